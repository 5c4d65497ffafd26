"""Make the momentum budget of a craft for a design review: one sheet of A4.

It has the verdict, what each case takes beside what is allowed, what drives it, how far
that spreads over what is assumed, and what was given and what assumed, all from a
sizing (`desat size`) and the craft file.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

from ..files.io import replace_text
from ..report.cases import tabulate_margins
from ..report.report import render, versions
from ..report.table import Column, Table
from ..system.errors import DesatError
from . import tables
from .dumps import DumpSizing
from .margins import tabulate_spread
from .result import Sizing

CRAFT = "craft.toml"
SPREADS = "dispersions"  # section of what is not known for sure
LONGEST_VALUE = 38  # characters of a value of the craft file that are shown
_LINE = re.compile(r'"?([\w.]+)"? = (.+?)\s+# (.*)')
_TEX = {"%": r"\%", "&": r"\&", "_": r"\_", "#": r"\#", "^": r"\^{}", "~": r"\~{}"}


@dataclass(frozen=True)
class Budget:
    """The sheet: its sentences and tables."""

    title: str
    answer: str
    holds: bool
    tables: tuple[Table, ...]
    source: str  # date, versions, digest and command


def budget_of(
    sizing: Sizing | DumpSizing, digest: str, folder: Path, factor: float = 1.0
) -> Budget:
    """Return the budget of a sizing.

    Parameters
    ----------
    sizing
        What the craft needs beside what it has.
    digest
        That of its system.
    folder
        The craft's, whose craft file says what was given; without it that is left out.
    factor
        By which every need is multiplied before it is held against what is allowed.
    """
    margins = [m._replace(used=factor * m.used) for m in sizing.margins]
    holds = not sizing.problems and all(m.margin >= 0.0 for m in margins)
    sheet = replace(sizing, margins=tuple(sorted(margins, key=lambda m: m.margin)))
    sheet_tables = [tabulate_margins(sheet.margins)]
    if isinstance(sheet, Sizing):
        sheet_tables += [
            tables.tabulate_sources(sheet.sources, sheet.unexplained),
            *([tables.tabulate_conditions(sheet)] if sheet.best else []),
        ]
    else:
        sheet_tables += [
            tables.tabulate_dump_sources(sheet.sources),
            tables.tabulate_dumps(sheet),
        ]
    sheet_tables += tabulate_spread(sheet.intervals, sheet.assumptions)
    sheet_tables += [_tabulate_origins(folder / CRAFT)]
    command = f"desat budget {sizing.target}"
    if factor != 1.0:
        command += f" --margin-factor {factor:g}"
    return Budget(
        f"Momentum budget: {sizing.target}",
        sizing.answer
        if factor == 1.0
        else f"{sizing.answer} Needs times {factor:g}: it "
        f"{'holds' if holds else 'does not hold'}.",
        holds,
        tuple(t for t in sheet_tables if t.rows),
        f"{versions()}; digest {digest[:12]}; {command}",
    )


def _tabulate_origins(file: Path) -> Table:
    """Tabulate the values of a craft file that say where they are from."""
    columns = [Column(x, kind="text") for x in ("given or assumed", "value", "from")]
    return Table("What it is made of", columns, list(_origins(file)))


def _origins(file: Path) -> Iterator[tuple[str, str, str]]:
    """Yield name, value and origin of each such value."""
    text = file.read_text(encoding="utf-8") if file.is_file() else ""
    section = ""
    for line in text.splitlines():
        if line.startswith("["):
            section = line.strip("[]").removeprefix("parameters.")
        match = _LINE.match(line)
        if match and (section == SPREADS or re.search("given|class|assumed", match[3])):
            value = match[2].strip('"')
            if len(value) > LONGEST_VALUE:
                value = f"{value[:LONGEST_VALUE]}..."
            yield f"{section} {match[1]}".strip(), value, match[3]


def as_html(budget: Budget) -> str:
    """Return the sheet as a page that prints on A4."""
    return render("budget.html", title=budget.title, budget=budget)


def as_markdown(budget: Budget) -> str:
    """Return the sheet as Markdown."""
    lines = [f"# {budget.title}", "", f"**{budget.answer}**"]
    for table in budget.tables:
        head, *rows = _with_header(table)
        lines += ["", f"## {table.title}", "", _row(head), "|---" * len(head) + "|"]
        lines += map(_row, rows)
    return "\n".join([*lines, "", budget.source, ""])


def as_tex(budget: Budget) -> str:
    """Return the sheet as LaTeX to be included, with booktabs."""
    lines = [rf"\section*{{{_tex(budget.title)}}}", _tex(budget.answer)]
    for table in budget.tables:
        head, *rows = _with_header(table)
        form = "".join("l" if c.kind == "text" else "r" for c in table.columns)
        lines += [rf"\subsection*{{{_tex(table.title)}}}"]
        lines += [rf"\begin{{tabular}}{{{form}}}", r"\toprule"]
        lines += [" & ".join(map(_tex, head)) + r" \\", r"\midrule"]
        lines += [" & ".join(map(_tex, row)) + r" \\" for row in rows]
        lines += [r"\bottomrule", r"\end{tabular}"]
    return "\n".join([*lines, "", _tex(budget.source), ""])


def as_csv(budget: Budget) -> str:
    """Return the tables of the sheet as csv, one below the other."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([budget.title, budget.answer])
    for table in budget.tables:
        writer.writerows([[], [table.title], *table.texts()])
    writer.writerows([[], [budget.source]])
    return out.getvalue()


def as_pdf(budget: Budget) -> bytes:
    """Return the sheet as PDF, A4.

    Raises
    ------
    DesatError
        If the library for it is not installed.
    """
    try:
        fpdf: Any = import_module("fpdf")
    except ImportError as error:
        raise DesatError(
            "--format pdf: it needs fpdf2: pip install 'desat[pdf]'; html prints on A4"
        ) from error
    pdf = fpdf.FPDF(format="A4")
    pdf.set_margins(12.0, 10.0)
    pdf.set_auto_page_break(True, 8.0)
    pdf.add_page()
    pdf.set_title(_latin(budget.title))

    def write(text: str, size: float, style: str = "") -> None:
        """Write a paragraph."""
        pdf.set_font("helvetica", style, size)
        pdf.multi_cell(0, 0.45 * size, _latin(text), new_x="LMARGIN", new_y="NEXT")

    write(budget.title, 14, "B")
    pdf.set_text_color(*((27, 107, 58) if budget.holds else (178, 34, 34)))
    write(budget.answer, 8, "B")
    pdf.set_text_color(0, 0, 0)
    for table in budget.tables:
        pdf.ln(1.5)
        write(table.title, 8.5, "B")
        pdf.set_font("helvetica", "", 6.5)
        rows = table.texts()
        widths = [max(4, max(len(row[k]) for row in rows)) for k in range(len(rows[0]))]
        alignment = tuple(
            "LEFT" if c.kind == "text" else "RIGHT" for c in table.columns
        )
        with pdf.table(
            [[_latin(x) for x in row] for row in rows],
            col_widths=tuple(min(60, w) for w in widths),
            text_align=alignment,
            line_height=3.0,
            borders_layout="HORIZONTAL_LINES",
            first_row_as_headings=table.has_header,
        ):
            pass
    pdf.ln(1.5)
    write(budget.source, 6.5)
    return bytes(pdf.output())


FORMATS: dict[str, Callable[[Budget], str | bytes]] = {
    "html": as_html,
    "pdf": as_pdf,
    "md": as_markdown,
    "tex": as_tex,
    "csv": as_csv,
}


def write(budget: Budget, form: str, path: Path) -> Path:
    """Write the sheet in one of FORMATS.

    Raises
    ------
    DesatError
        If the library of the format is not installed.
    """
    content = FORMATS[form](budget)
    path.parent.mkdir(parents=True, exist_ok=True)
    replace_text(path, content)
    return path


def _with_header(table: Table) -> list[list[str]]:
    """Return headings and rows, with empty headings where the table shows none."""
    rows = table.texts()
    return rows if table.has_header else [[""] * len(table.columns), *rows]


def _row(cells: Sequence[str]) -> str:
    """Return a row of a Markdown table."""
    return "| " + " | ".join(x.replace("|", "\\|") for x in cells) + " |"


def _tex(text: str) -> str:
    """Escape a text for LaTeX."""
    return "".join(_TEX.get(x, x) for x in text)


def _latin(text: str) -> str:
    """Return a text with the letters of the PDF's own fonts."""
    return text.encode("latin-1", "replace").decode("latin-1")
