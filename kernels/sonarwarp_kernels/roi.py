"""Region of interest of a beam: the bins before the seabed's onset (Eq. 5-6), at any attitude."""

from typing import Any

import warp as wp

from sonarwarp_kernels.geometry import beam_direction, bin_below
from sonarwarp_kernels.launch import check_array, launch
from sonarwarp_kernels.specs import Fan

wp.set_module_options({"enable_backward": False})


@wp.func
def seabed_distance(pose: wp.transform, altitude: float, azimuth: float, elevation: float, cone: int) -> float:
    """Slant range [m] at which a direction of the sonar meets a flat seabed; infinite where it does not point down."""
    direction = wp.transform_vector(pose, beam_direction(azimuth, elevation, cone))
    if direction[2] >= 0.0:
        return wp.inf
    return altitude / -direction[2]


@wp.kernel
def seabed_range_kernel(
    first: int,
    fan: Fan,
    world_from_sensor: wp.array(dtype=wp.transform),  # [frame]
    altitude: wp.array(dtype=float),  # [frame]
    r_emin_out: wp.array(dtype=float, ndim=2),  # [frame, beam]
):
    index, beam = wp.tid()
    frame = first + index
    r_emin_out[frame, beam] = seabed_distance(
        world_from_sensor[frame], altitude[frame], fan.azimuth[beam], fan.elevation_min, fan.cone
    )


@wp.func
def roi_bins(range_edge: wp.array(dtype=float), r_emin: float, guard: int) -> int:
    """Number of bins in the ROI (Eq. 5-6): indices up to I_emin, the edge nearest to ``r_emin``, less ``guard``."""
    bins = range_edge.shape[0] - 1
    below = wp.min(bin_below(range_edge, r_emin), bins - 1)
    if below < 0:
        return 0
    edge = range_edge[below]
    coordinate = float(below) + (r_emin - edge) / (range_edge[below + 1] - edge)
    # Beyond the window the last bin's scale goes on as far as it matters: the range may be infinite.
    nearest = int(wp.round(wp.min(coordinate, float(bins + guard))))
    return wp.clamp(nearest - guard + 1, 0, bins)


def seabed_range(
    fan: Fan,
    world_from_sensor: wp.array,
    altitude: wp.array,
    r_emin_out: wp.array,
    *,
    device: Any = None,
    threads: int = 1,
) -> None:
    """Range r_emin at which each beam's lower edge first meets a flat seabed (Eq. 5, at any attitude).

    A beam stands for its centre azimuth; the sides of the paper's beams differ by less than 0.1 %. The lower edge meets
    the seabed before the rest of the beam while it points ahead of straight down and is not rolled over.

    Args:
        fan: azimuths, lower edge and kind of the beams.
        world_from_sensor: poses of the sonar, shape [frame].
        altitude: height of the sonar itself above the seabed [m], shape [frame].
        r_emin_out: slant range [m], shape [frame, beam]; infinite where the lower edge does not point down.
        device: device of all arrays.
        threads: CPU threads.

    Raises:
        ValueError: an array of the wrong shape, type or device.
    """
    device = wp.get_device(device)
    check_array("fan.azimuth", fan.azimuth, (None,), wp.float32, device)
    check_array("world_from_sensor", world_from_sensor, (None,), wp.transform, device)
    frames = world_from_sensor.shape[0]
    beams = fan.azimuth.shape[0]
    check_array("altitude", altitude, (frames,), wp.float32, device)
    check_array("r_emin_out", r_emin_out, (frames, beams), wp.float32, device)
    launch(seabed_range_kernel, (frames, beams), [fan, world_from_sensor, altitude], [r_emin_out], device, threads)
