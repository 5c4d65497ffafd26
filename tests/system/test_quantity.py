"""What is typed as a number is finite, of a unit that fits and within its range; an
option that would be ignored is refused by its name."""

from __future__ import annotations

import shlex
import tomllib
from pathlib import Path

import pytest

from desat.begin.craft import write
from desat.begin.facts import CraftFacts
from desat.runs.new_craft import write_craft
from desat.sizing.requirements import SizingRequirements
from desat.system.errors import DesatError
from desat.system.quantity import Quantity
from tests.fuzz import commands

TLE = commands.TLE


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    result = tmp_path_factory.mktemp("quantities")
    commands.prepare(result)
    return result


@pytest.mark.parametrize(
    ("values", "value"),
    [("5", 5.0), ("5 km", 5.0), ("5000m", 5.0), (" .5e1 ", 5.0), (5.0, 5.0), (3, 3.0)],
)
def test_a_quantity_is_a_number_with_its_unit_or_without(values, value):
    assert Quantity("--x", "km", 1.0, 9.0)(values) == value


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ("inf", "--x inf: a number is needed, with its unit or in km"),
        ("nan", "--x nan: a number is needed, with its unit or in km"),
        ("1e309", "--x 1e309: a finite number 1 or more is needed, 9 km at most"),
        (float("inf"), "--x inf: a finite number 1 or more is needed, 9 km at most"),
        (float("nan"), "--x nan: a finite number 1 or more is needed, 9 km at most"),
        ("10", "--x 10: 1 to 9 km are covered"),
        ("1e300 m", "--x 1e300 m: 1 to 9 km are covered"),
        ("5 s", "--x 5 s: s does not fit km"),
        ("5 kmm", "--x 5 kmm: unit kmm is not known"),
        ("", "--x : a number is needed"),
    ],
)
def test_what_is_none_is_refused_with_the_option(values, message):
    with pytest.raises(DesatError) as refusal:
        Quantity("--x", "km", 1.0, 9.0)(values)
    assert str(refusal.value).startswith(message)


REFUSED = {
    "new craft x --residual-dipole 1e309": "--residual-dipole 1e309: a finite number",
    "new craft x --mass 1e309kg": "--mass 1e309kg: a finite number",
    "new craft x --box 1,1,1e309": "--box 1,1,1e309: a finite number",
    "new craft x --inertia 1,1e309,1e309": "--inertia 1,1e309,1e309: a finite number",
    "new craft x --wheels '3 axes 1e309Nms'": "--wheels 1e309Nms: a finite number",
    "new craft x --thrusters '7 1N'": "--thrusters 7: 4 are pairs both ways about each axis",
    "new craft x --epoch 1000-01-01": "--epoch 1000-01-01: a year from 1957 to 2056 is needed",
    "new craft x --tle iss.tle --inclination 10deg": "--inclination 10deg: --tle iss.tle says the",
    "new craft x --tle iss.tle --ltan 10:30": "--ltan 10:30: --tle iss.tle says the orbit",
    "new craft x --tle iss.tle --altitude 400km": "--altitude, --tle: only one of them may define the orbit",
    "new craft x --tle iss.tle --epoch 2027-01-01": "x/nominal.toml: epoch: environment: epoch_j2000: ",
    "new craft 'a\"b'": 'a"b: a name of letters, digits, blanks and . _ + - is needed',
    "size mine --margin inf": "--margin inf: a number is needed",
    "size mine --margin 1e300": "--margin 1e300: a factor of 1 or more is needed, 100 at most",
    "size mine --duty nan": "--duty nan: a number is needed",
    "size mine --tip-off inf": "--tip-off inf: a number is needed",
    "size mine --arm 1e300": "--arm 1e300: a number above 0 is needed, 100 m at most",
    "size mine --isp nan": "--isp nan: a number is needed",
    "size mine --slew 60/inf": "--slew inf: a number is needed",
    "size mine --map --altitudes 4": "--altitudes 4: 150 to 2000 km are covered",
    "size mine --map --inclinations 1e300": "--inclinations 1e300: 0 to 180 deg are covered",
    "size mine --map --rods 1e309": "--rods 1e309: a finite number above 0 are needed",
    "size mine --map --dipoles -1": "--dipoles -1: 0 to 10000 A.m2 are covered",
    "size mine --map --slew 60/300": "--slew: a map has none of it",
    "size mine --map --no-year": "--year: a map has none of it",
    "size mine --rods 1": "--rods: it belongs to --map",
    "size mine --map --wheels 1": "--wheels: it is of dumps by thrusters, and this craft has none",
    "tune mine manager.gain --for peak --between 1e-4,inf": "--between 1e-4,inf: numbers are",
    "tune mine manager.gain --for peak --between 1,1e309": "--between 1,1e309: a finite number",
    "compare mine mine --seed 3": "--seed: it goes with -n",
    "compare mine mine --accuracy 1e300": "--accuracy 1e300: above 0 is needed, 0.1 rad at most",
    "sweep mine manager.gain=1 --seed 3": "--seed: it goes with --samples",
    "run mine --stop nan": "--stop nan: a number is needed",
    "run mine --call-limit inf": "--call-limit inf: a number is needed",
    "run mine --time-limit 1e300": "--time-limit 1e300: above 0 is needed, 1e+07 s at most",
    "run mine --checkpoint nan": "--checkpoint nan: a number is needed",
    "campaign mine --case-limit inf": "--case-limit inf: a number is needed",
    "export c magnetometer --compiler '\"'": '--compiler ": no closing quotation',
    "export c magnetometer --compiler ''": "--compiler: an empty text is given",
}


@pytest.mark.parametrize("line", REFUSED)
def test_what_is_typed_and_means_nothing_is_a_line(folder, line):
    code, message = commands.run_line(shlex.split(line), folder)
    assert (code, message.strip().count("\n")) == (2, 0), message
    assert message.startswith(f"error: {REFUSED[line]}")
    assert not (folder / "x").exists()


def test_a_compiler_of_the_environment_that_is_no_command_is_a_line(
    folder, monkeypatch
):
    from desat.fmus.compiler import NoCompilerError, compiler

    monkeypatch.setenv("CC", '"')
    compiler.cache_clear()
    try:
        with pytest.raises(NoCompilerError, match='CC = ": no closing quotation'):
            compiler()
    finally:
        compiler.cache_clear()


@pytest.mark.parametrize(
    "wish", ["margin", "arm", "specific_impulse", "tip_off", "slew_time"]
)
@pytest.mark.parametrize("value", [float("inf"), float("nan"), 1e300])
def test_a_program_is_refused_the_same(wish, value):
    with pytest.raises(DesatError):
        SizingRequirements(
            **{wish: value, **({"slew_angle": 1.0} if wish == "slew_time" else {})}
        )


def test_the_epoch_of_a_craft_is_that_of_its_elements(tmp_path):
    file = tmp_path / "iss.tle"
    file.write_text(TLE)
    write(tmp_path / "mine", CraftFacts(tle=file), "")
    result = tomllib.loads((tmp_path / "mine" / "nominal.toml").read_text())
    assert (
        result["epoch"].isoformat() == "2019-12-09T16:38:29+00:00"
    )  # day 343.69339541
    for epoch, line_count in (
        (None, 0),
        ("2019-12-12", 0),
        ("2019-12-20T00:00:00Z", 1),
    ):
        facts = CraftFacts(tle=file, epoch=epoch)
        _, warnings = write_craft(tmp_path / "mine", facts, "", force=True)
        text = "the run is 11 days after the epoch of its elements"
        assert sum(text in line for line in warnings) == line_count
    with pytest.raises(
        DesatError,
        match=r"the run is 70 days before the epoch of its elements .*"
        r"SGP4 is not valid beyond 30 days",
    ):
        write_craft(tmp_path / "other", CraftFacts(tle=file, epoch="2019-10-01"), "")
    assert not (tmp_path / "other").exists()


def test_numbers_have_units_on_the_command_line(folder):
    code, message = commands.run_line(
        shlex.split("run mine --blocks --stop '2000 ms' --step 1 --substeps 1 --json"),
        folder,
    )
    assert code in (0, 1), message
    assert '"steps_done": 2' in message


def test_times_are_days_too() -> None:
    stop = Quantity("--stop", "s")
    assert (stop("20d"), stop("6h"), stop("90 min"), stop("5")) == (
        1728000.0,
        21600.0,
        5400.0,
        5.0,
    )
    with pytest.raises(DesatError, match="d is not known"):
        Quantity("--mass", "kg")("3d")
