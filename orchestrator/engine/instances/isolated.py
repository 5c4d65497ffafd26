"""An FMU in a process of its own: what it does to that process, it does to no other.

The process is forked before any FMU is loaded. Inputs, outputs, the time of the step and statuses
lie in memory that both share; a byte each way over a socket says that a step is due, and that it is
made: inputs are set, the step is made and outputs are read in one such turn. Calls that are rare go
over the socket as they are. The end of the process closes the socket; one that does not answer in
time is killed. `apart.py` is the other side.
"""

from __future__ import annotations

import math
import os
import pickle
import signal
import socket
import struct
import time
import warnings
from collections.abc import Mapping
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, NoReturn

from desat.components.contract.block import Scalar

from ...files.library import Fmu
from ...system.codes import Exit
from ...system.interface import Kind, Signal
from ...system.model import Component
from .. import current_call
from ..current_call import INSTANTIATE, PUSH
from .base import Array, Clock, ComponentError, EndedError
from .fmu import failure
from .isolated_server import (
    A_CALL,
    A_STEP,
    DOING,
    DONE,
    DUE,
    MADE,
    OPEN,
    OUTPUTS,
    RAISED,
    READ,
    SAID,
    SET,
    Shared,
    kept_back,
    live,
)

CAN = hasattr(os, "fork")
GRACE = 1.0
"""A process that has closed its socket is killed where it has not ended after so long (s)."""


class IsolatedInstance:
    """An FMU in a process of its own, each call of which may take `limit` s. Any call raises
    EndedError where that process ends, or does not answer."""

    def __init__(self, component: Component, fmu: Fmu, limit: float = math.inf) -> None:
        self.name, self.place = component.name, 0
        self.messages: list[str] = []
        self._heard, self._limit, self._ended, self._read = 0, limit, "", False
        ours, theirs = socket.socketpair()
        head = os.getpid()
        with warnings.catch_warnings():  # the child uses nothing that another thread may hold
            warnings.simplefilter("ignore", DeprecationWarning)
            with kept_back():
                self._shared = Shared(fmu.interface)
                self._words, self._time = self._shared.words, self._shared.clock
                self._words[DOING] = INSTANTIATE
                self._process = os.fork()
                if not self._process:
                    live(Connection(theirs.detach()), self._shared, component, fmu, head)
        theirs.close()
        if limit < 1e9:
            rest, seconds = math.modf(limit)
            time_value = struct.pack("ll", int(seconds), int(1e6 * rest))
            ours.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, time_value)
        self._socket: Connection | None = Connection(ours.detach())
        self._file = self._socket.fileno()
        try:
            self._answer()
        except BaseException:
            self._reap()  # it ends by itself: what it refused is not to be hidden by that
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
        self._words[DUE] = 1
        self._read = False
        return 0

    def step(self) -> int:
        self._time[0], self._time[1] = self._clock.t.value, self._clock.dt.value
        self._turn(A_STEP)
        self._read = True
        if (status := self._words[MADE]) == RAISED:
            self._ask("raised")
        return status

    def pull(self) -> int:
        if not self._read:
            self._turn(OUTPUTS)
        self._read = False
        for mine, theirs in self._moves:
            mine[:] = theirs
        return self._words[READ]

    def _turn(self, what: bytes) -> None:
        """Have the inputs set where they are due, a step made or not, the outputs read."""
        if self._ended:
            raise ComponentError(self._ended)
        self._words[OPEN] = 1
        try:
            os.write(self._file, what)
            done = os.read(self._file, 1)
        except BlockingIOError:
            self._lost(hung=True)
        except OSError:
            self._lost()
        if done != DONE or self._words[OPEN]:
            self._lost(garbled=f"at t = {self._time[0]:g} s it wrote" if done else "")
        if self._words[SAID] > self._heard:
            self._hear("messages")
        if (status := self._words[SET]) > 1:
            raise self.failed(current_call.told(PUSH), status)

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
            os.write(self._file, A_CALL)
            self._socket.send((name, arguments))
        except OSError:
            self._lost()
        return self._answer()

    def _answer(self) -> Any:
        assert self._socket is not None
        try:
            octets = self._socket.recv_bytes()
        except BlockingIOError:
            self._lost(hung=True)
        except (EOFError, OSError):
            self._lost()
        try:
            said, error, what = pickle.loads(octets)
        except Exception:  # what the component has written itself
            self._lost(garbled=f"{current_call.told(self._words[DOING])} wrote")
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

    def _lost(self, hung: bool = False, garbled: str = "") -> NoReturn:
        """The process there has ended, or is ended here: say how. `garbled`: when it has answered
        what our side of it does not."""
        call = current_call.told(self._words[DOING])
        if hung and (status := current_call.status_of(self._process)) is not None:
            hung = False  # what it has forked keeps its socket open
            self._close()
            self._end_group()
            self._ended = f"{self.name}: {call} ended its process: {current_call.how(status)}"
        elif garbled:
            os.kill(self._process, signal.SIGKILL)
            self._reap()
            self._ended = f"{self.name}: {garbled} into a file that is not its own; it was ended"
        elif hung:
            os.kill(self._process, signal.SIGKILL)
            self._reap()
            self._ended = f"{self.name}: {call} did not return within {self._limit:g} s"
        else:
            self._ended = f"{self.name}: {call} ended its process: {self._reap()}"
        current_call.word[0] = 0  # whoever watches this process need not
        raise EndedError(self._ended, Exit.TIMEOUT if hung else Exit.COMPONENT)

    def _reap(self) -> str:
        """How the process ended."""
        if self._socket is None:
            return ""
        self._close()
        until = time.monotonic() + GRACE
        while True:
            if (status := current_call.status_of(self._process)) is not None:
                self._end_group()
                return current_call.how(status)
            if time.monotonic() > until:
                os.kill(self._process, signal.SIGKILL)
            time.sleep(0.001)

    def _end_group(self) -> None:
        """End what it has forked, of its session: what has left that comes to the process that
        steps (`runs/supervisor.py`)."""
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process, signal.SIGKILL)

    def _close(self) -> None:
        """Close the socket."""
        assert self._socket is not None
        self._socket.close()
        self._socket = None
