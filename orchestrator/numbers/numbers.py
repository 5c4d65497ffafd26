"""Numbers from series: what a scenario's `[NAME]` gives of a run.

    [wheels]
    title = "Mean wheel from 2 h on"
    signal = "wheels.h_wheel"        # or several, where the measure takes several
    measure = "mean_size"            # measures.py
    options = {}                     # the measure's own
    window = [7200.0, 86400.0]       # only rows of this time (s), ends included; default: all
    percent_of = "wheels.inertia_wheel * wheels.speed_limit"   # in per cent of this: a product
                                     # of parameters, or a number in the measure's own unit
    unit = "%"                       # else: converted from the measure's unit

    [roll]
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
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from desat.components.contract.units import Unit

from ..system.errors import DesatError, nearest
from ..system.expression import Table, entry, factor, product, unit_of
from . import derived
from .measures import LATE, MEASURES, OWN_UNIT

if TYPE_CHECKING:
    from ..engine.recording.results import Results

OPEN_END = 1e9
"""A window that ends here or later (s) ends with the run."""


def evaluate(number: dict[str, Any], results: Results, parameters: Table) -> float | None:
    """The number that a scenario describes: `signal`, `measure` and the measure's options.

    None where the run does not reach it: no row in its window, or nothing there to measure.
    Raises DesatError for an unknown measure or series, a unit that does not fit, and a product of
    parameters that has no value.
    """
    name, names = _measure(number), signals_of(number)
    units = _units(number, [results.attribute(s, "unit") for s in names])
    conversion = _conversion(number, units, parameters)
    options = _options(number, units, parameters)
    columns = _columns(number, results, parameters)
    rows = min(len(c) for c in columns)
    times = results.times()[:rows]
    if "window" in number:
        begin, end = number["window"]
        kept = (times >= begin - 1e-6) & (times <= end + 1e-6)
        times, columns = times[kept], [c[:rows][kept] for c in columns]
        rows = len(times)
    if rows == 0:
        return None
    with np.errstate(over="ignore"):  # a run that diverges has infinite numbers
        value = MEASURES[name](times, *(c[:rows] for c in columns), **options)
    return None if math.isnan(value) else conversion(value)


def signals_of(number: dict[str, Any]) -> list[str]:
    """The series that a number is made of."""
    signals = number.get("signal", [])
    return [signals] if isinstance(signals, str) else list(signals)


def late(about: Mapping[str, Any]) -> set[str]:
    """A scenario's numbers that are times at which something is reached: over several runs, one
    that does not reach it is later than all that do. Not those with `only_done`."""
    return {
        name for name, number in about.get("numbers", {}).items()
        if number.get("measure") in LATE and not number.get("options", {}).get("only_done")
    }  # fmt: skip


def ranked(values: Sequence[float | None], is_late: bool) -> list[Any]:
    """A number over several runs, as it is ranked: a time that is not reached is infinite."""
    return [math.inf if x is None and is_late else x for x in values]


def _columns(
    number: dict[str, Any], results: Results, parameters: Table
) -> list[derived.Array]:  # fmt: skip
    """What is measured, (rows, elements) each: the series, or what is derived of them. Several
    numbers measure the same."""

    def column(signal: str) -> derived.Array:
        values = results.values(signal)
        return (values if values.ndim > 1 else values[:, None]).astype(float)

    names = signals_of(number)
    columns = [results.recent(name, partial(column, name)) for name in names]
    if derivation := derived.of_entry(number):
        quantity, options = derivation
        key = (number["derive"], *names, *options.items())
        options = {**options, **_own(number, quantity, parameters)}
        make = partial(quantity.rows, results.times(), columns, options)
        columns = [results.recent(key, make)]
    if "element" in number:
        element = number["element"]
        if element > columns[0].shape[1]:
            raise DesatError(f"element {element}: there are {columns[0].shape[1]}")
        columns[0] = columns[0][:, element - 1 : element]
    return columns


def _own(
    number: dict[str, Any], quantity: derived.Quantity, parameters: Table
) -> dict[str, Any]:  # fmt: skip
    """The parameters that a derived quantity takes. Raises DesatError where there are none."""
    owner = signals_of(number)[0].partition(".")[0]
    return {name: entry(f"{owner}.{name}", parameters)[0] for name in quantity.own}


def _units(number: dict[str, Any], signals: list[str]) -> list[Unit]:
    """The unit of each of what is measured, from those of the signals."""
    if derivation := derived.of_entry(number):
        signals = [derivation[0].unit or signals[0]]
    return [unit_of(s) for s in signals]


def _measure(number: dict[str, Any]) -> str:
    name: str = number.get("measure", "last")
    if name not in MEASURES:
        raise DesatError(f"no measure {name}{nearest(name, MEASURES)}")
    return name


def _conversion(
    number: dict[str, Any], units: list[Unit], parameters: Table
) -> Callable[[float], float]:  # fmt: skip
    """From the measure's unit to the number's. Raises DesatError where they do not fit."""
    name = _measure(number)
    source = OWN_UNIT[name](units[0]) if name in OWN_UNIT else units[0]
    unit = number.get("unit")
    if "percent_of" in number:
        if unit != "%":
            raise DesatError(f"unit {unit}: a number with percent_of is in %")
        whole = number["percent_of"]
        if isinstance(whole, str):
            text, (whole, own) = whole, product(whole, parameters)
            if own.dimension != source.dimension:
                raise DesatError(f'percent_of = "{text}": its unit is not that of {name}')
            whole *= own.factor / source.factor
        if whole == 0.0:
            raise DesatError(f"percent_of = {number['percent_of']} is 0")
        return lambda value: 100.0 * value / float(whole)
    if unit is None or (name not in OWN_UNIT and unit_of(unit) == source):
        return lambda value: value
    scaled = factor(source, unit, f"of {name}")
    return lambda value: value * scaled


def _options(number: dict[str, Any], units: list[Unit], parameters: Table) -> dict[str, Any]:
    """The measure's options; a product of parameters has the unit of one of its series."""
    options = dict(number.get("options", {}))
    accepted = inspect.signature(MEASURES[_measure(number)]).parameters
    for key, value in options.items():
        if key not in accepted:
            raise DesatError(f"no option {key}{nearest(key, accepted)}")
        if isinstance(value, str) and accepted[key].annotation == "float":
            options[key], unit = product(value, parameters)
            if all(unit.dimension != u.dimension for u in units):
                raise DesatError(f'{key} = "{value}": its unit is that of no signal')
    return options


def defined(number: dict[str, Any] | None) -> str:
    """A number of a scenario in a sentence: its title, and how it is measured. Empty for None."""
    if number is None:
        return ""
    title = str(number["title"])
    if "reference" in number:
        how = f"{number['form']} of {number['of']} to that of {number['reference']}"
        return f"{title} ({how})"
    what = inspect.getdoc(MEASURES[_measure(number)]) or ""
    sentence = " ".join(what.split()).removesuffix(".")
    of = " and ".join(signals_of(number))
    if "derive" in number:
        of = f"{number['derive'].replace('_', ' ')} of {of}"
    parts = [f"{sentence[0].lower()}{sentence[1:]}; of {of}"]
    parts += [f"{k} = {v}" for k, v in number.get("options", {}).items()]
    if "window" in number:
        begin, end = number["window"]
        parts.append(f"from {begin:g} s to " + ("the end" if end >= OPEN_END else f"{end:g} s"))
    if "percent_of" in number:
        parts.append(f"in % of {number['percent_of']}")
    return f"{title} ({'; '.join(parts)})"


def problems(about: dict[str, Any], units: dict[str, str], parameters: Table) -> list[str]:
    """What is wrong with a system's numbers before it runs; `units`: of every series there is."""
    wrong = []
    for name, number in about.get("numbers", {}).items():
        try:
            if missing := [s for s in signals_of(number) if s not in units]:
                raise DesatError(f"signal {missing[0]}: no such series{nearest(missing[0], units)}")
            if "reference" not in number:
                known = _units(number, [units[s] for s in signals_of(number)])
                _conversion(number, known, parameters)
                _options(number, known, parameters)
                if derivation := derived.of_entry(number):
                    _own(number, derivation[0], parameters)
        except DesatError as error:
            wrong.append(f"numbers.{name}: {error}")
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
