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
    """Noise on the echo amplitudes of both sonars, independent between sonars, frames, beams and bins."""

    speckle: bool = True
    """Rayleigh speckle of unit mean on every bin."""

    background_db: float | None = -25.0
    """Mean of the additive Rayleigh background over the flat seabed's echo, at r_emin for the FLS and on the axis of a
    head in mid-sector for the PS [dB]; None for none. Ours."""

    def __post_init__(self) -> None:
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

    profile_relative_db: float = -26.0
    """Least return of a ping over its strongest, both corrected for spreading [dB]. Ours."""

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

    hit: float = 2.0
    """Log-odds that a ping adds on a footprint's ridge. Ours."""

    miss: float = -2.0
    """Log-odds that a ping adds in front of its first footprint. Ours: a cell is passed once or twice per sweep."""

    no_return: float = 0.0
    """Log-odds that a ping without any footprint adds. Ours: a weak echo missed must not pierce a surface."""

    range_deviation: float = 0.02
    """Standard deviation of a ridge along range [m]. Ours: two bins of 1 cm."""

    low: float = -4.0
    """Lower clamp of log-odds when read. Ours."""

    high: float = 6.0
    """Upper clamp of log-odds when read. Ours."""

    informed: float = 0.5
    """Least log-odds at the most likely particle for a point that the field informs. Ours."""

    window_sweeps: float = 3.0
    """Sweeps of the PS that the field remembers, k of Eq. 21. Ours."""

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
class ReconstructionSettings:
    """Everything that a reconstruction can be told."""

    detection: Detection = field(default_factory=Detection)
    likelihood_field: LikelihoodField = field(default_factory=LikelihoodField)
    mixture: RangeMixture = field(default_factory=RangeMixture)

    particles: int = 256
    """Hypotheses per beam. Ours."""

    causal: bool = True
    """Whether a frame is weighed against the pings before it only (online), or against all of them (offline)."""

    def __post_init__(self) -> None:
        in_range("ReconstructionSettings.particles", self.particles, 1, 1 << 20)
