"""The surface that both sonars of a survey could see: what completeness asks for."""

from __future__ import annotations

import numpy as np

from sonarwarp.metrics.surface import SonarView, checked_part, sample_surface, visible_samples
from sonarwarp.survey import Survey
from sonarwarp_scenes import Scene

SAMPLES = 10_000
"""Samples of a surface. Ours: with the sixth of a half-buried wreck that is seen, a share is good to 0.01."""


def seen_samples(
    scene: Scene,
    survey: Survey,
    *,
    part: np.ndarray | None = None,
    count: int = SAMPLES,
    seed: int = 0,
    device: str | None = None,
) -> np.ndarray:
    """Surface samples that the FLS in any of its frames or the PS in any of its pings could see, of all trajectories.

    Args:
        scene: everything that can hide a sample.
        survey: frames and pings with their true poses.
        part: whether a face belongs to the surface that is asked for, shape [face]; all do by default.
        count: samples of that surface, seen and unseen, uniform by area.
        seed: names the draw of samples.
        device: Warp device.

    Returns:
        Positions [m], shape [sample, 3]; none where nothing is seen.

    Raises:
        ValueError: a part of another type or shape or without faces, or as ``sample_surface``.
    """
    faces = scene.faces if part is None else scene.faces[checked_part(part, len(scene.faces))]
    samples = sample_surface(scene.vertices, faces, count, seed)
    rig = survey.rig
    seen = np.zeros(len(samples), dtype=bool)
    for sonar, poses in ((rig.fls, survey.frames.pose), (rig.ps, survey.pings.head_pose)):
        view = SonarView.of(sonar)
        # One sonar's answer spares the other the search.
        seen[~seen] = visible_samples(scene.vertices, scene.faces, samples[~seen], view, [poses], device=device)[0]
    return samples[seen]
