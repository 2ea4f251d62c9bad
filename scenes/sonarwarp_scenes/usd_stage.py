"""What all OpenUSD files written here have in common: the stage, frames that move, curves, and how they are saved."""

# pyright: reportAttributeAccessIssue=false
# OpenUSD fills its modules when they load, where no type checker sees it.

from __future__ import annotations

import errno
import uuid
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sonarwarp_scenes.trajectories import Trajectory

if TYPE_CHECKING:
    from pxr import Gf, Sdf, Usd, UsdGeom

TIME_CODES_PER_SECOND = 32.0
"""A power of two, so that times in seconds come back bit for bit; near the frames that viewers show in a second."""


def new_stage(documentation: str) -> Usd.Stage:
    """An empty stage in metres, z up, with ``/World`` as its default prim."""
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    stage.SetTimeCodesPerSecond(TIME_CODES_PER_SECOND)
    stage.SetFramesPerSecond(TIME_CODES_PER_SECOND)
    stage.GetRootLayer().documentation = documentation
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    return stage


def set_times(stage: Usd.Stage, start: float, end: float) -> None:
    """Let viewers play from one time to another [s]; time code 0 is time 0."""
    stage.SetStartTimeCode(start * TIME_CODES_PER_SECOND)
    stage.SetEndTimeCode(end * TIME_CODES_PER_SECOND)


def free_path(stage: Usd.Stage, parent: Sdf.Path, name: str) -> Sdf.Path:
    """Path below ``parent`` for a prim called ``name``, or nearly so where characters or prims are in the way."""
    from pxr import Tf

    valid = Tf.MakeValidIdentifier(name)
    path, number = parent.AppendChild(valid), 1
    while stage.GetPrimAtPath(path):
        path, number = parent.AppendChild(f"{valid}_{number}"), number + 1
    return path


def add_curves(
    stage: Usd.Stage, path: Sdf.Path, lines: Sequence[np.ndarray], colour: tuple[float, float, float]
) -> None:
    """Polylines, 1 cm wide."""
    from pxr import UsdGeom, Vt

    curves = UsdGeom.BasisCurves.Define(stage, path)
    points = np.concatenate(lines).astype(np.float32)
    curves.CreateTypeAttr(UsdGeom.Tokens.linear)
    curves.CreateCurveVertexCountsAttr([len(line) for line in lines])
    curves.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    curves.CreateWidthsAttr([0.01])
    curves.SetWidthsInterpolation(UsdGeom.Tokens.constant)
    curves.CreateExtentAttr(extent(points, 0.005))
    curves.CreateDisplayColorAttr([colour])


def extent(points: np.ndarray, margin: float = 0.0) -> list[list[float]]:
    """Lowest and highest corner of the box around points [point, 3]."""
    return [(points.min(axis=0) - margin).tolist(), (points.max(axis=0) + margin).tolist()]


def add_still(stage: Usd.Stage, path: Sdf.Path, pose: np.ndarray) -> None:
    """A frame at ``pose`` [7]."""
    from pxr import Gf, UsdGeom

    frame = UsdGeom.Xform.Define(stage, path)
    frame.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(*pose[:3].tolist()))
    frame.AddOrientOp(UsdGeom.XformOp.PrecisionDouble).Set(_quaternion(pose))


def add_moving(stage: Usd.Stage, path: Sdf.Path, trajectory: Trajectory) -> UsdGeom.Xform:
    """A frame with a time sample at every pose."""
    from pxr import Gf, UsdGeom

    frame = UsdGeom.Xform.Define(stage, path)
    translate = frame.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble)
    orient = frame.AddOrientOp(UsdGeom.XformOp.PrecisionDouble)
    for time, pose in zip(trajectory.times.tolist(), trajectory.poses, strict=True):
        translate.Set(Gf.Vec3d(*pose[:3].tolist()), time * TIME_CODES_PER_SECOND)
        orient.Set(_quaternion(pose), time * TIME_CODES_PER_SECOND)
    return frame


def _quaternion(pose: np.ndarray) -> Gf.Quatd:
    from pxr import Gf

    x, y, z, w = pose[3:].tolist()
    return Gf.Quatd(w, x, y, z)


def _exported(stage: Usd.Stage, path: Path) -> bool:
    from pxr import Tf

    try:
        return stage.GetRootLayer().Export(str(path))
    except Tf.ErrorException:
        return False


def save(stage: Usd.Stage, path: Path) -> None:
    """Write to a file beside ``path`` first, so that a failure leaves what was there.

    Raises:
        ValueError: a suffix other than .usda, .usdc or .usd.
        OSError: the folder does not exist, may not be written, or its disk is full.
    """
    if path.suffix not in (".usda", ".usdc", ".usd"):
        raise ValueError(f"path: {path}, must end in .usda, .usdc or .usd")
    if not path.parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, "no such folder", str(path.parent))
    draft = path.with_name(f".{uuid.uuid4().hex}{path.suffix}")
    try:
        # OpenUSD makes folders that are missing, and says little about why it cannot write: Python says it here.
        draft.touch()
        if path.suffix == ".usda":
            draft.write_text(stage.GetRootLayer().ExportToString())
        elif not _exported(stage, draft):
            raise OSError(errno.EIO, "cannot be written in full, is the disk full?")
        draft.replace(path)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        draft.unlink(missing_ok=True)
