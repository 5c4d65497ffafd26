"""The day of paper 004 as one loop over numpy arrays, to be held beside the FMUs.

What one writes without components: the model of `integrated/mil-nadir` (sensors with
noise, nadir guidance, PID, integrated manager, wheels with lag and compensated
friction, lagging coils, rigid body with gravity gradient, dipole, drag and radiation)
in one function, vectors as numpy arrays, at the same steps and with the same equations.
It exists twice: with numpy's own `cross` and matrix products (`Plain`), and with these
few written out in floats (`Tuned`), as one does after profiling; then not much of numpy
is left in it. Orbit, field, Sun and density are asked of the same plain-float code that
the environment's FMU has inside; so only what is on board and the craft are numpy.
Noise is numpy's own, so runs agree where all noise is off (`compare`).
"""

from __future__ import annotations

from math import ceil, exp, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desat.components.blocks.environment_kepler import EnvironmentKepler
from desat.components.maths.moments import lag as lag_moments
from desat.components.physics.orbit import EARTH_RATE, MU
from desat.components.physics.torques import SOLAR_PRESSURE
from desat.runs.run import Options, execute, prepare
from desat.system.model import table

Array = NDArray[np.float64]
SCENARIO = "integrated/mil-nadir"
NOISE_OFF = (
    "determination.markov_sigma",
    "gyro.noise",
    "magnetometer.noise",
    "tachometers.noise",
    "wheels.unbalance",
)


def values(sets: list[str]) -> dict[str, dict[str, Any]]:
    """The scenario's parameters as numbers and arrays."""
    system, _ = prepare(SCENARIO, Options(sets=sets, blocks=True)).or_raise()
    found: dict[str, dict[str, Any]] = {}
    for component, entries in table(system.components.values()).items():
        inputs = {name: e.value for name, e in entries.items()}
        found[component] = {
            n: np.array(v) if isinstance(v, list) and not isinstance(v[0], str) else v
            for n, v in inputs.items()
        }
    found["run"] = {"step": system.step}
    return found


# --- vectors --------------------------------------------------------------------------


class Plain:
    """What one writes first."""

    @staticmethod
    def cross(a: Array, b: Array) -> Array:
        """a x b"""
        return np.asarray(np.cross(a, b))

    @staticmethod
    def matrix(q: Array) -> Array:
        """C(q): body from eci."""
        v, w = q[:3], q[3]
        skew = np.array(((0.0, -v[2], v[1]), (v[2], 0.0, -v[0]), (-v[1], v[0], 0.0)))
        return np.asarray(
            (w * w - v @ v) * np.eye(3) + 2.0 * np.outer(v, v) - 2.0 * w * skew
        )

    @staticmethod
    def product(a: Array, b: Array) -> Array:
        """a (x) b: first b, then a."""
        v = a[3] * b[:3] + b[3] * a[:3] - np.cross(a[:3], b[:3])
        return np.append(v, a[3] * b[3] - a[:3] @ b[:3])


class Tuned(Plain):
    """The same, written out in floats."""

    @staticmethod
    def cross(a: Array, b: Array) -> Array:
        ax, ay, az = a.tolist()
        bx, by, bz = b.tolist()
        return np.array((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx))

    @staticmethod
    def matrix(q: Array) -> Array:
        x, y, z, w = q.tolist()
        return np.array(
            (
                (
                    x * x - y * y - z * z + w * w,
                    2 * (x * y + z * w),
                    2 * (x * z - y * w),
                ),
                (
                    2 * (x * y - z * w),
                    -x * x + y * y - z * z + w * w,
                    2 * (y * z + x * w),
                ),
                (
                    2 * (x * z + y * w),
                    2 * (y * z - x * w),
                    -x * x - y * y + z * z + w * w,
                ),
            )
        )

    @staticmethod
    def product(a: Array, b: Array) -> Array:
        a1, a2, a3, a4 = a.tolist()
        b1, b2, b3, b4 = b.tolist()
        return np.array(
            (
                a4 * b1 + a3 * b2 - a2 * b3 + a1 * b4,
                -a3 * b1 + a4 * b2 + a1 * b3 + a2 * b4,
                a2 * b1 - a1 * b2 + a4 * b3 + a3 * b4,
                -a1 * b1 - a2 * b2 - a3 * b3 + a4 * b4,
            )
        )


def turned(ops: type[Plain], q: Array, angle: Array) -> Array:
    """q turned by a rotation vector in body axes."""
    size = sqrt(angle @ angle)
    if size == 0.0:
        return q
    step = np.append(angle * (np.sin(0.5 * size) / size), np.cos(0.5 * size))
    new = ops.product(step, q)
    return new / sqrt(new @ new)


def from_matrix(c: Array) -> Array:
    """The quaternion of a rotation matrix, scalar not negative."""
    trace = c[0, 0] + c[1, 1] + c[2, 2]
    k = int(np.argmax((c[0, 0], c[1, 1], c[2, 2], trace)))
    if k == 3:
        q = np.array(
            (c[1, 2] - c[2, 1], c[2, 0] - c[0, 2], c[0, 1] - c[1, 0], 1.0 + trace)
        )
    else:
        i, j = (k + 1) % 3, (k + 2) % 3
        q = np.zeros(4)
        q[k] = 1.0 + c[k, k] - c[i, i] - c[j, j]
        q[i], q[j] = c[k, i] + c[i, k], c[k, j] + c[j, k]
        q[3] = c[i, j] - c[j, i]
    q = q / sqrt(q @ q)
    return q if q[3] >= 0.0 else -q


# --- the loop -------------------------------------------------------------------------


def run(
    steps: int,
    sets: list[str],
    every: int = 0,
    ops: type[Plain] = Plain,
    nutation: float = 0.25,
) -> dict[str, Array]:
    """So many steps from the scenario's start: attitude and wheel momentum at the end,
    and with `every` at every n-th step (`q`, `h`: rows). A substep turns at most
    `nutation` (rad)."""
    cross, matrix, product = ops.cross, ops.matrix, ops.product
    p = values(sets)
    dt = float(p["run"]["step"])
    environment = _environment(p["environment"])
    axes = p["wheels"]["axes_wheel"].reshape(3, 4)
    spin = p["wheels"]["inertia_wheel"]
    to_wheels = np.linalg.pinv(axes)
    inertia = p["spacecraft"]["inertia"].reshape(3, 3)
    carrier = inertia - (axes * spin) @ axes.T
    inverse = np.linalg.inv(carrier)
    stiffest = np.abs(inverse).sum(axis=1).max()

    craft, wheel, coil = p["spacecraft"], p["wheels"], p["torquers"]
    control, manage = p["controller"], p["manager"]
    sigma_q, tau_q = (
        p["determination"]["markov_sigma"],
        p["determination"]["correlation_time"],
    )
    sigma_w, sigma_b = p["gyro"]["noise"], p["magnetometer"]["noise"]
    sigma_h = p["tachometers"]["noise"]
    gains = control["gain_matrix"].reshape(3, 3)
    decay = exp(-dt / tau_q)
    random = np.random.default_rng(1)

    q = craft["q_start_bi"] / np.linalg.norm(craft["q_start_bi"])
    h = wheel["h_start_wheel"].astype(float)
    momentum = matrix(q).T @ (carrier @ craft["omega_start_body"] + axes @ h)
    motor, learnt, dipole = np.zeros(4), np.zeros(4), np.zeros(3)
    rates_before = axes.T @ craft["omega_start_body"]
    spinning = False
    markov = sigma_q * random.standard_normal(3)
    xi, q_ref = np.zeros(3), np.array((0.0, 0.0, 0.0, 1.0))
    unloading, emergency = np.zeros(4, bool), False
    on, off, capacity = (
        manage["threshold_on"],
        manage["threshold_off"],
        manage["h_limit"],
    )
    jitter, jitter_noise, second = np.zeros(3), np.zeros((4, 3)), -1
    kept_q, kept_h = [q], [h]

    for k in range(steps):
        t = k * dt
        environment.output(t)
        r, v = np.array(environment.r_eci), np.array(environment.v_eci)
        b, b1, b2 = (
            np.array(x)
            for x in (
                environment.b_eci,
                environment.b_rate_eci,
                environment.b_accel_eci,
            )
        )
        c = matrix(q)
        omega = inverse @ (c @ momentum - axes @ h)

        # sensors
        if k:
            markov = decay * markov + sigma_q * sqrt(
                1.0 - decay**2
            ) * random.standard_normal(3)
        q_meas = turned(ops, q, markov)
        omega_meas = omega + sigma_w * random.standard_normal(3)
        b_meas = c @ b + sigma_b * random.standard_normal(3)
        h_meas = h + sigma_h * random.standard_normal(4)

        # the guidance is the lvlh frame
        z = -r / sqrt(r @ r)
        across = cross(r, v)
        y = -across / sqrt(across @ across)
        reference = from_matrix(np.array((cross(y, z), y, z)))
        q_ref = reference if reference @ q_ref >= 0.0 else -reference
        omega_ref = np.array((0.0, -sqrt(across @ across) / (r @ r), 0.0))

        # PID
        error = product(q_meas, q_ref * (-1.0, -1.0, -1.0, 1.0))
        e = error[:3] if error[3] >= 0.0 else -error[:3]
        d_omega = omega_meas - matrix(error) @ omega_ref
        grown = np.clip(
            xi + dt * e, -control["integral_limit"], control["integral_limit"]
        )
        limit = control["torque_limit"]

        def pid(
            xi: Array, e: Array = e, d_omega: Array = d_omega, limit: float = limit
        ) -> tuple[Array, bool]:
            expected = -gains @ (
                control["kp"] * e + control["kd"] * d_omega + control["ki"] * xi
            )
            cut = np.clip(expected, -limit, limit)
            return cut, bool((cut != expected).any())

        tau, was_cut = pid(grown)
        if was_cut:
            grown = np.where(np.abs(grown) < np.abs(xi), grown, xi)
            tau, _ = pid(grown)
        xi = grown

        # manager
        largest = np.abs(h_meas).max()
        emergency = largest >= manage["emergency_on"] * capacity or (
            emergency and largest >= manage["emergency_off"] * capacity
        )
        size = np.abs(h_meas)
        unloading = (size >= on * capacity) | (unloading & (size >= off * capacity))
        counted = h_meas if emergency else h_meas * unloading
        gain = manage["gain_emergency"] if emergency else manage["gain"]
        field2 = b_meas @ b_meas
        most = manage["m_limit"] * sqrt(field2) if emergency else manage["torque_limit"]
        t_des = (-gain / field2) * cross(cross(b_meas, axes @ counted), b_meas)
        size_des = sqrt(t_des @ t_des)
        if size_des > most:
            t_des = t_des * (most / size_des)
        share = 0.0 if emergency else manage["magnetic_share"]
        m_cmd = cross(b_meas, t_des if emergency else share * tau) / field2
        over = np.abs(m_cmd).max()
        if over > manage["m_limit"]:
            m_cmd = m_cmd * (manage["m_limit"] / over)
        gyroscopic = cross(omega_meas, axes @ h_meas)
        command = to_wheels @ (t_des - (1.0 - share) * tau - gyroscopic)

        # coils: first-order lag towards the command
        m_cmd = np.clip(m_cmd, -coil["m_limit"], coil["m_limit"])
        mean, slope, end = lag_moments(dt / coil["lag"])
        gap = dipole - m_cmd
        m_mean, m_slope, dipole = m_cmd + mean * gap, slope * gap, m_cmd + end * gap

        # wheels
        rates = axes.T @ omega
        then = rates + (rates - rates_before) if spinning else rates
        rates_before, spinning = rates, True
        if wheel["unbalance"] > 0.0:
            if int(t + 1e-6) != second:
                second, jitter_noise = int(t + 1e-6), random.standard_normal((4, 3))
            forces = wheel["unbalance"] * (h / spin - rates) ** 2
            jitter = sum(
                f * cross(a, n)
                for f, a, n in zip(forces, axes.T, jitter_noise, strict=True)
            )
        command = np.clip(command, -wheel["torque_limit"], wheel["torque_limit"])
        h_new, motor, learnt, integral = _wheels(
            wheel, spin, h, motor, learnt, command, rates, then, dt
        )
        tau_mean = (h_new - h) / dt
        tau_slope = 12.0 * ((h_new - integral / dt) / dt - 0.5 * tau_mean)

        # body: attitude and inertial momentum by RK4
        spin_rate = sqrt(omega @ omega)
        n = max(
            1,
            ceil(spin_rate * dt / 0.025),
            ceil(sqrt(momentum @ momentum) * stiffest * dt / nutation),
        )
        w0 = axes @ h
        w2 = 0.5 * dt * (axes @ tau_slope)
        w1 = dt * (axes @ tau_mean) - w2
        residual = craft["residual_dipole_body"] + m_mean
        wind = v - cross(np.array((0.0, 0.0, EARTH_RATE)), r)
        fall = -0.5 * MU / (r @ r) ** 1.5
        sun = np.array(environment.sun_eci)
        pressure = environment.sunlight * SOLAR_PRESSURE * craft["area_radiation"]
        density = environment.density * craft["drag_coefficient"] * craft["area_drag"]
        de = 1.0 / n

        def slopes(
            s: float,
            q: Array,
            momentum: Array,
            outer: Array,
            w0: Array = w0,
            w1: Array = w1,
            w2: Array = w2,
            b: Array = b,
            b1: Array = b1,
            b2: Array = b2,
            r: Array = r,
            v: Array = v,
            fall: float = fall,
            residual: Array = residual,
            m_slope: Array = m_slope,
        ) -> tuple[Array, Array]:
            c = matrix(q)
            omega = inverse @ (c @ momentum - (w0 + s * (w1 + s * w2)))
            x = s * dt
            torque = outer + cross(
                residual + (s - 0.5) * m_slope, c @ (b + x * (b1 + 0.5 * x * b2))
            )
            place = c @ ((1.0 + fall * x * x) * r + x * v)
            far = sqrt(place @ place)
            torque = torque + 3.0 * MU / far**5 * cross(place, inertia @ place)
            wx, wy, wz = (0.5 * omega).tolist()
            q1, q2, q3, q4 = q.tolist()
            return np.array(
                (
                    wz * q2 - wy * q3 + wx * q4,
                    -wz * q1 + wx * q3 + wy * q4,
                    wy * q1 - wx * q2 + wz * q4,
                    -wx * q1 - wy * q2 - wz * q3,
                )
            ), c.T @ torque

        for i in range(n):
            s, step = i * de, de * dt
            c_half = matrix(turned(ops, q, 0.5 * step * omega))
            flow = c_half @ wind
            outer = jitter + craft["tau_disturbance_body"]
            outer = outer + cross(
                craft["centre_drag_body"], -0.5 * density * sqrt(flow @ flow) * flow
            )
            outer = outer + cross(
                craft["centre_radiation_body"], -pressure * (c_half @ sun)
            )
            q1, p1 = slopes(s, q, momentum, outer)
            q2, p2 = slopes(
                s + 0.5 * de, q + 0.5 * step * q1, momentum + 0.5 * step * p1, outer
            )
            q3, p3 = slopes(
                s + 0.5 * de, q + 0.5 * step * q2, momentum + 0.5 * step * p2, outer
            )
            q4, p4 = slopes(s + de, q + step * q3, momentum + step * p3, outer)
            q = q + step / 6.0 * (q1 + 2.0 * (q2 + q3) + q4)
            momentum = momentum + step / 6.0 * (p1 + 2.0 * (p2 + p3) + p4)
        q = q / sqrt(q @ q)
        h = h_new
        environment.advance(t, dt)
        if every and (k + 1) % every == 0:
            kept_q.append(q)
            kept_h.append(h)
    return {"q": np.array(kept_q), "h": np.array(kept_h), "q_end": q, "h_end": h}


def _losses(
    wheel: dict[str, Any],
    spin: Array,
    omega: Array,
    x0: Array,
    drives: tuple[Array, Array],
    pushes: tuple[Array, Array],
    part: float,
) -> tuple[Array, Array]:
    """Momentum lost to friction in a part (s) at speed omega, and its integral.

    x0: friction that is not learnt. drives: torque of the command and the motor's excess
    at the start; pushes: momentum of both in the part, and its integral.
    """
    coulomb, eps, loop = (
        wheel["coulomb"],
        wheel["friction_speed"],
        wheel["compensation"],
    )
    lag = wheel["motor_lag"]
    middle = omega + 0.5 * (pushes[0] - x0 * part / (1.0 + loop * part)) / spin
    bend = wheel["viscous"] + coulomb / eps * (1.0 - np.tanh(middle / eps) ** 2)
    a = bend / spin
    k = a + loop
    rest = np.exp(-k * part)
    x = x0 * rest + a * drives[0] * (1.0 - rest) / k
    x += a * drives[1] * (exp(-part / lag) - rest) / (k - 1.0 / lag)
    loss = (x0 - x + a * pushes[0]) / k
    return loss, (x0 * part - loss + a * pushes[1]) / k


def _wheels(
    wheel: dict[str, Any],
    spin: Array,
    h: Array,
    motor: Array,
    learnt: Array,
    command: Array,
    rate0: Array,
    rate1: Array,
    dt: float,
) -> tuple[Array, Array, Array, Array]:
    """Momentum, motor torque, learnt friction after a step, and the integral of the
    momentum."""
    lag, viscous, coulomb = wheel["motor_lag"], wheel["viscous"], wheel["coulomb"]
    eps, loop = wheel["friction_speed"], wheel["compensation"]
    limit = spin * wheel["speed_limit"]

    def drag(omega: Array) -> Array:
        return np.asarray(viscous * omega + coulomb * np.tanh(omega / eps))

    gained = np.maximum(np.abs(motor), np.abs(command)) * dt / spin
    turning = np.abs(h / spin - rate0) < 8.0 * eps + gained
    unknown = np.abs(drag(h / spin - rate0) - learnt) * dt / spin
    parts = turning * (gained + unknown) / (0.05 * eps)
    n = int(min(max(1, ceil(parts.max())), 64))
    part, rate, slope = dt / n, rate0, (rate1 - rate0) / dt
    after = exp(-part / lag)
    total = np.zeros(4)
    for i in range(n):
        rate = rate0 + slope * i * part
        excess = (motor - command) * lag
        pushed = command * part + excess * (1.0 - after)
        motor_part = 0.5 * command * part**2 + excess * (part - lag * (1.0 - after))
        by_body = spin * slope
        loss, first = _losses(
            wheel,
            spin,
            h / spin - rate,
            drag(h / spin - rate) - learnt,
            (command - by_body, motor - command),
            (pushed - by_body * part, motor_part - 0.5 * by_body * part**2),
            part,
        )
        new = h + pushed - loss
        integral = h * part + motor_part - first
        stopped = np.abs(new) > limit
        if stopped.any():
            edge = np.copysign(limit, new)
            gone = np.where(new != h, new - h, 1.0)
            share = np.clip(np.where(new != h, (edge - h) / gone, 0.0), 0.0, 1.0)
            at_edge = part * (share * 0.5 * (h + edge) + (1.0 - share) * edge)
            new, integral = (
                np.where(stopped, edge, new),
                np.where(stopped, at_edge, integral),
            )
        total = total + integral
        h, motor, learnt = (
            new,
            command + excess / lag * after,
            learnt + loop * loss,
        )
    return h, motor, learnt, total


def _environment(values: dict[str, Any]) -> EnvironmentKepler:
    block = EnvironmentKepler()
    for variable in block.variables:
        if variable.causality == "parameter":
            value = values[variable.name]
            if variable.choices:
                value = variable.choices.index(value)
            setattr(block, variable.name, tuple(value) if variable.shape else value)
    block.start()
    return block


def compare(seconds: float, nutation: float = 0.25) -> dict[str, dict[str, float]]:
    """The largest differences of runs without noise from that of the components:
    attitude (rad), wheel momentum (N m s). At `nutation` = 0.25 they are the truncation
    of the RK4 here: the craft's own integrator is of higher order."""
    sets = [f"{name}=0" for name in NOISE_OFF]
    ours = execute(SCENARIO, Options(sets=sets, stop=seconds, blocks=True)).results
    q, h = ours.values("spacecraft.q_bi"), ours.values("wheels.h_wheel")
    found = {}
    for ops in (Plain, Tuned):
        theirs = run(len(q) - 1, sets, every=1, ops=ops, nutation=nutation)
        sign = np.sign((q * theirs["q"]).sum(axis=1, keepdims=True))
        found[ops.__name__.lower()] = {
            "seconds": seconds,
            "attitude_rad": float(
                2.0 * np.linalg.norm(q - sign * theirs["q"], axis=1).max()
            ),
            "wheel_momentum": float(np.abs(h - theirs["h"]).max()),
        }
    return found
