"""What the imaging sonar's contacts say of a face: where its upper edge is, and what stands before it."""

import warp as wp

from sonarwarp_kernels.faces import FrontModel
from sonarwarp_kernels.specs import Grid
from sonarwarp_kernels.tops import NO_HEIGHT, top_height

wp.set_module_options({"enable_backward": False})

# Contacts further behind may be a face's upper edge where it would be steeper than 50 degrees, more than an imaging
# sonar sees as it is; and how far behind its foot they may be looked for [m].
STEEP = wp.constant(1.2)
FURTHEST_TOP = wp.constant(1.0)

# How a ray is followed back to see whether it ran through the object [m].
COVER_STEP = wp.constant(0.05)
COVER_STEPS = wp.constant(40)

# Not from the face itself: contacts scatter about its edge.
COVER_START = wp.constant(3)


@wp.func
def highest_along(
    grid: Grid, model: FrontModel, top: wp.array3d(dtype=int), owner: int, point: wp.vec3, ahead: wp.vec3
) -> float:
    """Height that a face may end at, along the way: of the highest contact close by, or so high that the face is steep.

    Arcs of contacts on the edge itself meet the face at a slant: where a top behind it is hardly lower, that counts.
    """
    highest = float(NO_HEIGHT)
    behind = float(NO_HEIGHT)
    steps = int(wp.ceil((model.before + FURTHEST_TOP) / grid.cell))
    for step in range(steps + 1):
        away = float(step) * grid.cell - model.before
        height = top_height(grid, top, owner, point + away * ahead)
        if away <= model.behind or height - point[2] > STEEP * away:
            highest = wp.max(highest, height)
            if away > model.before:
                behind = wp.max(behind, height)
    return wp.where(highest - behind < model.edge_height, behind, highest)


@wp.func
def highest_before(
    grid: Grid, model: FrontModel, top: wp.array3d(dtype=int), owner: int, point: wp.vec3, ahead: wp.vec3
) -> float:
    """Highest contact that stands before a face, too far to be its upper edge: both may be off by ``before``."""
    highest = float(NO_HEIGHT)
    for step in range(1, int(wp.ceil((model.behind - model.before) / grid.cell)) + 1):
        away = 2.0 * model.before + float(step) * grid.cell
        highest = wp.max(highest, top_height(grid, top, owner, point - away * ahead))
    return highest


@wp.func
def is_covered(
    grid: Grid, top: wp.array3d(dtype=int), owner: int, head: wp.vec3, point: wp.vec3, clearance: float
) -> bool:
    """Whether the ray from a head to a point runs under contacts, ``clearance`` deep, on its last two metres."""
    back = wp.normalize(head - point)
    covered = bool(False)
    for step in range(COVER_START, COVER_STEPS):
        place = point + COVER_STEP * float(step) * back
        covered = covered or place[2] < top_height(grid, top, owner, place) - clearance
    return covered
