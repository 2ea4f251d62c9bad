"""Footprints of steep faces: which ones they are, and where on the wide fan of the profiling sonar they lie."""

from typing import Any

import warp as wp

from sonarwarp_kernels.geometry import beam_direction
from sonarwarp_kernels.launch import check_array
from sonarwarp_kernels.profile import NO_FOOTPRINT, is_compact
from sonarwarp_kernels.specs import Grid

wp.set_module_options({"enable_backward": False})


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
    edge_height: float  # how much contacts on the edge may be too high [m]
    window_along: float  # other footprints count up to this far along the way [m]
    window_height: float  # and up to this far in height [m]
    deviation: float  # of a footprint from its face's line [m]
    most_run: float  # most way back of a face over its height: flatter ones the imaging sonar sees as they are
    least_run: float  # and the least, below zero where a face may overhang
    least_spread: float  # standard deviation of the heights that a face's line goes through [m]
    clearance: float  # a ray that runs this deep under contacts has met the object before the face [m]


@wp.struct
class Profiles:
    """Pings of all trajectories, and where each trajectory's stand in ``order``."""

    trajectory: wp.array(dtype=int)  # [ping]
    world_from_head: wp.array(dtype=wp.transform)  # [ping]
    footprint: wp.array2d(dtype=wp.vec3)  # [ping, footprint]
    seabed: wp.array(dtype=float)  # [ping] height of the seabed [m]
    order: wp.array(dtype=int)  # [ping] pings by trajectory
    first: wp.array(dtype=int)  # [trajectory + 1] where a trajectory begins in ``order``


@wp.func
def is_face(model: FrontModel, footprint: wp.vec3) -> bool:
    """Whether a footprint is as compact in range as a face's within the beam."""
    return footprint[0] != NO_FOOTPRINT and is_compact(footprint, model.half_width, model.compact)


@wp.func
def sheet_point(head: wp.transform, distance: float, fan_angle: float) -> wp.vec3:
    """World position on the beam's axis at a fan angle (Eq. 34)."""
    return wp.transform_point(head, distance * beam_direction(0.0, fan_angle, 1))


@wp.func
def upwards(origin: wp.vec3, point: wp.vec3) -> wp.vec3:
    """Unit direction across the ray to a point, in its vertical plane."""
    ray = point - origin
    return wp.normalize(wp.vec3(0.0, 0.0, 1.0) - ray[2] / wp.length_sq(ray) * ray)


@wp.func
def heights_on_face(model: FrontModel, origin: wp.vec3, point: wp.vec3, ground: float, ceiling: float) -> wp.vec2:
    """Heights [m] between which a footprint's beam meets a face; the second is the lower one where it misses."""
    half = model.half_width * wp.length(point - origin) * upwards(origin, point)[2]
    return wp.vec2(wp.max(point[2] - half, ground), wp.min(point[2] + half, ceiling))


@wp.func
def middle_of_face(model: FrontModel, origin: wp.vec3, point: wp.vec3, ground: float, ceiling: float) -> wp.vec3:
    """Where a footprint's echo comes from: of a beam that reaches into the ground or over the face, the middle between.

    The range stays, so that a place lower down lies nearer to the head along the way.
    """
    heights = heights_on_face(model, origin, point, ground, ceiling)
    if heights[1] <= heights[0]:
        return point
    up = upwards(origin, point)
    return point + (0.5 * (heights[0] + heights[1]) - point[2]) / up[2] * up


@wp.func
def share_on_face(model: FrontModel, origin: wp.vec3, point: wp.vec3, ground: float, ceiling: float) -> float:
    """Share of a footprint's beam that meets a face, 0 where it misses: the rest bends its range."""
    heights = heights_on_face(model, origin, point, ground, ceiling)
    width = 2.0 * model.half_width * wp.length(point - origin) * upwards(origin, point)[2]
    return wp.max(heights[1] - heights[0], 0.0) / width


@wp.func
def fan_angle_of(column: int, columns: int, spacing: float, distance: float) -> float:
    """Angle across the fan [rad] of one of ``columns`` strips at a range, the middle one straight ahead."""
    return (float(column) - 0.5 * float(columns - 1)) * spacing / distance


def check_profiles(grid: Grid, model: FrontModel, profiles: Profiles, device: Any) -> None:
    """Refuse pings that do not fit each other or the grid, and a model out of bounds.

    Raises:
        ValueError: an array of the wrong shape, type or device, or a model out of bounds.
    """
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
