"""Read a given torque that replaces drag, light and residual dipole of the class."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from desat.components.blocks.disturbance_table import ROWS

from ..files import io
from ..system.errors import DesatError
from ..system.quantity import Quantity, is_float
from .facts import CraftFacts

FRAMES = ("body", "lvlh", "eci")
SECULAR = Quantity("--secular", "N.m", -1e4, 1e4, bare=False)

Row = tuple[float, ...]  # time s, torque about x, y, z N m


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
        """Return an estimate of the mean torque (N m).

        It is the magnitude of the rows' mean plus that of the constant part.
        """
        table = np.array(self.rows)
        constant = float(np.linalg.norm(self.constant))
        if not self.repeated:
            return float(np.linalg.norm(table[0, 1:])) + constant
        impulse = np.trapezoid(table[:, 1:], table[:, 0], axis=0)
        return float(np.linalg.norm(impulse) / (table[-1, 0] - table[0, 0])) + constant


def given_torque(facts: CraftFacts) -> GivenTorque | None:
    """Return the given torque, or None where the class's torques are modelled.

    Raises
    ------
    DesatError
        If the option or its file is invalid.
    """
    steady = None if facts.secular is None else _secular(facts.secular)
    if facts.torque is None:
        return (
            None
            if steady is None
            else GivenTorque("--secular", "body", ((0.0, *steady),))
        )
    name, _, frame = facts.torque.strip().rpartition(" ")
    if not name or frame not in FRAMES:
        name, frame = facts.torque.strip(), "body"
    rows = read(Path(name))
    if steady is None:
        return GivenTorque("--torque", frame, rows)
    return GivenTorque("--torque and --secular", frame, rows, steady)


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
    """Read the rows of a csv file; its first line may name the columns.

    Raises
    ------
    DesatError
        If a row is no four numbers, times do not increase, or there are no or too many
        rows.
    """
    place = f"--torque {file}"
    rows: list[Row] = []
    for number, line in enumerate(io.text(file, place).splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        row = _numbers(line)
        if row is None and number == 1 and not _has_number(line):
            continue  # a heading
        if row is None:
            raise DesatError(
                f"{place}:{number}: four numbers are needed, t in s and the torque "
                f"about x, y, z in N m; got {line.strip()[:60]}"
            )
        if rows and row[0] <= rows[-1][0]:
            raise DesatError(
                f"{place}:{number}: its time {row[0]:g} s is not after that of the "
                f"row before, {rows[-1][0]:g} s"
            )
        rows.append(row)
    if not rows:
        raise DesatError(f"{place}: there is no row of four numbers")
    if len(rows) > ROWS:
        raise DesatError(
            f"{place}: {len(rows)} rows; {ROWS} are taken at most: thin it"
        )
    return tuple(rows)


def _numbers(line: str) -> Row | None:
    """Return the four finite numbers of a line, or None if it has others."""
    try:
        row = tuple(float(x) for x in line.replace(";", ",").split(","))
    except ValueError:
        return None
    return row if len(row) == 4 and all(math.isfinite(x) for x in row) else None


def _has_number(line: str) -> bool:
    """Return whether a field of a line is a number, so that it is no heading.

    nan and inf count as numbers.
    """
    return any(is_float(field) for field in line.replace(";", ",").split(","))
