"""The benchmark of conditions: each changes the one part that it says, and the complete one is the experiment's own."""

from dataclasses import fields

import numpy as np
import pytest

import sonarwarp as sw
from benchmarks.conditions import CASES, CONDITIONS, measure, run_under
from benchmarks.variants import variant_table
from sonarwarp.app.experiment import record, run_recorded
from tests.small_runs import same_points
from tests.test_ablation import BRICK

BY_TITLE = {condition.title: condition for condition in CONDITIONS}

PARTS = {
    "field noise": set(),
    "no speckle": {"noise.speckle"},
    "no background": {"noise.background_db"},
    "flat seabed": {"rough"},
    "no waves": {"motion.heave", "motion.roll_deg", "motion.pitch_deg", "motion.yaw_deg"},
    "exact DVL": {"navigation.dvl_scale", "navigation.dvl_noise"},
    "exact depth, altitude, attitude": {"navigation.depth", "navigation.altitude", "navigation.attitude_deg"},
    "exact mounts and head": {"navigation.head_angle_deg", "navigation.lever_arm", "navigation.boresight_deg"},
    "background up 6 dB": {"noise.background_db"},
    "waves twice as high": {"motion.heave", "motion.roll_deg", "motion.pitch_deg", "motion.yaw_deg"},
    "mounts and head twice as far off": {
        "navigation.head_angle_deg",
        "navigation.lever_arm",
        "navigation.boresight_deg",
    },
    "DVL's bias 0.1 cm/s": {"navigation.dvl_bias"},
}
"""What differs from the defaults of the field noise."""


def changed(condition):
    """Names of parts that are not the field noise's."""
    parts = {"noise": sw.Noise(), "motion": sw.Motion(), "navigation": sw.Navigation()}
    names = {
        f"{part}.{item.name}"
        for part, default in parts.items()
        for item in fields(default)
        if getattr(getattr(condition, part), item.name) != getattr(default, item.name)
    }
    return names if condition.rough else names | {"rough"}


def test_every_condition_changes_what_it_says_and_nothing_else():
    assert {title: changed(condition) for title, condition in BY_TITLE.items()} == PARTS
    doubled, off = BY_TITLE["waves twice as high"].motion, sw.Motion()
    assert all(
        getattr(doubled, name) == 2.0 * getattr(off, name) for name in ("heave", "roll_deg", "pitch_deg", "yaw_deg")
    )
    assert [(case.object, case.arrangement) for case in CASES] == [("brick", None), ("90", "misaligned")]


def test_the_complete_condition_is_the_experiment_s_own(device):
    experiment = BRICK.experiment(3, "field")
    want = run_recorded(experiment, record(experiment, device=device), device=device)
    found = run_under(BY_TITLE["field noise"], BRICK, 3, device=device)
    assert len(want.clouds.fused) > 100
    assert same_points(want.clouds.fused, found.clouds.fused)


def test_what_is_left_on_stays_as_it_was(device):
    whole, still, flat = (
        run_under(BY_TITLE[title], BRICK, 3, device=device) for title in ("field noise", "no waves", "flat seabed")
    )
    # The errors of position are the same with waves and without; to rounding of positions of some metres.
    errors = [run.survey.frames.pose[:, :3] - run.truth.frames.pose[:, :3] for run in (whole, flat)]
    assert np.abs(errors[0]).max() > 1e-3
    np.testing.assert_array_equal(errors[0], errors[1])
    assert np.ptp(whole.truth.frames.pose[:, 2]) > 0.01 > np.ptp(still.truth.frames.pose[:, 2])


def test_a_small_case_gives_a_line_for_each_condition(device):
    some = [BY_TITLE[title] for title in ("field noise", "no speckle")]
    steps = []
    measured = measure([BRICK], some, seeds=(3, 4), device=device, watch=lambda *_: steps.append)
    assert sum(steps) == 4
    assert [(row["variant"], row["seed"]) for row in measured] == [(one.title, seed) for one in some for seed in (3, 4)]
    heading, _, *lines = variant_table(measured).splitlines()
    assert heading == "| Slope / area / volume error | brick |"
    assert [line.split(" | ")[0] for line in lines] == ["| field noise", "| no speckle"]


@pytest.mark.parametrize("title", ["no background", "background up 6 dB", "exact mounts and head"])
def test_a_condition_reaches_the_clouds(device, title):
    clouds = [run_under(BY_TITLE[name], BRICK, 3, device=device).clouds.single for name in ("field noise", title)]
    assert not np.array_equal(clouds[0].points, clouds[1].points)
