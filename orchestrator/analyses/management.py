"""The standard numbers of a managed run: what the wheels hold, and what the coils do about it.

Of wheels with axes A (columns) and momenta h the coils can act on the sum A h alone. What is left,
h - A^+ A h, adds up to nothing: no torque on the body changes it. A mean over wheels cannot tell
the two apart, so each has its number; the others say how near wheels and coils are to their limits.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..engine.recording.results import Results
from ..numbers.text import Value
from ..system.model import System
from . import Parts as Named
from . import titled
from .manifest import Manifest

KEY = "management"
NUMBERS = (
    "sum_rms", "sum_largest", "null_rms", "coil_duty", "coil_limit_share", "momentum_margin",
    "limit_time", "crossings",
)  # fmt: skip
AT_LIMIT = 0.999
"""Share of its limit from which on a coil counts as at it: one with a lag never is quite."""
_OF_WHEELS = ("saturated_wheel", "speed_wheel")


@dataclass(frozen=True)
class Parts(Named):
    """Which component is what; no `wheels` where they are ideal ones within the craft."""

    spacecraft: str
    torquers: str
    wheels: str | None = None


def applies(system: System) -> Parts | None:
    """By the connections; None where no manager commands coils of a craft with wheels."""

    def target(source: str, connector: str) -> str | None:
        targets = (c.target for c in system.connections
                 if c.source == source and c.input == connector)  # fmt: skip
        return next(targets, None)

    for c in system.connections:
        if c.input != "m_cmd_body[1]":
            continue
        manager, torquers = c.source, c.target
        body = target(torquers, "m_mean_body[1]")
        if body is None or not system.components[body].interface.elements("h_copy_wheel"):
            continue
        wheels = target(manager, "tau_cmd_wheel[1]")
        if wheels and all(system.components[wheels].interface.elements(n) for n in _OF_WHEELS):
            return Parts(body, torquers, wheels)
        return Parts(body, torquers)
    return None


def signals(parts: Parts) -> list[str]:
    """The series that the numbers are made of."""
    names = [f"{parts.spacecraft}.h_copy_wheel", f"{parts.torquers}.m_mean_body"]
    return names + [f"{parts.wheels}.{n}" for n in _OF_WHEELS if parts.wheels]


def numbers(manifest: Manifest, results: Results) -> dict[str, Value]:
    """The standard numbers of a completed run, as a manifest has them; none where too little was
    recorded, and only those for which the parameters are known."""
    parts: Parts = manifest.parts[KEY]
    if not manifest.completed or not set(signals(parts)) <= set(results.names()):
        return {}
    h = results.values(f"{parts.spacecraft}.h_copy_wheel")
    axes = np.reshape(manifest.values_of(parts.spacecraft).get("axes_wheel", np.eye(3, 4)), (3, 4))
    there = np.linalg.norm(axes, axis=0) > 0.0
    h, axes = h[:, there], axes[:, there]
    stored = h @ axes.T
    size = np.linalg.norm(stored, axis=1)
    idle = h - stored @ np.linalg.pinv(axes).T
    rows: dict[str, tuple[str, float | None, str]] = {
        "sum_rms": ("Momentum that coils can act on, sum g h: rms", _rms(size), "N.m.s"),
        "sum_largest": ("Momentum that coils can act on, sum g h: largest", float(size.max()),
                        "N.m.s"),
        "null_rms": ("Null-space part of a wheel's momentum: rms of the largest wheel",
                     _rms(np.abs(idle).max(axis=1)), "N.m.s"),
    }  # fmt: skip
    m = results.values(f"{parts.torquers}.m_mean_body")
    rows |= _of_coils(m, manifest.values_of(parts.torquers), manifest.step)
    if parts.wheels:
        own = manifest.values_of(parts.wheels)
        rows |= _of_wheels(parts.wheels, own, results, np.abs(h), there)
    return titled(rows)


def _rms(values: Any) -> float:
    return float(np.sqrt((values**2).mean()))


def _of_coils(m: Any, given: dict[str, Any], step: float) -> dict[str, tuple[str, float, str]]:
    """Duty of the coils, as a share of what they can do: in the mean of a step, or of a period
    where they are pulsed."""
    most = given.get("m_limit", 0.0)
    if given.get("drive") == "ideal" or not most or "axes_coil" not in given:
        return {}
    axes = np.reshape(given["axes_coil"], (3, -1))
    coils = np.abs(m @ np.linalg.pinv(axes[:, np.linalg.norm(axes, axis=0) > 0.0]).T)
    if given.get("drive") == "pulsed":
        most *= given["duty_max"]
        count = max(1, round(given["sample_time"] / step))
        coils = coils[: len(coils) // count * count].reshape(-1, count, coils.shape[1]).mean(axis=1)
    if not len(coils):
        return {}
    return {
        "coil_duty": ("Coil duty: mean dipole of a coil, share of the most that it can do",
                      100.0 * float(coils.mean()) / most, "%"),
        "coil_limit_share": ("Time that some coil is at its limit",
                             100.0 * float((coils >= AT_LIMIT * most).any(axis=1).mean()), "%"),
    }  # fmt: skip


def _of_wheels(
    wheels: str, given: dict[str, Any], results: Results, h: Any, there: Any
) -> dict[str, tuple[str, float, str]]:  # fmt: skip
    """How near the wheels come to their limits, and how often they pass zero speed."""
    rows = {}
    if "inertia_wheel" in given and "speed_limit" in given:
        capacity = (np.array(given["inertia_wheel"]) * given["speed_limit"])[there]
        margin = 100.0 * (1.0 - float((h / capacity).max()))
        rows["momentum_margin"] = ("Momentum margin: what the fullest wheel has left, least",
                                    margin, "%")  # fmt: skip
    saturated, speed = (results.values(f"{wheels}.{n}") for n in _OF_WHEELS)
    steps = np.diff(results.times(), append=results.times()[-1])
    at_limit = np.asarray(saturated.reshape(len(saturated), -1).any(axis=1))
    crossings = (np.diff(np.signbit(speed[:, there]), axis=0)).sum()
    rows["limit_time"] = ("Time that some wheel is at its limit",
                           float(steps[: len(at_limit)] @ at_limit), "s")  # fmt: skip
    rows["crossings"] = ("Zero crossings of the wheels", float(crossings), "1")
    return rows
