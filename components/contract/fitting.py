"""Declare what a manager requires of a craft and the default gains of its laws.

A manager declares both (`Manager.craft_needs`, `Manager.offers`). Code that chooses
among managers relies on these declarations alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType
from typing import NamedTuple


class Need(Enum):
    """Equipment or property that a craft must have for a manager to be of use.

    The value is its description.
    """

    WHEELS = "wheels about three axes"
    COILS = "coils that take its command"
    THRUSTERS = "thrusters that take its command"
    CONTROLLER = "an attitude controller whose torque passes through it"
    DESIGN = "tables made for one craft, orbit and attitude (`desat design`)"
    INERTIAL = "an attitude that stays in eci"


class Law(NamedTuple):
    """Law of a manager that keeps the wheel momentum bounded as long as it flies.

    `gains` maps a parameter to a choice by its name, to true or false, or to a rule. A
    rule is a product, as in scenarios, of numbers, of parameters of the craft
    (`torquers.m_limit`) and of

    - `craft.rate`, 1/s: the rate at which momentum across the field is to decay: five times the orbit
      rate, or the rate of the craft's own law;
    - `craft.field`, T: the mean magnitude of the field;
    - `craft.orbit_rate`, rad/s;
    - `craft.field_noise`, T, `craft.h_noise`, N m s, `craft.rate_noise`, rad/s, and
      `craft.attitude_noise`, rad: standard deviations of the sensors' measurements at each sample.

    A parameter with `follows` is set from the craft without a rule.
    """

    name: str
    gains: Mapping[str, str | bool] = MappingProxyType({})
    # gain from which other managers take the rate of a craft's own law; empty: none
    rate: str = ""
    # parameter -> its unit under this law, where that differs from the declared one
    units: Mapping[str, str] = MappingProxyType({})


def unit_under(
    manager: type, parameter: str, values: Mapping[str, object]
) -> str | None:
    """Return the unit of a parameter under the law that a manager's values choose.

    None means that the unit is as declared.
    """
    for law in getattr(manager, "offers", ()):
        choices = {k: x for k, x in law.gains.items() if isinstance(values.get(k), str)}
        if parameter in law.units and all(values[k] == x for k, x in choices.items()):
            return str(law.units[parameter])
    return None


def needs_of(manager: type) -> list[Need]:
    """Collect what a craft must have for a manager, from its class and its bases."""
    declared_needs = {
        need for c in manager.__mro__ for need in vars(c).get("craft_needs", ())
    }
    return [need for need in Need if need in declared_needs]
