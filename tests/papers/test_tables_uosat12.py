"""Tables 2 and 3 of paper 000, from FMUs: inside the notes' bands."""

from __future__ import annotations

import json

import pytest


@pytest.fixture(scope="module")
def rows(desat_module):
    result = desat_module("tables", "uosat12", "--json")
    assert result.returncode == 0, result.stderr
    data = json.loads(result.stdout)
    assert data["family"] == "uosat12"
    return data["rows"]


@pytest.fixture(scope="module")
def desat_module():
    import subprocess
    import sys

    from tests.conftest import ROOT

    return lambda *a: subprocess.run(
        [sys.executable, "-m", "desat.cli", *a],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
    )


def cell(rows, table, method, case, quantity="firing_time"):
    (row,) = [
        r
        for r in rows
        if (r["table"], r["method"], r["case"], r["quantity"])
        == (table, method, case, quantity)
    ]
    return row


CASES = ("ILQR 1", "ILQR 2", "ILQR 3", "MEC 1", "MEC 2", "MEC 3")
PROTOTYPE = {
    # an independent numpy prototype's seconds, before this code; pulses may fall one
    # either way
    ("2", "DCT"): (98.25, 87.75, 95.20, 97.65, 89.00, 90.10),
    ("2", "CCCP"): (71.50, 54.20, 75.10, 69.50, 42.65, 74.55),
    ("2", "CRCP"): (32.10, 52.40, 57.85, 40.15, 30.95, 62.45),
    ("2", "OCDC"): (36.70, 53.25, 57.05, 44.10, 35.00, 60.75),
    ("3", "OCDC"): (73.05, 69.05, 73.60, 61.40, 50.45, 60.85),
}


@pytest.mark.slow
def test_every_banded_cell_is_within(rows):
    rows_with_band = [r for r in rows if r["band"]]
    # Tables 2 and 3, then what is beyond: three methods, two of them with MEC, and the
    # bound
    assert (
        len([r for r in rows_with_band if r["quantity"] == "firing_time"])
        == 24 - 1 + 12 + 3 * 4 + 6
    )
    assert (
        len([r for r in rows_with_band if r["quantity"] == "dipole_energy"]) == 12 - 3
    )
    for r in rows_with_band:
        # a row of draws is outside also where one draw is
        assert r["within"] <= (r["band"][0] <= r["ours"] <= r["band"][1])
    outside = {
        (r["quantity"], r["method"], r["case"])
        for r in rows_with_band
        if not r["within"]
    }
    assert {x for x in outside if x[0] != "above_bound"} == {
        # what the paper claims of CRCP, and does not hold here
        ("firing_time_over_ocdc", "CRCP", "ILQR 3"),
        ("firing_time_over_ocdc", "CRCP", "MEC 3"),
        # the limit of the coils, which does nothing there, nor in the paper's own cells
        ("firing_time_over_that_without_a_limit", "OCDC", "MEC 3"),
        # coils alone: MEC stays within 40 A m2, and with the flight's field it ends
        # below LQR
        ("largest_dipole", "", "fig2-mec-1"),
        *(
            ("final_momentum_over_mec", "", f"fig2-flight-igrf-lqr-{n}")
            for n in (1, 2, 3)
        ),
    }
    assert {x[1] for x in outside if x[0] == "above_bound"} <= {"RECEDING HORIZON"}


def test_what_no_run_decides_says_why(rows):
    open_rows = [r for r in rows if r["ours"] is None]
    assert len(open_rows) == 5
    for r in open_rows:
        assert r["remark"].startswith("not judged: ")
        assert (r["band"], r["within"], r["out_of_sample"]) == (None, None, False)


def test_the_receding_horizon_is_never_worse_than_ocdc(rows):
    """In the median of every row, and in every draw; the median is within 5 % of the
    bound, and so are 95 % of the draws with the attitude off."""
    for quantity in ("above_bound_over_ocdc", "above_bound_less_ocdc"):
        quantity_rows = [r for r in rows if r["quantity"] == quantity]
        assert len(quantity_rows) == 15 + 4
        assert all(r["within"] for r in quantity_rows)
    worse = [r for r in rows if r["quantity"] == "draws_worse_than_ocdc"]
    assert [r["draws"]["count"] for r in worse] == [0] * (15 + 4)
    above = {r["case"]: r for r in rows if r["quantity"] == "draws_above_5_percent"}
    assert len(above) == 15 + 4
    for r in rows:
        if r["quantity"] == "above_bound" and r["case"] in above:
            assert r["method"] != "RECEDING HORIZON" or r["ours"] <= 5.0
    off = [r["draws"] for case, r in above.items() if "5 deg off" in case]
    assert len(off) == 3
    assert all(d["count"] <= 0.05 * d["n"] for d in off)


def test_what_is_out_of_sample_is_little_and_said(rows):
    out = {
        (r["table"], r["quantity"], r["method"], r["case"])
        for r in rows
        if r["out_of_sample"] and r["band"]
    }
    mec, every = CASES[3:], CASES
    assert out == {
        *(("2", "firing_time", "DCT", c) for c in mec),
        *(("3", "firing_time", "OCDC", c) for c in every),
    }
    for r in rows:
        assert r["definition"], (r["table"], r["quantity"])
        assert not (r["tuned"] and r["out_of_sample"])
        assert r["out_of_sample"] <= (r["paper"] is not None)
    assert cell(rows, "2", "DCT", "MEC 1")["within"] is True
    assert cell(rows, "2", "DCT", "MEC 1")["paper_within"] is False
    assert "B_y" in cell(rows, "2", "CRCP", "ILQR 1")["remark"]


def test_bands_are_the_notes(rows):
    assert cell(rows, "2", "OCDC", "ILQR 1")["band"] == pytest.approx(
        [36.90 * 0.98, 36.90 * 1.02]
    )
    assert cell(rows, "2", "CRCP", "ILQR 1")["band"] == pytest.approx(
        [31.95 * 0.965, 31.95 * 1.035]
    )
    assert cell(rows, "2", "CRCP", "MEC 3")["band"] is None
    assert cell(rows, "2", "CRCP", "MEC 3")["paper"] == 50.75
    assert cell(rows, "3", "OCDC", "MEC 2")["band"] == pytest.approx(
        [48.8 * 0.96, 48.8 * 1.04], abs=0.01
    )
    assert cell(rows, "2", "OCDC", "MEC 1", "dipole_energy")["band"] is None


@pytest.mark.parametrize(("table", "method"), PROTOTYPE)
def test_near_the_independent_prototype(rows, table, method):
    for case, seconds in zip(CASES, PROTOTYPE[table, method], strict=True):
        assert cell(rows, table, method, case)["ours"] == pytest.approx(
            seconds, abs=0.45
        )


def test_savings_and_momentum(rows):
    dct = cell(rows, "3", "DCT", "ILQR 2")["ours"]
    row = cell(rows, "3", "OCDC", "ILQR 2", "saving")
    assert row["ours"] == pytest.approx(
        100 * (1 - cell(rows, "3", "OCDC", "ILQR 2")["ours"] / dct)
    )
    assert row["unit"] == "%"
    assert row["paper"] == 21.88
    momenta = [
        r
        for r in rows
        if r["quantity"] == "final_momentum" and "assumed" not in r["table"]
    ]
    assert len(momenta) == 36 + 9 + 6 + 5
    assert all(0 < r["ours"] < 0.06 and r["paper"] is None for r in momenta)


def test_what_is_tuned_is_called_tuned(rows):
    assert cell(rows, "2", "DCT", "ILQR 1")["tuned"] is True
    assert cell(rows, "2", "DCT", "MEC 1")["tuned"] is False
    assert all(cell(rows, "2", m, c)["tuned"] for m in ("CCCP", "OCDC") for c in CASES)
    assert not any(cell(rows, "2", "CRCP", c)["tuned"] for c in CASES)
    assert not any(cell(rows, "3", "OCDC", c)["tuned"] for c in CASES)


BEYOND = {
    "BOUNDED QUADRATIC": (71.75, 68.50, 72.90),
    "BOUNDED 1-NORM": (71.30, 68.00, 71.40),
    "RECEDING HORIZON": (52.85, 40.05, 52.10),
    "BOUND": (52.85, 40.06, 52.12),
}


@pytest.mark.parametrize("method", BEYOND)
def test_beyond_the_paper(rows, method):
    """Near the prototype; the receding horizon within 1 % of the bound, and it saves 40
    %."""
    for case, seconds in zip(CASES[:3], BEYOND[method], strict=True):
        row = cell(rows, "3", method, case)
        assert row["ours"] == pytest.approx(seconds, abs=0.2)
        assert row["paper"] is None
        if method == "RECEDING HORIZON":
            assert row["ours"] <= 1.01 * cell(rows, "3", "BOUND", case)["ours"]
            assert cell(rows, "3", method, case, "saving")["ours"] >= 40.0
            assert cell(rows, "3", method, case, "final_momentum")["ours"] <= 0.002


def test_least_seconds_of_the_linear_programme(rows):
    """No bounded law beats the linear programme at 36 A m2 (notes; |h_f|_1 / 0.04 s
    allowed)."""
    for case, least_seconds in zip(CASES[:3], (52.85, 40.06, 52.12), strict=True):
        slack = 3**0.5 * cell(rows, "3", "OCDC", case, "final_momentum")["ours"] / 0.04
        assert cell(rows, "3", "OCDC", case)["ours"] + slack >= least_seconds


def test_random_starts_are_stored_draws(rows):
    rows_by_method = {
        (r["method"], r["quantity"]): r for r in rows if r["table"] == "Random starts"
    }
    assert all(
        r["draws"]["n"] >= 20 and r["paper"] is None for r in rows_by_method.values()
    )
    bound_row = rows_by_method["BOUND", "firing_time"]
    for method in (
        "DCT",
        "OCDC",
        "BOUNDED QUADRATIC",
        "BOUNDED 1-NORM",
        "RECEDING HORIZON",
    ):
        assert rows_by_method[method, "firing_time"]["ours"] > bound_row["ours"]
    assert rows_by_method["RECEDING HORIZON", "above_bound"]["ours"] < 0.2
    assert rows_by_method["RECEDING HORIZON", "above_bound"]["draws"]["max"] <= 1.0
    assert rows_by_method["RECEDING HORIZON", "final_momentum"]["draws"]["max"] <= 0.002


def test_a_stored_draw_is_what_the_fmus_give():
    from desat.campaign.draws import draws
    from desat.papers import stored
    from desat.runs.run import Options

    name = "uosat12/starts-receding_horizon"
    stored_samples = stored.read("uosat12")
    stored.require_current(stored_samples)
    (now,) = draws(name, 1, stored_samples["seed"], Options(), 1).rows
    first = stored_samples["scenarios"][name]["draws"][0].numbers
    # HiGHS may round otherwise on another processor, and that may be a pulse
    assert now.numbers["firing_time"] == pytest.approx(first["firing_time"], abs=0.1)
    assert now.numbers["bound"] == pytest.approx(first["bound"], rel=1e-6)
