"""Arguments that need no conversion are given to a command as they are.

typer 0.29 has pydantic convert every one, also a text to a text, and also one that was
not given: to import it takes longer than `desat list` does. Older ones do not, and are
left alone.
"""

from __future__ import annotations

from enum import Enum
from typing import Any

_KEPT = "_runtime_param"
"""Where typer 0.29 keeps how it converts a parameter's values, once it has made that.
"""


class _AsGiven:
    """Typer's conversion of one parameter, made where a value needs it."""

    def coerce(self, value: Any, param: Any, ctx: Any) -> Any:
        many = param.multiple or param.nargs == -1
        if value is None:
            return () if many else None
        wanted = param.type_descriptor
        is_text = type(value) is str and wanted.annotation is str
        if is_text and wanted.parameter_info.parser is None and not many:
            return value
        if isinstance(value, Enum) and type(value) is wanted.annotation:
            return value
        setattr(param, _KEPT, None)
        return param.get_runtime_param().coerce(value, param=param, ctx=ctx)


def spare(command: Any) -> None:
    """Let a command, and those below it, convert no argument that is right as it is."""
    for param in command.get_params(command.context_class(command)):  # with --help
        if getattr(param, _KEPT, param) is None:
            setattr(param, _KEPT, _AsGiven())
    for inner in getattr(command, "commands", {}).values():
        spare(inner)
