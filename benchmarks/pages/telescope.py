"""What pages of paper 001 measure beside its runs: figure 2, and what a law computes
onboard."""

from __future__ import annotations

import dis
import sys
from collections.abc import Callable, Sequence
from functools import cache
from types import CodeType, FrameType
from typing import Any

import numpy as np

from desat.analyses.coil_bound import course_of
from desat.analyses.manifest import Manifest
from desat.components.maths.attitude import normalise, rotate
from desat.engine.recording.results import Results
from desat.system.model import System
from desat.system.parameters import bare_block

# ------------------------------------------------------------------------------------------------
# Figure 2 of paper 001 as measured: what an open-loop law does for desaturation periods of
# several lengths, on the field of a run
# Over a period the torque is T_M(t) = G(t) P, P = Q^-1 H_D, with G = [B]'S[B] and Q its integral.
# How ill Q is, how much larger than H_D over the period T_M is, and how far it turns away from H_D,
# is taken over periods that begin all along the run, and H_D over directions spread evenly.


STARTS, DIRECTIONS = 48, 200


def study(
    manifest: Manifest, results: Results, periods: Sequence[float]
) -> list[dict[str, float]]:
    """Of each period (s) `condition` of Q (1, median over begins, inf where singular),
    `condition_most`, `torque` (1, largest |T_M| times period over |H_D|) and `swing` (1, largest
    |integral of T_M| so far over |H_D|), both in the direction of H_D where that is most, and
    `angle` (deg, largest of T_M to H_D over period and directions); medians over begins."""
    course, *_ = course_of(manifest, results)
    b = course.field
    skew = np.zeros((len(b), 3, 3))  # [B] v = B x v
    skew[:, 0, 1], skew[:, 0, 2], skew[:, 1, 2] = -b[:, 2], b[:, 1], -b[:, 0]
    skew -= skew.transpose(0, 2, 1)
    product = skew.transpose(0, 2, 1) @ course.weighting @ skew
    expected = _directions(DIRECTIONS)
    entries = []
    for period in periods:
        count = round(period / course.dt)
        begins = np.unique(np.linspace(0, len(product) - count, STARTS).astype(int))
        rows = [_period(product[k : k + count], expected) for k in begins]
        conditions, torques, swings, angles = zip(*rows, strict=True)
        entries.append(
            {
                "period": float(period),
                "condition": float(np.median(conditions)),
                "condition_most": float(max(conditions)),
                "torque": float(np.median(torques)),
                "swing": float(np.median(swings)),
                "angle": float(np.median(angles)),
            }
        )
    return entries


def _period(product: Any, expected: Any) -> tuple[float, float, float, float]:
    """Condition, largest torque, swing and angle of a period; nan where Q is singular."""
    full = product.sum(axis=0)
    condition = float(np.linalg.cond(full))
    if condition > 1e12:
        return float("inf"), float("nan"), float("nan"), float("nan")
    gains = product @ np.linalg.inv(full) * len(product)  # T_M of H_D, times the period
    torque = gains @ expected.T
    size = np.linalg.norm(torque, axis=1)
    cosine = (torque * expected.T).sum(axis=1) / size
    largest = float(np.linalg.norm(gains, 2, axis=(1, 2)).max())
    so_far = np.cumsum(gains, axis=0) / len(product)
    swing = float(np.linalg.norm(so_far, 2, axis=(1, 2)).max())
    return (
        condition,
        largest,
        swing,
        float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).max()),
    )


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
    """Multiplications and divisions a second of a manager's law (without the wheels'
    part), at a craft at rest in the attitude of its guidance, over an hour. Indices of
    tables count as well: some ten a sample."""
    names = ("manager", "environment", "guidance")
    manager, environment, guidance = blocks = [
        bare_block(system.components[n]) for n in names
    ]
    for block in blocks:
        block.start()
    manager.q_bi = q = normalise(guidance.q_target_bi)
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
        i.offset
        for i in dis.get_instructions(code)
        if i.opname == "BINARY_OP" and i.argrepr in COUNTED
    )
