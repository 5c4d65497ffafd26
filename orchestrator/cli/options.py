"""Declare the options that several commands share (`from .. import options as o`)."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..system import choices
from ..system.errors import DesatError
from ..system.quantity import Quantity
from .console import SHOWN

if TYPE_CHECKING:
    from ..system.options import Options


LONGEST = 1e7  # s: maximum of wall times in options


def complete_name(incomplete: str) -> list[str]:
    """Return the scenarios whose name begins with a text, for the shell."""
    from ..runs import catalogue

    names = (
        name
        for f in catalogue.families()
        for name in catalogue.family(f, of_systems=False).scenarios
    )
    return [name for name in names if name.startswith(incomplete)]


def complete_family(incomplete: str) -> list[str]:
    """Return the families whose name begins with a text, for the shell."""
    from ..runs.catalogue import families

    return [n for n in families() if n.startswith(incomplete)]


def number(quantity: Quantity, metavar: str, text: str) -> Any:
    """Return an option of one number, parsed with its unit.

    Every number that is typed uses this, or is an integer of typer's.
    """
    return typer.Option(
        quantity.option, parser=quantity.__call__, metavar=metavar, help=text
    )


def output_file(option: str, text: str) -> Any:
    """Return an option that names a file to write.

    A path that cannot be written is refused at once.
    """

    def checked(path: str | Path) -> Path:
        """Return the path, or raise DesatError."""
        from ..files.io import place_of

        place_of(Path(path), option)
        return Path(path)

    return typer.Option(
        option, parser=checked, metavar="FILE", show_default=False, help=text
    )


def refuse(ctx: typer.Context, reason: str, *names: str) -> None:
    """Raise DesatError, which names the option, for a typed one that has no effect."""
    for param in ctx.command.params:
        source = ctx.get_parameter_source(str(param.name))
        if param.name in names and source is not None and source.name == "COMMANDLINE":
            raise DesatError(f"{param.opts[0]}: {reason}")


TARGET = typer.Argument(
    metavar="NAME|FILE|FOLDER",
    help="The folder of a craft of your own, a scenario (see `desat list`), a scenario file "
    "(.toml), an .ssp file, or a folder with a SystemStructure.ssd.",
    show_default=False,
    autocompletion=complete_name,
)
Target = Annotated[str, TARGET]
Sets = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="COMP.VAR=VALUE",
        help="Give a parameter (or unconnected input) another value; a choice by its "
        "name, an array as 1,2,3; shared.VAR in every component that has it. May be "
        "repeated.",
    ),
]
Seed = Annotated[int, typer.Option(help="Seed of the random samples.", min=0)]
Sources = Annotated[
    list[str] | None,
    typer.Option(
        "--source",
        metavar="COMP=FMU",
        help="Another FMU in a component's place: a file, one of ours by its name, or a "
        "block file of your own (.py), which is built. Parameters that both declare alike "
        "stay. May be repeated.",
    ),
]


def time_or_orbits(name: str) -> Callable[[str | float], str | float]:
    """Return the parser of an option: a number of s, or the text of a number of orbits."""

    def parse(value: str | float) -> str | float:
        """Parse the time."""
        from ..system.options import orbits

        is_count = isinstance(value, str) and orbits(value)
        return value if is_count else Quantity(name, "s")(value)

    return parse


Stop = Annotated[
    str | None,
    typer.Option(
        "--stop",
        parser=time_or_orbits("--stop"),
        metavar="TIME",
        help="Stop time: 6000 (s), 6h, 20d, 2orbits.",
    ),
]
Step = Annotated[float | None, number(Quantity("--step", "s"), "S", "Step, s.")]
Substeps = Annotated[
    str | None,
    typer.Option(
        metavar="N|auto",
        help="Number of substeps in each step for components that exchange step averages "
        "(actuators and body); auto: as many as --accuracy needs.",
    ),
]
Accuracy = Annotated[
    float | None,
    number(
        Quantity("--accuracy", "rad", 0.0, choices.MOST_ACCURACY, above=True),
        "RAD",
        "Bound of the estimated attitude error (rad) for --substeps auto.",
    ),
]
Alg = Annotated[
    choices.Algorithm,
    typer.Option(
        help="gauss_seidel: no delay in the loop; jacobi: as libcosim and Ecos do."
    ),
]
SolveLoops = Annotated[
    bool,
    typer.Option(
        "--solve-loops",
        help="Solve algebraic loops of foreign FMUs at each communication point, by "
        "Newton's method to 1e-10 of their size; else they are refused, or a step late by jacobi.",
    ),
]
LoopOption = Annotated[
    choices.Loop,
    typer.Option(
        "--loop",
        help="compiled: in C, where a compiler is there and all components are "
        "FMUs, else python; the same bits.",
    ),
]
Blocks = Annotated[bool, typer.Option("--blocks", help="Bare blocks instead of FMUs.")]
Fmus = Annotated[
    choices.Fmus,
    typer.Option(
        "--fmus",
        help="Which of our FMUs: native ones where there are such, or those of "
        "Python; the same bits.",
    ),
]
Everything = Annotated[
    bool,
    typer.Option(
        "--all",
        help="Print every number; default: those with a requirement, and the "
        f"first of the others, {SHOWN} in all.",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON for programs.")]
Classes = Annotated[
    list[str] | None,
    typer.Option(
        "--output-class",
        metavar="COMP.OUT=CLASS",
        help="Class of an output: state or interval. May be repeated.",
    ),
]
DesignOption = Annotated[
    str | None,
    typer.Option(
        "--design",
        metavar="now|FILE",
        help="Of a scenario with a design (gain tables, costates): make one now for these "
        "values, or take that of a file. Default: the kept one.",
    ),
]
TimeLimit = Annotated[
    float | None,
    number(
        Quantity("--time-limit", "s", 0.0, LONGEST, above=True),
        "SECONDS",
        "Wall time that a run may take to step; what it has by then is kept, and the command "
        "ends with 5.",
    ),
]
Trust = Annotated[
    Path | None,
    typer.Option(
        "--trust",
        metavar="FILE",
        help="A list of sha256 hashes (as of sha256sum): an FMU that is neither ours nor "
        "of it is refused.",
    ),
]
Outside = Annotated[
    bool,
    typer.Option("--allow-outside", help="Let an SSP name files outside its folder."),
]
Strict = Annotated[
    bool,
    typer.Option(
        "--strict",
        help="Refuse a foreign FMU whose model description breaks the "
        "standard; else that is a warning.",
    ),
]
Platforms = Annotated[
    str,
    typer.Option(
        metavar="all|NAMES",
        help="Native for these platforms: all, or linux64,win64,darwin64,aarch64-linux "
        "(`pip install ziglang`). Default: this one.",
        show_default=False,
    ),
]
Fmi = Annotated[choices.FmiVersion, typer.Option(help="Of FMI 2.0 or of FMI 3.0.")]
Jobs = Annotated[int, typer.Option(help="Processes.", min=1)]
CPUS = os.cpu_count() or 1


def options_of(
    sets: list[str] | None,
    stop: str | float | None,
    step: float | None,
    algorithm: choices.Algorithm,
    blocks: bool,
    classes: list[str] | None = None,
    sources: list[str] | None = None,
    **more: Any,
) -> Options:
    """Return the options that a command was given."""
    from ..system.options import Options

    for option, texts in (
        ("--set", sets),
        ("--source", sources),
        ("--output-class", classes),
    ):
        _refuse_twice(option, texts or [])
    overrides: dict[str, str] = {}
    for text in classes or []:
        key, _, value = text.partition("=")
        overrides[key] = value
    if (trust := more.pop("trust", None)) is not None:
        from ..files.library import hashes

        more["trusted"] = hashes(trust)
    if (substeps := more.get("substeps")) is not None:
        more["substeps"] = (
            substeps
            if substeps == "auto"
            else parse_integer(f"--substeps {substeps}", substeps)
        )
    return Options(
        sets=list(sets or []),
        sources=list(sources or []),
        stop=stop,
        step=step,
        algorithm=algorithm,
        blocks=blocks,
        output_classes=overrides,
        **more,
    )


def _refuse_twice(option: str, texts: list[str]) -> None:
    """Raise DesatError where two texts, as NAME=VALUE, have the same name."""
    first: dict[str, str] = {}
    for text in texts:
        name = text.partition("=")[0].strip()
        if name in first:
            raise DesatError(
                f"{option} {text}: {name} has {option} {first[name]} already"
            )
        first[name] = text


def parse_integer(place: str, text: str) -> int:
    """Parse an integer, or raise DesatError."""
    try:
        return int(text)
    except ValueError:
        raise DesatError(f"{place}: an integer or auto is needed") from None
