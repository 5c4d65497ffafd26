"""Cases side by side in the lanes of vector registers: a trial.

    python -m benchmarks.lanes [write]        # `write`: into latest.json

The loop of a scenario (`loop_unit.py`) is compiled with `double` as a vector of 4 or 8
lanes, from the same translated C: arithmetic of all lanes at once, functions of libm
lane by lane, so that the bits are those of the scalar code. A branch that lanes do not
take alike, and an integer in which they differ, would have to be made lane by lane: of
drawn cases it is counted in how many steps of each block that is so.
"""

from __future__ import annotations

import ctypes
import json
import re
import subprocess
import sys
import time
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

from .loop_unit import Unit
from .run import LATEST

NAME = "nadir_day/day-dipole"
WIDTHS = {4: ["-mavx2"], 8: ["-mavx512f", "-mavx512dq", "-mprefer-vector-width=512"]}
FLAGS = [
    "-std=c++20",
    "-O3",
    "-ffp-contract=off",
    "-w",
    "-fpermissive",
    "-shared",
    "-fPIC",
]
ROUNDS, STEPS = 3, 20_000
_C = {
    "double": (8, 8),
    "uint64_t": (8, 8),
    "int64_t": (8, 8),
    "int32_t": (4, 4),
    "bool": (1, 1),
}
_HEAD = """
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
using namespace std;
#define DEVICE
#define DATA
[[noreturn]] static void failed(int kind) { throw kind; }
"""
_SCALAR = """
static inline double py_min(double a, double b) { return b < a ? b : a; }
static inline double py_max(double a, double b) { return b > a ? b : a; }
"""
_LANES = """
#define ALL ((1 << LANES) - 1)
typedef double values __attribute__((vector_size(8 * LANES)));
typedef int64_t masks __attribute__((vector_size(8 * LANES)));
typedef uint64_t words __attribute__((vector_size(8 * LANES)));
struct diverged {};

/* a condition: of all lanes, or of none */
struct mask {
    masks m;
    operator bool() const
    {
        int64_t all = -1, any = 0;
        for (int i = 0; i < LANES; i++) { all &= m[i]; any |= m[i]; }
        if (all != any) throw diverged();
        return any != 0;
    }
};

struct ulane {
    words v;
    ulane() = default;
    ulane(uint64_t x) : v(x - words{}) {}
    ulane(int x) : ulane((uint64_t)x) {}
    ulane(int64_t x) : ulane((uint64_t)x) {}
    ulane(words x) : v(x) {}
};
#define U(op) static inline ulane operator op(ulane a, ulane b) { return a.v op b.v; }
U(+) U(-) U(*) U(^) U(|) U(&)
static inline ulane operator>>(ulane a, int n) { return a.v >> n; }
static inline ulane operator<<(ulane a, int n) { return a.v << n; }

struct lane {
    values v;
    lane() = default;
    lane(double x) : v(x - values{}) {}
    lane(int x) : lane((double)x) {}
    lane(int64_t x) : lane((double)x) {}
    lane(values x) : v(x) {}
    explicit lane(ulane x) : v(__builtin_convertvector(x.v, values)) {}
    lane &operator+=(lane b) { v += b.v; return *this; }
    lane &operator-=(lane b) { v -= b.v; return *this; }
    lane &operator*=(lane b) { v *= b.v; return *this; }
    explicit operator int64_t() const
    {
        for (int i = 1; i < LANES; i++) if ((int64_t)v[i] != (int64_t)v[0]) throw diverged();
        return (int64_t)v[0];
    }
};
#define OP(op) static inline lane operator op(lane a, lane b) { return a.v op b.v; }
#define IS(op) static inline mask operator op(lane a, lane b) { return {a.v op b.v}; }
OP(+) OP(-) OP(*) OP(/)
IS(<) IS(>) IS(<=) IS(>=) IS(==) IS(!=)
static inline lane operator-(lane a) { return -a.v; }
#define EACH(name) static lane name(lane a) \\
    { for (int i = 0; i < LANES; i++) a.v[i] = ::name(a.v[i]); return a; }
#define BOTH(name) static lane name(lane a, lane b) \\
    { for (int i = 0; i < LANES; i++) a.v[i] = ::name(a.v[i], b.v[i]); return a; }
namespace vec {
EACH(sin) EACH(cos) EACH(tan) EACH(asin) EACH(acos) EACH(atan) EACH(exp) EACH(expm1) EACH(log)
EACH(log1p) EACH(log2) EACH(log10) EACH(sinh) EACH(cosh) EACH(tanh)
EACH(floor) EACH(ceil) EACH(trunc) EACH(nearbyint)
BOTH(atan2) BOTH(pow) BOTH(fmod) BOTH(remainder)
static inline lane sqrt(lane a) { for (int i = 0; i < LANES; i++) a.v[i] = __builtin_sqrt(a.v[i]);
    return a; }
static inline lane fabs(lane a) { return (values)((masks)a.v & INT64_MAX); }
static inline lane copysign(lane a, lane b)
    { return (values)(((masks)a.v & INT64_MAX) | ((masks)b.v & INT64_MIN)); }
static inline mask isfinite(lane a)
    { return {((masks)a.v & INT64_C(0x7ff0000000000000)) != INT64_C(0x7ff0000000000000)}; }
static inline mask isnan(lane a) { return {a.v != a.v}; }
static inline mask isinf(lane a) { return {(values)((masks)a.v & INT64_MAX) == INFINITY}; }
}
using namespace vec;
static inline lane py_min(lane a, lane b) { return b.v < a.v ? b.v : a.v; }
static inline lane py_max(lane a, lane b) { return b.v > a.v ? b.v : a.v; }
#define double lane
#define uint64_t ulane
"""
_TAIL = """
#undef double
#undef uint64_t
extern "C" size_t loop_size() { return loop::size; }
extern "C" int loop_advance(char *state, int64_t steps)
{
    try { loop::advance(state, steps); } catch (...) { return 1; }
    return 0;
}
"""
_COUNTED = 'extern "C" { long apart[64]; unsigned long ticks[64]; }\n'


class Layout:
    """Where the values of a state lie, with lanes and without: (offset, its size) each."""

    def __init__(self, text: str, lanes: int) -> None:
        self._lanes = lanes
        self.plain: list[tuple[int, int]] = []
        self.wide: list[tuple[int, int, bool]] = []
        self._seeds: dict[int, NDArray[np.uint8]] = {}
        """Of each lane, by its place: nothing reads them after the start."""
        self._at = [0, 0]
        spaces = re.split(r"^namespace (\w+) \{$", text, flags=re.M)
        found = dict(zip(spaces[1::2], spaces[2::2], strict=True))
        rooms = re.search(r"constexpr size_t size = .*", found["loop"])
        assert rooms is not None
        parts = re.findall(r"sizeof\((\w+)::block\)", rooms[0])
        for name in ["loop", *parts]:
            self._types: dict[str, list[tuple[str, int, str]]] = {}
            for body, of in re.findall(
                r"^typedef struct \{(.*?)\} (\w+);$", found[name], re.M
            ):
                self._types[of] = self._fields(body)
            block = re.search(r"^struct block \{(.*?)^\};", found[name], re.M | re.S)
            assert block is not None
            self._types["block"] = self._fields(
                re.sub(r"/\*.*?\*/", "", block[1], flags=re.S)
            )
            self._buffer("block")
        self.sizes = tuple(self._at)

    def _fields(self, body: str) -> list[tuple[str, int, str]]:
        def substeps(found: re.Match[str]) -> str:
            name = f"inner_{len(self._types)}"
            self._types[name] = self._fields(found[1])
            return f"{name} {found[2]};"

        body = re.sub(r"struct \{(.*?)\} (\w+);", substeps, body)
        fields = []
        for line in filter(None, map(str.strip, body.split(";"))):
            kind, names = line.replace("const char *", "pointer ").split(None, 1)
            for name in names.split(","):
                count = re.search(r"\[(\d+)\]", name)
                fields.append((kind, int(count[1]) if count else 1, name))
        return fields

    def _size(self, kind: str, wide: bool) -> tuple[int, int]:
        if kind in ("double", "uint64_t") and wide:
            return 8 * self._lanes, 8 * self._lanes
        if kind in _C or kind == "pointer":
            return _C.get(kind, (8, 8))
        size, largest = 0, 1
        for of, count, _ in self._types[kind]:
            n, align = self._size(of, wide)
            size = -(-size // align) * align + n * count
            largest = max(largest, align)
        return -(-size // largest) * largest, largest

    def _buffer(self, kind: str) -> None:
        at = tuple(self._at)
        self._walk(kind, *at)
        for w in (0, 1):
            self._at[w] = at[w] + -(-self._size(kind, bool(w))[0] // 16) * 16

    def _walk(self, kind: str, plain: int, wide: int) -> None:
        if kind in _C or kind == "pointer":
            size = self._size(kind, False)[0]
            self.plain.append((plain, size))
            self.wide.append((wide, size, kind in ("double", "uint64_t")))
            return
        for of, count, name in self._types[kind]:
            a, b = self._size(of, False), self._size(of, True)
            plain, wide = -(-plain // a[1]) * a[1], -(-wide // b[1]) * b[1]
            if of == "int64_t" and re.fullmatch(r"seed|v\d+\[1\]", name):
                self._seeds[plain] = np.zeros(0, np.uint8)
            for _ in range(count):
                self._walk(of, plain, wide)
                plain, wide = plain + a[0], wide + b[0]

    def put(self, states: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """States (lanes, bytes) side by side; their integers are alike."""
        memory = np.zeros(self.sizes[1] + 64, np.uint8)
        result = memory[-memory.ctypes.data % 64 :][: self.sizes[1]]
        for (a, size), (b, _, is_lane) in zip(self.plain, self.wide, strict=True):
            part = states[:, a : a + size]
            if is_lane:
                result[b : b + size * self._lanes] = part.reshape(-1)
            else:
                result[b : b + size] = part[0]
                if a in self._seeds:
                    self._seeds[a] = part.copy()
                assert a in self._seeds or (part == part[0]).all()
        return result

    def take(self, wide: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The states (lanes, bytes)."""
        states = np.zeros((self._lanes, self.sizes[0]), np.uint8)
        for (a, size), (b, _, is_lane) in zip(self.plain, self.wide, strict=True):
            part = wide[b : b + size * (self._lanes if is_lane else 1)].reshape(
                -1, size
            )
            states[:, a : a + size] = self._seeds.get(a, part)
        return states


def built(text: str, folder: Path, lanes: int, flags: list[str]) -> Any:
    """The library of a loop with so many lanes."""
    head = _HEAD + (_SCALAR if lanes == 1 else _LANES.replace("LANES", str(lanes)))
    source = folder / f"{len(list(folder.glob('*.cpp')))}.cpp"
    source.write_text(head + text + _TAIL)
    library = source.with_suffix(".so")
    subprocess.run(["g++", *FLAGS, *flags, "-o", str(library), str(source)], check=True)
    shared_library = ctypes.CDLL(str(library))
    shared_library.loop_size.restype = ctypes.c_size_t
    return shared_library


def counted(text: str) -> str:
    """Its blocks timed, and counted in how many steps the lanes of each are not alike:
    then it goes on with the next one, so that only counts are right."""
    call = re.compile(
        r"(\w+::do_advance\(c->part\[(\d+)\], [^;]*\); \w+::do_output\([^;]*\);)"
    )
    return _COUNTED + call.sub(
        r"{ unsigned long before = __builtin_ia32_rdtsc(); try { \1 } catch (diverged &) "
        r"{ apart[\2]++; } ticks[\2] += __builtin_ia32_rdtsc() - before; }",
        text,
    )


def advance(library: Any, state: NDArray[np.uint8], steps: int) -> float:
    """The seconds that steps of a state take, which is changed."""
    began = time.perf_counter()
    failed = library.loop_advance(
        ctypes.c_void_p(state.ctypes.data), ctypes.c_int64(steps)
    )
    assert not failed
    return time.perf_counter() - began


def cases(
    unit: Unit, size: int, count: int, steps: int = 0
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """The states (count, bytes) that drawn cases begin with, and those after so many
    steps."""
    draft = draft_to_draw(read(NAME), False)
    known = unit.parameters()
    states = []
    for draw in range(count):
        values: dict[str, Any] = {}
        for name, value in draw_of(draft, 1, draw).items():
            of = value if isinstance(value, list) else [value]
            names = (
                [name]
                if name in known
                else [f"{name}[{i}]" for i in range(1, len(of) + 1)]
            )
            values |= zip(names, of, strict=True)
        states.append(unit.states(values, size, steps))
    return np.stack([x for x, _ in states]), np.stack([x for _, x in states])


def measure() -> dict[str, Any]:
    """Of each width that this processor has: how much faster lanes of one and the same
    case are, whether their bits are those of the scalar code, and of drawn cases each
    block's share of the time and of the steps in which its lanes go apart."""
    has = Path("/proc/cpuinfo").read_text()
    draws = draw_of(draft_to_draw(read(NAME), False), 1, 0)
    found: dict[str, Any] = {"system": NAME, "steps": STEPS, "date": str(date.today())}
    with TemporaryDirectory() as temporary:
        folder = Path(temporary)
        expected = LoopEnds(parameters=tuple(draws))
        fmu = export(NAME, Options(), expected, folder / "loop.fmu")
        unit = Unit(fmu, folder / "fmu")
        text = unit.text()
        for lanes, flags in WIDTHS.items():
            if all(flag.removeprefix("-m") in has for flag in flags if "=" not in flag):
                found[str(lanes)] = _with(unit, text, folder, lanes, flags)
    return found


def _with(
    unit: Unit, text: str, folder: Path, lanes: int, flags: list[str]
) -> dict[str, Any]:
    layout = Layout(text, lanes)
    scalar, wide = built(text, folder, 1, flags), built(text, folder, lanes, flags)
    assert (scalar.loop_size(), wide.loop_size()) == layout.sizes
    drawn_cases, _ = cases(unit, layout.sizes[0], lanes)
    alike = np.repeat(drawn_cases[:1], lanes, axis=0)
    ratios = []
    for _ in range(ROUNDS):
        one, together = alike[0].copy(), layout.put(alike)
        seconds = advance(scalar, one, STEPS)
        ratios.append(lanes * seconds / advance(wide, together, STEPS))
    equal = bool((layout.take(together) == one).all())
    clocked = "struct diverged {};\n" + counted(text)
    scalar, wide = (
        built(clocked, folder, 1, flags),
        built(counted(text), folder, lanes, flags),
    )
    advance(scalar, drawn_cases[0].copy(), STEPS)
    advance(wide, layout.put(drawn_cases), STEPS)
    ticks = [list((ctypes.c_ulong * 64).in_dll(x, "ticks")) for x in (scalar, wide)]
    apart = list((ctypes.c_long * 64).in_dll(wide, "apart"))
    return {
        "alike": max(ratios),
        "equal": equal,
        "blocks": {
            name: {
                "share": ticks[0][i] / sum(ticks[0]),
                "apart": apart[i] / STEPS,
                "faster": lanes * ticks[0][i] / ticks[1][i],
            }
            for i, name in enumerate(unit.parts)
        },
    }


def main() -> int:
    """Measure, and write."""
    found = measure()
    print(json.dumps(found, indent=1))
    if sys.argv[1:] == ["write"]:
        data = json.loads(LATEST.read_text())
        LATEST.write_text(
            json.dumps({**data, "lanes": found}, indent=1) + "\n", encoding="utf-8"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
