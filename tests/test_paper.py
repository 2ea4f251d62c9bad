"""The paper's experiments over seeds: batches that change nothing, rows, summaries and pages."""

import dataclasses
import json
import math

import numpy as np
import pytest

import sonarwarp as sw
from sonarwarp.app.experiment import plan_surveys, run_batch, runs_per_batch
from sonarwarp.app.paper import run_paper
from sonarwarp.app.paper_cases import BRICK as BRICK_CASE
from sonarwarp.app.paper_cases import CASES, PAIRS, SLOPES, Case
from sonarwarp.app.paper_printed import slope_limit_deg
from sonarwarp.app.paper_summary import summarise
from sonarwarp.app.paper_table import paper_table
from sonarwarp.app.rows import evaluate_objects, object_rows
from sonarwarp_scenes import BRICK, CONCRETE, Deployment, Extent, PlacedObject, Scene, flat_seabed, rough_seabed
from tests.small_runs import RIG, run, same_points
from tests.test_demo import KEYS, watch

EXTENT = Extent(x_min=-12.0, x_max=12.0, y_min=-4.0, y_max=4.0)


def deploy(*objects):
    """A short run towards some bricks, as the paper's deployments are made."""

    def over(roughness=None):
        ground = flat_seabed(EXTENT) if roughness is None else rough_seabed(EXTENT, roughness)
        scenes = [placed.scene(CONCRETE) for placed in objects]
        return Deployment(
            name="small",
            scene=Scene.join(ground, *scenes),
            objects=objects,
            bodies=tuple((placed.name, len(body.faces)) for placed, body in zip(objects, scenes, strict=True)),
            trajectory=run(length=0.5),
            frames_from=0.0,
        )

    return over


def brick(name, front_x, centre_y):
    return PlacedObject(name=name, shape=BRICK, front_x=front_x, centre_y=centre_y)


ALONE = deploy(brick("brick", 0.0, 0.0))
ALIGNED = deploy(brick("first", 0.0, -0.1), brick("second", 0.0, 0.1))
MISALIGNED = deploy(brick("first", 0.0, -0.1), brick("second", 0.1, 0.1))

SMALL = (
    Case(name="slope-limit", object="90", rig=RIG, deploy=ALONE),
    Case(name="slope-limit", object="45", rig=RIG, deploy=ALONE),
    Case(name="deployments", object="90", arrangement="aligned", rig=RIG, deploy=ALIGNED),
    Case(name="deployments", object="90", arrangement="misaligned", rig=RIG, deploy=MISALIGNED),
    Case(name="field", object="brick", rig=RIG, deploy=ALONE),
)


@pytest.mark.parametrize("noise", ["none", "field"])
def test_a_seed_is_the_same_alone_and_in_a_batch(device, noise):
    case = SMALL[3]
    alone = run_batch([case.experiment(3, noise)], device=device, watch=watch)[0]
    together = run_batch([case.experiment(seed, noise) for seed in range(4)], device=device, watch=watch)
    assert object_rows(alone, evaluate_objects(alone)) == object_rows(together[3], evaluate_objects(together[3]))
    for method in ("single", "fused"):
        one, other = getattr(alone.clouds, method), getattr(together[3].clouds, method)
        assert len(one) > 50
        assert same_points(one, other)
        assert not other.attributes["trajectory"].any()
    assert np.array_equal(alone.critical_range, together[3].critical_range)
    assert np.array_equal(alone.survey.frames.pose, together[3].survey.frames.pose)
    assert not same_points(together[2].clouds.fused, together[3].clouds.fused)


def test_a_batch_has_one_rig_and_one_noise(device):
    case = SMALL[0]
    others = (
        case.experiment(1, "field"),
        dataclasses.replace(case, rig=RIG.tilted(30.0)).experiment(1, "none"),
    )
    for other in others:
        with pytest.raises(ValueError, match="another rig or noise"):
            run_batch([case.experiment(0, "none"), other], device=device, watch=watch)


def test_a_batch_is_as_large_as_the_memory_for_fields():
    experiment = BRICK_CASE.experiment(0, "none")
    one = runs_per_batch(experiment)
    assert runs_per_batch(experiment, memory=4 << 30) == pytest.approx(4 * one, abs=4)
    assert runs_per_batch(experiment, memory=1) == 1


def test_small_experiments_leave_rows_clouds_and_pages(device, tmp_path):
    rows_file = tmp_path / "rows.json"
    steps = []

    def counted(title, total, unit):
        return lambda done: steps.append(done) if unit == "frames" else None

    report = run_paper(
        SMALL, seeds=[5, 6], noise="field", device=device, out=tmp_path / "out", rows_file=rows_file, watch=counted
    )
    assert sum(steps) == report.frames
    assert all(list(row) == list(report.rows[0]) and set(row) == KEYS for row in report.rows)
    names = ("experiment", "object", "deployment", "seed", "which", "method")
    assert [tuple(row[name] for name in names) for row in report.rows] == [
        (case.name, case.object, case.arrangement, seed, which, method)
        for case in SMALL
        for seed in (5, 6)
        for which in (("first", "second") if case.arrangement else (None,))
        for method in ("single", "fused")
    ]
    assert json.loads(rows_file.read_text()) == report.rows
    assert json.loads((tmp_path / "out" / "metrics.json").read_text())["rows"] == report.rows
    for name in CASES:
        assert (tmp_path / "out" / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "out" / "deployments_90_misaligned_field_fused.ply").exists()
    assert all(path.exists() for path in report.files)
    assert paper_table(report.rows).row_count == 2 * 2 + 2 * 2 * 2 + 2 + 2


def test_rows_that_cannot_be_written_are_refused_before_any_work(tmp_path):
    with pytest.raises(ValueError, match="json: cannot write to"):
        run_paper(
            SMALL, seeds=[0], noise="none", device="cpu", out=tmp_path, rows_file=tmp_path / "no" / "rows", watch=watch
        )


def test_the_cases_are_the_papers():
    assert [case.object for case in SLOPES] == ["90", "80", "60", "45", "30", "20"]
    assert [(case.arrangement, case.object) for case in PAIRS] == [
        (arrangement, slope) for arrangement in ("aligned", "misaligned") for slope in ("30", "45", "60", "90")
    ]
    for case in (*SLOPES, *PAIRS, BRICK_CASE):
        assert len(case.experiment(0, "none").deployment.objects) == (2 if case.arrangement else 1)


def test_only_noise_brings_a_rough_seabed_and_every_seed_its_own():
    quiet, other_quiet = (BRICK_CASE.experiment(seed, "none").deployment.scene for seed in (1, 2))
    assert np.array_equal(quiet.vertices, other_quiet.vertices)
    rough, other_rough = (BRICK_CASE.experiment(seed, "field").deployment.scene for seed in (1, 2))
    assert len(rough.vertices) > 1000 > len(quiet.vertices)
    assert rough.vertices.shape == other_rough.vertices.shape
    assert not np.array_equal(rough.vertices, other_rough.vertices)


def test_motion_takes_no_frame_from_a_run():
    planned, moved = (plan_surveys(BRICK_CASE.experiment(7, noise))[0] for noise in ("none", "field"))
    assert len(planned.frames) == len(moved.frames)
    assert len(planned.pings) == len(moved.pings)


# Eq. 4 by hand: at t = 30 and s = 14 degrees, cos 30 = 0.8660, sin 37 = 0.6018, cos 37 = 0.7986.
@pytest.mark.parametrize(
    ("preset", "limit"), [("paper slope series", 59.4), ("paper field", 64.3), ("paper simulation", 49.6)]
)
def test_the_slope_limit_is_eq_4s(preset, limit):
    assert slope_limit_deg(sw.PRESETS[preset]) == pytest.approx(limit, abs=0.05)


def row(seed, **figures):
    names = {"experiment": "field", "object": "brick", "deployment": None, "which": None}
    return names | {"method": "fused", "noise": "field", "seed": seed} | figures


def test_a_seed_without_a_figure_is_the_worst():
    rows = [
        row(0, slope_deg=80.0, slope_error=0.11, area_error=0.1, volume_error=None),
        row(1, slope_deg=None, slope_error=None, area_error=0.3, volume_error=None),
    ]
    (summary,) = summarise(rows)
    assert summary.mean("slope_error") == 0.11
    assert summary.worst("slope_error") is None
    assert summary.missing("slope_error") == 1
    assert summary.mean("area_error") == pytest.approx(0.2)
    assert summary.worst("area_error") == 0.3
    assert summary.mean("volume_error") is None
    assert math.isnan(summary.figures["slope_deg"][1])
