"""Manage archives and FMUs on disk.

Each is extracted once per process and found again by its contents.
"""

from __future__ import annotations

import atexit
import hashlib
import json
import os
import re
import shutil
import sys
import tempfile
import time
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache, cached_property, lru_cache
from pathlib import Path
from typing import Any

import fmpy
from filelock import FileLock, Timeout

from desat.components.contract.block import Scalar
from desat.fmus import meaning, registry, starts

from ..system.errors import DesatError, nearest, require
from ..system.interface import Interface, interface_of_block
from ..system.model import Component, Fmu, System
from ..system.options import Options
from ..system.typed import JsonObject
from . import binary, io, own, paths
from .fmu import description_of, faults, of_fmu
from .io import contents, regular, text

_PREFIX, _LOCK = "desat-", ".lock"
# Names of a process' temporary folder, and of what is in it besides its lock.
_NAME, _OURS = (
    re.compile(r"desat-[a-z0-9_]{8}"),
    re.compile(r"[0-9a-f]{20}|(run-|tmp).*"),
)
# s: age of a folder without a lock after which it counts as abandoned by a process that
# was killed while removing it; a new folder gets its lock at once.
_ABANDONED_AFTER = 3600.0
_ELSEWHERE = ("/tmp", "/var/tmp")


class FmuFile:
    """An FMU on disk, a file or a folder with its contents.

    Each property is read once, when it is first used. Raises DesatError for what cannot
    be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    @cached_property
    def sha256(self) -> str:
        """Compute the sha256 of its file, or that of the names and contents of a folder."""
        if not self.path.is_dir():
            return sha256(self.path)
        digest = hashlib.sha256()
        for file in sorted(p for p in self.path.rglob("*") if not p.is_dir()):
            name = file.relative_to(self.path).as_posix()
            data = contents(file, f"{self.path.name}/{name}", io.LARGEST)
            digest.update(name.encode() + data)
        return digest.hexdigest()

    @cached_property
    def _copy(self) -> starts.Starts | None:
        """Return its start values if it is a copy of one of ours with others.

        All else has to be the same, byte by byte.
        """
        if self.path.is_dir() or self.sha256 in index():
            return None
        try:
            with zipfile.ZipFile(self.path) as archive:
                if starts.MEMBER not in archive.namelist():
                    return None
                start_table = starts.read(archive.read(starts.MEMBER).decode())
                entry = index().get(start_table.origin)
                if entry is None:
                    return None
                data = (paths.fmus() / entry["file"]).read_bytes()
                expected = starts.with_starts(
                    starts.members_of(data), start_table.origin, start_table.values
                )
                is_copy = sorted(archive.namelist()) == sorted(expected) and all(
                    archive.read(name) == data for name, data in expected.items()
                )
                return start_table if is_copy else None
        except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile):
            return None

    @cached_property
    def origin(self) -> str:
        """Return the sha256 of the FMU of ours that it is, but for start values.

        That of any other FMU is its own.
        """
        return self.sha256 if self._copy is None else self._copy.origin

    @cached_property
    def ours(self) -> bool:
        """Return whether we built it, byte by byte, from our or the user's own block.

        It may have other start values. A description may claim anything, so it is not
        consulted.
        """
        return self.origin in index() or own.folder_of(self.path) is not None

    @cached_property
    def folder(self) -> Path:
        """Return the folder into which it is extracted."""
        return self.path if self.path.is_dir() else extract(self.path)

    @cached_property
    def interface(self) -> Interface:
        """Return its variables.

        For a block of ours that was built from the Python that is here, they are the
        block's: its description says the same.
        """
        entry = {} if self.path.is_dir() else index().get(self.origin, {})
        if entry.get("kind") in ("native", "python") and any(
            (e["name"], e["computes"]) == (entry["name"], entry["computes"])
            and meaning.is_as(e)
            for e in index().values()
            if e["kind"] == "python"
        ):
            return interface_of_block(entry["name"])
        name, sizes = sizes_in(self.path.stem)
        if sizes and own.folder_of(self.path) is not None:
            return interface_of_block(name, sizes)
        return of_fmu(self.folder, self.path.name)

    @cached_property
    def start_values(self) -> dict[str, Scalar]:
        """Return the values that a copy of one of ours starts with, by name."""
        if self._copy is None:
            return {}
        names = {s.reference: name for name, s in self.interface.signals.items()}
        return {names[start.reference]: start.value for start in self._copy.values}

    def sized(self, sizes: Mapping[str, int]) -> Interface:
        """Return its variables where structural parameters have these values."""
        return of_fmu(self.folder, self.path.name, sorted(sizes.items()))

    @cached_property
    def description(self) -> Any:
        """Return its model description, parsed by fmpy, even if it has faults."""
        return description_of(self.folder)

    @cached_property
    def faults(self) -> tuple[str, ...]:
        """Return the violations of the standard in its model description.

        They are empty for an FMU of ours.
        """
        return () if self.ours else faults(self.folder)

    @cached_property
    def platforms(self) -> list[str]:
        """Return the platforms of its libraries, as its version of FMI names them."""
        folders = (p for p in (self.folder / "binaries").glob("*") if p.is_dir())
        return sorted(p.name for p in folders if any(q.is_file() for q in p.iterdir()))


@cache
def _root() -> Path:
    """Create the temporary folder of this process and remove those of dead ones."""
    usual = tempfile.gettempdir()
    for parent in (usual, *(x for x in _ELSEWHERE if os.access(x, os.W_OK | os.X_OK))):
        if _plain(Path(parent)):
            break
    else:
        raise DesatError(
            f"{usual}: FMUs cannot be extracted to a path with such characters; set TMPDIR to "
            "another folder"
        )
    folder, lock = _hold(Path(parent))
    atexit.register(_remove, folder, lock, os.getpid())
    for other in folder.parent.glob(f"{_PREFIX}*"):
        if other != folder and _NAME.fullmatch(other.name):
            _sweep(other)
    return folder


def _hold(parent: Path) -> tuple[Path, FileLock]:
    """Create a new folder with its lock, and hold the lock.

    Between the two, another process that sweeps may take the folder for that of a dead
    process and remove it; then another one is created.
    """
    while True:
        folder = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=parent))
        lock = FileLock(folder / _LOCK)
        try:
            lock.acquire()
        except OSError:
            if folder.exists():
                raise
            continue
        if (folder / _LOCK).exists():
            return folder, lock
        lock.release()


def _plain(folder: Path) -> bool:
    """Return whether FMUs of Python can find their files in this folder.

    pythonfmu decodes no escape of a URI but `%20`.
    """
    return "%" not in folder.absolute().as_uri().replace("%20", "")


def _remove(folder: Path, lock: FileLock, process: int) -> None:
    """Remove the temporary folder at the end of the process that created it."""
    if os.getpid() == process:  # not in a process forked from it
        _remove_all(folder)
        lock.release()
        # again, for platforms on which an open file cannot be removed
        shutil.rmtree(folder, ignore_errors=True)


def _sweep(folder: Path) -> None:
    """Remove a temporary folder that no process holds any more.

    This includes what another process left when it was killed while removing one.
    """
    lock = folder / _LOCK
    try:
        if folder.stat().st_uid != paths.user() or not folder.is_dir():
            return
        if not lock.exists():
            old = time.time() - folder.stat().st_mtime > _ABANDONED_AFTER
            if old and all(_OURS.fullmatch(x.name) for x in folder.iterdir()):
                shutil.rmtree(folder, ignore_errors=True)
            return
        with FileLock(lock, timeout=0):
            _remove_all(folder)
    except (Timeout, OSError):
        pass


def _remove_all(folder: Path) -> None:
    """Remove a temporary folder, its lock last.

    If the process is killed meanwhile, the folder is still recognised by its lock.
    """
    for entry in folder.glob("*"):
        if entry.is_dir() and not entry.is_symlink():
            shutil.rmtree(entry, ignore_errors=True)
    shutil.rmtree(folder, ignore_errors=True)


def scratch(name: str) -> Path:
    """Create a folder that lasts as long as this process."""
    return Path(tempfile.mkdtemp(prefix=f"{name}-", dir=_root()))


@contextmanager
def own_temporary_folder() -> Iterator[Path]:
    """Let temporary files of this process and its children go into a scratch folder.

    What a killed process leaves there, another one removes.
    """
    folder = scratch("temporary")
    before, variable = tempfile.tempdir, os.environ.get("TMPDIR")
    tempfile.tempdir = os.environ["TMPDIR"] = str(folder)
    try:
        yield folder
    finally:
        tempfile.tempdir = before
        if variable is None:
            del os.environ["TMPDIR"]
        else:
            os.environ["TMPDIR"] = variable
        shutil.rmtree(folder, ignore_errors=True)


_by_contents: dict[str, Path] = {}
_by_stat: dict[tuple[str, int, int], str] = {}


def sha256(path: Path) -> str:
    """Compute the hash of a regular file's contents.

    It is cached until size or time of the file change.
    """
    regular(path, path.name)
    stat = path.stat()
    key = (str(path), stat.st_mtime_ns, stat.st_size)
    if key not in _by_stat:
        with path.open("rb") as file:
            _by_stat[key] = hashlib.file_digest(file, "sha256").hexdigest()
    return _by_stat[key]


def extract(path: Path) -> Path:
    """Return the folder with the contents of a zip archive.

    Raises DesatError as `io.extract`.
    """
    try:
        digest = sha256(path)
    except OSError as error:
        raise DesatError(f"{path.name}: {error.strerror}") from error
    if digest not in _by_contents:
        folder = _root() / digest[:20]
        if not folder.is_dir():  # a process forked from this one may have extracted it
            with tempfile.TemporaryDirectory(dir=_root()) as new:
                io.extract(path, Path(new) / folder.name)
                try:
                    (Path(new) / folder.name).rename(folder)
                except OSError:
                    if not folder.is_dir():
                        raise
        _by_contents[digest] = folder
    return _by_contents[digest]


def find(source: str, folder: Path) -> Fmu | None:
    """Find the FMU to which an SSD's `source` refers.

    It is beside the SSD or, only for an SSD in our own ssp/, one of our built FMUs: a
    foreign system never runs ours because of an equal name.
    """
    file = folder / source
    if not file.exists():
        return (
            of_ours(source)
            if folder.resolve().is_relative_to(paths.SCENARIOS)
            else None
        )
    return load(file)


def of_ours(source: str, kind: str = "native") -> Fmu | None:
    """Load our built FMU of a name, as `our_file` finds it."""
    path = our_file(source, kind)
    return load(path) if path is not None else None


def of_block(name: str, sizes: registry.Sizes) -> Fmu | None:
    """Load the FMU of one of our blocks with such lengths, which is built if needed."""
    if not sizes:
        return of_ours(f"{name}.fmu")
    file = paths.cache() / "sized" / f"{registry.sized_name(name, sizes)}.py"
    text_of_block = registry.sized_text(name, sizes)
    if not file.exists() or file.read_text(encoding="utf-8") != text_of_block:
        file.parent.mkdir(parents=True, exist_ok=True)
        io.replace_text(file, text_of_block)
    fmus = own.build(file)
    return load(fmus.native or fmus.python)


_SIZED = re.compile(r"(\w+?)((?:_of_\d+_[a-z]+)+)\Z")


def sizes_in(name: str) -> tuple[str, registry.Sizes]:
    """Split the name of a sized block into that of the block and its lengths."""
    match = _SIZED.fullmatch(name)
    if match is None or match[1] not in registry.names():
        return name, ()
    sizes = re.findall(r"_of_(\d+)_([a-z]+)", match[2])
    return match[1], tuple(sorted((kind, int(n)) for n, kind in sizes))


def our_file(source: str, kind: str = "native") -> Path | None:
    """Find our built FMU of a name (`resources/NAME.fmu`, `NAME.fmu`).

    It is the native one, or with `fmi3` that of FMI 3.0. If there is none, or if `kind`
    is python, it is the one of Python. The result is None if there is neither.
    """
    name = Path(source).name
    folders = [paths.fmus() / kind] if kind in ("native", "fmi3") else []
    candidates = (folder / name for folder in (*folders, paths.fmus()))
    return next((path for path in candidates if path.exists()), None)


def of_kind(fmu: Fmu, kind: str) -> Fmu:
    """Return a built FMU of ours, or of a user's block file, as native or Python one.

    Any other FMU is returned unchanged.
    """
    path = fmu.path
    if (folder := own.folder_of(path)) is not None:
        path_of_kind = folder / ("" if kind == "python" else kind) / path.name
        return load(path_of_kind) if path_of_kind.exists() else fmu
    ours = path.parent in (paths.fmus(), paths.fmus() / "native")
    return (of_ours(path.name, kind) or fmu) if ours else fmu


_loaded: dict[tuple[Path, int, int], FmuFile] = {}


def load(path: Path) -> FmuFile:
    """Load an FMU from its file, or from a folder with its contents.

    The same object is returned as long as the file does not change.
    """
    if path.is_dir():
        return FmuFile(path)
    stat = path.stat()
    return _loaded.setdefault((path, stat.st_mtime_ns, stat.st_size), FmuFile(path))


def unpack(system: System) -> None:
    """Extract the FMUs of a system and read their descriptions.

    A process forked from this one would not clean up after itself, and each would read
    them anew.
    """
    for component in system.components.values():
        if component.fmu is not None:
            _ = component.fmu.folder, component.fmu.description


def computes(name: str, fmu: Fmu | None) -> str:
    """Identify what computes a component.

    For a foreign FMU, or one of ours that was not built here, it is the sha256 of its
    file. For a block of ours (`fmu` None: the bare one of this name) it is the hash of
    its Python, the same for its native FMU, its Python FMU and the bare block.
    """
    if fmu is not None:
        entry = index().get(fmu.origin, {})
        return (
            f"block {entry['computes']}"
            if "computes" in entry
            else f"file {fmu.sha256}"
        )
    for entry in index().values():
        if entry["name"] == name and entry["kind"] == "python" and meaning.is_as(entry):
            return f"block {entry['computes']}"
    return f"block {_hash_of(name)}"


@cache
def _hash_of(name: str) -> str:
    """Compute the hash of the Python of a block."""
    return str(meaning.index_entry(name)["computes"])


def index() -> dict[str, JsonObject]:
    """Return the entries of our built FMUs by the sha256 of their files.

    The table is empty if none are built.
    """
    if not paths.are_built():
        return {}
    file = paths.fmus() / "index.json"
    try:
        stat = file.stat()
        return _load_index(file, stat.st_mtime_ns, stat.st_size)
    except OSError:
        return {}


def portable() -> bool:
    """Return whether all our native FMUs are for Linux and for Windows."""
    of_c = [e for e in index().values() if e["kind"] == "native"]
    return bool(of_c) and all({"linux64", "win64"} <= {*e["platforms"]} for e in of_c)


def python_alone() -> list[str]:
    """Return our blocks that have no native FMU."""
    return sorted(
        e["name"] for e in index().values() if e["kind"] == "python" and e.get("why")
    )


@lru_cache(maxsize=4)
def _load_index(file: Path, *_: int) -> dict[str, JsonObject]:
    """Read the index of our built FMUs."""
    return {e["sha256"]: e for e in json.loads(file.read_text(encoding="utf-8"))}


def interface_of(
    source: str, fmu: Fmu | None, blocks: bool, is_foreign: bool = False
) -> Interface:
    """Return the interface of an FMU, or (`blocks`) of the bare block of the same name.

    In a foreign system a missing FMU is not one of ours.

    Raises
    ------
    DesatError
        If the FMU is missing, or there is no such block.
    """
    name = source.rpartition("/")[2].removesuffix(".fmu")
    if blocks:
        name, sizes = sizes_in(name)
        require(name, registry.names(), "no block")
        return interface_of_block(name, sizes)
    if fmu is None:
        fmu_names = {p.stem for p in paths.fmus().glob("*.fmu")}
        hint = nearest(name, fmu_names) or "; run `make fmus`"
        # a foreign system does not run our FMUs
        hint = "" if is_foreign or name in fmu_names else hint
        raise DesatError(f"FMU {source} is missing{hint}")
    return fmu.interface


# ------------------------------------------------------------------------------------------------
# Origin and platforms of an FMU's code: ours, trusted by a list of hashes, or foreign. A foreign FMU
# is native code that runs with the rights of the user. Ours are recognised by their hash, because a
# description may claim anything.


_LINE = re.compile(r"([0-9a-fA-F]{64})(\s+\*?.*)?")


def hashes(path: Path) -> frozenset[str]:
    """Read the hashes of a list as sha256sum writes it.

    Each line has a hash and, optionally, the name of its file. `#` begins a comment.

    Raises
    ------
    DesatError
        If a line has another form; the message names it.
    """
    digests = set()
    for number, line in enumerate(text(path, str(path)).splitlines(), 1):
        line = line.partition("#")[0].strip()
        if line and not (match := _LINE.fullmatch(line)):
            raise DesatError(
                f"{path}:{number}: {line[:40]!r}: a sha256 of 64 digits is needed"
            )
        if line and match:
            digests.add(match[1].lower())
    return frozenset(digests)


def fault_warnings(fmus: Iterable[tuple[str, Fmu | None]]) -> Iterator[str]:
    """Yield a line for each foreign FMU whose model description violates the standard.

    It gives the first of the faults, and all components with this FMU. What cannot be
    read at all is reported elsewhere.
    """
    components: dict[Fmu, list[str]] = {}
    for component, fmu in fmus:
        if fmu is not None:
            components.setdefault(fmu, []).append(component)
    for fmu, names in components.items():
        try:
            faults_of_fmu = fmu.faults
        except (DesatError, OSError):
            continue
        if faults_of_fmu:
            more = f" ({len(faults_of_fmu) - 1} more)" if len(faults_of_fmu) > 1 else ""
            yield (
                f"{_listed(names)}: {fmu.path.name}: not as FMI wants it: "
                f"{faults_of_fmu[0][:300]}{more}"
            )


def _listed(names: Sequence[str]) -> str:
    """List names for a line; of more than three the first two and their count."""
    if len(names) <= 3:
        return ", ".join(names)
    return f"{', '.join(names[:2])} and {len(names) - 2} more"


def unused_warnings(system: System) -> Iterator[str]:
    """Yield a line for each component with variables of a type not exchanged."""
    for c in system.components.values():
        if names := [
            s.name for s in c.interface.signals.values() if s.kind == "Binary"
        ]:
            more = f" and {len(names) - 3} more" if len(names) > 3 else ""
            yield (
                f"{c.name}: Binary variables are not passed to other components: "
                f"{', '.join(names[:3])}{more}"
            )


def problems(system: System, options: Options) -> Iterator[str]:
    """Yield a line for each FMU that cannot or must not run here.

    Either it has no binary for this platform, or it is not in the list of trusted FMUs,
    if there is one.
    """
    trusted = options.trusted
    for c in system.components.values():
        if c.fmu is None or c.fmu.ours:
            continue
        fmu = c.fmu
        if trusted is not None and fmu.sha256 not in trusted:
            yield f"{c.name}: {fmu.path.name} is not of the list of --trust (sha256 {fmu.sha256})"
        if obstacle := find_obstacle(fmu):
            yield f"{c.name}: {obstacle}"


def find_obstacle(fmu: Fmu) -> str:
    """Return why an FMU's library could not run here, or an empty text."""
    here = fmpy.platform_tuple if fmu.interface.fmi == "3.0" else fmpy.platform
    if here not in (platforms := fmu.platforms):
        there = ", ".join(platforms) or "none"
        return f"{fmu.path.name} has no binary for {here}; there is {there}"
    fault = _loading_fault(fmu, here)
    return fault and f"{fmu.path.name}: its library cannot be loaded: {fault}"


def _loading_fault(fmu: Fmu, here: str) -> str:
    """Return why the library of an FMU could not be loaded, or an empty text."""
    name = fmu.description.coSimulation.modelIdentifier
    # of FMI 1.0 they have names of their own
    functions = {
        "1.0": (),
        "2.0": ("fmi2Instantiate", "fmi2DoStep"),
    }.get(fmu.interface.fmi, ("fmi3InstantiateCoSimulation", "fmi3DoStep"))
    file = fmu.folder / "binaries" / here / f"{name}.so"
    if not file.is_file():
        return "" if not sys.platform.startswith("linux") else f"{file.name} is missing"
    return binary.loading_fault(file, functions)


def step_warnings(system: System) -> Iterator[str]:
    """Yield a line for each foreign FMU whose fixed step does not fit the system's."""
    for c in system.components.values():
        if c.fmu is None or c.fmu.ours:
            continue
        of = c.fmu.description.coSimulation
        fixed = getattr(of, "fixedInternalStepSize", None)
        if fixed is None and not of.canHandleVariableCommunicationStepSize:
            fixed = getattr(c.fmu.description.defaultExperiment, "stepSize", None)
        step, fixed = system.step * c.step_ratio, float(fixed or 0.0)
        ratio = step / fixed if fixed > 0.0 else 1.0
        if abs(ratio - round(ratio)) > 1e-6 or round(ratio) < 1:
            yield (
                f"{c.name}: {c.fmu.path.name} has a fixed step of {fixed:g} s, which "
                f"does not fit into its step of {step:g} s: --step changes that"
            )


def notes(components: Iterable[Component]) -> Iterator[str]:
    """Yield a line for each foreign FMU, with its platforms and its hash."""
    for c in components:
        if c.fmu is not None and not c.fmu.ours:
            platforms = ", ".join(c.fmu.platforms) or "no platform"
            note = f"is foreign native code, for {platforms}; sha256 {c.fmu.sha256}"
            yield f"{c.name}: {c.fmu.path.name} {note}"
