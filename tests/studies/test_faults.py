"""`desat faults`: what each fault does to a craft, and which samples fail."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from desat import faults as desat_faults
from desat.analyses.unmanaged_orbit import mean_torque
from desat.begin import craft as new_craft
from desat.begin.facts import CraftFacts
from desat.campaign.draws import RunRow
from desat.campaign.sampling import draw_of
from desat.fmus.registry import block_class, names
from desat.runs.cases import draft_to_draw
from desat.runs.prepare import prepare, read
from desat.runs.run import execute
from desat.studies import faults
from desat.studies.criteria import CRITERIA, measured_run
from desat.system.errors import DesatError, Exit
from desat.system.options import Options


@pytest.fixture(scope="module")
def craft(tmp_path_factory):
    """A 12U of one's own."""
    folder = tmp_path_factory.mktemp("faults") / "u12"
    new_craft.write(folder, CraftFacts(size="12U", rods="0.2"), "desat new craft")
    return folder


def named(fault):
    """Parameters that a fault names."""
    return [n for key in ("set", "factor", "sample") for n in fault.table.get(key, {})]


def test_faults_name_parameters_that_blocks_have():
    """So a renamed parameter does not make a fault silently inapplicable."""
    blocks = {
        v.name
        for n in names()
        for v in block_class(n)().variables
        if v.causality == "parameter"
    }
    every = faults.declared()
    assert len(every) == 14
    for fault in every.values():
        assert named(fault) or fault.table.get("component")
        assert {x.partition(".")[2] for x in named(fault)} <= blocks, fault.name


def test_values_of_a_fault(craft):
    system, _ = prepare(str(craft), Options()).or_raise()
    every = faults.declared()
    inertia = system.components["spacecraft"].values["inertia[1,1]"]
    found = faults.changes_of(every["inertia"], system)["spacecraft.inertia"]
    assert found[0] == pytest.approx(1.1 * inertia)
    assert len(found) == 9
    assert faults.changes_of(every["coil_turned"], system) == {
        "torquers.failed_coil": "1",
        "torquers.failed_share": -1.0,
    }
    assert faults.changes_of(every["thrust"], system) == (
        "it has no thrusters.tau_level; it has no thrusters.thrust"
    )
    rough = faults.changes_of(every["friction"], system)
    wheels = system.components["wheels"].values
    assert rough == {
        name: pytest.approx(10.0 * wheels[name.partition(".")[2]])
        for name in named(every["friction"])
        if wheels[name.partition(".")[2]]
    }
    assert rough, "a new craft's wheels have friction"


def test_a_sample_with_a_fault_is_the_run_with_its_values(craft):
    """The numbers are those of a run with the drawn values and the fault's."""
    (fault,) = faults.chosen(["coil_weak"])
    options = Options(stop=2000.0)
    found = faults.fly_faults([str(craft)], options, [fault], 1, 3, jobs=1)
    values = {
        **draw_of(draft_to_draw(read(str(craft)), False), 3, 0),
        "torquers.failed_coil": "1",
        "torquers.failed_share": 0.5,
    }
    run = execute(str(craft), replace(options, values=values))
    seen = CRITERIA["peak"].of(measured_run(run.manifest, run.results))
    (outcome,) = found.rows["coil_weak"][1]
    assert outcome.median == pytest.approx(seen, rel=1e-6)
    assert (outcome.count, outcome.failed) == (1, len(run.manifest.not_met) > 0)
    assert set(found.rows) == {"nominal", "coil_weak"}
    assert found.answer.startswith(str(craft))


def test_torques_in_pulses_are_added_to_a_copy_of_the_craft(craft):
    before = {p.name: p.read_text() for p in craft.glob("*.toml")}
    (fault,) = faults.chosen(["pulses"])
    options = Options(stop=900.0)
    found = faults.fly_faults([str(craft)], options, [fault], 1, 1, jobs=1)
    calm, pushed = (found.rows[n][1][0].median for n in ("nominal", "pulses"))
    assert pushed > calm + 1.0, "600 s of 4 uN m are 2.4 mN m s of 15"
    assert {p.name: p.read_text() for p in craft.glob("*.toml")} == before


def test_torques_in_pulses_are_those_of_their_table(craft, tmp_path):
    (fault,) = faults.chosen(["pulses"])
    ((name, block),) = fault.table["component"].items()
    added = fault.table["component"]
    folder = tmp_path / "copy"
    source = read(str(craft))
    target, values = faults._with_component(fault, source, Options(), added, folder)
    torque = mean_torque(prepare(source, Options()).or_raise()[0])
    rows = [
        x for t, *of in fault.table["table"] for x in (t, *(torque * y for y in of))
    ]
    assert values[f"{name}.torque"][: len(rows)] == rows
    assert not any(values[f"{name}.torque"][len(rows) :])
    assert (values[f"{name}.between"], values[f"{name}.repeated"]) == ("hold", True)
    assert f'{name} = "{block}"' in (folder / "craft.toml").read_text()
    assert target.startswith(str(folder))


def test_a_sample_that_never_ends_fails(desat):
    """What the scenario measures the time of is not reached."""
    target = "hausat2/detumbling-b-dot"
    options = (
        "--fault",
        "coil_turned",
        "-n",
        "1",
        "--jobs",
        "1",
        "--stop",
        "600",
        "--json",
    )
    done = desat("faults", target, *options)
    assert done.returncode == Exit.COMPLETED, "it breaks without the fault as well"
    answer = json.loads(done.stdout)
    assert answer["number"]["unit"] == "min"
    outcome = answer["faults"]["coil_turned"]["outcomes"][target]
    assert (outcome["count"], outcome["failed"], outcome["median"]) == (1, 1, None)
    assert outcome["reasons"] == ["detumbled is not reached"]


def test_a_sample_beyond_a_limit_fails(craft):
    """A limit is one more condition; what is not there is beyond it."""
    (fault,) = faults.chosen(["coil_weak"])
    of = [str(craft)], Options(stop=600.0), [fault], 1, 1
    loose, tight = (
        faults.fly_faults(*of, limits={"peak": most}, jobs=1).rows["coil_weak"][1][0]
        for most in (99.0, 1e-3)
    )
    assert tight.failed == 1
    assert "peak is above 0.001" in tight.reasons
    assert "peak is above 0.001" not in loose.reasons


def test_the_worst_fault_is_said_in_words(desat, craft):
    options = (
        "--fault",
        "attitude",
        "--fault",
        "late",
        "--jobs",
        "1",
        "-n",
        "1",
        "--stop",
        "600",
    )
    done = desat("faults", craft.name, *options, cwd=craft.parent)
    assert done.returncode == Exit.UNMET
    text = " ".join(done.stdout.split())
    assert f"{craft.name} breaks under attitude off by 5 deg: 1 of 1 samples" in text
    assert (
        "does not apply: attitude a sample late: it has no star_tracker.delay" in text
    )


@pytest.mark.parametrize(
    ("values", "line"),
    [
        (["u12", "--fault", "dead_weel"], "no such fault; did you mean dead_wheel?"),
        (["u12", "u12", "--laws", "all"], "u12 u12: --laws flies one craft"),
        (["nowhere"], "nowhere"),
        (["u12", "--limit", "peak"], "--limit peak: NAME=MOST is needed"),
        (["u12", "--number", "paek"], "u12: no number paek; did you mean peak?"),
    ],
)
def test_wrong_faults_are_refused_in_a_line(desat, craft, values, line):
    done = desat("faults", *values, "-n", "1", cwd=craft.parent)
    assert done.returncode == Exit.INPUT
    assert line in done.stderr
    assert "Traceback" not in done.stderr


def test_a_program_flies_faults(craft):
    found = desat_faults(str(craft), names=["coil_dead"], count=1, stop=600.0)
    assert set(found.rows) == {"nominal", "coil_dead"}
    assert repr(found) == f"<FaultTable {found.answer}>"


def test_faults_refuse_several_crafts_under_laws():
    with pytest.raises(DesatError, match="--laws flies one craft"):
        faults.fly_faults(["a", "b"], Options(), [], 1, 1, laws=["all"])


@pytest.mark.study
def test_a_fault_under_which_the_first_law_is_worse_flies_more_samples(craft):
    """Only that fault, for all laws, with the samples that were there first."""
    fly = [str(craft)], Options(stop=900.0), faults.chosen(["coil_weak"]), 2, 1
    worse = 0
    for laws in (["cross product", "predictive"], ["predictive", "cross product"]):
        few = faults.fly_faults(*fly, laws, jobs=1)
        more = faults.fly_faults(*fly, laws, jobs=1, more=3)
        for name, (_, outcomes) in few.rows.items():
            counts = [x.count for x in more.rows[name][1]]
            if faults._is_worse(outcomes):
                worse += 1
                assert counts == [3, 3]
            else:
                assert more.rows[name][1] == outcomes
    assert worse


def row(status: str, message: str = "", **numbers: float | None) -> RunRow:
    """Return the row of a sample; one that misses a requirement has a message."""
    unmet = (message,) if status == "completed" and message else ()
    return RunRow(status, 0, message, unmet, numbers=numbers)


def test_samples_are_counted_with_their_reasons():
    """A sample with several reasons fails once; what is not reached is infinite."""
    rows = [
        row("completed", time=1.0, peak=30.0),
        row("completed", time=2.0, peak=60.0),
        row("completed", time=9.0, peak=61.0),
        row("completed", "pointing: 3 deg", time=4.0, peak=70.0),
        row("completed", time=None, peak=None),
        row("failed", "controller: no number", time=0.1),
    ]
    outcome = faults._outcome(rows, "time", {"peak": 60.0})
    assert (outcome.count, outcome.failed) == (6, 4)
    assert outcome.median == pytest.approx(6.5), "of 1, 2, 4, 9 and two infinite ones"
    assert outcome.reasons == (
        "peak is above 60",
        "pointing",
        "time is not reached",
        "controller",
    )
    assert outcome.text == "6.5; 4 of 6 fail"
    never = faults._outcome(rows[4:], "time", {})
    assert (never.median, never.text) == (None, "2 of 2 fail")
    peak = faults._outcome(rows[:2], "peak", {})
    assert (peak.median, peak.failed, peak.reasons) == (45.0, 0, ())


def answer_of(*outcomes: faults.FaultOutcome) -> str:
    """Return the answer of a table: without a fault, then faults a, b, ..."""
    named = ("nominal", "a", "b", "c")
    rows = {
        n: (faults.Fault(n, f"fault {n}", {}), (x,))
        for n, x in zip(named, outcomes, strict=False)
    }
    table = faults.FaultTable(("craft",), ("law",), "Time", "min", 1, rows, {})
    return table.answer


def test_the_worst_fault_is_that_of_most_failures_then_of_the_largest_median():
    good, slow = faults.FaultOutcome(4, 0, 1.0, ()), faults.FaultOutcome(4, 0, 3.0, ())
    bad, never = (
        faults.FaultOutcome(4, 1, 0.5, ("x",)),
        faults.FaultOutcome(8, 2, None, ("y",)),
    )
    assert answer_of(good) == "law: no fault applies."
    assert answer_of(good, good, slow) == (
        "law: no fault makes it fail; the worst is fault b (3 min)."
    )
    assert answer_of(good, bad, slow) == (
        "law breaks under fault a: 1 of 4 samples fail: x."
    )
    assert answer_of(good, bad, never, slow) == (
        "law breaks under fault b: 2 of 8 samples fail: y."
    )
    half = faults.FaultOutcome(4, 2, 1.0, ("w",))
    assert answer_of(good, half, faults.FaultOutcome(8, 3, 1.0, ("y",))) == (
        "law breaks under fault a: 2 of 4 samples fail: w."
    )
    broken = faults.FaultOutcome(4, 4, None, ("z",))
    assert answer_of(broken, bad) == "law fails without a fault: z."
    assert answer_of(bad, bad, good) == (
        "law: no fault makes it fail; the worst is fault a (0.5 min)."
    )


@pytest.mark.parametrize(("drawn", "samples"), [(True, [2, 3, 4]), (False, [])])
def test_a_scenario_without_draws_flies_once(drawn, samples):
    contender = faults.Contender("law", read("hausat2/detumbling-b-dot"), Options())
    fault = faults.declared()["coil_dead"]
    flight = faults.FaultFlight(fault, contender, "target", {"a.b": 1.0}, drawn)
    assert [x[3] for x in flight.tasks(range(2, 5), 7, ("peak",))] == samples
    first = [0, 1] if drawn else [None]
    tasks = flight.tasks(range(2), 7, ("peak",))
    assert tasks == [
        ("target", contender.options, 7, x, ("peak",), {"a.b": 1.0}) for x in first
    ]


@pytest.mark.parametrize(
    ("first", "second", "is_worse"),
    [
        ((0, 1.0), (0, 1.0), False),
        ((0, 1.0), (1, 0.5), True),
        ((1, 1.0), (0, 2.0), True),
        ((0, 1.0), (4, None), False),
        ((4, None), (4, None), False),
    ],
)
def test_a_law_is_worse_by_a_failure_or_by_its_median(first, second, is_worse):
    outcomes = [
        faults.FaultOutcome(4, failed, median, ()) for failed, median in (first, second)
    ]
    assert faults._is_worse(outcomes) is is_worse


def test_a_free_number_is_searched_first_and_said(craft, monkeypatch):
    """Of a law that has it, over other samples; a law without it flies as it is."""
    calls = []

    def tune(target, parameter, number, options, *, seed, jobs):
        calls.append((parameter, number, seed))
        return type("Found", (), {"best": 2e-3})

    monkeypatch.setattr(faults.tune, "tune", tune)
    laws = ["cross product", "predictive"]
    fly = [str(craft)], Options(stop=300.0), faults.chosen(["coil_weak"]), 1, 4, laws
    found = faults.fly_faults(*fly, jobs=1, free="manager.gain")
    assert calls == [("manager.gain", "peak", 5)]
    assert found.labels == ("cross product, manager.gain = 0.002", "predictive")
    with pytest.raises(DesatError, match="predictive: it has no parameter manager"):
        faults.fly_faults(*fly, jobs=1, free={"predictive": "manager.gain"})


def test_pulses_act_on_a_family_of_ours(tmp_path):
    """Its craft with the torque more, under the scenario's own samples."""
    (fault,) = faults.chosen(["pulses"])
    options = Options(stop=60.0)
    target = "alsat1/spin"
    found = faults.fly_faults([target], options, [fault], 1, 1, (), jobs=1)
    assert not found.without
    assert found.rows["pulses"][1][0].has_effect


@pytest.mark.parametrize("rods", ["0.2", "2"])
def test_sizes_of_faults_follow_the_craft(tmp_path, rods):
    """Coupling, field, rate and pulses as shares of what the craft has."""
    facts = {"size": "12U", "altitude": "500km", "inclination": "60deg", "rods": rods}
    new_craft.write(tmp_path / "c", CraftFacts(**facts), "")
    system, _ = prepare(str(tmp_path / "c"), Options()).or_raise()
    changes = {
        name: faults.changes_of(fault, system)
        for name, fault in faults.declared().items()
    }
    coupling = np.reshape(changes["coupling"]["magnetometer.coil_coupling"], (3, 3))
    field = np.linalg.norm(coupling, 2) * float(rods)
    assert field == pytest.approx(0.2 * 3.8e-5, rel=0.3), "a fifth of the field"
    bias = np.linalg.norm(changes["field"]["magnetometer.bias_body"])
    assert bias == pytest.approx(0.05 * 3.8e-5, rel=0.1)
    assert changes["gyro_bias"]["gyro.bias_body"][0] == pytest.approx(
        0.1 * 2.0 * math.pi / 5677.0, rel=1e-2
    )
    assert 1e-8 < faults.unit_of_fault(faults.declared()["pulses"], system) < 1e-5


def test_a_fault_that_moves_no_number_says_so(craft):
    found = faults.fly_faults(
        [str(craft)],
        Options(stop=600.0, sets=["manager.enable=false"]),
        faults.chosen(["coil_dead"]),
        1,
        1,
        jobs=1,
    )
    (outcome,) = found.rows["coil_dead"][1]
    assert not outcome.has_effect
    assert outcome.text.endswith("; no effect")
