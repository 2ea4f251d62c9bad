"""The command ``paper``, and how work done is told to people."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.table import Table

    from sonarwarp.app.output import Report


class _PaperExperiment(StrEnum):
    SLOPE_LIMIT = "slope-limit"
    DEPLOYMENTS = "deployments"
    FIELD = "field"
    ALL = "all"


class _PaperNoise(StrEnum):
    NONE = "none"
    FIELD = "field"


def paper(
    experiment: Annotated[
        _PaperExperiment, typer.Argument(help="Table 1 and Figure 3; Table 2 and Figures 8 to 10; section 3.3; or all.")
    ],
    seeds: Annotated[int, typer.Option(min=1, max=10_000, help="Runs of each case, worked on as one batch.")] = 1,
    noise: Annotated[
        _PaperNoise,
        typer.Option(help="field: speckle, background, motion, navigation errors and a rough seabed, anew each seed."),
    ] = _PaperNoise.NONE,
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1, help="First seed; the others follow it.")] = 0,
    out: Annotated[Path, typer.Option(help="Folder for figures, metrics.json and the first seed's clouds.")] = Path(
        "sonarwarp-paper"
    ),
    json_file: Annotated[
        Path | None, typer.Option("--json", help="File for the rows alone, as demo prints them.")
    ] = None,
    device: Annotated[str | None, typer.Option(help="Such as cpu or cuda:0; Warp's choice if none.")] = None,
) -> None:
    """Repeat the paper's experiments over many seeds, and set both methods beside what it prints.

    All of them take 13,000 frames a seed: one to two minutes on two cores.
    """
    from sonarwarp.app.machine import find_device
    from sonarwarp.app.paper import run_paper
    from sonarwarp.app.paper_cases import CASES
    from sonarwarp.app.paper_table import paper_table
    from sonarwarp.app.progress import show_progress

    names = list(CASES) if experiment is _PaperExperiment.ALL else [experiment.value]
    chosen = find_device(device)
    with show_progress() as watch:
        report = run_paper(
            [case for name in names for case in CASES[name]],
            seeds=range(seed, seed + seeds),
            noise=noise.value,
            device=chosen,
            out=out,
            rows_file=json_file,
            watch=watch,
        )
    print_work(paper_table(report.rows), report, chosen)


def print_work(table: Table, report: Report, device: str) -> None:
    """Print results, how fast they came, and what was written."""
    from rich.console import Console

    console = Console(highlight=False)
    console.print(table)
    rate = report.frames / report.seconds
    console.print(
        f"{report.frames} frames of both sonars simulated and reconstructed on {device} in {report.seconds:.1f} s: "
        f"{rate:.0f} frames/s",
        soft_wrap=True,
    )
    console.print("Written:")
    for path in report.files:
        console.print(f"  {path}", markup=False, soft_wrap=True)
