"""From files to files on the command line: preset, simulate, reconstruct, evaluate."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

import sonarwarp as sw
import sonarwarp_scenes
from sonarwarp.toml_text import toml_text
from sonarwarp.trajectory_files import write_csv
from tests.small_runs import RIG, SETTINGS, run
from tests.test_cli import sonarwarp

BRICK = Path(sonarwarp_scenes.__file__).parent / "assets" / "brick.usda"


@pytest.fixture(scope="module", name="folder")
def folder_fixture(tmp_path_factory):
    """A folder with a small rig, a short run, and the log and clouds that the commands make of them."""
    folder = tmp_path_factory.mktemp("files")
    (folder / "rig.toml").write_text(toml_text(rig=RIG, noise=sw.Noise(), reconstruction=SETTINGS))
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
    log = sw.simulate(RIG, world, run(length=0.6), noise=sw.Noise(), seed=3)
    stored = sw.open_log(folder / "log")
    assert np.array_equal(stored.load().images, log.images)
    assert np.array_equal(stored.load().echoes, log.echoes)


def test_clouds_are_those_of_reconstruct_in_every_format(folder):
    clouds = sw.reconstruct(sw.open_log(folder / "log"), settings=SETTINGS, seed=3)
    for method in ("single", "fused"):
        wanted = getattr(clouds, method)
        assert len(wanted) > 50
        for suffix in (".ply", ".npz"):
            read = sw.read_cloud(folder / "clouds" / f"{method}{suffix}")
            assert np.allclose(read.points, wanted.points, atol=1e-6)
            assert set(read.attributes) == set(wanted.attributes)


def test_evaluate_measures_distances_to_the_scene(folder):
    figures = {}
    for name in ("fused.ply", "fused.npz"):
        found = sonarwarp("evaluate", f"clouds/{name}", "--truth", str(BRICK), "--json", folder=folder)
        assert found.returncode == 0, found.stderr
        figures[name] = json.loads(found.stdout)
    assert 0.0 < figures["fused.ply"]["accuracy_rms"] < 0.2
    assert figures["fused.ply"]["accuracy_rms"] == pytest.approx(figures["fused.npz"]["accuracy_rms"], rel=1e-4)


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
    "a cloud of no known kind": (["evaluate", "rig.toml", "--truth", str(BRICK)], "must be .ply or .npz"),
    "a cloud that is none": (["evaluate", "fake.ply", "--truth", str(BRICK)], "fake.ply"),
    "a truth that is none": (["evaluate", "clouds/fused.ply", "--truth", "rig.toml"], "rig.toml"),
    "no tolerance": (["evaluate", "clouds/fused.ply", "--truth", str(BRICK), "--tolerance", "0"], "tolerance"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_files_cost_one_line(name, folder):
    (folder / "fake.ply").write_text("ply\nformat ascii 1.0\nelement vertex 9\nend_header\n")
    arguments, mentioned = WRONG[name]
    found = sonarwarp(*arguments, folder=folder)
    assert found.returncode in (1, 2)
    assert "Traceback" not in found.stderr
    assert mentioned in found.stderr
    assert len(found.stderr.strip().splitlines()) == 1
    assert not (folder / "new").exists()


@pytest.mark.parametrize("suffix", [".ply", ".npz"])
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
