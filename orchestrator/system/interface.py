"""Describe the interface of a component: scalar variables and classes of outputs.

It is read from an FMU's model description (`files/fmu.py`) or from a bare block; both
give the same.
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
from desat.fmus.registry import Sizes, block_class

from .errors import DesatError, look_up, nearest

Kind = Literal["Real", "Integer", "Boolean", "String"]
# The kinds of values that are recorded, and those that connections move.
KINDS: tuple[Kind, ...] = ("Real", "Integer", "Boolean")
MOVED_KINDS: tuple[Kind, ...] = (*KINDS, "String")
# An element's name: that of its array, then its index.
_ELEMENT = re.compile(r"(.+)\[([0-9]+(?:, *[0-9]+)*)\]", re.DOTALL)
OutputClass = Literal["state", "interval", "undeclared"]


@dataclass(frozen=True)
class Signal:
    """Scalar variable of a component."""

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
    initial: bool = False  # an input that is read in initialisation mode only
    # an interval output that is a mean over the step; its integral is preserved at any
    # rates
    mean: bool = False
    slope: str = ""  # the output with the slope of this mean; empty if there is none
    # all components of a system with a parameter of this name must agree on it
    shared: bool = False
    # the product of the craft's parameters to which it is usually equal; mostly empty
    follows: str = ""
    # the component's parameters and inputs that have no effect if this input is neither
    # wired nor given, or if this output is unused
    needed_by: tuple[str, ...] = ()
    # the usual range, in the variable's own unit; a value outside is probably a mistake
    usual: tuple[float, float] | None = None
    type: str = ""  # FMI 3.0 only: the variable's type, such as Float32 or UInt8
    element: int = 0  # FMI 3.0 only: index in its array; `reference` includes it
    # whether a scenario may give its value: it may be set before initialisation (inputs,
    # parameters, and what has `initial` exact or approx)
    settable: bool = False
    # an output that is recorded under its own name, as its array is not numbered from 1
    # in order
    alone: bool = False

    # the variable of which it is an element, or itself
    array: str = field(init=False, repr=False, compare=False)
    # the variable in whose series it is recorded
    series: str = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        array = base_name(self.name)
        object.__setattr__(self, "array", array)
        object.__setattr__(self, "series", self.name if self.alone else array)

    def named(self, value: Any) -> Any:
        """Return the name of a choice; any other value is returned unchanged."""
        is_choice = isinstance(value, int) and 0 <= value < len(self.choices)
        return self.choices[value] if is_choice else value


@dataclass(frozen=True)
class Interface:
    """Variables of a component by name, in the order of its description."""

    model: str
    title: str
    signals: dict[str, Signal]
    role: str = ""
    fmi: str = "2.0"
    sizes: Sizes = ()  # lengths of a block of ours that are not the usual ones
    # the scalars of each variable by its name; for an array all elements
    arrays: Mapping[str, tuple[Signal, ...]] = field(
        init=False, repr=False, compare=False
    )
    # the same, and in addition each element by its own name
    elements: Mapping[str, tuple[Signal, ...]] = field(
        init=False, repr=False, compare=False
    )
    inputs: tuple[Signal, ...] = field(init=False, repr=False, compare=False)
    outputs: tuple[Signal, ...] = field(init=False, repr=False, compare=False)
    parameters: tuple[Signal, ...] = field(init=False, repr=False, compare=False)
    # the outputs that are the slope of a mean
    slopes: frozenset[str] = field(init=False, repr=False, compare=False)
    # the parameters of FMI 3.0 from which the lengths of arrays follow
    structural: frozenset[str] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Sort the signals, once."""
        arrays: dict[str, list[Signal]] = {}
        sides: dict[str, list[Signal]] = {"input": [], "output": [], "parameter": []}
        for s in self.signals.values():
            arrays.setdefault(s.array, []).append(s)
            sides.setdefault(s.causality, []).append(s)
        complete = {name: tuple(of) for name, of in arrays.items()}
        tables: dict[str, Any] = {
            "arrays": complete,
            "elements": complete | {s.name: (s,) for s in self.signals.values()},
            **{
                f"{side}s": tuple(sides[side])
                for side in ("input", "output", "parameter")
            },
            "structural": frozenset(
                s.name for s in sides.get("structuralParameter", ())
            ),
            "slopes": frozenset(s.slope for s in self.signals.values() if s.slope),
        }
        for name, value in tables.items():
            object.__setattr__(self, name, value)

    def of(self, causality: str) -> Iterator[Signal]:
        """Return the signals of one causality."""
        return (s for s in self.signals.values() if s.causality == causality)


# of a component whose FMU is missing, which is a problem already
MISSING = Interface("", "", {})


def apart(outputs: Iterable[Signal]) -> dict[str, Signal]:
    """Find outputs that cannot form one series with the rest of their array.

    They are returned marked as `alone`. The outputs come in the order of their
    description. A series needs an array that is complete, numbered from 1 in order,
    contiguous, and of one class and one unit.
    """
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
    """Return whether the elements are x, or x[1], x[2], ..., or x[1,1], x[1,2], ...

    They must be contiguous and of one type, class and unit.
    """
    first, signal = elements[0]
    if [s.name for _, s in elements] == [signal.array]:
        return True
    matches = [_ELEMENT.fullmatch(s.name) for _, s in elements]
    indices = [tuple(map(int, m[2].split(","))) if m else () for m in matches]
    every_index = list(product(*(range(1, n + 1) for n in indices[-1])))
    return indices == every_index and all(
        place == first + k
        and (s.kind, s.output_class, s.unit_name)
        == (signal.kind, signal.output_class, signal.unit_name)
        for k, (place, s) in enumerate(elements)
    )


def is_mean(name: str) -> bool:
    """Return whether a series holds means or slopes over each step."""
    return "_mean_" in name or "_slope_" in name


@lru_cache(maxsize=1 << 16)
def base_name(name: str) -> str:
    """Return the name of the array of an element: `b_eci` for `b_eci[2]`.

    Only an index at the end is one of an array of scalars: `a[1].b` is a name as a
    whole.
    """
    match = _ELEMENT.fullmatch(name) if name.endswith("]") else None
    return match[1] if match else name


@cache
def interface_of_block(name: str, sizes: Sizes = ()) -> Interface:
    """Return the interface of one of our blocks, by its name and lengths."""
    return of_block(name, block_class(name, sizes))


def of_block(name: str, block: type[Block]) -> Interface:
    """Build the interface of a bare block."""
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
                settable=v.causality in ("input", "parameter"),
                mean=v.mean,
                slope=element.replace(v.name, v.slope, 1) if v.slope else "",
                shared=v.shared,
                follows=v.follows,
                needed_by=v.needed_by,
                usual=v.usual,
            )
    sizes = tuple(sorted(block.sizes.items()))
    return Interface(name, title(block), signals, block.role, sizes=sizes)


# --- Usual sources of inputs, and compatibility of outputs and inputs -----------------


@cache
def role_classes() -> dict[str, type[Block]]:
    """Return the class that declares each role.

    The order is that of `components/contract/roles.py`.
    """
    return {
        c.role: c
        for c in vars(roles).values()
        if isinstance(c, type) and issubclass(c, Block) and "role" in vars(c) and c.role
    }


@cache
def usual_sources() -> dict[str, dict[str, tuple[str, ...]]]:
    """Return the usual source of each input: role -> input -> `role.output`.

    The best source comes first.
    """
    return {
        role: {v.name: v.source for v in c.variables if v.causality == "input"}
        for role, c in role_classes().items()
    }


@cache
def asked_for() -> frozenset[tuple[str, str]]:
    """Return role and input of those inputs that are wired only on demand.

    They are wired only if something in the block needs them.
    """
    inputs = [(role, v) for role, c in role_classes().items() for v in c.variables]
    return frozenset((role, v.name) for role, v in inputs if v.only_if_needed)


@cache
def computers() -> frozenset[str]:
    """Return the roles of flight computers, which know the craft by a model of it."""
    return frozenset(
        r for r, c in role_classes().items() if issubclass(c, roles.Computer)
    )


def names(interface: Interface, causality: str) -> dict[str, None]:
    """Return the names of the variables of one causality; an array has one name."""
    return dict.fromkeys(s.array for s in interface.of(causality))


def elements(interface: Interface, name: str, causality: str) -> dict[str, Signal]:
    """Return the scalars of a variable by the suffix of their name.

    The suffix is empty, `[1]` or `[3,4]`.
    """
    return {
        s.name.removeprefix(name): s
        for s in interface.elements.get(name, ())
        if s.causality == causality and s.array == name
    }


def misfit(outputs: dict[str, Signal], inputs: dict[str, Signal]) -> str:
    """Explain why an output cannot feed an input; empty if it can."""
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
    """A component, or something else with its variables."""

    @property
    def interface(self) -> Interface:
        """Return its variables."""


def find_elements(
    components: Mapping[str, HasInterface], name: str, *causalities: str
) -> Sequence[Signal]:
    """Return the elements of `component.variable`.

    The result is empty if the component's FMU is missing.

    Raises
    ------
    DesatError
        If there is no such variable of these causalities.
    """
    owner, _, variable = name.partition(".")
    interface = look_up(owner, components, "no component").interface
    if interface is MISSING:
        return ()
    elements = interface.elements.get(variable, ())
    is_right = bool(elements) and elements[0].causality in causalities
    if not is_right or (
        elements[0].causality == "output" and elements[0].series != variable
    ):
        series_names = {s.series for c in causalities for s in interface.of(c)}
        raise DesatError(
            f"{owner} has no {causalities[0]} {variable}{nearest(variable, series_names)}"
        )
    return elements


def selects(patterns: Iterable[str], component: str, signal: Signal) -> bool:
    """Return whether `component.variable` matches one of the patterns (`manager.*`).

    `fault` must be named: a fault ends the run in any case. A reference attitude
    selects what its guidance wants with it, against which errors are taken.
    """
    names = [f"{component}.{signal.series}"]
    if signal.series == roles.WANTED_ATTITUDE:
        names.append(f"{component}.{roles.HELD_ATTITUDE}")
    if any(name in patterns for name in names):
        return True
    open_ = [p for p in patterns if "*" in p or "?" in p or "[" in p]
    return signal.name != "fault" and any(
        fnmatch(name, p) for name in names for p in open_
    )
