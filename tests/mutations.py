"""`python tests/mutations.py PART SECONDS FOLDER`: mutations of a part of the code
against the quick tests that run the mutated line; results in build/mutations.json, the
page from them.

A part is a seeded sample of mutations of some folders, or all of some functions
(PARTS).

Mutations are cosmic-ray's (`pip install cosmic-ray coverage`, both are no dependencies
of desat). It goes on where an earlier call stopped: FOLDER keeps a copy of the
repository, in which files are mutated, and which test runs which line. The FMUs of that
copy are empty, so that no test can fail because an FMU is of other code than the
mutated block; those of the orchestrator's are the real ones. A test that fails as well
where the file has a line more that does nothing (it compares hashes of code) kills
nothing. What the quick tests do not kill runs with `--all` against every quick test
that runs its line, the tests that its entry names as `also`, and of blocks the files of
tests that name its module and the test that fmus/interfaces.md is of this code. Tests
that were changed meanwhile are copied and mapped anew.

`--landed` draws from the statements that the last release has not, wherever they stood
in it, and prints what lives; the page is of the other parts. `make mutations` does so.
"""

from __future__ import annotations

import argparse
import ast
import copy
import difflib
import gc
import importlib
import inspect
import io
import json
import os
import platform
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tarfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cache
from importlib import metadata
from itertools import zip_longest
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
STORED = ROOT / "build" / "mutations.json"
PAGE = ROOT / "docs" / "mutations.md"
SEED, SAMPLE = 11, 200
LONGEST = 3.0
"""Processor time [s] of a quick test while lines are counted."""
BUDGET, MOST = 5.0, 15
"""Of the quick tests of a mutation: seconds in all, and how many."""
CPU = 15
"""Processor time [s] of a mutation's tests beyond thrice what they take, and half its
time on the clock; a mutation that takes longer is called killed."""

# Without operators that hardly any test can miss (for ** a bit operation and the like).
OPERATORS = [
    "ReplaceBinaryOperator_Add_Sub",
    "ReplaceBinaryOperator_Sub_Add",
    "ReplaceBinaryOperator_Mul_Div",
    "ReplaceBinaryOperator_Div_Mul",
    "ReplaceBinaryOperator_Mul_Add",
    "ReplaceBinaryOperator_Pow_Mul",
    "ReplaceBinaryOperator_Mod_Sub",
    "ReplaceBinaryOperator_FloorDiv_Mul",
    "ReplaceComparisonOperator_Lt_LtE",
    "ReplaceComparisonOperator_Lt_GtE",
    "ReplaceComparisonOperator_LtE_Lt",
    "ReplaceComparisonOperator_LtE_Gt",
    "ReplaceComparisonOperator_Gt_GtE",
    "ReplaceComparisonOperator_Gt_LtE",
    "ReplaceComparisonOperator_GtE_Gt",
    "ReplaceComparisonOperator_GtE_Lt",
    "ReplaceComparisonOperator_Eq_NotEq",
    "ReplaceComparisonOperator_NotEq_Eq",
    "ReplaceUnaryOperator_Delete_USub",
    "ReplaceUnaryOperator_Delete_Not",
    "ReplaceAndWithOr",
    "ReplaceOrWithAnd",
    "ReplaceTrueWithFalse",
    "ReplaceFalseWithTrue",
    "NumberReplacer",
    "AddNot",
    "ZeroIterationForLoop",
    "ReplaceBreakWithContinue",
    "ReplaceContinueWithBreak",
]

# These hold FMUs, packed files, pages or the engine against the code, or take long.
OF_BLOCKS = {
    "fmus/fmus",
    "fmus/native",
    "files/ssp",
    "files/craft",
    "site/pages",
    "style/structure",
    "library/install",
    "export/independent_masters",
    "fuzz/fuzz",
    "cli/cli",
    "campaign/campaign",
    "engine/checkpoint",
    "engine/failures",
    "language/scenario",
    "site/family",
    "papers/tables_uosat12",
    "engine/results",
    "engine/loop",
    "engine/master",
    "runs/checking",
    "system/expression",
    "papers/stored",
    "runs/stopping",
    "campaign/draws",
    "engine/rates",
    "analyses/coverage",
    "engine/exchange",
    "papers/space_telescope",
}


# These hold pages and FMUs against the code, make folders of their own from it, or take
# long.
OF_RUNS = {
    "fmus/fmus",
    "fmus/native",
    "site/pages",
    "style/structure",
    "library/install",
    "site/contributing",
    "export/independent_masters",
    "fuzz/fuzz",
    "benchmarks/commands",
}
VERDICTS = {
    "system/errors.py": (),
    "numbers/statistics.py": (),
    "analyses/__init__.py": ("not_checked",),
    "analyses/residual.py": (
        "BOUND",
        "unmet",
        "beyond",
        "unchecked",
        "missing",
        "numbers",
    ),
    "analyses/energy.py": (
        "BOUND",
        "ENERGY_BOUND",
        "unmet",
        "unchecked",
        "_not_of_rows",
        "numbers",
        "add",
    ),
    "analyses/fixed.py": (
        "unmet",
        "unchecked",
        "_reason_against",
        "numbers",
        "mismatch",
    ),
    "analyses/coverage.py": (
        "LIMITS",
        "TOGETHER",
        "JITTER",
        "_beyond",
        "_of_jitter",
        "remarks",
    ),
    "campaign/judged.py": (),
    "campaign/case.py": ("row",),
    "campaign/draws.py": ("one", "ran", "_asks_for", "lost_row", "summary"),
    "campaign/spread.py": ("not_reached_text", "spreads"),
    "runs/run.py": ("ok", "code", "or_raise", "_measure", "_cut_short"),
    "engine/child.py": ("apart", "stopped"),
    "runs/step_case.py": ("step", "_add"),
    "runs/stopping.py": ("met", "_reaches", "watch"),
    "papers/comparison.py": ("band_of", "_row", "share_of"),
    "papers/tables.py": ("_single",),
    "cli/__init__.py": ("_code", "_terminate", "_refuse_empty"),
    "files/io.py": ("is_full",),
    "cli/commands/run.py": ("conclude", "skip_if_disk_full", "_report_run"),
    "cli/commands/check.py": ("check",),
    "cli/commands/sweep.py": ("sweep",),
    "cli/commands/campaign.py": ("case", "_report"),
    "cli/commands/size.py": ("size",),
    "papers/commands/tables.py": ("tables",),
}
"""What decides a verdict, an exit code or a bound: functions and constants (none: all)
by file."""
DECIDES = re.compile("Comparison|Not|AndWithOr|OrWithAnd|True|False")
"""Operators of these are tried before others, of a part that is tried whole."""


@dataclass(frozen=True)
class Part:
    """Mutations of some folders; `sample` None: all of those in `functions`, else so
    many of those that are in none of them."""

    title: str
    folders: tuple[str, ...]
    left_out: frozenset[str]
    """Files of tests that do not run."""
    sample: int | None = SAMPLE
    functions: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    empty: bool = False
    """Whether FMUs are empty."""
    release: str = ""
    """Commit whose statements are left out; empty: none are."""

    def has(self, file: str, line: int, places: list[tuple[str, int, int]]) -> bool:
        """Whether a mutation of a line belongs to it, `places` all of the file."""
        is_listed = file.removeprefix("orchestrator/") in self.functions
        names = self.functions.get(file.removeprefix("orchestrator/"), ())
        of = {name for name, first, last in places if first <= line <= last}
        decides = is_listed and (not names or bool(of & set(names)))
        return decides == (self.sample is None)


ROOMS = tuple(
    f"orchestrator/{package}"
    for package in ("system", "engine", "numbers", "analyses", "runs", "campaign")
)
PARTS = {
    "components": Part(
        "what a block does", ("components",), frozenset(OF_BLOCKS), empty=True
    ),
    "orchestrator": Part(
        "how a system is checked, stepped, measured and drawn",
        ROOMS,
        frozenset(OF_RUNS),
        sample=210,
        functions=VERDICTS,
    ),
    "verdicts": Part(
        "a verdict, an exit code or a bound",
        (*ROOMS, "orchestrator/papers", "orchestrator/cli"),
        frozenset(OF_RUNS),
        None,
        VERDICTS,
    ),
}


# --- what landed since the last release -----------------------------------------------


def git(*arguments: str) -> bytes:
    """Return the output of a command of git, empty where it fails."""
    process = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True)
    return process.stdout


def find_last_release() -> str:
    """Return the last tag, or the commit that last changed the version."""
    version = ("log", "-1", "--format=%H", "-G^version = ", "--", "pyproject.toml")
    tag = git("describe", "--tags", "--abbrev=0") or git(*version)
    return tag.decode().strip()


def restrict_to_new_code(part: Part) -> Part:
    """Return a part of the same folders, of what landed since the last release."""
    is_of_blocks = part.folders == ("components",)
    return replace(
        part,
        folders=part.folders if is_of_blocks else ("orchestrator",),
        sample=SAMPLE,
        functions={},
        release=find_last_release(),
    )


def statements_of(text: str) -> Iterator[tuple[str, range]]:
    """Yield the code and the lines of each statement of a module.

    Of a compound statement it is the code before its body.
    """
    for node in ast.walk(ast.parse(text)):
        if not isinstance(node, ast.stmt):
            continue
        head, end = copy.copy(node), node.end_lineno or node.lineno
        if body := getattr(node, "body", None):
            end = max(node.lineno, body[0].lineno - 1)
            for name in ("body", "orelse", "handlers", "finalbody", "cases"):
                setattr(head, name, [])
        begin = min([node.lineno, *(d.lineno for d in _decorators(node))])
        yield ast.dump(head), range(begin, end + 1)


def _decorators(node: ast.stmt) -> list[ast.expr]:
    """Return the decorators of a function or class; else none."""
    return list(getattr(node, "decorator_list", ()))


@cache
def read_release_code(release: str) -> frozenset[str]:
    """Return the code of all statements of a release, but for those of its tests."""
    statements = set()
    with tarfile.open(fileobj=io.BytesIO(git("archive", release))) as files:
        for file in files:
            if file.name.endswith(".py") and not file.name.startswith("tests/"):
                text = files.extractfile(file).read()  # type: ignore[union-attr]
                statements.update(code for code, _ in statements_of(text.decode()))
    return frozenset(statements)


def landed_lines(text: str, release: str) -> set[int]:
    """Return the lines of a module's statements that a release has not."""
    old_statements = read_release_code(release)
    lines = (lines for code, lines in statements_of(text) if code not in old_statements)
    return {line for each in lines for line in each}


# --- the copy, and which test runs which line -----------------------------------------


def find_test_files(tree: Path, part: Part) -> list[Path]:
    """Return the files of tests that run for a part."""
    files = sorted((tree / "tests").rglob("test_*.py"))
    return [file for file in files if name_test_file(file) not in part.left_out]


def name_test_file(file: Path) -> str:
    """Return folder and subject of a file of tests: `fmus/native`."""
    return f"{file.parent.name}/{file.stem.removeprefix('test_')}"


def map_of(folder: Path, file: Path) -> Path:
    """Return the file that says which lines the tests of a file run."""
    return folder / f"map.{name_test_file(file).replace('/', '.')}.json"


def _renew_tests(tree: Path, folder: Path) -> None:
    """Copy the tests that are new or other; remove those that were moved or removed."""
    for file in (ROOT / "tests").rglob("*.py"):
        old = tree / file.relative_to(ROOT)
        if not old.exists() or old.read_bytes() != file.read_bytes():
            old.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(file, old)
            map_of(folder, file).unlink(missing_ok=True)
    for old in (tree / "tests").rglob("*.py"):
        if not (ROOT / old.relative_to(tree)).exists():
            old.unlink()
            map_of(folder, old).unlink(missing_ok=True)


def copy_tree(folder: Path, empty: bool) -> Path:
    """The repository's files in FOLDER/tree, with our FMUs, or (`empty`) empty ones."""
    tree = folder / "tree"
    if tree.exists():
        _renew_tests(tree, folder)
    if not tree.exists():
        process = subprocess.run(
            ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True
        )
        for name in process.stdout.decode().split("\0"):
            if name and (ROOT / name).is_file():
                (tree / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, tree / name)
        if empty:
            (tree / "fmus" / "dist").mkdir()
            for file in (ROOT / "fmus" / "dist").glob("*.fmu"):
                (tree / "fmus" / "dist" / file.name).touch()
        else:
            shutil.copytree(ROOT / "fmus" / "dist", tree / "fmus" / "dist")
        names = tree / ".names" / "desat"
        names.mkdir(parents=True)
        for target in (
            *(tree / "orchestrator").iterdir(),
            tree / "components",
            tree / "fmus",
        ):
            (names / target.name).symlink_to(target)
    return tree


class Lines:
    """A plugin of pytest: the lines that each test runs, in forked processes too, and
    how long it takes."""

    def __init__(self, tree: Path, part: Part, children: Path) -> None:
        import coverage

        self.tree, self.children = tree, children
        source = [str(tree / f) for f in part.folders]
        self.cov = coverage.Coverage(data_file=None, source=source, config_file=False)
        self.seconds: dict[str, float] = {}
        self.passed: set[str] = set()

    def pytest_configure(self) -> None:
        signal.signal(signal.SIGVTALRM, _too_long)
        self.children.mkdir(exist_ok=True)
        self.cov.start()
        ours, end = os.getpid(), os._exit

        def exit_with(code: int) -> None:  # a run is in a fork, which ends without more
            if os.getpid() != ours:
                text = json.dumps(self.found())
                (self.children / f"{os.getpid()}.json").write_text(text)
            end(code)

        os._exit = exit_with  # type: ignore[assignment]

    def pytest_runtest_protocol(self, item: Any) -> None:
        self.cov.switch_context(item.nodeid)
        self.began = time.process_time()
        signal.setitimer(signal.ITIMER_VIRTUAL, LONGEST)

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.when == "call" and report.passed:
            self.passed.add(report.nodeid)
        if report.when == "teardown":
            signal.setitimer(signal.ITIMER_VIRTUAL, 0)
            self.seconds[report.nodeid] = time.process_time() - self.began

    def pytest_unconfigure(self) -> None:
        self.cov.stop()

    def found(self) -> list[tuple[str, str, int]]:
        """Test, file and line of what this process ran."""
        data, out = self.cov.get_data(), []
        for path in data.measured_files():
            name = str(Path(path).resolve().relative_to(self.tree))
            for line, tests in data.contexts_by_lineno(path).items():
                out += [(test, name, line) for test in tests]
        return out


def _too_long(*_: object) -> None:
    raise TimeoutError("too long for a quick test")


def write_maps(tree: Path, folder: Path, part: Part, until: float) -> bool:
    """Write FOLDER/map.FILE.json for each file of tests; True where all are there."""
    for file in find_test_files(tree, part):
        map_file = map_of(folder, file)
        if map_file.exists():
            continue
        if time.time() > until:
            return False
        for _ in range(2):  # the limit of a test may end it where coverage holds a lock
            if (pid := os.fork()) == 0:
                _quiet(map_file.with_suffix(".log"), 240)
                os._exit(_map_file(tree, part, file, map_file))
            if wait_for(pid, 400.0) is not None:
                break
        if not map_file.exists():
            map_file.write_text("{}")
        print(
            f"{file.stem}: {len(json.loads(map_file.read_text()))} quick tests",
            flush=True,
        )
    return True


def _map_file(tree: Path, part: Part, file: Path, stored_values: Path) -> int:
    import pytest

    children = stored_values.with_suffix(".forked")
    plugin = Lines(tree, part, children)
    code = pytest.main([*QUIET, str(file)], plugins=[plugin])
    ran = {tuple(x) for x in plugin.found()}
    for answer in children.glob("*.json"):
        ran |= {tuple(x) for x in json.loads(answer.read_text())}
    shutil.rmtree(children)
    lines: dict[str, dict[str, list[int]]] = {}
    for test, name, line in sorted(ran):
        if test in plugin.passed:
            lines.setdefault(test, {}).setdefault(name, []).append(line)
    test_lines = {t: {"s": plugin.seconds[t], "lines": v} for t, v in lines.items()}
    stored_values.write_text(json.dumps(test_lines))
    return int(code)


QUIET = [
    "-n",
    "0",
    "-p",
    "no:cacheprovider",
    "--no-header",
    "--tb=line",
    "-W",
    "ignore",
]


def wait_for(pid: int, seconds: float) -> int | None:
    """How a forked child ended; None where it did not for so long, and was killed with
    its group, as it is where this process is told to end."""
    until = time.time() + seconds
    try:
        while time.time() < until:
            ended_pid, status = os.waitpid(pid, os.WNOHANG)
            if ended_pid:
                pid = 0
                return os.waitstatus_to_exitcode(status)
            time.sleep(0.02)
        return None
    finally:
        if pid:
            with suppress(ProcessLookupError):
                os.killpg(pid, signal.SIGKILL)
            os.waitpid(pid, 0)


def _quiet(log: Path, seconds: int) -> None:
    """What a forked child does first: a log of its own and a limit of its processor
    time."""
    os.setpgid(0, 0)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    out = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(out, 1)
    os.dup2(out, 2)
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))


# --- the sample -----------------------------------------------------------------------


def places_of(text: str) -> list[tuple[str, int, int]]:
    """Name, first and last line of the functions and of the constants of a module."""
    tree = ast.parse(text)
    places = [(n.name, n) for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)]
    places += [
        (t.id, n)
        for n in tree.body
        if isinstance(n, ast.Assign)
        for t in n.targets
        if isinstance(t, ast.Name)
    ]  # type: ignore[misc]
    return [(name, n.lineno, n.end_lineno or 0) for name, n in places]


def list_mutations(tree: Path, part: Part) -> list[tuple[str, int, str, int]]:
    """All mutations of a part: file, line, operator, which of its places. Raises
    ValueError for a name in `functions` that its file has not: it was renamed."""
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.plugins import get_operator

    for file, names in part.functions.items():
        has = {
            name for name, *_ in places_of((tree / "orchestrator" / file).read_text())
        }
        if missing := set(names) - has:
            raise ValueError(f"{file} has no {', '.join(sorted(missing))}")
    mutations = []
    for path in sorted(p for f in part.folders for p in (tree / f).rglob("*.py")):
        text, file = path.read_text(encoding="utf-8"), str(path.relative_to(tree))
        module_tree = get_ast(text)
        places = places_of(text)
        lines = landed_lines(text, part.release) if part.release else None
        nodes = list(ast_nodes(module_tree))
        for name in OPERATORS:
            operator, k = get_operator(f"core/{name}")(), 0
            for node in nodes:
                for (line, _), _ in operator.mutation_positions(node):
                    counts = lines is None or line in lines
                    if counts and part.has(file, line, places):
                        mutations.append((file, line, name, k))
                    k += 1
    return sorted(mutations)


def draw_sample(tree: Path, part: Part) -> dict[str, Any]:
    """A sample (or all) without those that change nothing, in the order in which it is
    run: so the first of them are a sample, too."""
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator

    every, rng, sample = list_mutations(tree, part), random.Random(SEED), []
    sample_entries = rng.sample(
        every, len(every) if part.sample is None else part.sample
    )
    if part.sample is None:
        sample_entries.sort(key=lambda entry: DECIDES.search(entry[2]) is None)
    for path, line, name, k in sample_entries:
        old = (tree / path).read_text(encoding="utf-8")
        new = mutate_code(old, get_operator(f"core/{name}")(), k)
        try:
            same = new is None or ast.dump(ast.parse(old)) == ast.dump(ast.parse(new))
        except SyntaxError:  # of a ** that is no power
            same = True
        if new is None or same:
            continue
        change = [
            x
            for x in difflib.unified_diff(old.splitlines(), new.splitlines(), n=0)
            if x[0] in "+-" and x[:3] not in ("+++", "---")
        ]
        sample.append(
            {
                "file": path,
                "line": line,
                "operator": name,
                "place": k,
                "was": change[0][1:].strip(),
                "is": change[-1][1:].strip(),
            }
        )
    return {
        "seed": SEED,
        "drawn": len(sample_entries),
        "of": len(every),
        "mutations": sample,
    }


def renew_sample(tree: Path, part: Part, old: dict[str, Any]) -> dict[str, Any]:
    """All drawn anew, of today's code. What was said of a mutation stays: why it
    changes nothing or is open, and the tests that were added for it; where its function
    has not changed, how it ended, too; what lived of what landed runs again."""
    before: dict[str, str] = {}
    for path in sorted(p for f in part.folders for p in (ROOT / f).rglob("*.py")):
        name = str(path.relative_to(ROOT))
        before[name] = (tree / name).read_text() if (tree / name).exists() else ""
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(path, tree / name)
    of = ("file", "operator", "was", "is")
    new, stored_samples = draw_sample(tree, part), {}
    for m in old["mutations"]:
        stored_samples.setdefault(tuple(m[k] for k in of), []).append(m)
    for m in new["mutations"]:
        old_entry = (stored_samples.get(tuple(m[k] for k in of)) or [{}]).pop(0)
        text = (tree / m["file"]).read_text()
        around = [(a, b) for _, a, b in places_of(text) if a <= m["line"] <= b]
        a, b = max(around, default=(1, -1))  # the innermost; else the file
        same = "\n".join(text.split("\n")[a - 1 : b]) in before[m["file"]]
        stays = same and (not part.release or old_entry.get("by"))
        outcome_keys = {"tests", "all", "outcome", "by"} if stays else set()
        stated_keys = {"equivalent", "why", "also", "added"}
        m.update(
            {k: v for k, v in old_entry.items() if k in stated_keys | outcome_keys}
        )
    return {**new, **{k: old[k] for k in ("controls", "date", "versions") if k in old}}


def mutate_text(tree: Path, m: dict[str, Any]) -> str:
    """The file's text with the mutation."""
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator

    old = (tree / m["file"]).read_text(encoding="utf-8")
    return str(mutate_code(old, get_operator(f"core/{m['operator']}")(), m["place"]))


# --- one mutation ---------------------------------------------------------------------


def choose_tests(
    tree: Path,
    part: Part,
    m: dict[str, Any],
    tests: dict[str, Any],
    every: bool,
    kills: Mapping[tuple[str, str], int],
) -> list[str]:
    """The tests that run the mutated statement: first which killed most other mutations
    of its file (`kills` by file and test), then those whose file names its function or
    module, then the quickest; where it is run at import, those that run most of the
    file. Of a condition those that meet it and those that do not in turn."""
    source = (tree / m["file"]).read_text(encoding="utf-8")
    text = ast.parse(source)
    inside, lines, branch_lines = False, {m["line"]}, set[int]()
    for node in ast.walk(text):
        if isinstance(node, ast.stmt) and node.lineno <= m["line"] <= (
            node.end_lineno or 0
        ):
            if isinstance(node, ast.FunctionDef):
                inside = inside or node.lineno < m["line"]
            elif isinstance(node, ast.If) and m["line"] < node.body[0].lineno:
                branch_lines = {
                    n.lineno
                    for x in node.body
                    for n in ast.walk(x)
                    if isinstance(n, ast.stmt)
                }
            elif not isinstance(
                node, ast.ClassDef | ast.If | ast.For | ast.While | ast.With
            ):
                lines = set(range(node.lineno, (node.end_lineno or 0) + 1))
    runs = {t: set(x["lines"].get(m["file"], ())) for t, x in tests.items()}
    names = [
        t
        for t, own_value in runs.items()
        if (own_value & lines if inside else own_value)
    ]
    if not names and not part.empty:  # a process that was killed, or not forked, ran it
        inside, names = False, [t for t, own_value in runs.items() if own_value]
    stem = Path(m["file"].removesuffix("/__init__.py")).stem
    subjects = {
        stem,
        *(name for name, a, b in places_of(source) if a <= m["line"] <= b),
    }
    files = {t.partition("::")[0] for t in names}
    near = {f: len(subjects & _words(tree / f)) for f in files}
    names.sort(
        key=lambda t: (
            -kills.get((m["file"], t), 0),
            -near[t.partition("::")[0]],
            0 if inside else -len(runs[t]),
            tests[t]["s"],
        )
    )
    others = [t for t in names if not runs[t] & branch_lines]
    if branch_lines and others and len(others) < len(names):
        both = ([t for t in names if runs[t] & branch_lines], others)
        names = [t for pair in zip_longest(*both) for t in pair if t]
    out, test_counts, spent = [], {}, 0.0
    for name in names:
        function = name.partition("[")[0]
        test_counts[function] = test_counts.get(function, 0) + 1
        if not every and (
            test_counts[function] > 3 or spent + tests[name]["s"] > BUDGET
        ):
            continue
        spent += tests[name]["s"]
        out.append(name)
    if not every:
        return out[:MOST]
    if not part.empty:
        return out
    module = Path(m["file"]).stem
    module_pattern = re.compile(rf"\b({module}|{module.title().replace('_', '')})\b")
    full = [
        str(file.relative_to(tree))
        for file in find_test_files(tree, part)
        if module_pattern.search(file.read_text(encoding="utf-8"))
    ]
    own_value = [x for x in out if x.partition("::")[0] not in full]
    return [PUBLISHED, *own_value, *full]


@cache
def _words(file: Path) -> set[str]:
    """The words of a file of tests."""
    return set(re.findall(r"\w+", file.read_text(encoding="utf-8")))


PUBLISHED = "tests/fmus/test_fmus.py::test_interfaces_page_is_current"
"""Names, units, defaults and bounds of all variables, as a user reads them."""


def try_tests(
    tree: Path, m: dict[str, Any], names: list[str], log: Path, text: str, limit: int
) -> str:
    """Run tests with a file's text replaced, for so many seconds of processor time
    (twice as many of the clock): killed, survived, or what else."""
    import pytest

    path = tree / m["file"]
    old = path.read_text(encoding="utf-8")
    bytecode_files = list((path.parent / "__pycache__").glob(f"{path.stem}.*.pyc"))
    for file in bytecode_files:
        file.unlink()
    path.write_text(text, encoding="utf-8")
    sys.stdout.flush()
    try:
        if (pid := os.fork()) == 0:
            sys.dont_write_bytecode = True
            os.environ["PYTHONDONTWRITEBYTECODE"] = "1"  # nor what is started from it
            _quiet(log, limit)
            if not replace_text(m, text):
                for name in [
                    n for n in sys.modules if n.partition(".")[0] in ("desat", "tests")
                ]:
                    del sys.modules[name]
            code = int(pytest.main([*QUIET, "-x", *names]))
            sys.stdout.flush()
            os._exit(code)
        status = wait_for(pid, 2.0 * limit)
    finally:
        path.write_text(old, encoding="utf-8")
    if status == 0:
        return "survived"
    if status is None or status < 0:
        return "killed: too long"
    broken = (
        "while loading conftest" in log.read_text()
    )  # the blocks cannot even be imported
    is_killed = status in (1, 2) or (status == 4 and broken)
    return "killed" if is_killed else f"pytest ended with {status}"


def replace_text(m: dict[str, Any], text: str) -> bool:
    """Give the function of a mutation, imported already, the code of the file's text:
    so nothing is imported anew. False where the line is run at import."""
    path = []
    node: Any = ast.parse(text)
    while node is not None:
        substeps = [
            n
            for n in node.body
            if isinstance(n, ast.FunctionDef | ast.ClassDef)
            and n.lineno <= m["line"] <= (n.end_lineno or 0)
        ]
        node = substeps[0] if substeps else None
        path += substeps
        if substeps and isinstance(node, ast.FunctionDef):
            break
    name = m["file"].removeprefix("orchestrator/").removesuffix(".py").replace("/", ".")
    at: Any = sys.modules.get(f"desat.{name.removesuffix('.__init__')}")
    if not path or at is None or isinstance(path[-1], ast.ClassDef):
        return False
    if m["line"] < path[-1].body[0].lineno:
        return False  # a default value
    code = compile(text, at.__file__, "exec", dont_inherit=True)
    for part in path:
        at = vars(at).get(part.name)
        at = next(
            (getattr(at, k) for k in ("fget", "__func__", "func") if hasattr(at, k)), at
        )
        began = min([part.lineno, *(d.lineno for d in part.decorator_list)])
        code = next(
            c for c in code.co_consts if getattr(c, "co_firstlineno", 0) == began
        )
    function = inspect.unwrap(at)
    if getattr(function, "__code__", code).co_firstlineno != code.co_firstlineno:
        return False
    function.__code__ = code
    return True


def judge_mutation(
    tree: Path,
    m: dict[str, Any],
    names: list[str],
    log: Path,
    limit: int,
    ruled_out: dict[tuple[str, str], bool],
) -> tuple[str, str]:
    """How a mutation ended, and the test that killed it. One that fails as well where
    nothing is mutated is ruled out for the file."""
    control = (tree / m["file"]).read_text(encoding="utf-8") + "\nCONTROL = 1\n"
    while True:
        names = [n for n in names if not ruled_out.get((m["file"], n))]
        if not names:
            return "no quick test runs it", ""
        outcome = try_tests(tree, m, names, log, mutate_text(tree, m), limit)
        if outcome != "killed":
            return outcome, ""
        line = failing(log)
        by = max(
            (n for n in names if line.startswith(n) and "::" in n),
            key=len,
            default=line,
        )
        if "::" in by and (m["file"], by) not in ruled_out:
            control_outcome = try_tests(
                tree, m, [by], log.with_name("log.c"), control, limit
            )
            ruled_out[m["file"], by] = control_outcome != "survived"
        if not ruled_out.get((m["file"], by)):
            return outcome, by
        if by not in names:  # of a whole file: without it
            full = by.partition("::")[0]
            if full not in names:
                return f"{by} fails unmutated", ""
            names.remove(full)


def failing(log: Path) -> str:
    """The first test that failed, as pytest's summary names it."""
    summary_line = re.search(
        r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", log.read_text(), re.MULTILINE
    )
    return summary_line[1] if summary_line else "?"


# --- the page -------------------------------------------------------------------------


def score(result: dict[str, Any]) -> dict[str, Any]:
    """How many of a sample ran, are killed, are no mutations, are open; and the score."""
    ran = [m for m in result["mutations"] if "outcome" in m]
    killed_mutations = [m for m in ran if m["outcome"].startswith("killed")]
    equal = [m for m in ran if m.get("equivalent")]
    return {
        "ran": len(ran),
        "killed": len(killed_mutations),
        "equivalent": len(equal),
        "open": [m for m in ran if m not in killed_mutations and m not in equal],
        "slow": sum(m["outcome"] == "killed: too long" for m in ran),
    }


def section(part: Part, result: dict[str, Any]) -> list[str]:
    """The lines of the page about a part."""
    from desat.numbers.statistics import clopper_pearson

    n = score(result)
    real = n["ran"] - n["equivalent"]
    low, high = clopper_pearson(n["killed"], real)
    of = result.get("controls", {})
    added_count = sum(bool(m.get("added")) for m in result["mutations"])
    once = sum(not m.get("all") for m in n["open"])
    places = ", ".join(f"`{f}/`" for f in part.folders)
    order = (
        "the first as drawn"
        if part.sample is not None
        else "comparisons and conditions first"
    )
    sample_text = (
        f"{result['drawn']:,} were drawn at random with seed {result['seed']} of the "
        f"{result['of']:,} mutations of {places}"
        if part.sample is not None
        else f"All {result['of']:,} mutations of the functions that decide them (`VERDICTS` in "
        "`tests/mutations.py`) count"
    )
    if part.sample is not None and part.functions:
        sample_text += (
            ", but for functions that decide a verdict, an exit code or a bound"
        )
    versions = result.get("versions", {}).items()
    message = (
        f" ({', '.join(f'{name} {x}' for name, x in versions)})" if versions else ""
    )
    bare = "FMUs are empty meanwhile, so that no test fails because an FMU is of other code. "
    lines = [
        f"## Of {part.title}",
        "",
        f"{n['killed']} of {real} mutations that change {part.title} are killed: "
        f"{100 * n['killed'] / real:.1f} %"
        + (
            f" (95 % interval {low:.0f} to {high:.0f} %, Clopper-Pearson)."
            if part.sample
            else "."
        ),
        "",
        f"{sample_text}; {len(result['mutations'])} of these change the code, and "
        + (
            f"{n['ran']} of them, {order},"
            if n["ran"] < len(result["mutations"])
            else "all of them"
        )
        + f" ran on {result['date']}{message}. {bare if part.empty else ''}"
        f"{once} of the open ones ran against {MOST} quick tests only, not yet against all. "
        f"{added_count} were not killed by any test and are now, by tests "
        "that were added for them. Controls, the same tests with nothing mutated: "
        f"{sum(v == 'survived' for v in of.values())} of {len(of)} passed"
        + "".join(f"; no. {k}: {v}" for k, v in of.items() if v != "survived")
        + ".",
        "",
        "| folder | ran | killed | no mutation | open |",
        "|---|---|---|---|---|",
    ]
    for folder in sorted({m["file"].split("/")[1] for m in result["mutations"]}):
        own_value = score(
            {
                "mutations": [
                    m for m in result["mutations"] if m["file"].split("/")[1] == folder
                ]
            }
        )
        if own_value["ran"]:
            lines.append(
                f"| {folder} | {own_value['ran']} | {own_value['killed']} | {own_value['equivalent']} "
                f"| {len(own_value['open'])} |"
            )
    for title, inputs in (
        (
            "They change nothing that can be seen",
            [m for m in result["mutations"] if m.get("equivalent")],
        ),
        ("Open", n["open"]),
    ):
        if inputs:
            lines += [
                "",
                f"### {title}",
                "",
                "| place | was | is | why |",
                "|---|---|---|---|",
            ]
        for m in inputs:
            was, new = (m[k].replace("|", "&#124;") for k in ("was", "is"))
            reason = m.get("equivalent") or m.get("why") or m["outcome"]
            place = f"{m['file'].partition('/')[2]} {m['line']}"
            lines.append(f"| {place} | `{was}` | `{new}` | {reason} |")
    return [*lines, ""]


def page(stored_results: Mapping[str, Any]) -> str:
    """docs/mutations.md."""
    lines = [
        "# Mutations",
        "",
        "What the tests do not notice when the code is changed by one of cosmic-ray's operators "
        "(those that hardly any test can miss left out): `tests/mutations.py`, results in "
        f"`build/mutations.json` (not in git). Each mutation ran against at most {MOST} quick "
        "tests that run its line, which was found by coverage (in the processes that it forks, "
        "too), and what these left against all quick tests that run it, "
        "of blocks against the files of tests of its module. A test that fails as well where "
        "nothing is mutated, as it compares hashes of code, kills nothing. Tests that take "
        "long, and those of FMUs and pages, did not run: they can only raise the score. Line "
        "numbers are those of the code that ran.",
        "",
    ]
    for name in (x for x in stored_results if x in PARTS):
        lines += section(PARTS[name], stored_results[name])
    return "\n".join([*lines, NAMED])


NAMED = """## Mutations named before

By hand, each seen to fail a test: the sign of N_con in the plan of the receding horizon; the
repair of the last sample's rounding; how long nozzles have been open before the first sample; the
bounds of the shortest dipole along a line; the cost of time in a plan; the mean square of a lag; a
plan without samples; which field, and which rate, the fallback takes. Tests for equality of shared
parameters, jitter of each wheel, the series of a lag's moments, the field's second derivative, the
fall of the place, `unless` of limits and the on-time of unused coils stand in
`tests/blocks`, `tests/maths` and `tests/physics`; their mutations were not made again.
"""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", choices=PARTS)
    parser.add_argument("seconds", type=float, help="0: only the page")
    parser.add_argument("folder", type=Path)
    parser.add_argument(
        "--all", action="store_true", help="survivors against all that run it"
    )
    parser.add_argument("--anew", action="store_true", help="draw of today's code")
    parser.add_argument(
        "--landed", action="store_true", help="only of what the last release has not"
    )
    arguments = parser.parse_args()
    signal.signal(
        signal.SIGTERM, lambda *_: sys.exit(143)
    )  # the mutated file is put back
    until, folder, name, part = (
        time.time() + arguments.seconds,
        arguments.folder.resolve(),
        arguments.part,
        PARTS[arguments.part],
    )
    if arguments.landed:
        name, part = f"{name} since the last release", restrict_to_new_code(part)
    folder.mkdir(parents=True, exist_ok=True)
    tree = copy_tree(folder, part.empty)
    os.environ["DESAT_CACHE"] = str(folder / "cache")
    os.environ["PYTHONPATH"] = str(tree / ".names")
    os.chdir(tree)
    sys.path[:0] = [str(tree / ".names"), str(tree)]
    _warm()
    result = _read_results().get(name)
    if result is None or arguments.anew:
        result = renew_sample(tree, part, result or {"mutations": []})
    if arguments.seconds and not write_maps(tree, folder, part, until):
        print("which test runs which line is not known yet: call it again")
        return 0
    tests: dict[str, Any] = {}
    for file in sorted(folder.glob("map.*.json")):
        tests.update(json.loads(file.read_text()))
    if arguments.seconds and not part.empty:
        _warm_ours(tree, part)
        gc.freeze()  # a fork need not copy what it would look through
    ruled_out: dict[tuple[str, str], bool] = {}
    kills = Counter((m["file"], m["by"]) for m in result["mutations"] if m.get("by"))
    for k, m in enumerate(result["mutations"]):
        remaining = m.get("outcome", "") in ("survived", "no quick test runs it")
        needs_all = (
            remaining and arguments.all and not (m.get("all") or m.get("equivalent"))
        )
        if time.time() > until or ("outcome" in m and not needs_all):
            continue
        names = [
            *m.get("also", ()),
            *choose_tests(tree, part, m, tests, arguments.all, kills),
        ]
        m["tests"], m["all"] = len(names), arguments.all
        mapped_as = (
            x["s"]
            for t, x in tests.items()
            if t in names or t.partition("[")[0] in names
        )
        limit = int((1 if part.sample is None else 5) * CPU + 3 * sum(mapped_as))
        m["outcome"], m["by"] = judge_mutation(
            tree, m, names, folder / f"log.{k}", limit, ruled_out
        )
        kills[m["file"], m["by"]] += 1
        if names and k % 10 == 0:  # a control: the same tests, nothing mutated
            text = (tree / m["file"]).read_text(encoding="utf-8") + "\nCONTROL = 1\n"
            named_tests = [n for n in names if not ruled_out.get((m["file"], n))]
            outcome = try_tests(tree, m, named_tests, folder / "log.c", text, limit)
            if outcome != "survived":  # by which test, and whether it does so again
                outcome += f" by {failing(folder / 'log.c')}, then "
                outcome += try_tests(
                    tree, m, named_tests, folder / "log.c", text, limit
                )
            result.setdefault("controls", {})[str(k)] = outcome
        result["date"] = f"{datetime.now(UTC):%Y-%m-%d}"
        result["versions"] = _versions()
        STORED.parent.mkdir(exist_ok=True)
        new = STORED.with_suffix(f".{arguments.part}")
        new.write_text(json.dumps({**_read_results(), name: result}, indent=1) + "\n")
        new.replace(STORED)
        print(k, m["file"], m["line"], m["outcome"], m["by"], flush=True)
    if arguments.landed:
        print_living(result)
    elif any("outcome" in m for m in result["mutations"]):
        PAGE.write_text(page(_read_results()), encoding="utf-8")
    return 0


def print_living(result: dict[str, Any]) -> None:
    """Print the mutations that no test has killed, and how many ran."""
    n = score(result)
    for m in n["open"]:
        print(f"{m['file']} {m['line']}: {m['was']} -> {m['is']}: {m['outcome']}")
    drawn_count = len(result["mutations"])
    print(f"{n['ran']} of {drawn_count} ran, {n['killed']} are killed")


def _versions() -> dict[str, str]:
    """Of what mutates and tests."""
    names = ("cosmic-ray", "coverage", "pytest")
    return {
        "python": platform.python_version(),
        **{n: metadata.version(n) for n in names},
    }


def _read_results() -> dict[str, Any]:
    """Results by part; other parts may run meanwhile."""
    return dict(json.loads(STORED.read_text())) if STORED.exists() else {}


def _warm() -> None:
    """Import once what is not ours: children are forks."""
    for name in (
        "fmpy",
        "h5py",
        "hypothesis",
        "jinja2",
        "lxml.etree",
        "matplotlib.figure",
        "numpy.testing",
        "pydantic",
        "pytest",
        "rich.progress",
        "scipy.integrate",
        "scipy.linalg",
        "scipy.optimize",
        "scipy.spatial.transform",
        "scipy.special",
        "xarray",
    ):
        importlib.import_module(name)


def _warm_ours(tree: Path, part: Part) -> None:
    """Import the orchestrator and its tests, whose assertions need no rewriting."""
    for path in sorted(p for f in part.folders for p in (tree / f).rglob("*.py")):
        name = (
            str(path.relative_to(tree / "orchestrator"))
            .removesuffix(".py")
            .replace("/", ".")
        )
        importlib.import_module(f"desat.{name.removesuffix('.__init__')}")
    for path in find_test_files(tree, part):
        name = ".".join(path.relative_to(tree).with_suffix("").parts)
        importlib.import_module(name)


if __name__ == "__main__":
    raise SystemExit(main())
