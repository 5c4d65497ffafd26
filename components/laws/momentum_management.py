"""Compute momentum management by magnetic torquers: paper 001, eqs. 1-8 and Table 1.

The torque on the craft is T_M = mu x B, with mu (A m2) the dipole and B (T) the field,
and its total momentum obeys H' = T_GG + T_M (N m) in axes that do not turn. All
arguments of one call are in the same axes. S = A A' (1) is the weighting: A holds the
coils' axes M for least coil energy, the wheels' axes W for least wheel speed, and S is
the identity for orthogonal ones.

Table 1 in a clean form. Closed loop: P = T_D / (B'S B), mu_M = (S B) x P. If the skew
matrix of B is read in place of the vector, the matrix of the formula is singular, and
the pseudo-inverse gives the same T_M whatever A, in contradiction to the text. Open
loop, where the skew matrix is meant: P = [integral of [B]'S[B] dt]^-1 H_D, mu_M = S (B
x P). Both: mu_T = M'(M M')^-1 mu_M.
"""

from __future__ import annotations

from math import acos, cos, inf, pi, sqrt

from ..contract.block import Mat33, Mat34, Table, Vec3, Vec4, WheelColumns
from ..maths.vector import ZERO, add, cross, dot, inner, inverse, mat_vec, scale, sub

# Numbers in a row of the preview's tables: the upper triangle xx, xy, xz, yy, yz, zz; a
# vector.
GAIN, COSTATE = 6, 3


def weighting(axes: WheelColumns) -> Mat33:
    """Compute S = A A' (1) of a mounting matrix A, its columns the axes."""
    count = len(axes) // 3
    x, y, z = axes[:count], axes[count : 2 * count], axes[2 * count :]
    xy, xz, yz = inner(x, y), inner(x, z), inner(y, z)
    return (inner(x, x), xy, xz, xy, inner(y, y), yz, xz, yz, inner(z, z))


def without(axes: Mat34, dead: int) -> Mat34:
    """Return the mounting matrix with column `dead`, from 1 on, set to zero.

    0: as it is.
    """
    return tuple(0.0 if i % 4 == dead - 1 else x for i, x in enumerate(axes))


def closed_loop_torque(h: Vec3, bias: Vec3, gain: float, gravity: Vec3) -> Vec3:
    """Compute T_D = -K_M (H_T + H_B) - T_GG (N m), eq. 5.

    K_M (1/s), H_T and H_B (N m s).
    """
    return sub(scale(-gain, add(h, bias)), gravity)


def mixed_mode_torque(h: Vec3, nominal: Vec3, period: float, gravity: Vec3) -> Vec3:
    """Compute T_D = (H_NOM(t + period) - H_T(t)) / period - T_GG (N m), eq. 4.

    period (s).
    """
    return sub(scale(1.0 / period, sub(nominal, h)), gravity)


def closed_loop_dipole(torque: Vec3, b: Vec3, s: Mat33) -> Vec3:
    """Compute mu_M (A m2) of Table 1, closed loop; zero where there is no field.

    T_M = T_D - S B (B.T_D) / (B'S B): of all torques across B it minimises (T_D - T_M)'
    S^-1 (T_D - T_M); for S = 1 it is the part of T_D across B.
    """
    sb = mat_vec(s, b)
    size = dot(b, sb)
    return ZERO if size <= 0.0 else scale(1.0 / size, cross(sb, torque))


def open_loop_dipole(p: Vec3, b: Vec3, s: Mat33) -> Vec3:
    """Compute mu_M = S (B x P) (A m2) of Table 1, open loop.

    P (A m2/T) is the costate.
    """
    return mat_vec(s, cross(b, p))


def field_product(b: Vec3, s: Mat33) -> Mat33:
    """Compute [B]'S[B] (T2), whose integral the costate needs; [B] v = B x v.

    The integral is that over a period.
    """
    x, y, z = b
    # the columns of S[B], then [B]' times them: [B]'v = v x B
    first = cross(mat_vec(s, (0.0, z, -y)), b)
    second = cross(mat_vec(s, (-z, 0.0, x)), b)
    third = cross(mat_vec(s, (y, -x, 0.0)), b)
    return (
        first[0],
        second[0],
        third[0],
        first[1],
        second[1],
        third[1],
        first[2],
        second[2],
        third[2],
    )


def open_loop_costate(product: Mat33, momentum: Vec3) -> Vec3:
    """Solve for P (A m2/T) from the integral of `field_product` and H_D (N m s).

    The integral is in T2 s. `condition` measures how near to singular it is.

    Raises
    ------
    ZeroDivisionError
        If the integral is singular.
    """
    return mat_vec(inverse(product), momentum)


def condition(m: Mat33) -> float:
    """Compute the condition (1) of a symmetric matrix without negative eigenvalues.

    It is the largest over the smallest eigenvalue; inf where the smallest is zero.
    Closed form: Smith, Communications of the ACM 4 (1961) 168.
    """
    a, b, c, _, d, e, _, _, f = m
    mean = (a + d + f) / 3.0
    a, d, f = a - mean, d - mean, f - mean
    spread = sqrt((a * a + d * d + f * f + 2.0 * (b * b + c * c + e * e)) / 6.0)
    if spread == 0.0:
        return 1.0 if mean > 0.0 else inf
    determinant = a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d)
    angle = (
        acos(min(max(0.5 * determinant / (spread * spread * spread), -1.0), 1.0)) / 3.0
    )
    least = mean + 2.0 * spread * cos(angle + 2.0 * pi / 3.0)
    most = mean + 2.0 * spread * cos(angle)
    return inf if least <= 1e-15 * most else most / least


def held_field(b: Vec3, before: Vec3, second: Vec3, third: Vec3) -> Vec3:
    """Predict the mean field (T) until the next sample from this and the last three.

    b is the present field, before, second and third those of one to three samples ago,
    all in axes that do not rotate; zero stands for a sample that does not exist. The
    weights are those of Adams and Bashforth: where the field rotates by an angle a
    (rad) per sample, the relative error is 0.35 a^4.
    """
    if before == ZERO:
        return b
    if second == ZERO:
        return sub(scale(1.5, b), scale(0.5, before))
    if third == ZERO:
        return add(
            sub(scale(23.0 / 12.0, b), scale(4.0 / 3.0, before)),
            scale(5.0 / 12.0, second),
        )
    newer = sub(scale(55.0 / 24.0, b), scale(59.0 / 24.0, before))
    return add(newer, sub(scale(37.0 / 24.0, second), scale(9.0 / 24.0, third)))


def scale_to_limit(m: Vec3, coils: Vec4, limit: float) -> Vec3:
    """Scale the dipole m (A m2) down so that no coil exceeds its limit.

    `coils` is the allocation of m to the coils. The direction of m is preserved.
    """
    a, b, c, d = coils
    most = max(abs(a), abs(b), abs(c), abs(d))
    return m if most <= limit else scale(limit / most, m)


def preview_costate(gain: Table, offset: Vec3, h: Vec3) -> Vec3:
    """Compute P = -(K h + g) (A m2/T), for `open_loop_dipole`.

    This state feedback minimises the cost q |H|^2 + |mu_T|^2 over a predicted field and
    gravity gradient, with K (1/(T2 s)) as six numbers and g (A m2/T). It is not in the
    paper; Psiaki, J. Guidance 24 (2001) 386, has it periodic.
    """
    xx, xy, xz, yy, yz, zz = gain
    x, y, z = h
    return (
        -(xx * x + xy * y + xz * z + offset[0]),
        -(xy * x + yy * y + yz * z + offset[1]),
        -(xz * x + yz * y + zz * z + offset[2]),
    )


def place(nodes: int, spacing: float, t: float) -> tuple[int, float]:
    """Find the row of an even table at or before t (s), and the fraction to the next.

    0 <= t <= (nodes - 1) spacing; spacing in s.
    """
    x = t / spacing
    i = min(max(int(x), 0), nodes - 2)
    return i, x - i


def between3(
    table: Table, i: int, share: float, first: int = 0, width: int = 3
) -> Vec3:
    """Interpolate three numbers of a row linearly between rows i and i + 1.

    The rows have `width` numbers; the three begin at `first`.
    """
    k, r = width * i + first, 1.0 - share
    return (
        r * table[k] + share * table[k + width],
        r * table[k + 1] + share * table[k + width + 1],
        r * table[k + 2] + share * table[k + width + 2],
    )


def between6(table: Table, i: int, share: float) -> Table:
    """Interpolate a row of six linearly between rows i and i + 1.

    Between two gains without negative eigenvalues the result has none either.
    """
    k, r = 6 * i, 1.0 - share
    return (
        r * table[k] + share * table[k + 6],
        r * table[k + 1] + share * table[k + 7],
        r * table[k + 2] + share * table[k + 8],
        r * table[k + 3] + share * table[k + 9],
        r * table[k + 4] + share * table[k + 10],
        r * table[k + 5] + share * table[k + 11],
    )


def profile3(table: Table, nodes: int, period: int, i: int, share: float) -> Vec3:
    """Interpolate a row of three between rows i and i + 1 of a profile.

    The slope of the profile jumps every `period` rows, where a desaturation period
    ends. The interpolation is cubic through the four rows around. At a jump, or at the
    table's end, it uses the three rows on this side of it; it is linear where there are
    only two.
    """
    first = i - i % period
    last = min(first + period, nodes - 1)
    if last - first < 2:
        return between3(table, i, share)
    u, v = share, share * share
    w = v * u
    h00, h01 = 2.0 * w - 3.0 * v + 1.0, 3.0 * v - 2.0 * w
    h10, h11 = w - 2.0 * v + u, w - v
    x, y, z = (
        h00 * table[3 * i + k]
        + h01 * table[3 * i + 3 + k]
        + h10 * _slope(table, k, i, first, last)
        + h11 * _slope(table, k, i + 1, first, last)
        for k in range(3)
    )
    return (x, y, z)


def _slope(table: Table, k: int, i: int, first: int, last: int) -> float:
    """Compute the slope of column k at row i, per row.

    It uses rows `first` to `last` alone.
    """
    j = 3 * i + k
    if i == first:
        return 0.5 * (4.0 * table[j + 3] - 3.0 * table[j] - table[j + 6])
    if i == last:
        return 0.5 * (3.0 * table[j] - 4.0 * table[j - 3] + table[j - 6])
    return 0.5 * (table[j + 3] - table[j - 3])
