"""Logs of a tiny rig, filled with keyed noise, for tests of what lies on disk."""

from dataclasses import fields

import numpy as np

import sonarwarp as sw
from sonarwarp_scenes import straight_trajectory

RIG = sw.Rig(
    fls=sw.FLS(azimuth_edge=np.radians([-3.0, -1.5, 0.0, 2.0, 3.0]), range_edge=np.linspace(2.0, 4.5, 9)),
    ps=sw.PS(range_edge=np.geomspace(1.0, 7.0, 7)),
)

CHUNK = 64
"""Frames that this rig's logs have in a chunk: the most."""


def small_survey(frames=150, rig=RIG, runs=1):
    """Level runs of ``frames`` frames at 10 Hz each."""
    span = (frames - 1) / 10 + 0.05
    return sw.plan_survey(
        rig,
        [
            straight_trajectory((-3.0 - start, 0.1 * start, 1.8), heading=0.1 + start, speed=0.1, length=0.1 * span)
            for start in range(runs)
        ],
    )


def small_log(frames=150, seed=0, rig=RIG, runs=1):
    """A log of noise."""
    survey = small_survey(frames, rig, runs)
    draw = np.random.default_rng(seed)
    shape = (len(survey.frames), rig.fls.beams, rig.fls.bins)
    return sw.SonarLog(
        survey=survey,
        images=draw.rayleigh(size=shape).astype(np.float32),
        echoes=draw.rayleigh(size=(len(survey.pings), rig.ps.bins)).astype(np.float32),
    )


def same_survey(one, other, frames=None, pings=None):
    """Whether the second survey is the first, or its beginning, to the bit."""
    return all(
        np.array_equal(getattr(rows, column.name), getattr(of, column.name)[:count])
        for rows, of, count in ((one.frames, other.frames, frames), (one.pings, other.pings, pings))
        for column in fields(rows)
    ) and np.array_equal(one.rig.fls.range_edge, other.rig.fls.range_edge)
