"""Targets are judged as they are stated: met, missed, missing, not measured, short as known or no longer so."""

import json

import pytest
import typer
from typer.testing import CliRunner

from benchmarks import bounds, general, meshes
from benchmarks.bounds import SHORTFALLS, TARGETS, Shortfall, Subject, shortfall_of
from benchmarks.targets import Verdict, figures_of, judge, main
from sonarwarp.app.experiment import run_batch
from sonarwarp.app.paper_cases import PAIRS, SLOPES
from sonarwarp.app.rows import evaluate_objects, object_rows
from tests.test_demo import watch

BRICK = Subject("field", "brick", noise="field")
GENTLE, LEVEL = (Subject("general", case.object, noise="field") for case in general.CASES[:2])
PAIR = Subject("deployments", "90", "aligned", "first", "field")
VASE = Subject("mesh", "vase, 0.7 m high")


KNOWN = (
    Shortfall(subject=GENTLE, figures=(bounds.SLOPE,), reason="a slope's"),
    Shortfall(subject=VASE, figures=(bounds.MISSED,), reason="a mesh's"),
)
"""Shortfalls of these tests: those of the library come and go."""


@pytest.fixture(autouse=True, name="own_shortfalls")
def own_shortfalls_fixture(monkeypatch):
    monkeypatch.setattr(bounds, "SHORTFALLS", KNOWN)


def section_row(subject, seed=0, *, method="fused", slope=0.01, area=0.01, volume=0.01):
    return {
        **subject._asdict(),
        "method": method,
        "seed": seed,
        "slope_deg": None if slope is None else 90.0,
        "slope_error": slope,
        "area_error": area,
        "volume_error": volume,
    }


def mesh_rows(*, steep=True, rms=(0.05, 0.02), p95=(0.1, 0.05), completeness=(0.6, 0.73)):
    figures = zip(("single", "fused"), rms, p95, completeness, strict=True)
    return [
        {
            "title": VASE.object,
            "method": method,
            "seed": 0,
            "steeper_than_deg": 49.6 if steep else None,
            "accuracy_rms": own_rms,
            "accuracy_p95": own_p95,
            "completeness": own_completeness,
        }
        for method, own_rms, own_p95, own_completeness in figures
    ]


def calibration_row(kind, coverage, *, experiment="all", sharpness=0.5):
    names = {"experiment": experiment, "object": None, "deployment": None, "noise": "field", "kind": kind}
    return names | {"coverage": coverage, "sharpness_deg": sharpness}


def verdicts(rows):
    """Of all targets that something was measured of, by subject, figure and whether it is an aim."""
    return {
        (judgement.target.subject, judgement.target.figure, judgement.target.aim): judgement.verdict
        for judgement in judge(figures_of(rows))
        if judgement.verdict is not Verdict.NOT_MEASURED
    }


def test_a_mean_over_the_seeds_is_held_against_target_and_aim():
    rows = [section_row(BRICK, seed, area=area) for seed, area in enumerate((0.06, 0.10))]
    assert verdicts(rows) == {
        (BRICK, figure, aim): Verdict.SHORT if aim and figure == bounds.AREA else Verdict.MET
        for figure in (bounds.SLOPE, bounds.AREA, bounds.VOLUME)
        for aim in (False, True)
    }


def test_bounds_belong_to_what_they_allow():
    assert verdicts([section_row(BRICK, slope=0.03)])[BRICK, bounds.SLOPE, True] is Verdict.MET
    assert verdicts([section_row(BRICK, slope=0.0301)])[BRICK, bounds.SLOPE, True] is Verdict.SHORT


@pytest.mark.parametrize("slopes", [(None,), (0.001, None), (None, 0.001, 0.001)])
def test_a_run_without_a_slope_misses_the_target_whatever_the_others_have(slopes):
    rows = [section_row(PAIR, seed, slope=slope) for seed, slope in enumerate(slopes)]
    found = verdicts(rows)
    assert found[PAIR, bounds.SLOPE, False] is found[PAIR, bounds.WORST_SLOPE, False] is Verdict.SHORT
    assert found[PAIR, bounds.AREA, False] is Verdict.MET


def test_one_bad_slope_of_many_is_seen():
    rows = [section_row(PAIR, seed, slope=0.001) for seed in range(9)]
    found = verdicts([*rows, section_row(PAIR, 9, slope=0.09)])
    assert found[PAIR, bounds.SLOPE, False] is Verdict.MET
    assert found[PAIR, bounds.WORST_SLOPE, False] is Verdict.SHORT


@pytest.mark.parametrize(
    ("slope", "known", "unknown"),
    [(0.043, Verdict.KNOWN, Verdict.SHORT), (0.01, Verdict.STALE, Verdict.MET), (None, Verdict.KNOWN, Verdict.SHORT)],
)
def test_a_known_shortfall_is_one_as_long_as_it_lasts(slope, known, unknown):
    found = verdicts([section_row(subject, slope=slope) for subject in (GENTLE, LEVEL)])
    assert (found[GENTLE, bounds.SLOPE, False], found[LEVEL, bounds.SLOPE, False]) == (known, unknown)
    assert found[GENTLE, bounds.AREA, False] is Verdict.MET


def test_rows_that_no_target_is_about_are_left_out():
    rows = [
        section_row(BRICK, method="single", slope=None),
        section_row(BRICK, method="seen", slope=None),
        {**section_row(BRICK, slope=None), "variant": "paper, as printed"},
        section_row(Subject("slope-limit", "30", noise="field"), slope=None),
        calibration_row("top", 0.1, experiment="field"),
        *mesh_rows(steep=False, rms=(0.01, 0.02)),
        {"case": "field brick", "seed": 0},
    ]
    assert verdicts(rows) == {}


@pytest.mark.parametrize(
    ("changed", "figure", "verdict"),
    [
        ({}, bounds.RMS, Verdict.MET),
        ({"rms": (0.05, 0.026)}, bounds.RMS, Verdict.SHORT),
        ({"p95": (0.1, 0.051)}, bounds.P95, Verdict.SHORT),
        ({"p95": (0.1, None)}, bounds.P95, Verdict.SHORT),
        ({}, bounds.MISSED, Verdict.KNOWN),
        ({"completeness": (0.6, 0.81)}, bounds.MISSED, Verdict.STALE),
        ({"completeness": (None, 0.9)}, bounds.MISSED, Verdict.KNOWN),
        ({"completeness": (1.0, 0.9)}, bounds.MISSED, Verdict.KNOWN),
    ],
)
def test_a_mesh_is_held_against_the_single_sonar_method(changed, figure, verdict):
    assert verdicts(mesh_rows(**changed))[VASE, figure, False] is verdict


@pytest.mark.parametrize(
    ("coverage", "verdict"), [(0.89, Verdict.SHORT), (0.90, Verdict.MET), (0.98, Verdict.MET), (0.99, Verdict.SHORT)]
)
def test_intervals_may_hold_neither_too_little_nor_too_much(coverage, verdict):
    fallback = Subject("calibration", "fallback")
    rows = [calibration_row("fallback", coverage, sharpness=2.0), calibration_row("top", 0.95, sharpness=1.1)]
    found = verdicts(rows)
    assert found[fallback, bounds.COVERAGE, False] is verdict
    # What has nothing to be sharp by need not be.
    assert (fallback, bounds.DEVIATION, False) not in found
    assert found[Subject("calibration", "top"), bounds.DEVIATION, False] is Verdict.SHORT


def test_every_shortfall_is_of_targets_that_there_are_and_no_other_covers_them(monkeypatch):
    monkeypatch.setattr(bounds, "SHORTFALLS", SHORTFALLS)
    for shortfall in SHORTFALLS:
        covered = [target for target in TARGETS if shortfall.covers(target)]
        assert sorted(target.figure for target in covered) == sorted(shortfall.figures), shortfall.subject
        assert all(shortfall_of(target) is shortfall for target in covered)


def test_falling_short_of_an_aim_is_not_falling_short_of_the_target():
    shortfall = Shortfall(subject=BRICK, figures=(bounds.AREA,), aim=True, reason="")
    assert [(target.at_most, target.aim) for target in TARGETS if shortfall.covers(target)] == [(0.07, True)]


def test_every_object_has_its_targets_and_what_has_no_slope_none_of_it():
    names = [str(target) for target in TARGETS]
    assert len(set(names)) == len(names)
    assert bounds.SLOPE in {target.figure for target in TARGETS if target.subject == GENTLE}
    pairs = {target.subject for target in TARGETS if target.figure == bounds.WORST_SLOPE}
    assert len(pairs) == 2 * len(PAIRS)
    sloping = {target.subject.object for target in TARGETS if target.figure == bounds.SLOPE}
    for case in general.CASES:
        assert (case.object in sloping) == (not case.object.startswith(("dome", "sphere", "half", "lying")))


def command(*files):
    app = typer.Typer()
    app.command()(main)
    return CliRunner().invoke(app, [str(file) for file in files])


def written(tmp_path, rows, name="rows.json"):
    path = tmp_path / name
    path.write_text(json.dumps(rows))
    return path


def test_the_command_fails_on_what_nobody_knows_of_and_on_what_is_known_wrongly(tmp_path):
    good = [section_row(BRICK), section_row(GENTLE, slope=0.043)]
    assert command(written(tmp_path, good)).exit_code == 0
    for bad in ([section_row(PAIR, slope=None)], [section_row(PAIR, area=0.2)], mesh_rows(completeness=(0.6, 0.9))):
        assert command(written(tmp_path, good), written(tmp_path, bad, "bad.json")).exit_code == 1


def test_the_table_has_a_line_for_every_target_and_one_for_what_was_not_measured(tmp_path):
    rows = [section_row(PAIR, slope=None), section_row(GENTLE, slope=0.0432), calibration_row("front", 0.9525)]
    heading, rule, *lines, blank, count = command(written(tmp_path, rows)).output.splitlines()
    assert {line.count("|") for line in (heading, rule, *lines)} == {6}
    assert blank == ""
    assert f"| {PAIR} | slope error | at most 0.03 | none | short |" in lines
    assert f"| {GENTLE} | slope error | at most 0.03 | 0.043 | known shortfall: a slope's |" in lines
    assert "| calibration: front | in the 95 % interval | 0.9 to 0.98 | 0.953 | met |" in lines
    assert lines.count(f"| {BRICK} |  |  |  | not measured |") == 1
    subjects = [line.split(" | ")[0] for line in lines if line.endswith("not measured |")]
    assert len(set(subjects)) == len(subjects)
    assert count.startswith("6 met, 2 short, 1 known shortfall, ")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "No such file"),
        ("nothing", "must be JSON"),
        ('{"rows": []}', "must be a list of rows"),
        ("[1]", "must be a list of rows"),
        ("[]", "must have rows"),
        ('[{"case": "field brick"}]', "must have rows"),
        (json.dumps([{"method": "fused", "slope_error": 0.1}]), "a row lacks 'experiment'"),
        (json.dumps([section_row(BRICK)] * 2), "2 times"),
    ],
)
def test_what_cannot_be_judged_is_refused(tmp_path, text, message):
    path = tmp_path / "rows.json"
    if text is not None:
        path.write_text(text)
    refusal = command(path)
    assert refusal.exit_code == 2
    assert message in " ".join(refusal.output.replace("│", " ").split())


def test_what_the_benchmark_of_meshes_writes_is_judged(tmp_path, monkeypatch):
    others = dict.fromkeys(("counted", "accuracy_mean", "precision", "f_score"))

    def judge_vase(mesh, clouds, *options):
        return [others | row for row in mesh_rows(steep=bool(options))] if mesh.title == VASE.object else []

    monkeypatch.setattr(meshes, "run_mesh", lambda *_: None)
    monkeypatch.setattr(meshes, "judge", judge_vase)
    path = tmp_path / "rows.json"
    meshes.main(tmp_path, seed=3, json_file=path)
    rows = json.loads(path.read_text())
    assert [row["seed"] for row in rows] == [3] * 4
    assert all({"device", "versions", "commit"} <= set(row) for row in rows)
    found = command(path)
    assert found.exit_code == 0
    assert found.output.splitlines()[-1].startswith("2 met, 1 known shortfall, ")


def test_a_real_run_meets_the_targets_and_the_single_sonar_method_would_not(device, tmp_path):
    steep = SLOPES[0]
    (run,) = run_batch([steep.experiment(0, "field")], device=device, watch=watch)
    rows = object_rows(run, evaluate_objects(run))
    met = command(written(tmp_path, rows))
    assert met.exit_code == 0, met.output
    assert "3 met, " in met.output
    single = [{**row, "method": "fused"} for row in rows if row["method"] == "single"]
    assert set(verdicts(single).values()) == {Verdict.SHORT}
    assert len(verdicts(single)) == 3
