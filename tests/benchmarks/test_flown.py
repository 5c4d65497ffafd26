"""docs/flown.md: no prediction of a spacecraft that flew gets worse unseen."""

from __future__ import annotations

import json

import pytest

from benchmarks import flown as study


def test_missions_are_complete():
    table = study.missions()
    assert len({x["title"].partition(",")[0] for x in table.values()}) >= 20
    for name, entry in table.items():
        assert entry["source"], name
        if "cannot" in entry:
            continue
        assert study.unit_of(entry["quantity"]), name
        assert entry["assumed"], name
        low, high = entry.get("low", 0.0), entry.get("high", float("inf"))
        assert low <= entry["value"] <= high, name
        assert entry.get("bound") in (None, "least", "most"), name


def test_factors():
    prediction = study.Prediction(2.0, 1.0, 5.0)
    assert prediction.factor(4.0) == prediction.factor(1.0) == 2.0


@pytest.mark.study
def test_no_prediction_gets_worse():
    table = study.missions()
    factors_stored = json.loads(study.STORED.read_text(encoding="utf-8"))
    of_today = study.factors(table, study.predict_all(table))
    assert of_today.keys() == factors_stored.keys(), "make flown"
    worse = {n: x for n, x in of_today.items() if x > 1.05 * factors_stored[n]}
    assert not worse
