"""What a reconstruction is told reaches the kernels."""

from dataclasses import fields, replace

import numpy as np
import pytest

import sonarwarp as sw
from sonarwarp import specs
from tests.small_runs import RIG

ANGLES = {"least_slope_deg", "overhang_deg"}


def front_model(**changed):
    settings = sw.ReconstructionSettings()
    return specs.front_model(replace(settings, faces=replace(settings.faces, **changed)), RIG.ps)


@pytest.mark.parametrize("name", sorted({column.name for column in fields(sw.Faces)} - ANGLES))
def test_what_counts_as_a_face_is_told_by_name(name):
    assert getattr(front_model(**{name: 0.123}), name) == pytest.approx(0.123)


def test_the_slopes_of_faces_are_told_as_their_way_back_over_their_height():
    model = front_model(least_slope_deg=60.0, overhang_deg=30.0)
    assert (model.most_run, model.least_run) == pytest.approx((1.0 / np.sqrt(3.0), -1.0 / np.sqrt(3.0)))
