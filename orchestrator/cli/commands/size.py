"""`desat size NAME`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from ...runs.progress import stages
from ...sizing import quantities
from ...system.errors import DesatError, Exit
from .. import options as o
from ..console import app, err, example, name_of, out, print_json

if TYPE_CHECKING:
    from ...sizing.dumps import DumpSizing
    from ...sizing.map import SizingMap
    from ...sizing.sizing import Sizing


@app.command(epilog=example("desat size my12u"))
def size(
    ctx: typer.Context,
    target: o.Target,
    duty: Annotated[
        float, o.number(quantities.DUTY, "PERCENT", "Duty of the coils to recommend rods for.")
    ] = 50.0,
    margin: Annotated[
        float, o.number(quantities.MARGIN, "FACTOR", "Of recommended rods over the least ones.")
    ] = 1.3,
    slew: Annotated[
        str | None, typer.Option(metavar="DEG/S", help="A slew that wheels make: 60/300.")
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
        float | None, o.number(quantities.ARM, "M", "Of thrusters (default: the craft's).")
    ] = None,
    isp: Annotated[
        float | None, o.number(quantities.ISP, "S", "Specific impulse (default: the craft's).")
    ] = None,
    laws: Annotated[
        bool | None,
        typer.Option(
            "--laws/--own-law", help="Other laws than the craft's, too (default: yes, of a map no)."
        ),
    ] = None,
    year: Annotated[
        bool, typer.Option("--year/--no-year", help="The extremes of a year, too.")
    ] = True,
    loop: Annotated[
        bool, typer.Option("--loop/--no-loop", help="Fly the sizes that count in the closed loop.")
    ] = True,
    as_map: Annotated[
        bool, typer.Option("--map", help="A map over rods, inclinations, altitudes, dipoles.")
    ] = False,
    rods: Annotated[
        str | None, typer.Option(metavar="A.M2,...", help="Of a map (default: by the least rod).")
    ] = None,
    inclinations: Annotated[
        str | None, typer.Option(metavar="DEG,...", help="Of a map (default: 10 to 97.5).")
    ] = None,
    altitudes: Annotated[
        str | None, typer.Option(metavar="KM,...", help="Of a map (default: 350 to 900).")
    ] = None,
    dipoles: Annotated[
        str | None, typer.Option(metavar="A.M2,...", help="Of a map (default: by its residual one)")
    ] = None,
    sets: o.Sets = None,
    sources: o.Sources = None,
    stop: o.Stop = None,
    blocks: o.Blocks = False,
    jobs: o.Jobs = o.CPUS,
    html: Annotated[
        Path | None, o.output_file("--html", "Where the page goes (default: runs/size-NAME.html).")
    ] = None,
    as_json: o.Json = False,
) -> None:
    """Size the wheels, torquers and propellant of a craft.

    By source and over a year: what the disturbances leave in the wheels, the least rod of any law,
    duty and momentum over rods law by law, and the rods for the duty asked for; of a craft that
    dumps by thrusters, how often and with how much propellant. Ends with 1 where the craft cannot
    hold.
    """
    from ...sizing import dumps, sizing
    from ...sizing import map as sizing_map
    from ...sizing import page as sizing_page

    options = o.options_of(sets, stop, None, o.Semantics.gauss_seidel, blocks, sources=sources)
    angle, seconds = _slew(slew)
    by_thrusters = dumps.is_of(target, options)
    if by_thrusters:
        o.refuse(ctx, "it is of coils, and this craft dumps by thrusters", "duty", "margin",
                 "tip_off", "laws", "as_map")  # fmt: skip
    wishes = sizing.Wishes(
        duty / 100.0,
        margin,
        radians(angle),
        seconds,
        None if tip_off is None else radians(tip_off),
        arm,
        isp,
        laws is not False,
        year,
        loop,
    )
    given = {"rods": (quantities.RODS, rods),
             "inclinations": (quantities.INCLINATIONS, inclinations),
             "altitudes": (quantities.ALTITUDES, altitudes),
             "dipoles": (quantities.DIPOLES, dipoles)}  # fmt: skip
    if as_map:
        o.refuse(ctx, "a map has none of it: leave --map out", "slew", "tip_off", "arm", "isp",
                 "year", "loop")  # fmt: skip
    else:
        o.refuse(ctx, "it belongs to --map", *given)
    page = html or Path("runs") / f"size-{'map-' if as_map else ''}{name_of(target)}.html"
    with stages(not as_json) as progress:
        if as_map:
            values = {k: quantity.many(text) if text is not None else ()
                      for k, (quantity, text) in given.items()}  # fmt: skip
            values["altitudes"] = tuple(1e3 * x for x in values["altitudes"])
            axes = sizing_map.MapAxes(**values, laws=laws is True)
            map_made = sizing_map.map_of(target, options, axes, wishes, jobs, progress)
        elif by_thrusters:
            found = dumps.size(target, options, wishes, progress, _print_sized(as_json))
        else:
            made = sizing.size(target, options, wishes, progress)
    if by_thrusters:
        if as_json:
            print_json(found.as_json())
        else:
            _print_dumps(found)
        if html is not None or not as_json:
            written = sizing_page.write_dumps(found, page)
            if not as_json:
                _print(written)
        for line in found.problems:
            err.print(f"it cannot hold: {line}", highlight=False, markup=False)
        if found.problems:
            raise typer.Exit(Exit.UNMET)
        return
    if as_map:
        if as_json:
            print_json(map_made.as_json())
        else:
            _print_map(map_made)
        if html is not None or not as_json:
            written = sizing_page.write_map(map_made, page)
            if not as_json:
                _print(written)
        return
    if as_json:
        print_json(made.as_json())
        if html is not None:
            sizing_page.write_sizing(made, page)
    else:
        _print_sizing(made)
        _print(sizing_page.write_sizing(made, page))
    for line in made.problems:
        err.print(f"it cannot hold: {line}", highlight=False, markup=False)
    if made.problems:
        raise typer.Exit(Exit.UNMET)


def _print(page: Path) -> None:
    out.print(f"page: {page.resolve()}", highlight=False, markup=False)


def _slew(text: str | None) -> tuple[float, float]:
    """Angle (deg) and time (s). Raises DesatError where they are none."""
    if text is None:
        return 0.0, 0.0
    parts = text.split("/")
    if len(parts) != 2:
        raise DesatError(f"--slew {text}: an angle in deg and a time in s are needed, as 60/300")
    angle, seconds = quantities.SLEW_ANGLE(parts[0]), quantities.SLEW_TIME(parts[1])
    if not (angle > 0.0 and seconds > 0.0):
        raise DesatError(f"--slew {text}: an angle and a time above 0 are needed, as 60/300")
    return angle, seconds


def _print_sizing(made: Sizing) -> None:
    from ...sizing.page import cells_of, rows_of

    out.print(made.answer, highlight=False, markup=False)
    out.print()
    rows = Table(box=None, show_header=False, pad_edge=False)
    rows.add_column()
    rows.add_column(justify="right")
    for row in rows_of(made):
        rows.add_row(*row)
    out.print(rows)
    if made.margins:
        out.print()
        table = _table("margin", "needed", "has", "unit", "times")
        for m in made.margins:
            table.add_row(m.name, f"{m.needed:.4g}", f"{m.has:.4g}", m.unit, f"{m.ratio:.3g}")
        out.print(table)
    if made.sources:
        out.print()
        table = _table("source", "secular, uN m", "along the total, %", "an orbit, mN m s",
                       "cyclic, mN m s")  # fmt: skip
        for s in made.sources:
            table.add_row(s.name, f"{1e6 * s.secular:.4g}", f"{100.0 * s.along:.1f}",
                          f"{1e3 * s.per_orbit:.4g}", f"{1e3 * s.cyclic:.4g}")  # fmt: skip
        out.print(table)
    if made.year:
        out.print()
        table = _table(
            "of a year", "day", "activity of the Sun", "secular, uN m", "least rod, A m2"
        )
        for name, pick in (("least", min), ("most", max)):
            d = pick(made.year, key=lambda x: x.least)
            table.add_row(name, d.day, d.activity, f"{1e6 * d.secular:.4g}", f"{d.least:.4g}")
        out.print(table)
    if made.curve:
        out.print()
        table = _table("law", "rod, A m2", "times the least", "rms, mN m s", "largest",
                       "wheel, %", "duty, %", "closed loop: rms", "largest", "duty, %")  # fmt: skip
        for r in made.curve:
            if r.law == made.curve[0].law or r.law == made.law:
                table.add_row(*cells_of(r))
        out.print(table)
    if made.conditions and made.best:
        out.print()
        laws = [b.law for b in made.best]
        table = _table(f"smallest rods (A m2), duty {100.0 * made.duty:g} %, margin "
                       f"{made.wishes.margin:g}", *laws)  # fmt: skip
        for found in made.conditions:
            table.add_row(found.condition, *(_rod_cell(found.rods, law) for law in laws))
        out.print(table)
    for line in made.notes:
        out.print(f"note: {line}", highlight=False, markup=False)


def _rod_cell(rods: Mapping[str, float | None], law: str) -> str:
    """Return the text of a law's rods (A m2): empty where it was not looked at."""
    if law not in rods:
        return ""
    rod = rods[law]
    return "none" if rod is None else f"{rod:.3g}"


def _print_sized(as_json: bool) -> Callable[[DumpSizing], None]:
    """Return what prints the sizes before the closed loop has flown."""

    def show(made: DumpSizing) -> None:
        if not as_json:
            out.print(f"sized: {made.answer}", highlight=False, markup=False)

    return show


def _print_dumps(made: DumpSizing) -> None:
    from ...sizing.page import dump_rows

    out.print(made.answer, highlight=False, markup=False)
    out.print()
    rows = _table("dumps by thrusters", "sized", "closed loop")
    for row in dump_rows(made):
        rows.add_row(*row)
    out.print(rows)
    if made.sources:
        out.print()
        table = _table("source", "secular, uN m", "along the total, %")
        for s in made.sources:
            table.add_row(s.name, f"{1e6 * s.secular:.4g}", f"{100.0 * s.along:.1f}")
        out.print(table)
    if made.year:
        out.print()
        table = _table("of a year", "day", "secular, uN m")
        for name, pick in (("least", min), ("most", max)):
            d = pick(made.year, key=lambda x: x.secular)
            table.add_row(name, d.day, f"{1e6 * d.secular:.4g}")
        out.print(table)
    for line in made.notes:
        out.print(f"note: {line}", highlight=False, markup=False)


def _table(*columns: str) -> Table:
    table = Table(box=None, header_style="bold", pad_edge=False)
    for i, name in enumerate(columns):
        table.add_column(name, justify="right" if i else "left")
    return table


def _print_map(made: SizingMap) -> None:
    order = sorted(range(len(made.axes.rods)), key=lambda i: made.axes.rods[i])
    for k, law in enumerate(made.laws):
        out.print(f"{law}: the smallest rod (A m2) that holds with a duty of "
                  f"{100.0 * made.wishes.duty:g} % and a margin of {made.wishes.margin:g}",
                  highlight=False)  # fmt: skip
        table = _table("residual dipole, A m2", "altitude, km",
                       *(f"{i:g} deg" for i in made.axes.inclinations))  # fmt: skip
        for d, dipole in enumerate(made.axes.dipoles):
            for a, altitude in enumerate(made.axes.altitudes):
                cells = []
                for i in range(len(made.axes.inclinations)):
                    held = [j for j in order if made.holds[k, i, a, d, j]]
                    cells.append(f"{made.axes.rods[held[0]]:.3g}" if held else "-")
                table.add_row(f"{dipole:.3g}", f"{altitude / 1e3:g}", *cells)
        out.print(table)
        out.print()
    for line in made.notes:
        out.print(f"note: {line}", highlight=False, markup=False)
