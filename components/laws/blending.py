"""Split a dumping torque N between magnetic torquers and thrusters.

Source: paper 000, eqs. 20-34. N = N_T + M x B (eq. 20): N_T (N m) by thrusters, M (A
m2) the torquers' dipole, B (T) the measured field; all in the body frame. Each split
returns (M, N_T).

The bounded splits at the end are not in the paper. They include the limit in the
optimisation, whereas eq. 34 limits a dipole that was optimised without it.
"""

from __future__ import annotations

from math import copysign, inf

from ..contract.block import Mat33, Vec3
from ..maths.simplex import least_cost
from ..maths.vector import (
    IDENTITY,
    ZERO,
    add,
    clip,
    cross,
    dot,
    inverse,
    mat_vec,
    norm,
    scale,
    sub,
)

#: Torquers' dipole (A m2) and thrusters' torque (N m), body.
Split = tuple[Vec3, Vec3]
_Held = tuple[float | None, float | None, float | None]


def dct(n: Vec3, b: Vec3) -> Split:
    """Split by thrusters only."""
    return ZERO, n


def cccp(n: Vec3, b: Vec3, k: float) -> Split:
    """Split by the conventional cross-product law M = -k (N x B) / |B| (eq. 25).

    k in 1/T.
    """
    size = norm(b)
    if size == 0.0:
        return ZERO, n
    return _with_thrusters(n, b, scale(-k / size, cross(n, b)))


def crcp(n: Vec3, b: Vec3) -> Split:
    """Split by the revised cross-product law M = -(N x B) / |B|^2 (eqs. 26-28).

    The torquers take all of N across B.
    """
    size2 = dot(b, b)
    if size2 == 0.0:
        return ZERO, n
    return _with_thrusters(n, b, scale(-1.0 / size2, cross(n, b)))


def ocdc(n: Vec3, b: Vec3, weight_ratio: float) -> Split:
    """Split optimally: minimise a |M|^2 + b |N_T|^2 (eq. 24).

    weight_ratio = b / a in 1/T2. S^-1 A' (A S^-1 A')^-1 N has the closed form N_T =
    N_par + N_perp / (1 + (b / a) |B|^2), with par and perp along and across B (notes,
    invariants).
    """
    size2 = dot(b, b)
    if size2 == 0.0:
        return ZERO, n
    share = weight_ratio * size2 / (1.0 + weight_ratio * size2)
    return _with_thrusters(n, b, scale(-share / size2, cross(n, b)))


def limit_dipole(split: Split, b: Vec3, limit: float) -> Split:
    """Limit each dipole component to +-limit (A m2); thrusters compensate (eq. 34)."""
    return _replace_dipole(split, b, clip(split[0], limit))


def without(split: Split, b: Vec3, axis: int) -> Split:
    """Remove the dipole along `axis` (0 to 2), a dead coil; thrusters compensate.

    Eq. 34.
    """
    x, y, z = (0.0 if i == axis else m for i, m in enumerate(split[0]))
    return _replace_dipole(split, b, (x, y, z))


def bounded_quadratic(n: Vec3, b: Vec3, weight_ratio: float, limit: Vec3) -> Split:
    """Split optimally with |M_i| <= limit_i (A m2): minimise a |M|^2 + b |N_T|^2.

    The cost is that of `ocdc`. The result is exact, without tolerances. Where the
    unconstrained optimum violates some bounds, the constrained optimum lies on one of
    these (otherwise a step towards the former would improve it). Each is fixed in turn,
    which leaves the same problem with one component less.
    """
    split = ocdc(n, b, weight_ratio)
    if all(abs(m) <= most for m, most in zip(split[0], limit, strict=True)):
        return split
    x, y, z = b
    s, k = dot(b, b), weight_ratio
    # half the gradient is hessian M - slope, as |N - M x B|^2 = |N|^2 + 2 M.(N x B) +
    # |M x B|^2
    hessian = (
        1.0 + k * (s - x * x),
        -k * x * y,
        -k * x * z,
        -k * x * y,
        1.0 + k * (s - y * y),
        -k * y * z,
        -k * x * z,
        -k * y * z,
        1.0 + k * (s - z * z),
    )
    return _with_thrusters(
        n, b, _in_box(hessian, scale(-k, cross(n, b)), limit, (None, None, None))
    )


def bounded_one_norm(n: Vec3, b: Vec3, limit: Vec3) -> Split:
    """Split for minimum |N_T|_1, the thrusters' on-time, with |M_i| <= limit_i (A m2).

    A linear programme (`simplex`). A dipole along B gives no torque, so the smallest of
    the dipoles with the same torque is taken.
    """
    size = norm(b)
    if size == 0.0:
        return ZERO, n
    # M = y - limit with 0 <= y <= 2 limit; torques are divided by |B|, so that all values
    # are of the size of M
    x, y, z = scale(1.0 / size, b)
    columns = ((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0))  # e_i x B / |B|
    lowest = scale(-1.0, limit)
    goal = sub(scale(1.0 / size, n), cross(lowest, (x, y, z)))
    most = (2.0 * limit[0], 2.0 * limit[1], 2.0 * limit[2])
    m0, m1, m2 = least_cost(columns, (0.0,) * 3, most, goal, 1.0)
    m = _nearest_along(add((m0, m1, m2), lowest), (x, y, z), limit)
    return _with_thrusters(n, b, m)


def _in_box(hessian: Mat33, slope: Vec3, limit: Vec3, held_components: _Held) -> Vec3:
    """Minimise M'(hessian M / 2 - slope) with |M_i| <= limit_i.

    M_i = held_components[i] where that is not None.
    """
    rows = [
        h if held_components[k // 3] is None else IDENTITY[k]
        for k, h in enumerate(hessian)
    ]
    right = tuple(
        s if held_value is None else held_value
        for s, held_value in zip(slope, held_components, strict=True)
    )
    solution = mat_vec(inverse(tuple(rows)), right)  # type: ignore[arg-type]
    x, y, z = m = tuple(
        value if held_value is None else held_value
        for value, held_value in zip(solution, held_components, strict=True)
    )
    broken = [
        i for i in range(3) if abs(m[i]) > limit[i] and held_components[i] is None
    ]
    if not broken:
        return (x, y, z)
    on_bounds = (
        _in_box(
            hessian, slope, limit, _with(held_components, i, copysign(limit[i], m[i]))
        )
        for i in broken
    )
    return min(
        on_bounds, key=lambda v: dot(v, sub(scale(0.5, mat_vec(hessian, v)), slope))
    )


def _with(held_components: _Held, axis: int, value: float) -> _Held:
    """Return `held_components` with the component `axis` held at `value` (A m2)."""
    x, y, z = (
        value if i == axis else held_value
        for i, held_value in enumerate(held_components)
    )
    return (x, y, z)


def _nearest_along(m: Vec3, u: Vec3, limit: Vec3) -> Vec3:
    """Find the shortest m + s u with all components within their limits.

    u has the length 1, and m is within the limits.
    """
    low, high = -inf, inf
    for component, slope, most in zip(m, u, limit, strict=True):
        if slope != 0.0:
            a, b = (-most - component) / slope, (most - component) / slope
            low, high = max(low, min(a, b)), min(high, max(a, b))
    nearest = add(m, scale(min(max(-dot(m, u), low), high), u))
    x, y, z = (min(max(c, -most), most) for c, most in zip(nearest, limit, strict=True))
    return (x, y, z)  # limited again, as the shift rounds


def _replace_dipole(split: Split, b: Vec3, m: Vec3) -> Split:
    """Replace the dipole of a split by m and add the lost torque to the thrusters."""
    removed_torque = cross(sub(split[0], m), b)
    return m, add(split[1], removed_torque)


def _with_thrusters(n: Vec3, b: Vec3, m: Vec3) -> Split:
    """Return m with the thruster torque that remains of n."""
    return m, sub(n, cross(m, b))
