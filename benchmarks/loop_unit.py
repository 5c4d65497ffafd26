"""The loop of a scenario as one C++ file: the C of its blocks and of what a master does
in a step, as `desat export fmu` writes them, each in a namespace, without texts and
without a way to catch a failure. A state goes in, so many steps are made, and a state
comes out. `gpu.py` and `lanes.py` compile it, each with a head of its own, which says
what DEVICE, `failed` and `double` are.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave
from numpy.typing import NDArray

_PREFIX = re.compile(r"\b(?:desat|DESAT)_")
"""Of names of C: in the C++ each block has a namespace."""
_STATIC = re.compile(r"^static (?!inline)(.*)$", re.M)
_MEMORY = re.compile(r"^ +static PY_THREAD (struct \{.*\}) (\w+);$", re.M)
_VARIABLE = re.compile(r"^    \{\"[^\"]*\", (offsetof\(.*?), '[RIB]', ", re.M)
_ENDS = re.compile(r"^static void do_(?:output|advance).*?^}", re.M | re.S)
_COPY = re.compile(
    r"memcpy\(&(self->[\w.]+)\[(\d+)\], &(self->[\w.]+)\[(\d+)\], (\d+) \* [^;]*;"
)
_CALL = re.compile(r"\b(REAL|INTEGER|BOOLEAN)\((\d+), (\d+)\)")
_KIND = {"REAL": "double", "INTEGER": "int64_t", "BOOLEAN": "bool"}


_FAILURES = """
enum { PY_BLOCK_ERROR, PY_VALUE_ERROR, PY_ZERO_DIVISION, PY_OVERFLOW, PY_INDEX_ERROR, PY_TYPE_ERROR,
       PY_RUNTIME_ERROR, PY_STOP_ITERATION };
#define PY_RARE(x) (x)
#define py_raise(kind, text) failed(kind)
#define py_no_value() failed(PY_TYPE_ERROR)
#define py_zero_division(text) failed(PY_ZERO_DIVISION)
#define py_index_error() failed(PY_INDEX_ERROR)
#define py_too_long(most) failed(PY_OVERFLOW)
#define py_unpack_error(n, wanted) failed(PY_VALUE_ERROR)
#define py_beyond() failed(PY_OVERFLOW)
#define py_not_integer(x) failed(PY_VALUE_ERROR)
#define py_domain() failed(PY_VALUE_ERROR)
#define py_raise_again() failed(PY_RUNTIME_ERROR)
#define py_caught(kinds) false
#define py_caught_text() ""
#define py_caught_name() ""
#define py_text_begin()
#define py_text(text) (void)(text)
#define py_text_float(x)
#define py_text_int(x) (void)(x)
#define py_text_mask(x)
#define py_text_format(kind, precision, x)
#define py_text_end() ""
struct py_frame {};
DEVICE static void py_end_try() {}
"""


class Unit:
    """The C++ of a loop FMU and the states that it begins with."""

    def __init__(self, fmu: Path, folder: Path) -> None:
        self._folder = extract(str(fmu), str(folder))
        self._description = read_model_description(self._folder)
        with zipfile.ZipFile(fmu) as archive:
            self._sources = {
                Path(n).stem: _PREFIX.sub("", archive.read(n).decode())
                for n in archive.namelist()
                if n.startswith("sources/") and n.endswith(".c")
            }
            self._header = _PREFIX.sub("", archive.read("sources/block.h").decode())
        assert self._description.coSimulation is not None
        self._loop = self._sources[self._description.coSimulation.modelIdentifier]
        head = self._loop.partition("parts[PARTS] = {")[2].partition("};")[0]
        self.parts = re.findall(r"&(\w+)_block", head)

    def text(self) -> str:
        """The C++, to be put behind a head."""
        return "\n".join([*self._arithmetic(), *self._blocks(), *self._steps()])

    def _arithmetic(self) -> Iterator[str]:
        """Python's, of block.h and runtime.c."""
        header = self._header.partition("static inline double py_sqrt")
        inline = (header[1] + header[2]).partition("/* --- what a block is")[0]
        inline = re.sub(
            r"^static inline double py_(min|max)\(.*\n", "", inline, flags=re.M
        )
        inline = re.sub(r"^(?! )[\w ]+\*?\w+\([^)]*\);\n", "", inline, flags=re.M)
        floats = (
            self._sources["runtime"]
            .partition("/* --- floats ---")[2]
            .partition("\n")[2]
        )
        floats = re.sub(r"^    errno = 0;\n", "", floats, flags=re.M)
        floats = floats.replace("(errno == ERANGE && r != 0.0)", "false")
        yield _FAILURES
        yield inline.replace("static inline", "DEVICE static inline")
        yield re.sub(
            r"^(?:static )?(?=(?:double|int64_t) \w+\()",
            "DEVICE static ",
            floats,
            flags=re.M,
        )
        yield "constexpr size_t block_room(size_t size) { return (size + 15) / 16 * 16; }"

    def _blocks(self) -> Iterator[str]:
        for name in dict.fromkeys(self.parts):
            code, _, table = self._sources[name].partition(
                "static const block at_start"
            )
            table = table.partition("static const block_variable variables[]")[2]
            places = _VARIABLE.findall(table)
            code = code.replace('#include "block.h"', "").replace(
                "typedef struct block block;", "struct block;"
            )
            ends = "\n".join(
                re.findall(
                    r"^static void do_(?:output|advance).*?^}", table, re.M | re.S
                )
            )
            ends = re.sub(r"\(void \*self", "(void *given", ends)
            ends = re.sub(
                r"^    (\w+\()self", r"    \1(block *)given", ends, flags=re.M
            )
            yield f"namespace {name} {{"
            yield _device(code)
            yield _device(ends)
            yield from (
                f"constexpr size_t at_{i} = {place};" for i, place in enumerate(places)
            )
            yield "}"

    def _steps(self) -> Iterator[str]:
        code = self._loop
        struct = re.search(r"^struct block \{.*?^\};", code, re.M | re.S)
        assert struct is not None
        body = code[
            code.index("static void do_0_") : code.index("static void parameters(")
        ]
        body = _CALL.sub(self._place, body)
        body = re.sub(r"\bstepped\(c, (\d+), ([^;]*), ([^;]*)\);", self._step, body)
        body = _COPY.sub(r"for (int i = 0; i < \5; i++) \1[\2 + i] = \3[\4 + i];", body)
        body = body[: body.rindex("}") + 1]
        shown = re.search(r"^static void shown\(.*?^}", code, re.M | re.S)
        assert shown is not None
        count = int(re.search(r"STEPS = (\d+)", code)[1])  # type: ignore[index]
        cases = " ".join(f"case {i}: step_{i}(c); break;" for i in range(count))
        rooms = [f"block_room(sizeof({name}::block))" for name in self.parts]
        yield "namespace loop {"
        yield struct[0]
        yield f"struct context {{ block *self; char *part[{len(rooms)}]; }};"
        yield _device(body)
        yield _device(shown[0])
        yield f"constexpr size_t size = block_room(sizeof(block)) + {' + '.join(rooms)};"
        yield "DEVICE static void advance(void *state, int64_t steps) {"
        yield "    context made, *c = &made;"
        yield "    char *at = (char *)state + block_room(sizeof(block));"
        yield "    c->self = (block *)state;"
        yield from (
            f"    c->part[{i}] = at; at += {package};"
            for i, package in enumerate(rooms)
        )
        yield f"    for (int64_t n = 0; n < steps; n++, c->self->k++) switch (c->self->k % {count})"
        yield f"    {{ {cases} }}"
        yield "    shown(c);"
        yield "}"
        yield "}"

    def _place(self, found: re.Match[str]) -> str:
        kind, part, variable = found[1], int(found[2]), found[3]
        return (
            f"(*({_KIND[kind]} *)(c->part[{part}] + {self.parts[part]}::at_{variable}))"
        )

    def _step(self, found: re.Match[str]) -> str:
        part, t, dt = int(found[1]), found[2], found[3]
        name = self.parts[part]
        return (
            f"{name}::do_advance(c->part[{part}], {t}, {dt}); "
            f"{name}::do_output(c->part[{part}], {t} + {dt});"
        )

    def parameters(self) -> set[str]:
        """The names of the FMU's parameters."""
        variables = self._description.modelVariables
        return {v.name for v in variables if v.causality == "parameter"}

    # --- states -----------------------------------------------------------------------

    def states(
        self, values: Mapping[str, Any], size: int, steps: int
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """The bytes of a case's loop when it begins, and after so many steps of 1 s of
        the FMU itself. `values`: of the FMU's parameters."""
        references = {
            v.name: v.valueReference for v in self._description.modelVariables
        }
        assert self._description.coSimulation is not None
        fmu = FMU2Slave(
            guid=self._description.guid,
            unzipDirectory=self._folder,
            instanceName="loop",
            modelIdentifier=self._description.coSimulation.modelIdentifier,
        )
        fmu.instantiate()
        try:
            fmu.setupExperiment(startTime=0.0)
            for name, value in values.items():
                give = fmu.setInteger if isinstance(value, int) else fmu.setReal
                give([references[name]], [value])
            fmu.enterInitializationMode()
            fmu.exitInitializationMode()
            first = self._bytes(fmu, size)
            if steps:
                fmu.doStep(0.0, float(steps))
            return first, self._bytes(fmu, size)
        finally:
            fmu.freeInstance()

    def _bytes(self, fmu: Any, size: int) -> NDArray[np.uint8]:
        state = fmu.getFMUState()
        result = fmu.serializeFMUState(state)
        fmu.freeFMUState(state)
        return np.frombuffer(result[-size:], np.uint8).copy()


def _device(code: str) -> str:
    """Functions of the device; what C converts and C++ does not."""
    code = re.sub(r"\bPY_APART\b ?", "", code)
    code = _STATIC.sub(
        lambda m: f"{'DATA' if '=' in m[1] else 'DEVICE'} static {m[1]}", code
    )
    # what a function remembers would be shared by all threads: it is not there, and
    # fails
    code = _MEMORY.sub(r"    \1 \2; failed(PY_RUNTIME_ERROR);", code)
    return re.sub(r"\bif \(PY_TRY\(\w+\)\)", "if (true)", code)
