"""The cases of a sizing beside the runs of the same craft."""

from __future__ import annotations

import pytest

from desat.report.cases import craft_digest, find_cases, keep_cases
from desat.system.model import Parameter

SIZING = {
    "answer": "mine holds.",
    "problems": [],
    "margins": [
        {"case": "worst", "of": "wheels", "used": 3.0, "limit": 4.0, "unit": "N.m.s"}
    ],
}


def craft(value):
    return {"wheels": {"inertia": Parameter(value, "kg.m2")}}


@pytest.fixture
def folder(tmp_path):
    sizing = SIZING | {"craft": craft_digest(craft((1.0, 2.0)))}
    keep_cases(tmp_path / "runs" / "size-mine.html", sizing)
    return tmp_path / "runs"


def test_a_craft_has_its_cases_once(folder):
    (cases,) = find_cases(folder, [craft([1.0, 2.0]), craft([3.0]), craft((1.0, 2.0))])
    assert cases.answer == "mine holds."
    assert cases.holds
    assert cases.table.texts()[1][-1] == "25"


def test_another_craft_has_none(folder):
    assert find_cases(folder, [craft([1.0, 2.5])]) == []


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"margins": [1]}'])
def test_what_is_no_sizing_is_passed_over(folder, text):
    (folder / "size-other.json").write_text(text)
    assert len(find_cases(folder, [craft([1.0, 2.0])])) == 1
