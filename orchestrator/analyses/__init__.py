"""Analyse a run beyond its numbers: each file of the folder is an analysis.

A module that has `applies` is an analysis, here and in a folder `analyses/` of another
room:

    KEY = "rigid_body"                              # its place in the manifest
    PARTS                                           # its class, which component is what
    NUMBERS = ("momentum_residual",)                # the names of all numbers that it may give
    def applies(system) -> Parts or None            # None: not this system
    def numbers(manifest, results) -> {name: Value} # {} where there is none

The following are optional:

    def signals(parts) -> list of series            # series that even a sparse run must record
    def balanced(parts) -> list of series           # more, for a bound or a requirement
    BOUND_KEYS = ("residual_bound",)                # the scenario keys of these bounds
    def unmet(manifest, results) -> list of lines   # violated bounds and goals
    def unchecked(manifest, results) -> {name: why} # NUMBERS that a run could not give
    def figures(manifest, results) -> [(caption, Figure)]
    def remarks(manifest, results) -> list of lines # warnings

Warnings about a checked system (`warnings(system) -> lines`), and problems that prevent
running it (`problems(system) -> lines`), are functions beside these; `runs/prepare.py`
lists them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from types import ModuleType
from typing import Any, Self

from ..numbers.text import Value
from ..system import discovery
from ..system.typed import JsonObject


@dataclass(frozen=True)
class Parts:
    """Components of a system by their part in an analysis."""

    @classmethod
    def from_json(cls, document: JsonObject) -> Self:
        """Read the parts from a manifest, also of another version."""
        return cls(
            **{f.name: document[f.name] for f in fields(cls) if f.name in document}
        )

    def to_json(self) -> JsonObject:
        """Return the parts for a manifest; None is left out, except for `feeds`."""
        document = {
            k: v for k, v in vars(self).items() if v is not None or k == "feeds"
        }
        return {k: list(v) if isinstance(v, tuple) else v for k, v in document.items()}


_NOTHING: dict[str, Any] = {
    "BOUND_KEYS": (),
    "signals": lambda parts: [],
    "balanced": lambda parts: [],
    **dict.fromkeys(("unmet", "figures", "remarks"), lambda manifest, results: []),
    "unchecked": lambda manifest, results: {},
}


class Analysis:
    """Module that is an analysis; functions that it lacks return nothing."""

    def __init__(self, module: ModuleType) -> None:
        self._module = module

    def __getattr__(self, name: str) -> Any:
        is_defined = hasattr(self._module, name) or name not in _NOTHING
        return getattr(self._module, name) if is_defined else _NOTHING[name]


@cache
def analyses() -> tuple[Analysis, ...]:
    """Return all analyses, by the names of their files."""
    found = discovery.load("analyses")
    return tuple(Analysis(module) for module in found if hasattr(module, "applies"))


def with_titles(rows: Mapping[str, tuple[str, float | None, str]]) -> dict[str, Value]:
    """Convert title, value and unit to numbers; unknown values are left out."""
    return {name: Value(*row) for name, row in rows.items() if row[1] is not None}


def not_checked(reasons: Mapping[str, str]) -> list[str]:
    """Return a line for each reason why numbers that judge a run are missing.

    The reasons are by the names of the numbers.
    """
    named: dict[str, list[str]] = {}
    for name, reason in reasons.items():
        named.setdefault(reason, []).append(name)
    return [
        f"not checked: {', '.join(names)}: {reason}" for reason, names in named.items()
    ]
