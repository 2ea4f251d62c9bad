"""Metrics give a known cloud its known figures, whatever its density, its strays and the order of its points."""

import dataclasses
import math

import numpy as np
import pytest

from sonarwarp.metrics import (
    ObjectTruth,
    SonarView,
    evaluate_section,
    evaluate_surface,
    sample_surface,
    visible_samples,
)
from sonarwarp.sonar import FLS, PS

BEAM_SPACING = 0.021
BRICK_SPACING = 0.017


def run_of(height, slope_deg):
    """How far along x a slope takes to rise by ``height``."""
    return height * math.tan(math.radians(90.0 - slope_deg))


def known(slope_deg, width, height, depth, front_x=9.0, centre_y=0.0):
    area = height * (depth - 0.5 * run_of(height, slope_deg))
    return ObjectTruth(
        name=f"{slope_deg:g} degrees",
        front_x=front_x,
        centre_y=centre_y,
        width=width,
        height=height,
        depth=depth,
        front_slope_deg=slope_deg,
        sectional_area=area,
        volume=area * width,
    )


def brick(**place):
    return known(90.0, 0.19, 0.39, 0.15, **place)


def wedge(slope_deg, **place):
    return known(slope_deg, 0.5, 1.0, 3.0, **place)


def placed(truth, x, y, z):
    return np.stack([x + truth.front_x, y + truth.centre_y, z], axis=1)


def dense_cloud(truth, count=60000, seed=1):
    """Points uniform by area over the front and the top, without error."""
    random = np.random.default_rng(seed)
    run = run_of(truth.height, truth.front_slope_deg)
    front = math.hypot(run, truth.height)
    along = random.random(count) * (front + truth.depth - run)
    y = (random.random(count) - 0.5) * truth.width
    part = np.minimum(along / front, 1.0)
    return placed(truth, run * part + np.maximum(along - front, 0.0), y, truth.height * part)


def sonar_cloud(truth, step, spacing, ramp_deg, phase=(0.5, 0.5), noise=0.0, seed=1):
    """What a sonar leaves: one point per frame and beam, from the ramp's foot over the level top to the back.

    The ramp ends where the true top begins. ``phase``: where frames and beams fall, in steps; ``noise``: standard
    deviation of the height [m].
    """
    corner = run_of(truth.height, truth.front_slope_deg)
    foot = corner - run_of(truth.height, ramp_deg)
    x = foot + (np.arange(-1, math.ceil((truth.depth - foot) / step) + 1) + phase[0]) * step
    y = -0.5 * truth.width + (np.arange(-1, math.ceil(truth.width / spacing) + 1) + phase[1]) * spacing
    x, y = x[(x >= foot) & (x <= truth.depth)], y[np.abs(y) <= 0.5 * truth.width]
    x, y = (axis.ravel() for axis in np.meshgrid(x, y))
    z = truth.height + np.minimum(x - corner, 0.0) / max(run_of(1.0, ramp_deg), 1e-12)
    return placed(truth, x, y, z + np.random.default_rng(seed).normal(0.0, noise, len(x)))


def face_cloud(truth, spacing, seed=2):
    """The vertical front as a profiling sonar would leave it."""
    y = np.arange(-0.5 * truth.width + 0.5 * spacing, 0.5 * truth.width, spacing)
    z = np.arange(0.5 * spacing, truth.height, spacing)
    y, z = (axis.ravel() for axis in np.meshgrid(y, z))
    return placed(truth, 0.0 * y, y, z)


def evaluate(cloud, truth, spacing):
    (metrics,) = evaluate_section(cloud, [truth], slab_width=spacing)
    return metrics


@pytest.mark.parametrize(
    ("truth", "spacing"),
    [(wedge(slope), BEAM_SPACING) for slope in (20.0, 30.0, 45.0, 60.0, 75.0, 80.0, 85.0, 88.0, 90.0)]
    + [(brick(), BRICK_SPACING)]
    # Steep and shallow, and a depth that no bin divides: where edges and corners weigh most.
    + [(known(slope, 0.2, 0.39, 0.147), BRICK_SPACING) for slope in (75.0, 80.0, 88.0)],
    ids=lambda value: f"{value.depth:g} m deep {value.name}" if isinstance(value, ObjectTruth) else "",
)
def test_a_perfect_dense_cloud_has_the_true_figures(truth, spacing):
    metrics = evaluate(dense_cloud(truth), truth, spacing)
    assert metrics.slope_deg == pytest.approx(truth.front_slope_deg, abs=0.5)
    assert metrics.front_coverage == 1.0
    assert metrics.area == pytest.approx(truth.sectional_area, rel=0.01)
    assert metrics.volume == pytest.approx(truth.volume, rel=0.02)


@pytest.mark.parametrize("step", [0.005, 0.01])
@pytest.mark.parametrize("spacing", [0.017, 0.021, 0.025])
@pytest.mark.parametrize("truth", [brick(), wedge(60.0), wedge(30.0)], ids=lambda truth: truth.name)
def test_at_the_sonar_s_density_one_sample_spacing_per_open_edge_is_allowed(truth, step, spacing):
    # The slope's foot lies on the seabed: nothing is open there. A vertical front that only the top shows is open.
    ends = 2 if truth.front_slope_deg == 90.0 else 1
    widths = []
    for phase in np.random.default_rng(5).random((12, 2)):
        metrics = evaluate(sonar_cloud(truth, step, spacing, truth.front_slope_deg, phase), truth, spacing)
        assert metrics.area == pytest.approx(truth.sectional_area, rel=0.01, abs=ends * step * truth.height)
        assert metrics.volume == pytest.approx(
            truth.volume,
            rel=0.02,
            abs=ends * step * truth.height * truth.width + 2 * spacing * truth.sectional_area,
        )
        widths.append(metrics.volume / metrics.area)
        if truth.front_slope_deg < 90.0:
            assert metrics.slope_deg == pytest.approx(truth.front_slope_deg, abs=0.5)
    # Whatever is gained or lost at an edge by where beams fall, it is not lost on average: 12 draws of less than one
    # spacing either way leave a standard error of a sixth of a spacing.
    assert np.mean(widths) == pytest.approx(truth.width, abs=0.5 * spacing)


@pytest.mark.parametrize("offset", [0.0, 0.3, 0.5, 0.9])
def test_beams_off_the_slabs_edges_do_not_bias_the_volume(offset):
    # Exactly 24 beams, 2 cm apart, that cover 48 cm, shifted against the slabs.
    truth = dataclasses.replace(wedge(45.0), width=0.48, volume=0.48 * wedge(45.0).sectional_area)
    cloud = sonar_cloud(truth, 0.01, 0.02, 45.0) + np.array([0.0, offset * 0.02, 0.0])
    assert evaluate(cloud, truth, 0.02).volume == pytest.approx(truth.volume, rel=0.005)


@pytest.mark.parametrize("step", [0.005, 0.01])
@pytest.mark.parametrize("noise", [0.0, 0.005])
def test_a_false_ramp_counts_in_full(step, noise):
    # A single sonar sees the brick's front as a ramp of 62 degrees that begins 0.207 m before it.
    truth = brick()
    false_area = 0.39 * (0.15 + 0.5 * run_of(0.39, 62.0))
    metrics = evaluate(sonar_cloud(truth, step, BRICK_SPACING, 62.0, noise=noise), truth, BRICK_SPACING)
    assert metrics.slope_deg == pytest.approx(62.0, abs=0.5)
    assert metrics.slope_error == pytest.approx(28.0 / 90.0, abs=0.5 / 90.0)
    assert metrics.front_coverage == 1.0
    assert metrics.area == pytest.approx(false_area, rel=0.01, abs=step * 0.39)
    assert metrics.area_error == pytest.approx(metrics.area / truth.sectional_area - 1.0)
    beams = 2 * BRICK_SPACING * false_area
    assert metrics.volume == pytest.approx(false_area * 0.19, rel=0.02, abs=step * 0.39 * 0.19 + beams)
    assert metrics.volume_error == pytest.approx(metrics.volume / truth.volume - 1.0)


def test_beams_that_spread_with_range_leave_the_false_ramp_its_figures():
    # Seen from 1.8 m at a fixed depression of 25 degrees: y is distance times tan(azimuth), a frame's step moves the
    # contact a fifth as far on the ramp as on the top, and beams are 1.7 cm apart at the top and 2 cm at the foot.
    truth = brick()
    random = np.random.default_rng(6)
    drop, rise = math.tan(math.radians(25.0)), math.tan(math.radians(62.0))
    across = np.tan(np.radians(np.arange(-14.5, 14.5, 29 / 96)))
    foot, areas, volumes = -0.39 / rise, [], []
    for _ in range(20):
        vehicle = foot - 5.0 + 0.01 * (np.arange(600) + random.random())
        ahead = (1.8 - (vehicle - foot) * rise) / (rise + drop)
        ahead = np.where(vehicle + ahead < 0.0, ahead, (1.8 - 0.39) / drop)
        x, y = vehicle[:, None] + 0.0 * across, ahead[:, None] * (across + 0.005 * random.random())
        x, z = x + ahead[:, None], (1.8 - ahead * drop)[:, None] + 0.0 * across
        met = (x >= foot) & (x <= truth.depth) & (np.abs(y) <= 0.5 * truth.width)
        metrics = evaluate(placed(truth, x[met], y[met], z[met]), truth, BRICK_SPACING)
        assert metrics.slope_deg == pytest.approx(62.0, abs=0.5)
        areas.append(metrics.area)
        volumes.append(metrics.volume)
    false_area = 0.39 * (0.15 - 0.5 * foot)
    # No bias: the mean of 20 runs, whose steps fall anywhere, stays within a tenth of a frame's step and of a beam.
    assert np.mean(areas) == pytest.approx(false_area, rel=0.0, abs=0.2 * 0.01 * 0.39)
    assert np.mean(volumes) == pytest.approx(
        false_area * 0.19, rel=0.0, abs=0.2 * (0.01 * 0.39 * 0.19 + 0.017 * false_area)
    )


def test_a_scalloped_top_is_no_front():
    # Tops that saw between the height and 15 % less, behind a true vertical face.
    truth = brick()
    top = sonar_cloud(truth, 0.005, BRICK_SPACING, 90.0)
    top[:, 2] -= 0.15 * 0.39 * (np.arange(len(top)) % 3) / 2
    metrics = evaluate(np.concatenate([top, face_cloud(truth, 0.01)]), truth, BRICK_SPACING)
    assert metrics.slope_deg == pytest.approx(90.0, abs=0.5)


@pytest.mark.parametrize("slope", [60.0, 80.0, 90.0])
def test_the_spread_of_a_face_does_not_change_its_slope(slope):
    truth = known(slope, 0.5, 1.0, 1.6)
    slopes = []
    for seed in range(10):
        cloud = dense_cloud(truth, 5000, seed)
        cloud[:, 0] += np.random.default_rng(seed).normal(0.0, 0.02, len(cloud))
        slopes.append(evaluate(cloud, truth, BEAM_SPACING).slope_deg)
    assert np.mean(slopes) == pytest.approx(slope, abs=0.5)


def test_a_cloud_that_stays_low_has_its_own_front():
    truth = brick()
    cloud = sonar_cloud(truth, 0.005, BRICK_SPACING, 62.0) * np.array([1.0, 1.0, 0.87])
    slope = math.degrees(math.atan(0.87 * math.tan(math.radians(62.0))))
    assert evaluate(cloud, truth, BRICK_SPACING).slope_deg == pytest.approx(slope, abs=0.5)


@pytest.mark.parametrize("end", ["front", "back"])
def test_a_face_that_the_cloud_shows_is_a_closed_end(end):
    # The top's last centimetre is missing there: without the face the end is open and half a frame step is added.
    truth = brick()
    top = sonar_cloud(truth, 0.01, BRICK_SPACING, 90.0)
    x = top[:, 0] - truth.front_x
    top = top[(x > 0.01) if end == "front" else (x < 0.14)]
    face = face_cloud(truth, 0.01) + np.array([0.0 if end == "front" else truth.depth, 0.0, 0.0])
    alone, shown = (evaluate(cloud, truth, BRICK_SPACING).area for cloud in (top, np.concatenate([top, face])))
    assert alone == pytest.approx(0.39 * 0.14, rel=0.001)
    assert shown == pytest.approx(0.39 * 0.15, rel=0.01)


def test_a_hole_in_the_top_is_bridged_and_moves_no_end_by_more_than_half_a_step():
    truth = brick()
    cloud = sonar_cloud(truth, 0.005, BRICK_SPACING, 90.0)
    x = cloud[:, 0] - truth.front_x
    metrics = evaluate(cloud[(x < 0.03) | (x > 0.12)], truth, BRICK_SPACING)
    assert metrics.area == pytest.approx(truth.sectional_area, rel=0.001, abs=2 * 0.0025 * 0.39)


@pytest.mark.parametrize("step", [0.001, 0.005])
def test_a_noisy_top_is_not_raised_by_how_densely_it_is_sampled(step):
    truth = brick()
    areas = [
        evaluate(sonar_cloud(truth, step, BRICK_SPACING, 90.0, noise=0.005, seed=seed), truth, BRICK_SPACING).area
        for seed in range(10)
    ]
    assert np.mean(areas) == pytest.approx(truth.sectional_area, rel=0.005)


def test_a_jittering_end_moves_by_less_than_half_its_jitter():
    # Its outermost point of all lies over a deviation outside.
    truth = brick()
    areas = []
    for seed in range(10):
        cloud = sonar_cloud(truth, 0.005, BRICK_SPACING, 90.0)
        cloud[:, 0] += np.random.default_rng(seed).normal(0.0, 0.002, len(cloud))
        areas.append(evaluate(cloud, truth, BRICK_SPACING).area)
    assert np.mean(areas) == pytest.approx(truth.sectional_area, rel=0.0, abs=2 * 0.001 * 0.39)


def test_a_top_alone_has_no_slope():
    metrics = evaluate(sonar_cloud(brick(), 0.01, BRICK_SPACING, 90.0), brick(), BRICK_SPACING)
    assert metrics.slope_deg is None
    assert metrics.slope_error is None
    assert metrics.front_coverage == 0.0
    assert metrics.area_error is not None


def test_a_face_alone_has_its_slope():
    metrics = evaluate(face_cloud(brick(), 0.02), brick(), BRICK_SPACING)
    assert metrics.slope_deg == pytest.approx(90.0)
    assert (metrics.front_coverage, metrics.area_error, metrics.volume_error) == (1.0, None, None)


@pytest.mark.parametrize(("bins", "slope_known"), [(4, False), (5, True)])
def test_a_slope_needs_five_filled_height_bins(bins, slope_known):
    truth = wedge(60.0)
    cloud = dense_cloud(truth)
    cloud = cloud[(cloud[:, 2] > 0.1 + 0.1 * (8 - bins))]
    metrics = evaluate(cloud, truth, BEAM_SPACING)
    assert metrics.front_coverage == bins / 8
    assert (metrics.slope_deg is not None) == slope_known


def test_an_overhanging_front_is_steeper_than_vertical():
    truth = brick()
    face = face_cloud(truth, 0.01)
    face[:, 0] -= run_of(1.0, 80.0) * face[:, 2]
    metrics = evaluate(np.concatenate([face, sonar_cloud(truth, 0.01, BRICK_SPACING, 90.0)]), truth, BRICK_SPACING)
    assert metrics.slope_deg == pytest.approx(100.0, abs=0.5)


STRAYS = {
    "side by side": [(-0.45, 0.01, 0.6), (-0.452, -0.03, 0.5)],
    "far before": [(-0.6, 0.01, 0.3), (-0.5, -0.03, 0.39)],
    "just before, high": [(-0.22, 0.02, 1.0)],
    "above the ramp": [(-0.1, 0.0, 1.1)],
    "above the top": [(0.05, 0.01, 0.9), (0.11, -0.02, 0.6)],
    "behind": [(0.7, 0.0, 0.2), (0.5, 0.03, 0.39)],
    "beside": [(0.05, 0.6, 0.39), (0.05, -0.4, 0.2)],
    "far away": [(30.0, 0.0, 0.5), (-8.0, 0.1, 3.0), (0.1, 9.0, 1.0), (0.1, 0.0, 40.0), (0.1, 0.0, -40.0)],
}


@pytest.mark.parametrize("strays", [*STRAYS, "all"])
@pytest.mark.parametrize(("step", "spacing"), [(0.005, 0.017), (0.01, 0.017), (0.01, 0.025)])
def test_a_few_stray_points_neither_extend_nor_raise(strays, step, spacing):
    truth = brick()
    cloud = sonar_cloud(truth, step, spacing, 62.0)
    places = [place for group in STRAYS.values() for place in group] if strays == "all" else STRAYS[strays]
    without = evaluate(cloud, truth, spacing)
    metrics = evaluate(np.concatenate([cloud, placed(truth, *np.array(places).T)]), truth, spacing)
    # A stray over the object may take part in one median of a bin, and make one cell of the volume at most.
    assert metrics.area == pytest.approx(without.area, rel=0.002)
    assert metrics.volume == pytest.approx(without.volume, rel=0.01)
    assert metrics.slope_deg == pytest.approx(without.slope_deg, abs=1.0)


@pytest.mark.parametrize(
    ("step", "spacing", "strays"),
    [
        (0.01, 0.035, [(-0.3, 0.0, 0.3)]),  # one against three beams of a frame
        (0.005, 0.017, [(-0.3, 0.01, 0.3), (-0.302, -0.03, 0.2)]),  # two against two frames of six beams
    ],
)
def test_strays_do_not_outvote_beams(step, spacing, strays):
    truth = brick()
    cloud = sonar_cloud(truth, step, spacing, 62.0)
    with_strays = np.concatenate([cloud, placed(truth, *np.array(strays).T)])
    without, metrics = (evaluate(points, truth, spacing) for points in (cloud, with_strays))
    assert metrics.area == without.area
    assert metrics.volume == without.volume


@pytest.mark.parametrize(("deviation", "count"), [(0.005, 400000), (0.02, 20000)], ids=["as dense as the top", "rough"])
def test_a_noisy_seabed_round_the_object_is_no_object(deviation, count):
    truth = brick()
    random = np.random.default_rng(3)
    seabed = np.stack([random.uniform(-4, 8, count), random.uniform(-2, 2, count), random.normal(0, deviation, count)])
    cloud = sonar_cloud(truth, 0.005, BRICK_SPACING, 62.0)
    without = evaluate(cloud, truth, BRICK_SPACING)
    metrics = evaluate(np.concatenate([cloud, placed(truth, *seabed)]), truth, BRICK_SPACING)
    assert metrics.slope_deg == pytest.approx(without.slope_deg, abs=0.5)
    assert metrics.area == pytest.approx(without.area, rel=0.005)
    assert metrics.volume == pytest.approx(without.volume, rel=0.005)


def test_points_belong_to_the_object_whose_centre_is_nearest_in_y():
    right, left = wedge(45.0, centre_y=-0.35), wedge(90.0, front_x=10.0, centre_y=0.35)
    clouds = [dense_cloud(right), dense_cloud(left)]
    together = evaluate_section(np.concatenate(clouds), [right, left], slab_width=BEAM_SPACING)
    assert [metrics.name for metrics in together] == ["45 degrees", "90 degrees"]
    for metrics, cloud, truth in zip(together, clouds, (right, left), strict=True):
        assert metrics == evaluate(cloud, truth, BEAM_SPACING)
        assert metrics.volume == pytest.approx(truth.volume, rel=0.02)


def test_the_seabed_s_height_is_what_heights_count_from():
    truth = wedge(60.0)
    cloud = dense_cloud(truth)
    (lifted,) = evaluate_section(cloud - (0.0, 0.0, 4.0), [truth], slab_width=BEAM_SPACING, seabed_z=-4.0)
    assert lifted.area == pytest.approx(evaluate(cloud, truth, BEAM_SPACING).area)


@pytest.mark.parametrize("cloud", ["dense", "sonar", "flat"])
def test_the_order_of_points_does_not_matter(cloud):
    truth = brick()
    points = {
        "dense": dense_cloud(truth, 5000),
        "sonar": sonar_cloud(truth, 0.01, BRICK_SPACING, 62.0, noise=0.005),
        # Many points of one height: nothing may hang on which of them comes first.
        "flat": sonar_cloud(truth, 0.002, 0.003, 90.0),
    }[cloud]
    shuffled = np.random.default_rng(4).permutation(points)
    assert evaluate(points, truth, BRICK_SPACING) == evaluate(shuffled, truth, BRICK_SPACING)


@pytest.mark.parametrize("count", [0, 1, 2])
@pytest.mark.parametrize("seed", range(5))
def test_a_tiny_cloud_has_no_figures(count, seed):
    truth = brick()
    cloud = np.random.default_rng(seed).permutation(sonar_cloud(truth, 0.01, BRICK_SPACING, 62.0))[:count]
    metrics = evaluate(cloud, truth, BRICK_SPACING)
    assert (metrics.slope_deg, metrics.slope_error, metrics.area_error, metrics.volume_error) == (None,) * 4
    assert (metrics.front_coverage, metrics.area, metrics.volume) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("count", range(3, 40))
def test_a_thin_cloud_is_no_error(count):
    truth = brick()
    cloud = np.random.default_rng(count).permutation(sonar_cloud(truth, 0.01, BRICK_SPACING, 62.0))[:count]
    metrics = evaluate(cloud, truth, BRICK_SPACING)
    assert (metrics.area_error is None) == (metrics.area == 0.0)
    assert (metrics.volume_error is None) == (metrics.volume == 0.0)
    assert 0.0 <= metrics.area < 0.3


def test_points_all_in_one_place_have_no_figures():
    metrics = evaluate(np.tile([9.1, 0.0, 0.3], (50, 1)), brick(), BRICK_SPACING)
    assert (metrics.slope_deg, metrics.area_error, metrics.volume_error) == (None, None, None)


def test_no_object_no_entry():
    assert evaluate_section(np.zeros((3, 3)), [], slab_width=0.02) == []


@pytest.mark.parametrize(
    ("points", "arguments", "message"),
    [
        (np.zeros((3, 2)), {}, r"points: expected shape \(None, 3\), got \(3, 2\)"),
        ([[0.0, np.nan, 0.0]], {}, "points: nan at index 1, must be finite"),
        (np.zeros((3, 3)), {"slab_width": 0.0}, r"slab_width: 0 is outside \[0.001, 10\]"),
        (np.zeros((3, 3)), {"slab_width": np.nan}, "slab_width: nan is outside"),
        (np.zeros((3, 3)), {"seabed_z": np.inf}, "seabed_z: inf, must be finite"),
    ],
)
def test_bad_input_is_refused_by_name(points, arguments, message):
    with pytest.raises(ValueError, match=message):
        evaluate_section(points, [brick()], **{"slab_width": 0.02, **arguments})


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("height", 0.0, "height: 0.0, must be positive"),
        ("front_slope_deg", 91.0, r"front_slope_deg: 91 is outside \[0, 90\]"),
        ("centre_y", np.nan, "centre_y: nan, must be finite"),
    ],
)
def test_an_impossible_object_is_refused(field, value, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(brick(), **{field: value})


def test_an_object_without_a_straight_front_has_no_slope_error():
    truth = dataclasses.replace(brick(), front_slope_deg=None)
    with_slope, without = (evaluate(dense_cloud(brick()), each, BRICK_SPACING) for each in (brick(), truth))
    assert without == dataclasses.replace(with_slope, slope_error=None)
    assert without.slope_deg == pytest.approx(90.0, abs=0.5)


SQUARE = (
    np.array([[0.0, -1.0, -1.0], [0.0, 1.0, -1.0], [0.0, 1.0, 1.0], [0.0, -1.0, 1.0]]),
    np.array([[0, 1, 2], [0, 2, 3]]),
)
ORIGIN_TO_SQUARE = np.array([[-2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])


def test_samples_are_uniform_by_area():
    # Triangles of area 1/2 and 2, the second cut from its corner like a dart board.
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 0, 0], [7, 0, 0], [5, 2, 0]])
    samples = sample_surface(vertices, np.array([[0, 1, 2], [3, 4, 5]]), 5000, 1)
    second = samples[samples[:, 0] >= 5.0] - (5.0, 0.0, 0.0)
    # Strata fall on one side or the other of the border: the shares are exact.
    assert len(second) == 4000
    assert (second[:, :2].sum(axis=1) <= 2.0 + 1e-12).all()
    # Half the side, a quarter of the area; the mean is the centroid. Six standard errors each.
    assert np.mean(second[:, :2].sum(axis=1) <= 1.0) == pytest.approx(0.25, abs=6 * math.sqrt(0.25 * 0.75 / 4000))
    assert second.mean(axis=0) == pytest.approx([2 / 3, 2 / 3, 0], abs=6 * math.sqrt(2 / 9 / 4000))


def test_samples_are_named_by_their_seed():
    first, same, other = (sample_surface(*SQUARE, 100, seed) for seed in (1, 1, 2))
    assert np.array_equal(first, same)
    assert not np.array_equal(first, other)


def test_a_face_without_area_gets_no_sample():
    vertices = np.concatenate([SQUARE[0], [[9.0, 9.0, 9.0]]])
    samples = sample_surface(vertices, np.concatenate([[[4, 4, 4]], SQUARE[1], [[4, 4, 0]]]), 1000, 1)
    assert np.abs(samples).max() <= 1.0


@pytest.mark.parametrize("offset", [0.0, 5000.0])
def test_a_cloud_at_a_known_distance_has_that_accuracy(device, offset):
    # Half the points 3 cm before it, half 4 cm behind: also far off the origin, where float32 knows half a millimetre.
    random = np.random.default_rng(1)
    vertices = SQUARE[0] + offset
    height = np.tile([0.03, -0.04], 500)
    points = np.stack([height, *random.uniform(-1, 1, (2, 1000))], axis=1) + offset
    (metrics,) = evaluate_surface(vertices, SQUARE[1], [points], [points], tolerance=0.035, device=device)
    assert metrics.accuracy_mean == pytest.approx(0.035, abs=1e-5)
    assert metrics.accuracy_rms == pytest.approx(math.sqrt(0.00125), abs=1e-5)
    assert metrics.accuracy_p95 == pytest.approx(0.04, abs=1e-5)
    assert metrics.precision == 0.5
    assert metrics.completeness == 1.0
    assert metrics.f_score == pytest.approx(2 / 3)


def test_completeness_is_the_share_of_visible_surface_that_has_a_point(device):
    samples = sample_surface(*SQUARE, 4000, 1)
    # Exact points over the half y < 0: the samples beyond by less than the tolerance count as met too.
    points = sample_surface(*SQUARE, 200000, 2)
    points = points[points[:, 1] < 0.0]
    (metrics,) = evaluate_surface(*SQUARE, [points], [samples], tolerance=0.05, device=device)
    assert metrics.precision == 1.0
    assert metrics.completeness == pytest.approx(np.mean(samples[:, 1] < 0.05), abs=0.005)
    assert metrics.f_score == pytest.approx(2 * metrics.completeness / (1 + metrics.completeness))


def test_clouds_of_one_batch_do_not_see_each_other(device):
    samples = sample_surface(*SQUARE, 500, 1)
    left, right = samples[samples[:, 1] > 0], samples[samples[:, 1] < 0] + (0.02, 0.0, 0.0)
    empty = np.zeros((0, 3))
    pairs = [(left, samples), (empty, samples), (right, left), (right, empty), (right, right)]
    clouds, visible = zip(*pairs, strict=True)
    batch = evaluate_surface(*SQUARE, clouds, visible, tolerance=0.03, device=device)
    for metrics, cloud, seen in zip(batch, clouds, visible, strict=True):
        assert [metrics] == evaluate_surface(*SQUARE, [cloud], [seen], tolerance=0.03, device=device)
    assert batch[1].accuracy_mean is None
    assert (batch[1].precision, batch[1].completeness, batch[1].f_score) == (None, 0.0, 0.0)
    assert (batch[3].completeness, batch[3].f_score) == (None, None)
    assert batch[3].precision == 1.0
    assert batch[4].f_score == 1.0


# A plate 1 m before the square, of half its size: two parts of one scene.
TWO = (
    np.concatenate([SQUARE[0], 0.5 * SQUARE[0] - (1.0, 0.0, 0.0)]),
    np.concatenate([SQUARE[1], SQUARE[1] + 4]),
)
PLATE = np.array([False, False, True, True])


def test_points_on_the_rest_say_nothing_of_a_part_but_points_on_nothing_do(device):
    on_plate, on_square, in_between = [-1.01, 0.0, 0.0], [-0.02, 0.2, 0.1], [-0.3, 0.0, 0.0]
    cloud = np.array([on_plate, on_square, on_square, in_between])
    asked = {"tolerance": 0.05, "device": device}
    (whole,) = evaluate_surface(*TWO, [cloud], [cloud[:0]], **asked)
    (plate,) = evaluate_surface(*TWO, [cloud], [cloud[:0]], part=PLATE, **asked)
    (square,) = evaluate_surface(*TWO, [cloud], [cloud[:0]], part=~PLATE, **asked)
    assert (whole.counted, plate.counted, square.counted) == (4, 2, 3)
    assert whole.accuracy_mean == pytest.approx((0.01 + 0.02 + 0.02 + 0.3) / 4)
    # What lies on nothing is wrong by its distance to whatever is nearest, whichever part is asked for.
    assert plate.accuracy_mean == pytest.approx((0.01 + 0.3) / 2)
    assert square.accuracy_mean == pytest.approx((0.02 + 0.02 + 0.3) / 3)
    assert (plate.precision, square.precision) == (1 / 2, 2 / 3)


def test_a_cloud_of_the_rest_alone_has_no_accuracy_on_a_part(device):
    rest, samples = np.zeros((3, 3)), sample_surface(TWO[0], TWO[1][PLATE], 50, 1)
    (found,) = evaluate_surface(*TWO, [rest], [samples], tolerance=0.05, part=PLATE, device=device)
    assert (found.counted, found.accuracy_rms, found.precision) == (0, None, None)
    assert (found.completeness, found.f_score) == (0.0, 0.0)


@pytest.mark.parametrize("offset", [0.0, 5000.0])
def test_only_the_near_side_of_a_box_is_visible(device, offset):
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([[a, b, c] for a, b, c, _ in quads] + [[a, c, d] for a, _, c, d in quads])
    samples = sample_surface(signs, faces, 3000, 1)
    samples = np.where(np.abs(samples) > 1 - 1e-12, np.sign(samples), samples)
    # Round the corner but hidden by less than the clearance of 1 mm counts as seen: keep off the edges.
    samples = samples[np.sum(np.abs(samples) > 0.99, axis=1) == 1]
    view = SonarView(
        azimuth_min=-0.5, azimuth_max=0.5, elevation_min=-0.5, elevation_max=0.5, range_min=0.1, range_max=10.0
    )
    ahead = np.array([[-5.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])
    turned = np.array([[0.0, -5.0, 0.0, 0.0, 0.0, math.sin(math.pi / 4), math.cos(math.pi / 4)]])
    ahead[:, :3] += offset
    turned[:, :3] += offset
    poses = [ahead, turned, np.concatenate([ahead, turned])]
    front, side, both = visible_samples(signs + offset, faces, samples + offset, view, poses, device=device)
    assert np.array_equal(front, samples[:, 0] == -1)
    assert np.array_equal(side, samples[:, 1] == -1)
    assert np.array_equal(both, front | side)


def test_a_view_is_what_the_sonar_covers(device):
    imaging, profiling = SonarView.of(FLS()), SonarView.of(PS())
    assert (imaging.azimuth_max, imaging.elevation_max) == pytest.approx(np.radians([14.5, 7.0]))
    assert (imaging.range_min, imaging.range_max, imaging.cone) == (0.42, 5.42, False)
    assert (profiling.azimuth_max, profiling.elevation_max) == pytest.approx(np.radians([0.9, 10.0]))
    assert (profiling.azimuth_min, profiling.elevation_min) == pytest.approx(np.radians([-0.9, -10.0]))
    assert profiling.cone
    samples = sample_surface(*SQUARE, 5000, 1)
    (seen,) = visible_samples(*SQUARE, samples, profiling, [ORIGIN_TO_SQUARE], device=device)
    # 2 m away: a strip 2 * 2 tan(0.9 deg) wide by 2 * 2 tan(10 deg) tall of the square's 4 m2, its ends rounded.
    assert seen.mean() == pytest.approx(4 * math.tan(math.radians(0.9)) * math.tan(math.radians(10.0)), rel=0.2)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"faces": np.array([[0, 1, 4]])}, r"faces: \[0, 4\] name vertices outside \[0, 3\]"),
        ({"faces": np.zeros((0, 3), dtype=int)}, "faces: none, must be at least one"),
        ({"faces": np.zeros((2, 3))}, "faces: expected integers of shape"),
        ({"vertices": np.full((4, 3), np.nan)}, "vertices: nan at index 0"),
        ({"clouds": [np.zeros((2, 2))]}, r"clouds\[0\]: expected shape \(None, 3\)"),
        ({"visible": []}, "visible: 0 sets of samples for 1 clouds"),
        ({"tolerance": 0.0}, "tolerance: 0.0, must be positive"),
        ({"part": np.array([True])}, r"part: expected bool of shape \(2,\), got bool of \(1,\)"),
        ({"part": np.array([0, 1])}, r"part: expected bool of shape \(2,\), got int64"),
        ({"part": np.zeros(2, dtype=bool)}, "part: no face, must be at least one"),
    ],
)
def test_what_would_end_the_process_is_refused(device, changes, message):
    arguments = {
        "vertices": SQUARE[0],
        "faces": SQUARE[1],
        "clouds": [np.zeros((1, 3))],
        "visible": [np.zeros((1, 3))],
        "tolerance": 0.1,
        **changes,
    }
    with pytest.raises(ValueError, match=message):
        evaluate_surface(**arguments, device=device)


def test_impossible_views_poses_and_samples_are_refused(device):
    view = SonarView.of(FLS())
    with pytest.raises(ValueError, match=r"azimuth_max: -1 is outside \[-0.253073, 3.14159\]"):
        dataclasses.replace(view, azimuth_max=-1.0)
    with pytest.raises(ValueError, match="range_max: inf is outside"):
        dataclasses.replace(view, range_max=math.inf)
    with pytest.raises(ValueError, match=r"world_from_sensor\[0\]: quaternion of length 2, must be 1"):
        visible_samples(*SQUARE, np.zeros((1, 3)), view, [2.0 * ORIGIN_TO_SQUARE], device=device)
    with pytest.raises(ValueError, match="count: 0, must be at least 1"):
        sample_surface(*SQUARE, 0, 1)
    with pytest.raises(ValueError, match="faces: all 1 have zero area"):
        sample_surface(SQUARE[0], np.array([[0, 0, 1]]), 1, 1)
