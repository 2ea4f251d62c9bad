"""The highest point over every column of cells: the maximum of the points in it, nothing where there are none."""

import numpy as np
import pytest
import warp as wp

from sonarwarp_kernels import tops
from sonarwarp_kernels.estimate import QUALITY_FALLBACK, QUALITY_INFORMED, QUALITY_NONE
from sonarwarp_kernels.specs import Grid
from tests.arc_world import struct
from tests.reference import tops as reference

NONE, FALLBACK, INFORMED = int(QUALITY_NONE), int(QUALITY_FALLBACK), int(QUALITY_INFORMED)
CELL = 0.25
"""A power of two: what lies in which cell does not depend on rounding."""
SHAPE = (16, 12, 8)
ORIGIN = (-2.0, 1.0, 0.5)
NO_HEIGHT = np.float32(tops.NO_HEIGHT)
STEP = 0.5 / float(tops.TOP_STEPS) + 1e-6
"""Heights are counted in whole steps, and float32 holds them to less [m]."""


@wp.kernel
def heights_kernel(
    grid: Grid,
    top: wp.array3d(dtype=int),
    owner: wp.array(dtype=int),
    point: wp.array(dtype=wp.vec3),
    height_out: wp.array(dtype=float),
):
    index = wp.tid()
    height_out[index] = tops.top_height(grid, top, owner[index], point[index])


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


def raise_tops(device, points, trajectory=None, quality=None, grid=None):
    """Tops of ``points``, shape [frame, beam, 3]."""
    points = np.asarray(points, dtype=np.float64)
    grid = grid or make_grid(device)
    top = wp.full((grid.origin.shape[0], *SHAPE[:2]), tops.NO_TOP, dtype=int, device=device)
    tops.raise_tops(
        grid,
        wp.array(np.zeros(len(points)) if trajectory is None else trajectory, dtype=int, device=device),
        wp.array(np.full(points.shape[:2], INFORMED) if quality is None else quality, dtype=int, device=device),
        wp.array(points, dtype=wp.vec3, device=device),
        top,
        device=device,
    )
    return top


def heights(device, top, at, owner=0, grid=None):
    """World heights of the tops over the places ``at``, shape [place]."""
    at = np.asarray(at, dtype=np.float64).reshape(-1, 3)
    out = wp.zeros(len(at), dtype=float, device=device)
    owners = wp.full(len(at), owner, dtype=int, device=device)
    inputs = [grid or make_grid(device), top, owners, wp.array(at, dtype=wp.vec3, device=device)]
    wp.launch(heights_kernel, len(at), inputs=inputs, outputs=[out], device=device)
    return out.numpy()


def over(device, points, at, **changed):
    """Height over one place, with a beam for every point."""
    return heights(device, raise_tops(device, [points], **changed), at)[0]


PLACE = (0.6, 2.6, 0.9)

# Points, the height over PLACE or None; its column spans x from 0.5 to 0.75 and y from 2.5 to 2.75.
COLUMNS = {
    "nothing": ([], None),
    "one": ([(0.6, 2.6, 1.1)], 1.1),
    "the higher of two": ([(0.55, 2.7, 1.4), (0.7, 2.55, 1.2)], 1.4),
    "the higher of two, in the other order": ([(0.7, 2.55, 1.2), (0.55, 2.7, 1.4)], 1.4),
    "the column's lower corner": ([(0.5, 2.5, 1.0)], 1.0),
    "the column's upper corner": ([(0.75, 2.75, 1.0)], None),
    "the next columns": ([(0.8, 2.6, 2.0), (0.4, 2.6, 2.0), (0.6, 2.8, 2.0), (0.6, 2.4, 2.0)], None),
    "the origin's height": ([(0.6, 2.6, 0.5)], 0.5),
    "over the box": ([(0.6, 2.6, 9.0)], 9.0),
    "below the box": ([(0.6, 2.6, 0.3)], None),
    "a millimetre below the box": ([(0.6, 2.6, 0.499)], None),
    "below the box and in it": ([(0.6, 2.6, -5.0), (0.6, 2.6, 0.7)], 0.7),
}


@pytest.mark.parametrize("case", COLUMNS)
def test_a_column_is_as_high_as_its_highest_point(device, case):
    points, height = COLUMNS[case]
    got = over(device, np.reshape(points, (-1, 3)), PLACE)
    if height is None:
        assert got == NO_HEIGHT
    else:
        assert got == pytest.approx(height, abs=STEP)


def test_a_top_answers_at_any_height_of_its_column_and_nowhere_else(device):
    top = raise_tops(device, [[(0.6, 2.6, 1.1)]])
    assert heights(device, top, [(0.5, 2.5, z) for z in (-9.0, 0.5, 1.1, 9.0)]) == pytest.approx(1.1, abs=STEP)
    assert np.all(heights(device, top, [(0.76, 2.6, 1.1), (0.49, 2.6, 1.1), (0.6, 2.76, 1.1)]) == NO_HEIGHT)


@pytest.mark.parametrize("outside", [(-2.1, 2.0), (2.1, 2.0), (0.0, 0.9), (0.0, 4.1), (1e6, -1e6)])
def test_outside_of_the_box_nothing_is_raised_or_asked(device, outside):
    top = raise_tops(device, [[(*outside, 1.0)]])
    assert np.all(top.numpy() == tops.NO_TOP)
    top.fill_(700)
    assert heights(device, top, [(*outside, 1.0)])[0] == NO_HEIGHT


def test_a_point_that_was_none_raises_nothing(device):
    points = [(0.6, 2.6, 2.0), (0.6, 2.6, 1.0), (0.6, 2.6, 1.5)]
    assert over(device, points, PLACE, quality=[[NONE, INFORMED, FALLBACK]]) == pytest.approx(1.5, abs=STEP)
    assert over(device, points, PLACE, quality=[[NONE] * 3]) == NO_HEIGHT


# --- Many trajectories, any order ---

SIZES = ((16, 12, 8), (9, 12, 5))
ORIGINS = ((-2.0, 1.0, 0.5), (0.5, -1.0, 0.0))


def random_batch(seed=5, frames=40, beams=20):
    """Points in and around the boxes of two trajectories; owners and qualities of the frames."""
    rng = np.random.default_rng(seed)
    owner = rng.integers(2, size=frames)
    share = rng.uniform(-0.2, 1.2, (frames, beams, 3))
    points = np.array(ORIGINS)[owner][:, None] + CELL * np.array(SIZES)[owner][:, None] * share
    return points.astype(np.float32), owner, rng.choice([NONE, FALLBACK, INFORMED], (frames, beams))


def test_random_points_match_the_oracle(device):
    points, owner, quality = random_batch()
    top = raise_tops(device, points, owner, quality, make_grid(device, ORIGINS, SIZES)).numpy()
    for index, (origin, size) in enumerate(zip(ORIGINS, SIZES, strict=True)):
        mine = (owner[:, None] == index) & (quality != NONE)
        want = np.full(SHAPE[:2], np.nan)
        want[: size[0], : size[1]] = reference.tops(points[mine], origin, CELL, size)
        assert 20 < np.isfinite(want).sum() < want.size
        assert np.array_equal(top[index] == tops.NO_TOP, np.isnan(want))
        found = np.isfinite(want)
        np.testing.assert_allclose(top[index][found] / float(tops.TOP_STEPS), want[found], atol=STEP)


def test_a_trajectory_is_alone_in_any_batch_and_asks_its_own_box(device):
    points, owner, quality = random_batch()
    grid = make_grid(device, ORIGINS, SIZES)
    both = raise_tops(device, points, owner, quality, grid)
    places = np.random.default_rng(6).uniform(-3, 4, (500, 3))
    for index in range(2):
        mine = owner == index
        only = make_grid(device, ORIGINS[index : index + 1], SIZES[index : index + 1])
        alone = raise_tops(device, points[mine], None, quality[mine], only)
        assert np.array_equal(both.numpy()[index], alone.numpy()[0])
        got = heights(device, both, places, index, grid)
        assert np.array_equal(got, heights(device, alone, places, 0, only))
        assert np.any(got != NO_HEIGHT)


def test_the_order_of_frames_and_beams_changes_nothing(device):
    points, owner, quality = random_batch()
    rng = np.random.default_rng(4)
    frame, beam = rng.permutation(len(points)), rng.permutation(points.shape[1])
    grid = make_grid(device, ORIGINS, SIZES)
    one = raise_tops(device, points, owner, quality, grid).numpy()
    mixed = raise_tops(device, points[frame][:, beam], owner[frame], quality[frame][:, beam], grid).numpy()
    assert np.array_equal(one, mixed)


def test_tops_only_rise(device):
    points, owner, quality = random_batch()
    grid = make_grid(device, ORIGINS, SIZES)
    whole = raise_tops(device, points, owner, quality, grid)
    again = wp.clone(whole)
    for half in (slice(0, 20), slice(20, None)):
        given = [wp.array(array[half], dtype=int, device=device) for array in (owner, quality)]
        point = wp.array(points[half], dtype=wp.vec3, device=device)
        tops.raise_tops(grid, *given, point, again, device=device)
    assert np.array_equal(whole.numpy(), again.numpy())


# --- Bad input ---


def launch_with(device, grid=None, **changed):
    given = {
        "trajectory": wp.zeros(4, dtype=int, device=device),
        "quality": wp.zeros((4, 6), dtype=int, device=device),
        "point": wp.zeros((4, 6), dtype=wp.vec3, device=device),
        "top_out": wp.zeros((1, *SHAPE[:2]), dtype=int, device=device),
    }
    tops.raise_tops(grid or make_grid(device), **(given | changed), device=device)


@pytest.mark.parametrize(
    ("wrong", "shape", "dtype", "message"),
    [
        ("trajectory", (4, 1), int, r"trajectory: expected shape \(any,\), got \(4, 1\)"),
        ("trajectory", (4,), float, "trajectory: expected dtype int32, got float32"),
        ("quality", (3, 6), int, r"quality: expected shape \(4, any\), got \(3, 6\)"),
        ("quality", (4, 6), float, "quality: expected dtype int32, got float32"),
        ("point", (4, 5), wp.vec3, r"point: expected shape \(4, 6\), got \(4, 5\)"),
        ("point", (4, 6), wp.vec4, "point: expected dtype vec3f, got vec4f"),
        ("top_out", (1, *SHAPE), int, r"top_out: expected shape \(1, 16, 12\), got \(1, 16, 12, 8\)"),
        ("top_out", (1, 12, 16), int, r"top_out: expected shape \(1, 16, 12\), got \(1, 12, 16\)"),
        ("top_out", (1, *SHAPE[:2]), float, "top_out: expected dtype int32, got float32"),
    ],
)
def test_wrong_arrays_are_refused_by_name(device, wrong, shape, dtype, message):
    with pytest.raises(ValueError, match=message):
        launch_with(device, **{wrong: wp.zeros(shape, dtype=dtype, device=device)})


@pytest.mark.parametrize("cell", [0.0, -0.1, float("nan")])
def test_a_grid_without_cells_is_refused_by_name(device, cell):
    grid = make_grid(device)
    grid.cell = cell
    with pytest.raises(ValueError, match=r"grid\.cell: must be above 0"):
        launch_with(device, grid)


def test_a_grid_of_other_trajectories_is_refused_by_name(device):
    with pytest.raises(ValueError, match=r"grid\.size: expected shape \(1,\), got \(3,\)"):
        launch_with(device, make_grid(device, sizes=[SHAPE] * 3))
