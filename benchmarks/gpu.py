"""Cases of a campaign as threads of a GPU: a trial.

    python -m benchmarks.gpu [CASES [STEPS]] [write]      # `write`: into latest.json

The loop of a scenario (`loop_unit.py`) is compiled by nvcc as a kernel, a case a
thread: states of drawn cases, initialised by the FMU, go in, and states at the end come
out. A failure ends its thread, whose status says its kind; there is no text. With a GPU
the kernel runs, and the states are held against those of the FMU (1e-12 relative) and
its speed against the processor's. Without one it is compiled, and the same file,
compiled by g++, steps the cases one after the other: its states are held against the
FMU's bit by bit.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from datetime import date
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desat.campaign.sampling import draw_of
from desat.export.loop_fmu import LoopEnds, export
from desat.runs.cases import draft_to_draw
from desat.runs.prepare import read
from desat.system.options import Options

from .lanes import NAME, Layout, cases
from .loop_unit import Unit
from .run import LATEST

CASES, STEPS, TOLERANCE = 4096, 2000, 1e-12
_HEAD = """
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <chrono>
#include <vector>
using namespace std;
#ifdef __CUDACC__
#define DEVICE __device__
#define DATA __device__
__device__ int *statuses;
[[noreturn]] __device__ static void failed(int kind)
{
    statuses[blockIdx.x * blockDim.x + threadIdx.x] = kind + 1;
    asm volatile("exit;");
    __builtin_unreachable();
}
#else
#define DEVICE
#define DATA
[[noreturn]] static void failed(int kind) { throw kind; }
#endif
DEVICE static inline double py_min(double a, double b) { return b < a ? b : a; }
DEVICE static inline double py_max(double a, double b) { return b > a ? b : a; }
"""
_MAIN = """
#ifdef __CUDACC__
__global__ void step_all(char *states, int n, int64_t steps)
{
    const int i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i < n) loop::advance(states + (size_t)i * loop::size, steps);
}
#define CHECKED(call) do { cudaError_t e = (call); if (e != cudaSuccess) { \\
    fprintf(stderr, "%s\\n", cudaGetErrorString(e)); exit(2); } } while (0)
#endif

/* states from standard input, as they are after the steps to standard output; "seconds failed" */
int main(int count, char **given)
{
    const int n = atoi(given[1]);
    const int64_t steps = atoll(given[2]);
    vector<char> states(n * loop::size);
    vector<int> status(n);
    if (fread(states.data(), loop::size, n, stdin) != (size_t)n) return 3;
    auto began = chrono::steady_clock::now();
#ifdef __CUDACC__
    char *there;
    int *said;
    CHECKED(cudaDeviceSetLimit(cudaLimitStackSize, 16 << 10));
    CHECKED(cudaMalloc(&there, states.size()));
    CHECKED(cudaMalloc(&said, n * sizeof(int)));
    CHECKED(cudaMemcpyToSymbol(statuses, &said, sizeof said));
    CHECKED(cudaMemset(said, 0, n * sizeof(int)));
    CHECKED(cudaMemcpy(there, states.data(), states.size(), cudaMemcpyHostToDevice));
    CHECKED(cudaDeviceSynchronize());
    began = chrono::steady_clock::now();
    step_all<<<(n + 63) / 64, 64>>>(there, n, steps);
    CHECKED(cudaDeviceSynchronize());
    auto ended = chrono::steady_clock::now();
    CHECKED(cudaMemcpy(states.data(), there, states.size(), cudaMemcpyDeviceToHost));
    CHECKED(cudaMemcpy(status.data(), said, n * sizeof(int), cudaMemcpyDeviceToHost));
#else
    for (int i = 0; i < n; i++) {
        try {
            loop::advance(states.data() + (size_t)i * loop::size, steps);
        } catch (int kind) {
            status[i] = kind + 1;
        }
    }
    auto ended = chrono::steady_clock::now();
#endif
    int failures = 0;
    for (int s : status) failures += s != 0;
    fprintf(stderr, "%.6f %d\\n", chrono::duration<double>(ended - began).count(), failures);
    return fwrite(states.data(), loop::size, n, stdout) != (size_t)n;
}
"""
NVCC = (
    "-std=c++20",
    "-O3",
    "--fmad=false",
    "--expt-relaxed-constexpr",
    "-arch=native",
    "-diag-suppress=177,550,20012",
)


def differs(
    states: NDArray[np.uint8], ends: NDArray[np.uint8], layout: Layout
) -> float:
    """The largest difference of any number of states (cases, bytes), relative to its
    own size or, below 1, absolute."""
    worst = 0.0
    for (at, size), (_, _, number) in zip(layout.plain, layout.wide, strict=True):
        if number and size == 8:
            a, b = (
                np.ascontiguousarray(x[:, at : at + 8]).view(float)
                for x in (states, ends)
            )
            both = np.isfinite(a) & np.isfinite(b)
            off = np.abs(a - b)[both] / np.maximum(1.0, np.abs(b)[both])
            worst = max(worst, float(off.max(initial=0.0)))
    return worst


def has_gpu() -> bool:
    """Whether a driver lists one."""
    lister = shutil.which("nvidia-smi")
    return (
        lister is not None
        and not subprocess.run([lister, "-L"], capture_output=True).returncode
    )


def measure(count: int, steps: int) -> dict[str, Any]:
    """What could be compiled and run here, and what came of it."""
    found: dict[str, Any] = {
        "system": NAME,
        "steps": steps,
        "date": str(date.today()),
        "gpu": has_gpu(),
        "compiled": False,
    }
    with TemporaryDirectory() as temporary:
        folder = Path(temporary)
        names = tuple(draw_of(draft_to_draw(read(NAME), False), 1, 0))
        unit = Unit(
            export(NAME, Options(), LoopEnds(parameters=names), folder / "loop.fmu"),
            folder / "fmu",
        )
        text = unit.text()
        layout = Layout(text, 1)
        source = folder / "loop.cu"
        source.write_text(_HEAD + text + _MAIN)
        on_host = folder / "host"
        subprocess.run(
            [
                "g++",
                "-x",
                "c++",
                "-std=c++20",
                "-O3",
                "-ffp-contract=off",
                "-w",
                "-fpermissive",
                "-o",
                str(on_host),
                str(source),
            ],
            check=True,
        )
        if nvcc := shutil.which("nvcc"):
            flags = [f if found["gpu"] else f.replace("native", "sm_80") for f in NVCC]
            done = subprocess.run(
                [nvcc, *flags, "-Xptxas", "-v", "-o", str(folder / "gpu"), str(source)],
                capture_output=True,
                text=True,
                check=False,
            )
            if done.returncode:
                sys.exit(done.stderr[:9000])
            used = re.search(
                r"Function properties for .*step_all.*\n\s*(.*)\n.*Used (\d+)",
                done.stderr,
            )
            found |= {
                "compiled": True,
                "ptxas": used and f"{used[1]}, {used[2]} registers",
            }
        few, ends = cases(unit, layout.sizes[0], min(count, 8), steps)
        result, seconds, failures = _run(on_host, few, steps)
        found["processor"] = {
            "cases": len(few),
            "failed": failures,
            "us_per_step": 1e6 * seconds / len(few) / steps,
            "equal": bool((result == ends).all()),
        }
        if found["compiled"] and found["gpu"]:
            many = np.resize(few, (count, few.shape[1]))
            result, seconds, failures = _run(folder / "gpu", many, steps)
            found["kernel"] = {
                "cases": count,
                "failed": failures,
                "us_per_step": 1e6 * seconds / count / steps,
                "differs": differs(result[: len(few)], ends, layout),
                "tolerance": TOLERANCE,
            }
    return found


def _run(
    program: Path, states: NDArray[np.uint8], steps: int
) -> tuple[NDArray[np.uint8], float, int]:
    done = subprocess.run(
        [str(program), str(len(states)), str(steps)],
        input=states.tobytes(),
        capture_output=True,
        check=False,
    )
    if done.returncode:
        sys.exit(done.stderr.decode())
    seconds, failures = done.stderr.split()
    buffer = np.frombuffer(done.stdout, np.uint8).reshape(states.shape)
    return buffer, float(seconds), int(failures)


def main() -> int:
    """Measure, and write."""
    arguments = [int(x) for x in sys.argv[1:] if x != "write"]
    found = measure(*arguments, *(CASES, STEPS)[len(arguments) :])
    print(json.dumps(found, indent=1))
    if "write" in sys.argv:
        data = json.loads(LATEST.read_text())
        LATEST.write_text(
            json.dumps({**data, "gpu": found}, indent=1) + "\n", encoding="utf-8"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
