"""Check whether a craft is in the range in which the exchange is shown to be accurate.

Two numbers of a rigid craft with wheels describe the range. Over a substep H
(`system/schedule.py`) components exchange means and slopes. The remainder of a torque,
its curvature c inside the substep, leaves an error of the rate of about H^3 / 60 |omega
x J_r^-1 c + J_r^-1 (J_r^-1 c x L)|. So it depends, with L the total momentum of the
body, on

- `turn`: H (|omega| + nutation), nutation = sqrt(L . J_r L / det J_r); rad
- `kick`: H^2 times the largest acceleration by wheels, coils or thrusters; rad

How fast a motor or coil follows is not among them: after a command the curvature of 1 -
exp(-t / lag) is largest where the lag is a third of H, and falls for shorter lags.

H is the mean of a step's substeps. Before a run the numbers are those of the initial
state and of the largest output of each actuator. After it they are those of the
recorded series (`remarks`), because a jet may spin up a craft that begins at rest.
`tests/analyses/test_coverage.py` tests the limits at the largest values that the scenarios of
`ssp/gyrostat` reach, whose error is at most 2e-5 rad.

In addition there is an effect that is exchanged with less than mean and slope: the
jitter of unbalanced wheels, of which the body receives the mean alone. Inside a step it
turns with the wheel, so each step leaves an attitude error of up to unbalance Omega H /
J.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..numbers.derived import blocks, rotate
from ..numbers.text import Value
from ..system.craft import craft_of
from ..system.model import AUTO, System
from ..system.wheels import existing
from . import Parts
from .manifest import Manifest

if TYPE_CHECKING:
    from ..engine.recording.results import Results

Array = NDArray[Any]
KEY = "exchange"
NUMBERS = ("substeps", "estimated_attitude_error")


@dataclass(frozen=True)
class StepCriteria:
    """The two numbers of a substep, defined in the text of this module."""

    turn: float
    kick: float


# Reached by heavy-wheels with its substeps (1e-6 rad) and by saturating without (4e-6
# rad).
LIMITS = StepCriteria(turn=0.46, kick=0.0076)
# rad, limit of `kick` after a run, where it is that of all actuators together (from
# saturating)
TOGETHER = 0.0103
# Ratio of the accumulated jitter error to the largest error of one step; the errors add
# up randomly.
AT_RANDOM = 8.0
JITTER = 1e-6  # rad, attitude error by jitter that needs no warning
FIELD = 6e-5  # T, the largest field that coils meet, near a pole in low orbit
TEXTS = {
    "turn": "turn and nutation in a substep",
    "kick": "turn by the largest torque of {} in a substep",
}
REMEDY = "--substeps auto chooses their number and states the error"


@dataclass(frozen=True)
class WheeledBody:
    """Rigid body with wheels.

    It has the inertia without the wheels' axial part (3, 3; kg m2), the axes of the
    wheels (3, n) and their momentum at the start (n,; N m s).
    """

    carrier: Array
    axes: Array
    h_start: Array
    spacecraft: str = ""  # names of the components of the body and of its wheels
    wheels: str = ""

    def turning(self, omega: Array, h: Array) -> Array:
        """Compute |omega| + nutation (rad/s).

        The states are rates (n, 3) in rad/s and wheel momenta (n, wheels) in N m s.
        """
        momentum = omega @ self.carrier.T + h @ self.axes.T
        nutation = np.einsum("ij,jk,ik->i", momentum, self.carrier, momentum)
        nutation = np.sqrt(nutation / np.linalg.det(self.carrier))
        return np.asarray(np.linalg.norm(omega, axis=1) + nutation)

    def pushed(self, torque: Array) -> Array:
        """Compute the size of the acceleration (rad/s2) by torques (n, 3), N m."""
        return np.asarray(
            np.linalg.norm(np.linalg.solve(self.carrier, torque.T), axis=0)
        )


def body_of(system: System) -> WheeledBody | None:
    """Return the rigid body with wheels of a checked system, or None without one.

    None also where the inertia is not that of a body, which is reported when it starts.
    """
    body = craft_of(system).rigid_body
    if body is None or not body.is_possible:
        return None
    wheels = body.wheels
    return WheeledBody(
        body.carrier,
        body.axes,
        wheels.h_start,
        body.component.name,
        wheels.component.name,
    )


def bound(system: System) -> StepCriteria | None:
    """Compute the two numbers of a checked system before it runs.

    None where there is no rigid body with wheels.
    """
    body = body_of(system)
    return None if body is None else _criteria(system, body)[0]


def _criteria(system: System, body: WheeledBody) -> tuple[StepCriteria, str]:
    """Compute the two numbers, and name the actuator with the largest kick."""
    omega = np.array(
        system.components[body.spacecraft].values.get("omega_start_body", (0.0,) * 3)
    )
    step = system.step / system.parts
    turn = step * float(body.turning(omega[None], body.h_start[None])[0])
    kicks = dict(_kicks(system, body, step))
    actuator = max(kicks, key=lambda name: kicks[name], default="")
    return StepCriteria(turn, kicks.get(actuator, 0.0)), actuator


def _kicks(
    system: System, body: WheeledBody, step: float
) -> Iterator[tuple[str, float]]:
    """Yield each actuator that acts on the body, and its largest turn in a step.

    The turn is in rad.
    """
    for name in sorted(
        {c.source for c in system.connections if c.target == body.spacecraft}
    ):
        torques = np.array(list(_torques(system, name, body)), dtype=float).reshape(
            -1, 3
        )
        if len(torques):
            yield name, step**2 * float(body.pushed(torques).max())


def _torques(system: System, name: str, body: WheeledBody) -> Iterator[Any]:
    """Yield the largest torques (3,; N m, body) of a component."""
    component = system.components[name]
    has, values = component.interface.arrays.keys(), component.values
    if has >= {"inertia_wheel", "torque_limit"}:
        yield from (body.axes * existing(values) * np.array(values["torque_limit"])).T
    if has >= {"m_mean_body", "m_limit"}:
        weakest = np.linalg.eigh(body.carrier)[1][:, 0]
        yield weakest * FIELD * float(np.abs(np.array(values["m_limit"])).max())
    if has >= {"schedule_tau_body"}:
        begin, long = (np.array(values[f"schedule_{n}"]) for n in ("start", "duration"))
        torque = np.array(values["schedule_tau_body"]).reshape(-1, 3)
        for t in begin[long > 0.0]:
            yield torque[(long > 0.0) & (begin <= t) & (t < begin + long)].sum(axis=0)


def jitter(parts: StepParts, speeds: Array, step: float) -> float:
    """Estimate the attitude error (rad) by jitter with wheels at speeds (n, 4; rad/s).

    The body receives the jitter as a mean over a substep of `step` s. The error is
    `AT_RANDOM` times that of a step, unbalance Omega H / J, and less where a step is
    short compared with a turn of the wheel. `parts` are as `applies` returns them.
    """
    fast = np.abs(speeds)
    angle = (fast * np.minimum(1.0, fast * step)).sum(axis=1).max(initial=0.0)
    least = float(np.linalg.eigvalsh(np.array(parts.carrier))[0])
    return float(AT_RANDOM * parts.unbalance * angle * step / least)


def _speeds(parts: StepParts, h: Array) -> Array:
    """Compute speeds (rad/s) of wheels with momenta h (n, 4; N m s).

    The body's rate is neglected.
    """
    spin = np.array(parts.inertia_wheel)
    return np.asarray(np.divide(h, spin, out=np.zeros_like(h), where=spin > 0.0))


def warnings(system: System) -> list[str]:
    """Return a line for each value of a system outside the tested range.

    There is none for a run that chooses its substeps, because the choice checks them
    itself.
    """
    body = None if system.substeps == AUTO else body_of(system)
    if body is None:
        return []
    numbers, actuator = _criteria(system, body)
    lines = [
        _line(TEXTS[name].format(actuator), value, getattr(LIMITS, name))
        for name, value in _beyond(numbers)
    ]
    parts = _step_parts(system, body)
    jitter_error = jitter(
        parts, _speeds(parts, body.h_start[None]), system.step / system.parts
    )
    return lines + _of_jitter(jitter_error, "at the speeds of the start")


def _of_jitter(error: float, condition: str) -> list[str]:
    """Return a line if the attitude error by jitter is not negligible."""
    if error <= JITTER:
        return []
    return [
        f"the jitter of unbalanced wheels is averaged over each substep, which causes "
        f"an attitude error of about {error:.1e} rad, {condition}; {REMEDY}"
    ]


def _beyond(numbers: StepCriteria) -> Iterator[tuple[str, float]]:
    """Yield name and value of each number beyond its limit."""
    for f in fields(StepCriteria):
        if (value := getattr(numbers, f.name)) > getattr(LIMITS, f.name) * (1.0 + 1e-9):
            yield f.name, value


def _line(quantity: str, value: float, limit: float) -> str:
    """Return the warning for a value beyond its limit."""
    return f"{quantity}: {value:.3g} rad, accuracy is shown up to {limit:g} rad only: {REMEDY}"


# --- after a run ----------------------------------------------------------------------


@dataclass(frozen=True)
class Reached:
    """Largest motions of a body at its rows.

    They are its turning (n,; rad/s), the acceleration by actuators from each row to the
    next (n - 1,; rad/s2), and the change of that from each pair to the next (n - 2,;
    rad/s2).
    """

    times: Array
    turning: Array
    pushed: Array
    changed: Array

    def largest(self) -> tuple[float, float, float]:
        """Return the largest value of each of the three."""
        return (
            float(self.turning.max(initial=0.0)),
            float(self.pushed.max(initial=0.0)),
            float(self.changed.max(initial=0.0)),
        )


def reached_by(
    body: WheeledBody, times: Array, q: Array, omega: Array, h: Array, impulse: Array
) -> Reached:
    """Compute the motions of a body from its states at times (n,; s).

    These are attitude (n, 4), rate (n, 3; rad/s), momenta of the wheels (n, k; N m s)
    and external impulse until then (n, 3; N m s, eci).
    """
    seconds = np.diff(times)[:, None]
    torque = rotate(q[:-1], np.diff(impulse, axis=0) / seconds)
    torque = torque - np.diff(h, axis=0) / seconds @ body.axes.T
    return Reached(
        times,
        body.turning(omega, h),
        body.pushed(torque),
        body.pushed(np.diff(torque, axis=0)),
    )


@dataclass(frozen=True)
class StepParts(Parts):
    """Series to inspect after a run, and the body, as lists."""

    series: list[str]
    axes_wheel: list[list[float]]
    carrier: list[list[float]]
    inertia_wheel: list[float]
    unbalance: float


PARTS = StepParts


def applies(system: System) -> StepParts | None:
    """Find the series to inspect after a run and the body, or None without wheels."""
    body = body_of(system)
    return None if body is None else _step_parts(system, body)


def _step_parts(system: System, body: WheeledBody) -> StepParts:
    """Collect the series to inspect after a run, and the parameters of the body."""
    craft, wheels = body.spacecraft, system.components[body.wheels]
    series = [
        f"{craft}.q_bi",
        f"{craft}.omega_bi_body",
        system.fed[craft, "h_wheel"].series,
        f"{craft}.impulse_eci",
    ]
    spin = system.components[craft].values["inertia_wheel"]
    return StepParts(
        series,
        body.axes.tolist(),
        body.carrier.tolist(),
        spin,
        float(np.max(wheels.values.get("unbalance", 0.0))),
    )


def of_run(parts: StepParts | None, results: Results) -> Reached | None:
    """Compute the motions of a run.

    None where there is no such body, or series are missing.
    """
    if parts is None or not set(parts.series) <= set(results.names()):
        return None
    times = results.times(parts.series[0])
    if len(times) < 3:
        return None
    body = WheeledBody(np.array(parts.carrier), np.array(parts.axes_wheel), np.zeros(4))
    parts_reached = [
        reached_by(body, times[rows], *(results.values(n, rows) for n in parts.series))
        for rows in blocks(len(times), 2)
    ]
    # each motion has a row less than the one before; blocks have two rows in common
    turning_rows = [f.turning[: len(f.turning) - 2] for f in parts_reached[:-1]]
    kick_rows = [f.pushed[: len(f.pushed) - 1] for f in parts_reached[:-1]]
    return Reached(
        times,
        np.concatenate([*turning_rows, parts_reached[-1].turning]),
        np.concatenate([*kick_rows, parts_reached[-1].pushed]),
        np.concatenate([f.changed for f in parts_reached]),
    )


def numbers(manifest: Manifest, results: Results) -> dict[str, Value]:
    """Return substeps and expected error (rad) of a run that chose its substeps."""
    choice = manifest.substep_choice
    if choice is None:
        return {}
    rows = {"substeps": Value("Substeps, chosen", manifest.substeps, "1")}
    if choice.estimate is not None:
        title = "Largest attitude error due to the substeps (estimated)"
        rows["estimated_attitude_error"] = Value(title, choice.estimate, "rad")
    return rows


def remarks(manifest: Manifest, results: Results) -> list[str]:
    """Return a line for each value of a run outside the tested range.

    A run that has chosen its substeps has a line if its choice could not be checked
    again.
    """
    choice, parts = manifest.substep_choice, manifest.parts[KEY]
    if choice is not None and choice.estimate is not None:
        lacking = set(parts.series if parts else ()) - set(results.names())
        if choice.reached is None or not lacking:
            return []
        return [
            f"its substeps are chosen by its first {choice.steps} steps, and not looked "
            f"at again: not recorded: {', '.join(sorted(lacking))}"
        ]
    if manifest.algorithm != "gauss_seidel":
        return []
    flight_seen = of_run(parts, results)
    if flight_seen is None:
        return []
    step = manifest.step / manifest.substeps
    rows = (
        ("turn", step * flight_seen.turning, LIMITS.turn),
        ("kick", step**2 * flight_seen.pushed, TOGETHER),
    )
    lines = []
    for name, values, limit in rows:
        k = int(values.argmax())
        if values[k] > limit * (1.0 + 1e-9):
            at = f"at t = {flight_seen.times[k]:g} s, {TEXTS[name].format('all actuators')}"
            lines.append(_line(at, float(values[k]), limit))
    wheels = parts.series[2]
    first_error, *errors = (
        jitter(parts, _speeds(parts, results.values(wheels, rows)), step)
        for rows in (slice(0, 1), *blocks(len(flight_seen.times)))
    )
    error = max(errors)
    return lines + (
        _of_jitter(error, "at their largest speeds")
        if error > 2.0 * first_error
        else []
    )
