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

Where a measurement differs by more than `DOUBT` standard deviations, a component has
failed, and the effectiveness becomes as uncertain as at first.

Fault detection by a momentum balance: Willsky, Automatica 12 (1976) 601.
"""

from __future__ import annotations

from ..contract.block import Table, Vec3
from ..maths import kalman

MOMENTUM_STATES = 3  # H, with which x begins
# Index in x of the first element of s, T_eci, T_o, d, e, f, and of T_c and T_s.
GRAVITY, INERTIAL, ORBITAL, DIPOLE, COILS, THRUSTERS, WAVES = 3, 4, 7, 10, 13, 17, 20
STATES = 26
CAUSES = STATES - MOMENTUM_STATES  # parameters
DOUBT = 6.0
# No actuator gives more than this multiple of its command, or of the opposite. Where a
# coil is hardly driven, the filter cannot distinguish its effectiveness from the
# craft's own dipole.
MOST = 1.1
SPREAD_GRAVITY = 0.3  # prior standard deviation of s (1)
SPREAD_ACTUATOR = 0.5  # prior standard deviation of e and f (1)


def first_state(h: Vec3) -> Table:
    """Return the initial x, with H (N m s) as measured."""
    x = [0.0] * STATES
    for row in range(MOMENTUM_STATES):
        x[row] = h[row]
    x[GRAVITY] = 1.0
    for i in range(COILS, WAVES):
        x[i] = 1.0
    return tuple(x)


def spreads(torque: float, dipole: float, noise: float) -> Table:
    """Return the standard deviations of `first_state`.

    noise (N m s) is that of H, torque (N m) that of the constant torques, dipole (A m2)
    that of the craft's dipole.
    """
    deviations = [torque] * STATES
    for row in range(MOMENTUM_STATES):
        deviations[row] = noise
    deviations[GRAVITY] = SPREAD_GRAVITY
    for i in range(DIPOLE, COILS):
        deviations[i] = dipole
    for i in range(COILS, WAVES):
        deviations[i] = SPREAD_ACTUATOR
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
    measured: Vec3,
    effects: Table,
    noise: float,
    walk: float,
    deviations: Table,
    drift: float,
) -> tuple[Table, Table]:
    """Return (x, P) after a sample at whose end H is `measured` (N m s, eci).

    Parameters
    ----------
    x, p : Table
        State and covariance (row-major) at the sample's begin.
    measured : Vec3
        H at its end (N m s, eci).
    effects : Table
        Effect of a unit of each parameter on H over the sample, of `causes`.
    noise : float
        Standard deviation of a measurement (N m s).
    walk : float
        Standard deviation of what changes H and is not modelled (N m s).
    deviations : Table
        Prior standard deviations, of `spreads`.
    drift : float
        Random walk of a parameter over its prior standard deviation (1).
    """
    state = [0.0] * STATES
    covariance = [0.0] * (STATES * STATES)
    for i in range(STATES):
        state[i] = x[i]
    for i in range(STATES * STATES):
        covariance[i] = p[i]
    _predict(state, covariance, effects, walk, deviations, drift)
    if _is_doubtful(state, covariance, measured, noise):
        _doubt_actuators(covariance, effects, deviations)
    _correct(state, covariance, measured, noise)
    for i in range(COILS, WAVES):
        state[i] = min(max(state[i], -MOST), MOST)
    return tuple(state), tuple(covariance)


def _predict(
    x: list[float],
    p: list[float],
    effects: Table,
    walk: float,
    deviations: Table,
    drift: float,
) -> None:
    """Replace (x, P) by (F x, F P F' + Q)."""
    for i in range(MOMENTUM_STATES, STATES):
        step = drift * deviations[i]
        p[STATES * i + i] += step * step
    moved = [0.0] * (MOMENTUM_STATES * STATES)
    for row in range(MOMENTUM_STATES):
        for j in range(STATES):
            moved[STATES * row + j] = _effect_on_row(p, effects, row, j)
        for i in range(CAUSES):
            x[row] += effects[CAUSES * row + i] * x[MOMENTUM_STATES + i]
    for row in range(MOMENTUM_STATES):
        for other in range(MOMENTUM_STATES):
            total = moved[STATES * row + other] + moved[STATES * other + row]
            for i in range(CAUSES):
                cause = STATES * row + MOMENTUM_STATES + i
                total += moved[cause] * effects[CAUSES * other + i]
            p[STATES * row + other] += total
        p[STATES * row + row] += walk * walk
    for row in range(MOMENTUM_STATES):
        for j in range(MOMENTUM_STATES, STATES):
            p[STATES * row + j] += moved[STATES * row + j]
            p[STATES * j + row] = p[STATES * row + j]


def _effect_on_row(p: list[float], effects: Table, row: int, j: int) -> float:
    """Return the element (row, j) of A times the parameters' rows of P."""
    total = 0.0
    for i in range(CAUSES):
        cause = STATES * (MOMENTUM_STATES + i) + j
        total += effects[CAUSES * row + i] * p[cause]
    return total


def _is_doubtful(x: list[float], p: list[float], measured: Vec3, noise: float) -> bool:
    """Return whether H is beyond `DOUBT` standard deviations of its prediction."""
    for row in range(MOMENTUM_STATES):
        variance = p[STATES * row + row] + noise * noise
        innovation = measured[row] - x[row]
        if innovation * innovation > DOUBT * DOUBT * variance:
            return True
    return False


def _doubt_actuators(p: list[float], effects: Table, deviations: Table) -> None:
    """Add to P the prior variances of e and f, and their effect on H by F."""
    for i in range(COILS, WAVES):
        p[STATES * i + i] += deviations[i] * deviations[i]
    first, end = COILS - MOMENTUM_STATES, WAVES - MOMENTUM_STATES
    for row in range(MOMENTUM_STATES):
        for other in range(MOMENTUM_STATES):
            for i in range(first, end):
                deviation = deviations[MOMENTUM_STATES + i]
                share = effects[CAUSES * row + i] * effects[CAUSES * other + i]
                p[STATES * row + other] += share * deviation * deviation
        for i in range(first, end):
            deviation = deviations[MOMENTUM_STATES + i]
            added = effects[CAUSES * row + i] * deviation * deviation
            p[STATES * row + MOMENTUM_STATES + i] += added
            p[STATES * (MOMENTUM_STATES + i) + row] += added


def _correct(x: list[float], p: list[float], measured: Vec3, noise: float) -> None:
    """Correct (x, P) by the measured H (N m s, eci), one axis after the other."""
    column = [0.0] * STATES
    for row in range(MOMENTUM_STATES):
        for i in range(STATES):
            column[i] = p[STATES * i + row]
        variance = p[STATES * row + row] + noise * noise
        kalman.correct(x, p, column, measured[row] - x[row], variance)
