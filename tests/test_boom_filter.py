"""The joint filter of a craft with a boom: what it finds, what it dumps, what is refused."""

from __future__ import annotations

import hashlib
import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from test_alsat1 import NEAR, THREE, J, N, boom

from desat.components.contract.block import BlockError
from desat.components.laws import boom_filter, orbit_momentum
from desat.components.maths.attitude import propagated
from desat.components.maths.vector import cross, dot, inverse
from desat.runs.run import Options, execute

ORBIT = 6128  # s, and samples of a run's series
BIAS = (1e-4, -1e-4, 1e-4)
TORQUE = (0.0, 5.47e-6, 0.0)
DIPOLE = (0.6, -0.6, 0.6)
NO_FIRING = "shared.schedule_duration=0,0,0,0,0,0,0,0"
JOINT = ("manager.estimator=joint", "manager.torque_noise=1e-6,1e-6,1e-6")


def listed(values) -> str:
    return ",".join(str(x) for x in values)


DISTURBED = (
    f"gyro.bias_body={listed(BIAS)}",
    f"spacecraft.tau_disturbance_body={listed(TORQUE)}",
    f"spacecraft.residual_dipole_body={listed(DIPOLE)}",
)
SETTING = boom_filter.Setting(
    1.7e-3,
    3.5e-5,
    boom_filter.Deviations(2e-4, 1e-5, 1.0),
    boom_filter.Deviations(1e-9, 2e-10, 1e-5),
    J,
    inverse(J),
)


@cache
def run(stop, blocks=False, sets=()):
    options = Options(blocks=blocks, stop=stop, sets=[*JOINT, *sets])
    found = execute("alsat1/firing-ours", options)
    assert found.ok, found.manifest["message"]
    return found


# --- the filter -----------------------------------------------------------------------


def test_bias_torque_and_dipole_are_found_within_an_orbit():
    """After one orbit, of the second one the root mean square error of each axis."""
    results = run(12250.0, sets=(*DISTURBED, NO_FIRING)).results
    for name, truth, most in (
        ("bias_est_body", BIAS, 2e-6),
        ("tau_est_body", TORQUE, 5e-8),
        ("dipole_est_body", DIPOLE, 0.01),
    ):
        error = results.values(f"manager.{name}")[ORBIT:] - np.array(truth)
        assert np.sqrt((error**2).mean(axis=0)).max() < most, name
    assert not results.values("manager.filter_restarts").any()


def test_native_and_python_give_the_same_bits():
    one, other = (
        run(400.0, blocks=blocks, sets=(*DISTURBED, *NEAR)) for blocks in (True, False)
    )
    names = [
        n for n in one.results.names() if n.startswith(("spacecraft.", "manager."))
    ]
    assert "manager.dipole_est_body" in names
    for name in names:
        same = np.array_equal(one.results.values(name), other.results.values(name))
        assert same, name


def orbit_field(t):
    """Field (T) of a dipole in a polar orbit, axes of the orbit."""
    return (2.2e-5 * math.cos(N * t), -3e-6, 4.4e-5 * math.sin(N * t))


def interval(t, dipole=(0.0, 0.0, 0.0)):
    return boom_filter.Interval(
        10.0,
        dipole,
        orbit_field(t),
        (0.0, 0.0, 1.0),
        N,
        (0.01, -0.02, 0.03),
        (0.01, -0.02, 0.03),
        (0.0, 0.0, 0.0),
        (1e-5, 1e-5, 1e-5),
    )


def test_the_covariance_stays_symmetric_and_positive_over_ten_orbits():
    q, omega = (0.0, 0.0, 0.0, 1.0), (0.0, -N, 0.0)
    x, p = boom_filter.begin(omega, SETTING)
    for k in range(6130):
        measured = propagated(q, omega, 10.0)
        q, x, p, _, surprise = boom_filter.update(
            q, x, p, interval(10.0 * k), measured, omega, SETTING
        )
        assert surprise < boom_filter.UNSOUND
        if k % 100 == 0:
            matrix = np.reshape(p, (15, 15))
            assert np.array_equal(matrix, matrix.T)
            scale = np.sqrt(np.diag(matrix))
            assert np.linalg.eigvalsh(matrix / np.outer(scale, scale)).min() > 0.0


def test_the_transition_is_the_slope_of_the_prediction():
    """Columns of rate, torque and dipole against differences of the nonlinear model."""
    span = interval(700.0, (1.0, -2.0, 0.5))
    x = np.zeros(15)
    x[3:6], x[9:12], x[12:15] = (2e-4, -N, 3e-4), TORQUE, DIPOLE
    effects = [0.0] * 90
    boom_filter._fill_effects(effects, tuple(x[3:6]), span, SETTING)

    def rate(state):
        values = tuple(state)
        out, p = list(values), [0.0] * 225
        return np.array(boom_filter._predict(out, p, values, span, SETTING))

    for column in (3, 4, 5, 9, 10, 11, 12, 13, 14):
        step = np.zeros(15)
        step[column] = {0: 1e-5, 1: 1e-5, 3: 1e-6, 4: 1e-1}[column // 3]
        slope = (rate(x + step) - rate(x - step)) / (2.0 * step[column])
        linear = np.reshape(effects, (6, 15))[3:, column]
        assert linear == pytest.approx(slope, rel=5e-3, abs=2e-3 * abs(slope).max())


def test_a_gap_keeps_what_is_constant():
    omega = (1e-4, -N, 2e-4)
    x, p = boom_filter.begin(omega, SETTING)
    x = (*x[:6], *BIAS, *TORQUE, *DIPOLE)
    state, covariance = boom_filter.resume(x, p, omega, SETTING)
    assert state[6:] == x[6:]
    assert state[3:6] == pytest.approx(np.subtract(omega, BIAS))
    matrix = np.reshape(covariance, (15, 15))
    assert np.array_equal(matrix, matrix.T)
    assert np.array_equal(matrix[6:, 6:], np.reshape(p, (15, 15))[6:, 6:])
    assert np.linalg.eigvalsh(matrix).min() >= 0.0


def joint(**parameters):
    values = {"estimator": 1, "torque_noise": (1e-6,) * 3, "axes_wheel": THREE}
    block = boom("manager_boom_feedforward", **{**values, **parameters})
    block.q_bi, block.omega_bi_body = (0.0, 0.0, 0.0, 1.0), (0.0, -N, 0.0)
    return block


def test_a_lost_filter_starts_anew_and_says_so():
    block = joint()
    for k in range(30):
        block.advance(10.0 * k, 10.0)
    assert block.filter_restarts == 0
    block.q_bi = propagated((0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0), 1.0)
    for k in range(30, 36):
        block.advance(10.0 * k, 10.0)
    assert block.filter_restarts == 1
    assert block._q == pytest.approx(block.q_bi, abs=0.1)


def test_without_an_attitude_the_constants_stay_and_act():
    """The wheels hold the rate without the gyro's bias, and take the constant torque."""
    block = joint()
    for k in range(10):
        block.advance(10.0 * k, 10.0)
    block._state = (*block._state[:6], *BIAS, *TORQUE, *DIPOLE)
    block.bias_est_body, block.tau_est_body = BIAS, TORQUE
    block.omega_bi_body = tuple(np.add((0.0, -N, 0.0), BIAS))
    block.valid_q = False
    block.advance(100.0, 10.0)
    assert block.tau_cmd_wheel[:3] == pytest.approx(TORQUE, abs=1e-15)
    block.valid_q = True
    block.advance(110.0, 10.0)
    assert block.bias_est_body == pytest.approx(BIAS)
    assert block.filter_restarts == 0


# --- what the orbit gives back --------------------------------------------------------


def test_the_field_of_an_orbit_is_learnt():
    c, p = orbit_momentum.first_field()
    share = orbit_momentum.retention_of(10.0, 9000.0)
    for k in range(620):
        c, p = orbit_momentum.learn_field(
            c, p, orbit_field(10.0 * k), 10.0 * N * k, share
        )
    assert orbit_momentum.term(c, 0) == pytest.approx((0.0, -3e-6, 0.0), abs=1e-8)
    assert orbit_momentum.term(c, 1) == pytest.approx((2.2e-5, 0.0, 0.0), abs=1e-8)
    assert orbit_momentum.term(c, 2) == pytest.approx((0.0, 0.0, 4.4e-5), abs=1e-8)
    size = math.sqrt(3e-6**2 + 0.5 * (2.2e-5**2 + 4.4e-5**2))
    assert orbit_momentum.field_size(c) == pytest.approx(size, rel=1e-3)


small = st.floats(-1e-5, 1e-5)
torques = st.tuples(small, small, small)


@given(torques, torques, torques)
def test_the_periodic_momentum_solves_the_wheels_equations(mean, even, odd):
    """Less the torque that drives it ever further, the solution is periodic."""
    # about pitch a mean grows; about roll and yaw what turns with the momentum
    a, b = 0.5 * (even[0] - odd[2]), 0.5 * (even[2] + odd[0])
    mean = (mean[0], 0.0, mean[2])
    even = (even[0] - a, even[1], even[2] - b)
    odd = (odd[0] - b, odd[1], odd[2] + a)
    torque = orbit_momentum.OrbitTorque(mean, even, odd)

    def slope(t, h):
        c, s = math.cos(N * t), math.sin(N * t)
        x, y, z = (mean[i] + even[i] * c + odd[i] * s for i in range(3))
        return (x + N * h[2], y, z - N * h[0])

    first = orbit_momentum.periodic_momentum(torque, 0.0, N, True)
    last = solve_ivp(slope, (0.0, 3000.0), first, rtol=1e-9, atol=1e-12).y[:, -1]
    expected = orbit_momentum.periodic_momentum(torque, 3000.0 * N, N, True)
    assert last == pytest.approx(expected, abs=1e-6)


@given(st.tuples(*(st.floats(-0.1, 0.1),) * 3), st.tuples(*(st.floats(-1.0, 1.0),) * 3))
def test_coils_take_only_momentum_beyond_the_threshold(excess, direction):
    b = tuple(4e-5 * x for x in direction)
    m = orbit_momentum.dump_dipole(excess, b, 0.02, 4e-5, 300.0)
    assert dot(cross(m, b), excess) <= 1e-18
    g = cross(b, excess)
    for i in range(3):
        assert m[i] == 0.0 or abs(g[i]) > 0.02 * 4e-5 * (1.0 - 1e-9)


def test_a_lean_about_roll_holds_a_torque_in_orbit():
    k = orbit_momentum.stiffness(J, N)
    assert k == pytest.approx((3.0 * N * N * 148.0,) * 2 + (0.0,))
    remaining = orbit_momentum.compute_net_torque((k[0], k[1], 1.0), k, (0.75, 1.0, 0))
    assert remaining == pytest.approx((0.0, 0.0, 1.0), abs=1e-15)


# --- runs -----------------------------------------------------------------------------


def test_the_craft_stays_upright_with_bias_dipole_and_torque_at_once():
    """Both firings: roll and pitch; today's law exceeds a degree."""
    found = execute("alsat1/firing-ours", Options(sets=[*JOINT, *DISTURBED]))
    numbers = {k: n["value"] for k, n in found.manifest["numbers"].items()}
    assert max(numbers[k] for k in ("roll_1", "pitch_1", "roll_2", "pitch_2")) < 0.5
    assert numbers["on_time"] < 9500.0
    assert not numbers["wheel_saturated"]
    assert not found.results.values("manager.filter_restarts").any()


def test_defaults_give_the_bits_of_before():
    """Attitude, momentum and coils of a firing, as they were without the filter."""
    options = Options(blocks=True, stop=400.0, sets=list(NEAR))
    results = execute("alsat1/firing-ours", options).results
    digest = hashlib.sha256()
    for name in ("spacecraft.q_bi", "wheels.h_wheel", "torquers.on_time"):
        digest.update(np.ascontiguousarray(results.values(name)).tobytes())
    assert digest.hexdigest()[:16] == "cf48913bacd8a6bc"


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        ({"bias_spread": 0.0}, "bias_spread = 0: it must be above 0"),
        ({"disturbance_spread": 0.0}, "disturbance_spread = 0: it must be above 0"),
        ({"dipole_spread": 0.0}, "dipole_spread = 0: it must be above 0"),
        ({"dipole_walk": 0.5, "dipole_spread": 0.1}, "dipole_walk = 0.5 is above dip"),
        ({"torque_noise": (1e-6, 0.0, 1e-6)}, "torque_noise must be above 0 about"),
        ({"lean_limit": 0.01}, "lean_total_limit = 0.0054 rad is below lean_limit"),
        ({"field_memory": 50.0}, "field_memory = 50 s is below ten samples of 10 s"),
        ({"axes_wheel": (0.0,) * 12}, "wheels = x_y_z: axes_wheel has no wheel along"),
    ],
)
def test_what_makes_no_sense_is_refused(parameters, text):
    with pytest.raises(BlockError, match=text):
        joint(**parameters)
