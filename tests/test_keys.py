"""Keys: independent streams, no dependence on order, exact agreement with an integer oracle."""

import numpy as np
import pytest
import warp as wp

from sonarwarp_kernels import keys
from tests.reference.keys import mix_key


@wp.kernel
def draw_kernel(
    key: wp.array(dtype=wp.uint64), uniform_out: wp.array(dtype=float), rayleigh_out: wp.array(dtype=float)
):
    row, index = wp.tid()
    n = uniform_out.shape[0] // key.shape[0]
    draw = keys.mix_key(key[row], index)
    uniform_out[row * n + index] = keys.uniform(draw)
    rayleigh_out[row * n + index] = keys.rayleigh(draw)


def frame_keys(seeds, trajectory_keys, trajectory, number, sonar, device):
    out = wp.zeros(len(trajectory), dtype=wp.uint64, device=device)
    keys.frame_keys(
        wp.array(seeds, dtype=wp.uint64, device=device),
        wp.array(trajectory_keys, dtype=wp.uint64, device=device),
        wp.array(trajectory, dtype=int, device=device),
        wp.array(number, dtype=int, device=device),
        sonar,
        out,
        device=device,
    )
    return out


def test_frame_keys_match_integer_oracle(device):
    got = frame_keys([7, 2**63 + 5], [11, 2**64 - 1], [0, 1, 1], [0, 5, 2**31 - 1], 2, device).numpy()
    for value, (seed, owner, number) in zip(
        got, [(7, 11, 0), (2**63 + 5, 2**64 - 1, 5), (2**63 + 5, 2**64 - 1, 2**31 - 1)], strict=True
    ):
        assert int(value) == mix_key(mix_key(seed, 2) ^ owner, number)


def test_a_key_does_not_depend_on_its_place_in_the_batch(device):
    batch = frame_keys([1, 2, 3], [4, 5, 6], [2, 0, 1, 2], [9, 9, 9, 8], 1, device).numpy()
    alone = frame_keys([3], [6], [0, 0], [9, 8], 1, device).numpy()
    assert np.array_equal(batch[[0, 3]], alone)
    assert len(set(batch.tolist())) == 4


@pytest.mark.parametrize("changed", ["seed", "trajectory", "number", "sonar"])
def test_streams_are_uncorrelated(device, changed):
    base = {"seed": 1, "trajectory": 1, "number": 1, "sonar": 1}
    values = []
    n = 20000
    for arguments in (base, {**base, changed: 2}):
        key = frame_keys(
            [arguments["seed"]], [arguments["trajectory"]], [0], [arguments["number"]], arguments["sonar"], device
        )
        uniform = wp.zeros(n, dtype=float, device=device)
        rayleigh = wp.zeros(n, dtype=float, device=device)
        wp.launch(draw_kernel, (1, n), inputs=[key], outputs=[uniform, rayleigh], device=device)
        values.append(uniform.numpy().astype(np.float64))
        # Six standard errors of each mean.
        assert abs(values[-1].mean() - 0.5) < 6 * np.sqrt(1 / 12 / n)
        assert abs(rayleigh.numpy().mean() - 1.0) < 6 * np.sqrt((4 / np.pi - 1) / n)
        assert values[-1].min() > 0.0
        assert values[-1].max() < 1.0
    assert abs(np.corrcoef(values[0], values[1])[0, 1]) < 6 / np.sqrt(n)
    assert abs(np.corrcoef(values[0][:-1], values[0][1:])[0, 1]) < 6 / np.sqrt(n)


def test_wrong_arrays_are_refused_by_name(device):
    seed = wp.zeros(1, dtype=wp.uint64, device=device)
    number = wp.zeros(3, dtype=int, device=device)
    out = wp.zeros(3, dtype=wp.uint64, device=device)
    with pytest.raises(ValueError, match=r"trajectory_key: expected shape \(1,\), got \(3,\)"):
        keys.frame_keys(seed, out, number, number, 1, out, device=device)
    with pytest.raises(ValueError, match="number: expected dtype int32, got uint64"):
        keys.frame_keys(seed, seed, number, out, 1, out, device=device)
