"""What the commands of `desat` share: the application, and how it prints."""

from __future__ import annotations

import io
import json
import os
import sys
from collections.abc import Container, Iterable
from pathlib import Path
from typing import Any

import typer
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table as RichTable
from rich.text import Text
from typer.core import TyperGroup

from ..report.table import Column, Table
from ..system.errors import Exit, plain

# a stream that is closed would be given to the next file that is opened, and written
# into
for _number, _name in ((1, "stdout"), (2, "stderr")):
    if getattr(sys, _name) is None:
        os.dup2(os.open(os.devnull, os.O_WRONLY), _number)
        setattr(sys, _name, open(_number, "w", encoding="utf-8", closefd=False))  # noqa: SIM115


class _Lasting(io.FileIO):
    """Where a stream ends. Whoever reads it may go away: the rest is for nobody, and
    the command ends as it would have."""

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except BrokenPipeError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), self.fileno())
            return len(data)
        except OSError as error:
            error.filename = {1: "standard output", 2: "standard error"}.get(
                self.fileno()
            )
            raise


# a path may have characters that the locale has not
for _name in ("stdout", "stderr"):
    if (
        type(_stream := getattr(sys, _name)) is io.TextIOWrapper
    ):  # not what tests put there
        _stream.flush()
        _raw = _Lasting(_stream.fileno(), "w", closefd=False)
        setattr(
            sys,
            _name,
            io.TextIOWrapper(
                io.BufferedWriter(_raw),
                _stream.encoding,
                "backslashreplace",
                line_buffering=_stream.line_buffering,
                write_through=_stream.write_through,
            ),
        )

EPILOG = "Exit codes: " + "; ".join(f"{e.value} {e.meaning}" for e in Exit) + "."

PANELS = {
    "Start": ("new", "size", "run", "list", "show", "help"),
    "Study": ("compare", "tune", "sweep", "campaign", "bound", "tables"),
    "Results": ("report", "export", "resume"),
    "Make": ("check", "build", "design", "pack"),
}
"""The commands as `desat --help` lists them."""


class Panels(TyperGroup):
    """The commands in panels, on a terminal and where help is piped."""

    def list_commands(self, ctx: Any) -> list[str]:
        for panel, names in PANELS.items():
            for name in names:
                if name in self.commands:
                    self.commands[name].rich_help_panel = panel  # type: ignore[attr-defined]
        return [n for names in PANELS.values() for n in names if n in self.commands]

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        for panel, names in PANELS.items():
            commands = [(n, self.commands[n]) for n in names if n in self.commands]
            with formatter.section(panel):
                formatter.write_dl([(n, c.get_short_help_str(90)) for n, c in commands])


def example(command: str) -> str:
    """The last lines of a command's help: a command line that can be typed as it is."""
    return f"Example: {command}"


app = typer.Typer(
    cls=Panels,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    # boxes take as long to load as all else: only where a person looks
    rich_markup_mode="rich" if sys.stdout.isatty() else None,
    context_settings={} if sys.stdout.isatty() else {"terminal_width": 120},
    help="Spacecraft momentum management as co-simulated FMUs. Start with `desat new craft my12u "
    "--size 12U`, then `desat size my12u` and `desat run my12u`; every command explains itself "
    "with --help.",
    epilog=EPILOG,
)


class WithDefault(TyperGroup):
    """A group whose first argument may be a target: then it is its command `run`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if args and args[0] not in self.commands and args[0] not in ("--help", "-h"):
            args = ["run", *args]
        return super().parse_args(ctx, args)


class _Plain(Console):
    """A console that prints no control characters of names and messages that others
    gave."""

    def render_str(self, text: str, **options: Any) -> Text:
        return super().render_str(
            "\n".join(plain(x) for x in text.split("\n")), **options
        )


def plain_console(**options: Any) -> Console:
    """A console for texts of anybody."""
    return _Plain(emoji=False, markup=False, highlight=False, **options)


# piped output is for other programs: not folded to a terminal's width
# no emoji: `file.ssd:100: …` is a line number; no markup: `h[b]` is a name
out = plain_console(**({"soft_wrap": True} if sys.stdout.isatty() else {"width": 200}))
err = plain_console(stderr=True, soft_wrap=True)


def warn(texts: Iterable[str]) -> None:
    """Warnings, on standard error."""
    for text in texts:
        err.print(f"warning: {text}")


def print_json(data: Any) -> None:
    """Data for programs, on standard output."""
    sys.stdout.write(json.dumps(data, indent=1) + "\n")


MARKS = {"": "", "ok": "green", "bad": "red"}  # colours of good and bad values


def print_table(table: Table, *, is_folded: bool = False) -> None:
    """Print a table on standard output.

    Parameters
    ----------
    table
        Nothing is printed of one without rows.
    is_folded
        Whether long texts are folded to the width of the terminal. Numbers are not: one that is
        cut is another one.
    """
    if not table.rows:
        return
    shown = RichTable(
        box=None, pad_edge=False, header_style="bold", show_header=table.has_header
    )
    for heading, column in zip(table.headings(), table.columns, strict=True):
        shown.add_column(
            heading, justify="right" if column.kind == "number" else "left"
        )
    for row in table.cells():
        shown.add_row(*(Text(plain(str(cell.value)), MARKS[cell.mark]) for cell in row))
    usual = out.width
    if not is_folded:
        whole = Measurement.get(
            out, out.options.update(max_width=10_000), shown
        ).maximum
        out.width = max(usual, whole)  # `print` takes no greater one
    out.print(shown)
    out.width = usual


SHOWN = 5
"""Numbers that a command prints where not all are asked for, and those with a
requirement."""


def to_print(
    numbers: Iterable[str], judged: Container[str], everything: bool
) -> list[str]:
    """The names of the numbers that are printed, in their order."""
    names = list(numbers)
    if everything:
        return names
    first = sorted(names, key=lambda name: name not in judged)
    most = max(SHOWN, sum(name in judged for name in names))
    return [name for name in names if name in first[:most]]


def print_rows(rows: list[dict[str, str]], as_json: bool) -> None:
    """Print texts of the same keys as a table, or for programs."""
    if as_json:
        print_json(rows)
        return
    columns = [Column(key, kind="text") for key in rows[0]]
    texts = [[str(value) for value in row.values()] for row in rows]
    print_table(Table("", columns, texts), is_folded=True)


def name_of(target: str) -> str:
    """The name under runs/ of what is made of a target."""
    path = Path(target).resolve()
    if not path.exists():
        return target.replace("/", "-")
    if path.is_dir():
        return path.name
    from ..files.scenario import name_of_file

    name = name_of_file(path) if path.suffix == ".toml" else path.stem
    return os.fsdecode(
        name.encode("utf-8", "surrogateescape")
    )  # as the locale names files
