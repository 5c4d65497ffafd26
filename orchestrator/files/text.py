"""Files that are whole or not there."""

from __future__ import annotations

from pathlib import Path


def replace_text(path: Path, content: str | bytes) -> None:
    """Write a file under a temporary name, then rename; its folder is made. Raises OSError."""
    part = path.with_name(f"{path.name}.tmp")  # `.part` is what a run that goes on has
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        part.write_bytes(content.encode() if isinstance(content, str) else content)
        part.replace(path)
    except OSError:
        part.unlink(missing_ok=True)
        raise
