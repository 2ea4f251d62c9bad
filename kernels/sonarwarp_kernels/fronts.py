"""Faces under the edges that the imaging sonar met, as the profiling sonar saw them.

From above an imaging sonar meets a steep face at its upper edge only; what lies below is hidden from it in principle.
The profiling sonar looks from further away at low depression. A footprint that is compact in range is a face: within
its narrow beam, all at one range. Where across its wide fan that face stands, the imaging sonar says:

- Places of the footprint's sheet in proven water are not it; this keeps the nearer of two objects from lending its face
  to the other. Where a nearer footprint of the same ping may be solid, the further one is hidden; this keeps the
  further object from lending its own. Nor does the ray to a face run under contacts.
- A face stands under contacts of the imaging sonar, a little before or behind; it ends at their height. Contacts
  further before it stand on the object as well, and under them it does not go on: a level top, compact where it is met
  steeply, has no faces in it.

At each place a robust line, run over height, goes through the footprints of other pings there, so that a face appears
as inclined as it is. The patch is that line over the height of the beam. One that is clearly flatter than the imaging
sonar's slope limit is none: of such a surface every place is met first by some beam, and a fan of 20 degrees blurs it.
Nor is one that overhangs by more than lines err, or whose footprints all lie at one height: the one comes of two
things, the other has no slope.
"""

from typing import Any

import warp as wp

from sonarwarp_kernels.edges import highest_along, highest_before, is_covered
from sonarwarp_kernels.faces import (
    FrontModel,
    Profiles,
    check_profiles,
    fan_angle_of,
    is_face,
    middle_of_face,
    share_on_face,
    sheet_point,
    upwards,
)
from sonarwarp_kernels.field import check_field
from sonarwarp_kernels.free_depth import ask_around, read_free_depth
from sonarwarp_kernels.launch import check_array, launch
from sonarwarp_kernels.profile import NO_FOOTPRINT
from sonarwarp_kernels.specs import Grid

wp.set_module_options({"enable_backward": False})

# Rounds of weighing residuals anew; the line has settled after three.
ROUNDS = wp.constant(4)


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
    if footprint[0] != NO_FOOTPRINT:
        angle = fan_angle_of(column, columns, 0.5 * model.spacing, footprint[1])
        if wp.abs(angle) <= model.half_fan:
            head = profiles.world_from_head[ping]
            point = sheet_point(head, footprint[1], angle)
            up = upwards(wp.transform_get_translation(head), point)
            # Of a face, a beam over it or into the ground shows another place than its axis.
            steps = int(0)
            if is_face(model, footprint) and point[2] >= profiles.seabed[ping] + model.least_height:
                steps = int(wp.ceil(model.half_width * footprint[1] / grid.cell))
            for step in range(-steps, steps + 1):
                ask_around(grid, profiles.trajectory[ping], point + float(step) * grid.cell * up, free_depth_out)


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
    check_profiles(grid, model, profiles, device)
    check_field(grid, "free_depth_out", free_depth_out, wp.float32, device)
    pings, footprints = profiles.footprint.shape
    # Places between two strips are read too.
    between = 2 * columns - 1
    launch(ask_sheets_kernel, (pings * footprints, between), [grid, model, profiles, between], [free_depth_out], device)


@wp.func
def is_hidden(
    grid: Grid,
    model: FrontModel,
    profiles: Profiles,
    free_depth: wp.array4d(dtype=float),
    ping: int,
    which: int,
    fan_angle: float,
) -> bool:
    """Whether a nearer footprint of the same ping may be solid at an angle across the fan, and hides what is behind."""
    hidden = bool(False)
    for nearer in range(which):
        cover = sheet_point(profiles.world_from_head[ping], profiles.footprint[ping, nearer][1], fan_angle)
        depth = read_free_depth(grid, free_depth, profiles.trajectory[ping], cover, model.reach)
        hidden = hidden or depth <= model.in_doubt
    return hidden


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
    ground = profiles.seabed[ping]
    if point[2] - half_height > ceiling or point[2] < ground + model.least_height:
        return
    axis_height = point[2]
    point = middle_of_face(model, wp.transform_get_translation(head), point, ground, ceiling)
    if read_free_depth(grid, free_depth, owner, point, model.reach) > model.in_doubt:
        return
    if is_covered(grid, top, owner, wp.transform_get_translation(head), point, model.clearance):
        return
    if is_hidden(grid, model, profiles, free_depth, ping, which, fan_angle):
        return
    place = float(0.0)
    run = float(0.0)
    variance = float(0.0)
    spread = float(0.0)
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
                    angle = wp.asin(aside / seen[1])
                    place_seen = sheet_point(pose, seen[1], angle)
                    origin = wp.transform_get_translation(pose)
                    away = middle_of_face(model, origin, place_seen, ground, ceiling) - point
                    x = wp.dot(away, ahead)
                    h = away[2]
                    near = wp.abs(x) < model.window_along and wp.abs(h) < model.window_height
                    share = share_on_face(model, origin, place_seen, ground, ceiling)
                    if near and share > 0.0 and point[2] + h > ground + 0.5 * model.least_height:
                        depth = read_free_depth(grid, free_depth, owner, point + away, model.reach)
                        if depth < model.in_doubt and not is_hidden(
                            grid, model, profiles, free_depth, neighbour, member, angle
                        ):
                            residual = (x - place - run * h) / model.deviation
                            near_height = h / (0.6 * model.window_height)
                            weight = share * wp.exp(-0.5 * near_height * near_height)
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
            moment = sum_hh - total * mean_h * mean_h
            # As if one more footprint, at the mean, knew its height to 2 cm: a line through few heights stands upright.
            run = (sum_hx - total * mean_h * mean_x) / (moment + 4.0e-4)
            place = mean_x - run * mean_h
            variance = sum_rr / total
            spread = moment / total
    if members < 2 or wp.abs(place) > 2.0 * model.deviation:
        return
    if run > model.most_run or run < model.least_run or spread < model.least_spread * model.least_spread:
        return
    low = wp.max(axis_height - half_height, ground + 0.5 * model.least_height)
    high = wp.min(axis_height + half_height, ceiling)
    foot = point + place * ahead + (low - point[2]) * run * ahead
    inside = highest_before(grid, model, top, owner, foot, ahead) - model.clearance
    # Within a level top no more is left than its contacts scatter.
    if high - inside < model.clearance + model.spacing:
        return
    low = wp.max(low, inside)
    fronts_out.found[ping, which, column] = 1
    fronts_out.point[ping, which, column] = point + place * ahead
    fronts_out.run[ping, which, column] = run * ahead + wp.vec3(0.0, 0.0, 1.0)
    fronts_out.low[ping, which, column] = low - point[2]
    fronts_out.high[ping, which, column] = high - point[2]
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
    check_profiles(grid, model, profiles, device)
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
