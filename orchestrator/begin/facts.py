"""Define the facts that are known of a new craft."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict


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


class Facts(TypedDict, total=False):
    """The same facts for programs: the options of `desat new craft`, as text."""

    altitude: str | None
    inclination: str | None
    sso: str | None
    ltan: str | None
    tle: Path | None
    epoch: str | None
    mass: str | None
    size: str | None
    box: str | None
    inertia: str | None
    wheels: str | None
    rods: str | None
    thrusters: str | None
    pointing: str | None
    residual_dipole: str | None
    orbit: str | None
    dump: str | None
    panel: str | None
    sun: str | None
    secular: str | None
    torque: str | Sequence[str] | None
    propellant: str | None
    isp: str | None
    sample: str | None
