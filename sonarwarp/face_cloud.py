"""Clouds made of the faces that the profiling sonar saw."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sonarwarp.cloud import PointCloud
from sonarwarp.cloud_attributes import covariance_attributes, deviation_along, normal_attributes
from sonarwarp.poses import rotate
from sonarwarp.scan_plane import per_elevation, to_polar
from sonarwarp.survey import Survey
from sonarwarp_kernels import estimate

# What rounding leaves of a component that is zero, for poses of float32.
_ROUNDING = 1e-6


def face_cloud(survey: Survey, fronts: Mapping[str, np.ndarray], *, spacing: float, registration: float) -> PointCloud:
    """Points of the profiling sonar: every patch of a face filled from its lower to its upper end.

    ``frame`` is the ping's number, ``beam`` the strip across the fan; ``azimuth`` and ``elevation`` are those of
    :mod:`sonarwarp.scan_plane`. A point is uncertain across its face, by its line's deviation, and along its arc, by
    the registration. Its elevation is as sure as where on the arc the face is: where the beam looks square at it, no
    surer than the beam is narrow.

    Args:
        survey: the pings.
        fronts: arrays of ``fronts.Fronts`` by name, shape [ping, footprint, column, ...].
        spacing: distance between points [m].
        registration: standard deviation of elevation between both sonars [rad].
    """
    patches = _fill(fronts, spacing)
    ping, column, points = patches.ping, patches.column, patches.points
    head = survey.pings.head_pose[ping]
    distance, azimuth, elevation = to_polar(head, points)
    ahead = _level_ahead(head)
    normal = _normal(ahead, patches.run)
    across = ahead[:, :, None] * ahead[:, None, :]
    # A head that looks straight down does not say which way a face looks.
    across[~ahead.any(axis=1)] = np.diag([1.0, 1.0, 0.0])
    arc = per_elevation(head, points)
    # A strip is known across and along itself to its own size.
    covariance = (
        (patches.deviation**2)[:, None, None] * across
        + spacing**2 / 12.0 * (np.eye(3) - across)
        + registration**2 * arc[:, :, None] * arc[:, None, :]
    )
    anywhere = np.radians(survey.rig.ps.beamwidth_deg) / np.sqrt(12.0)
    deviation = _elevation_deviation(normal, covariance, arc, anywhere)
    margin = float(estimate.NORMAL_INTERVAL) * deviation
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
            "azimuth": azimuth,
            "elevation": elevation.astype(np.float32),
            "elevation_mean": elevation.astype(np.float32),
            "elevation_deviation": deviation.astype(np.float32),
            "elevation_low": (elevation - margin).astype(np.float32),
            "elevation_high": (elevation + margin).astype(np.float32),
            "effective_size": np.ones(len(points), dtype=np.float32),
            "quality": np.full(len(points), int(estimate.QUALITY_INFORMED), dtype=np.int32),
            "hits": np.ones(len(points), dtype=np.int32),
            **normal_attributes(normal),
            **covariance_attributes(covariance),
        },
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Patches:
    """What points on patches have of them."""

    ping: np.ndarray  # [point]
    column: np.ndarray  # [point]
    points: np.ndarray  # [point, 3] world [m]
    run: np.ndarray  # [point, 3] displacement per metre of height
    deviation: np.ndarray  # [point] along the way [m]


def _fill(fronts: Mapping[str, np.ndarray], spacing: float) -> _Patches:
    patch = np.nonzero((fronts["found"] != 0) & (fronts["high"] >= fronts["low"]))
    low, high = fronts["low"][patch], fronts["high"][patch]
    count = np.floor((high - low) / spacing).astype(int) + 1
    step = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    # As much is left over below as above.
    height = np.repeat(low, count) + spacing * (step + 0.5 * np.repeat((high - low) / spacing - count + 1, count))
    run = np.repeat(fronts["run"][patch], count, axis=0)
    return _Patches(
        ping=np.repeat(patch[0], count),
        column=np.repeat(patch[2], count),
        points=np.repeat(fronts["point"][patch], count, axis=0) + height[:, None] * run,
        run=run,
        deviation=np.repeat(fronts["deviation"][patch], count),
    )


def _level_ahead(head: np.ndarray) -> np.ndarray:
    """Unit level direction that heads look in, zero where that is straight down, shape [point, 3]."""
    axis = rotate(head[:, 3:], np.array([1.0, 0.0, 0.0]))
    level = np.linalg.norm(axis[:, :2], axis=1, keepdims=True)
    return np.divide(axis * (1.0, 1.0, 0.0), level, out=np.zeros_like(axis), where=level > _ROUNDING)


def _normal(ahead: np.ndarray, run: np.ndarray) -> np.ndarray:
    """Unit normals towards the sonar, zero where the way ahead is, shape [point, 3]."""
    incline = np.sum(run * ahead, axis=1, keepdims=True)
    return (incline * (0.0, 0.0, 1.0) - ahead) / np.sqrt(1.0 + incline**2)


def _elevation_deviation(normal: np.ndarray, covariance: np.ndarray, arc: np.ndarray, anywhere: float) -> np.ndarray:
    """Standard deviation of where the face crosses the arc [rad], at most ``anywhere``, shape [point].

    A face that is off by x along its normal crosses the arc further on by x over ``normal . arc``.
    """
    across = deviation_along(covariance, normal)
    slide = np.abs(np.sum(normal * arc, axis=1))
    return np.divide(across, slide, out=np.full_like(across, anywhere), where=across < anywhere * slide)
