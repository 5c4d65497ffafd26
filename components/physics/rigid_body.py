"""Motion of a rigid body with wheels over a step, in which all that acts on it is given.

What is given goes as a quadratic in the share e of the step, a + e (b + e c) with e from 0 to 1:
a mean with its slope, a value with its first and second derivative.
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt

from ..contract.block import Mat33, Vec3
from ..maths.runge_kutta import Slope, State
from .orbit import MU

Quadratic = tuple[Vec3, Vec3, Vec3]
"""a, b, c of a + e (b + e c)."""

Torque = Callable[[float, Mat33], Vec3]
"""f(e, C) in N m, body, with C body from eci."""


def ramp(mean: Vec3, slope: Vec3) -> Quadratic:
    """mean + slope (e - 1/2)."""
    return (
        (mean[0] - 0.5 * slope[0], mean[1] - 0.5 * slope[1], mean[2] - 0.5 * slope[2]),
        slope,
        (0.0, 0.0, 0.0),
    )


def gathered(start: Vec3, mean: Vec3, slope: Vec3, dt: float) -> Quadratic:
    """start plus the integral of `ramp` over e dt."""
    a, b, c = 0.5 * dt * slope[0], 0.5 * dt * slope[1], 0.5 * dt * slope[2]
    return start, (dt * mean[0] - a, dt * mean[1] - b, dt * mean[2] - c), (a, b, c)


def course(value: Vec3, first: Vec3, second: Vec3, dt: float) -> Quadratic:
    """A value with its time derivatives: value + first e dt + second (e dt)^2 / 2."""
    s = 0.5 * dt * dt
    return (
        value,
        (dt * first[0], dt * first[1], dt * first[2]),
        (s * second[0], s * second[1], s * second[2]),
    )


def slopes(
    inertia: Mat33,
    inverse: Mat33,
    wheels: Quadratic,
    torque: Quadratic,
    dipole: Quadratic,
    field: Quadratic | None,
    place: Quadratic | None,
    others: Torque | None,
) -> Slope:
    """f(e, y), the derivative per second of y = (q, H): attitude, total momentum (N m s, eci).

        q' = 1/2 Omega(omega) q                         omega = J_r^-1 (C H - h)
        H' = C' (tau + m x C B + 3 mu / r^5 p x J p + others)         p = C r

    inertia J (kg m2) and inverse J_r^-1 in body; wheels h (N m s), torque tau (N m) and dipole m
    (A m2) in body; field B (T) and place r (m) in eci, None where neither acts. One expression
    after another, for this is where a simulation spends its time.
    """
    j11, j12, j13, j21, j22, j23, j31, j32, j33 = inertia
    i11, i12, i13, i21, i22, i23, i31, i32, i33 = inverse
    (w0x, w0y, w0z), (w1x, w1y, w1z), (w2x, w2y, w2z) = wheels
    (t0x, t0y, t0z), (t1x, t1y, t1z), _ = torque
    (m0x, m0y, m0z), (m1x, m1y, m1z), _ = dipole
    (b0x, b0y, b0z), (b1x, b1y, b1z), (b2x, b2y, b2z) = field or NOTHING
    (r0x, r0y, r0z), (r1x, r1y, r1z), (r2x, r2y, r2z) = place or NOTHING
    magnetic, gravity = field is not None, place is not None
    free = not (magnetic or gravity or others or any(torque[0]) or any(torque[1]))

    def slope(e: float, y: State) -> State:
        q1, q2, q3, q4, hx, hy, hz = y
        # C(q)
        a, b, c, d = q1 * q1, q2 * q2, q3 * q3, q4 * q4
        c11, c12, c13 = a - b - c + d, 2.0 * (q1 * q2 + q3 * q4), 2.0 * (q1 * q3 - q2 * q4)
        c21, c22, c23 = 2.0 * (q1 * q2 - q3 * q4), d - a + b - c, 2.0 * (q2 * q3 + q1 * q4)
        c31, c32, c33 = 2.0 * (q1 * q3 + q2 * q4), 2.0 * (q2 * q3 - q1 * q4), d - a - b + c
        # momentum of the body without the wheels, and half its rate
        x = c11 * hx + c12 * hy + c13 * hz - (w0x + e * (w1x + e * w2x))
        y_ = c21 * hx + c22 * hy + c23 * hz - (w0y + e * (w1y + e * w2y))
        z = c31 * hx + c32 * hy + c33 * hz - (w0z + e * (w1z + e * w2z))
        ox = 0.5 * (i11 * x + i12 * y_ + i13 * z)
        oy = 0.5 * (i21 * x + i22 * y_ + i23 * z)
        oz = 0.5 * (i31 * x + i32 * y_ + i33 * z)
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
            y_ = c21 * u + c22 * v + c23 * w
            z = c31 * u + c32 * v + c33 * w
            u, v, w = m0x + e * m1x, m0y + e * m1y, m0z + e * m1z
            tx, ty, tz = tx + v * z - w * y_, ty + w * x - u * z, tz + u * y_ - v * x
        if gravity:
            u = r0x + e * (r1x + e * r2x)
            v = r0y + e * (r1y + e * r2y)
            w = r0z + e * (r1z + e * r2z)
            x = c11 * u + c12 * v + c13 * w
            y_ = c21 * u + c22 * v + c23 * w
            z = c31 * u + c32 * v + c33 * w
            rr = x * x + y_ * y_ + z * z
            g = 3.0 * MU / (rr * rr * sqrt(rr))
            u = j11 * x + j12 * y_ + j13 * z
            v = j21 * x + j22 * y_ + j23 * z
            w = j31 * x + j32 * y_ + j33 * z
            tx, ty, tz = tx + g * (y_ * w - z * v), ty + g * (z * u - x * w), tz + g * (x * v - y_ * u)
        if others is not None:
            x, y_, z = others(e, (c11, c12, c13, c21, c22, c23, c31, c32, c33))
            tx, ty, tz = tx + x, ty + y_, tz + z
        return (
            d1, d2, d3, d4,
            c11 * tx + c21 * ty + c31 * tz,
            c12 * tx + c22 * ty + c32 * tz,
            c13 * tx + c23 * ty + c33 * tz,
        )  # fmt: skip

    return slope


NOTHING: Quadratic = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
