"""Paper 004: the law's functions, the manager, short runs, and the stored draws' bands."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import python
from hypothesis import given
from hypothesis import strategies as st
from test_blocks import begin, fresh

from desat.components.laws import integrated
from desat.components.laws.margins import pid_margins
from desat.components.maths.vector import cross, dot, norm, sub
from desat.components.physics.wheel_array import body_momentum, pseudo_inverse, to_wheels
from desat.files.scenario import find
from desat.study import derived, measures, stored
from desat.study.case import Options, execute
from desat.study.tables import rows

S = 1.0 / math.sqrt(3.0)
PYRAMID = (S, -S, -S, S, S, S, -S, -S, S, S, S, S)
B = (2e-5, -1e-5, 3e-5)
H_MAX = 0.02

component = st.floats(-1.0, 1.0)
vectors = st.tuples(component, component, component).filter(lambda v: norm(v) > 1e-2)
fields = vectors.map(lambda v: tuple(4e-5 * x for x in v))
momenta = st.tuples(*[st.floats(-H_MAX, H_MAX)] * 4)


# --- the law ----------------------------------------------------------------------------------


@given(vectors, fields, st.floats(1e-3, 1.0), st.floats(1e-6, 1e-2))
def test_desaturation_is_across_the_field_takes_momentum_and_stays_within_its_limit(
    h, b, gain, limit
):
    t = integrated.desaturation(h, b, gain, limit)
    assert norm(t) <= limit * (1 + 1e-12)
    assert abs(dot(t, b)) <= 1e-14 * norm(b)
    assert dot(t, h) <= 1e-15
    free = integrated.desaturation(h, b, gain, math.inf)
    along = dot(h, b) / dot(b, b)
    across = sub(h, tuple(along * x for x in b))
    assert free == pytest.approx(tuple(-gain * x for x in across), abs=1e-9 * gain)
    assert norm(cross(t, free)) <= 1e-14 * norm(t)  # the limit keeps the direction


def test_desaturation_and_dipole_are_zero_without_a_field():
    assert integrated.desaturation((1.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0, 1.0) == (0.0, 0.0, 0.0)
    assert integrated.dipole((1.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0) == (0.0, 0.0, 0.0)


@given(vectors, fields, st.floats(0.01, 10.0))
def test_dipole_gives_the_part_of_the_torque_across_the_field(t, b, limit):
    torque = tuple(1e-5 * x for x in t)
    m = integrated.dipole(torque, b, math.inf)
    along = dot(torque, b) / dot(b, b)
    assert cross(m, b) == pytest.approx(
        sub(torque, tuple(along * x for x in b)), abs=1e-9 * norm(torque)
    )
    bounded = integrated.dipole(torque, b, limit)
    assert max(map(abs, bounded)) <= limit * (1 + 1e-12)
    assert norm(cross(bounded, m)) <= 1e-12 * norm(m)


@given(momenta)
def test_null_vector_turns_no_body_and_completes_the_pseudo_inverse(h):
    n = integrated.null_vector(PYRAMID)
    assert n == pytest.approx((1.0, -1.0, 1.0, -1.0), abs=1e-12)
    assert norm(body_momentum(PYRAMID, n)) < 1e-12
    t = integrated.null_torque(h, n, 1e-3, math.inf)
    assert norm(body_momentum(PYRAMID, t)) < 1e-12
    rest = to_wheels(pseudo_inverse(PYRAMID), body_momentum(PYRAMID, h))
    assert t == pytest.approx([-1e-3 * (x - y) for x, y in zip(h, rest, strict=True)], abs=1e-15)
    assert max(map(abs, integrated.null_torque(h, n, 1.0, 1e-5))) <= 1e-5 * (1 + 1e-12)


def test_three_wheels_or_wheels_in_one_plane_have_no_null_vector():
    three = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    plane = (1.0, -1.0, 0.0, S, 0.0, 0.0, 1.0, S, 0.0, 0.0, 0.0, 0.0)
    for axes in (three, plane):
        assert integrated.null_vector(axes) == integrated.NO_NULL_SPACE
    assert integrated.null_torque((1.0, 1.0, 1.0, 1.0), integrated.NO_NULL_SPACE, 1.0, 1.0) == (
        integrated.NO_NULL_SPACE
    )


def test_null_vector_of_uneven_axes():
    axes = np.array([[1.0, 0.0, 0.0, S], [0.0, 1.0, 0.0, S], [0.0, 0.0, 1.0, S]])
    n = integrated.null_vector(tuple(axes.ravel()))
    assert np.allclose(axes @ n, 0.0, atol=1e-12)
    assert max(map(abs, n)) == pytest.approx(1.0)


def test_thresholds_hold_in_between_and_look_at_the_size():
    off, on = (False,) * 4, (True,) * 4
    h = (0.05, 0.105, 0.2, -0.2)
    assert integrated.unloading(off, h, 0.1, 0.11) == (False, False, True, True)
    assert integrated.unloading(on, h, 0.1, 0.11) == (False, True, True, True)
    # eq. 23 as printed: a wheel that turns backwards is below any threshold
    assert integrated.unloading(on, h, 0.1, 0.11, paper_signed=True) == (False, True, True, False)


# --- margins ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("beta", "p", "d", "degrees"),
    [(1e-2, 1, 10, 65.2), (1e-2, 3, 20, 70.5), (1e-2, 1, 3, 22.5), (1e-3, 1, 3, 2.6)],
)
def test_phase_margins_of_eq_12(beta, p, d, degrees):
    found = pid_margins(p * beta, d * beta, beta / 500)
    assert found.phase == pytest.approx(degrees, abs=0.1)
    # against the poles: with exactly the delay that the loop bears, it oscillates at the crossover
    w, delay = found.crossover, found.delay
    s = 1j * w
    loop = (d * beta * s + p * beta / 2 + beta / 1000 / s) / s**2 * np.exp(-s * delay)
    assert loop == pytest.approx(-1.0, abs=1e-9)


def test_gain_margins_are_where_the_characteristic_polynomial_crosses_the_axis():
    kp, kd, ki = 1e-2, 0.1, 2e-5
    found = pid_margins(kp, kd, ki)
    assert found.gain_up == math.inf
    g = 10 ** (-found.gain_down / 20)
    roots = np.roots([1.0, g * kd, g * kp / 2, g * ki / 2])
    assert abs(roots.real).min() < 1e-9
    late = pid_margins(kp, kd, ki, 0.25)
    assert late.phase == pytest.approx(found.phase - math.degrees(0.25 * found.crossover))
    assert 20 < late.gain_up < 60


# --- the manager ------------------------------------------------------------------------------


def manager(**values):
    made = fresh("manager_integrated")
    for key, value in {"axes_wheel": PYRAMID, **values}.items():
        assert hasattr(made, key)
        setattr(made, key, value)
    return begin(made)


def stepped(block, t=0.0, **values):
    for key, value in values.items():
        setattr(block, key, value)
    block.advance(t, 0.5)
    return block


def test_the_wheels_get_what_the_equations_say():
    tau, omega, h = (1e-5, -2e-6, 3e-6), (1e-3, 2e-3, -1e-3), (0.01, -0.005, 0.004, 0.008)
    block = stepped(manager(), b_body=B, tau_ctrl_body=tau, omega_bi_body=omega, h_wheel=h)
    a = np.reshape(PYRAMID, (3, 4))
    stored_h = a @ h
    t_des = integrated.desaturation(tuple(stored_h), B, 0.05, 1.2e-5)
    wanted = np.linalg.pinv(a) @ (
        np.array(t_des) - 0.75 * np.array(tau) - np.cross(omega, stored_h)
    )
    assert block.tau_cmd_wheel == pytest.approx(wanted, rel=1e-12)
    b = np.array(B)
    assert block.m_cmd_body == pytest.approx(np.cross(b, 0.25 * np.array(tau)) / (b @ b), rel=1e-12)
    assert block.mode == 1


@given(st.floats(0.0, 1.0))
def test_the_coils_give_the_share_k(k):
    tau = (1e-6, -2e-6, 3e-6)
    block = stepped(manager(magnetic_share=k), b_body=B, tau_ctrl_body=tau)
    b = np.array(B)
    assert block.m_cmd_body == pytest.approx(k * np.cross(b, tau) / (b @ b), rel=1e-12)
    given_by_wheels = -np.reshape(PYRAMID, (3, 4)) @ block.tau_cmd_wheel
    assert given_by_wheels == pytest.approx((1 - k) * np.array(tau), abs=1e-18)


def test_disabled_the_wheels_give_all_and_the_coils_nothing():
    block = manager(null_gain=1e-3)
    stepped(block, b_body=B, tau_ctrl_body=(1e-4, 0.0, 0.0), h_wheel=(0.019, 0.0, 0.0, 0.0))
    assert block.mode == 4
    stepped(block, 0.5, enable=False)
    assert block.m_cmd_body == (0.0, 0.0, 0.0)
    given_by_wheels = -np.reshape(PYRAMID, (3, 4)) @ block.tau_cmd_wheel
    assert given_by_wheels == pytest.approx([1e-4, 0.0, 0.0], abs=1e-18)
    assert block.mode == 0


def test_emergency_from_90_until_60_per_cent():
    block = manager()
    modes = []
    for k, share in enumerate((0.5, 0.89, 0.91, 0.7, 0.61, 0.59, 0.7)):
        stepped(block, 0.5 * k, b_body=B, h_wheel=(0.0, -share * H_MAX, 0.0, 0.0))
        modes.append(block.mode)
    assert modes == [1, 1, 4, 4, 4, 1, 1]


def test_in_the_emergency_the_coils_balance_what_the_wheels_give_away():
    block = stepped(manager(), b_body=B, h_wheel=(0.019, 0.019, 0.01, 0.0))
    assert block.mode == 4
    absorbed = np.reshape(PYRAMID, (3, 4)) @ block.tau_cmd_wheel
    assert np.cross(block.m_cmd_body, B) == pytest.approx(absorbed, abs=1e-15)
    stored_h = body_momentum(PYRAMID, block.h_wheel)
    assert dot(stored_h, tuple(absorbed)) < 0.0
    assert max(map(abs, block.m_cmd_body)) <= 0.3 * (1 + 1e-12)
    assert norm(tuple(absorbed)) > 3 * 0.25 * 1.2e-5  # than the integrated law at its limit


def test_velocity_dumping_begins_and_ends_at_its_rates():
    block = manager(velocity_dumping=True, rate_on=0.05, rate_off=0.01, magnetic_share=0.0)
    tau = (7e-6, 0.0, 0.0)
    modes = []
    for k, rate in enumerate((0.02, 0.06, 0.02, 0.005, 0.02)):
        stepped(block, 0.5 * k, b_body=B, tau_ctrl_body=tau, omega_bi_body=(0.0, rate, 0.0))
        given_by_wheels = -np.reshape(PYRAMID, (3, 4)) @ block.tau_cmd_wheel
        modes.append(block.mode)
        wanted = (0.0, -2e-3 * rate, 0.0) if block.mode == 5 else tau
        assert given_by_wheels == pytest.approx(wanted, abs=1e-15)
    assert modes == [0, 5, 5, 0, 0]


def test_the_bias_and_the_null_gain_hold_the_wheels_where_they_are_wanted():
    block = manager(null_gain=1e-3, h_null=0.005)
    stepped(block, b_body=B, h_wheel=(0.005, -0.005, 0.005, -0.005))
    assert block.tau_cmd_wheel == pytest.approx((0.0,) * 4, abs=1e-18)
    assert block.mode == 0
    stepped(block, 0.5, h_wheel=(0.0, 0.0, 0.0, 0.0))
    assert block.tau_cmd_wheel == pytest.approx((5e-6, -5e-6, 5e-6, -5e-6), rel=1e-9)


def test_thresholds_the_wrong_way_round_are_refused():
    with pytest.raises(ValueError, match=r"threshold_on = 0.05 is below threshold_off = 0.1"):
        manager(threshold_on=0.05)


# --- measures ---------------------------------------------------------------------------------


def attitude(axis, degrees):
    half = np.radians(np.asarray(degrees)) / 2.0
    return np.column_stack([*(np.sin(half) * a for a in axis), np.cos(half)])


def test_error_vector_is_the_rotation_vector():
    degrees = np.array([0.0, 1e-6, 10.0, 120.0, -170.0])
    reference = np.tile(attitude((0.0, 1.0, 0.0), [30.0]), (5, 1))
    x, y, z, w = attitude((1.0, 0.0, 0.0), degrees).T
    a, b, c, d = reference.T
    q = np.column_stack([
        w * a + z * b - y * c + x * d, -z * a + w * b + x * c + y * d,
        y * a - x * b + w * c + z * d, -x * a - y * b - z * c + w * d,
    ])  # fmt: skip
    found = derived.error_vector(-q, reference)
    assert found[:, 0] == pytest.approx(degrees, abs=1e-9)
    assert np.abs(found[:, 1:]).max() < 1e-9


def test_relative_error_leaves_out_what_is_constant_over_an_interval():
    times = np.arange(0.0, 100.0, 0.5)
    ref = attitude((1.0, 0.0, 0.0), np.zeros(200))
    wobble = np.where(np.arange(200) % 2 == 0, 1.0, -1.0)
    q = attitude((1.0, 0.0, 0.0), 5.0 + wobble)
    assert measures.pointing_relative(times, q, ref, interval=10.0) == pytest.approx(1.0)
    assert measures.pointing_relative(times, q, ref, interval=10.0, level=95.0) == pytest.approx(
        1.0
    )
    assert measures.pointing_mean(times, q, ref) == pytest.approx(5.0)
    assert measures.pointing_level(times, q, ref) == pytest.approx(6.0)


def test_settling_is_for_good():
    times = np.arange(6.0)
    h = np.array([[5.0], [1.0], [4.0], [1.0], [-1.0], [0.5]])
    assert measures.until_below(times, h, limit=2.0) == 3.0
    assert measures.until_below(times, h, limit=9.0) == 0.0
    assert measures.until_below(times, h, limit=0.1) == 5.0
    assert measures.first_reached(times, h, limit=4.0) == 0.0
    assert measures.first_reached(times, np.hstack([h[::-1], h[::-1]]), limit=4.0, count=2) == 3.0
    assert measures.sign_changes(times, h) == 2.0
    assert measures.share_below(times, h, limit=1.0) == pytest.approx(100.0 / 6.0)


def test_momentum_budget_adds_up():
    run = execute("integrated/mil-nadir", Options(stop=900.0, blocks=True))
    names = ("spacecraft.impulse_eci", "environment.b_eci", "spacecraft.q_bi",
             "torquers.m_mean_body")  # fmt: skip
    series = [run.results.values(n) for n in names]
    budget = derived.momentum_budget(run.results.times(), *series)
    off = execute("integrated/mil-nadir",
                  Options(stop=900.0, blocks=True, sets=["manager.enable=false"]))  # fmt: skip
    alone = np.linalg.norm(off.results.values("spacecraft.impulse_eci"), axis=1)
    # the disturbances found are those of the craft without coils, which turns a little otherwise
    assert budget[-1, 0] == pytest.approx(alone[len(budget) - 1], rel=0.2)
    assert budget[-1, 1] > 3.0 * budget[-1, 0]


# --- runs -------------------------------------------------------------------------------------


def short(name, **options):
    run = execute(f"integrated/{name}", Options(blocks=True, **options))
    assert run.ok
    return run.results


def test_what_leaves_the_wheels_is_linear_in_k():
    def rate(name):
        run = execute(f"integrated/{name}", Options(blocks=True))
        return run.manifest["numbers"]["net_torque"]["value"]

    unit = rate("share-0-1") / 0.1
    assert 50.0 < unit < 100.0  # t_DES is across B, the momentum is not
    assert rate("share-0-5") / 0.5 == pytest.approx(unit, rel=0.03)


def test_eq_23_as_printed_leaves_negative_wheels_as_they_are():
    size = {
        rule: np.abs(short(f"threshold-{rule}", stop=3600.0).values("wheels.h_wheel")[-1]).mean()
        for rule in ("magnitude", "signed")
    }
    assert size["signed"] > 0.7 * H_MAX
    assert size["magnitude"] < 0.65 * H_MAX


@pytest.mark.parametrize("gain", [1e-3, 4e-3])
def test_the_residual_tumble_is_the_limit_over_the_gain(gain):
    omega = short(
        "velocity-dumping", stop=1500.0, sets=[f"manager.gain_rate={gain}"]
    ).values("spacecraft.omega_bi_body")  # fmt: skip
    assert np.linalg.norm(omega[-1500:], axis=1).mean() == pytest.approx(3e-5 / gain, rel=0.1)


def test_the_paper_s_law_keeps_null_space_momentum_and_the_option_drains_it():
    n = np.array([1.0, -1.0, 1.0, -1.0])
    start = [0.006, -0.005, 0.006, -0.005]
    paper, option = (
        short("mil-nadir", stop=3000.0,
              sets=[f"wheels.h_start_wheel={','.join(map(str, start))}", f"manager.null_gain={g}"])
        .values("wheels.h_wheel")[-1] @ n / 4
        for g in (0.0, 2e-3)
    )  # fmt: skip
    assert paper == pytest.approx(0.0055, rel=0.02)
    assert abs(option) < 0.05 * 0.0055


def test_velocity_dumping_hands_over_to_pointing():
    run = execute("integrated/velocity-to-pointing", Options(stop=900.0, blocks=True))
    mode = run.results.values("manager.mode")
    dumping = np.flatnonzero(mode == 5)
    over = dumping[-1] + 1
    assert (mode[:over] == 5).all()  # no way back
    rate = np.linalg.norm(run.results.values("spacecraft.omega_bi_body"), axis=1)
    assert rate[0] > math.radians(9.0) > math.radians(1.1) > rate[over]
    assert run.manifest["numbers"]["settled"]["value"] < 600.0


def test_the_manager_is_replaced_by_one_source_and_its_parameters():
    swapped, usual = find("integrated/mil-cross-product").data, find("integrated/mil-nadir").data
    assert swapped["sources"] == {"manager": "manager_cross_product"}
    assert "sources" not in usual
    changed = {
        k for k in swapped["parameters"] if swapped["parameters"][k] != usual["parameters"][k]
    }
    assert changed == {"manager"}
    options = Options(stop=3000.0, blocks=True)
    run = execute("integrated/mil-cross-product", options)
    assert run.ok
    numbers = run.manifest["numbers"]
    assert numbers["momentum_residual"]["value"] < 1e-12
    assert numbers["pointing"]["value"] < 3.6
    assert numbers["wheels_end"]["value"] < numbers["wheels_start"]["value"]


def test_the_numpy_loop_of_the_benchmark_is_the_same_model():
    result = python(
        "import json; from benchmarks import monolith as m;"
        "print(json.dumps([m.compare(100.0), m.compare(100.0, nutation=0.02)]))"
    )
    assert result.returncode == 0, result.stderr
    usual, fine = json.loads(result.stdout)
    for ops in ("plain", "tuned"):
        assert fine[ops]["attitude_rad"] < 5e-8
        assert fine[ops]["wheel_momentum"] < 5e-10
        assert usual[ops]["attitude_rad"] < 5e-7, "the truncation of its RK4"


# --- the stored draws -------------------------------------------------------------------------


@pytest.fixture(scope="module")
def drawn():
    return stored.read("integrated")


@pytest.fixture
def current(drawn):
    """The stored draws, where they are of this code; `desat tables` says of others that they are
    not."""
    if old := stored.outdated(drawn):
        pytest.skip(f"draws of earlier code, `make papers` renews them: {', '.join(old)}")
    return drawn


def test_the_stored_draws_say_where_they_are_from(drawn):
    assert drawn["seed"] == stored.SEED
    assert {"desat", "numpy", "python"} <= set(drawn["versions"])
    for found in drawn["scenarios"].values():
        assert len(found["draws"]) >= 20
        for name, s in found["summary"].items():
            values = [d["numbers"][name] for d in found["draws"]]
            assert (s["min"], s["max"], s["n"]) == (min(values), max(values), len(values))
            assert s["median"] == np.median(values)


def test_every_band_of_the_draws_is_met(drawn):
    banded = 0
    for name, found in drawn["scenarios"].items():
        for entry in find(name).data.get("paper", {}).values():
            if "tolerance" not in entry:
                continue
            s = found["summary"][entry.get("number", entry["quantity"])]
            (low, high), (least, most) = entry["tolerance"], entry["each"]
            assert low <= s["median"] <= high, (name, entry["quantity"])
            assert least <= s["min"], (name, entry["quantity"])
            assert s["max"] <= most, (name, entry["quantity"])
            banded += 1
    assert banded >= 11


def test_a_stored_draw_comes_out_again(current):
    """The first draw of the shortest scenario, bit for bit."""
    from desat.study.case import load
    from desat.study.draws import drawn as values_of

    name = "integrated/velocity-dumping"
    values = values_of(load(name, blocks=True), current["seed"], 0)
    again = execute(name, Options(blocks=True, values=values)).manifest["numbers"]
    kept = current["scenarios"][name]["draws"][0]["numbers"]
    assert {k: again[k]["value"] for k in kept} == pytest.approx(kept, rel=1e-6)


def test_rows_of_draws_have_the_median_and_the_file_is_named(drawn, monkeypatch):
    """Without the scenarios that would have to run."""
    from desat.study import tables

    chosen = {n: s for n, s in tables.scenarios("integrated").items() if n in drawn["scenarios"]}
    monkeypatch.setattr(tables, "scenarios", lambda family: chosen)
    data = tables.as_json("integrated", rows("integrated", Options(), drawn=drawn),
                          stored.provenance(drawn, fresh=False))  # fmt: skip
    assert data["run"]["file"] == "docs/papers/integrated/draws.json"
    assert {"date", "seed", "versions"} <= set(data["run"])
    row = next(r for r in data["rows"] if r["quantity"] == "pointing")
    summary = drawn["scenarios"]["integrated/mil-nadir"]["summary"]["pointing"]
    assert row["ours"] == summary["median"]
    assert row["draws"]["n"] >= 20
    assert (row["draws"]["min"], row["draws"]["max"]) == (summary["min"], summary["max"])
    assert row["within"] is True
    lost = replace(rows("integrated", Options(), drawn=drawn)[0], draws=None)
    assert tables.shown(lost)["draws"] == ""
    assert json.dumps(data)
