"""`desat check`: everything that can be wrong with a system before it runs, with names."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from .draft import Draft
from .errors import DesatError, nearest
from .expression import named, values_of
from .foreseen import foreseen
from .interface import base_name
from .model import System
from .parameters import table, value_of
from .resolve import resolve
from .schedule import Schedule, schedule
from .unwired import Unwired, unwired, without_effect
from .wiring import computers


@dataclass
class Checked:
    """What a check found; `system` where the draft could be resolved, `schedule` where nothing
    stands against running it."""

    problems: list[str]
    warnings: list[str]
    notes: list[str] = field(default_factory=list)
    """A line a component: the inputs that keep their default, the outputs that reach nobody."""
    unwired: dict[str, Unwired] = field(default_factory=dict)
    system: System | None = None
    schedule: Schedule | None = None

    def or_raise(self) -> tuple[System, Schedule]:
        """The system and its schedule; raises DesatError with every problem, a line each."""
        if self.problems or self.system is None or self.schedule is None:
            raise DesatError("\n".join(self.problems))
        return self.system, self.schedule


def check(draft: Draft) -> Checked:
    """Resolve a draft and check what it comes to."""
    resolved = resolve(draft)
    system = resolved.system
    checked = Checked(resolved.problems, list(draft.warnings), system=system)
    if system is None:
        return checked
    checked.problems += _inputs(system)
    _shared(system, checked)
    checked.problems += _samples(system)
    checked.problems += _overrides(system, draft.given)
    checked.unwired = unwired(system)
    checked.problems += without_effect(system, checked.unwired)
    problems, warnings = foreseen(system, checked.unwired)
    checked.problems += problems
    checked.warnings += warnings
    checked.notes += filter(None, (ends.text(n) for n, ends in checked.unwired.items()))
    if not checked.problems:
        checked.warnings += _undeclared(system)
        checked.warnings += _follows(system, draft)
        try:
            checked.schedule = schedule(system)
            checked.warnings += checked.schedule.warnings
        except DesatError as error:
            checked.problems += str(error).splitlines()
    return checked


def _inputs(system: System) -> Iterator[str]:
    """Listed inputs without a source or value, and arrays that are wired in part."""
    wired = {(c.target, c.input) for c in system.connections}
    for c in system.components.values():
        for connector in c.connectors.values():
            name = connector.name
            given = (c.name, name) in wired or name in c.parameters
            if connector.kind == "input" and not given:
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


def _shared(system: System, checked: Checked) -> None:
    """A parameter that a block declares as shared must be equal wherever the name stands; where a
    flight computer knows it otherwise, its model errs, which a warning says."""
    values: dict[str, tuple[str, object]] = {}
    err: dict[tuple[str, str], str] = {}
    # the craft first: a computer's model is of it
    for c in sorted(system.components.values(), key=lambda c: c.interface.role in computers()):
        for signal in c.interface.of("parameter"):
            if not signal.shared:
                continue
            value, name = value_of(c, signal.name), base_name(signal.name)
            owner, other = values.setdefault(signal.name, (c.name, value))
            if value == other:
                continue
            text = f"{c.name}.{signal.name} = {value}, but {owner}.{signal.name} = {other}"
            if c.interface.role in computers():
                where = c.given.get(name, f"{system.where}: default")
                err.setdefault((c.name, name), f"{where}: {text}: what runs onboard errs about it")
            else:
                checked.problems.append(f"{system.where}: {text}: the two must be equal")
    checked.warnings += err.values()


def _follows(system: System, draft: Draft) -> Iterator[str]:
    """Parameters that differ from what of the craft they usually are, as their blocks declare it
    (`follows`): where a scenario extends another craft's they may be that one's.

    Silent where the scenario gives a product of parameters, where it gives neither side, and of
    what is of no craft: 0 (off), and a matrix that is a multiple of the identity.
    """
    known = table(system.components.values())
    known |= {c.interface.role: known[c.name] for c in system.components.values()
              if c.name in known and c.interface.role not in known}  # fmt: skip
    for c in system.components.values():
        for name, text in {base_name(s.name): s.follows for s in c.interface.of("parameter")
                           if s.follows}.items():  # fmt: skip
            if name in draft.components[c.name].references:
                continue
            try:
                usual = [float(x) for x in values_of(c, name, text, known).values()]
            except DesatError:  # that craft has none, or several that differ
                continue
            signals = c.interface.elements(name)
            own = [float(str(value_of(c, s.name))) for s in signals]
            ends = [known[owner][p] for owner, _, p in (n.partition(".") for n in named(text))]
            given = any(s.name in c.parameters for s in signals) or any(e["given"] for e in ends)
            least = 1e-9 * max(map(abs, usual))
            apart = [i for i, x in enumerate(own) if abs(x - usual[i]) > least]
            if not (given and apart) or _of_no_craft(own):
                continue
            i, unit = apart[0], signals[0].unit_name
            where = c.given.get(name, f"{system.where}: default")
            unit = f" {unit}" if unit not in ("", "1") else ""
            yield (f"{where}: {c.name}.{signals[i].name} = {own[i]:g}{unit}, where {text} is "
                   f"{usual[i]:g}{unit}: is it another craft's? Given as \"{text}\", or a "
                   "multiple, it follows")  # fmt: skip


def _of_no_craft(values: list[float]) -> bool:
    """Whether all are 0, or they are a multiple of the identity (3, 3)."""
    matrix = len(values) == 9 and [values[0] * (i % 4 == 0) for i in range(9)]
    return not any(values) or values == matrix


def _samples(system: System) -> Iterator[str]:
    """A component that samples does so, for whatever purpose, once in a whole number of its steps;
    so it is with its delay."""
    for c in system.components.values():
        step = system.step * c.decimation
        names = [n for n in c.interface.signals if n.endswith("sample_time") or n == "delay"]
        for name in names if "sample_time" in names else ():
            sample = value_of(c, name)
            ratio = float(sample) / step if isinstance(sample, (int, float)) else 0.0
            if ratio and (ratio < 1.0 - 1e-9 or abs(ratio - round(ratio)) > 1e-6):
                yield (f"{system.where}: {c.name}.{name} = {sample:g} s is not a multiple of "
                       f"its step {step:g} s")  # fmt: skip


def _overrides(system: System, given: Mapping[str, str]) -> Iterator[str]:
    """Classes that are none, or of no output; `given`: who said so."""
    for key, value in system.output_classes.items():
        where = given.get(key, f"{system.where}: output_classes")
        owner, _, name = key.partition(".")
        component = system.components.get(owner)
        if component is None:
            yield f"{where}: no component {owner}{nearest(owner, system.components)}"
        elif not any(s.causality == "output" for s in component.interface.elements(name)):
            yield f"{where}: {owner} has no output {name}"
        if value not in ("state", "interval"):
            yield f'{where}: {key} = "{value}"; state or interval is needed'


def _undeclared(system: System) -> Iterator[str]:
    silent: dict[str, list[str]] = defaultdict(list)
    for c in system.connections:
        component = system.components[c.source]
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
