"""A mesh half-buried on a rough seabed under a run of a rig: for the demo, and as a scene in a file."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

import sonarwarp as sw
from sonarwarp.toml_settings import read_rig
from sonarwarp_scenes import (
    Deployment,
    Roughness,
    Scene,
    SonarOutline,
    bury,
    exposed_bounds,
    mesh_deployment,
    read_scene,
    write_deployment,
)

RIG = "paper simulation"
"""Preset that passes over meshes."""

# Altitudes over a mesh: as low as its width, and a fifth more, stays inside the FLS's swath. Under 2 m the swath is
# gone before the PS has been round; over 3.5 m the window of the FLS ends before the seabed [m].
_SWATH_MARGIN = 1.2
_LOWEST, _HIGHEST = 2.0, 3.5

# Water between the vehicle and a mesh's top, at least [m].
_CLEARANCE = 1.5

# Outlines begin no nearer [m], and reach no farther to either side than they can be drawn [rad].
_NEAREST = 0.01
_WIDEST = 0.5 * math.pi


def bury_mesh(path: Path, rig: sw.Rig, *, scale: float | None, altitude: float | None, seed: int) -> Deployment:
    """A mesh, half-buried on a rough seabed, and a run over it.

    Args:
        path: mesh file or OpenUSD stage, z up.
        rig: what passes over it.
        scale: metres per unit of the file; its own, or 1, if None.
        altitude: of the vehicle over the mean seabed [m]; None: the lowest of 2 to 3.5 m from which the FLS's swath
            covers what is over the seabed, or 1.5 m over its top where that is more.
        seed: of the rough seabed.

    Raises:
        ValueError: a file that is no mesh, or a size or altitude that makes no run.
    """
    mesh, _ = read_scene(path, scale=scale)
    return mesh_deployment(
        mesh,
        name=path.stem,
        altitude=_altitude(mesh, rig) if altitude is None else altitude,
        roughness=Roughness(seed=seed),
    )


def _altitude(mesh: Scene, rig: sw.Rig) -> float:
    _, width, height = np.ptp(exposed_bounds(bury(mesh)), axis=0)
    lower_edge = math.radians(rig.fls_mount.tilt_deg) + rig.fls.half_elevation
    swath_per_altitude = 2.0 * math.sin(rig.fls.azimuth_edge[-1]) / math.sin(lower_edge)
    covering = min(max(_SWATH_MARGIN * width / swath_per_altitude, _LOWEST), _HIGHEST)
    return float(max(covering, height + _CLEARANCE))


def bury_file(
    mesh: Path, out: Path, *, rig: Path | None, scale: float | None, altitude: float | None, seed: int
) -> dict[str, Any]:
    """Write what :func:`bury_mesh` makes as an OpenUSD stage that ``simulate`` takes and viewers play.

    The stage says when imaging may start; so does what is returned.

    Args:
        mesh: mesh file or OpenUSD stage, z up.
        out: the stage.
        rig: TOML file of the rig that passes over the mesh; the preset :data:`RIG` if None.
        scale, altitude, seed: as for :func:`bury_mesh`.

    Raises:
        ValueError: as for :func:`bury_mesh`, or a file of another kind to write.
    """
    carried = sw.PRESETS[RIG] if rig is None else read_rig(rig)
    deployment = bury_mesh(mesh, carried, scale=scale, altitude=altitude, seed=seed)
    write_deployment(out, deployment, sonars=_outlines(carried))
    trajectory = deployment.trajectory
    return {
        "scene": str(out),
        "part": deployment.bodies[-1][0],
        "triangles": len(deployment.scene.faces),
        "altitude": float(trajectory.poses[0, 2]),
        "duration": float(trajectory.times[-1]),
        "frames_from": deployment.frames_from,
        "seed": seed,
    }


def _outlines(rig: sw.Rig) -> list[SonarOutline]:
    half_azimuth = float(np.abs(rig.fls.azimuth_edge).max())
    half_sector = 0.5 * math.radians(rig.ps.sector_deg)
    half_fan = 0.5 * math.radians(rig.ps.fan_beamwidth_deg)
    return [
        SonarOutline(
            name=name,
            vehicle_from_sensor=tuple(mount.vehicle_from_sensor().tolist()),
            half_azimuth=min(half_angle, _WIDEST),
            half_elevation=half_elevation,
            range_min=max(float(edges[0]), _NEAREST),
            range_max=float(edges[-1]),
        )
        for name, mount, half_angle, half_elevation, edges in (
            ("FLS", rig.fls_mount, half_azimuth, rig.fls.half_elevation, rig.fls.range_edge),
            ("PS", rig.ps_mount, half_sector, half_fan, rig.ps.range_edge),
        )
    ]
