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

    def write_npz(self, path: str | Path) -> None:
        """Write a compressed NumPy archive: ``points``, and every attribute under its name."""
        np.savez_compressed(path, allow_pickle=False, points=self.points, **self.attributes)


def read_cloud(path: str | Path) -> PointCloud:
    """Read a cloud that :class:`PointCloud` wrote, PLY or NPZ, or the vertices of any other PLY.

    Raises:
        ValueError: another suffix, no such file, or one that cannot be read; one line that names the file.
    """
    path = Path(path)
    readers = {".ply": _read_ply, ".npz": _read_npz}
    if path.suffix.lower() not in readers:
        raise ValueError(f"{path}: {path.suffix or 'no suffix'}, must be .ply or .npz")
    try:
        points, attributes = readers[path.suffix.lower()](path)
        return PointCloud(points=points, attributes=attributes)
    # Readers of damaged files raise what their parsers happen to meet.
    except Exception as error:
        raise ValueError(f"{path}: cannot be read as a cloud: {error}") from error


def _read_npz(path: Path) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
        return archive["points"], {name: archive[name] for name in archive.files if name != "points"}


def _read_ply(path: Path) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    from trimesh.exchange.ply import load_ply

    with path.open("rb") as file:
        vertex = load_ply(file)["metadata"]["_ply_raw"]["vertex"]["data"]
    names = vertex.dtype.names
    points = np.stack([vertex[axis] for axis in "xyz"], axis=-1).astype(np.float64)
    return points, {name: vertex[name] for name in names if name not in ("x", "y", "z")}
