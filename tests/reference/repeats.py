"""Repeated hits, by sorting all contacts of each cube."""

import numpy as np


def surest(owner, point, length, spacing: float) -> dict[int, np.ndarray]:
    """Of every cube the contact that stays, with all the contacts that it stands for, itself the first.

    Args:
        owner: trajectory of each contact, shape [contact].
        point: shape [contact, 3].
        length: standard deviation of the place along its arc, shape [contact].
        spacing: edge of the cubes, which are counted from 0.
    """
    owner, point = np.asarray(owner), np.asarray(point)
    cubes: dict[tuple, list[int]] = {}
    for contact in range(len(owner)):
        place = np.floor(point[contact] / spacing).astype(int)
        cubes.setdefault((int(owner[contact]), *place.tolist()), []).append(contact)
    ranked = [sorted(members, key=lambda contact: (length[contact], contact)) for members in cubes.values()]
    return {members[0]: np.array(members) for members in ranked}
