"""Nearest surface point, nearest cloud point and visibility: against brute force, and where the answer is plain."""

import numpy as np
import pytest
import warp as wp

from sonarwarp_kernels import surface
from tests.reference import geometry
from tests.reference import surface as oracle

ROUNDING = 2e-6
"""Error of a float32 distance over some metres [m], a few units in the last place of the coordinates."""


def soup(seed, count, size=0.6):
    """Triangles at random in the cube from -1 to 1."""
    random = np.random.default_rng(seed)
    vertices = (random.uniform(-1, 1, (count, 1, 3)) + random.uniform(-size, size, (count, 3, 3))).reshape(-1, 3)
    return vertices.astype(np.float32).astype(np.float64), np.arange(3 * count).reshape(-1, 3)


def plate(x, half=1.0):
    """A square across the x axis at ``x``, cut into two triangles."""
    corners = np.array([[x, -half, -half], [x, half, -half], [x, half, half], [x, -half, half]])
    return corners, np.array([[0, 1, 2], [0, 2, 3]])


def joined(*parts):
    firsts = np.cumsum([0, *(len(vertices) for vertices, _ in parts[:-1])])
    faces = [faces + first for (_, faces), first in zip(parts, firsts, strict=True)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces)


def upload(mesh, device):
    vertices, faces = mesh
    return wp.Mesh(
        points=wp.array(vertices, dtype=wp.vec3, device=device),
        indices=wp.array(faces.ravel(), dtype=int, device=device),
    )


def surface_points(meshes, points, cloud, reach, device, threads=1):
    """Distances, positions and faces; an entry of ``meshes`` may be None."""
    uploaded = [None if mesh is None else upload(mesh, device) for mesh in meshes]
    count = len(points)
    distance = wp.zeros(count, dtype=float, device=device)
    position = wp.zeros(count, dtype=wp.vec3, device=device)
    face = wp.zeros(count, dtype=int, device=device)
    surface.surface_points(
        wp.array([0 if mesh is None else mesh.id for mesh in uploaded], dtype=wp.uint64, device=device),
        wp.array(points, dtype=wp.vec3, device=device),
        wp.array(cloud, dtype=int, device=device),
        reach,
        distance,
        position,
        face,
        device=device,
        threads=threads,
    )
    return distance.numpy(), position.numpy(), face.numpy()


def cloud_distances(clouds, samples, owner, reach, device, cells=16, threads=1):
    points = [wp.array(cloud, dtype=wp.vec3, device=device) for cloud in clouds]
    grids = []
    for array in points:
        grid = None
        if len(array):
            grid = wp.HashGrid(cells, cells, cells, device=device)
            grid.build(array, reach)
        grids.append(grid)
    distance = wp.zeros(len(samples), dtype=float, device=device)
    surface.cloud_distances(
        wp.array([0 if grid is None else grid.id for grid in grids], dtype=wp.uint64, device=device),
        wp.array(np.concatenate(clouds), dtype=wp.vec3, device=device),
        wp.array(np.cumsum([0, *map(len, clouds[:-1])]), dtype=int, device=device),
        wp.array(samples, dtype=wp.vec3, device=device),
        wp.array(owner, dtype=int, device=device),
        reach,
        distance,
        device=device,
        threads=threads,
    )
    return distance.numpy()


def view(azimuth=(-0.5, 0.5), elevation=(-0.3, 0.3), reach=(0.5, 5.0), cone=False):
    made = surface.View()
    made.azimuth_min, made.azimuth_max = azimuth
    made.elevation_min, made.elevation_max = elevation
    made.range_min, made.range_max = reach
    made.cone = int(cone)
    return made


def visible_samples(meshes, seen_by, poses, samples, owner, device, threads=1, capture=False):
    """``poses``: per cloud a list of (position, rotation matrix)."""
    uploaded = [None if mesh is None else upload(mesh, device) for mesh in meshes]
    frames = [[*position, *geometry.quaternion(turn)] for each in poses for position, turn in each]
    visible = wp.full(len(samples), -1, dtype=int, device=device)
    arguments = (
        wp.array([0 if mesh is None else mesh.id for mesh in uploaded], dtype=wp.uint64, device=device),
        seen_by,
        wp.array(np.array(frames).reshape(-1, 7), dtype=wp.transform, device=device),
        wp.array(np.cumsum([0, *map(len, poses)]), dtype=int, device=device),
        wp.array(samples, dtype=wp.vec3, device=device),
        wp.array(owner, dtype=int, device=device),
        1e-3,
        visible,
    )
    if capture:
        surface.visible_samples(*arguments, device=device)
        visible.fill_(-1)
        with wp.ScopedCapture(device=device) as captured:
            surface.visible_samples(*arguments, device=device, threads=threads)
        wp.capture_launch(captured.graph)
    else:
        surface.visible_samples(*arguments, device=device, threads=threads)
    return visible.numpy()


def test_the_nearest_surface_point_is_the_nearest_of_all_triangles(device):
    vertices, faces = soup(1, 60)
    points = np.random.default_rng(2).uniform(-2, 2, (500, 3)).astype(np.float32)
    distance, position, face = surface_points([(vertices, faces)], points, np.zeros(500), 10.0, device)
    every = oracle.face_distances(vertices, faces, points.astype(np.float64))
    assert np.allclose(distance, every.min(axis=1), rtol=0, atol=ROUNDING)
    assert np.allclose(every[np.arange(500), face], every.min(axis=1), rtol=0, atol=ROUNDING)
    assert np.allclose(np.linalg.norm(position - points, axis=1), distance, rtol=0, atol=ROUNDING)
    on_surface = oracle.face_distances(vertices, faces, position.astype(np.float64))
    assert np.allclose(on_surface[np.arange(500), face], 0.0, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize(
    ("point", "distance", "nearest"),
    [
        ((1.5, 0.2, 0.3), 0.5, (1, 0.2, 0.3)),  # before a face
        ((0.6, -0.9, 0.4), 0.4, (1, -0.9, 0.4)),  # behind it: unsigned
        ((1.0, 0.25, 0.25), 0.0, (1, 0.25, 0.25)),  # on the edge that both triangles share
        ((1.0, 4.0, 0.0), 3.0, (1, 1, 0)),  # beside an edge
        ((3.0, 3.0, 2.0), 3.0, (1, 1, 1)),  # off a corner
    ],
)
def test_distance_to_a_plate(device, point, distance, nearest):
    got, position, face = surface_points([plate(1.0)], [point], [0], 10.0, device)
    assert got[0] == pytest.approx(distance, abs=ROUNDING)
    assert position[0] == pytest.approx(nearest, abs=ROUNDING)
    assert face[0] in (0, 1)


def test_each_point_is_judged_against_its_own_cloud_s_mesh(device):
    points = np.zeros((4, 3))
    distance, position, face = surface_points([plate(1.0), None, plate(-3.0)], points, [2, 1, 0, 2], 10.0, device)
    assert distance.tolist() == [3.0, np.inf, 1.0, 3.0]
    assert face[1] == surface.NO_FACE
    assert np.array_equal(position[1], points[1])


def test_nothing_is_found_beyond_reach(device):
    distance, position, face = surface_points([plate(1.0)], [(0, 0, 0), (0.5, 0, 0)], [0, 0], 0.9, device)
    assert distance.tolist() == [surface.TOO_FAR, 0.5]
    assert face[0] == surface.NO_FACE
    assert position[0].tolist() == [0, 0, 0]


@pytest.mark.parametrize("cells", [4, 16])
def test_the_nearest_cloud_point_is_the_nearest_within_reach_of_the_own_cloud(device, cells):
    # Clouds 2 m wide in cells of 0.2 m: with 4 cells an axis the grid wraps and mixes far places.
    random = np.random.default_rng(3)
    clouds = [random.uniform(-1, 1, (count, 3)).astype(np.float32) for count in (400, 0, 250)]
    samples = random.uniform(-1.2, 1.2, (600, 3)).astype(np.float32)
    owner = random.integers(0, 3, 600)
    reach = 0.2
    distance = cloud_distances(clouds, samples, owner, reach, device, cells)
    for index, cloud in enumerate(clouds):
        expected = oracle.cloud_distances(cloud.astype(np.float64), samples[owner == index].astype(np.float64))
        assert np.abs(expected - reach).min() > ROUNDING  # none too close to call
        expected[expected > reach] = np.inf
        assert np.isinf(expected).any()
        assert np.allclose(distance[owner == index], expected, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("cone", [False, True])
def test_visible_is_what_lies_in_view_with_nothing_nearer_on_the_ray(device, cone):
    random = np.random.default_rng(4)
    mesh = soup(5, 40)
    corners = mesh[0][mesh[1]]
    weight = random.dirichlet(np.ones(3), 800)
    samples = np.einsum("sc,scx->sx", weight, corners[random.integers(0, len(corners), 800)])
    samples = samples.astype(np.float32).astype(np.float64)
    poses = [
        ((-3.0, 0.2, 0.5), geometry.sonar_rotation(0.1, 0.2, 0.05)),
        ((0.0, 3.5, -0.4), geometry.sonar_rotation(-0.3, 0.0, -1.5)),
        ((0.4, -0.1, 4.0), geometry.sonar_rotation(0.0, 1.4, 2.0)),
    ]
    limits = {"azimuth": (-0.3, 0.25), "elevation": (-0.2, 0.15), "reach": (1.0, 3.8)}
    expected, called = np.zeros(800, dtype=bool), np.ones(800, dtype=bool)
    for position, turn in poses:
        local = (samples - position) @ turn
        wider, narrower = (
            oracle.in_view(local, **{key: (low - by, high + by) for key, (low, high) in limits.items()}, cone=cone)
            for by in (1e-5, -1e-5)
        )
        hidden = oracle.line_of_sight(*mesh, np.array(position), samples)
        expected |= oracle.in_view(local, **limits, cone=cone) & (hidden < 1e-3)
        called &= (wider == narrower) & (np.abs(hidden - 1e-3) > 1e-5)
    assert called.mean() > 0.99
    assert 0.05 < expected.mean() < 0.95
    visible = visible_samples([mesh], view(**limits, cone=cone), [poses], samples, np.zeros(800), device)
    assert np.array_equal(visible[called] == 1, expected[called])
    assert set(visible.tolist()) == {0, 1}


FORWARD = ((0.0, 0.0, 0.0), np.eye(3))


@pytest.mark.parametrize(
    ("sample", "seen"),
    [
        ((2, 0, 0), True),
        ((0.49, 0, 0), False),  # nearer than the window
        ((0.51, 0, 0), True),
        ((4.99, 0, 0), True),
        ((5.01, 0, 0), False),  # beyond the window
        ((2 * np.cos(0.49), 2 * np.sin(0.49), 0), True),
        ((2 * np.cos(0.51), 2 * np.sin(0.51), 0), False),  # left of the fan
        ((2 * np.cos(0.51), -2 * np.sin(0.51), 0), False),  # right of it
        ((2 * np.cos(0.29), 0, 2 * np.sin(0.29)), True),
        ((2 * np.cos(0.31), 0, 2 * np.sin(0.31)), False),  # above it
        ((2 * np.cos(0.31), 0, -2 * np.sin(0.31)), False),  # below it
        ((-2, 0, 0), False),  # behind the sonar
        ((0, 0, 0), False),  # the sonar's own place
    ],
)
@pytest.mark.parametrize("cone", [False, True])
def test_edges_of_the_view(device, sample, seen, cone):
    visible = visible_samples([None], view(cone=cone), [[FORWARD]], [sample], [0], device)
    assert visible.tolist() == [int(seen)]


@pytest.mark.parametrize(
    ("sample", "seen"),
    [
        ((2, 0.1, 0.1), True),  # on the plate itself
        ((2, 0.1, 0.1 - 1e-4), True),
        ((2.0005, 0.1, 0.1), True),  # behind it by less than the clearance
        ((2.01, 0.1, 0.1), False),  # just behind it
        ((4, 0.1, 0.1), False),  # in its shadow
        ((4, 0.9, 0.1), True),  # beside its shadow
        ((1.9, 0.1, 0.1), True),  # before it
    ],
)
def test_a_plate_hides_what_lies_behind_it(device, sample, seen):
    visible = visible_samples([plate(2.0, half=0.4)], view(), [[FORWARD]], [sample], [0], device)
    assert visible.tolist() == [int(seen)]


def test_one_pose_that_sees_is_enough_and_none_sees_nothing(device):
    behind = ((4.0, 0.0, 0.0), geometry.rotation("z", np.pi))
    mesh = joined(plate(2.0), plate(3.0))
    samples = [(2, 0.1, 0), (3, 0.1, 0)] * 4
    poses = [[FORWARD], [behind], [FORWARD, behind], []]
    owner = np.repeat(np.arange(4), 2)
    visible = visible_samples([mesh] * 4, view(), poses, samples, owner, device)
    assert visible.reshape(4, 2).tolist() == [[1, 0], [0, 1], [1, 1], [0, 0]]


def test_threads_and_capture_change_nothing(device):
    mesh = soup(6, 30)
    random = np.random.default_rng(7)
    points = random.uniform(-1, 1, (300, 3)).astype(np.float32)
    owner = random.integers(0, 2, 300)
    one, many = (surface_points([mesh, plate(0.0)], points, owner, 5.0, device, threads) for threads in (1, 3))
    assert all(np.array_equal(a, b) for a, b in zip(one, many, strict=True))
    clouds = [points[:100], points[100:180]]
    one, many = (cloud_distances(clouds, points, owner, 0.3, device, threads=threads) for threads in (1, 3))
    assert np.array_equal(one, many)
    poses = [[((-3.0, 0.0, 0.0), np.eye(3))], [((-2.0, 0.0, 1.0), geometry.rotation("y", 0.4))]]
    one, many, captured = (
        visible_samples([mesh, None], view(), poses, points, owner, device, threads, capture)
        for threads, capture in ((1, False), (3, False), (3, True))
    )
    assert set(one.tolist()) == {0, 1}
    assert np.array_equal(one, many)
    assert np.array_equal(one, captured)


def test_wrong_arrays_are_refused_by_name(device):
    ids = wp.zeros(2, dtype=wp.uint64, device=device)
    vectors = wp.zeros(3, dtype=wp.vec3, device=device)
    numbers = wp.zeros(3, dtype=int, device=device)
    values = wp.zeros(3, dtype=float, device=device)
    poses = wp.zeros(4, dtype=wp.transform, device=device)
    with pytest.raises(ValueError, match=r"cloud: expected shape \(3,\), got \(2,\)"):
        surface.surface_points(ids, vectors, numbers[:2], 1.0, values, vectors, numbers, device=device)
    with pytest.raises(ValueError, match=r"first_point: expected shape \(2,\), got \(3,\)"):
        surface.cloud_distances(ids, vectors, numbers, vectors, numbers, 1.0, values, device=device)
    with pytest.raises(ValueError, match=r"first_frame: expected shape \(3,\), got \(2,\)"):
        surface.visible_samples(ids, view(), poses, numbers[:2], vectors, numbers, 1e-3, numbers, device=device)
    with pytest.raises(ValueError, match="visible_out: expected dtype int32, got float32"):
        surface.visible_samples(ids, view(), poses, numbers, vectors, numbers, 1e-3, values, device=device)
