"""How good a cloud is, against the known scene; one definition for every method, over every emitted point."""

from sonarwarp.metrics.section import ObjectTruth, SectionMetrics, evaluate_section
from sonarwarp.metrics.surface import (
    SonarView,
    SurfaceMetrics,
    evaluate_surface,
    sample_surface,
    visible_samples,
)

__all__ = [
    "ObjectTruth",
    "SectionMetrics",
    "SonarView",
    "SurfaceMetrics",
    "evaluate_section",
    "evaluate_surface",
    "sample_surface",
    "visible_samples",
]
