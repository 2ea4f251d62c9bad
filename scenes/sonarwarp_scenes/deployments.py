"""Whole experiments: what lies on the seabed, and the run over it.

The first front is at x = 0. Runs head along +x at constant altitude over y = 0. The profiling sonar records from the
start of the run; the imaging sonar needs to only from ``frames_from`` on, which spares 32 to 44 % of its frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sonarwarp_scenes.burial import bury
from sonarwarp_scenes.checks import check_positive
from sonarwarp_scenes.materials import CONCRETE
from sonarwarp_scenes.scene import Scene
from sonarwarp_scenes.seabed import Extent, Roughness, flat_seabed, rough_seabed
from sonarwarp_scenes.shapes import BRICK, FOOT, PlacedObject, Shape, Wedge
from sonarwarp_scenes.trajectories import Trajectory, straight_trajectory

# A run starts this far before the first front: a later start leaves the slow profiling sonar of the field test too few
# pings [m].
APPROACH = 9.0

# A run ends this far past the last object [m].
OVERRUN = 1.0

# An imaging sonar looks for objects nearer than where its lower edge meets the seabed (Eq. 5-6). No object of the paper
# comes inside that range before the vehicle is within 4.1 m of it (a top of 1 m, seen from 3.5 m at a tilt of 40
# degrees) [m].
IMAGING_DISTANCE = 4.5

# The seabed goes on for what the sonars see: the profiling sonar 10 m ahead with a fan of +-10 degrees; behind the
# start only what a steep ray meets [m].
_SEABED_BEHIND = 2.0
_SEABED_AHEAD = 12.0
_SEABED_HALF_WIDTH = 3.0

_ROUGH = Roughness()


@dataclass(frozen=True, kw_only=True, eq=False)
class Deployment:
    """A scene, what is known to lie in it, and a run over it.

    Raises:
        ValueError: ``frames_from`` outside the run, or bodies without faces or with more than the scene has.
    """

    name: str
    """Name in results."""

    scene: Scene
    """Seabed and objects, world frame."""

    objects: tuple[PlacedObject, ...]
    """Objects that results are compared with; empty where only the surface is known."""

    trajectory: Trajectory
    """The vehicle's run."""

    frames_from: float
    """Time from which the imaging sonar needs to record [s]."""

    bodies: tuple[tuple[str, int], ...] = ()
    """Name and number of faces of each body on the seabed: the scene's last faces, in this order."""

    def __post_init__(self) -> None:
        sizes = [size for _, size in self.bodies]
        if sizes and (min(sizes) < 1 or sum(sizes) >= len(self.scene.faces)):
            raise ValueError(f"bodies: {sizes} faces, must be at least 1 each, and some left for the seabed")
        start, end = self.trajectory.times[0], self.trajectory.times[-1]
        if not start <= self.frames_from <= end:
            raise ValueError(f"frames_from: {self.frames_from} s, must be within the run, {start} to {end} s")

    def parts(self) -> list[tuple[str, Scene]]:
        """The scene cut into ``Seabed`` and bodies, each with its name; one ``Surface`` where there are no bodies."""
        scene = self.scene
        sizes = [size for _, size in self.bodies]
        names = ["Seabed", *(name for name, _ in self.bodies)] if sizes else ["Surface"]
        cuts = np.cumsum([len(scene.faces) - sum(sizes), *sizes])[:-1]
        return [
            (name, _compact(scene.vertices, faces, impedance))
            for name, faces, impedance in zip(
                names, np.split(scene.faces, cuts), np.split(scene.impedance, cuts), strict=True
            )
        ]


def _compact(vertices: np.ndarray, faces: np.ndarray, impedance: np.ndarray) -> Scene:
    """Some faces of a scene, without the vertices before the first and after the last of theirs."""
    low, high = int(faces.min()), int(faces.max())
    return Scene(vertices=vertices[low : high + 1], faces=faces - low, impedance=impedance)


def brick_deployment(
    *,
    roughness: Roughness | None = None,
    altitude: float = 1.8,
    speed: float = 0.05,
    imaging_distance: float = IMAGING_DISTANCE,
) -> Deployment:
    """The field test: a concrete brick on the seabed (paper, section 3.3), its front at x = 0.

    Args:
        roughness: of the seabed; None is flat.
        altitude: of the vehicle over the mean seabed [m]. Paper, section 3.3.
        speed: of the vehicle [m/s]. Ours: the paper is silent.
        imaging_distance: from the vehicle to the first front where the imaging sonar starts to record [m].

    Raises:
        ValueError: a value that is not positive, or a seabed that dips below the object's foot.
    """
    brick = PlacedObject(name="brick", shape=BRICK, front_x=0.0, centre_y=0.0)
    return _object_deployment("brick", (brick,), roughness, altitude, speed, imaging_distance)


def slope_deployment(
    shape: Wedge,
    *,
    roughness: Roughness | None = None,
    altitude: float = 2.5,
    speed: float = 0.1,
    imaging_distance: float = IMAGING_DISTANCE,
) -> Deployment:
    """One object of the series over the front slope (paper, section 2.2, ``TABLE_1``), its front at x = 0.

    Args:
        shape: the object.
        roughness: of the seabed; None is flat.
        altitude: of the vehicle over the mean seabed [m]. Paper, section 2.2.
        speed: of the vehicle [m/s]. Ours: the paper is silent.
        imaging_distance: from the vehicle to the first front where the imaging sonar starts to record [m].

    Raises:
        ValueError: a value that is not positive, or a seabed that dips below the object's foot.
    """
    name = f"slope_{shape.front_slope_deg:g}"
    wedge = PlacedObject(name="wedge", shape=shape, front_x=0.0, centre_y=0.0)
    return _object_deployment(name, (wedge,), roughness, altitude, speed, imaging_distance)


def object_deployment(
    shape: Shape,
    *,
    name: str = "object",
    roughness: Roughness | None = _ROUGH,
    altitude: float = 2.5,
    speed: float = 0.1,
    imaging_distance: float = 5.5,
) -> Deployment:
    """Any shape with closed forms, alone, its front at x = 0.

    Args:
        shape: the object.
        name: name in results, of the deployment and of the object.
        roughness: of the seabed; None is flat.
        altitude: of the vehicle over the mean seabed [m].
        speed: of the vehicle [m/s].
        imaging_distance: from the vehicle to the front where the imaging sonar starts to record [m]; as for meshes.

    Raises:
        ValueError: a value that is not positive, an altitude at which the vehicle would run into the object, or a
            seabed that dips to :data:`FOOT` under the base plane.
    """
    if not altitude > shape.height:
        raise ValueError(f"altitude: {altitude} m, must be over the object's top at {shape.height:.3f} m")
    placed = PlacedObject(name=name, shape=shape, front_x=0.0, centre_y=0.0)
    return _object_deployment(name, (placed,), roughness, altitude, speed, imaging_distance)


def pair_deployment(
    shape: Wedge,
    arrangement: Literal["aligned", "misaligned"],
    *,
    roughness: Roughness | None = None,
    altitude: float = 3.5,
    speed: float = 0.1,
    imaging_distance: float = IMAGING_DISTANCE,
) -> Deployment:
    """Two equal objects side by side (paper, section 3.1, ``TABLE_2``): the first at y = -0.35 m, the second at 0.35 m.

    Args:
        shape: both objects.
        arrangement: "aligned", both fronts at x = 0; "misaligned", the second 1 m further away. Ours: the paper shows
            a figure and gives no distances.
        roughness: of the seabed; None is flat.
        altitude: of the vehicle over the mean seabed [m]. Ours: both objects lie inside the imaging sonar's swath.
        speed: of the vehicle [m/s]. Ours: the paper is silent.
        imaging_distance: from the vehicle to the first front where the imaging sonar starts to record [m].

    Raises:
        ValueError: another arrangement, a value that is not positive, or a seabed that dips below the objects' feet.
    """
    if arrangement not in ("aligned", "misaligned"):
        raise ValueError(f"arrangement: {arrangement!r}, must be 'aligned' or 'misaligned'")
    name = f"pair_{shape.front_slope_deg:g}_{arrangement}"
    first = PlacedObject(name="first", shape=shape, front_x=0.0, centre_y=-0.35)
    second = PlacedObject(name="second", shape=shape, front_x=0.0 if arrangement == "aligned" else 1.0, centre_y=0.35)
    return _object_deployment(name, (first, second), roughness, altitude, speed, imaging_distance)


def mesh_deployment(
    mesh: Scene,
    *,
    name: str = "mesh",
    roughness: Roughness | None = _ROUGH,
    altitude: float | None = None,
    speed: float = 0.1,
    imaging_distance: float = 5.5,
) -> Deployment:
    """Any mesh, half-buried: its lowest x at x = 0, the middle of its height at the mean seabed, and what of it is over
    the seabed centred on y = 0. Among the deployment's parts it is ``Mesh``.

    What is wider than the imaging sonar's swath (2.5 m at 5 m) is seen in part.

    Args:
        mesh: the mesh in metres, wherever it stands.
        name: name in results.
        roughness: of the seabed; None is flat.
        altitude: of the vehicle over the mean seabed [m]; None: 2.5 m, or 1.5 m over the mesh's top where that is more.
        speed: of the vehicle [m/s].
        imaging_distance: from the vehicle to the mesh where the imaging sonar starts to record [m]. Ours: over the
            reach of the paper's imaging sonar, 5.42 m, whatever its tilt.

    Raises:
        ValueError: a value that is not positive, or an altitude at which the vehicle would run into the mesh.
    """
    body = bury(mesh)
    length, _, top = body.bounds()[1]
    if altitude is None:
        altitude = max(2.5, top + 1.5)
    if not altitude > top:
        raise ValueError(f"altitude: {altitude} m, must be over the mesh's top at {top:.3f} m")
    return _deployment(name, [("Mesh", body)], (), length, roughness, altitude, speed, imaging_distance)


def _object_deployment(
    name: str,
    objects: tuple[PlacedObject, ...],
    roughness: Roughness | None,
    altitude: float,
    speed: float,
    imaging_distance: float,
) -> Deployment:
    bodies = [(item.name, item.scene(CONCRETE)) for item in objects]
    last_back = max(item.back_x for item in objects)
    return _deployment(name, bodies, objects, last_back, roughness, altitude, speed, imaging_distance)


def _deployment(
    name: str,
    bodies: Sequence[tuple[str, Scene]],
    objects: tuple[PlacedObject, ...],
    last_back: float,
    roughness: Roughness | None,
    altitude: float,
    speed: float,
    imaging_distance: float,
) -> Deployment:
    """``bodies`` on a seabed under a run from ``APPROACH`` before x = 0 to ``OVERRUN`` past ``last_back`` [m]."""
    check_positive("altitude", altitude)
    check_positive("imaging_distance", imaging_distance)
    start, end = -APPROACH, last_back + OVERRUN
    extent = Extent(
        x_min=start - _SEABED_BEHIND,
        x_max=end + _SEABED_AHEAD,
        y_min=-_SEABED_HALF_WIDTH,
        y_max=_SEABED_HALF_WIDTH,
    )
    seabed = flat_seabed(extent) if roughness is None else rough_seabed(extent, roughness)
    lowest = float(np.min(seabed.vertices[:, 2]))
    if objects and lowest <= -FOOT:
        raise ValueError(
            f"roughness: the seabed dips to {lowest:.3f} m, must stay over the objects' feet at {-FOOT} m: "
            "lower rms_height"
        )
    return Deployment(
        name=name,
        scene=Scene.join(seabed, *(body for _, body in bodies)),
        objects=objects,
        bodies=tuple((each, len(body.faces)) for each, body in bodies),
        trajectory=straight_trajectory((start, 0.0, altitude), heading=0.0, speed=speed, length=end - start),
        frames_from=max(0.0, APPROACH - imaging_distance) / speed,
    )
