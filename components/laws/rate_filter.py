"""Estimate the body's rate by an extended Kalman filter.

It uses magnetometer and tachometers alone. The model is that of `rate_observer`: rate
omega (rad/s) and field b (T), body,

    J_r omega' = m x b + tau - omega x (J_r omega + w),      b' = -omega x b,

with the field measured. The part of omega along the field does not move it; it is known
by how it couples the axes, which a fixed gain does not use and the covariance does.
From sample to sample

    P = [[P_w, C], [C', P_b]],   F = [[F_w, 0], [[b x] T, 1 - [omega x] T]],
    F_w = 1 + A T + (A T)^2 / 2,   A = J_r^-1 ([(J_r omega + w) x] - [omega x] J_r).

Source: Psiaki, Martel & Pal, Three-axis attitude determination via Kalman filtering of
magnetometer data, J. Guidance, Control, and Dynamics 13 (1990) 506, without the
attitude.
"""

from __future__ import annotations

from ..contract.block import Mat33, Vec3
from ..maths.matrix import add as plus
from ..maths.matrix import multiply, scale, subtract, transposed
from ..maths.vector import IDENTITY, add, inverse, mat_vec, sub

NONE: Mat33 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def diagonal(x: float) -> Mat33:
    """Return the matrix with x on the diagonal."""
    return (x, 0.0, 0.0, 0.0, x, 0.0, 0.0, 0.0, x)


def crossing(a: Vec3) -> Mat33:
    """Return the skew matrix [a x]."""
    return (0.0, -a[2], a[1], a[2], 0.0, -a[0], -a[1], a[0], 0.0)


def spread(
    omega: Vec3,
    b: Vec3,
    wheel: Vec3,
    rates: Mat33,
    mixed: Mat33,
    fields: Mat33,
    inertia: Mat33,
    inverse_inertia: Mat33,
    rate_noise: float,
    field_noise: float,
    elapsed: float,
) -> tuple[Mat33, Mat33, Mat33]:
    """Propagate the covariance (P_w, C, P_b) over `elapsed` (s).

    The state is (omega, b), with wheels' momentum w (N m s). rate_noise, field_noise:
    random walk of rate (rad/s) and field (T) over a root second.
    """
    momentum = add(mat_vec(inertia, omega), wheel)
    turning = crossing(omega)
    slope = subtract(crossing(momentum), multiply(turning, inertia))
    a = scale(elapsed, multiply(inverse_inertia, slope))
    f = plus(plus(IDENTITY, a), scale(0.5, multiply(a, a)))
    down = scale(elapsed, crossing(b))
    across = transposed(subtract(IDENTITY, scale(elapsed, turning)))
    moved, coupled = multiply(f, rates), multiply(down, mixed)
    of_both = multiply(coupled, across)
    return (
        plus(
            multiply(moved, transposed(f)), diagonal(rate_noise * rate_noise * elapsed)
        ),
        plus(multiply(moved, transposed(down)), multiply(multiply(f, mixed), across)),
        plus(
            plus(
                multiply(multiply(down, rates), transposed(down)),
                multiply(multiply(transposed(across), fields), across),
            ),
            plus(
                plus(of_both, transposed(of_both)),
                diagonal(field_noise * field_noise * elapsed),
            ),
        ),
    )


def corrected(
    omega: Vec3,
    b: Vec3,
    measured: Vec3,
    rates: Mat33,
    mixed: Mat33,
    fields: Mat33,
    noise: float,
) -> tuple[Vec3, Vec3, Mat33, Mat33, Mat33]:
    """Correct (omega, b, P_w, C, P_b) by a measured field (T).

    noise (T) is the standard deviation in each axis.
    """
    gain = inverse(plus(fields, diagonal(noise * noise)))
    d = sub(measured, b)
    of_rate, of_field = multiply(mixed, gain), multiply(fields, gain)
    return (
        add(omega, mat_vec(of_rate, d)),
        add(b, mat_vec(of_field, d)),
        subtract(rates, multiply(of_rate, transposed(mixed))),
        subtract(mixed, multiply(of_rate, fields)),
        subtract(fields, multiply(of_field, fields)),
    )
