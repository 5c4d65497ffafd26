"""Build tables of results, which are shown on a terminal or on a page.

`print_table` (`cli/console.py`) prints a table and the macro of `templates/table.html`
renders it, both from `Table.headings` and `Table.cells`. Within a table a quantity has
one unit. The output of `--json` is made from the results themselves, whose units stay
as they are.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Literal

from ..numbers.text import number, spell_unit

ROW_UNIT = "row"  # unit of a column whose values have the unit in their row
SCALES: Mapping[str, Mapping[str, float]] = {
    "N.m": {"N.m": 1.0, "mN.m": 1e-3, "uN.m": 1e-6},
    "N.m.s": {"N.m.s": 1.0, "mN.m.s": 1e-3, "uN.m.s": 1e-6},
    "kg": {"kg": 1.0, "g": 1e-3},
}  #: units of a quantity, the largest first, with their factor to SI
SI_UNITS = {unit: si for si, units in SCALES.items() for unit in units}


Mark = Literal["", "ok", "bad"]


@dataclass(frozen=True)
class Column:
    """Column of a table.

    Parameters
    ----------
    title
        Heading of the column.
    unit
        Unit of its numbers; ROW_UNIT: that of their row; empty or 1: none.
    form
        Format specification of its numbers; empty: four significant digits, with
        separated thousands.
    kind
        `unit`: its cells are the units of the rows. Numbers are aligned to the right.
    is_detail
        Whether narrow pages leave it out.
    """

    title: str
    unit: str = ""
    form: str = ""
    kind: Literal["text", "number", "unit"] = "number"
    is_detail: bool = False


@dataclass(frozen=True)
class Cell:
    """Value of a table with a note, a mark or several numbers.

    Parameters
    ----------
    value
        Number in the column's unit, or a text.
    numbers
        Numbers in the column's unit that replace `{}` in the text.
    note
        Note in brackets after the value.
    mark
        Whether the value is good or bad: its colour on a page.
    """

    value: str | float | None
    numbers: Sequence[float] = ()
    note: str = ""
    mark: Mark = ""


Row = Sequence[str | float | Cell | None]


def share(value: float, limit: float) -> Cell:
    """Return a value and its limit: `37.3 of 1000`."""
    return Cell("{} of {}", (value, limit))


def or_not_reached(value: float | None) -> str | float:
    """Return a number of a run, or the text that it is not reached."""
    return number(None) if value is None else value


@dataclass(frozen=True)
class Table:
    """Rows with titles and units.

    Parameters
    ----------
    title
        Title of the table.
    columns, rows
        A row has a cell for each column; None is shown as empty. If the unit of a row
        is a `Cell`, it is a remark and no unit.
    has_header
        Whether the titles of the columns are shown.
    is_scaled
        Whether units are chosen by the largest value. Otherwise units stay as they are,
        unless there are several of one quantity.
    scales
        Units and factors of the table of which this one is a part.
    """

    title: str
    columns: Sequence[Column]
    rows: Sequence[Row]
    has_header: bool = True
    is_scaled: bool = False
    scales: Mapping[str, tuple[str, float]] | None = field(default=None, repr=False)

    def headings(self) -> list[str]:
        """Return the titles of the columns with the units in which they are shown."""
        scales = self._scales()
        return [_heading(column, scales) for column in self.columns]

    def cells(self) -> list[list[Cell]]:
        """Return the rows as readable texts."""
        scales = self._scales()
        return [
            [
                _shown(column, value, self._unit(column, row), scales)
                for column, value in zip(self.columns, row, strict=True)
            ]
            for row in self.rows
        ]

    def texts(self) -> list[list[str]]:
        """Return headings, where there are some, and rows as texts."""
        rows = [[str(cell.value or "") for cell in row] for row in self.cells()]
        return [self.headings(), *rows] if self.has_header else rows

    def part(self, columns: Sequence[int], rows: Sequence[int]) -> Table:
        """Return some columns and rows, in the units of the whole table."""
        return replace(
            self,
            columns=[self.columns[i] for i in columns],
            rows=[[self.rows[k][i] for i in columns] for k in rows],
            scales=self._scales(),
        )

    def scale(self, unit: str) -> tuple[str, float]:
        """Return the unit in which the table shows another one, and the factor to it."""
        return self._scales().get(unit, (unit, 1.0))

    def _unit(self, column: Column, row: Row) -> str:
        """Return the unit of a column's number in a row."""
        if column.unit != ROW_UNIT:
            return column.unit
        units = [
            cell for c, cell in zip(self.columns, row, strict=True) if c.kind == "unit"
        ]
        return units[0] if units and isinstance(units[0], str) else ""

    def _scales(self) -> Mapping[str, tuple[str, float]]:
        """Choose the unit in which each unit is shown, and the factor to it."""
        if self.scales is not None:
            return self.scales
        sizes: dict[str, float] = {}
        units: dict[str, set[str]] = {}
        for unit, value in self._numbers():
            si = SI_UNITS[unit]
            sizes[si] = max(sizes.get(si, 0.0), abs(value) * SCALES[si][unit])
            units.setdefault(si, set()).add(unit)
        scales = {}
        for si, size in sizes.items():
            if self.is_scaled or len(units[si]) > 1:
                scaled_unit = _suitable_unit(si, size)
                for unit, factor in SCALES[si].items():
                    scales[unit] = scaled_unit, factor / SCALES[si][scaled_unit]
        return scales

    def _numbers(self) -> Iterator[tuple[str, float]]:
        """Yield units that can be scaled, and finite numbers in them."""
        for row in self.rows:
            for column, element in zip(self.columns, row, strict=True):
                unit, cell = self._unit(column, row), _cell(element)
                if unit not in SI_UNITS:
                    continue
                for value in (cell.value, *cell.numbers):
                    if isinstance(value, (int, float)) and isfinite(value):
                        yield unit, float(value)


def _cell(value: str | float | Cell | None) -> Cell:
    """Convert a value to a cell."""
    return value if isinstance(value, Cell) else Cell(value)


def _suitable_unit(si: str, size: float) -> str:
    """Select the largest unit in which a size (SI) is 1 or more, else the smallest."""
    if size == 0.0:
        return si
    units = SCALES[si]
    return next(
        (unit for unit, factor in units.items() if size >= factor), [*units][-1]
    )


def _heading(column: Column, scales: Mapping[str, tuple[str, float]]) -> str:
    """Return the title of a column with its unit."""
    unit = scales[column.unit][0] if column.unit in scales else column.unit
    spelled = "" if unit == ROW_UNIT else spell_unit(unit)
    return f"{column.title}, {spelled}" if spelled else column.title


def _shown(
    column: Column,
    value: str | float | Cell | None,
    unit: str,
    scales: Mapping[str, tuple[str, float]],
) -> Cell:
    """Return a cell whose value is a readable text."""
    if column.kind == "unit" and isinstance(value, str):
        return Cell(spell_unit(scales[value][0] if value in scales else value))
    cell = _cell(value)
    factor = scales[unit][1] if unit in scales else None
    if cell.numbers:
        text = str(cell.value).format(
            *(_format(x, column.form, factor) for x in cell.numbers)
        )
    else:
        text = _format(cell.value, column.form, factor)
    if cell.note:
        text += f" ({cell.note})"
    return Cell(text, mark=cell.mark)


def _format(value: str | float | None, form: str, factor: float | None) -> str:
    """Format a value after scaling."""
    if value is None:
        return ""
    if isinstance(value, str):
        return value
    scaled = value if factor is None else factor * value
    return format(scaled, form) if form else number(scaled)
