"""Range and angles of points that a profiling sonar saw: in its scan plane and across its fan.

Elevation is the angle in the scan plane: positive upwards where the head lies on its side, towards its y axis where it
does not. Azimuth is the angle across the fan, the one that a conical beam keeps (Eq. 34).
"""

from __future__ import annotations

import math

import numpy as np

from sonarwarp.poses import rotate

_CONJUGATE = (-1.0, -1.0, -1.0, 1.0)


def to_polar(head: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Range [m], azimuth and elevation [rad] of points, shape [point] each.

    Args:
        head: world_from_head, x along the beam's axis, y in the scan plane, shape [point, 7].
        points: world [m], none of them in its head, shape [point, 3].
    """
    away = points - head[:, :3]
    distance = np.linalg.norm(away, axis=1)
    seen = rotate(head[:, 3:] * _CONJUGATE, away)
    return distance, np.arcsin(seen[:, 2] / distance), _sense(head) * np.arctan2(seen[:, 1], seen[:, 0])


def to_world(head: np.ndarray, distance: np.ndarray, azimuth: np.ndarray, elevation: np.ndarray) -> np.ndarray:
    """Points of a range [m], azimuth and elevation [rad], world [m], shape [point, 3]; the inverse of :func:`to_polar`.

    Args:
        head: world_from_head, shape [point, 7].
        distance: shape [point].
        azimuth: shape [point].
        elevation: shape [point].
    """
    turn, level = _sense(head) * elevation, distance * np.cos(azimuth)
    seen = np.stack([level * np.cos(turn), level * np.sin(turn), distance * np.sin(azimuth)], axis=1)
    return head[:, :3] + rotate(head[:, 3:], seen)


def per_elevation(head: np.ndarray, points: np.ndarray) -> np.ndarray:
    """How points move with elevation, along their arcs of one range and azimuth, world [m/rad], shape [point, 3].

    Args:
        head: world_from_head, shape [point, 7].
        points: world [m], shape [point, 3].
    """
    axis = rotate(head[:, 3:], np.array([0.0, 0.0, 1.0]))
    return _sense(head)[:, None] * np.cross(axis, points - head[:, :3])


def _sense(head: np.ndarray) -> np.ndarray:
    """-1 where the head's y axis points down, rolled by 45 deg or more, so that waves never turn it over, else 1."""
    axis, side = (rotate(head[:, 3:], np.array(own)) for own in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    # The steeper the beam, the less a roll turns the y axis up or down.
    return np.where(side[:, 2] < -math.sqrt(0.5) * np.hypot(axis[:, 0], axis[:, 1]), -1.0, 1.0)
