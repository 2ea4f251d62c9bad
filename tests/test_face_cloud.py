"""Points of a face: where its patch is, as sure as that, and looking the way that the wall does."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import sonarwarp as sw
from sonarwarp.cloud_attributes import covariances_of, normals_of
from sonarwarp.face_cloud import face_cloud
from tests.reference.geometry import quaternion
from tests.small_runs import RIG, run
from tests.test_fronts import WALLS, WITHIN
from tests.wall_world import Wall, WallWorld, find


def survey_of(poses):
    """A survey whose pings are taken from heads at ``poses``, shape [ping, 7]."""
    survey, count = sw.plan_survey(RIG, [run(length=0.1)]), len(poses)
    pings = sw.Pings(
        time=np.arange(count) / 10,
        trajectory=np.zeros(count, dtype=int),
        number=np.arange(count),
        pose=np.array(poses),
        head_angle=np.zeros(count),
    )
    return replace(survey, pings=pings)


def survey_of_one_ping(roll, tilt=20.0):
    """A head at 2 m that looks ahead and ``tilt`` degrees down, turned about its axis by ``roll`` degrees."""
    turn = (Rotation.from_euler("y", tilt, degrees=True) * Rotation.from_euler("x", roll, degrees=True)).as_quat()
    return survey_of([[0.0, 0.0, 2.0, *turn]])


def fronts_of(low, high, found=1, run_along=(0.0, 0.0, 1.0)):
    """One patch, 3 m ahead and 1 m up, as the kernel leaves it."""
    return {
        "found": np.full((1, 1, 1), found),
        "point": np.full((1, 1, 1, 3), (3.0, 0.1, 1.0)),
        "run": np.full((1, 1, 1, 3), run_along),
        "low": np.full((1, 1, 1), low),
        "high": np.full((1, 1, 1), high),
        "deviation": np.full((1, 1, 1), 0.02),
    }


@pytest.mark.parametrize(
    ("low", "high", "count"),
    [(-0.1, 0.1, 5), (-0.1, 0.09, 4), (0.02, 0.03, 1), (0.0, 0.0, 1), (0.1, -0.1, 0)],
    ids=["a multiple of the spacing", "no multiple", "less than one", "a line", "nothing between"],
)
@pytest.mark.parametrize("along", [(0.0, 0.0, 1.0), (0.5, 0.1, 1.0)], ids=["upright", "inclined"])
def test_a_patch_is_filled_evenly_from_its_lower_to_its_upper_end(low, high, count, along):
    # A spacing that float64 holds exactly.
    low, high = low / 0.05 * 0.0625, high / 0.05 * 0.0625
    cloud = face_cloud(
        survey_of_one_ping(90.0), fronts_of(low, high, run_along=along), spacing=0.0625, registration=0.0
    )
    assert len(cloud) == count
    height = cloud.points[:, 2] - 1.0
    np.testing.assert_allclose(cloud.points, np.array([3.0, 0.1, 1.0]) + height[:, None] * along, atol=1e-6)
    np.testing.assert_allclose(np.diff(height), 0.0625, atol=1e-6)
    if count:
        # As much is left over below as above.
        assert height[0] - low == pytest.approx(high - height[-1], abs=1e-6)
        assert height[0] >= low - 1e-6


def test_a_patch_that_was_not_found_gives_no_points():
    assert len(face_cloud(survey_of_one_ping(90.0), fronts_of(-0.1, 0.1, found=0), spacing=0.05, registration=0.0)) == 0


def test_a_head_that_has_turned_sees_a_face_as_one_mounted_so():
    fixed, mounted = survey_of_one_ping(90.0, tilt=20.0), survey_of_one_ping(90.0, tilt=50.0)
    turned = replace(mounted, pings=replace(mounted.pings, head_angle=np.radians([30.0])))
    want, found = (face_cloud(each, fronts_of(-0.1, 0.1), spacing=0.05, registration=0.01) for each in (fixed, turned))
    for name, values in want.attributes.items():
        np.testing.assert_allclose(found.attributes[name], values, atol=1e-6, err_msg=name)


@pytest.mark.parametrize("roll", [90.0, -90.0])
def test_angles_of_a_face_are_positive_upwards_whichever_way_round_the_head_lies(roll):
    cloud = face_cloud(survey_of_one_ping(roll), fronts_of(-0.2, 0.2), spacing=0.1, registration=0.0)
    beam = np.arctan2(cloud.points[:, 2] - 2.0, cloud.points[:, 0]) + np.radians(20.0)
    np.testing.assert_allclose(cloud.attributes["elevation"], beam, atol=1e-3)
    assert np.all(np.diff(cloud.attributes["elevation"]) > 0)
    distance = np.sqrt(9.0 + 0.01 + (cloud.points[:, 2] - 2.0) ** 2)
    np.testing.assert_allclose(cloud.attributes["range"], distance, rtol=1e-6)
    # Its z axis points right or left.
    np.testing.assert_allclose(np.abs(cloud.attributes["azimuth"]), np.arcsin(0.1 / distance), rtol=1e-5)


def test_a_face_is_uncertain_across_itself_and_as_large_as_its_strip():
    cloud = face_cloud(survey_of_one_ping(90.0), fronts_of(-0.1, 0.1), spacing=0.05, registration=0.0)
    variance = {name: cloud.attributes[f"covariance_{name}"] for name in ("xx", "yy", "zz", "xy", "xz", "yz")}
    np.testing.assert_allclose(variance["xx"], 0.02**2, rtol=1e-5)
    for name in ("yy", "zz"):
        np.testing.assert_allclose(variance[name], 0.05**2 / 12, rtol=1e-5)
    for name in ("xy", "xz", "yz"):
        np.testing.assert_allclose(variance[name], 0.0, atol=1e-9)


@pytest.mark.parametrize("roll", [90.0, -90.0, 0.0])
@pytest.mark.parametrize("off", [0.0, 1e-9])
def test_under_a_head_that_looks_straight_down_a_face_may_look_any_way(roll, off):
    """Exactly or but for rounding: uncertain across by the face's deviation in every level direction."""
    cloud = face_cloud(survey_of_one_ping(roll, tilt=90.0 + off), fronts_of(-0.1, 0.1), spacing=0.05, registration=0.0)
    assert len(cloud) == 5
    assert all(np.isfinite(values).all() for values in cloud.attributes.values())
    variance = {name: cloud.attributes[f"covariance_{name}"] for name in ("xx", "yy", "zz", "xy", "xz", "yz")}
    for name in ("xx", "yy"):
        np.testing.assert_allclose(variance[name], 0.02**2, rtol=1e-5)
    np.testing.assert_allclose(variance["zz"], 0.05**2 / 12, rtol=1e-5)
    for name in ("xy", "xz", "yz"):
        assert np.all(variance[name] == 0.0)
    assert np.all(normals_of(cloud) == 0.0)


@pytest.mark.parametrize(("roll", "side"), [(0.0, 1.0), (180.0, -1.0)], ids=["upright", "upside down"])
def test_angles_of_a_head_that_does_not_lie_on_its_side_are_those_of_its_own_scan_plane(roll, side):
    """Level, that plane has no up: positive towards the head's y axis, left of an upright one."""
    cloud = face_cloud(survey_of_one_ping(roll), fronts_of(-0.2, 0.2), spacing=0.1, registration=0.0)
    ahead = np.array([np.cos(np.radians(20.0)), 0.0, -np.sin(np.radians(20.0))])
    angle = np.arctan2(cloud.points[:, 1], (cloud.points - [0.0, 0.0, 2.0]) @ ahead)
    assert np.all(angle > 0.03)
    np.testing.assert_allclose(cloud.attributes["elevation"], side * angle, rtol=1e-5)
    np.testing.assert_allclose(cloud.attributes["elevation_mean"], side * angle, rtol=1e-5)


def crossing(run, offset):
    """Elevation at which the arc of the point below a head 20 deg down meets a face ``offset`` behind it."""
    radius, tilt = np.hypot(3.0, 1.0), np.radians(20.0)

    def before(elevation):
        x, z = radius * np.cos(tilt - elevation), 2.0 - radius * np.sin(tilt - elevation)
        return x - 3.0 - run * (z - 1.0) - offset

    return brentq(before, -0.1, 0.15)


@pytest.mark.parametrize("run", [0.0, 0.15, 0.6, 1.5])
@pytest.mark.parametrize("roll", [90.0, -90.0])
def test_a_face_holds_its_elevation_to_where_its_arc_meets_it_within_95_per_cent_of_its_deviation(run, roll):
    fronts = fronts_of(-0.0004, 0.0004, run_along=(run, 0.0, 1.0)) | {"deviation": np.full((1, 1, 1), 0.0005)}
    cloud = face_cloud(survey_of_one_ping(roll), fronts, spacing=0.0002, registration=0.0)
    middle = len(cloud) // 2
    np.testing.assert_allclose(cloud.points[middle], (3.0, 0.1, 1.0), atol=1e-6)
    ends = sorted(crossing(run, side * 1.959964 * 0.0005) for side in (-1.0, 1.0))
    found = [cloud.attributes[name][middle] for name in ("elevation_low", "elevation_high")]
    # An arc bends.
    np.testing.assert_allclose(found, ends, atol=0.03 * (ends[1] - ends[0]))
    deviation = cloud.attributes["elevation_deviation"][middle]
    assert 2 * 1.959964 * deviation == pytest.approx(found[1] - found[0], rel=1e-4)


def test_registration_adds_to_a_faces_elevation_and_moves_it_along_its_arc():
    fronts = fronts_of(-0.1, 0.1) | {"deviation": np.full((1, 1, 1), 0.002)}
    alone, both = (
        face_cloud(survey_of_one_ping(90.0), fronts, spacing=0.05, registration=size) for size in (0.0, 0.005)
    )
    sharp, blunt = (cloud.attributes["elevation_deviation"] for cloud in (alone, both))
    np.testing.assert_allclose(blunt, np.hypot(sharp, 0.005), rtol=1e-5)
    more = covariances_of(both) - covariances_of(alone)
    for index, point in enumerate(both.points):
        ray = point - [0.0, 0.1, 2.0]
        up = np.array([-ray[2], 0.0, ray[0]])
        np.testing.assert_allclose(more[index], 0.005**2 * np.outer(up, up), atol=1e-8)


@pytest.mark.parametrize("run", [1.0 / 3.0, 0.0], ids=["square to the beam", "known badly"])
def test_a_face_that_tells_no_elevation_may_be_anywhere_in_the_beam(run):
    # A metre under the head: little over the 9 mm that a uniform beam deviates by.
    fronts = fronts_of(-0.1, 0.1, run_along=(run, 0.0, 1.0)) | {"deviation": np.full((1, 1, 1), 0.012)}
    cloud = face_cloud(
        survey_of_one_ping(90.0, tilt=np.degrees(np.arctan(1.0 / 3.0))), fronts, spacing=0.05, registration=0.0
    )
    uniform = np.radians(RIG.ps.beamwidth_deg) / np.sqrt(12.0)
    np.testing.assert_allclose(cloud.attributes["elevation_deviation"], uniform, rtol=1e-5)


# --- Which way a face looks ---


@pytest.mark.parametrize("heading_deg", [0, 37, 180])
@pytest.mark.parametrize("name", WALLS)
def test_a_face_looks_as_its_wall_does(device, name, heading_deg):
    slope, lowest = np.radians(WALLS[name][0]), WALLS[name][1]
    world = WallWorld.passing(Wall(WALLS[name][0]), lowest_contact=lowest, heading=np.radians(heading_deg))
    scene = world.scene()
    heads = [[*ping.position, *quaternion(ping.orientation)] for ping in scene.pings]
    cloud = face_cloud(survey_of(heads), find(device, scene), spacing=0.02, registration=0.0)
    normal, within = normals_of(cloud), np.abs((cloud.points @ world.turn)[:, 1]) < WITHIN
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0, rtol=1e-6)
    towards = np.array(heads)[cloud.attributes["frame"], :3] - cloud.points
    assert np.all(np.sum(normal * towards, axis=1) > 0.0)
    want = world.turn @ [-np.sin(slope), 0.0, np.cos(slope)]
    assert within.sum() > 1000
    # As near as the patches' lines, whose slope is within half a degree.
    assert np.degrees(np.arccos(np.minimum(normal[within] @ want, 1.0))).max() < 0.5


@pytest.mark.parametrize("roll", [90.0, -90.0, 0.0])
@pytest.mark.parametrize("incline", [0.0, 0.5, -0.3], ids=["upright", "leaning back", "overhanging"])
def test_a_normal_is_square_to_the_patch_and_level_across_the_way(roll, incline):
    along = np.array([incline, 0.0, 1.0])
    cloud = face_cloud(survey_of_one_ping(roll), fronts_of(-0.1, 0.1, run_along=along), spacing=0.05, registration=0.0)
    normal = normals_of(cloud)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0, rtol=1e-6)
    np.testing.assert_allclose(normal @ along, 0.0, atol=1e-6)
    np.testing.assert_allclose(normal[:, 1], 0.0, atol=1e-6)
    assert np.all(normal[:, 0] < 0.0)
