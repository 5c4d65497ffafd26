"""The stepping loop in C (loop.c): built once into the user's cache, and run over a master's plan.

It makes the same bits as `Master.advance`. It needs a C compiler and FMUs alone; where it cannot
be had, `NotCompiledError` says why, and the master's own loop steps.
"""

from __future__ import annotations

import ctypes
import hashlib
import platform
import shlex
import subprocess
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from desat.fmus.compiler import NoCompilerError, compiler

from ..files import paths
from ..system.interface import KINDS
from ..system.options import Loop
from . import current_call
from .ending import Ending
from .master import Master
from .operations import Call
from .program import NotCompiledError, Program
from .recording.recorder import Recorder
from .recording.row_buffer import Half

SOURCE = Path(__file__).with_name("loop.c")
FLAGS = ("-std=c11", "-O3", "-ffp-contract=off", "-fPIC", "-shared")
_HOW = ("never", "below", "above", "reaches", "always")
_LOOK, _FAILED, _NOT_FINITE = range(3)


class _Table(ctypes.Structure):
    _fields_ = (
        ("source", ctypes.c_void_p), ("rows", ctypes.c_void_p), ("bytes", ctypes.c_int64),
    )  # fmt: skip


class _Loop(ctypes.Structure):
    _fields_ = (
        ("k", ctypes.c_int64), ("word", ctypes.c_void_p), ("time", ctypes.c_void_p),
        ("start", ctypes.c_double), ("step", ctypes.c_double),
        ("steps", ctypes.c_int64), ("edges", ctypes.c_void_p), ("operations", ctypes.c_void_p),
        ("failed", ctypes.c_int64), ("status", ctypes.c_int64),
        ("real", ctypes.c_void_p), ("reals", ctypes.c_int64),
        ("ahead", ctypes.c_int64), ("every", ctypes.c_int64), ("capacity", ctypes.c_int64),
        ("taken", ctypes.c_void_p), ("times", ctypes.c_void_p),
        ("tables", ctypes.c_int64), ("table", _Table * len(KINDS)),
        ("how", ctypes.c_int64), ("watched", ctypes.c_int64), ("asked", ctypes.c_int64),
        ("places", ctypes.c_void_p), ("watched_reals", ctypes.c_void_p),
        ("watched_integers", ctypes.c_void_p), ("limit", ctypes.c_double),
    )  # fmt: skip


class CompiledSteps:
    """Steps of an initialised master in C. Raises NotCompiledError where they cannot be."""

    name: Loop = "compiled"
    why = ""
    seconds = 0.0

    def __init__(self, master: Master, recorder: Recorder | None, ending: Ending) -> None:
        self._run, self._master, self._recorder = _library().desat_loop, master, recorder
        self._program = Program(master.cycle)
        real = master.live["Real"]
        self._loop = _Loop(
            word=current_call.address(current_call.word),
            time=current_call.address(current_call.time),
            start=master.start, step=master.step_size, steps=len(master.cycle),
            edges=self._program.edges.ctypes.data,
            operations=ctypes.addressof(self._program.operations),
            real=real.ctypes.data, reals=len(real), ahead=master.ahead,
        )  # fmt: skip
        if recorder is not None:
            self._record(master, recorder)
        self._watch(master, ending)

    def _record(self, master: Master, recorder: Recorder) -> None:
        """Say where rows are taken from."""
        loop, rows = self._loop, recorder.unwritten.active.rows
        loop.every, loop.tables = recorder.every, len(rows)
        for place, kind in zip(loop.table, rows, strict=False):
            place.source, place.bytes = master.row[kind].ctypes.data, rows[kind].strides[0]

    def _aim(self, half: Half) -> None:
        """Say where rows go."""
        loop = self._loop
        loop.taken, loop.times = half.taken.ctypes.data, half.times.ctypes.data
        loop.capacity = len(half.times)
        for place, rows in zip(loop.table, half.rows.values(), strict=False):
            place.rows = rows.ctypes.data

    def _watch(self, master: Master, ending: Ending) -> None:
        """Say when to come back for the ending to be asked."""
        loop = self._loop
        self._places = np.array([s.index for s in ending.watched], np.int64)
        loop.how, loop.limit, loop.asked = _HOW.index(ending.how), ending.limit, 1
        loop.watched, loop.places = len(self._places), self._places.ctypes.data
        if ending.watched:
            kind = ending.watched[0].kind
            of = "watched_reals" if kind == "Real" else "watched_integers"
            setattr(loop, of, master.live[kind].ctypes.data)

    def some(self, most: int) -> None:
        """Make so many steps, or fewer, so that a run may end there."""
        loop = self._loop
        loop.k = self._master.k
        if self._recorder is not None:
            self._aim(self._recorder.unwritten.active)
        result = self._run(ctypes.byref(loop), most)
        self._master.k = loop.k
        if self._recorder is not None:
            self._recorder.make_room()
        if result == _FAILED:
            call = self._program.source(loop.failed)
            assert isinstance(call, Call)
            raise call.failed(loop.k, loop.status)
        if result == _NOT_FINITE:
            self._master.check_finite()


@cache
def _library() -> Any:
    """The built loop. Raises NotCompiledError."""
    try:
        command = compiler()
    except NoCompilerError as error:
        raise NotCompiledError(str(error)) from error
    made = Path(command[0]).resolve()
    state = made.stat()
    key = [*command, *FLAGS, platform.machine(), str(made), state.st_size, state.st_mtime_ns]
    digest = hashlib.sha256(repr(key).encode() + SOURCE.read_bytes()).hexdigest()[:20]
    library = paths.cache() / "loop" / f"{digest}.so"
    try:
        if not library.exists():
            _build(command, library)
        return ctypes.CDLL(str(library))  # which lets other threads run meanwhile
    except OSError as error:
        raise NotCompiledError(f"{library}: {error}") from error


def _build(command: tuple[str, ...], library: Path) -> None:
    """Compile, under a temporary name first: several processes may."""
    library.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=library.parent) as folder:
        part = Path(folder) / library.name
        done = subprocess.run(
            [*command, *FLAGS, "-o", str(part), str(SOURCE), "-lm"],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        if done.returncode:
            said = (done.stderr.strip().splitlines() or [f"exit {done.returncode}"])[0]
            raise NotCompiledError(f"{shlex.join(command)} does not compile {SOURCE.name}: {said}")
        part.replace(library)
