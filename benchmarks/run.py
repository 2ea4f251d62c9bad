"""Measures a case from scene to cloud: frames per second, each stage's share, peak memory."""

from __future__ import annotations

import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import warp as wp

import sonarwarp as sw
from benchmarks.cases import Case
from benchmarks.stages import timed_stages
from sonarwarp.app.machine import describe_device, versions
from sonarwarp.simulator import MEMORY


@dataclass(frozen=True)
class _Batch:
    simulator: sw.Simulator
    reconstructor: sw.Reconstructor
    frames: int
    pings: int
    rounds: int

    def run(self) -> float:
        """Seconds for the whole batch, from the first round to the host's copy of the clouds."""
        self.simulator.reset()
        self.reconstructor.reset()
        start = time.perf_counter()
        for _ in range(self.rounds):
            self.simulator.step()
            self.reconstructor.step(self.simulator.images, self.simulator.echoes)
        self.reconstructor.read()
        return time.perf_counter() - start


def _plan(case: Case, device: str, seed: int, memory: int) -> _Batch:
    deployment = case.deployment()
    truth, survey = sw.plan_disturbed(
        case.rig,
        [deployment.trajectory] * case.trajectories,
        motion=case.motion,
        navigation=case.navigation,
        seed=seed,
        frames_from=deployment.frames_from,
    )
    reconstructor = sw.Reconstructor(case.rig, settings=case.settings, device=device)
    schedule = reconstructor.plan_schedule(survey, frames=sw.frames_per_round(case.rig, memory))
    simulator = sw.Simulator(case.rig, noise=case.noise, device=device)
    simulator.plan(truth, [deployment.scene], schedule, seed=seed)
    reconstructor.plan(survey, schedule, seed=seed)
    return _Batch(simulator, reconstructor, len(survey.frames), len(survey.pings), schedule.rounds)


def measure(
    case: Case,
    *,
    device: str,
    seed: int = 0,
    repeats: int = 3,
    memory: int = MEMORY,
    watch: Callable[[str], None] = print,
) -> dict[str, Any]:
    """One row of results; compilation and warm-up are apart, the rate is the median of the repeats.

    Args:
        case: what to run.
        device: Warp device.
        seed: of noise, motion, navigation errors and particles.
        repeats: timed passes.
        memory: bytes of a round's images and scratch.
        watch: told what is going on.
    """
    watch(f"{case.name}: planning")
    start = time.perf_counter()
    batch = _plan(case, device, seed, memory)
    planning = time.perf_counter() - start
    watch(f"{case.name}: warm-up of {batch.frames} frames")
    warm_up = batch.run()
    seconds = []
    for number in range(repeats):
        watch(f"{case.name}: pass {number + 1} of {repeats}")
        seconds.append(batch.run())
    watch(f"{case.name}: stages")
    with timed_stages(wp.get_device(device)) as stages:
        staged = batch.run()
    stages["other"] = staged - sum(stages.values())
    frame = 1e3 / batch.frames
    return {
        "case": case.name,
        "seed": seed,
        "trajectories": case.trajectories,
        "frames": batch.frames,
        "pings": batch.pings,
        "beams": case.rig.fls.beams,
        "bins": case.rig.fls.bins,
        "method": case.settings.method,
        "hypotheses": _hypotheses(case.settings),
        "frames_per_second": batch.frames / statistics.median(seconds),
        "frames_per_second_range": [batch.frames / max(seconds), batch.frames / min(seconds)],
        "planning_s": planning,
        "warm_up_s": warm_up,
        "stage_ms_per_frame": {
            name: value * frame for name, value in sorted(stages.items(), key=lambda stage: -stage[1])
        },
        "peak_memory_mib": _peak_memory(device),
        **machine(device),
    }


def _hypotheses(settings: sw.ReconstructionSettings) -> int:
    """Places weighed per beam, whatever the method calls them."""
    return settings.particles if settings.method == "paper" else settings.free_space.hypotheses


def _peak_memory(device: str) -> float:
    place = wp.get_device(device)
    if place.is_cuda:
        return wp.get_mempool_used_mem_high(place) / 2**20
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    # Kibibytes, but bytes on macOS.
    return peak / (2**20 if sys.platform == "darwin" else 2**10)


def machine(device: str) -> dict[str, Any]:
    """What a figure depends on besides the case: device, versions, commit, date."""
    return {
        "device": describe_device(device),
        "versions": versions(),
        "commit": _commit(),
        "date": datetime.now(UTC).date().isoformat(),
    }


def _commit() -> str | None:
    command = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return None
