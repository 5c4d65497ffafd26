"""Estimate disturbance torques and the effectiveness of actuators in flight.

The momentum H (N m s, eci) of the whole craft, measured at each sample, obeys

    H' = s T_GG + T_eci + C_o' (T_o + T_c cos u + T_s sin u) + (C' d) x B
         + sum_j e_j C' (m_j a_j x B) + sum_i f_i C' t_i

with T_GG the gravity gradient in the law's model, T_eci (eci), T_o, T_c and T_s (lvlh)
constant, u the argument of latitude, d the craft's own dipole (A m2, body), e and f the
signed effectiveness of coils and thrusters, m and t their commands (A m2, N m). A
Kalman filter estimates x = (H, s, T_eci, T_o, d, e, f, T_c, T_s); its parameters
perform a random walk. H is measured with the sensors' noise, and its process noise stands for
torques that are not modelled. With A (3 x CAUSES) the effect of a unit of each
parameter on H over the sample (`causes`), the prediction is x -> F x, P -> F P F' + Q,

    F = [[1, A], [0, 1]].

A torque that is not modelled, as air at a low perigee or a vent, must not look like a
lost coil. The mean innovation of the last sixtieth of an orbit, less what the
uncertain parameters explain, is the size of such a torque and sets the process noise;
that size is remembered for an orbit (`gather`). An actuator is lost where the
innovations follow its command: where over a third of an orbit a change of its
effectiveness explains `EXPLAINED` of their power, and more than a constant torque or a
dipole (`find_failure`). Its effectiveness then becomes as uncertain as that of a coil
at first; before that, thrusters are known to `SPREAD_THRUSTER`. For use, a coil has
e = 1 or has failed and is dead, turned or has another effectiveness (`judge`). The prior
probability that it has failed is that of a `Doubt`, or `SUSPECTED` once the innovations
have followed its command.

Fault detection by a momentum balance: Willsky, Automatica 12 (1976) 601.
"""

from __future__ import annotations

from math import exp, inf, sqrt
from typing import NamedTuple

from ..contract.block import Table, Vec3, Vec4
from ..maths import kalman
from ..maths.vector import ZERO, dot, norm, scale, sub
from ..physics import atmosphere
from ..physics.orbit import EARTH_RADIUS, MU, elements_from_state

MOMENTUM_STATES = 3  # H, with which x begins
# Index in x of the first element of s, T_eci, T_o, d, e, f, and of T_c and T_s.
GRAVITY, INERTIAL, ORBITAL, DIPOLE, COILS, THRUSTERS, WAVES = 3, 4, 7, 10, 13, 17, 20
STATES = 26
CAUSES = STATES - MOMENTUM_STATES  # parameters
CANDIDATES = WAVES - INERTIAL  # what may explain a torque: T_eci, T_o, d, e and f
SMOOTHED = 1.0 / 60.0  # time over which innovations are averaged, in orbits
MEMORY = 1.0 / 3.0  # time over which they are compared with commands, in orbits
EXPLAINED = 0.7  # share of the torque's power that a lost actuator explains at least
CHANGED = 0.3  # least change of e or f that counts as a loss
# Innovations within so many standard deviations of a parameter's effect are no sign of
# a torque that is not modelled.
EXPECTED = 2.0
DEAD = 0.5  # share of the failed coils that give nothing
TURNED = 0.25  # share of the failed coils that give the opposite
# No actuator gives more than this multiple of its command, or of the opposite. Where a
# coil is hardly driven, the filter cannot distinguish its effectiveness from the
# craft's own dipole.
MOST = 1.1
SPREAD_GRAVITY = 0.3  # prior standard deviation of s (1)
SPREAD_ACTUATOR = 0.5  # prior standard deviation of e (1)
SPREAD_THRUSTER = 0.01  # prior standard deviation of f (1)
# Torque of the air at the perigee, of `air_torque`: on a cube of BULK_DENSITY (kg/m3), at
# AIR_ARM of its side from the centre of mass.
BULK_DENSITY = 1000.0
DRAG_COEFFICIENT = 2.2
AIR_ARM = 0.1


class Doubt(NamedTuple):
    """How readily a coil is taken for failed."""

    failure_prior: float  # prior probability that it has
    # true errors of e over those of P: torques last, and are not the white noise of P
    error_ratio: float
    expected_share: float  # as EXPECTED, of the effect of e


class Evidence(NamedTuple):
    """What the innovations of the last samples say of torques that are not modelled."""

    torque: Vec3  # N m, eci: mean innovation over time
    effects: tuple[Vec3, ...]  # N m by unit, eci: mean effect of each candidate
    # sums over MEMORY, each times s, of torque . effect, effect^2 and torque^2
    products: Table
    squares: Table
    total: float  # N2 m2 s
    excess: float  # N2 m2: torque^2 beyond EXPECTED
    recent: float  # N2 m2: its mean over an orbit


NO_CANDIDATE: Table = (0.0,) * CANDIDATES
NO_EVIDENCE = Evidence(
    ZERO, (ZERO,) * CANDIDATES, NO_CANDIDATE, NO_CANDIDATE, 0.0, 0.0, 0.0
)

# While momentum is held, coils give little, and a torque in pulses is soon as large.
HOLDING = Doubt(0.001, 3.5, 2.0)
# Wheels are emptied within minutes by coils that give all they have, so that a coil that
# is turned, four deviations off, must be seen at once.
EMPTYING = Doubt(0.01, 2.0, 4.0)
# Prior probability that a coil has failed whose command the innovations have followed. A
# torque in pulses, against which coils are driven, looks like that for a while.
SUSPECTED = 0.18
# The craft's own dipole explains a torque up to so many prior standard deviations.
MOST_DIPOLE = 5.0


def first_state(h: Vec3) -> Table:
    """Return the initial x, with H (N m s) as measured."""
    x = [0.0] * STATES
    for row in range(MOMENTUM_STATES):
        x[row] = h[row]
    x[GRAVITY] = 1.0
    for i in range(COILS, WAVES):
        x[i] = 1.0
    return tuple(x)


def air_torque(inertia: float, r: Vec3, v: Vec3) -> float:
    """Estimate the largest torque of the air on an orbit (N m), that at its perigee.

    inertia: the largest of the craft (kg m2), which gives the side of a homogeneous cube;
    r (m) and v (m/s): position and velocity, eci. Source: ours.
    """
    orbit = elements_from_state(r, v)
    perigee = orbit.semi_major_axis * (1.0 - orbit.eccentricity)
    side: float = (6.0 * inertia / BULK_DENSITY) ** 0.2
    pressure = (
        0.5
        * atmosphere.table(perigee - EARTH_RADIUS)
        * MU
        * (1.0 + orbit.eccentricity)
        / perigee
    )
    return DRAG_COEFFICIENT * pressure * AIR_ARM * side * side * side


def spreads(torque: float, air: float, dipole: float, noise: float) -> Table:
    """Return the standard deviations of `first_state`.

    noise (N m s) is that of H, torque (N m) that of the constant torques, to which air
    (N m) is added in lvlh, dipole (A m2) that of the craft's dipole.
    """
    deviations = [torque + air] * STATES
    for row in range(MOMENTUM_STATES):
        deviations[row] = noise
    deviations[GRAVITY] = SPREAD_GRAVITY
    for i in range(INERTIAL, ORBITAL):
        deviations[i] = torque
    for i in range(DIPOLE, COILS):
        deviations[i] = dipole
    for i in range(COILS, WAVES):
        deviations[i] = SPREAD_ACTUATOR if i < THRUSTERS else SPREAD_THRUSTER
    return tuple(deviations)


def vector(x: Table, first: int) -> Vec3:
    """Return three elements of x from index `first` on."""
    return (x[first], x[first + 1], x[first + 2])


def first_covariance(deviations: Table) -> Table:
    """Build the initial covariance P, row-major, of standard deviations as `spreads`."""
    p = [0.0] * (STATES * STATES)
    for i in range(STATES):
        p[STATES * i + i] = deviations[i] * deviations[i]
    return tuple(p)


def forgotten(p: Table, noise: float) -> Table:
    """Return P for H measured anew with `noise` (N m s), its past unknown."""
    cov = [0.0] * (STATES * STATES)
    for i in range(MOMENTUM_STATES, STATES):
        for j in range(MOMENTUM_STATES, STATES):
            cov[STATES * i + j] = p[STATES * i + j]
    for i in range(MOMENTUM_STATES):
        cov[STATES * i + i] = noise * noise
    return tuple(cov)


def causes(columns: tuple[Vec3, ...]) -> Table:
    """Arrange the effect of a unit of each parameter on H (N m s) as three rows.

    `columns` holds CAUSES vectors.
    """
    return tuple(
        columns[i][row] for row in range(MOMENTUM_STATES) for i in range(CAUSES)
    )


def update(
    x: Table,
    p: Table,
    h_measured: Vec3,
    effects: Table,
    noise: float,
    walk: float,
    errors: tuple[Vec3, ...],
    deviations: Table,
    drift: float,
    doubtful_state: int,
) -> tuple[Table, Table, float]:
    """Return (x, P) after a sample at whose end H is `h_measured` (N m s, eci).

    The third is the largest square of an innovation over its variance (1),
    `kalman.UNSOUND` where (x, P) can be those of nothing.

    Parameters
    ----------
    x, p : Table
        State and covariance (row-major) at the sample's begin.
    h_measured : Vec3
        H at its end (N m s, eci).
    effects : Table
        Effect of a unit of each parameter on H over the sample, of `causes`.
    noise : float
        Standard deviation of a measurement (N m s).
    walk : float
        Standard deviation of what changes H and is not modelled (N m s).
    errors : tuple
        The same of three independent errors along their axes (N m s, eci).
    deviations : Table
        Prior standard deviations, of `spreads`.
    drift : float
        Random walk of a parameter over its prior standard deviation (1).
    doubtful_state : int
        Index in x of an effectiveness that has changed, of `find_failure`; -1: none.
    """
    state, covariance = list(x), list(p)
    if doubtful_state >= 0:
        spread = max(deviations[doubtful_state], SPREAD_ACTUATOR)
        covariance[STATES * doubtful_state + doubtful_state] += spread * spread
    _predict(state, covariance, effects, walk, deviations, drift)
    for row in range(MOMENTUM_STATES):
        for other in range(MOMENTUM_STATES):
            for error in errors:
                covariance[STATES * row + other] += error[row] * error[other]
    worst = _correct(state, covariance, h_measured, noise)
    _constrain(state, covariance)
    if not kalman.is_sound(state, covariance):
        worst = kalman.UNSOUND
    return tuple(state), tuple(covariance), worst


def _constrain(x: list[float], p: list[float]) -> None:
    """Hold e and f within MOST, in place.

    What is beyond it is taken as an error, and so is what other parameters have with it by
    P: a limit on one alone would let the others drift.
    """
    for i in range(COILS, WAVES):
        nearest = min(max(x[i], -MOST), MOST)
        variance = p[STATES * i + i]
        if nearest != x[i] and variance > 0.0:
            share = (nearest - x[i]) / variance
            for j in range(STATES):
                x[j] += share * p[STATES * j + i]
        x[i] = nearest


def judge(x: Table, p: Table, doubt: Doubt, coil_suspicions: Vec4) -> Table:
    """Return the expected x where a coil gives its command, or has failed.

    x and P (row-major) are those of the filter; `coil_suspicions` of `suspect`. Without a
    failure e is 1; a coil that has failed is dead, e = 0, turned, e = -1, or has any e
    with the prior deviation `SPREAD_ACTUATOR`. The other elements are what they are
    with that. With the probabilities w of these cases by Bayes' rule, the expected x is
    that after a
    measurement of the mean e of the first three with the variance P_ee / (sum of w).
    """
    state, covariance = list(x), list(p)
    column = [0.0] * STATES
    for j in range(COILS, THRUSTERS):
        variance = covariance[STATES * j + j]
        prior = SUSPECTED if coil_suspicions[j - COILS] > 0.0 else doubt.failure_prior
        if variance > 0.0:
            spread = doubt.error_ratio * sqrt(variance)
            e = state[j]
            intact = (1.0 - prior) * _likelihood(e - 1.0, spread)
            dead = prior * DEAD * _likelihood(e, spread)
            reverse = prior * TURNED * _likelihood(e + 1.0, spread)
            known_weight = intact + dead + reverse
            other = prior * (1.0 - DEAD - TURNED) * sqrt(variance) / SPREAD_ACTUATOR
            correction = (intact - reverse) / known_weight - e
            for i in range(STATES):
                column[i] = covariance[STATES * i + j]
            total = variance * (1.0 + other / known_weight)
            kalman.correct(state, covariance, column, correction, total, STATES)
    _constrain(state, covariance)
    return tuple(state)


def _likelihood(error: float, spread: float) -> float:
    """Return the likelihood of an error with the standard deviation `spread`.

    It is relative to that of no error, and not below 1e-43.
    """
    return exp(-min(0.5 * (error / spread) * (error / spread), 100.0))


def _predict(
    x: list[float],
    p: list[float],
    effects: Table,
    walk: float,
    deviations: Table,
    drift: float,
) -> None:
    """Replace (x, P) by (F x, F P F' + Q)."""
    transition = [0.0] * (MOMENTUM_STATES * STATES)
    for i in range(MOMENTUM_STATES, STATES):
        step = drift * deviations[i]
        p[STATES * i + i] += step * step
    for row in range(MOMENTUM_STATES):
        transition[(STATES + 1) * row] = 1.0
        for i in range(CAUSES):
            effect = effects[CAUSES * row + i]
            transition[STATES * row + MOMENTUM_STATES + i] = effect
            x[row] += effect * x[MOMENTUM_STATES + i]
    kalman.predict(x, p, transition)
    for row in range(MOMENTUM_STATES):
        p[(STATES + 1) * row] += walk * walk


def innovation(x: Table, h_measured: Vec3, effects: Table) -> Vec3:
    """Return the measured H less its prediction (N m s, eci); arguments as `update`."""
    difference = [0.0, 0.0, 0.0]
    for row in range(MOMENTUM_STATES):
        difference[row] = h_measured[row] - x[row]
        for i in range(CAUSES):
            difference[row] -= effects[CAUSES * row + i] * x[MOMENTUM_STATES + i]
    return (difference[0], difference[1], difference[2])


def deviation_along(
    p: Table, effects: Table, axis: Vec3, known_state: int, noise: float
) -> float:
    """Return the standard deviation (N m s) of the innovation along an axis (eci).

    The parameter with the index `known_state` in x counts as known. p is the covariance
    (row-major) at the sample's begin, the other arguments are those of `update`.
    """
    along = [0.0] * STATES
    for row in range(MOMENTUM_STATES):
        along[row] = axis[row]
        for i in range(CAUSES):
            along[MOMENTUM_STATES + i] += axis[row] * effects[CAUSES * row + i]
    along[known_state] = 0.0
    total = noise * noise
    for i in range(STATES):
        for j in range(STATES):
            total += along[i] * p[STATES * i + j] * along[j]
    return sqrt(max(total, 0.0))


def gather(
    evidence: Evidence,
    p: Table,
    innovation: Vec3,
    effects: Table,
    elapsed_time: float,
    orbit: float,
    doubt: Doubt,
) -> Evidence:
    """Return the evidence after a sample, from `NO_EVIDENCE` on.

    Parameters
    ----------
    evidence : Evidence
        Before it.
    p : Table
        Covariance (row-major) at its begin.
    innovation : Vec3
        Of `innovation` (N m s, eci).
    effects : Table
        Of `causes`.
    elapsed_time, orbit : float
        The sample's time and the orbit's period (s).
    doubt : Doubt
        Of the coils.
    """
    means = [ZERO] * CANDIDATES
    products = [0.0] * CANDIDATES
    squares = [0.0] * CANDIDATES
    share = min(elapsed_time / (SMOOTHED * orbit), 1.0)
    memory = max(1.0 - elapsed_time / (MEMORY * orbit), 0.0)
    torque = _average(evidence.torque, innovation, elapsed_time, share)
    power = dot(torque, torque)
    excess = power
    for j in range(CANDIDATES):
        i = INERTIAL + j
        k = i - MOMENTUM_STATES
        effect = (effects[k], effects[CAUSES + k], effects[2 * CAUSES + k])
        effect = _average(evidence.effects[j], effect, elapsed_time, share)
        square = dot(effect, effect)
        means[j] = effect
        products[j] = memory * evidence.products[j] + elapsed_time * dot(torque, effect)
        squares[j] = memory * evidence.squares[j] + elapsed_time * square
        most = doubt.expected_share if COILS <= i < THRUSTERS else EXPECTED
        excess -= most * most * p[STATES * i + i] * square
    excess = max(excess, 0.0)
    return Evidence(
        torque,
        tuple(means),
        tuple(products),
        tuple(squares),
        memory * evidence.total + elapsed_time * power,
        excess,
        evidence.recent + min(elapsed_time / orbit, 1.0) * (excess - evidence.recent),
    )


def _average(mean: Vec3, impulse: Vec3, elapsed_time: float, share: float) -> Vec3:
    """Return a mean torque (N m) with a `share` of an impulse (N m s) in `elapsed_time` s."""
    return (
        mean[0] + share * (impulse[0] / elapsed_time - mean[0]),
        mean[1] + share * (impulse[1] / elapsed_time - mean[1]),
        mean[2] + share * (impulse[2] / elapsed_time - mean[2]),
    )


def find_failure(evidence: Evidence, x: Table, dipole: float) -> int:
    """Return the index in x of the effectiveness that has changed; -1: none.

    It has changed where the torque that is not modelled follows the actuator's
    command, neither a constant torque nor a dipole explains as much, and the changed
    effectiveness is one that an actuator can have.

    Parameters
    ----------
    evidence : Evidence
        Of `gather`.
    x : Table
        State of the filter.
    dipole : float
        Prior standard deviation of the craft's dipole (A m2).
    """
    most = EXPLAINED
    for first in (INERTIAL, ORBITAL, DIPOLE):
        limit = MOST_DIPOLE * dipole if first == DIPOLE else inf
        total = 0.0
        for i in range(first, first + 3):
            total += _share(evidence, i, limit)
        most = max(most, total)
    worst = -1
    for i in range(COILS, WAVES):
        j = i - INERTIAL
        share = _share(evidence, i, inf)
        if share > most:
            change = evidence.products[j] / evidence.squares[j]
            if abs(change) > CHANGED and abs(x[i] + change) < MOST + CHANGED:
                worst, most = i, share
    return worst


def suspect(coil_suspicions: Vec4, failed_actuator: int) -> Vec4:
    """Return which coils are suspected (1), with one of `find_failure` more."""
    flags = [0.0, 0.0, 0.0, 0.0]
    for j in range(THRUSTERS - COILS):
        flags[j] = 1.0 if failed_actuator == COILS + j else coil_suspicions[j]
    return (flags[0], flags[1], flags[2], flags[3])


def _share(evidence: Evidence, i: int, most: float) -> float:
    """Return the share of the torque's power that a change of x[i] explains.

    The change is `most` at most.
    """
    j = i - INERTIAL
    product, square = abs(evidence.products[j]), evidence.squares[j]
    total = evidence.total
    if square * total <= 0.0:
        return 0.0
    change = min(product / square, most)
    return change * (2.0 * product - change * square) / total


def explain(evidence: Evidence, failed_actuator: int) -> Evidence:
    """Return the evidence without the torque that a failed actuator explains.

    failed_actuator: of `find_failure`. What follows the commands is gathered anew.
    """
    j = failed_actuator - INERTIAL
    change = evidence.products[j] / evidence.squares[j]
    remainder = max(1.0 - _share(evidence, failed_actuator, inf), 0.0)
    return Evidence(
        sub(evidence.torque, scale(change, evidence.effects[j])),
        evidence.effects,
        NO_CANDIDATE,
        NO_CANDIDATE,
        0.0,
        0.0,
        evidence.recent * remainder,
    )


def known_torque(x: Table) -> float:
    """Return the size of the torques that x has (N m), without gravity and dipole."""
    total = 0.0
    for first in (INERTIAL, ORBITAL, WAVES, WAVES + 3):
        total += norm(vector(x, first))
    return total


def unmodelled_torque(evidence: Evidence) -> float:
    """Return the standard deviation of the torque that is not modelled (N m, an axis)."""
    return sqrt(max(evidence.excess, evidence.recent) / 3.0)


def _correct(x: list[float], p: list[float], h_measured: Vec3, noise: float) -> float:
    """Correct (x, P) by the measured H (N m s, eci), one axis after the other.

    The result is the largest square of an innovation over its variance (1).
    """
    column = [0.0] * STATES
    worst = 0.0
    for row in range(MOMENTUM_STATES):
        for i in range(STATES):
            column[i] = p[STATES * i + row]
        variance = p[STATES * row + row] + noise * noise
        difference = h_measured[row] - x[row]
        worst = max(worst, kalman.surprise(difference, variance))
        kalman.correct(x, p, column, difference, variance, STATES)
    return worst
