"""What is known before a run: values outside of what is usual, and what blocks of ours foresee.

A block foresees (`Block.foresee`) with its parameters and the times of the run: where it leaves the
range in which its model holds, and what it lacks to be of use. Another FMU says nothing of that.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache, lru_cache

from desat.components.contract.block import Block, BlockError, Scalar
from desat.fmus.registry import block_class, names

from .interface import base_name, of_block
from .model import Component, System
from .refusal import REFUSES, told
from .unwired import Unwired


def foreseen(system: System, open_ends: dict[str, Unwired]) -> tuple[list[str], list[str]]:
    """Problems and warnings, a line each."""
    problems: list[str] = []
    warnings: list[str] = []
    for c in system.components.values():
        warnings += _unusual(c, system.where)
        problems += _no_attitudes(c, system.where)
        if not _foresees(c):
            continue
        ends = open_ends[c.name]
        left = {*ends.inputs_at_default, *ends.outputs_unread}
        wired = frozenset({base_name(s.name) for s in c.interface.signals.values()} - left)
        given = tuple((c.interface.signals[n].reference, x) for n, x in c.parameters.items())
        lines, refusal = _of_block(c.interface.model, given, system.start, system.stop, wired)
        for line in lines:
            warnings += told(system, f"{c.name}: {REFUSES}{line}")
        problems += told(system, f"{c.name}: {REFUSES}{refusal}") if refusal else []
    return list(dict.fromkeys(problems)), list(dict.fromkeys(warnings))


def _unusual(c: Component, where: str) -> Iterator[str]:
    """A line a variable with values that are allowed, but outside of what is usual."""
    told_of: set[str] = set()
    for name, value in c.parameters.items():
        signal, base = c.interface.signals[name], base_name(name)
        if signal.usual is None or base in told_of:
            continue
        low, high = signal.usual
        if not low <= value <= high:
            told_of.add(base)
            unit = f" {signal.unit_name}" if signal.unit_name not in ("", "1") else ""
            yield (f"{c.given.get(base, where)}: {c.name}.{name} = {value:g}{unit}: usual is "
                   f"{low:g} to {high:g}{unit}")  # fmt: skip


def _no_attitudes(c: Component, where: str) -> Iterator[str]:
    """A line a quaternion (q_..., scalar last) that is zero: it is no attitude."""
    for name in {base_name(n) for n in c.parameters if n.startswith("q_")}:
        values = [c.parameters.get(s.name, s.start) for s in c.interface.elements(name)]
        if len(values) == 4 and not any(values):
            yield (f"{c.given.get(name, where)}: {c.name}.{name} = (0, 0, 0, 0): a quaternion of "
                   "size 0 is no attitude; (0, 0, 0, 1) is none turned")  # fmt: skip


def _foresees(c: Component) -> bool:
    """Whether a component is of a block of ours, with that one's variables, that foresees."""
    model = c.interface.model
    if model not in names() or block_class(model).foresee is Block.foresee:
        return False
    return c.interface.signals.keys() == _variables(model)


@cache
def _variables(model: str) -> frozenset[str]:
    return frozenset(of_block(model, block_class(model)).signals)


@lru_cache(maxsize=256)
def _of_block(
    model: str, given: tuple[tuple[int, Scalar], ...], begin: float, end: float,
    wired: frozenset[str],
) -> tuple[tuple[str, ...], str]:  # fmt: skip
    """What a block foresees with the values of its variables by number, and what it refuses.
    Nothing where it does not start: that is told when it does."""
    block = block_class(model)()
    block.access([k for k, _ in given]).write([x for _, x in given])
    try:
        block.check()
        block.start()
    except Exception:
        return (), ""
    lines: list[str] = []
    try:
        lines += block.foresee(begin, end, wired)
    except BlockError as error:
        return tuple(lines), str(error)
    return tuple(lines), ""
