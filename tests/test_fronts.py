"""Faces under contacts: on the wall, as inclined as it is, between the seabed and the contacts, and nowhere else."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp

from sonarwarp_kernels import fronts
from sonarwarp_kernels.free_depth import ASKED, UNASKED
from tests.reference import fronts as reference
from tests.wall_world import (
    CELL,
    COLUMNS,
    MODEL,
    NO_TOP,
    STEPS,
    Wall,
    WallWorld,
    find,
    front_model,
    in_turn,
    look,
    make_fronts,
    make_grid,
    make_profiles,
    random_scene,
)

ON_FACE = 0.25**2 / (2 * 2.5) * 2 / 3
"""Most distance of a patch from its wall [m], 8 mm: a sheet is round, the wall is flat, 25 cm to either side and at
least 2.5 m off; a third of the difference at its ends lies in the mean over its width."""
WITHIN = 0.25 - np.sqrt(2) * CELL
"""How far to the side all cells along the way hold the wall's contacts, at any heading [m]."""
UPRIGHT = WallWorld.passing(Wall())
# Slope of the wall and height of its lowest contact: of a steep wall the imaging sonar meets the upper edge alone.
WALLS = {"upright": (90.0, 0.8), "75 degrees": (75.0, 0.45), "60 degrees": (60.0, 0.3)}


def places(found, end=None, where=...):
    """Where the patches are: on their beam's axis, or their end ``low`` or ``high``; shape [patch, 3]."""
    there = found["found"][where] == 1
    height = 0.0 if end is None else found[end][where][there][:, None]
    return found["point"][where][there] + height * found["run"][where][there]


def ask_batch(device, scenes, columns=COLUMNS, **changed):
    """Which cells the sheets of many trajectories ask for, shape [trajectory, x, y, z]."""
    grid = make_grid(device, scenes)
    cells = wp.full((len(scenes), grid.nx, grid.ny, grid.nz), 7.0, dtype=float, device=device)
    profiles = make_profiles(device, scenes, in_turn(scenes))
    fronts.ask_sheets(grid, front_model(**changed), profiles, columns, cells, device=device)
    assert set(np.unique(cells.numpy())) <= {7.0, np.float32(ASKED)}
    return cells.numpy() != 7.0


def ask(device, scene, **changed):
    return ask_batch(device, [scene], **changed)[0]


def any_found(device, scene, **changed):
    return bool(find(device, scene, **changed)["found"].any())


# --- A face is found where it stands ---


@pytest.mark.parametrize("heading_deg", [0, 37, 90, 180, 255])
@pytest.mark.parametrize("name", WALLS)
def test_patches_stand_on_the_wall_as_inclined_as_it_is(device, name, heading_deg):
    slope = np.radians(WALLS[name][0])
    wall = Wall(WALLS[name][0])
    world = WallWorld.passing(wall, lowest_contact=WALLS[name][1], heading=np.radians(heading_deg))
    got = find(device, world.scene())
    for end in (None, "low", "high"):
        place = places(got, end) @ world.turn
        assert np.abs(place[:, 1]).max() < 0.25
        place = place[np.abs(place[:, 1]) < WITHIN]
        assert np.abs(wall.before(place) * np.sin(slope)).max() < ON_FACE
    for ping in range(len(world.pings)):
        side = (places(got, where=ping) @ world.turn)[:, 1]
        assert side.min() < -0.2
        assert side.max() > 0.2
        assert np.all(np.abs(np.diff(np.sort(side)) - MODEL["spacing"]) < 1e-3)
    within = np.abs((places(got) @ world.turn)[:, 1]) < WITHIN
    run = got["run"][got["found"] == 1][within] @ world.turn
    assert np.abs(np.degrees(np.arctan2(run[:, 2], run[:, 0]) - slope)).max() < 0.5


@pytest.mark.parametrize(("slope_deg", "is_face"), [(62.0, True), (58.0, False)])
def test_a_wall_that_the_imaging_sonar_sees_as_it_is_has_no_face(device, slope_deg, is_face):
    scene = WallWorld.passing(Wall(slope_deg), lowest_contact=0.3).scene()
    assert any_found(device, scene)
    assert any_found(device, scene, most_run=1.0 / np.tan(np.radians(60.0))) == is_face


@pytest.mark.parametrize(("slope_deg", "is_face"), [(98.0, True), (102.0, False)])
def test_a_wall_that_overhangs_more_than_lines_err_has_no_face(device, slope_deg, is_face):
    scene = WallWorld.passing(Wall(slope_deg), lowest_contact=0.8).scene()
    assert any_found(device, scene)
    assert any_found(device, scene, least_run=-np.tan(np.radians(10.0))) == is_face


def test_footprints_at_one_height_have_no_slope(device):
    scene = UPRIGHT.scene()
    chosen = np.flatnonzero(find(device, scene)["found"].any(axis=(1, 2)))[0]
    level = replace(scene, pings=[scene.pings[chosen]] * 3)
    assert any_found(device, level)
    assert not any_found(device, level, least_spread=0.01)
    assert any_found(device, scene, least_spread=0.01)


@pytest.mark.parametrize(("lower", "cut"), [(0.06, True), (0.12, False)], ids=["an error", "a rail"])
def test_a_face_ends_at_the_top_behind_an_edge_that_is_hardly_higher(device, lower, cut):
    scene = UPRIGHT.scene()
    whole = places(find(device, scene, edge_height=0.08), "high")[:, 2].max()
    column, row = np.nonzero(scene.top != NO_TOP)
    top = scene.top.copy()
    for further in range(1, 5):
        top[column.max() + further, row] = scene.top[column, row] - round(lower * STEPS)
    ends = places(find(device, replace(scene, top=top), edge_height=0.08), "high")[:, 2]
    assert ends.max() == pytest.approx(0.8 - lower if cut else whole, abs=2e-3)
    assert not cut or whole > 0.8 - lower + 0.02


@pytest.mark.parametrize("heading_deg", [37, 90, 180, 255])
def test_a_turned_world_has_the_same_patches_turned(device, heading_deg):
    turned = replace(UPRIGHT, heading=np.radians(heading_deg))
    one, other = find(device, UPRIGHT.scene()), find(device, turned.scene())
    # A strip at the wall's side may or may not share a cell with its contacts.
    both = (one["found"] == 1) & (other["found"] == 1)
    assert both.sum() >= 22 * len(UPRIGHT.pings)
    for name in ("point", "run"):
        np.testing.assert_allclose(other[name][both] @ turned.turn, one[name][both], atol=1e-5)
    np.testing.assert_allclose(other["low"][both], one["low"][both], atol=1e-5)
    np.testing.assert_allclose(other["high"][both], one["high"][both], atol=1e-5)


def test_a_head_on_its_other_side_finds_the_same_in_the_other_order(device):
    one = find(device, UPRIGHT.scene())
    other = find(device, WallWorld.passing(Wall(), roll=-np.pi / 2).scene())
    assert np.array_equal(one["found"], other["found"][..., ::-1])
    there = one["found"] == 1
    for name in ("point", "run", "low", "high"):
        np.testing.assert_allclose(one[name][there], other[name][:, :, ::-1][there], atol=1e-5)


def test_footprints_gone_astray_neither_bend_the_face_nor_show(device):
    wall, scene = Wall(), UPRIGHT.scene()
    stray = (2, 8)
    pings = list(scene.pings)
    for ping in stray:
        pings[ping] = replace(pings[ping], footprints=[tuple(np.add(pings[ping].footprints[0], 0.08))])
    got = find(device, replace(scene, pings=pings))
    assert not got["found"][list(stray)].any()
    assert got["found"].sum() == find(device, scene)["found"].sum() * 14 / 16
    for end in ("low", "high"):
        assert np.abs(wall.before(places(got, end))).max() < ON_FACE


def test_a_wall_seen_from_one_place_again_and_again_stands_upright(device):
    # One height says nothing of an incline.
    wall = Wall(60.0)
    ping = look((wall,), (0.5, 0.0, 1.8), (4.2, 0.0, 0.4))
    got = find(device, replace(WallWorld((wall,), [ping] * 4, lowest_contact=0.3)).scene())
    run = got["run"][got["found"] == 1]
    assert len(run) > 4 * 20
    np.testing.assert_allclose(run, np.tile([0.0, 0.0, 1.0], (len(run), 1)), atol=1e-3)


# --- Its ends ---


def test_patches_are_as_high_as_the_beam_there(device):
    got = find(device, UPRIGHT.scene())
    for ping in range(len(UPRIGHT.pings)):
        half = MODEL["half_width"] * UPRIGHT.pings[ping].footprints[0][1]
        there = got["found"][ping] == 1
        axis = got["point"][ping][there][:, 2]
        # Neither the seabed nor the contacts are as near as that.
        inside = (axis > half + 0.04) & (axis < 0.79 - half)
        np.testing.assert_allclose(got["high"][ping][there][inside], half, rtol=1e-6)
        np.testing.assert_allclose(got["low"][ping][there][inside], -half, rtol=1e-6)


@pytest.mark.parametrize("height", [0.3, 0.5])
def test_a_face_ends_at_the_contacts_height_and_beams_over_them_see_none(device, height):
    scene = UPRIGHT.scene()
    got = find(device, replace(scene, top=np.where(scene.top == NO_TOP, NO_TOP, round(1000 * height))))
    top = places(got, "high")[:, 2]
    assert top.max() == pytest.approx(height, abs=1e-5)
    assert np.sum(top > height - 1e-5) > 10
    whole = find(device, scene)
    for number, ping in enumerate(UPRIGHT.pings):
        bottom = places(whole, where=number)[0, 2] - MODEL["half_width"] * ping.footprints[0][1]
        assert got["found"][number].any() == (bottom < height)


@pytest.mark.parametrize("seabed", [0.0, 0.15])
def test_a_face_ends_over_the_seabed(device, seabed):
    scene = UPRIGHT.scene()
    got = find(device, replace(scene, pings=[replace(ping, seabed=seabed) for ping in scene.pings]))
    least = seabed + MODEL["least_height"] / 2
    bottom = places(got, "low")[:, 2]
    assert bottom.min() == pytest.approx(least, abs=1e-6)
    assert places(got)[:, 2].min() > seabed + MODEL["least_height"]


# --- And nowhere else ---


def shifted(scene, ahead):
    """The same with its contacts moved ahead, in cells."""
    return replace(scene, top=np.roll(scene.top, ahead, axis=0))


def with_footprints(scene, change):
    """The same with every footprint changed."""
    return replace(scene, pings=[replace(p, footprints=[change(*f) for f in p.footprints]) for p in scene.pings])


def with_depth(scene, depth):
    """The same with one free depth everywhere."""
    return replace(scene, free_depth=np.full(scene.free_depth.shape, depth))


def with_pings(scene, *pings):
    return replace(scene, pings=[scene.pings[ping] for ping in pings])


def spread(scene, share):
    """Footprints that spread over a share of the beam's width."""
    half = 0.4 * share * 2 * MODEL["half_width"]
    return with_footprints(scene, lambda _, middle, __: (middle * (1 - half), middle, middle * (1 + half)))


# What the wall's world becomes, and whether its face is found; contacts stand up to 6 cm behind the edge.
CHANGES = {
    "as it is": (lambda scene: scene, True),
    "nothing proven": (lambda scene: with_depth(scene, -0.1), True),
    "hardly in water": (lambda scene: with_depth(scene, 0.019), True),
    "in proven water": (lambda scene: with_depth(scene, 0.021), False),
    "no contacts": (lambda scene: replace(scene, top=np.full(scene.top.shape, NO_TOP)), False),
    "contacts from 4 cm before on": (lambda scene: shifted(scene, -2), True),
    "contacts from 10 cm before on": (lambda scene: shifted(scene, -5), True),
    "contacts 8 cm before and more": (lambda scene: shifted(scene, -7), False),
    "contacts 12 cm behind": (lambda scene: shifted(scene, 6), True),
    "contacts 18 cm behind and little higher": (lambda scene: with_pings(shifted(scene, 9), 3, 8, 13), False),
    "contacts 18 cm behind and much higher": (lambda scene: with_pings(shifted(scene, 9), 0, 2, 5, 7), True),
    "contacts 70 cm behind": (lambda scene: shifted(scene, 35), False),
    "contacts under the beams": (lambda scene: replace(scene, top=np.minimum(scene.top, 5)), False),
    "compact footprints": (lambda scene: spread(scene, 0.88), True),
    "footprints as long as a flat seabed's": (lambda scene: spread(scene, 0.92), False),
    "no footprints": (lambda scene: replace(scene, pings=[replace(p, footprints=[]) for p in scene.pings]), False),
    "one ping": (lambda scene: with_pings(scene, 2), False),
    "two pings 40 cm apart in height": (lambda scene: with_pings(scene, 0, 3), False),
    "two pings 16 cm apart in height": (lambda scene: with_pings(scene, 0, 2), True),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_face_is_found_only_where_both_sonars_leave_it(device, change):
    made, found = CHANGES[change]
    assert any_found(device, made(UPRIGHT.scene())) == found


def test_two_returns_of_one_ping_are_no_face(device):
    scene = with_pings(UPRIGHT.scene(), 2)
    near, middle, far = scene.pings[0].footprints[0]
    both = [(near, middle, far), (near + 0.05, middle + 0.05, far + 0.05)]
    assert not any_found(device, replace(scene, pings=[replace(scene.pings[0], footprints=both)]))


def test_a_flat_seabed_is_no_face(device):
    # Its footprint at this depression spreads over r / tan(depression) times the beam's angle. Contacts stand over it,
    # nothing is proven, and the seabed is said to lie deeper: its length alone is against it.
    scene, pings = UPRIGHT.scene(), []
    for way in np.linspace(0.0, 0.3, 8):
        ping = look((), (way, 0.0, 1.8), (way + 4.0, 0.0, 0.0))
        angle = np.arctan2(1.8, 4.0) + MODEL["half_width"] * np.array([0.8, 0.0, -0.8])
        pings.append(replace(ping, footprints=[tuple(1.8 / np.sin(angle))], seabed=-1.0))
    bare = with_depth(replace(scene, pings=pings, top=np.full(scene.top.shape, 100)), -0.1)
    assert not any_found(device, bare, clearance=9.0)
    assert any_found(device, bare, clearance=9.0, compact=3.0, behind=MODEL["before"])


def test_a_level_top_has_no_faces_in_it(device):
    # Met at 40 degrees its footprints spread over 1.2 of the beam's width; contacts stand all over it.
    scene, pings = UPRIGHT.scene(), []
    for way in np.linspace(2.8, 3.1, 8):
        ping = look((), (way, 0.0, 1.8), (way + 1.2, 0.0, 0.8))
        angle = np.arctan2(1.0, 1.2) + MODEL["half_width"] * np.array([0.8, 0.0, -0.8])
        pings.append(replace(ping, footprints=[tuple(1.0 / np.sin(angle))]))
    level = with_depth(replace(scene, pings=pings, top=np.full(scene.top.shape, round(0.8 * STEPS))), -0.1)
    assert not any_found(device, level, compact=1.5)
    # Unless nobody looks at the contacts before it.
    assert any_found(device, level, compact=1.5, behind=MODEL["before"])


SIDE_BY_SIDE = {"in line": 4.0, "10 cm behind": 4.1, "40 cm behind": 4.4, "10 cm before": 3.9}


@pytest.mark.parametrize("name", SIDE_BY_SIDE)
def test_neighbours_do_not_lend_each_other_their_faces(device, name):
    left, right = Wall(right=0.1, left=0.4), Wall(foot=SIDE_BY_SIDE[name], right=-0.4, left=-0.1)
    world = WallWorld.passing(left, right)
    got = find(device, world.scene())
    place = places(got)
    on_left, on_right = left.spans(place), right.spans(place)
    assert np.all(on_left | on_right)
    # A sheet over 10 to 40 cm is out by the difference of their squares, of which half lies on either side of the mean.
    aside = (0.4**2 - 0.1**2) / (2 * 2.4) / 2
    assert np.abs(left.before(place[on_left])).max() < aside
    assert np.abs(right.before(place[on_right])).max() < aside
    # All pings but those that look under a wall which begins behind its neighbour's foot.
    assert min(on_left.sum(), on_right.sum()) >= 10 * 14


def test_it_is_the_proven_water_that_keeps_a_face_from_its_neighbour(device):
    walls = Wall(right=0.1, left=0.4), Wall(foot=4.1, right=-0.4, left=-0.1)
    scene = WallWorld.passing(*walls).scene()
    lent = places(find(device, with_depth(scene, -0.1)))
    assert np.sum(walls[1].spans(lent) & (walls[1].before(lent) > 0.06)) > 10


def test_what_a_nearer_object_hides_is_not_seen_behind_it(device):
    # A second wall behind the first, too low to be seen over it: its footprint is another object's.
    front, behind = Wall(), Wall(foot=4.3)
    world = WallWorld.passing(front, behind)
    scene = replace(world, pings=[look((front,), p.position, (4, 0, 0.4)) for p in world.pings]).scene()
    further = [tuple(np.add(p.footprints[0], 0.33)) for p in scene.pings]
    pings = [replace(p, footprints=[p.footprints[0], f]) for p, f in zip(scene.pings, further, strict=True)]
    got = find(device, with_depth(replace(scene, pings=pings), -0.1), clearance=9.0)
    assert got["found"][:, 0].any()
    assert not got["found"][:, 1].any()
    alone = [replace(p, footprints=[f]) for p, f in zip(scene.pings, further, strict=True)]
    unhidden = with_depth(replace(scene, pings=alone), -0.1)
    assert any_found(device, unhidden, clearance=9.0)
    # Its rays would have run through the first one's contacts.
    assert not any_found(device, unhidden)


# --- Against the oracle ---


def as_oracle(scene, changed):
    """Model, box and pings as the oracle takes them."""
    top = np.where(scene.top == NO_TOP, np.nan, scene.top / 1000)
    pings = [(p.position, p.orientation, p.footprints, p.seabed) for p in scene.pings]
    return SimpleNamespace(**{**MODEL, **changed}), reference.Box(scene.origin, CELL, scene.free_depth, top), pings


def asked_by_oracle(scene, columns, **changed):
    return reference.asked(*as_oracle(scene, changed), columns)


def oracle(scene, columns, **changed):
    """Every patch by brute force, None where there is none, by ping, footprint and column."""
    model, box, pings = as_oracle(scene, changed)
    return {
        (ping, which, column): reference.patch(
            model, box, pings, ping, which, (column - (columns - 1) / 2) * model.spacing / footprint[1]
        )
        for ping, each in enumerate(scene.pings)
        for which, footprint in enumerate(each.footprints)
        for column in range(columns)
    }


@pytest.mark.parametrize(
    ("bounds", "least"),
    [({}, 25), ({"most_run": 0.2, "least_run": -0.2, "least_spread": 0.04, "edge_height": 0.1}, 5)],
)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_random_scenes_match_the_oracle(device, seed, bounds, least):
    scene = random_scene(seed)
    changed = {"spacing": 0.04, "clearance": 0.15, "behind": 0.09, **bounds}
    got = find(device, scene, columns=13, **changed)
    want = oracle(scene, 13, **changed)
    found = {key for key, patch in want.items() if patch}
    assert least < len(found) < 0.5 * len(want)
    assert {tuple(map(int, key)) for key in np.argwhere(got["found"] == 1)} == found
    for name, atol in (("point", 2e-5), ("run", 2e-4), ("low", 1e-5), ("high", 1e-5), ("deviation", 2e-5)):
        expected = np.array([patch[name] for _, patch in sorted(want.items()) if patch])
        np.testing.assert_allclose(got[name][got["found"] == 1], expected, atol=atol)
    # Where nothing is found nothing but that is written.
    assert set(np.unique(got["found"])) <= {0, 1}
    for name in ("point", "run", "low", "high", "deviation"):
        assert np.all(got[name][got["found"] == 0] == 7)


@pytest.mark.parametrize("seed", [1, 2])
def test_cells_are_asked_for_where_faces_may_stand_and_nowhere_else(device, seed):
    scene = random_scene(seed)
    got = ask(device, scene, columns=13, spacing=0.08)
    want = asked_by_oracle(scene, 13, spacing=0.08)
    assert 0.02 < want.mean() < 0.9
    assert np.array_equal(got, want)


def test_cells_that_nobody_asked_for_tell_nothing(device):
    wall = Wall(75.0)
    for world in (UPRIGHT, WallWorld.passing(wall, lowest_contact=0.45, heading=0.6)):
        scene = world.scene()
        known = np.where(ask(device, scene), scene.free_depth, float(UNASKED))
        assert np.mean(known != scene.free_depth) > 0.5
        one, other = find(device, scene), find(device, replace(scene, free_depth=known))
        assert np.array_equal(one["found"], other["found"])
        assert np.array_equal(one["point"], other["point"])


# --- Many trajectories, threads ---


def test_a_trajectory_asks_in_its_own_box_only(device):
    scenes = [random_scene(1), WallWorld.passing(Wall(), size=(70, 80, 40)).scene()]
    both = ask_batch(device, scenes)
    for index, scene in enumerate(scenes):
        inside = tuple(slice(n) for n in scene.free_depth.shape)
        assert np.array_equal(both[index][inside], ask(device, scene))
        assert both[index].sum() == both[index][inside].sum() > 0


def same(one, other):
    return all(np.array_equal(one[name], other[name]) for name in one)


def test_two_trajectories_with_mixed_pings_find_what_each_finds_alone(device):
    small = WallWorld.passing(Wall(75.0, height=0.5), lowest_contact=0.2, size=(70, 80, 40), heading=0.3)
    scenes = [UPRIGHT.scene(), small.scene()]
    order = [(scene, ping) for ping in range(16) for scene in (1, 0)]
    both = find(device, *scenes, order=order)
    for index, scene in enumerate(scenes):
        rows = [row for row, (owner, _) in enumerate(order) if owner == index]
        alone = find(device, scene)
        assert alone["found"].any()
        assert same({name: both[name][rows] for name in both}, alone)


@pytest.mark.parametrize("threads", [2, 5])
def test_threads_change_nothing(device, threads):
    scene = random_scene(4)
    assert same(find(device, scene, threads=threads), find(device, scene))


def test_no_pings_have_no_faces(device):
    got = find(device, replace(UPRIGHT.scene(), pings=[]))
    assert got["found"].shape[0] == 0


# --- Bad input ---


def launch_with(device, launcher, part, name, array):
    """Both launchers' arguments, with one array replaced."""
    scene = UPRIGHT.scene()
    grid, profiles = make_grid(device, [scene]), make_profiles(device, [scene], in_turn([scene]))
    shape = (1, *scene.free_depth.shape)
    given = {"free_depth": wp.zeros(shape, dtype=float, device=device)}
    given["top"] = wp.zeros(shape[:3], dtype=int, device=device)
    out = make_fronts(device, (16, 3, 5))
    if part == "given":
        given[name] = array
    elif part:
        setattr({"grid": grid, "profiles": profiles, "out": out}[part], name, array)
    if launcher == "ask":
        fronts.ask_sheets(grid, front_model(), profiles, 5, given["free_depth"], device=device)
    else:
        fronts.find_fronts(grid, front_model(), profiles, given["free_depth"], given["top"], out, device=device)


WRONG = {
    "owners": ("profiles", "trajectory", 9, int, r"profiles\.world_from_head: expected shape \(9,\), got \(16,\)"),
    "poses": ("profiles", "world_from_head", 15, wp.transform, r"profiles\.world_from_head: expected shape \(16,\)"),
    "rows": ("profiles", "footprint", (3, 16), wp.vec3, r"profiles\.footprint: expected shape \(16, any\), got"),
    "seabed": ("profiles", "seabed", 1, float, r"profiles\.seabed: expected shape \(16,\), got \(1,\)"),
    "order": ("profiles", "order", 15, int, r"profiles\.order: expected shape \(16,\), got \(15,\)"),
    "firsts": ("profiles", "first", 16, int, r"profiles\.first: expected shape \(2,\), got \(16,\)"),
    "sizes": ("grid", "size", 2, wp.vec3i, r"grid\.size: expected shape \(1,\), got \(2,\)"),
    "cells": ("given", "free_depth", (1, 9, 9, 9), float, r"free_depth(_out)?: expected shape \(1, 90, 90, 45\), got"),
    "counts": ("given", "free_depth", (1, 90, 90, 45), int, r"free_depth(_out)?: expected dtype float32, got int32"),
}
WRONG_FOUND = {
    "tops": ("given", "top", (1, 90, 45), int, r"top: expected shape \(1, 90, 90\), got \(1, 90, 45\)"),
    "heights": ("given", "top", (1, 90, 90), float, r"top: expected dtype int32, got float32"),
    "found": ("out", "found", (16, 2, 5), int, r"fronts_out\.found: expected shape \(16, 3, any\), got \(16, 2, 5\)"),
    "points": ("out", "point", (16, 3, 4), wp.vec3, r"fronts_out\.point: expected shape \(16, 3, 5\), got"),
    "run": ("out", "run", (16, 2, 5), wp.vec3, r"fronts_out\.run: expected shape \(16, 3, 5\), got"),
    "deviation": ("out", "deviation", (15, 3, 5), float, r"fronts_out\.deviation: expected shape \(16, 3, 5\)"),
}
CASES = [(launcher, case) for case in WRONG.values() for launcher in ("ask", "find")]
CASES += [("find", case) for case in WRONG_FOUND.values()]


@pytest.mark.parametrize(("launcher", "case"), CASES)
def test_wrong_arrays_are_refused_by_name(device, launcher, case):
    part, name, shape, dtype, message = case
    with pytest.raises(ValueError, match=message):
        launch_with(device, launcher, part, name, wp.zeros(shape, dtype=dtype, device=device))


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan")])
@pytest.mark.parametrize(
    "name", ["half_width", "half_fan", "spacing", "reach", "window_along", "window_height", "deviation"]
)
def test_a_model_out_of_bounds_is_refused_by_name(device, name, value):
    with pytest.raises(ValueError, match=rf"model\.{name}: must be above 0, got {value}"):
        find(device, UPRIGHT.scene(), **{name: value})
    with pytest.raises(ValueError, match=rf"model\.{name}: must be above 0, got {value}"):
        ask(device, UPRIGHT.scene(), **{name: value})
