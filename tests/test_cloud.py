"""Point clouds: attributes travel with their points, into PLY and back."""

from typing import Any

import numpy as np
import pytest
import trimesh

from sonarwarp import PointCloud, read_cloud

POINTS = np.array([[0.0, 1.0, 2.0], [3.0, 4.0, 5.0], [6.0, 7.0, 8.5]])


def cloud():
    return PointCloud(
        points=POINTS, attributes={"range": np.array([1.5, 2.5, 3.5]), "quality": np.array([2, 1, 2], dtype=np.int32)}
    )


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


@pytest.mark.parametrize(("suffix", "write"), [(".ply", PointCloud.write_ply), (".npz", PointCloud.write_npz)])
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


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("cloud.xyz", b"0 0 0", r"cloud\.xyz: \.xyz, must be \.ply or \.npz"),
        ("cloud.ply", b"ply\nformat", r"cloud\.ply: cannot be read as a cloud"),
        ("cloud.npz", b"PK", r"cloud\.npz: cannot be read as a cloud"),
    ],
)
def test_bad_files_are_refused_by_name(tmp_path, name, content, message):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ValueError, match=message):
        read_cloud(path)


def test_bad_clouds_are_refused_by_name():
    with pytest.raises(ValueError, match=r"PointCloud\.points: expected shape \(None, 3\), got \(3, 2\)"):
        PointCloud(points=POINTS[:, :2])
    with pytest.raises(ValueError, match=r"PointCloud\.points: inf at index"):
        PointCloud(points=np.array([[0.0, np.inf, 0.0]]))
    with pytest.raises(ValueError, match=r"PointCloud\.attributes\[range\]: expected \(3,\), got \(2,\)"):
        PointCloud(points=POINTS, attributes={"range": np.zeros(2)})
