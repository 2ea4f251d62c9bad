"""A page per experiment: what the sonars saw, what the field knew, and what both methods made of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sonarwarp.app import panels
from sonarwarp.app.experiment import Run
from sonarwarp.app.page import LABELS, LEFT, LEGEND_SIZE, TITLE, TITLE_SIZE, WIDTH, Page
from sonarwarp.app.rows import METHODS, Sections
from sonarwarp.app.snapshot import Snapshot, take_snapshot
from sonarwarp.app.sonar_row import BELOW_SONARS, SweepWindow, draw_sonars, survey_page
from sonarwarp.metrics import SectionMetrics
from sonarwarp.metrics.section import SECTION_HALF_WIDTH
from sonarwarp_scenes import PlacedObject

# Inches.
HALF = 6.9
RIGHT = WIDTH - 0.3 - HALF
CLOUD = 5.2
_LEGEND = 0.8

# A run ends past the last object; shown of a sweep is this much more [m].
_BEHIND = 1.0

# Shown round an object, in its heights: before its front, behind its back, under the seabed, over its top.
_MARGIN = (1.4, 0.5, 0.15, 0.4)


def draw_objects_page(run: Run, sections: Sections, path: Path) -> None:
    """Write the page of a run over known objects as PNG.

    Args:
        run: what was done.
        sections: metrics, for the legends.
        path: where to.
    """
    objects = run.experiment.deployment.objects
    windows = [_section_window(placed) for placed in objects]
    heights = [HALF * float(np.ptp(z)) / float(np.ptp(x)) for x, z in windows]
    top = BELOW_SONARS
    page = new_page(run, top + sum(height + TITLE + LABELS for height in heights) + TITLE + CLOUD)
    snapshot = take_snapshot(run)
    draw_run_sonars(page, run, snapshot)
    for index, (placed, (x_span, z_span), height) in enumerate(zip(objects, windows, heights, strict=True)):
        field = page.axes(LEFT, top + TITLE, HALF, height)
        panels.draw_field(field, snapshot, placed.centre_y)
        field.set_title(
            f"field at y = {placed.centre_y:g} m, third frame: white free, grey unknown, black occupied",
            fontsize=TITLE_SIZE,
        )
        section = page.axes(RIGHT, top + TITLE, HALF, height)
        for method in METHODS:
            points = getattr(run.clouds, method).points
            central = np.abs(points[:, 1] - placed.centre_y) <= SECTION_HALF_WIDTH
            label = _section_label(method, sections[method][index])
            panels.draw_section(section, points[central], method, label)
        section.set_title(f"central section of the {_object_name(run, placed)}", fontsize=TITLE_SIZE)
        for axes in (field, section):
            panels.draw_outline(axes, placed)
            axes.set(xlim=x_span, ylim=z_span)
            axes.legend(loc="upper left", fontsize=LEGEND_SIZE)
        top += height + TITLE + LABELS
    draw_clouds(page, run, top)
    page.save(path)


def draw_clouds(page: Page, run: Run, top: float) -> None:
    """Both methods' clouds side by side in 3-D, :data:`CLOUD` inches high with their titles."""
    objects = run.experiment.deployment.objects
    box = _objects_box(objects)
    for method, left in zip(METHODS, (LEFT, RIGHT), strict=True):
        axes = page.axes(left, top + TITLE, HALF, CLOUD - TITLE, projection="3d")
        panels.draw_cloud(axes, getattr(run.clouds, method).points, box, method)
        for placed in objects:
            panels.draw_edges(axes, placed)
        axes.set_title(f"{method}: cloud and true edges", fontsize=TITLE_SIZE)


def new_page(run: Run, height: float) -> Page:
    """A page ``height`` inches high under the heading of a run."""
    return survey_page(run.experiment.title, run.survey, run.experiment.seed, height)


def draw_run_sonars(page: Page, run: Run, snapshot: Snapshot) -> None:
    """What the sonars of a run saw; the sweep from where it began to a little behind the last object, from under the
    seabed to over the sonar."""
    start = snapshot.survey.pings.pose[-run.experiment.rig.ps.pings_per_sweep :]
    end = run.experiment.deployment.trajectory.poses[-1, 0]
    window = SweepWindow(
        plane=panels.ALONG_X, along=(start[0, 0] - 0.2, end + _BEHIND), z=(-0.4, start[:, 2].max() + 0.2)
    )
    titles = [f"FLS from x = {x:.2f} m" for x in snapshot.survey.frames.pose[:, 0]]
    draw_sonars(page, snapshot, titles, window)


def _section_window(placed: PlacedObject) -> tuple[tuple[float, float], tuple[float, float]]:
    """Spans of x and z shown round an object [m]."""
    height = placed.shape.height
    before, behind, under, over = (height * margin for margin in _MARGIN)
    x_span = (placed.front_x - before, placed.back_x + behind)
    over = max(over, _LEGEND * (x_span[1] - x_span[0]) / HALF)
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
