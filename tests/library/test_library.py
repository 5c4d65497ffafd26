"""`import desat`: what a program gets and gives."""

from __future__ import annotations

import copy
import dataclasses
import datetime
import doctest
import json
import math
import os
import pickle
import re
import shlex
from fractions import Fraction
from importlib.metadata import version
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from typer.main import get_command

import desat as library
from desat.begin.craft import write
from desat.begin.facts import CraftFacts, Facts
from desat.cli.commands import run as _  # noqa: F401  (registers the command)
from desat.cli.console import app
from desat.components.bases.dumping import TorquerDumping
from desat.components.contract.block import Parameter, Vec3
from desat.components.laws import cross_product
from desat.components.maths.vector import scale
from desat.system.errors import DesatError
from desat.system.options import Options, RunOptions, as_arguments
from desat.system.parameters import parse_assignment
from desat.system.program_values import plain_values
from tests.conftest import ROOT

DAY = "nadir_day/day-dipole"


def test_a_run_says_what_it_is_in_a_line_and_in_a_table() -> None:
    run = library.run(DAY, stop=60.0)
    assert len(repr(run)) <= 1000
    assert repr(run).startswith("<Run nadir_day/day-dipole: completed, ")
    frame = run.numbers
    assert list(frame.columns) == ["title", "value", "unit", "limit", "met"]
    assert set(frame.index) == set(run.manifest.numbers)
    assert frame.loc["pointing", "value"] == run.manifest.numbers["pointing"].value
    assert "<table" in run._repr_html_()


def test_what_is_required_stands_beside_its_number(tmp_path) -> None:
    write(tmp_path / "mine", CraftFacts(size="12U"), "")
    frame = library.run(str(tmp_path / "mine"), stop=600.0).numbers
    assert frame.loc["pointing", "limit"] == "at most 0.2"
    assert frame.loc["pointing", "met"]
    assert frame.loc["final_momentum", "met"] is pd.NA


def test_sources_are_a_mapping_or_texts() -> None:
    law = "manager_cross_product"
    answer = [
        library.run(DAY, stop=20.0, sources=inputs).manifest.digest
        for inputs in ([f"manager={law}"], {"manager": law})
    ]
    assert answer[0] == answer[1]


def test_an_option_that_there_is_not_is_named() -> None:
    with pytest.raises(DesatError, match="recrod: no option; did you mean record"):
        library.run(DAY, stop=20.0, recrod=("*",))  # type: ignore[call-arg]


def test_the_options_of_a_program_are_those_of_a_run() -> None:
    own_value = {"sets", "stop", "step", "values"}
    assert (
        set(RunOptions.__annotations__)
        == {f.name for f in dataclasses.fields(Options)} - own_value
    )


COMMAND_LINE = (
    " --set a.b=1 --set 'w.x=[1.0, 2.0]' --source 'a=my fmus/b.fmu' --stop '2 orbits'"
    " --blocks --fmus python --record 'manager.*' --record 'a b' --every 3"
    " --output-class x.y=state --trust FILE --allow-outside --strict --isolate none"
    " --halve 2 --checkpoint 2.0"
)


def test_the_command_line_of_options_is_one_that_run_takes() -> None:
    options = Options(
        sets=["a.b=1"],
        values={"w.x": [1.0, 2.0]},
        sources=["a=my fmus/b.fmu"],
        stop="2 orbits",
        blocks=True,
        fmus="python",
        record=("manager.*", "a b"),
        every=3,
        output_classes={"x.y": "state"},
        trusted=frozenset(["x"]),
        outside=True,
        strict=True,
        isolate="none",
        halvings=2,
        checkpoint=2.0,
        supervised=True,
    )  # of one kind each
    assert as_arguments(options) == COMMAND_LINE
    assert as_arguments(Options()) == ""
    command = get_command(app).get_command(None, "run")  # type: ignore[arg-type]
    flags = {name for x in command.params for name in x.opts}
    assert {x for x in shlex.split(COMMAND_LINE) if x.startswith("--")} <= flags
    for field in dataclasses.fields(Options):
        name = field.metadata.get("option", field.name.replace("_", "-"))
        assert not name or f"--{name}" in flags, field.name


def test_a_craft_is_sized_by_a_program(tmp_path) -> None:
    write(tmp_path / "mine", CraftFacts(size="3U"), "")
    sizing = library.size(
        str(tmp_path / "mine"), stop=12000.0, year=False, laws=False, flown=False
    )
    assert sizing.answer.startswith(str(tmp_path / "mine"))
    assert sizing.as_json()["least"] > 0.0


def test_the_examples_of_the_docstrings_are_right() -> None:
    answer = doctest.testmod(library, optionflags=doctest.ELLIPSIS)
    assert answer.failed == 0
    assert answer.attempted >= 9


def test_series_of_a_kind_share_their_dimension() -> None:
    run = library.run(DAY, stop=60.0)
    ds = run.data
    lacking = ds["wheels.h_wheel"] - ds["tachometers.h_meas_wheel"]
    assert lacking.dims == ("time", "wheel")
    assert lacking.shape == (61, 4)
    assert bool(lacking[:-1].notnull().all())
    assert bool(lacking[-1].isnull().all()), "nothing is measured after the end"
    assert list(ds["wheels.h_wheel"].wheel) == [1, 2, 3, 4]
    assert list(ds["environment.b_eci"].axis) == ["x", "y", "z"]
    assert ds["torquers.m_mean_body"].dims == ("interval", "axis")
    assert float(ds.interval[0]) == 0.5
    for rows in (slice(None), slice(3, 50, 7), slice(None, None, -1), 60, -1, [0, 60]):
        full = ds["tachometers.h_meas_wheel"].values
        assert np.array_equal(
            ds["tachometers.h_meas_wheel"][rows].values, full[rows], True
        )
    frame = ds[["wheels.h_wheel", "wheels.speed_wheel"]].to_dataframe()
    assert len(frame) == 61 * 4
    frame = ds.to_dataframe()
    assert len(frame) == 61
    assert (
        frame["wheels.h_wheel[2]"].tolist()
        == run["wheels.h_wheel"][:, 1].values.tolist()
    )
    means = frame["torquers.m_mean_body[z]"]
    assert means.tolist()[:-1] == run["torquers.m_mean_body"][:, 2].values.tolist()
    assert math.isnan(means.iloc[-1])


def test_a_run_is_a_mapping_of_its_series() -> None:
    with library.run(DAY, stop=pd.Timedelta("1min")) as flight:
        assert flight.manifest.end_time == 60.0
        assert "wheels.h_wheel" in flight
        assert "wheels.h" not in flight
        assert list(flight) == flight.keys() == flight.results.names()
        two = flight[["wheels.h_wheel", "torquers.m_mean_body"]]
        assert list(two.data_vars) == ["wheels.h_wheel", "torquers.m_mean_body"]
        with pytest.raises(library.DesatError, match=r"no series wheels\.h; did you"):
            flight[["wheels.h_wheel", "wheels.h"]]
    for span in (datetime.timedelta(seconds=30), np.timedelta64(30, "s")):
        assert library.run(DAY, stop=span).manifest.end_time == 30.0


def test_runs_are_taken_where_targets_are() -> None:
    runs = [
        library.run(DAY, {"manager.gain": gain}, stop=6000.0) for gain in (1e-3, 2e-3)
    ]
    comparison = library.compare(*runs)
    assert list(comparison.numbers.columns[2:4]) == [DAY, f"{DAY} (1)"]
    assert (
        comparison.numbers.loc["pointing", DAY]
        == runs[0].numbers.loc["pointing", "value"]
    )
    least = library.bound(runs[0])
    assert 0.0 < least.least < least.energy
    assert len(runs[0]["time"]) == 6001, "its series are still there"


def test_sweeps_and_sizings_have_tables() -> None:
    axes = {"manager.gain": [1e-3, 2e-3], "torquers.m_limit": [1.0, 2.0]}
    sweep = library.sweep(DAY, axes, stop=60.0)
    assert len(sweep) == len(sweep.to_dataframe()) == 4
    assert len(repr(sweep)) < 200
    answer = sweep.to_xarray()
    assert answer["manager.gain"].attrs["units"] == "1/s"
    assert dict(answer.sizes) == {"manager.gain": 2, "torquers.m_limit": 2}
    assert answer["pointing"].attrs["units"] == "deg"
    row = answer["pointing"].sel({"manager.gain": 2e-3, "torquers.m_limit": 1.0})
    flight = library.run(
        DAY, {"manager.gain": 2e-3, "torquers.m_limit": 1.0}, stop=60.0
    )
    assert float(row) == flight.numbers.loc["pointing", "value"]
    sizing = library.size(DAY, stop="2 orbits", year=False, laws=False, flown=False)
    assert sizing.numbers.loc["Secular torque", "unit"] == "N.m"
    assert sizing.numbers.loc["Secular torque", "value"] == pytest.approx(
        np.linalg.norm(sizing.secular)
    )


def test_a_run_plots_what_is_named(tmp_path) -> None:
    run = library.run(DAY, stop=60.0)
    assert run.plot("momentum").svg() == run.plot("momentum")._repr_svg_()
    run.plot("wheels.h_wheel", tmp_path / "h.png")
    assert (tmp_path / "h.png").read_bytes()[1:4] == b"PNG"
    run.plot(file=tmp_path / "h.svg")
    assert "<svg" in (tmp_path / "h.svg").read_text(encoding="utf-8")
    with pytest.raises(
        DesatError, match="no plot and no series; did you mean momentum"
    ):
        run.plot("momentun")
    with pytest.raises(DesatError, match=r"written as \.svg, \.png or \.pdf"):
        run.plot("momentum", tmp_path / "h.gif")


@pytest.mark.slow
def test_a_craft_is_begun_compared_and_tuned_by_a_program(tmp_path) -> None:
    craft = str(library.new(tmp_path / "mine", size="3U", altitude="500km"))
    with pytest.raises(
        DesatError, match="altitud: no fact of a craft; did you mean altitude"
    ):
        library.new(tmp_path / "other", altitud="500km")  # type: ignore[call-arg]
    assert set(Facts.__annotations__) == {
        f.name for f in dataclasses.fields(CraftFacts)
    }
    assert library.scenario(craft).loc["stop", "value"] == 86400.0
    comparison = library.compare(craft, f"{craft}/worst.toml", stop=120.0)
    frame = comparison.numbers
    assert frame.loc["pointing", f"less {craft}/worst.toml"] == (
        frame.loc["pointing", craft] - frame.loc["pointing", f"{craft}/worst.toml"]
    )
    ranking = library.compare(craft, laws=["ccpl"], by="peak", stop=600.0)
    assert "least fill" in ranking.answer
    assert len(ranking.numbers) == 2
    tuning = library.tune(
        craft, "manager.gain", "coil_duty", stop=60.0, count=1, unseen=6
    )
    assert tuning.best < tuning.own
    for result in (comparison, ranking, tuning):
        assert len(repr(result)) <= 1000


def test_each_public_name_is_on_the_page_of_python() -> None:
    page = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    page_names = set(re.findall(r":: desat\.(\w+)", page))
    assert page_names == set(library.__all__)


# --- what a program gives -------------------------------------------------------------


@pytest.mark.parametrize(
    "value",
    [
        [1e-3, 2e-3, 3e-3, 0.0],
        (1e-3, 2e-3, 3e-3, 0.0),
        np.array([1e-3, 2e-3, 3e-3, 0.0]),
        pd.Series([1e-3, 2e-3, 3e-3, 0.0]),
        pd.Series([2e-3, 1e-3, 0.0, 3e-3], index=[2, 1, 4, 3]),
        pd.Series([0.0, 1e-3, 2e-3, 3e-3], index=list("wxyz")),
        xr.DataArray([1e-3, 2e-3, 3e-3, 0.0], dims="wheel"),
        [np.float64(1e-3), 2e-3, np.int64(0) + 3e-3, 0],
    ],
)
@pytest.mark.parametrize("is_nested", [True, False])
def test_values_are_given_as_programs_have_them(value, is_nested) -> None:
    name = "h_start_wheel"
    sets = {"wheels": {name: value}} if is_nested else {f"wheels.{name}": value}
    run = library.run(DAY, sets, stop=2.0)
    assert run["wheels.h_wheel"][0].values.tolist() == [1e-3, 2e-3, 3e-3, 0.0]


def test_numbers_of_numpy_are_numbers() -> None:
    sets = {"manager.gain": np.float64(2e-3), "magnetometer.seed": np.int64(3)}
    sets["manager.enable"] = np.bool_(False)
    case = library.prepare(DAY, Options(values=plain_values(sets)))
    system = case.or_raise()[0]
    values = system.components["manager"].values
    assert (values["gain"], values["enable"]) == (2e-3, False)
    assert system.components["magnetometer"].values["seed"] == 3


@pytest.mark.parametrize(
    ("sets", "message"),
    [
        (
            {"wheels.h_start_wheel": pd.Series([0.0] * 4, index=list("abcd"))},
            "wheels.h_start_wheel: a Series labelled a, b, c, d: allowed is x, y, z, w, or "
            "0 to 3, or 1 to 4",
        ),
        (
            {"wheels.h_start_wheel": pd.Series([0.0] * 4, index=[1, 1, 2, 3])},
            "a Series labelled 1, 1, 2, 3: allowed is",
        ),
        ({"wheels.h_start_wheel": np.zeros(3)}, "needs 4 values, got 3"),
        (
            {"wheels.h_start_wheel": np.zeros((2, 2))},
            "wheels.h_start_wheel has no rows: a list of 4 values is needed",
        ),
        (
            {"wheels.axes_wheel": np.ones((4, 3))},
            "wheels.axes_wheel has rows of 4 values, got rows of 3",
        ),
        (
            {"wheels.axes_wheel": [[1.0] * 4, [1.0] * 4, [1.0] * 3 + [0.0, 1.0]]},
            "rows of 4 values, got rows of 4 and 5",
        ),
        ({"wheels": {"h_strt_wheel": 1.0}}, "did you mean h_start_wheel"),
        (
            {"wheels": {"h": {"x": 1.0}}},
            "sets: wheels.h: a mapping holds the variables of a component",
        ),
        (
            {"manager.gain": 1.0, "manager": {"gain": 1.0}},
            "sets: manager.gain is given twice",
        ),
        ({"manager.gain": object()}, "manager.gain: a object is given"),
        ({3: 1.0}, "sets: 3: a text is needed"),
        (["manager.gain"], "sets: a list is given; a mapping of"),
    ],
)
def test_values_of_another_form_are_named(sets, message) -> None:
    with pytest.raises(DesatError) as error:
        library.run(DAY, sets, stop=2.0)
    assert message in str(error.value)


def test_near_names_are_those_of_the_call_too() -> None:
    with pytest.raises(DesatError, match="stpo: no option; did you mean stop"):
        library.run(DAY, stpo=2.0)  # type: ignore[call-arg]


def test_a_run_gives_its_series_in_every_form(tmp_path) -> None:
    run = library.run(DAY, stop=60.0, folder=tmp_path / "a")
    assert run["wheels.h_wheel"].shape == (61, 4)
    with pytest.raises(DesatError, match=r"no series wheels\.h_weel; did you mean"):
        run["wheels.h_weel"]
    frame = run.to_dataframe()
    (path,) = library.export(run, "parquet", tmp_path / "b")
    names = [frame.index.name, *frame.columns]
    assert names == pd.read_parquet(path).columns.tolist()
    assert np.array_equal(
        frame["wheels.h_wheel[2] [N.m.s]"], run["wheels.h_wheel"][:, 1]
    )
    means = frame["torquers.m_mean_body[3] [A.m2]"]
    assert np.array_equal(means[:-1], run["torquers.m_mean_body"][:, 2])
    assert np.isnan(means.iloc[-1])
    assert len(run) == len([*run.values()]) == len(dict(run.items())) == len([*run])
    for original in (run, library.run(DAY, stop=60.0)):  # in a file, and in memory
        for duplicate in (
            pickle.loads(pickle.dumps(original)),
            copy.deepcopy(original),
        ):
            assert duplicate.to_xarray().equals(pickle.loads(pickle.dumps(run.data)))
    assert library.export(tmp_path / "a", "csv") == [tmp_path / "a" / "series.csv"]
    assert run.write_report() == tmp_path / "a" / "report.html"
    run.data.to_netcdf(tmp_path / "a.nc")
    again = xr.open_dataset(tmp_path / "a.nc")
    assert np.array_equal(again["wheels.h_wheel"], run["wheels.h_wheel"])
    assert again["manager.mode"].attrs["choices"].startswith("idle, ")
    stored_run = library.load(tmp_path / "a")
    assert isinstance(stored_run, library.Run)
    assert (
        stored_run["wheels.h_wheel"].values.tolist()
        == run["wheels.h_wheel"].values.tolist()
    )
    assert stored_run.numbers.equals(run.numbers)


@pytest.mark.parametrize(
    "epoch",
    [
        *("2026-03-20T12:00", "2026-03-20T12:00:00Z", pd.Timestamp("2026-03-20T12:00")),
        *(np.datetime64("2026-03-20T12:00"), np.datetime64("2026-03-20T12:00", "ns")),
        *(pd.Timestamp("2026-03-20T14:00", tz="Africa/Cairo"), 827280000.0),
    ],
    ids=repr,
)
@pytest.mark.parametrize("name", ["epoch", "shared.epoch_j2000"])
def test_a_flight_is_at_the_date_that_is_given(name, epoch) -> None:
    flight = library.run(DAY, {name: epoch}, stop=2.0)
    assert flight.data.attrs["epoch"] == "2026-03-20T12:00:00+00:00"


@pytest.mark.parametrize(
    "duration",
    [
        *(pd.Timedelta("20s"), datetime.timedelta(seconds=20)),
        *(np.timedelta64(20, "s"), np.timedelta64(20_000_000_000, "ns")),
    ],
    ids=repr,
)
def test_a_duration_is_a_value_in_its_unit(duration) -> None:
    flight = library.run(DAY, {"manager.sample_time": duration}, stop=60.0)
    assert flight.manifest.parameters["manager"]["sample_time"].value == 20.0
    with pytest.raises(DesatError, match=r"s is no unit of manager\.gain"):
        library.run(DAY, {"manager.gain": duration}, stop=60.0)


@pytest.mark.parametrize("name", ["stop", "step"])
def test_arguments_among_the_values_are_named(name) -> None:
    with pytest.raises(DesatError, match=f"sets: {name}: it is an argument: {name}=2"):
        library.run(DAY, {name: 2})
    assert parse_assignment(f"{name}.x=2") == (name, "x", 2)  # of a component
    with pytest.raises(DesatError, match=f"no component {name}"):
        library.run(DAY, {f"{name}.x": 2}, stop=2.0)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: library.run(DAY, stop=-5.0), "stop -5, "),
        (lambda: library.run(DAY, sources={"manager": "no.fmu"}), "sources manager="),
        (lambda: library.new(os.curdir, size="12U"), "it exists; force writes"),
        (lambda: library.cases(DAY, 3, "c", curves=["no"]), "curves no: no plot"),
        (lambda: library.new("x", residual_dipole="1,2"), "residual_dipole 1,2: "),
    ],
)
def test_messages_are_in_the_words_of_python(call, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DesatError) as error:
        call()
    assert message in str(error.value)
    assert "--" not in str(error.value)


def test_numbers_without_a_requirement_are_told_from_those_with_one(tmp_path) -> None:
    library.new(tmp_path / "c", size="12U", altitude=500e3, inclination=0.9, rods=0.2)
    numbers = library.run(tmp_path / "c", {"manager.gain": 1e-9}, stop=6000.0).numbers
    with_limit = numbers.dropna(subset=["limit"])
    assert list(with_limit.index) == ["pointing", "largest_momentum", "coil_duty"]
    assert numbers[~numbers.met].index.isin(with_limit.index).all()
    assert numbers.met.isna().sum() == len(numbers) - len(with_limit)


def test_values_may_be_a_row_of_a_table_and_series_are_written_to() -> None:
    row = pd.DataFrame({"manager.gain": [1e-3, 2e-3]}).loc[1]
    flight = library.run(DAY, row, stop=2.0)
    assert flight.manifest.parameters["manager"]["gain"].value == 2e-3
    first = flight["wheels.h_wheel"]
    first[:] = 0.0
    first.values[0] = 1.0
    assert flight["wheels.h_wheel"][0].values.tolist() != [1.0] * 4
    with pytest.raises(DesatError, match="sets: a DataFrame is given"):
        library.run(DAY, pd.DataFrame({"manager.gain": [1e-3]}), stop=2.0)


def test_an_unknown_series_is_a_key_error() -> None:
    flight = library.run(DAY, stop=2.0)
    with pytest.raises(KeyError) as error:
        flight["wheels.h_weel"]
    assert isinstance(error.value, DesatError)
    assert "did you mean wheels.h_wheel?" in str(error.value)


def test_the_page_of_python_works_as_it_says(tmp_path, monkeypatch) -> None:
    page = (ROOT / "docs" / "python.md").read_text()
    (snippet,) = re.findall(r"```python\n(.*?)```", page, re.S)
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    exec(snippet, names)
    commands, means = (
        names["run"]["manager.m_cmd_body"],
        names["run"]["torquers.m_mean_body"],
    )
    assert (commands.shape, means.shape) == ((600, 3), (600, 3))  # without a nan
    assert commands.time[-1] == 599.0
    assert means.interval[-1] == 599.5
    assert {"momentum.svg", "page", "runs", "my12u"} <= {*os.listdir()}


@pytest.mark.parametrize(
    "stop",
    [
        *(np.int64(60), np.int32(60), np.uint8(60), np.float32(60.0), np.array(60.0)),
        *(Fraction(60), pd.Series([60])[0], xr.DataArray(60)),
        *("1min", "60 s", np.timedelta64(1, "m")),
    ],
    ids=repr,
)
def test_a_time_is_that_of_any_library(stop) -> None:
    """None is ignored, and one without its unit is none."""
    run = library.run(DAY, stop=stop, step=np.float32(0.5), every=np.int64(2))
    assert run["time"].values.tolist() == [*map(float, range(61))]
    assert run.manifest.step == 0.5
    if not isinstance(stop, str):  # what `run` makes plain is refused elsewhere
        with pytest.raises(DesatError, match="a time in s is needed"):
            Options(stop=stop)  # type: ignore[arg-type]


def test_numbers_and_dates_of_any_library_are_taken(tmp_path) -> None:
    sweep = library.sweep(
        "integrated/mil-nadir",
        {"manager.gain": np.array([1e-3])},
        stop=np.int64(10),
        samples=np.int64(2),
        seed=np.int64(3),
    )
    assert json.dumps(sweep.to_json())
    craft = library.new(
        tmp_path / "c",
        size="12U",
        altitude=np.float32(4e5),
        epoch=np.datetime64("2027-03-20T12:00"),
    )
    assert "2027-03-20" in (craft / "craft.toml").read_text()
    runs = [library.run(str(craft), stop=np.float32(t)) for t in (10.0, 20.0)]
    assert library.compare(runs).numbers.equals(library.compare(*runs).numbers)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"stop": "soon"}, "stop soon: a number is needed"),
        ({"stop": "60 m"}, "stop 60 m: "),
        ({"step": "2 orbits"}, "step 2 orbits: "),
        ({"stop": [60.0]}, r"stop = \[60.0\]: a time in s is needed"),
        ({"parameters": {}}, r"parameters: no option.*sets=\{'component.variable'"),
    ],
)
def test_a_call_that_is_wrong_says_what_is_taken(options, message) -> None:
    with pytest.raises(DesatError, match=message):
        library.run(DAY, **options)


def test_a_run_in_memory_needs_a_folder_for_files(tmp_path) -> None:
    run = library.run(DAY, stop=20.0)
    for write_file in (run.write_report, lambda: library.export(run)):
        with pytest.raises(DesatError, match="series are in memory: the folder"):
            write_file()
    assert run.write_report(tmp_path / "x").is_file()
    assert library.export(run, "mat", tmp_path / "x")[0].is_file()


def test_what_commands_do_programs_do(tmp_path, monkeypatch) -> None:
    assert library.__version__ == version("desat")
    assert library.check(DAY).problems == []
    slow = library.check(DAY, {"magnetometer.sample_time": 1.5})
    assert any("sample_time" in problem for problem in slow.problems)
    with pytest.raises(
        DesatError, match=r"manager\.gain = -1 1/s: allowed is 0 to inf"
    ):
        library.check(DAY, {"manager.gain": -1.0})
    least = library.bound("uosat12/table3-ocdc-ilqr-1")
    assert 0.0 < least.least <= least.seconds
    sweep = library.sweep(DAY, {"manager.gain": np.array([1e-3, 2e-3])}, stop=60.0)
    assert sweep.numbers.shape[0] == 2
    assert sweep.numbers["pointing"].notna().all()
    monkeypatch.chdir(tmp_path)
    cases = library.campaign(DAY, 2, stop=20.0)
    assert cases.sizes["case"] == 2
    assert (tmp_path / "runs/campaign-nadir_day-day-dipole/report.html").is_file()
    library.run(DAY, stop=2.0, folder=tmp_path / "d")
    with pytest.raises(DesatError, match="curves: it is no campaign"):
        library.load(tmp_path / "d", curves=True)


# --- a class as a source --------------------------------------------------------------

HALF = 0.5


def half_of(h: Vec3) -> Vec3:
    return scale(HALF, h)


class HalfLaw(TorquerDumping):
    """Half of what h says."""

    gain: float = Parameter("1/s", "gain", start=1e-3)

    def dipole(self, elapsed_time: float, h: Vec3) -> Vec3 | None:
        return cross_product.normalised(half_of(h), self.b_body, math.fabs(self.gain))


def test_a_class_is_a_source() -> None:
    """With the function, the constant and the imports that it uses."""
    mine = library.run(
        DAY, {"manager.gain": 2e-3}, stop=60.0, sources={"manager": HalfLaw}
    )
    ours = library.run(
        DAY,
        {"manager.gain": 1e-3},
        stop=60.0,
        sources={"manager": "manager_cross_product"},
    )
    m = mine["manager.m_cmd_body"]
    assert m.any()
    assert m.values == pytest.approx(ours["manager.m_cmd_body"].values, rel=1e-12)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (int, "sources: manager: int is no block"),
        (
            type("Mine", (TorquerDumping,), {"__module__": __name__}),
            "Mine: its source is not known: write the class to a file",
        ),
    ],
)
def test_classes_that_are_no_source_are_named(source, message) -> None:
    with pytest.raises(DesatError, match=message):
        library.run(DAY, stop=2.0, sources={"manager": source})
