"""The pages of a sizing and of its map, and their figures."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from ..figures.canvas import Figure, Ticks
from ..figures.style import COLOURS, DASHED, DOTTED, LIMIT, figure
from ..report.report import figures_of, render, write_page
from .dumps import DumpSizing
from .map import SizingMap
from .sizing import Flown, Sizing, duration, momenta

SHADES = ("#fdf3c0", "#f6d36b", "#7ecb8f", "#35a3a0", "#2a6fb0", "#33307e", "#1a1037")
"""Of the smallest to the largest rod of a map."""
NONE = "#c9c9c9"


def versions() -> str:
    """Date and versions that a page was made with."""
    return (
        f"{datetime.now(UTC).date().isoformat()}, desat {version('desat')}, numpy {np.__version__}"
    )


def write_sizing(made: Sizing, path: Path) -> Path:
    """The page of a sizing. Raises OSError where it cannot be written."""
    path.parent.mkdir(parents=True, exist_ok=True)
    return write_page(path, render(
        "sizing.html", made=made, rows=rows_of(made), versions=versions(),
        curve=[cells_of(r) for r in made.curve], inf=inf, **figures_of(drawn_of(made)),
    ))  # fmt: skip


def write_dumps(made: DumpSizing, path: Path) -> Path:
    """The page of a sizing of dumps. Raises OSError where it cannot be written."""
    drawn = [("A year: propellant, as if each day lasted", _dump_year(made))] if made.year else []
    path.parent.mkdir(parents=True, exist_ok=True)
    return write_page(path, render("sizing_dumps.html", made=made, rows=dump_rows(made),
                                   versions=versions(), **figures_of(drawn)))  # fmt: skip


def dump_rows(made: DumpSizing) -> list[tuple[str, str, str]]:
    """What dumps come to: name, as sized, in the closed loop."""
    loop, steady = made.loop, made.steady
    first, taken, spent = (loop.get(x) for x in ("first_dump", "dump_momentum", "dump_propellant"))

    def shown(name: str) -> str:
        value = loop.get(name)
        return "" if value is None else f"{value:.4g}"

    return [
        ("first dump, from wheels at rest", duration(steady.first),
         "" if first is None else duration(first)),
        ("dumps a week", f"{steady.a_week:.4g}", shown("dumps_a_week")),
        ("the same, thresholds 1 % apart", f"{steady.least_a_week:.4g} to "
         f"{steady.most_a_week:.4g}", ""),
        ("momentum of a dump", momenta(steady.momentum), "" if taken is None else momenta(taken)),
        ("propellant of a dump, g", f"{1e3 * steady.propellant:.4g}",
         "" if spent is None else f"{1e3 * spent:.4g}"),
        ("propellant a year as in this time, kg", f"{steady.a_year:.4g}",
         shown("propellant_a_year")),
        ("propellant a year, mean over its days, kg", f"{made.a_year:.4g}", ""),
        *((f"the same with {name} solar activity, kg", f"{x:.4g}", "")
          for name, x in made.by_activity.items()),
        ("the same, each dump at its cheapest attitude, kg", f"{made.least_a_year:.4g}", ""),
        ("momentum of a day", momenta(made.a_day), ""),
        ("largest pointing error, deg", "", shown("pointing_largest")),
        ("wheels that dump once a week", momenta(made.weekly, made.capacity), ""),
        *([("slew: momentum of the fullest wheel", momenta(made.slew_momentum, made.capacity), ""),
           ("slew: torque of it, N m", f"{made.slew_torque:.4g} of {made.wheel_torque:.4g}", "")]
          if made.slew_momentum > 0.0 else []),
    ]  # fmt: skip


def write_map(made: SizingMap, path: Path) -> Path:
    """The page of a map. Raises OSError where it cannot be written."""
    drawn = [(f"{law}: the smallest rod that holds with a duty of "
              f"{100.0 * made.wishes.duty:g} % and a margin of {made.wishes.margin:g}",
              heat_map(made, k)) for k, law in enumerate(made.laws)]  # fmt: skip
    path.parent.mkdir(parents=True, exist_ok=True)
    return write_page(path, render("sizing_map.html", made=made, versions=versions(),
                                   **figures_of(drawn)))  # fmt: skip


def rows_of(made: Sizing) -> list[tuple[str, str, str]]:
    """What drives it and what follows: name, value, unit."""
    size = float(np.linalg.norm(made.secular))
    rows = [
        ("Secular torque", f"{1e6 * size:.4g}", "µN m"),
        ("Secular momentum of an orbit", f"{1e3 * made.per_orbit:.4g}", "mN m s"),
        ("Cyclic momentum, largest about its middle", f"{1e3 * made.cyclic:.4g}", "mN m s"),
        ("Fullest wheel, beside what is dumped", f"{1e3 * made.wheel_needed:.4g}", "mN m s"),
        ("Time without dumping until a wheel is full", duration(made.time_without), ""),
        ("Least rod, |s| / mean Σ |(a × B) · n|", f"{made.least_formula:.4g}", "A m²"),
        ("Least rod for any law, linear programme", f"{made.least:.4g}", "A m²"),
        ("Longest time in which 1.3 times that cannot undo s", duration(made.blind), ""),
        ("Rods along the direction where they do least, over the mean", f"{made.weakness:.3f}", ""),
        ("That direction, eci", ", ".join(f"{x:.2f}" for x in made.weakest), ""),
        ("Rate after separation", f"{np.degrees(made.tip_off_rate):.4g}", "deg/s"),
        ("Momentum after separation", f"{1e3 * made.tip_off:.4g}", "mN m s"),
        ("Detumbling, least time by its rods at their limits", duration(made.detumbling), ""),
        ("First dump of it from the wheels, least time", duration(made.first_dump), ""),
    ]  # fmt: skip
    if made.least_year > 0.0:
        rows.insert(7, (f"The same on the worst day of the year ({made.worst_day})",
                        f"{made.least_year:.4g}", "A m²"))  # fmt: skip
    if made.detumbling_recommended is not None and made.first_dump_recommended is not None:
        rows += [
            (f"Detumbling with {made.recommended:.3g} A m²", duration(made.detumbling_recommended),
             ""),
            ("First dump with these", duration(made.first_dump_recommended), ""),
        ]  # fmt: skip
    if made.start_momentum > 0.0:
        rows += [("Wheels at the start", f"{1e3 * made.start_momentum:.4g}", "mN m s"),
                 ("Dump of that, least time", duration(made.start_dump), "")]  # fmt: skip
    if made.slew_momentum > 0.0:
        rows += [
            ("Slew, momentum of the fullest wheel, 2 I θ / T", f"{1e3 * made.slew_momentum:.4g}",
             "mN m s"),
            ("Slew, torque of it, 4 I θ / T²", f"{1e3 * made.slew_torque:.4g}", "mN m"),
        ]  # fmt: skip
    if made.propellant is not None and made.propellant_least is not None:
        rows += [
            ("Propellant a year by thrusters alone, dumps as a wheel is full",
             _grams(made.propellant), "g"),
            ("The same, each dump where it costs least", _grams(made.propellant_least), "g"),
        ]  # fmt: skip
    return rows


def _grams(mass: float) -> str:
    """A mass (kg) in grams."""
    return "no layout gives it" if mass == inf else f"{1e3 * mass:.4g}"


def cells_of(row: Flown) -> list[str]:
    """The cells of a row of a curve."""

    def beside(model: float | None, loop: float | None) -> str:
        if loop is None:
            return ""
        off = "" if model is None else f" ({100.0 * (model / loop - 1.0):+.1f} %)"
        return f"{1e3 * loop:.4g}{off}"

    def cell(value: float | None, factor: float) -> str:
        return "" if value is None else f"{factor * value:.4g}"

    return [
        row.law, f"{row.rod:.4g}", f"{row.multiple:.3g}", cell(row.rms, 1e3),
        cell(row.largest, 1e3), cell(row.filled, 100.0), cell(row.duty, 100.0),
        beside(row.rms, row.loop_rms), beside(row.largest, row.loop_largest),
        cell(row.loop_duty, 100.0),
    ]  # fmt: skip


# --- figures ------------------------------------------------------------------------------------


def drawn_of(made: Sizing) -> list[tuple[str, Figure]]:
    """Caption and figure of a sizing."""
    figures = []
    if any(r.duty is not None for r in made.curve):
        figures.append(
            (
                "Duty of the coils over their size: lines the model, circles the closed loop",
                _curve(made, "duty", "loop_duty", 100.0, "duty [%]"),
            )
        )
        figures.append(
            (
                "Momentum of the wheels, rms, over the size of the coils",
                _curve(made, "rms", "loop_rms", 1e3, "momentum, rms [mN m s]"),
            )
        )
        if any(r.filled is not None for r in made.curve):
            figures.append(
                (
                    "The fullest wheel in the second half of the run, share of its capacity",
                    _curve(made, "filled", "", 100.0, "of capacity [%]"),
                )
            )
    if made.sources:
        figures.append(
            ("What drives it: momentum of an orbit and cyclic momentum by source", _sources(made))
        )
    if made.year:
        figures.append(("The least rod over a year", _year(made)))
    return figures  # fmt: skip


def _curve(made: Sizing, key: str, loop: str, factor: float, label: str) -> Figure:
    fig, ax = figure()
    laws = list(dict.fromkeys(r.law for r in made.curve))
    shape = [r.rod for r in made.curve if r.rod != made.rod]
    low, high = min(shape), max(shape)
    for i, law in enumerate(laws):
        rows = sorted((r for r in made.curve if r.law == law and r.rod <= 3.0 * high),
                      key=lambda r: r.rod)  # fmt: skip
        colour = COLOURS[i % len(COLOURS)]
        known = [r for r in rows if getattr(r, key) is not None]
        if known:
            ax.plot([r.rod for r in known], [factor * getattr(r, key) for r in known], colour,
                    width=1.5, label=law)  # fmt: skip
        closed = [r for r in rows if loop and getattr(r, loop) is not None]
        if closed:
            ax.plot([r.rod for r in closed], [factor * getattr(r, loop) for r in closed], colour,
                    width=0.0, marker=6.0, hollow=True, label=f"{law}, closed loop")  # fmt: skip
    ax.upright(made.least, LIMIT, width=1.2, dash=DASHED, label="least rod, any law")
    if made.recommended is not None:
        ax.upright(made.recommended, "#2e8b57", width=1.2, dash=DOTTED, label="recommended")
        high = max(high, made.recommended)
    if low <= made.rod <= 3.0 * high:
        ax.upright(made.rod, "#444444", width=1.2, dash=DOTTED, label="what it has")
    ax.x.log, ax.x.label, ax.y.label = True, "coil [A m²]", label
    ax.y.log = key == "rms"
    if key != "rms":
        ax.y.low = 0.0
    return fig


def _sources(made: Sizing) -> Figure:
    fig, ax = figure(2.4)
    names = [s.name for s in made.sources]
    at = np.arange(len(names), dtype=float)
    for k, (label, key) in enumerate((("secular, an orbit", "per_orbit"), ("cyclic", "cyclic"))):
        heights = [1e3 * getattr(s, key) for s in made.sources]
        ax.bars(at - 0.38 + 0.38 * k, at + 0.38 * k, heights, COLOURS[k], label=label)
    ax.x.ticks = Ticks(tuple(at.tolist()), tuple(names))
    ax.y.low, ax.y.label = 0.0, "momentum\n[mN m s]"
    return fig


def _year(made: Sizing) -> Figure:
    fig, ax = figure(2.4)
    for i, activity in enumerate(dict.fromkeys(d.activity for d in made.year)):
        rows = [d for d in made.year if d.activity == activity]
        label = f"{activity} solar activity" if activity else "least rod"
        ax.plot([28.0 * k for k in range(len(rows))], [d.least for d in rows], COLOURS[i],
                width=1.5, marker=4.0, label=label)  # fmt: skip
    if made.rod <= 3.0 * max(d.least for d in made.year):
        ax.level(made.rod, "#444444", width=1.2, dash=DOTTED, label="what it has")
    ax.x.label, ax.y.label, ax.y.low = f"days since {made.year[0].day}", "least rod\n[A m²]", 0.0
    return fig


def _dump_year(made: DumpSizing) -> Figure:
    fig, ax = figure(2.4)
    for i, activity in enumerate(dict.fromkeys(d.activity for d in made.year)):
        rows = [x for d, x in zip(made.year, made.each_year, strict=True) if d.activity == activity]
        label = f"{activity} solar activity" if activity else "propellant a year"
        ax.plot([28.0 * k for k in range(len(rows))], rows, COLOURS[i], width=1.5, marker=4.0,
                label=label)  # fmt: skip
    ax.level(made.a_year, "#444444", width=1.2, dash=DOTTED, label="mean")
    ax.x.label, ax.y.label, ax.y.low = (
        f"days since {made.year[0].day}",
        "propellant\n[kg a year]",
        0.0,
    )
    return fig


def heat_map(made: SizingMap, law: int) -> Figure:
    """For each residual dipole a panel of altitude over inclination, each cell the smallest rod of
    the map that holds."""
    axes = made.axes
    order = np.argsort(axes.rods)
    holds = made.holds[law][..., order]
    rods = [axes.rods[i] for i in order]
    count = len(axes.dipoles)
    rows = -(-count // 2)
    fig = Figure(7.2, 0.15 + 2.2 * rows)
    for k, dipole in enumerate(axes.dipoles):
        row, column = divmod(k, 2)
        tall = 2.2 / fig.height
        ax = fig.add(0.3 / fig.height + row * tall, 1.0 - (row + 1) * tall + 0.25 / fig.height,
                     0.095 + 0.37 * column, 1.0 - (0.365 + 0.37 * column))  # fmt: skip
        ax.title, ax.size = f"residual dipole {dipole:.3g} A m²", 80
        ax.x.label, ax.y.label = "inclination [deg]", "altitude [km]" if column == 0 else ""
        _cells(ax, holds[:, :, k], rods, legend=k == min(1, count - 1))
        ax.x.ticks = _ticks(axes.inclinations)
        ax.y.ticks = _ticks([a / 1e3 for a in axes.altitudes])
        ax.x.low, ax.x.high, ax.y.low, ax.y.high = 0.0, len(axes.inclinations), 0.0, len(
            axes.altitudes)  # fmt: skip
        ax.x.margin = ax.y.margin = 0.0
    return fig


def _cells(ax: Any, holds: Any, rods: Sequence[float], legend: bool) -> None:
    """A colour for each rod, over the cells of which it is the smallest that holds."""
    smallest = np.where(holds.any(axis=2), holds.argmax(axis=2), len(rods))
    shades = [SHADES[round(i * (len(SHADES) - 1) / max(1, len(rods) - 1))]
              for i in range(len(rods))]  # fmt: skip
    for i, colour in enumerate([*shades, NONE]):
        label = f"{rods[i]:.3g} A m²" if i < len(rods) else "none of them"
        label = label if legend else ""
        cells = np.argwhere(smallest == i)
        if not len(cells):
            if label:
                ax.area([-9.0, -8.0], -9.0, -8.0, colour, label=label)
            continue
        for column, row in cells:
            ax.area([column, column + 1.0], row, row + 1.0, colour, label=label)
            label = ""


def _ticks(values: Sequence[float]) -> Ticks:
    return Ticks(tuple(i + 0.5 for i in range(len(values))), tuple(f"{v:g}" for v in values))
