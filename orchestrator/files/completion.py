"""Complete a draft: evaluate products of parameters, compare wires, and check times."""

from __future__ import annotations

import math
from collections.abc import Iterator

from ..system.errors import DesatError
from ..system.expression import evaluate
from ..system.interface import base_name
from ..system.model import System
from .connect import check_connections, check_connectors
from .draft import SHARED, Draft

# no component may have these names: series of times, parameters of all
RESERVED = ("time", SHARED)
# SI; no quantity of a spacecraft is larger, and its square and cube are finite
LARGEST = 1e40
MOST_STEPS = 1e12  # of a run: at a microsecond each they take eleven days


def complete(draft: Draft) -> System | None:
    """Build the system, or return None if there are `problems`.

    Parameters that are products of others are evaluated, also where the system has
    problems, so that the components can be compared with what a scenario names.
    """
    draft.problems += _name_problems(draft)
    if draft.unchecked:
        check_connectors(draft)
    references = {
        (name, parameter): text
        for name, component in draft.components.items()
        for parameter, text in component.references.items()
    }
    draft.components, wrong, unsure = evaluate(
        draft.components, references, draft.place
    )
    draft.problems += [*draft.refused.values(), *wrong]
    draft.warnings += unsure
    draft.problems += _too_large(draft)
    connections = tuple(draft.connections)
    if draft.unchecked:
        connections = check_connections(draft)
    draft.problems = list(dict.fromkeys(draft.problems))
    draft.warnings += draft.guesses.values()
    draft.guesses = {}
    try:
        step, stop = _times(draft)
    except DesatError as error:
        draft.problems.append(str(error))
    if draft.problems:
        return None
    return System(
        draft.name,
        draft.place,
        draft.components,
        connections,
        step,
        stop,
        draft.start,
        draft.substeps,
        draft.accuracy,
        draft.output_classes,
        draft.about,
        draft.body,
    )


def system_of(draft: Draft) -> System:
    """Build the system.

    Raises
    ------
    DesatError
        If there are problems, with a line for each.
    """
    system = complete(draft)
    if system is None:
        raise DesatError("\n".join(draft.problems))
    return system


def _name_problems(draft: Draft) -> Iterator[str]:
    """Find component names with which no name of a series can begin."""
    for c in draft.components.values():
        bad = set("./[]*?=") & set(c.name)
        if bad or not c.name.strip() or not c.name.isprintable() or c.name in RESERVED:
            yield (
                f"{draft.place}:{c.line}: component {c.name!r}: a name is needed without . / ["
                f" ] * ? = and other than {', '.join(RESERVED)}"
            )


def _too_large(draft: Draft) -> Iterator[str]:
    """Find values of our roles that are too large for any quantity, a line each."""
    for component in draft.components.values():
        if not component.interface.role:
            continue
        for name, value in component.parameters.items():
            if isinstance(value, float) and not abs(value) <= LARGEST:
                place = component.origins.get(base_name(name), draft.place)
                yield (
                    f"{place}: {component.name}.{name} = {value:g}: a magnitude of at most "
                    f"{LARGEST:g} is needed"
                )


def _times(draft: Draft) -> tuple[float, float]:
    """Return step and stop time (s).

    Raises
    ------
    DesatError
        If the number of steps from start to stop is not whole, or is too large.
    """
    start, step, stop = draft.start, draft.step, draft.stop
    if step is None or stop is None:
        missing = "step" if step is None else "stop time"
        raise DesatError(
            f"{draft.place}: no {missing} is given; use --{missing.split()[0]}"
        )
    by_step, by_stop = (draft.origins.get(key, draft.place) for key in ("step", "stop"))
    both = by_step if by_step == by_stop else f"{by_stop}, {by_step}"
    if not (math.isfinite(step) and step > 0.0):
        raise DesatError(f"{by_step}: step {step:g} s; a positive number is needed")
    span = (stop - start) / step
    if not 1.0 - 1e-9 <= span < math.inf:
        raise DesatError(
            f"{both}: no step of {step:g} s from {start:g} s to {stop:g} s"
        )
    if span >= MOST_STEPS:
        raise DesatError(
            f"{both}: {span:.3g} steps of {step:g} s; at most {MOST_STEPS:g} are made"
        )
    if start + step == start or stop - step == stop:
        raise DesatError(
            f"{both}: from {start:g} s to {stop:g} s, time does not grow by a step of "
            f"{step:g} s"
        )
    if abs(span - round(span)) > 1e-6:
        raise DesatError(
            f"{both}: {stop - start:g} s is not a multiple of the step {step:g} s"
        )
    return step, stop
