"""The simulator: results that do not depend on batch, chunking, threads or capture, and noise as stated."""

import math
from dataclasses import replace

import numpy as np
import pytest
import warp as wp

import sonarwarp as sw
from sonarwarp.simulator import seabed_echo
from sonarwarp_scenes import Extent, flat_seabed
from tests.small_logs import same_survey
from tests.small_runs import RIG, SETTINGS, allocations, none_of, run, same_points, scene, stream

NOISE = sw.Noise()


@pytest.fixture(scope="module", name="alone")
def alone_fixture(device):
    return stream([run()], [scene()], device=device, noise=NOISE, keys=[42], seed=3)


@pytest.mark.parametrize("case", ["batch", "one frame a round", "all in one round", "one thread", "five threads"])
def test_a_run_has_its_bits_however_it_is_computed(alone, device, case):
    images, echoes, _, _ = alone
    options = {"device": device, "noise": NOISE, "seed": 3}
    if case == "batch":
        runs, scenes = [run(start_x=-2.9, length=0.5, altitude=1.6), run()], [scene(front_x=0.4), scene()]
        found = stream(runs, scenes, keys=[7, 42], **options)
        survey = sw.plan_survey(RIG, runs)
        mine, sent = survey.frames.trajectory == 1, survey.pings.trajectory == 1
        assert np.array_equal(found[0][mine], images)
        assert np.array_equal(found[1][sent], echoes)
        assert not np.array_equal(found[0][: len(images)], images)
        return
    options |= {
        "one frame a round": {"frames": 1},
        "all in one round": {"frames": 1000},
        "one thread": {"threads": 1},
        "five threads": {"threads": 5},
    }[case]
    found = stream([run()], [scene()], keys=[42], **options)
    assert np.array_equal(found[0], images)
    assert np.array_equal(found[1], echoes)


def test_seeds_and_keys_change_the_noise(alone, device):
    images, echoes = alone[:2]
    for change in ({"seed": 4, "keys": [42]}, {"seed": 3, "keys": [43]}):
        other = stream([run()], [scene()], device=device, noise=NOISE, **change)
        assert np.mean(other[0] != images) > 0.9
        assert np.mean(other[1] != echoes) > 0.9


def test_frames_and_sonars_draw_noise_of_their_own(device):
    """Where both sonars hear background alone, what one bin holds says nothing of another frame or sonar."""
    noise = sw.Noise(speckle=False)
    clean = stream([run()], [scene(front_x=9.0)], device=device)
    noisy = stream([run()], [scene(front_x=9.0)], device=device, noise=noise)
    dark = min(int(np.argmax((rows > 0).any(axis=tuple(range(rows.ndim - 1))))) for rows in clean[:2])
    assert dark > 20
    frames, pings = noisy[0][:, 0, :dark], noisy[1][:, :dark]
    count = min(len(frames), len(pings))
    others = {"sonar": pings[:count], "frame": np.roll(frames, 1, axis=0)[:count], "beam": noisy[0][:count, 1, :dark]}
    for name, other in others.items():
        # Six standard errors of the correlation of independent samples.
        correlation = np.corrcoef(frames[:count].ravel(), other.ravel())[0, 1]
        assert abs(correlation) < 6 / math.sqrt(other.size), name


def planned(device, noise=NOISE, frames=8):
    survey = sw.plan_survey(RIG, [run()])
    schedule = sw.plan_schedule(survey, frames=frames, window=6)
    simulator = sw.Simulator(RIG, noise=noise, device=device)
    simulator.plan(survey, [scene()], schedule, seed=3, trajectory_keys=[42])
    return simulator, schedule


def test_reset_replays_bit_for_bit(device):
    simulator, schedule = planned(device)
    first = []
    for _ in range(schedule.rounds):
        simulator.step()
        first.append([values.copy() for values in simulator.read()])
    simulator.reset()
    for images, echoes in first:
        simulator.step()
        again = simulator.read()
        assert np.array_equal(again[0], images)
        assert np.array_equal(again[1], echoes)


def test_a_captured_step_replays_every_round(device):
    simulator, schedule = planned(device)
    eager = []
    for _ in range(schedule.rounds):
        simulator.step()
        eager.append([values.copy() for values in simulator.read()])
    simulator.reset()
    with wp.ScopedCapture(device=device) as capture:
        simulator.step()
    simulator.reset()
    for images, echoes in eager:
        wp.capture_launch(capture.graph)
        replayed = simulator.read()
        assert np.array_equal(replayed[0], images)
        assert np.array_equal(replayed[1], echoes)


def test_rounds_allocate_nothing(device):
    simulator, schedule = planned(device)
    simulator.step()

    def work():
        simulator.reset()
        for _ in range(schedule.rounds):
            simulator.step()

    assert allocations(work) == allocations(lambda: None)
    assert allocations(lambda: wp.zeros(1, dtype=int, device=device)) != allocations(lambda: None)


@pytest.mark.parametrize("kind", ["frames", "pings"])
def test_one_sonar_alone_has_the_bits_that_it_has_beside_the_other(device, kind):
    survey = sw.plan_survey(RIG, [run()])
    survey = replace(survey, **{kind: none_of(getattr(survey, kind))})
    schedule = sw.plan_schedule(survey, frames=8, window=6)
    # The background follows the frames' altitude, so it is left out.
    noise = sw.Noise(background_db=None)
    simulator = sw.Simulator(RIG, noise=noise, device=device)
    simulator.plan(survey, [scene()], schedule, seed=3, trajectory_keys=[42])
    images, echoes, *_ = stream([run()], [scene()], device=device, noise=noise, keys=[42], seed=3)
    for frame, ping in zip(schedule.round_frame, schedule.round_ping, strict=True):
        simulator.step()
        round_images, round_echoes = simulator.read()
        assert np.array_equal(round_images[frame >= 0], images[frame[frame >= 0]])
        assert np.array_equal(round_echoes[ping >= 0], echoes[ping[ping >= 0]])


def test_speckle_keeps_the_mean(device):
    clean = stream([run(length=1.0)], [scene()], device=device)[0].astype(np.float64)
    speckled = stream([run(length=1.0)], [scene()], device=device, noise=sw.Noise(background_db=None))[0]
    lit = clean > 0
    ratio = speckled[lit] / clean[lit]
    assert (speckled[~lit] == 0).all()
    # Six standard errors of the mean of unit Rayleigh variates.
    assert ratio.mean() == pytest.approx(1.0, abs=6 * math.sqrt((4 / math.pi - 1) / ratio.size))
    assert ratio.std() == pytest.approx(math.sqrt(4 / math.pi - 1), rel=0.05)


@pytest.mark.parametrize("sonar", ["FLS", "PS"])
def test_background_stands_where_stated_under_the_seabeds_echo(device, sonar):
    clean, noisy = (
        stream([run(length=1.0)], [scene(front_x=9.0)], device=device, noise=noise)[sonar == "PS"]
        for noise in (sw.NO_NOISE, sw.Noise(speckle=False, background_db=-25.0))
    )
    tilt, fls, ps = math.radians(25.0), RIG.fls, RIG.ps
    level = {
        "FLS": lambda: seabed_echo(fls.fan(device), 1.8, tilt + fls.half_elevation, fls.half_elevation),
        "PS": lambda: seabed_echo(ps.fan(device), 1.8, tilt, math.radians(ps.beamwidth_deg) / 2),
    }[sonar]() * 10 ** (-25 / 20)
    # Six standard errors of the mean of unit Rayleigh variates.
    tolerance = 6 * math.sqrt((4 / math.pi - 1) / clean.size)
    assert (noisy - clean).mean() == pytest.approx(level, rel=tolerance)
    assert tolerance < 0.05


def test_seabed_echo_is_what_a_flat_seabed_leaves(device):
    """From r_emin, where the beam's lower edge meets the seabed, through the whole window."""
    ground = flat_seabed(Extent(x_min=-12.0, x_max=12.0, y_min=-4.0, y_max=4.0), impedance=1.5e6 * 1.35 / 0.65)
    # The middle beam looks straight ahead; reflection (z - z0) / (z + z0) is 0.35 here.
    fls = replace(RIG.fls, azimuth_edge=np.radians([-0.75, -0.25, 0.25, 0.75]), intervals=64)
    rig = replace(RIG, fls=fls)
    image = stream([run(length=0.1)], [ground], device=device, rig=rig)[0][0, 1].astype(np.float64)
    lower = math.radians(25.0) + fls.half_elevation
    r_emin = 1.8 / math.sin(lower)
    edge = fls.range_edge
    centre = 0.5 * (edge[:-1] + edge[1:])
    onset = int(np.searchsorted(edge, r_emin)) - 1
    assert not image[:onset].any()
    fan = fls.fan(device)
    expected = np.array([seabed_echo(fan, 1.8, math.asin(1.8 / r), fls.half_elevation) for r in centre[onset + 1 :]])
    assert len(expected) > 50
    # Images of this quality are 1.5 % right as a whole; a plane bin by bin.
    assert image[onset + 1 :] == pytest.approx(expected, rel=0.01)
    lit = (edge[onset + 1] - r_emin) / (edge[onset + 1] - edge[onset])
    assert image[onset] == pytest.approx(lit * seabed_echo(fan, 1.8, lower, fls.half_elevation), rel=0.05)


@pytest.mark.parametrize("frames", [1, 3, 1000])
def test_simulate_equals_the_rounds_in_any_memory(device, frames):
    memory = frames * RIG.fls.beams * RIG.fls.bins * 16
    log = sw.simulate(RIG, scene(), run(), noise=NOISE, seed=3, device=device, memory=memory)
    found = stream([run()], [scene()], device=device, noise=NOISE, seed=3)
    assert np.array_equal(log.images, found[0])
    assert np.array_equal(log.echoes, found[1])


def test_echoes_come_from_where_the_sonars_are_and_the_log_says_where_they_seem(device):
    way = {"motion": sw.Motion(), "navigation": sw.Navigation(), "seed": 3}
    true, believed = sw.plan_disturbed(RIG, [run()], **way)
    log = sw.simulate(RIG, scene(), run(), **way, device=device)
    assert same_survey(log.survey, believed)
    assert log.truth is not None
    assert same_survey(log.truth, true)
    schedule = sw.plan_schedule(true, frames=8, window=6)
    simulator = sw.Simulator(RIG, device=device)
    simulator.plan(true, [scene()], schedule, seed=3)
    simulator.step()
    frame = schedule.round_frame[0][schedule.round_frame[0] >= 0]
    assert np.array_equal(simulator.read()[0][: len(frame)], log.images[frame])


def test_only_the_estimate_is_reconstructed_from(device):
    log = sw.simulate(RIG, scene(), run(), motion=sw.Motion(), navigation=sw.Navigation(), seed=3, device=device)
    blind = replace(log, truth=None)
    one, other = (sw.reconstruct(each, settings=SETTINGS, device=device).fused for each in (log, blind))
    assert len(one) > 50
    assert same_points(one, other)
    exact = sw.reconstruct(replace(log, survey=log.truth), settings=SETTINGS, device=device).fused
    assert not same_points(one, exact)
    assert log.truth is not None
    short = replace(log.truth, frames=none_of(log.truth.frames))
    with pytest.raises(ValueError, match=r"SonarLog\.truth\.frames: other rows than survey\.frames"):
        replace(log, truth=short)


def test_a_trajectory_needs_a_scene(device):
    survey = sw.plan_survey(RIG, [run(), run()])
    schedule = sw.plan_schedule(survey, frames=8, window=SETTINGS.particles)
    simulator = sw.Simulator(RIG, device=device)
    with pytest.raises(ValueError, match=r"scene_of: .* must name one of 3 scenes for each of 2 trajectories"):
        simulator.plan(survey, [scene()] * 3, schedule, scene_of=[0, 3])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"seed": -1}, r"seed: -1, must be at least 0 and under 2\*\*64"),
        ({"seed": 2**64}, r"seed: 18446744073709551616, must be at least 0"),
        ({"trajectory_keys": [1, 2]}, r"trajectory_keys: expected 1, got 2"),
        ({"trajectory_keys": [-3]}, r"trajectory_keys: -3, must be at least 0"),
    ],
)
def test_seeds_and_keys_out_of_bounds_are_refused_by_name(device, options, message):
    survey = sw.plan_survey(RIG, [run(length=0.1)])
    schedule = sw.plan_schedule(survey, frames=8, window=6)
    with pytest.raises(ValueError, match=message):
        sw.Simulator(RIG, device=device).plan(survey, [scene()], schedule, **options)
