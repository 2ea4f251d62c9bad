"""Borders of beams and range bins given as equal steps, which is how a person writes them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from sonarwarp.sonar import uniform_edges

# Most beams or bins of equal steps: far more than any sonar has, and no memory to speak of.
_MOST_STEPS = 1 << 16

# Differences of edges carry rounding, which the number that a person chose does not: round it away first.
_DIGITS = 9


@dataclass(frozen=True)
class Steps:
    """How equal steps of one array are written."""

    keys: dict[str, str]
    """Key to its comment, the number of steps first."""

    bounds: tuple[tuple[float, float], ...]
    """Least and most of each key."""

    edges: Callable[..., np.ndarray]
    """From the keys' values, shape [step + 1]."""

    guesses: Callable[[np.ndarray], Iterator[tuple[float, ...]]]
    """Values of the keys that may give some edges."""

    def values(self, edges: np.ndarray) -> dict[str, float] | None:
        """The keys' values that give ``edges`` to the bit; None where they are no equal steps."""
        for values in self.guesses(edges):
            if np.array_equal(self.edges(*values), edges):
                return dict(zip(self.keys, values, strict=True))
        return None


def _fan(beams: int, width_deg: float) -> np.ndarray:
    return np.radians(uniform_edges(-width_deg / 2, width_deg / 2, beams))


def _window(bins: int, start: float, length: float) -> np.ndarray:
    return uniform_edges(start, start + length, bins)


def _rounded(*values: float) -> Iterator[float]:
    for value in values:
        yield round(float(value), _DIGITS)
        yield float(value)


EDGE_STEPS: dict[str, Steps] = {
    "azimuth_edge": Steps(
        keys={
            "beams": "Number of beams, equally wide.",
            "field_of_view_deg": "Width of all beams together, centred on the sonar's axis [deg].",
        },
        bounds=((1, _MOST_STEPS), (1e-3, 180.0)),
        edges=_fan,
        guesses=lambda edges: (
            (len(edges) - 1, width) for width in _rounded(np.degrees(edges[-1] - edges[0]), 2 * np.degrees(edges[-1]))
        ),
    ),
    "range_edge": Steps(
        keys={
            "bins": "Number of range bins, equally long.",
            "window_start": "Slant range of the first bin's start [m].",
            "window_length": "Length of all bins together [m].",
        },
        bounds=((1, _MOST_STEPS), (0.01, 1e4), (1e-6, 1e4)),
        edges=_window,
        guesses=lambda edges: ((len(edges) - 1, float(edges[0]), length) for length in _rounded(edges[-1] - edges[0])),
    ),
}
"""By the name of the array."""
