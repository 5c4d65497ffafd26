"""Paper 002: laws, estimates, managers, what is refused, losses, short runs, stored
draws."""

from __future__ import annotations

import json
import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from desat.components.contract.block import BlockError
from desat.components.laws import cross_product, firing
from desat.components.laws import gravity_gradient as laws
from desat.components.maths.attitude import matrix, product, propagate, rotate
from desat.components.maths.vector import cross, dot, mat_vec, norm
from desat.components.physics import geomagnetic
from desat.components.physics.gyrostat import check_inertia
from desat.engine import trial_initialisation
from desat.export.packing import pack_scenario
from desat.figures.plots import lines_of
from desat.files.scenario import find, scenarios
from desat.numbers import derived, measures
from desat.papers import stored
from desat.runs.run import Options, execute, prepare
from desat.system.refusal import explain
from tests.conftest import cross3
from tests.contract.test_block import begin, fresh

N = 0.0010252474302388003
MOMENTS, PRODUCTS = (153.0, 153.0, 5.0), (-0.25, 0.0005, 0.1)
J = (153.0, 0.25, -0.1, 0.25, 153.0, -0.0005, -0.1, -0.0005, 5.0)
PRINTED = (153.0, 0.0, 0.0, -0.25, 153.0, 0.0005, 0.1, 0.0, 5.0)
B = (2e-5, -1e-5, 3e-5)
NO_AXES = (0.0,) * 12
ALONG_Y = (0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
ALONG_Z = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
THREE = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)
NOTHING, NO_FIELD, NO_ATTITUDE, NO_RATE, NO_MOMENTUM, TORQUE_LIMIT = range(6)

component = st.floats(-1.0, 1.0)
vectors = st.tuples(component, component, component).filter(lambda v: norm(v) > 1e-2)
fields = vectors.map(lambda v: tuple(4e-5 * x for x in v))
quaternions = (
    st.tuples(component, component, component, component)
    .filter(lambda q: dot(q[:3], q[:3]) + q[3] ** 2 > 1e-2)
    .map(lambda q: tuple(x / math.sqrt(dot(q[:3], q[:3]) + q[3] ** 2) for x in q))
)


# --- the paper's equations ------------------------------------------------------------


@given(quaternions)
def test_eqs_7_to_9_are_the_vector_form_with_products_in_the_positive_form(q):
    a = matrix(q)
    u = (a[2], a[5], a[8])
    written = laws.gravity_torque(a, MOMENTS, PRODUCTS, N)
    vector = laws.gravity_vector_torque(u, J, N)
    assert written == pytest.approx(vector, abs=1e-14 * 153.0 * 3.0 * N * N)


def test_eqs_7_to_9_are_not_the_vector_form_with_the_tensor_s_sign():
    a = matrix((0.1, 0.2, -0.1, math.sqrt(0.94)))
    wrong = laws.gravity_torque(a, MOMENTS, tuple(-x for x in PRODUCTS), N)
    right = laws.gravity_vector_torque((a[2], a[5], a[8]), J, N)
    assert max(abs(x - y) for x, y in zip(wrong, right, strict=True)) > 1e-7


@given(st.floats(-1.2, 1.2), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_the_angles_are_those_of_the_2_1_3_sequence(roll, pitch, yaw):
    q = product(
        (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)),
        product(
            (math.sin(roll / 2), 0.0, 0.0, math.cos(roll / 2)),
            (0.0, math.sin(pitch / 2), 0.0, math.cos(pitch / 2)),
        ),
    )
    assert laws.euler_angles(matrix(q)) == pytest.approx((roll, pitch, yaw), abs=1e-9)


@given(quaternions, vectors)
def test_eq_6_is_the_rate_of_these_angles(q, omega):
    angles = laws.euler_angles(matrix(q))
    if abs(angles[0]) > 1.3:
        return
    step = 1e-6
    ahead = laws.euler_angles(matrix(propagate(q, omega, step)))
    back = laws.euler_angles(matrix(propagate(q, omega, -step)))
    found = [
        math.remainder(x - y, 2.0 * math.pi) / (2.0 * step)
        for x, y in zip(ahead, back, strict=True)
    ]
    assert laws.euler_rates(angles, omega) == pytest.approx(found, abs=1e-7, rel=1e-5)


@given(vectors, vectors)
def test_eq_12_is_a_dipole_that_points_north(strength, direction):
    r = tuple(7.2e6 / norm(direction) * x for x in direction)
    north = tuple(7.8e15 * x for x in strength)
    south = tuple(-x for x in north)
    assert laws.dipole_field(north, r) == pytest.approx(
        geomagnetic.dipole(r, south), rel=1e-12
    )


def test_eq_12_is_igrf_of_degree_1_without_its_tilt():
    g10, year = -29350.0e-9, 2025.0
    r = (4e6, -3e6, 5e6)
    along = laws.dipole_field((0.0, 0.0, -g10 * geomagnetic.REFERENCE_RADIUS**3), r)
    igrf = geomagnetic.igrf(r, year, 1)
    tilt = laws.dipole_field(
        tuple(
            -x * geomagnetic.REFERENCE_RADIUS**3 for x in (-1410.3e-9, 4545.5e-9, 0.0)
        ),
        r,
    )
    assert tuple(x + y for x, y in zip(along, tilt, strict=True)) == pytest.approx(
        igrf, rel=2e-4
    )
    # on the northern side of the equator the field points down, and north at it
    assert laws.dipole_field((0.0, 0.0, 7.8e15), (7e6, 0.0, 0.0))[2] > 0.0


@given(vectors, fields)
def test_eqs_13_to_16_take_momentum_and_never_push_along_the_field(h, b):
    m = laws.cross_product(tuple(380.0 * x for x in h), b)
    torque = mat_vec(laws.coil_matrix(b), m)
    assert torque == pytest.approx(cross(m, b), abs=1e-12)
    assert dot(torque, b) == pytest.approx(0.0, abs=1e-12 * norm(m) * norm(b) ** 2)
    assert dot(torque, h) <= 1e-12 * norm(h) * norm(m) * norm(b)
    assert m == pytest.approx(cross_product.ccpl(h, b, 380.0))


def test_the_aerodynamic_torque_at_table_1_s_densities():
    """The same order as eq. 11 within a factor of 3: at average activity, not at high."""
    arm = (
        0.18 * 3.1 + 0.0225 * 6.175 - 0.36 * 0.2
    )  # of boom, tip and box as in craft.toml (m3)
    speed = 7421.0
    ratio = {
        density: norm(
            laws.aerodynamic_torque(density, speed, arm, (0.0, 0.0, 1.0), (1.0, 0, 0))
        )
        / 1.74e-7
        for density in (6.95e-15, 1.24e-14, 9.41e-14, 1.59e-13)
    }
    same = {d for d, x in ratio.items() if 1.0 / 3.0 <= x <= 3.0}
    assert same == {6.95e-15, 1.24e-14}


def test_the_rigid_body_is_eq_1():
    """Table 3's start for an orbit, against eqs. 1 to 4 integrated by themselves."""
    r0 = 7238137.0
    body = fresh("spacecraft_rigid")
    roll = math.radians(3.0)
    body.inertia, body.start_frame = J, 1
    body.q_start_bi = (math.sin(roll / 2), 0.0, 0.0, math.cos(roll / 2))
    body.omega_start_body = (0.0, -2.3355186928902e-5, 0.0104183182073188)
    body.inertia_wheel = (0.0,) * 4

    def place(t):
        c, s = math.cos(N * t), math.sin(N * t)
        return (r0 * c, r0 * s, 0.0), (-r0 * N * s, r0 * N * c, 0.0)

    body.r_eci, body.v_eci = place(0.0)
    begin(body)
    start = (*body.q_bi, *body.omega_bi_body)
    assert body.omega_bi_body == pytest.approx(
        (0.0, -2.0 * math.pi / 6000.0, math.radians(0.6)), abs=1e-15
    )
    inertia = np.reshape(J, (3, 3))
    inverse = np.linalg.inv(inertia)

    def eq_1(t, y):
        q, w = y[:4], y[4:]
        u = np.array(rotate(tuple(q), (math.cos(N * t), math.sin(N * t), 0.0)))
        torque = 3.0 * N * N * cross3(u, inertia @ u) - cross3(w, inertia @ w)
        x, yy, z = w
        omega = np.array(
            [[0, z, -yy, x], [-z, 0, x, yy], [yy, -x, 0, z], [-x, -yy, -z, 0]]
        )
        return np.concatenate([0.5 * omega @ q, inverse @ torque])

    # eq. 7's mu / r^3 is n^2; ours takes r
    assert pytest.approx(N * N, rel=1e-12) == 3.986004418e14 / r0**3
    stop = 6128
    reference = solve_ivp(
        eq_1, (0.0, stop), start, method="DOP853", rtol=1e-13, atol=1e-15
    )
    for k in range(stop):
        body.r_eci, body.v_eci = place(float(k))
        body.advance(float(k), 1.0)
    body.output(float(stop))
    end = reference.y[:, -1]
    assert max(abs(x - y) for x, y in zip(body.q_bi, end[:4], strict=True)) < 1e-9
    assert (
        max(abs(x - y) for x, y in zip(body.omega_bi_body, end[4:], strict=True)) < 1e-9
    )


# --- ours: what is known of a firing --------------------------------------------------


def test_the_predicted_rate_is_euler_s():
    omega, h, impulse = (0.002, -0.001, 0.009), (0.01, 0.02, -0.03), (1e-4, -2e-4, 3e-4)
    inertia = np.reshape(J, (3, 3))

    def slope(_, w):
        return np.linalg.solve(
            inertia, np.array(impulse) / 10.0 - np.cross(w, inertia @ w + np.array(h))
        )

    truth = solve_ivp(slope, (0.0, 10.0), omega, rtol=1e-12, atol=1e-15).y[:, -1]
    inverse = tuple(np.linalg.inv(inertia).ravel())
    found = firing.predicted_rate(omega, h, h, impulse, J, inverse, 10.0)
    still = norm(tuple(x - y for x, y in zip(truth, omega, strict=True)))
    missed = norm(tuple(x - y for x, y in zip(found, truth, strict=True)))
    assert missed < 0.01 * still


@given(st.floats(-5.0, 5.0))
def test_what_pulses_make_of_a_command_is_what_the_torquers_do(m):
    coils = fresh("torquers")
    coils.drive, coils.m_limit, coils.duty_max, coils.least_pulse = 2, 3.604, 0.8, 0.2
    coils.sample_time = 10.0
    begin(coils)
    coils.m_cmd_body = (m, 0.0, 0.0)
    coils.advance(0.0, 10.0)
    assert firing.pulse_dipole(m, 3.604, 0.2, 10.0, 0.8) == pytest.approx(
        coils.m_mean_body[0], abs=1e-12
    )


def test_overlaps_and_gains():
    assert firing.overlap(40.0, 30.0, 60.0, 20.0) == 10.0
    assert firing.overlap(40.0, 30.0, 70.0, 10.0) == 0.0
    assert firing.kalman_gain(0.0, 1.0) == 0.0
    assert firing.kalman_gain(4.0, 2.0) == 0.5


# --- the managers ---------------------------------------------------------------------


def boom(name="manager_boom", **parameters):
    block = fresh(name)
    values = {"sample_time": 10.0, **parameters}
    for key, value in values.items():
        variable = next(v for v in block.variables if v.name == key)
        if variable.shape and len(value) < variable.size:
            value = (*value, *(0.0,) * (variable.size - len(value)))
        setattr(block, key, value)
    block.omega_ref_body = (0.0, -N, 0.0)
    block.b_body = B
    block.omega_bi_body = (1e-5, -N + 2e-5, 3e-5)
    block.q_bi = propagate((0.0, 0.0, 0.0, 1.0), (0.03, -0.02, 0.1), 1.0)
    return begin(block)


def step(block, k=0, **inputs):
    for key, value in inputs.items():
        setattr(block, key, value)
    block.advance(10.0 * k, 10.0)
    return block


def test_the_z_wheel_s_law_and_its_coils():
    block = step(boom(wheel=2, axes_wheel=ALONG_Z), h_wheel=(0.02, 0.0, 0.0, 0.0))
    a = matrix(block.q_bi)
    roll, pitch, yaw = laws.euler_angles(a)
    rate = tuple(
        x - y
        for x, y in zip(
            block.omega_bi_body, rotate(block.q_bi, (0, -N, 0)), strict=True
        )
    )
    assert -block.tau_cmd_wheel[0] == pytest.approx(
        -block.kp * yaw - block.kd * rate[2]
    )
    e = (25.0 * a[5] + 4.4e4 * rate[0], -25.0 * a[2] + 4.4e4 * rate[1], 380.0 * 0.02)
    assert block.m_cmd_body == pytest.approx(laws.cross_product(e, B))
    # upright to first order: the tilt is the sine of roll and pitch, seen in a body
    # that has yawed
    assert math.hypot(a[2], a[5]) == pytest.approx(math.hypot(roll, pitch), rel=1e-3)
    assert block.mode == 1


@given(vectors)
def test_the_coils_torque_is_against_tilt_rate_and_momentum(tilted):
    """Without gyroscopic effects, -|B| e: across the field against each."""
    block = boom(wheel=0, gain_rate=0.0)
    step(
        block,
        q_bi=propagate((0.0, 0.0, 0.0, 1.0), tuple(0.05 * x for x in tilted), 1.0),
    )
    a = matrix(block.q_bi)
    e = tuple(25.0 * x for x in laws.tilt((a[2], a[5], a[8])))
    assert dot(cross(block.m_cmd_body, B), e) <= 0.0


def test_the_y_wheel_follows_its_bias():
    block = boom(wheel=1, axes_wheel=ALONG_Y, gain_tilt=0.0, gain_rate=0.0)
    step(block, h_target_body=(0.0, -0.42, 0.0), h_wheel=(-0.42, 0.0, 0.0, 0.0))
    assert block.m_cmd_body == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
    step(block, 1, h_wheel=(-0.40, 0.0, 0.0, 0.0))
    assert dot(cross(block.m_cmd_body, B), (0.0, 1.0, 0.0)) < 0.0


def test_there_is_a_deadband():
    block = step(boom(wheel=0, deadband=100.0))
    assert not any(block.m_cmd_body)
    assert block.mode == 0


def test_an_inverted_craft_is_turned_by_a_wheel_that_pumps():
    block = boom(wheel=1, axes_wheel=ALONG_Y, recovery=True, recovery_momentum=0.1)
    down = propagate((0.0, 0.0, 0.0, 1.0), (0.0, math.pi - 0.05, 0.0), 1.0)
    step(block, q_bi=down, omega_bi_body=(0.0, -N + 1e-4, 0.0))
    assert block.mode == 2
    # the wheel goes down by as much as the body is to gain in the sense in which it
    # swings
    assert block.tau_cmd_wheel[0] < 0.0
    assert (
        dot(cross(block.m_cmd_body, B), (0.0, 1.0, 0.0)) < 0.0
    )  # the coils damp the swing
    step(block, 1, h_wheel=(-0.1, 0.0, 0.0, 0.0))
    assert block.tau_cmd_wheel[0] == pytest.approx(0.0, abs=1e-15)
    up = propagate((0.0, 0.0, 0.0, 1.0), (0.0, 0.05, 0.0), 1.0)
    step(block, 2, q_bi=up, omega_bi_body=(0.0, -N + 2e-3, 0.0))
    step(block, 3, q_bi=propagate(up, (0.0, -0.1, 0.0), 1.0))
    assert block.tau_cmd_wheel[0] > 0.0  # upright: it takes what it gave
    step(block, 4, q_bi=up, omega_bi_body=(0.0, -N + 1e-4, 0.0))
    assert block.mode == 1


STALE = {"valid_b": NO_FIELD, "valid_q": NO_ATTITUDE, "valid_omega": NO_RATE}
VALUES = {"valid_b": "b_body", "valid_q": "q_bi", "valid_omega": "omega_bi_body"}
SCENARIOS = [
    ("manager_boom", {"wheel": 2, "axes_wheel": ALONG_Z}),
    ("manager_boom", {"wheel": 1, "axes_wheel": ALONG_Y}),
    ("manager_boom", {"wheel": 0}),
    ("manager_boom_feedforward", {}),
]


@pytest.mark.parametrize(("name", "parameters"), SCENARIOS)
@pytest.mark.parametrize("missing", STALE)
def test_what_is_lost_is_not_used_and_the_coils_are_off(name, parameters, missing):
    commands = []
    for stale in (math.nan, 1.0):
        block = step(boom(name, **parameters), h_wheel=(0.02, 0.03, -0.01, 0.0))
        assert any(block.m_cmd_body)
        value = tuple(stale * x for x in getattr(block, VALUES[missing]))
        step(block, 1, **{VALUES[missing]: value, missing: False})
        commands.append(block.tau_cmd_wheel)
        assert not any(block.m_cmd_body)
        assert block.reason == STALE[missing]
        if missing == "valid_omega":
            assert not any(block.tau_cmd_wheel)  # they keep their momentum
        elif parameters.get("wheel") != 0:
            assert any(block.tau_cmd_wheel)  # they hold the rate
        step(
            block,
            2,
            **{VALUES[missing]: tuple(x / stale for x in value), missing: True},
        )
        if not math.isnan(stale):
            assert any(block.m_cmd_body)
    assert commands[0] == commands[1]


@pytest.mark.parametrize(("name", "parameters"), SCENARIOS)
def test_a_momentum_that_is_not_valid_is_not_dumped(name, parameters):
    found = []
    for h in ((math.nan,) * 4, (0.09,) * 4):
        block = step(boom(name, **parameters), 0, h_wheel=h, valid_h=False)
        found.append((block.m_cmd_body, block.tau_cmd_wheel))
        assert block.reason == NO_MOMENTUM
    assert found[0] == found[1]
    assert all(math.isfinite(x) for x in (*found[0][0], *found[0][1]))


def feed(**parameters):
    values = {
        "schedule_start": (20.0, 60.0),
        "schedule_duration": (15.0, 15.0),
        "schedule_tau_body": (0.0, 1.5e-3, 1.5e-3, 0.0, 3e-3, 3e-3),
    }
    block = boom("manager_boom_feedforward", **{**values, **parameters})
    block.q_bi, block.omega_bi_body = (0.0, 0.0, 0.0, 1.0), (0.0, -N, 0.0)
    return block


def test_the_wheels_take_what_the_firing_gives_while_it_gives_it():
    block, blind = feed(), feed(feedforward=False)
    taken = []
    for k in range(6):
        step(block, k)
        step(blind, k)
        taken.append(
            [
                x - y
                for x, y in zip(block.tau_cmd_wheel, blind.tau_cmd_wheel, strict=True)
            ]
        )
    assert taken[1] == [0.0] * 4
    assert taken[2] == pytest.approx([0.0, 1.5e-3, 1.5e-3, 0.0])
    assert block.mode == blind.mode == 1


def fly(block, truth, until=40, noise=0.0, seed=1):
    """Three wheels and a body without gravity, firings as they truly are; its rates."""
    rng = np.random.default_rng(seed)
    omega, h = np.array([0.0, -N, 0.0]), np.zeros(3)
    inertia = np.reshape(J, (3, 3))
    rates = []
    for k in range(until):
        measured = tuple(omega + noise * rng.normal(size=3))
        step(
            block,
            k,
            q_bi=(0.0, 0.0, 0.0, 1.0),
            omega_bi_body=measured,
            h_wheel=(*h, 0.0),
        )
        torque = np.array(block.tau_cmd_wheel[:3])
        for j, (start, lasts) in enumerate(
            zip(block.schedule_start, block.schedule_duration, strict=True)
        ):
            if lasts > 0.0:
                on = firing.overlap(start, lasts, 10.0 * k, 10.0)
                omega = omega + np.linalg.solve(inertia, on * np.array(truth[j]))
        for _ in range(20):
            gyroscopic = cross3(omega, inertia @ omega + h)
            omega = omega - np.linalg.solve(inertia, 0.5 * (torque + gyroscopic))
            h = h + 0.5 * torque
        rates.append(norm(tuple(omega - (0.0, -N, 0.0))))
    return rates


def test_the_attitude_is_carried_on_by_the_rate():
    block, start, omega = feed(attitude_gain=0.0), (0.0, 0.0, 0.0, 1.0), (0.0, -N, 0.0)
    for k in range(2):
        step(block, k, q_bi=start, omega_bi_body=omega, h_wheel=(0.0,) * 4)
    assert block._q == pytest.approx(propagate(start, omega, 10.0), abs=1e-5)


def test_a_firing_teaches_of_the_next_in_proportion_to_its_size():
    truth = ((4e-4, 1.8e-3, 1.2e-3), (8e-4, 3.6e-3, 2.4e-3))
    learnt, dull = [], []
    for learning, into in ((True, learnt), (False, dull)):
        values = {"learning": learning, "gain_dump": (0.0,) * 3}
        values |= {"gain_lean": 0.0, "attitude_gain": 1.0}
        block = feed(schedule_start=(20.0, 660.0), **values)
        into += fly(block, truth, until=70)
        known = block.schedule_tau_body[3:6]
        missed = [
            norm(tuple(x - y for x, y in zip(truth[1], tau, strict=True)))
            for tau in (known, block.tau_firing_body)
        ]
        assert missed[1] < 0.3 * missed[0]
    assert max(learnt[66:]) < 0.3 * max(dull[66:])


def test_a_torque_beyond_the_wheels_is_flown_saturated_and_flagged():
    block = feed(schedule_tau_body=(0.0, 9e-3, 9e-3))
    for k in range(3):
        step(block, k)
    assert block.reason == TORQUE_LIMIT
    assert block.tau_cmd_wheel[1:3] == pytest.approx((5e-3, 5e-3))


def test_gravity_dumps_by_a_lean():
    block = step(feed(gain_dump=(0.0, 0.0, 0.0)), h_wheel=(0.0, 0.05, 0.0, 0.0))
    assert not any(block.m_cmd_body)
    # wanted: a pitch of +lean, where gravity's torque is against h_2
    assert block.tau_cmd_wheel[1] < 0.0
    lean = matrix(propagate((0.0, 0.0, 0.0, 1.0), (0.0, block.lean_limit, 0.0), 1.0))
    assert laws.gravity_vector_torque((lean[2], lean[5], lean[8]), J, N)[1] < 0.0


# --- what is refused ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "parameters", "text"),
    [
        (
            "manager_boom",
            {"wheel": 2, "axes_wheel": ALONG_Y},
            r"wheel = z: axes_wheel has no whe",
        ),
        (
            "manager_boom",
            {"wheel": 2, "axes_wheel": ALONG_Z, "recovery": True},
            "recovery = true: it needs wheel = y",
        ),
        (
            "manager_boom_feedforward",
            {"axes_wheel": ALONG_Z},
            r"wheels = x_y_z: axes_wheel has no wheel along body \(1.0, 0.0, 0.0\)",
        ),
        (
            "manager_boom_feedforward",
            {
                "axes_wheel": THREE,
                "schedule_start": (25.0,),
                "schedule_duration": (30.0,),
            },
            r"schedule_start\[1\] = 25 s: not at a sample, a multiple of sample_time = 10 s",
        ),
        (
            "manager_boom_feedforward",
            {
                "axes_wheel": THREE,
                "schedule_start": (20.0, 40.0),
                "schedule_duration": (30.0, 30.0),
            },
            r"schedule_start\[2\] = 40 s for 30 s overlaps firing 1, from 20 s for 30 s",
        ),
        (
            "manager_boom_feedforward",
            {"inertia": PRINTED},
            r"inertia\[1,2\] = 0 and inertia\[2,1\] = -0.25 kg m2: they must be equal",
        ),
        (
            "thrusters_misaligned",
            {"schedule_start": (20.0, 40.0), "schedule_duration": (30.0, 30.0)},
            r"schedule_start\[2\] = 40 s for 30 s overlaps firing 1",
        ),
        (
            "spacecraft_rigid",
            {"inertia": PRINTED},
            r"inertia\[1,2\] = 0 and inertia\[2,1\] = ",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(name, parameters, text):
    with pytest.raises(BlockError, match=text):
        boom(name, **parameters) if name.startswith("manager") else begin_with(
            name, parameters
        )


def test_table_5_as_printed_is_refused_by_name_and_the_resolved_one_is_named(tmp_path):
    rows = [list(PRINTED[i : i + 3]) for i in (0, 3, 6)]
    file = tmp_path / "mine.toml"
    file.write_text(f'extends = "alsat1/firing-z-wheel"\n[shared]\ninertia = {rows}\n')
    system, schedule = prepare(str(file), Options(blocks=True)).or_raise()
    (line,) = explain(
        system, "\n".join(trial_initialisation.refusals(system, schedule)[0])
    )
    text = "inertia[1,2] = 0 and inertia[2,1] = -0.25 kg m2: they must be equal"
    assert line.startswith(f"{file}: shared.inertia: spacecraft: {text}")
    flight = find("alsat1/open-loop-z-products").content.written
    assert tuple(np.ravel(flight["shared"]["inertia"])) == J
    assert str(flight["shared"]["inertia"]) in flight["paper"]["pitch"]["remark"]


def begin_with(name, parameters):
    block = fresh(name)
    for key, value in parameters.items():
        size = next(v for v in block.variables if v.name == key).size
        setattr(block, key, (*value, *(0.0,) * (size - len(value))))
    return begin(block)


def test_an_inertia_is_that_of_a_body():
    check_inertia(J)
    check_inertia(
        (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 2.0)
    )  # a disc without thickness
    with pytest.raises(BlockError, match="no body has it"):
        check_inertia((1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 2.1))
    turned = np.linalg.qr(np.array([[1.0, 2, 3], [0, 1, 4], [5, 6, 0]]))[0]
    for moments, right in (((3.0, 4.0, 6.9), True), ((3.0, 4.0, 7.1), False)):
        tensor = tuple((turned @ np.diag(moments) @ turned.T).ravel())
        if right:
            check_inertia(tensor)
        else:
            with pytest.raises(BlockError, match="no body has it"):
                check_inertia(tensor)
    with pytest.raises(BlockError, match="principal moments must be above 0"):
        check_inertia((1.0, 2.0, 0.0, 2.0, 1.0, 0.0, 0.0, 0.0, 1.0))


def test_a_firing_that_is_not_as_known():
    block = begin_with(
        "thrusters_misaligned",
        {
            "schedule_start": (2.5, 20.0),
            "schedule_duration": (3.25, 1.0),
            "schedule_tau_body": (0.0, 1e-3, 0.0, 1e-3),
            "schedule_scale_error": (0.0, -0.5),
            "turn_body": (math.pi / 2.0, 0.0, 0.0),
        },
    )
    block.scale_error = 0.2
    begin(block)
    turn = np.zeros(3)
    for k in range(22):
        block.advance(float(k), 1.0)
        turn += block.tau_mean_thruster_body
    # 1.2e-3 N m about y, turned to z, for 3.25 s whose edges fall inside steps; half of it about x
    assert turn == pytest.approx([0.6e-3, 0.0, 1.2e-3 * 3.25], rel=1e-12, abs=1e-18)


# --- measures -------------------------------------------------------------------------


def test_measures_of_settling_and_growth():
    times = np.arange(0.0, 50.0, 10.0)
    angles = np.array([[0.0, 9.0], [3.0, 1.0], [-2.0, 7.0], [2.6, 0.0], [0.0, 0.0]])
    options = {"limits": [2.5, 8.0], "since": 10.0, "period": 10.0}
    assert measures.settled_within(times, angles, **options) == 3.0
    assert measures.settled_within(times[:3], angles[:3] * 0.1, **options) == 0.0
    assert math.isnan(measures.settled_within(times[:4], angles[:4], **options))
    assert measures.mean_rate(times, angles[:, :1] + 2.0 * times[:, None]) == 2.0


def test_angles_from_lvlh_are_those_from_a_reference():
    r, v = np.array([[7e6, 1e5, 0.0]]), np.array([[0.0, 1e3, 7.4e3]])
    z = -r / np.linalg.norm(r)
    y = -np.cross(r, v) / np.linalg.norm(np.cross(r, v))
    from scipy.spatial.transform import Rotation

    lvlh = Rotation.from_matrix(np.stack([np.cross(y, z), y, z], axis=2))
    q = (lvlh * Rotation.from_euler("YXZ", [10.0, -3.0, 70.0], degrees=True)).as_quat()
    assert derived.euler_lvlh(q, r, v, "213")[0] == pytest.approx([10.0, -3.0, 70.0])


# --- runs -----------------------------------------------------------------------------

NEAR = [
    "shared.schedule_start=100,0,0,0,0,0,0,0",
    "shared.schedule_duration=30,0,0,0,0,0,0,0",
]


@cache
def run(name, **options):
    run_options = {"blocks": True, **options}
    run_options["sets"] = list(run_options.get("sets", ()))
    found = execute(f"alsat1/{name}", Options(**run_options))
    assert found.ok, found.manifest["message"]
    return found


@pytest.mark.parametrize(
    ("name", "number", "expected"),
    [
        ("impulse", "yaw_rate", 0.516),
        ("y", "pitch", 9.7),
        ("z", "roll", 8.4),
        ("z", "pitch", 1.6),
    ],
)
def test_what_the_given_data_alone_decide(name, number, expected):
    numbers = run(f"open-loop-{name}", record=RECORDED).manifest["numbers"]
    assert numbers[number]["value"] == pytest.approx(expected, rel=0.02)


RECORDED = (
    "spacecraft.q_bi",
    "spacecraft.omega_bi_body",
    "environment.r_eci",
    "environment.v_eci",
)


def test_open_loop_analytically():
    rate = 0.0015 * 30.0 / 5.0
    assert math.degrees(rate) == pytest.approx(0.516, rel=1e-3)
    roll = 5e-6 * 30.0 / 153.0 / (math.sqrt(4.0 * 148.0 / 153.0) * N)
    x = run("open-loop-x", record=RECORDED).manifest["numbers"]["roll"]["value"]
    assert x == pytest.approx(math.degrees(roll), rel=0.02)


@pytest.mark.parametrize("name", ["firing-z-wheel", "firing-y-wheel", "firing-ours"])
def test_fmus_give_the_bits_of_the_blocks_with_and_without_step_ratios(name, tmp_path):
    options = {"stop": 200.0, "sets": tuple(NEAR)}
    one, other = run(name, **options), run(name, blocks=False, **options)
    undecimated = tmp_path / "all.toml"
    undecimated.write_text(
        f'extends = "alsat1/{name}"\nwithout = ["step_ratio"]\n', encoding="utf-8"
    )
    third = execute(str(undecimated), Options(blocks=True, stop=200.0, sets=list(NEAR)))
    series = [n for n in one.results.names() if n.startswith("spacecraft.")]
    assert series
    for name_ in series:
        assert np.array_equal(one.results.values(name_), other.results.values(name_)), (
            name_
        )
        assert np.array_equal(one.results.values(name_), third.results.values(name_)), (
            name_
        )


def test_momentum_adds_up_and_the_impulse_of_a_firing_is_exact():
    found = run("firing-ours", stop=200.0, sets=tuple(NEAR))
    numbers = {k: n["value"] for k, n in found.manifest["numbers"].items()}
    assert numbers["momentum_residual"] <= 1e-12 * 0.06
    assert found.results.values("thrusters.schedule_on_time")[-1] == pytest.approx(
        30.0, 1e-12
    )
    assert not numbers["wheel_saturated"]
    inside = (
        "shared.schedule_start=100.3,0,0,0,0,0,0,0",
        "shared.schedule_duration=29.45,0,0,0,0,0,0,0",
    )
    found = run("firing-z-wheel", stop=140.0, sets=inside)
    impulse = found.results.values("thrusters.tau_mean_thruster_body").sum(axis=0)
    assert impulse == pytest.approx(
        [29.45 * x for x in (5e-6, 1.5e-3, 1.5e-3)], rel=1e-12
    )
    assert found.manifest["numbers"]["momentum_residual"]["value"] <= 1e-12 * 0.16


def test_elements_without_a_name_are_not_drawn():
    plots = find("alsat1/firing-ours").content.plots
    results = run("firing-ours", stop=200.0, sets=tuple(NEAR)).results
    names = {
        k: [x.name for x in lines_of(plots[k], results, plots[k].unit)]
        for k in ("yaw", "tilt", "momentum")
    }
    assert names == {
        "yaw": ["yaw"],
        "tilt": ["pitch", "roll"],
        "momentum": ["x", "y", "z"],
    }


def test_three_wheels_keep_the_craft_where_the_z_wheel_does_not():
    yaw = {}
    for name in ("firing-ours", "firing-z-wheel"):
        found = run(name, stop=200.0, sets=tuple(NEAR)).results
        angles = derived.euler_lvlh(
            *(
                found.values(s)
                for s in ("spacecraft.q_bi", "environment.r_eci", "environment.v_eci")
            ),
            "213",
        )
        rates = found.values("spacecraft.omega_bi_body")[:, 2]
        yaw[name] = abs(rates[131:] - rates[99]).max()
        assert len(angles) == 201
    assert yaw["firing-z-wheel"] > math.radians(0.35)
    assert yaw["firing-ours"] < 0.02 * 0.009 + 0.004


def test_another_manager_swaps_in_by_its_source():
    """Its law is flown: the z wheel takes the firing's 1.5 mN m while it lasts, so that
    the craft turns less than a tenth as fast about z; what it does not take of the
    craft's own is said."""
    swapped = execute(
        "alsat1/firing-z-wheel",
        Options(
            blocks=True,
            stop=160.0,
            sources=["manager=manager_boom_feedforward"],
            sets=["manager.wheels=z", *NEAR],
        ),
    )
    assert swapped.ok
    plain = run("firing-z-wheel", stop=160.0, sets=tuple(NEAR))
    mode = swapped.results.values("manager.mode")
    assert mode.tolist() == [1] * 100 + [2] * 30 + [1] * (len(mode) - 130)
    torque = swapped.results.values("manager.tau_cmd_wheel")[:, 0]
    assert torque[100:130] == pytest.approx(1.5e-3, rel=0.1)
    assert np.abs(torque[[*range(90, 100), *range(130, 140)]]).max() < 0.5e-3
    rates = [
        r.results.values("spacecraft.omega_bi_body")[:, 2] for r in (swapped, plain)
    ]
    turned = [np.abs(rate[100:] - rate[99]).max() for rate in rates]
    assert turned[0] < 0.1 * turned[1]
    (messages,) = [w for w in swapped.manifest.warnings if "does not take" in w]
    assert "manager_boom_feedforward does not take wheel, gain_dump, kp, kd" in messages


def test_schedules_that_differ_are_a_warning():
    """What runs onboard may err about the firings; both are named."""
    case = prepare(
        "alsat1/firing-ours",
        Options(blocks=True, sets=["thrusters.schedule_start=50,0,0,0,0,0,0,0"]),
    )
    case.or_raise()
    [line] = [w for w in case.warnings if "schedule_start" in w]
    assert "manager" in line
    assert "thrusters" in line


def test_a_firing_that_lasts_beyond_the_run_is_said():
    for stop, message in ((110.0, 1), (130.0, 0), (100.0, 0)):
        case = prepare(
            "alsat1/firing-z-wheel", Options(blocks=True, stop=stop, sets=list(NEAR))
        )
        lines = [x for x in case.warnings if "beyond the run's end" in x]
        assert len(lines) == message
    text = r"thrusters.schedule_duration[1] = 30 s from 100 s on: it lasts beyond the run's end at"
    case = prepare(
        "alsat1/firing-z-wheel", Options(blocks=True, stop=110.0, sets=list(NEAR))
    )
    assert any(text in x for x in case.warnings)


def test_a_torque_that_the_wheels_cannot_take_is_said():
    tau = ",".join(["0", "0", "9e-3", *["0"] * 21])
    case = prepare(
        "alsat1/firing-ours",
        Options(blocks=True, sets=[f"shared.schedule_tau_body={tau}"]),
    )
    text = (
        "manager.schedule_tau_body[1,3] = 0.009 N m: more than torque_limit = 0.005 N m"
    )
    assert [x for x in case.warnings if text in x]


# --- stored runs and draws ------------------------------------------------------------


def test_momentum_adds_up_in_every_run():
    """Each scenario whole: `python -m benchmarks.residuals`."""
    found = json.loads(stored.file_of("alsat1").with_name("residuals.json").read_text())
    assert set(found["runs"]) == set(scenarios("alsat1"))
    assert max(r["share"] for r in found["runs"].values()) <= 1e-12


def test_stored_draws_are_of_scenarios_that_there_are():
    assert set(stored.read("alsat1")["scenarios"]) <= set(stored.with_draws("alsat1"))


def test_it_packs():
    assert pack_scenario(find("alsat1/firing-ours")).suffix == ".ssp"
