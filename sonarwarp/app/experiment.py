"""One run of both sonars over a deployment, streamed: no image outlives the round that formed it."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Literal

import numpy as np
import warp as wp

import sonarwarp as sw
from sonarwarp.app.progress import Watch
from sonarwarp.schedule import EMPTY
from sonarwarp.simulator import MEMORY
from sonarwarp_scenes import Deployment, Scene


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
    """Noise in result rows: ``none`` over a flat seabed, or what the ``field`` adds and a rough seabed."""

    seed: int
    """Of the noise and of the particles."""

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
    """Frames and pings."""

    clouds: sw.Clouds
    """Both methods' points."""

    critical_range: np.ndarray
    """Slant range of the contacts [m], below 0 where a beam has none, shape [frame, beam]."""

    seconds: float
    """From the first round to the clouds; planning apart [s]."""

    @property
    def frames_per_second(self) -> float:
        """FLS frames simulated and reconstructed, with the pings between them [1/s]."""
        return len(self.survey.frames) / self.seconds


class Engines:
    """Simulator and reconstructor of an experiment, stepped together.

    Args:
        experiment: rig, noise and scene.
        device: Warp device.
    """

    def __init__(self, experiment: Experiment, device: str) -> None:
        self.experiment = experiment
        noise = sw.NO_NOISE if experiment.noise == "none" else sw.Noise()
        self.simulator = sw.Simulator(experiment.rig, noise=noise, device=device)
        self.reconstructor = sw.Reconstructor(experiment.rig, device=device)

    def plan_schedule(self, survey: sw.Survey) -> sw.Schedule:
        """Rounds of a size that the simulator is content with."""
        frames = sw.frames_per_round(self.experiment.rig, MEMORY)
        return sw.plan_schedule(survey, frames=frames, window=self.reconstructor.window)

    def plan(self, survey: sw.Survey, schedule: sw.Schedule) -> None:
        """Allocate everything and go to the first round."""
        self.simulator.plan(survey, [self.experiment.deployment.scene], schedule, seed=self.experiment.seed)
        self.reconstructor.plan(survey, schedule, seed=self.experiment.seed)

    def step(self) -> None:
        """Form the next round and work it in."""
        self.simulator.step()
        self.reconstructor.step(self.simulator.images, self.simulator.echoes)


def plan_survey(experiment: Experiment) -> sw.Survey:
    """Frames and pings of an experiment."""
    deployment = experiment.deployment
    return sw.plan_survey(experiment.rig, [deployment.trajectory], frames_from=deployment.frames_from)


def run_experiment(experiment: Experiment, *, device: str, watch: Watch) -> Run:
    """Simulate and reconstruct an experiment.

    Args:
        experiment: what to run.
        device: Warp device.
        watch: told of every round.
    """
    survey = plan_survey(experiment)
    advance = watch(experiment.title, len(survey.frames), "frames")
    engines = Engines(experiment, device)
    schedule = engines.plan_schedule(survey)
    engines.plan(survey, schedule)
    start = time.perf_counter()
    for frames in schedule.round_frame:
        engines.step()
        wp.synchronize_device(device)
        advance(int((frames != EMPTY).sum()))
    clouds = engines.reconstructor.read()
    return Run(
        experiment=experiment,
        device=device,
        survey=survey,
        clouds=clouds,
        critical_range=engines.reconstructor.contacts.critical_range.numpy(),
        seconds=time.perf_counter() - start,
    )
