"""What a scenario means, beyond its words: measures and their options; and, of a system that it
describes, series, units, limits and dispersions. A line for each thing that is not there."""

from __future__ import annotations

import inspect
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from math import inf
from pathlib import Path
from typing import Any

from ..analyses import analyses
from ..files.builder import Part as BuiltPart
from ..language.content import Content
from ..language.paper import OfNumber
from ..language.scenario import Dispersion, Number, Plot
from ..numbers import derived
from ..numbers.measures import MEASURES, OWN_UNIT, SCALARS, SIZES
from ..numbers.numbers import problems, scale
from ..system.errors import DesatError, nearest
from ..system.interface import KINDS, Signal, base_name, selects
from ..system.model import Component, System
from ..system.options import Options
from ..system.parameters import expand, table
from ..system.quantity import is_float
from . import stopping

Keys = tuple[str, ...]
Part = BuiltPart | Component


def options_of(measure: str) -> tuple[list[str], dict[str, Any]]:
    """The series that a measure takes after the times, and its options with their defaults (or
    `inspect.Parameter.empty`)."""
    given = list(inspect.signature(MEASURES[measure]).parameters.values())[1:]
    series = [p.name for p in given if p.annotation == "Array"]
    return series, {p.name: p.default for p in given if p.name not in series}


def content_problems(
    content: Content, components: Mapping[str, Part], system: System | None = None
) -> Iterator[tuple[Keys, str]]:
    """What is wrong with what a scenario says, keys and text: by itself; if it is right, held
    against components, of which some interfaces may be missing; and if it fits them, against the
    system that they make."""
    lines = list(word_problems(content))
    if not lines:
        lines = [*_series_problems(content, components), *dispersion_problems(content, components)]
    if not lines and system is not None:
        lines = [*_analysis_problems(content, system), *stopping.problems(system)]
        lines += number_problems(content, system)
    yield from lines


def word_problems(content: Content) -> Iterator[tuple[Keys, str]]:
    """Measures, options and derived quantities that there are not; no system is needed."""
    yield from _plain_problems(content)
    yield from requirement_problems(content)
    yield from _row_problems(content)


def _plain_problems(content: Content) -> Iterator[tuple[Keys, str]]:
    for name, number in content.numbers.items():
        problems = _measure_problems(number) if number.signals else ()
        yield from ((("numbers", name, *path), text) for path, text in problems)
        if number.of:
            yield from _unknown(content, number.of, ("numbers", name, "of"))
        yield from ((("numbers", name, key), text) for key, text in _derive_problems(number))
    for name, plot in content.plots.items():
        yield from ((("plots", name, key), text) for key, text in _derive_problems(plot))
        if derived.takes_parameters(plot.derive):
            yield ("plots", name, "derive"), f"{plot.derive} is of numbers only"


def _unknown(content: Content, name: str, path: Keys) -> Iterator[tuple[Keys, str]]:
    """A line where no number of a name is computed of a run."""
    if name in content.numbers:
        return
    known = {*content.numbers, *(n for a in analyses() for n in a.NUMBERS)}
    if name not in known:
        yield path, f"no number {name}{nearest(name, known)}"


def _measure_problems(number: Number) -> Iterator[tuple[Keys, str]]:
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


def _row_problems(content: Content) -> Iterator[tuple[Keys, str]]:
    """Rows of a paper's table whose number nobody computes."""
    for row, entry in content.judged.items():
        named = [("number" if entry.number else "quantity", entry.of)]
        if isinstance(entry.tolerance, OfNumber):
            named.append(("tolerance", entry.tolerance.of))
        for key, number in named:
            yield from _unknown(content, number, ("paper", row, key))


def _analysis_problems(content: Content, system: System) -> Iterator[tuple[Keys, str]]:
    """Rows whose number is of an analysis that does not apply to the system."""
    for row, entry in content.judged.items():
        if entry.of not in content.numbers and not any(
            entry.of in a.NUMBERS and a.applies(system) for a in analyses()
        ):  # fmt: skip
            yield ("paper", row), f"no number {entry.of} of this system"


def _derive_problems(entry: Number | Plot) -> Iterator[tuple[str, str]]:
    """What is wrong with what a number or plot derives: key and text."""
    try:
        quantity = derived.of_entry(entry)
    except DesatError as error:
        yield "derive", str(error)
        return
    if entry.sequence and entry.derive not in ("euler", "euler_lvlh"):
        yield "sequence", 'only with derive = "euler" or "euler_lvlh"'
    if quantity is not None:
        yield from _element_problems(entry, len(quantity[0].names), entry.derive)


def _element_problems(
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


def number_problems(content: Content, system: System) -> list[tuple[Keys, str]]:
    """What is wrong with the numbers that a scenario wants of a resolved system."""
    units = {
        f"{c.name}.{s.series}": s.unit_name
        for c in system.components.values() for s in c.interface.outputs
    }  # fmt: skip
    return problems(content, units, table(system.components.values()))


def fit_to(content: Content, system: System) -> tuple[Content, list[tuple[Keys, str]]]:
    """A scenario's content for a system in which other FMUs are: without the numbers, plots, limits
    and conditions that name what these lack; and what is left out, keys and text."""
    told = deepcopy(content.written)
    tables = {t: told.get(t, {}) for t in ("numbers", "plots", "requirements", "paper")}
    left: dict[Keys, str] = {}
    lines = [*_series_problems(content, system.components), *number_problems(content, system)]
    for path, text in lines:
        what, name, *key = path
        if name not in tables[what]:
            continue
        entry = tables[what][name]
        some = [
            x for x in entry.get("signals", []) if not _lacks(x, system.components, ("output",))
        ]
        if key == ["limits"]:
            entry["limits"] = [x for x in entry["limits"] if not _lacks(x, system.components)]
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
    for path, text in _analysis_problems(content, system):
        tables["paper"].pop(path[1], None)
        left[path] = f"{text}: left out"
    for path, text in stopping.problems(system):
        told.pop("stop_when", None)
        left[path] = f"{text}: left out, the run goes on to its stop time"
    return (Content.model_validate(told) if left else content), list(left.items())


def _lacks(
    written: Any, components: Mapping[str, Part], kinds: tuple[str, ...] = ("parameter", "input")
) -> bool:  # fmt: skip
    """Whether a limit or signal of a plot, as it is written, names a variable that is not there."""
    value = written.get("value") if isinstance(written, dict) else written
    names = _parameters_named(value)
    return any(isinstance(_elements(components, name, kinds), str) for name in names)


def _parameters_named(value: Any) -> list[str]:
    """The parameters that a limit names."""
    factors = re.split(r"[*/]", value) if isinstance(value, str) else ()
    return [base_name(x.strip()) for x in factors if not is_float(x)]


def _elements(
    components: Mapping[str, Part], name: str, causalities: tuple[str, ...]
) -> Sequence[Signal] | str:
    """The elements of `component.variable`, or what is wrong with the name; none where the
    component's FMU is missing, which is said elsewhere."""
    owner, _, variable = name.partition(".")
    component = components.get(owner)
    if component is None:
        return f"no component {owner}{nearest(owner, components)}"
    if component.interface is None:
        return ()
    elements = component.interface.elements.get(variable, ())
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


def _series_problems(
    content: Content, components: Mapping[str, Part]
) -> Iterator[tuple[Keys, str]]:  # fmt: skip
    entries: list[tuple[Keys, str, Number | Plot]] = [
        *((("numbers", name), "signal", number) for name, number in content.numbers.items()),
        *((("plots", name), "signals", plot) for name, plot in content.plots.items()),
    ]
    for path, key, entry in entries:
        ends = [_elements(components, signal, ("output",)) for signal in entry.signals]
        yield from (((*path, key), problem) for problem in ends if isinstance(problem, str))
        known = [e for e in ends if not isinstance(e, str) and e]
        first = isinstance(entry, Number) or entry.derive
        for what, text in _entry_problems(entry, known[:1] if first else known):
            yield (*path, what), text
    for name, plot in content.plots.items():
        for limit in plot.limits:
            for parameter in _parameters_named(limit.value):
                problem = _elements(components, parameter, ("parameter", "input"))
                if isinstance(problem, str):
                    yield ("plots", name, "limits"), problem


def _entry_problems(
    entry: Number | Plot, signals: Sequence[Sequence[Signal]]
) -> Iterator[tuple[str, str]]:  # fmt: skip
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
            yield from _element_problems(entry, len(elements))


def dispersion_problems(
    content: Content, components: Mapping[str, Part]
) -> Iterator[tuple[Keys, str]]:  # fmt: skip
    """Dispersions that do not fit the components."""
    for key, spec in content.dispersions.items():
        path = ("dispersions", key)
        owner, _, variable = key.partition(".")
        owners = [owner]
        if owner == "*":
            owners = [n for n, c in components.items()
                      if c.interface and variable in c.interface.arrays]  # fmt: skip
            if not owners and all(c.interface for c in components.values()):
                yield path, f"no component has a parameter {variable}"
        for name in owners:
            elements = _elements(components, f"{name}.{variable}", ("parameter", "input"))
            if isinstance(elements, str):
                yield path, elements
            elif elements and (text := _misfit(components[name], variable, elements, spec)):
                yield path, text


def _misfit(part: Part, variable: str, elements: Sequence[Signal], spec: Dispersion) -> str:
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
    assert part.interface is not None
    for value in given:
        try:
            expand(part.interface, variable, value, part.name)
        except DesatError as error:
            return f"one_of: {error}"
    return ""


# --- [requirements.NAME]: what a campaign's cases are held against, as far as it is to be had ---


def requirement_problems(content: Content) -> Iterator[tuple[Keys, str]]:
    """Requirements of a number that nobody computes, or that nothing can meet."""
    for name, entry in content.requirements.items():
        path, number = ("requirements", name), entry.number
        yield from _unknown(content, number, (*path, "number"))
        if number in content.numbers and content.numbers[number].of:
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
