"""A page per experiment: what the sonars saw, what the field knew, and what both methods made of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from sonarwarp.app import panels
from sonarwarp.app.experiment import Run
from sonarwarp.app.page import Page
from sonarwarp.app.rows import METHODS, Sections
from sonarwarp.app.snapshot import Snapshot, take_snapshot
from sonarwarp.metrics import SectionMetrics
from sonarwarp.metrics.section import SECTION_HALF_WIDTH
from sonarwarp_scenes import PlacedObject

# Inches.
WIDTH = 16.0
LEFT = 0.75
_HEAD = 1.2
_SONARS = 4.2
LABELS = 0.75
TITLE = 0.4
_HALF = 6.9
_RIGHT = WIDTH - 0.3 - _HALF
_CLOUD = 5.2
_LEGEND = 0.8

BELOW_SONARS = _HEAD + _SONARS + LABELS
"""Where the row of the sonars ends, from the top of a page [inch]."""

# A run ends past the last object; shown of a sweep is this much more [m].
_BEHIND = 1.0

# Shown round an object, in its heights: before its front, behind its back, under the seabed, over its top.
_MARGIN = (1.4, 0.5, 0.15, 0.4)

TITLE_SIZE = 11
_LEGEND_SIZE = 9


def draw_objects_page(run: Run, sections: Sections, path: Path) -> None:
    """Write the page of a run over known objects as PNG.

    Args:
        run: what was done.
        sections: metrics, for the legends.
        path: where to.
    """
    objects = run.experiment.deployment.objects
    windows = [_section_window(placed) for placed in objects]
    heights = [_HALF * float(np.ptp(z)) / float(np.ptp(x)) for x, z in windows]
    top = BELOW_SONARS
    page = new_page(run, top + sum(height + TITLE + LABELS for height in heights) + TITLE + _CLOUD)
    snapshot = take_snapshot(run)
    draw_sonars(page, run, snapshot)
    for index, (placed, (x_span, z_span), height) in enumerate(zip(objects, windows, heights, strict=True)):
        field = page.axes(LEFT, top + TITLE, _HALF, height)
        panels.draw_field(field, snapshot, placed.centre_y)
        field.set_title(
            f"field at y = {placed.centre_y:g} m, third frame: white free, grey unknown, black occupied",
            fontsize=TITLE_SIZE,
        )
        section = page.axes(_RIGHT, top + TITLE, _HALF, height)
        for method in METHODS:
            points = getattr(run.clouds, method).points
            central = np.abs(points[:, 1] - placed.centre_y) <= SECTION_HALF_WIDTH
            label = _section_label(method, sections[method][index])
            panels.draw_section(section, points[central], method, label)
        section.set_title(f"central section of the {_object_name(run, placed)}", fontsize=TITLE_SIZE)
        for axes in (field, section):
            panels.draw_outline(axes, placed)
            axes.set(xlim=x_span, ylim=z_span)
            axes.legend(loc="upper left", fontsize=_LEGEND_SIZE)
        top += height + TITLE + LABELS
    box = _objects_box(objects)
    for method, left in zip(METHODS, (LEFT, _RIGHT), strict=True):
        axes = page.axes(left, top + TITLE, _HALF, _CLOUD - TITLE, projection="3d")
        panels.draw_cloud(axes, getattr(run.clouds, method).points, box, method)
        for placed in objects:
            panels.draw_edges(axes, placed)
        axes.set_title(f"{method}: cloud and true edges", fontsize=TITLE_SIZE)
    page.save(path)


def new_page(run: Run, height: float) -> Page:
    """A page ``height`` inches high under the heading of a run."""
    fls, ps = run.experiment.rig.fls_mount, run.experiment.rig.ps_mount
    tilt = f"{fls.tilt_deg:g} deg" if fls.tilt_deg == ps.tilt_deg else f"{fls.tilt_deg:g} and {ps.tilt_deg:g} deg"
    subtitle = (
        f"sonars tilted {tilt}, altitude {float(np.median(run.survey.frames.altitude)):.2f} m, "
        f"{len(run.survey.frames)} frames, {len(run.survey.pings)} pings, seed {run.experiment.seed}"
    )
    return Page(WIDTH, height, run.experiment.title, subtitle)


def draw_sonars(page: Page, run: Run, snapshot: Snapshot) -> None:
    """Three FLS frames side by side, and the PS sweep beside them."""
    fls = run.experiment.rig.fls
    reach = float(fls.range_edge[-1])
    width = _SONARS * 2.0 * reach * float(np.sin(fls.azimuth_edge[-1])) / reach
    level = panels.decibels(snapshot.images)
    drawn: Any = None
    for number, frame in enumerate(snapshot.frame):
        axes = page.axes(LEFT + number * (width + 0.12), _HEAD, width, _SONARS)
        drawn = panels.draw_fan(
            axes, fls, level[number], snapshot.seabed_range[number], snapshot.critical_range[number]
        )
        axes.set_title(f"FLS from x = {run.survey.frames.pose[frame, 0]:.2f} m", fontsize=TITLE_SIZE)
        if number == 0:
            axes.set_ylabel("slant range ahead [m]")
            axes.legend(loc="lower center", fontsize=_LEGEND_SIZE, **panels.DARK_LEGEND)
        else:
            axes.tick_params(labelleft=False)
    left = LEFT + 3 * (width + 0.12) + 0.05
    bar = page.axes(left, _HEAD, 0.15, _SONARS)
    page.figure.colorbar(drawn, cax=bar, label="echo amplitude [dB of the strongest]")
    sweep_left = left + 1.5
    sweep = page.axes(sweep_left, _HEAD, WIDTH - 0.3 - sweep_left, _SONARS)
    panels.draw_sweep(sweep, run.experiment.rig, run.survey, snapshot)
    _frame_sweep(sweep, run, snapshot)
    sweep.set_title("PS: one sweep, every ping from where it was sent", fontsize=TITLE_SIZE)
    sweep.legend(loc="upper right", fontsize=_LEGEND_SIZE, **panels.DARK_LEGEND)


def _frame_sweep(axes: Any, run: Run, snapshot: Snapshot) -> None:
    """Show a sweep from where it began to a little behind the last object, from under the seabed to over the sonar."""
    start = run.survey.pings.pose[snapshot.ping[-run.experiment.rig.ps.pings_per_sweep :]]
    end = run.experiment.deployment.trajectory.poses[-1, 0]
    axes.set_xlim(start[0, 0] - 0.2, end + _BEHIND)
    axes.set_ylim(-0.4, start[:, 2].max() + 0.2)


def _section_window(placed: PlacedObject) -> tuple[tuple[float, float], tuple[float, float]]:
    """Spans of x and z shown round an object [m]."""
    height = placed.shape.height
    before, behind, under, over = (height * margin for margin in _MARGIN)
    x_span = (placed.front_x - before, placed.back_x + behind)
    over = max(over, _LEGEND * (x_span[1] - x_span[0]) / _HALF)
    return x_span, (-under, height + over)


def _objects_box(objects: tuple[PlacedObject, ...]) -> np.ndarray:
    """Lowest and highest corner shown in 3-D [m], shape [2, 3]."""
    height = max(placed.shape.height for placed in objects)
    low_x = min(placed.front_x for placed in objects) - height
    high_x = max(placed.back_x for placed in objects) + 0.3 * height
    low_y = min(placed.centre_y - placed.shape.width for placed in objects)
    high_y = max(placed.centre_y + placed.shape.width for placed in objects)
    return np.array([[low_x, low_y, 0.0], [high_x, high_y, 1.25 * height]])


def _section_label(method: str, figures: SectionMetrics) -> str:
    slope = "no slope" if figures.slope_deg is None else f"slope {figures.slope_deg:.1f} deg"
    area = "no area" if figures.area_error is None else f"area error {figures.area_error:.3f}"
    return f"{method}: {slope}, {area}"


def _object_name(run: Run, placed: PlacedObject) -> str:
    if len(run.experiment.deployment.objects) == 1:
        return run.experiment.object
    return f"{placed.name} object"
