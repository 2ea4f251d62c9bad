"""The likelihood field: per-cell log-odds of the profiling sonar's returns (Eq. 21-22).

Every ping adds fixed-point evidence to the cells that its beam covers: free before the first footprint, occupied
within a footprint, nothing behind it. Sums stay unclamped integers, so that a ping which leaves the window of the last
k sweeps is subtracted exactly by the same kernel with the opposite sign; they are clamped when read. A cell that no
ping touched holds 0: unknown, p = 1/2.

A beam of finite width sees an oblique surface over a stretch of range: its deeper edge meets it first. Where a
footprint is wider than a wall's could be, the occupied ridge follows that tilt across the beam instead of filling it.
"""

from typing import Any

import warp as wp

from sonarwarp_kernels.launch import check_array, launch
from sonarwarp_kernels.profile import NO_FOOTPRINT
from sonarwarp_kernels.slots import EMPTY
from sonarwarp_kernels.specs import Grid

wp.set_module_options({"enable_backward": False})

FIXED_POINT = wp.constant(65536.0)
"""Counts per unit of log-odds: 32,767 full-weight pings fit before a cell could overflow."""


@wp.struct
class ProfileModel:
    """Inverse sensor model of the profiling sonar."""

    hit: float  # log-odds added at a footprint's ridge on the beam's axis
    miss: float  # log-odds added in front of the first footprint on the beam's axis; negative
    no_return: float  # log-odds added along the whole beam of a ping without any footprint; at most 0
    half_width: float  # half the beamwidth in the scan plane [rad]
    half_fan: float  # half the beamwidth across it [rad]
    range_deviation: float  # deviation of a ridge along range [m]
    reach: float  # range that a ping without a footprint speaks for [m]


@wp.struct
class Ridge:
    """Where along range one footprint puts occupied evidence."""

    near: float  # 10 % point of its energy [m]
    centre: float  # crossing on the beam's axis [m]
    far: float  # 90 % point [m]
    tilt: float  # change of the crossing over one beamwidth [m]
    deviation: float  # along range [m]


@wp.func
def ridge_of(model: ProfileModel, footprint: wp.vec3) -> Ridge:
    """Ridge of a footprint.

    A surface inclined 45 deg to the beam spreads its footprint over r times the beamwidth. Walls spread less, and are
    taken as crossing every ray at one range; flatter surfaces are crossed later by shallower rays.
    """
    ridge = Ridge()
    # 10 % to 90 % of a uniform spread is 0.8 of it.
    spread = 1.25 * (footprint[2] - footprint[0])
    wall = 2.0 * model.half_width * footprint[1]
    flatness = wp.clamp(spread / wall - 1.0, 0.0, 1.0)
    ridge.near = footprint[0]
    ridge.centre = footprint[1]
    ridge.far = footprint[2]
    ridge.tilt = flatness * spread
    # A uniform spread s has deviation s / sqrt(12); a tilted ridge has taken that up.
    ridge.deviation = model.range_deviation + 0.289 * (1.0 - flatness) * spread
    return ridge


@wp.func
def beam_pattern(position: float) -> float:
    """Relative weight at an angular ``position`` in half widths off the axis: half at 1, nothing from sqrt(2) on."""
    return wp.max(1.0 - 0.5 * position * position, 0.0)


@wp.func
def ridge_evidence(model: ProfileModel, ridge: Ridge, nearest: bool, distance: float, position: float) -> float:
    """Log-odds on the ray at ``position`` half widths from the axis: free before the nearest ridge, occupied on one."""
    away = (distance - ridge.centre - 0.5 * position * ridge.tilt) / ridge.deviation
    if wp.abs(away) > 4.0:
        if nearest and away < 0.0:
            return model.miss
        return 0.0
    share = wp.exp(-0.5 * away * away)
    if nearest and away < 0.0:
        return share * model.hit + (1.0 - share) * model.miss
    return share * model.hit


@wp.func
def column_span(head_from_world: wp.transform, corner: wp.vec3, height: float, half_width: float) -> wp.vec2:
    """Heights above ``corner`` between which a vertical line lies within ``half_width`` [rad] of the scan plane's axis.

    Both of the beam's faces are planes through the head's z axis, hence linear in height: closed form at any attitude.
    Empty where the second is not above the first.
    """
    start = wp.transform_point(head_from_world, corner)
    rise = wp.transform_vector(head_from_world, wp.vec3(0.0, 0.0, 1.0))
    slope = wp.tan(half_width)
    low = float(0.0)
    high = height
    for side in range(2):
        sign = 1.0 - 2.0 * float(side)
        # sign * y <= slope * x along the line: offset + gain * h >= 0.
        offset = slope * start[0] - sign * start[1]
        gain = slope * rise[0] - sign * rise[1]
        if wp.abs(gain) < 1.0e-7:
            if offset < 0.0:
                high = -1.0
        else:
            root = -offset / gain
            if gain > 0.0:
                low = wp.max(low, root)
            else:
                high = wp.min(high, root)
    return wp.vec2(low, high)


@wp.kernel
def update_field_kernel(
    first: int,
    grid: Grid,
    model: ProfileModel,
    slot_ping: wp.array(dtype=int),  # [slot]
    trajectory: wp.array(dtype=int),  # [ping]
    world_from_head: wp.array(dtype=wp.transform),  # [ping]
    footprint: wp.array2d(dtype=wp.vec3),  # [ping, footprint]
    sign: int,
    log_odds_out: wp.array4d(dtype=int),  # [trajectory, x, y, z]
):
    row, iy = wp.tid()
    slot = (first + row) // grid.nx
    ix = (first + row) % grid.nx
    ping = slot_ping[slot]
    if ping == EMPTY:
        return
    owner = trajectory[ping]
    head = world_from_head[ping]
    head_from_world = wp.transform_inverse(head)
    nearest = ridge_of(model, footprint[ping, 0])
    clear = float(0.0)
    behind = model.reach
    if footprint[ping, 0][0] == NO_FOOTPRINT:
        if model.no_return == 0.0:
            return
    else:
        clear = nearest.centre - wp.abs(nearest.tilt) - 4.0 * nearest.deviation
        behind = float(0.0)
        for index in range(footprint.shape[1]):
            if footprint[ping, index][0] != NO_FOOTPRINT:
                ridge = ridge_of(model, footprint[ping, index])
                behind = wp.max(behind, ridge.centre + ridge.tilt + 4.0 * ridge.deviation)
    corner = grid.origin[owner] + grid.cell * wp.vec3(float(ix) + 0.5, float(iy) + 0.5, 0.0)
    span = column_span(head_from_world, corner, float(grid.nz) * grid.cell, wp.sqrt(2.0) * model.half_width)
    bottom = wp.max(int(wp.ceil(span[0] / grid.cell - 0.5)), 0)
    top = wp.min(int(wp.floor(span[1] / grid.cell - 0.5)), grid.nz - 1)
    start = wp.transform_point(head_from_world, corner)
    rise = wp.transform_vector(head_from_world, wp.vec3(0.0, 0.0, 1.0))
    fan = wp.sin(model.half_fan)
    for iz in range(bottom, top + 1):
        point = start + (float(iz) + 0.5) * grid.cell * rise
        distance = wp.length(point)
        if point[0] > 0.0 and distance < behind and wp.abs(point[2]) < distance * fan:
            # The beam is narrow: its tangent stands for the angle.
            position = point[1] / (point[0] * model.half_width)
            evidence = float(0.0)
            if footprint[ping, 0][0] == NO_FOOTPRINT:
                evidence = model.no_return
            elif distance < clear:
                evidence = model.miss
            else:
                evidence = ridge_evidence(model, nearest, True, distance, position)
                for index in range(1, footprint.shape[1]):
                    if footprint[ping, index][0] != NO_FOOTPRINT:
                        ridge = ridge_of(model, footprint[ping, index])
                        evidence += ridge_evidence(model, ridge, False, distance, position)
            counts = int(wp.round(beam_pattern(position) * evidence * FIXED_POINT))
            log_odds_out[owner, ix, iy, iz] += sign * counts


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

    At most one ping per trajectory may stand in one call: cells belong to one slot.

    Args:
        grid: cells, with ``origin`` of shape [trajectory].
        model: inverse sensor model.
        slot_ping: ping of each slot, ``EMPTY`` where empty, shape [slot].
        trajectory: owner of each ping, shape [ping].
        world_from_head: pose of the turned head, shape [ping].
        footprint: see :func:`sonarwarp_kernels.profile.detect_profile`, shape [ping, footprint].
        sign: +1 to add, -1 to subtract.
        log_odds_out: fixed-point sums, updated in place, shape [trajectory, x, y, z].
    """
    device = wp.get_device(device)
    pings = trajectory.shape[0]
    check_array("slot_ping", slot_ping, (None,), wp.int32, device)
    check_array("trajectory", trajectory, (pings,), wp.int32, device)
    check_array("world_from_head", world_from_head, (pings,), wp.transform, device)
    check_array("footprint", footprint, (pings, None), wp.vec3, device)
    check_array("log_odds_out", log_odds_out, (grid.origin.shape[0], grid.nx, grid.ny, grid.nz), wp.int32, device)
    if sign not in (1, -1):
        raise ValueError(f"sign: {sign} is neither 1 nor -1")
    launch(
        update_field_kernel,
        (slot_ping.shape[0] * grid.nx, grid.ny),
        [grid, model, slot_ping, trajectory, world_from_head, footprint, sign],
        [log_odds_out],
        device,
        threads,
    )


@wp.func
def cell_log_odds(log_odds: wp.array4d(dtype=int), owner: int, ix: int, iy: int, iz: int, low: float, high: float):
    """Clamped log-odds of one cell; 0, unknown, outside of the box."""
    inside = ix >= 0 and iy >= 0 and iz >= 0
    inside = inside and ix < log_odds.shape[1] and iy < log_odds.shape[2] and iz < log_odds.shape[3]
    if not inside:
        return 0.0
    return wp.clamp(float(log_odds[owner, ix, iy, iz]) / FIXED_POINT, low, high)


@wp.func
def read_log_odds(
    grid: Grid, log_odds: wp.array4d(dtype=int), owner: int, point: wp.vec3, low: float, high: float
) -> float:
    """Trilinear log-odds between cell centres at a world ``point``, every cell clamped to [low, high]."""
    place = (point - grid.origin[owner]) / grid.cell - wp.vec3(0.5, 0.5, 0.5)
    ix = int(wp.floor(place[0]))
    iy = int(wp.floor(place[1]))
    iz = int(wp.floor(place[2]))
    fx = place[0] - float(ix)
    fy = place[1] - float(iy)
    fz = place[2] - float(iz)
    total = float(0.0)
    for corner in range(8):
        dx = corner & 1
        dy = (corner >> 1) & 1
        dz = corner >> 2
        wx = 1.0 - fx
        wy = 1.0 - fy
        wz = 1.0 - fz
        if dx == 1:
            wx = fx
        if dy == 1:
            wy = fy
        if dz == 1:
            wz = fz
        total += wx * wy * wz * cell_log_odds(log_odds, owner, ix + dx, iy + dy, iz + dz, low, high)
    return total


@wp.func
def occupancy(log_odds: float) -> float:
    """Probability of a log-odds value (Eq. 22)."""
    return 1.0 - 1.0 / (1.0 + wp.exp(log_odds))


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
    """
    device = wp.get_device(device)
    points = point.shape[0]
    check_array("log_odds", log_odds, (grid.origin.shape[0], grid.nx, grid.ny, grid.nz), wp.int32, device)
    check_array("trajectory", trajectory, (points,), wp.int32, device)
    check_array("point", point, (points,), wp.vec3, device)
    check_array("occupancy_out", occupancy_out, (points,), wp.float32, device)
    launch(
        read_field_kernel, (points,), [grid, log_odds, trajectory, point, low, high], [occupancy_out], device, threads
    )
