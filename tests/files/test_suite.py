"""The suite for hosts and importers: our own importer does what each system expects."""

from __future__ import annotations

import json
import zipfile

import pytest

from benchmarks.hosts import PAGE
from benchmarks.suite import __main__ as suite
from benchmarks.suite.files import libraries, package
from benchmarks.suite.systems import GROUPS, systems
from desat.fmus.compiler import NoCompilerError

SYSTEMS = systems()


@pytest.fixture(autouse=True)
def _library():
    try:
        libraries()
    except NoCompilerError as error:
        pytest.skip(str(error))


@pytest.mark.parametrize("name", SYSTEMS)
def test_our_importer_does_what_is_expected(name, tmp_path):
    _, system = SYSTEMS[name]
    path = tmp_path / f"{name}.ssp"
    path.write_bytes(package(system))
    outcome = suite.run("desat", system, path)
    assert suite.judge(system, outcome) in suite.PASSES, outcome


@pytest.mark.parametrize(
    ("name", "fault"),
    [
        ("type_Real_2", ""),
        ("fault_crash", "ends the process: SIGSEGV"),
        ("fault_exit", "ends the process: exit(0)"),
        ("fault_not_a_number", "runs to the end without a message"),
    ],
)
def test_a_host_has_a_process_of_its_own(name, fault, tmp_path):
    _, system = SYSTEMS[name]
    path = tmp_path / f"{name}.ssp"
    path.write_bytes(package(system))
    assert suite.judge(system, suite.run_apart("FMPy", name, path)) == fault


def test_the_files_are_written_for_other_tools(tmp_path, monkeypatch):
    """For this platform: zig takes a minute for the first library of another."""

    def missing() -> None:
        raise NoCompilerError("none")

    monkeypatch.setattr(suite, "zig", missing)
    suite.write(tmp_path)
    expectations = json.loads((tmp_path / "expected.json").read_text(encoding="utf-8"))
    assert set(expectations) == {path.stem for path in tmp_path.glob("*.ssp")}
    assert expectations["unit_factor"]["numbers"] == {"b.y": 5000}
    assert all(x["numbers"] or x["refusal_allowed"] for x in expectations.values())
    with zipfile.ZipFile(tmp_path / "type_Real_2.ssp") as archive:
        assert "resources/a.fmu" in archive.namelist()


def test_the_page_has_the_groups_of_now():
    """`python -m benchmarks.suite --keep` writes the table."""
    table = PAGE.read_text(encoding="utf-8").split(suite.BEGIN)[1].split(suite.END)[0]
    assert f"{len(SYSTEMS)} systems" in table
    counts = [len(list(make())) for make in GROUPS.values()]
    for group, n in zip(GROUPS, counts, strict=True):
        assert f"| {group} | {n} of {n} |" in table
