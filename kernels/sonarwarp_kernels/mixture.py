"""Range likelihood of the imaging sonar (Eq. 9-13): density and inverse-transform sampling.

Each part is normalised over [r_min, r_emin] and the weights sum to 1, so that the mixture is a density there. Eq. 10's
sigma is taken as a standard deviation; Eq. 11 is truncated at the critical range; Eq. 13 rises towards r_emin.

Two corners that the print leaves open: a critical range outside of the support is taken at the support's nearer end,
and where no room is left ahead of it, the part of what is nearer has shrunk onto the critical point itself, so that
its weight is the hit's.
"""

import warp as wp

from sonarwarp_kernels.specs import Mixture

wp.set_module_options({"enable_backward": False})

_SQRT_TWO = wp.constant(1.4142135623730951)
_INVERSE_SQRT_TWO_PI = wp.constant(0.3989422804014327)


def check_mixture(mixture: Mixture) -> None:
    """Refuse a mixture that is no density.

    Raises:
        ValueError: a deviation or rate that is not above 0, a negative weight, or weights that do not sum to 1.
    """
    for name in ("deviation", "rate_short", "rate_seabed"):
        if not getattr(mixture, name) > 0.0:
            raise ValueError(f"mixture.{name}: must be above 0, got {getattr(mixture, name)}")
    weights = {name: getattr(mixture, f"weight_{name}") for name in ("hit", "short", "random", "seabed")}
    for name, weight in weights.items():
        if not weight >= 0.0:
            raise ValueError(f"mixture.weight_{name}: must be at least 0, got {weight}")
    total = sum(weights.values())
    # Four float32 weights.
    if abs(total - 1.0) > 1.0e-6:
        raise ValueError(f"mixture: weights must sum to 1, got {total}")


@wp.func
def normal_within(deviation: float, length: float) -> float:
    """Probability that a normal variate of ``deviation`` lies within ``length`` of its mean, however small."""
    return wp.erf(length / (_SQRT_TWO * deviation))


@wp.func
def exponential_share(exponent: float) -> float:
    """1 - exp(-``exponent``), without cancellation where the exponent is small."""
    half = wp.tanh(0.5 * exponent)
    return 2.0 * half / (1.0 + half)


@wp.func
def exponential_offset(rate: float, length: float, part: float) -> float:
    """Offset in [0, length] below which an exponential of ``rate``, truncated there, has the share ``part``."""
    share = part * exponential_share(rate * length)
    rest = 1.0 - share
    exponent = share
    if rest != 1.0:
        # The quotient makes good what rounding took from the rest (Kahan's log1p).
        exponent = -wp.log(rest) * share / (1.0 - rest)
    return wp.min(exponent / rate, length)


@wp.func
def hit_weight(mixture: Mixture, critical: float, start: float) -> float:
    """Weight of the part at the critical point: with that of what is nearer where nothing can be."""
    if critical <= start:
        return mixture.weight_hit + mixture.weight_short
    return mixture.weight_hit


@wp.func
def range_density(mixture: Mixture, critical: float, start: float, seabed: float, distance: float) -> float:
    """Density p(r | x, m) of Eq. 9 [1/m] at ``distance``, on [``start``, ``seabed``], the edge at ``critical``.

    Ranges in metres. 0 outside of the support, and everywhere where the support has no length.
    """
    length = seabed - start
    if distance < start or distance > seabed or length <= 0.0:
        return 0.0
    edge = wp.clamp(critical, start, seabed)
    away = (distance - edge) / mixture.deviation
    inside = 0.5 * (normal_within(mixture.deviation, edge - start) + normal_within(mixture.deviation, seabed - edge))
    hit = _INVERSE_SQRT_TWO_PI * wp.exp(-0.5 * away * away) / (mixture.deviation * inside)
    short = float(0.0)
    if distance < edge:
        rate = mixture.rate_short
        short = rate * wp.exp(-rate * (distance - start)) / exponential_share(rate * (edge - start))
    rate = mixture.rate_seabed
    rising = rate * wp.exp(rate * (distance - seabed)) / exponential_share(rate * length)
    return (
        hit_weight(mixture, edge, start) * hit
        + mixture.weight_short * short
        + mixture.weight_random / length
        + mixture.weight_seabed * rising
    )


@wp.func
def sample_range(mixture: Mixture, critical: float, start: float, seabed: float, choice: float, part: float) -> float:
    """Range [m] drawn from Eq. 9 by two uniforms: ``choice`` picks the part, ``part`` inverts its distribution."""
    length = seabed - start
    edge = wp.clamp(critical, start, seabed)
    if choice < hit_weight(mixture, edge, start):
        below = normal_within(mixture.deviation, edge - start)
        above = normal_within(mixture.deviation, seabed - edge)
        # The inverse error function is infinite at its ends: cut at 4.8 deviations.
        within = wp.clamp(part * (below + above) - below, -0.999998, 0.999998)
        return wp.clamp(edge + mixture.deviation * _SQRT_TWO * wp.erfinv(within), start, seabed)
    if choice < mixture.weight_hit + mixture.weight_short:
        return start + exponential_offset(mixture.rate_short, edge - start, part)
    if choice < mixture.weight_hit + mixture.weight_short + mixture.weight_random:
        return start + part * length
    return seabed - exponential_offset(mixture.rate_seabed, length, part)
