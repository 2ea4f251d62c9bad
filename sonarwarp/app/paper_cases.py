"""The paper's own experiments: what lies where, and which rig looks at it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import sonarwarp as sw
from sonarwarp.app.experiment import Experiment, runs_per_batch
from sonarwarp_scenes import (
    TABLE_1,
    TABLE_2,
    Deployment,
    Roughness,
    brick_deployment,
    pair_deployment,
    slope_deployment,
)

# The brick comes inside the FLS's region of interest at 3.1 m [m].
_BRICK_IMAGING_DISTANCE = 3.5


@dataclass(frozen=True, kw_only=True)
class Case:
    """One object of an experiment, or one pair: a seed makes a run of it."""

    name: str
    """Experiment in result rows."""

    object: str
    """Object in result rows: its front slope [degrees], or what it is."""

    arrangement: str | None = None
    """Deployment in result rows; None where the object has one only."""

    rig: sw.Rig
    """Sonars and mounts."""

    deploy: Callable[..., Deployment]
    """Makes the deployment over a seabed of some ``roughness``."""

    def experiment(self, seed: int, noise: Literal["none", "field"]) -> Experiment:
        """The run of a seed; where there is noise, over a seabed of its own."""
        return Experiment(
            name=self.name,
            object=self.object,
            arrangement=self.arrangement,
            deployment=self.deploy(roughness=None if noise == "none" else Roughness(seed=seed)),
            rig=self.rig,
            noise=noise,
            seed=seed,
        )

    def batches(self, seeds: Sequence[int], noise: Literal["none", "field"]) -> Iterator[list[Experiment]]:
        """All seeds' runs, or as many at a time as memory allows."""
        size = runs_per_batch(self.experiment(seeds[0], noise))
        for start in range(0, len(seeds), size):
            yield [self.experiment(seed, noise) for seed in seeds[start : start + size]]


SLOPES = tuple(
    Case(
        name="slope-limit",
        object=f"{shape.front_slope_deg:g}",
        rig=sw.PRESETS["paper slope series"],
        deploy=partial(slope_deployment, shape),
    )
    for shape in TABLE_1
)
"""The objects of Table 1, alone (section 2.2, Figure 3)."""

PAIRS = tuple(
    Case(
        name="deployments",
        object=f"{shape.front_slope_deg:g}",
        arrangement=arrangement,
        rig=sw.PRESETS["paper simulation"],
        deploy=partial(pair_deployment, shape, arrangement),
    )
    for arrangement in ("aligned", "misaligned")
    for shape in TABLE_2
)
"""The objects of Table 2, two by two (section 3.1, Figures 8 and 9)."""

BRICK = Case(
    name="field",
    object="brick",
    rig=sw.PRESETS["paper field"],
    deploy=partial(brick_deployment, imaging_distance=_BRICK_IMAGING_DISTANCE),
)
"""The field test's brick (section 3.3, Figure 13)."""

CASES: Mapping[str, Sequence[Case]] = {"slope-limit": SLOPES, "deployments": PAIRS, "field": (BRICK,)}
"""Cases of each experiment, by its name."""
