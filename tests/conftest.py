"""Options and fixtures that every test shares."""

import pytest
import warp as wp


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--device", default="cpu", help="Warp device that the tests run on, such as cpu or cuda:0")
    parser.addoption(
        "--warp-mode",
        choices=("release", "debug"),
        default="release",
        help="debug checks every array index in a kernel; a wrong one ends the whole process",
    )


def pytest_configure(config: pytest.Config) -> None:
    wp.config.log_level = wp.LOG_WARNING
    wp.config.mode = config.getoption("--warp-mode")
    if wp.config.mode == "debug":
        # Unoptimised kernels follow a pointer to tile memory that all threads share, and end the process; we have no
        # tiles.
        wp.config.enable_tiles_in_stack_memory = False


@pytest.fixture(scope="session")
def device(request: pytest.FixtureRequest) -> str:
    """Warp device named on the command line."""
    return str(request.config.getoption("--device"))
