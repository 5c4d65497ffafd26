"""What a manager of ours needs of a craft to be of any use (`Manager.craft_needs`), and
what the craft has instead."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from desat.components.contract.fitting import Need, needs_of
from desat.components.contract.roles import Manager
from desat.fmus.registry import block_class, names

from ..system.craft import craft_of
from ..system.model import Component, System
from ..system.options import Options
from ..system.wheels import axes_of, existing

ROWS = 64
"""An array of more elements is a table."""
FLAT = 1e-3
"""Axes count up to this part of the longest."""


def problems(system: System) -> Iterator[str]:
    """A line for each thing that a manager needs and the craft has not: it would fly
    without doing anything."""
    for c in system.components.values():
        if c.interface.role != "manager" or c.interface.model not in names():
            continue
        block = block_class(c.interface.model)
        if not issubclass(block, Manager) or _is_off(c):
            continue
        if block.offers and _turns(system) and instead(Need.CONTROLLER, system, c.name):
            yield (
                f"{system.where}: {c.name}: {c.interface.model} has no attitude law, "
                "and no other component controls the attitude: tau_ctrl_body is "
                "unconnected"
            )
        for need in needs_of(block):
            if has := instead(need, system, c.name):
                yield f"{system.where}: {c.name}: {c.interface.model} needs {need.value}; {has}"


def design_problems(system: System, options: Options) -> Iterator[str]:
    """A line where a manager of ours needs tables made for one craft and has none: of
    one that is put in another's place, as a design is made with a manager that has none
    yet. Tables that say what they are made for are looked at by who provides designs
    (`runs/provider.py`)."""
    for c in system.components.values() if options.sources else ():
        if c.interface.role != "manager" or c.interface.model not in names():
            continue
        if "made_for" in c.interface.signals:
            continue
        block = block_class(c.interface.model)
        tables = [
            v.name
            for v in block.variables
            if v.causality == "parameter" and v.size > ROWS
        ]
        if not (
            issubclass(block, Manager) and Need.DESIGN in needs_of(block)
        ) or _is_off(c):
            continue
        if not any(x for t in tables for x in c.values[t]):
            yield (
                f"{system.where}: {c.name}: {c.interface.model} needs {Need.DESIGN.value}; "
                f"{', '.join(tables)} {'is' if len(tables) == 1 else 'are'} 0"
            )


def _turns(system: System) -> bool:
    """Whether the craft's attitude is what torques make of it."""
    craft = craft_of(system).spacecraft
    return craft is not None and "omega_start_body" in craft.interface.arrays


def _is_off(manager: Component) -> bool:
    return "enable" in manager.interface.signals and not manager.values["enable"]


def instead(need: Need, system: System, manager: str) -> str:
    """What a craft has instead of what its manager needs; nothing where it has that, or
    where it is no matter of wires and hardware."""
    craft, sends = (
        craft_of(system),
        {output for name, output in system.read if name == manager},
    )
    if need is Need.WHEELS:
        axes = _axes(craft.spacecraft)
        return "" if axes == 3 else f"the craft's span {axes} of them"
    if need is Need.COILS:
        coils = craft.coils
        there = (
            coils is None
            or "m_limit" not in coils.interface.signals
            or (coils.values["m_limit"] > 0.0)
        )
        return "" if there and "m_cmd_body" in sends else "the craft has none"
    if need is Need.THRUSTERS:
        return "" if "tau_cmd_thruster_body" in sends else "the craft has none"
    if need is Need.CONTROLLER:
        return "" if (manager, "tau_ctrl_body") in system.fed else "the craft has none"
    return ""


def _axes(craft: Component | None) -> int:
    """How many axes the wheels of a craft span; three where they are ideal ones within
    it, or it is not known."""
    if craft is None or "axes_wheel" not in craft.interface.arrays:
        return 3
    axes = axes_of(craft.values) * existing(craft.values)
    sizes = np.linalg.svd(axes, compute_uv=False)
    return int((sizes > FLAT * max(float(sizes[0]), 1e-300)).sum())
