"""Make telemetry of crafts whose dipole and centre of pressure are known, with noise."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from desat.analyses import flight as flights
from desat.numbers.derived import cross, from_body, rotate_back
from desat.runs.prepare import prepare
from desat.system.model import System
from desat.system.options import Options
from desat.telemetry.fit import _turn
from desat.telemetry.log import align_signs

STEP = 10.0  # s


@dataclass(frozen=True)
class Errors:
    """Errors of a log: standard deviations."""

    field: float = 100e-9  # T, each axis: half of it constant
    attitude: float = np.radians(0.1)  # rad, each axis, slow
    tacho: float = 1.0  # rpm, each sample
    resolution: float = 1.0  # rpm


def system_of(craft: Path, values: dict[str, Any] | None = None) -> System:
    """Return a craft with some values of the spacecraft changes."""
    changes = {
        f"spacecraft.{k}": list(map(float, x)) for k, x in (values or {}).items()
    }
    return prepare(str(craft), Options(values=changes)).or_raise()[0]


def slow_noise(rng: Any, times: Any, deviation: float, correlation: float) -> Any:
    """Return a Gauss-Markov process (n, 3) at equal steps."""
    keep = np.exp(-(times[1] - times[0]) / correlation)
    rows = [deviation * rng.standard_normal(3)]
    for _ in times[1:]:
        kick = deviation * np.sqrt(1.0 - keep**2) * rng.standard_normal(3)
        rows.append(keep * rows[-1] + kick)
    return np.array(rows)


def columns_of(
    craft: Path,
    truth: dict[str, Any],
    seed: int,
    duration: float = 21600.0,
    errors: Errors = Errors(),
    dumps: dict[int, float] | None = None,
) -> tuple[list[str], Any]:
    """Return headings and rows of a log of a craft with true values.

    At the rows of `dumps` thrusters give so much (N m s, eci) about each axis.
    """
    rng = np.random.default_rng(seed)
    system = system_of(craft, truth)
    times = np.arange(0.0, duration + STEP, STEP)
    block = flights.environment_block(system.components["environment"])
    inputs = flights.inputs_at(block, times.tolist())
    share = errors.field / np.sqrt(2.0)
    inputs["b_eci"] = (
        inputs["b_eci"]
        + share * rng.standard_normal(3)
        + slow_noise(rng, times, share, 1500.0)
    )
    attitude = flights.wanted_attitude(system)
    flight = flights.flown_at(system, attitude, inputs, times)
    momenta, dipoles = _fly(system, flight, rng, dumps or {})
    rotor = system.components["spacecraft"].values["inertia_wheel"][0]
    rpm = momenta / rotor * 30.0 / np.pi
    rpm = rpm + errors.tacho * rng.standard_normal(rpm.shape)
    rpm = errors.resolution * np.round(rpm / errors.resolution)
    q = _turn(flight.q, slow_noise(rng, times, errors.attitude, 1000.0))
    names = ["time [s]"] + [f"speed_{i} [rpm]" for i in range(1, 5)]
    names += [f"q_bi[{i}]" for i in range(1, 5)]
    rows = [times[:, None], rpm, q]
    if "torquers" in system.components:
        names += [f"m_mean_body[{i}] [A.m2]" for i in range(1, 4)]
        rows.append(dipoles)
    return names, np.hstack(rows)


def _fly(system: System, flight: Any, rng: Any, dumps: dict[int, float]) -> Any:
    """Return the momenta (n, 4) N m s of wheels, and dipoles (n, 3) A m2 of coils."""
    hardware = flights.hardware_of(system)
    attitudes = align_signs(flight.q)
    turn = from_body(flight.q)  # columns: body axes in eci
    body = flight.omega @ hardware.inertia.T
    spread, capacity = hardware.spread(), hardware.capacity.max()
    total = turn[0] @ (
        body[0] + hardware.axes_wheel @ (0.2 * capacity * rng.uniform(-1, 1, 4))
    )
    coils = "torquers" in system.components
    momenta, dipoles = [], []
    gain, limit = 1e-3, hardware.m_limit
    for k in range(len(flight.times)):
        h = turn[k].T @ total - body[k]
        b = turn[k].T @ flight.b[k]
        m = np.zeros(3)
        if coils:
            m = np.clip(gain * np.cross(h, b) / (b @ b), -limit, limit)
        momenta.append(spread @ h)
        dipoles.append(m)
        if k + 1 < len(flight.times):
            q, b_eci = (
                attitudes[k : k + 2].mean(axis=0),
                flight.b[k : k + 2].mean(axis=0),
            )
            q = (q / np.linalg.norm(q))[None]
            total = total + STEP * cross(rotate_back(q, m[None]), b_eci[None])[0]
            total = total + flight.disturbance[k + 1] - flight.disturbance[k]
            total = total + dumps.get(k, 0.0)
    return np.array(momenta), np.array(dipoles)


def write_log(file: Path, names: list[str], rows: Any) -> Path:
    """Write a log; an element that is nan is an empty cell."""
    lines = [",".join(names)]
    lines += [",".join("" if np.isnan(x) else f"{x:.9g}" for x in row) for row in rows]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file
