"""Compute attitude guidance and control: paper 004, eqs. 7-11, and eigenaxis slews.

Quaternions as in `attitude.py`. q_BI, omega_BI_B: the body; q_RI, omega_RI_R: the
reference frame, its rate (rad/s) in the reference frame itself.
"""

from __future__ import annotations

from math import atan2, sqrt

from ..contract.block import Mat33, Vec3, Vec4
from ..maths.attitude import inverse, product, rotate
from ..maths.vector import ZERO, add, clip, mat_vec, scale, sub


def tracking_error(
    q_BI: Vec4, omega_BI_B: Vec3, q_RI: Vec4, omega_RI_R: Vec3
) -> tuple[Vec3, Vec3]:
    """Compute the attitude error e and the rate error delta omega (rad/s), body.

    e = sign(dq_4) dq_1:3 with dq = q_BI (x) q_RI^-1 (eq. 7). The sign selects the
    shorter rotation (eq. 10), with sign(0) = 1 so that half a turn is not an
    equilibrium. delta omega = omega_BI_B - C(dq) omega_RI_R. Eq. 8 subtracts without
    saying in which frame; the two agree to first order in the error.
    """
    dq = product(q_BI, inverse(q_RI))
    x, y, z, w = dq
    e = (x, y, z) if w >= 0.0 else (-x, -y, -z)
    return e, sub(omega_BI_B, rotate(dq, omega_RI_R))


def integrate_error(xi: Vec3, e: Vec3, time: float, limit: float) -> Vec3:
    """Integrate the error: xi + time e (s), each component within +-limit (s).

    limit 0: none.
    """
    xi = add(xi, scale(time, e))
    return clip(xi, limit) if limit > 0.0 else xi


def unwound(xi: Vec3, xi_after: Vec3) -> Vec3:
    """Return xi, with the components of `xi_after` that are nearer to zero."""
    return (
        xi_after[0] if abs(xi_after[0]) < abs(xi[0]) else xi[0],
        xi_after[1] if abs(xi_after[1]) < abs(xi[1]) else xi[1],
        xi_after[2] if abs(xi_after[2]) < abs(xi[2]) else xi[2],
    )


def pd_torque(e: Vec3, d_omega: Vec3, kp: float, kd: float, gain_matrix: Mat33) -> Vec3:
    """Compute the PD torque -G (kp e + kd delta omega) (N m).

    Eq. 10 without its integral, gains as in eq. 11.
    """
    return mat_vec(gain_matrix, sub(scale(-kp, e), scale(kd, d_omega)))


def pid_torque(
    e: Vec3,
    d_omega: Vec3,
    xi: Vec3,
    kp: float,
    kd: float,
    ki: float,
    gain_matrix: Mat33,
) -> Vec3:
    """Compute the PID torque -G (kp e + kd delta omega + ki xi) (N m).

    Eq. 10 with xi the integral of e (s), gains as in eq. 11.
    """
    return sub(
        pd_torque(e, d_omega, kp, kd, gain_matrix), mat_vec(gain_matrix, scale(ki, xi))
    )


def limit_torque(tau: Vec3, limit: float) -> Vec3:
    """Limit each component of tau (N m) to +-limit (N m); limit 0: none."""
    return clip(tau, limit) if limit > 0.0 else tau


def eigenaxis(q_from: Vec4, q_to: Vec4) -> tuple[Vec3, float]:
    """Compute axis and angle (rad, 0 to pi) of the shortest rotation between attitudes.

    The axis has the same components in both frames; it is zero where they are the same.
    """
    x, y, z, w = product(q_to, inverse(q_from))
    if w < 0.0:
        x, y, z, w = -x, -y, -z, -w
    s = sqrt(x * x + y * y + z * z)
    return (scale(1.0 / s, (x, y, z)), 2.0 * atan2(s, w)) if s > 0.0 else (ZERO, 0.0)


def rest_to_rest(tau: float) -> tuple[float, float]:
    """Evaluate (s, ds/dtau) of the quintic from 0 to 1 for tau in [0, 1].

    It is at rest outside. Rate and acceleration are zero at both ends; the largest rate
    is 15/8.
    """
    if tau <= 0.0:
        return 0.0, 0.0
    if tau >= 1.0:
        return 1.0, 0.0
    return tau**3 * (10.0 - tau * (15.0 - 6.0 * tau)), 30.0 * (tau * (1.0 - tau)) ** 2
