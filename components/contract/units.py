"""The closed list of units that may cross a block's boundary.

A unit is a name, its exponents of the SI base units (as FMI 2.0 `BaseUnit` counts them) and a
factor to SI. Signals are SI throughout; the units with a factor other than 1 exist so that
connectors of foreign FMUs can be understood and converted.
"""

from __future__ import annotations

from math import pi
from typing import NamedTuple


class Unit(NamedTuple):
    """Exponents of kg, m, s, A, K, rad and the factor and offset to SI."""

    kg: int = 0
    m: int = 0
    s: int = 0
    A: int = 0
    K: int = 0
    rad: int = 0
    factor: float = 1.0
    offset: float = 0.0

    @property
    def dimension(self) -> tuple[int, ...]:
        """The exponents, without the radian: an angle is a number."""
        return (self.kg, self.m, self.s, self.A, self.K)


UNITS: dict[str, Unit] = {
    "1": Unit(),
    "s": Unit(s=1),
    "1/s": Unit(s=-1),
    "m": Unit(m=1),
    "m2": Unit(m=2),
    "m3/s2": Unit(m=3, s=-2),
    "m/s": Unit(m=1, s=-1),
    "m/s2": Unit(m=1, s=-2),
    "kg": Unit(kg=1),
    "kg/m3": Unit(kg=1, m=-3),
    "kg.m2": Unit(kg=1, m=2),
    "rad": Unit(rad=1),
    "rad/s": Unit(rad=1, s=-1),
    "N": Unit(kg=1, m=1, s=-2),
    "N.m": Unit(kg=1, m=2, s=-2),
    "N.m.s": Unit(kg=1, m=2, s=-1),
    "N/m2": Unit(kg=1, m=-1, s=-2),
    "N.m.s/rad": Unit(kg=1, m=2, s=-1, rad=-1),
    "N.m/s": Unit(kg=1, m=2, s=-3),
    "W": Unit(kg=1, m=2, s=-3),
    "J": Unit(kg=1, m=2, s=-2),
    "A.m2": Unit(m=2, A=1),
    "Ohm": Unit(kg=1, m=2, s=-3, A=-2),
    "A2.m4.s": Unit(m=4, s=1, A=2),
    "T": Unit(kg=1, s=-2, A=-1),
    "T/s": Unit(kg=1, s=-3, A=-1),
    "T/s2": Unit(kg=1, s=-4, A=-1),
    "T.m3": Unit(kg=1, m=3, s=-2, A=-1),
    "1/T": Unit(kg=-1, s=2, A=1),
    "1/T2": Unit(kg=-2, s=4, A=2),
    "1/(T2.s)": Unit(kg=-2, s=3, A=2),
    "1/(T2.s2)": Unit(kg=-2, s=2, A=2),
    "A.m2.s": Unit(m=2, s=1, A=1),
    "A.m2.s/T": Unit(kg=-1, m=2, s=3, A=2),
    "N.m.s/T2": Unit(kg=-1, m=2, s=3, A=2),
    "A.m2/T": Unit(kg=-1, m=2, s=2, A=2),
    "deg": Unit(rad=1, factor=pi / 180),
    "deg/s": Unit(rad=1, s=-1, factor=pi / 180),
    "rpm": Unit(rad=1, s=-1, factor=pi / 30),
    "uT": Unit(kg=1, s=-2, A=-1, factor=1e-6),
    "nT": Unit(kg=1, s=-2, A=-1, factor=1e-9),
    "uN.m": Unit(kg=1, m=2, s=-2, factor=1e-6),
    "mN.m": Unit(kg=1, m=2, s=-2, factor=1e-3),
    "mN.m.s": Unit(kg=1, m=2, s=-1, factor=1e-3),
    "km": Unit(m=1, factor=1e3),
    "km/s": Unit(m=1, s=-1, factor=1e3),
}


def conversion(source: Unit, target: Unit) -> tuple[float, float] | None:
    """Return (factor, offset) with target value = factor * source value + offset.

    None where the dimensions differ. Units are compared by exponents, never by name.
    """
    if source.dimension != target.dimension:
        return None
    if source.factor == target.factor:
        return 1.0, (source.offset - target.offset) / target.factor
    return source.factor / target.factor, (source.offset - target.offset) / target.factor
