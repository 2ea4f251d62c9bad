"""Ray casting against meshes (Eq. 33): one ray, a grid of rays in each sonar's frame, a beam's first contact.

Kernels read world poses; azimuth and elevation are those of ``geometry.beam_direction``.
"""

from typing import Any

import warp as wp

from sonarwarp_kernels.geometry import beam_direction
from sonarwarp_kernels.launch import check_array, lanes, launch
from sonarwarp_kernels.specs import Fan, SceneTable

wp.set_module_options({"enable_backward": False})

NO_HIT = wp.constant(float("inf"))
"""Range [m] of a ray that meets nothing within its reach; its face is ``NO_FACE`` and its normal zero."""

NO_FACE = wp.constant(-1)

# A ray may slip between two faces that share an edge; one that is a micrometre aside at 1 m does not find the same gap.
_OFFSET = wp.constant(1.0e-6)


@wp.func
def cast_ray(mesh: wp.uint64, origin: wp.vec3, direction: wp.vec3, reach: float):
    """First face along a ray from ``origin`` [m], nearer than ``reach`` [m]; ``direction`` is a unit vector.

    Returns range [m], face and unit normal as wound (not turned towards the ray). Mesh 0 is an empty scene.
    """
    distance = float(NO_HIT)
    face = int(NO_FACE)
    normal = wp.vec3(0.0, 0.0, 0.0)
    if mesh != wp.uint64(0):
        query = wp.mesh_query_ray(mesh, origin, direction, reach)
        if not query.result:
            query = wp.mesh_query_ray(mesh, origin, direction + wp.vec3(_OFFSET, -_OFFSET, _OFFSET), reach)
        if not query.result:
            query = wp.mesh_query_ray(mesh, origin, direction + wp.vec3(_OFFSET, _OFFSET, -_OFFSET), reach)
        if query.result:
            distance = query.t
            face = query.face
            normal = query.normal
    return distance, face, normal


@wp.kernel
def cast_grid_kernel(
    first: int,
    scenes: SceneTable,
    azimuth: wp.array(dtype=float),  # [column]
    elevation: wp.array(dtype=float),  # [row]
    cone: int,
    reach: float,
    world_from_sensor: wp.array(dtype=wp.transform),  # [frame]
    scene_index: wp.array(dtype=int),  # [frame]
    lane_count: int,
    range_out: wp.array3d(dtype=float),  # [frame, column, row]
    face_out: wp.array3d(dtype=int),  # [frame, column, row]
    normal_out: wp.array3d(dtype=wp.vec3),  # [frame, column, row]
):
    line, lane = wp.tid()
    line += first
    columns = azimuth.shape[0]
    frame = line // columns
    column = line - frame * columns
    pose = world_from_sensor[frame]
    mesh = scenes.mesh[scene_index[frame]]
    for row in range(lane, elevation.shape[0], lane_count):
        direction = wp.transform_vector(pose, beam_direction(azimuth[column], elevation[row], cone))
        distance, face, normal = cast_ray(mesh, wp.transform_get_translation(pose), direction, reach)
        range_out[frame, column, row] = distance
        face_out[frame, column, row] = face
        normal_out[frame, column, row] = normal


def cast_grid(
    scenes: SceneTable,
    azimuth: wp.array,
    elevation: wp.array,
    cone: int,
    reach: float,
    world_from_sensor: wp.array,
    scene_index: wp.array,
    range_out: wp.array,
    face_out: wp.array,
    normal_out: wp.array,
    *,
    device: Any = None,
    threads: int = 1,
) -> None:
    """Cast the rays of every azimuth with every elevation from each sonar.

    Args:
        scenes: meshes.
        azimuth: shape [column], rad.
        elevation: shape [row], rad.
        cone: 1 for conical beams (``geometry.beam_direction``).
        reach: longest range [m].
        world_from_sensor: poses, shape [frame].
        scene_index: scene of each frame, shape [frame].
        range_out: slant range [m], ``NO_HIT`` where nothing is met, shape [frame, column, row].
        face_out: face of the scene's mesh, ``NO_FACE`` where nothing is met, shape [frame, column, row].
        normal_out: unit normal in the world frame as wound, zero where nothing is met, shape [frame, column, row].
    """
    device = wp.get_device(device)
    frames, columns, rows = world_from_sensor.shape[0], azimuth.shape[0], elevation.shape[0]
    check_array("azimuth", azimuth, (columns,), wp.float32, device)
    check_array("elevation", elevation, (rows,), wp.float32, device)
    check_array("world_from_sensor", world_from_sensor, (frames,), wp.transform, device)
    check_array("scene_index", scene_index, (frames,), wp.int32, device)
    check_array("range_out", range_out, (frames, columns, rows), wp.float32, device)
    check_array("face_out", face_out, (frames, columns, rows), wp.int32, device)
    check_array("normal_out", normal_out, (frames, columns, rows), wp.vec3, device)
    lane_count = lanes(device)
    launch(
        cast_grid_kernel,
        (frames * columns, lane_count),
        [scenes, azimuth, elevation, cone, reach, world_from_sensor, scene_index, lane_count],
        [range_out, face_out, normal_out],
        device,
        threads,
    )


@wp.kernel
def first_contacts_kernel(
    first: int,
    fan: Fan,
    scenes: SceneTable,
    world_from_sensor: wp.array(dtype=wp.transform),  # [frame]
    scene_index: wp.array(dtype=int),  # [frame]
    azimuths: int,
    elevations: int,
    range_out: wp.array2d(dtype=float),  # [frame, beam]
    azimuth_out: wp.array2d(dtype=float),  # [frame, beam]
    elevation_out: wp.array2d(dtype=float),  # [frame, beam]
    face_out: wp.array2d(dtype=int),  # [frame, beam]
):
    line = first + wp.tid()
    beams = fan.azimuth.shape[0]
    frame = line // beams
    beam = line - frame * beams
    pose = world_from_sensor[frame]
    mesh = scenes.mesh[scene_index[frame]]
    lower = fan.column_azimuth[fan.first_column[beam]]
    upper = fan.column_azimuth[fan.first_column[beam] + fan.strips]
    reach = fan.range_edge[fan.range_edge.shape[0] - 1]
    nearest = float(NO_HIT)
    nearest_azimuth = float(0.0)
    nearest_elevation = float(0.0)
    nearest_face = int(NO_FACE)
    for i in range(azimuths):
        azimuth = lower + (upper - lower) * (float(i) + 0.5) / float(azimuths)
        for j in range(elevations):
            part = (float(j) + 0.5) / float(elevations)
            elevation = fan.elevation_min + (fan.elevation_max - fan.elevation_min) * part
            direction = wp.transform_vector(pose, beam_direction(azimuth, elevation, fan.cone))
            distance, face, _normal = cast_ray(mesh, wp.transform_get_translation(pose), direction, reach)
            if distance < nearest:
                nearest = distance
                nearest_azimuth = azimuth
                nearest_elevation = elevation
                nearest_face = face
                # Only something nearer matters from here on.
                reach = distance
    range_out[frame, beam] = nearest
    azimuth_out[frame, beam] = nearest_azimuth
    elevation_out[frame, beam] = nearest_elevation
    face_out[frame, beam] = nearest_face


def first_contacts(
    fan: Fan,
    scenes: SceneTable,
    world_from_sensor: wp.array,
    scene_index: wp.array,
    azimuths: int,
    elevations: int,
    range_out: wp.array,
    azimuth_out: wp.array,
    elevation_out: wp.array,
    face_out: wp.array,
    *,
    device: Any = None,
    threads: int = 1,
) -> None:
    """What each beam meets first, over ``azimuths`` x ``elevations`` rays at the centres of equal parts of the beam.

    The truth that an elevation estimate is judged by. Range is ``NO_HIT``, face ``NO_FACE`` and both angles 0 where
    nothing lies nearer than the window's end.

    Args:
        fan: the sonar.
        scenes: meshes.
        world_from_sensor: poses, shape [frame].
        scene_index: scene of each frame, shape [frame].
        azimuths: rays across a beam.
        elevations: rays along a beam.
        range_out: slant range [m], shape [frame, beam].
        azimuth_out: azimuth of that contact [rad], shape [frame, beam].
        elevation_out: elevation of that contact [rad], shape [frame, beam].
        face_out: face of the scene's mesh, shape [frame, beam].
    """
    device = wp.get_device(device)
    shape = (world_from_sensor.shape[0], fan.azimuth.shape[0])
    check_array("world_from_sensor", world_from_sensor, shape[:1], wp.transform, device)
    check_array("scene_index", scene_index, shape[:1], wp.int32, device)
    check_array("range_out", range_out, shape, wp.float32, device)
    check_array("azimuth_out", azimuth_out, shape, wp.float32, device)
    check_array("elevation_out", elevation_out, shape, wp.float32, device)
    check_array("face_out", face_out, shape, wp.int32, device)
    if azimuths < 1 or elevations < 1:
        raise ValueError(f"azimuths, elevations: must be at least 1, got {azimuths}, {elevations}")
    launch(
        first_contacts_kernel,
        (shape[0] * shape[1],),
        [fan, scenes, world_from_sensor, scene_index, azimuths, elevations],
        [range_out, azimuth_out, elevation_out, face_out],
        device,
        threads,
    )
