"""Highest point in every column of cells, by asking all points column by column, in float64."""

import numpy as np


def tops(point, origin, cell: float, size) -> np.ndarray:
    """Height over the box's origin [m] of the highest point in each column, NaN where there is none, shape [x, y]."""
    away = np.asarray(point, dtype=np.float64) - origin
    out = np.full((size[0], size[1]), np.nan)
    for x, y in np.ndindex(out.shape):
        corner = np.array([x, y]) * cell
        inside = np.all((away[:, :2] >= corner) & (away[:, :2] < corner + cell), axis=1) & (away[:, 2] >= 0.0)
        if inside.any():
            out[x, y] = away[inside, 2].max()
    return out
