"""Motion and navigation errors: amplitudes as stated, keyed by run, each part alone."""

from dataclasses import fields, replace

import numpy as np
import pytest

from sonarwarp import PRESETS, plan_survey
from sonarwarp.navigation import EXACT_NAVIGATION, NO_MOTION, Motion, Navigation, moved, navigated, plan_disturbed
from sonarwarp_scenes import straight_trajectory
from tests.small_logs import same_survey

RUN = straight_trajectory((0.0, 0.0, 2.0), heading=0.3, speed=0.1, length=20.0)


def only(**part):
    """Navigation with one error alone."""
    return replace(EXACT_NAVIGATION, **part)


def angle_between(a, b):
    """Angle between quaternions [rad]."""
    return 2.0 * np.arccos(np.clip(np.abs(np.sum(a * b, axis=-1)), 0.0, 1.0))


def test_heave_and_attitude_swing_by_their_amplitudes():
    true = moved(RUN, Motion(), seed=3)
    planned = RUN.at(true.times)
    heave = true.poses[:, 2] - planned[:, 2]
    assert np.ptp(heave) == pytest.approx(0.06, rel=1e-3)
    assert np.allclose(true.poses[:, :2], planned[:, :2])
    turn = moved(RUN, Motion(heave=0.0, roll_deg=0.0, pitch_deg=0.0), seed=3)
    assert angle_between(turn.poses[:, 3:], planned[:, 3:]).max() == pytest.approx(np.radians(1.0), rel=1e-3)


def test_no_motion_and_perfect_instruments_change_nothing():
    rig = PRESETS["paper field"]
    planned = plan_survey(rig, [RUN])
    for survey in plan_disturbed(rig, [RUN], motion=NO_MOTION, navigation=EXACT_NAVIGATION, seed=1):
        assert same_survey(survey, planned)


@pytest.mark.parametrize("part", [field.name for field in fields(Motion) if "period" not in field.name])
def test_each_part_of_motion_is_on_alone(part):
    rig, motion = PRESETS["paper field"], replace(NO_MOTION, **{part: 0.5})
    true, believed = plan_disturbed(rig, [RUN], motion=motion, seed=1)
    assert same_survey(believed, true)
    planned = plan_survey(rig, [RUN]).frames.pose
    assert not np.allclose(true.frames.pose, planned, atol=1e-4)
    assert (part == "heave") == (np.allclose(true.frames.pose[:, 3:], planned[:, 3:], atol=1e-9))


@pytest.mark.parametrize("part", [field.name for field in fields(Navigation) if field.name != "fix_rate"])
def test_each_error_is_on_alone(part):
    true, believed = plan_disturbed(PRESETS["paper field"], [RUN], navigation=only(**{part: 0.5}), seed=1)
    moves = {
        "altitude": {"frames.altitude"},
        "head_angle_deg": {"pings.head_angle"},
        "lever_arm": {"frames.pose", "pings.pose"},
        "boresight_deg": {"frames.pose", "pings.pose"},
    }
    differing = {
        f"{kind}.{field.name}"
        for kind in ("frames", "pings")
        for field in fields(getattr(true, kind))
        if not np.allclose(getattr(getattr(true, kind), field.name), getattr(getattr(believed, kind), field.name))
    }
    assert differing == moves.get(part, {"frames.pose", "pings.pose"})


def test_a_run_has_its_errors_wherever_it_stands_in_a_batch():
    rig = PRESETS["paper field"]
    setting = {"motion": Motion(), "navigation": Navigation(), "seed": 5}
    alone = plan_disturbed(rig, [RUN], keys=[7], **setting)
    batch = plan_disturbed(rig, [RUN, RUN], keys=[2, 7], **setting)
    for one, many in zip(alone, batch, strict=True):
        mine = many.frames.trajectory == 1
        assert np.array_equal(one.frames.pose, many.frames.pose[mine])
        assert not np.allclose(one.frames.pose, many.frames.pose[~mine])
        assert np.array_equal(one.frames.altitude, many.frames.altitude[mine])


def spread(part, values_of):
    """Standard deviation over 400 runs of one error alone."""
    navigation = only(**part)
    return np.std([values_of(navigated(RUN, navigation, seed=1, key=key)) for key in range(400)])


def test_dead_reckoning_errs_as_stated():
    truth = RUN
    # Five standard errors of a deviation over 400 runs: 5 / sqrt(800).
    close = {"rel": 0.18}
    along = np.array([np.cos(0.3), np.sin(0.3)])
    end = truth.poses[-1]
    assert spread({"dvl_scale": 0.002}, lambda t: (t.poses[-1, :2] - end[:2]) @ along) == pytest.approx(0.04, **close)
    fixes = 200.0 * 5.0
    drift = 0.001 / 5.0 * np.sqrt(fixes)
    assert spread({"dvl_noise": 0.001}, lambda t: t.poses[-1, 0] - end[0]) == pytest.approx(drift, **close)
    assert spread({"dvl_bias": 0.001}, lambda t: t.poses[-1, 0] - end[0]) == pytest.approx(0.2, **close)
    assert spread({"depth": 0.01}, lambda t: t.poses[3, 2] - 2.0) == pytest.approx(0.01, **close)
    bias = spread({"depth": 0.01}, lambda t: t.poses[:, 2].mean() - 2.0)
    assert bias == pytest.approx(0.01 / np.sqrt(2.0), **close)


def test_mounts_and_head_err_once_per_run():
    rig = PRESETS["paper field"]
    navigation = only(head_angle_deg=0.2, lever_arm=0.01, boresight_deg=0.2)
    true, believed = plan_disturbed(rig, [RUN] * 100, navigation=navigation, seed=2)
    head = (true.pings.head_angle - believed.pings.head_angle).reshape(100, -1)
    assert np.ptp(head, axis=1).max() < 1e-12
    assert np.std(head[:, 0]) == pytest.approx(np.radians(0.2), rel=0.36)
    first = believed.frames.number == 0
    arm = true.frames.pose[first, :3] - believed.frames.pose[first, :3]
    assert np.std(arm) == pytest.approx(0.01, rel=0.25)
    turn = angle_between(true.frames.pose[first, 3:], believed.frames.pose[first, 3:])
    # Three independent axes.
    assert np.sqrt(np.mean(turn**2)) == pytest.approx(np.sqrt(3.0) * np.radians(0.2), rel=0.25)


def test_wrong_errors_are_refused_by_name():
    with pytest.raises(ValueError, match=r"Navigation\.depth: -1 is outside \[0, 10\]"):
        Navigation(depth=-1.0)
    with pytest.raises(ValueError, match=r"Motion\.heave_period"):
        Motion(heave_period=0.0)
    for wrong in ({"seed": -1}, {"keys": [-1]}, {"seed": 2**65}):
        with pytest.raises(ValueError, match=rf"{next(iter(wrong))}: .* is outside \[0, "):
            plan_disturbed(PRESETS["paper field"], [RUN], **wrong)
