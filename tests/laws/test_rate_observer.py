"""The model of the rate observer."""

from __future__ import annotations

import numpy as np
import pytest

from desat.components.laws import (
    rate_observer,
)


def test_the_observer_s_model_moves_momentum_between_wheel_and_body():
    """Without a field, body and wheel together keep the size of their momentum while
    the wheel's motor works."""
    inertia, omega, tau = np.diag([2.0, 3.0, 4.0]), (0.3, -0.2, 0.4), (0.0, 0.5, 0.0)
    wheel = np.array([0.0, 0.4, 0.0])
    inverse = tuple(np.linalg.inv(inertia).ravel())
    zero = (0.0, 0.0, 0.0)
    later, _ = rate_observer.predict(
        omega,
        (1e-5, 0.0, 0.0),
        zero,
        tau,
        tuple(wheel),
        tuple(inertia.ravel()),
        inverse,
        0.4,
    )
    before = np.linalg.norm(inertia @ omega + wheel)
    after = np.linalg.norm(inertia @ later + wheel - 0.4 * np.array(tau))
    assert after == pytest.approx(before, rel=2e-4)
