"""Convert values of parameters and inputs to scalars.

They come from a scenario, an SSV or the command line.
"""

from __future__ import annotations

import math
import re
import sys
import tomllib
from collections.abc import Sequence
from datetime import UTC, date, datetime
from typing import Any, cast

from desat.components.contract import units
from desat.components.contract.block import Scalar
from desat.components.contract.units import Unit, conversion
from desat.fmus.registry import block_class

from .errors import DesatError, nearest
from .interface import Interface, Signal
from .model import J2000, Component

# component and variable that `epoch` stands for
EPOCH = ("shared", "epoch_j2000")
# what a scenario has as keys, and a run as options
OPTIONS = ("stop", "step")


def unit_of(text: str) -> Unit:
    """Parse the expression of a unit.

    Raises
    ------
    DesatError
        If the unit is unknown.
    """
    try:
        return units.unit_of(text)
    except ValueError as error:
        name = str(error).partition(" is no unit")[0]
        reason = "" if name == text else f" ({error})"
        hint = nearest(name, units.NAMES) if name.isalpha() else ""
        if dotted := with_dots(text):
            hint = f"; did you mean {dotted}?"
        raise DesatError(f"unit {text} is not known{reason}{hint}") from error


def with_dots(text: str) -> str | None:
    """Insert the dots of a product of units that is written without them.

    `mNms` becomes `mN.m.s`, and `kgm2/s` becomes `kg.m2/s`. The result is None if there
    is no such product.
    """
    try:
        units.unit_of(text)
    except ValueError as error:
        name = str(error).partition(" is no unit")[0]
        power = re.match(rf".*{re.escape(name)}(\d?[A-Za-z0-9]*)", text)
        name += power[1] if power else ""
        product = _product(name)
        return text.replace(name, product) if product else None
    return None


def _product(text: str) -> str | None:
    """Insert the dots of a product; the first factor may have a prefix."""
    for end in range(len(text), 0, -1):
        name, power, rest = text[:end], "", text[end:]
        while rest[:1].isdigit():
            power, rest = power + rest[0], rest[1:]
        if not name.isalpha() or known_unit(name + power) is None:
            continue
        if not rest:
            return name + power
        if after := _bare_units(rest):
            return f"{name}{power}.{after}"
    return None


def _bare_units(text: str) -> str | None:
    """Insert the dots of a product of units without prefixes.

    The `ms` of `mNms` is no millisecond.
    """
    for name in sorted((*units.SI, *units.OTHER), key=len, reverse=True):
        match = re.match(rf"{re.escape(name)}(\d?)(.*)", text)
        if match and not match[2]:
            return name + match[1]
        if match and (after := _bare_units(match[2])):
            return f"{name}{match[1]}.{after}"
    return None


def known_unit(text: str) -> Unit | None:
    """Parse the expression of a unit, also as other tools write it.

    They write `[m]`, and `-` for 1. The result is None for an unknown unit, which FMUs
    of other tools may have.
    """
    bare = text.strip().removeprefix("[").removesuffix("]")
    try:
        return units.unit_of("1" if bare == "-" else bare)
    except ValueError:
        return None


_QUANTITY = re.compile(
    r"\s*([+-]?(?:\d[\d_]*\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([A-Za-z%].*|1/.+)"
)


def is_quantity(value: Any) -> bool:
    """Return whether a text is a number with a unit, such as "51.6 deg"."""
    return isinstance(value, str) and _QUANTITY.fullmatch(value) is not None


def _quantity(signal: Signal, text: str, place: str) -> float:
    """Convert a number with a unit to the unit of its variable.

    Raises DesatError if the unit does not fit.
    """
    match = _QUANTITY.fullmatch(text)
    assert match is not None
    unit = match[2].strip()
    try:
        meant = with_dots(unit)
        if (
            meant is not None
            and conversion(unit_of(meant), signal.unit or Unit()) is not None
        ):
            unit = meant
        converted = conversion(unit_of(unit), signal.unit or Unit())
    except DesatError as error:
        raise DesatError(f"{place} = {text!r}: {error}") from None
    if converted is None:
        subject = place.rpartition(": ")[2]
        expected = "has no unit"
        if signal.unit_name not in ("", "1"):
            expected = f"is in {signal.unit_name}"
        raise DesatError(
            f"{place} = {text!r}: {unit} is no unit of {subject}, which {expected}"
        )
    return float(match[1].replace("_", "")) * converted[0] + converted[1]


MATRIX_ROWS = 4  # upper bound of a matrix's rows; an array with more is a table


def _is_begun_table(value: Any, last: str, count: int) -> bool:
    """Return whether a value is the first rows of a table, whose other rows are 0.

    The table has more rows than matrices have, and each given row has its length.
    `last` is the name of the last element, `plates[16,9]`.
    """
    shape = re.fullmatch(r".*\[(\d+),(\d+)\]", last)
    if shape is None or not isinstance(value, (list, tuple)) or not value:
        return False
    rows, columns = int(shape[1]), int(shape[2])
    return (
        rows > MATRIX_ROWS
        and count < rows * columns
        and all(isinstance(row, (list, tuple)) and len(row) == columns for row in value)
    )


def expand(
    interface: Interface, name: str, value: Any, place: str, typed: bool = False
) -> dict[str, Scalar]:
    """Convert `name = value` to scalars by element name.

    `place` (file and component) begins every message. A list gives an array's elements
    row by row; for a table the first rows are enough. A text gives a choice by its
    name. `typed` means that a person typed the value: then the number 5 is the choice
    named 5 if choices are numbers.

    Raises
    ------
    DesatError
        If the variable is unknown or cannot be set, or if count, type or bounds do not fit.
    """
    signal = interface.signals.get(name)
    signals = interface.elements.get(name, ()) if signal is None else [signal]
    if not signals:
        variable_names = {s.array for s in interface.signals.values() if s.settable}
        raise DesatError(
            f"{place} has no variable {name}{nearest(name, variable_names)}"
        )
    if not signals[0].settable:
        reason = "" if interface.role else ", whose start value the FMU computes"
        kind = signals[0].causality
        article = "an" if kind[0] in "aeiou" else "a"
        raise DesatError(
            f"{place}.{name} is {article} {kind}{reason}: it cannot be set"
        )
    if typed and isinstance(value, int) and not isinstance(value, bool):
        value = _typed_choice(signals[0].choices, value)
    if signal is not None and not isinstance(value, (list, tuple)):
        return {name: _scalar(signal, value, f"{place}.{name}")}
    values = _flat(value)
    _check_rows(value, signals[-1].name.removeprefix(name), f"{place}.{name}")
    if len(values) < len(signals) and _is_begun_table(
        value, signals[-1].name, len(values)
    ):
        values += [0.0] * (len(signals) - len(values))
    if len(values) != len(signals):
        raise DesatError(
            f"{place}.{name} needs {len(signals)} values, got {len(values)}"
        )
    return {
        s.name: _scalar(s, x, f"{place}.{s.name}")
        for s, x in zip(signals, values, strict=True)
    }


def _check_rows(value: Any, last: str, place: str) -> None:
    """Raise DesatError if rows are not as long as an array's; `last` is as [3,4]."""
    if not isinstance(value, (list, tuple)):
        return
    lengths = {len(_flat(x)) if isinstance(x, (list, tuple)) else 0 for x in value}
    if lengths == {0}:
        return
    sizes = [int(n) for n in last.strip("[]").split(",") if n]
    row = math.prod(sizes[1:])
    if len(sizes) < 2:
        raise DesatError(
            f"{place} has no rows: a list of {math.prod(sizes)} values is needed"
        )
    if lengths != {row}:
        lengths_text = " and ".join(
            str(n) if n else "single values" for n in sorted(lengths)
        )
        raise DesatError(
            f"{place} has rows of {row} values, got rows of {lengths_text}"
        )


def _typed_choice(choices: Sequence[str], value: int) -> int | str:
    """Convert a number to a choice's name if choices have numbers as names.

    Any other number is returned unchanged. 0 is the first choice if that has another
    name, such as none.
    """
    called = any(x.isdigit() for x in choices)
    return str(value) if called and (value or choices[0].isdigit()) else value


def _flat(value: Any) -> list[Any]:
    """Return the elements of a list, row by row; a scalar becomes a list of one."""
    if not isinstance(value, (list, tuple)):
        return [value]
    flat: list[Any] = []
    for item in value:
        if isinstance(item, (list, tuple)):
            flat += _flat(item)
        else:
            flat.append(item)
    return flat


def _choice(signal: Signal, value: str, place: str) -> int:
    """Return the index of a choice, or raise DesatError for another text."""
    if value not in signal.choices:
        raise DesatError(
            f"{place} = {value}: not a choice{nearest(value, signal.choices)}"
        )
    return signal.choices.index(value)


def _scalar(signal: Signal, value: Any, place: str) -> Scalar:
    """Check a value and convert it to one scalar.

    Raises DesatError, whose text begins with `place`.
    """
    low, high = signal.minimum, signal.maximum
    if (
        type(value) is float
        and signal.kind == "Real"
        and math.isfinite(value)
        and (low is None or value >= low)
        and (high is None or value <= high)
    ):
        return value  # fast path for nearly all of a table's thousands of values
    if isinstance(value, int) and abs(value) > sys.float_info.max:
        raise DesatError(f"{place}: a number of {len(str(value))} digits is too large")
    if signal.choices and isinstance(value, str):
        return _choice(signal, value, place)
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    match signal.kind:
        case "Boolean" if isinstance(value, bool):
            return value
        case "Integer" if is_number and isinstance(value, int):
            return int(_within(signal, value, place))
        case "Real" if isinstance(value, str) and is_quantity(value):
            return _within(signal, _quantity(signal, value, place), place)
        case "Real" if is_number:
            return _within(signal, float(value), place)
        case "String" if isinstance(value, str):
            return cast("Scalar", value)  # only an FMU takes a text
        case "Boolean" | "Integer" | "Real" | "String":
            pass
        case _:
            raise DesatError(f"{place} is of type {signal.kind}: it cannot be set")
    kind = "an Integer" if signal.kind == "Integer" else f"a {signal.kind}"
    expected = f"one of {', '.join(signal.choices)}" if signal.choices else kind
    raise DesatError(f"{place} = {value!r}: {expected} is needed")


def _within(signal: Signal, value: float, place: str) -> float:
    """Check that a value is finite and within the bounds of its variable."""
    if not math.isfinite(value):
        raise DesatError(f"{place} = {value}: a finite number is needed")
    low, high = signal.minimum, signal.maximum
    if signal.kind == "Integer":  # 32 bits, as in C
        low, high = (
            low if low is not None else -(2**31),
            high if high is not None else 2**31 - 1,
        )
    if (low is not None and value < low) or (high is not None and value > high):
        unit = f" {signal.unit_name}" if signal.unit_name not in ("", "1") else ""
        lowest = "-inf" if low is None else f"{low:.10g}"
        highest = "inf" if high is None else f"{high:.10g}"
        got = value if isinstance(value, int) else f"{value:g}"
        if lowest == highest:
            raise DesatError(
                f"{place} = {got}{unit}: allowed is {lowest} alone: {signal.description}"
            )
        raise DesatError(f"{place} = {got}{unit}: allowed is {lowest} to {highest}")
    return value


def bare_block(component: Component) -> Any:
    """Create the block of ours behind a component, with its parameters.

    The block is checked, but not started.
    """
    block = block_class(component.model, component.interface.sizes)()
    signals, values = component.interface.signals, component.parameters
    block.access([signals[n].reference for n in values]).write(list(values.values()))
    block.check()
    return block


def in_unit_of(signal: Signal, value: Scalar, unit: Unit | str, place: str) -> Scalar:
    """Convert a value in `unit` to the unit of its variable.

    `unit` is a text if its definition is unknown.

    Raises
    ------
    DesatError
        If the unit does not fit; the text begins with `place`.
    """
    if signal.unit is None or isinstance(value, bool):
        raise DesatError(
            f"{place}: {signal.name} has no unit, but its value was given with one"
        )
    if isinstance(unit, str):
        raise DesatError(
            f"{place}: unit {unit} is not known: it cannot be converted to "
            f"{signal.unit_name}"
        )
    converted = conversion(unit, signal.unit)
    if converted is None:
        raise DesatError(
            f"{place}: the unit of {signal.name} = {value} does not fit "
            f"{signal.unit_name}"
        )
    return value if converted == (1.0, 0.0) else converted[0] * value + converted[1]


def parse_assignment(text: str) -> tuple[str, str, Any]:
    """Parse `manager.k=1,2` to ("manager", "k", [1, 2]).

    Raises
    ------
    DesatError
        If the text has another form.
    """
    target, equals, right = text.partition("=")
    component, name = target_of(target.strip())
    if component in OPTIONS and not name:
        raise DesatError(f"--set {text}: it is an option: --{component} {right}")
    if not (equals and component and name and right.strip()):
        raise DesatError(f"--set {text}: the form is COMPONENT.VARIABLE=VALUE")
    return component, name, with_date(name, parse_value(right.strip()))


def target_of(name: str) -> tuple[str, str]:
    """Return component and variable of a name; `epoch` is that of all components."""
    if name == "epoch":
        return EPOCH
    component, _, variable = name.partition(".")
    return component, variable


def with_date(name: str, value: Any) -> Any:
    """Return the value of a variable: of a date as an epoch its seconds since J2000."""
    if name != EPOCH[1]:
        return value
    if isinstance(value, str):
        try:
            value = datetime.fromisoformat(value)
        except ValueError:
            return value
    elif isinstance(value, date) and not isinstance(value, datetime):
        value = datetime(value.year, value.month, value.day)
    if not isinstance(value, datetime):
        return value
    utc = value if value.tzinfo else value.replace(tzinfo=UTC)
    return (utc - J2000).total_seconds()


def as_text(value: Any, typed: str, count: int) -> Any:
    """Return the value of `count` texts as it was typed, such as "043" for 43.

    A text in quotes is that within them.
    """
    if count > 1:
        parts = [part.strip() for part in typed.strip("[]").split(",")]
        values = value if isinstance(value, list) else [value]
        is_alike = len(values) == len(parts)
        return list(map(_unquoted, values, parts)) if is_alike else value
    return _unquoted(value, typed)


def _unquoted(value: Any, typed: str) -> str:
    """Return a text, or what was typed where that was read as something else."""
    return value if isinstance(value, str) else typed


def parse_value(text: str) -> Any:
    """Parse a value of the command line: a TOML value, a comma list, or a bare word."""
    for candidate in (text, f"[{text}]") if "," in text else (text,):
        try:
            return tomllib.loads(f"x = {candidate}")["x"]
        except tomllib.TOMLDecodeError:
            continue
    if "," in text:
        return [parse_value(part.strip()) for part in text.split(",")]
    try:
        return float(text)  # "10." and ".5" are no TOML
    except ValueError:
        return text
