"""Sides of objects: beams that an object fills by less than half.

A beam that only brushes an object reports it at the beam's centre, up to half a beam beside it, and widens everything
by about a beam. What it reports is as much fainter as it is less filled: beside a neighbour that looks at the same
surface, its onset's level says how much. A beam filled by half has its centre on the side.
"""

from typing import Any

import warp as wp

from sonarwarp_kernels.critical import NO_BIN, NO_DETECTION
from sonarwarp_kernels.estimate import QUALITY_NONE
from sonarwarp_kernels.launch import check_array, launch

wp.set_module_options({"enable_backward": False})


@wp.struct
class Sides:
    """What ends at a beam, and how faint it may be."""

    jump: float  # a neighbour this much further, or without a critical point, looks past the object [m]
    share: float  # least level over the next neighbours' towards the inside


@wp.kernel
def measure_onsets_kernel(
    first: int,
    image: wp.array3d(dtype=float),  # [slot, beam, bin]
    critical_bin: wp.array2d(dtype=int),  # [slot, beam]
    length: int,
    level_out: wp.array2d(dtype=float),  # [slot, beam]
):
    index, beam = wp.tid()
    slot = first + index
    start = critical_bin[slot, beam]
    total = float(0.0)
    if start != NO_BIN:
        stop = wp.min(start + length, image.shape[2])
        for bin in range(start, stop):
            total += image[slot, beam, bin]
        total /= float(stop - start)
    level_out[slot, beam] = total


def measure_onsets(
    image: wp.array,
    critical_bin: wp.array,
    length: int,
    level_out: wp.array,
    *,
    device: Any = None,
    threads: int = 1,
) -> None:
    """Mean amplitude of the first bins of each beam's echo.

    Args:
        image: echo amplitudes, shape [slot, beam, bin].
        critical_bin: bin of the critical point (:mod:`sonarwarp_kernels.critical`), int32, shape [slot, beam].
        length: bins that count from there on, at least 1.
        level_out: mean amplitude, shape [slot, beam]; 0 without a critical point.
        device: device of all arrays.
        threads: CPU threads.

    Raises:
        ValueError: an array of the wrong shape, type or device, or ``length`` under 1.
    """
    device = wp.get_device(device)
    if length < 1:
        raise ValueError(f"length: {length}, must be at least 1")
    check_array("image", image, (None, None, None), wp.float32, device)
    shape = image.shape[:2]
    check_array("critical_bin", critical_bin, shape, wp.int32, device)
    check_array("level_out", level_out, shape, wp.float32, device)
    launch(measure_onsets_kernel, shape, [image, critical_bin, length], [level_out], device, threads)


@wp.func
def meets_same(critical_range: wp.array2d(dtype=float), frame: int, beam: int, distance: float, jump: float) -> bool:
    """Whether a beam exists and meets something within ``jump`` of ``distance`` [m]."""
    if beam < 0 or beam >= critical_range.shape[1]:
        return False
    met = critical_range[frame, beam]
    return met != NO_DETECTION and wp.abs(met - distance) < jump


@wp.kernel
def drop_sides_kernel(
    first: int,
    sides: Sides,
    critical_range: wp.array2d(dtype=float),  # [frame, beam]
    level: wp.array2d(dtype=float),  # [frame, beam]
    quality_out: wp.array2d(dtype=int),  # [frame, beam]
):
    index, beam = wp.tid()
    frame = first + index
    if quality_out[frame, beam] == QUALITY_NONE:
        return
    distance = critical_range[frame, beam]
    for side in range(2):
        step = 2 * side - 1
        outer = beam + step
        # At the fan's own edge nobody knows what lies beside the beam.
        if outer >= 0 and outer < critical_range.shape[1]:
            beyond = critical_range[frame, outer]
            passes = beyond == NO_DETECTION or beyond > distance + sides.jump
            if passes and meets_same(critical_range, frame, beam - step, distance, sides.jump):
                inside = level[frame, beam - step]
                if meets_same(critical_range, frame, beam - 2 * step, distance, 2.0 * sides.jump):
                    inside = 0.5 * (inside + level[frame, beam - 2 * step])
                if level[frame, beam] < sides.share * inside:
                    quality_out[frame, beam] = QUALITY_NONE


def drop_sides(
    sides: Sides,
    critical_range: wp.array,
    level: wp.array,
    quality_out: wp.array,
    *,
    device: Any = None,
    threads: int = 1,
) -> None:
    """Take back the points of beams that only brush what they meet.

    Args:
        sides: what ends at a beam.
        critical_range: [m], ``NO_DETECTION`` where there is none, shape [frame, beam].
        level: mean amplitude of the onset (:func:`measure_onsets`), shape [frame, beam].
        quality_out: becomes ``QUALITY_NONE`` there, int32, shape [frame, beam].
        device: device of all arrays.
        threads: CPU threads.

    Raises:
        ValueError: an array of the wrong shape, type or device.
    """
    device = wp.get_device(device)
    check_array("critical_range", critical_range, (None, None), wp.float32, device)
    shape = critical_range.shape
    check_array("level", level, shape, wp.float32, device)
    check_array("quality_out", quality_out, shape, wp.int32, device)
    launch(drop_sides_kernel, shape, [sides, critical_range, level], [quality_out], device, threads)
