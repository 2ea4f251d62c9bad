"""Polygons of OpenUSD's analytic shapes. Corners lie on the true surface, so a round body is drawn a little small."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

Axis = Literal["X", "Y", "Z"]

# Columns that turn a shape along z to lie along another axis; even permutations, so that nothing is mirrored.
_COLUMNS = {"X": [2, 0, 1], "Y": [1, 2, 0], "Z": [0, 1, 2]}


class Polygons(NamedTuple):
    """Faces of any number of corners."""

    points: np.ndarray
    """Positions, float64, shape [point, 3]."""

    counts: np.ndarray
    """Corners of each face, shape [face]."""

    indices: np.ndarray
    """Points at all faces' corners, one face after the other, counter-clockwise from outside."""


def cube(size: float) -> Polygons:
    """A cube around the origin with edges of ``size``."""
    corner = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return Polygons(size * corner, np.full(6, 4), np.ravel(sides))


def plane(width: float, length: float, axis: Axis) -> Polygons:
    """A rectangle around the origin that faces along ``axis``.

    Its width lies along x (z for axis X), its length along y (z for axis Y).
    """
    across, along = {"X": (2, 1), "Y": (0, 2), "Z": (0, 1)}[axis]
    points = np.zeros((4, 3))
    points[:, across] = 0.5 * width * np.array([-1.0, 1.0, 1.0, -1.0])
    points[:, along] = 0.5 * length * np.array([-1.0, -1.0, 1.0, 1.0])
    order = [0, 1, 2, 3] if axis == "Z" else [3, 2, 1, 0]
    return Polygons(points, np.array([4]), np.array(order))


def sphere(radius: float, segments: int) -> Polygons:
    """A sphere around the origin."""
    return _turned([_arc(radius, 0.0, -90.0, 90.0, segments)], "Z", segments)


def cylinder(height: float, bottom: float, top: float, axis: Axis, segments: int) -> Polygons:
    """A cylinder around the origin, or a frustum; with a ``top`` radius of 0 a cone."""
    return _turned([[(bottom, -0.5 * height), (top, 0.5 * height)]], axis, segments)


def capsule(height: float, bottom: float, top: float, axis: Axis, segments: int) -> Polygons:
    """A cylinder of ``height`` around the origin with a half sphere on each end."""
    below = _arc(bottom, -0.5 * height, -90.0, 0.0, segments)
    above = _arc(top, 0.5 * height, 0.0, 90.0, segments)
    return _turned([below, above], axis, segments)


def _arc(radius: float, middle: float, first_deg: float, last_deg: float, segments: int) -> list[tuple[float, float]]:
    """Radii and heights along a circle, in steps as long as those around it; exactly 0 at a pole."""
    steps = max(1, round(segments * (last_deg - first_deg) / 360.0))
    latitudes = [math.radians(first_deg + (last_deg - first_deg) * i / steps) for i in range(steps + 1)]
    poles = (math.radians(-90.0), math.radians(90.0))
    return [(0.0 if a in poles else radius * math.cos(a), middle + radius * math.sin(a)) for a in latitudes]


def _turned(profile: Sequence[Sequence[tuple[float, float]]], axis: Axis, segments: int) -> Polygons:
    """The surface that a profile of (radius, height), bottom to top, sweeps about ``axis``; its ends are closed."""
    rows = np.array([place for part in profile for place in part])
    angle = 2.0 * np.pi * np.arange(segments) / segments
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points, rings = [], []
    for radius, height in rows:
        # A ring without radius is one point.
        here = ring * radius if radius else np.zeros((1, 2))
        rings.append(sum(len(p) for p in points) + np.arange(segments) % len(here))
        points.append(np.column_stack([here, np.full(len(here), height)]))
    # A shape without any radius has no faces.
    counts, indices = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]

    def add(faces: np.ndarray) -> None:
        counts.append(np.full(len(faces), faces.shape[1]))
        indices.append(faces.ravel())

    if rows[0, 0]:
        add(rings[0][None, ::-1])
    for k in range(len(rows) - 1):
        low, high = rings[k], rings[k + 1]
        sides = np.stack([low, np.roll(low, -1), np.roll(high, -1), high], axis=1)
        if rows[k, 0] and rows[k + 1, 0]:
            add(sides)
        elif rows[k, 0]:
            add(sides[:, [0, 1, 3]])
        elif rows[k + 1, 0]:
            add(sides[:, [0, 2, 3]])
    if rows[-1, 0]:
        add(rings[-1][None])
    return Polygons(np.concatenate(points)[:, _COLUMNS[axis]], np.concatenate(counts), np.concatenate(indices))
