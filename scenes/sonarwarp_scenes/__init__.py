"""Scenes, trajectories and the paper's deployments, as plain arrays."""

from sonarwarp_scenes.deployments import (
    Deployment,
    brick_deployment,
    mesh_deployment,
    pair_deployment,
    slope_deployment,
)
from sonarwarp_scenes.files import scene_from_file
from sonarwarp_scenes.materials import CONCRETE, ROCK, SAND, STEEL, WATER
from sonarwarp_scenes.scene import Scene
from sonarwarp_scenes.seabed import Extent, Roughness, flat_seabed, rough_seabed
from sonarwarp_scenes.shapes import BRICK, FOOT, TABLE_1, TABLE_2, PlacedObject, Wedge
from sonarwarp_scenes.trajectories import Trajectory, straight_trajectory, waypoint_trajectory

__all__ = [
    "BRICK",
    "CONCRETE",
    "FOOT",
    "ROCK",
    "SAND",
    "STEEL",
    "TABLE_1",
    "TABLE_2",
    "WATER",
    "Deployment",
    "Extent",
    "PlacedObject",
    "Roughness",
    "Scene",
    "Trajectory",
    "Wedge",
    "brick_deployment",
    "flat_seabed",
    "mesh_deployment",
    "pair_deployment",
    "rough_seabed",
    "scene_from_file",
    "slope_deployment",
    "straight_trajectory",
    "waypoint_trajectory",
]
