"""From files to files: a scene, a rig and a trajectory become a log; a log becomes clouds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import sonarwarp as sw
from sonarwarp.app.progress import Watch
from sonarwarp.app.rows import METHODS
from sonarwarp.cloud_usd import sonar_tracks, write_cloud_usd
from sonarwarp.toml_settings import read_configuration, read_settings
from sonarwarp.trajectory_files import read_trajectory as read_text_trajectory
from sonarwarp_scenes import Trajectory, read_scene
from sonarwarp_scenes import read_trajectory as read_stage_trajectory

_STAGES = (".usd", ".usda", ".usdc", ".usdz")


def simulate_files(
    scene: Path,
    rig: Path,
    trajectory: Path | None,
    out: Path,
    *,
    scale: float | None,
    seed: int,
    frames_from: float,
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
        frames_from: time from which the FLS records [s].
        truth: whether first contacts are kept too.
        overwrite: whether an older log may be replaced.
        device: Warp device.
        watch: told of the work's progress.

    Raises:
        ValueError: a file that cannot be read or says something impossible.
    """
    configuration = read_configuration(rig)
    world, report = read_scene(scene, scale=scale)
    way = _read_trajectory(scene if trajectory is None else trajectory)
    survey = sw.plan_survey(configuration.rig, [way], frames_from=frames_from)
    advance = watch(f"simulating {scene.name}", len(survey.frames), "frames")
    sw.survey_to_store(
        survey,
        [world],
        out,
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
        "triangles": len(world.faces),
        "parts": len(report.parts),
        "seed": seed,
    }


def _read_trajectory(path: Path) -> Trajectory:
    return read_stage_trajectory(path) if path.suffix.lower() in _STAGES else read_text_trajectory(path)


def reconstruct_files(
    log: Path, out: Path, *, settings: Path | None, seed: int, device: str, watch: Watch
) -> dict[str, Any]:
    """Reconstruct a log into clouds: PLY, NPZ and OpenUSD, of both methods.

    Args:
        log: what ``simulate`` or a ``StoreWriter`` wrote; what is complete of it counts.
        out: folder, made where there is none.
        settings: TOML file with a table ``reconstruction``; the log's own settings if None.
        seed: of the particles.
        device: Warp device.
        watch: told of the work's progress.

    Raises:
        ValueError: a log or file that cannot be read.
    """
    stored = sw.open_log(log)
    chosen = stored.reconstruction if settings is None else read_settings(settings)
    advance = watch(f"reconstructing {log.name}", len(stored.survey.frames), "frames")
    clouds = sw.reconstruct(stored, settings=chosen, seed=seed, device=device, advance=advance)
    out.mkdir(parents=True, exist_ok=True)
    tracks = sonar_tracks(stored.survey)
    files = []
    for method in METHODS:
        cloud = getattr(clouds, method)
        colour = "elevation_deviation" if method == "fused" else "range"
        cloud.write_ply(out / f"{method}.ply")
        cloud.write_npz(out / f"{method}.npz")
        write_cloud_usd(out / f"{method}.usdc", cloud, colour_by=colour, tracks=tracks)
        files += [str(out / f"{method}{suffix}") for suffix in (".ply", ".npz", ".usdc")]
    return {
        "log": str(log),
        "complete": stored.complete,
        "frames": len(stored.survey.frames),
        "frames_planned": stored.frames_planned,
        "points": {method: len(getattr(clouds, method)) for method in METHODS},
        "seed": seed,
        "files": files,
    }


def evaluate_files(cloud: Path, truth: Path, *, scale: float | None, tolerance: float, device: str) -> dict[str, Any]:
    """Distances of a cloud's points to a scene.

    Args:
        cloud: PLY or NPZ.
        truth: mesh file or OpenUSD stage.
        scale: as for :func:`simulate_files`.
        tolerance: distance within which a point lies on the surface [m].
        device: Warp device.

    Raises:
        ValueError: a file that cannot be read, a cloud without points.
    """
    from sonarwarp.metrics import evaluate

    points = sw.read_cloud(cloud)
    if not len(points):
        raise ValueError(f"{cloud}: no points, nothing to compare")
    world, _ = read_scene(truth, scale=scale)
    figures = evaluate(points, scene=world, tolerance=tolerance, device=device).surface
    assert figures is not None
    names = ("accuracy_mean", "accuracy_rms", "accuracy_p95", "precision")
    return {
        "cloud": str(cloud),
        "truth": str(truth),
        "points": len(points),
        "tolerance": tolerance,
        **{name: getattr(figures, name) for name in names},
    }
