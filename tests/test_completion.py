"""Shell completion: what TAB offers, and that it costs next to nothing."""

import os
import subprocess
import sys

import pytest

from sonarwarp import PRESETS
from tests.test_cli import sonarwarp

HEAVY = {"warp", "numpy", "pxr", "trimesh", "matplotlib", "xarray", "zarr", "pypcd4"}

PROBE = f"""
import atexit, sys
atexit.register(lambda: print(*sorted({HEAVY} & set(sys.modules)), file=sys.stderr))
from sonarwarp.app.cli import main
main()
"""


def press_tab(line):
    """Run what bash runs for TAB at the end of ``line``."""
    words = line.split(" ")
    asked = {"_SONARWARP_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)}
    return subprocess.run(
        [sys.executable, "-c", PROBE], env={**os.environ, **asked}, capture_output=True, text=True, check=True
    )


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("sonarwarp preset ", set(PRESETS)),
        ("sonarwarp preset pap", set(PRESETS)),
        ("sonarwarp preset nothing", set()),
        ("sonarwarp preset paper s", {"simulation", "slope series"}),
        ("sonarwarp preset paper slope ", {"series"}),
        ("sonarwarp preset paper field ", set()),
        ("sonarwarp pre", {"preset"}),
    ],
)
def test_tab_offers_what_may_come_next(line, offered):
    assert set(filter(None, press_tab(line).stdout.split("\n"))) == offered


def test_tab_brings_nothing_heavy():
    assert press_tab("sonarwarp preset ").stderr.split() == []


def test_a_preset_needs_no_quotes():
    typed = sonarwarp("preset", "paper", "slope", "series")
    assert typed.returncode == 0
    assert typed.stdout == sonarwarp("preset", "paper slope series").stdout


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_is_installed_as_typers_users_expect(monkeypatch, tmp_path, shell):
    # Else Typer asks which shell has called it, and pytest is none.
    monkeypatch.setenv("_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION", "1")
    monkeypatch.setenv("HOME", str(tmp_path))
    shown = sonarwarp("--show-completion", shell)
    assert shown.returncode == 0
    assert "_SONARWARP_COMPLETE=" in shown.stdout
    installed = sonarwarp("--install-completion", shell)
    assert installed.returncode == 0
    written = [path.read_text() for path in tmp_path.rglob("*") if path.is_file()]
    assert any(shown.stdout.strip() in text for text in written)
