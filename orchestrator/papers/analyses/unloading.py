"""Compute numbers of momentum management by coils, for the claims of paper 001.

The first quarter of a run is left out. The periodic part of a momentum is found by a
least-squares fit of cos and sin of twice the orbital rate and a straight line: at an
inertial attitude gravity gradient makes such a part, and a secular one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from desat.components.physics.orbit import mean_motion

from ...analyses import Parts
from ...analyses.manifest import Manifest
from ...numbers.derived import rotate, rotate_back, unit_rows
from ...numbers.text import Value
from ...system.model import System

if TYPE_CHECKING:
    from ...engine.recording.results import Results

KEY = "unloading"
SPEEDS = (100, 200, 300)  # rpm: the time of the fastest wheel above these is counted
RPM = 30.0 / np.pi
NUMBERS = (
    *(f"time_above_{s}" for s in SPEEDS),
    "moved_by_coils",
    "moved_by_gravity",
    "mean_momentum",
    "mean_change",
    "amplitude_kept",
    "dipole_correlation",
    "off_profile",
    "field_models",
    "end_miss",
)
SIGNALS = (
    "spacecraft.q_bi",
    "spacecraft.impulse_eci",
    "environment.b_eci",
    "torquers.m_mean_body",
    "manager.tau_desired_body",
    "wheels.speed_wheel",
)


@dataclass(frozen=True)
class TelescopeParts(Parts):
    """Component that manages the momentum."""

    manager: str = "manager"


PARTS = TelescopeParts


def applies(system: System) -> TelescopeParts | None:
    """Return the parts of a system that the analysis applies to, or None.

    Its manager must output its desired torque, and it must have the components of a
    craft with coils.
    """
    for signal in SIGNALS:
        name, _, output = signal.partition(".")
        component = system.components.get(name)
        if component is None or not component.interface.elements.get(output, ()):
            return None
    return TelescopeParts()


def signals(parts: TelescopeParts) -> list[str]:
    """Return the series that the numbers need."""
    return list(SIGNALS)


def numbers(manifest: Manifest, results: Results) -> dict[str, Value]:
    """Compute the numbers of a completed run of at least two orbits.

    There are none where a series is not recorded.
    """
    if not manifest.completed or not set(SIGNALS) <= set(results.names()):
        return {}
    law = manifest.values_of("manager")
    q, impulse, field, dipole, reference, speed = (results.values(s) for s in SIGNALS)
    step = manifest.step
    rate = mean_motion(float(manifest.values_of("environment")["semi_major_axis"]))
    orbit = 2.0 * np.pi / rate
    rows = len(dipole)  # interval outputs have no row at the end
    if rows * step < 2.0 * orbit:
        return {}
    first = rows // 4
    turned = (field[:-1] + field[1:])[:rows] / 2.0
    torque = np.cross(rotate_back(unit_rows(q[:-1] + q[1:])[:rows], dipole), turned)
    moved = np.diff(impulse[: rows + 1], axis=0)
    gravity = moved - step * torque
    fastest = np.abs(speed[first:rows]).max(axis=1) * RPM
    entries = {
        f"time_above_{s}": (
            f"Time that the fastest wheel is above {s} rpm",
            100.0 * float((fastest > s).mean()),
            "%",
        )
        for s in SPEEDS
    }
    count = rows - first
    per_orbit = orbit / (count * step)
    entries["moved_by_coils"] = (
        "Momentum exchanged by the coils per orbit (integral of the torque's magnitude)",
        per_orbit * step * float(np.linalg.norm(torque[first:], axis=1).sum()),
        "N.m.s",
    )
    entries["moved_by_gravity"] = (
        "Momentum exchanged by the gravity gradient per orbit (likewise)",
        per_orbit * float(np.linalg.norm(gravity[first:], axis=1).sum()),
        "N.m.s",
    )
    period_rows = int(orbit / step)
    means = [
        impulse[k : k + period_rows].mean(axis=0)
        for k in range(first, rows - period_rows + 1, period_rows)
    ]
    entries["mean_change"] = (
        "Mean change of the orbit-averaged momentum from one orbit to the next",
        float(np.linalg.norm(np.diff(means, axis=0), axis=1).mean())
        if means[1:]
        else np.nan,
        "N.m.s",
    )
    entries["mean_momentum"] = (
        "Magnitude of the mean momentum",
        float(np.linalg.norm(impulse[first:rows].mean(axis=0))),
        "N.m.s",
    )
    times = step * np.arange(first, rows)
    built = np.cumsum(gravity, axis=0)[first:]
    ours, free = (
        _periodic(times, x, rate) for x in (impulse[first + 1 : rows + 1], built)
    )
    entries["amplitude_kept"] = (
        "Periodic momentum (share of that of the gravity gradient alone)",
        100.0 * float(ours / free),
        "%",
    )
    held = max(1, round(law["sample_time"] / step))
    part = slice(first + held // 2, rows, held)  # the middle of a hold
    b = rotate(q[part], turned[part])
    size, across = (
        np.linalg.norm(x, axis=1) for x in (dipole[part], np.cross(reference[part], b))
    )
    sine = across / np.maximum(
        np.linalg.norm(reference[part], axis=1) * np.linalg.norm(b, axis=1), 1e-300
    )
    if size.std() > 0.0 and sine.std() > 1e-3:
        entries["dipole_correlation"] = (
            "Correlation of the dipole's size with the sine of the angle of T_D to B",
            float(np.corrcoef(size, sine)[0, 1]),
            "1",
        )
    if (
        "desaturation_period" in law
    ):  # one for the dipole of each sample, and those of each solution
        each = law["desaturation_period"] / law["sample_time"] / law["update_period"]
        models = 3600.0 * (1.0 / law["sample_time"] + each)
    else:
        models = 0.0
    entries["field_models"] = (
        "Onboard evaluations of the field model per hour",
        models,
        "1",
    )
    if "profile_table" in law:
        entries["off_profile"] = (
            "Difference from H_NOM at the rows of the table, rms",
            _off_profile(law, impulse[: rows + 1], step, first),
            "N.m.s",
        )
    if "update_period" in law and law["update_period"] == law["desaturation_period"]:
        title = "Difference from H_NOM at the ends of desaturation periods, rms (share of H_D's)"
        entries["end_miss"] = (title, _end_miss(law, impulse, reference, q, step), "%")
    return {name: Value(*row) for name, row in entries.items() if np.isfinite(row[1])}


def _periodic(times: Any, momentum: Any, rate: float) -> float:
    """Return the size of the periodic part (N m s) of a momentum."""
    phase = 2.0 * rate * times
    form = np.stack([np.ones_like(times), times, np.cos(phase), np.sin(phase)], axis=1)
    return float(np.linalg.norm(np.linalg.lstsq(form, momentum, rcond=None)[0][2:]))


def _off_profile(
    parameters: Mapping[str, Any], impulse: Any, step: float, first: int
) -> float:
    """Return the rms distance (N m s) of the momentum (rows, 3) from H_NOM's rows."""
    nodes = int(parameters["table_nodes"])
    table = np.reshape(parameters["profile_table"], (-1, 3))[:nodes]
    rows = np.round(parameters["table_spacing"] * np.arange(nodes) / step).astype(int)
    is_inside = (rows >= first) & (rows < len(impulse))
    return float(
        np.sqrt(((impulse[rows[is_inside]] - table[is_inside]) ** 2).sum(axis=1).mean())
    )


def _end_miss(
    law: Mapping[str, Any], impulse: Any, reference: Any, q: Any, step: float
) -> float:
    """Return the rms of |H - H_NOM| at the ends of desaturation periods.

    It is in % of the rms of |H_D|, the integral of the desired torque (eq. 3).
    """
    period = law["update_period"]
    rows, nodes = round(period / step), round(period / law["table_spacing"])
    if abs(nodes * law["table_spacing"] - period) > 1e-6:
        return float("nan")
    meant = rotate_back(q[: len(reference)], reference) * step
    table = np.reshape(law["profile_table"], (-1, 3))
    ends = range(rows, len(reference) + 1, rows)
    missed = [impulse[k] - table[k // rows * nodes] for k in ends]
    dumped = [meant[k - rows : k].sum(axis=0) for k in ends]
    return 100.0 * float(np.linalg.norm(missed) / np.linalg.norm(dumped))
