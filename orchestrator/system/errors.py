"""Define errors that a user reads, as one clear line each."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterable, Mapping, Sequence
from enum import IntEnum
from typing import TypeVar

T = TypeVar("T")


class Exit(IntEnum):
    """Exit code, with its meaning as `meaning`."""

    meaning: str

    def __new__(cls, code: int, meaning: str = "") -> Exit:
        member = int.__new__(cls, code)
        member._value_ = code
        member.meaning = meaning
        return member

    COMPLETED = 0, "completed"
    UNMET = (
        1,
        "completed, but checks, residual or requirements are not met (`check`: problems)",
    )
    INPUT = 2, "wrong input: it did not begin"
    BUG = 3, "a bug of ours"
    COMPONENT = 4, "a component failed while it ran"
    TIMEOUT = 5, "timed out"
    SPACE = 6, "no space left on the disk"
    HUNG_UP = 129, "stopped as its terminal was closed (SIGHUP)"
    INTERRUPTED = 130, "stopped by Ctrl-C (SIGINT)"
    TERMINATED = 143, "stopped by SIGTERM"


# Maximum number of names, and of characters of a name, for which the nearest is searched;
# beyond, the search would take minutes.
MANY, LONG = 2000, 200


class DesatError(Exception):
    """Error that the user can correct.

    The text names file, component and variable, the value and what is allowed. `code`
    is the exit code of the command.
    """

    code: Exit = Exit.INPUT


class MisfitError(DesatError):
    """A value of a file that does not fit.

    `keys` lead to it within its table.
    """

    def __init__(self, text: str, *keys: str) -> None:
        super().__init__(text)
        self.keys = keys


class UnknownSeriesError(DesatError, KeyError):
    """A name that a run has no series of."""

    __str__ = Exception.__str__  # that of KeyError is in quotes


class RunError(DesatError):
    """A run that did not complete: a component failed, or it was stopped."""

    def __init__(self, text: str, code: Exit = Exit.COMPONENT) -> None:
        super().__init__(text, code)
        self.code = code

    def __str__(self) -> str:
        return str(self.args[0])


def plain(text: str) -> str:
    """Convert any text to one printable line.

    No control characters reach a terminal.
    """
    if text.isprintable():
        return text
    return "".join(
        x if x.isprintable() else " " if x.isspace() else "\ufffd" for x in text
    )


def nearest(name: str, names: Iterable[str]) -> str:
    """Suggest the closest known name: `; did you mean X?`.

    If none is close, the known names are listed.
    """
    names = sorted(names)
    if len(names) > MANY or len(name) > LONG:
        return ""
    if close := _closest(name, names):
        return close
    if len(names) > 12:
        names = [*names[:12], "…"]
    return f"; there is {', '.join(names)}" if names else ""


def _closest(name: str, names: Sequence[str]) -> str:
    """Return `; did you mean X?` with the closest of the known names; "": none is."""
    begun = [x for x in names if len(name) > 2 and x.startswith(name)]
    close = begun[:1] or difflib.get_close_matches(name, names, n=1, cutoff=0.6)
    return f"; did you mean {close[0]}?" if close else ""


def choices(name: str, known: Iterable[str], otherwise: str = "") -> str:
    """List all known names in their order, after the closest one if there is one.

    `otherwise` is what else may be given, as ", or a number in N".
    """
    names = list(known)
    return f"{_closest(name, names)}; there is {', '.join(names)}{otherwise}"


def require(name: str, names: Collection[str], subject: str) -> None:
    """Check that a name is known.

    Raises
    ------
    DesatError
        If it is not: `subject` introduces the name, as in "no component", and the nearest
        name follows.
    """
    if name not in names:
        raise DesatError(f"{subject} {name}{nearest(name, names)}")


def look_up(name: str, entries: Mapping[str, T], subject: str) -> T:
    """Return the entry of a name.

    Raises
    ------
    DesatError
        If the name is unknown, as `require`.
    """
    require(name, entries, subject)
    return entries[name]
