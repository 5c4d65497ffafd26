"""What a law of momentum management computes onboard: multiplications and divisions, as its block
is written, counted while it runs through the samples of an hour."""

from __future__ import annotations

import dis
import sys
from collections.abc import Callable
from functools import cache
from types import CodeType, FrameType
from typing import Any

from desat.components.contract.block import Block
from desat.components.maths.attitude import normalised, rotate
from desat.fmus.registry import block_class

from ...system.model import Component, System

HOUR = 3600.0
COUNTED = ("*", "/", "*=", "/=")


def work(system: System) -> float:
    """Multiplications and divisions a second of a manager's law (without the wheels' part), at a
    craft at rest in the attitude of its guidance, over an hour. Indices of tables count as well:
    some ten a sample."""
    manager, environment = _bare(system.components["manager"]), _bare(
        system.components["environment"]
    )  # fmt: skip
    guidance = _bare(system.components["guidance"])
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


def _bare(component: Component) -> Any:
    """The block of a component with its parameters, started."""
    block: Block = block_class(component.interface.model)()
    signals = component.interface.signals
    references = [signals[n].reference for n in component.parameters]
    block.access(references).write(list(component.parameters.values()))
    block.check()
    block.start()
    return block
