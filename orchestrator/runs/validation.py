"""What a scenario means, beyond its words: measures and their options; and, of a system that it
describes, series, units, limits and dispersions. A line for each thing that is not there."""

from __future__ import annotations

import inspect
import re
import shutil
from collections.abc import Iterator, Sequence
from copy import deepcopy
from math import inf
from pathlib import Path
from typing import Any

from ..analyses import analyses
from ..engine.recording.results import selects
from ..files.scenario import Scenario
from ..language.content import Content
from ..language.paper import OfNumber
from ..language.scenario import Dispersion, Number, Plot
from ..numbers import derived
from ..numbers.measures import MEASURES, OWN_UNIT, SCALARS, SIZES
from ..numbers.numbers import problems, scale
from ..system.draft import Draft
from ..system.errors import DesatError, nearest
from ..system.interface import KINDS, Signal, base_name
from ..system.model import System
from ..system.options import Options
from ..system.parameters import expand, table
from . import stopping

Keys = tuple[str, ...]


def options_of(measure: str) -> tuple[list[str], dict[str, Any]]:
    """The series that a measure takes after the times, and its options with their defaults (or
    `inspect.Parameter.empty`)."""
    given = list(inspect.signature(MEASURES[measure]).parameters.values())[1:]
    series = [p.name for p in given if p.annotation == "Array"]
    return series, {p.name: p.default for p in given if p.name not in series}


def words(scenario: Scenario) -> list[str]:
    """Measures, options and derived quantities that there are not; no system is needed."""
    content = scenario.content
    problems = [*_words(content), *unmeetable(content), *_rows(content)]
    return [f"{scenario.where(path)}: {text}" for path, text in problems]


def _words(content: Content) -> Iterator[tuple[Keys, str]]:
    known = _numbers(content)
    for name, number in content.numbers.items():
        problems = _measured(number) if number.signals else ()
        yield from ((("numbers", name, *path), text) for path, text in problems)
        if number.of and number.of not in known:
            yield ("numbers", name, "of"), f"no number {number.of}{nearest(number.of, known)}"
        yield from ((("numbers", name, key), text) for key, text in _derived(number))
    for name, plot in content.plots.items():
        yield from ((("plots", name, key), text) for key, text in _derived(plot))
        if derived.takes_parameters(plot.derive):
            yield ("plots", name, "derive"), f"{plot.derive} is of numbers only"


def _numbers(content: Content) -> set[str]:
    """The numbers that a run may have."""
    return {*content.numbers, *(n for a in analyses() for n in a.NUMBERS)}


def _measured(number: Number) -> Iterator[tuple[Keys, str]]:
    """What is wrong with the measure of a number, its series and options."""
    measure, given = number.measure, number.options
    if measure not in MEASURES:
        yield ("measure",), f"no measure {measure}{nearest(measure, MEASURES)}"
        return
    series, options = options_of(measure)
    count = 1 if number.derive else len(number.signals)
    if number.element and len(series) > 1:
        yield ("element",), f"{measure} takes {len(series)} series; only with one"
    if count != len(series):
        yield ("signal",), f"{count} given; {measure} takes {len(series)}"
    kinds = inspect.get_annotations(MEASURES[measure])
    for option, value in given.items():
        path = ("options", option)
        if option not in options:
            yield (
                path,
                f"{measure} has no option {option}{nearest(option, options) or '; it has none'}",
            )
        elif wanted := _unfit(option, kinds[option], value):
            yield path, f"got {value!r}; {wanted} is needed"
    if given.keys() <= options.keys():  # else what is missing may be misspelt
        for option, default in options.items():
            if default is inspect.Parameter.empty and option not in given:
                yield ("options",), f"{measure} needs {option}"


def _rows(content: Content) -> Iterator[tuple[Keys, str]]:
    """Rows of a paper's table whose number nobody computes."""
    known = _numbers(content)
    for row, entry in content.judged.items():
        named = [("number" if entry.number else "quantity", entry.of)]
        if isinstance(entry.tolerance, OfNumber):
            named.append(("tolerance", entry.tolerance.of))
        for key, number in named:
            if number not in known:
                yield ("paper", row, key), f"no number {number}{nearest(number, known)}"


def _analysed(content: Content, system: System) -> Iterator[tuple[Keys, str]]:
    """Rows whose number is of an analysis that does not apply to the system."""
    for row, entry in content.judged.items():
        of = [a for a in analyses() if entry.of in a.NUMBERS]
        if entry.of not in content.numbers and not any(a.applies(system) for a in of):
            yield ("paper", row), f"no number {entry.of} of this system"


def _derived(entry: Number | Plot) -> Iterator[tuple[str, str]]:
    """What is wrong with what a number or plot derives: key and text."""
    try:
        quantity = derived.of_entry(entry)
    except DesatError as error:
        yield "derive", str(error)
        return
    if entry.sequence and entry.derive not in ("euler", "euler_lvlh"):
        yield "sequence", 'only with derive = "euler" or "euler_lvlh"'
    if quantity is not None:
        yield from _counted(entry, len(quantity[0].names), entry.derive)


def _counted(
    entry: Number | Plot, count: int, what: str = "the signal"
) -> Iterator[tuple[str, str]]:
    """Where more elements are named, or a further one is meant, than there are."""
    if isinstance(entry, Number):
        if (entry.element or 0) > count:
            yield "element", f"got {entry.element}; {what} has {count}"
    elif len(entry.components) > count:
        yield "components", f"{len(entry.components)} names for {count} elements"


def _unfit(option: str, annotation: str, value: Any) -> str:
    """What an option of a measure needs, where the value is not that. A text may stand for a
    number: it names parameters."""
    if option == "kind":
        return "" if value in SIZES else " or ".join(SIZES)
    if annotation.startswith("list"):
        good = isinstance(value, list) and all(type(x) in (int, float) for x in value)
        return "" if good else "a list of numbers"
    if annotation == "int":
        return "" if type(value) is int else "a whole number"
    return "" if type(value) in (int, float, str) else "a number"


def names(scenario: Scenario, system: Draft) -> list[str]:
    """Series, units, limits and dispersions that do not fit the system, interfaces loaded."""
    problems = [
        f"{scenario.where(path)}: {text}" for path, text in _series(scenario.content, system)
    ]
    return problems + dispersions(scenario, system)


def dispersions(scenario: Scenario, system: Draft) -> list[str]:
    """Dispersions that do not fit the system, interfaces loaded."""
    problems = _dispersions(scenario.content, system)
    return [f"{scenario.where(path)}: {text}" for path, text in problems]


def wants(scenario: Scenario, system: System) -> list[str]:
    """What a scenario wants of a resolved system that is not to be had: numbers of an analysis that
    does not apply to it, and a condition that it cannot meet."""
    problems = list(_analysed(scenario.content, system))
    for line in stopping.problems(system):
        path, _, text = line.partition(": ")
        problems.append((tuple(path.split(".")), text))
    return [f"{scenario.where(path)}: {text}" for path, text in problems]


def numbers(content: Content, system: System) -> list[tuple[Keys, str]]:
    """What is wrong with the numbers that a scenario wants of a resolved system."""
    units = {
        f"{c.name}.{s.series}": s.unit_name
        for c in system.components.values() for s in c.interface.outputs
    }  # fmt: skip
    return problems(content, units, table(system.components.values()))


def fitted(content: Content, system: System) -> tuple[Content, list[tuple[Keys, str]]]:
    """A scenario's content for a system in which other FMUs are: without the numbers, plots, limits
    and conditions that name what these lack; and what is left out, keys and text."""
    told = deepcopy(content.written)
    tables = {t: told.get(t, {}) for t in ("numbers", "plots", "requirements", "paper")}
    left: dict[Keys, str] = {}
    for path, text in [*_series(content, system), *numbers(content, system)]:
        what, name, *key = path
        if name not in tables[what]:
            continue
        entry = tables[what][name]
        some = [x for x in entry.get("signals", []) if not _lacks(x, system, ("output",))]
        if key == ["limits"]:
            entry["limits"] = [x for x in entry["limits"] if not _lacks(x, system)]
        elif key == ["signals"] and some and "derive" not in entry:
            entry["signals"] = some
        else:
            del tables[what][name]
        left[path] = f"{text}: left out"
    gone = set(content.numbers) - tables["numbers"].keys()
    while more := {n for n, x in tables["numbers"].items() if x.get("of") in gone}:
        for name in more:
            del tables["numbers"][name]
            left["numbers", name] = f"of {content.numbers[name].of}: left out"
        gone |= more
    for name, entry in content.requirements.items():
        if entry.number in gone:
            del tables["requirements"][name]
            left["requirements", name] = f"of {entry.number}: left out, not checked"
    for path, text in _analysed(content, system):
        tables["paper"].pop(path[1], None)
        left[path] = f"{text}: left out"
    for line in stopping.problems(system):
        told.pop("stop_when", None)
        path_text, _, text = line.partition(": ")
        left[tuple(path_text.split("."))] = f"{text}: left out, the run goes on to its stop time"
    return (Content.model_validate(told) if left else content), list(left.items())


def _lacks(
    written: Any, system: System, kinds: tuple[str, ...] = ("parameter", "input")
) -> bool:  # fmt: skip
    """Whether a limit or signal of a plot, as it is written, names a variable that is not there."""
    value = written.get("value") if isinstance(written, dict) else written
    return any(isinstance(_elements(system, name, kinds), str) for name in _named(value))


def _named(value: Any) -> list[str]:
    """The parameters that a limit names."""
    factors = re.split(r"[*/]", value) if isinstance(value, str) else ()
    return [base_name(x.strip()) for x in factors if not _is_number(x)]


def _elements(
    system: Draft | System, name: str, causalities: tuple[str, ...]
) -> Sequence[Signal] | str:
    """The elements of `component.variable`, or what is wrong with the name; none where the
    component's FMU is missing, which is said elsewhere."""
    owner, _, variable = name.partition(".")
    component = system.components.get(owner)
    if component is None:
        return f"no component {owner}{nearest(owner, system.components)}"
    if component.interface is None:
        return ()
    elements = component.interface.elements(variable)
    if not elements or elements[0].causality not in causalities or (
        elements[0].causality == "output" and elements[0].series != variable
    ):  # fmt: skip
        known = {s.series for c in causalities for s in component.interface.of(c)}
        return f"{owner} has no {causalities[0]} {variable}{nearest(variable, known)}"
    return elements


def _unit(own: str, unit: str) -> str:
    """What is wrong with a unit in place of another."""
    try:
        scale(own, unit)
    except DesatError as error:
        return str(error)
    return ""


def _series(content: Content, system: Draft | System) -> Iterator[tuple[Keys, str]]:
    entries: list[tuple[Keys, str, Number | Plot]] = [
        *((("numbers", name), "signal", number) for name, number in content.numbers.items()),
        *((("plots", name), "signals", plot) for name, plot in content.plots.items()),
    ]
    for path, key, entry in entries:
        ends = [_elements(system, signal, ("output",)) for signal in entry.signals]
        yield from (((*path, key), problem) for problem in ends if isinstance(problem, str))
        known = [e for e in ends if not isinstance(e, str) and e]
        first = isinstance(entry, Number) or entry.derive
        for what, text in _entry(entry, known[:1] if first else known):
            yield (*path, what), text
    for name, plot in content.plots.items():
        for limit in plot.limits:
            for parameter in _named(limit.value):
                problem = _elements(system, parameter, ("parameter", "input"))
                if isinstance(problem, str):
                    yield ("plots", name, "limits"), problem


def _entry(entry: Number | Plot, signals: Sequence[Sequence[Signal]]) -> Iterator[tuple[str, str]]:
    """What of a number or plot does not fit the elements of its signals: key and text."""
    quantity, number = derived.of_entry(entry), entry if isinstance(entry, Number) else None
    own = number and (number.measure in OWN_UNIT or number.percent_of is not None)
    for elements in signals:
        unit = (quantity[0].unit if quantity else "") or elements[0].unit_name
        if not own and entry.unit and (text := _unit(unit, entry.unit)):
            yield "unit", text
        several = len(quantity[0].names if quantity else elements)
        if number and not number.element and several > 1 and number.measure in SCALARS:
            yield "element", f"{number.measure} takes one element; there are {several}"
        if not quantity:
            yield from _counted(entry, len(elements))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _dispersions(content: Content, system: Draft) -> Iterator[tuple[Keys, str]]:
    for key, spec in content.dispersions.items():
        path = ("dispersions", key)
        owner, _, variable = key.partition(".")
        owners = [owner]
        if owner == "*":
            owners = [n for n, c in system.components.items()
                      if c.interface and c.interface.elements(variable)]  # fmt: skip
            if not owners and all(c.interface for c in system.components.values()):
                yield path, f"no component has a parameter {variable}"
        for name in owners:
            elements = _elements(system, f"{name}.{variable}", ("parameter", "input"))
            if isinstance(elements, str):
                yield path, elements
            elif elements and (text := _misfit(system, name, variable, elements, spec)):
                yield path, text


def _misfit(
    system: Draft, owner: str, variable: str, elements: Sequence[Signal], spec: Dispersion
) -> str:
    kind = spec.kind
    given = getattr(spec, kind)
    wanted = {"signs": len(given) if kind == "signs" else 0, "attitude": 4, "seed": 1}
    if len(elements) != wanted.get(kind, len(elements)):
        return f"{kind}: {variable} has {len(elements)} elements, not {wanted[kind]}"
    if kind == "direction" and len(elements) < 2:
        return f"direction: {variable} is no vector"
    if kind != "one_of":
        type_ = "Integer" if kind == "seed" else "Real"
        other = elements[0].kind != type_
        return f"{kind}: {variable} is of type {elements[0].kind}, not {type_}" if other else ""
    interface = system.components[owner].interface
    assert interface is not None
    for value in given:
        try:
            expand(interface, variable, value, owner)
        except DesatError as error:
            return f"one_of: {error}"
    return ""


# --- [NAME]: what a campaign's cases are held against, as far as it is to be had ---


def unmeetable(content: Content) -> Iterator[tuple[Keys, str]]:
    """Requirements of a number that nobody computes, or that nothing can meet."""
    known = _numbers(content)
    for name, entry in content.requirements.items():
        path, number = ("requirements", name), entry.number
        if number not in known:
            yield (*path, "number"), f"no number {number}{nearest(number, known)}"
        elif number in content.numbers and content.numbers[number].of:
            yield (*path, "number"), f"{number} compares runs: a case has no such number"
        if entry.min is not None and entry.max is not None and entry.min > entry.max:
            yield (*path, "min"), "it is above max: nothing can be within"


# ------------------------------------------------------------------------------------------------
# What a run would record, before it begins: is there anything, is there room for it, and can the
# components be saved


_BYTES = {"Real": 8, "Integer": 4, "Boolean": 4}


def recording_problems(system: System, options: Options) -> Iterator[str]:
    """A line for each pattern that no output fits, and for rows too rare to be any."""
    outputs = [(c.name, s) for c in system.components.values() for s in c.interface.outputs]
    for pattern in options.record:
        if pattern != "*" and not any(selects([pattern], name, signal) for name, signal in outputs):
            known = {f"{name}.{s.series}" for name, s in outputs}
            yield f"--record {pattern}: no output fits{nearest(pattern, known)}"
    for name, signal in outputs:
        text = signal.series
        if not (text.isprintable() and text.strip(". ") and "/" not in text) and any(
            selects([pattern], name, signal) for pattern in options.record
        ):
            yield f"{system.where}: {name}: the output {text!r} has no name that can be recorded"
    if options.every > system.steps:
        yield f"--every {options.every}: the run has {system.steps} steps"


def not_saved(system: System, options: Options) -> Iterator[str]:
    """A line for each component whose state cannot be saved, where checkpoints are wanted."""
    if options.checkpoint is None:
        return
    if not 0.0 < options.checkpoint < inf:
        yield f"--checkpoint {options.checkpoint:g}: a time above 0 s is needed"
    for c in system.components.values():
        if c.fmu is None:
            continue
        of = c.fmu.description.coSimulation
        if not (of.canGetAndSetFMUstate and of.canSerializeFMUstate):
            yield (f"--checkpoint: {c.name}: {c.fmu.path.name} cannot save its state "
                   "(canGetAndSetFMUstate, canSerializeFMUstate)")  # fmt: skip


def not_halved(system: System, options: Options) -> Iterator[str]:
    """A line for each foreign FMU whose steps cannot be halved, where that is wanted."""
    foreign = [c for c in system.components.values() if c.fmu and not c.interface.role]
    if options.halvings and not foreign:
        yield "--halve: it has no effect without a foreign FMU"
    for c in foreign if options.halvings else ():
        assert c.fmu is not None
        of = c.fmu.description.coSimulation
        if not (of.canGetAndSetFMUstate and of.canHandleVariableCommunicationStepSize):
            yield (f"--halve: {c.name}: {c.fmu.path.name} cannot step anew with another length "
                   "(canGetAndSetFMUstate, canHandleVariableCommunicationStepSize)")  # fmt: skip


def size(system: System, options: Options) -> int:
    """What the series of a run to its stop time take (bytes) before any row is left out."""
    row = 8 + sum(
        _BYTES[s.kind]
        for c in system.components.values() for s in c.interface.outputs
        if s.kind in KINDS and selects(options.record, c.name, s)
    )  # fmt: skip
    return row * (system.steps + 1)


def room(system: System, options: Options, folder: Path) -> str:
    """What to say where the series may not fit on the disk of a folder; else nothing."""
    while not folder.exists():
        folder = folder.parent
    needed, disk = size(system, options), shutil.disk_usage(folder)
    if needed < (free := disk.free) or not disk.total:  # no size: no disk
        return ""
    return (f"the series may take {needed / 1e9:.3g} GB, {free / 1e9:.3g} GB are free in {folder}: "
            "record less (--record)")  # fmt: skip
