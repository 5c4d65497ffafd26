"""Verdicts of a paper's tables."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import pytest

from desat.language.content import PaperEntry
from desat.numbers.statistics import clopper_pearson
from tests.conftest import module_of

comparison = module_of("desat.papers.comparison")


@pytest.mark.parametrize(
    ("entry", "band"),
    [
        ({"tolerance": [1, 2]}, (1.0, 2.0)),
        ({"tolerance": {"of": "x", "from": 0.5, "to": 2.0}}, (2.0, 8.0)),
        ({"tolerance": "12 %", "values": -50.0}, (-56.0, -44.0)),
        ({"tolerance": "12%", "values": -50.0}, (-56.0, -44.0)),
        ({"tolerance": "0.5", "values": 3.0}, (2.5, 3.5)),
        ({"tolerance": "0.5"}, None),
        ({"values": 3.0}, None),
    ],
)
def test_what_counts_as_within_a_row(entry, band):
    row = {"table": "1", "quantity": "a_number", "unit": "1", **entry}
    assert comparison.band_of(PaperEntry.model_validate(row), {"x": 4.0}) == band


def test_of_draws_the_limits_count_and_what_is_lacking_does_not():
    values = [1.0, 2.0, 3.0, None]
    answer = comparison.share_of(values, least=2.0, most=3.0)
    assert (answer.n, answer.count) == (4, 2)
    assert comparison.share_of(values, most=2.0).count == 2
    assert comparison.share_of(values, least=-math.inf).count == 3
    assert answer.interval == clopper_pearson(2, 4)


def cell(ours: float | None, draws: object | None = None, **more: object):
    """A row of a table; its band is 1 to 2."""
    content = SimpleNamespace(labels={}, numbers={})
    scenario = SimpleNamespace(content=content, cell={}, name="family/name")
    entry = {
        "table": "1",
        "quantity": "a_number",
        "unit": "1",
        "tolerance": [1.0, 2.0],
        **more,
    }
    inputs = PaperEntry.model_validate(
        {k: v for k, v in entry.items() if v is not None}
    )
    return comparison._row(scenario, inputs, ours, {}, draws)


@pytest.mark.parametrize(
    ("ours", "within"),
    [(0.9, False), (1.0, True), (1.5, True), (2.0, True), (2.1, False), (None, None)],
)
def test_a_cell_at_the_edge_of_its_band_is_within(ours, within):
    assert cell(ours).within is within
    assert cell(1.5, values=ours).paper_within is within
    assert cell(ours, tolerance=None).within is None


@pytest.mark.parametrize(
    ("least", "most", "ours", "within"),
    [
        (3.0, 4.0, 1.5, True),
        (3.0, 3.0, 1.5, True),
        (2.9, 4.0, 1.5, False),
        (3.0, 4.1, 1.5, False),
        (None, 4.0, 1.5, False),
        (3.0, None, 1.5, False),
        (3.0, 4.0, 2.5, False),
    ],
)
def test_each_draw_of_a_cell_is_to_be_in_its_band(least, most, ours, within):
    draws = comparison.PaperSpread(2, least, most, (3.0, 4.0))
    assert cell(ours, draws).within is within
    assert cell(1.5, replace(draws, band=None)).within is True


def test_cells_are_counted_by_what_they_show():
    rows = [
        cell(1.5, values=1.6),
        cell(1.5, values=3.0),
        cell(3.0, values=1.5),
        cell(1.5, values=1.5, tuned="a gain"),
        cell(1.5, tuned="a gain"),
        cell(1.5, values=1.5, in_sample="a choice"),
        cell(1.5),
        cell(3.0),
        cell(None, not_judged="why", tolerance=None),
        cell(1.5, tolerance=None),
    ]
    assert comparison.count(rows) == {
        "rows": 10,
        "not_judged": 1,
        "banded": 8,
        "within": 6,
        "tuned": 2,
        "without_paper": 2,
        "in_sample": 1,
        "out_of_sample": 3,
        "out_of_sample_within": 2,
        "paper_outside": 1,
    }
    assert (cell(1.5).case, cell(1.5, case="1").case) == ("name", "1")
    assert (cell(1.5).heading, cell(1.5, heading="how long").heading) == (
        "a number",
        "how long",
    )
    assert (cell(1.5).method, cell(1.5, label="ours").method) == ("", "ours")
    assert cell(1.5, definition="as it says").definition == "as it says"
