"""A page of axes placed in inches from its upper left corner, written as PNG."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sonarwarp.durable import replacing

# A page is read at 100 dots an inch.
_DPI = 100

# Measures that pages share [inch]: their width, where the first axes begin, room under axes for labels, over them for
# titles; sizes of text [point].
WIDTH = 16.0
LEFT = 0.75
LABELS = 0.75
TITLE = 0.4
TITLE_SIZE = 11
LEGEND_SIZE = 9


class Page:
    """An empty page with a heading.

    Args:
        width: of the page [inch].
        height: of the page [inch].
        title: first line of the heading.
        subtitle: second, smaller line.
    """

    def __init__(self, width: float, height: float, title: str, subtitle: str) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self.width, self.height = width, height
        self.figure = Figure(figsize=(width, height), dpi=_DPI)
        FigureCanvasAgg(self.figure)
        self.write(0.25, 0.38, title, size=16)
        self.write(0.25, 0.66, subtitle, size=11)

    def write(self, left: float, top: float, text: str, *, size: float) -> None:
        """Text whose baseline begins at a place [inch]."""
        self.figure.text(left / self.width, 1.0 - top / self.height, text, fontsize=size, va="baseline")

    def axes(self, left: float, top: float, width: float, height: float, **how: Any) -> Any:
        """New axes whose frame has this place and size [inch]; ``how`` goes to matplotlib."""
        place = (left / self.width, 1.0 - (top + height) / self.height, width / self.width, height / self.height)
        return self.figure.add_axes(place, **how)

    def save(self, path: Path) -> None:
        """Write the page, in one step over an older one."""
        with replacing(path) as file:
            self.figure.savefig(file, format="png")
