"""Dumping by torquers alone (paper 000, eqs. 10-14, Fig. 2): laws, `desat design`,
scenarios."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import solve_continuous_are
from scipy.optimize import minimize
from typer.testing import CliRunner

from desat import cli
from desat.components.laws import magnetic, momentum_offline, riccati
from desat.components.laws import magnetic_offline as offline
from desat.files.scenario import find, scenarios
from desat.fmus.registry import block_class
from desat.papers.designs import making as design_module
from desat.runs.run import Options, execute
from desat.system.errors import DesatError
from tests.conftest import but, cross3

RATE, HORIZON = 1.0715e-3, 3000.0
NADIR = np.array([0.0, -RATE, 0.0])
PUSHED = np.array([1.7e-4, 9.0e-5, -3.0e-5])  # N_con of a boom, N m
START = np.array([1.0, 2.0, -1.0])
ONES = (1.0, 1.0, 1.0)

number = st.floats(-1, 1, allow_nan=False)
vector = st.tuples(number, number, number).map(np.array)
direction = vector.filter(lambda v: np.linalg.norm(v) > 0.1).map(
    lambda v: v / np.linalg.norm(v)
)
weight = st.tuples(*[st.floats(0.5, 2.0)] * 3)


def skew(v):
    x, y, z = v
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def field(t, phase=1.445):
    """Eq. 30, microtesla, B_y = +2.4."""
    u = phase + RATE * t
    return (23e-6 * np.cos(u), 2.4e-6, 46e-6 * np.sin(u))


def reach(t, r=ONES):
    q = -skew(field(t))
    return q @ np.diag(1 / np.array(r)) @ q.T


def solve_ode(slope, span, y, **options):
    return solve_ivp(slope, span, y, method="DOP853", rtol=1e-12, atol=1e-14, **options)


# --- the infinite horizon -------------------------------------------------------------


def flat(*matrices):
    return [tuple(np.asarray(m).ravel().tolist()) for m in matrices]


def infinite_gain(w, s, f):
    k = riccati.infinite_gain(*flat(w, s, f))
    return None if k is None else np.reshape(k, (3, 3))


def infinite_offset(k, w, s, n_con):
    return np.array(riccati.infinite_offset(*flat(k, w, s), tuple(n_con)))


@given(direction, direction, weight, st.tuples(*[st.floats(100.0, 1e4)] * 3))
def test_gain_is_scipys(omega, b, r, f):
    assume(abs(omega @ b) < 0.95)  # along omega nothing can be stabilised
    w, q = -skew(RATE * omega), -skew(3e-5 * b)
    s = q @ np.diag(1 / np.array(r)) @ q.T
    riccati_gain = solve_continuous_are(w, q, np.diag(f), np.diag(r))
    gain = infinite_gain(w, s, np.diag(f))
    assert np.linalg.norm(gain - riccati_gain) <= 1e-12 * np.linalg.norm(riccati_gain)


@given(st.integers(0, 2**31), st.floats(-8, 8), st.floats(-8, 8))
def test_gain_is_scipys_for_any_system(seed, scale_s, scale_f):
    stream = np.random.default_rng(seed)
    w, b, a = stream.normal(size=(3, 3, 3))
    s, f = b @ b.T + 0.1 * np.eye(3), a @ a.T + 0.1 * np.eye(3)
    riccati_gain = solve_continuous_are(w, np.linalg.cholesky(s), f, np.eye(3))
    # S -> S c / d, F -> F c d with W -> c W has K -> d K: any size is scaled away
    # inside
    c, d = 10.0 ** ((scale_s + scale_f) / 2), 10.0 ** ((scale_f - scale_s) / 2)
    gain = infinite_gain(c * w, c / d * s, c * d * f) / d
    assert np.linalg.norm(gain - riccati_gain) <= 1e-12 * np.linalg.norm(riccati_gain)


def test_no_gain_where_nothing_can_be_stabilised():
    w, f = -skew(NADIR), np.eye(3)
    assert infinite_gain(w, np.zeros((3, 3)), f) is None
    q = -skew((0.0, 3e-5, 0.0))  # field along omega
    assert infinite_gain(w, q @ q.T, 3000 * f) is None


@given(direction, direction, vector)
def test_offset_is_eq_11_at_rest(omega, b, n_con):
    assume(abs(omega @ b) < 0.9)
    w, q = -skew(RATE * omega), -skew(3e-5 * b)
    s = q @ q.T
    k = infinite_gain(w, s, 3000 * np.eye(3))
    g = infinite_offset(k, w, s, 1e-4 * n_con)
    rest = -(w - s @ k).T @ g + k @ (1e-4 * n_con)
    assert np.abs(rest).max() <= 1e-10 * max(np.abs(k @ (1e-4 * n_con)).max(), 1e-9)


# --- the finite horizon ---------------------------------------------------------------


TIMES = np.linspace(0.0, HORIZON, 61)
WEIGHT = (3000.0, 2000.0, 4000.0)
R = (1.0, 0.7, 1.5)


@pytest.fixture(scope="module")
def tables():
    return offline.gains(field, NADIR, WEIGHT, R, PUSHED, TIMES)


def test_gains_solve_the_two_point_boundary_problem(tables):
    """h' = W h - S p + N_con, p' = -F h - W'p, p(t_f) = 0, solved forwards, with no K
    and no g."""
    w, f, unit = -skew(NADIR), np.diag(WEIGHT), 1e6

    def slope(t, y):
        h, p = y[:3], unit * y[3:]
        return np.concatenate(
            (w @ h - reach(t, R) @ p + PUSHED, (-f @ h - w.T @ p) / unit)
        )

    def fly(start, from_h, to):
        return solve_ode(slope, (start, to), np.asarray(from_h)).y[:, -1]

    for i in (0, 20, 45):
        t = TIMES[i]
        free = fly(t, [*START, 0, 0, 0], HORIZON)
        effect = np.stack(
            [fly(t, [*START, *e], HORIZON)[3:] - free[3:] for e in np.eye(3)], axis=1
        )
        p = -unit * np.linalg.solve(effect, free[3:])
        costate = magnetic.lqr_costate(
            tuple(START), tuple(tables[0][i]), tuple(tables[1][i])
        )
        assert np.allclose(costate, p, rtol=0, atol=2e-7 * np.abs(p).max())
        assert np.linalg.norm(tables[1][i]) > 0.01 * np.linalg.norm(
            p
        )  # and g matters in it


def test_gains_obey_eq_11_as_full_matrices(tables):
    """All nine elements of K and g, integrated one by one: K stays symmetric."""
    w, f, unit = -skew(NADIR), np.diag(WEIGHT), 1e6

    def slope(t, y):
        k, g, s = unit * y[:9].reshape(3, 3), unit * y[9:], reach(t, R)
        dk = -k @ w - w.T @ k + k @ s @ k - f
        return np.concatenate((dk.ravel(), -(w - s @ k).T @ g + k @ PUSHED)) / unit

    y = (
        solve_ode(slope, (HORIZON, 0), np.zeros(12), t_eval=TIMES[::-1]).y.T[::-1]
        * unit
    )
    assert np.allclose(y[:, [1, 2, 5]], y[:, [3, 6, 7]], rtol=0, atol=1e-3)  # of 1e6
    largest = np.abs(y).max()
    assert np.allclose(tables[0], y[:, [0, 1, 2, 4, 5, 8]], rtol=0, atol=1e-8 * largest)
    assert np.allclose(tables[1], y[:, 9:], rtol=0, atol=1e-8 * np.abs(y[:, 9:]).max())


def test_gains_are_positive_and_vanish_at_the_end(tables):
    gain, offset = tables
    for row in gain:
        k = np.reshape(magnetic.full(tuple(row)), (3, 3))
        assert (k == k.T).all()
        assert np.linalg.eigvalsh(k).min() >= -1e-9 * np.abs(gain).max()
    assert not gain[-1].any()
    assert not offset[-1].any()
    without = offline.gains(field, NADIR, WEIGHT, R, np.zeros(3), TIMES)
    assert not without[1].any()
    assert np.allclose(
        without[0], gain, rtol=1e-6, atol=1e-3
    )  # N_con is no matter of K


def test_no_weight_no_gain():
    gain, offset = offline.gains(field, NADIR, (0.0, 0.0, 0.0), R, PUSHED, TIMES)
    assert not gain.any()
    assert not offset.any()


def test_between_the_nodes_the_error_is_bounded(tables):
    fine = np.linspace(0.0, HORIZON, 601)
    exact = offline.gains(field, NADIR, WEIGHT, R, PUSHED, fine)
    width, between = HORIZON / (len(TIMES) - 1), fine[1] - fine[0]
    for table, columns, truth in zip(tables, (6, 3), exact, strict=True):
        interpolation = np.array(
            [
                magnetic.interpolate_rows(
                    tuple(table.ravel()), columns, len(TIMES), HORIZON, t
                )
                for t in fine
            ]
        )
        curvature = np.abs(np.diff(truth, 2, axis=0)).max(axis=0) / between**2
        error = np.abs(interpolation - truth).max(axis=0)
        assert (
            error <= 1.1 * width**2 / 8 * curvature + 1e-9 * np.abs(truth).max()
        ).all()
        assert error.max() <= 0.002 * np.abs(truth).max()
        assert np.allclose(
            interpolation[::10], table, rtol=1e-14, atol=0
        )  # at a node: the node


def fly(law, h=START, n_con=PUSHED, horizon=HORIZON):
    """h(t_f), eq. 10's cost and eq. 32's energy of dipole = law(t, h), continuous."""

    def slope(t, y):
        m = np.array(law(t, y[:3]))
        cost = 0.5 * (y[:3] @ (np.array(WEIGHT) * y[:3]) + m @ (np.array(R) * m))
        dh = -cross3(NADIR, y[:3]) + cross3(m, field(t)) + n_con
        return [*dh, cost / 1e6, 0.5 * m @ m / 1e6]

    y = solve_ivp(
        slope, (0, horizon), [*h, 0, 0], method="DOP853", rtol=1e-8, atol=1e-10
    ).y[:, -1]
    return y[:3], 1e6 * y[3], 1e6 * y[4]


def lqr_of(tables, factor=1.0, offset=1.0):
    gain, g = factor * tables[0], offset * tables[1]
    nodes = len(gain)

    def law(t, h):
        k = magnetic.interpolate_rows(tuple(gain.ravel()), 6, nodes, HORIZON, t)
        p = magnetic.interpolate_rows(tuple(g.ravel()), 3, nodes, HORIZON, t)
        return magnetic.dipole(magnetic.lqr_costate(tuple(h), k, p), field(t), R)

    return law


def ilqr(t, h):
    w, s = -skew(NADIR), reach(t, R)
    k = infinite_gain(w, s, np.diag(WEIGHT))
    p = k @ h - infinite_offset(k, w, s, PUSHED)
    return magnetic.dipole(tuple(p), field(t), R)


def test_lqr_has_the_least_cost(tables):
    _, best, _ = fly(lqr_of(tables))
    fine = offline.gains(field, NADIR, WEIGHT, R, PUSHED, np.linspace(0, HORIZON, 601))
    _, exact, _ = fly(lqr_of(fine))
    assert best == pytest.approx(exact, rel=2e-5)  # what the table's few rows cost
    assert best > exact * (1 - 1e-7)
    for other in (
        ilqr,
        lqr_of(tables, 0.9),
        lqr_of(tables, 1.1),
        lqr_of(tables, 1.0, 0.0),
    ):
        assert fly(other)[1] > best * 1.0005


@settings(max_examples=20)
@given(vector, vector, st.tuples(*[st.floats(0.5, 2.0)] * 3), st.floats(600.0, 6000.0))
def test_mec_reaches_its_end(end, n_con, r, horizon):
    p = offline.costate(field, NADIR, r, 1e-4 * n_con, START, end, horizon)

    def slope(t, h):
        m = magnetic.dipole(
            magnetic.mec_costate(tuple(p), tuple(NADIR), t), field(t), r
        )
        return -cross3(NADIR, h) + cross3(m, field(t)) + 1e-4 * n_con

    h = solve_ivp(
        slope, (0, horizon), START, method="DOP853", rtol=3e-14, atol=1e-15
    ).y[:, -1]
    assert np.linalg.norm(h - end) <= 1e-12


def test_mec_needs_the_least_energy(tables):
    for law in (lqr_of(tables), ilqr, lqr_of(tables, 3.0)):
        end, _, energy = fly(law)
        p = offline.costate(field, NADIR, ONES, PUSHED, START, end, HORIZON)
        again, _, least = fly(
            lambda t, h, p=p: magnetic.dipole(
                magnetic.mec_costate(tuple(p), tuple(NADIR), t), field(t), ONES
            )
        )
        assert np.allclose(again, end, atol=1e-6)
        assert least < 0.9 * energy


@given(
    vector.filter(lambda v: np.linalg.norm(v) > 0.2),
    st.floats(0.05, 0.95),
    st.integers(0, 99),
)
def test_cheapest_end(free, share, seed):
    stream = np.random.default_rng(seed)
    a = stream.normal(size=(3, 3))
    effect, cost = stream.normal(size=(3, 3)) + 2 * np.eye(3), a @ a.T + 0.1 * np.eye(3)
    size = share * float(np.linalg.norm(free))
    end = offline.cheapest_end(free, effect, cost, size)
    assert np.linalg.norm(end) == pytest.approx(size, rel=1e-9)

    def price(h):
        p = np.linalg.solve(effect, h - free)
        return p @ cost @ p

    others = stream.normal(size=(50, 3))
    for h in size * others / np.linalg.norm(others, axis=1, keepdims=True):
        assert price(end) <= price(h) * (1 + 1e-9)


# --- the blocks -----------------------------------------------------------------------


def manager(name, **values):
    block = block_class(name)()
    inputs = {"b_body": (2e-5, 1e-5, -3e-5), "h_wheel": (1.0, -0.5, 0.3, 0.0)}
    vars(block).update(inputs, omega_bi_body=tuple(NADIR), sample_time=10.0, **values)
    block.check()
    block.start()
    return block


@pytest.mark.real_units
def test_ilqr_block_is_eq_11_with_scipys_gain():
    n_con, r, f, bias = (
        (1e-4, -2e-4, 5e-5),
        (1.0, 2.0, 0.5),
        (1000.0, 2000.0, 3000.0),
        0.1,
    )
    block = manager(
        "manager_magnetic_ilqr",
        saturation=False,
        n_con_body=n_con,
        dipole_weight=r,
        momentum_weight=f,
        h_target_body=(bias, 0.0, 0.0),
    )
    block.advance(0.0, 10.0)
    q, w = -skew(block.b_body), -skew(NADIR)
    s = q @ np.diag(1 / np.array(r)) @ q.T
    k = solve_continuous_are(w, q, np.diag(f), np.diag(r))
    g = np.linalg.solve((w - s @ k).T, k @ n_con)
    dipole = -np.diag(1 / np.array(r)) @ q.T @ (k @ [1.0 - bias, -0.5, 0.3] - g)
    assert np.allclose(block.m_cmd_body, dipole, rtol=1e-11)
    assert np.allclose(
        block.tau_cmd_wheel[:3],
        np.cross(block.m_cmd_body, block.b_body) - np.cross(NADIR, [1.0, -0.5, 0.3]),
        atol=1e-15,
    )
    assert block.mode == 1


@pytest.mark.real_units
@pytest.mark.parametrize("b", [(0.0, 0.0, 0.0), (0.0, 3e-5, 0.0)])
def test_ilqr_block_without_a_gain_does_not_dump(b):
    block = manager("manager_magnetic_ilqr", b_body=b)
    block.advance(0.0, 10.0)
    assert block.m_cmd_body == (0.0, 0.0, 0.0)
    assert block.mode == 0


@pytest.mark.real_units
def test_the_clock_of_a_design_starts_with_enable_and_ends_with_its_horizon():
    p = (4e5, -3e5, 2e5)
    block = manager(
        "manager_magnetic",
        law=1,
        saturation=True,
        m_limit=8.0,
        horizon=100.0,
        costate=p,
        omega_nominal_body=tuple(NADIR),
        enable=False,
    )
    block.advance(0.0, 10.0)
    assert (block.mode, block.m_cmd_body) == (0, (0.0, 0.0, 0.0))
    block.enable = True
    for k in range(1, 11):
        block.advance(10.0 * k, 10.0)
        requests = magnetic.dipole(
            magnetic.mec_costate(p, tuple(NADIR), 10.0 * (k - 1)), block.b_body, ONES
        )
        assert block.m_cmd_body == pytest.approx(np.clip(requests, -8, 8), abs=1e-12)
        assert max(map(abs, requests)) > 8.0
        assert block.mode == 1
    block.advance(110.0, 10.0)
    assert (block.mode, block.m_cmd_body) == (0, (0.0, 0.0, 0.0))


# --- Fig. 2 ---------------------------------------------------------------------------


LAWS, STARTS = ("lqr", "ilqr", "mec", "ccpl"), (1, 2, 3)


@pytest.fixture(scope="module")
def values():
    """name -> numbers of the paper's-model scenarios, by FMUs."""
    names = [n for n in scenarios("uosat12") if "/fig2-" in n and "flight" not in n]
    values_by_name = {}
    for name in names:
        run = execute(name, Options())
        assert run.ok
        values_by_name[name.removeprefix("uosat12/")] = {
            "end": run.results.values("spacecraft.h_copy_wheel")[-1][:3],
            **{k: n["value"] for k, n in run.manifest["numbers"].items()},
        }
        run.results.close()
    return values_by_name


@pytest.mark.real_units
@pytest.mark.parametrize("start", STARTS)
def test_mec_dumps_everything(values, start):
    assert values[f"fig2-least-zero-{start}"]["final_momentum"] <= 1e-12


@pytest.mark.real_units
@pytest.mark.parametrize("start", STARTS)
def test_fig_2_at_equal_final_momentum(values, start):
    """The paper: MEC consumes the least energy, and the energy cost of CCPL is the
    highest."""
    ends = [values[f"fig2-{law}-{start}"]["final_momentum"] for law in LAWS]
    assert ends == pytest.approx([0.05] * 4, abs=1e-11)
    lqr, ilqr, mec, ccpl = (
        values[f"fig2-{law}-{start}"]["dipole_energy"] for law in LAWS
    )
    assert mec < min(lqr, ilqr)
    assert ccpl > max(lqr, ilqr)


@pytest.mark.real_units
@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("law", ["lqr", "ilqr", "ccpl"])
def test_mec_is_least_among_laws_with_the_same_end(values, law, start):
    theirs, least = values[f"fig2-{law}-{start}"], values[f"fig2-least-{law}-{start}"]
    assert np.abs(least["end"] - theirs["end"]).max() <= 1e-12
    assert least["dipole_energy"] < theirs["dipole_energy"]
    # and MEC to the cheapest end of that size needs still less
    assert values[f"fig2-mec-{start}"]["dipole_energy"] <= least["dipole_energy"] * (
        1 + 1e-9
    )


@pytest.mark.real_units
def test_off_nadir_the_constant_torque_must_be_known(values):
    final = {
        n.removeprefix("fig2-offnadir-"): v["final_momentum"]
        for n, v in values.items()
        if "offnadir" in n
    }
    assert [final[law] for law in LAWS] == pytest.approx([0.05] * 4, abs=1e-11)
    assert final["mec-blind"] > 0.3
    assert final["lqr-blind"] > 0.06


def stored_design(name):
    """The file of a scenario's design."""
    return tomllib.loads(find(name).design.read_text(encoding="utf-8"))


def cost(name, f, **overrides):
    """Eq. 10 of a run in the paper's model, F = f I, R = I, per sample."""
    run = execute(name, Options(blocks=True, values=overrides))
    h = run.results.values("spacecraft.h_copy_wheel")[:-1]
    return (
        10.0 * 0.5 * f * (h**2).sum()
        + run.manifest["numbers"]["dipole_energy"]["value"]
    )


@pytest.mark.real_units
def test_lqr_costs_less_than_ilqr_and_than_itself_without_g():
    weight = stored_design("uosat12/fig2-lqr-1")["tuned"]["momentum_weight"]
    ilqr = cost(
        "uosat12/fig2-ilqr-1", weight, **{"manager.momentum_weight": [weight] * 3}
    )
    assert cost("uosat12/fig2-lqr-1", weight) < 0.99 * ilqr
    f = find("uosat12/fig2-offnadir-lqr-blind").content.design.momentum_weight[0]
    assert f == pytest.approx(
        stored_design("uosat12/fig2-offnadir-lqr")["tuned"]["momentum_weight"], 1e-6
    )
    assert cost("uosat12/fig2-offnadir-lqr", f) < cost(
        "uosat12/fig2-offnadir-lqr-blind", f
    )


@pytest.mark.real_units
@pytest.mark.parametrize("start", STARTS[:1])
def test_in_flight_feedback_keeps_what_open_loop_loses(start):
    final = {}
    for law in LAWS:
        run = execute(f"uosat12/fig2-flight-{law}-{start}", Options())
        numbers = {k: n["value"] for k, n in run.manifest["numbers"].items()}
        assert numbers["momentum_residual"] < 1e-12
        assert numbers["pointing"] < 0.2
        assert np.abs(run.results.values("torquers.m_mean_body")).max() <= 40.0
        final[law] = numbers["final_momentum"]
    assert max(final["lqr"], final["ilqr"]) < min(final["mec"], 0.25)
    feedback_run = execute(f"uosat12/fig2-flight-igrf-mec-{start}", Options())
    assert feedback_run.manifest["numbers"]["final_momentum"]["value"] == pytest.approx(
        0.05, abs=0.02
    )


# --- desat design ---------------------------------------------------------------------


@pytest.mark.real_units
@pytest.mark.parametrize(
    "name",
    ["fig2-mec-1", "fig2-ccpl-2", "fig2-least-ilqr-3", "fig2-offnadir-lqr-blind"],
)
def test_the_kept_design_is_what_the_command_computes(name):
    scenario = find(f"uosat12/{name}")
    result = design_module.design(scenario)
    text = design_module.text(scenario, result)
    if name == "fig2-mec-1":  # the others take seconds each
        assert text == design_module.text(scenario, design_module.design(scenario))
    file = stored_design(scenario.name)["parameters"]["manager"]
    assert list(file) == list(result.parameters)
    for key, value in result.parameters.items():
        assert np.asarray(file[key]) == pytest.approx(
            np.asarray(value), rel=1e-8, abs=1e-8
        )


@pytest.mark.real_units
def test_every_design_is_kept_and_none_is_left_over():
    assert set((design_module.ROOT / "uosat12" / "design").glob("*")) == {
        s.design for s in scenarios("uosat12").values() if s.design
    }


@pytest.fixture
def command(monkeypatch, tmp_path):
    """`desat design NAME`, its file in tmp_path, with [design] and manager parameters
    changed."""

    def run(name, *arguments, manager=(), **changes):
        def find_changed(scenario_name):
            scenario = find(scenario_name)
            if scenario_name != f"uosat12/{name}" or not (changes or manager):
                return scenario
            table = {
                k: v
                for k, v in {**scenario.content.written["design"], **changes}.items()
                if v is not None
            }
            parameters = dict(scenario.content.parameters)
            parameters["manager"] = {**parameters["manager"], **dict(manager)}
            content = but(scenario.content, design=table, parameters=parameters)
            return replace(scenario, content=content)

        monkeypatch.setattr(design_module, "find", find_changed)
        monkeypatch.setattr(design_module, "ROOT", tmp_path)
        return CliRunner().invoke(
            cli.app_for([]), ["design", f"uosat12/{name}", *arguments]
        )

    return run


@pytest.mark.real_units
def test_design_command(command, tmp_path):
    first = command("fig2-mec-2", "--json")
    assert first.exit_code == 0
    (entry,) = json.loads(first.stdout)
    file = tmp_path / "uosat12" / "design" / "fig2-mec-2.toml"
    assert entry["file"] == str(file)
    assert entry["reached"]["final_momentum"] == pytest.approx(0.05, abs=1e-12)
    text = file.read_text()
    assert text.startswith("# Computed by `desat design uosat12/fig2-mec-2`")
    assert "numpy" in text
    second = command("fig2-mec-2")
    assert "fig2-mec-2" in second.stdout
    assert file.read_text() == text
    assert not list(file.parent.glob("*.part"))


REFUSED = {
    "nodes is not for ccpl; known are final_momentum": ("fig2-ccpl-1", {"nodes": 9}),
    "nodes = 65: at most 64": ("fig2-lqr-1", {"nodes": 65}),
    "end_of = 'fig2-mec-1': the name of another": (
        "fig2-mec-1",
        {"end_of": "fig2-mec-1"},
    ),
    "no scenario uosat12/fig9": ("fig2-mec-1", {"end_of": "fig9"}),
    "final_momentum is needed": ("fig2-ccpl-1", {"final_momentum": None}),
    "momentum_weight or final_momentum needed": (
        "fig2-lqr-1",
        {"final_momentum": None},
    ),
    "the least is 0.0": ("fig2-ccpl-2", {"final_momentum": 1e-6}),
    "is reached without dumping": ("fig2-mec-2", {"final_momentum": 9.0}),
    "= 9 N m s is reached without dumping": ("fig2-ccpl-2", {"final_momentum": 9.0}),
    "no component moon": ("fig2-mec-1", {"assume": {"moon": {"x": 1}}}),
    "spacecraft has no variable inertai": (
        "fig2-mec-1",
        {"assume": {"spacecraft": {"inertai": 1}}},
    ),
    "uses the design of uosat12/fig2-lqr-1: run": ("fig2-flight-lqr-1", {}),
    "it has no [design]": ("table2-dct-ilqr-1", {}),
    "made in the paper's model": (
        "fig2-flight-mec-1",
        {"of": None, "final_momentum": 0.05},
    ),
}


@pytest.mark.real_units
@pytest.mark.parametrize("message", REFUSED)
def test_design_refuses(command, tmp_path, message):
    name, changes = REFUSED[message]
    result = command(name, **changes)
    assert isinstance(result.exception, DesatError)
    assert message in str(result.exception)
    assert "uosat12/" in str(result.exception)
    assert "\n" not in str(result.exception)
    assert not list(tmp_path.iterdir())


@pytest.mark.real_units
def test_design_refuses_a_bounded_mec_and_an_unknown_law(command):
    assert "manager.saturation = false" in str(
        command("fig2-mec-1", manager={"saturation": True}).exception
    )
    assert "no design for manager_cross_product normalised" in str(
        command("fig2-ccpl-1", manager={"law": "normalised"}).exception
    )


def test_design_command_ends_with_one_line(desat):
    result = desat("design", "uosat12/fig2-flight-mec-1")
    assert result.returncode == 2
    assert result.stderr.splitlines() == [
        "error: uosat12/fig2-flight-mec-1 uses the design of uosat12/fig2-mec-1: "
        "run `desat design uosat12/fig2-mec-1`"
    ]


def test_a_scenario_without_its_design_says_so(monkeypatch, tmp_path):
    from desat.files import scenario as scenario_module

    monkeypatch.setattr(scenario_module, "ROOT", tmp_path)
    with pytest.raises(DesatError, match="run `desat design uosat12/fig2-lqr-1`"):
        find("uosat12/fig2-flight-lqr-1").parameters()


@pytest.mark.parametrize(
    ("peak", "first", "dipole", "least"),
    [
        (2e-3, 0, np.inf, 0.999),
        (2e-3, 12, np.inf, 0.999),
        (2e-3, 12, 0.04, 0.89),
        (1e-3, 12, 0.1, 0.96),
        (5e-4, 12, 0.1, 0.97),
    ],
)
def test_the_least_energy_beside_a_general_solver(peak, first, dipole, least):
    """Wheels within a peak from a sample on, and coils within their limit; with the
    last of these limits the optimum is another than without. `least` is the bound's
    share of it: with a limit of the coils the bound is that of limits 2 % wider."""
    rng, count, dt = np.random.default_rng(5), 24, 100.0
    t = dt * np.arange(count)
    field = 3e-5 * np.stack(
        [np.cos(1e-3 * t), np.full(count, 0.3), 2.0 * np.sin(1e-3 * t)], axis=1
    )
    torque = np.array([1e-6, -5e-7, 8e-7]) + 1e-6 * rng.normal(size=(count, 3))
    identity = np.broadcast_to(np.eye(3), (count, 3, 3)).copy()
    course = momentum_offline.Course(dt, field, torque, identity, identity, identity)
    start = np.array([2e-3, -1e-3, 5e-4])
    most = np.where(np.arange(count) >= first, peak, 1.0)[:, None]
    drift = (start + np.cumsum(dt * torque, axis=0)).ravel()
    effect = np.zeros((3 * count, 3 * count))
    for k in range(count):
        for j in range(k + 1):
            effect[3 * k : 3 * k + 3, 3 * j : 3 * j + 3] = course.effect[j]
    scale, wide = 0.05, np.repeat(most, 3)
    within = [
        {
            "type": "ineq",
            "fun": lambda u, s=s: 1e3 * (wide - s * (drift + scale * effect @ u)),
            "jac": lambda u, s=s: -1e3 * s * scale * effect,
        }
        for s in (1.0, -1.0)
    ]
    bounds = [(-dipole / scale, dipole / scale)] * (3 * count)
    solution = minimize(
        lambda u: u @ u,
        np.zeros(3 * count),
        jac=lambda u: 2.0 * u,
        constraints=within,
        bounds=None if np.isinf(dipole) else bounds,
        method="SLSQP",
        options={"maxiter": 2000, "ftol": 1e-12},
    )
    assert solution.success
    optimum = solution.fun * scale**2 * dt
    limits = momentum_offline.Limits(most, dipole)
    dipoles = scale * solution.x.reshape(count, 3)
    lowest, ease = momentum_offline.least_energy(course, limits, start, dipoles)
    assert (ease > 0.0) == (dipole < np.inf)
    assert least * optimum < lowest <= optimum * (1.0 + 1e-6)
