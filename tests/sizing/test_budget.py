"""The momentum budget of a craft: one sheet in five formats."""

from __future__ import annotations

import csv
import sys
from dataclasses import replace

import pytest

from desat.begin.craft import write
from desat.begin.facts import CraftFacts
from desat.report.cases import Margin
from desat.sizing import budget, dumps
from desat.sizing.requirements import SizingRequirements
from desat.system.errors import DesatError, Exit
from desat.system.options import Options


@pytest.fixture(scope="module")
def craft(tmp_path_factory):
    folder = tmp_path_factory.mktemp("budget") / "deep_space"
    facts = CraftFacts(
        sun="1AU",
        mass="600kg",
        wheels="4 pyramid 15Nms",
        thrusters="4 1N",
        dump="thrusters 70:10",
        propellant="5kg",
    )
    write(folder, facts, "")
    return folder


@pytest.fixture(scope="module")
def sizing(craft):
    requirements = SizingRequirements(flown=False, year=False)
    return dumps.size(str(craft), Options(), requirements)


@pytest.mark.study
def test_every_format_has_the_numbers(craft, sizing):
    sheet = budget.budget_of(sizing, "abc", craft)
    assert sheet.holds
    worst = sizing.margins[0]
    for form, make in budget.FORMATS.items():
        content = make(sheet)
        if form == "pdf":
            assert content.startswith(b"%PDF")
            continue
        assert sheet.title.replace("_", "\\_" if form == "tex" else "_") in content
        assert f"{100.0 * worst.margin:.3g}" in content
        assert "what is assumed" in content
    rows = list(csv.reader(budget.as_csv(sheet).splitlines()))
    (inertia,) = [row for row in rows if row[:1] == ["dispersions spacecraft.inertia"]]
    assert inertia[1] == "{ factor = 1.5 }"
    assert inertia[2].startswith("a homogeneous body of 600 kg")


def test_needs_grow_by_the_users_factor(craft, sizing):
    """Propellant leaves most of the tank; wheels have 12 % from where dumps begin."""
    sheet = budget.budget_of(sizing, "abc", craft, factor=1.2)
    assert not sheet.holds
    assert sheet.answer.endswith("Needs times 1.2: it does not hold.")
    assert "--margin-factor 1.2" in sheet.source
    used = [m.used for m in sizing.margins if m.of == "wheels"]
    (row,) = [r for r in sheet.tables[0].texts() if r[1] == "wheels"]
    assert float(row[2]) == pytest.approx(1.2 * used[0], rel=1e-3)


def test_a_notebook_shows_the_answer_and_the_cases(sizing):
    text = sizing._repr_html_()
    assert sizing.answer in text
    assert "<td>where a dump begins</td><td>wheels</td>" in text
    assert "<td>Time between dumps</td>" in text


def test_texts_are_escaped(craft, sizing):
    odd = Margin("a_case with 5 % & more | pipes", "wheels", 1.0, 2.0, "N.m.s")
    sheet = budget.budget_of(replace(sizing, margins=(odd,)), "abc", craft)
    assert r"a\_case with 5 \% \& more | pipes" in budget.as_tex(sheet)
    assert r"a_case with 5 % & more \| pipes" in budget.as_markdown(sheet)
    assert "5 % &amp; more" in budget.as_html(sheet)


def test_without_the_library_pdf_is_refused(craft, sizing, monkeypatch):
    monkeypatch.setitem(sys.modules, "fpdf", None)
    sheet = budget.budget_of(sizing, "abc", craft)
    with pytest.raises(DesatError, match=r"needs fpdf2: pip install 'desat\[pdf\]'"):
        budget.as_pdf(sheet)


def test_the_command_writes_a_sheet(craft, desat):
    outcome = desat("budget", str(craft), "--no-loop", "--format", "md", cwd=craft)
    assert outcome.returncode == 0, outcome.stderr
    text = (craft / "runs/budget-deep_space.md").read_text()
    assert text.startswith("# Momentum budget: ")
    wrong = desat("budget", str(craft), "--format", "doc", cwd=craft)
    assert wrong.returncode == Exit.INPUT
    assert "--format doc: no format" in wrong.stderr
