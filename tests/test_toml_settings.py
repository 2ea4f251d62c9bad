"""Settings survive TOML to the bit, explain themselves, and are refused by file, key, value and bound."""

import dataclasses
import math
import random
import tomllib
import typing

import numpy as np
import pytest
import tomlkit
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sonarwarp import (
    EXACT_NAVIGATION,
    FLS,
    NO_MOTION,
    NO_NOISE,
    PRESETS,
    PS,
    Faces,
    FreeSpace,
    Motion,
    Mount,
    Navigation,
    Noise,
    ReconstructionSettings,
    Rig,
)
from sonarwarp.sonar import uniform_edges
from sonarwarp.toml_settings import (
    parse_noise,
    parse_rig,
    parse_settings,
    read_configuration,
    read_noise,
    read_rig,
    read_settings,
)
from sonarwarp.toml_text import field_comments, preset_text, toml_text
from tests.attempts import attempt, count_inputs

FUZZ = settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])

FIELD = preset_text("paper field")


def same(one: typing.Any, other: typing.Any) -> bool:
    """Equal to the bit, arrays included."""
    if dataclasses.is_dataclass(one):
        names = [field.name for field in dataclasses.fields(one)]
        return type(one) is type(other) and all(same(getattr(one, name), getattr(other, name)) for name in names)
    if isinstance(one, np.ndarray):
        return np.array_equal(one, other)
    return type(one) is type(other) and one == other


def leaves(table: dict, *path: str) -> list[tuple[str, ...]]:
    """Paths of all keys that are no tables."""
    found = []
    for key, value in table.items():
        found += leaves(value, *path, key) if isinstance(value, dict) else [(*path, key)]
    return found


def changed(path: tuple[str, ...], value: typing.Any) -> str:
    """The field test's preset with one value replaced."""
    document = tomllib.loads(FIELD)
    table = document
    for key in path[:-1]:
        table = table[key]
    table[path[-1]] = value
    return tomlkit.dumps(document)


LEAVES = leaves(tomllib.loads(FIELD))
NESTED = ("detection", "likelihood_field", "mixture", "free_space", "faces")


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_survives_its_text(tmp_path, name):
    path = tmp_path / "preset.toml"
    path.write_text(preset_text(name))
    read = read_configuration(path)
    assert same(read.rig, PRESETS[name])
    at_sea = name == "paper field"
    assert same(read.noise, Noise() if at_sea else NO_NOISE)
    assert same(read.motion, Motion() if at_sea else NO_MOTION)
    assert same(read.navigation, Navigation() if at_sea else EXACT_NAVIGATION)
    assert same(read.reconstruction, ReconstructionSettings())
    assert same(read_rig(path), read.rig)
    assert same(read_noise(path), read.noise)
    assert same(read_settings(path), read.reconstruction)


def test_a_preset_has_every_field_with_its_docstring_and_default():
    table = tomllib.loads(FIELD)
    comments = " ".join(line.removeprefix("#").strip() for line in FIELD.splitlines() if line.startswith("#"))
    nested = table["reconstruction"]
    for cls, keys in (
        (PS, table["ps"]),
        (Mount, table["fls_mount"]),
        (Noise, table["noise"]),
        (Motion, table["motion"]),
        (Navigation, table["navigation"]),
        (ReconstructionSettings, nested),
        *((type(getattr(ReconstructionSettings(), key)), nested[key]) for key in NESTED),
    ):
        for name, comment in field_comments(cls).items():
            assert name in keys or name == "range_edge" or not comment
            assert comment.replace("None for", '"none" for') in comments
    assert FIELD.count("# Default: ") + FIELD.count(" Default: ") >= len(LEAVES)
    assert "# Frames per second [Hz]. Paper.\n# Default: 10.0.\nrate = 10.0\n" in FIELD
    assert max(len(line) for line in FIELD.splitlines()) <= 100


def test_every_part_of_a_reconstruction_is_a_table_with_all_its_fields():
    table = tomllib.loads(FIELD)["reconstruction"]
    assert {key for key, value in table.items() if isinstance(value, dict)} == set(NESTED)
    for key in NESTED:
        names = {field.name for field in dataclasses.fields(getattr(ReconstructionSettings(), key))}
        assert table[key].keys() == names
        assert {(leaf[2]) for leaf in LEAVES if leaf[:2] == ("reconstruction", key)} == names


def test_any_method_and_parts_survive_their_text():
    told = ReconstructionSettings(
        method="paper",
        causal=True,
        particles=100,
        free_space=FreeSpace(reach=0.2, margin_deg=0.1, hypotheses=7, stray_points=0),
        faces=Faces(in_doubt=-0.01, before=0.0),
    )
    assert same(parse_settings(toml_text(reconstruction=told), "told"), told)
    some = parse_settings("[reconstruction.faces]\nspacing = 0.05\n[reconstruction.free_space]\nguard = 0.1\n", "some")
    assert same(some, ReconstructionSettings(faces=Faces(spacing=0.05), free_space=FreeSpace(guard=0.1)))


def test_equal_steps_and_written_edges_say_the_same():
    text = toml_text(rig=Rig())
    assert "beams = 96\n" in text
    assert "window_length = 5.0\n" in text
    document = tomllib.loads(text)
    for key in ("beams", "field_of_view_deg", "bins", "window_start", "window_length"):
        del document["fls"][key]
    document["fls"]["azimuth_edge"] = Rig().fls.azimuth_edge.tolist()
    document["fls"]["range_edge"] = Rig().fls.range_edge.tolist()
    assert same(parse_rig(tomlkit.dumps(document), "rig"), Rig())


def test_what_is_left_out_keeps_its_default(tmp_path):
    rig = parse_rig("[fls]\nbins = 256\n", "rig")
    assert same(rig, Rig(fls=FLS(range_edge=uniform_edges(0.42, 5.42, 256))))
    assert rig.ps_mount.roll_deg == 90.0
    assert parse_noise("[noise]\nspeckle = false\n", "noise") == Noise(speckle=False)
    assert parse_noise('[noise]\nbackground_db = "none"\n', "noise").background_db is None
    (tmp_path / "rig.toml").write_text("[motion]\nheave = 0.1\n[navigation]\ndepth = 0.0\n")
    read = read_configuration(tmp_path / "rig.toml")
    assert read.motion == Motion(heave=0.1)
    assert read.navigation == Navigation(depth=0.0)
    assert read.noise == NO_NOISE
    (tmp_path / "rig.toml").write_text("[noise]\n")
    read = read_configuration(tmp_path / "rig.toml")
    assert (read.motion, read.navigation) == (NO_MOTION, EXACT_NAVIGATION)
    assert same(parse_settings("[reconstruction]\n", "settings"), ReconstructionSettings())
    assert parse_settings("[reconstruction.mixture]\ndeviation = 1\n", "settings").mixture.deviation == 1.0


edges = st.lists(st.floats(0.011, 1e3), min_size=2, max_size=6, unique=True).map(sorted)
angles = st.lists(st.floats(-1.57, 1.57), min_size=2, max_size=6, unique=True).map(sorted)
degrees = st.floats(-180.0, 180.0)
mounts = st.builds(
    Mount,
    position=st.tuples(*[st.floats(-50.0, 50.0)] * 3),
    tilt_deg=degrees,
    roll_deg=degrees,
    pan_deg=degrees,
)


@FUZZ
@given(
    fls=st.builds(FLS, azimuth_edge=angles, range_edge=edges, cone=st.booleans(), gain_db=st.floats(-200, 200)),
    ps=st.builds(PS, range_edge=edges, step_deg=st.floats(0.01, 60.0), strips=st.integers(1, 256)),
    fls_mount=mounts,
    ps_mount=mounts,
)
def test_any_rig_survives_its_text(fls, ps, fls_mount, ps_mount):
    rig = Rig(fls=fls, ps=ps, fls_mount=fls_mount, ps_mount=ps_mount)
    assert same(parse_rig(toml_text(rig=rig), "rig"), rig)


@FUZZ
@given(beams=st.integers(1, 200), width=st.floats(0.1, 170.0), bins=st.integers(1, 200), length=st.floats(0.01, 100.0))
def test_any_equal_steps_survive_their_text(beams, width, bins, length):
    fls = f"[fls]\nbeams = {beams}\nfield_of_view_deg = {width}\nbins = {bins}\nwindow_length = {length}\n"
    rig = parse_rig(fls, "rig")
    assert (rig.fls.beams, rig.fls.bins) == (beams, bins)
    assert math.isclose(math.degrees(rig.fls.azimuth_edge[-1]), width / 2, rel_tol=1e-12)
    assert same(parse_rig(toml_text(rig=rig), "rig"), rig)


WRONG_TYPES = {
    "a word": "fast",
    "a truth": True,
    "a number": 12.5,
    "an array": [1.0, "x"],
    "a table": {"x": 1},
    "a date": tomllib.loads("x = 1979-05-27")["x"],
}


@pytest.mark.parametrize("kind", WRONG_TYPES)
def test_every_value_of_a_wrong_type_is_refused_by_name(tmp_path, kind):
    path = tmp_path / "rig.toml"
    sound = tomllib.loads(FIELD)
    refused = 0
    for leaf in LEAVES:
        value: typing.Any = sound
        for key in leaf:
            value = value[key]
        wrong = WRONG_TYPES[kind]
        number = isinstance(wrong, float) and isinstance(value, float)
        if number or (isinstance(wrong, bool) and isinstance(value, bool)):
            continue
        path.write_text(changed(leaf, wrong))
        with pytest.raises(ValueError, match=r"must be ") as refusal:
            read_configuration(path)
        assert str(refusal.value).startswith(f"{path}: {'.'.join(leaf)}: ")
        assert len(str(refusal.value).splitlines()) == 1
        count_inputs()
        refused += 1
    assert refused > 15


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e200, -1e200, 2**80, -(2**63) + 1])
def test_every_number_out_of_range_is_refused_by_name(tmp_path, value):
    path = tmp_path / "rig.toml"
    sound = tomllib.loads(FIELD)
    refused = 0
    for leaf in LEAVES:
        old: typing.Any = sound
        for key in leaf:
            old = old[key]
        if isinstance(old, bool | str):
            continue
        wrong = [0.0, value, 0.0] if isinstance(old, list) else value
        path.write_text(changed(leaf, wrong))
        with pytest.raises(ValueError, match=r"rig\.toml: ") as refusal:
            read_configuration(path)
        # The sum of the mixture's weights and the first borders of a fan go by other names.
        assert ".".join(leaf[:-1]) in str(refusal.value)
        assert len(str(refusal.value).splitlines()) == 1
        count_inputs()
        refused += 1
    assert refused > 40


def test_every_misspelt_key_is_answered_with_the_right_one():
    document = tomllib.loads(FIELD)
    for leaf in LEAVES:
        wrong = leaf[-1][:-1] + leaf[-1][-1] * 2
        count_inputs()
        with pytest.raises(ValueError, match=r"unknown, did you mean") as refusal:
            parse_all(changed((*leaf[:-1], wrong), 1))
        assert str(refusal.value) == f"rig: {'.'.join((*leaf[:-1], wrong))}: unknown, did you mean '{leaf[-1]}'?"
    with pytest.raises(ValueError, match=r"rig: fsl: unknown, did you mean 'fls'\?"):
        parse_rig("[fsl]\n", "rig")
    with pytest.raises(ValueError, match=r"rig: fls\.q: unknown, must be one of beams, field_of_view_deg, azimuth"):
        parse_rig("[fls]\nq = 1\n", "rig")
    assert "reconstruction" in document


MISREAD = {
    "motion": ("[motion]\nheave = -1\n", r"rig\.toml: motion\.heave: -1 is outside \[0, 90\]"),
    "a period": ("[motion]\nyaw_period = 0\n", r"rig\.toml: motion\.yaw_period: 0 is outside \[0\.1, 1e\+06\]"),
    "navigation": ("[navigation]\ndepth = 11\n", r"rig\.toml: navigation\.depth: 11 is outside \[0, 10\]"),
    "a fix rate": ('[navigation]\nfix_rate = "none"\n', r"rig\.toml: navigation\.fix_rate: 'none', must be a number"),
    "a misspelt table": ("[navigaton]\n", r"rig\.toml: navigaton: unknown, did you mean 'navigation'\?"),
}


@pytest.mark.parametrize("case", MISREAD)
def test_careless_motion_and_navigation_are_refused_with_their_bound(tmp_path, case):
    text, message = MISREAD[case]
    (tmp_path / "rig.toml").write_text(text)
    with pytest.raises(ValueError, match=message):
        read_configuration(tmp_path / "rig.toml")


def parse_all(text: str) -> tuple:
    return parse_rig(text, "rig"), parse_noise(text, "rig"), parse_settings(text, "rig")


REFUSED = {
    "both ways of edges": (
        "[fls]\nbeams = 2\nazimuth_edge = [0, 0.1]",
        r"rig: fls\.azimuth_edge: given together with beams, must be one or the other",
    ),
    "edges that go back": ("[ps]\nrange_edge = [1, 3, 2]", r"rig: ps\.range_edge: 2 follows 3, must ascend"),
    "one edge": ("[ps]\nrange_edge = [1]", r"rig: ps\.range_edge: expected one axis of at least 2 values"),
    "no edge": ("[ps]\nrange_edge = []", r"rig: ps\.range_edge: expected one axis of at least 2 values"),
    "no beams": ("[fls]\nbeams = 0", r"rig: fls\.beams: 0 is outside \[1, 65536\]"),
    "beams by the million": ("[fls]\nbeams = 1000000", r"rig: fls\.beams: 1e\+06 is outside"),
    "half a bin": ("[ps]\nbins = 0.5", r"rig: ps\.bins: 0\.5, must be a whole number"),
    "a window of no length": ("[ps]\nwindow_length = 0", r"rig: ps\.window_length: 0 is outside"),
    "two thirds of a place": ("[fls_mount]\nposition = [0, 1]", r"position: \[0, 1\], must be an array of 3 numbers"),
    "a table as a value": ("fls = 3", r"rig: fls: 3, must be a table \[fls\]"),
    "an array of tables": ("[[fls]]\nrate = 1", r"rig: fls: \[\{'rate': 1\}\], must be a table"),
    "no rig": ("[noise]", r"rig: no table \[fls\]; add it, or print one with `sonarwarp preset`"),
    "nothing": ("", r"rig: no table \[fls\]"),
    "no TOML": ("fls: 3", r"rig: not TOML: "),
    "a key twice": ("[fls]\nrate = 1\nrate = 2", r"rig: not TOML: Cannot overwrite a value"),
    "arrays without end": ("x = " + "[" * 5000, r"rig: not TOML that can be read: maximum recursion"),
    "a number without end": ("x = " + "1" * 5000, r"rig: not TOML that can be read: Exceeds the limit"),
    "a key of two lines": ('"a\\nb" = 1', r"rig: 'a\\nb': unknown, must be one of fls, ps"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_careless_rig_is_refused_with_its_bound(case):
    text, message = REFUSED[case]
    with pytest.raises(ValueError, match=message) as refusal:
        parse_rig(text, "rig")
    assert len(str(refusal.value).splitlines()) == 1


def test_other_refusals_say_where_they_come_from(tmp_path):
    with pytest.raises(ValueError, match=r"none\.toml: No such file or directory, must be a readable TOML file"):
        read_rig(tmp_path / "none.toml")
    with pytest.raises(ValueError, match=r": Is a directory, must be a readable TOML file"):
        read_noise(tmp_path)
    (tmp_path / "latin.toml").write_bytes(b"# caf\xe9")
    with pytest.raises(ValueError, match=r"latin\.toml: byte 5 is not UTF-8"):
        read_settings(tmp_path / "latin.toml")
    with pytest.raises(ValueError, match=r"preset: 'paper filed', did you mean 'paper field'\?"):
        preset_text("paper filed")
    with pytest.raises(ValueError, match=r"n: reconstruction\.mixture weights: sum to 1\.1, must sum to 1"):
        parse_settings("[reconstruction.mixture]\nweight_hit = 1.0\n", "n")
    with pytest.raises(ValueError, match=r"n: reconstruction\.detection\.edge: 'first', must be one of 'nearest', "):
        parse_settings('[reconstruction.detection]\nedge = "first"\n', "n")


# What a reconstruction is told, after its table's name, and how it is refused.
CARELESS = {
    "another method": ('method = "best"', r"n: reconstruction\.method: 'best', must be one of 'carved', 'paper'"),
    "half online": ("causal = 0.5", r"n: reconstruction\.causal: 0\.5, must be "),
    "no reach": ("free_space.reach = 0", r"n: reconstruction\.free_space\.reach: 0 is outside \[0\.001, 10\]"),
    "a share of all": ("free_space.side_share = 2", r"free_space\.side_share: 2 is outside \[0, 1\]"),
    "no hypotheses": ("free_space.hypotheses = 0", r"free_space\.hypotheses: 0 is outside \[1, "),
    "half a point": ("free_space.stray_points = 0.5", r"free_space\.stray_points: 0\.5, must be a whole number"),
    "no spacing": ("faces.spacing = 0", r"n: reconstruction\.faces\.spacing: 0 is outside \[0\.001, 10\]"),
    "contacts before behind": ("faces.before = -0.1", r"faces\.before: -0\.1 is outside \[0, 10\]"),
    "a word": ('faces.deviation = "small"', r"n: reconstruction\.faces\.deviation: 'small', must be a number"),
    "a misspelt key": ("faces.window = 1", r"n: reconstruction\.faces\.window: unknown"),
    "a misspelt table": ("face.spacing = 1", r"n: reconstruction\.face: unknown, did you mean 'faces'\?"),
    "a table as a value": ("free_space = 1", r"n: reconstruction\.free_space: 1, must be a table"),
}


@pytest.mark.parametrize("case", CARELESS)
def test_a_careless_reconstruction_is_refused_with_its_bound(case):
    text, message = CARELESS[case]
    with pytest.raises(ValueError, match=message) as refusal:
        parse_settings(f"[reconstruction]\n{text}\n", "n")
    assert len(str(refusal.value).splitlines()) == 1


LINES = FIELD.splitlines(keepends=True)


@FUZZ
@given(seed=st.integers(0, 2**32), noise=st.none() | st.text(max_size=60))
def test_a_mutated_file_is_read_or_refused_in_one_line(tmp_path, seed, noise):
    path = tmp_path / "rig.toml"
    rng = random.Random(seed)
    lines = [line for line in LINES if "=" in line or line.startswith("[")]
    for _ in range(rng.randint(1, 3)):
        at = rng.randrange(len(lines))
        start = rng.randrange(len(lines[at]))
        piece = rng.choice(["", "-", "e9", "nan", "[", "]", '"', "=", "\n", "1_0", "0x", ".", "'''", "7" * 40, "\x00"])
        lines[at] = lines[at][:start] + piece + lines[at][start + rng.randint(0, 3) :]
    path.write_text("".join(lines) if noise is None else noise, encoding="utf-8", errors="replace")
    read, message = attempt(read_configuration, path)
    if message is None:
        assert read.rig.fls.beams >= 1
    else:
        assert message.startswith(str(path))
