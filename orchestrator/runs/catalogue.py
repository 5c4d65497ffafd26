"""List the families of scenarios for `desat list`, with problems in their files.

For this every scenario is read and checked against the language and, where a family is
named, against its system, which takes seconds. The result is cached for the user as
long as the family's files and our code are the same; then only this module and JSON are
read.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

from ..files import paths
from ..system.errors import DesatError, require


@dataclass(frozen=True)
class Family:
    """Family of scenarios.

    It has the line about it, its valid scenarios (name -> title), and a line for each
    problem of the others.
    """

    name: str
    title: str
    scenarios: dict[str, str]
    problems: list[str]


def families() -> list[str]:
    """Return the names of all families."""
    return sorted(p.parent.name for p in paths.SCENARIOS.glob("*/scenarios"))


def family(name: str, of_systems: bool = True) -> Family:
    """Read a family, from the cache where that is current.

    With `of_systems` False problems are only those of the files alone, unless all are
    known.

    Raises
    ------
    DesatError
        If there is none.
    """
    require(name, families(), "no family")
    digest, stored_file = _digest(name), _file(name)
    with suppress(OSError, ValueError, KeyError, TypeError):
        known = json.loads(stored_file.read_text(encoding="utf-8"))
        if known.pop("digest") == digest and known.pop("of_systems") >= of_systems:
            return Family(**known)
    if of_systems and sys.stderr.isatty():
        print(
            f"reading the scenarios of {name}, for they or desat have changed",
            file=sys.stderr,
        )
    loaded = _load(name, of_systems)
    with suppress(OSError):  # the cache is optional
        stored_file.parent.mkdir(parents=True, exist_ok=True)
        part = stored_file.with_name(f"{stored_file.name}.{os.getpid()}.part")
        document = {"digest": digest, "of_systems": of_systems, **asdict(loaded)}
        part.write_text(json.dumps(document), encoding="utf-8")
        part.replace(stored_file)
    return loaded


def of_folder(folder: Path) -> Family:
    """Read the scenarios in the folder of a user's craft."""
    from ..files import craft, scenario

    titles: dict[str, str] = {}
    problems = []
    for file in sorted(
        folder.glob("*.toml"), key=lambda p: (p.name != paths.NOMINAL, p.name)
    ):
        if file.name.endswith(craft.FILE):
            continue
        name = str(folder) if file.name == paths.NOMINAL else str(file)
        try:
            titles[name] = scenario.read_foreign(file).content.title
        except DesatError as error:
            problems += str(error).splitlines()
    return Family(str(folder), "", titles, problems)


def _load(name: str, of_systems: bool) -> Family:
    """Read a family's scenarios, with a line for each that is not valid.

    With `of_systems` each system is checked too, not its file alone.
    """
    from ..files import scenario

    good, lines = scenario.readable(name)
    if of_systems:
        from .explain import readable

        # scenarios of an installation are valid; checking their systems needs the FMUs,
        # which takes long
        good, lines = readable(name, of_systems=not paths.INSTALLED)
    titles = {n: s.content.title for n, s in good.items()}
    return Family(name, scenario.summary(name), titles, lines)


def _file(name: str) -> Path:
    """Return the path of the cache of a family in this folder."""
    name_hash = hashlib.sha256(os.fsencode(paths.SCENARIOS / name)).hexdigest()[:16]
    return paths.cache() / "lists" / f"{name}-{name_hash}.json"


def _digest(name: str) -> str:
    """Compute the digest of a family's files and of our code."""
    digest = hashlib.sha256(f"{sys.version}".encode())
    folder = paths.SCENARIOS / name
    for path in sorted(
        p for p in folder.rglob("*") if p.suffix in (".toml", ".ssd", ".fmu")
    ):
        digest.update(
            os.fsencode(f"\0{path.relative_to(folder)}\0") + path.read_bytes()
        )
    digest.update(_code())
    return digest.hexdigest()


@cache
def _code() -> bytes:
    """Compute the digest of path, size and modification time of our code files."""
    digest = hashlib.sha256()
    # in a checkout these packages lie beside the main one
    source_folders = [
        paths.PACKAGE.parent / "components",
        paths.PACKAGE.parent / "fmus",
    ]
    for root in (paths.PACKAGE, *(() if paths.INSTALLED else source_folders)):
        for folder, folders, files in os.walk(root):
            folders[:] = sorted(
                f for f in folders if f not in ("__pycache__", "dist", "ssp")
            )
            for file in sorted(f for f in files if f.endswith(".py")):
                path = os.path.join(folder, file)
                stat = os.stat(path)
                digest.update(
                    os.fsencode(f"\0{path} {stat.st_size} {stat.st_mtime_ns}")
                )
    return digest.digest()
