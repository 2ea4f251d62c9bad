"""Values of OpenUSD attributes as arrays. A file may give an attribute another type than its schema does."""

# pyright: reportAttributeAccessIssue=false
# OpenUSD fills its modules when they load, where no type checker sees it.

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pxr import Usd


def integers(attribute: Usd.Attribute, time: Usd.TimeCode) -> np.ndarray:
    """A list of whole numbers, int64, shape [n]; empty where the attribute has none.

    Raises:
        ValueError: values of another type; names prim, attribute and type.
    """
    return _array(attribute, time, "iu", ()).astype(np.int64)


def vectors(attribute: Usd.Attribute, time: Usd.TimeCode) -> np.ndarray:
    """A list of vectors, float64, shape [n, 3]; empty where the attribute has none.

    Raises:
        ValueError: values of another type; names prim, attribute and type.
    """
    return _array(attribute, time, "iuf", (3,)).astype(np.float64)


def _array(attribute: Usd.Attribute, time: Usd.TimeCode, kinds: str, entry: tuple[int, ...]) -> np.ndarray:
    value = attribute.Get(time)
    if value is None:
        return np.zeros((0, *entry), dtype=np.int8)
    try:
        values = np.array(value)
    except (TypeError, ValueError):
        values = np.array(None)
    if values.size == 0:
        return np.zeros((0, *entry), dtype=np.int8)
    if values.dtype.kind not in kinds or values.shape[1:] != entry or values.ndim == 0:
        wanted = "vectors" if entry else "whole numbers"
        place = f"{attribute.GetPrim().GetPath()}: {attribute.GetName()}"
        raise ValueError(f"{place}: a {type(value).__name__}, must be a list of {wanted}")
    return values
