"""Rotations (Eq. 34-35), polar and Cartesian coordinates, and the indices of range bins.

Frames: x forward, y left, z up. Azimuth is positive to the left, elevation positive upwards. Two kinds of beam share
one formula set: the paper's fan turns by azimuth, then raises by elevation; a conical beam keeps y/r = sin(azimuth)
over its whole elevation extent, which is how a linear array hears and also what the profiling sonar's rotation order
``R_z(xi) R_y(phi) R_z(theta)`` gives.
"""

from typing import Any

import warp as wp

from sonarwarp_kernels.launch import check_array, launch

wp.set_module_options({"enable_backward": False})


@wp.func
def beam_direction(azimuth: float, elevation: float, cone: int) -> wp.vec3:
    """Unit direction in the sonar's frame; ``cone`` selects conical beams."""
    ca = wp.cos(azimuth)
    sa = wp.sin(azimuth)
    ce = wp.cos(elevation)
    se = wp.sin(elevation)
    if cone != 0:
        return wp.vec3(ca * ce, sa, ca * se)
    return wp.vec3(ca * ce, sa * ce, se)


@wp.func
def azimuth_of(point: wp.vec3, distance: float, cone: int) -> float:
    """Azimuth [rad] of a point in the sonar's frame, ``distance`` from its origin and not in it."""
    if cone != 0:
        return wp.asin(wp.clamp(point[1] / distance, -1.0, 1.0))
    return wp.atan2(point[1], point[0])


@wp.func
def polar_coordinates(point: wp.vec3, cone: int) -> wp.vec3:
    """Range [m], azimuth and elevation [rad] of a point in the sonar's frame; the inverse of :func:`beam_direction`."""
    distance = wp.length(point)
    if distance == 0.0:
        return wp.vec3(0.0, 0.0, 0.0)
    azimuth = azimuth_of(point, distance, cone)
    if cone != 0:
        return wp.vec3(distance, azimuth, wp.atan2(point[2], point[0]))
    return wp.vec3(distance, azimuth, wp.asin(wp.clamp(point[2] / distance, -1.0, 1.0)))


@wp.func
def rotation_about_z(angle: float) -> wp.quat:
    """Rotation by ``angle`` [rad] about z."""
    return wp.quat(0.0, 0.0, wp.sin(0.5 * angle), wp.cos(0.5 * angle))


@wp.func
def bin_below(range_edge: wp.array(dtype=float), distance: float) -> int:
    """Index of the last edge at or below ``distance``; -1 below the first, the bin count at or beyond the last.

    ``range_edge`` [bin + 1] ascends. The guess from the mean step is exact for uniform bins; the walk mends it for
    recorded, non-uniform ones.
    """
    bins = range_edge.shape[0] - 1
    if distance < range_edge[0]:
        return -1
    if distance >= range_edge[bins]:
        return bins
    guess = int(float(bins) * (distance - range_edge[0]) / (range_edge[bins] - range_edge[0]))
    index = wp.clamp(guess, 0, bins - 1)
    while index > 0 and distance < range_edge[index]:
        index -= 1
    while index < bins - 1 and distance >= range_edge[index + 1]:
        index += 1
    return index


@wp.func
def bin_range(range_edge: wp.array(dtype=float), position: float) -> float:
    """Slant range [m] at a fractional bin ``position``: 0 is the centre of the first bin."""
    bins = range_edge.shape[0] - 1
    coordinate = wp.clamp(position + 0.5, 0.0, float(bins))
    index = wp.min(int(coordinate), bins - 1)
    part = coordinate - float(index)
    return range_edge[index] * (1.0 - part) + range_edge[index + 1] * part


@wp.kernel
def turn_heads_kernel(
    first: int,
    world_from_mount: wp.array(dtype=wp.transform),  # [ping]
    head_angle: wp.array(dtype=float),  # [ping]
    world_from_head_out: wp.array(dtype=wp.transform),  # [ping]
):
    ping = first + wp.tid()
    turn = wp.transform(wp.vec3(0.0, 0.0, 0.0), rotation_about_z(head_angle[ping]))
    world_from_head_out[ping] = world_from_mount[ping] * turn


def turn_heads(
    world_from_mount: wp.array,
    head_angle: wp.array,
    world_from_head_out: wp.array,
    *,
    device: Any = None,
    threads: int = 1,
) -> None:
    """Poses of the profiling sonar's head: R_PS R_z(xi) of Eq. 34.

    What is left of Eq. 34, R_y(phi) R_z(theta) of the forward axis, is ``beam_direction(theta, -phi, cone=1)``.

    Args:
        world_from_mount: pose of the sonar's own frame, whose rotation is R_PS (Eq. 35), shape [ping].
        head_angle: xi [rad], positive from x towards y of the sonar's own frame, shape [ping].
        world_from_head_out: shape [ping].

    Raises:
        ValueError: an array of the wrong shape, type or device.
    """
    device = wp.get_device(device)
    pings = world_from_mount.shape[0]
    check_array("world_from_mount", world_from_mount, (pings,), wp.transform, device)
    check_array("head_angle", head_angle, (pings,), wp.float32, device)
    check_array("world_from_head_out", world_from_head_out, (pings,), wp.transform, device)
    launch(turn_heads_kernel, (pings,), [world_from_mount, head_angle], [world_from_head_out], device, threads)
