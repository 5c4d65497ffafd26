"""Estimate disturbance torques and the effectiveness of actuators in flight.

The momentum H (N m s, eci) of the whole craft, measured at each sample, obeys

    H' = s T_GG + T_eci + C_o' (T_o + T_c cos u + T_s sin u) + (C' d) x B
         + sum_j e_j C' (m_j a_j x B) + sum_i f_i C' t_i

with T_GG the gravity gradient in the law's model, T_eci (eci), T_o, T_c and T_s (lvlh)
constant, u the argument of latitude, d the craft's own dipole (A m2, body), e and f the
signed effectiveness of coils and thrusters, m and t their commands (A m2, N m). A
Kalman filter estimates (H, s, T_eci, T_o, d, e, f, T_c, T_s); its parameters perform a
random walk. H is measured with the sensors' noise, and its process noise stands for
torques that are not modelled. Where a measurement differs by more than `DOUBT` standard
deviations, a component has failed, and the effectiveness becomes as uncertain as at
first.

Fault detection by a momentum balance: Willsky, Automatica 12 (1976) 601.
"""

from __future__ import annotations

from ..contract.block import Table, Vec3

STATES = 26
GRAVITY, INERTIAL, ORBITAL, DIPOLE, COILS, THRUSTERS, WAVES = 3, 4, 7, 10, 13, 17, 20
CAUSES = STATES - 3
DOUBT = 6.0
# No actuator gives more than this multiple of its command, or of the opposite. Where a
# coil is hardly driven, the filter cannot distinguish its effectiveness from the
# craft's own dipole.
MOST = 1.1
# Prior standard deviations of s and of e and f (1).
SPREAD_GRAVITY, SPREAD_ACTUATOR = 0.3, 0.5


def first_state(h: Vec3) -> Table:
    """Return the initial state, with H (N m s) as measured."""
    return (
        h[0],
        h[1],
        h[2],
        1.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        1.0,
        1.0,
        1.0,
        1.0,
        1.0,
        1.0,
        1.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
    )


def spreads(torque: float, dipole: float, noise: float) -> Table:
    """Return the standard deviations of `first_state`.

    noise (N m s) is that of H, torque (N m) that of the constant torques, dipole (A m2)
    that of the craft's dipole.
    """
    return (
        noise,
        noise,
        noise,
        SPREAD_GRAVITY,
        torque,
        torque,
        torque,
        torque,
        torque,
        torque,
        dipole,
        dipole,
        dipole,
        SPREAD_ACTUATOR,
        SPREAD_ACTUATOR,
        SPREAD_ACTUATOR,
        SPREAD_ACTUATOR,
        SPREAD_ACTUATOR,
        SPREAD_ACTUATOR,
        SPREAD_ACTUATOR,
        torque,
        torque,
        torque,
        torque,
        torque,
        torque,
    )


def first_covariance(deviations: Table) -> Table:
    """Build the initial covariance P, row-major."""
    p = [0.0] * (STATES * STATES)
    for i in range(STATES):
        p[STATES * i + i] = deviations[i] * deviations[i]
    return tuple(p)


def forgotten(p: Table, noise: float) -> Table:
    """Return P for H measured anew with `noise` (N m s), its past unknown."""
    cov = [0.0] * (STATES * STATES)
    for i in range(3, STATES):
        for j in range(3, STATES):
            cov[STATES * i + j] = p[STATES * i + j]
    for i in range(3):
        cov[STATES * i + i] = noise * noise
    return tuple(cov)


def causes(columns: tuple[Vec3, ...]) -> Table:
    """Arrange the effect of a unit of each parameter on H (N m s) as three rows.

    `columns` holds CAUSES vectors.
    """
    return tuple(columns[i][row] for row in range(3) for i in range(CAUSES))


def learnt(
    x: Table,
    p: Table,
    measured: Vec3,
    rows: Table,
    noise: float,
    walk: float,
    deviations: Table,
    drift: float,
) -> tuple[Table, Table]:
    """Update (x, P) by a sample at whose end H is `measured` (N m s, eci).

    rows: effect of a unit of each parameter on H over the sample, as of `causes`; noise
    (N m s) of a measurement; walk (N m s), by which H may change otherwise; drift (1),
    the random walk of a parameter relative to its prior standard deviation.
    """
    now = [0.0] * STATES
    cov = [0.0] * (STATES * STATES)
    half = [0.0] * (3 * STATES)
    gain = [0.0] * STATES
    for i in range(STATES):
        now[i] = x[i]
    for i in range(STATES * STATES):
        cov[i] = p[i]
    for i in range(3, STATES):
        step = drift * deviations[i]
        cov[STATES * i + i] += step * step
    for row in range(3):
        for j in range(STATES):
            total = 0.0
            for i in range(CAUSES):
                total += rows[CAUSES * row + i] * cov[STATES * (3 + i) + j]
            half[STATES * row + j] = total
        for i in range(CAUSES):
            now[row] += rows[CAUSES * row + i] * x[3 + i]
    for row in range(3):
        for other in range(3):
            total = half[STATES * row + other] + half[STATES * other + row]
            for i in range(CAUSES):
                total += half[STATES * row + 3 + i] * rows[CAUSES * other + i]
            cov[STATES * row + other] += total
        cov[STATES * row + row] += walk * walk
    for row in range(3):
        for j in range(3, STATES):
            cov[STATES * row + j] += half[STATES * row + j]
            cov[STATES * j + row] = cov[STATES * row + j]
    doubted = False
    for row in range(3):
        size = cov[STATES * row + row] + noise * noise
        miss = measured[row] - now[row]
        if miss * miss > DOUBT * DOUBT * size:
            doubted = True
    if doubted:
        for i in range(COILS, WAVES):
            cov[STATES * i + i] += deviations[i] * deviations[i]
        # the effect of this on H over the sample
        for row in range(3):
            for other in range(3):
                for i in range(COILS - 3, WAVES - 3):
                    share = rows[CAUSES * row + i] * rows[CAUSES * other + i]
                    cov[STATES * row + other] += (
                        share * deviations[3 + i] * deviations[3 + i]
                    )
            for i in range(COILS - 3, WAVES - 3):
                added = rows[CAUSES * row + i] * deviations[3 + i] * deviations[3 + i]
                cov[STATES * row + 3 + i] += added
                cov[STATES * (3 + i) + row] += added
    for row in range(3):
        size = cov[STATES * row + row] + noise * noise
        miss = (measured[row] - now[row]) / size
        for i in range(STATES):
            gain[i] = cov[STATES * i + row]
        for i in range(STATES):
            now[i] += gain[i] * miss
            for j in range(STATES):
                cov[STATES * i + j] -= gain[i] * gain[j] / size
    for i in range(COILS, WAVES):
        now[i] = min(max(now[i], -MOST), MOST)
    return tuple(now), tuple(cov)
