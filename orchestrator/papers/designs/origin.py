"""Record what a design was made from, and find how a run differs from it.

A design's file ends with a table [made_of]: times, sources, wiring, the [design] of the
scenario and every parameter of its system except those that were computed.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Container
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...files.build import build
from ...files.draft import Assignment
from ...files.reader import design
from ...files.scenario import Scenario, find
from ...language.scenario import Design, DesignFile
from ...runs.case import Case
from ...runs.checks import check_draft
from ...system.interface import MISSING, base_name
from ...system.model import Connection, System
from ...system.options import Options
from ...system.parameters import parse_assignment

TABLE = "made_of"


def design_of(scenario: Scenario) -> Design:
    """Return the [design] of a scenario that has one."""
    assert scenario.content.design is not None
    return scenario.content.design


def case_for(scenario: Scenario, options: Options, designed: bool = False) -> Case:
    """Build and check the system, on bare blocks, that a scenario's design is made for.

    It has the values of `options`, then those that [design] assumes. With `designed` it
    has the stored design and nothing assumed.
    """
    on_blocks = replace(options, blocks=True)
    draft = build(scenario, on_blocks, None if designed else {})
    if scenario.content.design is not None and not designed:
        draft.assign(
            Assignment(owner, variable, value, scenario.name)
            for owner, values in scenario.content.design.assume.items()
            for variable, value in values.items()
        )
    return check_draft(draft, on_blocks, scenario)


LONGEST = 12  # an array longer than this is stored as a digest


def system_of(scenario: Scenario, options: Options) -> System:
    """Resolve the system that a scenario's design is made for.

    FMUs that the options exchange are ignored.

    Raises
    ------
    DesatError
        If it cannot be resolved.
    """
    return case_for(scenario, replace(options, sources=[])).or_raise()[0]


def made_of(
    scenario: Scenario,
    system: System,
    without: set[str],
    known: Container[str] | None = None,
) -> dict[str, Any]:
    """Return what a scenario's design is made from, `component.parameter` -> value.

    Times, wiring and sources are included; a choice stands by its name.

    Parameters
    ----------
    scenario
        The scenario.
    system
        System that the design is made for.
    without
        Parameters that the design computes.
    known
        Names to include. A parameter that is neither in it nor set by anybody is left
        out, because its block got it later. None: all.
    """
    values: dict[str, Any] = {
        "start": system.start,
        "stop": system.stop,
        "step": system.step,
        **({"substeps": system.substeps} if system.substeps != 1 else {}),
        "wiring": _digest(sorted(map(_wire, system.connections))),
        **{
            f"design.{k}": v
            for k, v in design_of(scenario).written.items()
            if k != "assume"
        },
    }
    if end := design_of(scenario).end_of:
        other = find(f"{scenario.family}/{end}")
        parameters = other.parameters()
        values["end_of"] = _digest(
            [made_of(other, system_of(other, Options()), set()), parameters]
        )
    for c in system.components.values():
        values[f"source.{c.name}"] = Path(c.source).stem
        if c.step_ratio > 1:
            values[f"step_ratio.{c.name}"] = c.step_ratio
    for name, rows in system.parameters.items():
        for k, entry in rows.items():
            if known is None or entry.given or f"{name}.{k}" in known:
                values[f"{name}.{k}"] = _short_form(entry.value)
    return {k: v for k, v in values.items() if k not in without and v is not None}


def _wire(c: Connection) -> str:
    """Format a connection with its conversion, where it has one."""
    same = (c.factor, c.offset) == (1.0, 0.0)
    return str(c) if same else f"{c}: {c.factor!r}, {c.offset!r}"


def _short_form(value: Any) -> Any:
    """Return a value, or the digest of a long array."""
    if isinstance(value, list) and len(value) > LONGEST:
        return f"{len(value)} values, {_digest(value)}"
    return value


def _digest(data: Any) -> str:
    """Compute a short digest of data."""
    return hashlib.sha256(
        json.dumps(data, sort_keys=True, default=str).encode()
    ).hexdigest()[:16]


def owner(scenario: Scenario, options: Options) -> tuple[Scenario, Options, list[str]]:
    """Return the scenario that owns the design which a scenario uses.

    Also returned are those options that this scenario knows, and the
    `component.variable` of those that it does not.
    """
    if not (of := design_of(scenario).of):
        return scenario, options, []
    other = find(f"{scenario.family}/{of}")
    components = build(other, Options(blocks=True), {}).components
    strange: list[str] = []

    def known(name: str, variable: str) -> bool:
        """Return whether the owner has a variable; note it if not."""
        interface = components[name].interface if name in components else MISSING
        if base_name(variable) in interface.elements:
            return True
        strange.append(f"{name}.{variable}")
        return False

    return (
        other,
        replace(
            options,
            sets=[t for t in options.sets if known(*parse_assignment(t)[:2])],
            values={k: v for k, v in options.values.items() if known(*k.split(".", 1))},
            sources=[t for t in options.sources if t.partition("=")[0] in components],
        ),
        strange,
    )


def names_of(file: DesignFile) -> set[str]:
    """Return `component.parameter` of everything that a design's file computes."""
    return {f"{name}.{k}" for name, values in file.parameters.items() for k in values}


def warnings(scenario: Scenario, options: Options, system: System) -> list[str]:
    """Return warnings on a run with a stored design made for other values.

    Each names the command that makes a design for the run's values. `system` is the one
    that runs with these options.
    """
    if scenario.design is None or not scenario.design.exists():
        return []
    file = design(scenario.design)
    other, fitting, strange = owner(scenario, options)
    again = f"`desat design {other.name}`"
    if not file.made_of:
        return [
            f"{scenario.name}: its design does not say what it was made from; {again} does"
        ]
    before, without = file.made_of, names_of(file)
    apart = other is not scenario or fitting.sources or design_of(other).assume
    now = made_of(
        other, system_of(other, fitting) if apart else system, without, before
    )
    for text in fitting.sources:
        name, _, source = text.partition("=")
        now[f"source.{name}"] = Path(source).stem
    differing = [
        f"{key} = {_short(before.get(key))}, now {_short(now.get(key))}"
        for key in dict.fromkeys([*before, *now])
        if before.get(key) != now.get(key)
    ]
    lines = []
    if differing:
        if made_of(other, system_of(other, Options()), without, before) == before:
            again = f"`desat run {scenario.name} ... --design now` makes one for these"
        else:
            again += " makes it again"
        differences = "; ".join(differing)
        lines.append(
            f"{scenario.name}: its design was made for other values: {differences}; {again}"
        )
    if strange:
        lines.append(
            f"{scenario.name}: its design is that of {other.name}, which has no "
            f"{', '.join(strange)}: it does not follow; `desat design {other.name} --set ... "
            "--out FILE`, then --design FILE"
        )
    return lines


def _short(value: Any) -> str:
    """Format a value in at most 80 characters."""
    text = "nothing" if value is None else str(value)
    return text if len(text) <= 80 else f"{text[:77]}..."
