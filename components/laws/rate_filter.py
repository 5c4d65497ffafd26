"""The body's rate from magnetometer and tachometers alone: an extended Kalman filter.

The model is that of `rate_observer`: rate omega (rad/s) and field b (T), body,

    J_r omega' = m x b + tau - omega x (J_r omega + w),      b' = -omega x b,

with the field measured. The part of omega along the field does not move it; it is known by how
it couples the axes, which a fixed gain does not use and the covariance does. From sample to sample

    P = [[P_w, C], [C', P_b]],   F = [[F_w, 0], [[b x] T, 1 - [omega x] T]],
    F_w = 1 + A T + (A T)^2 / 2,   A = J_r^-1 ([(J_r omega + w) x] - [omega x] J_r).

Source: Psiaki, Martel & Pal, Three-axis attitude determination via Kalman filtering of
magnetometer data, J. Guidance, Control, and Dynamics 13 (1990) 506, without the attitude.
"""

from __future__ import annotations

from ..contract.block import Mat33, Vec3
from ..maths.vector import IDENTITY, add, inverse, mat_vec, sub

NONE: Mat33 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def diagonal(x: float) -> Mat33:
    """x on the diagonal."""
    return (x, 0.0, 0.0, 0.0, x, 0.0, 0.0, 0.0, x)


def times(a: Mat33, b: Mat33) -> Mat33:
    """a b"""
    return (
        a[0] * b[0] + a[1] * b[3] + a[2] * b[6], a[0] * b[1] + a[1] * b[4] + a[2] * b[7],
        a[0] * b[2] + a[1] * b[5] + a[2] * b[8],
        a[3] * b[0] + a[4] * b[3] + a[5] * b[6], a[3] * b[1] + a[4] * b[4] + a[5] * b[7],
        a[3] * b[2] + a[4] * b[5] + a[5] * b[8],
        a[6] * b[0] + a[7] * b[3] + a[8] * b[6], a[6] * b[1] + a[7] * b[4] + a[8] * b[7],
        a[6] * b[2] + a[7] * b[5] + a[8] * b[8],
    )  # fmt: skip


def turned(a: Mat33) -> Mat33:
    """a'"""
    return (a[0], a[3], a[6], a[1], a[4], a[7], a[2], a[5], a[8])


def plus(a: Mat33, b: Mat33) -> Mat33:
    """a + b"""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5],
            a[6] + b[6], a[7] + b[7], a[8] + b[8])  # fmt: skip


def by(s: float, a: Mat33) -> Mat33:
    """s a"""
    return (s * a[0], s * a[1], s * a[2], s * a[3], s * a[4], s * a[5], s * a[6], s * a[7],
            s * a[8])  # fmt: skip


def crossing(a: Vec3) -> Mat33:
    """[a x]"""
    return (0.0, -a[2], a[1], a[2], 0.0, -a[0], -a[1], a[0], 0.0)


def spread(
    omega: Vec3, b: Vec3, wheel: Vec3, rates: Mat33, mixed: Mat33, fields: Mat33,
    inertia: Mat33, inverse_inertia: Mat33, rate_noise: float, field_noise: float, elapsed: float,
) -> tuple[Mat33, Mat33, Mat33]:  # fmt: skip
    """(P_w, C, P_b) after `elapsed` (s) from a state (omega, b) with wheels' momentum w (N m s).

    rate_noise, field_noise: random walk of rate (rad/s) and field (T) over a root second.
    """
    momentum = add(mat_vec(inertia, omega), wheel)
    a = times(inverse_inertia,
              plus(crossing(momentum), by(-1.0, times(crossing(omega), inertia))))  # fmt: skip
    a = by(elapsed, a)
    f = plus(plus(IDENTITY, a), by(0.5, times(a, a)))
    down = by(elapsed, crossing(b))
    across = plus(IDENTITY, by(-elapsed, crossing(omega)))
    moved = times(f, rates)
    new_mixed = plus(times(moved, turned(down)), times(times(f, mixed), turned(across)))
    half = times(times(down, mixed), turned(across))
    new_fields = plus(
        plus(times(times(down, rates), turned(down)), times(times(across, fields), turned(across))),
        plus(plus(half, turned(half)), diagonal(field_noise * field_noise * elapsed)),
    )
    new_rates = plus(times(moved, turned(f)), diagonal(rate_noise * rate_noise * elapsed))
    return new_rates, new_mixed, new_fields


def corrected(
    omega: Vec3, b: Vec3, measured: Vec3, rates: Mat33, mixed: Mat33, fields: Mat33, noise: float
) -> tuple[Vec3, Vec3, Mat33, Mat33, Mat33]:
    """(omega, b, P_w, C, P_b) with a measured field (T), of this noise (T) in each axis."""
    gain = inverse(plus(fields, diagonal(noise * noise)))
    d = sub(measured, b)
    of_rate, of_field = times(mixed, gain), times(fields, gain)
    return (
        add(omega, mat_vec(of_rate, d)), add(b, mat_vec(of_field, d)),
        plus(rates, by(-1.0, times(of_rate, turned(mixed)))),
        plus(mixed, by(-1.0, times(of_rate, fields))),
        plus(fields, by(-1.0, times(of_field, fields))),
    )  # fmt: skip
