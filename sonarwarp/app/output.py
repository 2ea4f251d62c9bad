"""What a command that runs experiments leaves behind: a folder of clouds, pages and ``metrics.json``, and a report."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sonarwarp.app.experiment import Run
from sonarwarp.app.machine import describe_device, versions
from sonarwarp.app.rows import METHODS
from sonarwarp.durable import replace_text


@dataclass(frozen=True, kw_only=True)
class Report:
    """What a command has to say."""

    rows: list[dict[str, Any]]
    """One per run, object and method."""

    files: list[Path]
    """Everything written."""

    frames: int
    """FLS frames of all runs."""

    seconds: float
    """Simulation and reconstruction of all runs [s]."""


def prepare_folder(out: Path) -> None:
    """Make a folder where there is none.

    Raises:
        ValueError: one that cannot be written to.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=out):
            pass
    except OSError as error:
        raise ValueError(f"out: cannot write to {out}: {error.strerror}") from error


def write_clouds(run: Run, out: Path) -> list[Path]:
    """Write both methods' clouds as PLY; the paths."""
    paths = []
    for method in METHODS:
        path = out / f"{run.experiment.slug}_{method}.ply"
        getattr(run.clouds, method).write_ply(path)
        paths.append(path)
    return paths


def write_metrics(out: Path, rows: Sequence[Mapping[str, Any]], device: str, seconds: Mapping[str, Any]) -> Path:
    """Write rows, and what they were made on and how long that took [s], as ``metrics.json``; the path."""
    record = {"rows": rows, "device": describe_device(device), "versions": versions(), "seconds": seconds}
    path = out / "metrics.json"
    replace_text(path, json.dumps(record, indent=2, allow_nan=False) + "\n")
    return path
