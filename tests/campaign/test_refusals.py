"""Campaigns that could have said what is not so: values that nobody has, cases that are
none."""

from __future__ import annotations

import dataclasses
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from scipy.stats import beta

import desat
from desat.campaign import case, coordinator, judged, pairs, report, store
from desat.campaign.draws import draws
from desat.campaign.plan import joined
from desat.campaign.sweep import sweep
from desat.language.scenario import Requirement
from desat.runs.run import Options, execute
from desat.system.errors import DesatError, Exit, RunError
from tests.campaign.test_campaign import RATE as OWN_SCENARIO

DRAWN = "wheels.h_start_wheel"


def scenario(folder: Path, more: str = "") -> str:
    path = folder / "mine.toml"
    path.write_text(OWN_SCENARIO + more)
    return str(path)


@pytest.fixture(scope="module")
def own_scenario(tmp_path_factory) -> str:
    return scenario(tmp_path_factory.mktemp("own"))


def fly(target: str, folder: Path, count: int = 3, **more: object) -> Path:
    plan, _ = coordinator.planned(target, count, **more)
    coordinator.run(plan, folder, 1, progress=False)
    return folder


@pytest.fixture(scope="module")
def three(own_scenario, tmp_path_factory) -> Path:
    return fly(own_scenario, tmp_path_factory.mktemp("three") / "campaign")


def test_a_data_set_stays_with_its_cases(own_scenario, three, tmp_path):
    """Also where earlier cases come after it was loaded, as from another worker."""
    folder = tmp_path / "campaign"
    shutil.copytree(three, folder)
    full = store.read(folder).to_pylist()
    block_rows = store._of_block(folder, 0)
    (folder / "cases/part-00000.parquet").unlink()
    lines = [row.to_line() for row in block_rows]
    store.journal(folder, 0).write_text("".join(lines[i] for i in (0, 2)))
    data_set, curves = desat.load(folder), desat.load(folder, curves=True)
    store.journal(folder, 0).write_text("".join(lines[i] for i in (0, 2, 1)))
    assert data_set["out.rate"].shape == data_set["out.rate"].values.shape == (2,)
    assert float(data_set["out.rate"].sel(case=2)) == full[2]["out.rate"]
    (curve, *_) = curves.data_vars
    stored_curves = desat.load(three, curves=True)[curve].values[[0, 2]]
    assert curves[curve].values.tobytes() == stored_curves.tobytes()
    store.journal(folder, 0).write_text(lines[0])
    with pytest.raises(DesatError, match="case 2 no longer exists"):
        data_set["out.rate"].values  # noqa: B018


@pytest.mark.parametrize(
    "name", [DRAWN, f"{DRAWN}[2]", f"{DRAWN} ", "shared.h_start_wheel"]
)
def test_what_is_drawn_has_no_other_value(own_scenario, name):
    value = "0.001" if "[" in name else "0.001,0,0,0"
    with pytest.raises(DesatError, match="is sampled, and so never has this value"):
        coordinator.planned(own_scenario, 3, options=Options(sets=[f"{name}={value}"]))
    if "wheels" in name:
        with pytest.raises(DesatError, match="is sampled, and so cannot be an axis"):
            sweep(own_scenario, {name.strip(): [0.0]}, draws=2)


def test_an_input_that_is_fed_takes_no_value(tmp_path):
    line = r"wheels\.tau_cmd_wheel: manager\..* feeds it: it never has this value"
    with pytest.raises(DesatError, match=line):
        execute(
            "integrated/mil-nadir",
            Options(sets=["wheels.tau_cmd_wheel=1,1,1,1"], stop=1.0),
        )
    with pytest.raises(DesatError, match=line):
        sweep(
            "integrated/mil-nadir",
            {"wheels.tau_cmd_wheel": [[1.0] * 4]},
            Options(stop=1.0),
        )
    more = '[dispersions]\n"wheels.tau_cmd_wheel" = { normal = [0.0, 1e-3] }\n'
    with pytest.raises(DesatError, match=line):
        coordinator.planned(scenario(tmp_path, more), 3)


def test_bounds_and_requirements_of_the_balances_are_looked_at(tmp_path):
    more = """residual_bound = 1e-30
impulse_bound = 1e-30
[requirements.residual]
number = "momentum_residual"
max = 1.0
probability = 0.3
"""
    target = scenario(tmp_path)
    Path(target).write_text(
        OWN_SCENARIO.replace("[numbers", more.partition("[")[0] + "[numbers")
        + more[more.index("[") :]
    )
    summary_value = report.summary(fly(target, tmp_path / "campaign")).to_json()
    assert summary_value["requirements"]["residual"]["outside"] == 0
    assert summary_value["requirements"]["residual"]["lacking"] == 0
    assert len(summary_value["unmet"]) == 6, summary_value["unmet"]
    assert all("above" in line for line in summary_value["unmet"])
    rows = draws(target, 2, 1, Options(), jobs=1).rows
    assert [len(r.unmet) for r in rows] == [2, 2]


def test_an_infinite_number_is_outside(tmp_path):
    values = np.array([1.0, np.inf, -np.inf, np.nan])
    for entry in ({"min": 0.0}, {"max": 2.0}):
        answer = judged.requirement(
            Requirement(number="x", **entry),
            {"x": values},
            np.ones(4, bool),
            np.arange(4),
            tmp_path,
        )
        assert (answer.within, answer.lacking) == (1, 3)
    answer = report._number("x", {}, values, np.arange(4))
    assert (answer.n, answer.not_reached, answer.infinite) == (1, 1, 2)


def test_how_many_more_cases_show_it_for_good():
    """2 of 100 outside: 124 would show it, 125 to 152 would not; from 181 on any number
    does."""

    def is_shown(total: int) -> bool:
        outside = int(0.02 * total + 0.5)
        return bool(beta.ppf(0.05, total - outside, outside + 1) >= 0.95)

    more = judged.more(100, 98, 0.95, 0.95)
    assert all(is_shown(100 + k) for k in range(more, more + 500))
    assert not is_shown(100 + more - 1)
    low, high = (
        beta.ppf(0.975, 1, n) for n in (10, 10 + judged.for_half_the_width(10, 0, 0.95))
    )
    assert 0.45 < high / low <= 0.5


def test_what_no_run_can_miss_is_said(own_scenario):
    """mil-nadir is to be dumped after 7200 s; these runs end after 20 s."""
    _, warnings = coordinator.planned(own_scenario, 3)
    (line,) = [w for w in warnings if "requirements.dumped" in w]
    assert line.endswith(
        "max = 7200 s is not before the end of a run, 20 s: no case can be above"
    )
    _, warnings = coordinator.planned("integrated/mil-nadir", 3)
    assert not any("requirements" in w for w in warnings)


def test_a_worker_that_is_told_to_end_gives_no_row(own_scenario, monkeypatch):
    """Its case is made again elsewhere."""

    def stop_worker(*_: object) -> None:
        raise RunError("interrupted", Exit.TERMINATED)

    monkeypatch.setattr(case, "ran", stop_worker)
    plan, _ = coordinator.planned(own_scenario, 3)
    with pytest.raises(SystemExit):
        case.row(plan, 1)


def test_a_flipped_bit_is_damage(three, tmp_path):
    """Wherever it is: Parquet itself would read half of them as other numbers."""
    folder = tmp_path / "campaign"
    shutil.copytree(three, folder)
    part = folder / "cases/part-00000.parquet"
    octets = part.read_bytes()
    rng = np.random.default_rng(1)
    for at in rng.integers(0, len(octets) - 1, 40):
        damaged_octets = bytearray(octets)
        damaged_octets[at] ^= 1 << int(rng.integers(8))
        part.write_bytes(damaged_octets)
        with pytest.raises(DesatError, match=r"part-00000\.parquet: damaged"):
            store.digest(folder)
    part.write_bytes(octets)
    assert store.digest(folder) == store.digest(three)


def test_a_file_whose_sha256_is_missing_is_refused_as_one_whose_sha256_is_another(
    three, tmp_path
):
    folder = tmp_path / "campaign"
    shutil.copytree(three, folder)
    signature_file = store.signature(folder / "cases/part-00000.parquet")
    signature_file.unlink()
    message = r"part-00000\.parquet: damaged \(_part-00000\.sha256, its sha256, is missing\); without"
    with pytest.raises(DesatError, match=message):
        store.read(folder)
    shutil.copy(store.signature(three / "cases/part-00000.parquet"), signature_file)
    assert store.digest(folder) == store.digest(three)


def test_a_file_that_is_being_replaced_is_read_whichever_it_is(
    three, tmp_path, monkeypatch
):
    """Its head may be killed between the two: the sha256 of both stand there until it
    is done."""
    shutil.copytree(three, folder := tmp_path / "campaign")
    path = folder / "cases/part-00000.parquet"
    for is_after in (True, False):  # before, and after the file has been replaced
        part = path.with_suffix(".tmp")
        pq.write_table(pq.read_table(path), part, compression="none")

        def replace_and_die(
            stored_values: Path, target: Path, is_after: bool = is_after
        ) -> None:
            if target != path or not is_after:
                shutil.move(stored_values, target)
            if target == path:
                raise KeyboardInterrupt

        monkeypatch.setattr(type(part), "replace", replace_and_die)
        with pytest.raises(KeyboardInterrupt):
            store.replace(part, path, part.read_bytes())
        monkeypatch.undo()
        assert store.digest(folder) == store.digest(three)


@pytest.mark.skipif(
    not Path("/dev/full").exists(), reason="needs the device that is always full"
)
@pytest.mark.parametrize(
    "name", ["cases/part-00000.jsonl", "cases/part-00000.tmp", "numbers.json.tmp"]
)
def test_a_full_disk_is_told_with_the_file(three, tmp_path, name):
    folder = tmp_path / "campaign"
    [row, *_] = store._of_block(three, 0)
    full = store.Store(folder, 2 if name.endswith(".jsonl") else 1)
    (folder / name).symlink_to("/dev/full")
    descriptions = {"out.x": {"title": "x", "unit": "1"}}
    batch = store.Batch.of([dataclasses.replace(row, described=descriptions)])
    with pytest.raises(OSError, match="No space left on device") as caught:
        full.add(batch)
    whole_file = folder / name.replace("00.tmp", "00.parquet").removesuffix(".tmp")
    assert caught.value.filename == str(whole_file)


def test_rows_of_a_block_that_has_grown_are_there_at_once(three, tmp_path):
    """And are kept where the head is killed before the block is whole again: its file
    stood beside the journal, and whatever read the folder took the file alone."""
    folder = tmp_path / "campaign"
    shutil.copytree(three, folder)
    second_store = store.Store(folder, 5)
    assert (second_store.done(), store.read(folder).num_rows) == (3, 3)
    [row, *_] = store._of_block(three, 0)
    second_store.add(store.Batch.of([dataclasses.replace(row, number=3)]))
    assert store.read(folder).num_rows == 4
    again = store.Store(folder, 5)
    assert (again.done(), list(again.missing())) == (4, [4])
    again.add(store.Batch.of([dataclasses.replace(row, number=4)]))
    assert store.read(folder)["case"].to_pylist() == [0, 1, 2, 3, 4]
    assert not [*(folder / "cases").glob("*.jsonl*")]


def test_a_case_is_one_object_from_run_to_column(three):
    """It was a dictionary that ten places took apart."""
    rows = store._of_block(three, 0)
    assert [row.case for row in rows] == [0, 1, 2]
    for row in rows:
        again = store.CaseRow.from_json(json.loads(row.to_line()))
        assert again == row
        assert row.completed == (row.status == "completed")
        with pytest.raises(dataclasses.FrozenInstanceError):
            row.code = 1


def test_damaged_folders_are_named(three, tmp_path, desat):
    folder = tmp_path / "campaign"
    shutil.copytree(three, folder)
    (folder / "cases/part-abc.parquet").write_text("x")
    store.journal(folder, 0).write_text('{"case": "3"}\n')
    assert store.read(folder).num_rows == 3
    (folder / "status.json").write_text('{"state": "running", "head": 5}')
    assert desat("campaign", "status", str(folder)).returncode == 0
    for name in ("part-0000{}.parquet", "_part-0000{}.sha256"):
        shutil.copy(
            folder / "cases" / name.format(0), folder / "cases" / name.format(1)
        )
    with pytest.raises(
        DesatError, match=r"part-00001.parquet: damaged \(it has other cases\)"
    ):
        store.read(folder)
    (folder / "cases/part-00001.parquet").unlink()
    (folder / store.NUMBERS).write_text("{}")
    with pytest.raises(DesatError, match=r"numbers.json: damaged: it lacks"):
        report.summary(folder)


def test_few_pairs_have_no_interval(three, own_scenario, tmp_path, desat):
    """Five pairs hold a median with 94 % at most; and a case that fails in one is said."""
    comparison = pairs.compare(three, three)
    assert not comparison.numbers["rate"].interval_holds
    result = desat(
        "compare", str(three), str(shutil.copytree(three, tmp_path / "same"))
    )
    title = comparison.numbers["rate"].title
    assert title
    (line,) = [x for x in result.stdout.splitlines() if x.startswith(title)]
    line = line.removeprefix(title).split()
    assert len(line) == 7, "median, share with its interval, share, pairs, unit"
    other = tmp_path / "other"
    shutil.copytree(three, other)
    rows = store._of_block(other, 0)
    rows[1] = dataclasses.replace(rows[1], status="failed")
    store._write(other, 0, rows)
    comparison = pairs.compare(three, other)
    assert comparison.warnings == [
        "case 1: completed in the first, failed in the second: in no pair"
    ]


def test_the_last_value_of_several_is_refused(tmp_path):
    more = '[numbers.q]\ntitle = "q"\nsignal = "wheels.h_wheel"\n'
    with pytest.raises(
        DesatError, match=r"numbers\.q\.element: last takes one element; there are"
    ):
        coordinator.planned(scenario(tmp_path, more), 3)


def test_a_case_that_was_cut_short_is_kept_again(own_scenario, tmp_path):
    folder = fly(own_scenario, tmp_path / "campaign", keep=["every:2"])
    manifest = coordinator.kept_in(folder, 2) / "manifest.json"
    answer = json.loads(manifest.read_text())
    manifest.write_text(json.dumps({**answer, "status": "no space"}))
    fly(own_scenario, folder, keep=["every:2"])
    assert json.loads(manifest.read_text())["status"] == "completed"


def test_what_was_timed_out_is_made_again_with_more_time(own_scenario, tmp_path):
    folder = fly(own_scenario, tmp_path / "campaign", limit=10.0)
    full = store.digest(folder)
    rows = store._of_block(folder, 0)
    rows[1] = dataclasses.replace(
        rows[1], status="timed out", code=int(Exit.TIMEOUT), numbers={}
    )
    store._write(folder, 0, rows)
    fly(own_scenario, folder, limit=10.0)
    assert store.digest(folder) != full
    fly(own_scenario, folder, limit=20.0)
    assert store.digest(folder) == full


def test_other_options_are_another_campaign_and_named(own_scenario, tmp_path):
    """Whether the digest tells them apart or not."""
    plan, other = (
        coordinator.planned(own_scenario, 3, options=Options(stop=x))[0]
        for x in (5.0, 6.0)
    )
    for new in (other, replace(plan, options=other.options)):
        with pytest.raises(DesatError, match="another campaign: options is "):
            joined(plan, new, tmp_path)
    joined(plan, replace(plan), tmp_path)


def test_options_as_programs_give_them(own_scenario, tmp_path):
    """Tuples come back as lists; what is no integer is no count and no seed."""
    options = Options(stop=5.0, record=("wheels.*",))
    plan, _ = coordinator.planned(own_scenario, 3, options=options)
    plan.write(tmp_path)
    joined(coordinator.read(tmp_path), plan, tmp_path)
    for wrong in ({"count": 2.5}, {"count": 0}, {"seed": -1}, {"seed": 0.5}):
        values = {"count": 3, "seed": 1, **wrong}
        (name,) = wrong
        with pytest.raises(DesatError, match=f"{name} = .*: an integer from"):
            coordinator.planned(own_scenario, values.pop("count"), **values)
        with pytest.raises(DesatError, match=f"{name} = .*: an integer from"):
            draws(
                own_scenario,
                {"count": 3, **wrong}["count"],
                {"seed": 1, **wrong}["seed"],
                Options(),
            )
    with pytest.raises(DesatError, match="at most 10000000"):
        coordinator.planned(own_scenario, 10**13, sampling="latin-hypercube")


def test_an_element_is_not_drawn_alone(tmp_path):
    more = f'[dispersions]\n"{DRAWN}[2]" = {{ normal = [0.0, 1e-3] }}\n'
    with pytest.raises(DesatError, match=r"h_start_wheel\[2\]"):
        coordinator.planned(scenario(tmp_path, more), 3)


def test_numbers_that_differ_by_rounding_have_no_figure(three):
    """Nor are they an error of the histogram's."""
    plan, summary_value = coordinator.read(three), report.summary(three)
    names = list(summary_value.numbers)
    assert len(report._figures(three, plan, summary_value)) <= len(names) + 1
    close = 1.0 + np.array([0.0, 2e-16, 4e-16])
    assert np.ptp(close) > 0.0
    assert np.ptp(close) <= 1e-9 * np.abs(close).max()
