"""Requirements of a campaign: intervals of shares, and how many more cases show them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import beta

from desat.campaign.judged import for_half_the_width, more, requirement
from desat.campaign.spread import Spread
from desat.language.scenario import Requirement
from desat.numbers.statistics import clopper_pearson


def judge_values(
    values: list[float], completion: list[bool], **bounds: float
) -> dict[str, object]:
    cases = np.arange(len(values))
    entry = Requirement(number="x", **bounds)
    return requirement(
        entry, {"x": np.array(values)}, np.array(completion), cases, Path("c")
    ).to_json()


def test_what_just_shows_a_requirement_shows_it():
    """One case of one, inside: any share within is less than 50 % with 50 % of
    confidence."""
    even = {"max": 2.0, "confidence": 0.5}
    assert judge_values([1.0], [True], probability=0.5, **even)["met"]
    assert judge_values([1.0], [True], probability=0.5, **even)["more_cases"] == 0
    above = math.nextafter(0.5, 1.0)
    assert not judge_values([1.0], [True], probability=above, **even)["met"]
    assert judge_values([1.0], [True], probability=above, **even)["more_cases"] == 1


@pytest.mark.parametrize(
    ("n", "outside"), [(58, 0), (59, 0), (92, 1), (93, 1), (200, 12)]
)
def test_a_requirement_is_judged_as_it_says(n, outside):
    """With 95 % and 95 % where nothing else is asked; the beta distribution as scipy
    has it."""
    values = np.where(np.arange(n) < outside, 3.0, 1.0)
    judgement = judge_values(list(values), [True] * n, max=2.0)
    share_shown = beta.ppf(0.05, n - outside, outside + 1)
    assert (judgement["probability"], judgement["confidence"], judgement["n"]) == (
        0.95,
        0.95,
        n,
    )
    assert judgement["met"] == (share_shown >= 0.95) == (n in (59, 93))
    assert judgement["shown_within"] == pytest.approx(100 * share_shown, rel=1e-12)
    assert judgement["outside"] == outside
    assert judgement["share_outside"] == pytest.approx(100 * outside / n, rel=1e-12)
    assert judgement["interval_outside"] == clopper_pearson(outside, n, 0.95)
    assert judgement["cases_outside"] == list(range(min(outside, 10)))
    assert judgement["commands"] == [
        f"desat campaign case c {k}" for k in range(min(outside, 3))
    ]
    assert judgement["for_half_the_width"] == for_half_the_width(n, outside, 0.95)


@pytest.mark.parametrize(
    ("count", "n"), [(0, 7), (1, 7), (3, 7), (6, 7), (7, 7), (1, 1)]
)
@pytest.mark.parametrize("level", [0.9, 0.95])
def test_the_interval_of_a_share(count, n, level):
    tail = (1.0 - level) / 2.0
    low = 100.0 * beta.ppf(tail, count, n - count + 1) if count else 0.0
    high = 100.0 * beta.ppf(1.0 - tail, count + 1, n - count) if count < n else 100.0
    assert clopper_pearson(count, n, level) == pytest.approx([low, high], rel=1e-12)
    assert clopper_pearson(count, n) == clopper_pearson(count, n, 0.95)


@pytest.mark.parametrize(
    ("n", "inside", "probability", "confidence"),
    [
        (10, 10, 0.9, 0.9),
        (10, 9, 0.8, 0.8),
        (7, 6, 0.7, 0.9),
        (30, 28, 0.85, 0.95),
        (9, 8, 0.8, 0.5),
        (3, 2, 0.5, 0.6),
        (40, 39, 0.9, 0.7),
        (2, 2, 0.99, 0.95),
    ],
)
def test_so_many_more_cases_show_it_and_one_less_does_not(
    n, inside, probability, confidence
):
    """Against every total one by one, the share outside rounded to whole cases."""

    def is_shown(total: int) -> bool:
        outside = math.floor((n - inside) * total / n + 0.5)
        return bool(
            beta.ppf(1.0 - confidence, total - outside, outside + 1) >= probability
        )

    last = max(k for k in range(n - 1, n + 3000) if k < n or not is_shown(k))
    assert more(n, inside, probability, confidence) == last + 1 - n


def test_more_than_ten_million_cases_are_not_told_of():
    assert more(10_000, 9_501, 0.95, 0.95) is None
    assert more(10, 10, 0.9999999, 0.95) is None  # it takes 29,957,321
    assert more(1, 1, 0.05 ** (1.0 / 9_999_998.5), 0.95) == 9_999_998
    assert more(1, 1, 0.05 ** (1.0 / 9_999_999.5), 0.95) is None
    assert for_half_the_width(3_000_000, 1_500_000, 0.95) is None
    assert for_half_the_width(2_000, 1_000, 0.95) == pytest.approx(6_000, rel=0.02)


def test_a_time_that_is_not_reached_counts_in_the_share():
    assert Spread(n=3, not_reached=1).not_reached_text == "1 of 4 (25 %)"
    assert Spread(n=5, not_reached=2).not_reached_text == "2 of 7 (28.6 %)"
    assert Spread(n=4, not_reached=0).not_reached_text == ""
