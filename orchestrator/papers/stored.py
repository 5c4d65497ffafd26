"""Compute and store samples that take long (`make papers`), for `desat tables`.

docs/papers/FAMILY/draws.parquet holds a row for each sample, sorted by scenario and
sample, and a column for each number. It is null where the sample does not reach the
number, or where the scenario does not store it.

docs/papers/draws.json holds for each family the seed, versions and the sha256 of that
file, and for each scenario, in one line, its stamps and the units of the stored
numbers: those that rows of papers name, and those that a page has requested.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import os
import platform
import re
from collections.abc import Collection, Iterable, Mapping
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, TypedDict, cast

from desat.fmus import meaning
from desat.fmus.meaning import COMPONENTS

from ..campaign.draws import RunRow, draws
from ..campaign.spread import Spread, spreads
from ..files import identity, paths
from ..files.build import build
from ..files.completion import system_of
from ..files.io import replace_text
from ..files.scenario import Scenario, families, scenarios
from ..language.content import NOTHING
from ..language.paper import OfNumber
from ..numbers.numbers import late
from ..system.errors import DesatError, Exit, RunError
from ..system.options import Options


class StoredScenario(TypedDict):
    """Samples of a scenario with their origin, `units` and summary of numbers."""

    sha256: str
    code_sha256: str
    date: str
    units: dict[str, str]
    summary: dict[str, Spread]
    draws: list[RunRow]


class StoredDraws(TypedDict):
    """Samples of a family."""

    family: str
    date: str
    seed: int
    components_as: str
    versions: dict[str, str]
    scenarios: dict[str, StoredScenario]


class Provenance(TypedDict):
    """Run that samples come from, and the file that holds them."""

    file: str
    date: str
    seed: int
    components_as: str
    versions: dict[str, str]


SEED = 1
ROUNDING = (
    1e-7  # relative; processors and libm differ by up to 3e-8 after an unstable rollout
)


def file_of(family: str) -> Path:
    """Return the path of a family's stored samples."""
    return paths.DRAWS / family / "draws.parquet"


def provenance_file() -> Path:
    """Return the path of the stamps of all families.

    They say which code and scenarios the stored samples belong to.
    """
    return paths.DRAWS / "draws.json"


def with_draws(family: str) -> dict[str, Scenario]:
    """Return the scenarios of a family that have samples."""
    return {n: s for n, s in scenarios(family).items() if s.content.samples}


def needed(family: str) -> dict[str, set[str]]:
    """Return the numbers of each scenario that rows of the family's paper need.

    They are those of its own rows and of rows that compare another scenario with it.
    Pages request more (`benchmarks/pages/sources.py`).
    """
    found: dict[str, set[str]] = {name: set() for name in with_draws(family)}
    for name, scenario in scenarios(family).items():
        numbers = scenario.content.numbers
        for entry in scenario.content.judged.values():
            band = entry.tolerance
            for number in (
                entry.of,
                *([band.of] if isinstance(band, OfNumber) else ()),
            ):
                compared = (
                    numbers[number]
                    if number in numbers and numbers[number].reference
                    else None
                )
                found.setdefault(name, set()).add(compared.of if compared else number)
                if compared:
                    found.setdefault(f"{family}/{compared.reference}", set()).add(
                        compared.of
                    )
    return found


def digest(scenario: Scenario) -> str:
    """Compute the digest of everything of a scenario that a sample depends on.

    It covers the system before sampling, with the code of its blocks, and the design
    where one is made for each sample.

    Raises
    ------
    DesatError
        If the scenario has no system.
    """
    system = system_of(build(scenario, Options(blocks=True)))
    return identity.of_system(
        system, Options(blocks=True), scenario.each_draw, identity.JUDGED
    )


def code(scenario: Scenario) -> str:
    """Compute a hash of the code that makes a scenario's samples, besides its blocks.

    It covers the engine, the sampling and the measures, and the code of designs where
    one is made for each sample. The file and order of definitions do not affect it, so
    that files can be moved, joined and split; nor do imports, comments and docstrings.
    """
    home = Path(__file__).parents[1]
    files = {p for p in (home / "engine").rglob("*") if p.suffix in (".py", ".c")}
    files |= {
        *(home / "numbers").glob("*.py"),
        home / "campaign" / "draws.py",
        home / "campaign" / "sampling.py",
        home / "language" / "content.py",
    }
    if scenario.each_draw:
        files |= {*(home / "papers" / "designs").rglob("*.py")}
        files |= {*(COMPONENTS / "laws").glob("*_offline.py")}
    return meaning.of_files(files, imports=False)


def compute(
    family: str,
    jobs: int,
    progress: bool = False,
    known: StoredDraws | None = None,
    names: Iterable[str] | None = None,
    also: Mapping[str, Collection[str]] | None = None,
) -> StoredDraws:
    """Run the samples of a family, or of the named scenarios, with its FMUs.

    Parameters
    ----------
    family
        Name of the family.
    jobs
        Number of processes.
    progress
        Show a progress bar.
    known
        An older result. Its other scenarios are retained, and so are those of its
        samples that this code would make again.
    names
        Scenarios to run; None: all.
    also
        Numbers to store by scenario, besides those that are `needed` and those that
        `known` has.

    Raises
    ------
    DesatError
        If a sample fails.
    """
    stored = known["scenarios"] if known else {}
    computed, of_rows = dict[str, StoredScenario](), needed(family)
    for name, scenario in with_draws(family).items():
        old = stored.get(name)
        if names is not None and name not in names:
            if old:
                computed[name] = old
            continue
        count = scenario.content.samples
        needed_units = {
            *of_rows[name],
            *(old["units"] if old else ()),
            *(also or {}).get(name, ()),
        }
        rows = list[RunRow]()
        if old and needed_units <= old["units"].keys() and _is_current(old, scenario):
            rows = old["draws"][:count]
        result = draws(name, count, SEED, Options(), jobs, progress, first=len(rows))
        for row in result.rows:
            if not row.completed:
                raise RunError(
                    f"{name}: draw {row.number}: {row.message}", Exit(row.code)
                )
            rows.append(
                row_of_draw(
                    row.number,
                    {n: x for n, x in row.numbers.items() if n in needed_units},
                )
            )
        summed = result.summary or (old["summary"] if old else {})
        units = {n: summed[n].unit or "" for n in sorted(needed_units & summed.keys())}
        computed[name] = {
            "sha256": digest(scenario),
            "code_sha256": code(scenario),
            "date": f"{datetime.now(UTC):%Y-%m-%d}",
            "units": units,
            "summary": spreads(
                [r.numbers for r in rows], units, late(scenario.content)
            ),
            "draws": rows,
        }
    return {
        "family": family,
        "date": f"{datetime.now(UTC):%Y-%m-%d}",
        "seed": SEED,
        "components_as": "FMUs",
        "versions": {**identity.versions(), "processor": _processor()},
        "scenarios": computed,
    }


def row_of_draw(draw: int | None, numbers: Mapping[str, float | None]) -> RunRow:
    """Return the row of a stored sample; all of these completed."""
    return RunRow("completed", 0, "", numbers=numbers, number=draw)


def _processor() -> str:
    """Return the processor's name, where the system gives it."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return platform.processor()
    match = re.search(r"model name\s*: (.*)", text)
    return match[1] if match else platform.processor()


def write(result: StoredDraws) -> Path:
    """Write the stored samples of a paper's scenarios, and return the file's path.

    The file of provenances gets the hashes of scenarios and code that they are of. The
    same samples give the same bytes.
    """
    path = file_of(result["family"])
    data = _pack(result["scenarios"])
    replace_text(path, data)
    head = {k: v for k, v in result.items() if k not in ("family", "scenarios")}
    head["draws_sha256"] = hashlib.sha256(data).hexdigest()
    stamps = {
        name: {k: v for k, v in samples.items() if k not in ("summary", "draws")}
        for name, samples in sorted(result["scenarios"].items())
    }
    families = {**_provenances(), result["family"]: {**head, "scenarios": stamps}}
    pack = partial(json.dumps, separators=(",", ":"))
    texts = []
    for family, entry in sorted(families.items()):
        lines = ",\n".join(
            f"{pack(n)}:{pack(x)}" for n, x in entry["scenarios"].items()
        )
        provenance = pack({k: v for k, v in entry.items() if k != "scenarios"})
        texts.append(f'{pack(family)}:{provenance[:-1]},"scenarios":{{\n{lines}\n}}}}')
    replace_text(provenance_file(), "{\n" + ",\n".join(texts) + "\n}\n")
    return path


def _provenances() -> Mapping[str, Any]:
    """Read the stamps of all families; empty where there are none."""
    try:
        provenances: Mapping[str, Any] = json.loads(
            provenance_file().read_text(encoding="utf-8")
        )
    except FileNotFoundError:
        return {}
    return provenances


def _pack(scenarios: Mapping[str, StoredScenario]) -> bytes:
    """Return the samples of scenarios as a Parquet file; numbers retain all bits."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows = [
        (name, r)
        for name, samples in sorted(scenarios.items())
        for r in samples["draws"]
    ]
    names = sorted({n for samples in scenarios.values() for n in samples["units"]})
    columns = {
        "scenario": pa.array([name for name, _ in rows], pa.string()),
        "draw": pa.array([r.number for _, r in rows], pa.int32()),
        **{
            n: pa.array([r.numbers.get(n) for _, r in rows], pa.float64())
            for n in names
        },
    }
    sink = pa.BufferOutputStream()
    pq.write_table(
        pa.table(columns),
        sink,
        compression="zstd",
        compression_level=19,
        store_schema=False,
        write_statistics=False,
        use_dictionary=["scenario"],
        column_encoding={"draw": "DELTA_BINARY_PACKED"}
        | dict.fromkeys(names, "BYTE_STREAM_SPLIT"),
    )
    data: bytes = sink.getvalue().to_pybytes()
    return data


def read(family: str) -> StoredDraws:
    """Read the stored samples of a family.

    Each scenario has its stamps, `units` and `summary` of its numbers, and `draws`, a
    row for each sample.

    Raises
    ------
    DesatError
        If there are none, or the file is not the one that was stamped.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    path, provenances = file_of(family), _provenances()
    if family not in provenances or not path.exists():
        missing = path if family in provenances else provenance_file()
        raise DesatError(
            f"{paths.shown(missing)}: no samples of {family} there; `desat tables "
            f"{family} --fresh` computes the samples now"
        )
    data = path.read_bytes()
    head = {"family": family, **provenances[family]}
    if hashlib.sha256(data).hexdigest() != head.pop("draws_sha256"):
        raise DesatError(
            f"{paths.shown(path)}: not the file that {paths.shown(provenance_file())} "
            "is of: its sha256 is another one"
        )
    columns = pq.read_table(pa.BufferReader(data)).to_pydict()
    places_of: dict[str, list[int]] = {}
    scenarios_known = scenarios(family) if family in families() else {}
    for i, name in enumerate(columns["scenario"]):
        places_of.setdefault(name, []).append(i)
    result = cast(StoredDraws, head)
    for name, samples in result["scenarios"].items():
        samples["draws"] = [
            row_of_draw(
                columns["draw"][i], {n: columns[n][i] for n in samples["units"]}
            )
            for i in places_of.get(name, ())
        ]
        of = scenarios_known[name].content if name in scenarios_known else NOTHING
        numbers = [r.numbers for r in samples["draws"]]
        samples["summary"] = spreads(numbers, samples["units"], late(of))
    return result


def outdated(stored: StoredDraws) -> list[str]:
    """Return the scenarios whose stored samples are not current.

    They are missing, fewer or more than the scenario requires, without a number that is
    needed, or of another version of the scenario or of the code.
    """
    samples, of_rows = stored["scenarios"], needed(stored["family"])
    return [
        name
        for name, scenario in with_draws(stored["family"]).items()
        if name not in samples
        or len(samples[name]["draws"]) != scenario.content.samples
        or not of_rows[name] <= samples[name]["units"].keys()
        or not _is_current(samples[name], scenario)
    ]


def require_current(stored: StoredDraws) -> None:
    """Raise DesatError where stored samples are not of today's scenarios and code.

    The message names the scenarios, what has changed, and the command that confirms or
    renews.
    """
    names = outdated(stored)
    if not names:
        return
    samples, family = stored["scenarios"], stored["family"]
    families_stored = with_draws(family)
    causes = {
        "missing, too few or without a number that is needed": [
            n for n in names if n not in samples
        ],
        "of another scenario or other blocks": [
            n
            for n in names
            if n in samples and samples[n]["sha256"] != digest(families_stored[n])
        ],
        "of other code of engine, measures or sampling": [
            n
            for n in names
            if n in samples
            and samples[n].get("code_sha256") != code(families_stored[n])
        ],
    }
    lines = [
        f"{family}: {len(of)} of {len(families_stored)} stored samples are {cause}: {', '.join(of[:3])}"
        for cause, of in causes.items()
        if of
    ]
    remedy = (
        f"`python -m desat.papers.stored {family}` stamps those that runs of today reproduce, "
        "`make papers` makes the others anew"
    )
    raise DesatError("\n".join([*lines, remedy]))


def _is_current(stored: StoredScenario, scenario: Scenario) -> bool:
    """Return whether stored samples are of this version of a scenario and its code."""
    return stored["sha256"] == digest(scenario) and stored.get("code_sha256") == code(
        scenario
    )


def renew(
    family: str,
    jobs: int,
    progress: bool = False,
    also: Mapping[str, Collection[str]] | None = None,
) -> StoredDraws:
    """Compute those samples of a family that are outdated or lack a number.

    `also` names further numbers by scenario.
    """
    if not file_of(family).exists():
        return compute(family, jobs, progress, also=also)
    draws_stored = read(family)
    lacking = [
        n
        for n, x in (also or {}).items()
        if not draws_stored["scenarios"][n]["units"].keys() >= set(x)
    ]
    old = {*outdated(draws_stored), *lacking}
    return (
        compute(family, jobs, progress, draws_stored, old, also)
        if old
        else draws_stored
    )


def confirm(family: str, count: int, jobs: int) -> list[str]:
    """Confirm stored samples by making the first `count` of them again.

    This is done for each scenario whose code or file has changed. Where all numbers
    agree (to ROUNDING), the samples are stamped as of the present code. Returns the
    names of the scenarios where they do not agree: `renew` is for these.
    """
    draws_stored, failed = read(family), []
    for name in outdated(draws_stored):
        scenario, stored = with_draws(family)[name], draws_stored["scenarios"].get(name)
        if stored is not None:
            again = draws(name, count, draws_stored["seed"], Options(), jobs).rows
            if _alike(
                [r.numbers for r in again], [r.numbers for r in stored["draws"][:count]]
            ):
                stored["sha256"], stored["code_sha256"] = (
                    digest(scenario),
                    code(scenario),
                )
                write(draws_stored)
                continue
        failed.append(name)
    return failed


def provenance(stored: StoredDraws, fresh: bool) -> Provenance:
    """Return the run that the samples come from."""
    file = "computed now" if fresh else paths.shown(file_of(stored["family"]))
    return {
        "file": file,
        "date": stored["date"],
        "seed": stored["seed"],
        "components_as": stored["components_as"],
        "versions": stored["versions"],
    }


def _alike(
    now: list[Mapping[str, float | None]], numbers: list[Mapping[str, float | None]]
) -> bool:
    """Return whether all stored numbers come out again.

    A number that runs have only since then is not in the stored samples; a request for
    it is reported elsewhere.
    """
    return len(now) == len(numbers) and all(
        all(_equal(a.get(k), b[k]) for k in b)
        for a, b in zip(now, numbers, strict=True)
    )


def _equal(a: float | None, b: float | None) -> bool:
    """Return whether two numbers are equal to ROUNDING, or both not reached."""
    return a is b is None or (
        a is not None and b is not None and math.isclose(a, b, rel_tol=ROUNDING)
    )


def main() -> int:
    """Run `python -m desat.papers.stored [--verify N] [FAMILY ...]`.

    It stamps stored samples that runs of today's code reproduce.
    """
    parser = argparse.ArgumentParser(description=confirm.__doc__)
    parser.add_argument(
        "families", nargs="*", metavar="FAMILY", help="default: all with samples"
    )
    parser.add_argument(
        "--verify", type=int, default=2, metavar="N", help="samples to compute again"
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    arguments = parser.parse_args()
    if arguments.verify < 1:
        parser.error("--verify: a whole number from 1 on is needed")
    selected = arguments.families or [f for f in families() if with_draws(f)]
    failed = [
        name
        for family in selected
        for name in confirm(family, arguments.verify, arguments.jobs)
    ]
    for name in failed:
        print(
            f"{name}: its samples come out otherwise; not stamped, `make papers` renews them"
        )
    return min(len(failed), 1)


if __name__ == "__main__":
    raise SystemExit(main())
