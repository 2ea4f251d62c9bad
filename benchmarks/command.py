"""What the commands share that measure cases over seeds, write rows for machines and print them as a table."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from benchmarks.run import machine
from benchmarks.tables import prepare, write_json
from sonarwarp.app.progress import show_progress

Seeds = Annotated[int, typer.Option(min=1, max=10_000, help="Runs of each case.")]
JsonFile = Annotated[Path | None, typer.Option("--json", help="File for the rows behind the table.")]
Device = Annotated[str, typer.Option(help="Warp device, such as cpu or cuda:0.")]


def report(
    measure: Callable[..., list[dict[str, Any]]],
    table: Callable[[list[dict[str, Any]]], str],
    *,
    json_file: Path | None,
    device: str,
) -> None:
    """Measure, with a progress display, write the rows with what measured them, and print the table.

    Args:
        measure: takes the keywords ``device`` and ``watch``, returns rows.
        table: of rows, as Markdown.
        json_file: for the rows; none if none.
        device: name of the Warp device.

    Raises:
        SystemExit: no such device, or a file that cannot be written to; before the work, in one line.
    """
    place = prepare(json_file, device)
    with show_progress() as watch:
        measured = measure(device=place, watch=watch)
    write_json(json_file, [{**row, **machine(place)} for row in measured])
    print(table(measured))
