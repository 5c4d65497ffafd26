"""The predictive law: its solver, what it learns, what it refuses, and what it does in the loop."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
from scipy.optimize import minimize

from desat.components.blocks.manager_predictive import ManagerPredictive
from desat.components.contract.block import BlockError
from desat.components.laws import disturbance_learning as learning
from desat.components.laws import predictive

N, J = predictive.INTERVALS, predictive.ACTUATORS


def _case(seed: int, count: int, fee: float, most: float) -> dict[str, tuple[float, ...]]:
    draw = random.Random(seed)
    used = [k < count and j < 4 for k in range(N) for j in range(J)]
    return {
        "dt": tuple(draw.uniform(0.5, 2.0) if k < count else 0.0 for k in range(N)),
        "drift": tuple(draw.gauss(0.0, 0.3) for _ in range(3 * N)),
        "effect": tuple(draw.gauss(0.0, 0.5) for _ in range(3 * J * N)),
        "price": tuple(draw.uniform(0.5, 2.0) for _ in range(J * N)),
        "fee": tuple(fee for _ in range(J * N)),
        "most": tuple(most if x else 0.0 for x in used),
        "rows": tuple(draw.gauss(0.0, 1.0) for _ in range(12 * N)),
    }


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(
    ("fee", "most", "peak", "end"),
    [(0.0, 50.0, 0.0, 0.0), (0.0, 0.25, 0.0, 2.0), (0.4, 0.3, 0.0, 20.0), (0.0, 0.4, 0.05, 0.0)],
)
def test_plan_is_the_least(seed: int, fee: float, most: float, peak: float, end: float) -> None:
    """The same problem by scipy's L-BFGS-B, with |u| split in two parts of one sign each."""
    count, size, q = 5, 1.2, 0.7
    case = _case(seed, count, fee, most)
    x0, bias = (0.8, -0.5, 0.3), (0.1, -0.1, 0.0, 0.05)
    u, costate, course, _, settled = predictive.solve(
        count, x0, predictive.NO_PLAN, *case.values(), bias, q, peak, size, end
    )  # fmt: skip
    assert settled
    dt = np.array(case["dt"])[:count]
    g = np.array(case["effect"]).reshape(N, J, 3)[:count, :4]
    d = np.array(case["drift"]).reshape(N, 3)[:count]
    r = np.array(case["price"]).reshape(N, J)[:count, :4]
    rows = np.array(case["rows"]).reshape(N, 4, 3)[:count]

    def cost(u: np.ndarray, first: np.ndarray) -> float:
        x = first + np.cumsum(d + np.einsum("kji,kj->ki", g, u), axis=0)
        h = np.einsum("kji,ki->kj", rows, x) + np.array(bias)
        path = 0.5 * q * (x**2).sum(1) + peak * ((h / size) ** 16).sum(1)
        effort = (0.5 * r * u**2 + fee * np.abs(u)).sum(1)
        return float(dt @ (path + effort) + 0.5 * end * (x[-1] ** 2).sum())

    def split(z: np.ndarray) -> float:
        up, down = z.reshape(2, count, 4)
        return cost(up - down, np.array(x0)) + float(
            dt @ (fee * (up + down - abs(up - down))).sum(1)
        )

    best = min(
        (minimize(split, np.full(8 * count, start), bounds=[(0.0, most)] * (8 * count),
                  method="L-BFGS-B", options={"maxiter": 5000, "maxfun": 10**6, "ftol": 1e-14})
         for start in (0.0, 0.1)), key=lambda x: x.fun,
    )  # fmt: skip
    ours = np.array(u).reshape(N, J)[:count, :4]
    assert np.abs(ours).max() <= most
    reached = cost(ours, np.array(x0))
    assert reached <= best.fun * (1.0 + 3.0 * predictive.SETTLED) + 1e-9
    end_of = x0 + (d + np.einsum("kji,kj->ki", g, ours)).sum(0)
    assert course[3 * count - 3 : 3 * count] == pytest.approx(tuple(end_of), abs=1e-12)
    step = 1e-6
    slope = [
        (cost(ours, np.array(x0) + step * e) - cost(ours, np.array(x0) - step * e)) / (2 * step)
        for e in np.eye(3)
    ]
    assert costate == pytest.approx(tuple(slope), rel=1e-5, abs=1e-6)


def test_filter_finds_a_dead_and_a_turned_coil() -> None:
    """Momentum that two good coils, a dead and a turned one make, measured with noise."""
    draw = random.Random(3)
    true = [1.0, 2e-4, -1e-4, 0.0, 0.0, 0.0, 3e-4, 0.0, 0.0, 0.0, 0.0, 1.0, -1.0, 0.7, 1.0, 1, 1]
    true += [0.0] * 6
    spreads = learning.spreads(1e-3, 0.1, 1e-3)
    h = [0.1, -0.2, 0.3]
    x, p = learning.first_state((0.1, -0.2, 0.3)), learning.first_covariance(spreads)
    for k in range(400):
        columns = [(0.0, 0.0, 0.0)] * learning.CAUSES
        columns[1], columns[2], columns[3] = (10.0, 0.0, 0.0), (0.0, 10.0, 0.0), (0.0, 0.0, 10.0)
        a = 0.02 * k
        columns[4] = (10.0 * math.cos(a), 10.0 * math.sin(a), 0.0)
        for j in range(4):
            columns[10 + j] = tuple(draw.gauss(0.0, 0.02) for _ in range(3))  # type: ignore[assignment]
        h = [h[i] + sum(t * c[i] for t, c in zip(true, columns, strict=True)) for i in range(3)]
        seen = tuple(y + draw.gauss(0.0, 1e-3) for y in h)
        rows = learning.causes(tuple(columns))
        x, p = learning.learnt(x, p, seen, rows, 1e-3, 1e-4, spreads, 1e-3)  # type: ignore[arg-type]
    assert x[13:17] == pytest.approx((0.0, 1.0, -1.0, 0.7), abs=0.05)
    assert x[4] == pytest.approx(2e-4, abs=3e-5)
    matrix = np.array(p).reshape(learning.STATES, learning.STATES)
    assert np.linalg.eigvalsh(0.5 * (matrix + matrix.T)).min() > -1e-12


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"weights": (0.0, 0.0, 0.0)}, r"weights = \(0, 0, 0\)"),
        ({"weights": (1.0, 0.0, 1.0)}, r"weights\[2\] = 0"),
        ({"weights": (0.0, 1.0, 1.0)}, r"weights\[1\] = 0"),
        ({"horizon": 15.0}, r"horizon = 15 s is below two samples of sample_time = 10 s"),
        ({"goal": 1, "end": 0.0}, r"end = 0 s is before now"),
        ({"goal": 1, "end": 600.0, "weights": (1.0, 1.0, 0.0)}, r"weights\[3\] = 0"),
        ({"m_limit": 0.0}, r"m_limit = 0 A m2 .* no coil is left"),
        ({"axes_coil": (0.0,) * 12}, "no coil is left"),
        ({"sample_time": 0.0}, "sample_time = 0 s"),
    ],
)  # fmt: skip
def test_refuses(values: dict[str, object], text: str) -> None:
    block = ManagerPredictive()
    for name, value in values.items():
        setattr(block, name, value)
    with pytest.raises(BlockError, match=text):
        block.start()
