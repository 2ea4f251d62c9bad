"""Whether what was measured reaches its targets: ``python -m benchmarks.targets ROWS.json``.

The targets are those of :mod:`benchmarks.bounds`. Reads the rows that ``sonarwarp paper``, ``benchmarks.general``,
``benchmarks.meshes`` and ``benchmarks.calibration`` write with ``--json``, of as many seeds as the README's tables
have: a mean of fewer may fall on either side. Rows that no target is about are left out: of the single-sonar method, of
an ablation, of gentle slopes.
"""

from __future__ import annotations

import itertools
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from benchmarks import calibration
from benchmarks.bounds import (
    AREA,
    CALIBRATION,
    COVERAGE,
    DEVIATION,
    MESH,
    MISSED,
    P95,
    RMS,
    SLOPE,
    TARGETS,
    VOLUME,
    WORST_SLOPE,
    Subject,
    Target,
    shortfall_of,
)
from benchmarks.tables import markdown
from sonarwarp.app.paper_summary import summarise

Row = Mapping[str, Any]

Figures = Mapping[tuple[Subject, str], float | None]
"""What was measured, by subject and figure; None where a run has no such figure."""

_ERRORS = {SLOPE: "slope_error", AREA: "area_error", VOLUME: "volume_error"}

# What tells a run from another.
_IDENTITY = (
    *("variant", "experiment", "object", "deployment", "which", "noise", "method"),
    *("seed", "kind", "title", "steeper_than_deg"),
)


class Verdict(StrEnum):
    """What a target has come to."""

    MET = "met"
    SHORT = "short"
    KNOWN = "known shortfall"
    STALE = "met, yet listed as a shortfall"
    NOT_MEASURED = "not measured"


FAILURES = (Verdict.SHORT, Verdict.STALE)
"""What nobody may leave as it is."""


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """A target, what was measured of it, and what it has come to."""

    target: Target
    measured: float | None
    verdict: Verdict


def main(
    files: Annotated[list[Path], typer.Argument(metavar="ROWS.json...", help="Rows that the measurements wrote.")],
) -> None:
    """Print all targets and what was measured as a Markdown table; exit code 1 unless all is as it is said to be."""
    try:
        judged = judge(figures_of(read_rows(files)))
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None
    print(table(judged))
    count = Counter(judgement.verdict for judgement in judged)
    print("\n" + ", ".join(f"{count[verdict]} {verdict}" for verdict in Verdict if count[verdict]))
    if any(count[verdict] for verdict in FAILURES):
        raise typer.Exit(1)


def read_rows(files: Sequence[Path]) -> list[Row]:
    """Rows of all files.

    Raises:
        ValueError: a file that cannot be read or holds no rows that targets are about; a run that is there twice.
    """
    rows: list[Row] = []
    for file in files:
        rows += _rows_of(file)
    counts = Counter(tuple(row.get(name) for name in _IDENTITY) for row in rows)
    run, times = counts.most_common(1)[0]
    if times > 1:
        names = ", ".join(str(name) for name in run if name is not None)
        raise ValueError(f"rows: {names}: there {times} times, must be once")
    return rows


def _rows_of(file: Path) -> list[Row]:
    try:
        rows = json.loads(file.read_text())
    except OSError as error:
        raise ValueError(f"{file}: {error.strerror}") from None
    except ValueError as error:
        raise ValueError(f"{file}: must be JSON: {error}") from None
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise ValueError(f"{file}: must be a list of rows")
    try:
        figures = figures_of(rows)
    except KeyError as error:
        raise ValueError(f"{file}: a row lacks {error}") from None
    if not figures:
        raise ValueError(f"{file}: must have rows of what targets are about")
    return rows


def figures_of(rows: Sequence[Row]) -> Figures:
    """Figures of the fused clouds, over all seeds, whether a target is about them or not."""
    return {**_section_figures(rows), **_mesh_figures(rows), **_calibration_figures(rows)}


def _section_figures(rows: Sequence[Row]) -> Figures:
    """Means over the seeds, and the worst slope; a seed that lacks a figure leaves none."""
    figures: dict[tuple[Subject, str], float | None] = {}
    fused = [row for row in rows if row.get("method") == "fused" and "slope_error" in row and "variant" not in row]
    for summary in summarise(fused):
        subject = Subject(summary.experiment, summary.object, summary.deployment, summary.which, summary.noise)
        for figure, key in _ERRORS.items():
            figures[subject, figure] = None if summary.missing(key) else summary.mean(key)
        figures[subject, WORST_SLOPE] = summary.worst("slope_error")
    return figures


def _mesh_figures(rows: Sequence[Row]) -> Figures:
    """Ratios of the fused cloud's mean figures to the single-sonar method's, where the surface is steep."""
    figures: dict[tuple[Subject, str], float | None] = {}
    steep = [row for row in rows if "title" in row and row["steeper_than_deg"] is not None]
    for title in dict.fromkeys(row["title"] for row in steep):
        clouds = {
            method: [row for row in steep if (row["title"], row["method"]) == (title, method)]
            for method in ("fused", "single")
        }
        for figure, key in ((RMS, "accuracy_rms"), (P95, "accuracy_p95"), (MISSED, "completeness")):
            fused, single = (_mean([row[key] for row in clouds[method]]) for method in clouds)
            if figure == MISSED:
                fused, single = (None if share is None else 1.0 - share for share in (fused, single))
            figures[Subject(MESH, title), figure] = fused / single if fused is not None and single else None
    return figures


def _mean(values: Sequence[float | None]) -> float | None:
    found = [value for value in values if value is not None]
    return sum(found) / len(found) if found and len(found) == len(values) else None


def _calibration_figures(rows: Sequence[Row]) -> Figures:
    """Coverage and sharpness by class of points, all cases pooled."""
    figures: dict[tuple[Subject, str], float | None] = {}
    for row in rows:
        if "coverage" in row and row["experiment"] == calibration.ALL:
            subject = Subject(CALIBRATION, row["kind"])
            figures[subject, COVERAGE] = row["coverage"]
            figures[subject, DEVIATION] = row["sharpness_deg"]
    return figures


def judge(figures: Figures, targets: Sequence[Target] = TARGETS) -> list[Judgement]:
    """What each target has come to."""
    return [
        Judgement(
            target=target,
            measured=figures.get((target.subject, target.figure)),
            verdict=_verdict(target, figures),
        )
        for target in targets
    ]


def _verdict(target: Target, figures: Figures) -> Verdict:
    if (target.subject, target.figure) not in figures:
        return Verdict.NOT_MEASURED
    if target.holds(figures[target.subject, target.figure]):
        return Verdict.MET if shortfall_of(target) is None else Verdict.STALE
    return Verdict.SHORT if shortfall_of(target) is None else Verdict.KNOWN


def table(judged: Sequence[Judgement]) -> str:
    """One line per target; one alone for a subject of which nothing was measured."""
    lines: list[tuple[str, ...]] = []
    for subject, group in itertools.groupby(judged, key=lambda judgement: judgement.target.subject):
        members = list(group)
        if all(member.verdict is Verdict.NOT_MEASURED for member in members):
            lines.append((str(subject), "", "", "", Verdict.NOT_MEASURED))
        else:
            lines += [(str(subject), *_cells(member)) for member in members]
    return markdown(("Subject", "Figure", "Target", "Measured", "Verdict"), lines)


def _cells(judgement: Judgement) -> tuple[str, ...]:
    target, measured, verdict = judgement.target, judgement.measured, judgement.verdict
    bound = f"{target.at_least:g} to {target.at_most:g}" if target.at_least else f"at most {target.at_most:g}"
    figure = "none" if measured is None else f"{measured:.3f}"
    shortfall = shortfall_of(target)
    reason = f"{verdict}: {shortfall.reason}" if shortfall and verdict is Verdict.KNOWN else str(verdict)
    return f"{target.figure}{' (aim)' if target.aim else ''}", bound, figure, reason


if __name__ == "__main__":
    typer.run(main)
