"""Fits to dates of dumps alone."""

from __future__ import annotations

import numpy as np
import pytest

from desat.begin.craft import write
from desat.begin.facts import CraftFacts
from desat.runs.prepare import prepare, read, resolved
from desat.runs.run import simulate
from desat.system.errors import DesatError
from desat.system.options import Options
from desat.telemetry.dates import fit_dates
from desat.telemetry.log import read_log

FACTS = CraftFacts(
    sun="1AU",
    mass="600kg",
    wheels="4 pyramid 1Nms",
    thrusters="4 1N",
    dump="thrusters 70:10",
    wings=("2 x 4m2 2.5m",),
)
FACTOR = 1.7


@pytest.fixture(scope="module")
def craft(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dates") / "mine"
    write(folder, FACTS, "")
    return folder


def dates_of(craft, factor):
    system, _ = resolved(str(craft), Options())
    offset = system.components["spacecraft"].values["offset_plates_body"]
    values = {"spacecraft.offset_plates_body": [factor * x for x in offset]}
    options = Options(values=values, stop=20.0 * 86400.0, record=("manager.dumps",))
    run = simulate(prepare(read(str(craft)), options)).or_raise("mine")
    with run.results as results:
        count = results.values("manager.dumps").ravel()
        return results.times()[1 - len(count) :][np.diff(count) > 0.0]


def log_of(folder, times):
    file = folder / "dumps.csv"
    file.write_text("time [s]\n" + "".join(f"{t:.1f}\n" for t in times))
    return read_log(file, None)


@pytest.mark.study
def test_the_size_of_an_offset_is_found(craft, tmp_path):
    system, _ = resolved(str(craft), Options())
    log = log_of(tmp_path, dates_of(craft, FACTOR))
    (parameter,) = fit_dates(system, str(craft), log, Options()).parameters.values()
    ratio = parameter.value / parameter.before
    deviation = parameter.deviation / np.abs(parameter.before)
    assert (np.abs(ratio - FACTOR) < 3.0 * deviation).all()
    assert ratio == pytest.approx(FACTOR, rel=0.05)


def test_a_log_of_other_columns_is_none_of_dates(tmp_path):
    file = tmp_path / "log.csv"
    file.write_text("time [s],wheelspeed_1 [rpm]\n0,1\n60,2\n120,3\n")
    assert not read_log(file, None).is_of_dates
    assert log_of(tmp_path, [0.0, 1.0]).is_of_dates


@pytest.mark.parametrize(
    ("times", "text"),
    [
        ([0.0, 86400.0], "2 dates of dumps; at least 3 are needed"),
        ([0.0, 60.0, 120.0], "no offset of the centre of pressure explains it"),
    ],
)
def test_dates_that_say_nothing_are_refused(craft, tmp_path, times, text):
    system, _ = resolved(str(craft), Options())
    with pytest.raises(DesatError, match=text):
        fit_dates(system, str(craft), log_of(tmp_path, times), Options())
