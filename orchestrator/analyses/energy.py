"""The standing monitor of a rigid body's energy: is what it gains what the torques do?

The kinetic energy of the body without the wheels' axial part, E = 1/2 omega . J_r omega, changes by

    dE/dt = omega . (tau_ext - A tau_wheel)

(the wheels' own, h^2 / 2 J_s, changes by tau_wheel . h / J_s, which the momentum of each wheel
fulfils by itself; the sum of both is tau_ext . omega + tau_wheel . Omega). Work is integrated over
each step from the rows (`within.py`), with the external torque as its mean: exact but for terms of
order 6 in nutation times step, and of order 2 where an external torque changes within a step.
What stays is what the integrator or the exchange takes or makes.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..engine.results import Results
from ..study.plots import COLOURS, figure, svg, time_axis
from ..system.model import System
from . import residual
from .within import NODES, WEIGHTS, Array, Steps, rotate

KEY = "energy"
_PAIR = ("tau_mean_wheel", "tau_slope_wheel")


def applies(system: System) -> dict[str, str] | None:
    """As for the momentum residual, and where the wheels' torques come from; None where they do
    not reach the body or are not stepped with it."""
    parts = residual.applies(system)
    if parts is None:
        return None
    body = parts["spacecraft"]
    for name in _PAIR:
        feeds = [c for c in system.connections if c.target == body and c.input == f"{name}[1]"]
        if not feeds:
            return None
        feed = feeds[0]
        if (
            system.components[body].decimation != 1
            or system.components[feed.source].decimation != 1
        ):
            return None
        parts[name] = f"{feed.source}.{feed.output.partition('[')[0]}"
    return parts


def steps_of(manifest: dict[str, Any], results: Results) -> Steps | None:
    """The steps of a run; None where not every row of what is needed is recorded, or a torque
    reaches the body a step late."""
    parts = manifest.get(KEY)
    if parts is None or manifest["algorithm"] != "conserving":
        return None
    name = parts["spacecraft"]
    states = [f"{name}.{n}" for n in ("q_bi", "omega_bi_body", "impulse_eci")] + [parts["wheels"]]
    pair = [parts[n] for n in _PAIR]
    if not {*states, *pair} <= set(results.names()):
        return None
    q, omega, impulse, h = (results.values(s) for s in states)
    mean, slope = (results.values(s) for s in pair)
    times = results.times(states[0])
    n = min(len(mean), len(q) - 1)
    if n < 1 or abs(times[1] - times[0] - manifest["step"]) > 1e-9 * manifest["step"]:
        return None
    carrier, axes = residual.carrier_of(manifest, name)
    return Steps(
        float(manifest["step"]), carrier, axes, q[: n + 1], omega[: n + 1], impulse[: n + 1],
        h[: n + 1], mean[:n], slope[:n],
    )  # fmt: skip


def balance(steps: Steps) -> tuple[Array, Array]:
    """(energy, work): of the body at the rows and what the torques have done until then, in J."""
    energy = 0.5 * np.einsum("ij,jk,ik->i", steps.omega, steps.carrier, steps.omega)
    work = np.zeros(len(steps.mean))
    for e, weight in zip(NODES.tolist(), WEIGHTS.tolist(), strict=True):
        q = steps.attitude(e)
        motors = steps.dt * (steps.mean + (e - 0.5) * steps.slope) @ steps.axes.T
        work += weight * (steps.rate(e, q) * (rotate(q, steps.gained) - motors)).sum(axis=1)
    return energy, np.concatenate([[0.0], np.cumsum(work)])


def signals(parts: dict[str, str]) -> list[str]:
    """None: the balance is made where its series are recorded anyhow."""
    return []


def numbers(manifest: dict[str, Any], results: Results) -> dict[str, dict[str, Any]]:
    """The largest mismatch, as a share of the largest energy that the body had or got."""
    steps = steps_of(manifest, results)
    if steps is None:
        return {}
    energy, work = balance(steps)
    scale = max(energy.max(), np.abs(work).max())
    if scale == 0.0:
        return {}
    return {
        "energy_mismatch": {
            "title": "Energy mismatch, largest",
            "value": float(np.abs(energy - energy[0] - work).max() / scale),
            "unit": "1",
            "note": "of the body's largest energy or work",
        }
    }


def figures(manifest: dict[str, Any], results: Results) -> list[tuple[str, str]]:
    """The mismatch over time."""
    steps = steps_of(manifest, results)
    if steps is None:
        return []
    energy, work = balance(steps)
    times = manifest["start"] + steps.dt * np.arange(len(energy))
    fig, ax = figure()
    seconds, unit = time_axis(times)
    ax.plot(times / seconds, energy - energy[0] - work, color=COLOURS[0], linewidth=1.0)
    ax.set_xlabel(f"time [{unit}]")
    ax.set_ylabel("[J]")
    ax.margins(x=0.01)
    caption = "Energy mismatch: what the body has gained beyond the work of its torques"
    return [(caption, svg(fig))]
