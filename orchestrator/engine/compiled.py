"""Step a master's plan in C (loop.c), which is built once into the user's cache.

The result has the same bits as that of `Master.advance`. The loop needs a C compiler,
and all components must be FMUs. Where it is not available, `NotCompiledError` gives the
reason, and the master's own loop steps.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import shlex
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from desat.fmus.compiler import NoCompilerError, compiler

from ..files import paths
from ..system.choices import Loop
from ..system.interface import KINDS
from . import current_call
from .ending import Ending
from .instances.fmi_versions import NOT_COMPILED
from .instances.fmu import FmuInstance
from .instances.isolated import IsolatedInstance
from .master import Master
from .operations import (
    Accumulate,
    Call,
    Gather,
    KeepRow,
    Length,
    Operation,
    Publish,
    Split,
    Step,
    Tick,
)
from .recording.recorder import Recorder
from .recording.row_buffer import Bank

SOURCE = Path(__file__).with_name("loop.c")
FLAGS = ("-std=c11", "-O3", "-ffp-contract=off", "-fPIC", "-shared")
_ENDING_KINDS = ("never", "below", "above", "reaches", "always")
_LOOK, _FAILED, _NOT_FINITE = range(3)


class _CompiledTable(ctypes.Structure):
    """Table of recorded rows of one type, in the layout of `desat_table` in loop.c."""

    _fields_ = (
        ("source", ctypes.c_void_p),
        ("rows", ctypes.c_void_p),
        ("bytes", ctypes.c_int64),
    )


class _Loop(ctypes.Structure):
    """State of the loop, in the layout of `desat_loop` in loop.c."""

    _fields_ = (
        ("k", ctypes.c_int64),
        ("process", ctypes.c_int64),
        ("word", ctypes.c_void_p),
        ("time", ctypes.c_void_p),
        ("start", ctypes.c_double),
        ("step", ctypes.c_double),
        ("steps", ctypes.c_int64),
        ("edges", ctypes.c_void_p),
        ("operations", ctypes.c_void_p),
        ("failed", ctypes.c_int64),
        ("status", ctypes.c_int64),
        ("warned", ctypes.c_void_p),
        ("warnings", ctypes.c_int64),
        ("real", ctypes.c_void_p),
        ("reals", ctypes.c_int64),
        ("ahead", ctypes.c_int64),
        ("capacity", ctypes.c_int64),
        ("taken", ctypes.c_void_p),
        ("times", ctypes.c_void_p),
        ("tables", ctypes.c_int64),
        ("table", _CompiledTable * len(KINDS)),
        ("how", ctypes.c_int64),
        ("watched", ctypes.c_int64),
        ("asked", ctypes.c_int64),
        ("places", ctypes.c_void_p),
        ("watched_reals", ctypes.c_void_p),
        ("watched_integers", ctypes.c_void_p),
        ("limit", ctypes.c_double),
    )


class CompiledSteps:
    """Steps of an initialised master in C.

    Raises NotCompiledError if the steps cannot be compiled.
    """

    name: Loop = "compiled"
    reason = ""
    seconds = 0.0

    def __init__(
        self, master: Master, recorder: Recorder | None, ending: Ending
    ) -> None:
        """Translate the cycle of a master to a program of the compiled loop."""
        self._run, self._master, self._recorder = (
            _library().desat_loop,
            master,
            recorder,
        )
        self._program = _program(master)
        real = master.live["Real"]
        self._warned = np.zeros(len(self._program.operations), np.int64)
        foreign = any(
            getattr(m.instance, "foreign", False) for m in master.members.values()
        )
        self._loop = _Loop(
            process=os.getpid() if foreign else 0,
            word=current_call.address(current_call.word),
            time=current_call.address(current_call.time),
            start=master.start,
            step=master.step_size,
            steps=len(master.cycle),
            edges=self._program.edges.ctypes.data,
            operations=ctypes.addressof(self._program.operations),
            warned=self._warned.ctypes.data,
            real=real.ctypes.data,
            reals=len(real),
            ahead=master.ahead,
        )
        if recorder is not None:
            self._record(master, recorder)
        self._watch(master, ending)

    def _record(self, master: Master, recorder: Recorder) -> None:
        """Set the arrays from which rows are taken."""
        loop, rows = self._loop, recorder.unwritten.active.rows
        loop.tables = len(rows)
        for place, kind in zip(loop.table, rows, strict=False):
            place.source, place.bytes = (
                master.row[kind].ctypes.data,
                rows[kind].strides[0],
            )

    def _aim(self, half: Bank) -> None:
        """Set the arrays to which rows are written."""
        loop = self._loop
        loop.taken, loop.times = half.taken.ctypes.data, half.times.ctypes.data
        loop.capacity = len(half.times)
        for place, rows in zip(loop.table, half.rows.values(), strict=False):
            place.rows = rows.ctypes.data

    def _watch(self, master: Master, ending: Ending) -> None:
        """Set the condition at which the loop returns to evaluate the ending."""
        loop = self._loop
        self._places = np.array([s.index for s in ending.watched], np.int64)
        loop.how, loop.limit, loop.asked = (
            _ENDING_KINDS.index(ending.kind),
            ending.limit,
            1,
        )
        loop.watched, loop.places = len(self._places), self._places.ctypes.data
        if ending.watched:
            kind = ending.watched[0].kind
            of = "watched_reals" if kind == "Real" else "watched_integers"
            setattr(loop, of, master.live[kind].ctypes.data)

    def some(self, most: int) -> None:
        """Make `most` steps, or fewer if a run may end earlier."""
        loop = self._loop
        loop.k = self._master.k
        if self._recorder is not None:
            self._aim(self._recorder.unwritten.active)
        result = self._run(ctypes.byref(loop), most)
        self._master.k = loop.k
        if self._recorder is not None:
            self._recorder.make_room()
        if loop.warnings:
            for i in np.flatnonzero(self._warned):
                self._call(int(i)).warn(int(self._warned[i]) - 1)
            loop.warnings = 0
        if result == _FAILED:
            raise self._call(loop.failed).failed(loop.k, loop.status)
        if result == _NOT_FINITE:
            self._master.check_finite()

    def _call(self, i: int) -> Call:
        """Return the call to which operation i belongs."""
        call = self._program.source(i)
        assert isinstance(call, Call)
        return call


_PROGRAMS: WeakKeyDictionary[Master, tuple[object, Program]] = WeakKeyDictionary()


def _program(master: Master) -> Program:
    """Return the operations of a master's cycle, compiled once."""
    cycle, program = _PROGRAMS.get(master, (None, None))
    if program is None or cycle is not master.cycle:
        program = Program(master.cycle)
        _PROGRAMS[master] = master.cycle, program
    return program


@cache
def _library() -> Any:
    """Build and load the loop.

    Raises NotCompiledError if that fails.
    """
    try:
        command = compiler()
    except NoCompilerError as error:
        raise NotCompiledError(str(error)) from error
    executable = Path(command[0]).resolve()
    state = executable.stat()
    key = [
        *command,
        *FLAGS,
        platform.machine(),
        str(executable),
        state.st_size,
        state.st_mtime_ns,
    ]
    digest = hashlib.sha256(repr(key).encode() + SOURCE.read_bytes()).hexdigest()[:20]
    library = paths.cache() / "loop" / f"{digest}.so"
    try:
        if not library.exists():
            _build(command, library)
        return ctypes.CDLL(str(library))  # CDLL releases the GIL during calls
    except OSError as error:
        raise NotCompiledError(f"{library}: {error}") from error


def _build(command: tuple[str, ...], library: Path) -> None:
    """Compile the loop, under a temporary name first.

    Several processes may build it at the same time.
    """
    library.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=library.parent) as folder:
        part = Path(folder) / library.name
        compilation = subprocess.run(
            [*command, *FLAGS, "-o", str(part), str(SOURCE), "-lm"],
            capture_output=True,
            text=True,
            check=False,
        )
        if compilation.returncode:
            error = (
                compilation.stderr.strip().splitlines()
                or [f"exit {compilation.returncode}"]
            )[0]
            raise NotCompiledError(
                f"{shlex.join(command)} does not compile {SOURCE.name}: {error}"
            )
        part.replace(library)


# --- A plan as the operations of the compiled loop, one by one: the layouts of loop.c -


CODES = (
    "TICK",
    "LENGTH",
    "TAKE_8",
    "TAKE_4",
    "CONVERT",
    "TRANSFER",
    "STEP",
    "COPY",
    "CLEAR",
    "JOIN",
    "CUT",
    "PUT_R",
    "PUT_I",
    "PUT_B",
    "FETCH_R",
    "FETCH_I",
    "FETCH_B",
    "KEEP",
    "TRANSFER_3",
    "STEP_3",
    "TO_TYPE",
    "FROM_TYPE",
    "WIDEN",
)
_CODE = {name: i for i, name in enumerate(CODES)}
# Calls with a status; of several calls of one operation the worst status counts.
_CALLS = ("TRANSFER", "STEP", "TRANSFER_3", "STEP_3", "TO_TYPE", "FROM_TYPE")


class NotCompiledError(Exception):
    """An operation that the compiled loop does not have.

    The text names it.
    """


class _CompiledOperation(ctypes.Structure):
    """Operation of a step, in the layout of `desat_operation` in loop.c."""

    _fields_ = (
        ("code", ctypes.c_int32),
        ("more", ctypes.c_int32),
        ("n", ctypes.c_int64),
        ("word", ctypes.c_int64),
        ("p", ctypes.c_void_p * 6),
        ("x", ctypes.c_double * 3),
    )


# Code, n, pointers (arrays, ctypes objects or addresses), numbers.
_Row = tuple[str, int, Sequence[Any], Sequence[float]]


class Program:
    """The operations of a cycle in one array.

    `edges` (2 steps + 1,) gives the indices at which the operations before and after
    each step's row begin.
    """

    def __init__(self, cycle: Sequence[Step]) -> None:
        """Flatten the operations of a cycle into the table that the compiled loop reads."""
        self._keep: list[Any] = []  # arrays that have no other reference
        self._sources: list[Operation] = []
        rows: list[tuple[_Row, bool]] = []
        edges = [0]
        for step in cycle:
            for operations in step:
                for operation in operations:
                    row_indices = list(_rows(operation))
                    rows += [(row, row is not row_indices[-1]) for row in row_indices]
                    self._sources += [operation] * len(row_indices)
                edges.append(len(rows))
        self.edges = np.array(edges, np.int64)
        self.operations = (_CompiledOperation * len(rows))()
        for i, ((code, n, pointers, numbers), more) in enumerate(rows):
            place = self.operations[i]
            place.code, place.n, place.more = _CODE[code], n, more and code in _CALLS
            place.word = getattr(self._sources[i], "word", 0)
            place.p[: len(pointers)] = [self._address(p) for p in pointers]
            place.x[: len(numbers)] = numbers

    def source(self, i: int) -> Operation:
        """Return the operation from which entry i was made."""
        return self._sources[i]

    def _address(self, of: Any) -> int:
        """Return the address of an array or ctypes object, and keep it alive."""
        if isinstance(of, int):
            return of
        self._keep.append(of)
        if isinstance(of, np.ndarray):
            assert of.flags.c_contiguous
            return int(of.ctypes.data)
        return ctypes.addressof(of)


def _rows(operation: Operation) -> Iterator[_Row]:
    """Convert an operation to those of loop.c."""
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
        case Publish(live, _) if live.dtype == object:
            raise NotCompiledError("texts are exchanged")
        case Publish(live, fresh):
            yield "COPY", fresh.nbytes, (live, fresh), ()
        case Accumulate(window, i):
            if i == 0:
                yield from (
                    ("CLEAR", len(x), (x,), ()) for x in (window.mean, window.slope)
                )
            source, n = window.source, len(window.mean)
            sums = (window.mean, window.slope)
            yield (
                "JOIN",
                n,
                (window.live, source.means, source.slopes, *sums),
                window.weights[i],
            )
            if i == len(window.weights) - 1:
                with_slope = np.flatnonzero(window.target.slopes >= 0)
                every, slopes = np.arange(n), window.target.slopes[with_slope]
                yield (
                    "TAKE_8",
                    n,
                    (window.into, window.target.means, window.mean, every),
                    (),
                )
                yield (
                    "TAKE_8",
                    len(with_slope),
                    (window.into, slopes, window.slope, with_slope),
                    (),
                )
        case Split(part, i):
            source, target = part.source, part.target
            places = (source.means, source.slopes, target.means, target.slopes)
            yield "CUT", len(source.means), (part.live, *places), part.weights[i]
        case KeepRow(source, index, rows, taken):
            yield "KEEP", len(index), (rows, taken, source, index), ()
        case _:
            raise NotCompiledError(f"{type(operation).__name__} is not compiled")


def _gather(g: Gather) -> _Row:
    """Convert the collection of inputs to an operation of loop.c."""
    into = np.arange(len(g.target)) if g.into is None else g.into
    pointers = (g.target, into, g.source, g.index)
    if g.source.dtype == object:
        raise NotCompiledError("texts are exchanged")
    if g.source.dtype != g.target.dtype and g.conversion is not None:
        return "WIDEN", len(into), (*pointers, *g.conversion), ()
    if g.conversion is None:
        return "TAKE_8" if g.kind == "Real" else "TAKE_4", len(into), pointers, ()
    if g.kind != "Real":
        raise NotCompiledError(f"a connection converts values of type {g.kind}")
    return "CONVERT", len(into), (*pointers, *g.conversion), ()


def _calls(call: Call) -> Iterator[_Row]:
    """Convert a call of a component to operations of loop.c."""
    instance = call.instance
    if isinstance(instance, IsolatedInstance):
        raise NotCompiledError(f"{instance.name} runs in a process of its own")
    if not isinstance(instance, FmuInstance):
        raise NotCompiledError(f"{instance.name} is not run as an FMU")
    if call.verb not in instance.prepared:
        raise NotCompiledError(f"the steps of {instance.name} may be halved")
    for moves in instance.prepared[call.verb]:
        if moves.places is None:
            if any(p.code == NOT_COMPILED for p in moves.calls):
                raise NotCompiledError("texts are exchanged")
            yield from ((p.code, p.n, p.pointers, ()) for p in moves.calls)
            continue
        n = len(moves.places)
        if call.verb == "pull" and moves.kind == "R" and _side_by_side(moves.places):
            yield "COPY", 8 * n, (moves.values, moves.places[0]), ()
            continue
        code = f"{'PUT' if call.verb == 'push' else 'FETCH'}_{moves.kind}"
        yield code, n, (moves.places, moves.values), ()


def _side_by_side(places: Sequence[int]) -> bool:
    """Return whether Reals at these addresses are contiguous."""
    return all(b - a == 8 for a, b in pairwise(places))
