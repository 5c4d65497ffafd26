"""What the bound of the hidden work (`analyses/energy.py`) tells apart: craft that err
or do not.

Craft made at random from a seed, on the loops of `ssp/gyrostat`; each run's attitude
held against the same with 64 substeps.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import log10, radians
from typing import Any, NamedTuple

import numpy as np

from desat.analyses.energy import ENERGY_BOUND
from desat.runs.run import Options, execute

from .estimate import difference

GOOD, BAD = 1e-5, 1e-3
"""Errors of the attitude (rad) below and above which a run is to be told apart from the
other."""
FINEST = 64
_SIGNALS = ("spacecraft.q_bi", "wheels.h_wheel")
_PYRAMID = [
    0.6,
    -0.48,
    -0.6,
    0.48,
    0.48,
    0.6,
    -0.36,
    -0.64,
    0.64,
    0.64,
    0.7144228439796701,
    0.6,
]
_THREE = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]

_STRONG: dict[str, Any] = {
    "shared.inertia_wheel": [8e-4, 8e-4, 8e-4, 0.0],
    "spacecraft.inertia": [1.7, 0.05, -0.03, 0.05, 1.5, 0.04, -0.03, 0.04, 1.6],
    "wheels.h_start_wheel": [0.2, -0.25, 0.2, 0.0],
    "thrusters.schedule_tau_body": [
        [0.4, 0.0, 0.0],
        [0.0, -0.4, 0.0],
        [0.0, 0.0, 0.4],
        [-0.4, 0.0, 0.0],
        [0.0, 0.4, 0.0],
        [0.0, 0.0, -0.4],
        [0.4, 0.4, 0.0],
        [0.0, -0.4, 0.4],
    ],
}
JETS: dict[str, dict[str, Any]] = {
    "strong jets on 1.7 kg m2": _STRONG,
    "a jet from rest to 0.9 rad/s": {
        **_STRONG,
        "spacecraft.omega_start_body": [0.0, 0.0, 0.0],
        "thrusters.schedule_duration": [2.0] + 7 * [0.0],
        "thrusters.schedule_tau_body": [[0.765, 0.23, 0.153]] + 7 * [[0.0, 0.0, 0.0]],
    },
}
"""Values for gyrostat/pulses that make other craft of it, by what they are."""


class Row(NamedTuple):
    """A run: its error against FINEST substeps (rad), its hidden work, and whether it
    ends with exit code 1."""

    name: str
    substeps: int
    error: float
    hidden: float
    refused: bool


def craft(seed: int) -> tuple[str, dict[str, Any]]:
    """A scenario and values for it: 0.01 to 200 kg m2, rates to 60 deg/s, three or four
    wheels, with and without jets."""
    r = np.random.default_rng(seed)
    size = 10.0 ** r.uniform(-2.0, log10(200.0))
    a, b, c = (size * r.uniform(0.75, 1.25, 3)).tolist()
    d, e, f = (0.05 * size * r.uniform(-1.0, 1.0, 3)).tolist()
    four, jets = r.random() < 0.5, r.random() < 0.4
    rate = 10.0 ** r.uniform(-2.5, log10(radians(60.0)))
    along = r.normal(size=3)
    spin = float(size * 10.0 ** r.uniform(-4.0, -1.8))
    limit = float(size * 10.0 ** r.uniform(-3.0, -1.0))
    momentum = size * 10.0 ** r.uniform(-2.5, -0.3) * r.uniform(-1.0, 1.0, 4)
    wheels = np.array([1.0, 1.0, 1.0, float(four)])
    bandwidth = 10.0 ** r.uniform(-2.0, -0.8)
    values = {
        "shared.axes_wheel": _PYRAMID if four else _THREE,
        "shared.inertia_wheel": (spin * wheels).tolist(),
        "spacecraft.inertia": [a, d, e, d, b, f, e, f, c],
        "spacecraft.omega_start_body": (rate * along / np.linalg.norm(along)).tolist(),
        "wheels.h_start_wheel": (momentum * wheels).tolist(),
        "wheels.torque_limit": limit,
        "wheels.motor_lag": float(r.choice([0.0, 0.02, 0.08, 0.3])),
        "wheels.viscous": 0.0,
        "wheels.coulomb": 0.0,
        "wheels.speed_limit": 1e5,
        "controller.kp": float(size * bandwidth**2),
        "controller.kd": float(1.4 * size * bandwidth),
        "controller.ki": 0.0,
        "controller.torque_limit": limit,
    }
    if jets:
        torques = size * 10.0 ** r.uniform(-2.5, -0.5) * r.uniform(-1.0, 1.0, (8, 3))
        values["thrusters.schedule_tau_body"] = torques.tolist()
    return f"gyrostat/{'pulses' if jets else 'light'}", values


def held(
    name: str,
    target: str,
    substeps: Iterable[int | None],
    values: dict[str, Any] | None = None,
    stop: float | None = None,
) -> list[Row]:
    """A scenario with other values, at each of these substeps (None: its own), until
    `stop` (s)."""

    def fly(substeps: int | None) -> tuple[Any, ...]:
        run = execute(
            target, Options(substeps=substeps, values=values or {}, stop=stop)
        ).or_raise(target)
        stated_numbers = (
            run.manifest.substeps,
            run.manifest.numbers,
            bool(run.manifest.unmet),
        )
        return *(run.results.values(s) for s in _SIGNALS), *stated_numbers

    q, h, *_ = fly(FINEST)
    rows = []
    for each in substeps:
        mine, wheels, result, numbers, refused = fly(each)
        error = difference(mine, wheels, q, h)[0]
        rows.append(Row(name, result, error, numbers["hidden_work"].value, refused))
    return rows


def at_random(seeds: Iterable[int], stop: float = 300.0) -> list[Row]:
    """The craft of these seeds, with one exchange a step."""
    rows = []
    for seed in seeds:
        target, values = craft(seed)
        rows += held(f"seed {seed}", target, (1,), values, stop)
    return rows


def summed(rows: Iterable[Row]) -> dict[str, Any]:
    """Of a set of runs: how many are good, bad and between; the largest unresolved work
    of the good and the least of the bad, and how many of each the bound takes for the
    other."""
    rows = list(rows)
    good = [r.hidden for r in rows if r.error < GOOD]
    bad = [r.hidden for r in rows if r.error > BAD]
    return {
        "good": len(good),
        "bad": len(bad),
        "between": len(rows) - len(good) - len(bad),
        "most_of_good": max(good, default=0.0),
        "least_of_bad": min(bad, default=0.0),
        "false_alarms": sum(h > ENERGY_BOUND for h in good),
        "missed": sum(h <= ENERGY_BOUND for h in bad),
    }
