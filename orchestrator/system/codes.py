"""How the command `desat` ends: its exit codes, and what each means."""

from __future__ import annotations

from enum import IntEnum


class Exit(IntEnum):
    """An exit code, with what it means as its `meaning`."""

    meaning: str

    def __new__(cls, code: int, meaning: str = "") -> Exit:
        member = int.__new__(cls, code)
        member._value_ = code
        member.meaning = meaning
        return member

    COMPLETED = 0, "completed"
    UNMET = 1, "completed, but checks, residual or requirements are not met (`check`: problems)"
    INPUT = 2, "wrong input: it did not begin"
    BUG = 3, "a bug of ours"
    COMPONENT = 4, "a component failed while it ran"
    TIMEOUT = 5, "timed out"
    SPACE = 6, "no space left on the disk"
    HUNG_UP = 129, "stopped as its terminal was closed (SIGHUP)"
    INTERRUPTED = 130, "stopped by Ctrl-C (SIGINT)"
    TERMINATED = 143, "stopped by SIGTERM"
