"""Draws that take long: computed once by `make papers`, kept under docs/papers, read by `tables`.

docs/papers/FAMILY/draws.json: date, seed, versions, and of each scenario with `draws`, a line, its
rows, by columns, and of every number median, least and largest
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import json
import math
import os
import platform
from collections.abc import Iterable
from datetime import UTC, datetime
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from desat.fmus.build import COMPONENTS, sources

from ..files import places
from ..files.scenario import Scenario, families, scenarios
from ..files.text import replace_text
from ..system.codes import Exit
from ..system.errors import DesatError, RunError
from .draws import draws, spreads
from .manifest import PACKAGES
from .numbers import late
from .options import Options

SEED = 1
ROUNDING = 1e-12
"""The last bit of a solved programme (a bound) is the processor's."""
_ASIDE = ("title", "story", "source", "twin", "plots", "paper", "labels", "requirements", "draws")
"""What of a scenario changes no number of a draw."""


def file_of(family: str) -> Path:
    """Where the draws of a family are stored."""
    return places.DRAWS / family / "draws.json"


def with_draws(family: str) -> dict[str, Scenario]:
    """The scenarios of a family that say `draws`."""
    return {n: s for n, s in scenarios(family).items() if s.data.get("draws")}


def digest(scenario: Scenario) -> str:
    """A hash of all of a scenario that a draw's numbers depend on."""
    data = {k: v for k, v in scenario.data.items() if k not in _ASIDE}
    return hashlib.sha256(json.dumps(data, sort_keys=True, default=str).encode()).hexdigest()


def code(scenario: Scenario) -> str:
    """A hash of the code that makes a scenario's draws: its blocks and all that they import, the
    engine, the drawing and the measures; and of its kept design, where it has one. Comments and
    docstrings do not count."""
    draft = scenario.draft(blocks=True)
    names = sorted({Path(c.source).stem for c in draft.components.values()})
    files = {p for name in names for p in sources(name)}
    here = Path(__file__).parent
    files |= {p for p in (here.parent / "engine").iterdir() if p.suffix in (".py", ".c")}
    files |= {here / f"{n}.py" for n in ("draws", "sampling", "numbers", "derived")}
    files |= {*here.glob("meas*.py")}
    if scenario.data.get("design", {}).get("each_draw", False):
        files |= {*(here.parent / "designs").glob("*.py")}
        files |= {*(COMPONENTS / "laws").glob("*_offline.py")}
    elif scenario.design is not None:
        files.add(scenario.design)
    made = hashlib.sha256()
    for path in sorted(files):
        text = path.read_text(encoding="utf-8")
        made.update(f"{path.name}\0{meaning(text) if path.suffix == '.py' else text}\0".encode())
    return made.hexdigest()


@cache
def meaning(text: str) -> str:
    """What a Python file says: its syntax tree without comments, docstrings and layout."""
    return _dump(ast.parse(text))


def _dump(node: Any) -> str:
    """A syntax tree as a text that is the same for every version of Python: unlike `ast.dump`, it
    leaves out every field that is empty."""
    if isinstance(node, list):
        return f"[{','.join(_dump(x) for x in node if not _is_text(x))}]"
    if not isinstance(node, ast.AST):
        return repr(node)
    fields = ((k, v) for k, v in ast.iter_fields(node) if v is not None and v != [])
    return f"{type(node).__name__}({','.join(f'{k}={_dump(v)}' for k, v in fields)})"


def _is_text(node: Any) -> bool:
    """True for a statement that is only a text: a docstring."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def compute(
    family: str,
    jobs: int,
    progress: bool = False,
    known: dict[str, Any] | None = None,
    names: Iterable[str] | None = None,
) -> dict[str, Any]:
    """Run the draws of a family (or of the scenarios named) by its FMUs. Raises DesatError where
    a draw fails.

    What `known` (an older result) has for the other scenarios is kept, and so are those of its
    draws that this code would make again.
    """
    kept = dict((known or {}).get("scenarios", {}))
    made = {}
    for name, scenario in with_draws(family).items():
        old = kept.get(name)
        if names is not None and name not in names:
            if old:
                made[name] = old
            continue
        count = scenario.data["draws"]
        rows = old["draws"][:count] if old and _is_current(old, scenario) else []
        result = draws(name, count, SEED, Options(), jobs, progress, first=len(rows))
        if failed := [r for r in result["draws"] if r["status"] != "completed"]:
            worst = failed[0]
            text = f"{name}: draw {worst['draw']}: {worst['message']}"
            raise RunError(text, Exit(worst["code"]))
        rows += [{"draw": r["draw"], "numbers": r["numbers"]} for r in result["draws"]]
        summed = result["summary"] or (old or {})["summary"]
        units = {n: s["unit"] for n, s in summed.items()}
        made[name] = {
            "sha256": digest(scenario),
            "code_sha256": code(scenario),
            "date": f"{datetime.now(UTC):%Y-%m-%d}",
            "summary": spreads(rows, units, late(scenario.data)),
            "draws": rows,
        }
    return {
        "family": family,
        "date": f"{datetime.now(UTC):%Y-%m-%d}",
        "seed": SEED,
        "components_as": "FMUs",
        "versions": {**{p: version(p) for p in PACKAGES}, "python": platform.python_version()},
        "scenarios": made,
    }


def write(result: dict[str, Any]) -> Path:
    """Store the draws of a family."""
    path, pack = file_of(result["family"]), partial(json.dumps, separators=(",", ":"))
    head = {key: value for key, value in result.items() if key != "scenarios"}
    lines = (
        f"{pack(name)}:{pack({**kept, 'draws': _by_column(kept['draws'])})}"
        for name, kept in result["scenarios"].items()
    )
    scenarios = ",\n".join(lines)
    replace_text(path, f'{pack(head)[:-1]},"scenarios":{{\n{scenarios}\n}}}}\n')
    return path


def _by_column(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Draws and their numbers, a list each: less than half of what the rows take. A number that a
    draw has not is None."""
    names = dict.fromkeys(name for row in rows for name in row["numbers"])
    return {
        "draw": [row["draw"] for row in rows],
        "numbers": {name: [row["numbers"].get(name) for row in rows] for name in names},
    }


def _by_row(columns: dict[str, Any]) -> list[dict[str, Any]]:
    """What `_by_column` was made of."""
    numbers = columns["numbers"]
    return [
        {"draw": draw, "numbers": {name: numbers[name][i] for name in numbers}}
        for i, draw in enumerate(columns["draw"])
    ]


def read(family: str) -> dict[str, Any]:
    """The stored draws of a family. Raises DesatError where there are none."""
    path = file_of(family)
    try:
        result: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise DesatError(
            f"{places.shown(path)}: no such file; `desat tables {family} --fresh` "
            "computes the draws now"
        ) from error
    for kept in result["scenarios"].values():
        kept["draws"] = _by_row(kept["draws"])
    return result


def outdated(stored: dict[str, Any]) -> list[str]:
    """The scenarios whose stored draws are missing, fewer or more than it says, or of another
    version of it or of the code that makes them."""
    kept = stored["scenarios"]
    return [
        name for name, scenario in with_draws(stored["family"]).items()
        if name not in kept
        or len(kept[name]["draws"]) != scenario.data["draws"]
        or not _is_current(kept[name], scenario)
    ]  # fmt: skip


def _is_current(kept: dict[str, Any], scenario: Scenario) -> bool:
    """True where stored draws are of this version of a scenario and of its code."""
    return kept["sha256"] == digest(scenario) and kept.get("code_sha256") == code(scenario)


def renew(family: str, jobs: int, progress: bool = False) -> dict[str, Any]:
    """The family's draws, of which only those that are outdated are made now."""
    if not file_of(family).exists():
        return compute(family, jobs, progress)
    known = read(family)
    old = outdated(known)
    return compute(family, jobs, progress, known, old) if old else known


def stamp(family: str, count: int, jobs: int) -> list[str]:
    """Make the first `count` draws of each scenario whose draws are of other code, or whose file
    has changed, and say that they are of this where all numbers come out equal (to ROUNDING); the
    names of the scenarios where they do not: `renew` is for these."""
    known, failed = read(family), []
    for name in outdated(known):
        scenario, kept = with_draws(family)[name], known["scenarios"].get(name)
        if kept is not None:
            again = draws(name, count, known["seed"], Options(), jobs)["draws"]
            numbers = [r["numbers"] for r in again]
            if _alike(numbers, [r["numbers"] for r in kept["draws"][:count]]):
                kept["sha256"], kept["code_sha256"] = digest(scenario), code(scenario)
                write(known)
                continue
        failed.append(name)
    return failed


def provenance(stored: dict[str, Any], fresh: bool) -> dict[str, Any]:
    """Which run the numbers of the draws are from."""
    keys = ("date", "seed", "components_as", "versions")
    file = "" if fresh else places.shown(file_of(stored["family"]))
    return {"file": file or "computed now", **{k: stored[k] for k in keys}}


def _alike(now: list[dict[str, float | None]], kept: list[dict[str, float | None]]) -> bool:
    """True where all that is kept comes out again. A number that runs have since is not in the kept
    draws, and whatever asks for it says so."""
    return len(now) == len(kept) and all(
        all(_equal(a.get(k), b[k]) for k in b) for a, b in zip(now, kept, strict=True)
    )


def _equal(a: float | None, b: float | None) -> bool:
    """Equal to ROUNDING, or neither reached."""
    return a is b is None or (
        a is not None and b is not None and math.isclose(a, b, rel_tol=ROUNDING)
    )


def main() -> int:
    """`python -m desat.study.stored [--verify N] [FAMILY ...]`: stamp stored draws that runs of
    today's code reproduce."""
    parser = argparse.ArgumentParser(description=stamp.__doc__)
    parser.add_argument("families", nargs="*", metavar="FAMILY", help="default: all with draws")
    parser.add_argument("--verify", type=int, default=2, metavar="N", help="draws to make again")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    given = parser.parse_args()
    if given.verify < 1:
        parser.error("--verify: a whole number from 1 on is needed")
    wanted = given.families or [f for f in families() if with_draws(f)]
    failed = [name for family in wanted for name in stamp(family, given.verify, given.jobs)]
    for name in failed:
        print(f"{name}: its draws come out otherwise; not stamped, `make papers` renews them")
    return min(len(failed), 1)


if __name__ == "__main__":
    raise SystemExit(main())
