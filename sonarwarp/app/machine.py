"""What this machine runs on: versions and Warp devices."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from sonarwarp_kernels.launch import cpu_threads


def versions() -> dict[str, str]:
    """Versions that a result depends on, by name."""
    try:
        ours = importlib.metadata.version("sonarwarp")
    except importlib.metadata.PackageNotFoundError:
        ours = "source tree"
    return {
        "sonarwarp": ours,
        "warp": wp.__version__,
        "numpy": np.__version__,
        "python": platform.python_version(),
        "system": platform.platform(),
    }


def start_warp() -> str:
    """Start Warp without a word on standard output or error; give what it had to say."""
    wp.config.log_level = wp.LOG_WARNING
    # Native code writes to the descriptor itself.
    with tempfile.TemporaryFile("w+", errors="replace") as said:
        kept = os.dup(2)
        try:
            os.dup2(said.fileno(), 2)
            wp.init()
        finally:
            os.dup2(kept, 2)
            os.close(kept)
        said.seek(0)
        return " ".join(said.read().split())


def find_device(name: str | None) -> str:
    """The device that a name means, Warp's own choice where there is no name.

    Raises:
        ValueError: no such device here.
    """
    remark = start_warp()
    try:
        # Warp asks a driver that is not there for its current device.
        if name == "cuda" and not wp.is_cuda_available():
            raise ValueError("no CUDA device")
        return str(wp.get_device(name))
    except ValueError as error:
        known = ", ".join(str(device) for device in wp.get_devices())
        reason = f" ({remark})" if remark else ""
        raise ValueError(f"device: {name!r}, must be one of: {known}{reason}") from error


def describe_devices() -> list[dict[str, Any]]:
    """All devices of this machine."""
    return [describe_device(str(device)) for device in wp.get_devices()]


def describe_device(name: str) -> dict[str, Any]:
    """Alias, name, memory [bytes] (None where the system does not tell) and, of a CPU, the threads that we use."""
    device = wp.get_device(name)
    if device.is_cpu:
        return {
            "alias": device.alias,
            "name": _processor(),
            "memory": _host_memory(),
            "threads": cpu_threads(),
        }
    return {"alias": device.alias, "name": device.name, "memory": device.total_memory, "threads": None}


def _processor() -> str:
    """Name of the processor; Linux tells it in a file only."""
    facts = Path("/proc/cpuinfo")
    lines = facts.read_text().splitlines() if facts.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _host_memory() -> int | None:
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        return None
