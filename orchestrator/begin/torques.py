"""Read a given torque that replaces drag, light and residual dipole of the class."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from desat.components.blocks.disturbance_table import ROWS

from ..files.columns import Row, read_columns
from ..system.errors import DesatError
from ..system.quantity import Quantity
from .facts import CraftFacts

FRAMES = ("body", "lvlh", "eci")
SECULAR = Quantity("--secular", "N.m", -1e4, 1e4, bare=False)


# s, N m: the columns of a file; `names` are other headings of theirs
UNITS = {"t": "s", "x": "N.m", "y": "N.m", "z": "N.m"}
NAMES = {
    "t": ("time",),
    **{axis: (f"t{axis}", f"tau_{axis}", f"torque_{axis}") for axis in "xyz"},
}


@dataclass(frozen=True)
class GivenTorque:
    """A torque by `--secular`, `--torque` or both, which add up."""

    option: str
    frame: str
    rows: tuple[Row, ...]
    # N m, body: added to the rows
    constant: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def repeated(self) -> bool:
        """Return whether the rows have an end after which they repeat."""
        return len(self.rows) > 1

    @property
    def worse(self) -> tuple[float, ...]:
        """Return 1.3 times the constant part (N m, body)."""
        return tuple(1.3 * x for x in self.constant)

    @property
    def size(self) -> float:
        """Return the size of the mean torque (N m).

        Of a table in eci and a constant part in body, whose directions turn against
        each other, it is the root of the sum of squares.
        """
        table, constant = np.array(self.rows), np.array(self.constant)
        mean = table[0, 1:]
        if self.repeated:
            impulse = np.trapezoid(table[:, 1:], table[:, 0], axis=0)
            mean = impulse / (table[-1, 0] - table[0, 0])
        if self.frame == "eci":
            return float(np.hypot(np.linalg.norm(mean), np.linalg.norm(constant)))
        return float(np.linalg.norm(mean + constant))


def given_torque(facts: CraftFacts) -> GivenTorque | None:
    """Return the given torque, or None where the class's torques are modelled.

    Raises
    ------
    DesatError
        If an option or its file is invalid, or several files do not add up: they need
        one frame and one duration.
    """
    steady = None if facts.secular is None else _secular(facts.secular)
    if not facts.torque:
        return (
            None
            if steady is None
            else GivenTorque("--secular", "body", ((0.0, *steady),))
        )
    texts = [facts.torque] if isinstance(facts.torque, str) else facts.torque
    tables = [_table(text) for text in texts]
    (frame, rows), *others = tables
    for text, (other_frame, other_rows) in zip(texts[1:], others, strict=True):
        if other_frame != frame:
            raise DesatError(
                f"--torque {text}: it is in {other_frame}, and --torque {texts[0]} in "
                f"{frame}: torques of one frame add up"
            )
        rows = _sum_of(rows, other_rows, f"--torque {text}", f"--torque {texts[0]}")
    if steady is None:
        return GivenTorque("--torque", frame, rows)
    return GivenTorque("--torque and --secular", frame, rows, steady)


def _table(text: str) -> tuple[str, tuple[Row, ...]]:
    """Return frame and rows of a typed file."""
    name, _, frame = text.strip().rpartition(" ")
    if not name or frame not in FRAMES:
        name, frame = text.strip(), "body"
    return frame, read(Path(name))


def _sum_of(
    rows: tuple[Row, ...], others: tuple[Row, ...], place: str, first: str
) -> tuple[Row, ...]:
    """Add the torques of two tables, at the times of both.

    Between its rows each torque is a straight line; one of a single row is constant.
    """
    one, two = np.array(rows), np.array(others)
    if len(one) > 1 and len(two) > 1:
        ends = [(table[0, 0], table[-1, 0]) for table in (one, two)]
        if ends[0] != ends[1]:
            raise DesatError(
                f"{place}: it is from {ends[1][0]:g} to {ends[1][1]:g} s, and {first} "
                f"from {ends[0][0]:g} to {ends[0][1]:g} s: tables that repeat together "
                "have the same ends"
            )
    longer = [table[:, 0] for table in (one, two) if len(table) > 1] or [one[:1, 0]]
    times = np.unique(np.concatenate(longer))
    if len(times) > ROWS:
        raise DesatError(
            f"{place}: with {first} {len(times)} rows; {ROWS} are taken at most: thin it"
        )
    total = np.zeros((len(times), 3))
    for t in (one, two):
        for k in range(3):
            total[:, k] += np.interp(times, t[:, 0], t[:, k + 1])
    return tuple(
        (t, *torque) for t, torque in zip(times.tolist(), total.tolist(), strict=True)
    )


def _secular(text: str) -> tuple[float, float, float]:
    """Parse a constant torque (N m, body); a single number is about y."""
    values = SECULAR.many(text)
    if len(values) not in (1, 3):
        raise DesatError(
            f"--secular {text}: one torque, about y, or three are needed, as 80uNm"
        )
    if not any(values):
        raise DesatError(f"--secular {text}: a torque other than 0 is needed")
    x, y, z = values if len(values) == 3 else (0.0, *values, 0.0)
    return x, y, z


def read(file: Path) -> tuple[Row, ...]:
    """Read the rows of a csv file; its first line may name columns and units.

    Raises
    ------
    DesatError
        If a heading or a row is wrong, times do not increase, or there are no or too
        many rows.
    """
    place = f"--torque {file}"
    rows = read_columns(file, place, UNITS, NAMES)
    for before, row in pairwise(rows):
        if row[0] <= before[0]:
            raise DesatError(
                f"{place}: its time {row[0]:g} s is not after that of the row before, "
                f"{before[0]:g} s"
            )
    if len(rows) > ROWS:
        raise DesatError(
            f"{place}: {len(rows)} rows; {ROWS} are taken at most: thin it"
        )
    return rows
