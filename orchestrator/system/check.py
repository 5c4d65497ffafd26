"""`desat check`: everything that can be wrong with a system before it runs, with names."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field

from desat.components.contract.units import conversion

from .errors import DesatError, nearest
from .expression import known_unit
from .interface import Interface, Signal, base_name
from .model import Component, Connection, System
from .parameters import expand, in_unit_of, resolve, value_of
from .schedule import Schedule, schedule
from .unwired import Unwired, unwired, without_effect


@dataclass
class Checked:
    """What a check found; `schedule` where nothing stands against running the system."""

    problems: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    """A line a component: the inputs that keep their default, the outputs that reach nobody."""
    unwired: dict[str, Unwired] = field(default_factory=dict)
    schedule: Schedule | None = None

    def or_raise(self) -> Schedule:
        """The schedule; raises DesatError with every problem, a line each."""
        if self.problems or self.schedule is None:
            raise DesatError("\n".join(self.problems))
        return self.schedule


def check(system: System, problems: list[str]) -> Checked:
    """Check a system; `problems` is what reading it and loading its interfaces found."""
    problems = [*problems, *resolve(system)]
    found = Checked(list(dict.fromkeys(problems)), list(system.warnings))
    for component in system.components.values():
        if component.interface is not None:
            found.problems += _connectors(system, component, component.interface)
            found.problems += _parameters(system, component, component.interface)
    found.problems += _connections(system)
    if not found.problems:
        found.problems += _inputs(system)
        found.problems += _shared(system)
        found.problems += _times(system)
        found.problems += _overrides(system)
        found.unwired = unwired(system)
        found.problems += without_effect(system, found.unwired)
        found.notes += filter(None, (ends.text(n) for n, ends in found.unwired.items()))
    if not found.problems:
        found.warnings += _undeclared(system)
        try:
            found.schedule = schedule(system)
        except DesatError as error:
            found.problems.append(str(error))
    return found


def _connectors(system: System, c: Component, interface: Interface) -> Iterator[str]:
    for connector in c.connectors.values():
        where = f"{system.where}:{connector.line}: {c.name}.{connector.name}"
        signal = interface.signals.get(connector.name)
        if signal is None:
            hint = nearest(connector.name, interface.signals)
            yield f"{where}: the FMU has no such variable{hint}"
            continue
        if connector.kind != signal.causality:
            yield f"{where}: listed as {connector.kind}, but it is an {signal.causality}"
        if connector.type and connector.type != signal.kind:
            yield f"{where}: listed as {connector.type}, but it is {signal.kind}"
        if connector.unit and connector.unit != signal.unit_name and signal.unit is not None:
            listed = known_unit(connector.unit)
            if listed is None or conversion(listed, signal.unit) != (1.0, 0.0):
                yield f"{where}: listed in {connector.unit}, but it is in {signal.unit_name or 1}"


def _parameters(system: System, c: Component, interface: Interface) -> Iterator[str]:
    for name, value in list(c.parameters.items()):
        try:
            if name in c.units and name in interface.signals:
                value = in_unit_of(interface.signals[name], value, c.units.pop(name))
                c.parameters[name] = value
            c.parameters.update(expand(interface, name, value, f"{system.where}: {c.name}"))
        except DesatError as error:
            yield str(error)


def _connections(system: System) -> Iterator[str]:
    driven: dict[tuple[str, str], Connection] = {}
    for c in system.connections:
        where = f"{system.where}:{c.line}: {c}"
        ends = []
        for element, connector, causality, end in (
            (c.source, c.output, "output", "start"), (c.target, c.input, "input", "end"),
        ):  # fmt: skip
            component = system.components.get(element)
            if component is None:
                yield f"{where}: no component {element}{nearest(element, system.components)}"
                continue
            known = component.connectors or (
                component.interface.signals if component.interface else {}
            )
            if connector not in known:
                yield f"{where}: {element} has no connector {connector}{nearest(connector, known)}"
                continue
            signal = component.interface.signals.get(connector) if component.interface else None
            if signal is None:
                continue
            if signal.causality != causality:
                yield (f"{where}: wrong direction: the {end} {element}.{connector} is an "
                       f"{signal.causality}, an {causality} is needed")  # fmt: skip
                continue
            ends.append(signal)
        if len(ends) < 2:
            continue
        source, target = ends
        if source.kind != target.kind:
            yield f"{where}: type {source.kind} does not fit {target.kind}"
        yield from _units(c, source, target, where)
        other = driven.setdefault((c.target, c.input), c)
        if other is not c:
            yield (f"{where}: {c.target}.{c.input} has two sources, also {other.source}."
                   f"{other.output} (line {other.line})")  # fmt: skip


def _units(c: Connection, source: Signal, target: Signal, where: str) -> Iterator[str]:
    if source.unit is None or target.unit is None or not c.converts:
        return
    converted = conversion(source.unit, target.unit)
    if converted is None:
        yield f"{where}: unit {source.unit_name} does not fit {target.unit_name}"
    elif converted != (1.0, 0.0) and (c.factor, c.offset) == (1.0, 0.0):
        c.factor, c.offset = converted


def _inputs(system: System) -> Iterator[str]:
    """Listed inputs without a source or value, and arrays that are wired in part."""
    wired = {(c.target, c.input) for c in system.connections}
    for c in system.components.values():
        assert c.interface is not None
        for connector in c.connectors.values():
            name = connector.name
            if connector.kind == "input" and (c.name, name) not in wired | {
                (c.name, p) for p in c.parameters
            }:
                yield (f"{system.where}:{connector.line}: {c.name}.{name} is listed, but has "
                       "neither a connection nor a value")  # fmt: skip
        arrays: dict[str, list[str]] = defaultdict(list)
        for signal in c.interface.of("input"):
            arrays[base_name(signal.name)].append(signal.name)
        for elements in arrays.values():
            missing = [e for e in elements if (c.name, e) not in wired and e not in c.parameters]
            if 0 < len(missing) < len(elements):
                array = base_name(missing[0])
                yield (f"{system.where}:{c.line}: {c.name}.{array} is wired in part: "
                       f"{', '.join(missing)} has neither a connection nor a value")  # fmt: skip


def _shared(system: System) -> Iterator[str]:
    """A parameter that a block declares as shared must be equal wherever the name stands."""
    values: dict[str, tuple[str, object]] = {}
    for c in system.components.values():
        assert c.interface is not None
        for signal in c.interface.of("parameter"):
            if not signal.shared:
                continue
            value = value_of(c, signal.name)
            owner, other = values.setdefault(signal.name, (c.name, value))
            if value != other:
                yield (f"{system.where}: {c.name}.{signal.name} = {value}, but {owner}."
                       f"{signal.name} = {other}: the two must be equal")  # fmt: skip


def steps_of(system: System) -> int:
    """The number of steps from start to stop. Raises DesatError where it is not whole."""
    if system.step is None or system.stop is None:
        missing = "step" if system.step is None else "stop time"
        raise DesatError(f"{system.where}: no {missing} is given; use --{missing.split()[0]}")
    if not (math.isfinite(system.step) and system.step > 0.0):
        raise DesatError(f"{system.where}: step {system.step} s; a positive number is needed")
    span = (system.stop - system.start) / system.step
    if not 1.0 - 1e-9 <= span < 1e12:
        raise DesatError(f"{system.where}: no step from {system.start} s to {system.stop} s")
    if abs(span - round(span)) > 1e-6:
        raise DesatError(
            f"{system.where}: {system.stop - system.start:g} s is not a multiple of the step "
            f"{system.step:g} s"
        )
    return round(span)


def _times(system: System) -> Iterator[str]:
    try:
        steps_of(system)
    except DesatError as error:
        yield str(error)
        return
    assert system.step is not None
    for c in system.components.values():
        assert c.interface is not None
        step = system.step * c.decimation
        if "sample_time" in c.interface.signals:
            sample = value_of(c, "sample_time")
            assert isinstance(sample, float)
            ratio = sample / step
            if sample and (ratio < 1.0 - 1e-9 or abs(ratio - round(ratio)) > 1e-6):
                yield (f"{system.where}: {c.name}.sample_time = {sample:g} s is not a multiple of "
                       f"its step {step:g} s")  # fmt: skip


def _overrides(system: System) -> Iterator[str]:
    for key, value in system.output_classes.items():
        owner, _, name = key.partition(".")
        component = system.components.get(owner)
        if component is None:
            yield f"{system.where}: output_classes: no component {owner}"
        elif not component.interface or not any(
            s.causality == "output" for s in component.interface.elements(name)
        ):
            yield f"{system.where}: output_classes: {owner} has no output {name}"
        if value not in ("state", "interval"):
            yield f'{system.where}: output_classes: {key} = "{value}"; state or interval is needed'


def _undeclared(system: System) -> Iterator[str]:
    silent: dict[str, list[str]] = defaultdict(list)
    for c in system.connections:
        component = system.components[c.source]
        assert component.interface is not None
        signal = component.interface.signals[c.output]
        if signal.output_class == "undeclared" and not any(
            f"{c.source}.{n}" in system.output_classes for n in (c.output, base_name(c.output))
        ):
            silent[c.source].append(base_name(c.output))
    for name, outputs in silent.items():
        listed = ", ".join(dict.fromkeys(outputs))
        yield (f"{system.where}: {name} declares no dependencies: {listed} taken as state outputs, "
               f'one step late; override with [output_classes] "{name}.{outputs[0]}" = '
               '"interval"')  # fmt: skip
