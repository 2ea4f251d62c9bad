"""How many of a cloud's points share a place, and which of them stand apart.

Frames a few millimetres apart meet one surface again and again; what few of them met is an error.
"""

from typing import Any

import warp as wp

from sonarwarp_kernels.estimate import QUALITY_NONE
from sonarwarp_kernels.field import check_field
from sonarwarp_kernels.launch import check_array, launch
from sonarwarp_kernels.specs import Grid

wp.set_module_options({"enable_backward": False})


@wp.func
def cube_of(origin: wp.vec3, edge: float, point: wp.vec3) -> wp.vec3i:
    """Indices of the cube that a point lies in, counted from an origin."""
    place = (point - origin) / edge
    return wp.vec3i(int(wp.floor(place[0])), int(wp.floor(place[1])), int(wp.floor(place[2])))


@wp.func
def cell_of(grid: Grid, owner: int, point: wp.vec3) -> wp.vec3i:
    """Indices of a world point's cell, inside the trajectory's box or not."""
    return cube_of(grid.origin[owner], grid.cell, point)


@wp.func
def is_inside(cell: wp.vec3i, size: wp.vec3i) -> bool:
    """Whether a cell lies in a box of ``size`` cells."""
    above = cell[0] >= 0 and cell[1] >= 0 and cell[2] >= 0
    return above and cell[0] < size[0] and cell[1] < size[1] and cell[2] < size[2]


@wp.func
def points_around(count: wp.array4d(dtype=int), size: wp.vec3i, owner: int, cell: wp.vec3i) -> int:
    """Points in a cell and the 26 next to it."""
    total = int(0)
    for ix in range(wp.max(cell[0] - 1, 0), wp.min(cell[0] + 2, size[0])):
        for iy in range(wp.max(cell[1] - 1, 0), wp.min(cell[1] + 2, size[1])):
            for iz in range(wp.max(cell[2] - 1, 0), wp.min(cell[2] + 2, size[2])):
                total += count[owner, ix, iy, iz]
    return total


@wp.kernel
def count_points_kernel(
    first: int,
    grid: Grid,
    trajectory: wp.array(dtype=int),  # [frame]
    quality: wp.array2d(dtype=int),  # [frame, beam]
    point: wp.array2d(dtype=wp.vec3),  # [frame, beam]
    count_out: wp.array4d(dtype=int),  # [trajectory, x, y, z]
):
    index, beam = wp.tid()
    frame = first + index
    if quality[frame, beam] != QUALITY_NONE:
        owner = trajectory[frame]
        cell = cell_of(grid, owner, point[frame, beam])
        if is_inside(cell, grid.size[owner]):
            wp.atomic_add(count_out, owner, cell[0], cell[1], cell[2], 1)


def count_points(
    grid: Grid, trajectory: wp.array, quality: wp.array, point: wp.array, count_out: wp.array, *, device: Any = None
) -> None:
    """Count the points in every cell; on one CPU thread, for points of many frames share a cell.

    Args:
        grid: cells.
        trajectory: owner of each frame, shape [frame].
        quality: ``QUALITY_NONE`` where there is no point, int32, shape [frame, beam].
        point: world [m], shape [frame, beam].
        count_out: added to, int32, shape [trajectory, x, y, z].
        device: device of all arrays.

    Raises:
        ValueError: an array of the wrong shape, type or device.
    """
    device = wp.get_device(device)
    shape = _check(grid, trajectory, "quality", quality, point, "count_out", count_out, device)
    launch(count_points_kernel, shape, [grid, trajectory, quality, point], [count_out], device)


@wp.kernel
def drop_strays_kernel(
    first: int,
    grid: Grid,
    trajectory: wp.array(dtype=int),  # [frame]
    point: wp.array2d(dtype=wp.vec3),  # [frame, beam]
    count: wp.array4d(dtype=int),  # [trajectory, x, y, z]
    least: int,
    quality_out: wp.array2d(dtype=int),  # [frame, beam]
):
    index, beam = wp.tid()
    frame = first + index
    if quality_out[frame, beam] == QUALITY_NONE:
        return
    owner = trajectory[frame]
    cell = cell_of(grid, owner, point[frame, beam])
    if points_around(count, grid.size[owner], owner, cell) < least:
        quality_out[frame, beam] = QUALITY_NONE


def drop_strays(
    grid: Grid,
    trajectory: wp.array,
    point: wp.array,
    count: wp.array,
    least: int,
    quality_out: wp.array,
    *,
    device: Any = None,
    threads: int = 1,
) -> None:
    """Take back points that stand apart.

    Args:
        grid: cells.
        trajectory: owner of each frame, shape [frame].
        point: world [m], shape [frame, beam].
        count: points in each cell (:func:`count_points`), shape [trajectory, x, y, z].
        least: fewest points in the 27 cells around a point that stays, itself included.
        quality_out: becomes ``QUALITY_NONE`` where a point stands apart, int32, shape [frame, beam].
        device: device of all arrays.
        threads: CPU threads.

    Raises:
        ValueError: an array of the wrong shape, type or device.
    """
    device = wp.get_device(device)
    shape = _check(grid, trajectory, "quality_out", quality_out, point, "count", count, device)
    launch(drop_strays_kernel, shape, [grid, trajectory, point, count, least], [quality_out], device, threads)


def _check(
    grid: Grid,
    trajectory: wp.array,
    quality_name: str,
    quality: wp.array,
    point: wp.array,
    count_name: str,
    count: wp.array,
    device: Any,
) -> tuple[int, int]:
    check_array("trajectory", trajectory, (None,), wp.int32, device)
    check_array(quality_name, quality, (trajectory.shape[0], None), wp.int32, device)
    check_array("point", point, quality.shape, wp.vec3, device)
    check_field(grid, count_name, count, wp.int32, device)
    return quality.shape
