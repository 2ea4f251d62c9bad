"""Critical points: where the seabed begins, what counts as an edge, and how exactly its range is read."""

from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp

from sonarwarp_kernels import critical, noise, roi
from sonarwarp_kernels.specs import Fan
from tests.reference import critical as reference
from tests.reference.geometry import quaternion, sonar_rotation

EPSILON = float(np.finfo(np.float32).eps)

BINS = 128
EDGES = {
    "uniform": np.linspace(0.42, 1.70, BINS + 1),
    "widening": np.geomspace(0.42, 5.0, BINS + 1),
    "irregular": 0.5 + np.cumsum(np.random.default_rng(3).uniform(0.002, 0.02, BINS + 1)),
}
SEARCHES = {"strongest": critical.find_critical_points, "nearest": critical.find_nearest_critical_points}
FAR = 1e6


def make_settings(**changed):
    settings = critical.CriticalFilter()
    values = {"guard": 2, "sigma": 1.0, "floor": 1e-4, "deviations": 5.0, "memory": 64.0, **changed}
    for name, value in values.items():
        setattr(settings, name, value)
    return settings


def search(device, image, range_edge, r_emin=FAR, which="strongest", threads=1, **changed):
    """Ranges, strengths and bins of all beams of ``image`` [frame, beam, bin]."""
    image = wp.array(np.asarray(image, dtype=np.float32), dtype=float, device=device)
    shape = image.shape[:2]
    r_emin = wp.array(np.broadcast_to(np.float32(r_emin), shape).copy(), dtype=float, device=device)
    edge = wp.array(range_edge, dtype=float, device=device)
    ranges, strengths = (wp.full(shape, 7.0, dtype=float, device=device) for _ in range(2))
    bins = wp.full(shape, 7, dtype=int, device=device)
    SEARCHES[which](
        make_settings(**changed), edge, image, r_emin, ranges, strengths, bins, device=device, threads=threads
    )
    return SimpleNamespace(range=ranges.numpy(), strength=strengths.numpy(), bin=bins.numpy())


def step(*edges, bins=BINS):
    """One beam with an echo of given amplitude from each bin on."""
    amplitude = np.zeros((1, 1, bins))
    for first, rise in edges:
        amplitude[..., first:] += rise
    return amplitude


def make_fan(device, azimuth, elevation_min, cone):
    fan = Fan()
    fan.azimuth = wp.array(azimuth, dtype=float, device=device)
    fan.elevation_min = elevation_min
    fan.cone = cone
    return fan


def seabed_range(device, attitudes, altitude, azimuth, elevation_min, cone=0, threads=1):
    poses = [[3.0, -2.0, 50.0, *quaternion(sonar_rotation(*attitude))] for attitude in attitudes]
    out = wp.zeros((len(poses), len(azimuth)), dtype=float, device=device)
    roi.seabed_range(
        make_fan(device, azimuth, elevation_min, cone),
        wp.array(poses, dtype=wp.transform, device=device),
        wp.array(altitude, dtype=float, device=device),
        out,
        device=device,
        threads=threads,
    )
    return out.numpy()


# --- Where the seabed begins (Eq. 5) ---


@pytest.mark.parametrize("pitch_deg", [0, 5])
@pytest.mark.parametrize("tilt_deg", [25, 30, 40, 80])
def test_on_the_middle_beam_the_printed_formula_holds(device, tilt_deg, pitch_deg):
    tilt, half = np.radians(tilt_deg + pitch_deg), np.radians(7.0)
    got = seabed_range(device, [(0.0, tilt, 0.7)], [3.5], [0.0], -half)
    assert got[0, 0] == pytest.approx(3.5 / np.sin(tilt + half), rel=8 * EPSILON)


@pytest.mark.parametrize("cone", [0, 1])
def test_any_attitude_matches_the_plane_below(device, cone):
    rng = np.random.default_rng(5)
    attitudes = rng.uniform([-3, -1.5, -3], [3, 1.5, 3], (40, 3))
    altitude = rng.uniform(0.5, 20.0, 40)
    azimuth = np.radians(np.linspace(-60, 60, 13))
    got = seabed_range(device, attitudes, altitude, azimuth, -0.2, cone)
    want = np.array(
        [
            [reference.seabed_range(sonar_rotation(*attitude), height, beam, -0.2, bool(cone)) for beam in azimuth]
            for attitude, height in zip(attitudes, altitude, strict=True)
        ]
    )
    assert 100 < np.isinf(want).sum() < 400
    # A direction's descent carries an absolute error of a few epsilon, so the relative error grows with the range.
    descent = altitude[:, None] / want
    assert np.array_equal(np.isinf(got), np.isinf(want))
    assert np.all(np.abs(altitude[:, None] / got - descent) < 8 * EPSILON)


def test_the_altitude_is_measured_from_the_sonar_wherever_it_is(device):
    got = seabed_range(device, [(0.0, 0.5, 0.0)] * 2, [2.0, 4.0], [0.0], -0.1)
    assert got[1, 0] == pytest.approx(2 * got[0, 0], rel=2 * EPSILON)


def test_a_sonar_rolled_to_port_side_up_sees_the_seabed_farther_to_port(device):
    got = seabed_range(device, [(0.1, 0.6, 0.0), (0.0, 0.6, 0.0)], [2.0, 2.0], [-0.2, 0.0, 0.2], -0.1)
    assert got[0, 0] < got[0, 1] < got[0, 2]
    assert got[1, 0] == pytest.approx(got[1, 2], rel=4 * EPSILON)
    # Level, the outer beams look less steeply down.
    assert got[1, 1] < got[1, 0]


def test_a_beam_that_looks_up_never_meets_the_seabed(device):
    got = seabed_range(device, [(0.0, -0.2, 0.0), (0.0, 0.0, 0.0)], [2.0, 2.0], [0.0], 0.0)
    assert np.all(np.isinf(got))


# --- The region of interest (Eq. 5-6) ---


@wp.kernel
def roi_kernel(
    range_edge: wp.array(dtype=float),
    r_emin: wp.array(dtype=float),
    guard: wp.array(dtype=int),
    bins_out: wp.array(dtype=int),
):
    i = wp.tid()
    bins_out[i] = roi.roi_bins(range_edge, r_emin[i], guard[i])


def roi_bins(device, range_edge, r_emin, guard):
    out = wp.zeros(len(r_emin), dtype=int, device=device)
    arrays = [
        wp.array(range_edge, dtype=float, device=device),
        wp.array(r_emin, dtype=float, device=device),
        wp.array(guard, dtype=int, device=device),
    ]
    wp.launch(roi_kernel, len(r_emin), inputs=arrays, outputs=[out], device=device)
    return out.numpy()


@pytest.mark.parametrize(
    ("where", "r_emin", "guard", "bins"),
    [
        ("before the window", 0.9, 0, 0),
        ("at the window's start", 1.0, 0, 1),
        ("below the middle of a bin", 1.34, 0, 4),
        ("above the middle of a bin", 1.36, 0, 5),
        ("with a guard", 1.36, 2, 3),
        ("with a guard wider than what lies ahead", 1.36, 9, 0),
        ("at the window's end", 2.0, 0, 10),
        ("at the window's end, with a guard", 2.0, 2, 9),
        ("beyond the window, the guard still inside", 2.11, 4, 8),
        ("far beyond the window", 1e30, 4, 10),
        ("nowhere", np.inf, 4, 10),
    ],
)
def test_the_roi_ends_at_the_nearest_edge_less_the_guard(device, where, r_emin, guard, bins):
    edge = np.linspace(1.0, 2.0, 11)
    assert roi_bins(device, edge, [r_emin], [guard])[0] == bins
    assert reference.roi_bins(edge, r_emin, guard) == bins


def test_two_bins_of_guard_leave_no_seabed_in_the_roi(device):
    edge = EDGES["irregular"].astype(np.float32)
    r_emin = np.random.default_rng(8).uniform(edge[3], edge[-1], 2000).astype(np.float32)
    bins = roi_bins(device, edge, r_emin, [2] * 2000)
    assert np.all(edge[bins] <= r_emin)


@pytest.mark.parametrize("name", EDGES)
def test_the_roi_matches_the_oracle(device, name):
    edge = EDGES[name].astype(np.float32)
    rng = np.random.default_rng(4)
    # Away from half-way points, where float32 and float64 may differ: positions at quarters of bins.
    index, quarter = rng.integers(0, BINS, 500), rng.choice([0.1, 0.25, 0.75, 0.9], 500)
    r_emin = (edge[index] + quarter * np.diff(edge)[index]).astype(np.float32)
    guard = rng.integers(0, 6, 500)
    want = [reference.roi_bins(edge, float(r), int(g)) for r, g in zip(r_emin, guard, strict=True)]
    assert np.array_equal(roi_bins(device, edge, r_emin, guard), want)


# --- The range of a step (Eq. 29-30) ---


@pytest.mark.parametrize("which", SEARCHES)
@pytest.mark.parametrize("sigma", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("name", EDGES)
def test_a_step_is_read_where_it_stands_inside_a_bin(device, name, sigma, which):
    edge = EDGES[name].astype(np.float32).astype(np.float64)
    filled = np.linspace(0.0, 1.0, 41)
    first = 60
    image = np.repeat(step((first + 1, 0.3)), len(filled), axis=1)
    image[0, :, first] = 0.3 * filled
    got = search(device, image, edge, which=which, sigma=sigma)
    truth = edge[first + 1] - filled * (edge[first + 1] - edge[first])
    # A fractional bin near 60 is held to 4e-6 bins, a range to its own last bits; the filter's sums add a few epsilon.
    tolerance = 8 * EPSILON * (edge[first + 1] + 60 * np.diff(edge)[first])
    assert np.max(np.abs(got.range[0] - truth)) < tolerance


def test_the_printed_range_of_a_step_is_a_bin_short(device):
    edge = EDGES["uniform"]
    got = search(device, step((60, 1.0)), edge)
    printed = edge[0] + (edge[-1] - edge[0]) * got.bin[0, 0] / BINS
    assert printed == pytest.approx(edge[59])
    assert got.range[0, 0] == pytest.approx(edge[60], rel=4 * EPSILON)


def test_the_strength_is_the_derivative_of_the_smoothed_step(device):
    taps = np.exp(-(np.arange(-2, 3) ** 2) / 2)
    taps /= taps.sum()
    # Smoothed, the step has risen by taps 0, 1 and 2 at its first bin and by the outermost tap two bins before.
    got = search(device, step((60, 0.7)), EDGES["uniform"])
    assert got.strength[0, 0] == pytest.approx(0.7 * (taps[2:].sum() - taps[4]), rel=4 * EPSILON)


# --- What counts as an edge, without noise ---


@pytest.mark.parametrize("which", SEARCHES)
@pytest.mark.parametrize(
    ("what", "edges", "r_emin_bin", "found"),
    [
        ("an object", [(60, 0.1)], None, 60),
        ("an object in a bright sea", [(0, 5.0), (60, 30.0)], None, 60),
        ("nothing", [], None, None),
        ("an even echo from the window's start on", [(0, 1.0)], None, None),
        ("an echo that only falls", [(0, 1.0), (60, -1.0)], None, None),
        ("crumbs below the floor", [(60, 1e-4)], None, None),
        ("the nearest edge that can be seen", [(5, 0.1)], None, 5),
        ("an edge too near the window's start", [(3, 0.1)], None, None),
        ("the farthest edge that can be seen", [(BINS - 5, 0.1)], None, BINS - 5),
        ("an edge too near the window's end", [(BINS - 3, 0.1)], None, None),
        ("the farthest edge in the ROI", [(93, 0.1)], 100, 93),
        ("an edge too near the ROI's end", [(96, 0.1)], 100, None),
        ("the seabed only", [(100, 3.0)], 100, None),
        ("the seabed, a little before its time", [(97, 3.0)], 100, None),
        ("an object ahead of the seabed", [(60, 0.1), (100, 3.0)], 100, 60),
        ("an object ahead of a seabed before its time", [(60, 0.1), (97, 3.0)], 100, 60),
        ("an object behind the ROI", [(60, 0.1)], 40, None),
        ("a ROI of no bins", [(60, 0.1)], -5, None),
        ("a ROI too short for the filter", [(5, 0.1)], 9, None),
    ],
)
def test_what_is_found(device, which, what, edges, r_emin_bin, found):
    edge = EDGES["uniform"]
    width = edge[1] - edge[0]
    r_emin = FAR if r_emin_bin is None else edge[0] + width * r_emin_bin
    got = search(device, step(*edges), edge, r_emin, which)
    if found is None:
        assert (got.range[0, 0], got.strength[0, 0], got.bin[0, 0]) == (critical.NO_DETECTION, 0.0, critical.NO_BIN)
    else:
        assert got.range[0, 0] == pytest.approx(edge[found], rel=4 * EPSILON)
        assert got.bin[0, 0] == found - 1
        assert got.strength[0, 0] > 0.0


def test_the_shortest_images_are_searched_without_harm(device):
    for bins in range(1, 12):
        image = step((bins // 2 + 1, 1.0), bins=bins)
        got = search(device, image, np.linspace(1.0, 2.0, bins + 1))
        assert (got.bin[0, 0] == critical.NO_BIN) == (bins < 9), bins


def test_the_strongest_and_the_nearest_of_several_edges(device):
    edge = EDGES["uniform"]
    image = step((30, 0.2), (50, -0.2), (70, 0.5), (90, 0.3))
    assert search(device, image, edge).range[0, 0] == pytest.approx(edge[70], rel=4 * EPSILON)
    assert search(device, image, edge, which="nearest").range[0, 0] == pytest.approx(edge[30], rel=4 * EPSILON)


def test_the_background_is_forgotten(device):
    # A bright stretch near the sonar hides a faint edge until it has left the mean.
    edge = EDGES["uniform"]
    image = step((0, 1.0), (20, -1.0), (110, 0.02))
    assert search(device, image, edge, memory=1000.0).bin[0, 0] == critical.NO_BIN
    assert search(device, image, edge, memory=8.0).range[0, 0] == pytest.approx(edge[110], rel=4 * EPSILON)


# --- Detection in noise ---


def rayleigh(rng, mean, shape):
    return rng.rayleigh(mean * np.sqrt(2 / np.pi), shape)


@pytest.mark.parametrize("which", SEARCHES)
@pytest.mark.parametrize("name", EDGES)
@pytest.mark.parametrize("changed", [{}, {"sigma": 0.6, "memory": 16.0, "deviations": 3.0}, {"floor": 0.6, "guard": 5}])
def test_noisy_images_match_the_oracle(device, name, which, changed):
    rng = np.random.default_rng(11)
    edge = EDGES[name].astype(np.float32)
    image = rayleigh(rng, 0.2, (2, 60, BINS))
    image[1] += step((70, 1.0))[0] * rayleigh(rng, 1.0, (60, BINS))
    image = image.astype(np.float32)
    r_emin = rng.uniform(edge[40], 1.1 * edge[-1], (2, 60)).astype(np.float32)
    got = search(device, image, edge, r_emin, which, **changed)
    settings = make_settings(**changed)
    found = 0
    for place in np.ndindex(2, 60):
        want = reference.critical_point(image[place], edge, float(r_emin[place]), settings, which == "nearest")
        assert got.bin[place] == want[2]
        if want[2] < 0:
            assert (got.range[place], got.strength[place]) == (critical.NO_DETECTION, 0.0)
            continue
        found += 1
        assert got.strength[place] == pytest.approx(want[1], rel=16 * EPSILON)
        # A flat top places its vertex less exactly: by the rounding of its values over their curvature.
        top = reference.derivative(image[place], settings.sigma)[want[2] - 1 : want[2] + 2]
        doubt = 8 * EPSILON * (image[place].max() / abs(np.diff(top, 2)[0]) + BINS) * np.diff(edge).max()
        assert abs(got.range[place] - want[0]) < doubt + 2 * EPSILON * edge[-1]
    assert 20 < found < 120


def background(device, level, frames, seed):
    """Images of the sonar's own noise, 96 beams x 512 bins."""
    keys = np.random.default_rng(seed).integers(0, 2**63, frames).astype(np.uint64)
    image = wp.zeros((frames, 96, 512), dtype=float, device=device)
    noise.finish_images(
        wp.zeros((frames, 96, 512), dtype=int, device=device),
        1.0,
        wp.array(keys, dtype=wp.uint64, device=device),
        wp.zeros(frames, dtype=int, device=device),
        wp.zeros((frames, 2), dtype=wp.uint64, device=device),
        wp.zeros(frames, dtype=float, device=device),
        wp.full(frames, level, dtype=float, device=device),
        image,
        device=device,
    )
    return image.numpy()


@pytest.mark.parametrize("level", [1e-3, 10.0])
def test_background_alone_is_hardly_ever_taken_for_an_object(device, level):
    image = background(device, level, 100, 1)
    edge = np.linspace(0.42, 5.42, 513)
    alarms = np.sum(search(device, image, edge, floor=0.0).bin >= 0)
    # 4e-5 of 768,000 beams were measured: the chance of more than five in 9,600 is 4e-6.
    assert alarms <= 5


def test_false_alarms_do_not_gather_at_the_window_start(device):
    # A low threshold gives alarms to count; the mean rests on few bins there and is often too low.
    image = background(device, 1.0, 100, 2)
    found = search(device, image, np.linspace(0.42, 5.42, 513), which="nearest", deviations=3.5).bin
    alarms = found[found >= 0]
    assert len(alarms) > 100
    assert np.mean(alarms < 64) < 0.125 + 4 * np.sqrt(0.125 * 0.875 / len(alarms))


@pytest.mark.parametrize(
    ("contrast_db", "speckled", "least"),
    [(9, False, 0.65), (12, False, 0.99), (12, True, 0.94), (15, True, 0.99), (25, True, 0.999)],
)
def test_an_object_is_detected_at(device, contrast_db, speckled, least):
    # Measured over 19,200 beams: 0.70, 0.999, 0.97, 0.999 and 1; 4,800 here leave a standard error under 0.007.
    image = background(device, 0.05, 50, 3)
    echo = np.zeros(512)
    echo[300:] = 0.05 * 10 ** (contrast_db / 20)
    image += echo * (rayleigh(np.random.default_rng(6), 1.0, image.shape) if speckled else 1.0)
    edge = np.linspace(0.42, 5.42, 513)
    got = search(device, image, edge, which="nearest")
    assert np.mean(got.bin >= 0) > least


def test_in_speckle_the_nearest_edge_is_the_object_and_the_strongest_often_is_not(device):
    # The seabed's own echo against a background 25 dB below it.
    echo = np.zeros(512)
    echo[300:] = 0.05 * 10 ** (25 / 20)
    image = background(device, 0.05, 50, 4) + echo * rayleigh(np.random.default_rng(7), 1.0, (50, 96, 512))
    edge = np.linspace(0.42, 5.42, 513)
    error = {which: (search(device, image, edge, which=which).range - edge[300]) / (5.0 / 512) for which in SEARCHES}
    near = {which: np.abs(error[which]) <= 3 for which in SEARCHES}
    assert np.mean(near["nearest"]) > 0.99
    assert 0.6 < np.mean(near["strongest"]) < 0.72
    assert np.std(error["nearest"][near["nearest"]]) < 0.65


# --- The contract ---


def test_any_number_of_threads_and_any_batch_give_the_same(device):
    image = np.random.default_rng(9).rayleigh(1.0, (5, 7, BINS))
    image += step((60, 4.0))
    attitudes = [(0.1 * frame, 0.3, 0.0) for frame in range(5)]
    edge = EDGES["widening"]
    for which in SEARCHES:
        serial = search(device, image, edge, 3.0, which)
        threaded = search(device, image, edge, 3.0, which, threads=3)
        alone = search(device, image[3:4, 2:3], edge, 3.0, which)
        for name in ("range", "strength", "bin"):
            assert np.array_equal(getattr(serial, name), getattr(threaded, name))
            assert getattr(serial, name)[3, 2] == getattr(alone, name)[0, 0]
        assert np.sum(serial.bin >= 0) > 10
    serial = seabed_range(device, attitudes, np.ones(5), [0.0, 0.1], -0.1)
    assert np.array_equal(serial, seabed_range(device, attitudes, np.ones(5), [0.0, 0.1], -0.1, threads=3))


@pytest.mark.parametrize("which", SEARCHES)
@pytest.mark.parametrize(
    ("wrong", "shape", "dtype", "message"),
    [
        ("image", (4, 512, 96), float, r"range_edge: expected shape \(97,\), got \(513,\)"),
        ("image", (96, 512), float, r"image: expected shape \(any, any, any\), got \(96, 512\)"),
        ("range_edge", (512,), float, r"range_edge: expected shape \(513,\), got \(512,\)"),
        ("r_emin", (96, 4), float, r"r_emin: expected shape \(4, 96\), got \(96, 4\)"),
        ("critical_range_out", (4,), float, r"critical_range_out: expected shape \(4, 96\), got \(4,\)"),
        ("critical_strength_out", (4, 96), int, "critical_strength_out: expected dtype float32, got int32"),
        ("critical_bin_out", (4, 96), float, "critical_bin_out: expected dtype int32, got float32"),
    ],
)
def test_wrong_arrays_are_refused_by_name(device, which, wrong, shape, dtype, message):
    arrays = {
        "range_edge": wp.zeros(513, dtype=float, device=device),
        "image": wp.zeros((4, 96, 512), dtype=float, device=device),
        "r_emin": wp.zeros((4, 96), dtype=float, device=device),
        "critical_range_out": wp.zeros((4, 96), dtype=float, device=device),
        "critical_strength_out": wp.zeros((4, 96), dtype=float, device=device),
        "critical_bin_out": wp.zeros((4, 96), dtype=int, device=device),
    }
    arrays[wrong] = wp.zeros(shape, dtype=dtype, device=device)
    with pytest.raises(ValueError, match=message):
        SEARCHES[which](make_settings(), **arrays, device=device)


@pytest.mark.parametrize(
    ("name", "value"),
    [("guard", -1), ("sigma", 0.0), ("sigma", float("nan")), ("floor", -1.0), ("deviations", -1.0), ("memory", 0.5)],
)
def test_settings_out_of_bounds_are_refused_by_name(device, name, value):
    with pytest.raises(ValueError, match=rf"settings\.{name}: must be at least .*, got {value}"):
        search(device, step((60, 1.0)), EDGES["uniform"], **{name: value})


@pytest.mark.parametrize(
    ("wrong", "shape", "dtype", "message"),
    [
        ("world_from_sensor", (4,), wp.vec3, "world_from_sensor: expected dtype transform"),
        ("altitude", (3,), float, r"altitude: expected shape \(4,\), got \(3,\)"),
        ("r_emin_out", (2, 4), float, r"r_emin_out: expected shape \(4, 2\), got \(2, 4\)"),
    ],
)
def test_wrong_poses_are_refused_by_name(device, wrong, shape, dtype, message):
    arrays = {
        "world_from_sensor": wp.zeros(4, dtype=wp.transform, device=device),
        "altitude": wp.zeros(4, dtype=float, device=device),
        "r_emin_out": wp.zeros((4, 2), dtype=float, device=device),
    }
    arrays[wrong] = wp.zeros(shape, dtype=dtype, device=device)
    with pytest.raises(ValueError, match=message):
        roi.seabed_range(make_fan(device, [0.0, 0.1], -0.1, 0), **arrays, device=device)


@pytest.mark.parametrize("width", [0.3, 1.0, 1.6])
@pytest.mark.parametrize("start", [100.0, 100.35, 100.8])
def test_a_short_echo_is_not_read_before_it_begins(device, start, width):
    """A face met at right angles returns within a bin or two; its range lies within the bin where that begins."""
    edges = np.arange(0.0, 200.0)
    share = np.clip(np.minimum(edges[1:], start + width) - np.maximum(edges[:-1], start), 0.0, None)
    got = search(device, share[None, None, :].astype(np.float32), edges + 1.0)
    assert int(start) <= got.range[0, 0] - 1.0 <= int(start) + 1.0
