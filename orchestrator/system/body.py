"""Describe the body of a craft by mass and sides, and find contradictions in them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import prod

DENSITY = 250.0  # kg/m3, class: mass of a craft divided by the volume of its box
DENSITIES = 20.0, 3000.0  # kg/m3: range of the crafts that were built
GYRATION = (
    0.1,
    30.0,
)  # largest moment divided by that of a homogeneous box: panels, booms, a dense core


@dataclass(frozen=True)
class Body:
    """Mass and sides of a craft."""

    mass: float  # kg
    sides: tuple[float, float, float]  # m, along x, y, z of the body

    @property
    def density(self) -> float:
        """Return mass divided by the volume of the box (kg/m3)."""
        return self.mass / prod(self.sides)


def homogeneous_inertia(
    mass: float, sides: Sequence[float]
) -> tuple[float, float, float]:
    """Compute the principal moments (3,) kg m2 of a homogeneous box.

    `mass` is in kg, `sides` in m.
    """
    a, b, c = (x * x for x in sides)
    return mass / 12.0 * (b + c), mass / 12.0 * (c + a), mass / 12.0 * (a + b)


def contradictions(body: Body, inertia: Sequence[float]) -> Iterator[str]:
    """Find properties of a body that no craft has, a line each.

    Parameters
    ----------
    body
        Mass and sides.
    inertia
        (3,) kg m2, moments about x, y, z.
    """
    least, most = DENSITIES
    sides = " x ".join(f"{x:.4g}" for x in body.sides)
    if not least <= body.density <= most:
        yield (
            f"{body.mass:.4g} kg in a box of {sides} m are {body.density:.3g} kg/m3; crafts have "
            f"{least:g} to {most:g}"
        )
    usual = max(homogeneous_inertia(body.mass, body.sides))
    share = max(inertia) / usual
    low, high = GYRATION
    if not low <= share <= high:
        yield (
            f"a moment of inertia of {max(inertia):.4g} kg m2 is {share:.3g} times that of a "
            f"homogeneous box of {body.mass:.4g} kg and {sides} m; {low:g} to {high:g} times are "
            "those of a craft"
        )
