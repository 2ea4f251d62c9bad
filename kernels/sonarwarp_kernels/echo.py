"""Echo amplitude (Eq. 36) and images of it per range bin.

A bin holds the mean, over the beam's aperture, of the echo amplitude of the rays whose range falls in it. The aperture
is uniform in azimuth and in elevation angle: the cosine by which a solid angle shrinks towards the poles is left out,
as a beam pattern of its own would be. So a bin does not depend on how many rays it was formed from. Sums are
integers (``Fan.fixed_point`` counts per unit), bit-identical for any order.
"""

from typing import Any

import warp as wp

from sonarwarp_kernels.forming import (
    CELL_FLAGGED,
    CELL_SMOOTH,
    Cell,
    Scratch,
    cell_direction,
    read_cell,
    sample_cells,
)
from sonarwarp_kernels.geometry import beam_direction, bin_below
from sonarwarp_kernels.keys import STREAM_LATTICE, mix_key, uniform
from sonarwarp_kernels.launch import check_array, lanes, launch
from sonarwarp_kernels.raycast import NO_FACE
from sonarwarp_kernels.samples import (
    Profile,
    forming_reach,
    profile_inverse,
    profile_weight,
    reflection_magnitude,
    take_sample,
)
from sonarwarp_kernels.specs import Fan, SceneTable

wp.set_module_options({"enable_backward": False})

# Rays of a flagged cell, a golden lattice whose footprints are 8 x 8 to a cell.
LATTICE_RAYS = wp.constant(64)
_LATTICE_SIDE = wp.constant(8)
_GOLDEN = wp.constant(0.6180339887498949)

# A grazing footprint is no longer flat over its own length: no footprint is longer than this part of its range.
_LONGEST_FOOTPRINT = wp.constant(0.03)

# Knots of a profile nearer than this part of a cell are one.
_SHORTEST_PIECE = wp.constant(0.02)


@wp.func
def echo_amplitude(amplitude: float, reflection: float, distance: float, cosine: float):
    """Echo amplitude of a surface element (Eq. 36): ``amplitude`` at 1 m, normal incidence and full reflection.

    ``reflection`` is (z - z0) / (z + z0), of either sign; ``cosine`` of the angle between ray and normal, of either
    sign, since a face reflects on both sides; ``distance`` in m.
    """
    return amplitude * wp.abs(reflection) * cosine * cosine / (distance * distance)


@wp.func
def trapezoid_below(x: float, wide: float, narrow: float):
    """Part below ``x`` of the sum of two independent uniform variables of half widths ``wide`` >= ``narrow``."""
    far = wp.abs(x)
    below = float(0.0)
    if far <= wide - narrow:
        return 0.5 + 0.5 * x / wide
    if far < wide + narrow:
        rest = wide + narrow - far
        below = rest * rest / (8.0 * wide * narrow)
    if x > 0.0:
        return 1.0 - below
    return below


@wp.func
def deposit(
    fan: Fan,
    frame: int,
    beam: int,
    centre: float,
    first_half: float,
    second_half: float,
    energy: float,
    counts_out: wp.array3d(dtype=int),
):
    """Spread ``energy`` s^4 over the bins that a linear patch covers; s is the inverse range.

    The patch's s is the sum of two uniform variables around ``centre`` with the given half widths [1/m]; ``energy`` is
    in counts m^4. What lies outside of the window is dropped.
    """
    bins = fan.range_edge.shape[0] - 1
    wide = wp.max(wp.max(first_half, second_half), 1.0e-7 * centre)
    narrow = wp.min(first_half, second_half)
    high = centre + wide + narrow
    low = wp.max(centre - wide - narrow, 1.0e-9)
    index = bin_below(fan.range_edge, 1.0 / high)
    above = float(1.0)
    if index < 0:
        index = int(0)
        high = 1.0 / fan.range_edge[0]
        above = trapezoid_below(high - centre, wide, narrow)
    while index < bins:
        edge = 1.0 / fan.range_edge[index + 1]
        below = float(0.0)
        if edge > low:
            below = trapezoid_below(edge - centre, wide, narrow)
        middle = 0.5 * (high + wp.max(edge, low))
        square = middle * middle
        part = (above - below) * energy * square * square
        wp.atomic_add(counts_out, frame, beam, index, int(part + 0.5))
        high = edge
        above = below
        index += 1
        if edge <= low:
            index = bins


@wp.func
def next_knot(profile: Profile, after: float, stop: float):
    """The first knot of a profile beyond ``after``, at most ``stop``."""
    if profile.lower > after:
        stop = wp.min(stop, profile.lower)
    if profile.upper > after:
        stop = wp.min(stop, profile.upper)
    return stop


@wp.func
def deposit_cell(fan: Fan, frame: int, beam: int, cell: Cell, unit: float, counts_out: wp.array3d(dtype=int)):
    """Write the surface between the two columns of a smooth cell, piece by piece from knot to knot."""
    start = float(0.0)
    near = cell.profile.foot
    far = cell.next_profile.foot
    while start < 1.0:
        after = start + _SHORTEST_PIECE
        stop = next_knot(cell.profile, after, next_knot(cell.next_profile, after, 1.0))
        if stop > 1.0 - _SHORTEST_PIECE:
            stop = 1.0
        near_stop = profile_inverse(cell.profile, stop)
        far_stop = profile_inverse(cell.next_profile, stop)
        centre = 0.25 * (near + near_stop + far + far_stop)
        half_up = 0.25 * wp.abs(near_stop + far_stop - near - far)
        half_across = 0.25 * wp.abs(far + far_stop - near - near_stop)
        middle = 0.5 * (start + stop)
        weight = 0.5 * (profile_weight(cell.profile, middle) + profile_weight(cell.next_profile, middle))
        deposit(fan, frame, beam, centre, half_up, half_across, weight * unit * (stop - start), counts_out)
        start = stop
        near = near_stop
        far = far_stop


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
                deposit_cell(fan, frame, beam, read_cell(scratch, frame, column, interval), unit, counts_out)


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
        for interval in range(fan.intervals):
            # All lanes share one cell's rays: flagged cells are few and uneven.
            if scratch.state[frame, column, interval] >= CELL_FLAGGED:
                cell_key = mix_key(key, interval)
                shift_across = uniform(cell_key)
                shift_up = uniform(mix_key(cell_key, 1))
                # Half a footprint along either side of the cell.
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
                        half_across = wp.min(wp.abs(wp.dot(sample.plane, across)), longest)
                        half_up = wp.min(wp.abs(wp.dot(sample.plane, up)), longest)
                        energy = sample.weight * unit
                        deposit(fan, frame, beam, sample.inverse, half_up, half_across, energy, counts_out)


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
    """Noise-free images of the echo amplitude, in integer counts.

    Args:
        fan: the sonar.
        scenes: meshes and impedances.
        world_from_sensor: poses, shape [frame].
        scene_index: scene of each frame, shape [frame].
        frame_key: keys of the frames (``keys.frame_keys``), shape [frame].
        scratch_out: arrays of ``forming.scratch_shapes``.
        counts_out: echo amplitude times ``fan.fixed_point``, overwritten, shape [frame, beam, bin].
    """
    device = wp.get_device(device)
    frames, beams = world_from_sensor.shape[0], fan.azimuth.shape[0]
    check_array("counts_out", counts_out, (frames, beams, fan.range_edge.shape[0] - 1), wp.int32, device)
    sample_cells(fan, scenes, world_from_sensor, scene_index, frame_key, scratch_out, device=device, threads=threads)
    counts_out.zero_()
    lane_count = lanes(device)
    dim = (frames * beams, lane_count)
    launch(write_smooth_kernel, dim, [fan, scratch_out, lane_count], [counts_out], device, threads)
    posed = [fan, scenes, world_from_sensor, scene_index, frame_key, scratch_out, lane_count]
    launch(write_flagged_kernel, dim, posed, [counts_out], device, threads)


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
    per_beam = azimuth.shape[0] // beams
    rows = elevation.shape[0]
    bins = fan.range_edge.shape[0] - 1
    for ray in range(lane, per_beam * rows, lane_count):
        column = beam * per_beam + ray // rows
        row = ray % rows
        if face[frame, column, row] != NO_FACE:
            reflection = reflection_magnitude(scenes, scene_index[frame], face[frame, column, row])
            direction = wp.transform_vector(pose, beam_direction(azimuth[column], elevation[row], fan.cone))
            cosine = wp.dot(direction, normal[frame, column, row])
            index = bin_below(fan.range_edge, distance[frame, column, row])
            if index >= 0 and index < bins:
                echo = echo_amplitude(fan.amplitude, reflection, distance[frame, column, row], cosine)
                # Rounded by a golden sequence: equal echoes would all be rounded the same way.
                dither = float(ray) * _GOLDEN
                dither -= wp.floor(dither)
                count = wp.floor(echo * fan.fixed_point * part + dither)
                wp.atomic_add(counts_out, frame, beam, index, int(count))


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
        azimuth: shape [column], rad; an equal number of columns per beam, the beams in order.
        elevation: shape [row], rad.
        distance: slant ranges [m], shape [frame, column, row].
        face: faces, shape [frame, column, row].
        normal: unit normals in the world frame, shape [frame, column, row].
        part: what one ray stands for: 1 / (rays of a beam), over all grids that are added up.
        counts_out: echo amplitude times ``fan.fixed_point``, added to, shape [frame, beam, bin].
    """
    device = wp.get_device(device)
    frames, beams = world_from_sensor.shape[0], fan.azimuth.shape[0]
    columns, rows = azimuth.shape[0], elevation.shape[0]
    if columns % beams:
        raise ValueError(f"azimuth: expected a multiple of {beams} columns, got {columns}")
    check_array("world_from_sensor", world_from_sensor, (frames,), wp.transform, device)
    check_array("scene_index", scene_index, (frames,), wp.int32, device)
    check_array("azimuth", azimuth, (columns,), wp.float32, device)
    check_array("elevation", elevation, (rows,), wp.float32, device)
    check_array("distance", distance, (frames, columns, rows), wp.float32, device)
    check_array("face", face, (frames, columns, rows), wp.int32, device)
    check_array("normal", normal, (frames, columns, rows), wp.vec3, device)
    check_array("counts_out", counts_out, (frames, beams, fan.range_edge.shape[0] - 1), wp.int32, device)
    lane_count = lanes(device)
    inputs = [fan, scenes, world_from_sensor, scene_index, azimuth, elevation, distance, face, normal, part, lane_count]
    launch(bin_hits_kernel, (frames * beams, lane_count), inputs, [counts_out], device, threads)
