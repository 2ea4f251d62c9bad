"""Pages of logs: a few images each, one page per trajectory, whatever way it runs and whatever it lacks."""

from dataclasses import replace

import matplotlib.image
import numpy as np
import pytest

import sonarwarp as sw
from sonarwarp.app import log_page
from sonarwarp.app.log_page import MOST_PAGES, draw_log_pages
from sonarwarp.app.snapshot import FRAMES, of_trajectory, take_log_snapshot
from sonarwarp.poses import compose
from tests.small_logs import small_log
from tests.small_runs import RIG, SETTINGS, none_of, run, scene


def watch(title, total, unit):
    """A progress display that shows nothing."""
    return lambda done: None


class ReadLog:
    """A log that notes which frames are read."""

    def __init__(self, log):
        self.survey = log.survey
        self._log = log
        self.frames = []

    def images_of(self, frames):
        self.frames += frames.tolist()
        return self._log.images_of(frames)

    def echoes_of(self, pings):
        return self._log.echoes_of(pings)


@pytest.fixture(scope="module", name="batch")
def batch_fixture():
    """A log of two trajectories over the brick and its clouds."""
    log = sw.simulate(RIG, scene(), [run(), run(start_x=-3.0)], noise=sw.NO_NOISE, device="cpu")
    return log, sw.reconstruct(log, settings=SETTINGS, device="cpu")


def draw(log, clouds, out):
    return draw_log_pages(log, clouds, out, name="log", settings=SETTINGS, seed=0, device="cpu", watch=watch)


def sizes(paths):
    """Width and height of pictures [pixel]."""
    return [matplotlib.image.imread(path).shape[1::-1] for path in paths]


def test_every_trajectory_has_a_page_of_a_few_images(batch, tmp_path):
    log, clouds = batch
    read = ReadLog(log)
    paths = draw(read, clouds, tmp_path)
    assert [path.name for path in paths] == ["trajectory_0.png", "trajectory_1.png"]
    assert all(width == 1600 and height > 1200 for width, height in sizes(paths))
    assert len(read.frames) == 2 * FRAMES
    assert {int(log.survey.frames.trajectory[frame]) for frame in read.frames} == {0, 1}


def test_a_snapshot_shows_the_logs_images_and_the_clouds_critical_points(batch):
    log, clouds = batch
    own = of_trajectory(log.survey, 1)
    cloud = clouds.single.select(clouds.single.attributes["trajectory"] == 1)
    contacts = np.bincount(cloud.attributes["frame"], minlength=len(own.frames))
    seen = take_log_snapshot(log, 1, contacts, settings=SETTINGS, device="cpu")
    rows = np.flatnonzero(
        (log.survey.frames.trajectory == 1) & np.isin(log.survey.frames.time, seen.survey.frames.time)
    )
    assert np.array_equal(seen.images, log.images[rows])
    assert contacts[seen.survey.frames.number].min() > 0
    for frame, critical in zip(seen.survey.frames.number, seen.critical_range, strict=True):
        assert np.array_equal(critical[critical >= 0.0], cloud.attributes["range"][cloud.attributes["frame"] == frame])
    # The sweep is the last one before the last frame.
    assert seen.survey.pings.time[-1] <= seen.survey.frames.time[-1]
    assert (seen.footprints[..., 1] > 0.0).any()


def turned(instants, angle):
    """Frames or pings of the same run in a world that is turned to the left [rad]."""
    turn = np.array([0.0, 0.0, 0.0, 0.0, 0.0, np.sin(angle / 2), np.cos(angle / 2)])
    return replace(instants, pose=compose(np.tile(turn, (len(instants), 1)), instants.pose))


@pytest.mark.parametrize("angle", [0.5 * np.pi, -2.0])
def test_a_sweep_looks_the_same_whatever_the_heading(batch, angle):
    log, _ = batch
    survey = log.survey
    other = replace(
        log,
        survey=replace(survey, frames=turned(survey.frames, angle), pings=turned(survey.pings, angle)),
        truth=None,
    )
    contacts = np.ones(np.count_nonzero(survey.frames.trajectory == 0), dtype=int)
    one, turned_one = (
        log_page.sweep_window(take_log_snapshot(each, 0, contacts, settings=SETTINGS, device="cpu"))
        for each in (log, other)
    )
    assert turned_one.plane.heading - one.plane.heading == pytest.approx(angle, abs=1e-6)
    assert turned_one.along == pytest.approx(one.along, abs=1e-6)
    assert turned_one.z == pytest.approx(one.z, abs=1e-6)


def test_a_log_without_pings_has_a_page(batch, tmp_path):
    log, _ = batch
    blind = sw.SonarLog(
        survey=replace(log.survey, pings=none_of(log.survey.pings)), images=log.images, echoes=log.echoes[:0]
    )
    clouds = sw.reconstruct(blind, settings=SETTINGS, device="cpu")
    assert len(clouds.fused) > 0
    assert len(sizes(draw(blind, clouds, tmp_path))) == 2


def test_a_log_that_shows_nothing_has_a_short_page(batch, tmp_path):
    log, _ = batch
    empty = replace(log, images=np.zeros_like(log.images))
    clouds = sw.reconstruct(empty, settings=SETTINGS, device="cpu")
    assert len(clouds.fused) == 0
    assert all(height < 800 for _, height in sizes(draw(empty, clouds, tmp_path)))


def test_a_large_batch_has_pages_of_its_first_trajectories(monkeypatch, tmp_path):
    log = small_log(12, runs=MOST_PAGES + 1)
    drawn = []
    monkeypatch.setattr(log_page, "_draw_page", lambda *arguments: drawn.append(arguments[-1].name))
    draw(log, sw.reconstruct(log, settings=SETTINGS, device="cpu"), tmp_path)
    assert drawn == [f"trajectory_{index}.png" for index in range(MOST_PAGES)]
