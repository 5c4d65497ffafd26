"""From a draft to a system: interfaces present, values expanded, units converted, times fit."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import islice

from desat.components.contract.block import Scalar
from desat.components.contract.units import conversion

from .draft import Draft, DraftComponent
from .errors import DesatError, nearest
from .expression import evaluate
from .interface import Interface, Signal, base_name
from .model import Component, Connection, System
from .parameters import expand, in_unit_of, known_unit

RESERVED = ("time", "shared")
"""What no component is called: the series of times, and parameters of all."""
MOST = 100
"""Lines about one kind of problem; more help nobody."""
LARGEST = 1e40  # SI; no quantity of a spacecraft is larger, and squares and cubes of it are numbers
MOST_STEPS = 1e12
"""Of a run: one of a microsecond each takes eleven days."""


@dataclass(frozen=True)
class Resolved:
    """What a draft comes to; `system` where nothing is wrong with it."""

    components: dict[str, Component]
    """Those whose interface is known."""
    problems: list[str]
    system: System | None


def resolve(draft: Draft) -> Resolved:
    """Resolve a draft; every problem is collected."""
    problems = [*draft.problems, *_names(draft)]
    components: dict[str, Component] = {}
    for c in draft.components.values():
        if c.interface is None:
            continue
        problems += islice(_connectors(draft, c, c.interface), MOST)
        parameters = _parameters(draft, c, c.interface, problems)
        components[c.name] = Component(
            c.name, c.source, c.interface, parameters, c.fmu, c.step_ratio, dict(c.connectors),
            c.line, dict(c.given),
        )  # fmt: skip
    references = {
        (name, parameter): text
        for name in components for parameter, text in draft.components[name].references.items()
    }  # fmt: skip
    components, wrong = evaluate(components, references, draft.where)
    problems += wrong
    problems += _too_large(draft, components.values())
    connections = _connections(draft, problems)
    problems = list(dict.fromkeys(problems))
    try:
        step, stop = _times(draft)
    except DesatError as error:
        return Resolved(components, [*problems, str(error)], None)
    if problems:
        return Resolved(components, problems, None)
    system = System(
        draft.name, draft.where, components, connections, step, stop, draft.start,
        draft.substeps, draft.accuracy, dict(draft.output_classes), draft.about,
        draft.body,
    )  # fmt: skip
    return Resolved(components, [], system)


def _names(draft: Draft) -> Iterator[str]:
    """Names of components that those of their variables, and of their series, cannot begin with."""
    for c in draft.components.values():
        bad = set("./[]*?=") & set(c.name) or not c.name.strip() or not c.name.isprintable()
        if bad or c.name in RESERVED:
            yield (f"{draft.where}:{c.line}: component {c.name!r}: a name is needed without . / [ "
                   f"] * ? = and other than {', '.join(RESERVED)}")  # fmt: skip


def _connectors(draft: Draft, c: DraftComponent, interface: Interface) -> Iterator[str]:
    for connector in c.connectors.values():
        where = f"{draft.where}:{connector.line}: {c.name}.{connector.name}"
        signal = interface.signals.get(connector.name)
        if c.placed and (signal is None or connector.kind != signal.causality):
            continue  # its connections are told, a line in all
        if signal is None:
            hint = nearest(connector.name, interface.signals)
            yield f"{where}: the FMU has no such variable{hint}"
            continue
        if connector.kind != signal.causality:
            yield f"{where}: listed as {connector.kind}, but it is an {signal.causality}"
        listed = "Integer" if connector.type == "Enumeration" else connector.type
        if listed and listed != signal.kind:
            yield f"{where}: listed as {connector.type}, but it is {signal.kind}"
        if connector.unit and connector.unit != signal.unit_name and signal.unit is not None:
            unit = known_unit(connector.unit)
            if unit is None or conversion(unit, signal.unit) != (1.0, 0.0):
                yield f"{where}: listed in {connector.unit}, but it is in {signal.unit_name or 1}"


def _parameters(
    draft: Draft, c: DraftComponent, interface: Interface, problems: list[str]
) -> dict[str, Scalar]:
    """The values of a component by element, in the variables' own units."""
    parameters: dict[str, Scalar] = {}
    for name, value in c.parameters.items():
        where = c.given.get(name, draft.where)
        try:
            own = interface.signals.get(name)
            signals = interface.elements.get(name, ()) if own is None else [own]
            if not (signals or interface.role):  # SSP 1.0: what matches no variable is ignored
                _warn(draft, f"{where}: {c.source} has no variable {name}"
                             f"{nearest(name, interface.signals)}: left out")  # fmt: skip
                continue
            if name in c.twice:
                problems.append(c.twice[name])
            if name in c.units and signals and not (signals[0].unit_name or interface.role):
                _warn(draft, f"{where}: {name} has no unit: its value, which was given with one, "
                             "is taken as it is")  # fmt: skip
            elif (
                signals and not isinstance(value, str)
                and (unit := c.units.get(name)) is not None and unit != signals[0].unit_name
            ):  # fmt: skip
                value = in_unit_of(signals[0], value, unit, where)
            parameters.update(expand(interface, name, value, f"{where}: {c.name}"))
        except DesatError as error:
            problems.append(str(error))
    return parameters


def _too_large(draft: Draft, components: Iterable[Component]) -> Iterator[str]:
    """Find values of our roles that no quantity has, a line each."""
    for component in components:
        if not component.interface.role:
            continue
        for name, value in component.parameters.items():
            if isinstance(value, float) and not abs(value) <= LARGEST:
                where = component.given.get(base_name(name), draft.where)
                yield (f"{where}: {component.name}.{name} = {value:g}: a size of at most "
                       f"{LARGEST:g} is needed")  # fmt: skip


def _warn(draft: Draft, line: str) -> None:
    if line not in draft.warnings:
        draft.warnings.append(line)


def _connections(draft: Draft, problems: list[str]) -> tuple[Connection, ...]:
    """The connections, those between different units with their conversion."""
    result = []
    driven: dict[tuple[str, str], Connection] = {}
    before = len(problems)
    lacking: dict[str, dict[str, None]] = defaultdict(dict)
    for c in draft.connections:
        if len(problems) > before + MOST:
            break
        source = _end(draft, c, "output", problems, lacking)
        target = _end(draft, c, "input", problems, lacking)
        if source is None or target is None:
            continue
        where = f"{draft.where}:{c.line}"
        if source.kind != target.kind:
            problems.append(f"{where}: {c}: type {source.kind} does not fit {target.kind}")
        other = driven.setdefault((c.target, c.input), c)
        if other is not c:
            problems.append(f"{where}: {c}: {c.target}.{c.input} has two sources, also "
                            f"{other.source}.{other.output} (line {other.line})")  # fmt: skip
        try:
            result.append(_converted(c, source, target))
        except DesatError as error:
            problems.append(f"{where}: {c}: {error}")
    problems += [
        f"{draft.components[name].placed}: {name}: its FMU lacks what is wired: {', '.join(ends)}"
        for name, ends in lacking.items()
    ]
    return tuple(result)


def _end(
    draft: Draft, c: Connection, causality: str, problems: list[str],
    lacking: Mapping[str, dict[str, None]],
) -> Signal | None:  # fmt: skip
    """The variable at one end of a connection; None where there is none that fits. What an FMU
    lacks that was put in a component's place goes to `lacking`, by component."""
    outgoing = causality == "output"
    element, connector = (c.source, c.output) if outgoing else (c.target, c.input)
    component = draft.components.get(element)
    where = f"{draft.where}:{c.line}"
    if component is None:
        hint = nearest(element, draft.components)
        problems.append(f"{where}: {c}: no component {element}{hint}")
        return None
    signals = component.interface.signals if component.interface else {}
    known = component.connectors or signals
    signal = signals.get(connector)
    fits = signal is not None and signal.causality == causality
    if component.placed and component.interface is not None and not fits:
        whole = c.output_array if outgoing else c.input_array
        part = component.interface.elements.get(whole, ()) and signal is None
        lacking[element][f"{causality} {connector if part else whole}"] = None
        return None
    if connector not in known:
        hint = nearest(connector, known)
        problems.append(f"{where}: {c}: {element} has no connector {connector}{hint}")
        return None
    if signal is not None and signal.causality != causality:
        end = "start" if outgoing else "end"
        problems.append(f"{where}: {c}: wrong direction: the {end} {element}.{connector} is an "
                        f"{signal.causality}, an {causality} is needed")  # fmt: skip
        return None
    return signal


def _converted(c: Connection, source: Signal, target: Signal) -> Connection:
    """The connection with the conversion of its units, where it has no other. Raises DesatError
    where they do not fit."""
    if not c.converts or not (source.unit_name and target.unit_name):
        return c
    if source.unit is None or target.unit is None:
        if source.unit_name == target.unit_name:
            return c
        unknown = source.unit_name if source.unit is None else target.unit_name
        raise DesatError(f"unit {unknown} is not known: nothing says how {source.unit_name} "
                         f"becomes {target.unit_name}")  # fmt: skip
    converted = conversion(source.unit, target.unit)
    if converted is None:
        raise DesatError(f"unit {source.unit_name} does not fit {target.unit_name}")
    if (c.factor, c.offset) != (1.0, 0.0):
        return c
    return replace(c, factor=converted[0], offset=converted[1])


def _times(draft: Draft) -> tuple[float, float]:
    """Step and stop time (s). Raises DesatError where the steps from start to stop are not
    whole."""
    if draft.step is None or draft.stop is None:
        missing = "step" if draft.step is None else "stop time"
        raise DesatError(f"{draft.where}: no {missing} is given; use --{missing.split()[0]}")
    by_step, by_stop = (draft.given.get(key, draft.where) for key in ("step", "stop"))
    both = by_step if by_step == by_stop else f"{by_stop}, {by_step}"
    if not (math.isfinite(draft.step) and draft.step > 0.0):
        raise DesatError(f"{by_step}: step {draft.step:g} s; a positive number is needed")
    span = (draft.stop - draft.start) / draft.step
    if not 1.0 - 1e-9 <= span < math.inf:
        raise DesatError(f"{both}: no step of {draft.step:g} s from {draft.start:g} s to "
                         f"{draft.stop:g} s")  # fmt: skip
    if span >= MOST_STEPS:
        raise DesatError(f"{both}: {span:.3g} steps of {draft.step:g} s; at most "
                         f"{MOST_STEPS:g} are made")  # fmt: skip
    if draft.start + draft.step == draft.start or draft.stop - draft.step == draft.stop:
        raise DesatError(f"{both}: from {draft.start:g} s to {draft.stop:g} s, time does "
                         f"not grow by a step of {draft.step:g} s")  # fmt: skip
    if abs(span - round(span)) > 1e-6:
        raise DesatError(
            f"{both}: {draft.stop - draft.start:g} s is not a multiple of the step {draft.step:g} s"
        )
    return draft.step, draft.stop
