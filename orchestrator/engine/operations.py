"""Define the operations of which a master's step consists; there are no others.

`master.py` calls an operation with the step's number k. An operation is also plain
data, which `compiled.py` hands to the compiled loop.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..system.interface import Kind
from ..system.schedule import Share
from .current_call import PLACE, PULL, PUSH, STEP, VERBS, time, word
from .instances.base import Array, ComponentError, Instance, warn_of

Verb = Literal["push", "step", "pull"]
_DOING: dict[Verb, str] = {
    "push": "setting its inputs at t = {:g} s",
    "step": "the step from t = {:g} s",
    "pull": "reading its outputs after t = {:g} s",
}


class Operation(Protocol):
    """An action in step k."""

    def __call__(self, k: int, /) -> None:
        """Perform the operation; raise ComponentError if a component fails."""


@dataclass(frozen=True, slots=True)
class Tick:
    """The beginning of a part of a step; it sets the clocks of those who step then."""

    start: float
    step: float
    at: float  # share of the step
    clocks: list[ctypes.c_double]

    def t(self, k: int) -> float:
        """Return its time in step k (s)."""
        return self.start + (k + self.at) * self.step

    def __call__(self, k: int) -> None:
        t = time[0] = self.t(k)
        for clock in self.clocks:
            clock.value = t


@dataclass(frozen=True, slots=True)
class Length:
    """The length of a part of a step (s)."""

    of: ctypes.c_double
    value: float

    def __call__(self, k: int) -> None:
        self.of.value = self.value


@dataclass(frozen=True, slots=True)
class Gather:
    """target[into] = factor source[index] + offset.

    Without `conversion` the values are copied unchanged, and without `into` all are
    set. The source of Reals may be Integers.
    """

    kind: Kind  # of the target
    source: Array
    target: Array
    index: NDArray[np.intp]
    into: NDArray[np.intp] | None = None
    # factor and offset
    conversion: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None

    def __call__(self, k: int = 0) -> None:
        if self.into is None:
            self.source.take(self.index, None, self.target, "clip")
        elif self.conversion is None:
            self.target[self.into] = self.source[self.index]
        else:
            factor, offset = self.conversion
            self.target[self.into] = self.source[self.index] * factor + offset


@dataclass(slots=True)
class Call:
    """One call of a component: set its inputs, make its step, or read its outputs."""

    instance: Instance
    verb: Verb
    tick: Tick
    call: Callable[[], int]
    word: int  # of `current_call`

    @classmethod
    def of(cls, instance: Instance, verb: Verb, tick: Tick) -> Call:
        """Build the prepared call of a wired instance."""
        word = instance.place + {"push": PUSH, "step": STEP, "pull": PULL}[verb]
        return cls(instance, verb, tick, getattr(instance, verb), word)

    def __call__(self, k: int) -> None:
        word[0] = self.word
        if (status := self.call()) > 1:
            raise self.failed(k, status)
        if status:
            self.warn(k)

    def warn(self, k: int) -> None:
        """Record once that the call returned a warning, in step k."""
        occasion = f", the first time at t = {self.tick.t(k):g} s"
        warn_of(self.instance, VERBS[self.word % PLACE], occasion)

    def failed(self, k: int, status: int) -> ComponentError:
        """Build the error for an FMI status in step k."""
        return self.instance.failed(_DOING[self.verb].format(self.tick.t(k)), status)


@dataclass(frozen=True, slots=True)
class Publish:
    """Copy of values from `fresh` to `live`, where all components see them."""

    live: Array
    fresh: Array

    def __call__(self, k: int = 0) -> None:
        self.live[:] = self.fresh


@dataclass(frozen=True, slots=True)
class Accumulate:
    """Addition of part i to the window to which it belongs."""

    window: WindowMean
    i: int

    def __call__(self, k: int) -> None:
        self.window(self.i)


@dataclass(frozen=True, slots=True)
class Split:
    """Extraction of part i from its window."""

    part: OperationPart
    i: int

    def __call__(self, k: int) -> None:
        self.part(self.i)


@dataclass(frozen=True, slots=True)
class KeepRow:
    """Recording of the values of `source` at `index` as a further row."""

    source: Array
    index: NDArray[np.intp]
    rows: Array  # (room, values)
    taken: NDArray[np.int64]  # (1,) number of rows recorded

    def __call__(self, k: int = 0) -> None:
        self.rows[self.taken[0]] = self.source[self.index]
        self.taken[0] += 1


class Step(NamedTuple):
    """A step of a cycle: the operations before its row is taken, and those after."""

    before: list[Operation]
    after: list[Operation]


# --- Means and slopes over windows of different length: between components of different rates ---
# Over a window a quantity is mean + slope (s - 1/2), s from 0 to 1. A window whose consecutive
# parts have start a and width w (as shares of it), mean m and slope p has
#
#     mean = sum w m,   slope = sum w (6 m (2 a + w - 1) + w p)
#
# which preserves the integral and the first moment. The part (a, w) of a window has
#
#     mean = m + p (a + w / 2 - 1/2),   slope = w p.


Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Places:
    """Indices of means (m,) and their slopes (m,) in an array.

    An index is negative where there is no slope.
    """

    means: NDArray[np.intp]
    slopes: NDArray[np.intp]

    @classmethod
    def of(cls, means: Sequence[int], slopes: Sequence[int]) -> Places:
        """Build places from two lists of the same length."""
        return cls(np.array(means, np.intp), np.array(slopes, np.intp))

    def read(self, values: Floats) -> tuple[Floats, Floats]:
        """Return means (m,) and slopes (m,), zero where there is no slope."""
        slopes = np.where(self.slopes >= 0, values[self.slopes], 0.0)
        return values[self.means], slopes

    def write(self, values: Floats, means: Floats, slopes: Floats) -> None:
        """Write means (m,) and slopes (m,) to their places."""
        values[self.means] = means
        has_slope = self.slopes >= 0
        values[self.slopes[has_slope]] = slopes[has_slope]


class WindowMean:
    """Mean and slope over a window, joined from its parts.

    They are outputs of a fast component for a slower one, or for a row.
    """

    def __init__(
        self,
        live: Floats,
        source: Places,
        into: Floats,
        target: Places,
        parts: Sequence[Share],
    ) -> None:
        self.live, self.source, self.into, self.target = live, source, into, target
        # for each part: weights of its mean in mean and slope, of its slope in the slope
        self.weights = [(w, 6.0 * w * (2.0 * a + w - 1.0), w * w) for a, w in parts]
        self.mean = np.zeros(len(source.means))
        self.slope = np.zeros(len(source.means))

    def __call__(self, i: int) -> None:
        """Add part i, which was just computed; the last part completes the window."""
        mean, slope = self.source.read(self.live)
        w, of_mean, of_slope = self.weights[i]
        if i == 0:
            self.mean[:] = self.slope[:] = 0.0
        self.mean += w * mean
        self.slope += of_mean * mean + of_slope * slope
        if i == len(self.weights) - 1:
            self.target.write(self.into, self.mean, self.slope)


class OperationPart:
    """Mean and slope of the parts of a window: a slow component's for a faster one."""

    def __init__(
        self, live: Floats, source: Places, target: Places, parts: Sequence[Share]
    ) -> None:
        self.live, self.source, self.target = live, source, target
        # for each part: weights of the window's slope in the part's mean and slope
        self.weights = [(a + 0.5 * w - 0.5, w) for a, w in parts]

    def __call__(self, i: int) -> None:
        """Write part i where the receiver reads it."""
        mean, slope = self.source.read(self.live)
        in_mean, in_slope = self.weights[i]
        self.target.write(self.live, mean + in_mean * slope, in_slope * slope)
