"""A torque that is given in the place of the class's drag, light and residual dipole."""

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

Row = tuple[float, ...]
"""Time s, torque about x, y, z N m."""


@dataclass(frozen=True)
class GivenTorque:
    """A torque by `--secular`, `--torque` or both, which add up."""

    option: str
    frame: str
    rows: tuple[Row, ...]
    constant: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """N m, body: beside the rows"""

    @property
    def repeated(self) -> bool:
        """Whether it has an end to begin anew at."""
        return len(self.rows) > 1

    @property
    def worse(self) -> tuple[float, ...]:
        """1.3 times the constant part (N m, body)."""
        return tuple(1.3 * x for x in self.constant)

    @property
    def size(self) -> float:
        """Of its mean (N m)."""
        table = np.array(self.rows)
        beside = float(np.linalg.norm(self.constant))
        if not self.repeated:
            return float(np.linalg.norm(table[0, 1:])) + beside
        impulse = np.trapezoid(table[:, 1:], table[:, 0], axis=0)
        return float(np.linalg.norm(impulse) / (table[-1, 0] - table[0, 0])) + beside


def given_torque(wanted: CraftFacts) -> GivenTorque | None:
    """Return the torque that is given, or None where the class's torques are modelled.

    Raises DesatError.
    """
    steady = None if wanted.secular is None else _secular(wanted.secular)
    if wanted.torque is None:
        return (
            None
            if steady is None
            else GivenTorque("--secular", "body", ((0.0, *steady),))
        )
    name, _, frame = wanted.torque.strip().rpartition(" ")
    if not name or frame not in FRAMES:
        name, frame = wanted.torque.strip(), "body"
    rows = read(Path(name))
    if steady is None:
        return GivenTorque("--torque", frame, rows)
    return GivenTorque("--torque and --secular", frame, rows, steady)


def _secular(text: str) -> tuple[float, float, float]:
    """Return a constant torque (N m, body), about y where one number is given."""
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
    """The rows of a csv; its first line may name the columns. Raises DesatError."""
    where = f"--torque {file}"
    rows: list[Row] = []
    for number, line in enumerate(io.text(file, where).splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        row = _numbers(line)
        if row is None and number == 1 and not _has_number(line):
            continue  # a heading
        if row is None:
            raise DesatError(
                f"{where}:{number}: four numbers are needed, t in s and the torque "
                f"about x, y, z in N m; got {line.strip()[:60]}"
            )
        if rows and row[0] <= rows[-1][0]:
            raise DesatError(
                f"{where}:{number}: its time {row[0]:g} s is not after that of the "
                f"row before, {rows[-1][0]:g} s"
            )
        rows.append(row)
    if not rows:
        raise DesatError(f"{where}: there is no row of four numbers")
    if len(rows) > ROWS:
        raise DesatError(
            f"{where}: {len(rows)} rows; {ROWS} are taken at most: thin it"
        )
    return tuple(rows)


def _numbers(line: str) -> Row | None:
    """The four numbers of a line; None: it has others."""
    try:
        row = tuple(float(x) for x in line.replace(";", ",").split(","))
    except ValueError:
        return None
    return row if len(row) == 4 and all(math.isfinite(x) for x in row) else None


def _has_number(line: str) -> bool:
    """Return whether a field of a line is a number, nan and inf among them: no heading
    then."""
    return any(is_float(field) for field in line.replace(";", ",").split(","))
