"""A block file of the user's own: FMUs of it, its run, and what is refused."""

from __future__ import annotations

import importlib
import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu

from desat.files import own
from desat.fmus import own as block_file
from desat.fmus.registry import block_class, names
from desat.runs.run import Options, execute
from desat.system.errors import DesatError
from desat.system.interface import role_classes
from tests.conftest import ROOT

LAW = '''"""A law of one's own."""

from __future__ import annotations

from desat.components.bases.dumping import TorquerDumping
from desat.components.contract.block import Parameter, Vec3
from desat.components.laws import cross_product
from desat.components.maths.vector import norm


def dipole(h: Vec3, b: Vec3, gain: float) -> Vec3:
    return cross_product.normalised(h, b, gain)


class MyLaw(TorquerDumping):
    """A law of one's own

    M = gain (h x B) / |B|^2.
    """

    gain: float = Parameter("1/s", "gain", start=5e-3, min=0.0)

    def dipole(self, elapsed_time: float, h: Vec3) -> Vec3 | None:
        if norm(h) <= 0.0:
            return None
        return dipole(h, self.b_body, self.gain)
'''
TARGET = "nadir_day/day-dipole"
OURS = "manager_cross_product"


@pytest.fixture(scope="module")
def law(tmp_path_factory, quick_builds) -> Path:
    file = tmp_path_factory.mktemp("theirs") / "my_law.py"
    file.write_text(LAW)
    return file


def test_a_law_of_ones_own_runs_as_ours_does_bit_by_bit(law, tmp_path, monkeypatch):
    """Compiled as for a user."""
    monkeypatch.delenv("CC")
    monkeypatch.setenv("DESAT_CACHE", str(tmp_path))

    def series(source: str, **options):
        ran = execute(
            TARGET, Options(sources=[f"manager={source}"], stop=300.0, **options), None
        )
        assert ran.ok, ran.manifest.message
        return ran

    ours = series(OURS)
    for kind in ("native", "python"):
        ran = series(str(law), fmus=kind)
        assert ran.manifest.fmus["manager"]["source"] == "resources/my_law.fmu"
        for name in ("manager.m_cmd_body", "wheels.h_wheel", "spacecraft.q_bi"):
            a, b = ours.results.values(name), ran.results.values(name)
            assert np.abs(a).max() > 0.0
            np.testing.assert_array_equal(a, b, strict=True)


def test_it_is_built_once_and_kept_by_its_contents(law, tmp_path, monkeypatch):
    first = own.build(law)
    monkeypatch.setattr(own, "_build", lambda *_: pytest.fail("it is built again"))
    copied = tmp_path / law.name
    copied.write_text(LAW)
    assert own.build(copied) == first
    copied.write_text(LAW.replace("5e-3", "4e-3"))
    with pytest.raises(pytest.fail.Exception):
        own.build(copied)


def test_the_command_builds_both_fmus_which_any_tool_can_run(law, desat, tmp_path):
    done = desat("build", str(law), "--out", str(tmp_path), "--json")
    assert done.returncode == 0, done.stderr
    written = json.loads(done.stdout)
    assert written == {
        "python": str(tmp_path / "my_law.fmu"),
        "native": str(tmp_path / "native" / "my_law.fmu"),
    }
    for fmu in written.values():
        assert validate_fmu(fmu) == []
    names = [
        v.name for v in fmpy.read_model_description(written["native"]).modelVariables
    ]
    result = fmpy.simulate_fmu(
        written["native"],
        stop_time=1.0,
        step_size=1.0,
        output=["m_cmd_body[1]"],
        start_values={"b_body[2]": 2e-5, "h_wheel[1]": 0.01, "enable": True},
    )
    assert "gain" in names
    assert np.isfinite(result["m_cmd_body[1]"]).all()


def test_what_does_not_translate_runs_as_python_and_says_why(
    quick_builds, tmp_path, desat
):
    file = tmp_path / "by_dict.py"
    file.write_text(
        LAW.replace(
            "    return cross_product",
            "    known = {1: gain}\n    return cross_product",
        ).replace("(h, b, gain)\n\n", "(h, b, known[1])\n\n")
    )
    done = desat(
        "run",
        TARGET,
        "--source",
        f"manager={file}",
        "--stop",
        "10",
        "--out",
        str(tmp_path / "run"),
    )
    assert done.returncode in (0, 1), done.stderr
    assert "by_dict.py runs as Python: by_dict.py:12: a dict" in done.stderr
    built = own.build(file)
    assert built.native is None
    assert built.python.is_file()


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("a-b.py", "", "", "a-b.py: its name becomes one of C: call it a_b.py"),
        (f"{OURS}.py", "", "", "a block of ours has this name"),
        ("x.py", "class MyLaw", "class MyLaw(", "x.py:15: "),
        (
            "x.py",
            "from desat.components.maths",
            "from ..maths",
            "x.py:8: a relative import",
        ),
        (
            "x.py",
            "from desat.components.maths.vector import norm",
            "import beside",
            "x.py:8: import of beside, which lies beside it",
        ),
        (
            "x.py",
            "from desat.components.maths.vector import norm",
            "import no_such_thing",
            "x.py:8: import of no_such_thing: there is no such module",
        ),
        (
            "x.py",
            "from desat.components.maths.vector import norm",
            "import desat.runs",
            "x.py:8: import of desat.runs: a block uses desat.components alone",
        ),
        (
            "x.py",
            "from desat.components.laws import",
            "from desat.components.laws import \\\n   ",
            "",
        ),
        ("x.py", "(TorquerDumping)", "", "x.py: it must hold one class that derives"),
        (
            "x.py",
            "    def dipole(self",
            "    def other(self",
            "x.py:15: MyLaw lacks what its role leaves to it: write `def dipole`",
        ),
        (
            "x.py",
            'Parameter("1/s"',
            'Parameter("1/parsec"',
            "MyLaw.gain: unit '1/parsec'",
        ),
        (
            "x.py",
            "from __future__ import annotations",
            "",
            "annotations are read as text",
        ),
    ],
)
def test_what_is_refused_names_file_line_and_what_to_write(
    tmp_path, name, old, new, message
):
    file = tmp_path / name
    (tmp_path / "beside.py").write_text("norm = len\n")
    file.write_text(LAW.replace(old, new) if old else LAW)
    if not message:  # an import over two lines is taken
        assert block_file.block_class(str(file)).__name__ == "MyLaw"
        return
    with pytest.raises(DesatError) as caught:
        own.build(file)
    assert message in str(caught.value)
    assert str(caught.value).startswith(name)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there_is_said(desat, tmp_path):
    done = desat("build", str(tmp_path / "none.py"))
    assert done.returncode == 2
    assert "none.py: No such file" in done.stderr
    done = desat("run", TARGET, "--source", f"manager={tmp_path / 'none.py'}")
    assert done.returncode == 2
    assert "none.py: No such file" in done.stderr


# --- desat new law --------------------------------------------------------------------


@pytest.mark.slow
def test_a_new_law_flies_and_its_own_test_holds(desat, quick_builds, tmp_path):
    """It is native, has the bits of our cross product at the same gain, and its test
    can fail."""
    result = desat("new", "law", "my_own", cwd=tmp_path, check=True)
    assert result.stdout.splitlines()[0] == "my_own.py, test_my_own.py"
    file = tmp_path / "my_own.py"
    built = own.build(file)
    assert built.native is not None, built.reason
    runs = [
        execute(TARGET, Options(stop=600.0, sources=[f"manager={x}"]))
        for x in (file, OURS)
    ]
    first, second = (run.results.values("torquers.m_mean_body") for run in runs)
    assert abs(first).max() > 0.0
    np.testing.assert_allclose(first, second, rtol=1e-9, atol=1e-15)

    def tested(*more: str) -> int:
        inputs = [
            sys.executable,
            "-m",
            "pytest",
            "-q",
            "-p",
            "no:cacheprovider",
            "test_my_own.py",
        ]
        return subprocess.run(
            [*inputs, *more], cwd=tmp_path, capture_output=True, timeout=60, check=False
        ).returncode

    assert tested() == 0
    file.write_text(
        file.read_text().replace("cross(h, self.b_body)", "cross(self.b_body, h)")
    )
    assert tested("-k", "across") == 1


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("manager_b_dot", "a block of ours has this name"),
        ("my-law", "call it my_law.py"),
        ("2nd", "call it block_2nd.py"),
        ("there", "there.py: it exists; --force writes over it"),
    ],
)
def test_a_new_law_that_cannot_be(desat, tmp_path, name, text):
    (tmp_path / "there.py").write_text("mine")
    refused = desat("new", "law", name, cwd=tmp_path)
    assert refused.returncode == 2
    assert text in refused.stderr
    assert [x.name for x in tmp_path.iterdir()] == ["there.py"]
    assert (tmp_path / "there.py").read_text() == "mine"
    assert desat("new", "law", "there.py", "--force", cwd=tmp_path).returncode == 0
    assert (tmp_path / "test_there.py").is_file()


@pytest.mark.parametrize(
    "role", sorted(r for r, c in role_classes().items() if c.typical_block)
)
def test_a_new_block_is_what_it_begins_with(desat, tmp_path, monkeypatch, role):
    """It has the role's interface, its own test holds, and that fails once it gives
    another."""
    desat("new", "block", role, cwd=tmp_path, check=True)
    file = tmp_path / f"my_{role}.py"
    block = block_file.block_class(str(file))
    assert block.role == role
    monkeypatch.syspath_prepend(str(tmp_path))
    test = vars(importlib.import_module(f"test_my_{role}"))
    (check,) = [f for name, f in test.items() if name.startswith("test_")]
    check()
    output = next(
        v for v in block.variables if v.causality == "output" and v.name != "fault"
    )
    with monkeypatch.context() as patch:
        patch.setattr(
            test[block.__name__],
            "output",
            lambda self, t: setattr(self, output.name, "another"),
        )
        patch.setattr(test[block.__name__], "advance", lambda self, t, dt: None)
        with pytest.raises(AssertionError):
            check()


def test_a_new_sensor_flies_native_and_says_what_cannot_be(
    desat, quick_builds, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    outcome = desat(
        "new", "block", "rate_gyro", "mine", "--json", cwd=tmp_path, check=True
    )
    assert json.loads(outcome.stdout)["files"] == ["mine.py", "test_mine.py"]
    runs = [
        execute(TARGET, Options(stop=60.0, sources=sources), None)
        for sources in ([], ["gyro=mine.py"])
    ]
    ours, mine = (run.results.values("spacecraft.q_bi") for run in runs)
    np.testing.assert_array_equal(ours, mine, strict=True)
    assert not any("runs as Python" in line for line in runs[1].manifest.warnings)
    wrong = desat("new", "block", "gyroo", cwd=tmp_path)
    assert "gyroo: no role and no block of ours; did you mean gyro?" in wrong.stderr
    assert desat("new", "block", "rate_gyro", "mine", cwd=tmp_path).returncode == 2
    desat("new", "block", "manager", "law", cwd=tmp_path, check=True)
    assert "TorquerDumping" in (tmp_path / "law.py").read_text(), (
        "of a manager it is a law"
    )


# --- outputs that nobody assigns ------------------------------------------------------

MAGNETOMETER = '''"""A magnetometer of one's own."""

from __future__ import annotations

from desat.components.contract.block import Vec3
from desat.components.contract.roles import Magnetometer
from desat.components.maths.attitude import rotate


class Mine(Magnetometer):
    """A magnetometer of one's own"""

    def start(self) -> None:
        super().start()
        self.valid = True
        BEGIN

    def advance(self, t: float, dt: float) -> None:
        self.read(rotate(self.q_bi, self.b_eci))

    def read(self, b: Vec3) -> None:
        self.b_bdy = b
'''


@pytest.mark.parametrize("begin", ["pass", "self.b_body = (0.0, 0.0, 0.0)"])
def test_an_output_that_is_never_assigned_is_refused(tmp_path, desat, begin):
    """It flew with zeros, or with what `start` gave."""
    file = tmp_path / "my_magnetometer.py"
    file.write_text(MAGNETOMETER.replace("BEGIN", begin))
    inputs = TARGET, "--source", f"magnetometer={file}"
    for command in (("build", str(file)), ("run", *inputs), ("check", *inputs)):
        done = desat(*command, cwd=tmp_path)
        assert done.returncode == 2, (command, done.stderr)
        text = " ".join(done.stderr.split())
        assert (
            "my_magnetometer.py:10: Mine.b_body: advance does not assign this output"
            in text
        )
        assert "it assigns self.b_bdy, which is not declared" in text
    file.write_text(MAGNETOMETER.replace("BEGIN", begin).replace("b_bdy", "b_body"))
    assert issubclass(block_file.block_class(str(file)), object)


def test_a_block_that_assigns_by_name_is_not_refused(tmp_path):
    file = tmp_path / "my_magnetometer.py"
    text = MAGNETOMETER.replace("BEGIN", "pass").replace(
        "self.b_bdy = b", 'setattr(self, "b_body", b)'
    )
    file.write_text(text)
    block_file.block_class(str(file))


def test_every_block_of_ours_assigns_its_outputs():
    found = {name: block_file.find_unassigned(block_class(name)) for name in names()}
    assert {name: lines for name, lines in found.items() if lines} == {}


BODY = '''"""A spacecraft of one's own."""

from __future__ import annotations

from desat.components.blocks.spacecraft_rigid import SpacecraftRigid
{imports}

class MyBody(SpacecraftRigid):
    """A spacecraft of one's own

    As ours.
    """
{declared}
'''
IMPORTS = """from desat.components.contract.block import Output, Vec3
from desat.components.maths.vector import dot, mat_vec
from desat.components.physics.gyrostat import carrier_inertia

"""
DECLARED = """
    momentum_eci: Vec3 = Output("N.m.s", "total momentum, eci")
    energy: float = Output("J", "energy of the body without the wheels'")

    def output(self, t: float) -> None:
        super().output(t)
        carrier = carrier_inertia(self.inertia, self.axes_wheel, self.inertia_wheel)
        self.momentum_eci = self._momentum
        self.energy = 0.5 * dot(self.omega_bi_body, mat_vec(carrier, self.omega_bi_body))
"""


@pytest.mark.parametrize("declares", [False, True])
def test_a_spacecraft_of_ones_own_is_checked_by_what_it_declares(
    tmp_path, quick_builds, declares
):
    file = tmp_path / "my_body.py"
    imports, declared = (IMPORTS, DECLARED) if declares else ("", "")
    file.write_text(BODY.format(imports=imports, declared=declared))
    options = Options(sources=[f"spacecraft={file}"], stop=120.0, substeps=1)
    run = execute(TARGET, options)
    numbers = run.manifest.numbers
    assert ("momentum_residual" in numbers) == declares
    assert ("energy_mismatch" in numbers) == declares
    assert "hidden_work" not in numbers
    assert not any("residual" in line for line in run.manifest.not_met)
    if declares:
        assert numbers["momentum_residual"].value < 1e-12
        assert numbers["energy_mismatch"].value < 1e-2
    else:
        messages = "\n".join(run.manifest.warnings)
        assert "not checked: momentum_residual" in messages
        assert "declares no total momentum (momentum_eci)" in messages


EVERY_STEP = """
from __future__ import annotations

from desat.components.contract.roles import {base}


class Mine({base}):
    \"\"\"Mine\"\"\"

    def compute(self, t: float, dt: float) -> None:
        self.{command} = (0.0, 0.0, 1e-6)
{more}
"""


MORE = """
        self.tau_cmd_wheel = (0.0, 0.0, 0.0, 0.0)
        self.tau_cmd_thruster_body = (0.0, 0.0, 0.0)
        self.mode = 1
"""


# --- the page -------------------------------------------------------------------------


def page_files() -> dict[str, str]:
    """The block files that docs/own-block.md shows, by name."""
    text = (ROOT / "docs/own-block.md").read_text(encoding="utf-8")
    found = re.findall(r'```python\n("""(\w+\.py)""".*?)```', text, re.DOTALL)
    return {name: code for code, name in found}


@pytest.mark.parametrize(
    ("name", "target", "sets"),
    [
        ("my_law.py", "integrated/mil-nadir", []),
        (
            "bdot_band.py",
            "integrated/velocity-b-dot",
            ["manager.sample_time=2", "manager.threshold=3e-7"],
        ),
    ],
)
def test_a_block_of_the_page_flies_native(quick_builds, tmp_path, name, target, sets):
    file = tmp_path / name
    file.write_text(page_files()[name])
    assert own.build(file).reason == ""
    options = Options(sources=[f"manager={file}"], sets=sets, stop=100.0)
    run = execute(target, options)
    assert run.manifest.completed
    assert run.results.values("manager.m_cmd_body").any()


def test_the_dead_band_of_the_page_is_one(quick_builds, tmp_path):
    """It samples every 2 s: its command changes nowhere else, and is 0 below the band."""
    file = tmp_path / "bdot_band.py"
    file.write_text(page_files()[file.name])
    sets = ["manager.sample_time=2", "manager.threshold=5e-6", "manager.gain=1e-5"]
    options = Options(sources=[f"manager={file}"], sets=sets, stop=200.0)
    run = execute("integrated/velocity-b-dot", options)
    times = run.results.times()[:-1]
    command = run.results.values("manager.m_cmd_body")
    changes = np.flatnonzero(np.any(command[1:] != command[:-1], axis=1)) + 1
    assert len(changes) > 10
    assert np.allclose(times[changes] % 2.0, 0.0)
    field = run.results.values("magnetometer.b_body")
    samples = np.flatnonzero(np.isclose(times % 2.0, 0.0))[1:]
    before = np.linalg.norm(field[samples[1:]] - field[samples[:-1]], axis=1) / 2.0
    is_off = ~command[samples[1:]].any(axis=1)
    assert is_off.any()
    assert not is_off.all()
    assert before[is_off].max() < 5.01e-6
    assert before[~is_off].min() > 4.99e-6


@pytest.mark.parametrize("base", ["Manager", "Controller"])
def test_a_sample_time_without_effect_is_refused(quick_builds, tmp_path, base):
    """At 0, which is true, the block flies."""
    file = tmp_path / "mine.py"
    command, more = {
        "Manager": ("m_cmd_body", MORE),
        "Controller": ("tau_ctrl_body", ""),
    }[base]
    file.write_text(EVERY_STEP.format(base=base, command=command, more=more))
    source = f"{base.lower()}={file}"
    sets = [f"{base.lower()}.sample_time=0"]
    options = Options(sources=[source], sets=sets, stop=10.0)
    assert execute(TARGET, options).manifest.completed
    reason = "no effect: compute does not call self.due(t), so it runs at every step"
    for value in ([], [f"{base.lower()}.sample_time=2"]):
        with pytest.raises(
            DesatError, match=re.escape(f"s: allowed is 0 alone: {reason}")
        ):
            execute(TARGET, replace(options, sets=value))


def test_help_says_what_a_block_of_a_role_writes(desat):
    for role, text in (
        ("manager", "compute(t, dt): Decide and assign"),
        ("magnetometer", "due(t), which is there"),
        ("wheels", "output(t): Set the state outputs"),
    ):
        printed = desat("help", "blocks", role, check=True).stdout
        assert text in " ".join(printed.split())


def test_a_bug_of_a_block_is_told_with_its_line(quick_builds, tmp_path):
    file = tmp_path / "mine.py"
    text = MAGNETOMETER.replace("BEGIN", "pass").replace(
        "b_bdy = b", "b_body = b[0][1]"
    )
    file.write_text(text)
    line = text[: text.index("b[0][1]")].count("\n") + 1
    options = Options(
        sources=[f"magnetometer={file}"],
        sets=["magnetometer.sample_time=0"],
        stop=10.0,
    )
    run = execute(TARGET, options)
    assert not run.manifest.completed
    text = f"mine.py:{line}: TypeError: 'float' object is not"
    assert any(text in warning for warning in run.manifest.warnings)
