"""Convert the values that a Python program gives to those of options.

A program may give numpy arrays and numbers, pandas Series, xarray arrays, tuples, and
mappings of a component's values. None of these packages is imported for it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from datetime import date, timedelta
from functools import wraps
from numbers import Integral, Real
from typing import Any, ParamSpec, TypeVar

from .errors import DesatError

P = ParamSpec("P")
R = TypeVar("R")

# Options of the command in its messages, and the arguments that have other names.
# What stands in backticks is a command to type.
_OPTION = re.compile(r"`[^`]*`|(?<![\w-])(?:--([a-z][a-z0-9-]+)|-(n))\b")
ARGUMENTS = {
    "set": "sets",
    "source": "sources",
    "curve": "curves",
    "out": "folder",
    "n": "count",
}

# Labels that a Series of n elements may have besides 0 to n - 1 and 1 to n.
LETTERS = {3: ("x", "y", "z"), 4: ("x", "y", "z", "w")}


def plain_argument(value: Any) -> Any:
    """Return a number or date of another library as one of Python.

    Any other value, as a duration of numpy, is returned as it is.
    """
    kind = type(value).__name__
    if kind == "datetime64":
        return value.astype("datetime64[us]").item()
    # a duration counts as a whole number, without its unit
    if kind == "timedelta64" or isinstance(value, bool):
        return value
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        return float(value)
    return value.item() if getattr(value, "ndim", None) == 0 else value


def with_plain_arguments(function: Callable[P, R]) -> Callable[P, R]:
    """Return a function that takes numbers and dates of any library.

    Its errors name arguments where those of the command name options.
    """

    @wraps(function)
    def call(*arguments: P.args, **options: P.kwargs) -> R:
        """Call the function with Python's own numbers and dates."""
        plain = {name: plain_argument(value) for name, value in options.items()}
        try:
            return function(*map(plain_argument, arguments), **plain)
        except DesatError as error:
            error.args = tuple(
                _OPTION.sub(_argument_of, x) if isinstance(x, str) else x
                for x in error.args
            )
            raise

    return call


def _argument_of(option: re.Match[str]) -> str:
    """Return the argument that stands for an option of the command."""
    name = option[1] or option[2]
    if name is None:
        return option[0]
    return ARGUMENTS.get(name, name.replace("-", "_"))


def plain_values(sets: Mapping[str, Any]) -> dict[str, Any]:
    """Return `component.variable` -> number, text, or list (of rows).

    A value that is itself a mapping has the variables of a component.

    Raises
    ------
    DesatError
        If a name or a value has another form, or a Series other labels; it names both.
    """
    values: dict[str, Any] = {}
    for name, value in _flattened(sets):
        if name in values:
            raise DesatError(f"sets: {name} is given twice")
        values[name] = _plain(name, value)
    return values


def _flattened(sets: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield each value with its full name."""
    for name, value in sets.items():
        if not isinstance(name, str):
            raise DesatError(
                f"sets: {name!r}: a text is needed, as 'component.variable'"
            )
        if not isinstance(value, Mapping):
            yield name, value
            continue
        for variable, inner in value.items():
            if isinstance(inner, Mapping) or not isinstance(variable, str):
                raise DesatError(
                    f"sets: {name}.{variable}: a mapping holds the variables of a "
                    "component, by text"
                )
            yield f"{name}.{variable}", inner


def _plain(name: str, value: Any) -> Any:
    """Convert a value: an array to lists, a number of numpy to one of Python.

    A duration is a text with its unit, a date one of ISO 8601.
    """
    kind = type(value).__name__
    if kind == "timedelta64":
        value = value.astype("timedelta64[us]").item()
    elif kind == "datetime64":
        value = plain_argument(value)
    if isinstance(value, timedelta):  # also one of pandas
        return f"{value.total_seconds()!r} s"
    if isinstance(value, date):
        return value.isoformat()
    labels: Any = getattr(value, "index", None)
    if hasattr(labels, "tolist") and hasattr(value, "tolist"):  # a Series
        return _by_labels(name, labels.tolist(), value.tolist())
    if hasattr(value, "tolist"):  # an array or a number of numpy
        return value.tolist()
    if hasattr(value, "values") and hasattr(value, "dims"):  # a DataArray of xarray
        return value.values.tolist()
    if isinstance(value, (list, tuple)):
        return [_plain(name, x) for x in value]
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise DesatError(
        f"sets: {name}: a {type(value).__name__} is given; a number, a text, a list, an "
        "array or a Series is needed"
    )


def _by_labels(name: str, labels: list[Any], values: list[Any]) -> list[Any]:
    """Return the values of a Series in the order of the elements."""
    n = len(values)
    orders: list[list[Any]] = [list(range(n)), list(range(1, n + 1))]
    if n in LETTERS:
        orders.append(list(LETTERS[n]))
    for order in orders:
        if len(set(labels)) == n and set(labels) == set(order):
            return [values[labels.index(label)] for label in order]
    allowed = f"0 to {n - 1}, or 1 to {n}"
    if n in LETTERS:
        allowed = f"{', '.join(LETTERS[n])}, or {allowed}"
    labels_text = ", ".join(map(str, labels[:6]))
    raise DesatError(
        f"sets: {name}: a Series labelled {labels_text}: allowed is {allowed}"
    )
