"""Predict the covariance of a Kalman filter, and correct it by one measured number.

The filter has a state x (n) and its covariance P (n x n, row-major). Of a measurement
y = c'x + v, with v of variance R, the gain is k = P c / (c'P c + R), and

    x -> x + k (y - c'x),     P -> P - k c'P.

Between measurements P -> F P F'. Measurements whose errors are independent may be used
one after the other. The unit of x and y is that of the filter.
"""

from __future__ import annotations


def correct(
    x: list[float],
    p: list[float],
    product: list[float],
    innovation: float,
    variance: float,
) -> None:
    """Correct x and P in place.

    Parameters
    ----------
    x, p : list of float
        State (n) and covariance (n n, row-major).
    product : list of float
        P c (n).
    innovation : float
        y - c'x.
    variance : float
        Variance of the innovation, c'P c + R.
    """
    states = len(x)
    share = innovation / variance
    for i in range(states):
        x[i] += product[i] * share
        for j in range(states):
            p[states * i + j] -= product[i] * product[j] / variance


def correct_first(
    x: list[float],
    p: list[float],
    product: list[float],
    innovation: float,
    variance: float,
    estimated: int,
) -> None:
    """Correct the first states in place, and only consider the others (Schmidt).

    The others keep their values and their own covariance; the covariance between them
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
    estimated : int
        How many states are corrected; n: all, as by `correct`.
    """
    states = len(x)
    share = innovation / variance
    for i in range(estimated):
        x[i] += product[i] * share
        for j in range(i, states):
            p[states * i + j] -= product[i] * product[j] / variance
            p[states * j + i] = p[states * i + j]


def predict(p: list[float], effects: list[float], moving: int, states: int) -> None:
    """Replace P by F P F' in place, where only the first states move.

    Parameters
    ----------
    p : list of float
        Covariance (n n, row-major), symmetric, which it stays to the bit.
    effects : list of float
        The first rows of F (moving n, row-major); the others are those of the identity.
    moving : int
        How many states move, at most 6.
    states : int
        n.
    """
    column = [0.0] * 6
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
