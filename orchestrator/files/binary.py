"""Read why an FMU's library could not be loaded, without loading it.

Loading it would run its code. Only libraries of Linux (ELF) are read.
"""

from __future__ import annotations

import platform
import subprocess
import sys
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import Any

_NONE: frozenset[str] = frozenset()
_WEAK = 2  # flag of a version that may be missing (VER_FLG_WEAK)
# Machine of the platform -> that of ELF.
_MACHINES = {"x86_64": "EM_X86_64", "aarch64": "EM_AARCH64"}
# Program that loads system libraries, and prints the file of each; an empty line for one
# that is missing. The second value of the linker's entry is the file's name.
_LOADER = """
import ctypes, sys
where, of_linker = ctypes.c_void_p(), 2  # RTLD_DI_LINKMAP
for name in sys.argv[1:]:
    try:
        handle = ctypes.c_void_p(ctypes.CDLL(name)._handle)
    except OSError:
        print()
        continue
    ctypes.CDLL(None).dlinfo(handle, of_linker, ctypes.byref(where))
    file = ctypes.cast(where.value, ctypes.POINTER(ctypes.c_char_p))[1]
    print(file.decode(errors="surrogateescape"))
"""


@lru_cache(maxsize=256)
def loading_fault(library: Path, functions: tuple[str, ...]) -> str:
    """Return why a library could not be loaded here, or an empty text.

    Parameters
    ----------
    library
        The file, with those that it needs beside it.
    functions
        Names of functions that it must export.
    """
    if not sys.platform.startswith("linux"):
        return ""
    from elftools.common.exceptions import ELFError
    from elftools.elf.elffile import ELFFile

    try:
        with library.open("rb") as stream:
            elf = ELFFile(stream)
            machine = elf["e_machine"]
            if machine != _MACHINES.get(platform.machine(), machine):
                return f"it is for {elf.get_machine_arch()}, not {platform.machine()}"
            if elf["e_type"] != "ET_DYN":
                return "it is no shared library"
            return _fault_of(elf, library.parent, functions)
    except (ELFError, OSError, ValueError, KeyError, AttributeError) as error:
        return f"it is no library of Linux ({error or type(error).__name__})"


def _fault_of(elf: Any, folder: Path, functions: Iterable[str]) -> str:
    """Return what a shared library lacks, or an empty text."""
    symbols = elf.get_section_by_name(".dynsym")
    exported = (
        {s.name for s in symbols.iter_symbols() if s["st_shndx"] != "SHN_UNDEF"}
        if symbols
        else set()
    )
    if lacking := [name for name in functions if name not in exported]:
        return f"it does not export {', '.join(lacking)}"
    return _dependency_fault(elf, folder)


def _dependency_fault(elf: Any, folder: Path, seen: frozenset[str] = _NONE) -> str:
    """Return which library, or version of one, a shared library lacks.

    Those beside it are looked at as well, except for those already `seen`.
    """
    from elftools.elf.elffile import ELFFile

    dynamic = elf.get_section_by_name(".dynamic")
    libraries = [t.needed for t in dynamic.iter_tags("DT_NEEDED")] if dynamic else []
    files = {name: str(folder / name) for name in libraries if (folder / name).exists()}
    others = tuple(sorted(set(libraries) - files.keys()))
    files |= zip(others, _find_libraries(others), strict=True)
    if missing := [name for name in libraries if not files[name]]:
        return f"it needs {', '.join(missing)}, which is not here"
    section = elf.get_section_by_name(".gnu.version_r")
    for library, entries in section.iter_versions() if section is not None else ():
        versions = _read_versions(files.get(library.name, ""))
        for entry in entries:
            is_weak = entry["vna_flags"] & _WEAK
            if versions and entry.name not in versions and not is_weak:
                kind = entry.name.rpartition("_")[0]
                of_kind = [v for v in versions if v.rpartition("_")[0] == kind]
                newest = max(of_kind, key=_numbers, default="none")
                return f"it needs {entry.name} of {library.name}; here is {newest}"
    neighbours = frozenset(libraries).difference(others)
    for name in sorted(neighbours - seen):
        with open(files[name], "rb") as stream:
            if fault := _dependency_fault(ELFFile(stream), folder, seen | neighbours):
                return f"{name}: {fault}"
    return ""


@lru_cache(maxsize=256)
def _find_libraries(names: tuple[str, ...]) -> list[str]:
    """Return the files of system libraries; an empty text for one that is missing."""
    listing = subprocess.run(
        [sys.executable, "-I", "-S", "-c", _LOADER, *names],
        capture_output=True,
        text=True,
        check=False,
    )
    return listing.stdout.splitlines()


@lru_cache(maxsize=256)
def _read_versions(library: str) -> frozenset[str]:
    """Return the versions that a shared library defines; none where it cannot be read."""
    from elftools.elf.elffile import ELFFile

    if not Path(library).is_file():
        return frozenset()
    with open(library, "rb") as stream:
        section: Any = ELFFile(stream).get_section_by_name(".gnu.version_d")
        definitions = section.iter_versions() if section is not None else ()
        return frozenset(next(names).name for _, names in definitions)


def _numbers(version: str) -> tuple[int, ...]:
    """Return the numbers of a version such as GLIBC_2.36; empty where it has others."""
    parts = version.rpartition("_")[2].split(".")
    return tuple(map(int, parts)) if all(p.isdigit() for p in parts) else ()
