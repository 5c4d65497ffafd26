"""The command as a user meets it."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from importlib.metadata import version
from math import pi, sqrt
from pathlib import Path

import pytest
from typer.main import get_command

from desat import cli
from desat.campaign.draws import draws
from desat.cli import console
from desat.cli.console import print_table
from desat.components.physics.orbit import MU
from desat.engine.recording.results import Results
from desat.files import paths
from desat.files.scenario import families, scenarios, summary
from desat.report.table import Column, Table
from desat.system.errors import Exit
from desat.system.options import Options
from desat.system.quantity import Quantity
from tests.conftest import ROOT, python

NAME = "uosat12/table3-ocdc-ilqr-1"


def test_help(desat):
    for command in (
        (),
        ("run",),
        ("campaign",),
        ("check",),
        ("pack",),
        ("tables",),
        ("report",),
        ("bound",),
        ("design",),
        ("list",),
    ):
        result = desat(*command, "--help")
        assert result.returncode == 0
        assert "Usage" in result.stdout


def test_no_flag_is_set_but_the_baseline_and_counts_are_as_told(desat):
    """A command that prints JSON or runs bare blocks unasked would be another command."""
    flags = {
        (name, option.name)
        for name, command in get_command(cli.app_for([])).commands.items()
        for option in command.params
        if name in ("run", "check", "sweep", "tables", "size")
        and getattr(option, "is_flag", False)
        and option.default
    }
    assert flags == {("run", "baseline"), ("size", "loop"), ("size", "year")}
    for command, line in (
        (
            "sweep",
            "Print medians of this many random samples (0: none). [default: 0; x>=0]",
        ),
        ("sweep", "Seed of the random samples. [default: 1; x>=0]"),
        ("size", "Duty of the coils to recommend rods for. [default: 50.0]"),
    ):
        assert line in " ".join(desat(command, "--help").stdout.split())


def test_list(desat):
    names = [s["name"] for s in json.loads(desat("list", "--json", check=True).stdout)]
    assert NAME in names
    assert NAME in desat("list", "uosat12", check=True).stdout


def test_run(desat, tmp_path):
    result = desat("run", NAME, "--out", str(tmp_path / "a"), "--csv")
    assert result.returncode == 0, result.stderr
    note = "states at t = 600 s have no interval after them, and no row"
    assert result.stderr == f"note: series.csv: {note}\n"
    assert {p.name for p in (tmp_path / "a").iterdir()} == {
        "manifest.json",
        "series.h5",
        "series.csv",
        "report.html",
        "baseline",
    }
    html = (tmp_path / "a" / "report.html").read_text()
    assert html.count("<svg") == 9  # seven figures, the loop and the craft
    assert "src=" not in html.replace("src=x", "")
    assert "DCT, ILQR 1" in html
    assert "N m s" in html


def test_run_json(desat, tmp_path):
    result = desat(
        "run",
        NAME,
        "--json",
        "--out",
        str(tmp_path / "a"),
        "--set",
        "manager.split=crcp",
        "--stop",
        "100",
        check=True,
    )
    manifest = json.loads(result.stdout)
    assert manifest["steps_done"] == 10
    assert manifest["parameters"]["manager"]["split"]["value"] == "crcp"
    assert manifest["numbers"]["saving"]["reference"] == "table3-dct-ilqr-1"


def test_runs_do_not_overwrite(desat, tmp_path):
    for folder_name in ("uosat12-table3-ocdc-ilqr-1", "uosat12-table3-ocdc-ilqr-1-2"):
        result = desat("run", NAME, "--no-baseline", "--json", cwd=tmp_path)
        assert json.loads(result.stdout)["folder"] == f"runs/{folder_name}"
    result = desat("run", NAME, "--out", "runs", cwd=tmp_path)
    assert result.returncode == 2
    assert (
        result.stderr
        == "error: --out runs: it exists already and is not an empty folder\n"
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("run", "uosat12/table3-ocdc-ilq-1"),
            "did you mean uosat12/table3-ocdc-ilqr-1?",
        ),
        (("run", "nothing.ssp"), "nothing.ssp: no such file or folder"),
        (
            ("run", NAME, "--set", "manager.splt=dct"),
            "manager has no variable splt; did you mean",
        ),
        (
            ("run", NAME, "--set", "manger.split=dct"),
            "no component manger; did you mean manager?",
        ),
        (("run", NAME, "--set", "split"), "the form is COMPONENT.VARIABLE=VALUE"),
        (
            ("run", NAME, "--set", "manager.duty=x"),
            "--set manager.duty=x: manager.duty: ",
        ),
        (
            ("run", NAME, "--step", "7"),
            "--step 7: 600 s is not a multiple of the step 7 s",
        ),
        (("run", NAME, "--stop", "1e300"), "steps of 10 s; at most 1e+12 are made"),
        (
            ("run", NAME, "--substeps", "0"),
            "substeps = 0: auto is needed, or an integer from 1 to",
        ),
        (("run", NAME, "--step", "-1"), "a positive number is needed"),
        (
            ("run", NAME, "--set", "torquers.duty_max=0.95"),
            "pulse_delay + duty_max * sample_time",
        ),
        (("tables", "uosat13"), "no family uosat13; did you mean uosat12?"),
        (("report", "."), "no run folder"),
        (("campaign", NAME, "--set", "manager.duty=3"), "allowed is 0 to 1"),
        (("pack", "uosat12/x"), "no scenario uosat12/x"),
        (
            ("run", NAME, "--source", "manger=x.fmu"),
            "no component manger; did you mean manager?",
        ),
        (("run", NAME, "--source", "manager"), "the form is COMPONENT=FMU"),
        (
            ("run", NAME, "--source", "manager=manager_combind"),
            "mean manager_combined?",
        ),
        (
            ("run", NAME, "--source", "manager=environment_kepler"),
            "manager: its FMU lacks what is wired: ",
        ),
        (("run", "/dev/null"), "/dev/null: neither a .toml, .ssp or .ssd file"),
        (("run", NAME, "--out", "/proc/x"), "/proc/x: No such file or directory"),
    ],
)
def test_bad_input_is_a_line(desat, tmp_path, arguments, message):
    result = desat(*arguments, cwd=tmp_path)
    assert result.returncode == 2
    assert result.stdout == ""
    assert message in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert result.stderr.startswith("error: ")
    assert not list(tmp_path.rglob("series.h5*"))


def test_another_fmu_in_a_components_place(desat, tmp_path):
    """By name or file; what both managers declare alike stays, and what is lost is
    said."""
    fmu = tmp_path / "theirs.fmu"
    shutil.copy(paths.fmus() / "native" / "manager_receding_horizon.fmu", fmu)
    answers = []
    for number, source in enumerate(("manager_receding_horizon", str(fmu))):
        result = desat(
            "run",
            NAME,
            "--source",
            f"manager={source}",
            "--set",
            "manager.b_y=-2.4e-6",
            "--no-baseline",
            "--json",
            "--out",
            str(tmp_path / str(number)),
            check=True,
        )
        assert "does not take k_cross, weight_ratio, saturation, split" in result.stderr
        answers.append(json.loads(result.stdout))
    assert (
        answers[0]["fmus"]["manager"]["sha256"]
        == answers[1]["fmus"]["manager"]["sha256"]
    )
    assert (
        answers[0]["parameters"]["manager"]["g_rate"]
        == answers[1]["parameters"]["manager"]["g_rate"]
    )
    for manifest in answers:
        assert manifest["numbers"]["firing_time"]["value"] == pytest.approx(
            52.85, abs=0.1
        )


def test_line_numbers_are_not_emoji(desat, tmp_path):
    shutil.copy(ROOT / "ssp" / "uosat12" / "SystemStructure.ssd", tmp_path)
    result = desat("check", str(tmp_path))
    assert result.returncode == 1
    assert re.search(r"SystemStructure\.ssd:\d+: manager", result.stderr)


def test_usage_errors(desat):
    result = desat("run")
    assert result.returncode == 2
    assert "Missing argument" in result.stderr
    assert "Traceback" not in result.stderr


def test_numbers_are_printed_whole_in_however_many_columns(capsys):
    columns = [Column(str(i), kind="text") for i in range(60)]
    print_table(Table("", columns, [["1.234567e-05"] * 60]))
    assert capsys.readouterr().out.count("1.234567e-05") == 60


def test_draws_do_not_depend_on_count_or_processes():
    three = draws(NAME, 3, 5, Options(), 1).to_json()
    four = draws(NAME, 4, 5, Options(), 2).to_json()
    assert three["draws"] == four["draws"][:3]
    assert draws(NAME, 1, 6, Options()).rows[0].numbers != three["draws"][0]["numbers"]
    times = sorted(d["numbers"]["firing_time"] for d in three["draws"])
    assert three["summary"]["firing_time"] == {
        "unit": "s",
        "median": times[1],
        "low": times[0],
        "high": times[2],
        "min": times[0],
        "max": times[2],
        "n": 3,
        "not_reached": 0,
    }
    assert len({d["values"]["magnetometer.seed"] for d in four["draws"]}) == 4


def test_a_small_campaign_prints_statistics_of_the_same_draws(desat, tmp_path):
    short = ("campaign", NAME, "-n", "3", "--seed", "5", "--jobs", "1", "--out", "c")
    outcome = desat(*short, cwd=tmp_path, check=True).stdout.splitlines()
    assert outcome[1].split() == [
        "number",
        "median",
        "5",
        "%",
        "95",
        "%",
        "min",
        "max",
        "unit",
        "not",
        "reached",
    ]
    assert outcome[7].endswith("more numbers in the report; --all prints them")
    answer = json.loads(
        desat("campaign", "report", "c", "--json", cwd=tmp_path, check=True).stdout
    )
    summary = draws(NAME, 3, 5, Options(), 1).summary
    assert len(summary) > 5
    for name, entry in summary.items():
        assert [answer["numbers"][name][k] for k in ("median", "min", "max")] == [
            entry.levels[k] for k in ("median", "min", "max")
        ]


LEAN_MANAGER = '''
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class LeanManager(Fmi2Slave):
    """Somebody's manager: rates and momentum are none of its business, three wheels."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.values = dict.fromkeys({inputs!r} + {outputs!r}, 0.0)
        for names, causality in (
            ({inputs!r}, Fmi2Causality.input), ({outputs!r}, Fmi2Causality.output)
        ):
            for name in names:
                self.register_variable(Real(
                    name, causality=causality, getter=lambda n=name: self.values[n],
                    setter=lambda v, n=name: self.values.update({{n: v}}),
                ))

    def do_step(self, current_time, step_size):
        for i in (1, 2, 3):
            self.values[f"m_cmd_body[{{i}}]"] = 1e5 * self.values[f"b_body[{{i}}]"]
        return True
'''


@pytest.fixture
def lean_manager(tmp_path):
    """Build a foreign manager with some outputs; its only inputs are field and three
    wheels."""

    def make(*outputs: str) -> str:
        inputs = [f"{name}[{i}]" for name in ("b_body", "h_wheel") for i in (1, 2, 3)]
        script = tmp_path / f"lean_manager_{len(outputs)}.py"
        script.write_text(LEAN_MANAGER.format(inputs=inputs, outputs=list(outputs)))
        # in a process of its own: an FMU of Python that this one has loaded brings a
        # pythonfmu without binaries
        fmu_file = tmp_path / f"lean{len(outputs)}.fmu"
        command = [
            sys.executable,
            "-m",
            "pythonfmu",
            "build",
            "-f",
            script,
            "-d",
            fmu_file,
        ]
        subprocess.run(command, check=True, capture_output=True)
        return str(fmu_file)

    return make


def test_a_foreign_manager_needs_only_what_its_law_wants(desat, tmp_path, lean_manager):
    outputs = [
        f"{name}[{i}]"
        for name in ("m_cmd_body", "tau_cmd_thruster_body", "tau_cmd_wheel")
        for i in range(1, 5 if name == "tau_cmd_wheel" else 4)
    ]
    full = f"manager={lean_manager(*outputs)}"
    result = desat(
        "run",
        NAME,
        "--source",
        full,
        "--no-baseline",
        "--json",
        "--stop",
        "100",
        "--out",
        str(tmp_path / "run"),
    )
    assert result.returncode == 0, result.stderr
    lines = [x for x in result.stderr.splitlines() if "left unwired" in x]
    assert len(lines) == 1
    assert lines[0].startswith("warning: manager: lean")
    assert (
        "has no input h_wheel[4], omega_bi_body, r_eci, v_eci, valid_b, valid_h:"
        in lines[0]
    )
    with Results.open(tmp_path / "run") as results:
        dipole = results.values("manager.m_cmd_body")
        field = results.values("magnetometer.b_body")
    assert dipole[2:].any()
    assert dipole[1:].tolist() == (1e5 * field[1 : len(dipole)]).tolist()

    short = f"manager={lean_manager(*outputs[:2], *outputs[3:])}"
    result = desat("check", NAME, "--source", short)
    assert result.returncode == 1
    (line,) = [x for x in result.stderr.splitlines() if "lacks" in x]
    assert line == (
        f"--source {short}: manager: its FMU lacks what is wired: output m_cmd_body[3]"
    )


def test_list_and_help_import_nothing_heavy(desat):
    """Numerics, plots and FMI take a second to import; `list` and `--help` have 0.4 s."""
    desat("list", check=True)  # keeps what it has found of the files
    code = """
import atexit, sys
from desat.cli import main
heavy = {"numpy", "scipy", "matplotlib", "fmpy", "h5py", "lxml", "jinja2", "sgp4", "pythonfmu",
         "pydantic"}
atexit.register(lambda: print("heavy:", sorted(heavy & set(sys.modules)), file=sys.stderr))
main()
"""
    for arguments in (
        ("list",),
        ("list", "integrated"),
        ("list", "--all", "--json"),
        ("--help",),
        ("--version",),
        ("run", "--help"),
    ):
        result = python(code, *arguments)
        assert result.returncode == 0, result.stderr
        assert result.stderr == "heavy: []\n"


def test_a_run_and_its_report_load_neither_matplotlib_nor_scipy(tmp_path):
    """Each takes longer to load than a short run needs. scipy is there for what it
    alone solves to the same bits: least firing times (uosat12), and Euler angles."""
    code = """
import sys
from pathlib import Path
from desat.report.table import Column, Table
from desat.runs.run import Options, execute
from desat.report.report import write_report
for name in sys.argv[2:]:
    place = Path(sys.argv[1]) / name
    run = execute(name, Options(stop=20.0), place)
    assert run.ok, run.manifest["message"]
    assert "<svg" in write_report(place, run).read_text()
print(sorted({"scipy", "matplotlib", "pyarrow"} & set(sys.modules)))
"""
    result = python(
        code, str(tmp_path), "integrated/mil-nadir", "plant/reference", NAME
    )
    assert result.returncode == 0, result.stderr
    assert "matplotlib" not in result.stdout
    result = python(
        code, str(tmp_path / "b"), "integrated/mil-nadir", "plant/reference"
    )
    assert result.stdout == "[]\n"


def test_list_by_family(desat):
    lines = desat("list", check=True).stdout.splitlines()
    for family in families():
        (line,) = (x for x in lines if x.startswith(f"{family} "))
        assert f" {len(scenarios(family))} " in line
        assert summary(family)
        assert summary(family) in line
    assert len(desat("list", "--all", check=True).stdout.splitlines()) == 1 + len(
        scenarios()
    )


def test_version(desat):
    assert desat("--version", check=True).stdout == f"desat {version('desat')}\n"


@pytest.mark.skipif(not shutil.which("bash"), reason="needs bash")
def test_completion_can_be_installed(tmp_path):
    """Into the shell that asks for it, as the files of one's home."""
    line = f"{sys.executable} -m desat.cli --install-completion; exit $?"
    result = subprocess.run(
        ["bash", "-c", line],
        capture_output=True,
        text=True,
        check=False,
        cwd=ROOT,
        env={**os.environ, "HOME": str(tmp_path)},
    )
    assert result.returncode == 0, result.stderr
    assert "_DESAT_COMPLETE" in (tmp_path / ".bash_completions/desat.sh").read_text()


def test_completion_offers_names(apart):
    words = {"COMP_WORDS": "desat run integrated/mil-n", "COMP_CWORD": "2"}
    result = apart(env={**os.environ, **words, "_DESAT_COMPLETE": "complete_bash"})
    assert "integrated/mil-nadir" in result.stdout.split()
    assert not any(n.startswith("uosat12") for n in result.stdout.split())


def test_shared_parameter(desat, tmp_path):
    """Every component that has the parameter gets it; a wrong name is a line."""
    cases = ("--stop", "2", "--json", "--no-baseline", "--out", str(tmp_path / "a"))
    result = desat(
        "run",
        "gyrostat/free",
        *cases,
        "--set",
        "shared.inertia_wheel=9e-3,9e-3,8e-3,0",
        check=True,
    )
    owners = {
        name: table["inertia_wheel"]["value"]
        for name, table in json.loads(result.stdout)["parameters"].items()
        if "inertia_wheel" in table
    }
    assert set(owners) >= {"spacecraft", "wheels"}
    assert all(value == [9e-3, 9e-3, 8e-3, 0.0] for value in owners.values())
    result = desat("run", "gyrostat/free", "--set", "shared.inertia_weel=2e-4")
    assert result.returncode == Exit.INPUT
    assert (
        "--set shared.inertia_weel=2e-4: no component has a parameter" in result.stderr
    )
    assert "did you mean inertia_wheel?" in result.stderr


def test_exit_codes_and_commands_are_told(desat):
    readme = (ROOT / "docs" / "reference.md").read_text(encoding="utf-8")
    table = readme.partition("## Commands")[2].partition("\n## ")[0]
    first = [
        line.split("|")[1] for line in table.splitlines() if line.startswith("| `")
    ]
    documented_commands = [
        name for cell in first for name in re.findall(r"`(\w+)`", cell)
    ]
    assert sorted(documented_commands) == sorted(get_command(cli.app_for([])).commands)
    outcome = " ".join(desat("--help", check=True).stdout.split())
    for code in Exit:
        assert f"| {int(code)} | {code.meaning} |" in readme
        assert f"{int(code)} {code.meaning}" in outcome


def test_a_component_that_fails_is_4(desat, tmp_path):
    """A torque that turns the craft too far within a step."""
    torque = "--set=spacecraft.tau_disturbance_body=1e30,0,0"
    result = desat("run", "nadir_day/day-dipole", torque, "--out", str(tmp_path / "a"))
    assert result.returncode == Exit.COMPONENT, result.stderr
    assert "spacecraft: in a step of 1 s body and nutation turn by" in result.stderr
    assert "\nfailed: " in result.stderr


def test_sigterm_ends_as_ctrl_c_does(tmp_path):
    folder = tmp_path / "run"
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "desat.cli",
            "run",
            NAME,
            "--stop",
            "2e7",
            "--no-baseline",
            "--record",
            "spacecraft.h_copy_wheel",
            "--out",
            str(folder),
        ],
        cwd=ROOT,
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    part = folder / "series.h5.part"
    deadline = time.monotonic() + 60
    while not (part.exists() and part.stat().st_size > 60000):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.1)
    process.terminate()
    out, err = process.communicate(timeout=60)
    assert process.returncode == Exit.TERMINATED
    assert "Traceback" not in out + err
    assert json.loads((folder / "manifest.json").read_text())["status"] == "interrupted"


@pytest.mark.skipif(
    not Path("/dev/full").exists(), reason="needs the device that is always full"
)
@pytest.mark.parametrize("arguments", [("list",), ("list", "--json")])
def test_no_space_is_6(arguments):
    with Path("/dev/full").open("w") as full:
        result = subprocess.run(
            [sys.executable, "-m", "desat.cli", *arguments],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
            cwd=ROOT,
        )
    assert result.returncode == Exit.SPACE
    assert result.stderr == "error: standard output: No space left on device\n"


def test_a_scenario_file_of_ones_own(desat, tmp_path):
    """From any folder, on a scenario of ours by its name or a file beside; messages
    name it."""
    (tmp_path / "mine.toml").write_text(
        'extends = "integrated/mil-nadir"\nstop = 20.0\n'
    )
    (tmp_path / "next.toml").write_text('extends = "mine"\nstop = 10.0\n')
    result = desat(
        "run", "next.toml", "--no-baseline", "--json", cwd=tmp_path, check=True
    )
    manifest = json.loads(result.stdout)
    assert (manifest["scenario"], manifest["end_time"]) == ("integrated/next", 10.0)
    for text, message in (
        (
            'extends = "integrated/mil-nadr"',
            "extends: no scenario integrated/mil-nadr; did you",
        ),
        ('extends = "mil-nadir"', "extends: no file mil-nadir.toml"),
        (
            'extends = "mine"\ntitel = "x"',
            "bad.toml:2: titel: unknown key; did you mean title?",
        ),
        (
            'extends = "mine"\nparameters.manger.x = 1',
            "parameters.manger.x: no component manger",
        ),
    ):
        (tmp_path / "bad.toml").write_text(text)
        result = desat("check", "bad.toml", cwd=tmp_path)
        # a problem of the system is one of the check; a file without one is wrong input
        is_problem = "no component" in message
        assert result.returncode == (Exit.UNMET if is_problem else Exit.INPUT)
        assert message in result.stderr
        assert len(result.stderr.splitlines()) == 1 + is_problem


def test_one_scenario_is_found_in_its_one_file():
    """Of a family of hundreds, a run reads the file that has it, what that extends, and
    those of the scenarios that it names."""
    code = """
import sys
from desat.files import io, scenario
read = []
real = io.toml
def counted(file):
    read.append(file.name)
    return real(file)
scenario.toml = counted
found = scenario.find(sys.argv[1])
assert found.name == sys.argv[1]
print(len(set(read)))
whole, _ = scenario.readable(found.family)
assert whole[found.name] == found
"""
    for name in (
        "uosat12/table3-ocdc-ilqr-1",
        "hausat2/detumbling-ours",
        "alsat1/firing-ours",
    ):
        result = python(code, name)
        assert result.returncode == 0, result.stderr
        assert int(result.stdout) <= 10, result.stdout


def test_python_m_beside_a_folder_of_our_name_says_so(tmp_path):
    (tmp_path / "desat").mkdir()
    result = subprocess.run(
        [sys.executable, "-m", "desat.cli", "run", NAME],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 2
    assert result.stderr == (
        f"error: {tmp_path / 'desat'}: a folder of this name hides the package from `python -m`; "
        "run `desat`, or python from another folder\n"
    )


def test_each_command_is_in_a_panel_and_has_an_example(desat):
    """Each example is a command line whose options there are."""
    top = get_command(cli.app_for([]))
    assert sorted(top.commands) == sorted(
        n for names in console.PANELS.values() for n in names
    )
    outcome = desat("--help", check=True).stdout
    assert [outcome.index(f"\n{panel}:") for panel in console.PANELS] == sorted(
        outcome.index(f"\n{panel}:") for panel in console.PANELS
    )

    def ends(path, command):
        for name, inner in getattr(command, "commands", {}).items():
            yield from ends([*path, name], inner)
        if not getattr(command, "commands", {}):
            yield path, command

    for path, command in ends([], top):
        assert command.epilog, path
        words = shlex.split(command.epilog.removeprefix("Example: "))
        group = path[:-1] if path[-1] in ("run", "page") and len(path) > 1 else path
        assert words[: len(group) + 1] == ["desat", *group], command.epilog
        options = {x for p in command.params for x in (*p.opts, *p.secondary_opts)}
        assert {w for w in words if w.startswith("-")} <= options, command.epilog


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (
            ("run", NAME, "--duration", "5"),
            "no option --duration; did you mean --stop?",
        ),
        (("run", NAME, "--dt", "1"), "no option --dt; did you mean --step?"),
        (
            ("new", "craft", "x", "--alitude", "4km"),
            "--alitude; did you mean --altitude?",
        ),
        (("rum", NAME), "no command rum; did you mean run?"),
        (("keys",), "no command keys; desat help keys prints them"),
        (
            ("run", NAME, "--set", "spacecraft.h_start_body=1Nm,0,0"),
            "did you mean N.m?",
        ),
        (
            ("run", NAME, "--stop", "0orbits"),
            "--stop 0orbits: unit orbits is not known",
        ),
        (("help", "own-blok"), "no such topic; did you mean own-block?"),
    ],
)
def test_what_was_meant_is_said(desat, arguments, text):
    command = desat(*arguments)
    assert command.returncode == Exit.INPUT
    assert text in command.stderr, command.stderr
    assert len(command.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    ("unit", "text", "value"),
    [
        ("N.m.s", "30mNms", 0.03),
        ("N.m", "0.73 mNm", 7.3e-4),
        ("kg.m2", "2 kgm2", 2.0),
        ("A.m2", "0.2Am2", 0.2),
        ("N.m.s", "3 Nm.s", 3.0),
    ],
)
def test_units_are_read_without_their_dots(unit, text, value):
    assert Quantity("--x", unit)(text) == pytest.approx(value, rel=1e-15)


def test_a_stop_time_in_orbits_is_that_of_the_craft(desat, tmp_path):
    desat("new", "craft", "mine", "--altitude", "400km", cwd=tmp_path, check=True)
    answer = json.loads(
        desat(
            "run", "mine", "--stop", "0.1orbit", "--json", cwd=tmp_path, check=True
        ).stdout
    )
    period = 2.0 * pi * sqrt(6778137.0**3 / MU)
    assert answer["end_time"] == pytest.approx(0.1 * period, rel=2e-3)
    assert draws(str(tmp_path / "mine"), 1, 1, Options(stop="0.01 orbits"), 1).rows


def test_a_crafts_folder_is_known_to_all_that_take_a_target(desat, tmp_path):
    desat("new", "craft", "mine", cwd=tmp_path, check=True)
    scenarios = json.loads(
        desat("list", "mine", "--json", cwd=tmp_path, check=True).stdout
    )
    assert [row["name"] for row in scenarios] == [
        "mine",
        "mine/detumbling.toml",
        "mine/rollout.toml",
        "mine/worst.toml",
    ]
    assert "not of a run" in desat("export", "mine", cwd=tmp_path).stderr
    assert (
        "parameters.manager.gain"
        in desat("show", "mine", cwd=tmp_path, check=True).stdout
    )
    desat("run", "mine/worst.toml", "--stop", "10", cwd=tmp_path)
    assert (tmp_path / "runs" / "mine-worst" / "report.html").is_file()


def test_a_run_prints_five_numbers_and_all_on_request(desat, tmp_path):
    some = desat(
        "run", NAME, "--stop", "60", "--no-baseline", cwd=tmp_path, check=True
    ).stdout
    full = desat(
        "run", NAME, "--stop", "60", "--no-baseline", "--all", cwd=tmp_path, check=True
    ).stdout
    rest = int(re.search(r"(\d+) more numbers", some)[1])
    assert len(full.splitlines()) - len(some.splitlines()) == rest - 1
    assert "more numbers" not in full


def test_abbreviations_are_spelt_out_where_they_head_a_column(desat, tmp_path):
    desat("run", NAME, "--out", "run", cwd=tmp_path, check=True)
    page = (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    for text in (
        "OCDC: optimal combined desaturation controller",
        "DCT: dumping controller",
    ):
        assert text in page
    assert "CRCP:" not in page, "it is not in this report"


def test_the_cost_of_a_process_of_its_own_is_said(desat, tmp_path):
    cases = ("run", NAME, "--stop", "20", "--no-baseline")
    outcome = desat(*cases, "--isolate", "all", cwd=tmp_path, check=True).stderr
    assert re.search(
        r"note: .*manager.*: in processes of their own, which costs about [\d.]+ us of",
        outcome,
    )
    assert "costs about" not in desat(*cases, cwd=tmp_path, check=True).stderr


# --- help and what all commands take --------------------------------------------------


@pytest.mark.parametrize("words", [["run"], ["campaign"], ["campaign", "run"]])
def test_help_has_each_option_once_in_a_section_the_usual_ones_first(desat, words):
    text = desat(*words, "--help", check=True).stdout
    command = get_command(cli.app_for(words))
    for word in [*words, *(["run"] if words == ["campaign"] else [])]:
        command = command.commands[word]
    places = {}
    for param in command.params:
        if param.param_type_name != "option":
            continue
        option = param.opts[0]
        assert any(option in names for names in console.SECTIONS.values()), (
            f"{option}: in no section of SECTIONS, cli/console.py"
        )
        entries = re.findall(rf"^  {re.escape(option)}[ ,]", text, re.MULTILINE)
        assert len(entries) == 1, option
        places[option] = re.search(rf"^  {re.escape(option)}[ ,]", text, re.M).start()
    heads = [text.index(f"\n{s}:") for s in console.SECTIONS if f"\n{s}:" in text]
    assert heads == sorted(heads)
    usual = [o for o in console.SECTIONS["Options"] if o in places]
    assert max(places[o] for o in usual) < min(
        x for o, x in places.items() if o not in usual
    )


def test_help_searches_its_topics(desat):
    command = desat("help", "predictive", check=True)
    assert command.stdout.splitlines()[1].startswith("blocks manager_predictive")
    rows = desat("help", "dead", "coil", check=True).stdout
    assert "manager_receding_horizon" in rows
    assert desat("help", "own-block", check=True).stdout.startswith("# ")
    page = desat("help", "python", check=True).stdout
    assert "- desat.run(target: str | PathLike[str]," in page.replace("\n", "")
    assert ".. " not in page
    refusal = desat("help", "xyzzy")
    assert refusal.returncode == 2
    assert "no such topic" in refusal.stderr


@pytest.mark.parametrize("place", ["before", "after", "short"])
def test_quiet_prints_errors_and_what_json_asks_for(desat, tmp_path, place):
    words = {
        "before": ["--quiet", "run", NAME],
        "after": ["run", NAME, "--quiet"],
        "short": ["run", NAME, "-q"],
    }[place]
    silent = desat(*words, "--stop", "20", "--out", str(tmp_path / "a"), check=True)
    assert silent.stdout == ""
    as_json = desat(*words, "--stop", "20", "--out", str(tmp_path / "b"), "--json")
    assert json.loads(as_json.stdout)["scenario"] == NAME


def test_quiet_hides_no_error_and_what_it_hides_is_there_otherwise(desat, tmp_path):
    assert "no scenario nix" in desat("run", "nix", "--quiet").stderr
    loud = desat("run", NAME, "--stop", "20", "--out", str(tmp_path / "c"), check=True)
    assert "steps" in loud.stdout


def test_the_version_by_its_short_name(desat):
    assert desat("-V", check=True).stdout == desat("--version", check=True).stdout


@pytest.mark.parametrize(
    ("line", "option"),
    [
        ("run c --stop 5 --stop 6", "--stop"),
        ("new craft d --mass 1kg --mass 2kg", "--mass"),
        ("new craft d --rods 0.1 --altitude 400km --rods 0.2", "--rods"),
        ("new craft d --epoch 2027-01-01 --epoch=2028-01-01", "--epoch"),
        ("campaign c -n 2 -n 3", "-n"),
        ("campaign c -n 2 --seed 1 --seed 2", "--seed"),
        ("size c --loop --no-loop", "--loop/--no-loop"),
        ("export run c --out a --out b", "--out"),
        ("check c --json --json", "--json"),
    ],
)
def test_an_option_given_twice_is_refused(desat, line, option):
    command = desat(*line.split())
    assert command.returncode == Exit.INPUT
    assert command.stderr == f"error: {option}: it is given twice; it takes one value\n"


def test_every_option_of_the_command_tree_takes_one_value_or_says_so():
    """No command of the tree is of another class."""
    from desat.cli.console import OnceOnly

    def leaves(command):
        subcommands = getattr(command, "commands", None)
        if subcommands is None:
            yield command
        for each in (subcommands or {}).values():
            yield from leaves(each)

    commands = list(leaves(get_command(cli.app_for([]))))
    assert len(commands) > 25
    assert all(isinstance(command, OnceOnly) for command in commands)


@pytest.mark.parametrize(
    ("options", "name"),
    [
        (("--set", "manager.gain=1", "--set", "manager.gain=2"), "manager.gain"),
        (("--source", "gyro=a.fmu", "--source", "gyro=b.fmu"), "gyro"),
        (("--output-class", "a.b=state", "--output-class", "a.b=interval"), "a.b"),
    ],
)
def test_a_name_given_twice_is_refused(desat, options, name):
    command = desat("run", "nadir_day/day-dipole", *options)
    assert command.returncode == Exit.INPUT
    assert (
        f"{options[2]} {options[3]}: {name} has {options[0]} {options[1]}"
        in command.stderr
    )


@pytest.mark.parametrize(
    "line",
    [
        "new craft d --pointing foo",
        "new craft d --pointing nadri",
        "new craft d --orbit foo",
        "new craft d --rods foo",
        "new craft d --thrusters '4 foo'",
        "new craft d --wheels '4 foo 3Nms'",
        "new craft d --wheels '4 pyramid foo'",
        "faults nadir_day/day-dipole --fault foo",
        "compare nadir_day/day-dipole --laws all --by foo",
    ],
)
def test_a_list_of_choices_stands_once(desat, line):
    command = desat(*shlex.split(line))
    assert command.returncode == Exit.INPUT
    assert command.stderr.count("there is ") == 1
