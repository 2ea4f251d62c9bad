"""Where a vehicle is at what time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sonarwarp_scenes.checks import check_finite, check_positive, check_reach, check_shape, read_only

# Recorded attitudes come with few digits: within this of unit length they are normalised, beyond it refused.
_UNIT_TOLERANCE = 1.0e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """Poses over time. Arrays are copied on the way in and read-only afterwards.

    Raises:
        ValueError: an empty array, another shape, a value that is not finite, times that do not increase, a position
            beyond 10 km of the origin, or a quaternion whose length differs from 1 by more than 0.001.
    """

    times: np.ndarray
    """Times of the poses [s], strictly increasing, float64, shape [pose]."""

    poses: np.ndarray
    """world_from_vehicle, float64, shape [pose, 7]: position x, y, z [m], then the unit quaternion x, y, z, w. The
    world has z up, the vehicle x forward, y left, z up. Quaternions are stored normalised."""

    def __post_init__(self) -> None:
        times = read_only("times", self.times, (None,))
        late = np.flatnonzero(np.diff(times) <= 0.0)
        if late.size:
            pose = int(late[0]) + 1
            raise ValueError(
                f"times: {times[pose]} s at pose {pose}, must be after {times[pose - 1]} s of the one before"
            )
        poses = read_only("poses", self.poses, (len(times), 7)).copy()
        check_reach("poses", poses[:, :3])
        lengths = np.linalg.norm(poses[:, 3:], axis=1)
        wrong = np.flatnonzero(np.abs(lengths - 1.0) > _UNIT_TOLERANCE)
        if wrong.size:
            raise ValueError(
                f"poses: quaternion of length {lengths[wrong[0]]:.6g} at pose {wrong[0]}, "
                f"must be within {_UNIT_TOLERANCE:g} of 1"
            )
        poses[:, 3:] /= lengths[:, None]
        poses.setflags(write=False)
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "poses", poses)

    def at(self, times: np.ndarray) -> np.ndarray:
        """Poses in between: linear in position, the shorter great arc (slerp) in attitude.

        Args:
            times: times wanted [s], in any order, shape [n].

        Returns:
            world_from_vehicle as in :attr:`poses`, shape [n, 7].

        Raises:
            ValueError: a time outside the trajectory.
        """
        times = np.asarray(times, dtype=np.float64)
        check_shape("times", times, (None,))
        start, end = self.times[0], self.times[-1]
        outside = np.flatnonzero(~((times >= start) & (times <= end)))
        if outside.size:
            raise ValueError(f"times: {times[outside[0]]} s at [{outside[0]}], must be within {start} to {end} s")
        last = len(self.times) - 1
        before = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, max(last - 1, 0))
        after = np.minimum(before + 1, last)
        # A trajectory of one pose has no step: the fraction is 0 then.
        step = np.where(after > before, self.times[after] - self.times[before], 1.0)
        fraction = ((times - self.times[before]) / step)[:, None]
        a, b = self.poses[before], self.poses[after]
        positions = (1.0 - fraction) * a[:, :3] + fraction * b[:, :3]
        return np.concatenate([positions, _slerp(a[:, 3:], b[:, 3:], fraction)], axis=1)


def _slerp(a: np.ndarray, b: np.ndarray, fraction: np.ndarray) -> np.ndarray:
    """Unit quaternions [n, 4] at ``fraction`` [n, 1] of the shorter arc from ``a`` to ``b``."""
    # A quaternion and its negative are one attitude: take the nearer.
    b = np.where(np.sum(a * b, axis=1, keepdims=True) < 0.0, -b, b)
    angle = 2.0 * np.arctan2(np.linalg.norm(b - a, axis=1), np.linalg.norm(b + a, axis=1))[:, None] / math.pi
    # sin(f angle) / sin(angle) by numpy's sinc, which has no trouble at angle 0.
    weight_a = (1.0 - fraction) * np.sinc((1.0 - fraction) * angle)
    weight_b = fraction * np.sinc(fraction * angle)
    mixed = weight_a * a + weight_b * b
    return mixed / np.linalg.norm(mixed, axis=1, keepdims=True)


def straight_trajectory(
    start: np.ndarray | tuple[float, float, float], *, heading: float, speed: float, length: float
) -> Trajectory:
    """A level line at constant speed and depth, from time 0.

    Args:
        start: first position [m], shape [3].
        heading: direction of travel and of the vehicle's x axis [rad], from world x towards y.
        speed: [m/s].
        length: of the line [m].

    Raises:
        ValueError: a start or heading that is not finite, a speed or length that is not positive.
    """
    check_finite("heading", heading)
    check_positive("speed", speed)
    check_positive("length", length)
    first = read_only("start", start, (3,))
    last = first + length * np.array([math.cos(heading), math.sin(heading), 0.0])
    return Trajectory(
        times=np.array([0.0, length / speed]), poses=_level_poses(np.stack([first, last]), np.full(2, heading))
    )


def waypoint_trajectory(waypoints: np.ndarray, *, speed: float, turn_rate: float = math.radians(10.0)) -> Trajectory:
    """Straight legs between waypoints at constant speed, from time 0, the vehicle level and looking along its leg.

    At a corner the vehicle turns at ``turn_rate`` the shorter way, half of it before the waypoint and half after, and
    never slows: images are taken at even spacing all along. On a vertical leg it keeps the heading it has.

    Args:
        waypoints: positions [m], shape [waypoint, 3], at least two.
        speed: along the path [m/s].
        turn_rate: rate of every turn [rad/s]. Ours: 10 degrees a second, which a hovering vehicle holds.

    Raises:
        ValueError: fewer than two waypoints, two equal ones in a row, a leg too short for the turns at its ends, or a
            speed or rate that is not positive.
    """
    check_positive("speed", speed)
    check_positive("turn_rate", turn_rate)
    points = read_only("waypoints", waypoints, (None, 3))
    if len(points) < 2:
        raise ValueError(f"waypoints: {len(points)}, must be at least 2")
    legs = np.diff(points, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    if not lengths.all():
        repeated = int(np.flatnonzero(lengths == 0.0)[0]) + 1
        raise ValueError(f"waypoints: {points[repeated].tolist()} at {repeated}, must differ from the one before")

    passed = np.concatenate([[0.0], np.cumsum(lengths / speed)])
    headings = _leg_headings(legs)
    turns = (np.diff(headings) + math.pi) % (2.0 * math.pi) - math.pi
    # Half the time that each waypoint's turn takes; there is none at the ends.
    half = np.concatenate([[0.0], np.abs(turns) / (2.0 * turn_rate), [0.0]])
    short = np.flatnonzero(np.diff(passed) < half[:-1] + half[1:])
    if short.size:
        leg = int(short[0])
        raise ValueError(
            f"waypoints: leg {leg} lasts {lengths[leg] / speed:.3g} s, must be at least the "
            f"{half[leg] + half[leg + 1]:.3g} s of the turns at its ends: lower the speed or raise turn_rate"
        )

    times = np.unique(np.concatenate([passed, passed - half, passed + half]))
    along = headings[0] + np.concatenate([[0.0], np.cumsum(turns)])
    yaw = np.interp(times, np.stack([passed[:-1] + half[:-1], passed[1:] - half[1:]], axis=1).ravel(), along.repeat(2))
    positions = np.stack([np.interp(times, passed, points[:, axis]) for axis in range(3)], axis=1)
    return Trajectory(times=times, poses=_level_poses(positions, yaw))


def _leg_headings(legs: np.ndarray) -> np.ndarray:
    """Heading of each leg [rad]; a vertical one takes the heading before it, or else the first there is."""
    level = np.flatnonzero(np.hypot(legs[:, 0], legs[:, 1]) > 0.0)
    if not level.size:
        return np.zeros(len(legs))
    latest = level[np.maximum(np.searchsorted(level, np.arange(len(legs)), side="right") - 1, 0)]
    return np.arctan2(legs[latest, 1], legs[latest, 0])


def _level_poses(positions: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """Poses [n, 7] of a level vehicle at ``positions`` [n, 3], turned by ``yaw`` [n] about z."""
    zero = np.zeros(len(yaw))
    return np.column_stack([positions, zero, zero, np.sin(0.5 * yaw), np.cos(0.5 * yaw)])
