"""What an OpenUSD stage tells of its faces' acoustic impedance.

In this order, for each face of a mesh:

1. ``primvars:acousticImpedance`` of the mesh with uniform interpolation: a number per face [rayl];
2. ``sonarwarp:acoustic:impedance`` of a geometry subset that holds the face: one number;
3. the nearest of ``primvars:acousticImpedance`` with constant interpolation and ``sonarwarp:acoustic:impedance`` on the
   mesh or a prim above it; on one prim the primvar;
4. ``sonarwarp:acoustic:impedance`` of the material bound to the face;
5. that material's name, where it mentions one of :data:`~sonarwarp_scenes.MATERIALS`;
6. the same of the subset's name, the mesh's, or the nearest above it;
7. the default of whoever reads.
"""

# pyright: reportAttributeAccessIssue=false
# OpenUSD fills its modules when they load, where no type checker sees it.

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sonarwarp_scenes.conversion import check_impedance, check_indices
from sonarwarp_scenes.materials import material_in
from sonarwarp_scenes.usd_values import integers

if TYPE_CHECKING:
    from pxr import Usd, UsdGeom

IMPEDANCE_ATTRIBUTE = "sonarwarp:acoustic:impedance"
IMPEDANCE_PRIMVAR = "primvars:acousticImpedance"


class Answer(NamedTuple):
    """An impedance and where it came from."""

    impedance: float  # [rayl]
    source: str


@dataclass(frozen=True, kw_only=True)
class Told:
    """What a prim and those above it tell, the nearest first."""

    stated: Answer | None = None
    """By attribute or constant primvar."""

    named: Answer | None = None
    """By a name."""

    def and_by(self, prim: Usd.Prim, time: Usd.TimeCode) -> Told:
        """The same with what ``prim`` itself tells before it.

        Raises:
            ValueError: an impedance that is none.
        """
        if prim.IsPseudoRoot():
            return self
        return Told(stated=_stated_by(prim, time) or self.stated, named=_named_by(prim) or self.named)


class FaceImpedances(NamedTuple):
    """Impedance of each face of a prim."""

    impedance: np.ndarray  # [rayl], [face]
    source: np.ndarray  # index into sources, [face]
    sources: list[str]


def face_impedances(prim: Usd.Prim, time: Usd.TimeCode, told: Told, faces: int, default: float) -> FaceImpedances:
    """Impedance of each of a prim's ``faces``; ``told`` is by the prim itself and those above it.

    Raises:
        ValueError: an impedance that is none, or of another number of faces; names prim, attribute and bound.
    """
    from pxr import UsdGeom

    uniform = _uniform_primvar(prim, time, faces)
    if uniform is not None:
        return FaceImpedances(uniform, np.zeros(faces, dtype=np.int64), [f"{IMPEDANCE_PRIMVAR} of {prim.GetPath()}"])
    answer = told.stated or _by_material(prim, time) or told.named or Answer(default, "default")
    impedance, source, sources = np.full(faces, answer.impedance), np.zeros(faces, dtype=np.int64), [answer.source]
    for subset in UsdGeom.Subset.GetAllGeomSubsets(UsdGeom.Imageable(prim)):
        part = subset.GetPrim()
        answer = _stated_by(part, time)
        if answer is None and told.stated is None:
            answer = _by_material(part, time) or _named_by(part)
        if answer is None or subset.GetElementTypeAttr().Get() != UsdGeom.Tokens.face:
            continue
        chosen = integers(subset.GetIndicesAttr(), time)
        check_indices(f"{part.GetPath()}: indices", chosen, faces)
        impedance[chosen], source[chosen] = answer.impedance, len(sources)
        sources.append(answer.source)
    return FaceImpedances(impedance, source, sources)


def _stated_by(prim: Usd.Prim, time: Usd.TimeCode) -> Answer | None:
    from pxr import UsdGeom

    primvar = _primvar(prim)
    if primvar is not None and primvar.GetInterpolation() == UsdGeom.Tokens.constant:
        values = np.ravel(primvar.Get(time)) if primvar.HasValue() else []
        if len(values) != 1:
            raise ValueError(f"{prim.GetPath()}: {IMPEDANCE_PRIMVAR}: {len(values)} values, must be 1 where constant")
        return _answer(prim, IMPEDANCE_PRIMVAR, values[0])
    attribute = prim.GetAttribute(IMPEDANCE_ATTRIBUTE)
    if attribute and attribute.HasValue():
        return _answer(prim, IMPEDANCE_ATTRIBUTE, attribute.Get(time))
    return None


def _answer(prim: Usd.Prim, name: str, value: object) -> Answer:
    place = f"{prim.GetPath()}: {name}"
    try:
        impedance = float(value)  # pyright: ignore[reportArgumentType]
    except (TypeError, ValueError):
        raise ValueError(f"{place}: {value}, must be one number [rayl]") from None
    check_impedance(place, impedance)
    return Answer(impedance, f"{name} of {prim.GetPath()}")


def _named_by(prim: Usd.Prim) -> Answer | None:
    material = material_in(prim.GetName())
    return Answer(material.impedance, f"name of {prim.GetPath()}: {material.name}") if material else None


def _by_material(prim: Usd.Prim, time: Usd.TimeCode) -> Answer | None:
    from pxr import UsdShade

    bound, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
    if not bound:
        return None
    return _stated_by(bound.GetPrim(), time) or _named_by(bound.GetPrim())


def _uniform_primvar(prim: Usd.Prim, time: Usd.TimeCode, faces: int) -> np.ndarray | None:
    """A number per face [face], or None where the prim has no such primvar."""
    from pxr import UsdGeom

    primvar = _primvar(prim)
    if primvar is None or primvar.GetInterpolation() == UsdGeom.Tokens.constant:
        return None
    place = f"{prim.GetPath()}: {IMPEDANCE_PRIMVAR}"
    if primvar.GetInterpolation() != UsdGeom.Tokens.uniform:
        raise ValueError(f"{place}: interpolation {primvar.GetInterpolation()}, must be constant or uniform")
    try:
        values = np.array(primvar.ComputeFlattened(time), dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"{place}: no list of numbers, must be one per face [rayl]") from None
    if values.shape != (faces,):
        raise ValueError(f"{place}: {values.size} values, must be one per face, {faces}")
    bound = np.finfo(np.float32)
    wrong = np.flatnonzero(~((values >= bound.tiny) & (values <= bound.max)))
    if wrong.size:
        check_impedance(f"{place}[{wrong[0]}]", float(values[wrong[0]]))
    return values


def _primvar(prim: Usd.Prim) -> UsdGeom.Primvar | None:
    from pxr import UsdGeom

    attribute = prim.GetAttribute(IMPEDANCE_PRIMVAR)
    return UsdGeom.Primvar(attribute) if attribute and attribute.IsAuthored() else None
