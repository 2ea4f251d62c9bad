"""What the FLS really met: the truth that a simulation can give beside its images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from sonarwarp.scene_table import DeviceScenes, scene_of_trajectory
from sonarwarp.survey import Survey
from sonarwarp_kernels import raycast
from sonarwarp_kernels.launch import cpu_threads
from sonarwarp_scenes import Scene


@dataclass(frozen=True, kw_only=True, eq=False)
class FirstContacts:
    """Nearest surface in every beam, all of shape [frame, beam]; see ``sonarwarp_kernels.raycast.first_contacts``."""

    range: np.ndarray
    """Slant range [m]; infinite where nothing lies in the window."""
    azimuth: np.ndarray
    """[rad]."""
    elevation: np.ndarray
    """[rad]."""
    face: np.ndarray
    """Face of the trajectory's scene; -1 where nothing lies in the window."""


def first_contacts(
    survey: Survey,
    scenes: Sequence[Scene],
    *,
    scene_of: Sequence[int] | None = None,
    azimuths: int = 3,
    elevations: int = 512,
    device: str | None = None,
    threads: int | None = None,
) -> FirstContacts:
    """Cast ``azimuths`` x ``elevations`` rays in every beam of every frame and keep the nearest hit.

    Args:
        survey: frames, with their true poses.
        scenes: what the sonar looks at.
        scene_of: scene of each trajectory; scene i for trajectory i by default, or the only one.
        azimuths: rays across a beam.
        elevations: rays along a beam; 512 over 14 deg are 2 mm apart at 4 m.
        device: Warp device.
        threads: CPU threads; all cores by default.
    """
    place = wp.get_device(device)
    frames = survey.frames
    uploaded = DeviceScenes(scenes, place)
    chosen = scene_of_trajectory(scene_of, survey.trajectories, len(scenes))
    shape = (len(frames), survey.rig.fls.beams)
    out = {name: wp.zeros(shape, dtype=float, device=place) for name in ("range", "azimuth", "elevation")}
    face = wp.zeros(shape, dtype=int, device=place)
    raycast.first_contacts(
        survey.rig.fls.fan(place),
        uploaded.table,
        wp.array(frames.pose, dtype=wp.transform, device=place),
        wp.array(chosen[frames.trajectory], dtype=int, device=place),
        azimuths,
        elevations,
        out["range"],
        out["azimuth"],
        out["elevation"],
        face,
        device=place,
        threads=threads or cpu_threads(),
    )
    host = {name: values.numpy() for name, values in out.items()}
    face_host = face.numpy()
    host["range"] = np.where(face_host == int(raycast.NO_FACE), np.inf, host["range"])
    return FirstContacts(**host, face=face_host)
