"""Range and angles of the profiling sonar's points, there and back, and how points move with elevation."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonarwarp.scan_plane import per_elevation, to_polar, to_world

RNG = np.random.default_rng(5)
HEADS = np.concatenate([RNG.normal(0.0, 3.0, (200, 3)), Rotation.random(200, rng=RNG).as_quat()], axis=1)
POINTS = HEADS[:, :3] + RNG.normal(0.0, 2.0, (200, 3))


def test_points_come_back_from_their_range_and_angles_whatever_the_head():
    np.testing.assert_allclose(to_world(HEADS, *to_polar(HEADS, POINTS)), POINTS, atol=1e-9)


def test_the_axis_of_the_beam_is_where_both_angles_are_zero():
    zero, three = np.zeros(len(HEADS)), np.full(len(HEADS), 3.0)
    want = HEADS[:, :3] + 3.0 * Rotation.from_quat(HEADS[:, 3:]).apply([1.0, 0.0, 0.0])
    np.testing.assert_allclose(to_world(HEADS, three, zero, zero), want, atol=1e-9)


def test_range_and_the_angle_across_the_fan_stay_along_an_arc():
    distance, azimuth, elevation = to_polar(HEADS, POINTS)
    across = Rotation.from_quat(HEADS[:, 3:]).apply([0.0, 0.0, 1.0])
    moved = to_world(HEADS, distance, azimuth, elevation + 0.3)
    np.testing.assert_allclose(np.linalg.norm(moved - HEADS[:, :3], axis=1), distance)
    np.testing.assert_allclose(np.sum((moved - POINTS) * across, axis=1), 0.0, atol=1e-9)
    np.testing.assert_allclose(distance * np.sin(azimuth), np.sum((POINTS - HEADS[:, :3]) * across, axis=1), atol=1e-9)


def test_points_move_with_elevation_as_their_arc_does():
    distance, azimuth, elevation = to_polar(HEADS, POINTS)
    step = 1e-6
    ends = [to_world(HEADS, distance, azimuth, elevation + side * step) for side in (-1.0, 1.0)]
    np.testing.assert_allclose(per_elevation(HEADS, POINTS), (ends[1] - ends[0]) / (2.0 * step), atol=1e-6)


@pytest.mark.parametrize("roll", [-90.0, -50.0, 50.0, 90.0, 130.0])
@pytest.mark.parametrize("tilt", [-30.0, 20.0, 60.0, 85.0])
def test_elevation_is_positive_upwards_where_the_head_lies_on_its_side(tilt, roll):
    turn = Rotation.from_euler("ZYX", [30.0, tilt, roll], degrees=True)
    head = np.array([[1.0, 2.0, 3.0, *turn.as_quat()]])
    assert per_elevation(head, head[:, :3] + 4.0 * turn.apply([1.0, 0.0, 0.0]))[0, 2] > 0.2


@pytest.mark.parametrize("roll", [-40.0, -0.1, 0.0, 0.1, 40.0])
@pytest.mark.parametrize("tilt", [-30.0, 20.0, 60.0, 85.0])
def test_waves_do_not_turn_the_sense_of_an_upright_head_over(tilt, roll):
    turn = Rotation.from_euler("ZYX", [0.0, tilt, roll], degrees=True)
    head = np.array([[0.0, 0.0, 2.0, *turn.as_quat()]])
    assert per_elevation(head, head[:, :3] + 4.0 * turn.apply([1.0, 0.0, 0.0]))[0, 1] > 3.0
