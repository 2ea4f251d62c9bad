"""All metrics of one run in one call."""

from dataclasses import fields, replace

import numpy as np
import pytest

import sonarwarp as sw
from sonarwarp.metrics import (
    ObjectTruth,
    SonarView,
    evaluate,
    face_inclination,
    sample_surface,
    seen_samples,
    visible_samples,
)
from sonarwarp.truth import first_contacts
from sonarwarp_scenes import BRICK, Scene
from tests.small_runs import CARVED, RIG, SETTINGS, run, scene

TRUTH = ObjectTruth(
    name="brick",
    front_x=0.0,
    centre_y=0.0,
    width=BRICK.width,
    height=BRICK.height,
    depth=BRICK.depth,
    front_slope_deg=BRICK.front_slope_deg,
    sectional_area=BRICK.sectional_area,
    volume=BRICK.volume,
)


@pytest.fixture(scope="module", name="known")
def known_fixture(device):
    world, way = scene(), run(length=0.9)
    log = sw.simulate(RIG, world, way, frames_from=1.0, device=device)
    clouds = sw.reconstruct(log, settings=SETTINGS, device=device)
    contacts = first_contacts(log.survey, [world], device=device)
    samples = sample_surface(world.vertices, world.faces, 5000, 1)
    seen = visible_samples(
        world.vertices, world.faces, samples, SonarView.of(RIG.fls), [log.survey.frames.pose], device=device
    )[0]
    return {
        "log": log,
        "clouds": clouds,
        "survey": log.survey,
        "contacts": contacts,
        "scene": world,
        "seen": samples[seen],
    }


def test_one_call_gives_sections_distances_and_calibration(known, device):
    found = evaluate(
        known["clouds"].fused,
        objects=[TRUTH],
        scene=known["scene"],
        seen=known["seen"],
        survey=known["survey"],
        contacts=known["contacts"],
        device=device,
    )
    assert found.sections[0].area > 0.0
    assert found.surface is not None
    assert found.surface.accuracy_rms is not None
    assert 0.0 < found.surface.accuracy_rms < 0.1
    kinds = {row.kind: row for row in found.calibration}
    assert {"front", "top"} & set(kinds)
    assert sum(row.points for row in found.calibration) > 0.8 * len(known["clouds"].fused)


def test_the_true_elevation_is_that_of_the_points_own_beam_and_frame(known, device):
    """An interval around the truth itself covers always; one beside it, on either side, never."""
    cloud, survey, contacts = known["clouds"].fused, known["survey"], known["contacts"]
    rows = {int(number): row for row, number in enumerate(survey.frames.number)}
    place = ([rows[int(number)] for number in cloud.attributes["frame"]], cloud.attributes["beam"])
    truth = contacts.elevation[place]
    for low, high, coverage in ((-0.001, 0.03, 1.0), (0.001, 0.03, 0.0), (-0.03, -0.001, 0.0)):
        perfect = sw.PointCloud(
            points=cloud.points,
            attributes=cloud.attributes
            | {
                "elevation_low": truth + low,
                "elevation_high": truth + high,
                "elevation_deviation": np.full(len(cloud), 0.01),
            },
        )
        found = evaluate(perfect, scene=known["scene"], survey=survey, contacts=contacts, device=device)
        assert {row.coverage for row in found.calibration} == {coverage}


def test_contacts_are_judged_as_if_there_were_no_faces_and_faces_as_if_no_contacts(known, device):
    options = {name: known[name] for name in ("scene", "survey", "contacts")} | {"device": device}
    # So short a run has hardly more than one footprint of the brick.
    settings = replace(CARVED, faces=sw.Faces(least_spread=0.0))
    fused = sw.reconstruct(known["log"], settings=settings, device=device).fused
    source = fused.attributes["source"]
    apart = [evaluate(fused.select(source == which), **options).calibration for which in (0, 1)]
    assert all(apart)
    assert {row.kind for row in apart[1]} == {"face"}
    assert "face" not in {row.kind for row in apart[0]}
    together = evaluate(fused, **options).calibration
    assert sorted(together, key=lambda row: row.kind) == sorted([*apart[0], *apart[1]], key=lambda row: row.kind)


def first_frames(survey, frames, pings):
    """The first frames and pings of a survey."""
    cut = {
        kind: replace(rows, **{column.name: getattr(rows, column.name)[:count] for column in fields(rows)})
        for kind, rows, count in (("frames", survey.frames, frames), ("pings", survey.pings, pings))
    }
    return replace(survey, **cut)


def test_what_is_seen_is_what_either_sonar_sees_of_the_part(known, device):
    """As ``visible_samples`` has it sonar by sonar, over the samples of the part alone."""
    world, survey = known["scene"], first_frames(known["survey"], 1, 8)
    seabed = world.impedance != world.impedance[-1]
    assert 0 < seabed.sum() < len(seabed)
    samples = sample_surface(world.vertices, world.faces[seabed], 20000, 4)
    imaged, profiled = (
        visible_samples(world.vertices, world.faces, samples, SonarView.of(sonar), [poses], device=device)[0]
        for sonar, poses in ((RIG.fls, survey.frames.pose), (RIG.ps, survey.pings.head_pose))
    )
    assert (imaged & ~profiled).any()
    assert (profiled & ~imaged).any()
    seen = seen_samples(world, survey, part=seabed, count=20000, seed=4, device=device)
    assert np.array_equal(seen, samples[imaged | profiled])


def test_a_log_without_frames_and_pings_sees_nothing(known, device):
    empty = first_frames(known["survey"], 0, 0)
    assert seen_samples(known["scene"], empty, count=10, device=device).shape == (0, 3)


def triangle(*corners):
    return Scene(vertices=np.array(corners, dtype=float), faces=np.array([[0, 1, 2]]), impedance=np.array([3e6]))


@pytest.mark.parametrize("bearing_deg", [0.0, 37.0, 90.0, 200.0])
@pytest.mark.parametrize("slope_deg", [0.0, 1e-3, 30.0, 49.6, 90.0])
@pytest.mark.parametrize("turned", [False, True], ids=["facing up", "facing down"])
def test_a_face_that_rises_by_a_slope_leans_by_it_wherever_it_faces(slope_deg, bearing_deg, turned):
    """An overhang leans as much as the slope that it would be from below."""
    slope, bearing = np.radians([slope_deg, bearing_deg])
    uphill = np.array([np.cos(bearing) * np.cos(slope), np.sin(bearing) * np.cos(slope), np.sin(slope)])
    along = np.array([-np.sin(bearing), np.cos(bearing), 0.0])
    corners = [np.zeros(3), 0.3 * along, 2.0 * uphill - along]
    found = face_inclination(triangle(*(corners[::-1] if turned else corners)))
    assert np.degrees(found) == pytest.approx([slope_deg], abs=1e-6)


def test_what_is_missing_is_named(known):
    with pytest.raises(ValueError, match="survey: None, is needed with contacts"):
        evaluate(known["clouds"].fused, contacts=known["contacts"], scene=known["scene"])
    with pytest.raises(ValueError, match=r"cloud\.attributes: no elevation_deviation, a fused cloud is needed"):
        evaluate(known["clouds"].single, contacts=known["contacts"], scene=known["scene"], survey=known["survey"])
    assert evaluate(known["clouds"].single) == evaluate(known["clouds"].fused)
