"""Make environments of templates, which are kept compiled in the user's cache.

Compiling those of a report takes as long as drawing it.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Self

from jinja2 import (
    Environment,
    FileSystemBytecodeCache,
    PackageLoader,
    StrictUndefined,
)

from . import paths

if TYPE_CHECKING:
    from jinja2.bccache import Bucket


class CompiledTemplates(FileSystemBytecodeCache):
    """Templates compiled before, in a folder of the user's cache."""

    @classmethod
    def in_cache(cls) -> Self | None:
        """Return the templates in the cache; None if it cannot be written."""
        folder = paths.cache() / "templates"
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            return None
        return cls(str(folder))

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Write a compiled template, unless the disk has no room for it."""
        with suppress(OSError):
            super().dump_bytecode(bucket)


def text_templates(folder: str) -> Environment:
    """Return the environment of the templates of text in a folder of `templates`."""
    return Environment(
        loader=PackageLoader("desat", f"templates/{folder}"),
        bytecode_cache=CompiledTemplates.in_cache(),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
    )
