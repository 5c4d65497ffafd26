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
running it (`problems(system) -> lines`), are functions beside these; `runs/checks.py`
lists them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields
from functools import cache
from types import ModuleType
from typing import Any, Self

from ..numbers.text import Value
from ..system import discovery
from ..system.interface import OutputClass, role_classes
from ..system.model import System
from ..system.schedule import schedule
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

    def applies(self, system: System) -> Any:
        """Return the parts of a system; None where it has none, or lacks their states."""
        if self.KEY not in system.parts_of_analyses:
            system.parts_of_analyses[self.KEY] = self._parts(system)
        return system.parts_of_analyses[self.KEY]

    def _parts(self, system: System) -> Any:
        """Find the parts of a system, as `applies` returns them."""
        parts = self._module.applies(system)
        late = {} if parts is None else find_late_states(system)
        if not late:
            return parts
        # a part is named by its component or by a series of it
        part_names = set(_texts_in([*vars(parts).values(), *self.signals(parts)]))
        series = {f"{name}.{output}" for name, of in late.items() for output in of}
        return None if part_names & (late.keys() | series) else parts


def _texts_in(values: Iterable[Any]) -> Iterator[str]:
    """Yield the texts among values and in their collections."""
    for value in values:
        if isinstance(value, str):
            yield value
        elif isinstance(value, Mapping):
            yield from _texts_in([*value, *value.values()])
        elif isinstance(value, Parts):
            yield from _texts_in(vars(value).values())
        elif isinstance(value, Iterable):
            yield from _texts_in(value)


def find_late_states(system: System) -> dict[str, list[str]]:
    """Return the outputs over the step that their roles declare as states.

    They are by component, and only of foreign FMUs in the place of a role: what declares
    no dependencies is taken over the step. An analysis needs them at t_k.
    """
    late: dict[str, list[str]] = {}
    classes: Mapping[tuple[str, str], OutputClass] = {}
    for name, component in system.components.items():
        role = role_classes().get(name)
        if component.interface.role or role is None or component.fmu is None:
            continue
        states = {
            v.name for v in role.variables if not v.interval and v.name != "fault"
        }
        classes = classes or schedule(system, breaks_loops=True).classes
        outputs = {
            s.array: None
            for s in component.interface.outputs
            if s.array in states and classes[name, s.name] == "interval"
        }
        late |= {name: list(outputs)} if outputs else {}
    return late


def late_state_warnings(system: System) -> Iterator[str]:
    """Yield a line for each component without whose states analyses are left out."""
    for name, outputs in find_late_states(system).items():
        yield (
            f"{system.place}: {name}: {', '.join(outputs)} are taken over the step: analyses "
            f"that need them at t_k are left out; --output-class {name}.{outputs[0]}=state"
        )


@cache
def analyses() -> tuple[Analysis, ...]:
    """Return all analyses, by the names of their files."""
    modules = discovery.load("analyses")
    return tuple(Analysis(module) for module in modules if hasattr(module, "applies"))


def with_titles(rows: Mapping[str, tuple[str, float | None, str]]) -> dict[str, Value]:
    """Convert title, value and unit to numbers; unknown values are left out."""
    return {name: Value(*row) for name, row in rows.items() if row[1] is not None}


def not_checked(reasons: Mapping[str, str]) -> list[str]:
    """Return a line for each reason why numbers that judge a run are missing.

    The reasons are by the names of the numbers.
    """
    names_by_reason: dict[str, list[str]] = {}
    for name, reason in reasons.items():
        names_by_reason.setdefault(reason, []).append(name)
    return [
        f"not checked: {', '.join(names)}: {reason}"
        for reason, names in names_by_reason.items()
    ]
