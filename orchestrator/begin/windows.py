"""Read the times in which dumps may be, or may not be, from a csv file."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from desat.components.blocks.manager_threshold import WINDOWS

from ..files.columns import read_columns
from ..system.errors import DesatError
from ..system.quantity import Quantity

UNITS = {"begin": "s", "end": "s"}
NAMES = {"begin": ("start", "from", "rise", "aos"), "end": ("stop", "to", "set", "los")}
AFTER = Quantity("each", "s", 60.0, 1e9, bare=False)
EVER = 1e9  # s: no run is as long
_FORM = re.compile(r"(.*?)\s+(within|outside)\s+(.+?)(?:\s+each\s+(\S+))?\s*")


@dataclass(frozen=True)
class Windows:
    """Times in which dumps may be."""

    rows: tuple[tuple[float, float], ...]  # s: begin and end of each
    period: float  # s, after which they repeat; 0: they do not
    origin: str


def windows_of(text: str) -> tuple[str, Windows | None]:
    """Split the windows of dumps, as within contacts.csv, from what stands before.

    `outside` takes what lies between the windows; `each 7d` repeats them.

    Raises
    ------
    DesatError
        If a file, a row or the time after which they repeat is wrong.
    """
    match = _FORM.fullmatch(text)
    if match is None:
        return text, None
    place = f"--dump: {match[2]} {match[3]}"
    table = read_columns(Path(match[3]), place, UNITS, NAMES)
    rows = [(begin, end) for begin, end in table]
    _check(rows, place)
    period = 0.0 if match[4] is None else AFTER(match[4])
    if 0.0 < period < rows[-1][1]:
        raise DesatError(
            f"{place} each {match[4]}: the last window ends at {rows[-1][1]:g} s, after that"
        )
    if match[2] == "outside":
        times = [0.0, *(t for row in rows for t in row), period or EVER]
        rows = [x for x in zip(times[::2], times[1::2], strict=True) if x[0] < x[1]]
    if len(rows) > WINDOWS:
        raise DesatError(
            f"{place}: {len(rows)} windows; {WINDOWS} are taken at most: a shorter file with "
            "`each 7d` repeats"
        )
    return match[1], Windows(tuple(rows), period, f"{match[2]} {match[3]}")


def _check(rows: list[tuple[float, float]], place: str) -> None:
    """Raise DesatError where a window is empty, or begins before the last one ends."""
    for begin, end in rows:
        if not 0.0 <= begin < end:
            raise DesatError(
                f"{place}: a window from {begin:g} to {end:g} s: it is empty"
            )
    for before, row in pairwise(rows):
        if row[0] < before[1]:
            raise DesatError(
                f"{place}: the window at {row[0]:g} s begins before the last one ends, at "
                f"{before[1]:g} s"
            )
