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

import math
from typing import Any

import warp as wp

from sonarwarp_kernels.critical import NO_DETECTION
from sonarwarp_kernels.field import check_field, corner_weight
from sonarwarp_kernels.launch import check_array, lanes, launch
from sonarwarp_kernels.particles import Contacts, check_contacts, world_point
from sonarwarp_kernels.proof import Carving, View, may_prove, proven_depth, seen_from, view_of
from sonarwarp_kernels.specs import Fan, Grid

wp.set_module_options({"enable_backward": False})

UNASKED = wp.constant(-2.0e9)
"""Content of a cell that nobody asked for."""
ASKED = wp.constant(-1.0e9)
"""Content of a cell that is to be measured."""

# Edge of the blocks of cells that frames are chosen for [cell]: with 4 as fast, with 16 a quarter slower.
BLOCK = wp.constant(8)

# Runs that a trajectory's frames are chosen in: bits of an integer.
RUNS = wp.constant(64)


@wp.struct
class Runs:
    """A trajectory's frames of ``order``, in runs of equal length, and which of those are asked."""

    start: int  # first place
    stop: int  # behind the last one
    length: int  # places in a run; the last runs may have fewer, or none
    asked: wp.uint64  # a bit each


@wp.func
def hypothesis(fan: Fan, number: int, hypotheses: int) -> float:
    """Elevation of one of ``hypotheses`` places, evenly spaced over a beam's extent [rad]."""
    step = (fan.elevation_max - fan.elevation_min) / float(hypotheses)
    return fan.elevation_min + (float(number) + 0.5) * step


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
    grid: Grid,
    fan: Fan,
    contacts: Contacts,
    hypotheses: int,
    free_depth_out: wp.array,
    *,
    device: Any = None,
    threads: int = 1,
) -> None:
    """Ask for the cells along the arcs of all critical points; arcs cross, but all write one and the same value.

    Args:
        grid: cells.
        fan: the imaging sonar.
        contacts: critical points of all frames.
        hypotheses: places on each arc (:func:`hypothesis`).
        free_depth_out: ``ASKED`` where asked, shape [trajectory, x, y, z].
        device: device of all arrays.
        threads: CPU threads.

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
        threads,
    )


@wp.func
def runs_that_prove(
    fan: Fan,
    carving: Carving,
    contacts: Contacts,
    view: View,
    order: wp.array(dtype=int),
    start: int,
    stop: int,
    centre: wp.vec3,
    radius: float,
) -> Runs:
    """The runs of which a frame may prove anything of a ball around a world point."""
    runs = Runs()
    runs.start = start
    runs.stop = stop
    runs.length = (stop - start + RUNS - 1) // RUNS
    for run in range(RUNS):
        begin = start + run * runs.length
        for place in range(begin, wp.min(begin + runs.length, stop)):
            frame = order[place]
            if may_prove(fan, carving, contacts, view, frame, seen_from(contacts, frame, centre), radius):
                runs.asked |= wp.uint64(1) << wp.uint64(run)
                break
    return runs


@wp.func
def measured_depth(
    fan: Fan,
    carving: Carving,
    contacts: Contacts,
    view: View,
    order: wp.array(dtype=int),
    runs: Runs,
    cell: wp.vec3,
) -> float:
    """Second largest depth that frames of the asked runs prove of a world point [m], kept within the reach."""
    kept = wp.vec2(-carving.reach, -carving.reach)
    # A frame of every run in turn: neighbours prove much the same.
    for step in range(runs.length):
        left = runs.asked
        place = runs.start + step
        while left != wp.uint64(0) and place < runs.stop:
            if (left & wp.uint64(1)) != wp.uint64(0):
                frame = order[place]
                point = seen_from(contacts, frame, cell)
                kept = two_largest(kept, proven_depth(fan, carving, contacts, view, frame, point))
                # Water that two frames prove empty stays so.
                if kept[1] >= carving.reach:
                    return carving.reach
            left = left >> wp.uint64(1)
            place += runs.length
    return kept[1]


@wp.kernel
def measure_free_depth_kernel(
    first: int,
    grid: Grid,
    fan: Fan,
    carving: Carving,
    contacts: Contacts,
    order: wp.array(dtype=int),  # [frame]
    first_frame: wp.array(dtype=int),  # [trajectory + 1]
    blocks: wp.vec3i,
    lane_count: int,
    free_depth_out: wp.array4d(dtype=float),  # [trajectory, x, y, z]
):
    index, lane = wp.tid()
    # Threads take slabs along y: what is asked for lies in few places along the way.
    block = first + index
    bz = block % blocks[2]
    block = block // blocks[2]
    bx = block % blocks[0]
    block = block // blocks[0]
    by = block % blocks[1]
    owner = block // blocks[1]
    low = BLOCK * wp.vec3i(bx, by, bz)
    size = grid.size[owner]
    chosen = bool(False)
    view = View()
    runs = Runs()
    for number in range(lane, BLOCK * BLOCK * BLOCK, lane_count):
        ix = low[0] + number // (BLOCK * BLOCK)
        iy = low[1] + number // BLOCK % BLOCK
        iz = low[2] + number % BLOCK
        if ix >= size[0] or iy >= size[1] or iz >= size[2]:
            continue
        if free_depth_out[owner, ix, iy, iz] == ASKED:
            if not chosen:
                chosen = True
                view = view_of(fan, carving)
                half = 0.5 * float(BLOCK)
                middle = wp.vec3(float(low[0]) + half, float(low[1]) + half, float(low[2]) + half)
                centre = grid.origin[owner] + grid.cell * middle
                radius = wp.sqrt(3.0) * half * grid.cell
                start = first_frame[owner]
                stop = first_frame[owner + 1]
                runs = runs_that_prove(fan, carving, contacts, view, order, start, stop, centre, radius)
            cell = grid.origin[owner] + grid.cell * wp.vec3(float(ix) + 0.5, float(iy) + 0.5, float(iz) + 0.5)
            free_depth_out[owner, ix, iy, iz] = measured_depth(fan, carving, contacts, view, order, runs, cell)


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
    blocks = [-(-cells // BLOCK) for cells in (grid.nx, grid.ny, grid.nz)]
    launch(
        measure_free_depth_kernel,
        (trajectories * math.prod(blocks), lane_count),
        [grid, fan, carving, contacts, order, first_frame, wp.vec3i(blocks), lane_count],
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
    """Free depth [m] at a world ``point``, trilinear between cell centres that anything is known of.

    Minus the reach where less than half of what counts there is known: no two frames looked, or all from behind.
    """
    size = grid.size[owner]
    place = (point - grid.origin[owner]) / grid.cell - wp.vec3(0.5, 0.5, 0.5)
    ix = int(wp.floor(place[0]))
    iy = int(wp.floor(place[1]))
    iz = int(wp.floor(place[2]))
    fraction = place - wp.vec3(float(ix), float(iy), float(iz))
    total = float(0.0)
    known = float(0.0)
    for corner in range(8):
        dx, dy, dz = corner & 1, (corner >> 1) & 1, corner >> 2
        value = cell_free_depth(free_depth, size, owner, ix + dx, iy + dy, iz + dz, reach)
        if value > -reach:
            weight = corner_weight(fraction, corner)
            total += weight * value
            known += weight
    if known < 0.5:
        return -reach
    return total / known
