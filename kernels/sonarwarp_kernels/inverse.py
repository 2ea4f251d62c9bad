"""Inverse sensor model of the profiling sonar: what one ping says about a place in its beam (Eq. 20-21).

Free before the first footprint, occupied within a footprint, nothing behind the last: its shadow stays unknown. A ping
without any footprint says nothing unless told otherwise, because a weak echo that was missed must not pierce a surface.

A beam of finite width sees an oblique surface over a stretch of range: its deeper edge meets it first. Where a
footprint is wider than a wall's could be, the occupied ridge follows that tilt across the beam instead of filling it.
A model may hold such ridges too vague to count as occupied; what lies in front of them is free all the same.
"""

import math

import warp as wp

from sonarwarp_kernels.profile import NO_FOOTPRINT, footprint_spread, is_compact

wp.set_module_options({"enable_backward": False})


@wp.struct
class ProfileModel:
    """Inverse sensor model of the profiling sonar."""

    hit: float  # log-odds added at a footprint's ridge on the beam's axis
    miss: float  # log-odds added in front of the first footprint on the beam's axis; negative
    no_return: float  # log-odds added along the whole beam of a ping without any footprint; at most 0
    compact: float  # most spread of a footprint that is occupied, over the width of the beam there
    half_width: float  # half the beamwidth in the scan plane [rad]
    half_fan: float  # half the beamwidth across it [rad]
    range_deviation: float  # deviation of a ridge along range [m]
    reach: float  # range that a ping without a footprint speaks for [m]


def check_model(model: ProfileModel) -> None:
    """Refuse a model whose beam has no width, or one that no tangent spans, and a ridge without extent.

    Raises:
        ValueError: the field, its bounds and its value.
    """
    for name, most in (("half_width", 1.0), ("half_fan", 0.5 * math.pi), ("range_deviation", math.inf)):
        value = getattr(model, name)
        if not 0.0 < value <= most:
            raise ValueError(f"model.{name}: must be above 0 and at most {most:g}, got {value:g}")
    if not model.compact >= 0.0:
        raise ValueError(f"model.compact: must be at least 0, got {model.compact:g}")


@wp.struct
class Ridge:
    """Where along range one footprint puts occupied evidence."""

    near: float  # 10 % point of its energy [m]
    centre: float  # crossing on the beam's axis [m]
    far: float  # 90 % point [m]
    tilt: float  # change of the crossing over one beamwidth [m]
    deviation: float  # along range [m]
    hit: float  # log-odds added on it on the beam's axis


@wp.func
def ridge_of(model: ProfileModel, footprint: wp.vec3) -> Ridge:
    """Ridge of a footprint.

    A surface inclined 45 deg to the beam spreads its footprint over r times the beamwidth. Walls spread less, and are
    taken as crossing every ray at one range; flatter surfaces are crossed later by shallower rays.
    """
    ridge = Ridge()
    spread = footprint_spread(footprint)
    wall = 2.0 * model.half_width * footprint[1]
    flatness = wp.clamp(spread / wall - 1.0, 0.0, 1.0)
    ridge.near = footprint[0]
    ridge.centre = footprint[1]
    ridge.far = footprint[2]
    ridge.tilt = flatness * spread
    ridge.hit = wp.where(is_compact(footprint, model.half_width, model.compact), model.hit, 0.0)
    # A uniform spread s has deviation s / sqrt(12); a tilted ridge has taken that up.
    ridge.deviation = model.range_deviation + 0.28867513 * (1.0 - flatness) * spread
    return ridge


@wp.func
def beam_pattern(position: float) -> float:
    """Relative weight at an angular ``position`` in half widths off the axis: half at 1, nothing from sqrt(2) on."""
    return wp.max(1.0 - 0.5 * position * position, 0.0)


@wp.func
def ridge_evidence(model: ProfileModel, ridge: Ridge, nearest: bool, distance: float, position: float) -> float:
    """Log-odds on the ray at ``position`` half widths off the axis: free before the nearest ridge, occupied on one.

    ``position`` is positive on the shallower side.
    """
    away = (distance - ridge.centre - 0.5 * position * ridge.tilt) / ridge.deviation
    if wp.abs(away) > 4.0:
        if nearest and away < 0.0:
            return model.miss
        return 0.0
    share = wp.exp(-0.5 * away * away)
    if nearest and away < 0.0:
        return share * ridge.hit + (1.0 - share) * model.miss
    return share * ridge.hit


@wp.struct
class Beam:
    """What every cell needs to know about one ping."""

    ping: int
    returned: int  # 1 where there is a footprint
    nearest: Ridge
    clear: float  # range before which all is free [m]
    behind: float  # range beyond which nothing is said [m]


@wp.func
def beam_of(model: ProfileModel, footprint: wp.array2d(dtype=wp.vec3), ping: int) -> Beam:
    """Ranges at which a ping speaks; ``behind`` is 0 where it says nothing at all."""
    beam = Beam()
    beam.ping = ping
    beam.returned = 0
    for index in range(footprint.shape[1]):
        if footprint[ping, index][0] != NO_FOOTPRINT:
            ridge = ridge_of(model, footprint[ping, index])
            clear = ridge.centre - ridge.tilt - 4.0 * ridge.deviation
            if index == 0:
                beam.returned = 1
                beam.nearest = ridge
                beam.clear = clear
            # A wide ridge may begin ahead of a nearer, narrow one.
            beam.clear = wp.min(beam.clear, clear)
            beam.behind = wp.max(beam.behind, ridge.centre + ridge.tilt + 4.0 * ridge.deviation)
    if beam.returned == 0 and model.no_return != 0.0:
        beam.behind = model.reach
    return beam


@wp.func
def beam_evidence(
    model: ProfileModel, footprint: wp.array2d(dtype=wp.vec3), beam: Beam, distance: float, position: float
) -> float:
    """Log-odds that a ping adds at ``distance`` [m] on the ray at ``position`` half widths to the shallower side."""
    if beam.returned == 0:
        return beam_pattern(position) * model.no_return
    if distance < beam.clear:
        return beam_pattern(position) * model.miss
    evidence = ridge_evidence(model, beam.nearest, True, distance, position)
    for index in range(1, footprint.shape[1]):
        if footprint[beam.ping, index][0] != NO_FOOTPRINT:
            ridge = ridge_of(model, footprint[beam.ping, index])
            evidence += ridge_evidence(model, ridge, False, distance, position)
    return beam_pattern(position) * evidence
