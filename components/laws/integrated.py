"""Compute integrated magnetic management of wheel momentum.

Source: paper 004, sections 2.2, 2.3 and 4. The attitude controller's torque is split
between wheels and coils, and the wheels are commanded to give momentum away besides.
The coils never see that torque: the wheels' part in the control torque that follows
cancels all of it except the fraction k, so the momentum that leaves the craft is k
t_DES (eqs. 9, 13, 17 and 19 together).

Torques N m, momenta N m s, field T, rates rad/s. Body frame, or along the wheels' axes.
"""

from __future__ import annotations

from ..contract.block import PerWheel, Vec3, WheelColumns, WheelFlags
from ..maths.vector import ZERO, cross, dot, inner, norm, scale
from ..physics.wheel_array import null_part, pseudo_inverse

FOUR = 4  # wheels, whose null space is a line


def hysteresis(on: bool, x: float, low: float, high: float) -> bool:
    """Switch on from x = high and off below x = low; hold in between (low <= high)."""
    return x >= high or (on and x >= low)


def unloading(
    on: WheelFlags, h: PerWheel, low: float, high: float, paper_signed: bool = False
) -> WheelFlags:
    """Select the wheels whose momentum is to be dumped: eq. 23 on |h_i|.

    It has a hysteresis from low to high (N m s). `paper_signed` takes h_i as eq. 23 is
    printed, which never unloads a wheel that turns backwards.
    """
    return tuple(
        hysteresis(is_on, x if paper_signed else abs(x), low, high)
        for is_on, x in zip(on, h, strict=True)
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


def null_vector(axes: WheelColumns) -> PerWheel:
    """Compute n with A n = 0: (1, -1, 1, -1) for a pyramid.

    Its largest element is +-1, the first of those +1. Of four wheels the components are
    the minors of A; zero where the existing ones have no null space: fewer than four,
    or axes in one plane. Of another number it is what the null space has of
    (1, -1, 1, ...).
    """
    count = len(axes) // 3
    if count != FOUR:
        return _nearest_null(axes)
    p, q, r, s = ((axes[i], axes[count + i], axes[2 * count + i]) for i in range(4))
    minors = (
        dot(q, cross(r, s)),
        -dot(p, cross(r, s)),
        dot(p, cross(q, s)),
        -dot(p, cross(q, r)),
    )
    largest = max(minors, key=abs)
    if abs(largest) < 1e-9 or ZERO in (p, q, r, s):
        return (0.0,) * count
    # of elements of equal size the first becomes +1, independent of rounding
    first = next(x for x in minors if abs(x) > (1.0 - 1e-9) * abs(largest))
    return tuple(minors[i % 4] / first for i in range(count))


def _nearest_null(axes: WheelColumns) -> PerWheel:
    """Return what the null space has of (1, -1, 1, ...), its largest element +-1."""
    count = len(axes) // 3
    present = tuple(
        (axes[i], axes[count + i], axes[2 * count + i]) != ZERO for i in range(count)
    )
    alternating = tuple((1.0 - 2.0 * (i % 2)) * present[i] for i in range(count))
    n = null_part(axes, pseudo_inverse(axes), alternating)
    largest = max(abs(x) for x in n)
    if largest < 1e-9:
        return (0.0,) * count
    return tuple(x / largest for x in n)


def null_torque(h: PerWheel, n: PerWheel, gain: float, limit: float) -> PerWheel:
    """Compute -gain (h.n / n.n) n (N m), which drains the momentum along n.

    n is of the null space, so the torque does not move the body. gain in 1/s; no wheel
    gets more than `limit`.
    """
    size2 = inner(n, n)
    if size2 == 0.0:
        return (0.0,) * len(h)
    t = min(max(-gain * inner(h, n) / size2, -limit), limit)
    return tuple(t * x for x in n)


def null_direction(
    h: PerWheel, axes: WheelColumns, to_wheels: tuple[float, ...], null: PerWheel
) -> PerWheel:
    """Return the direction of the null space along which h (N m s) is drained.

    It is `null` of four wheels; of more it is what they hold against each other, whose
    largest element is made +-1.
    """
    if len(h) == FOUR:
        return null
    against = null_part(axes, to_wheels, h)
    largest = max(abs(x) for x in against)
    return null if largest == 0.0 else tuple(x / largest for x in against)
