"""Simulates straight to disk: no image outlives the round that formed it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from pathlib import Path

import numpy as np

from sonarwarp.navigation import EXACT_NAVIGATION, NO_MOTION, Motion, Navigation, plan_disturbed
from sonarwarp.scene_table import scene_of_trajectory
from sonarwarp.schedule import EMPTY, Schedule, frames_per_round, plan_schedule
from sonarwarp.settings import NO_NOISE, Noise, ReconstructionSettings
from sonarwarp.simulator import MEMORY, Simulator
from sonarwarp.sonar import Rig
from sonarwarp.store_write import StoreWriter
from sonarwarp.survey import Frames, Pings, Survey
from sonarwarp.truth import ContactCaster
from sonarwarp_scenes import Scene, Trajectory

# Rays for first contacts, across and along a beam: 256 over 14 deg are 4 mm apart at 4 m.
_AZIMUTHS, _ELEVATIONS = 3, 256


def simulate_to_store(
    rig: Rig,
    scene: Scene | Sequence[Scene],
    trajectory: Trajectory | Sequence[Trajectory],
    path: str | Path,
    *,
    frames_from: float | Sequence[float] = -math.inf,
    noise: Noise = NO_NOISE,
    motion: Motion = NO_MOTION,
    navigation: Navigation = EXACT_NAVIGATION,
    seed: int = 0,
    truth: bool = False,
    reconstruction: ReconstructionSettings | None = None,
    overwrite: bool = False,
    device: str | None = None,
    threads: int | None = None,
    memory: int = MEMORY,
    advance: Callable[[int], None] | None = None,
) -> None:
    """Simulate a rig along one or more trajectories, as ``simulate`` does, into a log on disk.

    Args:
        rig: sonars and mounts.
        scene: one for all trajectories, or one each.
        trajectory: what is asked of the vehicle, one or more.
        path: of the log.
        frames_from: time from which the FLS records [s].
        noise: added to the echoes.
        motion: waves on each run.
        navigation: errors of instruments and mounts.
        seed: of noise, motion and errors.
        truth: whether to cast for the first contact of every beam too, with 3 x 256 rays each.
        reconstruction: settings that go with the log.
        overwrite: whether an older log may be replaced.
        device: Warp device.
        threads: CPU threads; all cores by default.
        memory: bytes that one round of frames may take on the device.
        advance: told after each round how many frames it brought.

    Raises:
        StoreError: as ``StoreWriter``; what is complete by then stays.
    """
    trajectories = [trajectory] if isinstance(trajectory, Trajectory) else list(trajectory)
    survey, believed = plan_disturbed(
        rig, trajectories, motion=motion, navigation=navigation, seed=seed, frames_from=frames_from
    )
    survey_to_store(
        survey,
        [scene] if isinstance(scene, Scene) else list(scene),
        path,
        believed=believed,
        noise=noise,
        seed=seed,
        truth=truth,
        reconstruction=reconstruction,
        overwrite=overwrite,
        device=device,
        threads=threads,
        memory=memory,
        advance=advance,
    )


def survey_to_store(
    survey: Survey,
    scenes: Sequence[Scene],
    path: str | Path,
    *,
    believed: Survey | None = None,
    scene_of: Sequence[int] | None = None,
    noise: Noise = NO_NOISE,
    seed: int = 0,
    truth: bool = False,
    reconstruction: ReconstructionSettings | None = None,
    overwrite: bool = False,
    device: str | None = None,
    threads: int | None = None,
    memory: int = MEMORY,
    advance: Callable[[int], None] | None = None,
) -> None:
    """Simulate a survey into a log on disk.

    Frames and pings of several trajectories are written in order of time, as they are worked on; a log's survey says
    which is whose.

    Args:
        survey: frames and pings with their true poses.
        scenes: what the sonars look at.
        path: of the log.
        believed: the same frames and pings with the poses that navigation gives, which the log then has as its own; the
            true ones by default. ``navigation.plan_disturbed`` gives both.
        scene_of: scene of each trajectory; scene i for trajectory i by default, or the only one.
        noise, seed, truth, reconstruction, overwrite, device, threads, memory, advance: as in
            :func:`simulate_to_store`.

    Raises:
        StoreError: as ``StoreWriter``; what is complete by then stays.
    """
    most, window = frames_per_round(survey.rig, memory), max(len(survey.pings), 1)
    order = plan_schedule(survey, frames=most, window=window)
    survey, believed = _in_order(survey, order), _in_order(believed or survey, order)
    schedule = plan_schedule(survey, frames=most, window=window)
    simulator = Simulator(survey.rig, noise=noise, device=device, threads=threads)
    simulator.plan(survey, scenes, schedule, scene_of=scene_of, seed=seed)
    caster = ContactCaster(
        survey.rig.fls,
        simulator.scenes,
        azimuths=_AZIMUTHS,
        elevations=_ELEVATIONS,
        device=simulator.device,
        threads=threads,
    )
    scene = scene_of_trajectory(scene_of, survey.trajectories, len(scenes))[survey.frames.trajectory]
    with StoreWriter(
        path,
        believed,
        truth=survey,
        contacts=truth,
        noise=noise,
        reconstruction=reconstruction,
        overwrite=overwrite,
    ) as writer:
        for frame_slots, ping_slots in zip(schedule.round_frame, schedule.round_ping, strict=True):
            simulator.step()
            images, echoes = simulator.read()
            frame = frame_slots[frame_slots != EMPTY]
            contacts = caster.cast(survey.frames.pose[frame], scene[frame]) if truth else None
            writer.append(images[: len(frame)], echoes[: np.count_nonzero(ping_slots != EMPTY)], contacts)
            if advance is not None:
                advance(len(frame))


def _in_order(survey: Survey, schedule: Schedule) -> Survey:
    """The same survey, its frames and pings in the order in which the rounds of a schedule take them."""

    def ordered(rows: Frames | Pings, slot: np.ndarray) -> Frames | Pings:
        order = slot[slot != EMPTY]
        return replace(rows, **{column.name: getattr(rows, column.name)[order] for column in fields(rows)})

    return replace(
        survey,
        frames=ordered(survey.frames, schedule.round_frame),
        pings=ordered(survey.pings, schedule.round_ping),
    )
