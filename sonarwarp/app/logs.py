"""From files to files: a scene, a rig and a trajectory become a log; a log becomes clouds."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

import sonarwarp as sw
from sonarwarp.app.cloud_usd import sonar_tracks, write_cloud_usd
from sonarwarp.app.log_page import draw_log_pages
from sonarwarp.app.output import prepare_folder
from sonarwarp.app.progress import Watch
from sonarwarp.app.rows import METHODS, SURFACE_FIGURES
from sonarwarp.checks import in_range
from sonarwarp.toml_settings import read_configuration, read_settings
from sonarwarp.trajectory_files import read_trajectory as read_text_trajectory
from sonarwarp_scenes import Scene, Trajectory, read_frames_from, read_scene
from sonarwarp_scenes import read_trajectory as read_stage_trajectory
from sonarwarp_scenes.files import is_stage


def simulate_files(
    scene: Path,
    rig: Path,
    trajectory: Path | None,
    out: Path,
    *,
    scale: float | None,
    seed: int,
    frames_from: float | None,
    truth: bool,
    overwrite: bool,
    device: str,
    watch: Watch,
) -> dict[str, Any]:
    """Simulate files into a log.

    Args:
        scene: mesh file or OpenUSD stage.
        rig: TOML file: rig, noise and reconstruction settings.
        trajectory: CSV, TUM or OpenUSD file; the scene's own stage if None.
        out: the log.
        scale: metres per unit of the scene's file; the file's own, or 1, if None.
        seed: of all noise.
        frames_from: time from which the FLS records [s]; None: as the stage says that the trajectory is read from, 0
            where it does not or is no stage.
        truth: whether first contacts are kept too.
        overwrite: whether an older log may be replaced.
        device: Warp device.
        watch: told of the work's progress.

    Raises:
        ValueError: a file that cannot be read or says something impossible.
    """
    configuration = read_configuration(rig)
    world, report = read_scene(scene, scale=scale)
    track = scene if trajectory is None else trajectory
    way = _read_trajectory(track)
    if frames_from is None:
        frames_from = _read_frames_from(track)
    survey, believed = sw.plan_disturbed(
        configuration.rig,
        [way],
        motion=configuration.motion,
        navigation=configuration.navigation,
        seed=seed,
        frames_from=frames_from,
    )
    advance = watch(f"simulating {scene.name}", len(survey.frames), "frames")
    sw.survey_to_store(
        survey,
        [world],
        out,
        believed=believed,
        noise=configuration.noise,
        seed=seed,
        truth=truth,
        reconstruction=configuration.reconstruction,
        overwrite=overwrite,
        device=device,
        advance=advance,
    )
    return {
        "log": str(out),
        "frames": len(survey.frames),
        "pings": len(survey.pings),
        "imaging_from": float(survey.frames.time[0]),
        "triangles": len(world.faces),
        "parts": len(report.parts),
        "seed": seed,
    }


def _read_trajectory(path: Path) -> Trajectory:
    return read_stage_trajectory(path) if is_stage(path) else read_text_trajectory(path)


def _read_frames_from(path: Path) -> float:
    stated = read_frames_from(path) if is_stage(path) else None
    return 0.0 if stated is None else stated


def reconstruct_files(
    log: Path, out: Path, *, settings: Path | None, seed: int, device: str, watch: Watch
) -> dict[str, Any]:
    """Reconstruct a log into clouds of both methods, PLY, PCD, NPZ and OpenUSD, and a page per trajectory (PNG).

    Args:
        log: what ``simulate`` or a ``StoreWriter`` wrote; what is complete of it counts.
        out: folder, made where there is none.
        settings: TOML file with a table ``reconstruction``; the log's own settings if None.
        seed: of the particles.
        device: Warp device.
        watch: told of the work's progress.

    Raises:
        ValueError: a log or file that cannot be read, or the log's own settings, where they are wanted.
    """
    stored = sw.open_log(log)
    chosen = stored.reconstruction if settings is None else read_settings(settings)
    prepare_folder(out)
    advance = watch(f"reconstructing {log.name}", len(stored.survey.frames), "frames")
    clouds = sw.reconstruct(stored, settings=chosen, seed=seed, device=device, advance=advance)
    tracks = sonar_tracks(stored.survey)
    files = []
    for method in METHODS:
        cloud = getattr(clouds, method)
        colour = "elevation_deviation" if method == "fused" else "range"
        paths = {suffix: out / f"{method}.{suffix}" for suffix in ("ply", "pcd", "npz", "usdc")}
        cloud.write_ply(paths["ply"])
        cloud.write_pcd(paths["pcd"])
        cloud.write_npz(paths["npz"])
        write_cloud_usd(paths["usdc"], cloud, colour_by=colour, tracks=tracks)
        files += paths.values()
    files += draw_log_pages(stored, clouds, out, name=log.name, settings=chosen, seed=seed, device=device, watch=watch)
    return {
        "log": str(log),
        "complete": stored.complete,
        "frames": len(stored.survey.frames),
        "frames_planned": stored.frames_planned,
        "points": {method: len(getattr(clouds, method)) for method in METHODS},
        "seed": seed,
        "files": [str(path) for path in files],
    }


def evaluate_files(
    cloud: Path,
    truth: Path,
    *,
    log: Path | None,
    part: str | None,
    steeper_than_deg: float | None,
    scale: float | None,
    tolerance: float,
    device: str,
) -> dict[str, Any]:
    """Distances of a cloud's points to a scene, and how much of what the sonars could see the cloud shows.

    Args:
        cloud: PLY or NPZ.
        truth: mesh file or OpenUSD stage.
        log: what the cloud was made from, for completeness and F-score: with its true poses where it holds them, else
            those of its navigation. None: neither.
        part: of the scene that is asked for, as ``SceneReport.faces_of`` takes it: completeness is about the part, and
            points that lie on the rest are left out. None: the whole scene.
        steeper_than_deg: inclination to the horizontal [degrees]; what leans less is not asked for, as if it were
            another part. Over the slope limit (Eq. 4; ``sonarwarp info`` gives each preset's) lies what an FLS alone
            cannot show. None: surface of any inclination.
        scale: as for :func:`simulate_files`.
        tolerance: distance within which a point lies on the surface, and a place of it is met [m].
        device: Warp device.

    Raises:
        ValueError: a file that cannot be read, a cloud without points, no such part, nothing so steep.
    """
    from sonarwarp.metrics import evaluate, seen_samples

    points = sw.read_cloud(cloud)
    if not len(points):
        raise ValueError(f"{cloud}: no points, nothing to compare")
    world, report = read_scene(truth, scale=scale)
    faces = None if part is None else report.faces_of(part)
    if steeper_than_deg is not None:
        faces = _steep_faces(world, np.ones(len(world.faces), dtype=bool) if faces is None else faces, steeper_than_deg)
    seen = None
    if log is not None:
        stored = sw.open_log(log)
        seen = seen_samples(world, stored.truth or stored.survey, part=faces, device=device)
    figures = evaluate(points, scene=world, seen=seen, part=faces, tolerance=tolerance, device=device).surface
    assert figures is not None
    names = SURFACE_FIGURES if log is not None else SURFACE_FIGURES[:-2]
    return {
        "cloud": str(cloud),
        "truth": str(truth),
        "log": None if log is None else str(log),
        "part": part,
        "steeper_than_deg": steeper_than_deg,
        "points": len(points),
        **{name: getattr(figures, name) for name in names},
    }


def _steep_faces(scene: Scene, faces: np.ndarray, limit_deg: float) -> np.ndarray:
    """Those of some faces that lean more than a limit from the horizontal [degrees], shape [face].

    Raises:
        ValueError: a limit outside [0, 90] or that no face exceeds.
    """
    from sonarwarp.metrics import face_inclination

    in_range("steeper_than_deg", limit_deg, 0.0, 90.0)
    inclination = face_inclination(scene)
    steep = faces & (inclination > math.radians(limit_deg))
    if not steep.any():
        steepest = math.degrees(inclination[faces].max())
        raise ValueError(f"steeper_than_deg: {limit_deg:g}, must be under the steepest face's {steepest:.2f}")
    return steep
