"""Compute the motion of a rigid body with wheels over a step under known loads.

The loads are polynomials in the fraction e of the step, from 0 to 1: a mean with its
slope, or a value with its first and second derivative.
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt

from ..contract.block import Mat33, Vec3
from ..maths.runge_kutta import Slope, State
from .orbit import MU

Quadratic = tuple[Vec3, Vec3, Vec3]  # a, b, c of a + e (b + e c)

Ramp = tuple[Vec3, Vec3]  # a, b of a + e b

# f(e, C) in N m, body, with C the rotation matrix from eci to body
Torque = Callable[[float, Mat33], Vec3]


STILL: Ramp = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
_NONE: Quadratic = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def ramp(mean: Vec3, slope: Vec3) -> Ramp:
    """Convert mean and slope to a ramp: mean + slope (e - 1/2)."""
    return (
        mean[0] - 0.5 * slope[0],
        mean[1] - 0.5 * slope[1],
        mean[2] - 0.5 * slope[2],
    ), slope


def peak(x: Ramp) -> float:
    """Compute an upper bound of the magnitude of a ramp within the step.

    It is the magnitude of the mean and half that of the slope.
    """
    (ax, ay, az), (bx, by, bz) = x
    bx, by, bz = 0.5 * bx, 0.5 * by, 0.5 * bz
    ax, ay, az = ax + bx, ay + by, az + bz
    return sqrt(ax * ax + ay * ay + az * az) + sqrt(bx * bx + by * by + bz * bz)


def integrate_ramp(start: Vec3, x: Ramp, dt: float) -> Quadratic:
    """Integrate a ramp over the step dt (s), beginning at `start`."""
    (ax, ay, az), (bx, by, bz) = x
    half = 0.5 * dt
    return start, (dt * ax, dt * ay, dt * az), (half * bx, half * by, half * bz)


def course(value: Vec3, first: Vec3, second: Vec3, dt: float) -> Quadratic:
    """Build the quadratic value + first e dt + second (e dt)^2 / 2.

    `first` and `second` are time derivatives of the value; dt in s.
    """
    s = 0.5 * dt * dt
    return (
        value,
        (dt * first[0], dt * first[1], dt * first[2]),
        (s * second[0], s * second[1], s * second[2]),
    )


def slopes(
    inertia: Mat33,
    half_inverse: Mat33,
    wheels: Quadratic,
    torque: Ramp,
    dipole: Ramp,
    field: Quadratic | None,
    place: Quadratic | None,
    others: Torque | None,
    mu: float = MU,
) -> Slope:
    """Build f(e, y), the derivative per second of y = (q, H).

    H is the total momentum (N m s, eci).

        q' = 1/2 Omega(omega) q                         omega = J_r^-1 (C H - h)
        H' = C' (tau + m x C B + 3 mu / r^5 p x J p + others)         p = C r

    In body: inertia J (kg m2), half_inverse J_r^-1 / 2, wheels h (N m s), torque tau (N
    m) and dipole m (A m2). In eci: field B (T) and place r (m), each None where it does
    not act. mu (m3/s2) is by default the Earth's. Vectors have x, y, z in body and u,
    v, w in eci. The expressions are written out one after another because a simulation
    spends most of its time here.
    """
    j11, j12, j13, j21, j22, j23, j31, j32, j33 = inertia
    i11, i12, i13, i21, i22, i23, i31, i32, i33 = half_inverse
    (w0x, w0y, w0z), (w1x, w1y, w1z), (w2x, w2y, w2z) = wheels
    (t0x, t0y, t0z), (t1x, t1y, t1z) = torque
    (m0x, m0y, m0z), (m1x, m1y, m1z) = dipole
    (b0x, b0y, b0z), (b1x, b1y, b1z), (b2x, b2y, b2z) = field or _NONE
    (r0x, r0y, r0z), (r1x, r1y, r1z), (r2x, r2y, r2z) = place or _NONE
    mu3 = 3.0 * mu
    magnetic, gravity = field is not None, place is not None
    free = not (magnetic or gravity or others or torque != STILL)

    def slope(e: float, state: State) -> State:
        """Compute the derivative of attitude (1/s) and total momentum (N m, eci)."""
        q1, q2, q3, q4, hx, hy, hz = state
        # the matrix C(q)
        a, b, c, d = q1 * q1, q2 * q2, q3 * q3, q4 * q4
        c11, c12, c13 = (
            a - b - c + d,
            2.0 * (q1 * q2 + q3 * q4),
            2.0 * (q1 * q3 - q2 * q4),
        )
        c21, c22, c23 = (
            2.0 * (q1 * q2 - q3 * q4),
            d - a + b - c,
            2.0 * (q2 * q3 + q1 * q4),
        )
        c31, c32, c33 = (
            2.0 * (q1 * q3 + q2 * q4),
            2.0 * (q2 * q3 - q1 * q4),
            d - a - b + c,
        )
        # momentum of the body without the wheels, and half its rate
        x = c11 * hx + c12 * hy + c13 * hz - (w0x + e * (w1x + e * w2x))
        y = c21 * hx + c22 * hy + c23 * hz - (w0y + e * (w1y + e * w2y))
        z = c31 * hx + c32 * hy + c33 * hz - (w0z + e * (w1z + e * w2z))
        ox = i11 * x + i12 * y + i13 * z
        oy = i21 * x + i22 * y + i23 * z
        oz = i31 * x + i32 * y + i33 * z
        d1 = oz * q2 - oy * q3 + ox * q4
        d2 = ox * q3 - oz * q1 + oy * q4
        d3 = oy * q1 - ox * q2 + oz * q4
        d4 = -ox * q1 - oy * q2 - oz * q3
        if free:
            return (d1, d2, d3, d4, 0.0, 0.0, 0.0)
        tx, ty, tz = t0x + e * t1x, t0y + e * t1y, t0z + e * t1z
        if magnetic:
            u = b0x + e * (b1x + e * b2x)
            v = b0y + e * (b1y + e * b2y)
            w = b0z + e * (b1z + e * b2z)
            x = c11 * u + c12 * v + c13 * w
            y = c21 * u + c22 * v + c23 * w
            z = c31 * u + c32 * v + c33 * w
            u, v, w = m0x + e * m1x, m0y + e * m1y, m0z + e * m1z
            tx, ty, tz = tx + v * z - w * y, ty + w * x - u * z, tz + u * y - v * x
        if gravity:
            u = r0x + e * (r1x + e * r2x)
            v = r0y + e * (r1y + e * r2y)
            w = r0z + e * (r1z + e * r2z)
            x = c11 * u + c12 * v + c13 * w
            y = c21 * u + c22 * v + c23 * w
            z = c31 * u + c32 * v + c33 * w
            rr = x * x + y * y + z * z
            g = mu3 / (rr * rr * sqrt(rr))
            u = j11 * x + j12 * y + j13 * z
            v = j21 * x + j22 * y + j23 * z
            w = j31 * x + j32 * y + j33 * z
            tx, ty, tz = (
                tx + g * (y * w - z * v),
                ty + g * (z * u - x * w),
                tz + g * (x * v - y * u),
            )
        if others is not None:
            x, y, z = others(e, (c11, c12, c13, c21, c22, c23, c31, c32, c33))
            tx, ty, tz = tx + x, ty + y, tz + z
        return (
            d1,
            d2,
            d3,
            d4,
            c11 * tx + c21 * ty + c31 * tz,
            c12 * tx + c22 * ty + c32 * tz,
            c13 * tx + c23 * ty + c33 * tz,
        )

    return slope
