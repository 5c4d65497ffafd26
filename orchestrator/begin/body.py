"""Compute the body of a new craft: mass, sides and moments of inertia.

Values that are not given follow from those that are: sides from the mass and the class
density, the mass from the sides and that density (for a CubeSat from its units), both
from the moments of inertia alone.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import prod

from ..system.body import DENSITY, Body, contradictions, homogeneous_inertia
from ..system.errors import DesatError
from ..system.quantity import Quantity
from .facts import CraftFacts
from .spread import class_factor, combine_factors, parse_values
from .surfaces import Part, Sides, parts_of

UNIT_MASS = 1.5  # kg, of one unit of a CubeSat
CUBESATS = {
    1: (0.1, 0.1, 0.1135),
    2: (0.1, 0.1, 0.227),
    3: (0.1, 0.1, 0.3405),
    6: (0.1, 0.2263, 0.366),
    8: (0.2263, 0.2263, 0.227),
    12: (0.2263, 0.2263, 0.366),
    16: (0.2263, 0.2263, 0.454),
    27: (0.34, 0.34, 0.366),
}  #: Sides (m) by units: CubeSat Design Specification, and deployers of larger ones.
MASS = Quantity("--mass", "kg", 0.0, 1e6, above=True, bare=False)
BOX = Quantity("--box", "m", 0.0, 100.0, above=True, noun="sides")
INERTIA = Quantity("--inertia", "kg.m2", 0.0, 1e9, above=True, noun="moments")


@dataclass(frozen=True)
class NewBody(Body):
    """Body of a new craft, with the origin of each figure."""

    inertia: Sides  # kg m2, principal moments
    spread: float  # of the inertia as a factor, 90 %; 1: it is known
    parts: tuple[Part, ...]  # wings and dish, which are in mass and inertia
    mass_from: str
    sides_from: str
    inertia_from: str
    shape: str  # as text: "a 12U"


def body_of(facts: CraftFacts) -> NewBody:
    """Return the body of a new craft.

    Raises
    ------
    DesatError
        If sides, mass and moments of inertia contradict each other or no craft can have
        them.
    """
    inertia, spread = None, 1.0
    if facts.inertia is not None:
        inertia, spread = _moments(facts.inertia)
    mass, mass_from, mass_spread = _given_mass(facts)
    sides, sides_from, shape, units = _given_sides(facts)
    if mass is None and sides is None and inertia is not None:
        # a cube of side s has m s^2 / 6 about each axis, and m = density s^3
        side = (6.0 * sum(inertia) / 3.0 / DENSITY) ** 0.2
        mass, mass_from = DENSITY * side**3, f"class: {DENSITY:g} kg/m3, by the inertia"
        sides = (side, side, side)
        sides_from = f"class: a cube of {DENSITY:g} kg/m3 with this inertia"
    elif mass is None and sides is None:
        units, shape, sides_from = 6, "a 6U", "class: a 6U"
        sides = CUBESATS[units]
    elif mass is not None and sides is None:
        side = (mass / DENSITY) ** (1.0 / 3.0)
        sides, sides_from = (side, side, side), f"class: a cube of {DENSITY:g} kg/m3"
    assert sides is not None
    if mass is None:
        mass = UNIT_MASS * units if units else DENSITY * prod(sides)
        per = f"{UNIT_MASS:g} kg a unit" if units else f"{DENSITY:g} kg/m3"
        mass_from = f"class: {per}"
    shape = shape or "a box of " + " x ".join(f"{x:.4g}" for x in sides) + " m"
    parts, inertia_from = parts_of(facts, sides, mass), "given"
    if inertia is None:
        inertia, inertia_from = _inertia(mass, sides, shape, parts)
        spread = combine_factors(class_factor("inertia"), mass_spread)
    body = NewBody(
        mass,
        sides,
        inertia,
        spread,
        parts,
        mass_from,
        sides_from,
        inertia_from,
        shape,
    )
    for line in contradictions(body, inertia):
        raise DesatError(f"{_options(facts)}: {line}")
    return body


def _given_mass(facts: CraftFacts) -> tuple[float | None, str, float]:
    """Return the given mass (kg), its origin, and its spread as a factor."""
    if facts.mass is None:
        return None, "", 1.0
    mass = parse_values(MASS, facts.mass)
    if len(mass.values) > 1:
        raise DesatError(f"--mass {facts.mass}: one mass is needed")
    return mass.values[0], ", ".join(filter(None, ("given", mass.text))), mass.share


def _inertia(
    mass: float, sides: Sides, shape: str, parts: tuple[Part, ...]
) -> tuple[Sides, str]:
    """Return the moments (kg m2) of a homogeneous body with wings and dish."""
    rest = mass - sum(part.mass for part in parts)
    a, b, c = homogeneous_inertia(rest, sides)
    for part in parts:
        x, y, z = part.inertia
        a, b, c = a + x, b + y, c + z
    text = f"a homogeneous body of {rest:.4g} kg, {shape}"
    return (a, b, c), text + (", with wings and dish" if parts else "")


def _options(facts: CraftFacts) -> str:
    """Return the options that define the body, for messages."""
    options = {
        "--size": facts.size,
        "--box": facts.box,
        "--mass": facts.mass,
        "--inertia": facts.inertia,
    }
    return " ".join(
        f"{name} {value}" for name, value in options.items() if value is not None
    )


def _given_sides(facts: CraftFacts) -> tuple[Sides | None, str, str, int]:
    """Return the given sides (m), their origin, the shape and a CubeSat's units.

    The sides are None where none are given.
    """
    if facts.box is not None:
        if facts.size is not None:
            raise DesatError(
                f"--box {facts.box}: --size {facts.size} gives the sides as well: use one of them"
            )
        if len(facts.box.split(",")) != 3:
            raise DesatError(
                f"--box {facts.box}: three sides are needed, as 0.5,0.5,0.8 in m"
            )
        a, b, c = BOX.many(facts.box)
        return (a, b, c), "given", f"a box of {a:g} x {b:g} x {c:g} m", 0
    if facts.size is None:
        return None, "", "", 0
    text = facts.size.strip()
    match = re.fullmatch(r"(\d+)[uU]", text)
    if match is None or int(match[1]) not in CUBESATS:
        size_names = ", ".join(f"{n}U" for n in CUBESATS)
        raise DesatError(f"--size {text}: there is {size_names}; --box has any other")
    return (
        CUBESATS[int(match[1])],
        f"given: {text.upper()}",
        f"a {text.upper()}",
        int(match[1]),
    )


def _moments(text: str) -> tuple[Sides, float]:
    """Parse principal moments (kg m2) and their spread as a factor.

    Raises DesatError if no body has them.
    """
    moments = parse_values(INERTIA, text)
    values = moments.values
    if len(values) != 3:
        raise DesatError(f"--inertia {text}: three moments are needed, as 0.2,0.2,0.1")
    if max(values) > sum(values) - max(values):
        raise DesatError(
            f"--inertia {text}: no body has these moments: each is above 0, and none is more than "
            "the two others together"
        )
    a, b, c = values
    return (a, b, c), moments.share
