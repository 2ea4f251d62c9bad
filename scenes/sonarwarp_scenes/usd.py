"""Scenes from OpenUSD stages."""

# pyright: reportAttributeAccessIssue=false
# OpenUSD fills its modules when they load, where no type checker sees it.

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sonarwarp_scenes.conversion import Conversion, Part, Up, assemble, check_face_count, check_indices
from sonarwarp_scenes.report import ImpedanceReport, SceneReport
from sonarwarp_scenes.scene import Scene
from sonarwarp_scenes.usd_impedance import FaceImpedances, Told, face_impedances
from sonarwarp_scenes.usd_mesh import Surface, surface_of
from sonarwarp_scenes.usd_values import integers

if TYPE_CHECKING:
    from pxr import Sdf, Usd, UsdGeom


def read_stage(stage: Usd.Stage, conversion: Conversion | None = None) -> tuple[Scene, SceneReport]:
    """All triangles of an open OpenUSD stage, where its transforms put them, and a report on them.

    For stages that a person trusts or has built; :func:`~sonarwarp_scenes.read_scene` reads files, in a process of its
    own, and describes the options. Read are meshes, OpenUSD's analytic shapes, native instances and point instancers;
    left out is what is invisible, inactive, or of a purpose other than default and render. How a face gets its
    impedance is told in :mod:`usd_impedance`.

    Raises:
        ValueError: a stage that does not compose, a prim whose arrays do not fit together, or no triangles; names prim,
            attribute, value and bound.
    """
    from pxr import Usd

    conversion = conversion or Conversion()
    metres_per_unit, up = stage_units(stage)
    if conversion.time_code is not None:
        time = Usd.TimeCode(conversion.time_code)
    elif stage.HasAuthoredTimeCodeRange():
        time = Usd.TimeCode(stage.GetStartTimeCode())
    else:
        time = Usd.TimeCode.EarliestTime()
    reader = _Reader(time, conversion)
    parts = reader.parts(stage.GetPseudoRoot(), _Place(), moved=False, within=())
    parts = [part for part in parts if part.faces]
    if not parts:
        raise ValueError("; ".join(["the stage holds no triangles", *reader.skipped[:3]]))
    return assemble(parts, conversion, reader="OpenUSD", metres_per_unit=metres_per_unit, up=up, skipped=reader.skipped)


def scene_of_file(path: str, conversion: Conversion) -> tuple[dict[str, np.ndarray], Any]:
    """Fields of the scene in a file, and the report as a JSON value."""
    from pxr import Usd

    scene, report = read_stage(Usd.Stage.Open(path), conversion)
    arrays = {"vertices": scene.vertices, "faces": scene.faces, "impedance": scene.impedance}
    return arrays, report.as_dict()


def check_composed(stage: Usd.Stage) -> None:
    """Refuse a stage that is not whole.

    Raises:
        ValueError: a reference, payload or layer that cannot be had.
    """
    errors = stage.GetCompositionErrors()
    if errors:
        reason = " ".join(str(errors[0]).split())
        raise ValueError(f"{reason} Put it there, or deactivate the prim ({len(errors)} such)")


def stage_units(stage: Usd.Stage) -> tuple[float, Up]:
    """Metres per unit and the axis that points up, of a stage that composes.

    Raises:
        ValueError: as :func:`check_composed`, or a unit that is not positive.
    """
    from pxr import UsdGeom

    check_composed(stage)
    metres_per_unit = UsdGeom.GetStageMetersPerUnit(stage)
    if not (np.isfinite(metres_per_unit) and metres_per_unit > 0.0):
        raise ValueError(f"metersPerUnit: {metres_per_unit}, must be positive and finite")
    up = str(UsdGeom.GetStageUpAxis(stage)).lower()
    if up not in ("y", "z"):
        raise ValueError(f"upAxis: {up.upper()}, must be Y or Z")
    return metres_per_unit, "y" if up == "y" else "z"


@dataclass(frozen=True, kw_only=True)
class _Place:
    """What a prim has from its ancestors."""

    matrix: np.ndarray = field(default_factory=lambda: np.eye(4))
    """Takes row vectors, [4, 4]."""

    purpose: UsdGeom.Imageable.PurposeInfo | None = None
    told: Told = field(default_factory=Told)


class _Reader:
    """Walks a stage at one time."""

    def __init__(self, time: Usd.TimeCode, conversion: Conversion) -> None:
        from pxr import UsdGeom

        self.skipped: list[str] = []
        self._time = time
        self._conversion = conversion
        self._transforms = UsdGeom.XformCache(time)
        # Native instances share their prototype's prims.
        self._of_prototype: dict[Sdf.Path, Surface | None] = {}

    def parts(self, root: Usd.Prim, place: _Place, *, moved: bool, within: tuple[Sdf.Path, ...]) -> list[Part]:
        """Meshes of ``root`` and all below it.

        Args:
            root: where to start.
            place: what it has from above.
            moved: whether its own transform counts.
            within: point instancers that this is a prototype of.
        """
        from pxr import Usd, UsdGeom

        parts = []
        stack = [(root, place, moved)]
        while stack:
            prim, above, moved = stack.pop()
            if prim.IsA(UsdGeom.Imageable) and self._is_invisible(UsdGeom.Imageable(prim)):
                self.skipped.append(f"{prim.GetPath()}: invisible")
                continue
            here = self._entered(prim, above, moved)
            if prim.IsA(UsdGeom.PointInstancer):
                parts += self._instances(UsdGeom.PointInstancer(prim), here, within)
                continue
            if prim.IsA(UsdGeom.Gprim):
                parts += self._part(prim, here)
            children = prim.GetFilteredChildren(Usd.TraverseInstanceProxies())
            stack += [(child, here, True) for child in reversed(children)]
        return parts

    def _is_invisible(self, prim: UsdGeom.Imageable) -> bool:
        from pxr import UsdGeom

        return prim.GetVisibilityAttr().Get(self._time) == UsdGeom.Tokens.invisible

    def _entered(self, prim: Usd.Prim, above: _Place, moved: bool) -> _Place:
        """What the children of ``prim`` have from it, and it has itself."""
        from pxr import UsdGeom

        matrix, purpose = above.matrix, above.purpose
        if moved:
            local, resets = self._transforms.GetLocalTransformation(prim)
            matrix = np.array(local) if resets else np.array(local) @ matrix
            if not np.isfinite(matrix).all():
                raise ValueError(f"{prim.GetPath()}: transform with values that are not finite, must be finite")
        if prim.IsA(UsdGeom.Imageable):
            imageable = UsdGeom.Imageable(prim)
            purpose = imageable.ComputePurposeInfo(purpose) if purpose else imageable.ComputePurposeInfo()
        return _Place(matrix=matrix, purpose=purpose, told=above.told.and_by(prim, self._time))

    def _part(self, prim: Usd.Prim, place: _Place) -> list[Part]:
        """The prim's mesh, if it is drawn and has one."""
        from pxr import UsdGeom

        path = prim.GetPath()
        purpose = place.purpose.purpose if place.purpose else UsdGeom.Tokens.default_
        if purpose not in (UsdGeom.Tokens.default_, UsdGeom.Tokens.render):
            self.skipped.append(f"{path}: of purpose {purpose}")
            return []
        surface = self._surface(prim)
        if surface is None:
            self.skipped.append(f"{path}: a {prim.GetTypeName()} is no mesh")
            return []
        told = face_impedances(prim, self._time, place.told, surface.faces, self._conversion.impedance)
        return [
            Part(
                name=str(path),
                vertices=surface.vertices,
                winding=surface.winding,
                impedance=told.impedance[surface.face],
                impedances=_impedance_reports(told, surface.face),
                dropped=surface.dropped,
                polygons=surface.polygons,
                tangled=surface.tangled,
                subdivision=surface.subdivision,
                placements=place.matrix[None],
            )
        ]

    def _surface(self, prim: Usd.Prim) -> Surface | None:
        if not prim.IsInstanceProxy():
            return surface_of(prim, self._time, self._conversion)
        key = prim.GetPrimInPrototype().GetPath()
        if key not in self._of_prototype:
            self._of_prototype[key] = surface_of(prim, self._time, self._conversion)
        return self._of_prototype[key]

    def _instances(self, instancer: UsdGeom.PointInstancer, place: _Place, within: tuple[Sdf.Path, ...]) -> list[Part]:
        """Meshes of a point instancer's prototypes, each with its copies."""
        from pxr import UsdGeom

        path = instancer.GetPath()
        if path in within:
            raise ValueError(f"{path}: prototypes: hold the instancer itself, must not")
        targets = instancer.GetPrototypesRel().GetForwardedTargets()
        index = integers(instancer.GetProtoIndicesAttr(), self._time)
        check_indices(f"{path}: protoIndices", index, len(targets))
        for attribute in (
            instancer.GetPositionsAttr(),
            instancer.GetOrientationsAttr(),
            instancer.GetOrientationsfAttr(),
            instancer.GetScalesAttr(),
            instancer.GetIdsAttr(),
        ):
            given = np.shape(attribute.Get(self._time) or [])[:1]
            is_needed = attribute.GetName() == UsdGeom.Tokens.positions
            if given != (len(index),) and (is_needed or given != (0,)):
                raise ValueError(
                    f"{path}: {attribute.GetName()}: {sum(given)} entries, must be the {len(index)} of protoIndices"
                )
        shown = np.array(instancer.ComputeMaskAtTime(self._time) or np.ones(len(index)), dtype=bool)
        matrices = np.array(instancer.ComputeInstanceTransformsAtTime(self._time, self._time)).reshape(-1, 4, 4)
        if len(shown) != len(index) or len(matrices) != np.count_nonzero(shown):
            raise ValueError(f"{path}: {len(matrices)} transforms for {len(index)} protoIndices, must be as many")
        index, matrices = index[shown], matrices @ place.matrix
        parts = []
        for prototype in np.unique(index):
            prim = instancer.GetPrim().GetStage().GetPrimAtPath(targets[prototype])
            if not prim:
                raise ValueError(f"{path}: prototypes: no prim at {targets[prototype]}")
            # The transform of the prototype itself is in those of its instances.
            above = replace(place, matrix=np.eye(4))
            copies = matrices[index == prototype]
            for part in self.parts(prim, above, moved=False, within=(*within, path)):
                check_face_count(part.faces * len(copies))
                part.placements = (part.placements[None] @ copies[:, None]).reshape(-1, 4, 4)
                parts.append(part)
        return parts


def _impedance_reports(told: FaceImpedances, face: np.ndarray) -> tuple[ImpedanceReport, ...]:
    """What the triangles of faces ``face`` [triangle] have, by source."""
    reports = []
    for number, source in enumerate(told.sources):
        values = told.impedance[face][told.source[face] == number]
        if len(values):
            lowest, highest = float(values.min()), float(values.max())
            reports.append(ImpedanceReport(source=source, faces=len(values), lowest=lowest, highest=highest))
    return tuple(reports)
