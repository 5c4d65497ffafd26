"""Put another FMU in the place of a component, which keeps what both declare alike."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import PurePath

from ..system.errors import DesatError, nearest, require
from ..system.interface import MISSING, Interface, base_name
from ..system.model import Component, Connection, Fmu
from ..system.parameters import expand
from . import library
from .draft import Draft


def replace_fmu(
    draft: Draft,
    name: str,
    source: str,
    fmu: Fmu | None,
    origin: str,
    label: str,
    blocks: bool,
    given_names: Sequence[str] | None = None,
) -> None:
    """Replace the FMU of a component.

    Values of variables that both FMUs declare alike are preserved; a warning names the
    others.

    Parameters
    ----------
    draft
        The system.
    name
        The component.
    source, fmu
        The file as the system names it, and the FMU; None: there is none.
    origin
        Option, or file and key, of the replacement.
    label
        The FMU in messages.
    blocks
        Whether the bare block of the FMU's name runs.
    given_names
        Variables that the same options give a value; None: a scenario replaces it.

    Raises
    ------
    DesatError
        If there is no such component.
    """
    require(name, draft.components, f"{origin}: no component")
    old = draft.components[name]
    draft.unchecked[name] = origin
    interface = MISSING
    try:
        interface = library.interface_of(source, fmu, blocks)
    except DesatError as error:
        draft.problems.append(f"{origin}: {name}: {error}")
    alike = {
        key for key in old.interface.signals if _is_alike(key, old.interface, interface)
    }
    component = replace(
        old,
        source=source,
        fmu=None if blocks else fmu,
        interface=interface,
        parameters={k: x for k, x in old.parameters.items() if k in alike},
        references={
            k: text
            for k, text in old.references.items()
            if alike.issuperset(s.name for s in old.interface.elements.get(k, ()))
        },
        origins=dict(old.origins),
    )
    draft.components[name] = component
    if interface is MISSING:
        return
    for key, value in component.parameters.items():
        place = old.origins.get(base_name(key), draft.place)
        try:
            expand(interface, key, value, f"{place}: {name}")
        except DesatError as error:
            draft.refused[name, base_name(key)] = str(error)
    dropped = dict.fromkeys(base_name(k) for k in old.parameters if k not in alike)
    if given_names is None:
        # a default of the craft may go; a value for this component is told of
        own_key = f"parameters.{name}."
        dropped_names = [k for k in dropped if own_key in old.origins.get(k, "")]
        of_whom = "the craft"
    else:
        dropped_names = [k for k in dropped if k not in given_names]
        of_whom = "the FMU that it replaces"
    if dropped_names:
        draft.warnings.append(
            f"{name}: {label} does not take {', '.join(dropped_names)} of {of_whom}"
        )
    _drop_unwanted(draft, component)


def _is_alike(key: str, old: Interface, new: Interface) -> bool:
    """Return whether two FMUs declare a variable alike."""
    if key not in new.signals:
        return False
    before, after = old.signals[key], new.signals[key]
    facts = ("causality", "kind", "unit", "choices")
    return all(getattr(before, fact) == getattr(after, fact) for fact in facts)


def _drop_unwanted(draft: Draft, component: Component) -> None:
    """Remove connections and connectors that a replaced component's FMU lacks.

    An FMU in a role's place needs only the inputs that its law uses, and may lack an
    output of the role (a manager without thrusters): an input that reads it keeps its
    start value. If it has none of the outputs that are read, or lacks part of an array,
    the connections stay, so that they become problems.
    """
    name, signals = component.name, component.interface.signals
    fmu, bases = PurePath(component.source).name, component.interface.arrays
    unwanted = [
        c for c in draft.connections if c.target == name and c.input not in signals
    ]
    if unwanted:
        arrays = {c.input_array for c in unwanted}.difference(bases)
        names = {
            c.input_array if c.input_array in arrays else c.input for c in unwanted
        }
        draft.warnings.append(
            f"{name}: {fmu} has no input {', '.join(sorted(names))}: left unwired"
        )
    outgoing = [c for c in draft.connections if c.source == name]
    missing = [c for c in outgoing if c.output_array not in bases]
    if len(missing) < len(outgoing):
        for output, inputs in sorted(_by_output(missing).items()):
            hint = nearest(output, {s.array for s in component.interface.outputs})
            draft.warnings.append(
                f"{name}: {fmu} has no output {output}{hint}: {', '.join(inputs)} "
                f"keep{'s' if len(inputs) == 1 else ''} the start value"
            )
        for c in missing:
            _forget_connectors(draft, c.target, {c.input})
        unwanted += missing
    if unwanted:
        draft.connections = [c for c in draft.connections if c not in unwanted]
    read = {c.output for c in draft.connections if c.source == name}
    _forget_connectors(draft, name, component.connectors.keys() - signals - read)


def _forget_connectors(draft: Draft, name: str, connectors: Iterable[str]) -> None:
    """Remove connectors that the file of the system lists for a component."""
    component = draft.components[name]
    if gone := set(connectors) & component.connectors.keys():
        listed = {k: c for k, c in component.connectors.items() if k not in gone}
        draft.components[name] = replace(component, connectors=listed)


def _by_output(connections: Iterable[Connection]) -> dict[str, list[str]]:
    """Return the inputs that each output feeds, arrays as a whole."""
    feeds: dict[str, dict[str, None]] = {}
    for c in connections:
        feeds.setdefault(c.output_array, {})[f"{c.target}.{c.input_array}"] = None
    return {output: list(inputs) for output, inputs in feeds.items()}


def adopt_shared(draft: Draft, name: str) -> None:
    """Copy the craft's values of shared parameters to a replaced component.

    They replace its own defaults, which belong to another craft. Parameters that were
    given a value are left alone.
    """
    mine = draft.components[name]
    shared = {s.array for s in mine.interface.parameters if s.shared}
    shared -= {base_name(k) for k in mine.parameters} | mine.references.keys()
    for key in sorted(shared):
        names = [s.name for s in mine.interface.elements[key]]
        owner = _find_sharer(draft, mine, key, names)
        if owner is None:
            continue
        if key in owner.references:
            mine.references[key] = owner.references[key]
        else:
            for element in names:
                start = owner.interface.signals[element].start
                value = owner.parameters.get(element, start)
                if value is not None and not isinstance(value, str):
                    mine.parameters[element] = value
        if key in owner.origins:
            mine.origins[key] = owner.origins[key]


def _find_sharer(
    draft: Draft, mine: Component, key: str, names: list[str]
) -> Component | None:
    """Find another component that shares a parameter with these elements."""
    for other in draft.components.values():
        signals = other.interface.elements.get(key, ())
        is_alike = other is not mine and [s.name for s in signals] == names
        if is_alike and signals[0].shared:
            return other
    return None
