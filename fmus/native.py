"""Build native FMUs: a block's C, compiled with the FMI wrapper and packed.

The C is translated from the block's Python. Native FMUs need no Python where they run,
only libc and libm, and carry their sources. On one machine they give the same bits as
the Python FMUs; `translate` refuses what it cannot make so.
"""

from __future__ import annotations

import errno
import hashlib
import os
import shutil
import struct
import subprocess
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path

from .compiler import compiler, zig
from .description import DATE, ICON, documentation, licence, model_description
from .own import identifier
from .registry import block_class
from .translate.program import translate
from .translate.types import SubsetError

HERE = Path(__file__).parent
WRAPPER = HERE / "c"
# C files that every library has besides its block; they implement both FMI 2.0 and FMI
# 3.0
UNITS = tuple(sorted(p.stem for p in WRAPPER.glob("*.c")))
# The arithmetic flags make the bits equal; they do not hinder the optimiser.
FLAGS = (
    "-std=c11",
    "-O3",
    "-fPIC",
    "-fvisibility=hidden",
    "-ffp-contract=off",  # no a * b + c in one rounding
    "-fno-builtin-pow",  # pow(x, 2.0) is not x * x to the last bit
    "-fno-math-errno",
    "-fno-trapping-math",  # a root or a choice need not be a call or a jump
    "-fwrapv",
    "-Werror=incompatible-pointer-types",
    "-Werror=int-conversion",
)
# The only list of blocks that stay Python, with the reason. Any other block is native,
# or `make check` fails.
PINNED = {
    "environment_tle": "SGP4 is the package sgp4's",
}

LINK = ("-shared", "-s", "-Wl,--build-id=none", "-Wl,-z,defs")


@cache
def compiler_version() -> str:
    """Return the first line of the compiler's version text."""
    process = subprocess.run(
        [*compiler(), "--version"], capture_output=True, text=True, check=True
    )
    return process.stdout.partition("\n")[0]


def platform() -> str:
    """Return FMI's name of this machine's platform."""
    system = {"linux": "linux", "darwin": "darwin", "win32": "win"}[sys.platform]
    return f"{system}{64 if sys.maxsize > 2**32 else 32}"


def library_suffix() -> str:
    """Return the suffix of shared libraries on this machine."""
    return {"linux": ".so", "darwin": ".dylib", "win32": ".dll"}[sys.platform]


@dataclass(frozen=True)
class Target:
    """A platform that libraries are compiled for.

    It has FMI's name of the platform and zig's name of the target (`triple`). Without
    `triple` this machine's compiler is used.
    """

    platform: str
    suffix: str
    triple: str = ""
    link: tuple[str, ...] = ("-shared", "-s")

    @property
    def compiler(self) -> tuple[str, ...]:
        """Return the compiler's command, or raise NoCompilerError."""
        return (*zig(), "-target", self.triple) if self.triple else compiler()


HERE_ALONE = Target(platform(), library_suffix(), link=LINK)
# Platforms that the package ziglang compiles for; linux64 runs with glibc from 2012 on
# (2.17).
EVERYWHERE = (
    Target("linux64", ".so", "x86_64-linux-gnu.2.17", LINK),
    Target("win64", ".dll", "x86_64-windows-gnu"),
    Target("darwin64", ".dylib", "x86_64-macos"),
    Target("darwin64", ".dylib", "aarch64-macos"),
    Target("aarch64-linux", ".so", "aarch64-linux-gnu.2.17", LINK),
)
_PAGE = 1 << 14


def targets_of(platforms: str) -> tuple[Target, ...]:
    """Return the targets that a list of platforms names.

    Parameters
    ----------
    platforms
        "" for this machine, "all", or names separated by commas.

    Raises
    ------
    NoCompilerError
        If the package ziglang is missing and other platforms are named.
    ValueError
        If a platform is unknown.
    """
    if not platforms:
        return (HERE_ALONE,)
    zig()
    platform_names = dict.fromkeys(t.platform for t in EVERYWHERE)
    names = list(platform_names) if platforms == "all" else platforms.split(",")
    if wrong := [p for p in names if p not in platform_names]:
        raise ValueError(
            f"platform {wrong[0]}: there is all, {', '.join(platform_names)}"
        )
    return tuple(t for t in EVERYWHERE if t.platform in names)


def made_of(targets: Sequence[Target] = (HERE_ALONE,)) -> bytes:
    """Compute a digest of what native FMUs are made of besides their blocks.

    Raises
    ------
    NoCompilerError
        If there is no C compiler.
    """
    by = (
        [compiler_version()]
        if HERE_ALONE in targets
        else [version("ziglang"), repr(targets)]
    )
    digest = hashlib.sha256(" ".join((*FLAGS, *LINK, *by)).encode())
    translator = sorted((HERE / "translate").glob("*.py"))
    for path in (*sorted(WRAPPER.iterdir()), *translator, HERE / "native.py"):
        digest.update(path.read_bytes())
    return digest.digest()


def sources(block_ref: str) -> tuple[dict[str, str], str]:
    """Return the C files of a block by name, and the GUID that they give.

    Raises
    ------
    SubsetError
        If the block leaves the subset.
    """
    block, name = block_class(block_ref), identifier(block_ref)
    description = model_description(block, name, "", DATE, version("desat"))
    return with_wrapper({f"{name}.c": translate(block, name, "@GUID@")}, description)


def with_wrapper(
    own_files: dict[str, str], description: bytes
) -> tuple[dict[str, str], str]:
    """Add the wrapper's files to C files, put the GUID in, and return both.

    `own_files` are C files, one of which has `@GUID@` in place of its GUID. The GUID follows
    from the files and a model description without one.
    """
    files = {
        p.name: p.read_text(encoding="utf-8") for p in sorted(WRAPPER.iterdir())
    } | own_files
    digest = hashlib.sha256(" ".join(FLAGS).encode())
    digest.update(description)
    for file, text in sorted(files.items()):
        digest.update(f"\0{file}\0".encode() + text.encode())
    guid = f"{{{uuid.UUID(bytes=digest.digest()[:16])}}}"
    return {file: text.replace("@GUID@", guid) for file, text in files.items()}, guid


# messages of compilers that cannot write, and the error number of each
_NO_ROOM = {
    "No space left on device": errno.ENOSPC,
    "NoSpaceLeft": errno.ENOSPC,
    "Disk quota exceeded": errno.EDQUOT,
    "File too large": errno.EFBIG,
    "FileTooBig": errno.EFBIG,
    "File size limit exceeded": errno.EFBIG,
}


def check_room(message: str, target: str) -> None:
    """Raise OSError if a compiler's message says that the disk is full.

    `target` is the error's file.
    """
    for text, number in _NO_ROOM.items():
        if text in message:
            raise OSError(number, os.strerror(number), target)


def _run_compiler(command: list[str], folder: Path) -> None:
    """Run a compiler, or raise an error with its message."""
    process = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, check=False
    )
    if process.returncode:
        check_room(process.stderr, f"compiler {command[0]}")
        raise RuntimeError(f"{' '.join(command)}: {process.stderr.strip()[:2000]}")


def compile_wrapper(shared: Path, targets: Sequence[Target] = (HERE_ALONE,)) -> None:
    """Compile the files that all blocks share into the folder `shared`."""
    for target in targets:
        folder = shared / target.triple
        folder.mkdir(exist_ok=True)
        for path in WRAPPER.iterdir():
            (folder / path.name).write_bytes(path.read_bytes())
        for name in UNITS:
            _run_compiler(
                [*target.compiler, *FLAGS, "-c", f"{name}.c", "-o", f"{name}.o"], folder
            )


def compile_block(
    files: dict[str, str],
    name: str,
    folder: Path,
    shared: Path,
    target: Target = HERE_ALONE,
) -> Path:
    """Compile the C of a block or of a loop of blocks and return its library.

    It is linked with the objects that `compile_wrapper` has put into `shared`; the
    library is in `folder`.
    """
    shared_objects = [f"{unit}.o" for unit in UNITS]
    for file in shared_objects:
        shutil.copy(shared / target.triple / file, folder / file)
    own_files = [
        file for file in files if not (WRAPPER / file).exists() or file.endswith(".h")
    ]
    for file in own_files:
        (folder / file).write_text(files[file], encoding="utf-8")
    units = [file.removesuffix(".c") for file in own_files if file.endswith(".c")]

    def one(unit: str) -> None:
        """Compile one C file."""
        _run_compiler(
            [*target.compiler, *FLAGS, "-c", f"{unit}.c", "-o", f"{unit}_.o"], folder
        )

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(one, units))
    library = f"{name}{target.suffix}"
    objects = [*(f"{unit}_.o" for unit in units), *shared_objects]
    _run_compiler(
        [*target.compiler, *target.link, *objects, "-lm", "-o", library], folder
    )
    return folder / library


def build(
    block_ref: str, dist: Path, shared: Path, targets: Sequence[Target] = (HERE_ALONE,)
) -> Path:
    """Build the native FMU of a block and return its path.

    Parameters
    ----------
    block_ref
        Name of a block of the project, or a user's own file.
    dist
        Folder of the FMU.
    shared
        Folder that `compile_wrapper` has filled.
    targets
        Platforms to compile for.

    Raises
    ------
    SubsetError
        If the block leaves the subset.
    NoCompilerError
        If there is no C compiler.
    """
    files, guid = sources(block_ref)
    block, name = block_class(block_ref), identifier(block_ref)
    units = sorted(f for f in files if f.endswith(".c"))
    description = model_description(
        block, name, guid, DATE, version("desat"), sources=units
    )
    dist.mkdir(parents=True, exist_ok=True)
    page = documentation(block, name)
    file, further = dist / f"{name}.fmu", licence(block)
    return assemble(files, name, description, page, shared, file, targets, further)


def assemble(
    files: dict[str, str],
    name: str,
    description: bytes,
    page: str,
    shared: Path,
    file: Path,
    targets: Sequence[Target] = (HERE_ALONE,),
    further: Mapping[str, bytes] | None = None,
) -> Path:
    """Compile and pack a native FMU and return its path.

    Parameters
    ----------
    files
        C files by their name.
    name
        Name of the FMU.
    description
        Model description as XML.
    page
        Documentation as HTML.
    shared
        Folder that `compile_wrapper` has filled.
    file
        Path of the FMU.
    targets
        Platforms to compile for.
    further
        Further members of the archive.

    Raises
    ------
    NoCompilerError
        If there is no C compiler.
    """
    by_platform: dict[str, list[bytes]] = {}
    for target in targets:
        with tempfile.TemporaryDirectory() as folder:
            library = compile_block(files, name, Path(folder), shared, target)
            member = f"binaries/{target.platform}/{library.name}"
            by_platform.setdefault(member, []).append(
                zero_link_time(library.read_bytes())
            )
    members = {
        "modelDescription.xml": description,
        "documentation/index.html": page.encode(),
        **(further or {}),
        "model.png": ICON.read_bytes(),
        **{member: universal(binaries) for member, binaries in by_platform.items()},
        **{f"sources/{file}": text.encode() for file, text in files.items()},
    }
    return pack(members, file)


def zero_link_time(library: bytes) -> bytes:
    """Return a library with its link time set to zero, which Windows ones have."""
    if library[:2] != b"MZ":
        return library
    (header,) = struct.unpack_from("<I", library, 60)
    return library[: header + 8] + bytes(4) + library[header + 12 :]


def universal(binaries: Sequence[bytes]) -> bytes:
    """Join macOS libraries for several processors to one, each on its own page.

    A single library is returned unchanged.
    """
    if len(binaries) == 1:
        return binaries[0]
    at = _PAGE
    head, body = struct.pack(">II", 0xCAFEBABE, len(binaries)), b""
    for binary in binaries:
        processor, kind = struct.unpack_from("<II", binary, 4)
        head += struct.pack(
            ">IIIII", processor, kind, at, len(binary), _PAGE.bit_length() - 1
        )
        padding = -len(binary) % _PAGE
        body += binary + bytes(padding)
        at += len(binary) + padding
    return head + bytes(_PAGE - len(head)) + body


def try_build(
    block_ref: str, dist: Path, shared: Path, targets: Sequence[Target] = (HERE_ALONE,)
) -> str:
    """Build the native FMU of a block; return the reason if there is none, or ""."""
    if block_ref in PINNED:
        return PINNED[block_ref]
    try:
        build(block_ref, dist, shared, targets)
    except SubsetError as refused:
        return str(refused)
    except (
        ArithmeticError,
        AttributeError,
        LookupError,
        RuntimeError,
        TypeError,
        ValueError,
    ) as e:
        return f"a bug of the translator: {type(e).__name__}: {e}"
    return ""


def pack(members: dict[str, bytes], target: Path) -> Path:
    """Write an archive whose bytes follow from its contents alone.

    Entries are sorted, deflated and dated 1980.
    """
    part = target.with_name(f"{target.name}.{os.getpid()}.part")
    with zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for member, data in sorted(members.items()):
            info = zipfile.ZipInfo(member)
            info.create_system, info.external_attr = 3, 0o644 << 16
            info.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(info, data)
    part.replace(target)
    return target
