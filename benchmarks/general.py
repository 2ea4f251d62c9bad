"""Whether the defaults hold where nobody chose them: ``python -m benchmarks.general``.

Prints a table as Markdown, of both methods' error rates over wedges, tilts, altitudes and speeds that the paper does
not use, with field noise. Every object can be seen: its foot lies in the imaging sonar's window, its width in the
swath.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

import sonarwarp as sw
from benchmarks.run import machine
from benchmarks.tables import markdown, prepare, write_json
from sonarwarp.app.experiment import run_batch
from sonarwarp.app.paper_cases import Case
from sonarwarp.app.paper_summary import summarise
from sonarwarp.app.progress import Watch, show_progress
from sonarwarp.app.rows import evaluate_objects, object_rows
from sonarwarp_scenes import Wedge, slope_deployment


def wedge_case(
    slope_deg: float, *, height: float, width: float, tilt_deg: float, altitude: float, speed: float = 0.1
) -> Case:
    """A wedge with a top of 1 m, under the paper's sonars tilted otherwise.

    Raises:
        ValueError: a wedge that the imaging sonar cannot see whole.
    """
    rig = sw.PRESETS["paper simulation"].tilted(tilt_deg)
    down = math.sin(math.radians(tilt_deg) + rig.fls.half_elevation)
    reach = altitude / down
    swath = 2.0 * math.sin(float(rig.fls.azimuth_edge[-1])) * (altitude - height) / down
    if reach > float(rig.fls.range_edge[-1]) - 0.1:
        raise ValueError(f"altitude: {altitude:g} m, the seabed begins {reach:.2f} m away, outside of the window")
    if swath < width + 0.06:
        raise ValueError(f"width: {width:g} m, must be under the swath at its top, {swath:.2f} m, less 0.06 m")
    depth = 1.0 + height / math.tan(math.radians(slope_deg))
    shape = Wedge(width=width, height=height, depth=depth, front_slope_deg=slope_deg)
    return Case(
        name="general",
        object=f"{slope_deg:g} deg, {height:g} m, tilt {tilt_deg:g} deg, altitude {altitude:g} m, {speed:g} m/s",
        rig=rig,
        deploy=partial(slope_deployment, shape, altitude=altitude, speed=speed, imaging_distance=5.0),
    )


CASES = (
    wedge_case(25.0, height=0.5, width=0.5, tilt_deg=40.0, altitude=2.5),
    wedge_case(50.0, height=0.5, width=0.5, tilt_deg=40.0, altitude=2.5),
    wedge_case(75.0, height=0.5, width=0.5, tilt_deg=40.0, altitude=2.5),
    wedge_case(90.0, height=0.4, width=0.3, tilt_deg=20.0, altitude=1.5),
    wedge_case(75.0, height=0.5, width=0.4, tilt_deg=30.0, altitude=2.0),
    wedge_case(60.0, height=0.8, width=0.5, tilt_deg=45.0, altitude=3.5),
    wedge_case(90.0, height=0.6, width=0.5, tilt_deg=45.0, altitude=3.0, speed=0.2),
    wedge_case(90.0, height=0.3, width=0.3, tilt_deg=35.0, altitude=2.5, speed=0.05),
)
"""What is reconstructed."""

FIGURES = ("slope_error", "area_error", "volume_error")
"""Columns, means over the seeds."""


def main(
    seeds: Annotated[int, typer.Option(min=1, max=10_000, help="Runs of each case.")] = 1,
    json_file: Annotated[Path | None, typer.Option("--json", help="File for the rows.")] = None,
    device: Annotated[str, typer.Option(help="Warp device, such as cpu or cuda:0.")] = "cpu",
) -> None:
    """Print error rates as a Markdown table."""
    place = prepare(json_file, device)
    with show_progress() as watch:
        measured = measure(CASES, seeds=range(seeds), device=place, watch=watch)
    write_json(json_file, [{**row, **machine(place)} for row in measured])
    print(table(measured))


def measure(cases: Sequence[Case], *, seeds: Sequence[int], device: str, watch: Watch) -> list[dict[str, Any]]:
    """Rows as ``sonarwarp paper`` has them: one per case, seed and method, with field noise.

    Args:
        cases: what to reconstruct.
        seeds: of the runs.
        device: Warp device.
        watch: told of the work's progress.
    """
    measured: list[dict[str, Any]] = []
    for case in cases:
        for batch in case.batches(seeds, "field"):
            for run in run_batch(batch, device=device, watch=watch):
                measured += object_rows(run, evaluate_objects(run))
    return measured


def table(measured: Sequence[dict[str, Any]]) -> str:
    """Means over the seeds, a case and method a line."""
    lines = []
    for summary in summarise(measured):
        means = [summary.mean(name) for name in FIGURES]
        lines.append((summary.object, summary.method, *("none" if mean is None else f"{mean:.3f}" for mean in means)))
    return markdown(("Object and run", "Method", "Slope error", "Area error", "Volume error"), lines)


if __name__ == "__main__":
    typer.run(main)
