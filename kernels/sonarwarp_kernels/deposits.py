"""How a patch of surface spreads its echo over range bins.

Over a small patch the inverse range s is linear in azimuth and in elevation: a sum of two independent uniform
variables, whose density is a trapezoid. Its distribution, read at the bins' edges 1 / r, gives each bin's part of the
patch; the echo amplitude there is weight * s^4 (Eq. 36, ``samples``).
"""

import warp as wp

from sonarwarp_kernels.geometry import bin_below
from sonarwarp_kernels.samples import Fold, Profile, profile_inverse, profile_weight
from sonarwarp_kernels.specs import Fan

wp.set_module_options({"enable_backward": False})

# Half widths below this part of the inverse range are as good as zero: single precision ends there.
_LEAST_HALF_WIDTH = wp.constant(1.0e-6)

# Inverse range [1/m] that no window reaches.
_LEAST_INVERSE = wp.constant(1.0e-9)

# Knots of a profile nearer to each other than this part of a cell are one.
_SHORTEST_PIECE = wp.constant(0.02)


@wp.func
def trapezoid_below(offset: float, wide: float, narrow: float) -> float:
    """Part below ``offset`` of a sum of two uniform variables around 0 with half widths ``wide`` >= ``narrow``."""
    distance = wp.abs(offset)
    if distance <= wide - narrow:
        return 0.5 + 0.5 * offset / wide
    beyond = float(0.0)
    if distance < wide + narrow:
        rest = wide + narrow - distance
        beyond = rest * rest / (8.0 * wide * narrow)
    return wp.where(offset > 0.0, 1.0 - beyond, beyond)


@wp.func
def deposit_patch(
    fan: Fan,
    frame: int,
    beam: int,
    inverse: float,
    half_up: float,
    half_across: float,
    energy: float,
    counts_out: wp.array3d(dtype=int),
):
    """Add a patch around the inverse range ``inverse`` to an image; what lies outside of the window is dropped.

    The half widths are what the inverse range changes by to the patch's edges along elevation and along azimuth [1/m];
    ``energy`` is the patch's weight times its part of the aperture, in counts m^4.
    """
    bins = fan.range_edge.shape[0] - 1
    wide = wp.max(wp.max(half_up, half_across), _LEAST_HALF_WIDTH * inverse)
    narrow = wp.min(half_up, half_across)
    upper = inverse + wide + narrow
    lower = wp.max(inverse - wide - narrow, _LEAST_INVERSE)
    index = bin_below(fan.range_edge, 1.0 / wp.max(upper, _LEAST_INVERSE))
    part_below_upper = float(1.0)
    if index < 0:
        index = int(0)
        upper = 1.0 / fan.range_edge[0]
        part_below_upper = trapezoid_below(upper - inverse, wide, narrow)
    while index < bins:
        edge = 1.0 / fan.range_edge[index + 1]
        part_below_edge = float(0.0)
        if edge > lower:
            part_below_edge = trapezoid_below(edge - inverse, wide, narrow)
        middle = 0.5 * (upper + wp.max(edge, lower))
        square = middle * middle
        echo = (part_below_upper - part_below_edge) * energy * square * square
        wp.atomic_add(counts_out, frame, beam, index, int(echo + 0.5))
        upper = edge
        part_below_upper = part_below_edge
        index += 1
        if edge <= lower:
            break


@wp.func
def next_knot(profile: Profile, after: float, stop: float) -> float:
    """First knot of a profile beyond ``after``, at most ``stop``."""
    if profile.lower > after:
        stop = wp.min(stop, profile.lower)
    if profile.upper > after:
        stop = wp.min(stop, profile.upper)
    return stop


@wp.func
def fold_at(height: float, profile: Profile, next_profile: Profile, low_fold: Fold, high_fold: Fold) -> float:
    """Where a fold that runs through a cell is at ``height``, 0-1 across the strip; negative where it is not known.

    It runs from the cell's foot to its top, or from one of these to the knot of a column, by which it leaves.
    """
    if low_fold.across >= 0.0 and high_fold.across >= 0.0:
        return low_fold.across + (high_fold.across - low_fold.across) * height
    if height <= 0.0:
        return low_fold.across
    if height >= 1.0:
        return high_fold.across
    if profile.lower == profile.upper and height == profile.lower:
        return 0.0
    if next_profile.lower == next_profile.upper and height == next_profile.lower:
        return 1.0
    return -1.0


@wp.func
def deposit_strip(
    fan: Fan,
    frame: int,
    beam: int,
    profile: Profile,
    next_profile: Profile,
    low_fold: Fold,
    high_fold: Fold,
    unit: float,
    counts_out: wp.array3d(dtype=int),
):
    """Add the surface between two columns of a cell, piece by piece from knot to knot; ``unit`` is counts per cell."""
    folded = low_fold.sharp + high_fold.sharp > 0
    start = float(0.0)
    near = profile.foot
    far = next_profile.foot
    fold_start = low_fold.across
    while start < 1.0:
        after = start + _SHORTEST_PIECE
        stop = next_knot(profile, after, next_knot(next_profile, after, 1.0))
        if stop > 1.0 - _SHORTEST_PIECE:
            stop = float(1.0)
        near_stop = profile_inverse(profile, stop)
        far_stop = profile_inverse(next_profile, stop)
        fold_stop = fold_at(stop, profile, next_profile, low_fold, high_fold)
        middle = 0.5 * (start + stop)
        weight = profile_weight(profile, middle)
        next_weight = profile_weight(next_profile, middle)
        energy = unit * (stop - start)
        half_up = 0.25 * wp.abs(near_stop + far_stop - near - far)
        begin = 0.5 * (near + near_stop)
        end = 0.5 * (far + far_stop)
        across = wp.max(fold_start, fold_stop)
        if fold_start >= 0.0 and fold_stop >= 0.0:
            across = 0.5 * (fold_start + fold_stop)
        if folded and across >= 0.0:
            # Each plane as far as the fold.
            turn = wp.where(2.0 * middle < profile.lower + profile.upper, low_fold.turn, high_fold.turn)
            next_low = 2.0 * middle < next_profile.lower + next_profile.upper
            next_turn = wp.where(next_low, low_fold.next_turn, high_fold.next_turn)
            fold = 0.5 * (begin + across * turn + end - (1.0 - across) * next_turn)
            first = 0.5 * (begin + fold)
            second = 0.5 * (fold + end)
            first_energy = energy * across * weight
            second_energy = energy * (1.0 - across) * next_weight
            deposit_patch(fan, frame, beam, first, half_up, wp.abs(first - begin), first_energy, counts_out)
            deposit_patch(fan, frame, beam, second, half_up, wp.abs(end - second), second_energy, counts_out)
        else:
            whole = 0.5 * (begin + end)
            energy *= 0.5 * (weight + next_weight)
            deposit_patch(fan, frame, beam, whole, half_up, wp.abs(whole - begin), energy, counts_out)
        start = stop
        near = near_stop
        far = far_stop
        fold_start = fold_stop
