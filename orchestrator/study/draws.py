"""`desat draws`: seeded draws of a scenario's dispersions, over processes, one row a draw.

    [dispersions]
    "spacecraft.h_start_body" = { normal = [0.0, 1.3] }      # each element: mean, deviation
    "environment.phase" = { uniform = [0.0, 6.283] }         # each element: low, high
    "spacecraft.omega_start_body" = { direction = 0.17 }     # random direction, this size
    "spacecraft.q_start_bi" = { attitude = "random" }        # uniform over all attitudes
    "spacecraft.h_start_body" = { signs = [0.1, 0.1, 0.1] }  # each element: plus or minus this
    "environment.phase" = { one_of = [0.0, 1.5, 3.0] }       # one of these, as likely as each other
    "*.seed" = { seed = true }                               # every component that has a seed

What is drawn depends on seed, draw and name alone, not on the order of the lines.
"""

from __future__ import annotations

import statistics
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing import get_context
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import track

from ..analyses import analyses
from ..system.draft import Draft
from ..system.errors import DesatError, RunError, nearest
from ..system.interface import base_name
from .case import Options, load, prepare, simulate

STOPPED = 128
"""Exit codes above are those of somebody who stopped the run."""
KINDS = ("normal", "uniform", "direction", "attitude", "signs", "one_of", "seed")


def dispersed(system: Draft) -> dict[str, dict[str, Any]]:
    """`component.variable` -> how it is drawn."""
    spread: dict[str, dict[str, Any]] = {}
    for key, spec in system.about.get("dispersions", {}).items():
        owner, _, variable = key.partition(".")
        owners = [c.name for c in system.having(variable)] if owner == "*" else [owner]
        spread |= {f"{name}.{variable}": spec for name in owners}
    return spread


def drawn(system: Draft, seed: int, draw: int) -> dict[str, Any]:
    """`component.variable` -> value for one draw of the system's dispersions."""
    values = {}
    for name, spec in dispersed(system).items():
        owner, _, variable = name.partition(".")
        values[name] = _value(system, owner, variable, spec, seed, draw)
    return values


def _value(
    system: Draft, owner: str, variable: str, spec: dict[str, Any], seed: int, draw: int
) -> Any:
    component = system.component(owner, f"{system.where}: dispersions")
    size = len(component.elements(variable))
    where = f"{system.where}: dispersions: {owner}.{variable}"
    if size == 0:
        signals = component.interface.of("parameter") if component.interface else ()
        raise DesatError(f"{where}: no such parameter"
                         f"{nearest(variable, {base_name(s.name) for s in signals})}")  # fmt: skip
    if len(spec) != 1 or next(iter(spec)) not in KINDS:
        raise DesatError(f"{where}: one of {', '.join(KINDS)} is needed")
    stream = np.random.default_rng([seed, draw, zlib.crc32(f"{owner}.{variable}".encode())])
    ((kind, given),) = spec.items()
    if kind == "normal":
        return [float(x) for x in stream.normal(given[0], given[1], size)]
    if kind == "uniform":
        return [float(x) for x in stream.uniform(given[0], given[1], size)]
    if kind == "signs":
        return [float(x) for x in stream.choice([-1.0, 1.0], len(given)) * np.array(given)]
    if kind == "one_of":
        return given[int(stream.integers(len(given)))]
    if kind == "seed":
        return int(stream.integers(1, 2**31 - 1))
    vector = stream.normal(size=size)
    vector /= np.linalg.norm(vector)
    return [float(x) for x in (vector if kind == "attitude" else given * vector)]


def one(target: str, options: Options, seed: int, draw: int | None) -> dict[str, Any]:
    """A run as a row: how it ended, its numbers, and the values drawn (`draw` None: nothing is).

    It is made in a process of its own, which a component may end. Raises DesatError, which names
    target and draw, for one that could not begin or was stopped.
    """
    values = {} if draw is None else drawn(system_of(target, options), seed, draw)
    case = prepare(target, replace(options, values={**options.values, **values}))
    system, _ = case.or_raise()
    if options.record == ("*",):
        needed = tuple(needed_signals(system.about))
        for analysis in analyses():
            parts = analysis.applies(system)
            needed += tuple(analysis.signals(parts)) if parts else ()
        case = replace(case, options=replace(case.options, record=needed))
    where = target if draw is None else f"{target}: draw {draw}"
    try:
        run = simulate(replace(case, options=replace(case.options, supervised=True)))
    except DesatError as error:
        raise RunError(
            "\n".join(f"{where}: {x}" for x in str(error).splitlines()), error.code
        ) from error
    if run.code > STOPPED:
        run.or_raise(where)
    row = {
        "draw": draw,
        "status": run.manifest["status"],
        "code": int(run.code),
        "message": run.manifest["message"],
        "unmet": run.manifest["unmet"],
        "stopped_when": run.manifest["stopped_when"],
        "numbers": {name: n["value"] for name, n in run.manifest["numbers"].items()},
        "values": values,
    }
    run.results.close()
    return row


def system_of(target: str, options: Options) -> Draft:
    """The draft of a target. Raises DesatError where something is wrong with it."""
    draft = load(target, options.blocks)
    if draft.problems:
        raise DesatError("\n".join(draft.problems))
    return draft


def needed_signals(about: Mapping[str, Any]) -> list[str]:
    """What a scenario's numbers are made of; the rest need not be recorded."""
    found: list[str] = []
    for number in about.get("numbers", {}).values():
        signals = number.get("signal", [])
        found += [signals] if isinstance(signals, str) else signals
    return sorted(set(found))


@contextmanager
def pool_of(jobs: int) -> Iterator[Callable[..., Iterable[Any]]]:
    """A `map` over so many processes; with one it is this process."""
    if jobs == 1:
        yield map
        return
    try:
        with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
            yield pool.map
    except BrokenProcessPool as error:  # runs themselves are made in processes of their own
        raise RunError(
            "a process that made runs was killed from outside; is there memory enough?"
        ) from error


def rows_of(
    tasks: Sequence[tuple[str, Options, int, int | None]], jobs: int, title: str, progress: bool
) -> list[dict[str, Any]]:  # fmt: skip
    """The row (`one`) of each task, over so many processes."""
    with pool_of(min(jobs, len(tasks))) as map_:
        console = Console(stderr=True)
        return list(
            track(map_(one, *zip(*tasks, strict=True)), title, total=len(tasks), console=console,
                  transient=True, disable=not (progress and console.is_terminal))
        )  # fmt: skip


def draws(
    target: str, count: int, seed: int, options: Options, jobs: int = 2, progress: bool = False
) -> dict[str, Any]:
    """Run `count` draws and return rows and, for each number, median, least and largest.

    Draw i of a seed is the same whatever the count and the number of processes.
    """
    system = system_of(target, options)
    if not system.about.get("dispersions"):
        raise DesatError(f"{target}: it has no [dispersions], so there is nothing to draw")
    first = replace(options, values={**options.values, **drawn(system, seed, 0)})
    warnings = prepare(target, first).checked.warnings
    given = {text.partition("=")[0] for text in options.sets} & dispersed(system).keys()
    warnings += [f"--set {name}: it is drawn, and so never has this value" for name in given]
    tasks = [(target, options, seed, draw) for draw in range(count)]
    rows = rows_of(tasks, jobs, target, progress)
    stopped = sum(r["stopped_when"] is not None for r in rows)
    return {
        "scenario": target, "seed": seed, "draws": rows, "stopped": stopped,
        "summary": summary(rows, system.about), "warnings": warnings,
    }  # fmt: skip


def summary(rows: list[dict[str, Any]], about: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Of each number of the draws that completed: unit, median, least, largest, and how many draws
    have reached it."""
    whole = [r for r in rows if r["status"] == "completed"]
    definitions = about.get("numbers", {})
    found = {}
    for name in whole[0]["numbers"] if whole else ():
        values = [x for r in whole if (x := r["numbers"].get(name)) is not None]
        found[name] = {
            "unit": definitions.get(name, {}).get("unit", ""),
            "median": statistics.median(values) if values else None,
            "min": min(values, default=None),
            "max": max(values, default=None),
            "n": len(values),
        }
    return found
