"""Imaging and profiling sonars simulated and fused into 3-D point clouds on NVIDIA Warp."""

from sonarwarp.cloud import PointCloud, read_cloud
from sonarwarp.log import Log, SonarLog
from sonarwarp.reconstructor import Clouds, Reconstructor, reconstruct
from sonarwarp.schedule import Schedule, frames_per_round, plan_schedule
from sonarwarp.settings import (
    NO_NOISE,
    Detection,
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
    "FLS",
    "NO_NOISE",
    "PRESETS",
    "PS",
    "Clouds",
    "Detection",
    "Frames",
    "LikelihoodField",
    "Log",
    "Mount",
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
    "plan_schedule",
    "plan_survey",
    "read_cloud",
    "reconstruct",
    "simulate",
    "simulate_to_store",
    "survey_to_store",
]
