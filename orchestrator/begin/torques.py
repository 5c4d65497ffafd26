"""A torque that is given in the place of those that a new craft is modelled with."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from desat.components.blocks.disturbance_table import ROWS

from ..files import io
from ..system.errors import DesatError
from ..system.quantity import Quantity
from .facts import CraftFacts

FRAMES = ("body", "lvlh", "eci")
SECULAR = Quantity("--secular", "N.m", -1e4, 1e4)

Row = tuple[float, ...]
"""Time s, torque about x, y, z N m."""


@dataclass(frozen=True)
class GivenTorque:
    """It takes the place of drag, radiation and residual dipole."""

    option: str
    frame: str
    rows: tuple[Row, ...]

    @property
    def repeated(self) -> bool:
        """Whether it has an end to begin anew at."""
        return len(self.rows) > 1

    @property
    def size(self) -> float:
        """Of its mean (N m)."""
        table = np.array(self.rows)
        if not self.repeated:
            return float(np.linalg.norm(table[0, 1:]))
        impulse = np.trapezoid(table[:, 1:], table[:, 0], axis=0)
        return float(np.linalg.norm(impulse) / (table[-1, 0] - table[0, 0]))


def given_torque(wanted: CraftFacts) -> GivenTorque | None:
    """What is given; None: the torques are modelled. Raises DesatError."""
    if wanted.secular is not None and wanted.torque is not None:
        raise DesatError("--secular, --torque: one of them says the torque")
    if wanted.secular is not None:
        values = SECULAR.many(wanted.secular)
        if len(values) not in (1, 3):
            raise DesatError(f"--secular {wanted.secular}: one torque, about y, or three are "
                             "needed, as 80uNm")  # fmt: skip
        if not any(values):
            raise DesatError(f"--secular {wanted.secular}: a torque other than 0 is needed")
        about = values if len(values) == 3 else (0.0, *values, 0.0)
        return GivenTorque("--secular", "body", ((0.0, *about),))
    if wanted.torque is None:
        return None
    name, _, frame = wanted.torque.strip().rpartition(" ")
    if not name or frame not in FRAMES:
        name, frame = wanted.torque.strip(), "body"
    return GivenTorque("--torque", frame, read(Path(name)))


def read(file: Path) -> tuple[Row, ...]:
    """The rows of a csv; its first line may name the columns. Raises DesatError."""
    where = f"--torque {file}"
    rows: list[Row] = []
    for number, line in enumerate(io.text(file, where).splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        row = _numbers(line)
        if row is None and number == 1:
            continue
        if row is None:
            raise DesatError(f"{where}:{number}: four numbers are needed, t in s and the torque "
                             f"about x, y, z in N m; got {line.strip()[:60]}")  # fmt: skip
        if rows and row[0] <= rows[-1][0]:
            raise DesatError(f"{where}:{number}: its time {row[0]:g} s is not after that of the "
                             f"row before, {rows[-1][0]:g} s")  # fmt: skip
        rows.append(row)
    if not rows:
        raise DesatError(f"{where}: there is no row of four numbers")
    if len(rows) > ROWS:
        raise DesatError(f"{where}: {len(rows)} rows; {ROWS} are taken at most: thin it")
    return tuple(rows)


def _numbers(line: str) -> Row | None:
    """The four numbers of a line; None: it has others."""
    try:
        row = tuple(float(x) for x in line.replace(";", ",").split(","))
    except ValueError:
        return None
    return row if len(row) == 4 and all(math.isfinite(x) for x in row) else None
