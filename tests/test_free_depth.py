"""Free depth: what frames prove empty, at which places that is asked and measured, and how it is read between cells."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from sonarwarp_kernels import free_depth
from sonarwarp_kernels.particles import Contacts
from sonarwarp_kernels.specs import Fan, Grid
from tests.arc_world import UNDETECTED, struct
from tests.carved_world import ASKED, ATTITUDES, UNASKED, UNEVEN, CarvedWorld
from tests.reference import free_depth as reference
from tests.reference.field import cell_centres

EPSILON = float(np.finfo(np.float32).eps)
EVEN = np.linspace(-0.5, 0.5, 9, dtype=np.float32)
# Positions and ranges of up to 5 m, some operations each.
LENGTH = 16 * EPSILON * 5.0


@wp.kernel
def two_largest_kernel(value: wp.array2d(dtype=float), kept_out: wp.array(dtype=wp.vec2)):
    row = wp.tid()
    kept = wp.vec2(-1.0, -1.0)
    for index in range(value.shape[1]):
        kept = free_depth.two_largest(kept, value[row, index])
    kept_out[row] = kept


@wp.kernel
def read_free_depth_kernel(
    grid: Grid,
    cells: wp.array4d(dtype=float),
    owner: int,
    point: wp.array(dtype=wp.vec3),
    reach: float,
    depth_out: wp.array(dtype=float),
):
    index = wp.tid()
    depth_out[index] = free_depth.read_free_depth(grid, cells, owner, point[index], reach)


# --- What several frames prove ---


@pytest.mark.parametrize("cone", [0, 1])
@pytest.mark.parametrize("azimuth", [EVEN, UNEVEN, np.float32([0.1])], ids=["even", "uneven", "one beam"])
@pytest.mark.parametrize("attitude", ATTITUDES)
def test_free_depth_is_the_second_largest_over_all_frames_at_any_attitude(device, attitude, azimuth, cone):
    border = np.float32([-0.3, 0.5]) if len(azimuth) == 1 else None
    world = CarvedWorld.around(ATTITUDES[attitude], cone=cone, azimuth=azimuth, border=border)
    got = world.measure(device, np.full(world.counts.shape, ASKED, dtype=np.float32))
    inside = world.inside()
    assert np.all(got[~inside] == ASKED)
    grid = world.inputs("cpu")["grid"]
    for owner in range(2):
        own = got[owner][inside[owner]]
        lower, upper = reference.bounds(world, owner, cell_centres(grid, owner)[inside[owner]])
        assert np.all(own >= lower - LENGTH)
        assert np.all(own <= upper + LENGTH)
        # Hardly any place lies so close to a beam's edge that either answer is right.
        assert np.mean(upper - lower > LENGTH) < 2e-3
        between = (own > -world.reach) & (own < world.reach)
        assert np.mean(between) > 0.1


@pytest.mark.parametrize("cone", [0, 1])
def test_of_more_frames_than_runs_none_is_left_out(device, cone):
    world = CarvedWorld.around(ATTITUDES["tilted"], frames=2 * 150, cone=cone)
    critical = np.random.default_rng(73).uniform(2.2, 2.4, world.critical.shape)
    world = replace(world, critical=critical.astype(np.float32))
    got = world.measure(device, np.full(world.counts.shape, ASKED, dtype=np.float32))
    grid = world.inputs("cpu")["grid"]
    for owner in range(2):
        inside = world.inside()[owner]
        lower, upper = reference.bounds(world, owner, cell_centres(grid, owner)[inside])
        assert np.all(got[owner][inside] >= lower - LENGTH)
        assert np.all(got[owner][inside] <= upper + LENGTH)
        assert np.mean(np.abs(got[owner][inside]) < world.reach) > 0.1


def test_frames_that_look_straight_ahead_find_the_depth_of_a_wall(device):
    """Before a wall, free depth is the distance to it; on it zero, behind it negative; the reach bounds all."""
    along = np.array([0.0, 0.1, 0.2, 0.3], dtype=np.float32)
    world = CarvedWorld.around(np.eye(3), azimuth=np.float32([0.0]), border=np.float32([-0.1, 0.1]), frames=4)
    world = replace(
        world,
        orientation=np.tile(np.eye(3), (4, 1, 1)),
        position=np.stack([along, 0 * along, 0 * along], axis=1),
        critical=(3.0 - along)[:, None],
        trajectory=np.zeros(4, dtype=np.int32),
        origin=np.float32([[1.0, -0.06, -0.06]]),
        counts=np.zeros((1, 30, 1, 1), dtype=np.int32),
        size=np.int32([[30, 1, 1]]),
        reach=0.5,
    )
    got = world.measure(device, np.full((1, 30, 1, 1), ASKED, dtype=np.float32))[0, :, 0, 0]
    depth = 3.0 - cell_centres(world.inputs("cpu")["grid"])[:, 0, 0, 0]
    np.testing.assert_allclose(got, np.clip(depth, -0.5, 0.5), atol=LENGTH)


def test_one_frame_alone_proves_nothing_and_twice_the_same_proves_what_it_sees(device):
    world = CarvedWorld.around(ATTITUDES["tilted"], frames=4)
    cells = np.full(world.counts.shape, ASKED, dtype=np.float32)
    inside = world.inside()
    assert np.all(world.selected([0, 1]).measure(device, cells)[inside] == -world.reach)
    twice = world.selected([0, 1, 0, 1]).measure(device, cells)
    where = cell_centres(world.inputs("cpu")["grid"], 0)
    seen = reference.proven(world, 0, where)
    sure = inside[0] & (np.abs(reference.bounds(world, 0, where)[0] - reference.bounds(world, 0, where)[1]) < LENGTH)
    np.testing.assert_allclose(twice[0][sure], seen[sure], atol=LENGTH)
    assert np.any(seen[sure] > 0.1)


def test_one_missed_echo_does_not_pierce_a_surface(device):
    world = CarvedWorld.around(np.eye(3), azimuth=np.float32([0.0]), border=np.float32([-0.1, 0.1]), frames=3)
    world = replace(
        world,
        orientation=np.tile(np.eye(3), (3, 1, 1)),
        position=np.zeros((3, 3), dtype=np.float32),
        critical=np.float32([[2.0], [UNDETECTED], [2.0]]),
        seabed=np.full((3, 1), np.inf, dtype=np.float32),
        trajectory=np.zeros(3, dtype=np.int32),
        origin=np.float32([[2.19, -0.06, -0.06]]),
        counts=np.zeros((1, 1, 1, 1), dtype=np.int32),
        size=np.int32([[1, 1, 1]]),
    )
    asked = np.full((1, 1, 1, 1), ASKED, dtype=np.float32)
    assert world.measure(device, asked)[0, 0, 0, 0] == pytest.approx(2.0 - 2.25, abs=LENGTH)
    twice_missed = world.selected([0, 1, 1])
    assert twice_missed.measure(device, asked)[0, 0, 0, 0] == pytest.approx(1.0, abs=LENGTH)


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("seed", [None, 1, 2])
def test_the_order_of_frames_and_the_number_of_threads_change_no_bit(device, seed, threads):
    world = CarvedWorld.around(ATTITUDES["tilted"])
    cells = np.full(world.counts.shape, ASKED, dtype=np.float32)
    want = world.measure(device, cells)
    order = None if seed is None else np.random.default_rng(seed).permutation(world.frames)
    assert np.array_equal(world.measure(device, cells, order=order, threads=threads), want)
    assert len(np.unique(want)) > 100


@pytest.mark.parametrize("owner", [0, 1])
def test_a_trajectory_has_its_bits_alone_or_beside_another_one(device, owner):
    world = CarvedWorld.around(ATTITUDES["rolled"])
    both = world.measure(device, world.ask(device))[owner]
    nx, ny, nz = world.size[owner]
    alone = replace(
        world.selected(world.trajectory == owner),
        trajectory=np.zeros(world.frames // 2, dtype=np.int32),
        origin=world.origin[owner : owner + 1],
        size=world.size[owner : owner + 1],
        counts=np.zeros((1, nx, ny, nz), dtype=np.int32),
    )
    assert np.array_equal(alone.measure(device, alone.ask(device))[0], both[:nx, :ny, :nz])
    assert np.any(np.abs(both[:nx, :ny, :nz]) < world.reach)


# --- Which cells are asked for ---


@pytest.mark.parametrize("cone", [0, 1])
@pytest.mark.parametrize("hypotheses", [1, 7, 40])
@pytest.mark.parametrize("attitude", ["tilted", "upside down", "upwards"])
def test_cells_around_every_place_on_an_arc_are_asked_for_and_no_others(device, attitude, hypotheses, cone):
    world = CarvedWorld.around(ATTITUDES[attitude], cone=cone)
    got = world.ask(device, hypotheses)
    assert set(np.unique(got)) == {ASKED, UNASKED}
    slack = LENGTH / world.cell
    for owner in range(2):
        found, possible = np.zeros((2, *got.shape[1:]), dtype=bool)
        for frame in np.flatnonzero(world.trajectory == owner):
            for beam in np.flatnonzero(world.critical[frame] != UNDETECTED):
                _, where = reference.arc(world, frame, beam, hypotheses)
                found |= reference.around(world, owner, where, -slack)
                possible |= reference.around(world, owner, where, slack)
        asked = got[owner] == ASKED
        assert np.all(asked[found])
        assert not np.any(asked[~possible])
        assert 0 < found.sum() < world.inside()[owner].sum()
        # Some arcs reach out of the box, which has no cells there.
        assert not np.any(asked[~world.inside()[owner]])


@pytest.mark.parametrize("threads", [2, 5])
def test_threads_ask_for_the_same_cells_as_one(device, threads):
    world = CarvedWorld.around(ATTITUDES["tilted"])
    assert np.array_equal(world.ask(device, threads=threads), world.ask(device))


def test_without_critical_points_nothing_is_asked_for(device):
    world = CarvedWorld.around(ATTITUDES["tilted"])
    world = replace(world, critical=np.full_like(world.critical, UNDETECTED))
    assert np.all(world.ask(device, content=7.0) == 7.0)


def test_where_nobody_asked_nothing_is_written(device):
    world = CarvedWorld.around(ATTITUDES["tilted"])
    cells = world.ask(device)
    got = world.measure(device, cells)
    asked = cells == ASKED
    assert np.all(got[~asked] == UNASKED)
    assert np.all(np.abs(got[asked]) <= world.reach)
    whole = world.measure(device, np.full(cells.shape, ASKED, dtype=np.float32))
    assert np.array_equal(got[asked], whole[asked])


# --- The two largest ---


@pytest.mark.parametrize(
    ("values", "kept"),
    [
        ((), (-1, -1)),
        ((0.5,), (0.5, -1)),
        ((-3.0, -2.0), (-1, -1)),
        ((0.5, 0.5), (0.5, 0.5)),
        ((0.2, 0.5, 0.3), (0.5, 0.3)),
        ((0.5, 0.3, 0.2), (0.5, 0.3)),
        ((0.2, 0.3, 0.5), (0.5, 0.3)),
        ((0.5, 0.2, 0.5, 0.1), (0.5, 0.5)),
    ],
)
def test_the_two_largest_of_a_sequence_are_kept(device, values, kept):
    out = wp.zeros(1, dtype=wp.vec2, device=device)
    given = wp.array(np.float32(values).reshape(1, -1), dtype=float, device=device)
    wp.launch(two_largest_kernel, 1, [given], [out], device=device)
    assert np.array_equal(out.numpy()[0], np.float32(kept))


# --- Reading between cells ---


def read(world, cells, owner, where, device):
    out = wp.zeros(len(where), dtype=float, device=device)
    arguments = [world.inputs(device)["grid"], wp.array(cells, dtype=float, device=device), owner]
    points = wp.array(where, dtype=wp.vec3, device=device)
    wp.launch(read_free_depth_kernel, len(where), [*arguments, points, world.reach], [out], device=device)
    return out.numpy()


def places(world, owner, number=4000):
    """Points in and around a box."""
    rng = np.random.default_rng(71)
    extent = world.cell * world.size[owner]
    return (world.origin[owner] + rng.uniform(-0.2, 1.2, (number, 3)) * extent).astype(np.float32)


@pytest.mark.parametrize("owner", [0, 1])
def test_between_cells_free_depth_is_trilinear_and_outside_nothing_is_proven(device, owner):
    world = CarvedWorld.around(np.eye(3))
    rng = np.random.default_rng(72)
    cells = rng.uniform(-1, 1, world.counts.shape).astype(np.float32)
    cells[rng.random(cells.shape) < 0.2] = UNASKED
    where = places(world, owner)
    want = reference.read(cells[owner], world.origin[owner], world.cell, world.size[owner], where, world.reach)
    # Cells differ by up to 2 from one to the next.
    np.testing.assert_allclose(read(world, cells, owner, where, device), want, atol=3 * 2 * LENGTH / world.cell)
    assert np.sum(want == -world.reach) > 100


def test_what_is_linear_is_read_as_it_is(device):
    world = CarvedWorld.around(np.eye(3))
    slope = np.array([0.2, -0.1, 0.15])
    grid = world.inputs("cpu")["grid"]
    cells = np.stack([(cell_centres(grid, owner) - world.origin[owner]) @ slope for owner in range(2)])
    where = places(world, 1)
    half = 0.5 * world.cell
    upper = world.origin[1] + world.cell * world.size[1] - half
    where = where[np.all((where > world.origin[1] + half) & (where < upper), axis=1)]
    assert len(where) > 1000
    np.testing.assert_allclose(read(world, cells, 1, where, device), (where - world.origin[1]) @ slope, atol=3 * LENGTH)


# --- Refusals ---


@pytest.mark.parametrize("number", [0, -3])
def test_fewer_than_one_hypothesis_is_refused(device, number):
    with pytest.raises(ValueError, match=f"hypotheses: {number}, must be at least 1"):
        CarvedWorld.around(np.eye(3)).ask(device, number)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"reach": 0.0}, r"carving\.reach: must be above 0, got 0\.0"),
        ({"reach": float("nan")}, r"carving\.reach: must be above 0, got nan"),
        ({"margin": -0.01}, r"carving\.margin: must be at least 0 and leave some of the beam, got -0\.01"),
        ({"margin": 0.3}, r"carving\.margin: must be at least 0 and leave some of the beam, got 0\.3"),
    ],
)
def test_a_carving_out_of_bounds_is_refused_by_name(device, changed, message):
    world = CarvedWorld.around(np.eye(3), **changed)
    with pytest.raises(ValueError, match=message):
        world.measure(device, np.full(world.counts.shape, ASKED, dtype=np.float32))


WRONG = [
    ("order", (13,), int, r"order: expected shape \(12,\), got \(13,\)"),
    ("order", (12,), float, "order: expected dtype int32, got float32"),
    ("first_frame", (2,), int, r"first_frame: expected shape \(3,\), got \(2,\)"),
    (
        "free_depth_out",
        (2, 26, 24, 21),
        float,
        r"free_depth_out: expected shape \(2, 26, 24, 20\), got \(2, 26, 24, 21\)",
    ),
    ("free_depth_out", (2, 26, 24, 20), int, "free_depth_out: expected dtype float32, got int32"),
    ("contacts.seabed_range", (12, 5), float, r"contacts\.seabed_range: expected shape \(12, 6\), got \(12, 5\)"),
    ("contacts.critical_range", (6, 12), float, r"contacts\.critical_range: expected shape \(12, 6\), got \(6, 12\)"),
    ("contacts.trajectory", (13,), int, r"contacts\.key: expected shape \(13,\), got \(12,\)"),
    ("contacts.world_from_sensor", (11,), wp.transform, r"world_from_sensor: expected shape \(12,\), got \(11,\)"),
    ("fan.azimuth", (5,), float, r"contacts\.seabed_range: expected shape \(12, 5\), got \(12, 6\)"),
    ("fan.range_edge", (1,), float, r"fan\.range_edge: needs at least 2 edges, got 1"),
    ("fan.column_azimuth", (1,), float, r"fan\.column_azimuth: needs at least 2 borders, got 1"),
    ("grid.size", (1,), wp.vec3i, r"grid\.size: expected shape \(2,\), got \(1,\)"),
]


def with_wrong(inputs, name, shape, dtype, device):
    owner, _, part = name.rpartition(".")
    array = wp.zeros(shape, dtype=dtype, device=device)
    if owner:
        setattr(inputs[owner], part, array)
    else:
        inputs[name] = array


@pytest.mark.parametrize(("name", "shape", "dtype", "message"), WRONG)
def test_wrong_arrays_are_refused_by_name(device, name, shape, dtype, message):
    world = CarvedWorld.around(np.eye(3))
    cells = wp.zeros(world.counts.shape, dtype=float, device=device)
    inputs = world.inputs(device) | world.rows(device) | {"free_depth_out": cells, "carving": world.carving()}
    with_wrong(inputs, name, shape, dtype, device)
    taken = ("grid", "fan", "carving", "contacts", "order", "first_frame", "free_depth_out")
    with pytest.raises(ValueError, match=message):
        free_depth.measure_free_depth(**{argument: inputs[argument] for argument in taken}, device=device)
    if name in ("order", "first_frame", "fan.column_azimuth"):
        return
    taken = ("grid", "fan", "contacts", "free_depth_out")
    with pytest.raises(ValueError, match=message):
        free_depth.ask_arcs(**{argument: inputs[argument] for argument in taken}, hypotheses=4, device=device)


def test_a_grid_without_a_cell_is_refused_by_name(device):
    world = CarvedWorld.around(np.eye(3), cell=0.0)
    with pytest.raises(ValueError, match=r"grid\.cell: must be above 0, got 0\.0"):
        world.ask(device)


def test_no_frames_leave_nothing_proven(device):
    world = CarvedWorld.around(np.eye(3)).selected([])
    cells = np.full(world.counts.shape, ASKED, dtype=np.float32)
    assert np.all(world.measure(device, cells)[world.inside()] == -world.reach)
    assert np.all(world.ask(device, content=7.0) == 7.0)


def test_structs_without_arrays_are_refused_by_name(device):
    world = CarvedWorld.around(np.eye(3))
    inputs = world.inputs(device)
    cells = wp.zeros(world.counts.shape, dtype=float, device=device)
    with pytest.raises(ValueError, match=r"fan\.azimuth: expected a warp array, got NoneType"):
        free_depth.ask_arcs(inputs["grid"], Fan(), inputs["contacts"], 4, cells, device=device)
    with pytest.raises(ValueError, match=r"contacts\.trajectory: expected a warp array, got NoneType"):
        free_depth.ask_arcs(inputs["grid"], inputs["fan"], struct(Contacts), 4, cells, device=device)
