"""What one frame proves empty, of points and of balls."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from sonarwarp_kernels import proof
from sonarwarp_kernels.particles import Contacts
from sonarwarp_kernels.specs import Fan
from tests.arc_world import UNDETECTED
from tests.carved_world import UNEVEN, CarvedWorld
from tests.reference import free_depth as reference
from tests.reference.geometry import direction

EPSILON = float(np.finfo(np.float32).eps)
EVEN = np.linspace(-0.5, 0.5, 9, dtype=np.float32)
# Positions and ranges of up to 5 m, some operations each.
LENGTH = 16 * EPSILON * 5.0


@wp.kernel
def nearest_beam_kernel(fan: Fan, angle: wp.array(dtype=float), beam_out: wp.array(dtype=int)):
    index = wp.tid()
    beam_out[index] = proof.nearest_beam(fan, angle[index])


@wp.kernel
def free_range_kernel(fan: Fan, carving: proof.Carving, contacts: Contacts, range_out: wp.array2d(dtype=float)):
    frame, beam = wp.tid()
    range_out[frame, beam] = proof.free_range(fan, carving, contacts, frame, beam)


@wp.kernel
def proven_depth_kernel(
    fan: Fan,
    carving: proof.Carving,
    contacts: Contacts,
    point: wp.array(dtype=wp.vec3),
    depth_out: wp.array(dtype=float),
):
    index = wp.tid()
    view = proof.view_of(fan, carving)
    depth_out[index] = proof.proven_depth(fan, carving, contacts, view, 0, point[index])


@wp.kernel
def ball_kernel(
    fan: Fan,
    carving: proof.Carving,
    contacts: Contacts,
    centre: wp.array(dtype=wp.vec3),
    radius: float,
    point: wp.array2d(dtype=wp.vec3),
    may_out: wp.array(dtype=int),
    depth_out: wp.array2d(dtype=float),
):
    ball = wp.tid()
    view = proof.view_of(fan, carving)
    may_out[ball] = int(proof.may_prove(fan, carving, contacts, view, 0, centre[ball], radius))
    for index in range(point.shape[1]):
        depth_out[ball, index] = proof.proven_depth(fan, carving, contacts, view, 0, point[ball, index])


@pytest.mark.parametrize(
    ("azimuth", "border"),
    [
        (EVEN, None),
        (UNEVEN, None),
        (np.float32([-0.1, 0.9, 1.0]), [-0.15, 0.4, 0.95, 1.05]),
        (np.float32([-0.2, 0.1]), [-0.3, -0.1, 0.3]),
        (np.float32([0.1]), [0.05, 0.15]),
    ],
    ids=["even", "uneven", "a wide gap", "two beams", "one beam"],
)
def test_a_direction_belongs_to_the_nearest_beam_and_outside_of_the_fan_to_none(device, azimuth, border):
    world = CarvedWorld.around(np.eye(3), azimuth=azimuth, border=None if border is None else np.float32(border))
    angle = np.concatenate([np.linspace(-1.6, 1.6, 4001), azimuth, world.borders]).astype(np.float32)
    beam = wp.zeros(len(angle), dtype=int, device=device)
    angles = wp.array(angle, dtype=float, device=device)
    wp.launch(nearest_beam_kernel, len(angle), [world.inputs(device)["fan"], angles], [beam], device=device)
    away = np.abs(angle.astype(np.float64)[:, None] - azimuth.astype(np.float64))
    got, inside = beam.numpy(), (angle >= world.borders[0]) & (angle <= world.borders[-1])
    assert np.array_equal(got >= 0, inside)
    # Half-way between two either is the nearest.
    assert np.all(away[inside, got[inside]] <= away[inside].min(axis=1) + 2 * EPSILON)
    assert set(got[inside]) == set(range(len(azimuth)))


@pytest.mark.parametrize(
    ("critical", "seabed", "expected"),
    [
        (2.0, 3.0, 2.0),  # a critical point
        (3.2, 3.0, 3.2),  # one that an uneven seabed left behind r_emin
        (2.0, np.inf, 2.0),
        (UNDETECTED, 3.0, 3.0 - 0.05),  # none: up to a guard before r_emin
        (UNDETECTED, 9.0, 4.0 - 0.05),  # r_emin beyond the window, which ends at 4 m
        (UNDETECTED, np.inf, 4.0 - 0.05),  # no seabed ahead
        (UNDETECTED, 0.0, 0.0 - 0.05),  # a frame that nobody has worked in proves nothing
    ],
)
def test_a_beam_is_free_up_to_its_critical_point_or_the_end_of_its_roi(device, critical, seabed, expected):
    world = CarvedWorld.around(np.eye(3))
    full = np.ones_like(world.critical)
    world = replace(world, critical=critical * full, seabed=seabed * full)
    out = wp.zeros(full.shape, dtype=float, device=device)
    inputs = world.inputs(device)
    arguments = [inputs["fan"], world.carving(), inputs["contacts"]]
    wp.launch(free_range_kernel, full.shape, arguments, [out], device=device)
    np.testing.assert_allclose(out.numpy(), expected, atol=2 * EPSILON * 4)
    oracle = reference.free_ranges(world.critical, world.seabed, 4.0, world.guard)
    np.testing.assert_allclose(out.numpy(), oracle, atol=2 * EPSILON * 4)


@pytest.mark.parametrize("cone", [0, 1])
@pytest.mark.parametrize(
    ("azimuth", "elevation", "distance", "expected"),
    [
        (0.1, 0.0, 1.5, 0.5),  # half a metre before the critical point
        (0.1, 0.0, 2.0, 0.0),  # on it
        (0.1, 0.2, 2.25, -0.25),  # behind it
        (0.1, 0.0, 0.5, 1.5),  # the reach bounds from below only: above, after the second largest was found
        (0.1, 0.0, 3.5, -1.0),
        (0.1, 0.269, 1.5, 0.5),  # the beam ends at 0.3, the margin takes 0.03
        (0.1, 0.271, 1.5, -1.0),
        (0.1, -0.269, 1.5, 0.5),
        (0.1, -0.271, 1.5, -1.0),
        (0.559, 0.0, 1.5, 0.5),  # the fan ends at 0.525 + 0.035
        (0.561, 0.0, 1.5, -1.0),
        (-0.539, 0.0, 1.5, 0.5),
        (-0.541, 0.0, 1.5, -1.0),
    ],
)
def test_a_place_has_the_free_depth_of_its_beam(device, cone, azimuth, elevation, distance, expected):
    border = np.float32([-0.54, -0.46, -0.36, -0.1, 0.125, 0.275, 0.56])
    world = CarvedWorld.around(np.eye(3), cone=cone, border=border)
    world = replace(world, critical=np.full_like(world.critical, 2.0))
    point = distance * direction(np.array([azimuth]), np.array([elevation]), bool(cone))
    out = wp.zeros(1, dtype=float, device=device)
    inputs = world.inputs(device)
    arguments = [inputs["fan"], world.carving(), inputs["contacts"], wp.array(point, dtype=wp.vec3, device=device)]
    wp.launch(proven_depth_kernel, 1, arguments, [out], device=device)
    np.testing.assert_allclose(out.numpy(), [expected], atol=LENGTH)


@pytest.mark.parametrize("cone", [0, 1])
@pytest.mark.parametrize("azimuth", [EVEN, UNEVEN, np.linspace(-1.5, 1.5, 31, dtype=np.float32)])
@pytest.mark.parametrize("radius", [0.02, 0.15, 1.0])
def test_of_balls_that_are_left_out_a_frame_proves_no_point(device, radius, azimuth, cone):
    world = CarvedWorld.around(np.eye(3), azimuth=azimuth, cone=cone, reach=0.1)
    rng = np.random.default_rng(74)
    centre = rng.uniform(-5.0, 5.0, (3000, 3)) * [1.0, 1.0, 0.3]
    aside = rng.normal(size=(3000, 60, 3))
    aside *= radius * np.cbrt(rng.uniform(0.0, 1.0, (3000, 60, 1))) / np.linalg.norm(aside, axis=-1, keepdims=True)
    inputs = world.inputs(device)
    balls = [wp.array(centre, dtype=wp.vec3, device=device), radius]
    points = wp.array(centre[:, None] + aside, dtype=wp.vec3, device=device)
    may, depth = wp.zeros(3000, dtype=int, device=device), wp.zeros((3000, 60), dtype=float, device=device)
    arguments = [inputs["fan"], world.carving(), inputs["contacts"], *balls, points]
    wp.launch(ball_kernel, 3000, arguments, [may, depth], device=device)
    proves = np.any(depth.numpy() > -world.reach, axis=1)
    left_out = may.numpy() == 0
    assert not np.any(proves & left_out)
    assert np.sum(proves) > 50
    # And hardly any small ball is kept in vain.
    assert np.mean(left_out[~proves]) > (0.9 if radius < 0.1 else 0.3)
