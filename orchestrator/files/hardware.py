"""Classes of hardware and products: what `[hardware]` of a craft file and
`desat new craft` take.

    [hardware]                    # component = "class:NAME" or "product:NAME"
    wheels = "class:30mNms"       # templates/classes.toml: what is typical, each with its reason
    torquers = "product:UoSAT-12" # templates/products.toml: figures with their source

A class fills what it is typical of, friction and lag included; a product what its
source says and no more. [shared] and [parameters] go before either.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Any

from ..system.errors import DesatError, nearest
from ..system.model import Values
from ..system.quantity import Quantity

Figures = Mapping[str, str]
KINDS = {
    "wheels": "wheels",
    "torquers": "rods",
    "thrusters": "thrusters",
    "gyro": "gyros",
    "determination": "star_trackers",
}
"""Role -> kind of hardware."""
FILES = {"class": "classes.toml", "product": "products.toml"}
WHEEL_LAG, COMPENSATION = "50 ms", "1 1/s"
COULOMB, VISCOUS = 0.01, 0.04
"""Friction of a class's wheels: of the torque, the latter at the largest speed."""


def quantity(option: str, text: str, unit: str) -> float:
    """A number with a unit or, without one, in `unit`. Raises DesatError."""
    return Quantity(option, unit)(text)


@cache
def known_figures(which: str) -> dict[str, dict[str, Figures]]:
    """Kind of hardware -> name -> its figures, as they are written; of classes or
    products."""
    text = (
        files("desat").joinpath(f"templates/{FILES[which]}").read_text(encoding="utf-8")
    )
    return tomllib.loads(text)


def classes() -> dict[str, dict[str, Figures]]:
    """Kind of hardware -> class -> its figures."""
    return known_figures("class")


def figures(role: str, text: str) -> tuple[bool, Figures]:
    """Whether `class:NAME` or `product:NAME` of a role is a class, and its figures.
    Raises DesatError."""
    if role not in KINDS:
        raise DesatError(
            f"there is no hardware of this role; there is of {', '.join(KINDS)}"
        )
    which, _, name = text.partition(":")
    if which not in FILES or not name:
        raise DesatError('the form is "class:NAME" or "product:NAME"')
    there = known_figures(which).get(KINDS[role], {})
    if name not in there:
        raise DesatError(
            f"no such {which}{nearest(name, there)}; there is {', '.join(there)}"
        )
    return which == "class", there[name]


def values(
    role: str, typical: bool, of: Figures, parameters: frozenset[str], present: Values
) -> dict[str, Any]:
    """What a component's parameters become: name -> value, as a craft file may write
    it.

    `parameters`: those that it has; `present`: the values that decide how many and
    where: `axes_wheel` (12 numbers, row by row) and `arm` (m).
    """
    if role == "wheels":
        return _wheels(typical, of, present["axes_wheel"])
    if role == "torquers":
        return {"m_limit": of["dipole"]} | ({"lag": of["lag"]} if "lag" in of else {})
    if role == "thrusters":
        force = quantity("", of["force"], "N")
        found: dict[str, Any] = {
            "specific_impulse": of["impulse"],
            "least_pulse": of["pulse"],
        }
        if "tau_level" in parameters:  # a pair of them each way
            found["tau_level"] = [2.0 * force * present["arm"]] * 3
        if "thrust" in parameters:
            found["thrust"] = [force] * 8
        return found
    if role == "gyro":
        return {"angle_random_walk": walk(of)}
    slow = (
        {"markov_sigma": of["slow"], "correlation_time": of["time"]}
        if "slow" in of
        else {}
    )
    return {"noise": of["noise"], **slow}


def _wheels(typical: bool, of: Figures, axes: list[float]) -> dict[str, Any]:
    speed, torque = (
        quantity("", of["speed"], "rad/s"),
        quantity("", of["torque"], "N.m"),
    )
    rotor = quantity("", of["capacity"], "N.m.s") / speed
    found: dict[str, Any] = {
        "inertia_wheel": [rotor if any(axes[i::4]) else 0.0 for i in range(4)],
        "torque_limit": of["torque"],
        "speed_limit": of["speed"],
    }
    if typical:
        viscous, coulomb = friction(torque, speed)
        found |= {
            "motor_lag": WHEEL_LAG,
            "compensation": COMPENSATION,
            "viscous": viscous,
            "coulomb": coulomb,
        }
    return found


def walk(gyro: Figures) -> float:
    """Its angle random walk as the block has it: the angle (rad) after 1 s; it grows
    with the root of the time, and the figure is that after 1 h."""
    return quantity("", gyro["walk"], "rad") / 60.0


def friction(torque: float, speed: float) -> tuple[float, float]:
    """Viscous (N m s/rad) and Coulomb (N m) friction of a class's wheel."""
    return VISCOUS * torque / speed, COULOMB * torque
