"""Compute the attitude part of paper 002, for a craft that a boom points to nadir.

It includes laws of ours. Body axes: roll x, pitch y, yaw z (along the boom, to nadir).
u is the direction of nadir in body: the third column of A, which takes vectors from
orbital (lvlh) to body axes. A tilt (rad) is the rotation from upright, u = (-tilt_y,
tilt_x, 1) to first order; rates (rad/s) are relative to lvlh. Dipoles m (A m2) give the
torque m x b, b (T) the field in body. A torque of a wheel (N m) is that on the body.
"""

from __future__ import annotations

from math import asin, atan2, cos, sin, sqrt, tan

from ..contract.block import Mat33, Vec3
from ..maths.vector import cross, dot, norm, scale, sub

# --- paper 002: kinematics, torques, field --------------------------------------------


def euler_angles(a: Mat33) -> Vec3:
    """Compute roll phi, pitch theta, yaw psi (rad) of A = R3(psi) R1(phi) R2(theta).

    This is the 2-1-3 sequence whose rates are eq. 6; phi within +-pi/2, where it is
    singular.
    """
    return asin(min(max(-a[7], -1.0), 1.0)), atan2(a[6], a[8]), atan2(a[1], a[4])


def euler_rates(angles: Vec3, omega: Vec3) -> Vec3:
    """Compute the rates of roll, pitch and yaw (rad/s), eq. 6.

    omega: relative to the reference, body.
    """
    roll, _, yaw = angles
    across = omega[0] * sin(yaw) + omega[1] * cos(yaw)
    roll_rate = omega[0] * cos(yaw) - omega[1] * sin(yaw)
    return roll_rate, across / cos(roll), omega[2] + across * tan(roll)


def gravity_torque(a: Mat33, moments: Vec3, products: Vec3, rate: float) -> Vec3:
    """Compute the gravity-gradient torque (N m, body) by eqs. 7-9 as written.

    Moments I_xx, I_yy, I_zz and products I_xy, I_yz, I_zx (kg m2) in the positive form,
    whose tensor has -I_xy; rate: the orbit's (rad/s). The result equals 3 rate^2 u x J
    u.
    """
    ixx, iyy, izz = moments
    ixy, iyz, izx = products
    a13, a23, a33 = a[2], a[5], a[8]
    g = 3.0 * rate * rate
    return (
        g
        * (
            (izz - iyy) * a23 * a33
            + ixy * a13 * a33
            + iyz * a33 * a33
            - izx * a13 * a23
            - iyz * a23 * a23
        ),
        g
        * (
            (ixx - izz) * a13 * a33
            - ixy * a23 * a33
            - izx * a33 * a33
            + izx * a13 * a13
            + iyz * a13 * a23
        ),
        g
        * (
            (iyy - ixx) * a13 * a23
            + ixy * a23 * a23
            + izx * a23 * a33
            - ixy * a13 * a13
            - iyz * a13 * a33
        ),
    )


def gravity_vector_torque(u: Vec3, inertia: Mat33, rate: float) -> Vec3:
    """Compute the gravity-gradient torque 3 rate^2 u x J u (N m, body).

    Eqs. 7-9 write it out; J (kg m2) is the tensor.
    """
    x, y, z = u
    j = inertia
    ju = (
        j[0] * x + j[1] * y + j[2] * z,
        j[3] * x + j[4] * y + j[5] * z,
        j[6] * x + j[7] * y + j[8] * z,
    )
    return scale(3.0 * rate * rate, cross(u, ju))


def aerodynamic_torque(
    density: float, speed: float, area: float, centre: Vec3, flow: Vec3
) -> Vec3:
    """Compute rho V^2 A_p (c_p x V) (N m), eq. 10.

    Density kg/m3, speed m/s, projected area m2, centre of pressure m from the centre of
    mass, unit velocity. The force is along -V: as printed, the torque has the opposite
    sign of that of the air.
    """
    return scale(density * speed * speed * area, cross(centre, flow))


def dipole_field(strength: Vec3, r: Vec3) -> Vec3:
    """Compute the dipole field M_e / R^3 [1 - 3 R R'] (T), eq. 12.

    The strength M_e (T m3) points north; r (m) is the position.
    """
    size = norm(r)
    radial = scale(1.0 / size, r)
    return scale(
        1.0 / size**3, sub(strength, scale(3.0 * dot(strength, radial), radial))
    )


def coil_matrix(b: Vec3) -> Mat33:
    """Return Psi of eq. 14: the torque of a dipole M is Psi M = M x B (eq. 13)."""
    x, y, z = b
    return (0.0, z, -y, -z, 0.0, x, y, -x, 0.0)


def cross_product(e: Vec3, b: Vec3) -> Vec3:
    """Compute M = e x B / |B| (A m2), eq. 16 with e = k_m h.

    The torque is -|B| e across B. Zero without a field.
    """
    size = norm(b)
    return scale(1.0 / size, cross(e, b)) if size > 0.0 else (0.0, 0.0, 0.0)


# --- paper 002: the attitude part, which it does not give -----------------------------


def tilt(u: Vec3) -> Vec3:
    """Compute (tilt_x, tilt_y, 0) (1), the sine of the angle from upright, in body."""
    return (u[1], -u[0], 0.0)


def is_inverted(u: Vec3) -> bool:
    """Return whether the body z axis points away from nadir: the boom is inverted."""
    return u[2] < 0.0


def pd(angle: float, rate: float, kp: float, kd: float) -> float:
    """Compute the torque -Kp angle - Kd rate (N m)."""
    return -kp * angle - kd * rate


# --- ours -----------------------------------------------------------------------------


def rotation_vector(q: tuple[float, float, float, float]) -> Vec3:
    """Convert a quaternion, scalar last, to the rotation vector (rad, at most pi)."""
    x, y, z, w = q
    if w < 0.0:
        x, y, z, w = -x, -y, -z, -w
    half_sine = sqrt(x * x + y * y + z * z)
    if half_sine < 1e-12:
        return (2.0 * x, 2.0 * y, 2.0 * z)
    factor = 2.0 * atan2(half_sine, w) / half_sine
    return (factor * x, factor * y, factor * z)
