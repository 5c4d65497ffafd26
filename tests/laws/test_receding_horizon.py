"""Bounded blends, the least firing time, the receding horizon: beyond paper 000."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog, lsq_linear

from desat.analyses import lower_bound
from desat.components.contract.block import BlockError
from desat.components.laws import blending, receding_horizon
from desat.components.laws.least_firing import least_firing
from desat.components.maths import vector
from desat.components.maths.attitude import rotate
from desat.components.maths.least_effort import least_effort
from desat.fmus.registry import block_class
from desat.runs.run import Options, execute
from desat.system.errors import DesatError

number = st.floats(-1, 1, allow_nan=False)
triple = st.tuples(number, number, number)
torque = triple.map(lambda v: vector.scale(0.05, v))
field = triple.filter(lambda v: vector.norm(v) > 0.1).map(
    lambda v: vector.scale(5e-5, v)
)
ratio = st.floats(1e6, 1e13)
most = st.floats(0, 100)
limits = st.tuples(most, most, most)

PULSE = 0.05
"""s; a plan holds its torques over 10 s at their mean, a pulse stands somewhere in them
"""


def q_matrix(b):
    """Eq. 5: M x B = Q M."""
    return np.array([[0, b[2], -b[1]], [-b[2], 0, b[0]], [b[1], -b[0], 0]])


# --- bounded blends -------------------------------------------------------------------


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
        blending.saturated(split, b, limit)
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


# --- the least firing time ------------------------------------------------------------


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
    proved = plan.price @ impulse - gain.sum() - np.abs(dipole @ plan.price).sum()
    assert proved == pytest.approx(plan.seconds, abs=1e-6)
    assert plan.seconds <= other + 1e-9
    step = 1e-6 * np.array([1.0, -2.0, 1.5])
    moved = least_firing(impulse + step, thrust, longest, dipole)
    assert moved is not None
    # the least seconds are convex in the impulse
    assert moved.seconds >= plan.seconds + plan.price @ step - 1e-9


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
    plan = least_firing(impulse, thrust, longest, dipole, bounded=False)
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


# --- the bound ------------------------------------------------------------------------

# an independent prototype, before this code
LEAST = {
    (0.0, -2.4e-6): (87.79, 81.55, 78.32),
    (36.0, -2.4e-6): (52.85, 40.06, 52.12),
    (40.0, -2.4e-6): (49.32, 35.55, 51.38),
    (36.0, 2.4e-6): (50.23, 42.91, 50.01),
    (40.0, 2.4e-6): (46.43, 38.80, 49.27),
}


def bound_of(name, **values):
    run = execute(name, Options(blocks=True, values=values))
    return lower_bound.of_run(run.manifest, run.results)


@pytest.mark.parametrize(("limit", "b_y"), LEAST)
def test_bounds_are_the_prototypes(limit, b_y):
    for case, seconds in zip((1, 2, 3), LEAST[limit, b_y], strict=True):
        found = bound_of(
            f"uosat12/table3-ocdc-ilqr-{case}",
            # rods of zero under a manager are refused
            **{
                "torquers.drive": "limited",
                "torquers.m_limit": max(limit, 1e-9),
                "environment.paper_b_y": b_y,
            },
        )
        assert found.least == pytest.approx(seconds, abs=0.011)


def test_a_pulsed_coil_is_bounded_by_its_duty_and_an_ideal_one_not():
    name = "uosat12/table3-dct-ilqr-1"
    assert bound_of(name).least == pytest.approx(52.85, abs=0.011)
    assert bound_of(name, **{"torquers.drive": "ideal"}).least == pytest.approx(
        0.0, abs=1e-9
    )
    dead = bound_of(name, **{"torquers.failed_coil": "2"}).least
    late = bound_of(
        name, **{"torquers.failed_coil": "2", "torquers.failed_from": 300.0}
    ).least
    assert 52.9 < late < dead < 87.79


def test_nozzles_as_the_axis_pairs_have_the_same_bound():
    """The default nozzles are one each way about every axis."""
    from desat.runs.prepare import read
    from desat.system.interface import interface_of_block

    pairs = execute("uosat12/table3-dct-ilqr-2", Options(blocks=True))
    expected = lower_bound.of_run(pairs.manifest, pairs.results)
    builder = read("uosat12/table3-dct-ilqr-2").builder(Options(blocks=True))
    nozzles = builder.components["thrusters"]
    nozzles.source = "resources/thrusters_nozzles.fmu"
    nozzles.parameters = {
        k: v for k, v in nozzles.parameters.items() if "tau_level" not in k
    }
    nozzles.interface = interface_of_block("thrusters_nozzles")
    system, _ = builder.check().or_raise()
    from desat.system.parameters import table

    thrusters = table(system.components.values())["thrusters"]
    manifest = replace(
        pairs.manifest, parameters={**pairs.manifest.parameters, "thrusters": thrusters}
    )
    found = lower_bound.of_run(manifest, pairs.results)
    assert found.least == pytest.approx(expected.least, rel=1e-9)


direction = triple.filter(lambda v: vector.norm(v) > 0.1).map(
    lambda v: vector.scale(2.45 / vector.norm(v), v)
)


@pytest.mark.parametrize(
    "method",
    ["dct", "ocdc", "bounded_quadratic", "bounded_one_norm", "receding_horizon"],
)
@settings(max_examples=6)
@given(
    direction, st.integers(0, 62).map(lambda k: 0.1 * k), st.sampled_from([0.0, 1e-4])
)
def test_no_law_beats_the_bound(method, h, phase, disturbance):
    run = execute(
        f"uosat12/starts-{method}",
        Options(
            blocks=True,
            values={
                "spacecraft.h_start_body": list(h),
                "environment.phase": phase,
                "spacecraft.tau_disturbance_body": [disturbance, 0.0, -disturbance],
            },
        ),
    )
    found = lower_bound.of_run(run.manifest, run.results)
    remaining = np.abs(run.results.values("spacecraft.h_copy_wheel")[-1]).sum()
    assert found.least_same_end <= found.seconds + PULSE
    assert found.least <= found.seconds + remaining / 0.04 + PULSE
    if method == "receding_horizon":
        above = (
            1.01 if disturbance == 0.0 else 1.04
        )  # it plans with the right torque, or without
        assert found.seconds <= found.least_same_end * above + PULSE
        assert found.final_momentum <= 0.002 + 10 * disturbance


def test_manifest_and_report_show_the_bound(desat, tmp_path):
    folder = tmp_path / "run"
    desat(
        "run",
        "uosat12/table3-ocdc-ilqr-2",
        "--out",
        str(folder),
        "--no-baseline",
        check=True,
    )
    numbers = json.loads((folder / "manifest.json").read_text())["numbers"]
    assert numbers["bound"]["value"] == pytest.approx(40.06, abs=0.011)
    above = 100 * (
        numbers["firing_time"]["value"] / numbers["bound_same_end"]["value"] - 1
    )
    assert numbers["above_bound"]["value"] == pytest.approx(above)
    assert numbers["above_bound"]["unit"] == "%"
    assert numbers["above_bound"]["title"] in (folder / "report.html").read_text()
    printed = json.loads(desat("bound", str(folder), "--json", check=True).stdout)
    assert printed["least"] == pytest.approx(numbers["bound"]["value"], rel=1e-12)
    assert printed["scenario"] == "uosat12/table3-ocdc-ilqr-2"
    again = json.loads(
        desat("bound", "uosat12/table3-ocdc-ilqr-2", "--json", check=True).stdout
    )
    assert again == printed


def test_what_has_no_bound_says_why(desat):
    result = desat("bound", "plant/light")
    assert result.returncode == 2
    assert "plant/light: no manager commands thrusters" in result.stderr
    name = "uosat12/table3-ocdc-ilqr-1"
    for options, text in (
        (Options(algorithm="jacobi"), "a run by jacobi"),
        (
            Options(record=("manager.*",)),
            "not recorded, and the bound needs it: environment.b_eci",
        ),
        (Options(every=2), "every step recorded"),
    ):
        options.blocks = True
        run = execute(name, options)
        with pytest.raises(DesatError, match=text):
            lower_bound.of_run(run.manifest, run.results)
        # a run's own is of all rows, also of those that are not kept
        assert ("bound" in run.manifest["numbers"]) == (options.every > 1)


# --- the receding horizon -------------------------------------------------------------


def modes(run) -> set[int]:
    return set(run.results.values("manager.mode").tolist())


def cheapest(goal, columns, cost, most) -> float | None:
    """The least effort by HiGHS; None where there is no plan."""
    matrix = np.array(columns).T
    tight = dict.fromkeys(
        ("primal_feasibility_tolerance", "dual_feasibility_tolerance"), 1e-10
    )
    found = linprog(
        np.array(cost * 2),
        A_eq=np.hstack([matrix, -matrix]),
        b_eq=goal,
        bounds=[(0.0, m) for m in most * 2],
        method="highs-ds",
        options=tight,
    )
    return float(found.fun) if found.status == 0 else None


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
    found = []

    def compared(columns, cost, most, goal):
        found.append(as_cheap(goal, columns, cost, most))
        return least_effort(columns, cost, most, goal)

    monkeypatch.setattr(receding_horizon, "least_effort", compared)
    execute(
        f"uosat12/{scenario}",
        Options(blocks=True, values={"spacecraft.h_start_body": h} if h else {}),
    )
    assert found.count(True) == (60 if h else 120), (
        "without the reserve, and with it if that can be"
    )
    assert False in found, (
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
    found = linprog(
        cost * 2, A_eq=np.hstack([matrix, -matrix]), b_eq=goal, bounds=(0, 1)
    )
    assert x == pytest.approx(found.x[:300] - found.x[300:], abs=1e-9)


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
    found = lower_bound.of_run(run.manifest, run.results)
    assert found.final_momentum <= 0.002
    assert found.seconds <= 1.01 * found.least


def begun(name, **parameters):
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
        environment = begun(
            "environment_orbit_dipole", inclination=1.2, raan=0.7, phase=0.4
        )
    else:
        environment = begun(
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
    manager = begun(
        "manager_receding_horizon",
        field_model=choices.index(model),
        igrf_degree=6,
        epoch_j2000=8.2e8,
        field_spread=0.0,
    )
    manager.r_eci, manager.v_eci = environment.r_eci, environment.v_eci
    n = 60
    q, ahead = manager._predicted(0.0, n)
    manager.b_body = truth = rotate(q[0], environment.b_eci)
    q, ahead = manager._predicted(0.0, n)
    assert len(q) == n + 2
    assert np.linalg.norm(ahead[0]) == pytest.approx(np.linalg.norm(truth), rel=0.02)
    for k in (0, 1, 30, 59):
        t = 10.0 * k + 5.0
        environment.advance(t - 10.0, 10.0)  # keeps its nodes
        environment.output(t)
        expected = rotate(q[k + 1], environment.b_eci)
        assert ahead[k] == pytest.approx(expected, abs=2e-10)


def test_a_plan_needs_samples():
    with pytest.raises(BlockError, match="sample_time = 0 s"):
        begun("manager_receding_horizon", sample_time=0.0)
    with pytest.raises(
        BlockError, match=r"horizon = 600 s is more than 600 samples of .* 0.9 s"
    ):
        begun("manager_receding_horizon", sample_time=0.9)
    with pytest.raises(BlockError, match=r"epoch_j2000 = 3150000000 s"):
        begun("manager_receding_horizon", field_model=2, epoch_j2000=3.15e9)


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
