"""A whole family of one's own: a law, a block, a craft, a scenario and a page, each a
new file.

In a copy of the repository; no existing file is touched, and the numbers are analytic.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
from math import sqrt

import pytest

from tests.conftest import ROOT

LAW = '''"""Spin-down of wheels: their momentum decays at a rate of one's choice."""

from __future__ import annotations

from ..contract.block import Vec4


def torque(h: Vec4, rate: float) -> Vec4:
    """-rate h (N m), of the wheels' momentum h (N m s) and a rate (1/s)."""
    a, b, c, d = h
    return (-rate * a, -rate * b, -rate * c, -rate * d)
'''
BLOCK = '''from __future__ import annotations

from ..contract.block import Output, Parameter
from ..contract.roles import Manager
from ..laws import spin_down
from ..maths.vector import ZERO


class ManagerSpinDown(Manager):
    """Spin-down of the wheels into the body

    After `wait`, at each sample, with h the wheels' momentum:

        tau_cmd_wheel = -rate h

    Source: none; an example.
    """

    rate: float = Parameter("1/s", "rate at which momentum decays", start=0.05, min=0.0)
    wait: float = Parameter("s", "nothing is done before", min=0.0)
    mode: int = Output("1", "what the manager does", interval=True, choices=("waiting", "braking"))

    def start(self) -> None:
        super().start()
        self.tau_cmd_wheel = (0.0, 0.0, 0.0, 0.0)
        self.m_cmd_body = self.tau_cmd_thruster_body = ZERO
        self.mode = 0

    def advance(self, t: float, dt: float) -> None:
        if self.due(t) and t >= self.wait:
            self.mode = 1
            self.tau_cmd_wheel = spin_down.torque(self.h_wheel, self.rate)
'''
CRAFT = """title = "A body with three wheels, and nothing else"

[components]
spacecraft = "spacecraft_rigid"
wheels = "wheels"
manager = "manager_spin_down"
"""
SCENARIO = """title = "Three wheels spin down"
description = "Wheels give their momentum to a sphere."
step = 1.0
stop = 60.0

[shared]
inertia_wheel = [0.008, 0.008, 0.008, 0.0]

[parameters.spacecraft]
inertia = [[10.0, 0, 0], [0, 10.0, 0], [0, 0, 10.0]]
gravity_gradient = false

[parameters.wheels]
h_start_wheel = [0.1, -0.05, 0.02, 0.0]

[parameters.manager]
rate = 0.05
wait = 10.0

[numbers.momentum_end]
title = "Momentum of the wheels at the end"
signal = "wheels.h_wheel"
measure = "norm_last"
unit = "N.m.s"

[numbers.rate_end]
title = "Rate of the body at the end"
signal = "spacecraft.omega_bi_body"
measure = "norm_last"
unit = "rad/s"

[plots.momentum]
title = "Wheel momentum"
signals = ["wheels.h_wheel"]
components = ["x", "y", "z"]
unit = "mN.m.s"
"""
PAGE = """# Spin-down

From {{ "%.6f"|format(value("wheels", "momentum_end")) }} N m s
left the body turns at {{ value("wheels", "rate_end")|fixed(6) }} rad/s. {# "manager.mode" #}

| rate 1/s | left N m s |
|---|---|
{% for rate, left in sweep("wheels", "manager.rate", [0.1], "momentum_end") %}
{{ row(rate, left|fixed(6)) }}
{% endfor %}

{{ plot("momentum", "wheels", "momentum", "Figure 1") }}
"""
FILES = {
    "components/laws/spin_down.py": LAW,
    "components/blocks/manager_spin_down.py": BLOCK,
    "ssp/spin_down/craft.toml": CRAFT,
    "ssp/spin_down/scenarios/wheels.toml": SCENARIO,
    "ssp/spin_down/page.md": PAGE,
}


@pytest.fixture(scope="module")
def repository(tmp_path_factory):
    """A copy of the repository with what is built, and `names`, where `desat` is that
    copy."""
    copy = tmp_path_factory.mktemp("family") / "copy"
    tracked_files = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    ).stdout.splitlines()
    built_fmus = [f"fmus/dist/{name}.fmu" for name in ("spacecraft_rigid", "wheels")]
    for name in (*tracked_files, *built_fmus):
        if (ROOT / name).is_file() and not name.startswith("docs/papers/"):
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, copy / name)
    package = copy.parent / "names" / "desat"
    package.mkdir(parents=True)
    for part in (
        *(copy / "orchestrator").iterdir(),
        copy / "components",
        copy / "fmus",
    ):
        (package / part.name).symlink_to(part)
    return copy


@pytest.mark.study
def test_a_family_touches_no_existing_file(repository):
    def hashes():
        files = (p for p in repository.rglob("*") if p.is_file() and p.suffix != ".pyc")
        return {
            p.relative_to(repository).as_posix(): hashlib.sha256(
                p.read_bytes()
            ).hexdigest()
            for p in files
        }

    def do(*command: str) -> str:
        environment = {
            **os.environ,
            "PYTHONPATH": f"{repository.parent / 'names'}:{repository}",
        }
        process = subprocess.run(
            [sys.executable, "-m", *command],
            cwd=repository.parent,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
            timeout=100,
        )
        assert process.returncode == 0, process.stdout + process.stderr
        return process.stdout

    before = hashes()
    for name, text in FILES.items():
        (repository / name).parent.mkdir(parents=True, exist_ok=True)
        (repository / name).write_text(text, encoding="utf-8")
    do("desat.fmus.build", "manager_spin_down")
    index = json.loads(
        (repository / "fmus/dist/index.json").read_text(encoding="utf-8")
    )
    assert [e.get("why") for e in index] == [None] * 3, "native, FMI 3.0, Python"
    do("desat.cli", "pack", "--ssd", "spin_down")
    do("desat.cli", "check", "spin_down/wheels")
    assert "Three wheels spin down" in do("desat.cli", "list", "spin_down")
    run = json.loads(
        do("desat.cli", "run", "spin_down/wheels", "--out", "run", "--json")
    )
    page = do("benchmarks.pages", "spin_down")

    # h decays by 1 - rate step at each of 50 steps; the body turns about h, which stays
    # where it is
    start, remaining = sqrt(0.1**2 + 0.05**2 + 0.02**2), 0.95**50
    numbers = {name: n["value"] for name, n in run["numbers"].items()}
    assert numbers["momentum_end"] == pytest.approx(start * remaining, rel=1e-12)
    turning = start * (1.0 - remaining) / (10.0 - 0.008)
    assert numbers["rate_end"] == pytest.approx(turning, rel=1e-9)
    assert numbers["momentum_residual"] < 1e-15
    assert run["choices"]["manager.mode"] == ["waiting", "braking"]

    assert page.strip().endswith("copy/docs/papers/spin_down/README.md")
    text = (repository / "docs/papers/spin_down/README.md").read_text(encoding="utf-8")
    assert (
        f"From {start * remaining:.6f} N m s left the body turns at {turning:.6f} rad/s.\n"
        in text
    )
    assert f"\n| 0.1 | {start * 0.9**50:.6f} |\n" in text
    assert "![Figure 1: wheel momentum](momentum.svg)" in text

    after = hashes()
    assert {name: after.get(name) for name in before} == before
    assert after.keys() - before.keys() == {
        *FILES,
        "ssp/spin_down/SystemStructure.ssd",
        "fmus/dist/manager_spin_down.fmu",
        "fmus/dist/native/manager_spin_down.fmu",
        "fmus/dist/fmi3/manager_spin_down.fmu",
        "fmus/dist/index.json",
        "docs/papers/spin_down/README.md",
        "docs/papers/spin_down/momentum.svg",
    }
