"""Walls on a flat seabed as both sonars know them, in closed form: footprints, contacts, and what is proven empty."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp
from scipy import ndimage

from sonarwarp_kernels import fronts, tops
from sonarwarp_kernels.specs import Grid
from tests.arc_world import struct
from tests.reference.geometry import quaternion, rotation, sonar_rotation

HALF_WIDTH, HALF_FAN = np.radians(0.9), np.radians(10.0)
MODEL = {
    "half_width": HALF_WIDTH,
    "half_fan": HALF_FAN,
    "compact": 0.9,
    "spacing": 0.02,
    "reach": 0.1,
    "least_height": 0.06,
    "in_doubt": 0.02,
    "before": 0.06,
    "behind": 0.15,
    "edge_height": 0.0,
    "window_along": 0.12,
    "window_height": 0.25,
    "deviation": 0.015,
    "most_run": 1.2,
    "least_run": -1.0,
    "least_spread": 0.0,
    "clearance": 0.04,
}
CELL = 0.02
COLUMNS = 71
"""Strips enough for the whole fan at 4 m."""
NO_TOP = int(tops.NO_TOP)
STEPS = float(tops.TOP_STEPS)
UNUSED = (float(fronts.NO_FOOTPRINT),) * 3


@dataclass(frozen=True)
class Wall:
    """A face across the x axis that leans back from its foot, and the flat top behind its edge."""

    slope_deg: float = 90.0
    foot: float = 4.0
    height: float = 0.8
    right: float = -0.25
    left: float = 0.25

    @property
    def run(self) -> float:
        """Way back per height."""
        return float(1.0 / np.tan(np.radians(self.slope_deg)))

    def before(self, points: np.ndarray) -> np.ndarray:
        """Horizontal distance from points to the face's plane, positive in the water [m]."""
        return self.foot + points[..., 2] * self.run - points[..., 0]

    def spans(self, points: np.ndarray) -> np.ndarray:
        return (points[..., 1] > self.right) & (points[..., 1] < self.left)

    def ranges(self, position: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """Distances at which ``rays`` from ``position`` meet the face, infinite where they miss, shape [ray]."""
        distance = self.before(position) / (rays[:, 0] - rays[:, 2] * self.run)
        hit = position + distance[:, None] * rays
        met = (distance > 0) & (hit[:, 2] >= 0) & (hit[:, 2] <= self.height) & self.spans(hit)
        return np.where(met, distance, np.inf)

    def contacts(self, lowest: float) -> np.ndarray:
        """Points 1 cm apart on the face from ``lowest`` up and on the top's first 6 cm, shape [point, 3]."""
        height = np.arange(lowest, self.height + 1e-9, 0.01)
        edge = self.foot + self.height * self.run
        face = np.column_stack([self.foot + height * self.run, height])
        top = np.column_stack([edge + np.arange(0.005, 0.06, 0.01), np.full(6, self.height)])
        side = np.arange(self.right + 0.005, self.left, 0.01)
        return np.array([[x, y, z] for x, z in np.concatenate([face, top]) for y in side])


@dataclass(frozen=True)
class Ping:
    """A head and what it saw."""

    position: np.ndarray
    orientation: np.ndarray
    footprints: list
    seabed: float = 0.0


def look(walls: tuple, position: Any, aim: Any, roll: float = np.pi / 2) -> Ping:
    """A head, laid on its side, that looks at ``aim``, with the footprint of every wall that its beam meets."""
    position, away = np.asarray(position, dtype=float), np.subtract(aim, position)
    turn = np.arctan2(away[1], away[0]), np.arctan2(-away[2], np.hypot(away[0], away[1]))
    orientation = sonar_rotation(roll, turn[1], turn[0])
    plane, across = np.meshgrid(np.linspace(-HALF_WIDTH, HALF_WIDTH, 41), np.linspace(-HALF_FAN, HALF_FAN, 201))
    # Eq. 34: R_y(phi) R_z(theta) of the forward axis.
    own = np.stack([np.cos(across) * np.cos(plane), np.sin(plane), -np.sin(across) * np.cos(plane)], axis=-1)
    rays = own.reshape(-1, 3) @ orientation.T
    seen = [wall.ranges(position, rays) for wall in walls]
    met = [distance[np.isfinite(distance)] for distance in seen]
    footprints = [(np.quantile(d, 0.1), d.mean(), np.quantile(d, 0.9)) for d in met if len(d)]
    return Ping(position, orientation, sorted(footprints))


@dataclass(frozen=True)
class Scene:
    """Pings and what the imaging sonar says: the kernels' input."""

    pings: list
    origin: np.ndarray
    free_depth: np.ndarray  # [x, y, z]
    top: np.ndarray  # [x, y] as raise_tops counts


@dataclass(frozen=True)
class WallWorld:
    """Walls and pings at them, all turned about z by ``heading`` [rad]."""

    walls: tuple
    pings: list
    lowest_contact: float = 0.8
    heading: float = 0.0
    size: tuple = (90, 90, 45)

    @classmethod
    def passing(cls, *walls: Wall, roll: float = np.pi / 2, side: float = 0.0, **changed: Any) -> "WallWorld":
        """A vehicle comes nearer, from 4 m to 2.5 m off the first wall, its head nodding over the wall's height."""
        pings = []
        for distance, share in zip(np.linspace(4.0, 2.5, 16), np.tile([0.1, 0.7, 0.3, 0.9, 0.5], 4), strict=False):
            wall = walls[0]
            height = share * wall.height
            head = wall.foot - distance, side, 1.8
            pings.append(look(walls, head, (wall.foot + height * wall.run, side, height), roll))
        return cls(walls, pings, **changed)

    @property
    def turn(self) -> np.ndarray:
        return rotation("z", self.heading)

    def scene(self) -> Scene:
        middle = self.turn @ [self.walls[0].foot + 0.2, 0.0, 0.0]
        origin = middle - [CELL * self.size[0] / 2, CELL * self.size[1] / 2, 0.0]
        index = np.stack(np.meshgrid(*map(np.arange, self.size), indexing="ij"), axis=-1)
        centre = (origin + CELL * (index + 0.5)) @ self.turn
        # Between the walls the water is open.
        depth = np.full(self.size, MODEL["reach"])
        for wall in self.walls:
            depth = np.where(wall.spans(centre), np.clip(wall.before(centre), -MODEL["reach"], MODEL["reach"]), depth)
        points = np.concatenate([wall.contacts(self.lowest_contact) for wall in self.walls]) @ self.turn.T - origin
        cell = np.floor(points[:, :2] / CELL).astype(int)
        top = np.full(self.size[:2], NO_TOP)
        np.maximum.at(top, tuple(cell.T), np.round(points[:, 2] * STEPS).astype(int))
        turned = [
            replace(p, position=self.turn @ p.position, orientation=self.turn @ p.orientation) for p in self.pings
        ]
        return Scene(turned, origin, depth, top)


def random_scene(seed: int, number: int = 24) -> Scene:
    """Heads at any attitude around a box, returns near any place in it, and an imaging sonar that says anything."""
    rng = np.random.default_rng(seed)
    origin, size = np.array([3.6, -0.4, 0.0]), (40, 36, 20)
    pings = []
    for _ in range(number):
        aim = origin + CELL * np.array(size) * rng.uniform(0.1, 0.9, 3)
        turn, away = rng.uniform(-np.pi, np.pi), rng.uniform(1.5, 3.0)
        head = aim + np.array([away * np.cos(turn), away * np.sin(turn), rng.uniform(0.3, 1.5)])
        ping = look((), head, aim, roll=rng.uniform(-np.pi, np.pi))
        middle = np.sort(np.linalg.norm(aim - head) + rng.uniform(-0.2, 0.2, rng.integers(1, 4)))
        half = rng.uniform(0.0, 0.45, len(middle)) * 2 * HALF_WIDTH * middle
        footprints = list(zip(middle - half, middle, middle + half, strict=True))
        pings.append(replace(ping, footprints=footprints, seabed=rng.uniform(-0.2, 0.1)))
    depth = ndimage.gaussian_filter(rng.normal(size=size), 2.0, mode="nearest")
    top = np.where(rng.uniform(size=size[:2]) < 0.6, NO_TOP, rng.integers(0, 400, size[:2]))
    return Scene(pings, origin, np.clip(depth, -MODEL["reach"], MODEL["reach"]), top)


def front_model(**changed: float) -> Any:
    return struct(fronts.FrontModel, **{**MODEL, **changed})


def make_grid(device: str, scenes: list) -> Grid:
    """Boxes of all scenes in arrays that hold the largest."""
    sizes = [scene.free_depth.shape for scene in scenes]
    nx, ny, nz = np.max(sizes, axis=0).tolist()
    origin = wp.array([scene.origin for scene in scenes], dtype=wp.vec3, device=device)
    return struct(
        Grid, origin=origin, size=wp.array(sizes, dtype=wp.vec3i, device=device), cell=CELL, nx=nx, ny=ny, nz=nz
    )


def make_profiles(device: str, scenes: list, order: list, slots: int = 3) -> fronts.Profiles:
    """Pings of all scenes, in ``order``: pairs of a scene's and its ping's number."""
    pings = [scenes[scene].pings[ping] for scene, ping in order]
    owner = np.array([scene for scene, _ in order], dtype=int)
    poses = [[*p.position, *quaternion(p.orientation)] for p in pings]
    footprints = [[*p.footprints, *[UNUSED] * (slots - len(p.footprints))] for p in pings]
    return struct(
        fronts.Profiles,
        trajectory=wp.array(owner, dtype=int, device=device),
        world_from_head=wp.array(np.reshape(poses, (-1, 7)), dtype=wp.transform, device=device),
        footprint=wp.array(np.reshape(footprints, (-1, slots, 3)), dtype=wp.vec3, device=device),
        seabed=wp.array([p.seabed for p in pings], dtype=float, device=device),
        order=wp.array(np.argsort(owner, kind="stable"), dtype=int, device=device),
        first=wp.array(np.searchsorted(np.sort(owner), np.arange(len(scenes) + 1)), dtype=int, device=device),
    )


def in_turn(scenes: list) -> list:
    return [(scene, ping) for scene in range(len(scenes)) for ping in range(len(scenes[scene].pings))]


def stacked(arrays: list, fill: float) -> np.ndarray:
    """Arrays of many boxes in one, the rest of it filled."""
    out = np.full((len(arrays), *np.max([a.shape for a in arrays], axis=0)), fill)
    for row, array in zip(out, arrays, strict=True):
        row[tuple(slice(n) for n in array.shape)] = array
    return out


def make_fronts(device: str, shape: tuple) -> fronts.Fronts:
    """Patches that nobody has written yet: 7 everywhere."""
    made = {name: wp.full(shape, 7, dtype=dtype, device=device) for name, dtype in fronts.FRONT_TYPES.items()}
    return struct(fronts.Fronts, **made)


def find(device: str, *scenes: Scene, order: list | None = None, threads: int = 1, columns: int = COLUMNS, **changed):
    """All patches by name, shape [ping, footprint, column, ...]; pings in ``order`` or scene by scene."""
    listed = list(scenes)
    profiles = make_profiles(device, listed, in_turn(listed) if order is None else order)
    out = make_fronts(device, (*profiles.footprint.shape, columns))
    # What lies in the arrays but not in a trajectory's box must not matter: solid, under contacts.
    free_depth = wp.array(stacked([s.free_depth for s in listed], -1.0), dtype=float, device=device)
    top = wp.array(stacked([s.top for s in listed], 9000), dtype=int, device=device)
    fronts.find_fronts(
        make_grid(device, listed),
        front_model(**changed),
        profiles,
        free_depth,
        top,
        out,
        device=device,
        threads=threads,
    )
    return {name: getattr(out, name).numpy() for name in fronts.FRONT_TYPES}
