"""Find what can be wrong with a system before it runs, a line each."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass
from functools import lru_cache

from desat.components.contract.block import Block, BlockError, Scalar
from desat.fmus.registry import Sizes, block_class

from .errors import DesatError, nearest
from .expression import names_in, values_of
from .interface import Signal, base_name, computers, interface_of_block
from .model import Component, System
from .refusal import REFUSES, explain


def incomplete_inputs(system: System) -> Iterator[str]:
    """Find listed inputs of our roles without source or value, and arrays in part."""
    wired_ends = {(c.target, c.input) for c in system.connections}
    for c in system.components.values():
        for connector in c.connectors.values():
            name = connector.name
            has_value = (c.name, name) in wired_ends or name in c.parameters
            if connector.kind == "input" and not has_value and c.interface.role:
                yield (
                    f"{system.place}:{connector.line}: {c.name}.{name} is listed, but has "
                    "neither a connection nor a value"
                )
        for array, missing in (
            _missing_elements(c, wired_ends) if c.interface.role else ()
        ):
            yield (
                f"{system.place}:{c.line}: {c.name}.{array} is wired in part: "
                f"{', '.join(missing)} has neither a connection nor a value"
            )


def partial_inputs(system: System) -> Iterator[str]:
    """Find arrays of foreign FMUs that are wired or given in part, a line each."""
    wired_ends = {(c.target, c.input) for c in system.connections}
    for c in system.components.values():
        if c.interface.role:
            continue
        for array, missing in _missing_elements(c, wired_ends):
            names = ", ".join(missing[:3]) + (" ..." if len(missing) > 3 else "")
            unknown = c.interface.fmi == "3.0" and any(
                c.interface.signals[e].start is None for e in missing
            )
            zeros = "are 0, as their start values are not known"
            yield (
                f"{system.place}:{c.line}: {c.name}.{array} is wired or given in part: "
                f"{names} of {len(c.interface.arrays[array])} "
                f"{zeros if unknown else 'keep the start values of the FMU'}"
            )


def _missing_elements(
    component: Component, wired_ends: Set[tuple[str, str]]
) -> Iterator[tuple[str, list[str]]]:
    """Yield the arrays of inputs that are wired or given in part, and what is missing."""
    arrays: dict[str, list[str]] = defaultdict(list)
    for signal in component.interface.inputs:
        arrays[signal.array].append(signal.name)
    for array, elements in arrays.items():
        missing = [
            e
            for e in elements
            if (component.name, e) not in wired_ends and e not in component.parameters
        ]
        if 0 < len(missing) < len(elements):
            yield array, missing


def unset_inputs(system: System) -> Iterator[str]:
    """Find listed inputs of foreign FMUs without source or value.

    There is one line per component.
    """
    wired_ends = {(c.target, c.input) for c in system.connections}
    for c in system.components.values():
        open_ = [
            name
            for name, connector in c.connectors.items()
            if connector.kind == "input"
            and (c.name, name) not in wired_ends
            and name not in c.parameters
            and not c.interface.role
        ]
        if open_:
            yield (
                f"{system.place}:{c.line}: {c.name}: {', '.join(open_)} "
                f"{'is' if len(open_) == 1 else 'are'} listed, but neither wired nor given: the "
                "FMU's start value stays"
            )


def unequal_shared(system: System) -> Iterator[str]:
    """Find parameters declared as shared whose values differ between components."""
    for c, signal, owner, other in _differing(system):
        if c.interface.role not in computers():
            text = _compared(c, signal.name, owner, other)
            yield f"{system.place}: {text}: the two must be equal"


def errors_of_models(system: System) -> Iterator[str]:
    """Find shared parameters of flight computers that differ from the craft's.

    The computer's model of the craft is in error then, which may be what is studied.
    There is one line for each parameter of a component.
    """
    lines: dict[tuple[str, str], str] = {}
    for c, signal, owner, other in _differing(system):
        if c.interface.role in computers():
            place = c.origins.get(signal.array, f"{system.place}: default")
            text = _compared(c, signal.name, owner, other)
            line = f"{place}: {text}: what runs onboard errs about it"
            lines.setdefault((c.name, signal.array), line)
    yield from lines.values()


def _differing(system: System) -> Iterator[tuple[Component, Signal, str, object]]:
    """Yield component and parameter, and the component and value that it differs from."""
    values: dict[str, tuple[str, object]] = {}
    # the craft comes first, because a computer's model describes it
    for c in sorted(
        system.components.values(), key=lambda c: c.interface.role in computers()
    ):
        for signal in c.interface.parameters:
            if not signal.shared:
                continue
            value = c.values[signal.name]
            owner, other = values.setdefault(signal.name, (c.name, value))
            if value != other:
                yield c, signal, owner, other


def _compared(c: Component, name: str, owner: str, other: object) -> str:
    """Format the two values of a shared parameter."""
    return f"{c.name}.{name} = {c.values[name]}, but {owner}.{name} = {other}"


def values_of_another_craft(system: System) -> Iterator[str]:
    """Find parameters that differ from what they usually are for the craft.

    Blocks declare the usual product (`follows`). A scenario that extends another
    craft's may still have the values of that craft. There is no warning if the scenario
    gives a product of parameters, if it gives neither side, or for values of no
    particular craft: 0 (off), and a multiple of the identity matrix.
    """
    parameters = dict(system.parameters)
    parameters |= {
        c.interface.role: parameters[c.name]
        for c in system.components.values()
        if c.name in parameters and c.interface.role not in parameters
    }
    for c in system.components.values():
        for name, text in {
            s.array: s.follows for s in c.interface.parameters if s.follows
        }.items():
            if name in c.references:
                continue
            try:
                usual = [
                    float(x) for x in values_of(c, name, text, parameters).values()
                ]
            except DesatError:  # the craft has no such value, or several that differ
                continue
            signals = c.interface.elements.get(name, ())
            values = [float(str(c.values[s.name])) for s in signals]
            ends = [
                parameters[owner][p]
                for owner, _, p in (n.partition(".") for n in names_in(text))
            ]
            is_given = any(s.name in c.parameters for s in signals) or any(
                e.given for e in ends
            )
            least = 1e-9 * max(map(abs, usual))
            apart = [i for i, x in enumerate(values) if abs(x - usual[i]) > least]
            if not (is_given and apart) or _of_no_craft(values):
                continue
            i, unit = apart[0], signals[0].unit_name
            place = c.origins.get(name, f"{system.place}: default")
            unit = f" {unit}" if unit not in ("", "1") else ""
            yield (
                f"{place}: {c.name}.{signals[i].name} = {values[i]:g}{unit}, where {text} is "
                f'{usual[i]:g}{unit}: does it belong to another craft? Written as "{text}" '
                "or a multiple of it, it follows the craft"
            )


def _of_no_craft(values: list[float]) -> bool:
    """Return whether all values are 0 or a multiple of the identity (3, 3)."""
    matrix = len(values) == 9 and [values[0] * (i % 4 == 0) for i in range(9)]
    return not any(values) or values == matrix


def misfit_sample_times(system: System) -> Iterator[str]:
    """Check that sample times and delays are whole numbers of a component's steps.

    This applies to every sample time of a component that takes samples.
    """
    for c in system.components.values():
        step = system.step * c.step_ratio
        names = [
            n for n in c.interface.signals if n.endswith("sample_time") or n == "delay"
        ]
        for name in names if "sample_time" in names else ():
            sample = c.values[name]
            ratio = float(sample) / step if isinstance(sample, (int, float)) else 0.0
            if ratio and (ratio < 1.0 - 1e-9 or abs(ratio - round(ratio)) > 1e-6):
                yield (
                    f"{system.place}: {c.name}.{name} = {sample:g} s is not a multiple of "
                    f"its step {step:g} s"
                )


def wrong_output_classes(system: System, origins: Mapping[str, str]) -> Iterator[str]:
    """Check that overridden classes exist and belong to outputs.

    `origins` holds the source of each override.
    """
    for key, value in system.output_classes.items():
        place = origins.get(key, f"{system.place}: output_classes")
        owner, _, name = key.partition(".")
        component = system.components.get(owner)
        if component is None:
            yield f"{place}: no component {owner}{nearest(owner, system.components)}"
        elif not any(
            s.causality == "output" for s in component.interface.elements.get(name, ())
        ):
            yield f"{place}: {owner} has no output {name}"
        if value not in ("state", "interval"):
            yield f'{place}: {key} = "{value}"; state or interval is needed'


# --------------------------------------------------------------------------------------
# Open ends of a system: inputs at their default, unused outputs, and the parameters that
# have no effect because of them


@dataclass(frozen=True)
class Unwired:
    """Inputs of a component at their default, and its unused outputs, by name."""

    inputs_at_default: tuple[str, ...]
    outputs_unread: tuple[str, ...]

    def text(self, component: str) -> str:
        """Describe the open ends in one line; empty if there are none."""
        parts = [
            f"{finding}: {', '.join(names)}"
            for finding, names in (
                ("unconnected inputs at their default", self.inputs_at_default),
                ("unused outputs", self.outputs_unread),
            )
            if names
        ]
        return f"{component}: {'; '.join(parts)}" if parts else ""


def unwired(system: System) -> dict[str, Unwired]:
    """Find the inputs and outputs of each component that are not connected.

    `fault` is for the master and is left out.
    """
    wired_inputs, read = system.fed, system.read
    result = {}
    for c in system.components.values():
        with_value = {base_name(name) for name in c.parameters}
        inputs = dict.fromkeys(s.array for s in c.interface.inputs)
        outputs = dict.fromkeys(s.array for s in c.interface.outputs)
        result[c.name] = Unwired(
            tuple(
                n
                for n in inputs
                if (c.name, n) not in wired_inputs and n not in with_value
            ),
            tuple(n for n in outputs if (c.name, n) not in read and n != "fault"),
        )
    return result


def without_effect(system: System, open_ends: Mapping[str, Unwired]) -> Iterator[str]:
    """Find parameters and wired inputs that have no effect.

    There is one problem for each such variable and each variable that it needs but that
    is open.
    """
    wired_inputs = system.fed
    for c in system.components.values():
        mine = open_ends[c.name]
        needed_by = {name: of[-1].needed_by for name, of in c.interface.arrays.items()}
        for name in (*mine.inputs_at_default, *mine.outputs_unread):
            for other in needed_by[name]:
                if (c.name, other) in wired_inputs:
                    user = f"{c.name}.{other} is wired and"
                elif any(c.values[s.name] for s in c.interface.elements.get(other, ())):
                    user = f"{c.name}.{other}{_value_text(c, other)}"
                else:
                    continue
                lack = (
                    "which is neither wired nor given"
                    if name in mine.inputs_at_default
                    else "an unused output"
                )
                yield f"{system.place}: {user} needs {name}, {lack}"


def _value_text(c: Component, name: str) -> str:
    """Format ` = value` of a scalar, with a choice by its name.

    The text is empty for an array.
    """
    signal = c.interface.signals.get(name)
    if signal is None:
        return ""
    value = c.values[name]
    if not signal.choices and isinstance(value, bool):
        return f" = {str(value).lower()}"
    return f" = {signal.named(value)}"


# ------------------------------------------------------------------------------------------------
# Findings before a run: values outside the usual range, and what blocks of ours foresee. From its
# parameters and the times of the run a block foresees (`Block.foresee`) where its model becomes
# invalid and which inputs it lacks to have an effect. Other FMUs cannot do so.


def foresee(
    system: System, open_ends: Mapping[str, Unwired]
) -> tuple[list[str], list[str]]:
    """Return the problems and warnings that are known before a run, a line each."""
    problems: list[str] = []
    warnings: list[str] = []
    for c in system.components.values():
        warnings += _unusual(c, system.place)
        problems += _no_attitudes(c, system.place)
        if not _foresees(c):
            continue
        ends = open_ends[c.name]
        unwired = {*ends.inputs_at_default, *ends.outputs_unread}
        wired_inputs = frozenset(c.interface.arrays.keys() - unwired)
        start_values = tuple(
            (c.interface.signals[n].reference, x) for n, x in c.parameters.items()
        )
        lines, refusal = _of_block(
            c.model,
            c.interface.sizes,
            start_values,
            system.start,
            system.stop,
            wired_inputs,
        )
        for line in lines:
            warnings += explain(system, f"{c.name}: {REFUSES}{line}")
        problems += explain(system, f"{c.name}: {REFUSES}{refusal}") if refusal else []
    return list(dict.fromkeys(problems)), list(dict.fromkeys(warnings))


def _unusual(c: Component, place: str) -> Iterator[str]:
    """Find variables whose values are allowed, but outside the usual range.

    There is one line per variable.
    """
    told_of: set[str] = set()
    for name, value in c.parameters.items():
        signal, base = c.interface.signals[name], base_name(name)
        if signal.usual is None or base in told_of:
            continue
        low, high = signal.usual
        if not low <= value <= high:
            told_of.add(base)
            unit = f" {signal.unit_name}" if signal.unit_name not in ("", "1") else ""
            yield (
                f"{c.origins.get(base, place)}: {c.name}.{name} = {value:g}{unit}: usual is "
                f"{low:g} to {high:g}{unit}"
            )


def _no_attitudes(c: Component, place: str) -> Iterator[str]:
    """Find quaternions (q_..., scalar last) that are zero and thus no attitude.

    There is one line for each.
    """
    for name in {base_name(n) for n in c.parameters if n.startswith("q_")}:
        values = [
            c.parameters.get(s.name, s.start)
            for s in c.interface.elements.get(name, ())
        ]
        if len(values) == 4 and not any(values):
            yield (
                f"{c.origins.get(name, place)}: {c.name}.{name} = (0, 0, 0, 0): "
                "a quaternion of norm 0 is no attitude; the identity is (0, 0, 0, 1)"
            )


def _foresees(c: Component) -> bool:
    """Return whether a component is a block of ours that implements `foresee`.

    It must have the variables of that block.
    """
    if c.block is None or c.block.foresee is Block.foresee:
        return False
    bare = interface_of_block(c.model, c.interface.sizes)
    return c.interface.signals.keys() == bare.signals.keys()


@lru_cache(maxsize=256)
def _of_block(
    model: str,
    sizes: Sizes,
    start_values: tuple[tuple[int, Scalar], ...],
    begin: float,
    end: float,
    wired_inputs: frozenset[str],
) -> tuple[tuple[str, ...], str]:
    """Return what a block foresees with these values, and what it refuses.

    Values are given by variable number. The result is empty if the block does not
    start; that is reported when it does.
    """
    block = block_class(model, sizes)()
    block.access([k for k, _ in start_values]).write([x for _, x in start_values])
    try:
        block.check()
        block.start()
    except Exception:
        return (), ""
    lines: list[str] = []
    try:
        lines += block.foresee(begin, end, wired_inputs)
    except BlockError as error:
        return tuple(lines), str(error)
    return tuple(lines), ""
