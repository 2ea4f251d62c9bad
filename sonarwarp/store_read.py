"""Reads a log from disk: the survey at once, images a chunk at a time, nothing that was not complete."""

from __future__ import annotations

import json
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sonarwarp.log import SonarLog
from sonarwarp.schedule import EMPTY
from sonarwarp.settings import Noise, ReconstructionSettings
from sonarwarp.sonar import Rig
from sonarwarp.store import (
    CONTACT_VARIABLES,
    CONTACTS,
    ECHOES,
    FLS_COLUMNS,
    IMAGES,
    PS_COLUMNS,
    TRUTH_COLUMNS,
    TRUTHS,
    VERSION,
    VERSION_ATTRIBUTE,
    StoreError,
    Variable,
    dimensions,
    refusing,
)
from sonarwarp.survey import Frames, Pings, Survey
from sonarwarp.toml_settings import parse_noise, parse_rig, parse_settings
from sonarwarp.truth import FirstContacts

# Chunks kept of each array: neighbouring rounds share one, and a few trajectories may take turns.
_KEPT = 4

# Largest chunk that is opened [byte]. Ours are 8 MiB; a damaged size must not ask for all memory.
_LARGEST_CHUNK = 1 << 30

_WAY_OUT = "write the log anew, or restore it from a copy"

_OTHER_SETTINGS = "give others: `sonarwarp reconstruct LOG --out OUT --settings FILE`, or settings= in code"


def open_log(path: str | Path) -> StoredLog:
    """Open a log on disk, also one that is being written or whose writer was killed: what is complete of it.

    Raises:
        StoreError: nothing there, something else than a log, another version, or a log that is damaged, its
            reconstruction settings excepted.
    """
    return StoredLog(path)


class StoredLog:
    """A log on disk; a ``sonarwarp.log.Log`` that ``reconstruct`` takes.

    Args:
        path: what a ``StoreWriter`` wrote.

    Raises:
        StoreError: see :func:`open_log`.
    """

    survey: Survey
    """Rig, times and the poses that navigation gives, of the frames and pings that are complete."""

    frames_planned: int
    """Frames of the whole log; ``len(survey.frames)`` of them are complete."""

    pings_planned: int
    """Pings of the whole log; ``len(survey.pings)`` of them are complete."""

    truth: Survey | None
    """The same frames and pings with their true poses, of a simulation."""

    noise: Noise | None
    """What a simulation added to the echoes."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        attributes = _root_attributes(self.path)
        with refusing(self.path, "rig or noise cannot be read", _WAY_OUT):
            rig = parse_rig(attributes["rig"], "rig")
            self.noise = parse_noise(attributes["noise"], "noise") if "noise" in attributes else None
        self._settings_text = attributes.get("reconstruction")
        truth = attributes.get("truth")
        if truth not in TRUTHS:
            raise StoreError(f"{self.path}: truth: {truth!r}, must be one of {TRUTHS}; {_WAY_OUT}")
        arrays = _Arrays(self.path, rig)
        self.frames_planned, self.pings_planned = arrays.rows["frame"], arrays.rows["ping"]
        complete = {
            "frame": _count(self.path, attributes, "frames_complete", self.frames_planned),
            "ping": _count(self.path, attributes, "pings_complete", self.pings_planned),
        }
        self._images = arrays.rows_of("fls", IMAGES, complete)
        self._echoes = arrays.rows_of("ps", ECHOES, complete)
        with refusing(self.path, "survey cannot be read", _WAY_OUT):
            self.survey = _survey(rig, arrays, complete)
            self.truth = None if truth == TRUTHS[0] else _true_survey(self.survey, arrays, complete)
        met = CONTACT_VARIABLES if truth == TRUTHS[2] else ()
        self._contacts = [arrays.rows_of("truth", variable, complete) for variable in met]

    @property
    def reconstruction(self) -> ReconstructionSettings | None:
        """Settings that go with the log, or None.

        Read when they are asked for: recorded images must not be lost with a setting that this version does not know.

        Raises:
            StoreError: a setting that is unknown or out of bounds, or a text that is damaged.
        """
        if self._settings_text is None:
            return None
        with refusing(self.path, "its settings cannot be read", _OTHER_SETTINGS):
            return parse_settings(self._settings_text, "reconstruction")

    @property
    def complete(self) -> bool:
        """Whether everything planned was written."""
        planned = (self.frames_planned, self.pings_planned)
        return (len(self.survey.frames), len(self.survey.pings)) == planned

    @property
    def has_contacts(self) -> bool:
        """Whether first contacts were written."""
        return bool(self._contacts)

    def images_of(self, frames: np.ndarray) -> np.ndarray:
        """As ``sonarwarp.log.Log.images_of``.

        Raises:
            StoreError: a chunk that is missing or damaged.
            ValueError: a frame that is not complete.
        """
        return self._images.gather(frames)

    def echoes_of(self, pings: np.ndarray) -> np.ndarray:
        """As ``sonarwarp.log.Log.echoes_of``; raises as :meth:`images_of`."""
        return self._echoes.gather(pings)

    def contacts_of(self, frames: np.ndarray) -> FirstContacts:
        """First contacts of some frames; raises as :meth:`images_of` and where the log has none."""
        if not self._contacts:
            raise StoreError(f"{self.path}: no first contacts, simulate it with truth")
        values = [rows.gather(frames) for rows in self._contacts]
        return FirstContacts(**dict(zip(CONTACTS, values, strict=True)))

    def image_chunks(self) -> Iterator[tuple[int, np.ndarray]]:
        """First frame and images [frame, beam, bin] of each chunk on disk in turn."""
        return self._images.chunks()

    def echo_chunks(self) -> Iterator[tuple[int, np.ndarray]]:
        """First ping and echo profiles [ping, bin] of each chunk on disk in turn."""
        return self._echoes.chunks()

    def load(self) -> SonarLog:
        """All that is complete, in memory."""
        frames, pings = np.arange(len(self.survey.frames)), np.arange(len(self.survey.pings))
        images, echoes = self.images_of(frames), self.echoes_of(pings)
        return SonarLog(survey=self.survey, images=images, echoes=echoes, truth=self.truth)


class _Rows:
    """Rows of an array on disk, of which the chunks last used are kept."""

    def __init__(self, path: Path, array: Any, complete: int) -> None:
        self._path = path
        self._array = array
        self.complete = complete
        self._kept: OrderedDict[int, np.ndarray] = OrderedDict()

    def chunk(self, number: int) -> np.ndarray:
        """Complete rows of a chunk."""
        if number in self._kept:
            self._kept.move_to_end(number)
            return self._kept[number]
        height = self._array.chunks[0]
        first = number * height
        if len(self._kept) == _KEPT:
            self._kept.popitem(last=False)
        with refusing(self._path, f"rows from {first} cannot be read", _WAY_OUT):
            rows = self._array[first : min(first + height, self.complete)]
        if _holes(rows):
            raise StoreError(f"{self._path}: rows from {first}: a chunk is missing or damaged; {_WAY_OUT}")
        self._kept[number] = rows
        return rows

    def gather(self, index: np.ndarray) -> np.ndarray:
        """Rows of some indices, zero for ``EMPTY``."""
        index = np.asarray(index)
        wrong = (index != EMPTY) & ((index < 0) | (index >= self.complete))
        if wrong.any():
            raise ValueError(f"{self._path}: row {index[wrong][0]}, must be below the {self.complete} complete")
        out = np.zeros((len(index), *self._array.shape[1:]), dtype=self._array.dtype)
        height = self._array.chunks[0]
        owner = np.where(index == EMPTY, EMPTY, index // height)
        for number in np.unique(owner[owner != EMPTY]):
            mine = owner == number
            out[mine] = self.chunk(int(number))[index[mine] - number * height]
        return out

    def chunks(self) -> Iterator[tuple[int, np.ndarray]]:
        """First row and rows of each chunk."""
        height = self._array.chunks[0]
        for first in range(0, self.complete, height):
            yield first, self.chunk(first // height)


def _holes(rows: np.ndarray) -> bool:
    """Whether rows hold what no writer writes: the fill value of what was never written."""
    if rows.dtype.kind == "f":
        return bool(np.isnan(rows).any())
    return bool((rows == -2).any())


class _Arrays:
    """Arrays of a log, each checked against the layout before anything is read of it."""

    def __init__(self, path: Path, rig: Rig) -> None:
        import zarr
        from zarr.storage import LocalStore

        self._path = path
        with refusing(path, "cannot be opened", _WAY_OUT):
            root: Any = zarr.open_group(LocalStore(path, read_only=True), mode="r", use_consolidated=False)
        self._root = root
        self._rig = rig
        self.rows = {"frame": self._length("fls"), "ping": self._length("ps")}

    def _length(self, group: str) -> int:
        with refusing(self._path / group / "ping_time", "cannot be opened", _WAY_OUT):
            return int(self._root[f"{group}/ping_time"].shape[0])

    def _opened(self, group: str, variable: Variable) -> Any:
        path = self._path / group / variable.name
        with refusing(path, "cannot be opened", _WAY_OUT):
            array = self._root[f"{group}/{variable.name}"]
            shape, dtype, chunks = tuple(array.shape), np.dtype(array.dtype), tuple(array.chunks)
        sizes = dimensions(self._rig, group, self.rows["frame"], self.rows["ping"])
        wanted = variable.shape(sizes)
        if shape != wanted:
            raise StoreError(f"{path}: shape {shape}, must be {wanted} for the rig and the times; {_WAY_OUT}")
        if dtype != np.dtype(variable.dtype):
            raise StoreError(f"{path}: dtype {dtype}, must be {np.dtype(variable.dtype)}; {_WAY_OUT}")
        size = int(np.prod(chunks, dtype=object)) * dtype.itemsize
        if size > _LARGEST_CHUNK or chunks[0] < 1 or chunks[1:] != wanted[1:]:
            raise StoreError(f"{path}: chunks of {chunks}, must be whole rows and at most 1 GiB; {_WAY_OUT}")
        return array

    def rows_of(self, group: str, variable: Variable, complete: dict[str, int]) -> _Rows:
        """Rows that are read as they are asked for."""
        return _Rows(self._path / group / variable.name, self._opened(group, variable), complete[variable.dims[0]])

    def column(self, group: str, name: str, complete: dict[str, int]) -> np.ndarray:
        """Complete rows of an array."""
        rows = self.rows_of(group, _COLUMNS[group][name], complete)
        return rows.gather(np.arange(rows.complete))

    def poses(self, group: str, prefix: str, complete: dict[str, int]) -> np.ndarray:
        """Complete poses, shape [row, 7]."""
        parts = [self.column(group, f"{prefix}_{part}", complete) for part in ("position", "quaternion")]
        return np.concatenate(parts, axis=1)


_COLUMNS = {
    group: {variable.name: variable for variable in columns}
    for group, columns in (("fls", FLS_COLUMNS), ("ps", PS_COLUMNS), ("truth", TRUTH_COLUMNS))
}


def _survey(rig: Rig, arrays: _Arrays, complete: dict[str, int]) -> Survey:
    def instants(group: str) -> dict[str, np.ndarray]:
        names = {"time": "ping_time", "trajectory": "trajectory", "number": "number"}
        columns = {key: arrays.column(group, name, complete) for key, name in names.items()}
        return columns | {"pose": arrays.poses(group, "sensor", complete)}

    return Survey(
        rig=rig,
        frames=Frames(**instants("fls"), altitude=arrays.column("fls", "altitude", complete)),
        pings=Pings(**instants("ps"), head_angle=arrays.column("ps", "head_angle", complete)),
    )


def _true_survey(believed: Survey, arrays: _Arrays, complete: dict[str, int]) -> Survey:
    frames = replace(
        believed.frames,
        pose=arrays.poses("truth", "frame", complete),
        altitude=arrays.column("truth", "altitude", complete),
    )
    pings = replace(
        believed.pings,
        pose=arrays.poses("truth", "ping", complete),
        head_angle=arrays.column("truth", "head_angle", complete),
    )
    return replace(believed, frames=frames, pings=pings)


def _root_attributes(path: Path) -> dict[str, Any]:
    """Attributes of a log of this version."""
    if not path.is_dir():
        raise StoreError(f"{path}: no such log, must be a folder that `sonarwarp simulate` or a StoreWriter wrote")
    with refusing(path / "zarr.json", "cannot be read", _WAY_OUT):
        root = json.loads((path / "zarr.json").read_text(encoding="utf-8"))
        version = root["attributes"].get(VERSION_ATTRIBUTE)
    if version != VERSION:
        raise StoreError(
            f"{path}: {VERSION_ATTRIBUTE}: {version!r}, must be {VERSION}; "
            "read it with the sonarwarp that wrote it, if any did"
        )
    return root["attributes"]


def _count(path: Path, attributes: dict[str, Any], name: str, planned: int) -> int:
    value = attributes.get(name)
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= planned:
        raise StoreError(f"{path}: {name}: {value!r}, must be a whole number from 0 to {planned}; {_WAY_OUT}")
    return value
