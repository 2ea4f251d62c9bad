"""Rigs, noise, motion, navigation and reconstruction settings read from TOML; ``toml_text`` writes them.

A file has the tables ``fls``, ``ps``, ``fls_mount`` and ``ps_mount`` for a rig, ``noise``, ``motion`` and
``navigation`` for what a simulation adds, and ``reconstruction`` with ``reconstruction.detection``,
``.likelihood_field``, ``.mixture``, ``.free_space`` and ``.faces``; keys are the names of the dataclasses' fields. What
a file leaves out keeps its default; without the table ``noise``, ``motion`` or ``navigation`` there is none of it. TOML
has no null: ``"none"`` stands for None. Arrays of edges are written out, or given as equal steps: ``beams`` and
``field_of_view_deg``; ``bins``, ``window_start`` and ``window_length``.
"""

from __future__ import annotations

import dataclasses
import difflib
import re
import tomllib
import types
import typing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sonarwarp.checks import in_range
from sonarwarp.edge_steps import EDGE_STEPS, Steps
from sonarwarp.navigation import EXACT_NAVIGATION, NO_MOTION, Motion, Navigation
from sonarwarp.settings import NO_NOISE, Noise, ReconstructionSettings
from sonarwarp.sonar import Rig

RIG_TABLES = ("fls", "ps", "fls_mount", "ps_mount")
"""Tables that make a rig."""

NONE = "none"
"""What stands for None."""


@dataclass(frozen=True, kw_only=True)
class Configuration:
    """What a file can say."""

    rig: Rig = field(default_factory=Rig)
    noise: Noise = NO_NOISE
    motion: Motion = NO_MOTION
    navigation: Navigation = EXACT_NAVIGATION
    reconstruction: ReconstructionSettings = field(default_factory=ReconstructionSettings)


def read_configuration(path: str | Path) -> Configuration:
    """Everything that a file says.

    Raises:
        ValueError: a file that cannot be read or is no TOML; a table or key that does not exist; a value of the wrong
            type or out of bounds. The message names file, key, value and bound.
    """
    return _parse(_read_text(path), str(path), ())


def read_rig(path: str | Path) -> Rig:
    """The rig of a file, which may hold other tables too; raises as :func:`read_configuration` and without a rig."""
    return parse_rig(_read_text(path), str(path))


def read_noise(path: str | Path) -> Noise:
    """The noise of a file; raises as :func:`read_configuration` and without the table ``noise``."""
    return parse_noise(_read_text(path), str(path))


def read_settings(path: str | Path) -> ReconstructionSettings:
    """Reconstruction settings; raises as :func:`read_configuration` and without the table ``reconstruction``."""
    return parse_settings(_read_text(path), str(path))


def parse_rig(text: str, name: str) -> Rig:
    """:func:`read_rig` of a text; ``name`` is what messages call it."""
    return _parse(text, name, RIG_TABLES).rig


def parse_noise(text: str, name: str) -> Noise:
    """:func:`read_noise` of a text; ``name`` is what messages call it."""
    return _parse(text, name, ("noise",)).noise


def parse_settings(text: str, name: str) -> ReconstructionSettings:
    """:func:`read_settings` of a text; ``name`` is what messages call it."""
    return _parse(text, name, ("reconstruction",)).reconstruction


def _read_text(path: str | Path) -> str:
    try:
        return Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror or error}, must be a readable TOML file") from error
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: byte {error.start} is not UTF-8, must be a TOML file") from error


def default_tables() -> dict[str, Any]:
    """What each table says unless told otherwise."""
    rig = Rig()
    tables: dict[str, Any] = {name: getattr(rig, name) for name in RIG_TABLES}
    added = {"noise": Noise(), "motion": Motion(), "navigation": Navigation()}
    return tables | added | {"reconstruction": ReconstructionSettings()}


def _parse(text: str, name: str, wanted: tuple[str, ...]) -> Configuration:
    """All tables of ``text``, of which one of ``wanted``, if any, must be there."""
    try:
        tables = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{name}: not TOML: {error}") from error
    except (RecursionError, ValueError) as error:  # nested too deep, or a number of thousands of digits
        raise ValueError(f"{name}: not TOML that can be read: {_one_line(error)}") from error
    defaults = default_tables()
    _refuse_unknown(name, "", tables, list(defaults))
    if wanted and not any(table in tables for table in wanted):
        raise ValueError(f"{name}: no table [{wanted[0]}]; add it, or print one with `sonarwarp preset`")
    read = {key: _build(default, tables.get(key, {}), name, key) for key, default in defaults.items()}
    return Configuration(
        rig=Rig(**{key: read[key] for key in RIG_TABLES}),
        noise=read["noise"] if "noise" in tables else NO_NOISE,
        motion=read["motion"] if "motion" in tables else NO_MOTION,
        navigation=read["navigation"] if "navigation" in tables else EXACT_NAVIGATION,
        reconstruction=read["reconstruction"],
    )


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())


def _refuse_unknown(name: str, prefix: str, table: dict[str, Any], known: list[str]) -> None:
    for key in table:
        if key not in known:
            shown = key if key.isprintable() else repr(key)
            raise ValueError(f"{name}: {prefix}{shown}: unknown, {instead(key, known)}")


def instead(word: str, known: list[str]) -> str:
    """The known word that ``word`` was probably meant to be, or all of them, for a message."""
    near = difflib.get_close_matches(word, known, n=1)
    return f"did you mean {near[0]!r}?" if near else f"must be one of {', '.join(known)}"


def _build(default: Any, table: Any, name: str, where: str) -> Any:
    """The dataclass ``default`` with what ``table`` says in place of its own values."""
    if not isinstance(table, dict):
        raise ValueError(f"{name}: {where}: {_shown(table)}, must be a table [{where}]")
    cls = type(default)
    kinds = typing.get_type_hints(cls)
    steps = {array: shape for array, shape in EDGE_STEPS.items() if array in kinds}
    known = [key for array in kinds for key in ([*steps[array].keys, array] if array in steps else [array])]
    _refuse_unknown(name, f"{where}.", table, known)
    values: dict[str, Any] = {}
    for key, kind in kinds.items():
        if key in steps and (given := [step for step in steps[key].keys if step in table]):
            if key in table:
                raise ValueError(f"{name}: {where}.{key}: given together with {given[0]}, must be one or the other")
            values[key] = _edges(steps[key], table, getattr(default, key), name, where)
        elif dataclasses.is_dataclass(kind):
            values[key] = _build(getattr(default, key), table.get(key, {}), name, f"{where}.{key}")
        elif key in table:
            values[key] = _value(table[key], kind, name, f"{where}.{key}")
    try:
        return dataclasses.replace(default, **values)
    except ValueError as error:
        raise ValueError(f"{name}: {re.sub(rf'^{cls.__name__}', where, _one_line(error))}") from error


def _shown(value: Any) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:57]}..."


def _number(value: Any, whole: bool) -> bool:
    if isinstance(value, bool):
        return False
    if isinstance(value, int):
        return abs(value) < 2**63  # as TOML bounds them; tomllib does not
    return isinstance(value, float) and not whole


def _value(value: Any, kind: Any, name: str, where: str) -> Any:
    """``value`` as the type that a field is annotated with."""
    if typing.get_origin(kind) is typing.Literal:
        options = list(typing.get_args(kind))
        if value not in options:
            raise ValueError(f"{name}: {where}: {_shown(value)}, must be one of {', '.join(map(repr, options))}")
        return value
    if isinstance(kind, types.UnionType):  # of a number and None
        if value == NONE:
            return None
        kind = next(option for option in typing.get_args(kind) if option is not types.NoneType)
        hint = f' or "{NONE}"'
    else:
        hint = ""
    length = len(typing.get_args(kind)) if typing.get_origin(kind) is tuple else None
    if kind is np.ndarray or length is not None:
        fits = isinstance(value, list) and all(_number(entry, False) for entry in value)
        if not fits or length not in (None, len(value)):
            size = "an array of" if length is None else f"an array of {length}"
            raise ValueError(f"{name}: {where}: {_shown(value)}, must be {size} numbers")
        return np.array(value, dtype=np.float64) if length is None else tuple(float(entry) for entry in value)
    if kind is bool:
        fits, wanted = isinstance(value, bool), "true or false"
    elif kind is int:
        fits, wanted = _number(value, True), "a whole number"
    else:
        fits, wanted = _number(value, False), "a number"
    if not fits:
        raise ValueError(f"{name}: {where}: {_shown(value)}, must be {wanted}{hint}")
    return kind(value)


def _edges(steps: Steps, table: dict[str, Any], default: np.ndarray, name: str, where: str) -> np.ndarray:
    values = dict(steps.values(default) or {})
    for position, (key, (low, high)) in enumerate(zip(steps.keys, steps.bounds, strict=True)):
        if key in table:
            values[key] = _value(table[key], int if position == 0 else float, name, f"{where}.{key}")
        if key not in values:
            raise ValueError(f"{name}: {where}.{key}: missing, must go with {', '.join(steps.keys)}")
        in_range(f"{name}: {where}.{key}", values[key], low, high)
    return steps.edges(*(values[key] for key in steps.keys))
