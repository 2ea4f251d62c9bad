"""Rigs, noise, motion, navigation and reconstruction settings as commented TOML, which ``toml_settings`` reads.

Comments are the docstrings of the dataclasses and of their fields, read from the source, so that they cannot drift.
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import textwrap
import types
import typing
from typing import Any

import numpy as np

from sonarwarp.edge_steps import EDGE_STEPS
from sonarwarp.navigation import EXACT_NAVIGATION, NO_MOTION, Motion, Navigation
from sonarwarp.settings import NO_NOISE, Noise, ReconstructionSettings
from sonarwarp.sonar import PRESETS, Rig
from sonarwarp.toml_settings import NONE, RIG_TABLES, default_tables, instead

# Width of comments, after the number sign and a space.
_WIDTH = 98


def preset_text(name: str) -> str:
    """A complete, commented file of a preset: rig, reconstruction, and noise, motion and navigation errors.

    The paper's field test has all three of them, its simulation none.

    Raises:
        ValueError: no such preset.
    """
    if name not in PRESETS:
        raise ValueError(f"preset: {name!r}, {instead(name, list(PRESETS))}")
    at_sea = name == "paper field"
    return toml_text(
        rig=PRESETS[name],
        noise=Noise() if at_sea else NO_NOISE,
        motion=Motion() if at_sea else NO_MOTION,
        navigation=Navigation() if at_sea else EXACT_NAVIGATION,
        reconstruction=ReconstructionSettings(),
    )


def toml_text(
    *,
    rig: Rig | None = None,
    noise: Noise | None = None,
    motion: Motion | None = None,
    navigation: Navigation | None = None,
    reconstruction: ReconstructionSettings | None = None,
) -> str:
    """Commented TOML of the parts given; reading it gives equal ones, to the bit."""
    import tomlkit

    given: dict[str, Any] = {} if rig is None else {name: getattr(rig, name) for name in RIG_TABLES}
    added = {"noise": noise, "motion": motion, "navigation": navigation, "reconstruction": reconstruction}
    given |= {name: value for name, value in added.items() if value is not None}
    document = tomlkit.document()
    for name, value in given.items():
        document.add(name, _commented_table(value, default_tables()[name]))
    return tomlkit.dumps(document)


def field_comments(cls: type) -> dict[str, str]:
    """Docstring of each field of a dataclass, as one line, read from its source."""
    body = ast.parse(textwrap.dedent(inspect.getsource(cls))).body[0]
    assert isinstance(body, ast.ClassDef)
    comments = {}
    for statement, after in zip(body.body, body.body[1:], strict=False):
        if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
            text = after.value.value if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) else ""
            comments[statement.target.id] = " ".join(str(text).split())
    return comments


def _commented_table(value: Any, default: Any) -> Any:
    import tomlkit

    cls = type(value)
    comments = field_comments(cls)
    table = tomlkit.table()
    _add_comment(table, inspect.getdoc(cls) or "")
    nested = []
    for key, kind in typing.get_type_hints(cls).items():
        mine = getattr(value, key)
        if dataclasses.is_dataclass(mine):
            nested.append(key)
            continue
        table.add(tomlkit.nl())
        comment = comments.get(key, "")
        _add_comment(table, comment.replace("None", f'"{NONE}"') if isinstance(kind, types.UnionType) else comment)
        steps = EDGE_STEPS[key].values(mine) if key in EDGE_STEPS else None
        if steps is None:
            _add_default(table, key, getattr(default, key))
            table.add(key, _plain(mine))
            continue
        usual = EDGE_STEPS[key].values(getattr(default, key)) or {}
        _add_comment(table, f"Given in equal steps here; {key} = [...] would give all edges.")
        for step, comment in EDGE_STEPS[key].keys.items():
            _add_comment(table, f"{comment} Default: {usual.get(step)}.")
            table.add(step, steps[step])
    for key in nested:
        table.add(tomlkit.nl())
        table.add(key, _commented_table(getattr(value, key), getattr(default, key)))
    return table


def _add_default(table: Any, key: str, default: Any) -> None:
    import tomlkit

    steps = EDGE_STEPS[key].values(default) if key in EDGE_STEPS else None
    if steps is None:
        text = tomlkit.item(_plain(default)).as_string()
    else:
        text = ", ".join(f"{step} = {value}" for step, value in steps.items())
    _add_comment(table, f"Default: {text}.")


def _add_comment(table: Any, text: str) -> None:
    import tomlkit

    for line in textwrap.wrap(" ".join(text.split()), _WIDTH):
        table.add(tomlkit.comment(line))


def _plain(value: Any) -> Any:
    if value is None:
        return NONE
    if isinstance(value, np.ndarray | tuple):
        return np.asarray(value, dtype=np.float64).tolist()
    return value.item() if isinstance(value, np.generic) else value
