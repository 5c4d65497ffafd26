"""What was made to fail, and what came of it: `seen.json`, from which a part of
docs/failures.md is written.

`keep` is called by the programs that make it (`same_bits`, `soak`, `killed`, `prices`,
`targets`, `ordinary`, tests/others.py, tests/misbehaving.py) when they are asked to
with `--keep`; `python -m benchmarks.seen` writes the part anew, and a test says where
the page has another.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from filelock import FileLock

from desat.runs.manifest import write_json

FILE = Path(__file__).with_name("seen.json")
PAGE = Path(__file__).parents[1] / "docs" / "failures.md"
BEGIN, END = "<!-- by python -m benchmarks.seen -->\n", "<!-- to here -->\n"
Parts = dict[str, dict[str, Any]]
Seen = dict[str, Parts]
FAILURES = {
    "NOTHING": "none",
    "SEGFAULT": "segmentation fault",
    "EXIT_0": "`exit(0)`",
    "HANG": "a step that does not return",
    "NOT_FINITE": "NaN",
    "STEP_ERROR": "the step returns error",
    "DISCARD": "the step returns discard",
    "IN_FREE": "a crash when freed",
}
"""What fails in other tools, too: the name in tests/failing.c, and in words."""
TARGET = "nadir_day/day-igrf"
OF = "same bits of "
"""Of another scenario than that of the other parts."""


def is_writing() -> bool:
    """Whether what is found is to be kept; the command line has the word for it no
    more."""
    if found := "--keep" in sys.argv:
        sys.argv.remove("--keep")
    return found


def known() -> Seen:
    """All that was kept: of what, in which part, what."""
    found: Seen = json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}
    return found


def keep(of: str, part: str, fault: dict[str, Any]) -> None:
    """Keep it, with the date and what else the machine did (its load average of a
    minute)."""
    about = {
        "date": datetime.now(UTC).date().isoformat(),
        "load": round(os.getloadavg()[0], 2),
    }
    with FileLock(FILE.with_suffix(".part")):
        seen = known()
        seen.setdefault(of, {})[part] = {**fault, **about}
        write_json(FILE, dict(sorted(seen.items())))


def dates(parts: Parts) -> str:
    """The day, or the first and the last day, of parts."""
    days = sorted({part["date"] for part in parts.values()})
    return " to ".join(dict.fromkeys((days[0], days[-1])))


def _soak(parts: Parts) -> Iterator[str]:
    for name, subject in (
        ("native", "runs of native FMUs"),
        ("python", "runs of FMUs of Python"),
    ):
        if name in parts:
            lines = parts[name]["lines"]
            first, half, last = lines[0], lines[len(lines) // 2 - 1], lines[-1]
            memory = [
                f"{x['memory_kB'] / 1e3:.1f} MB after {x['runs']:,}"
                for x in (first, half, last)
            ]
            held = " and ".join(
                f"{first[k]} {words}"
                if first[k] == last[k]
                else f"{first[k]} then {last[k]} {words}"
                for k, words in (
                    ("handles", "open files"),
                    ("temporary", "temporary files"),
                )
            )
            more = ""
            if name == "python":
                saved = (last["memory_kB"] - half["memory_kB"]) / (
                    last["runs"] - half["runs"]
                )
                more = (
                    f"; {first['classes']} then {last['classes']} classes of FMUs. What grows, "
                    f"{saved:.1f} kB a run of some ten FMUs in its second half, is pythonfmu's "
                    "library: it keeps the names of an instance's classes, twice"
                )
            yield (
                f"- Soak, {last['runs']:,} {subject} in one process: private memory "
                + (f"{', '.join(memory)}; {held}{more} ({parts[name]['date']}).")
            )
    if "steps" in parts:
        lines = parts["steps"]["lines"]
        memory = [f"{x['memory_kB'] / 1e3:.1f} MB" for x in (lines[0], lines[-2])]
        yield (
            f"- Soak, one run of {lines[-1]['rows'] - 1:,} steps that records two outputs at "
            f"each (gyrostat): private memory {memory[0]} after the first part written, "
            f"{memory[1]} after the last; {lines[0]['handles']} then {lines[-2]['handles']} "
            f"open files "
            f"({parts['steps']['date']})."
        )


def _killed(parts: Parts) -> Iterator[str]:
    runs, equal, kills = (
        sum(p[k] for p in parts.values()) for k in ("runs", "equal", "kills")
    )
    yield (
        f"- Kill -9 with checkpoints, {TARGET}: {equal} of {runs} runs that were killed {kills} "
        "times at random moments, and went on, equal the run without a break in all bits "
        f"({dates(parts)})."
    )


def _same_bits(parts: Parts, fault: str = "A day at nadir") -> Iterator[str]:
    some = next(iter(parts.values()))
    different = [name for name, part in parts.items() if not part["equal"]]
    yield (
        f"- {fault}, {some['steps']:,} steps, {some['values']:,} values, the whole "
        f"length, made anew in {len(parts)} {'way' if len(parts) == 1 else 'ways'}: "
        + "; ".join(f"{name} ({part['loop']} loop)" for name, part in parts.items())
        + (
            f". NOT EQUAL: {'; '.join(different)}"
            if different
            else ". All bits are equal"
        )
        + f" ({dates(parts)})."
    )


def _rows(parts: Parts) -> Iterator[str]:
    ours, others = (
        ", ".join(sorted({p[k] for p in parts.values()})) for k in ("of", "other")
    )
    off = {name: p["largest"] for name, p in parts.items() if p["differing"]}
    besides = "".join(
        f"; {name} differs by at most {x:.0e}, relative" for name, x in off.items()
    )
    yield (
        f"- The first {min(p['cases'] for p in parts.values())} cases of a scenario of each "
        f"family by the code of {ours}, against that of {others}: rows equal in every bit in "
        f"{len(parts) - len(off)} of {len(parts)}{besides} ({dates(parts)})."
    )


def _targets(parts: Parts) -> Iterator[str]:
    for name, part in parts.items():
        after = ", ".join(f"{x:g}" for x in part["killed_after"])
        differing = len(part["different"])
        yield (
            f"- `make {name}` from nothing, killed with all its processes after {after} s, each "
            f"time started again, then left to end: of {part['files']} files that it builds "
            + (f"{differing} differ from" if differing else "all have the bytes of")
            + f" those made in one go; {len(part['parts'])} parts of files left "
            f"({part['date']})."
        )


def _ordinary(parts: Parts) -> Iterator[str]:
    wrong = [
        f"{name}: {text}" for name, part in parts.items() for text in part["wrong"]
    ]
    yield (
        f"- An ordinary user (uid 65534, nothing of the checkout his), {'; '.join(parts)}: "
        f"{sum(p['commands'] for p in parts.values())} commands (`run`, two at once in a folder "
        "with the same bits, and into one run folder, where one is refused; `list`, `check`, "
        "`--checkpoint`, `draws` with two processes). "
        + (
            f"NOT AS IT SHOULD BE: {'; '.join(wrong)}"
            if wrong
            else "All end as they should, print nothing else, and leave no temporary file"
        )
        + f" ({dates(parts)})."
    )


def _misbehaving(parts: Parts) -> Iterator[str]:
    for part in parts.values():
        yield (
            f"- A campaign of {part['cases']:,} cases of a component that ends its process in "
            f"{part['crashed']} of them and never returns in {part['hung']}: "
            + (
                "each case has one row"
                if part["each_once"]
                else "ROWS ARE MISSING OR TWICE"
            )
            + (
                "; those say how they failed, all others completed"
                if not part["wrong"]
                else f"; WRONG: {', '.join(map(str, part['wrong']))}"
            )
            + f" ({part['date']})."
        )


def _prices(parts: Parts) -> Iterator[str]:
    for steps, part in parts.items():
        yield f"- Prices ({steps} of the nadir day; least of five, in turns; {part['date']},"
        yield f"  load average {part['load']:g} on two processors):"
        yield from (
            f"  {k}: {v:g};" for k, v in part.items() if k not in ("date", "load")
        )


def _others(parts: Parts) -> Iterator[str]:
    tools = [t for t in ("desat", "libcosim", "Ecos", "Ecos, proxyfmu") if t in parts]
    heads = [f"{t} {parts[t]['version']}" for t in tools]
    yield f"| failure ({dates(parts)}) | {' | '.join(heads)} |"
    yield "|---" * (1 + len(tools)) + "|"
    for failure, words in FAILURES.items():
        yield f"| {words} | {' | '.join(_cell(parts[t][failure]) for t in tools)} |"


def _cell(found: dict[str, Any]) -> str:
    """A cell: how the process ended, and what of the ten steps was made."""
    went, wrong = found["rows"] - found["refused"], found["wrong"] - found["refused"]
    text = f"{found['ended']}; {went} steps"
    text += f", {wrong} of them with wrong values" if wrong > 0 else ""
    return text + (
        f", {found['refused']} said to have failed" if found["refused"] else ""
    )


def part() -> str:
    """That part of the page."""
    data = known()
    writers = {
        "same bits": _same_bits,
        "rows": _rows,
        "killed": _killed,
        "soak": _soak,
        "targets": _targets,
        "ordinary": _ordinary,
        "misbehaving": _misbehaving,
        "prices": _prices,
    }
    lines = [
        line
        for of, written in writers.items()
        if of in data
        for line in written(data[of])
    ]
    for of in (of for of in data if of.startswith(OF)):
        lines += _same_bits(data[of], f"`{of.removeprefix(OF)}`")
    if "others" in data:
        lines += ["", *_others(data["others"])]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write it."""
    page = PAGE.read_text(encoding="utf-8")
    before, rest = page.split(BEGIN)
    PAGE.write_text(
        before + BEGIN + part() + END + rest.split(END)[1], encoding="utf-8"
    )


if __name__ == "__main__":
    main()
