"""What each part of the field noise costs, and what more of it would: ``python -m benchmarks.conditions``.

Prints the default method's mean errors of slope, area and volume over seeds and objects as a Markdown table, under the
complete field noise, without one of its parts, and under more than it. A seed draws the same everywhere: what is
switched off leaves the rest as it was.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import typer

import sonarwarp as sw
from benchmarks.command import Device, JsonFile, Seeds, report
from benchmarks.variants import variant_rows, variant_table
from sonarwarp.app.experiment import Run, run_recorded
from sonarwarp.app.paper_cases import BRICK, PAIRS, Case
from sonarwarp.app.progress import Watch


@dataclass(frozen=True, kw_only=True)
class Condition:
    """A row of the table."""

    title: str
    """Name in the table."""
    noise: sw.Noise = field(default_factory=sw.Noise)
    motion: sw.Motion = field(default_factory=sw.Motion)
    navigation: sw.Navigation = field(default_factory=sw.Navigation)
    rough: bool = True
    """Whether the seabed is."""


_NAVIGATION = sw.Navigation()

CONDITIONS = (
    Condition(title="field noise"),
    Condition(title="no speckle", noise=sw.Noise(speckle=False)),
    Condition(title="no background", noise=sw.Noise(background_db=None)),
    Condition(title="flat seabed", rough=False),
    Condition(title="no waves", motion=sw.NO_MOTION),
    Condition(title="exact DVL", navigation=replace(_NAVIGATION, dvl_scale=0.0, dvl_noise=0.0)),
    Condition(
        title="exact depth, altitude, attitude",
        navigation=replace(_NAVIGATION, depth=0.0, altitude=0.0, attitude_deg=0.0),
    ),
    Condition(
        title="exact mounts and head",
        navigation=replace(_NAVIGATION, head_angle_deg=0.0, lever_arm=0.0, boresight_deg=0.0),
    ),
    Condition(title="background up 6 dB", noise=sw.Noise(background_db=-19.0)),
    Condition(
        title="waves twice as high",
        motion=sw.Motion(heave=0.06, roll_deg=2.0, pitch_deg=2.0, yaw_deg=2.0),
    ),
    Condition(
        title="mounts and head twice as far off",
        navigation=replace(_NAVIGATION, head_angle_deg=0.4, lever_arm=0.02, boresight_deg=0.4),
    ),
    Condition(title="DVL's bias 0.1 cm/s", navigation=replace(_NAVIGATION, dvl_bias=0.001)),
)
"""The complete noise, less one part, and more than it."""

CASES = (BRICK, *(case for case in PAIRS if (case.object, case.arrangement) == ("90", "misaligned")))
"""What is reconstructed."""


def main(seeds: Seeds = 3, json_file: JsonFile = None, device: Device = "cpu") -> None:
    """Print what parts of the field noise cost as a Markdown table."""
    report(partial(measure, CASES, CONDITIONS, seeds=range(seeds)), variant_table, json_file=json_file, device=device)


def measure(
    cases: Sequence[Case], conditions: Sequence[Condition], *, seeds: Sequence[int], device: str, watch: Watch
) -> list[dict[str, Any]]:
    """Rows of the fused clouds, one per condition, object and seed.

    Args:
        cases: what to reconstruct.
        conditions: under what.
        seeds: of the runs.
        device: Warp device.
        watch: told of every run.
    """
    advance = watch("conditions", len(cases) * len(conditions) * len(seeds), "runs")
    measured = []
    for case in cases:
        for condition in conditions:
            for seed in seeds:
                run = run_under(condition, case, seed, device=device)
                measured += variant_rows(condition.title, run)
                advance(1)
    return measured


def run_under(condition: Condition, case: Case, seed: int, *, device: str) -> Run:
    """Simulate a run of a case under a condition, and reconstruct it."""
    experiment = case.experiment(seed, "field")
    if not condition.rough:
        experiment = replace(experiment, deployment=case.experiment(seed, "none").deployment)
    deployment = experiment.deployment
    log = sw.simulate(
        experiment.rig,
        deployment.scene,
        deployment.trajectory,
        frames_from=deployment.frames_from,
        noise=condition.noise,
        motion=condition.motion,
        navigation=condition.navigation,
        seed=seed,
        device=device,
    )
    return run_recorded(experiment, log, device=device)


if __name__ == "__main__":
    typer.run(main)
