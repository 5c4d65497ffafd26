"""Reaction wheels: what they take over a step, friction, limits, failures."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from desat.components.blocks.wheels import Wheels
from desat.components.contract.block import BlockError
from desat.components.physics.rotor import friction, step

torque = st.floats(-0.02, 0.02).map(lambda x: round(x, 6))
momentum = st.floats(-3, 3).map(lambda x: round(x, 6))
J = 0.008


def wheels(**values) -> Wheels:
    block = Wheels()
    for name, value in values.items():
        setattr(block, name, value)
    block.check()
    block.start()
    block.output(0.0)
    return block


def exact(motor, rotor, command, rate0, rate1, dt):
    """(h, T, learnt) and the integral of h, by scipy."""
    j, lag, viscous, coulomb, eps, compensation, _ = motor

    def slope(t, y):
        h, torque, learnt, _ = y
        drag = friction(h / j - rate0 - (rate1 - rate0) * t / dt, viscous, coulomb, eps)
        motor_slope = (command - torque) / lag if lag else 0.0
        return [torque - drag + learnt, motor_slope, compensation * (drag - learnt), h]

    start = [rotor[0], rotor[1] if lag else command, rotor[2], 0.0]
    y = solve_ivp(slope, (0, dt), start, rtol=1e-12, atol=1e-15, method="DOP853").y[:, -1]
    return y[:3], y[3]


@given(torque, torque, momentum, st.sampled_from([0.0, 0.05, 0.3]),
       st.sampled_from([0.1, 1.0, 5.0]))  # fmt: skip
def test_a_frictionless_step_is_exact(command, torque0, h, lag, dt):
    motor = (J, lag, 0.0, 0.0, 1.0, 0.0, 0.0)
    (h1, t1, _), integral = step(motor, (h, torque0, 0.0), command, 0.0, 0.0, dt, 1e9)
    (he, te, _), integral_e = exact(motor, (h, torque0, 0.0), command, 0.0, 0.0, dt)
    assert h1 == pytest.approx(he, abs=1e-11)
    assert t1 == pytest.approx(te, abs=1e-11)
    assert integral == pytest.approx(integral_e, abs=1e-10)


@given(torque, torque, momentum, st.sampled_from([0.0, 0.3]), torque,
       st.sampled_from([0.0, 1.0]))  # fmt: skip
def test_a_step_with_friction(command, torque0, h, lag, rate, compensation):
    motor = (J, lag, 2e-5, 5e-4, 20.0, compensation, 0.0)
    rotor = (h, torque0, 1e-4 if compensation else 0.0)
    (h1, t1, l1), integral = step(motor, rotor, command, rate, 1.1 * rate, 1.0, 1e9)
    (he, te, le), integral_e = exact(motor, rotor, command, rate, 1.1 * rate, 1.0)
    # a compensating loop takes friction as linear over the step
    accuracy = 2e-6 if compensation else 5e-7
    assert h1 == pytest.approx(he, abs=accuracy)
    assert t1 == pytest.approx(te, abs=1e-9)
    assert l1 == pytest.approx(le, abs=1e-5)
    assert integral == pytest.approx(integral_e, abs=accuracy)


def run(block: Wheels, steps: int, dt: float, k0: int = 0):
    """(h, mean, slope) of the first wheel over some steps."""
    rows = []
    for k in range(k0, k0 + steps):
        h0 = block.h_wheel
        block.advance(k * dt, dt)
        block.output((k + 1) * dt)
        rows.append((h0, block.tau_mean_wheel, block.tau_slope_wheel, block.h_wheel))
    return rows


def test_mean_and_slope_are_the_moments_of_the_torque():
    """tau_mean = (h1 - h0) / H; tau_slope = 12 int (s - 1/2) tau ds, by sums of small steps."""
    fine = wheels(motor_lag=0.3, viscous=2e-5, coulomb=5e-4, h_start_wheel=(0.5, -1.5, 0.8, 0.0))
    coarse = wheels(motor_lag=0.3, viscous=2e-5, coulomb=5e-4, h_start_wheel=(0.5, -1.5, 0.8, 0.0))
    for block in (fine, coarse):
        block.tau_cmd_wheel = (0.015, -0.01, 0.02, 0.0)
    n = 1000
    small = np.array([row[1] for row in run(fine, n, 1.0 / n)])
    ((h0, mean, slope, h1),) = run(coarse, 1, 1.0)
    assert mean == tuple(b - a for a, b in zip(h0, h1, strict=True))
    s = (np.arange(n) + 0.5) / n
    assert np.allclose(small.mean(axis=0), mean, atol=1e-8)
    assert np.allclose(12 * ((s - 0.5)[:, None] * small).mean(axis=0), slope, atol=1e-6)


def test_torque_is_limited_and_the_wheel_saturates():
    block = wheels(torque_limit=0.02, speed_limit=100.0)
    block.tau_cmd_wheel = (1.0, -1.0, 0.001, 0.0)
    rows = run(block, 60, 1.0)
    assert rows[0][1][:2] == pytest.approx((0.02, -0.02))
    assert block.h_wheel[:2] == pytest.approx((0.8, -0.8))
    assert block.saturated_wheel == (True, True, False, False)
    assert rows[-1][1][:2] == (0.0, 0.0), "a saturated wheel takes nothing more"
    block.tau_cmd_wheel = (-0.02, 0.0, 0.0, 0.0)
    run(block, 1, 1.0, 60)
    assert block.saturated_wheel[:2] == (False, True)


def test_momentum_leaves_no_gap_when_it_saturates_within_a_step():
    block = wheels(torque_limit=0.02, speed_limit=100.0, h_start_wheel=(0.79, 0, 0, 0))
    block.tau_cmd_wheel = (0.02, 0.0, 0.0, 0.0)
    ((h0, mean, slope, h1),) = run(block, 1, 1.0)
    assert (h0[0], h1[0]) == (0.79, pytest.approx(0.8))
    assert mean[0] == pytest.approx(0.01)
    # full torque in the first half, none in the second: 12 int (s - 1/2) tau = -12 * 0.02 / 8
    assert slope[0] == pytest.approx(-0.03)


def test_friction_brings_a_wheel_to_rest():
    block = wheels(viscous=2e-5, coulomb=5e-4, stiction=6e-4, h_start_wheel=(0.4, 0, 0, 0))
    run(block, 2000, 1.0)
    assert abs(block.speed_wheel[0]) < 2.0
    block.tau_cmd_wheel = (5e-4, 0.0, 0.0, 0.0)  # below stiction
    run(block, 100, 1.0, 2000)
    assert block.speed_wheel[0] == 0.0, "a standing rotor holds against a small torque"
    block.tau_cmd_wheel = (2e-3, 0.0, 0.0, 0.0)
    run(block, 10, 1.0, 2100)
    assert block.speed_wheel[0] > 1.0


def test_a_stuck_rotor_turns_with_the_body():
    block = wheels(stiction=1e-3)
    for k in range(5):
        block.omega_bi_body = (0.01 * k, 0.0, 0.0)
        run(block, 1, 1.0, k)
    assert block.h_wheel[0] == pytest.approx(J * 0.05)
    assert block.speed_wheel[0] == pytest.approx(0.0, abs=1e-15)


def test_the_speed_loop_compensates_friction():
    plain = wheels(viscous=2e-5, coulomb=5e-4, h_start_wheel=(0.4, 0, 0, 0))
    looped = wheels(viscous=2e-5, coulomb=5e-4, h_start_wheel=(0.4, 0, 0, 0), compensation=2.0)
    run(plain, 100, 1.0)
    run(looped, 100, 1.0)
    assert plain.h_wheel[0] < 0.3
    assert looped.h_wheel[0] == pytest.approx(0.4, abs=1e-3)


def test_speed_mode_reaches_the_speed():
    block = wheels(command_mode=1, speed_gain=0.5, viscous=2e-5, compensation=1.0)
    block.speed_cmd_wheel = (30.0, -60.0, 0.0, 0.0)
    run(block, 200, 1.0)
    assert block.speed_wheel[:3] == pytest.approx((30.0, -60.0, 0.0), abs=0.05)


def test_a_failed_wheel_coasts():
    block = wheels(failed=2, failed_from=3.0, viscous=2e-5, h_start_wheel=(0.4, 0.4, 0.4, 0))
    block.tau_cmd_wheel = (0.01, 0.01, 0.01, 0.0)
    rows = run(block, 6, 1.0)
    assert rows[2][1][1] == pytest.approx(rows[2][1][0])
    assert block.failed_wheel == (False, True, False, False)
    assert rows[-1][1][1] == pytest.approx(-2e-5 * rows[-1][0][1] / J, rel=1e-2), "only friction"


def test_rates_are_extrapolated():
    """With a linearly growing body rate the friction is right although the rate is held."""
    block = wheels(viscous=2e-3, h_start_wheel=(0.0, 0, 0, 0))
    for k in range(20):
        block.omega_bi_body = (0.01 * k, 0.0, 0.0)
        run(block, 1, 1.0, k)
    solution = solve_ivp(
        lambda t, h: -2e-3 * (h / J - 0.01 * np.maximum(t, 0)),
        (0, 20),
        [0.0],
        rtol=1e-10,
        atol=1e-14,
    )
    assert block.h_wheel[0] == pytest.approx(solution.y[0, -1], rel=0.02)


def test_jitter_is_across_the_axes_and_grows_with_speed():
    block = wheels(unbalance=1e-8, inertia_wheel=(J, 0, 0, 0), h_start_wheel=(0.8, 0, 0, 0))
    jitter = []
    for k in range(3000):
        block.advance(float(k), 1.0)
        jitter.append(block.tau_jitter_body)
    values = np.array(jitter)
    assert not values[:, 0].any()
    assert values[:, 1:].std(axis=0) == pytest.approx([1e-8 * 100**2] * 2, rel=0.05)
    assert block.tau_mean_wheel == (0.0, 0.0, 0.0, 0.0), "jitter is no wheel torque"


def test_power():
    block = wheels(idle_power=0.5, motor_constant=0.02, inertia_wheel=(J, 0, 0, 0),
                   h_start_wheel=(0.8, 0, 0, 0))  # fmt: skip
    assert block.power == 0.5
    block.tau_cmd_wheel = (0.01, 0.0, 0.0, 0.0)
    run(block, 1, 1.0)
    assert block.power == pytest.approx(0.5 + 0.01 * 0.81 / J + 0.25)
    block.tau_cmd_wheel = (-0.01, 0.0, 0.0, 0.0)
    run(block, 1, 1.0, 1)
    assert block.power == pytest.approx(0.5 + 0.25), "braking gives nothing back"


def test_axes_must_be_unit_vectors():
    with pytest.raises(BlockError, match=r"column 2 = .* is not a unit vector"):
        wheels(axes_wheel=(1.0, 0, 0, 0, 0, 2.0, 0, 0, 0, 0, 1.0, 0))
    assert math.isclose(wheels().h_wheel[0], 0.0)
