"""A log written to disk and read back: seconds against the time that it spans, memory, bytes.

Writing and reading run in a fresh process each, so that the growth of its peak memory is theirs. What is written are
simulated frames with noise, made beforehand, over and over: a chunk is compressed by itself, so repetition saves
nothing. Writing waits for the disk (``sonarwarp.durable``); reading comes after it and finds the files in the page
cache.
"""

from __future__ import annotations

import multiprocessing
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

import sonarwarp as sw
from benchmarks.run import machine
from sonarwarp_scenes import Roughness, Trajectory, brick_deployment, straight_trajectory

FRAMES = 900
"""Frames in the log, of 96 x 512 at 10 Hz."""

_PRESET = "paper field"

# Frames made beforehand, from 10 s before the end of the brick's run, and appended at a time.
_MADE = 32
_BEFORE_END = 10.0


# What Linux says of a process; other systems cannot tell the memory of some work from that of the imports before it.
_STATUS = Path("/proc/self/status")

_Work = Callable[[Path, int], Callable[[], None]]
"""Prepares some work on the log in a folder, and gives what does it."""


def measure_log(
    *, device: str, seed: int, frames: int = FRAMES, watch: Callable[[str], None] = print
) -> dict[str, Any]:
    """One row of results.

    Args:
        device: Warp device that makes the frames; the log is the host's work.
        seed: of their noise.
        frames: in the log.
        watch: told what is going on.
    """
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        watch(f"log: making {_MADE} frames")
        _make(place, device, seed)
        watch(f"log: writing {frames} frames")
        write_s, write_mib = _alone(_write, place, frames)
        watch(f"log: reading {frames} frames")
        read_s, read_mib = _alone(_read, place, frames)
        log = place / "log"
        fls = sw.PRESETS[_PRESET].fls
        span = frames / fls.rate
        image = 4 * fls.beams * fls.bins / 2**20
        return {
            "case": "log",
            "seed": seed,
            "frames": frames,
            "beams": fls.beams,
            "bins": fls.bins,
            "span_s": span,
            "write_s": write_s,
            "read_s": read_s,
            "write_times_real_time": span / write_s,
            "read_times_real_time": span / read_s,
            "write_memory_mib": write_mib,
            "read_memory_mib": read_mib,
            "chunk_mib": image * len(next(sw.open_log(log).image_chunks())[1]),
            "images_mib": image * frames,
            "disk_mib": sum(file.stat().st_size for file in log.rglob("*") if file.is_file()) / 2**20,
            **machine(device),
        }


def _survey(frames: int) -> sw.Survey:
    rig = sw.PRESETS[_PRESET]
    # A little longer than to the last frame, or rounding might lose it.
    span = (frames - 0.5) / rig.fls.rate
    return sw.plan_survey(rig, [straight_trajectory((-9.0, 0.0, 1.8), heading=0.0, speed=0.1, length=0.1 * span)])


def _make(place: Path, device: str, seed: int) -> None:
    rig = sw.PRESETS[_PRESET]
    brick = brick_deployment(roughness=Roughness(seed=seed))
    times = brick.trajectory.times[-1] - _BEFORE_END + np.arange(_MADE) / rig.fls.rate
    part = Trajectory(times=times, poses=brick.trajectory.at(times))
    log = sw.simulate(rig, brick.scene, part, noise=sw.Noise(), seed=seed, device=device)
    np.save(place / "images.npy", log.images)
    np.save(place / "echoes.npy", log.echoes)


def _alone(work: _Work, place: Path, frames: int) -> tuple[float, float | None]:
    """Seconds of some work, and by how much memory was up at its peak [MiB], in a process of its own."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as process:
        return process.submit(_watched, work, place, frames).result()


def _watched(work: _Work, place: Path, frames: int) -> tuple[float, float | None]:
    run = work(place, frames)
    before = None
    if _STATUS.exists():
        # From here on the peak is that of the work: Linux sets it back to what is in use.
        Path("/proc/self/clear_refs").write_text("5")
        before = _peak()
    start = time.perf_counter()
    run()
    seconds = time.perf_counter() - start
    return seconds, None if before is None else _peak() - before


def _peak() -> float:
    """Most memory in use [MiB]."""
    (line,) = [line for line in _STATUS.read_text().splitlines() if line.startswith("VmHWM")]
    return float(line.split()[1]) / 2**10


def _write(place: Path, frames: int) -> Callable[[], None]:
    images, echoes = np.load(place / "images.npy"), np.load(place / "echoes.npy")
    survey = _survey(frames)
    # The first import of zarr is neither writing nor reading.
    import zarr  # noqa: F401

    assert len(survey.frames) == frames

    def run() -> None:
        with sw.StoreWriter(place / "log", survey) as writer:
            pings = np.resize(np.arange(len(echoes)), len(survey.pings))
            writer.append(images[:0], echoes[pings])
            for first in range(0, frames, len(images)):
                writer.append(images[: frames - first], echoes[:0])

    return run


def _read(place: Path, frames: int) -> Callable[[], None]:
    import zarr  # noqa: F401

    def run() -> None:
        log = sw.open_log(place / "log")
        read = sum(len(rows) for _, rows in log.image_chunks())
        pings = sum(len(rows) for _, rows in log.echo_chunks())
        assert (read, pings) == (frames, len(log.survey.pings))

    return run
