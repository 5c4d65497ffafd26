"""What a signal does over a step, as mean and slope: impulse and its first moment.

Over a step of length H, with s = (t - t_k) / H:

    x_mean  = int_0^1 x ds
    x_slope = 12 int_0^1 (s - 1/2) x ds

Both have the unit of x, and the receiver applies x_mean + x_slope (s - 1/2). Impulse and first
moment are then exact whatever the signal did, so nothing is lost between two blocks. A constant
has slope 0.
"""

from __future__ import annotations

from math import exp, expm1


def pulse(begin: float, end: float) -> tuple[float, float]:
    """Mean and slope of a unit pulse from s = begin to s = end (0 <= begin <= end <= 1)."""
    width = end - begin
    return width, 6.0 * width * (begin + end - 1.0)


def lag(ratio: float) -> tuple[float, float, float]:
    """Mean, slope and end value of exp(-s ratio), ratio = step / time constant, over one step.

    A first-order lag from x0 to x1 has mean x1 + (x0 - x1) * mean, and slope and end likewise.
    """
    if ratio < 1.0:  # the closed form cancels; the series is good to 1e-17
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
