"""The measures that a scenario's `[numbers.NAME]` may name: how series become a number.

A measure takes times (rows,), values (rows, elements) and its options, and gives one
number: in the unit of the values, or in the one that is declared with it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from desat.components.contract.units import Unit, times, unit_of

from .derived import by_rows, error_vector, pointing

# --- What a measure is: a function that is known by its name, and the unit that it gives --------


Array = NDArray[np.float64]
Measure = Callable[..., float]
MEASURES: dict[str, Measure] = {}
OWN_UNIT: dict[str, Callable[[Unit], Unit]] = {}
"""Measures that give another unit than that of their values: which, from the values'
unit."""
LATE: set[str] = set()
"""Measures of a time at which a run reaches something. Where it does not they give nan,
no number; over several runs that is later than any time that one reached."""


def measure(function: Measure) -> Measure:
    """Make a function known by its name."""
    MEASURES[function.__name__] = function
    return function


def in_unit(
    unit: str | Callable[[Unit], Unit], late: bool = False
) -> Callable[[Measure], Measure]:
    """The same, of a function that gives a unit of its own, or one made from that of
    its values; `late`: it is one of LATE.
    """

    def known(function: Measure) -> Measure:
        if late:
            LATE.add(function.__name__)
        if isinstance(unit, str):
            fixed = unit_of(unit)
            OWN_UNIT[function.__name__] = lambda _: fixed
        else:
            OWN_UNIT[function.__name__] = unit
        return measure(function)

    return known


def per_second(unit: Unit) -> Unit:
    """The unit of a rate of change."""
    return times(unit, unit_of("s"), -1)


def settled(times: Array, good: NDArray[np.bool_]) -> float:
    """When it has become good to stay (s); nan where it does not."""
    bad = np.flatnonzero(~good)
    if not len(bad):
        return float(times[0])
    return float(times[bad[-1] + 1]) if good[-1] else float("nan")


__all__ = ["LATE", "MEASURES", "OWN_UNIT", "Measure"]


SCALARS = (
    "last",
    "growth_in",
    "growth_between",
    "growth_each",
    "steps_in",
    "time_between",
    "mean_rate",
)
"""Measures of one element."""

OF_EVENTS = ("steps_in", "growth_between", "growth_each", "time_between")
"""Measures between the events of a scalar that grows now and then: they need two."""

OF_ENDS = (
    "last",
    "norm_last",
    "mean_size_last",
    "along",
    "above",
    "growth_in",
    "mean_rate",
    "decay_rate",
    "pointing_last",
)
"""Measures of the last row, or of the first and the last: few rows suffice."""


@by_rows(1)
def mean_elements(values: Array) -> Array:
    """The mean size of the elements of each row."""
    return np.asarray(np.abs(values).mean(axis=1))


@by_rows(1)
def largest_elements(values: Array) -> Array:
    """The size of the largest element of each row."""
    return np.asarray(np.abs(values).max(axis=1))


@by_rows(1)
def norms(values: Array) -> Array:
    """The size of the vector in each row."""
    return np.asarray(np.linalg.norm(values, axis=1))


@by_rows(1)
def square_sums(values: Array) -> Array:
    """The sum of the squares of the elements of each row."""
    return np.asarray((values**2).sum(axis=1))


SIZES: dict[str, Callable[[Array], Array]] = {
    "mean": lambda v: mean_elements(v),
    "largest": lambda v: largest_elements(v),
    "norm": lambda v: norms(v),
}
"""Kinds of size of a row, for `until_below`."""


@measure
def last(times: Array, values: Array) -> float:
    """The last value of a scalar."""
    return float(values[-1, 0])


@measure
def norm_last(times: Array, values: Array) -> float:
    """The size of a vector at the end."""
    return float(np.linalg.norm(values[-1]))


@measure
def largest(times: Array, values: Array) -> float:
    """The largest size of any element at any time."""
    return float(largest_elements(values).max())


@measure
def norm_largest(times: Array, values: Array) -> float:
    """The largest size of a vector."""
    return float(norms(values).max())


@measure
def rms(times: Array, values: Array, each: int = 0) -> float:
    """The root of the mean square size; with `each` 1 of the mean square element."""
    mean = square_sums(values).mean()
    return float(np.sqrt(mean / len(values[0]) if each else mean))


@measure
def growth_in(times: Array, values: Array, time: float, multiple: float = 1.0) -> float:
    """How much a scalar grows in `time` seconds, from first to last row, times
    `multiple`; of what grows now and then take `steps_in`. It is nan with one row.
    """
    if len(times) < 2:
        return float("nan")
    return float(
        multiple * time * (values[-1, 0] - values[0, 0]) / (times[-1] - times[0])
    )


@in_unit("1")
def steps_in(times: Array, values: Array, time: float) -> float:
    """How often a scalar that grows now and then does so in `time` seconds: between its
    first and its last rise, so that neither the time before nor that after counts; nan
    with less than two.
    """
    rises = np.flatnonzero(np.diff(values[:, 0]) > 0.0)
    rises = rises[np.append(True, np.diff(rises) > 1)] if len(rises) else rises
    if len(rises) < 2:
        return float("nan")
    return float(time * (len(rises) - 1) / (times[rises[-1]] - times[rises[0]]))


@measure
def growth_between(times: Array, values: Array, driver: Array, time: float) -> float:
    """How much a scalar grows in `time` seconds, between the first and the last rise of
    another that grows now and then, as what each of its events takes; nan with less
    than two.
    """
    rises = np.flatnonzero(np.diff(driver[:, 0]) > 0.0) + 1
    if len(rises) < 2:
        return float("nan")
    first, last = rises[0], rises[-1]
    return float(
        time * (values[last, 0] - values[first, 0]) / (times[last] - times[first])
    )


@measure
def growth_each(times: Array, values: Array, driver: Array) -> float:
    """How much a scalar grows from one rise to the next of another that grows now and
    then, in the mean; nan with less than two.
    """
    rises = np.flatnonzero(np.diff(driver[:, 0]) > 0.0) + 1
    if len(rises) < 2:
        return float("nan")
    return float((values[rises[-1], 0] - values[rises[0], 0]) / (len(rises) - 1))


@in_unit("s")
def time_between(times: Array, values: Array) -> float:
    """The mean time from one rise to the next of a scalar that grows now and then (s);
    nan with less than two.
    """
    rises = np.flatnonzero(np.diff(values[:, 0]) > 0.0) + 1
    return float(np.diff(times[rises]).mean()) if len(rises) > 1 else float("nan")


@in_unit("%")
def share_along(times: Array, values: Array, direction: Array) -> float:
    """The root mean square of a vector's part along the direction of another, of that
    of its size (%); nan where the vector is zero throughout.
    """
    size = np.linalg.norm(direction, axis=1, keepdims=True)
    part = (values * direction).sum(axis=1) / np.where(size > 0.0, size, 1.0)[:, 0]
    total = (values**2).sum()
    return (
        float(100.0 * np.sqrt((part**2).sum() / total)) if total > 0.0 else float("nan")
    )


@measure
def norm_mean(times: Array, values: Array) -> float:
    """The mean size of a vector."""
    return float(norms(values).mean())


@measure
def norm_level_while(
    times: Array, values: Array, driver: Array, least: float, level: float
) -> float:
    """What the size of a vector stays below for `level` per cent of the time in which
    the size of another is at least `least`; nan where it never is.
    """
    there = np.linalg.norm(driver, axis=1) >= least
    size = np.linalg.norm(values[there], axis=1)
    return float(np.percentile(size, level)) if there.any() else float("nan")


@measure
def mean_size(times: Array, values: Array) -> float:
    """The mean over time and elements of the elements' sizes."""
    return float(mean_elements(values).mean())


@measure
def mean_size_last(times: Array, values: Array) -> float:
    """The mean of the elements' last sizes."""
    return mean_size(times, values[-1:])


@measure
def largest_mean(times: Array, values: Array) -> float:
    """The mean over time of the size of the largest element."""
    return float(largest_elements(values).mean())


@measure
def load_until_below(times: Array, values: Array, stored: Array, limit: float) -> float:
    """`largest_mean` of the values until the mean size of `stored` is below a limit to
    stay; of all where it never is.
    """
    end = np.fmin(until_below(times, stored, limit), times[-1])
    return largest_mean(times, values[: max(1, int(np.searchsorted(times, end)))])


@in_unit("1", late=True)
def settled_within(
    times: Array, values: Array, limits: list[float], since: float, period: float
) -> float:
    """After how many periods from `since` (s) on every element is within its limit to
    stay; 0: it never was outside.
    """
    good = np.asarray((np.abs(values) <= np.array(limits)).all(axis=1))
    return 0.0 if good.all() else (settled(times, good) - since) / period


@measure
def along(times: Array, values: Array, direction: list[float]) -> float:
    """The size of the last value's part along a direction, divided by the direction's
    length as the elements have it: |x.n| / n.n (the momentum of a wheel with n_i = 1
    that n alone makes).
    """
    n = np.array(direction)
    return float(abs(values[-1] @ n) / (n @ n))


@measure
def above(times: Array, values: Array, direction: list[float], floor: float) -> float:
    """The last mean size of the elements, less `along` or `floor`, whichever is larger."""
    return mean_size_last(times, values) - max(along(times, values, direction), floor)


@in_unit("s", late=True)
def until_below(times: Array, values: Array, limit: float, kind: str = "mean") -> float:
    """When the values have come below a limit to stay (s): the mean size of the
    elements, the largest, or the vector's (`norm`).
    """
    return settled(times, SIZES[kind](values) < limit)


@in_unit("s", late=True)
def first_reached(times: Array, values: Array, limit: float, count: int = 1) -> float:
    """When `count` elements at once have first reached a limit (s)."""
    return _first(times, (np.abs(values) >= limit).sum(axis=1) >= count)


@in_unit("s", late=True)
def first_below(
    times: Array, values: Array, limit: float, held: float = 0.0, only_done: int = 0
) -> float:
    """When the sizes of all elements at once have first come below a limit and stayed
    there for `held` seconds (s: the beginning of that time); with `only_done` 1 median
    and largest of several runs are of those that reach it.
    """
    good = (np.abs(values) < limit).all(axis=1)
    begins = np.flatnonzero(np.diff(good.astype(int), prepend=0) == 1)
    bad = np.flatnonzero(~good)
    for begin in begins:
        later = bad[bad > begin]
        end = later[0] if len(later) else len(times) - 1
        if times[end] - times[begin] >= held - 1e-9:
            return float(times[begin])
    return float("nan")


@in_unit("s", late=True)
def until_above(times: Array, values: Array, limit: float) -> float:
    """When all values have come to a limit or above to stay (s)."""
    return settled(times, np.asarray(values.min(axis=1) >= limit))


@measure
def largest_while(
    times: Array, values: Array, driver: Array, value: int, element: int = 0
) -> float:
    """The largest size of any element, or of one counted from 1, while a whole-number
    signal, such as a phase, has a value; nan where it never has.
    """
    there = (driver == value).all(axis=1)
    counted = values[:, element - 1 : element] if element else values
    return float(np.abs(counted[there]).max()) if there.any() else float("nan")


@in_unit("J")
def drive_energy(times: Array, values: Array, power: float, nominal: float) -> float:
    """The energy (J) of drives that take `power` (W) at `nominal` speed, and at another
    speed in proportion to its size.
    """
    speed = np.abs(values).sum(axis=1)
    return float(power / nominal * np.trapezoid(speed, times))


@in_unit("s", late=True)
def time_of(times: Array, values: Array, value: int) -> float:
    """When a whole-number signal, such as a mode, first has a value (s)."""
    return _first(times, (values == value).all(axis=1))


def _first(times: Array, there: NDArray[np.bool_]) -> float:
    """The time of the first row that is there (s); nan where none is."""
    return float(times[np.argmax(there)]) if there.any() else float("nan")


@in_unit("%")
def share_below(times: Array, values: Array, limit: float) -> float:
    """The share of time and elements whose size is below a limit (%). Elements that
    are zero all the time, as wheels that there are not, do not count.
    """
    small = np.abs(values) < limit
    idle = np.abs(values).max(axis=0) == 0.0
    return float(100.0 * (small.mean() - idle.mean()) / max(1.0 - idle.mean(), 1e-9))


@in_unit("1")
def sign_changes(times: Array, values: Array) -> float:
    """How often elements change their sign."""
    return float((np.diff(np.signbit(values), axis=0)).sum())


@in_unit(per_second)
def decay_rate(times: Array, values: Array) -> float:
    """How fast the size of a vector falls, from first to last row (unit per s); nan
    with one row.
    """
    if len(times) < 2:
        return float("nan")
    size = np.linalg.norm(values[[0, -1]], axis=1)
    return float((size[0] - size[1]) / (times[-1] - times[0]))


@in_unit(per_second)
def mean_rate(times: Array, values: Array) -> float:
    """How fast a scalar grows, from first to last row (unit per s); nan with one row."""
    if len(times) < 2:
        return float("nan")
    return float((values[-1, 0] - values[0, 0]) / (times[-1] - times[0]))


# --- Measures of the angle between two attitudes --------------------------------------


@in_unit("deg")
def pointing_last(times: Array, q: Array, q_ref: Array) -> float:
    """The angle between two attitudes at the end (deg)."""
    return float(pointing(q, q_ref)[-1])


@in_unit("deg")
def pointing_largest(times: Array, q: Array, q_ref: Array) -> float:
    """The largest angle between two attitudes (deg)."""
    late = pointing(q, q_ref)
    return float(late.max()) if len(late) else float("nan")


@in_unit("deg")
def pointing_rms(times: Array, q: Array, q_ref: Array) -> float:
    """The root mean square angle between two attitudes (deg)."""
    return float(np.sqrt((pointing(q, q_ref) ** 2).mean()))


@in_unit("deg")
def pointing_mean(times: Array, q: Array, q_ref: Array) -> float:
    """The mean angle between two attitudes (deg)."""
    return float(pointing(q, q_ref).mean())


@in_unit("s", late=True)
def pointing_until_below(times: Array, q: Array, q_ref: Array, limit: float) -> float:
    """When the angle has come below a limit (deg) to stay (s)."""
    return settled(times, pointing(q, q_ref) < limit)


@in_unit("deg")
def pointing_level(times: Array, q: Array, q_ref: Array, level: float = 95.0) -> float:
    """The angle that `level` per cent of the time stay below: absolute performance
    error (APE) at this level (deg); ECSS-E-ST-60-10C.
    """
    return float(np.percentile(pointing(q, q_ref), level))


@by_rows(1)
def deviations(windows: Array) -> Array:
    """The distances (windows, rows) of vectors (windows, rows, 3) from their mean."""
    mean = windows.mean(axis=1, keepdims=True)
    return np.asarray(np.linalg.norm(windows - mean, axis=2))


@in_unit("deg")
def pointing_relative(
    times: Array, q: Array, q_ref: Array, interval: float, level: float | None = None
) -> float:
    """The relative performance error (RPE) over intervals of so many seconds (deg): the
    distance of the error vector from its mean over its interval. Its mean, or the value
    that `level` per cent of the time stay below; ECSS-E-ST-60-10C.
    """
    if len(times) < 2:
        return float("nan")
    error = error_vector(q, q_ref)
    count = max(1, round(interval / (times[1] - times[0])))
    windows = error[: len(error) // count * count].reshape(-1, count, 3)
    if not len(windows):
        return float("nan")
    size = deviations(windows)
    return float(size.mean() if level is None else np.percentile(size, level))
