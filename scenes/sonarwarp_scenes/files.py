"""Scenes from mesh files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sonarwarp_scenes.checks import check_positive
from sonarwarp_scenes.materials import CONCRETE
from sonarwarp_scenes.scene import Scene


def scene_from_file(path: str | Path, *, scale: float = 1.0, impedance: float = CONCRETE) -> Scene:
    """All triangles of a mesh file, in any format that trimesh reads, each part where the file's transforms put it.

    Axes are the file's own: a file with y up (glTF) must be turned before.

    Args:
        path: the file.
        scale: metres per unit of the file.
        impedance: acoustic impedance of every face [rayl].

    Raises:
        ValueError: no such file, a file that cannot be read, one without triangles, or a scene that
            :class:`~sonarwarp_scenes.Scene` refuses.
    """
    import trimesh

    check_positive("scale", scale)
    check_positive("impedance", impedance)
    if not Path(path).is_file():
        raise ValueError(f"path: no file at {path}")
    try:
        # Every format has its own parser, and each fails in its own way.
        parts = trimesh.load_scene(str(path)).dump()
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"path: cannot read {path} as a mesh: {reason}") from error
    meshes = [part for part in parts if isinstance(part, trimesh.Trimesh) and len(part.faces)]
    if not meshes:
        raise ValueError(f"path: {path} holds no triangles")
    try:
        return Scene.join(
            *(
                Scene(
                    vertices=scale * np.asarray(mesh.vertices),
                    faces=np.asarray(mesh.faces),
                    impedance=np.full(len(mesh.faces), impedance),
                )
                for mesh in meshes
            )
        )
    except ValueError as error:
        raise ValueError(f"path: {path}: {error}") from error
