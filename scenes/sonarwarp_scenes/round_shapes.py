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
class Sphere:
    """A sphere buried in part, or resting on the seabed.

    Raises:
        ValueError: a radius that is not positive, or a centre at or under ``-radius`` or over ``radius``.
    """

    radius: float
    """Radius [m]."""

    centre_height: float
    """Height of the centre over the base plane [m]: 0 buries the sphere to its equator, ``radius`` rests it."""

    def __post_init__(self) -> None:
        _check_circle(self.radius, self.centre_height)

    @property
    def width(self) -> float:
        """Extent along y over the base plane [m]."""
        return self.depth

    @property
    def height(self) -> float:
        """Height of the top over the base plane [m]."""
        return self.radius + self.centre_height

    @property
    def depth(self) -> float:
        """Extent along x over the base plane [m]."""
        return 2.0 * _half_chord(self.radius, self.centre_height)

    @property
    def front_slope_deg(self) -> None:
        """None: the front is no plane."""
        return None

    @property
    def sectional_area(self) -> float:
        """Area of the central section under its upper arc [m2]."""
        return _area_under_arc(self.radius, self.centre_height)

    @property
    def volume(self) -> float:
        """Volume under the upper surface [m3]: a cap, or half the sphere on a cylinder."""
        over = max(self.centre_height, 0.0)
        cap = self.height - over
        return math.pi * (cap * cap * (self.radius - cap / 3.0) + self.radius * self.radius * over)

    def outline(self) -> np.ndarray:
        """Corners of the central section, front to back: x from the foremost place and z [m], shape [corner, 2]."""
        return _arc(self.radius, self.centre_height)

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
class LyingCylinder:
    """A cylinder that lies across the run, its axis along y, buried in part or resting on the seabed.

    Raises:
        ValueError: a radius or length that is not positive, or a centre at or under ``-radius`` or over ``radius``.
    """

    radius: float
    """Radius [m]."""

    length: float
    """Extent along y [m]."""

    centre_height: float
    """Height of the axis over the base plane [m]: 0 buries half of it, ``radius`` rests it."""

    def __post_init__(self) -> None:
        check_positive("length", self.length)
        _check_circle(self.radius, self.centre_height)

    @property
    def width(self) -> float:
        """Extent along y [m]."""
        return self.length

    @property
    def height(self) -> float:
        """Height of the top over the base plane [m]."""
        return self.radius + self.centre_height

    @property
    def depth(self) -> float:
        """Extent along x over the base plane [m]."""
        return 2.0 * _half_chord(self.radius, self.centre_height)

    @property
    def front_slope_deg(self) -> None:
        """None: the front is no plane."""
        return None

    @property
    def sectional_area(self) -> float:
        """Area of the section under its upper arc [m2]."""
        return _area_under_arc(self.radius, self.centre_height)

    @property
    def volume(self) -> float:
        """Volume under the upper surface [m3]."""
        return self.sectional_area * self.length

    def outline(self) -> np.ndarray:
        """Corners of the section, front to back: x from the foremost place and z [m], shape [corner, 2]."""
        return _arc(self.radius, self.centre_height)

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


def _check_circle(radius: float, centre_height: float) -> None:
    check_positive("radius", radius)
    check_finite("centre_height", centre_height)
    if not -radius < centre_height <= radius:
        raise ValueError(f"centre_height: {centre_height} m, must be over {-radius} m and at most {radius} m")


def _half_chord(radius: float, centre_height: float) -> float:
    """Half the widest part of a circle over the base plane."""
    under = min(centre_height, 0.0)
    return math.sqrt(radius * radius - under * under)


def _area_under_arc(radius: float, centre_height: float) -> float:
    """A segment of the circle, or half of it on a rectangle."""
    under, over = min(centre_height, 0.0), max(centre_height, 0.0)
    half = _half_chord(radius, centre_height)
    return radius * radius * math.acos(-under / radius) + half * under + 2.0 * half * over


def _arc(radius: float, centre_height: float) -> np.ndarray:
    """The upper arc from the front to the back, from a foot to a foot where it does not end there."""
    half = _half_chord(radius, centre_height)
    last = math.acos(-min(centre_height, 0.0) / radius)
    angle = np.linspace(-last, last, SEGMENTS // 2 + 1)
    arc = np.column_stack([half + radius * np.sin(angle), centre_height + radius * np.cos(angle)])
    return np.concatenate([[[0.0, 0.0]], arc, [[2.0 * half, 0.0]]])


def _in_section(outline: np.ndarray, y: float = 0.0) -> np.ndarray:
    return np.insert(outline, 1, y, axis=1)


def _ring(middle: float, radius: float, z: float) -> np.ndarray:
    """A level circle around x = ``middle``, closed, shape [corner, 3]."""
    angle = np.linspace(0.0, 2.0 * np.pi, SEGMENTS + 1)
    return np.column_stack([middle + radius * np.cos(angle), radius * np.sin(angle), np.full(len(angle), z)])


def _scene(body: solids.Polygons, centre: tuple[float, float, float], impedance: float) -> Scene:
    faces = triangulate(*body).triangles
    return Scene(vertices=body.points, faces=faces, impedance=np.full(len(faces), impedance)).moved(centre)
