"""How a file becomes a scene: options, the parts that readers find, and their assembly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from sonarwarp_scenes.checks import REACH, check_finite, check_positive, read_only
from sonarwarp_scenes.materials import CONCRETE
from sonarwarp_scenes.report import ImpedanceReport, PartReport, SceneReport
from sonarwarp_scenes.scene import Scene
from sonarwarp_scenes.winding import Winding, wind_outwards

Up = Literal["y", "z"]

# Instances of instances multiply; this many triangles take 5 GB as a scene.
_MOST_FACES = 2**26


@dataclass(frozen=True, kw_only=True)
class Conversion:
    """Options of :func:`~sonarwarp_scenes.read_scene`, where they are described.

    Raises:
        ValueError: names the option, its value and the bound.
    """

    scale: float | None = None
    up: Up | None = None
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    impedance: float = CONCRETE
    winding: Literal["repair", "keep"] = "repair"
    segments: int = 64
    time_code: float | None = None

    def __post_init__(self) -> None:
        if self.scale is not None:
            check_positive("scale", self.scale)
        if self.up not in (None, "y", "z"):
            raise ValueError(f"up: {self.up!r}, must be 'y', 'z' or None")
        object.__setattr__(self, "origin", tuple(read_only("origin", self.origin, (3,)).tolist()))
        check_impedance("impedance", self.impedance)
        if self.winding not in ("repair", "keep"):
            raise ValueError(f"winding: {self.winding!r}, must be 'repair' or 'keep'")
        if not 3 <= self.segments <= 4096:
            raise ValueError(f"segments: {self.segments}, must be 3 to 4096")
        if self.time_code is not None:
            check_finite("time_code", self.time_code)

    def wind(self, vertices: np.ndarray, triangles: np.ndarray) -> Winding:
        """Triangles as the ``winding`` option wants them."""
        wound = wind_outwards(vertices, triangles)
        return wound if self.winding == "repair" else wound._replace(triangles=triangles, flipped=0)


def check_impedance(name: str, value: float) -> None:
    """Refuse what is no impedance, or none that single precision holds.

    Raises:
        ValueError: names ``name`` and the value.
    """
    bound = np.finfo(np.float32)
    if not float(bound.tiny) <= value <= float(bound.max):
        raise ValueError(f"{name}: {value} rayl, must be positive and fit float32")


def check_vertices(name: str, vertices: np.ndarray) -> None:
    """Refuse positions [vertex, 3] that are not finite.

    Raises:
        ValueError: names ``name``, the vertex and its position.
    """
    wrong = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if wrong.size:
        raise ValueError(f"{name}: vertex {wrong[0]} at {vertices[wrong[0]].tolist()}, must be finite")


def check_indices(name: str, indices: np.ndarray, count: int) -> None:
    """Refuse indices, of any shape, outside 0 to ``count`` - 1.

    Raises:
        ValueError: names ``name``, the index and the bounds.
    """
    wrong = np.argwhere((indices < 0) | (indices >= count))
    if len(wrong):
        where = tuple(int(axis) for axis in wrong[0])
        raise ValueError(f"{name}: index {indices[where]} at {list(where)}, must be in 0..{count - 1}")


@dataclass(kw_only=True)
class Part:
    """One mesh as a reader found it: in the file's units and axes, and where its transforms put it."""

    name: str
    vertices: np.ndarray  # [vertex, 3]
    winding: Winding
    impedance: np.ndarray  # [triangle]
    impedances: tuple[ImpedanceReport, ...]
    dropped: int = 0  # faces of fewer than three corners
    polygons: int = 0
    tangled: int = 0
    subdivision: str = "none"
    placements: np.ndarray = field(default_factory=lambda: np.eye(4)[None])
    """Matrices that take row vectors, one per copy, shape [copy, 4, 4]."""

    @property
    def faces(self) -> int:
        """Triangles of all copies."""
        return len(self.placements) * len(self.winding.triangles)


def assemble(
    parts: Sequence[Part],
    conversion: Conversion,
    *,
    reader: str,
    metres_per_unit: float,
    up: Up,
    skipped: Sequence[str] = (),
) -> tuple[Scene, SceneReport]:
    """All parts as one scene in metres with z up, and the report on them.

    Args:
        parts: at least one, with at least one triangle each.
        conversion: options; ``scale`` and ``up`` go before what the file says.
        reader: name for the report.
        metres_per_unit: what the file says of its unit.
        up: what the file says of its axes.
        skipped: what the reader left out.

    Raises:
        ValueError: a position that is not finite or too far out, no triangle with an area, or too many.
    """
    scale = metres_per_unit if conversion.scale is None else conversion.scale
    up = up if conversion.up is None else conversion.up
    check_face_count(sum(part.faces for part in parts))
    placed = [_placed(part, scale, up, conversion.origin) for part in parts]
    _check_reach([part.name for part in parts], placed, conversion.origin)
    faces, impedances, reports, first = [], [], [], 0
    for part, vertices in zip(parts, placed, strict=True):
        triangles = _triangles_of_copies(part)
        impedance = np.tile(part.impedance, len(part.placements))
        kept = _has_area(vertices, triangles)
        faces.append(triangles[kept] + first)
        impedances.append(impedance[kept])
        first += len(vertices)
        reports.append(_report(part, int(kept.sum())))
    total = sum(map(len, faces))
    if not total:
        raise ValueError(f"faces: all {sum(part.faces for part in parts)} have zero area, at least one must not")
    scene = Scene(vertices=np.concatenate(placed), faces=np.concatenate(faces), impedance=np.concatenate(impedances))
    report = SceneReport(reader=reader, metres_per_unit=scale, up=up, parts=tuple(reports), skipped=tuple(skipped))
    return scene, report


def check_face_count(faces: int) -> None:
    """Refuse more triangles than a scene may have.

    Raises:
        ValueError: names the number and the bound.
    """
    if faces > _MOST_FACES:
        raise ValueError(f"faces: {faces}, must be at most {_MOST_FACES}: leave parts or instances out")


def turned_up(vectors: np.ndarray, up: Up) -> np.ndarray:
    """Vectors [.., 3] of a file whose ``up`` axis points up, turned about x so that z does."""
    if up == "z":
        return vectors
    return np.stack([vectors[..., 0], -vectors[..., 2], vectors[..., 1]], axis=-1)


def _placed(part: Part, scale: float, up: Up, origin: tuple[float, float, float]) -> np.ndarray:
    """World positions [m] of all copies' vertices, shape [copy * vertex, 3]."""
    with np.errstate(all="ignore"):
        world = part.vertices @ part.placements[:, :3, :3] + part.placements[:, 3:, :3]
        return turned_up(scale * world.reshape(-1, 3), up) - np.array(origin)


def _check_reach(names: Sequence[str], placed: Sequence[np.ndarray], origin: tuple[float, float, float]) -> None:
    for name, vertices in zip(names, placed, strict=True):
        check_vertices(name, vertices)
    low = np.min([vertices.min(axis=0) for vertices in placed], axis=0)
    high = np.max([vertices.max(axis=0) for vertices in placed], axis=0)
    furthest = max(np.abs(low).max(), np.abs(high).max())
    if furthest <= REACH:
        return
    outside = next(name for name, vertices in zip(names, placed, strict=True) if np.abs(vertices).max() == furthest)
    way_out = "scale to metres"
    if (0.5 * (high - low) < REACH).all():
        middle = np.round(0.5 * (low + high) + np.array(origin))
        way_out = f"pass origin=({', '.join(f'{value:.0f}' for value in middle)}), or {way_out}"
    raise ValueError(f"{outside}: coordinate of {furthest:.6g} m, must be within {REACH:g} m of the origin: {way_out}")


def _triangles_of_copies(part: Part) -> np.ndarray:
    """Triangles of all copies, shape [copy * triangle, 3]; those of a mirrored copy are turned over."""
    triangles = part.winding.triangles
    mirrored = np.linalg.det(part.placements[:, :3, :3]) < 0.0
    first = len(part.vertices) * np.arange(len(part.placements))
    copies = np.where(mirrored[:, None, None], triangles[:, ::-1], triangles) + first[:, None, None]
    return copies.reshape(-1, 3)


def _has_area(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Which triangles have an area as kernels see them, in single precision."""
    corners = vertices.astype(np.float32).astype(np.float64)[triangles]
    return np.any(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) != 0.0, axis=1)


def _report(part: Part, kept: int) -> PartReport:
    copies = len(part.placements)
    return PartReport(
        name=part.name,
        copies=copies,
        faces=kept,
        degenerate=part.faces - kept + copies * part.dropped,
        polygons=part.polygons,
        tangled=part.tangled,
        flipped=part.winding.flipped,
        open=part.winding.open,
        unclear=part.winding.unclear,
        subdivision=part.subdivision,
        impedances=part.impedances,
    )
