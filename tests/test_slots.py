"""A round's slots: walking a table on the device, reading what the slots point at, writing their rows back."""

import numpy as np
import pytest
import warp as wp

from sonarwarp_kernels import slots

EMPTY = int(slots.EMPTY)
TABLE = np.array([[4, 2, 0], [1, EMPTY, 3], [EMPTY, EMPTY, 5]])


def on(device, values, dtype=int):
    return wp.array(values, dtype=dtype, device=device)


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("current", [0, 1, 2])
def test_a_round_takes_its_row_of_the_table(device, current, threads):
    slot = wp.full(3, 7, dtype=int, device=device)
    slots.load_slots(on(device, TABLE), on(device, [current]), slot, device=device, threads=threads)
    assert np.array_equal(slot.numpy(), TABLE[current])


@pytest.mark.parametrize("current", [3, 4, 1000])
def test_after_the_table_every_slot_is_empty(device, current):
    slot = wp.full(3, 7, dtype=int, device=device)
    slots.load_slots(on(device, TABLE), on(device, [current]), slot, device=device)
    assert np.array_equal(slot.numpy(), [EMPTY] * 3)


def test_a_table_without_rounds_empties_the_slots(device):
    slot = wp.full(3, 7, dtype=int, device=device)
    slots.load_slots(wp.zeros((0, 3), dtype=int, device=device), on(device, [0]), slot, device=device)
    assert np.array_equal(slot.numpy(), [EMPTY] * 3)


def test_the_next_round_is_one_later(device):
    current = on(device, [0])
    for expected in (1, 2, 3):
        slots.next_round(current, device=device)
        assert current.numpy().tolist() == [expected]


def test_replaying_one_captured_round_walks_the_table_to_its_end_and_stays_there(device):
    table, current = on(device, TABLE), on(device, [0])
    slot = wp.full(3, 7, dtype=int, device=device)
    with wp.ScopedCapture(device=device) as capture:
        slots.load_slots(table, current, slot, device=device, threads=2)
        slots.next_round(current, device=device)
    assert slot.numpy().tolist() == [7] * 3, "launched eagerly, which leaves the graph empty"
    for row in [*TABLE.tolist(), [EMPTY] * 3, [EMPTY] * 3]:
        wp.capture_launch(capture.graph)
        assert slot.numpy().tolist() == row
    assert current.numpy().tolist() == [len(TABLE) + 2]


@pytest.mark.parametrize("threads", [1, 3])
def test_slots_carry_what_belongs_to_their_frame_and_empty_ones_an_empty_scene(device, threads):
    pose = np.random.default_rng(2).normal(size=(4, 7)).astype(np.float32)
    key = np.array([5, 2**64 - 1, 9, 11], dtype=np.uint64)
    index = [2, EMPTY, 0, 2, 1]
    out = [wp.zeros(5, dtype=dtype, device=device) for dtype in (wp.transform, wp.uint64, int)]
    slots.load_poses(
        on(device, index),
        on(device, pose, wp.transform),
        on(device, key, wp.uint64),
        on(device, [0, 2, 1, 0]),
        3,
        *out,
        device=device,
        threads=threads,
    )
    pose_out, key_out, scene_out = (array.numpy() for array in out)
    filled = [0, 2, 3, 4]
    assert np.array_equal(pose_out[filled], pose[[2, 0, 2, 1]])
    assert np.array_equal(key_out[filled], key[[2, 0, 2, 1]])
    assert scene_out.tolist() == [1, 3, 0, 1, 2]
    # An empty slot stands at the origin, unturned: a pose that no kernel stumbles over.
    assert pose_out[1].tolist() == [0, 0, 0, 0, 0, 0, 1]
    assert key_out[1] == 0


@pytest.mark.parametrize("threads", [1, 3])
def test_slots_carry_the_noise_of_their_frame_and_empty_ones_none(device, threads):
    knot_keys = np.array([[1, 2**64 - 1], [2**63, 3], [2**40, 7]], dtype=np.uint64)
    blend, background = np.array([0.0, 0.5, 0.25]), np.array([1.0, 2.0, 4.0])
    out = [
        wp.zeros((4, 2), dtype=wp.uint64, device=device),
        wp.full(4, 9.0, dtype=float, device=device),
        wp.full(4, 9.0, dtype=float, device=device),
    ]
    slots.load_noise(
        on(device, [2, EMPTY, 0, 1]),
        on(device, knot_keys, wp.uint64),
        on(device, blend, float),
        on(device, background, float),
        *out,
        device=device,
        threads=threads,
    )
    assert np.array_equal(out[0].numpy()[[0, 2, 3]], knot_keys[[2, 0, 1]])
    assert out[1].numpy().tolist() == [0.25, 0.0, 0.0, 0.5]
    assert out[2].numpy().tolist() == [4.0, 0.0, 1.0, 2.0]


ROWS = {
    "numbers": (float, np.arange(12, dtype=np.float32).reshape(4, 3)),
    "points": (wp.vec3, np.arange(36, dtype=np.float32).reshape(4, 3, 3)),
}


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("kind", ROWS)
def test_rows_go_to_their_frames_and_others_stay(device, kind, threads):
    dtype, rows = ROWS[kind]
    out = wp.full((6, 3), -1.0, dtype=dtype, device=device)
    slots.scatter_rows(on(device, [5, EMPTY, 0, 3]), on(device, rows, dtype), out, device=device, threads=threads)
    expected = np.full((6, *rows.shape[1:]), -1.0)
    expected[[5, 0, 3]] = rows[[0, 2, 3]]
    assert np.array_equal(out.numpy(), expected)


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("kind", ROWS)
def test_rows_come_from_their_frames_and_those_of_empty_slots_stay(device, kind, threads):
    dtype, rows = ROWS[kind]
    out = wp.full((5, 3), -1.0, dtype=dtype, device=device)
    slots.gather_rows(on(device, [2, EMPTY, 0, 2, 3]), on(device, rows, dtype), out, device=device, threads=threads)
    expected = np.full((5, *rows.shape[1:]), -1.0)
    expected[[0, 2, 3, 4]] = rows[[2, 0, 2, 3]]
    assert np.array_equal(out.numpy(), expected)


# Launcher, its arrays as (shape, type), then one wrong array at a time and what is said of it.
ARRAYS = {
    "load_slots": {"table": ((4, 3), int), "round_index": ((1,), int), "slot_out": ((3,), int)},
    "next_round": {"round_index_out": ((1,), int)},
    "load_poses": {
        "slot_index": ((3,), int),
        "pose": ((5,), wp.transform),
        "key": ((5,), wp.uint64),
        "scene": ((5,), int),
        "pose_out": ((3,), wp.transform),
        "key_out": ((3,), wp.uint64),
        "scene_out": ((3,), int),
    },
    "load_noise": {
        "slot_index": ((3,), int),
        "knot_keys": ((5, 2), wp.uint64),
        "blend": ((5,), float),
        "background": ((5,), float),
        "knot_keys_out": ((3, 2), wp.uint64),
        "blend_out": ((3,), float),
        "background_out": ((3,), float),
    },
    "scatter_rows": {"slot_index": ((3,), int), "value": ((3, 2), float), "value_out": ((5, 2), float)},
    "gather_rows": {"slot_index": ((3,), int), "value": ((5, 2), float), "value_out": ((3, 2), float)},
}
WRONG = [
    ("load_slots", "table", (4, 2), int, r"table: expected shape \(any, 3\), got \(4, 2\)"),
    ("load_slots", "table", (3,), int, r"table: expected shape \(any, 3\), got \(3,\)"),
    ("load_slots", "round_index", (2,), int, r"round_index: expected shape \(1,\), got \(2,\)"),
    ("load_slots", "slot_out", (3,), float, "slot_out: expected dtype int32, got float32"),
    ("next_round", "round_index_out", (2,), int, r"round_index_out: expected shape \(1,\), got \(2,\)"),
    ("load_poses", "slot_index", (3, 1), int, r"slot_index: expected shape \(3,\), got \(3, 1\)"),
    ("load_poses", "pose", (5,), wp.vec3, "pose: expected dtype transform"),
    ("load_poses", "key", (4,), wp.uint64, r"key: expected shape \(5,\), got \(4,\)"),
    ("load_poses", "scene", (4,), int, r"scene: expected shape \(5,\), got \(4,\)"),
    ("load_poses", "pose_out", (2,), wp.transform, r"pose_out: expected shape \(3,\), got \(2,\)"),
    ("load_poses", "key_out", (3,), int, "key_out: expected dtype uint64, got int32"),
    ("load_poses", "scene_out", (2,), int, r"scene_out: expected shape \(3,\), got \(2,\)"),
    ("load_noise", "slot_index", (3,), float, "slot_index: expected dtype int32, got float32"),
    ("load_noise", "knot_keys", (4, 2), wp.uint64, r"knot_keys: expected shape \(5, 2\), got \(4, 2\)"),
    ("load_noise", "blend", (5,), int, "blend: expected dtype float32, got int32"),
    ("load_noise", "background", (4,), float, r"background: expected shape \(5,\), got \(4,\)"),
    ("load_noise", "knot_keys_out", (3,), wp.uint64, r"knot_keys_out: expected shape \(3, 2\), got \(3,\)"),
    ("load_noise", "blend_out", (2,), float, r"blend_out: expected shape \(3,\), got \(2,\)"),
    ("load_noise", "background_out", (2,), float, r"background_out: expected shape \(3,\), got \(2,\)"),
    ("scatter_rows", "slot_index", (2,), int, r"value: expected shape \(2, any\), got \(3, 2\)"),
    ("scatter_rows", "value", (3,), float, r"value: expected shape \(3, any\), got \(3,\)"),
    ("scatter_rows", "value", (3, 2), int, "value: expected dtype float32 or vec3f, got int32"),
    ("scatter_rows", "value_out", (5, 3), float, r"value_out: expected shape \(any, 2\), got \(5, 3\)"),
    ("scatter_rows", "value_out", (5, 2), wp.vec3, "value_out: expected dtype float32, got vec3f"),
    ("gather_rows", "slot_index", (3, 1), int, r"slot_index: expected shape \(any,\), got \(3, 1\)"),
    ("gather_rows", "value", (5,), float, r"value: expected shape \(any, any\), got \(5,\)"),
    ("gather_rows", "value_out", (2, 2), float, r"value_out: expected shape \(3, 2\), got \(2, 2\)"),
]


@pytest.mark.parametrize(("launcher", "wrong", "shape", "dtype", "message"), WRONG)
def test_wrong_arrays_are_refused_by_name(device, launcher, wrong, shape, dtype, message):
    arrays = {name: wp.zeros(shape, dtype=dtype, device=device) for name, (shape, dtype) in ARRAYS[launcher].items()}
    arrays[wrong] = wp.zeros(shape, dtype=dtype, device=device)
    scalars = {"empty_scene": 1} if launcher == "load_poses" else {}
    with pytest.raises(ValueError, match=message):
        getattr(slots, launcher)(**arrays, **scalars, device=device)
