"""The scenario language: what is wrong with a file is one line, never silence or a bug
of ours."""

from __future__ import annotations

import json
import math
import re
import shutil
import tomllib
from itertools import product
from typing import get_args

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from desat import cli
from desat.campaign.sampling import draw_of
from desat.files import paths, reader, scenario
from desat.files.build import build
from desat.files.scenario import find, load, read_foreign
from desat.language import paper
from desat.language import scenario as language
from desat.language.content import KEYS, content_of
from desat.language.kinds import TRAVELS, Use, declared
from desat.language.scenario import AxisCell, ScenarioFile
from desat.numbers.derived import euler
from desat.numbers.measures import first_below, time_of
from desat.numbers.numbers import evaluate
from desat.numbers.spline import Spline
from desat.runs import catalogue, explain, validation
from desat.runs.run import Options, execute
from desat.system.errors import DesatError, Exit
from tests.conftest import ROOT

BASE = """step = 10.0
stop = 600.0
title = "T"
[numbers.firing_time]
title = "Thruster firing time"
signal = "thrusters.on_time"
measure = "last"
unit = "s"
[plots.rate]
title = "Rate"
signals = ["thrusters.on_time"]
unit = "s"
[paper.firing_time]
table = "2"
quantity = "firing_time"
unit = "s"
values = 3.0
tolerance = "2 %"
[dispersions]
"spacecraft.h_start_body" = { direction = 2.0 }
[axes.m.a]
label = "A"
"""


def _clear() -> None:
    for cached_function in (
        scenario.families,
        scenario.cells,
        scenario.survey,
        scenario.scenarios,
    ):
        cached_function.cache_clear()


@pytest.fixture
def family(tmp_path, monkeypatch):
    """Write files of a family in a temporary folder; then everything reads that."""
    folder = tmp_path / "ssp" / "f" / "scenarios"
    folder.mkdir(parents=True)
    shutil.copy(ROOT / "ssp/uosat12/SystemStructure.ssd", folder.parent)
    monkeypatch.setattr(scenario, "ROOT", tmp_path / "ssp")
    monkeypatch.setattr(paths, "SCENARIOS", tmp_path / "ssp")
    monkeypatch.setenv("DESAT_CACHE", str(tmp_path / "cache"))

    def write(**files: str | bytes) -> None:
        for old in folder.glob("*.toml"):
            old.unlink()
        for name, text in files.items():
            data = text if isinstance(text, bytes) else text.encode()
            (folder / f"{name}.toml").write_bytes(data)
        _clear()

    yield write
    _clear()


def list_problems() -> str:
    """What `desat list` says is wrong."""
    return "\n".join(explain.readable(None)[1])


def check_scenario(name: str = "f/t-a") -> str:
    """What `desat check` says is wrong with the words and names of a scenario."""
    try:
        own_scenario = scenario.find(name)
        draft = build(own_scenario, Options(blocks=True))
        wrong = validation.content_problems(own_scenario.content, draft.components)
        draft.problems += [
            f"{own_scenario.place(path)}: {text}" for path, text in wrong
        ]
    except DesatError as error:
        return str(error)
    return "\n".join(draft.problems)


def test_the_sound_file_is_silent(family):
    family(t=BASE)
    assert list_problems() == ""
    assert check_scenario() == ""


EVERYWHERE = {
    "top": ("step = 10.0", "stepp = 10.0", "stepp: unknown key; did you mean step?"),
    "number": (
        'unit = "s"',
        'unitt = "s"',
        "numbers.firing_time.unitt: unknown key; did you mean",
    ),
    "plot": (
        "signals = ",
        "signls = ",
        "plots.rate.signls: unknown key; did you mean signals?",
    ),
    "paper": (
        "values = 3.0",
        "vals = 3.0",
        "paper.firing_time.vals: unknown key; did you mean",
    ),
    "unknown unit": ('unit = "s"', 'unit = "sek"', "got 'sek': unit sek is not known"),
    "baseline": (
        'title = "T"',
        'baseline = "t-q"',
        "baseline: no scenario t-q; did you mean t-a?",
    ),
    "kind of dispersion": (
        "direction",
        "directon",
        "directon: unknown key; did you mean directi",
    ),
    "bad axis": ("[axes.m.a]", "[axes.m]", "axes.m.label: got 'A'; a table is needed"),
    "key in an axis": (
        "label",
        "lable",
        "axes.m.a.lable: unknown key; did you mean label?",
    ),
    "measure": (
        '"last"',
        '"lst"',
        "numbers.firing_time.measure: no measure lst; did you mean",
    ),
    "option": (
        '"last"',
        '"until_below"\noptions = { limt = 1 }',
        "limt: until_below has no",
    ),
    "option's value": (
        '"last"',
        '"until_below"\noptions = { limit = 1, kind = "men" }',
        "'men'",
    ),
    "option's type": (
        '"last"',
        '"until_below"\noptions = { limit = true }',
        "limit: got True",
    ),
    "type": ("step = 10.0", 'step = "10"', "step: got '10'; a number is needed"),
    "plot that is not there": (
        'title = "T"',
        'without = ["plots.r"]',
        "without plots.r: there is",
    ),
    "derive": (
        'signals = ["th',
        'derive = "eler"\nsignals = ["th',
        "plots.rate.derive: no eler",
    ),
    "tolerance": (
        '"2 %"',
        '"two"',
        "paper.firing_time.tolerance: got 'two': a width is needed",
    ),
    "row that is not judged": (
        '"2 %"',
        '"2 %"\nnot_judged = "why"',
        "not_judged, and tolerance: one of the two",
    ),
    "number of a row": (
        'y = "firing_time"',
        'y = "fireing"',
        "paper.firing_time.quantity: no num",
    ),
    "cut": (
        "{ direction = 2.0 }",
        "{ normal = [0.0, 1.0], within = [9.0, 10.0] }",
        "within: 0 % of normal",
    ),
    "cut of another kind": (
        "{ direction = 2.0 }",
        "{ uniform = [0.0, 1.0], within = [0.0, 1.0] }",
        "within goes with normal only",
    ),
    "circle": ("step = 10.0", 'extends = "t"', "extends itself"),
}


OF_THE_SYSTEM = {
    "unit of another kind": (
        'unit = "s"',
        'unit = "m"',
        "numbers.firing_time.unit: unit s does",
    ),
    "series": (
        "thrusters.on_time",
        "thrusters.on_tim",
        "firing_time.signal: thrusters has no out",
    ),
    "element": ('"last"', '"last"\nelement = 2', "element: got 2; the signal has 1"),
    "plot's series": (
        '["thrusters.on_time',
        '["thrusters.on_tim',
        "plots.rate.signals: thrusters",
    ),
    "component": (
        '"thrusters.on',
        '"thruster.on',
        "no component thruster; did you mean thrusters",
    ),
    "size": (
        "{ direction = 2.0 }",
        "{ signs = [1.0] }",
        "signs: h_start_body has 3 elements, not",
    ),
    "dispersed": (
        "spacecraft.h_st",
        "spacecraft.h_str",
        "spacecraft has no parameter h_strart",
    ),
    "number of an analysis": (
        'y = "firing_time"',
        'y = "momentum_residual"',
        "paper.firing_time: no number momentum",
    ),
    "limit": (
        'title = "Rate"',
        'title = "R"\nlimits = ["thrusters.tau_lvel[1]"]',
        "no parameter",
    ),
}


WHOLE_FILES = {
    "not UTF-8": (b"title = '\xff'", "not UTF-8 (byte 10)"),
    "no TOML": ("title = ", "Invalid value"),
    "base that is not there": (
        'extends = "comon"',
        "extends: no file comon.toml; did you mean",
    ),
    "stop_when": (
        BASE + "[stop_when]\nsignal = 'thrusters.on'\nabove = 1\n",
        "stop_when.signal: thrusters has no output on",
    ),
}
CASES = {
    **{
        name: (BASE.replace(old, new, 1), message)
        for name, (old, new, message) in (EVERYWHERE | OF_THE_SYSTEM).items()
    },
    **WHOLE_FILES,
}


@pytest.fixture
def command(monkeypatch, capsys):
    """Give a command line; what it ends with, and what it says is wrong, a line each."""

    def give(*arguments: str) -> tuple[int, list[str]]:
        monkeypatch.setattr("sys.argv", ["desat", *arguments])
        code = cli._code()
        lines = capsys.readouterr().err.splitlines()
        messages = [line.removeprefix("error: ") for line in lines]
        return code, [
            x
            for x in messages
            if not x.startswith(("note: ", "warning: ", "1 problem(s)"))
        ]

    return give


@pytest.mark.parametrize("case", CASES)
def test_a_broken_scenario_is_one_line_on_run_check_and_list(
    family, command, tmp_path, case
):
    text, message = CASES[case]
    assert text != BASE
    family(t=text, sound=BASE, common="abstract = true")
    code, lines = command("list", "f")
    assert code == Exit.INPUT
    (line,) = lines
    assert re.match(r"ssp/f/scenarios/t\.toml(:\d+)?: ", line)
    assert message in line
    assert "internal" not in line
    assert catalogue.family("f").scenarios == {"f/sound-a": "T"}
    folder = tmp_path / "run"
    assert command("run", "f/t-a", "--blocks", "--out", str(folder)) == (
        Exit.INPUT,
        [line],
    )
    assert not folder.exists()
    code, lines = command("check", "f/t-a", "--blocks")
    assert code in (Exit.INPUT, Exit.UNMET)
    assert lines == [line]
    assert check_scenario("f/sound-a") == "", "another file's fault is not its own"


def test_list_reads_again_what_has_changed(family, command, monkeypatch):
    """What was found is kept until a file changes; a kept file that is broken is made
    anew."""
    family(t=BASE)
    for arguments in (["list"], ["list", "--all"]):
        assert command(*arguments) == (0, [])
        with monkeypatch.context() as patch:
            patch.setattr(catalogue, "_load", None)  # would fail if it were called
            assert command("list") == command(*arguments) == (0, [])
    catalogue._file("f").write_text("{")
    assert command("list") == (0, [])
    family(t=BASE.replace("step =", "stepp ="))
    assert command("list")[1] == [
        "ssp/f/scenarios/t.toml:1: stepp: unknown key; did you mean step?"
    ]
    family(t=BASE)
    assert command("list") == (0, [])


def test_the_first_list_reads_files_alone(family, command):
    """The systems of 492 scenarios take 2 s; what is wrong with one is said of its
    family."""
    family(t=BASE + "[parameters.manager]\nno_such = 1.0\n")
    assert command("list") == (0, [])
    (line,) = command("list", "f")[1]
    assert "no_such" in line
    assert command("list")[1] == [line], "what is known is said"


WRONG = """stepp = 10.0
stop = "600"
titel = "T"
substeps = 0
accuracy = -1.0
epoch = "today"
[number.x]
signal = "a.b"
[numbers.y]
signl = "a.b"
unit = "sek"
element = 0
window = [1.0]
options = 3
[plots.rate]
signals = []
points = 3
sequence = "124"
limits = [{ valu = 1.0 }, true]
[dispersions]
"*.seed" = { sed = true }
[requirements.r]
probability = 2.0
[parameters]
manager = 1
[stop_when]
held = -1.0
"""


def test_all_wrong_keys_of_a_file_are_named_at_once_each_with_its_line(family):
    family(t=WRONG)
    problem_lines = list_problems().splitlines()
    assert len(problem_lines) == 21
    places = [
        re.match(r"ssp/f/scenarios/t\.toml:(\d+): ([\w.*]+): ", line)
        for line in problem_lines
    ]
    assert all(places), problem_lines
    for place, line in zip(places, problem_lines, strict=True):
        number, key = int(place[1]), place[2]
        last = re.sub(r"\.\d+$", "", key).rpartition(".")[2]
        assert last in WRONG.splitlines()[number - 1], line
    assert (
        "ssp/f/scenarios/t.toml:1: stepp: unknown key; did you mean step?"
        in problem_lines
    )
    assert "ssp/f/scenarios/t.toml:9: numbers.y" not in "\n".join(problem_lines)


def test_a_value_that_is_refused_later_has_its_line_too(family):
    """In the file, and the axis, that gave it."""
    family(
        t='extends = "base"\n\n[axes.m.a]\nnumbers.y.measure = "lst"\n',
        base=BASE.partition("[axes")[0] + '[numbers.y]\ntitle = "y"\nsignal = "a.b"\n',
    )
    assert (
        "ssp/f/scenarios/t.toml:4: axes.m.a.numbers.y.measure: no measure lst"
        in list_problems()
    )


def test_a_manifest_of_another_language_is_one_line():
    with pytest.raises(
        DesatError, match=r"^about\.plots\.rate\.signls: .*: no content that"
    ):
        content_of(
            {
                "name": "f/x",
                "plots": [{"name": "rate", "title": "x", "signls": ["a.b"]}],
            }
        )


def test_a_band_by_a_number_that_is_not_there(family):
    text = BASE.replace(
        'tolerance = "2 %"', "tolerance.b = {of='firing_tim', from=0.0, to=1.0}"
    )
    family(t=text.replace("[axes.m.a]", "[axes.method.b]"))
    line = "ssp/f/scenarios/t.toml:18: paper.firing_time.tolerance: no number firing_tim; did you"
    assert list_problems().startswith(line)
    assert check_scenario("f/t-b") == list_problems()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[parameters.manager]\n[tune]\n", "tune: unknown key; did you mean tuned?"),
        ("[tuned]\n", "parameters missing"),
        ("parameters = 1\n", "parameters: got 1; a table is needed"),
        (
            "[parameters.manager]\nx = 2026-01-01\n",
            "parameters.manager.x: got datetime",
        ),
        ("[parameters", "Expected ']'"),
    ],
)
def test_a_broken_design_is_one_line(family, tmp_path, text, message):
    family(t=BASE.replace("[axes.m.a]", "[design]\nfinal_momentum = 1.0\n[axes.m.a]"))
    (tmp_path / "ssp/f/design").mkdir()
    (tmp_path / "ssp/f/design/t-a.toml").write_text(text)
    for lines in (list_problems(), check_scenario()):
        assert re.match(r"ssp/f/design/t-a\.toml(:\d+)?: ", lines)
        assert message in lines
        assert len(lines.splitlines()) == 1


def test_not_utf8_and_bases(family):
    family(t=b"title = '\xff'\n")
    assert list_problems() == "ssp/f/scenarios/t.toml: not UTF-8 (byte 10)"
    family(t='extends = "tt"', tt='extends = "t"')
    assert "extends itself (t -> tt -> t)" in list_problems()
    family(t='extends = "comon"', common="abstract = true")
    assert list_problems().endswith("extends: no file comon.toml; did you mean common?")
    family(
        t='extends = "base"',
        base='abstract = true\n[numbers.x]\nsignal = "a.b"\nunt = "s"',
    )
    assert list_problems().startswith(
        "ssp/f/scenarios/base.toml:4: numbers.x.unt: unknown key"
    ), "once"


def _paths(data: dict, path: tuple = ()) -> list[tuple]:
    paths = []
    for key, value in data.items():
        paths += [
            (*path, key),
            *(_paths(value, (*path, key)) if isinstance(value, dict) else []),
        ]
    return paths


def _toml(value) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f'"{k}" = {_toml(v)}' for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    return f"'{value}'" if isinstance(value, str) else repr(value)


SCALARS = (
    st.booleans()
    | st.integers(-5, 5)
    | st.floats(-1e3, 1e3)
    | st.sampled_from(["", "x", "a.b", "5 %", "s", "thrusters.on_time"])
)
NAMES = st.sampled_from(["a", "value", "table", "of", "x.y"])
VALUES = st.recursive(
    SCALARS,
    lambda substeps: (
        st.lists(substeps, max_size=3) | st.dictionaries(NAMES, substeps, max_size=2)
    ),
    max_leaves=4,
)
DECLARED = {row["key"] for row in explain.keys(None)}


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_no_broken_file_meets_a_bug_or_silence(family, data):
    """A declared key renamed is always refused; any value changed is refused or taken,
    no more."""
    table = tomllib.loads(BASE)
    path = data.draw(st.sampled_from(_paths(table)))
    owner = table
    for key in path[:-1]:
        owner = owner[key]
    renames_key = data.draw(st.booleans()) and path[-1] in DECLARED and len(path) != 2
    if renames_key:
        owner[path[-1] + data.draw(st.sampled_from(["x", "_", "Q"]))] = owner.pop(
            path[-1]
        )
    else:
        owner[path[-1]] = data.draw(VALUES)
    family(t="\n".join(f'"{k}" = {_toml(v)}' for k, v in table.items()))
    names = list(explain.readable(None)[0])  # anything but a DesatError is our bug
    lines = list_problems() or "\n".join(check_scenario(name) for name in names)
    assert not renames_key or "unknown key" in lines
    assert lines or names


def test_signs_and_one_of(family):
    spec = '{ signs = [0.1, 0.2, 0.3] }\n"environment.phase" = { one_of = [0.5, 1.5] }'
    family(t=BASE.replace("{ direction = 2.0 }", spec))
    assert check_scenario() == ""
    system = build(scenario.find("f/t-a"), Options(blocks=True))
    draws = [draw_of(system, 1, i) for i in range(40)]
    h = np.array([d["spacecraft.h_start_body"] for d in draws])
    assert np.array_equal(np.abs(h), np.tile([0.1, 0.2, 0.3], (40, 1)))
    assert len({tuple(row) for row in np.sign(h)}) == 8
    assert {d["environment.phase"] for d in draws} == {0.5, 1.5}


def test_first_below_and_time_of():
    t = np.arange(6.0)
    v = np.array([[2, 0], [0, 0], [2, 0], [0, -0.5], [0, 0], [0, 0]], float)
    assert first_below(t, v, 1.0) == 1.0
    assert first_below(t, v, 1.0, held=2.0) == 3.0
    assert math.isnan(first_below(t, v, 1.0, held=3.0)), "not the end of the run"
    mode = np.array([0, 0, 5, 1, 5, 5.0])[:, None]
    assert time_of(t, mode, 5) == 2.0
    assert math.isnan(time_of(t, mode, 7))


SEQUENCES = ["".join(x) for x in product("123", repeat=3) if x[0] != x[1] != x[2]]


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_euler_angles_are_scipys(sequence):
    """Of a turn by known angles about moving axes, from any reference; also where the
    first and the third axis fall together, when the third angle is 0."""
    middle = 0.0 if sequence[0] == sequence[2] else 90.0
    angles = np.array([[10.0, 20.0, 30.0], [-1.0, 2.0, 0.5], [40.0, middle, 0.0]])
    axes = "".join("XYZ"[int(a) - 1] for a in sequence)
    ref = Rotation.from_quat(
        [[0.1, 0.2, 0.3, 0.9], [0.5, -0.5, 0.5, 0.5], [0.0, 0.6, 0.0, 0.8]]
    )
    q = (ref * Rotation.from_euler(axes, angles, degrees=True)).as_quat()
    assert euler(q, ref.as_quat(), sequence) == pytest.approx(angles, abs=1e-5)
    assert euler(q[:2], ref.as_quat()[:2], sequence) == pytest.approx(
        angles[:2], rel=1e-12
    )
    assert np.isnan(euler(np.zeros((1, 4)), ref.as_quat()[:1], sequence)).all()


@given(st.integers(2, 40), st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.4]))
def test_a_spline_is_scipys(n, seed, uneven):
    chance = np.random.default_rng(seed)
    times = np.cumsum(1.0 + chance.uniform(-uneven, uneven, n))
    values = chance.normal(size=(n, 2, 3))
    at = chance.uniform(times[0], times[-1], (5, 3))
    assert Spline(times, values)(at) == pytest.approx(
        CubicSpline(times, values)(at), abs=1e-12
    )


@pytest.mark.parametrize(("element", "code"), [(1, 0), (3, 0), (4, 1)])
def test_an_element_of_a_derived_quantity_is_one_that_it_has(
    tmp_path, desat, element, code
):
    path = tmp_path / "mine.toml"
    path.write_text(
        'extends = "integrated/mil-nadir"\n[numbers.roll]\ntitle = "Roll"\n'
        'signal = ["spacecraft.q_bi", "guidance.q_ref_bi"]\nderive = "euler"\n'
        f'element = {element}\nmeasure = "largest"\n'
    )
    outcome = desat("check", str(path))
    assert outcome.returncode == code, outcome.stderr
    assert ("element: got 4; euler has 3" in outcome.stderr) == bool(code)


def test_numbers_of_derived_quantities():
    """The largest roll of a run is that of its attitudes by scipy, and nothing else."""
    run = execute("integrated/mil-nadir", Options(stop=400.0, blocks=True))
    q, ref = (run.results.values(n) for n in ("spacecraft.q_bi", "guidance.q_ref_bi"))
    n = min(len(q), len(ref))
    turn = Rotation.from_quat(ref[:n]).inv() * Rotation.from_quat(q[:n])
    roll = np.abs(turn.as_euler("ZYX", degrees=True)[:, 2]).max()
    number = {
        "signal": ["spacecraft.q_bi", "guidance.q_ref_bi"],
        "derive": "euler",
        "element": 3,
        "sequence": "321",
        "measure": "largest",
        "unit": "rad",
    }
    roll_value = evaluate(
        language.Number(**number), run.results, run.manifest.parameters
    ).value
    assert roll_value == pytest.approx(np.radians(roll), rel=1e-12)
    number |= {"measure": "until_below", "options": {"limit": 1e9}, "unit": "min"}
    assert (
        evaluate(language.Number(**number), run.results, run.manifest.parameters).value
        == 0.0
    )


def test_inheritance_of_plots_by_name():
    """A child changes one plot and repeats none; what it leaves out may have dots in
    its name."""
    data = load(ROOT / "ssp/uosat12/scenarios/fig2-common.toml", {})
    assert list(data["plots"]) == [
        "momentum_size",
        "momentum",
        "dipole",
        "dipole_energy",
        "field",
    ]
    assert data["plots"]["dipole"]["signals"] == ["torquers.m_mean_body"]


def test_all_of_ours_are_sound():
    good, lines = explain.readable(None)
    assert lines == []
    assert {name.partition("/")[0] for name in good} == {*scenario.families()}
    problems = []
    for name in [
        n
        for n in good
        if n.endswith(("-1", "dumping", "nadir", "cross-product", "full"))
    ]:
        components = build(good[name], Options(blocks=True)).components
        problems += validation.content_problems(good[name].content, components)
    assert problems == []


def test_commands(desat):
    assert "final_momentum" in desat("help", "keys", "design", check=True).stdout
    assert "first_below" in desat("help", "measures", check=True).stdout
    assert "$defs" in desat("help", "keys", "--schema", check=True).stdout
    listing = desat("show", "uosat12/table3-ocdc-ilqr-1", check=True).stdout
    assert "axes.method.ocdc" in listing
    assert "plot" in desat("help", "keys", "plt").stderr


def test_each_value_that_is_shown_comes_from_a_file(desat):
    rows = json.loads(
        desat("show", "uosat12/table3-ocdc-ilqr-1", "--json", check=True).stdout
    )
    assert all((ROOT / row["from"]).is_file() for row in rows)
    (step,) = [row for row in rows if row["key"] == "step"]
    assert step == {
        "key": "step",
        "value": 10.0,
        "cell": "",
        "from": "ssp/uosat12/scenarios/common.toml",
    }


def test_every_table_of_the_language_is_told():
    """In `desat help keys` and on the page, by the name that other keys' types have."""
    answer = set(explain._tables().values())
    for module in (language, paper):
        for table in vars(module).values():
            if isinstance(table, type) and table.__module__ == module.__name__:
                full = table in answer or any(issubclass(t, table) for t in answer)
                assert full or table is language.DesignFile, table


def test_the_page_of_the_language_is_current():
    """`desat help keys --markdown > docs/language.md` makes it."""
    assert (ROOT / "docs" / "language.md").read_text(encoding="utf-8") == explain.page()


def test_a_file_may_extend_a_cell_of_a_table_whose_rows_are_then_its_own(
    tmp_path, desat
):
    file = tmp_path / "mine.toml"
    file.write_text('extends = "uosat12/table3-ocdc-ilqr-1"\ntitle = "mine"\n')
    desat("check", str(file), check=True)
    rows = read_foreign(file).content.entries
    assert rows == find("uosat12/table3-ocdc-ilqr-1").content.entries
    assert (rows["firing_time"].values, rows["firing_time"].tolerance) == (71.45, "3 %")


@pytest.mark.parametrize(("old", "new"), reader.RENAMED.items())
def test_a_key_of_before_is_refused_with_its_name_of_now(tmp_path, old, new):
    file = tmp_path / "own.toml"
    file.write_text(f'extends = "nadir_day/day-dipole"\n{old} = 1\n')
    with pytest.raises(
        DesatError, match=f":2: {old}: unknown key; it is called {new}$"
    ):
        scenario.read_foreign(file)
    file.write_text(f'extends = "nadir_day/day-dipole"\n[numbers.x]\n{old} = 1\n')
    with pytest.raises(DesatError, match=f"numbers.x.{old}: unknown key") as error:
        scenario.read_foreign(file)
    assert "it is called" not in str(error.value)


def test_each_key_at_the_top_says_what_it_is_of_use_for():
    """A key counts in the digest, or travels, by what is declared with it: four lists
    elsewhere said so, and none failed where it lacked one."""
    keys = declared(ScenarioFile) | declared(AxisCell)
    assert [name for name, of in keys.items() if of.use not in get_args(Use)] == []
    travelling = {name for name, of in keys.items() if of.use in TRAVELS}
    assert travelling | {"labels"} == set(KEYS)
    assert {n for n, of in keys.items() if not of.inherited} == {"extends", "abstract"}
    content = find("nadir_day/day-dipole").content
    answer = content.as_json()
    assert answer.keys() - content.counted().keys() <= {
        "name",
        "cell",
        "labels",
        *(n for n, of in keys.items() if of.use in ("text", "resolved")),
    }
    assert content.counted().keys() == {
        n for n in answer if n in keys and keys[n].use == "run"
    }
