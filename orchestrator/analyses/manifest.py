"""Describe a run in a manifest: system, values, how it ended, and its numbers."""

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
from ..system.model import Component, Parameter, System, Values, table
from ..system.options import Options
from ..system.typed import JsonObject, fault_of
from . import analyses

# Keys that are written once a run is over, even if they are empty.
AT_THE_END = {
    "stopped_when",
    "loop",
    "numbers",
    "verdicts",
    "unmet",
    "not_checked",
    "balance",
}
UNKNOWN = "?"  # stands for values that a killed run could not report


@dataclass(frozen=True)
class Stopped:
    """Condition that ended a run, and its time (s)."""

    condition: str
    time: float

    def to_json(self) -> JsonObject:
        """Return it as a manifest has it; a campaign's columns keep the time alone."""
        return dict(vars(self)) if self.condition else {"time": self.time}


@dataclass(frozen=True)
class Slow:
    """Errors due to components that do not step at every step.

    They are those of attitude (rad) and of a wheel's momentum (N m s) until a time (s).
    """

    attitude: float
    momentum: float
    until: float
    of: str


@dataclass(frozen=True)
class SubstepChoice:
    """Substeps of a run, and how they were chosen."""

    substeps: int
    accuracy: float  # rad
    estimate: float | None = None  # rad, largest attitude error; None: not known
    why: str = ""  # reason why nothing was estimated
    # steps from the start of the run that were flown with the chosen count
    steps: int = 0
    tried: Mapping[int, float] = field(default_factory=dict)  # count -> estimate (rad)
    # For flights that did not see the whole run: largest turning (rad/s), acceleration
    # by actuators and change of that (rad/s2).
    reached: tuple[float, float, float] | None = None
    # Largest change in a step of each wheel's momentum (N m s) where it passes zero in
    # the flights; 0: it does not.
    crossed: tuple[float, ...] = ()
    flown: int = 0  # substeps of all flights
    # reason for each repetition of the run
    again: list[str] = field(default_factory=list)
    seconds: float = 0.0  # s, CPU time of the choice
    # How often discrete outputs of the momentum manager change in the run. A change at
    # another sample is not in the estimate.
    switches: Mapping[str, int] = field(default_factory=dict)

    def to_json(self) -> JsonObject:
        """Return it as the manifest has it."""
        return {**vars(self), "tried": {str(n): e for n, e in self.tried.items()}}

    @classmethod
    def from_json(cls, document: JsonObject) -> SubstepChoice:
        """Read it from a manifest."""
        reached_range = document["reached"]
        tried = {int(n): e for n, e in document["tried"].items()}
        return cls(
            **{
                **document,
                "tried": tried,
                "reached": reached_range and tuple(reached_range),
                "crossed": tuple(document.get("crossed", ())),
            }
        )


@dataclass(frozen=True, eq=False)
class Manifest(Mapping[str, Any]):
    """Manifest of a run.

    As a mapping it is its JSON, whose keys are the names of the fields; those of
    `parts` and `more` stand among them.
    """

    scenario: str = ""
    # content of the scenario in JSON (`content`)
    about: Mapping[str, Any] = field(default_factory=dict)
    algorithm: str = ""
    components_as: str = ""
    start: float = 0.0
    stop: float = 0.0
    step: float = 0.0
    substeps: int = 1
    step_ratio: Mapping[str, int] = field(default_factory=dict)
    output_classes: Mapping[str, Any] = field(default_factory=dict)
    connections: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    platform: str = ""
    ssp: Mapping[str, str] | None = None
    fmus: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    # For each analysis, by its key, the components that it inspects; None where it does
    # not apply.
    parts: Mapping[str, Any] = field(default_factory=dict)
    # meaning of the values of an output, by component.output
    choices: Mapping[str, Sequence[str]] = field(default_factory=dict)
    parameters: Table = field(default_factory=dict)
    digest: str = ""
    substep_choice: SubstepChoice | None = None
    decimated: Slow | None = None
    started: str | None = None
    steps: int | None = None
    status: str = "running"
    warnings: Sequence[str] = ()
    message: str | None = None  # None: the run is not over
    steps_done: int | str | None = None
    end_time: float | None = None
    stopped_when: Stopped | None = None
    # the loop that stepped, and why it was not the compiled one
    loop: Mapping[str, str] | None = None
    wall_seconds: float | str | None = None
    us_per_step: float | str | None = None
    numbers: Mapping[str, Value] = field(default_factory=dict)
    # those requirements of the scenario that this run can judge, by name
    verdicts: Mapping[str, Verdict] = field(default_factory=dict)
    unmet: Sequence[str] = ()  # a line for each bound of an analysis that is exceeded
    # reason why a number that the run is judged by is missing, by name
    not_checked: Mapping[str, str] = field(default_factory=dict)
    # totals of the balances that were made while it ran (`energy.Totals`)
    balance: Mapping[str, Any] | None = None
    rows: int | None = None  # rows that hold values, where the file has more
    exit: int | None = None  # exit code, where the status does not imply it
    # keys that another version wrote
    more: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, system: System, options: Options, target: str) -> Manifest:
        """Build the manifest of a system before it runs."""
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
            parameters=system.parameters,
            digest=of_system(system, options),
        )

    def varied(self, system: System, changed: Iterable[Component]) -> Manifest:
        """Return the manifest of the same system with other values of some components.

        It is that before a run, without a digest, which costs more than everything else
        here.
        """
        return replace(
            self,
            parts={a.KEY: a.applies(system) for a in analyses()},
            parameters={**self.parameters, **table(changed)},
            digest="",
        )

    @cached_property
    def content(self) -> Content:
        """Return the content of the scenario.

        Raises DesatError where that of another version is not in the language.
        """
        return content_of(self.about)

    @property
    def completed(self) -> bool:
        """Return whether the run reached its end."""
        return self.status == "completed"

    @property
    def not_met(self) -> list[str]:
        """Return a line for each bound and each requirement that is not met."""
        return [*self.unmet, *verdicts.lines(self.verdicts)]

    def values_of(self, component: str) -> Values:
        """Return the values of a component's parameters by name; empty if unknown."""
        return {name: p.value for name, p in self.parameters.get(component, {}).items()}

    def to_json(self) -> JsonObject:
        """Return the content of `manifest.json`."""
        document: dict[str, Any] = {}
        for f in fields(self):
            value = getattr(self, f.name)
            if f.name in ("parts", "more"):
                document |= {key: _as_json(x) for key, x in value.items()}
            elif (
                self.message is not None
                if f.name in AT_THE_END
                else (value is not None or f.name == "ssp")
            ):
                document[f.name] = _as_json(value)
        return document

    @classmethod
    def from_json(cls, document: JsonObject) -> Manifest:
        """Read a manifest, also one of an older or a newer version.

        An older one lacks some keys.

        Raises
        ------
        ValueError
            If a key does not have the form that it needs; the text names the key.
        """
        keys = {f.name for f in fields(cls)} - {"parts", "more"}
        fields_found = {key: x for key, x in document.items() if key in keys}
        for key, of in _TYPED.items():
            if fields_found.get(key) is not None:
                fields_found[key] = _read(key, of, fields_found[key])
        parts: dict[str, Any] = {}
        for analysis in analyses():
            key = analysis.KEY
            if key in document:
                parts[key] = None
                if document[key] is not None:
                    parts[key] = _read(key, analysis.PARTS.from_json, document[key])
        more = {
            key: x
            for key, x in document.items()
            if key not in fields_found and key not in parts
        }
        manifest = cls(**{**fields_found, "parts": parts, "more": more})
        fault = fault_of(manifest, cls, "")
        for key, part in parts.items():
            fault = fault or (fault_of(part, type(part), key) if part else "")
        if fault:
            raise ValueError(fault)
        return manifest

    @cached_property
    def _json(self) -> JsonObject:
        """Return the JSON of the manifest, once."""
        return self.to_json()

    def __getitem__(self, key: str) -> Any:
        return self._json[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._json)

    def __len__(self) -> int:
        return len(self._json)


def _as_json(x: Any) -> Any:
    """Convert a value to JSON types."""
    if hasattr(x, "to_json"):
        return x.to_json()
    if isinstance(x, Mapping):
        return {key: _as_json(value) for key, value in x.items()}
    return dict(vars(x)) if is_dataclass(x) else x


def _read(key: str, of: Callable[[Any], Any], value: Any) -> Any:
    """Read the value of a key with `of`; raise ValueError, which names the key."""
    try:
        return of(value)
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
