"""Rows of many seeds drawn together: one summary per object and method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

_NAMES = ("experiment", "object", "deployment", "which", "noise", "method")
FIGURES = ("slope_deg", "slope_error", "area_error", "volume_error")
"""Keys of rows that are drawn together."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Summary:
    """What all seeds made of an object by one method."""

    experiment: str
    object: str
    deployment: str | None
    which: str | None
    noise: str
    method: str

    figures: Mapping[str, np.ndarray]
    """By key of :data:`FIGURES`, shape [seed], in the order of the rows; NaN where a seed has none."""

    def mean(self, key: str) -> float | None:
        """Mean over the seeds that have the figure; None where none has."""
        found = self._found(key)
        return float(found.mean()) if len(found) else None

    def worst(self, key: str) -> float | None:
        """Largest figure of all seeds; None where a seed has none, which is worse than any."""
        return None if self.missing(key) else float(self.figures[key].max())

    def missing(self, key: str) -> int:
        """Number of seeds without the figure."""
        return len(self.figures[key]) - len(self._found(key))

    def _found(self, key: str) -> np.ndarray:
        return self.figures[key][np.isfinite(self.figures[key])]


def summarise(rows: Sequence[Mapping[str, Any]]) -> list[Summary]:
    """One summary for all rows that differ in their seed only, in the order in which they first come."""
    groups: dict[tuple[Any, ...], list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault(tuple(row[name] for name in _NAMES), []).append(row)
    return [
        Summary(
            **dict(zip(_NAMES, names, strict=True)),
            figures={key: np.array([row[key] for row in group], dtype=float) for key in FIGURES},
        )
        for names, group in groups.items()
    ]
