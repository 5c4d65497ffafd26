"""`import desat`: what a program gets and gives."""

from __future__ import annotations

import dataclasses

import pytest

import desat as library
from desat.begin.craft import write
from desat.begin.facts import CraftFacts
from desat.system.errors import DesatError
from desat.system.options import Options, RunOptions

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
    told = [
        library.run(DAY, stop=20.0, sources=given).manifest.digest
        for given in ([f"manager={law}"], {"manager": law})
    ]
    assert told[0] == told[1]


def test_an_option_that_there_is_not_is_named() -> None:
    with pytest.raises(DesatError, match="recrod: no option; did you mean record"):
        library.run(DAY, stop=20.0, recrod=("*",))  # type: ignore[call-arg]


def test_the_options_of_a_program_are_those_of_a_run() -> None:
    own = {"sets", "stop", "step", "values"}
    assert set(RunOptions.__annotations__) == {f.name for f in dataclasses.fields(Options)} - own


def test_a_craft_is_sized_by_a_program(tmp_path) -> None:
    write(tmp_path / "mine", CraftFacts(size="3U"), "")
    made = library.size(str(tmp_path / "mine"), stop=12000.0, year=False, laws=False, flown=False)
    assert made.answer.startswith(str(tmp_path / "mine"))
    assert made.as_json()["least"] > 0.0
