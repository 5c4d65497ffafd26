"""Explain refusals of components to start, as lines that a user can act on."""

from __future__ import annotations

import re
from collections import defaultdict

from .interface import base_name
from .model import Component, System

# Prefix of a refusal by a block of ours; any other text is an unintended failure
# (`components/contract/block.py`).
REFUSES = "BlockError: "
_NAME = re.compile(r"([A-Za-z]\w*)(\[[^\]]*\])?(\s*=(?!=))?")


def explain(system: System, text: str) -> list[str]:
    """Return the lines of a failure, with the source of the values in refusals.

    A refusal begins with the file, key or option that gave the first variable it names,
    and ends with the sources of the others. A value given once for several components
    and refused by them all makes one line. A component that fails because of the
    outputs of a refusing one is left out.
    """
    lines = text.splitlines()
    refusing = {line.partition(": ")[0] for line in lines if REFUSES in line}
    components_fed = _fed_by(system, refusing & set(system.components))
    result: dict[str, str] = {}
    for line in lines:
        name, _, rest = line.partition(": ")
        component = system.components.get(name)
        if component is None or REFUSES not in rest:
            if not (name in components_fed and name not in refusing):
                result[line] = line
            continue
        reason = rest.partition(REFUSES)[2]
        given_elsewhere, own_defaults = _sources(component, reason)
        place = given_elsewhere[0][1] if given_elsewhere else system.place
        reason += "".join(
            f"; {n} from {at}" for n, at in given_elsewhere[1:] if at != place
        )
        reason += f"; {' and '.join(own_defaults)}: the default" if own_defaults else ""
        result.setdefault(
            place if given_elsewhere else line, f"{place}: {name}: {reason}"
        )
    return list(result.values())


def _fed_by(system: System, names: set[str]) -> set[str]:
    """Find the components that these feed, directly or indirectly."""
    targets: dict[str, set[str]] = defaultdict(set)
    for c in system.connections:
        targets[c.source].add(c.target)
    components_fed: set[str] = set()
    new = set(names)
    while new:
        new = {t for n in new for t in targets[n]} - components_fed
        components_fed |= new
    return components_fed


def _sources(
    component: Component, text: str
) -> tuple[list[tuple[str, str]], list[str]]:
    """Return each variable that a text names with the source of its value.

    Variables without a source, which have their default, are returned separately.
    """
    variable_names = {base_name(n) for n in component.interface.signals}
    named = [
        m[1]
        for m in _NAME.finditer(text)
        if m[1] in variable_names and (m[2] or m[3] or "_" in m[1] or m.start() == 0)
    ]
    named = list(dict.fromkeys(named))
    sources = [(n, component.origins[n]) for n in named if n in component.origins]
    return sources, [n for n in named if n not in component.origins]
