"""What a shell offers where TAB is pressed. It runs at every press, so it imports nothing heavy: no presets either."""

from __future__ import annotations

import typer

PRESET_NAMES = ("paper simulation", "paper slope series", "paper field")
"""Names of ``sonarwarp.PRESETS``."""


def complete_preset(context: typer.Context, incomplete: str) -> list[str]:
    """What is left of presets' names after the words that are there: no quotes needed, shells insert none."""
    before = " ".join([*(context.params.get("name") or ()), ""])
    return [name.removeprefix(before) for name in PRESET_NAMES if name.startswith(before + incomplete)]
