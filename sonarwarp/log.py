"""What a run of the two sonars leaves behind: recorded or simulated, nothing after this knows which."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sonarwarp.schedule import EMPTY
from sonarwarp.survey import Survey, check_same_rows


class Log(Protocol):
    """What a reconstruction reads: a log in memory or on disk."""

    @property
    def survey(self) -> Survey:
        """Rig, times and the poses that navigation gives: all that a reconstruction may know of where it was."""
        ...

    @property
    def truth(self) -> Survey | None:
        """The same frames and pings with their true poses, of a simulation; to judge by, never to reconstruct from."""
        ...

    def images_of(self, frames: np.ndarray) -> np.ndarray:
        """FLS images of some frames, float32, shape [slot, beam, bin], zero for ``EMPTY`` slots.

        Args:
            frames: indices of the survey's frames or ``EMPTY``, shape [slot].
        """
        ...

    def echoes_of(self, pings: np.ndarray) -> np.ndarray:
        """PS echo profiles of some pings, float32, shape [slot, bin], zero for ``EMPTY`` slots.

        Args:
            pings: indices of the survey's pings or ``EMPTY``, shape [slot].
        """
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class SonarLog:
    """Images and echo profiles with the survey that took them, in memory."""

    survey: Survey
    """Rig, times and the poses that navigation gives."""

    images: np.ndarray
    """FLS echo amplitude, float32, shape [frame, beam, bin]."""

    echoes: np.ndarray
    """PS echo amplitude, float32, shape [ping, bin]."""

    truth: Survey | None = None
    """The same frames and pings with their true poses, of a simulation."""

    def __post_init__(self) -> None:
        rig = self.survey.rig
        check_amplitudes("SonarLog.images", self.images, (len(self.survey.frames), rig.fls.beams, rig.fls.bins))
        check_amplitudes("SonarLog.echoes", self.echoes, (len(self.survey.pings), rig.ps.bins))
        if self.truth is not None:
            check_same_rows("SonarLog.truth", self.truth, "survey", self.survey)

    def images_of(self, frames: np.ndarray) -> np.ndarray:
        """As :meth:`Log.images_of`."""
        return _rows(self.images, frames)

    def echoes_of(self, pings: np.ndarray) -> np.ndarray:
        """As :meth:`Log.echoes_of`."""
        return _rows(self.echoes, pings)


def _rows(values: np.ndarray, index: np.ndarray) -> np.ndarray:
    rows = np.zeros((len(index), *values.shape[1:]), dtype=values.dtype)
    filled = index != EMPTY
    rows[filled] = values[index[filled]]
    return rows


def check_amplitudes(name: str, values: np.ndarray, shape: tuple[int, ...]) -> None:
    """Refuse amplitudes that are not float32, finite and of ``shape``, with a ``ValueError`` that says so."""
    if values.shape != shape:
        raise ValueError(f"{name}: expected shape {shape}, got {values.shape}")
    if values.dtype != np.float32:
        raise ValueError(f"{name}: expected dtype float32, got {values.dtype}")
    if not np.isfinite(values).all():
        raise ValueError(f"{name}: holds values that are not finite")
