"""Scenes, trajectories and the paper's deployments, as plain arrays."""

from sonarwarp_scenes.burial import bury, exposed_bounds
from sonarwarp_scenes.conversion import Conversion
from sonarwarp_scenes.deployments import (
    Deployment,
    brick_deployment,
    mesh_deployment,
    object_deployment,
    pair_deployment,
    slope_deployment,
)
from sonarwarp_scenes.files import read_scene, scene_from_file
from sonarwarp_scenes.materials import CONCRETE, MATERIALS, ROCK, SAND, STEEL, WATER, Material
from sonarwarp_scenes.report import ImpedanceReport, PartReport, SceneReport
from sonarwarp_scenes.round_shapes import Frustum, LyingCylinder, Sphere
from sonarwarp_scenes.scene import Scene
from sonarwarp_scenes.seabed import Extent, Roughness, flat_seabed, rough_seabed
from sonarwarp_scenes.shapes import BRICK, FOOT, TABLE_1, TABLE_2, PlacedObject, Shape, Wedge
from sonarwarp_scenes.trajectories import Trajectory, straight_trajectory, waypoint_trajectory
from sonarwarp_scenes.usd import read_stage
from sonarwarp_scenes.usd_track import read_frames_from, read_trajectory
from sonarwarp_scenes.usd_write import SonarOutline, write_deployment, write_scene

__all__ = [
    "BRICK",
    "CONCRETE",
    "FOOT",
    "MATERIALS",
    "ROCK",
    "SAND",
    "STEEL",
    "TABLE_1",
    "TABLE_2",
    "WATER",
    "Conversion",
    "Deployment",
    "Extent",
    "Frustum",
    "ImpedanceReport",
    "LyingCylinder",
    "Material",
    "PartReport",
    "PlacedObject",
    "Roughness",
    "Scene",
    "SceneReport",
    "Shape",
    "SonarOutline",
    "Sphere",
    "Trajectory",
    "Wedge",
    "brick_deployment",
    "bury",
    "exposed_bounds",
    "flat_seabed",
    "mesh_deployment",
    "object_deployment",
    "pair_deployment",
    "read_frames_from",
    "read_scene",
    "read_stage",
    "read_trajectory",
    "rough_seabed",
    "scene_from_file",
    "slope_deployment",
    "straight_trajectory",
    "waypoint_trajectory",
    "write_deployment",
    "write_scene",
]
