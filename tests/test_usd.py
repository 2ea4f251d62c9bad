"""OpenUSD in and out: what a stage shows is what a scene holds, and what is written comes back bit for bit."""

# pyright: reportAttributeAccessIssue=false
# OpenUSD fills its modules when they load, where no type checker sees it.

import math
import os
import subprocess
import sys
import textwrap
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdShade, UsdValidation, Vt
from scipy.spatial.transform import Rotation

import sonarwarp_scenes as scenes
from sonarwarp import PRESETS, PointCloud, plan_survey, simulate
from sonarwarp.app.cloud_usd import sonar_tracks, write_cloud_usd
from sonarwarp.cloud import NORMAL
from sonarwarp_scenes import Conversion, Scene, Trajectory, assets, child, read_stage
from sonarwarp_scenes.assets import asset, paper_deployments
from tests.attempts import attempt, count_inputs

EXAMPLES = settings(max_examples=60, deadline=None, derandomize=True, database=None)

seeds = st.integers(0, 2**32 - 1)

CUBE_POINTS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float32)
CUBE_SIDES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]


def new_stage(metres_per_unit: float = 1.0, up: str = "Z") -> Usd.Stage:
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, metres_per_unit)
    UsdGeom.SetStageUpAxis(stage, up)
    return stage


def add_cube(stage: Usd.Stage, path: str = "/Cube") -> UsdGeom.Mesh:
    """A cube of quads from -1 to 1."""
    return add_mesh(stage, path, CUBE_POINTS, CUBE_SIDES)


def add_mesh(stage: Usd.Stage, path: str, points: object, faces: list[list[int]]) -> UsdGeom.Mesh:
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(np.asarray(points, dtype=np.float32))
    mesh.CreateFaceVertexCountsAttr([len(face) for face in faces])
    mesh.CreateFaceVertexIndicesAttr([corner for face in faces for corner in face])
    mesh.CreateSubdivisionSchemeAttr("none")
    return mesh


def as_mesh(scene: Scene) -> trimesh.Trimesh:
    return trimesh.Trimesh(scene.vertices, scene.faces, process=False)


def corners(scene: Scene) -> np.ndarray:
    return scene.vertices[scene.faces]


def read(stage: Usd.Stage, **options: object) -> Scene:
    return read_stage(stage, Conversion(**options))[0]  # pyright: ignore[reportArgumentType]


def complaints(stage: Usd.Stage) -> list[str]:
    """What OpenUSD's own validation has against a stage, by every validator there is."""
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert len(validators) >= 20
    return [error.GetErrorAsString() for error in UsdValidation.ValidationContext(validators).Validate(stage)]


def test_the_validation_sees_a_fault():
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.Cube.Define(stage, "/Cube")
    assert complaints(stage)


# What a stage shows


@pytest.mark.parametrize(("up", "expected"), [("Z", [1.0, 2.0, 3.0]), ("Y", [1.0, -3.0, 2.0])])
@pytest.mark.parametrize("metres_per_unit", [1.0, 0.01])
def test_units_and_axes_are_those_of_the_stage(up, expected, metres_per_unit):
    stage = new_stage(metres_per_unit, up)
    points = np.array([[1, 2, 3], [2, 2, 3], [1, 3, 3]]) / metres_per_unit
    add_mesh(stage, "/Triangle", points, [[0, 1, 2]])
    scene, report = read_stage(stage)
    assert np.allclose(scene.vertices[0], expected)
    assert (report.metres_per_unit, report.up) == (metres_per_unit, up.lower())


def test_options_go_before_what_the_stage_says():
    stage = new_stage(0.01, "Y")
    add_mesh(stage, "/Triangle", [[1, 2, 3], [2, 2, 3], [1, 3, 3]], [[0, 1, 2]])
    assert np.allclose(read(stage, scale=1.0, up="z", origin=(1.0, 1.0, 1.0)).vertices[0], [0.0, 1.0, 2.0])


def test_a_stage_that_says_nothing_is_in_centimetres_with_y_up():
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.Cube.Define(stage, "/Cube").AddTranslateOp().Set(Gf.Vec3d(0, 100, 0))
    assert np.allclose(read(stage).bounds(), [[-0.01, -0.01, 0.99], [0.01, 0.01, 1.01]])


@EXAMPLES
@given(seed=seeds, depth=st.integers(0, 4), up=st.sampled_from("YZ"), left_handed=st.booleans())
def test_a_body_stands_where_its_transforms_put_it_and_faces_outwards(seed, depth, up, left_handed):
    random = np.random.default_rng(seed)
    metres_per_unit = float(random.uniform(0.5, 2.0))
    stage = new_stage(metres_per_unit, up)
    expected, path = np.eye(4), ""
    for level in range(depth):
        path += f"/Level{level}"
        frame = UsdGeom.Xform.Define(stage, path)
        shift, turn = random.normal(size=3), Rotation.random(random_state=random)
        scale = random.uniform(0.5, 2.0, 3) * random.choice([-1.0, 1.0], 3)
        x, y, z, w = turn.as_quat().tolist()
        frame.AddTranslateOp().Set(Gf.Vec3d(*shift.tolist()))
        frame.AddOrientOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Quatd(w, x, y, z))
        frame.AddScaleOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(*scale.tolist()))
        local = np.eye(4)
        local[:3, :3], local[:3, 3] = turn.as_matrix() @ np.diag(scale), shift
        expected = expected @ local
    mesh = add_cube(stage, path + "/Cube")
    if left_handed:
        mesh.CreateOrientationAttr("leftHanded")
        mesh.CreateFaceVertexIndicesAttr([corner for side in CUBE_SIDES for corner in reversed(side)])
    # What is wound rightly needs no repair, however it is mirrored.
    scene = read(stage, winding="keep")
    world = metres_per_unit * (CUBE_POINTS @ expected[:3, :3].T + expected[:3, 3])
    if up == "Y":
        world = world @ Rotation.from_euler("x", 90, degrees=True).as_matrix().T
    assert np.allclose(scene.vertices, world, atol=1e-12)
    volume = 8.0 * abs(np.linalg.det(expected)) * metres_per_unit**3
    assert as_mesh(scene).volume == pytest.approx(volume)
    assert as_mesh(scene).is_winding_consistent


def test_a_stack_that_is_reset_forgets_what_is_above():
    stage = new_stage()
    UsdGeom.Xform.Define(stage, "/Far").AddTranslateOp().Set(Gf.Vec3d(100, 0, 0))
    cube = add_cube(stage, "/Far/Cube")
    cube.AddTranslateOp().Set(Gf.Vec3d(0, 5, 0))
    cube.SetResetXformStack(True)
    assert np.allclose(read(stage).bounds(), [[-1, 4, -1], [1, 6, 1]])


@pytest.mark.parametrize(("time_code", "x"), [(None, 10.0), (1.0, 10.0), (3.0, 30.0), (2.0, 20.0), (99.0, 50.0)])
def test_a_moving_body_is_read_at_the_time_asked_for(time_code, x):
    stage = new_stage()
    shift = add_cube(stage).AddTranslateOp()
    for code in (1, 3, 5):
        shift.Set(Gf.Vec3d(10 * code, 0, 0), code)
    assert read(stage, time_code=time_code).bounds().mean(axis=0)[0] == pytest.approx(x)


def test_a_stage_is_read_at_its_start_unless_told_otherwise():
    stage = new_stage()
    stage.SetStartTimeCode(3)
    stage.SetEndTimeCode(5)
    shift = add_cube(stage).AddTranslateOp()
    shift.Set(Gf.Vec3d(10, 0, 0), 1)
    shift.Set(Gf.Vec3d(30, 0, 0), 3)
    assert read(stage).bounds().mean(axis=0)[0] == pytest.approx(30.0)


def test_what_is_not_drawn_is_left_out_and_named():
    stage = new_stage()
    add_cube(stage, "/Seen")
    add_cube(stage, "/Hidden/Cube")
    UsdGeom.Xform.Define(stage, "/Hidden").MakeInvisible()
    UsdGeom.Imageable(stage.GetPrimAtPath("/Hidden/Cube")).CreateVisibilityAttr("inherited")
    add_cube(stage, "/Guide").CreatePurposeAttr("guide")
    UsdGeom.Xform.Define(stage, "/Proxy").CreatePurposeAttr("proxy")
    add_cube(stage, "/Proxy/Cube")
    add_cube(stage, "/Render").CreatePurposeAttr("render")
    add_cube(stage, "/Off").GetPrim().SetActive(False)
    UsdGeom.Points.Define(stage, "/Points")
    stage.CreateClassPrim("/Class")
    add_cube(stage, "/Class/Cube")
    _, report = read_stage(stage)
    assert [part.name for part in report.parts] == ["/Seen", "/Render"]
    assert report.skipped == (
        "/Hidden: invisible",
        "/Guide: of purpose guide",
        "/Proxy/Cube: of purpose proxy",
        "/Points: a Points is no mesh",
    )


def test_a_mesh_below_a_mesh_is_read_too():
    stage = new_stage()
    add_cube(stage, "/Outer")
    add_cube(stage, "/Outer/Inner").AddTranslateOp().Set(Gf.Vec3d(9, 0, 0))
    assert len(read(stage).faces) == 24


def test_native_instances_stand_wherever_they_are_placed():
    stage = new_stage()
    add_cube(stage, "/Prototype/Cube")
    stage.GetPrimAtPath("/Prototype").SetSpecifier(Sdf.SpecifierClass)
    for index in range(3):
        instance = UsdGeom.Xform.Define(stage, f"/Instance{index}")
        instance.AddTranslateOp().Set(Gf.Vec3d(10.0 * index, 0, 0))
        instance.GetPrim().GetReferences().AddInternalReference("/Prototype")
        instance.GetPrim().SetInstanceable(True)
    scene, report = read_stage(stage)
    assert [part.name for part in report.parts] == [f"/Instance{index}/Cube" for index in range(3)]
    assert np.allclose(scene.bounds(), [[-1, -1, -1], [21, 1, 1]])
    assert as_mesh(scene).volume == pytest.approx(24.0)


def add_instancer(stage: Usd.Stage, path: str, places: list[tuple[float, float, float]]) -> UsdGeom.PointInstancer:
    instancer = UsdGeom.PointInstancer.Define(stage, path)
    instancer.CreateProtoIndicesAttr([0] * len(places))
    instancer.CreatePositionsAttr(places)
    return instancer


def test_a_point_instancer_places_turns_scales_and_hides_its_prototypes():
    stage = new_stage()
    instancer = add_instancer(stage, "/Field", [(0, 0, 0), (10, 0, 0), (20, 0, 0), (30, 0, 0)])
    instancer.AddTranslateOp().Set(Gf.Vec3d(0, 0, 100))
    cube = add_cube(stage, "/Field/Stone")
    cube.AddScaleOp().Set(Gf.Vec3f(2, 1, 1))
    UsdGeom.Sphere.Define(stage, "/Field/Unused")
    instancer.CreatePrototypesRel().SetTargets(["/Field/Stone", "/Field/Unused"])
    instancer.CreateScalesAttr([(1, 1, 1), (1, -1, 1), (1, 1, 1), (1, 1, 1)])
    quarter = Gf.Quath(math.sqrt(0.5), 0, 0, math.sqrt(0.5))
    instancer.CreateOrientationsAttr([Gf.Quath(1, 0, 0, 0), Gf.Quath(1, 0, 0, 0), quarter, Gf.Quath(1, 0, 0, 0)])
    instancer.CreateInvisibleIdsAttr([3])
    scene, report = read_stage(stage, Conversion(winding="keep"))
    (part,) = report.parts
    assert (part.name, part.copies, part.faces) == ("/Field/Stone", 3, 36)
    expected = [[(-2, -1), (2, 1)], [(8, -1), (12, 1)], [(19, -2), (21, 2)]]
    for copy, box in enumerate(expected):
        body = trimesh.Trimesh(scene.vertices, scene.faces[12 * copy : 12 * copy + 12]).process()
        assert np.allclose(body.bounds[:, :2], box, atol=2e-3)  # half-precision quaternions
        assert np.allclose(body.bounds[:, 2], [99, 101])
        assert body.volume == pytest.approx(16.0, rel=2e-3)


def test_instancers_of_instancers_multiply():
    stage = new_stage()
    outer = add_instancer(stage, "/Outer", [(0, 0, 0), (0, 100, 0)])
    inner = add_instancer(stage, "/Outer/Inner", [(0, 0, 0), (10, 0, 0), (20, 0, 0)])
    outer.CreateScalesAttr([(2, 1, 1)] * 2)
    add_cube(stage, "/Outer/Inner/Cube").AddTranslateOp().Set(Gf.Vec3d(0, 0, 5))
    outer.CreatePrototypesRel().SetTargets(["/Outer/Inner"])
    inner.CreatePrototypesRel().SetTargets(["/Outer/Inner/Cube"])
    scene, report = read_stage(stage)
    assert (report.parts[0].copies, len(scene.faces)) == (6, 72)
    middles = scene.vertices.reshape(6, 8, 3).mean(axis=1)
    assert {tuple(place) for place in middles.round(6).tolist()} == {(x, y, 5) for x in (0, 20, 40) for y in (0, 100)}


# True volumes of OpenUSD's shapes of unit sizes, and how far 64 segments fall short of them at most.
SOLIDS = {
    "Cube": ({"size": 2.0}, 8.0, 0.0),
    "Sphere": ({"radius": 1.0}, 4 / 3 * math.pi, 0.005),
    "Cylinder": ({"radius": 1.0, "height": 2.0}, 2 * math.pi, 0.002),
    "Cone": ({"radius": 1.0, "height": 3.0}, math.pi, 0.002),
    "Capsule": ({"radius": 1.0, "height": 2.0}, 2 * math.pi + 4 / 3 * math.pi, 0.004),
    "Cylinder_1": ({"radiusBottom": 1.0, "radiusTop": 0.5, "height": 3.0}, math.pi * 1.75, 0.002),
    "Capsule_1": ({"radiusBottom": 1.0, "radiusTop": 1.0, "height": 2.0}, 2 * math.pi + 4 / 3 * math.pi, 0.004),
}


@pytest.mark.parametrize("kind", SOLIDS)
def test_a_shape_is_closed_and_a_little_smaller_than_its_closed_form(kind):
    sizes, volume, short = SOLIDS[kind]
    stage = new_stage()
    shape = getattr(UsdGeom, kind).Define(stage, "/Shape")
    for name, size in sizes.items():
        shape.GetPrim().GetAttribute(name).Set(size)
    mesh = as_mesh(read(stage, winding="keep"))
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert volume * (1.0 - short) <= mesh.volume * (1.0 + 1e-12)
    assert mesh.volume <= volume * (1.0 + 1e-12)


@pytest.mark.parametrize(("axis", "box"), [("X", (5, 1, 1)), ("Y", (1, 5, 1)), ("Z", (1, 1, 5))])
def test_a_shape_lies_along_its_axis(axis, box):
    stage = new_stage()
    UsdGeom.Cone.Define(stage, "/Cone")
    cone = UsdGeom.Cone(stage.GetPrimAtPath("/Cone"))
    cone.CreateHeightAttr(10.0)
    cone.CreateRadiusAttr(1.0)
    cone.CreateAxisAttr(axis)
    scene = read(stage)
    assert np.allclose(scene.bounds(), [-np.array(box), box])
    # The tip points along the axis: there is one corner there, and a ring at the other end.
    along = scene.vertices[:, "XYZ".index(axis)]
    assert (np.count_nonzero(along > 4.9), np.count_nonzero(along < -4.9)) == (1, 64)
    assert as_mesh(scene).volume > 0.0


@pytest.mark.parametrize(("axis", "size"), [("X", (0, 3, 2)), ("Y", (2, 0, 3)), ("Z", (2, 3, 0))])
def test_a_plane_faces_along_its_axis(axis, size):
    stage = new_stage()
    plane = UsdGeom.Plane.Define(stage, "/Plane")
    plane.CreateWidthAttr(2.0)
    plane.CreateLengthAttr(3.0)
    plane.CreateAxisAttr(axis)
    scene = read(stage)
    assert np.allclose(np.ptp(scene.bounds(), axis=0), size)
    assert np.allclose(as_mesh(scene).face_normals, np.eye(3)["XYZ".index(axis)])


def test_finer_segments_come_nearer_to_the_true_shape():
    stage = new_stage()
    UsdGeom.Sphere.Define(stage, "/Sphere")
    missing = [4 / 3 * math.pi - as_mesh(read(stage, segments=n)).volume for n in (16, 32, 64)]
    # Twice the segments miss a quarter.
    assert missing[0] / missing[1] == pytest.approx(4.0, rel=0.05)
    assert missing[1] / missing[2] == pytest.approx(4.0, rel=0.05)


@EXAMPLES
@given(holes=st.sets(st.integers(0, 5), max_size=5))
def test_holes_are_open(holes):
    stage = new_stage()
    add_cube(stage).CreateHoleIndicesAttr(sorted(holes))
    scene, report = read_stage(stage)
    normals = {tuple(normal) for normal in as_mesh(scene).face_normals.round(6).tolist()}
    sides = [(-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0), (0, 0, -1), (0, 0, 1)]
    assert normals == {side for index, side in enumerate(sides) if index not in holes}
    assert report.parts[0].degenerate == 0
    assert (report.parts[0].open == 0) == (not holes)


def test_faces_of_two_corners_are_dropped_and_counted():
    stage = new_stage()
    add_mesh(stage, "/Mesh", CUBE_POINTS, [*CUBE_SIDES, [0, 1], [3], [2, 2, 3], [0, 1, 0]])
    scene, report = read_stage(stage)
    assert len(scene.faces) == 12
    assert report.parts[0].degenerate == 4


def test_a_face_turned_over_is_turned_back_and_counted():
    stage = new_stage()
    add_mesh(stage, "/Mesh", CUBE_POINTS, [CUBE_SIDES[0][::-1], *CUBE_SIDES[1:]])
    scene, report = read_stage(stage)
    assert as_mesh(scene).volume == pytest.approx(8.0)
    assert report.parts[0].flipped == 2
    assert "/Mesh: 2 triangles turned over" in report.notes()


def test_subdivision_is_ignored_and_named():
    stage = new_stage()
    add_cube(stage).CreateSubdivisionSchemeAttr("catmullClark")
    scene, report = read_stage(stage)
    assert as_mesh(scene).volume == pytest.approx(8.0)
    assert "/Cube: subdivision catmullClark ignored" in report.notes()


# Impedances


def state(prim: Usd.Prim, impedance: float) -> None:
    prim.CreateAttribute("sonarwarp:acoustic:impedance", Sdf.ValueTypeNames.Float).Set(impedance)


def bind(prim: Usd.Prim, name: str) -> Usd.Prim:
    material = UsdShade.Material.Define(prim.GetStage(), f"/Looks/{name}")
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(material)
    return material.GetPrim()


def impedance_world() -> tuple[Usd.Stage, Usd.Prim, Usd.Prim]:
    stage = new_stage()
    above = UsdGeom.Xform.Define(stage, "/World/Gravel_Pit").GetPrim()
    return stage, above, add_cube(stage, "/World/Gravel_Pit/Wooden_Crate").GetPrim()


def set_primvar(prim: Usd.Prim, values: list[float], interpolation: str) -> UsdGeom.Primvar:
    primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar("acousticImpedance", Sdf.ValueTypeNames.FloatArray, interpolation)
    primvar.Set(values)
    return primvar


def test_the_nearest_and_most_explicit_word_on_impedance_counts():
    stage, above, cube = impedance_world()

    def told() -> tuple[float, str]:
        scene, report = read_stage(stage, Conversion(impedance=2e6))
        (entry,) = report.parts[0].impedances
        assert set(scene.impedance.tolist()) == {np.float32(entry.lowest)}
        assert (entry.faces, entry.lowest) == (12, entry.highest)
        return entry.lowest, entry.source

    # From the weakest source to the strongest.
    path = "/World/Gravel_Pit/Wooden_Crate"
    assert told() == (720.0 * 4000.0, f"name of {path}: wood")
    material = bind(cube, "Rusty_Steel")
    assert told() == (scenes.STEEL, "name of /Looks/Rusty_Steel: steel")
    state(material, 3e6)
    assert told() == (3e6, "sonarwarp:acoustic:impedance of /Looks/Rusty_Steel")
    state(above, 4e6)
    assert told() == (4e6, "sonarwarp:acoustic:impedance of /World/Gravel_Pit")
    set_primvar(above, [5e6], "constant")
    assert told() == (5e6, "primvars:acousticImpedance of /World/Gravel_Pit")
    state(cube, 6e6)
    assert told() == (6e6, f"sonarwarp:acoustic:impedance of {path}")
    primvar = set_primvar(cube, [7e6], "constant")
    assert told() == (7e6, f"primvars:acousticImpedance of {path}")
    primvar.SetInterpolation("uniform")
    primvar.Set([8e6] * 6)
    assert told() == (8e6, f"primvars:acousticImpedance of {path}")


def test_a_name_above_counts_where_the_mesh_has_none_that_says_anything():
    stage = new_stage()
    add_cube(stage, "/World/Gravel_Pit/Part_3/Mesh")
    add_cube(stage, "/World/Thing")
    scene, report = read_stage(stage)
    assert scene.impedance[0] == np.float32(2000.0 * 1800.0)
    assert report.parts[0].impedances[0].source == "name of /World/Gravel_Pit: gravel"
    assert report.parts[1].impedances[0].source == "default"


def test_an_impedance_per_face_reaches_the_triangles_of_that_face():
    stage = new_stage()
    mesh = add_cube(stage)
    mesh.CreateHoleIndicesAttr([1])
    values = [1e6, 2e6, 3e6, 4e6, 5e6, 6e6]
    set_primvar(mesh.GetPrim(), values, "uniform")
    scene, report = read_stage(stage)
    sides = {(-1, 0, 0): 1e6, (0, -1, 0): 3e6, (0, 1, 0): 4e6, (0, 0, -1): 5e6, (0, 0, 1): 6e6}
    for normal, impedance in zip(as_mesh(scene).face_normals.round(6).tolist(), scene.impedance, strict=True):
        assert sides[tuple(normal)] == impedance
    (entry,) = report.parts[0].impedances
    assert (entry.faces, entry.lowest, entry.highest) == (10, 1e6, 6e6)


def test_an_indexed_primvar_is_looked_up():
    stage = new_stage()
    set_primvar(add_cube(stage).GetPrim(), [1e6, 2e6], "uniform").SetIndices(Vt.IntArray([0, 1, 1, 1, 1, 1]))
    assert sorted(read(stage).impedance.tolist()) == [1e6] * 2 + [2e6] * 10


def test_subsets_have_materials_of_their_own():
    stage = new_stage()
    cube = add_cube(stage)
    bind(cube.GetPrim(), "Concrete")
    api = UsdShade.MaterialBindingAPI(cube)
    for name, faces, material in (("Top", [5], "Sand"), ("Low", [4], "Paint"), ("Side", [0, 1], "Steel")):
        bind(api.CreateMaterialBindSubset(name, Vt.IntArray(faces)).GetPrim(), material)
    state(stage.GetPrimAtPath("/Cube/Low"), 9e6)
    scene, report = read_stage(stage)
    faces = {"sand": 2, "low": 2, "steel": 4, "concrete": 4}
    found = {"sand": scenes.SAND, "low": 9e6, "steel": scenes.STEEL, "concrete": scenes.CONCRETE}
    for name, count in faces.items():
        assert np.count_nonzero(scene.impedance == np.float32(found[name])) == count
    assert {entry.source: entry.faces for entry in report.parts[0].impedances} == {
        "name of /Looks/Concrete: concrete": 4,
        "name of /Looks/Sand: sand": 2,
        "sonarwarp:acoustic:impedance of /Cube/Low": 2,
        "name of /Looks/Steel: steel": 4,
    }
    # A number for the mesh goes before its subsets' materials, but not before their numbers.
    state(cube.GetPrim(), 7e6)
    assert sorted(read(stage).impedance.tolist()) == [7e6] * 10 + [9e6] * 2


# Refusals


def faulty(change: object) -> Usd.Stage:
    stage = new_stage()
    change(stage, add_cube(stage, "/World/Cube"))  # pyright: ignore[reportCallIssue]
    return stage


def give(name: str, kind: Sdf.ValueTypeName, value: object) -> object:
    """Sets an attribute of the cube, whatever its schema says of the type."""

    def change(stage: Usd.Stage, mesh: UsdGeom.Mesh) -> None:
        mesh.GetPrim().RemoveProperty(name)
        spec = stage.GetRootLayer().GetPrimAtPath(mesh.GetPath())
        Sdf.AttributeSpec(spec, name, kind).default = kind.type.pythonClass(value) if kind.isArray else value

    return change


def endless(stage: Usd.Stage, mesh: UsdGeom.Mesh) -> None:
    outer = add_instancer(stage, "/Outer", [(0, 0, 0)])
    UsdGeom.Xform.Define(stage, "/Outer/Group")
    inner = add_instancer(stage, "/Outer/Group/Inner", [(0, 0, 0)])
    outer.CreatePrototypesRel().SetTargets(["/Outer/Group"])
    inner.CreatePrototypesRel().SetTargets(["/Outer"])


def countless(stage: Usd.Stage, mesh: UsdGeom.Mesh) -> None:
    path = ""
    for level in range(12):
        path += f"/Level{level}"
        target = f"{path}/Level{level + 1}" if level < 11 else "/World/Cube"
        add_instancer(stage, path, [(0, 0, 0)] * 10).CreatePrototypesRel().SetTargets([target])


def instancer(**attributes: object) -> object:
    def change(stage: Usd.Stage, mesh: UsdGeom.Mesh) -> None:
        instancer = add_instancer(stage, "/Field", [(0, 0, 0), (1, 0, 0)])
        instancer.CreatePrototypesRel().SetTargets(["/World/Cube"])
        for name, value in attributes.items():
            instancer.GetPrim().GetAttribute(name).Set(value)

    return change


TYPES = Sdf.ValueTypeNames
FAULTS = {
    "empty": (lambda stage, mesh: stage.RemovePrim("/World"), "the stage holds no triangles"),
    "no points": (give("points", TYPES.Point3fArray, []), "faceVertexIndices: index 0 at [0], must be in 0..-1"),
    "no faces": (
        lambda stage, mesh: [mesh.CreateFaceVertexCountsAttr([]), mesh.CreateFaceVertexIndicesAttr([])],
        "the stage holds no triangles",
    ),
    "only points": (
        lambda stage, mesh: [stage.RemovePrim("/World"), UsdGeom.Points.Define(stage, "/Points")],
        "the stage holds no triangles; /Points: a Points is no mesh",
    ),
    "nan": (
        give("points", TYPES.Point3fArray, [(0, 0, 0)] * 7 + [(0, math.nan, 0)]),
        "/World/Cube: points: vertex 7 at [0.0, nan, 0.0], must be finite",
    ),
    "infinite": (give("points", TYPES.Point3fArray, [(math.inf, 0, 0)] * 8), "vertex 0 at [inf, 0.0, 0.0]"),
    "one place": (give("points", TYPES.Point3fArray, [(1, 1, 1)] * 8), "faces: all 12 have zero area"),
    "far": (
        lambda stage, mesh: mesh.AddTranslateOp().Set(Gf.Vec3d(1e7, 0, 0)),
        "/World/Cube: coordinate of 1e+07 m, must be within 10000 m of the origin: pass origin=(10000000, 0, 0)",
    ),
    "large": (
        lambda stage, mesh: UsdGeom.SetStageMetersPerUnit(stage, 1e6),
        "/World/Cube: coordinate of 1e+06 m, must be within 10000 m of the origin: scale to metres",
    ),
    "overflow": (
        lambda stage, mesh: mesh.AddScaleOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(1e200, 1e200, 1e200)),
        "/World/Cube: coordinate of 1e+200 m",
    ),
    "transform": (
        lambda stage, mesh: mesh.AddTranslateOp().Set(Gf.Vec3d(math.nan, 0, 0)),
        "/World/Cube: transform with values that are not finite",
    ),
    "flat transform": (
        lambda stage, mesh: mesh.AddScaleOp().Set(Gf.Vec3f(0, 0, 1)),
        "faces: all 12 have zero area",
    ),
    "index": (
        give("faceVertexIndices", TYPES.IntArray, [*range(23), 8]),
        "/World/Cube: faceVertexIndices: index 8 at [8], must be in 0..7",
    ),
    "negative index": (
        give("faceVertexIndices", TYPES.IntArray, [0] * 23 + [-1]),
        "/World/Cube: faceVertexIndices: index -1 at [23], must be in 0..7",
    ),
    "sum": (
        give("faceVertexCounts", TYPES.IntArray, [4] * 5),
        "/World/Cube: faceVertexCounts: sum of 20, must be the 24 of faceVertexIndices",
    ),
    "sum past 32 bits": (
        give("faceVertexCounts", TYPES.IntArray, [2**31 - 1] * 2 + [26]),
        "faceVertexCounts: sum of 4294967320, must be the 24",
    ),
    "negative count": (
        give("faceVertexCounts", TYPES.IntArray, [4, -4, 4]),
        "/World/Cube: faceVertexCounts: -4 at [1], must be at least 0",
    ),
    "hole": (
        lambda stage, mesh: mesh.CreateHoleIndicesAttr([6]),
        "/World/Cube: holeIndices: index 6 at [0], must be in 0..5",
    ),
    "counts of words": (
        give("faceVertexCounts", TYPES.StringArray, ["four"] * 6),
        "/World/Cube: faceVertexCounts: a StringArray, must be a list of whole numbers",
    ),
    "indices with fractions": (
        give("faceVertexIndices", TYPES.FloatArray, [0.5] * 24),
        "/World/Cube: faceVertexIndices: a FloatArray, must be a list of whole numbers",
    ),
    "points of two": (
        give("points", TYPES.Float2Array, [(0, 0)] * 8),
        "/World/Cube: points: a Vec2fArray, must be a list of vectors",
    ),
    "impedance": (
        lambda stage, mesh: state(mesh.GetPrim(), -1.0),
        "/World/Cube: sonarwarp:acoustic:impedance: -1.0 rayl, must be positive",
    ),
    "impedance in words": (
        give("sonarwarp:acoustic:impedance", TYPES.String, "hard"),
        "/World/Cube: sonarwarp:acoustic:impedance: hard, must be one number",
    ),
    "primvar length": (
        lambda stage, mesh: set_primvar(mesh.GetPrim(), [1e6] * 5, "uniform"),
        "/World/Cube: primvars:acousticImpedance: 5 values, must be one per face, 6",
    ),
    "primvar value": (
        lambda stage, mesh: set_primvar(mesh.GetPrim(), [1e6] * 5 + [math.nan], "uniform"),
        "/World/Cube: primvars:acousticImpedance[5]: nan rayl, must be positive",
    ),
    "primvar per vertex": (
        lambda stage, mesh: set_primvar(mesh.GetPrim(), [1e6] * 8, "vertex"),
        "/World/Cube: primvars:acousticImpedance: interpolation vertex, must be constant or uniform",
    ),
    "two constants": (
        lambda stage, mesh: set_primvar(mesh.GetPrim(), [1e6] * 2, "constant"),
        "/World/Cube: primvars:acousticImpedance: 2 values, must be 1 where constant",
    ),
    "primvar of words": (
        give("primvars:acousticImpedance", TYPES.StringArray, ["hard"]),
        "/World/Cube: primvars:acousticImpedance: hard, must be one number",
    ),
    "units": (lambda stage, mesh: UsdGeom.SetStageMetersPerUnit(stage, -1.0), "metersPerUnit: -1.0, must be positive"),
    "axis": (lambda stage, mesh: stage.SetMetadata("upAxis", "X"), "upAxis: X, must be Y or Z"),
    "shape": (
        lambda stage, mesh: UsdGeom.Sphere.Define(stage, "/Ball").CreateRadiusAttr(-1.0),
        "/Ball: radius: -1.0, must be at least 0 and finite",
    ),
    "shape's axis": (
        lambda stage, mesh: UsdGeom.Cone.Define(stage, "/Cone").CreateAxisAttr("W"),
        "/Cone: axis: W, must be X, Y or Z",
    ),
    "missing reference": (
        lambda stage, mesh: mesh.GetPrim().GetReferences().AddReference("./nowhere.usd"),
        "Could not open asset @nowhere.usd@ for reference introduced by",
    ),
    "prototype's index": (instancer(protoIndices=[0, 1]), "/Field: protoIndices: index 1 at [1], must be in 0..0"),
    "positions": (instancer(positions=[(0, 0, 0)]), "/Field: positions: 1 entries, must be the 2 of protoIndices"),
    "orientations": (instancer(orientations=[Gf.Quath(1, 0, 0, 0)]), "/Field: orientations: 1 entries, must be the 2"),
    "no prototype": (
        lambda stage, mesh: add_instancer(stage, "/F", [(0, 0, 0)]).CreatePrototypesRel().SetTargets(["/Gone"]),
        "/F: prototypes: no prim at /Gone",
    ),
    "endless instances": (endless, "/Outer: prototypes: hold the instancer itself, must not"),
    "countless instances": (countless, "must be at most 67108864: leave parts or instances out"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_in_a_stage_is_refused_by_name(fault):
    change, message = FAULTS[fault]
    with pytest.raises(ValueError) as refusal:  # noqa: PT011 - the whole message is compared below
        read_stage(faulty(change))
    assert message in str(refusal.value)
    assert "\n" not in str(refusal.value)


# Files


def test_a_file_and_an_open_stage_give_one_scene(tmp_path):
    stage = new_stage(0.5, "Y")
    add_cube(stage, "/World/Rock").AddTranslateOp().Set(Gf.Vec3d(3, 4, 5))
    for suffix in ("usda", "usdc", "usd"):
        path = tmp_path / f"stage.{suffix}"
        stage.Export(str(path))
        scene, report = scenes.read_scene(path)
        expected, expected_report = read_stage(stage)
        for name in ("vertices", "faces", "impedance"):
            assert np.array_equal(getattr(scene, name), getattr(expected, name))
        assert report == expected_report


def test_a_file_brings_in_what_it_refers_to(tmp_path):
    stone = new_stage()
    stone.SetDefaultPrim(add_cube(stone, "/Rock").GetPrim())
    stone.Export(str(tmp_path / "rock.usdc"))
    stage = Usd.Stage.CreateNew(str(tmp_path / "field.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, "Z")
    stage.DefinePrim("/A").GetReferences().AddReference("./rock.usdc")
    stage.DefinePrim("/B").GetPayloads().AddPayload("./rock.usdc")
    stage.Save()
    assert len(scenes.scene_from_file(tmp_path / "field.usda").faces) == 24
    (tmp_path / "rock.usdc").unlink()
    with pytest.raises(ValueError, match=r"path: .*field.usda: Could not open asset @.*rock.usdc@ for reference"):
        scenes.scene_from_file(tmp_path / "field.usda")


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("empty.usda", b"", "cannot read .*empty.usda as OpenUSD: "),
        ("empty.usdc", b"", "cannot read .*empty.usdc as OpenUSD: "),
        ("words.usd", b"what is this", "cannot read .*words.usd as OpenUSD: "),
        ("short.usda", b'#usda 1.0\ndef Mesh "M" {', "cannot read .*short.usda as OpenUSD: "),
        ("zeros.usdc", b"PXR-USDC" + bytes(200), "cannot read .*zeros.usdc as OpenUSD: "),
        ("broken.usdz", b"PK\x03\x04", "cannot read .*broken.usdz as OpenUSD: "),
        ("bare.USDA", b"#usda 1.0\n", "bare.USDA: the stage holds no triangles"),
    ],
)
def test_an_unusable_file_is_refused_in_one_line(tmp_path, name, content, message, capfd):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=f"path: .*{message}") as refusal:
        scenes.scene_from_file(tmp_path / name)
    assert "\n" not in str(refusal.value)
    # OpenUSD's own complaints do not reach the terminal.
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("os.kill(os.getpid(), signal.SIGSEGV)", r"its reader died \(SIGSEGV\): the file is damaged"),
        ("os._exit(3)", r"its reader died \(exit code 3\)"),
        ("time.sleep(60)", "not done after 1 s, the file may be damaged"),
        ("print('noise', flush=True)\nraise RuntimeError('two\\nlines')", "as OpenUSD: two lines"),
        ("raise MemoryError", "needs more memory than there is"),
    ],
)
def test_a_reader_that_dies_takes_nothing_else_with_it(tmp_path, monkeypatch, body, message):
    # A package that the child imports in place of OpenUSD's.
    (tmp_path / "pxr").mkdir()
    (tmp_path / "pxr/__init__.py").write_text(f"import os, signal, time\n{body}\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(child, "_PATIENCE", 1.0)
    path = tmp_path / "stage.usda"
    path.write_text("#usda 1.0\n")
    with pytest.raises(ValueError, match=f"path: .*stage.usda.*{message}"):
        scenes.scene_from_file(path)


# Reads damaged files one after the other, each in a fork of this process, and prints how each ended.
DAMAGE = """
import os, resource, signal, sys
import numpy as np
from pxr import Tf, Usd
from sonarwarp_scenes import Conversion
from sonarwarp_scenes.usd import scene_of_file
from tests.test_scene_files import damaged

path, cases = sys.argv[1], int(sys.argv[2])
whole = open(path, "rb").read()
random = np.random.default_rng(len(whole))
silence = os.open(os.devnull, os.O_WRONLY)
for case in range(cases):
    draft = path.replace("whole", f"damaged{case}")
    open(draft, "wb").write(damaged(whole, random))
    reading, writing = os.pipe()
    if os.fork() == 0:
        os.dup2(silence, 1), os.dup2(silence, 2)
        signal.alarm(20)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))
        try:
            scene_of_file(draft, Conversion())
            end = "read"
        except (ValueError, MemoryError, Tf.ErrorException) as error:
            end = "refused"
        except Exception as error:
            end = f"accident {error!r}"
        os.write(writing, end.encode())
        os._exit(0)
    os.close(writing)
    status = os.wait()[1]
    print(os.read(reading, 1000).decode() if status == 0 else f"died {status}")
    os.close(reading)
    os.unlink(draft)
"""


@pytest.fixture
def busy_stage() -> Usd.Stage:
    """A small stage with a little of everything that is read."""
    stage = new_stage(0.1, "Y")
    cube = add_cube(stage, "/World/Rock")
    cube.CreateHoleIndicesAttr([1])
    set_primvar(cube.GetPrim(), [1e6, 2e6, 3e6, 4e6, 5e6, 6e6], "uniform")
    shift = cube.AddTranslateOp()
    for code in range(4):
        shift.Set(Gf.Vec3d(code, 0, 0), code)
    field = add_instancer(stage, "/World/Field", [(0, 0, 0), (5, 0, 0)])
    UsdGeom.Cone.Define(stage, "/World/Field/Cone")
    field.CreatePrototypesRel().SetTargets(["/World/Field/Cone"])
    bind(add_cube(stage, "/World/Box").GetPrim(), "Steel")
    UsdShade.MaterialBindingAPI(stage.GetPrimAtPath("/World/Box")).CreateMaterialBindSubset("Top", Vt.IntArray([5]))
    return stage


@pytest.mark.parametrize("suffix", ["usda", "usdc"])
def test_a_damaged_stage_is_read_or_refused_and_never_an_accident_of_ours(tmp_path, busy_stage, suffix):
    whole = tmp_path / f"whole.{suffix}"
    busy_stage.Export(str(whole))
    root = Path(__file__).resolve().parents[1]
    cases = 100
    run = subprocess.run(
        [sys.executable, "-c", DAMAGE, str(whole), str(cases)],
        env={
            **os.environ,
            "PXR_WORK_THREAD_LIMIT": "1",
            "PYTHONPATH": os.pathsep.join(str(root / folder) for folder in (".", "kernels", "scenes")),
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    ends = run.stdout.splitlines()
    assert len(ends) == cases
    count_inputs(cases)
    # OpenUSD itself may die of a damaged binary file: that is what the child is for.
    allowed = ("read", "refused") if suffix == "usda" else ("read", "refused", "died")
    assert [end for end in ends if not end.startswith(allowed)] == []
    assert ends.count("refused") > cases // 10


@pytest.mark.parametrize("suffix", ["usda", "usdc"])
def test_damaged_stages_end_in_scenes_or_single_lines(tmp_path, busy_stage, suffix, capfd):
    from tests.test_scene_files import damaged

    whole = tmp_path / f"whole.{suffix}"
    busy_stage.Export(str(whole))
    random = np.random.default_rng(7)
    refusals = []
    for case in range(6):
        path = tmp_path / f"damaged{case}.{suffix}"
        path.write_bytes(damaged(whole.read_bytes(), random))
        refusals.append(attempt(scenes.scene_from_file, path)[1])
    assert any(refusals)
    assert all(line.startswith("path: ") for line in refusals if line is not None)
    assert capfd.readouterr() == ("", "")


def test_a_million_triangles_are_read(tmp_path):
    side = 708
    x, y = np.meshgrid(np.arange(side), np.arange(side), indexing="ij")
    node = np.arange(side * side).reshape(side, side)
    quads = np.stack([node[:-1, :-1], node[1:, :-1], node[1:, 1:], node[:-1, 1:]], axis=-1).reshape(-1, 4)
    stage = new_stage()
    mesh = UsdGeom.Mesh.Define(stage, "/Terrain")
    points = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3).astype(np.float32)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(quads), 4, dtype=np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(quads.ravel().astype(np.int32)))
    stage.Export(str(tmp_path / "terrain.usdc"))
    scene, report = scenes.read_scene(tmp_path / "terrain.usdc")
    assert (len(scene.faces), report.parts[0].polygons) == (2 * len(quads), len(quads))
    assert as_mesh(scene).area == pytest.approx((side - 1) ** 2)


# What is written comes back


def random_scene(random: np.random.Generator, impedances: int) -> Scene:
    """Triangles anywhere, of corners that single precision has to round."""
    vertices = random.normal(0.0, 10.0 ** random.uniform(-3.0, 3.0), (int(random.integers(3, 40)), 3))
    faces = np.array([random.permutation(len(vertices))[:3] for _ in range(random.integers(1, 60))])
    values = 10.0 ** random.uniform(5.0, 8.0, impedances)
    return Scene(vertices=vertices, faces=faces, impedance=values[random.integers(0, impedances, len(faces))])


@EXAMPLES
@given(seed=seeds, impedances=st.integers(1, 4), suffix=st.sampled_from(["usda", "usdc"]))
def test_a_scene_survives_bit_for_bit_as_kernels_see_it(tmp_path_factory, seed, impedances, suffix):
    folder = tmp_path_factory.mktemp("scene")
    scene = random_scene(np.random.default_rng(seed), impedances)
    scenes.write_scene(folder / f"first.{suffix}", scene)
    first = read(Usd.Stage.Open(str(folder / f"first.{suffix}")), winding="keep")
    assert np.array_equal(first.vertices.astype(np.float32), scene.vertices.astype(np.float32))
    assert np.array_equal(first.faces, scene.faces)
    assert np.array_equal(first.impedance, scene.impedance)
    scenes.write_scene(folder / f"second.{suffix}", first)
    second = read(Usd.Stage.Open(str(folder / f"second.{suffix}")), winding="keep")
    assert np.array_equal(second.vertices, first.vertices)


def test_what_single_precision_would_flatten_is_not_written(tmp_path):
    vertices = np.array([[5000.0, 0, 0], [5000.0 + 1e-6, 0, 0], [5000.0, 1e-60, 0]])
    scene = Scene(vertices=vertices, faces=np.array([[0, 1, 2]]), impedance=np.ones(1))
    with pytest.raises(ValueError, match="faces: all 1 have zero area"):
        scenes.write_scene(tmp_path / "scene.usda", scene)
    assert not list(tmp_path.iterdir())


RUNS = {
    "brick": lambda: scenes.brick_deployment(),
    "rough pair": lambda: scenes.pair_deployment(scenes.TABLE_2[1], "misaligned", roughness=scenes.Roughness(seed=4)),
    "mesh": lambda: scenes.mesh_deployment(scenes.BRICK.scene(scenes.STEEL)),
}


@pytest.mark.parametrize("name", RUNS)
def test_a_deployment_survives_with_its_run(tmp_path, name):
    deployment = RUNS[name]()
    path = tmp_path / "run.usdc"
    scenes.write_deployment(path, deployment)
    scene, report = scenes.read_scene(path)
    assert np.array_equal(scene.vertices, deployment.scene.vertices.astype(np.float32))
    assert np.array_equal(scene.faces, deployment.scene.faces)
    assert np.array_equal(scene.impedance, deployment.scene.impedance)
    assert sum(part.flipped + part.degenerate for part in report.parts) == 0
    run = scenes.read_trajectory(path)
    assert np.array_equal(run.times, deployment.trajectory.times)
    assert np.array_equal(run.poses, deployment.trajectory.poses)
    assert scenes.read_frames_from(path) == deployment.frames_from
    stage = Usd.Stage.Open(str(path))
    assert stage.GetPrimAtPath("/World/Vehicle").GetAttribute("sonarwarp:framesFrom").Get() == deployment.frames_from
    assert complaints(stage) == []


def test_objects_are_prims_of_their_own():
    names = [str(part.name) for part in scenes.read_scene(asset("pair_60_misaligned"))[1].parts]
    assert names == ["/World/Seabed", "/World/first", "/World/second"]


def test_images_from_the_file_are_those_from_code(tmp_path, device):
    deployment = scenes.brick_deployment(roughness=scenes.Roughness(seed=2))
    scenes.write_deployment(tmp_path / "run.usda", deployment)
    read_back = scenes.scene_from_file(tmp_path / "run.usda")
    run = scenes.read_trajectory(tmp_path / "run.usda")
    logs = []
    for scene, trajectory in ((deployment.scene, deployment.trajectory), (read_back, run)):
        times = np.linspace(100.0, 100.4, 5)
        part = Trajectory(times=times, poses=trajectory.at(times))
        logs.append(simulate(PRESETS["paper field"], [scene], [part], device=device))
    from_code, from_file = logs
    assert from_code.images.max() > 0.0
    assert np.array_equal(from_code.images, from_file.images)
    assert np.array_equal(from_code.echoes, from_file.echoes)


def test_a_failed_write_leaves_the_file_that_was_there(tmp_path):
    path = tmp_path / "scene"
    code = textwrap.dedent(
        f"""
        import resource
        import sonarwarp_scenes as scenes
        rough = scenes.brick_deployment(roughness=scenes.Roughness())
        for suffix in ("usda", "usdc"):
            path = {str(path)!r} + "." + suffix
            scenes.write_scene(path, scenes.BRICK.scene(1e6))
        resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))
        for suffix in ("usda", "usdc"):
            try:
                scenes.write_deployment({str(path)!r} + "." + suffix, rough)
            except OSError as error:
                print(error)
        """
    )
    root = Path(__file__).resolve().parents[1]
    run = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": str(root / "scenes")},
        capture_output=True,
        text=True,
        check=True,
    )
    first, second = run.stdout.splitlines()
    assert "scene.usda" in first
    assert "scene.usdc" in second
    assert sorted(file.name for file in tmp_path.iterdir()) == ["scene.usda", "scene.usdc"]
    for file in tmp_path.iterdir():
        assert len(scenes.scene_from_file(file).faces) == 12


@pytest.mark.parametrize(
    ("path", "error", "message"),
    [
        ("scene.obj", ValueError, "scene.obj, must end in .usda, .usdc or .usd"),
        ("nowhere/scene.usda", FileNotFoundError, "no such folder"),
        ("nowhere/scene.usdc", FileNotFoundError, "no such folder"),
    ],
)
def test_a_path_that_cannot_be_written_is_refused(tmp_path, path, error, message):
    with pytest.raises(error, match=message):
        scenes.write_scene(tmp_path / path, scenes.BRICK.scene(1e6))
    assert not list(tmp_path.iterdir())


# Trajectories

TURNS = scenes.waypoint_trajectory(np.array([[0, 0, 3], [20, 0, 3], [20, 6, 5], [0, 6, 3]], float), speed=0.5)


@pytest.fixture
def turning(tmp_path: Path) -> Path:
    base = scenes.brick_deployment()
    deployment = scenes.Deployment(name="turns", scene=base.scene, objects=(), trajectory=TURNS, frames_from=0.0)
    scenes.write_deployment(tmp_path / "turns.usda", deployment)
    return tmp_path / "turns.usda"


def test_a_viewer_shows_the_vehicle_where_the_trajectory_has_it(turning):
    stage = Usd.Stage.Open(str(turning))
    vehicle = UsdGeom.Xformable(stage.GetPrimAtPath("/World/Vehicle"))
    for time in np.linspace(0.0, TURNS.times[-1], 41):
        shown = np.array(vehicle.ComputeLocalToWorldTransform(time * stage.GetTimeCodesPerSecond()))
        (pose,) = TURNS.at(np.array([time]))
        assert np.allclose(shown[3, :3], pose[:3], atol=1e-12)
        assert np.allclose(shown[:3, :3].T, Rotation.from_quat(pose[3:]).as_matrix(), atol=1e-12)
    assert stage.GetEndTimeCode() / stage.GetTimeCodesPerSecond() == pytest.approx(TURNS.times[-1])


def test_a_run_with_turns_comes_back(turning):
    run = scenes.read_trajectory(turning)
    assert np.array_equal(run.times, TURNS.times)
    assert np.array_equal(run.poses[:, :3], TURNS.poses[:, :3])
    assert np.allclose(np.abs(np.sum(run.poses[:, 3:] * TURNS.poses[:, 3:], axis=1)), 1.0, atol=1e-14)


def moving_stage(up: str) -> tuple[Usd.Stage, UsdGeom.Xform]:
    """A prim that turns to the left by 90 degrees, on a carriage that moves forward by 20 units, over 10 time codes."""
    stage = new_stage(0.5, up)
    stage.SetTimeCodesPerSecond(5.0)
    carriage = UsdGeom.Xform.Define(stage, "/Carriage").AddTranslateOp()
    prim = UsdGeom.Xform.Define(stage, "/Carriage/Vehicle")
    turn = prim.AddRotateYOp() if up == "Y" else prim.AddRotateZOp()
    prim.AddScaleOp().Set(Gf.Vec3f(2, 3, 4))
    for code in (0, 10):
        carriage.Set(Gf.Vec3d(2.0 * code, 0, 0), code)
    turn.Set(0.0, 0)
    turn.Set(90.0, 10)
    add_cube(stage)
    return stage, prim


@pytest.mark.parametrize("up", ["Y", "Z"])
def test_a_prim_on_a_prim_that_moves_gives_its_way_in_the_world(tmp_path, up):
    stage, _ = moving_stage(up)
    stage.Export(str(tmp_path / "stage.usda"))
    run = scenes.read_trajectory(tmp_path / "stage.usda", "/Carriage/Vehicle")
    assert np.allclose(run.times, [0.0, 2.0])
    assert np.allclose(run.poses[:, :3], [[0, 0, 0], [10, 0, 0]])
    # Forward becomes left, in a world with z up.
    assert np.allclose(Rotation.from_quat(run.poses[:, 3:]).apply([1.0, 0.0, 0.0]), [[1, 0, 0], [0, 1, 0]], atol=1e-12)
    shifted = scenes.read_trajectory(tmp_path / "stage.usda", "/Carriage/Vehicle", scale=1.0, origin=(5.0, 0.0, 0.0))
    assert np.allclose(shifted.poses[:, 0], [-5.0, 15.0])


def shear(prim: UsdGeom.Xform, matrix: list[list[float]]) -> None:
    prim.ClearXformOpOrder()
    prim.AddTransformOp().Set(Gf.Matrix4d(matrix), 0.0)


@pytest.mark.parametrize(
    ("change", "prim", "message"),
    [
        (lambda prim: None, None, r"prim: 2 prims move \(/Carriage, /Carriage/Vehicle\), must be one: name it"),
        (lambda prim: None, "/Cube", "prim: /Cube does not move"),
        (lambda prim: None, "/Gone", "prim: '/Gone' is no prim with a transform"),
        (lambda prim: None, "no path at all", "prim: 'no path at all' is no prim with a transform"),
        (lambda prim: prim.GetScaleOp().Set(Gf.Vec3f(1, 0, 1)), "/Carriage/Vehicle", "an axis of length 0"),
        (lambda prim: prim.GetScaleOp().Set(Gf.Vec3f(-1, 1, 1)), "/Carriage/Vehicle", "mirrored transform"),
        (
            lambda prim: shear(prim, [[1, 0, 0, 0], [0.5, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]),
            "/Carriage/Vehicle",
            r"sheared transform \(a cosine of 0.447 between axes\)",
        ),
    ],
)
def test_a_way_that_is_none_is_refused(tmp_path, change, prim, message):
    stage, vehicle = moving_stage("Z")
    change(vehicle)
    stage.Export(str(tmp_path / "stage.usda"))
    with pytest.raises(ValueError, match=f"path: .*stage.usda: .*{message}"):
        scenes.read_trajectory(tmp_path / "stage.usda", prim)


def say_frames_from(prim: UsdGeom.Xform, kind: Sdf.ValueTypeName, value: object) -> None:
    # An attribute that is there would keep its type.
    prim.GetPrim().RemoveProperty("sonarwarp:framesFrom")
    prim.GetPrim().CreateAttribute("sonarwarp:framesFrom", kind).Set(value)


def test_the_prim_that_moves_says_when_imaging_may_start(tmp_path):
    """As it stands, whatever the stage's time codes, units and up axis are; others' word does not count."""
    stage, vehicle = moving_stage("Y")
    path = tmp_path / "stage.usda"
    said = {"/Carriage": 7.0, "/Carriage/Vehicle": None, "/Cube": 1.5}
    for name, kind in (("/Carriage", Sdf.ValueTypeNames.Double), ("/Cube", Sdf.ValueTypeNames.Half)):
        say_frames_from(UsdGeom.Xform(stage.GetPrimAtPath(name)), kind, said[name])
    stage.Export(str(path))
    assert {name: scenes.read_frames_from(path, name) for name in said} == said
    with pytest.raises(ValueError, match=r"path: .*stage\.usda: prim: 2 prims move .*, must be one: name it"):
        scenes.read_frames_from(path)
    for kind, value in ((Sdf.ValueTypeNames.Int, -3), (Sdf.ValueTypeNames.Double, 0.1)):
        say_frames_from(vehicle, kind, value)
        stage.Export(str(path))
        assert scenes.read_frames_from(path, "/Carriage/Vehicle") == value
    vehicle.GetPrim().GetAttribute("sonarwarp:framesFrom").Block()
    stage.Export(str(path))
    assert scenes.read_frames_from(path, "/Carriage/Vehicle") is None


@pytest.mark.parametrize(
    ("kind", "value", "message"),
    [
        (Sdf.ValueTypeNames.Double, math.nan, "nan, must be finite"),
        (Sdf.ValueTypeNames.Double, -math.inf, "-inf, must be finite"),
        (Sdf.ValueTypeNames.Bool, True, r"True, must be one number \[s\]"),
        (Sdf.ValueTypeNames.String, "35", r"'35', must be one number \[s\]"),
        (Sdf.ValueTypeNames.DoubleArray, [1.0, 2.0], r"Vt\.DoubleArray\(2, \(1, 2\)\), must be one number \[s\]"),
        (Sdf.ValueTypeNames.Matrix4d, Gf.Matrix4d(1.0), r"Gf\.Matrix4d\(1\.0, .* \.\.\., must be one number \[s\]"),
    ],
)
def test_when_imaging_may_start_must_be_a_finite_number(tmp_path, kind, value, message):
    stage, vehicle = moving_stage("Z")
    say_frames_from(vehicle, kind, value)
    stage.Export(str(tmp_path / "stage.usda"))
    with pytest.raises(
        ValueError, match=rf"path: .*stage\.usda: /Carriage/Vehicle: sonarwarp:framesFrom: {message}"
    ) as refusal:
        scenes.read_frames_from(tmp_path / "stage.usda", "/Carriage/Vehicle")
    assert "\n" not in str(refusal.value)


def test_a_stage_that_is_not_whole_says_nothing_of_when_imaging_may_start(tmp_path):
    stage, _ = moving_stage("Z")
    stage.DefinePrim("/Other").GetReferences().AddReference("gone.usda")
    # Unlike a stage, a layer is written with its references as they are.
    stage.GetRootLayer().Export(str(tmp_path / "stage.usda"))
    with pytest.raises(ValueError, match=r"path: .*stage\.usda: .*gone\.usda"):
        scenes.read_frames_from(tmp_path / "stage.usda", "/Carriage/Vehicle")


# The paper's scenes


@pytest.mark.parametrize("name", sorted(paper_deployments()))
def test_a_published_scene_is_valid_and_what_code_makes(name):
    deployment, sonars = paper_deployments()[name]
    path = asset(name)
    stage = Usd.Stage.Open(str(path))
    assert complaints(stage) == []
    scene = read(stage)
    assert np.array_equal(scene.vertices, deployment.scene.vertices.astype(np.float32))
    assert np.array_equal(scene.faces, deployment.scene.faces)
    assert np.array_equal(scene.impedance, deployment.scene.impedance)
    vehicle = UsdGeom.Xformable(stage.GetPrimAtPath("/World/Vehicle"))
    assert np.array_equal(np.array(vehicle.GetTimeSamples()) / 32.0, deployment.trajectory.times)
    assert scenes.read_frames_from(path) == deployment.frames_from
    for sonar in sonars:
        beam = UsdGeom.BasisCurves(stage.GetPrimAtPath(f"/World/Vehicle/{sonar.name}/Beam"))
        assert np.array_equal(beam.GetPointsAttr().Get(), np.concatenate(sonar.edges()).astype(np.float32))


def test_published_scenes_are_small_and_none_is_left_over():
    files = sorted(Path(assets.__file__).parent.glob("*.usda"))
    assert [file.stem for file in files] == sorted(paper_deployments())
    assert sum(file.stat().st_size for file in files) < 200_000


def test_the_command_writes_the_published_scenes(tmp_path):
    root = Path(__file__).resolve().parents[1]
    subprocess.run(
        [sys.executable, "-m", "sonarwarp_scenes.assets", str(tmp_path)],
        env={**os.environ, "PYTHONPATH": str(root / "scenes")},
        check=True,
        capture_output=True,
    )
    assert sorted(file.stem for file in tmp_path.iterdir()) == sorted(paper_deployments())


def test_an_asset_that_is_none_is_refused_with_those_there_are():
    with pytest.raises(ValueError, match="name: 'wreck', must be one of brick, pair_30_misaligned"):
        asset("wreck")


@pytest.mark.parametrize(
    ("name", "preset"),
    [("brick", "paper field"), ("slope_60", "paper slope series"), ("pair_60_misaligned", "paper simulation")],
)
def test_outlines_are_those_of_the_paper_s_rigs(name, preset):
    rig = PRESETS[preset]
    fls, ps = paper_deployments()[name][1]
    assert np.allclose(fls.vehicle_from_sensor, rig.fls_mount.vehicle_from_sensor(), atol=1e-7)
    assert np.allclose(ps.vehicle_from_sensor, rig.ps_mount.vehicle_from_sensor(), atol=1e-7)
    assert fls.half_azimuth == pytest.approx(rig.fls.azimuth_edge[-1])
    assert fls.half_elevation == pytest.approx(rig.fls.half_elevation)
    assert (fls.range_min, fls.range_max) == pytest.approx((rig.fls.range_edge[0], rig.fls.range_edge[-1]))
    assert ps.half_azimuth == pytest.approx(math.radians(rig.ps.sector_deg) / 2)
    assert ps.half_elevation == pytest.approx(math.radians(rig.ps.fan_beamwidth_deg) / 2)
    assert (ps.range_min, ps.range_max) == pytest.approx((rig.ps.range_edge[0], rig.ps.range_edge[-1]))


def test_an_outline_lies_on_the_borders_of_what_the_sonar_sees():
    sonar = paper_deployments()["brick"][1][0]
    points = np.concatenate(sonar.edges())
    distance = np.linalg.norm(points, axis=1)
    azimuth, elevation = np.arctan2(points[:, 1], points[:, 0]), np.arcsin(points[:, 2] / distance)
    on_borders = np.isclose(distance[:, None], [sonar.range_min, sonar.range_max]).any(axis=1).astype(int)
    on_borders += np.isclose(np.abs(azimuth), sonar.half_azimuth)
    on_borders += np.isclose(np.abs(elevation), sonar.half_elevation)
    assert on_borders.min() >= 2


# Clouds

CLOUD = PointCloud(
    points=np.random.default_rng(0).normal(size=(50, 3)),
    attributes={
        "probability": np.linspace(0.0, 1.0, 50),
        "elevation deviation": np.linspace(0.1, 0.2, 50).astype(np.float32),
        "beam": np.arange(50),
        "key": np.arange(50) + 2**40,
        "found": np.arange(50) % 2 == 0,
    },
)


@pytest.mark.parametrize("suffix", ["usda", "usdc", "usd"])
def test_a_cloud_keeps_its_points_and_attributes(tmp_path, suffix):
    path = tmp_path / f"cloud.{suffix}"
    write_cloud_usd(path, CLOUD, colour_by="probability")
    stage = Usd.Stage.Open(str(path))
    assert complaints(stage) == []
    points = UsdGeom.Points(stage.GetPrimAtPath("/World/Cloud"))
    assert np.array_equal(points.GetPointsAttr().Get(), CLOUD.points.astype(np.float32))
    primvars = UsdGeom.PrimvarsAPI(points)
    for name, values in CLOUD.attributes.items():
        primvar = primvars.GetPrimvar(Tf.MakeValidIdentifier(name))
        assert primvar.GetInterpolation() == UsdGeom.Tokens.vertex
        assert np.array_equal(np.array(primvar.Get()), values)
    colours = np.array(points.GetDisplayColorAttr().Get())
    assert len(colours) == 50
    # Brighter with every step.
    assert (np.diff(colours @ [0.2126, 0.7152, 0.0722]) > 0.0).all()


def test_normals_are_those_of_the_points(tmp_path):
    normals = np.random.default_rng(1).normal(size=(50, 3)).astype(np.float32)
    whole = replace(CLOUD, attributes={**CLOUD.attributes, **dict(zip(NORMAL, normals.T, strict=True))})
    write_cloud_usd(tmp_path / "cloud.usda", whole, colour_by="normal_z")
    stage = Usd.Stage.Open(str(tmp_path / "cloud.usda"))
    assert complaints(stage) == []
    points = UsdGeom.Points(stage.GetPrimAtPath("/World/Cloud"))
    assert np.array_equal(points.GetNormalsAttr().Get(), normals)
    assert points.GetNormalsInterpolation() == UsdGeom.Tokens.vertex
    primvars = UsdGeom.PrimvarsAPI(points)
    assert not any(primvars.HasPrimvar(name) for name in NORMAL)
    assert len(points.GetDisplayColorAttr().Get()) == 50


def test_a_cloud_without_all_of_a_normal_has_none(tmp_path):
    write_cloud_usd(tmp_path / "cloud.usda", replace(CLOUD, attributes={"normal_x": np.arange(50.0)}))
    stage = Usd.Stage.Open(str(tmp_path / "cloud.usda"))
    points = UsdGeom.Points(stage.GetPrimAtPath("/World/Cloud"))
    assert not points.GetNormalsAttr().HasAuthoredValue()
    assert np.array_equal(UsdGeom.PrimvarsAPI(points).GetPrimvar("normal_x").Get(), np.arange(50.0))


@pytest.mark.parametrize(
    ("values", "alike"),
    [([3.0, 3.0, 3.0], [[0, 1, 2]]), ([math.nan, 0.0, math.inf], [[0, 2]]), ([math.nan] * 3, [[0, 1, 2]])],
)
def test_colours_are_finite_whatever_the_values(tmp_path, values, alike):
    cloud = PointCloud(points=np.eye(3), attributes={"value": np.array(values)})
    write_cloud_usd(tmp_path / "cloud.usda", cloud, colour_by="value")
    stage = Usd.Stage.Open(str(tmp_path / "cloud.usda"))
    points = UsdGeom.Points(stage.GetPrimAtPath("/World/Cloud"))
    colours = np.array(points.GetDisplayColorAttr().Get())
    assert np.isfinite(colours).all()
    for group in alike:
        assert len(np.unique(colours[group], axis=0)) == 1


def test_an_empty_cloud_is_a_valid_stage(tmp_path):
    write_cloud_usd(tmp_path / "cloud.usda", PointCloud(points=np.zeros((0, 3))))
    assert complaints(Usd.Stage.Open(str(tmp_path / "cloud.usda"))) == []


def test_sonars_move_through_the_cloud_s_stage_as_they_did(tmp_path):
    runs = [TURNS, scenes.straight_trajectory((0, 0, 2), heading=1.0, speed=0.1, length=1.0)]
    survey = plan_survey(PRESETS["paper simulation"], runs)
    tracks = sonar_tracks(survey)
    assert sorted(tracks) == ["fls_0", "fls_1", "ps_0", "ps_1"]
    path = tmp_path / "cloud.usdc"
    write_cloud_usd(path, CLOUD, tracks=tracks)
    stage = Usd.Stage.Open(str(path))
    assert complaints(stage) == []
    for name, track in tracks.items():
        run = scenes.read_trajectory(path, f"/World/Tracks/{name}")
        assert np.array_equal(run.times, track.times)
        assert np.array_equal(run.poses[:, :3], track.poses[:, :3])
        assert np.allclose(np.abs(np.sum(run.poses[:, 3:] * track.poses[:, 3:], axis=1)), 1.0, atol=1e-14)
    pose = survey.pings.pose[survey.pings.trajectory == 1]
    assert np.array_equal(tracks["ps_1"].poses[:, :3], pose[:, :3])
    assert stage.GetEndTimeCode() == 32.0 * max(track.times[-1] for track in tracks.values())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"path": "cloud.ply"}, "must end in .usda, .usdc or .usd"),
        ({"colour_by": "depth"}, "colour_by: 'depth', must be one of probability, "),
        ({"width": 0.0}, "width: 0.0 m, must be positive"),
        ({"tracks": {"a b": TURNS, "a.b": TURNS}}, "tracks: 'a b' and 'a.b' are both a_b in OpenUSD"),
        (
            {"cloud": PointCloud(points=np.eye(3), attributes={"name": np.array(["a", "b", "c"])})},
            r"attributes\[name\]: dtype <U1, must be numbers",
        ),
        (
            {"cloud": PointCloud(points=np.eye(3), attributes={"displayColor": np.ones(3)})},
            "attributes: 'displayColor' is what OpenUSD calls",
        ),
    ],
)
def test_a_cloud_that_cannot_be_written_is_refused(tmp_path, options, message):
    options = {"path": "cloud.usda", "cloud": CLOUD, **options}
    with pytest.raises(ValueError, match=message):
        write_cloud_usd(tmp_path / options.pop("path"), options.pop("cloud"), **options)
    assert not list(tmp_path.iterdir())
