"""The reconstructor: results that do not depend on batch, chunking, threads or capture; causality; bad input."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

import sonarwarp as sw
from tests.small_runs import RIG, SETTINGS, run, same_points, scene, stream

NOISE = sw.Noise()


@pytest.fixture(scope="module", name="alone")
def alone_fixture(device):
    found = stream([run()], [scene()], device=device, noise=NOISE, keys=[42], seed=3)
    assert len(found[2].fused) > 40
    assert (found[2].fused.attributes["quality"] == 2).any()
    return found


@pytest.mark.parametrize("case", ["batch", "one frame a round", "all in one round", "one thread"])
def test_a_run_has_its_bits_however_it_is_computed(alone, device, case):
    clouds = alone[2]
    options = {"device": device, "noise": NOISE, "seed": 3}
    if case == "batch":
        runs, scenes = [run(start_x=-2.9, length=0.5, altitude=1.6), run()], [scene(front_x=0.4), scene()]
        found = stream(runs, scenes, keys=[7, 42], **options)[2]
        mine = found.fused.attributes["trajectory"] == 1
        # The box of a batch is the largest one's; its origin and cells are the same, so are the bits.
        assert same_points(clouds.fused, found.fused, mine)
        assert same_points(clouds.single, found.single, mine)
        return
    options |= {
        "one frame a round": {"frames": 1},
        "all in one round": {"frames": 1000},
        "one thread": {"threads": 1},
    }[case]
    found = stream([run()], [scene()], keys=[42], **options)[2]
    assert same_points(clouds.fused, found.fused)
    assert same_points(clouds.single, found.single)


def replayed(device, by_graph):
    survey = sw.plan_survey(RIG, [run()])
    reconstructor = sw.Reconstructor(RIG, settings=SETTINGS, device=device)
    schedule = sw.plan_schedule(survey, frames=8, window=reconstructor.window)
    simulator = sw.Simulator(RIG, noise=NOISE, device=device)
    simulator.plan(survey, [scene()], schedule, seed=3, trajectory_keys=[42])
    reconstructor.plan(survey, schedule, seed=3, trajectory_keys=[42])

    def step():
        simulator.step()
        reconstructor.step(simulator.images, simulator.echoes)

    if by_graph:
        # Modules must be loaded before a capture: one eager round does that.
        step()
        with wp.ScopedCapture(device=device) as capture:
            step()

        def step():
            wp.capture_launch(capture.graph)

    for _ in range(2):
        simulator.reset()
        reconstructor.reset()
        for _ in range(schedule.rounds):
            step()
    return reconstructor.read()


@pytest.mark.parametrize("by_graph", [False, True], ids=["eager", "graph"])
def test_reset_and_graphs_replay_bit_for_bit(alone, device, by_graph):
    found = replayed(device, by_graph)
    assert same_points(alone[2].fused, found.fused)
    assert same_points(alone[2].single, found.single)


def test_later_pings_do_not_change_earlier_points(device):
    log = sw.simulate(RIG, scene(), run(), noise=NOISE, seed=3, device=device)
    whole = sw.reconstruct(log, settings=SETTINGS, device=device).fused
    kept = log.survey.pings.time <= 1.6
    pings = log.survey.pings
    shorter = sw.Pings(
        time=pings.time[kept],
        trajectory=pings.trajectory[kept],
        number=pings.number[kept],
        pose=pings.pose[kept],
        head_angle=pings.head_angle[kept],
    )
    cut = sw.SonarLog(survey=replace(log.survey, pings=shorter), images=log.images, echoes=log.echoes[kept])
    part = sw.reconstruct(cut, settings=SETTINGS, device=device).fused
    following = pings.time[~kept].min()
    early, late = (cloud.select(cloud.attributes["time"] < following) for cloud in (whole, part))
    assert len(early) > 10
    assert same_points(early, late)
    assert not same_points(whole, part)


def test_offline_asks_the_later_pings_too(alone, device):
    found = stream(
        [run()], [scene()], device=device, noise=NOISE, keys=[42], seed=3, settings=replace(SETTINGS, causal=False)
    )[2]
    assert np.array_equal(found.single.points, alone[2].single.points)
    assert not np.array_equal(found.fused.points, alone[2].fused.points)


def test_the_window_forgets_exactly(device):
    """The field after a long run equals the one built from the last window's pings alone."""
    log = sw.simulate(RIG, scene(), run(length=0.6), noise=NOISE, seed=3, device=device)
    fields = []
    window = sw.Reconstructor(RIG, settings=SETTINGS, device=device).window
    pings = log.survey.pings
    assert len(pings) > 2 * window
    for kept in (np.ones(len(pings), dtype=bool), np.arange(len(pings)) >= len(pings) - window):
        survey = replace(
            log.survey,
            pings=sw.Pings(
                time=pings.time[kept],
                trajectory=pings.trajectory[kept],
                number=pings.number[kept],
                pose=pings.pose[kept],
                head_angle=pings.head_angle[kept],
            ),
        )
        reconstructor = sw.Reconstructor(RIG, settings=SETTINGS, device=device)
        schedule = sw.plan_schedule(survey, frames=8, window=window)
        reconstructor.plan(survey, schedule)
        for frame, ping in zip(schedule.round_frame, schedule.round_ping, strict=True):
            images = wp.array(log.images[frame], dtype=float, device=device)
            echoes = wp.array(log.echoes[kept][ping], dtype=float, device=device)
            reconstructor.step(images, echoes)
        fields.append(reconstructor.log_odds.numpy())
    assert np.array_equal(fields[0], fields[1])
    assert (fields[0] != 0).any()


def test_reconstruct_equals_the_rounds(device):
    log = sw.simulate(RIG, scene(), run(), noise=NOISE, seed=3, device=device)
    whole = sw.reconstruct(log, settings=SETTINGS, seed=3, device=device)
    found = stream([run()], [scene()], device=device, noise=NOISE, seed=3)[2]
    assert same_points(whole.fused, found.fused)
    assert same_points(whole.single, found.single)


def test_clouds_say_what_they_know(alone):
    fused, single = alone[2].fused, alone[2].single
    assert len(fused) == len(single)
    for cloud in (fused, single):
        assert np.isfinite(cloud.points).all()
        for values in cloud.attributes.values():
            assert np.isfinite(values).all()
    half = RIG.fls.half_elevation
    assert (np.abs(fused.attributes["elevation"]) <= half + 1e-6).all()
    fallback = fused.attributes["quality"] == 1
    assert np.allclose(fused.points[fallback], single.points[fallback])
    assert (fused.attributes["effective_size"] <= SETTINGS.particles * (1 + 1e-5)).all()
    # Every single-sonar point lies at its critical range from the sonar.
    frames = sw.plan_survey(RIG, [run()]).frames
    origin = frames.pose[single.attributes["frame"], :3]
    assert np.allclose(np.linalg.norm(single.points - origin, axis=1), single.attributes["range"], atol=1e-5)


def test_bad_logs_are_refused_by_name(device):
    log = sw.simulate(RIG, scene(), run(length=0.1), device=device)
    with pytest.raises(ValueError, match=r"SonarLog\.images: expected shape"):
        sw.SonarLog(survey=log.survey, images=log.images[:, :-1], echoes=log.echoes)
    with pytest.raises(ValueError, match=r"SonarLog\.echoes: expected dtype float32, got float64"):
        sw.SonarLog(survey=log.survey, images=log.images, echoes=log.echoes.astype(float))
    spoiled = log.images.copy()
    spoiled[0, 0, 0] = np.nan
    with pytest.raises(ValueError, match=r"SonarLog\.images: holds values that are not finite"):
        sw.SonarLog(survey=log.survey, images=spoiled, echoes=log.echoes)
