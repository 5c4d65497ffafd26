"""Build the options of a call of `import desat`."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import timedelta
from typing import Any

import numpy as np

from desat.components.contract.block import Block

from ..files.class_source import file_of
from ..system.errors import DesatError, nearest
from ..system.options import Options, RunOptions, orbits
from ..system.program_values import plain_values
from ..system.quantity import Quantity


def options_of(
    stop: float | str | None,
    step: float | None,
    sets: Mapping[str, Any] | None,
    keywords: RunOptions,
    *others: str,
) -> Options:
    """Return the options of a program's call.

    `sources` may map a component to an FMU, a file, or a class. `others` are further
    arguments of the call, for the message on a name that is none.

    Raises
    ------
    DesatError
        If there is no such option, or a value is wrong.
    """
    entries: dict[str, Any] = dict(keywords)
    option_names = {*RunOptions.__annotations__, "sets", "stop", "step", *others}
    if unknown := [name for name in entries if name not in RunOptions.__annotations__]:
        raise DesatError(
            f"{unknown[0]}: no option{nearest(unknown[0], option_names)}; values of "
            "components are given as sets={'component.variable': value}"
        )
    if sets is not None and getattr(sets, "ndim", 0) == 1 and hasattr(sets, "to_dict"):
        sets = sets.to_dict()  # a row of a table of pandas
    if sets is not None and not isinstance(sets, Mapping):
        raise DesatError(
            f"sets: a {type(sets).__name__} is given; a mapping of 'component.variable' "
            "to values is needed"
        )
    sources = entries.pop("sources", [])
    if isinstance(sources, Mapping):
        sources = [f"{name}={_fmu_of(name, fmu)}" for name, fmu in sources.items()]
    return Options(
        stop=_seconds("stop", stop),
        step=_seconds("step", step),
        values=plain_values(sets or {}),
        sources=sources,
        **entries,
    )


def _seconds(name: str, time: Any) -> Any:
    """Return a timedelta of Python, pandas or numpy, or a text as "6h", in seconds.

    A text of orbits and any other value are returned as they are. Raises DesatError for
    another text.
    """
    if isinstance(time, np.timedelta64):
        return float(time / np.timedelta64(1, "s"))
    if isinstance(time, str) and not (name == "stop" and orbits(time)):
        return Quantity(name, "s")(time)
    return time.total_seconds() if isinstance(time, timedelta) else time


def _fmu_of(component: str, source: Any) -> str:
    """Return the FMU or the file of a source, which may be a block class."""
    if isinstance(source, type):
        if issubclass(source, Block):
            return str(file_of(source))
        raise DesatError(
            f"sources: {component}: {source.__name__} is no block: it must derive from a "
            "role of desat.components.contract.roles"
        )
    return str(source)
