"""Another FMU in a component's place: what of the old one's wiring it does not want."""

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
