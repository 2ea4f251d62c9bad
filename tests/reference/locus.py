"""Exact first contacts of a fan beam with a body extruded along y: closed form, float64."""

import numpy as np


def first_contact(sensor_x, height, tilt, azimuth, half_elevation, profile):
    """Nearest range to a profile within a beam.

    A ray at elevation e has, in the plane of x and z, the direction a cos e + b sin e. Over a facet of normal n at
    distance c its range is c / (n . direction), least where n . direction is largest: at the foot of the perpendicular
    if that lies on the facet and in the beam, else at an end of what the beam sees of it.

    Args:
        sensor_x: position of the sonar [m].
        height: of the sonar over z = 0 [m].
        tilt: downwards [rad].
        azimuth: of the beam [rad].
        half_elevation: half the vertical beamwidth [rad].
        profile: corners (x, z) from the seabed's near end onwards; faces are seen from above and from the left.

    Returns:
        Range [m]; infinite where no facet is met.
    """
    along = np.array([np.cos(tilt) * np.cos(azimuth), -np.sin(tilt) * np.cos(azimuth)])
    across = np.array([np.sin(tilt), np.cos(tilt)])
    corners = np.asarray(profile, dtype=np.float64) - [sensor_x, height]
    # Elevation of the ray through each corner: the cross product of direction and corner vanishes.
    angle = np.arctan2(
        along[0] * corners[:, 1] - along[1] * corners[:, 0], across[1] * corners[:, 0] - across[0] * corners[:, 1]
    )
    best = np.inf
    highest = -np.inf
    for start, stop in zip(range(len(corners) - 1), range(1, len(corners)), strict=True):
        edge = corners[stop] - corners[start]
        normal = np.array([-edge[1], edge[0]]) / np.linalg.norm(edge)
        distance = normal @ corners[start]
        # From the near end outwards, what lies under an elevation met before is hidden.
        low, high = max(angle[start], highest), angle[stop]
        highest = max(highest, angle[start], angle[stop])
        low, high = max(low, -half_elevation), min(high, half_elevation)
        if distance >= 0.0 or low >= high:
            continue
        foot = np.arctan2(normal @ across, normal @ along)
        foot = (foot + np.pi) if normal @ (along * np.cos(foot) + across * np.sin(foot)) > 0.0 else foot
        foot = (foot + np.pi) % (2.0 * np.pi) - np.pi
        elevation = np.clip(foot, low, high)
        best = min(best, distance / (normal @ (along * np.cos(elevation) + across * np.sin(elevation))))
    return best
