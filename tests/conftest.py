"""Options and fixtures that every test shares, and the count of made-up inputs."""

import functools
import signal
from collections.abc import Callable
from typing import Any

import pytest
import warp as wp

from tests.attempts import count_inputs, tried


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--device", default="cpu", help="Warp device that the tests run on, such as cpu or cuda:0")
    parser.addoption(
        "--warp-mode",
        choices=("release", "debug"),
        default="release",
        help="debug checks every array index in a kernel; a wrong one ends the whole process",
    )
    parser.addoption(
        "--least-inputs", type=int, default=0, help="Fail where fewer made-up inputs were tried: fuzz and properties"
    )


def pytest_configure(config: pytest.Config) -> None:
    # Started in the background, a shell has Ctrl-C ignored, and so would every process that a test interrupts.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    wp.config.log_level = wp.LOG_WARNING
    wp.config.mode = config.getoption("--warp-mode")
    if wp.config.mode == "debug":
        # Unoptimised kernels follow a pointer to tile memory that all threads share, and end the process; we have no
        # tiles.
        wp.config.enable_tiles_in_stack_memory = False


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    # Hypothesis keeps what it calls with every example here, for others to wrap.
    handles = {id(test): test for item in items if (test := getattr(getattr(item, "obj", None), "hypothesis", None))}
    for test in handles.values():
        test.inner_test = _counted(test.inner_test)


def _counted(example: Callable[..., None]) -> Callable[..., None]:
    """A property that counts every example that it ran through, unless what it calls has counted already."""

    @functools.wraps(example)
    def run(*arguments: Any, **named: Any) -> None:
        before = tried.total()
        example(*arguments, **named)
        if tried.total() == before:
            count_inputs()

    return run


def pytest_sessionfinish(session: pytest.Session) -> None:
    if tried.total() < session.config.getoption("--least-inputs"):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    least = config.getoption("--least-inputs")
    if tried or least:
        files = ", ".join(f"{count} in {path}" for path, count in tried.most_common())
        bound = f", must be at least {least}" if tried.total() < least else ""
        terminalreporter.write_line(f"{tried.total()} made-up inputs tried{bound}: {files}", red=bool(bound))


@pytest.fixture(scope="session")
def device(request: pytest.FixtureRequest) -> str:
    """Warp device named on the command line."""
    return str(request.config.getoption("--device"))
