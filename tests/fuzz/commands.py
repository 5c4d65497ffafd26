"""Fuzzing of the command line: options with strange values never give a bug (exit code
3), never a code that the README does not have, and never a craft with a number that is
not finite.

Each input is a command line of SEEDS with one to three changes: a value replaced, an
option left out, doubled or taken from another line of the command. It runs through the
real functions, in this process, in a folder of its own; no value names a place outside
of it.
"""

from __future__ import annotations

import contextlib
import io
import os
import random
import re
import shlex
import signal
import sys
import time
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from desat import cli
from desat.system.errors import Exit
from tests.fuzz import tree
from tests.fuzz.mutations import STRANGE

LONGEST = 20
"""Wall time (s) after which an input is interrupted as by Ctrl-C."""
CODES = {int(code) for code in Exit} - {int(Exit.BUG)}
TLE = """1 25544U 98067A   19343.69339541  .00001764  00000-0  38792-4 0  9991
2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482
"""
FLIGHT = "--blocks --stop 3 --step 1 --substeps 1"
WRITTEN = (
    "new craft made --force --altitude 400km --inclination 51.6deg --size 12U --rods 0.2",
    "new craft made --force --sso 500km --ltan 10:30 --mass 16kg --box 0.2,0.2,0.4 "
    "--inertia 0.2,0.2,0.1 --wheels '4 pyramid 30mNms' --thrusters '4 1N' --pointing inertial",
    "new craft made --force --tle iss.tle --epoch 2019-12-10T00:00:00Z --residual-dipole 0.05",
    "new law made_law --force",
    "new block magnetometer made_block --force",
    "size nowhere --duty 50 --margin 1.3 --slew 60/300 --tip-off 5 --arm 0.2 --isp 60",
    "size nowhere --map --rods 0.1,0.2 --inclinations 10 --altitudes 400 --dipoles 0.1",
    "tune nowhere manager.gain --for peak --between 1e-4,1e-2 -n 1 --unseen 1",
    "export c magnetometer --out c --compiler 'false -O0'",
    "export run nowhere --format csv --out exported",
    "export fmu nowhere --platforms linux64 --fmi 2 --stop 3 --step 1 --out made.fmu",
    f"run nowhere --checkpoint 1 --call-limit 9 --time-limit 9 --accuracy 1e-7 {FLIGHT}",
    "check mine",
    "show mine",
    "show mine --diagram --out made.svg",
    "show mine --sketch",
    "help page predictive law",
    "help keys",
    "help blocks magnetometer",
    f"sweep nowhere manager.gain=1e-3,2e-3 --samples 1 --seed 1 --jobs 1 {FLIGHT}",
    f"compare nowhere other -n 1 --seed 1 --jobs 1 {FLIGHT}",
    f"campaign nowhere -n 1 --seed 1 --accuracy 1e-7 --case-limit 9 --jobs 1 {FLIGHT}",
    "campaign nowhere -n 1 --sampling random --keep every:1 --case-limit 10",
)
QUICK = (*WRITTEN, *tree.generate_lines("nowhere"))
"""What ends at once: `nowhere` is no scenario, which is seen when the options have been
read."""
WITH_FLIGHTS = (
    "check",
    "show",
    "run",
    "compare",
    "sweep",
    "size",
    "tune",
    "campaign run",
    "export fmu",
)
SLOW = (
    *tree.generate_lines("mine", with_flights=True, only=WITH_FLIGHTS),
    f"run mine --checkpoint 1 --call-limit 9 --time-limit 9 --accuracy 1e-7 {FLIGHT}",
    f"campaign mine -n 1 --seed 1 --jobs 1 {FLIGHT}",
    f"sweep mine manager.gain=1e-3,2e-3 --jobs 1 {FLIGHT}",
    f"compare mine mine --jobs 1 {FLIGHT}",
    "size mine --own-law --no-year --no-loop --duty 50 --margin 1.3 --slew 60/300 --tip-off 5 "
    "--arm 0.2 --isp 60",
    "size mine --map --jobs 1 --rods 0.1 --inclinations 10 --altitudes 400 --dipoles 0.1",
    f"tune mine manager.gain --for peak --between 1e-4,1e-2 -n 1 --unseen 1 --jobs 1 {FLIGHT}",
    "campaign mine -n 1 --jobs 1 --blocks --stop 3 --out made_campaign",
    "export c magnetometer --out c",
    "export fmu mine --platforms linux64 --out made.fmu",
)
VALUES = (
    "inf",
    "-inf",
    "nan",
    "1e309",
    "-1e309",
    "1e300",
    "-1e300",
    "1e-320",
    "0",
    "-0.0",
    "-1",
    "4",
    "1e9",
    "10deg",
    "4 km",
    "1 %",
    "1,2",
    "1,2,3",
    "1,,2",
    "a,b",
    "60/0",
    "1/1/1",
    "9:99",
    "'",
    "12U",
    "3 axes 1e309",
    "3 axes 1 N.m.s",
    "4 1e309N",
    "1e309Nms",
    "1 s",
    "5 kg m2",
    "x=y",
    "2027-01-01",
    "1800-01-01T00:00:00Z",
    "9999-12-31T23:59:59Z",
    "2027-01-01T00:00:00+23:59",
    *(
        x.decode(errors="surrogateescape")
        for x in STRANGE
        if b"/" not in x and b".." not in x and b"\0" not in x
    ),
)
NOT_VARIED = {"--jobs", "--out", "--into", "--html", "--force", "--blocks"}
"""What stays as it is: it says how much of the machine is taken, and where files go."""


def lines(seed: int, count: int, seeds: Sequence[str] = QUICK) -> Iterator[list[str]]:
    """Command lines: first the seeds, then `count` changed ones."""
    yield from map(shlex.split, seeds)
    rng = random.Random(seed)
    for _ in range(count):
        result = shlex.split(rng.choice(seeds))
        for _ in range(rng.choice((1, 1, 2, 3))):
            result = _change_line(result, rng, seeds)
        yield result


def _change_line(
    line: list[str], rng: random.Random, seeds: Sequence[str]
) -> list[str]:
    at = [
        i
        for i, x in enumerate(line)
        if i > 1 and x.startswith("-") and x not in NOT_VARIED and i + 1 < len(line)
    ]
    way = rng.randrange(6)
    if way < 3 and at:
        i = rng.choice(at)
        return [*line[: i + 1], rng.choice(VALUES), *line[i + 2 :]]
    if way == 3 and at:
        i = rng.choice(at)
        return line[:i] + line[i + 2 :]
    if way == 4:
        others = [shlex.split(x) for x in seeds if x.split()[0] == line[0]]
        other = rng.choice(others)
        places = [
            i for i, x in enumerate(other) if x.startswith("--") and i + 1 < len(other)
        ]
        if places:
            i = rng.choice(places)
            return [*line, *(x for x in other[i : i + 2] if x not in NOT_VARIED)]
    return line


def prepare(folder: Path) -> None:
    """The files that command lines name."""
    (folder / "iss.tle").write_text(TLE, encoding="utf-8")
    (folder / "torque.csv").write_text("0,1e-6,0,0\n100,0,1e-6,0\n", encoding="utf-8")
    (folder / "trusted.txt").write_text(f"{64 * 'a'}  a.fmu\n", encoding="utf-8")
    code, message = run_line(
        ["new", "craft", "mine", "--size", "3U", "--altitude", "400km"], folder
    )
    assert code == 0, message


def _interrupt(number: int, frame: Any) -> None:
    raise KeyboardInterrupt


def run_line(line: Sequence[str], folder: Path) -> tuple[int, str]:
    """The exit code of a command line in a folder, and all that it says."""
    message, before = io.StringIO(), (os.getcwd(), sys.argv)
    handler = signal.signal(signal.SIGALRM, _interrupt)
    os.chdir(folder)
    sys.argv = ["desat", *line]
    signal.alarm(LONGEST)
    try:
        with contextlib.redirect_stdout(message), contextlib.redirect_stderr(message):
            code = int(cli._code())
    except BaseException as error:
        return int(Exit.BUG), f"{type(error).__name__}: {error}"
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, handler)
        sys.argv = before[1]
        os.chdir(before[0])
    return code, message.getvalue()


def wrong(line: Sequence[str], folder: Path) -> str:
    """What is wrong with how a command line ends; nothing where it is right."""
    began = time.monotonic()
    code, message = run_line(line, folder)
    if code not in CODES:
        return f"exit {code}: {message.strip()[-300:]}"
    if "Traceback" in message:
        return f"a traceback: {message.strip()[-300:]}"
    if code == Exit.INPUT and not re.search(r"^(error:|Usage:)", message, re.M):
        return f"exit 2 without a line: {message.strip()[-300:]}"
    if time.monotonic() - began > 3.0 * LONGEST:
        return "it cannot be interrupted"
    if code == 0:
        return _not_finite(folder / "made")
    return ""


def _not_finite(folder: Path) -> str:
    """The first number of a craft's files that is not finite, or a file that is not
    TOML."""
    for path in folder.glob("*.toml"):
        try:
            todo: list[Any] = [tomllib.loads(path.read_text(encoding="utf-8"))]
        except ValueError as error:
            return f"{path.name}: {error}"
        while todo:
            value = todo.pop()
            if isinstance(value, (dict, list)):
                todo += value.values() if isinstance(value, dict) else value
            text = str(value) if isinstance(value, (float, str)) else ""
            if re.match(r"[+-]?(inf|nan)\b", text):
                return f"{path.name}: {text}"
    return ""


def run(
    folder: Path, seed: int, count: int, seeds: Sequence[str] = QUICK
) -> tuple[int, list[str]]:
    """Try command lines in a folder that is there; how many, and what is wrong."""
    prepare(folder)
    faults, line_count = [], 0
    outside = set(folder.parent.iterdir())
    for line in lines(seed, count, seeds):
        line_count += 1
        if reason := wrong(line, folder):
            faults.append(f"{shlex.join(line)}: {reason}")
    faults += [f"a file outside: {p}" for p in set(folder.parent.iterdir()) - outside]
    return line_count, faults
