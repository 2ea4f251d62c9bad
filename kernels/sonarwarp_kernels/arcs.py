"""Where on its elevation arc a critical point lies, judged by both sonars together.

A critical point fixes range and azimuth; the arc over the beam's elevation remains. Hypotheses on it, evenly spaced,
weigh as likely as the profiling sonar's field holds them occupied and as the free depth leaves them in doubt: a
contact lies where it is smallest along its own arc, so a common error of range or navigation cancels. Where nobody
else looked nothing is known, which is as good as the least. The range needs no particles: its deviation, half a bin,
is little beside what the free depth's allows for.

Exactly one place on the arc is the contact, so the field counts by its odds: that i alone is occupied is as likely as
p_i prod_{j != i} (1 - p_j), which is proportional to p_i / (1 - p_i), the exponential of the log-odds. The
probabilities themselves (Eq. 22) saturate: they hardly tell a place that one ping met from one that four met. Pings
overlap and share their evidence, hence a power of the odds.

A contact that the seabed explains, being hardly nearer than r_emin, says what is empty and gives no point.
"""

from typing import Any

import warp as wp

from sonarwarp_kernels.critical import NO_DETECTION
from sonarwarp_kernels.estimate import (
    NORMAL_INTERVAL,
    QUALITY_FALLBACK,
    QUALITY_INFORMED,
    QUALITY_NONE,
    Estimates,
    check_estimates,
)
from sonarwarp_kernels.field import check_field, read_log_odds
from sonarwarp_kernels.free_depth import hypothesis, read_free_depth
from sonarwarp_kernels.geometry import beam_direction
from sonarwarp_kernels.launch import launch
from sonarwarp_kernels.particles import Contacts, Reading, check_contacts, check_reading, world_point
from sonarwarp_kernels.specs import Fan, Grid

wp.set_module_options({"enable_backward": False})

# A hypothesis in water that is surely empty keeps exp(-8) of its weight: where all are, the best of them still counts.
MOST_DOUBT = wp.constant(8.0)

# Weight beyond the ends of an arc: less than any.
NO_PLACE = wp.constant(-1.0)

# Mass of the interval of elevation.
INTERVAL = wp.constant(0.95)

# The free depth varies slowly: every fourth hypothesis finds its minimum.
MINIMUM_STEP = wp.constant(4)


@wp.struct
class ArcModel:
    """How hypotheses weigh."""

    reach: float  # bound of the free depths [m]
    proven: float  # least free depth that tells anything: less, behind the surface, is as likely [m]
    solid: float  # most free depth of a contact's own place: cells smooth corners [m]
    deviation: float  # of a contact's free depth about its arc's least [m]
    odds_power: float  # power of the field's odds that counts: pings that overlap share their evidence
    range_deviation: float  # of the critical range [m]
    least_height: float  # over the seabed, at the beam's lower edge, of a contact that gives a point [m]
    informed: float  # most standard deviation of elevation of an informed point [rad]
    sharpness: float  # power of the weights that counts for the interval: neighbours on an arc share their evidence
    registration: float  # standard deviation of elevation between both sonars, where no end of the beam bounds it [rad]


@wp.func
def doubt(model: ArcModel, free_depth: float, least: float) -> float:
    """Likelihood that a place is not empty: its free depth against the arc's least one.

    1 where nothing is known, and the free depth minus the reach: no least one is less.
    """
    away = wp.max(free_depth - least, 0.0) / model.deviation
    return wp.exp(-wp.min(0.5 * away * away, MOST_DOUBT))


@wp.func
def arc_weight(
    fan: Fan,
    grid: Grid,
    reading: Reading,
    model: ArcModel,
    contacts: Contacts,
    log_odds: wp.array4d(dtype=int),
    free_depth: wp.array4d(dtype=float),
    frame: int,
    beam: int,
    number: int,
    hypotheses: int,
    least: float,
) -> float:
    """Weight of one of the places on a beam's arc; ``NO_PLACE`` beyond its ends."""
    if number < 0 or number >= hypotheses:
        return NO_PLACE
    owner = contacts.trajectory[frame]
    elevation = hypothesis(fan, number, hypotheses)
    critical = contacts.critical_range[frame, beam]
    point = world_point(contacts.world_from_sensor[frame], fan.azimuth[beam], elevation, critical, fan.cone)
    depth = read_free_depth(grid, free_depth, owner, point, model.reach)
    held = read_log_odds(grid, log_odds, owner, point, reading.low, reading.high)
    return doubt(model, depth, least) * wp.exp(model.odds_power * held)


@wp.func
def seabed_height(fan: Fan, contacts: Contacts, frame: int, beam: int) -> float:
    """Height over the seabed [m] of a beam's lower edge at its critical range; infinite where r_emin is."""
    if not wp.isfinite(contacts.seabed_range[frame, beam]):
        return wp.inf
    lower = beam_direction(fan.azimuth[beam], fan.elevation_min, fan.cone)
    down = -wp.transform_vector(contacts.world_from_sensor[frame], lower)[2]
    return down * (contacts.seabed_range[frame, beam] - contacts.critical_range[frame, beam])


@wp.kernel
def estimate_arcs_kernel(
    first: int,
    fan: Fan,
    grid: Grid,
    reading: Reading,
    model: ArcModel,
    contacts: Contacts,
    log_odds: wp.array4d(dtype=int),  # [trajectory, x, y, z]
    free_depth: wp.array4d(dtype=float),  # [trajectory, x, y, z]
    hypotheses: int,
    estimates_out: Estimates,
):
    index, beam = wp.tid()
    frame = first + index
    critical = contacts.critical_range[frame, beam]
    estimates_out.quality[frame, beam] = QUALITY_NONE
    if critical == NO_DETECTION or seabed_height(fan, contacts, frame, beam) < model.least_height:
        return
    owner = contacts.trajectory[frame]
    pose = contacts.world_from_sensor[frame]
    azimuth = fan.azimuth[beam]
    step = (fan.elevation_max - fan.elevation_min) / float(hypotheses)
    least = float(model.solid)
    for number in range(0, hypotheses, MINIMUM_STEP):
        point = world_point(pose, azimuth, hypothesis(fan, number, hypotheses), critical, fan.cone)
        depth = read_free_depth(grid, free_depth, owner, point, model.reach)
        if depth > -model.reach:
            least = wp.min(least, wp.max(depth, model.proven))
    # Moments about the beam's middle, so that squares stay small in float32.
    centre = world_point(pose, azimuth, 0.0, critical, fan.cone)
    total = float(0.0)
    # Of small weights the squares underflow in float32.
    squares = wp.float64(0.0)
    shift = wp.vec3(0.0, 0.0, 0.0)
    outer = wp.mat33()
    angle = float(0.0)
    angle_square = float(0.0)
    sharp = float(0.0)
    best = float(-1.0)
    likeliest = int(0)
    for number in range(hypotheses):
        elevation = hypothesis(fan, number, hypotheses)
        weight = arc_weight(
            fan, grid, reading, model, contacts, log_odds, free_depth, frame, beam, number, hypotheses, least
        )
        if weight > best:
            # Relative to the best, or powers of small weights would underflow.
            sharp *= wp.pow(wp.max(best, 0.0) / weight, model.sharpness)
            best = weight
            likeliest = number
        away = world_point(pose, azimuth, elevation, critical, fan.cone) - centre
        total += weight
        sharp += wp.pow(weight / best, model.sharpness)
        squares += wp.float64(weight) * wp.float64(weight)
        shift += weight * away
        outer += weight * wp.outer(away, away)
        angle += weight * elevation
        angle_square += weight * elevation * elevation
    mean = shift / total
    mean_angle = angle / total
    deviation = wp.sqrt(wp.max(angle_square / total - mean_angle * mean_angle, 0.0) + step * step / 12.0)
    # The interval of highest density grows from the likeliest place to its more likely neighbour.
    lowest = likeliest
    highest = likeliest
    below = float(0.0)
    above = float(0.0)
    held = float(1.0)
    side = int(2)
    while held < INTERVAL * sharp and (lowest > 0 or highest < hypotheses - 1):
        if side != 1:
            number = lowest - 1
            below = arc_weight(
                fan, grid, reading, model, contacts, log_odds, free_depth, frame, beam, number, hypotheses, least
            )
        if side != 0:
            number = highest + 1
            above = arc_weight(
                fan, grid, reading, model, contacts, log_odds, free_depth, frame, beam, number, hypotheses, least
            )
        side = wp.where(below >= above, 0, 1)
        held += wp.pow(wp.max(below, above) / best, model.sharpness)
        lowest -= 1 - side
        highest += side
    likely = hypothesis(fan, likeliest, hypotheses)
    # An end of the beam bounds the interval by the imaging sonar alone, however it is mounted.
    bounded = lowest == 0 or highest == hypotheses - 1
    common = wp.where(bounded, 0.0, NORMAL_INTERVAL * model.registration)
    down = likely - hypothesis(fan, lowest, hypotheses) + 0.5 * step
    up = hypothesis(fan, highest, hypotheses) + 0.5 * step - likely
    estimates_out.elevation_low[frame, beam] = likely - wp.sqrt(down * down + common * common)
    estimates_out.elevation_high[frame, beam] = likely + wp.sqrt(up * up + common * common)
    along = wp.normalize(centre - wp.transform_get_translation(pose))
    estimates_out.mean[frame, beam] = centre + mean
    estimates_out.covariance[frame, beam] = (
        outer / total - wp.outer(mean, mean) + model.range_deviation * model.range_deviation * wp.outer(along, along)
    )
    estimates_out.elevation_mean[frame, beam] = mean_angle
    estimates_out.elevation_deviation[frame, beam] = deviation
    estimates_out.effective_size[frame, beam] = float(wp.float64(total) * wp.float64(total) / squares)
    estimates_out.elevation[frame, beam] = likely
    estimates_out.likely[frame, beam] = world_point(pose, azimuth, likely, critical, fan.cone)
    estimates_out.quality[frame, beam] = wp.where(deviation <= model.informed, QUALITY_INFORMED, QUALITY_FALLBACK)


def estimate_arcs(
    fan: Fan,
    grid: Grid,
    reading: Reading,
    model: ArcModel,
    contacts: Contacts,
    log_odds: wp.array,
    free_depth: wp.array,
    hypotheses: int,
    estimates_out: Estimates,
    *,
    device: Any = None,
    threads: int = 1,
) -> None:
    """Place all critical points.

    Args:
        fan: the imaging sonar.
        grid: cells of both fields.
        reading: how log-odds are read.
        model: how hypotheses weigh.
        contacts: critical points of all frames.
        log_odds: the profiling sonar's field, shape [trajectory, x, y, z].
        free_depth: what the imaging sonar proved empty (:mod:`sonarwarp_kernels.free_depth`), shape as ``log_odds``.
        hypotheses: per beam, at least 1.
        estimates_out: written for every frame and beam; where there is no point, only the quality.
        device: device of all arrays.
        threads: CPU threads.

    Raises:
        ValueError: an array of the wrong shape, type or device, a model or clamps out of bounds, or no hypotheses.
    """
    device = wp.get_device(device)
    for name in ("reach", "deviation", "sharpness"):
        if not getattr(model, name) > 0.0:
            raise ValueError(f"model.{name}: must be above 0, got {getattr(model, name)}")
    for name in ("solid", "odds_power", "registration"):
        if not getattr(model, name) >= 0.0:
            raise ValueError(f"model.{name}: must be at least 0, got {getattr(model, name)}")
    if hypotheses < 1:
        raise ValueError(f"hypotheses: {hypotheses}, must be at least 1")
    check_reading(reading)
    check_contacts(fan, contacts, device)
    check_field(grid, "log_odds", log_odds, wp.int32, device)
    check_field(grid, "free_depth", free_depth, wp.float32, device)
    frames, beams = contacts.critical_range.shape
    check_estimates(estimates_out, (frames, beams), device)
    launch(
        estimate_arcs_kernel,
        (frames, beams),
        [fan, grid, reading, model, contacts, log_odds, free_depth, hypotheses],
        [estimates_out],
        device,
        threads,
    )
