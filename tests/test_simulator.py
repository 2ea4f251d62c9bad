"""The simulator: results that do not depend on batch, chunking, threads or capture, and noise as stated."""

import math

import numpy as np
import pytest
import warp as wp

import sonarwarp as sw
from sonarwarp.simulator import seabed_echo
from sonarwarp_scenes import Extent, flat_seabed
from tests.small_runs import RIG, SETTINGS, run, scene, stream

NOISE = sw.Noise()


@pytest.fixture(scope="module", name="alone")
def alone_fixture(device):
    return stream([run()], [scene()], device=device, noise=NOISE, keys=[42], seed=3)


@pytest.mark.parametrize("case", ["batch", "one frame a round", "all in one round", "one thread"])
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
    }[case]
    found = stream([run()], [scene()], keys=[42], **options)
    assert np.array_equal(found[0], images)
    assert np.array_equal(found[1], echoes)


def test_seeds_and_keys_change_the_noise(alone, device):
    images = alone[0]
    for change in ({"seed": 4, "keys": [42]}, {"seed": 3, "keys": [43]}):
        other = stream([run()], [scene()], device=device, noise=NOISE, **change)[0]
        assert np.mean(other != images) > 0.9


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


def test_speckle_keeps_the_mean(device):
    clean = stream([run(length=1.0)], [scene()], device=device)[0].astype(np.float64)
    speckled = stream([run(length=1.0)], [scene()], device=device, noise=sw.Noise(background_db=None))[0]
    lit = clean > 0
    ratio = speckled[lit] / clean[lit]
    assert (speckled[~lit] == 0).all()
    # Six standard errors of the mean of unit Rayleigh variates.
    assert ratio.mean() == pytest.approx(1.0, abs=6 * math.sqrt((4 / math.pi - 1) / ratio.size))
    assert ratio.std() == pytest.approx(math.sqrt(4 / math.pi - 1), rel=0.05)


def test_background_stands_where_stated_under_the_seabeds_echo(device):
    noise = sw.Noise(speckle=False, background_db=-25.0)
    clean = stream([run(length=1.0)], [scene(front_x=9.0)], device=device)[0]
    noisy = stream([run(length=1.0)], [scene(front_x=9.0)], device=device, noise=noise)[0]
    dark = clean == 0
    edge = math.radians(25.0) + RIG.fls.half_elevation
    level = seabed_echo(RIG.fls.fan(device), 1.8, edge, RIG.fls.half_elevation) * 10 ** (-25 / 20)
    samples = int(dark.sum())
    assert noisy[dark].mean() == pytest.approx(level, rel=6 * math.sqrt((4 / math.pi - 1) / samples))


def test_seabed_echo_is_what_a_flat_seabed_leaves(device):
    ground = flat_seabed(Extent(x_min=-12.0, x_max=12.0, y_min=-4.0, y_max=4.0), impedance=1.5e6 * 1.35 / 0.65)
    images = stream([run(length=0.1)], [ground], device=device)[0]
    depression = math.radians(25.0)
    distance = 1.8 / math.sin(depression)
    edge = RIG.fls.range_edge
    bin_at = int(np.searchsorted(edge, distance)) - 1
    centre = 0.5 * (edge[bin_at] + edge[bin_at + 1])
    expected = seabed_echo(RIG.fls.fan(device), 1.8, math.asin(1.8 / centre), RIG.fls.half_elevation)
    # Reflection (z - z0) / (z + z0) is 0.35 here; off-centre beams see the seabed at a slightly lower depression.
    assert images[:, 5:7, bin_at] == pytest.approx(expected, rel=0.02)


def test_simulate_equals_the_rounds(alone, device):
    log = sw.simulate(RIG, scene(), run(), noise=NOISE, seed=3, device=device)
    found = stream([run()], [scene()], device=device, noise=NOISE, seed=3)
    assert np.array_equal(log.images, found[0])
    assert np.array_equal(log.echoes, found[1])


def test_a_trajectory_needs_a_scene(device):
    survey = sw.plan_survey(RIG, [run(), run()])
    schedule = sw.plan_schedule(survey, frames=8, window=SETTINGS.particles)
    simulator = sw.Simulator(RIG, device=device)
    with pytest.raises(ValueError, match=r"scene_of: .* must name one of 3 scenes for each of 2 trajectories"):
        simulator.plan(survey, [scene()] * 3, schedule, scene_of=[0, 3])
