"""When and where every frame and ping of a batch of trajectories is taken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sonarwarp.checks import finite_array
from sonarwarp.poses import compose
from sonarwarp.sonar import Rig
from sonarwarp_scenes import Trajectory


@dataclass(frozen=True, kw_only=True, eq=False)
class Frames:
    """The imaging sonar's frames, a flat list over all trajectories, in order of time within each."""

    time: np.ndarray
    """[s], shape [frame]."""
    trajectory: np.ndarray
    """Index of the trajectory, shape [frame]."""
    number: np.ndarray
    """Number within the trajectory, shape [frame]."""
    pose: np.ndarray
    """world_from_sensor, shape [frame, 7]."""
    altitude: np.ndarray
    """Height of the sonar above the seabed [m], shape [frame]."""

    def __post_init__(self) -> None:
        _check_instants("Frames", self.time, self.trajectory, self.number, self.pose)
        object.__setattr__(self, "altitude", finite_array("Frames.altitude", self.altitude, shape=self.time.shape))
        if len(self.altitude) and self.altitude.min() <= 0.0:
            raise ValueError(f"Frames.altitude: {self.altitude.min():g}, must be above 0")

    def __len__(self) -> int:
        return len(self.time)


@dataclass(frozen=True, kw_only=True, eq=False)
class Pings:
    """The profiling sonar's pings, a flat list over all trajectories, in order of time within each."""

    time: np.ndarray
    """[s], shape [ping]."""
    trajectory: np.ndarray
    """Index of the trajectory, shape [ping]."""
    number: np.ndarray
    """Number within the trajectory, shape [ping]."""
    pose: np.ndarray
    """world_from_mount, before the head's turn, shape [ping, 7]."""
    head_angle: np.ndarray
    """Head angle xi [rad], shape [ping]."""

    def __post_init__(self) -> None:
        _check_instants("Pings", self.time, self.trajectory, self.number, self.pose)
        object.__setattr__(self, "head_angle", finite_array("Pings.head_angle", self.head_angle, shape=self.time.shape))

    @property
    def head_pose(self) -> np.ndarray:
        """world_from_head, the head turned about its z axis, shape [ping, 7]."""
        half = 0.5 * self.head_angle
        turn = np.zeros_like(self.pose)
        turn[:, 5], turn[:, 6] = np.sin(half), np.cos(half)
        return compose(self.pose, turn)

    def __len__(self) -> int:
        return len(self.time)


def _check_instants(owner: str, time: np.ndarray, trajectory: np.ndarray, number: np.ndarray, pose: np.ndarray) -> None:
    count = len(time)
    finite_array(f"{owner}.time", time, shape=(count,))
    finite_array(f"{owner}.pose", pose, shape=(count, 7))
    for name, index in (("trajectory", trajectory), ("number", number)):
        if index.shape != (count,):
            raise ValueError(f"{owner}.{name}: expected shape ({count},), got {index.shape}")
        if count and index.min() < 0:
            raise ValueError(f"{owner}.{name}: {index.min()}, must be at least 0")
    norm = np.linalg.norm(pose[:, 3:], axis=1)
    if count and np.abs(norm - 1.0).max() > 1e-3:
        raise ValueError(f"{owner}.pose: quaternion of length {norm[np.abs(norm - 1.0).argmax()]:g}, must be 1")
    for index, rows in enumerate(by_trajectory(trajectory)):
        if (np.diff(time[rows]) <= 0.0).any():
            raise ValueError(f"{owner}.time: does not ascend within trajectory {index}")


def by_trajectory(trajectory: np.ndarray) -> list[np.ndarray]:
    """Rows of each trajectory in their order, from ``trajectory`` [row]."""
    return group_rows(trajectory, int(trajectory.max(initial=-1)) + 1)


def group_rows(label: np.ndarray, count: int) -> list[np.ndarray]:
    """Rows of each label 0 to ``count`` - 1 in their order, from ``label`` [row]."""
    order = np.argsort(label, kind="stable")
    return np.split(order, np.searchsorted(label[order], np.arange(1, count)))[:count]


@dataclass(frozen=True, kw_only=True, eq=False)
class Survey:
    """Frames and pings of a batch, and the rig that took them."""

    rig: Rig
    frames: Frames
    pings: Pings

    @property
    def trajectories(self) -> int:
        """Number of trajectories."""
        return int(max(self.frames.trajectory.max(initial=-1), self.pings.trajectory.max(initial=-1))) + 1


def check_same_rows(name: str, survey: Survey, other_name: str, other: Survey) -> None:
    """Refuse a survey with other frames or pings than ``other`` has, with a ``ValueError`` that says so."""
    for kind in ("frames", "pings"):
        rows, wanted = getattr(survey, kind), getattr(other, kind)
        if not all(np.array_equal(getattr(rows, key), getattr(wanted, key)) for key in ("trajectory", "number")):
            raise ValueError(f"{name}.{kind}: other rows than {other_name}.{kind}, must be the same ones in order")


def plan_survey(
    rig: Rig,
    trajectories: Sequence[Trajectory],
    *,
    frames_from: Sequence[float] | float = -np.inf,
    seabed_z: float = 0.0,
) -> Survey:
    """Times and poses of every frame and ping along some trajectories.

    Args:
        rig: sonars and mounts.
        trajectories: what the vehicle does.
        frames_from: time from which the imaging sonar records [s], one or one per trajectory; the profiling sonar
            records all along.
        seabed_z: height of the mean seabed [m], for altitudes.

    Raises:
        ValueError: no trajectory, or one that ends before its imaging sonar records.
    """
    starts = np.broadcast_to(np.asarray(frames_from, dtype=float), (len(trajectories),))
    return join_surveys(
        [
            _survey_one(rig, trajectory, float(start), seabed_z)
            for trajectory, start in zip(trajectories, starts, strict=True)
        ]
    )


def _survey_one(rig: Rig, trajectory: Trajectory, frames_from: float, seabed_z: float) -> Survey:
    start, stop = float(trajectory.times[0]), float(trajectory.times[-1])

    def instants(rate: float, begin: float) -> tuple[np.ndarray, np.ndarray]:
        number = np.arange(int((stop - start) * rate + 1e-9) + 1)
        time = np.minimum(start + number / rate, stop)
        late = time >= begin - 1e-9
        if not late.any():
            raise ValueError(f"frames_from: {begin:g} s, must be at most {time[-1]:g} s, the run's last frame")
        return number[late], time[late]

    number, time = instants(rig.fls.rate, frames_from)
    pose = compose(trajectory.at(time), rig.fls_mount.vehicle_from_sensor())
    owner = np.zeros(len(time), dtype=int)
    frames = Frames(time=time, trajectory=owner, number=number, pose=pose, altitude=pose[:, 2] - seabed_z)
    number, time = instants(rig.ps.rate, -np.inf)
    pose = compose(trajectory.at(time), rig.ps_mount.vehicle_from_sensor())
    owner = np.zeros(len(time), dtype=int)
    pings = Pings(time=time, trajectory=owner, number=number, pose=pose, head_angle=rig.ps.head_angles(number))
    return Survey(rig=rig, frames=frames, pings=pings)


def join_surveys(surveys: Sequence[Survey]) -> Survey:
    """One batch of several, their trajectories numbered on; the rig is the first one's.

    Raises:
        ValueError: no survey at all.
    """
    if not surveys:
        raise ValueError("surveys: empty, at least one is needed")
    offset = np.cumsum([0, *(survey.trajectories for survey in surveys[:-1])])

    def joined(kind: str, name: str) -> np.ndarray:
        parts = [getattr(getattr(survey, kind), name) for survey in surveys]
        if name == "trajectory":
            parts = [part + first for part, first in zip(parts, offset, strict=True)]
        return np.concatenate(parts)

    return Survey(
        rig=surveys[0].rig,
        frames=Frames(
            **{name: joined("frames", name) for name in ("time", "trajectory", "number", "pose", "altitude")}
        ),
        pings=Pings(**{name: joined("pings", name) for name in ("time", "trajectory", "number", "pose", "head_angle")}),
    )
