"""Everything that can be said of a cloud whose truth is known, in one call."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sonarwarp.cloud import PointCloud
from sonarwarp.metrics.calibration import CalibrationMetrics, evaluate_calibration
from sonarwarp.metrics.inclination import face_inclination
from sonarwarp.metrics.section import ObjectTruth, SectionMetrics, evaluate_section
from sonarwarp.metrics.surface import SurfaceMetrics, evaluate_surface
from sonarwarp.survey import Survey
from sonarwarp.truth import FirstContacts
from sonarwarp_scenes import Scene

# A face that leans less than this from the horizontal is a top [rad].
_TOP_LEAN = math.radians(20.0)

# A detection stands for the first contact of its beam where their ranges differ by no more [m]: three bins and the
# roughness of the seabed.
_SAME_CONTACT = 0.03


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """What was asked for; empty or None where it was not."""

    sections: Sequence[SectionMetrics] = ()
    """Slope, area and volume of each object."""

    surface: SurfaceMetrics | None = None
    """Distances to the scene, completeness and F-score."""

    calibration: Sequence[CalibrationMetrics] = ()
    """Coverage and sharpness of the imaging sonar's elevations, by class of point: front, top, fallback."""


def evaluate(
    cloud: PointCloud,
    *,
    objects: Sequence[ObjectTruth] = (),
    slab_width: float = 0.02,
    scene: Scene | None = None,
    seen: np.ndarray | None = None,
    part: np.ndarray | None = None,
    tolerance: float = 0.05,
    survey: Survey | None = None,
    contacts: FirstContacts | None = None,
    device: str | None = None,
) -> Evaluation:
    """Compare a cloud with all that is known: objects, a scene, first contacts; all its points count.

    Args:
        cloud: as ``reconstruct`` gives it, of one scene.
        objects: known objects, for sections.
        slab_width: width of the volume's slabs, about one beam spacing at the objects [m].
        scene: seabed and objects, for distances and classes of points.
        seen: surface samples that the sonars could see (:func:`~sonarwarp.metrics.seen_samples`) [m], shape
            [sample, 3]; with ``scene``.
        part: whether a face of ``scene`` belongs to what is asked for, shape [face]; all do by default. Points that lie
            on the rest are left out (:func:`~sonarwarp.metrics.evaluate_surface`).
        tolerance: distance within which a point or a sample counts as met [m].
        survey: frames that the cloud was made from; with ``contacts``.
        contacts: first contacts of those frames (``sonarwarp.truth.first_contacts``), for calibration; needs ``scene``
            and a cloud with ``elevation_low``, ``elevation_high`` and ``elevation_deviation``. Points of the profiling
            sonar, whose elevations are measured, are left out of it.
        device: Warp device for distances.

    Raises:
        ValueError: contacts without a survey or a scene, or a cloud without a posterior.
    """
    surface = None
    if scene is not None:
        samples = np.zeros((0, 3)) if seen is None else seen
        surface = evaluate_surface(
            scene.vertices, scene.faces, [cloud.points], [samples], tolerance=tolerance, part=part, device=device
        )[0]
    calibration: Sequence[CalibrationMetrics] = ()
    if contacts is not None:
        if survey is None or scene is None:
            raise ValueError(f"{'survey' if survey is None else 'scene'}: None, is needed with contacts")
        calibration = _calibration(cloud, survey, scene, contacts)
    return Evaluation(
        sections=evaluate_section(cloud.points, objects, slab_width=slab_width) if objects else (),
        surface=surface,
        calibration=calibration,
    )


def _calibration(
    cloud: PointCloud, survey: Survey, scene: Scene, contacts: FirstContacts
) -> Sequence[CalibrationMetrics]:
    needed = {"source", "elevation_low", "elevation_high", "elevation_deviation", "quality"}
    missing = needed - set(cloud.attributes)
    if missing:
        raise ValueError(f"cloud.attributes: no {sorted(missing)[0]}, a fused cloud is needed")
    # Faces number pings and strips where contacts number frames and beams.
    cloud = cloud.select(cloud.attributes["source"] == 0)
    place = (_frame_rows(cloud, survey), cloud.attributes["beam"])
    known = np.abs(contacts.range[place] - cloud.attributes["range"]) <= _SAME_CONTACT
    truth = np.where(known, contacts.elevation[place], np.nan)
    is_top = face_inclination(scene) <= _TOP_LEAN
    kind = np.where(is_top[np.maximum(contacts.face[place], 0)], "top", "front")
    kind = np.where(cloud.attributes["quality"] == 1, "fallback", kind)
    low, high, deviation = (cloud.attributes[f"elevation_{name}"] for name in ("low", "high", "deviation"))
    return evaluate_calibration(low, high, deviation, truth, kind)


def _frame_rows(cloud: PointCloud, survey: Survey) -> np.ndarray:
    """Row in the survey of each point's frame, found by trajectory and number."""
    frames = survey.frames
    span = int(frames.number.max(initial=0)) + 1
    order = np.argsort(frames.trajectory * span + frames.number)
    wanted = cloud.attributes["trajectory"].astype(np.int64) * span + cloud.attributes["frame"]
    sorted_keys = (frames.trajectory * span + frames.number)[order]
    found = np.minimum(np.searchsorted(sorted_keys, wanted), len(order) - 1)
    if len(wanted) and not np.array_equal(sorted_keys[found], wanted):
        raise ValueError("survey: does not hold every frame of the cloud")
    return order[found]
