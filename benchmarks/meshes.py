"""Meshes half-buried in a rough seabed, through the command line: ``python -m benchmarks.meshes FOLDER``.

Prints the tables of the README as Markdown, of all surface and of what is steeper than the slope limit: each mesh is
buried, simulated, reconstructed and evaluated by the commands that a person would type, each in a process of its own.
``--picture`` draws one mesh beside its clouds.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console

import sonarwarp as sw
from benchmarks import tables
from benchmarks.run import machine
from sonarwarp.app import mesh_panels
from sonarwarp.app.page import Page
from sonarwarp.app.paper_printed import slope_limit_deg
from sonarwarp.app.rows import METHODS
from sonarwarp_scenes import Scene, read_scene


@dataclass(frozen=True, kw_only=True)
class Mesh:
    """A mesh file and what it is called."""

    title: str
    """Name in the table."""
    file: str
    """Name in the folder."""
    scale: float = 1.0
    """Metres per unit of the file."""


MESHES = (
    Mesh(title="ship, 3.5 m long", file="sunken_ship.ply", scale=0.2),
    Mesh(title="vase, 0.7 m high", file="sunken_vase.obj"),
    Mesh(title="shell, 1.4 m long", file="uxo.stl"),
)

_RIG = "paper simulation"

_COLUMNS = (
    ("Points", "counted", "d"),
    ("Mean [m]", "accuracy_mean", ".3f"),
    ("RMS [m]", "accuracy_rms", ".3f"),
    ("95 % [m]", "accuracy_p95", ".3f"),
    ("Precision", "precision", ".2f"),
    ("Completeness", "completeness", ".2f"),
    ("F-score", "f_score", ".2f"),
)

STEEP = f"{slope_limit_deg(sw.PRESETS[_RIG]):.1f}"
"""Slope limit of the rig [degrees]: what is steeper the imaging sonar alone cannot show as it is."""

# Inches: a panel's width and height, the page's heading, and what surrounds the panels.
_PANEL = (4.3, 3.0)
_HEAD = 1.05
_MARGIN = 0.45

# Elevation and azimuth of the eye [deg].
_EYE = (24.0, -130.0)

# A long box leaves much of its square axes empty.
_ZOOM = 1.2


def main(
    folder: Annotated[Path, typer.Argument(help=f"Folder with {', '.join(mesh.file for mesh in MESHES)}.")],
    out: Annotated[Path | None, typer.Option(help="Folder that keeps scenes, logs and clouds; none if none.")] = None,
    picture: Annotated[Path | None, typer.Option(help="PNG of one mesh and its clouds to write.")] = None,
    pictured: Annotated[str, typer.Option(help="File of the mesh in the picture.")] = MESHES[0].file,
    seed: Annotated[int, typer.Option(min=0, help="Of seabed, noise, motion, navigation and particles.")] = 0,
    json_file: Annotated[Path | None, typer.Option("--json", help="File for the rows of both tables.")] = None,
) -> None:
    """Print accuracy and completeness of clouds of real meshes as Markdown tables."""
    if pictured not in [mesh.file for mesh in MESHES]:
        raise typer.BadParameter(f"{pictured!r} is none of the meshes", param_hint="--pictured")
    # The commands leave the choice to Warp as well.
    device = tables.prepare(json_file, None)
    with tempfile.TemporaryDirectory() as scratch, Console(stderr=True).status("starting") as status:
        whole, steep = [], []
        for mesh in MESHES:
            status.update(mesh.title)
            place = (Path(scratch) if out is None else out) / Path(mesh.file).stem
            clouds = run_mesh(mesh, folder, place, seed)
            whole += judge(mesh, clouds)
            steep += judge(mesh, clouds, "--steeper-than", STEEP)
            if picture is not None and mesh.file == pictured:
                draw(mesh, place, picture)
    tables.write_json(json_file, [{**row, "seed": seed, **machine(device)} for row in whole + steep])
    print(markdown(whole), f"Steeper than {STEEP} degrees:", markdown(steep), sep="\n\n")


@dataclass(frozen=True, kw_only=True)
class Clouds:
    """What the commands made of a mesh."""

    scene: str
    """The mesh on its seabed."""
    part: str
    """The mesh in it."""
    log: str
    """What the sonars recorded."""
    folder: str
    """Clouds of both methods."""


def run_mesh(mesh: Mesh, folder: Path, place: Path, seed: int) -> Clouds:
    """Commands from a mesh file to clouds; what they write lies in ``place``."""
    place.mkdir(parents=True, exist_ok=True)
    scene, rig, log, clouds = (str(place / name) for name in ("scene.usda", "rig.toml", "log", "clouds"))
    drawn = ("--seed", str(seed))
    Path(rig).write_text(_sonarwarp("preset", _RIG))
    buried = ("bury", str(folder / mesh.file), "--scale", str(mesh.scale), "--rig", rig, "--out", scene)
    facts = json.loads(_sonarwarp(*buried, *drawn, "--json"))
    _sonarwarp("simulate", scene, "--rig", rig, "--out", log, "--overwrite", *drawn)
    _sonarwarp("reconstruct", log, "--out", clouds, *drawn)
    return Clouds(scene=scene, part=facts["part"], log=log, folder=clouds)


def judge(mesh: Mesh, clouds: Clouds, *options: str) -> list[dict[str, Any]]:
    """Figures of a mesh's clouds, one row per method."""
    judged = ("--truth", clouds.scene, "--log", clouds.log, "--part", clouds.part, *options, "--json")
    return [
        {"title": mesh.title, "method": method}
        | json.loads(_sonarwarp("evaluate", f"{clouds.folder}/{method}.ply", *judged))
        for method in METHODS
    ]


def _sonarwarp(*arguments: str) -> str:
    """Standard output of a command; the command's own words where it fails."""
    done = subprocess.run([sys.executable, "-m", "sonarwarp.app", *arguments], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(done.stderr.strip())
    return done.stdout


def markdown(rows: Sequence[dict[str, Any]]) -> str:
    """Rows as a table of the README."""
    lines = []
    for row in rows:
        figures = ("null" if row[key] is None else format(row[key], form) for _, key, form in _COLUMNS)
        lines.append((row["title"], row["method"], *figures))
    return tables.markdown(("Mesh", "Method", *(heading for heading, _, _ in _COLUMNS)), lines)


def draw(mesh: Mesh, place: Path, path: Path) -> None:
    """A mesh, and the clouds that :func:`run_mesh` left in ``place``, in one view."""
    scene, report = read_scene(place / "scene.usda")
    faces = report.faces_of("Mesh")
    body = Scene(vertices=scene.vertices, faces=scene.faces[faces], impedance=scene.impedance[faces])
    box = mesh_panels.box_over_seabed(body)
    scale = mesh_panels.height_scale(0.0, float(body.bounds()[1, 2]))
    width, height = _PANEL
    page = Page(
        (1 + len(METHODS)) * width + 1.2,
        _HEAD + height + _MARGIN,
        f"{mesh.title}, half-buried in a rough seabed",
        "left: the mesh; then the clouds of both methods; coloured by height",
    )
    clouds = [sw.read_cloud(place / "clouds" / f"{method}.ply").points for method in METHODS]
    for column, (title, points) in enumerate(zip(("mesh", *METHODS), (None, *clouds), strict=True)):
        left = _MARGIN + column * width
        axes = page.axes(left, _HEAD, width - _MARGIN, height, projection="3d", proj_type="ortho")
        if points is None:
            mesh_panels.draw_mesh(axes, body, box, scale)
        else:
            mesh_panels.draw_points(axes, points, box, scale)
        axes.view_init(*_EYE)
        axes.set_title(title, y=0.98)
        axes.set_box_aspect(np.ptp(box, axis=0), zoom=_ZOOM)
        # Between the panels there is no room for its name, and the colours say it.
        axes.set_zlabel("")
    bar = page.axes((1 + len(METHODS)) * width + _MARGIN, _HEAD + 0.4, 0.12, height - 0.8)
    page.figure.colorbar(scale, cax=bar, label="height [m]")
    page.save(path)


if __name__ == "__main__":
    typer.run(main)
