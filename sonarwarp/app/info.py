"""What is installed, what it may run on, and the rigs that come with it."""

from __future__ import annotations

import math
from typing import Any

from sonarwarp.app.machine import describe_devices, start_warp, versions
from sonarwarp.app.paper_printed import slope_limit_deg
from sonarwarp.sonar import PRESETS, Rig


def gather_info() -> dict[str, Any]:
    """Versions, devices, what Warp said when it started, and main figures of every preset."""
    remark = start_warp()
    return {
        "versions": versions(),
        "devices": describe_devices(),
        "remark": remark,
        "presets": {name: rig_figures(rig) for name, rig in PRESETS.items()},
    }


def rig_figures(rig: Rig) -> dict[str, float]:
    """Main figures of a rig, by name and unit."""
    fls, ps = rig.fls, rig.ps
    return {
        "tilt [°]": rig.fls_mount.tilt_deg,
        "slope limit [°]": round(slope_limit_deg(rig), 3),
        "FLS beams": fls.beams,
        "FLS bins": fls.bins,
        "FLS azimuth [°]": round(math.degrees(fls.azimuth_edge[-1] - fls.azimuth_edge[0]), 3),
        "FLS elevation [°]": fls.vertical_beamwidth_deg,
        "FLS nearest range [m]": float(fls.range_edge[0]),
        "FLS farthest range [m]": float(fls.range_edge[-1]),
        "FLS frames [1/s]": fls.rate,
        "PS bins": ps.bins,
        "PS beamwidth [°]": ps.beamwidth_deg,
        "PS fan [°]": ps.fan_beamwidth_deg,
        "PS sector [°]": ps.sector_deg,
        "PS step [°]": ps.step_deg,
        "PS scan rate [°/s]": ps.scan_rate_deg,
        "PS farthest range [m]": float(ps.range_edge[-1]),
    }
