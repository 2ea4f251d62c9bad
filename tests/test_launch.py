"""Launches cut into pieces, spread over threads and captured into graphs; arrays refused before a kernel reads them."""

import os
import threading

import numpy as np
import pytest
import warp as wp

from sonarwarp_kernels.launch import check_array, cpu_threads, lanes, launch


@wp.kernel
def visit_kernel(first: int, step: int, visits_out: wp.array3d(dtype=int), where_out: wp.array3d(dtype=int)):
    row, i, j = wp.tid()
    row += first
    visits_out[row, i, j] = visits_out[row, i, j] + step
    where_out[row, i, j] = (row * visits_out.shape[1] + i) * visits_out.shape[2] + j


@wp.kernel
def lane_kernel(first: int, lane_count: int, visits_out: wp.array2d(dtype=int)):
    row, lane = wp.tid()
    row += first
    for i in range(lane, visits_out.shape[1], lane_count):
        visits_out[row, i] = visits_out[row, i] + 1


def visit(shape, device, threads):
    visits = wp.zeros(shape, dtype=int, device=device)
    where = wp.full(shape, -1, dtype=int, device=device)
    launch(visit_kernel, shape, [1], [visits, where], device, threads)
    return visits.numpy(), where.numpy()


@pytest.fixture
def launches(monkeypatch):
    """Records, for every launch of a kernel, its first row, its dimensions and the thread that made it."""
    made = []
    warp_launch = wp.launch

    def record(kernel, dim, inputs, **options):
        made.append((inputs[0], dim, threading.current_thread()))
        warp_launch(kernel, dim, inputs=inputs, **options)

    monkeypatch.setattr(wp, "launch", record)
    return made


# Rows against pieces: none to spare, fewer than pieces, as many, one over, a prime, many.
@pytest.mark.parametrize("rows", [1, 2, 3, 7, 8, 9, 31, 1000])
@pytest.mark.parametrize("threads", [0, 1, 2, 3, 8])
def test_every_row_is_visited_exactly_once(device, rows, threads):
    shape = (rows, 3, 5)
    visits, where = visit(shape, device, threads)
    assert np.array_equal(visits, np.ones(shape))
    assert np.array_equal(where, np.arange(rows * 15).reshape(shape))


@pytest.mark.parametrize("shape", [(0, 3, 5), (4, 0, 5), (4, 3, 0)])
@pytest.mark.parametrize("threads", [1, 4])
def test_an_empty_axis_launches_nothing(device, shape, threads, launches):
    visit(shape, device, threads)
    assert launches == []


@pytest.mark.parametrize("rows", [2, 5, 16, 1000])
def test_cpu_threads_share_pieces_that_join_up(rows, launches):
    visit((rows, 3, 5), "cpu", 4)
    pieces = sorted((first, dim[0]) for first, dim, _ in launches)
    assert len(pieces) == min(rows, 16)
    assert [first for first, _ in pieces] == [0, *np.cumsum([length for _, length in pieces])[:-1]]
    assert sum(length for _, length in pieces) == rows
    assert max(length for _, length in pieces) - min(length for _, length in pieces) <= 1
    assert all(dim[1:] == (3, 5) for _, dim, _ in launches)
    assert threading.main_thread() not in [thread for _, _, thread in launches]


def test_one_thread_launches_once_and_by_itself(device, launches):
    visit((1000, 3, 5), device, 1)
    assert [(first, dim) for first, dim, _ in launches] == [(0, (1000, 3, 5))]
    assert launches[0][2] is threading.current_thread()


def test_an_error_in_a_piece_reaches_the_caller():
    visits = wp.zeros((8, 3, 5), dtype=int, device="cpu")
    where = wp.zeros((8, 3, 5), dtype=float, device="cpu")
    with pytest.raises(RuntimeError, match="where_out"):
        launch(visit_kernel, (8, 3, 5), [1], [visits, where], "cpu", 4)


@pytest.mark.parametrize("threads", [1, 4])
def test_a_captured_launch_does_nothing_until_replayed_and_then_what_an_eager_one_does(device, threads):
    shape = (64, 3, 5)
    eager_visits, eager_where = visit(shape, device, threads)
    visits = wp.zeros(shape, dtype=int, device=device)
    where = wp.full(shape, -1, dtype=int, device=device)
    with wp.ScopedCapture(device=device) as capture:
        launch(visit_kernel, shape, [1], [visits, where], device, threads)
    assert not visits.numpy().any(), "launched eagerly, which leaves the graph empty"
    wp.capture_launch(capture.graph)
    assert np.array_equal(visits.numpy(), eager_visits)
    assert np.array_equal(where.numpy(), eager_where)
    wp.capture_launch(capture.graph)
    assert np.array_equal(visits.numpy(), 2 * eager_visits)


@pytest.mark.parametrize("bins", [1, 31, 32, 33, 512])
def test_lanes_share_every_bin_once(device, bins):
    visits = wp.zeros((5, bins), dtype=int, device=device)
    launch(lane_kernel, (5, lanes(device)), [lanes(device)], [visits], device, 2)
    assert np.array_equal(visits.numpy(), np.ones((5, bins)))


def test_threads_do_not_exceed_the_cores_of_this_process():
    assert 1 <= cpu_threads() <= (os.cpu_count() or 1)


@pytest.mark.parametrize("shape", [(4, 96, 512), (None, 96, 512), (4, None, None), (None, None, None)])
def test_a_fitting_array_is_accepted(device, shape):
    check_array("image_out", wp.zeros((4, 96, 512), dtype=float, device=device), shape, wp.float32, device)


@pytest.mark.parametrize(
    ("expected", "got", "message"),
    [
        ((4, 96, 512), (4, 512, 96), "image_out: expected shape (4, 96, 512), got (4, 512, 96)"),
        ((4, 96, 512), (4, 96), "image_out: expected shape (4, 96, 512), got (4, 96)"),
        ((None, 96, 512), (7, 96, 511), "image_out: expected shape (any, 96, 512), got (7, 96, 511)"),
        ((3,), (0,), "image_out: expected shape (3,), got (0,)"),
        ((3,), (3, 1), "image_out: expected shape (3,), got (3, 1)"),
    ],
)
def test_a_wrong_shape_is_told_with_the_right_one(device, expected, got, message):
    with pytest.raises(ValueError, match="expected") as error:
        check_array("image_out", wp.zeros(got, dtype=float, device=device), expected, wp.float32, device)
    assert str(error.value) == message


@pytest.mark.parametrize(
    ("given", "kind"), [(np.zeros(3, dtype=np.float32), "ndarray"), ([0.0, 0.0, 0.0], "list"), (None, "NoneType")]
)
def test_what_is_not_a_warp_array_is_refused(device, given, kind):
    with pytest.raises(ValueError, match=rf"^echo: expected a warp array, got {kind}$"):
        check_array("echo", given, (3,), wp.float32, device)


def test_an_indexed_array_is_refused(device):
    base = wp.zeros(3, dtype=float, device=device)
    indexed = wp.indexedarray(base, [wp.array([2, 0], dtype=int, device=device)])
    with pytest.raises(ValueError, match=r"^echo: expected a warp array, got indexedarray$"):
        check_array("echo", indexed, (2,), wp.float32, device)


def test_a_wrong_type_is_refused(device):
    with pytest.raises(ValueError, match=r"^echo: expected dtype float32, got float64$"):
        check_array("echo", wp.zeros(3, dtype=wp.float64, device=device), (3,), wp.float32, device)


def test_an_array_of_another_device_is_refused(device, monkeypatch):
    array = wp.zeros(3, dtype=float, device=device)
    monkeypatch.setattr(array, "device", "elsewhere")
    with pytest.raises(ValueError, match=rf"^echo: expected device {device}, got elsewhere$"):
        check_array("echo", array, (3,), wp.float32, device)


@pytest.mark.parametrize(("stride", "refused"), [(2**31 - 4, False), (2**31, True), (2**33, True)])
def test_a_stride_beyond_32_bits_is_refused(device, stride, refused):
    base = wp.zeros(5, dtype=float, device=device)
    # Never read: only the first row lies in memory.
    array = wp.array(ptr=base.ptr, shape=(2, 5), strides=(stride, 4), dtype=float, device=device)
    if refused:
        with pytest.raises(ValueError, match=rf"^field: stride of {stride} bytes, must be under {2**31}$"):
            check_array("field", array, (2, 5), wp.float32, device)
    else:
        check_array("field", array, (2, 5), wp.float32, device)
