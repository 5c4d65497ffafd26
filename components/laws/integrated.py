"""Compute integrated magnetic management of wheel momentum.

Source: paper 004, sections 2.2, 2.3 and 4. The attitude controller's torque is split
between wheels and coils, and the wheels are commanded to give momentum away besides.
The coils never see that torque: the wheels' part in the control torque that follows
cancels all of it except the fraction k, so the momentum that leaves the craft is k
t_DES (eqs. 9, 13, 17 and 19 together).

Torques N m, momenta N m s, field T, rates rad/s. Body frame, or along the wheels' axes.
"""

from __future__ import annotations

from ..contract.block import Flags4, Mat34, Vec3, Vec4
from ..maths.vector import ZERO, cross, dot, norm, scale

NO_NULL_SPACE: Vec4 = (0.0, 0.0, 0.0, 0.0)


def hysteresis(on: bool, x: float, low: float, high: float) -> bool:
    """Switch on from x = high and off below x = low; hold in between (low <= high)."""
    return x >= high or (on and x >= low)


def unloading(
    on: Flags4, h: Vec4, low: float, high: float, paper_signed: bool = False
) -> Flags4:
    """Select the wheels whose momentum is to be dumped: eq. 23 on |h_i|.

    It has a hysteresis from low to high (N m s). `paper_signed` takes h_i as eq. 23 is
    printed, which never unloads a wheel that turns backwards.
    """
    a, b, c, d = h if paper_signed else map(abs, h)
    return (
        hysteresis(on[0], a, low, high),
        hysteresis(on[1], b, low, high),
        hysteresis(on[2], c, low, high),
        hysteresis(on[3], d, low, high),
    )


def desaturation(h_B: Vec3, b_B: Vec3, gain: float, limit: float) -> Vec3:
    """Compute the rate of the wheels' momentum for unloading (N m, body), eq. 19.

    t_DES = -gain (h - (h.b) b), b = B / |B|. It lies across the field, so that coils
    can balance it, and does not exceed `limit`; gain in 1/s. Zero without a field.
    """
    size2 = dot(b_B, b_B)
    if size2 == 0.0:
        return ZERO
    t = scale(-gain / size2, cross(cross(b_B, h_B), b_B))
    size = norm(t)
    return scale(limit / size, t) if size > limit else t


def dipole(t_B: Vec3, b_B: Vec3, m_limit: float) -> Vec3:
    """Compute M = B x t / |B|^2 (A m2), which gives the part of t across B (eq. 18).

    Where a component exceeds m_limit, the whole dipole is scaled down, so that the
    torque keeps its direction. Zero without a field.
    """
    size2 = dot(b_B, b_B)
    if size2 == 0.0:
        return ZERO
    m = scale(1.0 / size2, cross(b_B, t_B))
    largest = max(abs(m[0]), abs(m[1]), abs(m[2]))
    return scale(m_limit / largest, m) if largest > m_limit else m


def velocity_torque(omega_B: Vec3, gain: float) -> Vec3:
    """Compute the damping torque t_DMP = -gain omega (eq. 24), gain in N m s."""
    return scale(-gain, omega_B)


def null_vector(axes: Mat34) -> Vec4:
    """Compute n with A n = 0: (1, -1, 1, -1) for a pyramid.

    Its largest element is +-1, the first of those +1. The components are the minors of
    A. Zero where the existing wheels have no null space: fewer than four, or axes in
    one plane.
    """
    p, q, r, s = ((axes[i], axes[4 + i], axes[8 + i]) for i in range(4))
    minors = (
        dot(q, cross(r, s)),
        -dot(p, cross(r, s)),
        dot(p, cross(q, s)),
        -dot(p, cross(q, r)),
    )
    largest = max(minors, key=abs)
    if abs(largest) < 1e-9 or ZERO in (p, q, r, s):
        return NO_NULL_SPACE
    # of elements of equal size the first becomes +1, independent of rounding
    first = next(x for x in minors if abs(x) > (1.0 - 1e-9) * abs(largest))
    a, b, c, d = (x / first for x in minors)
    return (a, b, c, d)


def null_torque(h: Vec4, n: Vec4, gain: float, limit: float) -> Vec4:
    """Compute -gain (h.n / n.n) n (N m), which drains the null-space momentum.

    n is the null vector, so the torque does not move the body. gain in 1/s; no wheel
    gets more than `limit`.
    """
    size2 = n[0] * n[0] + n[1] * n[1] + n[2] * n[2] + n[3] * n[3]
    if size2 == 0.0:
        return NO_NULL_SPACE
    along = h[0] * n[0] + h[1] * n[1] + h[2] * n[2] + h[3] * n[3]
    t = min(max(-gain * along / size2, -limit), limit)
    return (t * n[0], t * n[1], t * n[2], t * n[3])
