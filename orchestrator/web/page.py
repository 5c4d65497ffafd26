"""Write one HTML file that flies a loop in WebAssembly as its sliders move.

The content of the page is that of the scenario (`desat export web`): its plots, its
numbers by the project's measures (`script.py`), those of momentum management, and the
parameters that follow from others by the scenario's expressions (`values.py`).
"""

from __future__ import annotations

import base64
import os
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from ..analyses import firings, health, management
from ..export.loop_fmu import LoopEnds, LoopSource, written_out
from ..figures.craft import DIRECTIONS
from ..figures.plots import elements_of
from ..figures.style import COLOURS, DASHES, LIMIT, time_axis
from ..files import io
from ..files.scenario import Scenario
from ..language.content import Content, content_of
from ..language.scenario import Number, Plot
from ..numbers import derived
from ..numbers.derived import QUANTITIES, coil_impulse
from ..numbers.limits import parameter_of
from ..numbers.measures import MEASURES, OWN_UNIT
from ..numbers.numbers import scale
from ..numbers.text import spell_unit
from ..report.cases import CraftCases, find_cases
from ..report.policy import part
from ..report.report import data_element, render
from ..report.scene import body_of, sources_of
from ..report.table import SCALES
from ..runs import substep_choice
from ..runs.drawings import craft_of_system
from ..runs.prepare import prepare, read
from ..runs.stopping import condition as condition_of
from ..sizing.dumps import applies
from ..system.craft import carrier
from ..system.errors import DesatError
from ..system.expression import Table, factor, product
from ..system.interface import KINDS
from ..system.model import System
from ..system.options import Options, as_arguments, sets_of
from ..system.parameters import unit_of
from ..system.typed import JsonObject
from ..system.wheels import axes_of, existing, smallest_capacity
from . import module
from .dump_model import DUMP_PARAMETERS, dumps_of, measured_of
from .script import numpy_source, script
from .sliders import Slider, asked_of, parts_of, refused, usual, usual_of
from .values import Expression, expression, follows, names_of, numbers_of, reached

# bytes: maximum size of a flight's series in the page's memory
MOST_BYTES = 800_000_000
_MANAGEMENT: tuple[Callable[..., Any], ...] = (
    management.of_momentum,
    management.of_coils,
    management.margin,
    management.of_wheels,
    management.momentum_at_start,
    management.unmanaged,
    management.effect,
    management.off_target,
    management.fired_impulse,
    coil_impulse,
    carrier,
)
# the lines of a run after its flight
_CHECKS: tuple[Callable[..., Any], ...] = (
    health.describe_full_wheels,
    health.describe_dead_sensor,
    health.describe_rare_sensor,
    health.describe_lost_attitude,
    health.describe_missed_attitude,
    management.largest_late_error,
    management.describe_lost,
    management.describe_braking,
    management.describe_effect,
    firings.describe_silence,
    firings.describe_firings,
)


@dataclass(frozen=True)
class _LawSystem:
    """A law with its system, the parameters that follow from others, and all values."""

    name: str
    options: Options  # options of a run with the law
    system: System
    ordered: list[JsonObject]
    values: JsonObject
    warnings: Sequence[str]  # of a run before its flight

    @property
    def content(self) -> Content:
        """Return the content of the scenario."""
        return content_of(self.system.about)

    @property
    def known(self) -> Table:
        """Return the parameters of the system."""
        return self.system.parameters


@dataclass(frozen=True)
class WrittenPage:
    """A page that was written."""

    path: Path
    digest: str
    sliders: tuple[str, ...]
    notes: tuple[str, ...]  # omitted items with the reason, a line each


def check_request(sliders: Sequence[str], file: Path | None) -> None:
    """Check the request of a page before its laws fly.

    Raises
    ------
    DesatError
        If the file cannot be written, the compiler is missing, or a slider has another
        form than `NAME=FROM:TO` or is given twice.
    """
    if file is not None:
        io.place_of(file, "--out")
    module.need_compiler()
    names = [parts_of(text)[0].strip() for text in sliders]
    for name in names:
        if names.count(name) > 1:
            raise DesatError(f"--slider {name}: it is given twice; give it one range")


def export(
    target: str,
    laws: Mapping[str, Options],
    sliders: Sequence[str],
    file: Path | None,
    author: str = "",
) -> WrittenPage:
    """Write the page of a target.

    Parameters
    ----------
    target
        Scenario of the page.
    laws
        Options of a run with each law, by name; the page opens with the first.
    sliders
        `NAME=FROM:TO` each; empty: the usual ones.
    file
        Path of the page; default: NAME.html.
    author
        Who made it, for the page; "": not named.

    Returns
    -------
    WrittenPage
        Path, digest, sliders and notes of the page.

    Raises
    ------
    DesatError
        If a component has no C, a slider is not of the scenario, nothing compiles to
        WebAssembly, or a flight would not fit into a page's memory.
    """
    check_request(sliders, file)
    source = read(target)
    law_systems = [
        _prepare_law(target, source, name, options) for name, options in laws.items()
    ]
    notes = list[str]()
    moved = _sliders(source, law_systems, sliders, notes)
    series = [sorted(_series(f)) for f in law_systems]
    loops = [
        _loop(f, {t for s in parameters for t in s.targets}, of)
        for f, parameters, of in zip(law_systems, moved, series, strict=True)
    ]
    code, data = _page_data(target, law_systems, moved, loops, notes)
    sources = module.sources(loops)
    data["digest"] = module.digest(sources)
    data["wasm"] = base64.b64encode(module.compiled(sources)).decode()
    path = file or Path(f"{Path(target).absolute().name.removesuffix('.toml')}.html")
    cases = find_cases(path.parent, [law_systems[0].known])
    io.replace_text(path, _page(data, code, author, cases))
    return WrittenPage(
        path,
        data["digest"],
        tuple(dict.fromkeys(s.name for of in moved for s in of)),
        tuple(notes),
    )


def _prepare_law(
    target: str, source: Scenario, name: str, options: Options
) -> _LawSystem:
    """Prepare a law of a target and choose its substeps.

    Raises DesatError if the case has problems.
    """
    case = prepare(source, options)
    system, _ = case.or_raise()
    choice = substep_choice.choose(target, system, options)
    if choice is not None:
        system = replace(system, substeps=choice.substeps)
        options = replace(options, substeps=choice.substeps, accuracy=None)
    ordered = follows(system)
    values = dict(numbers_of(system))
    return _LawSystem(name, options, system, ordered, values, case.warnings)


def _sliders(
    source: Scenario,
    law_systems: Sequence[_LawSystem],
    requests: Sequence[str],
    notes: list[str],
) -> list[list[Slider]]:
    """Return the sliders of each law: the requested or the usual ones.

    Raises DesatError for a requested one that is impossible.
    """
    if not requests:
        usual_sliders = [usual(f.system) for f in law_systems]
    else:
        rows = [_requested_sliders(text, law_systems, notes) for text in requests]
        usual_sliders = [
            [row[i] for row in rows if i in row] for i in range(len(law_systems))
        ]
    return [
        [s for s in of if _is_possible(s, source, f, notes)]
        for f, of in zip(law_systems, usual_sliders, strict=True)
    ]


def _is_possible(
    slider: Slider, source: Scenario, law: _LawSystem, notes: list[str]
) -> bool:
    """Return whether a page can move a slider of a law; the reason becomes a note.

    Raises DesatError for a requested slider.
    """
    reason = refused(slider, source, law.options, law.system, law.ordered)
    if reason and slider.is_requested:
        raise DesatError(f"--slider {slider.name}: {reason}")
    if reason and (note := f"no slider {slider.name}: {reason}") not in notes:
        notes.append(note)
    return not reason


def _requested_sliders(
    text: str, law_systems: Sequence[_LawSystem], notes: list[str]
) -> dict[int, Slider]:
    """Return the slider of `NAME=FROM:TO` for each law that has it, by the law's index.

    The range is that of the first law whose own value lies in it, else of the first
    that accepts it. A law whose own value lies elsewhere gets the range that is usual
    for it. Raises DesatError where no law accepts it, as for the first of them.
    """
    sliders: dict[int, Slider] = {}
    errors: list[DesatError] = []
    for i, f in enumerate(law_systems):
        try:
            sliders[i] = asked_of(text, f.system)
        except DesatError as error:
            errors.append(error)
    if not sliders:
        raise errors[0]
    home = next((i for i, s in sliders.items() if s.holds_start), min(sliders))
    name = sliders[home].name
    of_home = {home: sliders[home]}
    if not sliders[home].holds_start:
        notes.append(
            f"slider {name}: the scenario's own value, {sliders[home].start:g} "
            f"{sliders[home].unit}".rstrip()
            + ", lies outside its range"
        )
    for i, f in enumerate(law_systems):
        if i == home:
            continue
        if i in sliders and _is_alike(sliders[i], sliders[home]):
            of_home[i] = sliders[i]
        elif name.partition(".")[0] in f.system.components and (
            other := _usual_there(name, f.system)
        ):
            of_home[i] = other
            notes.append(
                f"slider {name}: its range is of {law_systems[home].name}; under {f.name}, which "
                f"has {other.start:g} {other.unit}".rstrip()
                + f", it is {other.low:g} to {other.high:g}"
            )
    return of_home


def _is_alike(slider: Slider, home: Slider) -> bool:
    """Return whether the range of one law's slider serves for that of another."""
    is_near = slider.holds_start or slider.start == home.start
    return is_near and slider.unit == home.unit


def _usual_there(name: str, system: System) -> Slider | None:
    """Return the slider of a parameter with its usual range, or None."""
    try:
        return usual_of(name, system)
    except DesatError:
        return None


# --- loops ----------------------------------------------------------------------------


def _loop(law: _LawSystem, targets: set[str], series: Sequence[str]) -> LoopSource:
    """Translate the loop of a law with these series and the parameters sliders reach.

    Raises DesatError for a component without C, or too many steps.
    """
    system = law.system
    parameters = [n for n in sorted(reached(targets, law.ordered)) if n in law.values]
    size = sum(len(system.components[c].interface.arrays[v]) for c, v in _split(series))
    if 8 * size * system.steps > MOST_BYTES:
        raise DesatError(
            f"{system.name}: {system.steps} steps are too many for a page's memory; "
            f"at most {MOST_BYTES // (8 * size)}: --stop"
        )
    ends = LoopEnds([*map(_pattern, series)], parameters=[*map(_pattern, parameters)])
    try:
        return written_out(system, ends)
    except DesatError as error:
        raise DesatError(str(error).partition("; `--without")[0]) from error


def _pattern(name: str) -> str:
    """Escape brackets in a name, for `LoopEnds`."""
    return name.replace("[", "[[]")


def _split(names: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Split names into component and variable."""
    return (tuple(name.split(".", 1)) for name in names)  # type: ignore[misc]


def _there(system: System) -> set[str]:
    """Return the names of all series of a system."""
    return {
        f"{c.name}.{s.array}"
        for c in system.components.values()
        for s in c.interface.outputs
        if s.kind in KINDS and not s.alone
    }


def _series(law: _LawSystem) -> set[str]:
    """Return the series that plots and numbers need."""
    content, there = law.content, _there(law.system)
    entries: list[Number | Plot] = [*content.numbers.values(), *content.plots.values()]
    series_needed = {s for e in entries for s in derived.compared_signals(e, there)}
    if parts := management.applies(law.system):
        series_needed |= {*management.signals(parts), *management.balanced(parts)}
        if parts.wheels:
            series_needed.add(f"{parts.wheels}.h_wheel")
    if ends := content.stop_when:
        series_needed.add(ends.signal)
    if applies(law.system) and (momenta := measured_of(law.system)):
        series_needed.add(momenta)
    series_needed |= {*_check_series(_checks(law.system))}
    series_needed |= {*_view_sources(law.system).values()}
    return series_needed & there


# --- what the page is told ------------------------------------------------------------


def _page_data(
    target: str,
    law_systems: Sequence[_LawSystem],
    sliders: Sequence[Sequence[Slider]],
    loops: Sequence[LoopSource],
    notes: list[str],
) -> tuple[str, JsonObject]:
    """Return the JavaScript of the measures, and all other data of the page."""
    first = law_systems[0].system
    used = {
        n.measure for f in law_systems for n in f.content.numbers.values() if n.signals
    }
    used_derived = {
        x.derive
        for f in law_systems
        for of in (f.content.numbers, f.content.plots)
        for x in of.values()
        if x.derive
    }
    code, lacking = script(
        [
            *(MEASURES[m] for m in sorted(used)),
            *_MANAGEMENT,
            *_CHECKS,
            *(QUANTITIES[d].function for d in sorted(used_derived)),
        ]
    )
    assert not lacking.keys() & {f.__name__ for f in (*_MANAGEMENT, *_CHECKS)}, lacking
    laws = [
        _law(f, of, loop, lacking, notes)
        for f, of, loop in zip(law_systems, sliders, loops, strict=True)
    ]
    seconds, unit = time_axis(np.array([first.start, first.stop]))
    return code, {
        "title": law_systems[0].content.title or first.name,
        "description": law_systems[0].content.description,
        "source": law_systems[0].content.source,
        "target": target,
        "version": version("desat"),
        "step": first.step,
        "start": first.start,
        "steps": first.steps,
        "stop": first.stop,
        "seconds": seconds,
        "time_unit": unit,
        "substeps": first.parts,
        "colours": COLOURS,
        "dashes": [[1.5 * x for x in dash] for dash in DASHES],
        "limit": LIMIT,
        "scales": [
            {spell_unit(unit): of for unit, of in units.items()}
            for units in SCALES.values()
        ],
        "laws": laws,
        "ground": 6378137.0,
    }


def _law(
    law: _LawSystem,
    sliders: Sequence[Slider],
    loop: LoopSource,
    lacking: Mapping[str, str],
    notes: list[str],
) -> JsonObject:
    """Return the data of the page for a law."""
    numbers = [*_numbers(law, lacking, notes)]
    plots = [*_plots(law, lacking, notes)]
    managed = _managed(law)
    slots, series, width = _places(loop)
    expressions = [x for n in numbers for x in (n["whole"], *n["options"].values())]
    expressions += [x["value"] for p in plots for x in p["limits"]] + [
        f["of"] for f in law.ordered
    ]
    parameters = {
        name for of in expressions if isinstance(of, dict) for name in names_of(of)
    }
    targets = {t for s in sliders for t in s.targets}
    parameters |= {name for name, _ in slots} | targets
    parameters |= {f["name"] for f in law.ordered} | {
        v for n in numbers for v in n["own"].values()
    }
    parameters |= {*managed["values"]} if managed else set()
    dumps = dumps_of(law.system, targets) if managed else None
    parameters |= {dumps[k] for k in DUMP_PARAMETERS} if dumps else set()
    ends, view = _ends(law), _view(law.system)
    if ends and isinstance(ends["limit"], dict):
        parameters |= {*names_of(ends["limit"])}
    if view["axes"]:
        parameters.add(view["axes"])
    return {
        "name": law.name,
        "substeps": law.system.parts,
        "sets": sets_of(law.options),
        "arguments": as_arguments(replace(law.options, sets=[], values={})),
        "values": {k: law.values[k] for k in sorted(parameters) if k in law.values},
        "follows": [f for f in law.ordered if f["name"] in law.values],
        "slots": slots,
        "series": series,
        "width": width,
        "numbers": numbers,
        "plots": plots,
        "managed": managed,
        "dumps": dumps,
        "ends": ends,
        "view": view,
        "checks": _checks(law.system),
        "warnings": list(law.warnings),
        "sliders": [{**s.page_data(), "shown": spell_unit(s.unit)} for s in sliders],
        "usual": _usual_ranges(law.system, {name for name, _ in slots}),
    }


def _usual_ranges(system: System, names: set[str]) -> list[JsonObject]:
    """Return the parameters that have a usual range.

    `desat run` warns outside of it.
    """
    sliders = []
    for name in sorted(names):
        owner, _, array = name.partition(".")
        signals = system.components[owner].interface.arrays[array]
        if signals[0].usual is None:
            continue
        low, high = signals[0].usual
        unit = signals[0].unit_name
        sliders.append(
            {
                "name": name,
                "elements": [f"{owner}.{s.name}" for s in signals],
                "low": low,
                "high": high,
                "unit": "" if unit == "1" else unit,
            }
        )
    return sliders


def _places(loop: LoopSource) -> tuple[list[Any], JsonObject, int]:
    """Return where a loop's parameters and series are.

    These are the name and the index of the first element of each parameter among all
    variables; the place of each series in a row of outputs; and the length of that row.
    """
    slots, series = [], {}
    place, at = 1, 1  # `fault` comes first
    for v in loop.variables:
        count = len(v.elements)
        if v.causality == "parameter":
            slots.append((v.name, place))
        elif v.causality == "output":
            series[v.name] = {
                "at": at,
                "size": count,
                "interval": v.name in loop.interval,
            }
            at += count
        place += count
    return slots, series, at


def _numbers(
    law: _LawSystem, lacking: Mapping[str, str], notes: list[str]
) -> Iterator[JsonObject]:
    """Yield the scenario's numbers on the page, each as `engine.js` evaluates it."""
    there = _there(law.system)
    for name, number in law.content.numbers.items():
        missing = [s for s in number.signals if s not in there]
        reason = next(
            (lacking[x] for x in (number.measure, number.derive) if x in lacking), ""
        )
        if not number.signals:
            reason = f"it compares with {number.reference}"
        if missing:
            reason = f"{law.name} has no {missing[0]}"
        if reason:
            notes.append(f"no number {name}: {reason}")
        else:
            yield {
                "name": name,
                "title": number.title,
                "unit": spell_unit(number.unit),
                **_number(number, law),
                "required": _required(law.content, name),
            }


def _number(number: Number, law: _LawSystem) -> JsonObject:
    """Return how a number is computed from series."""
    signals = derived.compared_signals(number, _there(law.system))
    units = [_unit(law.system, s) for s in signals]
    entry = derived.of_entry(number)
    if entry is not None:
        units = [entry[0].unit or units[0]]
    kinds = [unit_of(u) for u in units]
    source = (
        OWN_UNIT[number.measure](kinds[0]) if number.measure in OWN_UNIT else kinds[0]
    )
    reference: float | Expression | None = number.percent_of  # type: ignore[assignment]
    if isinstance(reference, str):
        unit = product(reference, law.known)[1]
        reference = expression(reference, law.known, unit.factor / source.factor)
    same = not number.unit or (
        number.measure not in OWN_UNIT and unit_of(number.unit) == source
    )
    return {
        "signals": signals,
        "measure": number.measure,
        "derive": number.derive,
        **_derivation(number, law),
        "element": number.element,
        "window": number.window or None,
        "percent": reference is not None,
        "whole": reference,
        "scale": 1.0
        if same or reference is not None
        else factor(source, number.unit, number.measure),
        "options": {
            k: expression(x, law.known) if isinstance(x, str) and k != "kind" else x
            for k, x in number.options.items()
        },
    }


def _derivation(entry: Number | Plot, law: _LawSystem) -> JsonObject:
    """Return the options of a derived quantity and the parameters that it needs."""
    quantity = derived.of_entry(entry)
    if quantity is None:
        return {"how": {}, "own": {}}
    owner = entry.signals[0].partition(".")[0]
    return {
        "how": quantity[1],
        "own": {name: f"{owner}.{name}" for name in quantity[0].extra_series},
    }


def _required(content: Content, name: str) -> dict[str, float]:
    """Return the required limits of a number."""
    limits = dict[str, float]()
    for of in content.requirements.values():
        if of.number == name:
            limits |= {
                k: x for k in ("min", "max") if (x := getattr(of, k)) is not None
            }
    return limits


def _unit(system: System, series: str) -> str:
    """Return the unit of a series."""
    owner, _, name = series.partition(".")
    return system.components[owner].interface.arrays[name][0].unit_name or "1"


def _plots(
    law: _LawSystem, lacking: Mapping[str, str], notes: list[str]
) -> Iterator[JsonObject]:
    """Yield the scenario's plots on the page, each as `engine.js` draws it."""
    there = _there(law.system)
    for name, plot in law.content.plots.items():
        signals = [s for s in plot.signals if s in there]
        if (
            plot.derive in lacking
            or not signals
            or (plot.derive and signals != [*plot.signals])
        ):
            reason = lacking.get(plot.derive, f"{law.name} has not all of its series")
            notes.append(f"no plot {name}: {reason}")
            continue
        compared = derived.compared_signals(plot, there)
        yield _plot(name, plot, [s for s in compared if s in there], law)


def _plot(name: str, plot: Plot, signals: list[str], law: _LawSystem) -> JsonObject:
    """Return a plot: the names of its lines by series, and its limits.

    The name is empty for a line that is not shown.
    """
    entry = derived.of_entry(plot)
    units = [_unit(law.system, s) for s in signals]
    if entry is not None:
        quantity = entry[0]
        units = [quantity.unit or units[0]]
        lines = [[*plot.components] or [n or plot.title for n in quantity.names]]
    else:
        lines = [[_line(plot, s, n) for n in _elements(plot, s, law)] for s in signals]
    unit = plot.unit or units[0]
    return {
        "name": name,
        "title": plot.title,
        "signals": signals,
        "derive": plot.derive,
        **_derivation(plot, law),
        "norm": plot.norm,
        "log": plot.log,
        "lines": lines,
        "label": f"{plot.axis or plot.title} [{spell_unit(unit)}]".removesuffix(" []"),
        "scales": [scale(u, unit) for u in units],
        "limits": [*_limits(plot, law, unit)],
    }


def _elements(plot: Plot, signal: str, law: _LawSystem) -> Sequence[str]:
    """Return the names of a series' elements in a plot."""
    owner, _, name = signal.partition(".")
    count = len(law.system.components[owner].interface.arrays[name])
    if count == 1:
        return [plot.axis or plot.title]
    return plot.components or elements_of(signal, count)


def _line(plot: Plot, signal: str, name: str) -> str:
    """Return the name of a line, after that of its series where there are several."""
    prefix = "" if len(plot.signals) == 1 or not name else signal.partition(".")[2]
    return f"{prefix} {name}".strip()


def _limits(plot: Plot, law: _LawSystem, unit: str) -> Iterator[JsonObject]:
    """Yield the limit lines of a plot."""
    for limit in plot.limits:
        value: float | Expression | str = limit.value
        name = "limit"
        if any(parameter_of(law.known, k) == x for k, x in limit.unless.items()):
            continue
        if isinstance(value, str):
            name = value.partition("[")[0]
            limit_unit = product(value, law.known)[1]
            value = expression(value, law.known, factor(limit_unit, unit, name))
        yield {"name": limit.name or name, "value": value, "filled": limit.fill}


def _ends(law: _LawSystem) -> JsonObject | None:
    """Return the condition that ends a flight (`stop_when`); None without one."""
    condition, stop_when = condition_of(law.system), law.content.stop_when
    if condition is None or stop_when is None:
        return None
    limit: float | Expression = condition.limit
    side = stop_when.below if condition.kind == "below" else stop_when.above
    if isinstance(side, str):
        unit = _unit(law.system, stop_when.signal)
        of = product(side, law.known)[1]
        limit = expression(side, law.known, factor(of, unit, f'of "{side}"'))
    return {
        "series": stop_when.signal,
        "kind": condition.kind,
        "limit": limit,
        "held": condition.held,
        "text": condition.text,
    }


def _view_sources(system: System) -> dict[str, str]:
    """Return the series of the view of orbit and attitude, by its names for them."""
    sources = sources_of({role: c.name for role, c in system.roles.items()})
    there = _there(system)
    return {name: series for name, series in sources.items() if series in there}


def _view(system: System) -> JsonObject:
    """Return the series, the wheels' axes and the craft of the view."""
    owner = system.roles.get("wheels") or system.roles.get("spacecraft")
    axes = f"{owner.name}.axes_wheel" if owner else ""
    if owner is None or "axes_wheel" not in owner.values:
        axes = ""
    return {
        "series": _view_sources(system),
        "axes": axes,
        "colours": DIRECTIONS,
        "body": body_of(system.roles["spacecraft"].values)
        if "spacecraft" in system.roles
        else None,
        "craft": [p.to_json() for p in craft_of_system(system)],
    }


def _checks(system: System) -> JsonObject:
    """Return the series and components of the lines of a run after its flight."""
    there = _there(system)
    parts, managed = health.applies(system), management.applies(system)
    checks: JsonObject = {
        "sensors": [],
        "wheels": None,
        "attitude": None,
        "law": None,
        "firings": _firings(system),
    }
    if parts is not None:
        checks["sensors"] = [_sensor(system, n) for n in parts.sensors]
        checks["wheels"] = parts.wheels
        checks["attitude"] = parts.attitude and (
            parts.attitude[0],
            derived.wanted_attitude(parts.attitude[1], there),
        )
    if managed is not None:
        reference = derived.wanted_attitude(str(managed.reference), there)
        late = (f"{managed.spacecraft}.q_bi", reference)
        checks["law"] = {
            "name": managed.manager,
            "rate": f"{managed.spacecraft}.omega_bi_body" if managed.brakes else None,
            "late": late if managed.holds and there.issuperset(late) else None,
            "holds": managed.holds,
            "deadband": managed.deadband,
        }
    return checks


def _firings(system: System) -> JsonObject | None:
    """Return the series and the tank of the lines on firings, None without any."""
    parts = firings.applies(system)
    if parts is None or not _there(system).issuperset(firings.series_of(parts)):
        return None
    spent = f"{parts.thrusters}.propellant"
    return {
        "name": parts.thrusters,
        "series": firings.series_of(parts),
        "tank": system.components[parts.thrusters].values.get("tank", 0.0),
        "spent": spent if spent in _there(system) else None,
        "scheduled": parts.scheduled,
    }


def _sensor(system: System, name: str) -> JsonObject:
    """Return the series of a sensor that say whether and why it is not valid."""
    signals = system.components[name].interface.signals
    has_reason = "lost_to" in signals
    return {
        "name": name,
        "valid": f"{name}.valid",
        "lost_to": f"{name}.lost_to" if has_reason else None,
        "meaning": signals["lost_to"].description if has_reason else "",
    }


def _check_series(checks: JsonObject) -> Iterator[str]:
    """Yield the series that `_checks` names."""
    for sensor in checks["sensors"]:
        yield from (sensor[k] for k in ("valid", "lost_to") if sensor[k])
    if checks["wheels"]:
        yield f"{checks['wheels']}.saturated_wheel"
    yield from checks["attitude"] or ()
    law = checks["law"] or {}
    yield from law.get("late") or ()
    if law.get("rate"):
        yield law["rate"]
    if fired := checks["firings"]:
        yield from fired["series"]
        yield from (s for s in [fired["spent"]] if s)


def _managed(law: _LawSystem) -> JsonObject | None:
    """Return the data of the management numbers and of the curve without management.

    None where they do not apply.
    """
    parts, system = management.applies(law.system), law.system
    if parts is None or parts.wheels is None or parts.target is None:
        return None
    if not management.balanced(parts):
        return None
    body, wheels, torquers = parts.spacecraft, parts.wheels, parts.torquers
    series = {
        "h": f"{wheels}.h_wheel",
        "q": f"{body}.q_bi",
        "omega": f"{body}.omega_bi_body",
        "copy": f"{body}.h_copy_wheel",
        "impulse": f"{body}.impulse_eci",
        "saturated": f"{wheels}.saturated_wheel",
        "speed": f"{wheels}.speed_wheel",
    }
    if torquers and parts.field:
        series |= {"dipole": f"{torquers}.m_mean_body", "field": parts.field}
    if parts.thrusters:
        series["fired"] = f"{parts.thrusters}.tau_mean_thruster_body"
    values = system.components[body].values
    if "inertia" not in values or not {*series.values()} <= _there(system):
        return None
    axes, there = axes_of(values), np.flatnonzero(existing(values))
    capacity = smallest_capacity(system.components[wheels].values)
    unit = "mN.m.s" if capacity < 1.0 else "N.m.s"
    names = {
        "inertia": f"{body}.inertia",
        "axes": f"{body}.axes_wheel",
        "spin": f"{body}.inertia_wheel",
        "rotors": f"{wheels}.inertia_wheel",
        "limit": f"{wheels}.speed_limit",
    }
    return {
        "series": series,
        "drawn": parts.holds or not parts.brakes,
        "there": there.tolist(),
        "target": list(parts.target),
        "inverse": np.linalg.pinv(axes[:, there]).tolist(),
        "of": names,
        "shares": [*management.required_shares(law.content, wheels)],
        "coils": _coils(system, torquers) if torquers else None,
        "values": [*names.values(), *([f"{torquers}.m_limit"] if torquers else [])],
        "label": f"fullest wheel [{spell_unit(unit)}]",
        "scale": scale("N.m.s", unit),
        "names": {
            "momentum": management.OF_MOMENTUM,
            "coils": management.OF_COILS,
            "wheels": management.OF_WHEELS,
            "balance": management.OF_BALANCE,
        },
        "titles": {k: (t, spell_unit(u)) for k, (t, u) in management.TITLES.items()},
        "required": {
            k: r for k in management.TITLES if (r := _required(law.content, k))
        },
    }


def _coils(system: System, torquers: str) -> JsonObject | None:
    """Return the data of the coils' duty, or None where they have no limit."""
    component = system.components[torquers]
    values = dict(component.values)
    if "drive" in values:
        values["drive"] = component.choice("drive")
    if (most := management.most_of_coils(values)) is None:
        return None
    axes = np.reshape(values["axes_coil"], (3, -1))
    return {
        "most": [f"{torquers}.m_limit", most / values["m_limit"]],
        "inverse": np.linalg.pinv(axes[:, np.linalg.norm(axes, axis=0) > 0.0]).tolist(),
        "period": management.rows_a_period(values, system.step),
    }


# --- the page -------------------------------------------------------------------------


def _asset(name: str) -> str:
    """Read a file of this package."""
    return (files(__package__) / name).read_text(encoding="utf-8")


def _page(
    content: JsonObject, code: str, author: str, cases: Sequence[CraftCases]
) -> str:
    """Return the HTML of the page; `author` made it, today or on SOURCE_DATE_EPOCH."""
    seconds = os.environ.get("SOURCE_DATE_EPOCH")
    now = datetime.fromtimestamp(float(seconds), UTC) if seconds else datetime.now(UTC)
    date = f"{now:%Y-%m-%d}"
    worker = "\n".join([numpy_source(), code, _asset("engine.js"), _asset("worker.js")])
    return render(
        "web.html",
        title=content["title"],
        cases=cases,
        told=content,
        made_by=author,
        made_on=date,
        command=f"desat run {shlex.quote(content['target'])}",
        uplot_css=part("uplot/uPlot.min.css"),
        uplot_licence=part("uplot/LICENSE"),
        notices=_asset("notices.txt"),
        worker=Markup(worker.replace("</", "<\\/")),
        data=data_element(content),
    )
