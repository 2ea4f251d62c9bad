"""Calibration: a true posterior covers at its level, a prior covers but is not sharp."""

import numpy as np
import pytest

from sonarwarp.metrics.calibration import evaluate_calibration


def test_a_normal_posterior_covers_95_per_cent_and_a_narrow_one_less():
    rng = np.random.default_rng(1)
    truth = rng.normal(0.0, 0.02, 40000)
    kind = np.where(np.arange(40000) % 2 == 0, "front", "top")
    deviation = np.where(kind == "front", 0.02, 0.005)
    front, top = evaluate_calibration(np.zeros(40000), deviation, truth, kind)
    assert (front.kind, top.kind) == ("front", "top")
    # Four standard errors of a share of 0.95 over 20,000 points.
    assert front.coverage == pytest.approx(0.95, abs=4 * np.sqrt(0.95 * 0.05 / 20000))
    assert top.coverage == pytest.approx(0.376, abs=0.02)
    assert (front.sharpness, top.sharpness) == (0.02, 0.005)


def test_points_without_a_truth_do_not_count():
    rows = evaluate_calibration(np.zeros(3), np.ones(3), np.array([0.0, np.nan, 5.0]), np.array(["a", "a", "a"]))
    assert (rows[0].points, rows[0].coverage) == (2, 0.5)
    assert evaluate_calibration(np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0, dtype=str)) == []


def test_shapes_must_agree():
    with pytest.raises(ValueError, match=r"truth: expected shape \(3,\), got \(2,\)"):
        evaluate_calibration(np.zeros(3), np.zeros(3), np.zeros(2), np.zeros(3, dtype=str))
