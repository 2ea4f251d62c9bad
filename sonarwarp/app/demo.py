"""The demo: the paper's field test and one pair of its simulation, or any mesh, run, evaluated, drawn and written."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import warp as wp

import sonarwarp as sw
from sonarwarp.app import figures, rows
from sonarwarp.app.bury import RIG, bury_mesh
from sonarwarp.app.experiment import Experiment, Run, run_experiment
from sonarwarp.app.mesh_page import draw_mesh_page
from sonarwarp.app.output import Report, prepare_folder, write_clouds, write_metrics
from sonarwarp.app.paper_cases import BRICK, PAIRS
from sonarwarp.app.progress import Watch
from sonarwarp_kernels.launch import cpu_threads


def paper_experiments(seed: int) -> list[Experiment]:
    """The field test's brick without and with noise, and a misaligned pair of Table 2 without.

    Args:
        seed: of noise, particles and the rough seabed.
    """
    return [BRICK.experiment(seed, "none"), BRICK.experiment(seed, "field"), PAIRS[-1].experiment(seed, "none")]


def mesh_experiment(path: Path, *, scale: float, altitude: float | None, seed: int) -> Experiment:
    """A mesh, half-buried in a rough seabed, under the paper's simulated rig and the field's noise.

    Args:
        path: mesh file, z up.
        scale: metres per unit of the file.
        altitude: of the vehicle over the mean seabed [m]; None: as ``bury_mesh`` chooses.
        seed: of noise, particles and the rough seabed.

    Raises:
        ValueError: a file that is no mesh, or a size or altitude that makes no run.
    """
    rig = sw.PRESETS[RIG]
    deployment = bury_mesh(path, rig, scale=scale, altitude=altitude, seed=seed)
    return Experiment(
        name="mesh",
        object=path.stem,
        deployment=deployment,
        rig=rig,
        noise="field",
        seed=seed,
        body=deployment.parts()[-1][1],
    )


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
    prepare_folder(out)
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
        files += write_clouds(run, out)
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
    summary = write_metrics(out, all_rows, device, timings)
    return Report(rows=all_rows, files=[*files, summary], frames=frames, seconds=seconds)


def _judge(run: Run, page: Path) -> list[dict[str, Any]]:
    """Rows of a run, and its page drawn."""
    if run.experiment.body is not None:
        surfaces = rows.evaluate_mesh(run)
        draw_mesh_page(run, surfaces, page)
        return rows.mesh_rows(run, surfaces)
    sections = rows.evaluate_objects(run)
    figures.draw_objects_page(run, sections, page)
    return rows.object_rows(run, sections)
