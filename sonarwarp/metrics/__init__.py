"""How good a cloud is, against the known scene; one definition for every method, over every emitted point."""

from sonarwarp.metrics.calibration import CalibrationMetrics, Claims, evaluate_calibration
from sonarwarp.metrics.claims import contact_claims, face_claims
from sonarwarp.metrics.evaluation import Evaluation, evaluate
from sonarwarp.metrics.inclination import face_inclination
from sonarwarp.metrics.section import ObjectTruth, SectionMetrics, evaluate_section
from sonarwarp.metrics.seen import seen_samples
from sonarwarp.metrics.surface import (
    SonarView,
    SurfaceMetrics,
    evaluate_surface,
    sample_surface,
    surface_distances,
    visible_samples,
)

__all__ = [
    "CalibrationMetrics",
    "Claims",
    "Evaluation",
    "ObjectTruth",
    "SectionMetrics",
    "SonarView",
    "SurfaceMetrics",
    "contact_claims",
    "evaluate",
    "evaluate_calibration",
    "evaluate_section",
    "evaluate_surface",
    "face_claims",
    "face_inclination",
    "sample_surface",
    "seen_samples",
    "surface_distances",
    "visible_samples",
]
