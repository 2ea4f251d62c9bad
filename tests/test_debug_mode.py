"""No kernel reads or writes past an array: its tests pass where Warp checks every index.

A wrong index ends the whole process, so these passes run in their own.
"""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

TESTS_OF_KERNELS = sorted(
    test.relative_to(ROOT).as_posix()
    for test in (ROOT / "tests").glob("test_*.py")
    if (ROOT / "kernels/sonarwarp_kernels" / test.name.removeprefix("test_")).exists()
)


def pytest_in_debug_mode(*arguments: str) -> subprocess.CompletedProcess[str]:
    # Captured output would be lost with the process, and with it the test's name and what Warp says.
    options = ["--verbose", "--capture=no", "-p", "no:cacheprovider", "--warp-mode", "debug"]
    command = [sys.executable, "-m", "pytest", *options, *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("test", TESTS_OF_KERNELS)
def test_kernels_stay_inside_their_arrays(test, device):
    run = pytest_in_debug_mode("--exitfirst", "--device", device, test)
    assert run.returncode == 0, run.stdout[-3000:] + run.stderr[-3000:]


PLANTED = """
import warp as wp

@wp.kernel
def over_kernel(a_out: wp.array(dtype=int)):
    a_out[wp.tid() + 1] = 1

def test_over():
    # The array that is passed ends one short of memory that is ours: without the check this writes harmlessly.
    memory = wp.zeros(8, dtype=int, device="cpu")
    wp.launch(over_kernel, 4, outputs=[memory[:4]], device="cpu")
"""


@pytest.mark.parametrize(("mode", "passes"), [("debug", False), ("release", True)])
def test_an_index_past_the_end_is_caught(tmp_path, mode, passes):
    planted = tmp_path / "test_planted.py"
    planted.write_text(PLANTED)
    run = pytest_in_debug_mode("-p", "tests.conftest", "--warp-mode", mode, str(planted))
    assert (run.returncode == 0) is passes
    assert ("Assertion failed" in run.stdout + run.stderr) is not passes
