"""Repeated hits of one place: the surest of them stays, and says how many repeat it.

Frames a few millimetres apart meet one edge again and again. Of all contacts of a trajectory in one cube the surest
stays, whose place is known to the least length of its arc; of equals the first. It stays a measurement: range,
azimuth, elevation and its interval fit the position, as those of a mean would not.

Cubes are found through a hash table with open addressing, a slot per cube, that holds the surest of the cube's contacts
met so far. Which slot a cube takes depends on the order of contacts; what its slot holds in the end does not.
"""

from typing import Any

import warp as wp

from sonarwarp_kernels.crowd import cube_of
from sonarwarp_kernels.estimate import QUALITY_NONE
from sonarwarp_kernels.keys import mix_key
from sonarwarp_kernels.launch import check_array, launch

wp.set_module_options({"enable_backward": False})

NO_CONTACT = wp.constant(-1)
"""Content of a slot that no cube has taken; a contact is its frame times the beams and its beam."""

SLOTS = 2
"""Slots of the table per contact: at most half full, a cube is found within two slots on average."""


@wp.func
def world_cube(spacing: float, point: wp.vec3) -> wp.vec3i:
    """Indices of the cube that a point lies in, from the world's origin: however far a run's box of cells reaches."""
    return cube_of(wp.vec3(0.0, 0.0, 0.0), spacing, point)


@wp.func
def first_slot(owner: int, cube: wp.vec3i, slots: int) -> int:
    """Where in a table of ``slots`` the search for a trajectory's cube begins."""
    key = mix_key(mix_key(mix_key(mix_key(wp.uint64(0), owner), cube[0]), cube[1]), cube[2])
    return int(key % wp.uint64(slots))


@wp.func
def lies_in(
    trajectory: wp.array(dtype=int),
    point: wp.array2d(dtype=wp.vec3),
    spacing: float,
    contact: int,
    owner: int,
    cube: wp.vec3i,
) -> bool:
    """Whether a contact lies in a trajectory's cube."""
    frame = contact // point.shape[1]
    beam = contact % point.shape[1]
    return trajectory[frame] == owner and world_cube(spacing, point[frame, beam]) == cube


@wp.func
def is_surer(
    critical_range: wp.array2d(dtype=float), elevation_deviation: wp.array2d(dtype=float), contact: int, other: int
) -> bool:
    """Whether a contact's place is known to less of its arc than another's; of equals the one of lower number."""
    beams = critical_range.shape[1]
    frame = contact // beams
    beam = contact % beams
    length = critical_range[frame, beam] * elevation_deviation[frame, beam]
    frame = other // beams
    beam = other % beams
    other_length = critical_range[frame, beam] * elevation_deviation[frame, beam]
    return length < other_length or (length == other_length and contact < other)


@wp.func
def surest_in_cube(
    trajectory: wp.array(dtype=int),
    point: wp.array2d(dtype=wp.vec3),
    surest: wp.array(dtype=int),
    spacing: float,
    owner: int,
    cube: wp.vec3i,
) -> int:
    """The contact that stays of a trajectory's cube; ``NO_CONTACT`` where the cube has none."""
    slots = surest.shape[0]
    slot = first_slot(owner, cube, slots)
    # In a table without a free slot, which was not filled with NO_CONTACT, the search ends as well.
    for _probe in range(slots):
        held = surest[slot]
        if held == NO_CONTACT or lies_in(trajectory, point, spacing, held, owner, cube):
            return held
        slot = (slot + 1) % slots
    return NO_CONTACT


@wp.kernel
def find_surest_kernel(
    first: int,
    trajectory: wp.array(dtype=int),  # [frame]
    quality: wp.array2d(dtype=int),  # [frame, beam]
    point: wp.array2d(dtype=wp.vec3),  # [frame, beam]
    critical_range: wp.array2d(dtype=float),  # [frame, beam]
    elevation_deviation: wp.array2d(dtype=float),  # [frame, beam]
    spacing: float,
    surest_out: wp.array(dtype=int),  # [slot]
):
    index, beam = wp.tid()
    frame = first + index
    if quality[frame, beam] == QUALITY_NONE:
        return
    slots = surest_out.shape[0]
    contact = frame * quality.shape[1] + beam
    owner = trajectory[frame]
    cube = world_cube(spacing, point[frame, beam])
    slot = first_slot(owner, cube, slots)
    for _probe in range(slots):
        held = wp.atomic_cas(surest_out, slot, NO_CONTACT, contact)
        if held == NO_CONTACT:
            return
        if lies_in(trajectory, point, spacing, held, owner, cube):
            while is_surer(critical_range, elevation_deviation, contact, held):
                seen = wp.atomic_cas(surest_out, slot, held, contact)
                if seen == held:
                    return
                # Another contact of the cube came between: now that one is to be surpassed.
                held = seen
            return
        slot = (slot + 1) % slots


def find_surest(
    trajectory: wp.array,
    quality: wp.array,
    point: wp.array,
    critical_range: wp.array,
    elevation_deviation: wp.array,
    spacing: float,
    surest_out: wp.array,
    *,
    device: Any = None,
) -> None:
    """Find the surest contact of every cube; on one CPU thread, for contacts share slots.

    Args:
        trajectory: owner of each frame, shape [frame].
        quality: ``QUALITY_NONE`` where there is no contact, int32, shape [frame, beam].
        point: world [m], up to 2^31 cubes from its origin, shape [frame, beam].
        critical_range: [m], shape [frame, beam].
        elevation_deviation: standard deviation [rad], shape [frame, beam].
        spacing: edge of the cubes [m].
        surest_out: table of the cubes' contacts, filled with ``NO_CONTACT`` beforehand, int32, shape [slot] with at
            least ``SLOTS`` times as many slots as there are frames and beams.
        device: device of all arrays.

    Raises:
        ValueError: an array of the wrong shape, type or device, a table too small, or a spacing that is not positive.
    """
    device = wp.get_device(device)
    shape = _check(trajectory, "quality", quality, point, spacing, "surest_out", surest_out, device)
    check_array("critical_range", critical_range, shape, wp.float32, device)
    check_array("elevation_deviation", elevation_deviation, shape, wp.float32, device)
    inputs = [trajectory, quality, point, critical_range, elevation_deviation, spacing]
    launch(find_surest_kernel, shape, inputs, [surest_out], device)


@wp.kernel
def drop_repeats_kernel(
    first: int,
    trajectory: wp.array(dtype=int),  # [frame]
    point: wp.array2d(dtype=wp.vec3),  # [frame, beam]
    surest: wp.array(dtype=int),  # [slot]
    spacing: float,
    hits_out: wp.array2d(dtype=int),  # [frame, beam]
    quality_out: wp.array2d(dtype=int),  # [frame, beam]
):
    index, beam = wp.tid()
    frame = first + index
    if quality_out[frame, beam] == QUALITY_NONE:
        return
    beams = quality_out.shape[1]
    owner = trajectory[frame]
    cube = world_cube(spacing, point[frame, beam])
    stays = surest_in_cube(trajectory, point, surest, spacing, owner, cube)
    if stays != NO_CONTACT and stays != frame * beams + beam:
        quality_out[frame, beam] = QUALITY_NONE
        wp.atomic_add(hits_out, stays // beams, stays % beams, 1)


def drop_repeats(
    trajectory: wp.array,
    point: wp.array,
    surest: wp.array,
    spacing: float,
    hits_out: wp.array,
    quality_out: wp.array,
    *,
    device: Any = None,
) -> None:
    """Take back all contacts but the surest of every cube; on one CPU thread, for they are counted together.

    Args:
        trajectory: owner of each frame, shape [frame].
        point: world [m], shape [frame, beam].
        surest: what :func:`find_surest` found of the same contacts, shape [slot]; others stay.
        spacing: edge of the cubes [m], the same.
        hits_out: added to: one for each contact taken back, at the one that stays; of contacts that stand for
            themselves so far, 1 beforehand; int32, shape [frame, beam].
        quality_out: becomes ``QUALITY_NONE`` where a surer contact stays, int32, shape [frame, beam].
        device: device of all arrays.

    Raises:
        ValueError: an array of the wrong shape, type or device, a table too small, or a spacing that is not positive.
    """
    device = wp.get_device(device)
    shape = _check(trajectory, "quality_out", quality_out, point, spacing, "surest", surest, device)
    check_array("hits_out", hits_out, shape, wp.int32, device)
    inputs = [trajectory, point, surest, spacing]
    launch(drop_repeats_kernel, shape, inputs, [hits_out, quality_out], device)


def _check(
    trajectory: wp.array,
    quality_name: str,
    quality: wp.array,
    point: wp.array,
    spacing: float,
    surest_name: str,
    surest: wp.array,
    device: Any,
) -> tuple[int, int]:
    if not spacing > 0.0:
        raise ValueError(f"spacing: must be above 0, got {spacing}")
    check_array("trajectory", trajectory, (None,), wp.int32, device)
    check_array(quality_name, quality, (trajectory.shape[0], None), wp.int32, device)
    check_array("point", point, quality.shape, wp.vec3, device)
    check_array(surest_name, surest, (None,), wp.int32, device)
    least = SLOTS * quality.shape[0] * quality.shape[1]
    if surest.shape[0] < least:
        raise ValueError(f"{surest_name}: {surest.shape[0]} slots, must be at least {least}")
    return quality.shape
