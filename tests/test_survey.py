"""Surveys: rates, poses and numbers of frames and pings; batches joined; bad instants refused."""

from dataclasses import replace

import numpy as np
import pytest

import sonarwarp as sw
from sonarwarp.survey import join_surveys
from tests.small_runs import RIG, run


def test_rates_start_and_poses():
    survey = sw.plan_survey(RIG, [run(length=0.5)], frames_from=2.0)
    frames, pings = survey.frames, survey.pings
    assert frames.time[0] == pytest.approx(2.0)
    assert np.allclose(np.diff(frames.time), 1.0 / RIG.fls.rate)
    assert np.allclose(np.diff(pings.time), 1.0 / RIG.ps.rate)
    assert pings.time[0] == 0.0
    # A frame keeps the number that it has in the whole run: its noise does not depend on where recording began.
    assert frames.number[0] == 20
    assert np.allclose(frames.pose[:, 0], -3.1 + 0.1 * frames.time)
    assert np.allclose(frames.altitude, 1.8)
    assert np.allclose(pings.pose[:, 2], 1.8 + RIG.ps_mount.position[2])


def test_a_run_that_ends_before_recording_begins_is_refused():
    with pytest.raises(ValueError, match=r"frames_from: 3\.01 s, must be at most 3 s, the run's last frame"):
        sw.plan_survey(RIG, [run(length=0.3)], frames_from=3.01)
    assert len(sw.plan_survey(RIG, [run(length=0.3)], frames_from=3.0).frames) == 1
    # The first run records from its start, the second from later on.
    both = sw.plan_survey(RIG, [run(), run()], frames_from=[0.0, 2.0]).frames
    assert [float(both.time[both.trajectory == index].min()) for index in (0, 1)] == [0.0, 2.0]


def test_joined_surveys_number_their_trajectories_on():
    one, two = sw.plan_survey(RIG, [run()]), sw.plan_survey(RIG, [run(length=0.2), run()])
    joined = join_surveys([one, two])
    assert joined.trajectories == 3
    assert np.array_equal(np.unique(joined.frames.trajectory), [0, 1, 2])
    assert np.array_equal(joined.frames.pose[joined.frames.trajectory == 0], one.frames.pose)
    with pytest.raises(ValueError, match="surveys: empty"):
        join_surveys([])


def test_bad_instants_are_refused_by_name():
    frames = sw.plan_survey(RIG, [run()]).frames
    late = frames.time.copy()
    late[3] = late[2]
    with pytest.raises(ValueError, match=r"Frames\.time: does not ascend within trajectory 0"):
        replace(frames, time=late)
    pose = frames.pose.copy()
    pose[1, 6] = 2.0
    with pytest.raises(ValueError, match=r"Frames\.pose: quaternion of length .*, must be 1"):
        replace(frames, pose=pose)
    pose[1, 6] = np.nan
    with pytest.raises(ValueError, match=r"Frames\.pose: nan at index"):
        replace(frames, pose=pose)
    with pytest.raises(ValueError, match=r"Frames\.altitude: -1, must be above 0"):
        replace(frames, altitude=-np.ones(len(frames)))
    with pytest.raises(ValueError, match=r"Frames\.number: expected shape"):
        replace(frames, number=frames.number[1:])
