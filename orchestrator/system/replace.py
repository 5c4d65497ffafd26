"""Another FMU in a component's place: what of the old one's wiring it does not want, and what of
the craft's values it takes."""

from __future__ import annotations

from pathlib import PurePath

from .draft import Draft, DraftComponent
from .interface import base_name


def drop_unwanted(draft: Draft, component: DraftComponent) -> None:
    """Take out what the SSD wires or lists for a replaced component and its FMU does not have:
    connections into inputs, with a warning that names them, and connectors that nobody reads.

    An FMU in a role's place needs only the inputs that its law wants. An output that somebody reads
    stays listed, so that the check misses it.
    """
    if component.interface is None:
        return
    name, signals = component.name, component.interface.signals
    unwanted = [c for c in draft.connections if c.target == name and c.input not in signals]
    if unwanted:
        whole = {base_name(c.input) for c in unwanted} - {base_name(s) for s in signals}
        names = (b if (b := base_name(c.input)) in whole else c.input for c in unwanted)
        inputs = ", ".join(sorted(set(names)))
        draft.warnings.append(
            f"{name}: {PurePath(component.source).name} has no input {inputs}: left unwired"
        )
        draft.connections = [c for c in draft.connections if c not in unwanted]
    read = {c.output for c in draft.connections if c.source == name}
    component.connectors = {
        key: c for key, c in component.connectors.items() if key in signals or key in read
    }


def adopt_shared(draft: Draft, component: DraftComponent) -> None:
    """Give a replaced component the craft's values of the shared parameters that nobody gave it,
    in place of its own defaults, which are another craft's."""
    shared = {
        base_name(s.name) for s in component.interface.of("parameter") if s.shared
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
