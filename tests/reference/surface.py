"""Distances to triangles and points, lines of sight and sonar views, by brute force in float64."""

import numpy as np


def _to_segments(a: np.ndarray, b: np.ndarray, point: np.ndarray) -> np.ndarray:
    along = b - a
    part = np.clip(np.sum((point - a) * along, axis=-1) / np.sum(along**2, axis=-1), 0.0, 1.0)
    return np.linalg.norm(a + part[..., None] * along - point, axis=-1)


def face_distances(vertices: np.ndarray, faces: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Distance from every point to every triangle, shape [point, face].

    That to the plane where the foot of the perpendicular lies inside, that to the nearest edge elsewhere.
    """
    a, b, c = vertices[faces].transpose(1, 0, 2)
    point = points[:, None]
    normal = np.cross(b - a, c - a)
    normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    height = np.sum((point - a) * normal, axis=-1)
    foot = point - height[..., None] * normal
    inside = np.ones(height.shape, dtype=bool)
    for start, end in ((a, b), (b, c), (c, a)):
        inside &= np.sum(np.cross(end - start, foot - start) * normal, axis=-1) >= 0.0
    edges = np.min([_to_segments(a, b, point), _to_segments(b, c, point), _to_segments(c, a, point)], axis=0)
    return np.where(inside, np.abs(height), edges)


def cloud_distances(points: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Distance from each sample to its nearest point, shape [sample]."""
    return np.array([np.min(np.linalg.norm(points - sample, axis=1), initial=np.inf) for sample in samples])


def first_hits(vertices: np.ndarray, faces: np.ndarray, origin: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Distance along unit ``directions`` from ``origin`` to the first triangle, infinite without one, shape [ray].

    Solves origin + t d = a + u (b - a) + v (c - a) by Cramer's rule.
    """
    a, b, c = vertices[faces].transpose(1, 0, 2)
    d = directions[:, None]
    across = np.cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1.0 / -np.sum(d * across, axis=-1)
        from_a = origin - a
        turned = np.cross(from_a, d)
        u = np.sum((c - a) * turned, axis=-1) * scale
        v = -np.sum((b - a) * turned, axis=-1) * scale
        t = np.sum(from_a * across, axis=-1) * scale
        met = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t > 0.0)
    return np.where(met, t, np.inf).min(axis=1)


def in_view(local: np.ndarray, azimuth: np.ndarray, elevation: np.ndarray, reach: np.ndarray, cone: bool) -> np.ndarray:
    """Which points of a sonar's frame lie in the closed intervals of azimuth, elevation [rad] and range [m].

    A fan's beam stands upright on its azimuth; a cone's keeps its angle with the y axis and turns about it.
    """
    x, y, z = local.T
    forward, side = (np.hypot(x, z), np.arctan2(z, x)) if cone else (np.hypot(x, y), np.arctan2(y, x))
    turn, rise = (np.arctan2(y, forward), side) if cone else (side, np.arctan2(z, forward))
    distance = np.linalg.norm(local, axis=1)
    kept = np.ones(len(local), dtype=bool)
    for value, (low, high) in ((turn, azimuth), (rise, elevation), (distance, reach)):
        kept &= (value >= low) & (value <= high)
    return kept


def line_of_sight(vertices: np.ndarray, faces: np.ndarray, origin: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """How much nearer than each sample the first face along the ray to it lies [m], at most 0 where none hides it."""
    between = samples - origin
    distance = np.linalg.norm(between, axis=1)
    return distance - first_hits(vertices, faces, origin, between / distance[:, None])
