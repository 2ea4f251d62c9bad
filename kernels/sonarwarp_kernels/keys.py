"""Keyed randomness: a value depends on what it is for, never on the order in which values are drawn.

A frame's key hashes (seed, trajectory key, frame number); a draw hashes (frame key, stream, beam, index). All through
the 64-bit SplitMix finaliser (Steele, Lea and Flood 2014), a bijection that passes BigCrush as a counter generator.
"""

from typing import Any

import warp as wp

from sonarwarp_kernels.launch import check_array, launch

wp.set_module_options({"enable_backward": False})

# One stream per use: two uses with one stream would be correlated.
STREAM_PROBE = wp.constant(1)
STREAM_GUARD = wp.constant(2)
STREAM_LATTICE = wp.constant(3)
STREAM_SPECKLE = wp.constant(4)
STREAM_BACKGROUND = wp.constant(5)
STREAM_RANGE = wp.constant(6)
STREAM_ELEVATION = wp.constant(7)

# Frames and pings of one number must not share a key.
FLS_FRAMES = wp.constant(1)
PS_PINGS = wp.constant(2)


@wp.func
def mix_key(key: wp.uint64, value: int) -> wp.uint64:
    """Hash ``value`` into ``key``."""
    x = key + wp.uint64(0x9E3779B97F4A7C15) * (wp.uint64(wp.uint32(value)) + wp.uint64(1))
    x = (x ^ (x >> wp.uint64(30))) * wp.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> wp.uint64(27))) * wp.uint64(0x94D049BB133111EB)
    return x ^ (x >> wp.uint64(31))


@wp.func
def uniform(key: wp.uint64) -> float:
    """Uniform in (0, 1), 23 bits, never an end point: safe under a logarithm."""
    return (float(wp.uint32(key >> wp.uint64(41))) + 0.5) * 1.1920928955078125e-07


@wp.func
def rayleigh(key: wp.uint64) -> float:
    """Rayleigh variate of unit mean."""
    return wp.sqrt(-1.2732395447351628 * wp.log(uniform(key)))


@wp.kernel
def frame_keys_kernel(
    first: int,
    seed: wp.array(dtype=wp.uint64),  # [trajectory]
    trajectory_key: wp.array(dtype=wp.uint64),  # [trajectory]
    trajectory: wp.array(dtype=int),  # [frame]
    number: wp.array(dtype=int),  # [frame]
    sonar: int,
    key_out: wp.array(dtype=wp.uint64),  # [frame]
):
    frame = first + wp.tid()
    owner = trajectory[frame]
    key = mix_key(seed[owner], sonar)
    key = mix_key(key ^ trajectory_key[owner], number[frame])
    key_out[frame] = key


def frame_keys(
    seed: wp.array,
    trajectory_key: wp.array,
    trajectory: wp.array,
    number: wp.array,
    sonar: int,
    key_out: wp.array,
    *,
    device: Any = None,
    threads: int = 1,
) -> None:
    """Keys of frames or pings, or of the knots between which their speckle is interpolated.

    Args:
        seed: user's seed, shape [trajectory].
        trajectory_key: what names a trajectory wherever it stands in a batch, shape [trajectory].
        trajectory: trajectory of each frame, shape [frame].
        number: number of the frame, or of a knot, within its trajectory, shape [frame].
        sonar: ``FLS_FRAMES`` or ``PS_PINGS``.
        key_out: shape [frame].
    """
    device = wp.get_device(device)
    trajectories = seed.shape[0]
    frames = trajectory.shape[0]
    check_array("seed", seed, (trajectories,), wp.uint64, device)
    check_array("trajectory_key", trajectory_key, (trajectories,), wp.uint64, device)
    check_array("trajectory", trajectory, (frames,), wp.int32, device)
    check_array("number", number, (frames,), wp.int32, device)
    check_array("key_out", key_out, (frames,), wp.uint64, device)
    launch(frame_keys_kernel, (frames,), [seed, trajectory_key, trajectory, number, sonar], [key_out], device, threads)
