"""The paper's experiments over many seeds as a table for people."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from sonarwarp.app.paper_printed import FIELD_TEST
from sonarwarp.app.paper_summary import Summary, summarise
from sonarwarp.app.tables import new_table, show

if TYPE_CHECKING:
    from rich.table import Table

# Key and heading of what has a mean and a worst seed.
_ERRORS = (("slope_error", "slope error"), ("area_error", "area error"), ("volume_error", "volume error"))


def paper_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Means over seeds, and the worst seed, of both methods; beside them what the paper prints.

    Args:
        rows: of any of its experiments.
    """
    summaries = summarise(rows)
    seeds = len(summaries[0].figures["slope_deg"])
    noise = "no noise" if summaries[0].noise == "none" else "with noise"
    table = new_table(f"Mean and worst of {seeds} {'seed' if seeds == 1 else 'seeds'}, {noise}", ("object", "method"))
    table.add_column("slope\n(deg)", justify="right")
    for _, heading in _ERRORS:
        table.add_column(f"{heading}\nmean worst", justify="right")
    for name, group in itertools.groupby(summaries, lambda summary: summary.experiment):
        members = list(group)
        for summary in members:
            table.add_row(_name(summary), summary.method, *_cells(summary))
        if name == "field":
            for method, printed in FIELD_TEST.items():
                figures = (show(printed["slope_deg"], ".2f"), *(f"{printed[key]:.3f}     -" for key, _ in _ERRORS))
                table.add_row("brick, the paper's", method, *figures, style="italic")
        table.add_section()
    if any(summary.missing(key) for summary in summaries for key, _ in _ERRORS):
        table.caption = "A worst of -: some seed has no such figure; the mean is of the others."
        table.caption_justify = "left"
    return table


def _cells(summary: Summary) -> tuple[str, ...]:
    errors = (f"{show(summary.mean(key), '.3f'):>5} {show(summary.worst(key), '.3f'):>5}" for key, _ in _ERRORS)
    return show(summary.mean("slope_deg"), ".2f"), *errors


def _name(summary: Summary) -> str:
    return " ".join(part for part in (summary.object, summary.deployment, summary.which) if part)
