"""What a beam's particles say: where its contact lies, how sure that is, and what is said where nothing is known."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from sonarwarp_kernels import estimate
from sonarwarp_kernels.slots import EMPTY
from sonarwarp_kernels.specs import Fan
from tests.arc_world import MIXTURE, UNDETECTED, ArcWorld, random_attitude, struct
from tests.reference import mixture as mixtures
from tests.reference import particles as reference
from tests.reference.field import cell_centres
from tests.reference.geometry import direction, quaternion

EPSILON = float(np.finfo(np.float32).eps)
NONE = int(estimate.QUALITY_NONE)
FALLBACK = int(estimate.QUALITY_FALLBACK)
INFORMED = int(estimate.QUALITY_INFORMED)
NARROW = {**MIXTURE, "weight_hit": 1.0, "weight_short": 0.0, "weight_random": 0.0, "weight_seabed": 0.0}


def arcs(world):
    """Every frame and beam."""
    return [(frame, beam) for frame in range(world.frames) for beam in range(world.beams)]


def evenly(world, log_odds):
    """The world with one value in every cell, all arcs inside."""
    counts = np.full((2, 60, 60, 60), log_odds * 65536, dtype=np.int32)
    origin = np.tile(world.position.mean(axis=0) - np.float32([6, 6, 6]), (2, 1))
    return replace(world, counts=counts, origin=origin, cell=0.2)


def with_blob(world, frame, beam, elevation, radius=0.15):
    """The world with one occupied ball on an arc and all else free."""
    azimuth, distance = float(world.azimuth[beam]), world.critical[frame, beam]
    centre = world.world_points(frame, direction(azimuth, elevation, bool(world.cone))[0], distance)
    owner = world.trajectory[frame]
    away = np.linalg.norm(cell_centres(world.inputs("cpu", [])["grid"], owner) - centre, axis=-1)
    counts = world.counts.copy()
    counts[owner] = np.where(away < radius, 20 * 65536, -20 * 65536)
    return replace(world, counts=counts), centre


# --- Where the contact lies ---


@pytest.mark.parametrize("cone", [0, 1])
@pytest.mark.parametrize("elevation", [-0.09, 0.0, 0.09])
def test_what_is_occupied_on_the_arc_draws_the_likeliest_point_and_the_mean_into_it(device, elevation, cone):
    world = ArcWorld.random(frames=2, low=-8.0, high=8.0, cell=0.05, cone=cone, mixture=NARROW)
    world = replace(
        world,
        counts=np.zeros((2, 60, 60, 60), dtype=np.int32),
        origin=world.position - np.float32([1.5, 1.5, 1.5]),
        critical=np.full((2, 4), 1.2),
    )
    for frame, beam in arcs(world):
        informed, centre = with_blob(world, frame, beam, elevation)
        got = {name: values[frame, beam] for name, values in informed.estimate(device, number=256).items()}
        assert got["quality"] == INFORMED
        for name in ("likely", "mean"):
            # The ball, and half a cell about it where the field is read between cells.
            assert np.linalg.norm(got[name] - centre) < 0.15 + 0.05
        assert abs(got["elevation"] - elevation) < 0.2 / 1.2
        # Fewer particles than all count: those in the ball.
        assert got["effective_size"] < 256
        inside = np.sqrt(np.trace(got["covariance"]))
        assert inside < 0.15


def test_the_likeliest_point_is_the_particle_of_the_greatest_target(device):
    # Some arcs through a field of noise find nothing much; let the point be the particle all the same.
    world = ArcWorld.random(informed=-4.0)
    distance, elevation, weight = world.sample(device, number=128)
    got = world.estimate(device, number=128)
    mixture = world.inputs(device, [])["mixture"]
    for frame, beam in arcs(world):
        critical = float(world.critical[frame, beam])
        start, end = reference.support(world.range_edge, world.seabed[frame, beam], critical)
        target = weight[frame, beam] * mixtures.density(mixture, critical, start, end, distance[frame, beam])
        chosen = np.flatnonzero(elevation[frame, beam] == got["elevation"][frame, beam])
        assert got["quality"][frame, beam] == INFORMED
        assert len(chosen) == 1
        # The hit's exponent errs by its size times epsilon.
        assert target[chosen[0]] >= target.max() * (1 - 100 * EPSILON)
        where = reference.points(world, frame, beam, distance[frame, beam][chosen], elevation[frame, beam][chosen])[0]
        np.testing.assert_allclose(got["likely"][frame, beam], where, atol=16 * EPSILON)


@pytest.mark.parametrize(("offset", "quality"), [(-0.01, INFORMED), (0.01, FALLBACK)])
def test_a_point_is_informed_where_its_particle_finds_enough(device, offset, quality):
    world = evenly(ArcWorld.random(informed=1.0 + offset), 1.0)
    assert np.all(world.estimate(device)["quality"] == quality)


# --- How sure it is ---


@pytest.mark.parametrize("number", [2, 64, 500])
@pytest.mark.parametrize("cone", [0, 1])
def test_moments_are_those_of_the_weighted_particles(device, number, cone):
    world = ArcWorld.random(cone=cone, mixture={**MIXTURE, "deviation": 0.2})
    distance, elevation, weight = (values.astype(np.float64) for values in world.sample(device, number=number))
    got = world.estimate(device, number=number)
    for frame, beam in arcs(world):
        r, e, w = (values[frame, beam] for values in (distance, elevation, weight))
        where = reference.points(world, frame, beam, r, e)
        size = np.sum(w) ** 2 / np.sum(w**2)
        # Sums of as many float32 terms, whose rounding adds up like a random walk; positions of some metres.
        terms = 4 * np.sqrt(number) * EPSILON
        spread = np.ptp(r) + np.ptp(e) * r.max()
        at = (frame, beam)
        np.testing.assert_allclose(got["mean"][at], np.average(where, axis=0, weights=w), atol=terms * spread + 1e-6)
        covariance = np.cov(where.T, aweights=w, ddof=0)
        np.testing.assert_allclose(got["covariance"][at], covariance, atol=terms * spread**2 + 1e-6 * spread)
        np.testing.assert_allclose(got["covariance"][at], got["covariance"][at].T, atol=terms * spread**2)
        mean = np.average(e, weights=w)
        assert got["elevation_mean"][at] == pytest.approx(mean, abs=terms * 0.12)
        variance = np.average((e - mean) ** 2, weights=w)
        assert got["elevation_deviation"][at] ** 2 == pytest.approx(variance, abs=terms * 0.12**2)
        assert got["effective_size"][at] == pytest.approx(size, rel=terms)


@pytest.mark.parametrize("cone", [0, 1])
def test_the_interval_of_elevation_is_normal_about_the_mean(device, cone):
    """As the paper's method knows no other shape: 1.96 deviations on either side."""
    world = ArcWorld.random(cone=cone)
    got = world.estimate(device, number=128)
    for end, side in (("low", -1.0), ("high", 1.0)):
        want = got["elevation_mean"] + side * 1.959964 * got["elevation_deviation"].astype(np.float64)
        np.testing.assert_allclose(got[f"elevation_{end}"], want, atol=2 * EPSILON * 0.5)
    assert np.all(got["elevation_high"] > got["elevation_low"])


def test_one_particle_is_its_own_mean_and_spreads_nowhere(device):
    world = ArcWorld.random()
    distance, elevation, _ = world.sample(device, number=1)
    got = world.estimate(device, number=1)
    for at in arcs(world):
        where = reference.points(world, *at, distance[at], elevation[at])[0]
        np.testing.assert_allclose(got["mean"][at], where, atol=16 * EPSILON)
        # A square and the square of a quotient, of an offset of up to 3 m.
        np.testing.assert_allclose(got["covariance"][at], np.zeros((3, 3)), atol=9 * 4 * EPSILON)
        assert got["elevation_deviation"][at] < 0.12 * 2 * np.sqrt(EPSILON)
        assert got["effective_size"][at] == 1.0


@pytest.mark.parametrize("low", [-4.0, -50.0, -80.0])
def test_a_field_that_is_free_all_over_leaves_all_particles_alike(device, low):
    world = evenly(ArcWorld.random(low=low), -100.0)
    got = world.estimate(device)
    assert np.all(got["quality"] == FALLBACK)
    # Weights as small as 1e-35 still weigh.
    np.testing.assert_allclose(got["effective_size"], 64, rtol=64 * EPSILON)
    assert np.all(np.isfinite(got["mean"]))
    assert np.all(np.isfinite(got["covariance"]))


# --- Where nothing is known ---


@pytest.mark.parametrize("cone", [0, 1])
def test_over_a_field_that_knows_nothing_points_fall_back_to_the_lower_edge(device, cone):
    world = ArcWorld.random(cone=cone).empty()
    got = world.estimate(device, number=256)
    _, elevation, _ = world.sample(device, number=256)
    assert np.all(got["quality"] == FALLBACK)
    assert np.all(got["effective_size"] == 256)
    assert np.all(got["elevation"] == -np.float32(world.half_elevation))
    for frame, beam in arcs(world):
        edge = direction(float(world.azimuth[beam]), -world.half_elevation, bool(cone))[0]
        want = world.world_points(frame, edge, world.critical[frame, beam])
        np.testing.assert_allclose(got["likely"][frame, beam], want, atol=16 * EPSILON)
    # The posterior is the prior: uniform over the beam, its deviation the height over sqrt(12).
    np.testing.assert_allclose(got["elevation_mean"], elevation.mean(axis=2), atol=1e-6)
    np.testing.assert_allclose(got["elevation_deviation"], 0.24 / np.sqrt(12), rtol=0.01)


def test_where_nothing_was_detected_only_the_quality_is_written(device):
    world = ArcWorld.random()
    critical = world.critical.copy()
    critical[1, [0, 2]] = UNDETECTED
    got = replace(world, critical=critical).estimate(device)
    nothing = critical == UNDETECTED
    assert np.all(got.pop("quality")[nothing] == NONE)
    for values in got.values():
        assert np.all(values[nothing] == 7)
        assert not np.any(values[~nothing] == 7)


def test_frames_in_no_slot_stay_untouched(device):
    for name, values in ArcWorld.random().estimate(device, slots=[EMPTY, 2, EMPTY]).items():
        assert np.all(values[:2] == 7), name
        assert not np.any(values[2] == 7), name


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("slots", [[0, 1, 2], [2, EMPTY, 0, 1]])
def test_estimates_do_not_depend_on_slots_or_threads(device, slots, threads):
    world = ArcWorld.random()
    batch = world.estimate(device, slots, threads=threads)
    for frame in range(world.frames):
        alone = world.estimate(device, [frame])
        assert all(np.array_equal(batch[name][frame], alone[name][frame]) for name in batch)


# --- The single-sonar method ---


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("cone", [0, 1])
def test_the_lower_edge_is_where_geometry_says_at_any_attitude(device, cone, threads):
    rng = np.random.default_rng(60)
    azimuth = np.radians([-40.0, -10.0, 0.0, 25.0])
    position = rng.uniform(-5, 5, (6, 3))
    orientation = [random_attitude(rng) for _ in range(6)]
    critical = rng.uniform(1, 5, (6, 4))
    critical[2, 1] = critical[5, 3] = UNDETECTED
    fan = struct(Fan, azimuth=wp.array(azimuth, dtype=float, device=device), elevation_min=-0.12, cone=cone)
    poses = [[*p, *quaternion(o)] for p, o in zip(position, orientation, strict=True)]
    out = wp.full((6, 4), 7.0, dtype=wp.vec3, device=device)
    estimate.place_at_lower_edge(
        fan,
        wp.array(poses, dtype=wp.transform, device=device),
        wp.array(critical, dtype=float, device=device),
        out,
        device=device,
        threads=threads,
    )
    # Turned to the beam, then lowered, or lowered, then turned: closed forms of both kinds.
    ce, se = np.cos(0.12), -np.sin(0.12)
    ca, sa = np.cos(azimuth), np.sin(azimuth)
    flat = np.ones(4)
    local = np.stack([ca * ce, sa, ca * se] if cone else [ca * ce, sa * ce, se * flat], axis=-1)
    want = position[:, None] + critical[..., None] * np.einsum("fij,bj->fbi", orientation, local)
    want[critical == UNDETECTED] = 7.0
    # Positions of up to 10 m.
    np.testing.assert_allclose(out.numpy(), want, atol=16 * EPSILON * 2)


# --- Refusals ---


@pytest.mark.parametrize("name", estimate.ESTIMATE_TYPES)
def test_wrong_estimates_are_refused_by_name(device, name):
    world = ArcWorld.random()
    made = {n: wp.zeros((3, 4), dtype=dtype, device=device) for n, dtype in estimate.ESTIMATE_TYPES.items()}
    made[name] = wp.zeros((4, 3), dtype=estimate.ESTIMATE_TYPES[name], device=device)
    message = rf"estimates_out\.{name}: expected shape \(3, 4\), got \(4, 3\)"
    with pytest.raises(ValueError, match=message):
        estimate.estimate_points(
            **world.inputs(device, [0]), particles=8, estimates_out=struct(estimate.Estimates, **made), device=device
        )


@pytest.mark.parametrize("number", [0, -1])
def test_fewer_than_one_particle_is_refused(device, number):
    with pytest.raises(ValueError, match=f"particles: {number}, must be at least 1"):
        ArcWorld.random().estimate(device, number=number)


@pytest.mark.parametrize(
    ("wrong", "shape", "dtype", "message"),
    [
        ("slot_frame", (3, 1), int, r"slot_frame: expected shape \(any,\), got \(3, 1\)"),
        ("log_odds", (2, 60, 60, 31), int, r"log_odds: expected shape \(2, 60, 60, 30\), got \(2, 60, 60, 31\)"),
    ],
)
def test_wrong_arrays_are_refused_by_name(device, wrong, shape, dtype, message):
    inputs = ArcWorld.random().inputs(device, [0])
    inputs[wrong] = wp.zeros(shape, dtype=dtype, device=device)
    with pytest.raises(ValueError, match=message):
        estimate.estimate_points(**inputs, particles=8, estimates_out=estimate.Estimates(), device=device)


@pytest.mark.parametrize(
    ("wrong", "shape", "dtype", "message"),
    [
        ("world_from_sensor", (6, 1), wp.transform, r"world_from_sensor: expected shape \(any,\), got \(6, 1\)"),
        ("critical_range", (4, 6), float, r"critical_range: expected shape \(6, 4\), got \(4, 6\)"),
        ("point_out", (6, 4), float, "point_out: expected dtype vec3f, got float32"),
    ],
)
def test_wrong_arrays_of_the_lower_edge_are_refused_by_name(device, wrong, shape, dtype, message):
    arrays = {
        "world_from_sensor": wp.zeros(6, dtype=wp.transform, device=device),
        "critical_range": wp.zeros((6, 4), dtype=float, device=device),
        "point_out": wp.zeros((6, 4), dtype=wp.vec3, device=device),
    }
    arrays[wrong] = wp.zeros(shape, dtype=dtype, device=device)
    fan = struct(Fan, azimuth=wp.zeros(4, dtype=float, device=device))
    with pytest.raises(ValueError, match=message):
        estimate.place_at_lower_edge(fan, **arrays, device=device)
    with pytest.raises(ValueError, match=r"fan\.azimuth: expected a warp array, got NoneType"):
        estimate.place_at_lower_edge(Fan(), **arrays, device=device)
