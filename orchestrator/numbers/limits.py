"""Compute the limit lines of a plot: numbers, or products of parameters."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from ..system.errors import DesatError
from ..system.expression import Table, factor, product
from ..system.expression import entry as value_of

if TYPE_CHECKING:
    from ..language.scenario import LimitLine


def limits_of(
    lines: Iterable[LimitLine], parameters: Table, unit: str
) -> list[tuple[str, float, bool]]:
    """Compute the limit lines, or bands about zero, that hold in this run.

    Each has (name, value, filled); the value is in `unit`.
    """
    limits = []
    for limit in lines:
        if any(parameter_of(parameters, k) == v for k, v in limit.unless.items()):
            continue
        value, name = limit.value, "limit"
        if isinstance(value, str):
            name = value.partition("[")[0]
            value, is_own_band = product(value, parameters)
            value *= factor(is_own_band, unit, f'of "{limit.value}"')
        limits.append((limit.name or name, float(value), limit.fill))
    return limits


def parameter_of(parameters: Table, name: str) -> Any:
    """Return the value of `component.parameter`, or one element, or None if unknown."""
    try:
        return value_of(name, parameters)[0]
    except DesatError:
        return None
