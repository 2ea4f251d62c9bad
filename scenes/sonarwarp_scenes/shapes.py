"""The paper's objects, with their closed forms."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sonarwarp_scenes.checks import check_finite, check_positive
from sonarwarp_scenes.scene import Scene

# How far a body goes on below its base plane [m], so that no gap opens under it on a rough seabed.
FOOT = 0.1

# Corners of the section run counter-clockwise seen from -y: front foot, back foot, back top, front top; the right
# side (y < 0) has 0-3, the left side 4-7.
_FACES = np.array(
    [
        [0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6],  # right, left
        [0, 4, 5], [0, 5, 1], [1, 5, 6], [1, 6, 2],  # bottom, back
        [2, 6, 7], [2, 7, 3], [3, 7, 4], [3, 4, 0],  # top, front
    ]
)  # fmt: skip


class Shape(Protocol):
    """What a shape tells of itself: sizes and closed forms over the base plane, lines to draw it by, and triangles."""

    @property
    def width(self) -> float:
        """Extent along y [m]."""
        ...

    @property
    def height(self) -> float:
        """Height of the top over the base plane [m]."""
        ...

    @property
    def depth(self) -> float:
        """Extent along x over the base plane [m]."""
        ...

    @property
    def front_slope_deg(self) -> float | None:
        """Angle of the front against the horizontal [degrees]; None where the front of the central section is no
        straight line."""
        ...

    @property
    def sectional_area(self) -> float:
        """Area of the central section over the base plane [m2]."""
        ...

    @property
    def volume(self) -> float:
        """Volume over the base plane [m3]."""
        ...

    def outline(self) -> np.ndarray:
        """Corners of the central section, front foot to back foot: x from the front's foot and z [m], shape
        [corner, 2]."""
        ...

    def edges(self) -> list[np.ndarray]:
        """Lines to draw the shape by, in the frame of :meth:`scene` [m], shape [corner, 3] each."""
        ...

    def scene(self, impedance: float) -> Scene:
        """Closed triangles with normals outwards, the front foot at x = 0, centred on y = 0, the base plane at z = 0;
        ``impedance`` of every face [rayl]."""
        ...


@dataclass(frozen=True, kw_only=True)
class Wedge:
    """A section extruded along y: a front that slopes up from its foot, a level top, a vertical back.

    Raises:
        ValueError: a size that is not positive, a slope outside (0, 90] degrees, or a slope that needs the whole depth
            before it reaches the top.
    """

    width: float
    """Extent along y [m]."""

    height: float
    """Height of the top over the base plane [m]."""

    depth: float
    """Extent along x at the base plane [m]."""

    front_slope_deg: float
    """Angle of the front against the horizontal [degrees]; at 90 the wedge is a box."""

    def __post_init__(self) -> None:
        check_positive("width", self.width)
        check_positive("height", self.height)
        check_positive("depth", self.depth)
        if not 0.0 < self.front_slope_deg <= 90.0:
            raise ValueError(f"front_slope_deg: {self.front_slope_deg}, must be over 0 and at most 90")
        run = self.height * self._run_per_height
        if run >= self.depth:
            raise ValueError(
                f"depth: {self.depth} m, must be over the {run:.3f} m that the front needs to reach the top"
            )

    @property
    def _run_per_height(self) -> float:
        # The cotangent, exactly 0 at 90 degrees.
        return math.tan(math.radians(90.0 - self.front_slope_deg))

    @property
    def sectional_area(self) -> float:
        """Area of the section over the base plane [m2]: the box less the triangle before the slope (Table 2)."""
        return self.height * (self.depth - 0.5 * self.height * self._run_per_height)

    @property
    def volume(self) -> float:
        """Volume over the base plane [m3] (Table 2)."""
        return self.sectional_area * self.width

    def outline(self) -> np.ndarray:
        """Corners of the section, front foot to back foot: x from the front's foot and z [m], shape [4, 2]."""
        run = self.height * self._run_per_height
        return np.array([[0.0, 0.0], [run, self.height], [self.depth, self.height], [self.depth, 0.0]])

    def edges(self) -> list[np.ndarray]:
        """The twelve edges, in the frame of :meth:`scene` [m], shape [corner, 3] each: both sides, and between them."""
        right, left = (np.insert(self.outline(), 1, y, axis=1) for y in (-0.5 * self.width, 0.5 * self.width))
        across = [np.stack(corners) for corners in zip(right, left, strict=True)]
        return [*(np.concatenate([side, side[:1]]) for side in (right, left)), *across]

    def scene(self, impedance: float) -> Scene:
        """Closed triangles with normals outwards, the front foot at x = 0, centred on y = 0, the base plane at z = 0.

        The body goes on by :data:`FOOT` below the base plane, and the front with it in the same plane: where a rough
        seabed dips or rises at the foot, the line of contact moves along the true front and shows no second slope.

        Args:
            impedance: acoustic impedance of every face [rayl].
        """
        front, back = FOOT * self._run_per_height, self.depth
        x = np.array([-front, back, back, self.height * self._run_per_height])
        z = np.array([-FOOT, -FOOT, self.height, self.height])
        right = np.stack([x, np.full(4, -0.5 * self.width), z], axis=1)
        return Scene(
            vertices=np.concatenate([right, right * [1.0, -1.0, 1.0]]),
            faces=_FACES,
            impedance=np.full(len(_FACES), impedance),
        )


@dataclass(frozen=True, kw_only=True)
class PlacedObject:
    """A shape on the seabed: what a reconstruction is compared with.

    Raises:
        ValueError: a position that is not finite.
    """

    name: str
    """Name in results."""

    shape: Shape
    """The shape, which faces the vehicle's run (-x)."""

    front_x: float
    """World x of the front's foot at z = 0 [m]."""

    centre_y: float
    """World y of the middle of the width [m]."""

    def __post_init__(self) -> None:
        check_finite("front_x", self.front_x)
        check_finite("centre_y", self.centre_y)

    @property
    def back_x(self) -> float:
        """World x of the back [m]."""
        return self.front_x + self.shape.depth

    def scene(self, impedance: float) -> Scene:
        """The shape's triangles in the world frame; ``impedance`` of every face [rayl]."""
        return self.shape.scene(impedance).moved((self.front_x, self.centre_y, 0.0))


def _half_metre_wedge(front_slope_deg: float, depth: float) -> Wedge:
    return Wedge(width=0.5, height=1.0, depth=depth, front_slope_deg=front_slope_deg)


TABLE_1 = (
    _half_metre_wedge(90.0, 1.6),
    _half_metre_wedge(80.0, 1.6),
    _half_metre_wedge(60.0, 1.6),
    _half_metre_wedge(45.0, 2.0),
    _half_metre_wedge(30.0, 3.0),
    _half_metre_wedge(20.0, 3.0),
)
"""Objects 1-6 of the paper's Table 1, for the series over the front slope."""

TABLE_2 = tuple(_half_metre_wedge(slope, 3.0) for slope in (30.0, 45.0, 60.0, 90.0))
"""Objects 1-4 of the paper's Table 2, deployed in pairs."""

BRICK = Wedge(width=0.19, height=0.39, depth=0.15, front_slope_deg=90.0)
"""The concrete brick of the field test (paper, section 3.3)."""
