"""What both fields say of one arc, in float64: weights of all hypotheses and their moments."""

import numpy as np

from tests.reference import free_depth
from tests.reference.field import read_log_odds
from tests.reference.geometry import direction


def weights(world, frame: int, beam: int, cells, number: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Elevations, world positions and weights of hypotheses: occupied by a power of the odds, and hardly more free than
    the arc's least.

    Free depths under what counts as proven are all alike.
    """
    elevation, where = free_depth.arc(world, frame, beam, number)
    owner = world.trajectory[frame]
    origin, size = world.origin[owner].astype(np.float64), world.size[owner]
    depth = free_depth.read(cells[owner], origin, world.cell, size, where, world.reach)
    known = depth > -world.reach
    depth = np.maximum(depth, world.doubt["proven"])
    # Every fourth looks for the least; none keeps less than exp(-8), and nothing known is as good as the least.
    least = min(world.doubt["solid"], depth[::4][known[::4]].min(initial=np.inf))
    depth[~known] = least
    away = np.clip(depth - least, 0.0, None) / world.doubt["deviation"]
    counts = world.counts[owner][: size[0], : size[1], : size[2]]
    held = read_log_odds(counts, origin, float(np.float32(world.cell)), where, world.low, world.high)
    odds = np.exp(world.doubt["odds_power"] * held)
    return elevation, where, np.exp(-np.minimum(away**2 / 2, 8.0)) * odds


def moments(world, frame: int, beam: int, cells, number: int) -> dict[str, np.ndarray]:
    """Weighted means, variances and effective size; a hypothesis stands for its part of the arc."""
    elevation, where, weight = weights(world, frame, beam, cells, number)
    middle = direction(np.array([world.azimuth[beam]]), np.zeros(1), bool(world.cone))[0]
    ahead = world.orientation[frame] @ middle
    mean = np.average(elevation, weights=weight)
    part = 2 * world.half_elevation / number
    variance = np.average((elevation - mean) ** 2, weights=weight) + part**2 / 12
    spread = np.cov(where.T, aweights=weight, ddof=0) + world.doubt["range_deviation"] ** 2 * np.outer(ahead, ahead)
    return {
        "mean": np.average(where, axis=0, weights=weight),
        "covariance": spread,
        "elevation_mean": mean,
        "elevation_deviation": np.sqrt(variance),
        "effective_size": np.sum(weight) ** 2 / np.sum(weight**2),
    }


def interval(density, likeliest: int, share: float = 0.95, favour: float = 1.0) -> tuple[int, int]:
    """First and last place of the interval of highest density: the more likely neighbour joins until it holds enough.

    Of neighbours alike the lower one joins, as it does where ``favour`` times its density is no less than the other's.
    """
    first = last = likeliest
    while density[first : last + 1].sum() < share * density.sum() and last - first + 1 < len(density):
        below = favour * density[first - 1] if first > 0 else -1.0
        above = density[last + 1] if last + 1 < len(density) else -1.0
        first, last = (first - 1, last) if below >= above else (first, last + 1)
    return first, last


def seabed_heights(world) -> np.ndarray:
    """How much higher a beam's lower edge is at the critical range than where it meets the seabed, shape as both."""
    lower = direction(world.azimuth, np.full(world.beams, -world.half_elevation), bool(world.cone))
    place = np.stack([world.world_points(f, lower, world.critical[f]) for f in range(world.frames)])
    with np.errstate(invalid="ignore"):
        seabed = np.stack([world.world_points(f, lower, world.seabed[f]) for f in range(world.frames)])
    return np.where(np.isfinite(world.seabed), place[..., 2] - seabed[..., 2], np.inf)
