"""Step a run to its end, to a condition, or to the first signal to stop."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Protocol

from ..system.choices import Loop
from .checkpoint import Checkpoints
from .compiled import CompiledSteps, NotCompiledError
from .ending import NEVER, Ending
from .master import Master
from .process_state import stop_signals
from .recording.recorder import Recorder

# s: a signal sooner than this after the first is the same one, which terminal and parent
# both send.
AGAIN = 0.3


class Stepper(Protocol):
    """Steps of an initialised master, and the reason if they are not compiled."""

    @property
    def name(self) -> Loop:
        """Return the name of the loop."""

    @property
    def reason(self) -> str:
        """Return the reason, for people; empty for the compiled loop."""

    seconds: float  # wall time that steps have taken so far

    def some(self, most: int) -> None:
        """Make `most` steps, or fewer if a run may end earlier."""


class StepObserver(Protocol):
    """An observer that examines a run's steps in batches while it runs."""

    @property
    def steps_before_look(self) -> int:
        """Return the number of steps that may be made before it has to look again."""

    def look(self) -> None:
        """Examine the steps made so far."""


class PythonSteps:
    """Steps of an initialised master, one by one."""

    name: Loop = "python"
    seconds = 0.0

    def __init__(self, master: Master, recorder: Recorder | None, reason: str) -> None:
        self._advance, self.reason = master.advance, reason
        self._record = None if recorder is None else recorder.record

    def some(self, most: int) -> None:
        """Make one step."""
        self._advance(self._record)


def stepping(
    master: Master,
    recorder: Recorder | None,
    ending: Ending = NEVER,
    loop: Loop = "compiled",
) -> Stepper:
    """Return the steps of an initialised master by the requested loop.

    The compiled loop is replaced by Python's where it is not available.
    """
    if loop == "python":
        return PythonSteps(master, recorder, "it was asked for")
    try:
        return CompiledSteps(master, recorder, ending)
    except NotCompiledError as error:
        return PythonSteps(master, recorder, str(error))


def run(
    master: Master,
    steps: Stepper,
    until: int,
    recorder: Recorder,
    ending: Ending = NEVER,
    interrupted: Callable[[], int] = lambda: 0,
    report: Callable[[int], None] = lambda k: None,
    checkpoints: Checkpoints | None = None,
    observer: StepObserver | None = None,
) -> str:
    """Step until `until`, a signal to stop, or an ending; return the ending's reason.

    The clock is read twenty times a second.
    """
    chunk = 1
    while master.k < until and not interrupted():
        began, first, edge = time.perf_counter(), master.k, min(master.k + chunk, until)
        if checkpoints is not None:
            edge = min(edge, checkpoints.next(master.k))
        try:
            if observer is not None:
                if observer.steps_before_look < edge - master.k:
                    observer.look()
                edge = min(edge, master.k + max(1, observer.steps_before_look))
            while master.k < edge and not interrupted():
                steps.some(edge - master.k)
                if reason := ending.reason():
                    return reason
        finally:
            seconds = time.perf_counter() - began
            steps.seconds += seconds
        steps_taken = (
            master.k - first
        )  # a chunk that ends early must not grow without bound
        chunk = max(
            1, min(2 * steps_taken, int(steps_taken * 0.05 / max(seconds, 1e-6)))
        )
        recorder.tick()
        report(master.k)
        if checkpoints is not None and checkpoints.due():
            checkpoints.save()
    return ""


@contextmanager
def interruptible() -> Iterator[Callable[[], int]]:
    """Record the number of a signal to stop instead of raising an exception.

    An exception inside an FMU would crash the process. A second signal, later than
    AGAIN, ends the process.
    """
    got, first = [0], [0.0]

    def handler(number: int, frame: Any) -> None:
        if got[0] and time.monotonic() - first[0] > AGAIN:
            os._exit(128 + number)
        if not got[0]:
            got[0], first[0] = number, time.monotonic()

    try:
        previous = {n: signal.signal(n, handler) for n in stop_signals()}
    except ValueError:  # not the main thread, which alone gets signals
        yield lambda: 0
        return
    try:
        yield lambda: got[0]
    finally:
        for number, before in previous.items():
            signal.signal(number, before)
