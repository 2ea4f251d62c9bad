"""Trajectories in files come back as they were, and every careless file is refused by file, line and field."""

import random

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sonarwarp.trajectory_files import read_csv, read_trajectory, read_tum, write_csv, write_tum
from sonarwarp_scenes import Trajectory
from tests.attempts import attempt

CSV = "t,x,y,z,qx,qy,qz,qw"
LEVEL = "0,0,0,1"
TUM = "# timestamp tx ty tz qx qy qz qw"

FUZZ = settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def saved(tmp_path, text, name="run.csv"):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def csv_lines(*rows):
    return "\n".join([CSV, *rows]) + "\n"


def test_a_header_may_name_columns_in_any_order_and_others_are_ignored(tmp_path):
    text = "depth, QW ,qz,qy,qx,z,y,x,t\n9,1,0,0,0,3,2,1,0.5\n\n9,0,1,0,0,6,5,4,0.75\n"
    run = read_csv(saved(tmp_path, b"\xef\xbb\xbf" + text.encode()))
    assert run.times.tolist() == [0.5, 0.75]
    assert run.poses.tolist() == [[1, 2, 3, 0, 0, 0, 1], [4, 5, 6, 0, 0, 1, 0]]


def test_angles_turn_about_x_y_z_with_yaw_outermost(tmp_path):
    angles = np.array([[10.0, -20.0, 30.0], [-170.0, 80.0, 400.0]])
    expected = Rotation.from_euler("ZYX", angles[:, ::-1], degrees=True).as_matrix()
    in_degrees = "t,x,y,z,roll_deg,pitch_deg,yaw_deg\n0,0,0,0,10,-20,30\n1,0,0,0,-170,80,400\n"
    rows = "\n".join(f"{time},0,0,0," + ",".join(repr(float(a)) for a in np.radians(angles[time])) for time in (0, 1))
    first, second = np.radians(angles[:, 1]).tolist()
    mixed = f"t,x,y,z,roll_deg,pitch,yaw_deg\n0,0,0,0,10,{first},30\n1,0,0,0,-170,{second},400\n"
    for text in (in_degrees, f"t,x,y,z,roll,pitch,yaw\n{rows}\n", mixed):
        run = read_csv(saved(tmp_path, text))
        assert np.allclose(Rotation.from_quat(run.poses[:, 3:]).as_matrix(), expected, atol=1e-14)


def test_a_positive_pitch_lowers_the_bow(tmp_path):
    run = read_csv(saved(tmp_path, "t,x,y,z,roll,pitch,yaw\n0,0,0,0,0,0.1,0\n"))
    assert Rotation.from_quat(run.poses[0, 3:]).apply([1.0, 0.0, 0.0])[2] < -0.09


def test_tum_skips_comments_and_blank_lines_and_takes_any_blanks(tmp_path):
    text = f"{TUM}\n\n 1403636579.763555527  1 2\t3 0 0 0 1\n# half-way\n1403636580 4 5 6 0.6 0 0 0.8\n"
    run = read_trajectory(saved(tmp_path, text, "groundtruth.txt"))
    assert run.times.tolist() == [1403636579.763555527, 1403636580.0]
    assert np.allclose(run.poses, [[1, 2, 3, 0, 0, 0, 1], [4, 5, 6, 0.6, 0, 0, 0.8]])


def test_a_rounded_quaternion_is_normalised(tmp_path):
    run = read_csv(saved(tmp_path, csv_lines("0,0,0,0,0.7075,0,0,0.7075")))
    assert np.allclose(np.linalg.norm(run.poses[:, 3:], axis=1), 1.0, atol=1e-15)


@st.composite
def trajectories(draw):
    count = draw(st.integers(1, 12))
    number = st.floats(-1e4, 1e4, allow_subnormal=False)
    times = draw(st.lists(st.floats(-9e9, 9e9), min_size=count, max_size=count, unique=True))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    quaternion = rng.standard_normal((count, 4))
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    places = draw(st.lists(st.tuples(number, number, number), min_size=count, max_size=count))
    return Trajectory(times=np.array(sorted(times)), poses=np.column_stack([places, quaternion]))


@FUZZ
@given(run=trajectories(), kind=st.sampled_from([(write_csv, "a.csv"), (write_tum, "a.tum")]))
def test_what_is_written_is_read_back(tmp_path, run, kind):
    write, name = kind
    write(run, tmp_path / name)
    again = read_trajectory(tmp_path / name)
    assert np.array_equal(again.times, run.times)
    assert np.array_equal(again.poses[:, :3], run.poses[:, :3])
    # Reading normalises once more: an ulp.
    assert np.abs(again.poses[:, 3:] - run.poses[:, 3:]).max() < 4e-16


REFUSED = {
    "empty": ("run.csv", b"", r"run\.csv: empty, must begin with a header"),
    "header only": ("run.csv", CSV, r"run\.csv: no poses, must be at least 1"),
    "TUM of comments": ("run.tum", TUM, r"run\.tum: no poses, must be at least 1"),
    "unknown ending": ("run.json", CSV, r"run\.json: ends in '\.json', must be \.csv"),
    "not UTF-8": ("run.csv", b"t,x\n\xff", r"run\.csv: byte 4 is not UTF-8"),
    "broken quotes": ("run.csv", csv_lines('0,0,0,0,"a"b,0,0,1'), r"run\.csv:2: not CSV"),
    "no z": ("run.csv", "t,x,y,qx,qy,qz,qw\n", r"run\.csv:1: column z: missing, must be there once"),
    "no attitude": ("run.csv", "t,x,y,z\n", r"run\.csv:1: column qx: missing"),
    "no pitch": ("run.csv", "t,x,y,z,roll,yaw\n", r"run\.csv:1: column pitch: missing"),
    "two rolls": ("run.csv", "t,x,y,z,roll,roll_deg,pitch,yaw\n", r"column roll: given as roll and roll_deg"),
    "two attitudes": ("run.csv", f"{CSV},yaw\n", r"columns qx and yaw: two attitudes"),
    "a column twice": ("run.csv", f"{CSV},x\n", r"run\.csv:1: column x: given 2 times"),
    "a missing time": ("run.csv", csv_lines(f",0,0,0,{LEVEL}"), r"run\.csv:2: t: '', must be a number"),
    "words": ("run.csv", csv_lines(f"0,0,one,0,{LEVEL}"), r"run\.csv:2: y: 'one', must be a number"),
    "digits apart": ("run.csv", csv_lines(f"0,0,1_5,0,{LEVEL}"), r"run\.csv:2: y: '1_5', must be a number"),
    "NaN time": ("run.csv", csv_lines(f"nan,0,0,0,{LEVEL}"), r"run\.csv:2: t: nan, must be finite"),
    "NaN place": ("run.csv", csv_lines(f"0,0,0,NaN,{LEVEL}"), r"run\.csv:2: z: nan, must be finite"),
    "too large": ("run.csv", csv_lines(f"0,1e999,0,0,{LEVEL}"), r"run\.csv:2: x: inf, must be finite"),
    "infinite attitude": ("run.csv", csv_lines("0,0,0,0,0,0,0,inf"), r"run\.csv:2: qw: inf, must be finite"),
    "short line": ("run.csv", csv_lines("0,0,0"), r"run\.csv:2: 3 fields, must be 8"),
    "short TUM line": ("run.tum", f"{TUM}\n0 0 0 0 0 0 1\n", r"run\.tum:2: 7 fields, must be 8"),
    "repeated time": (
        "run.csv",
        csv_lines(f"0,0,0,0,{LEVEL}", "", f"1,0,0,0,{LEVEL}", f"1,0,0,0,{LEVEL}"),
        r"run\.csv:5: t: 1 s repeats 1 s, must increase; sort the lines",
    ),
    "unsorted": (
        "run.tum",
        f"{TUM}\n1 0 0 0 0 0 0 1\n0.5 0 0 0 0 0 0 1\n",
        r"run\.tum:3: t: 0\.5 s comes after 1 s, must increase",
    ),
    "nanoseconds": ("run.csv", csv_lines(f"1.4e18,0,0,0,{LEVEL}"), r"run\.csv:2: t: 1\.4e\+18, .*give seconds"),
    "long quaternion": ("run.csv", csv_lines("0,0,0,0,0,0,0,1.002"), r"run\.csv:2: qx,qy,qz,qw: length 1\.002"),
    "huge quaternion": ("run.csv", csv_lines("0,0,0,0,0,0,0,1e300"), r"length inf, must be within 0\.001 of 1"),
    "zero quaternion": ("run.tum", f"{TUM}\n0 0 0 0 0 0 0 0\n", r"run\.tum:2: qx,qy,qz,qw: length 0, "),
    "far away": ("run.csv", csv_lines(f"0,1e7,0,0,{LEVEL}"), r"run\.csv: poses: coordinate of 1e\+07 m, must be"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_careless_file_is_refused_by_file_line_and_field(tmp_path, case):
    name, content, message = REFUSED[case]
    with pytest.raises(ValueError, match=message) as refused:
        read_trajectory(saved(tmp_path, content, name))
    assert "\n" not in str(refused.value)


def test_places_without_a_file_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"none\.csv: No such file or directory, must be a readable"):
        read_trajectory(tmp_path / "none.csv")
    (tmp_path / "folder.tum").mkdir()
    with pytest.raises(ValueError, match=r"folder\.tum: Is a directory"):
        read_trajectory(tmp_path / "folder.tum")
    run = read_csv(saved(tmp_path, csv_lines(f"0,0,0,0,{LEVEL}")))
    for write in (write_csv, write_tum):
        with pytest.raises(ValueError, match=r"below\.csv: cannot be written: Not a directory; choose another"):
            write(run, tmp_path / "run.csv" / "below.csv")


def mutated(data: bytes, seed: int) -> bytes:
    """Bytes with some cut, swapped, doubled or replaced."""
    rng = random.Random(seed)
    changed = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(changed) + 1)
        end = min(at + rng.randint(1, 6), len(changed))
        piece = rng.choice([b"", b"-", b"e9", b"nan", b",", b"\n", b'"', b"\0", b" ", rng.randbytes(3), b"7" * 400])
        changed[at:end] = piece
    return bytes(changed)


SOUND = {
    "csv": csv_lines(*(f"{time},1.5,-2,3,{LEVEL}" for time in range(4))).encode(),
    "tum": f"{TUM}\n0 1 2 3 0 0 0 1\n1 1 2 3 0.6 0 0 0.8\n".encode(),
}


@FUZZ
@given(kind=st.sampled_from(["csv", "tum"]), seed=st.integers(0, 2**32), noise=st.none() | st.binary(max_size=80))
@example(kind="csv", seed=0, noise=b"t,x\x1cy\n")
@example(kind="csv", seed=0, noise="t,x\x85y\n".encode())
@example(kind="csv", seed=0, noise="t,x\u2028y\n".encode())
def test_a_mutated_file_is_read_or_refused_in_one_line(tmp_path, kind, seed, noise):
    path = saved(tmp_path, mutated(SOUND[kind], seed) if noise is None else noise, f"run.{kind}")
    run, message = attempt(read_csv if kind == "csv" else read_tum, path)
    if message is None:
        assert np.isfinite(run.poses).all()
    else:
        assert message.startswith(str(path))
