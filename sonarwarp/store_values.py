"""What the columns of a log on disk hold: a survey's own arrays, and what the ICES convention derives from them."""

from __future__ import annotations

import math

import numpy as np

from sonarwarp.poses import compose, rotate
from sonarwarp.sonar import FLS, PS, Mount
from sonarwarp.survey import Frames, Pings, Survey


def fls_columns(survey: Survey) -> dict[str, np.ndarray]:
    """Values of :data:`sonarwarp.store.FLS_COLUMNS`."""
    frames, fls, mount = survey.frames, survey.rig.fls, survey.rig.fls_mount
    return {
        **_instant_values(frames, mount),
        "altitude": frames.altitude,
        "beam": np.arange(fls.beams),
        "azimuth": fls.azimuth,
        "range": _centres(fls),
        **_beam_values(
            mount, fls.azimuth, np.degrees(np.diff(fls.azimuth_edge)), np.full(fls.beams, fls.vertical_beamwidth_deg)
        ),
    }


def ps_columns(survey: Survey) -> dict[str, np.ndarray]:
    """Values of :data:`sonarwarp.store.PS_COLUMNS`."""
    pings, ps, mount = survey.pings, survey.rig.ps, survey.rig.ps_mount
    widths = [np.full(len(pings), width) for width in (ps.beamwidth_deg, ps.fan_beamwidth_deg)]
    major, minor = reversed(widths) if scans_vertically(mount) else widths
    return {
        **_instant_values(pings, mount),
        "head_angle": pings.head_angle,
        "range": _centres(ps),
        **_beam_values(mount, pings.head_angle, major, minor),
    }


def truth_columns(truth: Survey) -> dict[str, np.ndarray]:
    """Values of :data:`sonarwarp.store.TRUTH_COLUMNS`."""
    frames, pings = truth.frames, truth.pings
    return {
        "frame_position": frames.pose[:, :3],
        "frame_quaternion": frames.pose[:, 3:],
        "altitude": frames.altitude,
        "ping_position": pings.pose[:, :3],
        "ping_quaternion": pings.pose[:, 3:],
        "head_angle": pings.head_angle,
    }


def scans_vertically(mount: Mount) -> bool:
    """Whether a PS lies on its side, so that its head turns about a horizontal axis."""
    return abs(math.sin(math.radians(mount.roll_deg))) > math.sqrt(0.5)


def _centres(sonar: FLS | PS) -> np.ndarray:
    return 0.5 * (sonar.range_edge[:-1] + sonar.range_edge[1:])


def _instant_values(rows: Frames | Pings, mount: Mount) -> dict[str, np.ndarray]:
    pitch, roll = vehicle_attitude(rows.pose, mount)
    return {
        "ping_time": rows.time,
        "trajectory": rows.trajectory,
        "number": rows.number,
        "sensor_position": rows.pose[:, :3],
        "sensor_quaternion": rows.pose[:, 3:],
        "platform_pitch": pitch,
        "platform_roll": roll,
    }


def _beam_values(mount: Mount, azimuth: np.ndarray, major: np.ndarray, minor: np.ndarray) -> dict[str, np.ndarray]:
    phi, theta = beam_rotation(mount, azimuth)
    x, y, z = mount.position
    return {
        "beamwidth_receive_major": major,
        "beamwidth_receive_minor": minor,
        "rx_beam_rotation_phi": phi,
        "rx_beam_rotation_theta": theta,
        "rx_beam_rotation_psi": np.zeros(len(phi)),
        **{f"transducer_offset_{axis}": np.array(value) for axis, value in zip("xyz", (x, -y, -z), strict=True)},
    }


def vehicle_attitude(pose: np.ndarray, mount: Mount) -> tuple[np.ndarray, np.ndarray]:
    """Pitch, bow up, and roll, starboard down [deg], each of shape [n], of a vehicle that carries a sensor.

    Args:
        pose: world_from_sensor, shape [n, 7].
        mount: of the sensor.
    """
    x, y, z, w = mount.vehicle_from_sensor()[3:]
    vehicle = compose(pose, np.array([0.0, 0.0, 0.0, -x, -y, -z, w]))[:, 3:]
    forward, left, up = (rotate(vehicle, axis)[:, 2] for axis in np.eye(3))
    return np.degrees(np.arcsin(np.clip(forward, -1.0, 1.0))), np.degrees(np.arctan2(left, up))


def beam_rotation(mount: Mount, azimuth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The convention's phi and theta [deg] of beams at ``azimuth`` [rad] of a sonar, each of shape [n], psi being 0.

    Theta about y, then phi about x, turn the platform's z axis (down; x forward, y starboard) to the beam's; a beam
    that points up takes phi beyond 90 deg.
    """
    inside = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros_like(azimuth)], axis=-1)
    forward, left, up = rotate(mount.vehicle_from_sensor()[3:], inside).T
    upright = np.where(up <= 0.0, 1.0, -1.0)
    phi = np.arctan2(left, upright * np.hypot(forward, up))
    return np.degrees(phi), np.degrees(np.arctan2(upright * forward, -upright * up))
