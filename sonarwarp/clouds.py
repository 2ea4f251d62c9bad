"""Both methods' clouds, and those made of the imaging sonar's contacts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sonarwarp.cloud import PointCloud
from sonarwarp.cloud_attributes import covariance_attributes, normal_attributes
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


_BELIEFS = (
    "elevation",
    "elevation_mean",
    "elevation_deviation",
    "elevation_low",
    "elevation_high",
    "effective_size",
    "quality",
)


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
            **normal_attributes(np.zeros_like(points)),
            **covariance_attributes(estimates["covariance"][found]),
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
