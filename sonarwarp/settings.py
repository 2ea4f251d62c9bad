"""What a simulation adds to echoes, and how a reconstruction reads them.

Every field gives its unit, its default and where the default comes from. "Paper" is Joe et al. 2022, "ours" means that
the paper is silent and says why.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from sonarwarp.checks import in_range


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Noise on the echo amplitudes of both sonars, independent between sonars, beams and bins.

    Speckle is correlated along the track, the background independent from frame to frame.
    """

    speckle: bool = True
    """Rayleigh speckle of unit mean on every bin: Eq. 36 gives an amplitude (Goodman, Speckle Phenomena in Optics)."""

    speckle_length: float = 0.01
    """Way of a sonar over which its speckle's complex correlation falls to 1/pi [m], and to 0 over twice that; 0 for
    speckle independent from frame to frame. Ours: a sonar that moves ahead carries its bins over the seabed, and after
    one bin of 1 cm they hold other scatterers. Moved sideways it would take half the aperture (Burckhardt 1978; Trahey
    et al. 1986), 8 cm for 0.3 deg at 1.8 MHz, which would be the longer. A turn by one beamwidth counts as much."""

    background_db: float | None = -25.0
    """Mean of the additive Rayleigh background over the flat seabed's echo, at r_emin for the FLS and on the axis of a
    head in mid-sector for the PS [dB]; None for none. Ours."""

    def __post_init__(self) -> None:
        in_range("Noise.speckle_length", self.speckle_length, 0.0, 100.0)
        if self.background_db is not None:
            in_range("Noise.background_db", self.background_db, -200.0, 60.0)


NO_NOISE = Noise(speckle=False, background_db=None)
"""Echoes as they are formed."""


@dataclass(frozen=True, kw_only=True)
class Detection:
    """Critical points of the FLS (Eq. 5-6, 23-30) and footprints of the PS."""

    edge: Literal["nearest", "strongest"] = "nearest"
    """Which edge is the critical point. Eq. 29 takes the strongest; under speckle it lies inside the object's echo in a
    third of the beams, while "the closest point" of the paper's text is the nearest."""

    guard: int = 5
    """Bins left out before I_emin. Ours: a seabed of 1 cm RMS moves r_emin by 1.4-1.9 cm."""

    sigma: float = 1.0
    """Standard deviation of the Gaussian filter [bin]. Ours."""

    deviations: float = 5.0
    """Least edge, in standard deviations of the background's derivative. Ours: 4e-5 false alarms per beam."""

    memory: float = 64.0
    """Bins over which the background's mean forgets. Ours."""

    floor_db: float = -60.0
    """Least edge over a flat seabed's echo at the window's end [dB]. Ours: above numerical crumbs."""

    profile_relative_db: float = -20.0
    """Least return of a ping over its strongest, both corrected for spreading [dB]. Ours: weaker ones come from aside,
    and are credited to all of the fan."""

    profile_clearance: float = 3.0
    """Least return of a ping over the mean of its background. Ours: 7 deviations of smoothed Rayleigh noise."""

    profile_gap: int = 3
    """Bins under the threshold that do not yet end a footprint. Ours: speckle."""

    footprints: int = 4
    """Most footprints kept of a ping, nearest first. Ours."""

    def __post_init__(self) -> None:
        if self.edge not in ("nearest", "strongest"):
            raise ValueError(f"Detection.edge: {self.edge!r}, must be 'nearest' or 'strongest'")
        in_range("Detection.guard", self.guard, 0, 1000)
        in_range("Detection.sigma", self.sigma, 0.1, 10.0)
        in_range("Detection.deviations", self.deviations, 0.0, 100.0)
        in_range("Detection.memory", self.memory, 1.0, 1e6)
        in_range("Detection.floor_db", self.floor_db, -300.0, 60.0)
        in_range("Detection.profile_relative_db", self.profile_relative_db, -120.0, 0.0)
        in_range("Detection.profile_clearance", self.profile_clearance, 1.0, 1e6)
        in_range("Detection.profile_gap", self.profile_gap, 0, 1000)
        in_range("Detection.footprints", self.footprints, 1, 64)


@dataclass(frozen=True, kw_only=True)
class LikelihoodField:
    """The likelihood field (Eq. 21-22)."""

    cell: float = 0.02
    """Edge length of a cell [m]. Ours: the field brick is 15 cm deep."""

    hit: float = 4.0
    """Log-odds that a ping adds on a footprint's ridge. Ours: the slow PS of the field passes a wall twice."""

    miss: float = -2.0
    """Log-odds that a ping adds in front of its first footprint. Ours: a cell is passed once or twice per sweep."""

    no_return: float = 0.0
    """Log-odds that a ping without any footprint adds. Ours: a weak echo missed must not pierce a surface."""

    range_deviation: float = 0.01
    """Standard deviation of a ridge along range [m]. Ours: one bin."""

    low: float = -6.0
    """Lower clamp of log-odds when read. Ours."""

    high: float = 8.0
    """Upper clamp of log-odds when read. Ours."""

    informed: float = 0.5
    """Least log-odds at the most likely particle for a point that the field informs. Ours."""

    window_sweeps: float = 3.0
    """Sweeps of the PS that the paper's method remembers online, k of Eq. 21. Ours."""

    near: float = 0.5
    """Nearest range kept in the field over r_emin: what rises higher has no cells and falls back. Ours."""

    def __post_init__(self) -> None:
        in_range("LikelihoodField.cell", self.cell, 1e-3, 10.0)
        in_range("LikelihoodField.hit", self.hit, 0.0, 100.0)
        in_range("LikelihoodField.miss", self.miss, -100.0, 0.0)
        in_range("LikelihoodField.no_return", self.no_return, -100.0, 0.0)
        in_range("LikelihoodField.range_deviation", self.range_deviation, 1e-4, 10.0)
        in_range("LikelihoodField.low", self.low, -50.0, 0.0)
        in_range("LikelihoodField.high", self.high, 0.0, 50.0)
        in_range("LikelihoodField.informed", self.informed, 0.0, self.high)
        in_range("LikelihoodField.window_sweeps", self.window_sweeps, 0.01, 1e6)
        in_range("LikelihoodField.near", self.near, 0.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class RangeMixture:
    """Parts of the FLS's range likelihood (Eq. 9-13)."""

    weight_hit: float = 0.90
    """alpha_1: the critical point. Ours, like all weights: the paper calibrates them and does not print them."""

    weight_short: float = 0.02
    """alpha_2: something nearer."""

    weight_random: float = 0.05
    """alpha_3: anything."""

    weight_seabed: float = 0.03
    """alpha_4: the uneven seabed."""

    deviation: float = 0.01
    """Standard deviation of the critical range [m]. Ours: one bin."""

    rate_short: float = 1.0
    """Rate of the exponential of nearer returns [1/m]. Ours."""

    rate_seabed: float = 5.0
    """Rate of the rise towards r_emin [1/m]. Ours."""

    def __post_init__(self) -> None:
        names = ("weight_hit", "weight_short", "weight_random", "weight_seabed")
        for name in names:
            in_range(f"RangeMixture.{name}", getattr(self, name), 0.0, 1.0)
        total = sum(getattr(self, name) for name in names)
        if abs(total - 1.0) > 1e-6:
            raise ValueError(f"RangeMixture weights: sum to {total:g}, must sum to 1")
        in_range("RangeMixture.deviation", self.deviation, 1e-4, 10.0)
        in_range("RangeMixture.rate_short", self.rate_short, 1e-3, 1e3)
        in_range("RangeMixture.rate_seabed", self.rate_seabed, 1e-3, 1e3)


@dataclass(frozen=True, kw_only=True)
class FreeSpace:
    """Water that the imaging sonar proves empty, and contacts placed by it. Ours: the paper has no such step.

    The defaults were chosen on fifteen runs of the brick, eleven of wedges and three of meshes, with and without noise.
    """

    reach: float = 0.1
    """Free depths are kept within +- this [m]."""

    guard: float = 0.05
    """A beam without a critical point is free up to this far before r_emin [m]; as ``Detection.guard``."""

    margin_deg: float = 0.25
    """Part of a beam's elevation that proves nothing, at either edge [deg]: boresight and attitude err by 0.2 deg."""

    proven: float = -0.02
    """Least free depth that tells anything [m]: less, behind the surface, is as likely."""

    solid: float = 0.03
    """Most free depth of a contact's own place [m]: cells of 2 cm smooth corners. Where all that is known of an arc is
    freer, it rather lies where nothing is known."""

    deviation: float = 0.014
    """Standard deviation of a contact's free depth about the least on its arc [m]. Sharper ones follow the wedge that
    consecutive arcs leave in doubt, blunter ones leave round shapes to the profiling sonar, which knows them less."""

    odds_power: float = 0.5
    """Power of the profiling sonar's odds on an arc: pings overlap and share their evidence, and its wide fan credits a
    near face to all of its width."""

    least_height: float = 0.06
    """Least height over the seabed of a contact that gives a point [m]: a seabed of 1 cm RMS, an altitude wrong by 1 cm
    and a tilt wrong by 0.3 deg add up to 3 cm at 5 m."""

    informed_deg: float = 1.5
    """Most standard deviation of elevation of an informed point [deg]."""

    sharpness: float = 3.0
    """Power of an arc's weights that counts for the interval of elevation, calibrated on ten runs with noise: the
    deviation above is wide, for the sake of the likeliest place."""

    registration_deg: float = 0.4
    """Standard deviation of elevation between both sonars [deg]: boresights and the head's zero err by 0.2 deg each,
    lever arms, depth and altitude of 1 cm each by 0.15 deg at 4 m, the attitude by 0.1 deg. A run keeps its error."""

    hypotheses: int = 128
    """Places on each arc, 0.11 deg apart in the paper's beam. Ours: half a cell at 4 m."""

    side_bins: int = 8
    """Bins of an onset whose level tells how far a beam is filled. Ours: speckle of 18 % over 8 bins."""

    side_share: float = 0.4
    """Least level of an object's last beam over the next ones'. Half filled, its centre is on the object; speckle
    spreads the levels."""

    side_jump: float = 0.04
    """A neighbour this much further looks past the object [m]."""

    stray_points: int = 6
    """Fewest points in the 27 cells around a point that stays: 0.1 m/s and 4 m away a surface leaves 16."""

    hit_spacing: float = 0.003
    """Edge of the cubes in which only the surest of a trajectory's contacts stays [m]; 0 for all to stay. A third of a
    bin: frames 5 mm apart meet an edge again and again. Of wider cubes the surest of many is less sure than it says,
    and detail across the track goes."""

    def __post_init__(self) -> None:
        in_range("FreeSpace.reach", self.reach, 1e-3, 10.0)
        in_range("FreeSpace.guard", self.guard, 0.0, 10.0)
        in_range("FreeSpace.margin_deg", self.margin_deg, 0.0, 45.0)
        in_range("FreeSpace.proven", self.proven, -10.0, 10.0)
        in_range("FreeSpace.solid", self.solid, 0.0, 10.0)
        in_range("FreeSpace.deviation", self.deviation, 1e-4, 10.0)
        in_range("FreeSpace.odds_power", self.odds_power, 0.0, 1.0)
        in_range("FreeSpace.least_height", self.least_height, 0.0, 10.0)
        in_range("FreeSpace.informed_deg", self.informed_deg, 0.0, 90.0)
        in_range("FreeSpace.sharpness", self.sharpness, 0.1, 10.0)
        in_range("FreeSpace.registration_deg", self.registration_deg, 0.0, 90.0)
        in_range("FreeSpace.hypotheses", self.hypotheses, 1, 1 << 20)
        in_range("FreeSpace.side_bins", self.side_bins, 1, 10000)
        in_range("FreeSpace.side_share", self.side_share, 0.0, 1.0)
        in_range("FreeSpace.side_jump", self.side_jump, 0.0, 10.0)
        in_range("FreeSpace.stray_points", self.stray_points, 0, 1000)
        if self.hit_spacing != 0.0:
            in_range("FreeSpace.hit_spacing", self.hit_spacing, 1e-3, 10.0)


@dataclass(frozen=True, kw_only=True)
class Faces:
    """Steep faces that the profiling sonar saw under the imaging sonar's contacts. Ours throughout."""

    compact: float = 1.5
    """Most spread of a face's footprint over the width of the beam there, an incline of 34 degrees to the beam. Wider
    ones are no evidence of anything solid either: where in them it lies, the profiling sonar cannot tell."""

    spacing: float = 0.02
    """Distance between points on a face [m]."""

    in_doubt: float = 0.02
    """Most free depth of a place that may be a face [m]."""

    before: float = 0.06
    """How far before a face the contacts over it may stand [m]: both sonars' places differ by their mounts' errors."""

    behind: float = 0.15
    """How far behind it [m]: a face of 60 degrees recedes so much over 26 cm of height."""

    edge_height: float = 0.08
    """How much contacts on a face's edge may stand too high over the top behind it [m]: 6 cm with a range 2 cm wrong,
    since they meet the face at a slant."""

    window_along: float = 0.12
    """How far before or behind a footprint those stand that its face's line goes through [m]."""

    window_height: float = 0.25
    """How far above or below it [m]."""

    deviation: float = 0.015
    """Standard deviation of a footprint from its face [m]."""

    least_slope_deg: float = 40.0
    """Least slope of a face's line [deg]: the imaging sonar sees what is flatter than its slope limit as it is (Eq. 4,
    50 deg for the paper's mount), and the line of a steeper face may come out 10 deg flatter."""

    overhang_deg: float = 15.0
    """Most that a face's line leans forward [deg]: lines of upright faces err by so much. Of a wreck's that leaned 15
    to 25 deg, half lay more than 5 cm off."""

    least_spread: float = 0.02
    """Least standard deviation of the heights that a face's line goes through [m]: at one height it has no slope, and
    stands upright by default."""

    clearance: float = 0.04
    """A ray that runs this deep under contacts has met the object before the face [m]."""

    def __post_init__(self) -> None:
        in_range("Faces.compact", self.compact, 0.0, 10.0)
        in_range("Faces.spacing", self.spacing, 1e-3, 10.0)
        in_range("Faces.in_doubt", self.in_doubt, -10.0, 10.0)
        in_range("Faces.least_slope_deg", self.least_slope_deg, 1.0, 90.0)
        in_range("Faces.overhang_deg", self.overhang_deg, 0.0, 89.0)
        in_range("Faces.least_spread", self.least_spread, 0.0, 10.0)
        in_range("Faces.clearance", self.clearance, 0.0, 10.0)
        for name in ("before", "behind", "edge_height"):
            in_range(f"Faces.{name}", getattr(self, name), 0.0, 10.0)
        for name in ("window_along", "window_height", "deviation"):
            in_range(f"Faces.{name}", getattr(self, name), 1e-3, 10.0)


@dataclass(frozen=True, kw_only=True)
class ReconstructionSettings:
    """Everything that a reconstruction can be told."""

    detection: Detection = field(default_factory=Detection)
    likelihood_field: LikelihoodField = field(default_factory=LikelihoodField)
    mixture: RangeMixture = field(default_factory=RangeMixture)
    free_space: FreeSpace = field(default_factory=FreeSpace)
    faces: Faces = field(default_factory=Faces)

    method: Literal["carved", "paper"] = "carved"
    """``paper``: particles weighed by the PS's field alone, points of the FLS only. ``carved``: elevations also by what
    the FLS proves empty, strays and repeats taken out, and faces that the PS sees added."""

    particles: int = 256
    """Particles per beam of the paper's method. Ours."""

    causal: bool = False
    """Whether rounds bring pings and frames in order of time (online), or all pings first (offline). Online, ``paper``
    weighs each frame once, against the pings of its window before it; ``carved`` weighs at every read all frames so far
    against all pings so far and forgets none, since what a contact leaves in doubt later frames decide. Its last read
    is the same either way."""

    def __post_init__(self) -> None:
        if self.method not in ("carved", "paper"):
            raise ValueError(f"ReconstructionSettings.method: {self.method!r}, must be 'carved' or 'paper'")
        in_range("ReconstructionSettings.particles", self.particles, 1, 1 << 20)
