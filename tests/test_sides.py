"""Sides of objects: how bright an echo begins, and that a beam which hardly brushes an object gives no point."""

import numpy as np
import pytest
import warp as wp

from sonarwarp_kernels import sides
from sonarwarp_kernels.critical import NO_BIN
from sonarwarp_kernels.estimate import QUALITY_FALLBACK, QUALITY_INFORMED, QUALITY_NONE
from tests.arc_world import UNDETECTED, struct
from tests.reference import sides as reference

NONE, FALLBACK, INFORMED = int(QUALITY_NONE), int(QUALITY_FALLBACK), int(QUALITY_INFORMED)
NOTHING = int(NO_BIN)
EPSILON = float(np.finfo(np.float32).eps)
PAST = UNDETECTED
"""A beam that meets nothing."""
JUMP, SHARE = 0.04, 0.5


def measure(device, image, critical_bin, length, threads=1):
    """Levels, from an output that held something else."""
    critical_bin = np.asarray(critical_bin)
    out = wp.full(critical_bin.shape, 7.0, dtype=float, device=device)
    sides.measure_onsets(
        wp.array(image, dtype=float, device=device),
        wp.array(critical_bin, dtype=int, device=device),
        length,
        out,
        device=device,
        threads=threads,
    )
    return out.numpy()


def drop(device, critical_range, level, quality=None, jump=JUMP, share=SHARE, threads=1):
    """Qualities after sides were dropped, all informed before by default."""
    critical_range = np.atleast_2d(critical_range)
    out = wp.array(np.full(critical_range.shape, INFORMED) if quality is None else quality, dtype=int, device=device)
    sides.drop_sides(
        struct(sides.Sides, jump=jump, share=share),
        wp.array(critical_range, dtype=float, device=device),
        wp.array(np.atleast_2d(level), dtype=float, device=device),
        out,
        device=device,
        threads=threads,
    )
    return out.numpy()


def dropped(device, critical_range, level, **changed):
    """Beams of one frame that lost their point, as a list, the same for the mirrored fan."""
    found = drop(device, critical_range, level, **changed)[0] == NONE
    mirrored = drop(device, critical_range[::-1], level[::-1], **changed)[0] == NONE
    assert np.array_equal(found, mirrored[::-1])
    return np.flatnonzero(found).tolist()


# --- How bright an echo begins ---

RISING = np.arange(1.0, 11.0)
"""One beam of ten bins."""


@pytest.mark.parametrize(
    ("start", "length", "level"),
    [
        (0, 1, 1.0),
        (3, 1, 4.0),
        (3, 4, 5.5),
        (0, 10, 5.5),
        (6, 4, 8.5),
        (7, 4, 9.0),
        (9, 8, 10.0),
        (0, 1000, 5.5),
        (NOTHING, 4, 0.0),
    ],
    ids=[
        "first bin",
        "one bin",
        "some bins",
        "whole window",
        "up to the window's end",
        "cut at it",
        "its last bin",
        "longer than it",
        "no critical point",
    ],
)
def test_a_level_is_the_mean_over_the_bins_from_the_critical_one(device, start, length, level):
    assert measure(device, RISING[None, None], [[start]], length)[0, 0] == level


def random_images(seed=1, slots=7, beams=11, bins=40):
    rng = np.random.default_rng(seed)
    start = rng.integers(0, bins, (slots, beams))
    start[rng.random(start.shape) < 0.2] = NOTHING
    return rng.rayleigh(size=(slots, beams, bins)).astype(np.float32), start


@pytest.mark.parametrize("length", [1, 8, 25, 60])
def test_levels_are_those_of_the_reference(device, length):
    image, start = random_images()
    got = measure(device, image, start, length)
    np.testing.assert_allclose(got, reference.levels(image, start, length), rtol=min(length, 40) * EPSILON)
    assert np.all(got[start == NOTHING] == 0.0)


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_levels_do_not_depend_on_threads_or_on_other_slots(device, threads):
    image, start = random_images()
    whole = measure(device, image, start, 8, threads)
    for slot in range(len(image)):
        assert np.array_equal(whole[slot], measure(device, image[slot : slot + 1], start[slot : slot + 1], 8)[0])


# --- Which beams lose their points ---

OBJECT = [PAST, PAST, 3.0, 3.0, 3.0, 3.0, PAST, PAST]
"""An object in the middle of a fan."""


@pytest.mark.parametrize(
    ("level", "lost"),
    [(0.0, [2]), (0.49, [2]), (0.51, []), (1.0, []), (20.0, [])],
    ids=["not filled", "less than half", "more than half", "filled", "brighter"],
)
def test_an_objects_last_beam_is_dropped_where_less_than_half_filled(device, level, lost):
    assert dropped(device, OBJECT, [9.0, 9.0, level, 1.0, 1.0, 1.0, 9.0, 9.0]) == lost


def test_either_side_of_an_object_is_judged_by_itself(device):
    for left, right in ((0.4, 0.4), (0.4, 0.6), (0.6, 0.4), (0.6, 0.6)):
        lost = [beam for beam, level in ((2, left), (5, right)) if level < 0.5]
        assert dropped(device, OBJECT, [0.0, 0.0, left, 1.0, 1.0, right, 0.0, 0.0]) == lost


def test_beams_inside_an_object_stay_however_faint(device):
    assert dropped(device, OBJECT, [0.0, 0.0, 1.0, 0.01, 0.01, 1.0, 0.0, 0.0]) == []


@pytest.mark.parametrize(
    ("inner", "level", "lost"),
    [((1.0, 1.0), 0.49, [1]), ((1.0, 0.2), 0.31, []), ((1.0, 0.2), 0.29, [1]), ((0.2, 1.0), 0.29, [1])],
)
def test_the_next_two_beams_say_together_how_bright_a_filled_one_is(device, inner, level, lost):
    distance = [PAST, 3.0, 3.0, 3.0, 3.0, 3.0]
    assert dropped(device, distance, [0.0, level, *inner, 100.0, 100.0]) == lost


@pytest.mark.parametrize(
    ("beyond", "lost"),
    [
        (PAST, [1]),
        (3.5, [1]),
        (3.05, [1]),
        (3.03, []),
        (3.0, []),
        (2.97, []),
        (2.95, []),
        (1.0, []),
    ],
    ids=["nothing", "far behind", "just behind", "hardly behind", "the same", "hardly nearer", "just nearer", "nearer"],
)
def test_only_a_neighbour_that_looks_past_the_object_shows_its_side(device, beyond, lost):
    """One that meets something nearer hides the object, which may go on behind it."""
    assert dropped(device, [beyond, 3.0, 3.0, 3.0, 3.0], [1.0, 0.2, 1.0, 1.0, 1.0]) == lost


@pytest.mark.parametrize(
    ("distance", "level"),
    [
        ([3.0, 3.0, 3.0, 3.0], [0.0, 1.0, 1.0, 1.0]),
        ([3.0, 3.0, 3.0, PAST], [0.0, 1.0, 1.0, 1.0]),
        ([3.0, 3.0], [0.0, 1.0]),
        ([3.0], [0.0]),
    ],
    ids=["all of the fan", "half of it", "two beams", "one beam"],
)
def test_at_the_fans_own_edge_nothing_is_dropped(device, distance, level):
    assert dropped(device, distance, level) == []


@pytest.mark.parametrize(
    ("distance", "level"),
    [
        ([PAST, 3.0, PAST], [0.0, 0.0, 0.0]),
        ([3.5, 3.0, 3.5], [9.0, 0.0, 9.0]),
        ([2.5, 3.0, PAST], [9.0, 0.0, 0.0]),
    ],
    ids=["alone", "before something", "behind something's edge"],
)
def test_what_only_one_beam_meets_stays(device, distance, level):
    """Nothing beside it says how bright it would be."""
    assert dropped(device, distance, level) == []


@pytest.mark.parametrize(("level", "lost"), [(0.49, [2]), (0.51, [])])
def test_of_an_object_of_two_beams_each_is_judged_by_the_other(device, level, lost):
    assert dropped(device, [PAST, 3.0, 3.0, PAST], [0.0, 1.0, level, 0.0]) == lost


@pytest.mark.parametrize(
    ("inner", "lost"),
    [((3.03, 3.07), [1]), ((3.03, 3.09), []), ((3.03, PAST), []), ((3.05, 3.05), []), ((2.97, 2.93), [1])],
    ids=["going away", "second too far", "second missing", "first too far", "coming nearer"],
)
def test_an_object_may_slant_by_less_than_a_jump_a_beam(device, inner, lost):
    """The second neighbour, within two jumps, counts as the same surface: here it alone is bright."""
    distance = [PAST, 3.0, *inner, *inner[-1:] * 2]
    found = dropped(device, distance, [0.0, 0.6, 1.0, 3.0, 3.0, 3.0])
    assert [beam for beam in found if beam == 1] == lost


@pytest.mark.parametrize("quality", [FALLBACK, INFORMED])
def test_points_that_stay_keep_their_quality_and_none_is_brought_back(device, quality):
    given = np.full((1, 8), NONE)
    given[0, [2, 3, 5]] = quality
    got = drop(device, OBJECT, [0.0, 0.0, 0.2, 1.0, 1.0, 0.8, 0.0, 0.0], given)
    # Beam 4, without a point before, still says how bright the object is.
    assert got[0].tolist() == [NONE, NONE, NONE, quality, NONE, quality, NONE, NONE]


@pytest.mark.parametrize(("share", "lost"), [(0.0, []), (0.3, []), (0.5, [2]), (1.0, [2])])
def test_the_share_is_that_of_the_model(device, share, lost):
    assert dropped(device, OBJECT, [0.0, 0.0, 0.4, 1.0, 1.0, 1.0, 0.0, 0.0], share=share) == lost


def random_frames(seed=2, frames=60, beams=40):
    """Surfaces that come and go from beam to beam, and levels that spread."""
    rng = np.random.default_rng(seed)
    leap = rng.random((frames, beams)) < 0.25
    step = np.where(leap, rng.normal(0.0, 0.3, leap.shape), rng.normal(0.0, 0.03, leap.shape))
    distance = (4.0 + np.cumsum(step, axis=1)).astype(np.float32)
    distance[rng.random(leap.shape) < 0.15] = PAST
    quality = rng.choice([NONE, FALLBACK, INFORMED], leap.shape, p=[0.1, 0.3, 0.6])
    return distance, rng.exponential(size=leap.shape).astype(np.float32), quality


@pytest.mark.parametrize(("jump", "share"), [(0.04, 0.4), (0.1, 0.9), (0.0, 0.5)])
def test_drops_are_those_of_the_reference(device, jump, share):
    distance, level, quality = random_frames()
    got = drop(device, distance, level, quality, jump, share)
    brushed = reference.brushed(distance, level, float(np.float32(jump)), float(np.float32(share)))
    assert np.array_equal(got, np.where(brushed, NONE, quality))
    # A surface goes on for less than a jump: without one, no object has a second beam.
    assert bool(np.sum(brushed & (quality != NONE)) > 30) is (jump > 0.0)


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_drops_do_not_depend_on_threads_on_other_frames_or_on_the_side_that_comes_first(device, threads):
    distance, level, quality = random_frames()
    whole = drop(device, distance, level, quality, threads=threads)
    order = np.random.default_rng(3).permutation(len(distance))
    assert np.array_equal(whole[order], drop(device, distance[order], level[order], quality[order]))
    assert np.array_equal(whole[5:6], drop(device, distance[5:6], level[5:6], quality[5:6]))
    mirrored = drop(device, *(values[:, ::-1].copy() for values in (distance, level, quality)))
    assert np.array_equal(whole, mirrored[:, ::-1])


# --- Bad input ---


@pytest.mark.parametrize("length", [0, -3])
def test_a_level_over_no_bins_is_refused(device, length):
    with pytest.raises(ValueError, match=f"length: {length}, must be at least 1"):
        measure(device, RISING[None, None], [[0]], length)


@pytest.mark.parametrize(
    ("wrong", "shape", "dtype", "message"),
    [
        ("image", (2, 3), float, r"image: expected shape \(any, any, any\), got \(2, 3\)"),
        ("image", (2, 3, 5), int, "image: expected dtype float32, got int32"),
        ("critical_bin", (3, 2), int, r"critical_bin: expected shape \(2, 3\), got \(3, 2\)"),
        ("critical_bin", (2, 3), float, "critical_bin: expected dtype int32, got float32"),
        ("level_out", (2, 4), float, r"level_out: expected shape \(2, 3\), got \(2, 4\)"),
        ("level_out", (2, 3), int, "level_out: expected dtype float32, got int32"),
    ],
)
def test_wrong_arrays_of_onsets_are_refused_by_name(device, wrong, shape, dtype, message):
    given = {
        "image": wp.zeros((2, 3, 5), dtype=float, device=device),
        "critical_bin": wp.zeros((2, 3), dtype=int, device=device),
        "level_out": wp.zeros((2, 3), dtype=float, device=device),
    }
    given[wrong] = wp.zeros(shape, dtype=dtype, device=device)
    with pytest.raises(ValueError, match=message):
        sides.measure_onsets(**given, length=4, device=device)


@pytest.mark.parametrize(
    ("wrong", "shape", "dtype", "message"),
    [
        ("critical_range", (4, 6, 1), float, r"critical_range: expected shape \(any, any\), got \(4, 6, 1\)"),
        ("critical_range", (4, 6), int, "critical_range: expected dtype float32, got int32"),
        ("level", (6, 4), float, r"level: expected shape \(4, 6\), got \(6, 4\)"),
        ("level", (4, 6), int, "level: expected dtype float32, got int32"),
        ("quality_out", (4, 5), int, r"quality_out: expected shape \(4, 6\), got \(4, 5\)"),
        ("quality_out", (4, 6), float, "quality_out: expected dtype int32, got float32"),
    ],
)
def test_wrong_arrays_of_drops_are_refused_by_name(device, wrong, shape, dtype, message):
    given = {
        "critical_range": wp.zeros((4, 6), dtype=float, device=device),
        "level": wp.zeros((4, 6), dtype=float, device=device),
        "quality_out": wp.zeros((4, 6), dtype=int, device=device),
    }
    given[wrong] = wp.zeros(shape, dtype=dtype, device=device)
    with pytest.raises(ValueError, match=message):
        sides.drop_sides(sides.Sides(), **given, device=device)
