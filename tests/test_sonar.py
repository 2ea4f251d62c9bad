"""Sonars, mounts and presets: the paper's numbers, the frames' signs, refusals by name."""

import numpy as np
import pytest

import sonarwarp as sw
from sonarwarp.poses import compose, rotate

FORWARD = np.array([1.0, 0.0, 0.0])


def test_presets_carry_the_papers_numbers():
    simulation, slope, sea = (sw.PRESETS[name] for name in ("paper simulation", "paper slope series", "paper field"))
    for rig in (simulation, slope, sea):
        assert (rig.fls.beams, rig.fls.bins, rig.fls.rate) == (96, 512, 10.0)
        assert np.degrees(np.ptp(rig.fls.azimuth_edge)) == pytest.approx(29.0)
        assert rig.fls.vertical_beamwidth_deg == 14.0
        assert (rig.ps.beamwidth_deg, rig.ps.fan_beamwidth_deg, rig.ps.range_edge[-1]) == (1.8, 20.0, 10.0)
    assert [rig.fls_mount.tilt_deg for rig in (simulation, slope, sea)] == [40.0, 30.0, 25.0]
    assert [rig.ps_mount.tilt_deg for rig in (simulation, slope, sea)] == [40.0, 30.0, 25.0]
    assert (simulation.fls.range_edge[0], simulation.fls.range_edge[-1]) == (0.42, 5.42)
    assert (sea.fls.range_edge[0], sea.fls.range_edge[-1]) == (0.83, 5.83)
    assert (simulation.ps.scan_rate_deg, simulation.ps.gain_db) == (3.6, 30.0)
    assert (sea.ps.scan_rate_deg, sea.ps.gain_db, sea.ps.sector_deg) == (1.2, 25.0, 60.0)


def test_tilt_is_positive_downwards_and_pan_to_the_left():
    down = rotate(sw.Mount(tilt_deg=90.0).vehicle_from_sensor()[3:], FORWARD)
    assert np.allclose(down, [0.0, 0.0, -1.0])
    left = rotate(sw.Mount(tilt_deg=0.0, pan_deg=90.0).vehicle_from_sensor()[3:], FORWARD)
    assert np.allclose(left, [0.0, 1.0, 0.0])


def test_a_positive_head_angle_raises_the_beam_of_a_sonar_on_its_side():
    mount = sw.Rig().ps_mount
    xi = np.radians(10.0)
    head = np.array([0.0, 0.0, 0.0, 0.0, 0.0, np.sin(xi / 2), np.cos(xi / 2)])
    beam = rotate(compose(mount.vehicle_from_sensor(), head)[3:], FORWARD)
    assert np.degrees(np.arcsin(-beam[2])) == pytest.approx(mount.tilt_deg - 10.0)


def test_the_head_sweeps_to_and_fro():
    ps = sw.PS(sector_deg=9.0, step_deg=1.8)
    angles = np.degrees(ps.head_angles(np.arange(13)))
    assert ps.pings_per_sweep == 6
    assert np.allclose(angles[:6], [-4.5, -2.7, -0.9, 0.9, 2.7, 4.5])
    assert np.allclose(angles[5:11], angles[5::-1])
    assert np.allclose(angles[10:], angles[:3])
    assert ps.rate == pytest.approx(2.0)


def test_beams_that_touch_share_a_column(device):
    fls = sw.FLS(azimuth_edge=np.radians([-0.4, 0.0, 0.3, 0.9]))
    fan = fls.fan(device)
    columns, first = fan.column_azimuth.numpy(), fan.first_column.numpy()
    for beam in range(3):
        assert columns[first[beam]] == pytest.approx(fls.azimuth_edge[beam])
        assert columns[first[beam] + fan.strips] == pytest.approx(fls.azimuth_edge[beam + 1])


def test_beams_wider_than_half_a_degree_are_cut_into_strips():
    for width_deg, strips in ((0.3, 1), (0.5, 1), (0.6, 2), (1.8, 4)):
        assert sw.FLS(azimuth_edge=np.radians([0.0, width_deg])).strips == strips


WRONG = [
    (lambda: sw.FLS(range_edge=np.array([1.0, 0.5])), r"FLS\.range_edge: 0\.5 follows 1, must ascend"),
    (lambda: sw.FLS(range_edge=np.array([0.0, 1.0])), r"FLS\.range_edge\[0\]: 0 is outside \[0\.01, 10000\]"),
    (lambda: sw.FLS(azimuth_edge=np.array([0.0, np.nan])), r"FLS\.azimuth_edge: nan at index 1, must be finite"),
    (lambda: sw.FLS(azimuth_edge=np.array([0.0])), r"FLS\.azimuth_edge: expected one axis of at least 2"),
    (lambda: sw.FLS(vertical_beamwidth_deg=-1.0), r"FLS\.vertical_beamwidth_deg: -1 is outside"),
    (lambda: sw.PS(step_deg=0.0), r"PS\.step_deg: 0 is outside"),
    (lambda: sw.PS(sector_deg=0.5), r"PS\.sector_deg: 0\.5 is outside \[1\.8, 360\]"),
    (lambda: sw.Mount(position=(0.0, np.inf, 0.0)), r"Mount\.position: inf at index 1, must be finite"),
    (lambda: sw.Mount(tilt_deg=200.0), r"Mount\.tilt_deg: 200 is outside \[-180, 180\]"),
]


@pytest.mark.parametrize(("build", "message"), WRONG)
def test_wrong_fields_are_refused_by_name(build, message):
    with pytest.raises(ValueError, match=message):
        build()
