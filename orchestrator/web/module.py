"""Compile loops to one WebAssembly module with the package ziglang's C compiler."""

from __future__ import annotations

import hashlib
import os
import subprocess
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from importlib.resources import files
from pathlib import Path

from desat.fmus import native
from desat.fmus.compiler import NoCompilerError, zig

from ..export.loop_fmu import LoopSource
from ..files import io
from ..system.errors import DesatError

_ASIDE = ("-O3", "-fPIC", "-fvisibility=hidden")
# The last three enable setjmp and longjmp: a failure of a block becomes an exception of
# WebAssembly.
_TARGET = (
    "-target",
    "wasm32-wasi",
    "-O2",
    "-mexception-handling",
    "-mllvm",
    "-wasm-enable-sjlj",
)
_LINK = ("-mexec-model=reactor", "-Wl,-z,stack-size=524288", "-Wl,--strip-all")
_FLAGS = (*_TARGET, *(f for f in native.FLAGS if f not in _ASIDE))
_SHARED = ("block.h", "runtime.c")


def need_compiler() -> None:
    """Raise DesatError if there is no compiler for WebAssembly."""
    try:
        zig()
    except NoCompilerError:
        raise DesatError(
            "a page is compiled by the package ziglang, which is not here: "
            "`pip install 'desat[web]'`"
        ) from None


def sources(loops: Sequence[LoopSource]) -> dict[str, str]:
    """Return the C files of a module of these loops, by name."""
    texts = {
        name: (native.WRAPPER / name).read_text(encoding="utf-8") for name in _SHARED
    }
    texts["shim.c"] = (files(__package__) / "shim.c").read_text(encoding="utf-8")
    names = [f"desat_loop_{i}_block" for i in range(len(loops))]
    texts["loops.h"] = "".join(
        f"extern const block_description {name};\n" for name in names
    ) + (
        "static const block_description *const web_loops[] = { "
        f"{', '.join(f'&{name}' for name in names)} }};\n"
    )
    for i, (loop, name) in enumerate(zip(loops, names, strict=True)):
        texts[f"loop_{i}.c"] = loop.loop.replace("desat_the_block", name)
        texts |= {f"{block}.c": text for block, text in loop.blocks.items()}
    return texts


def digest(texts: dict[str, str]) -> str:
    """Compute the sha256 of C files and of how they are compiled."""
    hashed = hashlib.sha256(" ".join((*_FLAGS, *_LINK)).encode())
    for name, text in sorted(texts.items()):
        hashed.update(f"\0{name}\0{text}".encode())
    return hashed.hexdigest()


def compiled(texts: dict[str, str]) -> bytes:
    """Compile C files to a module and return its bytes.

    Raises
    ------
    DesatError
        If there is no compiler, or it does not compile a file.
    """
    need_compiler()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for name, text in texts.items():
            io.replace_text(folder / name, text)
        units = sorted(name.removesuffix(".c") for name in texts if name.endswith(".c"))

        def one(unit: str) -> None:
            """Compile one C file."""
            _run([*zig(), *_FLAGS, "-c", f"{unit}.c", "-o", f"{unit}.o"], folder)

        one(units[0])  # the first fills the compiler's cache for the others
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(one, units[1:]))
        objects = [f"{unit}.o" for unit in units]
        _run([*zig(), *_TARGET, *_LINK, *objects, "-o", "loops.wasm"], folder)
        return (folder / "loops.wasm").read_bytes()


def fill_cache() -> None:
    """Compile an empty module where there is a compiler.

    It builds its C library for WebAssembly once, which the first page would wait for.
    """
    with suppress(DesatError):
        compiled({"empty.c": "int desat_empty(void) { return 0; }\n"})


def _run(command: Sequence[str], folder: Path) -> None:
    """Run the compiler, or raise DesatError with its message."""
    process = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, check=False
    )
    if process.returncode:
        native.check_room(process.stderr, "compiler zig")
        lines = (process.stderr.strip() or "no word").splitlines()
        raise DesatError(f"zig does not compile {command[-1]}: {lines[0]}")


if __name__ == "__main__":
    fill_cache()
