"""Free depth by its definition, in float64: every frame of a trajectory at every point, sorted."""

import numpy as np
from scipy import ndimage

from sonarwarp_kernels.critical import NO_DETECTION
from tests.reference.geometry import direction


def free_ranges(critical, seabed, window_end: float, guard: float) -> np.ndarray:
    """Range up to which beams are empty: the critical point's, else a guard before the ROI's or the window's end."""
    critical = np.asarray(critical, dtype=np.float64)
    seabed = np.asarray(seabed, dtype=np.float64)
    return np.where(critical == float(NO_DETECTION), np.minimum(seabed, window_end) - guard, critical)


def nearest_beam(azimuth, border, angle) -> np.ndarray:
    """Beam with the nearest centre, -1 outside of the outer borders."""
    beam = np.abs(np.asarray(angle)[..., None] - np.asarray(azimuth, dtype=np.float64)).argmin(axis=-1)
    return np.where((angle >= border[0]) & (angle <= border[-1]), beam, -1)


def polar(point, cone: bool):
    """Range, azimuth and elevation: a cone's azimuth is the angle to the plane x z, a fan's elevation that to x y."""
    forward, left, up = np.moveaxis(np.asarray(point), -1, 0)
    distance = np.sqrt(forward**2 + left**2 + up**2)
    if cone:
        return distance, np.arctan2(left, np.hypot(forward, up)), np.arctan2(up, forward)
    return distance, np.arctan2(left, forward), np.arctan2(up, np.hypot(forward, left))


def proven(world, frame: int, where, turn: float = 0.0, widen: float = 0.0) -> np.ndarray:
    """What one frame proves of world points, their azimuths turned and the beam's elevation widened [rad]."""
    distance, azimuth, elevation = polar((where - world.position[frame]) @ world.orientation[frame], bool(world.cone))
    beam = nearest_beam(world.azimuth, world.borders, azimuth + turn)
    within = np.abs(elevation) <= world.half_elevation - world.margin + widen
    free = free_ranges(world.critical[frame], world.seabed[frame], float(world.range_edge[-1]), world.guard)[beam]
    return np.where(within & (beam >= 0), np.clip(free - distance, -world.reach, world.reach), -world.reach)


def second_largest(depths, reach: float) -> np.ndarray:
    """Second largest over frames, the first axis; minus the reach where fewer than two look."""
    outside = np.full((2, *np.shape(depths)[1:]), -reach)
    return np.sort(np.concatenate([np.reshape(depths, (-1, *outside.shape[1:])), outside]), axis=0)[-2]


def bounds(world, owner: int, where, angle: float = 1e-5) -> tuple[np.ndarray, np.ndarray]:
    """Least and most free depth of points, whichever beam they are counted to within ``angle`` of its edges."""
    least, most = [], []
    for frame in np.flatnonzero(world.trajectory == owner):
        each = [proven(world, frame, where, turn=t, widen=w) for t in (-angle, 0.0, angle) for w in (-angle, angle)]
        least.append(np.min(each, axis=0))
        most.append(np.max(each, axis=0))
    shape = np.shape(where)[:-1]
    both = (np.reshape(depths, (-1, *shape)) for depths in (least, most))
    lower, upper = (second_largest(depths, world.reach) for depths in both)
    return lower, upper


def arc(world, frame: int, beam: int, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Elevations in the middles of equal parts of the beam, and their world positions at the critical range."""
    edge = np.linspace(-world.half_elevation, world.half_elevation, number + 1)
    elevation = 0.5 * (edge[1:] + edge[:-1])
    azimuth = np.full(number, float(world.azimuth[beam]))
    turned = direction(azimuth, elevation, bool(world.cone))
    return elevation, world.world_points(frame, turned, float(world.critical[frame, beam]))


def around(world, owner: int, where, slack: float) -> np.ndarray:
    """Whether each cell is among the eight whose centres surround a point, the point anywhere within ``slack`` cells.

    A negative slack keeps the cells that surround it wherever it may be.
    """
    found = np.zeros(world.counts.shape[1:], dtype=bool)
    centre = np.indices(found.shape).reshape(3, -1).T
    inside = np.all(centre < world.size[owner], axis=1)
    for point in where:
        place = (point - world.origin[owner].astype(np.float64)) / float(np.float32(world.cell)) - 0.5
        found.ravel()[inside & np.all(np.abs(centre - place) < 1.0 + slack, axis=1)] = True
    return found


def read(free_depth, origin, cell: float, size, where, reach: float) -> np.ndarray:
    """Trilinear between cell centres over minus the reach; that itself where they are less than half of what counts."""
    own = np.asarray(free_depth, dtype=np.float64)[: size[0], : size[1], : size[2]]
    place = (np.asarray(where, dtype=np.float64) - origin) / float(np.float32(cell)) - 0.5
    return known_mean(own, place, reach)


def known_mean(cells, place, reach: float) -> np.ndarray:
    """Trilinear at places in cells over those of more than minus the reach, shape [place]."""
    known = np.asarray(cells > np.float32(-reach), dtype=np.float64)
    held, weight = (
        ndimage.map_coordinates(values, place.T, order=1, mode="grid-constant", cval=0.0)
        for values in (np.where(known > 0, cells, 0.0), known)
    )
    return np.where(weight >= 0.5, held / np.maximum(weight, 0.5), -reach)
