"""Height of the highest point in every column of cells: under it faces may stand."""

from typing import Any

import warp as wp

from sonarwarp_kernels.crowd import cell_of
from sonarwarp_kernels.estimate import QUALITY_NONE
from sonarwarp_kernels.field import check_grid
from sonarwarp_kernels.launch import check_array, launch
from sonarwarp_kernels.specs import Grid

wp.set_module_options({"enable_backward": False})

NO_TOP = wp.constant(-1)
"""Height of a column of cells without any point."""

TOP_STEPS = wp.constant(1000.0)
"""Heights are counted in this part of a metre: maxima of integers do not depend on their order."""

NO_HEIGHT = wp.constant(-1.0e30)
"""World height where there is no point [m]."""


@wp.kernel
def raise_tops_kernel(
    first: int,
    grid: Grid,
    trajectory: wp.array(dtype=int),  # [frame]
    quality: wp.array2d(dtype=int),  # [frame, beam]
    point: wp.array2d(dtype=wp.vec3),  # [frame, beam]
    top_out: wp.array3d(dtype=int),  # [trajectory, x, y]
):
    index, beam = wp.tid()
    frame = first + index
    if quality[frame, beam] != QUALITY_NONE:
        owner = trajectory[frame]
        cell = cell_of(grid, owner, point[frame, beam])
        size = grid.size[owner]
        if cell[0] >= 0 and cell[1] >= 0 and cell[0] < size[0] and cell[1] < size[1]:
            height = point[frame, beam][2] - grid.origin[owner][2]
            wp.atomic_max(top_out, owner, cell[0], cell[1], int(wp.round(height * TOP_STEPS)))


def raise_tops(
    grid: Grid, trajectory: wp.array, quality: wp.array, point: wp.array, top_out: wp.array, *, device: Any = None
) -> None:
    """Raise each column of cells to its highest point; on one CPU thread, for points share a column.

    Args:
        grid: cells.
        trajectory: owner of each frame, shape [frame].
        quality: ``QUALITY_NONE`` where there is no point, int32, shape [frame, beam].
        point: world [m], shape [frame, beam].
        top_out: height over the box's origin in units of 1 / ``TOP_STEPS`` m, filled with ``NO_TOP`` beforehand, int32,
            shape [trajectory, x, y].
        device: device of all arrays.

    Raises:
        ValueError: an array of the wrong shape, type or device.
    """
    device = wp.get_device(device)
    check_grid(grid, device)
    check_array("trajectory", trajectory, (None,), wp.int32, device)
    check_array("quality", quality, (trajectory.shape[0], None), wp.int32, device)
    check_array("point", point, quality.shape, wp.vec3, device)
    check_array("top_out", top_out, (grid.origin.shape[0], grid.nx, grid.ny), wp.int32, device)
    launch(raise_tops_kernel, quality.shape, [grid, trajectory, quality, point], [top_out], device)


@wp.func
def top_height(grid: Grid, top: wp.array3d(dtype=int), owner: int, point: wp.vec3) -> float:
    """World height of the highest contact in the column of cells of a point [m]; ``NO_HEIGHT`` where there is none."""
    cell = cell_of(grid, owner, point)
    size = grid.size[owner]
    if cell[0] < 0 or cell[1] < 0 or cell[0] >= size[0] or cell[1] >= size[1]:
        return NO_HEIGHT
    height = top[owner, cell[0], cell[1]]
    if height == NO_TOP:
        return NO_HEIGHT
    return grid.origin[owner][2] + float(height) / TOP_STEPS
