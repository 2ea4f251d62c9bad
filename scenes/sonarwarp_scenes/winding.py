"""Triangles wound one way: counter-clockwise seen from outside, where there is an outside.

trimesh can do this too, but walks a graph in Python and needs networkx: a million triangles take it minutes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Winding(NamedTuple):
    """Triangles after :func:`wind_outwards`, and what is known of them."""

    triangles: np.ndarray
    """Vertex indices, shape [triangle, 3], in the order given."""

    flipped: int
    """Triangles that were turned over."""

    closed: int
    """Triangles of closed surfaces: wound outwards now. Those with two corners at one place count nowhere."""

    open: int
    """Triangles of surfaces with a border: of one sense now, but which side is out is not known."""

    unclear: int
    """Triangles of surfaces with one side only, or with an edge that three triangles or more share; the former are left
    as they were, the latter are of one sense up to such edges."""


def wind_outwards(vertices: np.ndarray, triangles: np.ndarray) -> Winding:
    """Turn triangles over so that neighbours agree, and so that closed surfaces face outwards.

    Surfaces are joined over edges that exactly two triangles share; vertices at the same place count as one. On an open
    surface the majority of the triangles keeps its sense. Every closed surface is taken for itself: the wall of a
    cavity comes to face into the body around it.

    Args:
        vertices: finite positions, shape [vertex, 3].
        triangles: vertex indices, shape [triangle, 3].
    """
    count = len(triangles)
    corners = _weld(vertices)[triangles]
    start, end = corners, np.roll(corners, -1, axis=1)
    ascends = (start < end).ravel()
    # A triangle with two corners at one place, as at the poles of many spheres, joins nothing: its sides are one edge.
    proper = (start != end).all(axis=1)
    sides = np.flatnonzero(np.repeat(proper, 3))
    span = int(corners.max(initial=0)) + 1
    edge = (np.minimum(start, end).astype(np.int64) * span + np.maximum(start, end)).ravel()[sides]
    order = np.argsort(edge, kind="stable")
    sides, edge = sides[order], edge[order]
    first = np.flatnonzero(np.diff(edge, prepend=-1))
    uses = np.diff(first, append=len(edge))
    pair = first[uses == 2]
    a, b = sides[pair] // 3, sides[pair + 1] // 3
    # Neighbours of one sense run through their edge in opposite directions.
    differs = ascends[sides[pair]] == ascends[sides[pair + 1]]
    surface, turned = _agree(count, a, b, differs)

    whole = np.ones(count, dtype=bool)
    whole[surface[sides[np.repeat(uses, uses) != 2] // 3]] = False
    sound = np.ones(count, dtype=bool)
    sound[surface[sides[np.repeat(uses, uses) > 2] // 3]] = False
    twisted = surface[a[(turned[a] ^ turned[b]) != differs]]
    sound[twisted] = whole[twisted] = False
    turned &= ~np.isin(surface, twisted)

    # The sense that most have is kept, then closed surfaces that hold a negative volume are turned.
    size = np.bincount(surface, minlength=count)
    minority = np.bincount(surface, weights=turned, minlength=count) * 2.0 <= size
    turned ^= ~minority[surface]
    # Volumes are of cones to a corner of the surface itself: far from the origin they would cancel badly.
    relative = vertices[triangles] - vertices[triangles[surface, 0]][:, None]
    cones = np.einsum("ij,ij->i", relative[:, 0], np.cross(relative[:, 1], relative[:, 2]))
    volume = np.bincount(surface, weights=np.where(turned, -cones, cones), minlength=count)
    turned ^= whole[surface] & (volume[surface] < 0.0)

    wound = np.array(triangles)
    wound[turned] = wound[turned][:, ::-1]
    closed, clear = whole[surface] & proper, sound[surface]
    return Winding(
        triangles=wound,
        flipped=int(turned.sum()),
        closed=int(closed.sum()),
        open=int((~closed & clear & proper).sum()),
        unclear=int((~clear).sum()),
    )


def _weld(vertices: np.ndarray) -> np.ndarray:
    """One number per place, shape [vertex]."""
    order = np.lexsort(vertices.T)
    ordered = vertices[order]
    # Compared as numbers: 0.0 and -0.0 are one place.
    new = np.concatenate([[True], (ordered[1:] != ordered[:-1]).any(axis=1)])[: len(ordered)]
    place = np.empty(len(vertices), dtype=np.int64)
    place[order] = np.cumsum(new) - 1
    return place


def _agree(count: int, a: np.ndarray, b: np.ndarray, differs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Surfaces of ``count`` triangles joined by pairs ``a``, ``b``, and a sense in which neighbours agree.

    A union-find that works on all pairs at once: roots hook onto lower roots, then every triangle looks up its root's
    root, carrying along whether it is turned against it.

    Returns:
        The lowest triangle of each triangle's surface, and whether it must be turned over to agree with that one,
        unless the surface is twisted; both of shape [triangle].
    """
    root = np.arange(count)
    turned = np.zeros(count, dtype=bool)
    while len(a):
        low, high = np.minimum(root[a], root[b]), np.maximum(root[a], root[b])
        apart = low != high
        a, b, differs, low, high = a[apart], b[apart], differs[apart], low[apart], high[apart]
        # Where several pairs hook one root, the last writes both arrays.
        root[high], turned[high] = low, differs ^ turned[a] ^ turned[b]
        while True:
            above = root[root]
            if (above == root).all():
                break
            turned ^= turned[root] & (above != root)
            root = above
    return root, turned
