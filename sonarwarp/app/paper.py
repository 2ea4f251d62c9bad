"""The paper's own experiments over many seeds: run in batches, evaluated, drawn and written."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

import warp as wp

from sonarwarp.app import paper_figures, rows
from sonarwarp.app.experiment import Run, plan_surveys, run_batch
from sonarwarp.app.output import Report, prepare_folder, write_clouds, write_metrics
from sonarwarp.app.paper_cases import Case
from sonarwarp.app.progress import Watch
from sonarwarp_kernels.launch import cpu_threads


def run_paper(
    cases: Sequence[Case],
    *,
    seeds: Sequence[int],
    noise: Literal["none", "field"],
    device: str,
    out: Path,
    rows_file: Path | None = None,
    watch: Watch,
) -> Report:
    """Run cases over seeds, and leave rows, a figure for each experiment, and the first seed's clouds.

    Rows are written anew after every case: an interrupted run keeps those of the cases that it finished.

    Args:
        cases: what to run; those of one experiment in a row.
        seeds: of the runs; all of a case's seeds run as one batch, or as few as memory allows.
        noise: of every run, as in :class:`Experiment`.
        device: Warp device.
        out: folder for clouds (PLY), figures (PNG) and ``metrics.json``; made where there is none.
        rows_file: file for the rows alone (JSON).
        watch: told of the work's progress: one piece of work, so that its time left is that of all cases.

    Raises:
        ValueError: a folder or file that cannot be written to.
    """
    prepare_folder(out)
    if rows_file is not None:
        _prepare_file(rows_file)
    start = time.perf_counter()
    advance = watch("loading kernels, compiled on first use", 1, "")
    wp.force_load(device=device, max_workers=cpu_threads())
    advance(1)
    timings: dict[str, Any] = {"kernels": time.perf_counter() - start}
    total = len(seeds) * sum(_frames(case) for case in cases)
    advance = watch(f"{len(cases)} cases x {len(seeds)} seeds", total, "frames")

    def all_along(title: str, steps: int, unit: str) -> Callable[[int], None]:
        return advance

    all_rows: list[dict[str, Any]] = []
    files: list[Path] = []
    first_runs: dict[str, list[Run]] = {}
    seconds = 0.0
    for case in cases:
        runs = [run for batch in case.batches(seeds, noise) for run in run_batch(batch, device=device, watch=all_along)]
        all_rows += [row for run in runs for row in rows.object_rows(run, rows.evaluate_objects(run))]
        files += write_clouds(runs[0], out)
        first_runs.setdefault(case.name, []).append(runs[0])
        spent = sum(run.seconds for run in runs)
        seconds += spent
        timings[runs[0].experiment.slug] = {"frames": len(seeds) * _frames(case), "run": spent}
        write_metrics(out, all_rows, device, timings)
        if rows_file is not None:
            rows_file.write_text(json.dumps(all_rows, indent=2, allow_nan=False) + "\n")
    for name, runs in first_runs.items():
        page = out / f"{name}.png"
        paper_figures.draw_page(runs, [row for row in all_rows if row["experiment"] == name], page)
        files.append(page)
    timings["total"] = time.perf_counter() - start
    files.append(write_metrics(out, all_rows, device, timings))
    if rows_file is not None:
        files.append(rows_file)
    return Report(rows=all_rows, files=files, frames=total, seconds=seconds)


def _frames(case: Case) -> int:
    """FLS frames of a run: the seed has no part in it."""
    return len(plan_surveys(case.experiment(0, "none"))[0].frames)


def _prepare_file(path: Path) -> None:
    try:
        with path.open("a"):
            pass
    except OSError as error:
        raise ValueError(f"json: cannot write to {path}: {error.strerror}") from error
