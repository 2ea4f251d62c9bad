"""Pose arrays against SciPy's rotations."""

import numpy as np
from scipy.spatial.transform import Rotation

from sonarwarp.poses import compose, rotate, turned

RNG = np.random.default_rng(4)


def random_poses(count):
    return np.concatenate([RNG.normal(size=(count, 3)), Rotation.random(count, rng=RNG).as_quat()], axis=1)


def test_rotate_turns_vectors():
    poses, vectors = random_poses(50), RNG.normal(size=(50, 3))
    assert np.allclose(rotate(poses[:, 3:], vectors), Rotation.from_quat(poses[:, 3:]).apply(vectors))


def test_compose_chains_frames():
    outer, inner, point = random_poses(50), random_poses(50), RNG.normal(size=(50, 3))
    chained = compose(outer, inner)
    within = rotate(inner[:, 3:], point) + inner[:, :3]
    expected = rotate(outer[:, 3:], within) + outer[:, :3]
    assert np.allclose(rotate(chained[:, 3:], point) + chained[:, :3], expected)


def test_turned_is_the_order_of_eq_35():
    poses, angles = random_poses(50), RNG.uniform(-3.0, 3.0, size=(50, 3))
    got = turned(poses, angles)
    expected = Rotation.from_quat(poses[:, 3:]) * Rotation.from_euler("ZYX", angles[:, ::-1])
    assert np.allclose(got[:, :3], poses[:, :3])
    assert np.allclose((Rotation.from_quat(got[:, 3:]).inv() * expected).magnitude(), 0.0, atol=1e-7)
