"""The schedule: everything once, in the order of time that the fields need, within the room there is."""

import numpy as np
import pytest

import sonarwarp as sw
from sonarwarp.schedule import EMPTY
from tests.small_runs import RIG, run


def survey_of(*lengths):
    return sw.plan_survey(RIG, [run(length=length) for length in lengths])


def filled(index):
    return index[index != EMPTY]


CASES = {
    "one run": (survey_of(0.6), 8, 6, True),
    "runs of different lengths": (survey_of(0.6, 0.2, 1.1), 8, 6, True),
    "a round of one frame": (survey_of(0.3, 0.3), 1, 6, True),
    "all in one round": (survey_of(0.4), 1000, 6, True),
    "window of one ping": (survey_of(0.6, 0.4), 8, 1, True),
    "offline": (survey_of(0.6, 0.2), 8, 6, False),
}


@pytest.fixture(params=CASES, name="case")
def case_fixture(request):
    survey, frames, window, causal = CASES[request.param]
    return survey, sw.plan_schedule(survey, frames=frames, window=window, causal=causal), frames, window, causal


def test_everything_stands_exactly_once(case):
    survey, schedule, *_ = case
    for count, tables in (
        (len(survey.frames), (schedule.round_frame, schedule.epoch_frame)),
        (len(survey.pings), (schedule.round_ping, schedule.epoch_ping)),
    ):
        for table in tables:
            assert np.array_equal(np.sort(filled(table)), np.arange(count))


def test_a_rounds_epochs_hold_what_the_round_forms(case):
    _, schedule, most, *_ = case
    assert schedule.round_frame.shape[1] <= most
    for number in range(schedule.rounds):
        assert np.array_equal(filled(schedule.epoch_frame[number]), filled(schedule.round_frame[number]))
        assert np.array_equal(filled(schedule.epoch_ping[number]), filled(schedule.round_ping[number]))


def test_a_frame_comes_after_exactly_the_pings_before_it(case):
    survey, schedule, _, window, causal = case
    frames, pings = survey.frames, survey.pings
    sent = [[] for _ in range(survey.trajectories)]
    held = [set() for _ in range(survey.trajectories)]
    last_frame = np.full(survey.trajectories, -np.inf)
    for number in range(schedule.rounds):
        for epoch in range(schedule.epochs):
            entering, leaving = schedule.epoch_ping[number, epoch], schedule.epoch_leaving[number, epoch]
            for row in entering:
                owners = set(pings.trajectory[filled(row)].tolist())
                assert len(owners) <= 1
            owners = [pings.trajectory[row[row != EMPTY][0]] for row in entering if (row != EMPTY).any()]
            assert len(owners) == len(set(owners))
            for ping in filled(entering):
                sent[pings.trajectory[ping]].append(ping)
                held[pings.trajectory[ping]].add(ping)
            for ping in filled(leaving):
                held[pings.trajectory[ping]].remove(ping)
            for frame in filled(schedule.epoch_frame[number, epoch]):
                owner, time = frames.trajectory[frame], frames.time[frame]
                mine = np.flatnonzero(pings.trajectory == owner)
                expected = mine[pings.time[mine] <= time] if causal else mine
                assert sent[owner] == expected.tolist()
                assert held[owner] == set(expected[-window:].tolist() if causal else expected.tolist())
                assert time > last_frame[owner]
                last_frame[owner] = time


def test_a_survey_without_pings_has_frames_all_the_same():
    survey = survey_of(0.4)
    none = sw.Pings(
        time=np.zeros(0),
        trajectory=np.zeros(0, dtype=int),
        number=np.zeros(0, dtype=int),
        pose=np.zeros((0, 7)),
        head_angle=np.zeros(0),
    )
    schedule = sw.plan_schedule(sw.Survey(rig=RIG, frames=survey.frames, pings=none), frames=8, window=3)
    assert np.array_equal(filled(schedule.epoch_frame), np.arange(len(survey.frames)))
    assert filled(schedule.epoch_ping).size == 0


def test_memory_bounds_the_frames_of_a_round():
    frame = RIG.fls.beams * RIG.fls.bins * 16
    assert sw.frames_per_round(RIG, 5 * frame + 1) == 5
    with pytest.raises(ValueError, match=rf"memory: {frame - 1} bytes, must be at least {frame} for one frame"):
        sw.frames_per_round(RIG, frame - 1)
    with pytest.raises(ValueError, match="window: 0, must be at least 1"):
        sw.plan_schedule(survey_of(0.2), frames=8, window=0)
