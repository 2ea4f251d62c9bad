"""Settings as the structs that kernels read."""

from __future__ import annotations

import math

from sonarwarp.settings import ReconstructionSettings
from sonarwarp.sonar import PS
from sonarwarp_kernels import arcs, critical, fronts, inverse, particles, profile, proof, sides
from sonarwarp_kernels.specs import Mixture


def critical_filter(settings: ReconstructionSettings, seabed_level: float) -> critical.CriticalFilter:
    """Detection of critical points; ``seabed_level`` is a flat seabed's echo at the window's end."""
    chosen = critical.CriticalFilter()
    chosen.guard = settings.detection.guard
    chosen.sigma = settings.detection.sigma
    chosen.floor = seabed_level * 10.0 ** (settings.detection.floor_db / 20.0)
    chosen.deviations = settings.detection.deviations
    chosen.memory = settings.detection.memory
    return chosen


def profile_detector(settings: ReconstructionSettings) -> profile.ProfileDetector:
    """Detection of the PS's footprints."""
    chosen = profile.ProfileDetector()
    chosen.relative = 10.0 ** (settings.detection.profile_relative_db / 20.0)
    chosen.clearance = settings.detection.profile_clearance
    chosen.gap = settings.detection.profile_gap
    return chosen


def profile_model(settings: ReconstructionSettings, ps: PS) -> inverse.ProfileModel:
    """Inverse sensor model of a PS."""
    chosen = inverse.ProfileModel()
    chosen.hit = settings.likelihood_field.hit
    chosen.miss = settings.likelihood_field.miss
    chosen.no_return = settings.likelihood_field.no_return
    chosen.half_width = math.radians(ps.beamwidth_deg) / 2
    chosen.half_fan = math.radians(ps.fan_beamwidth_deg) / 2
    chosen.range_deviation = settings.likelihood_field.range_deviation
    chosen.reach = float(ps.range_edge[-1])
    # As printed, every footprint is occupied.
    chosen.compact = math.inf if settings.method == "paper" else settings.faces.compact
    return chosen


def mixture(settings: ReconstructionSettings) -> Mixture:
    """Range likelihood of the FLS."""
    chosen = Mixture()
    for name in (
        "weight_hit",
        "weight_short",
        "weight_random",
        "weight_seabed",
        "deviation",
        "rate_short",
        "rate_seabed",
    ):
        setattr(chosen, name, getattr(settings.mixture, name))
    return chosen


def reading(settings: ReconstructionSettings) -> particles.Reading:
    """How particles read the field."""
    chosen = particles.Reading()
    chosen.low = settings.likelihood_field.low
    chosen.high = settings.likelihood_field.high
    chosen.informed = settings.likelihood_field.informed
    return chosen


def carving(settings: ReconstructionSettings) -> proof.Carving:
    """What a frame proves empty."""
    chosen = proof.Carving()
    chosen.reach = settings.free_space.reach
    chosen.guard = settings.free_space.guard
    chosen.margin = math.radians(settings.free_space.margin_deg)
    return chosen


def arc_model(settings: ReconstructionSettings) -> arcs.ArcModel:
    """How hypotheses on an arc weigh."""
    chosen = arcs.ArcModel()
    chosen.reach = settings.free_space.reach
    chosen.proven = settings.free_space.proven
    chosen.solid = settings.free_space.solid
    chosen.deviation = settings.free_space.deviation
    chosen.odds_power = settings.free_space.odds_power
    chosen.range_deviation = settings.mixture.deviation
    chosen.least_height = settings.free_space.least_height
    chosen.informed = math.radians(settings.free_space.informed_deg)
    chosen.sharpness = settings.free_space.sharpness
    chosen.registration = math.radians(settings.free_space.registration_deg)
    return chosen


def side_model(settings: ReconstructionSettings) -> sides.Sides:
    """Which beams only brush what they meet."""
    chosen = sides.Sides()
    chosen.jump = settings.free_space.side_jump
    chosen.share = settings.free_space.side_share
    return chosen


def front_model(settings: ReconstructionSettings, ps: PS) -> fronts.FrontModel:
    """What counts as a face."""
    chosen = fronts.FrontModel()
    chosen.half_width = math.radians(ps.beamwidth_deg) / 2
    chosen.half_fan = math.radians(ps.fan_beamwidth_deg) / 2
    chosen.reach = settings.free_space.reach
    chosen.least_height = settings.free_space.least_height
    chosen.most_run = 1.0 / math.tan(math.radians(settings.faces.least_slope_deg))
    chosen.least_run = -math.tan(math.radians(settings.faces.overhang_deg))
    for name in (
        "compact",
        "spacing",
        "in_doubt",
        "before",
        "behind",
        "edge_height",
        "window_along",
        "window_height",
        "deviation",
        "least_spread",
        "clearance",
    ):
        setattr(chosen, name, getattr(settings.faces, name))
    return chosen
