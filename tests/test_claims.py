"""Contacts are judged by what their beam met first, faces across them, from where their ping really was taken."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sonarwarp as sw
from sonarwarp.face_cloud import face_cloud
from sonarwarp.metrics import Claims, contact_claims, evaluate_calibration, face_claims
from sonarwarp.poses import compose, rotate
from sonarwarp.truth import FirstContacts
from sonarwarp_scenes import Scene
from tests.test_face_cloud import fronts_of, survey_of, survey_of_one_ping

NONE = FirstContacts(
    **{name: np.zeros((1, 1)) for name in ("range", "azimuth", "elevation")}, face=np.zeros((1, 1), int)
)


def wall(run=0.0, x=3.0):
    """A wall through (x, y, 1) that leans back by ``run`` per height, 4 m wide, between the heights of 0 and 2 m."""
    corners = [[x + run * (height - 1.0), side, height] for height in (0.0, 2.0) for side in (-2.0, 2.0)]
    return Scene(vertices=np.array(corners), faces=np.array([[0, 1, 2], [1, 3, 2]]), impedance=np.full(2, 3e6))


def face(survey, run=0.0, registration=0.0):
    """The cloud of a patch through (3, 0.1, 1), 2 cm uncertain along the way."""
    return face_cloud(survey, fronts_of(-0.1, 0.1, run_along=(run, 0.0, 1.0)), spacing=0.002, registration=registration)


@pytest.mark.parametrize("run", [0.0, 0.6], ids=["upright", "leaning back"])
@pytest.mark.parametrize("side", [-1.0, 1.0], ids=["before", "behind"])
@pytest.mark.parametrize(("deviations", "coverage"), [(0.0, 1.0), (1.9, 1.0), (2.02, 0.0)])
def test_a_face_within_its_deviations_of_the_surface_is_held(device, run, side, deviations, coverage):
    survey = survey_of_one_ping(90.0)
    scene = wall(run, x=3.0 + side * deviations * 0.02)
    (row,) = evaluate_calibration(face_claims(face(survey, run), survey, scene, device=device))
    assert (row.kind, row.points, row.coverage) == ("face", 101, coverage)
    # 3.2 m away: 2 cm along the way, less across the face.
    assert row.sharpness == pytest.approx(0.02 / np.hypot(1.0, run) / np.sqrt(10.01), rel=0.02)


def test_registration_widens_what_a_face_claims_by_how_far_it_moves_across(device):
    """A rotation of the head moves an upright face, a metre under it, by a metre per radian along the way."""
    survey = survey_of_one_ping(90.0)
    for deviations, coverage in ((1.8, 1.0), (2.2, 0.0)):
        scene = wall(x=3.0 + deviations * np.hypot(0.02, 0.03))
        claims = face_claims(face(survey, registration=0.03), survey, scene, device=device)
        middle = np.abs(face(survey).points[:, 2] - 1.0) < 0.05
        chosen = Claims(**{name: values[middle] for name, values in vars(claims).items()})
        assert [row.coverage for row in evaluate_calibration(chosen)] == [coverage]


def test_where_navigation_believed_the_ping_does_not_count(device):
    """The cloud stands where the estimate put it; scene and true poses are turned away from there together."""
    survey, scene = survey_of_one_ping(90.0), wall(x=3.01)
    want = face_claims(face(survey), survey, scene, device=device)
    error = np.array([0.4, -0.3, 0.2, *Rotation.from_euler("ZYX", [8.0, 3.0, -2.0], degrees=True).as_quat()])
    moved = replace(survey, pings=replace(survey.pings, pose=compose(error, survey.pings.pose)))
    there = replace(scene, vertices=error[:3] + rotate(error[3:], scene.vertices))
    found = face_claims(face(survey), moved, there, device=device)
    np.testing.assert_allclose(found.truth, want.truth, atol=2e-6)
    np.testing.assert_array_equal(found.high, want.high)


def test_a_head_that_has_turned_is_judged_where_it_looked(device):
    fixed, mounted = survey_of_one_ping(90.0, tilt=20.0), survey_of_one_ping(90.0, tilt=50.0)
    turned = replace(mounted, pings=replace(mounted.pings, head_angle=np.radians([30.0])))
    want, found = (face_claims(face(each), each, wall(x=3.01), device=device) for each in (fixed, turned))
    np.testing.assert_allclose(found.truth, want.truth, atol=2e-6)


def test_every_face_is_judged_by_its_own_ping(device):
    """In whatever order pings come, and whichever numbers trajectories share; here each was ahead by its own length."""
    head, ahead = survey_of_one_ping(90.0).pings.pose[0], np.array([0.01, 0.02, 0.03, 0.04])
    survey = survey_of([head] * 4)
    rows = {"trajectory": np.array([0, 1, 0, 1]), "number": np.array([1, 0, 2, 5])}
    survey = replace(survey, pings=replace(survey.pings, **rows))
    fronts = {name: np.repeat(values, 4, axis=0) for name, values in fronts_of(0.0, 0.0).items()}
    cloud = face_cloud(survey, fronts, spacing=0.05, registration=0.0)
    pose = survey.pings.pose + ahead[:, None] * np.eye(7)[0]
    moved = replace(survey, pings=replace(survey.pings, pose=pose))
    for chosen in ([0, 1, 2, 3], [3, 0], [1]):
        claims = face_claims(cloud.select(np.array(chosen)), moved, wall(), device=device)
        np.testing.assert_allclose(claims.truth, ahead[chosen], atol=2e-6)
    # A number that its own trajectory lacks, and the other one's first row.
    lost = cloud.select(np.array([0]))
    lost = sw.PointCloud(points=lost.points, attributes=lost.attributes | {"frame": np.array([6])})
    with pytest.raises(ValueError, match="survey: does not hold every ping of the cloud"):
        face_claims(lost, moved, wall(), device=device)


def test_a_contact_is_of_its_first_contacts_class_and_judged_where_they_are_the_same():
    """Up to 3 cm of range; faces that lean less than 20 degrees are tops, and what is uncertain is a fallback."""
    survey = survey_of_one_ping(90.0)
    lean = np.radians([18.0, 22.0])
    corners = [[[0.0, 0.0, 0.0], [np.cos(a), 0.0, np.sin(a)], [0.0, 1.0, 0.0]] for a in lean]
    scene = Scene(vertices=np.reshape(corners, (6, 3)), faces=np.arange(6).reshape(2, 3), impedance=np.full(2, 3e6))
    last, shape = len(survey.frames) - 1, (len(survey.frames), 6)
    first = {"range": np.full(shape, 4.0), "azimuth": np.zeros(shape), "elevation": np.full(shape, 0.5)}
    first["range"][last, 5], first["elevation"][last] = np.inf, 0.01 * np.arange(6)
    faces = np.full(shape, -1)
    faces[last] = [0, 1, 1, 0, 0, -1]
    attributes = {
        "source": np.zeros(6, dtype=int),
        "trajectory": np.zeros(6, dtype=int),
        "frame": np.full(6, survey.frames.number[last]),
        "beam": np.arange(6),
        "range": np.array([4.0, 4.029, 3.971, 4.0, 4.031, 4.0]),
        "quality": np.array([2, 2, 1, 1, 2, 2]),
        **{f"elevation_{name}": np.zeros(6) for name in ("low", "high", "deviation")},
    }
    cloud = sw.PointCloud(points=np.zeros((6, 3)), attributes=attributes)
    claims = contact_claims(cloud, survey, scene, FirstContacts(**first, face=faces))
    np.testing.assert_array_equal(claims.truth, [0.0, 0.01, 0.02, 0.03, np.nan, np.nan])
    assert list(claims.kind[:5]) == ["top", "front", "fallback", "fallback", "top"]


def test_a_face_without_what_it_claims_by_is_refused_by_name(device):
    survey = survey_of_one_ping(90.0)
    cloud = face(survey)
    for name in ("source", "normal_x", "covariance_xx"):
        less = {key: values for key, values in cloud.attributes.items() if key != name}
        with pytest.raises(ValueError, match=rf"cloud\.attributes: no {name}, a fused cloud is needed"):
            face_claims(sw.PointCloud(points=cloud.points, attributes=less), survey, wall(), device=device)


def test_faces_without_a_normal_and_clouds_without_faces_claim_nothing(device):
    survey = survey_of_one_ping(90.0, tilt=90.0)
    blind = face_cloud(survey, fronts_of(-0.1, 0.1), spacing=0.05, registration=0.0)
    assert len(blind) == 5
    nothing = blind.select(np.zeros(5, dtype=bool))
    for cloud in (blind, nothing):
        assert evaluate_calibration(face_claims(cloud, survey, wall(), device=device)) == []
        assert evaluate_calibration(contact_claims(cloud, survey, wall(), NONE)) == []


def test_a_point_of_another_ping_or_trajectory_is_refused(device):
    survey = survey_of_one_ping(90.0)
    cloud = face(survey)
    for name in ("frame", "trajectory"):
        other = sw.PointCloud(points=cloud.points, attributes=cloud.attributes | {name: cloud.attributes[name] + 1})
        with pytest.raises(ValueError, match="survey: does not hold every ping of the cloud"):
            face_claims(other, survey, wall(), device=device)
