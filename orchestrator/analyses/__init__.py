"""What is computed of a run beyond its numbers: a file an analysis, found by the folder;
in `papers/` those of one family.

A module of this folder that has `applies` is an analysis:

    KEY = "rigid_body"                              # its place in the manifest
    NUMBERS = ("momentum_residual",)                # the names of all numbers that it may give
    def applies(system) -> parts or None            # which component is what; None: not this system
    def signals(parts) -> list of series            # what a run of which little is kept must record
    def numbers(manifest, results) -> numbers       # as a manifest has them, {} where there is none
    def balanced(parts) -> list of series           # more, where a bound or a requirement asks
    BOUND_KEYS = ("residual_bound",)                # the scenario keys of these bounds
    def unmet(manifest, results) -> list of lines   # what of it is not as it ought to be
    def unchecked(manifest, results) -> {name: why} # which of NUMBERS could not be made of a run
    def figures(manifest, results) -> [(caption, svg)]
    def remarks(manifest, results) -> list of lines # what to beware of, if it has any

and one that has `warnings(system) -> [line]` says what to beware of in a checked system.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Mapping
from functools import cache
from types import ModuleType
from typing import Any

from ..system.model import System


@cache
def _modules() -> tuple[ModuleType, ...]:
    found = (m.name for m in pkgutil.walk_packages(__path__, f"{__name__}."))
    return tuple(
        importlib.import_module(name) for name in sorted(found, key=lambda n: n.split(".")[::-1])
    )


@cache
def analyses() -> tuple[ModuleType, ...]:
    """The analyses that there are, by the names of their files."""
    return tuple(m for m in _modules() if hasattr(m, "applies"))


def titled(rows: Mapping[str, tuple[str, float | None, str]]) -> dict[str, dict[str, Any]]:
    """Title, value and unit by name, as a manifest has numbers; what is not known is left out."""
    return {
        name: {"title": title, "value": value, "unit": unit}
        for name, (title, value, unit) in rows.items() if value is not None
    }  # fmt: skip


def warnings(system: System) -> list[str]:
    """What to beware of in a checked system, a line each."""
    modules = (m for m in _modules() if hasattr(m, "warnings"))
    return [line for m in modules for line in m.warnings(system)]


def not_checked(reasons: Mapping[str, str]) -> list[str]:
    """A line for each reason why numbers cannot be made that a run is held against; `reasons` by
    the numbers' names."""
    named: dict[str, list[str]] = {}
    for name, why in reasons.items():
        named.setdefault(why, []).append(name)
    return [f"not checked: {', '.join(names)}: {why}" for why, names in named.items()]
