"""Compute the surfaces of a new craft: the faces of its body, its wings and its dish.

Light and air act on plates as each is turned to Sun and wind (`spacecraft_rigid`): the
six faces of the box, each wing as one plate that its drive turns to the Sun or as two
sides that are fixed, and both sides of a dish. No part shades another. All centres are
off by the offset of the centre of pressure from the centre of mass.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from desat.components.maths.vector import norm
from desat.components.physics import torques

from ..files.hardware import classes, quantity
from ..system.errors import DesatError
from ..system.quantity import Quantity
from .facts import CraftFacts
from .spread import SpreadValues, parse_values

Array = NDArray[np.float64]
Sides = tuple[float, float, float]  # along x, y, z of the body
Shine = tuple[float, float]  # specular and diffuse share of the light that is reflected
AXES = "xyz"
FORM = (
    "the form is AREA ARM [AXIS] [fixed SIDE] [MASS] [REFLECTED], as 13m2 3.2m +y, or of "
    "a pair 2 x 13m2 3.2m y fixed +z 3kg/m2 0.2/0.03"
)  #: Of a wing, for messages.
OFFSET = 0.05  # of each side: offset of the centre of pressure, where it is not given
CP = Quantity("--cp", "m", -100.0, 100.0)
DIAMETER = Quantity("--dish", "m", 0.0, 100.0, above=True)
# Directions from which light or air may come: faces, edges and corners of a cube.
AROUND = [
    tuple((np.array(x) / np.linalg.norm(x)).tolist())
    for x in product((-1.0, 0.0, 1.0), repeat=3)
    if any(x)
]


class Plate(NamedTuple):
    """A plate of `spacecraft_rigid`."""

    normal: tuple[float, float, float]
    area: float  # m2
    centre: tuple[float, float, float]  # m, body
    shine: Shine
    drive: tuple[float, float, float] = (0.0, 0.0, 0.0)  # axis; 0: it is fixed


@dataclass(frozen=True)
class Part:
    """A wing or a dish."""

    name: str
    plates: tuple[Plate, ...]
    mass: float  # kg
    inertia: tuple[float, float, float]  # kg m2, about the craft's centre of mass
    origin: str

    @property
    def area(self) -> float:
        """Return the area of one side (m2)."""
        return self.plates[0].area

    @property
    def arm(self) -> float:
        """Return the distance of its centre (m)."""
        return norm(self.plates[0].centre)


@dataclass(frozen=True)
class Surfaces:
    """Surfaces of a new craft."""

    faces: tuple[Plate, ...]  # of the body; none where its torques are given
    parts: tuple[Part, ...]
    offset: tuple[float, float, float]  # m: centre of pressure from the centre of mass
    offset_from: str
    offset_given: SpreadValues | None

    @property
    def plates(self) -> tuple[Plate, ...]:
        """Return all plates."""
        return (*self.faces, *(plate for part in self.parts for plate in part.plates))

    @property
    def driven(self) -> bool:
        """Return whether a plate has a drive."""
        return any(any(plate.drive) for plate in self.plates)

    @property
    def table(self) -> list[list[float]]:
        """Return the rows of the parameter `plates`."""
        return [[*p.normal, p.area, *p.centre, *p.shine] for p in self.plates]

    def light(self, suns: Sequence[Sequence[float]]) -> float:
        """Return the largest torque of light at 1 astronomical unit (N m).

        The directions of the Sun are unit vectors, body.
        """
        rows, drives = self._plates
        each = [tuple(map(float, sun)) for sun in suns]
        return max(
            norm(
                torques.radiation_on_plates(
                    (x, y, z),
                    torques.SOLAR_PRESSURE,
                    torques.facing(rows, drives, (x, y, z)),
                )
            )
            for x, y, z in each
        )

    @property
    def lever(self) -> float:
        """Return the largest area times lever (m3) that the wind meets."""
        rows, drives = self._plates
        return max(
            norm(torques.drag_on_plates((x, y, z), 2.0, 1.0, rows, drives))
            for x, y, z in AROUND
        )

    @property
    def _plates(self) -> tuple[torques.Plates, tuple[tuple[float, float, float], ...]]:
        """Return plates and drives as the functions of torques take them."""
        flat = tuple(x for row in self.table for x in row)
        return torques.plates_of(flat, self.offset), tuple(p.drive for p in self.plates)


def parts_of(facts: CraftFacts, sides: Sides, mass: float) -> tuple[Part, ...]:
    """Return wings and dish of a new craft of a mass (kg).

    Raises
    ------
    DesatError
        If one is impossible, or they weigh more than half of the craft.
    """
    parts = [
        part
        for text in facts.wings or ()
        for part in _wings("--wings", text, sides, inside=False)
    ]
    if facts.panel is not None:
        parts += _panel(facts.panel, sides)
    if facts.dish is not None:
        parts.append(_dish(facts.dish, sides))
    weight = sum(part.mass for part in parts)
    if weight > 0.5 * mass:
        raise DesatError(
            f"--wings: wings and dish weigh {weight:.4g} kg of {mass:.4g} kg "
            f"({', '.join(part.name for part in parts)}): give their mass, as 2kg/m2"
        )
    if (count := 6 + sum(len(part.plates) for part in parts)) > 16:
        raise DesatError(f"--wings: {count} surfaces with the body; 16 are taken")
    return tuple(parts)


def surfaces_of(
    facts: CraftFacts, sides: Sides, parts: tuple[Part, ...], has_body: bool
) -> Surfaces:
    """Return the surfaces of a new craft; without `has_body` those of its parts alone.

    Raises
    ------
    DesatError
        If the centre of pressure lies outside the body.
    """
    shine = _shine("body")
    faces = []
    for k, side in enumerate(sides):
        area = math.prod(sides) / side
        for sign in (1.0, -1.0):
            normal = _unit(k, sign)
            faces.append(Plate(normal, area, _times(0.5 * side, normal), shine))
    return Surfaces(tuple(faces) if has_body else (), parts, *_offset(facts, sides))


def _offset(facts: CraftFacts, sides: Sides) -> tuple[Sides, str, SpreadValues | None]:
    """Return the offset of the centre of pressure (m), its origin, and what was typed."""
    a, b, c = sides
    if facts.cp is None:
        offset = OFFSET * a, OFFSET * b, OFFSET * c
        return offset, f"class: {100.0 * OFFSET:g} % of each side", None
    cp = parse_values(CP, facts.cp)
    if len(cp.values) not in (1, 3):
        raise DesatError(
            f"--cp {facts.cp}: one offset, of unknown direction, or three are "
            "needed, as 2cm,0cm,1cm"
        )
    if len(cp.values) == 3:
        offset, origin = (cp.values[0], cp.values[1], cp.values[2]), "given"
    else:
        x = cp.values[0] / math.sqrt(3.0)
        offset, origin = (x, x, x), "given; its direction is assumed"
    if any(abs(x) > 0.5 * side for x, side in zip(offset, sides, strict=True)):
        raise DesatError(
            f"--cp {facts.cp}: it lies outside the body of {a:.4g} x {b:.4g} x {c:.4g} m"
        )
    return offset, origin, cp


@dataclass(frozen=True)
class _WingWords:
    """What follows area and arm of a wing."""

    axis: str = ""  # such as y or +y
    side: str = ""  # that it is fixed to, such as +z; "": it is turned to the Sun
    density: float | None = None  # kg/m2
    shine: Shine | None = None


def _wings(option: str, text: str, sides: Sides, inside: bool) -> Iterator[Part]:
    """Yield the wings of a text, one or a pair; `inside` the body only where allowed."""
    pair = re.match(r"\s*2\s*x\s+", text)
    words = text[pair.end() :].split() if pair else text.split()
    if len(words) < 2:
        raise DesatError(f"{option} {text}: {FORM}")
    area = Quantity(option, "m2", 0.0, 1e4, above=True, bare=False)(words[0])
    arms = Quantity(option, "m", -100.0, 100.0).many(words[1])
    more = _read_words(option, text, words[2:])
    axis, density = more.axis or ("y" if pair else "-y"), more.density
    origin = "given"
    if density is None:
        density = quantity("", classes()["surfaces"]["wings"]["mass"], "kg")
        origin = f"given; class: {density:g} kg/m2"
    k = AXES.index(axis[-1])
    signs = (1.0, -1.0) if pair else (-1.0 if axis[0] == "-" else 1.0,)
    if pair and len(axis) == 2:
        raise DesatError(f"{option} {text}: a pair has both sides: {axis[-1]}")
    if len(arms) != 1 and not (pair and len(arms) == 3):
        raise DesatError(
            f"{option} {text}: one arm is needed; a pair may have three, as 0,1.8,-0.6m"
        )
    arm = abs(arms[k] if len(arms) == 3 else arms[0])
    if not inside:
        _check_outside(f"{option} {text}", arm, sides, k)
    shine = more.shine or _shine("wings")
    for sign in signs:
        centre = list(arms if len(arms) == 3 else (0.0, 0.0, 0.0))
        centre[k] = sign * arm
        x, y, z = centre
        name = f"wing on {'+' if sign > 0.0 else '-'}{AXES[k]}"
        yield _wing(name, area, (x, y, z), k, more.side, density, shine, sides, origin)


def _read_words(option: str, text: str, words: Sequence[str]) -> _WingWords:
    """Read what follows area and arm of a wing, in any order."""
    words_read = _WingWords()
    rest = iter(words)
    for word in rest:
        if re.fullmatch(r"[+-]?[xyz]", word):
            words_read = replace(words_read, axis=word)
        elif word == "fixed":
            side = next(rest, "")
            if not re.fullmatch(r"[+-][xyz]", side):
                raise DesatError(f"{option} {text}: fixed to which side, as fixed +z")
            words_read = replace(words_read, side=side)
        elif word.endswith("kg/m2"):
            form = Quantity(f"{option} {text}:", "kg", 0.0, 100.0)
            words_read = replace(words_read, density=form(word.removesuffix("/m2")))
        elif re.fullmatch(r"[\d.]+/[\d.]+", word):
            specular, diffuse = (float(x) for x in word.split("/"))
            if specular + diffuse > 1.0:
                raise DesatError(
                    f"{option} {text}: {word} of the light are reflected: 1 at most"
                )
            words_read = replace(words_read, shine=(specular, diffuse))
        else:
            raise DesatError(f"{option} {text}: {FORM} ({word}?)")
    return words_read


def _check_outside(place: str, arm: float, sides: Sides, axis: int) -> None:
    """Raise DesatError if a centre at an arm (m) along an axis lies in the body."""
    if arm <= 0.5 * sides[axis]:
        raise DesatError(
            f"{place}: its centre at {arm:g} m lies in the body, whose side is "
            f"{0.5 * sides[axis]:g} m away along {AXES[axis]}"
        )


def _wing(
    name: str,
    area: float,
    centre: Sides,
    axis: int,
    normal: str,
    density: float,
    shine: Shine,
    sides: Sides,
    origin: str,
) -> Part:
    """Return a wing along an axis (0 to 2) whose centre (m) is as far out as it is.

    It reaches from the body to twice its arm less that; one that begins in it is square.
    """
    boom = _unit(axis, 1.0)
    if normal:
        front = _unit(AXES.index(normal[1]), 1.0 if normal[0] == "+" else -1.0)
        plates = tuple(
            Plate(_times(sign, front), area, centre, shine) for sign in (1.0, -1.0)
        )
    else:
        front = _unit((axis + 1) % 3, 1.0)
        plates = (Plate(front, area, centre, shine, boom),)
    mass = density * area
    length = 2.0 * (abs(centre[axis]) - 0.5 * sides[axis])
    length = length if length > 0.0 else math.sqrt(area)
    along, across = mass * length**2 / 12.0, mass * (area / length) ** 2 / 12.0
    moments = []  # about its own centre
    for k in range(3):
        if k == axis:
            moments.append(across)
        elif normal:
            # about its normal both extents count, about the third axis its length
            moments.append(along + across * (k == AXES.index(normal[1])))
        else:
            moments.append(along + 0.5 * across)  # mean over its turn
    square = sum(x * x for x in centre)
    a, b, c = (
        m + mass * (square - x * x) for m, x in zip(moments, centre, strict=True)
    )
    motion = f"fixed to {normal}" if normal else f"turned about {AXES[axis]} to the Sun"
    return Part(name, plates, mass, (a, b, c), f"{origin}; {motion}")


def _panel(text: str, sides: Sides) -> Iterator[Part]:
    """Yield the wing of `--panel AREA ARM`, on -y."""
    match = re.fullmatch(r"\s*([\d.eE+-]+)\s*m2\s+([\d.eE+-]+)\s*m\s*", text)
    if match is None:
        raise DesatError(
            f"--panel {text}: area and arm are needed, as '13m2 1.35m'; --wings says more"
        )
    Quantity("--panel", "m", 0.0, 100.0)(match[2])
    yield from _wings("--panel", f"{match[1]}m2 {match[2]}m -y", sides, inside=True)


def _dish(text: str, sides: Sides) -> Part:
    """Return the dish of a text: its diameter, side and arm."""
    match = re.fullmatch(r"\s*(\S+)\s+([+-][xyz])\s+(\S+)\s*", text)
    if match is None:
        raise DesatError(
            f"--dish {text}: diameter, side and arm are needed, as '1.2m +x 1m'"
        )
    diameter = DIAMETER(match[1])
    arm = Quantity("--dish", "m", 0.0, 100.0, above=True)(match[3])
    axis, sign = AXES.index(match[2][1]), 1.0 if match[2][0] == "+" else -1.0
    _check_outside(f"--dish {text}", arm, sides, axis)
    area = math.pi / 4.0 * diameter**2
    density = quantity("", classes()["surfaces"]["dish"]["mass"], "kg")
    mass, centre = density * area, _times(sign * arm, _unit(axis, 1.0))
    plates = tuple(
        Plate(_unit(axis, side), area, centre, _shine("dish")) for side in (sign, -sign)
    )
    across = mass * diameter**2 / 16.0
    a, b, c = (2.0 * across if k == axis else across + mass * arm**2 for k in range(3))
    return Part(
        f"dish on {match[2]}",
        plates,
        mass,
        (a, b, c),
        f"given; class: {density:g} kg/m2",
    )


def _shine(name: str) -> Shine:
    """Return the reflected shares of a surface of the class."""
    figures = classes()["surfaces"][name]
    return quantity("", figures["specular"], "1"), quantity("", figures["diffuse"], "1")


def _unit(axis: int, sign: float) -> tuple[float, float, float]:
    """Return the unit vector along an axis."""
    x, y, z = (sign if k == axis else 0.0 for k in range(3))
    return x, y, z


def _times(
    factor: float, vector: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Return a vector times a factor."""
    x, y, z = vector
    return factor * x, factor * y, factor * z
