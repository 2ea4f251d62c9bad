"""Where a trajectory's likelihood field needs cells: the part of the FLS's region of interest that it may ask about."""

from __future__ import annotations

import numpy as np
import warp as wp

from sonarwarp.poses import rotate
from sonarwarp.settings import LikelihoodField
from sonarwarp.sonar import FLS
from sonarwarp.survey import Survey, group_rows
from sonarwarp_kernels.specs import Grid

# Margin around the region of interest: a PS beam's half width at 5 m [m].
_MARGIN = 0.1


def plan_grid(survey: Survey, settings: LikelihoodField, device: wp.Device) -> Grid:
    """Cells around every trajectory's region of interest.

    The region of a frame spans its azimuths and elevations between ``settings.near`` times r_emin and r_emin, at the
    frame's own attitude and altitude.

    Raises:
        ValueError: a box of 2 GiB or more, which kernels cannot index.
    """
    owned = group_rows(survey.frames.trajectory, survey.trajectories)
    boxes = [_region(survey, rows, settings.near) for rows in owned]
    filled = [box for box in boxes if len(box)]
    if not filled:
        raise ValueError("survey.frames: empty, nothing to reconstruct")
    low = np.array([box.min(axis=0) if len(box) else filled[0].min(axis=0) for box in boxes]) - _MARGIN
    high = np.array([box.max(axis=0) if len(box) else filled[0].min(axis=0) for box in boxes]) + _MARGIN
    # The origin stands on a multiple of a cell, up to one under the lowest corner.
    size = np.ceil((high - low) / settings.cell).astype(int) + 1
    cells = size.max(axis=0)
    if 4 * int(np.prod(cells.astype(object))) >= 2**31:
        size = " x ".join(str(count) for count in cells)
        raise ValueError(f"likelihood_field.cell: {settings.cell:g} m gives {size} cells, over 2 GiB; raise it")
    grid = Grid()
    grid.origin = wp.array(np.floor(low / settings.cell) * settings.cell, dtype=wp.vec3, device=device)
    grid.size = wp.array(size, dtype=wp.vec3i, device=device)
    grid.cell = settings.cell
    grid.nx, grid.ny, grid.nz = (int(count) for count in cells)
    return grid


def _region(survey: Survey, rows: np.ndarray, near: float) -> np.ndarray:
    """Corner points of the frames' regions of interest, world [m], shape [point, 3]."""
    fls, frames = survey.rig.fls, survey.frames
    direction = _border(fls)
    down = -rotate(frames.pose[rows, None, 3:], _edge(fls, -fls.half_elevation))[..., 2]
    with np.errstate(divide="ignore"):
        seabed = np.where(down > 0.0, frames.altitude[rows, None] / down, np.inf)
    far = np.minimum(seabed.max(axis=1, initial=0.0), fls.range_edge[-1])
    turned = rotate(frames.pose[rows, None, 3:], direction)
    reach = np.array([near, 1.0])[:, None, None, None] * far[None, :, None, None]
    return (frames.pose[rows, None, :3] + reach * turned).reshape(-1, 3)


def _border(fls: FLS) -> np.ndarray:
    half = fls.half_elevation
    return np.concatenate([_edge(fls, elevation) for elevation in (-half, 0.0, half)])


def _edge(fls: FLS, elevation: float) -> np.ndarray:
    """Unit directions at one elevation over the fan's azimuths, sonar frame, shape [azimuth, 3]."""
    azimuth = np.linspace(fls.azimuth_edge[0], fls.azimuth_edge[-1], 9)
    if fls.cone:
        inner = np.cos(azimuth)
        return np.stack([inner * np.cos(elevation), np.sin(azimuth), inner * np.sin(elevation)], axis=-1)
    level = np.cos(elevation)
    height = np.full_like(azimuth, np.sin(elevation))
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), height], axis=-1)
