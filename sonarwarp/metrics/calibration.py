"""Calibration: how often what points claim holds, and how sharp it is."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np


@dataclass(frozen=True, kw_only=True, eq=False)
class Claims:
    """What points say of a quantity each, and what is true of it.

    Raises:
        ValueError: arrays of different shapes.
    """

    low: np.ndarray
    """Lower end of each point's 95 % interval, itself inside, shape [point]."""

    high: np.ndarray
    """Its upper end, inside too, shape [point]."""

    deviation: np.ndarray
    """Standard deviation that the point gives, as an angle at its sonar [rad], shape [point]."""

    truth: np.ndarray
    """What is true, NaN where that is not known, shape [point]."""

    kind: np.ndarray
    """Name of each point's class, shape [point]."""

    def __post_init__(self) -> None:
        for name in ("high", "deviation", "truth", "kind"):
            shape = getattr(self, name).shape
            if shape != self.low.shape:
                raise ValueError(f"Claims.{name}: expected shape {self.low.shape}, got {shape}")

    @staticmethod
    def join(*claims: Claims) -> Claims:
        """The claims of several clouds or classes as those of one."""
        return Claims(
            **{
                column.name: np.concatenate([getattr(part, column.name) for part in claims])
                for column in fields(Claims)
            }
        )


@dataclass(frozen=True, kw_only=True)
class CalibrationMetrics:
    """One class of points."""

    kind: str
    """Name of the class, such as front, top, fallback or face."""

    points: int
    """Points of the class whose truth is known."""

    coverage: float
    """Share of points whose truth lies in their interval; 0.95 where that is what it says it holds."""

    sharpness: float
    """Median standard deviation [rad]. Reporting the prior would always cover; this shows it."""


def evaluate_calibration(claims: Claims) -> list[CalibrationMetrics]:
    """Coverage and sharpness of each class of points, in the order of their names."""
    known = np.isfinite(claims.truth)
    covered = (claims.low <= claims.truth) & (claims.truth <= claims.high)
    rows = []
    for name in np.unique(claims.kind[known]):
        chosen = known & (claims.kind == name)
        rows.append(
            CalibrationMetrics(
                kind=str(name),
                points=int(chosen.sum()),
                coverage=float(covered[chosen].mean()),
                sharpness=float(np.median(claims.deviation[chosen])),
            )
        )
    return rows
