"""Descriptions that kernels read: a sonar's fan, the scenes, the field's grid, the range mixture.

Scalars and array addresses in a struct are frozen when a graph is captured; what changes per frame is an array.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.struct
class Fan:
    """Where a sonar sends its rays and how it bins what returns; the profiling sonar is a fan of one beam.

    A beam's aperture is cut into ``strips`` along azimuth, each between two neighbouring columns of rays, and into
    ``intervals`` along elevation. Beams that touch share the column between them.
    """

    azimuth: wp.array(dtype=float)  # [beam] centre [rad], positive to the left
    column_azimuth: wp.array(dtype=float)  # [column] borders of the strips [rad]
    first_column: wp.array(dtype=int)  # [beam] column at the beam's lower azimuth
    strips: int  # strips per beam
    elevation_min: float  # lower edge of every beam [rad]
    elevation_max: float  # upper edge of every beam [rad]
    intervals: int  # elevation intervals per strip
    cone: int  # 1 where a beam keeps y / r, 0 where it keeps azimuth
    range_edge: wp.array(dtype=float)  # [bin + 1] slant range [m], ascending
    amplitude: float  # k I0 times the gain in Eq. 36: echo amplitude at 1 m, normal incidence, full reflection
    fixed_point: float  # counts per unit of amplitude in integer sums


@wp.struct
class SceneTable:
    """Meshes of a batch. A mesh id of 0 is an empty scene: every ray misses."""

    mesh: wp.array(dtype=wp.uint64)  # [scene] id of a wp.Mesh in world coordinates
    first_face: wp.array(dtype=int)  # [scene] where the scene's faces begin in ``impedance``
    impedance: wp.array(dtype=float)  # [face] acoustic impedance of every scene's faces in turn [rayl]
    water: float  # acoustic impedance of water [rayl]


@wp.struct
class Grid:
    """Cells of the likelihood field, one box per trajectory, in arrays that hold the largest one.

    Nothing is written or read outside of a trajectory's own box: what its particles find there must not depend on
    which others share the arrays.
    """

    origin: wp.array(dtype=wp.vec3)  # [trajectory] world position of the lowest corner [m]
    size: wp.array(dtype=wp.vec3i)  # [trajectory] cells of the box along x, y and z, at most nx, ny and nz
    cell: float  # edge length [m]
    nx: int
    ny: int
    nz: int


@wp.struct
class Mixture:
    """Range likelihood of the imaging sonar (Eq. 9-13); the weights sum to 1."""

    weight_hit: float  # alpha_1: the critical point measured with noise (Eq. 10)
    weight_short: float  # alpha_2: something nearer, such as fish (Eq. 11)
    weight_random: float  # alpha_3: uniform (Eq. 12)
    weight_seabed: float  # alpha_4: the uneven seabed near r_emin (Eq. 13)
    deviation: float  # standard deviation of Eq. 10 [m]
    rate_short: float  # lambda of Eq. 11 [1/m]
    rate_seabed: float  # lambda of Eq. 13 [1/m]
