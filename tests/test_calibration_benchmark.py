"""The benchmark of calibration judges every tenth frame and all faces, each run in its own scene, and pools them."""

import numpy as np
import pytest

from benchmarks.calibration import CASES, EVERY, KINDS, judge, measure, table
from sonarwarp.app.experiment import run_batch
from sonarwarp.app.paper_cases import Case
from tests.test_carving import SWIFT
from tests.test_demo import watch
from tests.test_paper import ALONE, MISALIGNED

SMALL = (
    Case(name="field", object="brick", rig=SWIFT, deploy=ALONE),
    Case(name="deployments", object="90", arrangement="misaligned", rig=SWIFT, deploy=MISALIGNED),
)


@pytest.fixture(scope="module", name="judged")
def judged_fixture(device):
    """Runs, and what their points claim."""
    runs = [run_batch([case.experiment(8, "field")], device=device, watch=watch)[0] for case in SMALL]
    return [(run, judge(run, watch)) for run in runs]


def test_contacts_of_every_tenth_frame_and_all_faces_are_judged(judged):
    for run, claims in judged:
        attributes = run.clouds.fused.attributes
        faces = attributes["source"] == 1
        numbers = run.truth.frames.number
        assert (np.diff(numbers) == 1).all()
        judged_frame = (attributes["frame"] - numbers[0]) % EVERY == 0
        contacts = int(np.sum(~faces & judged_frame))
        assert 0 < contacts < np.sum(~faces)
        assert np.sum(claims.kind != "face") == contacts
        assert np.sum(claims.kind == "face") == faces.sum()
    assert any("face" in claims.kind for _run, claims in judged)


def test_small_cases_give_rows_by_experiment_and_the_documented_columns(device):
    measured = measure(SMALL, seeds=(4, 8), device=device, watch=watch)
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
    assert {row["kind"] for row in pooled} == {row["kind"] for row in measured} >= {"top", "face"}
    for row in pooled:
        parts = [part for part in measured if part["kind"] == row["kind"] and part not in pooled]
        assert row["points"] == sum(part["points"] for part in parts) > 0
        assert row["coverage"] == pytest.approx(
            sum(part["coverage"] * part["points"] for part in parts) / row["points"]
        )
    heading, rule, *lines = table(measured).splitlines()
    assert heading == "| Points | Judged | Held in 95 % | Median deviation [deg] |"
    assert len(lines) == len(pooled)
    assert {line.count("|") for line in (heading, rule, *lines)} == {5}


def test_the_cases_are_the_brick_misaligned_pairs_and_slopes_from_45_degrees():
    assert [(case.name, case.object) for case in CASES] == [
        ("field", "brick"),
        *(("deployments", slope) for slope in ("30", "45", "60", "90")),
        *(("slope-limit", slope) for slope in ("90", "80", "60", "45")),
    ]
    assert {case.arrangement for case in CASES} == {None, "misaligned"}
