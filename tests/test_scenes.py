"""Scenes: the paper's objects and runs as printed, seabeds with the statistics that they state, refusals by name."""

import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Literal, NamedTuple, cast

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation, Slerp

import sonarwarp_scenes as scenes
from sonarwarp_scenes import (
    BRICK,
    FOOT,
    TABLE_1,
    TABLE_2,
    Deployment,
    Extent,
    PlacedObject,
    Roughness,
    Scene,
    Trajectory,
    Wedge,
)

TRIANGLE = {"vertices": np.eye(3), "faces": np.array([[0, 1, 2]]), "impedance": np.array([5e6])}
LEVEL = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]


def as_mesh(scene: Scene) -> trimesh.Trimesh:
    return trimesh.Trimesh(scene.vertices, scene.faces, process=False)


def heights(extent: Extent, roughness: Roughness) -> np.ndarray:
    """Heights of a rough seabed's nodes, [nx, ny]."""
    vertices = scenes.rough_seabed(extent, roughness).vertices
    return vertices[:, 2].reshape(-1, len(np.unique(vertices[:, 1])))


def test_the_package_brings_numpy_only():
    code = "import sonarwarp_scenes, sys; print([m for m in ('warp', 'trimesh', 'pxr', 'scipy') if m in sys.modules])"
    result = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": str(Path(scenes.__file__).parents[1])},
        capture_output=True,
        text=True,
        check=True,
    )
    assert result.stdout.strip() == "[]"


# Scene


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"vertices": np.zeros((0, 3))}, "vertices: empty"),
        ({"vertices": np.zeros((3, 2))}, r"vertices: expected shape \[any, 3\], got \[3, 2\]"),
        ({"vertices": "corner"}, "vertices: not an array of numbers"),
        ({"vertices": np.diag([1.0, np.nan, 1.0])}, r"vertices: nan at \[1, 1\], must be finite"),
        ({"vertices": 4e6 * np.eye(3)}, "vertices: coordinate of 4e\\+06 m, must be within 10000 m"),
        ({"vertices": np.ones((3, 3))}, "faces: all 1 have zero area"),
        ({"vertices": np.arange(3.0)[:, None] * np.ones(3)}, "faces: all 1 have zero area"),
        ({"faces": np.zeros((0, 3), int)}, "faces: empty"),
        ({"faces": np.array([0, 1, 2])}, r"faces: expected shape \[any, 3\], got \[3\]"),
        ({"faces": np.array([[0.0, 1.0, 2.0]])}, "faces: dtype float64, must be integers"),
        ({"faces": np.array([[0, 1, 3]])}, r"faces: index 3 at face 0, must be in 0\.\.2"),
        ({"faces": np.array([[0, 1, -1]])}, r"faces: index -1 at face 0, must be in 0\.\.2"),
        ({"faces": np.array([[0, 1, 2**32]])}, f"faces: index {2**32} at face 0"),
        ({"impedance": np.array([1e6, 1e6])}, r"impedance: expected shape \[1\], got \[2\]"),
        ({"impedance": np.array([0.0])}, "impedance: 0.0 at face 0, must be positive"),
        ({"impedance": np.array([-1.5e6])}, "impedance: -1500000.0 at face 0, must be positive"),
        ({"impedance": np.array([1e-50])}, "impedance: 1e-50 at face 0"),
        ({"impedance": np.array([1e50])}, r"impedance: 1e\+50 at face 0"),
        ({"impedance": np.array([np.inf])}, r"impedance: inf at \[0\], must be finite"),
    ],
)
def test_a_scene_that_kernels_would_misread_is_refused(changed, message):
    with pytest.raises(ValueError, match=message):
        Scene(**{**TRIANGLE, **changed})


def test_a_scene_keeps_its_own_arrays():
    vertices = np.eye(3)
    scene = Scene(**{**TRIANGLE, "vertices": vertices})
    vertices[0, 0] = 7.0
    assert scene.vertices[0, 0] == 1.0
    for array, dtype in ((scene.vertices, np.float64), (scene.faces, np.int32), (scene.impedance, np.float32)):
        assert array.dtype == dtype
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


def test_a_face_without_area_beside_one_with_area_passes():
    scene = Scene(vertices=np.eye(3), faces=np.array([[0, 0, 1], [0, 1, 2]]), impedance=np.ones(2))
    assert len(scene.faces) == 2


def test_joined_scenes_keep_their_triangles_and_impedances():
    parts = [
        BRICK.scene(1e6),
        BRICK.scene(2e6).moved((3.0, 0.0, 0.0)),
        scenes.flat_seabed(Extent(**SMALL), impedance=3e6),
    ]
    whole = Scene.join(*parts)
    first = 0
    for part in parts:
        last = first + len(part.faces)
        assert np.array_equal(whole.vertices[whole.faces[first:last]], part.vertices[part.faces])
        assert np.array_equal(whole.impedance[first:last], part.impedance)
        first = last
    assert first == len(whole.faces)
    with pytest.raises(ValueError, match="scenes: none given"):
        Scene.join()


def test_bounds_are_of_the_faces_only():
    scene = Scene(**{**TRIANGLE, "vertices": np.concatenate([np.eye(3), [[9.0, 9.0, 9.0]]])})
    assert np.array_equal(scene.bounds(), [[0, 0, 0], [1, 1, 1]])


# Files


def test_a_file_keeps_every_part_where_its_transforms_put_it(tmp_path):
    scene = trimesh.Scene()
    for x in (0.0, 5.0):
        scene.add_geometry(
            trimesh.creation.box((1, 2, 3)), transform=trimesh.transformations.translation_matrix([x, 0, 0])
        )
    scene.export(tmp_path / "boxes.glb")
    read = scenes.scene_from_file(tmp_path / "boxes.glb", scale=0.5, impedance=scenes.STEEL)
    assert len(read.faces) == 24
    assert np.allclose(read.bounds(), [[-0.25, -0.5, -0.75], [2.75, 0.5, 0.75]])
    assert set(read.impedance.tolist()) == {np.float32(scenes.STEEL)}
    # Two boxes, not one hull or one instance.
    assert as_mesh(read).volume == pytest.approx(2 * 6 * 0.5**3)


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply", "off"])
def test_a_brick_survives_every_common_format(tmp_path, suffix):
    path = tmp_path / f"brick.{suffix}"
    as_mesh(BRICK.scene(1e6)).export(path)
    read = as_mesh(scenes.scene_from_file(path))
    assert read.volume == pytest.approx(as_mesh(BRICK.scene(1e6)).volume, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("absent.stl", None, "path: no file at .*absent.stl"),
        ("broken.ply", b"ply\nformat ascii 1.0\nelement vertex", "path: cannot read .*broken.ply as a mesh: "),
        ("broken.glb", b"\x00" * 40, "path: cannot read .*broken.glb as a mesh: "),
        ("words.docx", b"words", "path: cannot read .*words.docx as a mesh: "),
        ("points.xyz", b"0 0 0\n1 0 0\n0 1 0\n", "path: .*points.xyz holds no triangles"),
        ("flat.obj", b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "path: .*flat.obj: faces: all 1 have zero area"),
    ],
)
def test_an_unusable_file_is_refused_in_one_line(tmp_path, name, content, message):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=message) as refusal:
        scenes.scene_from_file(tmp_path / name)
    assert "\n" not in str(refusal.value)


def test_a_mesh_in_millimetres_is_refused_until_it_is_scaled(tmp_path):
    trimesh.creation.box((30000.0, 1000.0, 1000.0)).export(tmp_path / "hull.stl")
    with pytest.raises(ValueError, match="scale to metres"):
        scenes.scene_from_file(tmp_path / "hull.stl")
    assert scenes.scene_from_file(tmp_path / "hull.stl", scale=1e-3).bounds()[1, 0] == pytest.approx(15.0)


# Shapes


@pytest.mark.parametrize(
    ("wedge", "slope", "area", "volume"),
    list(zip(TABLE_2, (30, 45, 60, 90), (2.13, 2.5, 2.71, 3.0), (1.07, 1.25, 1.36, 1.5), strict=True)),
)
def test_table_2_has_its_printed_areas_and_volumes(wedge, slope, area, volume):
    assert (wedge.width, wedge.height, wedge.depth, wedge.front_slope_deg) == (0.5, 1.0, 3.0, slope)
    # Half a unit of the last digit printed.
    assert wedge.sectional_area == pytest.approx(area, abs=0.005)
    assert wedge.volume == pytest.approx(volume, abs=0.005)


def test_table_1_and_the_brick_are_as_printed():
    sizes = [(wedge.front_slope_deg, wedge.width, wedge.height, wedge.depth) for wedge in TABLE_1]
    assert sizes == [(s, 0.5, 1.0, d) for s, d in ((90, 1.6), (80, 1.6), (60, 1.6), (45, 2.0), (30, 3.0), (20, 3.0))]
    assert (BRICK.width, BRICK.height, BRICK.depth) == (0.19, 0.39, 0.15)
    assert BRICK.sectional_area == pytest.approx(0.39 * 0.15)


@pytest.mark.parametrize("wedge", [*TABLE_1, *TABLE_2, BRICK])
def test_a_wedge_is_closed_and_holds_its_closed_form(wedge):
    mesh = as_mesh(wedge.scene(1e6))
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    # The body goes on below the base plane, where its section grows with the slope. A volume below zero is inside out.
    run = 1.0 / math.tan(math.radians(wedge.front_slope_deg))
    foot = wedge.width * FOOT * (wedge.depth + 0.5 * FOOT * run)
    assert mesh.volume == pytest.approx(wedge.volume + foot, rel=1e-12)
    assert np.allclose(mesh.bounds[:, 1], [-0.5 * wedge.width, 0.5 * wedge.width])
    assert np.allclose(mesh.bounds[:, 2], [-FOOT, wedge.height])


@pytest.mark.parametrize("wedge", [*TABLE_1, BRICK])
def test_the_front_is_one_plane_that_meets_the_seabed_at_the_foot(wedge):
    item = PlacedObject(name="it", shape=wedge, front_x=2.0, centre_y=-1.0)
    mesh = as_mesh(item.scene(1e6))
    slope = math.radians(wedge.front_slope_deg)
    front = np.flatnonzero(mesh.face_normals[:, 0] < -1e-6)
    assert len(front) == 2
    assert np.allclose(mesh.face_normals[front], [-math.sin(slope), 0.0, math.cos(slope)])
    corners = mesh.triangles[front].reshape(-1, 3) - [2.0, -1.0, 0.0]
    assert np.allclose(corners @ [-math.sin(slope), 0.0, math.cos(slope)], 0.0)
    assert item.back_x == mesh.bounds[1, 0]


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"width": 0.0}, "width: 0.0, must be positive and finite"),
        ({"height": -1.0}, "height: -1.0, must be positive"),
        ({"depth": math.inf}, "depth: inf, must be positive and finite"),
        ({"front_slope_deg": 0.0}, "front_slope_deg: 0.0, must be over 0 and at most 90"),
        ({"front_slope_deg": 91.0}, "front_slope_deg: 91.0"),
        ({"front_slope_deg": math.nan}, "front_slope_deg: nan"),
        ({"front_slope_deg": 15.0}, "depth: 3.0 m, must be over the 3.732 m"),
    ],
)
def test_a_wedge_that_cannot_be_is_refused(changed, message):
    with pytest.raises(ValueError, match=message):
        Wedge(**{"width": 0.5, "height": 1.0, "depth": 3.0, "front_slope_deg": 30.0, **changed})


def test_an_object_nowhere_is_refused():
    with pytest.raises(ValueError, match="centre_y: nan, must be finite"):
        PlacedObject(name="it", shape=BRICK, front_x=0.0, centre_y=math.nan)


# Seabed

SMALL = {"x_min": -2.0, "x_max": 3.0, "y_min": -1.0, "y_max": 1.0}


def test_a_flat_seabed_is_two_triangles_that_face_up():
    seabed = scenes.flat_seabed(Extent(**SMALL))
    assert len(seabed.faces) == 2
    assert np.allclose(as_mesh(seabed).face_normals, [0, 0, 1])
    assert as_mesh(seabed).area == pytest.approx(10.0)


@pytest.mark.parametrize("spacing", [None, 0.1])
def test_a_rough_seabed_covers_its_extent_once_and_faces_up(spacing):
    roughness = Roughness(spacing=spacing)
    seabed = scenes.rough_seabed(Extent(**SMALL), roughness)
    low, high = seabed.bounds()[:, :2]
    assert (low <= [-2, -1]).all()
    assert (high >= [3, 1]).all()
    assert (low > np.array([-2, -1]) - roughness.node_spacing).all()
    assert (high < np.array([3, 1]) + roughness.node_spacing).all()
    normals = as_mesh(seabed).face_normals
    assert normals[:, 2].min() > 0.5
    areas_seen_from_above = as_mesh(seabed).area_faces * normals[:, 2]
    assert areas_seen_from_above.sum() == pytest.approx(np.prod(high - low))
    assert np.allclose(areas_seen_from_above, 0.5 * roughness.node_spacing**2)


@pytest.mark.parametrize(("spacing", "cells"), [(None, 4), (0.15, 2), (0.05, 6)])
def test_a_rough_seabed_has_the_stated_moments(spacing, cells):
    deviation, length, side = 0.01, 0.3, 40.0
    extent = Extent(x_min=0.0, x_max=side, y_min=0.0, y_max=side)
    height = heights(extent, Roughness(rms_height=deviation, correlation_length=length, seed=3, spacing=spacing))
    # Variances of spatial averages of a Gaussian field with correlation C over an area: of the height, the integral of
    # C; of its square, twice that of C^2; of products at a lag, that of C^2 + C(u + lag) C(u - lag).
    integral, bound = math.pi * length**2 / side**2, 5.0
    assert abs(height.mean()) < bound * deviation * math.sqrt(integral)
    assert abs((height**2).mean() / deviation**2 - 1.0) < bound * math.sqrt(integral)
    for lag_x, lag_y in ((cells, 0), (0, cells), (2 * cells, 0), (cells, cells)):
        a, b = height[lag_x:, lag_y:], height[: height.shape[0] - lag_x, : height.shape[1] - lag_y]
        squared = (lag_x**2 + lag_y**2) / cells**2
        expected = math.exp(-squared)
        error = math.sqrt(0.5 * integral * (1.0 + math.exp(-2.0 * squared)))
        assert abs((a * b).mean() / deviation**2 - expected) < bound * error


def test_heights_are_gaussian():
    extent = Extent(x_min=0.0, x_max=40.0, y_min=0.0, y_max=40.0)
    # Nodes three correlation lengths apart are independent (their correlation is 1e-4).
    apart = heights(extent, Roughness(rms_height=1.0, seed=5))[::12, ::12].ravel()
    n = len(apart)
    assert abs((apart**3).mean()) < 5 * math.sqrt(15 / n)
    assert abs((apart**4).mean() - 3.0) < 5 * math.sqrt(96 / n)


def test_one_seed_is_one_surface_bit_for_bit():
    a, b = (scenes.rough_seabed(Extent(**SMALL), Roughness(seed=8)) for _ in range(2))
    assert np.array_equal(a.vertices, b.vertices)
    assert np.array_equal(a.faces, b.faces)


def test_the_surface_belongs_to_the_plane_not_to_the_extent():
    small = scenes.rough_seabed(Extent(**SMALL), Roughness(seed=8)).vertices
    large = scenes.rough_seabed(Extent(x_min=-9.7, x_max=8.1, y_min=-6.2, y_max=7.3), Roughness(seed=8)).vertices
    shared = {(x, y): z for x, y, z in large.tolist()}
    assert all(shared[x, y] == z for x, y, z in small.tolist())


def test_seeds_give_independent_surfaces():
    side = 40.0
    extent = Extent(x_min=-20.0, x_max=side - 20.0, y_min=-20.0, y_max=side - 20.0)
    a, b = (heights(extent, Roughness(rms_height=1.0, seed=seed)) for seed in (1, 2))
    # Variance of the mean product of two independent fields: the integral of C^2 over the area.
    assert abs((a * b).mean()) < 5 * math.sqrt(0.5 * math.pi * 0.3**2 / side**2)


def test_no_part_of_a_surface_returns_elsewhere():
    length, side = 0.3, 32.0
    extent = Extent(x_min=-0.5 * side, x_max=0.5 * side, y_min=-0.5 * side, y_max=0.5 * side)
    height = heights(extent, Roughness(rms_height=1.0, correlation_length=length, seed=6))
    spectrum = np.fft.rfft2(height, s=(1024, 1024))
    product = np.fft.irfft2(np.abs(spectrum) ** 2) / height.size
    lag = np.abs(np.fft.fftfreq(1024, 1.0 / 1024)) * 0.25 * length
    far = np.hypot(lag[:, None], lag) > 4.0 * length
    # Deviation as for independent surfaces; the largest of a million lags, far fewer of them independent, is near 5.
    assert np.abs(product[far]).max() < 7.0 * math.sqrt(0.5 * math.pi * length**2 / side**2)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Extent(**{**SMALL, "x_max": -2.0}), "x_max: -2.0, must be finite and over x_min of -2.0"),
        (lambda: Extent(**{**SMALL, "y_min": math.nan}), "y_max: 1.0, must be finite and over y_min of nan"),
        (lambda: Roughness(rms_height=0.0), "rms_height: 0.0, must be positive"),
        (lambda: Roughness(correlation_length=math.nan), "correlation_length: nan, must be positive"),
        (lambda: Roughness(spacing=-0.1), "spacing: -0.1, must be positive"),
        (lambda: Roughness(spacing=0.2), "spacing: 0.2 m, must be at most half the correlation_length of 0.3 m"),
        (lambda: Roughness(seed=-1), "seed: -1, must be 0 or more"),
        (
            lambda: scenes.rough_seabed(Extent(**SMALL), Roughness(spacing=1e-4)),
            "spacing: 0.0001 m makes .* nodes over the extent, must be at most",
        ),
    ],
)
def test_a_seabed_that_cannot_be_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


# Trajectories


def random_trajectory(poses: int = 20) -> Trajectory:
    random = np.random.default_rng(4)
    rotations = Rotation.random(poses, rng=random).as_quat()
    return Trajectory(
        times=np.cumsum(random.uniform(0.1, 2.0, poses)),
        poses=np.concatenate([random.normal(size=(poses, 3)), rotations], axis=1),
    )


def test_poses_between_match_linear_and_slerp_oracles():
    trajectory = random_trajectory()
    times = np.random.default_rng(1).uniform(trajectory.times[0], trajectory.times[-1], 500)
    got = trajectory.at(times)
    for axis in range(3):
        assert np.allclose(got[:, axis], np.interp(times, trajectory.times, trajectory.poses[:, axis]), atol=1e-12)
    wanted = Slerp(trajectory.times, Rotation.from_quat(trajectory.poses[:, 3:]))(times)
    assert (wanted.inv() * Rotation.from_quat(got[:, 3:])).magnitude().max() < 1e-7
    assert np.allclose(np.linalg.norm(got[:, 3:], axis=1), 1.0, atol=1e-15)


def test_given_poses_are_hit():
    trajectory = random_trajectory()
    got = trajectory.at(trajectory.times)
    assert np.allclose(got[:, :3], trajectory.poses[:, :3], atol=1e-15)
    # The sign of a quaternion does not matter.
    assert np.allclose(np.abs(np.sum(got[:, 3:] * trajectory.poses[:, 3:], axis=1)), 1.0, atol=1e-15)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-7, math.pi - 1e-9, math.pi])
def test_halfway_is_halfway_for_the_smallest_and_largest_turns(angle):
    end = [*LEVEL[:5], math.sin(0.5 * angle), math.cos(0.5 * angle)]
    half = Trajectory(times=np.array([0.0, 1.0]), poses=np.array([LEVEL, end])).at(np.array([0.5]))[0, 3:]
    assert np.allclose(half, [0.0, 0.0, math.sin(0.25 * angle), math.cos(0.25 * angle)], rtol=1e-6, atol=1e-15)


def test_a_quaternion_and_its_negative_are_one_attitude():
    flipped = [*LEVEL[:6], -1.0]
    halfway = Trajectory(times=np.array([0.0, 1.0]), poses=np.array([LEVEL, flipped])).at(np.array([0.5]))
    assert np.allclose(np.abs(halfway[0, 6]), 1.0)


def test_one_pose_is_a_trajectory_of_one_moment():
    still = Trajectory(times=np.array([3.0]), poses=np.array([LEVEL]))
    assert np.array_equal(still.at(np.array([3.0, 3.0])), [LEVEL, LEVEL])
    with pytest.raises(ValueError, match=r"must be within 3\.0 to 3\.0 s"):
        still.at(np.array([3.1]))


@pytest.mark.parametrize("time", [-0.1, 1.1, math.nan, math.inf])
def test_a_time_outside_the_span_is_refused(time):
    trajectory = Trajectory(times=np.array([0.0, 1.0]), poses=np.array([LEVEL, LEVEL]))
    with pytest.raises(ValueError, match=rf"times: {time} s at \[1\], must be within 0.0 to 1.0 s"):
        trajectory.at(np.array([0.5, time]))


@pytest.mark.parametrize(
    ("times", "poses", "message"),
    [
        ([], np.zeros((0, 7)), "times: empty"),
        ([[0.0]], [LEVEL], r"times: expected shape \[any\], got \[1, 1\]"),
        ([0.0, 1.0, 1.0], [LEVEL] * 3, "times: 1.0 s at pose 2, must be after 1.0 s"),
        ([0.0, -1.0], [LEVEL] * 2, "times: -1.0 s at pose 1, must be after 0.0 s"),
        ([0.0, np.nan], [LEVEL] * 2, r"times: nan at \[1\], must be finite"),
        ([0.0, 1.0], [LEVEL], r"poses: expected shape \[2, 7\], got \[1, 7\]"),
        ([0.0], [LEVEL[:6]], r"poses: expected shape \[1, 7\], got \[1, 6\]"),
        ([0.0], [[np.nan, *LEVEL[1:]]], r"poses: nan at \[0, 0\], must be finite"),
        ([0.0], [[5e5, *LEVEL[1:]]], "poses: coordinate of 500000 m, must be within 10000 m"),
        ([0.0], [[*LEVEL[:6], 0.9]], "poses: quaternion of length 0.9 at pose 0, must be within 0.001 of 1"),
        ([0.0], [[0.0] * 7], "poses: quaternion of length 0 at pose 0"),
    ],
)
def test_a_trajectory_that_kernels_would_misread_is_refused(times, poses, message):
    with pytest.raises(ValueError, match=message):
        Trajectory(times=np.array(times), poses=np.array(poses))


def test_quaternions_of_few_digits_are_normalised():
    rounded = [*LEVEL[:3], 0.183, 0.365, 0.548, 0.730]
    assert np.linalg.norm(Trajectory(times=np.zeros(1), poses=np.array([rounded])).poses[0, 3:]) == pytest.approx(1.0)


def test_a_straight_line_keeps_speed_heading_and_depth():
    line = scenes.straight_trajectory((1.0, 2.0, 3.0), heading=math.radians(120.0), speed=0.4, length=6.0)
    times = np.linspace(0.0, 15.0, 31)
    assert line.times[-1] == pytest.approx(15.0)
    poses = line.at(times)
    forward = Rotation.from_quat(poses[:, 3:]).apply([1.0, 0.0, 0.0])
    assert np.allclose(forward, [-0.5, math.sqrt(0.75), 0.0])
    assert np.allclose(poses[:, :3], [1.0, 2.0, 3.0] + 0.4 * times[:, None] * forward)


LAWN = np.array([[0, 0, 3], [20, 0, 3], [20, 4, 3], [0, 4, 3], [0, 8, 3], [20, 8, 3]], dtype=float)


def heading_of(poses: np.ndarray) -> np.ndarray:
    return np.unwrap(Rotation.from_quat(poses[:, 3:]).as_euler("ZYX")[:, 0])


def test_a_survey_keeps_its_speed_and_looks_along_its_legs():
    speed, rate = 0.5, math.radians(15.0)
    survey = scenes.waypoint_trajectory(LAWN, speed=speed, turn_rate=rate)
    assert survey.times[-1] == pytest.approx(68.0 / speed)
    times = np.linspace(0.0, survey.times[-1], 17601)
    step = times[1]
    poses = survey.at(times)
    moved = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(LAWN, axis=0), axis=1))]) / speed
    near_corner = np.abs(times[:, None] - along[1:-1]).min(axis=1)
    assert np.allclose(moved[near_corner[:-1] > 2 * step], speed * step)
    yaw = heading_of(poses)
    assert np.abs(np.diff(yaw)).max() < rate * step * (1 + 1e-6)
    # A quarter turn takes 6 s here, half of it before the corner.
    straight = near_corner > 3.0 + step
    direction = np.diff(poses[:, :2], axis=0)[straight[:-1]] / (speed * step)
    facing = np.stack([np.cos(yaw), np.sin(yaw)], axis=1)[:-1][straight[:-1]]
    assert np.allclose(direction, facing, atol=1e-6)
    # Two turns left and two right end where they began, not a full turn away.
    assert yaw[-1] == pytest.approx(yaw[0])


def test_every_waypoint_is_reached_with_half_its_turn_done():
    survey = scenes.waypoint_trajectory(LAWN, speed=0.5, turn_rate=math.radians(15.0))
    poses = survey.at(np.array([0.0, 40.0, 48.0, 88.0, 96.0, 136.0]))
    assert np.allclose(poses[:, :3], LAWN)
    assert np.allclose(np.degrees(heading_of(poses)), [0, 45, 135, 135, 45, 0])


def test_a_vertical_leg_keeps_the_heading():
    dive = scenes.waypoint_trajectory(np.array([[0, 0, 9], [0, 0, 3], [0, 5, 3], [0, 5, 8]], float), speed=0.5)
    assert np.allclose(heading_of(dive.poses), 0.5 * math.pi)
    assert np.allclose(heading_of(scenes.waypoint_trajectory(np.array([[1.0, 1, 1], [1, 1, 2]]), speed=1.0).poses), 0.0)


def test_a_reversal_turns_at_its_rate():
    there_and_back = scenes.waypoint_trajectory(np.array([[0.0, 0, 0], [9, 0, 0], [0, 0, 0]]), speed=0.5)
    yaw = heading_of(there_and_back.at(np.array([0.0, 9.0, 13.5, 18.0, 22.5, 27.0, 36.0])))
    assert np.allclose(np.abs(np.degrees(yaw)), [0, 0, 45, 90, 135, 180, 180])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: scenes.waypoint_trajectory(LAWN[:1], speed=1.0), "waypoints: 1, must be at least 2"),
        (lambda: scenes.waypoint_trajectory(LAWN[:, :2], speed=1.0), r"waypoints: expected shape \[any, 3\]"),
        (
            lambda: scenes.waypoint_trajectory(LAWN[[0, 1, 1]], speed=1.0),
            r"waypoints: \[20.0, 0.0, 3.0\] at 2, must differ",
        ),
        (lambda: scenes.waypoint_trajectory(LAWN, speed=0.5), "leg 1 lasts 8 s, must be at least the 9 s of the turns"),
        (lambda: scenes.waypoint_trajectory(LAWN, speed=0.0), "speed: 0.0, must be positive"),
        (lambda: scenes.waypoint_trajectory(LAWN, speed=1.0, turn_rate=-1.0), "turn_rate: -1.0, must be positive"),
        (lambda: scenes.straight_trajectory((0, 0, 0), heading=0.0, speed=-1.0, length=1.0), "speed: -1.0"),
        (lambda: scenes.straight_trajectory((0, 0, 0), heading=0.0, speed=1.0, length=0.0), "length: 0.0"),
        (
            lambda: scenes.straight_trajectory(np.zeros(2), heading=0.0, speed=1.0, length=1.0),
            r"start: expected shape \[3\]",
        ),
        (
            lambda: scenes.straight_trajectory((0, 0, 0), heading=math.nan, speed=1.0, length=1.0),
            "heading: nan, must be finite",
        ),
    ],
)
def test_a_run_that_cannot_be_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


# Deployments


class Run(NamedTuple):
    deployment: Deployment
    altitude: float  # [m]
    speed: float  # [m/s]
    back: float  # back of the last object [m]


RUNS = {
    "brick": lambda: Run(scenes.brick_deployment(), 1.8, 0.05, 0.15),
    "brick, rough": lambda: Run(scenes.brick_deployment(roughness=Roughness(seed=2)), 1.8, 0.05, 0.15),
    "steep": lambda: Run(scenes.slope_deployment(TABLE_1[0]), 2.5, 0.1, 1.6),
    "gentle, rough": lambda: Run(scenes.slope_deployment(TABLE_1[5], roughness=Roughness()), 2.5, 0.1, 3.0),
    "aligned": lambda: Run(scenes.pair_deployment(TABLE_2[2], "aligned"), 3.5, 0.1, 3.0),
    "misaligned, rough": lambda: Run(
        scenes.pair_deployment(TABLE_2[2], "misaligned", roughness=Roughness()), 3.5, 0.1, 4.0
    ),
}


@pytest.fixture(params=RUNS, scope="module")
def run(request: pytest.FixtureRequest) -> Run:
    return RUNS[request.param]()


def test_a_run_goes_from_9_m_before_the_first_front_to_1_m_past_the_last_object(run):
    first_front = min(item.front_x for item in run.deployment.objects)
    assert first_front == 0.0
    times, poses = run.deployment.trajectory.times, run.deployment.trajectory.poses
    assert np.allclose(poses[[0, -1], :3], [[-9.0, 0.0, run.altitude], [run.back + 1.0, 0.0, run.altitude]])
    assert np.allclose(poses[:, 3:], [0, 0, 0, 1])
    assert times[-1] - times[0] == pytest.approx((run.back + 10.0) / run.speed)
    assert run.deployment.trajectory.at(np.array([run.deployment.frames_from]))[0, 0] == pytest.approx(-4.5)


def test_the_seabed_lies_under_all_that_the_sonars_see(run):
    low, high = run.deployment.scene.bounds()
    assert low[0] <= -9.0
    assert high[0] >= run.back + 1.0 + 12.0
    assert low[1] <= -3.0
    assert high[1] >= 3.0


def test_objects_of_concrete_stand_without_a_gap_on_sand(run):
    scene = run.deployment.scene
    sand = scene.impedance == np.float32(scenes.SAND)
    concrete = scene.impedance == np.float32(scenes.CONCRETE)
    assert (sand | concrete).all()
    assert concrete.sum() == 12 * len(run.deployment.objects)
    assert scene.vertices[scene.faces[sand]][..., 2].min() > -FOOT
    objects = scene.vertices[scene.faces[concrete]].reshape(len(run.deployment.objects), -1, 3)
    for item, corners in zip(run.deployment.objects, objects, strict=True):
        assert corners[:, 2].min() == -FOOT
        assert corners[:, 2].max() == item.shape.height
        assert 0.5 * (corners[:, 1].min() + corners[:, 1].max()) == pytest.approx(item.centre_y)


@pytest.mark.parametrize(("arrangement", "second_front"), [("aligned", 0.0), ("misaligned", 1.0)])
def test_pairs_stand_side_by_side(arrangement, second_front):
    first, second = scenes.pair_deployment(TABLE_2[0], arrangement).objects
    assert (first.front_x, first.centre_y) == (0.0, -0.35)
    assert (second.front_x, second.centre_y) == (second_front, 0.35)
    assert first.shape == second.shape == TABLE_2[0]


def test_arrangements_lie_on_one_seabed():
    aligned, misaligned = (
        scenes.pair_deployment(TABLE_2[0], arrangement, roughness=Roughness(seed=1)).scene.vertices[:-16]
        for arrangement in ("aligned", "misaligned")
    )
    assert len(misaligned) > len(aligned)
    assert np.array_equal(misaligned[: len(aligned)], aligned)


def test_the_whole_run_is_imaged_when_the_distance_says_so():
    assert scenes.brick_deployment(imaging_distance=20.0).frames_from == 0.0


HILL = as_mesh(Wedge(width=2.0, height=3.0, depth=5.0, front_slope_deg=50.0).scene(1e6)).apply_translation([7, 8, 9])
MESH = Scene(vertices=HILL.vertices, faces=HILL.faces, impedance=np.full(len(HILL.faces), 9e6))


@pytest.mark.parametrize("roughness", [None, Roughness(rms_height=0.05)])
def test_a_mesh_is_half_buried_with_its_front_at_the_origin(roughness):
    deployment = scenes.mesh_deployment(MESH, name="hill", roughness=roughness)
    own = deployment.scene.impedance == np.float32(9e6)
    corners = deployment.scene.vertices[deployment.scene.faces[own]]
    assert corners[..., 0].min() == pytest.approx(0.0)
    assert corners[..., 1].min() == pytest.approx(-1.0)
    assert corners[..., 1].max() == pytest.approx(1.0)
    assert corners[..., 2].min() == pytest.approx(-1.55)
    assert corners[..., 2].max() == pytest.approx(1.55)
    assert deployment.objects == ()
    assert deployment.name == "hill"
    # 1.5 m over the top is more than 2.5 m over the seabed here.
    assert deployment.trajectory.poses[0, 2] == pytest.approx(3.05)


def test_a_mesh_that_lists_is_centred_on_what_stays_in_the_water():
    """A wall that leans over: what of it is over the seabed is as far to the left as to the right."""
    box = trimesh.creation.box((2.0, 0.3, 1.5))
    box.apply_transform(trimesh.transformations.rotation_matrix(0.8, [1, 0, 0]))
    mesh = Scene(vertices=box.vertices + np.array([3.0, 5.0, 7.0]), faces=box.faces, impedance=np.full(12, 9e6))
    body = scenes.bury(mesh)
    low, high = body.bounds()
    assert (low[0], low[2], high[2]) == pytest.approx((0.0, -high[2], -low[2]))
    dense, _ = trimesh.remesh.subdivide_to_size(body.vertices, body.faces, 0.005)
    over = dense[dense[:, 2] >= 0.0]
    bounds = scenes.exposed_bounds(body)
    # A corner of the section with the seabed may lie an edge of the fine mesh away.
    assert np.stack([over.min(axis=0), over.max(axis=0)]) == pytest.approx(bounds, abs=0.005)
    assert bounds[:, 1].sum() == pytest.approx(0.0)
    assert abs(body.bounds()[:, 1].sum()) > 0.1
    deployed = scenes.mesh_deployment(mesh).parts()[-1][1]
    assert np.array_equal(deployed.vertices, body.vertices)


def test_what_is_all_under_the_seabed_has_no_bounds_over_it():
    with pytest.raises(ValueError, match=r"scene: highest at z = -1 m, must reach over 0"):
        scenes.exposed_bounds(Scene(**TRIANGLE).moved((0.0, 0.0, -2.0)))


def test_parts_are_the_seabed_and_the_bodies_in_the_order_of_faces():
    deployment = scenes.pair_deployment(TABLE_2[0], "aligned")
    parts = deployment.parts()
    assert [name for name, _ in parts] == ["Seabed", "first", "second"]
    joined = Scene.join(*(part for _, part in parts))
    assert np.array_equal(joined.vertices[joined.faces], deployment.scene.vertices[deployment.scene.faces])
    assert np.array_equal(joined.impedance, deployment.scene.impedance)
    assert [name for name, _ in replace(deployment, bodies=()).parts()] == ["Surface"]
    for sizes in ((0,), (len(deployment.scene.faces),)):
        with pytest.raises(ValueError, match=r"bodies: .* must be at least 1 each, and some left for the seabed"):
            replace(deployment, bodies=tuple(("it", size) for size in sizes))


def test_a_low_mesh_is_passed_at_2_and_a_half_metres():
    deployment = scenes.mesh_deployment(BRICK.scene(1e6))
    assert deployment.trajectory.poses[0, 2] == 2.5


@pytest.mark.parametrize("name", ["sunken_ship.ply", "sunken_vase.obj", "uxo.stl"])
def test_a_found_mesh_is_deployed(name):
    folder = os.environ.get("SONARWARP_TEST_DATA")
    if folder is None:
        pytest.skip("SONARWARP_TEST_DATA does not name a folder with third-party meshes")
    mesh = scenes.scene_from_file(Path(folder) / "meshes" / name)
    deployment = scenes.mesh_deployment(mesh)
    length, _, height = np.ptp(mesh.bounds(), axis=0)
    assert deployment.trajectory.poses[-1, 0] == pytest.approx(length + 1.0)
    assert deployment.trajectory.poses[-1, 2] == pytest.approx(max(2.5, 0.5 * height + 1.5))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: scenes.brick_deployment(altitude=0.0), "altitude: 0.0, must be positive"),
        (lambda: scenes.brick_deployment(speed=math.nan), "speed: nan, must be positive"),
        (lambda: scenes.brick_deployment(imaging_distance=-1.0), "imaging_distance: -1.0, must be positive"),
        (
            lambda: scenes.pair_deployment(BRICK, cast("Literal['aligned']", "diagonal")),
            "arrangement: 'diagonal', must be 'aligned' or 'misaligned'",
        ),
        (
            lambda: scenes.slope_deployment(TABLE_1[0], roughness=Roughness(rms_height=0.05)),
            r"roughness: the seabed dips to -0\.\d+ m, must stay over the objects' feet at -0.1 m",
        ),
        (lambda: scenes.mesh_deployment(MESH, altitude=1.5), "altitude: 1.5 m, must be over the mesh's top at 1.550 m"),
    ],
)
def test_a_deployment_that_cannot_be_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_frames_outside_the_run_are_refused():
    run = scenes.brick_deployment()
    with pytest.raises(ValueError, match=r"frames_from: -1\.0 s, must be within the run"):
        Deployment(name="it", scene=run.scene, objects=(), trajectory=run.trajectory, frames_from=-1.0)
