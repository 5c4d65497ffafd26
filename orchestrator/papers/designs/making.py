"""Make, store and use designs (`desat design`)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from ...files.io import replace_text
from ...files.reader import design as read_design
from ...files.scenario import ROOT, Scenario, find, scenarios
from ...system.errors import DesatError
from ...system.model import System
from ...system.options import NOW, Options
from . import MadeDesign, Parameters, kinds
from .origin import TABLE, case_for, design_of, made_of, names_of, owner, system_of

PACKAGES = ("desat", "numpy", "scipy")
COMMON = ("of", "assume", "each_draw")
# tolerance for results of a stored design: the last bits of linear algebra depend on
# the machine
ROUNDING = 1e-12


def designable(names: list[str]) -> list[Scenario]:
    """Return the scenarios of these names, or all that have a design of their own.

    A scenario that ends where another ends comes after it.

    Raises
    ------
    DesatError
        If a named scenario has no design of its own.
    """
    selected = [find(n) for n in names] or [
        s for s in scenarios().values() if s.content.design and not s.content.design.of
    ]
    for s in selected:
        if (design := s.content.design) is None:
            raise DesatError(f"{s.name}: it has no [design]")
        if design.of:
            other = f"{s.family}/{design.of}"
            raise DesatError(
                f"{s.name} uses the design of {other}: run `desat design {other}`"
            )
    return sorted(selected, key=lambda s: bool(design_of(s).end_of))


def design(scenario: Scenario, options: Options | None = None) -> MadeDesign:
    """Compute a scenario's design for the values of `options`.

    Raises
    ------
    DesatError
        If it cannot be made.
    """
    options = options or Options()
    system, _ = case_for(scenario, options).or_raise()
    kind = next((k for k in kinds() if k.applies(system)), None)
    if kind is None:
        raise DesatError(f"{scenario.name}: {_no_kind(system)}")
    for key in design_of(scenario).written:
        if key not in (*COMMON, *kind.KEYS):
            name = kind.__name__.rpartition(".")[2]
            raise DesatError(
                f"{scenario.name}: design: {key} is not for {name}; known are "
                f"{', '.join(kind.KEYS)}"
            )
    new_design: MadeDesign = kind.make(scenario, options)
    return new_design


def _no_kind(system: System) -> str:
    """Return the message that no kind of design applies to a system."""
    names = ", ".join(k.__name__.rpartition(".")[2] for k in kinds())
    manager = system.components.get("manager")
    constituents = ""
    if manager is not None:
        constituents = f" for {manager.model}"
        for signal in manager.interface.elements.get("law", ()):
            constituents += f" {manager.choice(signal.name)}"
    return f"no design{constituents}; there is one for {names}"


_designs: dict[str, MadeDesign] = {}


def parameters_for(scenario: Scenario, options: Options) -> dict[str, Parameters]:
    """Return the designed parameters that `options.design` selects, by component.

    They are read from a file, or computed now for the values of the options.

    Raises
    ------
    DesatError
        If that is impossible.
    """
    if options.design is None:
        return {}
    if scenario.design is None:
        raise DesatError(f"--design {options.design}: {scenario.name} has no [design]")
    if options.design != NOW:
        return dict(read_design(Path(options.design)).parameters)
    other, fitting, _ = owner(scenario, options)
    key = repr((other.name, fitting))
    if key not in _designs:
        _designs[key] = design(other, fitting)
    return {_designs[key].component: _designs[key].parameters}


def text(
    scenario: Scenario, new_design: MadeDesign, options: Options | None = None
) -> str:
    """Return the text of a design's file.

    The same design with the same versions gives the same text.
    """
    from importlib.metadata import version

    versions = ", ".join(f"{p} {version(p)}" for p in PACKAGES)
    lines = [
        f"# Computed by `desat design {scenario.name}`, not kept by hand; {versions}.",
        "# `reached` is what the run on bare blocks that it was computed with ended with.",
        *(f"# {note}." for note in new_design.notes),
    ]
    if assumed := design_of(scenario).assume:
        lines.append(f"# Assumed, against the scenario: {assumed}.")
    if new_design.tuned:
        lines += ["", "[tuned]"]
        lines += [
            f"{name} = {value!r}  # {unit}"
            for name, (value, unit) in new_design.tuned.items()
        ]
    lines += [
        "",
        "[reached]",
        *(f"{k} = {v!r}  # {u}" for k, (v, u) in new_design.reached.items()),
        "",
        f"[parameters.{new_design.component}]",
        *(_assignment(name, value) for name, value in new_design.parameters.items()),
    ]
    without = {f"{new_design.component}.{k}" for k in new_design.parameters}
    system = system_of(scenario, options or Options())
    made_from = made_of(scenario, system, without)
    for option in options.sources if options else ():
        name, _, source = option.partition("=")
        made_from[f"source.{name}"] = Path(source).stem
    return "\n".join(lines) + "\n" + origin_text(made_from)


def origin_text(values: dict[str, Any]) -> str:
    """Return the table that ends a design's file."""
    lines = [f"{json.dumps(k)} = {_toml_value(v)}" for k, v in values.items()]
    return "\n".join(["", f"[{TABLE}]", *lines]) + "\n"


def _toml_value(value: Any) -> str:
    """Format a value in TOML."""
    if isinstance(value, list):
        return f"[{', '.join(_toml_value(v) for v in value)}]"
    return json.dumps(value) if isinstance(value, (str, bool)) else repr(value)


def _assignment(name: str, value: Any) -> str:
    """Format an assignment in TOML, a matrix with a row on each line."""
    if isinstance(value, list) and isinstance(value[0], list):
        return "\n".join([f"{name} = [", *(f"  {row!r}," for row in value), "]"])
    return f"{name} = {value!r}"


def as_json(scenario: Scenario, new_design: MadeDesign, path: Path) -> dict[str, Any]:
    """Return the data that `--json` prints of a design written to `path`."""
    return {
        "scenario": scenario.name,
        "file": str(path),
        "tuned": {
            name: {"value": v, "unit": u} for name, (v, u) in new_design.tuned.items()
        },
        "reached": {name: v for name, (v, _) in new_design.reached.items()},
    }


def write(
    scenario: Scenario,
    new_design: MadeDesign,
    options: Options | None = None,
    file: Path | None = None,
) -> Path:
    """Write a design's file (default: where the scenario looks) and return its path."""
    path = (
        file
        or ROOT / scenario.family / "design" / f"{scenario.name.partition('/')[2]}.toml"
    )
    replace_text(path, text(scenario, new_design, options))
    return path


def confirm(scenario: Scenario) -> bool:
    """Renew the table [made_of] of a stored design if a run confirms the design.

    The run with the stored numbers has to reach the results in the file, to `ROUNDING`;
    otherwise nothing is written and the result is False.
    """
    from .plant import Plant

    if scenario.design is None:
        raise DesatError(f"{scenario.name}: it has no [design]")
    file = read_design(scenario.design)
    plant = Plant(scenario)
    flight = plant.fly(**file.parameters["manager"])
    for key, (value, _) in flight.reached().items():
        stored, now = np.atleast_1d(file.reached[key]), np.atleast_1d(value)
        if not np.abs(now - stored).max() <= ROUNDING * np.abs(stored).max():
            return False
    content = scenario.design.read_text(encoding="utf-8").partition(f"\n[{TABLE}]\n")[0]
    origin = origin_text(
        made_of(scenario, system_of(scenario, Options()), names_of(file))
    )
    replace_text(scenario.design, content + origin)
    return True


def main() -> int:
    """Run `python -m desat.papers.designs.making`: stamp designs that runs confirm."""
    failed = 0
    for scenario in designable([]):
        try:
            confirmed = confirm(scenario)
        except DesatError as error:  # a design of another kind
            print(f"left: {error}")
            continue
        if not confirmed:
            failed += 1
            print(f"{scenario.name}: a run with its design ends elsewhere; not stamped")
    return min(failed, 1)


if __name__ == "__main__":
    raise SystemExit(main())
