"""Reads OpenUSD files in a process of its own, because a damaged file can take its reader down.

OpenUSD 26.11 on 6,000 damaged copies of a 3 kB binary (.usdc) file: three segmentation faults, and eight reads that
took up to 5 GB and many seconds; neither on 6,000 damaged text (.usda) files. But a text file may refer to binary ones,
so all are read here. It costs 0.4 s, mostly imports. Whoever trusts a stage, or has one open, calls
:func:`~sonarwarp_scenes.read_stage` directly. On 9,000 damaged files of six formats trimesh, which is Python, raised
exceptions and nothing worse: those are read where the caller is.
"""

from __future__ import annotations

import importlib
import importlib.util
import io
import json
import os
import signal
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from sonarwarp_scenes.conversion import Conversion

# A million triangles take seconds.
_PATIENCE = 600.0

# What the child can do: module and function, which turns a path and a Conversion into arrays and a JSON value.
_TASKS = {
    "scene": ("sonarwarp_scenes.usd", "scene_of_file"),
    "trajectory": ("sonarwarp_scenes.usd_track", "trajectory_of_file"),
    "frames_from": ("sonarwarp_scenes.usd_track", "frames_from_of_file"),
}


def in_child(task: str, path: Path, conversion: Conversion, **arguments: Any) -> tuple[dict[str, np.ndarray], Any]:
    """Arrays and a JSON value that a task makes of a file.

    Raises:
        ValueError: what the task refuses, and whatever befalls its process; one line that names the file.
        ModuleNotFoundError: usd-core is not installed.
    """
    if importlib.util.find_spec("pxr") is None:
        raise ModuleNotFoundError("OpenUSD files need usd-core: pip install 'sonarwarp[app]'")
    order = {"task": task, "path": str(path.resolve()), "conversion": asdict(conversion), "arguments": arguments}
    # One thread: the memory bound counts the stacks of every thread of every library.
    quiet = {"PXR_WORK_THREAD_LIMIT": "1", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    search = os.pathsep.join(entry or os.getcwd() for entry in sys.path)
    try:
        run = subprocess.run(
            [sys.executable, "-P", "-c", "from sonarwarp_scenes.child import serve; serve()"],
            input=json.dumps(order).encode(),
            capture_output=True,
            env={**os.environ, **quiet, "PYTHONPATH": search},
            timeout=_PATIENCE,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise ValueError(
            f"path: cannot read {path} as OpenUSD: not done after {_PATIENCE:.0f} s, the file may be damaged"
        ) from error
    if run.returncode:
        how = f"exit code {run.returncode}"
        if run.returncode < 0:
            how = signal.Signals(-run.returncode).name
        raise ValueError(
            f"path: cannot read {path} as OpenUSD: its reader died ({how}): "
            "the file is damaged, or needs over half of this machine's memory"
        )
    with np.load(io.BytesIO(run.stdout)) as arrays:
        values = {name: arrays[name] for name in arrays.files}
    answer = json.loads(values.pop("answer").item())
    if "refused" in answer:
        raise ValueError(f"path: {path}: {answer['refused']}")
    if "failed" in answer:
        raise ValueError(f"path: cannot read {path} as OpenUSD: {answer['failed']}")
    return values, answer["value"]


def serve() -> None:
    """Read an order from standard input, carry it out, and write an archive of arrays to standard output."""
    order = json.load(sys.stdin)
    # Nothing that a library prints may reach the archive.
    reply = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    _bound_memory()
    module, function = _TASKS[order["task"]]
    arrays: dict[str, np.ndarray] = {}
    try:
        task = getattr(importlib.import_module(module), function)
        arrays, value = task(order["path"], Conversion(**order["conversion"]), **order["arguments"])
        answer = {"value": value}
    except ValueError as error:
        answer = {"refused": str(error)}
    except MemoryError:
        answer = {"refused": "needs more memory than there is"}
    except Exception as error:
        answer = {"failed": _first_line(error)}
    np.savez(reply, answer=np.array(json.dumps(answer)), **arrays)  # pyright: ignore[reportArgumentType]
    reply.flush()
    # Libraries' threads may hang or crash as they wind down.
    os._exit(0)


def _bound_memory() -> None:
    """Half of the machine's memory, where the system can bound it."""
    if importlib.util.find_spec("resource") is None:
        return
    import resource

    half = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2
    _, most = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (half if most == resource.RLIM_INFINITY else min(half, most), most))


def _first_line(error: Exception) -> str:
    """What an exception says; of OpenUSD's lists of errors with places in its source, the first text."""
    text = str(error)
    if type(error).__module__.startswith("pxr") and " : '" in text:
        text = text.split(" : '", 1)[1].split("'\n", 1)[0].rstrip().removesuffix("'")
    return " ".join(text.split()) or type(error).__name__
