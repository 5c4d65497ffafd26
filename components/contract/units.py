"""Parse and convert units: products of the names below, in FMI and Modelica spelling.

`rad/s2`, `kg.m2/s`, `1/(T2.s2)`, `mA.m2`: factors with whole-number exponents, joined
by `.`, and at most one `/`, whose denominator is one factor or stands in parentheses. A
unit is its exponents of the SI base units (as FMI 2.0 `BaseUnit` counts them) and a
factor to SI. Signals of our blocks are SI throughout. Units with a factor other than 1
exist for people, and so that connectors of foreign FMUs can be understood and
converted.
"""

from __future__ import annotations

import re
from functools import lru_cache
from math import inf, pi
from typing import NamedTuple


class Unit(NamedTuple):
    """Exponents of kg, m, s, A, K and rad, and the factor and offset to SI."""

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
        """Return the exponents without the radian, as an angle is a number."""
        return (self.kg, self.m, self.s, self.A, self.K)


# names that take a prefix
SI: dict[str, Unit] = {
    "s": Unit(s=1),
    "m": Unit(m=1),
    "g": Unit(kg=1, factor=1e-3),
    "A": Unit(A=1),
    "K": Unit(K=1),
    "rad": Unit(rad=1),
    "Hz": Unit(s=-1),
    "N": Unit(kg=1, m=1, s=-2),
    "Pa": Unit(kg=1, m=-1, s=-2),
    "J": Unit(kg=1, m=2, s=-2),
    "W": Unit(kg=1, m=2, s=-3),
    "C": Unit(s=1, A=1),
    "V": Unit(kg=1, m=2, s=-3, A=-1),
    "Ohm": Unit(kg=1, m=2, s=-3, A=-2),
    "H": Unit(kg=1, m=2, s=-2, A=-2),
    "T": Unit(kg=1, s=-2, A=-1),
    "Wb": Unit(kg=1, m=2, s=-2, A=-1),
}
PREFIXES = {"n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "k": 1e3, "M": 1e6, "G": 1e9}
# names that take no prefix
OTHER: dict[str, Unit] = {
    "kg": Unit(kg=1),
    "%": Unit(factor=0.01),
    "deg": Unit(rad=1, factor=pi / 180),
    "rpm": Unit(rad=1, s=-1, factor=pi / 30),
    "bar": Unit(kg=1, m=-1, s=-2, factor=1e5),
    "min": Unit(s=1, factor=60.0),
    "h": Unit(s=1, factor=3600.0),
    "degC": Unit(K=1, offset=273.15),
}
NAMES = ("1", *SI, *OTHER)

_TOKEN = re.compile(r"([A-Za-z%]+)([+-]?[0-9])?|(1)(?![0-9])|[./()]")
_LONGEST = 60  # characters of an expression


@lru_cache(maxsize=256)
def unit_of(text: str) -> Unit:
    """Parse the unit of an expression; the empty text is 1.

    Raises
    ------
    ValueError
        If the expression is not a unit; the text says why.
    """
    if len(text) > _LONGEST:
        raise ValueError(f"more than {_LONGEST} characters")
    tokens = _tokens(text.strip() or "1")
    try:
        unit, end = _quotient(tokens, 0)
    except ZeroDivisionError:
        unit, end = Unit(factor=0.0), len(tokens)
    if end < len(tokens):
        hint = (
            "; a product below / stands in parentheses"
            if tokens[end] in ("/", ".")
            else ""
        )
        raise ValueError(f"{tokens[end]} is one too many{hint}")
    if not 0.0 < unit.factor < inf:
        raise ValueError("its factor to SI is no number")
    return unit


def times(a: Unit, b: Unit, power: int = 1) -> Unit:
    """Return the unit a b^power."""
    return Unit(
        a.kg + power * b.kg,
        a.m + power * b.m,
        a.s + power * b.s,
        a.A + power * b.A,
        a.K + power * b.K,
        a.rad + power * b.rad,
        a.factor * b.factor**power,
    )


def _tokens(text: str) -> list[str]:
    """Split an expression into its factors and signs."""
    tokens, at = [], 0
    while at < len(text):
        token = _TOKEN.match(text, at)
        if token is None:
            raise ValueError(f"{text[at:]} is no unit; the form is kg.m2/(A.s3)")
        tokens.append(token.group())
        at = token.end()
    return tokens


def _quotient(tokens: list[str], at: int) -> tuple[Unit, int]:
    """Parse a product, or two with / between, from `at` on; return its unit and end."""
    unit, at = _product(tokens, at)
    if at < len(tokens) and tokens[at] == "/":
        below, at = _factor(tokens, at + 1)
        unit = times(unit, below, -1)
    return unit, at


def _product(tokens: list[str], at: int) -> tuple[Unit, int]:
    """Parse factors joined by `.` from `at` on; return their unit and end."""
    unit, at = _factor(tokens, at)
    while at < len(tokens) and tokens[at] == ".":
        other, at = _factor(tokens, at + 1)
        unit = times(unit, other)
    return unit, at


def _factor(tokens: list[str], at: int) -> tuple[Unit, int]:
    """Parse a name with its exponent, or an expression in parentheses, from `at` on.

    Return its unit and the position after it.
    """
    if at == len(tokens):
        raise ValueError("something is missing at its end")
    if tokens[at] == "(":
        unit, at = _quotient(tokens, at + 1)
        if at == len(tokens) or tokens[at] != ")":
            raise ValueError("a parenthesis is not closed")
        return unit, at + 1
    if tokens[at] == "1":
        return Unit(), at + 1
    match = _TOKEN.fullmatch(tokens[at])
    if match is None or match.group(1) is None:
        raise ValueError(f"a name is missing before {tokens[at]}")
    return times(
        Unit(), _unit_of_name(match.group(1)), int(match.group(2) or 1)
    ), at + 1


def _unit_of_name(name: str) -> Unit:
    """Return the unit of a name, with or without a prefix."""
    if name in SI:
        return SI[name]
    if name in OTHER:
        return OTHER[name]
    if name[0] in PREFIXES and name[1:] in SI:
        return times(Unit(factor=PREFIXES[name[0]]), SI[name[1:]])
    raise ValueError(f"{name} is no unit")


def conversion(source: Unit, target: Unit) -> tuple[float, float] | None:
    """Return (factor, offset) with target value = factor * source value + offset.

    None where the dimensions differ. Units are compared by exponents, never by name.
    """
    if source.dimension != target.dimension:
        return None
    if source.factor == target.factor:
        return 1.0, (source.offset - target.offset) / target.factor
    return source.factor / target.factor, (
        source.offset - target.offset
    ) / target.factor
