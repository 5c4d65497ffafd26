"""What a manager asks of a craft, and the gains that its laws have by rule from it.

A manager declares both (`Manager.craft_needs`, `Manager.offers`); whoever chooses among
managers asks these declarations, and nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType
from typing import NamedTuple


class Need(Enum):
    """What a craft must have for a manager to be of use; the value says it."""

    WHEELS = "wheels about three axes"
    COILS = "coils that take its command"
    THRUSTERS = "thrusters that take its command"
    CONTROLLER = "an attitude controller whose torque passes through it"
    DESIGN = "tables made for one craft, orbit and attitude (`desat design`)"
    INERTIAL = "an attitude that stays in eci"


class Law(NamedTuple):
    """A law of a manager that holds the momentum of wheels as long as it flies.

    `gains`: parameter -> a choice by its name, true or false, or a rule, which is a
    product as scenarios have it, of numbers, of parameters of the craft
    (`torquers.m_limit`) and of

    - `craft.rate`, 1/s: at which momentum across the field is to go out: five times the orbit's
      rate, or what the craft's own law has;
    - `craft.field`, T: the field's mean size;
    - `craft.orbit_rate`, rad/s;
    - `craft.h_noise`, N m s, `craft.rate_noise`, rad/s, and `craft.attitude_noise`, rad: standard
      deviations at each sample of what its sensors measure.

    A parameter that `follows` something of the craft does so without a rule.
    """

    name: str
    gains: Mapping[str, str | bool] = MappingProxyType({})
    rate: str = ""
    """The gain by which others take over the rate of a craft's own law; empty: none."""
    units: Mapping[str, str] = MappingProxyType({})
    """parameter -> its unit under this law, where that is not the one that it is
    declared with."""


def unit_under(
    manager: type, parameter: str, values: Mapping[str, object]
) -> str | None:
    """The unit of a parameter under the law that a manager's values choose; None: as
    declared."""
    for law in getattr(manager, "offers", ()):
        chosen = {k: x for k, x in law.gains.items() if isinstance(values.get(k), str)}
        if parameter in law.units and all(values[k] == x for k, x in chosen.items()):
            return str(law.units[parameter])
    return None


def needs_of(manager: type) -> list[Need]:
    """What a craft must have for a manager, by what it and its bases say."""
    said = {need for c in manager.__mro__ for need in vars(c).get("craft_needs", ())}
    return [need for need in Need if need in said]
