"""Points that share a place, by comparing every point with every other, in integers."""

import numpy as np


def cells_of(point, origin, cell: float) -> np.ndarray:
    """Indices of the points' cells, shape [..., 3]."""
    return np.floor((np.asarray(point, dtype=np.float64) - origin) / cell).astype(int)


def counts(cells: np.ndarray, size) -> np.ndarray:
    """Points in each cell of a box, shape ``size``; those outside of it count nowhere."""
    index = np.ravel_multi_index(cells[np.all((cells >= 0) & (cells < size), axis=1)].T, tuple(size))
    return np.bincount(index, minlength=int(np.prod(size))).reshape(tuple(size))


def stays(cells: np.ndarray, size, least: int) -> np.ndarray:
    """Which points have enough others, themselves included, at most a cell away along each axis.

    Only points inside of the box are counted; all are asked.
    """
    inside = cells[np.all((cells >= 0) & (cells < size), axis=1)]
    away = np.abs(inside[None] - cells[:, None]).max(axis=-1)
    return np.sum(away <= 1, axis=1) >= least
