"""Trajectories from text files and back: CSV with a header, and the TUM format of SLAM benchmarks.

CSV: columns ``t``, ``x``, ``y``, ``z`` and an attitude, either ``qx``, ``qy``, ``qz``, ``qw`` or ``roll``, ``pitch``,
``yaw`` [rad], each of which may end in ``_deg`` instead [deg]; in any order, other columns are ignored. TUM: lines of
``timestamp tx ty tz qx qy qz qw`` apart by blanks; lines that begin with a number sign are comments.

Seconds and metres. The world has z up, the vehicle x forward, y left, z up; angles turn about x, y and z by the right
hand, yaw outermost (Eq. 35), so that a positive pitch lowers the bow. Attitudes are world from vehicle. A quaternion
within 0.001 of unit length is normalised: files carry few digits.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from sonarwarp.durable import replace_text
from sonarwarp.poses import turned
from sonarwarp_scenes import Trajectory

_POSITION = ("t", "x", "y", "z")
_QUATERNION = ("qx", "qy", "qz", "qw")
_ANGLES = ("roll", "pitch", "yaw")

# Furthest from unit length that counts as rounding, as in ``Trajectory``.
_UNIT_TOLERANCE = 1e-3

# Latest time that is one in seconds and no count of nanoseconds: the year 2262 [s].
_LATEST = 9.2e9

_LEVEL = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])

Record = tuple[int, list[str]]
"""A line's number in its file, from 1, and its fields."""


def read_trajectory(path: str | Path) -> Trajectory:
    """Read a trajectory by what its file's name ends in: ``.csv``, or ``.tum`` and ``.txt``.

    Raises:
        ValueError: another ending; a file that cannot be read; a missing column or field; a value that is no finite
            number; times that do not increase; a quaternion that is not of unit length; a position beyond 10 km of the
            origin. The message names file, line, field, value and bound.
    """
    ending = Path(path).suffix.lower()
    if ending == ".csv":
        return read_csv(path)
    if ending in (".tum", ".txt"):
        return read_tum(path)
    raise ValueError(f"{path}: ends in {ending!r}, must be .csv for CSV or .tum or .txt for TUM; rename it")


def read_csv(path: str | Path) -> Trajectory:
    """Read a CSV file; raises as :func:`read_trajectory`."""
    text = _read_text(path)
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    records = _csv_records(path, reader)
    try:
        line, header = next(records)
    except StopIteration:
        raise ValueError(f"{path}: empty, must begin with a header such as t,x,y,z,qx,qy,qz,qw") from None
    names = [name.strip().lower() for name in header]
    wanted = _wanted_columns(f"{path}:{line}", names)
    lines, values = _numbers(path, records, wanted, [names.index(name) for name in wanted], len(names))
    column = dict(zip(wanted, values.T, strict=True))
    if "qx" in column:
        quaternion = _unit_quaternions(path, lines, np.stack([column[name] for name in _QUATERNION], axis=1))
    else:
        angles = [np.radians(column[f"{name}_deg"]) if f"{name}_deg" in column else column[name] for name in _ANGLES]
        quaternion = turned(_LEVEL, np.stack(angles, axis=1))[:, 3:]
    return _trajectory(path, lines, values[:, :4], quaternion)


def read_tum(path: str | Path) -> Trajectory:
    """Read a TUM file; raises as :func:`read_trajectory`."""
    rows = ((number, line.split()) for number, line in enumerate(_read_text(path).splitlines(), 1))
    records = ((number, fields) for number, fields in rows if fields and not fields[0].startswith("#"))
    wanted = ("timestamp", "tx", "ty", "tz", *_QUATERNION)
    lines, values = _numbers(path, records, wanted, list(range(8)), 8)
    return _trajectory(path, lines, values[:, :4], _unit_quaternions(path, lines, values[:, 4:]))


def write_csv(trajectory: Trajectory, path: str | Path) -> None:
    """Write a CSV file with quaternions; reading it gives the same times and positions to the bit.

    Raises:
        ValueError: a file that cannot be written.
    """
    header = ",".join((*_POSITION, *_QUATERNION))
    _write_text(path, [header, *(",".join(fields) for fields in _fields(trajectory))])


def write_tum(trajectory: Trajectory, path: str | Path) -> None:
    """Write a TUM file; as :func:`write_csv` otherwise."""
    header = "# timestamp tx ty tz qx qy qz qw"
    _write_text(path, [header, *(" ".join(fields) for fields in _fields(trajectory))])


def _fields(trajectory: Trajectory) -> Iterator[list[str]]:
    for row in np.column_stack([trajectory.times, trajectory.poses]).tolist():
        yield [repr(value) for value in row]


def _write_text(path: str | Path, lines: Iterable[str]) -> None:
    try:
        replace_text(Path(path), "\n".join(lines) + "\n")
    except OSError as error:
        raise ValueError(f"{path}: cannot be written: {error.strerror or error}; choose another place") from error


def _read_text(path: str | Path) -> str:
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror or error}, must be a readable trajectory file") from error
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: byte {error.start} is not UTF-8, must be a text file") from error


def _csv_records(path: str | Path, reader: Iterator[list[str]]) -> Iterator[Record]:
    line = 0
    try:
        for fields in reader:
            line = reader.line_num  # type: ignore[attr-defined]
            if any(field.strip() for field in fields):
                yield line, fields
    except csv.Error as error:
        raise ValueError(f"{path}:{line + 1}: not CSV: {error}; write plain numbers apart by commas") from error


def _wanted_columns(where: str, names: list[str]) -> tuple[str, ...]:
    """The columns that make a trajectory, time and position first."""

    def choose(name: str) -> str:
        found = [option for option in (name, f"{name}_deg") if option in names]
        if len(found) == 1:
            return found[0]
        problem = "missing" if not found else f"given as {' and '.join(found)}"
        raise ValueError(f"{where}: column {name}: {problem}, must be there once: qx,qy,qz,qw or roll,pitch,yaw")

    angles = [name for name in names if name.removesuffix("_deg") in _ANGLES]
    given = [name for name in names if name in _QUATERNION]
    if angles and given:
        raise ValueError(f"{where}: columns {given[0]} and {angles[0]}: two attitudes, must be one; drop one")
    wanted = (*_POSITION, *(tuple(map(choose, _ANGLES)) if angles else _QUATERNION))
    for name in wanted:
        if names.count(name) != 1:
            problem = "missing" if name not in names else f"given {names.count(name)} times"
            shown = ", ".join(map(_shown, names))
            raise ValueError(f"{where}: column {name}: {problem}, must be there once; columns are {shown}")
    return wanted


def _numbers(
    path: str | Path, records: Iterable[Record], names: tuple[str, ...], place: list[int], width: int
) -> tuple[np.ndarray, np.ndarray]:
    """Line of each record, shape [record], and its numbers ``names`` at ``place``, shape [record, name]."""
    lines, rows = [], []
    for line, fields in records:
        if len(fields) != width:
            raise ValueError(f"{path}:{line}: {len(fields)} fields, must be {width}")
        row = []
        for name, field in zip(names, (fields[index] for index in place), strict=True):
            try:
                value = float(field.replace("_", "?"))  # to Python, 1_5 is 15
            except ValueError:
                raise ValueError(f"{path}:{line}: {name}: {_shown(field)}, must be a number") from None
            if not np.isfinite(value):
                raise ValueError(f"{path}:{line}: {name}: {value}, must be finite; drop the line")
            row.append(value)
        lines.append(line)
        rows.append(row)
    if not rows:
        raise ValueError(f"{path}: no poses, must be at least 1")
    return np.array(lines), np.array(rows)


def _shown(field: str) -> str:
    return repr(field if len(field) <= 40 else f"{field[:37]}...")


def _unit_quaternions(path: str | Path, lines: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    with np.errstate(over="ignore"):
        length = np.linalg.norm(quaternion, axis=1)
    wrong = np.flatnonzero(~(np.abs(length - 1.0) <= _UNIT_TOLERANCE))
    if wrong.size:
        raise ValueError(
            f"{path}:{lines[wrong[0]]}: qx,qy,qz,qw: length {length[wrong[0]]:.6g}, "
            f"must be within {_UNIT_TOLERANCE:g} of 1; the order is x, y, z, w"
        )
    return quaternion


def _trajectory(path: str | Path, lines: np.ndarray, placed: np.ndarray, quaternion: np.ndarray) -> Trajectory:
    times = placed[:, 0]
    far = np.flatnonzero(np.abs(times) > _LATEST)
    if far.size:
        raise ValueError(
            f"{path}:{lines[far[0]]}: t: {times[far[0]]:g}, must be within {_LATEST:g} s; give seconds, not nanoseconds"
        )
    late = np.flatnonzero(np.diff(times) <= 0.0)
    if late.size:
        before, now = times[late[0]], times[late[0] + 1]
        problem = "repeats" if before == now else "comes after"
        raise ValueError(
            f"{path}:{lines[late[0] + 1]}: t: {now:.17g} s {problem} {before:.17g} s, must increase; "
            "sort the lines and keep one of each time"
        )
    try:
        return Trajectory(times=times, poses=np.column_stack([placed[:, 1:], quaternion]))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
