"""`make builds`: native FMUs of a second compiler, and under sanitizers, beside the
usual ones.

`python tests/builds.py windows` runs one block's libraries for Linux and Windows beside
each other. `python tests/builds.py zig` or `sanitizers` builds all of them into a
temporary folder. Each block, its Python FMU, its usual native FMU and the other one get
the inputs of tests/fmus/test_native.py, and one scenario of each family runs its first 600 steps
with both builds: all bits must be equal. zig needs the package ziglang; under
sanitizers the first complaint ends the process. With names of scenarios only these and
their blocks are tried.
"""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from desat.engine import compiled
from desat.files import paths
from desat.fmus import native
from desat.fmus.compiler import compiler
from desat.runs.run import Options, execute, prepare
from tests.fmus import test_native, test_platforms

SCENARIOS = (
    "nadir_day/day-igrf",
    "integrated/mil-nadir",
    "uosat12/flight-receding_horizon-1",
    "alsat1/firing-ours",
    "hausat2/start-up-ours",
    "gyrostat/stress",
    "plant/light",
    "space_telescope/preview-nominal",
)
"""One of each family."""
SEEDS = 10
SANE = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
ZIG = f"{sys.executable} -m ziglang cc -fno-sanitize=undefined"


def prepare_build(kind: str) -> None:
    """Set the compiler and its flags; start anew where the environment has to be
    another."""
    if kind == "zig":
        if "CC" not in os.environ and importlib.util.find_spec("ziglang") is None:
            raise SystemExit(
                "the package ziglang is not installed, and CC names no compiler"
            )
        os.environ.setdefault("CC", ZIG)
        compiler.cache_clear()
        return
    process = subprocess.run(
        [*compiler(), "-print-file-name=libasan.so"],
        capture_output=True,
        text=True,
        check=True,
    )
    if "LD_PRELOAD" not in os.environ:
        options = {
            "LD_PRELOAD": process.stdout.strip(),
            "ASAN_OPTIONS": "detect_leaks=0",
            "UBSAN_OPTIONS": "print_stacktrace=1",
        }
        os.execve(
            sys.executable, [sys.executable, *sys.argv], {**os.environ, **options}
        )
    native.FLAGS = (*native.FLAGS, "-g", "-w", *SANE)
    native.HERE_ALONE = replace(native.HERE_ALONE, link=("-shared", *SANE))
    compiled.FLAGS = (*compiled.FLAGS, *SANE)


def blocks_of(scenarios: Sequence[str]) -> tuple[str, ...]:
    """The native blocks of scenarios; all where none is named."""
    systems = [prepare(name, Options()).or_raise()[0] for name in scenarios]
    used = {c.fmu.path.stem for s in systems for c in s.components.values() if c.fmu}
    return tuple(n for n in test_native.NATIVE if not scenarios or n in used)


def build_all(names: Sequence[str], folder: Path) -> None:
    """Native FMUs of blocks below a folder."""
    with tempfile.TemporaryDirectory() as shared:
        here = (native.HERE_ALONE,)
        native.compile_wrapper(Path(shared), here)
        for name in names:
            native.build(name, folder / "native", Path(shared), here)
    print(f"{len(names)} built by {' '.join(compiler())}", flush=True)


def same_run(scenario: str, folder: Path) -> int:
    """Series of the first 600 steps, equal in every bit with both builds; their number."""
    step = prepare(scenario, Options()).or_raise()[0].step
    assert step is not None
    usual, series, hashes = paths.fmus, [], []
    for dist in (usual(), folder):
        paths.fmus = lambda dist=dist: dist
        run = execute(scenario, Options(stop=600 * step, fmus="native"))
        names = run.results.names()
        series.append({name: run.results.values(name).tobytes() for name in names})
        hashes.append({c["sha256"] for c in run.manifest["fmus"].values()})
    paths.fmus = usual
    if hashes[0] == hashes[1]:
        raise SystemExit(f"{scenario}: both runs took the same FMUs")
    different = [name for name in series[0] if series[0][name] != series[1].get(name)]
    if different or not series[0]:
        raise SystemExit(f"{scenario}: {', '.join(different) or 'no series'} differ")
    return len(series[0])


def main(kind: str, *scenarios: str) -> int:
    """Build, compare, and say how much was compared."""
    if kind == "windows":
        with tempfile.TemporaryDirectory() as temporary:
            print(
                test_platforms.same_bits_for_linux_and_windows(Path(temporary)),
                flush=True,
            )
        return 0
    prepare_build(kind)
    names = blocks_of(scenarios)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        build_all(names, folder)
        for path in paths.fmus().glob("*.fmu"):
            (folder / path.name).symlink_to(path)
        usual = test_native.path

        def path(name: str, variant: str = "native") -> Path:
            return (
                folder / "native" / f"{name}.fmu"
                if variant == kind
                else usual(name, variant)
            )

        test_native.path = path
        test_native.KINDS.append(kind)
        alike = (
            test_native.test_block_and_both_fmus_are_bitwise_alike.hypothesis.inner_test
        )
        for name in names:
            for seed in range(SEEDS):
                alike(name=name, seed=seed)
        kinds = ", ".join(test_native.KINDS)
        print(f"{len(names)} blocks alike: bare, {kinds}", flush=True)
        for scenario in scenarios or SCENARIOS:
            print(
                f"{scenario}: {same_run(scenario, folder)} series are equal", flush=True
            )
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
