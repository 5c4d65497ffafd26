"""Compute numbers from series: the value of a scenario's `[numbers.NAME]` in a run.

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
    derive = "euler"                 # the measured quantity, derived from the signals: derived.py
    sequence = "321"
    element = 3                      # only this element of the quantity is measured
    measure = "largest"
    unit = "deg"

An option may be a product of parameters, too (`system/expression.py`).
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desat.components.contract.units import Unit

from ..system.errors import DesatError, MisfitError, nearest
from ..system.expression import Table, entry, factor, product
from ..system.parameters import unit_of
from . import derived
from .measures import LATE, MEASURES, OWN_UNIT, SCALARS, SIZES, Measure

if TYPE_CHECKING:
    from ..engine.recording.results import Results
    from ..language.content import Content
    from ..language.scenario import Number, Plot

OPEN_END = 1e9  # s: a window that ends here or later ends with the run


class SeriesUnit(NamedTuple):
    """Unit and width of a series, which a number needs before it is measured."""

    unit: str
    width: int  # elements; 0: not known


# Function that returns unit and elements of `component.output`, or None where the FMU
# of the component is missing. It raises DesatError where there is no such series.
SeriesLookup = Callable[[str], SeriesUnit | None]


class MeasuredNumber(NamedTuple):
    """Number of a run, and the samples that it is measured over."""

    value: float | None  # in the number's unit; None where the run does not reach it
    samples: int
    # whether they are samples of a reference that is not known at the rows between
    is_of_reference: bool = False


class BoundNumber(NamedTuple):
    """Number of a scenario, bound to a system or run."""

    number: Number
    measure: Measure
    quantity: derived.DerivedQuantity | None
    derive_options: dict[str, Any]
    options: dict[str, Any]  # of the measure, as numbers
    convert: Callable[[float], float]  # from the measure's unit to the number's
    # s, of the reference that attitudes are compared with; 0: rows are taken as they are
    sample_time: float = 0.0

    def evaluate(self, results: Results) -> MeasuredNumber:
        """Measure it in a run.

        The run does not reach it where no row is in its window, or there is nothing to
        measure.
        """
        signals = derived.compared_signals(self.number, set(results.names()))
        columns = self._columns(results, signals)
        rows = min(len(c) for c in columns)
        times = results.times()[:rows]
        held = self.sample_time > 0.0 and signals == tuple(self.number.signals)
        if held:
            sampled = derived.sample_rows(times, self.sample_time)
            times, columns = times[sampled], [_at(c, sampled) for c in columns]
            rows = len(times)
        if self.number.window:
            begin, end = self.number.window
            inside = (times >= begin - 1e-6) & (times <= end + 1e-6)
            times, columns = times[inside], [_at(c, inside) for c in columns]
            rows = len(times)
        if rows == 0:
            return MeasuredNumber(None, 0, held)
        columns = [derived.head(c, rows) for c in columns]
        with np.errstate(over="ignore"):  # a run that diverges has infinite numbers
            value = self.measure(times, *columns, **self.options)
        converted_value = None if math.isnan(value) else self.convert(value)
        return MeasuredNumber(converted_value, rows, held)

    def _columns(self, results: Results, signals: Sequence[str]) -> list[Any]:
        """Return the measured columns, (rows, elements) each, as arrays or series.

        They are the signals or a quantity derived from them, which is cached, because
        several numbers measure the same one.
        """
        number = self.number
        columns = [results.series(name, slice(None)) for name in signals]
        if self.quantity is not None:
            key = (number.derive, *signals, number.sequence)
            options = self.derive_options
            make = partial(self.quantity.rows, results.times(), columns, options)
            columns = [results.recent(key, make)]
        if element := number.element:
            if element > columns[0].shape[1]:
                raise DesatError(f"element {element}: there are {columns[0].shape[1]}")
            columns[0] = columns[0][:, element - 1 : element]
        return columns


def _at(column: Any, rows: NDArray[np.bool_]) -> Any:
    """Return these of the first rows of an array or a series."""
    if isinstance(column, np.ndarray):
        return column[: len(rows)][rows]
    return column.at(rows)


def bind(number: Number, series: SeriesLookup, parameters: Table | None) -> BoundNumber:
    """Bind a number to the series and parameters of a system or of a run.

    Without `parameters`, which a system that cannot be built lacks, everything that
    follows from them is left out, and the result serves as a check only.

    Raises
    ------
    MisfitError
        If measure, option, derived quantity, series, element, unit or parameter does
        not fit.
    """
    check_words(number)
    measure = MEASURES[number.measure]
    quantity, derive_options = derived.of_entry(number) or (None, {})
    signals = []
    for name in number.signals:
        try:
            signal = series(name)
        except DesatError as error:
            raise MisfitError(str(error), "signal") from error
        if signal is not None:
            signals.append(signal)
    if len(signals) < len(number.signals):
        return BoundNumber(number, measure, quantity, {}, {}, float)
    texts = [s.unit for s in signals]
    if quantity is not None:
        texts = [quantity.unit or signals[0].unit]
    units = [unit_of(text) for text in texts]
    _check_elements(number, len(quantity.names) if quantity else signals[0].width)
    try:
        convert = _conversion(number, texts[0], parameters)
    except DesatError as error:
        raise MisfitError(str(error), "unit") from error
    options = dict(number.options)
    if parameters is not None:
        options = _options(number, units, parameters)
        owner = number.signals[0].partition(".")[0]
        for name in quantity.extra_series if quantity else ():
            derive_options[name] = entry(f"{owner}.{name}", parameters)[0]
    return BoundNumber(
        number,
        measure,
        quantity,
        derive_options,
        options,
        convert,
        sample_time_of(number, parameters),
    )


def sample_time_of(entry: Number | Plot, parameters: Table | None) -> float:
    """Return the sample time (s) of the reference of an attitude error; 0 without one."""
    measure = getattr(entry, "measure", "")
    reference = derived.reference_of(entry.signals, measure, entry.derive)
    owner = reference.partition(".")[0]
    sample_time = (parameters or {}).get(owner, {}).get("sample_time")
    return float(sample_time.value) if sample_time is not None else 0.0


def evaluate(number: Number, results: Results, parameters: Table) -> MeasuredNumber:
    """Measure a scenario's number in a run.

    Raises
    ------
    DesatError
        If the run lacks a series, a unit does not fit, or a product of parameters has
        no value.
    """

    def series(name: str) -> SeriesUnit:
        """Return the unit of a series; its width is not known."""
        return SeriesUnit(results.attribute(name, "unit"), 0)

    return bind(number, series, parameters).evaluate(results)


# --- What is wrong with a number by itself --------------------------------------------


class MeasureOptions(NamedTuple):
    """Arguments of a measure after the times."""

    series: list[str]
    defaults: Mapping[str, Any]  # of its options, or inspect.Parameter.empty
    kinds: Mapping[str, str]  # of its options, as annotated


@cache
def options_of(measure: str) -> MeasureOptions:
    """Return the series and options that a measure takes."""
    parameters = list(inspect.signature(MEASURES[measure]).parameters.values())[1:]
    series = [p.name for p in parameters if p.annotation == "Array"]
    options = [p for p in parameters if p.annotation != "Array"]
    return MeasureOptions(
        series,
        {p.name: p.default for p in options},
        {p.name: p.annotation for p in options},
    )


def check_words(number: Number) -> None:
    """Check measure, options and derived quantity of a number without any system.

    Raises
    ------
    MisfitError
        For the first of them that does not exist or does not fit.
    """
    measure = number.measure
    if measure not in MEASURES:
        raise MisfitError(
            f"no measure {measure}{nearest(measure, MEASURES)}", "measure"
        )
    series, defaults, kinds = options_of(measure)
    derived.of_entry(number)
    if number.element and len(series) > 1:
        raise MisfitError(
            f"{measure} takes {len(series)} series; only with one", "element"
        )
    count = 1 if number.derive else len(number.signals)
    if count != len(series):
        raise MisfitError(f"{count} given; {measure} takes {len(series)}", "signal")
    for option, value in number.options.items():
        if option not in defaults:
            hint = nearest(option, defaults) or "; it has none"
            raise MisfitError(
                f"{measure} has no option {option}{hint}", "options", option
            )
        if option_needed := _needed_instead(option, kinds[option], value):
            raise MisfitError(
                f"got {value!r}; {option_needed} is needed", "options", option
            )
    for option, default in defaults.items():
        if default is inspect.Parameter.empty and option not in number.options:
            raise MisfitError(f"{measure} needs {option}", "options")


def _needed_instead(option: str, annotation: str, value: Any) -> str:
    """Describe the value that an option of a measure needs; empty if it has one.

    A text may stand for a number: it names parameters.
    """
    if option == "kind":
        return "" if value in SIZES else " or ".join(SIZES)
    if annotation.startswith("list"):
        is_list = isinstance(value, list) and all(
            type(x) in (int, float) for x in value
        )
        return "" if is_list else "a list of numbers"
    if annotation == "int":
        return "" if type(value) is int else "a whole number"
    return "" if type(value) in (int, float, str) else "a number"


def _check_elements(number: Number, count: int) -> None:
    """Raise MisfitError for an element that does not exist, or several for one."""
    if not count:
        return
    if (number.element or 0) > count:
        subject = number.derive or "the signal"
        raise MisfitError(f"got {number.element}; {subject} has {count}", "element")
    if not number.element and count > 1 and number.measure in SCALARS:
        raise MisfitError(
            f"{number.measure} takes one element; there are {count}", "element"
        )


def late(content: Content) -> set[str]:
    """Return the names of numbers that are times at which something is reached.

    Over several runs, one that does not reach such a time ranks after all that do.
    Numbers with `only_done` are not among them.
    """
    return {
        name
        for name, number in content.numbers.items()
        if number.signals
        and number.measure in LATE
        and not number.options.get("only_done")
    }


def ranks(values: Sequence[float | None], is_late: bool) -> list[Any]:
    """Return a number over several runs for ranking; a time not reached is infinite."""
    return [math.inf if x is None and is_late else x for x in values]


def _conversion(
    number: Number, own_unit: str, parameters: Table | None
) -> Callable[[float], float]:
    """Return the conversion from the measure's unit to the number's.

    The series is in `own_unit`.

    Raises
    ------
    DesatError
        If they do not fit.
    """
    name, unit = number.measure, number.unit
    source, unit_text = unit_of(own_unit), own_unit or "1"
    if name in OWN_UNIT:
        source, unit_text = OWN_UNIT[name](source), f"of {name}"
    if (reference := number.percent_of) is not None:
        if unit != "%":
            raise DesatError(f"unit {unit or None}: a number with percent_of is in %")
        if isinstance(reference, str):
            if parameters is None:
                return float
            text, (reference, reference_unit) = (
                reference,
                product(reference, parameters),
            )
            if reference_unit.dimension != source.dimension:
                raise DesatError(
                    f'percent_of = "{text}": its unit is not that of {name}'
                )
            reference *= reference_unit.factor / source.factor
        if reference == 0.0:
            raise DesatError(f"percent_of = {number.written['percent_of']} is 0")
        share = float(reference)
        return lambda value: 100.0 * value / share
    if not unit or (name not in OWN_UNIT and unit_of(unit) == source):
        return lambda value: value
    scaled = factor(source, unit, unit_text)
    return lambda value: value * scaled


def _options(number: Number, units: list[Unit], parameters: Table) -> dict[str, Any]:
    """Evaluate the options of a measure; products of parameters become values.

    The unit of a product has to be that of one of the series.
    """
    options = dict(number.options)
    texts = {key: value for key, value in options.items() if isinstance(value, str)}
    kinds = options_of(number.measure).kinds
    for key, value in texts.items():
        if kinds[key] == "float":
            options[key], unit = product(value, parameters)
            if all(unit.dimension != u.dimension for u in units):
                raise DesatError(f'{key} = "{value}": its unit is that of no signal')
    return options


def defined(number: Number | None) -> str:
    """Describe a number in a sentence: its title, and how it is measured.

    Empty for None.
    """
    if number is None:
        return ""
    if number.reference:
        relation = f"{number.form} of {number.of} to that of {number.reference}"
        return f"{number.title} ({relation})"
    sentence = " ".join(
        (inspect.getdoc(MEASURES[number.measure]) or "").split()
    ).removesuffix(".")
    of = " and ".join(number.signals)
    if number.derive:
        of = f"{number.derive.replace('_', ' ')} of {of}"
    parts = [f"{sentence[0].lower()}{sentence[1:]}; of {of}"]
    parts += [f"{k} = {v}" for k, v in number.options.items()]
    if number.window:
        begin, end = number.window
        parts.append(
            f"from {begin:g} s to " + ("the end" if end >= OPEN_END else f"{end:g} s")
        )
    if number.percent_of is not None:
        parts.append(f"in % of {number.written['percent_of']}")
    return f"{number.title} ({'; '.join(parts)})"


def scale(source: str, target: str) -> float:
    """Return the factor from one unit to another.

    Raises
    ------
    DesatError
        If the units do not fit.
    """
    source, target = source or "1", target or "1"
    return 1.0 if source == target else factor(unit_of(source), target, source)


def relative(form: str, value: float | None, reference: float | None) -> float | None:
    """Compute a saving (% less than the reference) or a ratio (value over reference).

    None where one of the values was not reached, or the reference is zero. Raises
    DesatError for another form.
    """
    if value is None or not reference:
        return None
    if form == "saving":
        return 100.0 * (1.0 - value / reference)
    if form == "ratio":
        return value / reference
    raise DesatError(f"no form {form}; there is ratio, saving")


# --- A number of one run in relation to that of another -------------------------------


def related(form: str, value: float | None, reference: float | None) -> float | None:
    """Compare a value with a reference: `difference`, `paired_ratio`, or as `relative`.

    A difference (value less reference) has the unit of both, a ratio has none. None
    where one of the two was not reached. Raises DesatError for another form.
    """
    form = "ratio" if form == "paired_ratio" else form
    if form != "difference":
        return relative(form, value, reference)
    return None if value is None or reference is None else value - reference
