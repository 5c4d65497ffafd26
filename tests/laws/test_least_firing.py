"""The plan with the least firing time: its price, its refusals, and HiGHS beside it."""

from __future__ import annotations

import numpy as np
import pytest

from desat.components.laws.least_firing import least_firing


def programme(seed: int):
    """A random programme that has a plan: intervals, thrusters, coils of any direction."""
    rng = np.random.default_rng(seed)
    n, p, c = rng.integers(1, 30), rng.integers(3, 9), rng.integers(0, 5)
    thrust = 0.04 * rng.normal(size=(n, p, 3))
    longest = rng.uniform(1.0, 10.0, n)
    dipole = 0.01 * rng.normal(size=(n, c, 3))
    on = rng.uniform(0, 1, (n, p)) ** 4 * longest[:, None]
    share = rng.uniform(-1, 1, (n, c))
    impulse = np.einsum("kp,kpj->j", on, thrust) + np.einsum("kc,kcj->j", share, dipole)
    return impulse, thrust, longest, dipole, on.sum()


@pytest.mark.parametrize("seed", range(10))
def test_a_plan_is_proved_by_its_price(seed):
    """Strong duality: what the price says cannot be undercut, and the plan reaches it."""
    impulse, thrust, longest, dipole, other = programme(seed)
    plan = least_firing(impulse, thrust, longest, dipole)
    assert plan is not None
    impulse_value = np.einsum("kp,kpj->j", plan.on_time, thrust) + np.einsum(
        "kc,kcj->j", plan.dipole, dipole
    )
    assert impulse_value == pytest.approx(impulse, abs=1e-7)
    assert plan.on_time.min() >= 0.0
    assert np.all(plan.on_time <= longest[:, None] + 1e-9)
    assert np.abs(plan.dipole).max(initial=0.0) <= 1.0 + 1e-9
    gain = longest[:, None] * np.maximum(thrust @ plan.price - 1.0, 0.0)
    dual_value = plan.price @ impulse - gain.sum() - np.abs(dipole @ plan.price).sum()
    assert dual_value == pytest.approx(plan.seconds, abs=1e-6)
    assert plan.seconds <= other + 1e-9
    step = 1e-6 * np.array([1.0, -2.0, 1.5])
    neighbour = least_firing(impulse + step, thrust, longest, dipole)
    assert neighbour is not None
    # the least seconds are convex in the impulse
    assert neighbour.seconds >= plan.seconds + plan.price @ step - 1e-9


def test_too_much_has_no_plan(capfd):
    impulse, thrust, longest, dipole, _ = programme(1)
    assert least_firing(1e4 * impulse, thrust, longest, dipole) is None
    assert capfd.readouterr() == (
        "",
        "",
    )  # the solver's own library may not write into ours


def test_dipole_without_limit_needs_no_thruster():
    impulse, thrust, longest, _, _ = programme(2)
    dipole = np.random.default_rng(3).normal(size=(len(longest), 3, 3))
    plan = least_firing(impulse, thrust, longest, dipole, limits_dipole=False)
    assert plan is not None
    assert plan.seconds == 0.0


def test_patience_is_late_and_costs_little():
    n = 20
    thrust = np.tile(0.04 * np.vstack([np.eye(3), -np.eye(3)]), (n, 1, 1))
    impulse, longest, dipole = (
        np.array([1.0, -0.5, 0.2]),
        np.full(n, 10.0),
        np.zeros((n, 0, 3)),
    )
    plan = least_firing(impulse, thrust, longest, dipole, patience=1e-3)
    assert plan is not None
    assert plan.seconds == pytest.approx(np.abs(impulse).sum() / 0.04)
    assert plan.on_time[-2:, 0] == pytest.approx([10.0, 10.0])
    assert plan.on_time[:-3].sum() == 0.0
