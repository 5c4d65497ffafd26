"""The body's energy and impulse, held against the work and the torques computed outside
it."""

from __future__ import annotations

import numpy as np
import pytest

from desat.analyses import energy
from desat.analyses.motion import Steps
from desat.components.blocks import spacecraft_rigid
from desat.components.physics import rigid_body
from desat.runs.run import Options, execute


def numbers(name: str, **options):
    run = execute(name, Options(blocks=True, **options))
    assert run.ok
    return {k: n["value"] for k, n in run.manifest["numbers"].items()}, run


def test_energy_adds_up_without_external_torque():
    values, run = numbers("gyrostat/free")
    assert values["energy_mismatch"] < 1e-11
    assert values["impulse_mismatch"] == 0.0
    ((caption, chart),) = energy.figures(run.manifest, run.results)
    assert caption.startswith("Energy mismatch")
    assert "<svg" in chart.svg()


def test_the_balance_is_of_order_six():
    """What it errs itself falls with the sixth power of nutation times step."""
    coarse = numbers("gyrostat/stress", step=1.0)[0]["energy_mismatch"]
    fine = numbers("gyrostat/stress", step=0.5)[0]["energy_mismatch"]
    assert coarse < 1e-9
    assert fine < coarse / 2**5


SURFACES = [
    "spacecraft.aerodynamics=plates",
    "spacecraft.radiation=plates",
    "spacecraft.plates="
    + str(
        [
            [1, 0, 0, 0.5, 0.1, 0.2, 0, 0.3, 0.4],
            [0, 1, 0, 0.7, 0, 0.1, 0.2, 0.1, 0.2],
            [0, -2, 0, 0.7, 0, 0.1, 0.3, 0.1, 0.2],
            [0, 0, 1, 0.4, 0.1, 0, 0.1, 0, 0.9],
        ]
        + [[0] * 9] * 12
    ),
]


@pytest.mark.parametrize(
    ("sets", "share"), [([], 1e-11), (SURFACES, 1e-9)], ids=["area", "plates"]
)
def test_impulse_is_what_the_neighbours_make_it(sets, share):
    """Field and dipole, gravity gradient, drag and radiation: all recomputed; where a
    plate turns into the flow or the light its torque has a kink, which a quadrature
    sees in second order."""
    values, run = numbers("nadir_day/day-igrf", stop=600.0, sets=sets)
    impulse = np.linalg.norm(run.results.values("spacecraft.impulse_eci"), axis=1).max()
    assert impulse > 1e-3
    assert values["impulse_mismatch"] < share * impulse
    assert values["energy_mismatch"] < 1e-8


ALWAYS = [
    "spacecraft.residual_dipole_body=[3.0, -2.0, 1.0]",
    "spacecraft.tau_disturbance_body=[1e-4, 2e-4, -3e-4]",
]


@pytest.mark.parametrize(
    "sets", [ALWAYS, SURFACES, []], ids=["always", "plates", "area"]
)
def test_impulse_of_a_minute_is_what_the_neighbours_make_it(sets):
    """Each torque that a body may have beside the usual ones, large enough to be seen
    at once."""
    values, run = numbers("nadir_day/day-igrf", stop=60.0, sets=sets)
    impulse = np.linalg.norm(run.results.values("spacecraft.impulse_eci"), axis=1).max()
    assert impulse > (1e-3 if sets is ALWAYS else 1e-6)
    assert values["impulse_mismatch"] < 1e-8 * impulse


def test_balances_go_on_from_block_to_block(monkeypatch):
    full, _ = numbers("nadir_day/day-igrf", stop=60.0)
    monkeypatch.setattr(energy, "BLOCK", 7)
    parts, _ = numbers("nadir_day/day-igrf", stop=60.0)
    for name, about in (
        ("energy_mismatch", 1e-3),
        ("impulse_mismatch", 0.5),
        ("hidden_work", 1e-9),
    ):
        assert parts[name] == pytest.approx(full[name], rel=about)


def test_a_wrong_torque_shows(monkeypatch):
    """The momentum residual takes the body's word for its impulse; this does not."""
    slopes = rigid_body.slopes
    monkeypatch.setattr(
        spacecraft_rigid, "slopes", lambda *x: slopes(*x[:-1], 1.0001 * x[-1])
    )
    values, _ = numbers("plant/reference", stop=600.0)
    assert values["momentum_residual"] < 1e-14
    assert values["impulse_mismatch"] > 1e-8


def test_an_integrator_that_damps_shows(monkeypatch):
    """RK4 in the place of the method of order 8."""
    full = numbers("gyrostat/stress")[0]
    monkeypatch.setattr(spacecraft_rigid, "step8", spacecraft_rigid.step4)
    rk4 = numbers("gyrostat/stress")[0]
    assert rk4["energy_mismatch"] > 100 * full["energy_mismatch"]
    assert rk4["momentum_residual"] < 1e-12


@pytest.mark.parametrize(
    "options",
    [{"algorithm": "jacobi"}, {"record": ("spacecraft.*",)}],
    ids=lambda o: next(iter(o)),
)
def test_no_number_where_it_cannot_be_known(options):
    """A torque that acts a step late, series left out."""
    values, run = numbers("gyrostat/free", stop=10.0, **options)
    assert not {"energy_mismatch", "impulse_mismatch"} & set(values)
    assert energy.figures(run.manifest, run.results) == []


@pytest.mark.parametrize("every", [2, 3])
def test_rows_left_out_are_no_steps(every):
    """The balance is made while it runs then, and has no course that could be shown."""
    values, run = numbers("gyrostat/free", stop=30.0, every=every)
    assert values["energy_mismatch"] < 1e-11
    assert list(energy.blocks_of(run.manifest, run.results)) == []
    assert energy.figures(run.manifest, run.results) == []


def test_one_step_has_a_balance():
    values, run = numbers("gyrostat/free", stop=0.5, step=0.5)
    assert len(run.results.times()) == 2
    assert len(list(energy.blocks_of(run.manifest, run.results))) == 1
    assert values["energy_mismatch"] < 1e-12


def test_attitude_between_rows():
    """A body that turns evenly about one axis: the attitude inside a step in closed
    form."""
    rate, dt, e = 0.2, 1.0, 0.3

    def q(t):
        return np.array([[0.0, 0.0, np.sin(0.5 * rate * t), np.cos(0.5 * rate * t)]])

    zero, omega = np.zeros((2, 3)), np.array([[0.0, 0.0, rate]] * 2)
    steps = Steps(
        dt,
        np.diag([3.0, 2.0, 1.0]),
        np.zeros((3, 4)),
        np.vstack([q(0.0), q(dt)]),
        omega,
        zero,
        np.zeros((2, 4)),
        np.zeros((1, 4)),
        np.zeros((1, 4)),
    )
    assert steps.attitude(e) == pytest.approx(
        q(e * dt), abs=(0.5 * rate * dt) ** 6 / 46080
    )
    assert steps.rate(e, q(e * dt)) == pytest.approx(omega[:1], abs=1e-15)
