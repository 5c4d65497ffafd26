"""Parse torquers given by their construction: coils and rods by turns or dipole."""

from __future__ import annotations

import re
from collections.abc import Callable
from math import inf, pi

from desat.components.physics import coil

from ..system.errors import DesatError
from ..system.quantity import Quantity

FORMS = (
    "'coil TURNS 80x80mm WIRE CURRENT', as 'coil 300 80x80mm 0.2mm 100mA'",
    "'rod TURNS 60x8mm WIRE CURRENT', as 'rod 800 60x8mm 0.2mm 100mA'",
)
TURNS = Quantity("--rods", "1", 1.0, 1e6, noun="turns")
DIPOLE = Quantity("--rods", "A.m2", 0.0, 1e5, above=True)
LENGTH = Quantity("--rods", "m", 1e-6, 100.0)
CURRENT = Quantity("--rods", "A", 1e-6, 1e3)
MOST_DENSITY = 30.0  # A/mm2: upper limit; copper in vacuum carries about 5
# of a core: so high that the ratio of length to diameter decides, not this
PERMEABILITY = 20_000.0


def is_made(text: str) -> bool:
    """Return whether a text describes a construction."""
    return text.split()[0:1] in (["coil"], ["rod"])


def design_coil(
    text: str, most_mass: float = inf, longest: float = inf
) -> tuple[coil.Coil, str]:
    """Return the coil that a text describes, and its construction as text.

    TURNS may be a dipole (0.2Am2): then the number of turns follows from it.

    Raises
    ------
    DesatError
        If the text has another form, the current melts the wire, its core does not hold
        the dipole, or the coil is heavier than `most_mass` (kg) or longer than `longest`
        (m).
    """
    words = text.split()
    size = (
        re.fullmatch(r"([\d.]+)x([\d.]+)(m|cm|mm)", words[2])
        if len(words) == 5
        else None
    )
    if size is None:
        raise DesatError(f"--rods {text}: the form is {' or '.join(FORMS)}")
    a, b = (LENGTH(f"{size[k]} {size[3]}") for k in (1, 2))
    if max(a, b) > longest:
        raise DesatError(
            f"--rods {text}: {max(a, b):.3g} m do not fit a craft of {longest:.3g} m"
        )
    wire, current = LENGTH(words[3]), CURRENT(words[4])
    build: Callable[[float], coil.Coil]
    if words[0] == "coil":

        def build(turns: float) -> coil.Coil:
            return coil.air(turns, a, b, wire, current)
    else:
        if a < 4.0 * b:
            raise DesatError(
                f"--rods {text}: a rod is at least four times as long as it is thick; "
                f"got {size[0]}"
            )

        def build(turns: float) -> coil.Coil:
            return coil.rod(turns, a, b / 2.0, PERMEABILITY, wire, current)

    density = 1e-6 * current / (pi * wire * wire / 4.0)
    if density > MOST_DENSITY:
        raise DesatError(
            f"--rods {text}: {density:.3g} A/mm2 in the wire; up to {MOST_DENSITY:g} are possible, "
            f"{1e9 * MOST_DENSITY * pi * wire * wire / 4.0:.3g} mA in {words[3]}"
        )
    turns = (
        TURNS(words[1])
        if re.fullmatch(r"[\d.]+", words[1])
        else _turns(words[1], build)
    )
    design = build(turns)
    if words[0] == "rod" and design.dipole > (most := coil.core_limit(a, b / 2.0)):
        raise DesatError(
            f"--rods {text}: {design.dipole:.3g} A m2; a core of {size[0]} is saturated at "
            f"{most:.2g} A m2"
        )
    if design.mass > most_mass:
        raise DesatError(
            f"--rods {text}: {turns:.3g} turns of {design.mass:.3g} kg; {most_mass:.3g} kg each is "
            "a tenth of the craft: take a larger current"
        )
    return design, (
        f"{words[0]} of {turns:.0f} turns, {words[2]}, wire of {words[3]}, {words[4]}: "
        f"{design.power:.3g} W, {1e3 * design.mass:.3g} g each"
    )


def _turns(dipole: str, build: Callable[[float], coil.Coil]) -> float:
    """Return the number of turns for a dipole.

    Raises DesatError if one turn gives more.
    """
    goal, one = DIPOLE(dipole), build(1.0).dipole
    if goal < one:
        raise DesatError(
            f"--rods {dipole}: one turn gives {one:.3g} A m2: a smaller current or "
            "area is needed"
        )
    return float(-(-goal // one))
