"""A log of a craft whose dipole and centre of pressure are known shows both, within
three standard deviations, whatever is wrong with it."""

from __future__ import annotations

import json
import tomllib

import numpy as np
import pytest

import desat as desat_package
from desat.begin.craft import write
from desat.begin.facts import CraftFacts
from desat.campaign.sampling import NINETY
from desat.runs.prepare import prepare
from desat.sizing import sizing
from desat.sizing.requirements import SizingRequirements
from desat.system.errors import DesatError
from desat.system.options import Options
from desat.telemetry import craft_file, fit
from desat.telemetry.log import origin_of, read_log
from tests.telemetry.synthetic import Errors, columns_of, system_of, write_log

DIPOLE, OFFSET = [0.021, -0.033, 0.047], [0.006, 0.0151, -0.0203]
TRUTH = {fit.DIPOLE: DIPOLE, fit.OFFSET: OFFSET}


def fit_of(system, file, **options):
    """Fit a log to a system."""
    return fit.fit(system, read_log(file, origin_of(system.parameters)), **options)


def misses(result, truth):
    """Return the errors of what was observed, in standard deviations."""
    each = []
    for name, value in truth.items():
        x = result.parameters[name]
        each.append(((x.value - value) / x.deviation)[x.is_observed])
    return np.concatenate(each)


def test_dipole_and_offset_are_found(craft, tmp_path):
    file = write_log(tmp_path / "log.csv", *columns_of(craft, TRUTH, 3))
    result = fit_of(system_of(craft), file)
    assert np.abs(misses(result, TRUTH)).max() < 3.0
    dipole, offset = result.parameters[fit.DIPOLE], result.parameters[fit.OFFSET]
    assert dipole.is_observed.all()
    assert np.linalg.norm(dipole.value - DIPOLE) < 0.03 * np.linalg.norm(DIPOLE)
    assert offset.is_observed.tolist() == [False, True, True]
    assert offset.value[0] == pytest.approx(offset.before[0], abs=2e-3)
    along = (
        "offset of the centre of pressure along the direction of flight: not observable"
    )
    assert along in result.unobservable


def test_deviations_say_what_the_errors_are(craft, tmp_path):
    """A log of greater errors has greater deviations; without errors it is exact."""
    system, deviations = system_of(craft), []
    for size in (0.0, 1.0, 5.0):
        errors = Errors(size * 1e-7, size * 2e-3, size + 1e-3, size + 1e-3)
        file = write_log(
            tmp_path / "log.csv", *columns_of(craft, TRUTH, 3, 12000.0, errors)
        )
        result = fit_of(system, file, errors=(size * 1e-7, size * 2e-3))
        if size > 0.0:
            assert np.abs(misses(result, {fit.DIPOLE: DIPOLE})).max() < 3.0
        deviations.append(result.parameters[fit.DIPOLE].deviation.max())
        if size == 0.0:
            error = result.parameters[fit.DIPOLE].value - DIPOLE
            assert np.linalg.norm(error) < 2e-3 * np.linalg.norm(DIPOLE)
    assert deviations == sorted(deviations)


def test_gaps_sparse_rows_and_wanted_attitude(craft, tmp_path):
    """Gaps end a segment; an attitude that is not sent is that of the guidance."""
    system = system_of(craft)
    names, rows = columns_of(craft, TRUTH, 5)
    gaps = np.delete(rows, np.s_[700:900], axis=0)
    gaps[300:340, 2] = np.nan
    without = names[:5] + names[9:], np.delete(rows, range(5, 9), axis=1)
    for table in ((names, gaps), (names, rows[::6]), without):
        file = write_log(tmp_path / "log.csv", *table)
        result = fit_of(system, file)
        assert np.abs(misses(result, {fit.DIPOLE: DIPOLE})).max() < 3.0
        error = result.parameters[fit.DIPOLE].value - DIPOLE
        assert np.linalg.norm(error) < 0.03 * np.linalg.norm(DIPOLE)


def test_the_csv_of_a_run_gives_its_own_values(craft, tmp_path, desat):
    """A log of the closed loop, whose sensors err, shows what the craft has."""
    out = tmp_path / "run"
    desat("run", str(craft), "--stop", "9000", "--csv", "--out", str(out), check=True)
    command = desat(
        "fit", str(craft), str(out / "series.csv"), "--dry-run", "--json", check=True
    )
    answer = json.loads(command.stdout)
    assert answer["written"] is None
    x = answer["parameters"]["spacecraft.residual_dipole_body"]
    miss = np.abs(np.subtract(x["value"], x["before"])) / x["deviation"]
    assert miss.max() < 3.0
    assert max(x["deviation"]) < 0.01 * np.linalg.norm(x["before"])


def test_a_steady_torque_of_a_craft_that_has_one(craft, tmp_path):
    torque, offset = [3e-7, 0.0, -2e-7], [0.012, 0.002, 0.012]
    truth = {fit.DIPOLE: DIPOLE, fit.OFFSET: offset, fit.STEADY: torque}
    file = write_log(tmp_path / "log.csv", *columns_of(craft, truth, 7))
    system = system_of(craft, {fit.STEADY: [1e-7, 1e-7, 1e-7]})
    result = fit_of(system, file)
    assert result.parameters[fit.STEADY].is_observed.any()
    assert np.abs(misses(result, truth)).max() < 3.0


@pytest.fixture(scope="module")
def deep_craft(tmp_path_factory):
    """A craft about the Sun, which points to it."""
    folder = tmp_path_factory.mktemp("deep") / "deep"
    facts = CraftFacts(
        sun="1AU",
        mass="600kg",
        wheels="4 pyramid 15Nms",
        thrusters="4 1N",
        dump="thrusters 70:10",
    )
    write(folder, facts, "")
    return folder


def test_light_across_the_sun_line(deep_craft, tmp_path):
    truth = {fit.OFFSET: [0.03, -0.08, 0.01]}
    table = columns_of(deep_craft, truth, 2, 200000.0)
    result = fit_of(system_of(deep_craft), write_log(tmp_path / "log.csv", *table))
    assert result.parameters[fit.OFFSET].is_observed.tolist() == [True, True, False]
    assert np.abs(misses(result, truth)).max() < 3.0
    line = "offset of the centre of pressure along the Sun line: not observable"
    assert line in result.unobservable


def test_dumps_end_a_segment(deep_craft, tmp_path):
    """Thrusters take momentum out at once; a log need not have their torque."""
    truth = {fit.OFFSET: [0.03, -0.08, 0.01]}
    dumps = {12000: 2.0, 21000: -1.5}
    table = columns_of(deep_craft, truth, 2, 300000.0, dumps=dumps)
    result = fit_of(system_of(deep_craft), write_log(tmp_path / "log.csv", *table))
    assert np.abs(misses(result, truth)).max() < 3.0


# --- the craft file -------------------------------------------------------------------


@pytest.fixture
def own_craft(craft, tmp_path):
    """A copy of the craft."""
    folder = tmp_path / "own"
    folder.mkdir()
    for file in craft.glob("*.toml"):
        (folder / file.name).write_text(file.read_text())
    return folder


def width_of(folder):
    """Return the interval of the momentum of a day, its ends over each other."""
    requirements = SizingRequirements(flown=False, year=False)
    answer = sizing.size(str(folder), Options(), requirements)
    (row,) = [x for x in answer.intervals if "day" in x.title]
    return row.high / row.low


def test_a_fit_goes_into_the_craft_file_and_narrows_its_sizing(
    craft, own_craft, tmp_path, desat
):
    before = (own_craft / "craft.toml").read_text()
    wide = width_of(own_craft)
    file = write_log(tmp_path / "log.csv", *columns_of(craft, TRUTH, 3))
    command = desat("fit", str(own_craft), str(file), check=True)
    assert "worst.toml has its own residual_dipole_body" in command.stderr
    after = (own_craft / "craft.toml").read_text()
    assert (own_craft / "craft.toml.bak").read_text() == before
    lines = [x for x in after.splitlines() if x not in before.splitlines()]
    assert len(lines) == 4
    assert [x for x in before.splitlines() if "#" in x and "body" not in x] == [
        x for x in after.splitlines() if "#" in x and "body" not in x
    ]
    result = fit_of(system_of(craft), file)
    data = tomllib.loads(after)
    offset = result.parameters[fit.OFFSET]
    value = data["parameters"]["spacecraft"][fit.OFFSET]
    width = data["dispersions"]["spacecraft.offset_plates_body"]["plus_minus"]
    assert value[0] == offset.before[0]
    assert value[1:] == pytest.approx(offset.value[1:], rel=1e-4)
    assert width[0] == pytest.approx(NINETY * offset.spread[0], rel=1e-2)
    assert width[1:] == pytest.approx(NINETY * offset.deviation[1:], rel=1e-2)
    assert width_of(own_craft) < 0.5 * wide
    assert prepare(str(own_craft), Options()).or_raise()[0] is not None
    again = desat("fit", str(own_craft), str(file))
    assert again.returncode == 2
    assert "it has a fit of log.csv already" in again.stderr
    assert (own_craft / "craft.toml").read_text() == after
    with pytest.raises(DesatError, match="a fit of log"):
        desat_package.fit(own_craft, file, write=True)
    other = file.with_name("second.csv")
    other.write_bytes(file.read_bytes())
    desat_package.fit(own_craft, other, write=True)
    assert (own_craft / "craft.toml").read_text().count("fit of second.csv") == 4


SOME = """[components]   # what it has
[parameters.spacecraft]
  residual_dipole_body = [
    1.0,   # x
    2.0, 3.0]   # A m2; "given"
rows = [
    [1, 2],
]
"""


def parameter_of(name=fit.DIPOLE):
    """Return a fit of one parameter."""
    x = np.array([1.0, 2.0, 3.0])
    return fit.Fit(
        {name: fit.ParameterFit(name, "A.m2", x, x, 2.0 * x, 0.1 * x, x > 1.5)},
        (),
        0.0,
        0.0,
        1.0,
        (),
    )


def test_values_over_lines_and_tables_that_are_not_there(tmp_path):
    file = tmp_path / "craft.toml"
    file.write_text(SOME)
    craft_file.write_fit(file, parameter_of(), "a.csv")
    data = tomllib.loads(file.read_text())
    assert data["parameters"]["spacecraft"][fit.DIPOLE] == [1.0, 4.0, 6.0]
    assert data["parameters"]["spacecraft"]["rows"] == [[1, 2]]
    widths = data["dispersions"]["spacecraft.residual_dipole_body"]["plus_minus"]
    assert widths == pytest.approx([NINETY, 0.2 * NINETY, 0.3 * NINETY], rel=1e-2)
    assert '# fit of a.csv; before [1, 2, 3]; A m2; "given"' in file.read_text()


@pytest.mark.parametrize(
    "text",
    [
        "dispersions.x = 1\n[parameters]\nspacecraft = { a = 1 }\n",
        SOME + "[dispersions.spacecraft]\nresidual_dipole_body = { factor = 2.0 }\n",
    ],
)
def test_a_file_that_cannot_be_changed_alone_stays(text, tmp_path):
    file = tmp_path / "craft.toml"
    file.write_text(text)
    with pytest.raises(DesatError, match=r"craft\.toml"):
        craft_file.write_fit(file, parameter_of(), "a.csv")
    assert file.read_text() == text
    assert not (tmp_path / "craft.toml.bak").exists()


@pytest.mark.study
def test_ten_crafts(craft, tmp_path):
    """Median error of the dipole at most 3 %, ten of ten within three deviations."""
    system, errors = system_of(craft), []
    for seed in range(10):
        rng = np.random.default_rng(seed + 100)
        direction = rng.standard_normal(3)
        size = 0.045 * rng.uniform(0.6, 1.4)
        dipole = size * direction / np.linalg.norm(direction)
        offset = (
            [0.005, 0.011, 0.018] * rng.uniform(0.4, 1.6, 3) * rng.choice([-1, 1], 3)
        )
        truth = {fit.DIPOLE: dipole, fit.OFFSET: offset}
        file = write_log(tmp_path / "log.csv", *columns_of(craft, truth, seed))
        result = fit_of(system, file)
        assert np.abs(misses(result, truth)).max() < 3.0, seed
        error = result.parameters[fit.DIPOLE].value - dipole
        errors.append(np.linalg.norm(error) / size)
    assert np.median(errors) < 0.03
