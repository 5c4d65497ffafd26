"""Correct a Kalman filter by one measured number.

The filter has a state x (n) and its covariance P (n x n, row-major). Of a measurement
y = c'x + v, with v of variance R, the gain is k = P c / (c'P c + R), and

    x -> x + k (y - c'x),     P -> P - k c'P.

Measurements whose errors are independent may be used one after the other. The unit of
x and y is that of the filter.
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
