"""Noise: unit-mean speckle on echoes, a background that adds to them, every draw keyed by what it is for.

``test_speckle`` has what speckle does along the way.
"""

import numpy as np
import pytest
import warp as wp
from scipy import stats

from sonarwarp_kernels import keys, noise
from tests.reference import noise as reference
from tests.reference.keys import mix_key

EPSILON = float(np.finfo(np.float32).eps)

# Rayleigh variate of unit mean.
UNIT_RAYLEIGH = stats.rayleigh(scale=np.sqrt(2 / np.pi))

FIXED_POINT = 2.0**20


def finish(device, counts, frame_key, speckle, background, threads=1, knot_keys=None, blend=None):
    """Images of ``counts`` [frame, beam, bin]; the other arguments are per frame, each on its own knot by default."""
    counts = np.asarray(counts, dtype=np.int32)
    knot_keys = np.stack([frame_key, np.zeros_like(frame_key)], axis=-1) if knot_keys is None else knot_keys
    blend = np.zeros(len(counts)) if blend is None else blend
    image = wp.full(counts.shape, -7.0, dtype=float, device=device)
    noise.finish_images(
        wp.array(counts, dtype=int, device=device),
        FIXED_POINT,
        wp.array(np.asarray(frame_key, dtype=np.uint64), dtype=wp.uint64, device=device),
        wp.array(speckle, dtype=int, device=device),
        wp.array(np.asarray(knot_keys, dtype=np.uint64), dtype=wp.uint64, device=device),
        wp.array(blend, dtype=float, device=device),
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
    frame_key, level, blend = [2**64 - 1, 12345], [0.25, 3.0], [0.0, 0.4]
    knot_keys = [[77, 2**64 - 1], [2**63, 5]]
    image = finish(device, counts, frame_key, [1, 1], level, knot_keys=knot_keys, blend=blend)
    for frame, beam, bin in np.ndindex(counts.shape):
        echo = counts[frame, beam, bin] / FIXED_POINT
        speckled = echo * reference.speckle(*knot_keys[frame], blend[frame], beam, bin)
        want = speckled + level[frame] * reference.background(frame_key[frame], beam, bin)
        # Where two knots nearly cancel, what is left has the rounding of their sum: that of an amplitude of 1 or so.
        lost = 32 * EPSILON * echo * min(1.0, echo / speckled) if blend[frame] else 0.0
        assert abs(image[frame, beam, bin] - want) < 8 * EPSILON * want + lost


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
    way = {"knot_keys": [[1, 2], [2, 3], [3, 4], [3, 4], [4, 5]], "blend": [0.0, 0.5, 0.2, 0.9, 0.1]}
    batch = finish(device, counts, frame_keys, speckle, level, **way)
    assert np.array_equal(batch, finish(device, counts, frame_keys, speckle, level, threads=3, **way))
    for frame in range(5):
        one = slice(frame, frame + 1)
        mine = {name: values[one] for name, values in way.items()}
        alone = finish(device, counts[one], frame_keys[one], speckle[one], level[one], **mine)
        assert np.array_equal(batch[one], alone)


def test_a_beam_is_the_same_in_a_shorter_window(device):
    counts = random_counts((1, 7, 100))
    whole = finish(device, counts, [9], [1], [0.1])
    assert np.array_equal(whole[:, :3, :40], finish(device, counts[:, :3, :40], [9], [1], [0.1]))


def test_the_counts_are_left_as_they_are(device):
    arrays = inputs(device, 1, 4, 64)
    arrays["counts"].fill_(100)
    noise.finish_images(fixed_point=FIXED_POINT, **arrays, device=device)
    assert np.all(arrays["counts"].numpy() == 100)


def inputs(device, frames, beams, bins):
    """What the launcher takes besides its scale, all zero."""
    return {
        "counts": wp.zeros((frames, beams, bins), dtype=int, device=device),
        "keys": wp.zeros(frames, dtype=wp.uint64, device=device),
        "speckle": wp.zeros(frames, dtype=int, device=device),
        "knot_keys": wp.zeros((frames, 2), dtype=wp.uint64, device=device),
        "blend": wp.zeros(frames, dtype=float, device=device),
        "background": wp.zeros(frames, dtype=float, device=device),
        "image_out": wp.zeros((frames, beams, bins), dtype=float, device=device),
    }


@pytest.mark.parametrize(
    ("wrong", "shape", "dtype", "message"),
    [
        ("counts", (4, 96, 512), float, "counts: expected dtype int32, got float32"),
        ("counts", (96, 512), int, r"counts: expected shape \(any, any, any\), got \(96, 512\)"),
        ("keys", (3,), wp.uint64, r"keys: expected shape \(4,\), got \(3,\)"),
        ("speckle", (4,), float, "speckle: expected dtype int32, got float32"),
        ("knot_keys", (4,), wp.uint64, r"knot_keys: expected shape \(4, 2\), got \(4,\)"),
        ("blend", (4,), int, "blend: expected dtype float32, got int32"),
        ("background", (4, 96), float, r"background: expected shape \(4,\), got \(4, 96\)"),
        ("image_out", (4, 512, 96), float, r"image_out: expected shape \(4, 96, 512\), got \(4, 512, 96\)"),
    ],
)
def test_wrong_arrays_are_refused_by_name(device, wrong, shape, dtype, message):
    arrays = inputs(device, 4, 96, 512)
    arrays[wrong] = wp.zeros(shape, dtype=dtype, device=device)
    with pytest.raises(ValueError, match=message):
        noise.finish_images(fixed_point=FIXED_POINT, **arrays, device=device)


@pytest.mark.parametrize("fixed_point", [0.0, -1.0, float("nan")])
def test_a_scale_that_is_not_positive_is_refused(device, fixed_point):
    with pytest.raises(ValueError, match="fixed_point: must be positive"):
        noise.finish_images(fixed_point=fixed_point, **inputs(device, 1, 1, 1), device=device)
