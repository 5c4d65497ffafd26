"""What is known of a component: its scalar variables and the class of its outputs.

Read from an FMU's model description (`files/fmu.py`) or from a bare block; both give
the same.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatch
from functools import cache, lru_cache
from itertools import product
from typing import Any, Literal, Protocol

from desat.components.contract import roles
from desat.components.contract.block import Block, Scalar
from desat.components.contract.units import Unit, conversion, unit_of
from desat.fmus.description import describe, title
from desat.fmus.registry import block_class

from .errors import DesatError, look_up, nearest

Kind = Literal["Real", "Integer", "Boolean"]
KINDS: tuple[Kind, ...] = ("Real", "Integer", "Boolean")
OutputClass = Literal["state", "interval", "undeclared"]


@dataclass(frozen=True)
class Signal:
    """One scalar variable of a component."""

    name: str
    causality: str
    kind: str
    reference: int
    unit_name: str = ""
    unit: Unit | None = None
    start: Scalar | str | None = None
    minimum: float | None = None
    maximum: float | None = None
    description: str = ""
    choices: tuple[str, ...] = ()
    output_class: OutputClass = "state"
    initial: bool = False
    """An input that is read in initialisation mode only."""
    mean: bool = False
    """An interval output that is a mean over the step, whose integral is handed on at
    any rates."""
    slope: str = ""
    """The output with the slope of this mean; empty where there is none."""
    shared: bool = False
    """All components of a system that have a parameter of this name must agree on it.
    """
    follows: str = ""
    """The product of the craft's parameters that it usually is; empty for most."""
    needed_by: tuple[str, ...] = ()
    """The component's parameters and inputs that have no effect where this input is
    neither wired nor given, or where this output reaches nobody."""
    usual: tuple[float, float] | None = None
    """The range outside of which a value is more likely a slip, in the variable's own
    unit."""
    type: str = ""
    """Of FMI 3.0 the variable's own, Float32 or UInt8 for instance."""
    element: int = 0
    """Of FMI 3.0 its place in its array, which `reference` has added to the array's."""
    alone: bool = False
    """An output that is recorded under its own name: its array is not numbered from 1
    in order."""

    array: str = field(init=False, repr=False, compare=False)
    """The variable that it is an element of; itself, where it is none."""
    series: str = field(init=False, repr=False, compare=False)
    """The variable whose series it is recorded in."""

    def __post_init__(self) -> None:
        array = self.name.partition("[")[0]
        object.__setattr__(self, "array", array)
        object.__setattr__(self, "series", self.name if self.alone else array)

    def named(self, value: Any) -> Any:
        """The name of a value, where it is a choice; else the value."""
        is_choice = isinstance(value, int) and 0 <= value < len(self.choices)
        return self.choices[value] if is_choice else value


@dataclass(frozen=True)
class Interface:
    """The variables of a component by name, in the order of its description."""

    model: str
    title: str
    signals: dict[str, Signal]
    role: str = ""
    fmi: str = "2.0"
    arrays: Mapping[str, tuple[Signal, ...]] = field(
        init=False, repr=False, compare=False
    )
    """The scalars of each variable by its name: of an array its elements."""
    elements: Mapping[str, tuple[Signal, ...]] = field(
        init=False, repr=False, compare=False
    )
    """The same, and each element by its own name, alone."""
    inputs: tuple[Signal, ...] = field(init=False, repr=False, compare=False)
    outputs: tuple[Signal, ...] = field(init=False, repr=False, compare=False)
    parameters: tuple[Signal, ...] = field(init=False, repr=False, compare=False)
    slopes: frozenset[str] = field(init=False, repr=False, compare=False)
    """The outputs that are the slope of a mean."""

    def __post_init__(self) -> None:
        """Sort the signals, once."""
        arrays: dict[str, list[Signal]] = {}
        sides: dict[str, list[Signal]] = {"input": [], "output": [], "parameter": []}
        for s in self.signals.values():
            arrays.setdefault(s.array, []).append(s)
            sides.setdefault(s.causality, []).append(s)
        whole = {name: tuple(of) for name, of in arrays.items()}
        found: dict[str, Any] = {
            "arrays": whole,
            "elements": whole | {s.name: (s,) for s in self.signals.values()},
            **{
                f"{side}s": tuple(sides[side])
                for side in ("input", "output", "parameter")
            },
            "slopes": frozenset(s.slope for s in self.signals.values() if s.slope),
        }
        for name, value in found.items():
            object.__setattr__(self, name, value)

    def of(self, causality: str) -> Iterator[Signal]:
        """The signals of one causality."""
        return (s for s in self.signals.values() if s.causality == causality)


def apart(outputs: Iterable[Signal]) -> dict[str, Signal]:
    """Of outputs in the order of their description those that make no series together,
    marked so: elements of an array that is not numbered from 1, whole, in order, in one
    row, of one class and one unit."""
    counts: dict[str, int] = {}
    arrays: dict[str, list[tuple[int, Signal]]] = {}
    for signal in outputs:
        place = counts[signal.kind] = counts.get(signal.kind, 0) + 1
        arrays.setdefault(signal.array, []).append((place, signal))
    return {
        s.name: replace(s, alone=True)
        for elements in arrays.values()
        if not _in_order(elements)
        for _, s in elements
    }


def _in_order(elements: list[tuple[int, Signal]]) -> bool:
    """Whether these are x, or x[1], x[2], ... or x[1,1], x[1,2], ... one behind the
    other."""
    first, signal = elements[0]
    base = signal.array
    if [s.name for _, s in elements] == [base]:
        return True
    found = [
        re.fullmatch(r"\[(\d+(?:,\d+)*)\]", s.name.removeprefix(base))
        for _, s in elements
    ]
    indices = [tuple(map(int, m[1].split(","))) if m else () for m in found]
    whole = list(product(*(range(1, n + 1) for n in indices[-1])))
    return indices == whole and all(
        place == first + k
        and (s.kind, s.output_class, s.unit_name)
        == (signal.kind, signal.output_class, signal.unit_name)
        for k, (place, s) in enumerate(elements)
    )


@lru_cache(maxsize=1 << 16)
def base_name(name: str) -> str:
    """`b_eci[2]` -> `b_eci`"""
    return name.partition("[")[0]


@cache
def interface_of_block(name: str) -> Interface:
    """The interface of one of our blocks, by its name."""
    return of_block(name, block_class(name))


def of_block(name: str, block: type[Block]) -> Interface:
    """The interface of a bare block."""
    signals: dict[str, Signal] = {}
    for v in block.variables:
        for element, start in zip(v.elements(), v.flat_start(), strict=True):
            real = v.type == "Real"
            signals[element] = Signal(
                name=element,
                causality=v.causality,
                kind=v.type,
                reference=len(signals),
                unit_name=v.unit if real else "",
                unit=unit_of(v.unit) if real else None,
                start=None if v.causality == "output" else start,
                minimum=v.minimum,
                maximum=v.maximum,
                description=describe(v),
                choices=v.choices,
                output_class="interval" if v.interval else "state",
                initial=v.initial,
                mean=v.mean,
                slope=element.replace(v.name, v.slope, 1) if v.slope else "",
                shared=v.shared,
                follows=v.follows,
                needed_by=v.needed_by,
                usual=v.usual,
            )
    return Interface(name, title(block), signals, block.role)


# --- What usually feeds which input, and whether one variable can feed another --------


@cache
def role_classes() -> dict[str, type[Block]]:
    """Return the class that declares each role, in the order of
    `components/contract/roles.py`."""
    return {
        c.role: c
        for c in vars(roles).values()
        if isinstance(c, type) and issubclass(c, Block) and "role" in vars(c) and c.role
    }


@cache
def usual_sources() -> dict[str, dict[str, tuple[str, ...]]]:
    """Return what usually feeds each input: role -> input -> `role.output`, the best
    first."""
    return {
        role: {v.name: v.source for v in c.variables if v.causality == "input"}
        for role, c in role_classes().items()
    }


@cache
def asked_for() -> frozenset[tuple[str, str]]:
    """Return role and input of those that are fed only where something of the block
    needs them."""
    inputs = [(role, v) for role, c in role_classes().items() for v in c.variables]
    return frozenset((role, v.name) for role, v in inputs if v.asked)


@cache
def computers() -> frozenset[str]:
    """Return the roles of flight computers, which know the craft by a model of it."""
    return frozenset(
        r for r, c in role_classes().items() if issubclass(c, roles.Computer)
    )


def names(interface: Interface, causality: str) -> dict[str, None]:
    """The variables of one causality, arrays by their names."""
    return dict.fromkeys(s.array for s in interface.of(causality))


def elements(interface: Interface, name: str, causality: str) -> dict[str, Signal]:
    """The scalars of a variable by what follows its name: nothing, `[1]`, `[3,4]`."""
    return {
        s.name.removeprefix(name): s
        for s in interface.elements.get(name, ())
        if s.causality == causality and s.array == name
    }


def misfit(outputs: dict[str, Signal], inputs: dict[str, Signal]) -> str:
    """Why an output cannot feed an input; nothing where it can."""
    if outputs.keys() != inputs.keys():
        return f"{len(outputs)} elements, {len(inputs)} are needed"
    for index, target in inputs.items():
        source = outputs[index]
        if source.kind != target.kind:
            return f"type {source.kind}, {target.kind} is needed"
        if source.unit and target.unit and conversion(source.unit, target.unit) is None:
            return f"unit {source.unit_name}, {target.unit_name} is needed"
    return ""


class HasInterface(Protocol):
    """A component, built or while its system is built."""

    @property
    def interface(self) -> Interface | None:
        """Its variables; None where its FMU is missing."""


def find_elements(
    components: Mapping[str, HasInterface], name: str, *causalities: str
) -> Sequence[Signal]:
    """Return the elements of `component.variable`; none where the component's FMU is
    missing.

    Raises
    ------
    DesatError
        If there is none of these causalities.
    """
    owner, _, variable = name.partition(".")
    interface = look_up(owner, components, "no component").interface
    if interface is None:
        return ()
    elements = interface.elements.get(variable, ())
    is_right = bool(elements) and elements[0].causality in causalities
    if not is_right or (
        elements[0].causality == "output" and elements[0].series != variable
    ):
        known = {s.series for c in causalities for s in interface.of(c)}
        raise DesatError(
            f"{owner} has no {causalities[0]} {variable}{nearest(variable, known)}"
        )
    return elements


def selects(patterns: Iterable[str], component: str, signal: Signal) -> bool:
    """True when `component.variable` fits one of the patterns (`manager.*`).

    `fault` must be named: a fault ends the run anyhow.
    """
    name = f"{component}.{signal.series}"
    if name in patterns:
        return True
    open_ = (p for p in patterns if "*" in p or "?" in p or "[" in p)
    return signal.name != "fault" and any(fnmatch(name, p) for p in open_)
