"""Rows and tables of benchmarks that reconstruct the same cases in several ways, a ``variant`` each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.tables import ERRORS_HEADING, error_cell, markdown
from sonarwarp.app.experiment import Run
from sonarwarp.app.paper_summary import Summary, summarise
from sonarwarp.app.rows import evaluate_objects, object_rows


def variant_rows(variant: str, run: Run) -> list[dict[str, Any]]:
    """Rows of a run's fused cloud, one per object."""
    return [{"variant": variant, **row} for row in object_rows(run, evaluate_objects(run, ("fused",)))]


def variant_table(measured: Sequence[Mapping[str, Any]]) -> str:
    """Mean errors over seeds and objects as a table, a variant a line."""
    return markdown(*variant_cells(measured))


def variant_cells(rows: Sequence[Mapping[str, Any]]) -> tuple[list[str], list[list[str]]]:
    """Headings and lines of mean errors: a line for each ``variant`` of the rows, a column for each case.

    Both objects of a pair count alike, and together.
    """
    summaries = {
        variant: summarise([{**row, "which": None} for row in rows if row["variant"] == variant])
        for variant in dict.fromkeys(row["variant"] for row in rows)
    }
    lines = [[variant, *(error_cell(summary) for summary in cases)] for variant, cases in summaries.items()]
    return [ERRORS_HEADING, *(_case_name(summary) for summary in next(iter(summaries.values())))], lines


def _case_name(summary: Summary) -> str:
    return summary.object if summary.deployment is None else f"pair, {summary.object} deg"
