"""The likelihood field: per-cell log-odds of the profiling sonar's returns (Eq. 21-22).

Every ping adds fixed-point evidence to the cells that its beam covers (see :mod:`sonarwarp_kernels.inverse`). Sums stay
unclamped integers, so that a ping which leaves the window of the last k sweeps is subtracted exactly by the same kernel
with the opposite sign; they are clamped when read. A cell that no ping touched holds 0: unknown, p = 1/2.
"""

from typing import Any

import warp as wp

from sonarwarp_kernels.inverse import Beam, ProfileModel, beam_evidence, beam_of, check_model
from sonarwarp_kernels.launch import check_array, lanes, launch
from sonarwarp_kernels.slots import EMPTY
from sonarwarp_kernels.specs import Grid

wp.set_module_options({"enable_backward": False})

FIXED_POINT = wp.constant(65536.0)
"""Counts per unit of log-odds: a cell holds sums up to 32,767 either way."""


def check_grid(grid: Grid, device: Any) -> None:
    """Refuse a grid that a kernel would misread."""
    if not grid.cell > 0.0:
        raise ValueError(f"grid.cell: must be above 0, got {grid.cell}")
    check_array("grid.origin", grid.origin, (None,), wp.vec3, device)
    check_array("grid.size", grid.size, (grid.origin.shape[0],), wp.vec3i, device)


def check_field(grid: Grid, name: str, cells: wp.array, dtype: Any, device: Any) -> None:
    """Refuse a grid and an array of its cells, called ``name``, that do not fit each other."""
    check_grid(grid, device)
    check_array(name, cells, (grid.origin.shape[0], grid.nx, grid.ny, grid.nz), dtype, device)


@wp.func
def column_span(start: wp.vec3, rise: wp.vec3, height: float, slope: float) -> wp.vec2:
    """Heights in [0, ``height``] at which the line ``start`` + h ``rise``, in the head's frame, has |y| <= slope x.

    Both faces of the beam are planes through the head's z axis, hence linear in h: closed form at any attitude. Empty
    where the second is not above the first.
    """
    low = float(0.0)
    high = float(height)
    for side in range(2):
        sign = 1.0 - 2.0 * float(side)
        # sign * y <= slope * x along the line: offset + gain * h >= 0.
        offset = slope * start[0] - sign * start[1]
        gain = slope * rise[0] - sign * rise[1]
        if wp.abs(gain) < 1.0e-7:
            if offset < 0.0:
                high = 0.0
        else:
            root = -offset / gain
            if gain > 0.0:
                low = wp.max(low, root)
            else:
                high = wp.min(high, root)
    # A root may lie farther away than an index of cells can count.
    return wp.vec2(wp.min(low, height), wp.max(high, 0.0))


@wp.func
def add_ping(
    grid: Grid,
    model: ProfileModel,
    footprint: wp.array2d(dtype=wp.vec3),
    beam: Beam,
    owner: int,
    head_from_world: wp.transform,
    ix: int,
    lane: int,
    lane_count: int,
    sign: int,
    log_odds_out: wp.array4d(dtype=int),
):
    """Add a ping, times ``sign``, to every ``lane_count``-th column of one x of its trajectory's box."""
    size = grid.size[owner]
    if ix >= size[0]:
        return
    corner = grid.origin[owner] + grid.cell * wp.vec3(float(ix) + 0.5, 0.5, 0.0)
    base = wp.transform_point(head_from_world, corner)
    across = wp.transform_vector(head_from_world, wp.vec3(0.0, 1.0, 0.0))
    rise = wp.transform_vector(head_from_world, wp.vec3(0.0, 0.0, 1.0))
    fan = wp.sin(model.half_fan)
    slope = wp.tan(wp.sqrt(2.0) * model.half_width)
    height = float(size[2]) * grid.cell
    # A head may be mounted either way up.
    shallower = wp.where(rise[1] < 0.0, -1.0, 1.0)
    for iy in range(lane, size[1], lane_count):
        start = base + float(iy) * grid.cell * across
        if wp.length(start - wp.dot(start, rise) * rise) < beam.behind:
            span = column_span(start, rise, height, slope)
            bottom = wp.max(int(wp.ceil(span[0] / grid.cell - 0.5)), 0)
            top = wp.min(int(wp.floor(span[1] / grid.cell - 0.5)), size[2] - 1)
            for iz in range(bottom, top + 1):
                point = start + (float(iz) + 0.5) * grid.cell * rise
                distance = wp.length(point)
                if point[0] > 0.0 and distance < beam.behind and wp.abs(point[2]) < distance * fan:
                    # The beam is narrow: its tangent stands for the angle.
                    position = shallower * point[1] / (point[0] * model.half_width)
                    evidence = beam_evidence(model, footprint, beam, distance, position)
                    log_odds_out[owner, ix, iy, iz] += sign * int(wp.round(evidence * FIXED_POINT))


@wp.kernel
def update_field_kernel(
    first: int,
    grid: Grid,
    model: ProfileModel,
    slot_ping: wp.array2d(dtype=int),  # [row, slot]
    trajectory: wp.array(dtype=int),  # [ping]
    world_from_head: wp.array(dtype=wp.transform),  # [ping]
    footprint: wp.array2d(dtype=wp.vec3),  # [ping, footprint]
    sign: int,
    lane_count: int,
    log_odds_out: wp.array4d(dtype=int),  # [trajectory, x, y, z]
):
    index, lane = wp.tid()
    row = (first + index) // grid.nx
    ix = (first + index) % grid.nx
    for slot in range(slot_ping.shape[1]):
        ping = slot_ping[row, slot]
        if ping != EMPTY:
            add_ping(
                grid,
                model,
                footprint,
                beam_of(model, footprint, ping),
                trajectory[ping],
                wp.transform_inverse(world_from_head[ping]),
                ix,
                lane,
                lane_count,
                sign,
                log_odds_out,
            )


def update_field(
    grid: Grid,
    model: ProfileModel,
    slot_ping: wp.array,
    trajectory: wp.array,
    world_from_head: wp.array,
    footprint: wp.array,
    sign: int,
    log_odds_out: wp.array,
    *,
    device: Any = None,
    threads: int = 1,
) -> None:
    """Add pings to the fields of their trajectories, or take them out again (Eq. 21).

    All pings of one trajectory must stand in one row: cells belong to one row.

    Args:
        grid: cells, with ``origin`` and ``size`` of shape [trajectory]; no size above (nx, ny, nz).
        model: inverse sensor model.
        slot_ping: ping of each slot, ``EMPTY`` where empty, shape [row, slot].
        trajectory: owner of each ping, shape [ping].
        world_from_head: pose of the turned head, shape [ping].
        footprint: see :func:`sonarwarp_kernels.profile.detect_profile`, shape [ping, footprint].
        sign: +1 to add, -1 to subtract.
        log_odds_out: fixed-point sums, updated in place, shape [trajectory, x, y, z].

    Raises:
        ValueError: an array of the wrong shape, type or device, a model out of bounds, or another sign.
    """
    device = wp.get_device(device)
    check_model(model)
    check_array("slot_ping", slot_ping, (None, None), wp.int32, device)
    check_array("trajectory", trajectory, (None,), wp.int32, device)
    pings = trajectory.shape[0]
    check_array("world_from_head", world_from_head, (pings,), wp.transform, device)
    check_array("footprint", footprint, (pings, None), wp.vec3, device)
    check_field(grid, "log_odds_out", log_odds_out, wp.int32, device)
    if sign not in (1, -1):
        raise ValueError(f"sign: {sign} is neither 1 nor -1")
    lane_count = lanes(device)
    launch(
        update_field_kernel,
        (slot_ping.shape[0] * grid.nx, lane_count),
        [grid, model, slot_ping, trajectory, world_from_head, footprint, sign, lane_count],
        [log_odds_out],
        device,
        threads,
    )


@wp.func
def cell_log_odds(
    log_odds: wp.array4d(dtype=int), size: wp.vec3i, owner: int, ix: int, iy: int, iz: int, low: float, high: float
) -> float:
    """Clamped log-odds of one cell; 0, unknown, outside of the trajectory's box of ``size`` cells."""
    inside = ix >= 0 and iy >= 0 and iz >= 0
    inside = inside and ix < size[0] and iy < size[1] and iz < size[2]
    if not inside:
        return 0.0
    return wp.clamp(float(log_odds[owner, ix, iy, iz]) / FIXED_POINT, low, high)


@wp.func
def corner_weight(fraction: wp.vec3, corner: int) -> float:
    """Trilinear weight of one of the eight cells around a point, its bits the offsets along x, y and z."""
    x = wp.where((corner & 1) == 1, fraction[0], 1.0 - fraction[0])
    y = wp.where(((corner >> 1) & 1) == 1, fraction[1], 1.0 - fraction[1])
    z = wp.where((corner >> 2) == 1, fraction[2], 1.0 - fraction[2])
    return x * y * z


@wp.func
def read_log_odds(
    grid: Grid, log_odds: wp.array4d(dtype=int), owner: int, point: wp.vec3, low: float, high: float
) -> float:
    """Trilinear log-odds between cell centres at a world ``point``, every cell clamped to [low, high]."""
    size = grid.size[owner]
    place = (point - grid.origin[owner]) / grid.cell - wp.vec3(0.5, 0.5, 0.5)
    ix = int(wp.floor(place[0]))
    iy = int(wp.floor(place[1]))
    iz = int(wp.floor(place[2]))
    fraction = place - wp.vec3(float(ix), float(iy), float(iz))
    total = float(0.0)
    for corner in range(8):
        dx, dy, dz = corner & 1, (corner >> 1) & 1, corner >> 2
        value = cell_log_odds(log_odds, size, owner, ix + dx, iy + dy, iz + dz, low, high)
        total += corner_weight(fraction, corner) * value
    return total


@wp.func
def occupancy(log_odds: float) -> float:
    """Probability of a log-odds value (Eq. 22); as a quotient, so that small ones keep their digits."""
    return 1.0 / (1.0 + wp.exp(-log_odds))


@wp.kernel
def read_field_kernel(
    first: int,
    grid: Grid,
    log_odds: wp.array4d(dtype=int),  # [trajectory, x, y, z]
    trajectory: wp.array(dtype=int),  # [point]
    point: wp.array(dtype=wp.vec3),  # [point]
    low: float,
    high: float,
    occupancy_out: wp.array(dtype=float),  # [point]
):
    index = first + wp.tid()
    value = read_log_odds(grid, log_odds, trajectory[index], point[index], low, high)
    occupancy_out[index] = occupancy(value)


def read_field(
    grid: Grid,
    log_odds: wp.array,
    trajectory: wp.array,
    point: wp.array,
    low: float,
    high: float,
    occupancy_out: wp.array,
    *,
    device: Any = None,
    threads: int = 1,
) -> None:
    """Occupancy probability at world points (Eq. 22), trilinear in clamped log-odds.

    Args:
        grid: cells.
        log_odds: fixed-point sums, shape [trajectory, x, y, z].
        trajectory: field that each point asks, shape [point].
        point: world positions [m], shape [point].
        low: lower clamp of the log-odds.
        high: upper clamp of the log-odds.
        occupancy_out: probability, shape [point].

    Raises:
        ValueError: an array of the wrong shape, type or device.
    """
    device = wp.get_device(device)
    check_field(grid, "log_odds", log_odds, wp.int32, device)
    check_array("point", point, (None,), wp.vec3, device)
    points = point.shape[0]
    check_array("trajectory", trajectory, (points,), wp.int32, device)
    check_array("occupancy_out", occupancy_out, (points,), wp.float32, device)
    launch(
        read_field_kernel, (points,), [grid, log_odds, trajectory, point, low, high], [occupancy_out], device, threads
    )
