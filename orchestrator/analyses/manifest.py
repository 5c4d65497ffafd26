"""The manifest of a run: what was run, with which values, how it ended, and its
numbers."""

from __future__ import annotations

import platform
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from ..files import library
from ..files.identity import of_system, versions
from ..language.content import Content, content_of
from ..numbers import verdicts
from ..numbers.text import Value
from ..numbers.verdicts import Verdict
from ..system.digest import wiring
from ..system.expression import Table
from ..system.model import Component, System, Values
from ..system.options import Options
from ..system.parameters import Parameter, table
from ..system.typed import JsonObject, fault_of
from . import analyses

AT_THE_END = {
    "stopped_when",
    "loop",
    "numbers",
    "verdicts",
    "unmet",
    "not_checked",
    "balance",
}
"""What is said once a run is over, be it that there is none."""
UNKNOWN = "?"
"""Stands for what a run that was killed could not say."""


@dataclass(frozen=True)
class Stopped:
    """The condition that ended a run, and when (s)."""

    condition: str
    time: float

    def to_json(self) -> JsonObject:
        """As a manifest has it; a campaign's columns keep the time alone."""
        return dict(vars(self)) if self.condition else {"time": self.time}


@dataclass(frozen=True)
class Slow:
    """What components cost that do not step at every step: errors of the attitude (rad)
    and of a wheel's momentum (N m s) until a time (s)."""

    attitude: float
    momentum: float
    until: float
    of: str


@dataclass(frozen=True)
class SubstepChoice:
    """The substeps of a run, and how it came to them."""

    substeps: int
    accuracy: float
    """rad"""
    estimate: float | None = None
    """Largest error of the attitude (rad); None: not known"""
    why: str = ""
    """Why nothing was estimated."""
    steps: int = 0
    """So many steps of the run, from its start, were flown with the count that was
    taken."""
    tried: Mapping[int, float] = field(default_factory=dict)
    """Count -> estimate (rad)."""
    reached: tuple[float, float, float] | None = None
    """Of the flights that did not see the whole run: largest turning (rad/s),
    acceleration by actuators and change of that (rad/s2)."""
    flown: int = 0
    """Substeps of all flights"""
    again: list[str] = field(default_factory=list)
    """Why the run was made again, each time."""
    seconds: float = 0.0
    """CPU time that choosing took"""

    def to_json(self) -> JsonObject:
        """As the manifest has it."""
        return {**vars(self), "tried": {str(n): e for n, e in self.tried.items()}}

    @classmethod
    def from_json(cls, told: JsonObject) -> SubstepChoice:
        """From a manifest."""
        seen = told["reached"]
        tried = {int(n): e for n, e in told["tried"].items()}
        return cls(**{**told, "tried": tried, "reached": seen and tuple(seen)})


@dataclass(frozen=True, eq=False)
class Manifest(Mapping[str, Any]):
    """A run's manifest. As a mapping it is its JSON, whose keys are the names of the
    fields; those of `parts` and `more` stand among them."""

    scenario: str = ""
    about: Mapping[str, Any] = field(default_factory=dict)
    """What the scenario says, as it travels (`content`)."""
    algorithm: str = ""
    components_as: str = ""
    start: float = 0.0
    stop: float = 0.0
    step: float = 0.0
    substeps: int = 1
    step_ratio: Mapping[str, int] = field(default_factory=dict)
    output_classes: Mapping[str, Any] = field(default_factory=dict)
    connections: Mapping[str, Any] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    platform: str = ""
    ssp: Mapping[str, str] | None = None
    fmus: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    parts: Mapping[str, Any] = field(default_factory=dict)
    """Of each analysis, by its key, which component is what; None where it does not
    apply."""
    choices: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """What the values of an output stand for, by `component.output`."""
    parameters: Table = field(default_factory=dict)
    digest: str = ""
    substep_choice: SubstepChoice | None = None
    decimated: Slow | None = None
    started: str | None = None
    steps: int | None = None
    status: str = "running"
    warnings: Sequence[str] = ()
    message: str | None = None
    """None: it is not over."""
    steps_done: int | str | None = None
    end_time: float | None = None
    stopped_when: Stopped | None = None
    loop: Mapping[str, str] | None = None
    """Which loop stepped, and why not the compiled one."""
    wall_seconds: float | str | None = None
    us_per_step: float | str | None = None
    numbers: Mapping[str, Value] = field(default_factory=dict)
    verdicts: Mapping[str, Verdict] = field(default_factory=dict)
    """Of the scenario's requirements, by their names, those that this run can judge."""
    unmet: Sequence[str] = ()
    """What does not add up: a line for each bound of an analysis that is not kept."""
    not_checked: Mapping[str, str] = field(default_factory=dict)
    """Why a number that the run is held against could not be made, by its name."""
    balance: Mapping[str, Any] | None = None
    """What the balances came to that were made while it ran (`energy.Totals`)."""
    rows: int | None = None
    """The rows that hold values, where the file has others too."""
    exit: int | None = None
    """The exit code, where the status does not say it."""
    more: Mapping[str, Any] = field(default_factory=dict)
    """What another version has said beside."""

    @classmethod
    def of(cls, system: System, options: Options, target: str) -> Manifest:
        """That of a system before it runs."""
        path = Path(target)
        return cls(
            scenario=content_of(system.about).name or system.name,
            about=system.about.as_json() if system.about else {},
            algorithm=options.algorithm,
            components_as="bare blocks" if options.blocks else "FMUs",
            start=system.start,
            stop=system.stop,
            step=system.step,
            substeps=system.parts,
            step_ratio={c.name: c.step_ratio for c in system.components.values()},
            output_classes=system.output_classes,
            connections=wiring(system.connections),
            versions=versions(),
            platform=platform.platform(),
            ssp={"file": path.name, "sha256": library.sha256(path)}
            if path.suffix == ".ssp"
            else None,
            fmus={
                c.name: {"source": c.source, "sha256": c.fmu.sha256}
                for c in system.components.values()
                if c.fmu is not None
            },
            parts={a.KEY: a.applies(system) for a in analyses()},
            choices={
                f"{c.name}.{s.name}": list(s.choices)
                for c in system.components.values()
                for s in c.interface.outputs
                if s.choices
            },
            parameters=table(system.components.values()),
            digest=of_system(system, options),
        )

    def varied(self, system: System, changed: Iterable[Component]) -> Manifest:
        """That of the same system with other values of some components, before it runs;
        without a digest, which costs more than all else here."""
        return replace(
            self,
            parts={a.KEY: a.applies(system) for a in analyses()},
            parameters={**self.parameters, **table(changed)},
            digest="",
        )

    @cached_property
    def content(self) -> Content:
        """What the scenario says. Raises DesatError where that of another version is
        not in the language."""
        return content_of(self.about)

    @property
    def completed(self) -> bool:
        """Whether the run reached its end."""
        return self.status == "completed"

    @property
    def not_met(self) -> list[str]:
        """A line for each bound and each requirement that is not met."""
        return [*self.unmet, *verdicts.lines(self.verdicts)]

    def values_of(self, component: str) -> Values:
        """The values of a component's parameters by name; none where it is not there."""
        return {name: p.value for name, p in self.parameters.get(component, {}).items()}

    def to_json(self) -> JsonObject:
        """As `manifest.json` has it."""
        told: dict[str, Any] = {}
        for f in fields(self):
            value = getattr(self, f.name)
            if f.name in ("parts", "more"):
                told |= {key: _as_json(x) for key, x in value.items()}
            elif (
                self.message is not None
                if f.name in AT_THE_END
                else (value is not None or f.name == "ssp")
            ):
                told[f.name] = _as_json(value)
        return told

    @classmethod
    def from_json(cls, told: JsonObject) -> Manifest:
        """Read a manifest, also one of an older version, which lacks some keys, or of a
        newer one.

        Raises
        ------
        ValueError
            If a key has not the form that it needs; the text names the key.
        """
        keys = {f.name for f in fields(cls)} - {"parts", "more"}
        made = {key: x for key, x in told.items() if key in keys}
        for key, of in _TYPED.items():
            if made.get(key) is not None:
                made[key] = _read(key, of, made[key])
        parts = {}
        for analysis in analyses():
            key = analysis.KEY
            if key in told:
                parts[key] = told[key] and _read(
                    key, analysis.PARTS.from_json, told[key]
                )
        more = {
            key: x for key, x in told.items() if key not in made and key not in parts
        }
        manifest = cls(**{**made, "parts": parts, "more": more})
        fault = fault_of(manifest, cls, "")
        for key, part in parts.items():
            fault = fault or (fault_of(part, type(part), key) if part else "")
        if fault:
            raise ValueError(fault)
        return manifest

    @cached_property
    def _json(self) -> JsonObject:
        return self.to_json()

    def __getitem__(self, key: str) -> Any:
        return self._json[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._json)

    def __len__(self) -> int:
        return len(self._json)


def _as_json(x: Any) -> Any:
    if hasattr(x, "to_json"):
        return x.to_json()
    if isinstance(x, Mapping):
        return {key: _as_json(value) for key, value in x.items()}
    return dict(vars(x)) if is_dataclass(x) else x


def _read(key: str, of: Callable[[Any], Any], told: Any) -> Any:
    """Return the value of a key as `of` reads it. Raises ValueError, which names the
    key."""
    try:
        return of(told)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise ValueError(f"{key} has not the form that it needs ({error})") from error


_TYPED: dict[str, Callable[[Any], Any]] = {
    "parameters": lambda t: {
        c: {k: Parameter(**p) for k, p in of.items()} for c, of in t.items()
    },
    "numbers": lambda t: {name: Value(**n) for name, n in t.items()},
    "substep_choice": SubstepChoice.from_json,
    "decimated": lambda t: Slow(**t),
    "stopped_when": lambda t: Stopped(**t),
    "verdicts": lambda t: {name: Verdict(**v) for name, v in t.items()},
}
