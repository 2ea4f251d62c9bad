"""What each step of the improved method brings: ``python -m benchmarks.ablation``.

Prints a table as Markdown: mean errors of slope, area and volume over seeds and objects, with field noise, of the
paper's method, of the improved one, of the improved one without one of its steps, and of its steps put together one
after the other. Every case and seed is simulated once, and all variants reconstruct the same images.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import typer

import sonarwarp as sw
from benchmarks.command import Device, JsonFile, Seeds, report
from benchmarks.variants import variant_rows, variant_table
from sonarwarp.app.experiment import record, run_recorded
from sonarwarp.app.paper_cases import BRICK, PAIRS, Case
from sonarwarp.app.progress import Watch


@dataclass(frozen=True, kw_only=True)
class Step:
    """A step of the improved method, and how it is left out."""

    title: str
    """Name in the table."""
    free_space: Mapping[str, float] = field(default_factory=dict)
    """Fields of ``FreeSpace`` that leave it out."""
    faces: Mapping[str, float] = field(default_factory=dict)
    """Fields of ``Faces`` that leave it out."""


STEPS = (
    # No free depth tells anything, and all places on an arc weigh the same: a wide deviation would leave differences
    # that still choose the likeliest.
    Step(title="free depth", free_space={"proven": 10.0, "solid": 10.0}),
    Step(title="height guard", free_space={"least_height": 0.0}),
    Step(title="sides", free_space={"side_share": 0.0}),
    Step(title="strays", free_space={"stray_points": 0}),
    Step(title="repeats", free_space={"hit_spacing": 0.0}),
    # A free depth under minus its bound.
    Step(title="faces", faces={"in_doubt": -10.0}),
)
"""In the order in which the method takes them."""


def without(steps: Iterable[Step]) -> sw.ReconstructionSettings:
    """The improved method's settings, but for some steps."""
    settings = sw.ReconstructionSettings()
    for step in steps:
        settings = replace(
            settings,
            free_space=replace(settings.free_space, **step.free_space),
            faces=replace(settings.faces, **step.faces),
        )
    return settings


@dataclass(frozen=True, kw_only=True)
class Variant:
    """A row of the table."""

    title: str
    """Name in the table."""
    settings: sw.ReconstructionSettings
    """What the reconstruction is told."""


VARIANTS = (
    Variant(title="paper, as printed", settings=sw.ReconstructionSettings(method="paper", causal=True)),
    Variant(title="paper, offline", settings=sw.ReconstructionSettings(method="paper")),
    Variant(title="profiling sonar's field alone", settings=without(STEPS)),
    # The last but one of these is the method without its last step, the last one is the method.
    *(Variant(title=f"+ {step.title}", settings=without(STEPS[place:])) for place, step in enumerate(STEPS[:-1], 1)),
    Variant(title=f"+ {STEPS[-1].title}: the whole method", settings=without(())),
    *(Variant(title=f"whole method - {step.title}", settings=without([step])) for step in STEPS[:-1]),
)
"""The paper's method, the improved one step by step, and the improved one less one step.

Less the last step is the row before the whole method.
"""

CASES = (BRICK, *(case for case in PAIRS if case.arrangement == "misaligned" and case.object in ("60", "90")))
"""What is reconstructed."""


def main(seeds: Seeds = 3, json_file: JsonFile = None, device: Device = "cpu") -> None:
    """Print what each step of the improved method brings as a Markdown table."""
    report(partial(measure, CASES, VARIANTS, seeds=range(seeds)), variant_table, json_file=json_file, device=device)


def measure(
    cases: Sequence[Case], variants: Sequence[Variant], *, seeds: Sequence[int], device: str, watch: Watch
) -> list[dict[str, Any]]:
    """Rows of the fused clouds, one per variant, object and seed.

    Args:
        cases: what to reconstruct, with field noise.
        variants: how.
        seeds: of the runs.
        device: Warp device.
        watch: told of every simulation and every reconstruction.
    """
    advance = watch("ablation", len(cases) * len(seeds) * (1 + len(variants)), "passes")
    measured = []
    for case in cases:
        for seed in seeds:
            experiment = case.experiment(seed, "field")
            # A run's images take 200 to 300 MB: one run at a time.
            log = record(experiment, device=device)
            advance(1)
            for variant in variants:
                run = run_recorded(replace(experiment, settings=variant.settings), log, device=device)
                measured += variant_rows(variant.title, run)
                advance(1)
    return measured


if __name__ == "__main__":
    typer.run(main)
