"""What components refuse is told before a run, with file and key."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
import zipfile
from dataclasses import replace

import pytest

from desat.engine import current_call, trial_initialisation
from desat.files import library, paths
from desat.runs.run import Options, prepare

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
    code, shared_object = tmp_path / "ends.c", tmp_path / "ends.so"
    code.write_text(
        "#include <stdlib.h>\n"
        "__attribute__((constructor)) static void ends(void) { abort(); }\n"
        "int fmi2Instantiate, fmi2DoStep;\n"
    )
    subprocess.run(
        [compiler, "-shared", "-fPIC", "-o", shared_object, code], check=True
    )
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
            theirs.writestr(name, shared_object.read_bytes() if is_library else data)
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
