"""A point cloud with what is known about each point."""

from __future__ import annotations

from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path

import numpy as np

from sonarwarp.checks import finite_array
from sonarwarp.durable import replacing

NORMAL = ("normal_x", "normal_y", "normal_z")
"""Attributes that hold the unit normal of the surface at a point, world; 0, 0, 0 where it is not known."""

# What programs that read PLY call the normals: MeshLab, CloudCompare.
_PLY_NAMES: dict[str, str] = dict(zip(NORMAL, ("nx", "ny", "nz"), strict=True))

# Headers name every field four times [byte].
_LONGEST_HEADER = 1 << 16

# Bytes that LZF, PCD's compression, packs into one at most. A damaged header must not ask for all memory.
_MOST_PACKED = 88


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

    @staticmethod
    def join(*clouds: PointCloud) -> PointCloud:
        """One cloud after the other; all must have the same attributes."""
        names = clouds[0].attributes
        return PointCloud(
            points=np.concatenate([cloud.points for cloud in clouds]),
            attributes={name: np.concatenate([cloud.attributes[name] for cloud in clouds]) for name in names},
        )

    def write_ply(self, path: str | Path) -> None:
        """Write binary PLY, every attribute a vertex property (float32 or int32), in one step over an older file.

        The attributes of :data:`NORMAL` are called nx, ny and nz, as in other programs.

        Raises:
            ValueError: an attribute of its own that is called nx, ny or nz beside one of :data:`NORMAL`.
        """
        import trimesh
        from trimesh.exchange.ply import export_ply

        mesh = trimesh.Trimesh(vertices=self.points, process=False)
        for name, values in self.attributes.items():
            stored = _PLY_NAMES.get(name, name)
            if stored != name and stored in self.attributes:
                raise ValueError(f"PointCloud.attributes: {name!r} and {stored!r} are both {stored} in PLY: rename one")
            mesh.vertex_attributes[stored] = values.astype(_stored_type(values))
        with replacing(Path(path)) as file:
            file.write(export_ply(mesh, encoding="binary"))

    def write_pcd(self, path: str | Path) -> None:
        """Write binary PCD, every attribute a field (float32 or int32), in one step over an older file.

        Names stay as they are; those of :data:`NORMAL` are what PCL calls normals.

        Raises:
            ValueError: a name that is not one word of letters, digits and underscores, as PCD's header wants.
        """
        from pypcd4.pypcd4 import PointCloud as Pcd

        for name in self.attributes:
            if not name.isidentifier():
                raise ValueError(f"PointCloud.attributes: {name!r}, must be letters, digits and underscores for PCD")
        columns = [*np.asarray(self.points, dtype=np.float32).T, *self.attributes.values()]
        types = [np.float32] * 3 + [_stored_type(values) for values in self.attributes.values()]
        content = BytesIO()
        Pcd.from_points(columns, ["x", "y", "z", *self.attributes], types).save(content)
        with replacing(Path(path)) as file:
            file.write(content.getvalue())

    def write_npz(self, path: str | Path) -> None:
        """Write a compressed NumPy archive, ``points`` and every attribute, in one step over an older file."""
        with replacing(Path(path)) as file:
            np.savez_compressed(file, allow_pickle=False, points=self.points, **self.attributes)


def _stored_type(values: np.ndarray) -> type[np.number]:
    """What an attribute becomes in files that point-cloud programs read."""
    return np.int32 if np.issubdtype(values.dtype, np.integer) else np.float32


def read_cloud(path: str | Path) -> PointCloud:
    """Read a cloud that :class:`PointCloud` wrote, PLY, PCD or NPZ, or the points of any other PLY or PCD.

    Attributes have the names that they were written by, a PLY's normals those of :data:`NORMAL`.

    Raises:
        ValueError: another suffix, no such file, or one that cannot be read; one line that names the file.
    """
    path = Path(path)
    readers = {".ply": _read_ply, ".pcd": _read_pcd, ".npz": _read_npz}
    if path.suffix.lower() not in readers:
        raise ValueError(f"{path}: {path.suffix or 'no suffix'}, must be .ply, .pcd or .npz")
    try:
        points, attributes = readers[path.suffix.lower()](path)
        return PointCloud(points=points, attributes=attributes)
    # Readers of damaged files raise what their parsers happen to meet.
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"{path}: cannot be read as a cloud: {reason}") from error


def _read_npz(path: Path) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
        return archive["points"], {name: archive[name] for name in archive.files if name != "points"}


def _read_ply(path: Path) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    from trimesh.exchange.ply import load_ply

    with path.open("rb") as file:
        points, attributes = _columns(load_ply(file)["metadata"]["_ply_raw"]["vertex"]["data"])
    names = {stored: name for name, stored in _PLY_NAMES.items()}
    return points, {names.get(stored, stored): values for stored, values in attributes.items()}


def _read_pcd(path: Path) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    from pypcd4.pypcd4 import MetaData
    from pypcd4.pypcd4 import PointCloud as Pcd

    with path.open("rb") as file:
        head, data, _ = file.read(_LONGEST_HEADER).partition(b"\nDATA ")
    if not data:
        raise ValueError("no whole header of a PCD file")
    header = MetaData.parse_header(head.decode().splitlines())
    if max(header.points, 1) * sum(header.count) > _MOST_PACKED * path.stat().st_size:
        raise ValueError("the header names more values than the file can hold")
    pcd = Pcd.from_path(path)
    if len(pcd.pc_data) != pcd.points:
        raise ValueError(f"{len(pcd.pc_data)} points, must be the header's {pcd.points}")
    points, attributes = _columns(pcd.pc_data)
    # What other programs leave between fields has no name.
    return points, {name: values for name, values in attributes.items() if not name.startswith("#")}


def _columns(rows: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Points [point, 3] and all other columns of a structured array [point]."""
    points = np.stack([rows[axis] for axis in "xyz"], axis=-1).astype(np.float64)
    return points, {name: rows[name] for name in rows.dtype.names or () if name not in ("x", "y", "z")}
