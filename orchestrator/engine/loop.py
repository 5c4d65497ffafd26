"""The stepping loop of a run: to the end, to a condition, or to the first signal to stop."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from .master import Master
from .results import Recorder

AGAIN = 0.3
"""A signal so soon after the first (s) is the same one: a terminal and a parent both send it."""


def never() -> str:
    """A run that nothing ends before its stop time."""
    return ""


def loop(
    master: Master, steps: int, recorder: Recorder, interrupted: Callable[[], int],
    report: Callable[[int], None], finished: Callable[[], str] = never,
) -> str:  # fmt: skip
    """Step to the end, to the first signal to stop, or until `finished`, asked after every step,
    gives a reason, which is returned; look at the clock twenty times a second."""
    advance, record = master.advance, recorder.record
    chunk = 1
    while master.k < steps and not interrupted():
        began = time.perf_counter()
        for _ in range(min(chunk, steps - master.k)):
            advance(record)
            if reason := finished():
                return reason
            if interrupted():
                break
        seconds = time.perf_counter() - began
        chunk = max(1, min(2 * chunk, int(chunk * 0.05 / max(seconds, 1e-6))))
        recorder.tick()
        report(master.k)
    return ""


@contextmanager
def interruptible() -> Iterator[Callable[[], int]]:
    """Within: a signal to stop only leaves its number, for an exception inside an FMU would crash
    the process; a second one, later than AGAIN, ends it."""
    got, first = [0], [0.0]

    def handler(number: int, frame: Any) -> None:
        if got[0] and time.monotonic() - first[0] > AGAIN:
            os._exit(128 + number)
        if not got[0]:
            got[0], first[0] = number, time.monotonic()

    names = ("SIGINT", "SIGTERM", "SIGHUP")  # Windows has no SIGHUP
    try:
        previous = {
            n: signal.signal(n, handler)
            for n in (getattr(signal, x) for x in names if hasattr(signal, x))
        }
    except ValueError:  # not the main thread: nobody can interrupt us
        yield lambda: 0
        return
    try:
        yield lambda: got[0]
    finally:
        for number, before in previous.items():
            signal.signal(number, before)


@contextmanager
def bar(name: str, steps: int, wanted: bool) -> Iterator[Callable[[int], None]]:
    """Within: a progress bar on a terminal, which is told the steps done."""
    if not (wanted and sys.stderr.isatty()):
        yield lambda k: None
        return
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:.0f} %"),
               TimeRemainingColumn())  # fmt: skip
    with Progress(*columns, transient=True, console=Console(stderr=True)) as progress:
        task = progress.add_task(name, total=steps)
        yield lambda k: progress.update(task, completed=k)
