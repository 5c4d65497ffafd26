"""Define the application `desat` and how its commands print."""

from __future__ import annotations

import io
import json
import os
import sys
from collections.abc import Callable, Container, Iterable
from pathlib import Path
from typing import Any, TypeVar

import typer
from rich.console import Console, JustifyMethod
from rich.table import Table as RichTable
from rich.text import Text
from typer.core import TyperCommand, TyperGroup

from ..report.table import Column, Table
from ..system.errors import DesatError, Exit, plain

# The number of a closed stream would be given to the next file opened, and that be
# written to.
for _number, _name in ((1, "stdout"), (2, "stderr")):
    if getattr(sys, _name) is None:
        os.dup2(os.open(os.devnull, os.O_WRONLY), _number)
        setattr(sys, _name, open(_number, "w", encoding="utf-8", closefd=False))  # noqa: SIM115


class _Lasting(io.FileIO):
    """Raw end of an output stream that survives its reader.

    If the reader goes away, the remaining output is discarded and the command ends as
    usual.
    """

    def write(self, data: Any) -> int:
        """Write data; discard it if the reader has gone."""
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


# a path may have characters that the locale lacks
for _name in ("stdout", "stderr"):
    if (
        type(_stream := getattr(sys, _name)) is io.TextIOWrapper
    ):  # not a stream that tests have set
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

# commands in the order of `desat --help`
PANELS = {
    "Start": ("new", "size", "budget", "run", "list", "show", "help"),
    "Study": (
        "compare",
        "fit",
        "faults",
        "tune",
        "sweep",
        "campaign",
        "bound",
        "tables",
    ),
    "Results": ("report", "export", "resume"),
    "Make": ("check", "build", "design", "pack"),
}


# sections of the help of a command with many options; the first has the usual ones
SECTIONS = {
    "Options": ("-n", "--set", "--source", "--stop", "--out", "--json", "--help"),
    "What is recorded and printed": (
        *("--all", "--record", "--every", "--csv", "--html", "--baseline"),
        *("--checkpoint", "--keep", "--by", "--curve"),
    ),
    "Time steps and accuracy": (
        *("--step", "--substeps", "--accuracy", "--algorithm", "--output-class"),
        *("--solve-loops", "--halve", "--design"),
    ),
    "Samples": ("--sampling", "--seed", "--accept-versions"),
    "FMUs, processes and limits": (
        *("--fmus", "--blocks", "--loop", "--isolate", "--trust", "--strict"),
        *("--allow-outside", "--time-limit", "--call-limit", "--case-limit"),
        *("--jobs", "--cluster"),
    ),
}


def section_of(option: str) -> str:
    """Return the section of an option; the first for one that no section names."""
    return next((s for s, names in SECTIONS.items() if option in names), "Options")


F = TypeVar("F", bound=Callable[..., Any])


class OnceOnly(TyperCommand):
    """A command that refuses an option given twice, unless it may be repeated."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments; raise DesatError for an option that comes again."""
        _, _, order = self.make_parser(ctx).parse_args(args=[*args])
        known: list[Any] = []
        for param in order:
            is_single = param.param_type_name == "option" and not param.multiple
            if is_single and param in known:
                names = "/".join([*param.opts[:1], *param.secondary_opts])
                raise DesatError(f"{names}: it is given twice; it takes one value")
            known.append(param)
        return super().parse_args(ctx, args)


class Sections(OnceOnly):
    """A command with many options, whose help has them in sections."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        for param in self.params:
            section = section_of(param.opts[0])
            if param.param_type_name == "option" and section != "Options":
                param.rich_help_panel = section  # type: ignore[attr-defined]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments, then the options, a section after the other."""
        rows: dict[str, list[tuple[str, str]]] = {"Arguments": []}
        rows |= {section: [] for section in SECTIONS}
        order = [name for names in SECTIONS.values() for name in names]

        def place(param: Any) -> int:
            """Return the place of an option in the help."""
            name = param.opts[0]
            return order.index(name) if name in order else len(order)

        for param in sorted(self.get_params(ctx), key=place):
            if (record := param.get_help_record(ctx)) is None:
                continue
            is_option = param.param_type_name == "option"
            section = section_of(param.opts[0]) if is_option else "Arguments"
            rows[section].append(record)
        for section, records in rows.items():
            if records:
                with formatter.section(section):
                    formatter.write_dl(records)


class Panels(TyperGroup):
    """Commands in panels, on a terminal and where help is piped."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the commands in the order of their panels."""
        for panel, names in PANELS.items():
            for name in names:
                if name in self.commands:
                    self.commands[name].rich_help_panel = panel  # type: ignore[attr-defined]
        return [n for names in PANELS.values() for n in names if n in self.commands]

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the commands, a section for each panel."""
        for panel, names in PANELS.items():
            commands = [(n, self.commands[n]) for n in names if n in self.commands]
            with formatter.section(panel):
                formatter.write_dl([(n, c.get_short_help_str(90)) for n, c in commands])


def example(command: str) -> str:
    """Return the last line of a command's help: an example that can be typed."""
    return f"Example: {command}"


class Commands(typer.Typer):
    """An application whose commands take each option once."""

    def command(
        self,
        *args: Any,
        cls: type[TyperCommand] | None = None,
        **options: Any,
    ) -> Callable[[F], F]:
        """Register a command, of the class OnceOnly unless another is named."""
        return super().command(*args, cls=cls or OnceOnly, **options)


app = Commands(
    cls=Panels,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    # boxes take as long to load as everything else: only on a terminal
    rich_markup_mode="rich" if sys.stdout.isatty() else None,
    context_settings={} if sys.stdout.isatty() else {"terminal_width": 120},
    help="Spacecraft momentum management as co-simulated FMUs. Start with `desat new craft my12u "
    "--size 12U`, then `desat size my12u` and `desat run my12u`; every command explains itself "
    "with --help.",
    epilog=EPILOG,
)


class WithDefault(TyperGroup):
    """A group that runs its command `run` if the first argument is a target."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Insert `run` before a first argument that is no command."""
        if args and args[0] not in self.commands and args[0] not in ("--help", "-h"):
            args = ["run", *args]
        return super().parse_args(ctx, args)

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the commands, then the options of `run`, which needs no name."""
        super().format_options(ctx, formatter)
        self.commands["run"].format_options(ctx, formatter)


class _Plain(Console):
    """A console that prints no control characters from names and messages."""

    def render_str(self, text: str, **options: Any) -> Text:
        """Render a text without control characters."""
        return super().render_str(
            "\n".join(plain(x) for x in text.split("\n")), **options
        )


def plain_console(**options: Any) -> Console:
    """Return a console for texts of any origin."""
    return _Plain(emoji=False, markup=False, highlight=False, **options)


# piped output is for other programs: not folded to a terminal's width
# no emoji: `file.ssd:100: …` is a line number; no markup: `h[b]` is a name
out = plain_console(**({"soft_wrap": True} if sys.stdout.isatty() else {"width": 200}))
err = plain_console(stderr=True, soft_wrap=True)


def warn(texts: Iterable[str]) -> None:
    """Print warnings on standard error."""
    for text in texts:
        err.print(f"warning: {text}")


def print_json(data: Any) -> None:
    """Print data as JSON on standard output."""
    sys.stdout.write(json.dumps(data, indent=1) + "\n")


MARKS = {"": "", "ok": "green", "bad": "red"}  # colours of good and bad values


def print_table(table: Table, *, is_folded: bool = False) -> None:
    """Print a table on standard output.

    Parameters
    ----------
    table
        The table; nothing is printed if it has no rows.
    is_folded
        Whether long texts are folded to the width of the terminal. Numbers and names
        are not: a truncated one would be another one.
    """
    if not table.rows:
        return
    rich_table = RichTable(
        box=None, pad_edge=False, header_style="bold", show_header=table.has_header
    )
    rows = [
        [Text(plain(str(cell.value)), MARKS[cell.mark]) for cell in row]
        for row in table.cells()
    ]
    headings = list(map(out.render_str, table.headings()))
    # a column that is not folded has its width from here: the library measures twice
    widths = [
        None
        if is_folded and any(" " in text.plain for text in texts[1:])
        else max(text.cell_len for text in texts)
        for texts in zip(headings, *rows, strict=True)
    ]
    for heading, column, width in zip(headings, table.columns, widths, strict=True):
        justify: JustifyMethod = "right" if column.kind == "number" else "left"
        rich_table.add_column(heading, justify=justify, width=width)
    for row in rows:
        rich_table.add_row(*row)
    usual = out.width
    full_width = sum(filter(None, widths)) + 2 * (len(widths) - 1)
    if not is_folded:
        out.width = max(usual, full_width)  # `print` limits its width to this
    out.print(rich_table)
    out.width = usual


# numbers that a command prints without --all, at least those with a requirement
SHOWN = 5


def to_print(
    numbers: Iterable[str], judged: Container[str], everything: bool
) -> list[str]:
    """Select the names of the numbers that are printed, in their order."""
    names = list(numbers)
    if everything:
        return names
    first = sorted(names, key=lambda name: name not in judged)
    most = max(SHOWN, sum(name in judged for name in names))
    return [name for name in names if name in first[:most]]


def print_rows(rows: list[dict[str, str]], as_json: bool) -> None:
    """Print rows of texts with the same keys as a table, or as JSON."""
    if as_json:
        print_json(rows)
        return
    columns = [Column(key, kind="text") for key in rows[0]]
    texts = [[str(value) for value in row.values()] for row in rows]
    print_table(Table("", columns, texts), is_folded=True)


def name_of(target: str) -> str:
    """Return the name under runs/ of the results of a target."""
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
