"""Clouds made of what the kernels found: contacts of the imaging sonar, faces of the profiling sonar."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sonarwarp.cloud import NORMAL, PointCloud
from sonarwarp.poses import rotate
from sonarwarp.survey import Survey
from sonarwarp_kernels import critical, estimate

QUALITIES = {0: "none", 1: "fallback", 2: "informed"}
"""Meaning of the clouds' attribute ``quality``."""

SOURCES = {0: "fls", 1: "ps"}
"""Meaning of the clouds' attribute ``source``: which sonar met the point."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Clouds:
    """Both methods' points from one pass over the same critical points."""

    fused: PointCloud
    """Points of both sonars' fusion.

    ``hits`` is how many contacts of one place a point stands for, itself included; 1 of the profiling sonar's points.
    Those have a normal (``cloud.NORMAL``): square to their face's line and to the level across the way that the head
    looks, towards the sonar; a face that stands oblique to that way is not told apart. Zero where the head looks
    straight down, and of the imaging sonar's points, whose surface's incline is not known.
    """

    single: PointCloud
    """The single-sonar method's points: every critical point at the beam's lower edge."""


_COVARIANCE = (
    ("covariance_xx", 0, 0),
    ("covariance_yy", 1, 1),
    ("covariance_zz", 2, 2),
    ("covariance_xy", 0, 1),
    ("covariance_xz", 0, 2),
    ("covariance_yz", 1, 2),
)

_BELIEFS = (
    "elevation",
    "elevation_mean",
    "elevation_deviation",
    "elevation_low",
    "elevation_high",
    "effective_size",
    "quality",
)

# What rounding leaves of a component that is zero, for poses of float32.
_ROUNDING = 1e-6


def single_cloud(survey: Survey, critical_range: np.ndarray, edge: np.ndarray) -> PointCloud:
    """Points at the beams' lower edges.

    Args:
        survey: the frames.
        critical_range: ``critical.NO_DETECTION`` where there is none [m], shape [frame, beam].
        edge: lower edges at that range, world [m], shape [frame, beam, 3].
    """
    found = critical_range != float(critical.NO_DETECTION)
    lower = np.full(int(found.sum()), -survey.rig.fls.half_elevation)
    return PointCloud(points=edge[found], attributes=_contacts(survey, critical_range, found) | {"elevation": lower})


def contact_cloud(
    survey: Survey,
    critical_range: np.ndarray,
    quality: np.ndarray,
    hits: np.ndarray,
    estimates: Mapping[str, np.ndarray],
) -> PointCloud:
    """Points of the imaging sonar, placed by the fusion.

    Args:
        survey: the frames.
        critical_range: [m], shape [frame, beam].
        quality: 0 where no point is to be, shape [frame, beam].
        hits: contacts that each point stands for, itself included, shape [frame, beam].
        estimates: arrays of ``estimate.Estimates`` by name, shape [frame, beam, ...].
    """
    found = quality != int(estimate.QUALITY_NONE)
    beliefs = {name: estimates[name][found] for name in _BELIEFS} | {"hits": hits[found]}
    points = estimates["likely"][found]
    return PointCloud(
        points=points,
        attributes={
            **_contacts(survey, critical_range, found),
            **beliefs,
            **_normal(np.zeros_like(points)),
            **_covariance(estimates["covariance"][found]),
        },
    )


def _contacts(survey: Survey, critical_range: np.ndarray, found: np.ndarray) -> dict[str, np.ndarray]:
    frame, beam = np.nonzero(found)
    frames = survey.frames
    return {
        "source": np.zeros(len(frame), dtype=np.int32),
        "trajectory": frames.trajectory[frame].astype(np.int32),
        "frame": frames.number[frame].astype(np.int32),
        "beam": beam.astype(np.int32),
        "time": frames.time[frame],
        "range": critical_range[found],
        "azimuth": survey.rig.fls.azimuth[beam],
    }


def _normal(vectors: np.ndarray) -> dict[str, np.ndarray]:
    return {name: values.astype(np.float32) for name, values in zip(NORMAL, vectors.T, strict=True)}


def _covariance(matrix: np.ndarray) -> dict[str, np.ndarray]:
    return {name: matrix[:, row, column].astype(np.float32) for name, row, column in _COVARIANCE}


def face_cloud(survey: Survey, fronts: Mapping[str, np.ndarray], spacing: float) -> PointCloud:
    """Points of the profiling sonar: every patch of a face filled from its lower to its upper end.

    ``frame`` is the ping's number, ``beam`` the strip across the fan; ``azimuth`` is the angle across the fan and
    ``elevation`` the one in the scan plane, positive upwards, or towards the head's y axis where that is level.

    Args:
        survey: the pings.
        fronts: arrays of ``fronts.Fronts`` by name, shape [ping, footprint, column, ...].
        spacing: distance between points [m].
    """
    patch = np.nonzero((fronts["found"] != 0) & (fronts["high"] >= fronts["low"]))
    low, high = fronts["low"][patch], fronts["high"][patch]
    count = np.floor((high - low) / spacing).astype(int) + 1
    ping, column = np.repeat(patch[0], count), np.repeat(patch[2], count)
    step = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    height = np.repeat(low, count) + spacing * (step + 0.5 * np.repeat((high - low) / spacing - count + 1, count))
    run = np.repeat(fronts["run"][patch], count, axis=0)
    points = np.repeat(fronts["point"][patch], count, axis=0) + height[:, None] * run
    deviation = np.repeat(fronts["deviation"][patch], count)
    head = survey.pings.head_pose[ping]
    away = points - head[:, :3]
    distance = np.linalg.norm(away, axis=1)
    # Inverse of the head's turn: x along its axis, y in the scan plane, z across it. Lying on its side, either way
    # round, its y axis points up or down.
    seen = rotate(head[:, 3:] * (-1.0, -1.0, -1.0, 1.0), away)
    upwards = np.where(rotate(head[:, 3:], np.array([0.0, 1.0, 0.0]))[:, 2] < -_ROUNDING, -1.0, 1.0)
    elevation = upwards * np.arctan2(seen[:, 1], seen[:, 0])
    axis = rotate(head[:, 3:], np.array([1.0, 0.0, 0.0]))
    level = np.linalg.norm(axis[:, :2], axis=1, keepdims=True)
    ahead = np.divide(axis * (1.0, 1.0, 0.0), level, out=np.zeros_like(axis), where=level > _ROUNDING)
    incline = np.sum(run * ahead, axis=1, keepdims=True)
    normal = (incline * (0.0, 0.0, 1.0) - ahead) / np.sqrt(1.0 + incline**2)
    across = ahead[:, :, None] * ahead[:, None, :]
    # A head that looks straight down does not say which way a face looks.
    across[level[:, 0] <= _ROUNDING] = np.diag([1.0, 1.0, 0.0])
    # A strip is known across and along itself to its own size, across the face to its line's deviation.
    covariance = (deviation**2)[:, None, None] * across + spacing**2 / 12.0 * (np.eye(3) - across)
    pings = survey.pings
    return PointCloud(
        points=points.astype(np.float32),
        attributes={
            "source": np.ones(len(points), dtype=np.int32),
            "trajectory": pings.trajectory[ping].astype(np.int32),
            "frame": pings.number[ping].astype(np.int32),
            "beam": column.astype(np.int32),
            "time": pings.time[ping],
            "range": distance.astype(np.float32),
            "azimuth": np.arcsin(seen[:, 2] / distance),
            "elevation": elevation.astype(np.float32),
            "elevation_mean": elevation.astype(np.float32),
            "elevation_deviation": (deviation / distance).astype(np.float32),
            "elevation_low": (elevation - float(estimate.NORMAL_INTERVAL) * deviation / distance).astype(np.float32),
            "elevation_high": (elevation + float(estimate.NORMAL_INTERVAL) * deviation / distance).astype(np.float32),
            "effective_size": np.ones(len(points), dtype=np.float32),
            "quality": np.full(len(points), int(estimate.QUALITY_INFORMED), dtype=np.int32),
            "hits": np.ones(len(points), dtype=np.int32),
            **_normal(normal),
            **_covariance(covariance),
        },
    )
