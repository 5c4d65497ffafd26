"""Before a run: a target found, read, changed by the options, and checked."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from desat.components.contract.block import Scalar

from ..analyses import problems, warnings
from ..analyses.manifest import Manifest
from ..analyses.needs import undesigned
from ..designs import making, origin
from ..designs import problems as design_problems
from ..engine.instances.isolated import CAN
from ..engine.master import Spare
from ..files import library, scenario, ssp
from ..files.assembly import modify
from ..files.scenario import Scenario
from ..language.content import NOTHING, dispersed, said
from ..system.check import Checked, check, foreseen, without_effect
from ..system.draft import Draft
from ..system.errors import DesatError
from ..system.interface import base_name
from ..system.model import Component, System
from ..system.options import Options
from ..system.parameters import expand
from ..system.resolve import resolve
from ..system.schedule import Schedule
from . import stopping, validation


@dataclass(frozen=True)
class Case:
    """A target with options, checked: what a run needs, or what is wrong with it."""

    target: str
    options: Options
    where: str
    """The file that its system was read from, for messages."""
    checked: Checked
    manifest: Manifest | None = None
    """Its manifest before it runs, where that is known from another case (`varied`)."""
    spare: Spare | None = None
    """Whose master it may run with, where there are others that differ in values alone."""

    def or_raise(self) -> tuple[System, Schedule]:
        """The system and its schedule; raises DesatError with every problem, a line each."""
        return self.checked.or_raise()


@dataclass(frozen=True)
class Source:
    """A target as it is read, before options change it: what many cases of it have in common."""

    target: str
    scenario: Scenario | None
    """None for an SSP file or a folder."""
    _drafts: dict[tuple[bool, bool, bool], Draft] = field(default_factory=dict)
    _drawable: set[bool] = field(default_factory=set)
    _first: dict[str, tuple[Case, Draft]] = field(default_factory=dict)
    """Of options without values: the first case that was prepared, and its draft."""

    def draft(self, blocks: bool, designed: bool = True, outside: bool = False) -> Draft:
        """Its system, to be changed by options, with what is wrong so far. `blocks`: of bare
        blocks; `designed` False leaves its design out; `outside`: an SSP may name
        files outside its folder. Raises DesatError where it has none."""
        key = blocks, designed, outside
        if key not in self._drafts:
            if self.scenario is not None:
                draft = self.scenario.draft(blocks, designed)
            else:
                draft = ssp.read(Path(self.target), outside)
                library.load_interfaces(draft, blocks)
            if told := self.scenario or _told(draft):
                draft.problems += validation.words(told) or validation.names(told, draft)
            self._drafts[key] = draft
        return self._drafts[key].copy()

    def to_draw(self, blocks: bool) -> Draft:
        """Its system, to draw values for. Raises DesatError where something is wrong with it."""
        draft = self.draft(blocks)
        if blocks not in self._drawable:
            if self.scenario is not None and not draft.problems:
                draft.problems += validation.dispersions(self.scenario, draft)
            if draft.problems:
                raise DesatError("\n".join(draft.problems))
            self._drawable.add(blocks)
        return draft


def read(target: str) -> Source:
    """The source that a target names: a scenario's name, a scenario file, an .ssp, an .ssd or a
    folder. Raises DesatError where there is none."""
    path = Path(target)
    if (own := path / scenario.NOMINAL).is_file():
        return Source(target, scenario.own(own))
    if path.suffix in (".ssp", ".ssd") or path.is_dir():
        return Source(target, None)
    if path.suffix != ".toml" and (beside := Path(f"{target}.toml")).is_file():
        path = beside
    if path.suffix == ".toml":
        return Source(target, scenario.own(path))
    try:
        return Source(target, scenario.find(target))
    except DesatError:
        if not path.exists():
            raise
    raise DesatError(f"{target}: it ends in none of .toml, .ssp, .ssd, and is no folder")


def prepare(target: str | Source, options: Options) -> Case:
    """Read a system, apply the options, and check it; warns of a design made for other values.
    Who makes many cases of it reads it once (`read`).

    Raises DesatError where there is nothing to check, or an option is wrong.
    """
    return _prepared(read(target) if isinstance(target, str) else target, options)[0]


def _prepared(source: Source, options: Options) -> tuple[Case, Draft]:
    """As `prepare`, and the draft that was checked."""
    described = source.scenario
    if options.design is None and options.values and described and described.each_draw:
        options = replace(options, design=making.NOW)
    if options.design is not None and described is None:
        raise DesatError(
            f"--design {options.design}: {source.target} is no scenario with a [design]"
        )
    draft = source.draft(options.blocks, options.design is None, options.outside)
    _modify(draft, described, options)
    checked = check(draft)
    if checked.system is not None:
        components = checked.system.components.values()
        checked.problems += library.problems(components, options.trusted)
        faults = checked.problems if options.strict else checked.warnings
        faults += library.told_faults(components)
        checked.warnings += library.told_unused(components)
        checked.problems += validation.recording_problems(checked.system, options)
        checked.problems += validation.not_saved(checked.system, options)
        checked.problems += validation.not_halved(checked.system, options)
        checked.problems += _isolation_problems(checked.system, options)
        checked.warnings += _isolation_warnings(checked.system, options)
        if checked.schedule is not None:
            _check_wishes(checked, checked.system, checked.schedule, described, options)
    return Case(source.target, options, draft.where, checked), draft


def varied(source: Source, options: Options) -> Case:
    """As `prepare`, for one of many cases that differ in values alone (`options.values`): only the
    components that get a value are resolved and checked anew. What its system is and what is wrong
    with it is as `prepare` has it; its warnings are those of the first case.

    Raises DesatError as `prepare`.
    """
    key = repr(replace(options, values=dict.fromkeys(sorted(options.values))))
    if key not in source._first:
        case, draft = _prepared(source, options)
        system, _ = case.or_raise()
        begun = Manifest.of(system, options, case.target)
        case = replace(case, manifest=begun, spare=Spare())
        source._first[key] = case, draft
        return case
    first, draft = source._first[key]
    system, schedule = first.or_raise()
    changed = _changed(system, draft, options.values)
    if changed is None:
        return prepare(source, options)
    system = replace(system, components={**system.components, **changed})
    some = replace(system, components=changed)
    ends = first.checked.unwired
    if [*without_effect(some, ends), *foreseen(some, ends)[0]]:
        return prepare(source, options)  # which says what is wrong as it is always said
    manifest = first.manifest and first.manifest.varied(system, changed.values())
    checked = replace(first.checked, system=system, schedule=schedule)
    return replace(first, options=options, checked=checked, manifest=manifest)


def _changed(
    system: System, draft: Draft, values: Mapping[str, Any]
) -> dict[str, Component] | None:  # fmt: skip
    """The components of a checked system that get other values; None where more than their own
    values would change by that, or one does not fit."""
    texts = [t for c in draft.components.values() for t in c.references.values()]
    told = [said(system.about).written.get(k) for k in ("numbers", "stop_when", "design")]
    named = set(re.findall(r"\w+", " ".join([*texts, repr(told)])))
    parameters: dict[str, dict[str, Scalar]] = {}
    for name, value in values.items():
        owner, _, variable = name.partition(".")
        component = system.components.get(owner)
        if component is None or isinstance(value, str):
            return None
        signals = component.interface.elements(variable)
        if any(s.shared for s in signals) or variable.endswith("sample_time") or (
            variable == "delay" or base_name(variable) in named
        ):  # fmt: skip
            return None
        try:
            given = expand(component.interface, variable, value, owner)
        except DesatError:
            return None
        parameters.setdefault(owner, dict(component.parameters)).update(given)
    return {
        name: replace(system.components[name], parameters=given)
        for name, given in parameters.items()
    }


def resolved(target: str | Source, options: Options) -> tuple[System, Any]:
    """The system of a target with the options applied, unchecked; and, where its design is made for
    the values of each draw, what its scenario says of it. Raises DesatError where it cannot be had.
    """
    source = read(target) if isinstance(target, str) else target
    draft = source.draft(options.blocks, options.design is None, options.outside)
    _modify(draft, source.scenario, options)
    found = resolve(draft)
    if found.system is None:
        raise DesatError("\n".join(found.problems))
    return found.system, source.scenario and source.scenario.each_draw


def _modify(draft: Draft, described: Scenario | None, options: Options) -> None:
    """Change a system as the options say; warn of a design made for other values."""
    drawn = _drawn(draft, described, options)
    if described is None or options.design is None:
        modify(draft, options, drawn=drawn)
        if source := described or _packed_from(draft):
            draft.warnings += origin.warnings(source, options)
    else:
        modify(draft, options, _designed(described, options), drawn)
    if options.fmus != "native":
        for component in draft.components.values():
            if component.fmu is not None:
                component.fmu = library.of_kind(component.fmu, options.fmus)


def _drawn(draft: Draft, described: Scenario | None, options: Options) -> dict[str, str]:
    """File and key of the dispersion of each value that is drawn: a draw has a value for each."""
    spread = dispersed(draft)
    if not spread.keys() <= options.values.keys():
        return {}
    given = said(draft.about).dispersions
    where = {}
    for name in spread:
        key = name if name in given else f"*.{name.partition('.')[2]}"
        path = ("dispersions", key)
        file, key = described.given(path) if described else (draft.where, ".".join(path))
        where[name] = f"{file}: {key}"
    return where


def _check_wishes(
    checked: Checked, system: System, schedule: Schedule, described: Scenario | None,
    options: Options,
) -> None:  # fmt: skip
    """Add what of a sound system does not suit what its scenario, and the options, want of it;
    what another FMU lacks, which the options put in a place, is left out of the content."""
    if options.sources:
        checked.problems += undesigned(system)
        content, left_out = validation.fitted(said(system.about), system)
        checked.system = system = replace(system, about=content)
        checked.warnings += [described.where(path) + f": {text}" if described
                             else f"{system.where}: {'.'.join(path)}: {text}"
                             for path, text in left_out]  # fmt: skip
    elif described is not None:
        checked.problems += validation.wants(described, system)
    else:
        checked.problems += [f"{system.where}: {t}" for t in stopping.problems(system)]
    checked.problems += design_problems(system)
    if not options.sources:
        content = said(system.about)
        name = content.name or system.name
        checked.problems += [f"{name}: {'.'.join(path)}: {text}"
                             for path, text in validation.numbers(content, system)]  # fmt: skip
    checked.problems += problems(system)
    checked.warnings += warnings(system)
    if options.algorithm == "jacobi":
        checked.warnings += _under_jacobi(system, schedule)


def _under_jacobi(system: System, schedule: Schedule) -> Iterator[str]:
    """What the other masters' semantics leaves out."""
    if system.parts > 1:
        yield f"jacobi takes no inner steps: inner = {system.inner} has no effect"
    if any(text.startswith(("mean of", "its part of")) for _, text in schedule.timing):
        yield "jacobi hands on one mean of several where rates differ: momentum is not conserved"


def _told(draft: Draft) -> Scenario | None:
    """What a packed system says of itself, as a scenario; None where it says nothing."""
    content = said(draft.about)
    if content is NOTHING:
        return None
    file = Path(draft.where).parent / ssp.ABOUT
    return Scenario(content, file, file.parent)


def _packed_from(draft: Draft) -> Scenario | None:
    """The scenario of ours that a packed system was packed from."""
    name = said(draft.about).name
    return scenario.find(name) if scenario.exists(name) else None


def _designed(described: Scenario, options: Options) -> dict[str, dict[str, Any]]:
    """The parameters of the design that the options ask for, but for those that the scenario
    gives itself."""
    own = described.parameters(designed=False)
    return {
        name: {k: v for k, v in values.items() if k not in own.get(name, {})}
        for name, values in making.parameters_for(described, options).items()
    }


# --- Which components run in processes of their own, and what to say where there can be none ----


def wanted(system: System, options: Options) -> frozenset[str]:
    """The components for which the options ask for a process."""
    if options.isolate == "none":
        return frozenset()
    return frozenset(
        c.name for c in system.components.values()
        if c.fmu is not None and (options.isolate == "all" or not c.fmu.ours)
    )  # fmt: skip


def isolated(system: System, options: Options) -> frozenset[str]:
    """Those that get one: all that are wanted, on POSIX."""
    return wanted(system, options) if CAN else frozenset()


def _isolation_problems(system: System, options: Options) -> Iterator[str]:
    """A line where all are to have a process each, and none can."""
    if options.isolate != "all":
        return
    if not CAN:
        yield "--isolate all: it needs processes that can be forked (POSIX)"
    elif not wanted(system, options):
        yield "--isolate all: it has no effect without an FMU"


def _isolation_warnings(system: System, options: Options) -> Iterator[str]:
    """A line where foreign FMUs are to have a process each, and none can."""
    if not CAN and options.isolate == "foreign" and (names := sorted(wanted(system, options))):
        yield (f"{', '.join(names)}: foreign FMUs run in the process of the run, which they may "
               "end: a process each needs POSIX")  # fmt: skip
