"""Compute the minimum coil energy for the peak wheel momentum of a run.

This is `desat bound` for management by coils. The true field and attitude of a run, its
momentum at the start, and everything that changes the wheels' momentum except the coils
are taken as given. Over the manager's samples it is a convex quadratic programme
(`least_energy` of `components/laws/momentum_offline.py`). It minimises the integral of
the squared coil dipoles with each wheel within the largest wheel momentum of the run
from a time on, before that within its capacity, and leaves the final momentum free. The
wheels share their momentum by least squares, in the programme and in the run's peak. The
coils keep to their limit. It knows the whole run: no law with such samples needs less.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from desat.components.laws import momentum_management as laws
from desat.components.laws import momentum_offline as offline

from ..numbers.derived import from_body, rotate_back, unit_rows
from ..numbers.text import Value
from ..system.errors import DesatError
from ..system.typed import JsonObject
from ..system.wheels import smallest_capacity
from . import with_titles
from .manifest import Manifest

if TYPE_CHECKING:
    from ..engine.recording.results import Results

Array = NDArray[Any]

SIGNALS = (
    "spacecraft.q_bi",
    "environment.b_eci",
    "torquers.m_mean_body",
    "torquers.dipole_energy",
    "wheels.h_wheel",
)


START = 0.02  # share of a run that counts as its start
LATE = (
    0.5  # share of a run after which its momentum counts where the start's is largest
)
# share of a run's energy below which the minimum for its initial momentum is
# meaningless
WORTH = 0.01
UNKNOWN = 1e3  # N m s, capacity of wheels that do not state theirs
ACCURACY = 1e-3  # of the minimum, relative


@dataclass(frozen=True)
class CoilBound:
    """Coil energy of a run, and its lower bound."""

    energy: float  # A2 m4 s, integral of the squared dipoles of all coils
    peak: float  # N m s, the largest momentum of a wheel from `first` on
    first: float  # s, time from which the momentum counts
    limit: float | None  # A m2, of the dipole of a coil; None: without
    # A2 m4 s, minimum energy with no larger peak; None: none is found
    least: float | None
    above_percent: float | None  # %, excess of the run over the minimum
    ease: float  # 1, by which the limits of the minimum are wider than the run's

    def numbers(self) -> dict[str, Value]:
        """Return the numbers for a manifest; unknown ones are left out."""
        rows: dict[str, tuple[str, float | None, str]] = {
            "energy": ("Integral of the squared coil dipoles", self.energy, "A2.m4.s"),
            "peak": (
                f"Largest momentum of a wheel from t = {self.first:g} s on",
                self.peak,
                "N.m.s",
            ),
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


def of_run(
    manifest: Manifest, results: Results, first: float | None = None
) -> CoilBound:
    """Compute the bound of a run for its largest wheel momentum from `first` (s) on.

    None: from the start, or over the second half where the largest momentum is that of
    the start and takes hardly any energy to keep.

    Raises
    ------
    DesatError
        If a series is not recorded, if `first` is not within the run, or if the
        programme cannot be solved.
    """
    course = course_of(manifest, results)
    spent, momenta = (results.values(s) for s in SIGNALS[-2:])
    axes = _axes_of(manifest)
    shared = momenta @ axes.T @ np.linalg.pinv(axes).T
    fullest, used = np.abs(shared).max(axis=1), 2.0 * float(spent[-1])
    times = results.times()[: len(fullest)]
    if first is not None and not times[0] <= first < times[-1]:
        raise DesatError(
            f"{manifest.scenario}: --from {first:g}: a time from {times[0]:g} s on and before "
            f"{times[-1]:g} s is needed"
        )
    begin = float(times[0]) if first is None else first
    peak = float(fullest[times >= begin].max())
    bound = _least(manifest, *course, peak, begin)
    at_start = int(fullest.argmax()) < START * len(fullest)
    if first is None and at_start and bound is not None and bound.energy < WORTH * used:
        begin = float(times[int(LATE * len(times))])
        peak = float(fullest[times >= begin].max())
        bound = _least(manifest, *course, peak, begin)
    limit = _limit_of(manifest)
    energy = None if bound is None else bound.energy
    if energy is not None and energy > used * (1.0 + ACCURACY):
        raise DesatError(
            f"{manifest.scenario}: no bound: the programme finds {energy:.4g} A2.m4.s, and the "
            f"run takes {used:.4g}: dipoles held over samples of {course[0].dt:g} s do not "
            "describe it"
        )
    return CoilBound(
        used,
        peak,
        begin,
        limit if np.isfinite(limit) else None,
        energy,
        max(0.0, 100.0 * (used / energy - 1.0)) if energy else None,
        0.0 if bound is None else bound.ease,
    )


def curve(
    manifest: Manifest, results: Results, peaks: Sequence[float]
) -> list[tuple[float, float]]:
    """Compute the minimum energy (A2 m4 s) for each peak wheel momentum (N m s).

    Peaks without a solution are left out.
    """
    course = course_of(manifest, results)
    bounds = ((p, _least(manifest, *course, p, manifest.start)) for p in peaks)
    return [(p, least.energy) for p, least in bounds if least is not None]


def _least(
    manifest: Manifest,
    course: offline.Course,
    start: Array,
    dipoles: Array,
    peak: float,
    first: float,
) -> offline.LeastEnergy | None:
    """Compute the least energy for a peak (N m s) from a time (s) on.

    None where there is no momentum, and where no course is found.
    """
    if not course.field.any():
        raise DesatError(
            f"{manifest.scenario}: no bound: there is no field, so that coils do nothing"
        )
    if peak <= 0.0:
        return None
    ends = manifest.start + course.dt * np.arange(1, len(course.field) + 1)
    most = np.where(ends >= first, peak, max(peak, _capacity_of(manifest)))
    limits = offline.Limits(most[:, None], _limit_of(manifest))
    try:
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            return offline.least_energy(course, limits, start, dipoles)
    except (ValueError, RuntimeError, np.linalg.LinAlgError) as error:
        raise DesatError(
            f"{manifest.scenario}: no bound: the programme of the least energy cannot be solved "
            f"({error})"
        ) from error


def _capacity_of(manifest: Manifest) -> float:
    """Return the momentum (N m s) that any wheel can take; 1e3 N m s if not known."""
    capacity = smallest_capacity(manifest.values_of("wheels"))
    return capacity if 0.0 < capacity < np.inf else UNKNOWN


def _limit_of(manifest: Manifest) -> float:
    """Return the largest dipole (A m2) of a coil that is held; inf without a limit."""
    torquers = manifest.values_of("torquers")
    if torquers.get("drive") not in ("limited", "pulsed"):
        return np.inf
    share = torquers["duty_max"] if torquers["drive"] == "pulsed" else 1.0
    return float(np.max(torquers["m_limit"])) * float(share)


def course_of(
    manifest: Manifest, results: Results
) -> tuple[offline.Course, Array, Array]:
    """Collect what changes the wheels' momentum over samples, its start, and the dipoles.

    The course is in eci, over the manager's samples, with the coils that work at the
    start. The run's mean dipoles (samples, 3; A m2, eci) lead along it from the momentum
    at the start (3,; N m s, eci) to that of the run at every sample, so that the run is
    one of the programme's candidates.

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
    q, field, dipole = (results.values(s) for s in SIGNALS[:3])
    parameters = {c: manifest.values_of(c) for c in manifest.parameters}
    step = manifest.step
    every = max(1, round(parameters["manager"]["sample_time"] / step))
    count = len(dipole) // every
    middle = unit_rows(q[:-1] + q[1:])[: count * every]
    mean_field = (field[:-1] + field[1:])[: count * every] / 2.0
    dipoles = rotate_back(middle, dipole[: count * every])
    dipoles = dipoles.reshape(count, every, 3).mean(axis=1)
    mean_field = mean_field.reshape(count, every, 3).mean(axis=1)
    ends = slice(0, count * every + 1, every)
    at_ends, axes = unit_rows(q[ends]), _axes_of(manifest)
    momentum = rotate_back(at_ends, results.values("wheels.h_wheel")[ends] @ axes.T)
    changes = np.diff(momentum, axis=0) / (step * every) - np.cross(dipoles, mean_field)
    attitudes = from_body(at_ends).transpose(0, 2, 1)
    live = laws.without(
        tuple(parameters["torquers"]["axes_coil"]), _dead_at_start(manifest)
    )
    s = np.reshape(laws.weighting(live), (3, 3))
    inverse = np.linalg.pinv(axes)
    halves = from_body(middle[every // 2 :: every]).transpose(0, 2, 1)
    course = offline.Course(
        step * every,
        mean_field,
        changes,
        np.einsum("kia,ij,kjb->kab", halves, s, halves),
        np.einsum("wi,kia->kwa", inverse, attitudes[1:]),
        np.einsum("ci,kia->kca", np.linalg.pinv(np.reshape(live, (3, 4))), halves),
    )
    return course, momentum[0], dipoles


def _axes_of(manifest: Manifest) -> Array:
    """Return the axes of the wheels (3, n), body."""
    return np.reshape(manifest.values_of("wheels")["axes_wheel"], (3, -1))


def _dead_at_start(manifest: Manifest) -> int:
    """Return the coil that gives nothing from the start on, from 1; 0: none.

    One that dies later counts as working: the bound is then lower than it has to be.
    """
    torquers = manifest.values_of("torquers")
    failed = torquers["failed_coil"]
    if failed == "none" or torquers.get("failed_share", 0.0) != 0.0:
        return 0
    return int(failed) if torquers["failed_from"] <= manifest.start else 0
