"""Prepare a run: find the target, read it, apply the options and check the system."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from desat.components.contract.block import BlockError, Scalar
from desat.fmus.registry import names

from ..analyses import (
    accounts,
    attitude_loop,
    coverage,
    energy,
    firings,
    fixed,
    late_state_warnings,
    management,
    needs,
    plausibility,
    residual,
    sampling,
    wheels,
)
from ..analyses.manifest import Manifest, SubstepChoice
from ..analyses.motion import period_of
from ..engine.instances.isolated import CAN
from ..engine.master import MasterPool
from ..files import craft, layers, library, paths, scenario, ssp
from ..files.builder import Builder
from ..files.scenario import Scenario
from ..language.content import NOTHING, content_of, dispersions_of
from ..system.check import Checked, foresee, without_effect
from ..system.errors import DesatError
from ..system.interface import base_name
from ..system.layer import Layer
from ..system.model import Component, System, Values
from ..system.options import NOW, Options, orbits
from ..system.parameters import bare_block, expand
from ..system.schedule import Schedule
from . import validation
from .provider import provider

DESIGNS = provider()

DEFAULT = Options()


@dataclass(frozen=True)
class Case:
    """Checked target with options: the system for a run, or the problems with it."""

    target: str
    options: Options
    place: str  # file that its system was read from, for messages
    checked: Checked
    # manifest before the run, where it is known from another case (`varied`)
    manifest: Manifest | None = None
    # pool with a master to run with, for cases that differ in values alone
    spare: MasterPool | None = None

    def or_raise(self) -> tuple[System, Schedule]:
        """Return the system and its schedule.

        Raises
        ------
        DesatError
            If there are problems; it names each on a line.
        """
        return self.checked.or_raise()


@dataclass(frozen=True)
class Target:
    """Target as it is read, before options change it: the common part of many cases."""

    text: str
    scenario: Scenario | None  # None for an SSP file or a folder
    _layers: dict[tuple[bool, bool], list[Layer]] = field(default_factory=dict)
    _to_draw: dict[bool, Builder] = field(default_factory=dict)
    # first prepared case, by the options without values
    _first: dict[str, Case] = field(default_factory=dict)
    # substeps that cases with drawn values begin with, by the options without these
    substep_choices: dict[str, SubstepChoice | None] = field(default_factory=dict)

    def builder(self, options: Options = DEFAULT) -> Builder:
        """Begin its system on bare blocks or FMUs.

        The design is left out where the options name one.

        Raises
        ------
        DesatError
            If it has no system.
        """
        key = options.design is None, options.outside
        if key not in self._layers:
            self._layers[key] = (
                [ssp.read(Path(self.text), options.outside)]
                if self.scenario is None
                else self.scenario.layers(designed=options.design is None)
            )
        first, *others = self._layers[key]
        return Builder(first, options.blocks, options.fmus).add(*others)

    def to_draw(self, blocks: bool) -> Builder:
        """Return its system to draw values for; raise DesatError for any problem."""
        if blocks not in self._to_draw:
            builder = self.builder(Options(blocks=blocks))
            scenario_drawn = self.scenario or _packed_scenario(builder)
            if scenario_drawn is not None and not builder.problems:
                found = validation.content_problems(
                    scenario_drawn.content, builder.components
                )
                builder.problems += [
                    f"{scenario_drawn.place(path)}: {text}"
                    for path, text in found
                    if "dispersions" in path
                ]
            if builder.problems:
                raise DesatError("\n".join(builder.problems))
            self._to_draw[blocks] = builder
        return self._to_draw[blocks]


def read(target: str) -> Target:
    """Find and read the source that a target names.

    It is a scenario's name, a scenario file, an .ssp, an .ssd or a folder.

    Raises
    ------
    DesatError
        If there is none.
    """
    path = Path(target)
    if (nominal := path / paths.NOMINAL).is_file():
        return Target(target, scenario.read_foreign(nominal))
    if path.suffix in (".ssp", ".ssd") or path.is_dir():
        return Target(target, None)
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
        return Target(target, scenario.read_foreign(path))
    try:
        return Target(target, scenario.find(target))
    except DesatError:
        if not path.exists():
            raise
    raise DesatError(f"{target}: neither a .toml, .ssp or .ssd file nor a folder")


def prepare(target: str | Target, options: Options) -> Case:
    """Read a system, apply the options, and check it.

    For many cases of a target, read it once with `read`.

    Raises
    ------
    DesatError
        If there is nothing to check, or an option is wrong.
    """
    target = read(target) if isinstance(target, str) else target
    if isinstance(options.stop, str):
        options = with_stop(target, options)
    return _prepare(target, options)


def with_stop(target: str | Target, options: Options) -> Options:
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
    if component is None or component.interface.model not in names():
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
    steps = round(count * period_of(block.r_eci, block.v_eci) / system.step)
    return replace(options, stop=system.start + max(1, steps) * system.step)


def _prepare(target: Target, options: Options) -> Case:
    """Prepare a case whose stop time is in seconds."""
    scenario = target.scenario
    if options.design is None and options.values and scenario and scenario.each_draw:
        options = replace(options, design=NOW)
    if options.design is not None and scenario is None:
        raise DesatError(
            f"--design {options.design}: {target.text} is no scenario with a [design]"
        )
    builder = _with_options(target, options)
    checked = builder.check(options.breaks_loops)
    system, sound = checked.system, checked.schedule is not None
    fmus = ((part.name, part.fmu) for part in builder.components.values())
    faults = library.fault_warnings(fmus)
    (checked.problems if options.strict else checked.warnings).extend(faults)
    if options.solve_loops and checked.schedule and not checked.schedule.loops:
        checked.warnings.append("--solve-loops: there is no algebraic loop")
    if system is not None:
        checked.problems += [line for find in RUNS for line in find(system, options)]
    if (scenario_read := scenario or _packed_scenario(builder)) is not None:
        _hold(checked, builder, scenario_read, target, options)
    if (
        system is not None
        and options.design is None
        and (described := scenario or _packed_from(builder))
    ):
        checked.warnings += DESIGNS.warnings(described, options, system)
    if system is not None and sound:
        checked.problems += [line for find in SYSTEMS for line in find(system)]
        checked.warnings += [line for find in WARNINGS for line in find(system)]
    if system is not None and checked.schedule is not None:
        checked.warnings += _run_warnings(system, checked.schedule, options)
    return Case(target.text, options, builder.place, checked)


def _hold(
    checked: Checked,
    builder: Builder,
    scenario_held: Scenario,
    target: Target,
    options: Options,
) -> None:
    """Add problems where a scenario's content does not suit its own system.

    Entries that other FMUs do not support are left out of the content with a warning:
    those that options put in the place of the scenario's, and those of a packed system,
    to which its content was fit when it was packed.
    """
    system, content = checked.system, scenario_held.content
    is_packed = target.scenario is None
    if is_packed:
        wrong = validation.content_problems(content, None)
    elif options.sources:
        own_components = target.builder(options).components
        wrong = validation.content_problems(content, own_components)
    else:
        built = system if checked.schedule else None
        wrong = validation.content_problems(content, builder.components, built)
    problems = [f"{scenario_held.place(path)}: {text}" for path, text in wrong]
    checked.problems += problems
    if problems or system is None or not (is_packed or options.sources):
        return
    content, left_out = validation.fit_to(scenario_held.content, system)
    checked.system = replace(system, about=content)
    checked.warnings += [
        f"{scenario_held.place(path)}: {text}" for path, text in left_out
    ]


def with_values(target: Target, options: Options) -> Case:
    """Prepare one of many cases that differ in values alone (`options.values`).

    Only the components that get a value are resolved and checked again. System and
    problems are those that `prepare` finds; the warnings are those of the first case.

    Raises
    ------
    DesatError
        As `prepare`.
    """
    if isinstance(options.stop, str):
        options = with_stop(target, options)
    key = repr(replace(options, values=dict.fromkeys(sorted(options.values))))
    if key not in target._first:
        case = _prepare(target, options)
        system, _ = case.or_raise()
        begun = Manifest.of(system, options, case.target)
        target._first[key] = replace(case, manifest=begun, spare=MasterPool())
        return target._first[key]
    first = target._first[key]
    system, schedule = first.or_raise()
    changed = _changed(system, options.values)
    if changed is None:
        return prepare(target, options)
    system = replace(system, components={**system.components, **changed})
    some = replace(system, components=changed)
    ends = first.checked.unwired
    if [*without_effect(some, ends), *foresee(some, ends)[0]]:
        return prepare(target, options)  # reports problems in the usual way
    manifest = first.manifest and first.manifest.varied(system, changed.values())
    checked = replace(first.checked, system=system, schedule=schedule)
    return replace(first, options=options, checked=checked, manifest=manifest)


def _changed(system: System, values: Values) -> dict[str, Component] | None:
    """Return the components of a checked system that get other values.

    None where more than their own values would change, or a value does not fit.
    """
    texts = [t for c in system.components.values() for t in c.references.values()]
    entries = [
        content_of(system.about).written.get(k)
        for k in ("numbers", "stop_when", "design")
    ]
    named = set(re.findall(r"\w+", " ".join([*texts, repr(entries)])))
    parameters: dict[str, dict[str, Scalar]] = {}
    for name, value in values.items():
        owner, _, variable = name.partition(".")
        component = system.components.get(owner)
        if component is None or isinstance(value, str):
            return None
        signals = component.interface.elements.get(variable, ())
        if (
            any(s.shared for s in signals)
            or variable.endswith("sample_time")
            or (variable == "delay" or base_name(variable) in named)
        ):
            return None
        try:
            elements = expand(component.interface, variable, value, owner)
        except DesatError:
            return None
        parameters.setdefault(owner, dict(component.parameters)).update(elements)
    return {
        name: replace(system.components[name], parameters=elements)
        for name, elements in parameters.items()
    }


def resolved(target: str | Target, options: Options) -> tuple[System, Any]:
    """Return the unchecked system of a target with the options applied.

    The second value is the scenario's description of its design, where that is made for
    the values of each draw.

    Raises
    ------
    DesatError
        If the system cannot be built.
    """
    target = read(target) if isinstance(target, str) else target
    options = with_stop(target, options)
    system = _with_options(target, options).system()
    return system, target.scenario and target.scenario.each_draw


def _with_options(target: Target, options: Options) -> Builder:
    """Begin the system of a target and add the layer of the options."""
    builder, scenario, designed = target.builder(options), target.scenario, None
    if scenario is not None and (
        options.design is not None or scenario.design is not None
    ):
        own_values = scenario.parameters(designed=False)
        designed = {  # except for the scenario's own values
            name: {k: v for k, v in values.items() if k not in own_values.get(name, {})}
            for name, values in DESIGNS.parameters_for(scenario, options).items()
        }
    sampled = _drawn_from(builder, scenario, options)
    return builder.add(layers.of_options(options, sampled, designed))


def _drawn_from(
    builder: Builder, described: Scenario | None, options: Options
) -> dict[str, str]:
    """Return file and key of the dispersion of each drawn value.

    A draw has a value for each dispersion; without that the result is empty.
    """
    spread = dispersions_of(builder)
    if not spread.keys() <= options.values.keys():
        return {}
    dispersions = content_of(builder.about).dispersions
    places = {}
    for name in spread:
        key = name if name in dispersions else f"*.{name.partition('.')[2]}"
        path = ("dispersions", key)
        file, key = (
            described.origin_of(path) if described else (builder.place, ".".join(path))
        )
        places[name] = f"{file}: {key}"
    return places


def _run_warnings(
    system: System, schedule: Schedule, options: Options
) -> Iterator[str]:
    """Yield a line for each option without effect.

    These concern substeps and step averages under the semantics of other masters, and
    processes for foreign FMUs where there can be none.
    """
    if (
        not CAN
        and options.isolate == "foreign"
        and (names := sorted(to_isolate(system, options)))
    ):
        yield (
            f"{', '.join(names)}: foreign FMUs run in the process of the run, which they may "
            "end: a process each needs POSIX"
        )
    if options.algorithm != "jacobi":
        return
    if system.parts > 1:
        yield f"jacobi takes no substeps: substeps = {system.substeps} has no effect"
    if any(text.startswith(("mean of", "its part of")) for _, text in schedule.timing):
        yield (
            "jacobi exchanges only one of several step averages where rates differ: momentum is "
            "not conserved"
        )


def _packed_scenario(builder: Builder) -> Scenario | None:
    """Return the scenario that is packed in a system, or None."""
    content = content_of(builder.about)
    if content is NOTHING:
        return None
    file = Path(builder.place).parent / ssp.ABOUT
    return Scenario(content, file, file.parent)


def _packed_from(builder: Builder) -> Scenario | None:
    """Return our own scenario that a packed system was packed from."""
    return scenario.of_its_file(content_of(builder.about).name)


# --- Components in processes of their own ---------------------------------------------


def to_isolate(system: System, options: Options) -> frozenset[str]:
    """Return the components for which the options require a process."""
    if options.isolate == "none":
        return frozenset()
    return frozenset(
        c.name
        for c in system.components.values()
        if c.fmu is not None and (options.isolate == "all" or not c.fmu.ours)
    )


def isolated_in(system: System, options: Options) -> frozenset[str]:
    """Return the components that get a process: all required ones, on POSIX."""
    return to_isolate(system, options) if CAN else frozenset()


def _isolation_problems(system: System, options: Options) -> Iterator[str]:
    """Yield a line if all components need a process each, and none can have one."""
    if options.isolate != "all":
        return
    if not CAN:
        yield "--isolate all: it needs processes that can be forked (POSIX)"
    elif not to_isolate(system, options):
        yield "--isolate all: it has no effect without an FMU"


# --- What a case is checked for -------------------------------------------------------

# Functions that yield a line for each problem of a run with its options.
RUNS: tuple[Callable[[System, Options], Iterable[str]], ...] = (
    library.problems,
    validation.recording_problems,
    validation.not_saved,
    validation.not_halved,
    _isolation_problems,
    needs.design_problems,
)
# Functions that yield a line for each problem of a system.
SYSTEMS: tuple[Callable[[System], Iterable[str]], ...] = (
    DESIGNS.problems,
    accounts.problems,
    management.problems,
    needs.problems,
    plausibility.problems,
    attitude_loop.problems,
)
# Functions that yield a line for each warning about a system.
WARNINGS: tuple[Callable[[System], Iterable[str]], ...] = (
    library.unused_warnings,
    library.step_warnings,
    accounts.warnings,
    coverage.warnings,
    energy.warnings,
    firings.warnings,
    fixed.warnings,
    management.warnings,
    wheels.warnings,
    attitude_loop.warnings,
    plausibility.warnings,
    residual.warnings,
    sampling.warnings,
    late_state_warnings,
)
