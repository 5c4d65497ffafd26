"""Predict the covariance of a Kalman filter, and correct it by one measured number.

The filter has a state x (n) and its covariance P (n x n, row-major). Of a measurement
y = c'x + v, with v of variance R, the gain is k = P c / (c'P c + R), and

    x -> x + k (y - c'x),     P -> P - k c'P.

Between measurements P -> F P F'. Measurements whose errors are independent may be used
one after the other. The unit of x and y is that of the filter.

A filter is lost where innovations are beyond six standard deviations for `SURPRISES`
samples in a row, or where its covariance is that of nothing; it must then start anew.
"""

from __future__ import annotations

from math import isfinite

SURPRISE = 36.0  # square of an innovation over its variance: six standard deviations
SURPRISES = 5  # so many samples in a row, and the filter is lost
UNSOUND = 1e30  # in place of such a square, where something is no number


def correct(
    x: list[float],
    p: list[float],
    product: list[float],
    innovation: float,
    variance: float,
    estimated_states: int,
) -> None:
    """Correct the first states in place, and only consider the others (Schmidt).

    The states that are considered keep their values and their own covariance; the covariance between them
    and the first ones changes as it must for this gain. P stays symmetric to the bit.

    Parameters
    ----------
    x, p : list of float
        State (n) and covariance (n n, row-major).
    product : list of float
        P c (n).
    innovation : float
        y - c'x.
    variance : float
        Variance of the innovation, c'P c + R, or more (underweighted).
    estimated_states : int
        How many states are corrected; n: all.
    """
    states = len(x)
    share = innovation / variance
    for i in range(states):
        is_estimated = i < estimated_states
        if is_estimated:
            x[i] += product[i] * share
        # both halves: as loops of known length they need no checks in C
        for j in range(states):
            if is_estimated or j < estimated_states:
                p[states * i + j] -= product[i] * product[j] / variance


def predict(x: list[float], p: list[float], effects: list[float]) -> None:
    """Replace P by F P F' in place, where only the first states move, at most 6.

    Parameters
    ----------
    x, p : list of float
        State, which gives n and stays, and covariance (n n, row-major), symmetric, which
        it stays to the bit.
    effects : list of float
        The first rows of F (moving n, row-major); the others are those of the identity.
    """
    column = [0.0] * 6
    states = len(x)
    moving = len(effects) // states
    # F P first, column by column; the rows of constants do not change
    for j in range(states):
        for i in range(moving):
            total = 0.0
            for k in range(states):
                total += effects[states * i + k] * p[states * k + j]
            column[i] = total
        for i in range(moving):
            p[states * i + j] = column[i]
    # then (F P) F', in the first columns
    for i in range(moving):
        for j in range(moving):
            total = 0.0
            for k in range(states):
                total += p[states * i + k] * effects[states * j + k]
            column[j] = total
        for j in range(moving):
            p[states * i + j] = column[j]
    for i in range(moving):
        for j in range(i + 1, states):
            p[states * j + i] = p[states * i + j]


def surprise(innovation: float, variance: float) -> float:
    """Return an innovation's square over its variance (1); UNSOUND if that is no number."""
    if not (variance > 0.0 and isfinite(variance) and isfinite(innovation)):
        return UNSOUND
    return innovation * innovation / variance


def is_sound(x: list[float], p: list[float]) -> bool:
    """Return whether states and variances are finite and no variance is negative."""
    states = len(x)
    for i in range(states):
        variance = p[(states + 1) * i]
        if not (variance >= 0.0 and isfinite(variance) and isfinite(x[i])):
            return False
    return True


def count_surprises(before: int, largest: float) -> int:
    """Return how many samples in a row were surprising: `SURPRISES`, and it is lost.

    before: the same at the last sample; largest: of `surprise` at this one.
    """
    if largest >= UNSOUND:
        return SURPRISES
    return before + 1 if largest > SURPRISE else 0
