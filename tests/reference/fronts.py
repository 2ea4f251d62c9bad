"""Faces under contacts, in float64: one footprint and column at a time, from world positions and weighted lines."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.reference.free_depth import known_mean


@dataclass(frozen=True)
class Box:
    """One trajectory's cells, its own box only: free depths [x, y, z] and tops [x, y], NaN where there is none."""

    origin: np.ndarray
    cell: float
    free_depth: np.ndarray
    top: np.ndarray

    def depth(self, point: np.ndarray, reach: float) -> float:
        place = (point - self.origin) / self.cell - 0.5
        return float(known_mean(self.free_depth, place[None], reach)[0])

    def height(self, point: np.ndarray) -> float:
        """Of the contacts over a point, minus infinity without one [m]."""
        x, y = np.floor((point - self.origin)[:2] / self.cell).astype(int)
        inside = 0 <= x < self.top.shape[0] and 0 <= y < self.top.shape[1]
        height = self.top[x, y] + self.origin[2] if inside else np.nan
        return -np.inf if np.isnan(height) else float(height)


def is_face(model: Any, footprint: np.ndarray) -> bool:
    """A footprint's 10 % to 90 % is 0.8 of an even spread."""
    near, centre, far = footprint
    return near >= 0.0 and (far - near) / 0.8 < model.compact * 2 * model.half_width * centre


def on_sheet(position: np.ndarray, orientation: np.ndarray, distance: float, angle: float) -> np.ndarray:
    return position + distance * (np.cos(angle) * orientation[:, 0] + np.sin(angle) * orientation[:, 2])


def fit(height: np.ndarray, along: np.ndarray, weight: np.ndarray) -> tuple[float, float]:
    """Position at no height, and run over height, of the line through weighted points.

    Least squares with one equation more, that the line stands upright, as heavy as a point 2 cm off the mean height.
    """
    mean = np.average(height, weights=weight)
    root = np.sqrt(weight)
    equations = np.column_stack([np.append(root, 0.0), np.append(root * (height - mean), 0.02)])
    (position, run), *_ = np.linalg.lstsq(equations, np.append(root * along, 0.0), rcond=None)
    return position - run * mean, run


def ceiling(model: Any, box: Box, point: np.ndarray, ahead: np.ndarray) -> float:
    """Highest contact up to ``behind`` along the way; up to a metre where it is 1.2 times as high as it is far.

    The highest further than ``before`` is what counts where it is lower by less than ``edge_height``.
    """
    away = np.arange(np.ceil((model.before + 1.0) / box.cell) + 1) * box.cell - model.before
    heights = [box.height(point + step * ahead) for step in away]
    near = [(h, s) for h, s in zip(heights, away, strict=True) if s <= model.behind or h - point[2] > 1.2 * s]
    highest = max(h for h, _ in near)
    behind = max((h for h, s in near if s > model.before), default=-np.inf)
    return behind if np.isfinite(behind) and highest - behind < model.edge_height else highest


def before(model: Any, box: Box, foot: np.ndarray, ahead: np.ndarray) -> float:
    """Highest contact before a face's foot, further off than its upper edge's may be, minus infinity without one."""
    steps = np.arange(1, np.ceil((model.behind - model.before) / box.cell) + 1) * box.cell
    return max((box.height(foot - (2 * model.before + step) * ahead) for step in steps), default=-np.inf)


def vertical(ray: np.ndarray) -> np.ndarray:
    """Unit vector across a ray, upwards in its vertical plane."""
    level = np.hypot(ray[0], ray[1])
    return np.array([-ray[0] * ray[2] / level, -ray[1] * ray[2] / level, level]) / np.linalg.norm(ray)


def middle(model: Any, head: np.ndarray, point: np.ndarray, ground: float, top: float) -> tuple[np.ndarray, float]:
    """Middle of what the beam about ``point`` sees of a face between ``ground`` and ``top``, at the same range.

    And the share of the beam that does. The beam's width stands across its ray, in the vertical plane.
    """
    up = vertical(point - head)
    half = model.half_width * np.linalg.norm(point - head) * up[2]
    low, high = max(point[2] - half, ground), min(point[2] + half, top)
    if high <= low:
        return point, 0.0
    return point + up * (0.5 * (low + high) - point[2]) / up[2], (high - low) / (2 * half)


def covered(model: Any, box: Box, position: np.ndarray, point: np.ndarray) -> bool:
    """Whether contacts stand over a ray, looked at every 5 cm from 15 cm to two metres before its end."""
    back = (position - point) / np.linalg.norm(position - point)
    places = point + 0.05 * np.arange(3, 40)[:, None] * back
    return any(place[2] < box.height(place) - model.clearance for place in places)


def hidden(model: Any, box: Box, ping: tuple, which: int, angle: float) -> bool:
    """Whether something nearer that the same ping saw may be solid at the same angle."""
    position, orientation, footprints, _ = ping
    places = [on_sheet(position, orientation, nearer[1], angle) for nearer in footprints[:which]]
    return any(box.depth(place, model.reach) <= model.in_doubt for place in places)


def asked(model: Any, box: Box, pings: list, columns: int) -> np.ndarray:
    """Cells around the places on sheets, half a strip apart, over the beam's width where it is a face; [x, y, z]."""
    out = np.zeros(box.free_depth.shape, dtype=bool)
    for position, orientation, footprints, seabed in pings:
        for footprint in footprints:
            angles = np.arange(-(columns - 1), columns) * model.spacing / 2 / footprint[1]
            for angle in angles[np.abs(angles) <= model.half_fan]:
                point = on_sheet(position, orientation, footprint[1], angle)
                wide = is_face(model, footprint) and point[2] >= seabed + model.least_height
                count = int(np.ceil(model.half_width * footprint[1] / box.cell)) if wide else 0
                up = vertical(point - position)
                for step in range(-count, count + 1):
                    lowest = np.floor((point + step * box.cell * up - box.origin) / box.cell - 0.5).astype(int)
                    near = tuple(slice(max(i, 0), max(i + 2, 0)) for i in lowest)
                    out[near] = True
    return out


def patch(model: Any, box: Box, pings: list, ping: int, which: int, angle: float) -> dict[str, Any] | None:
    """The patch of one footprint at one angle across the fan, None where there is none.

    ``pings``: (position, orientation, footprints, height of the seabed) of all of the trajectory's pings.
    """
    position, orientation, footprints, seabed = pings[ping]
    footprint = footprints[which]
    if not is_face(model, footprint) or abs(angle) > model.half_fan:
        return None
    point = on_sheet(position, orientation, footprint[1], angle)
    ahead = orientation[:, 0] * [1, 1, 0] / np.linalg.norm(orientation[:2, 0])
    top = ceiling(model, box, point, ahead)
    half = model.half_width * footprint[1]
    if point[2] - half > top or point[2] < seabed + model.least_height:
        return None
    axis, (point, _) = point, middle(model, position, point, seabed, top)
    if box.depth(point, model.reach) > model.in_doubt:
        return None
    if covered(model, box, position, point) or hidden(model, box, pings[ping], which, angle):
        return None
    members = []
    for number, (other_position, other_orientation, others, _) in enumerate(pings):
        aside = (point - other_position) @ other_orientation[:, 2]
        for order, other in enumerate(others):
            if is_face(model, other) and abs(aside) < other[1] * np.sin(model.half_fan):
                turn = np.arcsin(aside / other[1])
                seen = on_sheet(other_position, other_orientation, other[1], turn)
                seen, share = middle(model, other_position, seen, seabed, top)
                along, height = (seen - point) @ ahead, (seen - point)[2]
                near = abs(along) < model.window_along and abs(height) < model.window_height
                high = seen[2] > seabed + model.least_height / 2
                solid = box.depth(seen, model.reach) < model.in_doubt
                if near and high and solid and share > 0 and not hidden(model, box, pings[number], order, turn):
                    members.append((height, along, share))
    if len(members) < 2:
        return None
    height, along, share = np.array(members).T
    closeness = share * np.exp(-0.5 * (height / (0.6 * model.window_height)) ** 2)
    weight, place, run = closeness, 0.0, 0.0
    for number in range(4):
        residual = (along - place - run * height) / model.deviation
        weight = closeness / (1.0 + residual**2) if number else closeness
        place, run = fit(height, along, weight)
    mean = np.average(height, weights=weight)
    narrow = np.average((height - mean) ** 2, weights=weight) < model.least_spread**2
    if abs(place) > 2 * model.deviation or not model.least_run <= run <= model.most_run or narrow:
        return None
    variance = np.average(residual**2, weights=weight)
    low, high = max(axis[2] - half, seabed + model.least_height / 2), min(axis[2] + half, top)
    foot = point + (place + (low - point[2]) * run) * ahead
    inside = before(model, box, foot, ahead) - model.clearance
    if high - inside < model.clearance + model.spacing:
        return None
    low = max(low, inside)
    return {
        "point": point + place * ahead,
        "run": run * ahead + [0, 0, 1],
        "low": low - point[2],
        "high": high - point[2],
        "deviation": model.deviation * np.sqrt(max(variance, 0.01)),
    }
