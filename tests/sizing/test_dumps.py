"""Dumps by thrusters between thresholds: the law, pulses that carry their rest, a GEO
craft from one line, and what `desat size` says of it beside values from elsewhere and
its closed loop."""

from __future__ import annotations

import itertools
import json
import re
import signal
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from desat.analyses import lower_bound
from desat.analyses.flight import flight_of
from desat.begin.craft import write
from desat.begin.facts import CraftFacts
from desat.components.blocks.manager_threshold import ManagerThreshold
from desat.components.blocks.thrusters import Thrusters
from desat.components.contract.block import BlockError
from desat.components.laws import least_firing
from desat.engine import loop
from desat.numbers.derived import coil_impulse
from desat.numbers.measures import growth_between
from desat.report.run_tables import tabulate_numbers
from desat.runs.checking import check
from desat.runs.prepare import prepare
from desat.runs.run import execute, simulate
from desat.sizing import dumps, page
from desat.sizing.dumps import size as size_dumps
from desat.sizing.requirements import SizingRequirements
from desat.system.errors import DesatError
from desat.system.options import Options
from tests.conftest import slow_after

GEO = CraftFacts(
    orbit="geo",
    mass="2500kg",
    box="2.5,2.5,3",
    wheels="4 pyramid 50Nms",
    rods="none",
    thrusters="4 10N",
    dump="thrusters 70:10",
    panel="13m2 1.35m",
    epoch="2027-03-20",
)
FLAT = Options(
    sets=[
        "spacecraft.radiation=area",
        "spacecraft.area_radiation=13",
        "spacecraft.centre_radiation_body=0,-1.35,0",
        "thrusters.arm=1.5",
        "thrusters.pulse_loss=0",
    ]
)
LOW = CraftFacts(
    altitude="600km",
    mass="150kg",
    wheels="4 pyramid 0.3Nms",
    rods="none",
    thrusters="4 1N",
    dump="thrusters 70:10",
)
FAR = CraftFacts(
    sun="1AU",
    mass="600kg",
    wheels="4 pyramid 15Nms",
    thrusters="4 1N",
    dump="thrusters 70:10 aligned",
    pointing="inertial",
    secular="0uNm,90uNm,60uNm",
)


def law(**values: object) -> ManagerThreshold:
    block = ManagerThreshold()
    for name, value in {"begin": 1.0, "end": 0.2, "torque": 0.01, **values}.items():
        setattr(block, name, value)
    block.check()
    block.start()
    return block


def fly(block: ManagerThreshold, momentum: list[float], steps: int, grows: float = 0.0):
    """Samples of a wheel assembly that takes just what is commanded: momenta, modes,
    torques."""
    h, rows = np.array([*momentum, 0.0]), []
    for k in range(steps):
        block.h_wheel = tuple(h)
        block.advance(10.0 * k, 10.0)
        n = np.array(block.tau_cmd_thruster_body)
        rows.append((float(np.abs(h).max()), block.mode, n))
        h[:3] += 10.0 * n
        h[0] += 10.0 * grows
    return rows


def test_a_dump_goes_from_one_threshold_to_the_other():
    block = law()
    rows = fly(block, [0.99, 0.0, 0.0], 400, grows=1e-3)
    dumping = [fill for fill, mode, _ in rows if mode == 1]
    assert max(fill for fill, _, _ in rows) < 1.011, (
        "no sample beyond the first above it"
    )
    assert 0.19 < min(fill for fill, _, _ in rows) <= 0.2 + 0.01 + 1e-9, (
        "which has grown since"
    )
    # 400 samples of 0.01 N m s are 4 N m s, of which a dump takes 0.8: the fifth has
    # begun
    assert block.dumps == 5
    assert block.dumping_time == pytest.approx(10.0 * len(dumping))
    assert all(np.linalg.norm(n) <= 0.01 + 1e-15 for _, _, n in rows)


def test_a_dump_by_the_calendar_begins_at_its_multiples():
    """At 600 s nothing is above the end; at 1200 s and 1800 s 0.6 N m s are."""
    block = law(period=600.0, begin=5.0, torque=0.1)
    rows = fly(block, [0.0, 0.0, 0.0], 200, grows=3e-4)
    begins = [
        10 * k
        for k, (before, now) in enumerate(itertools.pairwise(rows), 1)
        if now[1] == 1 and before[1] != 1
    ]
    assert begins == [1200, 1800]
    assert block.dumps == 2
    early = law(period=600.0, torque=0.1)
    assert fly(early, [1.0, 0.0, 0.0], 1)[0][1] == 1, "at its threshold at once"


CONTACTS = "begin [h],end [min]\n2,150\n14,900\n"


def times_of(windows, **values):
    """Return a law with windows (s), from which its table follows."""
    table = [x for row in windows for x in row]
    return law(windows=tuple(table + [0.0] * (64 - len(table))), **values)


def test_a_dump_waits_for_its_window_and_goes_on_in_the_next():
    """0.8 N m s take 80 samples of 10 s; a window has 30."""
    block = times_of([(500.0, 800.0), (2000.0, 9000.0)], torque=1e-3)
    rows = fly(block, [1.0, 0.0, 0.0], 400)
    modes = [mode for _, mode, _ in rows]
    assert modes[:50] == [2] * 50
    assert modes[50:80] == [1] * 30
    assert set(modes[80:200]) == {2}
    assert modes[200:250] == [1] * 50
    assert block.dumps == 2
    assert all(not n.any() for _, mode, n in rows if mode != 1)


def test_windows_repeat_and_open_when_they_say():
    block = times_of([(100.0, 200.0), (300.0, 400.0)], windows_period=1000.0)
    inside = [t for t in range(0, 3000, 50) if block.is_open(float(t))]
    assert inside == [b + x for b in (0, 1000, 2000) for x in (100, 150, 300, 350)]
    for t in np.linspace(0.0, 2999.0, 200):
        opens = block.next_open(float(t))
        assert opens >= t
        assert block.is_open(opens)
        assert opens == t or not block.is_open(0.5 * (t + opens))
    once = times_of([(100.0, 200.0)])
    assert once.next_open(200.0) == np.inf
    lines = list(once.foresee(0.0, 300.0, frozenset({"tau_cmd_thruster_body"})))
    assert lines == [
        "windows: the last ends at 200 s, the run at 300 s: no dump is after it"
    ]


@pytest.mark.parametrize(
    "dump",
    slow_after(
        1,
        [
            "thrusters every 2d within FILE each 1d",
            "thrusters every 1d",
            "thrusters 12Nms:0",
            "thrusters 70:10 within FILE each 1d",
            "thrusters 70:10 outside FILE each 18h",
        ],
        "study",
    ),
)
def test_dumps_by_calendar_and_momentum_are_sized_as_they_fly(tmp_path, dump):
    (tmp_path / "contacts.csv").write_text(CONTACTS)
    wheels = "4 pyramid 20Nms" if "FILE" in dump else GEO.wheels
    dump = dump.replace("FILE", str(tmp_path / "contacts.csv"))
    write(tmp_path / "mine", replace(GEO, dump=dump, wheels=wheels), "")
    sizing = size_dumps(
        str(tmp_path / "mine"),
        Options(stop=12.0 * 86400.0),
        SizingRequirements(year=False),
    )
    assert sizing.loop["dumps_a_week"] == pytest.approx(sizing.steady.a_week, rel=0.05)
    assert sizing.loop["dump_momentum"] == pytest.approx(
        sizing.steady.momentum, rel=0.05
    )
    assert sizing.loop["dump_propellant"] == pytest.approx(
        sizing.steady.propellant, rel=0.05
    )
    if "every 1d" in dump:
        assert sizing.steady.a_week == pytest.approx(7.0, rel=0.01)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("begin,end\n5,5\n", "it is empty"),
        ("begin,end\n5,9\n7,12\n", "before the last one ends"),
        ("begin [kg],end [s]\n5,9\n", "kg"),
        ("begin,end\n" + "".join(f"{k},{k}.5\n" for k in range(1, 40)), "32 are taken"),
        ("begin,end\n5,9e4\n", "the last window ends at 90000 s"),
        ("", "there is no row"),
    ],
)
def test_windows_that_are_none_are_refused(tmp_path, text, message):
    (tmp_path / "w.csv").write_text(text)
    dump = f"thrusters 70:10 within {tmp_path / 'w.csv'} each 1d"
    with pytest.raises(DesatError, match=message):
        write(tmp_path / "mine", replace(GEO, dump=dump), "")
    assert not (tmp_path / "mine").exists()


def test_thrusters_hold_the_attitude_in_a_dump(tmp_path):
    """They give the controller's torque as well; the wheels the dumping torque alone."""
    block = law(attitude_by=1)
    block.tau_ctrl_body, block.h_wheel = (1e-3, 0.0, 2e-3), (1.0, 0.0, 0.0, 0.0)
    block.advance(0.0, 10.0)
    assert block.tau_cmd_thruster_body == pytest.approx((-9e-3, 0.0, 2e-3))
    others = law()
    others.h_wheel = block.h_wheel
    others.advance(0.0, 10.0)
    assert block.tau_cmd_wheel == others.tau_cmd_wheel
    write(tmp_path / "mine", replace(GEO, wheels="4 pyramid 15Nms"), "")
    options = Options(stop=12.0 * 86400.0, values={"manager.attitude_by": "thrusters"})
    sizing = size_dumps(str(tmp_path / "mine"), options, SizingRequirements(year=False))
    assert sizing.loop["dump_propellant"] == pytest.approx(
        sizing.steady.propellant, rel=0.05
    )
    assert sizing.loop["pointing_largest"] < 0.5


@pytest.mark.study
def test_wheels_that_are_not_known_widen_the_time_between_dumps(tmp_path):
    ratios = []
    for wheels in ("4 pyramid 50Nms", "4 pyramid 50Nms +-80%", None):
        folder = tmp_path / str(len(ratios))
        write(folder, replace(GEO, wheels=wheels, dump="thrusters 70:10"), "")
        rows = size_dumps(
            str(folder), Options(), SizingRequirements(year=False, flown=False)
        ).intervals
        ratios.append(rows[1].high / rows[1].low)
    assert ratios[0] < 2.0 < 2.5 < ratios[1] < ratios[2]


def test_an_aligned_dump_waits_for_its_attitude_but_not_for_ever():
    turned = [1.0, 1.0, 0.0]  # |h|_1 / |h| is 1.414
    assert [
        mode for _, mode, _ in fly(law(aligned=1.1, longest_wait=45.0), turned, 7)
    ] == ([2] * 5 + [1] * 2)
    assert [mode for _, mode, _ in fly(law(aligned=1.5), turned, 2)] == [1, 1]


def test_a_dump_that_waits_begins_before_the_wheels_are_full():
    """An inertial craft does not turn: its momentum never lies along an axis."""
    turned = [1.0, 1.0, 0.0]
    block = law(aligned=1.1, latest=1.2)
    rows = fly(block, turned, 100, grows=1e-3)
    assert [mode for _, mode, _ in rows[:10]] == [2] * 10
    first = next(fill for fill, mode, _ in rows if mode == 1)
    assert 1.2 <= first < 1.22
    assert max(fill for fill, _, _ in rows) < 1.22
    assert fly(law(aligned=1.1, latest=1.01), [1.0, 0.0, 0.0], 1)[0][1] == 1


@pytest.mark.parametrize(
    ("options", "count"),
    [
        ((), 0),
        (("manager.latest=0",), 1),
        (("manager.latest=0", "manager.longest_wait=20000"), 0),
        (("manager.latest=40",), 1),
    ],
)
def test_a_wait_that_cannot_be_afforded_is_refused(tmp_path, options, count):
    write(tmp_path / "c", FAR, "")
    checked = check(str(tmp_path / "c"), Options(sets=list(options)))
    assert len([x for x in checked.problems if "wait" in x]) == count
    if options == ("manager.latest=0",):
        (line,) = checked.problems
        assert "bring up to 5.61 N m s into a wheel, which holds 4.5 N m s" in line
        with pytest.raises(DesatError, match="longest_wait = 86400 s"):
            size_dumps(str(tmp_path / "c"), Options(sets=list(options)))


def test_a_craft_whose_dumps_wait_keeps_its_attitude(tmp_path):
    write(tmp_path / "c", FAR, "")
    start = "wheels.h_start_wheel=10.4,10.4,0,0"
    run = execute(str(tmp_path / "c"), Options(stop=60000.0, sets=[start]))
    numbers = run.manifest.numbers
    assert numbers["dumps"].value == 1.0
    assert numbers["largest_momentum"].value == pytest.approx(85.0, abs=0.5)
    assert numbers["pointing_largest"].value < 0.5
    few = tabulate_numbers(run.manifest, None, ["this run"])
    rows = [row for row in few.rows if "fewer than two events" in str(row[-1])]
    (row,) = rows
    assert "Time between two dumps, mean, momentum that a dump takes out" in str(row[0])


@pytest.mark.study
def test_rates_are_of_the_weeks_between_dumps(tmp_path):
    """Its first dump comes after a week; node and Sun move meanwhile."""
    facts = replace(
        LOW,
        mass="100kg",
        altitude="650km",
        inclination="60deg",
        wheels="4 pyramid 1Nms",
    )
    write(tmp_path / "c", facts, "")
    wishes = SizingRequirements(flown=False, year=False)
    target = str(tmp_path / "c")
    short = size_dumps(target, Options(sets=[]), wishes)
    long = size_dumps(target, Options(stop=60 * 86400.0), wishes)
    assert short.steady.a_week == pytest.approx(long.steady.a_week, rel=0.05)
    assert short.steady.first == pytest.approx(long.steady.first, rel=1e-3)


@pytest.mark.study
def test_the_numbers_of_a_sentence_are_of_one_condition(tmp_path):
    write(tmp_path / "c", LOW, "")
    found = size_dumps(str(tmp_path / "c"), Options(), SizingRequirements(flown=False))
    sentence = re.search(
        r"dumps (\S+) times a week, (\S+) g each, (\S+) kg a year at this rate; over "
        r"the dates of a year (\S+) kg \((\S+) to (\S+) by date\)",
        found.answer,
    )
    assert sentence is not None
    rate, grams, a_year, mean, least, most = map(float, sentence.groups())
    assert rate * 365.25 / 7.0 * grams * 1e-3 == pytest.approx(a_year, rel=0.02)
    assert least <= mean <= most


@pytest.mark.study
@pytest.mark.parametrize(("rods", "suffice"), [("0.5", True)])
def test_a_craft_with_rods_and_thrusters_is_told_which_suffices(
    tmp_path, desat, rods, suffice
):
    command = ["new", "craft", "c", "--size", "12U", "--sso", "500km", "--rods", rods]
    dump = ["--thrusters", "4 50mN", "--dump", "thrusters 70:10"]
    done = desat(*command, *dump, cwd=tmp_path, check=True)
    assert re.search(r"momentum is removed by +thrusters alone", done.stdout)
    assert "'both 70:10' lets the rods take what they can" in done.stdout
    found = size_dumps(
        str(tmp_path / "c"), Options(), SizingRequirements(flown=False, year=False)
    )
    assert found.rods is not None
    assert found.rods.suffice == suffice
    assert 0.02 < found.rods.needed < 0.2
    text = "suffice alone (" if suffice else "do not suffice alone: "
    assert f"Its rods of {rods} A m2 {text}" in found.answer


BOTH = CraftFacts(
    size="12U",
    altitude="500km",
    inclination="51.6deg",
    thrusters="4 10mN",
    rods="0.004Am2",
    dump="both 70:10",
    residual_dipole="0.1Am2",
)


@pytest.mark.study
@pytest.mark.parametrize(
    ("changes", "days"),
    [
        ({}, 4),
        ({"dump": "both every 1d"}, 6),
        ({"rods": "0.006Am2"}, 8),
        ({"pointing": "sun", "rods": "0.01Am2"}, 5),
    ],
)
def test_thrusters_dump_what_rods_leave_as_it_flies(tmp_path, changes, days):
    write(tmp_path / "mine", replace(BOTH, **changes), "")
    craft = str(tmp_path / "mine")
    sizing = size_dumps(
        craft, Options(stop=86400.0 * days), SizingRequirements(year=False)
    )
    assert sizing.loop["dumps"] > 3
    assert sizing.loop["dumps_a_week"] == pytest.approx(sizing.steady.a_week, rel=0.05)
    assert sizing.loop["propellant_a_year"] == pytest.approx(
        sizing.steady.a_year, rel=0.05
    )
    case = prepare(craft, Options(stop=86400.0 * days))
    with simulate(case).or_raise(craft).results as series:
        flight = flight_of(case.or_raise()[0], series)
        dipole = series.values("torquers.m_mean_body")
    coils = coil_impulse(flight.times, flight.b, flight.q, dipole[: len(flight.q) - 1])
    impulse = flight.disturbance[-1]
    of_coils = -(coils[-1] @ impulse) / (impulse @ impulse)
    assert sizing.coil_share == pytest.approx(of_coils, abs=0.05)
    assert 0.1 < of_coils < 0.9
    share = f"A m2 take {100.0 * sizing.coil_share:.3g} % of the momentum"
    assert share in sizing.answer


@pytest.mark.study
def test_rods_that_suffice_leave_the_thrusters_nothing(tmp_path):
    write(tmp_path / "mine", replace(BOTH, rods="0.1Am2"), "")
    craft = size_dumps(
        str(tmp_path / "mine"), Options(), SizingRequirements(flown=False, year=False)
    )
    assert craft.steady.a_week == 0.0
    assert craft.coil_share == pytest.approx(1.0, abs=0.01)
    assert "no dump. Its rods of 0.1 A m2 take 100 % of the momentum" in craft.answer


@pytest.mark.study
def test_what_the_law_commands_at_most_counts_as_smaller_rods(tmp_path):
    requirements, shares = SizingRequirements(flown=False, year=False), []
    for rods, values in (("0.004Am2", {"manager.m_limit": 0.002}), ("0.002Am2", {})):
        write(tmp_path / rods, replace(BOTH, rods=rods), "")
        craft = str(tmp_path / rods)
        shares.append(size_dumps(craft, Options(values=values), requirements))
    assert shares[0].coil_share == pytest.approx(shares[1].coil_share, rel=1e-6)
    assert shares[0].steady.a_week == pytest.approx(shares[1].steady.a_week, rel=1e-6)


def test_coils_work_all_the_time_beside_thrusters():
    block = law(by=2, m_limit=0.5, gain=1e-3, fill=1)
    block.b_body = (0.0, 3e-5, 0.0)
    block.h_wheel = (0.5, 0.0, 0.3, 0.0)
    block.advance(0.0, 10.0)
    m = np.clip(1e-3 * np.cross([0.5, 0.0, 0.3], block.b_body) / 9e-10, -0.5, 0.5)
    assert block.m_cmd_body == pytest.approx(tuple(m))
    assert block.tau_cmd_thruster_body == (0.0, 0.0, 0.0)
    assert block.mode == 0
    block.h_wheel = (0.5, 0.0, 3.0, 0.0)
    block.advance(10.0, 10.0)
    assert block.mode == 1
    assert any(block.m_cmd_body)
    assert np.linalg.norm(block.tau_cmd_thruster_body) == pytest.approx(0.01)
    assert block.dumped == pytest.approx(0.1)


@pytest.mark.study
@pytest.mark.parametrize("dump", ["thrusters 70:10", None])
def test_what_is_computed_after_a_run_takes_less_than_its_flight(tmp_path, dump):
    """A month of a craft with rods and thrusters: no programme over all its samples."""
    facts = CraftFacts(
        orbit="geo",
        mass="1500kg",
        wheels="4 pyramid 40Nms",
        rods="30",
        thrusters="4 10N",
        dump=dump,
    )
    write(tmp_path / "c", facts, "")
    start = ["wheels.h_start_wheel=30,30,-30,-30"] if dump == "thrusters 70:10" else []
    began = time.process_time()
    run = execute(str(tmp_path / "c"), Options(stop=28 * 86400.0, sets=start))
    seconds = time.process_time() - began
    assert "bound" not in run.manifest.numbers
    stepping = 1e-6 * run.manifest.us_per_step * run.manifest.steps_done
    assert seconds < 2.0 * stepping + 3.0
    if dump == "thrusters 70:10":
        assert run.manifest.numbers["dumps"].value >= 1.0
        with pytest.raises(DesatError, match=r"no bound: 241920 samples of 10 s"):
            lower_bound.of_run(run.manifest, run.results)


def test_a_large_programme_ends_with_a_signal(monkeypatch):
    """The solver runs in a thread of its own, which a signal cancels."""
    monkeypatch.setattr(least_firing, "LARGE", 10)
    rng, n = np.random.default_rng(1), 40_000
    rows, cost = rng.normal(size=(3, n)), rng.random(n)
    none, most = np.zeros(n), np.ones(n)

    def solve_many() -> None:
        for k in range(500):
            goal = np.array([1.0, 2.0, 3.0 + k])
            least_firing.programme(cost, rows, goal, none, most)

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, stop)
    began = time.monotonic()
    signal.setitimer(signal.ITIMER_REAL, 0.15)
    try:
        with pytest.raises(KeyboardInterrupt):
            solve_many()
    finally:
        signal.signal(signal.SIGALRM, before)
    assert time.monotonic() - began < 5.0


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"end": 1.0}, "end = 1.0 N m s is not below begin"),
        ({"latest": 0.9}, "latest = 0.9 N m s is not above begin"),
        ({"aligned": 0.5}, "is never below 1"),
        ({"windows": (5.0, 4.0) + (0.0,) * 62}, "row 1, 5.0 to 4.0 s"),
        ({"windows": (1.0, 4.0, 3.0, 5.0) + (0.0,) * 60}, "row 2, 3.0 to 5.0 s"),
        (
            {"windows": (1.0, 4.0) + (0.0,) * 62, "windows_period": 3.0},
            "the last ends at 4.0 s",
        ),
    ],
)
def test_thresholds_that_mean_nothing_are_refused(values, text):
    with pytest.raises(BlockError, match=text):
        law(**values)


@pytest.mark.parametrize(("carried", "values"), [(False, 0.0), (True, 1.0)])
def test_what_a_pulse_leaves_comes_with_the_next(carried, values):
    """Of a torque whose on-times are a third of the shortest pulse, both ways."""
    block = Thrusters()
    block.carried, block.sample_time, block.least_pulse = carried, 10.0, 0.06
    block.check()
    block.start()
    total = 0.0
    for k in range(300):
        way = 1.0 if k < 240 else -1.0
        block.tau_cmd_thruster_body = (way * 0.02 / 10.0 * block.tau_level[0], 0.0, 0.0)
        block.advance(10.0 * k, 10.0)
        total += 10.0 * block.tau_mean_thruster_body[0]
    expected = (240 - 60) * 0.02 * block.tau_level[0]
    assert total == pytest.approx(values * expected, abs=0.06 * block.tau_level[0])


def test_growth_is_between_the_first_event_and_the_last():
    times = np.arange(11.0)
    events = np.array([[0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3]], float).T
    grown = np.array([[0, 0, 0, 4, 4, 4, 8, 8, 8, 12, 12]], float).T
    assert growth_between(times, grown, events, 6.0) == 8.0
    assert np.isnan(growth_between(times, grown, 0.0 * events, 6.0))


def test_a_run_of_many_millions_of_steps_goes_on():
    """The chunk between two looks at the clock grew without end where a buffer ends
    each."""
    master = SimpleNamespace(k=0)

    class Steps:
        seconds = 0.0

        def some(self, most: int) -> None:
            master.k += most

    recorder_value = SimpleNamespace(steps_before_look=1000, look=lambda: None)
    recorder, never = (
        SimpleNamespace(tick=lambda: None),
        SimpleNamespace(reason=lambda: ""),
    )
    loop.run(master, Steps(), 2_000_000, recorder, never, observer=recorder_value)
    assert master.k == 2_000_000


@pytest.fixture(scope="module")
def geo(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("geo") / "geo"
    write(folder, GEO, "desat new craft geo")
    assert not (folder / "detumbling.toml").exists()
    return str(folder)


@pytest.fixture(scope="module")
def sizing(geo) -> dumps.DumpSizing:
    return dumps.size(geo, Options(), SizingRequirements(flown=False))


@pytest.mark.study
def test_the_geo_of_the_notes_is_sized_from_one_line(geo):
    """76.9 uN m on 20 March 2027, 71.4 (12 June) to 80.3 (19 February) over the year, 0.918 dumps a
    week, 1.038 kg a year flown and 0.749 at least, by hand-made files and other code.

    Theirs is one area that always faces the Sun, with thrusters that lose nothing."""
    sizing = dumps.size(geo, FLAT, SizingRequirements(flown=False))
    assert np.linalg.norm(sizing.secular) == pytest.approx(76.9e-6, rel=0.005)
    least, most = (pick(sizing.year, key=lambda d: d.secular) for pick in (min, max))
    assert (least.day, most.day) == ("2027-06-12", "2028-02-19")
    assert least.secular == pytest.approx(71.4e-6, rel=0.005)
    assert most.secular == pytest.approx(80.3e-6, rel=0.005)
    assert sizing.steady.a_week == pytest.approx(0.918, rel=0.05)
    assert sizing.a_year == pytest.approx(1.038, rel=0.05)
    assert sizing.least_a_year == pytest.approx(0.749, rel=0.02)
    assert sizing.problems == ()


def test_the_pictures_of_a_sizing_are_of_its_numbers(sizing, tmp_path):
    """The course goes from threshold to threshold; at the craft's own threshold the
    curve has the rate of a day that lasts; a higher one dumps less often."""
    times, fill, begun = sizing.course
    assert len(begun) >= 2
    assert fill.max() == pytest.approx(sizing.begin, rel=0.02)
    rows = np.searchsorted(times, begun)
    assert (fill[rows] >= sizing.begin * (1.0 - 1e-9)).all()
    after = fill[(rows + 1).clip(max=len(fill) - 1)]
    assert (after[:-1] < 0.3 * sizing.begin).all()
    assert begun[0] == pytest.approx(sizing.steady.first, rel=1e-9)
    rates = [t.a_week for t in sizing.thresholds]
    assert rates == sorted(rates, reverse=True)
    (at_begin,) = [
        t for t in sizing.thresholds if t.begin == pytest.approx(sizing.begin)
    ]
    assert at_begin.a_week == pytest.approx(sizing.steady.a_week, rel=0.1)
    document = sizing.as_json()
    assert "course" not in document
    assert [t["begin"] for t in document["thresholds"]] == [
        t.begin for t in sizing.thresholds
    ]
    text = page.write_dumps(sizing, tmp_path / "size.html").read_text()
    for caption in (
        "Momentum of the wheels, dump after dump",
        "Propellant a year over the momentum at which dumps begin",
        "Dumps a week over the momentum at which they begin",
    ):
        assert caption in text


def test_a_map_of_dumps_has_the_craft_itself_and_its_tank(tmp_path, desat):
    write(tmp_path / "mine", replace(LOW, propellant="2kg"), "")
    axes = ["--wheels", "0.3,0.6", "--thresholds", "50,70", "--years", "2,4"]
    process = desat("size", "mine", "--map", *axes, "--json", cwd=tmp_path, check=True)
    answer = json.loads(process.stdout)
    craft = size_dumps(
        str(tmp_path / "mine"), Options(), SizingRequirements(flown=False, year=False)
    )
    for cell in answer["cells"]:
        assert cell["end"] == pytest.approx(0.1 * cell["wheel"])
        assert cell["tanks"] == pytest.approx([2 * cell["a_year"], 4 * cell["a_year"]])
    by_share = {round(t.begin, 9): t for t in craft.thresholds}
    for cell in answer["cells"][:2]:  # the wheels that it has
        same = by_share[round(cell["begin"], 9)]
        assert (cell["a_week"], cell["a_year"]) == (same.a_week, same.a_year)
    assert answer["cells"][2]["a_week"] < 0.7 * answer["cells"][0]["a_week"]
    text = desat("size", "mine", "--map", *axes, cwd=tmp_path, check=True).stdout
    assert "tank for 4 years" in text
    assert "its tank lasts" in text
    page = (tmp_path / "runs" / "size-map-mine.html").read_text()
    assert "Dumps by wheels and thresholds: mine" in page
    assert "wheels of 600 mN m s" in page


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--rods", "1"], "--rods: no rods work between its dumps; manager.by = both"),
        (["--dipoles", "1"], "--dipoles: it is of coils, and this craft dumps by"),
        (["--wheels", "0"], "--wheels 0: numbers above 0 are needed"),
        (["--thresholds", "120"], "--thresholds 120: 1 to 100 % are covered"),
    ],
)
def test_a_map_of_dumps_that_cannot_be_is_refused(tmp_path, desat, options, message):
    write(tmp_path / "mine", LOW, "")
    process = desat("size", "mine", "--map", *options, cwd=tmp_path)
    assert process.returncode == 2
    assert message in process.stderr


def test_what_the_model_says_comes_before_the_loop(tmp_path, desat):
    write(tmp_path / "mine", CraftFacts(size="12U", altitude="500km"), "")
    lines = desat("size", "mine", "--no-year", cwd=tmp_path).stdout.splitlines()
    assert re.match(r"sized: mine by the model: [\d.]+ A m2 is the least rod", lines[0])
    assert lines[1].startswith("mine holds")


@pytest.mark.study
def test_the_model_is_within_5_percent_of_the_closed_loop(tmp_path):
    """A craft in low orbit with thrusters alone, for it dumps often: 3 days, seven
    dumps."""
    facts = CraftFacts(
        sso="600km", size="12U", rods="none", thrusters="4 10mN", dump="thrusters 70:10"
    )
    write(tmp_path / "mine", facts, "desat new craft mine")
    sizing = dumps.size(
        str(tmp_path / "mine"),
        Options(stop=12.0 * 86400.0),
        SizingRequirements(year=False),
    )
    assert sizing.loop["dumps"] >= 7
    assert sizing.steady.a_week == pytest.approx(sizing.loop["dumps_a_week"], rel=0.05)
    assert sizing.steady.a_year == pytest.approx(
        sizing.loop["propellant_a_year"], rel=0.05
    )


@pytest.mark.study
def test_wheels_of_the_weekly_capacity_dump_once_a_week(sizing, tmp_path):
    """50 N m s dump 0.918 times a week, so that 45.9 N m s dump once."""
    assert sizing.weekly == pytest.approx(45.9, rel=0.05)
    facts = {k: v for k, v in vars(GEO).items() if v is not None}
    smaller = {**facts, "wheels": f"4 pyramid {sizing.weekly:.6g}Nms"}
    write(tmp_path / "mine", CraftFacts(**smaller), "desat new craft mine")
    found = dumps.size(
        str(tmp_path / "mine"), Options(), SizingRequirements(year=False, flown=False)
    )
    assert found.steady.a_week == pytest.approx(1.0, rel=0.02)


def test_worst_of_a_geo_craft_is_sound(geo):
    case = prepare(f"{geo}/worst.toml", Options())
    assert case.problems == []


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"dump": None}, "no rods: --dump says what takes momentum out"),
        ({"dump": "thrusters 10:70"}, "it ends at 70 %, which is not below 10 %"),
        ({"dump": "thrusters 90Nms:0"}, "a wheel holds 50 N m s: at most 47.5 N m s"),
        ({"dump": "thrusters 1Nms:2Nms"}, "it ends at 4 %, which is not below 2 %"),
        ({"dump": "thrusters every 7"}, "a unit is needed"),
        ({"dump": "thrusters every 1s"}, "600 to 1e+08 s are covered"),
        (
            {"dump": "coils every 7d"},
            "the form is thrusters, coils or both BEGIN:END",
        ),
        ({"dump": "sails 70:10"}, "the form is thrusters, coils or both BEGIN:END"),
        ({"dump": "coils 70:10"}, "--rods none leaves no coils"),
        ({"thrusters": None}, "--thrusters says which"),
        ({"orbit": "geos"}, "did you mean geo"),
        ({"orbit": "50x35786km"}, "--orbit 50 km"),
        ({"panel": "13"}, "area and arm are needed"),
    ],
)
def test_a_craft_that_cannot_be_is_refused(tmp_path, values, text):
    facts = {**{k: v for k, v in vars(GEO).items() if v is not None}, **values}
    with pytest.raises(DesatError) as error:
        write(tmp_path / "x", CraftFacts(**facts), "")
    assert text in str(error.value)
    assert not (tmp_path / "x").exists()


def test_a_dump_is_of_whole_pulses_which_the_wheels_take_up():
    block = law(pulse_body=(0.03, 0.0, 0.04))
    rows = fly(block, [1.0, 0.3, 0.0], 60)
    inputs = np.array([10.0 * n for _, mode, n in rows if mode == 1])
    assert np.allclose(inputs[:, 0] / 0.03, np.round(inputs[:, 0] / 0.03))
    assert not inputs[:, 2].any(), "no momentum, no pulse"
    assert inputs[:, 0].sum() == pytest.approx(-0.8, abs=0.06), (
        "what is left comes with the next"
    )
    assert (inputs[:, 1] != 0.0).all(), (
        "an axis without a shortest pulse has any impulse"
    )


def test_what_a_sample_leaves_of_a_pulse_comes_with_the_next_samples():
    """Of a torque that is a part of a pulse a sample about y, and three pulses and a
    part about x: after each sample all that was wanted so far has been fired, to within
    a pulse."""
    pulse, start = np.array([0.03, 0.05, 1e-9]), np.array([1.0, 0.2, 0.0])
    rows = fly(law(pulse_body=tuple(pulse), end=0.05), start.tolist(), 8)
    fired = np.cumsum([10.0 * n for _, _, n in rows], axis=0)
    h = np.vstack([start, start + fired[:-1]])
    expected = np.cumsum(
        -0.1 * h / np.linalg.norm(h, axis=1)[:, None], axis=0
    )  # 0.01 N m, 10 s
    assert abs(expected[0, 1]) < pulse[1], "no sample alone fires about y"
    assert (np.abs(fired - expected) < pulse).all()


def test_a_dump_whose_rest_is_no_pulse_ends():
    """It stayed in its dump for ever: less than half a pulse about each axis was left,
    and more than a sample's torque."""
    block = law(pulse_body=(0.3, 0.3, 0.3), end=0.9, torque=1e-3)
    rows = fly(block, [1.0, 0.9, 0.9], 60)
    assert sum(mode == 1 for _, mode, _ in rows) < 60
    (answer,) = block.foresee(0.0, 1.0, frozenset({"tau_cmd_thruster_body", "h_wheel"}))
    assert "a dump may fire nothing" in answer


@pytest.mark.parametrize(
    "facts",
    [
        GEO,
        CraftFacts(
            sso="550km",
            mass="20kg",
            size="12U",
            rods="none",
            wheels="3 axes 50mNms",
            thrusters="4 50mN",
            dump="thrusters 60:20",
        ),
    ],
    ids=["geo", "12u"],
)
def test_no_pulse_of_a_new_craft_turns_it_far(tmp_path, facts):
    write(tmp_path / "mine", facts, "desat new craft mine")
    system, _ = prepare(str(tmp_path / "mine"), Options()).or_raise()
    law, jets = (
        system.components["manager"].values,
        system.components["thrusters"].values,
    )
    inertia = np.reshape(system.components["spacecraft"].values["inertia"], (3, 3))
    turned = law["torque"] * law["sample_time"] ** 2 / (8.0 * np.diag(inertia).min())
    assert np.degrees(turned) <= 0.1 * (1.0 + 1e-3)
    assert law["sample_time"] == jets["sample_time"]
    assert np.allclose(
        law["pulse_body"], np.array(jets["tau_level"]) * jets["least_pulse"]
    )


def test_a_craft_file_is_no_scenario_and_says_which_there_are(tmp_path):
    write(tmp_path / "mine", GEO, "desat new craft mine")
    with pytest.raises(DesatError, match=r"a craft file.*: nominal, worst"):
        prepare(str(tmp_path / "mine" / "craft.toml"), Options())


@pytest.mark.study
def test_aligned_dumps_are_sized_as_they_fly_and_save_a_quarter(tmp_path):
    """LANE: 0.769 kg a year where dumps wait until |h|_1 / |h| is 1.03, 26 % less than
    without."""
    for name, dump in (
        ("mine", "thrusters 70:10 aligned"),
        ("at_once", "thrusters 70:10"),
    ):
        facts = {k: v for k, v in vars(GEO).items() if v is not None}
        write(tmp_path / name, CraftFacts(**{**facts, "dump": dump}), "")
    waits = dumps.size(str(tmp_path / "mine"), FLAT, SizingRequirements(year=False))
    at_once = dumps.size(
        str(tmp_path / "at_once"),
        FLAT,
        SizingRequirements(year=False, flown=False),
    )
    assert waits.steady.a_year == pytest.approx(
        waits.loop["propellant_a_year"], rel=0.05
    )
    assert waits.steady.a_year == pytest.approx(0.769, rel=0.05)
    assert waits.steady.a_year / at_once.steady.a_year == pytest.approx(0.74, abs=0.03)


@pytest.mark.parametrize(
    ("first", "interval", "stop", "reaches", "flights"),
    [
        (4e5, 4e5, None, True, (1.4e6, 480_000.0)),  # three dumps
        (1e4, 1e4, None, True, (800_000.0, 86_400.0)),  # many steps, a day
        (1e4, 1e4, 5e4, True, (9e6, 9e6)),  # what the user says
        (4e5, 4e5, None, False, (1e6, 480_000.0)),  # the environment ends
    ],
)
def test_how_long_the_closed_loop_flies(first, interval, stop, reaches, flights):
    system = SimpleNamespace(start=0.0, stop=1e6, step=1.0)
    steady = dumps.DumpRates(first, interval, 1.0, *dumps.NOTHING)
    lengths = dumps._lengths_of_flights(
        system, Options(stop=stop), 9e6, steady, object() if reaches else None
    )
    assert lengths == pytest.approx(flights)
