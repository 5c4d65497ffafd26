"""Fuzzing of all readers: mutated files never give a traceback, and never take long.

A mutator of our own, for what is read is five formats within each other (an archive of
XML, JSON and archives of XML; TOML) and CI gives it seconds: each input is one seed
file with one to four mutations, of its bytes, its quoted values, its lines, its JSON or
its archive. The same seed gives the same inputs. What fails is kept in `corpus/`, and
tried first from then on.
"""

from __future__ import annotations

import hashlib
import inspect
import io
import random
import sys
import time
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import CodeType

from desat.files import io as reading
from desat.files import library
from desat.runs.prepare import prepare
from desat.system.errors import DesatError
from desat.system.options import Options
from tests.fuzz.mutations import mutate
from tests.fuzz.seeds import BARE, FILES, TARGETS, library_of_ours, plain_kind, seeds

LONGEST = 5.0
"""CPU time (s) that an input may take."""
TRACED = 40
CORPUS = Path(__file__).parent / "corpus"
READERS = Path(sys.modules["desat.files.library"].__file__).parent


@dataclass
class Outcome:
    """What came of so many inputs."""

    count: int = 0
    refused: int = 0
    failures: list[str] = field(default_factory=list)
    lines: set[tuple[str, int]] = field(default_factory=set)
    """Lines of the readers that were run, of those inputs that were traced."""

    def __str__(self) -> str:
        there = sum(len(_lines(name)) for name in {name for name, _ in self.lines})
        return (
            f"{self.count} inputs, {self.refused} refused, {len(self.failures)} failed; "
            f"{len(self.lines)} of the {there} lines of the readers' functions reached by each "
            f"{TRACED}th input"
        )


@cache
def _lines(file: str) -> set[int]:
    """The lines of a file's functions."""
    todo, numbers = (
        [compile(Path(file).read_text(encoding="utf-8"), file, "exec")],
        set[int](),
    )
    for code in todo:
        todo += [x for x in code.co_consts if isinstance(x, CodeType)]
        if (
            code.co_flags & inspect.CO_OPTIMIZED
        ):  # of a function, neither a module's nor a class's
            numbers |= {
                n for *_, n in code.co_lines() if n and n != code.co_firstlineno
            }
    return numbers


def inputs(seed: int, count: int) -> Iterator[tuple[str, bytes]]:
    """Kind and bytes of inputs: first those kept, then `count` mutated ones."""
    for path in sorted(CORPUS.glob("*.*")):
        yield path.suffix[1:], path.read_bytes()
    rng, seed_inputs = random.Random(seed), seeds()
    for _ in range(count):
        kind = rng.choice(list(seed_inputs))
        yield kind, mutate(plain_kind(kind), seed_inputs[kind], rng)


def run(folder: Path, seed: int, count: int) -> Outcome:
    """Try inputs in a folder; each TRACED-th is traced for the lines it reaches."""
    outcome = Outcome()
    for file, data in FILES.items():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_bytes(data())
    (folder / "outside.ssv").write_bytes(b"<x/>")
    for kind, (
        target,
        file,
    ) in TARGETS.items():  # unchanged, all are right; and nothing is cold
        (folder / file).write_bytes(_wrap_input(kind, seeds()[kind]))
        prepare(str(folder / target), _options(kind)).or_raise()
    before = set(folder.parent.iterdir())
    for number, (kind, data) in enumerate(inputs(seed, count)):
        message = _one(folder, kind, data, outcome if number % TRACED == 0 else None)
        outcome.count += 1
        outcome.refused += message == "refused"
        if message not in ("", "refused"):
            name = f"{kind}-{hashlib.sha256(data).hexdigest()[:12]}.{kind}"
            outcome.failures.append(f"{name}: {message}")
            CORPUS.mkdir(exist_ok=True)
            (CORPUS / name).write_bytes(data)
    outside = set(folder.parent.iterdir()) - before
    outcome.failures += [f"a file outside: {p}" for p in outside]
    return outcome


def _one(folder: Path, kind: str, data: bytes, coverage: Outcome | None) -> str:
    """Read one input: `refused`, what is wrong, or nothing."""
    target, file = TARGETS[kind]
    (folder / file).write_bytes(_wrap_input(kind, data))
    reading._extracted = 0  # the budget is a process's, and this is one for each
    began = time.process_time()
    if coverage is not None:
        sys.settrace(_tracer(coverage.lines))
    try:
        message = (
            "refused" if prepare(str(folder / target), _options(kind)).problems else ""
        )
    except DesatError as error:
        message = "refused" if str(error) else "no message"
    except Exception as error:  # what the fuzzer is for
        message = f"{type(error).__name__}: {error}"
    finally:
        sys.settrace(None)
        library._by_contents.clear()
        (folder / file).write_bytes(FILES[file]() if file in FILES else b"")
    took = time.process_time() - began
    return message if took < LONGEST else f"took {took:.1f} s of CPU"


def _options(kind: str) -> Options:
    if kind.endswith(BARE):
        return Options()
    theirs = kind in ("fmu", "ssp") or kind.startswith("xml")
    return Options(step=1.0, stop=2.0, blocks=not theirs)


def _wrap_input(kind: str, data: bytes) -> bytes:
    """The file with an input: a model description, of any FMI, is within an archive."""
    if not kind.startswith("xml"):
        return data
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("modelDescription.xml", data)
        for folder in ("linux64", "x86_64-linux"):  # of FMI 1.0 and 2.0, of FMI 3.0
            archive.writestr(f"binaries/{folder}/theirs.so", library_of_ours())
    return buffer.getvalue()


def _tracer(lines: set[tuple[str, int]]):
    def of_line(frame, event, argument):
        if event == "line":
            lines.add((frame.f_code.co_filename, frame.f_lineno))
        return of_line

    def of_call(frame, event, argument):
        return of_line if frame.f_code.co_filename.startswith(str(READERS)) else None

    return of_call
