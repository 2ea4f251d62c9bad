"""How steep the faces of a scene are."""

from __future__ import annotations

import numpy as np

from sonarwarp_scenes import Scene


def face_inclination(scene: Scene) -> np.ndarray:
    """Angle between each face and the horizontal [rad], from 0 to pi/2, shape [face].

    Which side of a face is its front does not matter: meshes of real things are seldom closed or turned alike, and an
    overhang is as steep to a sonar as the slope under it. A face without area is level.
    """
    a, b, c = (scene.vertices[scene.faces[:, corner]] for corner in range(3))
    normal = np.cross(b - a, c - a)
    return np.arctan2(np.linalg.norm(normal[:, :2], axis=1), np.abs(normal[:, 2]))
