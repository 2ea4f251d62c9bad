"""Results and presets as tables for people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from sonarwarp.app.paper_printed import FIELD_TEST

if TYPE_CHECKING:
    from rich.table import Table

# Key, heading in two lines so that 80 columns hold a table, format.
_SECTION_COLUMNS = (
    ("slope_deg", "slope\n(deg)", ".2f"),
    ("slope_error", "slope\nerror", ".3f"),
    ("front_coverage", "front\ncover", ".2f"),
    ("area_error", "area\nerror", ".3f"),
    ("volume_error", "volume\nerror", ".3f"),
)

_MESH_COLUMNS = (
    ("points", "\npoints", "d"),
    ("accuracy_mean", "mean\n(m)", ".3f"),
    ("accuracy_rms", "RMS\n(m)", ".3f"),
    ("accuracy_p95", "95 %\n(m)", ".3f"),
    ("precision", "of the\npoints", ".2f"),
    ("completeness", "of what\nis seen", ".2f"),
    ("f_score", "\nF-score", ".2f"),
)


def section_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Front slope, area and volume of known objects, the paper's own figures beside them where it prints them."""
    table = new_table("Front slope, sectional area and volume against the truth", ("object", "noise", "method"))
    for _, heading, _ in _SECTION_COLUMNS:
        table.add_column(heading, justify="right")
    for row in rows:
        table.add_row(*_names(row), *(show(row[key], form) for key, _, form in _SECTION_COLUMNS))
    table.add_section()
    for method, figures in FIELD_TEST.items():
        cells = (show(figures.get(key), form) for key, _, form in _SECTION_COLUMNS)
        table.add_row("brick, the paper's", "at sea", method, *cells, style="italic")
    return table


def mesh_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Distances of clouds to a mesh and its seabed."""
    tolerance = rows[0]["tolerance"]
    table = new_table(f"Distance to mesh and seabed, and shares within {100.0 * tolerance:g} cm", ("object", "method"))
    for _, heading, _ in _MESH_COLUMNS:
        table.add_column(heading, justify="right")
    for row in rows:
        cells = (show(row[key], form) for key, _, form in _MESH_COLUMNS)
        table.add_row(_literal(row["object"]), row["method"], *cells)
    return table


def preset_table(presets: Mapping[str, Mapping[str, float]]) -> Table:
    """Main figures of rigs, one rig a column."""
    table = new_table("Presets", ("",))
    for name in presets:
        table.add_column(name, justify="right")
    for key in next(iter(presets.values())):
        table.add_row(_literal(key), *(f"{figures[key]:g}" for figures in presets.values()))
    return table


def device_table(devices: Sequence[Mapping[str, Any]]) -> Table:
    """Warp devices with their memory."""
    table = new_table("Devices", ("device", "name"))
    for heading in ("memory (GiB)", "threads"):
        table.add_column(heading, justify="right")
    for device in devices:
        memory = None if device["memory"] is None else device["memory"] / 2**30
        table.add_row(device["alias"], _literal(device["name"]), show(memory, ".1f"), show(device["threads"], "d"))
    return table


def version_table(versions: Mapping[str, str]) -> Table:
    """Versions by name."""
    table = new_table("Versions", ("", ""))
    for name, version in versions.items():
        table.add_row(name, version)
    return table


def new_table(title: str, headings: Sequence[str]) -> Table:
    """An empty table in the form of all of ours, its first columns headed and to the left."""
    from rich import box
    from rich.table import Table

    table = Table(
        title=title,
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        collapse_padding=True,
    )
    for heading in headings:
        table.add_column(heading)
    return table


def _names(row: Mapping[str, Any]) -> tuple[str, str, str]:
    parts = (row["object"], row["deployment"], row["which"])
    return _literal(" ".join(part for part in parts if part)), row["noise"], row["method"]


def _literal(text: str) -> str:
    """Text whose brackets stay: ``[m]`` would be a tag."""
    from rich.markup import escape

    return escape(text)


def show(value: float | None, form: str) -> str:
    """A figure in a format, or a dash where there is none."""
    return "-" if value is None else format(value, form)
