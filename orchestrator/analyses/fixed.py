"""Check the momentum balance of a craft whose attitude is prescribed.

Its wheels are inside the body and take every torque. So its momentum C'(J omega + h),
from the wheel momentum that it outputs, has to change by the impulse of the external
torques, which `motion.py` computes outside it. There is no energy balance, because the
rotation of the body is prescribed.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin
from typing import TYPE_CHECKING

import numpy as np

from ..numbers.derived import blocks, cross, rotate_back
from ..numbers.text import Value
from ..system.model import System
from . import Parts, motion, not_checked, residual
from .energy import BOUND
from .manifest import Manifest
from .motion import NODES, WEIGHTS, Array

if TYPE_CHECKING:
    from ..engine.recording.results import Results

KEY = "fixed_attitude"
NUMBERS = ("impulse_mismatch",)
BOUND_KEYS = ("impulse_bound",)
_BODY_OUTPUTS = ("q_bi", "omega_bi_body", "h_copy_wheel")


@dataclass(frozen=True)
class FixedAttitudeParts(Parts):
    """Component with prescribed attitude, its feeds, and why it is not checked."""

    spacecraft: str
    feeds: motion.Feeds | None
    why: str


PARTS = FixedAttitudeParts


def applies(system: System) -> FixedAttitudeParts | None:
    """Find the component with prescribed attitude, or None without one."""
    for c in system.components.values():
        if c.model == motion.FIXED:
            feeds, reason = motion.feeds(system, c.name), ""
            if system.substeps != 1 or c.step_ratio > 1:
                reason = f"a row has several steps of {c.name}, or a part of one"
            elif feeds is None:
                reason = f"what reaches {c.name} is converted, or does not come at every step"
            return FixedAttitudeParts(c.name, feeds, reason)
    return None


def warnings(system: System) -> list[str]:
    """Return a line with the reason why runs of a system cannot be checked, if any."""
    parts = applies(system)
    return not_checked({NUMBERS[0]: parts.why}) if parts and parts.why else []


def balanced(parts: FixedAttitudeParts) -> list[str]:
    """Return the series that the balance is computed from."""
    outer = [x for x in (parts.feeds or {}).values() if isinstance(x, str)]
    return [*(f"{parts.spacecraft}.{n}" for n in _BODY_OUTPUTS), *outer]


def unchecked(manifest: Manifest, results: Results) -> dict[str, str]:
    """Return the reason why there is no balance, by the number's name."""
    reason = _reason_against(manifest, results)
    return {"impulse_mismatch": reason} if reason else {}


def _reason_against(manifest: Manifest, results: Results) -> str:
    """Return the reason why a run has no balance, or ""."""
    parts: FixedAttitudeParts = manifest.parts[KEY]
    if manifest.algorithm != "gauss_seidel":
        return f"under {manifest.algorithm} torques act a step late"
    if reason := parts.why or residual.missing(balanced(parts), results):
        return reason
    times = results.times(f"{parts.spacecraft}.q_bi")
    if len(times) < 2:
        return "there is no whole step"
    late = abs(times[1] - times[0] - manifest.step) > 1e-9 * manifest.step
    return "rows are left out" if late else ""


def mismatch(manifest: Manifest, results: Results) -> tuple[float, float] | None:
    """Compute the largest impulse mismatch and the largest momentum (N m s), once.

    None where they cannot be checked.
    """
    return results.once(KEY, lambda: _mismatch(manifest, results))


def _mismatch(manifest: Manifest, results: Results) -> tuple[float, float] | None:
    """Compute the largest impulse mismatch and the largest momentum from the series."""
    if _reason_against(manifest, results):
        return None
    parts: FixedAttitudeParts = manifest.parts[KEY]
    name, dt, parameters = (
        parts.spacecraft,
        manifest.step,
        manifest.parameters[parts.spacecraft],
    )
    inertia = np.reshape(parameters["inertia"].value, (3, 3))
    impulse_before, most, first = np.zeros(3), np.zeros(2), np.zeros(3)
    series = [f"{name}.{n}" for n in _BODY_OUTPUTS]
    for rows in blocks(results.count(series[0]), 1):
        q, omega, h = (results.values(s, rows) for s in series)
        total = rotate_back(q, omega @ inertia.T + h[:, :3])
        first = total[0] if rows.start == 0 else first
        steps = slice(rows.start, rows.stop - 1)
        reach = parts.feeds and motion.recorded_inputs(results, parts.feeds, steps)
        assert reach
        torque = motion.torque(parameters, reach, dt)
        reference = np.zeros((len(q) - 1, 3))
        for e, weight in zip(NODES, WEIGHTS, strict=True):
            turned = _turned(q[:-1], omega[0], e * dt)
            reference += weight * dt * rotate_back(turned, torque(e, turned))
        impulse = impulse_before + np.cumsum(reference, axis=0)
        impulse_before = impulse[-1]
        off = total[1:] - first - impulse
        sizes = [float(np.linalg.norm(x, axis=1).max()) for x in (off, total)]
        most = np.maximum(most, sizes)
    return float(most[0]), float(most[1])


def _turned(q: Array, omega: Array, t: float) -> Array:
    """Propagate q (rows, 4) by t (s) at a constant rate (rad/s, body)."""
    rate = float(np.linalg.norm(omega))
    vector = omega * (sin(0.5 * rate * t) / rate) if rate else np.zeros(3)
    scalar = cos(0.5 * rate * t)
    return np.hstack(
        [
            scalar * q[:, :3] + q[:, 3:] * vector - cross(vector, q[:, :3]),
            scalar * q[:, 3:] - (q[:, :3] @ vector)[:, None],
        ]
    )


def numbers(manifest: Manifest, results: Results) -> dict[str, Value]:
    """Return the largest impulse mismatch (N m s)."""
    mismatches = mismatch(manifest, results)
    if mismatches is None:
        return {}
    title = "Largest difference of the total momentum from the impulse computed independently"
    return {"impulse_mismatch": Value(title, mismatches[0], "N.m.s")}


def unmet(manifest: Manifest, results: Results) -> list[str]:
    """Return a line if the momentum does not follow the external torques."""
    mismatches = mismatch(manifest, results)
    if mismatches is None:
        return []
    bound = manifest.about.get("impulse_bound", BOUND)
    number = manifest.numbers["impulse_mismatch"]
    return residual.beyond(
        "impulse_mismatch", number, "impulse_bound", bound, mismatches[1]
    )
