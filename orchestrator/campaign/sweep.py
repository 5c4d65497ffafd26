"""`desat sweep`: a system at every combination of some parameters' values, and its numbers."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from ..numbers.numbers import late
from ..runs.run import Options, prepare
from ..system.draft import overridden
from ..system.errors import DesatError
from ..system.parameters import parse_assignment
from .draws import rows_of, summary, system_of


def axes_of(texts: Sequence[str]) -> dict[str, list[Any]]:
    """`component.parameter` -> its values, from texts as `manager.gain=1,2,3`; arrays have `;`
    between them. Raises DesatError for another form, and a name that comes twice."""
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
    target: str, axes: Mapping[str, Sequence[Any]], options: Options | None = None, jobs: int = 2,
    progress: bool = False, *, draws: int = 0, seed: int = 1,
) -> dict[str, Any]:  # fmt: skip
    """Run a system at the product of the axes' values ("component.parameter" -> values in SI).

    Returns "points": of each combination its "values", and its "numbers"; with `draws`, of so many
    seeded draws, the numbers are medians and "summary" has more; and "units" of the numbers.
    Raises DesatError for what is unknown or out of bounds, and for an axis that is drawn.
    """
    options = options or Options()
    if not axes or not all(axes.values()):
        raise DesatError("a sweep needs a parameter and its values: component.parameter=a,b,c")
    system = system_of(target, options)
    for name in axes if draws else ():
        if drawn := overridden(system, name):
            raise DesatError(f"{target}: {name}: {drawn[0]} is drawn, and so cannot be an axis of "
                             "draws")  # fmt: skip
    points = [dict(zip(axes, v, strict=True)) for v in itertools.product(*axes.values())]
    warnings = _warnings(target, axes, options)
    tasks = [
        (target, replace(options, values={**options.values, **point}), seed, draw)
        for point in points for draw in (range(draws) if draws else (None,))
    ]  # fmt: skip
    rows = rows_of(tasks, jobs, target, progress)
    count = max(draws, 1)
    made, times = [], late(system.about)
    for i, point in enumerate(points):
        own = rows[i * count : (i + 1) * count]
        worst = max(own, key=lambda row: row["code"])
        of_draws = summary(own, times)
        made.append({
            "values": point,
            "numbers": {name: entry["median"] for name, entry in of_draws.items()},
            "stopped": sum(row["stopped_when"] is not None for row in own),
            **{key: worst[key] for key in ("status", "code")},
            "message": f"draw {worst['draw']}: {worst['message']}"
            if worst["message"] and draws else worst["message"],
            **({"summary": of_draws} if draws else {}),
        })  # fmt: skip
    units = {n: e["unit"] for n, e in summary(rows, times).items()}
    return {
        "scenario": target, "axes": {name: list(values) for name, values in axes.items()},
        "draws": draws, "seed": seed if draws else None, "units": units, "points": made,
        "warnings": warnings,
    }  # fmt: skip


def _warnings(target: str, axes: Mapping[str, Sequence[Any]], options: Options) -> list[str]:
    """The warnings of each value beside the others' first. Raises DesatError for what is wrong."""
    first = {name: values[0] for name, values in axes.items()}
    tried = [first, *({**first, name: v} for name, values in axes.items() for v in values[1:])]
    lines: dict[str, None] = {}
    for point in tried:
        case = prepare(target, replace(options, values={**options.values, **point}))
        case.or_raise()
        lines |= dict.fromkeys(case.checked.warnings)
    return list(lines)
