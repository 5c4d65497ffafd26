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

# Machine of the platform -> that of ELF.
_MACHINES = {"x86_64": "EM_X86_64", "aarch64": "EM_AARCH64"}
# Libraries that every Linux has, which need no look.
_USUAL = (
    "libc.so.",
    "libm.so.",
    "libpthread.so.",
    "libdl.so.",
    "librt.so.",
    "ld-linux",
)
_GLIBC = "GLIBC_"
# Program that loads system libraries, and prints the name of each that is missing.
_LOADER = """
import ctypes, sys
for name in sys.argv[1:]:
    try:
        ctypes.CDLL(name)
    except OSError:
        print(name)
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
    dynamic = elf.get_section_by_name(".dynamic")
    needed = [t.needed for t in dynamic.iter_tags("DT_NEEDED")] if dynamic else []
    if missing := _missing(needed, folder):
        return f"it needs {', '.join(missing)}, which is not here"
    if version := _too_new(elf):
        return f"it needs {version}; here is {_GLIBC}{platform.libc_ver()[1]}"
    return ""


def _missing(needed: Iterable[str], folder: Path) -> list[str]:
    """Return the libraries that are neither in a folder nor of the system."""
    names = [
        name
        for name in needed
        if not name.startswith(_USUAL) and not (folder / name).exists()
    ]
    if not names:
        return []
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", _LOADER, *names],
        capture_output=True,
        text=True,
        check=False,
    )
    return done.stdout.split()


def _too_new(elf: Any) -> str:
    """Return the version of glibc that a library needs, if it is newer than ours."""
    here = _numbers(platform.libc_ver()[1])
    section = elf.get_section_by_name(".gnu.version_r")
    if section is None or not here:
        return ""
    versions = [
        entry.name
        for _, entries in section.iter_versions()
        for entry in entries
        if entry.name.startswith(_GLIBC)
    ]
    newest = max(versions, key=lambda v: _numbers(v.removeprefix(_GLIBC)), default="")
    return newest if _numbers(newest.removeprefix(_GLIBC)) > here else ""


def _numbers(version: str) -> tuple[int, ...]:
    """Return the numbers of a version; empty where it has others than digits."""
    parts = version.split(".")
    return tuple(map(int, parts)) if all(p.isdigit() for p in parts) else ()
