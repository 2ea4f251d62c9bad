"""The benchmark of other shapes and runs: cases that can be seen, and a table of means."""

import math

import numpy as np
import pytest

from benchmarks.general import CASES, measure, table, wedge_case
from sonarwarp.app.paper_cases import Case
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
    assert (shape.front_slope_deg, rig.fls_mount.tilt_deg, altitude) not in {(90.0, 40.0, 3.5), (90.0, 30.0, 2.5)}


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"altitude": 4.0}, "altitude: 4 m, the seabed begins 5.47 m away"),
        ({"width": 2.0}, "width: 2 m, must be under"),
    ],
)
def test_what_cannot_be_seen_whole_is_refused(changed, message):
    with pytest.raises(ValueError, match=message):
        wedge_case(90.0, **({"height": 0.5, "width": 0.5, "tilt_deg": 40.0, "altitude": 2.5} | changed))


def test_a_small_case_gives_rows_and_a_table_of_means(device):
    case = Case(name="general", object="brick", rig=RIG, deploy=ALONE)
    measured = measure([case], seeds=(3, 4), device=device, watch=watch)
    assert [(row["method"], row["seed"]) for row in measured] == [
        ("single", 3),
        ("fused", 3),
        ("single", 4),
        ("fused", 4),
    ]
    lines = table(measured).splitlines()
    assert len(lines) == 4
    area = np.mean([row["area_error"] for row in measured if row["method"] == "single"])
    assert lines[2].split(" | ")[3] == f"{area:.3f}"
