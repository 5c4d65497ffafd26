"""Export a block alone as C (`fmus/alone.py`), given by name or by a user's file."""

from __future__ import annotations

import shlex
import shutil
from collections.abc import Sequence
from pathlib import Path

from desat.fmus.alone import Size, alone, sources_of
from desat.fmus.compiler import NoCompilerError, compiler
from desat.fmus.native import sources
from desat.fmus.registry import block_class

from ..files import library, own, paths
from ..files.io import replace_text
from ..system.errors import DesatError, nearest


def export(
    block: str,
    folder: Path,
    compilers: Sequence[str] | None = None,
    samples: int | None = None,
) -> tuple[list[Path], list[Size]]:
    """Write NAME.h and NAME.c into a folder.

    Parameters
    ----------
    block
        Name of a block, or a user's own file.
    folder
        Folder for the files.
    compilers
        Commands of compilers; default: this machine's, where it has one.
    samples
        Largest number of samples of a plan; default: the block's own. The stack
        follows from it.

    Returns
    -------
    tuple
        Paths of the files, and the sizes (bytes) that each compiler gives.

    Raises
    ------
    DesatError
        If there is no such block, it has no C, it plans no samples or not so many, or
        a compiler does not compile it.
    """
    fmu = _native(block)
    commands = _commands(compilers)
    try:
        if samples is None:
            files, sizes = alone(fmu.stem, sources_of(fmu), commands)
        else:
            note = f"room for plans of at most {samples} samples"
            files, sizes = alone(fmu.stem, _smaller(block, samples), commands, note)
    except RuntimeError as error:
        raise DesatError(f"{block}: {error}") from error
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, text in files.items():
        replace_text(folder / name, text)
        written.append(folder / name)
    return written, sizes


def _smaller(block: str, samples: int) -> dict[str, str]:
    """Translate a block anew, with room for at most so many samples."""
    areas = getattr(block_class(block), "work_areas", ())
    if not areas:
        raise DesatError(f"--samples {samples}: {block} makes no plan of samples")
    limits = {(m, name): getattr(m, name) for m, name, _ in areas}
    most = min(limits[m, name] // share for m, name, share in areas)
    if not 1 <= samples <= most:
        raise DesatError(f"--samples {samples}: {block} has room for 1 to {most}")
    try:
        for module, name, share in areas:
            setattr(module, name, share * samples)
        return sources(block)[0]
    finally:
        for (module, name), value in limits.items():
            setattr(module, name, value)


def _native(block: str) -> Path:
    """Return the native FMU of a block, or raise DesatError."""
    if block.endswith(".py"):
        archive = own.build(Path(block))
        if archive.native is None:
            raise DesatError(f"{block}: there is no C of it: {archive.reason}")
        return archive.native
    files_by_name = {
        path.stem: path for path in (paths.fmus() / "native").glob("*.fmu")
    }
    if block in files_by_name:
        return files_by_name[block]
    if library.our_file(f"{block}.fmu") is not None:
        raise DesatError(f"{block}: there is no C of it, it runs as Python")
    raise DesatError(f"{block}: no such block{nearest(block, files_by_name)}")


def _commands(names: Sequence[str] | None) -> list[Sequence[str]]:
    """Return the commands of the compilers, or raise DesatError for an unknown one."""
    if names is None:
        try:
            return [compiler()]
        except NoCompilerError:
            return []
    commands: list[Sequence[str]] = []
    for text in names:
        try:
            command = shlex.split(text)
        except ValueError as error:
            raise DesatError(f"--compiler {text}: {str(error).lower()}") from None
        if not command or shutil.which(command[0]) is None:
            raise DesatError(f"--compiler {text}: there is no such command")
        commands.append(command)
    return commands
