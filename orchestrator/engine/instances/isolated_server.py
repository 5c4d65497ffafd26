"""The process of an isolated FMU: what it does there, and the memory that both processes share.

`isolated.py` is the other side.
"""

from __future__ import annotations

import ctypes
import faulthandler
import mmap
import os
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import Any, NoReturn
from weakref import WeakSet

import numpy as np

from ...files.library import Fmu
from ...system.errors import DesatError
from ...system.interface import KINDS, Interface, Kind, Signal
from ...system.model import Component
from .. import current_call
from ..current_call import ENTER, EXIT, FREE, PULL, PUSH, RESTORE, SAVE, STEP
from ..process_state import kept
from .base import DTYPE, Array, Clock, ComponentError
from .fmu import FmuInstance

_VERBS = {"enter": ENTER, "exit": EXIT, "save": SAVE, "restore": RESTORE, "close": FREE}
DOING, DUE, SET, MADE, READ, SAID = range(6)
"""The shared words: the verb that the process is in; whether inputs are to be set; the statuses of
setting them, of the step and of reading outputs; how many messages there are."""
RAISED = -1
"""Instead of a status: an error was raised, and is to be asked for."""
A_STEP, OUTPUTS, A_CALL, DONE = b"s", b"p", b"c", b"."
"""What is due, and that it is done, over the socket."""
_HEAD = 64


class Shared:
    """Memory of both processes: words, start and length of the step (s), inputs, outputs."""

    def __init__(self, interface: Interface) -> None:
        signals = interface.signals.values()
        self._sizes = {k: 8 * sum(s.kind == k for s in signals) for k in KINDS}
        # anonymous: a process that is forked has the same
        self._memory = mmap.mmap(-1, _HEAD + 2 * sum(self._sizes.values()))
        _inherited.add(self._memory)  # of those that are forked after its own
        self.words = memoryview(self._memory)[:48].cast("q")
        self.clock = memoryview(self._memory)[48:_HEAD].cast("d")

    def arrays(self, signals: Mapping[Kind, list[Signal]], at: int) -> dict[Kind, Array]:
        """The inputs (at 0) or the outputs (at 1) that are moved, an array a type."""
        place, values = _HEAD + at * sum(self._sizes.values()), {}
        for kind, size in self._sizes.items():
            if signals[kind]:
                values[kind] = np.frombuffer(self._memory, DTYPE[kind], len(signals[kind]), place)
            place += size
        return values


class _There:
    """The instance in its process, and what is asked of it."""

    def __init__(self, shared: Shared, changes: Callable[..., list[str]]) -> None:
        self._shared, self._words, self._changes = shared, shared.words, changes
        self._moves: list[tuple[Array, Array]] = []
        self._clock, self._error = Clock(0.0, 0.0), ComponentError("")
        self._instance: FmuInstance
        self._process = os.getpid()

    def end_forked(self) -> None:
        """End a process that the component has forked, and that has come back from its call, too:
        one answers."""
        if os.getpid() != self._process:
            os._exit(0)

    @property
    def said(self) -> list[str]:
        """What the component has logged."""
        return self._instance.messages if hasattr(self, "_instance") else []

    def make(self, component: Component, fmu: Fmu) -> None:
        """Load and instantiate it."""
        self._instance = FmuInstance(component, fmu)

    def wire(self, inputs: dict[Kind, list[Signal]], outputs: dict[Kind, list[Signal]]) -> None:
        """Its inputs come from, and its outputs go to, the memory of both."""
        into = {k: np.zeros(0, DTYPE[k]) for k in KINDS} | self._shared.arrays(outputs, 1)
        self._instance.wire(inputs, outputs, into, self._clock)
        theirs = self._shared.arrays(inputs, 0)
        self._moves = [(mine, theirs[k]) for k, mine in self._instance.inputs.items()]

    def turn(self, step: bool) -> None:
        """Set the inputs where they are due, make a step or not, read the outputs."""
        words, instance = self._words, self._instance
        words[MADE] = words[READ] = 0
        self.push()
        try:
            if step and words[SET] <= 1:
                words[DOING] = STEP
                self._clock.t.value, self._clock.dt.value = self._shared.clock
                words[MADE] = instance.step()
        except ComponentError as error:
            self._error = error
            words[MADE] = RAISED
        if words[SET] <= 1 and 0 <= words[MADE] <= 1:
            words[DOING] = PULL
            words[READ] = instance.pull()
        words[SAID] = len(instance.messages)

    def push(self) -> None:
        """Set the inputs where they are due."""
        self._words[SET] = 0
        if self._words[DUE]:
            self._words[DUE] = 0
            self._words[DOING] = PUSH
            for mine, theirs in self._moves:
                mine[:] = theirs
            self._words[SET] = self._instance.push()

    def call(self, name: str, *arguments: Any) -> Any:
        """Any of the other functions."""
        if name in ("make", "wire"):
            return getattr(self, name)(*arguments)
        if name == "messages":
            return self.said
        if name == "raised":
            raise self._error
        if name in ("look", "save"):  # who goes on from a state has a process as it was made
            lines = self._changes("while it ran", handlers=True)
            self.said.extend(line for line in lines if line not in self.said)
        if name == "look":
            return self.said
        if name == "save":
            self.push()  # what is due belongs to its state
        self._words[DOING] = _VERBS.get(name, 0)
        return getattr(self._instance, name)(*arguments)


_inherited: WeakSet[mmap.mmap] = WeakSet((current_call.page,))
"""Memory that a process which is forked would have, too, and that is nothing of an FMU's."""


@contextmanager
def kept_back() -> Iterator[None]:
    """Within: a process that is forked has none of this process' shared memory (Linux)."""
    memories = list(_inherited) if hasattr(mmap, "MADV_DONTFORK") else []
    for memory in memories:
        memory.madvise(mmap.MADV_DONTFORK)
    try:
        yield
    finally:
        for memory in memories:
            memory.madvise(mmap.MADV_DOFORK)


def _alone(pipe: Connection) -> None:
    """Keep nothing of the head's but standard error, and take a session of its own: whatever the
    component writes into, signals or starts is its own."""
    os.setsid()
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.dup2(2, 1)  # what an FMU prints is no result
    os.closerange(3, pipe.fileno())
    os.closerange(pipe.fileno() + 1, os.sysconf("SC_OPEN_MAX"))


def live(
    pipe: Connection, shared: Shared, component: Component, fmu: Fmu, head: int
) -> NoReturn:  # fmt: skip
    """The process: it does what it is told until it is told to free the component."""
    try:
        faulthandler.disable()
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            signal.signal(getattr(signal, name), signal.SIG_IGN)  # the head decides
        if sys.platform == "linux":
            ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # it dies with its head, also in a call
            if os.getppid() != head:
                os._exit(1)
        _alone(pipe)
        with kept("it", "its process") as changes, np.errstate(all="ignore"):
            there, file = _There(shared, changes), pipe.fileno()
            alive = _answered(pipe, there, "make", (component, fmu))
            while alive:
                what = os.read(file, 1)
                if what == A_CALL:
                    alive = _answered(pipe, there, *pipe.recv())
                elif what:
                    there.turn(what == A_STEP)
                    there.end_forked()
                    os.write(file, DONE)
                else:
                    alive = False
    finally:
        os._exit(0)  # not what the interpreter would do, which is the head's


def _answered(pipe: Connection, there: _There, name: str, arguments: tuple[Any, ...]) -> bool:
    """Do a rare call and say what came of it; False where there is no more to come."""
    error: type[Exception] | None = None
    what: Any = None
    try:
        what = there.call(name, *arguments)
    except DesatError as raised:
        error, what = type(raised), raised.args
    except Exception as raised:
        error, what = RuntimeError, (f"{type(raised).__name__}: {raised}",)
    there.end_forked()
    pipe.send((list(there.said), error, what))
    return name != "close" and (name != "make" or error is None)
