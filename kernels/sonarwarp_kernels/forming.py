"""Where an image needs few rays and where many: corner rays, and the state of every cell between them.

A cell is what one strip of a beam covers in one interval of elevation. Its four corner rays are shared with its
neighbours. Where what they saw agrees and keyed rays inside see nothing else, the cell is smooth and ``echo`` writes it
in closed form. Elsewhere, such as across an object's outline, it is flagged and ``echo`` samples it densely.
"""

from typing import Any

import warp as wp

from sonarwarp_kernels.geometry import beam_direction
from sonarwarp_kernels.keys import STREAM_GUARD, STREAM_PROBE, mix_key, uniform
from sonarwarp_kernels.launch import check_array, lanes, launch
from sonarwarp_kernels.raycast import NO_FACE
from sonarwarp_kernels.samples import (
    _RANGE_BINS,
    _RANGE_PART,
    Profile,
    Sample,
    bin_width,
    column_profile,
    faces_join,
    fold_profile,
    row_fold,
    follow_face,
    forming_reach,
    profile_inverse,
    samples_agree,
    take_sample,
)
from sonarwarp_kernels.specs import Fan, SceneTable

wp.set_module_options({"enable_backward": False})

CELL_EMPTY = wp.constant(0)
CELL_SMOOTH = wp.constant(1)
CELL_FLAGGED = wp.constant(2)
"""A pass of the guard that finds a cell rough gives it the next higher state; all from here on are flagged."""

# A cell beside a flagged one gets this many test rays, in this many passes: without them rods of 1 cm cost 25 % error.
GUARD_RAYS = wp.constant(8)
GUARD_PASSES = 8
PROBE_ALL = wp.constant(False)


_FOLD_SLANT = wp.constant(0.5)

@wp.struct
class Scratch:
    """Caller-owned arrays between the kernels of one image; ``scratch_shapes`` gives their shapes."""

    corner: wp.array3d(dtype=Sample)  # [frame, column, row] row between intervals
    state: wp.array3d(dtype=int)  # [frame, beam, cell] cell = strip * intervals + interval


@wp.struct
class Cell:
    """Corner samples of a cell, those that met nothing replaced, and the profiles of its two columns."""

    a: Sample  # lower azimuth, lower elevation
    b: Sample  # lower azimuth, upper elevation
    c: Sample  # upper azimuth, lower elevation
    d: Sample  # upper azimuth, upper elevation
    left: Profile
    right: Profile
    middle: Profile
    fold: float


@wp.func
def elevation_step(fan: Fan):
    """Height of a cell [rad]."""
    return (fan.elevation_max - fan.elevation_min) / float(fan.intervals)


@wp.func
def cell_direction(fan: Fan, beam: int, cell: int, u: float, v: float):
    """Direction inside a cell: ``u`` along azimuth and ``v`` along elevation, both in 0-1."""
    strip = cell // fan.intervals
    column = fan.first_column[beam] + strip
    lower = fan.column_azimuth[column]
    upper = fan.column_azimuth[column + 1]
    elevation = fan.elevation_min + elevation_step(fan) * (float(cell - strip * fan.intervals) + v)
    return beam_direction(lower + (upper - lower) * u, elevation, fan.cone)


@wp.func
def lend(missing: Sample, beside: Sample, across: Sample, opposite: Sample):
    """A corner that met nothing goes on with the plane of a neighbour that foretold so."""
    lent = beside
    if lent.face == NO_FACE:
        lent = across
    if lent.face == NO_FACE:
        lent = opposite
    lent.inverse = wp.max(wp.dot(lent.plane, missing.direction), 1.0e-6)
    lent.direction = missing.direction
    return lent


@wp.func
def fold_of(a: Sample, b: Sample, c: Sample, d: Sample, fan: Fan):
    """Where a fold runs up a cell, 0-1 from its left: 1 for none, negative where the columns tell of two surfaces."""
    if samples_agree(a, c, fan) and samples_agree(b, d, fan):
        return 1.0
    foot = row_fold(a, c, fan)
    top = row_fold(b, d, fan)
    if foot < 0.0 or top < 0.0 or wp.abs(foot - top) > _FOLD_SLANT:
        return -1.0
    return 0.5 * (foot + top)


@wp.func
def read_cell(fan: Fan, scratch: Scratch, frame: int, beam: int, index: int):
    """A cell's corners and profiles; at least one corner met something."""
    strip = index // fan.intervals
    column = fan.first_column[beam] + strip
    row = index - strip * fan.intervals
    cell = Cell()
    a = scratch.corner[frame, column, row]
    b = scratch.corner[frame, column, row + 1]
    c = scratch.corner[frame, column + 1, row]
    d = scratch.corner[frame, column + 1, row + 1]
    cell.a = a
    cell.b = b
    cell.c = c
    cell.d = d
    if a.face == NO_FACE:
        cell.a = lend(a, b, c, d)
    if b.face == NO_FACE:
        cell.b = lend(b, a, d, c)
    if c.face == NO_FACE:
        cell.c = lend(c, d, a, b)
    if d.face == NO_FACE:
        cell.d = lend(d, c, b, a)
    cell.left = column_profile(cell.a, cell.b)
    cell.right = column_profile(cell.c, cell.d)
    cell.fold = fold_of(cell.a, cell.b, cell.c, cell.d, fan)
    if cell.fold < 1.0:
        low_across = wp.dot(cell.a.plane, cell.c.direction) - cell.a.inverse
        high_across = wp.dot(cell.b.plane, cell.d.direction) - cell.b.inverse
        cell.middle = fold_profile(cell.a, cell.b, cell.left, cell.right, cell.fold, low_across, high_across)
    return cell


@wp.func
def corners_agree(fan: Fan, scratch: Scratch, frame: int, beam: int, index: int):
    """Whether a cell's four corners tell of one surface, smooth along azimuth and at most folded along elevation."""
    strip = index // fan.intervals
    column = fan.first_column[beam] + strip
    row = index - strip * fan.intervals
    a = scratch.corner[frame, column, row]
    b = scratch.corner[frame, column, row + 1]
    c = scratch.corner[frame, column + 1, row]
    d = scratch.corner[frame, column + 1, row + 1]
    if a.face == b.face and a.face == c.face and a.face == d.face:
        return True
    if fold_of(a, b, c, d, fan) < 0.0:
        return False
    if not samples_agree(a, b, fan):
        if not faces_join(a, b, fan):
            return False
    if not samples_agree(c, d, fan):
        if not faces_join(c, d, fan):
            return False
    return True


@wp.func
def foretells(fan: Fan, scratch: Scratch, frame: int, beam: int, index: int, test: Sample, u: float, v: float):
    """Whether what a ray inside a cell met is what the cell's corners say."""
    strip = index // fan.intervals
    column = fan.first_column[beam] + strip
    row = index - strip * fan.intervals
    a = scratch.corner[frame, column, row]
    b = scratch.corner[frame, column, row + 1]
    c = scratch.corner[frame, column + 1, row]
    d = scratch.corner[frame, column + 1, row + 1]
    known = test.face == a.face or test.face == b.face or test.face == c.face or test.face == d.face
    if known and a.face == b.face and a.face == c.face and a.face == d.face:
        return True
    if a.face == NO_FACE and b.face == NO_FACE and c.face == NO_FACE and d.face == NO_FACE:
        return False
    cell = read_cell(fan, scratch, frame, beam, index)
    foretold = float(0.0)
    if cell.fold >= 1.0:
        foretold = profile_inverse(cell.left, v) * (1.0 - u) + profile_inverse(cell.right, v) * u
    elif u < cell.fold:
        part = u / cell.fold
        foretold = profile_inverse(cell.left, v) * (1.0 - part) + profile_inverse(cell.middle, v) * part
    else:
        part = (1.0 - u) / (1.0 - cell.fold)
        foretold = profile_inverse(cell.right, v) * (1.0 - part) + profile_inverse(cell.middle, v) * part
    tolerance = _RANGE_BINS * bin_width(fan)
    if test.face == NO_FACE:
        return foretold * (forming_reach(fan) - tolerance) < 1.0
    low = wp.min(wp.min(cell.a.inverse, cell.b.inverse), wp.min(cell.c.inverse, cell.d.inverse))
    high = wp.max(wp.max(cell.a.inverse, cell.b.inverse), wp.max(cell.c.inverse, cell.d.inverse))
    allowed = wp.max(tolerance * test.inverse * test.inverse, _RANGE_PART * (high - low))
    if wp.abs(foretold - test.inverse) > allowed:
        return False
    if known:
        return True
    if v < 0.5:
        return samples_agree(test, cell.a, fan) and samples_agree(test, cell.c, fan)
    return samples_agree(test, cell.b, fan) and samples_agree(test, cell.d, fan)


@wp.kernel
def cast_corners_kernel(
    first: int,
    fan: Fan,
    scenes: SceneTable,
    world_from_sensor: wp.array(dtype=wp.transform),  # [frame]
    scene_index: wp.array(dtype=int),  # [frame]
    lane_count: int,
    scratch_out: Scratch,
):
    line, lane = wp.tid()
    line += first
    columns = fan.column_azimuth.shape[0]
    frame = line // columns
    column = line - frame * columns
    pose = world_from_sensor[frame]
    scene = scene_index[frame]
    azimuth = fan.column_azimuth[column]
    step = elevation_step(fan)
    strip = wp.min(column, columns - 2)
    width = fan.column_azimuth[strip + 1] - fan.column_azimuth[strip]
    for row in range(lane, fan.intervals + 1, lane_count):
        elevation = fan.elevation_min + step * float(row)
        direction = beam_direction(azimuth, elevation, fan.cone)
        sample = take_sample(scenes, scene, pose, direction, forming_reach(fan))
        if sample.face != NO_FACE:
            above = beam_direction(azimuth, elevation + step, fan.cone)
            sample = follow_face(scenes, scene, pose, sample, above, step, width * wp.where(fan.cone!=0, wp.cos(azimuth), wp.cos(elevation)))
        scratch_out.corner[frame, column, row] = sample


@wp.kernel
def classify_cells_kernel(
    first: int,
    fan: Fan,
    scenes: SceneTable,
    world_from_sensor: wp.array(dtype=wp.transform),  # [frame]
    scene_index: wp.array(dtype=int),  # [frame]
    frame_key: wp.array(dtype=wp.uint64),  # [frame]
    lane_count: int,
    scratch_out: Scratch,
):
    line, lane = wp.tid()
    line += first
    beams = fan.azimuth.shape[0]
    frame = line // beams
    beam = line - frame * beams
    key = mix_key(mix_key(frame_key[frame], STREAM_PROBE), beam)
    for index in range(lane, fan.strips * fan.intervals, lane_count):
        strip = index // fan.intervals
        state = int(CELL_FLAGGED)
        if corners_agree(fan, scratch_out, frame, beam, index):
            column = fan.first_column[beam] + strip
            row = index - strip * fan.intervals
            met = scratch_out.corner[frame, column, row].face != NO_FACE
            met = met or scratch_out.corner[frame, column + 1, row].face != NO_FACE
            met = met or scratch_out.corner[frame, column, row + 1].face != NO_FACE
            met = met or scratch_out.corner[frame, column + 1, row + 1].face != NO_FACE
            state = wp.where(met, CELL_SMOOTH, CELL_EMPTY)
            pair_key = mix_key(key, index // 2)
            if PROBE_ALL or (index & 1) == int(pair_key & wp.uint64(1)):
                cell_key = mix_key(key, index)
                u = uniform(cell_key)
                v = uniform(mix_key(cell_key, 1))
                direction = cell_direction(fan, beam, index, u, v)
                probe = take_sample(scenes, scene_index[frame], world_from_sensor[frame], direction, forming_reach(fan))
                if not foretells(fan, scratch_out, frame, beam, index, probe, u, v):
                    state = CELL_FLAGGED
        scratch_out.state[frame, beam, index] = state


@wp.func
def has_state(fan: Fan, scratch: Scratch, frame: int, beam: int, strip: int, interval: int, state: int):
    """Whether a cell, perhaps of the next beam or outside of the fan, has the given state."""
    if strip < 0:
        beam -= 1
        strip += fan.strips
    if strip >= fan.strips:
        beam += 1
        strip -= fan.strips
    if beam < 0 or beam >= fan.azimuth.shape[0] or interval < 0 or interval >= fan.intervals:
        return False
    return scratch.state[frame, beam, strip * fan.intervals + interval] == state


@wp.kernel
def guard_cells_kernel(
    first: int,
    fan: Fan,
    scenes: SceneTable,
    world_from_sensor: wp.array(dtype=wp.transform),  # [frame]
    scene_index: wp.array(dtype=int),  # [frame]
    frame_key: wp.array(dtype=wp.uint64),  # [frame]
    found: int,
    lane_count: int,
    scratch_out: Scratch,
):
    line, lane = wp.tid()
    line += first
    beams = fan.azimuth.shape[0]
    frame = line // beams
    beam = line - frame * beams
    key = mix_key(mix_key(mix_key(frame_key[frame], STREAM_GUARD), beam), found)
    for index in range(lane, fan.strips * fan.intervals, lane_count):
        strip = index // fan.intervals
        interval = index - strip * fan.intervals
        if scratch_out.state[frame, beam, index] < CELL_FLAGGED:
            beside = (
                has_state(fan, scratch_out, frame, beam, strip - 1, interval, found)
                or has_state(fan, scratch_out, frame, beam, strip + 1, interval, found)
                or has_state(fan, scratch_out, frame, beam, strip, interval - 1, found)
                or has_state(fan, scratch_out, frame, beam, strip, interval + 1, found)
            )
            if beside:
                cell_key = mix_key(key, index)
                for ray in range(GUARD_RAYS):
                    u = (float(ray) + uniform(mix_key(cell_key, 2 * ray))) / float(GUARD_RAYS)
                    v = uniform(mix_key(cell_key, 2 * ray + 1))
                    direction = cell_direction(fan, beam, index, u, v)
                    test = take_sample(
                        scenes, scene_index[frame], world_from_sensor[frame], direction, forming_reach(fan)
                    )
                    if not foretells(fan, scratch_out, frame, beam, index, test, u, v):
                        scratch_out.state[frame, beam, index] = found + 1
                        break


def scratch_shapes(fan: Fan, frames: int) -> dict[str, tuple[tuple[int, int, int], Any]]:
    """Shape and Warp type of each array of ``Scratch`` for ``frames`` frames."""
    return {
        "corner": ((frames, fan.column_azimuth.shape[0], fan.intervals + 1), Sample),
        "state": ((frames, fan.azimuth.shape[0], fan.strips * fan.intervals), wp.int32),
    }


def sample_cells(
    fan: Fan,
    scenes: SceneTable,
    world_from_sensor: wp.array,
    scene_index: wp.array,
    frame_key: wp.array,
    scratch_out: Scratch,
    *,
    device: Any = None,
    threads: int = 1,
) -> None:
    """Cast the corner rays and give every cell its state.

    Args:
        fan: the sonar.
        scenes: meshes and impedances.
        world_from_sensor: poses, shape [frame].
        scene_index: scene of each frame, shape [frame].
        frame_key: keys of the frames (``keys.frame_keys``), shape [frame].
        scratch_out: arrays of ``scratch_shapes``.
    """
    device = wp.get_device(device)
    frames = world_from_sensor.shape[0]
    check_array("world_from_sensor", world_from_sensor, (frames,), wp.transform, device)
    check_array("scene_index", scene_index, (frames,), wp.int32, device)
    check_array("frame_key", frame_key, (frames,), wp.uint64, device)
    for name, (shape, dtype) in scratch_shapes(fan, frames).items():
        check_array(f"scratch_out.{name}", getattr(scratch_out, name), shape, dtype, device)
    lane_count = lanes(device)
    posed = [fan, scenes, world_from_sensor, scene_index]
    columns = (frames * fan.column_azimuth.shape[0], lane_count)
    rows = (frames * fan.azimuth.shape[0], lane_count)
    launch(cast_corners_kernel, columns, [*posed, lane_count], [scratch_out], device, threads)
    launch(classify_cells_kernel, rows, [*posed, frame_key, lane_count], [scratch_out], device, threads)
    for guard in range(GUARD_PASSES):
        inputs = [*posed, frame_key, int(CELL_FLAGGED) + guard, lane_count]
        launch(guard_cells_kernel, rows, inputs, [scratch_out], device, threads)
