"""Settings: every field out of its bounds is refused by name."""

import re
from dataclasses import fields

import pytest

import sonarwarp as sw

WRONG = [
    (lambda: sw.Noise(background_db=float("nan")), r"Noise\.background_db: nan is outside"),
    (lambda: sw.Detection(edge="farthest"), r"Detection\.edge: 'farthest', must be 'nearest' or 'strongest'"),  # pyright: ignore[reportArgumentType]
    (lambda: sw.Detection(guard=-1), r"Detection\.guard: -1 is outside \[0, 1000\]"),
    (lambda: sw.Detection(memory=0.5), r"Detection\.memory: 0\.5 is outside"),
    (lambda: sw.LikelihoodField(cell=0.0), r"LikelihoodField\.cell: 0 is outside"),
    (lambda: sw.LikelihoodField(miss=1.0), r"LikelihoodField\.miss: 1 is outside \[-100, 0\]"),
    (lambda: sw.LikelihoodField(informed=9.0), r"LikelihoodField\.informed: 9 is outside \[0, 8\]"),
    (lambda: sw.FreeSpace(hit_spacing=9e-4), r"FreeSpace\.hit_spacing: 0\.0009 is outside \[0\.001, 10\]"),
    (lambda: sw.FreeSpace(hit_spacing=-0.01), r"FreeSpace\.hit_spacing: -0\.01 is outside \[0\.001, 10\]"),
    (lambda: sw.FreeSpace(hit_spacing=float("nan")), r"FreeSpace\.hit_spacing: nan is outside"),
    (lambda: sw.RangeMixture(weight_hit=0.5), r"RangeMixture weights: sum to 0\.6, must sum to 1"),
    (lambda: sw.RangeMixture(deviation=0.0), r"RangeMixture\.deviation: 0 is outside"),
    (lambda: sw.ReconstructionSettings(particles=0), r"ReconstructionSettings\.particles: 0 is outside"),
]


@pytest.mark.parametrize(("build", "message"), WRONG)
def test_wrong_fields_are_refused_by_name(build, message):
    with pytest.raises(ValueError, match=message):
        build()


KINDS = (
    *(sw.Noise, sw.Detection, sw.LikelihoodField, sw.RangeMixture, sw.ReconstructionSettings),
    *(sw.FLS, sw.PS, sw.Mount),
)
NUMBERS = [
    (kind, field.name)
    for kind in KINDS
    for field in fields(kind)
    if isinstance(field.default, int | float) and not isinstance(field.default, bool)
]


@pytest.mark.parametrize(("kind", "name"), NUMBERS, ids=lambda part: getattr(part, "__name__", part))
@pytest.mark.parametrize("wrong", [float("nan"), 1e12, -1e12])
def test_no_number_may_be_anything(kind, name, wrong):
    with pytest.raises(ValueError, match=re.escape(f"{kind.__name__}.{name}: {wrong:g} is outside")):
        kind(**{name: wrong})


def test_defaults_are_within_their_bounds():
    settings = sw.ReconstructionSettings()
    weights = [getattr(settings.mixture, f"weight_{part}") for part in ("hit", "short", "random", "seabed")]
    assert sum(weights) == pytest.approx(1.0)
    assert not settings.causal
