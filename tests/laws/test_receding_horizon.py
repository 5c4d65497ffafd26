"""The receding horizon: the bound that it stands on, and what it does without a plan."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from desat.analyses import lower_bound
from desat.components.contract.block import BlockError
from desat.components.laws import (
    receding_horizon,
)
from desat.components.maths import vector
from desat.components.maths.attitude import rotate
from desat.components.maths.least_effort import least_effort
from desat.components.physics import (
    torques,
)
from desat.fmus.registry import block_class
from desat.runs.cases import draft_to_draw
from desat.runs.prepare import read
from desat.runs.run import Options, execute
from tests.contract.test_block import begin, fresh

number = st.floats(-1, 1, allow_nan=False)
triple = st.tuples(number, number, number)
torque = triple.map(lambda v: vector.scale(0.05, v))
most = st.floats(0, 100)


# --- the receding horizon -------------------------------------------------------------


def modes(run) -> set[int]:
    return set(run.results.values("manager.mode").tolist())


def cheapest(goal, columns, cost, most) -> float | None:
    """The least effort by HiGHS; None where there is no plan."""
    matrix = np.array(columns).T
    tight = dict.fromkeys(
        ("primal_feasibility_tolerance", "dual_feasibility_tolerance"), 1e-10
    )
    solution = linprog(
        np.array(cost * 2),
        A_eq=np.hstack([matrix, -matrix]),
        b_eq=goal,
        bounds=[(0.0, m) for m in most * 2],
        method="highs-ds",
        options=tight,
    )
    return float(solution.fun) if solution.status == 0 else None


def as_cheap(goal, columns, cost, most) -> bool:
    """Our plan keeps all limits and is as cheap as that of HiGHS; true where both have
    one."""
    x, least = (
        least_effort(columns, cost, most, goal),
        cheapest(goal, columns, cost, most),
    )
    assert (x is None) == (least is None)
    if x is None or least is None:
        return False
    assert np.array(x) @ np.array(columns) == pytest.approx(np.array(goal), abs=1e-10)
    assert np.all(np.abs(x) <= most)
    assert np.abs(x) @ np.array(cost) == pytest.approx(least, rel=1e-9, abs=1e-9)
    return True


@settings(max_examples=60)
@given(
    seed=st.integers(0, 2**32),
    n=st.integers(1, 60),
    turn=st.sampled_from([0.0, 0.01]),
    still=st.booleans(),
    dead=st.sampled_from([0, 1, 2, None]),
    zero=st.booleans(),
    size=st.sampled_from([0.0, 1e-3, 0.1, 1.0, 10.0, 60.0]),
    reserve=st.sampled_from([0.0, 8.0, 10.0]),
)
def test_a_plan_is_as_cheap_as_that_of_highs(
    seed, n, turn, still, dead, zero, size, reserve
):
    """With attitude and field that stand still, so that many plans cost the same, dead
    coils, goals along an axis, no goal, and goals that are too far."""
    rng = np.random.default_rng(seed)
    h = rng.normal(size=3) * (1.0, 0.0 if zero else 1.0, 0.0 if zero else 1.0)
    h *= size / max(np.linalg.norm(h), 1e-9)
    u = 1.0 + turn * np.arange(n + 2)
    q = tuple((0.0, math.sin(a / 2), 0.0, math.cos(a / 2)) for a in u)
    b = np.array([23e-6 * np.cos(u), 2.4e-6 + 0 * u, 46e-6 * np.sin(u)]).T[1:-1]
    fields = tuple(map(tuple, (b[:1].repeat(n, axis=0) if still else b).tolist()))
    limit = tuple(0.0 if axis == dead else 36.0 for axis in range(3))
    level = (0.04, 0.02, 0.04)
    start, torque = tuple(h.tolist()), (1e-5, 0.0, 0.0)
    as_cheap(
        receding_horizon.goal(start, (0.0, 0.0, 0.0), q, torque, 0.04, 10.0),
        receding_horizon.columns(q, fields, limit, level, 10.0),
        receding_horizon.costs(n),
        receding_horizon.bounds(n, (10.0, reserve)),
    )


@pytest.mark.parametrize(
    ("scenario", "h"),
    [
        ("beyond-receding_horizon-ilqr-1", None),
        ("robust-receding_horizon-dead_known", None),
        ("beyond-receding_horizon-ilqr-1", [24.0, 3.0, -12.0]),
    ],
)
def test_the_plans_of_a_run_are_as_cheap(scenario, h, monkeypatch):
    comparisons = []

    def compare_effort(columns, cost, most, goal):
        comparisons.append(as_cheap(goal, columns, cost, most))
        return least_effort(columns, cost, most, goal)

    monkeypatch.setattr(receding_horizon, "least_effort", compare_effort)
    execute(
        f"uosat12/{scenario}",
        Options(blocks=True, values={"spacecraft.h_start_body": h} if h else {}),
    )
    assert comparisons.count(True) == (60 if h else 120), (
        "without the reserve, and with it if that can be"
    )
    assert False in comparisons, (
        "where the reserve is needed the first programmes have no plan"
    )


def test_a_plan_that_is_unique_is_that_of_highs():
    """Costs that differ everywhere: one plan alone is the cheapest."""
    rng = np.random.default_rng(4)
    columns = tuple(map(tuple, rng.normal(size=(300, 3)).tolist()))
    cost, most = tuple(rng.uniform(0.5, 2.0, 300).tolist()), (1.0,) * 300
    goal = (30.0, -20.0, 50.0)
    x = least_effort(columns, cost, most, goal)
    matrix = np.array(columns).T
    solution = linprog(
        cost * 2, A_eq=np.hstack([matrix, -matrix]), b_eq=goal, bounds=(0, 1)
    )
    assert x == pytest.approx(solution.x[:300] - solution.x[300:], abs=1e-9)


@pytest.mark.parametrize("case", [1, 2, 3])
def test_receding_horizon_stands_on_the_bound(case):
    run = execute(f"uosat12/beyond-receding_horizon-ilqr-{case}", Options(blocks=True))
    numbers = {k: n["value"] for k, n in run.manifest["numbers"].items()}
    dct = execute(f"uosat12/table3-dct-ilqr-{case}", Options(blocks=True)).manifest[
        "numbers"
    ]
    assert numbers["firing_time"] <= 1.01 * numbers["bound"]
    assert numbers["final_momentum"] <= 0.002
    assert numbers["firing_time"] <= 0.6 * dct["firing_time"]["value"]
    assert modes(run) == {2}
    assert np.abs(run.results.values("manager.m_cmd_body")).max() <= 36.0


CONDITIONS = [
    *(
        ("robust", c, percent, remaining)
        for c, percent, remaining in (
            ("torque", 1.0, 0.004),
            ("noise", 1.0, 0.003),
            ("dead_known", 1.0, 0.002),
            ("dead_unknown", 6.0, 0.02),
        )
    ),
    *(("robust-model", c, 2.0, 0.003) for c in ("weak", "strong", "untilted")),
]


@pytest.mark.parametrize(("file", "condition", "percent", "remaining"), CONDITIONS)
def test_receding_horizon_with_something_wrong(file, condition, percent, remaining):
    run = execute(f"uosat12/{file}-receding_horizon-{condition}", Options(blocks=True))
    numbers = run.manifest["numbers"]
    assert numbers["above_bound"]["value"] <= percent
    assert numbers["final_momentum"]["value"] <= remaining
    assert modes(run) == {2}


def test_too_much_momentum_falls_back_and_says_so():
    run = execute(
        "uosat12/beyond-receding_horizon-ilqr-1",
        Options(blocks=True, values={"spacecraft.h_start_body": [60.0, 0.0, 0.0]}),
    )
    assert modes(run) == {3}
    assert run.ok
    assert run.manifest["numbers"]["final_momentum"]["value"] < 60.0 - 0.04 * 590
    assert "bound" not in run.manifest["numbers"], "no plan dumps that in time"


@pytest.mark.parametrize(
    ("cost", "doing", "remaining", "above"),
    [(0.5, {2, 3}, 0.003, 0.01), (1e9, {2}, 0.002, 0.1)],
)
def test_near_the_most_that_can_be_dumped_the_reserve_is_used(
    cost, doing, remaining, above
):
    """Kept while that is cheap, firing stands on the bound, and the last samples have
    no plan; kept at any price, each has one, for a twelfth more."""
    run = execute(
        "uosat12/beyond-receding_horizon-ilqr-1",
        Options(
            blocks=True,
            values={
                "spacecraft.h_start_body": [24.0, 3.0, -12.0],
                "manager.reserve_cost": cost,
            },
        ),
    )
    numbers = {k: n["value"] for k, n in run.manifest["numbers"].items()}
    assert modes(run) == doing
    assert numbers["final_momentum"] <= remaining
    assert numbers["firing_time"] <= (1.0 + above) * numbers["bound"]
    thrust = np.abs(run.results.values("manager.tau_cmd_thruster_body"))
    assert thrust.max() > 0.8 * 0.04 + 1e-9


def test_after_the_horizon_it_is_idle():
    run = execute(
        "uosat12/beyond-receding_horizon-ilqr-2", Options(blocks=True, stop=640.0)
    )
    mode = run.results.values("manager.mode").tolist()
    assert mode == [2] * 60 + [0] * 4
    assert not run.results.values("manager.m_cmd_body")[60:].any()
    assert not run.results.values("manager.tau_cmd_thruster_body")[60:].any()


def test_the_end_may_be_a_bias():
    target = [0.3, -0.2, 0.1]
    run = execute(
        "uosat12/beyond-receding_horizon-ilqr-3",
        Options(blocks=True, values={"manager.h_target_body": target}),
    )
    h = run.results.values("spacecraft.h_copy_wheel")[-1, :3]
    assert h == pytest.approx(target, abs=0.002)
    lower = lower_bound.of_run(run.manifest, run.results)
    assert lower.final_momentum <= 0.002
    assert lower.seconds <= 1.01 * lower.least


def initialise_block(name, **parameters):
    block = block_class(name)()
    for key, value in parameters.items():
        assert hasattr(block, key)
        setattr(block, key, value)
    block.check()
    block.start()
    return block


@pytest.mark.parametrize("model", ["orbit_dipole", "dipole", "igrf"])
def test_the_field_ahead_is_the_environments(model):
    """A manager's own models, on two-body motion, against the environments' blocks."""
    choices = ("orbit_dipole", "dipole", "igrf")
    if model == "orbit_dipole":
        environment = initialise_block(
            "environment_orbit_dipole", inclination=1.2, raan=0.7, phase=0.4
        )
    else:
        environment = initialise_block(
            "environment_kepler",
            semi_major_axis=7.1e6,
            eccentricity=0.01,
            inclination=1.2,
            raan=0.7,
            mean_anomaly=2.0,
            field={"dipole": 1, "igrf": 2}[model],
            igrf_degree=6,
            epoch_j2000=8.2e8,
        )
    environment.output(0.0)
    manager = initialise_block(
        "manager_receding_horizon",
        field_model=choices.index(model),
        igrf_degree=6,
        epoch_j2000=8.2e8,
        field_spread=0.0,
    )
    manager.r_eci, manager.v_eci = environment.r_eci, environment.v_eci
    n = 60
    q, ahead = manager._predict_course(0.0, n)
    manager.b_body = truth = rotate(q[0], environment.b_eci)
    q, ahead = manager._predict_course(0.0, n)
    assert len(q) == n + 2
    assert np.linalg.norm(ahead[0]) == pytest.approx(np.linalg.norm(truth), rel=0.02)
    for k in (0, 1, 30, 59):
        t = 10.0 * k + 5.0
        environment.advance(t - 10.0, 10.0)  # keeps its nodes
        environment.output(t)
        body_field = rotate(q[k + 1], environment.b_eci)
        assert ahead[k] == pytest.approx(body_field, abs=2e-10)


def test_a_plan_needs_samples():
    with pytest.raises(BlockError, match="sample_time = 0 s"):
        initialise_block("manager_receding_horizon", sample_time=0.0)
    with pytest.raises(
        BlockError, match=r"horizon = 600 s is more than 600 samples of .* 0.9 s"
    ):
        initialise_block("manager_receding_horizon", sample_time=0.9)
    with pytest.raises(BlockError, match=r"epoch_j2000 = 3150000000 s"):
        initialise_block("manager_receding_horizon", field_model=2, epoch_j2000=3.15e9)


@pytest.mark.parametrize("start", [1, 2, 3])
def test_in_flight(start):
    """On the rigid body with noise: near the bound, and the craft keeps pointing."""
    run = execute(f"uosat12/flight-receding_horizon-{start}", Options(blocks=True))
    numbers = {k: n["value"] for k, n in run.manifest["numbers"].items()}
    assert numbers["above_bound"] <= 3.0
    assert numbers["final_momentum"] <= 0.02
    assert numbers["pointing"] <= 0.7
    assert numbers["momentum_residual"] <= 1e-9
    assert modes(run) == {2}


UPRIGHT = (0.0, 0.0, 0.0, 1.0)

COILS, LEVEL, PERIOD = (36.0, 36.0, 36.0), (0.04, 0.04, 0.04), 10.0


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
    on_times = [-(a + PERIOD * n) / 0.04 for a, n in zip(h, n_con, strict=True)]
    assert step[1] == pytest.approx(on_times, abs=1e-6)


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


@pytest.mark.parametrize(("is_valid", "h"), [(False, 0.5), (True, 50.0)])
def test_what_is_done_without_a_plan(is_valid, h):
    """No field: thrusters alone give -h rate, with a rate that is enough for the time
    that is left. A field, but more momentum than any plan can take: coils help, and no
    thruster gives more than its share of a sample."""
    block = fresh("manager_receding_horizon")
    block.horizon, block.g_rate = 100.0, 1e-4
    begin(block)
    block.b_body, block.valid_b = (2e-5, 0.0, 3e-5), is_valid
    torque, (m, n_t) = block.dump(0.0, 50.0, (0.0, h, 0.01))
    assert block.mode == 3
    most = block.thruster_duty * block.tau_level[1]
    if is_valid:
        assert n_t[1] == pytest.approx(-most)
        assert np.cross(m, block.b_body)[1] < 0.0
    else:
        assert m == (0.0, 0.0, 0.0)
        assert torque == pytest.approx(
            (0.0, -min(h / 50.0, most), -0.01 / 50.0), rel=0.06
        )
    assert torque == pytest.approx(tuple(np.cross(m, block.b_body) + n_t))


@pytest.mark.parametrize(("period", "fails"), [(0.0, True), (0.5, False), (1.0, False)])
def test_a_plan_needs_samples_within_its_horizon(period, fails):
    block = fresh("manager_receding_horizon")
    block.sample_time, block.horizon = period, 20.0
    if fails:
        with pytest.raises(BlockError, match="sample_time = 0 s"):
            block.start()
    else:
        block.start()


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
    for b, measurement in zip(model[:50], truth[:50], strict=True):
        fit = receding_horizon.learnt(fit, tuple(b), tuple(measurement))
        course_ahead = tuple(tuple(x) for x in model[50:])
        ahead = receding_horizon.correct_fields(fit, course_ahead, 0.1, 1e-6)
        errors.append(np.abs(np.array(ahead) - truth[50:]).max())
    assert np.abs(model[50:] - truth[50:]).max() > 5e-6
    assert errors[0] < np.abs(model[50:] - truth[50:]).max(), (
        "one measurement helps already"
    )
    assert errors[-1] < 1e-6


def test_no_measurement_leaves_the_model_as_it_is():
    b = [(1e-5, 2e-5, -3e-5), (0.0, 1e-5, 0.0)]
    assert receding_horizon.correct_fields(
        receding_horizon.NO_FIT, tuple(b), 0.1, 1e-6
    ) == tuple(b)


CLIFF = [("robust-model", "b_y_3", 10), ("robust", "yaw", 19)]


@pytest.mark.parametrize(("file", "case", "draw"), CLIFF)
def test_a_wrong_model_costs_little_once_it_is_learnt(file, case, draw):
    """The draws that cost 23 and 30 % more while the plan trusted its model and kept
    its reserve at any price."""
    from desat.campaign.sampling import draw_of

    name = f"uosat12/{file}-receding_horizon-{case}"
    start = draw_of(draft_to_draw(read(name), True), 1, draw)

    def above(spread, cost):
        own_value = {"manager.field_spread": spread, "manager.reserve_cost": cost}
        run = execute(name, Options(blocks=True, values={**start, **own_value}))
        return run.manifest["numbers"]["above_bound"]["value"]

    assert above(0.1, 0.5) <= 5.0
    assert above(0.1, 1e9) <= 5.0
    assert above(0.0, 1e9) >= 10.0


def test_the_gravity_gradient_of_later_is_that_of_free_fall():
    block = fresh("manager_closed_loop")
    begin(block)
    block.r_eci, block.v_eci, block.q_bi = (
        (7e6, 1e5, 0.0),
        (100.0, 5300.0, 5300.0),
        UPRIGHT,
    )
    (r, _), *_ = receding_horizon.coast(block.r_eci, block.v_eci, (120.0,))
    gravity_torque = torques.gravity_gradient(r, block._inertia)
    assert block._gravity_in(120.0) == pytest.approx(gravity_torque, rel=2e-3)


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
