"""Say what a craft uses in each case beside what it is allowed, and the margin left."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from importlib import import_module
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np

from ..figures.canvas import Figure, in_notebook
from ..numbers.text import format_duration, format_momenta, spell_unit
from ..report.cases import Margin
from ..report.table import ROW_UNIT, Column, Row, Table
from ..system.typed import JsonObject
from .intervals import AssumptionShare, Interval

if TYPE_CHECKING:
    from pandas import DataFrame  # type: ignore[import-untyped]

PLURAL = frozenset(("wheels", "coils", "rods"))


def finite(value: Any) -> Any:
    """Convert a value for JSON: numbers that are not finite become null."""
    if isinstance(value, dict):
        return {k: finite(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(v) for v in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def margins_as_json(margins: Sequence[Margin]) -> list[JsonObject]:
    """Return margins as `--json` prints them."""
    return [finite(m._asdict() | {"margin": m.margin}) for m in margins]


def quantities_of(sizing: Any, tabulate: str) -> DataFrame:
    """Return a table of a sizing's quantities by title, with the unit of each.

    `tabulate` is the function of tables.py that makes it; infinite ones stay.
    """
    from importlib import import_module

    from pandas import DataFrame

    # by name: the tables are of sizings, and so lie above them
    table = getattr(import_module(".tables", __package__), tabulate)(sizing)
    names = [column.title or "unit" for column in table.columns[1:]]
    names[0] = names[0] if names[0] != "unit" else "value"
    rows = {row[0]: row[1:] for row in table.rows}
    return DataFrame.from_dict(rows, orient="index", columns=names)


def describe_margins(target: str, margins: Sequence[Margin]) -> str:
    """Say in which case the least of each kind is left, the worst first.

    Cases in which something is short are of what is assumed, as all others are problems:
    they are told of apart.
    """
    least, short = dict[str, Margin](), dict[str, Margin]()
    for m in sorted(margins, key=lambda m: m.margin):
        (least if m.margin >= 0.0 else short).setdefault(m.of, m)
    by_case: dict[str, list[Margin]] = {}
    for m in least.values():
        by_case.setdefault(m.case, []).append(m)
    texts = []
    for case, rows in by_case.items():
        each = " and ".join(f"{100.0 * m.margin:.0f} % of the {m.of}" for m in rows)
        texts.append(f"{each} ({case})")
    holds = f"{target} holds"
    if short:
        holds += " as it is described"
    text = f"{holds} with margins of {', '.join(texts)}" if texts else target
    return text + "".join(f"; {_describe_short(m)}" for m in short.values())


def _describe_short(margin: Margin) -> str:
    """Say what a case takes that is short of it."""
    if margin.unit == "N.m.s":
        amount = format_momenta(margin.used, margin.limit)
    else:
        unit = spell_unit(margin.unit)
        amount = f"{margin.used:.3g} of {margin.limit:.3g} {unit}"
    verb = "come" if margin.of in PLURAL else "comes"
    return f"the {margin.of} {verb} to {amount} ({margin.case})"


def tabulate_spread(
    intervals: Sequence[Interval], assumptions: Sequence[AssumptionShare]
) -> tuple[Table, ...]:
    """Tabulate intervals over what is not known for sure, and what carries them.

    There is no table where all is known.
    """
    if not intervals:
        return ()
    columns = [
        Column("", kind="text"),
        Column("as described", ROW_UNIT, ".4g"),
        Column("5 %", ROW_UNIT, ".4g"),
        Column("95 %", ROW_UNIT, ".4g"),
        Column("unit", kind="unit"),
    ]
    rows: list[Row] = []
    for title, unit, *values in intervals:
        if unit == "s":
            texts = [format_duration(x) if x < inf else "never" for x in values]
            rows.append((title, *texts, ""))
        else:
            rows.append((title, *values, unit))
    carrying = [
        Column("assumption", kind="text"),
        Column("share, %", form=".1f"),
        Column("given by", kind="text"),
    ]
    shares = [(x.title, 100.0 * x.share, x.option) for x in assumptions]
    return (
        Table("How far it spreads over what is assumed", columns, rows, is_scaled=True),
        Table("What carries the width", carrying, shares),
    )


def first_figure(sizing: Any) -> Figure | None:
    """Draw the first figure of a sizing's page; None where it has none."""
    # by name: the page is made of sizings, and so lies above them
    figures = import_module(".page", __package__).drawn_of(sizing)
    return figures[0][1] if figures else None


def as_html(answer: str, tables: Sequence[Table], figure: Figure | None) -> str:
    """Return what a notebook shows: the answer, a figure and tables."""
    parts = [f"<p>{escape(answer)}</p>", in_notebook(figure)]
    for table in tables:
        cells = ("".join(f"<td>{escape(x)}</td>" for x in row) for row in table.texts())
        parts.append(f"<table>{''.join(f'<tr>{x}</tr>' for x in cells)}</table>")
    return "".join(parts)
