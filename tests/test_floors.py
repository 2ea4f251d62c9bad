"""The floors of the house hold: nothing reaches up, host code of the kernels costs nothing, contracts are kept.

Every rule is also shown a planted violation, so that a rule which no longer sees anything fails here.
"""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests import house_rules

ROOT = Path(__file__).resolve().parents[1]

Rule = Callable[[str, str], list[str]]


def files(*folders: str, but: tuple[str, ...] = ()) -> list[str]:
    """Python files below ``folders``, as paths relative to the root."""
    paths = [path.relative_to(ROOT).as_posix() for folder in folders for path in (ROOT / folder).rglob("*.py")]
    return sorted(path for path in paths if not path.startswith(but))


KERNELS = files("kernels")
ABOVE = files("scenes", "sonarwarp", "benchmarks", but=("sonarwarp/newton/",))

KERNEL_HEAD = 'import warp as wp\nwp.set_module_options({"enable_backward": False})\n'

HOUSE = files("kernels", "scenes", "sonarwarp", "benchmarks")

RULES: dict[str, tuple[Rule, list[str]]] = {
    "nothing reaches up": (house_rules.reaches_up, HOUSE),
    "kernels' host code neither allocates nor waits": (house_rules.costs_on_host, KERNELS),
    "device code stands in kernels": (house_rules.holds_device_code, ABOVE),
    "kernels keep their signature": (house_rules.breaks_signature, KERNELS),
    "kernels write to outputs only": (house_rules.writes_inputs, KERNELS),
    "backward passes are off": (
        house_rules.compiles_backward,
        [path for path in KERNELS if path != "kernels/sonarwarp_kernels/gradient.py"],
    ),
    "kernel files stay short": (house_rules.is_too_long, KERNELS),
}


@pytest.mark.parametrize("rule", RULES)
def test_the_house_keeps_the_rule(rule):
    check, paths = RULES[rule]
    assert paths
    broken = [line for path in paths for line in check(path, (ROOT / path).read_text())]
    assert not broken, "\n".join(broken)


@pytest.mark.parametrize(
    ("path", "source", "refused"),
    [
        ("kernels/sonarwarp_kernels/x.py", "import numpy as np", "numpy"),
        ("kernels/sonarwarp_kernels/x.py", "def f():\n    import numpy", "numpy"),
        ("kernels/sonarwarp_kernels/x.py", "from sonarwarp.sonar import FLS", "sonarwarp.sonar.FLS"),
        ("kernels/sonarwarp_kernels/x.py", "from sonarwarp_scenes import Scene", "sonarwarp_scenes.Scene"),
        ("scenes/sonarwarp_scenes/x.py", "import trimesh", "trimesh"),
        ("scenes/sonarwarp_scenes/x.py", "from pxr import Usd", "pxr.Usd"),
        ("scenes/sonarwarp_scenes/x.py", "def f():\n    import sonarwarp_kernels.keys", "sonarwarp_kernels.keys"),
        ("sonarwarp/x.py", "import xarray as xr", "xarray"),
        ("sonarwarp/x.py", "try:\n    import zarr\nexcept ImportError:\n    pass", "zarr"),
        ("sonarwarp/x.py", "import sonarwarp_scenes", "sonarwarp_scenes"),
        ("sonarwarp/x.py", "from sonarwarp_scenes import shapes", "sonarwarp_scenes.shapes"),
        ("sonarwarp/x.py", "from sonarwarp_scenes.shapes import wedge", "sonarwarp_scenes.shapes.wedge"),
        ("sonarwarp/x.py", "def f():\n    from sonarwarp.app import cli", "sonarwarp.app.cli"),
        ("sonarwarp/x.py", "from . import app", "sonarwarp.app"),
        ("sonarwarp/newton/x.py", "from ..examples import plain", "sonarwarp.examples.plain"),
        ("sonarwarp/x.py", "import importlib\nimportlib.import_module('sonarwarp.app.cli')", "sonarwarp.app.cli"),
        ("sonarwarp/x.py", "import tests.reference", "tests.reference"),
        ("sonarwarp/app/x.py", "def f():\n    from benchmarks import cases", "benchmarks.cases"),
        ("benchmarks/x.py", "from tests.reference import keys", "tests.reference.keys"),
    ],
)
def test_reaching_up_is_seen(path, source, refused):
    (found,) = house_rules.reaches_up(path, source)
    assert found.startswith(f"{path}:")
    assert found.endswith(f" imports {refused}")


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("kernels/sonarwarp_kernels/x.py", "import os\nimport warp as wp\nfrom sonarwarp_kernels.launch import launch"),
        ("scenes/sonarwarp_scenes/x.py", "import numpy\nfrom .scene import Scene\ndef f():\n    import trimesh"),
        ("sonarwarp/x.py", "from sonarwarp_scenes.scene import Scene\nfrom sonarwarp_scenes import Trajectory"),
        ("sonarwarp/x.py", "from . import sonar\nfrom sonarwarp_kernels import keys\ndef f():\n    import xarray"),
        ("sonarwarp/x.py", "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import xarray"),
        ("sonarwarp/newton/x.py", "import newton\nfrom sonarwarp.sonar import FLS"),
        ("sonarwarp/app/x.py", "import typer\nfrom sonarwarp_scenes import shapes\nfrom sonarwarp import sonar"),
        ("benchmarks/x.py", "import embreex\nfrom benchmarks import cases\nimport sonarwarp.app.cli"),
    ],
)
def test_reaching_down_is_allowed(path, source):
    assert house_rules.reaches_up(path, source) == []


@pytest.mark.parametrize(
    ("statement", "seen"),
    [
        ("wp.zeros(3, dtype=float)", "calls wp.zeros"),
        ("x = wp.empty_like(y)", "calls wp.empty_like"),
        ("wp.array([1.0])", "calls wp.array"),
        ("wp.clone(y)", "calls wp.clone"),
        ("wp.Mesh(y, z)", "calls wp.Mesh"),
        ("wp.synchronize()", "calls wp.synchronize"),
        ("wp.synchronize_device(y)", "calls wp.synchronize_device"),
        ("y.numpy()[0]", "calls .numpy()"),
        ("y.list()", "calls .list()"),
    ],
)
def test_costs_on_the_host_are_seen(statement, seen):
    path = "kernels/sonarwarp_kernels/x.py"
    launcher = f"import warp as wp\ndef launcher(y: wp.array) -> None:\n    {statement}\n"
    assert house_rules.costs_on_host(path, launcher) == [f"{path}:3 {seen}"]
    assert house_rules.costs_on_host(path, f"import warp as wp\n{statement}\n") == [f"{path}:2 {seen}"]


def test_a_constructor_called_by_another_name_is_seen():
    found = house_rules.costs_on_host("x.py", "import warp\nfrom warp import full as fill\nfill(3, 1)\nwarp.ones(3)\n")
    assert found == ["x.py:3 calls wp.full", "x.py:4 calls wp.ones"]


def test_annotations_and_device_code_cost_the_host_nothing():
    source = (
        "import warp as wp\n"
        "@wp.struct\nclass S:\n    a: wp.array(dtype=float)\n"
        "@wp.func\ndef f(a: wp.array(dtype=float)):\n    return wp.zeros(shape=3, dtype=float)\n"
        "@wp.kernel(enable_backward=False)\ndef k(a: wp.array(dtype=float)):\n    b = wp.zeros(shape=3, dtype=float)\n"
        "def launcher(a: wp.array(dtype=float)) -> wp.array(dtype=int):\n    assert isinstance(a, wp.array)\n"
    )
    assert house_rules.costs_on_host("x.py", source) == []


@pytest.mark.parametrize(
    ("source", "seen"),
    [
        ("import warp as wp\n@wp.kernel\ndef k(): ...", "warp.kernel"),
        ("import warp as wp\n@wp.kernel(enable_backward=False)\ndef k(): ...", "warp.kernel"),
        ("import warp as wp\n@wp.func\ndef f(): ...", "warp.func"),
        ("from warp import func as device\n@device\ndef f(): ...", "warp.func"),
        ("import warp as wp\nwp.launch(k, 3)", "warp.launch"),
        ("import warp as wp\ngo = wp.launch_tiled", "warp.launch_tiled"),
        (
            "from sonarwarp_kernels.launch import launch\nlaunch(k, (3,), [], [], 'cpu')",
            "sonarwarp_kernels.launch.launch",
        ),
        ("from sonarwarp_kernels import launch\nlaunch.launch(k)", "sonarwarp_kernels.launch.launch"),
    ],
)
def test_device_code_outside_kernels_is_seen(source, seen):
    assert [found.split(" uses ")[1] for found in house_rules.holds_device_code("sonarwarp/x.py", source)] == [seen]


def test_drivers_may_ask_for_the_cores():
    source = "from sonarwarp_kernels.launch import cpu_threads\ncpu_threads()"
    assert house_rules.holds_device_code("sonarwarp/x.py", source) == []


def kernel_file(arguments: str, name: str = "k_kernel", body: str = "pass", launched: str | None = None) -> str:
    signature = "".join(f"    {argument}\n" for argument in arguments.split("; "))
    kernel = f"@wp.kernel\ndef {name}(\n{signature}):\n    {body}\n"
    return f"{KERNEL_HEAD}{kernel}def k(a):\n    launch({launched or name}, a)\n"


GOOD = "first: int,; a: wp.array(dtype=float),  # [x]; scale: float,; b_out: wp.array(dtype=float),  # [x]"


@pytest.mark.parametrize(
    ("source", "seen"),
    [
        (kernel_file(GOOD.replace("first: int,; ", "")), "first argument is not first: int"),
        (kernel_file(GOOD.replace("first: int", "first: float")), "first argument is not first: int"),
        (kernel_file(GOOD + "; n: int,"), "outputs *_out do not come last"),
        (kernel_file(GOOD.replace("b_out", "b")), "outputs *_out do not come last"),
        (
            kernel_file(GOOD.replace("a: wp.array(dtype=float),  # [x]", "a: wp.array(dtype=float),")),
            "no shape comment for a",
        ),
        (kernel_file(GOOD, name="k"), "name does not end in _kernel"),
        (kernel_file(GOOD, launched="other_kernel"), "no launcher uses it"),
    ],
)
def test_a_broken_signature_is_seen(source, seen):
    assert house_rules.breaks_signature("x.py", kernel_file(GOOD)) == []
    assert [found.split(": ", 1)[1] for found in house_rules.breaks_signature("x.py", source)] == [seen]


@pytest.mark.parametrize("body", ["a[0] = 1.0", "a[0, 1] += 1.0", "a[0][1] = 1.0", "wp.atomic_add(a, 0, 1.0)"])
def test_a_written_input_is_seen(body):
    (found,) = house_rules.writes_inputs("x.py", kernel_file(GOOD, body=body))
    assert found.endswith("k_kernel writes to a")
    assert (
        house_rules.writes_inputs(
            "x.py", kernel_file(GOOD, body=body.replace("a[", "b_out[").replace("(a,", "(b_out,"))
        )
        == []
    )


@pytest.mark.parametrize("head", ["import warp as wp\n", KERNEL_HEAD.replace("False", "True")])
@pytest.mark.parametrize("mark", ["kernel", "func", "kernel(enable_backward=False)"])
def test_a_backward_pass_is_seen(head, mark):
    source = f"@wp.{mark}\ndef k(): ...\n"
    assert house_rules.compiles_backward("x.py", head + source) == ["x.py does not switch enable_backward off"]
    assert house_rules.compiles_backward("x.py", KERNEL_HEAD + source) == []


def test_a_long_file_is_seen():
    assert house_rules.is_too_long("x.py", "\n" * 350) == []
    assert house_rules.is_too_long("x.py", "\n" * 351) == ["x.py has 351 lines, more than 350"]


def test_source_roots_are_not_packages():
    # A package called kernels would overwrite another project's.
    assert not (ROOT / "kernels/__init__.py").exists()
    assert not (ROOT / "scenes/__init__.py").exists()


def test_no_file_is_a_place_for_anything():
    names = {Path(path).stem for path in HOUSE} | {Path(path).parent.name for path in HOUSE}
    assert not names & {"utils", "util", "common", "helpers", "misc", "_src"}


def packages_brought_by(statement: str) -> set[str]:
    """Top-level packages outside the standard library in memory after ``statement`` runs in a fresh interpreter."""
    code = f"{statement}\nimport sys\nprint(*{{name.split('.')[0] for name in sys.modules}})"
    roots = os.pathsep.join(str(ROOT / folder) for folder in (".", "kernels", "scenes"))
    run = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": roots},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    return set(run.stdout.split()) - set(sys.stdlib_module_names)


IMPORT_ALL = "import {0}, importlib, pkgutil\nfor m in pkgutil.iter_modules({0}.__path__, '{0}.'): {1}"

HEAVY = {"pxr", "trimesh", "matplotlib", "xarray", "zarr", "dask", "typer", "rich", "scipy", "newton", "torch", "jax"}


def test_all_kernel_files_bring_nothing_but_warp():
    everything = IMPORT_ALL.format("sonarwarp_kernels", "importlib.import_module(m.name)")
    extra = packages_brought_by(everything) - packages_brought_by("import warp")
    assert extra == {"sonarwarp_kernels"}


def test_importing_sonarwarp_brings_nothing_heavy():
    brought = packages_brought_by("import sonarwarp")
    assert "sonarwarp" in brought
    assert not brought & HEAVY


def test_no_file_of_the_library_brings_anything_heavy():
    everything = IMPORT_ALL.format("sonarwarp", "m.ispkg or importlib.import_module(m.name)")
    assert not packages_brought_by(everything) & HEAVY


def test_no_file_of_the_scenes_brings_anything_heavy():
    everything = IMPORT_ALL.format("sonarwarp_scenes", "importlib.import_module(m.name)")
    assert not packages_brought_by(everything) & HEAVY
