"""Scenes and deployments as OpenUSD files.

OpenUSD keeps points in single precision, as kernels do: the file holds what a device would get of the scene, bit for
bit.
"""

# pyright: reportAttributeAccessIssue=false
# OpenUSD fills its modules when they load, where no type checker sees it.

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sonarwarp_scenes.checks import check_positive, read_only
from sonarwarp_scenes.deployments import Deployment
from sonarwarp_scenes.materials import SAND
from sonarwarp_scenes.scene import Scene
from sonarwarp_scenes.trajectories import Trajectory
from sonarwarp_scenes.usd_impedance import IMPEDANCE_ATTRIBUTE, IMPEDANCE_PRIMVAR
from sonarwarp_scenes.usd_stage import (
    add_curves,
    add_moving,
    add_still,
    extent,
    free_path,
    new_stage,
    save,
    set_times,
)
from sonarwarp_scenes.usd_track import FRAMES_FROM_ATTRIBUTE

if TYPE_CHECKING:
    from pxr import Sdf, Usd

_SAND_COLOUR = (0.76, 0.66, 0.45)
_OBJECT_COLOUR = (0.45, 0.47, 0.50)
_BEAM_COLOUR = (0.10, 0.65, 0.85)
_RUN_COLOUR = (0.90, 0.45, 0.10)

# Corners of an outline's arc.
_ARC = 9


@dataclass(frozen=True, kw_only=True)
class SonarOutline:
    """What of a sonar is drawn on the vehicle: the edges of the space that it looks into.

    Raises:
        ValueError: a pose of another shape, an angle outside (0, pi/2], or a range that is not positive or not over the
            lower.
    """

    name: str
    """Name of its prim."""

    vehicle_from_sensor: tuple[float, ...]
    """Position x, y, z [m], then the unit quaternion x, y, z, w; x forward, y left, z up."""

    half_azimuth: float
    """Half the extent about the sensor's z axis [rad]."""

    half_elevation: float
    """Half the extent above and below its x-y plane [rad]."""

    range_min: float
    """[m]."""

    range_max: float
    """[m]."""

    def __post_init__(self) -> None:
        read_only("vehicle_from_sensor", self.vehicle_from_sensor, (7,))
        for name in ("half_azimuth", "half_elevation"):
            if not 0.0 < getattr(self, name) <= 0.5 * math.pi:
                raise ValueError(f"{name}: {getattr(self, name)} rad, must be over 0 and at most pi/2")
        check_positive("range_min", self.range_min)
        check_positive("range_max", self.range_max)
        if self.range_min >= self.range_max:
            raise ValueError(f"range_max: {self.range_max} m, must be over range_min of {self.range_min} m")

    def edges(self) -> list[np.ndarray]:
        """Polylines in the sensor's frame [m], each of shape [corner, 3]."""
        azimuths = np.linspace(-self.half_azimuth, self.half_azimuth, _ARC)
        elevations = np.linspace(-self.half_elevation, self.half_elevation, _ARC)
        ranges = np.array([self.range_min, self.range_max])
        edges = [_polar(ranges, a, e) for a in azimuths[[0, -1]] for e in elevations[[0, -1]]]
        edges += [_polar(r, azimuths, e) for r in ranges for e in elevations[[0, -1]]]
        return edges + [_polar(r, a, elevations) for r in ranges for a in azimuths[[0, -1]]]


def _polar(distance: np.ndarray, azimuth: np.ndarray, elevation: np.ndarray) -> np.ndarray:
    """Points [n, 3]; the arguments broadcast to [n]."""
    level = distance * np.cos(elevation)
    x, y, z = level * np.cos(azimuth), level * np.sin(azimuth), distance * np.sin(elevation)
    return np.stack(np.broadcast_arrays(x, y, z), axis=-1)


def write_scene(path: str | Path, scene: Scene, *, name: str = "Surface") -> None:
    """Write a scene as one OpenUSD mesh, in metres with z up.

    :func:`~sonarwarp_scenes.read_scene` gives the same triangles in the same order, with vertices as single precision
    holds them and impedances bit for bit, as long as its repair of windings finds nothing to turn and all triangles
    have an area.

    Args:
        path: the file: .usda (text), .usdc or .usd (binary). It is replaced in one step once all is written.
        scene: the scene.
        name: name of the mesh's prim; characters that prims' names cannot have become underscores.

    Raises:
        ValueError: another suffix, or a scene whose faces all lose their area in single precision.
        OSError: the folder does not exist, may not be written, or its disk is full.
        ModuleNotFoundError: usd-core is not installed.
    """
    stage = new_stage("Triangles with an acoustic impedance each.")
    _add_mesh(stage, stage.GetDefaultPrim().GetPath(), name, scene)
    save(stage, Path(path))


def write_deployment(path: str | Path, deployment: Deployment, *, sonars: Sequence[SonarOutline] = ()) -> None:
    """Write a deployment as an OpenUSD stage that viewers can play: seabed, objects, run, and the vehicle moving along.

    ``/World`` holds the meshes in the order of the scene's faces, the run as a curve, and ``Vehicle`` with time-sampled
    translation and orientation at the trajectory's poses, between which OpenUSD interpolates as ``Trajectory`` does.
    Time code 0 is time 0. The attribute ``sonarwarp:framesFrom`` [s] of ``Vehicle`` says when imaging may start, which
    :func:`~sonarwarp_scenes.read_frames_from` reads back. Below it stands every sonar with the outline of what it looks
    into.

    Args:
        path: as for :func:`write_scene`.
        deployment: the deployment.
        sonars: what the vehicle carries.

    Raises:
        ValueError: as for :func:`write_scene`.
        OSError: as for :func:`write_scene`.
        ModuleNotFoundError: usd-core is not installed.
    """
    from pxr import Sdf

    stage = new_stage(f"Deployment {deployment.name}.")
    world = stage.GetDefaultPrim().GetPath()
    for name, part in deployment.parts():
        _add_mesh(stage, world, name, part)
    trajectory = deployment.trajectory
    set_times(stage, float(trajectory.times[0]), float(trajectory.times[-1]))
    if len(trajectory.poses) > 1:
        add_curves(stage, free_path(stage, world, "Run"), [trajectory.poses[:, :3]], _RUN_COLOUR)
    vehicle = add_moving(stage, free_path(stage, world, "Vehicle"), trajectory)
    frames_from = vehicle.GetPrim().CreateAttribute(FRAMES_FROM_ATTRIBUTE, Sdf.ValueTypeNames.Double)
    frames_from.Set(deployment.frames_from)
    for sonar in sonars:
        here = free_path(stage, vehicle.GetPath(), sonar.name)
        still = Trajectory(times=np.zeros(1), poses=np.array([sonar.vehicle_from_sensor]))
        add_still(stage, here, still.poses[0])
        add_curves(stage, here.AppendChild("Beam"), sonar.edges(), _BEAM_COLOUR)
    save(stage, Path(path))


def _add_mesh(stage: Usd.Stage, parent: Sdf.Path, name: str, scene: Scene) -> None:
    from pxr import Sdf, UsdGeom, Vt

    # What single precision leaves without an area is refused here, not when it is read.
    scene = Scene(vertices=scene.vertices.astype(np.float32), faces=scene.faces, impedance=scene.impedance)
    mesh = UsdGeom.Mesh.Define(stage, free_path(stage, parent, name))
    points = scene.vertices.astype(np.float32)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(scene.faces), 3, dtype=np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(scene.faces.ravel()))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateExtentAttr(extent(points))
    first = float(scene.impedance[0])
    is_object = (scene.impedance != np.float32(SAND)).astype(np.int32)
    if (scene.impedance == first).all():
        mesh.CreateDisplayColorAttr([_OBJECT_COLOUR if is_object[0] else _SAND_COLOUR])
        mesh.GetPrim().CreateAttribute(IMPEDANCE_ATTRIBUTE, Sdf.ValueTypeNames.Float).Set(first)
        return
    colour = mesh.CreateDisplayColorPrimvar(UsdGeom.Tokens.uniform)
    colour.Set([_SAND_COLOUR, _OBJECT_COLOUR])
    colour.SetIndices(Vt.IntArray.FromNumpy(is_object))
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        IMPEDANCE_PRIMVAR.removeprefix("primvars:"), Sdf.ValueTypeNames.FloatArray, UsdGeom.Tokens.uniform
    )
    primvar.Set(Vt.FloatArray.FromNumpy(scene.impedance))
