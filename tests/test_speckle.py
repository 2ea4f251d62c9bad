"""Speckle along the way of a sonar: Rayleigh at every frame, correlated by distance, fresh where nothing is shared."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from scipy import stats

import sonarwarp as sw
from sonarwarp.poses import turned
from sonarwarp.speckle import speckle_knots
from sonarwarp_kernels import keys, noise
from tests.reference.noise import bohman, knot_correlation

WIDTH = np.radians(0.3)

# Rayleigh variate of unit mean.
UNIT_RAYLEIGH = stats.rayleigh(scale=np.sqrt(2 / np.pi))

BEAMS, BINS = 96, 512


def straight(steps):
    """Poses along x, shape [len(steps) + 1, 7]."""
    pose = np.zeros((len(steps) + 1, 7))
    pose[1:, 0] = np.cumsum(steps)
    pose[:, 6] = 1.0
    return pose


def one(count):
    """That many frames of one trajectory."""
    return np.zeros(count, dtype=int)


def along(device, knots, *, seed=1, trajectory=1, sonar=int(keys.FLS_FRAMES), shape=(BEAMS, BINS)):
    """Speckle at distances of some knots, shape [distance, beam, bin]."""
    knots = np.asarray(knots, dtype=float)
    count = len(knots)
    number = np.stack([np.floor(knots), np.floor(knots) + 1], axis=-1).ravel()
    key = wp.zeros(2 * count, dtype=wp.uint64, device=device)
    keys.frame_keys(
        wp.array([seed], dtype=wp.uint64, device=device),
        wp.array([trajectory], dtype=wp.uint64, device=device),
        wp.zeros(2 * count, dtype=int, device=device),
        wp.array(number, dtype=int, device=device),
        sonar,
        key,
        device=device,
    )
    image = wp.zeros((count, *shape), dtype=float, device=device)
    noise.finish_images(
        wp.full((count, *shape), 2**20, dtype=int, device=device),
        2.0**20,
        wp.zeros(count, dtype=wp.uint64, device=device),
        wp.full(count, 1, dtype=int, device=device),
        key.reshape((count, 2)),
        wp.array(knots % 1.0, dtype=float, device=device),
        wp.zeros(count, dtype=float, device=device),
        image,
        device=device,
    )
    return image.numpy()


def correlation(a, b):
    return np.corrcoef(a.ravel(), b.ravel())[0, 1]


# --- The law ---


@pytest.mark.parametrize("blend", [0.0, 0.01, 0.25, 0.5, 0.8, 0.99])
def test_speckle_is_rayleigh_of_unit_mean_wherever_a_frame_lies(device, blend):
    image = along(device, [7.0 + blend])
    assert abs(image.mean(dtype=np.float64) - 1.0) < 5 * np.sqrt((4 / np.pi - 1) / image.size)
    assert stats.kstest(image.ravel(), UNIT_RAYLEIGH.cdf).pvalue > 1e-4


@pytest.mark.parametrize("lag", [0.1, 0.5, 0.9, 1.0, 1.3, 1.9, 2.0, 2.7])
def test_power_is_correlated_by_distance_as_stated(device, lag):
    start = np.linspace(0.0, 1.0, 10, endpoint=False)
    here, there = along(device, start) ** 2, along(device, start + lag) ** 2
    found = [correlation(a, b) for a, b in zip(here, there, strict=True)]
    # Of complex Gaussians, power is correlated by the square of their own correlation. Five standard errors over 49,152
    # bins are 0.023 where there is none; power's tails make it up to 0.04.
    assert np.allclose(found, [knot_correlation(at, at + lag) ** 2 for at in start], atol=0.04)


def test_correlation_is_bohmans_window_over_where_the_knots_lie():
    start = (np.arange(2000) + 0.5) / 2000
    for lag in (0.1, 0.5, 1.0, 1.9, 2.0, 2.7):
        mean = np.mean([knot_correlation(at, at + lag) for at in start])
        assert mean == pytest.approx(bohman(lag), abs=1e-6)
    assert bohman(1.0) == pytest.approx(1.0 / np.pi)


def test_the_same_distance_has_the_same_speckle(device):
    first, second = along(device, [3.25, 8.5]), along(device, [8.5, 3.25])
    assert np.array_equal(first, second[::-1])
    # From both sides of a knot it is that knot's own.
    below, at = along(device, [4.0 - 1e-7, 4.0])
    assert np.allclose(below, at, atol=1e-5)


@pytest.mark.parametrize("changed", [{"seed": 2}, {"trajectory": 2}, {"sonar": int(keys.PS_PINGS)}], ids=str)
def test_seeds_trajectories_and_sonars_share_no_speckle(device, changed):
    a, b = along(device, [3.25]), along(device, [3.25], **changed)
    assert abs(correlation(a, b)) < 5 / np.sqrt(a.size)


def test_between_knots_beams_and_bins_share_nothing(device):
    image = along(device, [3.5])[0]
    for a, b in ((image[:, 1:], image[:, :-1]), (image[1:], image[:-1]), (image[:, :96], image[:, :96].T)):
        assert abs(correlation(a, b)) < 5 / np.sqrt(a.size)


# --- Knots along the way ---


def test_knots_lie_a_length_apart():
    knot, blend = speckle_knots(straight([0.005] * 6), one(7), 0.01, WIDTH)
    assert np.allclose(knot + blend, 0.5 * np.arange(7))
    assert ((blend >= 0.0) & (blend < 1.0)).all()


def test_a_sonar_that_stands_still_sees_the_same_speckle():
    knot, blend = speckle_knots(straight([0.004, 0.0, 0.0]), one(4), 0.01, WIDTH)
    assert np.allclose(knot + blend, [0.0, 0.4, 0.4, 0.4])


def test_a_turn_by_a_beamwidth_counts_as_a_length():
    angles = np.zeros((4, 3))
    angles[:, 2] = np.array([0.0, 0.5, 1.0, 0.5]) * WIDTH
    for pose in (straight([0.0] * 3), straight([0.0] * 3) * np.array([1, 1, 1, 1, 1, 1, -1.0])):
        knot, blend = speckle_knots(turned(pose, angles), one(4), 0.01, WIDTH)
        assert np.allclose(knot + blend, [0.0, 0.5, 1.0, 1.5], atol=1e-6)
    # Pitch moves bins along what a tall beam sees anyway.
    angles[:, 1], angles[:, 2] = angles[:, 2], 0.0
    knot, blend = speckle_knots(turned(straight([0.0] * 3), angles), one(4), 0.01, WIDTH)
    assert np.allclose(knot + blend, 0.0, atol=1e-6)


def test_frames_that_share_nothing_lie_on_knots_of_their_own():
    steps = [0.005, 0.02, 0.004, 0.5, 0.5]
    knot, blend = speckle_knots(straight(steps), one(6), 0.01, WIDTH)
    assert np.allclose(knot + blend, [0.0, 0.5, 2.0, 2.4, 4.0, 5.0])
    used = [set(range(int(k), int(k) + 1 + (b > 0))) for k, b in zip(knot, blend, strict=True)]
    assert not used[1] & used[2]
    assert not used[3] & used[4]


def test_without_a_length_every_frame_is_its_own_knot():
    for steps in ([0.01] * 5, [0.0] * 5):
        knot, blend = speckle_knots(straight(steps), one(6), 0.0, WIDTH)
        assert np.array_equal(knot, np.arange(6))
        assert not blend.any()


def test_a_trajectory_has_its_knots_wherever_its_frames_stand():
    draw = np.random.default_rng(3)
    a, b = (straight(draw.uniform(0.0, 0.03, 20)) for _ in range(2))
    order = draw.permutation(42)
    mixed = np.empty((42, 7))
    owner = np.empty(42, dtype=int)
    # Each in order of time, the two of them shuffled together.
    for trajectory, pose in enumerate((a, b)):
        rows = np.sort(order[21 * trajectory : 21 * trajectory + 21])
        mixed[rows], owner[rows] = pose, trajectory
    together = speckle_knots(mixed, owner, 0.01, WIDTH)
    for trajectory, pose in enumerate((a, b)):
        for values, alone in zip(together, speckle_knots(pose, one(21), 0.01, WIDTH), strict=True):
            assert np.array_equal(values[owner == trajectory], alone)
    knot, blend = speckle_knots(np.zeros((0, 7)), one(0), 0.01, WIDTH)
    assert (len(knot), len(blend)) == (0, 0)


# --- In a simulation ---


def test_neighbouring_frames_of_a_run_share_speckle_and_distant_ones_none(device):
    from tests.small_runs import RIG, run, scene

    still = replace(sw.Noise(), background_db=None)
    bare = sw.simulate(RIG, scene(front_x=9.0), run(speed=0.05), device=device)
    log = sw.simulate(RIG, scene(front_x=9.0), run(speed=0.05), noise=still, seed=2, device=device)
    lit = bare.images > 0.2 * bare.images.max()
    speckle = np.where(lit, log.images / np.where(lit, bare.images, 1.0), np.nan)

    def shared(lag):
        a, b = speckle[:-lag].ravel() ** 2, speckle[lag:].ravel() ** 2
        both = np.isfinite(a) & np.isfinite(b)
        return correlation(a[both], b[both])

    # 5 mm are half a length, where pairs within an interval and across a knot alike have cos(pi / 4), squared.
    assert shared(1) == pytest.approx(0.5, abs=0.05)
    assert abs(shared(4)) < 0.05
    fresh = sw.simulate(
        RIG, scene(front_x=9.0), run(speed=0.05), noise=replace(still, speckle_length=0.0), seed=2, device=device
    )
    speckle = np.where(lit, fresh.images / np.where(lit, bare.images, 1.0), np.nan)
    assert abs(shared(1)) < 0.05


@pytest.mark.parametrize("length", [-0.01, 101.0, float("nan")])
def test_a_careless_length_is_refused_by_name(length):
    with pytest.raises(ValueError, match=r"Noise\.speckle_length: .* is outside \[0, 100\]"):
        sw.Noise(speckle_length=length)
