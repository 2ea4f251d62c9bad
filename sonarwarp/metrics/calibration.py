"""Calibration of the elevation posterior: how often its interval covers the truth, and how sharp it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class CalibrationMetrics:
    """One class of points."""

    kind: str
    """Name of the class, such as front, top or fallback."""

    points: int
    """Points of the class whose truth is known."""

    coverage: float
    """Share of points whose true elevation lies in their interval; 0.95 where that is what it says it holds."""

    sharpness: float
    """Median standard deviation of elevation [rad]. Reporting the prior would always cover; this shows it."""


def evaluate_calibration(
    low: np.ndarray, high: np.ndarray, deviation: np.ndarray, truth: np.ndarray, kind: np.ndarray
) -> list[CalibrationMetrics]:
    """Coverage and sharpness of each class of points, in the order of their names.

    Args:
        low: lower end of each point's interval of elevation, itself inside [rad], shape [point].
        high: its upper end, inside too [rad], shape [point].
        deviation: posterior standard deviation of elevation [rad], shape [point].
        truth: true elevation [rad], NaN where it is not known, shape [point].
        kind: name of each point's class, shape [point].

    Raises:
        ValueError: arrays of different shapes.
    """
    for name, values in (("high", high), ("deviation", deviation), ("truth", truth), ("kind", kind)):
        if values.shape != low.shape:
            raise ValueError(f"{name}: expected shape {low.shape}, got {values.shape}")
    known = np.isfinite(truth)
    covered = (low <= truth) & (truth <= high)
    rows = []
    for name in np.unique(kind[known]):
        chosen = known & (kind == name)
        rows.append(
            CalibrationMetrics(
                kind=str(name),
                points=int(chosen.sum()),
                coverage=float(covered[chosen].mean()),
                sharpness=float(np.median(deviation[chosen])),
            )
        )
    return rows
