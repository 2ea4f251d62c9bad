"""The head of a page: what was surveyed, three FLS frames side by side, and a sweep of the PS beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

import sonarwarp as sw
from sonarwarp.app import panels
from sonarwarp.app.page import LABELS, LEFT, LEGEND_SIZE, TITLE_SIZE, WIDTH, Page
from sonarwarp.app.snapshot import FRAMES, Snapshot

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Inches. Fans wider than this are drawn smaller, or the sweep would have no room; under narrower ones labels collide.
_HEAD = 1.2
_HEIGHT = 4.2
_NARROWEST_FAN, _WIDEST_FAN = 1.7, 2.6
_GAP = 0.12

BELOW_SONARS = _HEAD + _HEIGHT + LABELS
"""Where the row of the sonars ends, from the top of a page [inch]."""


@dataclass(frozen=True, kw_only=True)
class SweepWindow:
    """What of a vertical plane is shown of a sweep."""

    plane: panels.SweepPlane
    along: tuple[float, float]
    """Span along the plane's heading [m]."""

    z: tuple[float, float]
    """Span of heights [m]."""


def survey_page(title: str, survey: sw.Survey, seed: int, height: float) -> Page:
    """A page ``height`` inches high under the heading of a survey."""
    fls, ps = survey.rig.fls_mount, survey.rig.ps_mount
    tilt = f"{fls.tilt_deg:g} deg" if fls.tilt_deg == ps.tilt_deg else f"{fls.tilt_deg:g} and {ps.tilt_deg:g} deg"
    subtitle = (
        f"sonars tilted {tilt}, altitude {float(np.median(survey.frames.altitude)):.2f} m, "
        f"{len(survey.frames)} frames, {len(survey.pings)} pings, seed {seed}"
    )
    return Page(WIDTH, height, title, subtitle)


def draw_sonars(page: Page, snapshot: Snapshot, titles: Sequence[str], window: SweepWindow | None) -> None:
    """Frames side by side, and the PS sweep beside them.

    Args:
        page: under whose heading.
        snapshot: what the sonars saw.
        titles: of the frames.
        window: what is shown of the sweep; None where there is no ping.
    """
    fls = snapshot.survey.rig.fls
    breadth = float(np.ptp(np.sin(fls.azimuth_edge)))
    width = float(np.clip(_HEIGHT * breadth, _NARROWEST_FAN, _WIDEST_FAN))
    level = panels.decibels(snapshot.images)
    drawn: Any = None
    for number, title in enumerate(titles):
        axes = page.axes(LEFT + number * (width + _GAP), _HEAD, width, _HEIGHT)
        drawn = panels.draw_fan(
            axes, fls, level[number], snapshot.seabed_range[number], snapshot.critical_range[number]
        )
        _fill(axes, width / _HEIGHT)
        axes.set_title(title, fontsize=TITLE_SIZE)
        if number == 0:
            axes.set_ylabel("slant range ahead [m]")
            axes.legend(loc="lower center", fontsize=LEGEND_SIZE, **panels.DARK_LEGEND)
        else:
            axes.tick_params(labelleft=False)
    left = LEFT + FRAMES * (width + _GAP) + 0.05
    bar = page.axes(left, _HEAD, 0.15, _HEIGHT)
    page.figure.colorbar(drawn, cax=bar, label="echo amplitude [dB of the strongest]")
    left += 1.5
    if window is None:
        page.write(left, _HEAD + 0.3, "PS: no ping before the last of these frames", size=TITLE_SIZE)
        return
    sweep = page.axes(left, _HEAD, WIDTH - 0.3 - left, _HEIGHT)
    panels.draw_sweep(sweep, snapshot, window.plane)
    sweep.set(xlim=window.along, ylim=window.z)
    sweep.set_title("PS: one sweep, every ping from where it was sent", fontsize=TITLE_SIZE)
    sweep.legend(loc="upper right", fontsize=LEGEND_SIZE, **panels.DARK_LEGEND)


def _fill(axes: Axes, ratio: float) -> None:
    """Show more on both sides of what is narrower than ``ratio`` of its height."""
    left, right = axes.get_xlim()
    low, high = axes.get_ylim()
    spare = 0.5 * max(ratio * (high - low) - abs(right - left), 0.0)
    outward = np.sign(right - left) * spare
    axes.set_xlim(left - outward, right + outward)
