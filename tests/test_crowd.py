"""Points that stand apart: what few frames met goes, what many agree upon stays."""

import numpy as np
import pytest
import warp as wp

from sonarwarp_kernels import crowd
from sonarwarp_kernels.estimate import QUALITY_FALLBACK, QUALITY_INFORMED, QUALITY_NONE
from sonarwarp_kernels.specs import Grid
from tests.arc_world import struct
from tests.reference import crowd as reference

NONE, FALLBACK, INFORMED = int(QUALITY_NONE), int(QUALITY_FALLBACK), int(QUALITY_INFORMED)
CELL = 0.25
"""A power of two: what lies in which cell does not depend on rounding."""
SHAPE = (16, 12, 8)
ORIGIN = (-2.0, 1.0, 0.5)


def make_grid(device, origins=(ORIGIN,), sizes=None):
    return struct(
        Grid,
        origin=wp.array(origins, dtype=wp.vec3, device=device),
        size=wp.array([SHAPE] * len(origins) if sizes is None else sizes, dtype=wp.vec3i, device=device),
        cell=CELL,
        nx=SHAPE[0],
        ny=SHAPE[1],
        nz=SHAPE[2],
    )


def places(cells, origin=ORIGIN):
    """World positions of the cells' centres."""
    return np.asarray(origin) + CELL * (np.asarray(cells, dtype=np.float64) + 0.5)


def run(device, points, trajectory=None, quality=None, least=3, grid=None, threads=1):
    """Counts and what became of the qualities of ``points``, shape [frame, beam, 3]."""
    points = np.asarray(points, dtype=np.float64)
    grid = grid or make_grid(device)
    owner = wp.array(np.zeros(len(points)) if trajectory is None else trajectory, dtype=int, device=device)
    quality = np.full(points.shape[:2], INFORMED) if quality is None else quality
    quality_out = wp.array(quality, dtype=int, device=device)
    point = wp.array(points, dtype=wp.vec3, device=device)
    count = wp.zeros((grid.origin.shape[0], *SHAPE), dtype=int, device=device)
    crowd.count_points(grid, owner, quality_out, point, count, device=device)
    crowd.drop_strays(grid, owner, point, count, least, quality_out, device=device, threads=threads)
    return count.numpy(), quality_out.numpy()


def kept(device, cells, **changed):
    """Which points at the centres of ``cells`` stay, shape [point]."""
    return run(device, places(cells)[:, None], **changed)[1][:, 0] != NONE


# --- Too few points ---


@pytest.mark.parametrize(
    ("others", "stays"),
    [
        ([], False),
        ([(8, 6, 4)], False),
        ([(8, 6, 4)] * 2, True),
        ([(9, 7, 5), (7, 5, 3)], True),  # across a corner of its cell
        ([(9, 6, 4), (10, 6, 4)], False),  # one of them a cell too far off
        ([(8, 6, 6)] * 5, False),
        ([(8, 3, 4)] * 100, False),
    ],
)
def test_a_point_stays_where_its_surroundings_hold_three(device, others, stays):
    assert kept(device, [(8, 6, 4), *others])[0] == stays


def test_an_isolated_point_goes_and_a_dense_cluster_stays(device):
    cluster = [(3, 3, 3)] * 4 + [(4, 3, 3)] * 4
    assert kept(device, [(12, 9, 6), *cluster]).tolist() == [False, *[True] * 8]


@pytest.mark.parametrize("least", [0, 1])
def test_nothing_is_isolated_where_one_point_is_enough(device, least):
    assert kept(device, [(8, 6, 4)], least=least).all()


# --- What counts ---


@pytest.mark.parametrize("outside", [(-2, 6, 4), (8, 12, 4), (8, 6, 9), (-3, -3, -3), (10**6, 6, 4)])
def test_points_outside_of_the_box_are_not_counted_and_do_not_stay(device, outside):
    points = places([outside] * 9)[:, None]
    count, quality = run(device, points)
    assert count.sum() == 0
    assert np.all(quality == NONE)


@pytest.mark.parametrize(("axis", "side"), [(axis, side) for axis in range(3) for side in (0, 1)])
def test_the_box_s_rim_belongs_to_it(device, axis, side):
    cell = np.array([8, 6, 4])
    cell[axis] = side * (SHAPE[axis] - 1)
    count, quality = run(device, places([cell] * 3)[:, None])
    assert count[0][tuple(cell)] == 3
    assert np.all(quality == INFORMED)


def test_a_point_that_was_none_is_ignored_and_stays_none(device):
    cells = places([(8, 6, 4)] * 4)[:, None]
    count, quality = run(device, cells, quality=[[NONE], [NONE], [INFORMED], [FALLBACK]])
    assert count.sum() == 2
    assert np.all(quality == NONE)
    count, quality = run(device, cells, quality=[[NONE], [FALLBACK], [INFORMED], [FALLBACK]])
    assert count.sum() == 3
    assert quality[:, 0].tolist() == [NONE, FALLBACK, INFORMED, FALLBACK]


def test_counts_are_added_to_what_was_counted(device):
    grid = make_grid(device)
    count = wp.zeros((1, *SHAPE), dtype=int, device=device)
    owner, quality = wp.zeros(1, dtype=int, device=device), wp.full((1, 2), INFORMED, dtype=int, device=device)
    point = wp.array(places([[(1, 2, 3), (4, 5, 6)]]), dtype=wp.vec3, device=device)
    for _ in range(3):
        crowd.count_points(grid, owner, quality, point, count, device=device)
    assert count.numpy().sum() == 6
    assert (count.numpy()[0, 1, 2, 3], count.numpy()[0, 4, 5, 6]) == (3, 3)


# --- Many trajectories, any order ---

SIZES = ((16, 12, 8), (9, 12, 5))
ORIGINS = ((-2.0, 1.0, 0.5), (0.5, -1.0, 0.0))


def random_batch(seed=3, frames=60, beams=20):
    """Points of two trajectories in and around their boxes, thick in places; owners and qualities of the frames."""
    rng = np.random.default_rng(seed)
    owner = rng.integers(2, size=frames)
    middle = rng.uniform(-0.1, 1.1, (2, 8, 3)) * np.array(SIZES)[:, None]
    cells = middle[owner[:, None], rng.integers(8, size=(frames, beams))]
    cells = cells + rng.normal(size=cells.shape) * rng.choice([0.5, 2.0], (frames, beams, 1))
    points = np.array(ORIGINS)[owner][:, None] + CELL * cells
    return points.astype(np.float32), owner, rng.choice([NONE, FALLBACK, INFORMED], (frames, beams), p=[0.1, 0.3, 0.6])


@pytest.mark.parametrize("least", [2, 4, 9])
def test_random_points_match_the_oracle(device, least):
    points, owner, quality = random_batch()
    grid = make_grid(device, ORIGINS, SIZES)
    count, got = run(device, points, owner, quality, least, grid)
    for index, (origin, size) in enumerate(zip(ORIGINS, SIZES, strict=True)):
        mine = (owner[:, None] == index) & (quality != NONE)
        cells = reference.cells_of(points[mine], origin, CELL)
        want = np.zeros(SHAPE, dtype=int)
        want[: size[0], : size[1], : size[2]] = reference.counts(cells, size)
        assert np.array_equal(count[index], want)
        stays = reference.stays(cells, size, least)
        assert 0.1 < stays.mean() < 0.9
        assert np.array_equal(got[mine] != NONE, stays)
    assert np.array_equal(got[got != NONE], quality[got != NONE])


def test_a_trajectory_is_alone_in_any_batch(device):
    points, owner, quality = random_batch()
    both = run(device, points, owner, quality, 3, make_grid(device, ORIGINS, SIZES))
    for index in range(2):
        mine = owner == index
        grid = make_grid(device, ORIGINS[index : index + 1], SIZES[index : index + 1])
        alone = run(device, points[mine], None, quality[mine], 3, grid)
        assert np.array_equal(both[0][index], alone[0][0])
        assert np.array_equal(both[1][mine], alone[1])


def test_the_order_of_frames_and_beams_changes_nothing(device):
    points, owner, quality = random_batch()
    rng = np.random.default_rng(4)
    frame, beam = rng.permutation(len(points)), rng.permutation(points.shape[1])
    grid = make_grid(device, ORIGINS, SIZES)
    count, got = run(device, points, owner, quality, 3, grid)
    mixed = run(device, points[frame][:, beam], owner[frame], quality[frame][:, beam], 3, grid)
    assert np.array_equal(count, mixed[0])
    assert np.array_equal(got[frame][:, beam], mixed[1])


@pytest.mark.parametrize("threads", [2, 5])
def test_threads_change_nothing(device, threads):
    points, owner, quality = random_batch()
    grid = make_grid(device, ORIGINS, SIZES)
    one = run(device, points, owner, quality, 3, grid)
    many = run(device, points, owner, quality, 3, grid, threads)
    assert np.array_equal(one[1], many[1])


@pytest.mark.parametrize("shape", [(0, 5), (5, 0)])
def test_no_frames_and_no_beams_have_no_points(device, shape):
    count, quality = run(device, np.zeros((*shape, 3)))
    assert count.sum() == 0
    assert quality.shape == shape


# --- Bad input ---


def arrays(device):
    return {
        "trajectory": wp.zeros(4, dtype=int, device=device),
        "quality": wp.zeros((4, 6), dtype=int, device=device),
        "point": wp.zeros((4, 6), dtype=wp.vec3, device=device),
        "count": wp.zeros((1, *SHAPE), dtype=int, device=device),
    }


def launch_both(device, grid, given, name):
    """The launcher that calls its arrays so."""
    if name in ("quality", "count_out"):
        crowd.count_points(grid, given["trajectory"], given["quality"], given["point"], given["count"], device=device)
    else:
        crowd.drop_strays(
            grid,
            given["trajectory"],
            given["point"],
            given["count"],
            3,
            given["quality"],
            device=device,
        )


@pytest.mark.parametrize(
    ("wrong", "shape", "dtype", "name", "message"),
    [
        ("trajectory", (4, 1), int, "quality", r"trajectory: expected shape \(any,\), got \(4, 1\)"),
        ("trajectory", (4,), float, "quality", "trajectory: expected dtype int32, got float32"),
        ("quality", (3, 6), int, "quality", r"quality: expected shape \(4, any\), got \(3, 6\)"),
        ("quality", (3, 6), int, "quality_out", r"quality_out: expected shape \(4, any\), got \(3, 6\)"),
        ("quality", (4, 6), float, "quality_out", "quality_out: expected dtype int32, got float32"),
        ("point", (4, 5), wp.vec3, "quality", r"point: expected shape \(4, 6\), got \(4, 5\)"),
        ("point", (4, 6), wp.vec4, "quality_out", "point: expected dtype vec3f, got vec4f"),
        ("count", (1, 16, 12, 7), int, "count_out", r"count_out: expected shape \(1, 16, 12, 8\), got"),
        ("count", (2, *SHAPE), int, "count", r"count: expected shape \(1, 16, 12, 8\), got \(2, 16, 12, 8\)"),
        ("count", (1, *SHAPE), float, "count", "count: expected dtype int32, got float32"),
    ],
)
def test_wrong_arrays_are_refused_by_name(device, wrong, shape, dtype, name, message):
    given = arrays(device) | {wrong: wp.zeros(shape, dtype=dtype, device=device)}
    with pytest.raises(ValueError, match=message):
        launch_both(device, make_grid(device), given, name)


@pytest.mark.parametrize("name", ["quality", "quality_out"])
def test_a_grid_that_does_not_fit_is_refused_by_name(device, name):
    grid = make_grid(device)
    grid.cell = 0.0
    with pytest.raises(ValueError, match=r"grid\.cell: must be above 0, got 0"):
        launch_both(device, grid, arrays(device), name)
    with pytest.raises(ValueError, match=r"grid\.size: expected shape \(1,\), got \(2,\)"):
        launch_both(device, make_grid(device, sizes=[SHAPE] * 2), arrays(device), name)
