"""Refusals at the edge: each names the field, the value and the bound."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def in_range(name: str, value: float, low: float, high: float) -> None:
    """Refuse a number outside [low, high] or not a number, with a ``ValueError`` that says so."""
    if not low <= value <= high:
        raise ValueError(f"{name}: {value:g} is outside [{low:g}, {high:g}]")


def finite_array(
    name: str, values: ArrayLike, *, shape: tuple[int | None, ...] | None = None, ascending: bool = False
) -> np.ndarray:
    """A read-only float64 copy of ``values``.

    Raises:
        ValueError: not finite; not of ``shape`` (``None`` leaves an axis free); or, where ``ascending`` is asked for,
            not one axis of at least two strictly ascending values.
    """
    array = np.array(values, dtype=np.float64)
    if shape is not None and (
        array.ndim != len(shape)
        or any(want is not None and have != want for have, want in zip(array.shape, shape, strict=True))
    ):
        raise ValueError(f"{name}: expected shape {shape}, got {array.shape}")
    bad = ~np.isfinite(array)
    if bad.any():
        raise ValueError(f"{name}: {array[bad].flat[0]} at index {int(np.flatnonzero(bad)[0])}, must be finite")
    if ascending:
        if array.ndim != 1 or array.size < 2:
            raise ValueError(f"{name}: expected one axis of at least 2 values, got shape {array.shape}")
        steps = np.diff(array)
        if (steps <= 0).any():
            where = int(np.argmax(steps <= 0))
            raise ValueError(f"{name}: {array[where + 1]:g} follows {array[where]:g}, must ascend")
    array.setflags(write=False)
    return array
