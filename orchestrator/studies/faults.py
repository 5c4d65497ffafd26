"""Fly a craft under faults that its law does not know of: `desat faults`.

The faults are declared in `templates/faults.toml`. A sample fails where the run does not
complete or misses a requirement, or a time that the scenario measures is not reached.
"""

from __future__ import annotations

import re
import shutil
import tempfile
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import pi
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from desat.components.blocks.disturbance_table import ROWS

from ..analyses.sampling import mean_field, orbit_period
from ..analyses.unmanaged_orbit import mean_torque
from ..campaign.draws import RunRow, rows_of
from ..files.io import replace_text
from ..files.scenario import Scenario
from ..language.content import content_of
from ..numbers.numbers import late
from ..numbers.text import number, spell_unit
from ..report.table import Column, Row, Table
from ..runs.cases import draft_to_draw
from ..runs.prepare import prepare, read
from ..runs.run import Options, simulate
from ..system import discovery
from ..system.craft import craft_of
from ..system.errors import DesatError, choices
from ..system.model import System
from ..system.typed import JsonObject
from . import tune
from .criteria import CRITERIA, half_full
from .ranking import laws_of
from .sampled_laws import JudgedSample

NOMINAL = "nominal"  # name of the flight without a fault
PEAK = "peak"
SAME = 1e-3  # relative difference of a number up to which a fault has not moved it
CRAFT, COMPONENTS = "craft.toml", "[components]\n"
TORQUE_INPUT = "tau_ext_body"  # of a spacecraft, for torques of other components


@dataclass(frozen=True)
class Fault:
    """A fault as it is declared."""

    name: str
    title: str
    table: Mapping[str, Any]


@dataclass(frozen=True)
class Contender:
    """A scenario under one law."""

    label: str
    source: Scenario
    options: Options


@dataclass(frozen=True)
class FaultFlight:
    """Samples of a contender under a fault."""

    fault: Fault
    contender: Contender
    target: str
    changes: Mapping[str, Any]  # values of the fault
    is_drawn: bool  # whether the scenario has something to draw

    def tasks(
        self, samples: range, seed: int, names: tuple[str, ...]
    ) -> list[tuple[Any, ...]]:
        """Return what `JudgedSample` flies for these samples."""
        draws: list[int | None] = list(samples) if self.is_drawn else []
        if not self.is_drawn and 0 in samples:
            draws = [None]
        options = self.contender.options
        return [(self.target, options, seed, x, names, self.changes) for x in draws]


@dataclass(frozen=True)
class FaultOutcome:
    """Samples of a contender under a fault."""

    count: int
    failed: int
    median: float | None  # None: not reached, or not known
    reasons: tuple[str, ...]
    has_effect: bool = True  # False: no number of a sample differs from that without it

    @property
    def text(self) -> str:
        """Return the samples that failed and the median of the others."""
        middle = "" if self.median is None else f"{number(self.median)}; "
        effect = "" if self.has_effect else "; no effect"
        return f"{middle}{self.failed} of {self.count} fail{effect}"


@dataclass(frozen=True, repr=False)
class FaultTable:
    """Outcome of each fault for each contender, and why a fault does not apply."""

    targets: tuple[str, ...]
    labels: tuple[str, ...]
    title: str  # of the number whose median is given
    unit: str
    seed: int
    rows: Mapping[str, tuple[Fault, tuple[FaultOutcome, ...]]]
    without: Mapping[str, str]  # title of a fault that does not apply -> reason

    def __repr__(self) -> str:
        return f"<FaultTable {self.answer}>"

    @property
    def answer(self) -> str:
        """Return a sentence for each contender: the fault under which it fares worst."""
        return " ".join(self._worst(k) for k in range(len(self.labels)))

    def _worst(self, k: int) -> str:
        """Return the sentence of a contender."""

        def key(entry: tuple[Fault, tuple[FaultOutcome, ...]]) -> tuple[float, float]:
            """Return the share that fails, then the median."""
            outcome = entry[1][k]
            middle = np.inf if outcome.median is None else outcome.median
            return outcome.failed / outcome.count, middle

        faults = [row for name, row in self.rows.items() if name != NOMINAL]
        _, nominal = self.rows[NOMINAL]
        if not faults:
            return f"{self.labels[k]}: no fault applies."
        fault, outcomes = max(faults, key=key)
        outcome = outcomes[k]
        if nominal[k].failed == nominal[k].count:
            return f"{self.labels[k]} fails without a fault: {nominal[k].reasons[0]}."
        if not any(row[1][k].failed > nominal[k].failed for row in faults):
            middle = "" if outcome.median is None else f" ({self._value(outcome)})"
            return f"{self.labels[k]}: no fault makes it fail; the worst is {fault.title}{middle}."
        reason = f": {outcome.reasons[0]}" if outcome.reasons else ""
        return (
            f"{self.labels[k]} breaks under {fault.title}: {outcome.failed} of "
            f"{outcome.count} samples fail{reason}."
        )

    def _value(self, outcome: FaultOutcome) -> str:
        """Return the median with its unit."""
        assert outcome.median is not None
        return f"{number(outcome.median)} {spell_unit(self.unit)}".rstrip()

    @property
    def table(self) -> Table:
        """Return the outcomes as a table of the report."""
        columns = [
            Column("fault", kind="text"),
            *(Column(x, kind="text") for x in self.labels),
        ]
        rows: list[Row] = [
            [fault.title, *(outcome.text for outcome in outcomes)]
            for fault, outcomes in self.rows.values()
        ]
        return Table(f"{self.title} [{spell_unit(self.unit)}], median", columns, rows)

    def as_json(self) -> JsonObject:
        """Return the outcomes for programs."""
        return {
            "targets": list(self.targets),
            "answer": self.answer,
            "number": {"title": self.title, "unit": self.unit},
            "seed": self.seed,
            "faults": {
                name: {
                    "title": fault.title,
                    "outcomes": {
                        label: {**vars(x), "reasons": list(x.reasons)}
                        for label, x in zip(self.labels, outcomes, strict=True)
                    },
                }
                for name, (fault, outcomes) in self.rows.items()
            },
            "do not apply": dict(self.without),
        }


def declared() -> dict[str, Fault]:
    """Return all faults by name."""
    for folder in discovery.folders("templates"):
        file = folder / "faults.toml"
        if file.is_file():
            tables = tomllib.loads(file.read_text(encoding="utf-8"))
            return {n: Fault(n, t["title"], t) for n, t in tables.items()}
    raise DesatError("faults.toml: it is not installed")


def chosen(names: Sequence[str]) -> list[Fault]:
    """Return faults by name, all of them for no name.

    Raises
    ------
    DesatError
        If there is no such fault.
    """
    faults = declared()
    for name in names:
        if name not in faults:
            raise DesatError(f"--fault {name}: no such fault{choices(name, faults)}")
    return [faults[name] for name in dict.fromkeys(names or faults)]


def changes_of(fault: Fault, system: System) -> dict[str, Any] | str:
    """Return the values that a fault gives a system, or why it does not apply."""
    table = fault.table
    unit = unit_of_fault(fault, system)
    if unit is None:
        return f"its {table['unit'].replace('_', ' ')} is not known, or 0"
    values: dict[str, Any] = {}
    lacking: list[str] = []
    names = {
        **table.get("set", {}),
        **table.get("factor", {}),
        **table.get("sample", {}),
    }
    for name, amount in names.items():
        now = _value_of(system, name)
        if now is None:
            lacking.append(f"it has no {name}")
        elif name in table.get("set", {}):
            values[name] = amount if unit == 1.0 else (unit * np.array(amount)).tolist()
        elif name in table.get("sample", {}):
            values[name] = _value_of(system, amount)
        elif not np.any(now):
            lacking.append(f"{name} is 0")
        else:
            values[name] = (np.array(now) * np.array(amount)).tolist()
    if lacking and not (table.get("any") and values):
        return "; ".join(lacking)
    return values


def unit_of_fault(fault: Fault, system: System) -> float | None:
    """Return what the sizes of a fault are multiplied by, in SI; None: not known, or 0."""
    name = fault.table.get("unit")
    if name is None:
        return 1.0
    if name == "mean_torque":
        return mean_torque(system)
    if name == "orbit_rate":
        period = orbit_period(system)
        return None if period is None else 2.0 * pi / period
    field = mean_field(system)
    if name == "field" or field is None:
        return field
    coils = craft_of(system).coils
    dipole = 0.0 if coils is None else float(np.max(coils.values.get("m_limit", 0.0)))
    return field / dipole if dipole > 0.0 else None


def _value_of(system: System, name: str) -> Any:
    """Return the value of a parameter, a list of an array; None without it."""
    owner, _, key = name.partition(".")
    component = system.components.get(owner)
    if component is None:
        return None
    signals = component.interface.elements.get(key, ())
    values = [component.values[s.name] for s in signals if s.causality == "parameter"]
    if not values:
        return None
    return values[0] if len(values) == 1 and signals[0].name == key else values


def fly_faults(
    targets: Sequence[str],
    options: Options,
    faults: Sequence[Fault],
    count: int,
    seed: int,
    laws: Sequence[str] = (),
    measured: str | None = None,
    limits: Mapping[str, float] = MappingProxyType({}),
    jobs: int = 2,
    progress: bool = False,
    more: int = 0,
    free: str | Mapping[str, str] = MappingProxyType({}),
) -> FaultTable:
    """Fly samples of scenarios, or of a craft under several laws, with each fault.

    Parameters
    ----------
    targets
        Scenarios, each with its own law.
    options
        Options of all runs.
    faults
        Faults to fly, besides none.
    count, seed
        Samples; one without draws where a scenario has nothing to draw.
    laws
        Laws that fly the one target besides its own, by name, or all.
    measured
        Number whose median is given; None: the first time that the scenario measures,
        else the fill of the fullest wheel, else the scenario's first number.
    limits
        Largest values of numbers, by name; a sample beyond one fails.
    jobs, progress
        Number of processes; whether progress is shown.
    more
        Samples in place of `count` under faults where the first contender is worse than
        another: more of its samples fail, or its median is above.
    free
        Parameter that is searched before, without a fault, for the least median of
        `measured` over samples of the next seed (`tune`): of all contenders that have
        it, or by the contender's label.

    Raises
    ------
    DesatError
        If a scenario cannot run, lacks a number that is named, or laws are named for
        several scenarios.
    """
    if laws and len(targets) > 1:
        raise DesatError(f"{' '.join(targets)}: --laws flies one craft")
    contenders = list(_contenders(targets, options, laws))
    first = contenders[0]
    system, _ = prepare(first.source, first.options).or_raise()
    content = content_of(system.about)
    measured = _check_numbers(contenders, system, measured, limits)
    contenders = [
        _tuned(c, _free_of(c, free), measured, seed + 1, jobs) for c in contenders
    ]
    names = (PEAK,) if PEAK in (measured, *limits) else ()
    runner = _SampleRunner(seed, names, jobs, progress)
    with tempfile.TemporaryDirectory() as folder:
        flights, without = _flights(contenders, faults, options, Path(folder))
        rows = runner(flights, range(count))
        table = _table(flights, rows, measured, limits)
        if more > count:
            worse = [x for x in flights if _is_worse(table[x.fault.name][1])]
            for k, added in zip(
                (k for k, x in enumerate(flights) if x in worse),
                runner(worse, range(count, more)),
                strict=True,
            ):
                rows[k] += added
            table = _table(flights, rows, measured, limits)
    declared_number = content.numbers.get(measured)
    return FaultTable(
        tuple(targets),
        tuple(c.label for c in contenders),
        CRITERIA[PEAK].title if declared_number is None else declared_number.title,
        CRITERIA[PEAK].unit if declared_number is None else declared_number.unit or "",
        seed,
        table,
        without,
    )


@dataclass(frozen=True)
class _SampleRunner:
    """How samples are flown."""

    seed: int
    names: tuple[str, ...]
    jobs: int
    progress: bool

    def __call__(
        self, flights: Sequence[FaultFlight], samples: range
    ) -> list[list[RunRow]]:
        """Return the rows of these samples of each flight."""
        of_each = [x.tasks(samples, self.seed, self.names) for x in flights]
        tasks = [task for tasks in of_each for task in tasks]
        if not tasks:
            return [[] for _ in flights]
        rows = rows_of(
            tasks,
            self.jobs,
            flights[0].contender.source.target,
            self.progress,
            runner=JudgedSample,
        )
        each = iter(rows)
        return [[next(each) for _ in tasks] for tasks in of_each]


def _flights(
    contenders: Sequence[Contender],
    faults: Sequence[Fault],
    options: Options,
    folder: Path,
) -> tuple[list[FaultFlight], dict[str, str]]:
    """Return the flights without a fault and with each, and why a fault does not apply.

    A fault that does not apply to one contender is flown by none.
    """
    flights: list[FaultFlight] = []
    without: dict[str, str] = {}
    for fault in (Fault(NOMINAL, "none", {}), *faults):
        of_fault: list[FaultFlight] = []
        for k, contender in enumerate(contenders):
            contender_with_fault = _with_fault(
                fault, contender, folder / f"{fault.name}{k}"
            )
            if isinstance(contender_with_fault, str):
                without[fault.title] = contender_with_fault
                break
            content = content_of(draft_to_draw(contender.source, options.blocks).about)
            of_fault.append(
                FaultFlight(
                    fault, contender, *contender_with_fault, bool(content.dispersions)
                )
            )
        else:
            flights += of_fault
    return flights, without


def _table(
    flights: Sequence[FaultFlight],
    rows: Sequence[Sequence[RunRow]],
    measured: str,
    limits: Mapping[str, float],
) -> dict[str, tuple[Fault, tuple[FaultOutcome, ...]]]:
    """Summarise the samples of all flights: name of a fault -> it and its outcomes."""
    table: dict[str, tuple[Fault, tuple[FaultOutcome, ...]]] = {}
    nominal = {
        flight.contender.label: of_flight
        for flight, of_flight in zip(flights, rows, strict=True)
        if flight.fault.name == NOMINAL
    }
    for flight, of_flight in zip(flights, rows, strict=True):
        _, before = table.get(flight.fault.name, (flight.fault, ()))
        outcome = _outcome(of_flight, measured, limits)
        if flight.fault.name != NOMINAL:
            without = nominal[flight.contender.label]
            outcome = replace(outcome, has_effect=_differ(of_flight, without))
        table[flight.fault.name] = flight.fault, (*before, outcome)
    return table


def _differ(rows: Sequence[RunRow], others: Sequence[RunRow]) -> bool:
    """Return whether a number of a sample differs from that of the same sample."""
    for row, other in zip(rows, others, strict=False):
        if row.status != other.status or row.unmet != other.unmet:
            return True
        for name, value in row.numbers.items():
            before = other.numbers.get(name)
            if value is None or before is None:
                if value is not before:
                    return True
            elif abs(value - before) > SAME * max(abs(value), abs(before)):
                return True
    return False


def _is_worse(outcomes: Sequence[FaultOutcome]) -> bool:
    """Return whether the first contender is worse than another."""
    first, *others = outcomes

    def middle(x: FaultOutcome) -> float:
        """Return the median, infinite where it is not reached."""
        return np.inf if x.median is None else x.median

    return any(
        x.failed < first.failed or (middle(x) < middle(first) and x.count > 1)
        for x in others
    )


def _free_of(contender: Contender, free: str | Mapping[str, str]) -> str:
    """Return the parameter that is searched for a contender; none: empty.

    Raises DesatError for a contender whose parameter is named and not there.
    """
    system, _ = prepare(contender.source, contender.options).or_raise()
    parameter = free if isinstance(free, str) else free.get(contender.label, "")
    has_it = bool(parameter) and _value_of(system, parameter) is not None
    if parameter and not has_it and not isinstance(free, str):
        raise DesatError(f"{contender.label}: it has no parameter {parameter}")
    return parameter if has_it else ""


def _tuned(
    contender: Contender, parameter: str, measured: str, seed: int, jobs: int
) -> Contender:
    """Return a contender with its free parameter searched, which its label says.

    The parameter stays as it is where half of the samples do not reach the number with
    any value.
    """
    if not parameter:
        return contender
    try:
        tuned_value = tune.tune(
            contender.source.target,
            parameter,
            measured,
            contender.options,
            seed=seed,
            jobs=jobs,
        )
    except tune.NoValueError:
        return replace(contender, label=f"{contender.label}, {parameter} as it is")
    values = {**contender.options.values, parameter: tuned_value.best}
    return replace(
        contender,
        label=f"{contender.label}, {parameter} = {number(tuned_value.best)}",
        options=replace(contender.options, values=values),
    )


def _check_numbers(
    contenders: Sequence[Contender],
    system: System,
    measured: str | None,
    limits: Mapping[str, float],
) -> str:
    """Return the number by which faults are judged, which all contenders must have.

    `system` is that of the first of them. Raises DesatError for one that lacks it.
    """
    first, content = contenders[0], content_of(system.about)
    for name in [*limits, *([] if measured is None else [measured])]:
        if name not in content.numbers and name != PEAK:
            raise DesatError(
                f"{first.source.target}: no number {name}"
                f"{choices(name, (*content.numbers, PEAK))}"
            )
    chosen_one = measured or _usual_number(system)
    for contender in contenders[1:]:
        other, _ = prepare(contender.source, contender.options).or_raise()
        if chosen_one not in (PEAK, *content_of(other.about).numbers):
            raise DesatError(
                f"{contender.label}: it has no number {chosen_one}, by which "
                f"{first.source.target} is judged; --number names another"
            )
    return chosen_one


def _usual_number(system: System) -> str:
    """Return the number by which faults are judged where none is named."""
    content = content_of(system.about)
    times = late(content)
    if first := next((n for n in content.numbers if n in times), ""):
        return first
    if half_full(system) is not None or not content.numbers:
        return PEAK
    return next(iter(content.numbers))


def _contenders(
    targets: Sequence[str], options: Options, laws: Sequence[str]
) -> Iterator[Contender]:
    """Yield each target with its own law, or the one target under several."""
    for target in targets:
        source = read(target)
        prepare(source, options).or_raise()
        if not laws:
            yield Contender(target, source, options)
    if laws:
        _, laws_fitting, _ = laws_of(source, options, laws)
        for law in laws_fitting:
            yield Contender(law.name, source, law.options)


def _with_fault(
    fault: Fault, contender: Contender, folder: Path
) -> tuple[str, dict[str, Any]] | str:
    """Return the target and the values of a contender with a fault.

    Or the reason why the fault does not apply. A component is added to a copy of the
    craft in `folder`.
    """
    target, system = (
        contender.source.target,
        prepare(contender.source, contender.options),
    )
    values = changes_of(fault, system.or_raise()[0])
    if isinstance(values, str):
        return values
    first = system.or_raise()[0]
    one_step = replace(
        contender.options,
        values={**contender.options.values, **values},
        stop=first.start + first.step,
        substeps=1,
        supervised=True,
    )
    try:
        simulate(prepare(contender.source, one_step))
    except DesatError as error:  # as an inertia that no body has
        return str(error).splitlines()[0]
    if added := fault.table.get("component"):
        return _with_component(
            fault, contender.source, contender.options, added, folder
        )
    return target, values


def _with_component(
    fault: Fault,
    source: Scenario,
    options: Options,
    added: Mapping[str, str],
    folder: Path,
) -> tuple[str, dict[str, Any]] | str:
    """Write a copy of a craft with a component more into `folder`.

    Returns the target and the component's values, or why there can be none.
    """
    ((name, block),) = added.items()
    folders = (source.file.parent, source.file.parent.parent)
    craft = next((x / CRAFT for x in folders if (x / CRAFT).is_file()), None)
    if source.is_system_file or craft is None:
        return "a component is added to a craft by its craft.toml alone"
    text = craft.read_text(encoding="utf-8")
    if f"\n{name} =" in text:
        return f"the craft has a component {name} already"
    if COMPONENTS not in text:
        return f"{CRAFT} has no [components]"
    target = folder / source.file.name
    if craft.parent == source.file.parent:
        shutil.copytree(craft.parent, folder, ignore=shutil.ignore_patterns("runs"))
    else:  # a family of ours, whose scenarios lie in a folder beside it
        folder.mkdir()
        replace_text(target, f'extends = "{source.name}"\n')
    more = f'{COMPONENTS}{name} = "{block}"\n'
    unwired = re.compile(rf'^"\w+\.{TORQUE_INPUT}" = false\n', re.MULTILINE)
    text = unwired.sub("", text)  # a craft on which no such torque acts
    replace_text(folder / CRAFT, text.replace(COMPONENTS, more, 1))
    torque = unit_of_fault(fault, prepare(source, options).or_raise()[0])
    rows = [
        x
        for time, *torques in fault.table["table"]
        for x in (time, *((torque or 0.0) * np.array(torques)).tolist())
    ]
    changes: dict[str, Any] = {
        f"{name}.torque": rows + [0.0] * (4 * ROWS - len(rows)),
        f"{name}.between": "hold",
        f"{name}.repeated": True,
    }
    return str(target), changes


def _outcome(
    rows: Sequence[RunRow], measured: str, limits: Mapping[str, float]
) -> FaultOutcome:
    """Summarise the samples of a contender under a fault."""
    reasons: list[str] = []
    values: list[float] = []
    failed_samples = 0
    for row in rows:
        value = row.numbers.get(measured)
        lines = list(row.unmet) if row.completed else [row.message or row.status]
        if row.completed and value is None and measured != PEAK:
            lines.append(f"{measured} is not reached")
        for name, most in limits.items():
            reached = row.numbers.get(name)
            if row.completed and (reached is None or reached > most):
                lines.append(f"{name} is above {number(most)}")
        failed_samples += bool(lines)
        reasons += [x.partition(":")[0] for x in lines]
        values.append(np.inf if value is None or not row.completed else value)
    middle = float(np.median(values)) if values else np.inf
    return FaultOutcome(
        len(rows),
        failed_samples,
        middle if np.isfinite(middle) else None,
        tuple(dict.fromkeys(reasons)),
    )
