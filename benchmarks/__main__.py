"""Benchmarks: ``python -m benchmarks --quick`` for the end-to-end rate, ``--case NAME`` for one alone."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from benchmarks import forming
from benchmarks.cases import CASES
from benchmarks.log import measure_log
from benchmarks.run import machine, measure
from sonarwarp.app.machine import find_device

FORMING = "forming"
"""The case that measures error against cost of image forming."""

LOG = "log"
"""The case that writes a log to disk and reads it back."""

OTHERS = (FORMING, LOG)
"""Cases that do not go from scene to cloud."""


def main(
    quick: Annotated[bool, typer.Option("--quick", help="Only the quick cases.")] = False,
    case: Annotated[list[str] | None, typer.Option(help="Case to run; may be given again.")] = None,
    device: Annotated[str, typer.Option(help="Warp device, such as cpu or cuda:0.")] = "cpu",
    seed: Annotated[int, typer.Option(min=0, help="Of noise and particles.")] = 0,
    repeats: Annotated[int, typer.Option(min=1, help="Timed passes of each case.")] = 3,
    json_file: Annotated[Path | None, typer.Option("--json", help="File for the rows.")] = None,
) -> None:
    """Measure simulation and reconstruction end to end, and image forming against its reference."""
    known = {entry.name: entry for entry in CASES}
    for name in case or []:
        if name not in (*known, *OTHERS):
            raise typer.BadParameter(f"{name!r} is none of {', '.join([*known, *OTHERS])}", param_hint="--case")
    try:
        place = find_device(device)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--device") from None
    names = case or [name for name, entry in known.items() if entry.quick or not quick] + [*OTHERS] * (not quick)
    with Console(stderr=True).status("starting") as status:
        watch = _watcher(status.update)
        rows = [
            measure(known[name], device=place, seed=seed, repeats=repeats, watch=watch)
            for name in names
            if name not in OTHERS
        ]
        formed = []
        if FORMING in names:
            watch("forming: error against cost")
            formed = [{**row, **machine(place)} for row in forming.run(device=place)]
        logs = [measure_log(device=place, seed=seed, watch=watch)] if LOG in names else []
    if json_file is not None:
        json_file.write_text(json.dumps(rows + formed + logs, indent=2) + "\n")
    show(rows, formed, logs)


def _watcher(update: Callable[[str], None]) -> Callable[[str], None]:
    return lambda text: update(text)


def show(rows: list[dict[str, Any]], formed: list[dict[str, Any]], logs: list[dict[str, Any]]) -> None:
    """Print rows for people."""
    console = Console(file=sys.stdout, highlight=False)
    for row in rows:
        low, high = row["frames_per_second_range"]
        console.print(
            f"{row['case']}: [bold]{row['frames_per_second']:.0f} frames/s[/bold] ({low:.0f} to {high:.0f}), "
            f"{row['peak_memory_mib']:.0f} MiB peak"
        )
        device = row["device"]
        console.print(
            f"{row['frames']} frames of {row['beams']} x {row['bins']}, {row['pings']} pings, "
            f"{row['method']}, {row['hypotheses']} places a beam; "
            f"{device['name']}, {device['threads'] or 'no'} CPU threads, Warp {row['versions']['warp']}",
            style="dim",
        )
        stages = row["stage_ms_per_frame"]
        total = sum(stages.values())
        table = Table("stage", "ms a frame", "share")
        for name, value in stages.items():
            table.add_row(name, f"{value:.3f}", f"{value / total:.0%}")
        console.print(table)
    if formed:
        table = Table("case", "method", "intervals or rays a beam", "error", "ms a frame", title="forming, one thread")
        for row in formed:
            amount = row.get("intervals", row.get("rays_per_beam"))
            table.add_row(row["case"], row["method"], str(amount), f"{row['error']:.2%}", f"{row['ms_per_frame']:.2f}")
        console.print(table)
    for row in logs:
        console.print(
            f"log: {row['frames']} frames of {row['beams']} x {row['bins']}, {row['span_s']:.0f} s, "
            f"{row['images_mib']:.0f} MiB, {row['disk_mib']:.0f} MiB on disk in chunks of {row['chunk_mib']:.1f} MiB"
        )
        for what, verb in (("write", "written"), ("read", "read")):
            memory, ratio = row[f"{what}_memory_mib"], row[f"{what}_times_real_time"]
            up = "" if memory is None else f", memory up by {memory:.0f} MiB at its peak"
            console.print(f"{verb} in {row[f'{what}_s']:.1f} s, [bold]{ratio:.0f} times real time[/bold]{up}")


if __name__ == "__main__":
    typer.run(main)
