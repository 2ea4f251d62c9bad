"""Characteristic acoustic impedances [rayl = kg/(m2 s)]: density [kg/m3] times compressional sound speed [m/s].

Sediments and rock: Jensen, Kuperman, Porter and Schmidt, Computational Ocean Acoustics, table 1.3.
Solids: Kinsler, Frey, Coppens and Sanders, Fundamentals of Acoustics, table of properties of solids (bulk speeds).
Plastics and titanium: Selfridge, Approximate material properties in isotropic materials, IEEE Transactions on Sonics
and Ultrasonics 32 (1985) 381-394.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

WATER = 1000.0 * 1500.0
SAND = 1900.0 * 1650.0
ROCK = 2700.0 * 5250.0  # basalt
CONCRETE = 2600.0 * 3100.0
STEEL = 7700.0 * 6100.0


@dataclass(frozen=True, kw_only=True)
class Material:
    """What a face may be made of."""

    name: str
    """Name in reports."""

    density: float
    """[kg/m3]."""

    sound_speed: float
    """Of compressional waves [m/s]."""

    source: str
    """Where both numbers are printed."""

    words: tuple[str, ...]
    """Words that name it in a file, in lower case."""

    @property
    def impedance(self) -> float:
        """Characteristic acoustic impedance [rayl]."""
        return self.density * self.sound_speed


def _table(source: str, *rows: tuple[str, float, float, tuple[str, ...]]) -> tuple[Material, ...]:
    return tuple(
        Material(name=name, density=density, sound_speed=speed, source=source, words=(name, *words))
        for name, density, speed, words in rows
    )


MATERIALS = (
    *_table(
        "Jensen et al., Computational Ocean Acoustics, table 1.3",
        ("clay", 1500.0, 1500.0, ("mud", "muddy")),
        ("silt", 1700.0, 1575.0, ("silty",)),
        ("sand", 1900.0, 1650.0, ("sandy",)),
        ("gravel", 2000.0, 1800.0, ("pebble", "pebbles", "shingle")),
        ("moraine", 2100.0, 1950.0, ("till",)),
        ("chalk", 2200.0, 2400.0, ()),
        ("limestone", 2400.0, 3000.0, ()),
        ("rock", 2700.0, 5250.0, ("basalt", "rocks", "rocky", "stone", "stones", "boulder", "boulders")),
    ),
    *_table(
        "Kinsler et al., Fundamentals of Acoustics, table of properties of solids",
        ("concrete", 2600.0, 3100.0, ("cement", "brick", "bricks")),
        ("steel", 7700.0, 6100.0, ()),
        ("iron", 7700.0, 4350.0, ()),
        ("aluminium", 2700.0, 6300.0, ("aluminum",)),
        ("brass", 8500.0, 4700.0, ()),
        ("copper", 8900.0, 5000.0, ()),
        ("nickel", 8800.0, 5850.0, ()),
        ("glass", 2300.0, 5600.0, ()),
        ("acrylic", 1200.0, 2650.0, ("lucite", "perspex", "plexiglas", "plexiglass")),
        ("wood", 720.0, 4000.0, ("oak", "timber", "wooden", "plank", "planks")),
        ("pine", 450.0, 3500.0, ()),
        ("rubber", 1100.0, 2400.0, ("tyre", "tyres", "tire", "tires")),
        ("cork", 240.0, 500.0, ()),
        ("ice", 920.0, 3200.0, ()),
    ),
    *_table(
        "Selfridge, IEEE Transactions on Sonics and Ultrasonics 32 (1985) 381-394",
        ("pvc", 1380.0, 2380.0, ()),
        ("nylon", 1120.0, 2600.0, ()),
        ("titanium", 4480.0, 6100.0, ()),
    ),
)
"""Materials that names in files are looked up in; wood is oak along the grain, rubber the hard kind."""

_BY_WORD = {word: material for material in MATERIALS for word in material.words}

# A word ends at whatever is no letter, and before a capital: RustySteel_01 is rusty and steel.
_WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")


def material_in(name: str) -> Material | None:
    """The material that a name mentions, in whatever case, or None.

    Whole words count: ``RustySteel_01`` is steel, ``sandstone`` is not sand. The last one wins, as in English.
    """
    for word in reversed(_WORD.findall(name)):
        if word.lower() in _BY_WORD:
            return _BY_WORD[word.lower()]
    return None
