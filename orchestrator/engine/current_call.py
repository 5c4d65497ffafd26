"""Record the component call that a process is in, in memory shared with its parent.

When a component ends the process, or never returns, the parent reads here which one it
was. A word and a time are written, without a call: the loop writes them before each
call that it makes.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import signal
from collections.abc import Sequence

VERBS = (
    "",
    "instantiating it",
    "entering initialisation",
    "leaving initialisation",
    "setting its inputs",
    "the step",
    "reading its outputs",
    "freeing it",
    "saving its state",
    "restoring its state",
    "terminating it",
)
INSTANTIATE, ENTER, EXIT, PUSH, STEP, PULL, FREE, SAVE, RESTORE, TERMINATE = range(
    1, 11
)
PLACE = 16  # a word is PLACE times a component's place, plus the verb

UNKNOWN = -1  # in place of the status of a process that has ended

page = mmap.mmap(
    -1, mmap.PAGESIZE
)  # anonymous and shared: a forked child writes to the same memory
# word[0]: PLACE times the component's place in the order of the schedule, plus the verb;
# 0 if no call is in progress.
word = memoryview(page)[:8].cast("q")
time = memoryview(page)[8:16].cast("d")  # time[0]: the time of the call (s)


def address(of: memoryview[int] | memoryview[float]) -> int:
    """Return the address of the word or the time, for the compiled loop."""
    return ctypes.addressof(ctypes.c_char.from_buffer(of))


def now() -> tuple[int, float]:
    """Return word and time, which change when the process makes progress."""
    return word[0], time[0]


def place_of(order: Sequence[str]) -> tuple[str, str]:
    """Return component and call that the process is in, or was in last.

    Both are empty for none.
    """
    place, verb = divmod(word[0], PLACE)
    if not verb:
        return "", ""
    return order[place], describe(verb)


def describe(verb: int) -> str:
    """Describe a call in words."""
    if verb in (PUSH, STEP, PULL, SAVE):
        return f"{VERBS[verb]}{' from' if verb == STEP else ' at'} t = {time[0]:g} s"
    return VERBS[verb]


def status_of(process: int) -> int | None:
    """Return the status of a child that has ended; None while it runs.

    The child is reaped. UNKNOWN is returned if its status cannot be had.
    """
    try:
        ended_process, status = os.waitpid(process, os.WNOHANG)
    except ChildProcessError:  # the parent of this process made it ignore SIGCHLD
        return UNKNOWN
    return status if ended_process else None


def describe_exit(status: int) -> str:
    """Describe how a process ended from its wait status: `SIGSEGV`, `exit(3)`."""
    if status == UNKNOWN:
        return "in a way that the system does not tell (SIGCHLD is ignored)"
    if not os.WIFSIGNALED(status):
        return f"exit({os.WEXITSTATUS(status)})"
    number = os.WTERMSIG(status)
    return (
        signal.Signals(number).name
        if number in set(signal.Signals)
        else f"signal {number}"
    )
