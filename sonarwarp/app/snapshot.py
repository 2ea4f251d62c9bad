"""What both sonars saw at a few instants of a run or of a log, and the field then.

A run keeps no images. Randomness is keyed by frame and ping, so that forming those few again gives the same bits.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TypeVar

import numpy as np
import warp as wp

import sonarwarp as sw
from sonarwarp.app.experiment import Engines, Run
from sonarwarp.log import Log
from sonarwarp.schedule import EMPTY
from sonarwarp_kernels.field import FIXED_POINT

Instants = TypeVar("Instants", sw.Frames, sw.Pings)

# Shares of a run's contacts that lie before the instants shown.
_SHARES = (0.1, 0.4, 0.7)

FRAMES = len(_SHARES)
"""Most frames of a snapshot."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Snapshot:
    """Up to three frames, the last pings before the last of them, as many as a window holds, and their field."""

    survey: sw.Survey
    """These frames and pings only."""

    images: np.ndarray
    """FLS echo amplitude, shape [frame, beam, bin]."""

    seabed_range: np.ndarray
    """r_emin of every beam [m], shape [frame, beam]."""

    critical_range: np.ndarray
    """Contacts [m], below 0 where a beam has none, shape [frame, beam]."""

    echoes: np.ndarray
    """PS echo amplitude, shape [ping, bin]."""

    footprints: np.ndarray
    """(10 % point, centre, 90 % point) [m], below 0 where unused, shape [ping, footprint, 3]."""

    log_odds: np.ndarray
    """The field's sums, ``FIXED_POINT`` counts per unit and not clamped, shape [x, y, z]."""

    clamps: tuple[float, float]
    """Between which log-odds are read."""

    origin: np.ndarray
    """Lowest corner of the field [m], shape [3]."""

    cell: float
    """Edge length of a cell [m]."""

    def occupancy(self, y: float) -> np.ndarray:
        """Probability that cells of the vertical plane at ``y`` [m], or of the nearest that there is, are occupied
        (Eq. 22), 1/2 where nothing is known, shape [x, z]."""
        column = int(np.clip((y - self.origin[1]) / self.cell, 0, self.log_odds.shape[1] - 1))
        log_odds = self.log_odds[:, column].astype(np.float32) / np.float32(FIXED_POINT)
        return 1.0 / (1.0 + np.exp(-np.clip(log_odds, *self.clamps)))


def take_snapshot(run: Run) -> Snapshot:
    """Form a few frames of a run again, and a window's pings before the last of them."""
    engines = Engines([run.experiment], run.device)
    frames = _telling_frames((run.critical_range >= 0.0).sum(axis=1))
    pings = _pings_before(run.survey, int(frames[-1]), engines.reconstructor.window)
    part = _part(run.survey, frames, pings)
    schedule = _within(engines.plan_schedule(part), frames, pings)
    engines.plan(run.truth, run.survey, schedule)
    fls, ps = run.experiment.rig.fls, run.experiment.rig.ps
    images = np.empty((len(frames), fls.beams, fls.bins), dtype=np.float32)
    echoes = np.empty((len(pings), ps.bins), dtype=np.float32)
    for frame, ping in zip(schedule.round_frame, schedule.round_ping, strict=True):
        engines.step()
        round_images, round_echoes = engines.simulator.read()
        images[np.searchsorted(frames, frame[frame != EMPTY])] = round_images[frame != EMPTY]
        echoes[np.searchsorted(pings, ping[ping != EMPTY])] = round_echoes[ping != EMPTY]
    return _read(engines.reconstructor, part, frames, pings, images, echoes)


def take_log_snapshot(
    log: Log,
    trajectory: int,
    contacts: np.ndarray,
    *,
    settings: sw.ReconstructionSettings | None,
    device: str,
) -> Snapshot:
    """Read a few frames of a log, and a window's pings before the last of them.

    Args:
        log: in memory or on disk.
        trajectory: whose frames.
        contacts: contacts in each of its frames, shape [frame].
        settings: of the log's reconstruction.
        device: Warp device.
    """
    reconstructor = sw.Reconstructor(log.survey.rig, settings=settings, device=device)
    own = of_trajectory(log.survey, trajectory)
    frames = _telling_frames(contacts)
    pings = _pings_before(own, int(frames[-1]), reconstructor.window)
    part = _part(own, frames, pings)
    images = log.images_of(np.flatnonzero(log.survey.frames.trajectory == trajectory)[frames])
    echoes = log.echoes_of(np.flatnonzero(log.survey.pings.trajectory == trajectory)[pings])
    shown = sw.SonarLog(survey=part, images=images, echoes=echoes)
    schedule = reconstructor.plan_schedule(part, frames=FRAMES)
    reconstructor.plan(part, schedule)
    for frame, ping in zip(schedule.round_frame, schedule.round_ping, strict=True):
        reconstructor.step(
            wp.array(shown.images_of(frame), device=device), wp.array(shown.echoes_of(ping), device=device)
        )
    return _read(reconstructor, part, np.arange(len(frames)), np.arange(len(pings)), images, echoes)


def of_trajectory(survey: sw.Survey, trajectory: int) -> sw.Survey:
    """A trajectory's frames and pings, as if it were the only one."""
    own = [np.flatnonzero(instants.trajectory == trajectory) for instants in (survey.frames, survey.pings)]
    part = _part(survey, *own)
    alone = [replace(rows, trajectory=np.zeros_like(rows.trajectory)) for rows in (part.frames, part.pings)]
    return replace(part, frames=alone[0], pings=alone[1])


def _read(
    reconstructor: sw.Reconstructor,
    part: sw.Survey,
    frames: np.ndarray,
    pings: np.ndarray,
    images: np.ndarray,
    echoes: np.ndarray,
) -> Snapshot:
    """What a reconstructor made of some frames and pings, by their indices in its own survey."""
    settings = reconstructor.settings.likelihood_field
    return Snapshot(
        survey=part,
        images=images,
        seabed_range=reconstructor.contacts.seabed_range.numpy()[frames],
        critical_range=reconstructor.contacts.critical_range.numpy()[frames],
        echoes=echoes,
        footprints=reconstructor.footprints.numpy()[pings],
        log_odds=reconstructor.log_odds.numpy()[0],
        clamps=(settings.low, settings.high),
        origin=reconstructor.grid.origin.numpy()[0],
        cell=reconstructor.grid.cell,
    )


def _telling_frames(contacts: np.ndarray) -> np.ndarray:
    """Frames spread over the contacts [frame], or over all where there are none; ascending, without repeats."""
    passed = np.cumsum(contacts if contacts.any() else np.ones_like(contacts))
    return np.unique(np.searchsorted(passed, np.array(_SHARES) * passed[-1]))


def _pings_before(survey: sw.Survey, frame: int, window: int) -> np.ndarray:
    """The last ``window`` pings up to a frame's time, ascending."""
    return np.flatnonzero(survey.pings.time <= survey.frames.time[frame])[-window:]


def _part(survey: sw.Survey, frames: np.ndarray, pings: np.ndarray) -> sw.Survey:
    """Some frames and pings of a survey only."""
    return replace(survey, frames=_rows(survey.frames, frames), pings=_rows(survey.pings, pings))


def _within(schedule: sw.Schedule, frames: np.ndarray, pings: np.ndarray) -> sw.Schedule:
    """The schedule of a survey's part, with the indices that its frames and pings have in the survey."""
    kept = {"frame": np.append(frames, EMPTY), "ping": np.append(pings, EMPTY), "leaving": np.append(pings, EMPTY)}
    indices = {field.name: getattr(schedule, field.name) for field in fields(schedule)}
    return sw.Schedule(**{name: kept[name.split("_")[1]][index] for name, index in indices.items()})


def _rows(instants: Instants, rows: np.ndarray) -> Instants:
    return type(instants)(**{field.name: getattr(instants, field.name)[rows] for field in fields(instants)})
