"""Front slope, sectional area and volume of a reconstructed object, against the known one.

One definition for every method, over every emitted point. The steps, for each object in turn:

1. **Whose points.** A point belongs to the object whose centre is nearest in y. It counts where it lies within two
   heights of the object's box and at least 5 % of the height over the seabed: the longest false ramp of a single sonar
   lies inside, a false target elsewhere and the seabed do not. How a point was made never decides.
2. **Agreement.** Along x in bins of 1 cm, across y in columns one beam spacing wide. A bin stays if its count is at
   least 30 % of the median count (and more than one where the median is two or more), so that a stray neither extends
   nor raises the cloud. A count is of cells that hold points, half a bin by a column, not of points: a steep face gives
   its bins many more points than the level top, and would make the top look like strays. The median is the count of the
   bin in which the typical cell lies: many thin bins of a noisy seabed do not lower it.
3. **Envelope.** The top points of a bin are those within 5 % of the height under the highest point of their column;
   the medians of their x and z are the bin's node, which is therefore on the surface however steep that is. A median
   of three along x takes out a single raised node and leaves every monotone run as it is.
4. **Area.** Trapezoids between nodes, and level from the outer nodes to the ends. A gap longer than half the height is
   not bridged: what lies beyond is no part of the same surface. An end is the median over the columns of each one's
   outermost point and half its own sample spacing there beyond, so that neither a stray nor the tail of a noisy edge
   sets it. A column whose points reach down below half its height at an end shows a closed face there: it gets no more.
5. **Volume.** The same areas in slabs one beam spacing wide, each slab a single column. Bins must agree over the slabs
   as in step 2, then slabs over the bins. Trapezoids across y between the slabs' median y; an end is the median over
   the bins of each one's outermost point and half its own sample spacing beyond, so that it does not matter how beams
   fall on slabs.
6. **Front slope.** Front points are those of the central section up to the x at which the envelope first reaches 90 %
   of the top (the object's height, or the envelope's own where that stays lower) with two nodes in a row, plus 5 % of
   the height, and farther the lower they lie, as on a face that overhangs by 30 degrees: a jittering top stays out, the
   spread of a steep face and a front that leans too far stay in. Medians of x and z in eight height bins, least squares
   of x on z.

A sample spacing is the gap that the typical place falls into: the length-weighted median of the gaps between sorted
coordinates, the frame step of a sonar and next to nothing in a dense cloud; blind to a hole, since it never exceeds the
median step between nodes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sonarwarp.checks import finite_array, in_range

SECTION_HALF_WIDTH = 0.05
"""Half the width of the central section [m]."""

ENVELOPE_BIN = 0.01
"""Length of an envelope bin along x [m]."""

LEAST_SHARE = 0.3
"""Share of the median count under which a bin or a slab is dropped."""

HEIGHT_BINS = 8
"""Height bins of the front, between 10 % and 90 % of the object's height."""

LEAST_POINTS = 3
"""Front points that fill a height bin."""

LEAST_BINS = 5
"""Filled height bins that a slope needs."""

LEAST_NODES = 3
"""Bins that an envelope needs."""

LEAST_SLABS = 2
"""Slabs with an envelope that a volume needs."""

# In heights of the object: how far round its box points count, what counts as seabed, how thick the layer of a column's
# top points is, which gap is bridged, and how far behind the place where the envelope reaches the top a front point may
# lie.
_REACH = 2.0
_SEABED = 0.05
_TOP_LAYER = 0.05
_BRIDGE = 0.5
_FRONT_MARGIN = 0.05

# How much of a column tells the sample spacing at its end [m]: a ramp is sampled more closely than the top behind it.
_END_LENGTH = 0.05

# Run per height of the steepest overhang that still counts as a front.
_OVERHANG = math.tan(math.radians(30.0))


@dataclass(frozen=True, kw_only=True)
class ObjectTruth:
    """A known object on the seabed: its central section in x and z, and its volume.

    Raises:
        ValueError: a position that is not finite, a figure that is not positive, a slope outside (0, 90] degrees.
    """

    name: str
    """Name in results."""

    front_x: float
    """World x of the front's foot [m]."""

    centre_y: float
    """World y of the middle of the width [m]."""

    width: float
    """Extent along y [m]."""

    height: float
    """Height of the top over the seabed [m]."""

    depth: float
    """Extent along x over the seabed [m]."""

    front_slope_deg: float | None
    """Angle of the front against the horizontal [degrees]; None where the front is no straight line."""

    sectional_area: float
    """Area of the section over the seabed [m2]."""

    volume: float
    """Volume over the seabed [m3]."""

    def __post_init__(self) -> None:
        for field in ("front_x", "centre_y", "width", "height", "depth", "front_slope_deg", "sectional_area", "volume"):
            value = getattr(self, field)
            if field == "front_slope_deg" and value is None:
                continue
            if not math.isfinite(value):
                raise ValueError(f"{field}: {value}, must be finite")
            if field not in ("front_x", "centre_y") and value <= 0.0:
                raise ValueError(f"{field}: {value}, must be positive")
        if self.front_slope_deg is not None:
            in_range("front_slope_deg", self.front_slope_deg, 0.0, 90.0)


@dataclass(frozen=True, kw_only=True)
class SectionMetrics:
    """Section figures of one object. Errors are rates, |estimate - truth| / truth.

    ``None`` stands where the cloud holds too few points for a figure; in a summary that is a miss, never left out.
    """

    name: str
    """Name of the object."""

    slope_deg: float | None
    """Front slope [degrees], over 90 where the front leans back towards the sonar; needs five filled height bins."""

    slope_error: float | None
    """Error rate of the front slope; needs one, and an object that has one."""

    front_coverage: float
    """Filled height bins / 8."""

    area: float
    """Sectional area [m2]; 0 where there is no envelope."""

    area_error: float | None
    """Error rate of the sectional area; needs an envelope, three bins at least."""

    volume: float
    """Volume [m3]; 0 where there are no two slabs with an envelope."""

    volume_error: float | None
    """Error rate of the volume; needs two slabs with an envelope."""


def evaluate_section(
    points: ArrayLike, objects: Sequence[ObjectTruth], *, slab_width: float, seabed_z: float = 0.0
) -> list[SectionMetrics]:
    """Front slope, sectional area and volume of each object, by the definition at the head of this file.

    Args:
        points: every emitted point in the world frame [m], shape [point, 3]; the order does not matter.
        objects: the known objects.
        slab_width: distance between neighbouring beams at the objects [m].
        seabed_z: world z of the seabed [m].

    Returns:
        One entry per object, in their order.

    Raises:
        ValueError: points of another shape, a slab width outside [0.001, 10] m, a coordinate that is not finite.
    """
    cloud = finite_array("points", points, shape=(None, 3))
    in_range("slab_width", slab_width, 1e-3, 10.0)
    if not math.isfinite(seabed_z):
        raise ValueError(f"seabed_z: {seabed_z}, must be finite")
    if not objects:
        return []
    centres = np.array([truth.centre_y for truth in objects])
    owner = np.argmin(np.abs(cloud[:, 1, None] - centres), axis=1)
    return [
        _evaluate(_near(cloud[owner == index] - (truth.front_x, truth.centre_y, seabed_z), truth), truth, slab_width)
        for index, truth in enumerate(objects)
    ]


def _near(points: np.ndarray, truth: ObjectTruth) -> np.ndarray:
    """Points that count (step 1); here and below x from the front's foot, y from the centre, z from the seabed."""
    x, y, z = points.T
    reach = _REACH * truth.height
    counts = (x >= -reach) & (x <= truth.depth + reach) & (np.abs(y) <= 0.5 * truth.width + reach)
    return points[counts & (z >= _SEABED * truth.height) & (z <= truth.height + reach)]


def _evaluate(points: np.ndarray, truth: ObjectTruth, slab_width: float) -> SectionMetrics:
    section = points[np.abs(points[:, 1]) <= SECTION_HALF_WIDTH]
    column = _cell(section[:, 1], slab_width)
    agreed = _agreed(_cell(section[:, 0], ENVELOPE_BIN), _pair(_half_bin(section[:, 0]), column))
    envelope = _envelope(section[agreed], column[agreed], truth.height)
    area = None if envelope is None else envelope.area
    volume = _volume(points, slab_width, truth.height)
    slope, coverage = _front(section, envelope, truth.height)
    return SectionMetrics(
        name=truth.name,
        slope_deg=slope,
        slope_error=_error(slope, truth.front_slope_deg),
        front_coverage=coverage,
        area=area or 0.0,
        area_error=_error(area, truth.sectional_area),
        volume=volume or 0.0,
        volume_error=_error(volume, truth.volume),
    )


def _error(estimate: float | None, truth: float | None) -> float | None:
    return None if estimate is None or truth is None else abs(estimate - truth) / truth


def _cell(coordinate: np.ndarray, size: float) -> np.ndarray:
    """Index of the bin, column or slab; number 0 is centred on the object's own line, never cut by it."""
    return np.floor(coordinate / size + 0.5).astype(np.int64)


def _half_bin(x: np.ndarray) -> np.ndarray:
    """Index of the half of an envelope bin."""
    return np.floor(x / (0.5 * ENVELOPE_BIN)).astype(np.int64)


def _agreed(group: np.ndarray, member: np.ndarray) -> np.ndarray:
    """Which points lie in a group with enough members (step 2), shape [point]."""
    _, once = np.unique(_pair(group, member), return_index=True)
    groups, count = np.unique(group[once], return_counts=True)
    if not len(groups):
        return np.zeros(0, dtype=bool)
    median = float(np.median(np.repeat(count, count)))
    return np.isin(group, groups[count >= max(LEAST_SHARE * median, min(2.0, median))])


def _pair(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """One index for each pair of indices."""
    if not len(first):
        return first
    return (first - first.min()) * (np.ptp(second) + 1) + second - second.min()


@dataclass(frozen=True)
class _Envelope:
    """Upper envelope of a section: nodes by ascending x, shape [node] each, and the area under it [m2]."""

    x: np.ndarray
    z: np.ndarray
    area: float


def _envelope(points: np.ndarray, column: np.ndarray, height: float) -> _Envelope | None:
    """Steps 3 and 4 for an object ``height`` [m] tall; None with fewer than three bins."""
    x, _, z = points.T
    x_bin = _cell(x, ENVELOPE_BIN)
    if len(np.unique(x_bin)) < LEAST_NODES:
        return None
    cells, cell = np.unique(_pair(x_bin, column), return_inverse=True)
    highest = np.full(len(cells), -np.inf)
    np.maximum.at(highest, cell, z)
    top = z >= highest[cell] - _TOP_LAYER * height
    node_x, node_z = _medians(x_bin[top], x[top]), _medians(x_bin[top], z[top])
    node_z[1:-1] = np.median(np.stack([node_z[:-2], node_z[1:-1], node_z[2:]]), axis=0)
    step = float(np.median(np.diff(node_x)))
    ends = [_column_ends(x[column == index], z[column == index], step) for index in np.unique(column)]
    return _Envelope(node_x, node_z, _integral(node_x, node_z, ends, _BRIDGE * height))


def _column_ends(x: np.ndarray, z: np.ndarray, step: float) -> tuple[float, float]:
    """Where a column's surface begins and ends along x (step 4)."""
    low, high = x.min(), x.max()
    first, last = z[x <= low + ENVELOPE_BIN], z[x >= high - ENVELOPE_BIN]
    before = _half_spacing(x[x <= low + _END_LENGTH], step) if first.min() >= 0.5 * first.max() else 0.0
    behind = _half_spacing(x[x >= high - _END_LENGTH], step) if last.min() >= 0.5 * last.max() else 0.0
    return low - before, high + behind


def _medians(group: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Median of ``value`` in each group, by ascending group."""
    value = value[np.lexsort((value, group))]
    _, first, count = np.unique(np.sort(group), return_index=True, return_counts=True)
    return 0.5 * (value[first + (count - 1) // 2] + value[first + count // 2])


def _integral(node: np.ndarray, value: np.ndarray, ends: Sequence[tuple[float, float]], bridge: float) -> float:
    """Trapezoids between nodes no more than ``bridge`` apart, level from the outer nodes to the median of ``ends``."""
    first, last = np.median(np.array(ends), axis=0)
    step = np.diff(node)
    between = np.where(step <= bridge, step * 0.5 * (value[1:] + value[:-1]), 0.0)
    return float(value[0] * max(node[0] - first, 0.0) + np.sum(between) + value[-1] * max(last - node[-1], 0.0))


def _half_spacing(sample: np.ndarray, most: float) -> float:
    """Half the sample spacing, taken as ``most`` where there is one sample only."""
    gap = np.sort(np.diff(np.sort(sample)))
    if not len(gap):
        return 0.5 * most
    covered = np.cumsum(gap)
    return 0.5 * min(float(gap[np.searchsorted(covered, 0.5 * covered[-1])]), most)


def _volume(points: np.ndarray, slab_width: float, height: float) -> float | None:
    """Step 5; None with fewer than two slabs."""
    slab = _cell(points[:, 1], slab_width)
    x_bin = _cell(points[:, 0], ENVELOPE_BIN)
    agreed = _agreed(x_bin, _pair(_half_bin(points[:, 0]), slab))
    points, slab, x_bin = points[agreed], slab[agreed], x_bin[agreed]
    agreed = _agreed(slab, _half_bin(points[:, 0]))
    points, slab, x_bin = points[agreed], slab[agreed], x_bin[agreed]
    middle, area = [], []
    for index in np.unique(slab):
        held = points[slab == index]
        envelope = _envelope(held, np.zeros(len(held), dtype=np.int64), height)
        if envelope is not None:
            middle.append(float(np.median(held[:, 1])))
            area.append(envelope.area)
    if len(middle) < LEAST_SLABS:
        return None
    step = float(np.median(np.diff(middle)))
    ends = []
    for index in np.unique(x_bin):
        y = points[x_bin == index, 1]
        half = _half_spacing(y, step)
        ends.append((y.min() - half, y.max() + half))
    return _integral(np.array(middle), np.array(area), ends, _BRIDGE * height)


def _front(section: np.ndarray, envelope: _Envelope | None, height: float) -> tuple[float | None, float]:
    """Front slope [degrees], or None, and the share of filled height bins (step 6); a face alone has no envelope."""
    if envelope is not None:
        reached = 0.9 * min(height, float(envelope.z.max()))
        high = envelope.z >= reached
        settled = high & np.append(high[1:], True)
        end = envelope.x[np.argmax(settled if settled.any() else high)] + _FRONT_MARGIN * height
        section = section[section[:, 0] <= end + _OVERHANG * np.maximum(reached - section[:, 2], 0.0)]
    x, _, z = section.T
    height_bin = np.floor((z / height - 0.1) / (0.8 / HEIGHT_BINS))
    inside = [height_bin == index for index in range(HEIGHT_BINS)]
    filled = [held for held in inside if np.count_nonzero(held) >= LEAST_POINTS]
    coverage = len(filled) / HEIGHT_BINS
    if len(filled) < LEAST_BINS:
        return None, coverage
    median_x = np.array([np.median(x[held]) for held in filled])
    median_z = np.array([np.median(z[held]) for held in filled])
    from_mean = median_z - median_z.mean()
    run_per_height = float(np.sum(from_mean * median_x) / np.sum(from_mean**2))
    return math.degrees(math.atan2(1.0, run_per_height)), coverage
