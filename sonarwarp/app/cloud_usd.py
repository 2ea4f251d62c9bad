"""Clouds and the ways of the sonars that saw them, as OpenUSD files."""

# pyright: reportAttributeAccessIssue=false
# OpenUSD fills its modules when they load, where no type checker sees it.

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sonarwarp.cloud import NORMAL, PointCloud
from sonarwarp.survey import Survey, by_trajectory
from sonarwarp_scenes import Trajectory
from sonarwarp_scenes.usd_stage import add_curves, add_moving, extent, new_stage, save, set_times

if TYPE_CHECKING:
    from pxr import Sdf, Usd

# Five colours of matplotlib's viridis (CC0), dark to bright; OpenUSD's colours are linear in light, these are not.
_VIRIDIS = np.array([[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]]) / 255.0
_GAMMA = 2.2
_NO_VALUE = (0.2, 0.2, 0.2)
_TRACK_COLOUR = (0.90, 0.45, 0.10)

# Arms of the cross that marks a sonar: forward, left, up [m].
_ARMS = np.array([[0.4, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 0.2]])


def sonar_tracks(survey: Survey) -> dict[str, Trajectory]:
    """Ways of all sonars of a survey: ``fls_0`` and ``ps_0`` for its first trajectory, and so on.

    Poses are world_from_sensor, at the times of the frames and pings; of the profiling sonar before its head's turn.
    """
    tracks = {}
    for name, instants in (("fls", survey.frames), ("ps", survey.pings)):
        for index, rows in enumerate(by_trajectory(instants.trajectory)):
            if len(rows):
                tracks[f"{name}_{index}"] = Trajectory(times=instants.time[rows], poses=instants.pose[rows])
    return tracks


def write_cloud_usd(
    path: str | Path,
    cloud: PointCloud,
    *,
    colour_by: str | None = None,
    width: float = 0.02,
    tracks: Mapping[str, Trajectory] | None = None,
) -> None:
    """Write a cloud and the ways of sonars as an OpenUSD stage, in metres with z up.

    ``/World/Cloud`` holds the points, and every attribute as a primvar of its name with one value per point. Those of
    ``cloud.NORMAL``, where the cloud has all three, are the points' ``normals`` instead, zero where not known. Points,
    normals and tracks' curves are rounded to single precision. Every track is a frame ``/World/Tracks/NAME`` with
    time-sampled translation and orientation in double precision, marked by a cross with its longest arm forward, and a
    curve ``/World/Paths/NAME``. Time code 0 is time 0.

    Args:
        path: the file: .usda (text), .usdc or .usd (binary). It is replaced in one step once all is written.
        cloud: the points.
        colour_by: attribute that colours the points, dark where low and bright where high; grey where not finite.
        width: diameter that points are drawn with [m].
        tracks: ways by name, such as from :func:`sonar_tracks`.

    Raises:
        ValueError: another suffix, no such attribute, a width that is not positive, or attributes or tracks whose names
            are one to OpenUSD, which knows letters, digits and underscores.
        OSError: the folder does not exist, may not be written, or its disk is full.
        ModuleNotFoundError: usd-core is not installed.
    """
    from pxr import UsdGeom

    path, tracks = Path(path), tracks or {}
    if not (math.isfinite(width) and width > 0.0):
        raise ValueError(f"width: {width} m, must be positive and finite")
    if colour_by is not None and colour_by not in cloud.attributes:
        raise ValueError(f"colour_by: {colour_by!r}, must be one of {', '.join(cloud.attributes) or 'no attributes'}")
    stage = new_stage("Points and the ways of the sonars that saw them.")
    world = stage.GetDefaultPrim().GetPath()
    _add_cloud(stage, world.AppendChild("Cloud"), cloud, colour_by, width)
    frames, curves = world.AppendChild("Tracks"), world.AppendChild("Paths")
    if tracks:
        start = min(float(track.times[0]) for track in tracks.values())
        set_times(stage, start, max(float(track.times[-1]) for track in tracks.values()))
        UsdGeom.Scope.Define(stage, frames)
        UsdGeom.Scope.Define(stage, curves)
    for name, prim_name in _identifiers("tracks", tracks).items():
        _add_track(stage, frames.AppendChild(prim_name), tracks[name])
        if len(tracks[name].poses) > 1:
            add_curves(stage, curves.AppendChild(prim_name), [tracks[name].poses[:, :3]], _TRACK_COLOUR)
    save(stage, path)


def _identifiers(kind: str, names: Mapping[str, object]) -> dict[str, str]:
    """Each name to what OpenUSD may call it."""
    from pxr import Tf

    valid = {name: Tf.MakeValidIdentifier(name) for name in names}
    owner: dict[str, str] = {}
    for name, identifier in valid.items():
        if owner.setdefault(identifier, name) != name:
            raise ValueError(f"{kind}: {owner[identifier]!r} and {name!r} are both {identifier} in OpenUSD: rename one")
    return valid


def _add_cloud(stage: Usd.Stage, path: Sdf.Path, cloud: PointCloud, colour_by: str | None, width: float) -> None:
    from pxr import UsdGeom, Vt

    prim = UsdGeom.Points.Define(stage, path)
    points = np.asarray(cloud.points).astype(np.float32)
    prim.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(points)))
    prim.CreateWidthsAttr([width])
    prim.SetWidthsInterpolation(UsdGeom.Tokens.constant)
    if len(points):
        prim.CreateExtentAttr(extent(points, 0.5 * width))
    if colour_by is not None:
        colour = prim.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex)
        colour.Set(Vt.Vec3fArray.FromNumpy(_colours(cloud.attributes[colour_by])))
    attributes = dict(cloud.attributes)
    if attributes.keys() >= set(NORMAL):
        normals = np.stack([attributes.pop(name) for name in NORMAL], axis=1).astype(np.float32)
        prim.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(normals))
        prim.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    primvars = UsdGeom.PrimvarsAPI(prim)
    for name, identifier in _identifiers("attributes", attributes).items():
        if identifier == "displayColor":
            raise ValueError(f"attributes: {name!r} is what OpenUSD calls the points' own colours: rename it")
        kind, values = _typed(name, attributes[name])
        primvars.CreatePrimvar(identifier, kind, UsdGeom.Tokens.vertex).Set(values)


def _typed(name: str, values: np.ndarray) -> tuple[Sdf.ValueTypeName, object]:
    """An attribute in the narrowest of OpenUSD's types that holds it exactly."""
    from pxr import Sdf, Vt

    types = Sdf.ValueTypeNames
    if values.dtype.kind in "biu":
        if values.size == 0 or (values.min() >= -(2**31) and values.max() < 2**31):
            return types.IntArray, Vt.IntArray.FromNumpy(values.astype(np.int32))
        return types.Int64Array, Vt.Int64Array.FromNumpy(values.astype(np.int64))
    if values.dtype.kind != "f":
        raise ValueError(f"attributes[{name}]: dtype {values.dtype}, must be numbers")
    if values.dtype.itemsize <= 4:
        return types.FloatArray, Vt.FloatArray.FromNumpy(values.astype(np.float32))
    return types.DoubleArray, Vt.DoubleArray.FromNumpy(values.astype(np.float64))


def _colours(values: np.ndarray) -> np.ndarray:
    """A colour per value, float32, shape [value, 3]."""
    values = values.astype(np.float64)
    finite = np.isfinite(values)
    low, high = (values[finite].min(), values[finite].max()) if finite.any() else (0.0, 0.0)
    share = (values[finite] - low) / (high - low) if high > low else np.full(int(finite.sum()), 0.5)
    stops = np.linspace(0.0, 1.0, len(_VIRIDIS))
    colours = np.full((len(values), 3), _NO_VALUE)
    colours[finite] = np.stack([np.interp(share, stops, channel) for channel in _VIRIDIS.T], axis=1) ** _GAMMA
    return colours.astype(np.float32)


def _add_track(stage: Usd.Stage, path: Sdf.Path, track: Trajectory) -> None:
    add_moving(stage, path, track)
    add_curves(stage, path.AppendChild("Cross"), [np.stack([np.zeros(3), arm]) for arm in _ARMS], _TRACK_COLOUR)
