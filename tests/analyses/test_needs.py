"""What is known before a run is said before it: models that are left, laws that lack
what they need, values that are unusual, models onboard that err."""

from __future__ import annotations

import pytest

from desat.components.contract.block import Block, BlockError, Parameter
from desat.components.maths.allocation import gives
from desat.components.physics import atmosphere, earth, igrf14
from desat.files.scenario import scenarios
from desat.fmus.registry import block_class, names
from desat.runs.run import Options, prepare
from desat.system.errors import Exit
from desat.system.interface import interface_of_block
from tests.conftest import ROOT

DAY, NADIR, COMBINED = (
    "nadir_day/day-igrf",
    "integrated/mil-nadir",
    "uosat12/table3-ocdc-ilqr-1",
)


def check_target(target, *sets, sources=(), **options):
    options = Options(blocks=True, sets=list(sets), sources=list(sources), **options)
    return prepare(target, options)


def new_warnings(target, *sets, **options):
    """The warnings that a target has with options beyond those without."""
    before = check_target(target).warnings
    case = check_target(target, *sets, **options)
    assert case.problems == []
    return [w for w in case.warnings if w not in before]


# --- models that are left -------------------------------------------------------------


def write_own(tmp_path, text, of=DAY):
    file = tmp_path / "own.toml"
    file.write_text(f'extends = "{of}"\n{text}\n', encoding="utf-8")
    return str(file)


@pytest.mark.parametrize(
    ("text", "year"),
    [
        ("epoch = 2031-01-01T00:00:00Z", "the year 2031.00"),
        ("epoch = 2029-12-31T23:00:00Z", "at t = 864"),
        ("epoch = 1899-06-30T00:00:00Z", "the year 1899.49"),
    ],
)
def test_a_run_beyond_the_field_model_is_refused_before_it(desat, tmp_path, text, year):
    file = write_own(tmp_path, text)
    command = desat("run", file, "--blocks", "--out", str(tmp_path / "run"))
    assert command.returncode == Exit.INPUT, command.stderr
    (line,) = [x for x in command.stderr.splitlines() if "IGRF-14 covers" in x]
    assert f"{file}: epoch" in line
    assert year in line
    assert not (tmp_path / "run").exists()
    assert desat("check", file).returncode == Exit.UNMET


def test_a_run_that_ends_with_the_field_model_is_not_refused(tmp_path):
    file = write_own(tmp_path, "epoch = 2029-12-31T00:00:00Z")
    assert check_target(file, stop=86400.0).problems == []
    assert check_target(file, stop=86800.0).problems != []
    dipole = write_own(
        tmp_path,
        "epoch = 2031-01-01T00:00:00Z\nparameters.environment.field = 'dipole'",
    )
    assert check_target(dipole).problems == []


def test_what_a_manager_predicts_is_within_its_field_model():
    """It plans 600 s beyond the last step; two hours are left to the end of 2029."""
    block = block_class("manager_open_loop")()
    block.field_model, block.epoch_j2000 = 1, 820497600.0 + 1461 * 86400.0 - 7200.0
    block.start()
    assert list(block.foresee(0.0, 6600.0, frozenset())) == []
    with pytest.raises(BlockError, match=r"at t = 7900 s: the year 2030.00 is outside"):
        list(block.foresee(0.0, 7300.0, frozenset()))


def test_the_suns_formula_is_left_with_a_word(tmp_path):
    text = "epoch = 2101-01-01T00:00:00Z\nparameters.environment.field = 'dipole'"
    lines = [w for w in check_target(write_own(tmp_path, text)).warnings if "Sun" in w]
    (line,) = lines
    assert "own.toml: epoch" in line
    assert "the year 2101.00 is outside [1950, 2050]" in line
    assert earth.SUN_YEARS == (1950.0, 2050.0)


@pytest.mark.parametrize(
    ("axis", "eccentricity", "text"),
    [
        (6418137.0, 0.0, "the orbit is 40 to 40 km high"),
        (6878137.0, 0.07, "the orbit is 19 to 981 km high"),
    ],
)
def test_an_orbit_beyond_the_atmospheres_model_is_said(axis, eccentricity, text):
    sets = (
        f"environment.semi_major_axis={axis}",
        f"environment.eccentricity={eccentricity}",
        "environment.atmosphere=table",
    )
    (line,) = [w for w in check_target(DAY, *sets).warnings if "atmosphere" in w]
    assert "density is good from 100 to 1000 km" in line
    assert text in line
    # above there is too little air to count
    high = ("environment.semi_major_axis=48378137", "environment.atmosphere=table")
    assert not [w for w in check_target(DAY, *high).warnings if "atmosphere" in w]
    none = (*sets[:2], "environment.atmosphere=none")
    assert not [w for w in check_target(DAY, *none).warnings if "density" in w]


def test_each_range_is_declared_once():
    """Nowhere else in the code stand the numbers that the models declare."""
    assert (igrf14.FIRST_YEAR, igrf14.LAST_YEAR) == (1900.0, 2030.0)
    assert atmosphere.HEIGHTS == (100e3, 1000e3)
    for file in (ROOT / "orchestrator").rglob("*.py"):
        text = file.read_text(encoding="utf-8")
        assert "SUN_YEARS" not in text
        assert "HEIGHTS" not in text


# --- laws that would do nothing -------------------------------------------------------


def test_a_manager_without_its_design_is_told():
    """One that is put in another's place is refused."""
    values = {"sources": ["manager=manager_magnetic"]}
    (line,) = check_target(NADIR, **values).problems
    assert line.endswith("(`desat design`); gain_table, offset_table are 0")
    (line,) = new_warnings("uosat12/fig2-mec-1", "manager.costate=0,0,0")
    assert (
        "costate = 0: law = mec commands no dipole without it; `desat design` makes it"
        in line
    )
    assert line.startswith("--set manager.costate=0,0,0: manager: ")


@pytest.mark.parametrize("manager", ["manager_combined", "manager_receding_horizon"])
def test_a_law_that_needs_thrusters_is_refused_without(manager):
    problems = check_target(NADIR, sources=[f"manager={manager}"]).problems
    (line,) = [p for p in problems if "tau_cmd_thruster_body" in p]
    assert "needs tau_cmd_thruster_body, an unused output" in line


def write_unwired(tmp_path, *inputs, family, name):
    """A scenario whose craft lacks what feeds these inputs."""
    folder = ROOT / "ssp" / family
    craft = (folder / "craft.toml").read_text(encoding="utf-8")
    lines = "".join(f'"{x}" = false\n' for x in inputs)
    assert craft.count("[wiring]") <= 1
    craft = (
        craft.replace("[wiring]\n", f"[wiring]\n{lines}")
        if "[wiring]" in craft
        else craft
    )
    craft += "" if "[wiring]" in craft else f"\n[wiring]\n{lines}"
    (tmp_path / "craft.toml").write_text(craft, encoding="utf-8")
    return write_own(tmp_path, 'craft = "craft.toml"', f"{family}/{name}")


def test_a_controllers_torque_that_reaches_no_wheel_is_refused(tmp_path):
    file = write_unwired(
        tmp_path, "wheels.tau_cmd_wheel", family="integrated", name="mil-nadir"
    )
    (line,) = [p for p in check_target(file).problems if "tau_ctrl_body" in p]
    assert (
        "manager.tau_ctrl_body is wired and needs tau_cmd_wheel, an unused output"
        in line
    )


def test_a_controller_without_guidance_is_told(tmp_path):
    file = write_unwired(
        tmp_path, "controller.q_ref_bi", family="integrated", name="mil-nadir"
    )
    (line,) = [w for w in check_target(file).warnings if "q_ref_bi" in w]
    assert (
        "controller: q_ref_bi is neither wired nor given: the axes of eci are held"
        in line
    )
    fixed_file = file.replace("own", "fixed")
    text = 'extends = "own"\nparameters.controller.q_ref_bi = [0, 0, 0, 1]\n'
    (tmp_path / "fixed.toml").write_text(text, encoding="utf-8")
    assert not [w for w in check_target(fixed_file).warnings if "q_ref_bi" in w]


@pytest.mark.parametrize(
    ("procedure", "lacks", "law"),
    [
        (2, "q_ref_bi", "the start-up"),
        (1, "omega_bi_body", "the start-up"),
        (0, "omega_bi_body", "detumbling"),
    ],
)
def test_what_phases_need_is_told(procedure, lacks, law):
    """A rate that nobody measures is zero: detumbling would be over at once."""
    block = block_class("manager_start_up")()
    block.procedure = procedure
    block.start()
    inputs = frozenset(v.name for v in block.variables)
    assert list(block.foresee(0.0, 1.0, inputs)) == []
    (line,) = block.foresee(0.0, 1.0, inputs - {lacks})
    assert line == f"{lacks} is not wired: the law of {law} is of no use without it"


@pytest.mark.parametrize(
    ("rate_from", "lacks"), [(0, ["omega_bi_body"]), (1, []), (2, ["h_wheel"])]
)
def test_what_detumbling_needs_follows_from_where_its_rate_is_from(rate_from, lacks):
    block = block_class("manager_detumbling_optimal")()
    block.rate_from = rate_from
    block.start()
    needs = block.foresee(0.0, 1.0, frozenset({"b_body"}))
    assert [line.partition(" ")[0] for line in needs] == lacks


def test_nozzles_without_torque_about_an_axis_are_told():
    source = ["thrusters=thrusters_nozzles"]
    assert not [w for w in new_warnings(COMBINED, sources=source) if "no torque" in w]
    (line,) = [
        w
        for w in new_warnings(
            COMBINED, "thrusters.thrust=0.1,0,0.1,0.1,0.1,0.1,0,0", sources=source
        )
        if "no torque" in w
    ]
    assert "give no torque about -x alone: what is commanded there is not given" in line
    assert line.startswith("--set thrusters.thrust=")


def test_nozzles_may_share_an_axis():
    """Two that turn about x and y at once give pure x only with one that turns back
    about y."""
    both, back = (1.0, 1.0, 0.0), (0.0, -0.5, 0.0)
    assert not gives((both,), (1.0, 0.0, 0.0))
    assert gives((both, back), (1.0, 0.0, 0.0))
    assert not gives((), (1.0, 0.0, 0.0))


# --- unusual values -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("target", "values", "text"),
    [
        (
            NADIR,
            "wheels.speed_limit=6000",
            "wheels.speed_limit = 6000 rad/s: usual is 1 to 1100",
        ),
        (DAY, "environment.f107=5", "environment.f107 = 5: usual is 60 to 400"),
        (
            NADIR,
            "spacecraft.omega_start_body=0,30,0",
            "spacecraft.omega_start_body[2] = 30 rad/s: usual is -3.1416 to 3.1416 rad/s",
        ),
        (DAY, "environment.raan=97.5", "environment.raan = 97.5 rad: usual is"),
    ],
)
def test_an_unusual_value_is_told(target, values, text):
    (line,) = [w for w in new_warnings(target, values) if "usual" in w]
    assert line.startswith(f"--set {values}: ")
    assert text in line


def test_a_slew_of_90_rad_is_told():
    name = next(n for n in scenarios("integrated") if "slew" in n)
    (line,) = [
        w for w in new_warnings(name, "guidance.slew_body=0,0,90") if "usual" in w
    ]
    assert "guidance.slew_body[3] = 90 rad: usual is -6.2832 to 6.2832 rad" in line


def test_a_default_is_usual():
    with pytest.raises(TypeError, match="its start value is not within what is usual"):

        class Odd(Block):
            angle: float = Parameter("rad", "an angle", start=90.0, usual=(-7.0, 7.0))


def test_what_is_usual_is_in_the_fmu():
    from desat.files import library
    from desat.files.fmu import of_fmu

    usual_count = 0
    for name in names():
        file = library.our_file(name + ".fmu")
        signals, block = of_fmu(file).signals, interface_of_block(name)
        for s in block.signals.values():
            assert signals[s.name].usual == s.usual, (name, s.name)
            usual_count += s.usual is not None
    assert usual_count > 50


# --- models onboard -------------------------------------------------------------------


@pytest.mark.parametrize(
    "manager", ["closed_loop", "preview", "mixed_mode", "open_loop"]
)
def test_another_manager_keeps_the_crafts_shared_values(manager):
    case = check_target(NADIR, sources=[f"manager=manager_{manager}"])
    assert not [p for p in case.problems if "tables are missing" not in p]
    assert not [w for w in case.warnings if "what runs onboard errs" in w]
    if case.problems:  # it needs tables that the craft has not: said, and all there is
        assert manager != "closed_loop"
    components = case.system.components
    inertia = [
        components["spacecraft"].parameters[f"inertia[{i},{i}]"] for i in (1, 2, 3)
    ]
    assert [
        components["manager"].parameters[f"inertia[{i},{i}]"] for i in (1, 2, 3)
    ] == inertia


CRAFT = """
[components]
environment = "environment_orbit_dipole"
spacecraft = "spacecraft_rigid"
wheels = "wheels"
magnetometer = "magnetometer"
torquers = "torquers"
manager = "manager_cross_product"
[wiring]
spacecraft.density = false
[parameters.spacecraft]
inertia = [1, 0, 0, 0, 2, 0, 0, 0, 2.5]
"""


def test_another_manager_of_a_scenario_keeps_them_too(tmp_path):
    (tmp_path / "craft.toml").write_text(CRAFT, encoding="utf-8")
    file = tmp_path / "own.toml"
    text = 'title = "Own"\ndescription = "Own."\ncraft = "craft.toml"\nstep = 1.0\nstop = 10.0\n'
    text += 'sources.manager = "manager_closed_loop"\n'
    of = "inertia = [1, 0, 0, 0, 2, 0, 0, 0,"
    for inputs, manager_inertia in (
        ("", 2.5),
        (f"parameters.spacecraft.{of} 2]", 2.0),
        (f"parameters.manager.{of} 3]", 3.0),
    ):
        file.write_text(text + inputs, encoding="utf-8")
        case = check_target(str(file))
        (line,) = case.problems
        assert (
            "closed_loop has no attitude law, and no other component controls the attitude"
            in line
        )
        assert (
            case.system.components["manager"].parameters["inertia[3,3]"]
            == manager_inertia
        )
        assert len([w for w in case.warnings if "what runs onboard errs" in w]) == (
            manager_inertia == 3.0
        )


def test_a_model_onboard_may_err():
    name = next(n for n in scenarios("space_telescope") if not check_target(n).problems)
    warnings = new_warnings(name, "manager.inertia=50,0,0,0,60,0,0,0,70")
    (line,) = [w for w in warnings if "what runs onboard errs" in w]
    assert line.startswith(
        "--set manager.inertia=50,0,0,0,60,0,0,0,70: manager.inertia[1,1] = 50.0"
        ", but spacecraft.inertia[1,1] = "
    )
    assert line.endswith("what runs onboard errs about it")


def test_what_errs_is_not_what_follows_from_the_craft():
    """The controller's gain matrix is `shared.inertia`: the craft's, not the erring
    model's."""
    source = ["manager=manager_closed_loop"]
    case = check_target(NADIR, "manager.inertia=50,0,0,0,60,0,0,0,70", sources=source)
    assert case.problems == []
    parts = case.system.components
    assert (
        parts["controller"].parameters["gain_matrix[1,1]"]
        == parts["spacecraft"].parameters["inertia[1,1]"]
    )


def test_parts_of_the_craft_may_not_differ():
    problems = check_target(NADIR, "wheels.inertia_wheel=1e-3,1e-3,1e-3,1e-3").problems
    assert len(problems) == 4
    assert all("the two must be equal" in p for p in problems)
