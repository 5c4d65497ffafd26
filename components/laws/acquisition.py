"""Compute detumbling and wheel start-up laws of a craft with a pitch-bias wheel.

The laws are those of paper 003 and laws of ours. Body axes: roll x, pitch y, yaw z. The
wheel's axis is along the pitch axis. Its momentum h (N m s) counts along -y, where the
orbit normal is when the craft points to nadir, and so it is positive in eq. 11. A
dipole m (A m2) gives the torque m x b, with b (T) the field and b' (T/s) its rate in
body. A torque of the wheel (N m) is that on the body about +y.
"""

from __future__ import annotations

from math import atan2, cos, sin

from ..contract.block import Mat33, Vec3
from ..maths.vector import ZERO, add, cross, dot, mat_vec, norm, scale, sub, unit
from ..physics.geomagnetic import dipole

# Direction along which the wheel's momentum counts, body; that of the orbit normal,
# lvlh.
PITCH_BIAS: Vec3 = (0.0, -1.0, 0.0)


def sign(x: float) -> float:
    """Return sgn x as in eq. 7: +1 for 0."""
    return 1.0 if x >= 0.0 else -1.0


def within(x: float, limit: float) -> float:
    """Limit x to +-limit."""
    return min(max(x, -limit), limit)


# --- paper 003: detumbling ------------------------------------------------------------


def b_dot(b_rate: Vec3, gain: float) -> Vec3:
    """Compute the B-dot dipole m = -K b' (A m2), eq. 1; K in A m2 s/T."""
    return scale(-gain, b_rate)


def pitch_coil(b_rate: Vec3, gain: float) -> Vec3:
    """Compute m = (0, -K b_y', 0) (A m2), eq. 8, which damps roll and yaw."""
    return (0.0, -gain * b_rate[1], 0.0)


def wheel_rate(omega_y: float, gain: float) -> float:
    """Compute the wheel torque -K_w omega_y (N m), eq. 3.

    It needs a gyro; K_w in N m s.
    """
    return -gain * omega_y


def _across_pitch(b: Vec3, b_rate: Vec3) -> float:
    """Compute b_3 b_1' - b_1 b_3' (T2/s).

    It is -|b|^2 omega_y for a body that turns across the field.
    """
    return b[2] * b_rate[0] - b[0] * b_rate[2]


def wheel_proportional(b: Vec3, b_rate: Vec3, gain: float) -> float:
    """Compute the wheel torque K_w (b_3 b_1' - b_1 b_3') (N m), eq. 6.

    K_w in N m s/T2.
    """
    return gain * _across_pitch(b, b_rate)


def wheel_constant(b: Vec3, b_rate: Vec3, torque: float) -> float:
    """Compute the wheel torque K_w sgn(b_3 b_1' - b_1 b_3') (N m), eq. 7.

    K_w is `torque`, in N m.
    """
    return torque * sign(_across_pitch(b, b_rate))


# --- paper 003: start-up --------------------------------------------------------------


def pitch_spin(b: Vec3, omega_y: float, target: float, gain: float) -> Vec3:
    """Compute m = (K_s (omega_y - target) sgn(b_3), 0, 0) (A m2), eq. 9.

    K_s in A m2 s, target in rad/s. Its pitch torque is -K_s (omega_y - target) |b_3|.
    It turns roll and yaw as well, and alone it never reaches the target: `pitch_coil`
    is to be added.
    """
    return (gain * (omega_y - target) * sign(b[2]), 0.0, 0.0)


def momentum_dump(b: Vec3, h: float, target: float, gain: float) -> Vec3:
    """Compute m = K_ws (h - target) (-b_3, 0, b_1) (A m2), eq. 11.

    K_ws in 1/(T2 s); h and target in N m s along -y. Its pitch torque is K_ws (h -
    target) (b_1^2 + b_3^2). The wheel, which holds the pitch angle, reacts to it and so
    reaches the target.
    """
    excess = gain * (h - target)
    return (-excess * b[2], 0.0, excess * b[0])


def pitch_angle(nadir: Vec3) -> float:
    """Compute the pitch angle (rad, -pi to pi) from the direction of nadir in body.

    It is the rotation about y that would bring nadir into the y-z plane with z > 0.
    """
    return atan2(-nadir[0], nadir[2])


def pitch_pd(angle: float, rate: float, kp: float, kd: float) -> float:
    """Compute the wheel torque -K_p theta - K_d theta' (N m), eq. 10; theta in rad."""
    return -kp * angle - kd * rate


# --- laws of ours ---------------------------------------------------------------------


def all_coils(omega: Vec3, b: Vec3, gain: float) -> Vec3:
    """Compute m = K omega x b (A m2), with K in A m2 s/T.

    The coils are then limited each on its own. The power of the torque is (m x b).omega =
    -m.(omega x b), so a large K, where every coil is at its limit with the sign of (omega x
    b)_i, removes kinetic energy as fast as the coils can. (Avanzini & Giulietti 2012 scale
    K with inertia and orbit rate instead, for an even decay.)
    """
    return scale(gain, cross(omega, b))


def even_decay_gain(inertia: float, orbit_rate: float, inclination: float) -> float:
    """Compute K_w = 2 n (1 + sin xi) J_min (N m s) of m = K_w (omega x b) / |b|^2.

    Avanzini & Giulietti, Magnetic detumbling of a rigid spacecraft, J. Guidance,
    Control, and Dynamics 35 (2012) 1326. inertia J_min (kg m2): the smallest principal
    one; orbit_rate n (rad/s); inclination xi (rad): that of the orbit to the
    geomagnetic equator.
    """
    return 2.0 * orbit_rate * (1.0 + sin(inclination)) * inertia


def look_ahead(momentum: Vec3, b: Vec3, later: Vec3, alpha: float) -> Vec3:
    """Compute the first u (N m s) of two torques u x b, then v x b_later.

    b and b_later are unit vectors; u and v minimise

        |h + u x b|^2 + alpha |h + u x b + v x b_later|^2 + |u|^2 + |v|^2

    h (N m s) is the momentum to be removed; alpha is the weight of the momentum that
    remains after the second torque. The component along b now is left for later where
    the field will have turned, and no step leads to h along b_later, from where the
    coils could not remove it. v is eliminated; u across b follows from two lines
    (Sherman and Morrison).

    After Willis, Fisch, Seletskiy & Manchester, Building a better B-dot: fast
    detumbling with non-monotonic Lyapunov functions, IEEE Aerospace Conference (2024),
    with regulariser 1.
    """
    rest = alpha / (1.0 + alpha)
    more = alpha - rest
    across = sub(momentum, scale(dot(b, momentum), b))
    p = sub(later, scale(dot(b, later), b))
    g = add(scale(1.0 + rest, across), scale(more * dot(later, momentum), p))
    weight = 2.0 + rest
    torque = sub(g, scale(more * dot(p, g) / (weight + more * dot(p, p)), p))
    return cross(torque, scale(1.0 / weight, b))


def field_ahead(r: Vec3, v: Vec3, horizon: float) -> Vec3:
    """Predict the direction of the field (unit vector, eci) after `horizon` (s).

    The orbit is circular, and the field is that of a dipole along the Earth's axis. r
    (m) and v (m/s) in eci; the result is zero where r or v is.
    """
    size, speed = norm(r), norm(v)
    if size == 0.0 or speed == 0.0:
        return ZERO
    angle = horizon * speed / size
    ahead = add(scale(cos(angle) / size, r), scale(sin(angle) / speed, v))
    return unit(dipole(ahead, (0.0, 0.0, -1.0)))


def start_up_error(
    momentum: Vec3,
    inertia: Mat33,
    omega_orbit: Vec3,
    h: float,
    target: float,
    normal: Vec3,
    beta: float,
    gamma: float,
) -> Vec3:
    """Compute the start-up error e (N m s, body).

    e = J omega + beta J omega_o + (h - h_t) a - gamma h_t (n - a). momentum: J omega;
    omega_orbit: the rate relative to lvlh (rad/s); a: PITCH_BIAS; n (normal): the orbit
    normal. e = 0 where the craft is at rest in lvlh with its wheel at the target along
    the orbit normal, except for the orbit rate's J n. The larger gamma, the sooner the
    wheel's axis turns to the normal, and the smaller the set of attitudes from which it
    gets there.
    """
    bias = scale(h - target + gamma * target, PITCH_BIAS)
    e = add(momentum, scale(beta, mat_vec(inertia, omega_orbit)))
    return sub(add(e, bias), scale(gamma * target, normal))


def dipole_against(e: Vec3, b: Vec3, gain: float) -> Vec3:
    """Compute m = K e x b / |b|^2 (A m2): the torque is -K e across the field.

    K in 1/s; zero without a field.
    """
    size2 = dot(b, b)
    return scale(gain / size2, cross(e, b)) if size2 > 0.0 else ZERO
