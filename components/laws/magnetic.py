"""Optimal dumping by magnetic torquers alone: paper 000, eqs. 10-14.

The model is h' = W h + M x B + N_con (eq. 7): h (N m s) the wheels' momentum, M (A m2)
the torquers' dipole, B (T) the measured field, N_con (N m) the constant torque of an
off-nadir attitude (eq. 3), W = -[omega x] with omega (rad/s) the body's inertial rate;
all in the body frame. W is skew, so exp(W t) is the rotation by -omega t, and M x B = Q
M with Q = -[B x] (eq. 5).

Of the cost 1/2 int h'F h + M'R M dt with R = diag(weight) (1) and F (1/(T2 s2)), the
costate p is in A m2/T and the gain K, p = K h - g, in 1/(T2 s). A symmetric matrix is
six numbers: its upper triangle, row by row.
"""

from __future__ import annotations

from ..contract.block import Mat33, Table, Vec3
from ..maths.vector import cross, mat_vec, rotation_about, scale, sub

UPPER = 6
"""Numbers of a symmetric matrix of three: xx, xy, xz, yy, yz, zz."""


def dipole(p: Vec3, b: Vec3, weight: Vec3) -> Vec3:
    """The dipole of a costate: M = -R^-1 Q' p = R^-1 (p x B) (A m2), eqs. 11 and 13.

    p (A m2/T), b (T), weight (1, positive): the diagonal of R.
    """
    x, y, z = cross(p, b)
    return (x / weight[0], y / weight[1], z / weight[2])


def lqr_costate(h: Vec3, gain: Table, offset: Vec3) -> Vec3:
    """p = K h - g (A m2/T), eq. 11, with K (1/(T2 s)) as six numbers and g (A m2/T)."""
    return sub(mat_vec(full(gain), h), offset)


def mec_costate(p0: Vec3, omega: Vec3, elapsed: float) -> Vec3:
    """p = exp(W t) p(t_0) (A m2/T), t = elapsed (s) since t_0, eq. 13."""
    return mat_vec(rotation_about(scale(-1.0, omega), elapsed), p0)


def full(upper: Table) -> Mat33:
    """The symmetric matrix of six numbers."""
    xx, xy, xz, yy, yz, zz = upper
    return (xx, xy, xz, xy, yy, yz, xz, yz, zz)


def interpolated(
    table: Table, columns: int, nodes: int, horizon: float, t: float
) -> Table:
    """A row between the rows of a table whose first `nodes` rows lie evenly from 0 to
    the horizon.

    Linear, so that between two gains without negative eigenvalues there is none with;
    the error is at most 1/8 (horizon / (nodes - 1))^2 times the second derivative. t
    and horizon in s, 0 <= t <= horizon; nodes >= 2.
    """
    x = t / horizon * (nodes - 1)
    i = min(int(x), nodes - 2)
    s, first = x - i, i * columns
    a, b = table[first : first + columns], table[first + columns : first + 2 * columns]
    return tuple(u + s * (v - u) for u, v in zip(a, b, strict=True))
