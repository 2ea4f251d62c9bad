"""The benchmark of reads on the way: what is published when, and that the last read is the whole log's."""

import math

import numpy as np
import pytest

import sonarwarp as sw
from benchmarks.online import EVERY, Publisher, identities, measure, table
from benchmarks.targets import figures_of
from sonarwarp.app.experiment import run_batch
from sonarwarp.app.rows import evaluate_objects, object_rows
from tests.test_ablation import BRICK
from tests.test_demo import watch

LONG = 1e6
"""Over the end of any run [s]."""


def cloud(*rows):
    """Points of (source, frame, beam, time, x)."""
    source, frame, beam, time, x = np.array(rows, dtype=float).reshape(-1, 5).T
    points = np.stack([x, 0.0 * x, 0.0 * x], axis=1).astype(np.float32)
    whole = {"source": source, "frame": frame, "beam": beam}
    whole = {name: values.astype(np.int32) for name, values in whole.items()}
    return sw.PointCloud(points=points, attributes={**whole, "time": time})


def test_a_point_is_published_when_it_is_due_and_never_again():
    publisher = Publisher(delay=1.0)
    early, late = (0, 3, 7, 0.3, 1.0), (0, 20, 7, 2.0, 2.0)
    publisher.take(cloud(early), now=1.2)
    assert len(publisher.published) == 0
    publisher.take(cloud(early, late), now=1.3)
    assert publisher.published.points[:, 0].tolist() == [1.0]
    # Moved: it stays where it was published.
    publisher.take(cloud((0, 3, 7, 0.3, 9.0), late), now=3.0)
    assert publisher.published.points[:, 0].tolist() == [1.0, 2.0]
    # Taken back by the reconstruction: it stays too.
    publisher.take(cloud(), now=4.0)
    publisher.take(cloud(early, late), now=math.inf)
    assert publisher.published.points[:, 0].tolist() == [1.0, 2.0]


def test_the_points_of_a_strip_are_published_together():
    publisher = Publisher(delay=0.0)
    strip = [(1, 4, 2, 0.5, height) for height in (0.0, 0.1, 0.2)]
    publisher.take(cloud(*strip), now=0.5)
    publisher.take(cloud(*strip, (1, 4, 2, 0.5, 0.3)), now=1.0)
    assert len(publisher.published) == 3


def test_sonars_frames_and_beams_tell_points_apart():
    largest = (1 << 24) - 1
    rows = [(s, f, b, 0.0, 0.0) for s in (0, 1) for f in (0, 1, largest) for b in (0, 1, 511, largest)]
    assert len(set(identities(cloud(*rows)).tolist())) == len(rows)


@pytest.fixture(scope="module", name="measured")
def measured_fixture(device):
    return measure([BRICK], (0.0, LONG), seeds=(3,), device=device, watch=watch)


def test_the_last_read_and_what_waits_for_it_are_the_offline_run(measured, device):
    (run,) = run_batch([BRICK.experiment(3, "field")], device=device, watch=watch)
    (want,) = (row for row in object_rows(run, evaluate_objects(run)) if row["method"] == "fused")
    assert want["slope_error"] is not None
    for variant in ("last read", f"after {LONG:g} s"):
        (found,) = (row for row in measured if row["variant"] == variant)
        assert {key: found[key] for key in want} == want
    (hasty,) = (row for row in measured if row["variant"] == "after 0 s")
    assert any(hasty[key] != want[key] for key in ("area_error", "volume_error"))


def test_a_run_is_read_on_the_way_and_nothing_later_is_known(device, monkeypatch):
    reads, publish = [], Publisher.take

    def take(publisher, cloud, now):
        reads.append((now, cloud.attributes["time"].max(initial=-math.inf)))
        publish(publisher, cloud, now)

    monkeypatch.setattr(Publisher, "take", take)
    measure([BRICK], (0.0,), seeds=(3,), device=device, watch=watch)
    now, latest = np.array(reads).T
    between = np.diff(now[:-1])
    assert between.min() > 0.0
    assert between.max() == pytest.approx(EVERY)
    assert now[-1] == math.inf
    assert (latest <= now).all()
    # What the last frame met is there at once.
    assert latest[-2] == now[-2]


def test_targets_are_not_about_what_is_published_early(measured):
    assert figures_of(measured) == {}


def test_the_table_has_a_line_for_each_delay_and_says_how_long_reads_took():
    names = {"experiment": "deployments", "object": "60", "deployment": "misaligned", "noise": "field"}
    rows = [
        {**names, "which": which, "method": "fused", "seed": 0, "slope_deg": None, "slope_error": slope}
        | {"area_error": area, "volume_error": None, "variant": variant, "longest_read": 10.0 * slope}
        for variant, area in (("after 2 s", 0.3), ("last read", 0.1))
        for which, slope in (("first", 0.01), ("second", 0.03))
    ]
    heading, _, *lines = table(rows).splitlines()
    assert heading == "| Slope / area / volume error | pair, 60 deg |"
    assert lines == [
        "| after 2 s | 0.020 / 0.300 / none |",
        "| last read | 0.020 / 0.100 / none |",
        "| longest read | 0.3 s |",
    ]
