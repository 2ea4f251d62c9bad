"""What the particles of a beam say: likeliest point, weighted mean, covariance, effective sample size (Eq. 19-20, 32).

The most likely point is the particle of the largest target density; the moments are of the importance weights. Where
the field knows nothing along the arc, the point falls back to the lower edge of the beam and says so. That edge is also
where the single-sonar method puts every point.
"""

from typing import Any

import warp as wp

from sonarwarp_kernels.critical import NO_DETECTION
from sonarwarp_kernels.launch import check_array, launch
from sonarwarp_kernels.particles import Contacts, Particle, Reading, arc_of, check_inputs, draw_particle, world_point
from sonarwarp_kernels.slots import EMPTY
from sonarwarp_kernels.specs import Fan, Grid, Mixture

wp.set_module_options({"enable_backward": False})

QUALITY_NONE = wp.constant(0)
"""Nothing was detected in the beam."""
QUALITY_FALLBACK = wp.constant(1)
"""Detected, but the field knows nothing along the arc: placed at the beam's lower edge."""
QUALITY_INFORMED = wp.constant(2)
"""Placed by the field."""

NORMAL_INTERVAL = wp.constant(1.959964)
"""Half the interval that holds 95 % of a normal distribution, in standard deviations."""


@wp.struct
class Estimates:
    """What the particles of every frame and beam say; caller-owned, written in place."""

    quality: wp.array2d(dtype=int)  # [frame, beam]
    likely: wp.array2d(dtype=wp.vec3)  # [frame, beam] most likely point, world [m]; the lower edge in a fallback
    elevation: wp.array2d(dtype=float)  # [frame, beam] elevation of the most likely point [rad]
    mean: wp.array2d(dtype=wp.vec3)  # [frame, beam] weighted mean, world [m]
    covariance: wp.array2d(dtype=wp.mat33)  # [frame, beam] weighted covariance, world [m2]
    elevation_mean: wp.array2d(dtype=float)  # [frame, beam] weighted mean elevation [rad]
    elevation_deviation: wp.array2d(dtype=float)  # [frame, beam] weighted standard deviation of elevation [rad]
    elevation_low: wp.array2d(dtype=float)  # [frame, beam] lower end of the interval that holds 95 % [rad]
    elevation_high: wp.array2d(dtype=float)  # [frame, beam] its upper end [rad]
    effective_size: wp.array2d(dtype=float)  # [frame, beam] effective sample size


ESTIMATE_TYPES = {
    "quality": wp.int32,
    "likely": wp.vec3,
    "elevation": wp.float32,
    "mean": wp.vec3,
    "covariance": wp.mat33,
    "elevation_mean": wp.float32,
    "elevation_deviation": wp.float32,
    "elevation_low": wp.float32,
    "elevation_high": wp.float32,
    "effective_size": wp.float32,
}
"""Element type of each array in :class:`Estimates`, for whoever allocates them."""


def check_estimates(estimates: Estimates, shape: tuple[int, int], device: Any) -> None:
    """Refuse estimates whose arrays are not all of ``shape`` [frame, beam].

    Raises:
        ValueError: an array of the wrong shape, type or device.
    """
    for name, dtype in ESTIMATE_TYPES.items():
        check_array(f"estimates_out.{name}", getattr(estimates, name), shape, dtype, device)


@wp.kernel
def estimate_points_kernel(
    first: int,
    fan: Fan,
    grid: Grid,
    mixture: Mixture,
    reading: Reading,
    contacts: Contacts,
    slot_frame: wp.array(dtype=int),  # [slot]
    log_odds: wp.array4d(dtype=int),  # [trajectory, x, y, z]
    particles: int,
    estimates_out: Estimates,
):
    row = first + wp.tid()
    beams = contacts.critical_range.shape[1]
    frame = slot_frame[row // beams]
    beam = row % beams
    if frame == EMPTY:
        return
    critical = contacts.critical_range[frame, beam]
    if critical == NO_DETECTION:
        estimates_out.quality[frame, beam] = QUALITY_NONE
        return
    arc = arc_of(fan, contacts, frame, beam)
    # Moments about the beam's middle at the critical range, so that squares stay small in float32.
    centre = world_point(arc.pose, arc.azimuth, 0.0, critical, fan.cone)
    total = float(0.0)
    # Of small weights the squares underflow in float32.
    squares = wp.float64(0.0)
    shift = wp.vec3(0.0, 0.0, 0.0)
    outer = wp.mat33()
    angle = float(0.0)
    angle_square = float(0.0)
    best = Particle()
    best.target = -1.0
    for index in range(particles):
        drawn = draw_particle(fan, grid, mixture, reading, log_odds, arc, index, particles)
        if drawn.target > best.target:
            best = drawn
        away = drawn.point - centre
        total += drawn.weight
        squares += wp.float64(drawn.weight) * wp.float64(drawn.weight)
        shift += drawn.weight * away
        outer += drawn.weight * wp.outer(away, away)
        angle += drawn.weight * drawn.elevation
        angle_square += drawn.weight * drawn.elevation * drawn.elevation
    mean = shift / total
    mean_angle = angle / total
    estimates_out.mean[frame, beam] = centre + mean
    estimates_out.covariance[frame, beam] = outer / total - wp.outer(mean, mean)
    estimates_out.elevation_mean[frame, beam] = mean_angle
    deviation = wp.sqrt(wp.max(angle_square / total - mean_angle * mean_angle, 0.0))
    estimates_out.elevation_deviation[frame, beam] = deviation
    estimates_out.elevation_low[frame, beam] = mean_angle - NORMAL_INTERVAL * deviation
    estimates_out.elevation_high[frame, beam] = mean_angle + NORMAL_INTERVAL * deviation
    estimates_out.effective_size[frame, beam] = float(wp.float64(total) * wp.float64(total) / squares)
    if best.log_odds >= reading.informed:
        estimates_out.quality[frame, beam] = QUALITY_INFORMED
        estimates_out.elevation[frame, beam] = best.elevation
        estimates_out.likely[frame, beam] = best.point
    else:
        estimates_out.quality[frame, beam] = QUALITY_FALLBACK
        estimates_out.elevation[frame, beam] = fan.elevation_min
        estimates_out.likely[frame, beam] = world_point(arc.pose, arc.azimuth, fan.elevation_min, critical, fan.cone)


def estimate_points(
    fan: Fan,
    grid: Grid,
    mixture: Mixture,
    reading: Reading,
    contacts: Contacts,
    slot_frame: wp.array,
    log_odds: wp.array,
    particles: int,
    estimates_out: Estimates,
    *,
    device: Any = None,
    threads: int = 1,
) -> None:
    """Estimate where the critical points of some frames lie.

    Args:
        fan: the imaging sonar.
        grid: cells of the field.
        mixture: range likelihood.
        reading: how the field is read.
        contacts: critical points of all frames.
        slot_frame: frame of each slot, ``EMPTY`` for none, no frame twice, shape [slot].
        log_odds: the field's fixed-point sums, shape [trajectory, x, y, z].
        particles: hypotheses per beam, at least 1.
        estimates_out: written for the frames of the slots; where nothing was detected, only the quality.

    Raises:
        ValueError: as :func:`sonarwarp_kernels.particles.check_inputs` does, an output of the wrong shape, type or
            device, or no particles.
    """
    device = wp.get_device(device)
    check_inputs(fan, grid, mixture, reading, contacts, slot_frame, log_odds, device)
    beams = contacts.critical_range.shape[1]
    check_estimates(estimates_out, contacts.critical_range.shape, device)
    if particles < 1:
        raise ValueError(f"particles: {particles}, must be at least 1")
    launch(
        estimate_points_kernel,
        (slot_frame.shape[0] * beams,),
        [fan, grid, mixture, reading, contacts, slot_frame, log_odds, particles],
        [estimates_out],
        device,
        threads,
    )


@wp.kernel
def place_at_lower_edge_kernel(
    first: int,
    fan: Fan,
    world_from_sensor: wp.array(dtype=wp.transform),  # [frame]
    critical_range: wp.array2d(dtype=float),  # [frame, beam]
    point_out: wp.array2d(dtype=wp.vec3),  # [frame, beam]
):
    row = first + wp.tid()
    beams = critical_range.shape[1]
    frame = row // beams
    beam = row % beams
    critical = critical_range[frame, beam]
    if critical != NO_DETECTION:
        point_out[frame, beam] = world_point(
            world_from_sensor[frame], fan.azimuth[beam], fan.elevation_min, critical, fan.cone
        )


def place_at_lower_edge(
    fan: Fan,
    world_from_sensor: wp.array,
    critical_range: wp.array,
    point_out: wp.array,
    *,
    device: Any = None,
    threads: int = 1,
) -> None:
    """The single-sonar method's points (the paper's [11]): every critical point at the beam's lower edge.

    Args:
        fan: the imaging sonar.
        world_from_sensor: pose of each frame, shape [frame].
        critical_range: critical range [m], ``NO_DETECTION`` where there is none, shape [frame, beam].
        point_out: world position [m]; untouched where nothing was detected; shape [frame, beam].

    Raises:
        ValueError: an array of the wrong shape, type or device.
    """
    device = wp.get_device(device)
    check_array("fan.azimuth", fan.azimuth, (None,), wp.float32, device)
    check_array("world_from_sensor", world_from_sensor, (None,), wp.transform, device)
    frames, beams = world_from_sensor.shape[0], fan.azimuth.shape[0]
    check_array("critical_range", critical_range, (frames, beams), wp.float32, device)
    check_array("point_out", point_out, (frames, beams), wp.vec3, device)
    launch(
        place_at_lower_edge_kernel,
        (frames * beams,),
        [fan, world_from_sensor, critical_range],
        [point_out],
        device,
        threads,
    )
