"""A rotor that meets its limit or breaks loose within a step."""

from __future__ import annotations

import pytest

from desat.components.physics import (
    rotor,
)


def test_a_rotor_meets_its_limit_while_the_body_speeds_up():
    """A constant torque until h / J less the body's rate is at the limit; then it is
    there: by hand for both parts."""
    torque, inertia, fastest, change = 0.02, 2e-3, 6.0, 2.0
    motor = (inertia, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.02)
    (h, *_), integral = rotor.step(
        motor, (0.0,) * 4, torque, 0.1, 0.1 + change, 1.0, fastest
    )
    limit_time = (fastest + 0.1) / (torque / inertia - change)
    at_limit = (fastest + 0.1) * (1.0 - limit_time) + 0.5 * change * (
        1.0 - limit_time**2
    )
    assert h == pytest.approx(inertia * (fastest + 0.1 + change), rel=1e-12)
    assert integral == pytest.approx(
        0.5 * torque * limit_time**2 + inertia * at_limit, rel=1e-9
    )


def test_a_rotor_that_breaks_loose_within_a_step_has_a_way():
    """Stiction 1 mN m: a motor on its way to 2 mN m breaks it loose, one to 0.5 mN m
    does not."""
    motor = (1e-3, 0.5, 0.0, 1e-4, 1.0, 0.0, 1e-3, 0.1)
    for command, way in ((2e-3, 1.0), (-2e-3, -1.0), (5e-4, 0.0)):
        after, standing_time, _ = rotor._standing(
            motor, (0.0, 0.0, 0.0, 0.0), command, (0.0, 0.0), 1.0
        )
        assert (after[3], standing_time < 1.0) == (way, way != 0.0)
