"""Compute the torque that dumps the wheels' momentum: paper 000, eqs. 15-19.

The model is h' = W h + N + N_con (eq. 15): h (N m s) the wheels' momentum, N (N m) the
external torque that the wheels absorb, N_con (N m) the constant torque of an off-nadir
attitude (eq. 3), W = -[omega x] with omega (rad/s) the body's inertial rate; all in the
body frame. W is skew, so exp(W t) is the rotation by -omega t.

Weights are isotropic, F = f I and R = r I. Only their ratio matters: g_rate = sqrt(f /
r) (1/s) is the closed-loop rate.
"""

from __future__ import annotations

from math import cos, sin, tanh

from ..contract.block import BlockError, Mat33, Vec3
from ..maths.vector import (
    add,
    cross,
    dot,
    inverse,
    mat_vec,
    norm,
    rotation_about,
    scale,
    sub,
)

MOST_SAMPLES = 4096  # maximum number of samples in a horizon


def ilqr(h: Vec3, omega: Vec3, g_rate: float, n_con: Vec3) -> Vec3:
    """Compute the infinite-horizon LQR torque (N m, body), eq. 17.

    K_inf = sqrt(f r) I; g_inf solves (W - S K)' g = K N_con, S = 1/r (eq. 11 at rest;
    notes, item 5).
    """
    return sub(ilqr_offset(omega, g_rate, n_con), scale(g_rate, h))


def ilqr_offset(omega: Vec3, g_rate: float, n_con: Vec3) -> Vec3:
    """Compute R^-1 g_inf (N m), the constant part of the infinite-horizon torque."""
    if n_con == (0.0, 0.0, 0.0):
        return n_con
    x, y, z = omega
    # (W - g_rate I)' = [omega x] - g_rate I
    m: Mat33 = (-g_rate, -z, y, z, -g_rate, -x, -y, x, -g_rate)
    return mat_vec(inverse(m), scale(g_rate, n_con))


def lqr(h: Vec3, g_rate: float, time_to_go: float, offset: Vec3) -> Vec3:
    """Compute the finite-horizon LQR torque (N m, body), eq. 17.

    `time_to_go` (s) remains, and offset = R^-1 g (N m). For isotropic weights K =
    sqrt(f r) tanh(g_rate (t_f - t)) I: K' = K K / r - F, K(t_f) = 0.
    """
    return sub(offset, scale(g_rate * tanh(g_rate * time_to_go), h))


def lqr_offsets(
    omega: Vec3, g_rate: float, n_con: Vec3, horizon: float, sample_time: float
) -> tuple[float, ...]:
    """Integrate R^-1 g (N m) backwards over the horizon (s).

    The result is flat, three numbers for each sample time (s) from 0 to the horizon. g' =
    -(W - S K)' g + K N_con from g(t_f) = 0 (eq. 11), by RK4 with 0.5 s or less.

    Raises
    ------
    BlockError
        If the horizon has more than MOST_SAMPLES samples.
    """
    samples = int(horizon / sample_time + 0.5)
    substeps = max(1, int(2.0 * sample_time))
    step = sample_time / substeps

    def slope(g: Vec3, to_go: float) -> Vec3:
        """Return the time derivative of R^-1 g (N m/s) at a time to go (s)."""
        k = g_rate * tanh(g_rate * max(to_go, 0.0))
        # -(W - S K)' g = -[omega x] g + k g
        return add(sub(scale(k, g), cross(omega, g)), scale(k, n_con))

    if samples > MOST_SAMPLES:
        raise BlockError(
            f"horizon = {horizon} s is more than {MOST_SAMPLES} times sample_time = {sample_time} s"
        )
    g = (0.0, 0.0, 0.0)
    table = [0.0] * (3 * (MOST_SAMPLES + 1))
    for n in range(samples * substeps):
        s = n * step  # time to go
        k1 = slope(g, s)
        k2 = slope(sub(g, scale(step / 2, k1)), s + step / 2)
        k3 = slope(sub(g, scale(step / 2, k2)), s + step / 2)
        k4 = slope(sub(g, scale(step, k3)), s + step)
        g = sub(g, scale(step / 6, add(add(k1, k4), scale(2.0, add(k2, k3)))))
        if (n + 1) % substeps == 0:
            first = 3 * (samples - (n + 1) // substeps)
            table[first], table[first + 1], table[first + 2] = g
    return tuple(table[: 3 * (samples + 1)])


def mec_costate(h: Vec3, omega: Vec3, n_con: Vec3, horizon: float) -> Vec3:
    """Compute p(t_0) (N m) of eq. 19 so that h(t_0 + horizon) = 0.

    It gives the minimum-energy torque. With exp(W t) a rotation, exp(-W t_f) h(t_f) =
    h_0 + int_0^t_f exp(-W s) N_con ds - t_f p.
    """
    total = add(h, _integral_of_rotation(omega, n_con, horizon))
    return scale(1.0 / horizon, total)


def mec(p: Vec3, omega: Vec3, elapsed_time: float) -> Vec3:
    """Compute the minimum-energy torque N = -exp(W t) p(t_0) (N m), eq. 19.

    t = elapsed_time (s) since t_0.
    """
    return scale(-1.0, mat_vec(rotation_about(scale(-1.0, omega), elapsed_time), p))


def _integral_of_rotation(omega: Vec3, v: Vec3, t: float) -> Vec3:
    """Integrate exp([omega x] s) v over s from 0 to t.

    v along omega grows with t, v across it turns.
    """
    w = norm(omega)
    if w == 0.0:
        return scale(t, v)
    axis = scale(1.0 / w, omega)
    along = scale(dot(axis, v), axis)
    across = add(
        scale(sin(w * t) / w, sub(v, along)),
        scale((1.0 - cos(w * t)) / w, cross(axis, v)),
    )
    return add(scale(t, along), across)
