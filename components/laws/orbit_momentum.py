"""Find the momentum of wheels that an orbit gives back, and dump only the remainder.

Axes are those of a craft that follows the orbit: roll x, pitch y, yaw z to nadir, with
the rate (0, -n, 0). The field of an orbit is learnt as

    B = c0 + c1 cos u + c2 sin u,       u = n t,

by recursive least squares with exponential forgetting. A dipole m_r and a constant
torque d then give the torque t = t0 + tc cos u + ts sin u. The wheels take it:

    h_x' = t_x + n h_z,   h_y' = t_y,   h_z' = t_z - n h_x,

whose periodic solution, without the part that grows, is

    h_x = t0_z / n + (p sin u + q cos u) / (2 n),    p = (tc_x + ts_z) / 2,
    h_y = (tc_y sin u - ts_y cos u) / n,             q = (tc_z - ts_x) / 2,
    h_z = -t0_x / n - (p cos u - q sin u) / (2 n).

A craft that leans against a constant torque takes K lean of it by gravity, with K_x = 3
n^2 (J_y - J_z) and K_y = 3 n^2 (J_x - J_z). As it turns with the orbit, a lean about
roll takes a third more, K_x lean / 3, by the momentum of the body itself.

Source: ours; least squares: Ljung, System Identification (1999), sec. 11.2.
"""

from __future__ import annotations

from math import cos, exp, sin, sqrt
from typing import NamedTuple

from ..contract.block import Mat33, Table, Vec3
from ..maths import kalman
from ..maths.vector import add, cross, scale

TERMS = 3  # mean, cosine and sine
FIRST_VARIANCE = 1e3  # 1, of a coefficient, over that of a measurement


class OrbitTorque(NamedTuple):
    """Torque over an orbit: t0 + tc cos u + ts sin u (N m, axes of the orbit)."""

    mean: Vec3
    cosine: Vec3
    sine: Vec3


def first_field() -> tuple[Table, Table]:
    """Return the first coefficients (9: x, y, z of three) and their covariance (9)."""
    p = [0.0] * (TERMS * TERMS)
    for i in range(TERMS):
        p[(TERMS + 1) * i] = FIRST_VARIANCE
    return (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), tuple(p)


def learn_field(
    c: Table, p: Table, b: Vec3, u: float, retention: float
) -> tuple[Table, Table]:
    """Return coefficients and covariance after one measurement.

    Parameters
    ----------
    c, p : Table
        Coefficients (T, 9) and their covariance over that of a measurement (3 x 3), which
        is the same for each axis.
    b : Vec3
        Measured field (T, axes of the orbit).
    u : float
        Phase in the orbit (rad).
    retention : float
        Share of the information that is still used (1), below 1.
    """
    regressor = (1.0, cos(u), sin(u))
    coefficients = [0.0] * (TERMS * TERMS)
    covariance = [0.0] * (TERMS * TERMS)
    product = [0.0] * TERMS
    of_axis = [0.0] * TERMS
    for axis in range(3):
        # each axis has the same covariance, so each begins with that before
        for i in range(TERMS * TERMS):
            covariance[i] = p[i] / retention
        variance, expected_field = 1.0, 0.0
        for i in range(TERMS):
            product[i] = (
                covariance[TERMS * i] * regressor[0]
                + covariance[TERMS * i + 1] * regressor[1]
                + covariance[TERMS * i + 2] * regressor[2]
            )
            of_axis[i] = c[TERMS * axis + i]
            variance += regressor[i] * product[i]
            expected_field += regressor[i] * of_axis[i]
        kalman.correct(
            of_axis, covariance, product, b[axis] - expected_field, variance, TERMS
        )
        for i in range(TERMS):
            coefficients[TERMS * axis + i] = of_axis[i]
    return tuple(coefficients), tuple(covariance)


def retention_of(elapsed_time: float, memory: float) -> float:
    """Return the share of information (1) that an elapsed time (s) leaves."""
    return exp(-elapsed_time / memory)


def term(c: Table, i: int) -> Vec3:
    """Return coefficient c_i of the field (T, axes of the orbit)."""
    return (c[i], c[TERMS + i], c[2 * TERMS + i])


def field_size(c: Table) -> float:
    """Return the root mean square of the field over an orbit (T)."""
    total = 0.0
    for axis in range(3):
        mean, even, odd = c[3 * axis], c[3 * axis + 1], c[3 * axis + 2]
        total += mean * mean + 0.5 * (even * even + odd * odd)
    return sqrt(total)


def torque_over_orbit(c: Table, constant: Vec3, dipole: Vec3) -> OrbitTorque:
    """Return the torque of a constant one (N m) and a dipole (A m2) in the field c."""
    return OrbitTorque(
        add(constant, cross(dipole, term(c, 0))),
        cross(dipole, term(c, 1)),
        cross(dipole, term(c, 2)),
    )


def stiffness(inertia: Mat33, n: float) -> Vec3:
    """Return the torque of gravity per lean (N m/rad), K; zero about yaw.

    It is zero where the craft is not stable about an axis. n: rate of the orbit (rad/s).
    """
    gravity = 3.0 * n * n
    return (
        max(gravity * (inertia[4] - inertia[8]), 0.0),
        max(gravity * (inertia[0] - inertia[8]), 0.0),
        0.0,
    )


def compute_net_torque(mean: Vec3, k: Vec3, lean: Vec3) -> Vec3:
    """Return what a lean (rad) leaves of a mean torque (N m), body; k of `stiffness`."""
    return (
        mean[0] - 4.0 / 3.0 * k[0] * lean[0],
        mean[1] - k[1] * lean[1],
        mean[2],
    )


def periodic_momentum(
    torque: OrbitTorque, u: float, n: float, has_roll_wheel: bool
) -> Vec3:
    """Return the periodic momentum (N m s) at the phase u (rad), n in rad/s.

    Without a wheel about roll there is no momentum that turns from yaw into roll, and
    each axis has what its own periodic torque gives.
    """
    mean, even, odd = torque.mean, torque.cosine, torque.sine
    c, s = cos(u), sin(u)
    if not has_roll_wheel:
        return (
            0.0,
            (even[1] * s - odd[1] * c) / n,
            (even[2] * s - odd[2] * c) / n,
        )
    p = 0.5 * (even[0] + odd[2])
    q = 0.5 * (even[2] - odd[0])
    return (
        (mean[2] + 0.5 * (p * s + q * c)) / n,
        (even[1] * s - odd[1] * c) / n,
        (-mean[0] - 0.5 * (p * c - q * s)) / n,
    )


def periodic_size(torque: OrbitTorque, n: float, has_roll_wheel: bool) -> Vec3:
    """Return the largest size of the periodic momentum (N m s), n in rad/s."""
    mean, even, odd = torque.mean, torque.cosine, torque.sine
    y = sqrt(even[1] * even[1] + odd[1] * odd[1]) / n
    if not has_roll_wheel:
        return (0.0, y, sqrt(even[2] * even[2] + odd[2] * odd[2]) / n)
    p = 0.5 * (even[0] + odd[2])
    q = 0.5 * (even[2] - odd[0])
    turning = 0.5 * sqrt(p * p + q * q)
    return ((abs(mean[2]) + turning) / n, y, (abs(mean[0]) + turning) / n)


def dump_dipole(
    excess: Vec3, b: Vec3, threshold: float, reference: float, time: float
) -> Vec3:
    """Return the dipole (A m2, body) of coils that run only where it pays.

    A second of coil i changes the excess s in proportion to g_i, with g = B x s. It runs
    where |g_i| is above threshold times reference.

    Parameters
    ----------
    excess : Vec3
        s (N m s, body).
    b : Vec3
        Field B (T, body).
    threshold : float
        Momentum (N m s) up to which no coil runs.
    reference : float
        Size of the field (T) for that threshold.
    time : float
        Time constant (s) of the dumping.
    """
    size2 = b[0] * b[0] + b[1] * b[1] + b[2] * b[2]
    if size2 == 0.0:
        return (0.0, 0.0, 0.0)
    g = cross(b, excess)
    dead_zone = threshold * reference
    return scale(
        -1.0 / (size2 * time),
        (
            _apply_dead_zone(g[0], dead_zone),
            _apply_dead_zone(g[1], dead_zone),
            _apply_dead_zone(g[2], dead_zone),
        ),
    )


def _apply_dead_zone(x: float, dead_zone: float) -> float:
    """Return x less a dead zone of +-dead_zone."""
    return max(x - dead_zone, 0.0) + min(x + dead_zone, 0.0)
