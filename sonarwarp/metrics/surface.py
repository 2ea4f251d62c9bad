"""Accuracy, completeness and F-score of clouds against any mesh.

Completeness asks only for the surface that the sonars could see, :func:`visible_samples` of
:func:`sample_surface`; what several sonars see together is the union of their answers
(``sonarwarp.metrics.seen_samples``). A sample counts whole or not at all, as if met by a ray at its centre: how a
beam's width mixes surfaces is not asked.

Where one part of a scene is asked for, points that lie on the rest are left out: a seabed that is right says nothing of
the wreck on it. A point that lies on nothing counts against every part, since nobody can say which it was meant for;
so no method gains by scattering its errors towards the seabed.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from sonarwarp.checks import finite_array, in_range
from sonarwarp.sonar import FLS, PS
from sonarwarp_kernels import surface
from sonarwarp_kernels.launch import cpu_threads

# How much nearer a face has to be to hide a sample [m]: far over the rounding of a ray that grazes the sample's own
# face at some metres, far under anything that a sonar tells apart.
_CLEARANCE = 1e-3


@dataclass(frozen=True, kw_only=True)
class SonarView:
    """Angles [rad] and ranges [m] that a sonar covers, in its own frame.

    Raises:
        ValueError: an angle outside [-pi, pi], a range that is negative or infinite, a lower bound over its upper one.
    """

    azimuth_min: float
    """Right edge, positive to the left [rad]."""

    azimuth_max: float
    """Left edge [rad]."""

    elevation_min: float
    """Lower edge, positive upwards [rad]."""

    elevation_max: float
    """Upper edge [rad]."""

    range_min: float
    """Start of the window, slant range [m]."""

    range_max: float
    """End of the window, slant range [m]."""

    cone: bool = False
    """Whether a beam keeps y / r (a linear array's cone) instead of azimuth (the paper's fan)."""

    def __post_init__(self) -> None:
        for name in ("azimuth", "elevation"):
            in_range(f"{name}_min", getattr(self, f"{name}_min"), -math.pi, math.pi)
            in_range(f"{name}_max", getattr(self, f"{name}_max"), getattr(self, f"{name}_min"), math.pi)
        in_range("range_min", self.range_min, 0.0, 1e6)
        in_range("range_max", self.range_max, self.range_min, 1e6)

    @staticmethod
    def of(sonar: FLS | PS) -> SonarView:
        """What one frame of an FLS covers, or one ping of a PS in the frame of its turned head."""
        if isinstance(sonar, FLS):
            low, high = float(sonar.azimuth_edge[0]), float(sonar.azimuth_edge[-1])
            half, cone = sonar.half_elevation, sonar.cone
        else:
            high = math.radians(sonar.beamwidth_deg) / 2
            low, half, cone = -high, math.radians(sonar.fan_beamwidth_deg) / 2, True
        return SonarView(
            azimuth_min=low,
            azimuth_max=high,
            elevation_min=-half,
            elevation_max=half,
            range_min=float(sonar.range_edge[0]),
            range_max=float(sonar.range_edge[-1]),
            cone=cone,
        )


@dataclass(frozen=True, kw_only=True)
class SurfaceMetrics:
    """Figures of one cloud against the surface. ``None`` stands where a figure does not exist; that is a miss."""

    tolerance: float
    """Distance within which a point or a sample counts as met [m]."""

    counted: int
    """Points of the cloud that accuracy and precision are about."""

    accuracy_mean: float | None
    """Mean distance from these points to the surface [m]; needs a point."""

    accuracy_rms: float | None
    """Root mean square of that distance [m]."""

    accuracy_p95: float | None
    """95th percentile of that distance [m]."""

    precision: float | None
    """Share of these points within tolerance of the surface."""

    completeness: float | None
    """Share of the visible samples with any point of the cloud within tolerance; needs a visible sample."""

    f_score: float | None
    """Harmonic mean of precision and completeness; 0 for a cloud without points."""


def sample_surface(vertices: ArrayLike, faces: ArrayLike, count: int, seed: int) -> np.ndarray:
    """Points spread over a mesh uniformly by area, stratified: one in each of ``count`` equal parts of the area.

    Args:
        vertices: corner positions [m], shape [vertex, 3].
        faces: vertex indices, shape [face, 3].
        count: number of points.
        seed: names the draw; the same seed gives the same points.

    Returns:
        Positions [m], float64, shape [count, 3].

    Raises:
        ValueError: an empty or broken mesh, no area, a count under 1.
    """
    corners, indices = _checked_mesh(vertices, faces)
    if count < 1:
        raise ValueError(f"count: {count}, must be at least 1")
    a, b, c = corners[indices].transpose(1, 0, 2)
    cumulative = np.cumsum(np.linalg.norm(np.cross(b - a, c - a), axis=1))
    if cumulative[-1] <= 0.0:
        raise ValueError(f"faces: all {len(indices)} have zero area, at least one must not")
    random = np.random.default_rng(seed)
    place = (np.arange(count) + random.random(count)) / count * cumulative[-1]
    face = np.minimum(np.searchsorted(cumulative, place, side="right"), len(indices) - 1)
    # A uniform point of a triangle: the root makes the distance from the first corner grow with the area behind it.
    root, along = np.sqrt(random.random((count, 1))), random.random((count, 1))
    return (1.0 - root) * a[face] + root * (1.0 - along) * b[face] + root * along * c[face]


def visible_samples(
    vertices: ArrayLike,
    faces: ArrayLike,
    samples: ArrayLike,
    view: SonarView,
    world_from_sensor: Sequence[ArrayLike],
    *,
    device: str | wp.Device | None = None,
    threads: int | None = None,
) -> np.ndarray:
    """Which surface samples each trajectory's sonar could see: in its view and first along the ray, from any pose.

    Args:
        vertices: corner positions of everything that can hide a sample [m], shape [vertex, 3].
        faces: vertex indices, shape [face, 3].
        samples: points on the surface [m], shape [sample, 3].
        view: what the sonar covers.
        world_from_sensor: for each trajectory its sonar's poses, position [m] and quaternion x, y, z, w, shape
            [frame, 7] each.
        device: where to compute.
        threads: CPU threads; all cores by default.

    Returns:
        Whether a sample could be seen, shape [trajectory, sample].

    Raises:
        ValueError: an empty or broken mesh, an array of another shape or not finite, a quaternion that is not unit.
    """
    device = wp.get_device(device)
    corners, indices = _checked_mesh(vertices, faces)
    wanted = finite_array("samples", samples, shape=(None, 3))
    poses = [
        finite_array(f"world_from_sensor[{index}]", each, shape=(None, 7))
        for index, each in enumerate(world_from_sensor)
    ]
    for index, each in enumerate(poses):
        length = np.linalg.norm(each[:, 3:], axis=1)
        if (np.abs(length - 1.0) > 1e-3).any():
            raise ValueError(f"world_from_sensor[{index}]: quaternion of length {length.flat[0]:g}, must be 1")
    shape = (len(poses), len(wanted))
    if 0 in shape:
        return np.zeros(shape, dtype=bool)
    origin = _origin(corners)
    mesh = _mesh(corners - origin, indices, device)
    frames = np.concatenate(poses) - np.append(origin, np.zeros(4))
    visible = wp.zeros(shape[0] * shape[1], dtype=int, device=device)
    kernel_view = surface.View()
    for field in fields(view):
        setattr(kernel_view, field.name, getattr(view, field.name))
    surface.visible_samples(
        wp.array([mesh.id] * len(poses), dtype=wp.uint64, device=device),
        kernel_view,
        wp.array(frames, dtype=wp.transform, device=device),
        wp.array(_firsts(poses), dtype=int, device=device),
        wp.array(np.tile(wanted - origin, (len(poses), 1)), dtype=wp.vec3, device=device),
        wp.array(np.repeat(np.arange(len(poses)), len(wanted)), dtype=int, device=device),
        _CLEARANCE,
        visible,
        device=device,
        threads=cpu_threads() if threads is None else threads,
    )
    return visible.numpy().reshape(shape) != 0


def evaluate_surface(
    vertices: ArrayLike,
    faces: ArrayLike,
    clouds: Sequence[ArrayLike],
    visible: Sequence[ArrayLike],
    *,
    tolerance: float,
    part: ArrayLike | None = None,
    device: str | wp.Device | None = None,
    threads: int | None = None,
) -> list[SurfaceMetrics]:
    """Accuracy, completeness and F-score of clouds of one scene, all in one batch.

    Args:
        vertices: corner positions of the whole scene [m], shape [vertex, 3].
        faces: vertex indices, shape [face, 3].
        clouds: each cloud's points [m], every emitted one, shape [point, 3] each.
        visible: for each cloud the surface samples that its sonars could see [m], shape [sample, 3] each.
        tolerance: distance within which a point or a sample counts as met [m].
        part: whether a face belongs to the part of the scene that is asked for, shape [face]; all do by default. A
            point is left out that lies on the rest: within tolerance of it, and nearer to it than to the part. Of all
            others the distance to the whole scene counts.
        device: where to compute.
        threads: CPU threads; all cores by default.

    Returns:
        One entry per cloud, in their order.

    Raises:
        ValueError: an empty or broken mesh, an array of another shape or not finite, another number of sample sets than
            of clouds, a tolerance that is not positive.
    """
    device = wp.get_device(device)
    threads = cpu_threads() if threads is None else threads
    corners, indices = _checked_mesh(vertices, faces)
    asked = np.ones(len(indices), dtype=bool) if part is None else checked_part(part, len(indices))
    if len(clouds) != len(visible):
        raise ValueError(f"visible: {len(visible)} sets of samples for {len(clouds)} clouds")
    if not (math.isfinite(tolerance) and tolerance > 0.0):
        raise ValueError(f"tolerance: {tolerance}, must be positive")
    origin = _origin(corners)
    corners = corners - origin
    points = [finite_array(f"clouds[{i}]", each, shape=(None, 3)) - origin for i, each in enumerate(clouds)]
    samples = [finite_array(f"visible[{i}]", each, shape=(None, 3)) - origin for i, each in enumerate(visible)]
    to_surface = [
        distance[asked[face] | (distance > tolerance)]
        for distance, face in _to_surface(corners, indices, points, device, threads)
    ]
    to_cloud = _to_cloud(points, samples, tolerance, device, threads)
    return [_metrics(a, b, tolerance) for a, b in zip(to_surface, to_cloud, strict=True)]


def surface_distances(
    vertices: ArrayLike, faces: ArrayLike, points: ArrayLike, *, device: str | wp.Device | None = None
) -> np.ndarray:
    """Distance of points to the nearest place of a surface [m], shape [point].

    Args:
        vertices: corner positions [m], shape [vertex, 3].
        faces: vertex indices, shape [face, 3].
        points: shape [point, 3] [m].
        device: where to compute.

    Raises:
        ValueError: an empty or broken mesh, an array of another shape or not finite.
    """
    corners, indices = _checked_mesh(vertices, faces)
    origin = _origin(corners)
    away = finite_array("points", points, shape=(None, 3)) - origin
    return _to_surface(corners - origin, indices, [away], wp.get_device(device), cpu_threads())[0][0]


def checked_part(part: ArrayLike, faces: int) -> np.ndarray:
    """A part of a mesh as booleans, shape [face].

    Raises:
        ValueError: another type or shape, or no face.
    """
    asked = np.asarray(part)
    if asked.dtype != bool or asked.shape != (faces,):
        raise ValueError(f"part: expected bool of shape ({faces},), got {asked.dtype} of {asked.shape}")
    if not asked.any():
        raise ValueError("part: no face, must be at least one")
    return asked


def _checked_mesh(vertices: ArrayLike, faces: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    corners = finite_array("vertices", vertices, shape=(None, 3))
    indices = np.asarray(faces)
    if indices.ndim != 2 or indices.shape[1] != 3 or indices.dtype.kind not in "iu":
        raise ValueError(f"faces: expected integers of shape (any, 3), got {indices.dtype} of {indices.shape}")
    if not len(indices):
        raise ValueError("faces: none, must be at least one")
    if indices.min() < 0 or indices.max() >= len(corners):
        raise ValueError(f"faces: [{indices.min()}, {indices.max()}] name vertices outside [0, {len(corners) - 1}]")
    return corners, indices.astype(np.int32)


def _origin(corners: np.ndarray) -> np.ndarray:
    """Middle of the mesh: float32 in a kernel resolves micrometres near 0 and millimetres at 10 km."""
    return 0.5 * (corners.min(axis=0) + corners.max(axis=0))


def _mesh(corners: np.ndarray, indices: np.ndarray, device: wp.Device) -> wp.Mesh:
    return wp.Mesh(
        points=wp.array(corners, dtype=wp.vec3, device=device),
        indices=wp.array(indices.ravel(), dtype=int, device=device),
        bvh_constructor="sah",
    )


def _firsts(parts: Sequence[np.ndarray]) -> list[int]:
    """Where each part begins when all stand in one row, and the end of the last."""
    return list(itertools.accumulate((len(part) for part in parts), initial=0))


def _row(parts: Sequence[np.ndarray], device: wp.Device) -> tuple[wp.array, wp.array]:
    """All parts in one row, and the part that each entry belongs to."""
    owner = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    return (
        wp.array(np.concatenate(parts), dtype=wp.vec3, device=device),
        wp.array(owner, dtype=int, device=device),
    )


def _to_surface(
    corners: np.ndarray, indices: np.ndarray, points: Sequence[np.ndarray], device: wp.Device, threads: int
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Distance of each cloud point to the surface [m] and the face that is nearest, shape [point] each, per cloud."""
    firsts = _firsts(points)
    if not firsts[-1]:
        return [(np.zeros(0), np.zeros(0, dtype=int)) for _ in points]
    mesh = _mesh(corners, indices, device)
    row, owner = _row(points, device)
    everything = np.concatenate([corners, *points])
    distance = wp.zeros(firsts[-1], dtype=float, device=device)
    face = wp.zeros(firsts[-1], dtype=int, device=device)
    surface.surface_points(
        wp.array([mesh.id] * len(points), dtype=wp.uint64, device=device),
        row,
        owner,
        # No nearest point is farther than the box around everything is long; the margin covers its own rounding.
        1.01 * float(np.linalg.norm(np.ptp(everything, axis=0))) + 1e-3,
        distance,
        wp.zeros(firsts[-1], dtype=wp.vec3, device=device),
        face,
        device=device,
        threads=threads,
    )
    distances = np.split(distance.numpy().astype(np.float64), firsts[1:-1])
    return list(zip(distances, np.split(face.numpy(), firsts[1:-1]), strict=True))


def _to_cloud(
    points: Sequence[np.ndarray], samples: Sequence[np.ndarray], tolerance: float, device: wp.Device, threads: int
) -> list[np.ndarray]:
    """Distance of each sample to its cloud [m], infinite beyond the tolerance, shape [sample] per cloud."""
    firsts = _firsts(samples)
    if not firsts[-1]:
        return [np.zeros(0) for _ in samples]
    row, owner = _row(samples, device)
    first_point = _firsts(points)
    cloud, _ = _row(points, device)
    grids = [_grid(each, tolerance, device) if len(each) else None for each in points]
    distance = wp.zeros(firsts[-1], dtype=float, device=device)
    surface.cloud_distances(
        wp.array([0 if grid is None else grid.id for grid in grids], dtype=wp.uint64, device=device),
        cloud,
        wp.array(first_point[:-1], dtype=int, device=device),
        row,
        owner,
        tolerance,
        distance,
        device=device,
        threads=threads,
    )
    return np.split(distance.numpy().astype(np.float64), firsts[1:-1])


def _grid(points: np.ndarray, cell: float, device: wp.Device) -> wp.HashGrid:
    """Hash grid over a cloud; no larger than the cloud needs, since a batch has one for each."""
    cells = np.clip(np.ceil(np.ptp(points, axis=0) / cell), 4, 128).astype(int)
    grid = wp.HashGrid(*cells.tolist(), device=device)
    grid.build(wp.array(points, dtype=wp.vec3, device=device), cell)
    return grid


def _metrics(to_surface: np.ndarray, to_cloud: np.ndarray, tolerance: float) -> SurfaceMetrics:
    mean = rms = p95 = precision = completeness = f_score = None
    if len(to_surface):
        mean = float(np.mean(to_surface))
        rms = float(np.sqrt(np.mean(to_surface**2)))
        p95 = float(np.percentile(to_surface, 95.0))
        precision = float(np.mean(to_surface <= tolerance))
    if len(to_cloud):
        completeness = float(np.mean(np.isfinite(to_cloud)))
        both = (precision or 0.0) + completeness
        f_score = 2.0 * (precision or 0.0) * completeness / both if both > 0.0 else 0.0
    return SurfaceMetrics(
        tolerance=tolerance,
        counted=len(to_surface),
        accuracy_mean=mean,
        accuracy_rms=rms,
        accuracy_p95=p95,
        precision=precision,
        completeness=completeness,
        f_score=f_score,
    )
