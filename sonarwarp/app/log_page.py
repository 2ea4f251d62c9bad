"""A page per trajectory of a log, whose scene nobody knows: what the sonars saw, and both methods' clouds."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import sonarwarp as sw
from sonarwarp.app import mesh_panels, panels
from sonarwarp.app.page import LEFT, TITLE_SIZE, WIDTH
from sonarwarp.app.progress import Watch
from sonarwarp.app.rows import METHODS
from sonarwarp.app.snapshot import Snapshot, of_trajectory, take_log_snapshot
from sonarwarp.app.sonar_row import BELOW_SONARS, SweepWindow, draw_sonars, survey_page
from sonarwarp.app.views import Views
from sonarwarp.clouds import QUALITIES
from sonarwarp.log import Log
from sonarwarp.poses import rotate

MOST_PAGES = 8
"""Trajectories of a log that get a page: a page takes seconds, a log may have thousands."""

# Inches: a column's width, and the gap between two.
_COLUMN = 6.4
_GAP = 0.8

# Shown of a sweep round the sonar and what it saw [m].
_ROUND = 0.4


def draw_log_pages(
    log: Log,
    clouds: sw.Clouds,
    out: Path,
    *,
    name: str,
    settings: sw.ReconstructionSettings | None,
    seed: int,
    device: str,
    watch: Watch,
) -> list[Path]:
    """Write ``trajectory_0.png`` and so on, for a log's first trajectories that have frames; the paths.

    Args:
        log: in memory or on disk; a few images of it are read.
        clouds: its reconstruction.
        out: folder that exists.
        name: of the log, for headings.
        settings: of the reconstruction.
        seed: of the reconstruction, for headings.
        device: Warp device.
        watch: told of every page.
    """
    chosen = np.unique(log.survey.frames.trajectory)[:MOST_PAGES].tolist()
    advance = watch("drawing", len(chosen), "pages")
    paths = []
    for trajectory in chosen:
        survey = of_trajectory(log.survey, trajectory)
        own = {method: _points_of(getattr(clouds, method), trajectory) for method in METHODS}
        # Times are exact in clouds, and ascend within a trajectory.
        frame = np.searchsorted(survey.frames.time, own["single"].attributes["time"])
        contacts = np.bincount(frame, minlength=len(survey.frames))
        snapshot = take_log_snapshot(log, trajectory, contacts, settings=settings, device=device)
        title = f"{name}, reconstructed"
        if log.survey.trajectories > 1:
            title = f"{title}: trajectory {trajectory} of {log.survey.trajectories}"
        paths.append(out / f"trajectory_{trajectory}.png")
        _draw_page(survey, snapshot, own, title, seed, paths[-1])
        advance(1)
    return paths


def _points_of(cloud: sw.PointCloud, trajectory: int) -> sw.PointCloud:
    return cloud.select(cloud.attributes["trajectory"] == trajectory)


def _draw_page(
    survey: sw.Survey, snapshot: Snapshot, clouds: dict[str, sw.PointCloud], title: str, seed: int, path: Path
) -> None:
    points = np.concatenate([cloud.points for cloud in clouds.values()])
    views = _views(points) if len(points) else None
    page = survey_page(title, survey, seed, views.bottom if views else BELOW_SONARS + 0.6)
    titles = [f"FLS at {time:.1f} s" for time in snapshot.survey.frames.time]
    draw_sonars(page, snapshot, titles, sweep_window(snapshot) if len(snapshot.survey.pings) else None)
    if views is None:
        page.write(LEFT, BELOW_SONARS + 0.3, "no critical points, so no clouds", size=TITLE_SIZE)
    else:
        for column, (method, cloud) in enumerate(clouds.items()):
            left = LEFT + column * (_COLUMN + _GAP)
            views.draw_points(page, left, _title(method, cloud, views.box), cloud.points)
        views.draw_scale(page, WIDTH - 0.95, "z [m]")
    page.save(path)


def _views(points: np.ndarray) -> Views:
    box = mesh_panels.box_over_points(points)
    low, high = np.percentile(points[:, 2], (2.0, 98.0))
    return Views(
        box=box,
        scale=mesh_panels.height_scale(float(low), float(high)),
        flat=(mesh_panels.ABOVE, mesh_panels.side_of(box)),
        top=BELOW_SONARS,
        width=_COLUMN,
    )


def _title(method: str, cloud: sw.PointCloud, box: np.ndarray) -> str:
    """How many points, and what about them a reader would not see."""
    parts = [f"{method}: {len(cloud)} points"]
    if "quality" in cloud.attributes:
        informed = next(value for value, name in QUALITIES.items() if name == "informed")
        parts.append(f"{int((cloud.attributes['quality'] == informed).sum())} informed by the PS")
    outside = int((~mesh_panels.within(cloud.points, box)).sum())
    if outside:
        parts.append(f"{outside} outside these views")
    return ", ".join(parts)


def sweep_window(snapshot: Snapshot) -> SweepWindow:
    """The plane in which the sonar swept, from where it began to the furthest that it saw, from the seabed up."""
    ps, pings, frames = snapshot.survey.rig.ps, snapshot.survey.pings, snapshot.survey.frames
    shown = slice(-ps.pings_per_sweep, None)
    pose, reach = pings.head_pose[shown], snapshot.footprints[shown].max(axis=(1, 2), initial=0.0)
    axis = rotate(pose[:, 3:], np.array([1.0, 0.0, 0.0]))
    ahead = axis.mean(axis=0)
    plane = panels.SweepPlane(
        origin=(float(pose[0, 0]), float(pose[0, 1])),
        heading=float(np.arctan2(ahead[1], ahead[0])),
        label="ahead of where the sweep began [m]",
    )
    reach = reach if reach.any() else np.full_like(reach, ps.range_edge[-1])
    seen = plane.project(np.concatenate([pose[:, :3], pose[:, :3] + reach[:, None] * axis]))
    (start, low), (end, high) = seen.min(axis=0), seen.max(axis=0)
    seabed = float((frames.pose[:, 2] - frames.altitude).min())
    return SweepWindow(
        plane=plane,
        along=(float(start) - _ROUND, float(end) + _ROUND),
        z=(min(float(low), seabed) - _ROUND, float(high) + _ROUND),
    )
