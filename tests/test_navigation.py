"""Motion and navigation errors: amplitudes as stated, keyed by run, each part alone."""

import numpy as np
import pytest

from sonarwarp import PRESETS, plan_survey
from sonarwarp.navigation import Motion, Navigation, moved, navigated, plan_disturbed
from sonarwarp_scenes import straight_trajectory

RUN = straight_trajectory((0.0, 0.0, 2.0), heading=0.3, speed=0.1, length=20.0)
STILL = Motion(heave=0.0, roll_deg=0.0, pitch_deg=0.0, yaw_deg=0.0)
PERFECT = {
    "dvl_scale": 0.0,
    "dvl_noise": 0.0,
    "depth": 0.0,
    "attitude_deg": 0.0,
    "altitude": 0.0,
    "head_angle_deg": 0.0,
    "lever_arm": 0.0,
    "boresight_deg": 0.0,
}


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
    true, believed = plan_disturbed(rig, [RUN], motion=STILL, navigation=Navigation(**PERFECT), seed=1)
    planned = plan_survey(rig, [RUN])
    for survey in (true, believed):
        assert np.allclose(survey.frames.pose, planned.frames.pose, atol=1e-12)
        assert np.allclose(survey.pings.pose, planned.pings.pose, atol=1e-12)
        assert np.array_equal(survey.pings.head_angle, planned.pings.head_angle)
        assert np.allclose(survey.frames.altitude, planned.frames.altitude)


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
    navigation = Navigation(**{**PERFECT, **part})
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
    navigation = Navigation(**{**PERFECT, "head_angle_deg": 0.2, "lever_arm": 0.01, "boresight_deg": 0.2})
    true, believed = plan_disturbed(rig, [RUN] * 100, motion=STILL, navigation=navigation, seed=2)
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
