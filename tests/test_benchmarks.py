"""The benchmark measures what it says; no test asserts a time."""

from dataclasses import replace

import pytest

from benchmarks.cases import CASES
from benchmarks.log import measure_log
from benchmarks.meshes import MESHES, markdown
from benchmarks.run import measure
from sonarwarp_scenes import Deployment
from tests.small_runs import CARVED, RIG, SETTINGS, run, scene


def deployment():
    return Deployment(name="small", scene=scene(), objects=(), trajectory=run(), frames_from=0.0)


@pytest.mark.parametrize(
    ("settings", "hypotheses", "own"),
    [(SETTINGS, 32, {"particles"}), (CARVED, 128, {"free depth", "arcs", "strays and sides", "faces", "repeats"})],
    ids=["paper", "carved"],
)
def test_a_row_says_case_device_versions_and_shares(device, settings, hypotheses, own):
    case = replace(CASES[0], name="small", deployment=deployment, rig=RIG, settings=settings, trajectories=2)
    seen = []
    row = measure(case, device=device, seed=5, repeats=1, watch=seen.append)
    assert (row["case"], row["seed"], row["trajectories"]) == ("small", 5, 2)
    assert row["frames"] == 2 * 31
    assert row["frames_per_second"] > 0
    assert row["peak_memory_mib"] > 0
    stages = row["stage_ms_per_frame"]
    assert {"FLS cast and form", "PS cast and form", "FLS noise", "critical points", "field", *own} <= set(stages)
    assert (row["method"], row["hypotheses"]) == (settings.method, hypotheses)
    assert {"warp", "numpy", "python"} <= set(row["versions"])
    assert row["device"]["alias"] == device
    assert seen


def test_a_log_is_written_whole_and_read_back(device):
    seen = []
    row = measure_log(device=device, seed=5, frames=70, watch=seen.append)
    assert (row["case"], row["frames"], row["span_s"]) == ("log", 70, 7.0)
    for what in ("write", "read"):
        assert row[f"{what}_times_real_time"] == 7.0 / row[f"{what}_s"] > 0.0
    # Speckle does not compress away.
    assert 0.5 * row["images_mib"] < row["disk_mib"] < row["images_mib"]
    assert {"warp", "numpy", "python"} <= set(row["versions"])
    assert seen


def test_the_table_of_meshes_says_null_where_there_is_no_figure():
    figures = {"accuracy_mean": 0.01, "accuracy_rms": 0.0236, "accuracy_p95": 0.05, "precision": 0.899}
    row = {"title": MESHES[0].title, "method": "fused", "counted": 12, **figures, "completeness": None, "f_score": 0.5}
    heading, rule, line = markdown([row]).splitlines()
    assert heading.count("|") == rule.count("|") == line.count("|")
    assert line == "| ship, 3.5 m long | fused | 12 | 0.010 | 0.024 | 0.050 | 0.90 | null | 0.50 |"


def test_names_of_cases_are_unique():
    names = [case.name for case in CASES]
    assert len(set(names)) == len(names)
    assert any(case.quick for case in CASES)
