"""Repeated hits of one place: the surest contact of a cube stays and counts the others, wherever the cube is."""

import numpy as np
import pytest
import warp as wp

from sonarwarp_kernels import repeats
from sonarwarp_kernels.estimate import QUALITY_FALLBACK, QUALITY_INFORMED, QUALITY_NONE
from tests.reference import repeats as reference
from tests.test_crowd import ORIGINS, SIZES

NONE, FALLBACK, INFORMED = int(QUALITY_NONE), int(QUALITY_FALLBACK), int(QUALITY_INFORMED)
NO_CONTACT = int(repeats.NO_CONTACT)
SPACING = 0.0625
"""A power of two: what lies in which cube does not depend on rounding."""


def run(
    device,
    points,
    deviation,
    distance=None,
    trajectory=None,
    quality=None,
    slots=None,
    hits=1,
    content=NO_CONTACT,
):
    """Hits and what became of the qualities of ``points``, shape [frame, beam, 3]."""
    points = np.asarray(points, dtype=np.float32)
    shape = points.shape[:2]
    owner = wp.array(np.zeros(len(points)) if trajectory is None else trajectory, dtype=int, device=device)
    quality_out = wp.array(np.full(shape, INFORMED) if quality is None else quality, dtype=int, device=device)
    point = wp.array(points, dtype=wp.vec3, device=device)
    distance = wp.array(np.ones(shape) if distance is None else distance, dtype=float, device=device)
    angle = wp.array(deviation, dtype=float, device=device)
    slots = repeats.SLOTS * shape[0] * shape[1] if slots is None else slots
    surest = wp.full(slots, content, dtype=int, device=device)
    hits_out = wp.full(shape, hits, dtype=int, device=device)
    repeats.find_surest(owner, quality_out, point, distance, angle, SPACING, surest, device=device)
    repeats.drop_repeats(owner, point, surest, SPACING, hits_out, quality_out, device=device)
    return hits_out.numpy(), quality_out.numpy()


def at(cubes):
    """World positions of the cubes' centres."""
    return SPACING * (np.asarray(cubes, dtype=np.float64) + 0.5)


def stays(device, cubes, deviation, **changed):
    """Hits of the contacts that stay, 0 of those that do not; one beam, a frame for each of ``cubes``."""
    hits, quality = run(device, at(cubes)[:, None], np.reshape(deviation, (-1, 1)), **changed)
    return np.where(quality == NONE, 0, hits)[:, 0].tolist()


# --- Which one stays ---

HERE, BESIDE = (3, 4, 5), (3, 4, 6)

# Cubes and deviations of contacts, and what each that stays stands for.
CASES = {
    "alone": ([HERE], [0.1], [1]),
    "the second is surer": ([HERE, HERE], [0.2, 0.1], [0, 2]),
    "the first is surer": ([HERE, HERE], [0.1, 0.2], [2, 0]),
    "as sure as each other": ([HERE] * 3, [0.1] * 3, [3, 0, 0]),
    "as sure as the first": ([HERE] * 4, [0.2, 0.1, 0.1, 0.3], [0, 4, 0, 0]),
    "certain": ([HERE, HERE], [0.1, 0.0], [0, 2]),
    "neighbours": ([HERE, BESIDE], [0.1, 0.2], [1, 1]),
    "in turn": ([HERE, BESIDE, HERE, BESIDE, HERE], [0.3, 0.1, 0.2, 0.2, 0.4], [0, 2, 3, 0, 0]),
}


@pytest.mark.parametrize("case", CASES)
def test_the_surest_of_a_cube_stays_and_counts_all(device, case):
    cubes, deviation, want = CASES[case]
    assert stays(device, cubes, deviation) == want


def test_sure_is_a_length_and_not_an_angle(device):
    assert stays(device, [HERE, HERE], [0.25, 0.125], distance=[[1.0], [4.0]]) == [2, 0]


def test_of_equals_the_first_frame_stays_and_in_it_the_first_beam(device):
    hits, quality = run(device, np.broadcast_to(at(HERE), (3, 4, 3)), np.full((3, 4), 0.1))
    assert np.flatnonzero(quality).tolist() == [0]
    assert hits[0, 0] == 12
    hits, quality = run(device, np.broadcast_to(at(HERE), (3, 4, 3)), [[0.2] * 4, [0.2, 0.1, 0.1, 0.2], [0.1] * 4])
    assert np.flatnonzero(quality).tolist() == [5]
    assert hits[1, 1] == 12


@wp.kernel
def is_surer_kernel(
    critical_range: wp.array2d(dtype=float),
    elevation_deviation: wp.array2d(dtype=float),
    surer_out: wp.array2d(dtype=int),
):
    one, other = wp.tid()
    surer_out[one, other] = int(repeats.is_surer(critical_range, elevation_deviation, one, other))


def test_of_any_two_contacts_one_is_surer_whichever_comes_first(device):
    rng = np.random.default_rng(1)
    distance, angle = rng.choice([1.0, 2.0, 4.0], (6, 4)), rng.integers(1, 5, (6, 4)) / 64
    surer = wp.zeros((24, 24), dtype=int, device=device)
    given = [wp.array(values, dtype=float, device=device) for values in (distance, angle)]
    wp.launch(is_surer_kernel, (24, 24), inputs=given, outputs=[surer], device=device)
    rank = np.argsort(np.lexsort((np.arange(24), (distance * angle).ravel())))
    assert np.array_equal(surer.numpy(), rank[:, None] < rank)


def test_what_stays_keeps_its_quality(device):
    quality = [[FALLBACK], [INFORMED], [FALLBACK]]
    _, got = run(device, at([HERE, HERE, BESIDE])[:, None], [[0.1], [0.2], [0.1]], quality=quality)
    assert got[:, 0].tolist() == [FALLBACK, NONE, FALLBACK]


def test_what_was_none_neither_stays_nor_counts(device):
    quality = [[NONE], [INFORMED], [INFORMED], [NONE]]
    assert stays(device, [HERE] * 4, [0.1, 0.3, 0.2, 0.2], quality=quality) == [0, 0, 2, 0]
    assert stays(device, [HERE] * 4, [0.1] * 4, quality=[[NONE]] * 4) == [0] * 4


def test_hits_are_added_to_what_was_counted(device):
    assert stays(device, [HERE, HERE, BESIDE], [0.1, 0.2, 0.3], hits=5) == [6, 0, 5]


def test_contacts_of_cubes_that_were_not_looked_into_stay(device):
    shape = (3, 1)
    owner, point = wp.zeros(3, dtype=int, device=device), wp.zeros(shape, dtype=wp.vec3, device=device)
    table = wp.full(6, NO_CONTACT, dtype=int, device=device)
    hits, quality = (wp.full(shape, value, dtype=int, device=device) for value in (1, INFORMED))
    repeats.drop_repeats(owner, point, table, SPACING, hits, quality, device=device)
    assert np.all(hits.numpy() == 1)
    assert np.all(quality.numpy() == INFORMED)


def test_the_search_ends_in_a_table_that_nobody_cleared(device):
    """All slots are the first contact's: no other cube finds one of its own, so that nothing of it is taken back."""
    assert stays(device, [HERE, BESIDE, BESIDE, HERE], [0.1, 0.1, 0.2, 0.2], content=0) == [2, 1, 1, 0]


# --- Where cubes are ---


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("cube", [0, 7, -1, -1000])
def test_a_cube_holds_its_lower_side_and_not_its_upper(device, axis, cube):
    points = np.repeat(at([(2, 2, 2)]), 4, axis=0)
    points[:, axis] = SPACING * (cube + np.array([-1e-3, 0.0, 0.99, 1.0]))
    hits, quality = run(device, points[:, None], [[0.1]] * 4)
    assert np.where(quality == NONE, 0, hits)[:, 0].tolist() == [1, 2, 0, 1]


@pytest.mark.parametrize("outside", [(-1, 4, 5), (3, -9, 5), (3, 4, 9999), (-(10**6), 10**6, -(10**6))])
def test_contacts_of_any_octant_and_far_away_are_kept_and_counted_like_all(device, outside):
    assert stays(device, [outside, HERE, outside, HERE], [0.2, 0.1, 0.1, 0.2]) == [0, 2, 2, 0]


def test_two_trajectories_share_a_place_and_no_cube(device):
    assert stays(device, [HERE] * 4, [0.1, 0.2, 0.3, 0.4], trajectory=[1, 0, 0, 1]) == [2, 2, 0, 0]


def test_all_in_cubes_of_their_own_stay(device):
    """As many as there are slots for, so that cubes of one place meet in the table however far apart they begin."""
    cubes = np.stack(np.meshgrid(*[np.arange(-12, 12)] * 3), axis=-1).reshape(-1, 3)
    both, owner = np.concatenate([cubes, cubes]), np.repeat([0, 1], len(cubes))
    assert stays(device, both, np.full(len(both), 0.1), trajectory=owner) == [1] * len(both)


# --- Many trajectories, any order ---


def random_batch(seed=3, frames=60, beams=20):
    """Points of two trajectories in and around their boxes, thick in places; lengths of which many are equal."""
    rng = np.random.default_rng(seed)
    owner = rng.integers(2, size=frames)
    middle = rng.uniform(-0.1, 1.1, (2, 8, 3)) * 4 * np.array(SIZES)[:, None]
    cubes = middle[owner[:, None], rng.integers(8, size=(frames, beams))]
    cubes = cubes + rng.normal(size=cubes.shape) * rng.choice([0.5, 2.0], (frames, beams, 1))
    return {
        "points": (np.array(ORIGINS)[owner][:, None] + SPACING * cubes).astype(np.float32),
        "deviation": rng.integers(1, 9, (frames, beams)) / 64,
        "distance": rng.choice([1.0, 2.0, 4.0], (frames, beams)),
        "trajectory": owner,
        "quality": rng.choice([NONE, FALLBACK, INFORMED], (frames, beams), p=[0.1, 0.3, 0.6]),
    }


def test_random_contacts_match_the_oracle(device):
    batch = random_batch()
    hits, quality = run(device, **batch)
    there = np.flatnonzero(batch["quality"])
    owner = np.repeat(batch["trajectory"], batch["quality"].shape[1])
    length = (batch["deviation"] * batch["distance"]).ravel()
    points = batch["points"].reshape(-1, 3).astype(np.float64)
    found = reference.surest(owner[there], points[there], length[there], SPACING)
    assert 0.2 < len(found) / len(there) < 0.8
    assert np.flatnonzero(quality).tolist() == sorted(there[list(found)])
    for contact, members in found.items():
        assert hits.flat[there[contact]] == len(members)
    kept = quality != NONE
    assert np.array_equal(quality[kept], batch["quality"][kept])
    assert np.all(hits[~kept] == 1)


def test_a_trajectory_is_alone_in_any_batch(device):
    batch = random_batch()
    both = run(device, **batch)
    for index in range(2):
        mine = batch["trajectory"] == index
        chosen = {name: values[mine] for name, values in batch.items()} | {"trajectory": None}
        alone = run(device, **chosen)
        for one, other in zip(both, alone, strict=True):
            assert np.array_equal(one[mine], other)


def test_the_order_of_frames_and_beams_decides_between_equals_only(device):
    batch = random_batch()
    rng = np.random.default_rng(4)
    batch["deviation"] = rng.permutation(batch["deviation"].size).reshape(batch["deviation"].shape) + 1.0
    batch["distance"] = np.ones_like(batch["deviation"])
    frame, beam = rng.permutation(len(batch["points"])), rng.permutation(batch["points"].shape[1])
    plain = run(device, **batch)
    shuffled = {name: values[frame] for name, values in batch.items()}
    shuffled |= {name: values[:, beam] for name, values in shuffled.items() if name != "trajectory"}
    for one, other in zip(plain, run(device, **shuffled), strict=True):
        assert np.array_equal(one[frame][:, beam], other)


@pytest.mark.parametrize("slots", [2401, 4096, 100_000])
def test_the_size_of_the_table_changes_nothing(device, slots):
    batch = random_batch()
    for one, other in zip(run(device, **batch), run(device, **batch, slots=slots), strict=True):
        assert np.array_equal(one, other)


def test_cubes_begin_their_search_all_over_the_table(device):
    """Cubes along a line, as an edge has them: a chain of full slots would cost a search through all of it."""
    line = np.arange(1000)
    first = wp.zeros(1000, dtype=int, device=device)
    cube = wp.array(line, dtype=int, device=device)
    wp.launch(first_slots_kernel, 1000, inputs=[cube], outputs=[first], device=device)
    # 1000 of 2000 slots at random leave 1000 (1 - exp(-1/2)) / (1/2) = 787 different ones, to 10.
    assert abs(len(np.unique(first.numpy())) - 787) < 40
    assert first.numpy().min() >= 0
    assert first.numpy().max() < 2000


@wp.kernel
def first_slots_kernel(cube: wp.array(dtype=int), slot_out: wp.array(dtype=int)):
    index = wp.tid()
    slot_out[index] = repeats.first_slot(0, wp.vec3i(cube[index], 0, -cube[index]), 2000)


@pytest.mark.parametrize("shape", [(0, 5), (5, 0)])
def test_no_frames_and_no_beams_have_no_contacts(device, shape):
    hits, quality = run(device, np.zeros((*shape, 3)), np.zeros(shape))
    assert hits.shape == quality.shape == shape


# --- Bad input ---


def launch_with(device, launcher, spacing=SPACING, **changed):
    given = {
        "trajectory": wp.zeros(4, dtype=int, device=device),
        "quality": wp.zeros((4, 6), dtype=int, device=device),
        "point": wp.zeros((4, 6), dtype=wp.vec3, device=device),
        "critical_range": wp.zeros((4, 6), dtype=float, device=device),
        "elevation_deviation": wp.zeros((4, 6), dtype=float, device=device),
        "surest": wp.zeros(48, dtype=int, device=device),
        "hits": wp.zeros((4, 6), dtype=int, device=device),
    } | changed
    if launcher == "find":
        names = ("trajectory", "quality", "point", "critical_range", "elevation_deviation")
        arrays = [given[name] for name in names]
        repeats.find_surest(*arrays, spacing, given["surest"], device=device)
    else:
        arrays = [given[name] for name in ("trajectory", "point", "surest")]
        repeats.drop_repeats(*arrays, spacing, given["hits"], given["quality"], device=device)


@pytest.mark.parametrize(
    ("launcher", "wrong", "shape", "dtype", "message"),
    [
        ("find", "trajectory", (4, 1), int, r"trajectory: expected shape \(any,\), got \(4, 1\)"),
        ("drop", "trajectory", (4,), float, "trajectory: expected dtype int32, got float32"),
        ("find", "quality", (3, 6), int, r"quality: expected shape \(4, any\), got \(3, 6\)"),
        ("drop", "quality", (3, 6), int, r"quality_out: expected shape \(4, any\), got \(3, 6\)"),
        ("drop", "quality", (4, 6), float, "quality_out: expected dtype int32, got float32"),
        ("find", "point", (4, 5), wp.vec3, r"point: expected shape \(4, 6\), got \(4, 5\)"),
        ("drop", "point", (4, 6), wp.vec4, "point: expected dtype vec3f, got vec4f"),
        ("find", "critical_range", (4, 5), float, r"critical_range: expected shape \(4, 6\), got \(4, 5\)"),
        ("find", "elevation_deviation", (4, 6), int, "elevation_deviation: expected dtype float32, got int32"),
        ("find", "surest", (6, 8), int, r"surest_out: expected shape \(any,\), got \(6, 8\)"),
        ("find", "surest", (47,), int, "surest_out: 47 slots, must be at least 48"),
        ("drop", "surest", (47,), int, "surest: 47 slots, must be at least 48"),
        ("drop", "surest", (48,), float, "surest: expected dtype int32, got float32"),
        ("drop", "hits", (4, 5), int, r"hits_out: expected shape \(4, 6\), got \(4, 5\)"),
    ],
)
def test_wrong_arrays_are_refused_by_name(device, launcher, wrong, shape, dtype, message):
    with pytest.raises(ValueError, match=message):
        launch_with(device, launcher, **{wrong: wp.zeros(shape, dtype=dtype, device=device)})


@pytest.mark.parametrize("launcher", ["find", "drop"])
def test_cubes_of_no_size_are_refused_by_name(device, launcher):
    for spacing in (0.0, -0.1, float("nan")):
        with pytest.raises(ValueError, match="spacing: must be above 0, got"):
            launch_with(device, launcher, spacing=spacing)
