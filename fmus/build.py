"""`python -m fmus.build [NAME ...]`: build the FMUs of the blocks into fmus/dist/.

Built by pythonfmu, each in a process of its own, then packed anew: our model description and
documentation, entries sorted, stored, dated 1980, so that the same sources give the same bytes.
An FMU ships the block, what it imports and the adapter in a package whose name is a hash of its
contents: FMUs share one interpreter, and equal names would share code.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import hashlib
import io
import os
import sys
import tempfile
import uuid
import zipfile
from concurrent.futures import ProcessPoolExecutor
from importlib.metadata import version
from multiprocessing import get_context
from pathlib import Path

import pythonfmu
from rich.progress import track

from . import interfaces
from .description import DATE, documentation, model_description
from .registry import block_class, names

HERE = Path(__file__).parent
DIST = HERE / "dist"
COMPONENTS = HERE.parent / "components"

ENTRY = '''"""Entry of the FMU {name}: the block behind the adapter, both from {package}."""

from {package}.blocks.{name} import {block}
from {package}.slave import Slave


class {block}Fmu(Slave):
    block_class = {block}

    def model_identifier(self):
        return "{name}"
'''


def sources(name: str) -> list[Path]:
    """The files that the block `name` needs, itself first, found through its imports."""
    todo, found = [COMPONENTS / "blocks" / f"{name}.py"], list[Path]()
    while todo:
        path = todo.pop()
        if path in found:
            continue
        found.append(path)
        if (initial := path.parent / "__init__.py").exists():
            todo.append(initial)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.level:
                base = path.parents[node.level - 1].joinpath(*(node.module or "").split("."))
                for candidate in (base, *(base / alias.name for alias in node.names)):
                    if candidate.with_suffix(".py").is_file():
                        todo.append(candidate.with_suffix(".py"))
    data = [p.with_suffix(".json") for p in found if p.with_suffix(".json").is_file()]
    return found + data


def contents(name: str) -> dict[str, bytes]:
    """Path in the package -> bytes, for the block `name`, the adapter included."""
    files = {p.relative_to(COMPONENTS).as_posix(): p.read_bytes() for p in sources(name)}
    files["slave.py"] = (HERE / "slave.py").read_bytes()
    return dict(sorted(files.items()))


def build(name: str, dist: Path = DIST) -> Path:
    """Build the FMU of the block `name` in this process and return its path."""
    block = block_class(name)
    files = contents(name)
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
            ENTRY.format(name=name, package=package, block=block.__name__), encoding="utf-8"
        )
        sys.dont_write_bytecode = True
        with contextlib.redirect_stdout(io.StringIO()):
            raw = pythonfmu.FmuBuilder.build_FMU(
                script, dest=root / "raw.fmu", project_files=[root / package]
            )
        with zipfile.ZipFile(raw) as archive:
            members = {n: archive.read(n) for n in archive.namelist() if "__pycache__" not in n}
    members["modelDescription.xml"] = model_description(
        block, name, f"{{{guid}}}", DATE, version("desat")
    )
    members["documentation/index.html"] = documentation(block, name).encode()
    dist.mkdir(parents=True, exist_ok=True)
    target, part = dist / f"{name}.fmu", dist / f"{name}.fmu.{os.getpid()}.part"
    with zipfile.ZipFile(part, "w", zipfile.ZIP_STORED) as archive:
        for member, data in sorted(members.items()):
            info = zipfile.ZipInfo(member)
            info.create_system, info.external_attr = 3, 0o644 << 16
            archive.writestr(info, data)
    part.replace(target)
    return target


def build_all(which: tuple[str, ...], dist: Path = DIST) -> list[Path]:
    """Build the FMUs of some blocks, each in a process of its own."""
    with ProcessPoolExecutor(
        os.cpu_count(), mp_context=get_context("spawn"), max_tasks_per_child=1
    ) as pool:
        results = pool.map(build, which, [dist] * len(which))
        return list(
            track(results, "FMUs", total=len(which), transient=True,
                  disable=not sys.stderr.isatty())
        )  # fmt: skip


def main() -> int:
    """Command line: build all blocks, or those named."""
    parser = argparse.ArgumentParser(description="Build the FMUs of the blocks into fmus/dist/.")
    parser.add_argument("names", nargs="*", metavar="NAME", help="blocks (default: all)")
    parser.add_argument("--into", type=Path, help="another folder, and nothing else is written")
    given = parser.parse_args()
    wanted = tuple(given.names) or names()
    if unknown := sorted(set(wanted) - set(names())):
        print(f"error: no block {', '.join(unknown)}; blocks are {', '.join(names())}",
              file=sys.stderr)  # fmt: skip
        return 2
    built = build_all(wanted, given.into or DIST)
    if given.into is None and len(wanted) == len(names()):
        for stale in set(DIST.glob("*.fmu")) - set(built):
            stale.unlink()
        interfaces.write()
    print(f"{len(built)} FMUs in {os.path.relpath(given.into or DIST)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
