"""Compute dipole, resistance, power and mass of coils and rods of magnetic torquers.

A coil of N turns around an area A has the dipole m = N I A. Around a core of radius r,
length l and relative permeability mu the dipole grows to

    m = pi r^2 N I [1 + (mu - 1) / (1 + (mu - 1) N_d)],
    N_d = 4 (ln(l / r) - 1) / ((l / r)^2 - 4 ln(l / r)),

with N_d the demagnetising factor of a long cylinder (Mehrjardi & Mirshams, "Design and
Manufacturing of a Research Magnetic Torquer Rod", Contemporary Engineering Sciences 3
(2010) 227). The wire is of copper: 1.72e-8 Ohm m at 20 deg C, 8960 kg/m3.
"""

from __future__ import annotations

from math import log, pi
from typing import NamedTuple

# resistivity (Ohm m) at 20 deg C, density (kg/m3)
COPPER, COPPER_DENSITY = 1.72e-8, 8960.0
CORE_DENSITY = 8200.0  # kg/m3, of an alloy of nickel and iron
SATURATION = 2.1  # T, of iron, at most; alloys with nickel are saturated from 0.8 T on
MU_0 = 4e-7 * pi  # T m/A


class Coil(NamedTuple):
    """Properties of a coil at its current."""

    dipole: float  # A m2, at its current
    area_turns: float  # m2, dipole per ampere, core included
    resistance: float  # Ohm
    power: float  # W, at its current
    mass: float  # kg, wire and core


def air(turns: float, a: float, b: float, wire: float, current: float) -> Coil:
    """Compute a coil without a core, of turns around a x b (m), at a current (A).

    `wire` is the diameter of the wire (m).
    """
    return _coil(turns, turns * a * b, 2.0 * turns * (a + b), wire, current, 0.0)


def core_factor(length: float, radius: float, permeability: float) -> float:
    """Compute the factor by which a core multiplies the dipole of its winding.

    Length and radius of the core in m.
    """
    slender = length / radius
    demagnetising = (
        4.0 * (log(slender) - 1.0) / (slender * slender - 4.0 * log(slender))
    )
    return 1.0 + (permeability - 1.0) / (1.0 + (permeability - 1.0) * demagnetising)


def rod(
    turns: float,
    length: float,
    radius: float,
    permeability: float,
    wire: float,
    current: float,
) -> Coil:
    """Compute a winding of turns around a rod of this length and radius (m).

    `wire` is the diameter of the wire (m), `current` in A.
    """
    section = pi * radius * radius
    area = turns * section * core_factor(length, radius, permeability)
    core = section * length * CORE_DENSITY
    return _coil(turns, area, 2.0 * pi * radius * turns, wire, current, core)


def core_limit(length: float, radius: float) -> float:
    """Compute the largest dipole (A m2) of a core of this length and radius (m).

    It is that of saturated iron, SATURATION / mu_0 times its volume.
    """
    return SATURATION / MU_0 * pi * radius * radius * length


def _coil(
    turns: float,
    area_turns: float,
    length: float,
    wire: float,
    current: float,
    core: float,
) -> Coil:
    """Compute the properties of a winding of a wire of this length (m).

    `area_turns` in m2, diameter `wire` in m, current in A, mass of the core in kg.
    """
    section = pi * wire * wire / 4.0
    resistance = COPPER * length / section
    return Coil(
        current * area_turns,
        area_turns,
        resistance,
        resistance * current * current,
        length * section * COPPER_DENSITY + core,
    )
