"""What a mutation once survived: each test here kills one that nothing else did.

How the sample was drawn and what is left: docs/mutations.md.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from desat.components.contract.block import BlockError
from desat.components.laws import (
    blending,
    dumping,
    magnetic,
    momentum_management,
    rate_observer,
    receding_horizon,
)
from desat.components.laws import magnetic_offline as offline
from desat.components.maths import attitude, moments
from desat.components.physics import (
    averaging,
    gyrostat,
    orbit,
    rotor,
    torques,
    wheel_array,
)
from desat.fmus import registry
from desat.language.scenario import LimitLine
from desat.numbers.limits import limits_of
from desat.runs.prepare import read
from desat.runs.run import Options, execute
from desat.system.errors import DesatError
from desat.system.parameters import Parameter
from tests.contract.test_block import begin, fresh
from tests.mutations import statements_of

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
COILS, LEVEL, PERIOD = (36.0, 36.0, 36.0), (0.04, 0.04, 0.04), 10.0


# --- the receding horizon -------------------------------------------------------------


def test_a_plan_fires_against_a_known_torque():
    """One sample, no field: the on-time is what takes back h + N_con T, axis by axis."""
    h, n_con = (0.05, 0.0, -0.02), (0.01, -0.004, 0.0)
    step = receding_horizon.first_step(
        h,
        (0.0, 0.0, 0.0),
        (UPRIGHT,) * 3,
        ((0.0, 0.0, 0.0),),
        n_con,
        COILS,
        LEVEL,
        (PERIOD, PERIOD),
        PERIOD,
    )
    assert step is not None
    expected = [-(a + PERIOD * n) / 0.04 for a, n in zip(h, n_con, strict=True)]
    assert step[1] == pytest.approx(expected, abs=1e-6)


def test_a_plan_that_knows_the_torque_stands_on_the_bound():
    torque = [4e-4, 0.0, -4e-4]
    run = execute(
        "uosat12/starts-receding_horizon",
        Options(
            blocks=True,
            values={
                "spacecraft.tau_disturbance_body": torque,
                "manager.n_con_body": torque,
            },
        ),
    )
    numbers = {k: n["value"] for k, n in run.manifest["numbers"].items()}
    assert numbers["above_bound"] <= 1.0
    assert numbers["final_momentum"] <= 0.002


def last_sample(h):
    """What the manager gives the wheels to absorb in its last sample, and the field."""
    block = fresh("manager_receding_horizon")
    block.horizon, block.field_spread = PERIOD, 0.0
    begin(block)
    # so far out that the body does not turn meanwhile
    block.r_eci, block.v_eci, block.b_body = (
        (4e8, 0.0, 0.0),
        (0.0, 998.0, 0.0),
        (2e-5, 2e-6, 0.0),
    )
    torque, _ = block.dump(0.0, 0.0, h)
    return np.array(torque), np.array(block.b_body)


@pytest.mark.parametrize(
    "odd", [0.024, -0.013, 0.035]
)  # rounded up: coils take it back
def test_in_the_last_sample_coils_repair_what_rounding_took(odd):
    """The on-time is a whole number of pulses, here more than was planned, and the
    dipole, which was at its limit, gives less."""
    h = (0.0, 0.0, 0.04 * (1.0 + odd))  # across the field
    torque, b = last_sample(h)
    remaining = np.array(h) + PERIOD * torque
    across = remaining - (remaining @ b) / (b @ b) * b
    assert np.linalg.norm(across) < 0.02 * 0.04 * 0.05  # of a pulse


@pytest.mark.parametrize(
    ("price", "on_x", "on_z"), [(0.5, 0.0, 10.0), (10.0, 1.7, 8.0)]
)
def test_the_reserve_is_not_kept_at_any_price(price, on_x, on_z):
    """Two samples, no coils, and 16.02 s of firing about z: with 8 s of each sample
    there is a plan only because the body turns by 0.011 rad between them, which brings
    that share of a shot about x and back to z."""
    block = fresh("manager_receding_horizon")
    block.horizon, block.m_limit, block.reserve_cost = 20.0, 1e-9, price
    begin(block)
    block.r_eci, block.v_eci, block.b_body = (
        (7e6, 0.0, 0.0),
        (0.0, 7546.0, 0.0),
        (2e-5, 0.0, 2e-5),
    )
    _, (_, n_t) = block.dump(0.0, 0.0, (0.0, 0.0, 0.04 * 16.02))
    assert n_t == pytest.approx(
        (0.04 * on_x / PERIOD, 0.0, -0.04 * on_z / PERIOD), abs=1e-9
    )


@pytest.mark.parametrize(("seen", "h"), [(False, 0.5), (True, 50.0)])
def test_what_is_done_without_a_plan(seen, h):
    """No field: thrusters alone give -h rate, with a rate that is enough for the time
    that is left. A field, but more momentum than any plan can take: coils help, and no
    thruster gives more than its share of a sample."""
    block = fresh("manager_receding_horizon")
    block.horizon, block.g_rate = 100.0, 1e-4
    begin(block)
    block.b_body, block.valid_b = (2e-5, 0.0, 3e-5), seen
    torque, (m, n_t) = block.dump(0.0, 50.0, (0.0, h, 0.01))
    assert block.mode == 3
    most = block.thruster_duty * block.tau_level[1]
    if seen:
        assert n_t[1] == pytest.approx(-most)
        assert np.cross(m, block.b_body)[1] < 0.0
    else:
        assert m == (0.0, 0.0, 0.0)
        assert torque == pytest.approx(
            (0.0, -min(h / 50.0, most), -0.01 / 50.0), rel=0.06
        )
    assert torque == pytest.approx(tuple(np.cross(m, block.b_body) + n_t))


@pytest.mark.parametrize(("period", "fails"), [(0.0, True), (0.5, False), (1.0, False)])
def test_a_plan_needs_samples(period, fails):
    block = fresh("manager_receding_horizon")
    block.sample_time, block.horizon = period, 20.0
    if fails:
        with pytest.raises(BlockError, match="sample_time = 0 s"):
            block.start()
    else:
        block.start()


@pytest.mark.parametrize(
    "u", [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.6, 0.0, 0.8), (0.36, 0.48, -0.8)]
)
def test_the_shortest_dipole_along_a_line_within_the_limits(u):
    """Of m + s u: within the limits, on the line, and any step along it that stays
    within is not shorter."""
    rng, limit = np.random.default_rng(5), np.array([3.0, 1.0, 2.0])
    for m in rng.uniform(-1.0, 1.0, (40, 3)) * limit:
        found = np.array(blending._nearest_along(tuple(m), u, tuple(limit)))
        assert (np.abs(found) <= limit).all()
        assert np.linalg.norm(np.cross(found - m, u)) < 1e-12
        for s in (-1e-3, 1e-3):
            moved = found + s * np.array(u)
            within = (np.abs(moved) <= limit).all()
            assert not within or moved @ moved >= found @ found - 1e-12


def test_the_fit_finds_attitude_scale_and_offset():
    """After half a turn of the field what is ahead is known, though not what each cause
    was."""
    angle = math.radians(5.0)
    turn = np.array(
        [
            [1, 0, 0],
            [0, math.cos(angle), math.sin(angle)],
            [0, -math.sin(angle), math.cos(angle)],
        ]
    )
    course = np.linspace(0.0, 2.0, 60)
    model = np.array(
        [23e-6 * np.cos(course), 0 * course + 2.4e-6, 46e-6 * np.sin(course)]
    ).T
    truth = 1.1 * model @ turn.T + np.array([1e-6, 3e-6, -2e-6])
    fit, errors = receding_horizon.NO_FIT, []
    for b, measured in zip(model[:50], truth[:50], strict=True):
        fit = receding_horizon.learnt(fit, tuple(b), tuple(measured))
        course_ahead = tuple(tuple(x) for x in model[50:])
        ahead = receding_horizon.corrected(fit, course_ahead, 0.1, 1e-6)
        errors.append(np.abs(np.array(ahead) - truth[50:]).max())
    assert np.abs(model[50:] - truth[50:]).max() > 5e-6
    assert errors[0] < np.abs(model[50:] - truth[50:]).max(), (
        "one measurement helps already"
    )
    assert errors[-1] < 1e-6


def test_no_measurement_leaves_the_model_as_it_is():
    b = [(1e-5, 2e-5, -3e-5), (0.0, 1e-5, 0.0)]
    assert receding_horizon.corrected(
        receding_horizon.NO_FIT, tuple(b), 0.1, 1e-6
    ) == tuple(b)


CLIFF = [("robust-model", "b_y_3", 10), ("robust", "yaw", 19)]


@pytest.mark.parametrize(("file", "case", "draw"), CLIFF)
def test_a_wrong_model_costs_little_once_it_is_learnt(file, case, draw):
    """The draws that cost 23 and 30 % more while the plan trusted its model and kept
    its reserve at any price."""
    from desat.campaign.sampling import draw_of

    name = f"uosat12/{file}-receding_horizon-{case}"
    start = draw_of(read(name).to_draw(blocks=True), 1, draw)

    def above(spread, cost):
        own_value = {"manager.field_spread": spread, "manager.reserve_cost": cost}
        run = execute(name, Options(blocks=True, values={**start, **own_value}))
        return run.manifest["numbers"]["above_bound"]["value"]

    assert above(0.1, 0.5) <= 5.0
    assert above(0.1, 1e9) <= 5.0
    assert above(0.0, 1e9) >= 10.0


# --- actuators and maths --------------------------------------------------------------


@pytest.mark.parametrize("ratio", [1e-9, 1e-6, 1e-3, 0.1, 0.999999, 1.0, 1.5, 4.0])
def test_moments_of_a_lag_keep_all_digits(ratio):
    """Each against its series in exact fractions: a closed form too far down cancels."""
    from fractions import Fraction

    x = Fraction(ratio)
    terms = [Fraction(1)]
    for n in range(1, 60):
        terms.append(terms[-1] * -x / n)
    mean = sum(t / (n + 1) for n, t in enumerate(terms))
    slope = 12 * sum(
        t * (Fraction(1, n + 2) - Fraction(1, 2 * (n + 1))) for n, t in enumerate(terms)
    )
    found = moments.lag(ratio)
    assert found[0] == pytest.approx(float(mean), rel=2e-15)
    assert found[1] == pytest.approx(float(slope), rel=5e-14)
    assert found[2] == pytest.approx(math.exp(-ratio), rel=1e-15)


@pytest.mark.parametrize("ratio", [0.3, 2.5])
def test_a_first_order_lag_by_its_integrals(ratio):
    s = (np.arange(20000) + 0.5) / 20000
    x = -1.5 + (2.0 + 1.5) * np.exp(-ratio * s)
    mean, slope, end, square = moments.first_order(2.0, -1.5, ratio)
    assert mean == pytest.approx(x.mean(), rel=1e-6)
    assert slope == pytest.approx(12.0 * (x * (s - 0.5)).mean(), rel=1e-6)
    assert end == pytest.approx(-1.5 + 3.5 * math.exp(-ratio))
    assert square == pytest.approx((x * x).mean(), rel=1e-6)


def test_a_part_of_a_step_by_its_integrals():
    s = (np.arange(20000) + 0.5) / 20000
    inside = (s > 0.2) & (s < 0.7)
    x = np.where(inside, 3.0 + 0.8 * ((s - 0.2) / 0.5 - 0.5), 0.0)
    mean, slope = moments.part(0.2, 0.7, 3.0, 0.8)
    assert mean == pytest.approx(x.mean(), rel=1e-4)
    assert slope == pytest.approx(12.0 * (x * (s - 0.5)).mean(), rel=1e-3)


@pytest.mark.parametrize("wheels", [1, 2, 3])
def test_too_few_axes_have_a_pseudo_inverse_too(wheels):
    """One axis, two, and three in a plane, against numpy's singular values."""
    axes = np.zeros((3, 4))
    axes[:, :wheels] = np.array([[0.6, 0.8, 0.0], [0.0, 0.6, 0.8], [0.6, 1.4, 0.8]]).T[
        :, :wheels
    ]
    found = np.reshape(wheel_array.pseudo_inverse(tuple(axes.ravel())), (4, 3))
    assert found == pytest.approx(np.linalg.pinv(axes), abs=1e-12)


@pytest.mark.parametrize("name", ["magnetic_share", "threshold_off", "threshold_on"])
def test_a_share_is_none_to_all(name):
    for value, right in ((0.0, True), (1.0, True), (-0.01, False), (1.01, False)):
        block = fresh("manager_integrated")
        setattr(block, name, value)
        if right:
            block.check()
        else:
            with pytest.raises(BlockError, match=name):
                block.check()


def test_the_condition_is_that_of_the_eigenvalues():
    rng = np.random.default_rng(3)
    for root in rng.normal(size=(50, 3, 3)):
        m = root @ root.T
        values = np.linalg.eigvalsh(m)
        found = momentum_management.condition(tuple(m.ravel()))
        assert found == pytest.approx(values[-1] / values[0], rel=1e-6)


def test_each_rotor_begins_its_jitter_at_an_angle_of_its_own():
    s = 1.0 / math.sqrt(3.0)
    wheels = fresh("wheels")
    wheels.axes_wheel = (s, -s, -s, s, s, s, -s, -s, s, s, s, s)
    wheels.inertia_wheel = (3.2e-5,) * 4
    begin(wheels)
    assert len({round(a, 6) for a in wheels._turned}) == 4


@pytest.mark.parametrize("drive", [0, 1, 2])
def test_a_coil_without_a_command_counts_no_time(drive):
    coils = fresh("torquers")
    coils.drive, coils.sample_time, coils.m_limit = drive, 10.0, 40.0
    begin(coils)
    coils.m_cmd_body = (36.0, 0.0, 0.0)
    for k in range(10):
        coils.advance(float(k), 1.0)
    coils.output(10.0)
    assert coils.on_time == pytest.approx(9.0 if drive == 2 else 10.0)


def craft(**values):
    body = fresh("spacecraft_rigid")
    for key, value in values.items():
        assert hasattr(body, key)
        setattr(body, key, value)
    begin(body)
    return body


def test_the_field_bends_within_a_step():
    """A residual dipole in a field that accelerates from zero: the impulse is m x b''
    T^3 / 6."""
    body = craft(
        inertia=(1e6, 0.0, 0.0, 0.0, 1e6, 0.0, 0.0, 0.0, 1e6),
        gravity_gradient=False,
        residual_dipole_body=(0.0, 0.0, 2.0),
        b_accel_eci=(3e-8, 0.0, 0.0),
    )
    body.advance(0.0, 10.0)
    body.output(10.0)
    assert body.impulse_eci == pytest.approx(
        (0.0, 2.0 * 3e-8 * 1000.0 / 6.0, 0.0), rel=1e-9
    )


def test_the_place_falls_within_a_step():
    """Gravity gradient over a step of 100 s on a circle, against the same in steps of 1
    s."""
    mu, r = 3.986004418e14, 7e6
    n = math.sqrt(mu / r**3)
    inertia = (9e5, 0.0, 0.0, 0.0, 6e5, 0.0, 0.0, 0.0, 4e5)

    def impulse(dt):
        body = craft(inertia=inertia, q_start_bi=(0.1, 0.2, 0.3, 0.9))
        for k in range(round(100.0 / dt)):
            a = n * k * dt
            body.r_eci = (r * math.cos(a), r * math.sin(a), 0.0)
            body.v_eci = (-r * n * math.sin(a), r * n * math.cos(a), 0.0)
            body.advance(k * dt, dt)
        body.output(100.0)
        return np.array(body.impulse_eci)

    fine = impulse(1.0)
    straight = (
        np.linalg.norm(fine) * 0.5 * (n * 100.0) ** 2 / 3.0
    )  # of the order of a missing fall
    assert np.linalg.norm(impulse(100.0) - fine) < 0.1 * straight


# --- the system and its plots ---------------------------------------------------------


def test_a_shared_parameter_must_be_equal_everywhere():
    builder = read("integrated/mil-nadir").builder(Options(blocks=True))
    builder.components["manager"].parameters["axes_wheel[1,2]"] = 0.5
    found = builder.check()
    assert found.problems == []  # a model onboard may err
    assert any(
        "manager.axes_wheel[1,2] = 0.5, but spacecraft." in w for w in found.warnings
    )
    builder.components["wheels"].parameters["axes_wheel[1,2]"] = 0.5
    with pytest.raises(
        DesatError, match=r"axes_wheel\[1,2\] = .*the two must be equal"
    ):
        builder.check().or_raise()


@pytest.mark.parametrize("known", ["axes_wheel", "inertia_wheel"])
def test_what_blocks_know_of_the_wheels_is_shared(known):
    """So that `check` says of a manager that it knows other wheels than there are."""
    found = {
        name: v.shared
        for name in registry.names()
        for v in registry.block_class(name).variables
        if v.name == known
    }
    assert len(found) > 2
    assert all(found.values()), found


def test_a_limit_is_left_out_where_its_unless_holds():
    parameters = {
        "torquers": {
            "drive": Parameter("ideal", ""),
            "m_limit": Parameter(40.0, "A.m2"),
        }
    }
    limits = [LimitLine(value="torquers.m_limit", unless={"torquers.drive": "ideal"})]
    assert limits_of(limits, parameters, "A.m2") == []
    parameters["torquers"]["drive"] = Parameter("pulsed", "")
    assert [x[1] for x in limits_of(limits, parameters, "A.m2")] == [40.0]


# --- the laws that are designed -------------------------------------------------------


@pytest.mark.parametrize(
    ("horizon", "intervals"), [(60.0, 1), (440.0, 1), (460.0, 2), (900.0, 3)]
)
def test_a_costate_asks_for_the_field_once_a_point(horizon, intervals):
    """A short horizon has one interval of the quadrature too."""
    requests = []

    def field(t):
        requests.append(t)
        return (0.0, 0.0, 3e-5)

    offline.costate(
        field,
        (0.0, 1e-3, 0.0),
        (1.0, 1.0, 1.0),
        (0.0,) * 3,
        (1.0, 0.5, 0.0),
        (0.0,) * 3,
        horizon,
    )
    assert len(requests) == intervals * offline.POINTS
    assert (
        0.0 < min(requests) < 0.01 * horizon < 0.99 * horizon < max(requests) < horizon
    )


def test_a_costate_turns_as_the_momentum_does():
    """Of momentum that nothing acts on, h' = -omega x h, the product with the costate
    is constant: p' = -omega x p."""
    omega, p0 = (1e-3, -2e-3, 0.5e-3), (2.0, -1.0, 4.0)
    later = magnetic.mec_costate(p0, omega, 1e-2)
    change = (np.array(later) - p0) / 1e-2
    assert change == pytest.approx(-np.cross(omega, p0), rel=1e-4)


@pytest.mark.parametrize("law", [0, 1, 2])
def test_the_manager_asks_the_law_it_is_told(law):
    h, n_con, rate = (1.0, -2.0, 0.5), (1e-4, 0.0, -2e-4), 0.008
    block = fresh("manager_combined")
    block.law, block.g_rate, block.n_con_body = law, rate, n_con
    block.horizon, block.sample_time = 600.0, 10.0
    begin(block)
    block.omega_bi_body = omega = (0.0, -1e-3, 0.0)
    offsets = dumping.lqr_offsets(omega, rate, n_con, 600.0, 10.0)
    start = dumping.mec_costate(h, omega, n_con, 600.0)
    expected = (
        dumping.ilqr(h, omega, rate, n_con),
        dumping.lqr(h, rate, 600.0, offsets[:3]),
        dumping.mec(start, omega, 0.0),
    )[law]
    assert block.dump(0.0, 0.0, h)[0] == pytest.approx(expected, rel=1e-12)


# --- physics --------------------------------------------------------------------------


def test_a_rotor_meets_its_limit_while_the_body_speeds_up():
    """A constant torque until h / J less the body's rate is at the limit; then it is
    there: by hand for both parts."""
    torque, inertia, fastest, change = 0.02, 2e-3, 6.0, 2.0
    motor = (inertia, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.02)
    (h, *_), integral = rotor.step(
        motor, (0.0,) * 4, torque, 0.1, 0.1 + change, 1.0, fastest
    )
    met = (fastest + 0.1) / (torque / inertia - change)
    at_limit = (fastest + 0.1) * (1.0 - met) + 0.5 * change * (1.0 - met**2)
    assert h == pytest.approx(inertia * (fastest + 0.1 + change), rel=1e-12)
    assert integral == pytest.approx(
        0.5 * torque * met**2 + inertia * at_limit, rel=1e-9
    )


def test_the_observer_s_model_moves_momentum_between_wheel_and_body():
    """Without a field, body and wheel together keep the size of their momentum while
    the wheel's motor works."""
    inertia, omega, tau = np.diag([2.0, 3.0, 4.0]), (0.3, -0.2, 0.4), (0.0, 0.5, 0.0)
    wheel = np.array([0.0, 0.4, 0.0])
    inverse = tuple(np.linalg.inv(inertia).ravel())
    zero = (0.0, 0.0, 0.0)
    later, _ = rate_observer.predicted(
        omega,
        (1e-5, 0.0, 0.0),
        zero,
        tau,
        tuple(wheel),
        tuple(inertia.ravel()),
        inverse,
        0.4,
    )
    before = np.linalg.norm(inertia @ omega + wheel)
    after = np.linalg.norm(inertia @ later + wheel - 0.4 * np.array(tau))
    assert after == pytest.approx(before, rel=2e-4)


def test_an_inertia_with_two_moments_below_zero_is_none():
    with pytest.raises(BlockError, match="principal moments must be above 0"):
        gyrostat.check_inertia((2.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0))


def test_an_inertia_that_is_not_symmetric_says_where():
    with pytest.raises(
        BlockError, match=r"inertia\[2,3\] = 0.1 and inertia\[3,2\] = 0"
    ):
        gyrostat.check_inertia((2.0, 0.0, 0.0, 0.0, 2.0, 0.1, 0.0, 0.0, 2.0))


@pytest.mark.parametrize("wheel", range(4))
def test_one_wheel_is_commanded(wheel):
    block = fresh("manager_start_up")
    begin(block)
    block._wheel, block._along, block.valid_h = wheel, -1.0, False
    block.give((0.0, 0.0, 0.0), 1e-5)
    assert block.tau_cmd_wheel == tuple(-1e-5 * (i == wheel) for i in range(4))


def test_the_gravity_gradient_of_later_is_that_of_free_fall():
    block = fresh("manager_closed_loop")
    begin(block)
    block.r_eci, block.v_eci, block.q_bi = (
        (7e6, 1e5, 0.0),
        (100.0, 5300.0, 5300.0),
        UPRIGHT,
    )
    (r, _), *_ = receding_horizon.coast(block.r_eci, block.v_eci, (120.0,))
    expected = torques.gravity_gradient(r, block._inertia)
    assert block._gravity_in(120.0) == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize(
    ("t", "row", "share"), [(0.0, 0, 0.0), (25.0, 2, 0.5), (40.0, 3, 1.0)]
)
def test_a_place_in_a_table(t, row, share):
    assert momentum_management.place(5, 10.0, t) == pytest.approx((row, share))


def test_a_field_that_turns_with_the_earth():
    """A quarter of a turn later, the dipole's field a quarter of a turn further is that
    of before, turned by it."""
    block = fresh("manager_receding_horizon")
    block.field_model = 1
    begin(block)
    x, y, z = 5e6, 3e6, 4e6
    bx, by, bz = block.field_date((x, y, z), 0.0, False)
    quarter = 0.5 * math.pi / block.earth_rate
    later = block.field_date((-y, x, z), quarter, False)
    assert later == pytest.approx((-by, bx, bz), rel=1e-9)
    assert abs(bx - block.field_date((x, y, z), quarter, False)[0]) > 1e-7


# --- attitude, momentum, orbits -------------------------------------------------------


@pytest.mark.parametrize("seed", range(8))
def test_a_quaternion_comes_back_from_its_matrix(seed):
    """Each of Shepperd's four choices; the matrix as scipy has it, which turns the
    other way."""
    from scipy.spatial.transform import Rotation

    q = np.random.default_rng(seed).normal(size=4)
    q[seed % 4] += math.copysign(4.0, q[seed % 4])  # which of the four is the largest
    q *= math.copysign(1.0, q[3]) / np.linalg.norm(q)
    c = attitude.matrix(tuple(q.tolist()))
    assert np.reshape(c, (3, 3)) == pytest.approx(
        Rotation.from_quat(q).as_matrix().T, abs=1e-14
    )
    assert attitude.from_matrix(c) == pytest.approx(q, abs=1e-14)


def test_a_turning_body_keeps_its_energy():
    """A body that nothing acts on, its attitude far from upright, by the rotation
    matrix of its own equations. The rotors keep their momentum, 0, so that they do not
    turn with it."""
    block = fresh("spacecraft_rigid")
    block.inertia = (2.0, 0.1, 0.0, 0.1, 3.0, -0.2, 0.0, -0.2, 1.5)
    block.q_start_bi, block.omega_start_body = (
        (0.5, -0.5, 0.1, 0.7),
        (0.02, -0.03, 0.05),
    )
    block.gravity_gradient = False
    begin(block)
    axes = np.reshape(block.axes_wheel, (3, 4))
    carried = np.reshape(block.inertia, (3, 3)) - (axes * block.inertia_wheel) @ axes.T
    energies = []
    for k in range(41):
        block.output(float(k))
        omega = np.array(block.omega_bi_body)
        energies.append(0.5 * omega @ carried @ omega)
        block.advance(float(k), 1.0)
    assert energies == pytest.approx([energies[0]] * 41, rel=1e-13)


def test_osculating_elements_are_the_inverse_of_mean_ones():
    mean = orbit.Elements(6.7e6, 0.001, 0.9, 0.3, 0.9, 1.0)
    back = averaging.mean_elements(
        averaging.osculating_elements(mean, 4, orbit.MU), 4, orbit.MU
    )
    assert back.semi_major_axis == pytest.approx(mean.semi_major_axis, abs=1e-6)
    assert back.inclination == pytest.approx(mean.inclination, abs=1e-13)


def test_a_rotor_that_breaks_loose_within_a_step_has_a_way():
    """Stiction 1 mN m: a motor on its way to 2 mN m breaks it loose, one to 0.5 mN m
    does not."""
    motor = (1e-3, 0.5, 0.0, 1e-4, 1.0, 0.0, 1e-3, 0.1)
    for command, way in ((2e-3, 1.0), (-2e-3, -1.0), (5e-4, 0.0)):
        after, lasted, _ = rotor._standing(
            motor, (0.0, 0.0, 0.0, 0.0), command, (0.0, 0.0), 1.0
        )
        assert (after[3], lasted < 1.0) == (way, way != 0.0)


def test_coils_that_are_off_are_allowed():
    block = fresh("manager_mixed_mode")
    block.m_limit = 0.0
    block.check()


# --- what is mutated ------------------------------------------------------------------


def test_what_landed_is_of_other_code_not_of_another_layout():
    old = "def f(x):\n    return g(2.0, x)\n"
    new = "def f(x):\n    y = (\n        3.0\n    )\n    return g(\n        2.0, x)\n"
    known = {code for code, _ in statements_of(old)}
    landed = [list(lines) for code, lines in statements_of(new) if code not in known]
    assert landed == [[2, 3, 4]]
