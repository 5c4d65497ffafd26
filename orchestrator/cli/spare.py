"""Pass arguments that need no conversion to a command unchanged.

typer 0.29 lets pydantic convert every argument, also a text to a text and one that was
not given; importing it takes longer than `desat list` does. Older versions do not, and
are left alone.
"""

from __future__ import annotations

import os
from enum import Enum
from pathlib import Path
from typing import Any

# attribute in which typer 0.29 caches the conversion of a parameter
_CACHE = "_runtime_param"


def _is_unchecked(path: str, information: Any) -> bool:
    """Return whether typer would only convert a path: it is of nothing that exists."""
    may_be_new = not (information.exists or information.resolve_path)
    return may_be_new and not os.path.lexists(path)


class _AsGiven:
    """Conversion of one parameter by typer, made only where a value needs it."""

    def coerce(self, value: Any, param: Any, ctx: Any) -> Any:
        """Return the value unchanged if its type is right, else convert it."""
        many = param.multiple or param.nargs == -1
        if value is None:
            return () if many else None
        descriptor = param.type_descriptor
        information = descriptor.parameter_info
        if type(value) is str and information.parser is None and not many:
            if descriptor.annotation is str:
                return value
            if descriptor.annotation is Path and _is_unchecked(value, information):
                return Path(value)
        if isinstance(value, Enum) and type(value) is descriptor.annotation:
            return value
        setattr(param, _CACHE, None)
        return param.get_runtime_param().coerce(value, param=param, ctx=ctx)


def spare(command: Any) -> None:
    """Skip unnecessary conversions in a command and those below it."""
    for param in command.get_params(command.context_class(command)):  # with --help
        if getattr(param, _CACHE, param) is None:
            setattr(param, _CACHE, _AsGiven())
    for inner in getattr(command, "commands", {}).values():
        spare(inner)
