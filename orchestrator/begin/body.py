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

Sides = tuple[float, float, float]


@dataclass(frozen=True)
class NewBody(Body):
    """Body of a new craft, with the origin of each figure."""

    inertia: Sides  # kg m2, principal moments
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
    inertia = None if facts.inertia is None else _moments(facts.inertia)
    mass = None if facts.mass is None else MASS(facts.mass)
    sides, sides_from, shape, units = _given_sides(facts)
    mass_from = "given"
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
    inertia_from = "given"
    if inertia is None:
        inertia = homogeneous_inertia(mass, sides)
        inertia_from = f"a homogeneous body of {mass:.4g} kg, {shape}"
    body = NewBody(mass, sides, inertia, mass_from, sides_from, inertia_from, shape)
    for line in contradictions(body, inertia):
        raise DesatError(f"{_options(facts)}: {line}")
    return body


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


def _moments(text: str) -> Sides:
    """Parse principal moments (kg m2), or raise DesatError if no body has them."""
    values = INERTIA.many(text)
    if len(values) != 3:
        raise DesatError(f"--inertia {text}: three moments are needed, as 0.2,0.2,0.1")
    if max(values) > sum(values) - max(values):
        raise DesatError(
            f"--inertia {text}: no body has these moments: each is above 0, and none is more than "
            "the two others together"
        )
    a, b, c = values
    return a, b, c
