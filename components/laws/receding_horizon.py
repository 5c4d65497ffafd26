"""Fuel-optimal dumping over a horizon with a predicted field. Needs numpy and scipy.

The wheels' momentum h (N m s) obeys h' = -omega x h + N_T + M x B + N_con (paper 000, eq. 15); in
an inertial frame it is the sum of what acts. So, over samples of `period` (s) with C_k the body's
attitude and B_k (T, body) the field in the middle of sample k, and C_0 and C_f the attitudes now
and at the end,

    C_f' h_target - C_0' h = period sum C_k' (N_T + M x B_k + N_con)

for constant N_T (N m) and M (A m2) in each sample: within a sample of 10 s that is right to 2e-5.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..contract.block import Vec3, Vec4
from ..maths.attitude import matrix
from ..maths.vector import dot, norm, sub
from ..physics.orbit import (
    elements_from_state,
    ellipse_state,
    mean_motion,
    orbit_plane,
    perifocal_axes,
)
from .least_firing import least_firing

_DIPOLE_COST = 1e-4
"""s of firing that a coil's whole dipole over one sample is worth: without it dipoles that save
nothing would be anything; it costs 0.02 s at the most in 60 samples."""
_PATIENCE = 1e-3
"""What a second in the last sample is cheaper than one now: what need not fire now may not be
needed, should the field turn out better than predicted."""


def coast(r_eci: Vec3, v_eci: Vec3, times: Sequence[float]) -> list[tuple[Vec3, Vec3]]:
    """Position (m) and velocity (m/s) after `times` (s) of two-body motion, eci.

    Raises ValueError where the motion is not an ellipse.
    """
    a, e, inclination, raan, perigee, anomaly = elements_from_state(r_eci, v_eci)
    n = mean_motion(a)
    p, q = perifocal_axes(inclination, raan, perigee)
    return [ellipse_state(a, e, anomaly + n * t, n, p, q) for t in times]


def orbit_dipole(r_eci: Vec3, v_eci: Vec3, amplitudes: Vec3) -> Callable[[Vec3], Vec3]:
    """The field of paper 000, (b_x cos u, b_y, b_z sin u) in lvlh (eq. 30), along an orbit.

    The function returned takes a position (m, eci) on the orbit through r (m) with v (m/s); u is
    its argument of latitude; amplitudes (b_x, b_y, b_z) in T.
    """
    elements = elements_from_state(r_eci, v_eci)
    node, ahead, _ = orbit_plane(elements.inclination, elements.raan)
    bx, by, bz = amplitudes

    def field(r: Vec3) -> Vec3:
        size = norm(r)
        return (bx * dot(r, node) / size, by, bz * dot(r, ahead) / size)

    return field


Fit = tuple[float, ...]
"""Sums of a fit of the field: X X' (4 x 4) and X D' (4 x 3), row by row, without the prior."""
NO_FIT: Fit = (0.0,) * 28


def learnt(fit: Fit, model: Vec3, measured: Vec3) -> Fit:
    """A fit with one more measurement: D = measured - model (T, body) at X = (model, size), where
    size is that of the model's field."""
    x = np.array([*model, norm(model)])
    added = np.concatenate([np.outer(x, x).ravel(), np.outer(x, sub(measured, model)).ravel()])
    return tuple((np.array(fit) + added).tolist())


def corrected(fit: Fit, fields: Sequence[Vec3], spread: float, noise: float) -> list[Vec3]:
    """The field where a model has `fields` (T, body), as measurements so far make it likely.

    B = b + A b + c |b|: a misaligned attitude, a wrong scale and a wrong constant part are of this
    form. The elements of A and c are the likeliest where each is 0 with a deviation of `spread`
    before anything is measured, and each measurement errs by `noise` (T). What one measurement says
    is shared out between them as the prior has it; as the field turns, they come apart.
    """
    sums = np.array(fit)
    normal = sums[:16].reshape(4, 4) + np.eye(4) * (noise / spread) ** 2
    theta = np.linalg.solve(normal, sums[16:].reshape(4, 3))
    b = np.array(fields)
    x = np.column_stack([b, np.linalg.norm(b, axis=1)])
    return [(p, q, r) for p, q, r in (b + x @ theta).tolist()]


def first_step(
    h: Vec3,
    h_target: Vec3,
    q_bi: Sequence[Vec4],
    fields: Sequence[Vec3],
    n_con: Vec3,
    limit: Vec3,
    tau_level: Vec3,
    longest: tuple[float, float],
    period: float,
) -> tuple[Vec3, Vec3] | None:
    """What the plan of least firing time does in its first sample; None where there is no plan.

    h, h_target: the wheels' momentum now and wanted at the end (N m s); q_bi: the predicted
    attitudes now, in the middle of each sample, and at the end; fields: B (T) in the middle of
    each sample; n_con (N m); limit: the largest mean dipole (A m2); tau_level (N m) of the
    thrusters, which may be on for `longest` (s) of `period` (s), in the first sample and in the
    others. All in body axes.

    Returns the mean dipole (A m2), and the on-time of each axis (s) with the sign of its torque.
    """
    # rows: the body's axes in eci, so that v_eci = v_body @ c
    c = np.array([matrix(q) for q in q_bi]).reshape(-1, 3, 3)
    now, middle, end = c[0], c[1:-1], c[-1]
    external = period * np.array(n_con) @ middle.sum(axis=0)
    impulse = np.array(h_target) @ end - np.array(h) @ now - external
    pairs = np.array(tau_level)[:, None] * middle
    unit_torques = np.cross(np.eye(3), np.array(fields)[:, None, :])  # of 1 A m2 along each axis
    plan = least_firing(
        impulse,
        np.concatenate([pairs, -pairs], axis=1),
        np.array([longest[0]] + [longest[1]] * (len(middle) - 1)),
        period * np.array(limit)[:, None] * (unit_torques @ middle),
        _DIPOLE_COST,
        _PATIENCE,
    )
    if plan is None:
        return None
    on, share = plan.on_time[0], plan.dipole[0]
    mx, my, mz = (share * np.array(limit)).tolist()
    x, y, z = (on[:3] - on[3:]).tolist()
    return (mx, my, mz), (x, y, z)
