"""Rays, echoes and images in float64: brute force, Eq. 36, point-binning, and a flat seabed in closed form."""

import numpy as np


def beam_direction(azimuth: np.ndarray, elevation: np.ndarray, cone: bool) -> np.ndarray:
    """Unit directions in the sonar's frame, shape [..., 3], of broadcast angles [rad]."""
    azimuth, elevation = np.broadcast_arrays(azimuth, elevation)
    if cone:
        x, y, z = np.cos(azimuth) * np.cos(elevation), np.sin(azimuth), np.cos(azimuth) * np.sin(elevation)
    else:
        x, y, z = np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)
    return np.stack([x, y, z], axis=-1)


def first_face(
    vertices: np.ndarray, faces: np.ndarray, origin: np.ndarray, direction: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Nearest range [m] and face along each ``direction`` [ray, 3], by every triangle in turn; inf and -1 on a miss."""
    nearest = np.full(len(direction), np.inf)
    found = np.full(len(direction), -1)
    for index, (a, b, c) in enumerate(np.asarray(vertices, dtype=np.float64)[faces]):
        first, second = b - a, c - a
        across = np.cross(direction, second)
        determinant = across @ first
        with np.errstate(divide="ignore", invalid="ignore"):
            u = across @ (origin - a) / determinant
            other = np.cross(origin - a, first)
            v = direction @ other / determinant
            distance = second @ other / determinant
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 0) & (distance < nearest)
        nearest[hit], found[hit] = distance[hit], index
    return nearest, found


def echo_amplitude(amplitude: float, impedance, water: float, distance, cosine) -> np.ndarray:
    """Echo amplitude of a surface element (Eq. 36), the reflection's magnitude."""
    reflection = np.abs(impedance - water) / (impedance + water)
    return amplitude * reflection * np.square(cosine) / np.square(distance)


def stratified_angles(lower, upper, low: float, high: float, columns: int, rows: int):
    """Azimuths [beam] and elevations [row] of one grid after another, jointly stratified over a beam, all distinct.

    ``columns`` grids of one azimuth per beam; their elevations are shifted by a bit-reversed part of a row, so that 16
    neighbouring azimuths share none of the 16 parts of a row: with 256 x 256 every stratum of 16 azimuths x 4,096
    elevations holds one ray.
    """
    bits = columns.bit_length() - 1
    for column in range(columns):
        azimuth = lower + (upper - lower) * (column + 0.5) / columns
        shift = (int(f"{column:0{bits}b}"[::-1], 2) + 0.5) / columns
        yield azimuth, low + (high - low) * (np.arange(rows) + shift) / rows


def binned(range_edge: np.ndarray, distance: np.ndarray, amplitude: np.ndarray) -> np.ndarray:
    """Sums of ``amplitude`` over each bin, shape [row, bin], of rays [row, ray]; what lies outside is dropped."""
    bins = len(range_edge) - 1
    index = np.searchsorted(range_edge, distance, side="right") - 1
    inside = (index >= 0) & (index < bins)
    place = np.arange(len(distance))[:, None] * bins + index
    sums = np.bincount(place[inside], amplitude[inside], minlength=len(distance) * bins)
    return sums.reshape(len(distance), bins)


def flat_seabed_image(
    azimuth_edge: np.ndarray,
    half_elevation: float,
    range_edge: np.ndarray,
    altitude: float,
    tilt: float,
    reflection: float,
    azimuths: int = 64,
) -> np.ndarray:
    """Image [beam, bin] of a plane under a sonar without roll: closed form in elevation, midpoints in azimuth.

    With s the inverse range, Eq. 36 over a plane at distance h is R h^2 s^4. A direction sinks by K sin(g) with
    g = b - elevation, K and b those of its azimuth: s = K sin(g) / h, and the integral of sin^4 is known.
    """
    parts = (np.arange(azimuths) + 0.5) / azimuths
    azimuth = azimuth_edge[:-1, None] + np.diff(azimuth_edge)[:, None] * parts
    scale = np.hypot(np.sin(tilt) * np.cos(azimuth), np.cos(tilt))
    turn = np.arctan2(np.sin(tilt) * np.cos(azimuth), np.cos(tilt))
    sine = altitude / (scale[..., None] * range_edge)
    # Below nadir the range grows again; no beam of these tests looks there.
    angle = np.where(sine < 1, np.arcsin(np.minimum(sine, 1)), np.inf)
    angle = np.clip(angle, (turn - half_elevation)[..., None], (turn + half_elevation)[..., None])
    integral = 3 / 8 * angle - np.sin(2 * angle) / 4 + np.sin(4 * angle) / 32
    energy = -np.diff(integral, axis=-1) / (2 * half_elevation)
    return np.mean(reflection * scale[..., None] ** 4 / altitude**2 * energy, axis=1)
