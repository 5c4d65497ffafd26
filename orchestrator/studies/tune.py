"""Tune a parameter: find the value that minimises a number over seeded draws.

This is `desat tune`. The same draws fly at every value, so that the median over them is
a function of the value alone. It is first sampled over the whole range, evenly in the
logarithm where the range is above 0, and then minimised by Brent's method between the
neighbours of the best sample. A value is rejected if more draws miss a requirement than
at the craft's own value. The result is judged on draws that were not used for tuning,
each paired with the same draw at the craft's own value.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from desat.components.contract.fitting import unit_under

from ..analyses import analyses
from ..campaign.draws import One, RunRow, rows_of
from ..campaign.pairs import confident, difference
from ..campaign.spread import Spread
from ..files.scenario import Scenario
from ..language.content import Content, content_of, overridden_by
from ..numbers.numbers import late, ranks
from ..numbers.text import number as text_of
from ..numbers.text import spell_unit
from ..report.table import Cell, Column, Table
from ..runs.cases import Cases, draft_to_draw
from ..runs.prepare import prepare, read
from ..runs.run import Options
from ..system.errors import DesatError, nearest, require
from ..system.interface import Signal, names
from ..system.typed import JsonObject
from .criteria import CRITERIA
from .sampled_laws import JudgedSample

SPAN = 10.0  # default range: this factor below and above the craft's own value
LOOKED_AT = 7  # values of the range that are flown first
REFINED = 8  # limit of the evaluations by Brent's method
SAME = 1e-3  # a smaller relative gain in the number is no reason for another value
FINE = 0.02  # tolerance of the search, as a share of the range


class NoValueError(DesatError):
    """The number has no finite median with any value of the parameter."""


@dataclass(frozen=True)
class Point:
    """Result at a value over the tuning draws."""

    value: float
    median: float  # of the number; inf where a draw lacks it
    missed: int  # samples that miss a requirement


@dataclass(frozen=True, kw_only=True)
class Unseen(Spread):
    """Paired differences of own less best over draws not used for tuning.

    It also has the medians, and the numbers of draws that miss a requirement.
    """

    median_own: float
    median_best: float
    missed_own: int
    missed_best: int


@dataclass(frozen=True, repr=False)
class Tuned:
    """Tuned value, compared with the craft's own on unseen samples."""

    target: str
    parameter: str
    unit: str
    number: str
    number_unit: str
    most: bool
    own: float
    best: float
    searched: tuple[float, float]  # the range
    draws: int
    points: tuple[Point, ...]  # by value
    unseen: Unseen

    def __repr__(self) -> str:
        return f"<Tuned {self.answer}>"

    @property
    def confirmed(self) -> bool:
        """Return whether unseen samples confirm that the tuned value is better.

        The confidence is 95 %, and it must not miss requirements more often, either.
        """
        unseen = self.unseen
        if self.best == self.own or not unseen.interval_holds:
            return False
        low, high = unseen.interval
        better = high < 0.0 if self.most else low > 0.0
        return bool(better and unseen.missed_best <= unseen.missed_own)

    @property
    def answer(self) -> str:
        """Return the sentence that answers."""
        unseen, unit = (
            self.unseen,
            f" {self.number_unit}" if self.number_unit not in ("", "1") else "",
        )
        if self.best == self.own:
            return f"{self.parameter} = {self.own:.4g} {self.unit} is the best of its range already."
        won = unseen.lower if self.most else unseen.higher
        edge = self.best in self.searched
        verdict = ", at the edge of its range" if edge else ""
        verdict += "" if self.confirmed else "; that is not confirmed"
        return (
            f"{self.parameter} = {self.best:.4g} {self.unit} instead of {self.own:.4g}: "
            f"{self.number} {text_of(unseen.median_best)}{unit} instead of "
            f"{text_of(unseen.median_own)}{unit} over {unseen.n} unseen samples, better in "
            f"{won}{verdict}."
        )

    @property
    def table(self) -> Table:
        """Tabulate the values that were tried."""
        columns = [
            Column(
                f"{self.parameter} [{spell_unit(self.unit)}]", form=".4g", kind="text"
            ),
            Column(
                f"{self.number} [{spell_unit(self.number_unit)}], median of {self.draws} "
                "tuning samples"
            ),
            Column("samples that miss a requirement", form="d"),
        ]
        notes = {self.best: "best", self.own: "own"}
        rows = [
            (Cell(p.value, note=notes.get(p.value, "")), p.median, p.missed)
            for p in self.points
        ]
        return Table("", columns, rows)

    def as_json(self) -> JsonObject:
        """Return the result for programs; medians that are not finite are null."""
        document = asdict(self) | {
            "unseen": self.unseen.to_json(),
            "confirmed": self.confirmed,
            "answer": self.answer,
        }
        for point in document["points"]:
            point["median"] = (
                point["median"] if math.isfinite(point["median"]) else None
            )
        return document


def tune(
    target: str,
    parameter: str,
    number: str,
    options: Options,
    *,
    most: bool = False,
    between: tuple[float, float] | None = None,
    draws: int = 8,
    unseen: int = 16,
    seed: int = 1,
    jobs: int = 2,
    progress: Callable[[str], None] = lambda text: None,
) -> Tuned:
    """Tune `component.parameter` to minimise (or maximise) a number.

    The draws of the seed before `draws` tune it, the next `unseen` ones judge it.

    Raises
    ------
    DesatError
        If parameter, number or dispersions do not exist.
    NoValueError
        If with no value the median of the number over the draws is finite.
    """
    source = read(target)
    system, _ = prepare(source, options).or_raise()
    content = content_of(system.about)
    signal, own_value, unit = _parameter(source, options, parameter)
    _number(content, system, number, target)
    low, high = _range(parameter, signal, own_value, between)
    if not content.dispersions:
        raise DesatError(
            f"{target}: it has no [dispersions], so there is nothing to sample"
        )

    is_late = number in late(content)
    judged: tuple[Any, ...] = ()  # what else the runner of a sample takes
    if _is_criterion(content, number):
        judged = ((number,), {})

    def rows(values: Sequence[float], draw: range) -> list[list[RunRow]]:
        """Run these draws at each value, and return the rows by value."""
        tasks = [
            (
                target,
                replace(options, values={**options.values, parameter: x}),
                seed,
                i,
                *judged,
            )
            for x in values
            for i in draw
        ]
        results = rows_of(
            tasks,
            jobs,
            target,
            False,
            Cases(source),
            runner=JudgedSample if judged else One,
        )
        return [results[k : k + len(draw)] for k in range(0, len(results), len(draw))]

    def evaluate(values: Sequence[float]) -> list[Point]:
        """Fly the tuning draws at these values, and return a point of each."""
        progress(f"{parameter} = {', '.join(f'{x:.3g}' for x in values)}")
        return [
            Point(
                x,
                _median(some, number, is_late),
                sum(_misses(content, r) for r in some),
            )
            for x, some in zip(values, rows(values, range(draws)), strict=True)
        ]

    search = _Search(evaluate, (low, high), own_value, most, draws)
    search.sample_range()
    if not math.isfinite(search.scale()):
        raise NoValueError(
            f"{target}: {parameter} = {low:g} to {high:g}: samples lack {number} "
            "with every value"
        )
    search.refine()
    best = search.find_best()
    points = tuple(search.points[x] for x in sorted(search.points))
    progress(f"{unseen} unseen samples")
    judges = rows([own_value, best], range(draws, draws + unseen))
    comparison, number_unit = _verdict(judges[0], judges[1], number, content)
    return Tuned(
        target,
        parameter,
        unit,
        number,
        number_unit,
        most,
        own_value,
        best,
        (low, high),
        draws,
        points,
        comparison,
    )


class _Search:
    """Search of the value with the least cost in a range.

    It is logarithmic where the range is above 0.
    """

    def __init__(
        self,
        evaluate: Callable[[Sequence[float]], list[Point]],
        limits: tuple[float, float],
        own_value: float,
        most: bool,
        draws: int,
    ) -> None:
        self.points: dict[float, Point] = {}  # by value
        self._evaluate = evaluate
        self._limits = limits
        self._own_value = own_value
        self._sign = -1.0 if most else 1.0
        self._draws = draws
        self._is_logarithmic = limits[0] > 0.0

    def sample_range(self) -> None:
        """Evaluate the craft's own value, and values spread evenly over the range."""
        spread = np.geomspace if self._is_logarithmic else np.linspace
        others = [
            x
            for x in spread(*self._limits, LOOKED_AT).tolist()
            if not math.isclose(x, self._own_value, rel_tol=1e-9)
        ]
        self._add(sorted([self._own_value, *others]))

    def refine(self) -> None:
        """Minimise the cost between the neighbours of the best value so far."""
        from scipy.optimize import minimize_scalar  # slow import

        values_tried = sorted(self.points)
        k = values_tried.index(min(values_tried, key=self.cost))
        neighbours = (
            values_tried[max(k - 1, 0)],
            values_tried[min(k + 1, len(values_tried) - 1)],
        )
        low, high = (self._place(x) for x in self._limits)
        minimize_scalar(
            self._cost_at,
            bounds=[self._place(x) for x in neighbours],
            method="bounded",
            options={"maxiter": REFINED, "xatol": FINE * (high - low)},
        )

    def find_best(self) -> float:
        """Return the value of least cost; the craft's own where it is about as good."""
        best = min(sorted(self.points), key=self.cost)
        if self.cost(self._own_value) - self.cost(best) < SAME:
            return self._own_value
        return best

    def cost(self, value: float) -> float:
        """Return the cost (1) of a value that was evaluated.

        It is relative to `scale`; large for a value that is
        rejected.
        """
        point, own_point = self.points[value], self.points[self._own_value]
        if math.isfinite(point.median) and point.missed <= own_point.missed:
            return self._sign * point.median / (abs(self.scale()) or 1.0)
        return 1e3 * (1.0 + point.missed / self._draws)

    def scale(self) -> float:
        """Return the number at the craft's own value, or the least that is finite."""
        own = self.points[self._own_value].median
        if math.isfinite(own):
            return own
        return min(point.median for point in self.points.values())

    def _cost_at(self, place: float) -> float:
        """Return the cost (1) at a place of the search; evaluate it where it is new."""
        value = math.exp(place) if self._is_logarithmic else place
        if value not in self.points:
            self._add([value])
        return self.cost(value)

    def _place(self, value: float) -> float:
        """Return the place of a value in the search: its logarithm, or itself."""
        return math.log(value) if self._is_logarithmic else value

    def _add(self, values: Sequence[float]) -> None:
        """Evaluate these values."""
        self.points |= {point.value: point for point in self._evaluate(values)}


def _parameter(
    source: Scenario, options: Options, name: str
) -> tuple[Signal, float, str]:
    """Find a parameter, its value, and its unit under the law that flies.

    Raises DesatError for one that cannot be tuned.
    """
    system, _ = prepare(source, options).or_raise()
    owner, _, variable = name.partition(".")
    require(owner, system.components, f"{name}: no component")
    component = system.components[owner]
    parameter_names = names(component.interface, "parameter")
    signal = component.interface.signals.get(variable)
    if signal is None or signal.causality != "parameter":
        problem = (
            "an array"
            if variable in parameter_names
            else f"no parameter{nearest(variable, parameter_names)}"
        )
        raise DesatError(
            f"{name}: {problem}: exactly one numeric parameter of a component can be tuned"
        )
    if signal.kind != "Real":
        raise DesatError(
            f"{name}: it is no Real: {', '.join(signal.choices) or signal.kind}"
        )
    if dispersed := overridden_by(draft_to_draw(source, options.blocks), name):
        raise DesatError(f"{name}: {dispersed[0]} is sampled, and so cannot be tuned")
    unit = None
    if component.block is not None:
        chosen = {
            s.name: component.choice(s.name)
            for s in component.interface.signals.values()
            if s.choices and s.causality == "parameter"
        }
        unit = unit_under(component.block, variable, chosen)
    return signal, float(str(component.values[variable])), unit or signal.unit_name


def _number(content: Content, system: Any, number: str, target: str) -> None:
    """Raise DesatError for a number that the runs will not have."""
    if _is_criterion(content, number):
        return
    number_names = {*content.numbers}
    for analysis in analyses():
        if analysis.applies(system):
            number_names.update(analysis.NUMBERS)
    if number not in number_names:
        raise DesatError(
            f"--for {number}: {target} has no such number{nearest(number, number_names)}; "
            f"there is {', '.join(sorted(number_names))}"
        )


def _is_criterion(content: Content, number: str) -> bool:
    """Return whether a number is not the scenario's but a criterion of laws."""
    criterion = CRITERIA.get(number)
    return (
        number not in content.numbers
        and criterion is not None
        and criterion.of is not None
    )


def _range(
    name: str, signal: Signal, own_value: float, between: tuple[float, float] | None
) -> tuple[float, float]:
    """Return the range for the search; raise DesatError where it is not valid."""
    if between is None:
        if own_value <= 0.0:
            raise DesatError(
                f"{name} = {own_value:g}: a range is needed: --between LOW,HIGH"
            )
        low, high = own_value / SPAN, own_value * SPAN
        low = max(low, signal.minimum) if signal.minimum is not None else low
        high = min(high, signal.maximum) if signal.maximum is not None else high
    else:
        low, high = between
    if not low < high:
        raise DesatError(
            f"--between {low:g},{high:g}: the first is to be below the second"
        )
    for x in (low, high):
        if (signal.minimum is not None and x < signal.minimum) or (
            signal.maximum is not None and x > signal.maximum
        ):
            raise DesatError(
                f"--between: {name} = {x:g} is outside [{signal.minimum}, "
                f"{signal.maximum}]"
            )
    return low, high


def _median(rows: Sequence[RunRow], number: str, is_late: bool) -> float:
    """Compute the median over draws.

    A time that a draw does not reach (`is_late`) is infinite; otherwise the median is
    infinite where a draw failed or lacks the number.
    """
    values = [r.numbers.get(number) if r.completed else None for r in rows]
    if None in values and not is_late:
        return math.inf
    median: float = statistics.median(ranks(values, is_late))
    return median


def _misses(content: Content, row: RunRow) -> bool:
    """Return whether a draw misses a requirement.

    A time that it does not reach, because it is too short, does not count.
    """
    if not row.completed:
        return True
    times = late(content)
    for entry in content.requirements.values():
        value = row.numbers.get(entry.number)
        if (value is None and entry.number not in times) or (
            value is not None and not entry.holds(value)
        ):
            return True
    return False


def _verdict(
    own_rows: Sequence[RunRow], best: Sequence[RunRow], number: str, content: Content
) -> tuple[Unseen, str]:
    """Compare pairs of draws, own less best; also return the number's unit."""
    pairs = [
        (a.numbers.get(number), b.numbers.get(number))
        for a, b in zip(own_rows, best, strict=True)
        if a.completed and b.completed
    ]
    pairs_of_values = [(a, b) for a, b in pairs if a is not None and b is not None]
    if not pairs_of_values:
        raise DesatError(f"no unseen sample has {number} with both values")
    unseen = Unseen(
        **vars(confident([difference(a, b) for a, b in pairs_of_values])),
        median_own=statistics.median(a for a, _ in pairs_of_values),
        median_best=statistics.median(b for _, b in pairs_of_values),
        missed_own=sum(_misses(content, r) for r in own_rows),
        missed_best=sum(_misses(content, r) for r in best),
    )
    if _is_criterion(content, number):
        return unseen, CRITERIA[number].unit
    unit = next(r.described[number]["unit"] for r in own_rows if number in r.described)
    return unseen, unit
