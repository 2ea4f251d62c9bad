"""Faces under the edges that the imaging sonar met, as the profiling sonar saw them.

From above an imaging sonar meets a steep face at its upper edge only; what lies below is hidden from it in principle.
The profiling sonar looks from further away at low depression. A footprint that is compact in range is a face: within
its narrow beam, all at one range. Where across its wide fan that face stands, the imaging sonar says:

- Places of the footprint's sheet in proven water are not it; this keeps the nearer of two objects from lending its face
  to the other.
- A face stands under contacts of the imaging sonar, a little before or behind; it ends at their height.

At each place a robust line, run over height, goes through the footprints of other pings there, so that a face appears
as inclined as it is. The patch is that line over the height of the beam.
"""

from typing import Any

import warp as wp

from sonarwarp_kernels.field import check_field
from sonarwarp_kernels.free_depth import ask_around, read_free_depth
from sonarwarp_kernels.geometry import beam_direction
from sonarwarp_kernels.launch import check_array, launch
from sonarwarp_kernels.profile import NO_FOOTPRINT
from sonarwarp_kernels.specs import Grid
from sonarwarp_kernels.tops import NO_HEIGHT, top_height

wp.set_module_options({"enable_backward": False})

# Rounds of weighing residuals anew; the line has settled after three.
ROUNDS = wp.constant(4)


@wp.struct
class FrontModel:
    """What counts as a face, and how its line is fitted."""

    half_width: float  # half the beamwidth in the scan plane [rad]
    half_fan: float  # half the beamwidth across it [rad]
    compact: float  # most spread of a face's footprint over the width of the beam there
    spacing: float  # distance between patches across the fan [m]
    reach: float  # bound of the free depths [m]
    least_height: float  # of a face over the seabed [m]
    in_doubt: float  # most free depth of a place that may be solid [m]
    before: float  # how far ahead of a face the contacts over it may stand [m]
    behind: float  # how far behind [m]
    window_along: float  # other footprints count up to this far along the way [m]
    window_height: float  # and up to this far in height [m]
    deviation: float  # of a footprint from its face's line [m]


@wp.struct
class Profiles:
    """Pings of all trajectories, and where each trajectory's stand in ``order``."""

    trajectory: wp.array(dtype=int)  # [ping]
    world_from_head: wp.array(dtype=wp.transform)  # [ping]
    footprint: wp.array2d(dtype=wp.vec3)  # [ping, footprint]
    seabed: wp.array(dtype=float)  # [ping] height of the seabed [m]
    order: wp.array(dtype=int)  # [ping] pings by trajectory
    first: wp.array(dtype=int)  # [trajectory + 1] where a trajectory begins in ``order``


@wp.struct
class Fronts:
    """Patches of faces, vertical strips one ``spacing`` wide; caller-owned, written in place."""

    found: wp.array3d(dtype=int)  # [ping, footprint, column] 1 where there is one
    point: wp.array3d(dtype=wp.vec3)  # [ping, footprint, column] on the face, at its beam's axis, world [m]
    run: wp.array3d(dtype=wp.vec3)  # [ping, footprint, column] displacement per metre of height
    low: wp.array3d(dtype=float)  # [ping, footprint, column] lower end over the point [m]
    high: wp.array3d(dtype=float)  # [ping, footprint, column] upper end over the point [m]
    deviation: wp.array3d(dtype=float)  # [ping, footprint, column] of the line along the way [m]


FRONT_TYPES = {
    "found": wp.int32,
    "point": wp.vec3,
    "run": wp.vec3,
    "low": wp.float32,
    "high": wp.float32,
    "deviation": wp.float32,
}
"""Element type of each array in :class:`Fronts`, for whoever allocates them."""


@wp.func
def highest_along(
    grid: Grid, model: FrontModel, top: wp.array3d(dtype=int), owner: int, point: wp.vec3, ahead: wp.vec3
) -> float:
    """Highest contact over a face's place: from ``before`` ahead of it to ``behind`` it, along the way."""
    highest = float(NO_HEIGHT)
    steps = int(wp.ceil((model.before + model.behind) / grid.cell))
    for step in range(steps + 1):
        place = point + (float(step) * grid.cell - model.before) * ahead
        highest = wp.max(highest, top_height(grid, top, owner, place))
    return highest


@wp.func
def is_face(model: FrontModel, footprint: wp.vec3) -> bool:
    """Whether a footprint is as compact in range as a face's within the beam."""
    # 10 % to 90 % of a uniform spread is 0.8 of it.
    spread = 1.25 * (footprint[2] - footprint[0])
    return footprint[0] != NO_FOOTPRINT and spread < model.compact * 2.0 * model.half_width * footprint[1]


@wp.func
def sheet_point(head: wp.transform, distance: float, fan_angle: float) -> wp.vec3:
    """World position on the beam's axis at a fan angle (Eq. 34)."""
    return wp.transform_point(head, distance * beam_direction(0.0, fan_angle, 1))


@wp.func
def fan_angle_of(column: int, columns: int, spacing: float, distance: float) -> float:
    """Angle across the fan [rad] of one of ``columns`` strips at a range, the middle one straight ahead."""
    return (float(column) - 0.5 * float(columns - 1)) * spacing / distance


@wp.kernel
def ask_sheets_kernel(
    first: int,
    grid: Grid,
    model: FrontModel,
    profiles: Profiles,
    columns: int,
    free_depth_out: wp.array4d(dtype=float),  # [trajectory, x, y, z]
):
    index, column = wp.tid()
    ping = (first + index) // profiles.footprint.shape[1]
    footprint = profiles.footprint[ping, (first + index) % profiles.footprint.shape[1]]
    if is_face(model, footprint):
        angle = fan_angle_of(column, columns, 0.5 * model.spacing, footprint[1])
        if wp.abs(angle) <= model.half_fan:
            point = sheet_point(profiles.world_from_head[ping], footprint[1], angle)
            ask_around(grid, profiles.trajectory[ping], point, free_depth_out)


def ask_sheets(
    grid: Grid, model: FrontModel, profiles: Profiles, columns: int, free_depth_out: wp.array, *, device: Any = None
) -> None:
    """Ask for the cells where faces might stand; on one CPU thread, for sheets cross.

    Args:
        grid: cells.
        model: what counts as a face.
        profiles: pings and their footprints.
        columns: strips across the fan, as in :func:`find_fronts`.
        free_depth_out: :data:`sonarwarp_kernels.free_depth.ASKED` where asked, shape [trajectory, x, y, z].
        device: device of all arrays.

    Raises:
        ValueError: an array of the wrong shape, type or device, or a model out of bounds.
    """
    device = wp.get_device(device)
    _check(grid, model, profiles, device)
    check_field(grid, "free_depth_out", free_depth_out, wp.float32, device)
    pings, footprints = profiles.footprint.shape
    # Places between two strips are read too.
    between = 2 * columns - 1
    launch(ask_sheets_kernel, (pings * footprints, between), [grid, model, profiles, between], [free_depth_out], device)


@wp.kernel
def find_fronts_kernel(
    first: int,
    grid: Grid,
    model: FrontModel,
    profiles: Profiles,
    free_depth: wp.array4d(dtype=float),  # [trajectory, x, y, z]
    top: wp.array3d(dtype=int),  # [trajectory, x, y]
    fronts_out: Fronts,
):
    index, column = wp.tid()
    footprints = profiles.footprint.shape[1]
    ping = (first + index) // footprints
    which = (first + index) % footprints
    fronts_out.found[ping, which, column] = 0
    footprint = profiles.footprint[ping, which]
    if not is_face(model, footprint):
        return
    distance = footprint[1]
    columns = fronts_out.found.shape[2]
    fan_angle = fan_angle_of(column, columns, model.spacing, distance)
    if wp.abs(fan_angle) > model.half_fan:
        return
    owner = profiles.trajectory[ping]
    head = profiles.world_from_head[ping]
    point = sheet_point(head, distance, fan_angle)
    half_height = model.half_width * distance
    axis = wp.transform_vector(head, wp.vec3(1.0, 0.0, 0.0))
    ahead = wp.normalize(wp.vec3(axis[0], axis[1], 0.0))
    ceiling = highest_along(grid, model, top, owner, point, ahead)
    seabed = profiles.seabed[ping] + model.least_height
    if point[2] - half_height > ceiling or point[2] < seabed:
        return
    if read_free_depth(grid, free_depth, owner, point, model.reach) > model.in_doubt:
        return
    place = float(0.0)
    run = float(0.0)
    variance = float(0.0)
    members = int(0)
    for round in range(ROUNDS):
        # Sums of weights, heights h and positions x along the way, relative to the point.
        total = float(0.0)
        sum_h = float(0.0)
        sum_x = float(0.0)
        sum_hh = float(0.0)
        sum_hx = float(0.0)
        sum_rr = float(0.0)
        members = int(0)
        for other in range(profiles.first[owner], profiles.first[owner + 1]):
            neighbour = profiles.order[other]
            pose = profiles.world_from_head[neighbour]
            aside = wp.dot(
                point - wp.transform_get_translation(pose), wp.transform_vector(pose, wp.vec3(0.0, 0.0, 1.0))
            )
            for member in range(footprints):
                seen = profiles.footprint[neighbour, member]
                if is_face(model, seen) and wp.abs(aside) < seen[1] * wp.sin(model.half_fan):
                    away = sheet_point(pose, seen[1], wp.asin(aside / seen[1])) - point
                    x = wp.dot(away, ahead)
                    h = away[2]
                    near = wp.abs(x) < model.window_along and wp.abs(h) < model.window_height
                    if near and point[2] + h > seabed - 0.5 * model.least_height:
                        depth = read_free_depth(grid, free_depth, owner, point + away, model.reach)
                        if depth < model.in_doubt:
                            residual = (x - place - run * h) / model.deviation
                            near_height = h / (0.6 * model.window_height)
                            weight = wp.exp(-0.5 * near_height * near_height)
                            if round > 0:
                                weight /= 1.0 + residual * residual
                            members += 1
                            total += weight
                            sum_h += weight * h
                            sum_x += weight * x
                            sum_hh += weight * h * h
                            sum_hx += weight * h * x
                            sum_rr += weight * residual * residual
        if total > 0.0:
            mean_h = sum_h / total
            mean_x = sum_x / total
            spread = sum_hh - total * mean_h * mean_h
            # As if one more footprint, at the mean, knew its height to 2 cm: a line through one height stands upright.
            run = (sum_hx - total * mean_h * mean_x) / (spread + 4.0e-4)
            place = mean_x - run * mean_h
            variance = sum_rr / total
    if members < 2 or wp.abs(place) > 2.0 * model.deviation:
        return
    fronts_out.found[ping, which, column] = 1
    fronts_out.point[ping, which, column] = point + place * ahead
    fronts_out.run[ping, which, column] = run * ahead + wp.vec3(0.0, 0.0, 1.0)
    fronts_out.low[ping, which, column] = wp.max(-half_height, seabed - 0.5 * model.least_height - point[2])
    fronts_out.high[ping, which, column] = wp.min(half_height, ceiling - point[2])
    fronts_out.deviation[ping, which, column] = model.deviation * wp.sqrt(wp.max(variance, 0.01))


def find_fronts(
    grid: Grid,
    model: FrontModel,
    profiles: Profiles,
    free_depth: wp.array,
    top: wp.array,
    fronts_out: Fronts,
    *,
    device: Any = None,
    threads: int = 1,
) -> None:
    """Find the faces that footprints show, strip by strip across each ping's fan.

    Args:
        grid: cells.
        model: what counts as a face.
        profiles: pings and their footprints (:func:`sonarwarp_kernels.profile.detect_profile`).
        free_depth: what the imaging sonar proved empty, shape [trajectory, x, y, z].
        top: highest contact in each column (:func:`sonarwarp_kernels.tops.raise_tops`), shape [trajectory, x, y].
        fronts_out: written for every footprint and column, whether found or not; where not, only ``found``.
        device: device of all arrays.
        threads: CPU threads.

    Raises:
        ValueError: an array of the wrong shape, type or device, or a model out of bounds.
    """
    device = wp.get_device(device)
    _check(grid, model, profiles, device)
    check_field(grid, "free_depth", free_depth, wp.float32, device)
    check_array("top", top, (grid.origin.shape[0], grid.nx, grid.ny), wp.int32, device)
    pings, footprints = profiles.footprint.shape
    check_array("fronts_out.found", fronts_out.found, (pings, footprints, None), wp.int32, device)
    shape = fronts_out.found.shape
    for name, dtype in FRONT_TYPES.items():
        check_array(f"fronts_out.{name}", getattr(fronts_out, name), shape, dtype, device)
    launch(
        find_fronts_kernel,
        (pings * footprints, shape[2]),
        [grid, model, profiles, free_depth, top],
        [fronts_out],
        device,
        threads,
    )


def _check(grid: Grid, model: FrontModel, profiles: Profiles, device: Any) -> None:
    for name in ("half_width", "half_fan", "spacing", "reach", "window_along", "window_height", "deviation"):
        if not getattr(model, name) > 0.0:
            raise ValueError(f"model.{name}: must be above 0, got {getattr(model, name)}")
    check_array("profiles.trajectory", profiles.trajectory, (None,), wp.int32, device)
    pings = profiles.trajectory.shape[0]
    check_array("profiles.world_from_head", profiles.world_from_head, (pings,), wp.transform, device)
    check_array("profiles.footprint", profiles.footprint, (pings, None), wp.vec3, device)
    check_array("profiles.seabed", profiles.seabed, (pings,), wp.float32, device)
    check_array("profiles.order", profiles.order, (pings,), wp.int32, device)
    check_array("profiles.first", profiles.first, (grid.origin.shape[0] + 1,), wp.int32, device)
