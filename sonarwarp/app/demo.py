"""The demo: the paper's field test and one pair of its simulation, or any mesh, run, evaluated, drawn and written."""

from __future__ import annotations

import json
import math
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

import sonarwarp as sw
from sonarwarp.app import figures, rows
from sonarwarp.app.experiment import Experiment, Run, run_experiment
from sonarwarp.app.machine import describe_device, versions
from sonarwarp.app.mesh_page import draw_mesh_page
from sonarwarp.app.progress import Watch
from sonarwarp_kernels.launch import cpu_threads
from sonarwarp_scenes import (
    TABLE_2,
    Roughness,
    Scene,
    brick_deployment,
    mesh_deployment,
    pair_deployment,
    scene_from_file,
)

# The brick comes inside the FLS's region of interest at 3.1 m [m].
_BRICK_IMAGING_DISTANCE = 3.5

# Altitudes over a mesh: as low as its width, and a fifth more, stays inside the FLS's swath. Under 2 m the swath is
# gone before the PS has been round; over 3.5 m the window of the FLS ends before the seabed [m].
_SWATH_MARGIN = 1.2
_LOWEST, _HIGHEST = 2.0, 3.5

# Water between the vehicle and a mesh's top, at least [m].
_CLEARANCE = 1.5


def paper_experiments(seed: int) -> list[Experiment]:
    """The field test's brick without and with noise, and a misaligned pair of Table 2 without.

    Args:
        seed: of noise, particles and the rough seabed.
    """
    rigs = sw.PRESETS
    smooth = brick_deployment(imaging_distance=_BRICK_IMAGING_DISTANCE)
    rough = brick_deployment(imaging_distance=_BRICK_IMAGING_DISTANCE, roughness=Roughness(seed=seed))
    brick = {"name": "field", "object": "brick", "rig": rigs["paper field"], "seed": seed}
    return [
        Experiment(**brick, deployment=smooth, noise="none"),
        Experiment(**brick, deployment=rough, noise="field"),
        Experiment(
            name="deployments",
            object="90",
            arrangement="misaligned",
            deployment=pair_deployment(TABLE_2[3], "misaligned"),
            rig=rigs["paper simulation"],
            noise="none",
            seed=seed,
        ),
    ]


def mesh_experiment(path: Path, *, scale: float, altitude: float | None, seed: int) -> Experiment:
    """A mesh, half-buried in a rough seabed, under the paper's simulated rig and the field's noise.

    Args:
        path: mesh file, z up.
        scale: metres per unit of the file.
        altitude: of the vehicle over the mean seabed [m]; None: the lowest of 2 to 3.5 m from which the FLS's swath
            covers the mesh, or 1.5 m over its top where that is more.
        seed: of noise, particles and the rough seabed.

    Raises:
        ValueError: a file that is no mesh, or a size or altitude that makes no run.
    """
    rig = sw.PRESETS["paper simulation"]
    mesh = scene_from_file(path, scale=scale)
    deployment = mesh_deployment(
        mesh,
        name=path.stem,
        altitude=_altitude(mesh, rig) if altitude is None else altitude,
        roughness=Roughness(seed=seed),
    )
    scene, faces = deployment.scene, len(mesh.faces)
    return Experiment(
        name="mesh",
        object=path.stem,
        deployment=deployment,
        rig=rig,
        noise="field",
        seed=seed,
        # The deployment puts the mesh's faces after the seabed's.
        body=Scene(vertices=scene.vertices, faces=scene.faces[-faces:], impedance=scene.impedance[-faces:]),
    )


def _altitude(mesh: Scene, rig: sw.Rig) -> float:
    _, width, height = np.ptp(mesh.bounds(), axis=0)
    lower_edge = math.radians(rig.fls_mount.tilt_deg) + rig.fls.half_elevation
    swath_per_altitude = 2.0 * math.sin(rig.fls.azimuth_edge[-1]) / math.sin(lower_edge)
    covering = min(max(_SWATH_MARGIN * width / swath_per_altitude, _LOWEST), _HIGHEST)
    return float(max(covering, 0.5 * height + _CLEARANCE))


@dataclass(frozen=True, kw_only=True)
class Report:
    """What a demo has to say."""

    rows: list[dict[str, Any]]
    """One per object and method."""

    files: list[Path]
    """Everything written."""

    frames: int
    """FLS frames of all runs."""

    seconds: float
    """Simulation and reconstruction of all runs [s]."""


def run_demo(experiments: Sequence[Experiment], *, device: str, out: Path, watch: Watch) -> Report:
    """Run, evaluate, draw and write.

    Args:
        experiments: what to run, one after the other.
        device: Warp device.
        out: folder for clouds (PLY), pages (PNG) and ``metrics.json``; made where there is none.
        watch: told of the work's progress.

    Raises:
        ValueError: a folder that cannot be written to.
    """
    _prepare_folder(out)
    start = time.perf_counter()
    advance = watch("loading kernels, compiled on first use", 1, "")
    wp.force_load(device=device, max_workers=cpu_threads())
    advance(1)
    timings: dict[str, Any] = {"kernels": time.perf_counter() - start}
    all_rows: list[dict[str, Any]] = []
    files: list[Path] = []
    frames, seconds = 0, 0.0
    for experiment in experiments:
        run = run_experiment(experiment, device=device, watch=watch)
        frames += len(run.survey.frames)
        seconds += run.seconds
        files += _write_clouds(run, out)
        advance = watch("drawing", 1, "page")
        page = out / f"{experiment.slug}.png"
        began = time.perf_counter()
        all_rows += _judge(run, page)
        files.append(page)
        advance(1)
        timings[experiment.slug] = {
            "frames": len(run.survey.frames),
            "pings": len(run.survey.pings),
            "run": run.seconds,
            "frames_per_second": run.frames_per_second,
            "evaluation_and_page": time.perf_counter() - began,
        }
    timings["total"] = time.perf_counter() - start
    record = {"rows": all_rows, "device": describe_device(device), "versions": versions(), "seconds": timings}
    summary = out / "metrics.json"
    summary.write_text(json.dumps(record, indent=2, allow_nan=False) + "\n")
    return Report(rows=all_rows, files=[*files, summary], frames=frames, seconds=seconds)


def _prepare_folder(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=out):
            pass
    except OSError as error:
        raise ValueError(f"out: cannot write to {out}: {error.strerror}") from error


def _write_clouds(run: Run, out: Path) -> list[Path]:
    paths = []
    for method in rows.METHODS:
        path = out / f"{run.experiment.slug}_{method}.ply"
        getattr(run.clouds, method).write_ply(path)
        paths.append(path)
    return paths


def _judge(run: Run, page: Path) -> list[dict[str, Any]]:
    """Rows of a run, and its page drawn."""
    if run.experiment.body is not None:
        surfaces = rows.evaluate_mesh(run)
        draw_mesh_page(run, surfaces, page)
        return rows.mesh_rows(run, surfaces)
    sections = rows.evaluate_objects(run)
    figures.draw_objects_page(run, sections, page)
    return rows.object_rows(run, sections)
