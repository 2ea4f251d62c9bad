"""Scenes from files: one way in for meshes and OpenUSD stages."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from sonarwarp_scenes.child import in_child
from sonarwarp_scenes.conversion import Conversion, Part, Up, assemble, check_indices, check_vertices
from sonarwarp_scenes.materials import CONCRETE, material_in
from sonarwarp_scenes.report import ImpedanceReport, SceneReport
from sonarwarp_scenes.scene import Scene

USD_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
"""Files that OpenUSD reads; all others are trimesh's."""

_SILENT = logging.NullHandler()


def is_stage(path: Path) -> bool:
    """Whether OpenUSD reads a file, by its suffix."""
    return path.suffix.lower() in USD_SUFFIXES


def scene_from_file(
    path: str | Path,
    *,
    scale: float | None = None,
    up: Up | None = None,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    impedance: float = CONCRETE,
    winding: Literal["repair", "keep"] = "repair",
    segments: int = 64,
    time_code: float | None = None,
) -> Scene:
    """The scene in a file: :func:`read_scene`, where all is described, without the report."""
    return read_scene(
        path,
        scale=scale,
        up=up,
        origin=origin,
        impedance=impedance,
        winding=winding,
        segments=segments,
        time_code=time_code,
    )[0]


def read_scene(
    path: str | Path,
    *,
    scale: float | None = None,
    up: Up | None = None,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    impedance: float = CONCRETE,
    winding: Literal["repair", "keep"] = "repair",
    segments: int = 64,
    time_code: float | None = None,
) -> tuple[Scene, SceneReport]:
    """All triangles of a mesh file or an OpenUSD stage, where its transforms put them, and a report on them.

    Files that end in .usd, .usda, .usdc or .usdz are read by OpenUSD, in a process of their own (:mod:`child` says
    why); any other by trimesh.

    Args:
        path: the file.
        scale: metres per unit of the file. None: what the file says, or 1 where it says nothing.
        up: axis of the file that points up; ``y`` is turned to z. None: the upAxis of a stage, and z of any other file,
            also where its format has y up (glTF).
        origin: what becomes the world's origin [m], in the file's place but metres and z up; for files in map
            coordinates, which single precision cannot hold.
        impedance: acoustic impedance [rayl] of faces of which the file does not tell any: neither by attribute or
            primvar nor by a material or a part whose name mentions one of :data:`~sonarwarp_scenes.MATERIALS`.
        winding: ``repair`` turns triangles over until neighbours agree and closed surfaces face outwards; ``keep``
            leaves them, as for a tank seen from inside.
        segments: of a full turn, for OpenUSD's spheres, cylinders, cones and capsules; with 64, surfaces lie up to
            0.12 % of the radius inside the true ones.
        time_code: time code at which an OpenUSD stage is read. None: the stage's start, or where it names none, each
            attribute's first sample.

    Raises:
        ValueError: no such file, a file that cannot be read, one without triangles, or one that makes no scene; one
            line that names the file, and the part, value, bound and way out where there are such.
        ModuleNotFoundError: trimesh or usd-core is not installed.
    """
    conversion = Conversion(
        scale=scale,
        up=up,
        origin=origin,
        impedance=impedance,
        winding=winding,
        segments=segments,
        time_code=time_code,
    )
    path = readable(path)
    if is_stage(path):
        arrays, values = in_child("scene", path, conversion)
        return Scene(**arrays), SceneReport.from_dict(values)
    nodes, metres_per_unit = _mesh_nodes(path)
    if not nodes:
        raise ValueError(f"path: {path} holds no triangles")
    try:
        parts = [_part(*node, conversion) for node in nodes]
        return assemble(parts, conversion, reader="trimesh", metres_per_unit=metres_per_unit, up="z")
    except ValueError as error:
        raise ValueError(f"path: {path}: {error}") from error
    except MemoryError as error:
        raise ValueError(f"path: {path}: needs more memory than there is") from error


def readable(path: str | Path) -> Path:
    """``path``, if there is a file that may be read.

    Raises:
        ValueError: says why not.
    """
    path = Path(path)
    if not path.is_file():
        raise ValueError(f"path: no file at {path}")
    try:
        path.open("rb").close()
    except OSError as error:
        raise ValueError(f"path: cannot read {path}: {error.strerror}") from error
    return path


class _Node(NamedTuple):
    """A mesh as trimesh found it, and where it stands."""

    names: tuple[str, ...]  # of its material, of itself, of its geometry; the second is what reports call it
    vertices: np.ndarray  # [vertex, 3]
    faces: np.ndarray  # [face, 3]
    matrix: np.ndarray  # takes column vectors, [4, 4]


def _mesh_nodes(path: Path) -> tuple[list[_Node], float]:
    """Meshes with triangles in a file that trimesh reads, and its metres per unit.

    Raises:
        ValueError: trimesh cannot read it.
    """
    import trimesh

    # What it logs about a broken file is in the refusal; without a handler it would go to the terminal too.
    logging.getLogger("trimesh").addHandler(_SILENT)
    nodes = []
    try:
        # Every format has its own parser, and each fails in its own way. Unprocessed, bad values stay to be refused.
        with np.errstate(all="ignore"):
            loaded = trimesh.load_scene(str(path), process=False)
            metres = 1.0 if loaded.units is None else float(trimesh.units.unit_conversion(loaded.units, "meters"))
            for name in loaded.graph.nodes_geometry:
                matrix, key = loaded.graph[name]
                mesh = loaded.geometry[key]
                if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
                    material = getattr(getattr(mesh.visual, "material", None), "name", None)
                    nodes.append(
                        _Node(
                            (str(material or ""), str(name), str(key)),
                            np.array(mesh.vertices, dtype=np.float64).reshape(-1, 3),
                            np.array(mesh.faces, dtype=np.int64).reshape(-1, 3),
                            np.array(matrix, dtype=np.float64).reshape(4, 4),
                        )
                    )
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"path: cannot read {path} as a mesh: {reason}") from error
    return nodes, metres


def _part(
    names: tuple[str, ...], vertices: np.ndarray, faces: np.ndarray, matrix: np.ndarray, conversion: Conversion
) -> Part:
    name = names[1]
    check_vertices(name, vertices)
    check_indices(f"{name}: faces", faces, len(vertices))
    impedance, source = conversion.impedance, "default"
    for kind, mentioned in zip(("material", "name", "geometry"), names, strict=True):
        material = material_in(mentioned)
        if material is not None:
            impedance, source = material.impedance, f"{kind} {mentioned}: {material.name}"
            break
    return Part(
        name=name,
        vertices=vertices,
        winding=conversion.wind(vertices, faces),
        impedance=np.full(len(faces), impedance),
        impedances=(ImpedanceReport(source=source, faces=len(faces), lowest=impedance, highest=impedance),),
        placements=matrix.T[None],
    )
