"""Levels of onsets and the beams that an object fills too little, in float64: one beam at a time, by their words."""

import numpy as np

from sonarwarp_kernels.critical import NO_BIN, NO_DETECTION


def levels(image, critical_bin, length: int) -> np.ndarray:
    """Mean of each echo's first bins, those that the window still has; 0 where there is no echo; shape [slot, beam]."""
    image = np.asarray(image, dtype=np.float64)
    out = np.zeros(image.shape[:2])
    for at in zip(*np.nonzero(np.asarray(critical_bin) != int(NO_BIN)), strict=True):
        out[at] = image[at][critical_bin[at] :][:length].mean()
    return out


def _ends(distance: np.ndarray, level: np.ndarray, jump: float, share: float) -> np.ndarray:
    """Which beams of a fan are the first of an object, on the side of the beam before, and too faint for it."""
    faint = np.zeros(len(distance), dtype=bool)
    for beam in range(1, len(distance) - 1):
        before, own, after = distance[beam - 1 : beam + 2]
        looks_past = np.isnan(before) or before - own > jump
        goes_on = not np.isnan(after) and abs(after - own) < jump
        if not np.isnan(own) and looks_past and goes_on:
            further = beam + 2 < len(distance) and abs(distance[beam + 2] - own) < 2 * jump
            faint[beam] = level[beam] < share * level[beam + 1 : beam + (3 if further else 2)].mean()
    return faint


def brushed(critical_range, level, jump: float, share: float) -> np.ndarray:
    """Beams that only brush what they meet, shape [frame, beam]: either end of a fan may be the object's first."""
    distance = np.asarray(critical_range, dtype=np.float64)
    distance = np.where(distance == float(NO_DETECTION), np.nan, distance)
    level = np.asarray(level, dtype=np.float64)
    rows = zip(distance, level, strict=True)
    return np.array([_ends(d, s, jump, share) | _ends(d[::-1], s[::-1], jump, share)[::-1] for d, s in rows])
