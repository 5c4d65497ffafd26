"""A plan as the operations of the compiled loop, one by one: the layouts of loop.c."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, cast

import numpy as np

from .instances.fmu import FmuInstance
from .instances.isolated import IsolatedInstance
from .operations import Call, Cut, Gather, Join, Keep, Length, Operation, Show, Step, Tick

CODES = ("TICK", "LENGTH", "TAKE_8", "TAKE_4", "CONVERT", "TRANSFER", "STEP", "COPY", "CLEAR",
          "JOIN", "CUT", "PUT_R", "PUT_I", "PUT_B", "FETCH_R", "FETCH_I", "FETCH_B",
          "KEEP")  # fmt: skip
_CODE = {name: i for i, name in enumerate(CODES)}


class NotCompiledError(Exception):
    """An operation that the compiled loop does not have; the text names it."""


class _Operation(ctypes.Structure):
    _fields_ = (
        ("code", ctypes.c_int32), ("more", ctypes.c_int32), ("n", ctypes.c_int64),
        ("word", ctypes.c_int64),
        ("p", ctypes.c_void_p * 6), ("x", ctypes.c_double * 3),
    )  # fmt: skip


_Row = tuple[str, int, Sequence[Any], Sequence[float]]
"""code, n, pointers (arrays, ctypes objects or addresses), numbers"""


class Program:
    """The operations of a cycle in one array; `edges` (2 steps + 1,) says where those before and
    after each step's row begin."""

    def __init__(self, cycle: Sequence[Step]) -> None:
        self._keep: list[Any] = []  # an array that nobody else holds
        self._sources: list[Operation] = []
        rows: list[tuple[_Row, bool]] = []
        edges = [0]
        for step in cycle:
            for operations in step:
                for operation in operations:
                    made = list(_rows(operation))
                    rows += [(row, row is not made[-1]) for row in made]
                    self._sources += [operation] * len(made)
                edges.append(len(rows))
        self.edges = np.array(edges, np.int64)
        self.operations = (_Operation * len(rows))()
        for i, ((code, n, pointers, numbers), more) in enumerate(rows):
            place = self.operations[i]
            place.code, place.n, place.more = _CODE[code], n, more and code in ("TRANSFER", "STEP")
            place.word = getattr(self._sources[i], "word", 0)
            place.p[: len(pointers)] = [self._address(p) for p in pointers]
            place.x[: len(numbers)] = numbers

    def source(self, i: int) -> Operation:
        """What operation i was made of."""
        return self._sources[i]

    def _address(self, of: Any) -> int:
        if isinstance(of, int):
            return of
        self._keep.append(of)
        if isinstance(of, np.ndarray):
            assert of.flags.c_contiguous
            return int(of.ctypes.data)
        return ctypes.addressof(of)


def _rows(operation: Operation) -> Iterator[_Row]:
    """An operation in those of loop.c."""
    match operation:
        case Tick():
            for clock in operation.clocks:
                yield "TICK", 1, (clock,), (operation.at,)
        case Length():
            yield "LENGTH", 1, (operation.of,), (operation.value,)
        case Gather():
            yield _gather(operation)
        case Call():
            yield from _calls(operation)
        case Show(live, fresh):
            yield "COPY", fresh.nbytes, (live, fresh), ()
        case Join(whole, i):
            if i == 0:
                yield from (("CLEAR", len(x), (x,), ()) for x in (whole.mean, whole.slope))
            source, n = whole.source, len(whole.mean)
            sums = (whole.mean, whole.slope)
            yield "JOIN", n, (whole.live, source.means, source.slopes, *sums), whole.weights[i]
            if i == len(whole.weights) - 1:
                kept = np.flatnonzero(whole.target.slopes >= 0)
                every, slopes = np.arange(n), whole.target.slopes[kept]
                yield "TAKE_8", n, (whole.into, whole.target.means, whole.mean, every), ()
                yield "TAKE_8", len(kept), (whole.into, slopes, whole.slope, kept), ()
        case Cut(part, i):
            source, target = part.source, part.target
            places = (source.means, source.slopes, target.means, target.slopes)
            yield "CUT", len(source.means), (part.live, *places), part.weights[i]
        case Keep(source, index, rows, taken):
            yield "KEEP", len(index), (rows, taken, source, index), ()
        case _:
            raise NotCompiledError(f"{type(operation).__name__} is not compiled")


def _gather(g: Gather) -> _Row:
    into = np.arange(len(g.target)) if g.into is None else g.into
    pointers = (g.target, into, g.source, g.index)
    if g.conversion is None:
        return "TAKE_8" if g.kind == "Real" else "TAKE_4", len(into), pointers, ()
    if g.kind != "Real":
        raise NotCompiledError(f"a connection converts values of type {g.kind}")
    return "CONVERT", len(into), (*pointers, *g.conversion), ()


def _calls(call: Call) -> Iterator[_Row]:
    instance = call.instance
    if isinstance(instance, IsolatedInstance):
        raise NotCompiledError(f"{instance.name} runs in a process of its own")
    if not isinstance(instance, FmuInstance):
        raise NotCompiledError(f"{instance.name} is not run as an FMU")
    if call.verb not in instance.prepared:
        raise NotCompiledError(f"the steps of {instance.name} may be halved")
    for i, prepared in enumerate(instance.prepared[call.verb]):
        function = ctypes.cast(cast(Any, prepared.func), ctypes.c_void_p).value
        if call.verb == "step":
            component, t, dt, _ = prepared.args
            yield "STEP", 1, (function, component.value, t, dt), ()
        else:
            component, references, n, values = prepared.args
            if direct := instance.places[call.verb][i]:
                kind, places = direct
                if call.verb == "pull" and kind == "R" and _side_by_side(places):
                    yield "COPY", 8 * n.value, (values.value, places[0]), ()
                    continue
                code = f"{'PUT' if call.verb == 'push' else 'FETCH'}_{kind}"
                yield code, n.value, (places, values.value), ()
                continue
            pointers = (function, component.value, references.value, values.value)
            yield "TRANSFER", n.value, pointers, ()


def _side_by_side(places: Sequence[int]) -> bool:
    """Whether Reals at these addresses follow each other."""
    return all(b - a == 8 for a, b in pairwise(places))
