"""Run work in a process of its own, which a component may end or block for ever.

The parent waits, forwards signals, and reports either what the run says when it ends,
or component and call, and the signal or exit code that ended it. A step takes no
longer, except for what `current_call.py` writes.
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
_LOOK = 0.2  # s: period at which the parent looks at its child
# s: delay after a call's limit, so that an isolated component alone is ended first.
_LATER = 0.5
# s: maximum time between two looks that counts for a call, as both processes may have been
# stopped (Ctrl-Z). It is less than `_LATER`, so that a stopped call has its whole limit
# when it continues.
_AT_ONCE = 0.8 * _LATER


@dataclass
class Ended:
    """The end of a supervised process.

    `reports` holds what it has sent, by name (`layout`, `error`).
    """

    reports: dict[str, Any] = field(default_factory=dict)
    component: str = ""
    call: str = ""
    exit_text: str = ""  # `SIGSEGV`, `exit(3)`; empty after a normal end
    hung: float = 0.0  # s: limit of one call, after which the process was killed
    signal: int = 0  # the signal that the parent received and forwarded

    def text(self) -> str:
        """Describe, in one line, a process that did not end normally."""
        if not self.call:
            return f"the process of the run ended by {self.exit_text}, outside a call of a component"
        if self.hung:
            return (
                f"{self.component}: {self.call} did not return within {self.hung:g} s"
            )
        return f"{self.component}: {self.call} ended the process: {self.exit_text}"


def watch(
    work: Callable[[Callable[[str, Any], None], RowBuffer], None],
    order: Sequence[str],
    unwritten: RowBuffer,
    limit: float,
) -> Ended:
    """Run `work(tell, unwritten)` in a forked process and describe how that ended.

    The process is killed after `limit` s in one call of a component of `order`, or at a
    second signal to stop.
    """
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
        ended.exit_text = current_call.describe_exit(status)
    if ended.exit_text:
        ended.component, ended.call = current_call.place_of(order)
    current_call.word[0] = 0
    return ended


def apart(work: Callable[[], T], order: Sequence[str], limit: float) -> T:
    """Run `work` in a forked process, as `watch` does, and return its result.

    Raises
    ------
    EndedError
        If a component ended that process.
    KeyboardInterrupt, SystemExit
        If a signal stopped it.
    Exception
        Whatever `work` raises.
    """
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
    if ended.exit_text:
        raise EndedError(ended.text(), Exit.TIMEOUT if ended.hung else Exit.COMPONENT)
    result: T = ended.reports["made"]
    return result


def stopped(ended: Ended) -> None:
    """Raise KeyboardInterrupt or SystemExit if a signal stopped the process."""
    if ended.signal:
        raise_stop(ended.signal)


def raise_stop(number: int) -> NoReturn:
    """Raise the exception of a signal to stop: KeyboardInterrupt or SystemExit."""
    if number == signal.SIGINT:
        raise KeyboardInterrupt
    raise SystemExit(128 + number)


def layout_of(ended: Ended) -> Layout | None:
    """Return the layout of the rows in memory; None if the run had none yet."""
    layout: Layout | None = ended.reports.get("layout")
    return layout


def _work(
    work: Callable[[Callable[[str, Any], None], RowBuffer], None],
    pipe: Connection,
    unwritten: RowBuffer,
    parent: int,
) -> NoReturn:
    """Run the child: do the work, and exit without the interpreter's handlers."""

    def tell(name: str, message: Any) -> None:
        pipe.send((name, message))

    try:
        process_state.die_with(parent, signal.SIGTERM)
        process_state.adopt()
        os.dup2(2, 1)  # the output of an FMU must not mix with results
        try:
            work(tell, unwritten)
            tell("done", True)
        except DesatError as error:
            tell("error", (type(error), error.args))
            tell("done", True)
        except (
            KeyboardInterrupt,
            SystemExit,
        ):  # stopped while it was not stepping
            pass
        except BaseException as error:
            if os.environ.get("DESAT_TRACEBACK"):
                traceback.print_exc()
            if isinstance(error, OSError):
                tell("system", (error.errno, error.strerror, error.filename))
            tell("bug", f"{type(error).__name__}: {error}")
            tell("done", True)
            process_state.end()
            # exit while `error` keeps all alive: files on a full disk cannot be closed
            os._exit(0)
    finally:
        process_state.end()
        os._exit(0)


def _wait(child: int, pipe: Connection, ended: Ended, limit: float) -> int:
    """Collect reports until the child has ended and return its status."""
    listening, seen, since, looked = True, current_call.now(), 0.0, time.monotonic()
    while True:
        if listening and pipe.poll(_LOOK):
            try:
                name, message = pipe.recv()
                ended.reports[name] = message
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
    """Forward the first signal to stop to the child; at the second, kill it."""
    first = [0.0]

    def handler(number: int, frame: Any) -> None:
        again = (
            ended.signal and time.monotonic() - first[0] > 0.3
        )  # a terminal sends it twice
        if not ended.signal:
            ended.signal, first[0] = number, time.monotonic()
        with suppress(ProcessLookupError):
            os.kill(child, signal.SIGKILL if again else number)

    try:
        previous = {n: signal.signal(n, handler) for n in process_state.stop_signals()}
    except ValueError:  # not the main thread, which alone gets signals
        yield
        return
    try:
        yield
    finally:
        for number, before in previous.items():
            signal.signal(number, before)
