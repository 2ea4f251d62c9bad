"""What the two sonars are and how a vehicle carries them: FLS, PS, mounts, rig, and the paper's presets.

Every field gives its unit, its default and where the default comes from. "Paper" is Joe et al. 2022, "ours" means that
the paper is silent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
import warp as wp

from sonarwarp.checks import finite_array, in_range
from sonarwarp.poses import turned
from sonarwarp_kernels.specs import Fan

# Integer sums hold this many counts for the largest amplitude that a bin can reach: one bit under the sign is spare.
_FULL_SCALE = 2.0**30

# Widest strip of a beam [rad]. Over a brick's edges strips of 1 deg are 1.6 % wrong, of 0.5 deg 0.8 %, of 3 deg 2.7 %.
_WIDEST_STRIP = math.radians(0.5)

# Furthest range and longest lever arm [m]: positions in single precision are good to 1 mm up to here.
_FURTHEST = 1e4


def uniform_edges(start: float, stop: float, count: int) -> np.ndarray:
    """Edges of ``count`` equal bins from ``start`` to ``stop``, shape [count + 1]."""
    return np.linspace(start, stop, count + 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class FLS:
    """Forward-looking multibeam imaging sonar: range and azimuth, no elevation."""

    azimuth_edge: np.ndarray = field(default_factory=lambda: np.radians(uniform_edges(-14.5, 14.5, 96)))
    """Borders between neighbouring beams [rad], positive to the left, ascending, shape [beam + 1]. Paper: 96 beams
    over 29 deg; its 0.3 deg a beam is 29 / 96 rounded."""

    range_edge: np.ndarray = field(default_factory=lambda: uniform_edges(0.42, 5.42, 512))
    """Slant ranges of the bins' borders [m], ascending, shape [bin + 1]. Paper: 512 bins, 5 m from 0.42 m."""

    vertical_beamwidth_deg: float = 14.0
    """Elevation extent of every beam [deg]. Paper."""

    rate: float = 10.0
    """Frames per second [Hz]. Paper."""

    cone: bool = False
    """Whether a beam keeps y / r (a linear array's cone) instead of azimuth (the paper's fan)."""

    gain_db: float = 0.0
    """Gain on the echo amplitude [dB]. Ours."""

    intervals: int = 64
    """Elevation intervals that an image is formed from. Ours: on a rough seabed (1 cm RMS over 0.3 m) 64 are 0.9 %
    wrong at the tilt of 40 deg and 1.3 % at the field test's 25 deg; 48 are 1.0 and 1.5 % for a fifth less time."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "azimuth_edge", finite_array("FLS.azimuth_edge", self.azimuth_edge, ascending=True))
        object.__setattr__(self, "range_edge", finite_array("FLS.range_edge", self.range_edge, ascending=True))
        in_range("FLS.azimuth_edge[0]", self.azimuth_edge[0], -math.pi / 2, math.pi / 2)
        in_range("FLS.azimuth_edge[-1]", self.azimuth_edge[-1], -math.pi / 2, math.pi / 2)
        in_range("FLS.range_edge[0]", self.range_edge[0], 0.01, _FURTHEST)
        in_range("FLS.range_edge[-1]", self.range_edge[-1], 0.01, _FURTHEST)
        in_range("FLS.vertical_beamwidth_deg", self.vertical_beamwidth_deg, 0.1, 120.0)
        in_range("FLS.rate", self.rate, 1e-3, 1e3)
        in_range("FLS.gain_db", self.gain_db, -200.0, 200.0)
        in_range("FLS.intervals", self.intervals, 4, 4096)

    @property
    def beams(self) -> int:
        """Number of beams."""
        return len(self.azimuth_edge) - 1

    @property
    def bins(self) -> int:
        """Number of range bins."""
        return len(self.range_edge) - 1

    @property
    def azimuth(self) -> np.ndarray:
        """Centres of the beams [rad], shape [beam]."""
        return 0.5 * (self.azimuth_edge[:-1] + self.azimuth_edge[1:])

    @property
    def half_elevation(self) -> float:
        """Half the vertical beamwidth [rad]."""
        return math.radians(self.vertical_beamwidth_deg) / 2

    @property
    def strips(self) -> int:
        """Strips that every beam is cut into: 1 unless a beam is wider than 0.5 deg."""
        return math.ceil(float(np.max(np.diff(self.azimuth_edge))) / _WIDEST_STRIP)

    def fan(self, device: str | wp.Device) -> Fan:
        """The kernels' description, its arrays on ``device``."""
        return _fan(
            self.azimuth_edge,
            self.strips,
            self.half_elevation,
            self.intervals,
            self.cone,
            self.range_edge,
            self.gain_db,
            device,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class PS:
    """Mechanically scanned profiling sonar: one beam on a turning head, narrow in the scan plane and wide across it."""

    beamwidth_deg: float = 1.8
    """Width in the scan plane [deg]. Paper."""

    fan_beamwidth_deg: float = 20.0
    """Width across the scan plane [deg]. Paper."""

    range_edge: np.ndarray = field(default_factory=lambda: uniform_edges(0.3, 10.0, 970))
    """Slant ranges of the bins' borders [m], ascending, shape [bin + 1]. Paper: 10 m; 1 cm bins and start are ours."""

    sector_deg: float = 60.0
    """Scanned sector, centred on the mount's tilt, swept to and fro [deg]. Paper (field test)."""

    step_deg: float = 1.8
    """Head's turn between pings [deg]. Ours: one beamwidth."""

    scan_rate_deg: float = 3.6
    """Head's speed [deg/s]. Paper (simulation)."""

    gain_db: float = 30.0
    """Gain on the echo amplitude [dB]. Paper (simulation)."""

    strips: int = 4
    """Strips in the scan plane that an echo is formed from. Ours: 0.7 % error or less over a flat and a rough seabed,
    2 strips 1.7 %; 0.05 to 0.2 ms a ping."""

    intervals: int = 20
    """Intervals across the scan plane that an echo is formed from. Ours: 40 change nothing that matters (0.5 %)."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "range_edge", finite_array("PS.range_edge", self.range_edge, ascending=True))
        in_range("PS.range_edge[0]", self.range_edge[0], 0.01, _FURTHEST)
        in_range("PS.range_edge[-1]", self.range_edge[-1], 0.01, _FURTHEST)
        in_range("PS.beamwidth_deg", self.beamwidth_deg, 0.05, 30.0)
        in_range("PS.fan_beamwidth_deg", self.fan_beamwidth_deg, 0.1, 120.0)
        in_range("PS.step_deg", self.step_deg, 0.01, 90.0)
        in_range("PS.sector_deg", self.sector_deg, self.step_deg, 360.0)
        in_range("PS.scan_rate_deg", self.scan_rate_deg, 1e-3, 1e4)
        in_range("PS.gain_db", self.gain_db, -200.0, 200.0)
        in_range("PS.strips", self.strips, 1, 256)
        in_range("PS.intervals", self.intervals, 4, 4096)

    @property
    def rate(self) -> float:
        """Pings per second [Hz]."""
        return self.scan_rate_deg / self.step_deg

    @property
    def pings_per_sweep(self) -> int:
        """Head positions between one end of the sector and the other."""
        return int(self.sector_deg / self.step_deg) + 1

    @property
    def bins(self) -> int:
        """Number of range bins."""
        return len(self.range_edge) - 1

    def head_angles(self, number: np.ndarray) -> np.ndarray:
        """Head angle xi [rad] of each ping ``number`` (int, any shape), swept to and fro from the lower end."""
        last = self.pings_per_sweep - 1
        if last == 0:
            return np.zeros(np.shape(number))
        phase = np.asarray(number) % (2 * last)
        position = np.where(phase <= last, phase, 2 * last - phase)
        return np.radians(self.step_deg) * (position - last / 2)

    def fan(self, device: str | wp.Device) -> Fan:
        """The kernels' description, its arrays on ``device``; in the head's own frame the one beam is at azimuth 0."""
        half = math.radians(self.beamwidth_deg) / 2
        across = math.radians(self.fan_beamwidth_deg) / 2
        edge = np.array([-half, half])
        return _fan(edge, self.strips, across, self.intervals, True, self.range_edge, self.gain_db, device)


def _fan(
    azimuth_edge: np.ndarray,
    strips: int,
    half_elevation: float,
    intervals: int,
    cone: bool,
    range_edge: np.ndarray,
    gain_db: float,
    device: str | wp.Device,
) -> Fan:
    beams = len(azimuth_edge) - 1
    columns = np.interp(np.arange(beams * strips + 1) / strips, np.arange(beams + 1), azimuth_edge)
    fan = Fan()
    fan.azimuth = wp.array(0.5 * (azimuth_edge[:-1] + azimuth_edge[1:]), dtype=float, device=device)
    fan.column_azimuth = wp.array(columns, dtype=float, device=device)
    fan.first_column = wp.array(np.arange(beams) * strips, dtype=int, device=device)
    fan.strips = strips
    fan.elevation_min = -half_elevation
    fan.elevation_max = half_elevation
    fan.intervals = intervals
    fan.cone = int(cone)
    fan.range_edge = wp.array(range_edge, dtype=float, device=device)
    fan.amplitude = 10.0 ** (gain_db / 20.0)
    fan.fixed_point = _FULL_SCALE * float(range_edge[0]) ** 2 / fan.amplitude
    return fan


@dataclass(frozen=True, kw_only=True)
class Mount:
    """Where a sonar sits on the vehicle; its own frame is x forward, y left, z up before it is turned."""

    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Lever arm in the vehicle's frame [m]."""

    tilt_deg: float = 40.0
    """Turn of the axis downwards [deg]. Paper (simulation)."""

    roll_deg: float = 0.0
    """Turn about the sonar's own axis [deg], applied first; 90 lays the PS on its side."""

    pan_deg: float = 0.0
    """Turn to the left about the vehicle's z axis [deg], applied last."""

    def __post_init__(self) -> None:
        finite_array("Mount.position", np.asarray(self.position, dtype=float), shape=(3,))
        for value in self.position:
            in_range("Mount.position", value, -_FURTHEST, _FURTHEST)
        in_range("Mount.tilt_deg", self.tilt_deg, -180.0, 180.0)
        in_range("Mount.roll_deg", self.roll_deg, -180.0, 180.0)
        in_range("Mount.pan_deg", self.pan_deg, -180.0, 180.0)

    def vehicle_from_sensor(self) -> np.ndarray:
        """Pose of the sonar in the vehicle's frame, (x, y, z, qx, qy, qz, qw), by Eq. 35's order of rotations."""
        still = np.array([[*self.position, 0.0, 0.0, 0.0, 1.0]], dtype=np.float64)
        return turned(still, np.radians([[self.roll_deg, self.tilt_deg, self.pan_deg]]))[0]


@dataclass(frozen=True, kw_only=True)
class Rig:
    """Both sonars and their mounts."""

    fls: FLS = field(default_factory=FLS)
    ps: PS = field(default_factory=PS)
    fls_mount: Mount = field(default_factory=Mount)
    ps_mount: Mount = field(default_factory=lambda: Mount(position=(0.0, 0.0, 0.15), roll_deg=90.0))
    """Paper: laid on its side, on top of the FLS; the 15 cm are ours."""

    def tilted(self, tilt_deg: float) -> Rig:
        """The same rig with both sonars tilted by ``tilt_deg``."""
        return replace(
            self,
            fls_mount=replace(self.fls_mount, tilt_deg=tilt_deg),
            ps_mount=replace(self.ps_mount, tilt_deg=tilt_deg),
        )


def _paper_field() -> Rig:
    fls = FLS(range_edge=uniform_edges(0.83, 5.83, 512))
    return Rig(fls=fls, ps=PS(scan_rate_deg=1.2, gain_db=25.0)).tilted(25.0)


PRESETS: dict[str, Rig] = {
    "paper simulation": Rig(),
    "paper slope series": Rig().tilted(30.0),
    "paper field": _paper_field(),
}
"""Rigs of the paper: section 3.1, section 2.2 and section 3.3."""
