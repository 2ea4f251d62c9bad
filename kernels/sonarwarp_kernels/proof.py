"""What one frame proves empty: of a point, and, so that most frames need not be asked point by point, of a ball.

Of a ball that is left out, the frame proves of no point anything. The bounds are safe for both kinds of fan: they leave
out work, never a frame that counts.
"""

import warp as wp

from sonarwarp_kernels.critical import NO_DETECTION
from sonarwarp_kernels.geometry import azimuth_of
from sonarwarp_kernels.particles import Contacts
from sonarwarp_kernels.specs import Fan

wp.set_module_options({"enable_backward": False})


@wp.struct
class Carving:
    """What a frame proves empty."""

    reach: float  # free depths are kept within +- this [m]
    guard: float  # a beam without a critical point is free up to this far before r_emin [m]
    margin: float  # part of a beam's elevation that proves nothing, at either edge: attitude and mounts err [rad]


@wp.struct
class View:
    """Where a frame may look, in its own coordinates."""

    furthest: float  # range [m]
    rise: float  # most height over or under its middle, of the range
    aside: float  # most distance from its middle to either side, of the range
    low: float  # height of the lower edge, of :func:`rise_base`
    high: float  # and of the upper one


@wp.func
def view_of(fan: Fan, carving: Carving) -> View:
    """Where any frame of a fan may look, up to a reach behind its window."""
    low = fan.elevation_min + carving.margin
    high = fan.elevation_max - carving.margin
    borders = fan.column_azimuth.shape[0]
    side = wp.max(wp.abs(fan.column_azimuth[0]), wp.abs(fan.column_azimuth[borders - 1]))
    view = View()
    view.furthest = fan.range_edge[fan.range_edge.shape[0] - 1] + carving.reach
    # In both kinds of fan no direction rises or turns aside more than those in the planes through the middle.
    view.rise = wp.sin(wp.max(wp.abs(low), wp.abs(high)))
    view.aside = wp.sin(wp.min(side, 0.5 * wp.pi))
    view.low = wp.where(fan.cone != 0, wp.tan(low), wp.sin(low))
    view.high = wp.where(fan.cone != 0, wp.tan(high), wp.sin(high))
    return view


@wp.func
def rise_base(fan: Fan, point: wp.vec3, distance: float) -> float:
    """What a rise counts from: a cone's elevation turns about y, a fan's is over the plane of x and y."""
    return wp.where(fan.cone != 0, point[0], distance)


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
def seen_from(contacts: Contacts, frame: int, point: wp.vec3) -> wp.vec3:
    """A world point in a frame's own coordinates [m]."""
    pose = contacts.world_from_sensor[frame]
    return wp.quat_rotate_inv(wp.transform_get_rotation(pose), point - wp.transform_get_translation(pose))


@wp.func
def proven_depth(fan: Fan, carving: Carving, contacts: Contacts, view: View, frame: int, point: wp.vec3) -> float:
    """r_free - r of a point in the frame's coordinates [m]; minus the reach where the frame does not look."""
    depth = -carving.reach
    distance = wp.length(point)
    base = rise_base(fan, point, distance)
    ahead = point[0] > 0.0 and distance < view.furthest
    if ahead and point[2] >= view.low * base and point[2] <= view.high * base:
        beam = nearest_beam(fan, azimuth_of(point, distance, fan.cone))
        if beam >= 0:
            depth = wp.max(free_range(fan, carving, contacts, frame, beam) - distance, depth)
    return depth


@wp.func
def may_look(view: View, point: wp.vec3, radius: float) -> bool:
    """Whether a ball about a point in the frame's coordinates may reach into its view."""
    distance = wp.length(point)
    return (
        point[0] > -radius
        and distance < view.furthest + radius
        and wp.abs(point[2]) <= view.rise * distance + (1.0 + view.rise) * radius
        and wp.abs(point[1]) <= view.aside * distance + (1.0 + view.aside) * radius
    )


@wp.func
def may_prove(
    fan: Fan, carving: Carving, contacts: Contacts, view: View, frame: int, point: wp.vec3, radius: float
) -> bool:
    """Whether a frame may prove anything of a ball about a point in its coordinates; if in doubt, it may."""
    if not may_look(view, point, radius):
        return False
    distance = wp.length(point)
    low = fan.column_azimuth[0]
    high = fan.column_azimuth[fan.column_azimuth.shape[0] - 1]
    level = wp.length(wp.vec2(point[0], point[1]))
    if level > radius and point[0] > 0.0:
        # The ball's shadow on the plane of x and y; a cone's azimuth turns by less.
        azimuth = azimuth_of(point, distance, fan.cone)
        half = wp.asin(radius / level)
        low = wp.clamp(azimuth - half, low, high)
        high = wp.clamp(azimuth + half, low, high)
    most = float(0.0)
    for beam in range(nearest_beam(fan, low), nearest_beam(fan, high) + 1):
        most = wp.max(most, free_range(fan, carving, contacts, frame, beam))
    return distance - radius < most + carving.reach
