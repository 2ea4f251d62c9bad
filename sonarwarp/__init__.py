"""Imaging and profiling sonars simulated and fused into 3-D point clouds on NVIDIA Warp."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sonarwarp.cloud import PointCloud, read_cloud
    from sonarwarp.log import Log, SonarLog
    from sonarwarp.navigation import EXACT_NAVIGATION, NO_MOTION, Motion, Navigation, plan_disturbed
    from sonarwarp.reconstructor import Clouds, Reconstructor, reconstruct
    from sonarwarp.schedule import Schedule, frames_per_round, plan_schedule
    from sonarwarp.settings import (
        NO_NOISE,
        Detection,
        Faces,
        FreeSpace,
        LikelihoodField,
        Noise,
        RangeMixture,
        ReconstructionSettings,
    )
    from sonarwarp.simulator import Simulator, simulate
    from sonarwarp.sonar import FLS, PRESETS, PS, Mount, Rig
    from sonarwarp.store import StoreError
    from sonarwarp.store_read import StoredLog, open_log
    from sonarwarp.store_simulation import simulate_to_store, survey_to_store
    from sonarwarp.store_write import StoreWriter, log_to_store
    from sonarwarp.survey import Frames, Pings, Survey, plan_survey

__all__ = [
    "EXACT_NAVIGATION",
    "FLS",
    "NO_MOTION",
    "NO_NOISE",
    "PRESETS",
    "PS",
    "Clouds",
    "Detection",
    "Faces",
    "Frames",
    "FreeSpace",
    "LikelihoodField",
    "Log",
    "Motion",
    "Mount",
    "Navigation",
    "Noise",
    "Pings",
    "PointCloud",
    "RangeMixture",
    "ReconstructionSettings",
    "Reconstructor",
    "Rig",
    "Schedule",
    "Simulator",
    "SonarLog",
    "StoreError",
    "StoreWriter",
    "StoredLog",
    "Survey",
    "frames_per_round",
    "log_to_store",
    "open_log",
    "plan_disturbed",
    "plan_schedule",
    "plan_survey",
    "read_cloud",
    "reconstruct",
    "simulate",
    "simulate_to_store",
    "survey_to_store",
]

_MODULES = (
    "cloud",
    "log",
    "navigation",
    "reconstructor",
    "schedule",
    "settings",
    "simulator",
    "sonar",
    "store",
    "store_read",
    "store_simulation",
    "store_write",
    "survey",
)


def __getattr__(name: str) -> object:
    # All loads at the first use of anything, Warp with it: the command line answers, or is interrupted, before.
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    for module in _MODULES:
        loaded = vars(import_module(f"{__name__}.{module}"))
        globals().update({public: loaded[public] for public in __all__ if public in loaded})
    return globals()[name]


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
