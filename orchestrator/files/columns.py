"""Read tables of numbers from csv files, whose heading may name columns and units."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from desat.components.contract.units import conversion

from ..system.errors import DesatError
from ..system.parameters import known_unit, unit_of, with_dots
from ..system.quantity import is_float
from . import io

Row = tuple[float, ...]
# a heading: a name, and a unit in brackets, as `t [ms]` or `x (mN m)`
_HEADING = re.compile(r"\s*\"?\s*([^\[\(]*?)\s*(?:[\[\(]\s*(.*?)\s*[\]\)])?\s*\"?\s*")
SHOWN = 60  # characters of a wrong line in a message


def read_columns(
    file: Path,
    place: str,
    units: Mapping[str, str],
    names: Mapping[str, Sequence[str]],
    labels: Sequence[str] = (),
) -> tuple[Row, ...]:
    """Read the columns of a csv file, in the order and the units of `units`.

    Parameters
    ----------
    file, place
        The file, and its name in messages.
    units
        By the name of each column the unit of its values. A file without a heading has
        the columns in this order and in these units; a heading may name them in another
        order and in units that fit.
    names
        Other names of a column in a heading.
    labels
        Headings of columns with text, which are left out.

    Raises
    ------
    DesatError
        If the heading has other columns, a unit is unknown or does not fit, a row does
        not have one finite number a column, or there is no row.
    """
    rows: list[Row] = []
    order, factors = list(range(len(units))), [1.0] * len(units)
    is_first, left_out = True, set[int]()
    for number, line in enumerate(io.text(file, place).splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        fields = line.replace(";", ",").split(",")
        if is_first and not any(is_float(field) for field in fields):
            left_out = {
                k for k, x in enumerate(fields) if x.strip(' "').casefold() in labels
            }
            fields = [x for k, x in enumerate(fields) if k not in left_out]
            order, factors = _of_heading(fields, f"{place}:{number}", units, names)
            is_first = False
            continue
        is_first = False
        values = _numbers([x for k, x in enumerate(fields) if k not in left_out])
        if values is None or len(values) != len(units):
            columns_needed = ", ".join(f"{n} in {u}" for n, u in units.items())
            raise DesatError(
                f"{place}:{number}: {len(units)} numbers are needed, {columns_needed}; got "
                f"{line.strip()[:SHOWN]}"
            )
        rows.append(tuple(values[k] * f for k, f in zip(order, factors, strict=True)))
    if not rows:
        raise DesatError(f"{place}: there is no row of {len(units)} numbers")
    return tuple(rows)


def _of_heading(
    fields: Sequence[str],
    place: str,
    units: Mapping[str, str],
    names: Mapping[str, Sequence[str]],
) -> tuple[list[int], list[float]]:
    """Return for each column its position in a row, and the factor to its unit."""
    positions: dict[str, int] = {}
    factors: dict[str, float] = {}
    columns_needed = ", ".join(f"{n} [{u}]" for n, u in units.items())
    for k, field in enumerate(fields):
        match = _HEADING.fullmatch(field)
        title = "" if match is None else match[1].casefold()
        name = next(
            (n for n in units if title in (n, *names.get(n, ()))),
            None,
        )
        if match is None or name is None or name in positions:
            again = "twice" if name in positions else "no such column"
            raise DesatError(
                f"{place}: column {field.strip()}: {again}; the columns are {columns_needed}, in any "
                "order"
            )
        positions[name] = k
        factors[name] = unit_factor(match[2], units[name], f"{place}: {field.strip()}")
    if missing := [n for n in units if n not in positions]:
        raise DesatError(
            f"{place}: no column {', '.join(missing)}; the columns are {columns_needed}, in any order"
        )
    return [positions[n] for n in units], [factors[n] for n in units]


def unit_factor(text: str | None, unit: str, place: str) -> float:
    """Return the factor from the unit of a heading, if it has one, to another unit.

    Raises
    ------
    DesatError
        If the unit is unknown or does not fit; the message begins with `place`.
    """
    if not text:
        return 1.0
    dotted = ".".join(text.replace("*", " ").replace("·", " ").split())
    meant = with_dots(dotted) or dotted
    unit_meant = known_unit(meant)
    if unit_meant is None:
        raise DesatError(f"{place}: unit {text} is not known; one that fits {unit} is")
    converted = conversion(unit_meant, unit_of(unit))
    if converted is None or converted[1] != 0.0:
        raise DesatError(f"{place}: unit {text} does not fit {unit}")
    return converted[0]


def _numbers(fields: Sequence[str]) -> list[float] | None:
    """Return the finite numbers of a line, or None if it has anything else."""
    try:
        values = [float(x) for x in fields]
    except ValueError:
        return None
    return values if all(math.isfinite(x) for x in values) else None
