"""The page of a run over a mesh: what the sonars saw, then the mesh beside both methods' clouds."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sonarwarp.app import mesh_panels
from sonarwarp.app.experiment import Run
from sonarwarp.app.figures import BELOW_SONARS, LABELS, LEFT, TITLE, TITLE_SIZE, WIDTH, draw_sonars, new_page
from sonarwarp.app.rows import METHODS, Surfaces
from sonarwarp.app.snapshot import take_snapshot
from sonarwarp.metrics import SurfaceMetrics

# Inches: a column's width, the gap between two, heights of the views, the second line of a title, the scale of heights.
_COLUMN = 4.3
_GAP = 0.65
_SPACE = 3.9
_TALLEST = 3.4
_SECOND_LINE = 0.25
_BAR = 0.15

# Elevation and azimuth of the eye in space [deg]: before the front, to the right.
_EYE = (24.0, -130.0)


def draw_mesh_page(run: Run, surfaces: Surfaces, path: Path) -> None:
    """Write the page of a run over a mesh as PNG.

    Args:
        run: what was done.
        surfaces: distances, for the titles.
        path: where to.

    Raises:
        ValueError: a run without a mesh.
    """
    body = run.experiment.body
    if body is None:
        raise ValueError(f"run: {run.experiment.title} has no mesh")
    box = mesh_panels.box_over_seabed(body)
    scale = mesh_panels.height_scale(box)
    sides = np.ptp(box, axis=0)
    views = (mesh_panels.ABOVE, mesh_panels.SIDE)
    heights = [min(_COLUMN * float(sides[view.up] / sides[view.right]), _TALLEST) for view in views]
    first = BELOW_SONARS + TITLE + _SECOND_LINE
    page = new_page(run, first + _SPACE + sum(TITLE + height + LABELS for height in heights))
    draw_sonars(page, run, take_snapshot(run))
    titles = ["the mesh over the seabed", *(_title(method, surfaces[method]) for method in METHODS)]
    clouds = [None, *(getattr(run.clouds, method).points for method in METHODS)]
    for column, (title, points) in enumerate(zip(titles, clouds, strict=True)):
        left = LEFT + column * (_COLUMN + _GAP)
        space = page.axes(left, first, _COLUMN, _SPACE, projection="3d", proj_type="ortho")
        if points is None:
            mesh_panels.draw_mesh(space, body, box, scale)
        else:
            mesh_panels.draw_points(space, points, box, scale)
        space.view_init(*_EYE)
        space.set_title(title, fontsize=TITLE_SIZE)
        top = first + _SPACE
        for view, height in zip(views, heights, strict=True):
            flat = page.axes(left, top + TITLE, _COLUMN, height)
            if points is None:
                mesh_panels.draw_flat_mesh(flat, body, box, scale, view)
            else:
                mesh_panels.draw_flat_points(flat, points, box, scale, view)
                flat.set_ylabel("")
            flat.set_title(view.title, fontsize=TITLE_SIZE)
            top += TITLE + height + LABELS
    bar = page.axes(WIDTH - 0.85, first + _SPACE + TITLE, _BAR, sum(heights) + TITLE + LABELS)
    page.figure.colorbar(scale, cax=bar, label="height over the mean seabed [m]")
    page.save(path)


def _title(method: str, figures: SurfaceMetrics) -> str:
    if figures.accuracy_mean is None or figures.accuracy_rms is None or figures.accuracy_p95 is None:
        return f"{method}: no points"
    mean, rms, most = (
        f"{100.0 * distance:.1f}" for distance in (figures.accuracy_mean, figures.accuracy_rms, figures.accuracy_p95)
    )
    shares = [
        f"{name} {value:.2f}"
        for name, value in (("complete", figures.completeness), ("F-score", figures.f_score))
        if value is not None
    ]
    return f"{method}: {', '.join(shares)}\ndistance: mean {mean}, RMS {rms}, 95 % under {most} cm"
