"""How sure each point is, and rightly so: ``python -m benchmarks.calibration``.

Prints a table as Markdown, of the fused points in the paper's experiments with field noise, pooled: how often what they
claim holds, and how sharp it is, by class. The imaging sonar's (top, front, fallback) claim an interval of elevation,
the profiling sonar's (face) a distance across themselves (:mod:`sonarwarp.metrics.claims`).

What an imaging beam really met first is cast for with 3 x 512 rays in its true pose. Every tenth frame is enough, a
second apart at the paper's 10 Hz: clouds are made of all frames, then cut to those.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields, replace
from functools import partial
from typing import Any

import numpy as np
import typer

from benchmarks.command import Device, JsonFile, Seeds, report
from benchmarks.tables import markdown
from sonarwarp.app.experiment import Run, run_batch
from sonarwarp.app.paper_cases import BRICK, PAIRS, SLOPES, Case
from sonarwarp.app.progress import Watch
from sonarwarp.metrics import Claims, contact_claims, evaluate_calibration, face_claims
from sonarwarp.truth import first_contacts

CASES = (
    BRICK,
    *(case for case in PAIRS if case.arrangement == "misaligned"),
    *(case for case in SLOPES if float(case.object) >= 45.0),
)
"""What is reconstructed."""

EVERY = 10
"""Frames from one whose first contacts are known to the next."""

KINDS = ("top", "front", "fallback", "face")
"""Classes of points, in the order of the table."""

ALL = "all"
"""Experiment in rows where all are drawn together."""


def main(seeds: Seeds = 1, json_file: JsonFile = None, device: Device = "cpu") -> None:
    """Print coverage and sharpness of points as a Markdown table."""
    report(partial(measure, CASES, seeds=range(seeds)), table, json_file=json_file, device=device)


def measure(cases: Sequence[Case], *, seeds: Sequence[int], device: str, watch: Watch) -> list[dict[str, Any]]:
    """One row per case and class of point, all seeds pooled, then one per class over all cases.

    Args:
        cases: what to reconstruct, with field noise.
        seeds: of the runs.
        device: Warp device.
        watch: told of the work's progress.
    """
    every, measured = [], []
    for case in cases:
        judged = [
            judge(run, watch)
            for batch in case.batches(seeds, "field")
            for run in run_batch(batch, device=device, watch=watch)
        ]
        every += judged
        names = {"experiment": case.name, "object": case.object, "deployment": case.arrangement}
        measured += _rows(judged, names, len(seeds))
    return measured + _rows(every, {"experiment": ALL, "object": None, "deployment": None}, len(seeds))


def judge(run: Run, watch: Watch) -> Claims:
    """What a run's points claim, those of every tenth frame and of all pings, beside what is true."""
    frames, scene = run.truth.frames, run.experiment.deployment.scene
    kept = {column.name: getattr(frames, column.name)[::EVERY] for column in fields(frames)}
    truth = replace(run.truth, frames=replace(frames, **kept))
    advance = watch(f"{run.experiment.title}: what the beams met", 1, "")
    contacts = first_contacts(truth, [scene], device=run.device)
    advance(1)
    cloud = run.clouds.fused
    imaged = cloud.select(np.isin(cloud.attributes["frame"], truth.frames.number))
    return Claims.join(
        contact_claims(imaged, truth, scene, contacts), face_claims(cloud, truth, scene, device=run.device)
    )


def _rows(claims: Sequence[Claims], names: dict[str, Any], seeds: int) -> list[dict[str, Any]]:
    return [
        {
            **names,
            "noise": "field",
            "seeds": seeds,
            "kind": metrics.kind,
            "points": metrics.points,
            "coverage": metrics.coverage,
            "sharpness_deg": math.degrees(metrics.sharpness),
        }
        for metrics in evaluate_calibration(Claims.join(*claims))
    ]


def table(measured: Sequence[dict[str, Any]]) -> str:
    """Rows over all cases as a table, a class of points a line."""
    pooled = {row["kind"]: row for row in measured if row["experiment"] == ALL}
    lines = [
        (kind, str(row["points"]), f"{row['coverage']:.1%}", f"{row['sharpness_deg']:.2f}")
        for kind, row in ((kind, pooled[kind]) for kind in KINDS if kind in pooled)
    ]
    return markdown(("Points", "Judged", "Held in 95 %", "Median deviation [deg]"), lines)


if __name__ == "__main__":
    typer.run(main)
