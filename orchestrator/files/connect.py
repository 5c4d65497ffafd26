"""Compare the wires of a system with the FMUs that are at their ends.

The wires of a craft are compared where they are read (`craft.py`); those of an SSP file,
and those of a component whose FMU was replaced, when all FMUs are known.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import replace

from desat.components.contract.units import Unit, conversion

from ..system.errors import DesatError, nearest
from ..system.interface import MISSING, Interface, Signal, base_name
from ..system.model import Connection, Connector
from ..system.parameters import known_unit
from .draft import Draft

# The kinds of outputs that an input of each kind takes: none loses anything.
_ACCEPTED = {
    "Real": ("Real", "Integer"),
    "Integer": ("Integer",),
    "Boolean": ("Boolean",),
    "String": ("String",),
}
MOST_LINES = 100  # upper bound of lines about one kind of problem
MOST_NAMED = 10  # upper bound of connectors that one line names


def converted(c: Connection, source: Signal, target: Signal) -> Connection:
    """Add the conversion of units to a connection, if it has no other.

    Raises
    ------
    DesatError
        If the units do not fit.
    """
    if not c.converts or not (source.unit_name and target.unit_name):
        return c
    if source.unit_name == target.unit_name:
        return c
    if source.unit is None or target.unit is None:
        unknown = source.unit_name if source.unit is None else target.unit_name
        raise DesatError(
            f"unit {unknown} is not known: nothing says how {source.unit_name} becomes "
            f"{target.unit_name}"
        )
    factor_and_offset = conversion(source.unit, target.unit)
    if factor_and_offset is None:
        raise DesatError(f"unit {source.unit_name} does not fit {target.unit_name}")
    if (c.factor, c.offset) != (1.0, 0.0):
        return c
    factor, offset = factor_and_offset
    return replace(c, factor=factor, offset=offset)


def warning_of_namesake(
    unit: Unit | str | None, other: Unit | None, signal: Signal, place: str
) -> str:
    """Return a warning if two units have one name and two definitions, else ""."""
    if isinstance(unit, str) or unit is None or other is None:
        return ""
    if conversion(unit, other) == (1.0, 0.0):
        return ""
    return (
        f"{place}: {signal.name}: the unit {signal.unit_name} is defined in two "
        "ways: the value is taken as it is"
    )


def warn(draft: Draft, line: str) -> None:
    """Add a warning to a draft, once."""
    if line and line not in draft.warnings:
        draft.warnings.append(line)


# --- Connectors that an SSP file lists ------------------------------------------------


def check_connectors(draft: Draft) -> None:
    """Report listed connectors that an FMU lacks or declares differently.

    They are problems if they are wired or given a value, in one line of a component,
    and warnings otherwise: tools list their own settings, too.
    """
    used = {(c.source, c.output) for c in draft.connections}
    used |= {(c.target, c.input) for c in draft.connections}
    for component in draft.components.values():
        interface, name = component.interface, component.name
        if interface is MISSING:
            continue
        with_values = {*component.origins, *map(base_name, component.origins)}
        wrong: dict[bool, list[tuple[Connector, str]]] = {True: [], False: []}
        for connector in component.connectors.values():
            signal = interface.signals.get(connector.name)
            is_fit = signal is not None and connector.kind == signal.causality
            if draft.unchecked.get(name) and not is_fit:
                continue  # reported in one line with all of its connections
            is_wired = (name, connector.name) in used
            is_used = is_wired or connector.name in with_values
            for text in _misfits(connector, signal, interface):
                wrong[is_used].append((connector, text))
        for is_used, misfits in wrong.items():
            if misfits:
                texts = [f"{c.name}: {text}" for c, text in misfits]
                line = f"{draft.place}:{misfits[0][0].line}: {name}.{_counted(texts)}"
                if is_used:
                    draft.problems.append(line)
                else:
                    warn(draft, f"{line}; they are not used")


def _misfits(
    connector: Connector, signal: Signal | None, interface: Interface
) -> Iterator[str]:
    """Say how a listed connector differs from the variable of its name.

    An Integer may be listed as Real: what is wired to it decides.
    """
    if signal is None:
        hint = nearest(connector.name, interface.signals)
        yield f"the FMU has no such variable{hint}"
        return
    if connector.kind != signal.causality:
        yield f"listed as {connector.kind}, but it is an {signal.causality}"
    listed = "Integer" if connector.type == "Enumeration" else connector.type
    is_wider = (listed, signal.kind) == ("Real", "Integer")
    if listed not in ("", signal.kind) and not is_wider:
        yield f"listed as {connector.type}, but it is {signal.kind}"
    if connector.unit in ("", signal.unit_name) or signal.unit is None:
        return
    unit = known_unit(connector.unit)
    if unit is None or conversion(unit, signal.unit) != (1.0, 0.0):
        own_unit = signal.unit_name or 1
        yield f"listed in {connector.unit}, but it is in {own_unit}"


def _counted(texts: list[str]) -> str:
    """Join texts for one line; of very many the first ones and their count."""
    if len(texts) <= MOST_NAMED:
        return "; ".join(texts)
    return f"{'; '.join(texts[:MOST_NAMED])}; and {len(texts) - MOST_NAMED} more"


# --- Connections ----------------------------------------------------------------------


def _misfit(source: Signal, target: Signal) -> str:
    """Return why the type of an output does not fit that of an input."""
    if source.kind == target.kind:
        return f"{source.kind} variables are not passed on here"
    return f"type {source.kind} does not fit {target.kind}"


def check_connections(draft: Draft) -> tuple[Connection, ...]:
    """Return the connections, with unit conversions where the units differ.

    What is wrong at the ends whose FMUs are not yet compared is added to the problems.
    """
    result = []
    driven: dict[tuple[str, str], Connection] = {}
    before = len(draft.problems)
    lacking: dict[str, dict[str, None]] = defaultdict(dict)
    for c in draft.connections:
        if len(draft.problems) > before + MOST_LINES:
            break
        if not {c.source, c.target} & draft.unchecked.keys():
            result.append(c)
            continue
        source = _end(draft, c, "output", lacking)
        target = _end(draft, c, "input", lacking)
        if source is None or target is None:
            continue
        place = f"{draft.place}:{c.line}"
        if source.kind not in _ACCEPTED.get(target.kind, ()):
            draft.problems.append(f"{place}: {c}: {_misfit(source, target)}")
        other = driven.setdefault((c.target, c.input), c)
        if other is not c:
            draft.problems.append(
                f"{place}: {c}: {c.target}.{c.input} has two sources, also "
                f"{other.source}.{other.output} (line {other.line})"
            )
        is_namesake = c.converts and source.unit_name == target.unit_name
        if is_namesake and source.unit != target.unit:
            at = f"{place}: {c}"
            warn(draft, warning_of_namesake(source.unit, target.unit, target, at))
        try:
            result.append(converted(c, source, target))
        except DesatError as error:
            draft.problems.append(f"{place}: {c}: {error}")
    for name, ends in lacking.items():
        draft.problems.append(
            f"{draft.unchecked[name]}: {name}: its FMU lacks what is wired: "
            f"{', '.join(ends)}"
        )
    return tuple(result)


def _end(
    draft: Draft, c: Connection, causality: str, lacking: Mapping[str, dict[str, None]]
) -> Signal | None:
    """Return the variable at one end of a connection, or None if none fits.

    Variables that a replacing FMU lacks are added to `lacking`, by component.
    """
    outgoing = causality == "output"
    owner, connector = (c.source, c.output) if outgoing else (c.target, c.input)
    component = draft.components.get(owner)
    place = f"{draft.place}:{c.line}"
    if component is None:
        hint = nearest(owner, draft.components)
        draft.problems.append(f"{place}: {c}: no component {owner}{hint}")
        return None
    interface = component.interface
    connectors = component.connectors or interface.signals
    if not connectors and interface is MISSING:
        return None
    signal = interface.signals.get(connector)
    has_causality = signal is not None and signal.causality == causality
    is_replaced = draft.unchecked.get(owner) and interface is not MISSING
    if is_replaced and not has_causality:
        array = c.output_array if outgoing else c.input_array
        in_part = interface.elements.get(array, ()) and signal is None
        lacking[owner][f"{causality} {connector if in_part else array}"] = None
        return None
    if connector not in connectors:
        hint = nearest(connector, connectors)
        draft.problems.append(
            f"{place}: {c}: {owner} has no connector {connector}{hint}"
        )
        return None
    if signal is not None and not has_causality:
        end = "start" if outgoing else "end"
        draft.problems.append(
            f"{place}: {c}: wrong direction: the {end} {owner}.{connector} is an "
            f"{signal.causality}, an {causality} is needed"
        )
        return None
    return signal
