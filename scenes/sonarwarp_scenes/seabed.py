"""Seabeds: a plane, and a Gaussian random surface."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sonarwarp_scenes.checks import check_positive
from sonarwarp_scenes.materials import SAND
from sonarwarp_scenes.scene import Scene

# Edge of the squares of nodes that are seeded one by one.
_TILE = 64

# Where the smoothing kernel exp(-2 (d / L)^2) is cut off, in correlation lengths: it has fallen to 2e-8 there.
_KERNEL_REACH = 3.0

# Building a surface of this many nodes takes about 5 GB.
_MOST_NODES = 2**23


@dataclass(frozen=True, kw_only=True)
class Extent:
    """A rectangle of the seabed, in world coordinates.

    Raises:
        ValueError: a border that is not finite, or an upper one that is not over the lower.
    """

    x_min: float
    """Lowest x [m]."""

    x_max: float
    """Highest x [m]."""

    y_min: float
    """Lowest y [m]."""

    y_max: float
    """Highest y [m]."""

    def __post_init__(self) -> None:
        for axis in "xy":
            low, high = getattr(self, f"{axis}_min"), getattr(self, f"{axis}_max")
            if not (math.isfinite(low) and math.isfinite(high) and low < high):
                raise ValueError(f"{axis}_max: {high}, must be finite and over {axis}_min of {low}")


@dataclass(frozen=True, kw_only=True)
class Roughness:
    """A zero-mean Gaussian random height with correlation ``exp(-(d / correlation_length)^2)`` at distance d.

    Raises:
        ValueError: a length that is not positive, nodes too far apart to carry the correlation, or a negative seed.
    """

    rms_height: float = 0.01
    """Root mean square height of the nodes [m]. Ours: ripples of a calm sandy bottom."""

    correlation_length: float = 0.3
    """Distance at which the correlation has fallen to exp(-1) [m]. Ours, as above."""

    seed: int = 0
    """Surfaces of different seeds are independent."""

    spacing: float | None = None
    """Distance between nodes [m], at most half a correlation length; None: a quarter of it, at which the flat triangles
    between the nodes lose 2 % of the RMS height."""

    def __post_init__(self) -> None:
        check_positive("rms_height", self.rms_height)
        check_positive("correlation_length", self.correlation_length)
        if self.seed < 0:
            raise ValueError(f"seed: {self.seed}, must be 0 or more")
        if self.spacing is not None:
            check_positive("spacing", self.spacing)
            if self.spacing > 0.5 * self.correlation_length:
                raise ValueError(
                    f"spacing: {self.spacing} m, must be at most half the correlation_length of "
                    f"{self.correlation_length} m"
                )

    @property
    def node_spacing(self) -> float:
        """Distance between nodes [m]."""
        return 0.25 * self.correlation_length if self.spacing is None else self.spacing


def flat_seabed(extent: Extent, *, impedance: float = SAND) -> Scene:
    """The plane z = 0 over ``extent``, facing up.

    Two triangles: rays may leak through an edge that triangles share, so there is one such edge only.

    Args:
        extent: rectangle covered.
        impedance: acoustic impedance [rayl].
    """
    x = [extent.x_min, extent.x_max, extent.x_max, extent.x_min]
    y = [extent.y_min, extent.y_min, extent.y_max, extent.y_max]
    return Scene(
        vertices=np.stack([x, y, np.zeros(4)], axis=1),
        faces=np.array([[0, 1, 2], [0, 2, 3]]),
        impedance=np.full(2, impedance),
    )


def rough_seabed(extent: Extent, roughness: Roughness, *, impedance: float = SAND) -> Scene:
    """A random surface about z = 0 that covers ``extent``, facing up.

    The surface belongs to the plane, not to the extent: nodes stand at multiples of the spacing, and a node's height
    depends on its place and the seed only, bit for bit. Two runs of different length lie on one seabed.

    Args:
        extent: rectangle to cover; the surface reaches the next node beyond each border.
        roughness: description of the height.
        impedance: acoustic impedance [rayl].

    Raises:
        ValueError: more nodes than fit in memory.
    """
    spacing = roughness.node_spacing
    first = math.floor(extent.x_min / spacing), math.floor(extent.y_min / spacing)
    last = math.ceil(extent.x_max / spacing), math.ceil(extent.y_max / spacing)
    nx, ny = last[0] - first[0] + 1, last[1] - first[1] + 1
    if nx * ny > _MOST_NODES:
        raise ValueError(f"spacing: {spacing} m makes {nx * ny} nodes over the extent, must be at most {_MOST_NODES}")
    height = _node_heights(first, (nx, ny), roughness)
    x = (first[0] + np.arange(nx)) * spacing
    y = (first[1] + np.arange(ny)) * spacing
    node = np.arange(nx * ny).reshape(nx, ny)
    near_right, far_right, near_left, far_left = node[:-1, :-1], node[1:, :-1], node[:-1, 1:], node[1:, 1:]
    faces = np.stack([near_right, far_right, far_left, near_right, far_left, near_left], axis=-1).reshape(-1, 3)
    return Scene(
        vertices=np.stack([np.repeat(x, ny), np.tile(y, nx), height.ravel()], axis=1),
        faces=faces,
        impedance=np.full(len(faces), impedance),
    )


def _node_heights(first: tuple[int, int], count: tuple[int, int], roughness: Roughness) -> np.ndarray:
    """Heights [m] of ``count`` nodes from node ``first`` on, shape [nx, ny].

    White noise under a kernel exp(-2 (d / L)^2), whose own correlation is exp(-(d / L)^2), scaled to unit power. The
    kernel factors over the axes and is summed tap by tap: a transform's period and rounding would depend on the extent.
    """
    reach = math.ceil(_KERNEL_REACH * roughness.correlation_length / roughness.node_spacing)
    step = np.arange(-reach, reach + 1) * (roughness.node_spacing / roughness.correlation_length)
    taps = np.exp(-2.0 * step**2)
    taps /= np.sqrt(np.sum(taps**2))
    height = _white_noise((first[0] - reach, first[1] - reach), (count[0] + 2 * reach, count[1] + 2 * reach), roughness)
    for n in count:
        # Smooths the leading axis and turns the other one to the front: twice is both, in their order.
        smooth = np.zeros((n, height.shape[1]))
        for start, tap in enumerate(taps):
            smooth += tap * height[start : start + n]
        height = smooth.T
    return roughness.rms_height * height


def _white_noise(first: tuple[int, int], count: tuple[int, int], roughness: Roughness) -> np.ndarray:
    """Independent standard normal variates of ``count`` nodes from node ``first`` on, one stream per tile of nodes."""
    tiles_x, tiles_y = (
        range(start // _TILE, (start + n - 1) // _TILE + 1) for start, n in zip(first, count, strict=True)
    )
    noise = np.block([[_tile_noise(x, y, roughness.seed) for y in tiles_y] for x in tiles_x])
    skip_x, skip_y = first[0] - tiles_x[0] * _TILE, first[1] - tiles_y[0] * _TILE
    return noise[skip_x : skip_x + count[0], skip_y : skip_y + count[1]]


def _tile_noise(x: int, y: int, seed: int) -> np.ndarray:
    # Spawn keys are unsigned words: the plane wraps after 2^32 tiles.
    sequence = np.random.SeedSequence(seed, spawn_key=(x % 2**32, y % 2**32))
    return np.random.Generator(np.random.PCG64(sequence)).standard_normal((_TILE, _TILE))
