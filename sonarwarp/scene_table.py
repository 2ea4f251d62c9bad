"""Scenes on a device: meshes for ray casting and the table that kernels look them up in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import warp as wp

from sonarwarp_kernels.specs import SceneTable
from sonarwarp_scenes import Scene

WATER_IMPEDANCE = 1.5e6
"""Acoustic impedance of water [rayl]: 1,000 kg/m3 times 1,500 m/s."""


class DeviceScenes:
    """Uploaded scenes; keep this object as long as kernels use its table, for Warp only knows the meshes' ids.

    Args:
        scenes: what the sonars look at.
        device: where to.
    """

    def __init__(self, scenes: Sequence[Scene], device: wp.Device) -> None:
        if not scenes:
            raise ValueError("scenes: empty, at least one is needed")
        self._meshes = [
            wp.Mesh(
                wp.array(scene.vertices, dtype=wp.vec3, device=device),
                wp.array(scene.faces.reshape(-1), dtype=int, device=device),
                bvh_constructor="sah",
                # Fewer faces a leaf: 5-15 % faster than the default 4 on a rough seabed, 1 is slower than both.
                bvh_leaf_size=2,
            )
            for scene in scenes
        ]
        counts = [len(scene.faces) for scene in scenes]
        impedance = np.concatenate([scene.impedance for scene in scenes])
        self.table = SceneTable()
        self.table.mesh = wp.array([*(mesh.id for mesh in self._meshes), 0], dtype=wp.uint64, device=device)
        self.table.first_face = wp.array(np.cumsum([0, *counts]), dtype=int, device=device)
        self.table.impedance = wp.array(impedance, dtype=float, device=device)
        self.table.water = WATER_IMPEDANCE
        self.empty = len(scenes)
        """Index of an empty scene, after all others."""


def scene_of_trajectory(scene_of: Sequence[int] | None, trajectories: int, scenes: int) -> np.ndarray:
    """Scene of each trajectory, int32, shape [trajectory]: as given, else the only one, else scene i for trajectory i.

    Raises:
        ValueError: a trajectory without a scene.
    """
    if scene_of is None:
        scene_of = [0] * trajectories if scenes == 1 else range(trajectories)
    chosen = np.asarray(list(scene_of), dtype=np.int32)
    if chosen.shape != (trajectories,) or (trajectories and not 0 <= chosen.min() <= chosen.max() < scenes):
        raise ValueError(
            f"scene_of: {chosen.tolist()}, must name one of {scenes} scenes for each of {trajectories} trajectories"
        )
    return chosen
