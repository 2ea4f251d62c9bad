"""Geometry: beams and their coordinates, the turning head of the profiling sonar, and bins of range."""

import numpy as np
import pytest
import warp as wp

from sonarwarp_kernels import geometry
from tests.reference import geometry as reference

# Float32 carries 24 bits; a chain of a few rotations loses a few of them.
EPSILON = float(np.finfo(np.float32).eps)

EDGES = {
    "uniform": np.linspace(0.42, 5.42, 513),
    "ten bins from zero": np.linspace(0.0, 1.0, 11),
    "one bin": np.array([1.0, 1.5]),
    "widening": np.geomspace(0.3, 40.0, 129),
    "a gap": np.array([1.0, 1.01, 1.02, 9.0, 9.5, 30.0]),
    "irregular": 0.5 + np.cumsum(np.random.default_rng(20).uniform(0.001, 0.2, 300)),
}


@wp.kernel
def beam_kernel(
    azimuth: wp.array(dtype=float),
    elevation: wp.array(dtype=float),
    distance: wp.array(dtype=float),
    cone: int,
    direction_out: wp.array(dtype=wp.vec3),
    polar_out: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    direction_out[i] = geometry.beam_direction(azimuth[i], elevation[i], cone)
    polar_out[i] = geometry.polar_coordinates(distance[i] * direction_out[i], cone)


@wp.kernel
def head_ray_kernel(
    world_from_head: wp.array(dtype=wp.transform),
    across: wp.array(dtype=float),
    in_plane: wp.array(dtype=float),
    ray_out: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    ray = geometry.beam_direction(in_plane[i], -across[i], 1)
    ray_out[i] = wp.transform_vector(world_from_head[i], ray)


@wp.kernel
def polar_kernel(point: wp.array(dtype=wp.vec3), cone: int, polar_out: wp.array(dtype=wp.vec3)):
    i = wp.tid()
    polar_out[i] = geometry.polar_coordinates(point[i], cone)


@wp.kernel
def bin_kernel(
    range_edge: wp.array(dtype=float),
    distance: wp.array(dtype=float),
    position: wp.array(dtype=float),
    bin_out: wp.array(dtype=int),
    range_out: wp.array(dtype=float),
):
    i = wp.tid()
    bin_out[i] = geometry.bin_below(range_edge, distance[i])
    range_out[i] = geometry.bin_range(range_edge, position[i])


def beams(azimuth, elevation, cone, device, distance=None):
    """Directions of beams, and the polar coordinates of points at ``distance`` along them."""
    distance = np.ones(len(azimuth)) if distance is None else distance
    direction = wp.zeros(len(azimuth), dtype=wp.vec3, device=device)
    polar = wp.zeros(len(azimuth), dtype=wp.vec3, device=device)
    inputs = [wp.array(values, dtype=float, device=device) for values in (azimuth, elevation, distance)]
    wp.launch(beam_kernel, len(azimuth), inputs=[*inputs, cone], outputs=[direction, polar], device=device)
    return direction.numpy(), polar.numpy()


def polar_coordinates(points, cone, device):
    polar = wp.zeros(len(points), dtype=wp.vec3, device=device)
    point = wp.array(points, dtype=wp.vec3, device=device)
    wp.launch(polar_kernel, len(points), inputs=[point, cone], outputs=[polar], device=device)
    return polar.numpy()


def turned_heads(orientation, head_angle, device, position=(0.0, 0.0, 0.0)):
    """Poses of the head, one for each head angle, of a sonar with one orientation matrix."""
    mount = np.tile(np.concatenate([position, reference.quaternion(orientation)]), (len(head_angle), 1))
    head = wp.zeros(len(head_angle), dtype=wp.transform, device=device)
    geometry.turn_heads(
        wp.array(mount, dtype=wp.transform, device=device),
        wp.array(head_angle, dtype=float, device=device),
        head,
        device=device,
    )
    return head


def head_rays(orientation, head_angle, across, in_plane, device):
    """Rays in the world, one for each triple of head angle xi, angle across the scan plane phi and within it theta."""
    head_angle, across, in_plane = np.broadcast_arrays(np.atleast_1d(head_angle), across, in_plane)
    ray = wp.zeros(len(head_angle), dtype=wp.vec3, device=device)
    inputs = [wp.array(values, dtype=float, device=device) for values in (across, in_plane)]
    head = turned_heads(orientation, head_angle, device)
    wp.launch(head_ray_kernel, len(head_angle), inputs=[head, *inputs], outputs=[ray], device=device)
    return ray.numpy()


def on_its_side(tilt, yaw=0.0):
    """Orientation of a profiling sonar laid on its side: rolled by +90 degrees, then tilted down."""
    return reference.sonar_rotation(np.pi / 2, tilt, yaw)


def bins(range_edge, distance, position, device):
    index = wp.zeros(len(distance), dtype=int, device=device)
    slant = wp.zeros(len(distance), dtype=float, device=device)
    inputs = [wp.array(values, dtype=float, device=device) for values in (range_edge, distance, position)]
    wp.launch(bin_kernel, len(distance), inputs=inputs, outputs=[index, slant], device=device)
    return index.numpy(), slant.numpy()


# Largest azimuth and elevation that each kind of beam tells apart: a fan all around, a cone in front of the array.
LIMITS = {0: (np.radians(179.0), np.radians(80.0)), 1: (np.radians(80.0), np.radians(179.0))}


@pytest.mark.parametrize("cone", [0, 1])
def test_direction_is_the_forward_axis_turned_and_raised(device, cone):
    random = np.random.default_rng(21)
    azimuth, elevation = (random.uniform(-limit, limit, 500) for limit in LIMITS[cone])
    direction, _ = beams(azimuth, elevation, cone, device)
    np.testing.assert_allclose(direction, reference.direction(azimuth, elevation, bool(cone)), atol=8 * EPSILON)


@pytest.mark.parametrize("cone", [0, 1])
def test_polar_coordinates_undo_the_direction(device, cone):
    random = np.random.default_rng(22)
    azimuth, elevation = (random.uniform(-limit, limit, 500) for limit in LIMITS[cone])
    distance = random.uniform(0.1, 100.0, 500)
    _, polar = beams(azimuth, elevation, cone, device, distance)
    np.testing.assert_allclose(polar[:, 0], distance, rtol=8 * EPSILON)
    # The arcsine at 80 degrees stretches rounding by 1 / cos 80 = 6; angles up to pi round by 3 epsilon themselves.
    np.testing.assert_allclose(polar[:, 1], azimuth, atol=24 * EPSILON)
    np.testing.assert_allclose(polar[:, 2], elevation, atol=24 * EPSILON)


@pytest.mark.parametrize("cone", [0, 1])
def test_left_is_positive_azimuth_and_up_is_positive_elevation(device, cone):
    half_turn = np.pi / 2
    cases = {(0.0, 0.0): (1, 0, 0), (half_turn, 0.0): (0, 1, 0), (0.0, half_turn): (0, 0, 1)}
    direction, _ = beams(*np.array(list(cases)).T, cone, device)
    np.testing.assert_allclose(direction, list(cases.values()), atol=EPSILON)


def test_a_cone_keeps_its_bearing_sine_and_a_fan_its_azimuth(device):
    elevation = np.linspace(-1.2, 1.2, 50)
    azimuth = np.full(50, 0.4)
    cone, _ = beams(azimuth, elevation, 1, device)
    fan, _ = beams(azimuth, elevation, 0, device)
    np.testing.assert_allclose(cone[:, 1], np.sin(0.4), atol=2 * EPSILON)
    np.testing.assert_allclose(np.arctan2(fan[:, 1], fan[:, 0]), 0.4, atol=4 * EPSILON)


@pytest.mark.parametrize("cone", [0, 1])
def test_the_sonar_itself_has_range_zero_and_finite_angles(device, cone):
    assert np.array_equal(polar_coordinates([(0.0, 0.0, 0.0)], cone, device), [[0.0, 0.0, 0.0]])


@pytest.mark.parametrize("cone", [0, 1])
@pytest.mark.parametrize("scale", [7.7e2, 3.3e-3])
def test_points_on_the_axes_have_exact_angles(device, cone, scale):
    points = scale * np.array([(0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)])
    angles = polar_coordinates(points, cone, device)[:, 1:]
    np.testing.assert_allclose(angles[:2, 0], [np.pi / 2, -np.pi / 2], atol=2 * EPSILON)
    np.testing.assert_allclose(angles[2:, 1], [np.pi / 2, -np.pi / 2], atol=2 * EPSILON)


@pytest.mark.parametrize("cone", [0, 1])
def test_angles_are_finite_where_squares_underflow(device, cone):
    # The range is then rounded so coarsely that y / r and z / r pass 1, whose arcsine is not a number.
    near = np.linspace(1e-22, 1e-20, 500)
    for axis in np.eye(3):
        assert np.isfinite(polar_coordinates(near[:, None] * axis, cone, device)).all()


def test_head_rays_follow_the_printed_order_of_rotations(device):
    random = np.random.default_rng(23)
    for roll, pitch, yaw in random.uniform(-np.pi, np.pi, (20, 3)):
        orientation = reference.sonar_rotation(roll, pitch, yaw)
        head_angle, across, in_plane = (random.uniform(-limit, limit, 40) for limit in (np.pi, 0.3, 0.3))
        rays = head_rays(orientation, head_angle, across, in_plane, device)
        expected = [
            reference.profiling_ray(orientation, *angles) for angles in zip(head_angle, across, in_plane, strict=True)
        ]
        # Angles up to pi round by 1.5 epsilon; then two quaternion products and one turn of a vector.
        np.testing.assert_allclose(rays, expected, atol=16 * EPSILON)


def test_turning_the_head_does_not_move_it(device):
    position = (12.5, -3.25, 1.75)
    head = turned_heads(on_its_side(0.4), np.linspace(-1.0, 1.0, 7), device, position)
    assert np.array_equal(head.numpy()[:, :3], np.tile(position, (7, 1)))


@pytest.mark.parametrize("tilt_deg", [0.0, 25.0, 40.0])
@pytest.mark.parametrize("yaw_deg", [0.0, -70.0])
def test_on_its_side_the_depression_is_the_tilt_less_the_head_angle(device, tilt_deg, yaw_deg):
    tilt, yaw = np.radians([tilt_deg, yaw_deg])
    head_angle = np.radians(np.arange(-30.0, 30.1, 1.8))
    rays = head_rays(on_its_side(tilt, yaw), head_angle, 0.0, 0.0, device)
    np.testing.assert_allclose(-np.arcsin(rays[:, 2]), tilt - head_angle, atol=16 * EPSILON)
    np.testing.assert_allclose(np.arctan2(rays[:, 1], rays[:, 0]), yaw, atol=16 * EPSILON)
    assert np.all(np.diff(rays[:, 2]) > 0.0), "a larger head angle raises the beam"


def test_on_its_side_the_head_axis_points_right(device):
    head = turned_heads(on_its_side(0.0), np.array([0.0, 0.8]), device).numpy()
    axis = [wp.quat_rotate(wp.quat(*map(float, pose[3:])), wp.vec3(0.0, 0.0, 1.0)) for pose in head]
    np.testing.assert_allclose(axis, [(0.0, -1.0, 0.0)] * 2, atol=4 * EPSILON)


def test_on_its_side_the_fan_lies_across_the_track_and_the_beam_within_it(device):
    half_fan, half_beam = np.radians([10.0, 0.9])
    left, right = head_rays(on_its_side(0.0), 0.0, np.array([half_fan, -half_fan]), 0.0, device)
    np.testing.assert_allclose([left[1], right[1]], [np.sin(half_fan), -np.sin(half_fan)], atol=4 * EPSILON)
    np.testing.assert_allclose([left[2], right[2]], 0.0, atol=4 * EPSILON)
    upper, lower = head_rays(on_its_side(0.0), 0.0, 0.0, np.array([half_beam, -half_beam]), device)
    np.testing.assert_allclose([upper[1], lower[1]], 0.0, atol=4 * EPSILON)
    np.testing.assert_allclose([upper[2], lower[2]], [np.sin(half_beam), -np.sin(half_beam)], atol=4 * EPSILON)


def test_scan_angle_and_fan_angle_are_a_fan_in_the_sonars_own_frame(device):
    random = np.random.default_rng(24)
    head_angle, across = random.uniform(-np.pi, np.pi, 100), random.uniform(-0.3, 0.3, 100)
    rays = head_rays(np.eye(3), head_angle, across, 0.0, device)
    polar = polar_coordinates(rays, 0, device)
    np.testing.assert_allclose(polar[:, 1], head_angle, atol=16 * EPSILON)
    np.testing.assert_allclose(polar[:, 2], -across, atol=16 * EPSILON)


@pytest.mark.parametrize("range_edge", EDGES.values(), ids=EDGES.keys())
def test_every_distance_falls_in_the_bin_that_holds_it(device, range_edge):
    random = np.random.default_rng(25)
    edge = range_edge.astype(np.float32)
    span = edge[-1] - edge[0]
    distance = np.concatenate(
        [
            edge,
            np.nextafter(edge, np.float32(np.inf)),
            np.nextafter(edge, np.float32(-np.inf)),
            random.uniform(edge[0] - span, edge[-1] + span, 2000).astype(np.float32),
            np.array([-1.0, 0.0, 1e6, np.inf, -np.inf], dtype=np.float32),
        ]
    )
    index, _ = bins(edge, distance, np.zeros(len(distance)), device)
    assert np.array_equal(index, reference.bin_below(edge, distance))


@pytest.mark.parametrize("range_edge", EDGES.values(), ids=EDGES.keys())
def test_fractional_bins_lie_on_straight_lines_between_edges(device, range_edge):
    random = np.random.default_rng(26)
    edge = range_edge.astype(np.float32)
    last = len(edge) - 1
    position = np.concatenate(
        [np.arange(last + 1) - 0.5, np.arange(last), random.uniform(-0.5, last - 0.5, 2000), [-9.0, -0.6, last, 1e6]]
    ).astype(np.float32)
    _, slant = bins(edge, np.zeros(len(position)), position, device)
    # Half a step of float32 in the coordinate moves the range by that part of the widest bin.
    coordinate_rounding = 0.5 * np.spacing(np.float32(last + 1)) * np.diff(edge).max()
    np.testing.assert_allclose(
        slant, reference.bin_range(edge, position), rtol=2 * EPSILON, atol=float(coordinate_rounding)
    )


@pytest.mark.parametrize("range_edge", EDGES.values(), ids=EDGES.keys())
def test_bin_centres_fall_back_into_their_bins(device, range_edge):
    edge = range_edge.astype(np.float32)
    centre = np.arange(len(edge) - 1)
    _, slant = bins(edge, np.zeros(len(centre)), centre, device)
    index, _ = bins(edge, slant, centre, device)
    assert np.array_equal(index, centre)


def test_turn_heads_refuses_wrong_arrays_by_name(device):
    pose = wp.zeros(3, dtype=wp.transform, device=device)
    angle = wp.zeros(3, dtype=float, device=device)
    short = wp.zeros(2, dtype=wp.transform, device=device)
    with pytest.raises(ValueError, match=r"head_angle: expected shape \(3,\), got \(3, 1\)"):
        geometry.turn_heads(pose, angle.reshape((3, 1)), pose, device=device)
    with pytest.raises(ValueError, match="world_from_mount: expected dtype transform"):
        geometry.turn_heads(angle, angle, pose, device=device)
    with pytest.raises(ValueError, match=r"world_from_head_out: expected shape \(3,\), got \(2,\)"):
        geometry.turn_heads(pose, angle, short, device=device)
