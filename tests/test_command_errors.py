"""No traceback reaches a user: wrong input costs one line and code 2, faults of the machine or of ours one and 1."""

import signal
import sys

import numpy as np
import pytest

import sonarwarp.toml_text
from sonarwarp.app import cli


def uneven(_):
    return np.concatenate([np.zeros((1, 2)), np.zeros((1, 3))])


def endless(name):
    return endless(name)


def raising(error):
    def fails(_):
        raise error

    return fails


@pytest.fixture
def preset(monkeypatch, capfd):
    """Runs the command ``preset`` with another function below it; gives the exit code and standard error."""

    def run(function):
        monkeypatch.setattr(sys, "argv", ["sonarwarp", "preset", "paper field"])
        monkeypatch.setattr(sonarwarp.toml_text, "preset_text", function)
        with pytest.raises(SystemExit) as done:
            cli.main()
        out, said = capfd.readouterr()
        assert out == ""
        return done.value.code, said

    kept = signal.getsignal(signal.SIGINT)
    yield run
    signal.signal(signal.SIGINT, kept)


FAULTS = {
    "TypeError: '<' of": raising(TypeError("'<' of\nNone")),
    "KeyError: 'beam'": raising(KeyError("beam")),
    "RuntimeError: codec": raising(RuntimeError("codec")),
    "AssertionError: ": raising(AssertionError()),
    "RecursionError: maximum recursion": endless,
    "ValueError: all the input array dimensions": uneven,
    "ValueError: invalid literal for int": lambda _: int("one"),
    "UnicodeDecodeError: 'utf-8' codec": lambda _: b"\xff".decode(),
}


@pytest.mark.parametrize("begin", FAULTS)
def test_a_fault_of_ours_costs_one_line_that_says_so(preset, monkeypatch, begin):
    monkeypatch.delenv("SONARWARP_TRACEBACK", raising=False)
    code, said = preset(FAULTS[begin])
    assert code == 1
    assert said.startswith(f"sonarwarp: internal error: {begin}")
    assert said.endswith("; run again with SONARWARP_TRACEBACK=1 and report it\n")
    assert len(said.splitlines()) == 1


def test_whoever_asks_gets_the_traceback_too(preset, monkeypatch):
    monkeypatch.setenv("SONARWARP_TRACEBACK", "1")
    code, said = preset(uneven)
    assert code == 1
    assert said.startswith("Traceback (most recent call last):\n")
    assert "in uneven\n" in said
    assert said.splitlines()[-1].endswith("; please report it with the traceback above")


def test_a_refusal_of_ours_is_wrong_input(preset):
    refuses = sonarwarp.toml_text.preset_text
    code, said = preset(lambda _: refuses("paper feild"))
    assert code == 2
    assert said == "sonarwarp: preset: 'paper feild', did you mean 'paper field'?\n"


@pytest.mark.parametrize("error", [PermissionError(13, "Permission denied", "a.ply"), MemoryError()])
def test_a_fault_of_the_environment_is_none_of_ours(preset, error):
    code, said = preset(raising(error))
    assert code == 1
    assert said in ("sonarwarp: [Errno 13] Permission denied: 'a.ply'\n", "sonarwarp: out of memory\n")
