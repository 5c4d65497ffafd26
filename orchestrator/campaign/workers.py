"""Run many calls: in this process, in processes of this machine, or on a Dask cluster.

All take `submit(key, *arguments)` of one function, and return `(key, result)` in the
order in which the calls end. The result is `NoResult` for a call whose process died or
passed its time limit.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import current_process, get_context
from multiprocessing.connection import wait
from typing import Any, Protocol, Self

from ..engine import process_state
from ..system.errors import Exit, RunError

# exit code of a process whose script would start processes while it is imported
UNGUARDED = 78
_GUARD = (
    'the script that asks for runs in several processes needs `if __name__ == "__main__":` '
    "before it does: each process imports it first"
)


def guarded() -> None:
    """End a process that is still importing the main script of its parent.

    In that case the script asks for processes again. The parent reports it.
    """
    if getattr(current_process(), "_inheriting", False):
        sys.exit(UNGUARDED)


@dataclass(frozen=True)
class NoResult:
    """Call that has no result, with the reason."""

    text: str
    timeout: bool = False


class Workers(Protocol):
    """Pool that takes calls."""

    size: int  # calls that run at the same time

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...

    def submit(self, key: Hashable, *arguments: Any) -> None:
        """Submit a call of the function."""

    def ended(self) -> tuple[Hashable, Any]:
        """Wait for the next call that ends; raise what the function raised."""


class Here:
    """Pool of this process alone: each call is made when its result is requested."""

    size = 1

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        self._waiting: list[tuple[Hashable, tuple[Any, ...]]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._waiting.clear()

    def submit(self, key: Hashable, *arguments: Any) -> None:
        """Append a call to the queue."""
        self._waiting.append((key, arguments))

    def ended(self) -> tuple[Hashable, Any]:
        """Make the next call and return its key and result."""
        key, arguments = self._waiting.pop(0)
        return key, self._function(*arguments)


class Local:
    """Pool of processes of this machine.

    A process that dies, or takes longer than `limit` s for a call, is replaced, and
    only its call is lost. Each has a pipe of its own, which identifies the call.

    (concurrent.futures gives up all calls when a process dies; pebble 5.2 loses a call
    whose process dies before its pool has read that it was taken.)
    """

    def __init__(
        self, function: Callable[..., Any], size: int, limit: float | None = None
    ) -> None:
        guarded()
        self.size = size
        self._function, self._limit = function, limit
        self._waiting: deque[tuple[Hashable, tuple[Any, ...]]] = deque()
        self._idle: list[_Worker] = []
        self._busy: list[_Worker] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._busy:
            worker.end()
        for worker in self._idle:
            worker.close()

    def submit(self, key: Hashable, *arguments: Any) -> None:
        """Append a call to the queue, and start it if a process is idle."""
        self._waiting.append((key, arguments))
        self._hand_out()

    def _hand_out(self) -> None:
        """Give waiting calls to idle or new processes."""
        while self._waiting and len(self._busy) < self.size:
            worker = self._idle.pop() if self._idle else _Worker(self._function)
            self._busy.append(worker)
            worker.take(*self._waiting.popleft())

    def ended(self) -> tuple[Hashable, Any]:
        """Wait for the next call that ends, and return its key and result."""
        while True:
            ready = wait([w.pipe for w in self._busy], self._patience())
            late = (
                []
                if self._limit is None
                else [
                    w
                    for w in self._busy
                    if w.pipe not in ready and w.seconds() > self._limit
                ]
            )
            for worker in self._busy:
                if worker.pipe in ready or worker in late:
                    break
            else:
                continue
            key = worker.key
            result: Any
            if worker in late:
                worker.end()
                kind, result = (
                    "lost",
                    NoResult(f"it was not over within {self._limit:g} s", True),
                )
            else:
                kind, result = worker.answer()
            if kind == "ready":
                worker.begin()
                continue
            self._busy.remove(worker)
            if kind != "lost":
                self._idle.append(worker)
            self._hand_out()
            if kind == "raised":
                raise result
            return key, result

    def _patience(self) -> float | None:
        """Return the time (s) until the next running call passes the limit.

        None where there is no limit.
        """
        if self._limit is None:
            return None
        return max(0.0, min(self._limit - w.seconds() for w in self._busy)) + 0.01


class _Worker:
    """Process that takes one call at a time."""

    def __init__(self, function: Callable[..., Any]) -> None:
        """Start a process that calls the function with what is sent to it."""
        # not a fork: all would record their calls in one word (`engine/current_call.py`)
        context = get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.key: Hashable = None
        self._since: float | None = None
        self._ready = False
        self._process = context.Process(
            target=_serve, args=(theirs, function, os.getpid()), daemon=True
        )
        with process_state.one_thread():
            self._process.start()
        theirs.close()

    def take(self, key: Hashable, arguments: tuple[Any, ...]) -> None:
        """Give the process a call."""
        self.key = key
        if self._ready:
            self.begin()
        with suppress(BrokenPipeError):  # the process has died: its answer reports that
            self.pipe.send(arguments)

    def begin(self) -> None:
        """Start the clock of the call, because the process is ready."""
        self._ready, self._since = True, time.monotonic()

    def seconds(self) -> float:
        """Return how long the call has been running (s)."""
        return 0.0 if self._since is None else time.monotonic() - self._since

    def answer(self) -> tuple[str, Any]:
        """Receive the outcome of the call: `result`, `raised` or `lost`, and its value.

        A process that has just started answers `ready`.
        """
        try:
            reply: tuple[str, Any] = self.pipe.recv()
            return reply
        except (EOFError, OSError):
            self._process.join()
            if self._process.exitcode == UNGUARDED and not self._ready:
                return "raised", RunError(_GUARD, Exit.INPUT)
            return "lost", NoResult(
                f"its process ended by {describe_exit(self._process.exitcode or 0)}"
            )

    def end(self) -> None:
        """Kill the process in the middle of a call."""
        self._process.kill()
        self._process.join()

    def close(self) -> None:
        """Close the pipe, and wait for the process to end."""
        self.pipe.close()
        self._process.join()


def _serve(pipe: Any, function: Callable[..., Any], head: int) -> None:
    """Serve calls in a worker process.

    It leaves Ctrl-C to its parent, and ends with it.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    process_state.adopt()
    threading.Thread(target=_die_with, args=(head,), daemon=True).start()
    with suppress(EOFError, OSError):
        pipe.send(("ready", None))
        while True:
            arguments = pipe.recv()
            try:
                answer = ("result", function(*arguments))
            except Exception as error:
                answer = ("raised", error)
            process_state.end()
            try:
                pipe.send(answer)
            except (TypeError, AttributeError, pickle.PicklingError) as error:
                pipe.send(
                    ("raised", RuntimeError(f"{answer[1]!r} cannot be sent: {error}"))
                )


def _die_with(head: int) -> None:
    """End the process when its parent ends, even in the middle of a call."""
    while sys.platform == "win32" or os.getppid() == head:
        time.sleep(1.0)
    os._exit(1)


def describe_exit(code: int) -> str:
    """Describe how a process ended: the name of a signal, or its exit code."""
    if code < 0:
        return signal.Signals(-code).name
    return f"exit({code})"


def results(
    workers: Workers,
    tasks: Iterable[tuple[Hashable, tuple[Any, ...]]],
    again: Callable[[Any, NoResult], Sequence[tuple[Hashable, tuple[Any, ...]]]],
) -> Iterator[tuple[Any, Any]]:
    """Yield key and result of each task in the order in which the tasks end.

    A few tasks are submitted in advance of those that run. A lost call is replaced by
    the calls that `again` returns; if there are none, its `NoResult` is its result.
    """
    tasks, running, more = iter(tasks), 0, True
    while more or running:
        while more and running < 3 * workers.size:
            task = next(tasks, None)
            if more := task is not None:
                workers.submit(task[0], *task[1])
                running += 1
        if not running:
            return
        key, result = workers.ended()
        running -= 1
        if isinstance(result, NoResult) and (others := again(key, result)):
            for other, arguments in others:
                workers.submit(other, *arguments)
            running += len(others)
            continue
        yield key, result
