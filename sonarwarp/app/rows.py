"""A run against the truth, as rows for machines: one per object and method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sonarwarp.app.experiment import Run
from sonarwarp.metrics import (
    ObjectTruth,
    SectionMetrics,
    SurfaceMetrics,
    evaluate_section,
    evaluate_surface,
    seen_samples,
)
from sonarwarp_scenes import PlacedObject

METHODS = ("single", "fused")

SEEN = "seen"
"""Stands for a method where the surface itself is evaluated."""

TOLERANCE = 0.05
"""Distance within which a point lies on a mesh, and a place of the mesh is met [m]. Ours: two cells and a half."""

# Samples of objects' surfaces, seen and unseen: some in each half bin by slab of a section.
_SEEN_SAMPLES = 100_000

_SECTION_FIGURES = ("slope_deg", "slope_error", "front_coverage", "area_error", "volume_error")
SURFACE_FIGURES = (
    "tolerance",
    "counted",
    "accuracy_mean",
    "accuracy_rms",
    "accuracy_p95",
    "precision",
    "completeness",
    "f_score",
)

Sections = Mapping[str, Sequence[SectionMetrics]]
"""Of each method, one entry per object."""

Surfaces = Mapping[str, SurfaceMetrics]
"""Of each method."""


def evaluate_objects(run: Run, methods: Sequence[str] = METHODS) -> Sections:
    """The methods' clouds against the known objects."""
    return {name: _sections(run, getattr(run.clouds, name).points) for name in methods}


def evaluate_seen(run: Run) -> Sections:
    """The surface of the known objects that the sonars could see, sampled without error, against the objects.

    The figures that the best of all methods would have: what the objects hide of themselves, no cloud holds.
    """
    deployment = run.experiment.deployment
    faces = len(deployment.scene.faces)
    # A deployment's last faces are its bodies'.
    part = np.arange(faces) >= faces - sum(size for _, size in deployment.bodies)
    seen = seen_samples(deployment.scene, run.truth, part=part, count=_SEEN_SAMPLES, device=run.device)
    return {SEEN: _sections(run, seen)}


def _sections(run: Run, points: np.ndarray) -> list[SectionMetrics]:
    truths = [_truth(placed) for placed in run.experiment.deployment.objects]
    return evaluate_section(points, truths, slab_width=_beam_spacing(run))


def _truth(placed: PlacedObject) -> ObjectTruth:
    shape = placed.shape
    return ObjectTruth(
        name=placed.name,
        front_x=placed.front_x,
        centre_y=placed.centre_y,
        width=shape.width,
        height=shape.height,
        depth=shape.depth,
        front_slope_deg=shape.front_slope_deg,
        sectional_area=shape.sectional_area,
        volume=shape.volume,
    )


def _beam_spacing(run: Run) -> float:
    """Distance between neighbouring beams at the typical contact, or in the middle of the window without any [m]."""
    fls = run.experiment.rig.fls
    contacts = run.critical_range[run.critical_range > 0.0]
    reach = np.median(contacts) if len(contacts) else 0.5 * (fls.range_edge[0] + fls.range_edge[-1])
    return float(reach * np.median(np.diff(fls.azimuth_edge)))


def evaluate_mesh(run: Run) -> Surfaces:
    """Both methods' clouds against the mesh, as a part of a scene with a seabed.

    Completeness is over what both sonars could see of the mesh; accuracy and precision over all points that do not lie
    on the seabed: ``sonarwarp evaluate --log --part`` says the same.
    """
    scene, body, truth = run.experiment.deployment.scene, run.experiment.body, run.truth
    if body is None:
        raise ValueError(f"run: {run.experiment.title} has no mesh")
    # A deployment's last faces are its mesh's.
    part = np.arange(len(scene.faces)) >= len(scene.faces) - len(body.faces)
    seen = seen_samples(scene, truth, part=part, device=run.device)
    clouds = [getattr(run.clouds, name).points for name in METHODS]
    figures = evaluate_surface(
        *(scene.vertices, scene.faces, clouds, [seen] * len(METHODS)),
        tolerance=TOLERANCE,
        part=part,
        device=run.device,
    )
    return dict(zip(METHODS, figures, strict=True))


def object_rows(run: Run, sections: Sections) -> list[dict[str, Any]]:
    """Rows of a run over known objects, of the methods that there are sections of."""
    objects = run.experiment.deployment.objects
    return [
        _row(run, placed.name if len(objects) > 1 else None, method)
        | {name: getattr(sections[method][index], name) for name in _SECTION_FIGURES}
        for index, placed in enumerate(objects)
        for method in sections
    ]


def mesh_rows(run: Run, surfaces: Surfaces) -> list[dict[str, Any]]:
    """Rows of a run over a mesh: no section figures, distances [m] and shares instead."""
    return [
        _row(run, None, method)
        | dict.fromkeys(_SECTION_FIGURES)
        | {"points": len(getattr(run.clouds, method))}
        | {name: getattr(surfaces[method], name) for name in SURFACE_FIGURES}
        for method in METHODS
    ]


def _row(run: Run, which: str | None, method: str) -> dict[str, Any]:
    experiment = run.experiment
    return {
        "experiment": experiment.name,
        "object": experiment.object,
        "deployment": experiment.arrangement,
        "which": which,
        "method": method,
        "noise": experiment.noise,
        "seed": experiment.seed,
    }
