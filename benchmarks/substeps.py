"""Compare the error that a run of a new craft states with the one that it has.

    python -m benchmarks.substeps --crafts 24 --seed 1

Crafts of `desat new craft` of all kinds fly as written, with the wheels at rest, half
full and at 80 % of their capacity, and `worst.toml`; the truth is
the same run with 64 substeps, or four times its own. Prints a line a run, and how many true errors are above
the stated one, or below a fifth of it and above 1e-9 rad.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks import dumps, sizing
from desat.begin import craft as new_craft
from desat.numbers.derived import pointing
from desat.runs.prepare import prepare
from desat.runs.run import Options, execute
from desat.system.errors import DesatError

TRUTH = 64  # substeps
FILLS = (0.0, 0.5, 0.8)  # of a wheel's capacity at the start


def crafts(count: int, seed: int, into: Path) -> Iterator[tuple[str, Path]]:
    """Write crafts, two of three with coils, one that dumps by thrusters."""
    dumping = dumps.drawn(seed)
    for i in range(count):
        folder = into / f"craft{i}"
        if i % 3 < 2:
            facts = sizing.draw_craft_facts(1000 * seed + i)
            new_craft.write(folder, facts, "desat new craft")
            yield "coils", folder
        else:
            kind, options = dumping[(5 * i + seed) % len(dumping)]
            command = [sys.executable, "-m", "desat.cli", "new", "craft", str(folder)]
            subprocess.run([*command, *options], check=True, capture_output=True)
            yield kind, folder


def errors(target: str, fill: float | None, steps: int) -> tuple[int, float, float]:
    """Return the substeps, the stated and the true attitude error (rad) of a run."""
    system, _ = prepare(target, Options()).or_raise()
    stop = system.start + min(system.stop - system.start, steps * system.step)
    sets = []
    if fill is not None:
        wheels = system.components["wheels"].values
        capacity = [
            wheels[f"inertia_wheel[{k}]"] * wheels["speed_limit"] for k in (1, 2, 3, 4)
        ]
        start = ", ".join(f"{fill * x:.9g}" for x in capacity)
        sets = [f"wheels.h_start_wheel=[{start}]"]
    run = execute(target, Options(stop=stop, sets=sets))
    truth = execute(
        target,
        Options(stop=stop, sets=sets, substeps=max(TRUTH, 4 * run.manifest.substeps)),
    )
    q, other = (r.results.values("spacecraft.q_bi") for r in (run, truth))
    choice = run.manifest.substep_choice
    stated = choice.estimate if choice and choice.estimate is not None else np.nan
    error = float(np.radians(pointing(q, other)).max())
    return run.manifest.substeps, float(stated), error


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly the crafts and print the comparison."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--crafts", type=int, default=24)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--steps", type=int, default=6_000, help="of a run, at most")
    chosen = parser.parse_args(arguments)
    below = above = total = 0
    with tempfile.TemporaryDirectory() as into:
        for kind, folder in crafts(chosen.crafts, chosen.seed, Path(into)):
            for scenario, fill in (*(("nominal", x) for x in FILLS), ("worst", None)):
                file = folder / f"{scenario}.toml"
                if not file.is_file():
                    continue
                try:
                    substeps, stated, error = errors(str(file), fill, chosen.steps)
                except DesatError as refusal:
                    print(f"{folder.name:8} {kind:22} {scenario:8} {fill}: {refusal}")
                    continue
                total += 1
                below += error > stated
                above += stated > max(5.0 * error, 1e-9)
                print(
                    f"{folder.name:8} {kind:22} {scenario:8} "
                    f"{'' if fill is None else fill:>4} {substeps:3d} substeps: stated "
                    f"{stated:.1e} rad, true {error:.1e} rad, {stated / error:.1f} times",
                    flush=True,
                )
    print(
        f"{total} runs: the error is above the stated one in {below}, "
        f"below a fifth of it in {above}"
    )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
