"""B-dot detumbling: what it commands, and how fast it brakes."""

from __future__ import annotations

from math import exp

import numpy as np
import pytest

from desat.components.blocks.manager_b_dot import ManagerBDot


def manager_with(**parameters: object) -> ManagerBDot:
    block = ManagerBDot()
    for name, value in {"sample_time": 1.0, **parameters}.items():
        setattr(block, name, value)
    block.start()
    return block


def test_it_opposes_the_fields_rate() -> None:
    block = manager_with(gain=2e-2, m_limit=100.0)
    block.b_body = (2e-5, 0.0, 1e-5)
    block.advance(0.0, 1.0)
    assert block.m_cmd_body == (0.0, 0.0, 0.0), "one sample has no rate"
    block.b_body = (2e-5, 3e-7, 1e-5)
    block.advance(1.0, 1.0)
    size2 = np.dot(block.b_body, block.b_body)
    assert block.m_cmd_body == pytest.approx((0.0, -2e-2 * 3e-7 / size2, 0.0))
    block.m_limit = 1e-3
    block.b_body = (2e-5, 3e-6, 1e-5)
    block.advance(2.0, 1.0)
    assert block.m_cmd_body == (0.0, -1e-3, 0.0)


def test_a_sample_that_is_not_valid_gives_no_rate_to_the_next() -> None:
    block = manager_with()
    for t, valid in enumerate((True, False, True, True)):
        block.b_body, block.valid_b = (2e-5, 1e-7 * t, 1e-5), valid
        block.advance(float(t), 1.0)
        assert any(block.m_cmd_body) == (t == 3)


def test_it_brakes_across_the_field_with_gain_over_inertia() -> None:
    """A body that turns across a field which stands still: omega falls as exp(-gain t /
    J)."""
    gain, inertia, omega, dt, size = 2e-3, 0.05, 0.02, 0.1, 3e-5
    block = manager_with(gain=gain, m_limit=1e3, sample_time=dt)
    angle, rate, steps = 0.0, omega, 400
    for k in range(steps):
        b = (size * np.cos(angle), -size * np.sin(angle), 0.0)  # body turns about z
        block.b_body = (float(b[0]), float(b[1]), 0.0)
        block.advance(k * dt, dt)
        torque = float(np.cross(block.m_cmd_body, block.b_body)[2])
        rate += dt * torque / inertia
        angle += dt * rate
    assert rate == pytest.approx(omega * exp(-gain * steps * dt / inertia), rel=0.02)
