"""Measures of the angle between two attitudes."""

from __future__ import annotations

import numpy as np

from .derived import error_vector, pointing
from .measuring import Array, in_unit, settled


@in_unit("deg")
def pointing_last(times: Array, q: Array, q_ref: Array) -> float:
    """The angle between two attitudes at the end (deg)."""
    return float(pointing(q, q_ref)[-1])


@in_unit("deg")
def pointing_largest(times: Array, q: Array, q_ref: Array) -> float:
    """The largest angle between two attitudes (deg)."""
    return float(pointing(q, q_ref).max())


@in_unit("deg")
def pointing_rms(times: Array, q: Array, q_ref: Array) -> float:
    """The root mean square angle between two attitudes (deg)."""
    return float(np.sqrt((pointing(q, q_ref) ** 2).mean()))


@in_unit("deg")
def pointing_mean(times: Array, q: Array, q_ref: Array) -> float:
    """The mean angle between two attitudes (deg)."""
    return float(pointing(q, q_ref).mean())


@in_unit("s", late=True)
def pointing_until_below(times: Array, q: Array, q_ref: Array, limit: float) -> float:
    """When the angle has come below a limit (deg) to stay (s)."""
    return settled(times, pointing(q, q_ref) < limit)


@in_unit("deg")
def pointing_level(times: Array, q: Array, q_ref: Array, level: float = 95.0) -> float:
    """The angle that `level` per cent of the time stay below: absolute performance error (APE) at
    this level (deg); ECSS-E-ST-60-10C."""
    return float(np.percentile(pointing(q, q_ref), level))


@in_unit("deg")
def pointing_relative(
    times: Array, q: Array, q_ref: Array, interval: float, level: float | None = None
) -> float:
    """The relative performance error (RPE) over intervals of so many seconds (deg): the distance
    of the error vector from its mean over its interval. Its mean, or the value that `level` per
    cent of the time stay below; ECSS-E-ST-60-10C."""
    error = error_vector(q, q_ref)
    count = max(1, round(interval / (times[1] - times[0])))
    whole = error[: len(error) // count * count].reshape(-1, count, 3)
    if not len(whole):
        return float("nan")
    size = np.linalg.norm(whole - whole.mean(axis=1, keepdims=True), axis=2)
    return float(size.mean() if level is None else np.percentile(size, level))
