"""Numbers from series: what a scenario's `[numbers.NAME]` gives of a run.

    [numbers.wheels]
    title = "Mean wheel from 2 h on"
    signal = "wheels.h_wheel"        # or several, where the measure takes several
    measure = "mean_size"            # measures.py
    options = {}                     # the measure's own
    window = [7200.0, 86400.0]       # only rows of this time (s), ends included; default: all
    percent_of = "wheels.inertia_wheel * wheels.speed_limit"   # in per cent of this: a product
                                     # of parameters, or a number in the measure's own unit
    unit = "%"                       # else: converted from the measure's unit

    [numbers.roll]
    signal = ["spacecraft.q_bi", "guidance.q_ref"]
    derive = "euler"                 # what is measured is derived of the signals: derived.py
    sequence = "321"
    element = 3                      # of what is measured, only this element
    measure = "largest"
    unit = "deg"

An option may be a product of parameters, too (`system/expression.py`).
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from desat.components.contract.units import Unit

from ..system.errors import DesatError, nearest
from ..system.expression import Table, entry, factor, product
from ..system.parameters import unit_of
from . import derived
from .measures import LATE, MEASURES, OWN_UNIT

if TYPE_CHECKING:
    from ..engine.recording.results import Results
    from ..language.content import Content
    from ..language.scenario import Number

OPEN_END = 1e9
"""A window that ends here or later (s) ends with the run."""


def evaluate(number: Number, results: Results, parameters: Table) -> float | None:
    """The number that a scenario describes.

    None where the run does not reach it: no row in its window, or nothing there to measure.
    Raises DesatError for a series that is not there, a unit that does not fit, and a product of
    parameters that has no value.
    """
    units = _units(number, [results.attribute(s, "unit") for s in number.signals])
    conversion = _conversion(number, units, parameters)
    options = _options(number, units, parameters)
    columns = _columns(number, results, parameters)
    rows = min(len(c) for c in columns)
    times = results.times()[:rows]
    if number.window:
        begin, end = number.window
        kept = (times >= begin - 1e-6) & (times <= end + 1e-6)
        times, columns = times[kept], [c[:rows][kept] for c in columns]
        rows = len(times)
    if rows == 0:
        return None
    with np.errstate(over="ignore"):  # a run that diverges has infinite numbers
        value = MEASURES[number.measure](times, *(c[:rows] for c in columns), **options)
    return None if math.isnan(value) else conversion(value)


def late(content: Content) -> set[str]:
    """A scenario's numbers that are times at which something is reached: over several runs, one
    that does not reach it is later than all that do. Not those with `only_done`."""
    return {
        name for name, number in content.numbers.items()
        if number.signals and number.measure in LATE and not number.options.get("only_done")
    }  # fmt: skip


def ranks(values: Sequence[float | None], is_late: bool) -> list[Any]:
    """A number over several runs, as it is ranked: a time that is not reached is infinite."""
    return [math.inf if x is None and is_late else x for x in values]


def _columns(
    number: Number, results: Results, parameters: Table
) -> list[derived.Array]:  # fmt: skip
    """What is measured, (rows, elements) each: the series, or what is derived of them. Several
    numbers measure the same."""

    def column(signal: str) -> derived.Array:
        values = results.values(signal)
        return (values if values.ndim > 1 else values[:, None]).astype(float)

    columns = [results.recent(name, partial(column, name)) for name in number.signals]
    if derivation := derived.of_entry(number):
        quantity, options = derivation
        key = (number.derive, *number.signals, *options.items())
        options = {**options, **_own(number, quantity, parameters)}
        make = partial(quantity.rows, results.times(), columns, options)
        columns = [results.recent(key, make)]
    if element := number.element:
        if element > columns[0].shape[1]:
            raise DesatError(f"element {element}: there are {columns[0].shape[1]}")
        columns[0] = columns[0][:, element - 1 : element]
    return columns


def _own(
    number: Number, quantity: derived.DerivedQuantity, parameters: Table
) -> dict[str, Any]:  # fmt: skip
    """The parameters that a derived quantity takes. Raises DesatError where there are none."""
    owner = number.signals[0].partition(".")[0]
    return {name: entry(f"{owner}.{name}", parameters)[0] for name in quantity.own}


def _units(number: Number, signals: list[str]) -> list[Unit]:
    """The unit of each of what is measured, from those of the signals."""
    if derivation := derived.of_entry(number):
        signals = [derivation[0].unit or signals[0]]
    return [unit_of(s) for s in signals]


def _conversion(
    number: Number, units: list[Unit], parameters: Table
) -> Callable[[float], float]:  # fmt: skip
    """From the measure's unit to the number's. Raises DesatError where they do not fit."""
    name, unit = number.measure, number.unit
    source = OWN_UNIT[name](units[0]) if name in OWN_UNIT else units[0]
    if (whole := number.percent_of) is not None:
        if unit != "%":
            raise DesatError(f"unit {unit or None}: a number with percent_of is in %")
        if isinstance(whole, str):
            text, (whole, own) = whole, product(whole, parameters)
            if own.dimension != source.dimension:
                raise DesatError(f'percent_of = "{text}": its unit is not that of {name}')
            whole *= own.factor / source.factor
        if whole == 0.0:
            raise DesatError(f"percent_of = {number.written['percent_of']} is 0")
        share = float(whole)
        return lambda value: 100.0 * value / share
    if not unit or (name not in OWN_UNIT and unit_of(unit) == source):
        return lambda value: value
    scaled = factor(source, unit, f"of {name}")
    return lambda value: value * scaled


def _options(number: Number, units: list[Unit], parameters: Table) -> dict[str, Any]:
    """The measure's options; a product of parameters has the unit of one of its series."""
    options = dict(number.options)
    texts = {key: value for key, value in options.items() if isinstance(value, str)}
    accepted = inspect.signature(MEASURES[number.measure]).parameters if texts else {}
    for key, value in texts.items():
        if accepted[key].annotation == "float":
            options[key], unit = product(value, parameters)
            if all(unit.dimension != u.dimension for u in units):
                raise DesatError(f'{key} = "{value}": its unit is that of no signal')
    return options


def defined(number: Number | None) -> str:
    """A number of a scenario in a sentence: its title, and how it is measured. Empty for None."""
    if number is None:
        return ""
    if number.reference:
        how = f"{number.form} of {number.of} to that of {number.reference}"
        return f"{number.title} ({how})"
    sentence = " ".join((inspect.getdoc(MEASURES[number.measure]) or "").split()).removesuffix(".")
    of = " and ".join(number.signals)
    if number.derive:
        of = f"{number.derive.replace('_', ' ')} of {of}"
    parts = [f"{sentence[0].lower()}{sentence[1:]}; of {of}"]
    parts += [f"{k} = {v}" for k, v in number.options.items()]
    if number.window:
        begin, end = number.window
        parts.append(f"from {begin:g} s to " + ("the end" if end >= OPEN_END else f"{end:g} s"))
    if number.percent_of is not None:
        parts.append(f"in % of {number.written['percent_of']}")
    return f"{number.title} ({'; '.join(parts)})"


def problems(
    content: Content, units: dict[str, str], parameters: Table
) -> list[tuple[tuple[str, ...], str]]:
    """What is wrong with a system's numbers before it runs, keys and text; `units`: of every series
    there is."""
    wrong: list[tuple[tuple[str, ...], str]] = []
    for name, number in content.numbers.items():
        try:
            signals = number.signals
            if missing := [s for s in signals if s not in units]:
                raise DesatError(f"signal {missing[0]}: no such series{nearest(missing[0], units)}")
            if signals:
                known = _units(number, [units[s] for s in signals])
                _conversion(number, known, parameters)
                _options(number, known, parameters)
                if derivation := derived.of_entry(number):
                    _own(number, derivation[0], parameters)
        except DesatError as error:
            wrong.append((("numbers", name), str(error)))
    return wrong


def scale(source: str, target: str) -> float:
    """The factor from one unit to another. Raises DesatError where they do not fit."""
    source, target = source or "1", target or "1"
    return 1.0 if source == target else factor(unit_of(source), target, source)


def relative(form: str, value: float | None, reference: float | None) -> float | None:
    """`saving`: percent less than the reference; `ratio`: value over reference. None where one of
    them was not reached, or there is no ratio."""
    if value is None or not reference:
        return None
    if form == "saving":
        return 100.0 * (1.0 - value / reference)
    if form == "ratio":
        return value / reference
    raise DesatError(f"no form {form}; there is ratio, saving")


# --- A number of one run in relation to that of another -----------------------------------------


def related(form: str, value: float | None, reference: float | None) -> float | None:
    """`difference`: value less reference; `paired_ratio`: value over reference; else as
    `relative`. None where one of them was not reached. Raises DesatError for another
    form."""
    form = "ratio" if form == "paired_ratio" else form
    if form != "difference":
        return relative(form, value, reference)
    return None if value is None or reference is None else value - reference
