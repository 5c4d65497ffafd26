"""What a master does in a step, operation by operation.

An operation is called with the step's number k, by `master.py`; and it is plain data,
which `compiled.py` hands to the compiled loop. There are no others.
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
    """Something that is done in step k."""

    def __call__(self, k: int, /) -> None:
        """Do it. Raises ComponentError where a component fails."""


@dataclass(frozen=True, slots=True)
class Tick:
    """The beginning of a part of a step: the clocks of those who step in it."""

    start: float
    step: float
    at: float
    """Share of the step."""
    clocks: list[ctypes.c_double]

    def t(self, k: int) -> float:
        """Its time in step k (s)."""
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
    """target[into] = factor source[index] + offset; without `conversion` the values as
    they are, without `into` all of them."""

    kind: Kind
    source: Array
    target: Array
    index: NDArray[np.intp]
    into: NDArray[np.intp] | None = None
    conversion: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
    """factor, offset"""

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
    """A component's inputs set, its step made, or its outputs read."""

    instance: Instance
    verb: Verb
    tick: Tick
    call: Callable[[], int]
    word: int
    """What `current_call` has of it."""

    @classmethod
    def of(cls, instance: Instance, verb: Verb, tick: Tick) -> Call:
        """The prepared call of a wired instance."""
        word = instance.place + {"push": PUSH, "step": STEP, "pull": PULL}[verb]
        return cls(instance, verb, tick, getattr(instance, verb), word)

    def __call__(self, k: int) -> None:
        word[0] = self.word
        if (status := self.call()) > 1:
            raise self.failed(k, status)
        if status:
            self.warn(k)

    def warn(self, k: int) -> None:
        """Say once that the call returned a warning, in step k."""
        when = f", the first time at t = {self.tick.t(k):g} s"
        warn_of(self.instance, VERBS[self.word % PLACE], when)

    def failed(self, k: int, status: int) -> ComponentError:
        """The error for an FMI status in step k."""
        return self.instance.failed(_DOING[self.verb].format(self.tick.t(k)), status)


@dataclass(frozen=True, slots=True)
class Publish:
    """Values that are seen from here on."""

    live: Array
    fresh: Array

    def __call__(self, k: int = 0) -> None:
        self.live[:] = self.fresh


@dataclass(frozen=True, slots=True)
class Accumulate:
    """Part i joined to the window that it belongs to."""

    whole: Whole
    i: int

    def __call__(self, k: int) -> None:
        self.whole(self.i)


@dataclass(frozen=True, slots=True)
class Split:
    """Part i cut from its window."""

    part: Part
    i: int

    def __call__(self, k: int) -> None:
        self.part(self.i)


@dataclass(frozen=True, slots=True)
class KeepRow:
    """A further row of values, which are those at `index` of `source`."""

    source: Array
    index: NDArray[np.intp]
    rows: Array
    """(room, values)"""
    taken: NDArray[np.int64]
    """(1,) so many rows are there."""

    def __call__(self, k: int = 0) -> None:
        self.rows[self.taken[0]] = self.source[self.index]
        self.taken[0] += 1


class Step(NamedTuple):
    """A step of a cycle: what is done before its row is taken, and after."""

    before: list[Operation]
    after: list[Operation]


# --- Means and slopes over windows of different length: between components of different rates ---
# Over a window a quantity is mean + slope (s - 1/2), s from 0 to 1. Of the parts of a window that
# follow each other, each with start a and width w as shares of it, mean m and slope p:
#
#     mean = sum w m,   slope = sum w (6 m (2 a + w - 1) + w p)
#
# which keeps the integral and the first moment; and the part (a, w) of a window has
#
#     mean = m + p (a + w / 2 - 1/2),   slope = w p.


Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Places:
    """Where means (m,) and their slopes (m,) lie in an array, a negative number where
    there is no slope."""

    means: NDArray[np.intp]
    slopes: NDArray[np.intp]

    @classmethod
    def of(cls, means: Sequence[int], slopes: Sequence[int]) -> Places:
        """From lists of one length."""
        return cls(np.array(means, np.intp), np.array(slopes, np.intp))

    def read(self, values: Floats) -> tuple[Floats, Floats]:
        """Means (m,) and slopes (m,), zero where there is none."""
        slopes = np.where(self.slopes >= 0, values[self.slopes], 0.0)
        return values[self.means], slopes

    def write(self, values: Floats, means: Floats, slopes: Floats) -> None:
        """Put means (m,) and slopes (m,) in their places."""
        values[self.means] = means
        kept = self.slopes >= 0
        values[self.slopes[kept]] = slopes[kept]


class Whole:
    """Joins the parts of a window: outputs of a fast component for a slower one, or for
    a row."""

    def __init__(
        self,
        live: Floats,
        source: Places,
        into: Floats,
        target: Places,
        parts: Sequence[Share],
    ) -> None:
        self.live, self.source, self.into, self.target = live, source, into, target
        self.weights = [(w, 6.0 * w * (2.0 * a + w - 1.0), w * w) for a, w in parts]
        """Of each part: of its mean in the mean and in the slope, and of its slope
        there."""
        self.mean = np.zeros(len(source.means))
        self.slope = np.zeros(len(source.means))

    def __call__(self, i: int) -> None:
        """Add part i, which was just computed; the last one completes the window."""
        mean, slope = self.source.read(self.live)
        w, of_mean, of_slope = self.weights[i]
        if i == 0:
            self.mean[:] = self.slope[:] = 0.0
        self.mean += w * mean
        self.slope += of_mean * mean + of_slope * slope
        if i == len(self.weights) - 1:
            self.target.write(self.into, self.mean, self.slope)


class Part:
    """Cuts a window: outputs of a slow component for a faster one."""

    def __init__(
        self, live: Floats, source: Places, target: Places, parts: Sequence[Share]
    ) -> None:
        self.live, self.source, self.target = live, source, target
        self.weights = [(a + 0.5 * w - 0.5, w) for a, w in parts]
        """Of each part: of the window's slope in its mean and in its slope."""

    def __call__(self, i: int) -> None:
        """Put part i where the receiver reads it."""
        mean, slope = self.source.read(self.live)
        in_mean, in_slope = self.weights[i]
        self.target.write(self.live, mean + in_mean * slope, in_slope * slope)
