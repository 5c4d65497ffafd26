"""Read the thrusters of a new craft: pairs about the axes, or nozzles by layout."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from desat.components.blocks.thrusters_nozzles import SIDES
from desat.components.contract.block import MOST_NOZZLES, NOZZLES
from desat.components.maths.allocation import gives, least_on_times

from ..files import io
from ..files.columns import read_columns
from ..system.errors import DesatError

Array = NDArray[np.float64]
LAYOUTS = (6, 8, 12)
INSIDE = (
    1e-3  # of the largest side: so far into its exhaust a nozzle is free of the body
)
UNITS = {"x": "m", "y": "m", "z": "m", "u": "1", "v": "1", "w": "1", "thrust": "N"}
NAMES = {
    **{x: (f"position_{x}", f"p{x}") for x in "xyz"},
    **{x: (f"direction_{y}", f"d{y}") for x, y in zip("uvw", "xyz", strict=True)},
    "thrust": ("force", "f"),
    "isp": ("specific_impulse", "i_sp"),
}


@dataclass(frozen=True)
class Nozzles:
    """Nozzles of a craft."""

    positions: Array  # (n, 3) m, body
    directions: Array  # (n, 3) of the force on the body
    thrust: Array  # (n,) N
    words: str
    isp: float | None = None  # s, where a file says it
    is_paired: bool = False  # whether each two after another are a couple

    @property
    def torques(self) -> tuple[tuple[float, ...], ...]:
        """Return the torque of each nozzle (N m)."""
        forces = self.directions * self.thrust[:, None]
        return tuple(map(tuple, np.cross(self.positions, forces).tolist()))

    @property
    def partners(self) -> list[float]:
        """Return the partner of each row of the tables, from 1 on; 0: none."""
        count = len(self.thrust)
        return [float(i + 2 - 2 * (i % 2)) for i in range(count)]

    @property
    def weakest(self) -> float:
        """Return the torque (N m) that they give about every axis, either way."""
        longest = max(
            max(least_on_times(self.torques, side, 1e9))  # type: ignore[arg-type]
            for _, side in SIDES
        )
        return 1.0 / longest

    def table(self, name: str) -> list[list[float]]:
        """Return a table of the block: positions or directions, zero for no nozzle."""
        rows = getattr(self, name)
        table = np.zeros((max(len(rows), NOZZLES), 3))
        table[: len(rows)] = rows
        return [[float(f"{x:.9g}") for x in row] for row in table.tolist()]

    @property
    def thrusts(self) -> list[float]:
        """Return the thrust of each row of the tables (N)."""
        count = max(len(self.thrust), NOZZLES)
        return [*self.thrust.tolist(), *[0.0] * (count - len(self.thrust))]


def layout_of(count: int, thrust: float, half: Sequence[float], arm: float) -> Nozzles:
    """Return a usual layout of nozzles of a thrust (N) on a body of half sides (m).

    Six give a torque each way about each axis, with a force along z or y; eight stand
    at the corners of the face -z, four along z and four along x; twelve are couples.
    `arm` (m) takes the place of the half sides across z; 0: it does not.

    Raises
    ------
    DesatError
        If there is no such layout.
    """
    a, b, c = (arm or half[0], arm or half[1], half[2])
    up, port = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)
    down, starboard = (0.0, 0.0, -1.0), (0.0, -1.0, 0.0)
    ahead, back = (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)
    rows = {
        6: [
            ((0.0, b, -c), up),
            ((0.0, -b, -c), up),
            ((-a, 0.0, -c), up),
            ((a, 0.0, -c), up),
            ((a, -b, 0.0), port),
            ((a, b, 0.0), starboard),
        ],
        8: [
            *(((x, y, -c), up) for x in (a, -a) for y in (b, -b)),
            ((a, b, -c), back),
            ((-a, -b, -c), ahead),
            ((-a, b, -c), ahead),
            ((a, -b, -c), back),
        ],
        12: [
            ((0.0, b, -c), up),
            ((0.0, -b, c), down),
            ((0.0, -b, -c), up),
            ((0.0, b, c), down),
            ((-a, 0.0, -c), up),
            ((a, 0.0, c), down),
            ((a, 0.0, -c), up),
            ((-a, 0.0, c), down),
            ((a, -b, 0.0), port),
            ((-a, b, 0.0), starboard),
            ((a, b, 0.0), starboard),
            ((-a, -b, 0.0), port),
        ],
    }
    if count not in rows:
        raise DesatError(
            f"--thrusters {count}: 4 are pairs both ways about each axis; layouts of 6, 8 and 12 "
            "nozzles are known, others by a csv: --thrusters layout.csv"
        )
    places, directions = zip(*rows[count], strict=True)
    words = {6: "one each way about each axis", 8: "at -z", 12: "couples"}[count]
    force = np.full(count, thrust)
    return Nozzles(
        np.array(places), np.array(directions), force, words, None, count == 12
    )


def read_layout(name: str, sides: Sequence[float]) -> Nozzles:
    """Read nozzles of a csv: position (m), direction of the force, thrust (N), I_sp (s).

    Raises
    ------
    DesatError
        If a row is wrong, a nozzle fires into the body, or they give no torque about
        an axis.
    """
    place = f"--thrusters {name}"
    file = Path(name)
    heading = io.text(file, place).partition("\n")[0].casefold()
    has_isp = any(x in heading for x in ("isp", "i_sp", "specific_impulse"))
    units = {**UNITS, **({"isp": "s"} if has_isp else {})}
    rows = np.array(read_columns(file, place, units, NAMES, ("name", "nozzle")))
    if len(rows) > MOST_NOZZLES:
        raise DesatError(
            f"{place}: {len(rows)} nozzles; {MOST_NOZZLES} are taken at most"
        )
    sizes = np.linalg.norm(rows[:, 3:6], axis=1)
    for i, size in enumerate(sizes, 1):
        if size == 0.0 or rows[i - 1, 6] <= 0.0:
            raise DesatError(f"{place}: row {i} has no direction, or no thrust")
    isp = float(rows[0, 7]) if has_isp else None
    if has_isp and np.ptp(rows[:, 7]) > 0.0:
        raise DesatError(f"{place}: one specific impulse of all nozzles is needed")
    directions = rows[:, 3:6] / sizes[:, None]
    nozzles = Nozzles(rows[:, :3], directions, rows[:, 6], f"by {name}", isp)
    _check_exhausts(nozzles, sides, place)
    check_torques(nozzles, place)
    return nozzles


def _check_exhausts(nozzles: Nozzles, sides: Sequence[float], place: str) -> None:
    """Raise DesatError where a nozzle fires into the body."""
    into = nozzles.positions - INSIDE * max(sides) * nozzles.directions
    inside = (np.abs(into) < 0.5 * np.array(sides) * (1.0 - 1e-9)).all(axis=1)
    if inside.any():
        row = int(np.argmax(inside)) + 1
        raise DesatError(
            f"{place}: row {row} fires into the body of "
            f"{' x '.join(f'{x:g}' for x in sides)} m: a direction is that of its force on the "
            "body, against the exhaust"
        )


def check_torques(nozzles: Nozzles, place: str) -> None:
    """Raise DesatError where nozzles give no torque about an axis alone."""
    missing = [n for n, side in SIDES if not gives(nozzles.torques, side)]  # type: ignore[arg-type]
    if missing:
        raise DesatError(
            f"{place}: no torque about {', '.join(missing)} alone: '6 1N' gives one each way "
            "about each axis, '12 1N' couples without a force"
        )


def count_of(text: str) -> tuple[int, str] | None:
    """Split `8 10N` into number and size; None for another form."""
    match = re.fullmatch(r"\s*(\d+)\s+(\S.*?)\s*", text)
    return None if match is None else (int(match[1]), match[2])
