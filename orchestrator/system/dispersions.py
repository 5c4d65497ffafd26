"""What of a draft is drawn, and how: its [dispersions] by component and variable."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .draft import Draft
from .interface import base_name

KINDS = ("normal", "uniform", "direction", "attitude", "signs", "one_of", "seed")


def dispersed(system: Draft) -> dict[str, dict[str, Any]]:
    """`component.variable` -> how it is drawn."""
    spread: dict[str, dict[str, Any]] = {}
    for key, spec in system.about.get("dispersions", {}).items():
        owner, _, variable = key.partition(".")
        owners = [c.name for c in system.having(variable)] if owner == "*" else [owner]
        spread |= {f"{name}.{variable}": spec for name in owners}
    return spread


def overridden(system: Draft, name: str) -> list[str]:
    """What is drawn of the parameters that a name gives a value: `component.parameter`, an element
    of it, or `shared.parameter`."""
    owner, variable = (part.strip() for part in base_name(name.strip()).split(".", 1))
    wanted = {f"{owner}.{variable}"}
    if owner == "shared" and owner not in system.components:
        wanted = {f"{c.name}.{variable}" for c in system.having(variable)}
    return sorted(wanted & dispersed(system).keys())


def kind_of(spec: Mapping[str, Any]) -> str:
    """How something is drawn: one of KINDS, or none ("") where not exactly one is given."""
    found = [key for key in spec if key in KINDS]
    return found[0] if len(found) == 1 and spec.keys() <= {found[0], "within"} else ""
