"""The range mixture is a density on its support, whatever the critical range, and its samples follow it."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from scipy import stats

from sonarwarp_kernels.keys import mix_key, uniform
from sonarwarp_kernels.mixture import check_mixture, range_density, sample_range
from sonarwarp_kernels.specs import Mixture
from tests.reference import mixture as reference

EPSILON = float(np.finfo(np.float32).eps)

USUAL = {
    "weight_hit": 0.90,
    "weight_short": 0.02,
    "weight_random": 0.05,
    "weight_seabed": 0.03,
    "deviation": 0.01,
    "rate_short": 1.0,
    "rate_seabed": 5.0,
}
EVEN = {"weight_hit": 0.25, "weight_short": 0.25, "weight_random": 0.25, "weight_seabed": 0.25}

# What is mixed, and the critical range, start and seabed [m].
CASES = {
    "usual": ({}, 3.2, 0.42, 4.8),
    "even weights": (EVEN, 3.2, 0.42, 4.8),
    "wide hit": ({**EVEN, "deviation": 2.0}, 3.2, 0.42, 4.8),
    "hit wider than the support": ({**EVEN, "deviation": 50.0}, 3.2, 0.42, 4.8),
    "steep exponentials": ({**EVEN, "rate_short": 60.0, "rate_seabed": 100.0}, 3.2, 0.42, 4.8),
    "flat exponentials": ({**EVEN, "rate_short": 1e-6, "rate_seabed": 1e-6}, 3.2, 0.42, 4.8),
    "critical at the start": (EVEN, 0.42, 0.42, 4.8),
    "critical before the start": (EVEN, 0.1, 0.42, 4.8),
    "critical just after the start": (EVEN, 0.421, 0.42, 4.8),
    "critical a rounding after the start": (EVEN, 0.42 + 4e-8, 0.42, 4.8),
    "critical at the seabed": (EVEN, 4.8, 0.42, 4.8),
    "critical beyond the seabed": (EVEN, 6.0, 0.42, 4.8),
    "start at zero": (EVEN, 1.0, 0.0, 2.0),
    "short support": ({**EVEN, "deviation": 0.5}, 0.5005, 0.5, 0.501),
}
RISE = 3
ALONE = ("hit", "short", "random", "seabed")


def make_mixture(**changed):
    mixture = Mixture()
    for name, value in {**USUAL, **changed}.items():
        setattr(mixture, name, value)
    return mixture


def only(part, **changed):
    return {**dict.fromkeys(EVEN, 0.0), f"weight_{part}": 1.0, **changed}


def case(name):
    """Mixture and its three ranges as the kernels see them, in float32."""
    changed, *ranges = CASES[name]
    return make_mixture(**changed), *(float(np.float32(value)) for value in ranges)


@wp.kernel
def density_kernel(
    mixture: Mixture,
    critical: float,
    start: float,
    seabed: float,
    distance: wp.array(dtype=float),
    density_out: wp.array(dtype=float),
):
    index = wp.tid()
    density_out[index] = range_density(mixture, critical, start, seabed, distance[index])


@wp.kernel
def sample_kernel(
    mixture: Mixture,
    critical: float,
    start: float,
    seabed: float,
    choice: wp.array(dtype=float),
    part: wp.array(dtype=float),
    distance_out: wp.array(dtype=float),
):
    index = wp.tid()
    distance_out[index] = sample_range(mixture, critical, start, seabed, choice[index], part[index])


@wp.kernel
def draw_kernel(seed: wp.uint64, choice_out: wp.array(dtype=float), part_out: wp.array(dtype=float)):
    index = wp.tid()
    key = mix_key(seed, index)
    choice_out[index] = uniform(key)
    part_out[index] = uniform(mix_key(key, 0))


def density(device, mixture, critical, start, seabed, distance):
    distance = wp.array(distance, dtype=float, device=device)
    out = wp.zeros(len(distance), dtype=float, device=device)
    inputs = [mixture, critical, start, seabed, distance]
    wp.launch(density_kernel, len(distance), inputs=inputs, outputs=[out], device=device)
    return out.numpy().astype(np.float64)


def sample(device, mixture, critical, start, seabed, choice, part):
    choice, part = (wp.array(values, dtype=float, device=device) for values in (choice, part))
    out = wp.zeros(len(choice), dtype=float, device=device)
    inputs = [mixture, critical, start, seabed, choice, part]
    wp.launch(sample_kernel, len(choice), inputs=inputs, outputs=[out], device=device)
    return out.numpy().astype(np.float64)


def draws(device, number, seed=20):
    """Uniforms as the particles draw them."""
    choice, part = (wp.zeros(number, dtype=float, device=device) for _ in range(2))
    wp.launch(draw_kernel, number, inputs=[wp.uint64(seed)], outputs=[choice, part], device=device)
    return choice.numpy(), part.numpy()


def middles(start, stop, number):
    """Middles of equal steps, in float32, and the steps' length."""
    step = (stop - start) / number
    return (start + step * (np.arange(number) + 0.5)).astype(np.float32), step


@pytest.mark.parametrize("name", CASES)
def test_the_density_integrates_to_one(device, name):
    mixture, critical, start, seabed = case(name)
    edge = min(max(critical, start), seabed)
    # Finer where the hit and both exponentials end than in between; the density jumps at the edge.
    near = [edge - 8 * mixture.deviation, edge - 0.05, edge + 0.05, edge + 8 * mixture.deviation, seabed - 0.2]
    breaks = np.unique(np.clip([start, start + 0.2, *near, edge, seabed], start, seabed))
    total = 0.0
    for low, high in itertools.pairwise(breaks):
        if high - low > 1e-5:
            distance, step = middles(low, high, 500)
            total += step * density(device, mixture, critical, start, seabed, distance).sum()
        else:
            # Too few float32 numbers lie in between: the density at both ends.
            ends = np.array([low, np.nextafter(np.float32(high), np.float32(low))])
            total += (high - low) * density(device, mixture, critical, start, seabed, ends).mean()
    # Midpoints over steps of at most a hundredth of the steepest exponential's length.
    assert total == pytest.approx(1.0, abs=2e-4)


@pytest.mark.parametrize("name", CASES)
def test_the_density_matches_scipy_inside_and_is_zero_outside(device, name):
    mixture, critical, start, seabed = case(name)
    distance = np.concatenate(
        [np.linspace(start, seabed, 4001), np.linspace(critical - 0.1, critical + 0.1, 2000), [0.0, 5.0, 100.0]]
    ).astype(np.float32)
    want = reference.density(mixture, critical, start, seabed, distance.astype(np.float64))
    got = density(device, mixture, critical, start, seabed, distance)
    assert np.all(np.isfinite(got))
    # At the parts' ends themselves either side will do.
    ends = np.isin(distance, np.float32([start, np.clip(critical, start, seabed), seabed]))
    # The exponent of a Gaussian or exponential tail carries an absolute error of its size times epsilon.
    np.testing.assert_allclose(got[~ends], want[~ends], rtol=200 * EPSILON, atol=200 * EPSILON)
    outside = (distance < np.float32(start)) | (distance > np.float32(seabed))
    assert outside.any()
    assert not got[outside].any()


@pytest.mark.parametrize("part", ALONE)
def test_each_part_is_the_printed_formula_normalised(device, part):
    # Eq. 10-13 without their normaliser, integrated by the sum over fine steps.
    changed = only(part, deviation=0.3, rate_short=0.7, rate_seabed=1.3)
    critical, start, seabed = 2.5, 0.5, 4.0
    distance, step = middles(start, seabed, 4000)
    r = distance.astype(np.float64)
    printed = {
        "hit": np.exp(-((r - critical) ** 2) / (2 * 0.3**2)),
        "short": np.where(r < critical, np.exp(-0.7 * r), 0.0),
        "random": np.ones_like(r),
        "seabed": np.exp(1.3 * r),
    }[part]
    got = density(device, make_mixture(**changed), critical, start, seabed, distance)
    # The one step that the edge at r_c cuts counts half or whole: 1 / 4000 of the support.
    np.testing.assert_allclose(got, printed / (printed.sum() * step), rtol=2 / 4000)


@pytest.mark.parametrize("critical", [0.42, 0.3, -1.0])
def test_where_nothing_can_be_nearer_the_critical_point_takes_that_weight(device, critical):
    shared = {"weight_random": 0.5, "weight_seabed": 0.0}
    split = make_mixture(**shared, weight_hit=0.2, weight_short=0.3)
    whole = make_mixture(**shared, weight_hit=0.5, weight_short=0.0)
    distance, _ = middles(0.42, 4.8, 1000)
    got, want = (density(device, mixture, critical, 0.42, 4.8, distance) for mixture in (split, whole))
    np.testing.assert_allclose(got, want, rtol=4 * EPSILON)
    uniforms = draws(device, 1000)
    got, want = (sample(device, mixture, critical, 0.42, 4.8, *uniforms) for mixture in (split, whole))
    assert np.array_equal(got, want)


def test_a_support_without_length_has_no_density_and_one_sample(device):
    for seabed in (2.0, 1.9):
        assert density(device, make_mixture(**EVEN), 2.0, 2.0, seabed, [1.9, 2.0, 2.1]).tolist() == [0.0] * 3
    got = sample(device, make_mixture(**EVEN), 2.0, 2.0, 2.0, *draws(device, 100))
    assert np.array_equal(got, np.full(100, 2.0))


# --- Samples ---


@pytest.mark.parametrize("name", CASES)
def test_samples_are_the_quantiles_of_the_part_that_was_chosen(device, name):
    mixture, critical, start, seabed = case(name)
    choice, part = draws(device, 4000)
    got = sample(device, mixture, critical, start, seabed, choice, part)
    want = reference.sample(mixture, critical, start, seabed, choice.astype(np.float64), part.astype(np.float64))
    assert got.min() >= np.float32(start)
    assert got.max() <= np.float32(seabed)
    # In tails a quantile moves by far more than its share is rounded by: compare shares of the part's own mass.
    weighted = reference.parts(mixture, critical, start, seabed)
    chosen = np.searchsorted(np.cumsum([weight for weight, _ in weighted])[:-1], choice, side="right")
    for index, (_, distribution) in enumerate(weighted):
        mine = chosen == index
        rounding = distribution.pdf(want[mine]) * 4 * EPSILON * seabed
        share = 1.0 - part[mine] if index == RISE else part[mine]
        error = np.abs(distribution.cdf(got[mine]) - share)
        # Cut at 4.8 deviations: a share of 1e-6. The inverse error function is a fit of a few epsilon.
        assert np.all(error <= 32 * EPSILON + rounding)
    assert len(np.unique(chosen)) == (3 if critical <= start else 4)


def kolmogorov(device, name, number):
    """Level at which samples of a fixed key fit the distribution function."""
    mixture, critical, start, seabed = case(name)
    got = sample(device, mixture, critical, start, seabed, *draws(device, number))
    return stats.kstest(got, lambda r: reference.share_below(mixture, critical, start, seabed, r)).pvalue


# 14 cases at a level of 0.1 %: another key fails one of them in 1.4 % of runs, this one is fixed.
@pytest.mark.parametrize("name", [name for name in CASES if "rounding" not in name])
def test_samples_follow_the_density(device, name):
    assert kolmogorov(device, name, 5000) > 1e-3


@pytest.mark.nightly
@pytest.mark.parametrize("name", [name for name in CASES if "rounding" not in name and "short" not in name])
def test_many_samples_follow_the_density(device, name):
    assert kolmogorov(device, name, 300_000) > 1e-3


@pytest.mark.parametrize("name", ["usual", "critical at the start", "critical beyond the seabed"])
def test_a_wrong_distribution_does_not_fit_the_samples(device, name):
    changed, critical, start, seabed = CASES[name]
    other = make_mixture(**{**changed, "weight_hit": 0.8, "weight_random": 0.15, "weight_short": 0.02})
    other.weight_seabed = 0.03
    got = sample(device, make_mixture(**changed), critical, start, seabed, *draws(device, 5000))
    fit = stats.kstest(got, lambda r: reference.share_below(other, critical, start, seabed, r))
    assert fit.pvalue < 1e-6


# --- What is no density ---


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"deviation": 0.0}, r"mixture\.deviation: must be above 0, got 0\.0"),
        ({"rate_short": -1.0}, r"mixture\.rate_short: must be above 0, got -1\.0"),
        ({"rate_seabed": float("nan")}, r"mixture\.rate_seabed: must be above 0, got nan"),
        ({"weight_hit": -0.25}, r"mixture\.weight_hit: must be at least 0, got -0\.25"),
        ({"weight_random": 0.5}, r"mixture: weights must sum to 1, got 1\.45"),
    ],
)
def test_what_is_no_density_is_refused_by_name(changed, message):
    with pytest.raises(ValueError, match=message):
        check_mixture(make_mixture(**changed))


def test_weights_that_float32_rounds_still_sum_to_one():
    third = 1 / 3
    check_mixture(make_mixture(weight_hit=third, weight_short=third, weight_random=third, weight_seabed=0.0))


def test_the_oracle_s_parts_are_distributions():
    mixture = SimpleNamespace(**{**USUAL, **EVEN})
    for _, part in reference.parts(mixture, 3.0, 0.5, 4.0):
        share = np.linspace(0.01, 0.99, 9)
        np.testing.assert_allclose(part.cdf(part.ppf(share)), share, atol=1e-12)
