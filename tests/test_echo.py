"""Echoes follow Eq. 36, bins hold the mean over the aperture, and few rays form the image that many would.

Errors are RMS of the difference over RMS of the reference, noise off, whole window.
"""

import dataclasses
import math

import numpy as np
import pytest
import warp as wp
from scipy.spatial.transform import Rotation

from sonarwarp import FLS, PRESETS, PS
from sonarwarp_kernels import echo, forming
from sonarwarp_kernels.specs import Fan
from sonarwarp_scenes import SAND, WATER, Extent, Roughness, Scene, flat_seabed, rough_seabed
from tests.reference import echo as oracle
from tests.sonar_world import (
    AHEAD,
    Frames,
    World,
    ball_on_flat,
    box,
    brick_on_flat,
    cast,
    formed_counts,
    formed_image,
    plate,
    pose,
    reference_image,
    relative_error,
    rods_on_flat,
    rough,
    scratch_for,
    vase_on_flat,
    wall,
    wandering_poses,
    wedges_on_flat,
)

ORIGIN = pose((0.0, 0.0, 0.0))

# Altitude [m] and tilt [deg] of the paper's experiments.
GEOMETRY = {
    "paper simulation": (3.5, 40.0),
    "paper slope series": (2.5, 30.0),
    "paper field": (1.8, 25.0),
}

SAND_REFLECTION = (SAND - WATER) / (SAND + WATER)


def narrow_fls(beams: int = 6, preset: str = "paper simulation", **changes) -> FLS:
    """A preset's FLS with fewer beams of the same width."""
    half = 29.0 / 96 * beams / 2
    edge = np.radians(np.linspace(-half, half, beams + 1))
    return dataclasses.replace(PRESETS[preset].fls, azimuth_edge=edge, **changes)


def head_poses(preset: str, count: int) -> np.ndarray:
    """Poses of the PS's head over its sector, the vehicle rolling and straying, shape [ping, 7]."""
    rig = PRESETS[preset]
    altitude, tilt = GEOMETRY[preset]
    mount = rig.tilted(tilt).ps_mount.vehicle_from_sensor()
    head = np.radians(np.linspace(-0.5, 0.5, count) * rig.ps.sector_deg)
    poses = []
    for vehicle, angle in zip(wandering_poses(count, altitude, 0.0), head, strict=True):
        turn = Rotation.from_quat(vehicle[3:])
        position = vehicle[:3] + turn.apply(mount[:3])
        poses.append([*position, *(turn * Rotation.from_quat(mount[3:]) * Rotation.from_euler("z", angle)).as_quat()])
    return np.array(poses)


# --- Eq. 36 ---


@wp.kernel
def amplitude_kernel(
    reflection: wp.array(dtype=float),
    distance: wp.array(dtype=float),
    cosine: wp.array(dtype=float),
    amplitude_out: wp.array(dtype=float),
):
    i = wp.tid()
    amplitude_out[i] = echo.echo_amplitude(2.5, reflection[i], distance[i], cosine[i])


def test_amplitude_matches_the_equation(device):
    impedance, distance, cosine = (
        axis.ravel()
        for axis in np.meshgrid([WATER / 3, WATER, SAND, 1e9], [0.42, 1.0, 10.0], [-1.0, -0.3, 0.0, 0.6, 1.0])
    )
    arguments = [(impedance - WATER) / (impedance + WATER), distance, cosine]
    out = wp.zeros(len(distance), dtype=float, device=device)
    inputs = [wp.array(values, dtype=float, device=device) for values in arguments]
    wp.launch(amplitude_kernel, len(distance), inputs=inputs, outputs=[out], device=device)
    expected = oracle.echo_amplitude(2.5, impedance, WATER, distance, cosine)
    np.testing.assert_allclose(out.numpy(), expected, rtol=1e-5)


def wall_echo(device, distance, impedance=SAND, amplitude=1.0, **changes):
    """Sum over a beam's bins of a wall across its axis."""
    fls = narrow_fls(1, range_edge=np.linspace(0.4, 8.4, 513), **changes)
    fan = fls.fan(device)
    world = World(device, wall(distance, impedance=impedance))
    return formed_image(world, fan, Frames(world, ORIGIN[None])).sum()


def test_echo_falls_with_the_square_of_range(device):
    near, far = wall_echo(device, 2.0), wall_echo(device, 6.0)
    assert near / far == pytest.approx(9.0, rel=1e-4)
    # Over a wall at d, the ray at angle a from its normal has r = d / cos(a): the echo is R cos^4(a) / d^2.
    angle = np.linspace(-1, 1, 2001) * math.radians(7.0)
    assert near == pytest.approx(SAND_REFLECTION * np.mean(np.cos(angle) ** 4) / 4.0, rel=1e-4)


def test_echo_takes_the_magnitude_of_the_reflection(device):
    hard, soft = wall_echo(device, 3.0, WATER * 5), wall_echo(device, 3.0, WATER / 5)
    assert hard == pytest.approx(soft, rel=1e-5)
    assert hard / wall_echo(device, 3.0, SAND) == pytest.approx(4 / 6 / SAND_REFLECTION, rel=1e-4)
    assert wall_echo(device, 3.0, WATER) == 0.0


def test_echo_follows_the_gain(device):
    assert wall_echo(device, 3.0, gain_db=20.0) / wall_echo(device, 3.0) == pytest.approx(10.0, rel=1e-4)


@pytest.mark.parametrize("slant_deg", [0.0, 30.0, 60.0, 75.0])
def test_echo_falls_with_the_squared_cosine_of_incidence(device, slant_deg):
    # A narrow beam on a wall that is turned about the vertical by the angle of incidence.
    fls = narrow_fls(1, range_edge=np.linspace(0.4, 8.4, 513), vertical_beamwidth_deg=0.2)
    slant = math.radians(slant_deg)
    along = np.array([math.sin(slant), math.cos(slant), 0.0]) * 20
    up = np.array([0, 0, 20.0])
    middle = np.array([4.0, 0, 0])
    corners = [middle + along - up, middle - along - up, middle - along + up, middle + along + up]
    world = World(device, plate(corners))
    got = formed_image(world, fls.fan(device), Frames(world, ORIGIN[None])).sum()
    assert got == pytest.approx(SAND_REFLECTION * math.cos(slant) ** 2 / 16.0, rel=3e-4)


@pytest.mark.parametrize(("scene", "tolerance"), [(flat_seabed(AHEAD), 1e-3), (rough(), 0.02)], ids=["flat", "rough"])
def test_energy_does_not_depend_on_the_number_of_rays(device, scene, tolerance):
    world = World(device, scene)
    frames = Frames(world, wandering_poses(2, 2.5, 30.0))
    fls = narrow_fls(4, range_edge=np.linspace(0.42, 9.0, 512))
    energy = [
        formed_image(world, dataclasses.replace(fls, intervals=intervals).fan(device), frames).sum(axis=-1)
        for intervals in (16, 64, 400)
    ]
    np.testing.assert_allclose(energy[0], energy[2], rtol=tolerance)
    np.testing.assert_allclose(energy[1], energy[2], rtol=tolerance)


# --- A flat seabed in closed form ---


@pytest.mark.parametrize("preset", GEOMETRY)
def test_a_flat_seabed_is_its_closed_form_bin_by_bin(device, preset):
    altitude, tilt_deg = GEOMETRY[preset]
    fls = PRESETS[preset].fls
    world = World(device, flat_seabed(AHEAD))
    frames = Frames(world, pose((0, 0, altitude), math.radians(tilt_deg))[None])
    image = formed_image(world, fls.fan(device), frames)[0]
    expected = oracle.flat_seabed_image(
        fls.azimuth_edge, fls.half_elevation, fls.range_edge, altitude, math.radians(tilt_deg), SAND_REFLECTION
    )
    assert relative_error(image, expected) < 2e-3
    assert image.sum() == pytest.approx(expected.sum(), rel=1e-4)
    # The seabed goes on beyond the window: nothing of that ends up in the last bin.
    np.testing.assert_allclose(image[:, -1], expected[:, -1], rtol=0.01)


def test_what_lies_outside_of_the_window_is_dropped(device):
    altitude, tilt = 2.5, math.radians(30.0)
    world = World(device, flat_seabed(AHEAD))
    frames = Frames(world, pose((0, 0, altitude), tilt)[None])
    for start, stop in [(4.0, 4.2), (4.0, 5.0), (5.0, 5.5), (0.5, 1.0), (7.5, 8.0)]:
        fls = narrow_fls(8, range_edge=np.linspace(start, stop, 41))
        image = formed_image(world, fls.fan(device), frames)[0]
        expected = oracle.flat_seabed_image(
            fls.azimuth_edge, fls.half_elevation, fls.range_edge, altitude, tilt, SAND_REFLECTION
        )
        assert np.all(np.abs(image - expected) <= 5e-3 * expected.max()), (start, stop)


def test_bins_need_not_be_uniform(device):
    altitude, tilt = 2.5, math.radians(30.0)
    fls = narrow_fls(8, range_edge=np.geomspace(1.0, 6.5, 200))
    world = World(device, flat_seabed(AHEAD))
    image = formed_image(world, fls.fan(device), Frames(world, pose((0, 0, altitude), tilt)[None]))[0]
    expected = oracle.flat_seabed_image(
        fls.azimuth_edge, fls.half_elevation, fls.range_edge, altitude, tilt, SAND_REFLECTION
    )
    assert relative_error(image, expected) < 2e-3


# --- Forming against many rays ---

SCENES = {"brick": brick_on_flat, "wedges": wedges_on_flat, "rough": rough, "ball": ball_on_flat, "vase": vase_on_flat}


@pytest.mark.parametrize("preset", ["paper simulation", "paper field"])
@pytest.mark.parametrize("scene", SCENES)
def test_few_rays_form_the_image_of_many(device, scene, preset):
    world = World(device, SCENES[scene]())
    frames = Frames(world, wandering_poses(3, *GEOMETRY[preset]))
    fan = narrow_fls(16, preset).fan(device)
    reference = reference_image(world, fan, frames)
    assert relative_error(formed_image(world, fan, frames), reference) < 0.015


@pytest.mark.parametrize("scene", SCENES)
def test_few_rays_form_the_profile_of_many(device, scene):
    world = World(device, SCENES[scene]())
    frames = Frames(world, head_poses("paper simulation", 12))
    fan = PS().fan(device)
    reference = reference_image(world, fan, frames)
    assert relative_error(formed_image(world, fan, frames), reference) < 0.02


def test_conical_beams_are_formed_as_well(device):
    # Wide beams, cut into strips, far from the axis, where a cone and a fan part.
    world = World(device, box((3.0, 3.5, 1.5), SAND))
    frames = Frames(world, wandering_poses(2, 0.2, 10.0))
    fls = FLS(azimuth_edge=np.radians(np.linspace(15.0, 60.0, 16)), vertical_beamwidth_deg=60.0, cone=True)
    cones, fans = (dataclasses.replace(fls, cone=cone).fan(device) for cone in (True, False))
    reference = reference_image(world, cones, frames, 64, 1024)
    assert relative_error(formed_image(world, cones, frames), reference) < 0.015
    assert relative_error(formed_image(world, fans, frames), reference) > 0.1


def test_facets_far_smaller_than_a_cell_are_averaged(device):
    extent = Extent(x_min=2.0, x_max=7.0, y_min=-0.5, y_max=0.5)
    world = World(device, rough_seabed(extent, Roughness(spacing=0.01)))
    frames = Frames(world, wandering_poses(2, 3.5, 40.0) * [1, 0, 1, 1, 1, 1, 1])
    fan = narrow_fls(4).fan(device)
    assert relative_error(formed_image(world, fan, frames), reference_image(world, fan, frames)) < 0.015


def test_rods_thinner_than_a_beam_keep_their_echo(device):
    # Most of what is seen of these is met by no corner ray: without the guard half of the image is wrong.
    world = World(device, rods_on_flat())
    frames = Frames(world, wandering_poses(3, 1.8, 25.0))
    fan = narrow_fls(40, "paper field").fan(device)
    assert relative_error(formed_image(world, fan, frames), reference_image(world, fan, frames, 128, 128)) < 0.05


# --- Binning ---


def test_binned_hits_match_the_oracle(device):
    world = World(device, brick_on_flat(), wall(3.0))
    frames = Frames(world, wandering_poses(3, 2.5, 30.0), [0, 1, 0])
    fls = narrow_fls(4, gain_db=6.0)
    fan = fls.fan(device)
    width = np.diff(fls.azimuth_edge)[:, None]
    azimuth = (fls.azimuth_edge[:-1, None] + width * (np.arange(8) + 0.5) / 8).ravel()
    elevation = fls.half_elevation * (2 * (np.arange(500) + 0.5) / 500 - 1)
    distance, face, normal = cast(world, frames, azimuth, elevation, 0, float(fls.range_edge[-1]))
    counts = wp.zeros((3, 4, fls.bins), dtype=int, device=device)
    for _ in range(2):
        echo.bin_hits(
            fan,
            world.table,
            frames.pose,
            frames.scene,
            wp.array(azimuth, dtype=float, device=device),
            wp.array(elevation, dtype=float, device=device),
            distance,
            face,
            normal,
            1.0 / 8000,
            counts,
            device=device,
            threads=2,
        )
    rotation = frames.pose.numpy()[:, 3:]
    direction = oracle.beam_direction(azimuth[:, None], elevation, False)
    ray = np.stack([Rotation.from_quat(turn).apply(direction.reshape(-1, 3)) for turn in rotation])
    cosine = np.einsum("fri,fri->fr", ray, normal.numpy().reshape(3, -1, 3))
    impedance = world.impedance[world.first_face[[0, 1, 0]][:, None] + face.numpy().reshape(3, -1)]
    r = distance.numpy().reshape(3, -1)
    amplitude = oracle.echo_amplitude(fan.amplitude, impedance.astype(np.float64), WATER, r, cosine)
    expected = oracle.binned(fan.range_edge.numpy(), r.reshape(12, -1), amplitude.reshape(12, -1)).reshape(3, 4, -1)
    # Rounding leaves 0.3 counts per ray, of about 500 each.
    np.testing.assert_allclose(counts.numpy() / fan.fixed_point, 2 * expected / 8000, rtol=5e-3)


# --- Geometry that must not matter ---


def turned_inside_out(scene: Scene) -> Scene:
    return Scene(vertices=scene.vertices, faces=scene.faces[:, ::-1], impedance=scene.impedance)


def test_either_side_of_a_face_reflects_alike(device):
    poses = wandering_poses(2, 0.1, 10.0)
    fan = narrow_fls(4).fan(device)
    room = box((3.0, 2.5, 2.0), SAND)
    images = []
    for scene in (room, turned_inside_out(room)):
        world = World(device, scene)
        images.append(formed_image(world, fan, Frames(world, poses)))
    assert images[0].sum() > 0.0
    assert relative_error(images[0], images[1]) < 1e-3


def test_a_mesh_with_holes_is_formed(device):
    seabed = rough()
    # Nearly a third of the facets, each as small as a cell, are missing, and nothing lies behind.
    keep = np.random.default_rng(0).uniform(size=len(seabed.faces)) < 0.7
    world = World(device, Scene(vertices=seabed.vertices, faces=seabed.faces[keep], impedance=seabed.impedance[keep]))
    frames = Frames(world, wandering_poses(2, 3.5, 40.0))
    fan = narrow_fls(8).fan(device)
    assert relative_error(formed_image(world, fan, frames), reference_image(world, fan, frames)) < 0.05


@pytest.mark.parametrize("scene", [None, wall(9.0), wall(-2.0), wall(0.2), wall(1e-9)])
def test_nothing_in_the_window_is_a_dark_image(device, scene):
    world = World(device, scene)
    assert not formed_counts(world, narrow_fls(4).fan(device), Frames(world, ORIGIN[None])).any()


def test_beams_that_do_not_touch_have_columns_of_their_own(device):
    world = World(device, flat_seabed(AHEAD))
    frames = Frames(world, wandering_poses(2, 2.5, 30.0))
    touching = narrow_fls(4).fan(device)
    apart = narrow_fls(4).fan(device)
    border = touching.column_azimuth.numpy()
    apart.column_azimuth = wp.array(np.repeat(border, 2)[1:-1], dtype=float, device=device)
    apart.first_column = wp.array(np.arange(4) * 2, dtype=int, device=device)
    assert np.array_equal(formed_counts(world, touching, frames), formed_counts(world, apart, frames))


# --- Batches ---


@pytest.mark.parametrize("sonar", ["FLS", "PS"])
def test_a_batch_over_two_scenes_equals_each_frame_alone(device, sonar):
    fan: Fan = narrow_fls(8).fan(device) if sonar == "FLS" else PS().fan(device)
    scenes = rough(), brick_on_flat()
    poses = wandering_poses(5, 3.0, 35.0) if sonar == "FLS" else head_poses("paper field", 5)
    which = [0, 1, 1, 0, 1]
    world = World(device, *scenes)
    batch = formed_counts(world, fan, Frames(world, poses, which))
    assert np.all(batch[:3].sum(axis=(1, 2)) > 0)
    for threads in (2, 7):
        assert np.array_equal(batch, formed_counts(world, fan, Frames(world, poses, which), threads))
    for frame in range(5):
        alone = World(device, scenes[which[frame]])
        frames = Frames(alone, poses[frame : frame + 1], numbers=[frame])
        assert np.array_equal(batch[frame], formed_counts(alone, fan, frames)[0])


@pytest.mark.parametrize("sonar", ["FLS", "PS"])
def test_images_do_not_depend_on_the_number_of_lanes(device, sonar, monkeypatch):
    fan = narrow_fls(8).fan(device) if sonar == "FLS" else PS().fan(device)
    poses = wandering_poses(2, 3.0, 35.0) if sonar == "FLS" else head_poses("paper field", 2)
    world = World(device, brick_on_flat())
    images = []
    for lanes in (1, 5, 32):
        for module in (forming, echo):
            monkeypatch.setattr(module, "lanes", lambda _device, lanes=lanes: lanes)
        images.append(formed_counts(world, fan, Frames(world, poses)))
    assert images[0].any()
    assert np.array_equal(images[0], images[1])
    assert np.array_equal(images[0], images[2])


def test_a_captured_graph_forms_the_same_image(device):
    world = World(device, brick_on_flat())
    fan = narrow_fls(4).fan(device)
    frames = Frames(world, wandering_poses(2, 3.5, 40.0))
    expected = formed_counts(world, fan, frames)
    scratch = scratch_for(fan, 2, device)
    counts = wp.full(expected.shape, -1, dtype=int, device=device)
    arguments = [fan, world.table, frames.pose, frames.scene, frames.key, scratch, counts]
    with wp.ScopedCapture(device) as capture:
        echo.form_echoes(*arguments, device=device)
    assert np.all(counts.numpy() == -1)
    for _ in range(2):
        wp.capture_launch(capture.graph)
        assert np.array_equal(counts.numpy(), expected)


# --- Refusals ---


def test_wrong_arrays_are_refused_by_name(device):
    world = World(device, wall(3.0))
    frames = Frames(world, ORIGIN[None])
    fan = narrow_fls(4).fan(device)
    scratch = scratch_for(fan, 1, device)
    counts = wp.zeros((1, 4, 512), dtype=int, device=device)
    arguments = [fan, world.table, frames.pose, frames.scene, frames.key]
    with pytest.raises(ValueError, match=r"counts_out: expected shape \(1, 4, 512\), got \(1, 512, 4\)"):
        echo.form_echoes(*arguments, scratch, counts.reshape((1, 512, 4)), device=device)
    with pytest.raises(ValueError, match=r"scratch_out.corner: expected shape \(1, 5, 65\), got \(2, 5, 65\)"):
        echo.form_echoes(*arguments, scratch_for(fan, 2, device), counts, device=device)
    five = wp.zeros(5, dtype=float, device=device)
    hits = [wp.zeros((1, 5, 5), dtype=kind, device=device) for kind in (float, int, wp.vec3)]
    with pytest.raises(ValueError, match="azimuth: 5 columns, must be a multiple of the 4 beams"):
        echo.bin_hits(fan, world.table, frames.pose, frames.scene, five, five, *hits, 1.0, counts, device=device)
