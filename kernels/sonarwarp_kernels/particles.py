"""Particles on the imaging sonar's elevation arc (Eq. 14-20, 31-32).

A particle is a hypothesis: a range drawn from the mixture (Eq. 9) and an elevation drawn over the vertical beamwidth,
stratified. The target is p(r | x, m') p(m' | z_P, x): the range likelihood times the field's occupancy at the
particle's cell. As the range is drawn from that likelihood, target over proposal is the occupancy alone; weighting by
the likelihood once more, as Eq. 32 prints it, would square Eq. 10.
"""

from typing import Any

import warp as wp

from sonarwarp_kernels.critical import NO_DETECTION
from sonarwarp_kernels.field import check_field, occupancy, read_log_odds
from sonarwarp_kernels.geometry import beam_direction
from sonarwarp_kernels.keys import STREAM_ELEVATION, STREAM_RANGE, mix_key, uniform
from sonarwarp_kernels.launch import check_array, launch
from sonarwarp_kernels.mixture import check_mixture, range_density, sample_range
from sonarwarp_kernels.slots import EMPTY
from sonarwarp_kernels.specs import Fan, Grid, Mixture

wp.set_module_options({"enable_backward": False})


@wp.struct
class Reading:
    """How particles read the field."""

    low: float  # lower clamp of log-odds, at least -80: lower ones are no weight at all in float32
    high: float  # upper clamp of log-odds
    informed: float  # least log-odds that the best particle must find for an informed point


@wp.struct
class Contacts:
    """Critical points of all frames and what the particles need to know about them."""

    trajectory: wp.array(dtype=int)  # [frame] whose field is asked
    key: wp.array(dtype=wp.uint64)  # [frame] random key
    world_from_sensor: wp.array(dtype=wp.transform)  # [frame]
    seabed_range: wp.array2d(dtype=float)  # [frame, beam] r_emin [m]
    critical_range: wp.array2d(dtype=float)  # [frame, beam] [m]; NO_DETECTION where there is none


@wp.struct
class Arc:
    """What every particle of one frame and beam shares."""

    owner: int  # trajectory
    pose: wp.transform  # world from sensor
    azimuth: float  # of the beam's centre [rad]
    critical: float  # critical range [m]
    start: float  # near end of the mixture's support [m]
    seabed: float  # far end, r_emin or the window's end [m]
    range_key: wp.uint64
    elevation_key: wp.uint64


@wp.struct
class Particle:
    """One hypothesis of where a critical point's echo came from."""

    distance: float  # slant range [m]
    elevation: float  # [rad]
    point: wp.vec3  # world [m]
    log_odds: float  # of the field there
    weight: float  # importance weight: target over proposal
    target: float  # target density, unnormalised


@wp.func
def world_point(pose: wp.transform, azimuth: float, elevation: float, distance: float, cone: int) -> wp.vec3:
    """World position [m] of a polar point."""
    return wp.transform_point(pose, distance * beam_direction(azimuth, elevation, cone))


@wp.func
def arc_of(fan: Fan, contacts: Contacts, frame: int, beam: int) -> Arc:
    """The arc of a beam's critical point; a detection at or beyond r_emin (uneven seabed) widens the support."""
    arc = Arc()
    arc.owner = contacts.trajectory[frame]
    arc.pose = contacts.world_from_sensor[frame]
    arc.azimuth = fan.azimuth[beam]
    arc.critical = contacts.critical_range[frame, beam]
    arc.start = fan.range_edge[0]
    window_end = fan.range_edge[fan.range_edge.shape[0] - 1]
    arc.seabed = wp.min(wp.max(contacts.seabed_range[frame, beam], arc.critical), window_end)
    arc.range_key = mix_key(mix_key(contacts.key[frame], STREAM_RANGE), beam)
    arc.elevation_key = mix_key(mix_key(contacts.key[frame], STREAM_ELEVATION), beam)
    return arc


@wp.func
def draw_particle(
    fan: Fan,
    grid: Grid,
    mixture: Mixture,
    reading: Reading,
    log_odds: wp.array4d(dtype=int),
    arc: Arc,
    index: int,
    particles: int,
) -> Particle:
    """Range from Eq. 9, elevation uniform within its own of ``particles`` equal intervals, weight from the field."""
    drawn = Particle()
    part = (float(index) + uniform(mix_key(arc.elevation_key, index))) / float(particles)
    drawn.elevation = fan.elevation_min + part * (fan.elevation_max - fan.elevation_min)
    key = mix_key(arc.range_key, index)
    drawn.distance = sample_range(mixture, arc.critical, arc.start, arc.seabed, uniform(key), uniform(mix_key(key, 0)))
    drawn.point = world_point(arc.pose, arc.azimuth, drawn.elevation, drawn.distance, fan.cone)
    drawn.log_odds = read_log_odds(grid, log_odds, arc.owner, drawn.point, reading.low, reading.high)
    drawn.weight = occupancy(drawn.log_odds)
    drawn.target = drawn.weight * range_density(mixture, arc.critical, arc.start, arc.seabed, drawn.distance)
    return drawn


def check_contacts(fan: Fan, contacts: Contacts, device: Any) -> None:
    """Refuse contacts that do not fit each other or their fan.

    Raises:
        ValueError: an array of the wrong shape, type or device.
    """
    check_array("fan.azimuth", fan.azimuth, (None,), wp.float32, device)
    check_array("fan.range_edge", fan.range_edge, (None,), wp.float32, device)
    if fan.range_edge.shape[0] < 2:
        raise ValueError(f"fan.range_edge: needs at least 2 edges, got {fan.range_edge.shape[0]}")
    check_array("contacts.trajectory", contacts.trajectory, (None,), wp.int32, device)
    beams = fan.azimuth.shape[0]
    frames = contacts.trajectory.shape[0]
    check_array("contacts.key", contacts.key, (frames,), wp.uint64, device)
    check_array("contacts.world_from_sensor", contacts.world_from_sensor, (frames,), wp.transform, device)
    check_array("contacts.seabed_range", contacts.seabed_range, (frames, beams), wp.float32, device)
    check_array("contacts.critical_range", contacts.critical_range, (frames, beams), wp.float32, device)


def check_reading(reading: Reading) -> None:
    """Refuse clamps that leave no log-odds, or no weight.

    Raises:
        ValueError: clamps out of bounds.
    """
    if not -80.0 <= reading.low <= reading.high:
        raise ValueError(f"reading.low: must lie between -80 and reading.high = {reading.high:g}, got {reading.low:g}")


def check_inputs(
    fan: Fan,
    grid: Grid,
    mixture: Mixture,
    reading: Reading,
    contacts: Contacts,
    slot_frame: wp.array,
    log_odds: wp.array,
    device: Any,
) -> None:
    """Refuse inputs of the particles' kernels that do not fit each other, or that describe nothing.

    Raises:
        ValueError: an array of the wrong shape, type or device; clamps or a mixture out of bounds.
    """
    check_mixture(mixture)
    check_reading(reading)
    check_contacts(fan, contacts, device)
    check_array("slot_frame", slot_frame, (None,), wp.int32, device)
    check_field(grid, "log_odds", log_odds, wp.int32, device)


@wp.kernel
def sample_particles_kernel(
    first: int,
    fan: Fan,
    grid: Grid,
    mixture: Mixture,
    reading: Reading,
    contacts: Contacts,
    slot_frame: wp.array(dtype=int),  # [slot]
    log_odds: wp.array4d(dtype=int),  # [trajectory, x, y, z]
    range_out: wp.array3d(dtype=float),  # [slot, beam, particle]
    elevation_out: wp.array3d(dtype=float),  # [slot, beam, particle]
    weight_out: wp.array3d(dtype=float),  # [slot, beam, particle]
):
    row, index = wp.tid()
    beams = contacts.critical_range.shape[1]
    slot = (first + row) // beams
    beam = (first + row) % beams
    frame = slot_frame[slot]
    weight_out[slot, beam, index] = 0.0
    if frame == EMPTY:
        return
    if contacts.critical_range[frame, beam] == NO_DETECTION:
        return
    arc = arc_of(fan, contacts, frame, beam)
    drawn = draw_particle(fan, grid, mixture, reading, log_odds, arc, index, range_out.shape[2])
    range_out[slot, beam, index] = drawn.distance
    elevation_out[slot, beam, index] = drawn.elevation
    weight_out[slot, beam, index] = drawn.weight


def sample_particles(
    fan: Fan,
    grid: Grid,
    mixture: Mixture,
    reading: Reading,
    contacts: Contacts,
    slot_frame: wp.array,
    log_odds: wp.array,
    range_out: wp.array,
    elevation_out: wp.array,
    weight_out: wp.array,
    *,
    device: Any = None,
    threads: int = 1,
) -> None:
    """The particles themselves, to look at: the same draws that :func:`estimate_points` makes.

    Args:
        fan: as in :func:`estimate_points`, like all inputs that follow.
        grid: cells of the field.
        mixture: range likelihood.
        reading: how the field is read.
        contacts: critical points of all frames.
        slot_frame: shape [slot].
        log_odds: shape [trajectory, x, y, z].
        range_out: slant range [m], shape [slot, beam, particle]; untouched where nothing was detected.
        elevation_out: elevation [rad], of the same shape; untouched where nothing was detected.
        weight_out: importance weight, of the same shape; 0 where nothing was detected and in empty slots.

    Raises:
        ValueError: as :func:`check_inputs` does, or an output of the wrong shape, type or device.
    """
    device = wp.get_device(device)
    check_inputs(fan, grid, mixture, reading, contacts, slot_frame, log_odds, device)
    slots, beams = slot_frame.shape[0], fan.azimuth.shape[0]
    check_array("range_out", range_out, (slots, beams, None), wp.float32, device)
    shape = range_out.shape
    check_array("elevation_out", elevation_out, shape, wp.float32, device)
    check_array("weight_out", weight_out, shape, wp.float32, device)
    launch(
        sample_particles_kernel,
        (slots * beams, shape[2]),
        [fan, grid, mixture, reading, contacts, slot_frame, log_odds],
        [range_out, elevation_out, weight_out],
        device,
        threads,
    )
