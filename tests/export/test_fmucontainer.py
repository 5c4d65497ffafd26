"""Packed FMUs that fmucontainer joins into one give the series of a run."""

from __future__ import annotations

import importlib.util
import json
import zipfile

import fmpy
import numpy as np
import pytest
from fmpy.fmi2 import FMU2Slave

from desat.export.packing import pack_scenario
from desat.files.scenario import find
from desat.files.ssp import read
from desat.runs.run import Options, execute
from tests.conftest import python, slow_after
from tests.export.test_independent_masters import columns, real_outputs

STEPS = 60
TOOL = "fmu_manipulation_toolbox"
CODE = f"""
import os, sys
from {TOOL}.cli.fmucontainer import fmucontainer
os.chdir(sys.argv.pop())
fmucontainer()
"""


def write_container(package, folder, step):
    """Join the FMUs of a packed system and return the path of the container."""
    with zipfile.ZipFile(package) as archive:
        for member in archive.namelist():
            if member.endswith(".fmu"):
                name = member.rpartition("/")[2]
                (folder / name).write_bytes(archive.read(member))
    system = read(package, Options())
    description = {
        "name": "loop.fmu",
        "fmu": [f"{name}.fmu" for name in system.components],
        "step_size": step,
        **{f"auto_{x}": False for x in ("input", "output", "link")},
        "link": [
            [f"{c.source}.fmu", c.output, f"{c.target}.fmu", c.input]
            for c in system.connections
        ],
        "output": [
            [f"{name}.fmu", output, f"{name}.{output}"]
            for name, outputs in real_outputs(package).items()
            for output in outputs
        ],
    }
    (folder / "loop.json").write_text(json.dumps(description), encoding="utf-8")
    result = python(CODE, "-container", "loop.json", str(folder))
    assert (folder / "loop.fmu").exists(), result.stdout + result.stderr
    return folder / "loop.fmu"


@pytest.mark.skipif(
    not importlib.util.find_spec(TOOL), reason="fmu-manipulation-toolbox not installed"
)
@pytest.mark.parametrize(
    "name", slow_after(1, ["uosat12/flight-ocdc-2", "gyrostat/full"])
)
def test_a_container_gives_the_series_of_a_run(tmp_path, name):
    package = pack_scenario(find(name), tmp_path / "loop.ssp", fmus="native")
    jacobi_run = execute(name, Options(algorithm="jacobi", stop=600.0))
    step = jacobi_run.manifest["step"]
    path = write_container(package, tmp_path, step)
    description = fmpy.read_model_description(path, validate=False)
    slave = FMU2Slave(
        guid=description.guid,
        unzipDirectory=fmpy.extract(path),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="loop",
    )
    slave.instantiate()
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    of = {v.name: v.valueReference for v in description.modelVariables}
    outputs = real_outputs(package)
    references = [of[f"{c}.{v}"] for c, names in outputs.items() for v in names]
    rows = []
    for k in range(STEPS):
        slave.doStep(k * step, step)
        rows.append(slave.getReal(references))
    slave.freeInstance()
    assert np.array_equal(rows, columns(jacobi_run, outputs)[:STEPS])
