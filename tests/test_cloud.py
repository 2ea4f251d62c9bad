"""Point clouds: attributes travel with their points, into files and back."""

from io import BytesIO
from typing import Any

import numpy as np
import pytest
import trimesh
from pypcd4.pypcd4 import Encoding
from pypcd4.pypcd4 import PointCloud as Pcd

from sonarwarp import PointCloud, read_cloud
from sonarwarp.cloud import NORMAL

POINTS = np.array([[0.0, 1.0, 2.0], [3.0, 4.0, 5.0], [6.0, 7.0, 8.5]])


def cloud():
    return PointCloud(
        points=POINTS, attributes={"range": np.array([1.5, 2.5, 3.5]), "quality": np.array([2, 1, 2], dtype=np.int32)}
    )


def cloud_with_normals():
    normals = np.array([[0.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [-0.625, 0.125, 0.75]])
    given = dict(zip(NORMAL, normals.T, strict=True))
    return PointCloud(points=POINTS, attributes=given | cloud().attributes)


def test_selecting_points_selects_their_attributes():
    chosen = cloud().select(np.array([True, False, True]))
    assert np.array_equal(chosen.points, POINTS[[0, 2]])
    assert chosen.attributes["range"].tolist() == [1.5, 3.5]


def test_ply_keeps_points_and_attributes(tmp_path):
    path = tmp_path / "cloud.ply"
    cloud().write_ply(path)
    read: Any = trimesh.load(path)
    assert np.allclose(read.vertices, POINTS)
    stored = read.metadata["_ply_raw"]["vertex"]["data"]
    assert stored["range"].dtype == np.float32
    assert stored["quality"].dtype == np.int32
    assert stored["range"].tolist() == [1.5, 2.5, 3.5]
    assert stored["quality"].tolist() == [2, 1, 2]


def pcd(points=POINTS, fields=("x", "y", "z"), encoding=Encoding.BINARY):
    """A PCD file in memory, of another program's making."""
    content = BytesIO()
    Pcd.from_points(np.asarray(points), fields, [np.float32] * len(fields)).save(content, encoding)
    return content.getvalue()


def test_pcd_keeps_points_and_attributes(tmp_path):
    path = tmp_path / "cloud.pcd"
    cloud().write_pcd(path)
    read = Pcd.from_path(path)
    assert read.metadata.data is Encoding.BINARY
    assert read.fields == ("x", "y", "z", "range", "quality")
    assert read.types == (np.float32, np.float32, np.float32, np.float32, np.int32)
    assert read.numpy().tolist() == [
        [*point, r, q] for point, r, q in zip(POINTS, (1.5, 2.5, 3.5), (2, 1, 2), strict=True)
    ]


@pytest.mark.parametrize("encoding", [Encoding.ASCII, Encoding.BINARY_COMPRESSED])
def test_any_pcd_is_a_cloud(tmp_path, encoding):
    path = tmp_path / "cloud.pcd"
    path.write_bytes(pcd(np.eye(4), ("x", "y", "z", "intensity"), encoding))
    read = read_cloud(path)
    assert np.array_equal(read.points, np.eye(4)[:, :3])
    assert read.attributes["intensity"].tolist() == [0.0, 0.0, 0.0, 1.0]


def test_padding_in_a_pcd_is_no_attribute(tmp_path):
    path = tmp_path / "cloud.pcd"
    path.write_bytes(pcd(np.eye(5), ("x", "y", "z", "_", "intensity")))
    assert set(read_cloud(path).attributes) == {"intensity"}


WRITERS = [(".ply", PointCloud.write_ply), (".pcd", PointCloud.write_pcd), (".npz", PointCloud.write_npz)]


@pytest.mark.parametrize(("suffix", "write"), WRITERS)
def test_a_cloud_without_points_is_written_and_read(tmp_path, suffix, write):
    path = tmp_path / f"cloud{suffix}"
    write(cloud().select(np.zeros(3, dtype=bool)), path)
    read = read_cloud(path)
    assert len(read) == 0
    assert set(read.attributes) == {"range", "quality"}


@pytest.mark.parametrize(("suffix", "write"), WRITERS)
def test_what_is_written_is_read(tmp_path, suffix, write):
    path = tmp_path / f"cloud{suffix}"
    write(cloud(), path)
    read = read_cloud(path)
    # Exact in float32 too.
    assert np.array_equal(read.points, POINTS)
    assert set(read.attributes) == {"range", "quality"}
    for name, values in cloud().attributes.items():
        assert read.attributes[name].tolist() == values.tolist()
        assert np.issubdtype(read.attributes[name].dtype, np.integer) == np.issubdtype(values.dtype, np.integer)


def ply_names(path):
    return trimesh.load(path).metadata["_ply_raw"]["vertex"]["data"].dtype.names


def pcd_names(path):
    return Pcd.from_path(path).fields


@pytest.mark.parametrize(
    ("suffix", "write", "names_in", "names"),
    [
        # What MeshLab and CloudCompare read as normals, and what PCL does.
        (*WRITERS[0], ply_names, ("nx", "ny", "nz")),
        (*WRITERS[1], pcd_names, ("normal_x", "normal_y", "normal_z")),
    ],
)
def test_normals_have_the_names_that_other_programs_know(tmp_path, suffix, write, names_in, names):
    path = tmp_path / f"cloud{suffix}"
    write(cloud_with_normals(), path)
    assert tuple(names_in(path)) == ("x", "y", "z", *names, "range", "quality")


@pytest.mark.parametrize(("suffix", "write"), WRITERS)
def test_normals_are_read_by_the_names_that_they_had(tmp_path, suffix, write):
    path, given = tmp_path / f"cloud{suffix}", cloud_with_normals()
    write(given, path)
    read = read_cloud(path)
    assert set(read.attributes) == {*NORMAL, "range", "quality"}
    for name, values in given.attributes.items():
        assert read.attributes[name].tolist() == values.tolist()


def test_two_attributes_of_one_name_in_ply_are_refused(tmp_path):
    attributes = {"normal_y": np.zeros(3), "ny": np.ones(3)}
    with pytest.raises(ValueError, match=r"attributes: 'normal_y' and 'ny' are both ny in PLY: rename one"):
        PointCloud(points=POINTS, attributes=attributes).write_ply(tmp_path / "cloud.ply")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("cloud.xyz", b"0 0 0", r"cloud\.xyz: \.xyz, must be \.ply, \.pcd or \.npz"),
        ("cloud.ply", b"ply\nformat", r"cloud\.ply: cannot be read as a cloud"),
        ("cloud.npz", b"PK", r"cloud\.npz: cannot be read as a cloud"),
        ("cloud.pcd", b"VERSION 0.7\nFIELDS x", r"cloud\.pcd: cannot be read as a cloud: no whole header"),
    ],
)
def test_bad_files_are_refused_by_name(tmp_path, name, content, message):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ValueError, match=message):
        read_cloud(path)


@pytest.mark.parametrize(
    ("written", "found"),
    [
        (b"FIELDS x", b"FIELDS a"),
        (b"TYPE F", b"TYPE Q"),
        (b"SIZE 4", b"SIZE 3"),
        (b"COUNT 1 1", b"COUNT 1"),
        (b"COUNT 1", b"COUNT 99999999"),
        (b"POINTS 3", b"POINTS 4"),
        (b"POINTS 3", b"POINTS -3"),
        (b"POINTS 3", b"POINTS 99999999999999"),
        (b"VERSION", b"\xff\xfe"),
        (b"DATA binary", b"DATA ascii"),
        (b"DATA binary", b"DATA binary_compressed"),
    ],
)
def test_a_garbled_pcd_is_refused_in_one_line(tmp_path, written, found):
    path = tmp_path / "cloud.pcd"
    path.write_bytes(pcd().replace(written, found, 1))
    with pytest.raises(ValueError, match=r"cloud\.pcd: cannot be read as a cloud: \S") as refusal:
        read_cloud(path)
    assert len(str(refusal.value).splitlines()) == 1


def test_a_pcd_cut_anywhere_is_refused(tmp_path):
    path, whole = tmp_path / "cloud.pcd", pcd()
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        with pytest.raises(ValueError, match="cannot be read as a cloud"):
            read_cloud(path)


@pytest.mark.parametrize("name", ["", "elevation deviation", "a\nb"])
def test_a_name_that_pcd_cannot_hold_is_refused(tmp_path, name):
    odd = PointCloud(points=POINTS, attributes={name: np.zeros(3)})
    with pytest.raises(ValueError, match="must be letters, digits and underscores for PCD"):
        odd.write_pcd(tmp_path / "cloud.pcd")
    assert not list(tmp_path.iterdir())


def test_bad_clouds_are_refused_by_name():
    with pytest.raises(ValueError, match=r"PointCloud\.points: expected shape \(None, 3\), got \(3, 2\)"):
        PointCloud(points=POINTS[:, :2])
    with pytest.raises(ValueError, match=r"PointCloud\.points: inf at index"):
        PointCloud(points=np.array([[0.0, np.inf, 0.0]]))
    with pytest.raises(ValueError, match=r"PointCloud\.attributes\[range\]: expected \(3,\), got \(2,\)"):
        PointCloud(points=POINTS, attributes={"range": np.zeros(2)})
