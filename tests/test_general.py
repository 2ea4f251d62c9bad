"""The benchmark of other shapes and runs: cases that can be seen, and a table of means."""

import math

import numpy as np
import pytest

from benchmarks.general import CASES, measure, seen_case, table, wedge
from sonarwarp.app.paper_cases import Case
from sonarwarp_scenes import Frustum, LyingCylinder, Sphere, Wedge
from tests.small_runs import RIG
from tests.test_demo import watch
from tests.test_paper import ALONE


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.object)
def test_every_case_is_one_that_the_paper_does_not_have_and_that_can_be_seen(case):
    experiment = case.experiment(0, "none")
    (placed,) = experiment.deployment.objects
    shape, rig = placed.shape, case.rig
    altitude = experiment.deployment.trajectory.poses[0, 2]
    down = math.sin(math.radians(rig.fls_mount.tilt_deg) + rig.fls.half_elevation)
    assert altitude / down <= rig.fls.range_edge[-1] - 0.1
    half_swath = math.sin(rig.fls.azimuth_edge[-1]) * (altitude - shape.height) / down
    assert half_swath >= 0.5 * shape.width + 0.03
    if isinstance(shape, Wedge):
        place = (shape.front_slope_deg, rig.fls_mount.tilt_deg, altitude)
        assert place not in {(90.0, 40.0, 3.5), (90.0, 30.0, 2.5)}


def test_cases_spread_over_shapes_tilts_and_altitudes():
    deployments = [case.deploy(roughness=None) for case in CASES]
    shapes = [deployment.objects[0].shape for deployment in deployments]
    assert {type(shape) for shape in shapes} == {Wedge, Frustum, Sphere, LyingCylinder}
    for kind in (Wedge, Frustum, Sphere, LyingCylinder):
        tilts = {case.rig.fls_mount.tilt_deg for case, shape in zip(CASES, shapes, strict=True) if type(shape) is kind}
        assert len(tilts) >= 2, kind
    altitudes = [deployment.trajectory.poses[0, 2] for deployment in deployments]
    assert (min(altitudes), max(altitudes)) == (1.5, 4.0)
    assert {case.rig.fls_mount.tilt_deg for case in CASES} >= {20.0, 30.0, 45.0}


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"altitude": 4.0}, "altitude: 4 m, the seabed begins 5.47 m away"),
        ({"width": 2.0}, "width: 2 m, must be under"),
    ],
)
def test_what_cannot_be_seen_whole_is_refused(changed, message):
    given = {"width": 0.5, "altitude": 2.5} | changed
    with pytest.raises(ValueError, match=message):
        seen_case("box", wedge(90.0, height=0.5, width=given["width"]), tilt_deg=40.0, altitude=given["altitude"])


def test_a_small_case_gives_rows_and_a_table_of_means(device):
    case = Case(name="general", object="brick", rig=RIG, deploy=ALONE)
    measured = measure([case], seeds=(3, 4), device=device, watch=watch)
    assert [(row["method"], row["seed"]) for row in measured] == [
        (method, seed) for seed in (3, 4) for method in ("single", "fused", "seen")
    ]
    lines = table(measured).splitlines()
    assert len(lines) == 3
    area = np.mean([row["area_error"] for row in measured if row["method"] == "single"])
    assert lines[2].split(" | ")[1].split(" / ")[1] == f"{area:.3f}"
    # A brick hides nothing of its top and front.
    seen = [row for row in measured if row["method"] == "seen"]
    assert max(row["area_error"] for row in seen) < 0.01
    assert max(row["slope_error"] for row in seen) < 0.01


def test_the_table_says_how_many_seeds_lack_what_others_have():
    names = {"experiment": "general", "object": "it", "deployment": None, "which": None, "noise": "field"}
    rows = [
        names | {"method": method, "seed": seed, "slope_deg": None, "slope_error": slope, "area_error": area}
        for method in ("single", "fused", "seen")
        for seed, slope, area in ((0, 0.017, 0.067), (1, None if method == "fused" else 0.019, 0.073))
    ]
    (line,) = table([row | {"volume_error": None} for row in rows]).splitlines()[2:]
    whole = "0.018 / 0.070 / none"
    assert line == f"| it | {whole} | 0.017 (1 of 2 none) / 0.070 / none | {whole} |"
