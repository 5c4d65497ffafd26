"""Blends whose coils are bounded: optima, and craft without an axis or a field."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog, lsq_linear

from desat.components.laws import (
    blending,
)
from desat.components.maths import vector
from desat.runs.run import Options, execute
from tests.contract.test_block import fresh

number = st.floats(-1, 1, allow_nan=False)

triple = st.tuples(number, number, number)

torque = triple.map(lambda v: vector.scale(0.05, v))

field = triple.filter(lambda v: vector.norm(v) > 0.1).map(
    lambda v: vector.scale(5e-5, v)
)

ratio = st.floats(1e6, 1e13)

most = st.floats(0, 100)

limits = st.tuples(most, most, most)


def q_matrix(b):
    """Eq. 5: M x B = Q M."""
    return np.array([[0, b[2], -b[1]], [-b[2], 0, b[0]], [b[1], -b[0], 0]])


@given(torque, field, ratio, limits)
def test_bounded_quadratic_is_the_optimum(n, b, k, limit):
    m, n_t = blending.bounded_quadratic(n, b, k, limit)
    assert np.all(np.abs(m) <= limit)
    assert np.allclose(np.add(n_t, np.cross(m, b)), n, rtol=0, atol=1e-15)
    a = np.vstack([np.eye(3), np.sqrt(k) * q_matrix(b)])
    target = np.r_[np.zeros(3), np.sqrt(k) * np.array(n)]
    bounds = np.maximum(limit, 1e-12)  # lsq_linear wants room
    best = lsq_linear(a, target, (-bounds, bounds), method="bvls", tol=1e-14)
    ours = 0.5 * np.sum((a @ m - target) ** 2)
    assert ours == pytest.approx(best.cost, rel=1e-9, abs=1e-9)


@given(torque, field, ratio)
def test_bounded_quadratic_without_need_is_ocdc(n, b, k):
    free = blending.ocdc(n, b, k)
    x, y, z = (abs(m) for m in free[0])
    assert blending.bounded_quadratic(n, b, k, (x, y, z)) == free


@given(torque, field, limits)
def test_bounded_one_norm_is_the_optimum(n, b, limit):
    m, n_t = blending.bounded_one_norm(n, b, limit)
    assert np.all(np.abs(m) <= limit)
    assert np.allclose(np.add(n_t, np.cross(m, b)), n, rtol=0, atol=1e-15)
    size = vector.norm(b)
    best = linprog(
        np.r_[np.zeros(3), np.ones(6)],
        A_eq=np.c_[q_matrix(b) / size, np.eye(3), -np.eye(3)],
        b_eq=np.array(n) / size,
        bounds=[(-x, x) for x in limit] + [(0, None)] * 6,
    )
    # the programme's tolerance is relative to torque over field, hundreds of A m2
    assert np.abs(n_t).sum() / size == pytest.approx(best.fun, rel=1e-9, abs=1e-6)


@given(torque, field, ratio, st.floats(0.1, 100), st.floats(0, 1e5))
def test_no_feasible_split_has_a_smaller_one_norm(n, b, k, limit, gain):
    box = (limit, limit, limit)
    least = np.abs(blending.bounded_one_norm(n, b, box)[1]).sum()
    others = [
        blending.limit_dipole(split, b, limit)
        for split in (
            blending.cccp(n, b, gain),
            blending.crcp(n, b),
            blending.ocdc(n, b, k),
        )
    ]
    others += [blending.dct(n, b), blending.bounded_quadratic(n, b, k, box)]
    for _, n_t in others:
        assert least <= np.abs(n_t).sum() + 1e-9


@given(torque, field, limits)
def test_no_dipole_along_the_field(n, b, limit):
    """Where the shortest dipole of the same torque is within the limits, that is the
    one."""
    m, _ = blending.bounded_one_norm(n, b, limit)
    u = np.array(b) / vector.norm(b)
    shorter = np.array(m) - (np.array(m) @ u) * u
    if np.all(np.abs(shorter) < limit):
        assert np.allclose(m, shorter, atol=1e-9)


@given(torque, field, ratio, st.integers(0, 2))
def test_a_dead_axis_has_no_dipole(n, b, k, axis):
    m, n_t = blending.without(blending.ocdc(n, b, k), b, axis)
    assert m[axis] == 0.0
    assert np.allclose(np.add(n_t, np.cross(m, b)), n, rtol=0, atol=1e-15)


def test_no_field_leaves_it_to_the_thrusters():
    n, zero, box = (0.01, -0.02, 0.03), (0.0, 0.0, 0.0), (36.0, 36.0, 36.0)
    assert blending.bounded_one_norm(n, zero, box) == (zero, n)
    assert blending.bounded_quadratic(n, zero, 5e9, box) == (zero, n)


@pytest.mark.parametrize("split", ["ocdc", "bounded_quadratic", "bounded_one_norm"])
def test_a_manager_leaves_its_dead_axis_out(split):
    run = execute(
        "uosat12/table3-ocdc-ilqr-1",
        Options(blocks=True, sets=[f"manager.split={split}", "manager.dead_axis=z"]),
    )
    m = run.results.values("manager.m_cmd_body")
    assert not m[:, 2].any()
    assert np.abs(m).max() <= 36.0
    assert np.abs(m[:, :2]).max() > 30.0


@pytest.mark.parametrize(
    "u", [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.6, 0.0, 0.8), (0.36, 0.48, -0.8)]
)
def test_the_shortest_dipole_along_a_line_within_the_limits(u):
    """Of m + s u: within the limits, on the line, and any step along it that stays
    within is not shorter."""
    rng, limit = np.random.default_rng(5), np.array([3.0, 1.0, 2.0])
    for m in rng.uniform(-1.0, 1.0, (40, 3)) * limit:
        nearest = np.array(blending._nearest_along(tuple(m), u, tuple(limit)))
        assert (np.abs(nearest) <= limit).all()
        assert np.linalg.norm(np.cross(nearest - m, u)) < 1e-12
        for s in (-1e-3, 1e-3):
            neighbour = nearest + s * np.array(u)
            within = (np.abs(neighbour) <= limit).all()
            assert not within or neighbour @ neighbour >= nearest @ nearest - 1e-12


def test_coils_that_are_off_are_allowed():
    block = fresh("manager_mixed_mode")
    block.m_limit = 0.0
    block.check()
