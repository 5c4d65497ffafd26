"""Measure a law by what an engineer asks of it.

A run of two orbits or more is measured from the end of the first one, so that its start
does not count. The time to empty the wheels has a flight of its own, in which they
begin half full.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..analyses import management
from ..analyses.flight import hardware_of
from ..analyses.manifest import Manifest
from ..analyses.motion import period_of
from ..engine.recording.results import Results
from ..numbers.derived import pointing, wanted_attitude
from ..numbers.text import spell_unit
from ..system.errors import DesatError, choices
from ..system.model import System

Array = NDArray[Any]
ORBIT = (
    "environment.r_eci",
    "environment.v_eci",
    "environment.b_eci",
    "spacecraft.q_bi",
)
REFERENCE = "guidance.q_ref_bi"
DIPOLE, ENERGY = "torquers.m_mean_body", "torquers.electric_energy"
TORQUE, FIRING = "thrusters.tau_mean_thruster_body", "thrusters.on_time"
RECORDED = (*ORBIT, REFERENCE, DIPOLE, ENERGY, TORQUE, FIRING)
START = "wheels.h_start_wheel"  # momentum of the wheels at the start
HALF = 0.5  # fill of the fullest wheel from which the emptying is timed
EMPTY = 10.0  # %: fill of the fullest wheel below which wheels count as empty
ALIKE = 0.02  # relative difference of a criterion up to which laws count as alike
# Fill (%) up to which three quarters of a wheel are free.
AT_EASE = 25.0


class MeasuredRun(NamedTuple):
    """A run and the time (s) from which it is measured."""

    manifest: Manifest
    results: Results
    first: float

    def rows(self, series: str) -> Array:
        """Return the rows of a series that are measured."""
        return self.late(self.results.values(series), self.results.times(series))

    def late(self, values: Array, times: Array) -> Array:
        """Return those of the values at times (s) that are measured."""
        return np.asarray(values[times[: len(values)] >= self.first - 1e-9])


def measured_run(manifest: Manifest, results: Results) -> MeasuredRun:
    """Find the time from which a run is measured: the end of its first orbit.

    A run of less than two orbits is measured from its start.
    """
    r, v = (results.values(name)[0] for name in ORBIT[:2])
    times, period = results.times(), period_of(r, v)
    is_long = times[-1] - times[0] >= 2.0 * period * (1.0 - 1e-9)
    return MeasuredRun(manifest, results, float(times[0]) + period * is_long)


class Criterion(NamedTuple):
    """Criterion by which laws are ranked; a smaller value is better."""

    name: str
    title: str
    unit: str
    # Value of a run, None if it is not known; None: it needs other flights than one.
    of: Callable[[MeasuredRun], float | None] | None

    @property
    def heading(self) -> str:
        """Return the title with unit, for a column or an axis."""
        return f"{self.title} [{spell_unit(self.unit)}]"


def _filled(run: MeasuredRun) -> float | None:
    """Return the fill of the fullest wheel (%), or None if it is not known."""
    fill = management.fill(run.manifest, run.results)
    if fill is None:
        return None
    return float(run.late(fill, run.results.times()).max())


def _stored(run: MeasuredRun) -> float | None:
    """Return the largest total wheel momentum (N m s), or None if it is not known."""
    wheel_momentum = management.stored(run.manifest, run.results)
    if wheel_momentum is None:
        return None
    late = run.late(wheel_momentum, run.results.times())
    return float(np.linalg.norm(late, axis=1).max())


def _duty(run: MeasuredRun) -> float | None:
    """Return the coil duty (%), or None if it is not known."""
    if DIPOLE not in run.results.names():
        return None
    duty = management.coils_of("torquers", run.manifest, run.rows(DIPOLE))
    return duty.get("coil_duty")


def _pointing(run: MeasuredRun) -> float | None:
    """Compute the rms pointing error (deg), or None without a reference."""
    recorded = run.results.names()
    if REFERENCE not in recorded:
        return None
    q = run.rows(ORBIT[3])
    reference = run.rows(wanted_attitude(REFERENCE, recorded))
    n = min(len(q), len(reference))
    return float(np.sqrt((pointing(q[:n], reference[:n]) ** 2).mean()))


def _gained(signal: str) -> Callable[[MeasuredRun], float | None]:
    """Build the criterion of how much a series grows, None without it."""

    def of(run: MeasuredRun) -> float | None:
        """Return how much the series has grown, or None without it."""
        if signal not in run.results.names():
            return None
        rows = run.rows(signal)
        return float(rows[-1] - rows[0])

    return of


CRITERIA = {
    c.name: c
    for c in (
        Criterion("peak", "fill of the fullest wheel", "%", _filled),
        Criterion("emptying", "time to empty half-full wheels", "min", None),
        Criterion("energy", "coil energy", "J", _gained(ENERGY)),
        Criterion("torquer", "least torquer on the worst day", "A.m2", None),
        Criterion("duty", "coil duty", "%", _duty),
        Criterion("pointing", "pointing error, rms", "deg", _pointing),
        Criterion("firing", "firing time", "s", _gained(FIRING)),
        Criterion("stored", "momentum of the wheels", "N.m.s", _stored),
    )
}
# Criteria of a ranking where none are named, as far as they are known for the craft.
STANDARD = ("peak", "emptying", "energy", "torquer", "duty", "pointing", "firing")


def criteria(by: str) -> tuple[Criterion, ...]:
    """Parse a list of criteria, as `peak,duty`.

    Raises
    ------
    DesatError
        If there is no such criterion.
    """
    names = [x.strip() for x in by.split(",") if x.strip()]
    for name in names or [by]:
        if name not in CRITERIA:
            raise DesatError(f"--by {by}: no {name or 'name'}{choices(name, CRITERIA)}")
    return tuple(CRITERIA[name] for name in dict.fromkeys(names))


def half_full(system: System) -> list[float] | None:
    """Return the momenta of the wheels (N m s) with the fullest one half full.

    Their sum lies along (1, 1, 1), body, and they hold nothing against each other. None
    where the craft has no wheels with a known capacity.
    """
    wheels = system.roles.get("wheels")
    if wheels is None or "h_start_wheel" not in wheels.interface.arrays:
        return None
    hardware = hardware_of(system)
    there = np.linalg.norm(hardware.axes_wheel, axis=0) > 0.0
    capacity = hardware.capacity[there]
    if not len(capacity) or not np.isfinite(capacity).all() or not capacity.all():
        return None
    h = np.zeros(len(there))
    h[there] = np.linalg.pinv(hardware.axes_wheel[:, there]) @ np.ones(3)
    fullest = float((np.abs(h[there]) / capacity).max())
    return [HALF * float(x) / fullest for x in h]


def time_to_empty(manifest: Manifest, results: Results) -> float:
    """Return the time (min) until the fullest wheel is filled to `EMPTY` %.

    It is infinite where that does not happen, and NaN where the fill is not known.
    """
    fill = management.fill(manifest, results)
    if fill is None:
        return np.nan
    below = np.flatnonzero(fill <= EMPTY)
    times = results.times()
    return float(times[below[0]] - times[0]) / 60.0 if len(below) else np.inf


def beats(one: Sequence[float], other: Sequence[float]) -> bool:
    """Return whether one law is as good in all criteria and better in one.

    Values that differ by less than `ALIKE` are as good as each other. A criterion that
    is not known (NaN) for one of them does not count.
    """
    both = [
        (a, b) for a, b in zip(one, other, strict=True) if not np.isnan([a, b]).any()
    ]
    as_good = all(a <= b * (1.0 + ALIKE) for a, b in both)
    return as_good and any(a * (1.0 + ALIKE) < b for a, b in both)
