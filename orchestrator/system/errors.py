"""Errors that a user reads: one clear line each."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

from .codes import Exit

MANY, LONG = 2000, 200
"""Beyond so many names, or characters of one, no nearest is looked for: it would take minutes."""


class DesatError(Exception):
    """Something the user can mend; the text names file, component and variable, what was got and
    what is allowed. `code` is how the command ends."""

    code: Exit = Exit.INPUT


class RunError(DesatError):
    """A run that did not complete: a component failed, or somebody stopped it."""

    def __init__(self, text: str, code: Exit = Exit.COMPONENT) -> None:
        super().__init__(text, code)
        self.code = code

    def __str__(self) -> str:
        return str(self.args[0])


def plain(text: str) -> str:
    """A text of somebody's as one printable line: no control characters reach a terminal."""
    return "".join(x if x.isprintable() else " " if x.isspace() else "\ufffd" for x in text)


def nearest(name: str, known: Iterable[str]) -> str:
    """`; did you mean X?` for the closest known name, or a list of the known names."""
    known = sorted(known)
    if len(known) > MANY or len(name) > LONG:
        return ""
    close = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
    if close:
        return f"; did you mean {close[0]}?"
    if len(known) > 12:
        known = [*known[:12], "…"]
    return f"; there is {', '.join(known)}" if known else ""
