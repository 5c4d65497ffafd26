"""Tabulate the numbers of a run and the verdicts on them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..analyses.manifest import Manifest
from ..numbers.measures import OF_EVENTS
from ..numbers.verdicts import FEW_EVENTS, Verdict
from .table import ROW_UNIT, Cell, Column, Row, Table, or_not_reached


def tabulate_numbers(
    manifest: Manifest,
    baseline: Manifest | None,
    titles: Sequence[str],
    *,
    has_verdicts: bool = False,
    has_references: bool = False,
) -> Table:
    """Tabulate the numbers of a run, then those that were not checked.

    Parameters
    ----------
    manifest, baseline
        The run, and the one whose numbers stand beside its own.
    titles
        Headings of the numbers of each.
    has_verdicts
        Whether a column shows the requirement of a number, and whether it is met.
    has_references
        Whether titles name the scenario that a number compares with.
    """
    manifests = [manifest] if baseline is None else [manifest, baseline]
    columns = [
        Column("", kind="text"),
        *(Column(title, ROW_UNIT) for title in titles),
        Column("", kind="unit"),
    ]
    required = _required(manifest) if has_verdicts else {}
    if required:
        columns.append(Column("required", ROW_UNIT, kind="text"))
    rows: list[Row] = []
    too_few = _with_too_few_events(manifest)
    for name, value in manifest.numbers.items():
        if name in too_few:
            continue
        is_related = has_references and value.reference
        title = Cell(
            value.label, note=f"against {value.reference}" if is_related else ""
        )
        row = [title, *(_number(m, name) for m in manifests), value.unit]
        rows.append([*row, required.get(name)] if required else row)
    reasons = dict(manifest.not_checked)
    if too_few:
        titles_without = [
            f"{title[:1].lower()}{title[1:]}" if k else title
            for k, title in enumerate(manifest.numbers[n].title for n in too_few)
        ]
        reasons[", ".join(titles_without)] = FEW_EVENTS
    for name, reason in reasons.items():
        if name in too_few:
            continue
        row = [name, "not checked", *([None] if baseline else []), Cell(reason)]
        rows.append([*row, None] if required else row)
    has_header = len(manifests) > 1 or bool(required)
    return Table("", columns, rows, has_header=has_header)


def _with_too_few_events(manifest: Manifest) -> list[str]:
    """Return the numbers between events of which a run has fewer than two."""
    return [
        name
        for name, number in manifest.content.numbers.items()
        if number.measure in OF_EVENTS
        and name in manifest.numbers
        and manifest.numbers[name].value is None
    ]


def _number(manifest: Manifest, name: str) -> str | float | None:
    """Return a number of a run; None if the run lacks it."""
    number = manifest.numbers.get(name)
    return None if number is None else or_not_reached(number.value)


def _required(manifest: Manifest) -> dict[str, Cell]:
    """Collect the requirements of numbers, by name, and whether they are met."""
    texts: dict[str, list[str]] = {}
    limits: dict[str, list[float]] = {}
    for v in manifest.verdicts.values():
        margin = (
            ""
            if v.margin is None or not v.met
            else f" (margin {100.0 * v.margin:.3g} %)"
        )
        text = f"{_limits_text(v)}: {'met' if v.met else 'NOT MET'}{margin}"
        texts.setdefault(v.number, []).append(text)
        limits.setdefault(v.number, []).extend(x for _, x in v.bounds)
    return {name: Cell("; ".join(lines), limits[name]) for name, lines in texts.items()}


def _limits_text(verdict: Verdict) -> str:
    """Return the limits with places for their numbers."""
    return ", ".join(f"{word} {{}}" for word, _ in verdict.bounds)


def tabulate_verdicts(verdicts: Mapping[str, Verdict]) -> Table:
    """Tabulate the requirements with the numbers of a run."""
    columns = [
        Column("requirement", kind="text"),
        Column("", kind="text"),
        Column("this run", ROW_UNIT),
        Column("required", ROW_UNIT),
        Column("unit", kind="unit"),
        Column("margin %", form=".3g", is_detail=True),
    ]
    rows: list[Row] = [
        (
            v.title,
            Cell("met", mark="ok") if v.met else Cell("NOT MET", mark="bad"),
            or_not_reached(v.value),
            Cell(_limits_text(v), [x for _, x in v.bounds]),
            v.unit,
            None if v.margin is None else 100.0 * v.margin,
        )
        for v in verdicts.values()
    ]
    return Table("", columns, rows)
