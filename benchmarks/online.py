"""The default method online: ``python -m benchmarks.online``.

A run is read every two seconds or sooner, as a vehicle under way would, and what a read gives is published for good: a
point is taken as the first read has it that comes a delay after the instant of its frame or ping, and never moved or
taken back. So strays stay that a later read takes out, and of repeated hits the first one beside a surer one.

Prints errors of what was published, by delay, beside those of the last read, as a Markdown table; means over seeds and
objects, with field noise.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
import typer
import warp as wp

import sonarwarp as sw
from benchmarks.ablation import CASES
from benchmarks.command import Device, JsonFile, Seeds, report
from benchmarks.tables import markdown
from benchmarks.variants import variant_cells, variant_rows
from sonarwarp.app.experiment import Engines, Experiment, Run, plan_surveys
from sonarwarp.app.paper_cases import Case
from sonarwarp.app.progress import Watch
from sonarwarp.schedule import EMPTY

DELAYS = (0.0, 2.0, 10.0)
"""How long points are thought over before they are published [s]."""

EVERY = 2.0
"""Most time from read to read [s]. A round ends before a ping whose frames no longer fit: the slow profiling sonar's of
the brick are read every 1.5 s."""


@dataclass(kw_only=True)
class Publisher:
    """Points as a reader has them who takes each when it is due, and then never again."""

    delay: float
    """Least time from a point's frame or ping to its publication [s]."""
    parts: list[sw.PointCloud] = field(default_factory=list)
    """What was published, read by read."""
    known: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """Identities of what was published."""

    def take(self, cloud: sw.PointCloud, now: float) -> None:
        """Publish what is due and new.

        Args:
            cloud: of one trajectory, read at ``now``.
            now: time of the last frame worked in [s].
        """
        met = identities(cloud)
        fresh = (cloud.attributes["time"] <= now - self.delay) & ~np.isin(met, self.known)
        self.parts.append(cloud.select(fresh))
        self.known = np.union1d(self.known, met[fresh])

    @property
    def published(self) -> sw.PointCloud:
        """All of it."""
        return sw.PointCloud.join(*self.parts)


def identities(cloud: sw.PointCloud) -> np.ndarray:
    """What a point is of: its sonar, frame or ping, and beam or strip; points of one strip share it; shape [point]."""
    source, frame, beam = (cloud.attributes[name].astype(np.int64) for name in ("source", "frame", "beam"))
    return (source << 60) | (frame << 24) | beam


def main(seeds: Seeds = 3, json_file: JsonFile = None, device: Device = "cpu") -> None:
    """Print the errors of points that are published on the way as a Markdown table."""
    report(partial(measure, CASES, DELAYS, seeds=range(seeds)), table, json_file=json_file, device=device)


def measure(
    cases: Sequence[Case], delays: Sequence[float], *, seeds: Sequence[int], device: str, watch: Watch
) -> list[dict[str, Any]]:
    """Rows of the fused clouds, one per delay, object and seed, and of the last read.

    Args:
        cases: what to reconstruct, with field noise.
        delays: [s].
        seeds: of the runs.
        device: Warp device.
        watch: told of every frame.
    """
    measured = []
    for case in cases:
        for seed in seeds:
            experiment = case.experiment(seed, "field")
            online = replace(experiment.settings, causal=True)
            measured += _measure(replace(experiment, settings=online), delays, device, watch)
    return measured


def _measure(experiment: Experiment, delays: Sequence[float], device: str, watch: Watch) -> list[dict[str, Any]]:
    truth, survey = plan_surveys(experiment)
    engines = Engines([experiment], device)
    reconstructor = engines.reconstructor
    schedule = reconstructor.plan_schedule(survey, frames=max(round(EVERY * experiment.rig.fls.rate), 1))
    engines.plan(truth, survey, schedule)
    advance = watch(experiment.title, len(survey.frames), "frames")
    publishers = [Publisher(delay=delay) for delay in delays]
    # Kernels load in this read, not in a timed one.
    clouds, reads = reconstructor.read(), []
    began = time.perf_counter()
    for shown in schedule.round_frame:
        engines.step()
        wp.synchronize_device(device)
        start = time.perf_counter()
        clouds = reconstructor.read()
        reads.append(time.perf_counter() - start)
        frames = shown[shown != EMPTY]
        # A round of pings alone has no such time: nothing is due.
        now = float(survey.frames.time[frames].max(initial=-math.inf))
        for publisher in publishers:
            publisher.take(clouds.fused, now)
        advance(len(frames))
    for publisher in publishers:
        publisher.take(clouds.fused, math.inf)
    run = Run(
        experiment=experiment,
        device=device,
        survey=survey,
        truth=truth,
        clouds=clouds,
        critical_range=reconstructor.contacts.critical_range.numpy(),
        seconds=time.perf_counter() - began,
    )
    fused = {f"after {publisher.delay:g} s": publisher.published for publisher in publishers}
    fused["last read"] = clouds.fused
    return [
        {**row, "longest_read": max(reads)}
        for variant, cloud in fused.items()
        for row in variant_rows(variant, replace(run, clouds=replace(clouds, fused=cloud)))
    ]


def table(measured: Sequence[Mapping[str, Any]]) -> str:
    """Rows of :func:`measure` as a table, a delay a line, and how long reads took at most."""
    headings, lines = variant_cells(measured)
    longest: dict[tuple[Any, ...], float] = {}
    for row in measured:
        case = (row["experiment"], row["object"], row["deployment"])
        longest[case] = max(row["longest_read"], longest.get(case, 0.0))
    return markdown(headings, [*lines, ["longest read", *(f"{seconds:.1f} s" for seconds in longest.values())]])


if __name__ == "__main__":
    typer.run(main)
