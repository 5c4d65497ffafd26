"""Guidance and attitude control: kinematics, the laws against transcriptions, closed
loops."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from desat.components.laws import attitude_control
from desat.components.maths import attitude
from desat.components.physics import orbit
from tests.conftest import cross3
from tests.contract.test_block import begin, fresh

TURN = attitude.normalise((0.3, -0.5, 0.2, 0.8))


def block(name, **values):
    new_block = fresh(name)
    for key, value in values.items():
        assert hasattr(new_block, key)
        setattr(new_block, key, value)
    return begin(new_block)


def make_rotation(axis, degrees):
    """The quaternion of a rotation about an axis."""
    half = math.radians(degrees) / 2
    n = math.sqrt(sum(x * x for x in axis))
    return (*(math.sin(half) * x / n for x in axis), math.cos(half))


def rate_of(before, now, after, h):
    """omega from q' = 1/2 (omega, 0) (x) q, by central differences over 2 h."""
    q = [np.array(x) * math.copysign(1, np.dot(x, now)) for x in (before, after)]
    slope = tuple((q[1] - q[0]) / (2 * h))
    return tuple(2 * x for x in attitude.product(slope, attitude.inverse(now))[:3])


def random_quaternion(rng):
    return attitude.normalise(tuple(float(x) for x in rng.normal(size=4)))


def random_vector(rng, size=1.0):
    return tuple(float(x) for x in size * rng.normal(size=3))


# --- guidance -------------------------------------------------------------------------


def two_body(r, v):
    """Position and velocity (m, m/s) on a Kepler orbit as a function of time (s)."""

    def slope(t, y):
        return np.concatenate([y[3:], -orbit.MU * y[:3] / np.linalg.norm(y[:3]) ** 3])

    solution = solve_ivp(
        slope,
        (-10.0, 9000.0),
        np.concatenate([r, v]),
        method="DOP853",
        rtol=1e-12,
        atol=1e-6,
        dense_output=True,
    ).sol

    def state(t):
        y = solution(t) if t > -10.0 else None
        return tuple(map(float, y[:3])), tuple(map(float, y[3:]))

    return state


@pytest.mark.parametrize("stretch", [1.0, 1.1], ids=["circular", "elliptic"])
@pytest.mark.parametrize(
    "q_bo", [(0.0, 0.0, 0.0, 1.0), TURN], ids=["aligned", "offset"]
)
def test_nadir_rate_is_the_derivative_of_the_attitude(stretch, q_bo):
    r0 = 7.0e6
    speed = stretch * math.sqrt(orbit.MU / r0)
    c, s = math.cos(1.1), math.sin(1.1)
    orbiting = two_body((r0, 0.0, 0.0), (0.0, speed * c, speed * s))
    guidance = block("guidance_nadir", q_bo=q_bo)
    rates = []
    for t in np.linspace(10.0, 8900.0, 60):
        h, q = 0.5, []
        for moment in (t - h, t + h, t):
            guidance.r_eci, guidance.v_eci = orbiting(moment)
            guidance.advance(moment, 1.0)
            q.append(guidance.q_ref_bi)
        rate = rate_of(q[0], q[2], q[1], h)
        assert guidance.omega_ref_body == pytest.approx(rate, abs=3e-10)
        rates.append(math.dist(guidance.omega_ref_body, (0, 0, 0)))
    if stretch == 1.0:
        assert rates == pytest.approx([orbit.mean_motion(r0)] * 60, rel=1e-8)
    else:
        assert max(rates) / min(rates) > 2


def test_nadir_points_the_bodys_axis_down():
    r, v = (0.0, 7.0e6, 0.0), (-7.5e3, 0.0, 0.0)
    guidance = block("guidance_nadir", r_eci=r, v_eci=v)
    assert attitude.rotate(guidance.q_ref_bi, (0, -1, 0)) == pytest.approx(
        (0, 0, 1), abs=1e-15
    )
    assert attitude.rotate(guidance.q_ref_bi, (-1, 0, 0)) == pytest.approx(
        (1, 0, 0), abs=1e-15
    )
    assert guidance.omega_ref_body == pytest.approx((0, -7.5e3 / 7.0e6, 0), abs=1e-18)
    # upside down about the velocity: z away from the Earth, rate about +y
    guidance = block("guidance_nadir", r_eci=r, v_eci=v, q_bo=(2.0, 0.0, 0.0, 0.0))
    assert attitude.rotate(guidance.q_ref_bi, (0, 1, 0)) == pytest.approx(
        (0, 0, 1), abs=1e-15
    )
    assert guidance.omega_ref_body == pytest.approx((0, 7.5e3 / 7.0e6, 0), abs=1e-18)


def test_nadir_quaternion_has_no_jumps():
    r0 = 7.0e6
    n = orbit.mean_motion(r0)
    guidance = block("guidance_nadir")
    last = guidance.q_ref_bi
    for k in range(2000):
        u = 0.01 * k
        guidance.r_eci = (r0 * math.cos(u), r0 * math.sin(u), 0.0)
        guidance.v_eci = (-r0 * n * math.sin(u), r0 * n * math.cos(u), 0.0)
        guidance.advance(float(k), 1.0)
        assert math.dist(guidance.q_ref_bi, last) < 0.0051
        last = guidance.q_ref_bi


def test_guidance_is_sampled():
    guidance = block("guidance_nadir", sample_time=10.0)
    guidance.advance(0.0, 1.0)
    first_reference = guidance.q_ref_bi
    guidance.r_eci = (0.0, 7.0e6, 1.0e6)
    guidance.advance(9.0, 1.0)
    assert guidance.q_ref_bi == first_reference
    guidance.advance(10.0, 1.0)
    assert guidance.q_ref_bi != first_reference


def test_inertial_reference_rests():
    guidance = block("guidance_inertial", q_target_bi=(0.0, 3.0, 0.0, 4.0))
    guidance.advance(0.0, 1.0)
    assert guidance.q_ref_bi == pytest.approx((0.0, 0.6, 0.0, 0.8))
    assert guidance.omega_ref_body == (0.0, 0.0, 0.0)


SLEW = {
    "q_begin_bi": TURN,
    "q_end_bi": (0.5, 0.5, -0.5, 0.5),
    "t_begin": 100.0,
    "t_end": 5500.0,
}


def slew_at(guidance, t):
    guidance.advance(t, 1.0)
    return guidance.q_ref_bi, guidance.omega_ref_body


def test_slew_ends_where_it_should_and_rests_there():
    guidance = block("guidance_slew", **SLEW)
    for t in (0.0, 100.0):
        q, omega = slew_at(guidance, t)
        assert q == pytest.approx(TURN, abs=1e-15)
        assert omega == (0.0, 0.0, 0.0)
    for t in (5500.0, 9000.0):
        q, omega = slew_at(guidance, t)
        assert attitude.error_angle(q, SLEW["q_end_bi"]) < 1e-14
        assert omega == (0.0, 0.0, 0.0)
    angle = attitude.error_angle(SLEW["q_end_bi"], TURN)
    for t in (
        101.0,
        5499.0,
    ):  # the rate begins and ends with the square of time: no acceleration
        _, omega = slew_at(guidance, t)
        assert math.dist(omega, (0, 0, 0)) == pytest.approx(
            30 * angle / 5400**3, rel=1e-3
        )


def test_slew_rate_is_the_derivative_of_the_attitude():
    guidance = block("guidance_slew", **SLEW)
    h, largest = 0.5, 0.0
    for t in np.linspace(50.0, 5550.0, 221):
        q = [slew_at(guidance, t + d)[0] for d in (-h, h, 0.0)]
        rate = rate_of(q[0], q[2], q[1], h)
        assert guidance.omega_ref_body == pytest.approx(rate, abs=1e-10)
        largest = max(largest, math.dist(guidance.omega_ref_body, (0, 0, 0)))
    angle = attitude.error_angle(SLEW["q_end_bi"], TURN)
    assert largest == pytest.approx(15 / 8 * angle / 5400, rel=1e-3)


def test_slew_turns_about_one_axis_the_short_way():
    angle = attitude.error_angle(SLEW["q_end_bi"], TURN)
    for sign in (1, -1):
        q_end = tuple(sign * x for x in SLEW["q_end_bi"])
        guidance = block("guidance_slew", **{**SLEW, "q_end_bi": q_end})
        q, omega = slew_at(guidance, 2800.0)
        assert attitude.error_angle(q, TURN) == pytest.approx(angle / 2, abs=1e-13)
        assert attitude.error_angle(q, SLEW["q_end_bi"]) == pytest.approx(
            angle / 2, abs=1e-13
        )
        _, early = slew_at(guidance, 1000.0)
        assert np.cross(omega, early) == pytest.approx(0, abs=1e-20)


def test_a_slew_as_a_rotation_vector_is_the_one_to_where_it_leads():
    axis, angle = attitude_control.eigenaxis(TURN, SLEW["q_end_bi"])
    by_vector = block(
        "guidance_slew",
        q_begin_bi=TURN,
        t_begin=100.0,
        t_end=5500.0,
        slew_body=tuple(angle * x for x in axis),
    )
    by_end = block("guidance_slew", **SLEW)
    for t in (0.0, 2000.0, 5500.0):
        assert slew_at(by_vector, t) == slew_at(by_end, t)
    manager = block(
        "manager_open_loop",
        manoeuvre=True,
        slew_body=by_vector.slew_body,
        q_begin_bi=TURN,
    )
    assert manager._rotation == by_end._rotation


def test_slew_to_where_it_is():
    guidance = block("guidance_slew", q_begin_bi=TURN, q_end_bi=TURN)
    q, omega = slew_at(guidance, 2700.0)
    assert q == pytest.approx(TURN, abs=1e-15)
    assert math.dist(omega, (0, 0, 0)) < 1e-18


@pytest.mark.parametrize(
    ("name", "values", "text"),
    [
        ("guidance_inertial", {"q_target_bi": (0.0,) * 4}, "q_target_bi is zero"),
        ("guidance_nadir", {"q_bo": (0.0,) * 4}, "q_bo is zero"),
        ("guidance_slew", {"q_end_bi": (0.0,) * 4}, "q_end_bi is zero"),
        (
            "guidance_slew",
            {"t_begin": 10.0, "t_end": 10.0},
            "t_end = 10.0 s must be after",
        ),
    ],
)
def test_senseless_references_are_refused(name, values, text):
    with pytest.raises(ValueError, match=text):
        block(name, **values)


# --- control laws ---------------------------------------------------------------------


def hamilton(p, q):
    """Hamilton product, scalar first."""
    a, u, b, v = p[0], p[1:], q[0], q[1:]
    return np.concatenate([[a * b - u @ v], a * v + b * u + cross3(u, v)])


def test_pid_is_the_gyrostats_controller():
    """tau on the wheels = clip(2 kp e + kd omega + ki xi, limit), e of q_ref^-1 * q
    with the scalar made >= 0, xi = clip(xi + Ts e, 0.5): Hamilton products, scalar
    first."""
    kp, kd, ki, limit, ts = 0.4, 5.6, 0.004, 0.02, 1.0
    axis = np.array([0.6, -0.64, 0.48])
    q_ref = np.concatenate(
        [[math.cos(math.radians(15))], math.sin(math.radians(15)) * axis]
    )
    controller = block(
        "controller_pid",
        kp=2 * kp,
        kd=kd,
        ki=ki,
        torque_limit=limit,
        integral_limit=0.5,
        sample_time=ts,
        q_ref_bi=tuple(map(float, (*q_ref[1:], q_ref[0]))),
    )
    rng = np.random.default_rng(3)
    xi, cut_count, largest = np.zeros(3), 0, 0.0
    for k in range(3000):
        # small errors, which do not saturate, and any attitude by turns
        spread = 10.0 ** rng.uniform(-4, 1)
        near = np.concatenate([[1.0], spread * rng.normal(size=3)])
        q = hamilton(q_ref, near / np.linalg.norm(near)) * rng.choice([-1, 1])
        omega = random_vector(rng, spread * 1e-3)
        error = hamilton(q_ref * [1, -1, -1, -1], q)
        e = error[1:] * (1 if error[0] >= 0 else -1)
        xi = np.clip(xi + ts * e, -0.5, 0.5)
        command = 2 * kp * e + kd * np.array(omega) + ki * xi
        tau_wheels = np.clip(command, -limit, limit)
        controller.q_bi = tuple(map(float, (*q[1:], q[0])))
        controller.omega_bi_body = omega
        controller.advance(k * ts, ts)
        assert np.abs(tau_wheels + controller.tau_ctrl_body).max() < 1e-15
        cut_count += (command != tau_wheels).any()
        largest = max(largest, np.abs(xi).max())
    assert 500 < cut_count < 2900
    assert largest == 0.5


@pytest.mark.parametrize("name", ["controller_pd", "controller_pid"])
def test_law_against_matrices(name):
    """Eqs. 7, 8, 10, 11 with rotation matrices: e from the skew part of C(q) C(q_ref)'."""
    rng = np.random.default_rng(4)
    for _ in range(200):
        gain = rng.normal(size=(3, 3))
        values = {"kp": 0.3, "kd": 0.7, "gain_matrix": tuple(map(float, gain.ravel()))}
        if name == "controller_pid":
            values |= {"ki": 0.1}
        q, q_ref = random_quaternion(rng), random_quaternion(rng)
        omega, omega_ref = random_vector(rng), random_vector(rng)
        controller = block(
            name,
            **values,
            sample_time=2.0,
            q_bi=q,
            q_ref_bi=q_ref,
            omega_bi_body=omega,
            omega_ref_body=omega_ref,
        )
        controller.advance(0.0, 1.0)
        c, c_ref = (np.reshape(attitude.matrix(x), (3, 3)) for x in (q, q_ref))
        dc = c @ c_ref.T
        angle = attitude.error_angle(q, q_ref)
        skew = (
            np.array([dc[1, 2] - dc[2, 1], dc[2, 0] - dc[0, 2], dc[0, 1] - dc[1, 0]])
            / 2
        )
        e = skew / (2 * math.cos(angle / 2))
        law = 0.3 * e + 0.7 * (np.array(omega) - dc @ omega_ref)
        if name == "controller_pid":
            law += 0.1 * 2.0 * e
        assert controller.tau_ctrl_body == pytest.approx(-gain @ law, abs=1e-11)


def test_the_torque_turns_the_body_back():
    controller = block(
        "controller_pd", kp=2.0, kd=3.0, q_bi=make_rotation((0, 0, 1), 1.0)
    )
    controller.advance(0.0, 1.0)
    # turned too far about +z: torque about -z, kp times half the angle
    assert controller.tau_ctrl_body == pytest.approx(
        (0, 0, -math.radians(1.0)), rel=2e-5
    )
    controller = block("controller_pd", kp=2.0, kd=3.0, omega_bi_body=(0.0, 0.1, 0.0))
    controller.advance(0.0, 1.0)
    assert controller.tau_ctrl_body == pytest.approx((0, -0.3, 0))


@pytest.mark.parametrize("name", ["controller_pd", "controller_pid"])
def test_on_its_reference_there_is_no_torque_at_any_attitude(name):
    """The body moves as the reference does, 120 deg of roll included: nothing to
    correct."""
    rng = np.random.default_rng(5)
    for _ in range(50):
        q, omega = random_quaternion(rng), random_vector(rng)
        controller = block(
            name, q_bi=q, q_ref_bi=q, omega_bi_body=omega, omega_ref_body=omega
        )
        controller.advance(0.0, 1.0)
        assert controller.tau_ctrl_body == pytest.approx((0, 0, 0), abs=1e-15)


def test_a_reference_rate_is_the_same_vector_seen_from_the_body():
    """Off by 90 deg about x, turning with the reference in inertial space: no rate
    error."""
    dq, omega_ref = make_rotation((1, 0, 0), 90), (0.0, -1e-3, 0.0)
    q = attitude.product(dq, TURN)
    _, d_omega = attitude_control.tracking_error(q, (0.0, 0.0, 1e-3), TURN, omega_ref)
    assert d_omega == pytest.approx((0, 0, 0), abs=1e-18)


@pytest.mark.parametrize("name", ["controller_pd", "controller_pid"])
def test_no_unwinding(name):
    """q and -q are one attitude and give one torque; so do q_ref and -q_ref."""
    rng = np.random.default_rng(6)
    for _ in range(100):
        q, q_ref, omega = (
            random_quaternion(rng),
            random_quaternion(rng),
            random_vector(rng),
        )
        torques = []
        for s, s_ref in ((1, 1), (-1, 1), (1, -1), (-1, -1)):
            controller = block(
                name,
                q_bi=tuple(s * x for x in q),
                q_ref_bi=tuple(s_ref * x for x in q_ref),
                omega_bi_body=omega,
            )
            controller.advance(0.0, 1.0)
            controller.advance(1.0, 1.0)
            torques.append(controller.tau_ctrl_body)
        assert torques == [torques[0]] * 4


def test_half_a_turn_is_no_equilibrium():
    controller = block("controller_pd", kp=1.0, q_bi=(0.0, 1.0, 0.0, 0.0))
    controller.advance(0.0, 1.0)
    assert controller.tau_ctrl_body == pytest.approx((0, -1, 0))


@pytest.mark.parametrize("name", ["controller_pd", "controller_pid"])
def test_torque_limit(name):
    values = {"kp": 1.0, "q_bi": make_rotation((1, -0.01, 0.0), 60)}
    free = block(name, **values)
    free.advance(0.0, 1.0)
    x, y, z = free.tau_ctrl_body
    limited_block = block(name, **values, torque_limit=0.02)
    limited_block.advance(0.0, 1.0)
    assert abs(x) > 0.4
    assert limited_block.tau_ctrl_body == (-0.02, y, z)


def integral(controller):
    """The torque of the integral alone, in units of ki."""
    return tuple(-x for x in controller.tau_ctrl_body)


ONLY_INTEGRAL = {
    "kp": 0.0,
    "kd": 0.0,
    "ki": 1.0,
    "q_bi": make_rotation((0, 0, 1), 60),
}  # e = (0, 0, 0.5)


@pytest.mark.parametrize(("sample_time", "dt"), [(0.0, 0.5), (2.0, 0.5), (2.0, 2.0)])
def test_integral_advances_before_use_and_stops_at_its_limit(sample_time, dt):
    controller = block(
        "controller_pid", **ONLY_INTEGRAL, sample_time=sample_time, integral_limit=3.2
    )
    period = sample_time or dt
    for k in range(40):
        controller.advance(k * dt, dt)
        samples = math.floor(k * dt / period + 1e-6) + 1
        assert integral(controller) == pytest.approx(
            (0, 0, min(0.5 * period * samples, 3.2))
        )


def test_integral_leaves_its_limit_at_once():
    controller = block("controller_pid", **ONLY_INTEGRAL, integral_limit=1.0)
    for k in range(10):
        controller.advance(float(k), 1.0)
    controller.q_bi = make_rotation((0, 0, 1), -60)
    controller.advance(10.0, 1.0)
    assert integral(controller) == pytest.approx((0, 0, 0.5))


@pytest.mark.parametrize("name", ["controller_pd", "controller_pid"])
def test_disabled_there_is_no_torque_and_the_integral_is_reset(name):
    def run(*switches):
        controller = block(
            name, q_bi=make_rotation((0, 0, 1), 60), omega_bi_body=(0.1, 0.0, 0.0)
        )
        torques = []
        for k, on in enumerate(switches):
            controller.enable = on
            controller.advance(float(k), 1.0)
            torques.append(controller.tau_ctrl_body)
        return torques

    a = run(True, True, False, True, True)
    assert a[2] == (0.0, 0.0, 0.0)
    assert a[3:] == a[:2]
    assert (a[0] == a[1]) == (name == "controller_pd")


def test_anti_windup_holds_the_integral_while_torque_is_cut():
    values = {"kp": 1.0, "kd": 0.0, "ki": 0.1, "torque_limit": 0.3, "anti_windup": True}
    controller = block("controller_pid", **values, q_bi=make_rotation((0, 0, 1), 60))
    for k in range(50):
        controller.advance(float(k), 1.0)
        assert controller.tau_ctrl_body == (0.0, 0.0, -0.3)
    controller.q_bi = make_rotation((0, 0, 1), 0.2)
    controller.advance(50.0, 1.0)
    e = math.sin(math.radians(0.1))
    assert controller.tau_ctrl_body[2] == pytest.approx(-(e + 0.1 * e), abs=1e-15)


def test_anti_windup_lets_the_integral_shrink():
    values = {
        "kp": 10.0,
        "kd": 0.0,
        "ki": 0.1,
        "torque_limit": 1.0,
        "anti_windup": True,
    }
    controller = block("controller_pid", **values, q_bi=make_rotation((0, 0, 1), 2))
    for k in range(50):
        controller.advance(float(k), 1.0)
    e = math.sin(math.radians(1))
    assert controller.tau_ctrl_body[2] == pytest.approx(-(10 + 5) * e)
    controller.q_bi = make_rotation((0, 0, 1), -60)  # cut now, on the other side
    controller.advance(50.0, 1.0)
    assert controller.tau_ctrl_body == (0.0, 0.0, 1.0)
    controller.q_bi = (0.0, 0.0, 0.0, 1.0)
    controller.advance(51.0, 1.0)
    assert controller.tau_ctrl_body[2] == pytest.approx(-0.1 * (50 * e - 0.5))


# --- closed loops ---------------------------------------------------------------------

J = np.array([[0.12, 0.01, -0.005], [0.01, 0.1, 0.004], [-0.005, 0.004, 0.06]])


def closed_loop(
    controller, q, omega, duration, step=1.0, guide=None, load=(0.0, 0.0, 0.0)
):
    """A rigid body under the controller, its torque held over each step; (q, omega) of
    each."""
    rows = [(q, omega)]
    for k in range(round(duration / step)):
        if guide:
            controller.q_ref_bi, controller.omega_ref_body = guide(k * step)
        controller.q_bi, controller.omega_bi_body = q, omega
        controller.advance(k * step, step)
        torque = np.array(controller.tau_ctrl_body) + load

        def slope(t, y, torque=torque):
            w = y[4:]
            dq = attitude.product((*(0.5 * w), 0.0), tuple(y[:4]))
            return np.concatenate([dq, np.linalg.solve(J, torque - cross3(w, J @ w))])

        y = solve_ivp(slope, (0, step), [*q, *omega], rtol=1e-8, atol=1e-11).y[:, -1]
        q = attitude.normalise(tuple(map(float, y[:4])))
        omega = tuple(map(float, y[4:]))
        rows.append((q, omega))
    return rows


INERTIA = tuple(map(float, J.ravel()))


def test_pid_settles_from_90_degrees_and_bears_a_load():
    """The default gains (beta = 1e-2) with the inertia as gain matrix, a constant load
    of 1e-6 N m: the integral takes it off (its rate ki / kp is 2e-3 1/s)."""
    load = np.array([1e-6, -1e-6, 5e-7])
    limit = {"controller_pd": {}, "controller_pid": {"integral_limit": 1.5}}
    q0 = make_rotation((1, 2, -1), 90)
    angles = {}
    for name in ("controller_pd", "controller_pid"):
        controller = block(name, gain_matrix=INERTIA, sample_time=1.0, **limit[name])
        rows = closed_loop(controller, q0, (0.0, 0.0, 0.0), 1500, load=load)
        angles[name] = [
            math.degrees(attitude.error_angle(q, (0, 0, 0, 1))) for q, _ in rows
        ]
        assert angles[name][120] < 1
        assert np.linalg.norm(rows[-1][1]) < 1e-6
    # what a PD leaves: J kp e = load, e half the angle
    remaining = math.degrees(2 * np.linalg.norm(np.linalg.solve(J, load)) / 1e-2)
    assert angles["controller_pd"][-1] == pytest.approx(remaining, rel=1e-2)
    assert angles["controller_pid"][-1] < 0.1 * remaining


def test_pid_goes_the_short_way():
    controller = block(
        "controller_pid", gain_matrix=INERTIA, sample_time=1.0, integral_limit=1.0
    )
    q0 = tuple(
        -x for x in make_rotation((1, 0, 0), 90)
    )  # scalar < 0: unwinding would turn by 270 deg
    rows = closed_loop(controller, q0, (0.0, 0.0, 0.0), 200)
    angles = [attitude.error_angle(q, (0, 0, 0, 1)) for q, _ in rows]
    assert max(angles) < math.radians(90.1)
    assert angles[-1] < math.radians(1)


def test_pd_tracks_a_slew_of_the_guidance():
    """Without an acceleration reference a PD lags by alpha / kp, without a rate
    reference by kd omega / kp as well; e is half the angle. The quintic's peaks are
    10/sqrt(3) and 15/8."""
    slew = {"q_begin_bi": TURN, "q_end_bi": (0.5, 0.5, -0.5, 0.5), "t_end": 600.0}
    guidance = block("guidance_slew", **slew)

    def with_rate(t):
        return slew_at(guidance, t)

    def without_rate(t):
        return slew_at(guidance, t)[0], (0.0, 0.0, 0.0)

    worst = []
    for guide in (with_rate, without_rate):
        controller = block("controller_pd", gain_matrix=INERTIA, sample_time=1.0)
        rows = closed_loop(controller, TURN, (0.0, 0.0, 0.0), 700, guide=guide)
        errors = [
            attitude.error_angle(rows[k][0], guide(float(k))[0]) for k in range(701)
        ]
        worst.append(math.degrees(max(errors)))
        assert errors[-1] < math.radians(0.05)
    angle = math.degrees(attitude.error_angle(slew["q_end_bi"], TURN))
    assert worst[0] == pytest.approx(
        2 * 10 / math.sqrt(3) * angle / 600**2 / 1e-2, rel=0.05
    )
    assert worst[1] == pytest.approx(2 * 0.1 * 15 / 8 * angle / 600 / 1e-2, rel=0.05)
