"""Represent a signal over a step by mean and slope: its impulse and first moment.

Over a step of length H, with s = (t - t_k) / H:

    x_mean  = int_0^1 x ds
    x_slope = 12 int_0^1 (s - 1/2) x ds

Both have the unit of x, and the receiver applies x_mean + x_slope (s - 1/2). Impulse
and first moment are then exact for any signal, so nothing is lost between two blocks. A
constant has slope 0.
"""

from __future__ import annotations

from functools import lru_cache
from math import exp, expm1


def pulse(begin: float, end: float) -> tuple[float, float]:
    """Compute mean and slope of a unit pulse from s = begin to s = end.

    0 <= begin <= end <= 1.
    """
    width = end - begin
    return width, 6.0 * width * (begin + end - 1.0)


def window(begin: float, end: float, t: float, dt: float) -> tuple[float, float, float]:
    """Compute mean and slope on [t, t + dt] of a signal that is 1 on [begin, end].

    The third result is the time (s) that the signal is 1 within the step.
    """
    first, last = max(begin - t, 0.0), min(end - t, dt)
    if last <= first:
        return 0.0, 0.0, 0.0
    mean, slope = pulse(first / dt, last / dt)
    return mean, slope, last - first


def part(begin: float, end: float, mean: float, slope: float) -> tuple[float, float]:
    """Convert mean and slope on s = begin to end to those over the whole step.

    The signal is 0 outside of that part.
    """
    width = end - begin
    return mean * width, width * (6.0 * mean * (begin + end - 1.0) + slope * width)


@lru_cache(maxsize=64)  # most steps have the same length
def lag(ratio: float) -> tuple[float, float, float]:
    """Compute mean, slope and end value of exp(-s ratio) over one step.

    ratio = step / time constant. A first-order lag from x0 to x1 has the mean x1 + (x0
    - x1) * mean; slope and end value follow likewise.
    """
    if ratio < 1.0:  # the closed form loses digits; the series errs by 1e-17
        mean = slope = 0.0
        term = 1.0
        for n in range(19):
            mean += term / (n + 1)
            slope += term * (1.0 / (n + 2) - 0.5 / (n + 1))
            term *= -ratio / (n + 1)
        return mean, 12.0 * slope, exp(-ratio)
    end = exp(-ratio)
    mean = -expm1(-ratio) / ratio
    first = (mean - end) / ratio  # int_0^1 s exp(-s ratio) ds
    return mean, 12.0 * (first - 0.5 * mean), end


def first_order(
    x0: float, x1: float, ratio: float
) -> tuple[float, float, float, float]:
    """Compute mean, slope, end and mean square of a first-order lag from x0 to x1.

    ratio = step / time constant; x1 is the value that the lag tends to.
    """
    mean, slope, end = lag(ratio)
    square = lag(2.0 * ratio)[0]
    d = x0 - x1
    return (
        x1 + d * mean,
        d * slope,
        x1 + d * end,
        x1 * x1 + d * (2.0 * x1 * mean + d * square),
    )
