"""What single rays tell of the scene, and what a few of them foretell of the surface between them.

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

# Two samples agree when each one's plane foretells the other's range within this many bins, or within this part of the
# range between them where a cell is long (its bins are then many), and their normals lie within this cosine.
_RANGE_BINS = wp.constant(2.0)
_RANGE_PART = wp.constant(0.25)
_NORMAL_COSINE = wp.constant(0.99)
_REFLECTION_PART = wp.constant(1.0e-3)

# Faces of one column join where one ends within this part of a cell of the other's start, and this many bins in range.
_JOINT_PART = wp.constant(0.02)
_JOINT_BINS = wp.constant(0.25)


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
    turn: float  # what the inverse range gains over one strip towards higher azimuth [1/m]
    right: float
    left: float


@wp.struct
class Profile:
    """Inverse range up one column of a cell, from 0 at its foot to 1 at its top: two faces and a straight line between.

    Where the faces meet, ``lower`` is ``upper``.
    """

    lower: float  # where the lower face ends
    upper: float  # where the upper face begins
    foot: float  # inverse ranges [1/m] at 0, lower, upper and 1
    lower_end: float
    upper_start: float
    top: float
    lower_weight: float
    upper_weight: float


@wp.func
def bin_width(fan: Fan):
    """Mean width of a range bin [m]."""
    bins = fan.range_edge.shape[0] - 1
    return (fan.range_edge[bins] - fan.range_edge[0]) / float(bins)


@wp.func
def forming_reach(fan: Fan):
    """Longest range [m] that a forming ray looks at."""
    return fan.range_edge[fan.range_edge.shape[0] - 1] + _REACH_BINS * bin_width(fan)


@wp.func
def reflection_magnitude(scenes: SceneTable, scene: int, face: int):
    """Magnitude of a face's pressure reflection, |z - z0| / (z + z0) (Eq. 36)."""
    impedance = scenes.impedance[scenes.first_face[scene] + face]
    return wp.abs(impedance - scenes.water) / (impedance + scenes.water)


@wp.func
def take_sample(scenes: SceneTable, scene: int, pose: wp.transform, direction: wp.vec3, reach: float):
    """Cast one ray of a sonar at ``pose`` along ``direction``, a unit vector in the sonar's frame."""
    sample = Sample()
    sample.direction = direction
    world = wp.transform_vector(pose, direction)
    distance, face, normal = cast_ray(scenes.mesh[scene], wp.transform_get_translation(pose), world, reach)
    sample.face = face
    if face != NO_FACE:
        cosine = wp.dot(normal, world)
        if wp.abs(cosine) < _LEAST_COSINE:
            cosine = wp.where(cosine < 0.0, -_LEAST_COSINE, _LEAST_COSINE)
        height = cosine * distance
        sample.plane = wp.quat_rotate_inv(wp.transform_get_rotation(pose), normal) / height
        sample.inverse = 1.0 / distance
        sample.weight = reflection_magnitude(scenes, scene, face) * height * height
    return sample


@wp.func
def face_extent(mesh: wp.uint64, face: int, origin: wp.vec3, along: wp.vec3, up: wp.vec3):
    """How far a face goes on from the direction ``along`` in the plane of ``along`` and ``up``: angles down and up."""
    side = wp.cross(along, up)
    a = wp.mesh_get_point(mesh, 3 * face) - origin
    b = wp.mesh_get_point(mesh, 3 * face + 1) - origin
    c = wp.mesh_get_point(mesh, 3 * face + 2) - origin
    lower = float(0.0)
    upper = float(0.0)
    for _edge in range(3):
        at_a = wp.dot(a, side)
        at_b = wp.dot(b, side)
        if at_a * at_b < 0.0:
            point = a + (b - a) * (at_a / (at_a - at_b))
            angle = wp.atan2(wp.dot(point, up), wp.dot(point, along))
            lower = wp.min(lower, angle)
            upper = wp.max(upper, angle)
        first = a
        a = b
        b = c
        c = first
    return lower, upper


@wp.func
def follow_face(scenes: SceneTable, scene: int, pose: wp.transform, sample: Sample, above: wp.vec3, step: float, width: float):
    """Add how a sample's face goes on; ``above`` is the direction one cell height, ``step`` [rad], up the column."""
    tangent = above - sample.direction
    tangent = wp.normalize(tangent - sample.direction * wp.dot(tangent, sample.direction))
    along = wp.transform_vector(pose, sample.direction)
    up = wp.transform_vector(pose, tangent)
    side = wp.cross(up, along)
    origin = wp.transform_get_translation(pose)
    lower, upper = face_extent(scenes.mesh[scene], sample.face, origin, along, up)
    sample.down = lower / step
    sample.up = upper / step
    sample.rise = wp.dot(sample.plane, above) - sample.inverse
    lower, upper = face_extent(scenes.mesh[scene], sample.face, origin, along, side)
    sample.right = lower / width
    sample.left = upper / width
    return sample


@wp.func
def samples_agree(a: Sample, b: Sample, fan: Fan):
    """Whether two rays tell of one smooth surface: same face, or planes that foretell each other."""
    if a.face == b.face:
        return True
    tolerance = _RANGE_BINS * bin_width(fan)
    if a.face == NO_FACE or b.face == NO_FACE:
        # One of the two is zero: the plane that was met must lie beyond reach where nothing was.
        foretold = wp.dot(a.plane, b.direction) + wp.dot(b.plane, a.direction)
        return foretold * (forming_reach(fan) - tolerance) < 1.0
    apart = _RANGE_PART * wp.abs(a.inverse - b.inverse)
    if wp.abs(wp.dot(a.plane, b.direction) - b.inverse) > wp.max(tolerance * b.inverse * b.inverse, apart):
        return False
    if wp.abs(wp.dot(b.plane, a.direction) - a.inverse) > wp.max(tolerance * a.inverse * a.inverse, apart):
        return False
    square_a = wp.dot(a.plane, a.plane)
    square_b = wp.dot(b.plane, b.plane)
    reflection = a.weight * square_a
    if wp.abs(reflection - b.weight * square_b) > _REFLECTION_PART * reflection:
        return False
    product = wp.dot(a.plane, b.plane)
    return product > 0.0 and product * product > _NORMAL_COSINE * _NORMAL_COSINE * square_a * square_b


@wp.func
def faces_join(low: Sample, high: Sample, fan: Fan):
    """Whether two faces of a column meet between their rays, at whatever angle: a fold, not an outline."""
    if low.face == NO_FACE or high.face == NO_FACE:
        return False
    if wp.abs(low.up - 1.0 - high.down) > _JOINT_PART:
        return False
    at_low = low.inverse + low.rise * low.up
    at_high = high.inverse + high.rise * high.down
    return wp.abs(at_low - at_high) < _JOINT_BINS * bin_width(fan) * at_low * at_low


@wp.func
def row_fold(a: Sample, c: Sample, fan: Fan):
    """Where the faces of two neighbouring columns meet, 0-1; negative where they do not in between."""
    if a.face == NO_FACE or c.face == NO_FACE:
        return -1.0
    if wp.abs(a.left - 1.0 - c.right) > _JOINT_PART:
        return -1.0
    at_a = a.inverse + (wp.dot(a.plane, c.direction) - a.inverse) * a.left
    at_c = c.inverse + (wp.dot(c.plane, a.direction) - c.inverse) * -c.right
    if wp.abs(at_a - at_c) > _JOINT_BINS * bin_width(fan) * at_a * at_a:
        return -1.0
    return a.left


@wp.func
def column_profile(low: Sample, high: Sample):
    """Profile between the two corners of a column."""
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
    profile.upper_start = high.inverse + high.rise * (profile.upper - 1.0)
    profile.top = high.inverse
    profile.lower_weight = low.weight
    profile.upper_weight = high.weight
    return profile


@wp.func
def fold_profile(low: Sample, high: Sample, left: Profile, right: Profile, fold: float, low_across: float, high_across: float):
    """Profile up a fold between two columns, on the faces of the left one; weights are the left one's."""
    profile = left
    profile.lower = left.lower + (right.lower - left.lower) * fold
    profile.upper = left.upper + (right.upper - left.upper) * fold
    profile.foot = low.inverse + low_across * fold
    profile.top = high.inverse + high_across * fold
    profile.lower_end = profile.foot + low.rise * profile.lower
    profile.upper_start = profile.top - high.rise * (1.0 - profile.upper)
    return profile


@wp.func
def profile_inverse(profile: Profile, t: float):
    """Inverse range [1/m] at ``t`` of a column, 0-1."""
    if t <= profile.lower:
        return profile.foot + (profile.lower_end - profile.foot) * t / wp.max(profile.lower, 1.0e-6)
    if t >= profile.upper:
        return profile.top + (profile.upper_start - profile.top) * (1.0 - t) / wp.max(1.0 - profile.upper, 1.0e-6)
    part = (t - profile.lower) / (profile.upper - profile.lower)
    return profile.lower_end + (profile.upper_start - profile.lower_end) * part


@wp.func
def profile_weight(profile: Profile, t: float):
    """Weight [m^2] at ``t`` of a column, 0-1."""
    if t <= profile.lower:
        return profile.lower_weight
    if t >= profile.upper:
        return profile.upper_weight
    return 0.5 * (profile.lower_weight + profile.upper_weight)
