"""What sound meets: triangles with an acoustic impedance each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sonarwarp_scenes.checks import check_reach, check_shape, read_only


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """Triangles in the world frame, z up. Arrays are copied on the way in and read-only afterwards.

    Raises:
        ValueError: an empty array, another shape, a value that is not finite, a vertex beyond 10 km of the origin, a
            face that names no vertex, an impedance that is not positive, or faces that all have zero area.
    """

    vertices: np.ndarray
    """Corner positions [m], float64, shape [vertex, 3]."""

    faces: np.ndarray
    """Vertex indices of each triangle, int32, shape [face, 3]; counter-clockwise seen from outside."""

    impedance: np.ndarray
    """Acoustic impedance of each face [rayl], float32, shape [face]."""

    def __post_init__(self) -> None:
        vertices = read_only("vertices", self.vertices, (None, 3))
        check_reach("vertices", vertices)
        faces = _checked_faces(self.faces, len(vertices))
        corners = vertices[faces]
        if not np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).any():
            raise ValueError(f"faces: all {len(faces)} have zero area, at least one must not")
        impedance = read_only("impedance", self.impedance, (len(faces),))
        bound = np.finfo(np.float32)
        wrong = np.flatnonzero((impedance < bound.tiny) | (impedance > bound.max))
        if wrong.size:
            raise ValueError(f"impedance: {impedance[wrong[0]]} at face {wrong[0]}, must be positive and fit float32")
        impedance = impedance.astype(np.float32)
        impedance.setflags(write=False)
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)
        object.__setattr__(self, "impedance", impedance)

    @staticmethod
    def join(*scenes: Scene) -> Scene:
        """All triangles of ``scenes`` as one scene, in the order given.

        Raises:
            ValueError: no scene given.
        """
        if not scenes:
            raise ValueError("scenes: none given, must be at least one")
        first_vertex = np.cumsum([0, *(len(scene.vertices) for scene in scenes[:-1])])
        return Scene(
            vertices=np.concatenate([scene.vertices for scene in scenes]),
            faces=np.concatenate([scene.faces + first for scene, first in zip(scenes, first_vertex, strict=True)]),
            impedance=np.concatenate([scene.impedance for scene in scenes]),
        )

    def moved(self, offset: np.ndarray | tuple[float, float, float]) -> Scene:
        """The scene shifted by ``offset`` [m], shape [3]."""
        shift = read_only("offset", offset, (3,))
        return Scene(vertices=self.vertices + shift, faces=self.faces, impedance=self.impedance)

    def bounds(self) -> np.ndarray:
        """Lowest and highest corner of the box around the faces [m], shape [2, 3]; vertices without a face are out."""
        corners = self.vertices[self.faces]
        return np.stack([corners.min(axis=(0, 1)), corners.max(axis=(0, 1))])


def _checked_faces(values: np.ndarray, vertices: int) -> np.ndarray:
    faces = np.asarray(values)
    check_shape("faces", faces, (None, 3))
    if faces.dtype.kind not in "iu":
        raise ValueError(f"faces: dtype {faces.dtype}, must be integers")
    outside = np.argwhere((faces < 0) | (faces >= vertices))
    if len(outside):
        face, corner = (int(axis) for axis in outside[0])
        raise ValueError(f"faces: index {faces[face, corner]} at face {face}, must be in 0..{vertices - 1}")
    faces = np.array(faces, dtype=np.int32)
    faces.setflags(write=False)
    return faces
