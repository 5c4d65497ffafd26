"""Read classes and products of hardware for `[hardware]` of a craft file.

`desat new craft` takes them as well.

    [hardware]                    # component = "class:NAME" or "product:NAME"
    wheels = "class:30mNms"       # templates/classes.toml: typical figures, each with its reason
    torquers = "product:UoSAT-12" # templates/products.toml: figures with their source

A class sets all that is typical of it, including friction and lag; a product sets only
what its source gives. [shared] and [parameters] take precedence over both.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Any

from ..system.errors import DesatError, choices
from ..system.model import Values
from ..system.quantity import Quantity

Figures = Mapping[str, str]
# Role -> kind of hardware.
KINDS = {
    "wheels": "wheels",
    "torquers": "rods",
    "thrusters": "thrusters",
    "gyro": "gyros",
    "determination": "star_trackers",
}
FILES = {"class": "classes.toml", "product": "products.toml"}
WHEEL_LAG, COMPENSATION = "50 ms", "1 1/s"
# Friction of a class's wheels as a share of the torque; the viscous one at full speed.
COULOMB, VISCOUS = 0.01, 0.04


def quantity(option: str, text: str, unit: str) -> float:
    """Return the number of a text in `unit`, whatever its own unit.

    A text without a unit is in `unit`.

    Raises
    ------
    DesatError
        If it is no such number.
    """
    return Quantity(option, unit)(text)


@cache
def known_figures(kind: str) -> dict[str, dict[str, Figures]]:
    """Read the figures of classes or products, as they are written.

    The result maps kind of hardware -> name -> figures.
    """
    text = (
        files("desat").joinpath(f"templates/{FILES[kind]}").read_text(encoding="utf-8")
    )
    return tomllib.loads(text)


def classes() -> dict[str, dict[str, Figures]]:
    """Return the figures of each class: kind of hardware -> class -> figures."""
    return known_figures("class")


def figures(role: str, text: str) -> tuple[bool, Figures]:
    """Return whether a choice of hardware is a class, and its figures.

    The choice is `class:NAME` or `product:NAME`.

    Raises
    ------
    DesatError
        If there is no such hardware of this role.
    """
    if role not in KINDS:
        raise DesatError(
            f"there is no hardware of this role; there is of {', '.join(KINDS)}"
        )
    kind, _, name = text.partition(":")
    if kind not in FILES or not name:
        raise DesatError('the form is "class:NAME" or "product:NAME"')
    there = known_figures(kind).get(KINDS[role], {})
    if name not in there:
        raise DesatError(f"no such {kind}{choices(name, there)}")
    return kind == "class", there[name]


def values(
    role: str, typical: bool, of: Figures, parameters: frozenset[str], present: Values
) -> dict[str, Any]:
    """Return the parameter values of a component: name -> value, as in a craft file.

    `parameters` are those that the component has. `present` holds the values that
    decide number and place: `axes_wheel` (12 numbers, row by row) and `arm` (m).
    """
    if role == "wheels":
        return _wheels(typical, of, present["axes_wheel"])
    if role == "torquers":
        return {"m_limit": of["dipole"]} | ({"lag": of["lag"]} if "lag" in of else {})
    if role == "thrusters":
        force = quantity("", of["force"], "N")
        parameter_values: dict[str, Any] = {
            "specific_impulse": of["impulse"],
            "least_pulse": of["pulse"],
        }
        if "tau_level" in parameters:  # a pair of thrusters each way
            parameter_values["tau_level"] = [2.0 * force * present["arm"]] * 3
        if "thrust" in parameters:
            parameter_values["thrust"] = [force] * 8
        return parameter_values
    if role == "gyro":
        return {"angle_random_walk": walk(of)}
    slow = (
        {"markov_sigma": of["slow"], "correlation_time": of["time"]}
        if "slow" in of
        else {}
    )
    return {"noise": of["noise"], **slow}


def _wheels(typical: bool, of: Figures, axes: list[float]) -> dict[str, Any]:
    """Return the parameter values of wheels, with friction and lag for a class."""
    speed, torque = (
        quantity("", of["speed"], "rad/s"),
        quantity("", of["torque"], "N.m"),
    )
    rotor = quantity("", of["capacity"], "N.m.s") / speed
    count = len(axes) // 3
    parameters: dict[str, Any] = {
        "inertia_wheel": [rotor if any(axes[i::count]) else 0.0 for i in range(count)],
        "torque_limit": of["torque"],
        "speed_limit": of["speed"],
    }
    if typical:
        viscous, coulomb = friction(torque, speed)
        parameters |= {
            "motor_lag": WHEEL_LAG,
            "compensation": COMPENSATION,
            "viscous": viscous,
            "coulomb": coulomb,
        }
    return parameters


def walk(gyro: Figures) -> float:
    """Return the angle random walk of a gyro as its block uses it (rad).

    It is the angle after 1 s. The angle grows with the root of the time, and the figure
    is that after 1 h.
    """
    return quantity("", gyro["walk"], "rad") / 60.0


def friction(torque: float, speed: float) -> tuple[float, float]:
    """Compute viscous (N m s/rad) and Coulomb (N m) friction of a class's wheel."""
    return VISCOUS * torque / speed, COULOMB * torque
