"""The benchmark measures what it says; no test asserts a time."""

from dataclasses import replace

from benchmarks.cases import CASES
from benchmarks.run import measure
from sonarwarp_scenes import Deployment
from tests.small_runs import RIG, SETTINGS, run, scene


def deployment():
    return Deployment(name="small", scene=scene(), objects=(), trajectory=run(), frames_from=0.0)


def test_a_row_says_case_device_versions_and_shares(device):
    case = replace(CASES[0], name="small", deployment=deployment, rig=RIG, settings=SETTINGS, trajectories=2)
    seen = []
    row = measure(case, device=device, seed=5, repeats=1, watch=seen.append)
    assert (row["case"], row["seed"], row["trajectories"]) == ("small", 5, 2)
    assert row["frames"] == 2 * 31
    assert row["frames_per_second"] > 0
    assert row["peak_memory_mib"] > 0
    stages = row["stage_ms_per_frame"]
    assert {"FLS cast and form", "PS cast and form", "FLS noise", "critical points", "field", "particles"} <= set(
        stages
    )
    assert {"warp", "numpy", "python"} <= set(row["versions"])
    assert row["device"]["alias"] == device
    assert seen


def test_names_of_cases_are_unique():
    names = [case.name for case in CASES]
    assert len(set(names)) == len(names)
    assert any(case.quick for case in CASES)
