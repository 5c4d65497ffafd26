"""Errors that a user reads: one clear line each."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class DesatError(Exception):
    """Something the user can mend; the text names file, component and variable, what was got and
    what is allowed."""


def nearest(name: str, known: Iterable[str]) -> str:
    """`; did you mean X?` for the closest known name, or a list of the known names."""
    known = sorted(known)
    close = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
    if close:
        return f"; did you mean {close[0]}?"
    if len(known) > 12:
        known = [*known[:12], "…"]
    return f"; there is {', '.join(known)}" if known else ""
