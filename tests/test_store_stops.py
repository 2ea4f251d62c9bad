"""Whatever stops a writer, a log opens, and what it says is complete is complete."""

import errno
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

from sonarwarp.cloud import PointCloud
from sonarwarp.store import StoreError
from sonarwarp.store_read import open_log
from sonarwarp.store_scratch import scratch_folder
from sonarwarp.store_write import StoreWriter, log_to_store
from tests import small_runs, store_victim
from tests.small_logs import same_survey, small_log

ROOT = Path(__file__).resolve().parents[1]


class Writers:
    """Processes that write a log each."""

    def __init__(self):
        roots = os.pathsep.join(str(ROOT / part) for part in ("", "kernels", "scenes"))
        self._server = subprocess.Popen(
            [sys.executable, "-m", "tests.store_victim"],
            cwd=ROOT,
            env=dict(os.environ, PYTHONPATH=roots),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._hear("ready")

    def _hear(self, word):
        """Lines up to the one that holds ``word``."""
        assert self._server.stdout is not None
        heard = []
        while not heard or word not in heard[-1]:
            heard.append(json.loads(self._server.stdout.readline()))
        return heard

    def start(self, path, last=None):
        """Begin a log; returns the writer's process once it writes."""
        assert self._server.stdin is not None
        self._server.stdin.write(json.dumps({"path": str(path), "last": last}) + "\n")
        self._server.stdin.flush()
        heard = self._hear("child")
        if not any("begin" in line for line in heard):
            heard += self._hear("begin")
        return next(line["child"] for line in heard if "child" in line)

    def end(self, word="signal"):
        """What was reported up to the writer's end, or up to ``word``."""
        return self._hear(word)

    def close(self):
        assert self._server.stdin is not None
        assert self._server.stdout is not None
        self._server.stdin.close()
        self._server.wait(timeout=60)
        self._server.stdout.close()


@pytest.fixture(scope="module")
def writers():
    started = Writers()
    yield started
    started.close()


@pytest.fixture(scope="module")
def whole_run(writers, tmp_path_factory):
    """Seconds of a writer that nobody kills, and its file operations until the log is made and until it is written."""
    start = time.monotonic()
    child = writers.start(tmp_path_factory.mktemp("whole") / "run.zarr")
    reported = writers.end("operations")
    seconds = time.monotonic() - start
    os.kill(child, signal.SIGKILL)
    writers.end()
    return seconds, next(line["made"] for line in reported if "made" in line), reported[-1]["operations"]


def check_what_is_left(path, reported):
    """A log whose writer was killed: nothing yet, or at least all that the writer ever called complete."""
    told = [(line["frames"], line["pings"]) for line in reported if "frames" in line]
    if not path.exists():
        assert not told
        return 0
    stored = open_log(path)
    log = small_log(store_victim.FRAMES)
    frames, pings = len(stored.survey.frames), len(stored.survey.pings)
    assert (frames, pings) >= max(told, default=(0, 0))
    assert same_survey(stored.survey, log.survey, frames, pings)
    assert np.array_equal(stored.load().images, log.images[:frames])
    assert np.array_equal(stored.load().echoes, log.echoes[:pings])
    # No frame is complete before the pings that came with it.
    assert pings >= int(frames * len(log.echoes) / len(log.images))
    return frames


@pytest.mark.parametrize("count", [5, pytest.param(20, marks=pytest.mark.nightly)])
def test_killed_at_any_instant_what_is_complete_is_complete(writers, whole_run, tmp_path, count):
    draw = random.Random(count)
    left = []
    for number in range(count):
        path = tmp_path / f"{number}.zarr"
        child = writers.start(path)
        time.sleep(draw.uniform(0.0, 1.1 * whole_run[0]))
        os.kill(child, signal.SIGKILL)
        reported = writers.end()
        assert reported[-1]["signal"] == signal.SIGKILL
        left.append(check_what_is_left(path, reported))
    assert len(set(left)) > 1


@pytest.mark.parametrize("count", [10, pytest.param(100, marks=pytest.mark.nightly)])
def test_killed_at_any_file_operation_what_is_complete_is_complete(writers, whole_run, tmp_path, count):
    draw = random.Random(count)
    left = []
    for number in range(count):
        path = tmp_path / f"{number}.zarr"
        # One in each stretch, by turns of the log's making and of its writing; a run may differ by a few.
        _, made, written = whole_run
        begin, end = (1, made) if number % 2 == 0 else (made, written - 9)
        writers.start(path, begin + int((number // 2 + draw.random()) * 2 / count * (end - begin)))
        reported = writers.end()
        assert reported[-1]["signal"] == signal.SIGKILL
        left.append(check_what_is_left(path, reported))
    assert len(set(left)) > min(count // 4, 10)


BIG = small_log(1000, rig=small_runs.RIG)
"""A log of 7.7 MB."""


def write_until_full(path):
    """Append rounds until the disk is full; the message."""
    with pytest.raises(StoreError, match=r"run\.zarr: cannot be written on: No space left on device; ") as full:
        write_rounds(path)
    return str(full.value)


def write_rounds(path):
    with StoreWriter(path, BIG.survey) as writer:
        for first in range(0, 1000, 10):
            writer.append(BIG.images[first : first + 10], BIG.echoes[first // 5 : first // 5 + 2])


def check_what_is_kept(path, message):
    stored = open_log(path)
    frames = len(stored.survey.frames)
    assert 0 < frames < 1000
    assert message.endswith(f"{frames} of 1000 frames are complete and stay so; free space or choose another disk")
    assert len(message.splitlines()) == 1
    assert np.array_equal(stored.load().images, BIG.images[:frames])


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 3 MB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = shutil.which("mount")
    if (
        mount is None
        or subprocess.run(
            [mount, "-t", "tmpfs", "-o", "size=3m", "tmpfs", str(disk)], capture_output=True, check=False
        ).returncode
    ):
        pytest.skip("mounting a small file system is not permitted here")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)


def test_a_full_disk_loses_nothing(small_disk):
    message = write_until_full(small_disk / "run.zarr")
    check_what_is_kept(small_disk / "run.zarr", message)
    with pytest.raises(StoreError, match=r"other\.zarr: cannot be created: No space left on device; choose a folder"):
        log_to_store(small_log(), small_disk / "other.zarr")
    assert [entry.name for entry in small_disk.iterdir()] == ["run.zarr"]


@pytest.mark.parametrize("first_failure", [7, 8])
def test_a_disk_that_fills_at_any_file_loses_nothing(tmp_path, monkeypatch, first_failure):
    """Without a small file system: the store refuses to write, from some chunk on, of images or of echoes."""
    from zarr.storage import LocalStore

    path = tmp_path / "run.zarr"
    really, written = LocalStore.set, []

    async def full(store, key, value):
        if path.exists():
            written.append(key)
            if len(written) >= first_failure:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        await really(store, key, value)

    monkeypatch.setattr(LocalStore, "set", full)
    message = write_until_full(path)
    assert len(written) == first_failure
    check_what_is_kept(path, message)


def test_a_failed_writer_takes_no_more(tmp_path, monkeypatch):
    import sonarwarp.store_write

    def fails(*_):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    log = small_log()
    writer = StoreWriter(tmp_path / "run.zarr", log.survey)
    with monkeypatch.context() as patch:
        patch.setattr(sonarwarp.store_write, "replace_text", fails)
        with pytest.raises(StoreError, match=r"run\.zarr: cannot be written on: Input/output error; 0 of 150 frames"):
            writer.append(log.images, log.echoes)
    with pytest.raises(StoreError, match=r"run\.zarr: closed"):
        writer.append(log.images[:1], log.echoes[:1])
    writer.close()
    assert len(open_log(tmp_path / "run.zarr").survey.frames) == 0


def test_no_folder_and_no_permission_are_said_in_one_line(tmp_path):
    log = small_log()
    (tmp_path / "file").write_text("words")
    for name, problem in (("file/run.zarr", "Not a directory"), ("none/run.zarr", "No such file or directory")):
        with pytest.raises(StoreError, match=rf"run\.zarr: cannot be created: {problem}; choose a folder that") as said:
            log_to_store(log, tmp_path / name)
        assert len(str(said.value).splitlines()) == 1
    assert (tmp_path / "file").read_text() == "words"


@pytest.fixture
def locked_folder():
    """A folder that may be read and not written: root, who may write anywhere, is nobody meanwhile."""
    # Outside of pytest's own folders, which nobody may enter.
    folder = Path(tempfile.mkdtemp())
    folder.chmod(0o555)
    user = os.geteuid()
    if user == 0:
        os.seteuid(65534)
    try:
        yield folder
    finally:
        os.seteuid(user)
        shutil.rmtree(folder)


def test_a_folder_that_may_not_be_written_is_said_in_one_line(tmp_path, locked_folder):
    with pytest.raises(StoreError, match=r"run\.zarr: cannot be created: Permission denied; choose a folder"):
        log_to_store(small_log(), locked_folder / "run.zarr")
    cloud = PointCloud(points=np.zeros((1, 3)))
    for name, write in (("a.ply", cloud.write_ply), ("a.npz", cloud.write_npz)):
        with pytest.raises(PermissionError, match=rf"Permission denied: '{locked_folder}/{name}'"):
            write(locked_folder / name)
    assert list(locked_folder.iterdir()) == []


def test_a_full_disk_keeps_the_cloud_that_was_there(tmp_path):
    path = tmp_path / "cloud.npz"
    PointCloud(points=np.ones((1, 3))).write_npz(path)
    whole = path.read_bytes()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    kept = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        with pytest.raises(OSError, match=r"File too large: '.*cloud\.npz'"):
            PointCloud(points=np.random.default_rng(0).normal(size=(1000, 3))).write_npz(path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, kept)
    assert path.read_bytes() == whole
    assert list(tmp_path.iterdir()) == [path]


def test_the_next_log_sweeps_what_a_killed_writer_left(writers, whole_run, tmp_path):
    path = tmp_path / "run.zarr"
    writers.start(path, whole_run[1] // 2)
    assert writers.end()[-1]["signal"] == signal.SIGKILL
    (left,) = tmp_path.iterdir()
    assert left.name.startswith(".run.zarr.")
    log_to_store(small_log(), path)
    assert list(tmp_path.iterdir()) == [path]


def test_what_a_living_writer_makes_is_not_swept_nor_are_other_things(tmp_path):
    path = tmp_path / "run.zarr"
    others = {f".run.zarr.{'a' * 32}.txt", ".run.zarr.notes", f".other.zarr.{'a' * 32}", f".run.zarr.{'a' * 31}"}
    for name in others:
        (tmp_path / name).mkdir()
    with scratch_folder(path) as living:
        log_to_store(small_log(), path)
        assert {entry.name for entry in tmp_path.iterdir()} == {*others, living.name, path.name}
    assert {entry.name for entry in tmp_path.iterdir()} == {*others, path.name}


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_log_that_was_about_to_be_replaced_is_not_lost(tmp_path, overwrite):
    path, log, scratch = tmp_path / "run.zarr", small_log(), tmp_path / f".run.zarr.{'a' * 32}"
    log_to_store(log, path)
    # Killed between the two renames.
    path.rename(scratch.with_name(f"{scratch.name}.old"))
    scratch.mkdir()
    if overwrite:
        log_to_store(small_log(seed=1), path, overwrite=True)
    else:
        with pytest.raises(StoreError, match=r"run\.zarr: exists already"):
            log_to_store(small_log(seed=1), path)
    assert np.array_equal(open_log(path).load().images, small_log(seed=int(overwrite)).images)
    assert list(tmp_path.iterdir()) == [path]


def test_a_read_only_file_system_is_said_in_one_line(small_disk):
    log = small_log()
    log_to_store(log, small_disk / "old.zarr")
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    with pytest.raises(StoreError, match=r"run\.zarr: cannot be created: Read-only file system; choose a folder"):
        log_to_store(log, small_disk / "run.zarr")
    assert np.array_equal(open_log(small_disk / "old.zarr").load().images, log.images)
