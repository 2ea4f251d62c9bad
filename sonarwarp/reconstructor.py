"""Fuses both sonars over a batch: plan allocates, step works one round in, read gives the clouds."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import warp as wp

from sonarwarp import specs
from sonarwarp.carving import Carver
from sonarwarp.cloud import PointCloud
from sonarwarp.clouds import Clouds, contact_cloud, single_cloud
from sonarwarp.field_box import plan_grid
from sonarwarp.log import Log
from sonarwarp.schedule import EMPTY, Schedule, check_schedule, frames_per_round, plan_schedule
from sonarwarp.seabed_echo import seabed_echo
from sonarwarp.settings import ReconstructionSettings
from sonarwarp.simulator import MEMORY, owner_keys
from sonarwarp.sonar import Rig
from sonarwarp.survey import Survey
from sonarwarp_kernels import critical, estimate, field, geometry, keys, particles, profile, roi, slots
from sonarwarp_kernels.launch import check_array, cpu_threads


class Reconstructor:
    """Turns images and echo profiles into point clouds.

    Args:
        rig: sonars and mounts.
        settings: detection, field, mixture and particles.
        device: Warp device.
        threads: CPU threads; all cores by default.
    """

    def __init__(
        self,
        rig: Rig,
        *,
        settings: ReconstructionSettings | None = None,
        device: str | None = None,
        threads: int | None = None,
    ) -> None:
        self.rig = rig
        self.settings = settings or ReconstructionSettings()
        self.device = wp.get_device(device)
        self.threads = threads or cpu_threads()

    @property
    def window(self) -> int:
        """Pings of a trajectory that its field remembers in the paper's method, online."""
        return max(round(self.settings.likelihood_field.window_sweeps * self.rig.ps.pings_per_sweep), 1)

    def plan_schedule(self, survey: Survey, *, frames: int) -> Schedule:
        """Order a survey as this reconstruction wants it: in order of time or not, with the paper's window or none.

        Args:
            survey: what was recorded.
            frames: most frames in a round. Online, a frame may wait for as many more before a read can show it.
        """
        window = self.window if self.settings.method == "paper" else max(len(survey.pings), 1)
        return plan_schedule(survey, frames=frames, window=window, causal=self.settings.causal)

    def plan(
        self,
        survey: Survey,
        schedule: Schedule,
        *,
        seed: int = 0,
        trajectory_keys: Sequence[int] | None = None,
    ) -> None:
        """Upload poses, allocate fields and results, and go to the first round.

        Args:
            survey: frames and pings, with the poses that navigation gives.
            schedule: which frames and pings each round brings, made by :meth:`plan_schedule`.
            seed: of the particles.
            trajectory_keys: what names each trajectory wherever it stands in a batch; its index by default.

        Raises:
            ValueError: a survey without frames, a field too large, a trajectory without a key, a seed or key outside 64
                bits, or another survey's schedule.
        """
        check_schedule(schedule, survey)
        device, settings = self.device, self.settings
        pings = survey.pings
        self.survey = survey
        self.schedule = schedule
        self._fan = self.rig.fls.fan(device)
        self._ps_edge = wp.array(self.rig.ps.range_edge, dtype=float, device=device)
        self._filter = specs.critical_filter(settings, self._seabed_level())
        self._detector = specs.profile_detector(settings)
        self._model = specs.profile_model(settings, self.rig.ps)
        self._mixture = specs.mixture(settings)
        self._reading = specs.reading(settings)
        self.grid = plan_grid(survey, settings.likelihood_field, device)
        self._round = wp.zeros(1, dtype=int, device=device)
        self._epoch = wp.zeros(1, dtype=int, device=device)
        self._plan_slots(schedule)
        self._plan_frames(survey, seed, trajectory_keys)
        self._ping_trajectory = wp.array(pings.trajectory, dtype=int, device=device)
        self._world_from_head = wp.array(pings.pose, dtype=wp.transform, device=device)
        angle = wp.array(pings.head_angle, dtype=float, device=device)
        geometry.turn_heads(self._world_from_head, angle, self._world_from_head, device=device, threads=self.threads)
        count = settings.detection.footprints
        self._footprint = wp.full((len(pings), count), profile.NO_FOOTPRINT, dtype=wp.vec3, device=device)
        shape = (survey.trajectories, self.grid.nx, self.grid.ny, self.grid.nz)
        self.log_odds = wp.zeros(shape, dtype=int, device=device)
        self._carver = None
        if settings.method == "carved":
            self._carver = Carver(
                survey,
                settings,
                self.grid,
                self.contacts,
                self._world_from_head,
                self._footprint,
                schedule.round_frame.shape[1],
                self.threads,
            )

    def _seabed_level(self) -> float:
        """The weakest echo that a flat seabed can leave where the beams meet it: at the window's end."""
        half = self.rig.fls.half_elevation
        edge = math.radians(self.rig.fls_mount.tilt_deg) + half
        return seabed_echo(self._fan, float(self.rig.fls.range_edge[-1]) * math.sin(max(edge, 0.05)), edge, half)

    def _plan_slots(self, schedule: Schedule) -> None:
        device = self.device

        self._tables, self._slots = {}, {}
        for name in ("round_frame", "round_ping", "epoch_frame", "epoch_ping", "epoch_leaving"):
            index = getattr(schedule, name)
            leading = schedule.rounds * (schedule.epochs if name.startswith("epoch") else 1)
            slot_count = index.size // max(leading, 1)
            self._tables[name] = wp.array(index.reshape(leading, slot_count), dtype=int, device=device)
            self._slots[name] = wp.zeros(slot_count, dtype=int, device=device)
        rows = schedule.epoch_ping.shape[2:]
        self._entering = self._slots["epoch_ping"].reshape(rows)
        self._leaving = self._slots["epoch_leaving"].reshape(rows)
        beams = self.rig.fls.beams
        frame_slots, ping_slots = schedule.round_frame.shape[1], schedule.round_ping.shape[1]
        self._slot_seabed = wp.zeros((frame_slots, beams), dtype=float, device=device)
        self._slot_range = wp.zeros((frame_slots, beams), dtype=float, device=device)
        self._slot_strength = wp.zeros((frame_slots, beams), dtype=float, device=device)
        self._slot_bin = wp.zeros((frame_slots, beams), dtype=int, device=device)
        footprints = self.settings.detection.footprints
        self._slot_footprint = wp.zeros((ping_slots, footprints), dtype=wp.vec3, device=device)

    def _plan_frames(self, survey: Survey, seed: int, trajectory_keys: Sequence[int] | None) -> None:
        device, frames, shape = self.device, survey.frames, (len(survey.frames), self.rig.fls.beams)
        seeds, owners = owner_keys(survey.trajectories, seed, trajectory_keys, device)
        contacts = particles.Contacts()
        contacts.trajectory = wp.array(frames.trajectory, dtype=int, device=device)
        contacts.key = wp.zeros(len(frames), dtype=wp.uint64, device=device)
        number = wp.array(frames.number, dtype=int, device=device)
        keys.frame_keys(seeds, owners, contacts.trajectory, number, keys.FLS_FRAMES, contacts.key, device=device)
        contacts.world_from_sensor = wp.array(frames.pose, dtype=wp.transform, device=device)
        contacts.critical_range = wp.full(shape, critical.NO_DETECTION, dtype=float, device=device)
        # Frames not yet worked in prove nothing empty: theirs stays at 0.
        contacts.seabed_range = wp.zeros(shape, dtype=float, device=device)
        self._seabed_range = wp.zeros(shape, dtype=float, device=device)
        altitude = wp.array(frames.altitude, dtype=float, device=device)
        roi.seabed_range(
            self._fan,
            contacts.world_from_sensor,
            altitude,
            self._seabed_range,
            device=device,
            threads=self.threads,
        )
        self.contacts = contacts
        self._every_frame = wp.array(np.arange(len(frames)), dtype=int, device=device)
        self._estimates = estimate.Estimates()
        for name, dtype in estimate.ESTIMATE_TYPES.items():
            setattr(self._estimates, name, wp.zeros(shape, dtype=dtype, device=device))

    def step(self, images: wp.array, echoes: wp.array) -> None:
        """Work the next round in; only launches, so a graph can capture it.

        Args:
            images: FLS images of the schedule's round, shape [slot, beam, bin].
            echoes: PS echo profiles of the schedule's round, shape [slot, bin].

        Raises:
            ValueError: an array of the wrong shape, type or device.
        """
        frames, pings = self.schedule.round_frame.shape[1], self.schedule.round_ping.shape[1]
        check_array("images", images, (frames, self.rig.fls.beams, self.rig.fls.bins), wp.float32, self.device)
        check_array("echoes", echoes, (pings, self.rig.ps.bins), wp.float32, self.device)
        self._detect(images, echoes)
        for _ in range(self.schedule.epochs):
            self._fuse()
        slots.next_round(self._round, device=self.device)

    def _detect(self, images: wp.array, echoes: wp.array) -> None:
        on = {"device": self.device, "threads": self.threads}
        frame, ping = self._slots["round_frame"], self._slots["round_ping"]
        slots.load_slots(self._tables["round_frame"], self._round, frame, device=self.device)
        slots.load_slots(self._tables["round_ping"], self._round, ping, device=self.device)
        slots.gather_rows(frame, self._seabed_range, self._slot_seabed, device=self.device)
        slots.scatter_rows(frame, self._slot_seabed, self.contacts.seabed_range, device=self.device)
        nearest = self.settings.detection.edge == "nearest"
        find = critical.find_nearest_critical_points if nearest else critical.find_critical_points
        find(
            self._filter,
            self._fan.range_edge,
            images,
            self._slot_seabed,
            self._slot_range,
            self._slot_strength,
            self._slot_bin,
            **on,
        )
        slots.scatter_rows(frame, self._slot_range, self.contacts.critical_range, device=self.device)
        if self._carver is not None:
            self._carver.look(frame, images, self._slot_bin)
        profile.detect_profile(self._ps_edge, self._detector, echoes, self._slot_footprint, **on)
        slots.scatter_rows(ping, self._slot_footprint, self._footprint, device=self.device)

    def _fuse(self) -> None:
        on = {"device": self.device, "threads": self.threads}
        for name in ("epoch_frame", "epoch_ping", "epoch_leaving"):
            slots.load_slots(self._tables[name], self._epoch, self._slots[name], device=self.device)
        for pings, sign in ((self._entering, 1), (self._leaving, -1)):
            field.update_field(
                self.grid,
                self._model,
                pings,
                self._ping_trajectory,
                self._world_from_head,
                self._footprint,
                sign,
                self.log_odds,
                **on,
            )
        if self.settings.causal and self._carver is None:
            self._estimate(self._slots["epoch_frame"])
        slots.next_round(self._epoch, device=self.device)

    def _estimate(self, slot_frame: wp.array) -> None:
        estimate.estimate_points(
            self._fan,
            self.grid,
            self._mixture,
            self._reading,
            self.contacts,
            slot_frame,
            self.log_odds,
            self.settings.particles,
            self._estimates,
            device=self.device,
            threads=self.threads,
        )

    def conclude(self) -> None:
        """Weigh everything worked in so far together; only launches. Online, ``paper`` has done so on the way."""
        if self._carver is not None:
            self._carver.conclude(self.log_odds, self._reading, self._estimates)
        elif not self.settings.causal:
            self._estimate(self._every_frame)

    @property
    def footprints(self) -> wp.array:
        """Footprints of the pings worked in so far (``profile.detect_profile``), shape [ping, footprint]."""
        return self._footprint

    def reset(self) -> None:
        """Forget everything seen and go back to the first round."""
        self._round.zero_()
        self._epoch.zero_()
        self.log_odds.zero_()
        self._footprint.fill_(profile.NO_FOOTPRINT)
        self.contacts.critical_range.fill_(critical.NO_DETECTION)
        self.contacts.seabed_range.zero_()
        self._estimates.quality.zero_()

    def read(self) -> Clouds:
        """Clouds of everything worked in so far; after any step, and as often as wanted."""
        self.conclude()
        contacts = self.contacts
        edge = wp.zeros(contacts.critical_range.shape, dtype=wp.vec3, device=self.device)
        estimate.place_at_lower_edge(
            self._fan,
            contacts.world_from_sensor,
            contacts.critical_range,
            edge,
            device=self.device,
            threads=self.threads,
        )
        critical_range = contacts.critical_range.numpy()
        estimates = {name: getattr(self._estimates, name).numpy() for name in estimate.ESTIMATE_TYPES}
        if self._carver is None:
            quality = estimates["quality"]
            fused = contact_cloud(self.survey, critical_range, quality, np.ones_like(quality), estimates)
        else:
            quality, hits = self._carver.quality.numpy(), self._carver.hits.numpy()
            contact = contact_cloud(self.survey, critical_range, quality, hits, estimates)
            fused = PointCloud.join(contact, self._carver.faces())
        return Clouds(fused=fused, single=single_cloud(self.survey, critical_range, edge.numpy()))


def reconstruct(
    log: Log,
    *,
    settings: ReconstructionSettings | None = None,
    seed: int = 0,
    device: str | None = None,
    threads: int | None = None,
    memory: int = MEMORY,
    advance: Callable[[int], None] | None = None,
) -> Clouds:
    """Reconstruct a log, simulated or recorded.

    Args:
        log: images, echoes and survey, in memory or on disk.
        settings: detection, field, mixture and particles.
        seed: of the particles.
        device: Warp device.
        threads: CPU threads; all cores by default.
        memory: bytes that one round of frames may take on the device.
        advance: told after each round how many frames it brought.
    """
    survey = log.survey
    reconstructor = Reconstructor(survey.rig, settings=settings, device=device, threads=threads)
    schedule = reconstructor.plan_schedule(survey, frames=frames_per_round(survey.rig, memory))
    reconstructor.plan(survey, schedule, seed=seed)
    for frame, ping in zip(schedule.round_frame, schedule.round_ping, strict=True):
        images = wp.array(log.images_of(frame), dtype=float, device=reconstructor.device)
        echoes = wp.array(log.echoes_of(ping), dtype=float, device=reconstructor.device)
        reconstructor.step(images, echoes)
        if advance is not None:
            advance(int((frame != EMPTY).sum()))
    return reconstructor.read()
