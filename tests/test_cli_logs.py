"""From files to files on the command line: preset, simulate, reconstruct, evaluate."""

# pyright: reportAttributeAccessIssue=false
# OpenUSD fills its modules when they load, where no type checker sees it.

import json
import shutil
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from pxr import Usd

import sonarwarp as sw
import sonarwarp_scenes
from sonarwarp.app.logs import evaluate_files
from sonarwarp.metrics import evaluate, seen_samples
from sonarwarp.toml_text import toml_text
from sonarwarp.trajectory_files import write_csv
from tests.small_logs import same_survey
from tests.small_runs import RIG, SETTINGS, run, scene
from tests.test_cli import sonarwarp

UP = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0])

BRICK = Path(sonarwarp_scenes.__file__).parent / "assets" / "brick.usda"


@pytest.fixture(scope="module", name="folder")
def folder_fixture(tmp_path_factory):
    """A folder with a small rig, a short run, and the log and clouds that the commands make of them."""
    folder = tmp_path_factory.mktemp("files")
    text = toml_text(rig=RIG, noise=sw.Noise(), motion=sw.Motion(), navigation=sw.Navigation(), reconstruction=SETTINGS)
    (folder / "rig.toml").write_text(text)
    write_csv(run(length=0.6), folder / "run.csv")
    made = sonarwarp(
        *("simulate", str(BRICK), "--rig", "rig.toml", "--trajectory", "run.csv", "--out", "log", "--seed", "3"),
        "--json",
        folder=folder,
    )
    assert made.returncode == 0, made.stderr
    assert json.loads(made.stdout)["frames"] == 61
    built = sonarwarp("reconstruct", "log", "--out", "clouds", "--seed", "3", "--json", folder=folder)
    assert built.returncode == 0, built.stderr
    facts = json.loads(built.stdout)
    assert facts["complete"] is True
    assert all((folder / name).exists() for name in facts["files"])
    return folder


def test_a_preset_is_a_rig_to_simulate_with(tmp_path):
    from sonarwarp.toml_settings import read_rig

    printed = sonarwarp("preset", "paper field")
    assert printed.returncode == 0
    (tmp_path / "rig.toml").write_text(printed.stdout)
    assert toml_text(rig=read_rig(tmp_path / "rig.toml")) == toml_text(rig=sw.PRESETS["paper field"])


def test_the_log_holds_what_simulate_gives_in_memory(folder):
    world, _ = sonarwarp_scenes.read_scene(BRICK)
    log = sw.simulate(
        RIG, world, run(length=0.6), noise=sw.Noise(), motion=sw.Motion(), navigation=sw.Navigation(), seed=3
    )
    stored = sw.open_log(folder / "log")
    assert same_survey(stored.survey, log.survey)
    assert stored.truth is not None
    assert log.truth is not None
    assert same_survey(stored.truth, log.truth)
    assert np.array_equal(stored.load().images, log.images)
    assert np.array_equal(stored.load().echoes, log.echoes)


def test_clouds_are_those_of_reconstruct_in_every_format(folder):
    clouds = sw.reconstruct(sw.open_log(folder / "log"), settings=SETTINGS, seed=3)
    for method in ("single", "fused"):
        wanted = getattr(clouds, method)
        assert len(wanted) > 50
        for suffix in (".ply", ".pcd", ".npz"):
            read = sw.read_cloud(folder / "clouds" / f"{method}{suffix}")
            assert np.allclose(read.points, wanted.points, atol=1e-6)
            assert set(read.attributes) == set(wanted.attributes)


@pytest.mark.parametrize(
    "text", ["[reconstruction]\nsparkle = 3\n", "[reconstr"], ids=["of another version", "damaged"]
)
def test_a_log_whose_settings_cannot_be_read_is_reconstructed_with_others(folder, tmp_path, text):
    log = shutil.copytree(folder / "log", tmp_path / "log")
    document = json.loads((log / "zarr.json").read_text())
    document["attributes"]["reconstruction"] = text
    (log / "zarr.json").write_text(json.dumps(document))
    refused = sonarwarp("reconstruct", "log", "--out", "new", folder=tmp_path)
    assert refused.returncode == 2
    (line,) = refused.stderr.strip().splitlines()
    assert line.startswith("sonarwarp: log: its settings cannot be read: reconstruction: ")
    assert line.endswith("; give others: `sonarwarp reconstruct LOG --out OUT --settings FILE`, or settings= in code")
    assert not (tmp_path / "new").exists()
    others = ("--settings", str(folder / "rig.toml"), "--seed", "3")
    built = sonarwarp("reconstruct", "log", "--out", "new", *others, folder=tmp_path)
    assert built.returncode == 0, built.stderr
    for name in ("single.npz", "fused.npz"):
        assert (tmp_path / "new" / name).read_bytes() == (folder / "clouds" / name).read_bytes()


def test_evaluate_measures_distances_to_the_scene(folder):
    figures = {}
    for name in ("fused.ply", "fused.npz"):
        found = sonarwarp("evaluate", f"clouds/{name}", "--truth", str(BRICK), "--json", folder=folder)
        assert found.returncode == 0, found.stderr
        figures[name] = json.loads(found.stdout)
    assert 0.0 < figures["fused.ply"]["accuracy_rms"] < 0.2
    assert figures["fused.ply"]["accuracy_rms"] == pytest.approx(figures["fused.npz"]["accuracy_rms"], rel=1e-4)
    assert "completeness" not in figures["fused.ply"]


def test_with_a_log_and_a_part_evaluate_asks_for_what_the_sonars_could_see_of_it(folder):
    found = {}
    for part in ("brick", "/World/brick", "Seabed"):
        asked = ("--truth", str(BRICK), "--log", "log", "--part", part, "--json")
        judged = sonarwarp("evaluate", "clouds/fused.ply", *asked, folder=folder)
        assert judged.returncode == 0, judged.stderr
        found[part] = json.loads(judged.stdout)
    assert found["brick"] == found["/World/brick"] | {"part": "brick"}
    world, report = sonarwarp_scenes.read_scene(BRICK)
    truth, points = sw.open_log(folder / "log").truth, sw.read_cloud(folder / "clouds" / "fused.ply")
    assert truth is not None
    for name in ("brick", "Seabed"):
        part = report.faces_of(name)
        seen = seen_samples(world, truth, part=part)
        wanted = evaluate(points, scene=world, seen=seen, part=part).surface
        assert wanted is not None
        assert found[name] == found[name] | asdict(wanted)
        assert found[name]["points"] == len(points) >= found[name]["counted"] > 0
    assert 0.0 < found["brick"]["f_score"] < 1.0
    assert found["brick"]["completeness"] > found["Seabed"]["completeness"]


def test_steeper_than_asks_for_the_faces_that_a_single_sonar_cannot_show(folder):
    """Of the brick, an upright box: its walls count and what lies on nothing, but neither its top nor the seabed."""
    world, report = sonarwarp_scenes.read_scene(BRICK)
    corners = world.vertices[world.faces[report.faces_of("brick")]].reshape(-1, 3)
    (front, right, _), (_, _, top) = corners.min(axis=0), corners.max(axis=0)
    across = right + np.linspace(0.05, 0.15, 4)
    off = {"front": (front - 0.02, top - 0.1), "top": (front + 0.07, top + 0.01), "none": (front - 0.3, top)}
    seabed = (front - 0.3, 0.01)
    points = [(x, y, z) for x, z in (*off.values(), seabed) for y in across]
    sw.PointCloud(points=np.array(points), attributes={}).write_ply(folder / "made.ply")
    asked = ("evaluate", "made.ply", "--truth", str(BRICK), "--log", "log", "--part", "brick", "--json")
    found = {}
    for limit in ("0", "89.9"):
        judged = sonarwarp(*asked, "--steeper-than", limit, folder=folder)
        assert judged.returncode == 0, judged.stderr
        found[limit] = json.loads(judged.stdout)
    steep = found["89.9"]
    assert (steep["steeper_than_deg"], steep["points"], steep["counted"]) == (89.9, 16, 8)
    assert steep["accuracy_mean"] == pytest.approx((0.02 + 0.3) / 2, abs=1e-5)
    assert steep["precision"] == 0.5
    # Over no limit the level top is not asked for either: level is not steep.
    assert found["0"] == steep | {"steeper_than_deg": 0.0}
    a, b, c = (world.vertices[world.faces[:, corner]] for corner in range(3))
    upright = np.abs(np.cross(b - a, c - a)[:, 2]) < 1e-9
    truth = sw.open_log(folder / "log").truth
    assert truth is not None
    seen = seen_samples(world, truth, part=upright)
    assert len(seen) > 100
    near = np.linalg.norm(seen[:, None] - np.array(points), axis=2).min(axis=1) <= 0.05
    assert steep["completeness"] == near.mean() > 0.0


def test_completeness_is_judged_from_true_poses_where_the_log_holds_them(folder):
    """Navigation far above everything sees nothing, and is all that a recorded log has."""
    stored = sw.open_log(folder / "log").load()
    frames, pings = (replace(rows, pose=rows.pose + 100.0 * UP) for rows in (stored.survey.frames, stored.survey.pings))
    lost = replace(stored, survey=replace(stored.survey, frames=frames, pings=pings))
    for name, log in (("lost", lost), ("recorded", replace(lost, truth=None))):
        sw.log_to_store(log, folder / name)
    found = {
        name: evaluate_files(
            folder / "clouds" / "fused.ply",
            BRICK,
            log=folder / name,
            part="brick",
            steeper_than_deg=None,
            scale=None,
            tolerance=0.05,
            device="cpu",
        )
        for name in ("log", "lost", "recorded")
    }
    assert found["lost"]["completeness"] == found["log"]["completeness"] > 0.0
    assert (found["recorded"]["completeness"], found["recorded"]["f_score"]) == (None, None)


def test_a_buried_mesh_is_a_scene_to_simulate_and_a_part_to_evaluate(folder):
    ball = trimesh.creation.icosphere(subdivisions=2, radius=40.0)
    ball.apply_translation([300.0, 200.0, 100.0]).export(folder / "ball.stl")
    made = sonarwarp(
        *("bury", "ball.stl", "--scale", "0.01", "--rig", "rig.toml", "--altitude", "1.9", "--seed", "5"),
        *("--out", "ball.usda", "--json"),
        folder=folder,
    )
    assert made.returncode == 0, made.stderr
    facts = json.loads(made.stdout)
    scene, report = sonarwarp_scenes.read_scene(folder / "ball.usda")
    corners = scene.vertices[scene.faces[report.faces_of(facts["part"])]]
    # The sphere's poles are corners; single precision of the file.
    assert corners.reshape(-1, 3).min(axis=0) == pytest.approx([0.0, -0.4, -0.4], abs=1e-5)
    assert corners.reshape(-1, 3).max(axis=0) == pytest.approx([0.8, 0.4, 0.4], abs=1e-5)
    seabed = scene.vertices[scene.faces[report.faces_of("Seabed")]]
    assert 0.002 < seabed[..., 2].std() < 0.1
    way = sonarwarp_scenes.read_trajectory(folder / "ball.usda")
    assert (way.times[-1], way.poses[0, 2]) == pytest.approx((facts["duration"], 1.9))
    assert 0.0 < facts["frames_from"] < facts["duration"]
    assert sonarwarp_scenes.read_frames_from(folder / "ball.usda") == facts["frames_from"]
    stage = Usd.Stage.Open(str(folder / "ball.usda"))
    assert stage.GetPrimAtPath("/World/Vehicle").GetChildrenNames() == ["FLS", "PS"]


# What stages of one run of 6 s say of when imaging may start.
SAID = {"late": "4", "beyond": "6.5", "wrong": "nan"}


@pytest.fixture(scope="module", name="staged")
def staged_fixture(folder):
    """The folder, with those stages and one that says nothing."""
    deployment = sonarwarp_scenes.Deployment(
        name="late", scene=scene(), objects=(), trajectory=run(length=0.6), frames_from=4.0
    )
    sonarwarp_scenes.write_deployment(folder / "late.usda", deployment)
    text = (folder / "late.usda").read_text()
    line = "custom double sonarwarp:framesFrom = 4\n"
    assert text.count(line) == 1
    (folder / "silent.usda").write_text(text.replace(line, ""))
    for name, value in SAID.items():
        (folder / f"{name}.usda").write_text(text.replace(line, line.replace("4", value)))
    return folder


# Arguments, time of the first frame, and how many there are.
STARTS = {
    "the stage says": (("late.usda",), 4.0, 21),
    "the option wins": (("late.usda", "--frames-from", "5"), 5.0, 11),
    "the option wins over what is wrong": (("wrong.usda", "--frames-from", "5"), 5.0, 11),
    "the trajectory's stage says nothing": (("late.usda", "--trajectory", "silent.usda"), 0.0, 61),
    "the trajectory is no stage": (("late.usda", "--trajectory", "run.csv"), 0.0, 61),
}


@pytest.mark.parametrize("name", STARTS)
def test_imaging_starts_when_the_run_s_own_stage_says(name, staged):
    arguments, start, frames = STARTS[name]
    made = sonarwarp(
        "simulate", *arguments, *("--rig", "rig.toml", "--out", "started", "--overwrite", "--json"), folder=staged
    )
    assert made.returncode == 0, made.stderr
    facts = json.loads(made.stdout)
    assert (facts["imaging_from"], facts["frames"], facts["pings"]) == (start, frames, 31)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("beyond.usda", "frames_from: 6.5 s, must be at most 6 s, the run's last frame"),
        ("wrong.usda", "wrong.usda: /World/Vehicle: sonarwarp:framesFrom: nan, must be finite"),
    ],
)
def test_a_stage_that_says_a_wrong_time_costs_one_line(name, message, staged):
    made = sonarwarp("simulate", name, "--rig", "rig.toml", "--out", "new", folder=staged)
    assert made.returncode == 2
    assert message in made.stderr
    assert len(made.stderr.strip().splitlines()) == 1
    assert not (staged / "new").exists()


WRONG = {
    "no such preset": (["preset", "paper feild"], "did you mean 'paper field'?"),
    "no such scene": (["simulate", "no.usda", "--rig", "rig.toml", "--out", "new"], "no.usda"),
    "no such rig": (["simulate", str(BRICK), "--rig", "no.toml", "--out", "new"], "no.toml"),
    "no such trajectory": (
        ["simulate", str(BRICK), "--rig", "rig.toml", "--trajectory", "no.csv", "--out", "new"],
        "no.csv",
    ),
    "a log that is there": (
        ["simulate", str(BRICK), "--rig", "rig.toml", "--trajectory", "run.csv", "--out", "log"],
        "log: exists already",
    ),
    "no such log": (["reconstruct", "nothing", "--out", "new"], "nothing"),
    "a log that is none": (["reconstruct", "rig.toml", "--out", "new"], "rig.toml"),
    "settings without settings": (["reconstruct", "log", "--out", "new", "--settings", "run.csv"], "run.csv"),
    "clouds into a file": (["reconstruct", "log", "--out", "rig.toml"], "rig.toml"),
    "a cloud of no known kind": (["evaluate", "rig.toml", "--truth", str(BRICK)], "must be .ply, .pcd or .npz"),
    "a cloud that is none": (["evaluate", "fake.ply", "--truth", str(BRICK)], "fake.ply"),
    "a truth that is none": (["evaluate", "clouds/fused.ply", "--truth", "rig.toml"], "rig.toml"),
    "no such part": (
        ["evaluate", "clouds/fused.ply", "--truth", str(BRICK), "--part", "brik"],
        "must be one of /World/Seabed, /World/brick",
    ),
    "a log that is none to see with": (
        ["evaluate", "clouds/fused.ply", "--truth", str(BRICK), "--log", "clouds"],
        "clouds",
    ),
    "a mesh to bury that is none": (["bury", "rig.toml", "--out", "new.usda"], "rig.toml"),
    "a scene of no known kind": (["bury", "box.stl", "--out", "new"], "must end in .usda"),
    "steeper than upright": (
        ["evaluate", "clouds/fused.ply", "--truth", str(BRICK), "--steeper-than", "91"],
        "steeper_than_deg: 91 is outside [0, 90]",
    ),
    "steeper than anything": (
        ["evaluate", "clouds/fused.ply", "--truth", str(BRICK), "--part", "Seabed", "--steeper-than", "50"],
        "steeper_than_deg: 50, must be under the steepest face's 0.00",
    ),
    "no tolerance": (["evaluate", "clouds/fused.ply", "--truth", str(BRICK), "--tolerance", "0"], "tolerance"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_files_cost_one_line(name, folder):
    trimesh.creation.box().export(folder / "box.stl")
    (folder / "fake.ply").write_text("ply\nformat ascii 1.0\nelement vertex 9\nend_header\n")
    arguments, mentioned = WRONG[name]
    found = sonarwarp(*arguments, folder=folder)
    assert found.returncode in (1, 2)
    assert "Traceback" not in found.stderr
    assert mentioned in found.stderr
    assert len(found.stderr.strip().splitlines()) == 1
    assert not (folder / "new").exists()


@pytest.mark.parametrize("suffix", [".ply", ".pcd", ".npz"])
def test_damaged_clouds_are_refused_in_one_line(folder, tmp_path, suffix):
    whole = (folder / "clouds" / f"fused{suffix}").read_bytes()
    path = tmp_path / f"cloud{suffix}"
    for length in (0, 3, 60, len(whole) // 2, len(whole) - 7):
        path.write_bytes(whole[:length])
        with pytest.raises(ValueError, match="cannot be read as a cloud"):
            sw.read_cloud(path)


def test_vertices_of_any_ply_are_a_cloud(tmp_path):
    trimesh.creation.box().export(tmp_path / "box.ply")
    assert len(sw.read_cloud(tmp_path / "box.ply")) == 8
