"""Time of each stage: the launchers that the drivers call, wrapped for as long as a context lasts."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any

import warp as wp

from sonarwarp_kernels import (
    arcs,
    critical,
    crowd,
    echo,
    estimate,
    field,
    free_depth,
    fronts,
    noise,
    profile,
    repeats,
    sides,
    slots,
    tops,
)

# Stage -> launchers of one module; the two sonars are told apart by their number of beams.
_LAUNCHERS: tuple[tuple[str, ModuleType, tuple[str, ...]], ...] = (
    ("cast and form", echo, ("form_echoes",)),
    ("noise", noise, ("finish_images",)),
    ("critical points", critical, ("find_critical_points", "find_nearest_critical_points")),
    ("profile", profile, ("detect_profile",)),
    ("field", field, ("update_field",)),
    ("particles", estimate, ("estimate_points",)),
    ("free depth", free_depth, ("ask_arcs", "measure_free_depth")),
    ("free depth", fronts, ("ask_sheets",)),
    ("arcs", arcs, ("estimate_arcs",)),
    ("strays and sides", crowd, ("count_points", "drop_strays")),
    ("strays and sides", sides, ("measure_onsets", "drop_sides")),
    ("faces", tops, ("raise_tops",)),
    ("faces", fronts, ("find_fronts",)),
    ("repeats", repeats, ("find_surest", "drop_repeats")),
    ("slots", slots, ("load_slots", "load_poses", "load_noise", "gather_rows", "scatter_rows", "next_round")),
)


@contextmanager
def timed_stages(device: wp.Device) -> Iterator[defaultdict[str, float]]:
    """Seconds of each stage while the context lasts, every launch waited for."""
    seconds: defaultdict[str, float] = defaultdict(float)
    originals = []
    for stage, module, names in _LAUNCHERS:
        for name in names:
            launcher = getattr(module, name)
            originals.append((module, name, launcher))
            setattr(module, name, _timed(launcher, stage, seconds, device))
    try:
        yield seconds
    finally:
        for module, name, launcher in originals:
            setattr(module, name, launcher)


def _timed(launcher: Any, stage: str, seconds: defaultdict[str, float], device: wp.Device) -> Any:
    def timed(*arguments: Any, **options: Any) -> None:
        label = stage
        if stage in ("cast and form", "noise"):
            counts = arguments[6] if stage == "cast and form" else arguments[0]
            label = f"{'PS' if counts.shape[1] == 1 else 'FLS'} {stage}"
        start = time.perf_counter()
        launcher(*arguments, **options)
        wp.synchronize_device(device)
        seconds[label] += time.perf_counter() - start

    return timed
