"""Trajectories from OpenUSD: the time-sampled transform of a prim, and what the prim says of the run."""

# pyright: reportAttributeAccessIssue=false
# OpenUSD fills its modules when they load, where no type checker sees it.

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sonarwarp_scenes.checks import check_finite, check_positive
from sonarwarp_scenes.child import in_child
from sonarwarp_scenes.conversion import Conversion, Up, turned_up
from sonarwarp_scenes.files import readable
from sonarwarp_scenes.trajectories import Trajectory
from sonarwarp_scenes.usd import check_composed, stage_units

if TYPE_CHECKING:
    from pxr import Usd

FRAMES_FROM_ATTRIBUTE = "sonarwarp:framesFrom"

# Axes of a frame count as perpendicular within this, in cosines.
_SQUARE = 1.0e-6


def read_trajectory(
    path: str | Path,
    prim: str | None = None,
    *,
    scale: float | None = None,
    up: Up | None = None,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Trajectory:
    """How a prim of an OpenUSD file moves: a pose at each time sample of its transform and of those above it.

    Its own axes are taken for the vehicle's, x forward, y left, z up; in a stage with y up they are turned as the world
    is, so that y of the prim is up and z right. Scales are left out.

    Args:
        path: the file.
        prim: path of the prim. None: the only one whose own transform has time samples.
        scale: as in :func:`~sonarwarp_scenes.read_scene`.
        up: as there.
        origin: as there.

    Raises:
        ValueError: no such file or prim, one that cannot be read, several prims that move, a transform that is sheared,
            mirrored or flat, or poses that a :class:`Trajectory` refuses; one line that names the file.
        ModuleNotFoundError: usd-core is not installed.
    """
    conversion = Conversion(scale=scale, up=up, origin=origin)
    arrays, _ = in_child("trajectory", readable(path), conversion, prim=prim)
    return Trajectory(**arrays)


def read_frames_from(path: str | Path, prim: str | None = None) -> float | None:
    """When imaging may start [s], as a prim of an OpenUSD file says by its attribute ``sonarwarp:framesFrom``.

    It counts as the times of :func:`read_trajectory` do; :func:`~sonarwarp_scenes.write_deployment` writes it.

    Args:
        path: the file.
        prim: as for :func:`read_trajectory`.

    Returns:
        None where the prim does not say.

    Raises:
        ValueError: no such file or prim, one that cannot be read, several prims that move, or a value that is no finite
            number; one line that names the file.
        ModuleNotFoundError: usd-core is not installed.
    """
    _, frames_from = in_child("frames_from", readable(path), Conversion(), prim=prim)
    return frames_from


def trajectory_of_file(path: str, conversion: Conversion, prim: str | None) -> tuple[dict[str, np.ndarray], Any]:
    """Fields of the trajectory of a prim in a file."""
    from pxr import Usd

    trajectory = _trajectory(Usd.Stage.Open(path), conversion, prim)
    return {"times": trajectory.times, "poses": trajectory.poses}, None


def frames_from_of_file(path: str, _: Conversion, prim: str | None) -> tuple[dict[str, np.ndarray], Any]:
    """No arrays, and when imaging may start [s] as a prim in a file says, or None."""
    from pxr import Usd

    stage = Usd.Stage.Open(path)
    # Half a stage could lack the prim, or hold another that moves.
    check_composed(stage)
    moving = _moving_prim(stage, prim)
    attribute = moving.GetAttribute(FRAMES_FROM_ATTRIBUTE)
    if not attribute or not attribute.HasValue():
        return {}, None
    place = f"{moving.GetPath()}: {FRAMES_FROM_ATTRIBUTE}"
    value = attribute.Get()
    if isinstance(value, bool) or not isinstance(value, int | float):
        shown = textwrap.shorten(repr(value), 60, placeholder=" ...")
        raise ValueError(f"{place}: {shown}, must be one number [s] for all times")
    check_finite(place, value)
    return {}, float(value)


def _trajectory(stage: Usd.Stage, conversion: Conversion, path: str | None) -> Trajectory:
    from pxr import Usd, UsdGeom

    metres_per_unit, up = stage_units(stage)
    scale = metres_per_unit if conversion.scale is None else conversion.scale
    up = up if conversion.up is None else conversion.up
    prim = _moving_prim(stage, path)
    codes = set()
    above = prim
    while above:
        frame = UsdGeom.Xformable(above)
        codes.update(frame.GetTimeSamples() if frame else [])
        if frame and frame.GetResetXformStack():
            break
        above = above.GetParent()
    if not codes:
        raise ValueError(f"prim: {prim.GetPath()} does not move: its transform has no time samples")
    times = np.array(sorted(codes))
    frame = UsdGeom.Xformable(prim)
    matrices = np.array([np.array(frame.ComputeLocalToWorldTransform(Usd.TimeCode(code))) for code in times])
    positions = turned_up(scale * matrices[:, 3, :3], up) - np.array(conversion.origin)
    quaternions = _quaternions(str(prim.GetPath()), matrices[:, :3, :3])
    # A turn of the world about x turns the axes of rotations, and leaves their angles.
    quaternions[:, :3] = turned_up(quaternions[:, :3], up)
    rate = stage.GetTimeCodesPerSecond()
    check_positive("timeCodesPerSecond", rate)
    return Trajectory(times=times / rate, poses=np.concatenate([positions, quaternions], axis=1))


def _moving_prim(stage: Usd.Stage, path: str | None) -> Usd.Prim:
    from pxr import Sdf, Usd, UsdGeom

    if path is not None:
        prim = stage.GetPrimAtPath(path) if Sdf.Path.IsValidPathString(path)[0] else None
        if not prim or not prim.IsA(UsdGeom.Xformable):
            raise ValueError(f"prim: {path!r} is no prim with a transform")
        return prim
    moving = [
        prim
        for prim in stage.Traverse(Usd.TraverseInstanceProxies())
        if prim.IsA(UsdGeom.Xformable) and UsdGeom.Xformable(prim).GetTimeSamples()
    ]
    if len(moving) != 1:
        named = ", ".join(str(prim.GetPath()) for prim in moving[:5])
        raise ValueError(f"prim: {len(moving)} prims move ({named or 'none'}), must be one: name it")
    return moving[0]


def _quaternions(name: str, matrices: np.ndarray) -> np.ndarray:
    """Unit quaternions x, y, z, w of frames that may be scaled, [n, 4]; matrices [n, 3, 3] take row vectors."""
    from pxr import Gf

    lengths = np.linalg.norm(matrices, axis=2, keepdims=True)
    if not (np.isfinite(lengths).all() and (lengths > 0.0).all()):
        raise ValueError(f"{name}: transform with an axis of length 0 or not finite, must keep all three")
    axes = matrices / lengths
    skew = np.abs(axes @ axes.transpose(0, 2, 1) - np.eye(3)).max()
    if skew > _SQUARE:
        raise ValueError(f"{name}: sheared transform (a cosine of {skew:.3g} between axes), must be square")
    if (np.linalg.det(axes) < 0.0).any():
        raise ValueError(f"{name}: mirrored transform, must be right-handed")
    turns = [Gf.Matrix3d(*frame.ravel().tolist()).ExtractRotation().GetQuat() for frame in axes]
    return np.array([[*turn.GetImaginary(), turn.GetReal()] for turn in turns])
