"""Prepare a run: find the target, read it, apply the options and check the system."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from desat.components.contract.block import BlockError

from ..analyses.motion import mu_of, period_of
from ..files import craft, paths, scenario
from ..files.build import build
from ..files.completion import system_of
from ..files.draft import Draft
from ..files.scenario import Scenario
from ..language.content import NOTHING
from ..system.errors import DesatError
from ..system.model import System
from ..system.options import NOW, Options, orbits
from ..system.parameters import bare_block
from .case import Case
from .checks import check_draft, run_checks
from .provider import provider


def read(target: str) -> Scenario:
    """Find and read the source that a target names.

    It is a scenario's name, a scenario file, an .ssp, an .ssd or a folder.

    Raises
    ------
    DesatError
        If there is none.
    """
    path = Path(target)
    if (nominal := path / paths.NOMINAL).is_file():
        return replace(scenario.read_foreign(nominal), target=target)
    if path.suffix in (".ssp", ".ssd") or path.is_dir():
        return Scenario(NOTHING, path, path.parent, target, is_system_file=True)
    if path.suffix != ".toml" and (with_suffix := Path(f"{target}.toml")).is_file():
        path = with_suffix
    if path.name.endswith(craft.FILE) and path.is_file():
        there = sorted(
            x.stem for x in path.parent.glob("*.toml") if x.name != path.name
        )
        raise DesatError(
            f"{target}: a craft file describes no run; name one of its scenarios: "
            f"{', '.join(there) or 'its folder'}"
        )
    if path.suffix == ".toml":
        return replace(scenario.read_foreign(path), target=target)
    try:
        return replace(scenario.find(target), target=target)
    except DesatError:
        if not path.exists():
            raise
    raise DesatError(f"{target}: neither a .toml, .ssp or .ssd file nor a folder")


def prepare(target: str | Scenario, options: Options) -> Case:
    """Read a system, apply the options, and check it.

    For many cases of a target, read it once with `read`.

    Raises
    ------
    DesatError
        If there is nothing to check, or an option is wrong.
    """
    source = read(target) if isinstance(target, str) else target
    options = with_stop(source, options)
    if options.design is None and options.values and source.each_draw:
        options = replace(options, design=NOW)
    case = check_draft(draft_of(source, options), options, source)
    run_checks(case, "run")
    return case


def with_stop(target: str | Scenario, options: Options) -> Options:
    """Convert a stop time in orbits to seconds.

    The orbit is that of the environment at the start; the time is rounded to a whole
    step.

    Raises
    ------
    DesatError
        If the environment does not define an orbit.
    """
    if not isinstance(options.stop, str):
        return options
    count = orbits(options.stop) or 0.0
    system, _ = resolved(target, replace(options, stop=None))
    component = system.components.get("environment")
    if component is None or component.block is None:
        raise DesatError(
            f"--stop {options.stop}: {system.name} has no environment of ours, which "
            "says how long an orbit is; a time is needed"
        )
    block = bare_block(component)
    try:
        block.start()
        block.output(system.start)
    except BlockError as error:
        raise DesatError(f"--stop {options.stop}: environment: {error}") from error
    steps = round(
        count * period_of(block.r_eci, block.v_eci, mu_of(system)) / system.step
    )
    return replace(options, stop=system.start + max(1, steps) * system.step)


def resolved(target: str | Scenario, options: Options) -> tuple[System, Any]:
    """Return the unchecked system of a target with the options applied.

    The second value is the scenario's description of its design, where that is made for
    the values of each draw.

    Raises
    ------
    DesatError
        If the system cannot be built.
    """
    source = read(target) if isinstance(target, str) else target
    options = with_stop(source, options)
    return system_of(draft_of(source, options)), source.each_draw


def draft_of(source: Scenario, options: Options) -> Draft:
    """Build the draft of a scenario with the options, and with the design they select.

    Raises
    ------
    DesatError
        If the system cannot be read, or the design cannot be made.
    """
    designed = None
    if options.design is not None and source.is_system_file:
        raise DesatError(
            f"--design {options.design}: {source.target} is no scenario with a [design]"
        )
    if options.design is not None or source.design is not None:
        designed = provider().parameters_for(source, options) or None
    return build(source, options, designed)
