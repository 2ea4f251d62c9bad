"""Calibration: a true posterior covers at its level, a prior covers but is not sharp."""

import numpy as np
import pytest

from sonarwarp.metrics.calibration import Claims, evaluate_calibration


def claims_of(low, high, deviation, truth, kind="front"):
    low, high, deviation, truth = (np.array(values, dtype=float) for values in (low, high, deviation, truth))
    return Claims(low=low, high=high, deviation=deviation, truth=truth, kind=np.full(len(low), kind))


def test_intervals_of_a_normal_posterior_cover_95_per_cent_and_narrow_ones_less():
    rng = np.random.default_rng(1)
    truth = rng.normal(0.0, 0.02, 40000)
    kind = np.where(np.arange(40000) % 2 == 0, "front", "top")
    deviation = np.where(kind == "front", 0.02, 0.005)
    claims = Claims(low=-1.96 * deviation, high=1.96 * deviation, deviation=deviation, truth=truth, kind=kind)
    front, top = evaluate_calibration(claims)
    assert (front.kind, top.kind) == ("front", "top")
    # Four standard errors of a share of 0.95 over 20,000 points.
    assert front.coverage == pytest.approx(0.95, abs=4 * np.sqrt(0.95 * 0.05 / 20000))
    assert top.coverage == pytest.approx(0.376, abs=0.02)
    assert (front.sharpness, top.sharpness) == (0.02, 0.005)


@pytest.mark.parametrize(
    ("low", "high", "covered"),
    [
        (-1.0, 2.0, True),
        (0.5, 2.0, True),
        (-1.0, 0.5, True),
        (0.5, 0.5, True),
        (0.6, 2.0, False),
        (-1.0, 0.4, False),
        (2.0, -1.0, False),
    ],
    ids=["inside", "lower end", "upper end", "no width", "below", "above", "ends swapped"],
)
def test_a_truth_is_covered_from_one_end_of_its_own_interval_to_the_other(low, high, covered):
    """Whatever the deviation: intervals need not be symmetric."""
    for deviation in (1e-6, 10.0):
        (row,) = evaluate_calibration(claims_of([low], [high], [deviation], [0.5]))
        assert row.coverage == float(covered)
        assert row.sharpness == deviation


def test_points_without_a_truth_do_not_count():
    (row,) = evaluate_calibration(claims_of([-1.0] * 3, [1.0] * 3, [1.0, 100.0, 3.0], [0.0, np.nan, 5.0]))
    assert (row.points, row.coverage, row.sharpness) == (2, 0.5, 2.0)
    assert evaluate_calibration(claims_of([], [], [], [])) == []


def test_joined_claims_are_those_of_one_cloud():
    parts = [claims_of([0.0], [1.0], [0.1], [0.5], "top"), claims_of([0.0, 0.2], [1.0, 1.0], [0.3, 0.5], [2.0, 0.3])]
    front, top = evaluate_calibration(Claims.join(*parts))
    assert (front.kind, front.points, front.coverage, front.sharpness) == ("front", 2, 0.5, 0.4)
    assert (top.kind, top.points, top.coverage, top.sharpness) == ("top", 1, 1.0, 0.1)


@pytest.mark.parametrize("name", ["high", "deviation", "truth", "kind"])
def test_shapes_must_agree(name):
    given = {each: np.zeros(3) for each in ("low", "high", "deviation", "truth")} | {"kind": np.zeros(3, dtype=str)}
    given[name] = given[name][:2]
    with pytest.raises(ValueError, match=rf"Claims\.{name}: expected shape \(3,\), got \(2,\)"):
        Claims(**given)
