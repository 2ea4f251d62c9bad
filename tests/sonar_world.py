"""Small worlds and arrays for tests that cast rays: scenes on a device, poses, keys and scratch."""

import math
from dataclasses import dataclass

import numpy as np
import warp as wp
from sonarwarp_kernels import forming, keys, raycast
from sonarwarp_kernels.specs import Fan, SceneTable
from sonarwarp_scenes import BRICK, CONCRETE, TABLE_2, WATER, Extent, Roughness, Scene, flat_seabed, rough_seabed

from tests.reference import echo as oracle
from tests.reference.geometry import quaternion, sonar_rotation

AHEAD = Extent(x_min=-1.0, x_max=8.0, y_min=-2.5, y_max=2.5)
