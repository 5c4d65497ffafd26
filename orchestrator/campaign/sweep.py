"""Run a scenario at every combination of some parameters' values."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from typing import TYPE_CHECKING, Any

from ..language.content import content_of, overridden_by
from ..language.scenario import Requirement
from ..numbers.numbers import late
from ..numbers.text import short_title
from ..runs.cases import Cases
from ..runs.prepare import prepare, read, with_stop
from ..runs.run import Options
from ..system.errors import DesatError
from ..system.parameters import parse_assignment
from ..system.typed import JsonObject
from .draws import RunRow, count_stopped, rows_of, summary
from .sampling import describe_parameter
from .spread import Spread, to_json

if TYPE_CHECKING:
    from pandas import DataFrame  # type: ignore[import-untyped]
    from xarray import Dataset


@dataclass(frozen=True)
class SweepPoint:
    """Combination of values, with the rows of its runs."""

    values: Mapping[str, Any]
    rows: Sequence[RunRow]
    summary: Mapping[str, Spread]

    @property
    def has_draws(self) -> bool:
        """Return whether the runs are draws."""
        return self.worst.number is not None

    @property
    def worst(self) -> RunRow:
        """Return the row with the largest exit code."""
        return max(self.rows, key=lambda row: row.code)

    @property
    def unmet(self) -> list[str]:
        """Return the titles of the requirements that a run does not meet."""
        verdicts = [v for row in self.rows for v in row.verdicts.values()]
        return list(dict.fromkeys(v.title for v in verdicts if not v.met))

    @property
    def holds(self) -> bool:
        """Return whether all runs complete and meet each requirement that they decide."""
        is_judged = any(row.verdicts for row in self.rows)
        has_failure = any(row.unmet or not row.completed for row in self.rows)
        return is_judged and not has_failure and not self.unmet

    @property
    def margin(self) -> tuple[float, str]:
        """Return the least margin of a requirement in any run, and its title."""
        verdicts = [v for row in self.rows for v in row.verdicts.values()]
        margins = [(v.margin, v.title) for v in verdicts if v.margin is not None]
        return min(margins, default=(-math.inf, ""))

    @property
    def place(self) -> str:
        """Return the values as `manager.gain = 0.002, ...`."""
        return ", ".join(f"{name} = {text_of(x)}" for name, x in self.values.items())

    @property
    def message(self) -> str:
        """Return the message of the worst row, with its draw."""
        worst = self.worst
        has_both = self.has_draws and worst.message
        return f"draw {worst.number}: {worst.message}" if has_both else worst.message

    def to_json(self) -> JsonObject:
        """Return values, medians and worst end; with draws also the spreads."""
        entry = {
            "values": self.values,
            "numbers": {
                name: spread.levels["median"] for name, spread in self.summary.items()
            },
            "stopped": count_stopped(self.rows),
            "status": self.worst.status,
            "code": self.worst.code,
            "message": self.message,
            "holds": self.holds,
            "unmet": self.unmet,
        }
        if self.has_draws:
            entry["summary"] = to_json(self.summary)
        return entry


@dataclass(frozen=True, repr=False)
class Sweep:
    """System at every combination of some parameters' values."""

    scenario: str
    axes: Mapping[str, Sequence[Any]]
    draws: int
    seed: int | None
    units: Mapping[str, str]
    points: Sequence[SweepPoint]
    warnings: Sequence[str]
    requirements: Mapping[str, Requirement] = field(default_factory=dict)
    titles: Mapping[str, str] = field(default_factory=dict)
    axis_titles: Mapping[str, tuple[str, str]] = field(default_factory=dict)

    def __repr__(self) -> str:
        axes = " x ".join(f"{len(values)} {name}" for name, values in self.axes.items())
        answer = f". {self.answer}" if self.answer else ""
        return f"<Sweep {self.scenario}: {axes}{answer}>"

    def _repr_html_(self) -> str:
        return f"<p>{escape(repr(self))}</p>{self.numbers.to_html()}"

    def __len__(self) -> int:
        """Return the number of combinations."""
        return len(self.points)

    @property
    def holds(self) -> bool:
        """Return whether a combination holds."""
        return any(point.holds for point in self.points)

    @property
    def answer(self) -> str:
        """Return the sentence on where the requirements hold; "" without any."""
        if not any(row.verdicts for point in self.points for row in point.rows):
            return ""
        good = [point for point in self.points if point.holds]
        best = max(good or self.points, key=lambda point: point.margin[0])
        margin, title = best.margin[0], short_title(best.margin[1])
        count = len(self.points)
        reason = f" (margin {100.0 * margin:.3g} %, {title})" if title else ""
        best_text = f"{best.place}{reason}"
        if not good:
            answer = f"Holds at none of {count} combinations; nearest at {best_text}"
        else:
            share = f"all {count}" if len(good) == count else f"{len(good)} of {count}"
            answer = f"Holds at {share} combinations; best at {best_text}"
        rows = [row for point in self.points for row in point.rows if row.completed]
        open_names = [
            name
            for name in self.requirements
            if any(name not in row.verdicts for row in rows)
        ]
        return answer + "; not decided: " * bool(open_names) + ", ".join(open_names)

    @property
    def numbers(self) -> DataFrame:
        """Return a table: the values of each combination, and its numbers in their units.

        With samples they are medians.
        """
        from pandas import DataFrame

        return DataFrame(
            [
                {**p.values, **{n: x.levels["median"] for n, x in p.summary.items()}}
                for p in self.points
            ]
        )

    def to_dataframe(self) -> DataFrame:
        """Return the table of `numbers`."""
        return self.numbers

    def to_xarray(self) -> Dataset:
        """Return the numbers as an xarray Dataset over the parameters.

        Raises
        ------
        DesatError
            If values of a parameter are arrays, which are no coordinates.
        """
        for name, values in self.axes.items():
            if any(isinstance(x, (list, tuple)) for x in values):
                raise DesatError(f"{name}: its values are arrays, no coordinates")
        numbers: Dataset = self.numbers.set_index(list(self.axes)).to_xarray()
        for number, values_of_number in numbers.data_vars.items():
            values_of_number.attrs["units"] = self.units.get(str(number), "")
        for name in self.axes:
            title, unit = self.axis_titles.get(name, ("", ""))
            numbers[name].attrs.update(units=unit, long_name=title)
        return numbers

    def to_json(self) -> JsonObject:
        """Return the sweep as `desat sweep --json` prints it."""
        entry = vars(self) | {"points": [point.to_json() for point in self.points]}
        del entry["requirements"], entry["titles"], entry["axis_titles"]
        return entry | {"answer": self.answer}


def text_of(value: Any) -> str:
    """Format a value of a parameter."""
    if isinstance(value, list):
        return ", ".join(map(text_of, value))
    if isinstance(value, bool):
        return str(value).lower()
    # digits that tell values apart which were given apart
    return f"{value:.12g}" if isinstance(value, float) else str(value)


def axes_of(texts: Sequence[str]) -> dict[str, list[Any]]:
    """Parse texts as `manager.gain=1,2,3` to `component.parameter` -> its values.

    Array values are separated by `;`.

    Raises
    ------
    DesatError
        If a text has another form, or a name comes twice.
    """
    axes: dict[str, list[Any]] = {}
    for text in texts:
        name, _, values = text.partition("=")
        parts = [v.strip() for v in values.split(";" if ";" in values else ",")]
        if "." not in name or not all(parts):
            raise DesatError(f"{text}: the form is component.parameter=a,b,c")
        if name.strip() in axes:
            raise DesatError(f"{text}: {name} is there already")
        axes[name.strip()] = [parse_assignment(f"{name}={v}")[2] for v in parts]
    return axes


def sweep(
    target: str,
    axes: Mapping[str, Sequence[Any]],
    options: Options | None = None,
    jobs: int = 2,
    progress: bool = False,
    *,
    draws: int = 0,
    seed: int = 1,
) -> Sweep:
    """Run a system at the product of the axes' values.

    The axes are "component.parameter" -> values in SI. With `draws`, that number of
    seeded draws runs at each combination, and its numbers are medians.

    Raises
    ------
    DesatError
        If a parameter is unknown, a value is out of bounds, or an axis is also drawn.
    """
    options = options or Options()
    if not axes or not all(axes.values()):
        raise DesatError(
            "a sweep needs a parameter and its values: component.parameter=a,b,c"
        )
    cases = Cases(read(target))
    system = cases.draft(options.blocks)
    options = with_stop(cases.scenario, options)
    for name in axes if draws else ():
        if dispersed := overridden_by(system, name):
            raise DesatError(
                f"{target}: {name}: {dispersed[0]} is sampled, and so cannot be an axis"
            )
    points = [
        dict(zip(axes, v, strict=True)) for v in itertools.product(*axes.values())
    ]
    warnings = _warnings(cases, axes, options)
    tasks = [
        (target, replace(options, values={**options.values, **point}), seed, draw)
        for point in points
        for draw in (range(draws) if draws else (None,))
    ]
    rows = rows_of(tasks, jobs, target, progress, cases)
    count = max(draws, 1)
    times = late(content_of(system.about))
    groups = []
    for i, point in enumerate(points):
        group = rows[i * count : (i + 1) * count]
        groups.append(SweepPoint(point, group, summary(group, times)))
    units = {name: spread.unit or "" for name, spread in summary(rows, times).items()}
    descriptions = next((row.described for row in rows if row.completed), {})
    return Sweep(
        scenario=target,
        axes={name: list(values) for name, values in axes.items()},
        draws=draws,
        seed=seed if draws else None,
        units=units,
        points=groups,
        warnings=warnings,
        requirements=content_of(system.about).requirements,
        titles={name: descriptions[name]["title"] for name in units},
        axis_titles={name: describe_parameter(system, name) for name in axes},
    )


def _warnings(
    cases: Cases, axes: Mapping[str, Sequence[Any]], options: Options
) -> list[str]:
    """Collect the warnings for each value, with the first value of all other axes.

    Raises DesatError for problems.
    """
    first = {name: values[0] for name, values in axes.items()}
    tried = [
        first,
        *({**first, name: v} for name, values in axes.items() for v in values[1:]),
    ]
    lines: dict[str, None] = {}
    for point in tried:
        values = {**options.values, **point}
        case = prepare(cases.scenario, replace(options, values=values))
        case.or_raise()
        lines |= dict.fromkeys(case.warnings)
    return list(lines)
