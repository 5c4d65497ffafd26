"""Keep the cases that a craft was sized in, and show them on the pages of its runs.

`desat size` keeps what it prints with `--json` beside its page, as size-NAME.json. Every
page of the same craft in that folder shows its cases, worst first.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

from ..files.io import replace_text
from ..numbers.verdicts import margin_of
from ..system.expression import Table as Parameters
from ..system.typed import JsonObject
from .table import ROW_UNIT, Cell, Column, Table


class Margin(NamedTuple):
    """What a craft uses of something in a case, beside what it is allowed."""

    case: str
    of: str  # wheels, coils, rods, propellant, ...
    used: float
    limit: float
    unit: str

    @property
    def margin(self) -> float:
        """Return the margin (1), (limit - used) / limit: below 0 it does not hold."""
        return margin_of(self.used, self.limit)


class CraftCases(NamedTuple):
    """Answer and cases of a sizing."""

    answer: str
    holds: bool
    table: Table

    @property
    def verdict(self) -> str:
        """Return the first sentence of the answer."""
        return self.answer.partition(". ")[0].removesuffix(".")


def tabulate_margins(margins: Sequence[Margin]) -> Table:
    """Tabulate what each case takes beside what is allowed, the worst case first."""
    columns = [
        Column("case", kind="text"),
        Column("of the", kind="text"),
        Column("used", ROW_UNIT, ".4g"),
        Column("allowed", ROW_UNIT, ".4g"),
        Column("unit", kind="unit"),
        Column("margin, %", form=".3g"),
    ]
    rows = [
        (
            m.case,
            m.of,
            m.used,
            m.limit,
            m.unit,
            Cell(100.0 * m.margin, mark="bad" if m.margin < 0.0 else "ok"),
        )
        for m in margins
    ]
    return Table("Cases", columns, rows, is_scaled=True)


def keep_cases(page: Path, sizing: JsonObject) -> None:
    """Keep a sizing, as `--json` prints it, beside its page."""
    page.parent.mkdir(parents=True, exist_ok=True)
    replace_text(page.with_suffix(".json"), json.dumps(sizing, indent=1))


def find_cases(folder: Path, crafts: Iterable[Parameters]) -> list[CraftCases]:
    """Return the cases of those crafts that a sizing in a folder is of, each once."""
    digests = dict.fromkeys(craft_digest(parameters) for parameters in crafts)
    by_craft = {}
    for file in sorted(folder.glob("size-*.json")):
        try:
            sizing = json.loads(file.read_text(encoding="utf-8"))
            margins = [
                Margin(m["case"], m["of"], m["used"], m["limit"], m["unit"])
                for m in sizing["margins"]
            ]
            cases = CraftCases(
                sizing["answer"], not sizing["problems"], tabulate_margins(margins)
            )
            by_craft[sizing["craft"]] = cases
        except (OSError, ValueError, KeyError, TypeError):
            continue  # a file of another name, or of another version
    return [by_craft[digest] for digest in digests if digest in by_craft]


def craft_digest(parameters: Parameters) -> str:
    """Return the digest of the values of a craft's parameters."""
    values = {
        component: {name: p.value for name, p in table.items()}
        for component, table in parameters.items()
    }
    text = json.dumps(values, sort_keys=True, default=list)
    return sha256(text.encode()).hexdigest()
