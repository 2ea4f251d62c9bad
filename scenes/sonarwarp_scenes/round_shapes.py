"""Round objects on the seabed, with their closed forms: cylinders, cones and spheres.

Areas and volumes are those under the upper surface, down to the base plane. Where the lower half overhangs, as on a
sphere that rests on the seabed, no sonar above sees under it, and what is there counts as solid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sonarwarp_scenes import solids
from sonarwarp_scenes.checks import check_finite, check_positive
from sonarwarp_scenes.polygons import triangulate
from sonarwarp_scenes.scene import Scene
from sonarwarp_scenes.shapes import FOOT

SEGMENTS = 128
"""Sides to a turn. The polygon in a circle is 0.04 % smaller than it."""


@dataclass(frozen=True, kw_only=True)
class Frustum:
    """A cone cut level, standing: a cylinder where both radii are equal, a whole cone where the upper one is 0.

    Raises:
        ValueError: a radius or height that is not positive (the upper radius may be 0), or an upper radius over the
            lower one.
    """

    base_radius: float
    """Radius at the base plane [m]."""

    top_radius: float
    """Radius at the top [m]."""

    height: float
    """Height of the top over the base plane [m]."""

    def __post_init__(self) -> None:
        check_positive("base_radius", self.base_radius)
        check_positive("height", self.height)
        if not 0.0 <= self.top_radius <= self.base_radius:
            raise ValueError(f"top_radius: {self.top_radius} m, must be in 0 to base_radius, {self.base_radius} m")

    @property
    def width(self) -> float:
        """Extent along y [m]."""
        return 2.0 * self.base_radius

    @property
    def depth(self) -> float:
        """Extent along x at the base plane [m]."""
        return 2.0 * self.base_radius

    @property
    def front_slope_deg(self) -> float:
        """Angle of the side against the horizontal [degrees], which is the front's in the central section."""
        return math.degrees(math.atan2(self.height, self.base_radius - self.top_radius))

    @property
    def sectional_area(self) -> float:
        """Area of the central section, a trapezoid [m2]."""
        return self.height * (self.base_radius + self.top_radius)

    @property
    def volume(self) -> float:
        """Volume over the base plane [m3]."""
        lower, upper = self.base_radius, self.top_radius
        return math.pi / 3.0 * self.height * (lower * lower + lower * upper + upper * upper)

    def outline(self) -> np.ndarray:
        """Corners of the central section, front foot to back foot: x from the front's foot and z [m], shape [4, 2]."""
        run = self.base_radius - self.top_radius
        return np.array([[0.0, 0.0], [run, self.height], [self.depth - run, self.height], [self.depth, 0.0]])

    def edges(self) -> list[np.ndarray]:
        """Lines to draw it by, in the frame of :meth:`scene` [m], shape [corner, 3] each: both rims and the section."""
        rims = [(self.base_radius, 0.0), (self.top_radius, self.height)]
        return [*(_ring(self.base_radius, radius, z) for radius, z in rims), _in_section(self.outline())]

    def scene(self, impedance: float) -> Scene:
        """Closed triangles with normals outwards, the front foot at x = 0, centred on y = 0, the base plane at z = 0.

        The body goes on by ``FOOT`` below the base plane, and its side with it at the same slope.

        Args:
            impedance: acoustic impedance of every face [rayl].
        """
        below = self.base_radius + FOOT * (self.base_radius - self.top_radius) / self.height
        body = solids.cylinder(self.height + FOOT, below, self.top_radius, "Z", SEGMENTS)
        return _scene(body, (self.base_radius, 0.0, 0.5 * (self.height - FOOT)), impedance)


@dataclass(frozen=True, kw_only=True)
class _Circular:
    """What has a circle for its central section, buried in part or resting on the seabed."""

    radius: float
    """Radius [m]."""

    centre_height: float
    """Height of the circle's centre over the base plane [m]: 0 buries half of it, ``radius`` rests it."""

    def __post_init__(self) -> None:
        check_positive("radius", self.radius)
        check_finite("centre_height", self.centre_height)
        if not -self.radius < self.centre_height <= self.radius:
            bounds = f"must be over {-self.radius} m and at most {self.radius} m"
            raise ValueError(f"centre_height: {self.centre_height} m, {bounds}")

    @property
    def height(self) -> float:
        """Height of the top over the base plane [m]."""
        return self.radius + self.centre_height

    @property
    def depth(self) -> float:
        """Extent along x over the base plane [m]: the circle's widest part there."""
        return 2.0 * math.sqrt(self.radius * self.radius - self._under * self._under)

    @property
    def front_slope_deg(self) -> None:
        """None: the front is no plane."""
        return None

    @property
    def sectional_area(self) -> float:
        """Area of the central section under its upper arc [m2]: a segment of the circle, or half on a rectangle."""
        segment = self.radius * self.radius * math.acos(-self._under / self.radius) + 0.5 * self.depth * self._under
        return segment + self.depth * max(self.centre_height, 0.0)

    def outline(self) -> np.ndarray:
        """Corners of the central section, front to back: x from the foremost place and z [m], shape [corner, 2].

        The upper arc, from a foot to a foot where it does not end there.
        """
        half = 0.5 * self.depth
        last = math.acos(-self._under / self.radius)
        angle = np.linspace(-last, last, SEGMENTS // 2 + 1)
        arc = np.column_stack([half + self.radius * np.sin(angle), self.centre_height + self.radius * np.cos(angle)])
        return np.concatenate([[[0.0, 0.0]], arc, [[self.depth, 0.0]]])

    @property
    def _under(self) -> float:
        """Height of a buried centre, 0 for one over the base plane [m]."""
        return min(self.centre_height, 0.0)


@dataclass(frozen=True, kw_only=True)
class Sphere(_Circular):
    """A sphere buried in part, or resting on the seabed.

    Raises:
        ValueError: a radius that is not positive, or a centre at or under ``-radius`` or over ``radius``.
    """

    @property
    def width(self) -> float:
        """Extent along y over the base plane [m]."""
        return self.depth

    @property
    def volume(self) -> float:
        """Volume under the upper surface [m3]: a cap, or half the sphere on a cylinder."""
        over = max(self.centre_height, 0.0)
        cap = self.height - over
        return math.pi * (cap * cap * (self.radius - cap / 3.0) + self.radius * self.radius * over)

    def edges(self) -> list[np.ndarray]:
        """Lines to draw it by, in the frame of :meth:`scene` [m], shape [corner, 3] each: widest ring and meridians."""
        half, arc = 0.5 * self.depth, self.outline()
        across = np.column_stack([np.full(len(arc), half), arc[:, 0] - half, arc[:, 1]])
        return [_ring(half, half, max(self.centre_height, 0.0)), _in_section(arc), across]

    def scene(self, impedance: float) -> Scene:
        """Closed triangles with normals outwards, foremost over the base plane at x = 0, centred on y = 0.

        Args:
            impedance: acoustic impedance of every face [rayl].
        """
        centre = (0.5 * self.depth, 0.0, self.centre_height)
        return _scene(solids.sphere(self.radius, SEGMENTS), centre, impedance)


@dataclass(frozen=True, kw_only=True)
class LyingCylinder(_Circular):
    """A cylinder that lies across the run, its axis along y, buried in part or resting on the seabed.

    Raises:
        ValueError: a radius or length that is not positive, or a centre at or under ``-radius`` or over ``radius``.
    """

    length: float
    """Extent along y [m]."""

    def __post_init__(self) -> None:
        check_positive("length", self.length)
        super().__post_init__()

    @property
    def width(self) -> float:
        """Extent along y [m]."""
        return self.length

    @property
    def volume(self) -> float:
        """Volume under the upper surface [m3]."""
        return self.sectional_area * self.length

    def edges(self) -> list[np.ndarray]:
        """Lines to draw it by, in the frame of :meth:`scene` [m], shape [corner, 3] each: both ends and the ridge."""
        half = 0.5 * self.length
        ridge = np.array([[0.5 * self.depth, y, self.height] for y in (-half, half)])
        return [*(_in_section(self.outline(), y) for y in (-half, half)), ridge]

    def scene(self, impedance: float) -> Scene:
        """Closed triangles with normals outwards, foremost over the base plane at x = 0, centred on y = 0.

        Args:
            impedance: acoustic impedance of every face [rayl].
        """
        body = solids.cylinder(self.length, self.radius, self.radius, "Y", SEGMENTS)
        return _scene(body, (0.5 * self.depth, 0.0, self.centre_height), impedance)


def _in_section(outline: np.ndarray, y: float = 0.0) -> np.ndarray:
    return np.insert(outline, 1, y, axis=1)


def _ring(middle: float, radius: float, z: float) -> np.ndarray:
    """A level circle around x = ``middle``, closed, shape [corner, 3]."""
    angle = np.linspace(0.0, 2.0 * np.pi, SEGMENTS + 1)
    return np.column_stack([middle + radius * np.cos(angle), radius * np.sin(angle), np.full(len(angle), z)])


def _scene(body: solids.Polygons, centre: tuple[float, float, float], impedance: float) -> Scene:
    faces = triangulate(*body).triangles
    return Scene(vertices=body.points, faces=faces, impedance=np.full(len(faces), impedance)).moved(centre)
