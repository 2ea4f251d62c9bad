"""Where each frame lies between the knots of its speckle: along the way that a sonar moves and turns."""

from __future__ import annotations

import numpy as np

from sonarwarp.poses import compose
from sonarwarp.survey import by_trajectory

# From so many knots on two frames have nothing in common.
_INDEPENDENT = 2.0


def speckle_knots(
    pose: np.ndarray, trajectory: np.ndarray, length: float, beamwidth: float
) -> tuple[np.ndarray, np.ndarray]:
    """Number of the knot before each frame, and how far the frame is from it to the next, 0 to under 1; both [frame].

    Knots lie one ``length`` apart along the way, as they do one ``beamwidth`` apart along turns about the sonar's z
    axis: then its beams look at other scatterers (Burckhardt 1978). A frame that shares no knot with the one before
    begins on a knot of its own, which takes half the draws.

    Args:
        pose: true world_from_sensor, in order of time within each trajectory, shape [frame, 7].
        trajectory: of each frame, shape [frame].
        length: distance between knots [m]; 0 gives each frame a knot of its own.
        beamwidth: horizontal in the sonar's frame [rad].
    """
    knot, blend = np.zeros(len(pose), dtype=np.int64), np.zeros(len(pose))
    for rows in by_trajectory(trajectory):
        if len(rows):
            knot[rows], blend[rows] = _knots_of_one(pose[rows], length, beamwidth)
    return knot, blend


def _knots_of_one(pose: np.ndarray, length: float, beamwidth: float) -> tuple[np.ndarray, np.ndarray]:
    way = np.linalg.norm(np.diff(pose[:, :3], axis=0), axis=1)
    step = np.append(0.0, way + _turns(pose) * (length / beamwidth))
    fresh = step >= _INDEPENDENT * length
    fresh[0] = True
    passed = np.cumsum(np.where(fresh, 0.0, step)) / (length or 1.0)
    stretch = np.cumsum(fresh) - 1
    first = np.flatnonzero(fresh)
    passed -= passed[first][stretch]
    last = passed[np.append(first[1:], len(pose)) - 1]
    start = np.append(0, np.cumsum(np.ceil(last[:-1]).astype(np.int64) + 1))
    knot = np.floor(passed).astype(np.int64)
    return start[stretch] + knot, passed - knot


def _turns(pose: np.ndarray) -> np.ndarray:
    """Angle about the sonar's own z axis from each pose to the next [rad], shape [pose - 1]."""
    back = pose[:-1] * np.array([0.0, 0.0, 0.0, -1.0, -1.0, -1.0, 1.0])
    back[:, :3] = 0.0
    turn = compose(back, pose[1:])
    return 2.0 * np.arctan2(np.abs(turn[:, 5]), np.abs(turn[:, 6]))
