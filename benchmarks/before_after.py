"""What `desat` answers, stored before the code is changed and compared after.

    python -m benchmarks.before_after FILE          # writes FILE; where it exists, compares
    python -m benchmarks.before_after FILE --values # series, numbers and exit codes alone

Answers are: the check of every scenario, each problem, warning and note word for word;
of a selection of them, cut to a few steps, the sha256 of every recorded series, and the
manifest; draws of one; and what is said of wrong files, made from the scenario files by
a seeded mutation of one value or key each. Ends with 1 where something differs, and
prints what.
"""

from __future__ import annotations

import argparse
import copy
import hashlib
import json
import random
import re
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from multiprocessing import Pool
from pathlib import Path
from typing import Any

import numpy as np

from desat.files import scenario
from desat.runs.prepare import prepare
from desat.runs.run import Options, simulate
from desat.system.errors import DesatError

MESSAGES = ("problems", "warnings", "notes", "unmet")
TEXTS = ("sha256", "digest", "title", "description", "message", "about", "refused")
WRONG = 900
"""So many wrong files are made."""
STEPS = 40
EVERY = 9
"""Of all scenarios one in so many is flown."""
ASIDE = (
    "began",
    "seconds",
    "created",
    "host",
    "machine",
    "versions",
    "desat",
    "timing",
    "cpu",
    "started",
    "finished",
    "wall",
    "speed",
    "processes",
    "folder",
    "run",
    "memory",
    "us_per",
)


def checked(target: str) -> tuple[str, Any]:
    """What is said of a target before it runs."""
    return target, _problems_of(target)


def _problems_of(target: str) -> Any:
    try:
        found = prepare(target, Options())
    except DesatError as error:
        return {"refused": str(error)}
    except Exception as error:
        return {"traceback": f"{type(error).__name__}: {error}"}
    return {
        "problems": found.problems,
        "warnings": found.warnings,
        "notes": found.notes,
    }


def series_of(target: str) -> tuple[str, Any]:
    """What a short run of a target gives."""
    try:
        case = prepare(target, Options())
        system, _ = case.or_raise()
        stop = system.start + min(STEPS, system.steps) * system.step
        with tempfile.TemporaryDirectory() as folder:
            run = simulate(prepare(target, Options(stop=stop)), Path(folder) / "run")
            series = {
                n: hashlib.sha256(
                    np.ascontiguousarray(run.results.values(n)).tobytes()
                ).hexdigest()[:16]
                for n in sorted(run.results.names())
            }
            run.results.close()
            text = (Path(folder) / "run" / "manifest.json").read_text()
            manifest = json.loads(text.replace(folder, "FOLDER"))
        return f"run {target}", {"series": series, "manifest": _steady(manifest)}
    except DesatError as error:
        return f"run {target}", {"refused": str(error)}


def _steady(x: Any) -> Any:
    """A manifest without what changes from run to run."""
    if isinstance(x, dict):
        return {k: _steady(v) for k, v in x.items() if not any(a in k for a in ASIDE)}
    if isinstance(x, list):
        return [_steady(v) for v in x]
    return float(f"{x:.12g}") if isinstance(x, float) else x


def _paths(data: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    for key in data if isinstance(data, dict) else range(len(data)):
        yield (*path, key)
        if isinstance(data[key], (dict, list)):
            yield from _paths(data[key], (*path, key))


def _mutated(data: dict[str, Any], rng: random.Random) -> dict[str, Any]:
    """The data of a scenario file with one thing wrong, or just another."""
    data = copy.deepcopy(data)
    path = rng.choice(list(_paths(data)))
    place: Any = data
    for key in path[:-1]:
        place = place[key]
    key, value = path[-1], place[path[-1]]
    subject = rng.choice(
        ("drop", "misspell", "text", "number", "large", "list", "table", "negative")
    )
    if subject == "drop":
        place.pop(key)
    elif subject == "misspell" and isinstance(key, str):
        place[key[:-1] + "q"] = place.pop(key)
    elif subject == "misspell" or subject == "text":
        place[key] = (
            f"{value[:-1]}q" if isinstance(value, str) and value else "no.such_thing"
        )
    else:
        place[key] = {
            "number": 3.7,
            "large": 1e30,
            "list": [1.0, 2.0],
            "table": {"a": 1},
            "negative": -1,
        }[subject]
    return data


def _toml(data: dict[str, Any]) -> str:
    """Data as TOML, all inline."""

    def of(x: Any) -> str:
        if isinstance(x, dict):
            return (
                "{"
                + ", ".join(f"{json.dumps(k)} = {of(v)}" for k, v in x.items())
                + "}"
            )
        if isinstance(x, list):
            return f"[{', '.join(map(of, x))}]"
        if isinstance(x, (str, bool)):
            return json.dumps(x, ensure_ascii=False)
        return str(x) if hasattr(x, "isoformat") else repr(x)

    return "".join(f"{json.dumps(k)} = {of(v)}\n" for k, v in data.items())


def wrong(folder: Path) -> list[str]:
    """Files with a mistake each."""
    rng, files = random.Random(1), sorted(scenario.ROOT.glob("*/scenarios/*.toml"))
    results = []
    for k in range(WRONG):
        file = rng.choice(files)
        family = file.parent.parent.name
        if k % 3:
            data = tomllib.loads(file.read_text(encoding="utf-8"))
            data.pop("abstract", None)
            bases = data.get("extends", [])
            bases = [bases] if isinstance(bases, str) else bases
            if bases:
                data["extends"] = [b if "/" in b else f"{family}/{b}" for b in bases]
            data.setdefault("extends", [f"{family}/{file.stem}"])
            for axis in data.get("axes", {}).values():
                first = next(iter(axis), None)
                for other in [x for x in axis if x != first]:
                    del axis[other]
            data = _mutated(data, rng)
        else:  # a craft of one's own, with all that a cell has
            names = list(scenario.cells(file, family))
            if not names:
                continue
            data = copy.deepcopy(scenario.find(rng.choice(names)).content.data)
            data = _mutated(data, rng)
            data.pop("family", None)
            data["extends"] = (
                [f"{family}/{file.stem}"]
                if "axes" not in tomllib.loads(file.read_text(encoding="utf-8"))
                else []
            )
        path = folder / f"{k:04d}-{family}-{file.stem}.toml"
        path.write_text(_toml(data), encoding="utf-8")
        results.append(str(path))
    return results


def answers() -> dict[str, Any]:
    """All of them."""
    targets = sorted(scenario.scenarios())
    found: dict[str, Any] = {}
    with Pool(2) as pool:
        found.update(pool.imap_unordered(checked, targets, 8))
        found.update(pool.imap_unordered(series_of, targets[::EVERY]))
        with tempfile.TemporaryDirectory() as folder:
            for path, message in pool.imap_unordered(checked, wrong(Path(folder)), 8):
                answer = json.dumps(message, ensure_ascii=False)
                answer = answer.replace(f"{folder}/", "").replace(
                    Path(path).parent.name, "FOLDER"
                )
                found[f"wrong {Path(path).name}"] = json.loads(answer)
    return dict(sorted(found.items()))


def main() -> int:
    """Write, or compare."""
    parser = argparse.ArgumentParser(description="Compare answers with stored ones.")
    parser.add_argument("file", type=Path, help="stored answers; written if not there")
    parser.add_argument(
        "--values", action="store_true", help="series, numbers and exit codes alone"
    )
    arguments = parser.parse_args()
    file, values = arguments.file, arguments.values
    now = json.loads(json.dumps(answers()))
    if not file.exists():
        file.write_text(json.dumps(now, indent=1, ensure_ascii=False))
        kinds = re.findall(r"refused|traceback", json.dumps(now))
        print(f"{len(now)} answers; { ({k: kinds.count(k) for k in set(kinds)}) }")
        return 0
    before, differing = json.loads(file.read_text()), 0
    for name in sorted({*before, *now}):
        a, b = before.get(name), now.get(name)
        if values:
            a, b = without_texts(a), without_texts(b)
        if a != b:
            differing += 1
            if differing <= 200:
                print(f"DIFFERS: {name}")
                for line in _differences(a, b):
                    print(f"    {line[:400]}")
    print(f"{len(now)} answers, {differing} differ")
    return int(differing > 0)


def without_texts(answer: Any) -> Any:
    """Return an answer without messages, titles and hashes of code.

    Of problems and warnings their number stays: a commit that changes text alone changes
    none.
    """
    if isinstance(answer, dict):
        return {
            key: len(x) if key in MESSAGES and isinstance(x, list) else without_texts(x)
            for key, x in answer.items()
            if key not in TEXTS
        }
    if isinstance(answer, list):
        return [without_texts(x) for x in answer]
    return answer


def _differences(a: Any, b: Any, place: str = "") -> Iterator[str]:
    if isinstance(a, dict) and isinstance(b, dict):
        for key in sorted({*a, *b}):
            if a.get(key) != b.get(key):
                yield from _differences(a.get(key), b.get(key), f"{place}/{key}")
    elif isinstance(a, list) and isinstance(b, list):
        yield from (f"{place} - {x}" for x in a if x not in b)
        yield from (f"{place} + {x}" for x in b if x not in a)
        if sorted(map(str, a)) == sorted(map(str, b)):
            yield f"{place}: another order"
    else:
        yield f"{place}: {a} -> {b}"


if __name__ == "__main__":
    sys.exit(main())
