"""Range likelihood of Eq. 9-13 in float64, each part one of SciPy's truncated distributions."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats


@dataclass(frozen=True)
class Mirrored:
    """A distribution on [low, high], run backwards."""

    forwards: Any
    low: float
    high: float

    def pdf(self, x):
        return self.forwards.pdf(self.low + self.high - x)

    def cdf(self, x):
        return self.forwards.sf(self.low + self.high - x)

    def ppf(self, share):
        return self.low + self.high - self.forwards.isf(share)


def parts(mixture, critical: float, start: float, seabed: float) -> list[tuple[float, Any]]:
    """Weight and distribution of the hit, of what is nearer, of anything and of the rise towards the seabed."""
    edge, length, sigma = float(np.clip(critical, start, seabed)), seabed - start, mixture.deviation
    hit = stats.truncnorm((start - edge) / sigma, (seabed - edge) / sigma, loc=edge, scale=sigma)
    anything = stats.uniform(start, length)
    rising = stats.truncexpon(mixture.rate_seabed * length, loc=start, scale=1 / mixture.rate_seabed)
    weights = [mixture.weight_hit, mixture.weight_short]
    if edge > start:
        short = stats.truncexpon(mixture.rate_short * (edge - start), loc=start, scale=1 / mixture.rate_short)
    else:
        # Nothing is nearer than the window's start: all of it is the critical point.
        weights, short = [sum(weights), 0.0], hit
    distributions = [hit, short, anything, Mirrored(rising, start, seabed)]
    return list(zip([*weights, mixture.weight_random, mixture.weight_seabed], distributions, strict=True))


def density(mixture, critical: float, start: float, seabed: float, distance) -> np.ndarray:
    """Eq. 9 [1/m]."""
    return np.sum([weight * part.pdf(distance) for weight, part in parts(mixture, critical, start, seabed)], axis=0)


def share_below(mixture, critical: float, start: float, seabed: float, distance) -> np.ndarray:
    """Distribution function of Eq. 9."""
    return np.sum([weight * part.cdf(distance) for weight, part in parts(mixture, critical, start, seabed)], axis=0)


def sample(mixture, critical: float, start: float, seabed: float, choice, part) -> np.ndarray:
    """Ranges by inversion: ``choice`` takes a part by its weight, ``part`` its quantile; the rise's from the end."""
    weighted = parts(mixture, critical, start, seabed)
    borders = np.cumsum([weight for weight, _ in weighted])[:-1]
    shares = [part, part, part, 1.0 - part]
    quantiles = np.array([distribution.ppf(share) for (_, distribution), share in zip(weighted, shares, strict=True)])
    return np.take_along_axis(quantiles, np.searchsorted(borders, choice, side="right")[None], axis=0)[0]
