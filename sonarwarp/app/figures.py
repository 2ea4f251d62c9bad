"""A page per experiment: what the sonars saw, what the field knew, and what both methods made of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sonarwarp.app import panels
from sonarwarp.app.experiment import Run
from sonarwarp.app.page import Page
from sonarwarp.app.rows import METHODS, Sections, Surfaces
from sonarwarp.app.snapshot import Snapshot, take_snapshot
from sonarwarp.metrics import SectionMetrics
from sonarwarp.metrics.section import SECTION_HALF_WIDTH
from sonarwarp_scenes import PlacedObject

# Inches.
_WIDTH = 16.0
_LEFT = 0.75
_HEAD = 1.2
_SONARS = 4.2
_LABELS = 0.65
_TITLE = 0.4
_HALF = 6.9
_RIGHT = _WIDTH - 0.3 - _HALF
_TALLEST_SECTION = 2.6
_CLOUD = 4.4
_THIRD = 5.0

# Shown round an object, in its heights: before its front, behind its back, under the seabed, over its top.
_MARGIN = (1.4, 0.5, 0.15, 0.4)

_TITLE_SIZE = 11
_LEGEND_SIZE = 9


def draw_objects_page(run: Run, sections: Sections, path: Path) -> None:
    """Write the page of a run over known objects as PNG.

    Args:
        run: what was done.
        sections: metrics, for the legends.
        path: where to.
    """
    objects = run.experiment.deployment.objects
    windows = [_section_window(placed) for placed in objects]
    heights = [_HALF * np.ptp(z) / np.ptp(x) for x, z in windows]
    top = _HEAD + _SONARS + _LABELS
    page = _page(run, top + sum(height + _TITLE + _LABELS for height in heights) + _TITLE + _CLOUD)
    snapshot = take_snapshot(run)
    _draw_sonars(page, run, snapshot)
    for index, (placed, window, height) in enumerate(zip(objects, windows, heights, strict=True)):
        field = _draw_field(page, top + _TITLE, height, snapshot, placed.centre_y)
        section = _draw_section(page, top + _TITLE, height, run, placed.centre_y)
        panels.draw_outline(field, placed)
        panels.draw_outline(section, placed)
        for axes in (field, section):
            axes.set(xlim=window[0], ylim=window[1])
        ...
        top += height + _TITLE + _LABELS
