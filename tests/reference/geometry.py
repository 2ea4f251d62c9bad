"""Rotation matrices, beam directions and bin look-ups in float64."""

import numpy as np

_AXES = {"x": 0, "y": 1, "z": 2}


def rotation(axis: str, angle: float) -> np.ndarray:
    """Matrix that turns vectors by ``angle`` [rad] about ``axis``, right-handed."""
    i, j = (_AXES[axis] + 1) % 3, (_AXES[axis] + 2) % 3
    matrix = np.eye(3)
    matrix[i, i] = matrix[j, j] = np.cos(angle)
    matrix[j, i] = np.sin(angle)
    matrix[i, j] = -matrix[j, i]
    return matrix


def sonar_rotation(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Orientation of a sonar from its three angles [rad] (Eq. 35)."""
    return rotation("z", yaw) @ rotation("y", pitch) @ rotation("x", roll)


def profiling_ray(orientation: np.ndarray, head_angle: float, across: float, in_plane: float) -> np.ndarray:
    """Direction of a ray of the profiling sonar: xi turns the head, phi and theta pick the ray (Eq. 34)."""
    turn = rotation("z", head_angle) @ rotation("y", across) @ rotation("z", in_plane)
    return orientation @ turn @ np.array([1.0, 0.0, 0.0])


def quaternion(matrix: np.ndarray) -> np.ndarray:
    """Quaternion x, y, z, w of a rotation matrix: the unit vector q that leaves the most of it, by eigenvectors."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = matrix
    symmetric = np.array(
        [
            [xx - yy - zz, xy + yx, xz + zx, zy - yz],
            [xy + yx, yy - xx - zz, yz + zy, xz - zx],
            [xz + zx, yz + zy, zz - xx - yy, yx - xy],
            [zy - yz, xz - zx, yx - xy, xx + yy + zz],
        ]
    )
    return np.linalg.eigh(symmetric)[1][:, -1]


def direction(azimuth: np.ndarray, elevation: np.ndarray, cone: bool) -> np.ndarray:
    """Unit vectors of a beam by its definition.

    A fan's beam turns about z by the azimuth after it was raised by the elevation; a cone's is turned first, so that
    its angle with the y axis never changes.
    """
    vectors = []
    for turn, rise in zip(np.ravel(azimuth), np.ravel(elevation), strict=True):
        by_turn, by_rise = rotation("z", turn), rotation("y", -rise)
        vectors.append((by_rise @ by_turn if cone else by_turn @ by_rise)[:, 0])
    return np.array(vectors)


def bin_below(range_edge: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Bin that holds each distance, its lower edge included; -1 below them, the bin count from the last on."""
    return np.searchsorted(range_edge, distance, side="right") - 1


def bin_range(range_edge: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Slant range at a fractional bin, 0 being the middle of the first; clamped to the outer edges."""
    return np.interp(position, np.arange(len(range_edge)) - 0.5, range_edge)
