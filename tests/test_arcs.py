"""Contacts on their arcs: where both sonars together place them, how sure that is, and which the seabed explains."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from scipy import ndimage

from sonarwarp_kernels import arcs, estimate
from tests.arc_world import UNDETECTED, struct
from tests.carved_world import ATTITUDES, DOUBT, UNASKED, CarvedWorld
from tests.reference import arcs as reference
from tests.reference.field import cell_centres
from tests.reference.free_depth import arc
from tests.reference.geometry import direction, rotation

EPSILON = float(np.finfo(np.float32).eps)
# Positions and ranges of up to 4 m, some operations each.
LENGTH = 8 * EPSILON * 4.0
NONE, FALLBACK, INFORMED = (
    int(q) for q in (estimate.QUALITY_NONE, estimate.QUALITY_FALLBACK, estimate.QUALITY_INFORMED)
)


def everywhere(attitude="tilted", **changed):
    """A world whose contacts all give points."""
    world = CarvedWorld.around(ATTITUDES[attitude], **changed)
    return replace(world, seabed=np.full_like(world.seabed, np.inf))


def contacts(world):
    """Every frame and beam with a critical point."""
    return list(zip(*np.nonzero(world.critical != UNDETECTED), strict=True))


def smooth(world, seed, most):
    """A field for every trajectory that varies over some cells."""
    noise = np.random.default_rng(seed).standard_normal(world.counts.shape)
    blurred = ndimage.gaussian_filter(noise, (0, 3, 3, 3))
    return most * blurred / np.abs(blurred).max()


def with_fields(world, seed=80, most=3.0):
    """The world with a smooth field of the profiling sonar, and free depths to go with it."""
    counts = np.round(smooth(world, seed, most) * 65536).astype(np.int32)
    return replace(world, counts=counts), smooth(world, seed + 1, 0.8 * world.reach).astype(np.float32)


def steepest(values):
    """Largest difference between neighbouring cells."""
    return max(np.abs(np.diff(values, axis=axis)).max() for axis in (1, 2, 3))


# --- Weights and moments ---


@pytest.mark.parametrize("cone", [0, 1])
@pytest.mark.parametrize("number", [1, 6, 64, 250])
@pytest.mark.parametrize(
    ("attitude", "proven", "solid"), [("tilted", -1.0, 1.0), ("upside down", -0.2, 0.1), ("upwards", 0.0, 0.0)]
)
def test_moments_are_those_of_the_weighted_hypotheses(device, attitude, proven, solid, number, cone):
    doubt = DOUBT | {"proven": proven, "solid": solid, "deviation": 0.3}
    world, cells = with_fields(everywhere(attitude, cone=cone, doubt=doubt))
    got = world.estimate_arcs(device, cells, number)
    # A place in error moves along all three axes of both fields. A doubt's exponent is 8 at most, 4 deviations.
    step = 3 * LENGTH / world.cell
    outside = max(world.reach + np.abs(cells).max(), steepest(cells)) * step * 4 / world.doubt["deviation"]
    relative = outside + steepest(world.counts / 65536) * step + np.sqrt(number) * 4 * EPSILON
    # Places lie so far from the middle of their arc at most.
    length = world.half_elevation * 3.5
    for at in contacts(world):
        want = reference.moments(world, *at, cells, number)
        np.testing.assert_allclose(got["mean"][at], want["mean"], atol=2 * relative * length + LENGTH)
        tolerance = 4 * relative * length**2 + 2 * LENGTH * length
        np.testing.assert_allclose(got["covariance"][at], want["covariance"], atol=tolerance)
        assert got["elevation_mean"][at] == pytest.approx(want["elevation_mean"], abs=2 * relative * 0.3)
        variance = want["elevation_deviation"] ** 2
        assert got["elevation_deviation"][at] ** 2 == pytest.approx(variance, abs=4 * relative * 0.3**2)
        assert got["effective_size"][at] == pytest.approx(want["effective_size"], rel=4 * relative)


@pytest.mark.parametrize("cone", [0, 1])
def test_the_range_is_uncertain_along_the_beam_and_nowhere_else(device, cone):
    world, cells = with_fields(everywhere(cone=cone))
    sure = replace(world, doubt=DOUBT | {"range_deviation": 0.0})
    got, without = (each.estimate_arcs(device, cells)["covariance"] for each in (world, sure))
    for frame, beam in contacts(world):
        middle = direction(world.azimuth[beam : beam + 1], np.zeros(1), bool(cone))[0]
        ahead = world.orientation[frame] @ middle
        # Sums of terms of up to a square metre.
        added = got[frame, beam] - without[frame, beam]
        np.testing.assert_allclose(added, 0.3**2 * np.outer(ahead, ahead), atol=8 * EPSILON)


@pytest.mark.parametrize("cone", [0, 1])
def test_the_likeliest_point_is_the_hypothesis_of_the_greatest_weight(device, cone):
    world, cells = with_fields(everywhere(cone=cone))
    got = world.estimate_arcs(device, cells, 64)
    chosen = set()
    for at in contacts(world):
        elevation, where, weight = reference.weights(world, *at, cells, 64)
        index = int(np.abs(elevation - got["elevation"][at]).argmin())
        np.testing.assert_allclose(got["elevation"][at], elevation[index], atol=4 * EPSILON)
        np.testing.assert_allclose(got["likely"][at], where[index], atol=LENGTH)
        # Neighbours may be as good as equal.
        assert weight[index] >= weight.max() * (1 - 1e-3)
        chosen.add(index)
    assert len(chosen) > 8


@pytest.mark.parametrize("offset", [-0.3, 0.15])
def test_an_error_common_to_all_free_depths_cancels(device, offset):
    world, cells = with_fields(everywhere(doubt=DOUBT | {"proven": -1.0}))
    # All cells one may read hold a free depth, so that none is read as unproven.
    inside = replace(world, origin=world.origin - np.float32(3.0), cell=0.4)
    first = inside.estimate_arcs(device, 0.5 * cells)
    second = inside.estimate_arcs(device, 0.5 * cells + np.float32(offset))
    assert np.array_equal(first["quality"], second["quality"])
    # Free depths of up to 1 are known to half an epsilon, eight of them are added up.
    relative = 2 * 8 * EPSILON * 4 / world.doubt["deviation"]
    for at in contacts(world):
        assert first["elevation_mean"][at] == pytest.approx(second["elevation_mean"][at], abs=2 * relative * 0.6)
        assert first["effective_size"][at] == pytest.approx(second["effective_size"][at], rel=4 * relative)
    assert np.ptp(first["effective_size"][world.critical != UNDETECTED]) > 1.0


def test_where_nothing_is_known_the_posterior_is_the_prior(device):
    world = everywhere()
    got = world.estimate_arcs(device, np.full(world.counts.shape, UNASKED, dtype=np.float32), 64)
    found = world.critical != UNDETECTED
    assert np.all(got["quality"][found] == FALLBACK)
    np.testing.assert_allclose(got["effective_size"][found], 64, rtol=64 * EPSILON)
    np.testing.assert_allclose(got["elevation_mean"][found], 0.0, atol=64 * EPSILON * 0.3)
    # Hypotheses stand for their parts: uniform over the whole beam.
    np.testing.assert_allclose(got["elevation_deviation"][found], 0.6 / np.sqrt(12), rtol=64 * EPSILON)


@pytest.mark.parametrize("low", [-6.0, -50.0, -80.0])
def test_an_arc_that_both_sonars_hold_empty_leaves_all_places_alike(device, low):
    world = everywhere(low=low)
    inside = replace(
        world, counts=np.full_like(world.counts, -100 * 65536), origin=world.origin - np.float32(3.0), cell=0.4
    )
    got = inside.estimate_arcs(device, np.full(world.counts.shape, world.reach, dtype=np.float32), 64)
    found = world.critical != UNDETECTED
    assert np.all(got["quality"][found] == FALLBACK)
    # Weights as small as 1e-35 still weigh.
    np.testing.assert_allclose(got["effective_size"][found], 64, rtol=64 * EPSILON)
    for name in ("mean", "covariance", "likely", "elevation_deviation"):
        assert np.all(np.isfinite(got[name][found]))


@pytest.mark.parametrize("depth", [-0.3, 0.05, 0.2])
def test_where_nothing_is_known_a_place_is_as_likely_as_the_least_free_but_no_freer_than_solid_water(device, depth):
    """The upper half of every arc, known to be as free as that, against the lower one of which nothing is known."""
    world = everywhere("level", doubt=DOUBT | {"proven": -0.2, "solid": 0.1, "deviation": 0.1})
    inside = replace(world, origin=world.origin - np.float32(3.0), cell=0.4)
    upper = np.full(world.counts.shape, UNASKED, dtype=np.float32)
    for at in contacts(inside):
        _, where, _ = reference.weights(inside, *at, upper, 64)
        owner = world.trajectory[at[0]]
        height = (where[:, 2] - inside.origin[owner][2]) / inside.cell
        cells = np.full(world.counts.shape, UNASKED, dtype=np.float32)
        split = int(np.median(height))
        cells[..., split:] = depth
        got = inside.estimate_arcs(device, cells, 64)["effective_size"][at]
        known = np.sum(height >= split)
        freer = max(depth, -0.2) - min(max(depth, -0.2), 0.1)
        weight = np.exp(-0.5 * (freer / 0.1) ** 2)
        assert got == pytest.approx((64 - known + known * weight) ** 2 / (64 - known + known * weight**2), rel=1e-4)


@pytest.mark.parametrize("elevation", [-0.2, 0.0, 0.2])
def test_an_arc_wholly_in_proven_water_still_gives_its_best_place(device, elevation):
    """What the profiling sonar holds occupied decides where the imaging sonar's free depth cannot."""
    world = everywhere()
    at = contacts(world)[3]
    owner = world.trajectory[at[0]]
    turned = direction(np.array([world.azimuth[at[1]]]), np.array([elevation]), False)
    centre = world.world_points(at[0], turned, float(world.critical[at]))[0]
    around = replace(world, origin=np.tile(centre.astype(np.float32), (2, 1)) - np.float32(0.06 * world.size))
    away = np.linalg.norm(cell_centres(around.inputs("cpu")["grid"], owner) - centre, axis=-1)
    counts = np.where(away < 0.2, 5 * 65536, -5 * 65536).astype(np.int32)
    around = replace(around, counts=np.stack([counts, counts]))
    got = around.estimate_arcs(device, np.full(counts.shape, world.reach, dtype=np.float32)[None].repeat(2, axis=0))
    # The ball, and the cells about it.
    assert np.linalg.norm(got["likely"][at] - centre) < 0.2 + world.cell
    assert got["quality"][at] != NONE


# --- The interval that holds 95 % ---


def ends(world, estimates, at, number):
    """First and last hypothesis of an interval that no registration widens; it ends half-way to the next ones."""
    part = 2 * world.half_elevation / number
    edges = [(float(estimates[f"elevation_{end}"][at]) + world.half_elevation) / part for end in ("low", "high")]
    np.testing.assert_allclose(edges, np.round(edges), atol=8 * EPSILON * number)
    return round(edges[0]), round(edges[1]) - 1


def likeliest(world, estimates, at, number):
    return int(np.abs(reference.free_depth.arc(world, *at, number)[0] - estimates["elevation"][at]).argmin())


@pytest.mark.parametrize("cone", [0, 1])
@pytest.mark.parametrize("number", [1, 6, 64, 250])
@pytest.mark.parametrize("sharpness", [0.5, 1.0, 4.0])
def test_the_interval_grows_from_the_likeliest_place_until_it_holds_95_per_cent(device, sharpness, number, cone):
    """Of the weights raised to the sharpness."""
    world, cells = with_fields(everywhere(cone=cone, doubt=DOUBT | {"deviation": 0.3, "sharpness": sharpness}))
    # Out of a box free depths jump, and places in error say little: here all arcs lie inside.
    world = replace(world, origin=world.origin - np.float32(3.0), cell=0.4)
    got = world.estimate_arcs(device, cells, number)
    # Powers multiply the error of a weight, which is that of its place along three axes and of some operations.
    slope = steepest(cells) * 4 / world.doubt["deviation"] + steepest(world.counts / 65536)
    error = sharpness * (slope * 3 * LENGTH / world.cell + np.sqrt(number) * 4 * EPSILON)
    sure = 0
    for at in contacts(world):
        density = reference.weights(world, *at, cells, number)[2] ** sharpness
        first, last = ends(world, got, at, number)
        best = likeliest(world, got, at, number)
        assert 0 <= first <= best <= last < number
        assert density[first : last + 1].sum() >= 0.95 * density.sum() * (1 - 2 * error)
        # Where neighbours are as good as equal, or 95 % are met to rounding, either way is right.
        allowed = {
            reference.interval(density, best, 0.95 * (1 + slack), favour)
            for slack in (-2 * error, 0.0, 2 * error)
            for favour in (1 - 2 * error, 1.0, 1 + 2 * error)
        }
        if len(allowed) == 1:
            assert (first, last) == allowed.pop()
            sure += 1
    assert sure > 0.4 * len(contacts(world))


def test_the_sharper_the_weights_count_the_narrower_the_interval(device):
    world, cells = with_fields(everywhere())
    found = world.critical != UNDETECTED
    width = []
    for sharpness in (0.5, 1.0, 4.0, 10.0):
        got = replace(world, doubt=DOUBT | {"sharpness": sharpness}).estimate_arcs(device, cells, 128)
        width.append((got["elevation_high"] - got["elevation_low"])[found])
    assert np.all(np.diff([each.mean() for each in width]) < 0.0)
    # The likeliest place and the moments are of the weights themselves.
    assert np.ptp(width[-1]) > 0.0


@pytest.mark.parametrize("registration", [0.002, 0.05, 2.0])
def test_registration_widens_the_interval_in_quadrature_about_the_likeliest_place(device, registration):
    world, cells = with_fields(everywhere(doubt=DOUBT | {"sharpness": 4.0}))
    sure = world.estimate_arcs(device, cells)
    wide = replace(world, doubt=world.doubt | {"registration": registration}).estimate_arcs(device, cells)
    inner = [at for at in contacts(world) if not reaches_an_end(world, sure, at)]
    assert inner
    for at in inner:
        assert wide["elevation"][at] == sure["elevation"][at]
        for end in ("low", "high"):
            alone, both = (each[f"elevation_{end}"][at] - sure["elevation"][at] for each in (sure, wide))
            assert np.sign(both) == np.sign(alone)
            want = np.hypot(alone, 1.959964 * registration)
            assert abs(both) == pytest.approx(want, abs=8 * EPSILON * max(world.half_elevation, 2 * registration))


def test_an_end_of_the_beam_bounds_the_interval_however_the_sonars_are_mounted(device):
    world, cells = with_fields(everywhere(doubt=DOUBT | {"sharpness": 4.0}))
    sure = world.estimate_arcs(device, cells)
    wide = replace(world, doubt=world.doubt | {"registration": 0.05}).estimate_arcs(device, cells)
    ending = [at for at in contacts(world) if reaches_an_end(world, sure, at)]
    for end in ("low", "high"):
        assert any(reaches_an_end(world, sure, at, end) for at in ending)
        for at in ending:
            assert wide[f"elevation_{end}"][at] == sure[f"elevation_{end}"][at]


def reaches_an_end(world, estimates, at, *ends):
    """Whether a beam's interval reaches one of its ends."""
    far = [abs(estimates[f"elevation_{end}"][at]) for end in ends or ("low", "high")]
    return max(far) > world.half_elevation - 16 * EPSILON


@pytest.mark.parametrize("sharpness", [1.0, 4.0])
@pytest.mark.parametrize("number", [1, 20, 64, 250])
def test_where_nothing_is_known_the_interval_is_95_per_cent_of_the_arc(device, number, sharpness):
    world = everywhere(doubt=DOUBT | {"sharpness": sharpness})
    got = world.estimate_arcs(device, np.full(world.counts.shape, UNASKED, dtype=np.float32), number)
    found = world.critical != UNDETECTED
    low, high = got["elevation_low"][found], got["elevation_high"][found]
    np.testing.assert_allclose(low, -0.3, rtol=8 * EPSILON)
    # In whole hypotheses; of 20, whether 19 are 95 % is rounding's to say.
    share = (high - low) / 0.6
    assert np.all((share > 0.95 - 8 * EPSILON) & (share < 0.95 + 1 / number + 8 * EPSILON))


@pytest.mark.parametrize("registration", [0.0, 0.01, 1.0])
def test_where_one_place_is_certain_the_interval_is_its_part_of_the_arc_and_registration(device, registration):
    """Four hypotheses further apart than an occupied ball is wide: the ball's own part of the arc is a quarter."""
    world = everywhere(doubt=DOUBT | {"sharpness": 4.0, "registration": registration})
    at, elevation = contacts(world)[3], 0.075
    turned = direction(np.array([world.azimuth[at[1]]]), np.array([elevation]), False)
    centre = world.world_points(at[0], turned, float(world.critical[at]))[0]
    around = replace(world, origin=np.tile(centre.astype(np.float32), (2, 1)) - np.float32(0.06 * world.size))
    owner = world.trajectory[at[0]]
    away = np.linalg.norm(cell_centres(around.inputs("cpu")["grid"], owner) - centre, axis=-1)
    counts = np.where(away < 0.12, 5 * 65536, -5 * 65536).astype(np.int32)
    around = replace(around, counts=np.stack([counts, counts]))
    got = around.estimate_arcs(device, np.full(counts.shape, world.reach, dtype=np.float32)[None].repeat(2, axis=0), 4)
    assert got["elevation"][at] == pytest.approx(elevation, abs=4 * EPSILON)
    half = np.hypot(0.075, 1.959964 * registration)
    for end, side in (("low", -1), ("high", 1)):
        assert got[f"elevation_{end}"][at] - elevation == pytest.approx(side * half, abs=16 * EPSILON)


# --- Objects ---


def approach(along, length, top=0.6, height=1.8, tilt=0.6, half=0.12, late=0.0):
    """A level run towards an object with a front at x = 0, ``length`` long; its first contacts by brute force."""
    azimuth = np.radians([-0.6, 0.0, 0.6]).astype(np.float32)
    turn = rotation("y", tilt)
    elevation = np.linspace(-half, half, 20001)
    critical = np.full((len(along), 3), UNDETECTED, dtype=np.float32)
    seabed = np.zeros((len(along), 3), dtype=np.float32)
    for beam, angle in enumerate(azimuth):
        ray = direction(np.full(3, angle), np.array([-half, 0.0, half]), False) @ turn.T
        seabed[:, beam] = height / -ray[0, 2]
        ray = np.stack(
            [np.cos(elevation) * np.cos(angle), np.cos(elevation) * np.sin(angle), np.sin(elevation)], axis=-1
        )
        ray = ray @ turn.T
        for frame, x in enumerate(along):
            front = -x / ray[:, 0]
            above = (top - height) / ray[:, 2]
            on_front = (front > 0) & (height + front * ray[:, 2] <= top) & (height + front * ray[:, 2] >= 0)
            on_top = (x + above * ray[:, 0] >= 0) & (x + above * ray[:, 0] <= length)
            nearest = min(front[on_front].min(initial=np.inf), above[on_top].min(initial=np.inf))
            if nearest < seabed[frame, beam]:
                critical[frame, beam] = nearest + late
    size = np.array([[80, 12, 50]], dtype=np.int32)
    frames = len(along)
    return CarvedWorld(
        orientation=np.tile(turn, (frames, 1, 1)),
        position=np.stack([along, 0 * along, 0 * along + height], axis=1).astype(np.float32),
        critical=critical,
        seabed=seabed,
        key=np.zeros(frames, dtype=np.uint64),
        trajectory=np.zeros(frames, dtype=np.int32),
        counts=np.zeros((1, *size[0]), dtype=np.int32),
        origin=np.array([[-0.6, -0.12, -0.05]], dtype=np.float32),
        cell=0.02,
        azimuth=azimuth,
        range_edge=np.linspace(0.5, 4.0, 71, dtype=np.float32),
        half_elevation=half,
        size=size,
        reach=0.1,
        margin=0.004,
        doubt=DOUBT | {"proven": 0.0, "solid": 0.03, "deviation": 0.015, "range_deviation": 0.01, "least_height": 0.06},
        certain=0.026,
    )


def placed(world, device):
    """Estimates of a world from what its own frames prove empty."""
    return world.estimate_arcs(device, world.measure(device, world.ask(device, 128)), 128)


@pytest.mark.parametrize("late", [0.0, 0.015], ids=["exact", "all ranges 1.5 cm long"])
@pytest.mark.parametrize("length", [0.0, 2.0], ids=["a lone wall", "a block"])
def test_a_contact_on_an_edge_is_placed_on_it(device, length, late):
    """Frames that look past an edge prove its surroundings empty; a common error of range does not move the place."""
    along = np.linspace(-2.6, -1.0, 80)
    got = placed(approach(along, length, late=late), device)
    middle = (along > -2.0) & (along < -1.6)
    for at in np.argwhere(np.broadcast_to(middle[:, None], got["quality"].shape)):
        at = tuple(at)
        # To a cell: the free depth is read between centres.
        assert np.hypot(got["likely"][at][0], got["likely"][at][2] - 0.6) < 0.02 + late
        assert got["quality"][at] in (FALLBACK, INFORMED)


def test_contacts_on_a_flat_top_are_placed_at_the_lower_edge_of_the_beam(device):
    along = np.linspace(-1.3, -0.6, 50)
    world = approach(along, 2.0)
    got = placed(world, device)
    # One hypothesis in 128 is 2 mrad of the beam.
    assert np.all(got["elevation"][:, 1] < -0.12 + 2 * 0.24 / 128)
    np.testing.assert_allclose(got["likely"][:, :, 2], 0.6, atol=0.005)
    assert np.all(np.diff(got["likely"][:, 1, 0]) > 0)


# --- Which contacts give points, and how sure they are ---


@pytest.mark.parametrize("cone", [0, 1])
@pytest.mark.parametrize("attitude", ["tilted", "rolled", "straight down"])
def test_a_contact_hardly_higher_than_the_seabed_gives_no_point(device, attitude, cone):
    world = CarvedWorld.around(ATTITUDES[attitude], cone=cone, frames=60)
    got = world.estimate_arcs(device, np.zeros(world.counts.shape, dtype=np.float32), 8)["quality"]
    height = reference.seabed_heights(world)
    least = world.doubt["least_height"]
    sure = np.abs(height - least) > LENGTH
    nothing = (world.critical == UNDETECTED) | (height < least)
    assert np.array_equal(got[sure] == NONE, nothing[sure])
    found = world.critical != UNDETECTED
    # Both kinds, and such as no seabed is ahead of.
    assert np.any(nothing & found)
    assert np.any(~nothing & found & np.isfinite(world.seabed))
    assert np.any(~nothing & found & ~np.isfinite(world.seabed))


@pytest.mark.parametrize(("short", "quality"), [(0.051, NONE), (0.053, FALLBACK)])
def test_the_least_height_is_that_of_the_lower_edge(device, short, quality):
    """A lower edge 70 degrees down: 5 cm of height are 5.32 cm of range."""
    world = CarvedWorld.around(rotation("y", np.radians(70.0) - 0.3), frames=1)
    world = replace(
        world,
        orientation=rotation("y", np.radians(70.0) - 0.3)[None],
        azimuth=np.array([0.0], dtype=np.float32),
        border=np.array([-0.1, 0.1], dtype=np.float32),
        critical=np.float32([[2.0 - short / np.sin(np.radians(70.0))]]),
        seabed=np.float32([[2.0]]),
        doubt=world.doubt | {"least_height": 0.052},
    )
    got = world.estimate_arcs(device, np.zeros(world.counts.shape, dtype=np.float32), 8)
    assert got["quality"][0, 0] == quality


@pytest.mark.parametrize("share", [0.999, 1.001])
def test_a_point_is_informed_where_its_elevation_is_certain_enough(device, share):
    world, cells = with_fields(everywhere())
    deviation = world.estimate_arcs(device, cells)["elevation_deviation"]
    found = world.critical != UNDETECTED
    limit = float(np.median(deviation[found])) * share
    got = replace(world, certain=limit).estimate_arcs(device, cells)["quality"]
    assert np.array_equal(got[found], np.where(deviation[found] <= np.float32(limit), INFORMED, FALLBACK))
    assert {FALLBACK, INFORMED} == set(got[found])


def test_where_there_is_no_point_only_the_quality_is_written(device):
    world = CarvedWorld.around(ATTITUDES["tilted"])
    got = world.estimate_arcs(device, np.zeros(world.counts.shape, dtype=np.float32))
    nothing = got.pop("quality") == NONE
    assert nothing.any()
    for values in got.values():
        assert np.all(values[nothing] == 7)
        assert not np.any(values[~nothing] == 7)


# --- What it does not depend on ---


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_estimates_do_not_depend_on_other_frames_or_threads(device, threads):
    world, cells = with_fields(everywhere())
    whole = world.estimate_arcs(device, cells, threads=threads)
    order = np.random.default_rng(81).permutation(world.frames)
    mixed = world.selected(order).estimate_arcs(device, cells)
    assert all(np.array_equal(whole[name][order], mixed[name]) for name in whole)
    alone = world.selected([5]).estimate_arcs(device, cells)
    assert all(np.array_equal(whole[name][5], alone[name][0]) for name in whole)


def test_cells_outside_of_a_trajectorys_own_box_are_never_read(device):
    world, cells = with_fields(everywhere())
    counts = world.counts.copy()
    spoiled = cells.copy()
    counts[~world.inside()] = 2**30
    spoiled[~world.inside()] = np.nan
    want, got = world.estimate_arcs(device, cells), replace(world, counts=counts).estimate_arcs(device, spoiled)
    assert all(np.array_equal(want[name], got[name]) for name in want)
    # Arcs do reach out of their boxes.
    outside = []
    for at in contacts(world):
        _, where = arc(world, *at, 16)
        place = (where - world.origin[world.trajectory[at[0]]]) / world.cell
        outside.append(np.any((place < 0) | (place > world.size[world.trajectory[at[0]]])))
    assert any(outside)


# --- Refusals ---


@pytest.mark.parametrize("number", [0, -1])
def test_fewer_than_one_hypothesis_is_refused(device, number):
    world = everywhere()
    with pytest.raises(ValueError, match=f"hypotheses: {number}, must be at least 1"):
        world.estimate_arcs(device, np.zeros(world.counts.shape, dtype=np.float32), number)


@pytest.mark.parametrize("value", [0.0, -0.1, float("nan")])
@pytest.mark.parametrize("name", ["reach", "deviation"])
def test_a_model_out_of_bounds_is_refused_by_name(device, name, value):
    world = everywhere()
    changed = {"reach": value} if name == "reach" else {"doubt": world.doubt | {name: value}}
    with pytest.raises(ValueError, match=rf"model\.{name}: must be above 0, got {value}"):
        replace(world, **changed).estimate_arcs(device, np.zeros(world.counts.shape, dtype=np.float32))


@pytest.mark.parametrize("value", [-0.1, float("nan")])
@pytest.mark.parametrize("name", ["solid", "odds_power", "registration"])
def test_a_model_below_zero_is_refused_by_name(device, name, value):
    world = everywhere(doubt=DOUBT | {name: value})
    with pytest.raises(ValueError, match=rf"model\.{name}: must be at least 0, got {value}"):
        world.estimate_arcs(device, np.zeros(world.counts.shape, dtype=np.float32))


@pytest.mark.parametrize(
    ("low", "high", "message"),
    [
        (-81.0, 8.0, r"reading\.low: must lie between -80 and reading\.high = 8, got -81"),
        (2.0, 1.0, r"reading\.low: must lie between -80 and reading\.high = 1, got 2"),
    ],
)
def test_clamps_out_of_bounds_are_refused_by_name(device, low, high, message):
    world = everywhere(low=low, high=high)
    with pytest.raises(ValueError, match=message):
        world.estimate_arcs(device, np.zeros(world.counts.shape, dtype=np.float32))


@pytest.mark.parametrize(
    ("name", "shape", "dtype", "message"),
    [
        ("log_odds", (2, 26, 24, 19), int, r"log_odds: expected shape \(2, 26, 24, 20\), got \(2, 26, 24, 19\)"),
        ("log_odds", (2, 26, 24, 20), float, "log_odds: expected dtype int32, got float32"),
        ("free_depth", (1, 26, 24, 20), float, r"free_depth: expected shape \(2, 26, 24, 20\), got \(1, 26, 24, 20\)"),
        ("free_depth", (2, 26, 24, 20), int, "free_depth: expected dtype float32, got int32"),
    ],
)
def test_wrong_fields_are_refused_by_name(device, name, shape, dtype, message):
    world = everywhere()
    inputs = world.inputs(device)
    inputs["free_depth"] = wp.zeros(world.counts.shape, dtype=float, device=device)
    inputs[name] = wp.zeros(shape, dtype=dtype, device=device)
    taken = {part: inputs[part] for part in ("fan", "grid", "reading", "contacts", "log_odds", "free_depth")}
    out = estimate.Estimates()
    with pytest.raises(ValueError, match=message):
        arcs.estimate_arcs(**taken, model=world.model(), hypotheses=4, estimates_out=out, device=device)


@pytest.mark.parametrize("name", ["critical_range", "seabed_range"])
def test_contacts_that_do_not_fit_are_refused_by_name(device, name):
    world = everywhere()
    inputs = world.inputs(device)
    setattr(inputs["contacts"], name, wp.zeros((12, 5), dtype=float, device=device))
    cells = wp.zeros(world.counts.shape, dtype=float, device=device)
    fields = [inputs["fan"], inputs["grid"], inputs["reading"], world.model(), inputs["contacts"], inputs["log_odds"]]
    with pytest.raises(ValueError, match=rf"contacts\.{name}: expected shape \(12, 6\), got \(12, 5\)"):
        arcs.estimate_arcs(*fields, cells, 4, estimate.Estimates(), device=device)


@pytest.mark.parametrize("name", estimate.ESTIMATE_TYPES)
def test_wrong_estimates_are_refused_by_name(device, name):
    world = everywhere()
    inputs = world.inputs(device)
    made = {n: wp.zeros((12, 6), dtype=dtype, device=device) for n, dtype in estimate.ESTIMATE_TYPES.items()}
    made[name] = wp.zeros((6, 12), dtype=estimate.ESTIMATE_TYPES[name], device=device)
    cells = wp.zeros(world.counts.shape, dtype=float, device=device)
    out = struct(estimate.Estimates, **made)
    fields = [inputs["fan"], inputs["grid"], inputs["reading"], world.model(), inputs["contacts"], inputs["log_odds"]]
    with pytest.raises(ValueError, match=rf"estimates_out\.{name}: expected shape \(12, 6\), got \(6, 12\)"):
        arcs.estimate_arcs(*fields, cells, 4, out, device=device)
