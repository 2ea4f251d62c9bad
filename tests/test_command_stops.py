"""Whatever stops a command, what is complete stays so, old outputs are there or replaced, and Ctrl-C costs a line."""

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import sonarwarp as sw
import sonarwarp_scenes
from sonarwarp.app.logs import reconstruct_files
from sonarwarp.store_scratch import sweep
from sonarwarp.toml_text import toml_text
from sonarwarp.trajectory_files import write_csv
from tests.small_logs import same_survey
from tests.small_runs import RIG, SETTINGS, run

BRICK = Path(sonarwarp_scenes.__file__).parent / "assets" / "brick.usda"

# Little memory makes many rounds of a short run.
COMMAND = """
from sonarwarp.app.__main__ import main
from sonarwarp.store_simulation import survey_to_store
survey_to_store.__kwdefaults__["memory"] = 1 << 19
main()
"""


def start(folder, *arguments, command=COMMAND):
    return subprocess.Popen(
        [sys.executable, "-c", command, *arguments],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def simulate(folder, out, *options, trajectory="run.csv", command=COMMAND):
    files = (str(BRICK), "--rig", "rig.toml", "--trajectory", trajectory, "--out", str(out), "--seed", "3")
    return start(folder, "simulate", *files, *options, command=command)


def reconstruct(folder, out):
    return start(folder, "reconstruct", "whole", "--out", out, "--seed", "3")


def wait(process):
    """Standard error of a process, once it has ended."""
    _, said = process.communicate(timeout=120)
    return said


def contents(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@pytest.fixture(scope="module", name="folder")
def folder_fixture(tmp_path_factory):
    """A tiny rig and run, what they become undisturbed, and what an older run left: of another seed."""
    folder = tmp_path_factory.mktemp("commands")
    (folder / "rig.toml").write_text(toml_text(rig=RIG, noise=sw.Noise(), reconstruction=SETTINGS))
    write_csv(run(length=3.0), folder / "run.csv")
    write_csv(run(length=60.0, start_x=-6.0), folder / "long.csv")
    survey = sw.plan_survey(RIG, [run(length=3.0)])
    for name, clouds, seed in (("whole", "clouds", 3), ("older", "older clouds", 4)):
        scene = sonarwarp_scenes.scene_from_file(BRICK)
        sw.survey_to_store(survey, [scene], folder / name, noise=sw.Noise(), seed=seed, reconstruction=SETTINGS)
        reconstruct_files(
            *(folder / "whole", folder / clouds),
            settings=None,
            seed=seed,
            device="cpu",
            watch=lambda *_: lambda _: None,
        )
    older, new = contents(folder / "older clouds"), contents(folder / "clouds")
    assert len(new) >= 6
    assert set(older) == set(new)
    assert all(older[name] != new[name] for name in new if name.startswith("fused"))
    return folder


def kill(process, draw, number, count, changed):
    """Kill a process: in one of ``count`` stretches of 3 s, or in odd cases soon after its output has ``changed``."""
    begin = time.monotonic()
    if number % 2:
        while not changed() and process.poll() is None:
            time.sleep(0.001)
        time.sleep(draw.uniform(0.0, 0.3))
    else:
        time.sleep(max(0.0, begin + 3.0 * (number + draw.random()) / count - time.monotonic()))
    process.kill()
    wait(process)


def frames_of_a_beginning(path, whole):
    """Frames that a log says are complete; all that it says so of is what an undisturbed run writes."""
    stored = sw.open_log(path)
    frames, pings = len(stored.survey.frames), len(stored.survey.pings)
    loaded, wanted = stored.load(), sw.open_log(whole).load()
    assert same_survey(stored.survey, wanted.survey, frames, pings)
    assert np.array_equal(loaded.images, wanted.images[:frames])
    assert np.array_equal(loaded.echoes, wanted.echoes[:pings])
    # No frame is complete before the pings that came with it.
    assert pings >= int(frames * len(wanted.echoes) / len(wanted.images))
    return frames


@pytest.mark.parametrize("count", [4, pytest.param(20, marks=pytest.mark.nightly)])
def test_simulate_killed_at_any_instant_leaves_what_is_complete(folder, tmp_path, count):
    draw, left = random.Random(count), []
    for number in range(count):
        path = tmp_path / f"{number}.zarr"
        overwrite = number % 4 >= 2
        if overwrite:
            shutil.copytree(folder / "older", path)
        before = os.stat(path).st_ino if overwrite else None

        def changed(path=path, before=before):
            return path.exists() and os.stat(path).st_ino != before

        kill(simulate(folder, path, *(["--overwrite"] if overwrite else [])), draw, number, count, changed)
        if overwrite and not path.exists():
            sweep(path)  # as the next command does
        if overwrite and os.stat(path).st_ino == before:
            left.append("older")
            assert frames_of_a_beginning(path, folder / "older") == len(sw.open_log(folder / "older").survey.frames)
        else:
            left.append(str(frames_of_a_beginning(path, folder / "whole")) if path.exists() else "nothing")
    assert len(set(left)) > 1, left


@pytest.mark.parametrize("count", [3, pytest.param(20, marks=pytest.mark.nightly)])
def test_reconstruct_killed_at_any_instant_leaves_whole_clouds(folder, tmp_path, count):
    draw, left = random.Random(count), []
    older, new = contents(folder / "older clouds"), contents(folder / "clouds")
    for number in range(count):
        out = tmp_path / str(number)
        fresh = number % 4 >= 2
        if not fresh:
            shutil.copytree(folder / "older clouds", out)
        first = out / "single.ply"
        before = None if fresh else os.stat(first).st_ino

        def changed(first=first, before=before):
            return first.exists() and os.stat(first).st_ino != before

        kill(reconstruct(folder, str(out)), draw, number, count, changed)
        found = contents(out) if out.exists() else {}
        assert fresh or set(new) <= set(found)
        for name in set(found) & set(new):
            assert found[name] == new[name] or (not fresh and found[name] == older[name]), name
        # Anything else is a draft, and says so by its name.
        assert all(name.startswith(".") or name.endswith(".partial") for name in set(found) - set(new))
        left.append(tuple(name for name in new if found.get(name) == new[name]))
    assert count < 20 or len(set(left)) > 2, left


def test_interrupted_simulate_says_how_far_its_log_came(folder, tmp_path):
    path = tmp_path / "run.zarr"
    process = simulate(folder, path, trajectory="long.csv")
    while process.poll() is None and not (path.exists() and len(sw.open_log(path).survey.frames)):
        time.sleep(0.001)
    process.send_signal(signal.SIGINT)
    said = wait(process)
    stored = sw.open_log(path)
    complete, planned = len(stored.survey.frames), stored.frames_planned
    assert 0 < complete < planned
    assert said == (f"sonarwarp: interrupted after {complete} of {planned} frames; {path} can be read\n")
    assert process.returncode == 130


def test_interrupted_before_there_is_a_log_leaves_nothing(folder, tmp_path):
    path = tmp_path / "run.zarr"
    command = (
        "import os, signal, sonarwarp.store_create as store\n"
        "store.settle = lambda _: os.kill(os.getpid(), signal.SIGINT)\n" + COMMAND
    )
    process = simulate(folder, path, command=command)
    assert wait(process) == "sonarwarp: interrupted; what was written so far is kept\n"
    assert process.returncode == 130
    assert list(tmp_path.iterdir()) == []


def test_what_begins_is_light():
    command = "import sonarwarp.app.__main__, sys; print(*{'numpy', 'typer', 'warp'} & set(sys.modules))"
    run = subprocess.run([sys.executable, "-c", command], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == ""


def test_interrupted_as_it_starts_costs_one_line(folder, tmp_path):
    command = "from sonarwarp.app.__main__ import main; print(flush=True); main()"
    for delay in (0.01, 0.03, 0.1, 0.2, 0.3, 0.5, 0.8):
        process = simulate(folder, tmp_path / "run.zarr", trajectory="long.csv", command=command)
        assert process.stdout is not None
        process.stdout.readline()
        time.sleep(delay)
        process.send_signal(signal.SIGINT)
        said = wait(process)
        assert (process.returncode, len(said.splitlines())) == (130, 1), (delay, said)
        assert said.startswith("sonarwarp: interrupted"), delay
