"""Cases of the end-to-end benchmark, as data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import sonarwarp as sw
from sonarwarp_scenes import TABLE_2, Deployment, Roughness, brick_deployment, pair_deployment


@dataclass(frozen=True, kw_only=True)
class Case:
    """One run, or several alike, simulated and reconstructed."""

    name: str
    """Name on the command line and in results."""
    deployment: Callable[[], Deployment]
    """Scene and trajectory."""
    rig: sw.Rig
    """Sonars and mounts."""
    noise: sw.Noise = field(default_factory=sw.Noise)
    """Added to the echoes."""
    motion: sw.Motion = field(default_factory=sw.Motion)
    """Waves on each run."""
    navigation: sw.Navigation = field(default_factory=sw.Navigation)
    """Errors of instruments and mounts."""
    settings: sw.ReconstructionSettings = field(default_factory=sw.ReconstructionSettings)
    """Reconstruction."""
    trajectories: int = 1
    """Runs in the batch, each with its own key."""
    quick: bool = False
    """Whether ``--quick`` runs it."""


CASES = (
    Case(
        name="brick",
        deployment=lambda: brick_deployment(imaging_distance=3.5, roughness=Roughness()),
        rig=sw.PRESETS["paper field"],
        quick=True,
    ),
    Case(
        name="pair-90-misaligned",
        deployment=lambda: pair_deployment(TABLE_2[3], "misaligned", roughness=Roughness()),
        rig=sw.PRESETS["paper simulation"],
        quick=True,
    ),
    Case(
        name="brick-x8",
        deployment=lambda: brick_deployment(imaging_distance=3.5, roughness=Roughness()),
        rig=sw.PRESETS["paper field"],
        trajectories=8,
    ),
)
