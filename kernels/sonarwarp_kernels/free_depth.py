"""Free depth: how far inside the water that the imaging sonar has proven empty a place lies.

A frame proves every beam empty up to its critical point, over the beam's whole elevation, or up to the ROI's end where
there is none. The free depth of a place is the second largest of r_free - r over all frames that look at it: positive
in the water, zero on what was met, negative behind it. It is linear along range, hence read between cells to a fraction
of one, where evidence counted as hits and misses only grows with the number of frames: consecutive arcs cross at 7 to
14 degrees, so that sums of hits build a false wedge in front of every wall. Of the largest alone, one frame with a
missed echo would pierce a surface. Neither depends on the order of frames.

Only cells that will be read are worth the work, a hundredth of the region of interest: those along the arcs of critical
points and on the sheets of the profiling sonar's faces. They are asked for first, then measured against all frames.
"""

from typing import Any

import warp as wp

from sonarwarp_kernels.critical import NO_DETECTION
from sonarwarp_kernels.field import check_field, corner_weight
from sonarwarp_kernels.geometry import polar_coordinates
from sonarwarp_kernels.launch import check_array, lanes, launch
from sonarwarp_kernels.particles import Contacts, check_contacts, world_point
from sonarwarp_kernels.specs import Fan, Grid

wp.set_module_options({"enable_backward": False})

UNASKED = wp.constant(-2.0e9)
"""Content of a cell that nobody asked for."""
ASKED = wp.constant(-1.0e9)
"""Content of a cell that is to be measured."""


@wp.struct
class Carving:
    """What a frame proves empty."""

    reach: float  # free depths are kept within +- this [m]
    guard: float  # a beam without a critical point is free up to this far before r_emin [m]
    margin: float  # part of a beam's elevation that proves nothing, at either edge: attitude and mounts err [rad]


@wp.func
def hypothesis(fan: Fan, number: int, hypotheses: int) -> float:
    """Elevation of one of ``hypotheses`` places, evenly spaced over a beam's extent [rad]."""
    step = (fan.elevation_max - fan.elevation_min) / float(hypotheses)
    return fan.elevation_min + (float(number) + 0.5) * step


@wp.func
def free_range(fan: Fan, carving: Carving, contacts: Contacts, frame: int, beam: int) -> float:
    """Range up to which a beam is empty [m]."""
    critical = contacts.critical_range[frame, beam]
    if critical != NO_DETECTION:
        return critical
    window_end = fan.range_edge[fan.range_edge.shape[0] - 1]
    return wp.min(contacts.seabed_range[frame, beam], window_end) - carving.guard


@wp.func
def nearest_beam(fan: Fan, angle: float) -> int:
    """Beam whose centre is nearest to ``angle`` [rad]; -1 outside of all beams."""
    if angle < fan.column_azimuth[0] or angle > fan.column_azimuth[fan.column_azimuth.shape[0] - 1]:
        return -1
    azimuth = fan.azimuth
    last = azimuth.shape[0] - 1
    if last == 0:
        return 0
    guess = float(last) * (angle - azimuth[0]) / (azimuth[last] - azimuth[0])
    beam = wp.clamp(int(wp.round(guess)), 0, last)
    while beam > 0 and wp.abs(azimuth[beam - 1] - angle) < wp.abs(azimuth[beam] - angle):
        beam -= 1
    while beam < last and wp.abs(azimuth[beam + 1] - angle) < wp.abs(azimuth[beam] - angle):
        beam += 1
    return beam


@wp.func
def two_largest(kept: wp.vec2, value: float) -> wp.vec2:
    """The two largest of three values, in descending order."""
    if value > kept[0]:
        return wp.vec2(value, kept[0])
    return wp.vec2(kept[0], wp.max(kept[1], value))


@wp.func
def ask_around(grid: Grid, owner: int, point: wp.vec3, free_depth_out: wp.array4d(dtype=float)):
    """Ask for the eight cells around a world point, as far as they lie in the trajectory's box."""
    size = grid.size[owner]
    place = (point - grid.origin[owner]) / grid.cell - wp.vec3(0.5, 0.5, 0.5)
    ix = int(wp.floor(place[0]))
    iy = int(wp.floor(place[1]))
    iz = int(wp.floor(place[2]))
    for x in range(wp.max(ix, 0), wp.min(ix + 2, size[0])):
        for y in range(wp.max(iy, 0), wp.min(iy + 2, size[1])):
            for z in range(wp.max(iz, 0), wp.min(iz + 2, size[2])):
                free_depth_out[owner, x, y, z] = ASKED


@wp.kernel
def ask_arcs_kernel(
    first: int,
    grid: Grid,
    fan: Fan,
    contacts: Contacts,
    hypotheses: int,
    free_depth_out: wp.array4d(dtype=float),  # [trajectory, x, y, z]
):
    index, beam = wp.tid()
    frame = first + index
    critical = contacts.critical_range[frame, beam]
    if critical != NO_DETECTION:
        pose = contacts.world_from_sensor[frame]
        for number in range(hypotheses):
            elevation = hypothesis(fan, number, hypotheses)
            point = world_point(pose, fan.azimuth[beam], elevation, critical, fan.cone)
            ask_around(grid, contacts.trajectory[frame], point, free_depth_out)


def ask_arcs(
    grid: Grid, fan: Fan, contacts: Contacts, hypotheses: int, free_depth_out: wp.array, *, device: Any = None
) -> None:
    """Ask for the cells along the arcs of all critical points; on one CPU thread, for arcs cross.

    Args:
        grid: cells.
        fan: the imaging sonar.
        contacts: critical points of all frames.
        hypotheses: places on each arc (:func:`hypothesis`).
        free_depth_out: ``ASKED`` where asked, shape [trajectory, x, y, z].
        device: device of all arrays.

    Raises:
        ValueError: an array of the wrong shape, type or device, or no hypotheses.
    """
    device = wp.get_device(device)
    if hypotheses < 1:
        raise ValueError(f"hypotheses: {hypotheses}, must be at least 1")
    check_contacts(fan, contacts, device)
    check_field(grid, "free_depth_out", free_depth_out, wp.float32, device)
    launch(
        ask_arcs_kernel,
        contacts.critical_range.shape,
        [grid, fan, contacts, hypotheses],
        [free_depth_out],
        device,
    )


@wp.kernel
def measure_free_depth_kernel(
    first: int,
    grid: Grid,
    fan: Fan,
    carving: Carving,
    contacts: Contacts,
    order: wp.array(dtype=int),  # [frame]
    first_frame: wp.array(dtype=int),  # [trajectory + 1]
    lane_count: int,
    free_depth_out: wp.array4d(dtype=float),  # [trajectory, x, y, z]
):
    index, lane = wp.tid()
    owner = (first + index) // grid.nx
    ix = (first + index) % grid.nx
    size = grid.size[owner]
    columns = wp.where(ix < size[0], size[1], 0)
    low = fan.elevation_min + carving.margin
    high = fan.elevation_max - carving.margin
    # Both kinds of fan lie within this share of the range above and below their middle.
    rise = wp.sin(wp.max(wp.abs(low), wp.abs(high)))
    for iy in range(lane, columns, lane_count):
        for iz in range(size[2]):
            if free_depth_out[owner, ix, iy, iz] == ASKED:
                cell = grid.origin[owner] + grid.cell * wp.vec3(float(ix) + 0.5, float(iy) + 0.5, float(iz) + 0.5)
                kept = wp.vec2(-carving.reach, -carving.reach)
                for place in range(first_frame[owner], first_frame[owner + 1]):
                    # Water that two frames prove empty stays so.
                    if kept[1] >= carving.reach:
                        break
                    frame = order[place]
                    pose = contacts.world_from_sensor[frame]
                    turn = wp.transform_get_rotation(pose)
                    point = wp.quat_rotate_inv(turn, cell - wp.transform_get_translation(pose))
                    if point[0] > 0.0 and wp.abs(point[2]) <= rise * wp.length(point):
                        kept = two_largest(kept, proven_depth(fan, carving, contacts, frame, point, low, high))
                free_depth_out[owner, ix, iy, iz] = wp.min(kept[1], carving.reach)


@wp.func
def proven_depth(
    fan: Fan, carving: Carving, contacts: Contacts, frame: int, point: wp.vec3, low: float, high: float
) -> float:
    """r_free - r of a point in the sensor's frame [m]; minus the reach where the frame does not look."""
    polar = polar_coordinates(point, fan.cone)
    depth = -carving.reach
    if polar[2] >= low and polar[2] <= high:
        beam = nearest_beam(fan, polar[1])
        if beam >= 0:
            depth = wp.max(free_range(fan, carving, contacts, frame, beam) - polar[0], depth)
    return depth


def measure_free_depth(
    grid: Grid,
    fan: Fan,
    carving: Carving,
    contacts: Contacts,
    order: wp.array,
    first_frame: wp.array,
    free_depth_out: wp.array,
    *,
    device: Any = None,
    threads: int = 1,
) -> None:
    """Free depth of every cell that was asked for, from all frames of its trajectory.

    Args:
        grid: cells.
        fan: the imaging sonar.
        carving: what a frame proves.
        contacts: critical points of all frames.
        order: frames by trajectory, int32, shape [frame].
        first_frame: where each trajectory begins in ``order``, int32, shape [trajectory + 1].
        free_depth_out: ``ASKED`` becomes the free depth [m], shape [trajectory, x, y, z].
        device: device of all arrays.
        threads: CPU threads.

    Raises:
        ValueError: an array of the wrong shape, type or device, or a carving out of bounds.
    """
    device = wp.get_device(device)
    if not carving.reach > 0.0:
        raise ValueError(f"carving.reach: must be above 0, got {carving.reach}")
    if not 0.0 <= carving.margin < 0.5 * (fan.elevation_max - fan.elevation_min):
        raise ValueError(f"carving.margin: must be at least 0 and leave some of the beam, got {carving.margin}")
    check_contacts(fan, contacts, device)
    check_array("fan.column_azimuth", fan.column_azimuth, (None,), wp.float32, device)
    if fan.column_azimuth.shape[0] < 2:
        raise ValueError(f"fan.column_azimuth: needs at least 2 borders, got {fan.column_azimuth.shape[0]}")
    check_array("order", order, contacts.trajectory.shape, wp.int32, device)
    trajectories = grid.origin.shape[0]
    check_array("first_frame", first_frame, (trajectories + 1,), wp.int32, device)
    check_field(grid, "free_depth_out", free_depth_out, wp.float32, device)
    lane_count = lanes(device)
    launch(
        measure_free_depth_kernel,
        (trajectories * grid.nx, lane_count),
        [grid, fan, carving, contacts, order, first_frame, lane_count],
        [free_depth_out],
        device,
        threads,
    )


@wp.func
def cell_free_depth(
    free_depth: wp.array4d(dtype=float), size: wp.vec3i, owner: int, ix: int, iy: int, iz: int, reach: float
) -> float:
    """Free depth of one cell [m]; not proven at all outside of the trajectory's box and where nobody asked."""
    inside = ix >= 0 and iy >= 0 and iz >= 0
    inside = inside and ix < size[0] and iy < size[1] and iz < size[2]
    if not inside:
        return -reach
    return wp.max(free_depth[owner, ix, iy, iz], -reach)


@wp.func
def read_free_depth(grid: Grid, free_depth: wp.array4d(dtype=float), owner: int, point: wp.vec3, reach: float) -> float:
    """Free depth [m] at a world ``point``, trilinear between cell centres."""
    size = grid.size[owner]
    place = (point - grid.origin[owner]) / grid.cell - wp.vec3(0.5, 0.5, 0.5)
    ix = int(wp.floor(place[0]))
    iy = int(wp.floor(place[1]))
    iz = int(wp.floor(place[2]))
    fraction = place - wp.vec3(float(ix), float(iy), float(iz))
    total = float(0.0)
    for corner in range(8):
        dx, dy, dz = corner & 1, (corner >> 1) & 1, corner >> 2
        value = cell_free_depth(free_depth, size, owner, ix + dx, iy + dy, iz + dz, reach)
        total += corner_weight(fraction, corner) * value
    return total
