"""Costates of the laws that are designed."""

from __future__ import annotations

import numpy as np
import pytest

from desat.components.laws import (
    magnetic,
)
from desat.components.laws import magnetic_offline as offline


@pytest.mark.parametrize(
    ("horizon", "intervals"), [(60.0, 1), (440.0, 1), (460.0, 2), (900.0, 3)]
)
def test_a_costate_asks_for_the_field_once_a_point(horizon, intervals):
    """A short horizon has one interval of the quadrature too."""
    requests = []

    def field(t):
        requests.append(t)
        return (0.0, 0.0, 3e-5)

    offline.costate(
        field,
        (0.0, 1e-3, 0.0),
        (1.0, 1.0, 1.0),
        (0.0,) * 3,
        (1.0, 0.5, 0.0),
        (0.0,) * 3,
        horizon,
    )
    assert len(requests) == intervals * offline.POINTS
    assert (
        0.0 < min(requests) < 0.01 * horizon < 0.99 * horizon < max(requests) < horizon
    )


def test_a_costate_turns_as_the_momentum_does():
    """Of momentum that nothing acts on, h' = -omega x h, the product with the costate
    is constant: p' = -omega x p."""
    omega, p0 = (1e-3, -2e-3, 0.5e-3), (2.0, -1.0, 4.0)
    later = magnetic.mec_costate(p0, omega, 1e-2)
    change = (np.array(later) - p0) / 1e-2
    assert change == pytest.approx(-np.cross(omega, p0), rel=1e-4)
