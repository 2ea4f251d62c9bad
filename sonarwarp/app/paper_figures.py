"""A page for each of the paper's experiments: its figure drawn for both methods beside each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sonarwarp.app import panels, paper_panels
from sonarwarp.app.experiment import Run
from sonarwarp.app.figures import CLOUD, HALF, LABELS, LEFT, RIGHT, TITLE, TITLE_SIZE, WIDTH, draw_clouds
from sonarwarp.app.page import Page
from sonarwarp.app.paper_printed import FIELD_TEST, slope_limit_deg
from sonarwarp.app.paper_summary import Summary, summarise
from sonarwarp.app.rows import METHODS
from sonarwarp.metrics.section import SECTION_HALF_WIDTH

# Inches.
_HEAD = 0.95
_CURVE = 3.6
_LAYOUT = 2.0
_HEADING = 0.4
# Room for seeds without a figure under the names along x.
_NAMES = 1.0
_ROW = TITLE + _CURVE + _NAMES
_LEGEND_SIZE = 9

# Front slopes shown [degrees].
_SLOPES = (12.0, 98.0)

# Shown of the deployments from above, and of the brick's section [m].
_LAYOUT_X, _LAYOUT_Y = (-3.0, 5.0), (-1.1, 1.1)
_BRICK_X, _BRICK_Z = (-0.65, 0.45), (-0.05, 0.6)

# Curves of pairs stand this far beside each other [degrees].
_CURVE_SHIFTS = {
    ("aligned", "first"): -0.9,
    ("aligned", "second"): -0.3,
    ("misaligned", "first"): 0.3,
    ("misaligned", "second"): 0.9,
}

_PLACES: Mapping[str, float] = dict(zip(METHODS, (LEFT, RIGHT), strict=True))

_ERRORS = {"slope_error": "slope error", "area_error": "area error", "volume_error": "volume error"}


def draw_page(runs: Sequence[Run], rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Write the page of one experiment as PNG.

    Args:
        runs: the first seed's, one of each case.
        rows: of all seeds and cases.
        path: where to.
    """
    draw = {"slope-limit": _slope_limit, "deployments": _deployments, "field": _field}
    draw[rows[0]["experiment"]](runs, summarise(rows)).save(path)


def _new_page(title: str, height: float, runs: Sequence[Run], summaries: Sequence[Summary]) -> Page:
    first = runs[0].experiment
    tilt = first.rig.fls_mount.tilt_deg
    altitude = float(first.deployment.trajectory.poses[0, 2])
    seeds = len(summaries[0].figures["slope_deg"])
    noise = "no noise, flat seabed" if first.noise == "none" else "noise, motion and navigation errors, rough seabed"
    named = f"seed {first.seed}" if seeds == 1 else f"{seeds} seeds from {first.seed} on"
    subtitle = f"sonars tilted {tilt:g} deg, altitude {altitude:g} m; {noise}; {named}"
    return Page(WIDTH, height, title, subtitle)


def _slope_limit(runs: Sequence[Run], summaries: Sequence[Summary]) -> Page:
    rows = {"slope_deg": "(a) front slope", "slope_error": "(b) error rate of the front slope"}
    height = _HEAD + len(rows) * _ROW
    page = _new_page("Single objects of Table 1, as the paper's Figure 3", height, runs, summaries)
    curves = [_Curve(label="mean of the seeds", marker="o", dashes="-", shift=0.0, of={})]
    _draw_rows(page, _HEAD, rows, curves, summaries, slope_limit_deg(runs[0].experiment.rig))
    return page


def _deployments(runs: Sequence[Run], summaries: Sequence[Summary]) -> Page:
    rows = {
        "area_error": "(a) error rate of the sectional area",
        "slope_deg": "(b) front slope",
        "volume_error": "(c) error rate of the volume",
    }
    below = _HEAD + TITLE + _LAYOUT + LABELS
    height = below + len(rows) * _ROW + _HEADING + CLOUD
    page = _new_page("Pairs of objects of Table 2, as the paper's Figures 8, 9 and 10", height, runs, summaries)
    steepest = {run.experiment.arrangement: run for run in runs if run.experiment.object == runs[-1].experiment.object}
    for (arrangement, run), left in zip(steepest.items(), _PLACES.values(), strict=True):
        axes = page.axes(left, _HEAD + TITLE, HALF, _LAYOUT)
        deployment = run.experiment.deployment
        paper_panels.draw_layout(axes, deployment.objects, deployment.trajectory.poses)
        axes.set(xlim=_LAYOUT_X, ylim=_LAYOUT_Y)
        axes.set_title(f"{arrangement}, from above", fontsize=TITLE_SIZE)
        axes.legend(loc="lower left", fontsize=_LEGEND_SIZE)
    curves = [
        _Curve(
            label=f"{arrangement}, {which} object",
            marker={"first": "s", "second": "^"}[which],
            dashes={"aligned": "-", "misaligned": "--"}[arrangement],
            shift=shift,
            of={"deployment": arrangement, "which": which},
        )
        for (arrangement, which), shift in _CURVE_SHIFTS.items()
    ]
    _draw_rows(page, below, rows, curves, summaries, slope_limit_deg(runs[0].experiment.rig))
    below += len(rows) * _ROW
    last = runs[-1].experiment
    page.write(LEFT, below + 0.3, f"front slope {last.object} deg, {last.arrangement}, first seed", size=TITLE_SIZE)
    draw_clouds(page, runs[-1], below + _HEADING)
    return page


def _field(runs: Sequence[Run], summaries: Sequence[Summary]) -> Page:
    run = runs[0]
    (placed,) = run.experiment.deployment.objects
    x_span, z_span = _BRICK_X, _BRICK_Z
    section = HALF * (z_span[1] - z_span[0]) / (x_span[1] - x_span[0])
    height = _HEAD + TITLE + section + LABELS + TITLE + CLOUD + _ROW
    page = _new_page("The brick of the field test, as the paper's Figure 13", height, runs, summaries)
    for summary in summaries:
        points = getattr(run.clouds, summary.method).points
        central = np.abs(points[:, 1] - placed.centre_y) <= SECTION_HALF_WIDTH
        axes = page.axes(_PLACES[summary.method], _HEAD + TITLE, HALF, section)
        slope = summary.figures["slope_deg"][0]
        shown = "no slope" if np.isnan(slope) else f"slope {slope:.1f} deg"
        panels.draw_section(axes, points[central], summary.method, f"{summary.method}: {shown}")
        panels.draw_outline(axes, placed)
        paper_panels.draw_printed_slope(axes, placed, FIELD_TEST[summary.method]["slope_deg"])
        axes.set(xlim=x_span, ylim=z_span)
        axes.set_title(f"{summary.method}: central section, first seed", fontsize=TITLE_SIZE)
        axes.legend(loc="upper left", fontsize=_LEGEND_SIZE)
    below = _HEAD + TITLE + section + LABELS
    draw_clouds(page, run, below)
    below += TITLE + CLOUD
    drawn = []
    for summary in summaries:
        axes = page.axes(_PLACES[summary.method], below + TITLE, HALF, _CURVE)
        paper_panels.draw_strip(axes, summary, _ERRORS, FIELD_TEST[summary.method])
        axes.set_title(f"{summary.method}: error rates of all seeds", fontsize=TITLE_SIZE)
        axes.legend(loc="upper left", fontsize=_LEGEND_SIZE)
        drawn.append(axes)
    _same_height(drawn)
    return page


@dataclass(frozen=True, kw_only=True)
class _Curve:
    """How the summaries that have the attributes ``of`` are drawn."""

    label: str
    marker: str
    dashes: str
    shift: float
    of: Mapping[str, str]


def _draw_rows(
    page: Page,
    top: float,
    rows: Mapping[str, str],
    curves: Sequence[_Curve],
    summaries: Sequence[Summary],
    limit: float,
) -> None:
    """Figures over the true front slope, one a row, methods side by side, from ``top`` [inch] down."""
    for key, title in rows.items():
        drawn = []
        for method, left in _PLACES.items():
            axes = page.axes(left, top + TITLE, HALF, _CURVE)
            if key == "slope_deg":
                paper_panels.draw_slope_theory(axes, {float(summary.object) for summary in summaries}, limit)
            for curve in curves:
                mine = [
                    summary
                    for summary in summaries
                    if summary.method == method
                    and all(getattr(summary, name) == value for name, value in curve.of.items())
                ]
                paper_panels.draw_curve(
                    axes, mine, key, marker=curve.marker, dashes=curve.dashes, shift=curve.shift, label=curve.label
                )
            axes.set_title(f"{method}: {title}", fontsize=TITLE_SIZE)
            paper_panels.name_slopes(axes, [summary for summary in summaries if summary.method == method], key)
            axes.set_xlim(_SLOPES)
            axes.grid(color="0.9")
            axes.set_axisbelow(True)
            axes.legend(loc="upper left", fontsize=_LEGEND_SIZE)
            drawn.append(axes)
        _same_height(drawn)
        drawn[0].set_ylabel("reconstructed front slope [deg]" if key == "slope_deg" else "error rate")
        top += _ROW


def _same_height(drawn: Sequence[Any]) -> None:
    """From 0 to a little over the highest of all, with room for legends, so that methods can be compared by eye."""
    highest = max(float(axes.dataLim.y1) for axes in drawn)
    for axes in drawn:
        axes.set_ylim(0.0, 1.25 * highest)
