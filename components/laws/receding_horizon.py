"""Plan fuel-optimal dumping over a horizon with a predicted field.

The wheels' momentum h (N m s) obeys h' = -omega x h + N_T + M x B + N_con (paper 000,
eq. 15); in an inertial frame it is the sum of all impulses. So, over samples of
`period` (s) with C_k the body's attitude and B_k (T, body) the field in the middle of
sample k, and C_0 and C_f the attitudes now and at the end,

    C_f' h_target - C_0' h = period sum C_k' (N_T + M x B_k + N_con)

for constant N_T (N m) and M (A m2) in each sample; within a sample of 10 s this is
accurate to 2e-5.
"""

from __future__ import annotations

from collections.abc import Callable

from ..contract.block import Vec3, Vec4
from ..maths.attitude import matrix
from ..maths.least_effort import COLUMNS, least_effort
from ..maths.vector import ZERO, add, cross, dot, mat_t_vec, norm, scale, sub
from ..physics.orbit import (
    elements_from_state,
    ellipse_state,
    mean_motion,
    orbit_plane,
    perifocal_axes,
)

SAMPLES = COLUMNS // 6  # maximum number of samples in a plan
# Seconds of firing that correspond to a coil's full dipole over one sample. Without it,
# dipoles that save nothing would be arbitrary; it costs at most 0.02 s in 60 samples.
_DIPOLE_COST = 1e-4
# Relative discount of a second in the last sample against one now: a firing that is
# postponed may become unnecessary, should the field turn out better than predicted.
_PATIENCE = 1e-3


def coast(
    r_eci: Vec3, v_eci: Vec3, times: tuple[float, ...]
) -> tuple[tuple[Vec3, Vec3], ...]:
    """Propagate two-body motion to `times` (s): position (m), velocity (m/s), eci.

    Raises
    ------
    ValueError
        If the motion is not an ellipse.
    """
    a, e, inclination, raan, perigee, anomaly = elements_from_state(r_eci, v_eci)
    n = mean_motion(a)
    p, q = perifocal_axes(inclination, raan, perigee)
    return tuple(ellipse_state(a, e, anomaly + n * t, n, p, q) for t in times)


def orbit_dipole(r_eci: Vec3, v_eci: Vec3, amplitudes: Vec3) -> Callable[[Vec3], Vec3]:
    """Build the field of paper 000, (b_x cos u, b_y, b_z sin u) in lvlh (eq. 30).

    The function returned takes a position (m, eci) on the orbit through r (m) with v
    (m/s) and returns the field (T, lvlh); u is the argument of latitude; amplitudes
    (b_x, b_y, b_z) in T.
    """
    elements = elements_from_state(r_eci, v_eci)
    node, ahead, _ = orbit_plane(elements.inclination, elements.raan)
    bx, by, bz = amplitudes

    def field(r: Vec3) -> Vec3:
        """Compute the field (T, lvlh) at a position (m, eci) on the orbit."""
        size = norm(r)
        return (bx * dot(r, node) / size, by, bz * dot(r, ahead) / size)

    return field


Vec10 = tuple[float, float, float, float, float, float, float, float, float, float]
# Sums of a fit of the field: X X' (the upper triangle, row by row) and, for each axis,
# X D, without the prior.
Fit = tuple[Vec10, tuple[Vec4, Vec4, Vec4]]
NO_FIT: Fit = ((0.0,) * 10, ((0.0,) * 4, (0.0,) * 4, (0.0,) * 4))


def learnt(fit: Fit, model: Vec3, measured_field: Vec3) -> Fit:
    """Add a measurement to a fit: D = measured_field - model (T, body).

    It is at X = (model, size), where size is that of the model's field.
    """
    (xx, xy, xz, xs, yy, yz, ys, zz, zs, ss), sums = fit
    x, y, z = model
    s = norm(model)
    d = sub(measured_field, model)
    squares = (
        xx + x * x,
        xy + x * y,
        xz + x * z,
        xs + x * s,
        yy + y * y,
        yz + y * z,
        ys + y * s,
        zz + z * z,
        zs + z * s,
        ss + s * s,
    )
    return squares, (
        _with(sums[0], d[0], model, s),
        _with(sums[1], d[1], model, s),
        _with(sums[2], d[2], model, s),
    )


def _with(sums: Vec4, d: float, model: Vec3, size: float) -> Vec4:
    """Add d times (model, size) to the sums of one axis."""
    x, y, z = model
    return (sums[0] + x * d, sums[1] + y * d, sums[2] + z * d, sums[3] + size * d)


def correct_fields(
    fit: Fit, fields: tuple[Vec3, ...], spread: float, noise: float
) -> tuple[Vec3, ...]:
    """Correct the `fields` (T, body) of a model by the measurements so far.

    B = b + A b + c |b| covers a misaligned attitude, a wrong scale and a wrong constant
    part. The elements of A and c are the most likely ones where each is 0 with a
    standard deviation of `spread` before any measurement, and each measurement errs by
    `noise` (T). The prior divides the information of one measurement among them; as the
    field turns, they become distinguishable.
    """
    (xx, xy, xz, xs, yy, yz, ys, zz, zs, ss), sums = fit
    share = noise / spread
    prior = share * share
    normal = (xx + prior, xy, xz, xs, yy + prior, yz, ys, zz + prior, zs, ss + prior)
    x, y, z = (_solve(normal, axis) for axis in sums)
    return tuple(add(b, (_times(x, b), _times(y, b), _times(z, b))) for b in fields)


def _times(row: Vec4, b: Vec3) -> float:
    """Return the correction of one component of b (T): row . (b, |b|)."""
    return row[0] * b[0] + row[1] * b[1] + row[2] * b[2] + row[3] * norm(b)


def _solve(m: Vec10, v: Vec4) -> Vec4:
    """Solve m x = v by elimination.

    m is symmetric and positive definite, its upper triangle row by row.
    """
    a, b, c, d, e, f, g, h, i, j = m
    p, q, r, s = v
    k, n, o = b / a, c / a, d / a
    e, f, g, q = e - k * b, f - k * c, g - k * d, q - k * p
    h, i, r = h - n * c, i - n * d, r - n * p
    j, s = j - o * d, s - o * p
    k, n = f / e, g / e
    h, i, r = h - k * f, i - k * g, r - k * q
    j, s = j - n * g, s - n * q
    k = i / h
    w = (s - k * r) / (j - k * i)
    z = (r - i * w) / h
    y = (q - f * z - g * w) / e
    return ((p - b * y - c * z - d * w) / a, y, z, w)


def first_step(
    h: Vec3,
    h_target: Vec3,
    q_bi: tuple[Vec4, ...],
    fields: tuple[Vec3, ...],
    n_con: Vec3,
    limit: Vec3,
    tau_level: Vec3,
    longest: tuple[float, float],
    period: float,
) -> tuple[Vec3, Vec3, float] | None:
    """Plan the least firing time and return the first sample; None without a plan.

    It is a linear programme in eci (`least_effort`), of `goal`, `columns`, `costs` and
    `bounds`. All arguments are in body axes.

    Parameters
    ----------
    h, h_target
        The wheels' momentum now and its target at the end (N m s).
    q_bi
        Predicted attitudes now, in the middle of each sample, and at the end.
    fields
        B (T) in the middle of each sample, at most SAMPLES.
    n_con
        Constant disturbance torque (N m).
    limit
        Largest mean dipole (A m2).
    tau_level
        Torque of the thrusters (N m).
    longest
        Largest on-times (s) in the first sample and in the others.
    period
        Duration of a sample (s).

    Returns
    -------
    tuple or None
        Mean dipole (A m2); on-time of each axis (s) with the sign of its torque; on-time
        of all axes over the whole plan (s).
    """
    impulse = goal(h, h_target, q_bi, n_con, max(tau_level), period)
    effect = columns(q_bi, fields, limit, tau_level, period)
    cost = costs(len(fields))
    most = bounds(len(fields), longest)
    x = least_effort(effect, cost, most, impulse)
    if x is None:
        return None
    firing = 0.0
    for i in range(len(x)):
        if i % 6 < 3:
            firing += abs(x[i])
    return (
        (x[3] * limit[0], x[4] * limit[1], x[5] * limit[2]),
        (x[0], x[1], x[2]),
        firing,
    )


def goal(
    h: Vec3,
    h_target: Vec3,
    q_bi: tuple[Vec4, ...],
    n_con: Vec3,
    strength: float,
    period: float,
) -> Vec3:
    """Compute the impulse (eci) that a plan must give, over `strength` (N m): in s.

    The arguments are those of `first_step`.
    """
    last = len(q_bi) - 1
    external = ZERO
    for k in range(1, last):
        external = add(external, mat_t_vec(matrix(q_bi[k]), n_con))
    target_change = sub(
        mat_t_vec(matrix(q_bi[last]), h_target), mat_t_vec(matrix(q_bi[0]), h)
    )
    return scale(1.0 / strength, sub(target_change, scale(period, external)))


def columns(
    q_bi: tuple[Vec4, ...],
    fields: tuple[Vec3, ...],
    limit: Vec3,
    tau_level: Vec3,
    period: float,
) -> tuple[Vec3, ...]:
    """Compute the impulses (eci) that a plan consists of, over the strongest level.

    Each sample has six: that of a second of firing about each axis, and that of the
    largest dipole along each over the sample. So both sides of the programme are in
    seconds, as its tolerances require. The arguments are those of `first_step`.
    """
    strength = max(tau_level)
    return tuple(
        mat_t_vec(matrix(q), scale(1.0 / strength, column))
        for q, b in zip(q_bi[1:-1], fields, strict=True)
        for column in (
            (tau_level[0], 0.0, 0.0),
            (0.0, tau_level[1], 0.0),
            (0.0, 0.0, tau_level[2]),
            scale(period * limit[0], cross((1.0, 0.0, 0.0), b)),
            scale(period * limit[1], cross((0.0, 1.0, 0.0), b)),
            scale(period * limit[2], cross((0.0, 0.0, 1.0), b)),
        )
    )


def costs(samples: int) -> tuple[float, ...]:
    """Return the cost of each column: of a second of firing, and of a full dipole."""
    return tuple(
        1.0 - _PATIENCE * k / samples if i < 3 else _DIPOLE_COST
        for k in range(min(samples, SAMPLES))
        for i in range(6)
    )


def bounds(samples: int, longest: tuple[float, float]) -> tuple[float, ...]:
    """Return the bound of each column: the longest on-time (s), and the full dipole."""
    return tuple(
        (longest[0] if k == 0 else longest[1]) if i < 3 else 1.0
        for k in range(min(samples, SAMPLES))
        for i in range(6)
    )
