"""Small worlds for tests that cast rays: scenes and poses on a device, and images of them both ways."""

import math
from collections.abc import Sequence

import numpy as np
import trimesh
import warp as wp

from sonarwarp_kernels import echo, forming, keys, raycast
from sonarwarp_kernels.specs import Fan, SceneTable
from sonarwarp_scenes import BRICK, CONCRETE, SAND, TABLE_2, WATER, Extent, Roughness, Scene, flat_seabed, rough_seabed
from tests.reference import echo as oracle
from tests.reference.geometry import quaternion, sonar_rotation

AHEAD = Extent(x_min=-1.0, x_max=8.0, y_min=-2.5, y_max=2.5)


def brick_on_flat() -> Scene:
    return Scene.join(flat_seabed(AHEAD), BRICK.scene(CONCRETE).moved((4.0, 0.0, 0.0)))


def wedges_on_flat() -> Scene:
    wedge = TABLE_2[2].scene(CONCRETE)
    return Scene.join(flat_seabed(AHEAD), wedge.moved((3.6, -0.35, 0.0)), wedge.moved((4.2, 0.35, 0.0)))


def rough() -> Scene:
    """Nodes twice as dense as the default: a facet is then about as wide as a beam."""
    return rough_seabed(AHEAD, Roughness(spacing=0.0375))


def ball_on_flat() -> Scene:
    """A ball of facets as large as a few cells, with a fold at every edge."""
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.4)
    solid = Scene(vertices=ball.vertices, faces=ball.faces, impedance=np.full(len(ball.faces), CONCRETE))
    return Scene.join(flat_seabed(AHEAD), solid.moved((4.2, 0.1, 0.3)))


def vase_on_flat() -> Scene:
    """A vase of 24 sides, folded by 15 degrees from side to side and where it bulges."""
    height = np.linspace(0.0, 0.8, 21)
    radius = 0.14 + 0.08 * np.sin(6.25 * height)
    vase = trimesh.creation.revolve(np.stack([radius, height], axis=-1), sections=24)
    solid = Scene(vertices=vase.vertices, faces=vase.faces, impedance=np.full(len(vase.faces), CONCRETE))
    return Scene.join(flat_seabed(AHEAD), solid.moved((4.2, 0.0, 0.0)))


def rods_on_flat() -> Scene:
    """Rods of 1 cm, which stand between the beams' borders."""
    rods = []
    for index, y in enumerate(np.linspace(-0.4, 0.4, 5)):
        rod = box((0.005, 0.005, 0.4), CONCRETE)
        rods.append(rod.moved((3.6 + 0.1 * index, y, 0.4)))
    return Scene.join(flat_seabed(AHEAD), *rods)


def box(half: Sequence[float], impedance: float) -> Scene:
    """A closed box around the origin, normals outwards."""
    vertices = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * np.asarray(half)
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
    faces += [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    return Scene(vertices=vertices, faces=np.array(faces), impedance=np.full(12, impedance))


def plate(corners: Sequence[Sequence[float]], impedance: float = SAND) -> Scene:
    """Two triangles over four corners."""
    return Scene(vertices=np.asarray(corners), faces=np.array([[0, 1, 2], [0, 2, 3]]), impedance=np.full(2, impedance))


def wall(distance: float, half: float = 20.0, impedance: float = SAND) -> Scene:
    """A plate across x at ``distance`` [m], facing the origin."""
    corners = [[distance, half, -half], [distance, -half, -half], [distance, -half, half], [distance, half, half]]
    return plate(corners, impedance)


class World:
    """Scenes on a device; None is an empty one."""

    def __init__(self, device: str, *scenes: Scene | None):
        self.device = device
        self._meshes = [
            wp.Mesh(
                wp.array(scene.vertices, dtype=wp.vec3, device=device),
                wp.array(scene.faces.ravel(), dtype=int, device=device),
                bvh_constructor="sah",
            )
            if scene
            else None
            for scene in scenes
        ]
        impedance = [scene.impedance if scene else np.zeros(0, dtype=np.float32) for scene in scenes]
        self.first_face = np.cumsum([0, *map(len, impedance)])[:-1]
        self.impedance = np.concatenate([*impedance, [np.float32(1.0)]])
        self.table = SceneTable()
        self.table.mesh = wp.array([mesh.id if mesh else 0 for mesh in self._meshes], dtype=wp.uint64, device=device)
        self.table.first_face = wp.array(self.first_face, dtype=int, device=device)
        self.table.impedance = wp.array(self.impedance, dtype=float, device=device)
        self.table.water = WATER


def pose(position: Sequence[float], tilt: float = 0.0, yaw: float = 0.0, roll: float = 0.0) -> np.ndarray:
    """World from sensor, (x, y, z, qx, qy, qz, qw); angles in rad, tilt downwards."""
    return np.array([*position, *quaternion(sonar_rotation(roll, tilt, yaw))])


def wandering_poses(count: int, altitude: float, tilt_deg: float, seed: int = 1) -> np.ndarray:
    """Poses of a vehicle that rolls, pitches and strays, shape [frame, 7]: no outline keeps to a beam's border."""
    draw = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 6))
    return np.stack(
        [
            pose(
                (0.4 * x, 0.2 * y, altitude + 0.05 * z),
                tilt=math.radians(tilt_deg) + 0.02 * pitch,
                yaw=0.1 * yaw,
                roll=0.03 * roll,
            )
            for x, y, z, pitch, yaw, roll in draw
        ]
    )


class Frames:
    """Per-frame arrays on a world's device."""

    def __init__(self, world: World, poses: np.ndarray, scene: Sequence[int] | int = 0, numbers: Sequence[int] = ()):
        count = len(poses)
        self.count = count
        self.pose = wp.array(np.asarray(poses, dtype=np.float32), dtype=wp.transform, device=world.device)
        self.scene = wp.array(np.broadcast_to(scene, count).astype(np.int32), dtype=int, device=world.device)
        self.key = wp.zeros(count, dtype=wp.uint64, device=world.device)
        one = wp.array([1], dtype=wp.uint64, device=world.device)
        trajectory = wp.zeros(count, dtype=int, device=world.device)
        number = wp.array(numbers or list(range(count)), dtype=int, device=world.device)
        keys.frame_keys(one, one, trajectory, number, keys.FLS_FRAMES, self.key, device=world.device)


def scratch_for(fan: Fan, frames: int, device: str) -> forming.Scratch:
    scratch = forming.Scratch()
    for name, (shape, dtype) in forming.scratch_shapes(fan, frames).items():
        setattr(scratch, name, wp.zeros(shape, dtype=dtype, device=device))
    return scratch


def formed_counts(world: World, fan: Fan, frames: Frames, threads: int = 1) -> np.ndarray:
    """Integer sums of :func:`echo.form_echoes`, shape [frame, beam, bin]."""
    shape = (frames.count, fan.azimuth.shape[0], fan.range_edge.shape[0] - 1)
    counts = wp.full(shape, -1, dtype=int, device=world.device)
    scratch = scratch_for(fan, frames.count, world.device)
    echo.form_echoes(
        fan,
        world.table,
        frames.pose,
        frames.scene,
        frames.key,
        scratch,
        counts,
        device=world.device,
        threads=threads,
    )
    return counts.numpy()


def formed_image(world: World, fan: Fan, frames: Frames) -> np.ndarray:
    """Echo amplitudes of :func:`echo.form_echoes`, shape [frame, beam, bin]."""
    return formed_counts(world, fan, frames) / fan.fixed_point


def cast(world: World, frames: Frames, azimuth, elevation, cone: int, reach: float, threads: int = 1):
    """Arrays of :func:`raycast.cast_grid` on the device: range, face, normal."""
    shape = (frames.count, len(azimuth), len(elevation))
    distance = wp.zeros(shape, dtype=float, device=world.device)
    face = wp.zeros(shape, dtype=int, device=world.device)
    normal = wp.zeros(shape, dtype=wp.vec3, device=world.device)
    raycast.cast_grid(
        world.table,
        wp.array(azimuth, dtype=float, device=world.device),
        wp.array(elevation, dtype=float, device=world.device),
        cone,
        reach,
        frames.pose,
        frames.scene,
        distance,
        face,
        normal,
        device=world.device,
        threads=threads,
    )
    return distance, face, normal


def reference_image(world: World, fan: Fan, frames: Frames, columns: int = 256, rows: int = 256) -> np.ndarray:
    """Images of ``columns`` x ``rows`` rays a beam, jointly stratified, binned in float64."""
    range_edge = fan.range_edge.numpy().astype(np.float64)
    border = fan.column_azimuth.numpy().astype(np.float64)
    first = fan.first_column.numpy()
    beams = len(first)
    face_start = world.first_face[frames.scene.numpy()][:, None, None]
    rotation = frames.pose.numpy()[:, 3:].astype(np.float64)
    image = np.zeros((frames.count * beams, len(range_edge) - 1))
    grids = oracle.stratified_angles(
        border[first], border[first + fan.strips], fan.elevation_min, fan.elevation_max, columns, rows
    )
    for azimuth, elevation in grids:
        distance, face, normal = (
            array.numpy() for array in cast(world, frames, azimuth, elevation, fan.cone, float(range_edge[-1]), 2)
        )
        direction = oracle.beam_direction(azimuth[:, None], elevation, bool(fan.cone))
        cosine = np.einsum("fbei,fbei->fbe", normal, turned(rotation, direction))
        amplitude = oracle.echo_amplitude(
            fan.amplitude, world.impedance[face_start + face].astype(np.float64), WATER, distance, cosine
        )
        rays = (frames.count * beams, rows)
        image += oracle.binned(range_edge, distance.reshape(rays), amplitude.reshape(rays))
    return image.reshape(frames.count, beams, -1) / (columns * rows)


def turned(rotation: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Vectors [..., 3] turned by each quaternion [frame, 4], shape [frame, ..., 3]."""
    axis = rotation[:, None, None, :3]
    across = 2.0 * np.cross(axis, direction)
    return direction + rotation[:, None, None, 3:] * across + np.cross(axis, across)


def relative_error(image: np.ndarray, reference: np.ndarray) -> float:
    """RMS of the difference over RMS of the reference."""
    return float(np.sqrt(np.mean((image - reference) ** 2) / np.mean(reference**2)))
