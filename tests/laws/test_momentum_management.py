"""Momentum management by an open loop: the condition, and places in its tables."""

from __future__ import annotations

import numpy as np
import pytest

from desat.components.laws import (
    momentum_management,
)


def test_the_condition_is_that_of_the_eigenvalues():
    rng = np.random.default_rng(3)
    for root in rng.normal(size=(50, 3, 3)):
        m = root @ root.T
        values = np.linalg.eigvalsh(m)
        condition_number = momentum_management.condition(tuple(m.ravel()))
        assert condition_number == pytest.approx(values[-1] / values[0], rel=1e-6)


@pytest.mark.parametrize(
    ("t", "row", "share"), [(0.0, 0, 0.0), (25.0, 2, 0.5), (40.0, 3, 1.0)]
)
def test_a_place_in_a_table(t, row, share):
    assert momentum_management.place(5, 10.0, t) == pytest.approx((row, share))
