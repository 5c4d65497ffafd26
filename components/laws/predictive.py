"""Plan coils and thrusters over a forecast of field and torque, by Newton's method.

Over intervals k of dt_k (s), with X (N m s) the wheels' momentum less its target, D_k
the change of it in the forecast, and actuators j with |u_kj| <= u_max,j, all in one
inertial frame:

    X_k+1 = X_k + D_k + sum_j g_kj u_kj

u is a dipole (A m2; g = e dt a x B) or an on-time (s; g = e tau). `held` minimises

    J = sum_k dt_k [ sum_j r_j u_kj^2 / 2 + q |X_k+1|^2 / 2 + w_p sum_i (h_i / h_s)^16 ]

with h_i = a_ki . X_k+1 + b_i the momentum of wheel i. Each step expands J to second
order in X; actuators that stand at a bound and would not leave it are held there. The
rest follows from a backward sweep of 3 x 3 matrices (Riccati). The new u follows from a
forward sweep that feeds back what the bounds remove, with the step halved until J
falls. Any plan at which the iteration stops can therefore be flown and is better than
the first one.

`emptied` minimises sum (r_j u_kj^2 / 2 + c_kj |u_kj|) + W |X_N|^2 / 2. There the
costate W X_N is the same for all intervals, so only three numbers are unknown: they
maximise a concave function whose second derivative jumps where an actuator leaves zero
or reaches its bound. r is large at first.

Bertsekas, SIAM J. Control Optim. 20 (1982) 221 (projected Newton); Tassa, Mansard,
Todorov, IEEE ICRA (2014) (the sweep with bounds). The peak as a high power is that of
the space telescope's preview.
"""

from __future__ import annotations

from math import inf, sqrt

from ..contract.block import Mat33, Table, Vec3
from ..maths.matrix import multiply, transposed
from ..maths.vector import ZERO, add, dot, mat_t_vec, mat_vec, norm, scale, sub

INTERVALS = 64  # maximum number of intervals of a plan
HELD = 40  # maximum number of intervals of a plan by `held`
COILS = 3  # commands to coils in an interval
ACTUATORS = 6  # the coils and the thrusters' three axes
STEPS = 30  # maximum number of Newton steps of a plan by `held`
TRIALS = 80  # maximum number of trials in each stage of `emptied`
SETTLED = 1e-4  # A plan has converged where a step lowers J by less than this fraction.
_HALVINGS = 12
_WHEELS = 4
_ROUNDED = 1e-15
NOTHING: Mat33 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
POWER = 16.0
NO_PLAN: Table = (0.0,) * (COILS * HELD)
_STAGES = (1000.0, 100.0, 10.0, 1.0)


def root(m: Mat33) -> Mat33:
    """Compute L with m = L L', lower triangular (Cholesky).

    m is symmetric and positive definite.
    """
    a = sqrt(m[0])
    b, c = m[3] / a, m[6] / a
    d = sqrt(max(m[4] - b * b, _ROUNDED * m[4]))
    e = (m[7] - c * b) / d
    return (
        a,
        0.0,
        0.0,
        b,
        d,
        0.0,
        c,
        e,
        sqrt(max(m[8] - c * c - e * e, _ROUNDED * m[8])),
    )


def inverse_of_lower(m: Mat33) -> Mat33:
    """Compute L^-1 of a lower triangular L."""
    a, b, c = 1.0 / m[0], 1.0 / m[4], 1.0 / m[8]
    d, e = -m[3] * a * b, -m[7] * b * c
    return (a, 0.0, 0.0, d, b, 0.0, -(m[6] * a + m[7] * d) * c, e, c)


def path_cost(
    x: Vec3, k: int, rows: Table, bias: Table, q: float, peak: float, size: float
) -> float:
    """Compute q |X|^2 / 2 + w_p sum (h_i / h_s)^16 at the end of interval k."""
    cost = 0.5 * q * (x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    if peak > 0.0:
        for i in range(_WHEELS):
            n = 3 * (_WHEELS * k + i)
            s = (
                rows[n] * x[0] + rows[n + 1] * x[1] + rows[n + 2] * x[2] + bias[i]
            ) / size
            s2 = s * s
            s4 = s2 * s2
            s8 = s4 * s4
            cost += peak * s8 * s8
    return cost


def path_slope(
    x: Vec3, k: int, rows: Table, bias: Table, q: float, peak: float, size: float
) -> tuple[Vec3, Mat33]:
    """Compute the first and second derivatives of `path_cost` by X."""
    gx, gy, gz = q * x[0], q * x[1], q * x[2]
    xx, xy, xz, yy, yz, zz = q, 0.0, 0.0, q, 0.0, q
    if peak > 0.0:
        for i in range(_WHEELS):
            n = 3 * (_WHEELS * k + i)
            a, b, c = rows[n], rows[n + 1], rows[n + 2]
            s = (a * x[0] + b * x[1] + c * x[2] + bias[i]) / size
            s2 = s * s
            s4 = s2 * s2
            s14 = s4 * s4 * s4 * s2
            first = POWER * peak / size * s14 * s
            second = POWER * (POWER - 1.0) * peak / (size * size) * s14
            gx, gy, gz = gx + first * a, gy + first * b, gz + first * c
            xx, xy, xz = xx + second * a * a, xy + second * a * b, xz + second * a * c
            yy, yz, zz = yy + second * b * b, yz + second * b * c, zz + second * c * c
    return (gx, gy, gz), (xx, xy, xz, xy, yy, yz, xz, yz, zz)


def held(
    count: int,
    x0: Vec3,
    first: Table,
    dt: Table,
    drift: Table,
    effect: Table,
    price: float,
    most: Vec3,
    rows: Table,
    bias: Table,
    q: float,
    peak: float,
    size: float,
) -> tuple[Table, Vec3, Table, int, bool]:
    """Plan over `count` intervals from X = x0, beginning with the plan `first`.

    dt; drift: D, three an interval; effect: g, COILS vectors an interval; price, most:
    r and u_max; rows: a, four vectors an interval; bias: b. Returns u, the costate of
    the first interval (dJ / dX_1), the course X_1 .. X_count, the number of steps, and
    whether J converged.
    """
    u = [0.0] * (COILS * HELD)
    new = [0.0] * (COILS * HELD)
    free = [0.0] * (COILS * HELD)
    course = [0.0] * (3 * HELD)
    ahead = [0.0] * (3 * HELD)
    back = [0.0] * (24 * HELD)
    cost = 0.0
    x = x0
    for k in range(count):
        nx, ny, nz = (
            x[0] + drift[3 * k],
            x[1] + drift[3 * k + 1],
            x[2] + drift[3 * k + 2],
        )
        for j in range(COILS):
            i = COILS * k + j
            v = min(max(first[i], -most[j]), most[j])
            u[i] = v
            a, b, c = effect[3 * i], effect[3 * i + 1], effect[3 * i + 2]
            nx, ny, nz = nx + a * v, ny + b * v, nz + c * v
            cost += dt[k] * (0.5 * price * v * v)
        x = (nx, ny, nz)
        course[3 * k], course[3 * k + 1], course[3 * k + 2] = x
        cost += dt[k] * path_cost(x, k, rows, bias, q, peak, size)
    steps, settled = 0, False
    while steps < STEPS and not settled:
        steps += 1
        # backward: V_k = X' P X / 2 + p X of the change of X; `tied` is the gradient of
        # J by X
        p: Mat33 = NOTHING
        tied, value = ZERO, ZERO
        for back_k in range(count):
            k = count - 1 - back_k
            here = (course[3 * k], course[3 * k + 1], course[3 * k + 2])
            slope, curve = path_slope(here, k, rows, bias, q, peak, size)
            t = dt[k]
            tied = (
                tied[0] + t * slope[0],
                tied[1] + t * slope[1],
                tied[2] + t * slope[2],
            )
            m = (
                value[0] + t * slope[0],
                value[1] + t * slope[1],
                value[2] + t * slope[2],
            )
            big: Mat33 = (
                p[0] + t * curve[0],
                p[1] + t * curve[1],
                p[2] + t * curve[2],
                p[3] + t * curve[3],
                p[4] + t * curve[4],
                p[5] + t * curve[5],
                p[6] + t * curve[6],
                p[7] + t * curve[7],
                p[8] + t * curve[8],
            )
            sxx, sxy, sxz, syy, syz, szz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            bx, by, bz = 0.0, 0.0, 0.0
            for j in range(COILS):
                i = COILS * k + j
                free[i] = 0.0
                limit = most[j]
                if limit > 0.0:
                    a, b, c = effect[3 * i], effect[3 * i + 1], effect[3 * i + 2]
                    pull = a * tied[0] + b * tied[1] + c * tied[2] + t * price * u[i]
                    if not (abs(u[i]) >= limit and u[i] * pull < 0.0):
                        free[i] = 1.0
                        w = 1.0 / (t * price)
                        bx, by, bz = bx + a * u[i], by + b * u[i], bz + c * u[i]
                        sxx, sxy, sxz = (
                            sxx + w * a * a,
                            sxy + w * a * b,
                            sxz + w * a * c,
                        )
                        syy, syz, szz = (
                            syy + w * b * b,
                            syz + w * b * c,
                            szz + w * c * c,
                        )
            s: Mat33 = (sxx, sxy, sxz, sxy, syy, syz, sxz, syz, szz)
            # With M = L L' and Z = (1 + L'S L)^-1, (1 + S M)^-1 = L'^-1 Z L', and so on.
            # This form keeps precision in the directions in which M is small.
            low = root(big)
            up = inverse_of_lower(low)
            held_back = multiply(transposed(low), multiply(s, low))
            z = inverse_of_lower(
                root(
                    (
                        1.0 + held_back[0],
                        held_back[1],
                        held_back[2],
                        held_back[3],
                        1.0 + held_back[4],
                        held_back[5],
                        held_back[6],
                        held_back[7],
                        1.0 + held_back[8],
                    )
                )
            )
            zl = multiply(z, transposed(low))
            shrink = multiply(transposed(multiply(z, up)), zl)
            p = multiply(transposed(zl), zl)
            at, off = mat_vec(s, m), (bx, by, bz)
            y = (at[0] + bx, at[1] + by, at[2] + bz)
            n = 24 * k
            for i in range(9):
                back[n + i] = big[i]
                back[n + 9 + i] = shrink[i]
            for i in range(3):
                back[n + 18 + i] = m[i]
                back[n + 21 + i] = y[i]
            kept, lost = mat_t_vec(shrink, m), mat_vec(p, off)
            value = (kept[0] - lost[0], kept[1] - lost[1], kept[2] - lost[2])
        share, better, flat = 1.0, False, False
        for _ in range(_HALVINGS):
            trial = 0.0
            x = x0
            dx, dy, dz = 0.0, 0.0, 0.0
            for k in range(count):
                n = 24 * k
                t = dt[k]
                vx = dx - share * back[n + 21]
                vy = dy - share * back[n + 22]
                vz = dz - share * back[n + 23]
                ex = back[n + 9] * vx + back[n + 10] * vy + back[n + 11] * vz
                ey = back[n + 12] * vx + back[n + 13] * vy + back[n + 14] * vz
                ez = back[n + 15] * vx + back[n + 16] * vy + back[n + 17] * vz
                lx = (
                    back[n] * ex
                    + back[n + 1] * ey
                    + back[n + 2] * ez
                    + share * back[n + 18]
                )
                ly = (
                    back[n + 3] * ex
                    + back[n + 4] * ey
                    + back[n + 5] * ez
                    + share * back[n + 19]
                )
                lz = (
                    back[n + 6] * ex
                    + back[n + 7] * ey
                    + back[n + 8] * ez
                    + share * back[n + 20]
                )
                nx, ny, nz = (
                    x[0] + drift[3 * k],
                    x[1] + drift[3 * k + 1],
                    x[2] + drift[3 * k + 2],
                )
                for j in range(COILS):
                    i = COILS * k + j
                    v = u[i]
                    a, b, c = effect[3 * i], effect[3 * i + 1], effect[3 * i + 2]
                    if free[i] != 0.0:
                        v -= share * v + (a * lx + b * ly + c * lz) / (t * price)
                        v = min(max(v, -most[j]), most[j])
                    new[i] = v
                    if v != 0.0:
                        nx, ny, nz = nx + a * v, ny + b * v, nz + c * v
                        trial += t * (0.5 * price * v * v)
                x = (nx, ny, nz)
                ahead[3 * k], ahead[3 * k + 1], ahead[3 * k + 2] = x
                dx, dy, dz = (
                    nx - course[3 * k],
                    ny - course[3 * k + 1],
                    nz - course[3 * k + 2],
                )
                trial += t * path_cost(x, k, rows, bias, q, peak, size)
            if trial < cost:
                better = True
                break
            flat = flat or trial - cost <= SETTLED * SETTLED * cost
            share *= 0.5
        if not better:
            settled = flat
            break
        settled = cost - trial <= SETTLED * cost
        cost = trial
        for i in range(COILS * count):
            u[i] = new[i]
        for i in range(3 * count):
            course[i] = ahead[i]
    tied = ZERO
    for back_k in range(count):
        k = count - 1 - back_k
        here = (course[3 * k], course[3 * k + 1], course[3 * k + 2])
        slope, _ = path_slope(here, k, rows, bias, q, peak, size)
        tied = (
            tied[0] + dt[k] * slope[0],
            tied[1] + dt[k] * slope[1],
            tied[2] + dt[k] * slope[2],
        )
    return tuple(u), tied, tuple(course), steps, settled


def emptied(
    count: int,
    rest: Vec3,
    effect: Table,
    price: float,
    limits: Vec3,
    fee: Table,
    most: Table,
    weight: float,
    near: float,
    stride: float,
) -> tuple[Table, int, bool]:
    """Plan over `count` intervals that lead X_0 + sum D = `rest` (N m s) to zero.

    effect: g, ACTUATORS vectors an interval, coils first; price: r of a second, and of
    a coil's whole dipole, which is one of `limits`; fee, most: c and u_max of
    thrusters, one for each interval; weight: W; near (N m s): tolerance between the end
    and the one that W implies; stride: limit of the costate's change in a step. Returns
    u, the number of steps, and whether it converged to that tolerance.
    """
    u = [0.0] * (ACTUATORS * INTERVALS)
    best = [0.0] * (ACTUATORS * INTERVALS)
    costate = ZERO
    steps, settled = 0, False
    for stage in _STAGES:
        share, settled = 1.0, False
        step = ZERO
        value = -inf
        for _ in range(TRIALS):
            steps += 1
            tried = add(costate, scale(share, step))
            total = dot(tried, rest) - 0.5 / weight * dot(tried, tried)
            gx, gy, gz = sub(rest, scale(1.0 / weight, tried))
            sxx, sxy, sxz, syy, syz, szz = (
                1.0 / weight,
                0.0,
                0.0,
                1.0 / weight,
                0.0,
                1.0 / weight,
            )
            for i in range(ACTUATORS * count):
                a, b, c = effect[3 * i], effect[3 * i + 1], effect[3 * i + 2]
                pull = a * tried[0] + b * tried[1] + c * tried[2]
                k, j = i // ACTUATORS, i % ACTUATORS
                limit = limits[j] if j < COILS else most[k]
                unit = max(limit * limit, 1e-12) if j < COILS else 1.0
                beyond, r = (
                    abs(pull) - (0.0 if j < COILS else fee[k]),
                    stage * (price / unit),
                )
                v = 0.0
                if beyond > 0.0 and limit > 0.0:
                    v = beyond / r
                    if v < limit:
                        sxx, sxy, sxz = (
                            sxx + a * a / r,
                            sxy + a * b / r,
                            sxz + a * c / r,
                        )
                        syy, syz, szz = (
                            syy + b * b / r,
                            syz + b * c / r,
                            szz + c * c / r,
                        )
                    v = min(v, limit)
                    total += 0.5 * r * v * v - beyond * v
                    v = -v if pull > 0.0 else v
                    gx, gy, gz = gx + a * v, gy + b * v, gz + c * v
                u[i] = v
            if total < value:
                # beyond the maximum
                share *= 0.5
                if share < 1e-9:
                    settled = True
                    break
                continue
            costate, value, share = tried, total, 1.0
            for i in range(ACTUATORS * count):
                best[i] = u[i]
            if gx * gx + gy * gy + gz * gz <= near * near:
                settled = True
                break
            up = inverse_of_lower(root((sxx, sxy, sxz, sxy, syy, syz, sxz, syz, szz)))
            step = mat_t_vec(up, mat_vec(up, (gx, gy, gz)))
            # limited, as only the slope is known where no actuator is free
            step = scale(min(1.0, stride / max(norm(step), 1e-300)), step)
    return tuple(best), steps, settled


def largest(count: int, course: Table, rows: Table, bias: Table) -> float:
    """Find the largest momentum of a wheel (N m s) on a course."""
    most = 0.0
    for k in range(count):
        for i in range(_WHEELS):
            n = 3 * (_WHEELS * k + i)
            h = bias[i] + rows[n] * course[3 * k] + rows[n + 1] * course[3 * k + 1]
            most = max(most, abs(h + rows[n + 2] * course[3 * k + 2]))
    return most
