"""Imaging and profiling sonars simulated and fused into 3-D point clouds on NVIDIA Warp."""

from sonarwarp.sonar import FLS, PRESETS, PS, Mount, Rig

__all__ = ["FLS", "PRESETS", "PS", "Mount", "Rig"]
