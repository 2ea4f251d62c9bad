"""Writes a log to disk, a chunk at a time: nothing that is complete is lost, whatever stops the writer."""

from __future__ import annotations

import json
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from sonarwarp.durable import replace_text, settle
from sonarwarp.log import SonarLog, check_amplitudes
from sonarwarp.settings import Noise, ReconstructionSettings
from sonarwarp.store import CONTACT_VARIABLES, CONTACTS, ECHOES, IMAGES, StoreError, refusing
from sonarwarp.store_create import create_log
from sonarwarp.survey import Survey
from sonarwarp.truth import FirstContacts


class StoreWriter:
    """A log on disk that grows by frames and pings, in the survey's order; a context manager.

    Leaving the context writes what is pending, also when an exception or Ctrl-C ends it.

    Args:
        path: where to; a folder that does not exist yet.
        survey: what will be written, all of it, with the poses that navigation gives.
        truth: the same frames and pings with their true poses, of a simulation.
        contacts: whether first contacts come with the images.
        noise: of a simulation, to be read back.
        reconstruction: settings that go with the log, to be read back.
        overwrite: whether an older log may be replaced. Anything else in its place never is.

    Raises:
        StoreError: something at ``path`` already, a folder that is missing or cannot be written, or a survey with times
            that are no time stamps or with other rows than ``truth``.
    """

    def __init__(
        self,
        path: str | Path,
        survey: Survey,
        *,
        truth: Survey | None = None,
        contacts: bool = False,
        noise: Noise | None = None,
        reconstruction: ReconstructionSettings | None = None,
        overwrite: bool = False,
    ) -> None:
        self.path = Path(path)
        self.survey = survey
        create_log(
            self.path,
            survey,
            truth=truth,
            contacts=contacts,
            noise=noise,
            reconstruction=reconstruction,
            overwrite=overwrite,
        )
        self._open_arrays(contacts)
        self._closed = False

    def _open_arrays(self, contacts: bool) -> None:
        self._root = json.loads((self.path / "zarr.json").read_text(encoding="utf-8"))
        self._images = _Rows(self.path, f"fls/{IMAGES.name}")
        self._echoes = _Rows(self.path, f"ps/{ECHOES.name}")
        self._contacts = [_Rows(self.path, f"truth/{variable.name}") for variable in CONTACT_VARIABLES if contacts]

    @property
    def frames_complete(self) -> int:
        """Frames on disk."""
        return min(rows.written for rows in (self._images, *self._contacts))

    @property
    def pings_complete(self) -> int:
        """Pings on disk."""
        return self._echoes.written

    def append(self, images: np.ndarray, echoes: np.ndarray, contacts: FirstContacts | None = None) -> None:
        """Take the next frames and pings, and write every chunk that they fill.

        Args:
            images: FLS images, float32, shape [frame, beam, bin].
            echoes: PS echo profiles, float32, shape [ping, bin]; all that were sent before these frames must come with
                them or earlier.
            contacts: first contacts of these frames, if the log was begun with them.

        Raises:
            ValueError: images or echoes of another type or shape, not finite, or more than the survey has.
            StoreError: a full disk or another failure of writing; what was complete before stays so.
        """
        if self._closed:
            raise StoreError(f"{self.path}: closed, open another log to write on")
        images, echoes = np.asarray(images), np.asarray(echoes)
        self._images.check("images", images)
        self._echoes.check("echoes", echoes)
        given = _checked_contacts(contacts, len(images), self.survey.rig.fls.beams, bool(self._contacts))
        # A frame is weighed against the pings before it: they are on disk before the frame counts.
        at = 0
        while at < len(echoes):
            at += self._echoes.take(echoes[at:])
            if self._echoes.full:
                self._write(self._echoes)
        at = 0
        while at < len(images):
            taken = self._images.take(images[at:])
            for rows, values in zip(self._contacts, given, strict=True):
                rows.take(values[at : at + taken])
            at += taken
            if self._images.full:
                self._write(self._echoes, self._images, *self._contacts)

    def close(self) -> None:
        """Write what is pending. A log can be closed early: it says how far it came."""
        if not self._closed:
            self._write(self._echoes, self._images, *self._contacts)
            self._closed = True

    def _write(self, *rows: _Rows) -> None:
        done = f"{self.frames_complete} of {self._images.planned} frames are complete and stay so"
        try:
            with refusing(self.path, "cannot be written on", f"{done}; free space or choose another disk"):
                for each in rows:
                    each.write()
                attributes = self._root["attributes"]
                attributes["frames_complete"], attributes["pings_complete"] = self.frames_complete, self.pings_complete
                replace_text(self.path / "zarr.json", json.dumps(self._root, indent=2))
        except StoreError:
            self._closed = True
            raise

    def __enter__(self) -> StoreWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        try:
            self.close()
        except KeyboardInterrupt as interrupt:
            error = interrupt
            self.close()
            raise
        finally:
            if error is not None:
                done = f"{self.frames_complete} of {self._images.planned} frames"
                error.add_note(f"after {done}; {self.path} can be read")


class _Rows:
    """Rows of one array on disk, held back until they fill a chunk."""

    def __init__(self, path: Path, name: str) -> None:
        import zarr
        from zarr.storage import LocalStore

        array: Any = zarr.open_array(LocalStore(path), path=name, mode="r+")
        self._array = array
        self._folder = path / name
        self._chunk = np.empty(array.chunks, dtype=array.dtype)
        self.planned = int(array.shape[0])
        self.taken = 0
        self.written = 0

    @property
    def full(self) -> bool:
        return self.taken > self.written and self.taken % len(self._chunk) == 0

    def check(self, name: str, values: np.ndarray) -> None:
        """Refuse amplitudes that are not this array's next rows."""
        count = len(values) if values.ndim else 0
        check_amplitudes(name, values, (count, *self._chunk.shape[1:]))
        if self.taken + count > self.planned:
            raise ValueError(
                f"{name}: {self.taken + count} with those before, must be at most the {self.planned} planned"
            )

    def take(self, values: np.ndarray) -> int:
        """Hold the first of some rows, as many as the chunk has room for; their number."""
        start = self.taken % len(self._chunk)
        count = min(len(self._chunk) - start, len(values))
        self._chunk[start : start + count] = values[:count]
        self.taken += count
        return count

    def write(self) -> None:
        """Write what is held of the last chunk."""
        if self.written < self.taken:
            number = (self.taken - 1) // len(self._chunk)
            first = number * len(self._chunk)
            self._array[first : self.taken] = self._chunk[: self.taken - first]
            settle(self._folder / "c" / str(number))
            self.written = self.taken


def log_to_store(
    log: SonarLog,
    path: str | Path,
    *,
    noise: Noise | None = None,
    reconstruction: ReconstructionSettings | None = None,
    overwrite: bool = False,
) -> None:
    """Write a log in memory, with its truth, to disk in its own order; arguments and errors: :class:`StoreWriter`."""
    with StoreWriter(
        path, log.survey, truth=log.truth, noise=noise, reconstruction=reconstruction, overwrite=overwrite
    ) as writer:
        writer.append(log.images, log.echoes)


def _checked_contacts(contacts: FirstContacts | None, frames: int, beams: int, wanted: bool) -> tuple[np.ndarray, ...]:
    if wanted != (contacts is not None):
        raise ValueError(f"contacts: {'missing' if wanted else 'given'}, must be as the log was begun")
    if contacts is None:
        return ()
    values = tuple(getattr(contacts, name) for name in CONTACTS)
    for name, array in zip(CONTACTS, values, strict=True):
        if array.shape != (frames, beams):
            raise ValueError(f"contacts.{name}: expected shape ({frames}, {beams}), got {array.shape}")
        if np.isnan(array).any():
            raise ValueError(f"contacts.{name}: nan, must be a number")
    return values
