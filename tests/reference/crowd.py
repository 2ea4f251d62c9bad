"""Points that share a place, by comparing every point with every other, in integers."""

import numpy as np


def cells_of(point, origin, cell: float) -> np.ndarray:
    """Indices of the points' cells, shape [..., 3]."""
    return np.floor((np.asarray(point, dtype=np.float64) - origin) / cell).astype(int)


def counts(cells: np.ndarray, size) -> np.ndarray:
    """Points in each cell of a box, shape ``size``; those outside of it count nowhere."""
    index = np.ravel_multi_index(cells[np.all((cells >= 0) & (cells < size), axis=1)].T, tuple(size))
    return np.bincount(index, minlength=int(np.prod(size))).reshape(tuple(size))


def crowds(cells: np.ndarray, size) -> tuple[np.ndarray, np.ndarray]:
    """For every point: how many lie at most a cell away along each axis, and the most around a place two cells off.

    Only points inside of the box are counted; all are asked.
    """
    inside = cells[np.all((cells >= 0) & (cells < size), axis=1)]
    away = inside[None] - cells[:, None]
    steps = 2 * np.stack(np.meshgrid(*[[-1, 0, 1]] * 3), axis=-1).reshape(-1, 3)
    around = np.array([np.sum(np.max(np.abs(away - step), axis=-1) <= 1, axis=1) for step in steps])
    own = np.sum(np.max(np.abs(away), axis=-1) <= 1, axis=1)
    return own, around.max(axis=0)


def stays(cells: np.ndarray, size, least: int, share: float) -> np.ndarray:
    """Which points do not stand apart."""
    own, most = crowds(cells, size)
    return (own >= least) & (own >= share * most)
