"""The schedule: everything once, in the order of time that the fields need, within the room there is."""

from dataclasses import replace

import numpy as np
import pytest

import sonarwarp as sw
from sonarwarp.schedule import EMPTY, check_schedule
from tests.small_runs import RIG, none_of, run


def survey_of(*lengths, frames_from=0.0):
    return sw.plan_survey(RIG, [run(length=length) for length in lengths], frames_from=frames_from)


def filled(index):
    return index[index != EMPTY]


CASES = {
    "one run": (survey_of(0.6), 8, 6, True),
    "runs of different lengths": (survey_of(0.6, 0.2, 1.1), 8, 6, True),
    "a round of one frame": (survey_of(0.3, 0.3), 1, 6, True),
    "all in one round": (survey_of(0.4), 1000, 6, True),
    "window of one ping": (survey_of(0.6, 0.4), 8, 1, True),
    "offline": (survey_of(0.6, 0.2), 8, 6, False),
    "many pings before the first frame": (survey_of(0.6, 0.5, frames_from=4.5), 2, 4, True),
    "no pings": (replace(survey_of(0.4, 0.2), pings=none_of(survey_of(0.1).pings)), 8, 6, True),
    "pings alone": (replace(survey_of(0.4, 0.2), frames=none_of(survey_of(0.1).frames)), 8, 6, True),
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
    survey, schedule, most, *_ = case
    assert schedule.round_frame.shape[1] <= most
    for number in range(schedule.rounds):
        # One epoch may bring 8 pings of each of as many trajectories; more epochs share the room.
        sent = filled(schedule.round_ping[number])
        if (schedule.epoch_ping[number] != EMPTY).any(axis=(1, 2)).sum() > 1:
            assert len(sent) <= most
        assert np.bincount(survey.pings.trajectory[sent], minlength=1).max() <= max(8, most)
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


def test_what_leaves_the_window_is_a_windows_pings_old(case):
    survey, schedule, _, window, causal = case
    order = [np.flatnonzero(survey.pings.trajectory == owner).tolist() for owner in range(survey.trajectories)]
    entering, leaving = schedule.epoch_ping.ravel(), schedule.epoch_leaving.ravel()
    assert (leaving[entering == EMPTY] == EMPTY).all()
    for new, old in zip(entering[entering != EMPTY], leaving[entering != EMPTY], strict=True):
        mine = order[survey.pings.trajectory[new]]
        place = mine.index(new)
        assert old == (mine[place - window] if causal and place >= window else EMPTY)


def test_offline_all_pings_come_before_any_frame():
    survey, frames, window, causal = CASES["offline"]
    schedule = sw.plan_schedule(survey, frames=frames, window=window, causal=causal)
    with_ping = (schedule.epoch_ping != EMPTY).any(axis=(2, 3)).ravel()
    with_frame = (schedule.epoch_frame != EMPTY).any(axis=2).ravel()
    assert np.flatnonzero(with_ping).max() <= np.flatnonzero(with_frame).min()


def test_a_schedule_of_a_longer_survey_is_refused():
    short, long = survey_of(0.2), survey_of(0.4)
    schedule = sw.plan_schedule(long, frames=8, window=6)
    check_schedule(schedule, long)
    with pytest.raises(ValueError, match="schedule: names frame 40 of a survey of 21, was made for another one"):
        check_schedule(schedule, short)
    with pytest.raises(ValueError, match="schedule: names ping 20 of a survey of 11"):
        check_schedule(schedule, replace(long, pings=short.pings))


def test_memory_bounds_the_frames_of_a_round():
    frame = RIG.fls.beams * RIG.fls.bins * 16
    assert sw.frames_per_round(RIG, 5 * frame + 1) == 5
    with pytest.raises(ValueError, match=rf"memory: {frame - 1} bytes, must be at least {frame} for one frame"):
        sw.frames_per_round(RIG, frame - 1)
    with pytest.raises(ValueError, match="window: 0, must be at least 1"):
        sw.plan_schedule(survey_of(0.2), frames=8, window=0)
