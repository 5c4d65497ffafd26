"""Show fits and overlays as tables, sentences and JSON."""

from __future__ import annotations

from collections.abc import Iterator

from ..report.table import ROW_UNIT, Cell, Column, Row, Table
from ..system.typed import JsonObject
from .fit import TITLES, Fit


def tabulate_fit(fit: Fit) -> Table:
    """Tabulate the elements of a fit beside what the craft had, deviations of 1 sigma."""
    columns = [
        Column("", kind="text"),
        Column("fit", ROW_UNIT),
        Column("+-", ROW_UNIT),
        Column("craft.toml", ROW_UNIT),
        Column("+-", ROW_UNIT),
        Column("unit", kind="unit"),
        Column("", kind="text"),
    ]
    rows: list[Row] = []
    for parameter in fit.parameters.values():
        for k, axis in enumerate("xyz"):
            is_observed = bool(parameter.is_observed[k])
            log = [parameter.value[k], parameter.deviation[k]] if is_observed else []
            rows.append(
                [
                    f"{TITLES[parameter.name]}, {axis}",
                    *(map(float, log) if log else (None, None)),
                    float(parameter.before[k]),
                    float(parameter.spread[k]),
                    parameter.unit,
                    Cell("" if is_observed else "not observable"),
                ]
            )
    return Table("", columns, rows)


def describe_fit(fit: Fit) -> Iterator[str]:
    """Yield what a fit could not see, its notes, and how well it explains the log."""
    yield from (f"{text}; craft.toml stands" for text in fit.unobservable)
    yield from fit.notes
    if fit.momentum == 0.0:  # dates of dumps alone
        return
    yield (
        f"left: {fit.residual:.3g} of {fit.momentum:.3g} N m s rms, "
        f"{fit.independent:.0f} independent samples; deviations are 1 sigma"
    )


def fit_as_json(fit: Fit) -> JsonObject:
    """Return a fit for programs, in SI."""
    return {
        "parameters": {
            f"spacecraft.{x.name}": {
                "unit": x.unit,
                "value": x.value.tolist(),
                "deviation": x.deviation.tolist(),
                "observable": x.is_observed.tolist(),
                "before": x.before.tolist(),
                "before_deviation": x.spread.tolist(),
            }
            for x in fit.parameters.values()
        },
        "not_observable": list(fit.unobservable),
        "notes": list(fit.notes),
        "residual": fit.residual,
        "momentum": fit.momentum,
        "independent_samples": fit.independent,
    }
