"""Faces of any number of corners cut into triangles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np


class Triangulation(NamedTuple):
    """Triangles of polygons, in the polygons' order."""

    triangles: np.ndarray
    """Vertex indices, int64, shape [triangle, 3], wound as their polygons."""

    face: np.ndarray
    """Polygon that each triangle is of, shape [triangle]."""

    polygons: int
    """Polygons of more than three corners."""

    tangled: int
    """Polygons among them that cross themselves: covered by as many triangles as any other, but not exactly."""


def triangulate(points: np.ndarray, counts: np.ndarray, indices: np.ndarray) -> Triangulation:
    """Cut polygons of three corners or more into triangles.

    A strictly convex one is fanned from its first corner, as OpenUSD's viewers do; a quadrilateral with one corner that
    is not is cut from that corner; any other loses ear after ear. No triangle of a polygon that does not cross itself
    has zero area, unless the whole polygon has.

    Args:
        points: positions, shape [point, 3].
        counts: corners of each polygon, at least 3, shape [polygon].
        indices: points at the corners of all polygons, one after the other, shape [sum of counts].
    """
    counts = np.asarray(counts, dtype=np.int64)
    indices = np.asarray(indices, dtype=np.int64)
    first_corner = np.cumsum(counts) - counts
    first_triangle = np.cumsum(counts - 2) - (counts - 2)
    triangles = np.empty((int(np.sum(counts - 2)), 3), dtype=np.int64)
    tangled = 0
    for n in np.unique(counts):
        face = np.flatnonzero(counts == n)
        corners = indices[first_corner[face, None] + np.arange(n)]
        if n == 3:
            triangles[first_triangle[face]] = corners
            continue
        cuts, crossing = _cut(_flatten(points[corners]))
        tangled += crossing
        triangles[first_triangle[face, None] + np.arange(n - 2)] = corners[np.arange(len(face))[:, None, None], cuts]
    return Triangulation(
        triangles=triangles,
        face=np.repeat(np.arange(len(counts)), counts - 2),
        polygons=int(np.count_nonzero(counts > 3)),
        tangled=tangled,
    )


def _flatten(corners: np.ndarray) -> np.ndarray:
    """Polygons [p, n, 3] as seen against their (Newell) normal, counter-clockwise, shape [p, n, 2]."""
    relative = corners - corners[:, :1]
    normal = np.cross(relative, np.roll(relative, -1, axis=1)).sum(axis=1)
    row = np.arange(len(corners))
    # Looking along the axis nearest to the normal keeps what is convex and what lies inside.
    axis = np.abs(normal).argmax(axis=1)
    across, up = (axis + 1) % 3, (axis + 2) % 3
    from_below = normal[row, axis] < 0.0
    across, up = np.where(from_below, up, across), np.where(from_below, across, up)
    return np.stack([relative[row, :, across], relative[row, :, up]], axis=-1)


def _cut(flat: np.ndarray) -> tuple[np.ndarray, int]:
    """Corners of the triangles of polygons [p, n, 2], shape [p, n - 2, 3], and how many polygons cross themselves."""
    count, n = flat.shape[:2]
    before = flat - np.roll(flat, 1, axis=1)
    after = np.roll(flat, -1, axis=1) - flat
    turn = before[..., 0] * after[..., 1] - before[..., 1] * after[..., 0]
    angle = np.arctan2(turn, np.sum(before * after, axis=-1))
    # A pentagram turns left at every corner too, but twice around.
    convex = (turn > 0.0).all(axis=1) & (angle.sum(axis=1) < 3.0 * np.pi)
    apex = np.zeros(count, dtype=np.int64)
    fanned = convex
    if n == 4:
        dart = (turn > 0.0).sum(axis=1) == 3
        apex[dart] = np.argmin(turn[dart], axis=1)
        fanned = convex | dart
    step = np.arange(n - 2)
    fan = np.stack([np.zeros(n - 2, dtype=np.int64), step + 1, step + 2], axis=1)
    cuts = (apex[:, None, None] + fan) % n
    crossing = 0
    for polygon in np.flatnonzero(~fanned):
        cuts[polygon], crosses = _clip_ears(flat[polygon, :, 0].tolist(), flat[polygon, :, 1].tolist())
        crossing += crosses
    return cuts, crossing


def _clip_ears(x: Sequence[float], y: Sequence[float]) -> tuple[list[tuple[int, int, int]], bool]:
    """Triangles of one counter-clockwise polygon, and whether it crosses itself."""

    def turn(a: int, b: int, c: int) -> float:
        return (x[b] - x[a]) * (y[c] - y[b]) - (y[b] - y[a]) * (x[c] - x[b])

    def is_ear(a: int, b: int, c: int) -> bool:
        if not turn(a, b, c) > 0.0:
            return False
        # Only corners that are not convex can lie inside.
        return not any(
            r not in (a, b, c) and turn(a, b, r) >= 0.0 and turn(b, c, r) >= 0.0 and turn(c, a, r) >= 0.0
            for r in reflex
        )

    n = len(x)
    previous = [(i - 1) % n for i in range(n)]
    following = [(i + 1) % n for i in range(n)]
    reflex = {i for i in range(n) if not turn(previous[i], i, following[i]) > 0.0}
    triangles: list[tuple[int, int, int]] = []
    crosses = False
    corner, passed = 0, 0
    while len(triangles) < n - 3:
        a, c = previous[corner], following[corner]
        remaining = n - len(triangles)
        # After a round without an ear a corner without area goes, and after another round whatever is next.
        stuck = passed >= 2 * remaining
        if is_ear(a, corner, c) or (passed >= remaining and turn(a, corner, c) == 0.0) or stuck:
            crosses = crosses or stuck
            triangles.append((a, corner, c))
            following[a], previous[c] = c, a
            reflex.discard(corner)
            reflex -= {i for i in (a, c) if i in reflex and turn(previous[i], i, following[i]) > 0.0}
            # Going on past the next corner keeps a long run of corners from becoming a fan of slivers.
            corner, passed = following[c], 0
        else:
            corner, passed = c, passed + 1
    triangles.append((previous[corner], corner, following[corner]))
    return triangles, crosses or turn(*triangles[-1]) < 0.0
