"""What the FLS really met: the truth that a simulation can give beside its images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from sonarwarp.scene_table import DeviceScenes, scene_of_trajectory
from sonarwarp.sonar import FLS
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


class ContactCaster:
    """Casts a grid of rays in every beam and keeps the nearest hit.

    Args:
        fls: the sonar.
        scenes: what it looks at, on the device.
        azimuths: rays across a beam.
        elevations: rays along a beam; 512 over 14 deg are 2 mm apart at 4 m.
        device: where the scenes are.
        threads: CPU threads; all cores by default.
    """

    def __init__(
        self,
        fls: FLS,
        scenes: DeviceScenes,
        *,
        azimuths: int,
        elevations: int,
        device: wp.Device,
        threads: int | None = None,
    ) -> None:
        self._scenes = scenes
        self._fan = fls.fan(device)
        self._beams = fls.beams
        self._grid = (azimuths, elevations)
        self._on = {"device": device, "threads": threads or cpu_threads()}

    def cast(self, pose: np.ndarray, scene: np.ndarray) -> FirstContacts:
        """First contacts of some frames.

        Args:
            pose: world_from_sensor, shape [frame, 7].
            scene: index of each frame's scene, shape [frame].
        """
        device, shape = self._on["device"], (len(pose), self._beams)
        out = {name: wp.zeros(shape, dtype=float, device=device) for name in ("range", "azimuth", "elevation")}
        face = wp.zeros(shape, dtype=int, device=device)
        raycast.first_contacts(
            self._fan,
            self._scenes.table,
            wp.array(pose, dtype=wp.transform, device=device),
            wp.array(scene, dtype=int, device=device),
            *self._grid,
            out["range"],
            out["azimuth"],
            out["elevation"],
            face,
            **self._on,
        )
        host = {name: values.numpy() for name, values in out.items()}
        face_host = face.numpy()
        host["range"] = np.where(face_host == int(raycast.NO_FACE), np.float32(np.inf), host["range"])
        return FirstContacts(**host, face=face_host)


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
    uploaded = DeviceScenes(scenes, place)
    chosen = scene_of_trajectory(scene_of, survey.trajectories, len(scenes))
    caster = ContactCaster(
        survey.rig.fls, uploaded, azimuths=azimuths, elevations=elevations, device=place, threads=threads
    )
    return caster.cast(survey.frames.pose, chosen[survey.frames.trajectory])
