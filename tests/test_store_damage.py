"""A damaged log is refused in one line or read as it was: never another exception, never other data."""

import json
import random
import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sonarwarp.store import VERSION_ATTRIBUTE, StoreError
from sonarwarp.store_read import open_log
from sonarwarp.store_write import StoreWriter
from sonarwarp.truth import FirstContacts
from tests.attempts import attempt
from tests.small_logs import same_survey, small_log

LOG = small_log()
FRAMES, PINGS = len(LOG.images), len(LOG.echoes)
CONTACTS = FirstContacts(
    **{name: LOG.images[:, :, place] for place, name in enumerate(("range", "azimuth", "elevation"))},
    face=np.arange(FRAMES * 4, dtype=np.int32).reshape(FRAMES, 4),
)


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """A whole log with truth."""
    path = tmp_path_factory.mktemp("sound") / "run.zarr"
    with StoreWriter(path, LOG.survey, truth=LOG.survey, contacts=True) as writer:
        writer.append(LOG.images, LOG.echoes, CONTACTS)
    return path


@pytest.fixture
def path(sound, tmp_path):
    """A copy to damage."""
    return shutil.copytree(sound, tmp_path / "run.zarr")


def read_all(path):
    """Everything that a log holds."""
    stored = open_log(path)
    loaded = stored.load()
    rows = np.arange(len(loaded.images))
    contacts = stored.contacts_of(rows) if stored.has_contacts else None
    assert stored.reconstruction is None
    return stored, loaded, contacts


def is_sound_or_refused(path: Path) -> str | None:
    """Message of the refusal, if any; otherwise whatever was read is what was written."""
    read, message = attempt(read_all, path)
    if message is not None:
        assert str(path) in message
        assert "; " in message  # the way out
        return message
    stored, loaded, contacts = read
    frames, pings = len(loaded.images), len(loaded.echoes)
    assert np.array_equal(loaded.images, LOG.images[:frames])
    assert np.array_equal(loaded.echoes, LOG.echoes[:pings])
    assert same_survey(stored.survey, LOG.survey, frames, pings)
    assert stored.truth is None or same_survey(stored.truth, LOG.survey, frames, pings)
    if contacts is not None:
        assert np.array_equal(contacts.face, CONTACTS.face[:frames])
        assert np.array_equal(contacts.range, CONTACTS.range[:frames])
    return None


def files_read(path: Path, of_data: bool) -> list[Path]:
    """Files of data or of metadata that our reader needs; what is derived for others is not read back."""
    derived = ("platform_", "rx_beam_", "beamwidth_", "transducer_", "fls/beam/", "fls/azimuth/", "/range/")
    files = sorted(file for file in path.rglob("*") if file.is_file() and (file.name != "zarr.json") == of_data)
    return [file for file in files if not any(part in file.as_posix() for part in derived)]


def test_the_sound_log_is_sound(path):
    assert is_sound_or_refused(path) is None


def test_every_chunk_that_is_read_is_missed_cut_and_checked(path):
    files = files_read(path, of_data=True)
    assert len(files) > 25
    for file in files:
        whole = file.read_bytes()
        flipped = bytearray(whole)
        flipped[len(whole) // 2] ^= 4
        for damage in (None, whole[: len(whole) // 2], whole + b"\0", bytes(flipped)):
            file.unlink()
            if damage is not None:
                file.write_bytes(damage)
            message = is_sound_or_refused(path)
            assert message, f"{file.relative_to(path)} as {damage!r:.20} was not noticed"
            file.write_bytes(whole)
    assert is_sound_or_refused(path) is None


def test_every_metadata_file_is_missed_cut_and_garbled(path):
    files = files_read(path, of_data=False)
    assert len(files) > 20
    for file in files:
        whole = file.read_bytes()
        rng = random.Random(len(whole))
        damages: list[bytes | None] = [None, b"", whole[:-3], b"[]", b"[" * 100000]
        damages.append(b'{"zarr_format": 3, "node_type": "group", "attributes": {}}')
        flipped = bytearray(whole)
        flipped[rng.randrange(len(whole))] ^= 1 << rng.randrange(8)
        damages.append(bytes(flipped))
        for damage in damages:
            file.unlink()
            if damage is not None:
                file.write_bytes(damage)
            is_sound_or_refused(path)
            file.write_bytes(whole)
    assert is_sound_or_refused(path) is None


HOSTILE = (None, True, -1, 0, 7, 2**62, 10**30, 0.5, "", "x", [], [0], [-1, 4, 8], [10**15, 4, 8], {}, {"a": 1}, "NaN")


def places(value, *path):
    """Paths to every value inside nested JSON."""
    found = [path] if path else []
    if isinstance(value, dict | list):
        items = value.items() if isinstance(value, dict) else enumerate(value)
        for key, inner in items:
            found += places(inner, *path, key)
    return found


ARRAYS = ("fls/backscatter_r", "fls/ping_time", "ps/head_angle", "truth/first_contact_face")


@pytest.mark.parametrize("step", [11, pytest.param(1, marks=pytest.mark.nightly)])
@pytest.mark.parametrize("name", ARRAYS)
def test_every_entry_of_an_array_made_hostile_is_refused_or_harmless(path, name, step):
    file = path / name / "zarr.json"
    whole = file.read_text()
    where = [place for place in places(json.loads(whole)) if place[0] != "attributes" or len(place) == 1]
    cases = [(place, value) for place in where for value in HOSTILE]
    assert len(cases) > 300
    for place, value in cases[::step]:
        entry = document = json.loads(whole)
        for key in place[:-1]:
            entry = entry[key]
        entry[place[-1]] = value
        file.write_text(json.dumps(document))
        is_sound_or_refused(path)


@pytest.mark.parametrize("name", ["frames_complete", "pings_complete", "rig", "truth", "noise", "reconstruction"])
def test_every_attribute_made_hostile_is_refused_or_harmless(path, name):
    file = path / "zarr.json"
    document = json.loads(file.read_text())
    for value in HOSTILE:
        document["attributes"][name] = value
        file.write_text(json.dumps(document))
        message = is_sound_or_refused(path)
        if name.endswith("complete") and not (
            isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= 7
        ):
            assert message is not None
            assert f"{name}: {value!r}, must be a whole number from 0 to" in message
    document["attributes"].pop(name)
    file.write_text(json.dumps(document))
    assert (is_sound_or_refused(path) is None) == (name in ("noise", "reconstruction"))


OTHERS = "give others: `sonarwarp reconstruct LOG --out OUT --settings FILE`, or settings= in code"

UNREADABLE = {
    "of another version": ("[reconstruction]\nparticle = 32\n", "particle: unknown, did you mean 'particles'?"),
    "without its table": ("[fls]\n", "no table [reconstruction]"),
    "out of bounds": ("[reconstruction]\nparticles = -1\n", "reconstruction.particles: -1"),
    "cut": ("[reconstruction]\npart", "not TOML"),
    "no text": (7, ""),
}


@pytest.mark.parametrize("name", UNREADABLE)
def test_settings_that_cannot_be_read_are_all_that_is_lost(path, name):
    text, message = UNREADABLE[name]
    file = path / "zarr.json"
    document = json.loads(file.read_text())
    document["attributes"]["reconstruction"] = text
    file.write_text(json.dumps(document))
    stored = open_log(path)
    assert stored.complete
    assert np.array_equal(stored.load().images, LOG.images)
    assert np.array_equal(stored.load().echoes, LOG.echoes)
    assert stored.truth is not None
    assert same_survey(stored.truth, LOG.survey)
    assert np.array_equal(stored.contacts_of(np.arange(FRAMES)).face, CONTACTS.face)
    with pytest.raises(StoreError) as refusal:
        _ = stored.reconstruction
    assert str(refusal.value).startswith(f"{path}: its settings cannot be read: ")
    assert message in str(refusal.value)
    assert str(refusal.value).endswith("; " + OTHERS)


def test_another_version_and_other_things_are_refused(path, tmp_path):
    file = path / "zarr.json"
    document = json.loads(file.read_text())
    for version in (0, 2, "1", None, [1]):
        document["attributes"][VERSION_ATTRIBUTE] = version
        file.write_text(json.dumps(document))
        with pytest.raises(StoreError, match=r"sonarwarp_log_version: .*, must be 1; read it with the sonarwarp that"):
            open_log(path)
    with pytest.raises(StoreError, match=r"none\.zarr: no such log, must be a folder that"):
        open_log(tmp_path / "none.zarr")
    (tmp_path / "file").write_text("words")
    with pytest.raises(StoreError, match=r"file: no such log"):
        open_log(tmp_path / "file")
    (tmp_path / "empty").mkdir()
    with pytest.raises(StoreError, match=r"zarr\.json: cannot be read: No such file or directory; write the log anew"):
        open_log(tmp_path / "empty")


def test_another_rig_than_the_images_have_is_refused(path):
    file = path / "zarr.json"
    document = json.loads(file.read_text())
    document["attributes"]["rig"] = "[fls]\n"
    file.write_text(json.dumps(document))
    with pytest.raises(StoreError, match=r"backscatter_r: shape \(150, 4, 8\), must be \(150, 96, 512\) for the rig"):
        open_log(path)


@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32))
def test_any_damage_is_refused_or_harmless(path, seed):
    rng = random.Random(seed)
    files = [file for file in path.rglob("*") if file.is_file()]
    chosen = rng.sample(files, rng.randint(1, 3))
    whole = [file.read_bytes() for file in chosen]
    for file in chosen:
        changed = bytearray(file.read_bytes())
        for _ in range(rng.randint(1, 3)):
            at = rng.randrange(len(changed) + 1)
            changed[at : at + rng.randint(0, 9)] = rng.choice(
                [b"", rng.randbytes(5), b"0", b"-", b"}", b'"', b"9" * 30]
            )
        file.write_bytes(changed)
    is_sound_or_refused(path)
    for file, data in zip(chosen, whole, strict=True):
        file.write_bytes(data)
