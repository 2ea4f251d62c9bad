"""A point cloud with what is known about each point."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sonarwarp.checks import finite_array


@dataclass(frozen=True, kw_only=True, eq=False)
class PointCloud:
    """Points in the world frame and named attributes, one value per point."""

    points: np.ndarray
    """World positions [m], shape [point, 3]."""

    attributes: dict[str, np.ndarray] = field(default_factory=dict)
    """Name to values, each of shape [point]."""

    def __post_init__(self) -> None:
        finite_array("PointCloud.points", self.points, shape=(None, 3))
        for name, values in self.attributes.items():
            if values.shape != (len(self.points),):
                raise ValueError(f"PointCloud.attributes[{name}]: expected ({len(self.points)},), got {values.shape}")

    def __len__(self) -> int:
        return len(self.points)

    def select(self, chosen: np.ndarray) -> PointCloud:
        """The points for which the mask or index ``chosen`` holds."""
        return PointCloud(
            points=self.points[chosen], attributes={name: values[chosen] for name, values in self.attributes.items()}
        )

    def write_ply(self, path: str | Path) -> None:
        """Write binary PLY, every attribute a vertex property (float32 or int32)."""
        import trimesh
        from trimesh.exchange.ply import export_ply

        mesh = trimesh.Trimesh(vertices=self.points, process=False)
        for name, values in self.attributes.items():
            kind = np.int32 if np.issubdtype(values.dtype, np.integer) else np.float32
            mesh.vertex_attributes[name] = values.astype(kind)
        Path(path).write_bytes(export_ply(mesh, encoding="binary"))
