"""Read logs of a craft: csv files with a column for each element of a quantity.

    time [s],wheels.speed_wheel[1] [rpm],speed_2 [rpm],q_bi[1],...,m_coil[1] [A.m2]

A heading is a name, the number of the element in brackets or after `_`, and the unit in
brackets. The first column is the time, in seconds since the craft's t = 0 or as UTC
(ISO 8601). An empty cell is a value that was not sent. The csv of `desat run --csv` is
such a file; columns of other names are left out.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..files import paths
from ..files.columns import unit_factor
from ..system.errors import DesatError, plain
from ..system.model import J2000
from ..system.quantity import is_float

Array = NDArray[np.float64]
ENDING = ".csv"
_HEADING = re.compile(
    r"\s*'?(?:([A-Za-z]\w*)\.)?([A-Za-z]\w*?)(?:\[(\d+)\]|_(\d+))?"
    r"\s*((?:[\[\(][^\[\]\(\)]*[\]\)]\s*)*)"
)
_UNIT = re.compile(r"[\[\(]\s*([^\[\]\(\)]*?)\s*[\]\)]")
LARGEST = 1e12  # a larger value is none that a craft sends
TIMES = ("t", "time", "utc", "date", "timestamp", "epoch")


class Channel(NamedTuple):
    """Quantity of a log: its unit, and the names of its columns, the first preferred."""

    unit: str
    names: tuple[str, ...]


CHANNELS = {
    "momentum": Channel("N.m.s", ("h_meas_wheel", "h_wheel", "wheel_momentum", "h")),
    "speed": Channel("rad/s", ("speed_wheel", "wheel_speed", "speed")),
    "attitude": Channel("1", ("q_meas_bi", "q_bi", "q")),
    "rate": Channel("rad/s", ("omega_meas_body", "omega_bi_body", "rate", "omega")),
    "coils": Channel("A.m2", ("m_coil",)),
    "dipole": Channel("A.m2", ("m_mean_body", "m_body", "m")),
    "thrust": Channel("N.m", ("tau_mean_thruster_body", "tau_thruster_body")),
}


class _Heading(NamedTuple):
    """Heading of a column: what it names, and its place in a row."""

    owner: str
    name: str
    element: int  # from 1; 0: it names none
    units: tuple[str, ...]
    text: str
    column: int


@dataclass(frozen=True)
class Log:
    """Telemetry of a craft."""

    place: str  # its name in messages
    times: Array  # (n,) s since the craft's t = 0
    # quantity of CHANNELS -> (n, elements) in SI; nan where none was sent
    values: Mapping[str, Array]
    is_of_dates: bool = False  # there is no column but the time


def read_log(file: Path, origin: datetime | None, is_scalar_first: bool = False) -> Log:
    """Read a log.

    Parameters
    ----------
    file
        The csv file.
    origin
        UTC of the craft's t = 0; None: it has none, and times are in seconds unless
        there are dates alone.
    is_scalar_first
        Whether the scalar is the first element of the quaternions in the file. Those
        that are returned have it last.

    Raises
    ------
    DesatError
        If the file cannot be read, or a column is wrong; the text names both.
    """
    place = paths.shown(file)
    headings, skip, comma = _read_headings(file, place)
    columns = _choose_columns(headings, place)
    names = [str(k) for k in range(len(headings))]
    used = [headings[0], *(h for rows in columns.values() for h in rows)]
    table = _read_cells(file, place, names, used, skip, comma)
    is_of_dates = len(headings) == 1
    if origin is None and is_of_dates:  # what is between them counts
        origin = J2000
    times = _times_of(table[0], headings[0], place, origin)
    values = {}
    for quantity, rows in columns.items():
        unit = CHANNELS[quantity].unit
        factors = [_factor_of(h, unit, place) for h in rows]
        values[quantity] = np.stack(
            [
                f * _numbers(table[h.column], h, place)
                for f, h in zip(factors, rows, strict=True)
            ],
            axis=1,
        )
    if "attitude" in values:
        values["attitude"] = _unit_quaternions(
            values["attitude"], is_scalar_first, place
        )
    return Log(place, times, values, is_of_dates)


def origin_of(parameters: Mapping[str, Mapping[str, Any]]) -> datetime | None:
    """Return UTC of the t = 0 of a craft with these parameters; None without an epoch."""
    epoch = parameters.get("environment", {}).get("epoch_j2000")
    return None if epoch is None else J2000 + timedelta(seconds=float(epoch.value))


def _read_headings(file: Path, place: str) -> tuple[list[_Heading], int, str]:
    """Read the headings; return them, the lines up to them, and the separator."""
    try:
        with file.open(encoding="utf-8-sig", newline="") as lines:
            skip, line = next(
                (k, x) for k, x in enumerate(lines) if x.strip() and x[0] != "#"
            )
    except StopIteration:
        raise DesatError(f"{place}: empty; a heading and rows are needed") from None
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not UTF-8"
        raise DesatError(f"{place}: {reason}") from error
    comma = ";" if line.count(";") > line.count(",") else ","
    headings = []
    for k, text in enumerate(next(csv.reader([line], delimiter=comma))):
        match = _HEADING.fullmatch(text)
        owner, name, element, other, units = match.groups() if match else ("",) * 5
        found_units = tuple(filter(None, _UNIT.findall(units or "")))
        number = int(element or other or 0)
        headings.append(
            _Heading(owner or "", name or "", number, found_units, plain(text), k)
        )
    first = headings[0]
    if first.name.casefold() not in TIMES:
        hint = "is a number, and no heading" if is_float(first.text) else "is no time"
        raise DesatError(
            f"{place}: no time column: the first, {first.text!r}, {hint}; "
            "time [s] or utc is needed"
        )
    return headings, skip, comma


def _choose_columns(
    headings: Sequence[_Heading], place: str
) -> dict[str, list[_Heading]]:
    """Choose the columns of each quantity, in the order of its elements."""
    columns: dict[str, list[_Heading]] = {}
    for quantity, channel in CHANNELS.items():
        of_names = [[h for h in headings[1:] if h.name == n] for n in channel.names]
        rows = next((r for r in of_names if r), [])
        rows = sorted(
            (h for h in rows if h.owner == rows[0].owner), key=lambda h: h.element
        )
        if not rows:
            continue
        for k, heading in enumerate(rows, 1):
            if heading.element != k:
                lack = "it is there twice" if heading.element < k else f"no element {k}"
                raise DesatError(f"{place}: column {heading.text}: {lack}")
        columns[quantity] = rows
    return columns


def _factor_of(heading: _Heading, unit: str, place: str) -> float:
    """Return the factor from a column to SI; raise DesatError for a wrong unit."""
    at = f"{place}: column {heading.text}"
    if len(heading.units) > 1:
        raise DesatError(
            f"{at}: two units, {' and '.join(heading.units)}; one is needed"
        )
    if not heading.units and unit != "1":
        raise DesatError(f"{at}: no unit; one that fits {unit} is needed, in brackets")
    return unit_factor("".join(heading.units), unit, at)


def _read_cells(
    file: Path,
    place: str,
    names: list[str],
    columns: Sequence[_Heading],
    skip: int,
    comma: str,
) -> dict[int, Any]:
    """Read columns of the file as texts: column -> (rows,); None for an empty cell."""
    import pyarrow as pa
    from pyarrow import csv as reader

    used = [str(h.column) for h in columns]
    try:
        table = reader.read_csv(
            file,
            reader.ReadOptions(column_names=names, skip_rows=skip + 1),
            reader.ParseOptions(delimiter=comma),
            reader.ConvertOptions(
                include_columns=used,
                column_types=dict.fromkeys(used, pa.string()),
                strings_can_be_null=True,
            ),
        )
    except pa.ArrowInvalid as error:
        raise DesatError(f"{place}: {plain(str(error).splitlines()[0])}") from error
    if not table.num_rows:
        raise DesatError(f"{place}: there is no row below the heading")
    return {int(n): table.column(n) for n in used}


def _numbers(cells: Any, heading: _Heading, place: str) -> Array:
    """Return a column as numbers (rows,), nan where a cell is empty.

    Raises DesatError for a text.
    """
    import pyarrow as pa
    from pyarrow import compute

    try:
        numbers = compute.cast(compute.utf8_trim_whitespace(cells), pa.float64())
    except pa.ArrowInvalid:
        texts = (x for x in cells.to_pylist() if x is not None and not is_float(x))
        wrong = plain(next(texts, "?"))
        raise DesatError(
            f"{place}: column {heading.text}: {wrong!r} is no number"
        ) from None
    values = np.asarray(numbers.to_numpy(), float)
    return np.where(np.abs(values) < LARGEST, values, np.nan)


def _times_of(
    cells: Any, heading: _Heading, place: str, origin: datetime | None
) -> Array:
    """Return the times (rows,) s since the craft's t = 0, which increase.

    Raises DesatError where they are no times or go back.
    """
    at = f"{place}: column {heading.text}"
    first = cells[0].as_py()
    if first is not None and not is_float(first):
        from pandas import to_datetime  # type: ignore[import-untyped]

        if origin is None:
            raise DesatError(
                f"{at}: the craft has no epoch: times in seconds are needed"
            )
        try:
            stamps = to_datetime(cells.to_pylist(), utc=True, format="ISO8601")
        except (ValueError, TypeError) as error:
            raise DesatError(
                f"{at}: a time is neither in seconds nor UTC, as 2027-01-01T00:00:00Z"
            ) from error
        times = np.asarray((stamps - origin).total_seconds(), float)
    else:
        factor = _factor_of(heading, "s", place) if heading.units else 1.0
        times = factor * _numbers(cells, heading, place)
    if np.isnan(times).any():
        row = int(np.isnan(times).argmax()) + 1
        raise DesatError(f"{at}: row {row} has no time")
    if (back := np.diff(times) <= 0.0).any():
        row = int(back.argmax())
        raise DesatError(
            f"{at}: the clock jumps back: row {row + 2} is at {times[row + 1]:.9g} s, "
            f"the row before at {times[row]:.9g} s"
        )
    return times


def _unit_quaternions(q: Array, is_scalar_first: bool, place: str) -> Array:
    """Return unit quaternions (n, 4), scalar last, of one sign from row to row."""
    if q.shape[1] != len("xyzw"):
        raise DesatError(
            f"{place}: the attitude has {q.shape[1]} columns; 4 are needed"
        )
    q = np.roll(q, -1, axis=1) if is_scalar_first else q
    size = np.linalg.norm(q, axis=1, keepdims=True)
    if (np.abs(size - 1.0) > 0.1).any():
        row = int((np.abs(size[:, 0] - 1.0) > 0.1).argmax()) + 1
        raise DesatError(
            f"{place}: unknown attitude: the quaternion of row {row} has the size "
            f"{size[row - 1, 0]:.3g}; 1 is needed"
        )
    return align_signs(q / size)


def align_signs(q: Array) -> Array:
    """Return quaternions (n, 4) of one sign from row to row; nan rows stay."""
    q = q.copy()
    rows = np.flatnonzero(~np.isnan(q).any(axis=1))
    turns = np.where((q[rows[1:]] * q[rows[:-1]]).sum(axis=1) < 0.0, -1.0, 1.0)
    q[rows[1:]] *= np.cumprod(turns)[:, None]
    return q
