"""Particles: ranges after Eq. 9, stratified elevations, weights from the field, draws that only their key decides."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from scipy import stats

from sonarwarp_kernels import particles
from sonarwarp_kernels.slots import EMPTY
from sonarwarp_kernels.specs import Fan, Grid
from tests.arc_world import MIXTURE, OUTPUTS, UNDETECTED, ArcWorld, struct
from tests.reference import mixture as mixtures
from tests.reference import particles as reference

EPSILON = float(np.finfo(np.float32).eps)


# --- What is drawn ---


@pytest.mark.parametrize("cone", [0, 1])
def test_particles_match_the_oracle(device, cone):
    world = ArcWorld.random(cone=cone)
    distance, elevation, weight = world.sample(device, number=32)
    assert np.mean(weight != 0.5) > 0.75, "most arcs must pass through the fields"
    for frame in range(world.frames):
        for beam in range(world.beams):
            want_distance, want_elevation = reference.draw(world, frame, beam, 32)
            np.testing.assert_allclose(elevation[frame, beam], want_elevation, atol=4 * EPSILON)
            # Quantiles in a tail of the hit, of 1 cm, move by 1e-5 of it; a range of 5 m rounds by half an epsilon.
            np.testing.assert_allclose(distance[frame, beam], want_distance, atol=16 * EPSILON)
            where = reference.points(world, frame, beam, distance[frame, beam], elevation[frame, beam])
            log_odds = reference.log_odds(world, frame, where)
            # Positions of some metres in cells of 10 cm whose log-odds differ by up to 10.
            want = 1 / (1 + np.exp(-log_odds))
            np.testing.assert_allclose(weight[frame, beam], want, atol=4 * 4 * EPSILON / 0.1 * 10 / 4)


@pytest.mark.parametrize("number", [1, 7, 256])
def test_every_elevation_has_its_own_equal_part_of_the_beam(device, number):
    world = ArcWorld.random()
    _, elevation, _ = world.sample(device, number=number)
    part = (elevation / world.half_elevation + 1) / 2 * number
    # A part's border may round into it.
    assert np.all(np.abs(part - (np.arange(number) + 0.5)) <= 0.5 + number * EPSILON)


def test_elevations_are_uniform_and_independent_of_ranges(device):
    world = ArcWorld.random(frames=8).empty()
    distance, elevation, _ = world.sample(device, number=256)
    part = (elevation / world.half_elevation + 1) / 2
    # Within its part of the beam every elevation is anywhere.
    within = (part * 256) % 1.0
    assert stats.kstest(within.ravel(), "uniform").pvalue > 1e-3
    beams = zip(distance.reshape(-1, 256), within.reshape(-1, 256), strict=True)
    correlation = [np.corrcoef(stats.rankdata(ranges), places)[0, 1] for ranges, places in beams]
    assert abs(np.mean(correlation)) < 5 / np.sqrt(distance.size)


def shares_below(device, frames, number):
    """Share of Eq. 9 below each range drawn, and its weight, over fields that know nothing."""
    world = ArcWorld.random(frames=frames, mixture={**MIXTURE, "weight_hit": 0.3, "weight_random": 0.65}).empty()
    mixture = world.inputs(device, [])["mixture"]
    distance, _, weight = world.sample(device, number=number)
    share = np.empty_like(distance)
    for frame in range(world.frames):
        for beam in range(world.beams):
            critical = float(world.critical[frame, beam])
            start, end = reference.support(world.range_edge, world.seabed[frame, beam], critical)
            share[frame, beam] = mixtures.share_below(mixture, critical, start, end, distance[frame, beam])
    return share.ravel(), weight.ravel()


def test_over_a_field_that_knows_nothing_weighted_ranges_follow_equation_9(device):
    share, weight = shares_below(device, 10, 256)
    assert np.all(weight == 0.5)
    # At a level of 0.1 %, with keys that never change.
    assert stats.kstest(share, "uniform").pvalue > 1e-3


@pytest.mark.nightly
def test_over_a_field_that_knows_nothing_many_weighted_ranges_follow_equation_9(device):
    share, weight = shares_below(device, 100, 2048)
    histogram, _ = np.histogram(share, bins=100, range=(0, 1), weights=weight)
    counts = histogram / 0.5
    assert stats.chisquare(counts).pvalue > 1e-3


@pytest.mark.parametrize(
    ("seabed", "critical", "end"),
    [(4.0, 3.0, 4.0), (2.5, 3.0, 3.0), (9.0, 3.0, 5.5), (np.inf, 3.0, 5.5)],
)
def test_ranges_lie_between_the_window_s_start_and_the_seabed_s_or_the_detection_beyond_it(
    device, seabed, critical, end
):
    world = ArcWorld.random(frames=1)
    world = replace(world, seabed=np.full((1, 4), seabed), critical=np.full((1, 4), critical))
    world = replace(world, mixture={**MIXTURE, "weight_hit": 0.1, "weight_random": 0.85})
    distance, _, _ = world.sample(device, number=1000)
    assert distance.min() >= 0.5
    assert distance.min() < 0.52
    assert end - 0.02 < distance.max() <= end


def test_the_weight_is_the_field_s_occupancy_at_the_particle(device):
    # Left of the sonar all is occupied, right of it free, and nobody has looked beyond the box.
    world = ArcWorld.random(frames=1, trajectories=1)
    counts = np.zeros_like(world.counts)
    counts[:, :, 30:] = 20 * 65536
    counts[:, :, :30] = -20 * 65536
    world = replace(
        world,
        counts=counts,
        orientation=np.eye(3)[None],
        position=np.float32([[-2, 0, 1.5]]),
        critical=np.float32([[3, 3, 9, UNDETECTED]]),
        seabed=np.full((1, 4), 20.0, dtype=np.float32),
        azimuth=np.float32([-0.25, 0.25, 0.1, 0.0]),
        range_edge=np.linspace(0.5, 12, 24, dtype=np.float32),
        mixture={**MIXTURE, "weight_hit": 1.0, "weight_short": 0, "weight_random": 0, "weight_seabed": 0},
    )
    weight = world.sample(device)[2][0]
    expected = [1 / (1 + np.exp(4.0)), 1 / (1 + np.exp(-6.0)), 0.5, 0.0]
    np.testing.assert_allclose(weight, np.tile(expected, (64, 1)).T, rtol=8 * EPSILON)


# --- Where nothing is drawn ---


def test_beams_without_a_detection_and_empty_slots_have_no_weight_and_stay_untouched(device):
    world = ArcWorld.random()
    critical = world.critical.copy()
    critical[1, [0, 2]] = UNDETECTED
    distance, elevation, weight = replace(world, critical=critical).sample(device, slots=[1, EMPTY, 0])
    nothing = np.zeros((3, 4), dtype=bool)
    nothing[0, [0, 2]] = nothing[1] = True
    assert np.all(weight[nothing] == 0.0)
    assert np.all(weight[~nothing] > 0.0)
    for values in (distance, elevation):
        assert np.all(values[nothing] == -7.0)
        assert not np.any(values[~nothing] == -7.0)


# --- Keys ---


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("slots", [[0, 1, 2], [2, EMPTY, 0, 1], [1], [2, 0]])
def test_a_frame_s_particles_do_not_depend_on_what_is_drawn_beside_them(device, slots, threads):
    world = ArcWorld.random()
    drawn = world.sample(device, slots, threads=threads)
    for slot, frame in enumerate(slots):
        if frame != EMPTY:
            alone = world.sample(device, [frame])
            assert all(np.array_equal(batch[slot], single[0]) for batch, single in zip(drawn, alone, strict=True))


def test_a_frame_s_particles_do_not_depend_on_its_place_in_the_batch(device):
    world = ArcWorld.random()
    order = [2, 0, 1]
    shuffled = replace(
        world,
        **{
            name: getattr(world, name)[order]
            for name in ("orientation", "position", "critical", "seabed", "key", "trajectory")
        },
    )
    for batch, moved in zip(world.sample(device), shuffled.sample(device), strict=True):
        assert np.array_equal(batch[order], moved)


def test_another_frame_key_draws_other_particles(device):
    world = ArcWorld.random(frames=2, trajectories=1)
    # One contact twice, all but for its key.
    twin = replace(world, **{name: getattr(world, name)[[0, 0]] for name in ("orientation", "position", "critical")})
    twin = replace(twin, seabed=world.seabed[[0, 0]], trajectory=world.trajectory[[0, 0]]).empty()
    distance, elevation, _ = twin.sample(device, number=256)
    for values in (distance, elevation):
        assert np.mean(values[0] == values[1]) < 0.02
    # Beams share a frame's key and must not share draws either.
    same = replace(twin, critical=np.full((2, 4), 3.0), seabed=np.full((2, 4), 4.0)).sample(device, number=256)
    for values in same[:2]:
        assert len(np.unique(values)) > 0.9 * values.size


# --- Refusals ---


CONTACTS = [
    ("trajectory", (2,), int, r"contacts\.key: expected shape \(2,\), got \(3,\)"),
    ("key", (2,), wp.uint64, r"contacts\.key: expected shape \(3,\), got \(2,\)"),
    ("world_from_sensor", (4,), wp.transform, r"contacts\.world_from_sensor: expected shape \(3,\), got \(4,\)"),
    ("seabed_range", (3, 5), float, r"contacts\.seabed_range: expected shape \(3, 4\), got \(3, 5\)"),
    ("critical_range", (4, 3), float, r"contacts\.critical_range: expected shape \(3, 4\), got \(4, 3\)"),
]


@pytest.mark.parametrize(("wrong", "shape", "dtype", "message"), CONTACTS)
def test_wrong_contacts_are_refused_by_name(device, wrong, shape, dtype, message):
    inputs = ArcWorld.random().inputs(device, [0])
    setattr(inputs["contacts"], wrong, wp.zeros(shape, dtype=dtype, device=device))
    out = {name: wp.zeros((1, 4, 8), dtype=float, device=device) for name in OUTPUTS}
    with pytest.raises(ValueError, match=message):
        particles.sample_particles(**inputs, **out, device=device)


@pytest.mark.parametrize(
    ("wrong", "shape", "dtype", "message"),
    [
        ("slot_frame", (1, 1), int, r"slot_frame: expected shape \(any,\), got \(1, 1\)"),
        ("log_odds", (1, 60, 60, 30), int, r"log_odds: expected shape \(2, 60, 60, 30\), got \(1, 60, 60, 30\)"),
        ("range_out", (1, 3, 8), float, r"range_out: expected shape \(1, 4, any\), got \(1, 3, 8\)"),
        ("range_out", (1, 4), float, r"range_out: expected shape \(1, 4, any\), got \(1, 4\)"),
        ("elevation_out", (1, 4, 9), float, r"elevation_out: expected shape \(1, 4, 8\), got \(1, 4, 9\)"),
        ("weight_out", (1, 4, 8), int, "weight_out: expected dtype float32, got int32"),
    ],
)
def test_wrong_arrays_are_refused_by_name(device, wrong, shape, dtype, message):
    arrays = ArcWorld.random().inputs(device, [0])
    arrays |= {name: wp.zeros((1, 4, 8), dtype=float, device=device) for name in OUTPUTS}
    arrays[wrong] = wp.zeros(shape, dtype=dtype, device=device)
    with pytest.raises(ValueError, match=message):
        particles.sample_particles(**arrays, device=device)


def refuse(device, message, **changed):
    inputs = ArcWorld.random().inputs(device, [0]) | changed
    with pytest.raises(ValueError, match=message):
        particles.check_inputs(**inputs, device=device)


def test_a_sonar_without_beams_or_bins_and_a_grid_without_boxes_are_refused_by_name(device):
    azimuth, edge = (wp.zeros(number, dtype=float, device=device) for number in (4, 1))
    refuse(device, r"fan\.azimuth: expected a warp array, got NoneType", fan=Fan())
    refuse(device, r"fan\.range_edge: expected a warp array, got NoneType", fan=struct(Fan, azimuth=azimuth))
    refuse(device, r"fan\.range_edge: needs at least 2 edges, got 1", fan=struct(Fan, azimuth=azimuth, range_edge=edge))
    refuse(device, r"grid\.origin: expected a warp array, got NoneType", grid=struct(Grid, cell=0.1))


@pytest.mark.parametrize(
    ("clamps", "message"),
    [
        ({"low": 1.0, "high": 0.5}, r"reading\.low: must lie between -80 and reading\.high = 0\.5, got 1"),
        ({"low": -81.0, "high": 0.5}, r"reading\.low: must lie between -80 and reading\.high = 0\.5, got -81"),
        ({"low": float("nan"), "high": 0.5}, r"reading\.low: must lie between .*, got nan"),
    ],
)
def test_clamps_out_of_order_are_refused_by_name(device, clamps, message):
    refuse(device, message, reading=struct(particles.Reading, informed=0.1, **clamps))


def test_a_mixture_that_is_no_density_is_refused_by_name(device):
    mixture = ArcWorld.random(mixture={**MIXTURE, "weight_hit": 0.5}).inputs(device, [0])["mixture"]
    refuse(device, "mixture: weights must sum to 1, got 0.6", mixture=mixture)
