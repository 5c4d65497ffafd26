"""Native FMUs with Reals alone give what the usual ones give, in a host of its own."""

from __future__ import annotations

import random
import zipfile

import fmpy
import pytest
from fmpy.fmi2 import FMU2Slave
from lxml import etree

from desat.files import library
from desat.fmus.reals import repack
from tests.conftest import slow_after

BLOCKS = (
    "torquers",
    "wheels",
    "thrusters_valves",
    "manager_threshold",
    "manager_cross_product",
    "manager_mixed_mode",
    "magnetometer",
    "star_tracker",
    "attitude_determination",
    "guidance_slew",
    "environment_planet",
    "controller_pid",
)
STEPS = 20


def fly(fmu, inputs):
    """Outputs after each step, by name, of an FMU whose Reals alone are set and read,
    or whose variables are by their types."""
    description = fmpy.read_model_description(str(fmu))
    folder = fmpy.extract(str(fmu))
    slave = FMU2Slave(
        guid=description.guid,
        modelIdentifier=description.coSimulation.modelIdentifier,
        unzipDirectory=folder,
        instanceName="same",
    )
    slave.instantiate()
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    by_name = {v.name: v for v in description.modelVariables}
    outputs = [v for v in by_name.values() if v.causality == "output"]
    rows = []
    for step in range(STEPS):
        for name, values in inputs.items():
            kind, value = by_name[name].type, values[step]
            setter = getattr(slave, f"set{kind}")
            setter(
                [by_name[name].valueReference],
                [{"Boolean": bool}.get(kind, float)(value)],
            )
        slave.doStep(float(step), 1.0)
        rows.append(
            [
                float(getattr(slave, f"get{v.type}")([v.valueReference])[0])
                for v in outputs
            ]
        )
    slave.terminate()
    slave.freeInstance()
    return rows


@pytest.mark.parametrize("name", slow_after(3, BLOCKS))
def test_a_block_of_reals_is_the_block(tmp_path, name):
    usual = library.of_ours(f"{name}.fmu").path
    reals = repack(usual, tmp_path / usual.name)
    random.seed(name)
    inputs = {
        v.name: [
            random.choice((0, 1))
            if v.type == "Boolean"
            else random.uniform(-1e-3, 1e-3)
            for _ in range(STEPS)
        ]
        for v in fmpy.read_model_description(str(usual)).modelVariables
        if v.causality == "input" and v.type in ("Boolean", "Real")
    }
    description = fmpy.read_model_description(str(reals))
    assert {v.type for v in description.modelVariables} == {"Real"}
    assert description.defaultExperiment.stepSize is None
    assert fmpy.validation.validate_model_description(description) == []
    first, second = fly(usual, inputs), fly(reals, inputs)
    assert [list(map(repr, row)) for row in first] == [
        list(map(repr, row)) for row in second
    ]


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("feedforward", 0.5, "0 or 1 is needed"),
        ("by", 1.5, "a whole number is needed"),
        ("by", float("nan"), "nan is no number"),
    ],
)
def test_what_is_no_value_of_its_type_is_refused(tmp_path, name, value, message):
    usual = library.of_ours("manager_threshold.fmu").path
    reals = repack(usual, tmp_path / usual.name)
    description = fmpy.read_model_description(str(reals))
    messages = []
    slave = FMU2Slave(
        guid=description.guid,
        modelIdentifier=description.coSimulation.modelIdentifier,
        unzipDirectory=fmpy.extract(str(reals)),
        instanceName="same",
    )
    callbacks = fmpy.fmi2.fmi2CallbackFunctions()
    callbacks.logger = fmpy.fmi2.fmi2CallbackLoggerTYPE(
        lambda *x: messages.append(x[-1])
    )
    callbacks.allocateMemory = fmpy.fmi2.fmi2CallbackAllocateMemoryTYPE(
        fmpy.fmi2.calloc
    )
    callbacks.freeMemory = fmpy.fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.fmi2.free)
    slave.instantiate(callbacks=callbacks)
    (reference,) = (
        v.valueReference for v in description.modelVariables if v.name == name
    )
    with pytest.raises(Exception, match="fmi2SetReal"):
        slave.setReal([reference], [value])
    assert message in messages[0].decode()
    slave.freeInstance()


def test_the_values_of_a_choice_are_in_its_text(tmp_path):
    usual = library.of_ours("manager_threshold.fmu").path
    with zipfile.ZipFile(repack(usual, tmp_path / usual.name)) as archive:
        root = etree.fromstring(archive.read("modelDescription.xml"))
    texts = {v.get("name"): v.get("description") for v in root.iter("ScalarVariable")}
    assert texts["by"] == "what dumps: 0 = thrusters, 1 = coils, 2 = both"
    assert texts["feedforward"].endswith(": 0 = false, 1 = true")


def test_the_command_writes_one_block_or_an_own_one(tmp_path, desat):
    process = desat(
        "build", "torquers", "--reals", "--out", "x", cwd=tmp_path, check=True
    )
    assert process.stdout.split() == ["x/reals/torquers.fmu"]
    desat("new", "law", "my_law", cwd=tmp_path, check=True)
    (file,) = tmp_path.rglob("my_law.py")
    desat("build", str(file), "--reals", cwd=tmp_path, check=True)
    assert (file.parent / "reals" / "my_law.fmu").exists()
    process = desat("build", "torquer", "--reals", cwd=tmp_path)
    assert process.returncode == 2
    for option, message in (
        (["--fmi", "3"], "--fmi 3: --reals is of FMI 2.0"),
        (["--platforms", "win64"], "--platforms win64: our blocks stay as they were"),
    ):
        refusal = desat("build", "torquers", "--reals", *option, cwd=tmp_path)
        assert (refusal.returncode, message in refusal.stderr) == (2, True)
    assert "torquer: no native block of ours; did you mean torquers" in process.stderr
