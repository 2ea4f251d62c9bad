"""Particles of one arc in float64: integer keys, quantiles of SciPy's distributions, a field read by ``ndimage``."""

import numpy as np

from sonarwarp_kernels.keys import STREAM_ELEVATION, STREAM_RANGE
from tests.reference import mixture as mixtures
from tests.reference.field import read_log_odds
from tests.reference.geometry import direction
from tests.reference.keys import mix_key


def uniform(key: int) -> float:
    """Middle of the interval that a key's upper 23 bits name."""
    return ((key >> 41) + 0.5) / 2**23


def support(range_edge, seabed: float, critical: float) -> tuple[float, float]:
    """From the window's start to r_emin, or to a critical range beyond it, but never past the window."""
    return float(range_edge[0]), float(min(max(seabed, critical), range_edge[-1]))


def draw(world, frame: int, beam: int, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Ranges and elevations."""
    by_range, by_elevation = (
        mix_key(mix_key(int(world.key[frame]), int(stream)), beam) for stream in (STREAM_RANGE, STREAM_ELEVATION)
    )
    each = [mix_key(by_range, index) for index in range(number)]
    choice = np.array([uniform(key) for key in each])
    part = np.array([uniform(mix_key(key, 0)) for key in each])
    within = np.array([uniform(mix_key(by_elevation, index)) for index in range(number)])
    critical = float(world.critical[frame, beam])
    start, end = support(world.range_edge, world.seabed[frame, beam], critical)
    distance = mixtures.sample(world.inputs("cpu", [])["mixture"], critical, start, end, choice, part)
    elevation = world.half_elevation * (2 * (np.arange(number) + within) / number - 1)
    return distance, elevation


def points(world, frame: int, beam: int, distance, elevation) -> np.ndarray:
    """World positions, shape [particle, 3]."""
    azimuth = np.full(len(elevation), float(world.azimuth[beam]))
    return world.world_points(frame, direction(azimuth, elevation, bool(world.cone)), distance)


def log_odds(world, frame: int, where) -> np.ndarray:
    """Clamped log-odds of the frame's field at world positions."""
    owner = world.trajectory[frame]
    origin = world.origin[owner].astype(np.float64)
    return read_log_odds(world.counts[owner], origin, float(np.float32(world.cell)), where, world.low, world.high)
