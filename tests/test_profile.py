"""Footprints of the profiling sonar's echoes: what counts as a return, where it lies, and in which order."""

import numpy as np
import pytest
import warp as wp

from sonarwarp_kernels import profile
from tests.reference import profile as reference

EPSILON = float(np.finfo(np.float32).eps)

BINS = 400
EDGES = {
    "uniform": np.linspace(1.0, 9.0, BINS + 1),
    "widening": np.geomspace(1.0, 9.0, BINS + 1),
    "irregular": 1.0 + np.cumsum(np.random.default_rng(4).uniform(0.005, 0.03, BINS + 1)),
}
WIDTH = 8.0 / BINS


def smoothing_shift(distance):
    """Shift [m] of a uniform echo's edge: amplitudes are smoothed, by one bin RMS, before their r^2 is corrected."""
    return 2.0 * WIDTH**2 / distance


def make_detector(**changed):
    detector = profile.ProfileDetector()
    for name, value in {"relative": 0.05, "clearance": 3.0, "gap": 3, **changed}.items():
        setattr(detector, name, value)
    return detector


def detect(device, echo, range_edge=EDGES["uniform"], footprints=3, threads=1, **changed):
    """Footprints of every row of ``echo``, shape [ping, footprint, 3]."""
    echo = wp.array(np.atleast_2d(echo), dtype=float, device=device)
    out = wp.full((echo.shape[0], footprints), 7.0, dtype=wp.vec3, device=device)
    edge = wp.array(range_edge, dtype=float, device=device)
    profile.detect_profile(edge, make_detector(**changed), echo, out, device=device, threads=threads)
    return out.numpy()


def found(footprints):
    """Number of footprints of each ping; the rest must be marked in all three ranges."""
    used = footprints[..., 0] != profile.NO_FOOTPRINT
    assert np.all(footprints[~used] == profile.NO_FOOTPRINT)
    return used.sum(axis=1)


def middles(range_edge):
    return 0.5 * (range_edge[1:] + range_edge[:-1])


def surface_echo(*returns, range_edge=EDGES["uniform"]):
    """Echo of surfaces that fill whole bins [first, stop), of a strength at 1 m, weaker by r^2."""
    echo = np.zeros(len(range_edge) - 1)
    for first, stop, strength in returns:
        echo[first:stop] += strength
    return echo / middles(range_edge) ** 2


def rayleigh(rng, shape):
    """Speckle of unit mean."""
    return rng.rayleigh(np.sqrt(2 / np.pi), shape)


# --- What is a return ---


@pytest.mark.parametrize("level", [0.0, 1e-6, 1.0])
@pytest.mark.parametrize("footprints", [1, 3])
def test_a_profile_without_a_return_has_no_footprint(device, level, footprints):
    assert found(detect(device, np.full(BINS, level), footprints=footprints)) == 0


def test_speckle_alone_is_no_return(device):
    # Smoothed Rayleigh noise has a deviation of 0.27 of its mean: a bin stands 7 deviations over it.
    echo = rayleigh(np.random.default_rng(5), (500, BINS))
    assert found(detect(device, echo)).sum() == 0
    # The same without a clearance: it is the clearance that keeps them out.
    assert found(detect(device, echo, clearance=0.0)).min() > 0


@pytest.mark.parametrize(("times", "count"), [(2.5, 0), (3.5, 1)])
def test_a_return_stands_clear_of_the_background(device, times, count):
    echo = np.full(BINS, 0.2)
    # Far off, and few bins: neither the correction for range nor the background's mean notices.
    echo[300:312] *= times
    background = reference.background(echo)
    assert background == pytest.approx(0.2 if times > 3 else 0.209, rel=1e-6)
    assert found(detect(device, echo)) == count


@pytest.mark.parametrize(("strength", "count"), [(0.04, 1), (0.06, 2)])
def test_a_return_reaches_a_share_of_the_strongest_at_whatever_range(device, strength, count):
    for first, second in ((50, 350), (350, 50)):
        echo = surface_echo((first, first + 20, 1.0), (second, second + 20, strength))
        assert found(detect(device, echo, clearance=0.0)) == count


def test_equal_surfaces_count_alike_however_far_they_are(device):
    # Uncorrected the far one would stand at (2.2 / 8.2)^2 = 7 % of the near one.
    near_and_far = surface_echo((50, 70, 1.0), (350, 370, 1.0))
    assert found(detect(device, near_and_far, relative=0.5)) == 2


# --- Where it lies ---


@pytest.mark.parametrize(("first", "stop"), [(50, 70), (200, 240), (350, 355), (100, 200)])
def test_a_box_echo_is_described_by_its_tenth_its_middle_and_its_nine_tenths(device, first, stop):
    got = detect(device, surface_echo((first, stop, 1.0)), clearance=1.0)[0, 0]
    begin, end = EDGES["uniform"][[first, stop]]
    want = begin + np.array([0.1, 0.5, 0.9]) * (end - begin)
    assert got[1] == pytest.approx(want[1], abs=smoothing_shift(begin))
    if (stop - first) * 0.1 < 2:
        # The smoothing rounds an edge over two bins to either side: a short box's tenths lie inside that.
        assert begin - 2 * WIDTH < got[0] < want[0]
        assert want[2] < got[2] < end + 2 * WIDTH
    else:
        np.testing.assert_allclose(got, want, atol=smoothing_shift(begin))


def test_amplitudes_count_by_the_square_of_their_range(device):
    echo = np.zeros(BINS)
    echo[100:180] = 1.0
    got = detect(device, echo, relative=0.01)[0, 0]
    begin, end = EDGES["uniform"][[100, 180]]
    # Cube of the range at which the integral of r^2 reaches a share; the centroid weighs r by r^2, and has no trail.
    tenth, nine_tenths = np.cbrt(begin**3 + np.array([0.1, 0.9]) * (end**3 - begin**3))
    centroid = 0.75 * (end**4 - begin**4) / (end**3 - begin**3)
    np.testing.assert_allclose(got, [tenth, centroid, nine_tenths], atol=smoothing_shift(begin))


def test_the_flanks_of_a_round_front_move_its_echo_back_by_less_than_their_centroid(device):
    begin, depth = 3.0, 1.2
    # What lies x to the side of the ridge of a parabola lies x^2 behind it, and is as strong.
    edge = np.clip((EDGES["uniform"] - begin) / depth, 0.0, 1.0)
    echo = np.diff(np.sqrt(edge)) / middles(EDGES["uniform"]) ** 2
    got = detect(device, echo, relative=0.01, clearance=1.0)[0, 0]
    # Of the roots, even in [0, 1]: 10 % and 90 % lie at their squares, the centroid at a third.
    near, centroid, far = begin + depth * np.array([0.01, 1 / 3, 0.81])
    trail = (near + far) / 2 - centroid
    # The first bin, a pole of the density, holds a ninth of the energy, and smoothing spreads it over four.
    np.testing.assert_allclose(got, [near, centroid - trail, far], atol=2 * WIDTH)
    assert got[1] < centroid - 0.05 * depth


def test_a_centre_does_not_lie_before_its_echo(device):
    # A quarter of the energy in a trail a hundred times as long: twice the centroid leads to ten bins before the spike.
    trailing = surface_echo((200, 202, 60.0), (202, 392, 0.2))
    near, centre, far = detect(device, trailing, relative=0.001, clearance=1.0)[0, 0]
    assert far - near > 100 * WIDTH
    assert centre == near


def test_an_echo_that_rises_keeps_its_centroid(device):
    rising = surface_echo((200, 238, 1.0), (238, 240, 30.0))
    # A threshold under what smoothing leaves of the weak end's border.
    near, centre, far = detect(device, rising, relative=0.001, clearance=1.0)[0, 0]
    # 38 bins of mean 19 and two of 39, the latter 30 times as strong.
    begin = EDGES["uniform"][200]
    assert centre == pytest.approx(begin + WIDTH * (38 * 19 + 60 * 39) / 98, abs=2 * smoothing_shift(begin))
    assert near < centre < far


def test_an_even_background_moves_nothing(device):
    echo = surface_echo((200, 240, 16.0))
    got = detect(device, echo + 0.1, clearance=1.2)
    # The background's mean is a sum of 360 equal terms.
    np.testing.assert_allclose(got[0, 0], detect(device, echo, clearance=1.2)[0, 0], atol=360 * EPSILON)


@pytest.mark.parametrize("edges", ["widening", "irregular"])
def test_bins_of_any_width_place_an_echo_alike(device, edges):
    range_edge = EDGES[edges]
    first, stop = 180, 230
    # A bin gathers what returns within it: an even surface fills each by its width.
    echo = surface_echo((first, stop, 1.0), range_edge=range_edge) * np.diff(range_edge)
    got = detect(device, echo, range_edge, clearance=1.0)[0, 0]
    begin, end = range_edge[[first, stop]]
    want = begin + np.array([0.1, 0.5, 0.9]) * (end - begin)
    np.testing.assert_allclose(got, want, atol=np.diff(range_edge)[first:stop].max())


@pytest.mark.parametrize(("first", "stop"), [(0, 30), (BINS - 30, BINS)])
def test_an_echo_at_the_window_s_end_stays_inside_the_window(device, first, stop):
    got = detect(device, surface_echo((first, stop, 1.0)), clearance=1.0)
    assert found(got) == 1
    begin, end = EDGES["uniform"][[first, stop]]
    # Replicated at the end, the smoothing takes nothing away and adds nothing there.
    np.testing.assert_allclose(got[0, 0], begin + np.array([0.1, 0.5, 0.9]) * (end - begin), atol=0.2 * WIDTH)


# --- How many, in which order ---


def test_footprints_come_nearest_first_whichever_is_stronger(device):
    for strengths in ((1.0, 0.2, 0.5), (0.2, 0.5, 1.0)):
        echo = surface_echo(*zip((40, 150, 300), (60, 170, 320), strengths, strict=True))
        got = detect(device, echo, clearance=1.0)
        assert found(got) == 3
        np.testing.assert_allclose(got[0, :, 1], EDGES["uniform"][[50, 160, 310]], atol=smoothing_shift(2.0))
        assert np.all(np.diff(got[0].ravel()) > 0)


@pytest.mark.parametrize("slots", [0, 1, 2, 3, 5])
def test_more_returns_than_slots_leave_out_the_farthest(device, slots):
    echo = surface_echo((40, 60, 1.0), (150, 170, 1.0), (300, 320, 1.0))
    got = detect(device, echo, footprints=slots)
    assert found(got) == min(slots, 3)
    assert np.array_equal(got[0, :3], detect(device, echo)[0, :slots])


# With a threshold at half the level, a hole of n >= 2 bins in a box leaves n bins under it.
@pytest.mark.parametrize(
    ("gap", "hole", "count"),
    [(0, 0, 1), (0, 2, 2), (1, 2, 2), (2, 2, 1), (2, 3, 2), (3, 3, 1), (3, 4, 2), (40, 40, 1), (40, 41, 2)],
)
def test_a_gap_is_bridged_up_to_its_number_of_bins(device, gap, hole, count):
    echo = surface_echo((200, 240, 1.0), (240 + hole, 320, 1.0))
    assert found(detect(device, echo, relative=0.5, clearance=0.0, gap=gap)) == count


def test_a_gap_holds_a_speckled_echo_together(device):
    echo = surface_echo((200, 260, 1.0)) * rayleigh(np.random.default_rng(6), (300, BINS))
    broken = [np.mean(found(detect(device, echo, relative=0.3, gap=gap)) > 1) for gap in (0, 3)]
    assert broken[0] > 1 / 3
    assert broken[1] < 1 / 20


# --- The whole of it ---


def random_profiles(rng, pings):
    """Up to five surfaces of any strength and length, speckled, over none to plenty of background."""
    echo = np.zeros((pings, BINS))
    for ping in range(pings):
        for _ in range(rng.integers(6)):
            first = rng.integers(BINS)
            echo[ping] += surface_echo((first, first + rng.integers(1, 60), 10 ** rng.uniform(-2, 1)))
    return echo * rayleigh(rng, echo.shape) + 10 ** rng.uniform(-4, -1, (pings, 1)) * rayleigh(rng, echo.shape)


@pytest.mark.parametrize("edges", EDGES)
def test_random_profiles_match_the_oracle(device, edges):
    rng = np.random.default_rng(7)
    echo = random_profiles(rng, 100).astype(np.float32)
    range_edge = EDGES[edges].astype(np.float32)
    settings = {"relative": 0.1, "clearance": 2.5, "gap": 2}
    got = detect(device, echo, range_edge, **settings)
    want = np.array([reference.footprints(row, range_edge, make_detector(**settings), 3) for row in echo])
    assert set(found(got)) == {0, 1, 2, 3}
    assert np.array_equal(got == profile.NO_FOOTPRINT, want == profile.NO_FOOTPRINT)
    # Sums of some hundred terms, then a share of a bin.
    np.testing.assert_allclose(got, want, atol=400 * EPSILON)


@pytest.mark.parametrize("threads", [2, 5])
def test_threads_change_nothing(device, threads):
    echo = random_profiles(np.random.default_rng(8), 37)
    assert np.array_equal(detect(device, echo, threads=threads), detect(device, echo))


@pytest.mark.parametrize(
    ("wrong", "shape", "dtype", "message"),
    [
        ("range_edge", (9,), float, r"range_edge: expected shape \(11,\), got \(9,\)"),
        ("echo", (10,), float, r"echo: expected shape \(any, any\), got \(10,\)"),
        ("echo", (4, 10), int, "echo: expected dtype float32, got int32"),
        ("footprint_out", (3, 2), wp.vec3, r"footprint_out: expected shape \(4, any\), got \(3, 2\)"),
        ("footprint_out", (4, 2), float, "footprint_out: expected dtype vec3f, got float32"),
    ],
)
def test_wrong_arrays_are_refused_by_name(device, wrong, shape, dtype, message):
    arrays = {
        "range_edge": wp.zeros(11, dtype=float, device=device),
        "echo": wp.zeros((4, 10), dtype=float, device=device),
        "footprint_out": wp.zeros((4, 2), dtype=wp.vec3, device=device),
    }
    arrays[wrong] = wp.zeros(shape, dtype=dtype, device=device)
    with pytest.raises(ValueError, match=message):
        profile.detect_profile(detector=make_detector(), **arrays, device=device)


@pytest.mark.parametrize(("name", "value"), [("relative", -0.1), ("clearance", float("nan")), ("gap", -1)])
def test_a_detector_out_of_bounds_is_refused_by_name(device, name, value):
    with pytest.raises(ValueError, match=rf"detector\.{name}: must be at least 0, got {value}"):
        detect(device, np.zeros(BINS), **{name: value})
