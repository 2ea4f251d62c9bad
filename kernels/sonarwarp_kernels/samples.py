"""What single rays tell of the scene, and what neighbouring rays foretell of the surface between them.

A plane at signed distance h with unit normal n is kept as ``plane = n / h`` in the sonar's frame: the inverse range in
any direction d is then ``plane . d``, whichever way the face is wound, and the echo amplitude of Eq. 36 is that inverse
range's fourth power times the reflection and h^2. Spans of range therefore need no trigonometry.
"""

import warp as wp

from sonarwarp_kernels.raycast import NO_FACE, cast_ray
from sonarwarp_kernels.specs import Fan, SceneTable

wp.set_module_options({"enable_backward": False})

# Rays look this many bins beyond the window, so that a cell which the window's end crosses is still smooth.
_REACH_BINS = wp.constant(4.0)

# Least |n . d|: a ray that grazes its face must not make an infinite plane.
_LEAST_COSINE = wp.constant(1.0e-4)

# Nearer than any window's start [m].
_LEAST_DISTANCE = wp.constant(1.0e-3)

# Where a face goes on so far that its end does not matter, in cell heights.
_FAR = wp.constant(1.0e6)

# Two samples agree when each one's plane foretells the other's range within this many bins, or within this part of the
# range between them where a cell is long (its bins are then many), and their normals lie within this cosine (14 deg).
_RANGE_BINS = wp.constant(2.0)
_RANGE_PART = wp.constant(0.25)
_SMOOTH_COSINE = wp.constant(0.97)
_REFLECTION_PART = wp.constant(1.0e-3)

# Normals under this cosine (3.6 deg) make a fold to be found between two columns; the ripples of a seabed do not.
_FOLD_COSINE = wp.constant(0.998)


@wp.struct
class Sample:
    """What one ray met, and how its face goes on along the column of its azimuth; lengths there in cell heights."""

    direction: wp.vec3  # unit vector in the sonar's frame
    plane: wp.vec3  # n / h in the sonar's frame [1/m]; zero on a miss
    inverse: float  # inverse range [1/m]; zero on a miss
    rise: float  # what the inverse range gains over one cell height up the column [1/m]
    weight: float  # reflection times h^2 [m^2]
    face: int
    down: float  # where the face ends below, <= 0
    up: float  # where the face ends above, >= 0


@wp.struct
class Profile:
    """The surface up one column of a cell, from 0 at its foot to 1 at its top: two faces, a straight line between.

    The line bridges faces that no ray met; where the two meet, ``lower`` is ``upper``.
    """

    lower: float  # where the lower face ends
    upper: float  # where the upper face begins
    foot: float  # inverse ranges [1/m] at 0, lower, upper and 1
    lower_end: float
    upper_start: float
    top: float
    lower_weight: float  # of either face [m^2]
    upper_weight: float


@wp.struct
class Fold:
    """How the surface goes on between two samples that lie beside each other, a strip apart."""

    across: float  # where their planes meet, 0-1 from the first; negative where they do not in between
    turn: float  # what the first plane's inverse range gains over the strip [1/m]
    next_turn: float  # and the second's
    sharp: int  # 1 where the planes differ so much that the fold matters


@wp.func
def bin_width(fan: Fan) -> float:
    """Mean width of a range bin [m]."""
    bins = fan.range_edge.shape[0] - 1
    return (fan.range_edge[bins] - fan.range_edge[0]) / float(bins)


@wp.func
def forming_reach(fan: Fan) -> float:
    """Longest range [m] that a forming ray looks at."""
    return fan.range_edge[fan.range_edge.shape[0] - 1] + _REACH_BINS * bin_width(fan)


@wp.func
def reflection_magnitude(scenes: SceneTable, scene: int, face: int) -> float:
    """Magnitude of a face's pressure reflection, |z - z0| / (z + z0) (Eq. 36)."""
    impedance = scenes.impedance[scenes.first_face[scene] + face]
    return wp.abs(impedance - scenes.water) / (impedance + scenes.water)


@wp.func
def take_sample(scenes: SceneTable, scene: int, pose: wp.transform, direction: wp.vec3, reach: float) -> Sample:
    """Cast one ray of a sonar at ``pose`` along ``direction``, a unit vector in the sonar's frame."""
    sample = Sample()
    sample.direction = direction
    world = wp.transform_vector(pose, direction)
    distance, face, normal = cast_ray(scenes.mesh[scene], wp.transform_get_translation(pose), world, reach)
    sample.face = face
    if face != NO_FACE:
        # A sonar that touches a face is at no distance, but has no inverse range then.
        distance = wp.max(distance, _LEAST_DISTANCE)
        cosine = wp.dot(normal, world)
        if wp.abs(cosine) < _LEAST_COSINE:
            cosine = wp.where(cosine < 0.0, -_LEAST_COSINE, _LEAST_COSINE)
        height = cosine * distance
        sample.plane = wp.quat_rotate_inv(wp.transform_get_rotation(pose), normal) / height
        sample.inverse = 1.0 / distance
        sample.weight = reflection_magnitude(scenes, scene, face) * height * height
    return sample


@wp.func
def column_climb(azimuth: float, elevation: float, cone: int) -> wp.vec3:
    """Derivative of ``geometry.beam_direction`` by elevation."""
    ca = wp.cos(azimuth)
    ce = wp.cos(elevation)
    se = wp.sin(elevation)
    if cone != 0:
        return wp.vec3(-ca * se, 0.0, ca * ce)
    return wp.vec3(-ca * se, -wp.sin(azimuth) * se, ce)


@wp.func
def follow_column(mesh: wp.uint64, pose: wp.transform, sample: Sample, climb: wp.vec3) -> Sample:
    """Add how a sample's face goes on; ``climb`` is what the direction gains over one cell height."""
    sample.rise = wp.dot(sample.plane, climb)
    # The plane that holds the column, in which the face is a line: cut both edges that cross it.
    scale = wp.length_sq(climb)
    along = wp.transform_vector(pose, sample.direction)
    up = wp.transform_vector(pose, climb) / scale
    side = wp.cross(along, up)
    origin = wp.transform_get_translation(pose)
    a = wp.mesh_get_point(mesh, 3 * sample.face) - origin
    b = wp.mesh_get_point(mesh, 3 * sample.face + 1) - origin
    c = wp.mesh_get_point(mesh, 3 * sample.face + 2) - origin
    at_a = wp.dot(a, side)
    at_b = wp.dot(b, side)
    at_c = wp.dot(c, side)
    for _edge in range(3):
        if at_a * at_b <= 0.0 and at_a != at_b:
            point = a * at_b - b * at_a
            forward = wp.dot(point, along)
            upward = wp.dot(point, up)
            if at_b < at_a:
                forward = -forward
                upward = -upward
            # The tangent is the angle over the few cells that matter; behind the sonar the face has long gone on.
            end = wp.where(upward > 0.0, _FAR, -_FAR)
            if forward > 0.0:
                end = upward / forward
            sample.down = wp.min(sample.down, end)
            sample.up = wp.max(sample.up, end)
        first = a
        a = b
        b = c
        c = first
        at_first = at_a
        at_a = at_b
        at_b = at_c
        at_c = at_first
    return sample


@wp.func
def ranges_agree(inverse: float, foretold: float, spread: float, fan: Fan) -> bool:
    """Whether an inverse range is as foretold, in a place over which inverse ranges differ by ``spread`` [1/m]."""
    bins = _RANGE_BINS * bin_width(fan) * inverse * inverse
    return wp.abs(inverse - foretold) <= wp.max(bins, _RANGE_PART * spread)


@wp.func
def is_beyond_reach(foretold: float, fan: Fan) -> bool:
    """Whether a ray may well meet nothing where a foretold inverse range [1/m] lies."""
    return foretold * (forming_reach(fan) - _RANGE_BINS * bin_width(fan)) < 1.0


@wp.func
def plane_cosine(a: Sample, b: Sample) -> float:
    """Cosine between the planes of two samples that met something, whichever way their faces are wound."""
    return wp.dot(a.plane, b.plane) / wp.sqrt(wp.length_sq(a.plane) * wp.length_sq(b.plane))


@wp.func
def samples_agree(a: Sample, b: Sample, fan: Fan) -> bool:
    """Whether two rays tell of one smooth surface: same face, or planes that foretell each other."""
    if a.face == b.face:
        return True
    b_by_a = wp.dot(a.plane, b.direction)
    a_by_b = wp.dot(b.plane, a.direction)
    if a.face == NO_FACE:
        return is_beyond_reach(a_by_b, fan)
    if b.face == NO_FACE:
        return is_beyond_reach(b_by_a, fan)
    spread = wp.abs(a.inverse - b.inverse)
    if not (ranges_agree(a.inverse, a_by_b, spread, fan) and ranges_agree(b.inverse, b_by_a, spread, fan)):
        return False
    reflection = a.weight * wp.length_sq(a.plane)
    if wp.abs(reflection - b.weight * wp.length_sq(b.plane)) > _REFLECTION_PART * reflection:
        return False
    return plane_cosine(a, b) > _SMOOTH_COSINE


@wp.func
def column_profile(low: Sample, high: Sample) -> Profile:
    """Profile between two samples that are one cell height apart on a column."""
    profile = Profile()
    profile.lower = 1.0
    profile.upper = 1.0
    if low.face != high.face:
        profile.lower = wp.min(low.up, 1.0)
        profile.upper = wp.max(1.0 + high.down, 0.0)
        if profile.lower > profile.upper:
            profile.lower = 0.5 * (profile.lower + profile.upper)
            profile.upper = profile.lower
    profile.foot = low.inverse
    profile.lower_end = low.inverse + low.rise * profile.lower
    profile.upper_start = high.inverse - high.rise * (1.0 - profile.upper)
    profile.top = high.inverse
    profile.lower_weight = low.weight
    profile.upper_weight = high.weight
    return profile


@wp.func
def profile_inverse(profile: Profile, height: float) -> float:
    """Inverse range [1/m] at ``height`` 0-1 up a column."""
    if height < profile.lower:
        return profile.foot + (profile.lower_end - profile.foot) * height / profile.lower
    if height > profile.upper:
        return profile.top + (profile.upper_start - profile.top) * (1.0 - height) / (1.0 - profile.upper)
    if profile.lower == profile.upper:
        return 0.5 * (profile.lower_end + profile.upper_start)
    part = (height - profile.lower) / (profile.upper - profile.lower)
    return profile.lower_end + (profile.upper_start - profile.lower_end) * part


@wp.func
def profile_weight(profile: Profile, height: float) -> float:
    """Weight [m^2] at ``height`` 0-1 up a column."""
    if height < profile.lower:
        return profile.lower_weight
    if height > profile.upper:
        return profile.upper_weight
    return 0.5 * (profile.lower_weight + profile.upper_weight)


@wp.func
def find_fold(sample: Sample, beside: Sample) -> Fold:
    """Fold between two samples that met something, the second a strip further in azimuth."""
    fold = Fold()
    fold.across = -1.0
    own_there = wp.dot(sample.plane, beside.direction)
    other_here = wp.dot(beside.plane, sample.direction)
    fold.turn = own_there - sample.inverse
    fold.next_turn = beside.inverse - other_here
    if sample.face != beside.face:
        step_here = sample.inverse - other_here
        step_there = own_there - beside.inverse
        if step_here * step_there < 0.0:
            fold.across = step_here / (step_here - step_there)
        if plane_cosine(sample, beside) < _FOLD_COSINE:
            fold.sharp = 1
    return fold
