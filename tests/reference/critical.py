"""NumPy float64 oracles of the ROI, the Gaussian-difference filter and critical points."""

import numpy as np

from tests.reference.geometry import bin_range, direction


def seabed_range(orientation: np.ndarray, altitude: float, azimuth: float, elevation: float, cone: bool) -> float:
    """Distance along a beam's edge to the plane ``altitude`` below, infinite where it never gets there."""
    descent = -(orientation @ direction(azimuth, elevation, cone)[0])[2]
    return altitude / descent if descent > 0 else np.inf


def roi_bins(range_edge, r_emin: float, guard: int) -> int:
    """Number of bins with an index up to the nearest integer of r_emin on the scale of edges, less the guard."""
    range_edge = np.asarray(range_edge, dtype=np.float64)
    bins = len(range_edge) - 1
    if r_emin < range_edge[0]:
        return 0
    coordinate = np.interp(r_emin, range_edge, np.arange(bins + 1))
    if r_emin > range_edge[-1]:
        coordinate = bins + (r_emin - range_edge[-1]) / (range_edge[-1] - range_edge[-2])
    if np.isinf(coordinate):
        return bins
    return int(np.clip(np.floor(coordinate + 0.5) - guard + 1, 0, bins))


def derivative(amplitude, sigma: float) -> np.ndarray:
    """S_D of Eq. 23-28, NaN where a tap lies outside the amplitudes given."""
    amplitude = np.asarray(amplitude, dtype=np.float64)
    taps = np.exp(-(np.arange(-2, 3) ** 2) / (2 * sigma**2))
    smooth = np.convolve(amplitude, taps / taps.sum(), mode="valid")
    out = np.full(len(amplitude), np.nan)
    out[3:-3] = np.convolve(smooth, [1, 0, -1], mode="valid")
    return out


def derivative_deviation(sigma: float) -> float:
    """Standard deviation of S_D over independent Rayleigh amplitudes of unit mean: the filter's impulse response."""
    impulse = np.zeros(15)
    impulse[7] = 1.0
    response = derivative(impulse, sigma)
    return np.sqrt(4 / np.pi - 1) * np.sqrt(np.nansum(response**2))


def edges(amplitude, bins: int, settings) -> list[tuple[int, float, float]]:
    """All edges in the first ``bins`` bins of one beam: bin, derivative, position of the vertex [bin].

    The definition spelt out bin by bin: a local maximum of the derivative over the floor and over the noise that the
    exponentially forgotten mean of the bins ahead implies.
    """
    roi = np.asarray(amplitude, dtype=np.float64)[:bins]
    if len(roi) < 9:
        return []
    slope = derivative(roi, settings.sigma)
    found = []
    for bin in range(4, len(roi) - 4):
        mean, count = forgotten_mean(roi[: bin - 2], settings.memory)
        threshold = settings.deviations * derivative_deviation(settings.sigma) * mean * (1 + 8 / count)
        before, here, after = slope[bin - 1 : bin + 2]
        if here > before and here >= after and here > max(settings.floor, threshold):
            vertex = bin + 0.5 * (before - after) / (before - 2 * here + after)
            # No edge before the first bin that holds some of its echo, three bins on at the latest.
            level = 3 * forgotten_mean(roi[: bin - 1], settings.memory)[0] + 1e-4 * here
            lit = [place for place in range(bin - 1, bin + 3) if roi[place] > level]
            found.append((bin, here, max(vertex, (lit[0] if lit else bin + 3) - 0.5)))
    return found


def forgotten_mean(ahead: np.ndarray, memory: float) -> tuple[float, float]:
    """Exponentially forgotten mean of some bins and the sum of its weights."""
    # The newest bin ahead weighs 1; the first two share the age of the second.
    age = np.minimum(np.arange(len(ahead))[::-1], len(ahead) - 2)
    weights = (1 - 1 / memory) ** age
    return weights @ ahead / weights.sum(), weights.sum()


def critical_point(amplitude, range_edge, r_emin: float, settings, nearest: bool) -> tuple[float, float, int]:
    """Range, derivative and bin of a beam's critical point; (-1, 0, -1) without one."""
    found = edges(amplitude, roi_bins(range_edge, r_emin, settings.guard), settings)
    if not found:
        return -1.0, 0.0, -1
    bin, strength, position = found[0] if nearest else max(found, key=lambda edge: edge[1])
    return float(bin_range(range_edge, position)), strength, bin
