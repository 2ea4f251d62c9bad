"""Runs of both sonars over deployments, streamed: no image outlives the round that formed it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import warp as wp

import sonarwarp as sw
from sonarwarp.app.progress import Watch
from sonarwarp.field_box import plan_grid
from sonarwarp.schedule import EMPTY
from sonarwarp.simulator import MEMORY
from sonarwarp.survey import join_surveys
from sonarwarp_kernels.critical import NO_DETECTION
from sonarwarp_scenes import Deployment, Scene

FIELD_MEMORY = 1 << 30
"""Bytes of fields that a batch may take; 30 to 120 MB a run in the paper's experiments."""

# Log-odds, free depth and the count of points.
_BYTES_PER_CELL = 12


@dataclass(frozen=True, kw_only=True, eq=False)
class Experiment:
    """What lies where, what looks at it, and through which noise."""

    name: str
    """Experiment in result rows, such as ``field``."""

    object: str
    """Object in result rows, such as ``brick``."""

    arrangement: str | None = None
    """Deployment in result rows; None where the object has one only."""

    deployment: Deployment
    """Scene and run."""

    rig: sw.Rig
    """Sonars and mounts."""

    noise: Literal["none", "field"]
    """Noise in result rows: ``none`` over a flat seabed, or what the ``field`` adds: ``Noise``, ``Motion`` and
    ``Navigation`` with their defaults, over a rough seabed."""

    seed: int
    """Of noise, motion, navigation errors and particles."""

    settings: sw.ReconstructionSettings = field(default_factory=sw.ReconstructionSettings)
    """What the reconstruction is told."""

    body: Scene | None = None
    """The mesh alone, where it lies, in deployments without known objects."""

    @property
    def title(self) -> str:
        """Name for people."""
        parts = (self.object, self.arrangement, "no noise" if self.noise == "none" else "with noise")
        return f"{self.name}: {', '.join(part for part in parts if part)}"

    @property
    def slug(self) -> str:
        """Name for files."""
        return "_".join(part for part in (self.name, self.object, self.arrangement, self.noise) if part)


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """What is left of an experiment when its images are gone."""

    experiment: Experiment

    device: str
    """Warp device that it ran on."""

    survey: sw.Survey
    """Frames and pings where navigation believes them, from which the clouds were made."""

    truth: sw.Survey
    """The same frames and pings where they were."""

    clouds: sw.Clouds
    """Both methods' points."""

    critical_range: np.ndarray
    """Slant range of the contacts [m], below 0 where a beam has none, shape [frame, beam]."""

    seconds: float
    """From the first round to the clouds, planning apart; of a batch, its share by frames [s]."""

    @property
    def frames_per_second(self) -> float:
        """FLS frames simulated and reconstructed, with the pings between them [1/s]."""
        return len(self.survey.frames) / self.seconds


class Engines:
    """Simulator and reconstructor of a batch of experiments, stepped together; each is a trajectory named by its seed.

    Args:
        experiments: of one rig, one kind of noise and the same settings.
        device: Warp device.

    Raises:
        ValueError: experiments that cannot share engines.
    """

    def __init__(self, experiments: Sequence[Experiment], device: str) -> None:
        first = experiments[0]
        for other in experiments:
            if (other.rig, other.noise, other.settings) != (first.rig, first.noise, first.settings):
                raise ValueError(f"experiments: {other.title} has another rig or noise or settings than {first.title}")
        self.experiments = experiments
        self.simulator = sw.Simulator(first.rig, noise=_noise(first), device=device)
        self.reconstructor = sw.Reconstructor(first.rig, settings=first.settings, device=device)

    def plan_schedule(self, survey: sw.Survey) -> sw.Schedule:
        """Rounds of a size that the simulator is content with."""
        frames = sw.frames_per_round(survey.rig, MEMORY)
        return self.reconstructor.plan_schedule(survey, frames=frames)

    def plan(self, truth: sw.Survey, survey: sw.Survey, schedule: sw.Schedule) -> None:
        """Allocate everything and go to the first round.

        Args:
            truth: frames and pings where they are, a trajectory for each experiment.
            survey: the same where navigation believes them.
            schedule: of either, which share their times.
        """
        scenes = [experiment.deployment.scene for experiment in self.experiments]
        # Seeds as keys: a run has the same noise and particles alone and in any batch.
        seeds = [experiment.seed for experiment in self.experiments]
        self.simulator.plan(truth, scenes, schedule, trajectory_keys=seeds)
        self.reconstructor.plan(survey, schedule, trajectory_keys=seeds)

    def step(self) -> None:
        """Form the next round and work it in."""
        self.simulator.step()
        self.reconstructor.step(self.simulator.images, self.simulator.echoes)


def plan_surveys(experiment: Experiment) -> tuple[sw.Survey, sw.Survey]:
    """Frames and pings of an experiment, where they are and where navigation believes them."""
    return sw.plan_disturbed(experiment.rig, [experiment.deployment.trajectory], **_disturbances(experiment))


def _disturbances(experiment: Experiment) -> dict[str, Any]:
    """From when an experiment records, and what its run and its navigation suffer."""
    at_sea = experiment.noise == "field"
    return {
        "motion": sw.Motion() if at_sea else sw.NO_MOTION,
        "navigation": sw.Navigation() if at_sea else sw.EXACT_NAVIGATION,
        "seed": experiment.seed,
        "frames_from": experiment.deployment.frames_from,
    }


def _noise(experiment: Experiment) -> sw.Noise:
    return sw.NO_NOISE if experiment.noise == "none" else sw.Noise()


def runs_per_batch(experiment: Experiment, *, memory: int = FIELD_MEMORY) -> int:
    """How many runs like this one may share a batch, at least one: their fields live to its end.

    Args:
        experiment: one of them.
        memory: bytes that all fields may take.
    """
    _, survey = plan_surveys(experiment)
    grid = plan_grid(survey, experiment.settings.likelihood_field, wp.get_device("cpu"))
    return max(memory // (_BYTES_PER_CELL * grid.nx * grid.ny * grid.nz), 1)


def run_experiment(experiment: Experiment, *, device: str, watch: Watch) -> Run:
    """Simulate and reconstruct one experiment; as :func:`run_batch`."""
    return run_batch([experiment], device=device, watch=watch)[0]


def run_batch(experiments: Sequence[Experiment], *, device: str, watch: Watch) -> list[Run]:
    """Simulate and reconstruct experiments together, each to the bit as it would be alone.

    Args:
        experiments: of one rig, one kind of noise and the same settings, such as the seeds of one deployment.
        device: Warp device.
        watch: told of every round.

    Returns:
        One run per experiment, in their order.
    """
    surveys = [plan_surveys(experiment) for experiment in experiments]
    truth, survey = (join_surveys(parts) for parts in zip(*surveys, strict=True))
    advance = watch(experiments[0].title, len(survey.frames), "frames")
    engines = Engines(experiments, device)
    schedule = engines.plan_schedule(survey)
    engines.plan(truth, survey, schedule)
    start = time.perf_counter()
    for frames in schedule.round_frame:
        engines.step()
        wp.synchronize_device(device)
        advance(int((frames != EMPTY).sum()))
    clouds = engines.reconstructor.read()
    critical_range = engines.reconstructor.contacts.critical_range.numpy()
    seconds = (time.perf_counter() - start) / len(survey.frames)
    return [
        Run(
            experiment=experiment,
            device=device,
            survey=own,
            truth=own_truth,
            clouds=sw.Clouds(fused=_alone(clouds.fused, index), single=_alone(clouds.single, index)),
            critical_range=critical_range[survey.frames.trajectory == index],
            seconds=seconds * len(own.frames),
        )
        for index, (experiment, (own_truth, own)) in enumerate(zip(experiments, surveys, strict=True))
    ]


def record(experiment: Experiment, *, device: str) -> sw.SonarLog:
    """Simulate an experiment with all its images kept, for reconstructions with several settings.

    Noise is drawn otherwise than in :func:`run_batch`; motion and navigation errors are the same.
    """
    deployment = experiment.deployment
    return sw.simulate(
        *(experiment.rig, deployment.scene, deployment.trajectory),
        noise=_noise(experiment),
        device=device,
        **_disturbances(experiment),
    )


def run_recorded(experiment: Experiment, log: sw.SonarLog, *, device: str) -> Run:
    """Reconstruct what :func:`record` left, with the experiment's settings; its seconds are the reconstruction's."""
    start = time.perf_counter()
    clouds = sw.reconstruct(log, settings=experiment.settings, seed=experiment.seed, device=device)
    seconds = time.perf_counter() - start
    frames, found = log.survey.frames, clouds.single.attributes
    critical_range = np.full((len(frames), experiment.rig.fls.beams), NO_DETECTION, dtype=np.float32)
    critical_range[np.searchsorted(frames.number, found["frame"]), found["beam"]] = found["range"]
    return Run(
        experiment=experiment,
        device=device,
        survey=log.survey,
        truth=log.survey if log.truth is None else log.truth,
        clouds=clouds,
        critical_range=critical_range,
        seconds=seconds,
    )


def _alone(cloud: sw.PointCloud, trajectory: int) -> sw.PointCloud:
    """A trajectory's points, as if it were the only one."""
    points = cloud.select(cloud.attributes["trajectory"] == trajectory)
    points.attributes["trajectory"][:] = 0
    return points
