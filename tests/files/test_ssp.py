"""SSP files: what we pack is valid and self-contained; what we read is read safely."""

from __future__ import annotations

import re
import subprocess
import zipfile
from dataclasses import replace
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.fmi2 import FMU2Slave
from lxml import etree

from desat.export.packing import pack, pack_scenario
from desat.files import io, library, paths, scenario, ssp
from desat.files.build import build
from desat.files.scenario import families, find, scenarios
from desat.files.xml import parse_bytes, validate
from desat.runs.checks import check_draft
from desat.runs.prepare import prepare, read
from desat.runs.run import Options, execute
from desat.system.errors import DesatError
from tests.conftest import ROOT, one_of_each_craft, slow_after

NAME = "uosat12/table3-ocdc-ilqr-1"


@pytest.fixture(scope="module")
def package(tmp_path_factory) -> Path:
    return pack_scenario(find(NAME), tmp_path_factory.mktemp("ssp") / "x.ssp")


def test_packed_file_is_in_the_universal_profile(package):
    with zipfile.ZipFile(package) as archive:
        members = {n: archive.read(n) for n in archive.namelist()}
    text = members["SystemStructure.ssd"].decode()
    root = parse_bytes(text.encode(), "SystemStructure.ssd")
    assert validate(root, "SystemStructureDescription.xsd", "x") == []
    for prefix in ("<ssd:", "<ssc:", "<osp:", "<oms:"):
        assert prefix in text
    assert (
        'xmlns:osp="http://opensimulationplatform.com/SSP/OSPAnnotations"'
        in text.split(">")[1]
    )
    endpoints, wire_ends, sets = set(), set(), set()
    for component in root.iter(f"{{{ssp.SSD}}}Component"):
        assert component.get("source") in members
        for connector in component.iter(f"{{{ssp.SSD}}}Connector"):
            endpoints.add((component.get("name"), connector.get("name")))
            (kind,) = connector
            assert etree.QName(kind).localname in ("Real", "Integer", "Boolean")
        for binding in component.iter(f"{{{ssp.SSD}}}ParameterBinding"):
            values = parse_bytes(members[binding.get("source")], "ssv")
            assert validate(values, "SystemStructureParameterValues.xsd", "x") == []
            sets.add(values.get("name"))
    for c in root.iter(f"{{{ssp.SSD}}}Connection"):
        wire_ends |= {
            (c.get("startElement"), c.get("startConnector")),
            (c.get("endElement"), c.get("endConnector")),
        }
    assert endpoints == wire_ends
    assert sets == {"parameters"}
    assert 'numWorkerThreads="0"' in text
    assert 'description="oms-ma"' in text


def _description(path):
    with zipfile.ZipFile(path) as archive:
        return etree.fromstring(archive.read("SystemStructure.ssd")).get("description")


def test_what_other_tools_make_otherwise_is_said(package, tmp_path, desat):
    """In the file and when it is packed: hints that some ignore, FMUs of FMI 3.0."""
    assert _description(package) is None
    slow, third = tmp_path / "slow.toml", tmp_path / "third.toml"
    slow.write_text('extends = "nadir_day/day-dipole"\n[step_ratio]\nenvironment = 2\n')
    fmu = paths.fmus() / "fmi3" / "rate_gyro.fmu"
    third.write_text(f'extends = "nadir_day/day-dipole"\nsources.gyro = "{fmu}"\n')
    for file, message in (
        (slow, "environment: slower than the step"),
        (third, "gyro: of FMI 3.0"),
    ):
        command = desat("pack", str(file), check=True)
        (line,) = command.stderr.splitlines()
        assert line.startswith(f"note: nadir_day/{file.stem}: ")
        assert message in line
        assert message in _description(file.with_suffix(".ssp"))


def test_packing_is_reproducible(package, tmp_path):
    again = pack_scenario(find(NAME), tmp_path / "y.ssp", force=True)
    assert again.read_bytes() == package.read_bytes()


def test_packed_file_stands_alone(package, tmp_path, monkeypatch):
    monkeypatch.setattr(paths, "fmus", lambda: tmp_path)
    run = execute(str(package), Options(stop=50.0))
    assert run.ok
    assert run.manifest["about"]["name"] == NAME


def test_a_folder_runs_as_well(package, tmp_path):
    with zipfile.ZipFile(package) as archive:
        archive.extractall(tmp_path)
    a, b = (execute(str(p), Options()) for p in (package, tmp_path))
    assert a.manifest["numbers"] == b.manifest["numbers"]


#: Their Python FMUs take seconds; those of other scenarios show the same.
SLOW_IN_PYTHON = ("hausat2/rollout-gyro", "space_telescope/preview-nominal")


# the first craft of each family, and each third of the others
PACKED = [
    name
    for k, name in enumerate(one_of_each_craft())
    if k % 3 == 0
    or name
    == next(n for n in one_of_each_craft() if n.split("/")[0] == name.split("/")[0])
]


@pytest.mark.real_units
@pytest.mark.parametrize("name", slow_after(7, PACKED))
def test_a_packed_scenario_gives_the_bits_of_the_scenario(name, tmp_path):
    """One of each craft: what tables, pages and draws compute of scenarios holds for
    the packed files that other tools load."""
    data = find(name).content.written
    options = Options(stop=min(data["stop"], 80.0 * data["step"]))
    kind = "native" if name in SLOW_IN_PYTHON else "python"
    place = pack_scenario(find(name), tmp_path / "x.ssp", fmus=kind)
    packed_run = execute(str(place), options)
    plain = execute(name, options)
    assert packed_run.ok
    assert packed_run.manifest["numbers"] == plain.manifest["numbers"]
    assert packed_run.results.names() == plain.results.names()
    for series in plain.results.names():
        assert np.array_equal(
            packed_run.results.values(series),
            plain.results.values(series),
            equal_nan=plain.results.values(series).dtype.kind == "f",
        ), series


def test_there_are_crafts_of_every_family():
    assert {name.split("/")[0] for name in one_of_each_craft()} == set(families())


def test_every_scenario_has_a_title_and_a_story():
    for inputs in scenarios().values():
        assert inputs.content.title
        assert inputs.content.description


def test_every_cell_of_tables_2_and_3_is_a_scenario():
    cases = [f"{law}-{i}" for law in ("ilqr", "mec") for i in (1, 2, 3)]
    names = {
        f"uosat12/table2-{m}-{c}"
        for m in ("dct", "cccp", "crcp", "ocdc")
        for c in cases
    }
    names |= {f"uosat12/table3-{m}-{c}" for m in ("dct", "ocdc") for c in cases}
    assert names <= set(scenarios("uosat12"))


def test_what_others_would_misread_is_not_packed(tmp_path):
    draft = build(read(NAME), Options())
    draft.connections[0] = replace(draft.connections[0], factor=2.0)
    system, _ = check_draft(draft).or_raise()
    with pytest.raises(DesatError, match="converts its value"):
        pack(system, tmp_path / "x.ssp")
    assert not list(tmp_path.iterdir())


def rezip(source: Path, target: Path, **changes: bytes | None) -> Path:
    with zipfile.ZipFile(source) as a, zipfile.ZipFile(target, "w") as b:
        for n in a.namelist():
            b.writestr(n, a.read(n))
        for n, data in changes.items():
            b.writestr(n, data)
    return target


def test_hostile_archives(package, tmp_path, monkeypatch):
    with pytest.raises(DesatError, match="would leave the folder"):
        ssp.read(rezip(package, tmp_path / "a.ssp", **{"../../evil": b"x"}), Options())
    with pytest.warns(UserWarning, match="Duplicate"):
        twice = rezip(package, tmp_path / "b.ssp", **{"SystemStructure.ssd": b"x"})
    with pytest.raises(DesatError, match=r"holds SystemStructure.ssd twice"):
        ssp.read(twice, Options())
    big = rezip(package, tmp_path / "c.ssp", extra=b"0" * 1000)
    monkeypatch.setattr(io, "LARGEST", 1000)
    with pytest.raises(DesatError, match="allowed"):
        ssp.read(big, Options())


@pytest.mark.parametrize(
    ("data", "message"),
    [(b"not a zip", "not a readable archive"), (None, "no such file")],
)
def test_no_archives(tmp_path, data, message):
    path = tmp_path / "x.ssp"
    if data:
        path.write_bytes(data)
    with pytest.raises(DesatError, match=message):
        ssp.read(path, Options())


def test_entities_are_not_resolved():
    xml = b'<?xml version="1.0"?><!DOCTYPE a [<!ENTITY e SYSTEM "file:///etc/passwd">]><a>&e;</a>'
    with pytest.raises(DesatError, match="DOCTYPE"):
        parse_bytes(xml, "x.ssd")


@pytest.fixture
def scenario_module():
    from desat.files import scenario

    yield scenario
    scenario.families.cache_clear()
    scenario.cells.cache_clear()
    scenario._cell.cache_clear()
    scenario.survey.cache_clear()
    scenario.scenarios.cache_clear()


def test_scenario_files(tmp_path, monkeypatch, scenario_module):
    scenario = scenario_module
    folder = tmp_path / "ssp" / "f" / "scenarios"
    folder.mkdir(parents=True)
    (folder.parent / "SystemStructure.ssd").write_text(
        (ROOT / "ssp/uosat12/SystemStructure.ssd").read_text()
    )
    monkeypatch.setattr(scenario, "ROOT", tmp_path / "ssp")
    monkeypatch.setattr(paths, "SCENARIOS", tmp_path / "ssp")

    def read(**files: str):
        for old in folder.glob("*.toml"):
            old.unlink()
        for name, text in files.items():
            (folder / f"{name}.toml").write_text(text)
        scenario.families.cache_clear()
        scenario.cells.cache_clear()
        scenario._cell.cache_clear()
        scenario.survey.cache_clear()
        scenario.scenarios.cache_clear()
        return scenario.scenarios()

    base = "abstract = true\nstep = 10\nstop = 20\n[parameters.manager]\nduty = 0.5\n[axes.m]\n"
    family = read(
        base=base,
        t='extends = "base"\ntitle = "{m} at {c}"\nbaseline = "t-a-{c}"\n'
        '[axes.m.a]\nlabel = "A"\n[axes.m.b]\nparameters.manager.split = "dct"\n[axes.c.x]\n',
    )
    assert list(family) == ["f/t-a-x", "f/t-b-x"]
    b = family["f/t-b-x"]
    assert b.content.title == "b at x"
    assert family["f/t-a-x"].content.title == "A at x"
    assert b.baseline == "f/t-a-x"
    assert family["f/t-a-x"].baseline is None
    assert b.content.parameters["manager"] == {"duty": 0.5, "split": "dct"}
    family = read(
        base=base,
        t='extends = "base"\n[axes.m.a]\n[axes.m.b]\nwithout = ["parameters.manager.duty"]\n',
    )
    assert family["f/t-a"].content.parameters["manager"] == {"duty": 0.5}
    assert family["f/t-b"].content.parameters["manager"] == {}
    with pytest.raises(
        DesatError, match=r"t.toml: without parameters.q.x: there is none before"
    ):
        read(t='[axes.m.a]\nwithout = ["parameters.q.x"]')
    with pytest.raises(
        DesatError, match=r"ssp/f/scenarios/t.toml:1: stp: unknown key; did you mean"
    ):
        read(t="stp = 3")
    with pytest.raises(DesatError, match=r"ssp/f/scenarios/t.toml: .*line 1"):
        read(t="x = = 3")
    with pytest.raises(DesatError, match=r"extends itself"):
        read(t='extends = "t"')
    read(t="step = 1")
    with pytest.raises(DesatError, match=r"no scenario f/q; did you mean f/t"):
        scenario.find("f/q")
    read(t="[parameters.manger]\nduty = 0.5")
    problems = build(scenario.find("f/t"), Options()).problems
    assert "no component manger; did you mean manager" in "\n".join(problems)
    read(t="[parameters.manager]\nduti = 0.5\n[shared]\nnothing = 1")
    problems = build(scenario.find("f/t"), Options()).problems
    assert "manager has no variable duti; did you mean duty?" in "\n".join(problems)
    assert "no component has a parameter nothing" in "\n".join(problems)


def test_packing_all_leaves_what_is_current(monkeypatch, tmp_path):
    """492 files of 2 MB each were written anew each time, also by `make demo`."""
    from desat.cli.commands.pack import pack as command

    monkeypatch.setattr(scenario, "scenarios", lambda family=None: {NAME: find(NAME)})
    monkeypatch.setattr(paths, "packed_folder", lambda: tmp_path)
    command(None)
    path = tmp_path / f"{NAME}.ssp"
    change_time = path.stat().st_mtime_ns
    command(None)
    assert path.stat().st_mtime_ns == change_time
    command(None, [NAME])
    assert path.stat().st_mtime_ns > change_time


def test_make_demo_and_make_ssp_pack_what_is_needed():
    pack_lines = {
        target: [
            line
            for line in subprocess.run(
                ["make", "-n", target],
                cwd=ROOT,
                capture_output=True,
                text=True,
                check=True,
            ).stdout.splitlines()
            if "desat pack" in line and "--ssd" not in line
        ]
        for target in ("demo", "ssp")
    }
    assert pack_lines == {
        "demo": [".venv/bin/desat pack uosat12/table3-ocdc-ilqr-1"],
        "ssp": [],
    }


# --- hosts that read no parameter set -------------------------------------------------


def rewritten(source: Path, target: Path, change) -> Path:
    """A copy of an archive; `change` maps name and data of a member, None leaves it out."""
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        for entry in old.infolist():
            data = change(entry.filename, old.read(entry))
            if data is not None:
                new.writestr(entry, data)
    return target


def without_sets(name: str, data: bytes) -> bytes | None:
    bindings = rb"<ssd:ParameterBindings>.*?</ssd:ParameterBindings>"
    if name.endswith(".ssv"):
        return None
    return re.sub(bindings, b"", data, flags=re.DOTALL) if name.endswith("d") else data


@pytest.mark.parametrize(
    ("fmus", "arrays"), [("python", False), ("native", False), ("native", True)]
)
def test_a_packed_system_needs_no_parameter_sets(tmp_path, fmus, arrays):
    """Its FMUs start with the scenario's values: the same bits without its .ssv; and
    they are ours, which run in this process."""
    name = "nadir_day/day-dipole"
    options = Options(stop=100.0)
    plain_results = execute(name, options).results
    archive_file = pack_scenario(
        find(name), tmp_path / "a.ssp", True, fmus, arrays=arrays
    )
    bare = rewritten(archive_file, tmp_path / "b.ssp", without_sets)
    for path in (archive_file, bare):
        run = execute(str(path), options)
        assert [c.fmu.ours for c in run_components(path)] == [True] * 11
        for series in plain_results.names():
            assert (
                run.results.values(series).tobytes()
                == plain_results.values(series).tobytes()
            ), series


def run_components(path: Path):
    system, _ = prepare(str(path), Options(stop=100.0)).or_raise()
    return system.components.values()


def test_a_copy_that_differs_in_more_than_its_values_is_foreign(tmp_path):
    archive_file = pack_scenario(
        find("nadir_day/day-dipole"), tmp_path / "a.ssp", True, "native"
    )
    with zipfile.ZipFile(archive_file) as archive:
        fmu = tmp_path / "wheels.fmu"
        fmu.write_bytes(archive.read("resources/wheels.fmu"))
    assert library.load(fmu).ours
    changes = {
        "resources/start.txt": lambda data: data + b"R 1 3ff0000000000000\n",
        "modelDescription.xml": lambda data: data.replace(b"wheels", b"wheals", 1),
        "sources/wheels.c": lambda data: data + b" ",
        "binaries/linux64/wheels.so": lambda data: data[:-1],
    }
    for member, change in changes.items():
        other = rewritten(
            fmu,
            tmp_path / f"{member.replace('/', '-')}.fmu",
            lambda name, data, member=member, change=change: (
                change(data) if name == member else data
            ),
        )
        assert not library.load(other).ours, member


def test_a_copy_starts_anew_with_its_values(tmp_path):
    """By fmpy: after instantiation and after a reset, native and of Python."""
    for kind in ("native", "python"):
        archive_file = pack_scenario(
            find("nadir_day/day-dipole"), tmp_path / f"{kind}.ssp", True, kind
        )
        with zipfile.ZipFile(archive_file) as archive:
            fmu = tmp_path / f"{kind}.fmu"
            fmu.write_bytes(archive.read("resources/torquers.fmu"))
        description = fmpy.read_model_description(fmu)
        starts = {
            v.valueReference: float(v.start)
            for v in description.modelVariables
            if v.type == "Real" and v.causality == "parameter"
        }
        own_value = fmpy.read_model_description(library.our_file("torquers.fmu", kind))
        assert description.guid != own_value.guid
        slave = FMU2Slave(
            guid=description.guid,
            unzipDirectory=str(library.extract(fmu)),
            modelIdentifier="torquers",
            instanceName="torquers",
        )
        slave.instantiate()
        assert slave.getReal(list(starts)) == list(starts.values())
        slave.reset()
        assert slave.getReal(list(starts)) == list(starts.values())
        slave.freeInstance()
