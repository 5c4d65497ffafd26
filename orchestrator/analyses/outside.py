"""The external torque on a rigid body, computed outside it from what the other components recorded.

It uses none of the body's code, only its parameters, its attitude and the signals that reach it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from desat.components.physics.orbit import EARTH_RATE, MU
from desat.components.physics.torques import PLATE_COLUMNS, SOLAR_PRESSURE

from ..engine.recording.results import Results
from ..numbers.derived import cross
from ..system.interface import base_name
from ..system.model import System
from ..system.parameters import value_of
from .within import Array, Torque, rotate

Feeds = dict[str, str | list[Any]]
"""Of each input the series that feeds it, or its values where none does."""

BLOCK, FIXED = "spacecraft_rigid", "spacecraft_fixed_attitude"
_ALWAYS: dict[str, Any] = {
    "residual_dipole_body": [0.0, 0.0, 0.0], "gravity_gradient": True, "plates": [],
    "aerodynamics": "none", "radiation": "none",
}  # fmt: skip
"""Of a body that has no such parameter."""
INPUTS = (
    "r_eci", "v_eci", "b_eci", "b_rate_eci", "b_accel_eci", "sun_eci", "sunlight", "density",
    "m_mean_body", "m_slope_body", "tau_mean_thruster_body", "tau_slope_thruster_body",
    "tau_ext_body",
)  # fmt: skip


def known(system: System, body: str) -> bool:
    """Whether a body is ours, whose torques are known."""
    interface = system.components[body].interface
    return interface is not None and interface.model in (BLOCK, FIXED)


def feeds(system: System, body: str) -> Feeds | None:
    """What feeds the inputs of a body; None for another block than ours, and for an input that
    comes changed (factor, unit) or not at every step."""
    component = system.components[body]
    interface = component.interface
    if not known(system, body):
        return None
    fed: Feeds = {}
    for name in INPUTS:
        signals = interface.elements(name)
        wires = [c for c in system.connections if c.target == body and base_name(c.input) == name]
        if not wires:
            fed[name] = [value_of(component, s.name) for s in signals]
            continue
        wire = wires[0]
        source = system.components[wire.source]
        series = {f"{c.source}.{base_name(c.output)}" for c in wires}
        signal = source.interface.signals.get(wire.output) if source.interface else None
        same = all(c.factor == 1.0 and c.offset == 0.0 for c in wires)
        if not (
            same and signal and len(series) == 1 and len(wires) == len(signals)
            and source.decimation == 1 and signal.unit_name == signals[0].unit_name
        ):  # fmt: skip
            return None
        fed[name] = series.pop()
    return fed


def recorded(results: Results, fed: Feeds, rows: slice) -> dict[str, Array] | None:
    """The inputs of a body in these steps of a run, (steps, elements) each; None where a series is
    not recorded."""
    n = rows.stop - rows.start
    known = set(results.names())
    if not {x for x in fed.values() if isinstance(x, str)} <= known:
        return None
    return {
        name: np.reshape(results.values(f, rows), (n, -1)) if isinstance(f, str)
        else np.broadcast_to(np.array(f, dtype=float), (n, len(f)))
        for name, f in fed.items()
    }  # fmt: skip


def torque(parameters: dict[str, Any], x: dict[str, Array], dt: float | Array) -> Torque:
    """The torque in steps of dt (s) on a body of these parameters (as a manifest has them), its
    inputs at each being x."""
    given = _ALWAYS | {k: v["value"] for k, v in parameters.items()}
    inertia = np.reshape(given["inertia"], (3, 3))
    fall = -MU * x["r_eci"] / np.linalg.norm(x["r_eci"], axis=1, keepdims=True) ** 3
    plates = np.reshape(given["plates"], (-1, PLATE_COLUMNS))
    plates = plates[plates[:, 3] > 0.0]

    def drag(v: Array) -> Array:
        """v (m/s, body) through the air, of size |v|."""
        head = -0.5 * x["density"] * given["drag_coefficient"]
        if given["aerodynamics"] == "area":
            force = head * given["area_drag"] * np.linalg.norm(v, axis=1, keepdims=True) * v
            return cross(given["centre_drag_body"], force)
        total = np.zeros_like(v)
        for p in plates:
            facing = np.maximum(v @ (p[:3] / np.linalg.norm(p[:3])), 0.0)[:, None]
            total += cross(p[4:7], head * p[3] * facing * v)
        return total

    def light(s: Array) -> Array:
        """s: unit vector to the Sun, body."""
        pressure = SOLAR_PRESSURE * x["sunlight"]
        if given["radiation"] == "area":
            return cross(given["centre_radiation_body"], -pressure * given["area_radiation"] * s)
        total = np.zeros_like(s)
        for p in plates:
            normal = p[:3] / np.linalg.norm(p[:3])
            cosine = np.maximum(s @ normal, 0.0)[:, None]
            along = (1.0 - p[7]) * s + 2.0 * (p[7] * cosine + p[8] / 3.0) * normal
            total += cross(p[4:7], -pressure * p[3] * cosine * along)
        return total

    def at(e: float, q: Array) -> Array:
        t, lead = e * dt, e - 0.5
        r = x["r_eci"] + t * x["v_eci"] + 0.5 * t * t * fall
        b = x["b_eci"] + t * x["b_rate_eci"] + 0.5 * t * t * x["b_accel_eci"]
        dipole = x["m_mean_body"] + lead * x["m_slope_body"] + given["residual_dipole_body"]
        total = x["tau_ext_body"] + given["tau_disturbance_body"] + cross(dipole, rotate(q, b))
        total += x["tau_mean_thruster_body"] + lead * x["tau_slope_thruster_body"]
        if given["gravity_gradient"]:
            p = rotate(q, r)
            size = np.linalg.norm(p, axis=1, keepdims=True)
            total += 3.0 * MU / size**5 * cross(p, p @ inertia.T)
        if given["aerodynamics"] != "none":
            wind = (
                x["v_eci"] + t * fall - cross([0.0, 0.0, EARTH_RATE], x["r_eci"] + t * x["v_eci"])
            )
            total += drag(rotate(q, wind))
        if given["radiation"] != "none":
            total += light(rotate(q, x["sun_eci"]))
        return np.asarray(total)

    return at
