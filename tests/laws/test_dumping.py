"""Dumping and blending laws of paper 000: the invariants of the notes over random
states."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import solve_continuous_are

from desat.components.laws import blending, dumping
from desat.components.maths import vector
from tests.conftest import cross3

number = st.floats(-1, 1, allow_nan=False)
torque = st.tuples(number, number, number).map(lambda v: vector.scale(0.05, v))
field = (
    st.tuples(number, number, number)
    .filter(lambda v: vector.norm(v) > 0.1)
    .map(lambda v: vector.scale(5e-5, v))
)
rate = st.tuples(number, number, number).map(lambda v: vector.scale(2e-3, v))
ratio = st.floats(1e6, 1e13)


def q_matrix(b):
    """Eq. 5: M x B = Q M."""
    return np.array([[0, b[2], -b[1]], [-b[2], 0, b[0]], [b[1], -b[0], 0]])


@given(torque, field, ratio)
def test_ocdc_is_equation_24(n, b, b_over_a):
    a_matrix = np.hstack([q_matrix(b), np.eye(3)])
    s_inverse = np.diag([1, 1, 1] + [1 / b_over_a] * 3)
    x = s_inverse @ a_matrix.T @ np.linalg.solve(a_matrix @ s_inverse @ a_matrix.T, n)
    m, n_t = blending.ocdc(n, b, b_over_a)
    assert np.allclose(m, x[:3], rtol=1e-6, atol=1e-7)  # the reference cancels
    assert np.allclose(n_t, x[3:], rtol=1e-6, atol=1e-12)


@given(torque, field, ratio)
def test_ocdc_closed_form(n, b, b_over_a):
    n, b = np.array(n), np.array(b)
    par = b * (b @ n) / (b @ b)
    _, n_t = blending.ocdc(tuple(n), tuple(b), b_over_a)
    assert np.allclose(n_t, par + (n - par) / (1 + b_over_a * (b @ b)), atol=1e-15)


@given(torque, field, st.floats(0, 1e5), ratio, st.floats(1, 100))
def test_every_split_adds_up(n, b, k, b_over_a, limit):
    for split in (
        blending.dct(n, b),
        blending.cccp(n, b, k),
        blending.crcp(n, b),
        blending.ocdc(n, b, b_over_a),
    ):
        for m, n_t in (split, blending.limit_dipole(split, b, limit)):
            assert np.allclose(np.add(n_t, np.cross(m, b)), n, rtol=0, atol=1e-15)
    m, _ = blending.limit_dipole(blending.crcp(n, b), b, limit)
    assert max(map(abs, m)) <= limit


@given(torque, field, ratio)
def test_thruster_torque_per_sample_is_ordered(n, b, b_over_a):
    sizes = [
        vector.norm(split[1])
        for split in (
            blending.crcp(n, b),
            blending.ocdc(n, b, b_over_a),
            blending.dct(n, b),
        )
    ]
    assert sizes[0] <= sizes[1] + 1e-15
    assert sizes[1] <= sizes[2] + 1e-15


@given(torque, field)
def test_ocdc_tends_to_crcp(n, b):
    m, n_t = blending.ocdc(n, b, 1e20)
    m_limit, n_limit = blending.crcp(n, b)
    assert np.allclose(m, m_limit, rtol=1e-6)
    assert np.allclose(n_t, n_limit, rtol=1e-6, atol=1e-9)


def test_no_field_leaves_it_to_the_thrusters():
    n, zero = (0.01, -0.02, 0.03), (0.0, 0.0, 0.0)
    for split in (
        blending.cccp(n, zero, 1e4),
        blending.crcp(n, zero),
        blending.ocdc(n, zero, 1e9),
    ):
        assert split == (zero, n)


@given(torque, rate, st.floats(1e-3, 0.1), torque)
def test_ilqr_is_the_riccati_solution(h, omega, g_rate, n_con):
    x, y, z = omega
    w = -np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    # F = g_rate^2, R = 1
    k = solve_continuous_are(w, np.eye(3), g_rate**2 * np.eye(3), np.eye(3))
    assert np.allclose(k, g_rate * np.eye(3), atol=1e-12)
    g = np.linalg.solve((w - k).T, k @ n_con)
    riccati_dipole = -k @ h + g
    assert np.allclose(
        dumping.ilqr(h, omega, g_rate, n_con), riccati_dipole, rtol=1e-9, atol=1e-14
    )


def test_lqr_solves_equation_11_backwards():
    omega, g_rate, n_con, horizon = (
        (1e-4, -1.07e-3, 5e-5),
        0.0077,
        (1e-3, -2e-3, 5e-4),
        600.0,
    )
    x, y, z = omega
    w = -np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])

    def slope(t, state):
        k, g = state[:9].reshape(3, 3), state[9:]
        dk = -k @ w - w.T @ k + k @ k - g_rate**2 * np.eye(3)
        return np.concatenate([dk.ravel(), -(w - k).T @ g + k @ n_con])

    times = np.arange(0, 601, 10.0)
    solution = solve_ivp(
        slope,
        (horizon, 0),
        np.zeros(12),
        t_eval=times[::-1],
        rtol=1e-11,
        atol=1e-16,
        method="DOP853",
    ).y[:, ::-1]
    offsets = np.reshape(
        dumping.lqr_offsets(omega, g_rate, n_con, horizon, 10.0), (-1, 3)
    )
    assert np.allclose(offsets, solution[9:].T, rtol=1e-6, atol=1e-9)
    h = np.array([1.0, 2.0, -1.0])
    for i, t in enumerate(times):
        backward_dipole = -solution[:9, i].reshape(3, 3) @ h + solution[9:, i]
        dipole = dumping.lqr(tuple(h), g_rate, horizon - t, tuple(offsets[i]))
        assert np.allclose(dipole, backward_dipole, rtol=1e-6, atol=1e-9)


@given(st.tuples(number, number, number), rate, torque, st.floats(100, 3000))
def test_mec_ends_at_zero(h0, omega, n_con, horizon):
    p = dumping.mec_costate(h0, omega, n_con, horizon)

    def slope(t, h):
        return -cross3(omega, h) + dumping.mec(p, omega, t) + n_con

    end = solve_ivp(slope, (0, horizon), h0, rtol=1e-12, atol=1e-15, method="DOP853").y[
        :, -1
    ]
    assert np.linalg.norm(end) < 1e-9


@given(st.tuples(number, number, number), rate)
def test_mec_needs_the_least_energy(h0, omega):
    """Against straight feed-forward of the same end: N = -h/(t_f - t), integrated
    exactly."""
    p = np.array(dumping.mec_costate(h0, omega, (0, 0, 0), 600.0))
    energy = 0.5 * 600 * p @ p  # |N| is constant
    # any other law with the same end, here all of the momentum in the first half
    other = 0.5 * 300 * (2 * p) @ (2 * p)
    assert energy <= other
    assert np.linalg.norm(p) == pytest.approx(np.linalg.norm(h0) / 600, rel=1e-12)
