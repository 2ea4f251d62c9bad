"""A mesh and clouds over it, in space and flat, coloured by height: a cloud of one colour shows no depth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sonarwarp.app.panels import frame_box
from sonarwarp_scenes import Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from mpl_toolkits.mplot3d.axes3d import Axes3D

# Shown round a mesh [m], and under the mean seabed.
_MARGIN = 0.15
_UNDER = 0.1

# How far before a front a cloud may begin, in heights: a single sonar's ramp at its slope limit.
_RAMP = 0.6

# Of a cloud's points along each axis, the lowest and the highest that are not shown [%].
_STRAYS = 0.5

# How dark a face is that stands edgewise to the eye.
_DARKEST = 0.45


@dataclass(frozen=True, kw_only=True)
class FlatView:
    """A drawing plane: which world axes go right and up, and where the eye is."""

    title: str
    right: int
    up: int
    eye: tuple[float, float, float]
    """Direction towards the eye."""


ABOVE = FlatView(title="from above", right=0, up=1, eye=(0.0, 0.0, 1.0))
SIDE = FlatView(title="from the side", right=0, up=2, eye=(0.0, -1.0, 0.0))
FRONT = FlatView(title="from the side", right=1, up=2, eye=(1.0, 0.0, 0.0))

# Towards the eye of the drawing in space, for shades.
_EYE = (-0.6, -0.6, 0.5)


def box_over_seabed(body: Scene) -> np.ndarray:
    """Lowest and highest corner of what is shown of a mesh [m], shape [2, 3]: the part over the mean seabed."""
    corners = body.vertices[body.faces]
    over = corners[corners[..., 2].max(axis=1) > -_UNDER].reshape(-1, 3)
    low, high = over.min(axis=0) - _MARGIN, over.max(axis=0) + _MARGIN
    low[0] -= _RAMP * (high[2] - _MARGIN)
    low[2] = -_UNDER
    return np.stack([low, high])


def box_over_points(points: np.ndarray) -> np.ndarray:
    """Lowest and highest corner of what is shown of clouds [point, 3] alone [m], shape [2, 3]: all but strays."""
    low, high = np.percentile(points, (_STRAYS, 100.0 - _STRAYS), axis=0)
    return np.stack([low - _MARGIN, high + _MARGIN])


def side_of(box: np.ndarray) -> FlatView:
    """The side from which more of a box [2, 3] is seen."""
    length, width, _ = np.ptp(box, axis=0)
    return SIDE if length >= width else FRONT


def height_scale(low: float, high: float) -> ScalarMappable:
    """Colours of heights [m]; blue to yellow, told apart by colour-blind readers."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    return ScalarMappable(Normalize(low, high), "viridis")


def within(points: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Which points [point, 3] lie in ``box`` [2, 3], shape [point]."""
    return ((points >= box[0]) & (points <= box[1])).all(axis=1)


def draw_mesh(axes: Axes3D, body: Scene, box: np.ndarray, scale: ScalarMappable) -> None:
    """The faces of a mesh that reach into ``box`` [2, 3], in space."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    corners, colours = _shaded(body, box, scale, _EYE)
    axes.add_collection3d(Poly3DCollection(np.clip(corners, *box), facecolors=colours, lw=0.0))
    frame_box(axes, box)


def draw_points(axes: Axes3D, points: np.ndarray, box: np.ndarray, scale: ScalarMappable) -> None:
    """The points of a cloud that lie in ``box`` [2, 3], in space."""
    inside = points[within(points, box)]
    colours = scale.to_rgba(inside[:, 2])
    axes.scatter(*inside.T, s=3, color=colours, lw=0.0, depthshade=False, rasterized=True)
    frame_box(axes, box)


def draw_flat_mesh(axes: Axes, body: Scene, box: np.ndarray, scale: ScalarMappable, view: FlatView) -> None:
    """A mesh as seen along an axis; nearer faces hide farther ones."""
    from matplotlib.collections import PolyCollection

    corners, colours = _shaded(body, box, scale, view.eye)
    order = np.argsort(corners.mean(axis=1) @ np.array(view.eye))
    flat = corners[order][..., [view.right, view.up]]
    # Antialiased faces would let the page shine through between them.
    axes.add_collection(
        PolyCollection(list(flat), facecolors=colours[order], lw=0.0, antialiased=False, rasterized=True)
    )
    _frame(axes, box, view)


def draw_flat_points(axes: Axes, points: np.ndarray, box: np.ndarray, scale: ScalarMappable, view: FlatView) -> None:
    """A cloud as seen along an axis; nearer points hide farther ones."""
    inside = points[within(points, box)]
    inside = inside[np.argsort(inside @ np.array(view.eye))]
    colours = scale.to_rgba(inside[:, 2])
    axes.scatter(inside[:, view.right], inside[:, view.up], s=4, color=colours, lw=0.0, rasterized=True)
    _frame(axes, box, view)


def _shaded(
    body: Scene, box: np.ndarray, scale: ScalarMappable, eye: tuple[float, float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the faces that rise over the box's floor, and their colours by height, darker the more they turn away
    from the eye; it does not matter which way round a face is."""
    corners = body.vertices[body.faces]
    corners = corners[corners[..., 2].max(axis=1) > box[0, 2]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1) * np.linalg.norm(eye)
    facing = np.abs(normal @ np.array(eye)) / np.maximum(length, np.finfo(float).tiny)
    colours = scale.to_rgba(corners[..., 2].mean(axis=1))
    colours[:, :3] *= (_DARKEST + (1.0 - _DARKEST) * facing)[:, None]
    return corners, colours


def _frame(axes: Axes, box: np.ndarray, view: FlatView) -> None:
    axes.set_xlim(*box[:, view.right])
    axes.set_ylim(*box[:, view.up])
    axes.set_xlabel(f"{'xyz'[view.right]} [m]")
    axes.set_ylabel(f"{'xyz'[view.up]} [m]")
    axes.set_aspect("equal")
    axes.set_facecolor("0.96")
