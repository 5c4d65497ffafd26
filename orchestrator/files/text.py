"""Files that are whole or not there."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Within: an OSError that names no file, as one of writing to a full disk, names this one."""
    try:
        yield
    except OSError as error:
        if error.filename is None:
            error.filename = str(path)
        raise


def replace_text(path: Path, content: str | bytes) -> None:
    """Write a file under a temporary name, then rename; its folder is made. Raises OSError."""
    part = path.with_name(f"{path.name}.tmp")  # `.part` is what a run that goes on has
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        with naming(path):
            part.write_bytes(content.encode() if isinstance(content, str) else content)
        part.replace(path)
    except OSError:
        part.unlink(missing_ok=True)
        raise
