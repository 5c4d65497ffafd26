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

from desat.components.contract.block import BlockError
from desat.components.laws import attitude_error, boom_filter, orbit_momentum
from desat.components.laws import gravity_gradient as gravity
from desat.components.maths import kalman
from desat.components.maths.attitude import propagated, rotate
from desat.components.maths.vector import add, cross, dot, inverse, mat_vec, sub
from desat.runs.run import Options, execute
from tests.papers.test_alsat1 import NEAR, THREE, J, N, boom

ORBIT = 6128  # s, and samples of a run's series
BIAS = (1e-4, -1e-4, 1e-4)
TORQUE = (0.0, 5.47e-6, 0.0)
DIPOLE = (0.6, -0.6, 0.6)
OFFSET = (0.005, -0.005, 0.005)  # rad, 0.5 deg together
NO_FIRING = "shared.schedule_duration=0,0,0,0,0,0,0,0"
NO_MODEL = "manager.field_model=none"
SEPARATE = (
    "manager.estimator=separate_axes",
    "manager.torque_noise=1e-5,1e-5,1e-5",
    NO_MODEL,
)


def format_values(values) -> str:
    return ",".join(str(x) for x in values)


DISTURBED = (
    f"gyro.bias_body={format_values(BIAS)}",
    f"spacecraft.tau_disturbance_body={format_values(TORQUE)}",
    f"spacecraft.residual_dipole_body={format_values(DIPOLE)}",
)
OFF = f"determination.misalignment_body={format_values(OFFSET)}"
DIPOLE_FIELD = "environment.field=dipole"
IGRF = ("environment.field=igrf", "manager.field_model=igrf", "manager.igrf_degree=6")
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
    options = Options(blocks=blocks, stop=stop, sets=list(sets))
    flight = execute("alsat1/firing-ours", options)
    assert flight.ok, flight.manifest["message"]
    return flight


# --- the filter -----------------------------------------------------------------------


def test_bias_torque_and_dipole_are_found_within_an_orbit():
    """After one orbit, of the second one the root mean square error of each axis."""
    results = run(12250.0, sets=(*DISTURBED, NO_FIRING, NO_MODEL)).results
    for name, truth, most in (
        ("bias_est_body", BIAS, 2e-6),
        ("tau_est_body", TORQUE, 5e-8),
        ("dipole_est_body", DIPOLE, 0.01),
    ):
        error = results.values(f"manager.{name}")[ORBIT:] - np.array(truth)
        assert np.sqrt((error**2).mean(axis=0)).max() < most, name
    assert not results.values("manager.filter_restarts").any()


@pytest.mark.parametrize("model", [(), (NO_MODEL,), IGRF])
def test_native_and_python_give_the_same_bits(model):
    one, other = (
        run(400.0, blocks=blocks, sets=(*DISTURBED, OFF, *model, *NEAR))
        for blocks in (True, False)
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
        attitude = propagated(q, omega, 10.0)
        q, x, p, _, surprise = boom_filter.update(
            q, x, p, interval(10.0 * k), attitude, omega, SETTING
        )
        assert surprise < kalman.UNSOUND
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


# --- the second reference ---------------------------------------------------------------


def test_a_constant_attitude_error_and_a_torque_are_told_apart():
    """By the field: after one orbit, of the second one the rms error of each axis."""
    sets = (*DISTURBED, OFF, NO_FIRING, *IGRF)
    results = run(12250.0, sets=sets).results
    for name, truth, most in (
        ("offset_est_body", OFFSET, 3e-3),
        ("tau_est_body", TORQUE, 1e-6),
        ("dipole_est_body", DIPOLE, 0.02),
    ):
        error = results.values(f"manager.{name}")[ORBIT:] - np.array(truth)
        assert np.sqrt((error**2).mean(axis=0)).max() < most, name


def refer(model_error=0.0):
    """Return the numbers of the filter after three orbits, with a bias of 1 uT."""
    rng = np.random.default_rng(1)
    x, p, remainder = (
        (0.0,) * 6,
        attitude_error.first_covariance(8.7e-3, 1e-6),
        (0.0, 0.0),
    )
    for k in range(1838):
        b = orbit_field(10.0 * k)
        erring_field = rotate(
            (0.0, 0.0, math.sin(model_error), math.cos(model_error)), b
        )
        offset = add(OFFSET, attitude_error.angles_of(x))
        model = sub(erring_field, cross(offset, erring_field))
        field = tuple(np.add(b, 1e-6) + 3e-7 * rng.standard_normal(3))
        variance, remainder = attitude_error.variance_of(
            x, remainder, field, model, 1e-6, 10.0, 9000.0
        )
        p = attitude_error.walked(p, 1e-6, 10.0)
        x, p, _ = attitude_error.update(x, p, field, model, variance, 6)
    return x, p


def test_offset_and_magnetometer_bias_are_found():
    x, p = refer()
    matrix = np.reshape(p, (6, 6))
    assert np.array_equal(matrix, matrix.T)
    deviation = np.sqrt(np.diag(matrix))
    assert deviation[:3].max() < 5e-3
    for estimate, truth, sigma in (
        (attitude_error.angles_of(x), sub((0.0, 0.0, 0.0), OFFSET), deviation[:3]),
        (attitude_error.field_error_of(x), (1e-6,) * 3, deviation[3:]),
    ):
        assert np.all(np.abs(np.subtract(estimate, truth)) < 2.0 * sigma)


def test_a_model_that_does_not_fit_counts_less():
    good, bad = (refer(error)[1] for error in (0.0, 0.2))
    assert (
        np.diag(np.reshape(bad, (6, 6)))[1] > 4.0 * np.diag(np.reshape(good, (6, 6)))[1]
    )


@given(st.tuples(*(st.floats(-0.01, 0.01),) * 3))
def test_a_known_error_moves_torque_into_attitude(change):
    """The total torque is the same before and after, and so is what the gyro measures."""
    x = np.zeros(15)
    x[3:6], x[6:9], x[9:12] = (2e-4, -N, 3e-4), BIAS, TORQUE
    nadir = (0.02, -0.03, 1.0)
    _, new_state = boom_filter.turn((0.0, 0.0, 0.0, 1.0), tuple(x), change, nadir, N, J)

    def total(state, u):
        omega = tuple(state[3:6])
        free = sub(
            gravity.gravity_vector_torque(u, J, N), cross(omega, mat_vec(J, omega))
        )
        return add(free, tuple(state[9:12]))

    after = total(new_state, add(nadir, cross(change, nadir)))
    assert after == pytest.approx(total(x, nadir), abs=1e-17)
    gyro = add(boom_filter.rate_of(new_state), boom_filter.bias_of(new_state))
    assert gyro == pytest.approx(tuple(x[3:6] + x[6:9]), abs=1e-17)


SCHEDULE = {
    "schedule_start": (1000.0,),
    "schedule_duration": (30.0,),
    "schedule_tau_body": (0.0, 1.5e-3, 1.5e-3),
}


@pytest.mark.parametrize(
    ("parameters", "t", "upright"),
    [
        ({"field_model": 1}, 740.0, False),
        ({"field_model": 1}, 760.0, True),
        ({"field_model": 1}, 1270.0, True),
        ({"field_model": 1}, 1290.0, False),
        ({"field_model": 0}, 1000.0, False),
        ({"field_model": 1, "feedforward": False}, 1000.0, False),
        ({"field_model": 1, "upright_time": 0.0}, 990.0, False),
    ],
)
def test_the_lean_ends_before_a_known_firing(parameters, t, upright):
    block = joint(**SCHEDULE, **parameters)
    block._filter_time = 1e5
    block.omega_ref_body = (0.0, -N, 0.0)
    block.tau_est_body = (0.0, 1e-5, 0.0)
    lean = block._lean_and_excess(t, (0.0, 0.0, 0.0))
    assert lean == (0.0, 0.0, 0.0) if upright else lean[1] == block.lean_total_limit


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


def test_learning_is_least_squares_with_weights_that_decay():
    """Of all samples and the first variance, by numpy."""
    retention, count = 0.98, 80
    random = np.random.default_rng(2)
    phases, fields = 0.11 * np.arange(count), 3e-5 * random.normal(size=(count, 3))
    c, p = orbit_momentum.first_field()
    for u, b in zip(phases.tolist(), fields.tolist(), strict=True):
        c, p = orbit_momentum.learn_field(c, p, tuple(b), u, retention)
    rows = np.stack([np.ones(count), np.cos(phases), np.sin(phases)], axis=1)
    weights = retention ** np.arange(count - 1, -1, -1)
    information = retention**count * np.eye(3) / 1e3 + (rows.T * weights) @ rows
    least_squares = np.linalg.solve(information, (rows.T * weights) @ fields)
    assert pytest.approx(least_squares, abs=1e-15) == np.reshape(c, (3, 3)).T
    assert np.linalg.inv(information) == pytest.approx(np.reshape(p, (3, 3)), rel=1e-9)


def test_information_decays_to_a_share_of_e_within_the_memory():
    assert orbit_momentum.retention_of(9000.0, 9000.0) == pytest.approx(1.0 / math.e)
    assert orbit_momentum.retention_of(90.0, 9000.0) == pytest.approx(math.exp(-0.01))


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
    periodic = orbit_momentum.periodic_momentum(torque, 3000.0 * N, N, True)
    assert last == pytest.approx(periodic, abs=1e-6)


@given(torques, torques, torques, st.booleans())
def test_the_size_of_the_periodic_momentum_bounds_it(mean, even, odd, has_roll):
    torque = orbit_momentum.OrbitTorque(mean, even, odd)
    size = np.array(orbit_momentum.periodic_size(torque, N, has_roll))
    momenta = [
        orbit_momentum.periodic_momentum(torque, u, N, has_roll)
        for u in np.linspace(0.0, 2.0 * math.pi, 720)
    ]
    assert np.abs(momenta).max(axis=0) == pytest.approx(size, rel=1e-4, abs=1e-12)


@given(torques, torques, torques, st.floats(0.0, 6.0))
def test_without_a_roll_wheel_each_axis_takes_its_own_torque(mean, even, odd, u):
    """By differences: h_y' and h_z' are the periodic torques about y and z."""
    torque = orbit_momentum.OrbitTorque(mean, even, odd)
    before, after = (
        np.array(orbit_momentum.periodic_momentum(torque, x, N, False))
        for x in (u - 1e-3, u + 1e-3)
    )
    periodic_torque = np.array(even) * math.cos(u) + np.array(odd) * math.sin(u)
    periodic_torque[0] = 0.0
    assert (after - before) / (2e-3 / N) == pytest.approx(periodic_torque, abs=1e-10)


def test_the_torque_over_an_orbit_is_that_of_the_dipole_in_its_field():
    c = (1e-5, 2e-5, -3e-5, 4e-6, 5e-6, -6e-6, 7e-5, -8e-5, 9e-5)
    constant, dipole = (1e-6, -2e-6, 3e-6), (0.1, -0.2, 0.3)
    mean, even, odd = orbit_momentum.torque_over_orbit(c, constant, dipole)
    u = 0.7
    field = np.reshape(c, (3, 3)) @ (1.0, math.cos(u), math.sin(u))
    torque = (
        np.array(mean) + np.multiply(even, math.cos(u)) + np.multiply(odd, math.sin(u))
    )
    assert torque == pytest.approx(np.add(constant, np.cross(dipole, field)), rel=1e-12)


@given(st.tuples(*(st.floats(-0.1, 0.1),) * 3))
def test_coils_without_a_threshold_take_the_excess_across_the_field(excess):
    """m x B = -s / time, less the part along the field; with a dead zone each |g_i| less."""
    b, time = np.array([2e-5, -1e-5, 3e-5]), 300.0
    m = orbit_momentum.dump_dipole(excess, tuple(b), 0.0, 4e-5, time)
    across = excess - b * (excess @ b) / (b @ b)
    assert np.cross(m, b) == pytest.approx(-across / time, abs=1e-15)
    g = np.cross(b, excess)
    remainder = np.sign(g) * np.maximum(np.abs(g) - 0.02 * 4e-5, 0.0)
    m = orbit_momentum.dump_dipole(excess, tuple(b), 0.02, 4e-5, time)
    assert m == pytest.approx(-remainder / (b @ b * time), rel=1e-12, abs=1e-15)


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


@pytest.mark.parametrize(
    ("x", "y", "stiffness"), [(2.0, 3.0, (1.5, 0.0, 0.0)), (3.0, 2.0, (0.0, 1.5, 0.0))]
)
def test_gravity_holds_nothing_about_axes_where_it_is_unstable(x, y, stiffness):
    inertia = (x, 0.0, 0.0, 0.0, y, 0.0, 0.0, 0.0, 2.5)
    k = orbit_momentum.stiffness(inertia, N)
    assert k == pytest.approx(tuple(N * N * s for s in stiffness), rel=1e-12, abs=0.0)


LEAN_LIMIT, CAPACITY = 6, 7


@pytest.mark.parametrize(
    ("h_limit", "torque", "reason"),
    [
        (0.0, 0.0, 0),
        (0.1, 0.0, 0),
        (0.08, 0.0, CAPACITY),  # 1.3 times 45 mN m s, and the threshold of 25
        (0.1, 1e-5, LEAN_LIMIT),
    ],
)
def test_what_leans_or_wheels_cannot_do_is_a_reason(h_limit, torque, reason):
    block = joint(**SCHEDULE, h_limit=h_limit)
    block._filter_time, block._phase = 1e5, 0.0
    block.omega_ref_body = (0.0, -N, 0.0)
    block.tau_est_body = (0.0, torque, 0.0)
    for k in range(614):
        block.reason = 0
        block._lean_and_excess(-10.0 * k, (0.0, 0.0, 0.0))
        assert k > 600 or block.reason in (0, CAPACITY)
    assert block.reason == reason


def test_a_wheel_that_a_firing_fills_is_foreseen():
    wires = frozenset({"q_ref_bi", "b_body"})
    (line,) = joint(**SCHEDULE, h_limit=0.08).foresee(0.0, 2000.0, wires)
    assert line.startswith(
        "h_limit = 0.08 N m s: the largest firing, the bias and dump"
    )
    assert "need 0.083 N m s" in line
    assert not list(joint(**SCHEDULE, h_limit=0.085).foresee(0.0, 2000.0, wires))
    assert not list(joint(**SCHEDULE, h_limit=0.08).foresee(1040.0, 2000.0, wires))


def test_a_field_model_without_the_joint_estimator_is_foreseen():
    (line,) = joint(estimator=0, field_model=1).foresee(0.0, 1.0, frozenset())
    assert line.startswith("field_model has no effect")


# --- runs -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "more",
    [
        (NO_MODEL, DIPOLE_FIELD),
        (OFF,),
        (OFF, *IGRF, "magnetometer.bias_body=1e-6,1e-6,-1e-6"),
    ],
)
def test_the_craft_stays_upright_with_bias_dipole_and_torque_at_once(more):
    """Both firings: roll and pitch; without the joint filter they exceed a degree."""
    flight = execute("alsat1/firing-ours", Options(sets=[*DISTURBED, *more]))
    numbers = {k: n["value"] for k, n in flight.manifest["numbers"].items()}
    assert max(numbers[k] for k in ("roll_1", "pitch_1", "roll_2", "pitch_2")) < 0.5
    assert numbers["on_time"] < 9500.0
    assert not numbers["wheel_saturated"]
    assert not flight.results.values("manager.filter_restarts").any()


def test_a_coarse_field_model_does_little_harm():
    """A dipole against a field of degree 13, beside none."""
    sets = (*DISTURBED, "environment.field=igrf")
    worst = []
    for more in ((NO_MODEL,), ()):
        flight = execute(
            "alsat1/firing-ours", Options(stop=60000.0, sets=[*sets, *more])
        )
        numbers = flight.manifest["numbers"]
        worst.append(max(numbers[k]["value"] for k in ("roll_1", "pitch_1")))
    assert worst[1] < worst[0] + 0.1


def test_separate_axes_give_the_bits_of_before():
    """Attitude, momentum and coils of a firing, as they were without the filter."""
    options = Options(blocks=True, stop=400.0, sets=[*NEAR, *SEPARATE, DIPOLE_FIELD])
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
        ({"field_model": 2, "offset_spread": 0.0}, "offset_spread = 0: it must be"),
        ({"field_model": 2, "epoch_j2000": -3.19e9}, "epoch_j2000 = -3190000000 s"),
        ({"axes_wheel": (0.0,) * 12}, "wheels = x_y_z: axes_wheel has no wheel along"),
    ],
)
def test_what_makes_no_sense_is_refused(parameters, text):
    with pytest.raises(BlockError, match=text):
        joint(**parameters)
