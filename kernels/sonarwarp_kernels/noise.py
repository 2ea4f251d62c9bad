"""Speckle and background: integer sums of echoes become the amplitudes of an image.

Eq. 36 gives an echo amplitude, so both are Rayleigh variates: what many scatterers of random phase add up to. Speckle
multiplies the echo; the background, which is what a sonar hears of water and electronics, adds to it. The two add as
amplitudes, without interference. A draw of the background is keyed by frame, stream, beam and bin, so a bin's value
depends on nothing else.

Speckle changes as the sonar moves past what it looks at, so it is keyed not by frames but by knots along the way, and
interpolated between the two around a frame: cos(b pi/2) z0 + sin(b pi/2) z1 of their complex Gaussians, whose variance
is that of a knot for any b. So the amplitude of every frame is exactly Rayleigh, and its complex correlation over a
distance of x knots, averaged over where the knots lie, is Bohman's window (1 - x/2) cos(pi x/2) + sin(pi x/2) / pi:
1/pi at one knot, 0 from two on. A frame on a knot (b = 0) needs one draw. Fully developed speckle is Rayleigh: Goodman,
Speckle Phenomena in Optics, 2nd edition 2020, chapter 3.

A frame of 96 x 512 bins, all of them lit, takes 0.57 ms on one CPU core with both on and on a knot, 1.04 ms between
two, 0.11 ms with both off (0.06 ms of hashing and 0.15 ms of logarithm and root per draw; the library's cosine cost
0.4 ms more than the polynomial). A dark bin draws no speckle: frames of the field test take 0.47 and 0.68 ms. Clearing
the counts in the same pass gained nothing over a memset (4 us), so the inputs stay as they are.
"""

from typing import Any

import warp as wp

from sonarwarp_kernels.keys import STREAM_BACKGROUND, STREAM_SPECKLE, mix_key, rayleigh, uniform
from sonarwarp_kernels.launch import check_array, lanes, launch

wp.set_module_options({"enable_backward": False})


@wp.func
def beam_key(frame_key: wp.uint64, stream: int, beam: int) -> wp.uint64:
    """Key of one beam's draws in one stream; a bin's key mixes its index into it."""
    return mix_key(mix_key(frame_key, stream), beam)


@wp.func
def cosine_of_half_turns(x: float) -> float:
    """cos(pi x) for x in [-1, 1], within 1e-6: 1 - 2 sin^2(pi x / 2), the sine a least-error odd polynomial."""
    t = x * x
    sine = x * (1.57079629 + t * (-0.64596336 + t * (0.0796884805 + t * (-0.00467222791 + t * 0.00015082056))))
    return 1.0 - 2.0 * sine * sine


@wp.func
def speckle_between(key: wp.uint64, next_key: wp.uint64, weight: float, next_weight: float) -> float:
    """Rayleigh variate of unit mean, of two keyed complex Gaussians whose weights' squares sum to 1."""
    power = -wp.log(uniform(key))
    next_power = -wp.log(uniform(next_key))
    # Their phases are the keys' lower 32 bits, which `uniform` does not use; so is the difference, wrapped.
    half_turns = float(int(wp.uint32(key - next_key))) * 4.656612873077393e-10
    cross = 2.0 * weight * next_weight * wp.sqrt(power * next_power) * cosine_of_half_turns(half_turns)
    power = weight * weight * power + next_weight * next_weight * next_power + cross
    return wp.sqrt(1.2732395447351628 * wp.max(power, 0.0))


@wp.kernel
def finish_images_kernel(
    first: int,
    counts: wp.array(dtype=int, ndim=3),  # [frame, beam, bin]
    amplitude_per_count: float,
    keys: wp.array(dtype=wp.uint64),  # [frame]
    speckle: wp.array(dtype=int),  # [frame]
    knot_keys: wp.array2d(dtype=wp.uint64),  # [frame, 2]
    blend: wp.array(dtype=float),  # [frame]
    background: wp.array(dtype=float),  # [frame]
    lane_count: int,
    image_out: wp.array(dtype=float, ndim=3),  # [frame, beam, bin]
):
    index, lane = wp.tid()
    row = first + index
    frame = row // counts.shape[1]
    beam = row % counts.shape[1]
    speckled = speckle[frame] != 0
    level = background[frame]
    knot_key = beam_key(knot_keys[frame, 0], STREAM_SPECKLE, beam)
    next_knot_key = beam_key(knot_keys[frame, 1], STREAM_SPECKLE, beam)
    between = blend[frame] > 0.0
    weight = wp.cos(0.5 * wp.pi * blend[frame])
    next_weight = wp.sin(0.5 * wp.pi * blend[frame])
    background_key = beam_key(keys[frame], STREAM_BACKGROUND, beam)
    for bin in range(lane, counts.shape[2], lane_count):
        amplitude = float(counts[frame, beam, bin]) * amplitude_per_count
        if speckled and amplitude > 0.0:
            if between:
                amplitude *= speckle_between(mix_key(knot_key, bin), mix_key(next_knot_key, bin), weight, next_weight)
            else:
                amplitude *= rayleigh(mix_key(knot_key, bin))
        if level > 0.0:
            amplitude += level * rayleigh(mix_key(background_key, bin))
        image_out[frame, beam, bin] = amplitude


def finish_images(
    counts: wp.array,
    fixed_point: float,
    keys: wp.array,
    speckle: wp.array,
    knot_keys: wp.array,
    blend: wp.array,
    background: wp.array,
    image_out: wp.array,
    *,
    device: Any = None,
    threads: int = 1,
) -> None:
    """Turn integer sums of echo amplitude (Eq. 36) into images with speckle and background.

    Args:
        counts: sums of echoes, int32, shape [frame, beam, bin]; left as they are.
        fixed_point: counts per unit of amplitude.
        keys: frame keys (:func:`sonarwarp_kernels.keys.frame_keys`), shape [frame].
        speckle: 1 where a frame's echoes are multiplied by Rayleigh speckle of unit mean, else 0, int32, shape [frame].
        knot_keys: keys of the knots of speckle before and after each frame (:func:`sonarwarp_kernels.keys.frame_keys`,
            their numbers in place of frames'), shape [frame, 2].
        blend: how far a frame is from the one knot to the other, 0 to under 1, shape [frame].
        background: mean amplitude of the Rayleigh background of a frame, 0 for none, shape [frame].
        image_out: echo amplitudes, shape [frame, beam, bin].
        device: device of all arrays.
        threads: CPU threads; a beam's values are the same with any number.

    Raises:
        ValueError: an array of the wrong shape, type or device, or ``fixed_point`` not positive.
    """
    device = wp.get_device(device)
    check_array("counts", counts, (None, None, None), wp.int32, device)
    frames, beams, _ = counts.shape
    check_array("keys", keys, (frames,), wp.uint64, device)
    check_array("speckle", speckle, (frames,), wp.int32, device)
    check_array("knot_keys", knot_keys, (frames, 2), wp.uint64, device)
    check_array("blend", blend, (frames,), wp.float32, device)
    check_array("background", background, (frames,), wp.float32, device)
    check_array("image_out", image_out, counts.shape, wp.float32, device)
    if not fixed_point > 0.0:
        raise ValueError(f"fixed_point: must be positive, got {fixed_point}")
    # One row per beam, not per frame: a handful of frames still fills every CPU thread.
    lane_count = lanes(device)
    launch(
        finish_images_kernel,
        (frames * beams, lane_count),
        [counts, 1.0 / fixed_point, keys, speckle, knot_keys, blend, background, lane_count],
        [image_out],
        device,
        threads,
    )
