"""Numbers of momentum management by coils (paper 001): what its claims are judged by.

Of a run the first quarter is left out. The periodic part of a momentum is what a least-squares fit
of cos and sin of twice the orbital rate, beside a straight line, finds in it: gravity gradient at
an inertial attitude makes that, and a secular part.
"""

from __future__ import annotations

import dis
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from types import CodeType, FrameType
from typing import Any

import numpy as np

from desat.components.maths.attitude import normalised, rotate
from desat.components.physics.orbit import mean_motion

from ...engine.recording.results import Results
from ...numbers.derived import rotate_back
from ...numbers.text import Value
from ...system.model import System
from ...system.parameters import bare_block
from .. import Parts
from ..coil_bound import course_of
from ..manifest import Manifest

KEY = "unloading"
SPEEDS = (100, 200, 300)
"""rpm, above which the time of the fastest wheel is counted."""
RPM = 30.0 / np.pi
NUMBERS = (
    *(f"time_above_{s}" for s in SPEEDS), "moved_by_coils", "moved_by_gravity",
    "mean_momentum", "mean_change", "amplitude_kept", "dipole_correlation", "off_profile",
    "field_models", "end_miss",
)  # fmt: skip
SIGNALS = (
    "spacecraft.q_bi", "spacecraft.impulse_eci", "environment.b_eci", "torquers.m_mean_body",
    "manager.tau_desired_body", "wheels.speed_wheel",
)  # fmt: skip


@dataclass(frozen=True)
class TelescopeParts(Parts):
    """Which component manages."""

    manager: str = "manager"


PARTS = TelescopeParts


def applies(system: System) -> TelescopeParts | None:
    """Systems whose manager says its desired torque, with the components of a craft with coils."""
    for signal in SIGNALS:
        name, _, output = signal.partition(".")
        component = system.components.get(name)
        if component is None or not component.interface.elements.get(output, ()):
            return None
    return TelescopeParts()


def signals(parts: TelescopeParts) -> list[str]:
    """The series that the numbers are made of."""
    return list(SIGNALS)


def numbers(manifest: Manifest, results: Results) -> dict[str, Value]:
    """Of a completed run of two orbits or more; none where a series is not recorded."""
    if not manifest.completed or not set(SIGNALS) <= set(results.names()):
        return {}
    law = manifest.values_of("manager")
    q, impulse, field, dipole, wanted, speed = (results.values(s) for s in SIGNALS)
    step = manifest.step
    rate = mean_motion(float(manifest.values_of("environment")["semi_major_axis"]))
    orbit = 2.0 * np.pi / rate
    rows = len(dipole)  # interval outputs have no row at the end
    if rows * step < 2.0 * orbit:
        return {}
    first = rows // 4
    turned = (field[:-1] + field[1:])[:rows] / 2.0
    torque = np.cross(rotate_back(_unit(q[:-1] + q[1:])[:rows], dipole), turned)
    moved = np.diff(impulse[: rows + 1], axis=0)
    gravity = moved - step * torque
    fastest = np.abs(speed[first:rows]).max(axis=1) * RPM
    entries = {
        f"time_above_{s}": (f"Time that the fastest wheel is above {s} rpm",
                            100.0 * float((fastest > s).mean()), "%") for s in SPEEDS
    }  # fmt: skip
    count = rows - first
    per_orbit = orbit / (count * step)
    entries["moved_by_coils"] = (
        "Momentum that the coils move per orbit: integral of the size of their torque",
        per_orbit * step * float(np.linalg.norm(torque[first:], axis=1).sum()), "N.m.s",
    )  # fmt: skip
    entries["moved_by_gravity"] = (
        "Momentum that gravity gradient moves per orbit, likewise",
        per_orbit * float(np.linalg.norm(gravity[first:], axis=1).sum()), "N.m.s",
    )  # fmt: skip
    whole = int(orbit / step)
    means = [impulse[k : k + whole].mean(axis=0) for k in range(first, rows - whole + 1, whole)]
    entries["mean_change"] = (
        "Change of the orbit's mean momentum from one to the next, mean size",
        float(np.linalg.norm(np.diff(means, axis=0), axis=1).mean()) if means[1:] else np.nan,
        "N.m.s",
    )
    entries["mean_momentum"] = (
        "Size of the mean momentum",
        float(np.linalg.norm(impulse[first:rows].mean(axis=0))),
        "N.m.s",
    )
    times = step * np.arange(first, rows)
    built = np.cumsum(gravity, axis=0)[first:]
    ours, free = (_periodic(times, x, rate) for x in (impulse[first + 1 : rows + 1], built))
    entries["amplitude_kept"] = (
        "Periodic part of the momentum, of that which gravity gradient alone makes",
        100.0 * float(ours / free), "%",
    )  # fmt: skip
    held = max(1, round(law["sample_time"] / step))
    part = slice(first + held // 2, rows, held)  # the middle of a hold
    b = _to_body(q[part], turned[part])
    size, across = (np.linalg.norm(x, axis=1) for x in (dipole[part], np.cross(wanted[part], b)))
    sine = across / np.maximum(np.linalg.norm(wanted[part], axis=1)
                               * np.linalg.norm(b, axis=1), 1e-300)  # fmt: skip
    if size.std() > 0.0 and sine.std() > 1e-3:
        entries["dipole_correlation"] = (
            "Correlation of the dipole's size with the sine of the angle of T_D to B",
            float(np.corrcoef(size, sine)[0, 1]), "1",
        )  # fmt: skip
    if "desaturation_period" in law:  # one for the dipole of a sample, and those of a solution
        each = law["desaturation_period"] / law["sample_time"] / law["update_period"]
        models = 3600.0 * (1.0 / law["sample_time"] + each)
    else:
        models = 0.0
    entries["field_models"] = ("Values of a field model onboard per hour", models, "1")
    if "profile_table" in law:
        entries["off_profile"] = ("Momentum off H_NOM at its rows, rms of its size",
                                  _off_profile(law, impulse[: rows + 1], step, first),
                                  "N.m.s")  # fmt: skip
    if "update_period" in law and law["update_period"] == law["desaturation_period"]:
        entries["end_miss"] = ("What the ends of desaturation periods miss H_NOM by, rms, of H_D's",
                               _end_miss(law, impulse, wanted, q, step), "%")  # fmt: skip
    return {name: Value(*row) for name, row in entries.items() if np.isfinite(row[1])}


def _to_body(q: Any, v: Any) -> Any:
    """Rows of v (eci) in the body's axes."""
    return rotate_back(q * np.array([-1.0, -1.0, -1.0, 1.0]), v)


def _periodic(times: Any, momentum: Any, rate: float) -> float:
    """The size of the periodic part (N m s)."""
    phase = 2.0 * rate * times
    form = np.stack([np.ones_like(times), times, np.cos(phase), np.sin(phase)], axis=1)
    return float(np.linalg.norm(np.linalg.lstsq(form, momentum, rcond=None)[0][2:]))


def _off_profile(given: dict[str, Any], impulse: Any, step: float, first: int) -> float:
    """How far the momentum (rows, 3) is off the rows of H_NOM."""
    nodes = int(given["table_nodes"])
    table = np.reshape(given["profile_table"], (-1, 3))[:nodes]
    rows = np.round(given["table_spacing"] * np.arange(nodes) / step).astype(int)
    kept = (rows >= first) & (rows < len(impulse))
    return float(np.sqrt(((impulse[rows[kept]] - table[kept]) ** 2).sum(axis=1).mean()))


def _end_miss(law: dict[str, Any], impulse: Any, wanted: Any, q: Any, step: float) -> float:
    """Where a desaturation period ends: rms of |H - H_NOM| over that of |H_D|, in %; H_D is the
    integral of the torque that is meant (eq. 3)."""
    period = law["update_period"]
    rows, nodes = round(period / step), round(period / law["table_spacing"])
    if abs(nodes * law["table_spacing"] - period) > 1e-6:
        return float("nan")
    meant = rotate_back(q[: len(wanted)], wanted) * step
    table = np.reshape(law["profile_table"], (-1, 3))
    ends = range(rows, len(wanted) + 1, rows)
    missed = [impulse[k] - table[k // rows * nodes] for k in ends]
    dumped = [meant[k - rows : k].sum(axis=0) for k in ends]
    return 100.0 * float(np.linalg.norm(missed) / np.linalg.norm(dumped))


def _unit(q: Any) -> Any:
    return q / np.linalg.norm(q, axis=1, keepdims=True)


# ------------------------------------------------------------------------------------------------
# Figure 2 of paper 001 as measured: what an open-loop law does for desaturation periods of
# several lengths, on the field of a run
# Over a period the torque is T_M(t) = G(t) P, P = Q^-1 H_D, with G = [B]'S[B] and Q its integral.
# How ill Q is, how much larger than H_D over the period T_M is, and how far it turns away from H_D,
# is taken over periods that begin all along the run, and H_D over directions spread evenly.


STARTS, DIRECTIONS = 48, 200


def study(
    manifest: Manifest, results: Results, periods: Sequence[float]
) -> list[dict[str, float]]:  # fmt: skip
    """Of each period (s) `condition` of Q (1, median over begins, inf where singular),
    `condition_most`, `torque` (1, largest |T_M| times period over |H_D|) and `swing` (1, largest
    |integral of T_M| so far over |H_D|), both in the direction of H_D where that is most, and
    `angle` (deg, largest of T_M to H_D over period and directions); medians over begins."""
    course, _ = course_of(manifest, results)
    b = course.field
    skew = np.zeros((len(b), 3, 3))  # [B] v = B x v
    skew[:, 0, 1], skew[:, 0, 2], skew[:, 1, 2] = -b[:, 2], b[:, 1], -b[:, 0]
    skew -= skew.transpose(0, 2, 1)
    product = skew.transpose(0, 2, 1) @ course.weighting @ skew
    wanted = _directions(DIRECTIONS)
    entries = []
    for period in periods:
        count = round(period / course.dt)
        begins = np.unique(np.linspace(0, len(product) - count, STARTS).astype(int))
        rows = [_period(product[k : k + count], wanted) for k in begins]
        conditions, torques, swings, angles = zip(*rows, strict=True)
        entries.append({
            "period": float(period), "condition": float(np.median(conditions)),
            "condition_most": float(max(conditions)), "torque": float(np.median(torques)),
            "swing": float(np.median(swings)), "angle": float(np.median(angles)),
        })  # fmt: skip
    return entries


def _period(product: Any, wanted: Any) -> tuple[float, float, float, float]:
    """Condition, largest torque, swing and angle of a period; nan where Q is singular."""
    whole = product.sum(axis=0)
    condition = float(np.linalg.cond(whole))
    if condition > 1e12:
        return float("inf"), float("nan"), float("nan"), float("nan")
    gains = product @ np.linalg.inv(whole) * len(product)  # T_M of H_D, times the period
    torque = gains @ wanted.T
    size = np.linalg.norm(torque, axis=1)
    cosine = (torque * wanted.T).sum(axis=1) / size
    largest = float(np.linalg.norm(gains, 2, axis=(1, 2)).max())
    so_far = np.cumsum(gains, axis=0) / len(product)
    swing = float(np.linalg.norm(so_far, 2, axis=(1, 2)).max())
    return condition, largest, swing, float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).max())


def _directions(count: int) -> Any:
    """Directions (count, 3) spread evenly: a spiral from pole to pole."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    across = np.sqrt(1.0 - z * z)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)


# ------------------------------------------------------------------------------------------------
# What a law of momentum management computes onboard: multiplications and divisions, as its block
# is written, counted while it runs through the samples of an hour


HOUR = 3600.0
COUNTED = ("*", "/", "*=", "/=")


def work(system: System) -> float:
    """Multiplications and divisions a second of a manager's law (without the wheels' part), at a
    craft at rest in the attitude of its guidance, over an hour. Indices of tables count as well:
    some ten a sample."""
    names = ("manager", "environment", "guidance")
    manager, environment, guidance = blocks = [bare_block(system.components[n]) for n in names]
    for block in blocks:
        block.start()
    manager.q_bi = q = normalised(guidance.q_target_bi)
    manager.h_wheel = (5.0, -3.0, 8.0, 2.0)
    counter = _Counter()
    manager.dump = counter.counting(manager.dump)
    dt, t = manager.sample_time, 0.0
    while t < HOUR - 1e-6:
        r, v = (environment.to_eci(x) for x in environment.motion(t))
        manager.r_eci, manager.v_eci = r, v
        manager.b_body = rotate(q, environment.field_eci(r, t, False))
        manager.advance(t, dt)
        t += dt
    return counter.count / HOUR


class _Counter:
    """Counts the multiplications of what it wraps, by the interpreter's own operations."""

    def __init__(self) -> None:
        self.count = 0

    def counting(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, counted."""

        def counted(*arguments: Any) -> Any:
            before = sys.gettrace()
            sys.settrace(self._trace)
            try:
                return function(*arguments)
            finally:
                sys.settrace(before)

        return counted

    def _trace(self, frame: FrameType, event: str, _: Any) -> Any:
        frame.f_trace_opcodes, frame.f_trace_lines = True, False
        if event == "opcode" and frame.f_lasti in _products(frame.f_code):
            self.count += 1
        return self._trace


@cache
def _products(code: CodeType) -> frozenset[int]:
    """Where in a code there is a multiplication or division."""
    return frozenset(
        i.offset for i in dis.get_instructions(code)
        if i.opname == "BINARY_OP" and i.argrepr in COUNTED
    )  # fmt: skip
