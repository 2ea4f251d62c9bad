"""In which order frames and pings of a batch are worked on, and how many at a time.

A round is one step of the drivers: its frames and pings are formed and searched together. Within a round, epochs keep
the order in time that the fields need: the pings of each trajectory up to some frames, then those frames.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sonarwarp.sonar import Rig
from sonarwarp.survey import Survey, group_rows

EMPTY = -1
"""Index of an empty slot, as in ``sonarwarp_kernels.slots``."""

# Per pixel of a frame in a round: counts and image, 4 bytes each, and about as much of forming scratch.
_BYTES_PER_PIXEL = 16

# Most pings of one trajectory in an epoch. Only a run's start has more before a frame, and offline work.
_DEPTH = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class Schedule:
    """Indices of frames and pings by round and epoch, ``EMPTY`` in unused slots."""

    round_frame: np.ndarray
    """Frames of each round, shape [round, slot]."""
    round_ping: np.ndarray
    """Pings of each round, shape [round, slot]."""
    epoch_frame: np.ndarray
    """Frames of each epoch, shape [round, epoch, slot]."""
    epoch_ping: np.ndarray
    """Pings that enter the fields before those frames, a trajectory a row, shape [round, epoch, row, ping]."""
    epoch_leaving: np.ndarray
    """Pings that leave the fields' windows at the same time, shape [round, epoch, row, ping]."""

    @property
    def rounds(self) -> int:
        """Number of rounds."""
        return len(self.round_frame)

    @property
    def epochs(self) -> int:
        """Epochs in every round, some of them empty."""
        return self.epoch_frame.shape[1]


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
        frames: most frames in a round. Its pings stay within the same number, unless one epoch alone brings more: up
            to 8 of each of as many trajectories, which are small beside images.
        window: pings of a trajectory that its field remembers.
        causal: whether a frame comes after the pings before it and no other; otherwise all pings come first, and none
            leaves.

    Raises:
        ValueError: ``frames`` or ``window`` under 1.
    """
    for name, value in (("frames", frames), ("window", window)):
        if value < 1:
            raise ValueError(f"{name}: {value}, must be at least 1")
    leaving = _leaving(survey, window if causal else len(survey.pings))
    pieces = [piece for epoch in _epochs(survey, causal) for piece in _pieces(epoch, survey, frames)]
    rounds = _pack(pieces, frames)
    most_epochs = max((len(members) for members in rounds), default=0)
    frame_slots = max((len(piece.frames) for piece in pieces), default=0)
    rows = max((piece.pings.shape[0] for piece in pieces), default=0)
    depth = max((piece.pings.shape[1] for piece in pieces), default=0)
    schedule = Schedule(
        round_frame=_empty(len(rounds), max((sum(len(p.frames) for p in members) for members in rounds), default=0)),
        round_ping=_empty(len(rounds), max((sum(p.count for p in members) for members in rounds), default=0)),
        epoch_frame=_empty(len(rounds), most_epochs, frame_slots),
        epoch_ping=_empty(len(rounds), most_epochs, rows, depth),
        epoch_leaving=_empty(len(rounds), most_epochs, rows, depth),
    )
    for number, members in enumerate(rounds):
        shown = np.concatenate([piece.frames for piece in members])
        schedule.round_frame[number, : len(shown)] = shown
        sent = np.concatenate([piece.pings[piece.pings != EMPTY] for piece in members])
        schedule.round_ping[number, : len(sent)] = sent
        for place, piece in enumerate(members):
            schedule.epoch_frame[number, place, : len(piece.frames)] = piece.frames
            high, wide = piece.pings.shape
            schedule.epoch_ping[number, place, :high, :wide] = piece.pings
            schedule.epoch_leaving[number, place, :high, :wide] = np.where(
                piece.pings == EMPTY, EMPTY, leaving[piece.pings]
            )
    return schedule


def check_schedule(schedule: Schedule, survey: Survey) -> None:
    """Refuse a schedule that names frames or pings which a survey has not: kernels would read beyond its arrays.

    Raises:
        ValueError: it was made for another survey.
    """
    for name, table, count in (
        ("frame", schedule.round_frame, len(survey.frames)),
        ("ping", schedule.round_ping, len(survey.pings)),
    ):
        last = int(table.max(initial=EMPTY))
        if last >= count:
            raise ValueError(f"schedule: names {name} {last} of a survey of {count}, was made for another one")


def _empty(*shape: int) -> np.ndarray:
    return np.full(shape, EMPTY, dtype=np.int32)


@dataclass(frozen=True)
class _Epoch:
    pings: np.ndarray
    frames: np.ndarray


@dataclass(frozen=True)
class _Piece:
    """Part of an epoch that fits into slots; ``pings`` has a trajectory a row, shape [row, ping]."""

    pings: np.ndarray
    frames: np.ndarray

    @property
    def count(self) -> int:
        return int((self.pings != EMPTY).sum())


def _leaving(survey: Survey, window: int) -> np.ndarray:
    """The ping that leaves when each one enters: the one ``window`` pings before it, shape [ping], one more at the end
    for ``EMPTY`` to index."""
    leaving = np.full(len(survey.pings) + 1, EMPTY, dtype=int)
    for mine in group_rows(survey.pings.trajectory, survey.trajectories):
        if len(mine) > window:
            leaving[mine[window:]] = mine[:-window]
    return leaving


def _epochs(survey: Survey, causal: bool) -> list[_Epoch]:
    """Epoch e of a trajectory: the pings since its epoch e - 1, then the frames up to its next ping."""
    frames, pings = survey.frames, survey.pings
    if not causal:
        return [_Epoch(np.arange(len(pings)), np.arange(len(frames)))]
    frame_epoch = np.zeros(len(frames), dtype=int)
    ping_epoch = np.zeros(len(pings), dtype=int)
    owners = survey.trajectories
    for mine, shown in zip(group_rows(pings.trajectory, owners), group_rows(frames.trajectory, owners), strict=True):
        before = np.searchsorted(pings.time[mine], frames.time[shown], side="right")
        cuts = np.unique(before)
        frame_epoch[shown] = np.searchsorted(cuts, before)
        ping_epoch[mine] = np.searchsorted(cuts, np.arange(1, len(mine) + 1))
    count = int(max(frame_epoch.max(initial=-1), ping_epoch.max(initial=-1))) + 1
    return [
        _Epoch(sent, shown)
        for sent, shown in zip(group_rows(ping_epoch, count), group_rows(frame_epoch, count), strict=True)
    ]


def _pieces(epoch: _Epoch, survey: Survey, most: int) -> Iterator[_Piece]:
    """An epoch's pings in pieces of bounded depth and rows, the frames with the last and, if too many, after it."""
    owner = survey.pings.trajectory[epoch.pings]
    rows = [epoch.pings[index] for index in group_rows(owner, survey.trajectories) if len(index)]
    parts = [
        _matrix([row[start : start + _DEPTH] for row in chunk if len(row) > start])
        for chunk in _chunks(rows, most)
        for start in range(0, max(len(row) for row in chunk), _DEPTH)
    ]
    none = _empty(0, 0)
    frames = _chunks(epoch.frames, most) or [epoch.frames]
    for part in parts[:-1]:
        yield _Piece(part, epoch.frames[:0])
    yield _Piece(parts[-1] if parts else none, frames[0])
    for part in frames[1:]:
        yield _Piece(none, part)


def _chunks(items, size: int) -> list:
    return [items[start : start + size] for start in range(0, len(items), size)]


def _matrix(rows: list[np.ndarray]) -> np.ndarray:
    matrix = _empty(len(rows), max(len(row) for row in rows))
    for place, row in enumerate(rows):
        matrix[place, : len(row)] = row
    return matrix


def _pack(pieces: list[_Piece], most: int) -> list[list[_Piece]]:
    """Rounds of pieces in order, up to ``most`` frames each.

    Every round costs as many epochs' launches as the fullest one, so rounds of pings alone are kept as short as those
    that their frames fill.
    """
    filled = [len(piece.frames) for piece in pieces if len(piece.frames)]
    most_epochs = max(-(-most // int(np.median(filled))), 1) if filled else most
    rounds: list[list[_Piece]] = []
    frames = pings = 0
    for piece in pieces:
        full = frames + len(piece.frames) > most or (pings and pings + piece.count > most)
        if not rounds or full or len(rounds[-1]) == most_epochs:
            rounds.append([])
            frames = pings = 0
        rounds[-1].append(piece)
        frames += len(piece.frames)
        pings += piece.count
    return rounds
