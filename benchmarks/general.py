"""Whether the defaults hold where nobody chose them: ``python -m benchmarks.general``.

Prints a table as Markdown, of both methods' error rates over shapes, tilts, altitudes and speeds that the paper does
not use, with field noise. Every object can be seen: its foot lies in the imaging sonar's window, its width in the
swath. Yet round objects hide part of their back, which no run ahead of it shows, and closed forms count it: a third
column tells what of the figures the surface itself would have, sampled without error wherever a sonar could see it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import typer

import sonarwarp as sw
from benchmarks.command import Device, JsonFile, Seeds, report
from benchmarks.tables import ERRORS_HEADING, error_cell, markdown
from sonarwarp.app.experiment import run_batch
from sonarwarp.app.paper_cases import Case
from sonarwarp.app.paper_summary import Summary, summarise
from sonarwarp.app.progress import Watch
from sonarwarp.app.rows import METHODS, SEEN, evaluate_objects, evaluate_seen, object_rows
from sonarwarp_scenes import Frustum, LyingCylinder, Shape, Sphere, Wedge, object_deployment


def seen_case(name: str, shape: Shape, *, tilt_deg: float, altitude: float, speed: float = 0.1) -> Case:
    """A shape alone, under the paper's sonars tilted otherwise.

    Raises:
        ValueError: a shape that the imaging sonar cannot see whole.
    """
    rig = sw.PRESETS["paper simulation"].tilted(tilt_deg)
    down = math.sin(math.radians(tilt_deg) + rig.fls.half_elevation)
    reach = altitude / down
    swath = 2.0 * math.sin(float(rig.fls.azimuth_edge[-1])) * (altitude - shape.height) / down
    if reach > float(rig.fls.range_edge[-1]) - 0.1:
        raise ValueError(f"altitude: {altitude:g} m, the seabed begins {reach:.2f} m away, outside of the window")
    if swath < shape.width + 0.06:
        raise ValueError(f"width: {shape.width:g} m, must be under the swath at its top, {swath:.2f} m, less 0.06 m")
    return Case(
        name="general",
        object=f"{name}, {shape.height:.3g} m, tilt {tilt_deg:g} deg, altitude {altitude:g} m, {speed:g} m/s",
        rig=rig,
        deploy=partial(object_deployment, shape, altitude=altitude, speed=speed, imaging_distance=5.0),
    )


def wedge(slope_deg: float, *, height: float, width: float) -> Wedge:
    """A wedge with a top of 1 m."""
    depth = 1.0 + height / math.tan(math.radians(slope_deg))
    return Wedge(width=width, height=height, depth=depth, front_slope_deg=slope_deg)


def cone(slope_deg: float, *, radius: float, height: float | None = None) -> Frustum:
    """A cone, or as much of it as is ``height`` tall."""
    rise = math.tan(math.radians(slope_deg))
    if height is None:
        return Frustum(base_radius=radius, top_radius=0.0, height=radius * rise)
    return Frustum(base_radius=radius, top_radius=radius - height / rise, height=height)


def standing(radius: float, *, height: float) -> Frustum:
    """A cylinder on its end."""
    return Frustum(base_radius=radius, top_radius=radius, height=height)


def lying(radius: float, *, centre_height: float) -> LyingCylinder:
    """A cylinder across the run."""
    return LyingCylinder(radius=radius, length=0.6, centre_height=centre_height)


CASES = (
    seen_case("25 deg", wedge(25.0, height=0.5, width=0.5), tilt_deg=40.0, altitude=2.5),
    seen_case("50 deg", wedge(50.0, height=0.5, width=0.5), tilt_deg=40.0, altitude=2.5),
    seen_case("75 deg", wedge(75.0, height=0.5, width=0.5), tilt_deg=40.0, altitude=2.5),
    seen_case("90 deg", wedge(90.0, height=0.4, width=0.3), tilt_deg=20.0, altitude=1.5),
    seen_case("75 deg", wedge(75.0, height=0.5, width=0.4), tilt_deg=30.0, altitude=2.0),
    seen_case("60 deg", wedge(60.0, height=0.8, width=0.5), tilt_deg=45.0, altitude=3.5),
    seen_case("90 deg", wedge(90.0, height=0.6, width=0.5), tilt_deg=45.0, altitude=3.0, speed=0.2),
    seen_case("90 deg", wedge(90.0, height=0.3, width=0.3), tilt_deg=35.0, altitude=2.5, speed=0.05),
    seen_case("standing cylinder", standing(0.3, height=0.6), tilt_deg=30.0, altitude=2.5),
    seen_case("standing cylinder", standing(0.4, height=0.5), tilt_deg=45.0, altitude=4.0),
    seen_case("cone of 35 deg", cone(35.0, radius=0.6), tilt_deg=45.0, altitude=3.0),
    seen_case("cone of 45 deg", cone(45.0, radius=0.5), tilt_deg=30.0, altitude=2.5),
    seen_case("cone of 60 deg", cone(60.0, radius=0.35), tilt_deg=45.0, altitude=3.0),
    seen_case("frustum of 70 deg", cone(70.0, radius=0.4, height=0.4), tilt_deg=30.0, altitude=2.0),
    seen_case("dome", Sphere(radius=0.4, centre_height=0.0), tilt_deg=30.0, altitude=2.0),
    seen_case("dome", Sphere(radius=0.5, centre_height=0.0), tilt_deg=45.0, altitude=3.5),
    seen_case("sphere at rest", Sphere(radius=0.3, centre_height=0.3), tilt_deg=30.0, altitude=2.5),
    seen_case("half a lying cylinder", lying(0.4, centre_height=0.0), tilt_deg=20.0, altitude=1.5),
    seen_case("half a lying cylinder", lying(0.5, centre_height=0.0), tilt_deg=45.0, altitude=3.0),
    seen_case("lying cylinder at rest", lying(0.25, centre_height=0.25), tilt_deg=30.0, altitude=2.5),
)
"""What is reconstructed."""


def main(seeds: Seeds = 1, json_file: JsonFile = None, device: Device = "cpu") -> None:
    """Print error rates as a Markdown table."""
    report(partial(measure, CASES, seeds=range(seeds)), table, json_file=json_file, device=device)


def measure(cases: Sequence[Case], *, seeds: Sequence[int], device: str, watch: Watch) -> list[dict[str, Any]]:
    """Rows as ``sonarwarp paper`` has them: one per case, seed and method, with field noise; a third for what is seen.

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
                measured += object_rows(run, {**evaluate_objects(run), **evaluate_seen(run)})
    return measured


def table(measured: Sequence[dict[str, Any]]) -> str:
    """Means over the seeds, a case a line."""
    cases: dict[str, dict[str, Summary]] = {}
    for summary in summarise(measured):
        cases.setdefault(summary.object, {})[summary.method] = summary
    methods = (*METHODS, SEEN)
    lines = [(title, *(error_cell(found[method]) for method in methods)) for title, found in cases.items()]
    return markdown((ERRORS_HEADING, *methods), lines)


if __name__ == "__main__":
    typer.run(main)
