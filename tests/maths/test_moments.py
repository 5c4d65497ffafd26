"""Moments of a lag and of part of a step, by their integrals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from desat.components.maths import moments


@pytest.mark.parametrize("ratio", [1e-9, 1e-6, 1e-3, 0.1, 0.999999, 1.0, 1.5, 4.0])
def test_moments_of_a_lag_keep_all_digits(ratio):
    """Each against its series in exact fractions: a closed form too far down cancels."""
    from fractions import Fraction

    x = Fraction(ratio)
    terms = [Fraction(1)]
    for n in range(1, 60):
        terms.append(terms[-1] * -x / n)
    mean = sum(t / (n + 1) for n, t in enumerate(terms))
    slope = 12 * sum(
        t * (Fraction(1, n + 2) - Fraction(1, 2 * (n + 1))) for n, t in enumerate(terms)
    )
    lag_moments = moments.lag(ratio)
    assert lag_moments[0] == pytest.approx(float(mean), rel=2e-15)
    assert lag_moments[1] == pytest.approx(float(slope), rel=5e-14)
    assert lag_moments[2] == pytest.approx(math.exp(-ratio), rel=1e-15)


@pytest.mark.parametrize("ratio", [0.3, 2.5])
def test_a_first_order_lag_by_its_integrals(ratio):
    s = (np.arange(20000) + 0.5) / 20000
    x = -1.5 + (2.0 + 1.5) * np.exp(-ratio * s)
    mean, slope, end, square = moments.first_order(2.0, -1.5, ratio)
    assert mean == pytest.approx(x.mean(), rel=1e-6)
    assert slope == pytest.approx(12.0 * (x * (s - 0.5)).mean(), rel=1e-6)
    assert end == pytest.approx(-1.5 + 3.5 * math.exp(-ratio))
    assert square == pytest.approx((x * x).mean(), rel=1e-6)


def test_a_part_of_a_step_by_its_integrals():
    s = (np.arange(20000) + 0.5) / 20000
    inside = (s > 0.2) & (s < 0.7)
    x = np.where(inside, 3.0 + 0.8 * ((s - 0.2) / 0.5 - 0.5), 0.0)
    mean, slope = moments.part(0.2, 0.7, 3.0, 0.8)
    assert mean == pytest.approx(x.mean(), rel=1e-4)
    assert slope == pytest.approx(12.0 * (x * (s - 0.5)).mean(), rel=1e-3)


@given(st.floats(0, 1), st.floats(0, 1))
def test_moments_of_a_pulse(a, b):
    begin, end = min(a, b), max(a, b)
    mean, slope = moments.pulse(begin, end)
    assert mean == pytest.approx(end - begin, abs=1e-15)
    first = (end**2 - begin**2) / 2 - mean / 2
    assert slope == pytest.approx(12 * first, abs=1e-12)


@given(st.floats(1e-9, 30))
def test_moments_of_a_lag(ratio):
    mean, slope, end = moments.lag(ratio)
    assert mean == pytest.approx(
        quad(lambda s: math.exp(-ratio * s), 0, 1, epsabs=1e-14)[0], 1e-11
    )
    first = quad(lambda s: (s - 0.5) * math.exp(-ratio * s), 0, 1, epsabs=1e-14)[0]
    assert slope == pytest.approx(12 * first, rel=1e-9, abs=1e-12)
    assert end == pytest.approx(math.exp(-ratio), rel=1e-14)
