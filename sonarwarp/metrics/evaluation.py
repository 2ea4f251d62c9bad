"""Everything that can be said of a cloud whose truth is known, in one call."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sonarwarp.cloud import PointCloud
from sonarwarp.metrics.calibration import CalibrationMetrics, Claims, evaluate_calibration
from sonarwarp.metrics.claims import contact_claims, face_claims
from sonarwarp.metrics.section import ObjectTruth, SectionMetrics, evaluate_section
from sonarwarp.metrics.surface import SurfaceMetrics, evaluate_surface
from sonarwarp.survey import Survey
from sonarwarp.truth import FirstContacts
from sonarwarp_scenes import Scene


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """What was asked for; empty or None where it was not."""

    sections: Sequence[SectionMetrics] = ()
    """Slope, area and volume of each object."""

    surface: SurfaceMetrics | None = None
    """Distances to the scene, completeness and F-score."""

    calibration: Sequence[CalibrationMetrics] = ()
    """Coverage and sharpness of what points claim, by class: front, top, fallback of the imaging sonar, face of the
    profiling sonar."""


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
        survey: frames and pings that the cloud was made from, with their true poses; with ``contacts``.
        contacts: first contacts of those frames (``sonarwarp.truth.first_contacts``), for calibration; needs ``scene``
            and a cloud as ``Clouds.fused`` is (:mod:`sonarwarp.metrics.claims`).
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
        claims = Claims.join(
            contact_claims(cloud, survey, scene, contacts), face_claims(cloud, survey, scene, device=device)
        )
        calibration = evaluate_calibration(claims)
    return Evaluation(
        sections=evaluate_section(cloud.points, objects, slab_width=slab_width) if objects else (),
        surface=surface,
        calibration=calibration,
    )
