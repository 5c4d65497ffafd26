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
from tests.contract.test_block import begin, fresh

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
    j, lag, viscous, coulomb, eps, compensation, _, limit = motor

    def derivative(t, y):
        h, torque, learnt, _ = y
        drag = friction(h / j - rate0 - (rate1 - rate0) * t / dt, viscous, coulomb, eps)
        following = (command - torque) / lag if lag else 0.0
        drive = min(max(torque + learnt, -limit), limit)
        return [drive - drag, following, compensation * (drag - learnt), h]

    start = [rotor[0], rotor[1] if lag else command, rotor[2], 0.0]
    y = solve_ivp(
        derivative, (0, dt), start, rtol=1e-12, atol=1e-15, method="DOP853"
    ).y[:, -1]
    return y[:3], y[3]


@given(
    torque,
    torque,
    momentum,
    st.sampled_from([0.0, 0.05, 0.3]),
    st.sampled_from([0.1, 1.0, 5.0]),
)
def test_a_frictionless_step_is_exact(command, torque0, h, lag, dt):
    motor = (J, lag, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0)
    rotor = (h, torque0, 0.0, 0.0)
    (h1, t1, _, _), integral = step(motor, rotor, command, 0.0, 0.0, dt, 1e9)
    (he, te, _), integral_e = exact(motor, rotor, command, 0.0, 0.0, dt)
    assert h1 == pytest.approx(he, abs=1e-11)
    assert t1 == pytest.approx(te, abs=1e-11)
    assert integral == pytest.approx(integral_e, abs=1e-10)


@given(
    torque,
    torque,
    momentum,
    st.sampled_from([0.0, 0.3]),
    torque,
    st.sampled_from([0.0, 1.0]),
)
def test_a_step_with_friction(command, torque0, h, lag, rate, compensation):
    motor = (J, lag, 2e-5, 5e-4, 20.0, compensation, 0.0, 1.0)
    rotor = (h, torque0, 1e-4 if compensation else 0.0, 0.0)
    (h1, t1, l1, _), integral = step(motor, rotor, command, rate, 1.1 * rate, 1.0, 1e9)
    (he, te, le), integral_e = exact(motor, rotor, command, rate, 1.1 * rate, 1.0)
    # a compensating loop takes friction as linear in the speed
    accuracy = 2e-6 if compensation else 5e-7
    assert h1 == pytest.approx(he, abs=accuracy)
    assert t1 == pytest.approx(te, abs=1e-9)
    assert l1 == pytest.approx(le, abs=1e-5)
    assert integral == pytest.approx(integral_e, abs=accuracy)


@pytest.mark.parametrize("difference", [0.0, 5e-5, -5e-5, 2e-4, -2e-4])
def test_a_loop_as_fast_as_its_motor_learns_the_friction_exactly(difference):
    """Viscous friction is linear; at equal rates the solution has a form of its own."""
    lag, viscous = 0.25, 2e-3
    compensation = 1.0 / lag - viscous / J + difference
    motor = (J, lag, viscous, 0.0, 1.0, compensation, 0.0, 1.0)
    rotor = (0.3, -0.01, 0.02, 0.0)
    (h1, t1, l1, _), integral = step(motor, rotor, 0.02, 0.1, 0.3, 1.5, 1e9)
    (he, te, le), integral_e = exact(motor, rotor, 0.02, 0.1, 0.3, 1.5)
    assert (h1, t1, l1) == pytest.approx((he, te, le), abs=1e-11)
    assert integral == pytest.approx(integral_e, abs=1e-11)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_rotor_above_its_limit_brakes_to_it_with_the_torque_limit(way):
    """From 8 rad/s to 6 at 0.02 N m / J, helped by the body; then it stays at 6."""
    j, fastest, change, dt = 2e-3, 6.0, 2.0, 1.0
    motor = (j, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.02)
    rotor = (way * j * 8.0, 0.0, 0.0, 0.0)
    (h, *_), integral = step(motor, rotor, way * 0.02, 0.0, way * change, dt, fastest)
    braking_time = 2.0 / (0.02 / j + change)
    braking_integral = j * 8.0 * braking_time - 0.5 * 0.02 * braking_time**2
    limit_integral = j * (
        fastest * (dt - braking_time) + 0.5 * change * (dt**2 - braking_time**2)
    )
    assert h == pytest.approx(way * j * (fastest + change), rel=1e-12)
    assert integral == pytest.approx(
        way * (braking_integral + limit_integral), rel=1e-12
    )


def test_a_motor_that_ends_its_command_may_reach_the_limit():
    """From 5 rad/s to 6 by what is left of 0.05 N m, which decays with 1 s."""
    j, fastest, torque = 2e-3, 6.0, 0.05
    motor = (j, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.1)
    rotor = (j * 5.0, torque, 0.0, 0.0)
    (h, *_), integral = step(motor, rotor, 0.0, 0.0, 0.0, 1.0, fastest)
    limit_time = -math.log(1.0 - j / torque)
    before = j * 5.0 * limit_time + torque * (limit_time - j / torque)
    assert h == pytest.approx(j * fastest, rel=1e-12)
    assert integral == pytest.approx(
        before + j * fastest * (1.0 - limit_time), rel=1e-9
    )


def test_a_limit_is_met_by_a_motor_that_turns_back_within_the_step():
    """Its speed would pass the limit by 0.67 rad/s, and is far below it at the end."""
    motor = (2e-3, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.1)
    fine = (2e-3 * 50.0, 0.05, 0.0, 0.0)
    once, _ = step(motor, fine, -0.05, 0.0, 0.0, 4.0, 57.0)
    free, _ = step(motor, fine, -0.05, 0.0, 0.0, 4.0, 1e9)
    for _ in range(800):
        fine, _ = step(motor, fine, -0.05, 0.0, 0.0, 0.005, 57.0)
    assert once[0] == pytest.approx(fine[0], abs=1e-9)
    peak = 0.05 * (1.0 - math.log(2.0)) - 2e-3 * 7.0
    assert free[0] - once[0] == pytest.approx(peak, rel=1e-6)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_standing_rotor_turns_with_the_body_until_its_motor_breaks_it_loose(way):
    """T = 2e-3 (1 - exp(-t / 0.5)) N m less J 0.5 rad/s2 is the stiction of 5e-4 N m."""
    j, lag, coulomb, change = 1e-3, 0.5, 2e-4, 0.5
    motor = (j, lag, 0.0, coulomb, 1.0, 0.0, 5e-4, 0.1)
    rotor = (way * j * 0.1, 0.0, 0.0, 0.0)
    rates = (way * 0.1, way * (0.1 + change))
    (h, torque, _, moves), integral = step(motor, rotor, way * 2e-3, *rates, 1.0, 1e9)
    loose = -lag * math.log(1.0 - (5e-4 + j * change) / 2e-3)
    moving, stood = 1.0 - loose, j * (0.1 + change * loose)
    before, after = math.exp(-loose / lag), math.exp(-1.0 / lag)
    motor_impulse = 2e-3 * (moving - lag * (before - after)) - coulomb * moving
    of_moving = lag * (lag * (before - after) - moving * before)
    of_moving = 2e-3 * (0.5 * moving**2 + of_moving)
    of_moving += stood * moving - 0.5 * coulomb * moving**2
    of_standing = j * (0.1 * loose + 0.5 * change * loose**2)
    momentum = stood + motor_impulse
    assert integral == pytest.approx(way * (of_standing + of_moving), rel=1e-9)
    assert (h, moves) == (pytest.approx(way * momentum, rel=1e-9), way)
    assert torque == pytest.approx(way * 2e-3 * (1.0 - math.exp(-1.0 / lag)), rel=1e-12)


def test_friction_is_viscous_and_turns_its_sign_smoothly():
    assert friction(3.0, 2e-5, 5e-4, 2.0) == pytest.approx(
        6e-5 + 5e-4 * math.tanh(1.5), rel=1e-12
    )


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
    """tau_mean = (h1 - h0) / H; tau_slope = 12 int (s - 1/2) tau ds, by sums of small
    steps."""
    fine = wheels(
        motor_lag=0.3, viscous=2e-5, coulomb=5e-4, h_start_wheel=(0.5, -1.5, 0.8, 0.0)
    )
    coarse = wheels(
        motor_lag=0.3, viscous=2e-5, coulomb=5e-4, h_start_wheel=(0.5, -1.5, 0.8, 0.0)
    )
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
    # full torque in the first half, none in the second: 12 int (s - 1/2) tau = -12 *
    # 0.02 / 8
    assert slope[0] == pytest.approx(-0.03)


@pytest.mark.parametrize("h_start", [-0.004, 0.004])
@pytest.mark.parametrize("lag", [0.0, 0.3])
def test_a_wheel_that_has_turned_round_saturates_as_any_other(h_start, lag):
    """It kept the way that it turned at the start, and was put at rest at its limit, at
    once."""
    block = wheels(
        torque_limit=0.02,
        speed_limit=100.0,
        h_start_wheel=(h_start, 0, 0, 0),
        motor_lag=lag,
        viscous=1e-6,
    )
    block.tau_cmd_wheel = (0.02, 0.0, 0.0, 0.0)
    momenta = [h1[0] for _, _, _, h1 in run(block, 60, 1.0)]
    assert np.abs(np.diff([h_start, *momenta])).max() <= 0.02, (
        "no more than the motor gives"
    )
    assert momenta[-1] == pytest.approx(0.8)
    assert block.saturated_wheel[0]


def test_friction_brings_a_wheel_to_rest():
    block = wheels(
        viscous=2e-5, coulomb=5e-4, stiction=6e-4, h_start_wheel=(0.4, 0, 0, 0)
    )
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
    compensating = wheels(
        viscous=2e-5, coulomb=5e-4, h_start_wheel=(0.4, 0, 0, 0), compensation=2.0
    )
    run(plain, 100, 1.0)
    run(compensating, 100, 1.0)
    assert plain.h_wheel[0] < 0.3
    assert compensating.h_wheel[0] == pytest.approx(0.4, abs=1e-3)


def test_speed_mode_reaches_the_speed():
    block = wheels(command_mode=1, speed_gain=0.5, viscous=2e-5, compensation=1.0)
    block.speed_cmd_wheel = (30.0, -60.0, 0.0, 0.0)
    run(block, 200, 1.0)
    assert block.speed_wheel[:3] == pytest.approx((30.0, -60.0, 0.0), abs=0.05)


def test_a_failed_wheel_coasts():
    block = wheels(
        failed=2, failed_from=3.0, viscous=2e-5, h_start_wheel=(0.4, 0.4, 0.4, 0)
    )
    block.tau_cmd_wheel = (0.01, 0.01, 0.01, 0.0)
    rows = run(block, 6, 1.0)
    assert rows[2][1][1] == pytest.approx(rows[2][1][0])
    assert block.failed_wheel == (False, True, False, False)
    assert rows[-1][1][1] == pytest.approx(-2e-5 * rows[-1][0][1] / J, rel=1e-2), (
        "only friction"
    )


def test_rates_are_extrapolated():
    """With a linearly growing body rate the friction is right although the rate is
    held."""
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


def test_power():
    block = wheels(
        idle_power=0.5,
        motor_constant=0.02,
        inertia_wheel=(J, 0, 0, 0),
        h_start_wheel=(0.8, 0, 0, 0),
    )
    assert block.power == 0.5
    block.tau_cmd_wheel = (0.01, 0.0, 0.0, 0.0)
    run(block, 1, 1.0)
    assert block.power == pytest.approx(0.5 + 0.01 * 0.81 / J + 0.25)
    block.tau_cmd_wheel = (-0.01, 0.0, 0.0, 0.0)
    run(block, 1, 1.0, 1)
    assert block.power == pytest.approx(0.5 + 0.25), "braking gives nothing back"


# --- what does not depend on the step -------------------------------------------------

STEPS = (0.05, 0.25, 1.0, 2.0, 10.0)
PHASES = 10.0  # s, of a command


def momenta(dt: float, commands, **values) -> np.ndarray:
    """The wheels' momenta at the end of each command of 10 s."""
    block, n, rows = wheels(**values), round(PHASES / dt), []
    for k, command in enumerate(commands):
        block.tau_cmd_wheel = command
        run(block, n, dt, k * n)
        rows.append(block.h_wheel)
    return np.array(rows)


def test_a_slow_rotor_is_not_stopped_within_a_step():
    """1.9 rad/s at a step of 10 ms: once -1.5 N m, where Coulomb friction is 5e-4."""
    block = wheels(coulomb=5e-4, stiction=6e-4, h_start_wheel=(1.9 * J, 0, 0, 0))
    ((_, mean, _, _),) = run(block, 1, 0.01)
    assert mean[0] == pytest.approx(-5e-4, rel=1e-9)
    run(block, 3100, 0.01, 1)
    assert block.speed_wheel[0] == 0.0, "at rest after J 1.9 / 5e-4 = 30.4 s"


@pytest.mark.parametrize("compensation", [0.0, 1.0])
@pytest.mark.parametrize("dt", STEPS)
def test_stopping_standing_and_breaking_loose_do_not_depend_on_the_step(
    dt, compensation
):
    commands = [
        (4e-4, 0.0, 5e-4, 0.0),
        (9e-4, -2e-3, 0.0, 0.0),
        (-3e-4, 1e-3, 0.0, 0.0),
        (-7e-4, -6.1e-4, 0.0, 0.0),
    ]
    values = {
        "viscous": 2e-5,
        "coulomb": 5e-4,
        "stiction": 6e-4,
        "motor_lag": 0.3,
        "compensation": compensation,
        "h_start_wheel": (1.9 * J, 0.0, -3.0 * J, 0.0),
    }
    rows, fine = momenta(dt, commands, **values), momenta(0.01, commands, **values)
    assert rows == pytest.approx(fine, abs=1e-8)
    assert rows[0, 1] == 0.0
    assert compensation or rows[3, 2] == 0.0, (
        "friction that is not compensated stops it"
    )
    assert rows[1, 1] < -0.01, "2e-3 N m break it loose"


@pytest.mark.parametrize("dt", [0.25, 1.0, 10.0])
def test_a_rotor_that_turns_back_within_a_step_has_stood(dt):
    """Friction stops it at once, its motor breaks it loose the same way it was going."""
    values = {
        "coulomb": 3e-3,
        "stiction": 6e-3,
        "motor_lag": 0.3,
        "h_start_wheel": (-1.5e-3 * J, 0.0, 0.0, 0.0),
    }
    ((first,), (last,)) = (
        momenta(x, [(-0.02, 0.0, 0.0, 0.0)], **values) for x in (dt, 0.01)
    )
    assert first == pytest.approx(last, abs=1e-12)


def test_a_standing_rotor_is_broken_loose_by_the_bodys_motion():
    """J (g.omega)' = 0.008 * 0.1 = 8e-4 N m, more than the stiction."""
    for stiction, speed in ((1e-3, 0.0), (6e-4, -0.1 - 3 * 0.05)):
        block = wheels(stiction=stiction, coulomb=4e-4)
        for k in range(5):
            block.omega_bi_body = (0.1 * k, 0.0, 0.0)
            run(block, 1, 1.0, k)
        # in the first step nothing is known of the motion; then 8e-4 - 4e-4 N m are
        # left
        assert block.speed_wheel[0] == pytest.approx(speed, abs=1e-12)


def test_stiction_below_friction_is_refused():
    with pytest.raises(
        BlockError, match=r"stiction = 0.0001 N m is below coulomb = 0.0005 N m"
    ):
        wheels(stiction=1e-4, coulomb=5e-4)


@pytest.mark.parametrize("dt", [0.01, 0.25, 1.0, 4.0, 5.0, 10.0])
def test_speed_mode_does_not_depend_on_the_step(dt):
    """Once a limit cycle at 4 s and the wrong sign at 5 s."""
    values = {"command_mode": 1, "viscous": 2e-5, "motor_lag": 0.05}
    block, fine = wheels(**values), wheels(**values)
    for each in (block, fine):
        each.speed_cmd_wheel = (3.0, -2.0, 1.0, 0.0)
    for k in range(3):
        run(block, round(20 / dt), dt, round(20 / dt) * k)
        run(fine, 200, 0.1, 200 * k)
        assert block.h_wheel == pytest.approx(fine.h_wheel, abs=1e-11)
    loop_gain = 1.0 / (
        1.0 + 2e-5 / (0.5 * J)
    )  # what a proportional loop reaches against friction
    momenta = tuple(J * loop_gain * x for x in (3.0, -2.0, 1.0, 0.0))
    assert block.h_wheel == pytest.approx(momenta, abs=1e-8)


def test_a_speed_loop_faster_than_its_samples_is_refused():
    with pytest.raises(
        BlockError, match=r"speed_gain = 20.0 1/s is above 1 / speed_sample_time"
    ):
        wheels(command_mode=1, speed_gain=20.0)


@given(st.floats(0.0, 6.0), st.sampled_from([0.25, 0.5, 1.0, 2.0, 6.0]))
def test_a_wheel_fails_inside_a_step(at, dt):
    """Against the closed form: the motor's lag until it fails, then the last momentum."""
    block = wheels(
        failed=2, failed_from=at, motor_lag=0.3, h_start_wheel=(0.4, 0.4, 0.4, 0)
    )
    block.tau_cmd_wheel = (0.01, 0.01, 0.01, 0.0)
    impulse = 0.0
    for _, mean, _, _ in run(block, round(6.0 / dt), dt):
        impulse += dt * mean[1]
    assert impulse == pytest.approx(
        0.01 * (at + 0.3 * math.expm1(-at / 0.3)), abs=1e-8 * dt
    )
    assert block.failed_wheel == (False, True, False, False)


@pytest.mark.parametrize(
    "friction",
    [{}, {"viscous": 2e-5}, {"viscous": 2e-5, "coulomb": 5e-4, "compensation": 1.0}],
)
@pytest.mark.parametrize("dt", STEPS)
def test_the_limit_is_found_inside_a_step(dt, friction):
    values = {
        "speed_limit": 100.0,
        "motor_lag": 0.3,
        "h_start_wheel": (0.75, -0.78, 0.0, 0.0),
    }
    commands = [
        (0.015, -0.02, 0.0, 0.0),
        (-0.01, 0.02, 0.0, 0.0),
        (0.02, -0.02, 0.0, 0.0),
    ]
    rows = momenta(dt, commands, **values, **friction)
    fine = momenta(0.01, commands, **values, **friction)
    # a compensating loop takes friction as linear in the speed
    assert rows == pytest.approx(fine, abs=1e-6 if "compensation" in friction else 1e-7)
    assert rows[0] == pytest.approx((0.8, -0.8, 0.0, 0.0), abs=1e-12)


def test_the_limit_is_of_speed_while_the_body_turns():
    block = wheels(speed_limit=100.0, h_start_wheel=(0.8, 0.799, 0.0, 0.0))
    block.tau_cmd_wheel = (0.02, 0.001, 0.0, 0.0)
    for k in range(300):
        omega = 0.3 * math.sin(0.02 * k)
        block.omega_bi_body = (omega, omega, 0.0)
        run(block, 1, 1.0, k)
        # what the extrapolated rate misses in a step: 0.3 * 0.02^2 rad/s
        assert max(block.speed_wheel) <= 100.0 + 2e-4
    assert block.h_wheel[0] == pytest.approx(
        J * (100.0 + 0.3 * math.sin(6.0)), abs=2e-6
    )


def test_a_start_beyond_the_limit_is_refused():
    with pytest.raises(
        BlockError, match=r"h_start_wheel\[2\] = -0.81 N m s: a speed of -101.25"
    ):
        wheels(speed_limit=100.0, h_start_wheel=(0.8, -0.81, 0.0, 0.0))


@given(
    torque,
    st.floats(0.0, 0.02),
    st.floats(-600.0, 600.0),
    st.sampled_from([0.1, 1.0, 10.0]),
)
def test_the_drive_stays_within_the_torque_limit(command, learnt, speed, dt):
    """Motor and compensated friction together, against scipy with the same cut."""
    motor = (J, 0.1, 2e-5, 5e-4, 2.0, 1.0, 0.0, 0.02)
    rotor = (J * speed, -command, learnt, 0.0)
    (h1, t1, _, _), integral = step(motor, rotor, command, 0.0, 0.0, dt, 1e9)
    (he, te, _), integral_e = exact(motor, rotor, command, 0.0, 0.0, dt)
    drags = 2e-5 * max(abs(speed), abs(h1 / J), abs(speed) + 0.02 * dt / J) + 5e-4
    assert abs(h1 - J * speed) <= (0.02 + drags) * dt * (1 + 1e-9)
    assert h1 == pytest.approx(he, abs=3e-5)
    assert t1 == pytest.approx(te, abs=1e-9)
    assert integral == pytest.approx(integral_e, abs=3e-5 * dt)


def test_a_compensating_wheel_gives_no_more_than_its_torque():
    """Once torque_limit and the friction."""
    block = wheels(
        viscous=2e-5, coulomb=5e-4, compensation=1.0, h_start_wheel=(1.0, 0, 0, 0)
    )
    run(block, 20, 1.0)
    block.tau_cmd_wheel = (0.02, 0.0, 0.0, 0.0)
    for row in run(block, 100, 1.0, 20)[1:]:
        speed = 0.5 * (row[0][0] + row[3][0]) / J
        assert row[1][0] == pytest.approx(
            0.02 - friction(speed, 2e-5, 5e-4, 2.0), abs=1e-6
        )


def jitter(dt: float, **values) -> np.ndarray:
    """The impulse of the jitter (N m s, body) every 2 s."""
    block, n, rows, total = wheels(**values), round(2.0 / dt), [], np.zeros(3)
    block.tau_cmd_wheel = (0.003, 0.002, 0.01, 0.0)
    for k in range(20 * n):
        run(block, 1, dt, k)
        total = total + dt * np.array(block.tau_jitter_body)
        if (k + 1) % n == 0:
            rows.append(total)
    return np.array(rows)


@pytest.mark.parametrize("dt", [0.1, 0.5, 1.0, 2.0])
def test_jitter_does_not_depend_on_the_step_and_leaves_no_momentum(dt):
    values = {"unbalance": 1e-6, "h_start_wheel": (0.5, 0.3, -0.2, 0.0)}
    rows = jitter(dt, **values)
    assert rows == pytest.approx(jitter(0.01, **values), abs=1e-12)
    fastest = (0.5 + 0.3 + 0.2 + 40 * 0.015) / J
    assert 1e-5 < np.abs(rows).max() < 2.0 * 1e-6 * fastest


def test_jitter_is_that_of_a_turning_imbalance():
    """A rotor at constant speed: -d/dt of U Omega across its axis, at the angle Omega
    t."""
    block = wheels(
        unbalance=1e-8, inertia_wheel=(J, 0, 0, 0), h_start_wheel=(0.8, 0, 0, 0)
    )
    dt = 1e-4
    values = np.array(
        [(run(block, 1, dt, k), block.tau_jitter_body)[1] for k in range(1000)]
    )
    assert not values[:, 0].any()
    assert np.hypot(values[:, 1], values[:, 2]) == pytest.approx(
        1e-8 * 100.0**2, rel=1e-4
    )
    angle = np.unwrap(np.arctan2(values[:, 2], values[:, 1]))
    assert np.diff(angle) == pytest.approx(100.0 * dt, rel=1e-6)
    assert block.tau_mean_wheel == (0.0, 0.0, 0.0, 0.0), "jitter is no wheel torque"


@pytest.mark.parametrize("dt", [1.0, 10.0])
def test_speed_is_exact_at_the_beginning_of_a_step(dt):
    """Tumbling with 30 deg/s: once 6e-2 rad/s wrong, 0.18 at 10 s."""
    block = wheels(viscous=2e-5, h_start_wheel=(0.5, -1.5, 0.8, 0))
    for k in range(30):
        phase = 0.5 * k * dt
        omega = (0.5 * math.sin(phase), 0.5 * math.cos(phase), 0.1)
        block.omega_bi_body = omega
        h = block.h_wheel
        run(block, 1, dt, k)
        exact_speed = [h[i] / J - omega[i] for i in range(3)]
        assert block.speed_wheel[:3] == pytest.approx(exact_speed, abs=1e-12)


def test_axes_must_be_unit_vectors():
    with pytest.raises(BlockError, match=r"column 2 = .* is not a unit vector"):
        wheels(axes_wheel=(1.0, 0, 0, 0, 0, 2.0, 0, 0, 0, 0, 1.0, 0))
    assert math.isclose(wheels().h_wheel[0], 0.0)


def test_each_rotor_begins_its_jitter_at_an_angle_of_its_own():
    s = 1.0 / math.sqrt(3.0)
    wheels = fresh("wheels")
    wheels.axes_wheel = (s, -s, -s, s, s, s, -s, -s, s, s, s, s)
    wheels.inertia_wheel = (3.2e-5,) * 4
    begin(wheels)
    assert len({round(a, 6) for a in wheels._rotor_angles}) == 4
