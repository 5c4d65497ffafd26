"""Bind each entry of a scenario to the system that it describes, or refuse it.

Numbers, plots, requirements, rows of a paper, dispersions and the stop condition have
one function each that binds them. `check` reports what it raises.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from functools import partial
from math import ceil, inf
from pathlib import Path
from typing import Any

from ..analyses import analyses
from ..engine.recording.results import Results
from ..engine.recording.shared_tables import MANY
from ..language.content import Content, PaperEntry
from ..language.paper import OfNumber
from ..language.scenario import Dispersion, LimitLine, Number, Plot, Requirement
from ..numbers import derived
from ..numbers.limits import limits_of
from ..numbers.numbers import SeriesUnit, bind, check_words, scale
from ..system.errors import DesatError, MisfitError, nearest
from ..system.expression import Table
from ..system.interface import KINDS, MISSING, Signal, find_elements, selects
from ..system.model import Component, System
from ..system.options import Options
from ..system.parameters import expand
from . import stopping

Keys = tuple[str, ...]
Components = Mapping[str, Component]
Check = Callable[[], object]


def content_problems(
    content: Content, components: Components | None, system: System | None = None
) -> Iterator[tuple[Keys, str]]:
    """Yield keys and text of each entry of a scenario that cannot be bound.

    Parameters
    ----------
    components
        Components that the entries are bound to, some perhaps MISSING their FMU; None:
        the words alone are checked.
    system
        System of these components, if they make one: values of parameters and analyses
        are then known.
    """
    for path, check in _checks(content, components, system):
        try:
            check()
        except MisfitError as error:
            yield (*path, *error.keys), str(error)
        except DesatError as error:
            yield path, str(error)


def _checks(
    content: Content, components: Components | None, system: System | None
) -> Iterator[tuple[Keys, Check]]:
    """Yield the keys of each entry, and the function that binds it."""
    parameters = None if system is None else system.parameters
    for key in ("title", "description"):
        yield (key,), partial(check_axes, getattr(content, key), content)
    for name, number in content.numbers.items():
        yield (
            ("numbers", name),
            partial(bind_number, content, number, components, parameters),
        )
    for name, plot in content.plots.items():
        yield ("plots", name), partial(bind_plot, plot, components, parameters)
    for name, requirement in content.requirements.items():
        yield ("requirements", name), partial(bind_requirement, content, requirement)
    for name, row in content.judged.items():
        yield ("paper", name), partial(bind_row, content, row, system)
    if components is not None:
        for name, dispersion in content.dispersions.items():
            yield (
                ("dispersions", name),
                partial(bind_dispersion, name, dispersion, components),
            )
    if system is not None:
        yield (), partial(stopping.condition, system)


def check_axes(text: str, content: Content) -> None:
    """Check that no `{axis}` of a text is left over.

    Raises
    ------
    MisfitError
        If the scenario has no axis of that name.
    """
    for name in re.findall(r"\{(\w+)\}", text):
        hint = nearest(name, content.cell) or "; it has none"
        raise MisfitError(f"{{{name}}}: no axis {name}{hint}")


def bind_number(
    content: Content,
    number: Number,
    components: Components | None,
    parameters: Table | None,
) -> None:
    """Bind a number to components; raise MisfitError where it does not fit."""
    if number.of:
        _require_number(content, number.of, "of")
    if not number.signals:
        derived.of_entry(number)
    elif components is None:
        check_words(number)
    else:
        bind(number, partial(_series, components), parameters)


def bind_plot(
    plot: Plot, components: Components | None, parameters: Table | None
) -> None:
    """Bind a plot to components: its signals, unit and limits.

    Raises
    ------
    MisfitError
        For the first of them that does not fit.
    """
    quantity, _ = derived.of_entry(plot) or (None, {})
    if quantity and quantity.extra_series:
        raise MisfitError(f"{plot.derive} is of numbers only", "derive")
    if components is None:
        return
    try:
        signals = [_series(components, name) for name in plot.signals]
    except DesatError as error:
        raise MisfitError(str(error), "signals") from error
    units = [signal for signal in signals if signal is not None]
    if quantity:
        units = [
            SeriesUnit(quantity.unit or x.unit, len(quantity.names)) for x in units[:1]
        ]
    for unit, count in units:
        _check_lines(plot, unit, count)
    if units and parameters is not None:
        try:
            limits_of(plot.limits, parameters, plot.unit or units[0].unit)
        except DesatError as error:
            raise MisfitError(str(error), "limits") from error


def _check_lines(plot: Plot, unit: str, count: int) -> None:
    """Raise MisfitError where names or unit of a plot do not fit a series."""
    if len(plot.components) > count:
        text = f"{len(plot.components)} names for {count} elements"
        raise MisfitError(text, "components")
    if plot.unit:
        try:
            scale(unit, plot.unit)
        except DesatError as error:
            raise MisfitError(str(error), "unit") from error


def bind_requirement(content: Content, entry: Requirement) -> None:
    """Bind a requirement to a number of a run.

    Raises
    ------
    MisfitError
        If nothing computes the number, it compares runs, or no value can be within.
    """
    _require_number(content, entry.number, "number")
    number = content.numbers.get(entry.number)
    if number is not None and number.of:
        raise MisfitError(
            f"{entry.number} compares runs: a case has no such number", "number"
        )
    if entry.min is not None and entry.max is not None and entry.min > entry.max:
        raise MisfitError("it is above max: nothing can be within", "min")


def bind_row(content: Content, row: PaperEntry, system: System | None) -> None:
    """Bind a row of a paper's table to numbers of a run.

    Raises
    ------
    MisfitError
        If nothing computes them, or only an analysis that does not apply to the system.
    """
    _require_number(content, row.of, "number" if row.number else "quantity")
    if isinstance(row.tolerance, OfNumber):
        _require_number(content, row.tolerance.of, "tolerance")
    if system is None or row.of in content.numbers:
        return
    if not any(row.of in a.NUMBERS and a.applies(system) for a in analyses()):
        raise MisfitError(f"no number {row.of} of this system")


def bind_dispersion(key: str, spec: Dispersion, components: Components) -> None:
    """Bind a dispersion to the parameters that it draws.

    Raises
    ------
    MisfitError
        If there are none, or they cannot have the drawn values.
    """
    owner, _, variable = key.partition(".")
    owners = [owner]
    if owner == "*":
        owners = [
            name
            for name, component in components.items()
            if variable in component.interface.arrays
        ]
        if not owners and all(c.interface is not MISSING for c in components.values()):
            raise MisfitError(f"no component has a parameter {variable}")
    for name in owners:
        elements = find_elements(components, f"{name}.{variable}", "parameter", "input")
        if elements:
            _check_dispersion(components[name], variable, elements, spec)


def _check_dispersion(
    component: Component, variable: str, elements: Sequence[Signal], spec: Dispersion
) -> None:
    """Raise MisfitError if a parameter cannot have the values of a dispersion."""
    kind, count = spec.kind, len(elements)
    values = getattr(spec, kind)
    counts_needed = {
        "signs": len(values) if kind == "signs" else 0,
        "attitude": 4,
        "seed": 1,
    }
    if count != counts_needed.get(kind, count):
        raise MisfitError(
            f"{kind}: {variable} has {count} elements, not {counts_needed[kind]}"
        )
    if kind == "direction" and count < 2:
        raise MisfitError(f"direction: {variable} has one element; a vector is needed")
    if kind != "one_of":
        type_ = "Integer" if kind == "seed" else "Real"
        if elements[0].kind != type_:
            raise MisfitError(
                f"{kind}: {variable} is of type {elements[0].kind}, not {type_}"
            )
        return
    for value in values:
        try:
            expand(component.interface, variable, value, component.name)
        except DesatError as error:
            raise MisfitError(f"one_of: {error}") from error


def _require_number(content: Content, name: str, key: str) -> None:
    """Raise MisfitError if a run computes no number of this name."""
    if name in content.numbers:
        return
    number_names = {*content.numbers, *(n for a in analyses() for n in a.NUMBERS)}
    if name not in number_names:
        raise MisfitError(f"no number {name}{nearest(name, number_names)}", key)


def _series(components: Components, name: str) -> SeriesUnit | None:
    """Return unit and elements of `component.output`; None where the FMU is missing."""
    elements = find_elements(components, name, "output")
    return SeriesUnit(elements[0].unit_name, len(elements)) if elements else None


# --- A scenario whose system has other FMUs in place of its own -----------------------

_LEFT_OUT = {
    "requirements": "left out, not checked",
    "stop_when": "left out, the run goes on to its stop time",
}


def fit_to(content: Content, system: System) -> tuple[Content, list[tuple[Keys, str]]]:
    """Remove those entries of a scenario's content that do not bind to a system.

    The system has other FMUs than the scenario describes.

    Returns
    -------
    tuple
        The content, and keys and text of each entry that is left out.
    """
    data, left_out = deepcopy(content.written), list[tuple[Keys, str]]()
    while problems := list(
        content_problems(content, system.components, replace(system, about=content))
    ):
        for path, text in problems:
            _leave_out(data, path, content, system)
            left_out.append((path, f"{text}: {_LEFT_OUT.get(path[0], 'left out')}"))
        content = Content.model_validate(data)
    return content, left_out


def _leave_out(
    data: dict[str, Any], path: Keys, content: Content, system: System
) -> None:
    """Remove an entry from a scenario's data.

    Of a plot with several signals, only the first one that the system lacks is removed,
    and of its limits the first one that does not bind.
    """
    kind, *names = path
    if not names:
        data.pop(kind, None)
        return
    entries = data.get(kind, {})
    entry = entries.get(names[0], {})
    part = names[1] if len(names) > 1 else ""
    items = list(entry.get(part, ())) if part in ("limits", "signals") else []
    lacking: list[bool] = []
    if part == "limits":
        plot = content.plots[names[0]]
        lacking = [_is_unbound(plot, line, system) for line in plot.limits]
    elif part == "signals" and "derive" not in entry and len(items) > 1:
        lacking = [_lacks_series(system, name) for name in items]
    if True not in lacking:
        entries.pop(names[0], None)
        return
    del items[lacking.index(True)]
    entry[part] = items


def _lacks_series(system: System, name: str) -> bool:
    """Return whether a system has no output `component.variable`."""
    try:
        return not find_elements(system.components, name, "output")
    except DesatError:
        return True


def _is_unbound(plot: Plot, limit: LimitLine, system: System) -> bool:
    """Return whether a plot with this limit alone does not bind."""
    alone = plot.model_copy(update={"limits": (limit,)})
    try:
        bind_plot(alone, system.components, system.parameters)
    except DesatError:
        return True
    return False


# --- Recording and saving, checked before a run ---------------------------------------


LONG, KEPT_ROWS = 1_000_000, 100_000  # steps of a run that is shortened, and to what
LARGE = 1_000_000_000  # bytes on disk above which a run says what it takes
_BYTES = {"Real": 8, "Integer": 4, "Boolean": 4}


def recording_problems(system: System, options: Options) -> Iterator[str]:
    """Yield a line for each problem with the recorded outputs.

    These are patterns without an output, and an `every` beyond the steps of the run.
    """
    outputs = [
        (c.name, s) for c in system.components.values() for s in c.interface.outputs
    ]
    for pattern in options.record:
        if pattern != "*" and not any(
            selects([pattern], name, signal) for name, signal in outputs
        ):
            series_names = {f"{name}.{s.series}" for name, s in outputs}
            yield f"--record {pattern}: no output fits{nearest(pattern, series_names)}"
    if options.every > system.steps:
        yield f"--every {options.every}: the run has {system.steps} steps"


def not_saved(system: System, options: Options) -> Iterator[str]:
    """Yield a line for each component without saved state, if checkpoints are used."""
    if options.checkpoint is None:
        return
    if not 0.0 < options.checkpoint < inf:
        yield f"--checkpoint {options.checkpoint:g}: a time above 0 s is needed"
    for wire in system.connections:
        source = system.components[wire.source].interface.signals[wire.output]
        if source.kind == "String":
            yield f"--checkpoint: {wire}: a text is no part of a checkpoint"
    for c in system.components.values():
        if c.fmu is None:
            continue
        of = c.fmu.description.coSimulation
        if not (of.canGetAndSetFMUstate and of.canSerializeFMUstate):
            yield (
                f"--checkpoint: {c.name}: {c.fmu.path.name} cannot save its state "
                "(canGetAndSetFMUstate, canSerializeFMUstate)"
            )


def not_halved(system: System, options: Options) -> Iterator[str]:
    """Yield a line for each foreign FMU that cannot halve its steps, with `--halve`."""
    foreign = [c for c in system.components.values() if c.fmu and not c.interface.role]
    if options.halvings and not foreign:
        yield "--halve: it has no effect without a foreign FMU"
    for c in foreign if options.halvings else ():
        assert c.fmu is not None
        of = c.fmu.description.coSimulation
        if not (of.canGetAndSetFMUstate and of.canHandleVariableCommunicationStepSize):
            yield (
                f"--halve: {c.name}: {c.fmu.path.name} cannot step anew with another length "
                "(canGetAndSetFMUstate, canHandleVariableCommunicationStepSize)"
            )


def _outputs_of(system: System, options: Options) -> list[tuple[str, Signal]]:
    """Return the outputs that a run records, with the names of their components."""
    return [
        (c.name, s)
        for c in system.components.values()
        for s in c.interface.outputs
        if s.kind in KINDS and selects(options.record, c.name, s)
    ]


def size(system: System, options: Options) -> int:
    """Compute the size (bytes) of the recorded series of a run, undecimated.

    The run lasts to its stop time.
    """
    row = 8 + sum(_BYTES[s.kind] for _, s in _outputs_of(system, options))
    return row * (system.steps + 1)


def kept_every(system: System, options: Options) -> int:
    """Return of how many rows of a run its file keeps one.

    It is `every`, and of a run that may be shortened so many that `KEPT_ROWS` are left
    of more than `LONG`. Series that share tables are all kept.
    """
    is_long = options.shortens and system.steps > LONG
    if options.every > 1 or not is_long:
        return options.every
    series = {(name, s.series) for name, s in _outputs_of(system, options)}
    if len(series) > MANY:
        return options.every
    return ceil(system.steps / KEPT_ROWS)


def check_disk(system: System, options: Options, folder: Path) -> str:
    """Return a warning if the series may not fit on the disk of a folder, else ""."""
    while not folder.exists():
        folder = folder.parent
    bytes_needed, disk = size(system, options), shutil.disk_usage(folder)
    if (
        bytes_needed < (free := disk.free) or not disk.total
    ):  # a total of 0: not a real disk
        return ""
    return (
        f"the series may take {bytes_needed / 1e9:.3g} GB, {free / 1e9:.3g} GB are free in {folder}: "
        "record less (--record)"
    )


def describe_size(system: System, options: Options) -> list[str]:
    """Return a line with the room that a run takes on disk, where it is above 1 GB."""
    if (bytes_needed := size(system, options)) < LARGE:
        return []
    line = f"{system.steps} steps take up to {bytes_needed / 1e9:.2g} GB on disk"
    if kept_every(system, options) > options.every:
        line += " while they are flown"
    return [line]


def describe_kept(results: Results) -> str:
    """Return which rows the file of a run has; "" if it has all."""
    if results.every == 1:
        return ""
    if not any(results.extremes(name) for name in results.names()[:1]):
        return f" (one row of {results.every}; numbers are of all rows)"
    return (
        f" (one row of {results.every}, with minimum, maximum and mean between; numbers "
        "are of all rows, and --every 1 keeps them)"
    )
