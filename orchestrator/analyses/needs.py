"""Check whether a craft has what our manager needs (`Manager.craft_needs`)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from desat.components.contract.fitting import Need, needs_of
from desat.components.contract.roles import Manager

from ..system.craft import craft_of
from ..system.model import Component, System
from ..system.options import Options
from ..system.wheels import axes_of, existing

ROWS = 64  # an array of more elements is a table
FLAT = 1e-3  # axes below this share of the longest singular value do not count


def problems(system: System) -> Iterator[str]:
    """Yield a line for each need of a manager that the craft does not meet.

    The manager would fly without effect.
    """
    for c in system.components.values():
        if c.interface.role != "manager" or c.block is None:
            continue
        block = c.block
        if not issubclass(block, Manager) or _is_off(c):
            continue
        if block.offers and _turns(system) and instead(Need.CONTROLLER, system, c.name):
            yield (
                f"{system.place}: {c.name}: {c.model} has no attitude law, "
                "and no other component controls the attitude: tau_ctrl_body is "
                "unconnected"
            )
        for need in needs_of(block):
            if has := instead(need, system, c.name):
                yield f"{system.place}: {c.name}: {c.model} needs {need.value}; {has}"


def design_problems(system: System, options: Options) -> Iterator[str]:
    """Yield a line where a manager of ours lacks the tables made for its craft.

    This concerns a manager that replaces another one, because a design is made with a
    manager that has no tables yet. Tables that declare what they are made for are
    checked by the provider of designs (`runs/provider.py`).
    """
    for c in system.components.values() if options.sources else ():
        if c.interface.role != "manager" or c.block is None:
            continue
        if "made_for" in c.interface.signals:
            continue
        block = c.block
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
                f"{system.place}: {c.name}: {c.model} needs {Need.DESIGN.value}; "
                f"{', '.join(tables)} {'is' if len(tables) == 1 else 'are'} 0"
            )


def _turns(system: System) -> bool:
    """Return whether torques determine the craft's attitude."""
    craft = craft_of(system).spacecraft
    return craft is not None and "omega_start_body" in craft.interface.arrays


def _is_off(manager: Component) -> bool:
    """Return whether a manager is disabled."""
    return "enable" in manager.interface.signals and not manager.values["enable"]


def instead(need: Need, system: System, manager: str) -> str:
    """Return what a craft has instead of a need of its manager.

    Empty where it meets the need, or where the need does not concern wires and
    hardware.
    """
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
    """Count the axes that the wheels of a craft span.

    There are three where the wheels are ideal ones within it, or not known.
    """
    if craft is None or "axes_wheel" not in craft.interface.arrays:
        return 3
    axes = axes_of(craft.values) * existing(craft.values)
    sizes = np.linalg.svd(axes, compute_uv=False)
    return int((sizes > FLAT * max(float(sizes[0]), 1e-300)).sum())
