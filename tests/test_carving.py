"""The default method over whole logs: bits that do not depend on batch, chunking, threads or capture; its clouds."""

from dataclasses import fields, replace

import numpy as np
import pytest
import warp as wp
from scipy.spatial.transform import Rotation

import sonarwarp as sw
from sonarwarp.cloud import NORMAL
from sonarwarp_kernels import estimate
from tests.reference.repeats import surest
from tests.small_runs import CARVED, RIG, SETTINGS, allocations, none_of, run, same_points, scene, stream

NOISE = sw.Noise()
SWIFT = replace(RIG, ps=replace(RIG.ps, range_edge=np.linspace(1.0, 7.0, 601), scan_rate_deg=18.0))
"""The small rig, its profiling sonar twice as fast and as fine as a face needs: it passes the brick's several times."""

LENGTH = 0.9
OPTIONS = {"noise": NOISE, "settings": CARVED, "rig": SWIFT, "seed": 3}


def approach(**changed):
    """A run until the front is under the vehicle's nose."""
    return run(**({"start_x": -3.4, "length": LENGTH} | changed))


@pytest.fixture(scope="module", name="alone")
def alone_fixture(device):
    found = stream([approach()], [scene()], device=device, **OPTIONS)
    fused = found[2].fused
    assert len(of_source(fused, 0)) > 100
    assert len(of_source(fused, 1)) > 20
    return found


@pytest.fixture(scope="module", name="log")
def log_fixture(device):
    return sw.simulate(SWIFT, scene(), approach(), noise=NOISE, seed=3, device=device)


def of_source(cloud, source):
    """Points of one sonar: 0 the imaging, 1 the profiling one."""
    return cloud.select(cloud.attributes["source"] == source)


def rows(instants, chosen):
    """Some of the frames or pings."""
    return replace(instants, **{field.name: getattr(instants, field.name)[chosen] for field in fields(instants)})


def planned(log, device, frames=8, settings=CARVED):
    """A reconstructor before its first round, and its rounds' images and echoes."""
    reconstructor = sw.Reconstructor(SWIFT, settings=settings, device=device)
    schedule = reconstructor.plan_schedule(log.survey, frames=frames)
    reconstructor.plan(log.survey, schedule)
    rounds = [
        (
            wp.array(log.images_of(frame), dtype=float, device=device),
            wp.array(log.echoes_of(ping), dtype=float, device=device),
        )
        for frame, ping in zip(schedule.round_frame, schedule.round_ping, strict=True)
    ]
    return reconstructor, schedule, rounds


# --- What the clouds do not depend on ---


@pytest.mark.parametrize("case", ["batch", "one frame a round", "all in one round", "one thread", "five threads"])
def test_a_run_has_its_bits_however_it_is_computed(alone, device, case):
    clouds = alone[2]
    if case == "batch":
        runs, scenes = [approach(start_x=-2.9, altitude=1.6), approach()], [scene(front_x=0.4), scene()]
        found = stream(runs, scenes, device=device, keys=[7, 0], **OPTIONS)[2]
        assert same_points(clouds.fused, found.fused, found.fused.attributes["trajectory"] == 1)
        assert same_points(clouds.single, found.single, found.single.attributes["trajectory"] == 1)
        assert (found.fused.attributes["trajectory"] == 0).any()
        return
    options = {
        "one frame a round": {"frames": 1},
        "all in one round": {"frames": 1000},
        "one thread": {"threads": 1},
        "five threads": {"threads": 5},
    }[case]
    found = stream([approach()], [scene()], device=device, **OPTIONS, **options)[2]
    assert same_points(clouds.fused, found.fused)
    assert same_points(clouds.single, found.single)


def test_a_run_finds_the_same_beside_one_that_needs_more_cells(alone, device):
    runs = [approach(altitude=2.4, length=1.4), approach()]
    _, _, both, reconstructor = stream(runs, [scene(), scene()], device=device, keys=[7, 0], **OPTIONS)
    assert reconstructor.grid.nx > alone[3].grid.nx + 5
    assert same_points(alone[2].fused, both.fused, both.fused.attributes["trajectory"] == 1)


def test_nothing_is_drawn_so_that_seeds_change_nothing(log, device):
    first, other = (sw.reconstruct(log, settings=CARVED, seed=seed, device=device) for seed in (5, 6))
    assert same_points(first.fused, other.fused)


def test_the_single_sonars_cloud_is_that_of_the_papers_method(log, device):
    carved, paper = (sw.reconstruct(log, settings=settings, device=device) for settings in (CARVED, SETTINGS))
    assert same_points(carved.single, paper.single)
    assert not np.array_equal(carved.fused.points, paper.fused.points)


@pytest.mark.parametrize("frames", [1, 3, 1000])
def test_reconstruct_equals_the_rounds_in_any_memory(alone, log, device, frames):
    memory = frames * RIG.fls.beams * RIG.fls.bins * 16
    assert same_points(alone[2].fused, sw.reconstruct(log, settings=CARVED, device=device, memory=memory).fused)


@pytest.mark.parametrize("by_graph", [False, True], ids=["eager", "graph"])
def test_reset_and_graphs_replay_bit_for_bit(alone, log, device, by_graph, monkeypatch):
    reconstructor, _, rounds = planned(log, device)
    images, echoes = (wp.empty_like(array) for array in rounds[0])

    def step():
        reconstructor.step(images, echoes)

    if by_graph:
        # Modules must be loaded before a capture: one eager round does that.
        step()
        reconstructor.conclude()
        with wp.ScopedCapture(device=device) as one:
            reconstructor.step(images, echoes)
        with wp.ScopedCapture(device=device) as last:
            reconstructor.conclude()
        monkeypatch.setattr(reconstructor, "conclude", lambda: wp.capture_launch(last.graph))

        def step():
            wp.capture_launch(one.graph)

    for _ in range(2):
        reconstructor.reset()
        for round_images, round_echoes in rounds:
            wp.copy(images, round_images)
            wp.copy(echoes, round_echoes)
            step()
        found = reconstructor.read()
        assert same_points(alone[2].fused, found.fused)
        assert same_points(alone[2].single, found.single)


def test_rounds_and_the_conclusion_allocate_nothing(log, device):
    reconstructor, _, rounds = planned(log, device)
    reconstructor.step(*rounds[0])
    reconstructor.conclude()

    def work():
        reconstructor.reset()
        for images, echoes in rounds:
            reconstructor.step(images, echoes)
        reconstructor.conclude()

    assert allocations(work) == allocations(lambda: None)


# --- Reading ---


def test_reading_twice_gives_the_same(log, device):
    reconstructor, _, rounds = planned(log, device)
    for images, echoes in rounds:
        reconstructor.step(images, echoes)
    first, second = reconstructor.read(), reconstructor.read()
    assert same_points(first.fused, second.fused)
    assert same_points(first.single, second.single)


def test_reading_on_the_way_leaves_no_trace(log, device):
    images = log.images.copy()
    # A fish: a stray that is taken out again however often it was counted.
    images[2, 5, 60:63] = 100.0 * images.max()
    fish = replace(log, images=images)
    want = sw.reconstruct(fish, settings=CARVED, device=device)
    reconstructor, _, rounds = planned(fish, device)
    for round_images, round_echoes in rounds:
        reconstructor.step(round_images, round_echoes)
        reconstructor.conclude()
    found = reconstructor.read()
    assert same_points(want.fused, found.fused)
    met = [(cloud.attributes["frame"] == 2) & (cloud.attributes["beam"] == 5) for cloud in (found.single, found.fused)]
    assert [int(each.sum()) for each in met] == [1, 0]


def test_after_some_rounds_only_their_frames_have_proven_anything(log, device):
    """Frames to come leave no trace: the cloud is that of a log which ends here."""
    reconstructor, schedule, rounds = planned(log, device)
    done = len(rounds) - 3
    for images, echoes in rounds[:done]:
        reconstructor.step(images, echoes)
    early = reconstructor.read()
    seen = schedule.round_frame[:done]
    kept = np.sort(seen[seen >= 0])
    assert set(schedule.round_ping[:done].ravel()) >= set(range(len(log.survey.pings)))
    survey = replace(log.survey, frames=rows(log.survey.frames, kept))
    cut = sw.SonarLog(survey=survey, images=log.images[kept], echoes=log.echoes)
    want = sw.reconstruct(cut, settings=CARVED, device=device)
    assert len(of_source(early.fused, 0)) > 50
    # The first frame looks least far, so that both boxes begin at one place.
    assert same_points(early.fused, want.fused)
    assert not same_points(early.fused, sw.reconstruct(log, settings=CARVED, device=device).fused)


def test_online_every_read_is_of_the_log_so_far(alone, log, device):
    """Neither a frame nor a ping to come leaves a trace, and none before is forgotten.

    The first frame looks least far, so that all boxes begin at one place.
    """
    reconstructor, schedule, rounds = planned(log, device, frames=1, settings=replace(CARVED, causal=True))
    frames, pings = log.survey.frames, log.survey.pings
    assert reconstructor.window < len(pings) / 2
    faces = 0
    for (images, echoes), frame in zip(rounds, schedule.round_frame[:, 0], strict=True):
        reconstructor.step(images, echoes)
        if frame not in (30, 60, 70, 80):
            continue
        shown, sent = np.arange(frame + 1), np.flatnonzero(pings.time <= frames.time[frame])
        survey = replace(log.survey, frames=rows(frames, shown), pings=rows(pings, sent))
        cut = sw.SonarLog(survey=survey, images=log.images[shown], echoes=log.echoes[sent])
        want, found = sw.reconstruct(cut, settings=CARVED, device=device), reconstructor.read()
        assert same_points(want.fused, found.fused)
        assert same_points(want.single, found.single)
        faces += len(of_source(found.fused, 1)) > 0
    assert faces >= 2
    assert same_points(alone[2].fused, reconstructor.read().fused)


def test_online_the_papers_method_weighs_nothing(log, device, monkeypatch):
    monkeypatch.setattr(estimate, "estimate_points", None)
    reconstructor, _, rounds = planned(log, device, settings=replace(CARVED, causal=True))
    for images, echoes in rounds:
        reconstructor.step(images, echoes)
    assert len(reconstructor.read().fused) > 0


def test_online_a_read_between_frames_knows_nothing_of_the_next_one(log, device):
    """For two seconds no frame comes, and the seabed rises by 0.8 m meanwhile, so that the box begins where it did."""
    kept = np.delete(np.arange(len(log.survey.frames)), np.s_[70:90])
    frames = rows(log.survey.frames, kept)
    frames = replace(frames, altitude=frames.altitude - 0.8 * (frames.number >= 90))
    gap = sw.SonarLog(survey=replace(log.survey, frames=frames), images=log.images[kept], echoes=log.echoes)
    reconstructor, schedule, rounds = planned(gap, device, frames=1, settings=replace(CARVED, causal=True))
    done = int(np.flatnonzero(schedule.round_frame[:, 0] == 70)[0])
    assert schedule.round_frame[done - 1, 0] < 0
    for images, echoes in rounds[:done]:
        reconstructor.step(images, echoes)
    sent = np.unique(schedule.round_ping[:done])
    sent = sent[sent >= 0]
    survey = replace(gap.survey, frames=rows(frames, np.arange(70)), pings=rows(gap.survey.pings, sent))
    cut = sw.SonarLog(survey=survey, images=gap.images[:70], echoes=gap.echoes[sent])
    found = reconstructor.read().fused
    assert len(of_source(found, 1)) > 0
    assert same_points(sw.reconstruct(cut, settings=CARVED, device=device).fused, found)


def test_before_any_round_there_are_no_points(log, device):
    reconstructor, _, rounds = planned(log, device)
    assert len(reconstructor.read().fused) == 0
    for images, echoes in rounds:
        reconstructor.step(images, echoes)
    assert len(reconstructor.read().fused) > 0
    reconstructor.reset()
    assert len(reconstructor.read().fused) == 0
    assert len(reconstructor.read().single) == 0


# --- Logs that lack something ---


def test_without_pings_there_are_contacts_and_no_faces(log, alone, device):
    blind = sw.SonarLog(
        survey=replace(log.survey, pings=none_of(log.survey.pings)), images=log.images, echoes=log.echoes[:0]
    )
    found = sw.reconstruct(blind, settings=CARVED, device=device)
    assert len(of_source(found.fused, 0)) > 100
    assert len(of_source(found.fused, 1)) == 0
    assert same_points(found.single, alone[2].single)


def test_over_a_bare_seabed_there_are_no_faces(device):
    log = sw.simulate(SWIFT, scene(front_x=9.0), approach(), noise=NOISE, seed=3, device=device)
    found = sw.reconstruct(log, settings=CARVED, device=device).fused
    assert len(found) == 0


def test_silence_gives_no_points(log, device):
    silent = sw.SonarLog(survey=log.survey, images=np.zeros_like(log.images), echoes=np.zeros_like(log.echoes))
    found = sw.reconstruct(silent, settings=CARVED, device=device)
    assert len(found.fused) == 0
    assert len(found.single) == 0


def test_a_trajectory_without_frames_has_no_points_and_harms_no_other(device):
    log = sw.simulate(SWIFT, [scene(), scene()], [approach(), approach()], noise=NOISE, seed=3, device=device)
    kept = log.survey.frames.trajectory == 0
    survey = replace(log.survey, frames=rows(log.survey.frames, kept))
    half = sw.SonarLog(survey=survey, images=log.images[kept], echoes=log.echoes)
    whole, found = (sw.reconstruct(each, settings=CARVED, device=device).fused for each in (log, half))
    assert (found.attributes["trajectory"] == 0).all()
    assert len(found) > 100
    assert same_points(found, whole, whole.attributes["trajectory"] == 0)


# --- What the clouds say ---


def test_contacts_stand_where_their_range_azimuth_and_elevation_say(alone, log):
    contacts = of_source(alone[2].fused, 0)
    told = {name: contacts.attributes[name].astype(float) for name in ("range", "azimuth", "elevation")}
    pose = log.survey.frames.pose[contacts.attributes["frame"]]
    # The paper's fan: turned by the azimuth after it was raised by the elevation.
    turn = Rotation.from_euler("ZY", np.stack([told["azimuth"], -told["elevation"]], axis=1))
    ahead = told["range"][:, None] * turn.apply([1.0, 0.0, 0.0])
    want = pose[:, :3] + Rotation.from_quat(pose[:, 3:]).apply(ahead)
    np.testing.assert_allclose(contacts.points, want, atol=1e-5)
    assert np.array_equal(contacts.attributes["time"], log.survey.frames.time[contacts.attributes["frame"]])
    assert np.all(np.abs(told["elevation"]) <= RIG.fls.half_elevation)
    assert np.allclose(told["azimuth"], RIG.fls.azimuth[contacts.attributes["beam"]])


def test_faces_stand_where_their_range_and_angles_say(alone, log):
    faces = of_source(alone[2].fused, 1)
    told = {name: faces.attributes[name].astype(float) for name in ("range", "azimuth", "elevation")}
    pings = log.survey.pings
    pose = pings.head_pose[faces.attributes["frame"]]
    turn = Rotation.from_quat(pose[:, 3:])
    # On its side the head's y axis points up here; the fan lies across.
    assert np.all(turn.apply([0.0, 1.0, 0.0])[:, 2] > 0.5)
    scan = told["elevation"]
    across = np.cos(told["azimuth"])
    local = np.stack([across * np.cos(scan), across * np.sin(scan), np.sin(told["azimuth"])], axis=1)
    want = pose[:, :3] + turn.apply(told["range"][:, None] * local)
    np.testing.assert_allclose(faces.points, want, atol=1e-5)
    assert np.array_equal(faces.attributes["time"], pings.time[faces.attributes["frame"]])
    half = np.radians(SWIFT.ps.fan_beamwidth_deg) / 2
    assert np.all(np.abs(told["azimuth"]) <= half + 0.01)
    assert np.all(faces.attributes["quality"] == int(estimate.QUALITY_INFORMED))


def test_no_face_is_surer_of_its_elevation_than_the_sonars_are_of_each_other(alone):
    deviation = of_source(alone[2].fused, 1).attributes["elevation_deviation"]
    assert np.degrees(deviation.min()) >= CARVED.free_space.registration_deg * (1 - 1e-6)


def test_faces_are_the_bricks_front(alone):
    """Upright and at x = 0, between the seabed and the brick's top, no wider than a strip beyond its sides."""
    faces = of_source(alone[2].fused, 1).points
    # Nearer to the top than a beam is wide, the top is in the beam as well.
    beam = np.radians(SWIFT.ps.beamwidth_deg) * 3.5
    whole = faces[:, 2] < 0.39 - beam
    assert np.mean(whole) > 0.6
    assert np.all(np.abs(faces[whole, 0]) < CARVED.likelihood_field.cell)
    assert abs(np.median(faces[:, 0])) < 0.02
    assert np.all(faces[:, 2] > 0.0)
    # Contacts end them, which cells of this size place to a cell or so.
    assert np.mean(faces[:, 2] < 0.39 + CARVED.likelihood_field.cell) > 0.95
    assert np.all(np.abs(faces[:, 1]) < 0.19 / 2 + 0.06)


def test_faces_look_back_along_the_way_and_square_to_their_strips(alone):
    faces = of_source(alone[2].fused, 1)
    normal = np.stack([faces.attributes[name] for name in NORMAL], axis=1)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0, rtol=1e-6)
    # The run is along x.
    assert np.all(normal[:, 0] < 0.0)
    np.testing.assert_allclose(normal[:, 1], 0.0, atol=1e-6)
    step = np.diff(faces.points, axis=0)
    of_one_strip = np.all([np.diff(faces.attributes[name]) == 0 for name in ("frame", "beam")], axis=0)
    assert of_one_strip.sum() > 20
    np.testing.assert_allclose(np.sum(step * normal[1:], axis=1)[of_one_strip], 0.0, atol=2e-6)


def test_clouds_say_what_they_know_of_every_point(alone):
    fused, single = alone[2].fused, alone[2].single
    common = {"source", "trajectory", "frame", "beam", "time", "range", "azimuth", "elevation"}
    covariance = {f"covariance_{axes}" for axes in ("xx", "yy", "zz", "xy", "xz", "yz")}
    angles = {f"elevation_{name}" for name in ("mean", "deviation", "low", "high")}
    beliefs = angles | {"effective_size", "quality", "hits", *NORMAL}
    assert set(single.attributes) == common
    assert set(fused.attributes) == common | covariance | beliefs
    for cloud in (fused, single):
        assert np.isfinite(cloud.points).all()
        assert all(np.isfinite(values).all() for values in cloud.attributes.values())
    xx, yy, zz, xy, xz, yz = (fused.attributes[f"covariance_{axes}"] for axes in ("xx", "yy", "zz", "xy", "xz", "yz"))
    matrix = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=1).reshape(-1, 3, 3).astype(float)
    # Squares of offsets of up to half a metre.
    assert np.linalg.eigvalsh(matrix).min() > -1e-6
    assert np.all(fused.attributes["quality"] > 0)
    assert np.all(fused.attributes["hits"] > 0)
    assert np.all(of_source(fused, 1).attributes["hits"] == 1)
    normal = np.stack([fused.attributes[name] for name in NORMAL], axis=1)
    assert np.array_equal(np.any(normal != 0.0, axis=1), fused.attributes["source"] == 1)
    assert np.all(fused.attributes["effective_size"] <= CARVED.free_space.hypotheses * (1 + 1e-5))
    assert np.all(fused.attributes["elevation_deviation"] > 0)
    for end, side in (("low", -1), ("high", 1)):
        assert np.all(side * (fused.attributes[f"elevation_{end}"] - fused.attributes["elevation"]) > 0)


# --- Repeated hits ---


def keeping_all(spacing=0.0):
    """The default method with other cubes, by default none."""
    return replace(CARVED, free_space=replace(CARVED.free_space, hit_spacing=spacing))


def test_where_all_hits_stay_each_stands_for_itself(log, alone, device):
    every = sw.reconstruct(log, settings=keeping_all(), device=device).fused
    assert np.all(every.attributes["hits"] == 1)
    assert len(of_source(every, 0)) > len(of_source(alone[2].fused, 0))


@pytest.mark.parametrize("spacing", [0.01, 0.05])
def test_of_each_cube_the_surest_contact_stays_as_it_was_and_counts_all(log, alone, device, spacing):
    every, kept = (
        of_source(sw.reconstruct(log, settings=keeping_all(s), device=device).fused, 0) for s in (0.0, spacing)
    )
    # As the kernel has it: what lies in which cube is a matter of rounding.
    length = every.attributes["range"] * every.attributes["elevation_deviation"]
    owner = every.attributes["trajectory"]
    found = surest(owner, every.points, length, np.float32(spacing))
    assert len(found) < 0.9 * len(every)
    chosen = np.sort(list(found))
    assert np.array_equal(kept.points, every.points[chosen])
    for name in set(every.attributes) - {"hits"}:
        assert np.array_equal(kept.attributes[name], every.attributes[name][chosen])
    assert kept.attributes["hits"].tolist() == [len(found[contact]) for contact in chosen]


def test_strays_and_faces_are_told_by_all_hits(log, device):
    """Points in cubes wider than a cell are too few for any not to be a stray."""
    every, kept = (sw.reconstruct(log, settings=keeping_all(s), device=device).fused for s in (0.0, 0.2))
    assert of_source(kept, 0).attributes["hits"].sum() == len(of_source(every, 0))
    assert len(of_source(kept, 0)) < 0.2 * len(of_source(every, 0))
    assert same_points(of_source(every, 1), of_source(kept, 1))
