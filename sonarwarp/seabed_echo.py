"""What a flat seabed sends back: the level that backgrounds and thresholds are measured against."""

from __future__ import annotations

import math

from sonarwarp_kernels.specs import Fan

SAND_REFLECTION = 0.35
"""Reflection of the seabed that the background is measured against: sand in water."""


def seabed_echo(fan: Fan, altitude: float, depression: float, half_width: float) -> float:
    """Amplitude that a flat sandy seabed leaves in one bin, where a beam of ``half_width`` [rad] meets it.

    Closed form of Eq. 36 over a plane: the share of the beam within one bin, times the echo there.

    Args:
        fan: the sonar, for its amplitude and bins.
        altitude: of the sonar [m].
        depression: of the ray towards the seabed [rad].
        half_width: half the beamwidth in the vertical plane [rad].
    """
    edges = fan.range_edge.numpy()
    # A grazing or a vertical ray has no echo that anything could be measured against.
    depression = min(max(depression, 0.05), math.pi / 2 - 0.05)
    distance = altitude / math.sin(depression)
    bin_width = float(edges[-1] - edges[0]) / (len(edges) - 1)
    share = min(bin_width * math.tan(depression) / distance / (2.0 * half_width), 1.0)
    return share * fan.amplitude * SAND_REFLECTION * math.sin(depression) ** 2 / distance**2
