"""`desat check` finds each kind of mistake and names file, line, component and
variable."""

from __future__ import annotations

import inspect
import json
import shutil
from pathlib import Path

import pytest

from desat.files import paths
from desat.files.build import build
from desat.runs.checks import check_draft
from desat.runs.prepare import read
from desat.runs.run import Options, prepare
from desat.system.errors import DesatError
from tests.conftest import ROOT

SSD = ROOT / "ssp" / "uosat12" / "SystemStructure.ssd"


@pytest.fixture
def broken(tmp_path):
    """Check the UoSAT-12 system with texts replaced; return the problems."""

    def make(
        *replacements: tuple[str, str], sets: tuple[str, ...] = (), step: float = 10.0
    ) -> str:
        text = SSD.read_text(encoding="utf-8")
        for old, new in replacements:
            assert old in text, old
            text = text.replace(old, new, 1)
        (tmp_path / "SystemStructure.ssd").write_text(text, encoding="utf-8")
        if not (tmp_path / "resources").exists():
            (tmp_path / "resources").symlink_to(paths.fmus())
        try:
            case = prepare(
                str(tmp_path), Options(sets=list(sets), step=step, stop=600.0)
            )
        except DesatError as error:
            return str(error)
        return "\n".join(case.problems)

    return make


def line_of(tmp: str) -> int:
    return next(i for i, x in enumerate(SSD.read_text().splitlines(), 1) if tmp in x)


CONNECTION = (
    '<ssd:Connection startElement="magnetometer" startConnector="b_body[1]" '
    'endElement="manager" endConnector="b_body[1]"/>'
)


def test_sound(broken):
    assert broken() == ""


def test_schema(broken):
    problems = broken(('kind="output"', 'kind="outlet"'))
    line = line_of('kind="output"')
    assert f"SystemStructure.ssd:{line}:" in problems
    assert "outlet" in problems
    assert "http://" not in problems


def test_not_xml(broken):
    assert "SystemStructure.ssd:" in broken(("</ssd:Elements>", ""))


def test_doctype(broken):
    problems = broken(
        (
            "<ssd:SystemStructureDescription",
            "<!DOCTYPE x>\n<ssd:SystemStructureDescription",
        )
    )
    assert "DOCTYPE" in problems


def test_missing_fmu(broken):
    problems = broken(("resources/magnetometer.fmu", "resources/magnetomter.fmu"))
    assert problems.endswith("magnetometer: FMU resources/magnetomter.fmu is missing")


def test_unknown_connector(broken):
    problems = broken(
        (
            CONNECTION,
            CONNECTION.replace('endConnector="b_body[1]"', 'endConnector="b_bdy[1]"'),
        )
    )
    assert "manager has no connector b_bdy[1]; did you mean b_body[1]?" in problems


def test_unknown_connector_in_the_list(broken):
    problems = broken(
        (
            '<ssd:Connector name="q_bi[1]" kind="input">',
            '<ssd:Connector name="q_ib[1]" kind="input">',
        )
    )
    assert "magnetometer has no connector q_bi[1]; did you mean q_ib[1]?" in problems


def test_unknown_component(broken):
    problems = broken((CONNECTION, CONNECTION.replace('"manager"', '"manger"')))
    assert "no component manger; did you mean manager?" in problems


def test_wrong_direction(broken):
    inputs = (
        '<ssd:Connection startElement="manager" startConnector="b_body[1]" '
        'endElement="manager" endConnector="b_body[2]"/>'
    )
    problems = broken((CONNECTION, inputs))
    assert "wrong direction" in problems
    assert "manager.b_body[1] is an input, an output is needed" in problems


def test_start_and_end_do_not_say_which_gives(broken):
    reverse = (
        '<ssd:Connection startElement="manager" startConnector="b_body[1]" '
        'endElement="magnetometer" endConnector="b_body[1]"/>'
    )
    assert broken((CONNECTION, reverse)) == ""


def test_wrong_kind_in_the_list(broken):
    problems = broken(
        (
            '<ssd:Connector name="q_bi[1]" kind="input">',
            '<ssd:Connector name="q_bi[1]" kind="output">',
        )
    )
    assert "q_bi[1]: listed as output, but it is an input" in problems


def test_wrong_type(broken):
    problems = broken(
        (
            '<ssd:Connector name="b_body[1]" kind="output"><ssc:Real/>',
            '<ssd:Connector name="b_body[1]" kind="output"><ssc:Integer/>',
        )
    )
    assert "b_body[1]: listed as Integer, but it is Real" in problems


def test_types_that_do_not_fit(broken):
    enable = '<ssd:Connector name="b_body[1]" kind="input"><ssc:Real/></ssd:Connector>'
    more = '<ssd:Connector name="enable" kind="input"><ssc:Boolean/></ssd:Connector>'
    wire = (
        '<ssd:Connection startElement="magnetometer" startConnector="b_body[1]" '
        'endElement="manager" endConnector="enable"/>'
    )
    problems = broken((enable, enable + more), (CONNECTION, CONNECTION + wire))
    assert "type Real does not fit Boolean" in problems


def test_incompatible_unit(broken):
    problems = broken(
        (
            CONNECTION,
            CONNECTION.replace(
                'startElement="magnetometer" startConnector="b_body[1]"',
                'startElement="spacecraft" startConnector="omega_bi_body[1]"',
            ),
        )
    )
    assert "unit rad/s does not fit T" in problems


def test_two_sources(broken):
    other = CONNECTION.replace(
        'startConnector="b_body[1]"', 'startConnector="b_body[2]"'
    )
    problems = broken((CONNECTION, CONNECTION + other))
    assert "manager.b_body[1] has two sources, also magnetometer.b_body[1]" in problems


def test_unconnected_and_half_wired(broken):
    problems = broken((CONNECTION, ""))
    assert (
        "manager.b_body[1] is listed, but has neither a connection nor a value"
        in problems
    )
    assert "manager.b_body is wired in part: b_body[1]" in problems
    assert broken((CONNECTION, ""), sets=("manager.b_body[1]=1e-5",)) == ""


def test_unknown_parameter(broken):
    problems = broken(sets=("manager.splitt=ocdc",))
    assert "manager has no variable splitt; did you mean split?" in problems


def test_unknown_choice(broken):
    problems = broken(sets=("manager.split=ocdcc",))
    assert "manager.split = ocdcc: not a choice; did you mean ocdc?" in problems


def test_out_of_range(broken):
    problems = broken(sets=("manager.duty=1.5",))
    assert "manager.duty = 1.5: allowed is 0 to 1" in problems


def test_wrong_count_and_kind(broken):
    assert "h_start_body needs 3 values, got 2" in broken(
        sets=("spacecraft.h_start_body=1,2",)
    )
    assert "a Real is needed" in broken(sets=("manager.duty=fast",))
    for seed, message in (
        ("1.5", "an Integer is needed"),
        ("3e9", "an Integer is needed"),
        ("3000000000", "3000000000: allowed is -2147483648 to 2147483647"),
        ("9" * 400, "a number of 400 digits"),
    ):
        assert message in broken(sets=(f"magnetometer.seed={seed}",))
    assert "a Boolean is needed" in broken(sets=("manager.saturation=3",))
    assert "is an output: it cannot be set" in broken(
        sets=("manager.m_cmd_body=1,2,3",)
    )
    assert "the form is COMPONENT.VARIABLE=VALUE" in broken(sets=("manager",))


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"loop": "fast"}, "loop = 'fast': there is compiled, python"),
        ({"isolate": True}, "isolate = True: there is all, foreign, none"),
        ({"stop": "5"}, "stop = '5': a time in s is needed"),
    ],
)
def test_what_a_program_asks_for_is_looked_at(option, message):
    with pytest.raises(DesatError, match=message):
        Options(**option)


def test_sample_time_that_does_not_fit(broken):
    problems = broken(sets=("manager.sample_time=15",))
    assert "manager.sample_time = 15 s is not a multiple of its step 10 s" in problems


def test_stop_that_does_not_fit(broken):
    assert "600 s is not a multiple of the step 7 s" in broken(step=7.0)


def test_cycle_is_printed_as_a_chain(broken):
    wire = ""
    for i in (1, 2, 3):
        wire += (
            f'<ssd:Connection startElement="torquers" startConnector="m_mean_body[{i}]" '
            f'endElement="magnetometer" endConnector="b_eci[{i}]" '
            'suppressUnitConversion="true"/>'
        )
    text = SSD.read_text(encoding="utf-8")
    old = [
        x
        for x in text.splitlines()
        if 'endElement="magnetometer" endConnector="b_eci' in x
    ]
    problems = broken(*((x, "") for x in old), (CONNECTION, CONNECTION + wire))
    assert "cycle over the step:" in problems
    for link in ("magnetometer.b_body", "manager.m_cmd_body", "torquers.m_mean_body"):
        assert link in problems
    assert "[output_classes]" in problems


def test_missing_parameter_file_and_component_twice(broken):
    component = '<ssd:Component name="tachometers"'
    assert "component magnetometer twice" in broken(
        (component, '<ssd:Component name="magnetometer"')
    )


def test_everything_at_once(broken):
    """All problems are reported, not the first alone."""
    problems = broken(
        ("resources/tachometers.fmu", "resources/nothing.fmu"),
        (CONNECTION, CONNECTION.replace('"manager"', '"manger"')),
    )
    assert "nothing.fmu is missing" in problems
    assert "no component manger" in problems


def test_command(desat, tmp_path):
    shutil.copy(SSD, tmp_path / "SystemStructure.ssd")
    (tmp_path / "resources").symlink_to(paths.fmus())
    good = desat("check", str(tmp_path), "--step", "10", "--schedule")
    assert good.returncode == 0
    assert (
        "steps in this order: environment, magnetometer, tachometers, manager"
        in good.stdout
    )
    assert "\nconnection " in good.stdout
    assert "\nenvironment.b_eci -> magnetometer.b_eci " in good.stdout
    assert "one step late" not in good.stdout
    bad = desat("check", str(tmp_path), "--step", "10", "--set", "manager.duty=2")
    assert bad.returncode == 2
    assert (
        bad.stderr.strip()
        == "error: --set manager.duty=2: manager.duty = 2: allowed is 0 to 1"
    )
    assert Path(tmp_path / "SystemStructure.ssd").exists()


def test_command_exit_code(desat, tmp_path):
    text = SSD.read_text(encoding="utf-8").replace(CONNECTION, "", 1)
    (tmp_path / "SystemStructure.ssd").write_text(text, encoding="utf-8")
    (tmp_path / "resources").symlink_to(paths.fmus())
    result = desat("check", str(tmp_path), "--step", "10")
    assert result.returncode == 1
    assert result.stderr.splitlines()[-1].startswith("2 problem(s) in ")


def test_a_foreign_system_never_runs_our_fmus(desat, tmp_path):
    """An .ssp that lacks an FMU is refused, although ours has one of that name."""
    shutil.copy(SSD, tmp_path / "SystemStructure.ssd")
    result = desat("check", str(tmp_path), "--step", "10")
    assert result.returncode == 1
    assert "manager: FMU resources/manager_combined.fmu is missing" in result.stderr


SET = """<?xml version="1.0" encoding="UTF-8"?>
<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"
 xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" name="p" version="1.0">
<ssv:Parameters><ssv:Parameter name="altitude"><ssv:Real value="650" unit="UNIT"/></ssv:Parameter>
</ssv:Parameters><ssv:Units><ssc:Unit name="league"><ssc:BaseUnit m="1" factor="5556"/></ssc:Unit>
</ssv:Units></ssv:ParameterSet>"""


def write_altitude(tmp_path: Path, unit: str | None) -> None:
    """The UoSAT-12 system with an altitude of 650 of a unit."""
    text = SSD.read_text(encoding="utf-8")
    head, middle, tail = text.partition('name="environment"')
    tail = tail.replace(
        "</ssd:Connectors>",
        "</ssd:Connectors><ssd:ParameterBindings>"
        '<ssd:ParameterBinding source="e.ssv"/></ssd:ParameterBindings>',
        1,
    )
    (tmp_path / "SystemStructure.ssd").write_text(
        head + middle + tail, encoding="utf-8"
    )
    (tmp_path / "e.ssv").write_text(
        SET.replace(' unit="UNIT"', f' unit="{unit}"' if unit else ""), encoding="utf-8"
    )
    (tmp_path / "resources").symlink_to(paths.fmus())


@pytest.mark.parametrize(
    ("unit", "value"),
    [
        ("km", 650e3),
        (None, "altitude = 650 m: allowed is 100000 to inf"),
        ("league", 650 * 5556.0),
        (
            "s",
            "e.ssv:4: environment.altitude: the unit of altitude = 650.0 does not fit m",
        ),
        ("mile", "unit mile is not known"),
    ],
)
def test_the_unit_of_a_parameter_is_read(tmp_path, unit, value):
    write_altitude(tmp_path, unit)
    case = prepare(str(tmp_path), Options(step=10.0, stop=600.0))
    if isinstance(value, str):
        assert any(value in problem for problem in case.problems)
    else:
        assert case.problems == []
        assert case.system.components["environment"].parameters["altitude"] == value


def test_a_value_of_the_command_line_is_in_the_variables_own_unit(tmp_path):
    """The unit that the file gave its value in is not that of another value."""
    write_altitude(tmp_path, "km")
    options = Options(step=10.0, stop=600.0, sets=["environment.altitude=5e5"])
    system, _ = prepare(str(tmp_path), options).or_raise()
    assert system.components["environment"].parameters["altitude"] == 5e5


def find_problems(name: str, *sets: str) -> list[str]:
    return prepare(name, Options(sets=list(sets))).problems


@pytest.mark.parametrize(
    ("name", "setting", "lack"),
    [
        (
            "uosat12/flight-ocdc-1",
            "spacecraft.aerodynamics=area",
            "spacecraft.aerodynamics = area needs density, which is neither wired nor given",
        ),
        (
            "uosat12/flight-ocdc-1",
            "spacecraft.radiation=plates",
            "spacecraft.radiation = plates needs sun_eci, which is neither wired nor given",
        ),
        (
            "gyrostat/full",
            "wheels.unbalance=1e-3",
            "wheels.unbalance = 0.001 needs tau_jitter_body, an unused output",
        ),
        (
            "gyrostat/full",
            "wheels.command_mode=speed",
            "wheels.command_mode = speed needs speed_cmd_wheel, which is neither wired nor given",
        ),
    ],
)
def test_physics_that_is_not_wired_is_refused(name, setting, lack):
    assert find_problems(name) == []
    assert any(
        problem.endswith(f"craft.toml: {lack}")
        for problem in find_problems(name, setting)
    )


def test_an_input_that_is_given_counts_as_wired():
    drag = ("spacecraft.aerodynamics=area", "spacecraft.density=1e-12")
    assert find_problems("uosat12/flight-ocdc-1", *drag) == []


def test_a_wired_input_that_needs_another():
    """A dipole without a field would have no effect."""
    draft = build(read("gyrostat/full"), Options())
    draft.connections = [
        c
        for c in draft.connections
        if (c.target, c.input[:5]) != ("spacecraft", "b_eci")
    ]
    (problem,) = check_draft(draft).problems
    assert (
        "spacecraft.m_mean_body is wired and needs b_eci, which is neither" in problem
    )


def test_what_is_left_open_is_listed(desat):
    result = desat("check", "gyrostat/full", "--json")
    assert result.returncode == 0
    open_ends = json.loads(result.stdout)["unwired"]
    assert "density" in open_ends["spacecraft"]["inputs_at_default"]
    assert "q_bi" not in open_ends["spacecraft"]["outputs_unread"]
    assert "tau_jitter_body" in open_ends["wheels"]["outputs_unread"]
    assert "fault" not in open_ends["wheels"]["outputs_unread"]
    lines = desat("check", "gyrostat/full").stderr.splitlines()
    assert (
        sum(
            line.startswith("note: spacecraft: unconnected inputs at their default: ")
            for line in lines
        )
        == 1
    )


def test_every_check_of_an_analysis_is_in_a_list():
    """A module of analyses/ with `problems` or `warnings` that no list names would say
    nothing."""
    from desat.runs.checks import CHECKS
    from desat.system import discovery

    listed_checks = {inspect.unwrap(check.find) for check in CHECKS}
    modules = discovery.load("analyses")
    module_checks = [
        getattr(m, kind)
        for m in modules
        for kind in ("problems", "warnings")
        if hasattr(m, kind)
    ]
    assert len(module_checks) > 8
    assert [f.__module__ for f in module_checks if f not in listed_checks] == []
