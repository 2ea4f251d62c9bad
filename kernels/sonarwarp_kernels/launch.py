"""Host side of every kernel: checks of shapes, types and devices, and launches spread over the CPU's cores.

Every kernel's first argument is ``first``: the leading index of a launch starts there, so that one launch can be cut
into pieces without slicing an array and without changing a random key (design contract of this package).
"""

from __future__ import annotations

import itertools
import os
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import cache
from typing import Any

import warp as wp

Shape = tuple[int | None, ...]

# Array strides are 32-bit inside kernels: an outer stride of this many bytes reads the wrong place without an error.
_STRIDE_LIMIT = 2**31

# Pieces per thread: enough to even out rows of unequal cost, few enough that a piece outweighs its launch (10 us).
_PIECES_PER_THREAD = 4


def check_array(name: str, array: Any, shape: Shape, dtype: Any, device: Any) -> None:
    """Refuse an array that a kernel would misread.

    Args:
        name: the argument's name, for the message.
        array: the array given.
        shape: expected shape; ``None`` leaves an axis free.
        dtype: expected Warp type.
        device: device of the launch.

    Raises:
        ValueError: wrong kind, number of axes, shape, type, device, or a stride that kernels cannot hold.
    """
    if not isinstance(array, wp.array):
        raise ValueError(f"{name}: expected a warp array, got {type(array).__name__}")
    fits = len(array.shape) == len(shape) and all(
        want is None or have == want for have, want in zip(array.shape, shape, strict=True)
    )
    if not fits:
        raise ValueError(f"{name}: expected shape {_shape_text(shape)}, got {_shape_text(array.shape)}")
    if array.dtype is not dtype:
        raise ValueError(f"{name}: expected dtype {dtype.__name__}, got {array.dtype.__name__}")
    if array.device != wp.get_device(device):
        raise ValueError(f"{name}: expected device {wp.get_device(device)}, got {array.device}")
    if array.size and max(array.strides) >= _STRIDE_LIMIT:
        raise ValueError(f"{name}: stride of {max(array.strides)} bytes, must be under {_STRIDE_LIMIT}")


def _shape_text(shape: Shape) -> str:
    axes = ["any" if axis is None else str(axis) for axis in shape]
    return f"({axes[0]},)" if len(axes) == 1 else f"({', '.join(axes)})"


def lanes(device: Any) -> int:
    """Threads that share one row of bins: 32 on CUDA read neighbouring addresses, on CPU one loop is fastest."""
    return 32 if wp.get_device(device).is_cuda else 1


def cpu_threads() -> int:
    """Number of cores that this process may use, for drivers that want all of them."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max_workers=threads, thread_name_prefix="sonarwarp")


def launch(
    kernel: Any,
    dim: tuple[int, ...],
    inputs: list[Any],
    outputs: list[Any],
    device: Any,
    threads: int = 1,
) -> None:
    """Launch ``kernel`` over ``dim``, its leading axis spread over CPU threads.

    Only for kernels whose leading index owns its outputs, or that write one value: CPU atomics are read-modify-write.
    Serial on CUDA and while the device is capturing a graph (a pool's launches would run eagerly and leave the graph
    empty). Leave ``threads`` at 1 under a tape, which would record the pieces.

    Args:
        kernel: a kernel whose first argument is ``first: int``.
        dim: launch dimensions, leading axis first.
        inputs: arguments after ``first``.
        outputs: output arguments.
        device: device of all arrays.
        threads: CPU threads to use.
    """
    device = wp.get_device(device)
    rows = dim[0]
    if min(dim) <= 0:
        return
    # Unoptimised CPU code shares one static pointer to the stack's tile storage between threads, used or not.
    unsafe = wp.config.mode == "debug" and wp.config.enable_tiles_in_stack_memory
    if threads <= 1 or rows < 2 or device.is_cuda or device.is_capturing or unsafe:
        wp.launch(kernel, dim, inputs=[0, *inputs], outputs=outputs, device=device)
        return
    kernel.module.load(device, block_dim=1)  # as launches on CPU do; another value builds the module twice
    pieces = min(rows, threads * _PIECES_PER_THREAD)
    bounds = [rows * piece // pieces for piece in range(pieces + 1)]

    def run(start: int, stop: int) -> None:
        wp.launch(kernel, (stop - start, *dim[1:]), inputs=[start, *inputs], outputs=outputs, device=device)

    jobs: list[Future[None]] = []
    try:
        for start, stop in itertools.pairwise(bounds):
            jobs.append(_pool(threads).submit(run, start, stop))
        wait(jobs)
    finally:
        # Interrupted, the caller would free the meshes that kernels still trace.
        for job in jobs:
            job.cancel()
        wait(jobs)
    for job in jobs:
        job.result()
