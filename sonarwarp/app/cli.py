"""The console script ``sonarwarp``. Heavy imports wait for the command that needs them: help comes at once."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from sonarwarp.app.demo import Report

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Imaging and profiling sonars simulated and fused into 3-D point clouds.",
)

# Typer's errors share a base that has no public name: it comes from click or from Typer's own copy of it.
_UsageError: type[Exception] = typer.BadParameter.__mro__[1]  # pyright: ignore[reportAssignmentType]

_AsJson = Annotated[bool, typer.Option("--json", help="Print JSON on standard output, and nothing else there.")]


@app.callback(invoke_without_command=True)
def _without_command(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


@app.command()
def demo(
    device: Annotated[str | None, typer.Option(help="Such as cpu or cuda:0; Warp's choice if none.")] = None,
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Of noise, particles and the rough seabed.")] = 0,
    out: Annotated[Path, typer.Option(help="Folder for clouds, pages and metrics.json.")] = Path("sonarwarp-demo"),
    as_json: _AsJson = False,
    mesh: Annotated[
        Path | None, typer.Option(help="Mesh file, z up, half-buried on a rough seabed in the objects' place.")
    ] = None,
    scale: Annotated[float | None, typer.Option(help="Metres per unit of the mesh file; 1 if none.")] = None,
    altitude: Annotated[
        float | None, typer.Option(help="Of the vehicle over the seabed with --mesh [m]; by the mesh's size if none.")
    ] = None,
) -> None:
    """Simulate both sonars over the paper's objects, or a mesh, reconstruct them, and compare with the truth."""
    with _one_line_errors():
        from sonarwarp.app.demo import mesh_experiment, paper_experiments, run_demo
        from sonarwarp.app.machine import find_device
        from sonarwarp.app.progress import show_progress

        if mesh is None:
            for name, value in (("scale", scale), ("altitude", altitude)):
                if value is not None:
                    raise ValueError(f"{name}: {value:g}, needs --mesh")
            experiments = paper_experiments(seed)
        else:
            experiments = [mesh_experiment(mesh, scale=1.0 if scale is None else scale, altitude=altitude, seed=seed)]
        chosen = find_device(device)
        with show_progress() as watch:
            report = run_demo(experiments, device=chosen, out=out, watch=watch)
        if as_json:
            _print_json(report.rows)
        else:
            _print_report(report, chosen)


_Device = Annotated[str | None, typer.Option(help="Such as cpu or cuda:0; Warp's choice if none.")]
_Seed = Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Of noise and particles.")]
_Scale = Annotated[float | None, typer.Option(help="Metres per unit of the scene's file; its own, or 1, if none.")]


@app.command()
def preset(name: Annotated[str, typer.Argument(help="Such as 'paper field'; see info.")]) -> None:
    """Print a complete, commented TOML file of a preset: rig, noise and reconstruction."""
    with _one_line_errors():
        from sonarwarp.toml_text import preset_text

        print(preset_text(name), end="", flush=True)


@app.command()
def simulate(
    scene: Annotated[Path, typer.Argument(help="Mesh file or OpenUSD stage, metres, z up.")],
    rig: Annotated[Path, typer.Option(help="TOML file, as preset prints it.")],
    out: Annotated[Path, typer.Option(help="Log to write, a Zarr store.")],
    trajectory: Annotated[
        Path | None, typer.Option(help="CSV, TUM or OpenUSD file; the scene's own stage if none.")
    ] = None,
    scale: _Scale = None,
    frames_from: Annotated[float, typer.Option(help="Time from which the FLS records [s].")] = 0.0,
    truth: Annotated[bool, typer.Option("--truth", help="Keep first contacts of every beam too.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an older log.")] = False,
    seed: _Seed = 0,
    device: _Device = None,
    as_json: _AsJson = False,
) -> None:
    """Simulate both sonars over a scene into a log; interrupted, the log says how far it came."""
    with _one_line_errors():
        from sonarwarp.app.logs import simulate_files
        from sonarwarp.app.machine import find_device
        from sonarwarp.app.progress import show_progress

        chosen = find_device(device)
        with show_progress() as watch:
            facts = simulate_files(
                scene,
                rig,
                trajectory,
                out,
                scale=scale,
                seed=seed,
                frames_from=frames_from,
                truth=truth,
                overwrite=overwrite,
                device=chosen,
                watch=watch,
            )
        _print_facts(facts, as_json)


@app.command()
def reconstruct(
    log: Annotated[Path, typer.Argument(help="Log that simulate wrote.")],
    out: Annotated[Path, typer.Option(help="Folder for the clouds.")],
    settings: Annotated[Path | None, typer.Option(help="TOML file; the log's own settings if none.")] = None,
    seed: _Seed = 0,
    device: _Device = None,
    as_json: _AsJson = False,
) -> None:
    """Reconstruct a log into clouds of both methods: PLY, NPZ and OpenUSD."""
    with _one_line_errors():
        from sonarwarp.app.logs import reconstruct_files
        from sonarwarp.app.machine import find_device
        from sonarwarp.app.progress import show_progress

        chosen = find_device(device)
        with show_progress() as watch:
            facts = reconstruct_files(log, out, settings=settings, seed=seed, device=chosen, watch=watch)
        _print_facts(facts, as_json)


@app.command()
def evaluate(
    cloud: Annotated[Path, typer.Argument(help="PLY or NPZ.")],
    truth: Annotated[Path, typer.Option(help="Scene: mesh file or OpenUSD stage.")],
    scale: _Scale = None,
    tolerance: Annotated[float, typer.Option(help="Distance within which a point lies on the surface [m].")] = 0.05,
    device: _Device = None,
    as_json: _AsJson = False,
) -> None:
    """Compare a cloud with a scene: distances of all points to its surface."""
    with _one_line_errors():
        from sonarwarp.app.logs import evaluate_files
        from sonarwarp.app.machine import find_device

        chosen = find_device(device)
        _print_facts(evaluate_files(cloud, truth, scale=scale, tolerance=tolerance, device=chosen), as_json)


@app.command()
def info(as_json: _AsJson = False) -> None:
    """Show versions, devices and presets."""
    with _one_line_errors():
        from sonarwarp.app.info import gather_info

        gathered = gather_info()
        if as_json:
            _print_json(gathered)
            return
        from rich.console import Console

        from sonarwarp.app.tables import device_table, preset_table, version_table

        console = Console()
        console.print(version_table(gathered["versions"]))
        console.print(device_table(gathered["devices"]))
        if gathered["remark"]:
            console.print(gathered["remark"], markup=False)
            console.print()
        console.print(preset_table(gathered["presets"]))


def main() -> None:
    """Run the command line and exit: 0 done, 1 failed, 2 wrong input, 130 interrupted."""
    try:
        code = app(standalone_mode=False)
    except _UsageError as error:
        _complain(error.format_message())  # pyright: ignore[reportAttributeAccessIssue]
        code = 2
    sys.exit(code)


@contextmanager
def _one_line_errors() -> Iterator[None]:
    """Say in one line what went wrong: wrong input is a ``ValueError`` everywhere in this package."""
    try:
        yield
    except KeyboardInterrupt:
        _complain("interrupted; what was written so far is kept")
        raise typer.Exit(130) from None
    except BrokenPipeError:
        # Whoever read standard output has gone; the interpreter must not flush into the void when it ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise typer.Exit(1) from None
    except ValueError as error:
        _complain(str(error))
        raise typer.Exit(2) from None
    except (OSError, MemoryError) as error:
        _complain(str(error) or "out of memory")
        raise typer.Exit(1) from None


def _complain(message: str) -> None:
    print("sonarwarp:", " ".join(message.split()), file=sys.stderr)


def _print_json(value: object) -> None:
    print(json.dumps(value, indent=2, allow_nan=False), flush=True)


def _print_facts(facts: dict[str, Any], as_json: bool) -> None:
    if as_json:
        _print_json(facts)
        return
    for name, value in facts.items():
        shown = f"{value:.4g}" if isinstance(value, float) else value
        print(f"{name.replace('_', ' ')}: {shown}")


def _print_report(report: Report, device: str) -> None:
    from rich.console import Console

    from sonarwarp.app.tables import mesh_table, section_table

    console = Console(highlight=False)
    over_mesh = report.rows[0]["experiment"] == "mesh"
    console.print(mesh_table(report.rows) if over_mesh else section_table(report.rows))
    rate = report.frames / report.seconds
    console.print(
        f"{report.frames} frames of both sonars simulated and reconstructed on {device} in {report.seconds:.1f} s: "
        f"{rate:.0f} frames/s",
        soft_wrap=True,
    )
    console.print("Written:")
    for path in report.files:
        console.print(f"  {path}", markup=False, soft_wrap=True)
