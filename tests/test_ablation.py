"""The ablation: each variant leaves out what it says, and all of them reconstruct the same images."""

from dataclasses import fields, replace

import numpy as np
import pytest

import sonarwarp as sw
from benchmarks.ablation import CASES, STEPS, VARIANTS, Variant, measure, without
from benchmarks.variants import variant_table
from sonarwarp.app.experiment import record, run_batch, run_recorded
from sonarwarp.app.paper_cases import Case
from tests.small_runs import CARVED
from tests.test_carving import SWIFT
from tests.test_demo import watch
from tests.test_paper import ALONE, MISALIGNED

DEFAULT = sw.ReconstructionSettings()
BRICK = Case(name="field", object="brick", rig=SWIFT, deploy=ALONE)
PAIR = Case(name="deployments", object="90", arrangement="misaligned", rig=SWIFT, deploy=MISALIGNED)


def changed(settings, default):
    """Names of fields that differ."""
    return {item.name for item in fields(settings) if getattr(settings, item.name) != getattr(default, item.name)}


@pytest.mark.parametrize("step", STEPS, ids=lambda step: step.title)
def test_a_step_is_left_out_by_its_own_fields_and_no_other(step):
    settings = without([step])
    assert changed(settings, DEFAULT) == ({"free_space"} if step.free_space else {"faces"})
    assert changed(settings.free_space, DEFAULT.free_space) == set(step.free_space)
    assert changed(settings.faces, DEFAULT.faces) == set(step.faces)


def test_no_two_steps_share_a_field():
    names = [(part, name) for step in STEPS for part in ("free_space", "faces") for name in getattr(step, part)]
    assert len(set(names)) == len(names)
    assert without(()) == DEFAULT


def test_variants_are_the_paper_steps_put_together_and_single_steps_left_out():
    settings = {variant.title: variant.settings for variant in VARIANTS}
    assert len(settings) == len(VARIANTS)
    assert changed(settings["paper, as printed"], DEFAULT) == {"method", "causal"}
    assert changed(settings["paper, offline"], DEFAULT) == {"method"}
    assert settings["+ faces: the whole method"] == DEFAULT
    assert settings["+ repeats"] == without([STEPS[-1]])
    for step in STEPS[:-1]:
        assert settings[f"whole method - {step.title}"] == without([step])
    # A variant that stands twice is measured twice for nothing.
    assert all(one != other for at, one in enumerate(settings.values()) for other in list(settings.values())[:at])


def test_the_cases_are_the_brick_and_two_pairs():
    assert [(case.object, case.arrangement) for case in CASES] == [
        ("brick", None),
        ("60", "misaligned"),
        ("90", "misaligned"),
    ]


@pytest.fixture(scope="module")
def recorded(device):
    experiment = BRICK.experiment(3, "field")
    return experiment, record(experiment, device=device)


def fused(recorded, device, settings):
    experiment, log = recorded
    small = replace(CARVED, free_space=settings.free_space, faces=settings.faces)
    return run_recorded(replace(experiment, settings=small), log, device=device).clouds.fused


def imaged(cloud):
    """Frame and beam of the imaging sonar's points."""
    mine = cloud.select(cloud.attributes["source"] == 0).attributes
    return set(zip(mine["frame"].tolist(), mine["beam"].tolist(), strict=True))


# On a run of half a metre the defaults have little to drop.
STRICT = {"least_height": 0.2, "side_share": 0.9, "stray_points": 60, "hit_spacing": 0.05}


@pytest.mark.parametrize("step", STEPS[1:5], ids=lambda step: step.title)
def test_without_a_step_that_drops_points_they_stay(recorded, device, step):
    none = without(STEPS)
    strict = {name: STRICT[name] for name in step.free_space}
    alone = replace(none, free_space=replace(none.free_space, **strict))
    assert imaged(fused(recorded, device, alone)) < imaged(fused(recorded, device, none))


def test_with_no_step_every_contact_stays(recorded, device):
    experiment, log = recorded
    run = run_recorded(replace(experiment, settings=CARVED), log, device=device)
    assert imaged(fused(recorded, device, without(STEPS))) == imaged(run.clouds.single)


def test_without_faces_the_profiling_sonar_gives_no_point(recorded, device):
    whole, less = (fused(recorded, device, without(steps)) for steps in ([], [STEPS[-1]]))
    assert (whole.attributes["source"] == 1).any()
    assert not (less.attributes["source"] == 1).any()
    assert imaged(less) == imaged(whole)


def test_without_free_depth_a_silent_profiling_sonar_leaves_the_whole_arc_in_doubt(recorded, device):
    experiment, log = recorded
    silent = experiment, replace(log, echoes=np.zeros_like(log.echoes))
    clouds = (fused(silent, device, without(steps)).attributes for steps in ([], [STEPS[0]]))
    known, unknown = (cloud["elevation_deviation"] for cloud in clouds)
    # A uniform distribution over the beam.
    whole_arc = 2.0 * experiment.rig.fls.half_elevation / np.sqrt(12.0)
    assert np.allclose(unknown, whole_arc, rtol=1e-3)
    assert np.median(known) < 0.9 * whole_arc


def test_a_recorded_run_is_that_of_its_seed(recorded, device):
    experiment, log = recorded
    run = run_recorded(replace(experiment, settings=CARVED), log, device=device)
    batch = run_batch([experiment], device=device, watch=watch)[0]
    assert np.array_equal(run.survey.frames.pose, batch.survey.frames.pose)
    assert np.array_equal(run.truth.frames.pose, batch.truth.frames.pose)
    single = run.clouds.single.attributes
    assert (run.critical_range >= 0.0).sum() == len(run.clouds.single) > 50
    row = single["frame"] - log.survey.frames.number[0]
    assert np.array_equal(run.critical_range[row, single["beam"]], single["range"])


def test_settings_reach_the_engines_and_a_batch_has_them_in_common(device):
    experiment = BRICK.experiment(0, "none")
    paper = replace(experiment, settings=replace(CARVED, method="paper"))
    cloud = run_batch([paper], device=device, watch=watch)[0].clouds.fused
    assert len(cloud) > 50
    assert not (cloud.attributes["source"] == 1).any()
    with pytest.raises(ValueError, match="settings"):
        run_batch([experiment, paper], device=device, watch=watch)


def test_small_cases_give_the_documented_columns(device):
    variants = (
        Variant(title="whole", settings=CARVED),
        Variant(title="paper", settings=replace(CARVED, method="paper")),
    )
    steps = []
    measured = measure((BRICK, PAIR), variants, seeds=(3,), device=device, watch=lambda *_: steps.append)
    assert sum(steps) == 2 * (1 + len(variants))
    assert [(row["variant"], row["object"], row["which"]) for row in measured] == [
        *(("whole", "brick", None), ("paper", "brick", None)),
        *((title, "90", which) for title in ("whole", "paper") for which in ("first", "second")),
    ]
    heading, rule, *lines = variant_table(measured).splitlines()
    assert heading == "| Slope / area / volume error | brick | pair, 90 deg |"
    assert [line.split(" | ")[0] for line in lines] == ["| whole", "| paper"]
    assert {line.count("|") for line in (heading, rule, *lines)} == {4}


def test_the_table_has_means_over_seeds_and_objects_and_counts_what_is_missing():
    names = {"variant": "whole", "experiment": "deployments", "object": "60", "deployment": "misaligned"}
    names |= {"noise": "field", "method": "fused", "slope_deg": None}
    rows = [
        names | {"which": which, "seed": 0, "slope_error": slope, "area_error": area, "volume_error": None}
        for which, slope, area in (("first", 0.02, 0.1), ("second", None, 0.3))
    ]
    assert variant_table(rows).splitlines()[2] == "| whole | 0.020 (1 of 2 none) / 0.200 / none |"
