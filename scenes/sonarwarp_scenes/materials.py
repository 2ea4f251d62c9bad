"""Characteristic acoustic impedances [rayl = kg/(m2 s)]: density [kg/m3] times compressional sound speed [m/s].

Sediments and rock: Jensen, Kuperman, Porter and Schmidt, Computational Ocean Acoustics, table 1.3.
Solids: Kinsler, Frey, Coppens and Sanders, Fundamentals of Acoustics, table of properties of solids (bulk speeds).
"""

WATER = 1000.0 * 1500.0
SAND = 1900.0 * 1650.0
ROCK = 2700.0 * 5250.0  # basalt
CONCRETE = 2600.0 * 3100.0
STEEL = 7700.0 * 6100.0
