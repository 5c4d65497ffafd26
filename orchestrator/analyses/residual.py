"""The standing monitor of a rigid body: does its momentum add up?

The inertial angular momentum of the craft, from its attitude and rate and from the momentum that
the *wheels* report, less its start and the external impulse, ought to be zero. The spacecraft's own
copy of the wheels' momentum is not used, so an exchange that loses momentum shows.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..engine.results import Results
from ..study.derived import rotate_back
from ..study.plots import COLOURS, figure, legend, svg, time_axis
from ..system.model import System

Array = NDArray[np.float64]
KEY = "rigid_body"
NUMBERS = ("momentum_residual",)
_NEEDED = ("inertia", "axes_wheel", "inertia_wheel", "q_bi", "omega_bi_body", "impulse_eci")


def applies(system: System) -> dict[str, str] | None:
    """Which component is a rigid body and where its wheels' momentum comes from; None: there is
    no such component."""
    for c in system.connections:
        target = system.components[c.target].interface
        if c.input == "h_wheel[1]" and target and all(target.elements(n) for n in _NEEDED):
            wheels = f"{c.source}.{c.output.partition('[')[0]}"
            return {"spacecraft": c.target, "wheels": wheels}
    return None


def momentum(manifest: dict[str, Any], results: Results) -> tuple[Array, Array] | None:
    """(times, residual) of a run, the residual (rows, 3) in N m s, eci; None where there is no
    rigid body or its series are not recorded."""
    body = manifest.get(KEY)
    if body is None:
        return None
    name = body["spacecraft"]
    series = [f"{name}.{n}" for n in ("q_bi", "omega_bi_body", "impulse_eci")] + [body["wheels"]]
    if not set(series) <= set(results.names()):
        return None
    q, omega, impulse, h = (results.values(s) for s in series)
    if len(q) == 0:
        return None
    given = manifest["parameters"][name]
    axes = np.reshape(given["axes_wheel"]["value"], (3, 4))
    spin = np.array(given["inertia_wheel"]["value"])
    carrier = np.reshape(given["inertia"]["value"], (3, 3)) - (axes * spin) @ axes.T
    in_eci = rotate_back(q, omega @ carrier.T + h @ axes.T)
    return results.times(series[0]), in_eci - in_eci[0] - (impulse - impulse[0])


def signals(parts: dict[str, str]) -> list[str]:
    """None: the residual is computed where its series are recorded anyhow."""
    return []


def numbers(manifest: dict[str, Any], results: Results) -> dict[str, dict[str, Any]]:
    """The largest residual of a run (N m s)."""
    found = momentum(manifest, results)
    if found is None:
        return {}
    return {
        "momentum_residual": {
            "title": "Momentum residual, largest",
            "value": float(np.linalg.norm(found[1], axis=1).max()),
            "unit": "N.m.s",
        }
    }


def figures(manifest: dict[str, Any], results: Results) -> list[tuple[str, str]]:
    """The residual over time."""
    found = momentum(manifest, results)
    caption = "Momentum residual: what the exchange between components loses"
    return [] if found is None else [(caption, plot(*found))]


def plot(times: Array, residual: Array) -> str:
    """The residual over time as SVG."""
    fig, ax = figure()
    seconds, unit = time_axis(times)
    for i, axis in enumerate("xyz"):
        ax.plot(times / seconds, residual[:, i], color=COLOURS[i], linewidth=1.0, label=axis)
    ax.set_xlabel(f"time [{unit}]")
    ax.set_ylabel("[N m s], eci")
    ax.margins(x=0.01)
    legend(ax)
    return svg(fig)
