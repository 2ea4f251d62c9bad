"""The page of a run over a mesh: what the sonars saw, then the mesh beside both methods' clouds."""

from __future__ import annotations

from pathlib import Path

from sonarwarp.app import mesh_panels
from sonarwarp.app.experiment import Run
from sonarwarp.app.figures import draw_run_sonars, new_page
from sonarwarp.app.page import LEFT, WIDTH
from sonarwarp.app.rows import METHODS, Surfaces
from sonarwarp.app.snapshot import take_snapshot
from sonarwarp.app.sonar_row import BELOW_SONARS
from sonarwarp.app.views import Views
from sonarwarp.metrics import SurfaceMetrics

# Inches: a column's width, and the gap between two.
_COLUMN = 4.3
_GAP = 0.65


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
    scale = mesh_panels.height_scale(0.0, float(body.bounds()[1][2]))
    views = Views(box=box, scale=scale, flat=(mesh_panels.ABOVE, mesh_panels.SIDE), top=BELOW_SONARS, width=_COLUMN)
    page = new_page(run, views.bottom)
    draw_run_sonars(page, run, take_snapshot(run))
    views.draw_column(
        page,
        LEFT,
        "the mesh over the seabed",
        lambda axes: mesh_panels.draw_mesh(axes, body, box, scale),
        lambda axes, view: mesh_panels.draw_flat_mesh(axes, body, box, scale, view),
    )
    for column, method in enumerate(METHODS, start=1):
        left = LEFT + column * (_COLUMN + _GAP)
        views.draw_points(page, left, _title(method, surfaces[method]), getattr(run.clouds, method).points)
    views.draw_scale(page, WIDTH - 0.85, "height over the mean seabed [m]")
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
