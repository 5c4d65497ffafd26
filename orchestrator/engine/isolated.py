"""An FMU in a process of its own: what it does to that process, it does to no other.

The process is forked before any FMU is loaded. Inputs, outputs, the time of the step and statuses
lie in memory that both share; a byte each way over a socket says that a step is due, and that it is
made: inputs are set, the step is made and outputs are read in one such turn. Calls that are rare go
over the socket as they are. The end of the process closes the socket; one that does not answer in
time is killed.
"""

from __future__ import annotations

import ctypes
import faulthandler
import math
import mmap
import os
import signal
import socket
import struct
import sys
import time
import warnings
from collections.abc import Callable, Mapping
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, NoReturn

import numpy as np

from desat.components.contract.block import Scalar

from ..files.library import Fmu
from ..system.codes import Exit
from ..system.errors import DesatError
from ..system.interface import KINDS, Interface, Kind, Signal
from ..system.model import Component
from . import last_call
from .fmu_instance import FmuInstance, failure
from .host import kept
from .instances import DTYPE, Array, Clock, ComponentError, EndedError
from .last_call import ENTER, EXIT, FREE, INSTANTIATE, PULL, PUSH, RESTORE, SAVE, STEP

CAN = hasattr(os, "fork")
GRACE = 1.0
"""A process that has closed its socket is killed where it has not ended after so long (s)."""
_VERBS = {"enter": ENTER, "exit": EXIT, "save": SAVE, "restore": RESTORE, "close": FREE}
_DOING, _DUE, _SET, _MADE, _READ, _SAID = range(6)
"""The shared words: the verb that the process is in; whether inputs are to be set; the statuses of
setting them, of the step and of reading outputs; how many messages there are."""
_RAISED = -1
"""Instead of a status: an error was raised, and is to be asked for."""
_HEAD, _STEP, _PULL, _CALL, _DONE = 64, b"s", b"p", b"c", b"."
_open: set[Connection] = set()
"""This process's ends of all sockets; one that is forked keeps none of them."""


class _Shared:
    """Memory of both processes: words, start and length of the step (s), inputs, outputs."""

    def __init__(self, interface: Interface) -> None:
        signals = interface.signals.values()
        self._sizes = {k: 8 * sum(s.kind == k for s in signals) for k in KINDS}
        # anonymous: a process that is forked has the same
        self._memory = mmap.mmap(-1, _HEAD + 2 * sum(self._sizes.values()))
        self.words = memoryview(self._memory)[:48].cast("q")
        self.clock = memoryview(self._memory)[48:_HEAD].cast("d")

    def arrays(self, signals: Mapping[Kind, list[Signal]], at: int) -> dict[Kind, Array]:
        """The inputs (at 0) or the outputs (at 1) that are moved, an array a type."""
        place, found = _HEAD + at * sum(self._sizes.values()), {}
        for kind, size in self._sizes.items():
            if signals[kind]:
                found[kind] = np.frombuffer(self._memory, DTYPE[kind], len(signals[kind]), place)
            place += size
        return found


class IsolatedInstance:
    """An FMU in a process of its own, each call of which may take `limit` s. Any call raises
    EndedError where that process ends, or does not answer."""

    def __init__(self, component: Component, fmu: Fmu, limit: float = math.inf) -> None:
        self.name, self.place = component.name, 0
        self.messages: list[str] = []
        self._heard, self._limit, self._ended, self._read = 0, limit, "", False
        self._shared = _Shared(fmu.interface)
        self._words, self._time = self._shared.words, self._shared.clock
        self._words[_DOING] = INSTANTIATE
        ours, theirs = socket.socketpair()
        head = os.getpid()
        with warnings.catch_warnings():  # the child uses nothing that another thread may hold
            warnings.simplefilter("ignore", DeprecationWarning)
            self._process = os.fork()
        if not self._process:
            ours.close()
            _live(Connection(theirs.detach()), self._shared, component, fmu, head)
        theirs.close()
        if limit < 1e9:
            rest, seconds = math.modf(limit)
            time_value = struct.pack("ll", int(seconds), int(1e6 * rest))
            ours.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, time_value)
        self._socket: Connection | None = Connection(ours.detach())
        self._file = self._socket.fileno()
        _open.add(self._socket)
        try:
            self._answer()
        except ComponentError:
            self.close()
            raise

    def failed(self, what: str, status: int) -> ComponentError:
        return failure(self.name, what, status, self.messages)

    # --- stepping -----------------------------------------------------------------------------

    def wire(
        self, inputs: dict[Kind, list[Signal]], outputs: dict[Kind, list[Signal]],
        into: dict[Kind, Array], clock: Clock,
    ) -> None:  # fmt: skip
        self.inputs, self._clock = self._shared.arrays(inputs, 0), clock
        self._moves = [(into[k], values) for k, values in self._shared.arrays(outputs, 1).items()]
        self._ask("wire", inputs, outputs)

    def halve(self, times: int) -> None:
        """As that of FmuInstance."""
        self._ask("halve", times)

    def push(self) -> int:
        self._words[_DUE] = 1
        self._read = False
        return 0

    def step(self) -> int:
        self._time[0], self._time[1] = self._clock.t.value, self._clock.dt.value
        self._turn(_STEP)
        self._read = True
        if (status := self._words[_MADE]) == _RAISED:
            self._ask("raised")
        return status

    def pull(self) -> int:
        if not self._read:
            self._turn(_PULL)
        self._read = False
        for mine, theirs in self._moves:
            mine[:] = theirs
        return self._words[_READ]

    def _turn(self, what: bytes) -> None:
        """Have the inputs set where they are due, a step made or not, the outputs read."""
        if self._ended:
            raise ComponentError(self._ended)
        try:
            os.write(self._file, what)
            done = os.read(self._file, 1)
        except BlockingIOError:
            self._lost(hung=True)
        except OSError:
            self._lost()
        if not done:
            self._lost()
        if self._words[_SAID] > self._heard:
            self._hear("messages")
        if (status := self._words[_SET]) > 1:
            raise self.failed(last_call.told(PUSH), status)

    # --- calls that are rare ------------------------------------------------------------------

    def enter(self, start: float, parameters: Mapping[str, Scalar]) -> None:
        self._ask("enter", start, dict(parameters))

    def exit(self) -> None:
        self._ask("exit")

    def save(self) -> bytes:
        state: bytes = self._ask("save")
        return state

    def restore(self, state: bytes) -> None:
        self._ask("restore", state)

    def look(self) -> None:
        """Add what the component has changed of its process, which is put back, to what it said."""
        if self._socket is not None and not self._ended:
            self._hear("look")

    def close(self) -> None:
        if self._socket is None:
            return
        try:
            if not self._ended:
                self._ask("close")
        finally:
            self._reap()

    def _ask(self, name: str, *arguments: Any) -> Any:
        """What a function of the instance there gives. Raises what it raises."""
        if self._ended or self._socket is None:
            raise ComponentError(self._ended or f"{self.name}: it is freed")
        try:
            os.write(self._file, _CALL)
            self._socket.send((name, arguments))
        except OSError:
            self._lost()
        return self._answer()

    def _answer(self) -> Any:
        assert self._socket is not None
        try:
            said, error, what = self._socket.recv()
        except BlockingIOError:
            self._lost(hung=True)
        except (EOFError, OSError):
            self._lost()
        self._take(said)
        if error is not None:
            raise error(*what)
        return what

    def _hear(self, name: str) -> None:
        with suppress(EndedError):  # the next call says so
            self._take(self._ask(name))

    def _take(self, said: list[str]) -> None:
        self.messages += said[self._heard :]
        self._heard = len(said)

    # --- its end ------------------------------------------------------------------------------

    def _lost(self, hung: bool = False) -> NoReturn:
        """The process there has ended, or is ended here: say how."""
        call = last_call.told(self._words[_DOING])
        if hung:
            os.kill(self._process, signal.SIGKILL)
            self._reap()
            self._ended = f"{self.name}: {call} did not return within {self._limit:g} s"
        else:
            self._ended = f"{self.name}: {call} ended its process: {self._reap()}"
        last_call.word[0] = 0  # whoever watches this process need not
        raise EndedError(self._ended, Exit.TIMEOUT if hung else Exit.COMPONENT)

    def _reap(self) -> str:
        """How the process ended."""
        if self._socket is None:
            return ""
        self._socket.close()
        _open.discard(self._socket)
        self._socket, until = None, time.monotonic() + GRACE
        while True:
            process, status = os.waitpid(self._process, os.WNOHANG)
            if process:
                return last_call.how(status)
            if time.monotonic() > until:
                os.kill(self._process, signal.SIGKILL)
            time.sleep(0.001)


class _There:
    """The instance in its process, and what is asked of it."""

    def __init__(self, shared: _Shared, changes: Callable[..., list[str]]) -> None:
        self._shared, self._words, self._changes = shared, shared.words, changes
        self._moves: list[tuple[Array, Array]] = []
        self._clock, self._error = Clock(0.0, 0.0), ComponentError("")
        self._instance: FmuInstance

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
        words[_MADE] = words[_READ] = 0
        self.push()
        try:
            if step and words[_SET] <= 1:
                words[_DOING] = STEP
                self._clock.t.value, self._clock.dt.value = self._shared.clock
                words[_MADE] = instance.step()
        except ComponentError as error:
            self._error = error
            words[_MADE] = _RAISED
        if words[_SET] <= 1 and 0 <= words[_MADE] <= 1:
            words[_DOING] = PULL
            words[_READ] = instance.pull()
        words[_SAID] = len(instance.messages)

    def push(self) -> None:
        """Set the inputs where they are due."""
        self._words[_SET] = 0
        if self._words[_DUE]:
            self._words[_DUE] = 0
            self._words[_DOING] = PUSH
            for mine, theirs in self._moves:
                mine[:] = theirs
            self._words[_SET] = self._instance.push()

    def call(self, name: str, *arguments: Any) -> Any:
        """Any of the other functions."""
        if name in ("make", "wire"):
            return getattr(self, name)(*arguments)
        if name == "messages":
            return self.said
        if name == "raised":
            raise self._error
        if name == "look":
            lines = self._changes("while it ran", handlers=True)
            self.said.extend(line for line in lines if line not in self.said)
            return self.said
        if name == "save":
            self.push()  # what is due belongs to its state
        self._words[_DOING] = _VERBS.get(name, 0)
        return getattr(self._instance, name)(*arguments)


def _live(
    pipe: Connection, shared: _Shared, component: Component, fmu: Fmu, head: int
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
        for other in _open:
            other.close()
        os.dup2(2, 1)  # what an FMU prints is no result
        with kept("it", "its process") as changes, np.errstate(all="ignore"):
            there, file = _There(shared, changes), pipe.fileno()
            alive = _answered(pipe, there, "make", (component, fmu))
            while alive:
                what = os.read(file, 1)
                if what == _CALL:
                    alive = _answered(pipe, there, *pipe.recv())
                elif what:
                    there.turn(what == _STEP)
                    os.write(file, _DONE)
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
    pipe.send((list(there.said), error, what))
    return name != "close" and (name != "make" or error is None)
