"""The attitude error that the predictive law learns from the measured field."""

from __future__ import annotations

import math
import random
from pathlib import Path

import numpy as np
import pytest

from desat.components.contract.block import Vec3
from desat.components.laws import attitude_error
from desat.components.maths.attitude import rotate
from desat.components.maths.vector import norm, scale
from desat.runs.run import Options, execute

NOISE = 1e-7  # T
SPREAD = 0.02  # of the model's field across it
SPREAD_ANGLE = 0.1  # rad

Filter = tuple[tuple[float, ...], tuple[float, ...]]


def step(
    x: tuple[float, ...], p: tuple[float, ...], b: Vec3, model: Vec3
) -> tuple[tuple[float, ...], tuple[float, ...], float]:
    """Return (x, P) after a measured direction, whose own error is only considered."""
    size, direction = norm(b), scale(1.0 / norm(model), model)
    return attitude_error.update(
        x,
        p,
        scale(1.0 / size, b),
        rotate(attitude_error.rotation(x), direction),
        (NOISE / size) ** 2,
        attitude_error.ANGLES,
    )


def estimate(
    theta: tuple[float, float, float],
    turn: float,
    size: float = 1.0,
    model_error: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Filter:
    """Return (x, P) after 60 measurements, while the field turns by `turn` (rad)."""
    draw = random.Random(4)
    x: tuple[float, ...] = (0.0,) * attitude_error.STATES
    p = attitude_error.first_covariance(SPREAD_ANGLE, SPREAD)
    true = attitude_error.rotation((*theta, 0.0, 0.0, 0.0))
    for k in range(60):
        u = 0.4 + turn * k / 59.0
        model = np.array([2.3e-5 * math.cos(u), 2.4e-6, 4.6e-5 * math.sin(u)])
        b = size * np.array(rotate(true, tuple(model.tolist())))
        b += np.linalg.norm(b) * np.array(model_error)
        b += [draw.gauss(0.0, NOISE) for _ in range(3)]
        x, p, _ = step(x, p, tuple(b.tolist()), tuple(model.tolist()))
    return x, p


@pytest.mark.parametrize("size", [0.9, 1.0, 1.1])
@pytest.mark.parametrize(
    "theta", [(0.087, 0.0, 0.0), (0.0, 0.0, 0.175), (0.05, -0.06, 0.04)]
)
def test_a_field_that_turns_shows_all_three_axes(
    theta: tuple[float, float, float], size: float
) -> None:
    x, p = estimate(theta, 1.2, size)
    assert x[:3] == pytest.approx(theta, abs=1.25 * SPREAD)
    assert x[3:] == (0.0, 0.0, 0.0)
    assert attitude_error.is_significant(x, p)
    covariance = np.array(p).reshape(attitude_error.STATES, -1)
    assert covariance == pytest.approx(covariance.T, abs=0.0)
    assert np.linalg.eigvalsh(covariance).min() > 0.0


def test_a_field_that_does_not_turn_shows_two_axes() -> None:
    """The error about the field itself stays about as uncertain as at first."""
    x, p = estimate((0.087, 0.05, -0.03), 0.0)
    along = np.array([2.3e-5 * math.cos(0.4), 2.4e-6, 4.6e-5 * math.sin(0.4)])
    along /= np.linalg.norm(along)
    covariance = np.array(p).reshape(attitude_error.STATES, -1)[:3, :3]
    spread = SPREAD_ANGLE
    assert math.sqrt(along @ covariance @ along) > 0.8 * spread
    assert abs(along @ np.array(x[:3])) < spread
    across = np.linalg.eigvalsh(covariance)[:2]
    assert np.sqrt(across) == pytest.approx(SPREAD, rel=0.05)


@pytest.mark.parametrize(
    "model_error", [(0.0, 0.0, 0.0), (0.0, 0.02, 0.0), (0.02, 0.0, -0.01)]
)
@pytest.mark.parametrize("turn", [0.0, 0.6, 1.2])
def test_an_error_of_the_model_is_no_attitude_error(
    model_error: tuple[float, float, float], turn: float
) -> None:
    x, p = estimate((0.0, 0.0, 0.0), turn, 1.1, model_error)
    assert not attitude_error.is_significant(x, p)


def test_innovations_show_the_noise() -> None:
    """The mean ratio is the true variance over the assumed one."""
    draw = random.Random(8)
    x: tuple[float, ...] = (0.0,) * attitude_error.STATES
    p = attitude_error.first_covariance(SPREAD_ANGLE, SPREAD)
    ratios = []
    model = (2e-5, 0.0, 3e-5)
    for _ in range(400):
        b = tuple(m + draw.gauss(0.0, 3.0 * NOISE) for m in model)
        x, p, ratio = step(x, p, b, model)  # type: ignore[arg-type]
        ratios.append(ratio)
    assert np.mean(ratios[1:]) == pytest.approx(9.0, rel=0.2)


@pytest.mark.parametrize(
    "q_bo", [(0.043619387, 0.0, 0.0, 0.999048222), (0.0, 0.0, 0.087155743, 0.996194698)]
)
def test_an_attitude_that_is_off_costs_little(
    q_bo: tuple[float, float, float, float], tmp_path: Path
) -> None:
    """Roll off by 5 deg, yaw by 10 deg; the native FMU has the bits of the block."""
    values = {"spacecraft.q_bo": q_bo}
    excess_times = {}
    for name, spread in (("learnt", 0.02), ("as it is", 0.0)):
        options = Options(values=values | {"manager.field_spread": spread})
        run = execute("uosat12/predictive-nominal", options, tmp_path / name)
        numbers = run.manifest.numbers
        assert numbers["final_momentum"].value < 0.01
        excess_times[name] = (
            numbers["firing_time"].value - numbers["bound_same_end"].value
        )
    assert excess_times["learnt"] < min(1.0, excess_times["as it is"])
    native, block = (
        execute(
            "uosat12/predictive-nominal",
            Options(values=values, blocks=blocks),
            tmp_path / str(blocks),
        ).results.values("manager.m_cmd_body")
        for blocks in (False, True)
    )
    assert (native == block).all()
