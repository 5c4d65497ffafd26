"""What the commands of `desat` share: the application, consoles, options."""

from __future__ import annotations

import io
import json
import os
import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from ..system.codes import Exit
from ..system.errors import DesatError, plain

if TYPE_CHECKING:
    from ..system.options import Algorithm, Options

# a stream that is closed would be given to the next file that is opened, and written into
for _number, _name in ((1, "stdout"), (2, "stderr")):
    if getattr(sys, _name) is None:
        os.dup2(os.open(os.devnull, os.O_WRONLY), _number)
        setattr(sys, _name, open(_number, "w", encoding="utf-8", closefd=False))  # noqa: SIM115


class _Lasting(io.FileIO):
    """Where a stream ends. Whoever reads it may go away: the rest is for nobody, and the command
    ends as it would have."""

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except BrokenPipeError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), self.fileno())
            return len(data)


# a path may have characters that the locale has not
for _name in ("stdout", "stderr"):
    if type(_stream := getattr(sys, _name)) is io.TextIOWrapper:  # not what tests put there
        _stream.flush()
        _raw = _Lasting(_stream.fileno(), "w", closefd=False)
        setattr(sys, _name, io.TextIOWrapper(
            io.BufferedWriter(_raw), _stream.encoding, "backslashreplace",
            line_buffering=_stream.line_buffering, write_through=_stream.write_through,
        ))  # fmt: skip

EPILOG = "Exit codes: " + "; ".join(f"{e.value} {e.meaning}" for e in Exit) + "."

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    # boxes take as long to load as all else: only where a person looks
    rich_markup_mode="rich" if sys.stdout.isatty() else None,
    context_settings={} if sys.stdout.isatty() else {"terminal_width": 120},
    help="Spacecraft momentum management as co-simulated FMUs. Start with `desat list`, then "
    "`desat run NAME`; every command explains itself with --help.",
    epilog=EPILOG,
)


class _Plain(Console):
    """A console that prints no control characters of names and messages that others gave."""

    def render_str(self, text: str, **options: Any) -> Text:
        return super().render_str("\n".join(plain(x) for x in text.split("\n")), **options)


def plain_console(**options: Any) -> Console:
    """A console for texts of anybody."""
    return _Plain(emoji=False, **options)


# piped output is for other programs: not folded to a terminal's width
# no emoji: `file.ssd:100: …` is a line number
out = plain_console(**({"soft_wrap": True} if sys.stdout.isatty() else {"width": 200}))
err = plain_console(stderr=True, soft_wrap=True)


class Semantics(StrEnum):
    """How values move between components."""

    conserving = "conserving"
    jacobi = "jacobi"


class Stepping(StrEnum):
    """What makes the steps of a run."""

    compiled = "compiled"
    python = "python"


class Isolated(StrEnum):
    """Which FMUs run in processes of their own."""

    all = "all"
    foreign = "foreign"
    none = "none"


class FmuKind(StrEnum):
    """Which of our FMUs run."""

    native = "native"
    python = "python"


def complete_name(incomplete: str) -> list[str]:
    """The scenarios that a shell offers for the beginning of a name."""
    from ..study import listing

    names = (
        name for f in listing.families() for name in listing.family(f, of_systems=False).scenarios
    )
    return [name for name in names if name.startswith(incomplete)]


def complete_family(incomplete: str) -> list[str]:
    """The families that a shell offers for the beginning of a name."""
    from ..study.listing import families

    return [n for n in families() if n.startswith(incomplete)]


TARGET = typer.Argument(
    metavar="NAME|FILE|FOLDER",
    help="A scenario (see `desat list`), a scenario file of your own (.toml), an .ssp file, or a "
    "folder with a SystemStructure.ssd.",
    show_default=False,
    autocompletion=complete_name,
)
Target = Annotated[str, TARGET]
Sets = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="COMP.VAR=VALUE",
                 help="Give a parameter (or unconnected input) another value; a choice by its "
                 "name, an array as 1,2,3; shared.VAR in every component that has it. May be "
                 "repeated."),
]  # fmt: skip
Sources = Annotated[
    list[str] | None,
    typer.Option("--source", metavar="COMP=FMU",
                 help="Another FMU in a component's place: a file, or one of ours by its name. "
                 "Parameters that both declare alike stay. May be repeated."),
]  # fmt: skip
Stop = Annotated[float | None, typer.Option(help="Stop time, s.")]
Step = Annotated[float | None, typer.Option(help="Step, s.")]
Inner = Annotated[
    str | None,
    typer.Option(metavar="N|auto",
                 help="Inner steps, within each step, of actuators and body: more of them exchange "
                 "torques more exactly; auto: as many as --accuracy needs."),
]  # fmt: skip
Accuracy = Annotated[
    float | None,
    typer.Option(metavar="RAD",
                 help="Attitude error, as the run estimates it, that --inner auto keeps below."),
]  # fmt: skip
Alg = Annotated[
    Semantics,
    typer.Option(help="conserving: no delay in the loop; jacobi: as libcosim and Ecos do."),
]
LoopOption = Annotated[
    Stepping,
    typer.Option("--loop", help="compiled: in C, where a compiler is there and all components are "
                 "FMUs, else python; the same bits."),
]  # fmt: skip
Blocks = Annotated[bool, typer.Option("--blocks", help="Bare blocks instead of FMUs.")]
Fmus = Annotated[
    FmuKind,
    typer.Option("--fmus", help="Which of our FMUs: native ones where there are such, or those of "
                 "Python; the same bits."),
]  # fmt: skip
Json = Annotated[bool, typer.Option("--json", help="Print JSON for programs.")]
Classes = Annotated[
    list[str] | None,
    typer.Option("--output-class", metavar="COMP.OUT=CLASS",
                 help="Class of an output: state or interval. May be repeated."),
]  # fmt: skip
DesignOption = Annotated[
    str | None,
    typer.Option("--design", metavar="now|FILE",
                 help="Of a scenario with a design (gain tables, costates): make one now for these "
                 "values, or take that of a file. Default: the kept one."),
]  # fmt: skip
TimeLimit = Annotated[
    float | None,
    typer.Option(metavar="SECONDS", min=0.0,
                 help="Wall time that a run may take to step; what it has by then is kept, and the "
                 "command ends with 5."),
]  # fmt: skip
Trust = Annotated[
    Path | None,
    typer.Option("--trust", metavar="FILE",
                 help="A list of sha256 hashes (as of sha256sum): an FMU that is neither ours nor "
                 "of it is refused."),
]  # fmt: skip
Jobs = Annotated[int, typer.Option(help="Processes.", min=1)]
CPUS = os.cpu_count() or 1


def options_of(
    sets: list[str] | None, stop: float | None, step: float | None, algorithm: Semantics,
    blocks: bool, classes: list[str] | None = None, sources: list[str] | None = None, **more: Any,
) -> Options:  # fmt: skip
    """What the options of a command say."""
    from ..system.options import Options

    overrides: dict[str, str] = {}
    for text in classes or []:
        key, _, value = text.partition("=")
        overrides[key] = value
    if (trust := more.pop("trust", None)) is not None:
        from ..files.trust import hashes

        more["trusted"] = hashes(trust)
    if (inner := more.get("inner")) is not None:
        more["inner"] = inner if inner == "auto" else _whole(f"--inner {inner}", inner)
    name: Algorithm = "jacobi" if algorithm is Semantics.jacobi else "conserving"
    return Options(
        sets=list(sets or []), sources=list(sources or []), stop=stop, step=step, algorithm=name,
        blocks=blocks, output_classes=overrides, **more,
    )  # fmt: skip


def _whole(where: str, text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise DesatError(f"{where}: an integer or auto is needed") from None


def warn(texts: list[str]) -> None:
    """Warnings, on standard error."""
    for text in texts:
        err.print(f"warning: {text}", highlight=False, markup=False)


def print_json(data: Any) -> None:
    """Data for programs, on standard output."""
    sys.stdout.write(json.dumps(data, indent=1) + "\n")


def print_numbers(table: Table) -> None:
    """A table of numbers on standard output, in its whole width: one that is cut is another one."""
    usual = out.width
    whole = Measurement.get(out, out.options.update(max_width=10_000), table).maximum
    out.width = max(usual, whole)  # `print` takes no greater one
    out.print(table)
    out.width = usual


def name_of(target: str) -> str:
    """The name under runs/ of what is made of a target."""
    return Path(target).resolve().stem if Path(target).exists() else target.replace("/", "-")
