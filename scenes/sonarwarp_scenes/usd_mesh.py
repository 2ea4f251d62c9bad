"""Triangles of one OpenUSD prim, in its own frame."""

# pyright: reportAttributeAccessIssue=false
# OpenUSD fills its modules when they load, where no type checker sees it.

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sonarwarp_scenes import solids
from sonarwarp_scenes.conversion import Conversion, check_indices, check_vertices
from sonarwarp_scenes.polygons import triangulate
from sonarwarp_scenes.usd_values import integers, vectors
from sonarwarp_scenes.winding import Winding

if TYPE_CHECKING:
    from pxr import Usd, UsdGeom


@dataclass(frozen=True, kw_only=True)
class Surface:
    """A prim's triangles."""

    vertices: np.ndarray
    """The prim's points, float64, shape [vertex, 3]."""

    winding: Winding
    """The triangles."""

    face: np.ndarray
    """The prim's face that each triangle is of, shape [triangle]."""

    faces: int
    """Number of the prim's faces, holes and dropped ones included."""

    dropped: int
    """Faces of fewer than three corners."""

    polygons: int
    """Faces of more than three corners."""

    tangled: int
    """Polygons among them that cross themselves."""

    subdivision: str
    """Subdivision scheme, which is ignored."""


def surface_of(prim: Usd.Prim, time: Usd.TimeCode, conversion: Conversion) -> Surface | None:
    """The surface of a mesh or an analytic shape; None for any other prim.

    Raises:
        ValueError: arrays that do not fit together; names prim, attribute, value and bound.
    """
    from pxr import UsdGeom

    if prim.IsA(UsdGeom.Mesh):
        return _mesh(UsdGeom.Mesh(prim), time, conversion)
    shape = _solid(prim, time, conversion.segments)
    if shape is None:
        return None
    return _surface(prim, shape, np.ones(len(shape.counts), dtype=bool), "none", False, conversion)


def _mesh(mesh: UsdGeom.Mesh, time: Usd.TimeCode, conversion: Conversion) -> Surface:
    from pxr import UsdGeom

    prim = mesh.GetPrim()
    points = vectors(mesh.GetPointsAttr(), time)
    counts = integers(mesh.GetFaceVertexCountsAttr(), time)
    indices = integers(mesh.GetFaceVertexIndicesAttr(), time)
    holes = integers(mesh.GetHoleIndicesAttr(), time)
    path = prim.GetPath()
    check_vertices(f"{path}: points", points)
    if (counts < 0).any():
        where = int(np.flatnonzero(counts < 0)[0])
        raise ValueError(f"{path}: faceVertexCounts: {counts[where]} at [{where}], must be at least 0")
    if counts.sum() != len(indices):
        raise ValueError(
            f"{path}: faceVertexCounts: sum of {counts.sum()}, must be the {len(indices)} of faceVertexIndices"
        )
    check_indices(f"{path}: faceVertexIndices", indices, len(points))
    check_indices(f"{path}: holeIndices", holes, len(counts))
    solid = np.ones(len(counts), dtype=bool)
    solid[holes] = False
    left_handed = mesh.GetOrientationAttr().Get(time) == UsdGeom.Tokens.leftHanded
    scheme = str(mesh.GetSubdivisionSchemeAttr().Get(time))
    return _surface(prim, solids.Polygons(points, counts, indices), solid, scheme, left_handed, conversion)


def _surface(
    prim: Usd.Prim,
    shape: solids.Polygons,
    solid: np.ndarray,
    subdivision: str,
    left_handed: bool,
    conversion: Conversion,
) -> Surface:
    """Triangles of the faces that are ``solid`` [face]."""
    kept = np.flatnonzero(solid & (shape.counts >= 3))
    of_kept = np.repeat(solid & (shape.counts >= 3), shape.counts)
    cut = triangulate(shape.points, shape.counts[kept], shape.indices[of_kept])
    triangles = cut.triangles[:, ::-1] if left_handed else cut.triangles
    return Surface(
        vertices=shape.points,
        winding=conversion.wind(shape.points, triangles),
        face=kept[cut.face],
        faces=len(shape.counts),
        dropped=int(np.count_nonzero(solid)) - len(kept),
        polygons=cut.polygons,
        tangled=cut.tangled,
        subdivision=subdivision,
    )


def _solid(prim: Usd.Prim, time: Usd.TimeCode, segments: int) -> solids.Polygons | None:
    """An analytic shape's polygons; None for any other prim."""
    kind = str(prim.GetTypeName())

    def size(name: str) -> float:
        return _size(prim.GetAttribute(name), time)

    def axis() -> solids.Axis:
        value = prim.GetAttribute("axis").Get(time)
        if value not in ("X", "Y", "Z"):
            raise ValueError(f"{prim.GetPath()}: axis: {value}, must be X, Y or Z")
        return value

    match kind:
        case "Cube":
            return solids.cube(size("size"))
        case "Plane":
            return solids.plane(size("width"), size("length"), axis())
        case "Sphere":
            return solids.sphere(size("radius"), segments)
        case "Cone":
            return solids.cylinder(size("height"), size("radius"), 0.0, axis(), segments)
        case "Cylinder":
            return solids.cylinder(size("height"), size("radius"), size("radius"), axis(), segments)
        case "Cylinder_1":
            return solids.cylinder(size("height"), size("radiusBottom"), size("radiusTop"), axis(), segments)
        case "Capsule":
            return solids.capsule(size("height"), size("radius"), size("radius"), axis(), segments)
        case "Capsule_1":
            return solids.capsule(size("height"), size("radiusBottom"), size("radiusTop"), axis(), segments)
    return None


def _size(attribute: Usd.Attribute, time: Usd.TimeCode) -> float:
    value = attribute.Get(time)
    if not (isinstance(value, float | int) and np.isfinite(value) and value >= 0.0):
        raise ValueError(
            f"{attribute.GetPrim().GetPath()}: {attribute.GetName()}: {value}, must be at least 0 and finite"
        )
    return float(value)
