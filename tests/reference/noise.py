"""Float64 oracle of keyed speckle and background."""

import math

from tests.reference.keys import mix_key

SPECKLE, BACKGROUND = 4, 5


def power(key: int) -> float:
    """Squared magnitude of a key's complex Gaussian, of unit mean."""
    return -math.log(((key >> 41) + 0.5) / 2**23)


def rayleigh(key: int) -> float:
    """Rayleigh variate of unit mean."""
    return math.sqrt(4.0 / math.pi * power(key))


def gaussian(key: int) -> complex:
    """Complex Gaussian of unit variance: its phase the key's lower half."""
    phase = 2.0 * math.pi * (key % 2**32) / 2**32
    return math.sqrt(power(key)) * complex(math.cos(phase), math.sin(phase))


def speckle(knot_key: int, next_key: int, blend: float, beam: int, bin: int) -> float:
    """Speckle of a bin, ``blend`` of the way from one knot to the next."""
    one, other = (gaussian(mix_key(mix_key(mix_key(key, SPECKLE), beam), bin)) for key in (knot_key, next_key))
    mixed = math.cos(0.5 * math.pi * blend) * one + math.sin(0.5 * math.pi * blend) * other
    return abs(mixed) * math.sqrt(4.0 / math.pi)


def background(frame_key: int, beam: int, bin: int) -> float:
    """Background of a bin, of unit mean."""
    return rayleigh(mix_key(mix_key(mix_key(frame_key, BACKGROUND), beam), bin))


def knot_correlation(one: float, other: float) -> float:
    """Complex correlation of speckle at two distances [knots]: the weights of the knots that they share."""

    def weights(at: float) -> dict[int, float]:
        blend = at - math.floor(at)
        return {math.floor(at): math.cos(0.5 * math.pi * blend), math.floor(at) + 1: math.sin(0.5 * math.pi * blend)}

    mine, its = weights(one), weights(other)
    return sum(mine[knot] * its.get(knot, 0.0) for knot in mine)


def bohman(knots: float) -> float:
    """Complex correlation of speckle at a distance of some knots, averaged over where the knots lie."""
    x = min(abs(knots) / 2.0, 1.0)
    return (1.0 - x) * math.cos(math.pi * x) + math.sin(math.pi * x) / math.pi
