"""A system as it is read, before it is resolved: interfaces, values and times may be missing.

Files (`files/`) write it, options of a command change it (`files/assembly.py`), and `resolve.py`
makes a `System` of it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import PurePath
from typing import Any

from desat.components.contract.block import Scalar
from desat.components.contract.units import Unit

from .body import Body
from .errors import DesatError, nearest
from .interface import Interface, OutputClass, base_name
from .model import ACCURACY, AUTO, Connection, Connector, Fmu, Substeps, Told
from .parameters import expand, is_quantity


@dataclass
class DraftComponent:
    """A component as it is read."""

    name: str
    source: str
    connectors: dict[str, Connector] = field(default_factory=dict)
    parameters: dict[str, Scalar | str] = field(default_factory=dict)
    """Scalar values, a choice by its name, by element name; inputs may be among them."""
    references: dict[str, str] = field(default_factory=dict)
    """Parameters that are given as other parameters: `gain_matrix = "shared.inertia"`."""
    units: dict[str, Unit | str] = field(default_factory=dict)
    """Units that values in `parameters` were given in, where they are not the component's own."""
    twice: dict[str, str] = field(default_factory=dict)
    """What to say of variables to which one parameter set gives two values."""
    given: dict[str, str] = field(default_factory=dict)
    """Who gave a variable its value: name -> file and key, or option."""
    line: int = 0
    placed: str = ""
    """Who put another FMU in its place: file and key, or option; "" where nobody did."""
    fmu: Fmu | None = None
    """What `source` stands for; None where there is none, and for a bare block."""
    interface: Interface | None = None
    step_ratio: int = 1

    def elements(self, name: str) -> list[str]:
        """The scalars of a variable by name; none where the interface is not known."""
        return [s.name for s in self.interface.elements.get(name, ())] if self.interface else []

    def assign(self, name: str, value: Any, where: str) -> None:
        """Give a parameter (or input) its value, or the text of one that follows from others.

        A text for a Real is a product of parameters (`expression.py`), evaluated by `resolve`.
        Raises DesatError as `expand` does. Nothing is given where the interface is not known: that
        it is missing is said elsewhere.
        """
        if self.interface is None:
            return
        signals = self.interface.elements.get(name, ())
        text = isinstance(value, str) and not is_quantity(value)
        if text and signals and signals[0].kind == "Real":
            expand(self.interface, name, [s.start or 0.0 for s in signals], where)
            self.references[name] = value
            return
        values = expand(self.interface, name, value, where, typed=True)
        self.parameters.update(values)
        self.references.pop(base_name(name), None)
        for element in (*values, name):
            self.units.pop(element, None)


@dataclass
class Draft:
    """Components, connections and the experiment as they are read. `where` is the file, for
    messages."""

    name: str
    where: str
    components: dict[str, DraftComponent] = field(default_factory=dict)
    connections: list[Connection] = field(default_factory=list)
    start: float = 0.0
    stop: float | None = None
    step: float | None = None
    substeps: Substeps = AUTO
    accuracy: float = ACCURACY
    output_classes: dict[str, OutputClass] = field(default_factory=dict)
    given: dict[str, str] = field(default_factory=dict)
    """Who gave a time, or the class of an output: its key -> file and key, or option."""
    title: str = ""
    about: Told | None = None
    """What its scenario says (`language/content.py`, `content_of`); None of a foreign system."""
    body: Body | None = None
    """Mass and sides, where its craft file says them."""
    problems: list[str] = field(default_factory=list)
    """What is wrong with it, a line each."""
    warnings: list[str] = field(default_factory=list)
    """What was left out as it was put together."""

    def copy(self) -> Draft:
        """One that options may change without changing this one."""
        components = {
            name: replace(
                c, connectors=dict(c.connectors), parameters=dict(c.parameters),
                references=dict(c.references), units=dict(c.units), given=dict(c.given),
            )
            for name, c in self.components.items()
        }  # fmt: skip
        return replace(
            self, components=components, connections=list(self.connections),
            output_classes=dict(self.output_classes), given=dict(self.given),
            problems=list(self.problems), warnings=list(self.warnings),
        )  # fmt: skip

    def component(self, name: str, where: str) -> DraftComponent:
        """A component by its name. Raises DesatError, which begins with `where`."""
        if name not in self.components:
            raise DesatError(f"{where}: no component {name}{nearest(name, self.components)}")
        return self.components[name]

    def having(self, name: str) -> list[DraftComponent]:
        """The components that have a variable of this name."""
        return [c for c in self.components.values() if c.elements(name)]

    def interfaces(self) -> Iterable[Interface]:
        """The interfaces that are known."""
        return (c.interface for c in self.components.values() if c.interface is not None)

    def share(self, name: str, value: Any, where: str, key: str = "") -> None:
        """Give a parameter to every component that has it; what is wrong becomes problems."""
        owners = self.having(name)
        if not owners:
            known = {s.array for i in self.interfaces() for s in i.parameters}
            text = f"no component has a parameter {name}{nearest(name, known)}"
            self.problems.append(f"{where}: shared: {text}")
        for component in owners:
            self.try_to_assign(component, name, value, where, key)

    def try_to_assign(
        self, component: DraftComponent, name: str, value: Any, where: str, key: str = ""
    ) -> None:
        """Give a component's parameter its value, which stands in `where`, at `key` where that is a
        file; what is wrong becomes a problem."""
        at = f"{where}: {component.name}"
        if key.partition(".")[0] == "shared":
            at = f"{where}: {key}: {component.name}"
        try:
            component.assign(name, value, at)
            component.given[base_name(name)] = f"{where}: {key}" if key else where
        except DesatError as error:
            self.problems.append(str(error))


# ------------------------------------------------------------------------------------------------
# Another FMU in a component's place: what of the old one's wiring it does not want, and what of
# the craft's values it takes


def drop_unwanted(draft: Draft, component: DraftComponent) -> None:
    """Take out what the SSD wires or lists for a replaced component and its FMU does not have:
    connections, with a warning that names them, and connectors that nobody reads.

    An FMU in a role's place needs only the inputs that its law wants, and may lack an output of the
    role (a manager without thrusters): who reads that keeps its start value. Where it has none of
    those that are read, or a part of an array, they stay, so that the check misses them.
    """
    if component.interface is None:
        return
    name, signals = component.name, component.interface.signals
    fmu, bases = PurePath(component.source).name, component.interface.arrays
    unwanted = [c for c in draft.connections if c.target == name and c.input not in signals]
    if unwanted:
        whole = {c.input_array for c in unwanted}.difference(bases)
        names = (b if (b := c.input_array) in whole else c.input for c in unwanted)
        inputs = ", ".join(sorted(set(names)))
        draft.warnings.append(f"{name}: {fmu} has no input {inputs}: left unwired")
    missing = [c for c in draft.connections if c.source == name and c.output_array not in bases]
    if any(c.source == name and c not in missing for c in draft.connections):
        for output, reads in sorted(_by_output(missing).items()):
            hint = nearest(output, {s.array for s in component.interface.outputs})
            draft.warnings.append(
                f"{name}: {fmu} has no output {output}{hint}: {', '.join(reads)} "
                f"keep{'s' if len(reads) == 1 else ''} the start value"
            )
        for c in missing:
            draft.components[c.target].connectors.pop(c.input, None)
        unwanted += missing
    if unwanted:
        draft.connections = [c for c in draft.connections if c not in unwanted]
    read = {c.output for c in draft.connections if c.source == name}
    component.connectors = {
        key: c for key, c in component.connectors.items() if key in signals or key in read
    }


def _by_output(connections: Iterable[Connection]) -> dict[str, list[str]]:
    """The inputs that each output feeds, arrays as a whole."""
    feeds: dict[str, dict[str, None]] = {}
    for c in connections:
        feeds.setdefault(c.output_array, {})[f"{c.target}.{c.input_array}"] = None
    return {output: list(inputs) for output, inputs in feeds.items()}


def adopt_shared(draft: Draft, component: DraftComponent) -> None:
    """Give a replaced component the craft's values of the shared parameters that nobody gave it,
    in place of its own defaults, which are another craft's."""
    shared = {
        s.array for s in component.interface.parameters if s.shared
    } if component.interface else set()  # fmt: skip
    given = {base_name(name) for name in component.parameters} | component.references.keys()
    for name in sorted(shared - given):
        wanted = component.elements(name)
        owners = (
            c for c in draft.components.values()
            if c is not component and c.interface is not None and c.elements(name) == wanted
            and c.interface.signals[wanted[0]].shared
        )  # fmt: skip
        if (owner := next(owners, None)) is None or owner.interface is None:
            continue
        where = owner.given.get(name, "")
        if name in owner.references:
            component.references[name] = owner.references[name]
        else:
            for element in wanted:
                start = owner.interface.signals[element].start
                value = owner.parameters.get(element, start)
                if value is not None and not isinstance(value, str):
                    component.parameters[element] = value
                if unit := owner.units.get(element):
                    component.units[element] = unit
        if where:
            component.given[name] = where
