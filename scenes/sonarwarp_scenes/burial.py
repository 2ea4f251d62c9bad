"""A mesh half-buried in a seabed, and what of it stays in the water."""

from __future__ import annotations

import numpy as np

from sonarwarp_scenes.scene import Scene


def bury(mesh: Scene) -> Scene:
    """A mesh with the middle of its height at z = 0, its lowest x at x = 0, and what is over z = 0 centred on y = 0.

    Only what is over the seabed is seen: a wreck that lists would else have its visible side beside the run.
    """
    low, high = mesh.bounds()
    buried = mesh.moved((-low[0], 0.0, -0.5 * (low[2] + high[2])))
    middle = 0.5 * exposed_bounds(buried).sum(axis=0)
    return buried.moved((0.0, -middle[1], 0.0))


def exposed_bounds(scene: Scene) -> np.ndarray:
    """Lowest and highest corner of the box round what of a scene is over z = 0 [m], shape [2, 3].

    Raises:
        ValueError: a scene of which nothing is.
    """
    corners = scene.vertices[scene.faces]
    start, end = corners.reshape(-1, 3), np.roll(corners, -1, axis=1).reshape(-1, 3)
    through = start[:, 2] * end[:, 2] < 0.0
    start, end, over = start[through], end[through], start[start[:, 2] >= 0.0]
    along = start[:, 2] / (start[:, 2] - end[:, 2])
    points = np.concatenate([over, start + along[:, None] * (end - start)])
    if not len(points):
        raise ValueError(f"scene: highest at z = {scene.bounds()[1, 2]:g} m, must reach over 0")
    return np.stack([points.min(axis=0), points.max(axis=0)])
