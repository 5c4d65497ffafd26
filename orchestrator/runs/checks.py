"""Check a case before it runs: one list of checks, and one loop over it.

Each check yields a line for each finding. Its level says when it is made: "structure"
for any system, "run" before every run, and "study", which flies, by `desat check` and
`new craft` alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import wraps
from pathlib import Path
from typing import Literal, NamedTuple

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
    unmanaged_orbit,
    wheels,
)
from ..files import library
from ..files.build import build
from ..files.draft import Draft
from ..files.scenario import Scenario, of_its_file
from ..language.content import NOTHING
from ..system import check
from ..system.errors import DesatError
from ..system.model import System
from ..system.options import Options
from ..system.schedule import schedule as schedule_of
from . import isolation, validation
from .case import Case
from .provider import provider

Lines = Iterable[str]


Level = Literal["structure", "run", "study"]


class Check(NamedTuple):
    """Something that is looked for in a case, where the case has what it needs."""

    kind: Literal["problem", "warning", "note"]
    find: Callable[[Case], Lines]
    needs: Literal["nothing", "system", "schedule"] = "schedule"
    level: Level = "run"


def run_checks(case: Case, *levels: Level) -> None:
    """Add the findings of all checks of these levels to a case."""
    findings = {"problem": case.problems, "warning": case.warnings, "note": case.notes}
    for check_made in CHECKS:
        has_needs = {
            "nothing": True,
            "system": case.system is not None,
            "schedule": case.schedule is not None,
        }
        if check_made.level in levels and has_needs[check_made.needs]:
            findings[check_made.kind] += check_made.find(case)


def check_draft(
    draft: Draft, options: Options | None = None, scenario: Scenario | None = None
) -> Case:
    """Complete a draft, check its structure and order its exchange.

    Parameters
    ----------
    draft
        The system.
    options
        Options of its run; None: the default ones.
    scenario
        The scenario that it is built of; None: none, a program has built it.
    """
    if scenario is None:
        scenario = Scenario(NOTHING, Path(draft.place), Path())
    case = Case.of_draft(scenario, options or Options(), draft)
    run_checks(case, "structure")
    if case.system is not None and not case.problems:
        try:
            case.schedule = schedule_of(case.system, case.options.breaks_loops)
            case.warnings += case.schedule.warnings
        except DesatError as error:
            case.problems += str(error).splitlines()
    return case


# --- Kinds of checks by what they look at ---------------------------------------------


def of_system(find: Callable[[System], Lines]) -> Callable[[Case], Lines]:
    """Make a check of a case from one of its system."""

    @wraps(find)
    def of_case(case: Case) -> Lines:
        assert case.system is not None
        return find(case.system)

    return of_case


def of_run(find: Callable[[System, Options], Lines]) -> Callable[[Case], Lines]:
    """Make a check of a case from one of its system and options."""

    @wraps(find)
    def of_case(case: Case) -> Lines:
        assert case.system is not None
        return find(case.system, case.options)

    return of_case


# --- Checks of a case -----------------------------------------------------------------


def output_classes(case: Case) -> Lines:
    """Yield a line for each wrong class of an output."""
    assert case.system is not None
    return check.wrong_output_classes(case.system, case.draft.origins)


def without_effect(case: Case) -> Lines:
    """Yield a line for each parameter that an open input leaves without effect."""
    assert case.system is not None
    return check.without_effect(case.system, case.unwired)


def loops(case: Case) -> Iterator[str]:
    """Yield a line if loops are to be solved and there is none."""
    if case.options.solve_loops and case.schedule and not case.schedule.loops:
        yield "--solve-loops: there is no algebraic loop"


def open_ends(case: Case) -> Lines:
    """Yield the open ends of each component."""
    return filter(None, (ends.text(name) for name, ends in case.unwired.items()))


def faults_as(kind: Literal["problem", "warning"]) -> Callable[[Case], Lines]:
    """Make the check of FMUs against the standard, of which `strict` makes problems."""

    def of_case(case: Case) -> Lines:
        if case.options.strict != (kind == "problem"):
            return ()
        components = case.draft.components.values()
        return library.fault_warnings((c.name, c.fmu) for c in components)

    return of_case


def content_problems(case: Case) -> Iterator[str]:
    """Yield a line for each entry of a scenario that does not suit its own system.

    That of a packed system was fit to it when it was packed. Where options replace
    FMUs, it is the system without these.
    """
    source = case.described
    if source is None:
        return
    content, components, system = source.content, None, None
    if not source.is_system_file and case.options.sources:
        plain = Options(blocks=case.options.blocks)
        components = build(case.scenario, plain).components
    elif not source.is_system_file:
        components = case.draft.components
        system = case.system if case.schedule else None
    for path, text in validation.content_problems(content, components, system):
        yield f"{source.place(path)}: {text}"


def left_out(case: Case) -> Iterator[str]:
    """Leave out the entries of a scenario that replaced FMUs do not support."""
    source, system = case.described, case.system
    is_replaced = case.scenario.is_system_file or case.options.sources
    if source is None or system is None or case.problems or not is_replaced:
        return
    content, omitted = validation.fit_to(source.content, system)
    case.system = replace(system, about=content)
    for path, text in omitted:
        yield f"{source.place(path)}: {text}"


def design_warnings(case: Case) -> Lines:
    """Yield a line if a stored design was made for other values."""
    source = case.described
    if source is not None and case.scenario.is_system_file:
        source = of_its_file(source.name)
    if case.options.design is not None or source is None or case.system is None:
        return ()
    return provider().warnings(source, case.options, case.system)


def exchange_warnings(case: Case) -> Iterator[str]:
    """Yield a line for each option without effect under the semantics of other masters.

    These concern substeps and step averages.
    """
    system, schedule, options = case.system, case.schedule, case.options
    assert system is not None
    assert schedule is not None
    if options.algorithm != "jacobi":
        return
    if system.parts > 1:
        yield f"jacobi takes no substeps: substeps = {system.substeps} has no effect"
    if any(text.startswith(("mean of", "its part of")) for _, text in schedule.timing):
        yield (
            "jacobi exchanges only one of several step averages where rates differ: momentum is "
            "not conserved"
        )


def foreign_code(case: Case) -> Lines:
    """Yield a line for each foreign FMU, with its platforms and its hash."""
    return library.notes(case.draft.components.values())


CHECKS = (
    Check("problem", of_system(check.incomplete_inputs), "system", "structure"),
    Check("warning", of_system(check.partial_inputs), "system", "structure"),
    Check("warning", of_system(check.unset_inputs), "system", "structure"),
    Check("problem", of_system(check.unequal_shared), "system", "structure"),
    Check("warning", of_system(check.errors_of_models), "system", "structure"),
    Check("problem", of_system(check.misfit_sample_times), "system", "structure"),
    Check("problem", output_classes, "system", "structure"),
    Check("problem", without_effect, "system", "structure"),
    Check("problem", lambda case: case.foreseen[0], "system", "structure"),
    Check("warning", lambda case: case.foreseen[1], "system", "structure"),
    Check("note", open_ends, "system", "structure"),
    Check("warning", of_system(check.values_of_another_craft)),
    Check("warning", loops),
    Check("problem", faults_as("problem"), "nothing"),
    Check("warning", faults_as("warning"), "nothing"),
    Check("problem", of_run(library.problems), "system"),
    Check("problem", of_run(validation.recording_problems), "system"),
    Check("problem", of_run(validation.not_saved), "system"),
    Check("problem", of_run(validation.not_halved), "system"),
    Check("problem", of_run(isolation.isolation_problems), "system"),
    Check("problem", of_run(needs.design_problems), "system"),
    Check("problem", content_problems, "nothing"),
    Check("warning", left_out, "system"),
    Check("warning", design_warnings, "system"),
    Check("problem", of_system(lambda system: provider().problems(system))),
    Check("problem", of_system(accounts.problems)),
    Check("problem", of_system(management.problems)),
    Check("problem", of_system(needs.problems)),
    Check("problem", of_system(attitude_loop.problems)),
    Check("warning", of_system(library.unused_warnings)),
    Check("warning", of_system(library.step_warnings)),
    Check("warning", of_system(accounts.warnings)),
    Check("warning", of_system(coverage.warnings)),
    Check("warning", of_system(energy.warnings)),
    Check("warning", of_system(firings.warnings)),
    Check("warning", of_system(fixed.warnings)),
    Check("warning", of_system(management.warnings)),
    Check("warning", of_system(wheels.warnings)),
    Check("warning", of_system(attitude_loop.warnings)),
    Check("warning", of_system(plausibility.warnings)),
    Check("warning", of_system(residual.warnings)),
    Check("warning", of_system(sampling.warnings)),
    Check("warning", of_system(late_state_warnings)),
    Check("warning", of_run(isolation.isolation_warnings)),
    Check("warning", exchange_warnings),
    Check("problem", of_system(unmanaged_orbit.dump_problems), level="study"),
    Check("warning", of_system(unmanaged_orbit.warnings), level="study"),
    Check("problem", of_system(attitude_loop.problems_when_full), level="study"),
    Check("problem", lambda case: case.trial[0], level="study"),
    Check("warning", lambda case: case.trial[1], level="study"),
    Check("note", foreign_code, level="study"),
    Check("note", of_system(sampling.notes), level="study"),
)
