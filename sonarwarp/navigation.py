"""How a vehicle really moves, and what its navigation believes: keyed errors, independent of batch and order.

Motion puts waves on a planned run. Navigation then measures the moved run with a DVL, a pressure meter, a gyroscope and
an altimeter; mounts and the PS's head are known up to an error per run. What is called "half bias, half white" splits
the variance evenly between a constant of the run and values independent from fix to fix.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sonarwarp.checks import in_range
from sonarwarp.poses import turned
from sonarwarp.sonar import Mount, Rig
from sonarwarp.survey import Survey, join_surveys, plan_survey
from sonarwarp_scenes import Trajectory

# Time step at which a moved run is sampled [s]: a hundredth of the shortest default period.
_STEP = 0.05

# Streams of a run's random numbers, so that switching one part off leaves the others as they were.
_MOTION, _TRACK, _DEPTH, _ATTITUDE, _ALTITUDE, _HEAD, _MOUNTS = range(7)


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Sinusoids on a planned run, their phases drawn per run; an amplitude of 0 switches one off.

    All defaults are ours, for a small hovering AUV in a slight swell: the paper gives no motion of its vehicle.
    """

    heave: float = 0.03
    """Amplitude of heave [m]."""
    heave_period: float = 8.0
    """[s]."""
    roll_deg: float = 1.0
    """Amplitude of roll [deg]."""
    pitch_deg: float = 1.0
    """Amplitude of pitch [deg]."""
    tilt_period: float = 6.0
    """Period of roll and pitch [s]."""
    yaw_deg: float = 1.0
    """Amplitude of yaw [deg]."""
    yaw_period: float = 10.0
    """[s]."""

    def __post_init__(self) -> None:
        for name in ("heave", "roll_deg", "pitch_deg", "yaw_deg"):
            in_range(f"Motion.{name}", getattr(self, name), 0.0, 90.0)
        for name in ("heave_period", "tilt_period", "yaw_period"):
            in_range(f"Motion.{name}", getattr(self, name), 0.1, 1e6)

    @property
    def still(self) -> bool:
        """Whether no part is on."""
        return not (self.heave or self.roll_deg or self.pitch_deg or self.yaw_deg)


NO_MOTION = Motion(heave=0.0, roll_deg=0.0, pitch_deg=0.0, yaw_deg=0.0)
"""Runs as they are planned."""


@dataclass(frozen=True, kw_only=True)
class Navigation:
    """Errors of the vehicle's instruments, standard deviations unless said otherwise; 0 switches a part off.

    The DVL's are the paper's (section 3.3: 0.2 % and 0.1 cm/s). The rest is ours: what a pressure meter, a fibre-optic
    gyroscope and an altimeter of a small AUV are sold with, and what a tape measure and a bracket leave of the mounts.
    """

    dvl_scale: float = 0.002
    """Relative error of speed, constant per run."""
    dvl_noise: float = 0.001
    """Error of velocity, independent per fix and axis [m/s]."""
    dvl_bias: float = 0.0
    """Error of velocity, constant per run and axis [m/s]; 0.001 is a stress case."""
    fix_rate: float = 5.0
    """Fixes per second [Hz]."""
    depth: float = 0.01
    """Depth, half bias, half white [m]."""
    attitude_deg: float = 0.1
    """Roll, pitch and yaw, half bias, half white [deg]."""
    altitude: float = 0.01
    """Altitude, half bias, half white [m]."""
    head_angle_deg: float = 0.2
    """Zero of the PS's head, constant per run [deg]."""
    lever_arm: float = 0.01
    """Position of each sonar on the vehicle, constant per run and axis [m]."""
    boresight_deg: float = 0.2
    """Direction of each sonar, constant per run and axis [deg]."""

    def __post_init__(self) -> None:
        for name in ("dvl_scale", "dvl_noise", "dvl_bias", "depth", "attitude_deg", "altitude"):
            in_range(f"Navigation.{name}", getattr(self, name), 0.0, 10.0)
        for name in ("head_angle_deg", "lever_arm", "boresight_deg"):
            in_range(f"Navigation.{name}", getattr(self, name), 0.0, 10.0)
        in_range("Navigation.fix_rate", self.fix_rate, 0.1, 1e3)

    @property
    def reckons_exactly(self) -> bool:
        """Whether the vehicle's pose has no error; altitude, head and mounts may have."""
        return not (self.dvl_scale or self.dvl_noise or self.dvl_bias or self.depth or self.attitude_deg)


EXACT_NAVIGATION = Navigation(
    dvl_scale=0.0,
    dvl_noise=0.0,
    depth=0.0,
    attitude_deg=0.0,
    altitude=0.0,
    head_angle_deg=0.0,
    lever_arm=0.0,
    boresight_deg=0.0,
)
"""Instruments and mounts without error: what is believed is true."""


def _random(seed: int, key: int, stream: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(key, stream)))


def moved(planned: Trajectory, motion: Motion, *, seed: int, key: int = 0) -> Trajectory:
    """A planned run with heave, roll, pitch and yaw on it.

    Args:
        planned: what was asked of the vehicle.
        motion: amplitudes and periods.
        seed: of the phases.
        key: what names the run.
    """
    if motion.still:
        return planned
    start, stop = planned.times[0], planned.times[-1]
    times = np.linspace(start, stop, max(math.ceil((stop - start) / _STEP), 1) + 1)
    phase = _random(seed, key, _MOTION).uniform(0.0, 2.0 * math.pi, 4)

    def wave(period: float, which: int) -> np.ndarray:
        return np.sin(2.0 * math.pi * times / period + phase[which])

    poses = planned.at(times)
    poses[:, 2] += motion.heave * wave(motion.heave_period, 0)
    angles = np.stack(
        [
            motion.roll_deg * wave(motion.tilt_period, 1),
            motion.pitch_deg * wave(motion.tilt_period, 2),
            motion.yaw_deg * wave(motion.yaw_period, 3),
        ],
        axis=-1,
    )
    return Trajectory(times=times, poses=turned(poses, np.radians(angles)))


def navigated(truth: Trajectory, navigation: Navigation, *, seed: int, key: int = 0) -> Trajectory:
    """What dead reckoning believes of a run: exact at its start but for depth and attitude, drifting from there."""
    if navigation.reckons_exactly:
        return truth
    start, stop = truth.times[0], truth.times[-1]
    times = np.append(np.arange(start, stop, 1.0 / navigation.fix_rate), stop)
    poses = truth.at(times)
    random = _random(seed, key, _TRACK)
    scale = 1.0 + navigation.dvl_scale * random.standard_normal()
    bias = navigation.dvl_bias * random.standard_normal(2)
    noise = navigation.dvl_noise * random.standard_normal((len(times) - 1, 2))
    steps = np.diff(poses[:, :2], axis=0) * scale + (bias + noise) * np.diff(times)[:, None]
    poses[1:, :2] = poses[0, :2] + np.cumsum(steps, axis=0)
    poses[:, 2] += navigation.depth * _half_bias(_random(seed, key, _DEPTH), (len(times), 1))[:, 0]
    angles = np.radians(navigation.attitude_deg) * _half_bias(_random(seed, key, _ATTITUDE), (len(times), 3))
    return Trajectory(times=times, poses=turned(poses, angles))


def _half_bias(random: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    """Unit deviation, half its variance constant along the first axis."""
    return math.sqrt(0.5) * (random.standard_normal((1, shape[1])) + random.standard_normal(shape))


def plan_disturbed(
    rig: Rig,
    planned: Sequence[Trajectory],
    *,
    motion: Motion = NO_MOTION,
    navigation: Navigation = EXACT_NAVIGATION,
    seed: int = 0,
    keys: Sequence[int] | None = None,
    frames_from: Sequence[float] | float = -math.inf,
    seabed_z: float = 0.0,
) -> tuple[Survey, Survey]:
    """Surveys of some runs as they were and as navigation believes them: simulate the first, reconstruct the second.

    Without motion and errors both are what ``plan_survey`` gives, to the bit.

    Args:
        rig: sonars and mounts as they are believed to be.
        planned: what was asked of the vehicle.
        motion: waves on each run.
        navigation: errors of the instruments.
        seed: of motion and errors.
        keys: what names each run; its index by default.
        frames_from: time from which the FLS records [s], one or one per run.
        seabed_z: height of the mean seabed [m].

    Raises:
        ValueError: as ``plan_survey``; a seed or key outside 64 bits; an altitude that is not above 0 once the vehicle
            has moved.
    """
    names = range(len(planned)) if keys is None else keys
    for key in names:
        in_range("keys", key, 0, 2**64 - 1)
    in_range("seed", seed, 0, 2**64 - 1)
    starts = np.broadcast_to(np.asarray(frames_from, dtype=float), (len(planned),))
    true, believed = [], []
    for run, key, start in zip(planned, names, starts, strict=True):
        truth = moved(run, motion, seed=seed, key=key)
        estimate = navigated(truth, navigation, seed=seed, key=key)
        real_rig = _real_rig(rig, navigation, _random(seed, key, _MOUNTS))
        survey = plan_survey(real_rig, [truth], frames_from=float(start), seabed_z=seabed_z)
        head = math.radians(navigation.head_angle_deg) * _random(seed, key, _HEAD).standard_normal()
        true.append(replace(survey, rig=rig, pings=replace(survey.pings, head_angle=survey.pings.head_angle + head)))
        reckoned = plan_survey(rig, [estimate], frames_from=float(start), seabed_z=seabed_z)
        error = _half_bias(_random(seed, key, _ALTITUDE), (len(survey.frames), 1))[:, 0]
        altitude = survey.frames.altitude + navigation.altitude * error
        believed.append(replace(reckoned, frames=replace(reckoned.frames, altitude=altitude)))
    return join_surveys(true), join_surveys(believed)


def _real_rig(rig: Rig, navigation: Navigation, random: np.random.Generator) -> Rig:
    def real(mount: Mount) -> Mount:
        arm = np.asarray(mount.position) + navigation.lever_arm * random.standard_normal(3)
        tilt, roll, pan = navigation.boresight_deg * random.standard_normal(3)
        return replace(
            mount,
            position=(float(arm[0]), float(arm[1]), float(arm[2])),
            tilt_deg=mount.tilt_deg + tilt,
            roll_deg=mount.roll_deg + roll,
            pan_deg=mount.pan_deg + pan,
        )

    return replace(rig, fls_mount=real(rig.fls_mount), ps_mount=real(rig.ps_mount))
