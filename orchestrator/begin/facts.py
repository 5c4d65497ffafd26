"""Define the facts that are known of a new craft."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from numbers import Real
from pathlib import Path
from typing import Any, TypedDict

from desat.components.physics import earth

from ..system.errors import DesatError, nearest

# SI units of the facts that a program may give as numbers
UNITS = {
    "altitude": "m",
    "inclination": "rad",
    "sso": "m",
    "mass": "kg",
    "box": "m",
    "inertia": "kg.m2",
    "rods": "A.m2",
    "residual_dipole": "A.m2",
    "secular": "N.m",
    "propellant": "kg",
    "isp": "s",
    "sample": "s",
    "sun": "m",
    "cp": "m",
    "bias": "N.m.s",
    "arm": "m",
}
SEQUENCES = (
    "box",
    "inertia",
    "secular",
    "residual_dipole",
    "cp",
)  # facts of several numbers


@dataclass(frozen=True)
class CraftFacts:
    """Facts of a new craft, as typed.

    None stands for the value of the class. The default pointing is nadir, for an orbit
    about the Sun to the Sun.
    """

    altitude: str | None = None
    inclination: str | None = None
    sso: str | None = None
    ltan: str | None = None
    tle: Path | None = None
    epoch: str | None = None
    mass: str | None = None
    size: str | None = None
    box: str | None = None
    inertia: str | None = None
    wheels: str | None = None
    rods: str | None = None
    thrusters: str | None = None
    pointing: str | None = None
    residual_dipole: str | None = None
    orbit: str | None = None
    dump: str | None = None
    panel: str | None = None
    sun: str | None = None
    secular: str | None = None
    torque: str | Sequence[str] | None = None
    propellant: str | None = None
    isp: str | None = None
    sample: str | None = None
    wings: Sequence[str] | None = None
    dish: str | None = None
    cp: str | None = None
    bias: str | None = None
    arm: str | None = None


class Facts(TypedDict, total=False):
    """The same facts for programs: texts as typed, or values in SI."""

    altitude: str | float | None
    inclination: str | float | None
    sso: str | float | None
    ltan: str | None
    tle: str | Path | None
    epoch: str | datetime | None
    mass: str | float | None
    size: str | None
    box: str | Iterable[float] | None
    inertia: str | Iterable[float] | None
    wheels: str | None
    rods: str | float | None
    thrusters: str | None
    pointing: str | None
    residual_dipole: str | float | Iterable[float] | None
    orbit: str | None
    dump: str | None
    panel: str | None
    sun: str | float | None
    secular: str | float | Iterable[float] | None
    torque: str | Path | Sequence[str | Path] | None
    propellant: str | float | None
    isp: str | float | None
    sample: str | float | None
    wings: str | Sequence[str] | None
    dish: str | None
    cp: str | float | Iterable[float] | None
    bias: str | float | None
    arm: str | float | None


def typed_facts(facts: Facts) -> dict[str, str | tuple[str, ...]]:
    """Return the facts that a program gives as texts of `desat new craft`.

    Files of torques and wings, of which there may be several, are a tuple.

    Raises
    ------
    DesatError
        If a fact is unknown, or its value is of no type that it can have.
    """
    if unknown := [name for name in facts if name not in Facts.__annotations__]:
        raise DesatError(
            f"{unknown[0]}: no fact of a craft"
            f"{nearest(unknown[0], Facts.__annotations__)}"
        )
    typed: dict[str, str | tuple[str, ...]] = {}
    for name, value in facts.items():
        if name in ("torque", "wings") and value is not None:
            several = value if isinstance(value, (list, tuple)) else (value,)
            typed[name] = tuple(_typed(name, each) for each in several)
        elif value is not None:
            typed[name] = _typed(name, value)
    return typed


def craft_facts(typed: Mapping[str, Any]) -> CraftFacts:
    """Return the facts of a craft from texts, by their names."""
    tle = Path(typed["tle"]) if "tle" in typed else None
    return CraftFacts(**{k: x for k, x in typed.items() if k != "tle"}, tle=tle)


def _typed(name: str, value: Any) -> str:
    """Return a fact as text, a number with its unit.

    Raises DesatError if its type is none that the fact can have.
    """
    plain = value.tolist() if hasattr(value, "tolist") else value
    match plain:
        case str():
            return plain
        case Path() if name in ("tle", "torque"):
            return str(plain)
        case datetime() if name == "epoch":
            return plain.isoformat()
        case list() | tuple() if name in SEQUENCES and all(map(_is_number, plain)):
            return ",".join(_with_unit(name, x) for x in plain)
        case _ if name in UNITS and _is_number(plain):
            return _with_unit(name, plain)
    raise DesatError(f"{name}={value!r}: {_needed(name)}")


def _is_number(value: Any) -> bool:
    """Return whether a value is a real number, and no truth."""
    return isinstance(value, Real) and not isinstance(value, bool)


def _with_unit(name: str, value: float) -> str:
    """Return a number in SI as text with its unit, a distance from the Sun in AU."""
    if name == "sun":
        return f"{float(value) / earth.ASTRONOMICAL_UNIT!r}AU"
    return f"{float(value)!r} {UNITS[name]}"


def _needed(name: str) -> str:
    """Describe the values that a fact can have."""
    option = name.replace("_", "-")
    text = f"a text as of `desat new craft --{option}` is needed"
    if name in SEQUENCES:
        return f"numbers in {UNITS[name]}, or {text}"
    return f"a number in {UNITS[name]}, or {text}" if name in UNITS else text
