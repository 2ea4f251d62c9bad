"""Echo amplitude (Eq. 36), and images of it formed from rays.

A bin holds the mean, over the beam's aperture, of the echo amplitude of the rays whose range falls in it. The aperture
is uniform in azimuth and in elevation angle: the cosine by which a solid angle shrinks towards the poles is left out,
as a beam pattern would be. So what a bin holds does not depend on how many rays it was formed from. Sums are integers
(``Fan.fixed_point`` counts per unit), bit-identical in any order and for any number of threads or lanes.

``bin_hits`` puts each ray whole into one bin: the plain way, right in the limit of many rays. ``form_echoes`` spreads
what lies between few rays in closed form (``forming``, ``deposits``) and needs a few hundred rays a beam where the
plain way needs tens of thousands.
"""

from typing import Any

import warp as wp

from sonarwarp_kernels.deposits import deposit_patch, deposit_strip
from sonarwarp_kernels.forming import (
    CELL_FLAGGED,
    CELL_SMOOTH,
    Scratch,
    cell_direction,
    read_cell,
    sample_cells,
)
from sonarwarp_kernels.geometry import beam_direction, bin_below
from sonarwarp_kernels.keys import STREAM_LATTICE, mix_key, uniform
from sonarwarp_kernels.launch import check_array, lanes, launch
from sonarwarp_kernels.raycast import NO_FACE
from sonarwarp_kernels.samples import forming_reach, reflection_magnitude, take_sample
from sonarwarp_kernels.specs import Fan, SceneTable

wp.set_module_options({"enable_backward": False})

# Rays of a flagged cell: a golden lattice, whose footprints are as those of a grid of this many a side.
LATTICE_RAYS = wp.constant(64)
_LATTICE_SIDE = wp.constant(8)
_GOLDEN = wp.constant(0.6180339887498949)

# A grazing footprint is no longer flat over its own length: half of one is no longer than this part of its range.
_LONGEST_FOOTPRINT = wp.constant(0.03)


@wp.func
def echo_amplitude(amplitude: float, reflection: float, distance: float, cosine: float) -> float:
    """Echo amplitude of a surface element (Eq. 36); ``amplitude`` is k I0, that of a full reflection at 1 m.

    ``reflection`` is (z - z0) / (z + z0), of either sign; ``cosine`` that of the angle between ray and normal, of
    either sign since a face reflects on both sides; ``distance`` in m.
    """
    return amplitude * wp.abs(reflection) * cosine * cosine / (distance * distance)


@wp.kernel
def write_smooth_kernel(
    first: int,
    fan: Fan,
    scratch: Scratch,
    lane_count: int,
    counts_out: wp.array3d(dtype=int),  # [frame, beam, bin]
):
    line, lane = wp.tid()
    line += first
    beams = fan.azimuth.shape[0]
    frame = line // beams
    beam = line - frame * beams
    unit = fan.amplitude * fan.fixed_point / float(fan.strips * fan.intervals)
    for strip in range(fan.strips):
        column = fan.first_column[beam] + strip
        for interval in range(lane, fan.intervals, lane_count):
            if scratch.state[frame, column, interval] == CELL_SMOOTH:
                cell = read_cell(scratch, frame, column, interval)
                deposit_strip(
                    fan, frame, beam, cell.profile, cell.next_profile, cell.low_fold, cell.high_fold, unit, counts_out
                )


@wp.kernel
def write_flagged_kernel(
    first: int,
    fan: Fan,
    scenes: SceneTable,
    world_from_sensor: wp.array(dtype=wp.transform),  # [frame]
    scene_index: wp.array(dtype=int),  # [frame]
    frame_key: wp.array(dtype=wp.uint64),  # [frame]
    scratch: Scratch,
    lane_count: int,
    counts_out: wp.array3d(dtype=int),  # [frame, beam, bin]
):
    line, lane = wp.tid()
    line += first
    beams = fan.azimuth.shape[0]
    frame = line // beams
    beam = line - frame * beams
    pose = world_from_sensor[frame]
    scene = scene_index[frame]
    unit = fan.amplitude * fan.fixed_point / float(fan.strips * fan.intervals * LATTICE_RAYS)
    for strip in range(fan.strips):
        column = fan.first_column[beam] + strip
        key = mix_key(mix_key(frame_key[frame], STREAM_LATTICE), column)
        flagged = scratch.latest[frame, column] >= CELL_FLAGGED
        for interval in range(fan.intervals):
            # All lanes share the rays of one cell: flagged cells are few and uneven.
            if flagged and scratch.state[frame, column, interval] >= CELL_FLAGGED:
                cell_key = mix_key(key, interval)
                shift_across = uniform(cell_key)
                shift_up = uniform(mix_key(cell_key, 1))
                foot = cell_direction(fan, column, interval, 0.0, 0.0)
                across = (cell_direction(fan, column, interval, 1.0, 0.0) - foot) / float(2 * _LATTICE_SIDE)
                up = (cell_direction(fan, column, interval, 0.0, 1.0) - foot) / float(2 * _LATTICE_SIDE)
                for ray in range(lane, LATTICE_RAYS, lane_count):
                    u = shift_across + (float(ray) + 0.5) / float(LATTICE_RAYS)
                    v = shift_up + float(ray) * _GOLDEN
                    direction = cell_direction(fan, column, interval, u - wp.floor(u), v - wp.floor(v))
                    sample = take_sample(scenes, scene, pose, direction, forming_reach(fan))
                    if sample.face != NO_FACE:
                        longest = _LONGEST_FOOTPRINT * sample.inverse
                        half_up = wp.min(wp.abs(wp.dot(sample.plane, up)), longest)
                        half_across = wp.min(wp.abs(wp.dot(sample.plane, across)), longest)
                        energy = sample.weight * unit
                        deposit_patch(fan, frame, beam, sample.inverse, half_up, half_across, energy, counts_out)


def form_echoes(
    fan: Fan,
    scenes: SceneTable,
    world_from_sensor: wp.array,
    scene_index: wp.array,
    frame_key: wp.array,
    scratch_out: Scratch,
    counts_out: wp.array,
    *,
    device: Any = None,
    threads: int = 1,
) -> None:
    """Form noise-free images of the echo amplitude.

    Args:
        fan: the sonar.
        scenes: meshes and impedances.
        world_from_sensor: poses, shape [frame]; of a profiling sonar those of its head.
        scene_index: scene of each frame, shape [frame].
        frame_key: keys of the frames (``keys.frame_keys``), shape [frame].
        scratch_out: arrays of ``forming.scratch_shapes``.
        counts_out: echo amplitude times ``fan.fixed_point``, overwritten, shape [frame, beam, bin].
        device: device of all arrays.
        threads: CPU threads; images are the same with any number.

    Raises:
        ValueError: an array of the wrong shape, type or device.
    """
    device = wp.get_device(device)
    frames, beams = world_from_sensor.shape[0], fan.azimuth.shape[0]
    check_array("counts_out", counts_out, (frames, beams, fan.range_edge.shape[0] - 1), wp.int32, device)
    sample_cells(fan, scenes, world_from_sensor, scene_index, frame_key, scratch_out, device=device, threads=threads)
    counts_out.zero_()
    lane_count = lanes(device)
    dim = (frames * beams, lane_count)
    launch(write_smooth_kernel, dim, [fan, scratch_out, lane_count], [counts_out], device, threads)
    inputs = [fan, scenes, world_from_sensor, scene_index, frame_key, scratch_out, lane_count]
    launch(write_flagged_kernel, dim, inputs, [counts_out], device, threads)


@wp.kernel
def bin_hits_kernel(
    first: int,
    fan: Fan,
    scenes: SceneTable,
    world_from_sensor: wp.array(dtype=wp.transform),  # [frame]
    scene_index: wp.array(dtype=int),  # [frame]
    azimuth: wp.array(dtype=float),  # [column]
    elevation: wp.array(dtype=float),  # [row]
    distance: wp.array3d(dtype=float),  # [frame, column, row]
    face: wp.array3d(dtype=int),  # [frame, column, row]
    normal: wp.array3d(dtype=wp.vec3),  # [frame, column, row]
    part: float,
    lane_count: int,
    counts_out: wp.array3d(dtype=int),  # [frame, beam, bin]
):
    line, lane = wp.tid()
    line += first
    beams = fan.azimuth.shape[0]
    frame = line // beams
    beam = line - frame * beams
    pose = world_from_sensor[frame]
    scene = scene_index[frame]
    bins = fan.range_edge.shape[0] - 1
    columns = azimuth.shape[0] // beams
    for column in range(beam * columns, (beam + 1) * columns):
        key = mix_key(wp.uint64(0), int(azimuth[column] * 1.0e9))
        for row in range(lane, elevation.shape[0], lane_count):
            index = bin_below(fan.range_edge, distance[frame, column, row])
            if index >= 0 and index < bins:
                reflection = reflection_magnitude(scenes, scene, face[frame, column, row])
                direction = wp.transform_vector(pose, beam_direction(azimuth[column], elevation[row], fan.cone))
                cosine = wp.dot(direction, normal[frame, column, row])
                echo = echo_amplitude(fan.amplitude, reflection, distance[frame, column, row], cosine)
                # Rounded up or down by the ray's direction: equal echoes all rounded one way would add up to a bias.
                dither = uniform(mix_key(key, int(elevation[row] * 1.0e9)))
                wp.atomic_add(counts_out, frame, beam, index, int(echo * fan.fixed_point * part + dither))


def bin_hits(
    fan: Fan,
    scenes: SceneTable,
    world_from_sensor: wp.array,
    scene_index: wp.array,
    azimuth: wp.array,
    elevation: wp.array,
    distance: wp.array,
    face: wp.array,
    normal: wp.array,
    part: float,
    counts_out: wp.array,
    *,
    device: Any = None,
    threads: int = 1,
) -> None:
    """Add the echoes of a ``raycast.cast_grid`` to images, each ray whole into the bin of its range.

    Args:
        fan: the sonar.
        scenes: impedances, by face.
        world_from_sensor: poses, shape [frame].
        scene_index: scene of each frame, shape [frame].
        azimuth: the grid's columns, equally many per beam and beam by beam [rad], shape [column].
        elevation: the grid's rows [rad], shape [row].
        distance: slant ranges [m], shape [frame, column, row].
        face: faces, shape [frame, column, row].
        normal: unit normals in the world frame, shape [frame, column, row].
        part: what a ray stands for: 1 / (rays of a beam), counted over all grids that are added up.
        counts_out: echo amplitude times ``fan.fixed_point``, added to, shape [frame, beam, bin].
        device: device of all arrays.
        threads: CPU threads; images are the same with any number.

    Raises:
        ValueError: an array of the wrong shape, type or device, or columns that do not divide among the beams.
    """
    device = wp.get_device(device)
    frames, beams = world_from_sensor.shape[0], fan.azimuth.shape[0]
    columns, rows = azimuth.shape[0], elevation.shape[0]
    if columns % beams:
        raise ValueError(f"azimuth: {columns} columns, must be a multiple of the {beams} beams")
    grid = (frames, columns, rows)
    check_array("world_from_sensor", world_from_sensor, (frames,), wp.transform, device)
    check_array("scene_index", scene_index, (frames,), wp.int32, device)
    check_array("azimuth", azimuth, (columns,), wp.float32, device)
    check_array("elevation", elevation, (rows,), wp.float32, device)
    check_array("distance", distance, grid, wp.float32, device)
    check_array("face", face, grid, wp.int32, device)
    check_array("normal", normal, grid, wp.vec3, device)
    check_array("counts_out", counts_out, (frames, beams, fan.range_edge.shape[0] - 1), wp.int32, device)
    lane_count = lanes(device)
    inputs = [fan, scenes, world_from_sensor, scene_index, azimuth, elevation, distance, face, normal, part, lane_count]
    launch(bin_hits_kernel, (frames * beams, lane_count), inputs, [counts_out], device, threads)
