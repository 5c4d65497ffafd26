"""Define `desat size NAME`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from ...runs.progress import stages
from ...sizing import quantities
from ...system.errors import DesatError, Exit
from .. import options as o
from ..console import app, err, example, name_of, out, print_json, print_table

if TYPE_CHECKING:
    from ...report.table import Table
    from ...sizing.dumps import DumpSizing
    from ...sizing.map import SizingMap
    from ...sizing.requirements import SizingRequirements
    from ...sizing.result import Sizing
    from ...sizing.trade import DumpMap
    from ...system.options import Options

# Options of a craft whose coils dump all the time, and of one that dumps by thrusters.
_OF_COILS = (
    "duty",
    "margin",
    "tip_off",
    "laws",
    "inclinations",
    "altitudes",
    "dipoles",
)
_OF_DUMPS = ("wheels", "thresholds", "years")


@app.command(epilog=example("desat size my12u"))
def size(
    ctx: typer.Context,
    target: o.Target,
    duty: Annotated[
        float,
        o.number(
            quantities.DUTY, "PERCENT", "Duty of the coils to recommend rods for."
        ),
    ] = 50.0,
    margin: Annotated[
        float,
        o.number(
            quantities.MARGIN, "FACTOR", "Of recommended rods over the least ones."
        ),
    ] = 1.3,
    slew: Annotated[
        str | None,
        typer.Option(metavar="DEG/S", help="A slew that wheels make: 60/300."),
    ] = None,
    tip_off: Annotated[
        float | None,
        o.number(
            quantities.TIP_OFF,
            "DEG_PER_S",
            "Rate after separation (default: that of detumbling.toml beside the craft, else 5).",
        ),
    ] = None,
    arm: Annotated[
        float | None,
        o.number(quantities.ARM, "M", "Of thrusters (default: the craft's)."),
    ] = None,
    isp: Annotated[
        float | None,
        o.number(quantities.ISP, "S", "Specific impulse (default: the craft's)."),
    ] = None,
    laws: Annotated[
        bool | None,
        typer.Option(
            "--laws/--own-law",
            help="Other laws than the craft's, too (default: yes, of a map no).",
        ),
    ] = None,
    year: Annotated[
        bool, typer.Option("--year/--no-year", help="The extremes of a year, too.")
    ] = True,
    loop: Annotated[
        bool,
        typer.Option(
            "--loop/--no-loop", help="Fly the sizes that count in the closed loop."
        ),
    ] = True,
    as_map: Annotated[
        bool,
        typer.Option(
            "--map",
            help="A map over rods, inclinations, altitudes, dipoles; of a craft that dumps by "
            "thrusters over wheels, thresholds, rods and the years of a tank.",
        ),
    ] = False,
    rods: Annotated[
        str | None,
        typer.Option(metavar="A.M2,...", help="Of a map (default: by the least rod)."),
    ] = None,
    inclinations: Annotated[
        str | None,
        typer.Option(metavar="DEG,...", help="Of a map (default: 10 to 97.5)."),
    ] = None,
    altitudes: Annotated[
        str | None,
        typer.Option(metavar="KM,...", help="Of a map (default: 350 to 900)."),
    ] = None,
    dipoles: Annotated[
        str | None,
        typer.Option(
            metavar="A.M2,...", help="Of a map (default: by its residual one)"
        ),
    ] = None,
    wheels: Annotated[
        str | None,
        typer.Option(
            metavar="N.M.S,...", help="Of a map of dumps (default: by its own)."
        ),
    ] = None,
    thresholds: Annotated[
        str | None,
        typer.Option(metavar="%,...", help="Of a map of dumps (default: 30 to 90)."),
    ] = None,
    years: Annotated[
        str | None,
        typer.Option(metavar="N,...", help="Of a map of dumps (default: 5, 10, 15)."),
    ] = None,
    sets: o.Sets = None,
    sources: o.Sources = None,
    stop: o.Stop = None,
    blocks: o.Blocks = False,
    jobs: o.Jobs = o.CPUS,
    html: Annotated[
        Path | None,
        o.output_file("--html", "Where the page goes (default: runs/size-NAME.html)."),
    ] = None,
    as_json: o.Json = False,
) -> None:
    """Size the wheels, torquers and propellant of a craft.

    By source and over a year: what the disturbances leave in the wheels, the least rod
    of any law, duty and momentum over rods law by law, and the rods for the duty asked
    for; of a craft that dumps by thrusters, how often and with how much propellant.
    Ends with 1 where the craft cannot hold.
    """
    from ...report.cases import keep_cases
    from ...sizing import dumps, sizing
    from ...sizing import page as sizing_page
    from ...sizing.requirements import SizingRequirements

    options = o.options_of(sets, stop, None, "gauss_seidel", blocks, sources=sources)
    angle, seconds = _slew(slew)
    by_thrusters = dumps.is_of(target, options)
    o.refuse(
        ctx,
        "it is of coils, and this craft dumps by thrusters"
        if by_thrusters
        else "it is of dumps by thrusters, and this craft has none",
        *(_OF_COILS if by_thrusters else _OF_DUMPS),
    )
    requirements = SizingRequirements(
        duty=duty / 100.0,
        margin=margin,
        slew_angle=radians(angle),
        slew_time=seconds,
        tip_off=None if tip_off is None else radians(tip_off),
        arm=arm,
        specific_impulse=isp,
        laws=laws is True if as_map else laws is not False,
        year=year,
        flown=loop,
    )
    axes = {
        "rods": (quantities.RODS, rods),
        "inclinations": (quantities.INCLINATIONS, inclinations),
        "altitudes": (quantities.ALTITUDES, altitudes),
        "dipoles": (quantities.DIPOLES, dipoles),
        "wheels": (quantities.WHEELS, wheels),
        "thresholds": (quantities.THRESHOLDS, thresholds),
        "years": (quantities.YEARS, years),
    }
    if as_map:
        unused = ("slew", "tip_off", "year", "loop")
        o.refuse(
            ctx,
            "a map has none of it: leave --map out",
            *(unused if by_thrusters else (*unused, "arm", "isp")),
        )
    else:
        o.refuse(ctx, "it belongs to --map", *axes)
    page = (
        html or Path("runs") / f"size-{'map-' if as_map else ''}{name_of(target)}.html"
    )
    to_page = page if html is not None or not as_json else None
    with stages(not as_json) as progress:
        if as_map:
            values = {
                k: quantity.many(text) if text is not None else ()
                for k, (quantity, text) in axes.items()
            }
            find = _map_of_dumps if by_thrusters else _map_of_rods
            result = find(target, options, values, requirements, jobs, progress)
        else:
            find_sizes = dumps.size if by_thrusters else sizing.size
            tell = _print_sized if loop and not as_json else _say_nothing
            sizes = find_sizes(target, options, requirements, progress, tell)
            if to_page is not None:
                keep_cases(to_page, sizes.as_json())
            result = _Result(
                sizes,
                _print_dumps if by_thrusters else _print_sizing,
                sizing_page.write_dumps if by_thrusters else sizing_page.write_sizing,
                sizes.problems,
            )
    _show(result, to_page, as_json)


class _Result(NamedTuple):
    """What a command has found, and how it is printed and written as a page."""

    sizes: SizingMap | DumpMap | DumpSizing | Sizing
    show: Callable[[Any], None]
    write: Callable[[Any, Path], Path]
    problems: Sequence[str] = ()  # why the craft cannot hold


def _map_of_dumps(
    target: str,
    options: Options,
    values: Mapping[str, tuple[float, ...]],
    requirements: SizingRequirements,
    jobs: int,
    progress: Callable[[str], None],
) -> _Result:
    """Map the dumps of a craft over the values of its axes, in one process."""
    from ...sizing import page, trade

    names = ("wheels", "thresholds", "rods", "years")
    axes = trade.DumpAxes(**{k: values[k] for k in names})
    sizes = trade.map_of_dumps(target, options, axes, requirements, progress)
    return _Result(sizes, _print_dump_map, page.write_dump_map)


def _map_of_rods(
    target: str,
    options: Options,
    values: Mapping[str, tuple[float, ...]],
    requirements: SizingRequirements,
    jobs: int,
    progress: Callable[[str], None],
) -> _Result:
    """Map the rods of a craft over the values of its axes."""
    from ...sizing import map as sizing_map
    from ...sizing import page

    axes = sizing_map.MapAxes(
        rods=values["rods"],
        inclinations=values["inclinations"],
        altitudes=tuple(1e3 * x for x in values["altitudes"]),
        dipoles=values["dipoles"],
        laws=requirements.laws,
    )
    sizes = sizing_map.map_of(target, options, axes, requirements, jobs, progress)
    return _Result(sizes, _print_map, page.write_map)


def _show(result: _Result, page: Path | None, as_json: bool) -> None:
    """Print sizes, or as JSON, and write their page where there is one.

    Exits with 1, and prints why, where the craft cannot hold.
    """
    if as_json:
        print_json(result.sizes.as_json())
    else:
        result.show(result.sizes)
    if page is not None:
        page_file = result.write(result.sizes, page)
        if not as_json:
            _print(page_file)
    for line in result.problems:
        err.print(f"it cannot hold: {line}", highlight=False, markup=False)
    if result.problems:
        raise typer.Exit(Exit.UNMET)


def _print(page: Path) -> None:
    """Print the path of a page."""
    out.print(f"page: {page.resolve()}", highlight=False, markup=False)


def _slew(text: str | None) -> tuple[float, float]:
    """Parse angle (deg) and time (s) of a slew, or raise DesatError."""
    if text is None:
        return 0.0, 0.0
    parts = text.split("/")
    if len(parts) != 2:
        raise DesatError(
            f"--slew {text}: an angle in deg and a time in s are needed, as 60/300"
        )
    angle, seconds = quantities.SLEW_ANGLE(parts[0]), quantities.SLEW_TIME(parts[1])
    if not (angle > 0.0 and seconds > 0.0):
        raise DesatError(
            f"--slew {text}: an angle and a time above 0 are needed, as 60/300"
        )
    return angle, seconds


def _print_sizing(sizing: Sizing) -> None:
    """Print a sizing."""
    from ...report.cases import tabulate_margins
    from ...sizing import tables
    from ...sizing.margins import tabulate_spread

    out.print(sizing.answer, highlight=False, markup=False)
    tables_shown = [
        tabulate_margins(sizing.margins),
        *tabulate_spread(sizing.intervals, sizing.assumptions),
        tables.tabulate_quantities(sizing),
        tables.tabulate_sources(sizing.sources),
    ]
    if sizing.year:
        tables_shown.append(tables.tabulate_extremes(sizing.year))
    laws = (sizing.curve[0].law, sizing.law) if sizing.curve else ()
    tables_shown.append(
        tables.tabulate_points([r for r in sizing.curve if r.law in laws])
    )
    if sizing.best:
        tables_shown.append(tables.tabulate_conditions(sizing))
    _print_tables(tables_shown)
    _print_notes(sizing.notes)


def _print_tables(tables: Sequence[Table]) -> None:
    """Print the tables that have rows."""
    for table in tables:
        if table.rows:
            out.print()
            print_table(table, is_folded=True)


def _print_notes(notes: Iterable[str]) -> None:
    """Print notes, a line each."""
    for line in notes:
        out.print(f"note: {line}", highlight=False, markup=False)


def _say_nothing(answer: str) -> None:
    """Print nothing."""


def _print_sized(answer: str) -> None:
    """Print what is known before the closed loop has flown."""
    out.print(f"sized: {answer}", highlight=False, markup=False)


def _print_dumps(sizing: DumpSizing) -> None:
    """Print a sizing of dumps."""
    from ...report.cases import tabulate_margins
    from ...sizing import tables
    from ...sizing.margins import tabulate_spread

    out.print(sizing.answer, highlight=False, markup=False)
    tables_shown = [
        tabulate_margins(sizing.margins),
        *tabulate_spread(sizing.intervals, sizing.assumptions),
        tables.tabulate_dumps(sizing),
        tables.tabulate_dump_sources(sizing.sources),
    ]
    if sizing.year:
        tables_shown.append(tables.tabulate_dump_extremes(sizing.year))
    _print_tables(tables_shown)
    _print_notes(sizing.notes)


def _print_dump_map(dump_map: DumpMap) -> None:
    """Print a map of dumps."""
    from ...sizing import tables

    _print_tables([tables.tabulate_dump_map(dump_map)])


def _print_map(sizing_map: SizingMap) -> None:
    """Print a map, a table for each law."""
    from ...sizing import tables

    for k in range(len(sizing_map.laws)):
        table = tables.tabulate_map(sizing_map, k)
        out.print(table.title, highlight=False)
        print_table(table, is_folded=True)
        out.print()
    _print_notes(sizing_map.notes)
