"""The profiling sonar's detection: one echo profile in, up to a few footprints out, nearest first.

A footprint is a stretch of range bins whose smoothed amplitude stands clear of the background and, once corrected for
spreading by r^2, within a given level of the profile's peak. It is described by the 10 % and 90 % points and the
centre of its energy, here the sum of corrected amplitudes: first returns alone credit a beam's steep edge to the
whole beam, which shows as scallops of 5-10 cm on flat tops.

The centre is the centroid, unless the energy trails off away from the sonar. It does so where the wide fan takes in the
flanks of something round, which lie behind the ridge that faces the sonar and move the centroid back by a tenth of the
radius. There the centre lies twice as far before the middle of the 10 % and 90 % points as the centroid does. Three
times as far is better still with cones, but moves faces that the beam's own width makes trail.

The mean of the background is found in the profile itself by clipping: of all bins under three times the mean so far,
a few times over. Rayleigh noise is over three times its mean in 1 of 1,200 bins, echoes nearly always.
"""

from typing import Any

import warp as wp

from sonarwarp_kernels.launch import check_array, launch

wp.set_module_options({"enable_backward": False})

NO_FOOTPRINT = wp.constant(-1.0)
"""Range that marks an unused footprint."""


@wp.func
def footprint_spread(footprint: wp.vec3) -> float:
    """Extent along range of what left a footprint, were it spread evenly: 10 % to 90 % is 0.8 of that [m]."""
    return 1.25 * (footprint[2] - footprint[0])


@wp.func
def is_compact(footprint: wp.vec3, half_width: float, most: float) -> bool:
    """Whether a footprint spreads over less than ``most`` of the width of its beam there."""
    return footprint_spread(footprint) < most * 2.0 * half_width * footprint[1]


@wp.struct
class ProfileDetector:
    """What counts as a return in a profile."""

    relative: float  # threshold over the profile's largest corrected amplitude
    clearance: float  # threshold over the mean of the background
    gap: int  # bins under the threshold that do not yet end a footprint (speckle)


@wp.func
def smoothed_amplitude(echo: wp.array(dtype=float), index: int) -> float:
    """Amplitude smoothed by [1 4 6 4 1] / 16 along range; replicated at the window's ends."""
    last = echo.shape[0] - 1
    inner = echo[wp.max(index - 1, 0)] + echo[wp.min(index + 1, last)]
    outer = echo[wp.max(index - 2, 0)] + echo[wp.min(index + 2, last)]
    return 0.0625 * (6.0 * echo[index] + 4.0 * inner + outer)


@wp.func
def clipped_mean(echo: wp.array(dtype=float)) -> float:
    """Mean of the background: of the bins that no echo reaches."""
    bound = float(1.0e30)
    mean = float(0.0)
    for _ in range(8):
        total = float(0.0)
        count = int(0)
        for index in range(echo.shape[0]):
            if echo[index] <= bound:
                total += echo[index]
                count += 1
        mean = total / float(wp.max(count, 1))
        bound = 3.0 * mean
    return mean


@wp.func
def corrected_amplitude(
    echo: wp.array(dtype=float), range_edge: wp.array(dtype=float), background: float, index: int
) -> float:
    """Smoothed amplitude over the background, times r^2; never negative."""
    centre = 0.5 * (range_edge[index] + range_edge[index + 1])
    return wp.max(smoothed_amplitude(echo, index) - background, 0.0) * centre * centre


@wp.func
def is_return(
    echo: wp.array(dtype=float),
    range_edge: wp.array(dtype=float),
    background: float,
    clear: float,
    least: float,
    index: int,
) -> bool:
    """Whether a bin stands over ``clear``, an amplitude, and over ``least``, a corrected one."""
    if smoothed_amplitude(echo, index) <= clear:
        return False
    return corrected_amplitude(echo, range_edge, background, index) > least


@wp.func
def energy_point(
    echo: wp.array(dtype=float),
    range_edge: wp.array(dtype=float),
    background: float,
    start: int,
    stop: int,
    target: float,
) -> float:
    """Range [m] within bins [start, stop) at which the summed corrected amplitude reaches ``target``."""
    total = float(0.0)
    found = range_edge[stop]
    for index in range(start, stop):
        amount = corrected_amplitude(echo, range_edge, background, index)
        if total + amount >= target:
            part = (target - total) / wp.max(amount, 1.0e-30)
            found = range_edge[index] + part * (range_edge[index + 1] - range_edge[index])
            break
        total += amount
    return found


@wp.func
def echo_centre(near: float, centroid: float, far: float) -> float:
    """Range [m] of what faces the sonar: the centroid of an echo less its trail, never before its 10 % point."""
    trail = wp.max(0.5 * (near + far) - centroid, 0.0)
    return wp.max(centroid - trail, near)


@wp.kernel
def detect_profile_kernel(
    first: int,
    range_edge: wp.array(dtype=float),  # [bin + 1]
    detector: ProfileDetector,
    echo: wp.array2d(dtype=float),  # [ping, bin]
    footprint_out: wp.array2d(dtype=wp.vec3),  # [ping, footprint]
):
    ping = first + wp.tid()
    profile = echo[ping]
    bins = echo.shape[1]
    footprints = footprint_out.shape[1]
    background = clipped_mean(profile)
    peak = float(0.0)
    for index in range(bins):
        peak = wp.max(peak, corrected_amplitude(profile, range_edge, background, index))
    least = detector.relative * peak
    clear = detector.clearance * background
    count = int(0)
    index = int(0)
    while index < bins and count < footprints:
        if not is_return(profile, range_edge, background, clear, least, index):
            index += 1
            continue
        start = index
        last = index
        energy = float(0.0)
        moment = float(0.0)
        while index < bins and index - last <= detector.gap + 1:
            if is_return(profile, range_edge, background, clear, least, index):
                last = index
            index += 1
        index = last + 1
        for inside in range(start, index):
            amount = corrected_amplitude(profile, range_edge, background, inside)
            energy += amount
            moment += amount * 0.5 * (range_edge[inside] + range_edge[inside + 1])
        near = energy_point(profile, range_edge, background, start, index, 0.1 * energy)
        far = energy_point(profile, range_edge, background, start, index, 0.9 * energy)
        footprint_out[ping, count] = wp.vec3(near, echo_centre(near, moment / energy, far), far)
        count += 1
    for unused in range(count, footprints):
        footprint_out[ping, unused] = wp.vec3(NO_FOOTPRINT, NO_FOOTPRINT, NO_FOOTPRINT)


def detect_profile(
    range_edge: wp.array,
    detector: ProfileDetector,
    echo: wp.array,
    footprint_out: wp.array,
    *,
    device: Any = None,
    threads: int = 1,
) -> None:
    """Footprints of every ping's echo profile.

    Args:
        range_edge: borders of the bins [m], shape [bin + 1].
        detector: thresholds.
        echo: amplitude, shape [ping, bin].
        footprint_out: (10 % point, centre, 90 % point) of each footprint's energy [m], nearest first, all
            ``NO_FOOTPRINT`` where there is none; ``vec3``, shape [ping, footprint].

    Raises:
        ValueError: an array of the wrong shape, type or device, or a negative threshold or gap.
    """
    device = wp.get_device(device)
    for name in ("relative", "clearance", "gap"):
        value = getattr(detector, name)
        if not value >= 0:
            raise ValueError(f"detector.{name}: must be at least 0, got {value:g}")
    check_array("echo", echo, (None, None), wp.float32, device)
    pings, bins = echo.shape
    check_array("range_edge", range_edge, (bins + 1,), wp.float32, device)
    check_array("footprint_out", footprint_out, (pings, None), wp.vec3, device)
    launch(detect_profile_kernel, (pings,), [range_edge, detector, echo], [footprint_out], device, threads)
