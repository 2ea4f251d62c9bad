"""Columns of drawings to one scale: a thing in space, and under it the same thing flat, from two sides."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sonarwarp.app.mesh_panels import FlatView, draw_flat_points, draw_points
from sonarwarp.app.page import LABELS, TITLE, TITLE_SIZE, Page

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from mpl_toolkits.mplot3d.axes3d import Axes3D

# Inches: height in space and room for the labels below, least and most height of a flat drawing, the second line of a
# title, the scale of heights.
_SPACE = 3.9
_BELOW_SPACE = 0.3
_LOWEST, _TALLEST = 0.6, 3.4
_SECOND_LINE = 0.25
_BAR = 0.15

# Elevation and azimuth of the eye in space [deg]: before the front, to the right.
_EYE = (24.0, -130.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Views:
    """What all columns of a page share."""

    box: np.ndarray
    """Lowest and highest corner of what is shown [m], shape [2, 3]."""

    scale: ScalarMappable
    """Colours of heights."""

    flat: tuple[FlatView, ...]
    """Flat drawings, from above to below."""

    top: float
    """Where the columns begin on the page [inch]."""

    width: float
    """Of a column [inch]."""

    @property
    def heights(self) -> list[float]:
        """Of the flat drawings [inch]."""
        sides = np.ptp(self.box, axis=0)
        return [
            float(np.clip(self.width * sides[view.up] / sides[view.right], _LOWEST, _TALLEST)) for view in self.flat
        ]

    @property
    def _flat_top(self) -> float:
        return self.top + TITLE + _SECOND_LINE + _SPACE + _BELOW_SPACE

    @property
    def bottom(self) -> float:
        """Where the columns end on the page [inch]."""
        return self._flat_top + sum(TITLE + height + LABELS for height in self.heights)

    def draw_column(
        self,
        page: Page,
        left: float,
        title: str,
        in_space: Callable[[Axes3D], None],
        flat: Callable[[Axes, FlatView], None],
    ) -> None:
        """A column of drawings.

        Args:
            page: where to.
            left: where the column begins [inch].
            title: one or two lines.
            in_space: draws on axes in space.
            flat: draws on flat axes.
        """
        space = page.axes(
            left, self._flat_top - _BELOW_SPACE - _SPACE, self.width, _SPACE, projection="3d", proj_type="ortho"
        )
        in_space(space)
        space.view_init(*_EYE)
        space.set_title(title, fontsize=TITLE_SIZE)
        top = self._flat_top
        for view, height in zip(self.flat, self.heights, strict=True):
            axes = page.axes(left, top + TITLE, self.width, height)
            flat(axes, view)
            axes.set_title(view.title, fontsize=TITLE_SIZE)
            top += TITLE + height + LABELS

    def draw_points(self, page: Page, left: float, title: str, points: np.ndarray) -> None:
        """A column of a cloud [point, 3]; as :meth:`draw_column`."""
        self.draw_column(
            page,
            left,
            title,
            lambda axes: draw_points(axes, points, self.box, self.scale),
            lambda axes, view: draw_flat_points(axes, points, self.box, self.scale, view),
        )

    def draw_scale(self, page: Page, left: float, label: str) -> None:
        """The scale of heights beside the flat drawings."""
        bar = page.axes(left, self._flat_top + TITLE, _BAR, self.bottom - self._flat_top - TITLE - LABELS)
        page.figure.colorbar(self.scale, cax=bar, label=label)
