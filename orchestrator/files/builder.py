"""Build a system from layers of values.

FMUs are put in their places, values are expanded and units converted.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePath
from typing import Any, Self

from desat.components.contract.block import Scalar
from desat.components.contract.units import Unit, conversion

from ..system.body import Body
from ..system.check import Checked, check
from ..system.errors import DesatError, nearest, require
from ..system.expression import evaluate
from ..system.interface import Interface, OutputClass, Signal, base_name
from ..system.layer import SHARED, Layer, Place, Value
from ..system.model import (
    ACCURACY,
    AUTO,
    About,
    Component,
    Connection,
    Connector,
    Fmu,
    Substeps,
    System,
)
from ..system.parameters import as_text, expand, in_unit_of, is_quantity, known_unit
from . import library, paths

# The kinds of outputs that an input of each kind takes: none loses anything.
_ACCEPTED = {
    "Real": ("Real", "Integer"),
    "Integer": ("Integer",),
    "Boolean": ("Boolean",),
    "String": ("String",),
}
RESERVED = (
    "time",
    SHARED,
)  # no component may have these names: series of times, parameters of all
MOST_LINES = 100  # upper bound of lines about one kind of problem
MOST_NAMED = 10  # upper bound of connectors that one line names
# SI; no quantity of a spacecraft is larger, and its square and cube are finite
LARGEST = 1e40
MOST_STEPS = 1e12  # of a run: at a microsecond each they take eleven days


@dataclass
class Part:
    """Component while its system is built."""

    name: str
    source: str
    line: int
    fmu: Fmu | None
    interface: Interface | None
    connectors: dict[str, Connector]
    step_ratio: int
    parameters: dict[str, Scalar | str] = field(default_factory=dict)  # by element
    references: dict[str, str] = field(
        default_factory=dict
    )  # given as products of parameters
    units: dict[str, Unit | str] = field(
        default_factory=dict
    )  # if not the variable's own unit
    unit_names: dict[str, str] = field(default_factory=dict)  # of these, as written
    conflicts: dict[str, str] = field(default_factory=dict)
    origins: dict[str, str] = field(
        default_factory=dict
    )  # source of a variable's value
    placed_by: str = ""  # source of the FMU that replaced its own

    def elements(self, name: str) -> list[str]:
        """Return the names of a variable's scalars.

        The list is empty if the interface is unknown.
        """
        return (
            [s.name for s in self.interface.elements.get(name, ())]
            if self.interface
            else []
        )

    def assign(self, name: str, value: Any, place: str, typed: str = "") -> None:
        """Set a parameter (or input) to a value, or to a text that refers to others.

        A text for a Real is a product of parameters (`expression.py`). A String takes
        `typed`, the value as it was typed. Nothing is set if the interface is unknown,
        because the missing interface is a problem already.

        Raises
        ------
        DesatError
            As `expand` does.
        """
        if self.interface is None:
            return
        signals = self.interface.elements.get(name, ())
        is_text = isinstance(value, str) and not is_quantity(value)
        if is_text and signals and signals[0].kind == "Real":
            expand(self.interface, name, [s.start or 0.0 for s in signals], place)
            self.references[name] = value
            return
        if typed and signals and signals[0].kind == "String":
            value = as_text(value, typed, len(signals))
        values = expand(self.interface, name, value, place, typed=True)
        self.parameters.update(values)
        self.references.pop(base_name(name), None)
        for element in (*values, name):
            self.units.pop(element, None)

    def resize(self) -> None:
        """Let the arrays follow from the structural parameters that are given."""
        if self.fmu is None or self.interface is None:
            return
        sizes = {
            name: int(value)
            for name, value in self.parameters.items()
            if name in self.interface.structural
        }
        self.interface = self.fmu.sized(sizes)

    def take(self, value: Value) -> None:
        """Store a value of an SSP file, which is checked when all layers are known."""
        name = value.name
        self.parameters[name] = value.value
        self.origins[name] = value.origin
        self.origins.setdefault(base_name(name), value.origin)
        self.conflicts.pop(name, None)
        if value.conflict:
            self.conflicts[name] = value.conflict
        self.units.pop(name, None)
        if value.unit is not None:
            self.units[name] = value.unit
            self.unit_names[name] = value.unit_name


class Builder:
    """Builder of a system from layers; the first has its components and connections.

    Parameters
    ----------
    first
        The layer of a craft or of an SSP file.
    blocks
        Whether components are bare blocks in place of FMUs.
    kind
        Which of our FMUs run: `native` or `python`.
    load
        Whether interfaces are loaded from FMUs or blocks; otherwise those of the places
        are used.
    """

    def __init__(
        self,
        first: Layer,
        blocks: bool = False,
        kind: str = "native",
        load: bool = True,
    ) -> None:
        self.blocks = blocks
        self.kind = kind
        self.load = load
        self.place = first.place
        self.name = first.name
        self.title = ""
        self.components: dict[str, Part] = {}
        self.connections: list[Connection] = []
        self.start = 0.0
        self.stop: float | None = None
        self.step: float | None = None
        self.substeps: Substeps = AUTO
        self.accuracy = ACCURACY
        self.output_classes: dict[str, OutputClass] = {}
        self.origins: dict[str, str] = {}
        self.about: About | None = None
        self.body: Body | None = None
        self.problems: list[str] = []
        self.warnings: list[str] = []
        self.guesses: dict[str, str] = {}  # of times that no layer has given
        self.add(first)

    def add(self, *layers: Layer) -> Self:
        """Add layers; a later one replaces values of an earlier one.

        Raises
        ------
        DesatError
            If a layer names a component that does not exist, or if values do not fit that
            must raise an error (`Value.raises`), with a line for each.
        """
        for layer in layers:
            self.problems += layer.problems
            self.warnings += layer.warnings
            self.guesses = {
                key: line
                for key, line in (self.guesses | layer.guesses).items()
                if key in layer.guesses or getattr(layer, key) is None
            }
            for key in (
                "name",
                "title",
                "start",
                "stop",
                "step",
                "substeps",
                "accuracy",
                "about",
                "body",
            ):
                if (value := getattr(layer, key)) not in (None, ""):
                    setattr(self, key, value)
            self.output_classes |= layer.output_classes
            self.origins |= layer.origins
            self.connections += layer.connections
            replaced = self._fill(layer)
            for name, ratio in layer.step_ratios.items():
                self.part(name, f"{layer.place}: step_ratio").step_ratio = ratio
            errors: list[str] = []
            parts = self.components.values()
            values = layer.values
            if any(p.interface and p.interface.structural for p in parts):
                # arrays follow from structural parameters
                values = sorted(values, key=lambda v: not self._is_structural(v))
            for value in values:
                self._give(value, layer, errors if value.raises else self.problems)
            if errors:
                raise DesatError("\n".join(dict.fromkeys(errors)))
            for name in replaced:
                self._adopt_shared(self.components[name])
        return self

    def part(self, name: str, place: str) -> Part:
        """Return a component by its name.

        Raises
        ------
        DesatError
            If there is none; the message begins with `place`.
        """
        require(name, self.components, f"{place}: no component")
        return self.components[name]

    # --- FMUs in their places ---------------------------------------------------------

    def _fill(self, layer: Layer) -> list[str]:
        """Put the FMUs of a layer in their places.

        Return the names of the components whose FMU was replaced.
        """
        replaced = []
        for place in layer.places:
            if not place.origin:
                part = Part(
                    place.name,
                    place.source,
                    place.line,
                    place.fmu,
                    place.interface,
                    dict(place.connectors),
                    place.step_ratio,
                )
                self.components[place.name] = part
                if self.load:
                    self._load_interface(part)
                if part.fmu is not None and part.interface is not None:
                    part.parameters.update(part.fmu.start_values)
            else:
                self._replace(place, layer)
                replaced.append(place.name)
        return replaced

    def _replace(self, place: Place, layer: Layer) -> None:
        """Replace the FMU of a component.

        Values of variables that both FMUs declare alike are preserved.
        """
        at = place.origin if layer.of_options else f"{layer.place}: sources"
        part = self.part(place.name, at)
        part.placed_by = place.origin
        part.source, part.fmu = place.source, place.fmu
        before = part.interface
        self._load_interface(part)
        if part.interface is None:
            return
        origins = dict(part.origins)
        dropped = _keep_alike(part, before)
        if layer.of_options and dropped:  # what an option sets is not lost
            options = {v.name for v in layer.values if v.owner == part.name}
            dropped = [name for name in dropped if name not in options]
        if layer.of_options and dropped:
            self.warnings.append(
                f"{part.name}: {place.label} does not take {', '.join(dropped)} of the FMU that it "
                "replaces"
            )
        own_parameters = [
            name
            for name in dropped
            if f"parameters.{part.name}." in origins.get(name, "")
        ]
        if own_parameters and not layer.of_options:
            self.warnings.append(
                f"{part.name}: {place.label} does not take {', '.join(own_parameters)} of the craft"
            )
        self._drop_unwanted(part)

    def _load_interface(self, part: Part) -> None:
        """Load the interface of a component from its FMU or the bare block of its name.

        A bare block has no file: `fmu` is None from then on.
        """
        part.interface = None
        if not part.source:  # it is refused already
            return
        try:
            part.interface = library.interface_of(
                part.source, part.fmu, self.blocks, self._is_foreign(part)
            )
        except DesatError as error:
            at = part.placed_by or f"{self.place}:{part.line}"
            self.problems.append(f"{at}: {part.name}: {error}")
        if self.blocks:
            part.fmu = None

    def _is_foreign(self, part: Part) -> bool:
        """Return whether a component is of somebody's system file, not of ours."""
        ours = Path(self.place).absolute().is_relative_to(paths.SCENARIOS)
        return bool(part.line) and not part.placed_by and not ours

    def _drop_unwanted(self, part: Part) -> None:
        """Remove connections and connectors that a replaced component's FMU lacks.

        An FMU in a role's place needs only the inputs that its law uses, and may lack
        an output of the role (a manager without thrusters): an input that reads it
        keeps its start value. If it has none of the outputs that are read, or lacks
        part of an array, the connections stay, so that the check reports them.
        """
        assert part.interface is not None
        name, signals = part.name, part.interface.signals
        fmu, bases = PurePath(part.source).name, part.interface.arrays
        unwanted = [
            c for c in self.connections if c.target == name and c.input not in signals
        ]
        if unwanted:
            arrays = {c.input_array for c in unwanted}.difference(bases)
            names = {
                c.input_array if c.input_array in arrays else c.input for c in unwanted
            }
            self.warnings.append(
                f"{name}: {fmu} has no input {', '.join(sorted(names))}: left unwired"
            )
        outgoing = [c for c in self.connections if c.source == name]
        missing = [c for c in outgoing if c.output_array not in bases]
        if len(missing) < len(outgoing):
            for output, reads in sorted(_by_output(missing).items()):
                hint = nearest(output, {s.array for s in part.interface.outputs})
                self.warnings.append(
                    f"{name}: {fmu} has no output {output}{hint}: {', '.join(reads)} "
                    f"keep{'s' if len(reads) == 1 else ''} the start value"
                )
            for c in missing:
                self.components[c.target].connectors.pop(c.input, None)
            unwanted += missing
        if unwanted:
            self.connections = [c for c in self.connections if c not in unwanted]
        read = {c.output for c in self.connections if c.source == name}
        part.connectors = {
            key: c
            for key, c in part.connectors.items()
            if key in signals or key in read
        }

    def _adopt_shared(self, part: Part) -> None:
        """Copy the craft's values of shared parameters to a replaced component.

        They replace its own defaults, which belong to another craft. Parameters that
        were given a value are left alone.
        """
        if part.interface is None:
            return
        shared = {s.array for s in part.interface.parameters if s.shared}
        set_names = {
            base_name(name) for name in part.parameters
        } | part.references.keys()
        for name in sorted(shared - set_names):
            elements = part.elements(name)
            owner = next(
                (p for p in self._sharing(name, elements) if p is not part), None
            )
            if owner is None or owner.interface is None:
                continue
            if name in owner.references:
                part.references[name] = owner.references[name]
            else:
                for element in elements:
                    start = owner.interface.signals[element].start
                    value = owner.parameters.get(element, start)
                    if value is not None and not isinstance(value, str):
                        part.parameters[element] = value
                    if unit := owner.units.get(element):
                        part.units[element] = unit
            if name in owner.origins:
                part.origins[name] = owner.origins[name]

    def _sharing(self, name: str, elements: list[str]) -> Iterator[Part]:
        """Find the components that share a parameter with these elements."""
        for part in self.components.values():
            if part.interface is None or part.elements(name) != elements:
                continue
            if part.interface.signals[elements[0]].shared:
                yield part

    # --- values -----------------------------------------------------------------------

    def _give(self, value: Value, layer: Layer, errors: list[str]) -> None:
        """Set a value of its component, or of all components that share it.

        A value that does not fit is appended to `errors`.
        """
        for part in self._owners(value, errors):
            resizes = part.interface and value.name in part.interface.structural
            if value.unchecked:
                part.take(value)
                if resizes:
                    part.resize()
                continue
            try:
                if layer.of_options and value.owner != SHARED:
                    self._check_open(part, value)
                prefix = f"{value.prefix}: " if value.prefix else ""
                at = f"{prefix}{part.name}"
                part.assign(value.name, value.value, at, value.text)
                part.origins[base_name(value.name)] = value.origin
                if resizes:
                    part.resize()
            except DesatError as error:
                errors.append(str(error))

    def _is_structural(self, value: Value) -> bool:
        """Return whether a value is that of a structural parameter."""
        part = self.components.get(value.owner)
        interface = None if part is None else part.interface
        return interface is not None and value.name in interface.structural

    def _owners(self, value: Value, errors: list[str]) -> list[Part]:
        """Return the components to which a value applies."""
        if value.owner != SHARED or SHARED in self.components:
            return [self.part(value.owner, value.origin)]
        owners = [
            part for part in self.components.values() if part.elements(value.name)
        ]
        if not owners:
            interfaces = [
                p.interface for p in self.components.values() if p.interface is not None
            ]
            known = {s.array for interface in interfaces for s in interface.parameters}
            hint = nearest(value.name, known)
            errors.append(
                f"{value.origin}: no component has a parameter {value.name}{hint}"
            )
        return owners

    def _check_open(self, part: Part, value: Value) -> None:
        """Raise DesatError if an output feeds the input that a value is for."""
        name = value.name
        for c in self.connections:
            end = c.input if name != base_name(name) else c.input_array
            if c.target == part.name and end == name:
                raise DesatError(
                    f"{value.origin}: {part.name}.{name}: {c.source}.{c.output} feeds it: it never "
                    "has this value"
                )

    # --- building ---------------------------------------------------------------------

    def build(self) -> tuple[System | None, dict[str, Component]]:
        """Build the system.

        Returns
        -------
        tuple
            The system, or None if there are `problems`; and the components whose interface
            is known.
        """
        self.problems += self._names()
        components: dict[str, Component] = {}
        for part in self.components.values():
            if part.interface is None:
                continue
            self._check_connectors(part, part.interface)
            fmu = part.fmu
            if fmu is not None and self.kind != "native":
                fmu = library.of_kind(fmu, self.kind)
            components[part.name] = Component(
                part.name,
                part.source,
                part.interface,
                self._parameters(part, part.interface),
                fmu,
                part.step_ratio,
                part.connectors,
                part.line,
                part.origins,
                part.references,
            )
        references = {
            (name, parameter): text
            for name, component in components.items()
            for parameter, text in component.references.items()
        }
        components, wrong, unsure = evaluate(components, references, self.place)
        self.problems += wrong
        self.warnings += unsure
        self.problems += self._too_large(components.values())
        connections = self._connections()
        self.problems = list(dict.fromkeys(self.problems))
        self.warnings += self.guesses.values()
        try:
            step, stop = self._times()
        except DesatError as error:
            self.problems.append(str(error))
        if self.problems:
            return None, components
        system = System(
            self.name,
            self.place,
            components,
            connections,
            step,
            stop,
            self.start,
            self.substeps,
            self.accuracy,
            self.output_classes,
            self.about,
            self.body,
        )
        return system, components

    def check(self, breaks_loops: bool = False) -> Checked:
        """Build the system and check it; `breaks_loops` is as for `schedule`."""
        system, _ = self.build()
        return check(system, self.problems, self.warnings, self.origins, breaks_loops)

    def system(self) -> System:
        """Build the system.

        Raises
        ------
        DesatError
            If there are problems, with a line for each.
        """
        system, _ = self.build()
        if system is None:
            raise DesatError("\n".join(self.problems))
        return system

    def _names(self) -> Iterator[str]:
        """Find component names with which no name of a series can begin."""
        for part in self.components.values():
            name = part.name
            bad = (
                set("./[]*?=") & set(name) or not name.strip() or not name.isprintable()
            )
            if bad or name in RESERVED:
                yield (
                    f"{self.place}:{part.line}: component {name!r}: a name is needed without . / ["
                    f" ] * ? = and other than {', '.join(RESERVED)}"
                )

    def _check_connectors(self, part: Part, interface: Interface) -> None:
        """Report listed connectors that the FMU lacks or declares differently.

        They are problems if they are wired or given a value, in one line of a
        component, and warnings otherwise: tools list their own settings, too.
        """
        used = {(c.source, c.output) for c in self.connections}
        used |= {(c.target, c.input) for c in self.connections}
        with_values = {*part.parameters, *map(base_name, part.parameters)}
        wrong: dict[bool, list[tuple[Connector, str]]] = {True: [], False: []}
        for connector in part.connectors.values():
            signal = interface.signals.get(connector.name)
            if part.placed_by and (
                signal is None or connector.kind != signal.causality
            ):
                continue  # reported in one line with all of its connections
            if signal is not None and (
                connector.kind == signal.causality
                and connector.type in ("", signal.kind)
                and connector.unit in ("", signal.unit_name)
            ):
                continue
            is_wired = (part.name, connector.name) in used
            is_used = is_wired or connector.name in with_values
            for text in _misfits(connector, signal, interface):
                wrong[is_used].append((connector, text))
        for is_used, report in ((True, self.problems.append), (False, self._warn)):
            if wrong[is_used]:
                line = wrong[is_used][0][0].line
                texts = [f"{c.name}: {text}" for c, text in wrong[is_used]]
                listed = _counted(texts)
                unused = "" if is_used else "; they are not used"
                report(f"{self.place}:{line}: {part.name}.{listed}{unused}")

    def _parameters(self, part: Part, interface: Interface) -> dict[str, Scalar]:
        """Return a component's values by element, in the variables' own units."""
        parameters: dict[str, Scalar] = {}
        for name, value in part.parameters.items():
            at = part.origins.get(name, self.place)
            declared = interface.signals.get(name)
            signals = (
                interface.elements.get(name, ()) if declared is None else [declared]
            )
            if not (
                signals or interface.role
            ):  # SSP 1.0: a value that matches no variable is ignored
                other = name.partition(".")[0]
                if other != name and other in self.components:
                    self.problems.append(
                        f"{at}: it names {other}, but the set is that of {part.name}"
                    )
                    continue
                hint = nearest(name, interface.signals)
                self._warn(
                    f"{at}: {part.source} has no variable {name}{hint}: left out"
                )
                continue
            if name in part.conflicts:
                self.problems.append(part.conflicts[name])
            unit = part.units.get(name)
            try:
                if unit is not None and signals:
                    if part.unit_names.get(name) == signals[0].unit_name:
                        self._warn_of_namesake(unit, signals[0].unit, signals[0], at)
                    else:
                        value = self._converted_value(
                            name, value, unit, signals[0], interface, at
                        )
                parameters.update(expand(interface, name, value, f"{at}: {part.name}"))
            except DesatError as error:
                self.problems.append(str(error))
        return parameters

    def _converted_value(
        self,
        name: str,
        value: Scalar | str,
        unit: Unit | str,
        signal: Signal,
        interface: Interface,
        place: str,
    ) -> Scalar | str:
        """Convert a value that was given with a unit to the unit of its variable."""
        if not (signal.unit_name or interface.role):
            self._warn(
                f"{place}: {name} has no unit: its value, which was given with one, is taken as it "
                "is"
            )
            return value
        if isinstance(value, str) or unit == signal.unit_name:
            return value
        if isinstance(value, list):
            return [in_unit_of(signal, x, unit, place) for x in value]
        return in_unit_of(signal, value, unit, place)

    def _warn_of_namesake(
        self, unit: Unit | str | None, other: Unit | None, signal: Signal, place: str
    ) -> None:
        """Warn of two units that have one name and are defined differently."""
        if isinstance(unit, str) or unit is None or other is None:
            return
        if conversion(unit, other) != (1.0, 0.0):
            self._warn(
                f"{place}: {signal.name}: the unit {signal.unit_name} is defined in two "
                "ways: the value is taken as it is"
            )

    def _warn(self, line: str) -> None:
        """Add a warning, once."""
        if line not in self.warnings:
            self.warnings.append(line)

    def _too_large(self, components: Iterable[Component]) -> Iterator[str]:
        """Find values of our roles that are too large for any quantity, a line each."""
        for component in components:
            if not component.interface.role:
                continue
            for name, value in component.parameters.items():
                if isinstance(value, float) and not abs(value) <= LARGEST:
                    place = component.origins.get(base_name(name), self.place)
                    yield (
                        f"{place}: {component.name}.{name} = {value:g}: a magnitude of at most "
                        f"{LARGEST:g} is needed"
                    )

    def _connections(self) -> tuple[Connection, ...]:
        """Return the connections, with unit conversions where the units differ."""
        result = []
        driven: dict[tuple[str, str], Connection] = {}
        before = len(self.problems)
        lacking: dict[str, dict[str, None]] = defaultdict(dict)
        for c in self.connections:
            if len(self.problems) > before + MOST_LINES:
                break
            source = self._end(c, "output", lacking)
            target = self._end(c, "input", lacking)
            if source is None or target is None:
                continue
            place = f"{self.place}:{c.line}"
            if source.kind not in _ACCEPTED.get(target.kind, ()):
                self.problems.append(
                    f"{place}: {c}: type {source.kind} does not fit {target.kind}"
                )
            other = driven.setdefault((c.target, c.input), c)
            if other is not c:
                self.problems.append(
                    f"{place}: {c}: {c.target}.{c.input} has two sources, also "
                    f"{other.source}.{other.output} (line {other.line})"
                )
            is_namesake = c.converts and source.unit_name == target.unit_name
            if is_namesake and source.unit != target.unit:
                at = f"{place}: {c}"
                self._warn_of_namesake(source.unit, target.unit, target, at)
            try:
                result.append(_converted(c, source, target))
            except DesatError as error:
                self.problems.append(f"{place}: {c}: {error}")
        for name, ends in lacking.items():
            by = self.components[name].placed_by
            self.problems.append(
                f"{by}: {name}: its FMU lacks what is wired: {', '.join(ends)}"
            )
        return tuple(result)

    def _end(
        self, c: Connection, causality: str, lacking: Mapping[str, dict[str, None]]
    ) -> Signal | None:
        """Return the variable at one end of a connection, or None if none fits.

        Variables that a replacing FMU lacks are added to `lacking`, by component.
        """
        outgoing = causality == "output"
        owner, connector = (c.source, c.output) if outgoing else (c.target, c.input)
        part = self.components.get(owner)
        place = f"{self.place}:{c.line}"
        if part is None:
            hint = nearest(owner, self.components)
            self.problems.append(f"{place}: {c}: no component {owner}{hint}")
            return None
        signals = part.interface.signals if part.interface else {}
        known = part.connectors or signals
        if not known and part.interface is None:
            return None
        signal = signals.get(connector)
        has_causality = signal is not None and signal.causality == causality
        if part.placed_by and part.interface is not None and not has_causality:
            is_array = c.output_array if outgoing else c.input_array
            in_part = part.interface.elements.get(is_array, ()) and signal is None
            lacking[owner][f"{causality} {connector if in_part else is_array}"] = None
            return None
        if connector not in known:
            hint = nearest(connector, known)
            self.problems.append(
                f"{place}: {c}: {owner} has no connector {connector}{hint}"
            )
            return None
        if signal is not None and signal.causality != causality:
            end = "start" if outgoing else "end"
            self.problems.append(
                f"{place}: {c}: wrong direction: the {end} {owner}.{connector} is an "
                f"{signal.causality}, an {causality} is needed"
            )
            return None
        return signal

    def _times(self) -> tuple[float, float]:
        """Return step and stop time (s).

        Raises
        ------
        DesatError
            If the number of steps from start to stop is not whole, or is too large.
        """
        start, step, stop = self.start, self.step, self.stop
        if step is None or stop is None:
            missing = "step" if step is None else "stop time"
            raise DesatError(
                f"{self.place}: no {missing} is given; use --{missing.split()[0]}"
            )
        by_step, by_stop = (
            self.origins.get(key, self.place) for key in ("step", "stop")
        )
        both = by_step if by_step == by_stop else f"{by_stop}, {by_step}"
        if not (math.isfinite(step) and step > 0.0):
            raise DesatError(f"{by_step}: step {step:g} s; a positive number is needed")
        span = (stop - start) / step
        if not 1.0 - 1e-9 <= span < math.inf:
            raise DesatError(
                f"{both}: no step of {step:g} s from {start:g} s to {stop:g} s"
            )
        if span >= MOST_STEPS:
            raise DesatError(
                f"{both}: {span:.3g} steps of {step:g} s; at most {MOST_STEPS:g} are made"
            )
        if start + step == start or stop - step == stop:
            raise DesatError(
                f"{both}: from {start:g} s to {stop:g} s, time does not grow by a step of "
                f"{step:g} s"
            )
        if abs(span - round(span)) > 1e-6:
            raise DesatError(
                f"{both}: {stop - start:g} s is not a multiple of the step {step:g} s"
            )
        return step, stop


def _misfits(
    connector: Connector, signal: Signal | None, interface: Interface
) -> Iterator[str]:
    """Say how a listed connector differs from the variable of its name.

    An Integer may be listed as Real: what is wired to it decides.
    """
    if signal is None:
        hint = nearest(connector.name, interface.signals)
        yield f"the FMU has no such variable{hint}"
        return
    if connector.kind != signal.causality:
        yield f"listed as {connector.kind}, but it is an {signal.causality}"
    listed = "Integer" if connector.type == "Enumeration" else connector.type
    is_wider = (listed, signal.kind) == ("Real", "Integer")
    if listed not in ("", signal.kind) and not is_wider:
        yield f"listed as {connector.type}, but it is {signal.kind}"
    if connector.unit in ("", signal.unit_name) or signal.unit is None:
        return
    unit = known_unit(connector.unit)
    if unit is None or conversion(unit, signal.unit) != (1.0, 0.0):
        own_unit = signal.unit_name or 1
        yield f"listed in {connector.unit}, but it is in {own_unit}"


def _counted(texts: list[str]) -> str:
    """Join texts for one line; of very many the first ones and their count."""
    if len(texts) <= MOST_NAMED:
        return "; ".join(texts)
    return f"{'; '.join(texts[:MOST_NAMED])}; and {len(texts) - MOST_NAMED} more"


def _keep_alike(part: Part, before: Interface | None) -> list[str]:
    """Remove the values of variables that the new interface declares differently.

    Returns
    -------
    list
        The names of the variables that have lost their values.
    """
    old = before.signals if before else {}
    new = part.interface.signals if part.interface else {}

    def is_alike(key: str) -> bool:
        if key not in old or key not in new:
            return False
        facts = ("causality", "kind", "unit", "choices")
        return all(getattr(old[key], fact) == getattr(new[key], fact) for fact in facts)

    parameters = part.parameters
    part.parameters = {key: value for key, value in parameters.items() if is_alike(key)}
    part.references = {
        name: text
        for name, text in part.references.items()
        if before is not None
        and all(is_alike(s.name) for s in before.elements.get(name, ()))
    }
    return list(
        dict.fromkeys(base_name(k) for k in parameters if k not in part.parameters)
    )


def _by_output(connections: Iterable[Connection]) -> dict[str, list[str]]:
    """Return the inputs that each output feeds, arrays as a whole."""
    feeds: dict[str, dict[str, None]] = {}
    for c in connections:
        feeds.setdefault(c.output_array, {})[f"{c.target}.{c.input_array}"] = None
    return {output: list(inputs) for output, inputs in feeds.items()}


def _converted(c: Connection, source: Signal, target: Signal) -> Connection:
    """Add the conversion of units to a connection, if it has no other.

    Raises
    ------
    DesatError
        If the units do not fit.
    """
    if not c.converts or not (source.unit_name and target.unit_name):
        return c
    if source.unit_name == target.unit_name:
        return c
    if source.unit is None or target.unit is None:
        unknown = source.unit_name if source.unit is None else target.unit_name
        raise DesatError(
            f"unit {unknown} is not known: nothing says how {source.unit_name} becomes "
            f"{target.unit_name}"
        )
    converted = conversion(source.unit, target.unit)
    if converted is None:
        raise DesatError(f"unit {source.unit_name} does not fit {target.unit_name}")
    if (c.factor, c.offset) != (1.0, 0.0):
        return c
    return replace(c, factor=converted[0], offset=converted[1])
