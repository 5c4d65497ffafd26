"""What a law learns in flight of the torques on its craft and of what its actuators
give.

The momentum H (N m s, eci) of the whole craft, measured at each sample, obeys

    H' = s T_GG + T_eci + C_o' (T_o + T_c cos u + T_s sin u) + (C' d) x B
         + sum_j e_j C' (m_j a_j x B) + sum_i f_i C' t_i

with T_GG gravity gradient as the law knows it, T_eci (eci), T_o, T_c and T_s (lvlh)
constant, u the argument of latitude, d the craft's own dipole (A m2, body), e and f the
signed effectiveness of coils and thrusters, m and t what they were commanded (A m2, N
m). (H, s, T_eci, T_o, d, e, f, T_c, T_s) is estimated by a Kalman filter whose
parameters walk at random; H is measured with the sensors' noise, and walks by what is
not modelled. Where a measurement is further off than `DOUBT` deviations allow,
something has failed: the effectiveness is as unknown as at first again.

Fault detection by a momentum balance: Willsky, Automatica 12 (1976) 601.
"""

from __future__ import annotations

from ..contract.block import Table, Vec3

STATES = 26
GRAVITY, INERTIAL, ORBITAL, DIPOLE, COILS, THRUSTERS, WAVES = 3, 4, 7, 10, 13, 17, 20
CAUSES = STATES - 3
DOUBT = 6.0
MOST = 1.1
"""No actuator gives more of what it is commanded, nor more of its opposite. Where a
coil hardly moves, its effectiveness and the craft's own dipole are one and the same to
the filter."""
SPREAD_GRAVITY, SPREAD_ACTUATOR = 0.3, 0.5
"""Standard deviations of s and of e and f beforehand (1)."""


def first_state(h: Vec3) -> Table:
    """The state before anything is learnt, with H (N m s) as measured."""
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
    """The standard deviations of `first_state`: of H noise (N m s), of the constant
    torques `torque` (N m), of the craft's dipole `dipole` (A m2)."""
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
    """P, row-major."""
    p = [0.0] * (STATES * STATES)
    for i in range(STATES):
        p[STATES * i + i] = deviations[i] * deviations[i]
    return tuple(p)


def forgotten(p: Table, noise: float) -> Table:
    """P where H is measured anew with `noise` (N m s), its past not known."""
    cov = [0.0] * (STATES * STATES)
    for i in range(3, STATES):
        for j in range(3, STATES):
            cov[STATES * i + j] = p[STATES * i + j]
    for i in range(3):
        cov[STATES * i + i] = noise * noise
    return tuple(cov)


def causes(columns: tuple[Vec3, ...]) -> Table:
    """What a unit of each parameter adds to H (N m s), CAUSES vectors, as three rows."""
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
    """(x, P) after a sample at whose end H is `measured` (N m s, eci).

    rows: what a unit of each parameter adds to H over the sample, as of `causes`; noise
    (N m s) of a measurement; walk (N m s), by which H may change otherwise; drift (1),
    by how much of its deviation beforehand a parameter may walk.
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
        # what that makes of H, over this sample
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
