"""In which order frames and pings of a batch are worked on, and how many at a time.

A round is one step of the drivers: its frames and pings are formed and searched together. Within a round, epochs keep
the order in time that the fields need: at most one ping per trajectory, then the frames up to the next one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sonarwarp.sonar import Rig
from sonarwarp.survey import Survey, group_rows

EMPTY = -1
"""Index of an empty slot, as in ``sonarwarp_kernels.slots``."""

# Per pixel of a frame in a round: counts and image, 4 bytes each, and about as much of forming scratch.
_BYTES_PER_PIXEL = 16


@dataclass(frozen=True, kw_only=True, eq=False)
class Schedule:
    """Indices of frames and pings by round and epoch, ``EMPTY`` in unused slots."""

    round_frame: np.ndarray
    """Frames of each round, shape [round, frame slot]."""
    round_ping: np.ndarray
    """Pings of each round, shape [round, ping slot]."""
    epoch_frame: np.ndarray
    """Frames of each epoch, shape [round, epoch, frame slot]."""
    epoch_ping: np.ndarray
    """Pings that enter the fields before those frames, shape [round, epoch, ping slot]."""
    epoch_leaving: np.ndarray
    """Pings that leave the fields' windows at the same time, shape [round, epoch, ping slot]."""

    @property
    def rounds(self) -> int:
        """Number of rounds."""
        return len(self.round_frame)


def frames_per_round(rig: Rig, memory: int) -> int:
    """Frames that fit into ``memory`` bytes of images and scratch.

    Raises:
        ValueError: not even one frame fits.
    """
    frame = rig.fls.beams * rig.fls.bins * _BYTES_PER_PIXEL
    if memory < frame:
        raise ValueError(f"memory: {memory} bytes, must be at least {frame} for one frame")
    return memory // frame


def plan_schedule(survey: Survey, *, frames: int, window: int, causal: bool = True) -> Schedule:
    """Order the frames and pings of a survey.

    Args:
        survey: what was recorded.
        frames: most frames in a round; pings follow the same bound.
        window: pings of a trajectory that its field remembers.
        causal: whether a frame is weighed against the pings before it only; otherwise all pings come first, and none
            leaves.
    """
    epochs = _causal_epochs(survey, window) if causal else _offline_epochs(survey)
    rounds = _pack(epochs, frames)
    most_epochs = max((len(members) for members in rounds), default=0)
    frame_slots = max((len(epoch.frames) for epoch in epochs), default=0)
    ping_slots = max((len(epoch.pings) for epoch in epochs), default=0)
    schedule = Schedule(
        round_frame=np.full((len(rounds), _most(rounds, "frames")), EMPTY, dtype=np.int32),
        round_ping=np.full((len(rounds), _most(rounds, "pings")), EMPTY, dtype=np.int32),
        epoch_frame=np.full((len(rounds), most_epochs, frame_slots), EMPTY, dtype=np.int32),
        epoch_ping=np.full((len(rounds), most_epochs, ping_slots), EMPTY, dtype=np.int32),
        epoch_leaving=np.full((len(rounds), most_epochs, ping_slots), EMPTY, dtype=np.int32),
    )
    for row, members in enumerate(rounds):
        for name, table in (("frames", schedule.round_frame), ("pings", schedule.round_ping)):
            index = np.concatenate([getattr(epoch, name) for epoch in members])
            table[row, : len(index)] = index
        for place, epoch in enumerate(members):
            schedule.epoch_frame[row, place, : len(epoch.frames)] = epoch.frames
            schedule.epoch_ping[row, place, : len(epoch.pings)] = epoch.pings
            schedule.epoch_leaving[row, place, : len(epoch.leaving)] = epoch.leaving
    return schedule


@dataclass(frozen=True)
class _Epoch:
    pings: np.ndarray
    leaving: np.ndarray
    frames: np.ndarray


def _most(rounds: list[list[_Epoch]], name: str) -> int:
    return max((sum(len(getattr(epoch, name)) for epoch in members) for members in rounds), default=0)


def _causal_epochs(survey: Survey, window: int) -> list[_Epoch]:
    """Epoch e holds every trajectory's ping e - 1 and the frames after it; epoch 0 the frames before any ping."""
    frames, pings = survey.frames, survey.pings
    frame_epoch = np.zeros(len(frames), dtype=int)
    ping_epoch = np.zeros(len(pings), dtype=int)
    leaving = np.full(len(pings), EMPTY, dtype=int)
    owners = survey.trajectories
    rows = zip(group_rows(pings.trajectory, owners), group_rows(frames.trajectory, owners), strict=True)
    for mine, shown in rows:
        ping_epoch[mine] = np.arange(1, len(mine) + 1)
        leaving[mine[window:]] = mine[: len(mine) - window] if window < len(mine) else []
        frame_epoch[shown] = np.searchsorted(pings.time[mine], frames.time[shown], side="right")
    count = int(max(frame_epoch.max(initial=0), ping_epoch.max(initial=0))) + 1
    frame_lists = group_rows(frame_epoch, count)
    ping_lists = group_rows(ping_epoch, count)
    return [
        _Epoch(mine, leaving[mine][leaving[mine] != EMPTY], shown)
        for mine, shown in zip(ping_lists, frame_lists, strict=True)
        if len(mine) or len(shown)
    ]


def _offline_epochs(survey: Survey) -> list[_Epoch]:
    none = np.zeros(0, dtype=int)
    order = np.zeros(len(survey.pings), dtype=int)
    for mine in group_rows(survey.pings.trajectory, survey.trajectories):
        order[mine] = np.arange(len(mine))
    epochs = [_Epoch(mine, none, none) for mine in group_rows(order, int(order.max(initial=-1)) + 1)]
    return [*epochs, _Epoch(none, none, np.arange(len(survey.frames)))]


def _pack(epochs: list[_Epoch], most: int) -> list[list[_Epoch]]:
    """Rounds of whole epochs; an epoch of more frames than a round holds goes on in the next without its pings."""
    none = np.zeros(0, dtype=int)
    rounds: list[list[_Epoch]] = []
    frames = pings = 0
    for epoch in epochs:
        parts = np.split(epoch.frames, np.arange(most, len(epoch.frames), most))
        for number, part in enumerate(parts):
            piece = _Epoch(epoch.pings, epoch.leaving, part) if number == 0 else _Epoch(none, none, part)
            full = frames + len(part) > most or (pings and pings + len(piece.pings) > most)
            if full or not rounds:
                rounds.append([])
                frames = pings = 0
            rounds[-1].append(piece)
            frames += len(part)
            pings += len(piece.pings)
    return rounds
