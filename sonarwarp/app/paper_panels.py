"""Drawings of what many seeds made of the paper's experiments, on a matplotlib axes, in the form of its figures."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from sonarwarp.app import panels
from sonarwarp.app.paper_summary import Summary
from sonarwarp_scenes import PlacedObject

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PRINTED = "black"
"""Colour of what the paper prints."""

_SEED: Mapping[str, Any] = {"ls": "none", "ms": 4.0, "mew": 0.0, "alpha": 0.35}


def draw_curve(
    axes: Axes, summaries: Sequence[Summary], key: str, *, marker: str, dashes: str, shift: float, label: str
) -> None:
    """A figure over the true front slope: a line through the seeds' means, and every seed a dot.

    Args:
        axes: where to draw.
        summaries: one method's, by their objects' front slopes.
        key: figure to draw.
        marker: of the means and of the seeds.
        dashes: matplotlib's name of the line's style.
        shift: to the right, so that curves do not hide each other [degrees].
        label: for the legend.
    """
    ordered = sorted(summaries, key=_slope)
    colour = panels.METHODS[ordered[0].method]
    place = np.array([_slope(summary) for summary in ordered]) + shift
    means = np.array([summary.mean(key) for summary in ordered], dtype=float)
    axes.plot(place, means, ls=dashes, marker=marker, color=colour, ms=7.0, lw=1.6, label=label)
    for x, summary in zip(place, ordered, strict=True):
        _draw_seeds(axes, x, summary, key, marker)


def name_slopes(axes: Axes, summaries: Sequence[Summary], key: str) -> None:
    """Name the true slopes along x, and count under each the seeds that have no figure."""
    slopes = sorted({_slope(summary) for summary in summaries})
    labels = [
        _count_missing(f"{slope:g}", [summary for summary in summaries if _slope(summary) == slope], key)
        for slope in slopes
    ]
    axes.set_xticks(slopes, labels)
    axes.set_xlabel("true front slope [deg]")


def draw_strip(axes: Axes, summary: Summary, keys: Mapping[str, str], printed: Mapping[str, float]) -> None:
    """Error rates side by side: every seed a dot, a diamond their mean, a bar what the paper prints.

    Args:
        axes: where to draw.
        summary: of one object by one method.
        keys: figures to draw, and their names for people.
        printed: the paper's, by key.
    """
    colour = panels.METHODS[summary.method]
    axes.plot([], [], "D", color=colour, ms=9.0, label="mean of the seeds")
    axes.plot([], [], "o", color=colour, **_SEED, label="a seed")
    axes.plot([], [], "-", color=PRINTED, lw=2.0, label="the paper, at sea")
    for place, key in enumerate(keys):
        _draw_seeds(axes, place, summary, key, "o")
        mean = summary.mean(key)
        if mean is not None:
            axes.plot(place, mean, "D", color=colour, ms=9.0)
            axes.annotate(f"{mean:.3f}", (place + 0.3, mean), va="center", color=colour)
        axes.plot([place - 0.28, place + 0.28], [printed[key]] * 2, "-", color=PRINTED, lw=2.0)
        axes.annotate(f"{printed[key]:g}", (place - 0.3, printed[key]), ha="right", va="center")
    axes.set_xticks(range(len(keys)), [_count_missing(name, [summary], key) for key, name in keys.items()])
    axes.set_xlim(-0.6, len(keys) - 0.4)


def _draw_seeds(axes: Axes, place: float, summary: Summary, key: str, marker: str) -> None:
    values = summary.figures[key]
    axes.plot(np.full(len(values), place), values, marker=marker, color=panels.METHODS[summary.method], **_SEED)


def _count_missing(name: str, summaries: Sequence[Summary], key: str) -> str:
    missing = sum(summary.missing(key) for summary in summaries)
    seeds = sum(len(summary.figures[key]) for summary in summaries)
    return f"{name}\n{missing} of {seeds}\nhave none" if missing else name


def _slope(summary: Summary) -> float:
    return float(summary.object)


def draw_slope_theory(axes: Axes, slopes: Collection[float], limit: float) -> None:
    """The true slope, and what Eq. 4 lets a single sonar see of it.

    Args:
        axes: where to draw.
        slopes: true front slopes [degrees].
        limit: slope limit [degrees].
    """
    slope = np.array(sorted(slopes))
    axes.plot(slope, slope, "-", color=panels.TRUTH, lw=1.6, label="truth")
    label = f"single, by Eq. 4: at most {limit:.1f} deg"
    axes.plot(slope, np.minimum(slope, limit), "o", color=panels.LIMIT, mfc="none", ms=12.0, mew=2.0, label=label)


def draw_printed_slope(axes: Axes, placed: PlacedObject, slope_deg: float) -> None:
    """A front slope that the paper prints, up to the upper edge of a vertical front."""
    height = placed.shape.height
    foot = placed.front_x - height / np.tan(np.radians(slope_deg))
    label = f"the paper, at sea: slope {slope_deg:g} deg"
    axes.plot([foot, placed.front_x], [0.0, height], "--", color=PRINTED, lw=2.0, label=label)


def draw_layout(axes: Axes, objects: Sequence[PlacedObject], way: np.ndarray) -> None:
    """Objects and the vehicle's way from above.

    Args:
        axes: where to draw.
        objects: what stands on the seabed.
        way: poses of the vehicle, shape [pose, 7].
    """
    from matplotlib.patches import Rectangle

    for placed in objects:
        shape = placed.shape
        corner = (placed.front_x, placed.centre_y - 0.5 * shape.width)
        axes.add_patch(Rectangle(corner, shape.depth, shape.width, fill=False, ec=panels.TRUTH, lw=2.0))
        middle = (placed.front_x + 0.5 * shape.depth, placed.centre_y)
        axes.annotate(f"{placed.name} object", middle, ha="center", va="center")
    axes.plot(way[:, 0], way[:, 1], "-", color=panels.LIMIT, lw=3.0, label="the vehicle's way, from the left")
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
