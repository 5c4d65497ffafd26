"""The closed loop against Basilisk's dynamics: trajectories stored by `make witness`."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import lpmv

import desat
from benchmarks.orbit_forces import RADIUS, TESSERALS, tesserals
from benchmarks.witness import (
    CASES,
    DOCS,
    LAWS,
    SERIES,
    STORED,
    STORED_SUMMARY,
    apart,
    ours,
    page,
)
from desat.components.physics.orbit import MU

TOLD_OF = json.loads(STORED_SUMMARY.read_text(encoding="utf-8"))
MOST = {"light": 1e-10, "orbit": 1e-10}
"""rad, rad/s and N m s; elsewhere 1e-8."""


def read_rows(name: str) -> dict[str, NDArray[np.float64]]:
    with np.load(STORED) as rows:
        return {series: rows[f"{name}.{series}"] for series in SERIES}


@pytest.mark.parametrize("name", [c for c in CASES if c != LAWS])
def test_the_closed_loop_is_basilisks(name: str) -> None:
    """To three times what Basilisk's own extrapolation may err, with 64 substeps."""
    differences = apart(read_rows(name), ours(name, None, CASES[name]))
    for subject, error in TOLD_OF["cases"][name]["error"].items():
        assert differences[subject] <= min(3.0 * error, MOST.get(name, 1e-8)), subject
    assert (
        TOLD_OF["cases"][name]["basilisk"]["0.1"]["attitude"] > differences["attitude"]
    )


def test_the_difference_to_basilisks_own_laws_is_what_the_page_says() -> None:
    differences = apart(read_rows(LAWS), ours(LAWS, None, CASES[LAWS]))
    answer = TOLD_OF["laws"]
    assert differences["attitude"] == pytest.approx(
        answer["modules"]["attitude"], rel=1e-3
    )
    assert differences["momentum"] == pytest.approx(
        answer["modules"]["momentum"], rel=1e-3
    )
    assert (
        answer["all_terms"]["attitude"]
        < 1e-13
        < min(remaining["momentum"] for remaining in answer["without"].values())
    )


def test_with_an_empty_null_space_ours_is_nearer() -> None:
    """The one term that changes wheels' momentum: by the parameter that Basilisk's law
    has, too."""
    run = desat.run(f"nadir_day/witness-{LAWS}", {"manager.null_gain": 1e-3})
    rows = {k: run.results.values(s)[:: CASES[LAWS]] for k, s in SERIES.items()}
    answer = TOLD_OF["laws"]["without"]
    remaining = (
        answer["mrp"]["momentum"]
        + answer["gyroscopic"]["momentum"]
        + answer["relative"]["momentum"]
    )
    assert apart(read_rows(LAWS), rows)["momentum"] < 1.1 * remaining
    assert remaining < 0.02 * TOLD_OF["laws"]["modules"]["momentum"]


def test_a_coil_that_is_off_by_a_thousandth_is_seen() -> None:
    run = desat.run("nadir_day/witness-light", {"manager.gain": 1.001e-3})
    rows = {k: run.results.values(s)[:: CASES["light"]] for k, s in SERIES.items()}
    differences, error = (
        apart(read_rows("light"), rows),
        TOLD_OF["cases"]["light"]["error"],
    )
    assert differences["attitude"] > 1e4 * error["attitude"]


def test_the_page_is_of_what_is_stored() -> None:
    assert DOCS.read_text(encoding="utf-8") == page(TOLD_OF)


def test_tesserals_are_the_gradient_of_their_potential() -> None:
    def potential(r: NDArray[np.float64]) -> float:
        far, total = float(np.linalg.norm(r)), 0.0
        for n, m, c, s in TESSERALS:
            norm = math.sqrt(
                2 * (2 * n + 1) * math.factorial(n - m) / math.factorial(n + m)
            )
            legendre = (-1) ** m * float(lpmv(m, n, r[2] / far))
            longitude_angle = m * math.atan2(r[1], r[0])
            total += (
                (RADIUS / far) ** n
                * norm
                * legendre
                * (c * math.cos(longitude_angle) + s * math.sin(longitude_angle))
            )
        return MU / far * total

    r, h = np.array([4.0e6, -3.0e6, 4.5e6]), 10.0
    slopes = [
        (potential(r + h * e) - potential(r - h * e)) / (2.0 * h) for e in np.eye(3)
    ]
    assert tesserals(r) == pytest.approx(slopes, rel=1e-6)
