"""What usually feeds which input, and whether one variable can feed another."""

from __future__ import annotations

from functools import cache

from desat.components.contract import roles
from desat.components.contract.block import Block
from desat.components.contract.units import conversion

from .interface import Interface, Signal, base_name


@cache
def usual_sources() -> dict[str, dict[str, tuple[str, ...]]]:
    """What usually feeds each input: role -> input -> `role.output`, the best first."""
    return {
        c.role: {v.name: v.source for v in c.variables if v.causality == "input"}
        for c in vars(roles).values()
        if isinstance(c, type) and issubclass(c, Block) and c.role
    }


@cache
def computers() -> frozenset[str]:
    """The roles of flight computers, which know the craft by a model of it."""
    return frozenset(
        c.role for c in vars(roles).values()
        if isinstance(c, type) and issubclass(c, roles.Computer) and c.role
    )  # fmt: skip


def names(interface: Interface, causality: str) -> dict[str, None]:
    """The variables of one causality, arrays by their names."""
    return dict.fromkeys(base_name(s.name) for s in interface.of(causality))


def elements(interface: Interface, name: str, causality: str) -> dict[str, Signal]:
    """The scalars of a variable by what follows its name: nothing, `[1]`, `[3,4]`."""
    return {
        s.name.removeprefix(name): s
        for s in interface.elements(name)
        if s.causality == causality and base_name(s.name) == name
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
