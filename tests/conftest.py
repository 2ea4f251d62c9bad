"""Options and fixtures that every test shares."""

import pytest
import warp as wp


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--device", default="cpu", help="Warp device that the tests run on, such as cpu or cuda:0")


@pytest.fixture(scope="session")
def device(request: pytest.FixtureRequest) -> str:
    """Warp device named on the command line."""
    wp.config.quiet = True
    return request.config.getoption("--device")
