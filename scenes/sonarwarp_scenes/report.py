"""What was found in a file, and what was made of it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, kw_only=True)
class ImpedanceReport:
    """Acoustic impedance of some faces of a part, and where it came from."""

    source: str
    """The attribute, primvar, material or name, in words; ``default`` where the file says nothing."""

    faces: int
    """Triangles of one copy of the part."""

    lowest: float
    """[rayl]."""

    highest: float
    """[rayl]."""


@dataclass(frozen=True, kw_only=True)
class PartReport:
    """One mesh of a file."""

    name: str
    """Prim path (OpenUSD) or node name."""

    copies: int
    """Times that it stands in the scene: over 1 for instances of a point instancer."""

    faces: int
    """Triangles in the scene, all copies together."""

    degenerate: int
    """Faces that were dropped, all copies together: of fewer than three corners, or of no area in single precision."""

    polygons: int
    """Faces of more than three corners that were cut into triangles, in one copy."""

    tangled: int
    """Polygons among them that cross themselves, and are covered only roughly."""

    flipped: int
    """Triangles of one copy that were turned over, to agree with their neighbours or to face outwards. Those that a
    left-handed or mirrored part turns are as its author meant them, and not counted."""

    open: int
    """Triangles of one copy on surfaces with a border, of which nothing says which side is out."""

    unclear: int
    """Triangles of one copy on surfaces with one side only, or with edges that three triangles or more share."""

    subdivision: str
    """Subdivision scheme, which is ignored: the cage is what stands in the scene. ``none`` where there is none."""

    impedances: tuple[ImpedanceReport, ...]
    """One entry per source."""


@dataclass(frozen=True, kw_only=True)
class SceneReport:
    """What :func:`~sonarwarp_scenes.read_scene` found in a file."""

    reader: str
    """``OpenUSD`` or ``trimesh``."""

    metres_per_unit: float
    """Factor that lengths were multiplied by."""

    up: str
    """Axis of the file that points up, ``y`` or ``z``."""

    parts: tuple[PartReport, ...]
    """Meshes, in the order of the scene's faces."""

    skipped: tuple[str, ...]
    """What was left out, and why."""

    def faces_of(self, name: str) -> np.ndarray:
        """Which faces of the scene belong to a part, shape [face].

        Args:
            name: of a part, or the last word of its prim path; also of a prim, for all parts below it.

        Raises:
            ValueError: no such part.
        """
        wanted = name.rstrip("/")
        asked = [
            part.name == wanted or part.name.startswith(f"{wanted}/") or part.name.rsplit("/", 1)[-1] == wanted
            for part in self.parts
        ]
        if not any(asked):
            raise ValueError(f"part: {name!r}, must be one of {', '.join(part.name for part in self.parts)}")
        return np.repeat(asked, [part.faces for part in self.parts])

    def as_dict(self) -> dict[str, Any]:
        """The report as plain dictionaries, lists, strings and numbers, as for JSON."""
        return asdict(self)

    @staticmethod
    def from_dict(values: dict[str, Any]) -> SceneReport:
        """What :meth:`as_dict` gave."""
        parts = tuple(
            PartReport(**{**part, "impedances": tuple(ImpedanceReport(**entry) for entry in part["impedances"])})
            for part in values["parts"]
        )
        return SceneReport(**{**values, "parts": parts, "skipped": tuple(values["skipped"])})

    def notes(self) -> list[str]:
        """What a person should know before trusting the scene, a line each; empty where all is well."""
        lines = []
        for part in self.parts:
            default = sum(entry.faces for entry in part.impedances if entry.source == "default")
            found = (
                (part.degenerate, "faces without area dropped"),
                (part.tangled, "polygons cross themselves and are covered roughly"),
                (part.flipped, "triangles turned over"),
                (part.open, "triangles on open surfaces, outside unknown"),
                (part.unclear, "triangles on surfaces whose sense is unclear"),
                (default, "faces of default impedance"),
            )
            lines += [f"{part.name}: {count} {what}" for count, what in found if count]
            if part.subdivision != "none":
                lines.append(f"{part.name}: subdivision {part.subdivision} ignored")
        return lines + [f"skipped {entry}" for entry in self.skipped]
