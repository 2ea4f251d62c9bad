"""Logs on disk: they come back to the bit, stream, and open with xarray alone."""

import tracemalloc
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import sonarwarp as sw
from sonarwarp.store import StoreError
from sonarwarp.store_read import open_log
from sonarwarp.store_simulation import simulate_to_store, survey_to_store
from sonarwarp.store_values import beam_rotation, vehicle_attitude
from sonarwarp.store_write import StoreWriter, log_to_store
from sonarwarp.truth import first_contacts
from tests import small_runs
from tests.small_logs import CHUNK, same_survey, small_log, small_survey

FEW = 8 * small_runs.RIG.fls.beams * small_runs.RIG.fls.bins * 16
"""Bytes of a round of eight frames of the small runs."""


def test_a_log_comes_back_to_the_bit(tmp_path):
    log = small_log(runs=2)
    log_to_store(log, tmp_path / "run.zarr", noise=sw.Noise(), reconstruction=small_runs.SETTINGS)
    stored = open_log(tmp_path / "run.zarr")
    assert stored.complete
    assert same_survey(stored.survey, log.survey)
    again = stored.load()
    assert np.array_equal(again.images, log.images)
    assert np.array_equal(again.echoes, log.echoes)
    assert stored.noise == sw.Noise()
    assert stored.reconstruction == small_runs.SETTINGS
    assert stored.truth is None
    assert not stored.has_contacts
    chunks = list(stored.image_chunks())
    assert [first for first, _ in chunks] == list(range(0, 300, CHUNK))
    assert np.array_equal(np.concatenate([rows for _, rows in chunks]), log.images)
    assert np.array_equal(np.concatenate([rows for _, rows in stored.echo_chunks()]), log.echoes)


def test_rows_are_gathered_in_any_order_and_empty_slots_are_zero(tmp_path):
    log = small_log()
    log_to_store(log, tmp_path / "run.zarr")
    stored = open_log(tmp_path / "run.zarr")
    wanted = np.array([149, -1, 0, 64, 63, 0, -1])
    for one in (stored, log):
        images = one.images_of(wanted)
        assert not images[wanted < 0].any()
        assert np.array_equal(images[wanted >= 0], log.images[wanted[wanted >= 0]])
        assert np.array_equal(one.echoes_of(wanted[1:3]), np.stack([np.zeros(6), log.echoes[0]]).astype(np.float32))
    with pytest.raises(ValueError, match=r"row 150, must be below the 150 complete"):
        stored.images_of(np.array([3, 150]))


@settings(deadline=None, max_examples=6, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(cuts=st.lists(st.integers(0, 150), max_size=8), frames=st.integers(0, 150))
def test_in_whatever_pieces_it_is_written_it_is_the_same(tmp_path, cuts, frames):
    log = small_log()
    bounds = sorted({0, *(cut for cut in cuts if cut < frames), frames})
    pings = [min(bound // 5 + 1, len(log.echoes)) if bound else 0 for bound in bounds]
    with StoreWriter(tmp_path / "run.zarr", log.survey, overwrite=True) as writer:
        for begin, end, first, last in zip(bounds, bounds[1:], pings, pings[1:], strict=False):
            writer.append(log.images[begin:end], log.echoes[first:last])
            # No frame counts before the pings that came with it.
            assert writer.frames_complete == end // CHUNK * CHUNK
            assert writer.pings_complete >= min(writer.frames_complete // 5 + 1, last) or not writer.frames_complete
    stored = open_log(tmp_path / "run.zarr")
    assert (len(stored.survey.frames), len(stored.survey.pings)) == (frames, pings[-1])
    assert (stored.frames_planned, stored.pings_planned) == (150, len(log.echoes))
    assert stored.complete == (frames == 150 and pings[-1] == len(log.echoes))
    assert same_survey(stored.survey, log.survey, frames, pings[-1])
    assert np.array_equal(stored.load().images, log.images[:frames])
    assert np.array_equal(stored.load().echoes, log.echoes[: pings[-1]])


def test_an_exception_leaves_what_was_appended(tmp_path):
    log = small_log()

    def interrupted():
        with StoreWriter(tmp_path / "run.zarr", log.survey) as writer:
            writer.append(log.images[:70], log.echoes[:10])
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert np.array_equal(open_log(tmp_path / "run.zarr").load().images, log.images[:70])


def test_a_log_can_be_read_while_it_grows(tmp_path):
    log = small_log()
    with StoreWriter(tmp_path / "run.zarr", log.survey) as writer:
        assert len(open_log(tmp_path / "run.zarr").survey.frames) == 0
        writer.append(log.images[:100], log.echoes[:20])
        stored = open_log(tmp_path / "run.zarr")
        writer.append(log.images[100:], log.echoes[20:])
    assert np.array_equal(stored.load().images, log.images[:64])
    assert np.array_equal(stored.load().echoes, log.echoes[:20])


def test_xarray_opens_and_plots_it_without_us(tmp_path):
    import matplotlib as mpl
    import xarray as xr

    mpl.use("Agg")
    log = small_log()
    log_to_store(replace(log, truth=log.survey), tmp_path / "run.zarr")
    fls = xr.open_zarr(tmp_path / "run.zarr", group="fls")
    ps = xr.open_zarr(tmp_path / "run.zarr", group="ps")
    truth = xr.open_zarr(tmp_path / "run.zarr", group="truth")
    assert fls.backscatter_r.dims == ("frame", "beam", "bin")
    assert ps.backscatter_r.dims == ("ping", "bin")
    assert np.array_equal(fls.backscatter_r.values, log.images)
    assert np.array_equal(ps.backscatter_r.values, log.echoes)
    assert np.array_equal(truth.frame_position.values, log.survey.frames.pose[:, :3])
    assert {"ping_time", "range", "azimuth"} <= set(fls.coords)
    for name, variable in [*fls.variables.items(), *ps.variables.items(), *truth.variables.items()]:
        assert variable.attrs.get("long_name"), name
        assert "units" in variable.attrs or "units" in variable.encoding, name
    since = (fls.ping_time.values - np.datetime64("1970-01-01", "ns")) / np.timedelta64(1, "ns")
    assert np.allclose(since, 1e9 * log.survey.frames.time, atol=1.0)
    fls.backscatter_r.isel(frame=3).plot(x="azimuth", y="range")
    ps.backscatter_r.plot(x="ping", y="range")
    tree = xr.open_datatree(tmp_path / "run.zarr", engine="zarr")
    assert tree.attrs["frames_complete"] == 150
    assert "[fls_mount]" in tree.attrs["rig"]


def test_what_was_not_written_is_nan_to_others(tmp_path):
    import xarray as xr

    log = small_log()
    with StoreWriter(tmp_path / "run.zarr", log.survey) as writer:
        writer.append(log.images[:10], log.echoes)
    fls = xr.open_zarr(tmp_path / "run.zarr", group="fls")
    assert np.isnan(fls.backscatter_r.values[10:]).all()
    assert np.isfinite(fls.ping_time.values.astype(float)).all()


def test_beams_turn_as_the_convention_says():
    """Turns z - y' - x'' of the platform's frame (x forward, y starboard, z down) take its z axis to the beam's."""
    draw = np.random.default_rng(3)
    for _ in range(20):
        tilt, roll, pan = draw.uniform(-180.0, 180.0, 3)
        mount = sw.Mount(tilt_deg=tilt, roll_deg=roll, pan_deg=pan)
        azimuth = draw.uniform(-np.pi, np.pi, 5)
        phi, theta = beam_rotation(mount, azimuth)
        assert (np.abs(theta) <= 90.0).all()
        turn = Rotation.from_euler("ZYX", np.stack([np.zeros(5), theta, phi], axis=1), degrees=True)
        ours = Rotation.from_euler("ZYX", [pan, tilt, roll], degrees=True).apply(
            np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(5)], axis=1)
        )
        assert np.allclose(turn.apply([0.0, 0.0, 1.0]), ours * [1.0, -1.0, -1.0], atol=1e-12)


def test_attitudes_are_bow_up_and_starboard_down():
    draw = np.random.default_rng(4)
    pitch, roll = draw.uniform(-80.0, 80.0, 9), draw.uniform(-170.0, 170.0, 9)
    heading = draw.uniform(0.0, 360.0, 9)
    # In the convention's frame, then ours: starboard and down change sign.
    theirs = Rotation.from_euler("ZYX", np.stack([heading, pitch, roll], axis=1), degrees=True).as_matrix()
    flip = np.diag([1.0, -1.0, -1.0])
    vehicle = Rotation.from_matrix(flip @ theirs @ flip)
    mount = sw.Mount(position=(1.0, 2.0, 3.0), tilt_deg=25.0, roll_deg=90.0, pan_deg=-10.0)
    sensor = vehicle * Rotation.from_quat(mount.vehicle_from_sensor()[3:])
    pose = np.concatenate([draw.standard_normal((9, 3)), sensor.as_quat()], axis=1)
    found_pitch, found_roll = vehicle_attitude(pose, mount)
    assert np.allclose(found_pitch, pitch, atol=1e-9)
    assert np.allclose(found_roll, roll, atol=1e-9)


def test_a_simulation_to_disk_is_the_one_in_memory(tmp_path, device):
    scene, run = small_runs.scene(), small_runs.run()
    log = sw.simulate(small_runs.RIG, scene, run, noise=sw.Noise(), seed=5, device=device)
    brought = []
    simulate_to_store(
        *(small_runs.RIG, scene, run, tmp_path / "run.zarr"),
        noise=sw.Noise(),
        seed=5,
        truth=True,
        device=device,
        memory=FEW,
        advance=brought.append,
    )
    stored = open_log(tmp_path / "run.zarr")
    assert stored.complete
    assert same_survey(stored.survey, log.survey)
    assert np.array_equal(stored.load().images, log.images)
    assert np.array_equal(stored.load().echoes, log.echoes)
    assert sum(brought) == len(log.images)
    assert max(brought) == 8
    rows = np.arange(len(log.images))
    expected = first_contacts(log.survey, [scene], elevations=256, device=device)
    for name in ("range", "azimuth", "elevation", "face"):
        assert np.array_equal(getattr(stored.contacts_of(rows), name), getattr(expected, name)), name
    assert same_survey(stored.truth, log.survey)


def test_runs_of_a_batch_are_written_in_order_of_time_and_reconstruct_alike(tmp_path, device):
    scene, runs = small_runs.scene(), [small_runs.run(), small_runs.run(start_x=-3.0)]
    simulate_to_store(small_runs.RIG, scene, runs, tmp_path / "run.zarr", device=device, memory=FEW)
    stored = open_log(tmp_path / "run.zarr")
    log = sw.simulate(small_runs.RIG, scene, runs, device=device)
    place = np.lexsort([stored.survey.frames.number, stored.survey.frames.trajectory])
    assert np.array_equal(stored.load().images[place], log.images)
    assert (np.diff(stored.survey.frames.time) > -1.0 / small_runs.RIG.ps.rate).all()
    one, other = (sw.reconstruct(each, settings=small_runs.SETTINGS, device=device).fused for each in (stored, log))
    assert len(other) > 50
    order = np.lexsort([one.attributes[name] for name in ("beam", "frame", "trajectory")])
    assert small_runs.same_points(other, one, order)


def test_a_log_on_disk_reconstructs_to_the_same_bits(tmp_path, device):
    log = sw.simulate(small_runs.RIG, small_runs.scene(), small_runs.run(), device=device)
    log_to_store(log, tmp_path / "run.zarr")
    clouds = [
        sw.reconstruct(one, settings=small_runs.SETTINGS, device=device, memory=FEW)
        for one in (log, open_log(tmp_path / "run.zarr"))
    ]
    assert len(clouds[0].fused) > 50
    assert small_runs.same_points(clouds[0].fused, clouds[1].fused)
    assert small_runs.same_points(clouds[0].single, clouds[1].single)


def test_navigation_and_truth_are_kept_apart(tmp_path, device):
    way = {"motion": sw.Motion(), "navigation": sw.Navigation(), "seed": 1}
    true, believed = sw.plan_disturbed(small_runs.RIG, [small_runs.run()], **way)
    path = tmp_path / "run.zarr"
    simulate_to_store(small_runs.RIG, small_runs.scene(), small_runs.run(), path, **way, device=device, memory=FEW)
    stored = open_log(path)
    assert same_survey(stored.survey, believed)
    for loaded in (stored, stored.load()):
        assert loaded.truth is not None
        assert same_survey(loaded.truth, true)
    assert not np.array_equal(believed.frames.pose, true.frames.pose)
    survey_to_store(true, [small_runs.scene()], tmp_path / "again.zarr", believed=believed, seed=1, device=device)
    assert np.array_equal(open_log(tmp_path / "again.zarr").load().images, stored.load().images)
    with pytest.raises(StoreError, match=r"no first contacts, simulate it with truth"):
        stored.contacts_of(np.arange(2))


def poked(image):
    image[1, 2, 3] = np.nan
    return image


WRONG_IMAGES = {
    "float64": (lambda image: image.astype(np.float64), r"images: expected dtype float32, got float64"),
    "integers": (lambda image: (image * 9).astype(np.uint16), r"images: expected dtype float32, got uint16"),
    "beams and bins exchanged": (
        lambda image: image.transpose(0, 2, 1),
        r"images: expected shape \(2, 4, 8\), got \(2, 8, 4\)",
    ),
    "one image": (lambda image: image[0], r"images: expected shape \(4, 4, 8\), got \(4, 8\)"),
    "a number": (lambda image: image[0, 0, 0], r"images: expected shape \(0, 4, 8\), got \(\)"),
    "a word": (lambda image: "image", r"images: expected shape \(0, 4, 8\), got \(\)"),
    "NaN": (poked, r"images: holds values that are not finite"),
    "too many": (
        lambda image: np.repeat(image, 80, axis=0),
        r"images: 230 with those before, must be at most the 150 planned",
    ),
}


@pytest.mark.parametrize("case", WRONG_IMAGES)
def test_wrong_images_are_refused_and_nothing_is_lost(tmp_path, case):
    change, message = WRONG_IMAGES[case]
    log = small_log()
    with StoreWriter(tmp_path / "run.zarr", log.survey) as writer:
        writer.append(log.images[:70], log.echoes[:20])
        with pytest.raises(ValueError, match=message):
            writer.append(change(log.images[70:72].copy()), log.echoes[:0])
        writer.append(log.images[70:], log.echoes[20:])
    assert np.array_equal(open_log(tmp_path / "run.zarr").load().images, log.images)


def test_a_closed_log_takes_no_more(tmp_path):
    log = small_log()
    writer = StoreWriter(tmp_path / "run.zarr", log.survey)
    writer.close()
    writer.close()
    with pytest.raises(StoreError, match=r"run\.zarr: closed, open another log"):
        writer.append(log.images[:1], log.echoes[:1])


def test_contacts_come_with_every_frame_or_never(tmp_path):
    log = small_log()
    contacts = first_contacts(small_survey(2), [small_runs.scene()], elevations=8, device="cpu")
    with (
        StoreWriter(tmp_path / "a.zarr", log.survey, truth=log.survey, contacts=True) as writer,
        pytest.raises(ValueError, match=r"contacts: missing, must be as the log was begun"),
    ):
        writer.append(log.images[:2], log.echoes[:0])
    with (
        StoreWriter(tmp_path / "b.zarr", log.survey, truth=log.survey) as writer,
        pytest.raises(ValueError, match=r"contacts: given, must be as the log was begun"),
    ):
        writer.append(log.images[:2], log.echoes[:0], contacts)
    with (
        StoreWriter(tmp_path / "c.zarr", log.survey, truth=log.survey, contacts=True) as writer,
        pytest.raises(ValueError, match=r"contacts\.range: expected shape \(3, 4\), got \(2, 4\)"),
    ):
        writer.append(log.images[:3], log.echoes[:0], contacts)
    with pytest.raises(StoreError, match=r"contacts: given without truth"):
        StoreWriter(tmp_path / "d.zarr", log.survey, contacts=True)
    with pytest.raises(StoreError, match=r"truth\.frames: other rows than survey\.frames"):
        StoreWriter(tmp_path / "d.zarr", log.survey, truth=small_survey(140))
    assert not (tmp_path / "d.zarr").exists()


def test_nothing_is_overwritten_unasked_and_only_a_log_at_all(tmp_path):
    log, other = small_log(seed=1), small_log(seed=2)
    path = tmp_path / "run.zarr"
    log_to_store(log, path)
    with pytest.raises(StoreError, match=r"run\.zarr: exists already, choose another name or ask to overwrite"):
        log_to_store(other, path)
    assert np.array_equal(open_log(path).load().images, log.images)
    log_to_store(other, path, overwrite=True)
    assert np.array_equal(open_log(path).load().images, other.images)
    precious = tmp_path / "home"
    precious.mkdir()
    (precious / "zarr.json").write_text('{"attributes": {}}')
    (tmp_path / "file").write_text("words")
    (tmp_path / "link").symlink_to(path)
    for name in ("home", "file", "link"):
        with pytest.raises(StoreError, match=rf"{name}: exists and is no log, which is never overwritten"):
            log_to_store(log, tmp_path / name, overwrite=True)
    assert (precious / "zarr.json").read_text() == '{"attributes": {}}'
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["file", "home", "link", "run.zarr"]


def test_times_that_are_no_time_stamps_are_refused(tmp_path):
    survey = small_survey()
    survey = replace(survey, frames=replace(survey.frames, time=survey.frames.time + 1.4e18 * np.arange(1, 151)))
    with pytest.raises(StoreError, match=r"survey\.frames\.time: 2\.1e\+20 s, must be within 9\.2e\+09 s"):
        StoreWriter(tmp_path / "run.zarr", survey)


def test_a_log_of_nothing_is_a_log(tmp_path):
    survey = small_survey()
    none = {
        rows: replace(old, **{column.name: getattr(old, column.name)[:0] for column in fields(old)})
        for rows, old in (("frames", survey.frames), ("pings", survey.pings))
    }
    with StoreWriter(tmp_path / "run.zarr", replace(survey, **none)):
        pass
    stored = open_log(tmp_path / "run.zarr")
    assert stored.complete
    assert stored.load().images.shape == (0, 4, 8)


LONG = sw.Rig(fls=sw.FLS(range_edge=np.linspace(0.42, 5.42, 257)))


def peak_of_writing(path, frames):
    """Most bytes that Python and NumPy held at once while a log was written [MiB]."""
    survey = small_survey(frames, LONG)
    images = np.random.default_rng(0).rayleigh(size=(10, 96, 256)).astype(np.float32)
    echoes = np.ones((2, LONG.ps.bins), dtype=np.float32)
    tracemalloc.start()
    with StoreWriter(path, survey) as writer:
        for _ in range(frames // 10):
            writer.append(images, echoes)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / 2**20


def peak_of_reading(path):
    """The same while it is read round by round [MiB]."""
    tracemalloc.start()
    stored = open_log(path)
    for first in range(0, len(stored.survey.frames), 10):
        stored.images_of(np.arange(first, first + 10))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / 2**20


def test_memory_is_bounded_by_the_chunk_and_not_by_the_log(tmp_path):
    chunk = 64 * 96 * 256 * 4 / 2**20
    peak_of_writing(tmp_path / "first.zarr", 10)  # what modules take as they load is no part of it
    written = [peak_of_writing(tmp_path / f"{frames}.zarr", frames) for frames in (320, 640)]
    read = [peak_of_reading(tmp_path / f"{frames}.zarr") for frames in (320, 640)]
    # The chunk held, its copies on the way through zarr, and what the codec makes of them; of reading four kept.
    assert max(written) < 4 * chunk
    assert max(read) < 7 * chunk
    assert written[1] < written[0] + 0.5 * chunk
    assert read[1] < read[0] + 0.5 * chunk
