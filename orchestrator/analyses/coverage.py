"""The range in which the exchange is shown to be exact: three numbers of a rigid craft with wheels.

Over an inner step H (`system/rates.py`) components exchange means and slopes; what a torque does
beside, curvature c inside it, leaves an error of the rate of about
H^3 / 60 |omega x J_r^-1 c + J_r^-1 (J_r^-1 c x L)|. So it depends, with the state at the start and
L the body's total momentum, on

- `turn`: H (|omega| + nutation), nutation = sqrt(L . J_r L / det J_r); rad
- `kick`: H^2 times the largest acceleration that the wheels' torque limit gives the body; rad
- `transient`: H over the motors' or the coils' lag, the longer ratio; 0 without lag

H is the mean of a step's inner steps. `tests/test_convergence.py` holds the limits below at the
largest that the scenarios of `ssp/gyrostat` reach, which err by 2e-5 rad at most.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import ceil
from typing import Any

import numpy as np

from ..system.model import Component, System
from ..system.parameters import value_of
from . import residual


@dataclass(frozen=True)
class Bound:
    """The three numbers, as the module's text has them."""

    turn: float
    kick: float
    transient: float


LIMITS = Bound(turn=0.46, kick=0.0076, transient=20.0)
"""Reached by heavy-wheels with its inner steps (1e-6 rad), by saturating without (4e-6 rad), and by
stress (2e-6 rad)."""
TEXTS = {
    "turn": ("turn and nutation in an inner step", " rad"),
    "kick": ("turn by the wheels' largest torque in an inner step", " rad"),
    "transient": ("inner step over the lag of motors or coils", ""),
}


def bound(system: System) -> Bound | None:
    """The three numbers of a checked system; None where there is no rigid body with wheels."""
    body = residual.applies(system)
    if body is None:
        return None
    craft = system.components[body["spacecraft"]]
    wheels = system.components[body["wheels"].partition(".")[0]]
    axes = _values(craft, "axes_wheel").reshape(3, 4)
    spin = _values(craft, "inertia_wheel")
    carrier = _values(craft, "inertia").reshape(3, 3) - (axes * spin) @ axes.T
    omega = _values(craft, "omega_start_body")
    momentum = carrier @ omega + axes @ _values(wheels, "h_start_wheel")
    nutation = np.sqrt(momentum @ carrier @ momentum / np.linalg.det(carrier))
    pushes = np.linalg.inv(carrier) @ axes * _values(wheels, "torque_limit")
    lags = [
        float(_values(c, name)[0]) for c in system.components.values()
        for name in ("motor_lag", "lag") if _has(c, name)
    ]  # fmt: skip
    step = system.step / system.inner
    return Bound(
        turn=step * float(np.linalg.norm(omega) + nutation),
        kick=step**2 * float(np.linalg.norm(pushes, axis=0).max()),
        transient=max((step / lag for lag in lags if lag > 0.0), default=0.0),
    )


def warnings(system: System) -> list[str]:
    """What leaves the range that the cases cover, a line each, with the remedy."""
    numbers = bound(system)
    if numbers is None:
        return []
    lines = []
    for f in fields(Bound):
        value, limit = getattr(numbers, f.name), getattr(LIMITS, f.name)
        if value > limit * (1.0 + 1e-9):
            what, unit = TEXTS[f.name]
            inner = ceil(system.inner * (value / limit) ** (0.5 if f.name == "kick" else 1.0))
            lines.append(
                f"{what}: {value:.3g}{unit}, accuracy is shown up to {limit:g}{unit} only: "
                f"take inner = {inner} (--inner), or look at --estimate"
            )
    return lines


def _has(component: Component, name: str) -> bool:
    return name in component.interface.signals


def _values(component: Component, name: str) -> Any:
    """The values of a parameter, zeros where the component has none of this name."""
    signals = component.interface.elements(name)
    values: list[Any] = [value_of(component, s.name) for s in signals]
    return np.array(values if values else [0.0] * 4, dtype=float)
