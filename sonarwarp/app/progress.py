"""How far long work has come: bars on standard error, nothing at all where that is no terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

Watch = Callable[[str, int, str], Callable[[int], None]]
"""Told what begins, how many steps it takes and of what; gives what wants to hear of steps done."""


@contextmanager
def show_progress() -> Iterator[Watch]:
    """Bars with rate and time left for as long as the context lasts."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        ProgressColumn,
        Task,
        TextColumn,
        TimeRemainingColumn,
    )
    from rich.text import Text

    class RateColumn(ProgressColumn):
        def render(self, task: Task) -> Text:
            speed = task.finished_speed or task.speed
            return Text(f"{speed:.0f} {task.fields['unit']}/s" if speed and task.fields["unit"] else "")

    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[unit]}"),
        RateColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:

        def watch(title: str, steps: int, unit: str) -> Callable[[int], None]:
            task = progress.add_task(title, total=steps, unit=unit)
            return lambda done: progress.advance(task, done)

        yield watch
