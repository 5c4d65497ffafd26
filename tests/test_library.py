"""`import desat`: what a program gets and gives."""

from __future__ import annotations

import dataclasses
import doctest
import shlex

import numpy as np
import pytest
from conftest import ROOT
from typer.main import get_command

import desat as library
from desat.begin.craft import write
from desat.begin.facts import CraftFacts, Facts
from desat.cli.commands import run as _  # noqa: F401  (registers the command)
from desat.cli.console import app
from desat.system.errors import DesatError
from desat.system.options import Options, RunOptions, as_arguments

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
    assert frame.loc["pointing", "met"] is True
    assert frame.loc["final_momentum", "met"] is None


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
    known = {name for x in command.params for name in x.opts}
    assert {x for x in shlex.split(COMMAND_LINE) if x.startswith("--")} <= known
    for declared in dataclasses.fields(Options):
        name = declared.metadata.get("option", declared.name.replace("_", "-"))
        assert not name or f"--{name}" in known, declared.name


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
    compared = library.compare(craft, f"{craft}/worst.toml", stop=120.0)
    frame = compared.numbers
    assert frame.loc["pointing", f"less {craft}/worst.toml"] == (
        frame.loc["pointing", craft] - frame.loc["pointing", f"{craft}/worst.toml"]
    )
    ranked = library.compare(craft, laws=["ccpl"], by="peak", stop=600.0)
    assert "least fill" in ranked.answer
    assert len(ranked.numbers) == 2
    tuned = library.tune(
        craft, "manager.gain", "coil_duty", stop=60.0, count=1, unseen=6
    )
    assert tuned.best < tuned.own
    for result in (compared, ranked, tuned):
        assert len(repr(result)) <= 1000


def test_each_public_name_is_on_the_page_of_python() -> None:
    page = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    assert [n for n in library.__all__ if f":: desat.{n}\n" not in page] == []
