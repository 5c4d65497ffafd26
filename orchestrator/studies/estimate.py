"""A run's own estimate of its error: from a companion run that is finer.

The companion is the same run with twice the inner steps (`system/schedule.py`): its computers,
samples and rows stay where they are. Of two runs whose error falls with order p, the coarse one
errs by (2^p) / (2^p - 1) of their difference (Richardson): twice it for order 1, 4/3 for 2, 8/7 for
3. The order is not known from two runs, and 4/3 is taken: an estimate, no bound. What does not fall
with the inner steps errs alike in both.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..analyses import residual
from ..numbers.derived import pointing
from ..numbers.text import Value
from ..runs.run import Run, execute
from ..system.errors import DesatError
from ..system.model import System
from ..system.options import Options

Array = NDArray[Any]
FACTOR = 4.0 / 3.0
FINER = 2
"""The companion makes so many inner steps where the run makes one."""
TITLES = {
    "estimated_attitude_error": ("Attitude error, largest, estimated from a companion run", "rad"),
    "estimated_wheel_momentum_error": (
        "Error of a wheel's momentum, largest, estimated from a companion run", "N.m.s"
    ),
}  # fmt: skip


def difference(q: Array, h: Array, q_other: Array, h_other: Array) -> tuple[float, float]:
    """Largest difference of two runs at the same times: attitude (rad), of q (n, 4), and any
    wheel's momentum (N m s), of h (n, 4)."""
    return float(np.radians(pointing(q, q_other)).max()), float(np.abs(h - h_other).max())


def estimate(q: Array, h: Array, q_finer: Array, h_finer: Array) -> tuple[float, float]:
    """The errors of a run, attitude (rad) and momentum of a wheel (N m s), from its companion."""
    attitude, momentum = difference(q, h, q_finer, h_finer)
    return FACTOR * attitude, FACTOR * momentum


def companion(system: System, options: Options) -> Options:
    """The options of a checked system's companion; `options` are those of its run."""
    return replace(options, inner=FINER * system.parts)


def add(run: Run, target: str, options: Options) -> None:
    """Make the companion of a completed run, and put the estimates into the run's manifest.

    Raises DesatError where the run has no rigid body, or did not record what is compared.
    """
    body: residual.Parts | None = run.manifest.parts.get(residual.KEY)
    if body is None:
        raise DesatError(f"--estimate: {target} has no rigid body with wheels")
    names = (f"{body.spacecraft}.q_bi", body.wheels)
    if missing := set(names) - set(run.results.names()):
        raise DesatError(f"--estimate: not recorded: {', '.join(sorted(missing))}")
    finer = replace(options, inner=FINER * run.manifest.inner, record=names)
    other = execute(target, finer).or_raise(f"{target}, companion run")
    same = np.searchsorted(other.results.times(names[0]), run.results.times(names[0]) - 1e-9)
    values = estimate(
        *(run.results.values(n) for n in names), *(other.results.values(n)[same] for n in names)
    )
    other.results.close()
    made = {
        name: Value(title, value, unit)
        for (name, (title, unit)), value in zip(TITLES.items(), values, strict=True)
    }
    run.manifest = replace(
        run.manifest, estimate={"companion_inner": FINER * run.manifest.inner, "factor": FACTOR},
        numbers={**run.manifest.numbers, **made},
    )  # fmt: skip
