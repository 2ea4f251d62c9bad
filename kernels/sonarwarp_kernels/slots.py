"""A round's slots: which frames and pings of a batch the launches of this round work on.

Which round it is lives on the device, so that a captured graph of one round can be replayed until the batch is done.
Empty slots carry index -1 and the scene of index ``scenes`` (its mesh id is 0), which every kernel treats as nothing.
"""

from typing import Any

import warp as wp

from sonarwarp_kernels.launch import check_array, launch

wp.set_module_options({"enable_backward": False})

EMPTY = wp.constant(-1)
"""Index that marks an empty slot."""


@wp.kernel
def load_slots_kernel(
    first: int,
    table: wp.array2d(dtype=int),  # [round, slot]
    round_index: wp.array(dtype=int),  # [1]
    slot_out: wp.array(dtype=int),  # [slot]
):
    slot = first + wp.tid()
    current = round_index[0]
    index = int(EMPTY)
    if current < table.shape[0]:
        index = table[current, slot]
    slot_out[slot] = index


def load_slots(
    table: wp.array, round_index: wp.array, slot_out: wp.array, *, device: Any = None, threads: int = 1
) -> None:
    """Read one row of a table of indices; all empty once the table has ended.

    Args:
        table: index of the frame or ping in each slot, ``EMPTY`` for none, shape [round, slot].
        round_index: current round, shape [1].
        slot_out: shape [slot].
    """
    device = wp.get_device(device)
    check_array("table", table, (None, slot_out.shape[0]), wp.int32, device)
    check_array("round_index", round_index, (1,), wp.int32, device)
    check_array("slot_out", slot_out, (None,), wp.int32, device)
    launch(load_slots_kernel, (slot_out.shape[0],), [table, round_index], [slot_out], device, threads)


@wp.kernel
def next_round_kernel(
    first: int,
    round_index_out: wp.array(dtype=int),  # [1]
):
    round_index_out[first + wp.tid()] += 1


def next_round(round_index_out: wp.array, *, device: Any = None) -> None:
    """Advance the round, shape [1]."""
    check_array("round_index_out", round_index_out, (1,), wp.int32, wp.get_device(device))
    launch(next_round_kernel, (1,), [], [round_index_out], device)


@wp.kernel
def load_poses_kernel(
    first: int,
    slot_index: wp.array(dtype=int),  # [slot]
    pose: wp.array(dtype=wp.transform),  # [frame]
    key: wp.array(dtype=wp.uint64),  # [frame]
    scene: wp.array(dtype=int),  # [frame]
    empty_scene: int,
    pose_out: wp.array(dtype=wp.transform),  # [slot]
    key_out: wp.array(dtype=wp.uint64),  # [slot]
    scene_out: wp.array(dtype=int),  # [slot]
):
    slot = first + wp.tid()
    index = slot_index[slot]
    if index == EMPTY:
        pose_out[slot] = wp.transform_identity()
        key_out[slot] = wp.uint64(0)
        scene_out[slot] = empty_scene
    else:
        pose_out[slot] = pose[index]
        key_out[slot] = key[index]
        scene_out[slot] = scene[index]


def load_poses(
    slot_index: wp.array,
    pose: wp.array,
    key: wp.array,
    scene: wp.array,
    empty_scene: int,
    pose_out: wp.array,
    key_out: wp.array,
    scene_out: wp.array,
    *,
    device: Any = None,
    threads: int = 1,
) -> None:
    """Copy what the forming kernels read about each slot's frame or ping.

    Args:
        slot_index: shape [slot].
        pose: world from sensor, shape [frame].
        key: random key, shape [frame].
        scene: index into the scene table, shape [frame].
        empty_scene: index of the table's empty scene, for empty slots.
        pose_out: shape [slot].
        key_out: shape [slot].
        scene_out: shape [slot].
    """
    device = wp.get_device(device)
    slots = slot_index.shape[0]
    frames = pose.shape[0]
    check_array("slot_index", slot_index, (slots,), wp.int32, device)
    check_array("pose", pose, (frames,), wp.transform, device)
    check_array("key", key, (frames,), wp.uint64, device)
    check_array("scene", scene, (frames,), wp.int32, device)
    check_array("pose_out", pose_out, (slots,), wp.transform, device)
    check_array("key_out", key_out, (slots,), wp.uint64, device)
    check_array("scene_out", scene_out, (slots,), wp.int32, device)
    launch(
        load_poses_kernel,
        (slots,),
        [slot_index, pose, key, scene, empty_scene],
        [pose_out, key_out, scene_out],
        device,
        threads,
    )


@wp.kernel
def load_noise_kernel(
    first: int,
    slot_index: wp.array(dtype=int),  # [slot]
    knot_keys: wp.array2d(dtype=wp.uint64),  # [frame, 2]
    blend: wp.array(dtype=float),  # [frame]
    background: wp.array(dtype=float),  # [frame]
    knot_keys_out: wp.array2d(dtype=wp.uint64),  # [slot, 2]
    blend_out: wp.array(dtype=float),  # [slot]
    background_out: wp.array(dtype=float),  # [slot]
):
    slot = first + wp.tid()
    index = slot_index[slot]
    if index == EMPTY:
        blend_out[slot] = 0.0
        background_out[slot] = 0.0
    else:
        knot_keys_out[slot, 0] = knot_keys[index, 0]
        knot_keys_out[slot, 1] = knot_keys[index, 1]
        blend_out[slot] = blend[index]
        background_out[slot] = background[index]


def load_noise(
    slot_index: wp.array,
    knot_keys: wp.array,
    blend: wp.array,
    background: wp.array,
    knot_keys_out: wp.array,
    blend_out: wp.array,
    background_out: wp.array,
    *,
    device: Any = None,
    threads: int = 1,
) -> None:
    """Copy what the noise kernels read about each slot's frame or ping; empty slots have no noise.

    Args:
        slot_index: shape [slot].
        knot_keys: keys of the knots of speckle before and after, shape [frame, 2].
        blend: how far a frame is from the one to the other, shape [frame].
        background: mean of the background, shape [frame].
        knot_keys_out: shape [slot, 2]; that of empty slots stays.
        blend_out: shape [slot].
        background_out: shape [slot].
    """
    device = wp.get_device(device)
    slots = slot_index.shape[0]
    frames = blend.shape[0]
    check_array("slot_index", slot_index, (slots,), wp.int32, device)
    check_array("knot_keys", knot_keys, (frames, 2), wp.uint64, device)
    check_array("blend", blend, (frames,), wp.float32, device)
    check_array("background", background, (frames,), wp.float32, device)
    check_array("knot_keys_out", knot_keys_out, (slots, 2), wp.uint64, device)
    check_array("blend_out", blend_out, (slots,), wp.float32, device)
    check_array("background_out", background_out, (slots,), wp.float32, device)
    launch(
        load_noise_kernel,
        (slots,),
        [slot_index, knot_keys, blend, background],
        [knot_keys_out, blend_out, background_out],
        device,
        threads,
    )


@wp.kernel
def scatter_rows_kernel(
    first: int,
    slot_index: wp.array(dtype=int),  # [slot]
    value: wp.array2d(dtype=Any),  # [slot, column]
    value_out: wp.array2d(dtype=Any),  # [frame, column]
):
    slot, column = wp.tid()
    slot += first
    index = slot_index[slot]
    if index != EMPTY:
        value_out[index, column] = value[slot, column]


@wp.kernel
def gather_rows_kernel(
    first: int,
    slot_index: wp.array(dtype=int),  # [slot]
    value: wp.array2d(dtype=Any),  # [frame, column]
    value_out: wp.array2d(dtype=Any),  # [slot, column]
):
    slot, column = wp.tid()
    slot += first
    index = slot_index[slot]
    if index != EMPTY:
        value_out[slot, column] = value[index, column]


# Named here, so that compiling ahead of time finds them.
_ROW_TYPES = (wp.float32, wp.vec3)
for _row_type in _ROW_TYPES:
    for _kernel in (scatter_rows_kernel, gather_rows_kernel):
        wp.overload(_kernel, [int, wp.array(dtype=int), wp.array2d(dtype=_row_type), wp.array2d(dtype=_row_type)])


def scatter_rows(
    slot_index: wp.array, value: wp.array, value_out: wp.array, *, device: Any = None, threads: int = 1
) -> None:
    """Write slots' rows where their frames belong.

    Args:
        slot_index: frame of each slot, no frame twice, shape [slot].
        value: ``float32`` or ``vec3``, shape [slot, column].
        value_out: of the same type, shape [frame, column]; rows of other frames stay.
    """
    _copy_rows(scatter_rows_kernel, slot_index, value, value_out, slot_index.shape[0], None, device, threads)


def gather_rows(
    slot_index: wp.array, value: wp.array, value_out: wp.array, *, device: Any = None, threads: int = 1
) -> None:
    """Read the rows of the frames in the slots.

    Args:
        slot_index: frame of each slot, shape [slot].
        value: ``float32`` or ``vec3``, shape [frame, column].
        value_out: of the same type, shape [slot, column]; rows of empty slots stay.
    """
    _copy_rows(gather_rows_kernel, slot_index, value, value_out, None, slot_index.shape[0], device, threads)


def _copy_rows(
    kernel: Any,
    slot_index: wp.array,
    value: wp.array,
    value_out: wp.array,
    rows_in: int | None,
    rows_out: int | None,
    device: Any,
    threads: int,
) -> None:
    device = wp.get_device(device)
    check_array("slot_index", slot_index, (None,), wp.int32, device)
    check_array("value", value, (rows_in, None), getattr(value, "dtype", None), device)
    if value.dtype not in _ROW_TYPES:
        raise ValueError(f"value: expected dtype float32 or vec3f, got {value.dtype.__name__}")
    columns = value.shape[1]
    check_array("value_out", value_out, (rows_out, columns), value.dtype, device)
    launch(kernel, (slot_index.shape[0], columns), [slot_index, value], [value_out], device, threads)
