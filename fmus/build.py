"""`python -m desat.fmus.build [NAME ...]`: build the FMUs of blocks into fmus/dist/.

Each block gets up to three FMUs:

- dist/NAME.fmu is the Python one. pythonfmu builds it in a process of its own; it is
  then packed anew with our model description and documentation, entries sorted,
  deflated and dated 1980, so that the same sources give the same bytes. It ships the
  block, the modules that the block imports and the adapter in a package whose name is a
  hash of its contents: FMUs share one interpreter, and equal names would share code.
- dist/native/NAME.fmu is the native one, for a block in the subset that translates to C
  (`native.py`).
- dist/fmi3/NAME.fmu is the native one as FMI 3.0 (`fmi3.py`).

dist/index.json lists them. An FMU whose sources are unchanged is not built again.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import inspect
import io
import json
import os
import sys
import tempfile
import time
import uuid
import zipfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from importlib.metadata import version
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pythonfmu
from rich.progress import track

from . import fmi3, interfaces, meaning, native
from .compiler import NoCompilerError, compiler
from .description import (
    DATE,
    ICON,
    LICENCE,
    documentation,
    licence,
    model_description,
)
from .meaning import COMPONENTS, sources
from .own import OwnBlockError, identifier, is_own, shipped_text
from .registry import block_class, names

HERE = Path(__file__).parent
DIST = HERE / "dist"
INDEX = "index.json"

ENTRY = '''"""Entry of the FMU {name}: the block behind the adapter, both from {package}.

pythonfmu runs this file once more for each instance, keeps whatever class it makes then, and puts
the folder of this file before the others of sys.path.
"""

try:
    {block}Fmu = {block}Fmu
    sys.path[:] = dict.fromkeys(sys.path)
except NameError:
    import sys

    from {package}.blocks.{name} import {block}
    from {package}.slave import Slave

    class {block}Fmu(Slave):
        block_class = {block}

        def model_identifier(self):
            return "{name}"
'''


def contents(block_ref: str) -> dict[str, bytes]:
    """Return the files of a block's package, adapter included, by their path.

    Raises
    ------
    OwnBlockError
        If a user's own file is no block.
    """
    files = {
        p.relative_to(COMPONENTS).as_posix(): p.read_bytes() for p in sources(block_ref)
    }
    if is_own(block_ref):
        files[f"blocks/{identifier(block_ref)}.py"] = shipped_text(block_ref).encode()
    files["slave.py"] = (HERE / "slave.py").read_bytes()
    return dict(sorted(files.items()))


def build(block_ref: str, dist: Path = DIST) -> Path:
    """Build the Python FMU of a block in this process and return its path.

    `block_ref` is the name of a block of the project or a user's own file.
    """
    block, name = block_class(block_ref), identifier(block_ref)
    files = contents(block_ref)
    digest = hashlib.sha256(f"{name} {pythonfmu.__version__}".encode())
    for path, data in files.items():
        digest.update(f"\0{path}\0{len(data)}\0".encode() + data)
    package = f"desat_{digest.hexdigest()[:16]}"
    guid = str(uuid.UUID(bytes=digest.digest()[:16]))

    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        for path, data in files.items():
            target = root / package / path
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(data)
        script = root / f"{name}_{digest.hexdigest()[:16]}.py"
        script.write_text(
            ENTRY.format(name=name, package=package, block=block.__name__),
            encoding="utf-8",
        )
        sys.dont_write_bytecode = True
        with contextlib.redirect_stdout(io.StringIO()):
            raw = pythonfmu.FmuBuilder.build_FMU(
                script, dest=root / "raw.fmu", project_files=[root / package]
            )
        with zipfile.ZipFile(raw) as archive:
            members = {
                n: archive.read(n) for n in archive.namelist() if "__pycache__" not in n
            }
    members["modelDescription.xml"] = model_description(
        block, name, f"{{{guid}}}", DATE, version("desat")
    )
    members["documentation/index.html"] = documentation(block, name).encode()
    members |= licence(block)
    members["model.png"] = ICON.read_bytes()
    dist.mkdir(parents=True, exist_ok=True)
    return native.pack(members, dist / f"{name}.fmu")


@contextlib.contextmanager
def without_fmus_on_the_path() -> Iterator[None]:
    """Remove the folders of loaded FMUs from sys.path within the context.

    Processes that are started would otherwise import an FMU's own pythonfmu, which
    lacks the binaries that an FMU needs.
    """
    before = list(sys.path)
    sys.path[:] = [p for p in before if not (Path(p) / "slavemodule.txt").is_file()]
    try:
        yield
    finally:
        sys.path[:] = before


def build_all(block_refs: tuple[str, ...], dist: Path = DIST) -> list[Path]:
    """Build the Python FMUs of some blocks, each in a process of its own."""
    with (
        without_fmus_on_the_path(),
        ProcessPoolExecutor(
            os.cpu_count(), mp_context=get_context("spawn"), max_tasks_per_child=1
        ) as pool,
    ):
        results = pool.map(build, block_refs, [dist] * len(block_refs))
        return list(
            track(
                results,
                "FMUs",
                total=len(block_refs),
                transient=True,
                disable=not sys.stderr.isatty(),
            )
        )


def build_native(
    block_refs: tuple[str, ...],
    dist: Path,
    targets: Sequence[native.Target] = (native.HERE_ALONE,),
) -> dict[str, str]:
    """Build the native FMUs of some blocks below `dist`.

    Returns
    -------
    dict
        For each block without a native FMU the reason.

    Raises
    ------
    NoCompilerError
        If there is no C compiler.
    """
    with tempfile.TemporaryDirectory() as shared:
        native.compile_wrapper(Path(shared), targets)
        with ProcessPoolExecutor(
            os.cpu_count(), mp_context=get_context("spawn")
        ) as pool:
            n = len(block_refs)
            results = pool.map(
                native.try_build,
                block_refs,
                [dist / "native"] * n,
                [Path(shared)] * n,
                [targets] * n,
            )
            progress = track(
                results,
                "native FMUs",
                total=n,
                transient=True,
                disable=not sys.stderr.isatty(),
            )
            return {
                name: reason
                for name, reason in zip(block_refs, progress, strict=True)
                if reason
            }


def _digest(block_ref: str) -> str:
    """Compute the digest of what both FMUs of a block are made of."""
    versions = f"{pythonfmu.__version__} {version('desat')}"
    digest = hashlib.sha256(f"{identifier(block_ref)} {versions}".encode())
    for path, data in contents(block_ref).items():
        digest.update(f"\0{path}\0{len(data)}\0".encode() + data)
    for text in (inspect.getsource(build), ENTRY, inspect.getsource(native.pack)):
        digest.update(text.encode())
    for file in (HERE / "description.py", ICON, LICENCE):
        digest.update(file.read_bytes())
    return digest.hexdigest()


def _entry(
    kind: str, name: str, dist: Path, made_of: str, reason: str
) -> dict[str, Any]:
    """Return the index entry of an FMU."""
    path = dist / ("" if kind == "python" else kind) / f"{name}.fmu"
    data = path.read_bytes()
    with zipfile.ZipFile(path) as archive:
        platforms = sorted(
            {n.split("/")[1] for n in archive.namelist() if n.startswith("binar")}
        )
    entry = {
        "name": name,
        "kind": kind,
        "file": path.relative_to(dist).as_posix(),
        "platforms": platforms,
        "bytes": len(data),
        "sha256": hashlib.sha256(data).hexdigest(),
        "made_of": made_of,
    }
    return {**entry, "why": reason} if reason else entry


def _build_digest(platforms: str) -> str:
    """Return the digest of the native build, or "" without a compiler."""
    try:
        return native.made_of(native.targets_of(platforms)).hex()
    except NoCompilerError:
        return ""


def _native_digest(digest: str, build_digest: str) -> str:
    """Compute the digest of a native FMU from those of block and build."""
    return hashlib.sha256((digest + build_digest).encode()).hexdigest()


def made_of(block_ref: str, platforms: str = "") -> str:
    """Compute a hash of all that the FMUs of a block are made of on this machine.

    Raises
    ------
    OwnBlockError
        If a user's own file is no block.
    """
    return _native_digest(_digest(block_ref), _build_digest(platforms))


def update(
    block_refs: tuple[str, ...], dist: Path, platforms: str = ""
) -> list[dict[str, Any]]:
    """Build the missing or outdated FMUs of some blocks; write and return the index.

    `platforms` is as in `native.targets_of`.
    """
    build_digest = _build_digest(platforms)
    block_ref_of = {identifier(block_ref): block_ref for block_ref in block_refs}
    try:
        old_index = json.loads((dist / INDEX).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        old_index = []
    entries_kept = {
        (e["kind"], e["name"]): e
        for e in old_index
        if e["name"] in {*names(), *block_ref_of}
    }

    def is_current(kind: str, name: str, made_of: str) -> bool:
        """Return whether an FMU is there, unchanged and made of the same."""
        e = entries_kept.get((kind, name))
        path = dist / e["file"] if e else dist
        return bool(
            e
            and e["made_of"] == made_of
            and path.is_file()
            and hashlib.sha256(path.read_bytes()).hexdigest() == e["sha256"]
        )

    digests = {name: _digest(block_ref) for name, block_ref in block_ref_of.items()}
    anew = hashlib.sha256((HERE / "fmi3.py").read_bytes()).hexdigest()
    both = {name: _native_digest(digests[name], build_digest) for name in block_ref_of}
    old = tuple(
        name for name in block_ref_of if not is_current("python", name, digests[name])
    )
    if old:
        build_all(tuple(block_ref_of[name] for name in old), dist)
        for name in old:
            entries_kept["python", name] = _entry(
                "python", name, dist, digests[name], ""
            )
        _write(entries_kept, dist)  # saved now because compiling may be interrupted
    todo, reasons = _select_native(
        block_ref_of, entries_kept, both, build_digest, is_current
    )
    if todo:
        build_reasons = build_native(todo, dist, native.targets_of(platforms))
        reasons |= {
            identifier(block_ref): text for block_ref, text in build_reasons.items()
        }
    for name, block_ref in block_ref_of.items():
        old_entry = entries_kept.get(("python", name), {})
        meaning_entry = (
            {k: old_entry[k] for k in ("computes", "files", "files_sha256")}
            if (meaning.is_as(old_entry))
            else meaning.index_entry(block_ref)
        )
        entries_kept["python", name] = {
            **_entry("python", name, dist, digests[name], reasons.get(name, "")),
            "with": both[name],
            **meaning_entry,
        }
        if name in reasons:
            for kind in ("native", "fmi3"):
                entries_kept.pop((kind, name), None)
                (dist / kind / f"{name}.fmu").unlink(missing_ok=True)
            continue
        compiled_by = (
            f"ziglang {version('ziglang')}" if platforms else native.compiler_version()
        )
        of_c = {"computes": meaning_entry["computes"], "compiler": compiled_by}
        entries_kept["native", name] = {
            **_entry("native", name, dist, both[name], ""),
            **of_c,
        }
        third = _native_digest(both[name], anew)
        if not is_current("fmi3", name, third):
            path = dist / entries_kept["native", name]["file"]
            fmi3.repack(path, block_class(block_ref), dist / "fmi3" / path.name)
        entries_kept["fmi3", name] = {**_entry("fmi3", name, dist, third, ""), **of_c}
    return _write(entries_kept, dist)


def _select_native(
    block_ref_of: dict[str, str],
    entries: dict[tuple[str, str], dict[str, Any]],
    native_digests: dict[str, str],
    build_digest: str,
    is_current: Callable[[str, str, str], bool],
) -> tuple[tuple[str, ...], dict[str, str]]:
    """Return the blocks to compile, and by name why others get no native FMU."""
    if not build_digest:
        return (), dict.fromkeys(block_ref_of, "no C compiler where it was built")
    old_reasons = {}
    for name in block_ref_of:
        entry = entries.get(("python", name), {})
        if entry.get("why") and entry.get("with") == native_digests[name]:
            old_reasons[name] = entry["why"]
    todo = tuple(
        block_ref
        for name, block_ref in block_ref_of.items()
        if name not in old_reasons
        and not is_current("native", name, native_digests[name])
    )
    return todo, old_reasons


def _write(
    entries: dict[tuple[str, str], dict[str, Any]], dist: Path
) -> list[dict[str, Any]]:
    """Write and return the index: native before FMI 3.0 before Python."""
    order = ("native", "fmi3", "python")
    index = [
        entries[key] for key in sorted(entries, key=lambda k: (k[1], order.index(k[0])))
    ]
    (dist / INDEX).write_text(json.dumps(index, indent=1) + "\n", encoding="utf-8")
    return index


def _unusable(block_refs: tuple[str, ...]) -> dict[str, str]:
    """Return the blocks that cannot become FMUs, each with a one-line reason."""
    wrong = {}
    for name in block_refs:
        try:
            block_class(name)
        except OwnBlockError as error:
            wrong[name] = str(error)
        except Exception as error:
            text = " ".join(f"{type(error).__name__}: {error}".split())
            wrong[name] = f"components/blocks/{name}.py: {text}"
    return wrong


def _print_table(index: list[dict[str, Any]]) -> None:
    """Print a line for each block: the sizes of its native and Python FMU in kB.

    A block without a native FMU has the reason instead.
    """
    by_name: dict[str, dict[str, dict[str, Any]]] = {}
    for e in index:
        by_name.setdefault(e["name"], {})[e["kind"]] = e
    print(f"{'block':28} {'native':>7} {'Python':>7}  kB")
    for name, kinds in by_name.items():
        size = f"{kinds['native']['bytes'] / 1e3:.0f}" if "native" in kinds else "-"
        reason = kinds["python"].get("why", "")
        print(
            f"{name:28} {size:>7} {kinds['python']['bytes'] / 1e3:>7.0f}  {reason}".rstrip()
        )


def _parse_arguments() -> argparse.Namespace:
    """Read the blocks and options from the command line."""
    parser = argparse.ArgumentParser(
        description="Build the FMUs of the blocks into fmus/dist/."
    )
    parser.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help="blocks, or files of your own (default: all of ours)",
    )
    parser.add_argument(
        "--into", type=Path, help="another folder, and nothing else is written"
    )
    parser.add_argument(
        "--platforms", default="", help="all, or linux64,win64,...: for these"
    )
    return parser.parse_args()


def _remove_stale(dist: Path, index: list[dict[str, Any]]) -> None:
    """Delete FMUs that the index lacks, and files of builds that were interrupted."""
    for stale in {
        path
        for folder in ("", "native/", "fmi3/")
        for path in dist.glob(f"{folder}*.fmu")
    } - {dist / e["file"] for e in index}:
        stale.unlink()
    for partial_file in dist.rglob(
        "*.part"
    ):  # left by a build that was killed; a running build writes its own quickly
        if time.time() - partial_file.stat().st_mtime > 60.0:
            partial_file.unlink(missing_ok=True)


def main() -> int:
    """Build all blocks, or those named on the command line; return the exit code."""
    arguments = _parse_arguments()
    try:
        native.targets_of(arguments.platforms)
    except (NoCompilerError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    block_refs = tuple(arguments.names) or names()
    own_blocks = [block_ref for block_ref in block_refs if is_own(block_ref)]
    if own_blocks and arguments.into is None:
        print(
            f"error: {own_blocks[0]}: --into is needed: fmus/dist/ holds ours alone",
            file=sys.stderr,
        )
        return 2
    if unknown := sorted({*block_refs} - {*own_blocks, *names()}):
        print(
            f"error: no block {', '.join(unknown)}; blocks are {', '.join(names())}",
            file=sys.stderr,
        )
        return 2
    dist, is_complete = arguments.into or DIST, len(block_refs) == len(names())
    for problem in (wrong := _unusable(block_refs)).values():
        print(f"error: {problem}", file=sys.stderr)
    block_refs = tuple(name for name in block_refs if name not in wrong)
    index = update(block_refs, dist, arguments.platforms)
    if arguments.into is None and is_complete and not wrong:
        _remove_stale(dist, index)
        interfaces.write()
    built_names = {
        Path(block_ref).stem if is_own(block_ref) else block_ref
        for block_ref in block_refs
    }
    if arguments.names:
        _print_table([e for e in index if e["name"] in built_names])
    of = {kind: sum(e["kind"] == kind for e in index) for kind in ("native", "fmi3")}
    print(
        f"{len(index)} FMUs in {os.path.relpath(dist)}, {of['native']} of them native, "
        f"{of['fmi3']} native ones of FMI 3.0"
    )
    try:
        compiler()
    except NoCompilerError as error:
        print(
            f"warning: {error}. Only the FMUs of Python were built: they need a Python where "
            "they run, and run slower.",
            file=sys.stderr,
        )
    return min(len(wrong), 1)


if __name__ == "__main__":
    sys.exit(main())
