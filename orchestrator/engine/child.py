"""Work in a process of its own, which a component may end, or never come back from.

The parent waits, hands signals on, and reports: what the run says of itself when it
ends, or else component and call, and the signal or exit code that ended it. Nothing is
added to a step but what `current_call.py` says.
"""

from __future__ import annotations

import os
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, Pipe
from typing import Any, NoReturn, TypeVar

from ..system.errors import DesatError, Exit
from . import current_call, process_state
from .instances.base import EndedError
from .recording.row_buffer import Layout, RowBuffer

T = TypeVar("T")
CAN = process_state.CAN_FORK
_LOOK = 0.2
"""The parent looks at its child so often (s)."""
_LATER = 0.5
"""So much (s) after the limit of an isolated component has ended that component alone.
"""
_AT_ONCE = 0.8 * _LATER
"""No more (s) between two looks is a call's: both processes may have been stopped
(Ctrl-Z). Less than `_LATER`, so that a call which was stopped has its whole limit when
it goes on."""


@dataclass
class Ended:
    """How a watched process ended. `reports`: what it has said by name (`layout`,
    `error`)."""

    reports: dict[str, Any] = field(default_factory=dict)
    component: str = ""
    call: str = ""
    how: str = ""
    """`SIGSEGV`, `exit(3)`; empty for one that ended as it should."""
    hung: float = 0.0
    """The time (s) that it was left in one call, until it was ended."""
    signal: int = 0
    """The signal that the parent got, and handed on."""

    def text(self) -> str:
        """The line about one that did not end as it should."""
        if not self.call:
            return f"the process of the run ended by {self.how}, outside a call of a component"
        if self.hung:
            return (
                f"{self.component}: {self.call} did not return within {self.hung:g} s"
            )
        return f"{self.component}: {self.call} ended the process: {self.how}"


def watch(
    work: Callable[[Callable[[str, Any], None], RowBuffer], None],
    order: Sequence[str],
    unwritten: RowBuffer,
    limit: float,
) -> Ended:
    """Do `work(tell, unwritten)` in a forked process, and say how that ended; after
    `limit` s in one call of a component of `order`, or a second signal to stop, it is
    killed."""
    ours, theirs = Pipe(duplex=False)
    sys.stdout.flush()
    sys.stderr.flush()
    parent, ended = os.getpid(), Ended()
    child = process_state.fork()
    if child == 0:
        _work(work, theirs, unwritten, parent)
    theirs.close()
    with _handed_on(child, ended):
        status = _wait(child, ours, ended, limit)
    ours.close()
    if status not in (0, current_call.UNKNOWN) or "done" not in ended.reports:
        ended.how = current_call.how(status)
    if ended.how:
        ended.component, ended.call = current_call.place_of(order)
    current_call.word[0] = 0
    return ended


def apart(work: Callable[[], T], order: Sequence[str], limit: float) -> T:
    """What `work` gives, done in a forked process as by `watch`. Raises what it raises;
    EndedError where a component has ended that process, and KeyboardInterrupt or
    SystemExit for a signal."""
    ended = watch(
        lambda tell, unwritten: tell("made", work()), order, RowBuffer(), limit
    )
    stopped(ended)
    if "error" in ended.reports:
        kind, arguments = ended.reports["error"]
        raise kind(*arguments)
    if "system" in ended.reports:
        raise OSError(*ended.reports["system"])
    if "bug" in ended.reports:
        raise RuntimeError(ended.reports["bug"])
    if ended.how:
        raise EndedError(ended.text(), Exit.TIMEOUT if ended.hung else Exit.COMPONENT)
    made: T = ended.reports["made"]
    return made


def stopped(ended: Ended) -> None:
    """Raise KeyboardInterrupt or SystemExit where a signal has stopped it."""
    if ended.signal == signal.SIGINT:
        raise KeyboardInterrupt
    if ended.signal:
        raise SystemExit(128 + ended.signal)


def layout_of(ended: Ended) -> Layout | None:
    """Where the rows in memory lie; None where the run had none yet."""
    layout: Layout | None = ended.reports.get("layout")
    return layout


def _work(
    work: Callable[[Callable[[str, Any], None], RowBuffer], None],
    pipe: Connection,
    unwritten: RowBuffer,
    parent: int,
) -> NoReturn:
    """The child: what it does, and then nothing more, not even what the interpreter
    would."""

    def tell(name: str, what: Any) -> None:
        pipe.send((name, what))

    try:
        process_state.die_with(parent, signal.SIGTERM)
        process_state.adopt()
        os.dup2(2, 1)  # what an FMU prints is no result
        try:
            work(tell, unwritten)
            tell("done", True)
        except DesatError as error:
            tell("error", (type(error), error.args))
            tell("done", True)
        except (
            KeyboardInterrupt,
            SystemExit,
        ):  # told to stop where it was not stepping
            pass
        except BaseException as error:
            if os.environ.get("DESAT_TRACEBACK"):
                traceback.print_exc()
            if isinstance(error, OSError):
                tell("system", (error.errno, error.strerror, error.filename))
            tell("bug", f"{type(error).__name__}: {error}")
            tell("done", True)
            process_state.end()
            os._exit(0)  # while `error` holds all: files that are full cannot be closed
    finally:
        process_state.end()
        os._exit(0)


def _wait(child: int, pipe: Connection, ended: Ended, limit: float) -> int:
    """Listen until the child has ended; its status."""
    listening, seen, since, looked = True, current_call.now(), 0.0, time.monotonic()
    while True:
        if listening and pipe.poll(_LOOK):
            try:
                name, what = pipe.recv()
                ended.reports[name] = what
            except (EOFError, OSError):
                listening = False
            continue
        if (status := current_call.status_of(child)) is not None:
            return status
        if not listening:
            time.sleep(0.01)
        past, looked = looked, time.monotonic()
        if (now := current_call.now()) != seen or not now[0]:
            seen, since = now, 0.0
        else:
            since += min(looked - past, _AT_ONCE)
        if since > limit + _LATER:
            ended.hung = limit
            os.kill(child, signal.SIGKILL)


@contextmanager
def _handed_on(child: int, ended: Ended) -> Iterator[None]:
    """Within: the first signal to stop is handed on to the child, the second kills it."""
    first = [0.0]

    def handler(number: int, frame: Any) -> None:
        again = (
            ended.signal and time.monotonic() - first[0] > 0.3
        )  # a terminal tells us twice
        if not ended.signal:
            ended.signal, first[0] = number, time.monotonic()
        with suppress(ProcessLookupError):
            os.kill(child, signal.SIGKILL if again else number)

    try:
        previous = {n: signal.signal(n, handler) for n in process_state.stop_signals()}
    except ValueError:  # not the main thread: nobody tells us
        yield
        return
    try:
        yield
    finally:
        for number, before in previous.items():
            signal.signal(number, before)
