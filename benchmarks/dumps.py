"""docs/sizing-thrusters.md: crafts of seventeen kinds, drawn by a seed, what `desat size`
says of each beside its closed loop.

python -m benchmarks.dumps [--seed N]
"""

from __future__ import annotations

import argparse
import json
import math
import os
import random
import resource
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parents[1] / "docs"
TEXT = Path(__file__).with_name("dumps.md")
EACH = 3
"""Crafts of a kind."""
BAR = 0.05
"""Of a size beside its closed loop."""


def _box(r: random.Random, a: tuple[float, float], b: tuple[float, float]) -> str:
    return f"{r.uniform(*a):.2f},{r.uniform(*a):.2f},{r.uniform(*b):.2f}"


def _wings(
    r: random.Random, areas: tuple[float, float], arms: tuple[float, float]
) -> list[str]:
    """One wing or a pair, turned to the Sun or fixed, of areas (m2) at arms (m)."""
    wing = f"{r.uniform(*areas):.2f}m2 {r.uniform(*arms):.2f}m"
    pair, fixed = r.choice(["2 x ", ""]), r.choice(["", "", " fixed +z"])
    return ["--wings", f"{pair}{wing} {r.choice('xy')}{fixed}"]


def _middle(r: random.Random, dump: str = "thrusters 70:10") -> str:
    """A craft of 300 to 1,200 kg with thrusters and two wings, without its place."""
    u = r.uniform
    sides = _box(r, (1.0, 1.5), (1.4, 2.2))
    return (
        f"--mass {u(300, 1200):.0f}kg --box {sides} --wings '2 x {u(2, 6):.1f}m2 "
        f"{u(1.8, 2.6):.1f}m' --rods none --wheels '{r.choice([4, 5, 6])} pyramid 4Nms' "
        f"--thrusters '{r.choice(['4 1N', '8 1N', '12 1N'])}' --dump '{dump}'"
    )


def _nano(r: random.Random) -> str:
    """A 12U with rods in a low orbit, without its wheels and attitude."""
    return (
        f"--size 12U --altitude {r.uniform(420, 650):.0f}km --inclination "
        f"{r.uniform(40, 97):.1f}deg --rods 0.5"
    )


def _target(r: random.Random) -> str:
    """A target that the orbit of `_nano` passes."""
    return f"target {r.uniform(5, 38):.1f}N {r.uniform(0, 170):.1f}E"


FORMS = {
    "GEO, nozzles": lambda r: (
        f"--orbit geo {_middle(r).replace('4Nms', '12Nms')} --secular "
        f"{r.uniform(10, 40):.0f}uNm,{r.uniform(10, 40):.0f}uNm,{r.uniform(5, 20):.0f}uNm"
    ),
    "Moon": lambda r: (
        f"--orbit 'moon {r.uniform(80, 300):.0f}km' --pointing 'nadir "
        f"{r.uniform(3, 15):.1f}deg {r.choice(['pitch', 'roll'])}' {_middle(r)}"
    ),
    "Mars": lambda r: (
        f"--orbit 'mars {r.uniform(250, 500):.0f}x{r.uniform(500, 2000):.0f}km' "
        f"--pointing 'nadir {r.uniform(3, 15):.1f}deg pitch' {_middle(r)}"
    ),
    "L1 and L2": lambda r: f"--sun {r.choice(['L1', 'L2'])} {_middle(r)}",
    "12U, wheels by number": lambda r: (
        f"{_nano(r)} --wheels '{r.choice([3, 5, 6, 8])} "
        f"{r.choice(['pyramid', 'axes'])} 40mNms'"
    ),
    "12U, six wheels with a bias": lambda r: (
        f"{_nano(r)} --wheels '6 pyramid 40mNms' --bias {r.uniform(3, 12):.0f}mNms"
    ),
    "12U, spin": lambda r: (
        f"{_nano(r)} --pointing 'spin {r.uniform(0.05, 1.0):.2f}rpm {r.choice('xz')}'"
    ),
    "12U, rods and thrusters": lambda r: (
        f"{_nano(r).replace('--rods 0.5', '')} --rods {r.uniform(1, 6):.1f}mAm2 "
        f"--residual-dipole 0.1Am2 --thrusters '4 10mN' --dump 'both 70:10'"
    ),
    "12U, target": lambda r: f"{_nano(r)} --pointing '{_target(r)}'",
}
"""Kinds of docs/forms.md: the options of `desat new craft` as text."""


def facts(kind: str, r: random.Random) -> list[str]:
    """The options of `desat new craft` of a craft of a kind."""
    u = r.uniform
    dump = f"thrusters {r.choice([60, 70, 80])}:{r.choice([10, 20])}"
    if kind == "3U, Sun-synchronous":
        return [
            "--size",
            "3U",
            "--sso",
            f"{u(450, 700):.0f}km",
            "--ltan",
            r.choice(["06:00", "10:30", "13:30", "22:00"]),
        ]
    if kind == "12U":
        return [
            "--size",
            "12U",
            "--altitude",
            f"{u(400, 700):.0f}km",
            "--inclination",
            f"{u(35, 97):.1f}deg",
            "--mass",
            f"{u(14, 24):.1f}kg",
        ]
    if kind == "150 kg":
        return [
            "--mass",
            f"{u(100, 200):.0f}kg",
            "--box",
            _box(r, (0.6, 0.9), (0.8, 1.3)),
            "--sso",
            f"{u(500, 800):.0f}km",
            "--wheels",
            r.choice(["4 pyramid 4Nms", "3 axes 4Nms", "4 pyramid 1Nms"]),
        ]
    if kind == "6U to the Sun":
        return [
            "--size",
            "6U",
            "--altitude",
            f"{u(450, 700):.0f}km",
            "--inclination",
            f"{u(30, 98):.1f}deg",
            "--pointing",
            "sun",
        ]
    if kind == "GEO":
        return [
            "--orbit",
            "geo",
            "--mass",
            f"{u(1500, 4000):.0f}kg",
            "--box",
            _box(r, (2.0, 3.0), (2.5, 4.0)),
            "--wheels",
            r.choice(["4 pyramid 50Nms", "3 axes 50Nms", "4 pyramid 15Nms"]),
            "--rods",
            "none",
            "--thrusters",
            "4 10N",
            "--dump",
            dump,
            *_wings(r, (8, 30), (2.5, 5.0)),
            "--dish",
            f"{u(0.8, 2.0):.1f}m {r.choice(['+x', '-x'])} {u(1.6, 2.5):.1f}m",
            "--epoch",
            f"2027-{r.randint(1, 12):02d}-15",
        ]
    if kind == "GTO":
        return [
            "--orbit",
            r.choice(["gto", "300x35786km"]),
            "--mass",
            f"{u(300, 900):.0f}kg",
            "--box",
            _box(r, (1.0, 1.6), (1.2, 2.0)),
            "--wheels",
            r.choice(["3 axes 4Nms", "4 pyramid 4Nms"]),
            "--rods",
            "none",
            "--thrusters",
            "4 1N",
            "--dump",
            dump,
        ]
    if kind == "Molniya":
        return [
            "--orbit",
            r.choice(["molniya", "600x39800km"]),
            "--mass",
            f"{u(200, 1500):.0f}kg",
            "--box",
            _box(r, (1.0, 1.8), (1.2, 2.5)),
            "--wheels",
            r.choice(["4 pyramid 4Nms", "3 axes 4Nms"]),
            "--rods",
            "none",
            "--thrusters",
            r.choice(["4 1N", "4 10N"]),
            "--dump",
            dump,
            *_wings(r, (4, 10), (1.2, 2.5)),
        ]
    if kind in FORMS:
        return shlex.split(FORMS[kind](r))
    sun, pointing = u(0.7, 1.6), r.choice(["sun", "inertial"])
    kg_per_unit, units = u(1.1, 2.0), r.choice([6, 12, 16])  # as CubeSats are flown
    return [
        "--sun",
        f"{sun:.2f}AU",
        "--pointing",
        pointing,
        "--mass",
        f"{kg_per_unit * units:.0f}kg",
        "--size",
        f"{units}U",
        "--wheels",
        r.choice(["3 axes 10mNms", "4 pyramid 15mNms", "3 axes 15mNms"]),
        "--thrusters",
        r.choice(["4 10mN", "4 50mN"]),
        "--dump",
        dump,
        *_wings(r, (0.1, 0.4), (0.25, 0.5)),
    ]


KINDS = (
    "3U, Sun-synchronous",
    "12U",
    "150 kg",
    "6U to the Sun",
    "GEO",
    "GTO",
    "Molniya",
    "deep space",
    *FORMS,
)


def drawn(seed: int) -> list[tuple[str, list[str]]]:
    """Kind and options of each craft."""
    results = []
    for kind in KINDS:
        r = random.Random(f"{seed} {kind}")
        results += [(kind, facts(kind, r)) for _ in range(EACH)]
    return results


def sized(options: Sequence[str]) -> tuple[dict[str, Any], float]:
    """What `desat size --json` says of a craft, and the CPU seconds of the command.
    Raises SystemExit where it cannot."""
    desat = [sys.executable, "-m", "desat.cli"]
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile("w+") as log:
        new_craft = subprocess.run(
            [*desat, "new", "craft", "mine", *options],
            cwd=folder,
            text=True,
            capture_output=True,
            check=False,
        )
        if new_craft.returncode:
            raise SystemExit(f"{shlex.join(options)}: {new_craft.stderr[-2000:]}")
        process = subprocess.Popen(
            [*desat, "size", "mine", "--json"],
            cwd=folder,
            text=True,
            stdout=subprocess.PIPE,
            stderr=log,
        )
        assert process.stdout is not None
        answer = process.stdout.read()
        process.stdout.close()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode > 1:
            log.seek(0)
            raise SystemExit(f"{shlex.join(options)}: {log.read()[-2000:]}")
        return json.loads(answer), usage.ru_utime + usage.ru_stime


def compare(message: dict[str, Any]) -> dict[str, tuple[float, float]]:
    """Name -> size and closed loop."""
    if "steady" in message:
        loop, steady = message["loop"], message["within"] or message["steady"]
        if not loop.get("dumps_a_week"):
            return {}
        return {
            "dumps a week": (steady["a_week"], loop["dumps_a_week"]),
            "kg a year": (steady["a_year"], loop["propellant_a_year"]),
        }
    rows = [
        r
        for r in message["curve"]
        if r["loop_rms"] is not None and r["rms"] is not None
    ]
    row = max(rows, key=lambda r: r["rod"])
    return {
        "rms, mN m s": (1e3 * row["rms"], 1e3 * row["loop_rms"]),
        "duty, %": (100.0 * row["duty"], 100.0 * row["loop_duty"]),
    }


def cells(pairs: dict[str, tuple[float, float]]) -> list[str]:
    """Of a row of the table."""
    if not pairs:
        return ["no dump", "", ""]
    shown = [
        f"{name}: {a:.4g}, {b:.4g} ({100.0 * (a / b - 1.0):+.1f} %)"
        for name, (a, b) in pairs.items()
    ]
    worst = max(abs(a / b - 1.0) for a, b in pairs.values())
    return [*shown, "yes" if worst <= BAR else "**no**"]


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=3)
    seed = parser.parse_args(arguments).seed
    crafts = drawn(seed)
    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(lambda craft: sized(craft[1]), crafts))
    rows, held, none = [], 0, 0
    for (kind, options), (answer, cpu) in zip(crafts, found, strict=True):
        pairs = compare(answer)
        result = cells(pairs)
        held += result[-1] == "yes"
        none += not pairs
        dumps = answer["loop"].get("dumps") if "steady" in answer else None
        count = "" if dumps is None else f"{dumps:.0f}"
        row = [
            kind,
            shlex.join(options),
            *result[:2],
            count,
            result[2],
            "; ".join(answer["problems"]),
        ]
        rows.append(f"| {' | '.join(row)} | {cpu:.0f} |")
    text = TEXT.read_text(encoding="utf-8").format(
        date=datetime.now(UTC).date(),
        version=version("desat"),
        seed=seed,
        held=held,
        of=len(crafts) - none,
        none=none,
        rows="\n".join(rows),
        bar=f"{100.0 * BAR:g}",
        most=math.ceil(max(cpu for _, cpu in found)),
    )
    (DOCS / "sizing-thrusters.md").write_text(text, encoding="utf-8")
    print(f"{held} of {len(crafts) - none} within {100.0 * BAR:g} %")
    return 0


if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    sys.exit(main())
