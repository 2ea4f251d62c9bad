"""Single drawings on a matplotlib axes: sonar images, the field, sections, clouds.

One colour means one thing on every page; all are told apart by colour-blind readers (Okabe and Ito's palette).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sonarwarp.app.snapshot import Snapshot
from sonarwarp.poses import rotate
from sonarwarp.sonar import FLS
from sonarwarp_scenes import PlacedObject

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from mpl_toolkits.mplot3d.axes3d import Axes3D

TRUTH = "#009E73"
LIMIT = "#56B4E9"
DETECTION = "#F0E442"
METHODS = {"single": "#D55E00", "fused": "#0072B2"}

# Echoes are drawn from this far under the strongest [dB].
_FLOOR_DB = -50.0

_UNSEEN = "0.85"

DARK_LEGEND: dict[str, Any] = {"facecolor": "0.3", "edgecolor": "none", "labelcolor": "white", "framealpha": 0.9}
"""For legends of what is drawn on black."""


def decibels(amplitude: np.ndarray) -> np.ndarray:
    """Amplitude over the strongest of all [dB], no less than the floor of the colour scale."""
    peak = max(float(amplitude.max(initial=0.0)), float(np.finfo(np.float32).tiny))
    return 20.0 * np.log10(np.maximum(amplitude / peak, 10.0 ** (_FLOOR_DB / 20.0)))


def draw_fan(
    axes: Axes, fls: FLS, level: np.ndarray, seabed_range: np.ndarray, critical_range: np.ndarray
) -> ScalarMappable:
    """One FLS frame in its own plane, with the limit of the region of interest and the critical points.

    Args:
        axes: where to draw.
        fls: the sonar, for its beams and bins.
        level: echo amplitude [dB], shape [beam, bin].
        seabed_range: limit of the region of interest [m], shape [beam].
        critical_range: contacts [m], below 0 where a beam has none, shape [beam].
    """
    across, ahead = _fan_place(fls.range_edge, fls.azimuth_edge[:, None])
    drawn = axes.pcolormesh(across, ahead, level, cmap="gray", vmin=_FLOOR_DB, vmax=0.0, rasterized=True)
    axes.plot(*_fan_place(seabed_range, fls.azimuth), "--", color=LIMIT, lw=2.0, label="limit of the ROI")
    found = critical_range >= 0.0
    place = _fan_place(critical_range[found], fls.azimuth[found])
    axes.plot(*place, "o", color=DETECTION, ms=3.5, mew=0.0, label="critical points")
    axes.set_aspect("equal")
    axes.set_facecolor(_UNSEEN)
    # Left of the vehicle on the left.
    axes.set_xlim(1.02 * float(across.max()), 1.02 * float(across.min()))
    axes.set_ylim(0.0, 1.02 * float(fls.range_edge[-1]))
    axes.set_xlabel("to the left [m]")
    return drawn


def _fan_place(slant_range: np.ndarray, azimuth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return slant_range * np.sin(azimuth), slant_range * np.cos(azimuth)


@dataclass(frozen=True, kw_only=True)
class SweepPlane:
    """A vertical plane to draw a sweep in."""

    origin: tuple[float, float]
    """World x and y from where the horizontal axis counts [m]."""

    heading: float
    """Of the horizontal axis, to the left of world x [rad]."""

    label: str
    """Of the horizontal axis."""

    def project(self, points: np.ndarray) -> np.ndarray:
        """Places [..., 2] in the plane, along its heading and up, of world points [..., 3]."""
        away = points[..., :2] - self.origin
        return np.stack([self.along(away), points[..., 2]], axis=-1)

    def along(self, vectors: np.ndarray) -> np.ndarray:
        """Lengths along the heading [...] of world vectors [..., 2 or more]."""
        return vectors[..., 0] * np.cos(self.heading) + vectors[..., 1] * np.sin(self.heading)


ALONG_X = SweepPlane(origin=(0.0, 0.0), heading=0.0, label="x [m]")


def draw_sweep(axes: Axes, snapshot: Snapshot, plane: SweepPlane) -> None:
    """The last sweep of the PS in a vertical plane: each ping at its head's angle, from where it was sent."""
    ps = snapshot.survey.rig.ps
    shown = slice(-ps.pings_per_sweep, None)
    echoes, footprints = snapshot.echoes[shown], snapshot.footprints[shown]
    pose = snapshot.survey.pings.head_pose[shown]
    axis = rotate(pose[:, 3:], np.array([1.0, 0.0, 0.0]))
    start, depression = plane.project(pose[:, :3]), np.arctan2(-axis[:, 2], plane.along(axis))
    half = np.radians(ps.beamwidth_deg) / 2
    # Two edges a ping; what lies between one ping's upper and the next one's lower is left empty.
    edges = np.stack([depression - half, depression + half], axis=1).reshape(-1, 1)
    x, z = _along(np.repeat(start, 2, axis=0)[:, None], ps.range_edge, edges)
    level = np.full((len(edges) - 1, ps.bins), np.nan)
    level[::2] = decibels(echoes)
    axes.pcolormesh(x, z, level, cmap="gray", vmin=_FLOOR_DB, vmax=0.0, rasterized=True)
    ping, number = np.nonzero(footprints[..., 1] >= 0.0)
    near, centre, far = (_along(start[ping], footprints[ping, number, point], depression[ping]) for point in range(3))
    axes.plot(*(np.stack(ends) for ends in zip(near, far, strict=True)), "-", color=DETECTION, lw=1.0)
    axes.plot(*centre, "o", color=DETECTION, ms=3.0, mew=0.0, label="footprints: centre, 10 to 90 % of the energy")
    axes.plot(*start.T, "-", color=LIMIT, lw=3.0, label="the sonar's way")
    axes.set_aspect("equal")
    # Nearly black, or the slivers between pings would be all that a reader sees.
    axes.set_facecolor("0.12")
    axes.set_xlabel(plane.label)
    axes.set_ylabel("z [m]")


def _along(start: np.ndarray, reach: np.ndarray, depression: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Place in the plane of a sweep [m] at a range from ``start`` [..., 2]."""
    return start[..., 0] + reach * np.cos(depression), start[..., 1] - reach * np.sin(depression)


def draw_field(axes: Axes, snapshot: Snapshot, y: float) -> ScalarMappable:
    """Probability that cells are occupied, in the vertical plane at ``y`` [m]."""
    cells = snapshot.occupancy(y)
    x = snapshot.origin[0] + snapshot.cell * np.arange(cells.shape[0] + 1)
    z = snapshot.origin[2] + snapshot.cell * np.arange(cells.shape[1] + 1)
    drawn = axes.pcolormesh(x, z, cells.T, cmap="gray_r", vmin=0.0, vmax=1.0, rasterized=True)
    axes.set_facecolor("0.5")
    _name_section(axes)
    return drawn


def draw_outline(axes: Axes, placed: PlacedObject) -> None:
    """The true section of an object."""
    x, z = placed.shape.outline().T
    axes.plot(placed.front_x + x, z, "-", color=TRUTH, lw=2.0, label="truth")


def draw_section(axes: Axes, points: np.ndarray, method: str, label: str) -> None:
    """Points of a central section, one method's."""
    axes.plot(points[:, 0], points[:, 2], "o", color=METHODS[method], ms=2.5, mew=0.0, label=label)
    _name_section(axes)


def _name_section(axes: Axes) -> None:
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("z [m]")


def draw_cloud(axes: Axes3D, points: np.ndarray, box: np.ndarray, method: str) -> None:
    """A cloud to scale; what lies outside ``box`` [m], shape [2, 3], is left out."""
    inside = points[((points >= box[0]) & (points <= box[1])).all(axis=1)]
    axes.scatter(*inside.T, s=2, color=METHODS[method], lw=0.0, depthshade=False, rasterized=True)
    frame_box(axes, box)


def frame_box(axes: Axes3D, box: np.ndarray) -> None:
    """Show exactly ``box`` [m], shape [2, 3], to scale."""
    from matplotlib.ticker import MaxNLocator

    axes.set(xlim=box[:, 0], ylim=box[:, 1], zlim=box[:, 2])
    axes.set_xlabel("x [m]", labelpad=13.0)
    axes.set_ylabel("y [m]", labelpad=9.0)
    axes.set_zlabel("z [m]", labelpad=4.0)
    sides = np.ptp(box, axis=0)
    axes.set_box_aspect(sides)
    # No more ticks than a side has room for.
    for axis, side in zip((axes.xaxis, axes.yaxis, axes.zaxis), sides, strict=True):
        axis.set_major_locator(MaxNLocator(max(2, round(6 * side / sides.max()))))


def draw_edges(axes: Axes3D, placed: PlacedObject) -> None:
    """The true edges of an object."""
    offset = np.array([placed.front_x, placed.centre_y, 0.0])
    for line in placed.shape.edges():
        axes.plot(*(line + offset).T, color=TRUTH, lw=1.2)
