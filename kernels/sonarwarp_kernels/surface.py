"""Judging a cloud against any mesh: nearest surface point, nearest cloud point, what a sonar could see.

A cloud is judged both ways round: from its points to the surface (accuracy) and from the surface that the sonars could
see to its points (completeness). Everything is a flat list over many clouds, each entry naming its cloud.
"""

from typing import Any

import warp as wp

from sonarwarp_kernels.geometry import polar_coordinates
from sonarwarp_kernels.launch import check_array, launch
from sonarwarp_kernels.raycast import NO_FACE, NO_HIT, cast_ray

wp.set_module_options({"enable_backward": False})

TOO_FAR = wp.constant(float("inf"))
"""Distance [m] where nothing lies within the reach of a search."""


@wp.struct
class View:
    """Angles and ranges that a sonar covers, in its own frame; both ends belong to it."""

    azimuth_min: float  # [rad], positive to the left
    azimuth_max: float  # [rad]
    elevation_min: float  # [rad], positive upwards
    elevation_max: float  # [rad]
    range_min: float  # [m]
    range_max: float  # [m]
    cone: int  # 1 where a beam keeps y / r, 0 where it keeps azimuth (``geometry.polar_coordinates``)


@wp.func
def surface_point(mesh: wp.uint64, point: wp.vec3, reach: float):
    """Nearest point of a mesh to ``point`` [m]: distance [m], position [m], face.

    ``TOO_FAR``, ``point`` itself and ``NO_FACE`` where no face lies within ``reach`` [m]; mesh 0 is an empty scene.
    """
    distance = float(TOO_FAR)
    position = point
    face = int(NO_FACE)
    if mesh != wp.uint64(0):
        query = wp.mesh_query_point_no_sign(mesh, point, reach)
        if query.result:
            face = query.face
            position = wp.mesh_eval_position(mesh, face, query.u, query.v)
            distance = wp.length(position - point)
    return distance, position, face


@wp.func
def in_view(view: View, world_from_sensor: wp.transform, point: wp.vec3) -> bool:
    """Whether a world ``point`` [m] lies in the angles and ranges of a sonar, whatever stands in between."""
    local = wp.transform_point(wp.transform_inverse(world_from_sensor), point)
    polar = polar_coordinates(local, view.cone)
    return (
        polar[0] >= view.range_min
        and polar[0] <= view.range_max
        and polar[1] >= view.azimuth_min
        and polar[1] <= view.azimuth_max
        and polar[2] >= view.elevation_min
        and polar[2] <= view.elevation_max
    )


@wp.func
def line_of_sight(mesh: wp.uint64, origin: wp.vec3, point: wp.vec3, clearance: float) -> bool:
    """Whether nothing stands between two points [m]; what lies within ``clearance`` [m] of ``point`` is the point."""
    between = point - origin
    reach = wp.length(between) - clearance
    if reach <= 0.0:
        return True
    distance, _face, _normal = cast_ray(mesh, origin, wp.normalize(between), reach)
    return distance == NO_HIT


@wp.func
def seen(mesh: wp.uint64, view: View, world_from_sensor: wp.transform, point: wp.vec3, clearance: float) -> bool:
    """Whether a sonar sees ``point`` [m]: in its view, and nothing in between."""
    if not in_view(view, world_from_sensor, point):
        return False
    return line_of_sight(mesh, wp.transform_get_translation(world_from_sensor), point, clearance)


@wp.kernel
def surface_points_kernel(
    first: int,
    mesh: wp.array(dtype=wp.uint64),  # [cloud]
    point: wp.array(dtype=wp.vec3),  # [point]
    cloud: wp.array(dtype=int),  # [point]
    reach: float,
    distance_out: wp.array(dtype=float),  # [point]
    position_out: wp.array(dtype=wp.vec3),  # [point]
    face_out: wp.array(dtype=int),  # [point]
):
    index = first + wp.tid()
    distance, position, face = surface_point(mesh[cloud[index]], point[index], reach)
    distance_out[index] = distance
    position_out[index] = position
    face_out[index] = face


def surface_points(
    mesh: wp.array,
    point: wp.array,
    cloud: wp.array,
    reach: float,
    distance_out: wp.array,
    position_out: wp.array,
    face_out: wp.array,
    *,
    device: Any = None,
    threads: int = 1,
) -> None:
    """Nearest surface point of each cloud point.

    Args:
        mesh: id of the ``wp.Mesh`` that each cloud is judged against, 0 for none, shape [cloud].
        point: cloud points in the world frame [m], shape [point].
        cloud: cloud of each point, shape [point].
        reach: how far to search [m].
        distance_out: unsigned distance [m], ``TOO_FAR`` where no face is within reach, shape [point].
        position_out: nearest surface point [m], the point itself where none is within reach, shape [point].
        face_out: face of that mesh, ``NO_FACE`` where none is within reach, shape [point].
    """
    device = wp.get_device(device)
    shape = (point.shape[0],)
    check_array("mesh", mesh, (None,), wp.uint64, device)
    check_array("point", point, shape, wp.vec3, device)
    check_array("cloud", cloud, shape, wp.int32, device)
    check_array("distance_out", distance_out, shape, wp.float32, device)
    check_array("position_out", position_out, shape, wp.vec3, device)
    check_array("face_out", face_out, shape, wp.int32, device)
    launch(
        surface_points_kernel,
        shape,
        [mesh, point, cloud, reach],
        [distance_out, position_out, face_out],
        device,
        threads,
    )


@wp.kernel
def cloud_distances_kernel(
    first: int,
    grid: wp.array(dtype=wp.uint64),  # [cloud]
    point: wp.array(dtype=wp.vec3),  # [point]
    first_point: wp.array(dtype=int),  # [cloud]
    sample: wp.array(dtype=wp.vec3),  # [sample]
    cloud: wp.array(dtype=int),  # [sample]
    reach: float,
    distance_out: wp.array(dtype=float),  # [sample]
):
    index = first + wp.tid()
    owner = cloud[index]
    position = sample[index]
    nearest = float(TOO_FAR)
    if grid[owner] != wp.uint64(0):
        for neighbour in wp.hash_grid_query(grid[owner], position, reach):
            distance = wp.length(point[first_point[owner] + neighbour] - position)
            # The grid hands out whole cells.
            if distance <= reach:
                nearest = wp.min(nearest, distance)
    distance_out[index] = nearest


def cloud_distances(
    grid: wp.array,
    point: wp.array,
    first_point: wp.array,
    sample: wp.array,
    cloud: wp.array,
    reach: float,
    distance_out: wp.array,
    *,
    device: Any = None,
    threads: int = 1,
) -> None:
    """Distance from each surface sample to its cloud's nearest point.

    Args:
        grid: id of a ``wp.HashGrid`` built over each cloud's points, 0 for an empty cloud, shape [cloud].
        point: points of all clouds in turn [m], shape [point].
        first_point: where each cloud begins in ``point``, shape [cloud].
        sample: surface samples in the world frame [m], shape [sample].
        cloud: cloud that each sample is looked up in, shape [sample].
        reach: how far to search [m]; the grid's cells are best as large.
        distance_out: distance [m], ``TOO_FAR`` where no point is within reach, shape [sample].
    """
    device = wp.get_device(device)
    clouds, samples = grid.shape[0], sample.shape[0]
    check_array("grid", grid, (clouds,), wp.uint64, device)
    check_array("point", point, (None,), wp.vec3, device)
    check_array("first_point", first_point, (clouds,), wp.int32, device)
    check_array("sample", sample, (samples,), wp.vec3, device)
    check_array("cloud", cloud, (samples,), wp.int32, device)
    check_array("distance_out", distance_out, (samples,), wp.float32, device)
    launch(
        cloud_distances_kernel,
        (samples,),
        [grid, point, first_point, sample, cloud, reach],
        [distance_out],
        device,
        threads,
    )


@wp.kernel
def visible_samples_kernel(
    first: int,
    mesh: wp.array(dtype=wp.uint64),  # [cloud]
    view: View,
    world_from_sensor: wp.array(dtype=wp.transform),  # [frame]
    first_frame: wp.array(dtype=int),  # [cloud + 1]
    sample: wp.array(dtype=wp.vec3),  # [sample]
    cloud: wp.array(dtype=int),  # [sample]
    clearance: float,
    visible_out: wp.array(dtype=int),  # [sample]
):
    index = first + wp.tid()
    owner = cloud[index]
    point = sample[index]
    visible = int(0)
    for frame in range(first_frame[owner], first_frame[owner + 1]):
        if seen(mesh[owner], view, world_from_sensor[frame], point, clearance):
            visible = 1
            break
    visible_out[index] = visible


def visible_samples(
    mesh: wp.array,
    view: View,
    world_from_sensor: wp.array,
    first_frame: wp.array,
    sample: wp.array,
    cloud: wp.array,
    clearance: float,
    visible_out: wp.array,
    *,
    device: Any = None,
    threads: int = 1,
) -> None:
    """Which surface samples a sonar could see: in its view and first along the ray, from one pose at least.

    Args:
        mesh: id of the ``wp.Mesh`` that each cloud is judged against, 0 for none, shape [cloud].
        view: angles and ranges that the sonar covers.
        world_from_sensor: poses of all clouds in turn, shape [frame].
        first_frame: where each cloud's poses begin, and the end of the last, shape [cloud + 1].
        sample: surface samples in the world frame [m], shape [sample].
        cloud: cloud of each sample, shape [sample].
        clearance: how much nearer a face has to be to hide a sample [m]; float32 and grazing rays need some.
        visible_out: 1 where visible, 0 elsewhere, shape [sample].
    """
    device = wp.get_device(device)
    clouds, samples = mesh.shape[0], sample.shape[0]
    check_array("mesh", mesh, (clouds,), wp.uint64, device)
    check_array("world_from_sensor", world_from_sensor, (None,), wp.transform, device)
    check_array("first_frame", first_frame, (clouds + 1,), wp.int32, device)
    check_array("sample", sample, (samples,), wp.vec3, device)
    check_array("cloud", cloud, (samples,), wp.int32, device)
    check_array("visible_out", visible_out, (samples,), wp.int32, device)
    launch(
        visible_samples_kernel,
        (samples,),
        [mesh, view, world_from_sensor, first_frame, sample, cloud, clearance],
        [visible_out],
        device,
        threads,
    )
