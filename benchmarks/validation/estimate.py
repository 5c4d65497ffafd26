"""A run's own estimate of its error: from a companion run that is finer.

The companion is the same run with twice the substeps (`system/schedule.py`): its computers,
samples and rows stay where they are. Of two runs whose error falls with order p, the coarse one
errs by (2^p) / (2^p - 1) of their difference (Richardson): twice it for order 1, 4/3 for 2, 8/7 for
3. The order is not known from two runs, and 4/3 is taken: an estimate, no bound. What does not fall
with the substeps errs alike in both.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desat.numbers.derived import pointing
from desat.system.model import System
from desat.system.options import Options

Array = NDArray[Any]
FACTOR = 4.0 / 3.0
FINER = 2
"""The companion makes so many substeps where the run makes one."""


def difference(
    q: Array, h: Array, q_other: Array, h_other: Array
) -> tuple[float, float]:
    """Largest difference of two runs at the same times: attitude (rad), of q (n, 4),
    and any wheel's momentum (N m s), of h (n, 4)."""
    return float(np.radians(pointing(q, q_other)).max()), float(
        np.abs(h - h_other).max()
    )


def estimate(q: Array, h: Array, q_finer: Array, h_finer: Array) -> tuple[float, float]:
    """The errors of a run, attitude (rad) and momentum of a wheel (N m s), from its
    companion."""
    attitude, momentum = difference(q, h, q_finer, h_finer)
    return FACTOR * attitude, FACTOR * momentum


def companion(system: System, options: Options) -> Options:
    """The options of a checked system's companion; `options` are those of its run."""
    return replace(options, substeps=FINER * system.parts)
