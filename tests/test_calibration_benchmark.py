"""The benchmark of calibration judges every tenth frame, each run in its own scene, and pools them."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.calibration import CASES, EVERY, KINDS, join, judge, measure, table
from sonarwarp.app.experiment import run_batch
from sonarwarp.app.paper_cases import Case
from sonarwarp.metrics import evaluate
from tests.small_runs import CARVED, RIG
from tests.test_demo import watch
from tests.test_paper import ALONE, MISALIGNED

SMALL = (
    Case(name="field", object="brick", rig=RIG, deploy=ALONE),
    Case(name="deployments", object="90", arrangement="misaligned", rig=RIG, deploy=MISALIGNED),
)


def calibration(judged, device):
    found = evaluate(judged.cloud, scene=judged.scene, survey=judged.truth, contacts=judged.contacts, device=device)
    return {metrics.kind: metrics for metrics in found.calibration}


@pytest.fixture(scope="module")
def judged(device):
    experiments = [replace(case.experiment(3, "field"), settings=CARVED) for case in SMALL]
    return [judge(run_batch([experiment], device=device, watch=watch)[0], watch) for experiment in experiments]


def test_every_tenth_frame_is_judged(judged):
    for part in judged:
        numbers = part.truth.frames.number
        assert (np.diff(numbers) == EVERY).all()
        assert part.contacts.range.shape == (len(numbers), RIG.fls.beams)
        assert set(part.cloud.attributes["frame"]) <= set(numbers)
        assert len(part.cloud) > 0
        assert not part.cloud.attributes["source"].any()


def test_runs_together_count_as_each_by_itself(judged, device):
    alone = [calibration(part, device) for part in judged]
    together = calibration(join(judged), device)
    assert set(together) == {kind for part in alone for kind in part}
    for kind, metrics in together.items():
        parts = [part[kind] for part in alone if kind in part]
        assert metrics.points == sum(part.points for part in parts)
        covered = sum(part.coverage * part.points for part in parts)
        assert metrics.coverage == pytest.approx(covered / metrics.points)
        sharpness = [part.sharpness for part in parts]
        assert min(sharpness) <= metrics.sharpness <= max(sharpness)


def test_small_cases_give_rows_by_experiment_and_the_documented_columns(device):
    measured = measure(SMALL, seeds=(3, 4), device=device, watch=watch)
    assert list(dict.fromkeys((row["experiment"], row["object"]) for row in measured)) == [
        ("field", "brick"),
        ("deployments", "90"),
        ("all", None),
    ]
    for row in measured:
        assert row["kind"] in KINDS
        assert row["seeds"] == 2
        assert 0.0 <= row["coverage"] <= 1.0
        assert 0.0 < row["sharpness_deg"] < 14.0
    pooled = [row for row in measured if row["experiment"] == "all"]
    assert sum(row["points"] for row in pooled) == sum(row["points"] for row in measured if row not in pooled) > 0
    heading, rule, *lines = table(measured).splitlines()
    assert heading == "| Points | Judged | In the 95 % interval | Median deviation [deg] |"
    assert len(lines) == len(pooled)
    assert {line.count("|") for line in (heading, rule, *lines)} == {5}


def test_the_cases_are_the_brick_misaligned_pairs_and_slopes_from_45_degrees():
    assert [(case.name, case.object) for case in CASES] == [
        ("field", "brick"),
        *(("deployments", slope) for slope in ("30", "45", "60", "90")),
        *(("slope-limit", slope) for slope in ("90", "80", "60", "45")),
    ]
    assert {case.arrangement for case in CASES} == {None, "misaligned"}
