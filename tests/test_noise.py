"""Noise: unit-mean speckle on echoes, a background that adds to them, every draw keyed by what it is for."""

import numpy as np
import pytest
import warp as wp
from scipy import stats

from sonarwarp_kernels import keys, noise
from tests.reference.keys import mix_key

EPSILON = float(np.finfo(np.float32).eps)

# Rayleigh variate of unit mean.
UNIT_RAYLEIGH = stats.rayleigh(scale=np.sqrt(2 / np.pi))

FIXED_POINT = 2.0**20


def finish(device, counts, frame_key, speckle, background, threads=1):
    """Images of ``counts`` [frame, beam, bin]; the other arguments are per frame."""
    counts = np.asarray(counts, dtype=np.int32)
    image = wp.full(counts.shape, -7.0, dtype=float, device=device)
    noise.finish_images(
        wp.array(counts, dtype=int, device=device),
        FIXED_POINT,
        wp.array(np.asarray(frame_key, dtype=np.uint64), dtype=wp.uint64, device=device),
        wp.array(speckle, dtype=int, device=device),
        wp.array(background, dtype=float, device=device),
        image,
        device=device,
        threads=threads,
    )
    return image.numpy()


def even_echo(amplitude, shape):
    return np.full(shape, round(amplitude * FIXED_POINT), dtype=np.int32)


def random_counts(shape):
    return np.random.default_rng(2).integers(0, 2**31, shape, dtype=np.int64).astype(np.int32)


# --- Amplitudes ---


def test_without_noise_an_image_is_its_counts(device):
    counts = random_counts((2, 3, 70))
    counts[0, 0, :5] = [0, 1, 2, 2**31 - 1, 2**20]
    image = finish(device, counts, [1, 2], [0, 0], [0.0, 0.0])
    assert np.array_equal(image, counts.astype(np.float32) / np.float32(FIXED_POINT))


def test_values_match_the_keyed_oracle(device):
    counts = random_counts((2, 3, 40))
    frame_key, level = [2**64 - 1, 12345], [0.25, 3.0]
    image = finish(device, counts, frame_key, [1, 1], level)

    def rayleigh(frame, stream, beam, bin):
        key = mix_key(mix_key(mix_key(frame_key[frame], stream), beam), bin)
        return np.sqrt(-4 / np.pi * np.log(((key >> 41) + 0.5) / 2**23))

    for frame, beam, bin in np.ndindex(counts.shape):
        echo = counts[frame, beam, bin] / FIXED_POINT * rayleigh(frame, 4, beam, bin)
        want = echo + level[frame] * rayleigh(frame, 5, beam, bin)
        assert image[frame, beam, bin] == pytest.approx(want, rel=8 * EPSILON)


def test_speckle_has_unit_mean_and_the_rayleigh_law(device):
    image = finish(device, even_echo(0.5, (1, 96, 512)), [3], [1], [0.0]) / 0.5
    n = image.size
    assert abs(image.mean(dtype=np.float64) - 1.0) < 5 * np.sqrt((4 / np.pi - 1) / n)
    assert stats.kstest(image.ravel(), UNIT_RAYLEIGH.cdf).pvalue > 1e-4


def test_the_background_has_its_mean_and_the_rayleigh_law(device):
    image = finish(device, np.zeros((1, 96, 512)), [3], [1], [0.02]) / 0.02
    n = image.size
    assert abs(image.mean(dtype=np.float64) - 1.0) < 5 * np.sqrt((4 / np.pi - 1) / n)
    assert stats.kstest(image.ravel(), UNIT_RAYLEIGH.cdf).pvalue > 1e-4


def test_speckle_scales_with_the_echo_and_leaves_darkness_dark(device):
    faint = finish(device, even_echo(0.25, (1, 4, 64)), [3], [1], [0.0])
    strong = finish(device, even_echo(4.0, (1, 4, 64)), [3], [1], [0.0])
    assert np.array_equal(strong, 16 * faint)
    assert np.all(finish(device, np.zeros((1, 4, 64)), [3], [1], [0.0]) == 0.0)


def test_the_background_adds_to_the_speckled_echo(device):
    counts = random_counts((1, 8, 64))
    both = finish(device, counts, [3], [1], [0.1])
    speckle = finish(device, counts, [3], [1], [0.0])
    background = finish(device, np.zeros_like(counts), [3], [1], [0.1])
    assert np.allclose(both, speckle + background, rtol=2 * EPSILON, atol=0.0)


def test_each_frame_has_its_own_switches(device):
    counts = even_echo(1.0, (4, 8, 64))
    image = finish(device, counts, [3, 3, 3, 3], [0, 1, 0, 1], [0.0, 0.0, 0.5, 0.5])
    for frame, (speckle, level) in enumerate([(0, 0.0), (1, 0.0), (0, 0.5), (1, 0.5)]):
        assert np.array_equal(image[frame], finish(device, counts[:1], [3], [speckle], [level])[0])
    assert len({image[frame].tobytes() for frame in range(4)}) == 4


# --- Independence ---


def frame_key(seed=1, trajectory=1, number=1, sonar=int(keys.FLS_FRAMES)):
    return mix_key(mix_key(seed, sonar) ^ trajectory, number)


@pytest.mark.parametrize(
    "changed", [{"seed": 2}, {"trajectory": 2}, {"number": 2}, {"number": 0}, {"sonar": int(keys.PS_PINGS)}], ids=str
)
@pytest.mark.parametrize(("speckle", "level"), [(1, 0.0), (0, 1.0)], ids=["speckle", "background"])
def test_sonars_frames_and_seeds_share_no_noise(device, changed, speckle, level):
    counts = even_echo(1.0, (2, 96, 512)) * speckle
    a, b = finish(device, counts, [frame_key(), frame_key(**changed)], [speckle] * 2, [level] * 2)
    assert abs(np.corrcoef(a.ravel(), b.ravel())[0, 1]) < 5 / np.sqrt(a.size)


def test_beams_bins_and_the_two_noises_share_nothing(device):
    speckle = finish(device, even_echo(1.0, (1, 96, 512)), [frame_key()], [1], [0.0])[0]
    background = finish(device, np.zeros((1, 96, 512)), [frame_key()], [0], [1.0])[0]
    pairs = {
        "speckle and background": (speckle, background),
        "speckle of neighbouring bins": (speckle[:, 1:], speckle[:, :-1]),
        "speckle of neighbouring beams": (speckle[1:], speckle[:-1]),
        "background of neighbouring bins": (background[:, 1:], background[:, :-1]),
        "background of neighbouring beams": (background[1:], background[:-1]),
        "speckle along a diagonal": (speckle[1:, :-1], speckle[:-1, 1:]),
        "speckle across beam and bin": (speckle[:, :96], speckle[:, :96].T),
    }
    for name, (a, b) in pairs.items():
        assert abs(np.corrcoef(a.ravel(), b.ravel())[0, 1]) < 5 / np.sqrt(a.size), name


# --- The contract ---


def test_a_frame_is_the_same_alone_in_a_batch_and_with_any_number_of_threads(device):
    counts = random_counts((5, 7, 100))
    frame_keys, speckle, level = [9, 8, 7, 6, 5], [1, 0, 1, 1, 0], [0.0, 0.1, 0.2, 0.3, 0.4]
    batch = finish(device, counts, frame_keys, speckle, level)
    assert np.array_equal(batch, finish(device, counts, frame_keys, speckle, level, threads=3))
    for frame in range(5):
        one = slice(frame, frame + 1)
        alone = finish(device, counts[one], frame_keys[one], speckle[one], level[one])
        assert np.array_equal(batch[one], alone)


def test_a_beam_is_the_same_in_a_shorter_window(device):
    counts = random_counts((1, 7, 100))
    whole = finish(device, counts, [9], [1], [0.1])
    assert np.array_equal(whole[:, :3, :40], finish(device, counts[:, :3, :40], [9], [1], [0.1]))


def test_the_counts_are_left_as_they_are(device):
    counts = wp.full((1, 4, 64), 100, dtype=int, device=device)
    image = wp.zeros((1, 4, 64), dtype=float, device=device)
    key = wp.zeros(1, dtype=wp.uint64, device=device)
    switch = wp.full(1, 1, dtype=int, device=device)
    level = wp.full(1, 0.1, dtype=float, device=device)
    noise.finish_images(counts, FIXED_POINT, key, switch, level, image, device=device)
    assert np.all(counts.numpy() == 100)


@pytest.mark.parametrize(
    ("wrong", "shape", "dtype", "message"),
    [
        ("counts", (4, 96, 512), float, "counts: expected dtype int32, got float32"),
        ("counts", (96, 512), int, r"counts: expected shape \(any, any, any\), got \(96, 512\)"),
        ("keys", (3,), wp.uint64, r"keys: expected shape \(4,\), got \(3,\)"),
        ("speckle", (4,), float, "speckle: expected dtype int32, got float32"),
        ("background", (4, 96), float, r"background: expected shape \(4,\), got \(4, 96\)"),
        ("image_out", (4, 512, 96), float, r"image_out: expected shape \(4, 96, 512\), got \(4, 512, 96\)"),
    ],
)
def test_wrong_arrays_are_refused_by_name(device, wrong, shape, dtype, message):
    arrays = {
        "counts": wp.zeros((4, 96, 512), dtype=int, device=device),
        "keys": wp.zeros(4, dtype=wp.uint64, device=device),
        "speckle": wp.zeros(4, dtype=int, device=device),
        "background": wp.zeros(4, dtype=float, device=device),
        "image_out": wp.zeros((4, 96, 512), dtype=float, device=device),
    }
    arrays[wrong] = wp.zeros(shape, dtype=dtype, device=device)
    with pytest.raises(ValueError, match=message):
        noise.finish_images(fixed_point=FIXED_POINT, **arrays, device=device)


@pytest.mark.parametrize("fixed_point", [0.0, -1.0, float("nan")])
def test_a_scale_that_is_not_positive_is_refused(device, fixed_point):
    image = wp.zeros((1, 1, 1), dtype=float, device=device)
    counts = wp.zeros((1, 1, 1), dtype=int, device=device)
    key = wp.zeros(1, dtype=wp.uint64, device=device)
    switch = wp.zeros(1, dtype=int, device=device)
    level = wp.zeros(1, dtype=float, device=device)
    with pytest.raises(ValueError, match="fixed_point: must be positive"):
        noise.finish_images(counts, fixed_point, key, switch, level, image, device=device)
