"""Scenes from mesh files: polygons cut, windings repaired, materials found by name, bad files refused in one line."""

import math
import re
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import sonarwarp_scenes as scenes
from sonarwarp_scenes.materials import MATERIALS, material_in
from sonarwarp_scenes.polygons import triangulate
from sonarwarp_scenes.winding import wind_outwards
from tests.attempts import attempt

EXAMPLES = settings(max_examples=100, deadline=None, derandomize=True, database=None)

seeds = st.integers(0, 2**32 - 1)


# Polygons


def shoelace(flat: np.ndarray) -> float:
    """Signed area of a polygon [n, 2]."""
    following = np.roll(flat, -1, axis=0)
    return 0.5 * float(np.sum(flat[:, 0] * following[:, 1] - flat[:, 1] * following[:, 0]))


def triangle_areas(points: np.ndarray, triangles: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Areas of triangles, negative where they face against ``normal``."""
    corners = points[triangles]
    return 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) @ normal


def star(corners: int, random: np.random.Generator) -> np.ndarray:
    """A polygon that does not cross itself, mostly with notches: corners at rising angles around its middle."""
    # No gap of half a turn: else the middle lies outside, and the sides may cross.
    gaps = random.uniform(0.4, 1.0, corners)
    angles = 2.0 * np.pi * np.cumsum(gaps) / gaps.sum()
    return random.uniform(0.1, 1.0, corners)[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def in_space(flat: np.ndarray, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A flat polygon somewhere in space, [n, 3], and its normal."""
    turn = Rotation.random(random_state=random)
    return turn.apply(np.column_stack([flat, np.zeros(len(flat))])) + random.normal(0.0, 5.0, 3), turn.apply([0, 0, 1])


@EXAMPLES
@given(seed=seeds, corners=st.integers(4, 40))
def test_a_polygon_is_covered_once_by_triangles_that_face_as_it_does(seed, corners):
    random = np.random.default_rng(seed)
    flat = star(corners, random)
    points, normal = in_space(flat, random)
    cut = triangulate(points, np.array([corners]), np.arange(corners))
    areas = triangle_areas(points, cut.triangles, normal)
    # Triangles of one sense whose areas add up to the polygon's can neither overlap nor leave a gap.
    assert len(cut.triangles) == corners - 2
    assert areas.min() > 0.0
    assert areas.sum() == pytest.approx(shoelace(flat), rel=1e-9)
    assert (cut.polygons, cut.tangled) == (1, 0)


@EXAMPLES
@given(seed=seeds, counts=st.lists(st.integers(3, 9), min_size=1, max_size=12))
def test_polygons_keep_their_order_and_corners(seed, counts):
    random = np.random.default_rng(seed)
    indices, points = [], []
    for n in counts:
        here, _ = in_space(star(max(n, 3), random), random)
        shuffled = random.permutation(n)
        indices.append(sum(map(len, points)) + np.argsort(shuffled))
        points.append(here[shuffled])
    cut = triangulate(np.concatenate(points), np.array(counts), np.concatenate(indices))
    assert np.array_equal(cut.face, np.repeat(np.arange(len(counts)), np.array(counts) - 2))
    for face, corners in enumerate(indices):
        assert set(cut.triangles[cut.face == face].ravel().tolist()) == set(corners.tolist())
    assert cut.polygons == sum(n > 3 for n in counts)


COMB = [(0, 0), (7, 0), (7, 3), (6, 3), (6, 1), (5, 1), (5, 3), (4, 3), (4, 1), (3, 1), (3, 3), (0, 3)]
CORNERS_ON_SIDES = [(0, 0), (1, 0), (2, 0), (3, 0), (3, 1), (3, 2), (2, 2), (1, 2), (0, 2), (0, 1)]
CORNERS_ON_ONE_SIDE = [(0, 0), (1, 0), (2, 0), (3, 0), (0, 2)]
BRIDGED_HOLE = [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)]


@pytest.mark.parametrize(
    ("flat", "area"),
    [
        ([(0, 0), (4, 0), (1, 1), (0, 4)], 4.0),
        ([(0, 0), (2, 0), (4, 0), (0, 4)], 8.0),
        ([(0, 0), (2, 0), (4, 0), (4, 4), (0, 4)], 16.0),
        (COMB, 17.0),
        (CORNERS_ON_SIDES, 6.0),
        (CORNERS_ON_ONE_SIDE, 3.0),
        (BRIDGED_HOLE, 12.0),
    ],
    ids=["dart", "flat corner", "flat corner of a pentagon", "comb", "flat corners", "one side", "hole by a bridge"],
)
@pytest.mark.parametrize("reverse", [False, True])
def test_awkward_polygons_are_covered_wherever_they_begin(flat, area, reverse):
    points = np.column_stack([np.array(flat, float), np.zeros(len(flat))])[:: -1 if reverse else 1]
    for start in range(len(points)):
        corners = np.roll(points, start, axis=0)
        cut = triangulate(corners, np.array([len(corners)]), np.arange(len(corners)))
        areas = triangle_areas(corners, cut.triangles, np.array([0.0, 0.0, -1.0 if reverse else 1.0]))
        assert areas.min() > 0.0
        assert areas.sum() == pytest.approx(area)
        assert cut.tangled == 0


@EXAMPLES
@given(seed=seeds, outer=st.integers(3, 20), inner=st.integers(3, 20))
def test_a_hole_on_a_bridge_stays_open(seed, outer, inner):
    random = np.random.default_rng(seed)
    # Corners between 2.1 and 3 from the middle have all their sides beyond 1, where the hole ends.
    angle = 2.0 * np.pi * np.arange(outer) / outer
    border = random.uniform(2.1, 3.0, outer)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    hole = star(inner, random)
    first = math.atan2(hole[0, 1], hole[0, 0])
    hole = hole @ np.array([[math.cos(first), -math.sin(first)], [math.sin(first), math.cos(first)]])
    # The bridge goes outwards from the hole's first corner to the border's.
    hole = np.roll(hole[::-1], 1, axis=0)
    flat = np.concatenate([border, border[:1], hole, hole[:1]])
    points, normal = in_space(flat, random)
    cut = triangulate(points, np.array([len(flat)]), np.arange(len(flat)))
    areas = triangle_areas(points, cut.triangles, normal)
    assert cut.tangled == 0
    assert areas.min() > 0.0
    assert areas.sum() == pytest.approx(shoelace(border) + shoelace(hole))


@pytest.mark.parametrize(
    "flat",
    [
        [(0, 0), (2, 2), (2, 0), (0, 1.5)],
        [(math.cos(0.8 * math.pi * i), math.sin(0.8 * math.pi * i)) for i in range(5)],
    ],
    ids=["bow tie", "pentagram"],
)
def test_polygons_that_cross_themselves_are_counted(flat):
    points = np.column_stack([np.array(flat, float), np.zeros(len(flat))])
    cut = triangulate(points, np.array([len(flat)]), np.arange(len(flat)))
    assert (len(cut.triangles), cut.tangled) == (len(flat) - 2, 1)


def test_a_doubled_corner_costs_a_triangle_without_area():
    flat = [(0, 0), (2, 0), (2, 0), (2, 2), (1, 1), (0, 2)]
    for start in range(len(flat)):
        points = np.column_stack([np.roll(np.array(flat, float), start, axis=0), np.zeros(len(flat))])
        cut = triangulate(points, np.array([len(flat)]), np.arange(len(flat)))
        areas = triangle_areas(points, cut.triangles, np.array([0.0, 0.0, 1.0]))
        assert np.count_nonzero(areas == 0.0) == 1
        assert (areas.min(), areas.sum(), cut.tangled) == (0.0, 3.0, 0)


@EXAMPLES
@given(seed=seeds, corners=st.integers(4, 12), kind=st.sampled_from(["one point", "one line", "soup", "nan", "huge"]))
def test_any_corners_whatever_end_in_triangles(seed, corners, kind):
    random = np.random.default_rng(seed)
    points = random.normal(size=(corners, 3))
    match kind:
        case "one point":
            points[:] = points[0]
        case "one line":
            points[:, 1:] = 0.0
        case "nan":
            points[random.integers(corners)] = np.nan
        case "huge":
            points *= 1e200
    with np.errstate(all="ignore"):
        cut = triangulate(points, np.array([corners]), random.integers(0, corners, corners))
    assert cut.triangles.shape == (corners - 2, 3)


# Windings

BODIES: dict[str, Callable[[], trimesh.Trimesh]] = {
    "box": lambda: trimesh.creation.box((1, 2, 3)),
    "ball": lambda: trimesh.creation.icosphere(subdivisions=2),
    "ring": lambda: trimesh.creation.torus(2.0, 0.5, major_sections=12, minor_sections=8),
}


def shuffled_bodies(names: list[str], random: np.random.Generator) -> tuple[np.ndarray, np.ndarray, float]:
    """Closed bodies apart from each other with triangles in random order and sense: vertices, triangles, volume."""
    vertices, triangles, volume = [], [], 0.0
    for index, name in enumerate(names):
        body = BODIES[name]()
        volume += float(body.volume)
        triangles.append(np.asarray(body.faces) + sum(map(len, vertices)))
        vertices.append(np.asarray(body.vertices) + np.array([10.0 * index, 0.0, 0.0]))
    faces = random.permutation(np.concatenate(triangles))
    turned = random.random(len(faces)) < random.random()
    faces[turned] = faces[turned][:, ::-1]
    return np.concatenate(vertices), faces, volume


@EXAMPLES
@given(seed=seeds, names=st.lists(st.sampled_from(sorted(BODIES)), min_size=1, max_size=3), soup=st.booleans())
def test_closed_bodies_come_to_face_outwards_however_they_were_wound(seed, names, soup):
    random = np.random.default_rng(seed)
    vertices, faces, volume = shuffled_bodies(names, random)
    if soup:
        # As in STL, where every triangle has corners of its own.
        vertices, faces = vertices[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3)
    wound = wind_outwards(vertices, faces)
    mesh = trimesh.Trimesh(vertices, wound.triangles, process=False)
    mesh.merge_vertices()
    bodies = mesh.split(only_watertight=True)
    assert len(bodies) == len(names)
    assert all(body.is_winding_consistent and body.volume > 0.0 for body in bodies)
    assert mesh.volume == pytest.approx(volume)
    assert (wound.closed, wound.open, wound.unclear) == (len(faces), 0, 0)
    assert wound.flipped == np.count_nonzero((wound.triangles != faces).any(axis=1))
    assert np.array_equal(np.sort(wound.triangles, axis=1), np.sort(faces, axis=1))


def test_nothing_is_turned_where_all_is_well():
    vertices, faces, _ = shuffled_bodies(["ball", "box"], np.random.default_rng(0))
    right = wind_outwards(vertices, faces).triangles
    again = wind_outwards(vertices, right)
    assert again.flipped == 0
    assert np.array_equal(again.triangles, right)


def test_outside_is_found_far_from_the_origin():
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.1)
    for offset in (1e4, 1e7):
        wound = wind_outwards(ball.vertices + offset, np.asarray(ball.faces)[:, ::-1])
        assert wound.flipped == len(ball.faces)


def test_an_open_sheet_keeps_the_sense_of_its_majority():
    grid = scenes.rough_seabed(scenes.Extent(x_min=0, x_max=2, y_min=0, y_max=2), scenes.Roughness())
    turned = np.random.default_rng(1).random(len(grid.faces)) < 0.3
    turned[0] = True
    faces = np.where(turned[:, None], grid.faces[:, ::-1], grid.faces)
    wound = wind_outwards(grid.vertices, faces)
    assert np.array_equal(wound.triangles, grid.faces)
    assert (wound.flipped, wound.closed, wound.open, wound.unclear) == (turned.sum(), 0, len(faces), 0)


def test_poles_where_corners_meet_keep_a_ball_closed():
    rows, columns = 5, 8
    latitude, longitude = np.meshgrid(
        np.linspace(-0.5 * np.pi, 0.5 * np.pi, rows), 2.0 * np.pi * np.arange(columns) / columns, indexing="ij"
    )
    level = np.cos(latitude).round(12)
    ball = np.stack([level * np.cos(longitude), level * np.sin(longitude), np.sin(latitude)], axis=-1)
    node = np.arange(rows * columns).reshape(rows, columns)
    beside = np.roll(node, -1, axis=1)
    a, b, c, d = node[:-1], beside[:-1], beside[1:], node[1:]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    wound = wind_outwards(ball.reshape(-1, 3), faces)
    meet_at_poles = 2 * columns
    assert (wound.flipped, wound.closed) == (0, len(faces) - meet_at_poles)
    assert (wound.open, wound.unclear) == (0, 0)


def test_a_surface_of_one_side_is_left_and_counted():
    n = 12
    angle = 2.0 * np.pi * np.arange(n) / n
    middle = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)
    across = 0.2 * np.stack(
        [np.cos(angle / 2) * np.cos(angle), np.cos(angle / 2) * np.sin(angle), np.sin(angle / 2)], 1
    )
    vertices = np.concatenate([middle - across, middle + across])
    # After a whole turn the edges have changed sides.
    low = np.arange(n)
    high = low + n
    next_low, next_high = np.append(low[1:], high[0]), np.append(high[1:], low[0])
    faces = np.concatenate([np.stack([low, next_low, high], 1), np.stack([next_low, next_high, high], 1)])
    wound = wind_outwards(vertices, faces)
    assert np.array_equal(wound.triangles, faces)
    assert (wound.flipped, wound.unclear) == (0, len(faces))


def test_an_edge_of_three_triangles_makes_the_surface_unclear():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]], float)
    wound = wind_outwards(vertices, np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]]))
    assert (wound.flipped, wound.open, wound.unclear) == (0, 0, 3)


# Materials


def test_materials_multiply_and_say_where_their_numbers_are_from():
    for material in MATERIALS:
        assert material.impedance == material.density * material.sound_speed
        assert material.source
    words = [word for material in MATERIALS for word in material.words]
    assert len(set(words)) == len(words)
    by_name = {material.name: material.impedance for material in MATERIALS}
    assert by_name["sand"] == scenes.SAND
    assert by_name["rock"] == scenes.ROCK
    assert by_name["concrete"] == scenes.CONCRETE
    assert by_name["steel"] == scenes.STEEL
    # Sediments grow harder from clay to rock; all solids but cork and the softest reflect more than sand.
    order = ("clay", "silt", "sand", "gravel", "moraine", "chalk", "limestone", "rock")
    assert sorted(order, key=by_name.__getitem__) == list(order)


@pytest.mark.parametrize(
    ("name", "material"),
    [
        ("Sand", "sand"),
        ("M_Rock_01", "rock"),
        ("RustySTEEL", "steel"),
        ("STEEL_PIPE", "steel"),
        ("rusty-steel.002", "steel"),
        ("Aluminum6061", "aluminium"),
        ("muddy bottom", "clay"),
        ("rubber on steel", "steel"),
        ("sandstone", None),
        ("Sandra", None),
        ("", None),
        ("geometry_0", None),
        ("Ünïcode岩", None),
    ],
)
def test_a_name_is_looked_up_word_by_word(name, material):
    found = material_in(name)
    assert (found.name if found else None) == material


# Reports on files

CUBE = trimesh.creation.box((2, 2, 2))


def written(path: Path, mesh: trimesh.Trimesh) -> Path:
    mesh.export(path)
    return path


def test_a_sound_file_has_nothing_to_note_but_its_default(tmp_path):
    scene, report = scenes.read_scene(written(tmp_path / "thing.ply", CUBE))
    assert report.notes() == ["thing.ply: 12 faces of default impedance"]
    (part,) = report.parts
    assert (part.faces, part.copies, part.degenerate, part.flipped, part.open, part.unclear) == (12, 1, 0, 0, 0, 0)
    assert (report.reader, report.metres_per_unit, report.up) == ("trimesh", 1.0, "z")
    assert set(scene.impedance.tolist()) == {scenes.CONCRETE}
    assert scenes.SceneReport.from_dict(report.as_dict()) == report


def test_a_file_wound_inwards_is_turned_and_says_so(tmp_path):
    inside_out = trimesh.Trimesh(CUBE.vertices, CUBE.faces[:, ::-1], process=False)
    path = written(tmp_path / "thing.obj", inside_out)
    scene, report = scenes.read_scene(path)
    assert trimesh.Trimesh(scene.vertices, scene.faces).volume == pytest.approx(8.0)
    assert report.parts[0].flipped == 12
    kept, report = scenes.read_scene(path, winding="keep")
    assert trimesh.Trimesh(kept.vertices, kept.faces).volume == pytest.approx(-8.0)
    assert report.parts[0].flipped == 0


def test_faces_without_area_are_dropped_and_counted(tmp_path):
    path = tmp_path / "thing.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 0 0\nv 5000 0 0\nv 5000 1 0\nv 5000.00001 0 0\n"
                    "f 1 2 3\nf 1 1 2\nf 1 2 4\nf 5 7 6\n")  # fmt: skip
    scene, report = scenes.read_scene(path)
    # The last is thinner than single precision is there.
    assert (len(scene.faces), report.parts[0].degenerate) == (1, 3)
    assert "3 faces without area dropped" in report.notes()[0]


def test_materials_of_a_file_give_impedances(tmp_path):
    (tmp_path / "wreck.mtl").write_text("newmtl Old_Steel\nKd 1 0 0\nnewmtl Paint\nKd 0 1 0\n")
    path = tmp_path / "wreck.obj"
    path.write_text("mtllib wreck.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nusemtl Old_Steel\nf 1 2 3\n"
                    "usemtl Paint\nf 1 2 4\n")  # fmt: skip
    scene, report = scenes.read_scene(path, impedance=2e6)
    assert sorted(scene.impedance.tolist()) == [2e6, np.float32(scenes.STEEL)]
    assert {entry.source for part in report.parts for entry in part.impedances} == {
        "material Old_Steel: steel",
        "default",
    }


def test_a_name_gives_an_impedance_where_no_material_does(tmp_path):
    scene, report = scenes.read_scene(written(tmp_path / "rock.stl", CUBE))
    assert set(scene.impedance.tolist()) == {np.float32(scenes.ROCK)}
    assert report.parts[0].impedances[0].source == "name rock.stl: rock"


def test_a_file_with_y_up_is_turned_where_asked(tmp_path):
    path = written(tmp_path / "thing.glb", trimesh.creation.box(bounds=[[0, 0, 0], [1, 2, 3]]))
    assert np.allclose(scenes.scene_from_file(path).bounds(), [[0, 0, 0], [1, 2, 3]])
    turned = scenes.scene_from_file(path, up="y")
    assert np.allclose(turned.bounds(), [[0, -3, 0], [1, 0, 2]])
    assert trimesh.Trimesh(turned.vertices, turned.faces).volume == pytest.approx(6.0)


def test_a_mirrored_node_still_faces_outwards(tmp_path):
    mirror = np.diag([1.0, -1.0, 1.0, 1.0])
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.icosphere(subdivisions=2), transform=mirror)
    scene.export(tmp_path / "thing.glb")
    read, report = scenes.read_scene(tmp_path / "thing.glb")
    assert trimesh.Trimesh(read.vertices, read.faces).volume > 4.0
    assert report.parts[0].flipped == 0


@pytest.mark.parametrize("place", [(5e5, 4.2e6, -30.0), (1e7, 0.0, 0.0)])
def test_a_scene_in_map_coordinates_is_refused_with_an_origin_that_works(tmp_path, place):
    # PLY by hand: trimesh would write single precision.
    vertices = CUBE.vertices + np.array(place)
    lines = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}"]
    lines += [f"property double {axis}" for axis in "xyz"]
    lines += [f"element face {len(CUBE.faces)}", "property list uchar int vertex_indices", "end_header"]
    lines += [" ".join(repr(float(value)) for value in vertex) for vertex in vertices]
    lines += ["3 " + " ".join(map(str, face)) for face in CUBE.faces]
    path = tmp_path / "map.ply"
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(ValueError, match="must be within 10000 m of the origin: pass origin=") as refusal:
        scenes.scene_from_file(path)
    advice = re.search(r"origin=\(([^)]*)\)", str(refusal.value))
    assert advice is not None
    origin = tuple(float(value) for value in advice[1].split(","))
    scene = scenes.scene_from_file(path, origin=(origin[0], origin[1], origin[2]))
    assert np.array_equal(scene.bounds(), [[-1, -1, -1], [1, 1, 1]])


def test_a_million_triangles_are_read(tmp_path):
    side = 708
    x, y = np.meshgrid(np.arange(side), np.arange(side), indexing="ij")
    vertices = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    node = np.arange(side * side).reshape(side, side)
    a, b, c, d = node[:-1, :-1], node[1:, :-1], node[1:, 1:], node[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    path = written(tmp_path / "large.ply", trimesh.Trimesh(vertices, faces, process=False))
    scene = scenes.scene_from_file(path)
    assert len(scene.faces) == 2 * (side - 1) ** 2
    assert np.array_equal(scene.vertices, vertices)


# Refusals

NAN_PLY = (
    b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    b"element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 nan 0\n0 1 0\n3 0 1 2\n"
)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("empty.stl", b"", "empty.stl holds no triangles"),
        ("empty.obj", b"", "cannot read .*empty.obj as a mesh: |empty.obj holds no triangles"),
        ("nan.ply", NAN_PLY, r"nan.ply: nan.ply: vertex 1 at \[1.0, nan, 0.0\], must be finite"),
        ("inf.ply", NAN_PLY.replace(b"nan", b"inf"), r"vertex 1 at \[1.0, inf, 0.0\], must be finite"),
        ("far.ply", NAN_PLY.replace(b"nan", b"1e30"), r"coordinate of 1e\+30 m, must be within .*: scale to metres"),
        ("out.ply", NAN_PLY.replace(b"nan", b"0").replace(b"3 0 1 2", b"3 0 1 9"), r"index 9 at \[0, 2\]|cannot read"),
        ("point.ply", NAN_PLY.replace(b"1 nan 0", b"0 0 0").replace(b"0 1 0", b"0 0 0"), "all 1 have zero area"),
        ("latin.obj", "# Felsblöcke\nv 0 0".encode("latin-1"), "cannot read .*latin.obj as a mesh: |no triangles"),
        ("broken.zip", b"PK\x03\x04 what is this", "cannot read .*broken.zip as a mesh: "),
        ("no_suffix", b"v 0 0 0", "cannot read .*no_suffix as a mesh: "),
    ],
)
def test_what_makes_no_scene_is_refused_in_one_line(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=message) as refusal:
        scenes.scene_from_file(tmp_path / name)
    assert str(refusal.value).startswith("path: ")
    assert "\n" not in str(refusal.value)


def test_a_folder_is_no_file(tmp_path):
    with pytest.raises(ValueError, match="path: no file at"):
        scenes.scene_from_file(tmp_path)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"scale": 0.0}, "scale: 0.0, must be positive"),
        ({"scale": math.nan}, "scale: nan, must be positive"),
        ({"up": "x"}, "up: 'x', must be 'y', 'z' or None"),
        ({"origin": (0.0, 0.0)}, r"origin: expected shape \[3\], got \[2\]"),
        ({"origin": (0.0, math.inf, 0.0)}, r"origin: inf at \[1\], must be finite"),
        ({"impedance": 0.0}, "impedance: 0.0 rayl, must be positive"),
        ({"impedance": 1e40}, r"impedance: 1e\+40 rayl, must be positive and fit float32"),
        ({"winding": "flip"}, "winding: 'flip', must be 'repair' or 'keep'"),
        ({"segments": 2}, "segments: 2, must be 3 to 4096"),
        ({"time_code": math.nan}, "time_code: nan, must be finite"),
    ],
)
def test_an_option_that_cannot_be_is_refused_by_name(tmp_path, options, message):
    path = written(tmp_path / "thing.stl", CUBE)
    with pytest.raises(ValueError, match=message):
        scenes.read_scene(path, **options)


@pytest.mark.parametrize("suffix", ["obj", "stl", "ply", "glb", "off", "stl_ascii"])
@pytest.mark.parametrize("part", range(4))
def test_a_damaged_file_is_a_scene_or_one_line(tmp_path, suffix, part, capfd):
    body = trimesh.Scene([BODIES["box"](), BODIES["box"]().apply_translation([5, 0, 0])])
    exported = body.export(file_type=suffix) if suffix in ("glb", "obj") else body.to_mesh().export(file_type=suffix)
    whole = exported.encode() if isinstance(exported, str) else bytes(exported)
    random = np.random.default_rng([part, len(whole)])
    path = tmp_path / f"damaged.{suffix.removesuffix('_ascii')}"
    scenes_read, refusals = [], []
    for _ in range(60):
        path.write_bytes(damaged(whole, random))
        with warnings.catch_warnings():
            # Parsers may warn; this suite would make that an error.
            warnings.simplefilter("ignore")
            read, refusal = attempt(scenes.scene_from_file, path)
        if refusal is None:
            scenes_read.append(read)
        else:
            refusals.append(refusal)
    assert len(refusals) > 5
    assert all(re.match(r"path: [^\n]*damaged[^\n]*\Z", line) for line in refusals)
    assert all(np.isfinite(scene.vertices).all() for scene in scenes_read)
    assert capfd.readouterr() == ("", "")


def damaged(whole: bytes, random: np.random.Generator) -> bytes:
    """A file cut short, with bits or bytes changed, or with a run of bytes overwritten or left out."""
    content = bytearray(whole)
    place = int(random.integers(len(content)))
    match random.integers(4):
        case 0:
            return bytes(content[:place])
        case 1:
            for index in random.integers(len(content), size=random.choice([1, 4, 32])):
                content[index] ^= 1 << int(random.integers(8))
        case 2:
            for index in random.integers(len(content), size=random.choice([1, 4])):
                content[index] = int(random.integers(256))
        case _:
            length = int(random.integers(1, 64))
            fill = [b"\xff" * length, b"\0" * length, random.bytes(length), b""][random.integers(4)]
            content[place : place + length] = fill
    return bytes(content)


def test_collada_is_read_too(tmp_path):
    trimesh.creation.box(bounds=[[0, 0, 0], [1, 2, 3]]).export(tmp_path / "thing.dae")
    read, _ = scenes.read_scene(tmp_path / "thing.dae")
    assert len(read.faces) == 12
    assert np.allclose(read.bounds(), [[0, 0, 0], [1, 2, 3]])
