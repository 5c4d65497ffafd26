"""Compute the minimum coil energy for the peak wheel momentum of a run.

This is `desat bound` for management by coils. The true field and attitude of a run, and
with them every external torque except the coils', are taken as given. Over the
manager's samples it is a convex quadratic programme (`least_energy` of
`components/laws/momentum_offline.py`). It minimises the integral of the squared coil
dipoles with each wheel within the largest wheel momentum of the run, and leaves the
final momentum free. It knows the whole run, and its coils have no limit: no law with
such samples needs less.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from desat.components.laws import momentum_management as laws
from desat.components.laws import momentum_offline as offline

from ..numbers.derived import from_body, rotate_back, unit_rows
from ..numbers.text import Value
from ..system.errors import DesatError
from ..system.typed import JsonObject
from . import with_titles
from .manifest import Manifest

if TYPE_CHECKING:
    from ..engine.recording.results import Results

SIGNALS = (
    "spacecraft.q_bi",
    "spacecraft.impulse_eci",
    "environment.b_eci",
    "torquers.m_mean_body",
    "torquers.dipole_energy",
    "wheels.h_wheel",
)


START = 0.02  # share of a run that counts as its start
# share of a run's energy below which the minimum for its initial momentum is
# meaningless
WORTH = 0.01


@dataclass(frozen=True)
class CoilBound:
    """Coil energy of a run, and its lower bound."""

    energy: float  # A2 m4 s, integral of the squared dipoles of all coils
    peak: float  # N m s, the largest momentum of a wheel
    # A2 m4 s, minimum energy with no larger peak; None: none is found
    least: float | None
    above_percent: float | None  # %, excess of the run over the minimum

    def numbers(self) -> dict[str, Value]:
        """Return the numbers for a manifest; unknown ones are left out."""
        rows: dict[str, tuple[str, float | None, str]] = {
            "energy": ("Integral of the squared coil dipoles", self.energy, "A2.m4.s"),
            "peak": ("Largest momentum of a wheel", self.peak, "N.m.s"),
            "least": (
                "Least coil energy for the same peak momentum",
                self.least,
                "A2.m4.s",
            ),
            "above": ("Excess coil energy over the least", self.above_percent, "%"),
        }
        return with_titles(rows)

    def as_json(self) -> JsonObject:
        """Return the content of `--json`."""
        return asdict(self)


def of_run(manifest: Manifest, results: Results) -> CoilBound:
    """Compute the bound of a run.

    Raises
    ------
    DesatError
        If a series is not recorded, if the largest momentum is that of the start and
        takes hardly any energy to keep, or if the programme cannot be solved.
    """
    course, start = course_of(manifest, results)
    energy, wheels = (results.values(s) for s in SIGNALS[-2:])
    fullest = np.abs(wheels).max(axis=1)
    used, peak = 2.0 * float(energy[-1]), float(fullest.max())
    try:
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            least = offline.least_energy(course, peak, start) if peak > 0.0 else None
    except (ValueError, np.linalg.LinAlgError) as error:
        raise DesatError(
            f"{manifest.scenario}: no bound: the programme of the least energy cannot be solved "
            f"({error})"
        ) from error
    at_start = int(fullest.argmax()) < START * len(fullest)
    if at_start and least is not None and least < WORTH * used:
        raise DesatError(
            f"{manifest.scenario}: its largest momentum, {peak:.3g} N m s of a wheel, is that of "
            f"the start, which {least:.2g} A2 m4 s keep of {used:.3g}: that says nothing of a law "
            "that lowers it"
        )
    above = 100.0 * (used / least - 1.0) if least else None
    return CoilBound(used, peak, least, above)


def curve(
    manifest: Manifest, results: Results, peaks: Sequence[float]
) -> list[tuple[float, float]]:
    """Compute the minimum energy (A2 m4 s) for each peak wheel momentum (N m s).

    Peaks without a solution are left out.
    """
    course, start = course_of(manifest, results)
    energies = ((p, offline.least_energy(course, p, start)) for p in peaks)
    return [(p, least) for p, least in energies if least is not None]


def course_of(manifest: Manifest, results: Results) -> tuple[offline.Course, Any]:
    """Collect the external torques over the manager's samples, and the start momentum.

    The course is in eci, with the coils that work; the wheel momentum at the start is
    in N m s.

    Raises
    ------
    DesatError
        If a series is not recorded.
    """
    missing = [s for s in SIGNALS if s not in results.names()]
    if missing:
        raise DesatError(
            f"{manifest.scenario}: {missing[0]} is not recorded; a bound needs it"
        )
    q, impulse, field, dipole = (results.values(s) for s in SIGNALS[:4])
    parameters = {c: manifest.values_of(c) for c in manifest.parameters}
    step = manifest.step
    every = round(parameters["manager"]["sample_time"] / step)
    count = len(dipole) // every
    middle = unit_rows(q[:-1] + q[1:])[: count * every]
    mean_field = (field[:-1] + field[1:])[: count * every] / 2.0
    torque = np.cross(rotate_back(middle, dipole[: count * every]), mean_field)
    disturbance = np.diff(impulse, axis=0)[: count * every] - step * torque
    attitudes = from_body(unit_rows(q[: count * every + 1 : every])).transpose(0, 2, 1)
    failed = parameters["torquers"]["failed_coil"]
    gives = parameters["torquers"].get("failed_share", 0.0) != 0.0
    dead = 0 if failed == "none" or gives else int(failed)
    live = laws.without(tuple(parameters["torquers"]["axes_coil"]), dead)
    s = np.reshape(laws.weighting(live), (3, 3))
    inverse = np.linalg.pinv(np.reshape(parameters["wheels"]["axes_wheel"], (3, -1)))
    halves = from_body(middle[every // 2 :: every]).transpose(0, 2, 1)
    course = offline.Course(
        step * every,
        mean_field.reshape(count, every, 3).mean(axis=1),
        disturbance.reshape(count, every, 3).sum(axis=1) / (step * every),
        np.einsum("kia,ij,kjb->kab", halves, s, halves),
        np.einsum("wi,kia->kwa", inverse, attitudes[1:]),
    )
    return course, impulse[0]
