"""What the paper prints of its own results, and what its theory says of the single-sonar method."""

from __future__ import annotations

import math
from collections.abc import Mapping

from sonarwarp.sonar import Rig

FIELD_TEST: Mapping[str, Mapping[str, float]] = {
    "single": {"slope_deg": 63.89, "slope_error": 0.29, "area_error": 0.57, "volume_error": 0.81},
    "fused": {"slope_deg": 85.77, "slope_error": 0.047, "area_error": 0.12, "volume_error": 0.18},
}
"""Section 3.3, by method, keyed as result rows are. Of its simulations the paper prints curves and no figures."""


def slope_limit_deg(rig: Rig) -> float:
    """Front slope over which the single-sonar method sees no steeper one, for a level vehicle (Eq. 4) [degrees]."""
    tilt = math.radians(rig.fls_mount.tilt_deg)
    lower = tilt + rig.fls.half_elevation
    rise, run = math.cos(tilt) * math.sin(lower), 1.0 - math.cos(tilt) * math.cos(lower)
    return math.degrees(math.atan2(rise, run))
