"""The standing monitor of a rigid body from outside: does its energy add up, and its impulse?

The kinetic energy of the body without the wheels' axial part, E = 1/2 omega . J_r omega, changes by

    dE/dt = omega . (tau_ext - A tau_wheel)

(the wheels' own, h^2 / 2 J_s, changes by tau_wheel . h / J_s, which the momentum of each wheel
fulfils by itself; the sum of both is tau_ext . omega + tau_wheel . Omega). Both integrals, of work
and of impulse, are taken over each step from the rows (`within.py`), with the external torque as
the body's neighbours recorded it (`outside.py`): exact but for terms of order 6 in nutation times
step. Where that torque is not known, its mean by the body's own impulse serves for the work, which
then errs by order 2 where the torque changes within a step.

What stays of the energy is what the integrator or the exchange takes or makes; what stays of the
impulse is a torque that the body has computed otherwise.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..engine.recording.results import Results
from ..figures.mode_bands import timeline
from ..figures.style import COLOURS, figure, time_axis
from ..numbers.derived import rotate_back
from ..system.model import System
from . import outside, residual
from .within import NODES, WEIGHTS, Array, Steps

KEY = "energy"
BOUND = 1e-6
"""Of the impulse's mismatch, as a share of the largest momentum, where a scenario has no
`impulse_bound`."""
NUMBERS = ("energy_mismatch", "impulse_mismatch")
BOUND_KEY = "impulse_bound"
BLOCK = 8192
"""Steps that are computed at once: what comes between fits the processor's cache."""
_PAIR = ("tau_mean_wheel", "tau_slope_wheel")


def applies(system: System) -> dict[str, Any] | None:
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
    return {**parts, "feeds": outside.feeds(system, body)}


def blocks_of(manifest: dict[str, Any], results: Results) -> Iterator[Steps]:
    """The steps of a run, a block at a time; none where not every row of what is needed is
    recorded, where a torque reaches the body a step late, and where a row has the mean of several
    inner steps."""
    parts = manifest.get(KEY)
    if parts is None or manifest["algorithm"] != "conserving" or manifest["inner"] > 1:
        return
    name = parts["spacecraft"]
    states = residual.balanced(parts)
    pair = [parts[n] for n in _PAIR]
    if not {*states, *pair} <= set(results.names()):
        return
    times = results.times(states[0])
    n = min(results.count(pair[0]), results.count(states[0]) - 1)
    if n < 1 or abs(times[1] - times[0] - manifest["step"]) > 1e-9 * manifest["step"]:
        return
    carrier, axes = residual.carrier_of(manifest, name)
    for first in range(0, n, BLOCK):
        rows = slice(first, min(first + BLOCK, n))
        ends = slice(first, rows.stop + 1)
        q, omega, impulse, h = (results.values(s, ends) for s in states)
        mean, slope = (results.values(s, rows) for s in pair)
        yield Steps(
            float(manifest["step"]), carrier, axes, q, omega, impulse, h, mean, slope,
            parts["feeds"] and outside.torque(manifest, results, name, parts["feeds"], rows),
        )  # fmt: skip


@dataclass
class Balance:
    """At the rows of a run: times (s), the body's energy and what torques have done to it (J), the
    impulse by its own account less that computed outside (N m s, eci; None: not known)."""

    times: Array
    energy: Array
    work: Array
    impulse: Array | None

    @property
    def mismatch(self) -> Array:
        """Energy gained beyond the work (J)."""
        return np.asarray(self.energy - self.energy[0] - self.work)


def balance(manifest: dict[str, Any], results: Results) -> Balance | None:
    """Of a run; None as for `blocks_of`."""
    return results.once(KEY, lambda: _balance(manifest, results))


def _balance(manifest: dict[str, Any], results: Results) -> Balance | None:
    work: list[Array] = []
    given: list[Array] = []
    energy: list[Array] = []
    own: list[Array] = []
    outer = False
    for steps in blocks_of(manifest, results):
        done, turned = np.zeros(len(steps.mean)), np.zeros((len(steps.mean), 3))
        for e, weight in zip(NODES.tolist(), WEIGHTS.tolist(), strict=True):
            q = steps.attitude(e)
            torque = steps.torque(e, q)
            done += weight * steps.dt * (steps.rate(e, q) * (torque - steps.motors(e))).sum(axis=1)
            turned += weight * steps.dt * rotate_back(q, torque)
        work.append(done)
        given.append(turned)
        held = slice(1 if energy else 0, None)  # the first row is the last of the block before
        energy.append(0.5 * np.einsum("ij,jk,ik->i", steps.omega, steps.carrier, steps.omega)[held])
        own.append(steps.impulse[held])
        outer = steps.outer is not None
    if not work:
        return None
    gained = np.concatenate(own)
    impulse = np.vstack([np.zeros(3), np.cumsum(np.concatenate(given), axis=0)])
    return Balance(
        times=manifest["start"] + manifest["step"] * np.arange(len(gained)),
        energy=np.concatenate(energy),
        work=np.concatenate([[0.0], np.cumsum(np.concatenate(work))]),
        impulse=gained - gained[0] - impulse if outer else None,
    )


def signals(parts: dict[str, str]) -> list[str]:
    """None: the balance is made where its series are recorded anyhow, or asked for."""
    return []


def balanced(parts: dict[str, Any]) -> list[str]:
    """The series that the balance is made of."""
    fed = parts["feeds"] or {}
    outer = [x for x in fed.values() if isinstance(x, str)]
    return [*residual.balanced(parts), *(parts[n] for n in _PAIR), *outer]


def numbers(manifest: dict[str, Any], results: Results) -> dict[str, dict[str, Any]]:
    """The largest mismatch of energy, as a share of the largest energy that the body had or got,
    and the largest one of impulse (N m s)."""
    balanced = balance(manifest, results)
    if balanced is None:
        return {}
    rows: dict[str, dict[str, Any]] = {}
    scale = max(balanced.energy.max(), np.abs(balanced.work).max())
    if scale > 0.0:
        rows["energy_mismatch"] = {
            "title": "Energy mismatch, largest",
            "value": float(np.abs(balanced.mismatch).max() / scale),
            "unit": "1",
            "note": "of the body's largest energy or work",
        }
    if balanced.impulse is not None:
        rows["impulse_mismatch"] = {
            "title": "External impulse, the body's own less that computed outside, largest",
            "value": float(np.linalg.norm(balanced.impulse, axis=1).max()),
            "unit": "N.m.s",
        }
    return rows


def unmet(manifest: dict[str, Any], results: Results) -> list[str]:
    """An external impulse that is not the one of the torques from outside the body."""
    mismatch = manifest["numbers"].get("impulse_mismatch")
    series = residual.momentum(manifest, results)
    if mismatch is None or series is None:
        return []
    bound = manifest["about"].get("impulse_bound", BOUND)
    return residual.beyond("impulse_mismatch", mismatch, "impulse_bound", bound, series.largest)


def figures(manifest: dict[str, Any], results: Results) -> list[tuple[str, str]]:
    """The mismatch of energy over time."""
    balanced = balance(manifest, results)
    if balanced is None:
        return []
    fig, ax = figure()
    seconds, unit = time_axis(balanced.times)
    ax.plot(balanced.times / seconds, balanced.mismatch, COLOURS[0])
    timeline(ax, seconds, unit)
    ax.y.label = "[J]"
    caption = "Energy mismatch: what the body has gained beyond the work of its torques"
    return [(caption, fig.svg())]
