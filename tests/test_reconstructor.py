"""The reconstructor: results that do not depend on batch, chunking, threads or capture; causality; bad input."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

import sonarwarp as sw
from sonarwarp.cloud import NORMAL
from tests.small_runs import RIG, SETTINGS, allocations, none_of, run, same_points, scene, stream

NOISE = sw.Noise()


@pytest.fixture(scope="module", name="alone")
def alone_fixture(device):
    found = stream([run()], [scene()], device=device, noise=NOISE, keys=[42], seed=3)
    assert len(found[2].fused) > 40
    assert (found[2].fused.attributes["quality"] == 2).any()
    return found


@pytest.mark.parametrize("case", ["batch", "one frame a round", "all in one round", "one thread", "five threads"])
def test_a_run_has_its_bits_however_it_is_computed(alone, device, case):
    clouds = alone[2]
    options = {"device": device, "noise": NOISE, "seed": 3}
    if case == "batch":
        runs, scenes = [run(start_x=-2.9, length=0.5, altitude=1.6), run()], [scene(front_x=0.4), scene()]
        found = stream(runs, scenes, keys=[7, 42], **options)[2]
        mine = found.fused.attributes["trajectory"] == 1
        assert same_points(clouds.fused, found.fused, mine)
        assert same_points(clouds.single, found.single, mine)
        return
    options |= {
        "one frame a round": {"frames": 1},
        "all in one round": {"frames": 1000},
        "one thread": {"threads": 1},
        "five threads": {"threads": 5},
    }[case]
    found = stream([run()], [scene()], keys=[42], **options)[2]
    assert same_points(clouds.fused, found.fused)
    assert same_points(clouds.single, found.single)


def test_a_run_finds_the_same_beside_one_that_needs_more_cells(device):
    """Cells are for the region of interest; a higher run's reach further up, where this one must find none."""
    shallow = replace(SETTINGS, likelihood_field=replace(SETTINGS.likelihood_field, near=0.95))
    options = {"device": device, "noise": NOISE, "seed": 3, "settings": shallow}
    _, _, alone, one = stream([run(length=0.6)], [scene()], keys=[42], **options)
    _, _, both, two = stream([run(altitude=2.4), run(length=0.6)], [scene(), scene()], keys=[7, 42], **options)
    assert two.grid.nz > one.grid.nz + 5
    assert same_points(alone.fused, both.fused, both.fused.attributes["trajectory"] == 1)


def test_seeds_and_keys_change_the_particles_and_nothing_else(alone, device):
    log = sw.simulate(RIG, scene(), run(), noise=NOISE, seed=3, device=device)
    first, again, other = (sw.reconstruct(log, settings=SETTINGS, seed=seed, device=device) for seed in (5, 5, 6))
    assert same_points(first.fused, again.fused)
    assert same_points(first.single, other.single)
    informed = (first.fused.attributes["quality"] == 2) & (other.fused.attributes["quality"] == 2)
    assert informed.sum() > 40
    assert (first.fused.points != other.fused.points).any(axis=1)[informed].all()


def replayed(device, by_graph):
    survey = sw.plan_survey(RIG, [run()])
    reconstructor = sw.Reconstructor(RIG, settings=SETTINGS, device=device)
    schedule = reconstructor.plan_schedule(survey, frames=8)
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


def test_rounds_allocate_nothing(device):
    survey = sw.plan_survey(RIG, [run()])
    reconstructor = sw.Reconstructor(RIG, settings=SETTINGS, device=device)
    schedule = reconstructor.plan_schedule(survey, frames=8)
    reconstructor.plan(survey, schedule)
    images = wp.zeros((schedule.round_frame.shape[1], RIG.fls.beams, RIG.fls.bins), dtype=float, device=device)
    echoes = wp.zeros((schedule.round_ping.shape[1], RIG.ps.bins), dtype=float, device=device)
    reconstructor.step(images, echoes)

    def work():
        reconstructor.reset()
        for _ in range(schedule.rounds):
            reconstructor.step(images, echoes)

    assert allocations(work) == allocations(lambda: None)
    assert allocations(reconstructor.read) != allocations(lambda: None)


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


def test_without_pings_all_points_fall_back_to_the_lower_edge(device):
    log = sw.simulate(RIG, scene(), run(), noise=NOISE, seed=3, device=device)
    blind = sw.SonarLog(
        survey=replace(log.survey, pings=none_of(log.survey.pings)), images=log.images, echoes=log.echoes[:0]
    )
    found = sw.reconstruct(blind, settings=SETTINGS, device=device)
    assert len(found.single) > 40
    assert (found.fused.attributes["quality"] == 1).all()
    assert np.array_equal(found.fused.points, found.single.points)
    assert np.array_equal(found.single.points, sw.reconstruct(log, settings=SETTINGS, device=device).single.points)


@pytest.mark.parametrize("frames", [1, 3, 1000])
def test_reconstruct_equals_the_rounds_in_any_memory(device, frames):
    log = sw.simulate(RIG, scene(), run(), noise=NOISE, seed=3, device=device)
    memory = frames * RIG.fls.beams * RIG.fls.bins * 16
    whole = sw.reconstruct(log, settings=SETTINGS, seed=3, device=device, memory=memory)
    found = stream([run()], [scene()], device=device, noise=NOISE, seed=3)[2]
    assert same_points(whole.fused, found.fused)
    assert same_points(whole.single, found.single)


def test_clouds_say_what_they_know(alone):
    fused, single = alone[2].fused, alone[2].single
    assert len(fused) == len(single)
    common = {"source", "trajectory", "frame", "beam", "time", "range", "azimuth", "elevation"}
    covariance = {f"covariance_{axes}" for axes in ("xx", "yy", "zz", "xy", "xz", "yz")}
    assert set(single.attributes) == common
    angles = {f"elevation_{name}" for name in ("mean", "deviation", "low", "high")}
    assert set(fused.attributes) == common | covariance | angles | {"effective_size", "quality", "hits", *NORMAL}
    assert not any(fused.attributes[name].any() for name in NORMAL)
    assert np.all(fused.attributes["hits"] == 1)
    for axis in "xyz":
        assert (fused.attributes[f"covariance_{axis}{axis}"] >= 0).all()
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


def test_clouds_keep_all_that_they_know_in_a_file(alone, tmp_path):
    fused = alone[2].fused
    fused.write_ply(tmp_path / "fused.ply")
    read = sw.read_cloud(tmp_path / "fused.ply")
    assert np.array_equal(read.points.astype(np.float32), fused.points)
    assert set(read.attributes) == set(fused.attributes)
    for name, values in fused.attributes.items():
        assert np.array_equal(read.attributes[name], values.astype(read.attributes[name].dtype)), name


def test_arrays_of_a_round_are_refused_by_name(device):
    survey = sw.plan_survey(RIG, [run(length=0.1)])
    reconstructor = sw.Reconstructor(RIG, settings=SETTINGS, device=device)
    schedule = reconstructor.plan_schedule(survey, frames=8)
    reconstructor.plan(survey, schedule)
    frames, pings = schedule.round_frame.shape[1], schedule.round_ping.shape[1]

    def step(images=(frames, 12, 160), echoes=(pings, 120), dtype=float):
        reconstructor.step(wp.zeros(images, dtype=dtype, device=device), wp.zeros(echoes, dtype=dtype, device=device))

    step()
    with pytest.raises(ValueError, match=rf"images: expected shape \({frames}, 12, 160\), got \({frames}, 12, 159\)"):
        step(images=(frames, 12, 159))
    with pytest.raises(
        ValueError, match=rf"images: expected shape \({frames}, 12, 160\), got \({frames - 1}, 12, 160\)"
    ):
        step(images=(frames - 1, 12, 160))
    with pytest.raises(ValueError, match=rf"echoes: expected shape \({pings}, 120\), got \({pings}, 121\)"):
        step(echoes=(pings, 121))
    with pytest.raises(ValueError, match="images: expected dtype float32, got float64"):
        step(dtype=wp.float64)


def test_what_a_plan_cannot_serve_is_refused_by_name(device):
    short, long = (sw.plan_survey(RIG, [run(length=length)]) for length in (0.1, 0.3))
    reconstructor = sw.Reconstructor(RIG, settings=SETTINGS, device=device)
    schedule = reconstructor.plan_schedule(long, frames=8)
    with pytest.raises(ValueError, match="schedule: names frame 30 of a survey of 11, was made for another one"):
        reconstructor.plan(short, schedule)
    blind = replace(long, frames=none_of(long.frames))
    with pytest.raises(ValueError, match=r"survey\.frames: empty, nothing to reconstruct"):
        reconstructor.plan(blind, reconstructor.plan_schedule(blind, frames=8))
    with pytest.raises(ValueError, match=r"seed: -1, must be at least 0"):
        reconstructor.plan(long, schedule, seed=-1)
    fine = replace(SETTINGS, likelihood_field=replace(SETTINGS.likelihood_field, cell=0.001))
    with pytest.raises(ValueError, match=r"likelihood_field\.cell: 0\.001 m gives .* cells, over 2 GiB; raise it"):
        sw.Reconstructor(RIG, settings=fine, device=device).plan(long, schedule)


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
