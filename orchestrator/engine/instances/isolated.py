"""Run an FMU in a process of its own, so that it cannot damage any other process.

The process is forked before any FMU is loaded. Both processes share memory that holds
inputs, outputs, the time of the step and statuses. One byte each way over a socket says
that a step is due and that it is done: such a turn sets the inputs, makes the step and
reads the outputs. Rare calls are sent over the socket; their answers are JSON, because
what comes from that process must not be run here. The end of the process closes the
socket, and a process that does not answer in time is killed. The functions at the end of
this file run on the other side.
"""

from __future__ import annotations

import json
import math
import mmap
import os
import signal
import socket
import struct
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from typing import Any, NoReturn
from weakref import WeakSet

import numpy as np

from desat.components.contract.block import Scalar

from ...system.errors import DesatError, Exit
from ...system.interface import KINDS, Interface, Kind, Signal
from ...system.model import Component, Fmu
from .. import current_call
from ..current_call import (
    ENTER,
    EXIT,
    FREE,
    INSTANTIATE,
    PULL,
    PUSH,
    RESTORE,
    SAVE,
    STEP,
    TERMINATE,
    VERBS,
)
from ..process_state import CAN_FORK, die_with, fork, keep_state
from .base import DTYPE, Array, Clock, ComponentError, EndedError, blank, warn_of
from .fmu import FmuInstance, failure

CAN = CAN_FORK
GRACE = 1.0  # s: a process that closed its socket is killed after this time


class IsolatedInstance:
    """An FMU in a process of its own, whose calls may each take `limit` s.

    Any call raises EndedError if that process ends or does not answer.
    """

    def __init__(self, component: Component, fmu: Fmu, limit: float = math.inf) -> None:
        """Start the process of a component's FMU; a call ends after `limit` (s).

        Raises DesatError if the FMU cannot be instantiated there.
        """
        self.name, self.place = component.name, 0
        self.messages: list[str] = []
        self.counts: dict[str, int] = {}
        self._heard, self._limit, self._ended, self._read = 0, limit, "", False
        _ = fmu.folder  # extracted here, because the process does not clean up
        ours, theirs = socket.socketpair()
        head = os.getpid()
        with kept_back():
            self._shared = Shared(component.interface)
            self._words, self._time = self._shared.words, self._shared.clock
            self._words[DOING] = INSTANTIATE
            self._process = fork()
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
            # the process ends by itself, which must not hide its refusal
            self._reap()
            raise

    def failed(self, call: str, status: int) -> ComponentError:
        return failure(self.name, call, status, self.messages)

    # --- stepping ---------------------------------------------------------------------

    def wire(
        self,
        inputs: dict[Kind, list[Signal]],
        outputs: dict[Kind, list[Signal]],
        into: dict[Kind, Array],
        clock: Clock,
    ) -> None:
        self.inputs, self._clock = self._shared.arrays(inputs, 0), clock
        self._texts = into["String"] if outputs.get("String") else None
        if inputs.get("String"):
            self.inputs["String"] = blank("String", len(inputs["String"]))
        self._moves = [
            (into[k], values) for k, values in self._shared.arrays(outputs, 1).items()
        ]
        self._ask("wire", inputs, outputs)

    def halve(self, times: int) -> None:
        """Repeat discarded steps in parts, as FmuInstance does."""
        self._ask("halve", times)

    def push(self) -> int:
        self._words[DUE] = 1
        self._read = False
        if "String" in self.inputs:  # texts have no place in the shared memory
            self._ask("take_texts", self.inputs["String"].tolist())
        return 0

    def step(self) -> int:
        self._time[0], self._time[1] = self._clock.t.value, self._clock.dt.value
        self._turn(A_STEP)
        self._read = True
        if (status := self._words[STEPS_MADE]) == RAISED:
            self._ask("raised")
        return status

    def pull(self) -> int:
        if not self._read:
            self._turn(OUTPUTS)
        self._read = False
        for mine, theirs in self._moves:
            mine[:] = theirs
        if self._texts is not None:
            self._texts[:] = self._ask("give_texts")
        return self._words[READ]

    def _turn(self, command: bytes) -> None:
        """Have the child process set inputs, make a step and read the outputs.

        `command` says which of these. Raises ComponentError for a call that failed, and
        EndedError where the process hangs, has ended or answers what nobody wrote.
        """
        if self._ended:
            raise ComponentError(self._ended)
        self._words[OPEN] = 1
        try:
            os.write(self._file, command)
            answer = os.read(self._file, 1)
        except BlockingIOError:
            self._raise_ended(hung=True)
        except OSError:
            self._raise_ended()
        if answer != DONE or self._words[OPEN]:
            self._raise_ended(
                garbled=f"at t = {self._time[0]:g} s it wrote" if answer else ""
            )
        if self._words[MESSAGES] > self._heard:
            self._hear("messages")
        if (status := self._words[SET]) > 1:
            raise self.failed(current_call.describe(PUSH), status)
        if status:
            warn_of(
                self, VERBS[PUSH], f", the first time at t = {current_call.time[0]:g} s"
            )

    # --- calls that are rare ----------------------------------------------------------

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
        """Add to the messages what the component changed in its process.

        These changes are undone.
        """
        if self._socket is not None and not self._ended:
            self._hear("look")
            with suppress(EndedError):
                self.counts = self._ask("counted")

    def terminate(self) -> None:
        self._ask("terminate")

    def close(self) -> None:
        if self._socket is None:
            return
        try:
            if not self._ended:
                self._ask("close")
        finally:
            self._reap()

    def _ask(self, name: str, *arguments: Any) -> Any:
        """Call a function of the remote instance; raise what it raises."""
        if self._ended or self._socket is None:
            raise ComponentError(self._ended or f"{self.name}: it is freed")
        try:
            os.write(self._file, A_CALL)
            self._socket.send((name, arguments))
        except OSError:
            self._raise_ended()
        return self._answer()

    def _answer(self) -> Any:
        """Receive the result of a call; raise the error that it reports."""
        assert self._socket is not None
        try:
            octets = self._socket.recv_bytes()
        except BlockingIOError:
            self._raise_ended(hung=True)
        except (EOFError, OSError):
            self._raise_ended()
        try:
            messages, error, answer = decode_answer(octets)
        except Exception:  # the component wrote to the socket itself
            self._raise_ended(
                garbled=f"{current_call.describe(self._words[DOING])} wrote"
            )
        self._take(messages)
        if error:
            raise _ERRORS[error](*answer)
        return answer

    def _hear(self, name: str) -> None:
        """Fetch new messages by a call; ignore a process that has ended."""
        with suppress(EndedError):  # the next call reports it
            self._take(self._ask(name))

    def _take(self, messages: list[str]) -> None:
        """Append the messages that are new."""
        self.messages += messages[self._heard :]
        self._heard = len(messages)

    # --- its end ----------------------------------------------------------------------

    def _raise_ended(self, hung: bool = False, garbled: str = "") -> NoReturn:
        """Raise EndedError for a process that has ended or that is killed here.

        `garbled` describes an answer that does not follow the protocol.
        """
        call = current_call.describe(self._words[DOING])
        if hung and (status := current_call.status_of(self._process)) is not None:
            hung = False  # a process that it forked keeps the socket open
            self._close()
            self._end_group()
            self._ended = f"{self.name}: {call} ended its process: {current_call.describe_exit(status)}"
        elif garbled:
            os.kill(self._process, signal.SIGKILL)
            self._reap()
            self._ended = (
                f"{self.name}: {garbled} into a file that is not its own; it was ended"
            )
        elif hung:
            os.kill(self._process, signal.SIGKILL)
            self._reap()
            self._ended = f"{self.name}: {call} did not return within {self._limit:g} s"
        else:
            self._ended = f"{self.name}: {call} ended its process: {self._reap()}"
        current_call.word[0] = 0  # no call is in progress any more
        raise EndedError(self._ended, Exit.TIMEOUT if hung else Exit.COMPONENT)

    def _reap(self) -> str:
        """Close the socket, wait for the process to end and describe how it ended.

        After GRACE seconds it is killed.
        """
        if self._socket is None:
            return ""
        self._close()
        until = time.monotonic() + GRACE
        while True:
            if (status := current_call.status_of(self._process)) is not None:
                self._end_group()
                return current_call.describe_exit(status)
            if time.monotonic() > until:
                os.kill(self._process, signal.SIGKILL)
            time.sleep(0.001)

    def _end_group(self) -> None:
        """Kill the processes that it forked within its session.

        Those that left the session become children of the process that steps
        (`child.py`).
        """
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process, signal.SIGKILL)

    def _close(self) -> None:
        """Close the socket."""
        assert self._socket is not None
        self._socket.close()
        self._socket = None


def cost_of_a_turn(count: int = 300) -> float:
    """Measure the time of one turn of an isolated FMU here (s, median).

    A turn is a byte there and back.
    """
    ours, theirs = socket.socketpair()
    child = fork()
    if not child:
        with suppress(OSError):
            ours.close()
            while theirs.send(theirs.recv(1)):
                pass
        os._exit(0)
    theirs.close()
    taken = []
    with ours:
        for _ in range(count):
            began = time.perf_counter()
            ours.send(A_STEP)
            ours.recv(1)
            taken.append(time.perf_counter() - began)
    os.waitpid(child, 0)
    return sorted(taken)[count // 2]


# ------------------------------------------------------------------------------------------------
# The process of an isolated FMU, and the memory that both processes share. The classes above run in
# the parent.


_VERBS = {
    "enter": ENTER,
    "exit": EXIT,
    "save": SAVE,
    "restore": RESTORE,
    "terminate": TERMINATE,
    "close": FREE,
}
# Shared words: the verb that the process executes; whether inputs are to be set; the
# statuses of setting inputs, of the step and of reading outputs; the number of messages;
# whether a turn was requested and is not done, whatever arrives over the socket.
DOING, DUE, SET, STEPS_MADE, READ, MESSAGES, OPEN = range(7)
RAISED = -1  # in place of a status: an error was raised and has to be fetched
# Bytes on the socket: three requests, and the reply when a turn is done.
A_STEP, OUTPUTS, A_CALL, DONE = b"s", b"p", b"c", b"."
_HEAD = 72


class Shared:
    """Memory that both processes share.

    It holds words, start and length of the step (s), inputs and outputs.
    """

    def __init__(self, interface: Interface) -> None:
        signals = interface.signals.values()
        self._sizes = {k: 8 * sum(s.kind == k for s in signals) for k in KINDS}
        # anonymous: a forked process shares it
        self._memory = mmap.mmap(-1, _HEAD + 2 * sum(self._sizes.values()))
        # the processes of other FMUs, forked later, must not get it
        _inherited.add(self._memory)
        self.words = memoryview(self._memory)[:56].cast("q")
        self.clock = memoryview(self._memory)[56:_HEAD].cast("d")

    def arrays(
        self, signals: Mapping[Kind, list[Signal]], at: int
    ) -> dict[Kind, Array]:
        """Return the inputs (`at` 0) or outputs (`at` 1), one array per type."""
        place, values = _HEAD + at * sum(self._sizes.values()), {}
        for kind, size in self._sizes.items():
            if signals[kind]:
                values[kind] = np.frombuffer(
                    self._memory, DTYPE[kind], len(signals[kind]), place
                )
            place += size
        return values


# Errors that an answer may name.
_ERRORS: dict[str, type[Exception]] = {
    e.__name__: e for e in (DesatError, ComponentError, RuntimeError)
}


def encode_answer(messages: list[str], error: str, answer: Any) -> bytes:
    """Encode messages, the name of an error and an answer: JSON, then its bytes."""
    is_state = isinstance(answer, bytes)
    head = [messages, error, None if is_state else answer, is_state]
    return json.dumps(head).encode() + b"\n" + (answer if is_state else b"")


def decode_answer(octets: bytes) -> tuple[list[str], str, Any]:
    """Decode what `encode_answer` returns.

    Raises
    ------
    Exception
        If the bytes are anything else.
    """
    head, _, state = octets.partition(b"\n")
    messages, error, answer, is_state = json.loads(head.decode())
    if not all(isinstance(text, str) for text in [*messages, error]):
        raise TypeError("messages and an error's name are texts")
    if error and not (error in _ERRORS and isinstance(answer, list)):
        raise ValueError(f"no error {error!r} with its arguments")
    return messages, error, state if is_state else answer


class _There:
    """The instance within its process, and the requests that it serves."""

    def __init__(self, shared: Shared, changes: Callable[..., list[str]]) -> None:
        self._shared, self._words, self._changes = shared, shared.words, changes
        self._moves: list[tuple[Array, Array]] = []
        self._clock, self._error = Clock(0.0, 0.0), ComponentError("")
        self._instance: FmuInstance

    @property
    def messages(self) -> list[str]:
        """Return what the component has logged."""
        return self._instance.messages if hasattr(self, "_instance") else []

    def make(self, component: Component, fmu: Fmu) -> None:
        """Load and instantiate the FMU."""
        self._instance = FmuInstance(component, fmu)

    def wire(
        self, inputs: dict[Kind, list[Signal]], outputs: dict[Kind, list[Signal]]
    ) -> None:
        """Connect inputs and outputs of the instance to the shared memory."""
        into = {k: np.zeros(0, DTYPE[k]) for k in KINDS} | self._shared.arrays(
            outputs, 1
        )
        into["String"] = self._texts = blank("String", len(outputs.get("String", ())))
        self._instance.wire(inputs, outputs, into, self._clock)
        theirs = self._shared.arrays(inputs, 0)
        mine = self._instance.inputs
        self._moves = [(mine[kind], values) for kind, values in theirs.items()]

    def take_texts(self, texts: list[str]) -> None:
        """Take the texts that are set with the other inputs."""
        self._instance.inputs["String"][:] = texts

    def give_texts(self) -> list[str]:
        """Return the texts that were read with the other outputs."""
        return list(self._texts)

    def turn(self, step: bool) -> None:
        """Set inputs that are due, make a step if `step`, and read the outputs."""
        words, instance = self._words, self._instance
        words[STEPS_MADE] = words[READ] = 0
        self.push()
        try:
            if step and words[SET] <= 1:
                words[DOING] = STEP
                self._clock.t.value, self._clock.dt.value = self._shared.clock
                words[STEPS_MADE] = instance.step()
        except ComponentError as error:
            self._error = error
            words[STEPS_MADE] = RAISED
        if words[SET] <= 1 and 0 <= words[STEPS_MADE] <= 1:
            words[DOING] = PULL
            words[READ] = instance.pull()
        if (worst := max(words[SET], words[STEPS_MADE], words[READ])) > 1:
            instance.note(worst)
        words[MESSAGES] = len(instance.messages)
        words[OPEN] = 0  # last: it marks the turn as done

    def push(self) -> None:
        """Set the inputs if they are due."""
        self._words[SET] = 0
        if self._words[DUE]:
            self._words[DUE] = 0
            self._words[DOING] = PUSH
            for mine, theirs in self._moves:
                mine[:] = theirs
            self._words[SET] = self._instance.push()

    def call(self, name: str, *arguments: Any) -> Any:
        """Call any of the rarely used functions by name."""
        if name in ("make", "wire", "take_texts", "give_texts"):
            return getattr(self, name)(*arguments)
        if name == "messages":
            return self.messages
        if name == "counted":
            return self._instance.counts
        if name == "raised":
            raise self._error
        if name in (
            "look",
            "save",
        ):  # a run that resumes from a state starts with a pristine process
            lines = self._changes("while it ran", handlers=True)
            self.messages.extend(line for line in lines if line not in self.messages)
        if name == "look":
            return self.messages
        if name == "save":
            self.push()  # inputs that are due belong to the state
        self._words[DOING] = _VERBS.get(name, 0)
        return getattr(self._instance, name)(*arguments)


# Memory that a forked process would inherit, but that no FMU's process may touch.
_inherited: WeakSet[mmap.mmap] = WeakSet((current_call.page,))


@contextmanager
def kept_back() -> Iterator[None]:
    """Keep this process' shared memory from processes forked within (Linux)."""
    memories = list(_inherited) if hasattr(mmap, "MADV_DONTFORK") else []
    for memory in memories:
        memory.madvise(mmap.MADV_DONTFORK)
    try:
        yield
    finally:
        for memory in memories:
            memory.madvise(mmap.MADV_DOFORK)


def _alone(pipe: Connection) -> None:
    """Detach the process from its parent.

    It closes all inherited files except standard error and starts a new session, so
    that whatever the component writes to, signals or starts is its own.
    """
    os.setsid()
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.dup2(2, 1)  # the output of an FMU must not mix with results
    os.closerange(3, pipe.fileno())
    os.closerange(pipe.fileno() + 1, os.sysconf("SC_OPEN_MAX"))


def live(
    pipe: Connection, shared: Shared, component: Component, fmu: Fmu, head: int
) -> NoReturn:
    """Serve requests in the forked process until the component is freed."""
    try:
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            # the parent decides when to stop
            signal.signal(getattr(signal, name), signal.SIG_IGN)
        die_with(head, signal.SIGKILL)  # also while a call is in progress
        _alone(pipe)
        with keep_state("it", "its process") as changes, np.errstate(all="ignore"):
            there, file = _There(shared, changes), pipe.fileno()
            alive = _answered(pipe, there, "make", (component, fmu))
            while alive:
                octet = os.read(file, 1)
                if octet == A_CALL:
                    alive = _answered(pipe, there, *pipe.recv())
                elif octet:
                    there.turn(octet == A_STEP)
                    os.write(file, DONE)
                else:
                    alive = False
    finally:
        os._exit(0)  # skip the interpreter's exit handlers, which belong to the parent


def _answered(
    pipe: Connection, there: _There, name: str, arguments: tuple[Any, ...]
) -> bool:
    """Make a rare call and send its result; return whether more requests may follow."""
    error, answer = "", None
    try:
        answer = there.call(name, *arguments)
    except DesatError as raised:
        is_known = type(raised).__name__ in _ERRORS
        error = type(raised).__name__ if is_known else DesatError.__name__
        answer = [str(raised)]
    except Exception as raised:
        error, answer = RuntimeError.__name__, [f"{type(raised).__name__}: {raised}"]
    pipe.send_bytes(encode_answer(there.messages, error, answer))
    return name != "close" and (name != "make" or not error)
