"""Two campaigns over the same cases, in pairs."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from ..numbers.statistics import clopper_pearson
from ..system.errors import DesatError
from . import store
from .figures import flat
from .pairs import difference, spread
from .plan import Plan, read, system


def compare(first: Path, second: Path, level: float = 0.95) -> dict[str, Any]:
    """Of each number that both have: the first's less the second's, case by case: median with its
    interval (order statistics), and the share of cases in which the first's is lower.

    Raises DesatError where they are not of the same draws.
    """
    one, other = read(first), read(second)
    for key in ("seed", "sampling"):
        if getattr(one, key) != getattr(other, key):
            raise DesatError(f"{first} and {second}: {key} is {getattr(one, key)} and "
                             f"{getattr(other, key)}; pairs need the same")  # fmt: skip
    tables = [store.read(first), store.read(second)]
    rows = [{c: i for i, (c, s) in enumerate(zip(t["case"].to_pylist(), t["status"].to_pylist(),
                                                 strict=True)) if s == "completed"}
            for t in tables]  # fmt: skip
    cases = sorted(rows[0].keys() & rows[1].keys())
    if not cases:
        raise DesatError(f"{first} and {second}: no case is completed in both")
    _same_inputs(first, second, tables, rows, cases)
    names = [
        n for n in tables[0].column_names if n.startswith("out.") and n in tables[1].column_names
    ]
    units = _same_units(first, second, names)
    return {
        "first": str(first), "second": str(second), "pairs": len(cases),
        "warnings": [*_warnings(one, other), *_apart(tables, rows)],
        "numbers": {
            n[4:]: {"unit": units[n], **_differences(tables, rows, cases, n, level)} for n in names
        },
    }  # fmt: skip


def _warnings(one: Plan, other: Plan) -> list[str]:
    """That the two do not end at the same time, as far as their systems are there."""
    try:
        ends = [p.run_options().stop or system(p.target, p.run_options().blocks).stop
                for p in (one, other)]  # fmt: skip
    except DesatError:
        return []
    if None in ends or ends[0] == ends[1]:
        return []
    return [f"the first runs until {ends[0]:g} s, the second until {ends[1]:g} s"]


def _apart(tables: list[Any], rows: list[dict[int, int]]) -> list[str]:
    """That cases which one of the two has completed failed in the other."""
    lines = []
    for i, (own, other) in enumerate((("first", "second"), ("second", "first"))):
        made = set(tables[1 - i]["case"].to_pylist())
        failed = sorted(rows[i].keys() & made - rows[1 - i].keys())
        if failed:
            told = f"case {failed[0]}" + (f" and {len(failed) - 1} more" if failed[1:] else "")
            lines.append(f"{told}: completed in the {own}, failed in the {other}: in no pair")
    return lines


def _same_inputs(
    first: Path, second: Path, tables: list[Any], rows: list[dict[int, int]], cases: list[int]
) -> None:  # fmt: skip
    """Raises DesatError where the two drew other values under one name, or nothing alike."""
    columns = [{n for n in t.column_names if n.startswith("in.")} for t in tables]
    shared = sorted(columns[0] & columns[1])
    if not shared:
        raise DesatError(f"{first} and {second}: there is nothing that both draw")
    for name in shared:
        a, b = (t[name].to_pylist() for t in tables)
        for case in cases:
            if a[rows[0][case]] != b[rows[1][case]]:
                raise DesatError(
                    f"{first} and {second}: {name[3:]} of case {case} is {a[rows[0][case]]} "
                    f"and {b[rows[1][case]]}; pairs need the same draws"
                )


def _same_units(first: Path, second: Path, names: list[str]) -> dict[str, str]:
    """The unit of each number. Raises DesatError where the second has it in another one."""
    told = [store.described(f) for f in (first, second)]
    units = {}
    for name in names:
        ours, theirs = (t[name[4:]]["unit"] for t in told)
        if ours != theirs:
            raise DesatError(f"{first} and {second}: {name[4:]} is in {ours} and in {theirs}; "
                             "pairs need the same")  # fmt: skip
        units[name] = ours
    return units


def _differences(
    tables: list[Any], rows: list[dict[int, int]], cases: list[int], name: str, level: float
) -> dict[str, Any]:  # fmt: skip
    a, b = (
        flat(t[name].to_pylist())[[r[c] for c in cases]] for t, r in zip(tables, rows, strict=True)
    )
    each = sorted(
        difference(x, y) for x, y in zip(a.tolist(), b.tolist(), strict=True)
        if math.isfinite(x) and math.isfinite(y)
    )  # fmt: skip
    told = spread(each)
    if not (n := len(each)):
        return told
    # the k-th least and the k-th largest hold the median with at least this confidence
    from scipy.stats import binom  # half a second

    k = int(binom.ppf((1.0 - level) / 2.0, n, 0.5))
    return {
        **told, "interval": [each[max(k - 1, 0)], each[min(n - k, n - 1)]],
        "interval_holds": k > 0, "share_lower": 100.0 * told["lower"] / n,
        "share_lower_interval": clopper_pearson(told["lower"], n, level),
    }  # fmt: skip
