"""Guards: designs made for other values, refusals of components, stale draws, sweeps,
pairs."""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import sys
import time
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest

from desat.campaign import draws
from desat.campaign.spread import spreads
from desat.engine import current_call, trial_initialisation
from desat.files import library, paths
from desat.files.io import toml
from desat.files.scenario import families, find, scenarios
from desat.fmus import meaning, registry
from desat.fmus.meaning import sources
from desat.fmus.slave import _name
from desat.runs.prepare import Target, resolved
from desat.runs.run import Options, execute, prepare
from desat.system.errors import DesatError
from tests.conftest import ROOT, but, module_of

making = module_of("desat.papers.designs.making")
origin = module_of("desat.papers.designs.origin")
pages = module_of("benchmarks.pages.verbs")
stored = module_of("desat.papers.stored")
MEC = "uosat12/fig2-mec-1"
START = "spacecraft.h_start_body=2,0,0"

# --- designs --------------------------------------------------------------------------


def _of_design(scenario) -> list[str]:
    """What is said of the kept design of a scenario that runs as it is."""
    system, _ = resolved(Target(scenario.name, scenario), Options())
    return origin.warnings(scenario, Options(), system)


def test_no_kept_design_is_for_other_values():
    designed = [s for s in scenarios("uosat12").values() if s.design]
    assert len(designed) > 36
    assert [line for s in designed for line in _of_design(s)] == []


@pytest.mark.parametrize(
    ("options", "fault"),
    [
        ({"sets": [START]}, "h_start_body = [1.0, 2.0, -1.0], now [2.0, 0.0, 0.0]"),
        (
            {"values": {"environment.phase": 0.5}},
            "environment.phase = 1.4451326206513049, now 0.5",
        ),
        ({"stop": 1500.0}, "stop = 3000.0, now 1500.0"),
        ({"step": 5.0}, "step = 10.0, now 5.0"),
        (
            {"sources": ["manager=manager_cross_product"]},
            "source.manager = manager_magnetic, now",
        ),
    ],
)
def test_a_design_for_other_values_is_said(options, fault):
    checked = prepare(MEC, Options(**options)).checked
    (line,) = [w for w in checked.warnings if "its design" in w]
    assert fault in line
    assert f"`desat run {MEC} ... --design now`" in line


def test_what_cannot_matter_to_a_design_is_not_said():
    same = Options(
        sets=["spacecraft.h_start_body=1,2,-1", "manager.costate=1,0,0"], stop=3000.0
    )
    assert prepare(MEC, same).checked.warnings == []
    blind = find("uosat12/fig2-offnadir-mec-blind")
    ((name, table),) = blind.content.design.assume.items()
    values = {
        f"{name}.{k}": [[2.0 * x for x in row] for row in v] for k, v in table.items()
    }
    assert prepare(blind.name, Options(values=values)).checked.warnings == []


def test_a_design_of_another_scenario_follows_its_values():
    flight = "uosat12/fig2-flight-mec-1"
    (line,) = prepare(
        flight, Options(values={"torquers.quiet_time": 2.0})
    ).checked.warnings
    assert "torquers.quiet_time = 0.0, now 2.0" in line
    (line,) = prepare(
        flight, Options(values={"wheels.h_start_wheel": [1.0, 1.0, 1.0, 0.0]})
    ).checked.warnings
    assert "that of uosat12/fig2-mec-1, which has no wheels.h_start_wheel" in line


@pytest.mark.real_units
def test_one_command_gets_the_right_gains(tmp_path):
    wrong = execute(MEC, Options(sets=[START], blocks=True))
    right = execute(MEC, Options(sets=[START], blocks=True, design="now"))
    assert any("its design" in w for w in wrong.manifest["warnings"])
    assert right.manifest["warnings"] == []
    assert wrong.manifest["numbers"]["final_momentum"]["value"] > 2.0
    assert right.manifest["numbers"]["final_momentum"]["value"] == pytest.approx(
        0.05, abs=1e-9
    )
    options = Options(sets=[START])
    file = making.write(
        find(MEC), making.design(find(MEC), options), options, tmp_path / "d.toml"
    )
    again = execute(MEC, Options(sets=[START], blocks=True, design=str(file)))
    assert again.manifest["numbers"] == right.manifest["numbers"]
    assert toml(file)["made_of"]["spacecraft.h_start_body"] == [2.0, 0.0, 0.0]


def test_a_design_is_stamped_only_if_its_numbers_are_reached(monkeypatch, tmp_path):
    scenario = find("uosat12/fig2-ccpl-1")
    saved = scenario.design.read_text(encoding="utf-8")
    bare = saved.partition("\n[made_of]\n")[0]
    file = tmp_path / "x.toml"
    monkeypatch.setattr(type(scenario), "design", property(lambda self: file))
    moved = {
        **scenario.content.parameters,
        "spacecraft": {"h_start_body": [2.0, 0.0, 0.0]},
    }
    other = replace(scenario, content=but(scenario.content, parameters=moved))
    file.write_text(bare, encoding="utf-8")
    assert not making.confirm(other)
    assert file.read_text(encoding="utf-8") == bare
    assert "does not say" in _of_design(scenario)[0]
    assert making.confirm(scenario)
    assert file.read_text(encoding="utf-8") == saved


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("run", "plant/reference", "--design", "now"),
            "plant/reference has no [design]",
        ),
        (("run", MEC, "--design", "no.toml"), "no.toml: no such file"),
        (("design", MEC, "--set", START), "a design for other values needs --out FILE"),
        (("design", MEC, "--set", "spacecraft.h_stat=1", "--out", "x"), "did you mean"),
    ],
)
def test_a_bad_design_is_a_line(desat, tmp_path, arguments, message):
    result = desat(*arguments, cwd=tmp_path)
    assert result.returncode == 2
    assert message in result.stderr
    assert len(result.stderr.splitlines()) == 1


# --- what components refuse -----------------------------------------------------------

COMBINED = "uosat12/table3-ocdc-ilqr-1"


@pytest.mark.parametrize("way", [(), ("--blocks",)])
def test_check_lists_what_every_component_refuses(desat, way):
    result = desat(
        "check",
        COMBINED,
        "--set",
        "torquers.quiet_time=9",
        "--set",
        "manager.k_cross=1",
        *way,
    )
    assert result.returncode == 1
    lines = [x for x in result.stderr.splitlines() if not x.startswith("note: ")]
    assert len(lines) == 2
    assert lines[0].startswith("--set torquers.quiet_time=9: torquers: quiet_time + ")
    assert lines[0].endswith(
        "; sample_time from ssp/uosat12/scenarios/common.toml: "
        "parameters.torquers.sample_time"
    )
    assert lines[1].startswith("1 problem(s)")
    assert desat("check", COMBINED, *way).returncode == 0


def test_a_refusal_names_the_file_and_the_key_that_gave_the_value(desat, tmp_path):
    """One line: what is given for two components once, and what fails for want of a
    body's attitude, is not said again."""
    for base, inputs, way, key, message in (
        (
            "none",
            "inertia = [1, 0, 0, 0, 1, 0, 0, 0, 5]",
            [],
            "shared.inertia: spacecraft: inertia = ",
            "is larger than the sum of the other two",
        ),
        (
            "ours",
            "schedule_start = [20, 40, 0, 0, 0, 0, 0, 0]",
            ["--blocks"],
            "shared.schedule_start: manager: schedule_start[2] = 40 s for 30 s overlaps",
            "from 20 s for 30 s; one at a time",
        ),
    ):
        text = f'extends = "alsat1/firing-{base}"\n[shared]\n{inputs}\n'
        (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
        result = desat("run", "mine.toml", "--stop", "100", *way, cwd=tmp_path)
        assert result.returncode == 2
        (line,) = result.stderr.splitlines()
        assert line.startswith(f"error: mine.toml: {key}")
        assert message in line


def test_all_failing_components_are_collected():
    system, schedule = prepare(COMBINED, Options(blocks=True)).or_raise()
    components = dict(system.components)
    for name in ("torquers", "magnetometer"):
        parameters = {**components[name].parameters, "sample_time": float("nan")}
        components[name] = replace(components[name], parameters=parameters)
    problems, warnings = trial_initialisation.refusals(
        replace(system, components=components), schedule
    )
    assert {p.partition(":")[0] for p in problems} == {"torquers", "magnetometer"}
    assert warnings == []


def test_of_a_foreign_fmu_only_the_description_is_read(tmp_path):
    """One that says that another tool made it, and whose library would end the process
    that loads it."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None or sys.platform != "linux":
        pytest.skip("needs Linux and a C compiler")
    code, built = tmp_path / "ends.c", tmp_path / "ends.so"
    code.write_text(
        "#include <stdlib.h>\n"
        "__attribute__((constructor)) static void ends(void) { abort(); }\n"
        "int fmi2Instantiate, fmi2DoStep;\n"
    )
    subprocess.run([compiler, "-shared", "-fPIC", "-o", built, code], check=True)
    fmu = tmp_path / "theirs.fmu"
    with (
        zipfile.ZipFile(paths.fmus() / "magnetometer.fmu") as ours,
        zipfile.ZipFile(fmu, "w") as theirs,
    ):
        for name in ours.namelist():
            data = ours.read(name)
            if name == "modelDescription.xml":
                data = data.replace(b"desat with PythonFMU", b"another tool")
            is_library = name.startswith("binaries/")
            theirs.writestr(name, built.read_bytes() if is_library else data)
    options = Options(sources=[f"magnetometer={fmu}"], sets=["torquers.quiet_time=9"])
    problems, warnings = trial_initialisation.refusals(
        *prepare(COMBINED, options).or_raise()
    )
    assert not library.load(fmu).ours
    assert [p.partition(":")[0] for p in problems + warnings] == ["torquers"]
    assert "quiet_time" in (problems + warnings)[0]


def test_a_crash_of_the_trial_is_a_line(monkeypatch):
    system, schedule = prepare(COMBINED, Options()).or_raise()

    def crash(system, schedule):
        current_call.word[0] = current_call.PLACE * schedule.order.index("torquers") + 1
        os.abort()

    monkeypatch.setattr(trial_initialisation, "_initialised", crash)
    (line,), _ = trial_initialisation.refusals(system, schedule)
    assert line.endswith(": torquers: instantiating it ended the process: SIGABRT")

    def hang(system, schedule):
        current_call.word[0] = current_call.PLACE * schedule.order.index("torquers") + 2
        time.sleep(60.0)

    monkeypatch.setattr(trial_initialisation, "_initialised", hang)
    monkeypatch.setattr(trial_initialisation, "TIMEOUT", 0.2)
    (line,), _ = trial_initialisation.refusals(system, schedule)
    assert line.endswith(
        ": torquers: entering initialisation did not return within 0.2 s"
    )


# --- stored draws ---------------------------------------------------------------------


def test_stored_draws_are_stale_when_their_code_changes(monkeypatch, tmp_path):
    """That of a block, of what it uses of others, of the engine; not a comment."""
    name = "uosat12/starts-dct"
    stored_samples = stored.read("uosat12")
    stored_samples["scenarios"][name] |= {
        "sha256": stored.digest(find(name)),
        "code_sha256": stored.code(find(name)),
    }
    assert name not in stored.outdated(stored_samples)
    shutil.copytree(ROOT / "components", tmp_path / "components")
    monkeypatch.setattr(meaning, "COMPONENTS", tmp_path / "components")
    for file, text, stale in (
        ("blocks/manager_combined.py", "# a comment", False),
        ("maths/vector.py", "# a comment", False),
        ("maths/vector.py", "ONE_MORE = 1.0", False),
        ("maths/vector.py", "def norm(a: Vec3) -> float:\n    return 1.0", True),
        ("blocks/manager_combined.py", "ONE_MORE = 1.0", True),
    ):
        library._hash_of.cache_clear()
        path = tmp_path / "components" / file
        before = path.read_text()
        path.write_text(f"{before}\n{text}\n")
        assert (name in stored.outdated(stored_samples)) is stale, (file, text)
        path.write_text(before)
    library._hash_of.cache_clear()


CODE = """\"\"\"What it is.\"\"\"


def f(x: float) -> float:
    \"\"\"Twice.\"\"\"
    return 2.0 * x  # a comment
"""


@pytest.mark.parametrize(
    ("old", "new", "same"),
    [
        ("What it is.", "What it was.", True),
        ("Twice.", "Two times.", True),
        ('    """Twice."""\n', "", True),
        ("# a comment", "", True),
        ("2.0 * x", "(2.0\n    * x)", True),
        ("2.0 * x", "x * 2.0", False),
        ("2.0", "2", False),
        ("f(x", "g(x", False),
        ("2.0 * x", "None", False),
    ],
)
def test_texts_and_layout_of_code_do_not_count(old, new, same):
    assert old in CODE
    assert (
        meaning.definitions(CODE.replace(old, new)) == meaning.definitions(CODE)
    ) is same


def test_draws_are_stamped_only_if_they_come_out_again(monkeypatch, tmp_path):
    name = "uosat12/starts-dct"
    stored_samples = stored.read("uosat12")
    monkeypatch.setattr(stored, "with_draws", lambda family: {name: find(name)})
    monkeypatch.setattr(paths, "DRAWS", tmp_path)
    stored_samples["scenarios"] = {name: stored_samples["scenarios"][name]}
    stored_samples["scenarios"][name].pop("code_sha256", None)
    stored.write(stored_samples)
    assert stored.outdated(stored.read("uosat12")) == [name]
    assert stored.confirm("uosat12", 1, 1) == []
    assert stored.outdated(stored.read("uosat12")) == []
    row = stored_samples["scenarios"][name]["draws"][0].numbers
    row["firing_time"] *= 1.0 + 1e-6
    stored.write(stored_samples)
    assert stored.confirm("uosat12", 1, 1) == [name]


def test_stale_samples_are_told_with_cause_and_command(monkeypatch):
    stored_samples = stored.read("uosat12")
    monkeypatch.setattr(stored, "outdated", lambda _: ["uosat12/starts-dct"])
    stored_samples["scenarios"]["uosat12/starts-dct"]["code_sha256"] = "another"
    with pytest.raises(
        DesatError, match="of other code of engine, measures or sampling"
    ) as error:
        stored.require_current(stored_samples)
    assert "python -m desat.papers.stored uosat12" in str(error.value)


def test_a_block_is_of_what_it_uses_of_other_files(monkeypatch, tmp_path):
    """A class more in the file of roles made all stored samples stale."""
    copy = tmp_path / "components"
    shutil.copytree(
        meaning.COMPONENTS, copy, ignore=shutil.ignore_patterns("__pycache__")
    )
    monkeypatch.setattr(meaning, "COMPONENTS", copy)
    names = ("wheels", "magnetometer", "manager_predictive", "spacecraft_rigid")

    def computes():
        return {name: meaning.computed(name)["computes"] for name in names}

    before = computes()
    roles, vector = copy / "contract" / "roles.py", copy / "maths" / "vector.py"
    text = roles.read_text(encoding="utf-8")
    roles.write_text(
        text + "\n\nclass EarthSensor(Sampled):\n    role = 'earth_sensor'\n"
    )
    assert computes() == before
    roles.write_text(
        text.replace('"measured field, body"', '"the measured field, body"')
    )
    assert {n for n, x in computes().items() if x != before[n]} == {"magnetometer"}
    roles.write_text(text)
    text = vector.read_text(encoding="utf-8")
    assert "def norm(" in text
    vector.write_text(text.replace("def norm(", "EXTRA = 1.0\n\n\ndef norm("))
    assert computes() == before
    changed = text.replace(
        "def norm(a: Vec3) -> float:", "def norm(a: Vec3) -> float:\n    a = a"
    )
    assert changed != text
    vector.write_text(changed)
    assert "spacecraft_rigid" in {n for n, x in computes().items() if x != before[n]}


def test_what_is_imported_counts_for_a_block_but_not_from_which_folder():
    text = "from ..maths.vector import cross as c\n\n\ndef f(x):\n    return c(x, x)\n"
    of = meaning.definitions
    assert (
        of(text)
        == of(text.replace("..maths.", "..elsewhere."))
        != of(text.replace("cross", "dot"))
    )
    assert of(text) != of(text.replace("vector", "other"))
    assert of(text, imports=False) == of(text.replace("vector", "other"), imports=False)
    assert of(text) == of(text + "\nif TYPE_CHECKING:\n    from x import y\n")


def test_moved_joined_and_split_files_leave_code_as_it_is(monkeypatch, tmp_path):
    """The place of a definition, and what is imported to reach it, are no part of the
    code's hash; a file in a new folder of the engine is."""
    scenario, before = (
        find("uosat12/starts-dct"),
        stored.code(find("uosat12/starts-dct")),
    )
    home = tmp_path / "desat"
    shutil.copytree(ROOT / "orchestrator", home)
    engine, recording = home / "engine", home / "engine" / "recording"
    monkeypatch.setattr(stored, "__file__", str(home / "papers" / "stored.py"))
    assert stored.code(scenario) == before
    (engine / "further").mkdir()
    (engine / "instances" / "fmu.py").rename(engine / "further" / "of_fmu.py")
    text = (engine / "node.py").read_text()
    (engine / "node.py").write_text(
        text.replace("from .instances", "from ..engine.instances")
    )
    joined = (engine / "current_call.py").read_text() + (
        recording / "shared_tables.py"
    ).read_text()
    head, _, rest = joined.rpartition("from __future__ import annotations")
    (engine / "current_call.py").write_text(head + rest)
    (recording / "shared_tables.py").unlink()
    assert stored.code(scenario) == before
    (engine / "instances" / "new.py").write_text("STEP = 2.0\n")
    assert stored.code(scenario) != before


def test_stored_draws_come_back(monkeypatch, tmp_path):
    """All bits, and the same bytes again; a line of stamps a scenario; a number that a
    draw has not is None; a family leaves the others as they are."""
    monkeypatch.setattr(paths, "DRAWS", tmp_path)
    rows = [
        stored.row_of_draw(0, {"a": 0.1, "b": None}),
        stored.row_of_draw(2, {"a": None, "b": 1e-300}),
    ]
    units = {"a": "s", "b": "1"}
    of_x = spreads([r.numbers for r in rows], units, set())
    x = {"sha256": "1", "units": units, "summary": of_x, "draws": rows}
    y = {
        "sha256": "2",
        "units": {"a": "s"},
        "draws": [stored.row_of_draw(0, {"a": -0.0})],
    }
    y["summary"] = spreads([r.numbers for r in y["draws"]], y["units"], set())
    for family in ("f", "e"):
        scenarios = {f"{family}/x": x, f"{family}/y": y}
        saved = {"family": family, "seed": 1, "scenarios": scenarios}
        file = stored.write(saved)
        before = file.read_bytes()
        assert stored.write(saved).read_bytes() == before
    assert len(stored.provenance_file().read_text().splitlines()) == 2 + 2 * 4
    back = stored.read("e")
    assert back == saved
    assert math.copysign(1.0, back["scenarios"]["e/y"]["draws"][0].numbers["a"]) == -1.0
    assert stored.read("f")["scenarios"]["f/x"] == x
    file.write_bytes(stored.file_of("f").read_bytes())
    with pytest.raises(
        DesatError, match=r"e/draws.parquet: not the file that .*draws.json is of"
    ):
        stored.read("e")


def test_stored_draws_are_small_and_have_what_rows_are_made_of():
    files = [*paths.DRAWS.rglob("draws.*")]
    assert {p.name for p in files} == {"draws.json", "draws.parquet"}
    assert sum(p.stat().st_size for p in files) < 2_000_000
    for family in filter(stored.with_draws, families()):
        stored_samples = stored.read(family)["scenarios"]
        lacking = {
            n: x - stored_samples[n]["units"].keys()
            for n, x in stored.needed(family).items()
            if n in stored_samples
        }
        assert not any(lacking.values()), lacking


def test_a_page_has_draws_made_anew_for_a_number_that_is_not_stored(
    monkeypatch, tmp_path
):
    name = "uosat12/starts-dct"
    stored_samples = stored.read("uosat12")
    assert "null_rms" not in stored_samples["scenarios"][name]["units"]
    monkeypatch.setattr(stored, "with_draws", lambda family: {name: find(name)})
    monkeypatch.setattr(paths, "DRAWS", tmp_path)
    stored_samples["scenarios"] = {name: stored_samples["scenarios"][name]}
    stored.write(stored_samples)
    requests = []

    def make_samples(target, count, *rest, first=0):
        requests.append((target, count, first))
        had = [r.numbers for r in stored_samples["scenarios"][name]["draws"]]
        rows = [
            stored.row_of_draw(i, {**had[i], "null_rms": float(i), "x": 1.0})
            for i in range(first, count)
        ]
        units = {
            **stored_samples["scenarios"][name]["units"],
            "null_rms": "N.m.s",
            "x": "1",
        }
        return draws.Draws(
            name, 1, rows, spreads([r.numbers for r in rows], units, set()), []
        )

    monkeypatch.setattr(stored, "draws", make_samples)
    with pytest.raises(
        DesatError, match="null_rms of its draws is not stored; without --draft"
    ):
        pages.Verbs(pages.Sources("uosat12", [], 1, 60.0)).drawn(
            "starts-dct", "null_rms"
        )
    verbs = pages.Verbs(pages.Sources("uosat12", [], 1, None))
    with pytest.raises(
        DesatError, match="draws have no number nul_rms; did you mean null_rms"
    ):
        verbs.drawn("starts-dct", "nul_rms")
    assert verbs.drawn("starts-dct", "null_rms") == [float(i) for i in range(200)]
    assert requests == [(name, 200, 0)]
    assert "x" not in stored.read("uosat12")["scenarios"][name]["units"]
    assert {"null_rms", "firing_time"} <= stored.read("uosat12")["scenarios"][name][
        "units"
    ].keys()


def test_more_draws_are_flown_after_those_that_are_kept(monkeypatch, tmp_path):
    name = "uosat12/starts-dct"
    stored_samples = stored.read("uosat12")
    scenario = find(name)
    full = stored_samples["scenarios"][name]
    full["sha256"], full["code_sha256"] = (
        stored.digest(scenario),
        stored.code(scenario),
    )
    monkeypatch.setattr(stored, "with_draws", lambda family: {name: scenario})
    monkeypatch.setattr(paths, "DRAWS", tmp_path)
    shown = full["draws"][0].numbers["firing_time"]
    first = full["draws"][:-1]
    first[0] = stored.row_of_draw(0, dict.fromkeys(first[0].numbers, 1.0))
    stored_samples["scenarios"] = {name: {**full, "draws": first}}
    stored.write(stored_samples)
    assert stored.outdated(stored.read("uosat12")) == [name]
    result = stored.renew("uosat12", 1)["scenarios"][name]
    assert result["draws"][1:] == full["draws"][1:]
    assert result["draws"][0] == first[0] != shown, (
        "a draw that is kept is not flown again"
    )
    assert result["summary"]["firing_time"].n == scenario.content.samples
    assert result["summary"]["firing_time"].levels["min"] == 1.0


def test_an_instance_that_is_named_by_its_file_has_the_components_name():
    """As Ecos does; its folder is another one in every run."""
    assert _name("gyro") == "gyro"
    assert _name("/somewhere/ecos_ssp_667c8ae5/resources/gyro.fmu") == "gyro"
    assert _name("C:\\somewhere\\resources\\gyro.fmu") == "gyro"


# --- the same bits under another Python -----------------------------------------------

DIGEST = """
import hashlib, importlib, json, random, sys
sys.path.insert(0, sys.argv[1])
from components.contract.block import Block
from components.physics.wheel_array import pseudo_inverse

def value(v, rng):
    flat = tuple(x + rng.uniform(-1.0, 1.0) * (abs(x) or SIZE.get(v.unit, 1.0)) * 0.1
                 for x in v.flat_start())
    return flat if v.shape else flat[0]

SIZE = {"T": 3e-4, "N.m.s": 1.0, "N.m": 1e-2, "rad/s": 1e-2, "A.m2": 50.0, "kg/m3": 1e-11}
digests = {}
rng = random.Random(1)
axes = (tuple(rng.uniform(-1.0, 1.0) for _ in range(12)) for _ in range(1000))
digests["pseudo_inverse"] = repr([pseudo_inverse(a) for a in axes])
for name in json.loads(sys.argv[2]):
    module = importlib.import_module("components.blocks." + name)
    (kind,) = (x for x in vars(module).values() if isinstance(x, type)
               and issubclass(x, Block) and x.__module__ == module.__name__)
    block, rng, rows = kind(), random.Random(2), []
    for v in block.variables:  # everything that draws, rubs or drifts
        if v.causality == "parameter" and v.name in ("noise", "bias_walk", "markov_sigma",
                "viscous", "compensation", "unbalance", "motor_lag", "lag"):
            setattr(block, v.name, 1e-5 if v.unit != "s" else 0.1)
    block.start()
    block.output(0.0)
    for k in range(50):
        for v in block.variables:
            if v.causality == "input" and v.type == "Real":
                setattr(block, v.name, value(v, rng))
        block.advance(float(k), 1.0)
        block.output(k + 1.0)
        rows.append([getattr(block, v.name) for v in block.variables if v.causality == "output"])
    digests[name] = repr(rows)
digests = {k: hashlib.sha256(v.encode()).hexdigest() for k, v in digests.items()}
print(json.dumps([list(sys.version_info[:2]), digests]))
"""
COMPENSATED_FROM = (3, 12)
"""The Python from which on `sum` of floats is compensated."""


def other_python() -> str | None:
    """A Python on the other side of that, where there is one."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    candidates = [shutil.which(f"python3.{minor}") for minor in range(11, 16)]
    candidates += [str(p) for p in sorted(pyenv.glob("versions/3.*/bin/python3"))]
    for path in filter(None, candidates):
        says = subprocess.run(
            [path, "-c", "import sys; print(*sys.version_info[:2])"],
            capture_output=True,
            text=True,
            check=False,
        ).stdout
        version = tuple(map(int, says.split()))
        compensates = version >= COMPENSATED_FROM
        if version >= (3, 11) and compensates != (sys.version_info >= COMPENSATED_FROM):
            return path
    return None


def test_blocks_have_the_same_bits_under_another_python():
    """Once `pseudo_inverse` differed in 74 % of its values between 3.11 and 3.12."""
    other = other_python()
    if other is None:
        pytest.skip("no Python on the other side of 3.12 here")
    foreign = ("import numpy", "import scipy", "sgp4")
    names = [
        name
        for name in registry.names()
        if not any(
            word in path.read_text() for path in sources(name) for word in foreign
        )
    ]
    assert len(names) > 20
    (ours, digests), (theirs, other_digests) = (
        json.loads(
            subprocess.run(
                [path, "-B", "-c", DIGEST, str(ROOT), json.dumps(names)],
                capture_output=True,
                text=True,
                check=True,
                cwd=ROOT,
            ).stdout
        )
        for path in (sys.executable, other)
    )
    assert ours != theirs
    assert digests == other_digests
