"""Fit residual dipole, centre of pressure and a steady torque of a craft to a log.

Momentum is affine in these parameters (`sizing/intervals.py`), so that they follow from
linear least squares of

    y(t) = H_segment + J_0(t) + sum_k p_k J_k(t)

by the impulses J of the craft's own torques. The covariance has two parts:

- what is left of y, with the number of independent samples that its autocorrelation
  leaves,
- the errors of field model and attitude, constant and once an orbit, each of which is
  led through the fit.

A direction in the space of the parameters whose deviation is larger than the spread
that is known without the log is not observed: there the craft's values stay.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..analyses.flight import integral, torques, values_of
from ..analyses.motion import is_known_body
from ..campaign.sampling import NINETY
from ..language.content import dispersions_of
from ..language.scenario import Dispersion
from ..numbers.derived import cross, rotate, rotate_back
from ..sizing.intervals import ImpulseBases
from ..system.errors import DesatError
from ..system.model import System
from .log import Log
from .momentum import MeasuredMomentum, measure_momentum

Array = NDArray[np.float64]
DIPOLE, OFFSET, STEADY = (
    "residual_dipole_body",
    "offset_plates_body",
    "tau_disturbance_body",
)
#: Parameters that are fitted, and their units.
UNITS = {DIPOLE: "A.m2", OFFSET: "m", STEADY: "N.m"}
TITLES = {
    DIPOLE: "residual dipole",
    OFFSET: "offset of the centre of pressure",
    STEADY: "steady torque",
}
FIELD_ERROR = 100e-9  # T: standard deviation of a model of the field, each axis
ATTITUDE_ERROR = np.radians(0.1)  # rad: standard deviation of an attitude, each axis
HARMONICS = 0.5, 1.0, 2.0  # of the orbit: courses of errors beside the constant
ALONG = 0.97  # cosine between a direction and the line that it is called by
UNEXPLAINED = 0.1  # share of the momentum that may be left without an explanation
MOST_UNEXPLAINED = 0.5  # the same, whatever the noise
BEYOND_NOISE = 10.0  # of what noise leaves, from which on a log is not explained
OBSERVED = 0.9  # share of its spread below which a deviation counts as observed
SINGULAR = 1e-12  # share of the largest square from which on a direction is none
WORSE = 3.0  # factor on a deviation from which on a steady torque hides a parameter


@dataclass(frozen=True)
class ParameterFit:
    """Vector of a craft as it was and as the log has it."""

    name: str
    unit: str
    before: Array  # (3,)
    spread: Array  # (3,) standard deviation that is known without the log
    value: Array  # (3,) that of the craft where it is not observed
    deviation: Array  # (3,) standard deviation
    is_observed: NDArray[np.bool_]  # (3,)


@dataclass(frozen=True)
class Fit:
    """Parameters of a craft that a log shows."""

    parameters: Mapping[str, ParameterFit]
    unobservable: Sequence[str]  # directions, in words
    residual: float  # N m s, root mean square
    momentum: float  # N m s, root mean square of what is to be explained
    independent: float  # number of independent samples
    notes: Sequence[str]


def fit(
    system: System,
    log: Log,
    errors: tuple[float, float] = (FIELD_ERROR, ATTITUDE_ERROR),
) -> Fit:
    """Fit the parameters of a craft to a log.

    Parameters
    ----------
    system
        The craft, with the environment in which it flew.
    log
        Its telemetry.
    errors
        Standard deviations of each axis of the field's model (T) and of the attitude
        (rad).

    Raises
    ------
    DesatError
        If the log lacks what is needed (`measure_momentum`), its momentum is not
        explained by the craft's torques, or nothing is observed.
    """
    values = values_of(system)["spacecraft"]
    names = [n for n in UNITS if n in values]
    if not names or not is_known_body(system, "spacecraft"):
        raise DesatError(f"{system.name}: spacecraft: a block of ours is needed")
    measured_momentum = measure_momentum(system, log)
    problem = _Problem(system, measured_momentum, names, errors)
    notes = []
    if STEADY in names and not _is_steady_known(system):
        others = [n for n in names if n != STEADY]
        if _hides(problem.solve(names, True), problem.solve(others, True)):
            names = others
            notes.append(
                "a steady torque cannot be told from the others: that of craft.toml stands"
            )
    solution = problem.solve(names)
    _check_explained(log, problem.size, solution)
    parameters = {x.name: x for x in solution.parameters}
    if not any(x.is_observed.any() for x in parameters.values()):
        raise DesatError(
            f"{log.place}: nothing is observed: a longer log, or one of another attitude, "
            "is needed"
        )
    return Fit(
        parameters,
        solution.unobservable,
        solution.residual,
        problem.size,
        solution.independent,
        notes,
    )


def _is_steady_known(system: System) -> bool:
    """Return whether the craft says that it has a steady torque."""
    value = system.components["spacecraft"].values[STEADY]
    return bool(np.any(value)) or f"spacecraft.{STEADY}" in dispersions_of(system)


@dataclass(frozen=True)
class _Solution:
    """Solution of the least squares for some parameters."""

    parameters: Sequence[ParameterFit]
    unobservable: Sequence[str]
    residual: float  # N m s, root mean square
    noise: float  # N m s, root mean square of what the errors make
    independent: float  # number of independent samples


def _hides(solution: _Solution, alone: _Solution) -> bool:
    """Return whether a steady torque makes deviations much larger than without it."""
    return any(
        bool((x.deviation > WORSE * y.deviation)[y.is_observed].any())
        for x, y in zip(solution.parameters, alone.parameters, strict=False)
    )


def _check_explained(log: Log, size: float, solution: _Solution) -> None:
    """Raise DesatError where torques do not explain a momentum of `size` (N m s)."""
    limit = max(UNEXPLAINED * size, BEYOND_NOISE * solution.noise)
    limit = min(limit, MOST_UNEXPLAINED * size)
    if solution.residual <= limit:
        return
    raise DesatError(
        f"{log.place}: the craft's torques do not explain its momentum: "
        f"{solution.residual:.3g} of {size:.3g} N m s are left; are epoch, orbit, "
        "attitude (--scalar-first) and wheels those of the log?"
    )


class _Problem:
    """Least squares of momentum, and the errors that it is subject to."""

    def __init__(
        self,
        system: System,
        momentum: MeasuredMomentum,
        names: Sequence[str],
        errors: tuple[float, float],
    ) -> None:
        """Prepare the columns of the parameters `names` and of the errors."""
        self._system, self._momentum, self._errors = system, momentum, errors
        flight = momentum.flight
        none = np.zeros_like(flight.disturbance)
        flight = replace(flight, sources={"constant": none, **flight.sources})
        bases = ImpulseBases(system, flight, names)
        columns: dict[tuple[str, int], Array] = {}
        for (name, element, _), impulse in zip(bases.terms, bases.rows, strict=True):
            columns[name, element] = columns.get((name, element), 0.0) + impulse
        fixed_part = columns.pop(("", -1), none)
        self._y = self._centre(momentum.y - momentum.at_blocks(fixed_part))
        self._columns = {
            key: self._centre(momentum.at_blocks(x)) for key, x in columns.items()
        }
        values = system.components["spacecraft"].values
        self._before = {n: np.array(values[n], float) for n in names}
        #: N m s, root mean square of the momentum that the parameters are to explain
        self.size = float(np.sqrt(np.mean(self._y**2)))

    def _centre(self, values: Array) -> Array:
        """Subtract the mean of each segment from values (n, 3)."""
        segments = self._momentum.segments
        number = np.unique(segments, return_inverse=True)[1]
        count = np.bincount(number)[:, None]
        means = np.stack([np.bincount(number, x) for x in values.T], axis=1) / count
        return np.asarray(values - means[number])

    def solve(self, names: Sequence[str], is_alone: bool = False) -> _Solution:
        """Solve for some parameters; the others are as the craft has them.

        With `is_alone` the log alone counts, not what is known without it.
        """
        before = np.concatenate([self._before[n] for n in names])
        spread = np.concatenate([self._spread(n, is_alone) for n in names])
        matrix = spread * np.stack(
            [self._columns[n, k].ravel() for n in names for k in range(3)], axis=1
        )
        rest = self._y.ravel()
        for (name, k), column in self._columns.items():
            rest = rest - self._before[name][k] * column.ravel()
        squares, axes = np.linalg.eigh(matrix.T @ matrix)
        is_regular = squares > SINGULAR * squares[-1]
        axes, squares = axes[:, is_regular], squares[is_regular]
        residual = rest - matrix @ (axes / squares @ (axes.T @ (matrix.T @ rest)))
        residual = residual.reshape(-1, 3)
        variance, independent = _sample_variance(residual, len(spread))
        axes, squares = axes[:, squares > variance], squares[squares > variance]
        # to the coordinates along these axes, in which the covariance is diagonal
        solver = (axes / squares).T @ matrix.T
        covariance = np.diag(variance / squares)
        value = before + spread * (axes @ (solver @ rest))
        vectors = np.split(value, len(names))
        errors = list(self._error_columns(dict(zip(names, vectors, strict=True))))
        for error in errors:
            change = solver @ error.ravel()
            covariance = covariance + np.outer(change, change)
        sizes, turn = np.linalg.eigh(covariance)
        observed_axes = (axes @ turn)[:, sizes < 1.0]
        sizes = sizes[sizes < 1.0]
        unseen = np.eye(len(spread)) - observed_axes @ observed_axes.T
        projector = axes.T @ observed_axes @ observed_axes.T
        value = before + spread * ((solver @ rest) @ projector)
        squares = observed_axes**2 @ sizes + np.diag(unseen)
        parameters = []
        unobservable: list[str] = []
        for i, name in enumerate(names):
            part = slice(3 * i, 3 * i + 3)
            parameter = ParameterFit(
                name,
                UNITS[name],
                before[part],
                spread[part],
                value[part],
                spread[part] * np.sqrt(squares[part]),
                squares[part] < OBSERVED**2,
            )
            parameters.append(parameter)
            unobservable += self._describe_unseen(parameter, unseen[part, part])
        steps = np.diff(residual, axis=0)  # what is rough of it is noise
        noise = (
            sum(float(np.mean(x**2)) for x in errors) + float(np.mean(steps**2)) / 2.0
        )
        return _Solution(
            parameters,
            unobservable,
            float(np.sqrt(np.mean(residual**2))),
            float(np.sqrt(noise)),
            independent,
        )

    def _spread(self, name: str, is_alone: bool) -> Array:
        """Return the standard deviation (3,) of a parameter that is known without a log.

        It is that of [dispersions]; without an entry, and with `is_alone`, it is the
        value whose torque would make all of the momentum.
        """
        before = self._before[name]
        size = float(np.linalg.norm(before))
        columns = [self._columns[name, k] for k in range(3)]
        effect = float(np.sqrt(np.mean(np.square(columns))))
        fallback = max(size, self.size / effect) if effect > 0.0 else max(size, 1.0)
        spec = dispersions_of(self._system).get(f"spacecraft.{name}")
        spread = np.zeros(3) if spec is None or is_alone else _deviation_of(spec, size)
        return np.where(spread > 0.0, spread, fallback)

    def _error_columns(self, values: Mapping[str, Array]) -> Iterator[Array]:
        """Yield what each error of field and attitude adds to the momentum (n, 3) N m s.

        The parameters have these values. An error is constant, or a sine or cosine of
        the orbit's angle, about each axis.
        """
        momentum, flight = self._momentum, self._momentum.flight
        inputs = dict(flight.inputs)
        q = inputs.pop("q_bi")
        dipole = momentum.dipole + values.get(DIPOLE, np.zeros(3))
        angle = 2.0 * np.pi * (flight.times - flight.times[0]) / flight.period
        courses = [np.ones_like(angle)]
        for order in HARMONICS:
            courses += [np.cos(order * angle), np.sin(order * angle)]
        changes = {n: x.tolist() for n, x in values.items()}

        def torque_at(attitude: Array) -> Array:
            """Return the torque (rows, 3) N m, eci, of craft and coils at an attitude."""
            each = torques(self._system, inputs, attitude, changes)
            coils = cross(momentum.dipole, rotate(attitude, flight.b))
            return rotate_back(attitude, coils) + sum(each.values())

        nominal = torque_at(q)
        for course in np.stack(courses)[:, :, None] / np.sqrt(2.0):
            for axis in np.eye(3):
                field = self._errors[0] * course * axis
                torque = rotate_back(q, cross(dipole, rotate(q, field)))
                yield self._centre(momentum.at_blocks(integral(torque, flight.times)))
                turn = self._errors[1] * course * axis
                change = torque_at(_turn(q, turn)) - nominal
                along = momentum.at_blocks(rotate_back(q, turn))
                yield self._centre(
                    cross(along, momentum.h)
                    - momentum.at_blocks(integral(change, flight.times))
                )

    def _describe_unseen(self, parameter: ParameterFit, unseen: Array) -> Iterator[str]:
        """Yield the directions of a parameter that are not observed, in words.

        `unseen` (3, 3) projects what is scaled by the spreads onto them.
        """
        title = TITLES[parameter.name]
        shares, axes = np.linalg.eigh(unseen)
        if (shares > 0.5).all():
            yield f"{title}: not observable"
            return
        flight = self._momentum.flight
        lines = {
            "the Sun line": rotate(flight.q, flight.inputs["sun_eci"]),
            "the direction of flight": rotate(flight.q, flight.v),
        }
        for direction in axes[:, shares > 0.5].T * parameter.spread:
            direction = direction / np.linalg.norm(direction)
            text = (
                "along [" + ", ".join(f"{x:.2f}" for x in direction) + "] of the body"
            )
            for name, rows in (
                *dict(zip("xyz", np.eye(3)[:, None], strict=True)).items(),
                *lines.items(),
            ):
                size = np.sqrt(np.mean(np.sum(rows**2, axis=1)))
                if abs(rows.mean(axis=0) @ direction) > ALONG * size:
                    text = f"along {name}"
            yield f"{title} {text}: not observable"


def _deviation_of(spec: Dispersion, size: float) -> Array:
    """Return the standard deviation (3,) of a vector of a size by its dispersion.

    It is 0 where the dispersion does not give one.
    """
    if spec.plus_minus is not None:
        return np.broadcast_to(np.array(spec.plus_minus) / NINETY, 3)
    deviation = 0.0
    if spec.direction is not None:
        deviation = spec.direction * (spec.factor or 1.0) / np.sqrt(3.0)
    elif spec.factor is not None:
        deviation = size * (spec.factor ** (1.0 / NINETY) - 1.0)
    elif spec.normal:
        deviation = spec.normal[1]
    return np.full(3, deviation)


def _sample_variance(residual: Array, count: int) -> tuple[float, float]:
    """Estimate the variance of a residual (n, 3) as if samples were independent.

    The autocorrelation is summed up to its first zero. Returns that variance times the
    samples that stand for an independent one, and the number of these. `count`
    parameters have been fitted.
    """
    n = len(residual)
    spectrum = np.abs(np.fft.rfft(residual - residual.mean(axis=0), 2 * n, axis=0)) ** 2
    lags = np.fft.irfft(spectrum.sum(axis=1))[:n]
    correlation = lags / max(lags[0], 1e-300)
    end = int(np.argmax(correlation < 0.0)) or n
    dependent = max(1.0, 1.0 + 2.0 * float(correlation[1:end].sum()))
    independent = max(residual.size / dependent, count + 1.0)
    square = float(np.mean(residual**2)) * independent / (independent - count)
    return square * residual.size / independent, independent


def _turn(q: Array, turn: Array) -> Array:
    """Turn attitudes q (n, 4) by small angles (n, 3) rad, body."""
    vector, scalar = q[:, :3], q[:, 3:]
    change = np.hstack(
        [
            scalar * turn - cross(turn, vector),
            -(turn * vector).sum(axis=1, keepdims=True),
        ]
    )
    turned_q = q + 0.5 * change
    return np.asarray(turned_q / np.linalg.norm(turned_q, axis=1, keepdims=True))
