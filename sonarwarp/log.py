"""What a run of the two sonars leaves behind: recorded or simulated, nothing after this knows which."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sonarwarp.survey import Survey


@dataclass(frozen=True, kw_only=True, eq=False)
class SonarLog:
    """Images and echo profiles with the survey that took them, in memory."""

    survey: Survey
    """Rig, times and navigation poses."""

    images: np.ndarray
    """FLS echo amplitude, float32, shape [frame, beam, bin]."""

    echoes: np.ndarray
    """PS echo amplitude, float32, shape [ping, bin]."""

    def __post_init__(self) -> None:
        rig = self.survey.rig
        _check_amplitudes("SonarLog.images", self.images, (len(self.survey.frames), rig.fls.beams, rig.fls.bins))
        _check_amplitudes("SonarLog.echoes", self.echoes, (len(self.survey.pings), rig.ps.bins))


def _check_amplitudes(name: str, values: np.ndarray, shape: tuple[int, ...]) -> None:
    if values.shape != shape:
        raise ValueError(f"{name}: expected shape {shape}, got {values.shape}")
    if values.dtype != np.float32:
        raise ValueError(f"{name}: expected dtype float32, got {values.dtype}")
    if not np.isfinite(values).all():
        raise ValueError(f"{name}: holds values that are not finite")
