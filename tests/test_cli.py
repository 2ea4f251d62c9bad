"""The command line as a user meets it: help, facts, one-line refusals."""

import json
import subprocess
import sys

import pytest
import warp as wp


def sonarwarp(*arguments, folder=None):
    """Run the command line in a process of its own."""
    return subprocess.run(
        [sys.executable, "-c", "from sonarwarp.app.cli import main; main()", *arguments],
        capture_output=True,
        text=True,
        check=False,
        cwd=folder,
    )


@pytest.mark.parametrize("arguments", [["--help"], ["demo", "--help"], ["paper", "--help"], ["info", "--help"], []])
def test_help_is_there(arguments):
    run = sonarwarp(*arguments)
    assert run.returncode == 0
    assert "Usage" in run.stdout


def test_info_is_json_and_nothing_else():
    run = sonarwarp("info", "--json")
    assert run.returncode == 0
    facts = json.loads(run.stdout)
    assert {"versions", "devices", "presets"} <= set(facts)
    assert {"paper simulation", "paper slope series", "paper field"} == set(facts["presets"])


def test_info_is_a_table_for_people():
    run = sonarwarp("info")
    assert run.returncode == 0
    assert "paper field" in run.stdout


WRONG = {
    "no such command": (["dmeo"], "dmeo"),
    "no such option": (["demo", "--sed", "1"], "--sed"),
    "no such device": (["demo", "--device", "cuda:9"], "device: 'cuda:9'"),
    "no device of any kind": (["demo", "--device", "gpu"], "device: 'gpu'"),
    "a negative seed": (["demo", "--seed", "-1"], "--seed"),
    "a seed that is no number": (["demo", "--seed", "x"], "--seed"),
    "no such mesh": (["demo", "--mesh", "missing.obj"], "missing.obj"),
    "a mesh that is none": (["demo", "--mesh", "notes.obj"], "notes.obj"),
    "a scale of nothing": (["demo", "--mesh", "notes.obj", "--scale", "0"], "scale"),
    "a scale without a mesh": (["demo", "--scale", "2"], "needs --mesh"),
    "an altitude without a mesh": (["demo", "--altitude", "2"], "needs --mesh"),
    "an output that is a file": (["demo", "--out", "notes.obj"], "notes.obj"),
    "an output below a file": (["demo", "--out", "notes.obj/below"], "notes.obj"),
    "no experiment of the paper": (["paper"], "Missing argument"),
    "another experiment than the paper's": (["paper", "lake"], "'lake'"),
    "no seed at all": (["paper", "field", "--seeds", "0"], "--seeds"),
    "noise of another kind": (["paper", "field", "--noise", "pink"], "'pink'"),
    "rows below a file": (["paper", "field", "--json", "notes.obj/rows.json"], "json: cannot write"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_input_costs_one_line(name, tmp_path):
    (tmp_path / "notes.obj").write_text("these are notes\n")
    arguments, mentioned = WRONG[name]
    run = sonarwarp(*arguments, folder=tmp_path)
    assert run.returncode == 2
    assert run.stdout == ""
    assert "Traceback" not in run.stderr
    assert mentioned in run.stderr
    assert len(run.stderr.strip().splitlines()) == 1


def test_any_gpu_where_there_is_none_costs_one_line(tmp_path):
    if wp.is_cuda_available():
        pytest.skip("there is a GPU")
    run = sonarwarp("demo", "--device", "cuda", folder=tmp_path)
    assert run.returncode == 2
    assert "device: 'cuda'" in run.stderr
    assert len(run.stderr.strip().splitlines()) == 1


def test_interrupted_work_costs_one_line(tmp_path):
    command = "import os, signal, threading; from sonarwarp.app.__main__ import main; {}; main()"
    # Once kernels are loaded and frames come, long before the end.
    when = "threading.Timer(4.0, os.kill, (os.getpid(), signal.SIGINT)).start()"
    run = subprocess.run(
        [sys.executable, "-c", command.format(when), "demo"], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert run.returncode == 130
    assert run.stdout == ""
    (line,) = run.stderr.strip().splitlines()
    # What loads late, such as the pages' drawing, ends the process as it loads.
    assert line in ("sonarwarp: interrupted; what was written so far is kept", "sonarwarp: interrupted")
