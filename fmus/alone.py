"""Export a block's C alone, without FMI: a header and a C99 file without heap.

The header holds the block's struct. The C file is made of the FMU's `sources/`:
Python's arithmetic from block.h and runtime.c, the block, and three functions around
it. It produces no text.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from textwrap import fill

FAILURES = Path(__file__).with_name("alone.c")
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off")
KINDS = (
    "BLOCK_ERROR",
    "VALUE_ERROR",
    "ZERO_DIVISION",
    "OVERFLOW",
    "INDEX_ERROR",
    "TYPE_ERROR",
    "RUNTIME_ERROR",
    "STOP_ITERATION",
)
_TYPE = re.compile(r"^typedef (struct \{.*\}) desat_(\w+);$", re.M)
_VARIABLE = re.compile(
    r"^    \{\"(.*?)\", (offsetof\(.*?), '([RIB])', '([iop])', (.*?), (.*?), \"", re.M
)
_AT_START = "static const desat_block desat_at_start"
_KIND = {"R": "double", "I": "int64_t", "B": "bool"}
_PROTOTYPE = re.compile(r"^(?! )(?=(?:double|int64_t) \w+\()", re.M)


@dataclass(frozen=True)
class Size:
    """Memory that a compiler needs for a block alone, in bytes.

    The fields are the struct; code and constants; static memory; and the stack of the
    deepest chain of calls, without those of libm. None stands for a value that is
    unknown: a function calls itself, or the tool is missing (the compiler's `size`, or
    a gcc for the stack).
    """

    compiler: str
    struct: int | None
    code: int | None
    static: int | None
    stack: int | None

    def __str__(self) -> str:
        struct, code, static, stack = (
            "not known" if x is None else f"{x:,} bytes"
            for x in (self.struct, self.code, self.static, self.stack)
        )
        return (
            f"{self.compiler}: struct {struct}, code and constants {code}, static memory "
            f"{static}, stack without libm's {stack}"
        )


def sources_of(fmu: Path) -> dict[str, str]:
    """Read the C files of a native FMU that its block alone needs, by name."""
    with zipfile.ZipFile(fmu) as archive:
        return {
            n: archive.read(f"sources/{n}").decode()
            for n in (f"{fmu.stem}.c", "block.h", "runtime.c")
        }


def alone(
    name: str,
    files: dict[str, str],
    compilers: Sequence[Sequence[str]] = (),
    note: str = "",
) -> tuple[dict[str, str], list[Size]]:
    """Return the files NAME.h and NAME.c of a block, and their sizes.

    Parameters
    ----------
    name
        Name of the block.
    files
        Its C files, those of its native FMU.
    compilers
        Commands of C compilers. Each compiles the files, and its sizes stand in the
        header.
    note
        A line that stands in the header.

    Returns
    -------
    tuple
        Text of each file by its name, and one `Size` for each compiler (bytes).

    Raises
    ------
    RuntimeError
        If a compiler does not compile the files.
    """
    code, _, table = files[f"{name}.c"].partition(_AT_START)
    struct = re.search(r"^struct desat_block \{.*?^\};\n", code, re.M | re.S)
    assert struct is not None
    types = _TYPE.findall(code)
    about = code.partition("#include")[0]
    source = _source(name, files, code.replace(struct[0], ""), _AT_START + table)
    header = _header(name, about, struct[0], types, _VARIABLE.findall(table))
    files_written = {f"{name}.h": header.replace("@SIZES@", ""), f"{name}.c": source}
    sizes = [measure_sizes(name, files_written, command) for command in compilers]
    sizes_text = "".join(f"\n   {line}" for line in (note, *sizes) if line)
    return files_written | {f"{name}.h": header.replace("@SIZES@", sizes_text)}, sizes


def _header(
    name: str,
    about: str,
    struct: str,
    types: list[tuple[str, str]],
    variables: list[tuple[str, str, str, str, str, str]],
) -> str:
    """Return the text of the header, with @SIZES@ where the sizes go."""

    def rename_types(text: str) -> str:
        """Replace the prefix `desat_` of the block's types by the block's name."""
        for _, of in types:
            text = re.sub(rf"\bdesat_{of}\b", f"{name}_{of}", text)
        return re.sub(r"\bdesat_block \*", f"{name} *", text)

    words = {"i": "inputs", "o": "outputs", "p": "parameters"}
    of: dict[str, dict[str, None]] = {c: {} for c in words}
    for element, _, _, causality, _, _ in variables:
        of[causality][element.partition("[")[0]] = None
    variable_lists = "\n".join(
        fill(
            f"{words[c]}: {', '.join(names)}",
            96,
            initial_indent=" " * 3,
            subsequent_indent=" " * 6,
        )
        for c, names in of.items()
        if names
    )
    guard, upper = f"{name.upper()}_H", name.upper()
    kinds = ", ".join(f"{upper}_{kind}" for kind in KINDS)
    return f"""{about.rstrip().removesuffix("*/").rstrip()}

   C99, no heap, no input or output. After {name}_init set parameters, inputs
   and, where it has noise, `instance`, a name that keys it; then {name}_start,
   and before each {name}_step the inputs.

{variable_lists}

   A function that fails returns what kind of failure it is, and sets `fault`; from then on no step
   is made. Several laws, and several structs of one law, may live beside each other, but not be
   called at the same time.@SIZES@
*/
#ifndef {guard}
#define {guard}

#include <stdbool.h>
#include <stdint.h>

typedef struct {name} {name};
{"".join(f"typedef {rename_types(body)} {name}_{of};" + chr(10) for body, of in types)}
{rename_types(struct).replace("struct desat_block {", f"struct {name} {{", 1)}
enum {{ {upper}_OK, {kinds}, {upper}_OUT_OF_BOUNDS, {upper}_FAILED_BEFORE, {upper}_NOT_FINITE }};

/* start values of all variables */
void {name}_init({name} *self);

/* begin at time t (s) with the inputs and parameters that are set; the outputs are those of t */
int {name}_start({name} *self, double t);

/* a step from t of dt (s) with the inputs that are set; state outputs are those of its end */
int {name}_step({name} *self, double t, double dt);

#endif
"""


def _source(name: str, files: dict[str, str], code: str, table: str) -> str:
    """Return the text of the C file."""
    upper = name.upper()
    header = files["block.h"]
    inline = (
        "static inline double py_sqrt"
        + header.partition("static inline double py_sqrt")[2]
    )
    inline = inline.partition("/* --- what a block is")[0]
    early = [
        line
        for line in header.splitlines()
        if re.match(r"(?:double|int64_t) py_\w+\(", line)
    ]
    inline = "\n".join(line for line in inline.splitlines() if line not in early)
    floats = files["runtime.c"].partition("/* --- floats ---")[2].partition("\n")[2]
    body = code.partition('#include "block.h"')[2].replace(
        "typedef struct desat_block desat_block;", ""
    )
    aliases = "".join(
        f"typedef {name}_{of} desat_{of};\n" for _, of in _TYPE.findall(code)
    )
    body = _TYPE.sub("", body)
    start = table.partition("static const block_variable")[0]
    bounds = [
        f"    {{{place}, '{kind}', {low}, {high}}},"
        for _, place, kind, causality, low, high in _VARIABLE.findall(table)
        if causality in "ip" and kind != "B"
    ]
    calls = re.findall(r"^static void desat_do_\w+\(.*?^\}", table, re.M | re.S)
    return f"""/* {name} alone: see {name}.h. Generated; not to be changed. */
#include "{name}.h"

#include <errno.h>
#include <math.h>
#include <setjmp.h>
#include <stddef.h>
#include <string.h>

#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-function"
#define PY_APART __attribute__((noinline))
#define PY_NORETURN __attribute__((noreturn))
#define PY_RARE(x) __builtin_expect(!!(x), 0)
#else
#define PY_APART
#define PY_NORETURN
#define PY_RARE(x) (x)
#endif
#define PY_THREAD

enum {{ {", ".join(f"PY_{kind}" for kind in KINDS)} }};

{FAILURES.read_text(encoding="utf-8")}
{chr(10).join(f"static {line}" for line in early)}

{inline}

{_PROTOTYPE.sub("static ", floats)}
typedef {name} desat_block;
{aliases}{body}
{start}
{(chr(10) * 2).join(calls)}

static const struct {{
    size_t offset;
    char kind;
    double low, high;
}} desat_bounds[] = {{
{chr(10).join(bounds) or "    {0, 'B', 0.0, 0.0},"}
}};

/* inputs and parameters within their bounds, and finite */
static int desat_checked(const desat_block *self)
{{
    for (size_t i = 0; i < sizeof desat_bounds / sizeof *desat_bounds; i++) {{
        const char *place = (const char *)self + desat_bounds[i].offset;
        double x = 0.0;
        if (desat_bounds[i].kind == 'R') x = *(const double *)place;
        else if (desat_bounds[i].kind == 'I') x = (double)*(const int64_t *)place;
        if (!isfinite(x)) return {upper}_NOT_FINITE;
        if (x < desat_bounds[i].low || x > desat_bounds[i].high) return {upper}_OUT_OF_BOUNDS;
    }}
    return {upper}_OK;
}}

static int desat_ended(desat_block *self, int how)
{{
    self->fault = how != {upper}_OK;
    return how;
}}

void {name}_init({name} *self)
{{
    memcpy(self, &desat_at_start, sizeof *self);
    self->instance = "{name}";
}}

int {name}_start({name} *self, double t)
{{
    py_frame frame;
    const int wrong = desat_checked(self);
    if (wrong) return desat_ended(self, wrong);
    if (!PY_TRY(frame)) return desat_ended(self, 1 + py_kind_caught);
    self->fault = false;
    desat_do_start(self);
    desat_do_output(self, t);
    py_end_try();
    return {upper}_OK;
}}

int {name}_step({name} *self, double t, double dt)
{{
    py_frame frame;
    const int wrong = desat_checked(self);
    if (self->fault) return {upper}_FAILED_BEFORE;
    if (wrong) return desat_ended(self, wrong);
    if (!PY_TRY(frame)) return desat_ended(self, 1 + py_kind_caught);
    desat_do_advance(self, t, dt);
    desat_do_output(self, t + dt);
    py_end_try();
    return {upper}_OK;
}}
"""


# --- what a compiler makes of it ------------------------------------------------------


def measure_sizes(name: str, files: dict[str, str], compiler: Sequence[str]) -> Size:
    """Compile the files of a block and return its sizes in bytes.

    Raises
    ------
    RuntimeError
        If the compiler does not compile them.
    """
    with TemporaryDirectory() as temporary:
        folder = Path(temporary)
        for file, text in files.items():
            (folder / file).write_text(text, encoding="utf-8")
        probe = f'#include "{name}.h"\nchar size_of[sizeof({name})];\n'
        (folder / "probe.c").write_text(probe, encoding="utf-8")
        graph = (
            []
            if _run_command(
                [*compiler, "-fcallgraph-info=su", "-c", "probe.c"], folder
            )[0]
            else ["-fcallgraph-info=su"]
        )
        for file in ("probe", name):
            exit_code, error = _run_command(
                [*compiler, *FLAGS, *graph, "-c", f"{file}.c"], folder
            )
            if exit_code:
                raise RuntimeError(f"{shlex.join(compiler)}: {error.strip()[:600]}")
        size_command = (
            _run_command([*compiler, "-print-prog-name=size"], folder)[1].strip()
            or "size"
        )
        probe_size, own_size = (
            _run_command([size_command, f"{file}.o"], folder)[1].split()
            for file in ("probe", name)
        )
        struct = code = static = None
        if (
            len(probe_size) > 8 and len(own_size) > 8
        ):  # columns after the six words of the heading: text, data, bss
            read_only, data, bss = map(int, own_size[6:9])
            struct, code, static = (
                int(probe_size[7]) + int(probe_size[8]),
                read_only + data,
                data + bss,
            )
        version = _run_command([*compiler, "--version"], folder)[1].splitlines()
        compiler_text = " ".join(
            [version[0] if version else compiler[0], *compiler[1:]]
        )
        stack = _deepest((folder / f"{name}.ci").read_text()) if graph else None
        return Size(compiler_text, struct, code, static, stack)


def _run_command(command: Sequence[str], folder: Path) -> tuple[int, str]:
    """Run a command in a folder; return its exit code and what it printed."""
    try:
        process = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, check=False
        )
    except OSError as error:
        return 1, str(error)
    return process.returncode, process.stdout or process.stderr


def _deepest(graph: str) -> int | None:
    """Return the stack of the longest chain of calls in bytes.

    None where a function calls itself or has no bound of its own.
    """
    own_stack: dict[str, int] = {}
    for of, label in re.findall(r'node: \{ title: "(.*?)" label: "(.*?)"', graph):
        match = re.search(r"(\d+) bytes \((\w+)", label)
        if match is not None and match[2] != "static" and "bounded" not in label:
            return None
        own_stack[of] = int(match[1]) if match else 0
    calls: dict[str, set[str]] = {}
    for caller, callee in re.findall(
        r'edge: \{ sourcename: "(.*?)" targetname: "(.*?)"', graph
    ):
        calls.setdefault(caller, set()).add(callee)
    depth_of: dict[str, int] = {}

    def depth(function: str, above: frozenset[str]) -> int:
        """Return the stack that a function and its callees need, in bytes."""
        if function in above:
            raise RecursionError
        if function not in depth_of:
            inner = above | {function}
            depth_of[function] = own_stack.get(function, 0) + max(
                (depth(x, inner) for x in calls.get(function, ())), default=0
            )
        return depth_of[function]

    try:
        return max((depth(x, frozenset()) for x in own_stack), default=0)
    except RecursionError:
        return None
