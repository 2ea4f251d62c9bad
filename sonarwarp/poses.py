"""Arrays of poses, shape [..., 7]: position x, y, z [m], then unit quaternion x, y, z, w."""

from __future__ import annotations

import numpy as np


def rotate(quaternion: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Vectors turned by quaternions; shapes [..., 4] and [..., 3] broadcast."""
    axis = quaternion[..., :3]
    turned = 2.0 * np.cross(axis, vector)
    return vector + quaternion[..., 3:] * turned + np.cross(axis, turned)


def compose(outer: np.ndarray, inner: np.ndarray) -> np.ndarray:
    """Poses ``outer`` after ``inner``: world_from_vehicle and vehicle_from_sensor give world_from_sensor."""
    outer, inner = np.broadcast_arrays(outer, inner)
    a, b = outer[..., 3:], inner[..., 3:]
    axis = a[..., 3:] * b[..., :3] + b[..., 3:] * a[..., :3] + np.cross(a[..., :3], b[..., :3])
    scalar = a[..., 3:] * b[..., 3:] - np.sum(a[..., :3] * b[..., :3], axis=-1, keepdims=True)
    position = outer[..., :3] + rotate(a, inner[..., :3])
    return np.concatenate([position, axis, scalar], axis=-1)


def turned(poses: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Poses turned in their own frame by roll, pitch and yaw [rad], shape [pose, 3], yaw outermost (Eq. 35's order)."""
    turn = np.zeros((len(angles), 7))
    turn[:, 6] = 1.0
    for axis in (2, 1, 0):
        step = np.zeros_like(turn)
        step[:, 3 + axis] = np.sin(0.5 * angles[:, axis])
        step[:, 6] = np.cos(0.5 * angles[:, axis])
        turn = compose(turn, step)
    return compose(poses, turn)
