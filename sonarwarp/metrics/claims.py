"""What the points of a cloud claim, beside what is true: elevations of contacts, places of faces.

A contact claims an interval of elevation, and its truth is the elevation of what its beam met first. A face claims to
lie within some deviations of its points, square to itself; its truth is how far they are from the nearest surface, be
it another face's or the seabed's. Elevation would not do for faces: where a beam looks square at one, all of the beam
meets it at one range.

Both are judged in their sonar's frame, where it truly was: errors of navigation are no part of what points claim.
"""

from __future__ import annotations

import math

import numpy as np

from sonarwarp.cloud import PointCloud
from sonarwarp.cloud_attributes import covariances_of, deviation_along, normals_of
from sonarwarp.metrics.calibration import Claims
from sonarwarp.metrics.inclination import face_inclination
from sonarwarp.metrics.surface import surface_distances
from sonarwarp.scan_plane import to_world
from sonarwarp.survey import Frames, Pings, Survey
from sonarwarp.truth import FirstContacts
from sonarwarp_kernels import estimate
from sonarwarp_scenes import Scene

# A face that leans less than this from the horizontal is a top [rad].
_TOP_LEAN = math.radians(20.0)

# A detection stands for the first contact of its beam where their ranges differ by no more [m]: three bins and the
# roughness of the seabed.
_SAME_CONTACT = 0.03


def contact_claims(cloud: PointCloud, survey: Survey, scene: Scene, contacts: FirstContacts) -> Claims:
    """Elevations [rad] of the imaging sonar's points, of classes front, top and fallback.

    Args:
        cloud: as ``Clouds.fused``; points of the profiling sonar are passed over.
        survey: its frames.
        scene: what they looked at.
        contacts: what those frames met first in their true poses.

    Raises:
        ValueError: a cloud without a posterior, or with a point of another frame.
    """
    _check(cloud, "elevation_deviation", "elevation_high", "elevation_low", "quality", "source")
    cloud = cloud.select(cloud.attributes["source"] == 0)
    place = (_rows(cloud, survey.frames, "frame"), cloud.attributes["beam"])
    known = np.abs(contacts.range[place] - cloud.attributes["range"]) <= _SAME_CONTACT
    is_top = face_inclination(scene) <= _TOP_LEAN
    kind = np.where(is_top[np.maximum(contacts.face[place], 0)], "top", "front")
    return Claims(
        low=cloud.attributes["elevation_low"],
        high=cloud.attributes["elevation_high"],
        deviation=cloud.attributes["elevation_deviation"],
        truth=np.where(known, contacts.elevation[place], np.nan),
        kind=np.where(cloud.attributes["quality"] == 1, "fallback", kind),
    )


def face_claims(cloud: PointCloud, survey: Survey, scene: Scene, *, device: str | None = None) -> Claims:
    """Distances [m] of the profiling sonar's points to the surface, of class face.

    Points without a normal are passed over: what is across their face they do not know.

    Args:
        cloud: as ``Clouds.fused``; points of the imaging sonar are passed over.
        survey: its pings, with their true poses.
        scene: what they looked at.
        device: Warp device.

    Raises:
        ValueError: a cloud without sources, or faces without normals or covariances, or a point of another ping.
    """
    _check(cloud, "source")
    cloud = cloud.select(cloud.attributes["source"] == 1)
    if len(cloud):
        _check(cloud, "normal_x", "covariance_xx")
        cloud = cloud.select(np.any(normals_of(cloud), axis=1))
    if not len(cloud):
        nothing = np.zeros(0)
        return Claims(low=nothing, high=nothing, deviation=nothing, truth=nothing, kind=nothing.astype(str))
    deviation = deviation_along(covariances_of(cloud), normals_of(cloud))
    head = survey.pings.head_pose[_rows(cloud, survey.pings, "ping")]
    distance, azimuth, elevation = (cloud.attributes[name] for name in ("range", "azimuth", "elevation"))
    points = to_world(head, distance, azimuth, elevation)
    return Claims(
        low=np.zeros(len(cloud)),
        high=float(estimate.NORMAL_INTERVAL) * deviation,
        deviation=deviation / distance,
        truth=surface_distances(scene.vertices, scene.faces, points, device=device),
        kind=np.full(len(cloud), "face"),
    )


def _check(cloud: PointCloud, *names: str) -> None:
    for name in names:
        if name not in cloud.attributes:
            raise ValueError(f"cloud.attributes: no {name}, a fused cloud is needed")


def _rows(cloud: PointCloud, instants: Frames | Pings, kind: str) -> np.ndarray:
    """Row of each point's frame or ping, found by trajectory and number."""
    number, wanted = instants.number, cloud.attributes["frame"].astype(np.int64)
    span = int(max(number.max(initial=0), wanted.max(initial=0))) + 1
    keys = instants.trajectory.astype(np.int64) * span + number
    wanted += cloud.attributes["trajectory"].astype(np.int64) * span
    if not np.isin(wanted, keys).all():
        raise ValueError(f"survey: does not hold every {kind} of the cloud")
    order = np.argsort(keys)
    return order[np.searchsorted(keys[order], wanted)]
