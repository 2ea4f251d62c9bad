"""Rays meet what closed forms and brute force say, at any edge, from either side, within reach and not beyond."""

import math

import numpy as np
import pytest
import trimesh
import warp as wp

from sonarwarp import FLS
from sonarwarp_kernels import raycast
from sonarwarp_scenes import CONCRETE, SAND, Scene, Wedge, flat_seabed
from tests.reference import echo as oracle
from tests.reference import geometry
from tests.sonar_world import AHEAD, Frames, World, box, cast, plate, pose, rough, wall, wandering_poses

AZIMUTH = np.linspace(-0.25, 0.25, 7)
ELEVATION = np.linspace(-0.4, 0.4, 33)
REACH = 50.0

ORIGIN = pose((0.0, 0.0, 0.0))

# Of a range in single precision through rotations and a triangle test.
PRECISION = 2e-6


def hits(world, poses, azimuth=AZIMUTH, elevation=ELEVATION, cone=0, reach=REACH, scene=0, threads=1):
    """Range, face and normal [frame, column, row] as arrays of the host."""
    frames = Frames(world, np.atleast_2d(poses), scene)
    return tuple(array.numpy() for array in cast(world, frames, azimuth, elevation, cone, reach, threads))


def directions(tilt=0.0, cone=False, azimuth=AZIMUTH, elevation=ELEVATION):
    return oracle.beam_direction(azimuth[:, None], elevation, cone) @ geometry.rotation("y", tilt).T


# --- Closed forms ---


@pytest.mark.parametrize("cone", [0, 1])
def test_a_plane_is_met_at_its_closed_form(device, cone):
    tilt, altitude = 0.7, 3.5
    distance, face, normal = hits(World(device, flat_seabed(AHEAD)), pose((0, 0, altitude), tilt), cone=cone)
    ray = directions(tilt, bool(cone))
    expected = altitude / -ray[..., 2]
    inside = np.abs(expected * ray[..., 1]) < 2.5
    inside &= (expected * ray[..., 0] < 8.0) & (expected * ray[..., 0] > -1.0)
    assert inside.sum() > 100
    np.testing.assert_allclose(distance[0][inside], expected[inside], rtol=PRECISION)
    np.testing.assert_allclose(normal[0][inside], np.broadcast_to([0, 0, 1], (inside.sum(), 3)), atol=PRECISION)
    # The diagonal of the plate parts its two faces.
    x, y = expected * ray[..., 0], expected * ray[..., 1]
    above = (y + 2.5) * 9.0 - (x + 1.0) * 5.0
    clear = inside & (np.abs(above) > 1e-3)
    assert np.array_equal(face[0][clear], (above > 0).astype(int)[clear])


def test_a_sphere_is_met_between_its_facets_and_itself(device):
    radius, centre = 0.5, np.array([3.0, 0.1, -0.05])
    ball = trimesh.creation.icosphere(subdivisions=4, radius=radius)
    sphere = Scene(vertices=ball.vertices + centre, faces=ball.faces, impedance=np.full(len(ball.faces), CONCRETE))
    distance, _, normal = hits(World(device, sphere), ORIGIN)
    ray = directions()
    along = ray @ centre
    beside = centre @ centre - along**2
    # A facet's plane is this near to the centre: the polyhedron holds this ball and lies inside of the other.
    inner = np.min(np.abs(np.einsum("fi,fi->f", ball.face_normals, ball.triangles[:, 0])))
    through = beside < inner**2
    assert through.sum() > 30
    nearest = along - np.sqrt(np.maximum(radius**2 - beside, 0))
    farthest = along - np.sqrt(np.maximum(inner**2 - beside, 0))
    assert np.all(distance[0][through] > nearest[through] - 1e-5)
    assert np.all(distance[0][through] < farthest[through] + 1e-5)
    assert np.all(np.isinf(distance[0][beside > radius**2]))
    outward = (distance[0][through][:, None] * ray[through] - centre) / radius
    assert np.all(np.einsum("ij,ij->i", outward, normal[0][through]) > 0.99)


def test_a_wedge_is_met_on_its_sloping_front(device):
    wedge = Wedge(width=4.0, height=2.0, depth=4.0, front_slope_deg=60.0)
    distance, _, normal = hits(World(device, wedge.scene(CONCRETE).moved((3.0, 0, 0))), pose((0, 0, 1.0)))
    ray = directions()
    outward = np.array([-math.sin(math.radians(60.0)), 0.0, math.cos(math.radians(60.0))])
    expected = (np.array([3.0, 0.0, -1.0]) @ outward) / (ray @ outward)
    height = 1.0 + expected * ray[..., 2]
    front = (height > 0.0) & (height < 2.0)
    assert front.sum() > 100
    np.testing.assert_allclose(distance[0][front], expected[front], rtol=PRECISION)
    np.testing.assert_allclose(normal[0][front], np.broadcast_to(outward, (front.sum(), 3)), atol=PRECISION)


# --- Brute force ---


def test_triangles_in_disorder_match_brute_force(device):
    rng = np.random.default_rng(4)
    vertices = rng.uniform([1.0, -1.5, -1.5], [6.0, 1.5, 1.5], (300, 3))
    soup = Scene(vertices=vertices, faces=np.arange(300).reshape(100, 3), impedance=np.full(100, SAND))
    poses = wandering_poses(3, altitude=0.0, tilt_deg=0.0)
    distance, face, _ = hits(World(device, soup), poses)
    rounded = np.asarray(vertices, dtype=np.float32)
    for frame, (x, y, z, *rotation) in enumerate(np.asarray(poses, dtype=np.float32).astype(np.float64)):
        matrix = wp.quat_to_matrix(wp.quat(*rotation))
        ray = (oracle.beam_direction(AZIMUTH[:, None], ELEVATION, False) @ np.array(matrix).reshape(3, 3).T).reshape(
            -1, 3
        )
        expected, expected_face = oracle.first_face(rounded, soup.faces, np.array([x, y, z]), ray)
        got, got_face = distance[frame].ravel(), face[frame].ravel()
        assert np.isfinite(expected).mean() > 0.5
        # Rays within a rounding error of an edge may fall on either side of it.
        same = got_face == expected_face
        assert same.mean() > 0.99
        np.testing.assert_allclose(got[same], expected[same], rtol=1e-4)


# --- Leaks ---


def flat_grid(squares: int) -> Scene:
    """The square from -1 to 1 at x = 2 as 2 x ``squares``^2 triangles, exactly flat."""
    line = np.linspace(-1.0, 1.0, squares + 1)
    y, z = np.meshgrid(line, line, indexing="ij")
    node = np.arange(y.size).reshape(y.shape)
    a, b, c, d = node[:-1, :-1], node[1:, :-1], node[1:, 1:], node[:-1, 1:]
    faces = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    vertices = np.stack([np.full(y.size, 2.0), y.ravel(), z.ravel()], axis=1)
    return Scene(vertices=vertices, faces=faces, impedance=np.full(len(faces), SAND))


@pytest.mark.parametrize("squares", [8, 13, 64])
def test_no_ray_slips_through_a_shared_edge(device, squares):
    # From an odd place a single query loses 1 % of these rays, which are aimed at edges, and at nodes.
    grid, origin = flat_grid(squares), np.array([0.3, 0.11, -0.07])
    rng = np.random.default_rng(squares)
    edges = np.concatenate([grid.faces[:, [0, 1]], grid.faces[:, [1, 2]], grid.faces[:, [2, 0]]])
    start, stop = grid.vertices[edges[rng.integers(0, len(edges), 300)]].transpose(1, 0, 2)
    target = start + (stop - start) * rng.choice([0.0, 0.25, 0.5, rng.uniform()], 300)[:, None] - origin
    azimuth = np.arctan2(target[:, 1], target[:, 0])
    elevation = np.arctan2(target[:, 2], np.hypot(target[:, 0], target[:, 1]))
    distance, _, _ = hits(World(device, grid), pose(origin), azimuth, elevation)
    ray = oracle.beam_direction(azimuth[:, None], elevation, False)
    expected = (2.0 - origin[0]) / ray[..., 0]
    inside = np.all(np.abs(origin[1:] + expected[..., None] * ray[..., 1:]) < 0.999, axis=-1)
    assert inside.mean() > 0.5
    np.testing.assert_allclose(distance[0][inside], expected[inside], rtol=5e-6)


# --- Misses ---


@pytest.mark.parametrize(
    ("scene", "where", "reach"),
    [
        (wall(5.0), "beyond reach", 4.9),
        (wall(-5.0), "behind", 50.0),
        (None, "empty scene", 50.0),
        (plate([[1, -1, -2], [9, -1, -2], [9, 1, -2], [1, 1, -2]]), "below", 1.9),
    ],
)
def test_nothing_within_reach_is_no_hit(device, scene, where, reach):
    distance, face, normal = hits(World(device, scene), ORIGIN, reach=reach)
    assert np.all(distance == raycast.NO_HIT), where
    assert np.all(face == raycast.NO_FACE)
    assert not normal.any()


def test_a_ray_along_a_plane_misses_it(device):
    lying = plate([[1, -1, 0], [9, -1, 0], [9, 1, 0], [1, 1, 0]])
    distance, _, _ = hits(World(device, lying), ORIGIN, np.array([0.0]), np.array([0.0]))
    assert np.isinf(distance).all()


# --- Sides ---


def test_a_box_is_met_from_inside_with_its_outward_normal(device):
    distance, _, normal = hits(World(device, box((2.0, 3.0, 4.0), CONCRETE)), ORIGIN)
    ray = directions()
    with np.errstate(divide="ignore"):
        expected = np.min(np.array([2.0, 3.0, 4.0]) / np.abs(ray), axis=-1)
    np.testing.assert_allclose(distance[0], expected, rtol=PRECISION)
    assert np.all(np.einsum("ijk,ijk->ij", normal[0], ray) > 0)


def test_a_single_triangle_is_met_from_either_side(device):
    for faces in ([[0, 1, 2]], [[0, 2, 1]]):
        vertices = np.array([[2.0, -3, -3], [2, 3, -3], [2, 0, 6]])
        leaf = Scene(vertices=vertices, faces=np.array(faces), impedance=np.array([SAND]))
        distance, _, normal = hits(World(device, leaf), ORIGIN, np.array([0.0]), np.array([0.1]))
        assert distance[0, 0, 0] == pytest.approx(2.0 / math.cos(0.1), rel=PRECISION)
        assert abs(normal[0, 0, 0, 0]) == pytest.approx(1.0)


# --- Batches ---


def test_a_batch_over_two_scenes_equals_each_frame_alone(device):
    first, second = rough(), wall(3.0)
    world = World(device, first, second)
    poses = np.concatenate([wandering_poses(3, 2.5, 30.0), wandering_poses(2, 0.0, 0.0)])
    scene = [0, 1, 0, 1, 0]
    batch = hits(world, poses, scene=scene)
    for threads in (2, 5):
        for one, other in zip(batch, hits(world, poses, scene=scene, threads=threads), strict=True):
            assert np.array_equal(one, other)
    for frame in range(5):
        alone = hits(World(device, (first, second)[scene[frame]]), poses[frame])
        for one, other in zip(batch, alone, strict=True):
            assert np.array_equal(one[frame], other[0])


# --- First contacts ---


def contacts(world, fan, poses, azimuths, elevations, threads=1):
    frames = Frames(world, np.atleast_2d(poses))
    shape = (frames.count, fan.azimuth.shape[0])
    out = [wp.zeros(shape, dtype=kind, device=world.device) for kind in (float, float, float, int)]
    raycast.first_contacts(
        fan,
        world.table,
        frames.pose,
        frames.scene,
        azimuths,
        elevations,
        *out,
        device=world.device,
        threads=threads,
    )
    return [array.numpy() for array in out]


def test_over_a_flat_seabed_the_lower_edge_is_met_first(device):
    fls = FLS(azimuth_edge=np.radians(np.linspace(-14.5, 14.5, 9)))
    world = World(device, flat_seabed(AHEAD))
    tilt, altitude = math.radians(40.0), 3.5
    distance, azimuth, elevation, face = contacts(world, fls.fan(device), pose((0, 0, altitude), tilt), 5, 200)
    lowest = -fls.half_elevation * (1 - 1 / 200)
    np.testing.assert_allclose(elevation, lowest, atol=1e-6)
    # A centred beam comes down first, so of each beam the azimuth nearest to it.
    parts = np.linspace(fls.azimuth_edge[:-1], fls.azimuth_edge[1:], 11)[1::2]
    nearest = np.take_along_axis(parts, np.argmin(np.abs(parts), axis=0)[None], axis=0)[0]
    np.testing.assert_allclose(azimuth[0], nearest, atol=1e-6)
    ray = oracle.beam_direction(nearest, lowest, False) @ geometry.rotation("y", tilt).T
    np.testing.assert_allclose(distance[0], altitude / -ray[:, 2], rtol=1e-5)
    assert set(face.ravel()) <= {0, 1}


def test_first_contacts_are_the_least_of_a_grid(device):
    fls = FLS(azimuth_edge=np.radians(np.linspace(-4.0, 4.0, 5)))
    world = World(device, rough())
    poses = wandering_poses(3, 2.5, 30.0)
    distance, azimuth, elevation, face = contacts(world, fls.fan(device), poses, 4, 50)
    width = np.diff(fls.azimuth_edge)[:, None]
    columns = (fls.azimuth_edge[:-1, None] + width * (np.arange(4) + 0.5) / 4).ravel()
    rows = fls.half_elevation * (2 * (np.arange(50) + 0.5) / 50 - 1)
    grid, faces, _ = hits(world, poses, columns, rows, reach=float(fls.range_edge[-1]))
    per_beam = grid.reshape(3, 4, 200)
    np.testing.assert_allclose(distance, per_beam.min(axis=-1), rtol=1e-5)
    best = per_beam.argmin(axis=-1)
    assert np.array_equal(face, np.take_along_axis(faces.reshape(3, 4, 200), best[..., None], axis=-1)[..., 0])
    np.testing.assert_allclose(elevation, rows[best % 50], atol=1e-6)
    np.testing.assert_allclose(azimuth, columns.reshape(4, 4)[np.arange(4), best // 50], atol=1e-6)
    for one, other in zip(
        (distance, azimuth, elevation, face), contacts(world, fls.fan(device), poses, 4, 50, 3), strict=True
    ):
        assert np.array_equal(one, other)


def test_a_beam_that_meets_nothing_in_the_window_has_no_contact(device):
    fls = FLS(azimuth_edge=np.radians(np.linspace(-4.0, 4.0, 5)))
    distance, azimuth, elevation, face = contacts(World(device, wall(6.0)), fls.fan(device), ORIGIN, 3, 9)
    assert np.all(distance == raycast.NO_HIT)
    assert np.all(face == raycast.NO_FACE)
    assert not azimuth.any()
    assert not elevation.any()


# --- Refusals ---


def test_wrong_arguments_are_refused_by_name(device):
    world = World(device, wall(3.0))
    frames = Frames(world, ORIGIN[None])
    two = wp.zeros(2, dtype=float, device=device)
    out = wp.zeros((1, 2, 2), dtype=float, device=device)
    face = wp.zeros((1, 2, 2), dtype=int, device=device)
    normal = wp.zeros((1, 2, 3), dtype=wp.vec3, device=device)
    with pytest.raises(ValueError, match=r"normal_out: expected shape \(1, 2, 2\), got \(1, 2, 3\)"):
        raycast.cast_grid(world.table, two, two, 0, 5.0, frames.pose, frames.scene, out, face, normal, device=device)
    with pytest.raises(ValueError, match="azimuths, elevations: must be at least 1, got 0, 5"):
        contacts(world, FLS().fan(device), ORIGIN, 0, 5)
