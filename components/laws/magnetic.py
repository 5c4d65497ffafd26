"""Compute optimal dumping by magnetic torquers alone: paper 000, eqs. 10-14.

The model is h' = W h + M x B + N_con (eq. 7): h (N m s) the wheels' momentum, M (A m2)
the torquers' dipole, B (T) the measured field, N_con (N m) the constant torque of an
off-nadir attitude (eq. 3), W = -[omega x] with omega (rad/s) the body's inertial rate;
all in the body frame. W is skew, so exp(W t) is the rotation by -omega t, and M x B = Q
M with Q = -[B x] (eq. 5).

For the cost 1/2 int h'F h + M'R M dt with R = diag(weight) (1) and F (1/(T2 s2)), the
costate p is in A m2/T and the gain K, p = K h - g, in 1/(T2 s). A symmetric matrix is
six numbers: its upper triangle, row by row.
"""

from __future__ import annotations

from ..contract.block import Mat33, Table, Vec3
from ..maths.vector import cross, mat_vec, rotation_about, scale, sub

UPPER = 6  # numbers of a symmetric matrix of three: xx, xy, xz, yy, yz, zz


def dipole(p: Vec3, b: Vec3, weight: Vec3) -> Vec3:
    """Compute the dipole of a costate: M = -R^-1 Q' p = R^-1 (p x B) (A m2).

    Eqs. 11 and 13. p (A m2/T), b (T), weight (1, positive): the diagonal of R.
    """
    x, y, z = cross(p, b)
    return (x / weight[0], y / weight[1], z / weight[2])


def lqr_costate(h: Vec3, gain: Table, offset: Vec3) -> Vec3:
    """Compute the costate p = K h - g (A m2/T), eq. 11.

    K (1/(T2 s)) as six numbers, g (A m2/T).
    """
    return sub(mat_vec(full(gain), h), offset)


def mec_costate(p0: Vec3, omega: Vec3, elapsed_time: float) -> Vec3:
    """Compute the costate p = exp(W t) p(t_0) (A m2/T), eq. 13.

    t = elapsed_time (s) since t_0.
    """
    return mat_vec(rotation_about(scale(-1.0, omega), elapsed_time), p0)


def full(upper: Table) -> Mat33:
    """Expand six numbers to the symmetric matrix."""
    xx, xy, xz, yy, yz, zz = upper
    return (xx, xy, xz, xy, yy, yz, xz, yz, zz)


def interpolate_rows(
    table: Table, columns: int, nodes: int, horizon: float, t: float
) -> Table:
    """Interpolate between the rows of a table, linearly in t.

    Its first `nodes` rows lie evenly from 0 to the horizon. An interpolation between two
    gains without negative eigenvalues has none either; the error is at most 1/8 (horizon /
    (nodes - 1))^2 times the second derivative. t and horizon in s, 0 <= t <= horizon; nodes
    >= 2.
    """
    x = t / horizon * (nodes - 1)
    i = min(int(x), nodes - 2)
    s, first = x - i, i * columns
    a, b = table[first : first + columns], table[first + columns : first + 2 * columns]
    return tuple(u + s * (v - u) for u, v in zip(a, b, strict=True))
