"""Evidence of one ping over a whole grid, and reading of a field between cells, in float64."""

import numpy as np
from scipy import ndimage

FIXED_POINT = 65536


def cell_centres(grid, owner: int = 0) -> np.ndarray:
    """World positions, shape [x, y, z, 3]."""
    index = np.stack(np.meshgrid(*(np.arange(n) for n in (grid.nx, grid.ny, grid.nz)), indexing="ij"), axis=-1)
    return grid.origin.numpy()[owner].astype(np.float64) + grid.cell * (index + 0.5)


def ridge(model, near: float, centre: float, far: float) -> tuple[float, float]:
    """Tilt over the beam's width and deviation of a footprint's ridge.

    A wall's footprint is as long as the beam is wide, r times its angle, and spreads evenly over range: a deviation of
    its length over sqrt(12). Of one twice as long or longer, all the length is tilt; in between both share it.
    """
    length = (far - near) / 0.8
    tilted = np.clip(length / (2 * model.half_width * centre) - 1.0, 0.0, 1.0)
    return tilted * length, model.range_deviation + (1.0 - tilted) * length / np.sqrt(12)


def ping_log_odds(points, model, position, orientation, footprints) -> np.ndarray:
    """Log-odds that a ping from a head at ``position`` adds at world ``points``, footprints in order of range."""
    forward, left, up = np.moveaxis((points - position) @ orientation, -1, 0)
    distance = np.sqrt(forward**2 + left**2 + up**2)
    with np.errstate(divide="ignore", invalid="ignore"):
        # Half widths off the axis, towards the side that looks higher.
        offset = left / forward / model.half_width * (1.0 if orientation[2, 1] >= 0 else -1.0)
        covered = (forward > 0) & (np.abs(np.arcsin(up / distance)) < model.half_fan)
    pattern = np.where(covered, np.clip(1.0 - np.where(covered, offset, 0.0) ** 2 / 2, 0.0, None), 0.0)
    offset = np.where(covered, offset, 0.0)
    if len(footprints) == 0:
        return pattern * model.no_return * (distance < model.reach)
    total = np.zeros(distance.shape)
    for order, (near, centre, far) in enumerate(footprints):
        tilt, deviation = ridge(model, near, centre, far)
        away = (distance - centre - offset * tilt / 2) / deviation
        share = np.where(np.abs(away) <= 4, np.exp(-(away**2) / 2), 0.0)
        if (far - near) / 0.8 < model.compact * 2 * model.half_width * centre:
            total += share * model.hit
        if order == 0:
            total += np.where(away < 0, (1.0 - share) * model.miss, 0.0)
    return pattern * total


def read_log_odds(counts, origin, cell: float, points, low: float, high: float) -> np.ndarray:
    """Trilinear log-odds between the centres of clamped cells, 0 for cells outside of the box."""
    clamped = np.clip(counts / FIXED_POINT, low, high)
    place = (np.asarray(points, dtype=np.float64) - origin) / cell - 0.5
    return ndimage.map_coordinates(clamped, place.T, order=1, mode="grid-constant", cval=0.0)
