"""What both sonars saw at a few instants of a run, and the field then.

A run keeps no images. Randomness is keyed by frame and ping, so that forming those few again gives the same bits.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TypeVar

import numpy as np

import sonarwarp as sw
from sonarwarp.app.experiment import Engines, Run
from sonarwarp.schedule import EMPTY
from sonarwarp_kernels.field import FIXED_POINT

Instants = TypeVar("Instants", sw.Frames, sw.Pings)

# Shares of a run's contacts that lie before the instants shown.
_SHARES = (0.1, 0.4, 0.7)


@dataclass(frozen=True, kw_only=True, eq=False)
class Snapshot:
    """Three frames, the pings that the field remembers at the last of them, and that field."""

    frame: np.ndarray
    """Indices in the run's survey, shape [frame]."""

    images: np.ndarray
    """FLS echo amplitude, shape [frame, beam, bin]."""

    seabed_range: np.ndarray
    """r_emin of every beam [m], shape [frame, beam]."""

    critical_range: np.ndarray
    """Contacts [m], below 0 where a beam has none, shape [frame, beam]."""

    ping: np.ndarray
    """Indices in the run's survey, shape [ping]."""

    echoes: np.ndarray
    """PS echo amplitude, shape [ping, bin]."""

    footprints: np.ndarray
    """(10 % point, centroid, 90 % point) [m], below 0 where unused, shape [ping, footprint, 3]."""

    occupancy: np.ndarray
    """Probability that a cell is occupied (Eq. 22), 1/2 where nothing is known, shape [x, y, z]."""

    origin: np.ndarray
    """Lowest corner of the field [m], shape [3]."""

    cell: float
    """Edge length of a cell [m]."""


def take_snapshot(run: Run) -> Snapshot:
    """Form a few frames of a run again, and every ping that the field remembers at the last of them."""
    engines = Engines(run.experiment, run.device)
    frames = _telling_frames(run.critical_range)
    pings = _pings_before(run.survey, int(frames[-1]), engines.reconstructor.window)
    schedule = _schedule_of(engines, run.survey, frames, pings)
    engines.plan(run.survey, schedule)
    fls, ps = run.experiment.rig.fls, run.experiment.rig.ps
    images = np.empty((len(frames), fls.beams, fls.bins), dtype=np.float32)
    echoes = np.empty((len(pings), ps.bins), dtype=np.float32)
    for frame, ping in zip(schedule.round_frame, schedule.round_ping, strict=True):
        engines.step()
        round_images, round_echoes = engines.simulator.read()
        images[np.searchsorted(frames, frame[frame != EMPTY])] = round_images[frame != EMPTY]
        echoes[np.searchsorted(pings, ping[ping != EMPTY])] = round_echoes[ping != EMPTY]
    reconstructor = engines.reconstructor
    settings = reconstructor.settings.likelihood_field
    log_odds = reconstructor.log_odds.numpy()[0].astype(np.float32) / np.float32(FIXED_POINT)
    log_odds = np.clip(log_odds, settings.low, settings.high)
    return Snapshot(
        frame=frames,
        images=images,
        seabed_range=reconstructor.contacts.seabed_range.numpy()[frames],
        critical_range=reconstructor.contacts.critical_range.numpy()[frames],
        ping=pings,
        echoes=echoes,
        footprints=reconstructor.footprints.numpy()[pings],
        occupancy=1.0 / (1.0 + np.exp(-log_odds)),
        origin=reconstructor.grid.origin.numpy()[0],
        cell=reconstructor.grid.cell,
    )


def _telling_frames(critical_range: np.ndarray) -> np.ndarray:
    """Frames spread over the contacts, or over the whole run where there are none; ascending, without repeats."""
    contacts = (critical_range >= 0.0).sum(axis=1)
    passed = np.cumsum(contacts if contacts.any() else np.ones_like(contacts))
    return np.unique(np.searchsorted(passed, np.array(_SHARES) * passed[-1]))


def _pings_before(survey: sw.Survey, frame: int, window: int) -> np.ndarray:
    """The last ``window`` pings up to a frame's time, ascending."""
    return np.flatnonzero(survey.pings.time <= survey.frames.time[frame])[-window:]


def _schedule_of(engines: Engines, survey: sw.Survey, frames: np.ndarray, pings: np.ndarray) -> sw.Schedule:
    """Rounds that bring some frames and pings of a survey only."""
    part = replace(survey, frames=_rows(survey.frames, frames), pings=_rows(survey.pings, pings))
    schedule = engines.plan_schedule(part)
    kept = {"frame": np.append(frames, EMPTY), "ping": np.append(pings, EMPTY), "leaving": np.append(pings, EMPTY)}
    indices = {field.name: getattr(schedule, field.name) for field in fields(schedule)}
    return sw.Schedule(**{name: kept[name.split("_")[1]][index] for name, index in indices.items()})


def _rows(instants: Instants, rows: np.ndarray) -> Instants:
    return type(instants)(**{field.name: getattr(instants, field.name)[rows] for field in fields(instants)})
