"""Two-line elements."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import pytest
import sgp4

from desat.components.blocks.environment_tle import EnvironmentTle
from desat.components.contract.block import BlockError
from desat.components.maths.vector import norm, sub
from desat.components.physics import tle
from tests.physics.environments import at, begin, epoch


def test_sgp4_verification():
    """The official output of SGP4 (Vallado and others, AIAA 2006-6753), which the
    package sgp4 ships: all its satellites with a valid checksum, down to the printed
    digits."""
    folder = Path(sgp4.__file__).parent
    text = (folder / "SGP4-VER.TLE").read_text(encoding="ascii").splitlines()
    lines = [line[:69] for line in text if line[:2] in ("1 ", "2 ")]
    rows: dict[int, list[list[float]]] = {}
    for line in (folder / "tcppver.out").read_text(encoding="ascii").splitlines():
        if line.endswith("xx"):
            latest = rows.setdefault(int(line.split()[0]), [])
        else:
            latest.append([float(x) for x in line.split()[:7]])
    # as a parameter the epoch is one float, of 1e-7 s: it moves the Moon of these two
    tolerance = {20413: 1e-3, 23333: 1e-2}
    row_count = 0
    for line1, line2 in zip(lines[::2], lines[1::2], strict=True):
        number = int(line1[2:7])
        if number in (33333, 33334, 33335):
            continue
        parameters = tle.tle_parameters(line1, line2)
        start = parameters["epoch_tle_j2000"]
        block = begin(EnvironmentTle(), **parameters, epoch_j2000=start, field="none")
        for minutes, *state in rows[number]:
            at(block, 60 * minutes)
            row_count += 1
            expected_r, expected_v = (
                [1e3 * x for x in half] for half in (state[:3], state[3:])
            )
            assert math.dist(block.r_eci, expected_r) < tolerance.get(number, 1e-5), (
                number
            )
            assert math.dist(block.v_eci, expected_v) < 2e-6, number
    assert row_count > 600


def test_time_of_two_line_elements():
    """t counts from epoch_j2000, wherever the epoch of the elements is."""
    early, late = (
        begin(EnvironmentTle()),
        begin(EnvironmentTle(), epoch_j2000=629208000.0 + 3600),
    )
    assert at(early, 3605.0).r_eci == pytest.approx(at(late, 5.0).r_eci, abs=1e-6)
    assert early.b_eci == pytest.approx(late.b_eci, abs=1e-10)
    assert norm(sub(early.r_eci, at(early, 0.0).r_eci)) > 1e6


def test_default_elements_are_those_of_the_iss():
    lines = (
        "1 25544U 98067A   19343.69339541  .00001764  00000-0  38792-4 0  9991",
        "2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482",
    )
    assert all(
        getattr(EnvironmentTle(), k) == x for k, x in tle.tle_parameters(*lines).items()
    )
    assert tle.tle_parameters(*lines)["epoch_tle_j2000"] == pytest.approx(
        epoch(2019, 12, 9, 16, 38, 29), abs=0.5
    )
    with pytest.raises(BlockError, match=r"line 2 .* checksum"):
        tle.tle_parameters(lines[0], lines[1].replace("51.6439", "51.6438"))
    with pytest.raises(BlockError, match="line 1"):
        tle.tle_parameters(*reversed(lines))


def test_a_decayed_satellite_is_an_error():
    block = begin(EnvironmentTle(), field="none", bstar=0.1)
    with pytest.raises(
        BlockError, match=r"SGP4, .* s after the epoch of the elements: "
    ):
        at(block, 30 * 86400.0)


def test_without_sgp4_the_message_says_so(monkeypatch):
    monkeypatch.setitem(sys.modules, "sgp4.api", None)
    tle._satellite.cache_clear()
    block = begin(EnvironmentTle(), field="none")
    with pytest.raises(
        BlockError, match=r"need the Python package sgp4 .* pip install sgp4"
    ):
        at(block, 0.0)
