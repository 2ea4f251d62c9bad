"""Simulates both sonars over a batch: plan allocates, step launches one round, read copies it to the host."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from sonarwarp.log import SonarLog
from sonarwarp.navigation import EXACT_NAVIGATION, NO_MOTION, Motion, Navigation, plan_disturbed
from sonarwarp.scene_table import DeviceScenes, scene_of_trajectory
from sonarwarp.schedule import Schedule, check_schedule, frames_per_round, plan_schedule
from sonarwarp.seabed_echo import seabed_echo
from sonarwarp.settings import NO_NOISE, Noise
from sonarwarp.sonar import Rig
from sonarwarp.speckle import speckle_knots
from sonarwarp.survey import Frames, Pings, Survey, group_rows
from sonarwarp_kernels import echo, forming, geometry, keys, noise, slots
from sonarwarp_kernels.launch import cpu_threads
from sonarwarp_kernels.specs import Fan
from sonarwarp_scenes import Scene, Trajectory

MEMORY = 64 << 20
"""Bytes of images and scratch that a round may take, unless told otherwise."""


@dataclass
class _Buffers:
    """One sonar's arrays: all frames' inputs, and a round's slots."""

    fan: Fan
    pose: wp.array
    key: wp.array
    scene: wp.array
    table: wp.array
    slot: wp.array
    slot_pose: wp.array
    slot_key: wp.array
    slot_scene: wp.array
    scratch: forming.Scratch
    counts: wp.array
    speckle: wp.array
    knot_keys: wp.array
    slot_knot_keys: wp.array
    blend: wp.array
    slot_blend: wp.array
    background: wp.array
    slot_background: wp.array
    image: wp.array


class Simulator:
    """Forms FLS images and PS echo profiles over scenes.

    Args:
        rig: sonars and mounts.
        noise: what is added to the echoes.
        device: Warp device.
        threads: CPU threads; all cores by default.
    """

    def __init__(
        self, rig: Rig, *, noise: Noise = NO_NOISE, device: str | None = None, threads: int | None = None
    ) -> None:
        self.rig = rig
        self.noise = noise
        self.device = wp.get_device(device)
        self.threads = threads or cpu_threads()

    def plan(
        self,
        survey: Survey,
        scenes: Sequence[Scene],
        schedule: Schedule,
        *,
        scene_of: Sequence[int] | None = None,
        seed: int = 0,
        trajectory_keys: Sequence[int] | None = None,
    ) -> None:
        """Upload scenes and poses, allocate one round's arrays, and go to the first round.

        Args:
            survey: frames and pings.
            scenes: what the sonars look at.
            schedule: which frames and pings each round forms.
            scene_of: scene of each trajectory; scene i for trajectory i by default, or the only one.
            seed: of all noise.
            trajectory_keys: what names each trajectory wherever it stands in a batch; its index by default.

        Raises:
            ValueError: a trajectory without a scene or a key, a seed or key outside 64 bits, or another survey's
                schedule.
        """
        check_schedule(schedule, survey)
        trajectories = survey.trajectories
        owner_scene = scene_of_trajectory(scene_of, trajectories, len(scenes))
        self.survey = survey
        self.schedule = schedule
        self._scenes = DeviceScenes(scenes, self.device)
        self._owner_keys = owner_keys(trajectories, seed, trajectory_keys, self.device)
        frames, pings = survey.frames, survey.pings
        fls, ps = self.rig.fls, self.rig.ps
        altitude, length = _altitudes(survey), self.noise.speckle_length
        edge = math.radians(self.rig.fls_mount.tilt_deg) + fls.half_elevation
        self._fls = self._allocate(
            fls.fan(self.device),
            frames,
            speckle_knots(frames.pose, frames.trajectory, length, float(np.median(np.diff(fls.azimuth_edge)))),
            keys.FLS_FRAMES,
            owner_scene,
            schedule.round_frame,
            self._background(fls.fan(self.device), altitude, edge, fls.half_elevation),
        )
        axis = math.radians(self.rig.ps_mount.tilt_deg)
        self._ps = self._allocate(
            ps.fan(self.device),
            pings,
            speckle_knots(pings.head_pose, pings.trajectory, length, math.radians(ps.beamwidth_deg)),
            keys.PS_PINGS,
            owner_scene,
            schedule.round_ping,
            self._background(ps.fan(self.device), altitude, axis, math.radians(ps.beamwidth_deg) / 2),
        )
        angle = wp.array(pings.head_angle, dtype=float, device=self.device)
        geometry.turn_heads(self._ps.pose, angle, self._ps.pose, device=self.device, threads=self.threads)
        self._round = wp.zeros(1, dtype=int, device=self.device)

    def _background(self, fan: Fan, altitude: np.ndarray, depression: float, half_width: float) -> np.ndarray:
        """Mean of each trajectory's background, shape [trajectory]: its own, or a batch would change it."""
        if self.noise.background_db is None:
            return np.zeros(len(altitude))
        ratio = 10.0 ** (self.noise.background_db / 20.0)
        return np.array([ratio * seabed_echo(fan, level, depression, half_width) for level in altitude])

    def _allocate(
        self,
        fan: Fan,
        instants: Frames | Pings,
        knots: tuple[np.ndarray, np.ndarray],
        sonar: int,
        owner_scene: np.ndarray,
        table: np.ndarray,
        background: np.ndarray,
    ) -> _Buffers:
        device, slot_count = self.device, table.shape[1]
        trajectory = instants.trajectory
        knot, blend = knots
        between = np.stack([knot, knot + 1], axis=-1)
        knot_keys = self._keys(np.repeat(trajectory, 2), between.ravel(), sonar).reshape(between.shape)
        scratch = forming.Scratch()
        for name, (shape, dtype) in forming.scratch_shapes(fan, slot_count).items():
            setattr(scratch, name, wp.zeros(shape, dtype=dtype, device=device))
        beams, bins = fan.azimuth.shape[0], fan.range_edge.shape[0] - 1
        return _Buffers(
            fan=fan,
            pose=wp.array(instants.pose, dtype=wp.transform, device=device),
            key=self._keys(trajectory, instants.number, sonar),
            scene=wp.array(owner_scene[trajectory], dtype=int, device=device),
            table=wp.array(table, dtype=int, device=device),
            slot=wp.zeros(slot_count, dtype=int, device=device),
            slot_pose=wp.zeros(slot_count, dtype=wp.transform, device=device),
            slot_key=wp.zeros(slot_count, dtype=wp.uint64, device=device),
            slot_scene=wp.zeros(slot_count, dtype=int, device=device),
            scratch=scratch,
            counts=wp.zeros((slot_count, beams, bins), dtype=int, device=device),
            speckle=wp.full(slot_count, int(self.noise.speckle), dtype=int, device=device),
            knot_keys=knot_keys,
            slot_knot_keys=wp.zeros((slot_count, 2), dtype=wp.uint64, device=device),
            blend=wp.array(blend, dtype=float, device=device),
            slot_blend=wp.zeros(slot_count, dtype=float, device=device),
            background=wp.array(background[trajectory], dtype=float, device=device),
            slot_background=wp.zeros(slot_count, dtype=float, device=device),
            image=wp.zeros((slot_count, beams, bins), dtype=float, device=device),
        )

    def _keys(self, trajectory: np.ndarray, number: np.ndarray, sonar: int) -> wp.array:
        key = wp.zeros(len(number), dtype=wp.uint64, device=self.device)
        owner, which = (wp.array(values, dtype=int, device=self.device) for values in (trajectory, number))
        keys.frame_keys(*self._owner_keys, owner, which, sonar, key, device=self.device)
        return key

    def step(self) -> None:
        """Form the next round's images and echoes; only launches, so a graph can capture it."""
        for sonar in (self._fls, self._ps):
            self._form(sonar)
        slots.next_round(self._round, device=self.device)

    def _form(self, sonar: _Buffers) -> None:
        if sonar.slot.shape[0] == 0:
            return
        on = {"device": self.device, "threads": self.threads}
        slots.load_slots(sonar.table, self._round, sonar.slot, device=self.device)
        slots.load_poses(
            sonar.slot,
            sonar.pose,
            sonar.key,
            sonar.scene,
            self._scenes.empty,
            sonar.slot_pose,
            sonar.slot_key,
            sonar.slot_scene,
            device=self.device,
        )
        slots.load_noise(
            sonar.slot,
            sonar.knot_keys,
            sonar.blend,
            sonar.background,
            sonar.slot_knot_keys,
            sonar.slot_blend,
            sonar.slot_background,
            device=self.device,
        )
        echo.form_echoes(
            sonar.fan,
            self._scenes.table,
            sonar.slot_pose,
            sonar.slot_scene,
            sonar.slot_key,
            sonar.scratch,
            sonar.counts,
            **on,
        )
        noise.finish_images(
            sonar.counts,
            sonar.fan.fixed_point,
            sonar.slot_key,
            sonar.speckle,
            sonar.slot_knot_keys,
            sonar.slot_blend,
            sonar.slot_background,
            sonar.image,
            **on,
        )

    @property
    def scenes(self) -> DeviceScenes:
        """The scenes on the device, for whoever casts rays at them too."""
        return self._scenes

    @property
    def images(self) -> wp.array:
        """FLS images of the current round on the device, shape [slot, beam, bin]."""
        return self._fls.image

    @property
    def echoes(self) -> wp.array:
        """PS echo profiles of the current round on the device, shape [slot, bin]."""
        slot_count, _, bins = self._ps.image.shape
        return self._ps.image.reshape((slot_count, bins))

    def reset(self) -> None:
        """Go back to the first round."""
        self._round.zero_()

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Images [slot, beam, bin] and echoes [slot, bin] of the last step, on the host."""
        return self.images.numpy(), self.echoes.numpy()


def _altitudes(survey: Survey) -> np.ndarray:
    """Median altitude of each trajectory's frames [m], 1 where it has none, shape [trajectory]."""
    rows = group_rows(survey.frames.trajectory, survey.trajectories)
    return np.array([np.median(survey.frames.altitude[mine]) if len(mine) else 1.0 for mine in rows])


def owner_keys(
    trajectories: int, seed: int, trajectory_keys: Sequence[int] | None, device: wp.Device
) -> tuple[wp.array, wp.array]:
    """Seed and key of each trajectory, on the device, both of shape [trajectory].

    Raises:
        ValueError: not one key for each trajectory, or a number that 64 bits do not hold.
    """
    chosen = list(range(trajectories) if trajectory_keys is None else trajectory_keys)
    if len(chosen) != trajectories:
        raise ValueError(f"trajectory_keys: expected {trajectories}, got {len(chosen)}")
    for name, values in (("seed", [seed]), ("trajectory_keys", chosen)):
        for value in values:
            if not 0 <= value < 2**64:
                raise ValueError(f"{name}: {value}, must be at least 0 and under 2**64")
    owners = np.array(chosen, dtype=np.uint64)
    seeds = np.full(trajectories, seed, dtype=np.uint64)
    return wp.array(seeds, dtype=wp.uint64, device=device), wp.array(owners, dtype=wp.uint64, device=device)


def simulate(
    rig: Rig,
    scene: Scene | Sequence[Scene],
    trajectory: Trajectory | Sequence[Trajectory],
    *,
    frames_from: float | Sequence[float] = -math.inf,
    noise: Noise = NO_NOISE,
    motion: Motion = NO_MOTION,
    navigation: Navigation = EXACT_NAVIGATION,
    seed: int = 0,
    device: str | None = None,
    threads: int | None = None,
    memory: int = MEMORY,
) -> SonarLog:
    """Simulate a rig along one or more trajectories, all images kept in memory.

    The log's survey is what navigation believes, its truth is where the sonars were.

    Args:
        rig: sonars and mounts.
        scene: one for all trajectories, or one each.
        trajectory: what is asked of the vehicle, one or more.
        frames_from: time from which the FLS records [s].
        noise: added to the echoes.
        motion: waves on each run.
        navigation: errors of instruments and mounts.
        seed: of noise, motion and errors.
        device: Warp device.
        threads: CPU threads; all cores by default.
        memory: bytes that one round of frames may take on the device.
    """
    scenes = [scene] if isinstance(scene, Scene) else list(scene)
    trajectories = [trajectory] if isinstance(trajectory, Trajectory) else list(trajectory)
    survey, believed = plan_disturbed(
        rig, trajectories, motion=motion, navigation=navigation, seed=seed, frames_from=frames_from
    )
    schedule = plan_schedule(survey, frames=frames_per_round(rig, memory), window=len(survey.pings))
    simulator = Simulator(rig, noise=noise, device=device, threads=threads)
    simulator.plan(survey, scenes, schedule, seed=seed)
    images = np.empty((len(survey.frames), rig.fls.beams, rig.fls.bins), dtype=np.float32)
    echoes = np.empty((len(survey.pings), rig.ps.bins), dtype=np.float32)
    for frame, ping in zip(schedule.round_frame, schedule.round_ping, strict=True):
        simulator.step()
        round_images, round_echoes = simulator.read()
        images[frame[frame >= 0]] = round_images[frame >= 0]
        echoes[ping[ping >= 0]] = round_echoes[ping >= 0]
    return SonarLog(survey=believed, images=images, echoes=echoes, truth=survey)
