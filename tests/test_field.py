"""The likelihood field: where a ping speaks and what it says, sums that forget exactly, and reading between cells."""

import numpy as np
import pytest
import warp as wp
from scipy.spatial.transform import Rotation

from sonarwarp_kernels import field, inverse
from sonarwarp_kernels.profile import NO_FOOTPRINT
from sonarwarp_kernels.slots import EMPTY
from sonarwarp_kernels.specs import Grid
from tests.reference import field as reference
from tests.reference.geometry import quaternion, rotation, sonar_rotation

EPSILON = float(np.finfo(np.float32).eps)
COUNTS = float(field.FIXED_POINT)
NOTHING = (float(NO_FOOTPRINT),) * 3
FORWARDS = np.eye(3)
ORIGIN = (1.0, -0.5, 0.5)
SHAPE = (24, 20, 16)


def make_model(**changed):
    model = inverse.ProfileModel()
    values = {"hit": 2.0, "miss": -1.0, "no_return": 0.0, "range_deviation": 0.03, "reach": 2.0}
    values |= {"compact": np.inf, "half_width": np.radians(3.0), "half_fan": np.radians(10.0), **changed}
    for name, value in values.items():
        setattr(model, name, value)
    return model


def make_grid(device, origins=(ORIGIN,), cell=0.05, shape=SHAPE, sizes=None):
    grid = Grid()
    grid.origin = wp.array(origins, dtype=wp.vec3, device=device)
    grid.size = wp.array([shape] * len(origins) if sizes is None else sizes, dtype=wp.vec3i, device=device)
    grid.cell = cell
    grid.nx, grid.ny, grid.nz = shape
    return grid


def fields(grid):
    """Fields that know nothing, one per trajectory."""
    shape = (grid.origin.shape[0], grid.nx, grid.ny, grid.nz)
    return wp.zeros(shape, dtype=int, device=grid.origin.device)


class Pings:
    """Pings as the kernels take them: owner, position, orientation and footprints of each."""

    def __init__(self, pings, footprints=3):
        self.owner, self.position, self.orientation, self.footprints = zip(*pings, strict=True)
        self.padded = [[*own, *[NOTHING] * (footprints - len(own))] for own in self.footprints]

    def add(self, grid, model, rows, log_odds, sign=1, threads=1):
        """Add the pings of each row of indices."""
        device = log_odds.device
        poses = [[*p, *quaternion(o)] for p, o in zip(self.position, self.orientation, strict=True)]
        field.update_field(
            grid,
            model,
            wp.array(rows, dtype=int, device=device).reshape((len(rows), -1)),
            wp.array(self.owner, dtype=int, device=device),
            wp.array(poses, dtype=wp.transform, device=device),
            wp.array(np.array(self.padded).reshape(len(self.owner), -1, 3), dtype=wp.vec3, device=device),
            sign,
            log_odds,
            device=device,
            threads=threads,
        )


def evidence(device, position, orientation, footprints, grid=None, **changed):
    """Counts of one ping in a field that knew nothing, shape [x, y, z]."""
    grid = grid or make_grid(device)
    log_odds = fields(grid)
    Pings([(0, position, orientation, footprints)]).add(grid, make_model(**changed), [[0]], log_odds)
    return log_odds.numpy()[0]


def random_footprints(rng):
    """None to three footprints, from a point's to a flat seabed's."""
    edges = np.sort(rng.uniform(0.3, 2.5, 6))[: 2 * rng.integers(0, 4)].reshape(-1, 2)
    return [(near, rng.uniform(near, far), far) for near, far in edges]


def random_pings(rng, number, owners=1):
    """Heads anywhere around the box, at any attitude, that look at a place inside."""
    pings = []
    for ping in range(number):
        target = np.array(ORIGIN) + 0.05 * np.array(SHAPE) * rng.uniform(size=3)
        forward = rng.normal(size=3)
        forward /= np.linalg.norm(forward)
        left = np.cross(rng.normal(size=3), forward)
        left /= np.linalg.norm(left)
        orientation = np.column_stack([forward, left, np.cross(forward, left)])
        pings.append((ping % owners, target - rng.uniform(0.0, 2.0) * forward, orientation, random_footprints(rng)))
    return pings


# Attitudes at which a vertical line is parallel to the scan plane, to a face of the beam or to its axis.
SIDEWAYS = rotation("x", np.pi / 2)
SPECIAL = {
    "level, upright": FORWARDS,
    "level, on its side": SIDEWAYS,
    "level, on its other side": SIDEWAYS.T,
    "straight down": rotation("y", np.pi / 2) @ SIDEWAYS,
    "straight down, one face vertical": rotation("y", np.pi / 2) @ SIDEWAYS @ rotation("z", np.sqrt(2) * 0.0523599),
    "straight up": rotation("y", -np.pi / 2),
    "backwards and down": sonar_rotation(np.pi / 2, 2.0, 0.3),
    "as the paper's, on its side": sonar_rotation(np.pi / 2, np.radians(40), 0.0),
    "rolled and yawed": sonar_rotation(1.2, 0.7, -2.0),
}


def special_pings():
    """Each attitude, with the middle of the box 0.9 m ahead."""
    middle = np.array(ORIGIN) + 0.5 * 0.05 * np.array(SHAPE)
    prints = [(0.85, 0.9, 0.93), (1.0, 1.15, 1.3)]
    return [(0, middle - 0.9 * orientation[:, 0], orientation, prints) for orientation in SPECIAL.values()]


def excess(got, grid, model, ping, owner=0):
    """Count error of each cell that the oracle touches, and how much of it rounding explains; none elsewhere."""
    _, position, orientation, footprints = ping
    points = reference.cell_centres(grid, owner)
    want = COUNTS * reference.ping_log_odds(points, model, position, orientation, footprints)
    # Float32 positions of some metres err by this much; what such a shift changes is no fault. It lets go of the cells
    # at the fan's border, where evidence begins at once.
    shift = 4 * EPSILON * max(np.abs(points).max(), np.abs(position).max())
    slack = np.ones(want.shape)
    for axis in np.eye(3):
        moved = [
            COUNTS * reference.ping_log_odds(points, model, position + side * shift * axis, orientation, footprints)
            for side in (-1, 1)
        ]
        slack += np.max([np.abs(other - want) for other in moved], axis=0)
    error = np.abs(got - want)
    assert np.all(error <= slack)
    return np.stack([error[want != 0], slack[want != 0]])


# --- What a ping says ---


@pytest.mark.parametrize(("half_width_deg", "compact"), [(0.9, np.inf), (3.0, np.inf), (3.0, 1.5), (15.0, np.inf)])
def test_random_pings_match_the_oracle_in_every_cell(device, half_width_deg, compact):
    pings = random_pings(np.random.default_rng(31), 60, owners=60)
    grid = make_grid(device, [ORIGIN] * 60)
    model = make_model(half_width=np.radians(half_width_deg), compact=compact, no_return=-0.5)
    log_odds = fields(grid)
    Pings(pings).add(grid, model, [[ping] for ping in range(60)], log_odds)
    found = [excess(got, grid, model, ping) for got, ping in zip(log_odds.numpy(), pings, strict=True)]
    error, slack = np.concatenate(found, axis=1)
    # Most cells agree to the count, and no cell is let go lightly: a hit is 131,072 counts.
    assert np.mean(error <= 1) > 0.85
    assert np.median(slack) < 4
    assert len(error) > 3000


@pytest.mark.parametrize("name", SPECIAL)
def test_attitudes_with_a_vertical_face_or_axis_match_the_oracle(device, name):
    ping = special_pings()[list(SPECIAL).index(name)]
    grid, model = make_grid(device), make_model()
    error, slack = excess(evidence(device, *ping[1:]), grid, model, ping)
    assert np.mean(error <= 1) > 0.85
    assert np.median(slack) < 4
    assert len(error) > 50


def thin(distance):
    """Footprint of a wall square to the beam."""
    return (distance - 1e-4, distance, distance + 1e-4)


def axis_counts(device, footprints, range_deviation=0.01, **changed):
    """Counts in cells along the axis of a level beam, and the cells' distances."""
    grid = make_grid(device, [(0.0, -0.025, -0.025)], shape=(40, 1, 1))
    changed["range_deviation"] = range_deviation
    got = evidence(device, (0.0, 0.0, 0.0), FORWARDS, footprints, grid=grid, **changed)
    return got[:, 0, 0], 0.05 * (np.arange(40) + 0.5)


def test_all_is_free_before_a_return_occupied_at_it_and_unknown_behind(device):
    got, distance = axis_counts(device, [thin(1.025)])
    free, behind = distance < 0.99, distance > 1.07
    assert np.all(got[free] == -COUNTS)
    assert got[20] == pytest.approx(2 * COUNTS, rel=1e-4)
    assert np.all(got[behind] == 0)
    assert (free.sum(), behind.sum()) == (20, 19)


@pytest.mark.parametrize(("compact", "occupied"), [(1.99, False), (2.01, True), (np.inf, True)])
def test_a_footprint_too_wide_is_not_occupied_and_the_water_before_it_is_free(device, compact, occupied):
    # Twice as long as the beam is wide there: 0.8 of that lies between its ends.
    half = 0.8 * np.radians(6.0) * 1.025
    got, distance = axis_counts(device, [(1.025 - half, 1.025, 1.025 + half)], compact=compact)
    assert np.all(got[distance < 0.98] < -0.9 * COUNTS)
    assert got[20] == pytest.approx(2 * COUNTS if occupied else 0.0, abs=4)
    assert np.all(got[distance > 1.07] == 0)


def test_between_two_returns_nothing_is_said(device):
    got, distance = axis_counts(device, [thin(0.525), thin(1.525)])
    assert np.all(got[distance < 0.49] == -COUNTS)
    assert np.all(got[(distance > 0.57) & (distance < 1.47)] == 0)
    assert got[[10, 30]] == pytest.approx(2 * COUNTS, rel=1e-4)
    assert np.all(got[distance > 1.57] == 0)


@pytest.mark.parametrize(("no_return", "reach"), [(0.0, 2.0), (-0.5, 2.0), (-0.5, 1.0)])
def test_a_ping_without_a_return_says_what_it_is_told_to_up_to_its_reach(device, no_return, reach):
    got, distance = axis_counts(device, [], no_return=no_return, reach=reach)
    assert np.array_equal(got, np.where(distance < reach, no_return * COUNTS, 0.0))


@pytest.mark.parametrize("footprints", [[(1.0, 1.1, 1.2)], []])
def test_outside_of_the_fan_nothing_is_said(device, footprints):
    grid = make_grid(device, [(-1.0, -1.0, -1.0)], shape=(40, 40, 40))
    got = evidence(device, (0.0, 0.0, 0.0), FORWARDS, footprints, grid=grid, no_return=-1.0, half_width=0.1)
    x, y, z = np.moveaxis(reference.cell_centres(grid), -1, 0)
    in_plane = np.arctan2(y, x)
    across = np.arcsin(z / np.sqrt(x**2 + y**2 + z**2))
    outside = (np.abs(in_plane) > np.sqrt(2) * 0.1) | (np.abs(across) > np.radians(10.0))
    assert not got[outside].any()
    assert np.all(got[(np.abs(in_plane) < 0.13) & (np.abs(across) < np.radians(9.9)) & (x < 0.6)] < 0)


def test_evidence_fades_off_the_axis_to_half_at_the_half_width(device):
    # Five cells abreast at 1 m: 0, 1/2, 1 half widths off, and so to both sides.
    grid = make_grid(device, [(0.975, -0.125, -0.025)], shape=(1, 5, 1))
    got = evidence(device, (0.0, 0.0, 0.0), FORWARDS, [], grid=grid, no_return=-1.0, half_width=0.1)
    np.testing.assert_allclose(got[0, :, 0] / -COUNTS, [0.5, 0.875, 1.0, 0.875, 0.5], atol=2e-5)


def range_of_peak(device, orientation, footprint, side):
    """Range at which evidence peaks on the ray at ``side`` half widths, in a scan plane that stands upright."""
    model = make_model(range_deviation=0.01)
    elevation = side * model.half_width
    forward, left = orientation[:, 0], orientation[:, 1]
    # Along that ray stand fields of a single cell.
    ranges = np.arange(1.6, 2.4, 0.01)
    points = [r * (np.cos(elevation) * forward + np.sin(elevation) * left * np.sign(left[2])) for r in ranges]
    grid = make_grid(device, [point - 0.002 for point in points], cell=0.004, shape=(1, 1, 1))
    log_odds = fields(grid)
    pings = [(index, np.zeros(3), orientation, [footprint]) for index in range(len(points))]
    Pings(pings).add(grid, model, [[index] for index in range(len(points))], log_odds)
    return ranges[np.argmax(log_odds.numpy().ravel())]


@pytest.mark.parametrize("roll", [np.pi / 2, -np.pi / 2])
def test_a_flat_surface_is_met_later_by_shallower_rays_whichever_side_the_head_lies_on(device, roll):
    orientation = sonar_rotation(roll, np.radians(20.0), 0.0)
    wall = 2 * make_model().half_width * 2.0
    flat = (2.0 - wall, 2.0, 2.0 + wall)
    peaks = [range_of_peak(device, orientation, flat, side) for side in (-0.9, 0.0, 0.9)]
    # All of the footprint, wider than two walls', is tilt over the beam's width.
    assert np.diff(peaks) == pytest.approx([0.45 * 2.5 * wall] * 2, abs=0.011)


@pytest.mark.parametrize("roll", [np.pi / 2, -np.pi / 2])
def test_a_wall_is_met_at_one_range_by_all_rays(device, roll):
    orientation = sonar_rotation(roll, np.radians(20.0), 0.0)
    short = 0.4 * 2 * make_model().half_width * 2.0
    peaks = [range_of_peak(device, orientation, (2.0 - short, 2.0, 2.0 + short), side) for side in (-0.9, 0.0, 0.9)]
    assert np.ptp(peaks) < 0.011


def test_a_head_on_its_other_side_says_the_same(device):
    for _, position, orientation, footprints in random_pings(np.random.default_rng(32), 20):
        over = orientation @ np.diag([1.0, -1.0, -1.0])
        got, want = (evidence(device, position, attitude, footprints) for attitude in (orientation, over))
        # Turned by half, positions round differently; cells at the fan's border may fall to either side.
        assert np.mean(np.abs(got - want) > 20) < 2e-3


# --- Sums (Eq. 21) ---


def test_pings_taken_out_in_any_order_leave_exactly_nothing(device):
    rng = np.random.default_rng(33)
    pings, grid, model = Pings(random_pings(rng, 12)), make_grid(device), make_model(no_return=-0.3)
    log_odds = fields(grid)
    for ping in range(12):
        pings.add(grid, model, [[ping]], log_odds)
    assert np.count_nonzero(log_odds.numpy()) > 500
    for ping in rng.permutation(12):
        pings.add(grid, model, [[ping]], log_odds, sign=-1)
    assert not log_odds.numpy().any()


def test_a_window_holds_what_its_pings_alone_would(device):
    window = 4
    pings = Pings(random_pings(np.random.default_rng(34), 15))
    grid, model = make_grid(device), make_model(no_return=-0.3)
    log_odds = fields(grid)
    for newest in range(15):
        pings.add(grid, model, [[newest]], log_odds)
        if newest >= window:
            pings.add(grid, model, [[newest - window]], log_odds, sign=-1)
        alone = fields(grid)
        # Newest first: the order does not matter either.
        for ping in range(newest, max(newest - window, -1), -1):
            pings.add(grid, model, [[ping]], alone)
        assert np.array_equal(log_odds.numpy(), alone.numpy())


def test_a_row_of_pings_adds_up_and_empty_slots_add_nothing(device):
    pings, grid, model = Pings(random_pings(np.random.default_rng(35), 3)), make_grid(device), make_model()
    together, apart = fields(grid), fields(grid)
    pings.add(grid, model, [[2, EMPTY, 0, 1, EMPTY]], together)
    for ping in range(3):
        pings.add(grid, model, [[ping]], apart)
    assert np.array_equal(together.numpy(), apart.numpy())
    assert together.numpy().any()
    pings.add(grid, model, [[EMPTY, EMPTY], [EMPTY, EMPTY]], together)
    assert np.array_equal(together.numpy(), apart.numpy())


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_trajectories_in_one_call_are_as_each_alone(device, threads):
    origins = [ORIGIN, (0.7, -0.4, 0.6), (1.2, -0.6, 0.4)]
    pings = random_pings(np.random.default_rng(36), 6, owners=3)
    grid, model = make_grid(device, origins), make_model(no_return=-0.3)
    together = fields(grid)
    # A row per trajectory, in another order than the trajectories'.
    Pings(pings).add(grid, model, [[1, 4], [2, 5], [0, 3]], together, threads=threads)
    for owner, origin in enumerate(origins):
        grid = make_grid(device, [origin])
        alone = fields(grid)
        Pings([(0, *ping[1:]) for ping in pings[owner::3]]).add(grid, model, [[0, 1]], alone)
        assert alone.numpy().any()
        assert np.array_equal(together.numpy()[owner], alone.numpy()[0])


# --- Heights within the beam ---


def test_a_box_in_larger_arrays_is_written_as_if_it_were_alone(device):
    """What another trajectory needs must not give this one cells that it has not alone."""
    size, model = (15, 20, 9), make_model(no_return=-0.3)
    pings = Pings(random_pings(np.random.default_rng(41), 12))
    counts = []
    for grid in (make_grid(device, shape=size), make_grid(device, sizes=[size])):
        log_odds = fields(grid)
        pings.add(grid, model, [list(range(12))], log_odds)
        counts.append(log_odds.numpy()[0])
    alone, shared = counts
    inside = tuple(slice(count) for count in size)
    assert np.count_nonzero(alone) > 100
    assert np.array_equal(shared[inside], alone)
    shared[inside] = 0
    assert not shared.any()


@wp.kernel
def span_kernel(
    start: wp.array(dtype=wp.vec3),
    rise: wp.array(dtype=wp.vec3),
    height: float,
    slope: float,
    span_out: wp.array(dtype=wp.vec2),
):
    line = wp.tid()
    span_out[line] = field.column_span(start[line], rise[line], height, slope)


def column_spans(device, start, rise, height, slope):
    start, rise = (wp.array(values, dtype=wp.vec3, device=device) for values in (start, rise))
    out = wp.zeros(len(start), dtype=wp.vec2, device=device)
    wp.launch(span_kernel, len(start), inputs=[start, rise, height, slope], outputs=[out], device=device)
    return out.numpy()


def lines(rng, number):
    """Vertical lines, in frames of heads at any attitude, the special ones first."""
    turned = [*SPECIAL.values(), *Rotation.random(number, random_state=rng).as_matrix()]
    rise = np.array([orientation.T @ [0.0, 0.0, 1.0] for orientation in turned])
    rise = np.repeat(rise, 20, axis=0)
    return rng.uniform([-0.5, -0.5, -2], [2, 0.5, 2], (len(rise), 3)), rise


@pytest.mark.parametrize("half_width", [0.02, 0.3, 1.2])
def test_a_column_s_span_is_where_its_points_lie_in_the_beam(device, half_width):
    start, rise = lines(np.random.default_rng(37), 100)
    height, slope = 1.5, float(np.tan(half_width))
    span = column_spans(device, start, rise, height, slope)
    heights = np.linspace(0.0, height, 301)
    x, y, _ = np.moveaxis(start[:, None] + heights[:, None] * rise[:, None], -1, 0)
    inside = np.abs(np.arctan2(y, x)) <= half_width
    within = (span[:, :1] <= heights) & (heights <= span[:, 1:]) & (span[:, :1] < span[:, 1:])
    # A few roundings of coordinates around 2 m.
    doubtful = np.abs(slope * x - np.abs(y)) < 8 * EPSILON * 2 * (1 + slope)
    assert np.array_equal(inside | doubtful, within | doubtful)
    assert np.mean(doubtful) < 1e-3
    share = np.mean(inside)
    assert 0.01 < share < 0.9


@pytest.mark.parametrize("x", [-1.0, 0.5])
def test_a_span_stays_within_the_column_however_far_its_roots_are(device, x):
    # Nearly parallel to a face, roots lie thousands of kilometres off.
    rise = np.array([[3e-7, 0.0, 1.0], [-3e-7, 0.0, 1.0], [0.0, 3e-7, 1.0], [0.0, -3e-7, 1.0], [0.0, 0.0, 1.0]])
    span = column_spans(device, np.tile([x, 0.0, 0.0], (5, 1)), rise, 2.0, 1.0)
    assert np.all((span >= 0.0) & (span <= 2.0))
    assert np.all(span[:, 0] < span[:, 1]) if x > 0 else np.all(span[:, 0] >= span[:, 1])


# --- Reading (Eq. 22) ---


@wp.kernel
def read_kernel(
    grid: Grid,
    log_odds: wp.array4d(dtype=int),
    owner: int,
    point: wp.array(dtype=wp.vec3),
    low: float,
    high: float,
    value_out: wp.array(dtype=float),
):
    index = wp.tid()
    value_out[index] = field.read_log_odds(grid, log_odds, owner, point[index], low, high)


@wp.kernel
def occupancy_kernel(log_odds: wp.array(dtype=float), occupancy_out: wp.array(dtype=float)):
    index = wp.tid()
    occupancy_out[index] = field.occupancy(log_odds[index])


def read(device, grid, log_odds, owner, points, low=-4.0, high=6.0):
    point = wp.array(points, dtype=wp.vec3, device=device)
    out = wp.zeros(len(points), dtype=float, device=device)
    inputs = [grid, log_odds, owner, point, low, high]
    wp.launch(read_kernel, len(points), inputs=inputs, outputs=[out], device=device)
    return out.numpy()


def occupancies(device, values):
    out = wp.zeros(len(values), dtype=float, device=device)
    wp.launch(occupancy_kernel, len(values), inputs=[wp.array(values, dtype=float, device=device), out], device=device)
    return out.numpy()


def random_fields(device, rng):
    """Two boxes whose cells hold more than the clamps allow."""
    origins = np.array([ORIGIN, (-3.0, 2.0, -1.0)])
    grid = make_grid(device, origins, shape=(6, 5, 4))
    counts = rng.integers(-10 * 65536, 10 * 65536, (2, 6, 5, 4))
    return grid, counts, wp.array(counts, dtype=int, device=device), origins


@pytest.mark.parametrize("owner", [0, 1])
def test_reading_is_trilinear_between_clamped_cells_and_unknown_outside(device, owner):
    rng = np.random.default_rng(38)
    grid, counts, log_odds, origins = random_fields(device, rng)
    size = 0.05 * np.array([6, 5, 4])
    # Half of the points inside, the others around the box, some far away.
    points = origins[owner] + size * np.concatenate(
        [rng.uniform(0, 1, (500, 3)), rng.uniform(-0.6, 1.6, (500, 3)), rng.uniform(-1e4, 1e4, (50, 3))]
    )
    points = points.astype(np.float32)
    got = read(device, grid, log_odds, owner, points)
    want = reference.read_log_odds(
        counts[owner], origins[owner].astype(np.float32), float(grid.cell), points, -4.0, 6.0
    )
    # A point is known to an epsilon of its 3 m: a share of a cell, times the greatest step between two cells, 10.
    np.testing.assert_allclose(got, want, atol=3 * 10 * 4 * EPSILON / 0.05)
    assert np.ptp(got[:500]) > 5
    assert not got[-50:].any()


def test_reading_at_a_cell_s_centre_is_that_cell_clamped(device):
    grid, counts, log_odds, _ = random_fields(device, np.random.default_rng(39))
    centres = reference.cell_centres(grid).reshape(-1, 3)
    got = read(device, grid, log_odds, 0, centres)
    np.testing.assert_allclose(got, np.clip(counts[0].ravel() / COUNTS, -4, 6), atol=3 * 10 * 4 * EPSILON / 0.05)


@pytest.mark.parametrize("owner", [0, 1])
def test_cells_beyond_a_box_are_unknown_whatever_its_arrays_hold(device, owner):
    rng = np.random.default_rng(42)
    grid, counts, log_odds, origins = random_fields(device, rng)
    sizes = np.array([(4, 5, 2), (6, 3, 3)])
    grid.size = wp.array(sizes, dtype=wp.vec3i, device=device)
    points = origins[owner] + 0.05 * np.array([6, 5, 4]) * rng.uniform(-0.2, 1.2, (500, 3))
    got = read(device, grid, log_odds, owner, points)
    x, y, z = sizes[owner]
    alone = make_grid(device, origins[[owner]], shape=tuple(sizes[owner]))
    cropped = wp.array(counts[[owner], :x, :y, :z], dtype=int, device=device)
    assert np.array_equal(got, read(device, alone, cropped, 0, points))
    assert np.count_nonzero(got) > 100


def test_what_is_unknown_is_a_coin_toss(device):
    grid = make_grid(device)
    assert occupancies(device, [0.0]).tolist() == [0.5]
    assert not read(device, grid, fields(grid), 0, reference.cell_centres(grid).reshape(-1, 3)).any()


def test_occupancy_is_the_printed_formula_with_all_its_digits(device):
    values = np.linspace(-80.0, 80.0, 321)
    # 1 - 1 / (1 + exp l)
    want = -np.expm1(-np.log1p(np.exp(values)))
    # exp of l errs by l epsilon.
    np.testing.assert_allclose(occupancies(device, values), want, rtol=100 * EPSILON)


@pytest.mark.parametrize("threads", [1, 3])
def test_each_point_asks_its_own_trajectory_s_field(device, threads):
    rng = np.random.default_rng(40)
    grid, _, log_odds, origins = random_fields(device, rng)
    owner = rng.integers(0, 2, 50)
    points = origins[owner] + rng.uniform(0.0, 0.2, (50, 3))
    got = wp.zeros(50, dtype=float, device=device)
    field.read_field(
        grid,
        log_odds,
        wp.array(owner, dtype=int, device=device),
        wp.array(points, dtype=wp.vec3, device=device),
        -4.0,
        6.0,
        got,
        device=device,
        threads=threads,
    )
    for index in (0, 1):
        alone = occupancies(device, read(device, grid, log_odds, index, points[owner == index]))
        assert np.array_equal(got.numpy()[owner == index], alone)


# --- Refusals ---


def update_arrays(device):
    return {
        "slot_ping": wp.zeros((2, 3), dtype=int, device=device),
        "trajectory": wp.zeros(4, dtype=int, device=device),
        "world_from_head": wp.zeros(4, dtype=wp.transform, device=device),
        "footprint": wp.zeros((4, 2), dtype=wp.vec3, device=device),
        "log_odds_out": wp.zeros((1, *SHAPE), dtype=int, device=device),
    }


@pytest.mark.parametrize(
    ("wrong", "shape", "dtype", "message"),
    [
        ("slot_ping", (3,), int, r"slot_ping: expected shape \(any, any\), got \(3,\)"),
        ("trajectory", (4, 1), int, r"trajectory: expected shape \(any,\), got \(4, 1\)"),
        ("world_from_head", (3,), wp.transform, r"world_from_head: expected shape \(4,\), got \(3,\)"),
        ("footprint", (3, 2), wp.vec3, r"footprint: expected shape \(4, any\), got \(3, 2\)"),
        ("footprint", (4, 2), float, "footprint: expected dtype vec3f, got float32"),
        ("log_odds_out", (2, *SHAPE), int, r"log_odds_out: expected shape \(1, 24, 20, 16\), got \(2, 24, 20, 16\)"),
        ("log_odds_out", (1, *SHAPE), float, "log_odds_out: expected dtype int32, got float32"),
    ],
)
def test_wrong_arrays_of_an_update_are_refused_by_name(device, wrong, shape, dtype, message):
    arrays = update_arrays(device) | {wrong: wp.zeros(shape, dtype=dtype, device=device)}
    with pytest.raises(ValueError, match=message):
        field.update_field(grid=make_grid(device), model=make_model(), sign=1, **arrays, device=device)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"half_width": 0.0}, r"model\.half_width: must be above 0 and at most 1, got 0"),
        ({"half_width": 1.1}, r"model\.half_width: must be above 0 and at most 1, got 1\.1"),
        ({"half_fan": float("nan")}, r"model\.half_fan: must be above 0 and at most 1\.5708, got nan"),
        ({"compact": -1.0}, r"model\.compact: must be at least 0, got -1"),
        ({"range_deviation": -0.1}, r"model\.range_deviation: must be above 0 and at most inf, got -0\.1"),
    ],
)
def test_a_model_out_of_bounds_is_refused_by_name(device, changed, message):
    with pytest.raises(ValueError, match=message):
        field.update_field(make_grid(device), make_model(**changed), sign=1, **update_arrays(device), device=device)


@pytest.mark.parametrize("sign", [0, 2, -3])
def test_a_ping_is_added_or_taken_out(device, sign):
    with pytest.raises(ValueError, match=f"sign: {sign} is neither 1 nor -1"):
        field.update_field(make_grid(device), make_model(), sign=sign, **update_arrays(device), device=device)


def test_a_grid_without_cells_of_some_size_or_without_boxes_is_refused_by_name(device):
    with pytest.raises(ValueError, match=r"grid\.cell: must be above 0, got 0\.0"):
        field.update_field(make_grid(device, cell=0.0), make_model(), sign=1, **update_arrays(device), device=device)
    empty = Grid()
    empty.cell = 0.05
    with pytest.raises(ValueError, match=r"grid\.origin: expected a warp array, got NoneType"):
        field.update_field(empty, make_model(), sign=1, **update_arrays(device), device=device)
    two = make_grid(device, sizes=[SHAPE, SHAPE])
    with pytest.raises(ValueError, match=r"grid\.size: expected shape \(1,\), got \(2,\)"):
        field.update_field(two, make_model(), sign=1, **update_arrays(device), device=device)


@pytest.mark.parametrize(
    ("wrong", "shape", "dtype", "message"),
    [
        ("log_odds", (1, 2, 3, 4), int, r"log_odds: expected shape \(1, 24, 20, 16\), got \(1, 2, 3, 4\)"),
        ("trajectory", (4,), int, r"trajectory: expected shape \(5,\), got \(4,\)"),
        ("point", (5,), float, "point: expected dtype vec3f, got float32"),
        ("occupancy_out", (4,), float, r"occupancy_out: expected shape \(5,\), got \(4,\)"),
    ],
)
def test_wrong_arrays_of_a_reading_are_refused_by_name(device, wrong, shape, dtype, message):
    arrays = {
        "log_odds": wp.zeros((1, *SHAPE), dtype=int, device=device),
        "trajectory": wp.zeros(5, dtype=int, device=device),
        "point": wp.zeros(5, dtype=wp.vec3, device=device),
        "occupancy_out": wp.zeros(5, dtype=float, device=device),
    }
    arrays[wrong] = wp.zeros(shape, dtype=dtype, device=device)
    with pytest.raises(ValueError, match=message):
        field.read_field(make_grid(device), low=-1.0, high=1.0, **arrays, device=device)
