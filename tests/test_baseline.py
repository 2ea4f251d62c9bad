"""The single-sonar baseline against theory: Eq. 4 and the exact locus of first contacts."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

import sonarwarp as sw
from sonarwarp.metrics import ObjectTruth, evaluate_section
from sonarwarp_scenes import (
    CONCRETE,
    TABLE_1,
    Extent,
    PlacedObject,
    Scene,
    flat_seabed,
    slope_deployment,
    straight_trajectory,
)
from tests.reference.locus import first_contact

TILT = math.radians(30.0)
HEIGHT = 2.5
COARSE = sw.ReconstructionSettings(likelihood_field=sw.LikelihoodField(cell=0.2), particles=1)


def rig(half_degrees, beams):
    """The slope series' rig with fewer beams of the paper's width, and a PS that costs next to nothing."""
    paper = sw.PRESETS["paper slope series"]
    fls = replace(paper.fls, azimuth_edge=np.radians(np.linspace(-half_degrees, half_degrees, beams + 1)))
    return replace(paper, fls=fls, ps=sw.PS(range_edge=np.linspace(0.3, 10.0, 65), strips=1, intervals=4))


def test_the_locus_agrees_with_rays():
    """The closed form against 20,000 rays of its own beam."""
    shape = TABLE_1[2]
    run = shape.height / math.tan(math.radians(shape.front_slope_deg))
    profile = [(-9.0, 0.0), (0.0, 0.0), (run, shape.height), (shape.depth, shape.height)]
    half = math.radians(7.0)
    for sensor_x, azimuth in ((-3.0, 0.0), (-2.2, 0.03), (-1.4, -0.05), (-0.5, 0.0)):
        elevation = np.linspace(-half, half, 20001)
        dx = math.cos(TILT) * np.cos(elevation) * math.cos(azimuth) + math.sin(TILT) * np.sin(elevation)
        dz = -math.sin(TILT) * np.cos(elevation) * math.cos(azimuth) + math.cos(TILT) * np.sin(elevation)
        nearest = np.full(elevation.shape, np.inf)
        for (x0, z0), (x1, z1) in itertools.pairwise(profile):
            # sensor + r d = corner + s edge, by Cramer's rule.
            edge = (x1 - x0, z1 - z0)
            offset = (x0 - sensor_x, z0 - HEIGHT)
            determinant = dx * -edge[1] + dz * edge[0]
            distance = (offset[0] * -edge[1] + offset[1] * edge[0]) / determinant
            part = (dx * offset[1] - dz * offset[0]) / determinant
            met = (part >= 0.0) & (part <= 1.0) & (distance > 0.0)
            nearest = np.where(met & (distance < nearest), distance, nearest)
        exact = first_contact(sensor_x, HEIGHT, TILT, azimuth, half, profile)
        assert exact == pytest.approx(nearest.min(), abs=2e-5)


@pytest.mark.parametrize("edge", ["nearest", "strongest"])
@pytest.mark.parametrize("shape", TABLE_1, ids=lambda shape: f"{shape.front_slope_deg:g} deg")
def test_critical_ranges_follow_the_locus_within_one_bin(device, shape, edge):
    chosen = rig(2.4, 16)
    placed = PlacedObject(name="object", shape=shape, front_x=0.0, centre_y=0.0)
    ground = flat_seabed(Extent(x_min=-15.0, x_max=20.0, y_min=-5.0, y_max=5.0))
    scene = Scene.join(ground, placed.scene(CONCRETE))
    # Frames 5 cm apart from where nothing is inside the region of interest to past the object's far edge.
    way = straight_trajectory((-4.6, 0.0, HEIGHT), heading=0.0, speed=0.5, length=4.6 + shape.depth)
    settings = replace(COARSE, detection=sw.Detection(edge=edge))
    log = sw.simulate(chosen, scene, way, device=device)
    cloud = sw.reconstruct(log, settings=settings, device=device).single
    found = np.full(log.images.shape[:2], np.nan)
    found[cloud.attributes["frame"], cloud.attributes["beam"]] = cloud.attributes["range"]

    run = 0.0 if shape.front_slope_deg == 90.0 else shape.height / math.tan(math.radians(shape.front_slope_deg))
    profile = [(-15.0, 0.0), (0.0, 0.0), (run, shape.height), (shape.depth, shape.height)]
    half = chosen.fls.half_elevation
    bin_size = float(chosen.fls.range_edge[1] - chosen.fls.range_edge[0])
    lower = TILT + half
    compared, errors = 0, []
    for frame, pose in enumerate(log.survey.frames.pose):
        for beam, azimuth in enumerate(chosen.fls.azimuth):
            exact = first_contact(pose[0], HEIGHT, TILT, azimuth, half, profile)
            down = math.sin(TILT) * math.cos(half) * math.cos(azimuth) + math.cos(TILT) * math.sin(half)
            seabed = HEIGHT / down
            # The filter needs five bins before the region's end, which the guard draws in by five more.
            if exact > seabed - 11 * bin_size or pose[0] + exact * math.cos(lower) > shape.depth - 0.05:
                continue
            compared += 1
            errors.append(found[frame, beam] - exact)
    assert compared > 300
    assert np.isfinite(errors).all()
    assert np.abs(errors).max() <= bin_size


@pytest.mark.parametrize("shape", TABLE_1[:2], ids=lambda shape: f"{shape.front_slope_deg:g} deg")
def test_steep_fronts_show_the_slope_limit_of_eq_4(device, shape):
    chosen = rig(4.5, 30)
    deployment = slope_deployment(shape)
    log = sw.simulate(
        chosen, deployment.scene, deployment.trajectory, frames_from=deployment.frames_from, device=device
    )
    cloud = sw.reconstruct(log, settings=COARSE, device=device).single
    truth = ObjectTruth(
        name="object",
        front_x=0.0,
        centre_y=0.0,
        width=shape.width,
        height=shape.height,
        depth=shape.depth,
        front_slope_deg=shape.front_slope_deg,
        sectional_area=shape.sectional_area,
        volume=shape.volume,
    )
    row = evaluate_section(cloud.points, [truth], slab_width=0.018)[0]
    upper = TILT + chosen.fls.half_elevation
    limit = math.atan2(math.cos(TILT) * math.sin(upper), 1.0 - math.cos(TILT) * math.cos(upper))
    assert row.slope_deg == pytest.approx(math.degrees(limit), abs=3.0)
