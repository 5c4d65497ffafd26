"""The split of a dumping torque N between magnetic torquers and thrusters: paper 000, eqs. 20-34.

N = N_T + M x B (eq. 20): N_T (N m) by thrusters, M (A m2) the torquers' dipole, B (T) the measured
field; all in the body frame. Each split returns (M, N_T).
"""

from __future__ import annotations

from ..block import Vec3
from ..vector import ZERO, clip, cross, dot, norm, scale, sub

Split = tuple[Vec3, Vec3]


def dct(n: Vec3, b: Vec3) -> Split:
    """Thrusters only."""
    return ZERO, n


def cccp(n: Vec3, b: Vec3, k: float) -> Split:
    """Conventional cross-product law M = -k (N x B) / |B|, k in 1/T (eq. 25)."""
    size = norm(b)
    if size == 0.0:
        return ZERO, n
    return _with_thrusters(n, b, scale(-k / size, cross(n, b)))


def crcp(n: Vec3, b: Vec3) -> Split:
    """Revised cross-product law M = -(N x B) / |B|^2: all of N across B (eqs. 26-28)."""
    size2 = dot(b, b)
    if size2 == 0.0:
        return ZERO, n
    return _with_thrusters(n, b, scale(-1.0 / size2, cross(n, b)))


def ocdc(n: Vec3, b: Vec3, weight_ratio: float) -> Split:
    """Optimal blending, least a |M|^2 + b |N_T|^2; weight_ratio = b / a in 1/T2 (eq. 24).

    S^-1 A' (A S^-1 A')^-1 N has the closed form N_T = N_par + N_perp / (1 + (b / a) |B|^2), with
    par and perp along and across B (notes, invariants).
    """
    size2 = dot(b, b)
    if size2 == 0.0:
        return ZERO, n
    share = weight_ratio * size2 / (1.0 + weight_ratio * size2)
    return _with_thrusters(n, b, scale(-share / size2, cross(n, b)))


def saturated(split: Split, b: Vec3, limit: float) -> Split:
    """Each dipole component within +-limit (A m2); thrusters compensate what is lost (eq. 34)."""
    m, n_t = split
    bounded = clip(m, limit)
    lost = cross(sub(m, bounded), b)
    return bounded, (n_t[0] + lost[0], n_t[1] + lost[1], n_t[2] + lost[2])


def _with_thrusters(n: Vec3, b: Vec3, m: Vec3) -> Split:
    return m, sub(n, cross(m, b))
