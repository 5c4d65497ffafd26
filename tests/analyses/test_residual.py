"""No balance is left out without a word: every `substeps`, every rate, and what is not
checked."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.validation import calibration
from desat.analyses import energy, fixed, residual
from desat.analyses.manifest import Manifest
from desat.campaign import report
from desat.campaign.draws import draws
from desat.cli import app_for
from desat.engine import node
from desat.engine.instances.base import ComponentError
from desat.engine.master import Master
from desat.numbers.text import Value
from desat.runs.run import execute, resume
from desat.system.errors import Exit
from desat.system.options import Options
from tests.campaign.test_refusals import fly

BALANCES = set(energy.NUMBERS)


def balances_of(target: str, **options: object):
    run = execute(target, Options(**options))
    assert run.ok, run.manifest["message"]
    return {
        k: n["value"] for k, n in run.manifest["numbers"].items() if k in BALANCES
    }, run


def mine(folder: Path, text: str, base: str = "gyrostat/light") -> str:
    file = folder / "mine.toml"
    file.write_text(f'extends = "{base}"\n{text}', encoding="utf-8")
    return str(file)


@pytest.mark.parametrize("substeps", [1, 2])
def test_strong_jets_are_not_met_at_any_inner_as_long_as_they_are_wrong(substeps):
    name = "strong jets on 1.7 kg m2"
    (row,) = calibration.held(
        name, "gyrostat/pulses", (substeps,), calibration.JETS[name]
    )
    assert row.error > calibration.BAD
    assert row.refused


def test_a_jet_that_spins_a_craft_up_is_not_met_until_it_errs_little():
    name = "a jet from rest to 0.9 rad/s"
    wrong, right = calibration.held(
        name, "gyrostat/pulses", (1, 8), calibration.JETS[name]
    )
    assert wrong.error > calibration.BAD
    assert wrong.refused
    assert right.error < calibration.GOOD
    assert not right.refused


@pytest.mark.parametrize(
    "options", [{"substeps": 2}, {"substeps": 8}, {"every": 3, "substeps": 1}], ids=str
)
def test_balances_are_made_for_every_inner_and_for_rows_left_out(options):
    balances, run = balances_of("gyrostat/light", stop=100.0, **options)
    assert set(balances) == BALANCES
    assert balances["energy_mismatch"] < 1e-8
    assert balances["impulse_mismatch"] < 1e-12
    assert run.manifest["unmet"] == []
    assert run.manifest["not_checked"] == {}


def test_made_while_it_runs_they_have_the_values_of_the_rows(monkeypatch):
    """Where rows cannot serve, as with substeps."""
    rows, run = balances_of("gyrostat/pulses", substeps=1, stop=100.0)
    assert run.manifest["balance"] is None
    by_rows = energy.applies
    monkeypatch.setattr(energy, "applies", lambda s: replace(by_rows(s), rows=False))
    along, run = balances_of("gyrostat/pulses", substeps=1, stop=100.0)
    assert run.manifest["balance"] is not None
    for name in BALANCES:
        assert along[name] == pytest.approx(rows[name], rel=1e-12, abs=0.0)


@pytest.mark.parametrize(
    "options",
    [{"loop": "python"}, {"blocks": True}, {"supervised": True}, {"isolate": "all"}],
    ids=str,
)
def test_every_loop_makes_the_same_bits_of_them(options):
    full = balances_of("gyrostat/pulses", stop=300.0)[0]
    assert balances_of("gyrostat/pulses", stop=300.0, **options)[0] == full


@pytest.mark.parametrize("piece", [4096, 100])
def test_they_go_on_from_a_checkpoint(tmp_path, monkeypatch, piece):
    monkeypatch.setattr(node, "PIECE", piece)
    full, _ = balances_of("gyrostat/pulses", stop=80.0)
    monkeypatch.chdir(tmp_path)
    advance = Master.advance

    def advance_and_fail(master: Master, record: object = None) -> None:
        advance(master, record)
        if master.k == 53:
            raise ComponentError("ended")

    options = Options(stop=80.0, checkpoint=20.0, loop="python")
    with monkeypatch.context() as patch:
        patch.setattr(Master, "advance", advance_and_fail)
        assert not execute("gyrostat/pulses", options, tmp_path / "run").ok
    gone_on = resume((tmp_path / "run").absolute())
    assert gone_on.ok
    assert {k: gone_on.manifest["numbers"][k]["value"] for k in full} == full


@pytest.mark.parametrize("substeps", [1, 2])
def test_a_run_of_before_is_still_shown(substeps):
    """Its manifest says less of where torques come from."""
    run = execute("gyrostat/light", Options(substeps=substeps, stop=20.0))
    answer = run.manifest.to_json()
    for name in ("rows", "why"):
        del answer["energy"][name]
    run.results._computed.clear()
    assert len(energy.figures(Manifest.from_json(answer), run.results)) == (
        substeps == 1
    )


def test_a_run_that_fails_within_a_step_has_those_before(monkeypatch):
    from desat.components.blocks import torquers

    advance = torquers.Torquers.advance

    def failing(block: torquers.Torquers, t: float, dt: float) -> None:
        if t > 30.5:
            block.fail("it breaks")
        advance(block, t, dt)

    monkeypatch.setattr(torquers.Torquers, "advance", failing)
    run = execute("gyrostat/light", Options(substeps=4, blocks=True))
    assert run.manifest["status"] == "failed"
    balances = {
        k: n["value"] for k, n in run.manifest["numbers"].items() if k in BALANCES
    }
    assert set(balances) == BALANCES
    assert balances["energy_mismatch"] < 1e-8
    assert balances["impulse_mismatch"] < 1e-12


def test_a_run_that_fails_in_its_first_step_has_no_balance(monkeypatch):
    from desat.components.blocks import torquers

    def failing(block: torquers.Torquers, t: float, dt: float) -> None:
        block.fail("it breaks")

    monkeypatch.setattr(torquers.Torquers, "advance", failing)
    run = execute("gyrostat/light", Options(substeps=4, blocks=True))
    assert run.manifest["status"] == "failed"
    assert run.manifest["balance"] is None
    assert not BALANCES & set(run.manifest["numbers"])


@pytest.mark.parametrize(
    "slow",
    [
        {"spacecraft": 5},
        {"spacecraft": 5, "wheels": 5},
        {"environment": 5},
        {"torquers": 5},
    ],
    ids=str,
)
def test_they_are_made_where_components_are_slow(tmp_path, slow):
    text = "step = 0.2\nstop = 60.0\n[step_ratio]\n" + "\n".join(
        f"{k} = {n}" for k, n in slow.items()
    )
    balances, run = balances_of(mine(tmp_path, text, "gyrostat/full"), blocks=True)
    assert set(balances) == BALANCES
    assert balances["impulse_mismatch"] < 1e-12
    assert balances["energy_mismatch"] < 1e-6
    assert run.manifest["not_checked"] == {}


def test_a_torque_that_a_body_computes_otherwise_shows_at_every_inner(monkeypatch):
    from desat.components.blocks import spacecraft_rigid
    from desat.components.physics.rigid_body import slopes

    monkeypatch.setattr(
        spacecraft_rigid, "slopes", lambda *x: slopes(*x[:-1], 1.001 * x[-1])
    )
    balances, run = balances_of("gyrostat/full", substeps=4, blocks=True, stop=300.0)
    assert balances["impulse_mismatch"] > 1e-7
    monkeypatch.undo()
    assert (
        balances_of("gyrostat/full", substeps=4, blocks=True, stop=300.0)[0][
            "impulse_mismatch"
        ]
        < 1e-12
    )
    assert run.manifest["numbers"]["momentum_residual"]["value"] < 1e-14


@pytest.mark.parametrize(
    ("options", "reason", "names"),
    [
        ({"algorithm": "jacobi"}, "under jacobi torques act a step late", BALANCES),
        (
            {"record": ("spacecraft.*",)},
            "not recorded: wheels.h_wheel",
            BALANCES | {"momentum_residual"},
        ),
        (
            {"record": ("spacecraft.*", "wheels.*")},
            "not recorded: environment",
            {"impulse_mismatch"},
        ),
    ],
    ids=lambda o: str(sorted(o))[:30],
)
@pytest.mark.parametrize("substeps", [1, 2])
def test_what_is_not_checked_is_said_with_why(options, reason, names, substeps):
    balances, run = balances_of(
        "gyrostat/light", stop=5.0, substeps=substeps, **options
    )
    results = {
        k: x
        for k, x in run.manifest["not_checked"].items()
        if k in BALANCES | {"momentum_residual"}
    }
    if substeps == 2 and "wheels.*" in str(
        options
    ):  # made while it runs: it needs no series for it
        names = set()
    assert set(results) == names
    assert not names & set(balances)
    assert all(reason in text for text in results.values())
    lines = [w for w in run.manifest["warnings"] if w.startswith("not checked: ")]
    assert all(any(n in line and reason in line for line in lines) for n in names)


def test_the_command_says_what_is_not_checked(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    command = [
        "run",
        "gyrostat/light",
        "--stop",
        "5",
        "--substeps",
        "2",
        "--record",
        "spacecraft.*",
    ]
    invocation = CliRunner().invoke(app_for([]), command, env={"COLUMNS": "300"})
    assert invocation.exit_code == 0, invocation.output
    assert "warning: not checked: " in invocation.output
    assert any(
        line.startswith("hidden_work") and "not checked" in line
        for line in invocation.output.splitlines()
    )
    page = (tmp_path / "runs/gyrostat-light/report.html").read_text()
    assert re.search(r'<tr><td class="">hidden_work<td class="n">not checked', page)


def test_slow_wheels_are_said_before_the_run(tmp_path):
    target = mine(
        tmp_path, "step = 0.1\nstop = 5.0\n[step_ratio]\nwheels = 10\n", "gyrostat/full"
    )
    _, run = balances_of(target, blocks=True)
    line = "not checked: energy_mismatch, hidden_work, impulse_mismatch: wheels is slower than"
    assert sum(w.startswith(line) for w in run.manifest["warnings"]) == 1
    invocation = CliRunner().invoke(
        app_for([]), ["check", target], env={"COLUMNS": "300"}
    )
    assert line in invocation.output.replace("\n", " ")


def test_a_fixed_attitude_has_its_balance():
    run = execute("uosat12/table3-ocdc-ilqr-1", Options(stop=1200.0, blocks=True))
    mismatch = run.manifest["numbers"]["impulse_mismatch"]["value"]
    impulse = np.linalg.norm(run.results.values("spacecraft.impulse_eci"), axis=1).max()
    assert impulse > 1e-2
    assert mismatch < 1e-6 * impulse
    assert run.manifest["unmet"] == []


@pytest.mark.parametrize("every", [2, 3])
def test_a_fixed_attitude_whose_rows_are_left_out_has_the_balance_of_all(every):
    name, full = "uosat12/table3-ocdc-ilqr-1", Options(stop=60.0, blocks=True)
    run, rows = execute(name, full), execute(name, replace(full, every=every))
    assert run.manifest.numbers == rows.manifest.numbers
    assert "impulse_mismatch" in rows.manifest.numbers
    assert len(rows.results.times()) == -(-len(run.results.times()) // every)


def test_a_fixed_attitude_that_computes_a_torque_otherwise_is_not_met(monkeypatch):
    from desat.components.blocks import spacecraft_fixed_attitude as block

    monkeypatch.setattr(block, "MU", 1.01 * block.MU)
    run = execute("uosat12/fig2-offnadir-ilqr-blind", Options(stop=3000.0, blocks=True))
    assert any("impulse_mismatch" in line for line in run.manifest["unmet"])
    assert run.code == Exit.UNMET


def test_heavy_wheels_at_one_exchange_are_not_met(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    invocation = CliRunner().invoke(
        app_for([]), ["run", "gyrostat/heavy-wheels", "--substeps", "1"]
    )
    assert invocation.exit_code == Exit.UNMET
    assert "hidden_work" in invocation.output
    assert "energy_bound = 2e-08" in invocation.output
    assert (
        CliRunner().invoke(app_for([]), ["run", "gyrostat/heavy-wheels"]).exit_code
        == Exit.COMPLETED
    )


JUDGED = range(500, 540)
"""Seeds that no bound was chosen with."""


@pytest.mark.study
def test_the_bound_tells_craft_apart_that_it_has_not_seen():
    rows = calibration.at_random(JUDGED)
    answer = calibration.summed(rows)
    assert answer["good"] >= 15
    assert answer["bad"] >= 4
    assert answer["false_alarms"] == answer["missed"] == 0
    assert all(r.refused for r in rows if r.error > calibration.BAD)


def test_a_scenario_has_its_own_bound_in_campaigns_too(tmp_path):
    text = """stop = 20.0
substeps = 2
energy_bound = 1e-30
[dispersions]
"spacecraft.omega_start_body" = { normal = [0.0, 1e-3] }
[numbers.rate]
title = "Rate"
signal = "spacecraft.omega_bi_body"
measure = "norm_last"
unit = "rad/s"
"""
    target = mine(tmp_path, text)
    assert "energy_bound = 1e-30" in execute(target, Options()).manifest["unmet"][0]
    summary_value = report.summary(fly(target, tmp_path / "campaign")).to_json()
    assert summary_value["unmet"]
    assert all("hidden_work" in line for line in summary_value["unmet"])
    rows = draws(target, 2, 1, Options(), jobs=1).to_json()["draws"]
    assert all(len(r["unmet"]) == 1 for r in rows)
    assert json.dumps(rows)


def manifest_with(**more: object) -> SimpleNamespace:
    """A manifest's part that balances look at."""
    usual = {
        "algorithm": "gauss_seidel",
        "step": 2.0,
        "substeps": 1,
        "about": {},
        "numbers": {},
        "parts": {},
        "balance": None,
    }
    return SimpleNamespace(**{**usual, **more})


def test_the_largest_residual_is_that_of_a_row(monkeypatch):
    off = np.array([[3.0, 0.0, 4.0], [0.0, -4.9, 0.0], [3.0, 0.0, 0.0]])
    series = residual.Momentum(7.0, 5.0, np.arange(3.0), off, 3)
    monkeypatch.setattr(residual, "momentum", lambda *_: series)
    number = residual.numbers(None, None)["momentum_residual"]
    assert (number.value, number.unit) == (5.0, "N.m.s")
    assert residual.unchecked(None, None) == {}
    for algorithm, residual_bound, lines in (
        ("gauss_seidel", None, 1),
        ("jacobi", None, 0),
        ("gauss_seidel", 5.0 / 7.0, 0),
        ("gauss_seidel", 0.7, 1),
    ):
        about = {} if residual_bound is None else {"residual_bound": residual_bound}
        manifest = manifest_with(
            numbers={"momentum_residual": number}, algorithm=algorithm, about=about
        )
        assert len(residual.unmet(manifest, None)) == lines
    at_bound = {"momentum_residual": Value("x", 7e-9, "N.m.s")}
    assert residual.unmet(manifest_with(numbers=at_bound), None) == []
    at_bound = {"momentum_residual": Value("x", 7.1e-9, "N.m.s")}
    assert len(residual.unmet(manifest_with(numbers=at_bound), None)) == 1
    monkeypatch.setattr(residual, "momentum", lambda *_: None)
    assert residual.unmet(manifest_with(), None) == []
    assert residual.numbers(None, None) == {}


def test_why_there_is_no_residual():
    parts = residual.MomentumParts("a", "w.h")
    series = [*(f"a.{n}" for n in ("q_bi", "omega_bi_body", "impulse_eci")), "w.h"]
    for names, reason in (
        (series, "there are no rows"),
        (series[1:], "not recorded: a.q_bi"),
        (series[2:], "not recorded: a.q_bi, a.omega_bi_body"),
    ):
        results = SimpleNamespace(
            names=lambda names=names: names, once=lambda key, make: None
        )
        manifest = manifest_with(parts={residual.KEY: parts})
        assert residual.unchecked(manifest, results) == {"momentum_residual": reason}


def test_totals_go_on_from_block_to_block(monkeypatch):
    blocks = [
        energy.Block(
            np.array([1.0, 4.0, 2.0]),
            np.array([2.5, -1.5]),
            np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0]]),
            np.array([0.1, 0.3]),
        ),
        energy.Block(
            np.array([2.0, 1.0]),
            np.array([-3.0]),
            np.array([[1.0, 0.0, 0.0]]),
            np.array([0.2]),
        ),
    ]
    impulses = [
        [[5.0, 0.0, 0.0], [6.0, 0.0, 3.0], [6.0, 2.0, 0.0]],
        [[6.0, 2.0, 0.0], [7.0, 2.0, -4.0]],
    ]
    monkeypatch.setattr(energy, "sums", lambda steps: blocks[steps.number])
    for outer in (None, object()):
        totals, mismatches = energy.Totals(), []
        for k, impulse in enumerate(impulses):
            steps = SimpleNamespace(number=k, impulse=np.array(impulse), outer=outer)
            mismatches.append(totals.add(steps))
            assert totals.start == 1.0
            assert totals.energy == 4.0
        assert [list(mismatch) for mismatch, _ in mismatches] == [[0.5, 0.0], [2.0]]
        assert (totals.work, totals.worked, totals.mismatch) == (-2.0, 2.5, 2.0)
        assert (totals.hidden, totals.began) == (0.3, (5.0, 0.0, 0.0))
        assert totals.given == (2.0, 2.0, 0.0)
        assert totals.impulse == (4.0 if outer else None)
    blocks[0] = blocks[0]._replace(energy=np.array([5.0, 1.0, 1.0]))
    totals = energy.Totals()
    totals.add(SimpleNamespace(number=0, impulse=np.array(impulses[0]), outer=None))
    assert (totals.energy, totals.start, totals.mismatch) == (5.0, 5.0, 6.5)


@pytest.mark.parametrize(
    ("values", "share", "impulse"),
    [
        ({"energy": 2.0, "worked": 4.0}, 0.25, None),
        ({"energy": 8.0, "worked": 4.0}, 0.125, 0.5),
        ({}, None, 0.5),
        (None, None, None),
    ],
)
def test_the_numbers_of_a_balance(monkeypatch, values, share, impulse):
    result = (
        None
        if values is None
        else energy.Totals(mismatch=1.0, hidden=3.0, impulse=impulse, **values)
    )
    monkeypatch.setattr(energy, "totals_of", lambda *_: result)
    monkeypatch.setattr(energy, "_not_of_rows", lambda *_: "why")
    balance_values = {
        name: n.value for name, n in energy.numbers(manifest_with(), None).items()
    }
    known_values = {
        "energy_mismatch": share,
        "hidden_work": values is not None and 3.0,
        "impulse_mismatch": impulse,
    }
    assert balance_values == {k: v for k, v in known_values.items() if v}
    parts = energy.EnergyParts("a", "w.h")
    lacking = energy.unchecked(manifest_with(parts={energy.KEY: parts}), None)
    if values is None:
        assert lacking == dict.fromkeys(energy.NUMBERS, "why")
    else:
        assert list(lacking) == ["impulse_mismatch"] * (impulse is None)


def series_of(names: list[str], times: list[float], lacking: str = "", **counts: int):
    """Results with such series."""
    return SimpleNamespace(
        names=lambda: [n for n in names if n != lacking],
        once=lambda key, make: make(),
        times=lambda name: np.array(times if name == "a.q_bi" else [0.0, 99.0]),
        count=lambda name: counts.get(name.replace(".", "_"), len(times)),
    )


@pytest.mark.parametrize(
    ("more", "times", "lacking", "counts", "reason"),
    [
        ({}, [0.0, 2.0, 4.0], "", {}, ""),
        (
            {"algorithm": "jacobi"},
            [0.0, 2.0],
            "",
            {},
            "under jacobi torques act a step late",
        ),
        ({"why": "so"}, [0.0, 2.0], "", {}, "so"),
        ({}, [0.0, 2.0], "w.mean", {}, "not recorded: w.mean"),
        ({}, [0.0], "", {}, "there is no whole step"),
        ({}, [0.0, 2.0], "", {"w_mean": 0}, "there is no whole step"),
        ({}, [0.0, 2.0], "", {"a_q_bi": 1}, "there is no whole step"),
        ({}, [0.0, 2.0], "", {"w_mean": 1}, ""),
        ({}, [0.0, 4.0], "", {}, "its rows"),
        ({}, [0.0, 1.0], "", {}, "its rows"),
        ({}, [5.0, 7.0], "", {}, ""),
        ({"rows": False}, [0.0, 2.0], "", {}, "its rows"),
        ({"rows": None}, [0.0, 2.0], "", {}, ""),
        ({"rows": None, "substeps": 2}, [0.0, 2.0], "", {}, "its rows"),
    ],
)
def test_why_rows_have_no_balance(more, times, lacking, counts, reason):
    of = {k: more.pop(k) for k in ("why", "rows") if k in more}
    parts = energy.EnergyParts(
        "a", "w.h", "w.mean", "w.slope", None, **{"rows": True, **of}
    )
    results = series_of(energy.of_work(parts), times, lacking, **counts)
    answer = energy._not_of_rows(
        manifest_with(parts={energy.KEY: parts}, **more), results
    )
    assert answer.startswith(reason)
    assert bool(answer) == bool(reason)


@pytest.mark.parametrize(
    ("hidden", "impulse", "about", "lines"),
    [
        (2e-8, 7e-6, {}, []),
        (2.1e-8, None, {}, ["hidden_work"]),
        (None, 7.1e-6, {}, ["impulse"]),
        (2.1e-8, 7.1e-6, {}, ["hidden_work", "impulse"]),
        (None, None, {}, []),
        (0.5, 3.5, {"energy_bound": 0.5, "impulse_bound": 0.5}, []),
        (
            0.6,
            3.6,
            {"energy_bound": 0.5, "impulse_bound": 0.5},
            ["hidden_work", "impulse"],
        ),
    ],
)
def test_a_balance_at_its_bound_is_met(monkeypatch, hidden, impulse, about, lines):
    series = residual.Momentum(7.0, 0.0, np.zeros(1), np.zeros((1, 3)), 1)
    numbers = {"hidden_work": hidden, "impulse_mismatch": impulse}
    manifest = manifest_with(
        about=about,
        numbers={k: Value(k, v, "1") for k, v in numbers.items() if v is not None},
    )
    monkeypatch.setattr(residual, "momentum", lambda *_: series)
    assert [
        x[: len(y)] for x, y in zip(energy.unmet(manifest, None), lines, strict=True)
    ] == lines
    monkeypatch.setattr(residual, "momentum", lambda *_: None)
    assert len(energy.unmet(manifest, None)) == ("hidden_work" in lines)
    of_fixed = "impulse" in lines
    monkeypatch.setattr(
        fixed, "mismatch", lambda *_: None if impulse is None else (impulse, 7.0)
    )
    assert len(fixed.unmet(manifest, None)) == of_fixed
    fixed_numbers = fixed.numbers(manifest, None)
    assert {k: v.value for k, v in fixed_numbers.items()} == (
        {} if impulse is None else {"impulse_mismatch": impulse}
    )


@pytest.mark.parametrize(
    ("more", "times", "lacking", "reason"),
    [
        ({}, [0.0, 2.0], "", ""),
        (
            {"algorithm": "jacobi"},
            [0.0, 2.0],
            "",
            "under jacobi torques act a step late",
        ),
        ({"why": "so"}, [0.0, 2.0], "", "so"),
        ({}, [0.0, 2.0], "a.h_copy_wheel", "not recorded: a.h_copy_wheel"),
        ({}, [0.0], "", "there is no whole step"),
        ({}, [0.0, 4.0], "", "rows are left out"),
        ({}, [3.0, 5.0, 9.0], "", ""),
    ],
)
def test_why_a_fixed_attitude_has_no_balance(more, times, lacking, reason):
    parts = fixed.FixedAttitudeParts("a", {"x": "b.c"}, more.pop("why", ""))
    results = series_of(fixed.balanced(parts), times, lacking)
    manifest = manifest_with(parts={fixed.KEY: parts}, **more)
    assert fixed._reason_against(manifest, results) == reason
    assert fixed.unchecked(manifest, results) == (
        {"impulse_mismatch": reason} if reason else {}
    )
