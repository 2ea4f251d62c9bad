"""Refusals that every description here shares: each names the field, the value and the bound."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

# Kernels hold positions in single precision, whose step at 10 km is 1 mm.
REACH = 1.0e4


def check_positive(name: str, value: float) -> None:
    """Refuse a number that is not positive and finite.

    Raises:
        ValueError: names ``name`` and the value.
    """
    if not (math.isfinite(value) and value > 0.0):
        raise ValueError(f"{name}: {value}, must be positive and finite")


def check_finite(name: str, value: float) -> None:
    """Refuse a number that is not finite.

    Raises:
        ValueError: names ``name`` and the value.
    """
    if not math.isfinite(value):
        raise ValueError(f"{name}: {value}, must be finite")


def read_only(name: str, values: Any, shape: tuple[int | None, ...]) -> np.ndarray:
    """Read-only float64 copy of ``values``.

    Args:
        name: the field's name, for the message.
        values: anything that numpy reads as an array of numbers.
        shape: expected shape; ``None`` leaves an axis free, but not empty.

    Raises:
        ValueError: not numbers, another shape, empty, or not finite.
    """
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name}: not an array of numbers ({error})") from error
    check_shape(name, array, shape)
    if not np.isfinite(array).all():
        where = tuple(int(axis) for axis in np.argwhere(~np.isfinite(array))[0])
        raise ValueError(f"{name}: {array[where]} at {list(where)}, must be finite")
    array.setflags(write=False)
    return array


def check_shape(name: str, array: np.ndarray, shape: tuple[int | None, ...]) -> None:
    """Refuse another shape than ``shape`` (``None`` leaves an axis free) and arrays without entries.

    Raises:
        ValueError: names ``name``, the shape expected and the shape given.
    """
    fits = array.ndim == len(shape) and all(
        want is None or have == want for have, want in zip(array.shape, shape, strict=True)
    )
    if not fits:
        expected = ", ".join("any" if axis is None else str(axis) for axis in shape)
        raise ValueError(f"{name}: expected shape [{expected}], got {list(array.shape)}")
    if array.size == 0:
        raise ValueError(f"{name}: empty, must have at least one entry")


def check_reach(name: str, positions: np.ndarray) -> None:
    """Refuse positions [.., 3] in metres that single precision would round by more than 1 mm.

    Raises:
        ValueError: names ``name``, the largest coordinate and :data:`REACH`.
    """
    furthest = float(np.abs(positions).max())
    if furthest > REACH:
        raise ValueError(
            f"{name}: coordinate of {furthest:.6g} m, must be within {REACH:g} m of the origin: "
            "subtract a local origin, or scale to metres"
        )
