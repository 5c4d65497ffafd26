"""Where many calls run: processes of this machine, which may die, or those of a Dask cluster.

Both take `submit(key, *arguments)` of one function, and give `(key, result)` in the order in which
they end, where the result is `Lost` for a call whose process died or passed its time limit.
"""

from __future__ import annotations

import os
import queue
import signal
import sys
import threading
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing import get_context
from types import TracebackType
from typing import Any, Protocol, Self

from ..system.codes import Exit
from ..system.errors import RunError


@dataclass(frozen=True)
class Lost:
    """A call that has no result, and why."""

    why: str
    timeout: bool = False


class Workers(Protocol):
    """What takes calls."""

    size: int
    """Calls that run at the same time."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...  # fmt: skip

    def submit(self, key: Hashable, *arguments: Any) -> None:
        """Have the function called."""

    def ended(self) -> tuple[Hashable, Any]:
        """The next call that has ended; waits for it. Raises what the function raised."""


class Here:
    """This process: each call is made when its result is asked for."""

    size = 1

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        self._waiting: list[tuple[Hashable, tuple[Any, ...]]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._waiting.clear()

    def submit(self, key: Hashable, *arguments: Any) -> None:
        self._waiting.append((key, arguments))

    def ended(self) -> tuple[Hashable, Any]:
        key, arguments = self._waiting.pop(0)
        return key, self._function(*arguments)


class Local:
    """Processes of this machine. One that dies, or takes longer than `limit` s for a call, is
    replaced; only its call is lost."""

    def __init__(self, function: Callable[..., Any], size: int, limit: float | None = None) -> None:
        from pebble import ProcessPool

        self.size = size
        self._function, self._limit = function, limit
        self._pool = ProcessPool(size, initializer=_begin, initargs=(os.getpid(),),
                                 context=get_context("spawn"))  # fmt: skip
        self._done: queue.SimpleQueue[tuple[Hashable, Any]] = queue.SimpleQueue()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self._pool.stop() if kind else self._pool.close()
        self._pool.join()

    def submit(self, key: Hashable, *arguments: Any) -> None:
        future = self._pool.schedule(self._function, arguments, timeout=self._limit)
        future.add_done_callback(lambda ended: self._done.put((key, ended)))

    def ended(self) -> tuple[Hashable, Any]:
        from pebble import ProcessExpired

        key, future = self._done.get()
        try:
            return key, future.result()
        except ProcessExpired as error:
            return key, Lost(f"its process ended by {_how(error.exitcode)}")
        except TimeoutError:
            return key, Lost(f"it was not over within {self._limit:g} s", timeout=True)


def _begin(head: int) -> None:
    """A worker leaves Ctrl-C to its head, and dies with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_die_with, args=(head,), daemon=True).start()


def _die_with(head: int) -> None:
    import time

    while _lives(head):
        time.sleep(1.0)
    os._exit(1)


def _lives(head: int) -> bool:
    """Whether a process is there (a zombie that init has not reaped yet is)."""
    if sys.platform == "win32":
        return True
    return os.getppid() == head


def _how(code: int) -> str:
    """How a process ended, as people say it."""
    if code < 0:
        return signal.Signals(-code).name
    return f"exit({code})"


def mapped(function: Callable[..., Any], tasks: Sequence[tuple[Any, ...]], jobs: int) -> list[Any]:
    """What a function gives for each task, in their order, over so many processes. Raises RunError
    where a process dies."""
    found: dict[Any, Any] = {}
    workers: Workers = Here(function) if min(jobs, len(tasks)) < 2 else Local(function, jobs)
    with workers:
        for key, result in results(workers, iter(enumerate(tasks)), lambda key, why: None):
            if isinstance(result, Lost):
                raise RunError(f"{tasks[key][0]}: {result.why}", Exit.COMPONENT)
            found[key] = result
    return [found[key] for key in range(len(tasks))]


def results(
    workers: Workers, tasks: Iterable[tuple[Hashable, tuple[Any, ...]]],
    again: Callable[[Any, Lost], tuple[Any, ...] | None],
) -> Iterator[tuple[Any, Any]]:  # fmt: skip
    """Each task's key and result in the order in which they end, with a few in advance of what
    runs. A lost call is made once more with the arguments that `again` gives; None: its `Lost` is
    its result."""
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
        if isinstance(result, Lost) and (arguments := again(key, result)) is not None:
            workers.submit(key, *arguments)
            continue
        running -= 1
        yield key, result
