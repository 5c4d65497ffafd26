"""Craft files: they give all that was wired by hand, their SSDs are current, bad ones
say so."""

from __future__ import annotations

import hashlib
import shutil

import pytest

from desat.components.contract import roles
from desat.export import packing
from desat.files import craft, paths, scenario, ssp
from desat.files.build import build
from desat.files.completion import complete
from desat.runs.run import Options, execute
from desat.system.errors import DesatError
from desat.system.interface import elements, misfit, of_block, usual_sources
from tests.conftest import ROOT

CRAFTS = [
    f for family in scenario.families() for f in craft.files(ROOT / "ssp" / family)
]

BY_HAND = {
    # the connections of the SSDs that were kept by hand, how many and the digest of
    # their names; since then `valid` of the sensors has come, and what a magnetometer
    # sees of the coils; the gyrostat's manager knows the body's rate, three more
    "gyrostat/craft.toml": (83, "c03012a9e721818a"),
    "integrated/craft.toml": (112, "028d67e774c5b8dd"),
    "nadir_day/craft.toml": (112, "028d67e774c5b8dd"),
    "plant/craft.toml": (34, "2e8085f172da0b7f"),
    "uosat12/craft.toml": (60, "68c101596fe8c5fe"),
    "uosat12/flight.craft.toml": (113, "cc31064078a31783"),
}

GOOD = """
title = "Two magnetometers & a <title>"

[components]
environment = "environment_orbit_dipole"
spacecraft = "spacecraft_fixed_attitude"
magnetometer = "magnetometer"
magnetometer_2 = "magnetometer"
tachometers = "tachometers"
manager = "manager_combined"
torquers = "torquers"
thrusters = "thrusters"

[wiring]
"manager.b_body" = "magnetometer_2.b_body"
"spacecraft.density" = false
spacecraft.sunlight = false

[shared]
sample_time = 1.0

[parameters.manager]
split = "crcp"
"""


def wires(system) -> set[str]:
    return {str(c) for c in system.connections}


def draft_of(folder, text: str = GOOD):
    file = folder / "mine.toml"
    file.write_text(text, encoding="utf-8")
    return craft.read(file, Options())


@pytest.mark.parametrize("name", BY_HAND)
def test_every_connection_made_by_hand_is_there(name):
    since = (".valid", "magnetometer.m_body")
    all_wires = wires(craft.read(ROOT / "ssp" / name, Options()))
    connections = [w for w in all_wires if not any(x in w for x in since)]
    digest = hashlib.sha256("\n".join(sorted(connections)).encode()).hexdigest()
    assert (len(connections), digest[:16]) == BY_HAND[name]


def test_all_511():
    assert sum(n for n, _ in BY_HAND.values()) == 511 + 3


@pytest.mark.parametrize("file", CRAFTS, ids=lambda f: f"{f.parent.name}/{f.name}")
def test_the_ssd_is_current_and_says_the_same(file):
    target = packing.target(file)
    assert target.read_text(encoding="utf-8") == packing.text(file), (
        "run `desat pack --ssd`"
    )
    system = ssp.read(target, Options())
    assert system.problems == []
    same_system(system, craft.read(file, Options()))


def same_system(a, b) -> None:
    assert (a.name, a.stop) == (b.name, b.stop)
    assert wires(a) == wires(b)
    assert list(a.components) == list(b.components)
    for c, d in zip(a.components.values(), b.components.values(), strict=True):
        assert (c.source, c.parameters) == (d.source, d.parameters)
        assert c.fmu is not None
        assert d.fmu is not None
        assert c.fmu.path.name == d.fmu.path.name  # native, where ours is run


def test_every_usual_source_is_an_output_that_fits():
    classes = {c.role: c for c in vars(roles).values() if getattr(c, "role", "")}
    components = {name: of_block(name, c) for name, c in classes.items()}
    count = 0
    for role, inputs in usual_sources().items():
        for name, sources in inputs.items():
            for source in sources:
                owner, _, output = source.partition(".")
                outputs = elements(components[owner], output, "output")
                assert outputs, source
                assert not misfit(outputs, elements(components[role], name, "input")), (
                    source
                )
                count += 1
    assert count > 40


def test_what_a_craft_says_goes_before_the_usual(tmp_path):
    system = draft_of(tmp_path)
    craft_wires = wires(system)
    assert "magnetometer_2.b_body[1] -> manager.b_body[1]" in craft_wires
    assert "magnetometer.b_body[1] -> manager.b_body[1]" not in craft_wires
    assert "spacecraft.q_bi[4] -> magnetometer_2.q_bi[4]" in craft_wires
    assert "environment.sun_eci[1] -> spacecraft.sun_eci[1]" in craft_wires
    assert not any("density" in w or "sunlight" in w for w in craft_wires)
    assert system.components["manager"].parameters["split"] == 2
    assert {
        c.parameters["sample_time"]
        for c in system.components.values()
        if "sample_time" in c.interface.signals
    } == {1.0}
    file, is_new = packing.write(tmp_path / "mine.toml")
    assert (file.name, is_new) == ("mine.ssd", True)
    assert packing.write(tmp_path / "mine.toml") == (file, False)
    (tmp_path / "resources").symlink_to(paths.fmus())
    again = ssp.read(file, Options())
    assert again.problems == []
    same_system(again, system)


def test_an_fmu_stands_beside_the_craft_file(tmp_path):
    text = GOOD.replace('"manager_combined"', '"fmus/other.fmu"')
    with pytest.raises(
        DesatError, match=r"components.manager = fmus/other.fmu: no such file"
    ):
        draft_of(tmp_path, text)
    (tmp_path / "fmus").mkdir()
    shutil.copy(paths.fmus() / "manager_combined.fmu", tmp_path / "fmus" / "other.fmu")
    system = draft_of(tmp_path, text)
    assert system.components["manager"].fmu.path == tmp_path / "fmus" / "other.fmu"
    assert wires(system) == wires(draft_of(tmp_path))


def test_ideal_sources_stand_in_for_missing_sensors(tmp_path):
    craft_wires = wires(
        draft_of(tmp_path, GOOD.replace('tachometers = "tachometers"\n', ""))
    )
    assert "spacecraft.h_copy_wheel[4] -> manager.h_wheel[4]" in craft_wires


BAD = {
    "role": (
        'manager = "m',
        'maneger = "m',
        ":10: components.maneger: no role maneger; did you mean manager?",
    ),
    "block": (
        "manager_combined",
        "manager_combind",
        ":10: components.manager = manager_combind: "
        "no such block; did you mean manager_combined?",
    ),
    "role of block": (
        "manager_combined",
        "magnetometer_bias",
        "no such block; did you mean",
    ),
    "another role": (
        '"manager_combined"',
        '"magnetometer"',
        ":10: components.manager = magnetometer: its role is magnetometer, not manager",
    ),
    "no text": (
        '"manager_combined"',
        "3",
        ":10: components.manager = 3: the name of a block or "
        "the path of an FMU is needed",
    ),
    "component": (
        '"manager.b_body"',
        '"manger.b_body"',
        ":15: wiring.manger.b_body: no component manger; did you mean manager?",
    ),
    "input": (
        '"manager.b_body"',
        '"manager.b_bdy"',
        ":15: wiring.manager.b_bdy: manager has no input b_bdy; did you mean b_body?",
    ),
    "input of a table": (
        "spacecraft.sunlight",
        "spacecraft.sunligt",
        ":17: "
        "wiring.spacecraft.sunligt: spacecraft has no input sunligt; did you "
        "mean sunlight?",
    ),
    "no input": (
        '"manager.b_body"',
        "manager",
        ":15: wiring.manager: the form is COMPONENT.INPUT",
    ),
    "source": (
        "magnetometer_2.b_body",
        "magnetometer_3.b_body",
        ":15: wiring.manager.b_body = "
        "magnetometer_3.b_body: no component magnetometer_3; did you mean magnetometer_2?",
    ),
    "output": (
        "magnetometer_2.b_body",
        "magnetometer_2.b_bod",
        ":15: wiring.manager.b_body: "
        "magnetometer_2 has no output b_bod, which manager.b_body would take; did you mean "
        "b_body?",
    ),
    "an input as source": (
        "magnetometer_2.b_body",
        "magnetometer_2.b_eci",
        "magnetometer_2 has no output b_eci",
    ),
    "unit": (
        "magnetometer_2.b_body",
        "environment.r_eci",
        ":15: wiring.manager.b_body: "
        "environment.r_eci does not fit manager.b_body: unit m, T is needed",
    ),
    "type": (
        'density" = false',
        'density" = "magnetometer.valid"',
        "magnetometer.valid does not "
        "fit spacecraft.density: type Boolean, Real is needed",
    ),
    "size": (
        "magnetometer_2.b_body",
        "spacecraft.q_bi",
        "spacecraft.q_bi does not fit manager.b_body: 4 elements, 3 are needed",
    ),
    "true": (
        'density" = false',
        'density" = true',
        ':16: wiring.spacecraft.density = True: "component.output" or false is needed',
    ),
    "key": ("title =", "titel =", ":2: titel: unknown key; did you mean title?"),
    "stop": (
        "title =",
        'stop = "1"\ntitle =',
        ":2: stop = '1': a time in seconds is needed",
    ),
    "shared": (
        "sample_time",
        "sampel_time",
        ":20: shared.sampel_time: no component has a "
        "parameter sampel_time; did you mean sample_time?",
    ),
    "parameter": (
        "split",
        "splitt",
        ":23: parameters.manager.splitt: manager has no variable "
        "splitt; did you mean split?",
    ),
    "choice": (
        '"crcp"',
        '"crc"',
        "manager.split = crc: not a choice; did you mean crcp?",
    ),
    "owner": (
        "[parameters.manager]",
        "[parameters.maneger]",
        ":22: parameters.maneger: no component maneger; did you mean manager?",
    ),
    "a table": (
        "[shared]\nsample_time = 1.0",
        "[shared.x]",
        ":19: shared.x: no component has a parameter x",
    ),
    "TOML": ("[components]", "[components", "mine.toml: "),
}


@pytest.mark.parametrize("fault", BAD)
def test_a_bad_craft_file_is_one_line(fault, tmp_path):
    old, new, message = BAD[fault]
    assert GOOD.count(old) >= 1
    with pytest.raises(DesatError) as error:
        draft_of(tmp_path, GOOD.replace(old, new, 1))
    (line,) = str(error.value).splitlines()
    assert line.startswith(str(tmp_path / "mine.toml"))
    assert message in line


def test_a_craft_file_gives_a_parameter_as_another(tmp_path):
    """As a scenario may; it took texts for choices alone."""
    line = 'm_limit = "torquers.m_limit"'
    text = GOOD.replace("[parameters.manager]", f"[parameters.manager]\n{line}")
    draft = draft_of(tmp_path, text)
    assert draft.components["manager"].references == {"m_limit": "torquers.m_limit"}
    complete(draft)
    components = draft.components
    limit = components["torquers"].values["m_limit"]
    assert components["manager"].values["m_limit"] == limit


def test_no_file_and_no_utf8(tmp_path):
    with pytest.raises(DesatError, match=r"none.toml: no such file"):
        craft.read(tmp_path / "none.toml", Options())
    (tmp_path / "mine.toml").write_bytes(b'title = "\xff"')
    with pytest.raises(DesatError, match=r"mine.toml: not UTF-8"):
        craft.read(tmp_path / "mine.toml", Options())
    with pytest.raises(DesatError, match=r"there is no component"):
        draft_of(tmp_path, "title = ''")


@pytest.fixture
def family(tmp_path, monkeypatch):
    """A family of one's own: a craft file and a scenario, no SSD."""
    folder = tmp_path / "ssp" / "mine"
    (folder / "scenarios").mkdir(parents=True)
    (folder / "craft.toml").write_text(GOOD, encoding="utf-8")
    (folder / "scenarios" / "one.toml").write_text(
        'title = "One"\ndescription = "Two."\nstep = 1.0\nstop = 20.0\n'
        '[sources]\nenvironment = "environment_kepler"\n',
        encoding="utf-8",
    )
    monkeypatch.setattr(scenario, "ROOT", tmp_path / "ssp")
    monkeypatch.setattr(paths, "SCENARIOS", tmp_path / "ssp")
    scenario.families.cache_clear()
    scenario.cells.cache_clear()
    scenario._cell.cache_clear()
    scenario.survey.cache_clear()
    scenario.scenarios.cache_clear()
    yield folder
    scenario.families.cache_clear()
    scenario.cells.cache_clear()
    scenario._cell.cache_clear()
    scenario.survey.cache_clear()
    scenario.scenarios.cache_clear()


def test_a_family_is_a_craft_file_and_a_scenario(family):
    system = build(scenario.find("mine/one"), Options())
    assert system.problems == []
    assert system.components["environment"].source == "resources/environment_kepler.fmu"
    run = execute("mine/one", Options())
    assert run.ok
    assert run.manifest["steps_done"] == 20
    assert run.manifest["about"]["title"] == "One"
    assert run.manifest["parameters"]["manager"]["split"]["value"] == "crcp"


def test_a_scenario_names_its_craft_or_its_ssd(family):
    file = family / "scenarios" / "one.toml"
    text = file.read_text(encoding="utf-8")

    def system(line: str):
        file.write_text(line + text, encoding="utf-8")
        scenario.cells.cache_clear()
        scenario._cell.cache_clear()
        scenario.survey.cache_clear()
        scenario.scenarios.cache_clear()
        return build(scenario.find("mine/one"), Options())

    (family / "small.craft.toml").write_text(
        '[components]\nenvironment = "environment_orbit_dipole"\n'
        'spacecraft = "spacecraft_fixed_attitude"\n',
        encoding="utf-8",
    )
    assert list(system('craft = "small.craft.toml"\n').components) == [
        "environment",
        "spacecraft",
    ]
    packing.write(family / "craft.toml")
    (family / "resources").symlink_to(paths.fmus())
    from_ssd = system('ssd = "SystemStructure.ssd"\n')
    assert from_ssd.place.endswith("SystemStructure.ssd")
    same_system(from_ssd, system(""))
    with pytest.raises(DesatError, match="craft and ssd: only one of them"):
        system('craft = "craft.toml"\nssd = "SystemStructure.ssd"\n')
    with pytest.raises(DesatError, match=r"craft = 'crft.toml': no such file"):
        system('craft = "crft.toml"\n')


def test_the_command(desat, tmp_path):
    (tmp_path / "mine.toml").write_text(GOOD, encoding="utf-8")
    result = desat("pack", "--ssd", "mine.toml", cwd=tmp_path, check=True)
    assert result.stdout == "mine.ssd: written\n"
    assert (
        desat("pack", "--ssd", "mine.toml", cwd=tmp_path).stdout
        == "mine.ssd: current\n"
    )
    result = desat("pack", "--ssd", "uosat21")
    assert result.returncode == 2
    assert "no family uosat21; did you mean uosat12?" in result.stderr
