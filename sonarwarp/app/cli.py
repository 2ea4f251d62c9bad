"""The console script ``sonarwarp``. Heavy imports wait for the command that needs them: help comes at once."""

from __future__ import annotations

import json
import linecache
import os
import signal
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sonarwarp.app.cli_paper import paper, print_work
from sonarwarp.app.completion import complete_preset

if TYPE_CHECKING:
    from sonarwarp.app.output import Report

app = typer.Typer(
    pretty_exceptions_enable=False,
    help="Imaging and profiling sonars simulated and fused into 3-D point clouds.",
)

# Typer's errors share a base that has no public name: it comes from click or from Typer's own copy of it.
_UsageError: type[Exception] = typer.BadParameter.__mro__[1]  # pyright: ignore[reportAssignmentType]

_INTERRUPTED = 130
"""Exit code of what Ctrl-C ended."""

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
def preset(
    name: Annotated[list[str], typer.Argument(help="Such as paper field; see info.", autocompletion=complete_preset)],
) -> None:
    """Print a complete, commented TOML file of a preset: rig, noise and reconstruction."""
    with _one_line_errors():
        from sonarwarp.toml_text import preset_text

        print(preset_text(" ".join(name)), end="", flush=True)


@app.command()
def bury(
    mesh: Annotated[Path, typer.Argument(help="Mesh file or OpenUSD stage, z up.")],
    out: Annotated[Path, typer.Option(help="OpenUSD stage to write: .usda, .usdc or .usd.")],
    rig: Annotated[Path | None, typer.Option(help="TOML file; 'paper simulation' if none.")] = None,
    scale: _Scale = None,
    altitude: Annotated[
        float | None, typer.Option(help="Of the vehicle over the seabed [m]; by the mesh's size if none.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Of the rough seabed.")] = 0,
    as_json: _AsJson = False,
) -> None:
    """Write a scene: a mesh half-buried on a rough seabed, and a run over it."""
    with _one_line_errors():
        from sonarwarp.app.bury import bury_file

        _print_facts(bury_file(mesh, out, rig=rig, scale=scale, altitude=altitude, seed=seed), as_json)


@app.command()
def simulate(
    scene: Annotated[Path, typer.Argument(help="Mesh file or OpenUSD stage, metres, z up.")],
    rig: Annotated[Path, typer.Option(help="TOML file, as preset prints it.")],
    out: Annotated[Path, typer.Option(help="Log to write, a Zarr store.")],
    trajectory: Annotated[
        Path | None, typer.Option(help="CSV, TUM or OpenUSD file; the scene's own stage if none.")
    ] = None,
    scale: _Scale = None,
    frames_from: Annotated[
        float | None,
        typer.Option(help="Time from which the FLS records [s]; as the trajectory's stage says, or 0, if none."),
    ] = None,
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
    out: Annotated[Path, typer.Option(help="Folder for clouds and pages.")],
    settings: Annotated[Path | None, typer.Option(help="TOML file; the log's own settings if none.")] = None,
    seed: _Seed = 0,
    device: _Device = None,
    as_json: _AsJson = False,
) -> None:
    """Reconstruct a log into clouds of both methods, PLY, PCD, NPZ and OpenUSD, and pages of figures."""
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
    log: Annotated[
        Path | None, typer.Option(help="Log that the cloud was made from: completeness over what its sonars could see.")
    ] = None,
    part: Annotated[
        str | None, typer.Option(help="Mesh or prim of the scene to ask for; points that lie on the rest are left out.")
    ] = None,
    steeper_than: Annotated[
        float | None,
        typer.Option(
            help="Ask for surface that leans more than this from the horizontal only, as for a part [degrees]."
        ),
    ] = None,
    scale: _Scale = None,
    tolerance: Annotated[float, typer.Option(help="Distance within which a point lies on the surface [m].")] = 0.05,
    device: _Device = None,
    as_json: _AsJson = False,
) -> None:
    """Compare a cloud with a scene: accuracy, and with a log completeness and F-score."""
    with _one_line_errors():
        from sonarwarp.app.logs import evaluate_files
        from sonarwarp.app.machine import find_device

        chosen = find_device(device)
        facts = evaluate_files(
            cloud,
            truth,
            log=log,
            part=part,
            steeper_than_deg=steeper_than,
            scale=scale,
            tolerance=tolerance,
            device=chosen,
        )
        _print_facts(facts, as_json)


app.command()(paper)


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
        with _one_line_errors():
            code = app(prog_name="sonarwarp", standalone_mode=False)
            # Interrupted between commands, Typer may say so by its code alone.
            if code == _INTERRUPTED:
                raise KeyboardInterrupt
    except _UsageError as error:
        _complain(error.format_message())  # pyright: ignore[reportAttributeAccessIssue]
        code = 2
    finally:
        # Ctrl-C as the interpreter winds up would print a traceback.
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(code)


@contextmanager
def _one_line_errors() -> Iterator[None]:
    """Say in one line what went wrong, and exit: no traceback reaches a user."""
    try:
        yield
    except (typer.Exit, _UsageError):
        raise
    except (KeyboardInterrupt, typer.Abort) as interrupt:
        # A writer notes how far it came.
        notes = getattr(interrupt, "__notes__", None)
        _complain(f"interrupted {notes[0]}" if notes else "interrupted; what was written so far is kept")
        raise SystemExit(_INTERRUPTED) from None
    except BrokenPipeError:
        # Whoever read standard output has gone; the interpreter must not flush into the void when it ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(1) from None
    except (OSError, MemoryError) as error:
        _complain(str(error) or "out of memory")
        raise SystemExit(1) from None
    except Exception as error:
        if _is_refusal(error):
            _complain(str(error))
            raise SystemExit(2) from None
        way_out = "run again with SONARWARP_TRACEBACK=1 and report it"
        if os.environ.get("SONARWARP_TRACEBACK"):
            traceback.print_exception(error)
            way_out = "please report it with the traceback above"
        _complain(f"internal error: {type(error).__name__}: {error}; {way_out}")
        raise SystemExit(1) from None


def _is_refusal(error: Exception) -> bool:
    """Whether a ``raise`` of ours made a ``ValueError``: so we refuse wrong input. One that NumPy raises is our bug."""
    *_, (frame, line) = traceback.walk_tb(error.__traceback__)
    ours = str(frame.f_globals.get("__name__", "")).startswith("sonarwarp")
    statement = linecache.getline(frame.f_code.co_filename, line).split()
    return isinstance(error, ValueError) and ours and statement[:1] == ["raise"]


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
    from sonarwarp.app.tables import mesh_table, section_table

    over_mesh = report.rows[0]["experiment"] == "mesh"
    print_work(mesh_table(report.rows) if over_mesh else section_table(report.rows), report, device)
