"""The standing monitor of a rigid body: does its momentum add up?

The inertial angular momentum of the craft, from its attitude and rate and from the momentum that
the *wheels* report, less its start and the external impulse, ought to be zero. The spacecraft's own
copy of the wheels' momentum is not used, so an exchange that loses momentum shows.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .results import Results
from .system import Component, System

Array = NDArray[np.float64]


def wheels_of(system: System, spacecraft: str) -> tuple[str, str] | None:
    """(component, variable) of the wheels' momentum that a spacecraft is wired to."""
    for c in system.connections:
        if (c.target, c.input) == (spacecraft, "h_wheel[1]"):
            return c.source, c.output.partition("[")[0]
    return None


def matrix(component: Component, name: str, rows: int) -> Array:
    """A parameter of a component as an array of so many rows."""
    from .check import value_of

    assert component.interface is not None
    values = [value_of(component, s.name) for s in component.interface.elements(name)]
    return np.asarray(values, float).reshape(rows, -1)


def rigid_bodies(system: System) -> list[tuple[Component, tuple[str, str]]]:
    """The components that are a rigid body with wheels, and where their wheels' momentum is."""
    needed = ("inertia", "axes_wheel", "inertia_wheel", "q_bi", "omega_bi_body", "impulse_eci")
    found = []
    for c in system.components.values():
        wheels = wheels_of(system, c.name)
        if wheels and c.interface and all(c.interface.elements(n) for n in needed):
            found.append((c, wheels))
    return found


def momentum(system: System, results: Results) -> tuple[Array, Array] | None:
    """(times, residual) with the residual (rows, 3) in N m s, eci; None where there is no rigid
    body or its series are not recorded."""
    bodies = rigid_bodies(system)
    if not bodies:
        return None
    body, (wheels, variable) = bodies[0]
    series = [f"{body.name}.{n}" for n in ("q_bi", "omega_bi_body", "impulse_eci")]
    series.append(f"{wheels}.{variable}")
    if not set(series) <= set(results.names()):
        return None
    q, omega, impulse, h = (results.values(s) for s in series)
    axes = matrix(body, "axes_wheel", 3)
    spin = matrix(body, "inertia_wheel", 1)[0]
    carrier = matrix(body, "inertia", 3) - (axes * spin) @ axes.T
    in_body = omega @ carrier.T + h @ axes.T
    in_eci = rotate_back(q, in_body)
    return results.times(series[0]), in_eci - in_eci[0] - (impulse - impulse[0])


def rotate_back(q: Array, v: Array) -> Array:
    """C(q)' v, row by row: from body to eci."""
    vector, scalar = q[:, :3], q[:, 3:]
    t = 2.0 * np.cross(vector, v)
    return np.asarray(v + scalar * t + np.cross(vector, t))


def summary(system: System, results: Results) -> dict[str, Any] | None:
    """What the manifest says of the momentum residual."""
    found = momentum(system, results)
    if found is None:
        return None
    _, residual = found
    return {
        "title": "Momentum residual, largest",
        "value": float(np.linalg.norm(residual, axis=1).max()) if len(residual) else 0.0,
        "unit": "N.m.s",
    }
