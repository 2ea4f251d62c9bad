"""Round objects: closed triangles that hold the closed forms, lines that lie on them, refusals by name."""

import math

import numpy as np
import pytest
import trimesh

import sonarwarp_scenes as scenes
from sonarwarp_scenes import BRICK, CONCRETE, FOOT, TABLE_1, Frustum, LyingCylinder, PlacedObject, Sphere
from sonarwarp_scenes.burial import exposed_bounds

CYLINDER = Frustum(base_radius=0.3, top_radius=0.3, height=0.6)
CONE = Frustum(base_radius=0.5, top_radius=0.0, height=0.4)
CUT_CONE = Frustum(base_radius=0.5, top_radius=0.2, height=0.4)
CAP = Sphere(radius=0.5, centre_height=-0.2)
DOME = Sphere(radius=0.5, centre_height=0.0)
BALL = Sphere(radius=0.3, centre_height=0.3)
SUNK = LyingCylinder(radius=0.5, length=0.7, centre_height=-0.2)
HALF = LyingCylinder(radius=0.5, length=0.7, centre_height=0.0)
LOG = LyingCylinder(radius=0.3, length=0.7, centre_height=0.3)

ROUND = {
    "cylinder": CYLINDER,
    "cone": CONE,
    "cut cone": CUT_CONE,
    "cap": CAP,
    "dome": DOME,
    "ball": BALL,
    "sunk log": SUNK,
    "half a log": HALF,
    "log": LOG,
}
SHAPES = {**ROUND, "brick": BRICK, "gentle wedge": TABLE_1[5]}


def as_mesh(shape):
    scene = shape.scene(CONCRETE)
    return trimesh.Trimesh(scene.vertices, scene.faces, process=False)


def volume_over_seabed(shape):
    """Integral over the surface of its height over the seabed times the normal's upward part."""
    vertices, faces = as_mesh(shape).vertices, as_mesh(shape).faces
    while len(faces) < 200_000:
        vertices, faces = trimesh.remesh.subdivide(vertices, faces)
    a, b, c = vertices[faces].transpose(1, 0, 2)
    upward = 0.5 * np.cross(b - a, c - a)[:, 2]
    middles = np.maximum(0.5 * np.stack([a + b, b + c, c + a])[:, :, 2], 0.0)
    return np.sum(upward * middles.mean(axis=0))


def distance(shape, point):
    """From a point to the triangles [m]."""
    triangles = as_mesh(shape).triangles
    closest = trimesh.triangles.closest_point(triangles, np.tile(point, (len(triangles), 1)))
    return np.linalg.norm(closest - point, axis=1).min()


@pytest.mark.parametrize("shape", ROUND.values(), ids=ROUND)
def test_the_triangles_are_closed_and_face_outwards(shape):
    mesh = as_mesh(shape)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0.0
    low, high = exposed_bounds(shape.scene(CONCRETE))
    sizes = [shape.depth, shape.width, shape.height]
    assert np.allclose(low, [0.0, -0.5 * shape.width, 0.0], atol=2e-4)
    assert np.allclose(high - low, sizes, atol=4e-4)


@pytest.mark.parametrize("shape", [CYLINDER, CONE, CUT_CONE, CAP, DOME, SUNK, HALF], ids=str)
def test_triangles_hold_the_volume_over_the_seabed(shape):
    assert volume_over_seabed(shape) == pytest.approx(shape.volume, rel=2e-3)


@pytest.mark.parametrize(
    ("shape", "volume", "area"),
    [
        (BALL, math.pi * 0.3**3 * (1.0 + 2.0 / 3.0), 0.3**2 * (2.0 + 0.5 * math.pi)),
        (LOG, 0.7 * 0.3**2 * (2.0 + 0.5 * math.pi), 0.3**2 * (2.0 + 0.5 * math.pi)),
        (DOME, math.pi * 0.5**3 * 2.0 / 3.0, 0.5 * math.pi * 0.5**2),
        (CONE, math.pi / 3.0 * 0.5**2 * 0.4, 0.5 * 0.4),
        (CYLINDER, math.pi * 0.3**2 * 0.6, 0.6 * 0.6),
    ],
    ids=["ball", "log", "dome", "cone", "cylinder"],
)
def test_figures_are_those_under_the_upper_surface(shape, volume, area):
    assert shape.volume == pytest.approx(volume, rel=1e-12)
    assert shape.sectional_area == pytest.approx(area, rel=1e-12)


@pytest.mark.parametrize("shape", [BALL, LOG], ids=["ball", "log"])
def test_what_rests_touches_the_seabed_and_is_whole(shape):
    mesh = as_mesh(shape)
    assert mesh.bounds[0, 2] == pytest.approx(0.0, abs=1e-12)
    whole = 4.0 / 3.0 * math.pi * 0.3**3 if shape is BALL else 0.7 * math.pi * 0.3**2
    assert mesh.volume == pytest.approx(whole, rel=2e-3)


@pytest.mark.parametrize(("shape", "slope_deg"), [(CYLINDER, 90.0), (CONE, 38.6598), (CUT_CONE, 53.1301)], ids=str)
def test_a_side_goes_on_below_the_seabed_at_its_slope(shape, slope_deg):
    assert shape.front_slope_deg == pytest.approx(slope_deg, abs=1e-4)
    mesh = as_mesh(shape)
    assert mesh.bounds[0, 2] == pytest.approx(-FOOT)
    side = np.abs(mesh.face_normals[:, 2]) < 0.999
    # The facets' middles lean a little more than the corners on the true surface.
    assert np.allclose(np.degrees(np.arccos(mesh.face_normals[side, 2])), slope_deg, atol=0.02)
    foot = mesh.vertices[(np.abs(mesh.vertices[:, 1]) < 1e-9) & (mesh.vertices[:, 0] < 0.1)].min(axis=0)
    assert foot[0] == pytest.approx(-FOOT / math.tan(math.radians(slope_deg)), abs=1e-6)


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_the_outline_encloses_the_sectional_area(shape):
    x, z = shape.outline().T
    assert (x[0], z[0], z[-1]) == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
    assert x[-1] == pytest.approx(shape.depth)
    assert z.max() == pytest.approx(shape.height)
    assert np.sum(0.5 * (z[1:] + z[:-1]) * np.diff(x)) == pytest.approx(shape.sectional_area, rel=1e-3)


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_lines_to_draw_are_on_the_surface_or_under_what_overhangs(shape):
    lines = shape.edges()
    for corner in np.concatenate(lines):
        assert corner[0] >= -1e-9
        assert abs(corner[1]) <= 0.5 * shape.width + 1e-9
    corners = np.concatenate([line[:: max(1, len(line) // 8)] for line in lines])
    # The foot of what overhangs stands free under its widest place.
    on_surface = corners[(corners[:, 2] > 0.0) | (shape not in (BALL, LOG))]
    assert max(distance(shape, corner) for corner in on_surface) < 5e-4


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Frustum(base_radius=0.0, top_radius=0.0, height=1.0), "base_radius: 0.0, must be positive"),
        (lambda: Frustum(base_radius=0.5, top_radius=0.6, height=1.0), "top_radius: 0.6 m, must be in 0 to base_rad"),
        (lambda: Frustum(base_radius=0.5, top_radius=-0.1, height=1.0), "top_radius: -0.1 m"),
        (lambda: Frustum(base_radius=0.5, top_radius=math.nan, height=1.0), "top_radius: nan m"),
        (lambda: Frustum(base_radius=0.5, top_radius=0.5, height=math.inf), "height: inf, must be positive"),
        (lambda: Sphere(radius=-1.0, centre_height=0.0), "radius: -1.0, must be positive"),
        (
            lambda: Sphere(radius=0.5, centre_height=-0.5),
            "centre_height: -0.5 m, must be over -0.5 m and at most 0.5 m",
        ),
        (lambda: Sphere(radius=0.5, centre_height=0.6), "centre_height: 0.6 m"),
        (lambda: Sphere(radius=0.5, centre_height=math.nan), "centre_height: nan, must be finite"),
        (lambda: LyingCylinder(radius=0.5, length=0.0, centre_height=0.0), "length: 0.0, must be positive"),
        (lambda: LyingCylinder(radius=0.5, length=1.0, centre_height=0.7), "centre_height: 0.7 m"),
    ],
)
def test_a_shape_that_cannot_be_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_any_shape_is_deployed_with_its_front_ahead_of_the_run(shape):
    deployment = scenes.object_deployment(shape, name="it", altitude=2.0, speed=0.2, roughness=None)
    assert deployment.name == "it"
    assert deployment.objects == (PlacedObject(name="it", shape=shape, front_x=0.0, centre_y=0.0),)
    body = deployment.parts()[1]
    assert body[0] == "it"
    assert exposed_bounds(body[1])[0, 0] == pytest.approx(0.0, abs=2e-4)
    poses, times = deployment.trajectory.poses, deployment.trajectory.times
    assert poses[-1, 0] == pytest.approx(shape.depth + 1.0)
    assert np.all(poses[:, 2] == 2.0)
    assert (poses[-1, 0] - poses[0, 0]) / times[-1] == pytest.approx(0.2)
    assert deployment.trajectory.at(np.array([deployment.frames_from]))[0, 0] == pytest.approx(-5.5)


def test_a_run_into_the_object_is_refused():
    with pytest.raises(ValueError, match=r"altitude: 0\.5 m, must be over the object's top at 0\.600 m"):
        scenes.object_deployment(CYLINDER, altitude=0.5)
