"""One reaction wheel over a step: motor lag, friction, stiction, momentum limit.

The absolute axial momentum h (N m s) obeys

    h' = T - friction(Omega) + learnt        T' = (command - T) / lag
    friction = c_v Omega + c_c tanh(Omega / omega_eps)
    learnt' = compensation (friction - learnt)

with T the motor torque on the rotor (N m), Omega = h / J_s - g.omega the speed relative to the
body (rad/s), and `learnt` what a compensating speed loop has found of the friction.
"""

from __future__ import annotations

from math import ceil, exp, expm1, tanh

from ..maths.moments import lag as lag_moments

Motor = tuple[float, float, float, float, float, float, float]
"""J_s (kg m2), lag (s), c_v (N m s/rad), c_c (N m), omega_eps (rad/s), compensation (1/s),
stiction (N m)"""

Rotor = tuple[float, float, float]
"""The state: h (N m s), T (N m), learnt (N m)"""


SMALL_SPEED = 3e-8
"""A motor transient is not resolved where friction makes less of it (rad/s)."""


def friction(omega: float, viscous: float, coulomb: float, omega_eps: float) -> float:
    """The torque against the rotation (N m): c_v Omega + c_c tanh(Omega / omega_eps)."""
    return viscous * omega + coulomb * tanh(omega / omega_eps)


def step(
    motor: Motor, rotor: Rotor, command: float, rate0: float, rate1: float, dt: float, limit: float
) -> tuple[Rotor, float]:
    """The state after dt (s) with a held motor command (N m), and the integral of h (N m s2).

    The body's axial rate g.omega goes linearly from rate0 to rate1 (rad/s); |h| <= limit (N m s).
    The motor's exponential is integrated in closed form, friction beside it by RK4, or where a loop
    compensates it, with the loop's exponential.
    """
    _, lag, viscous, coulomb, _, _, stiction = motor
    if viscous == coulomb == stiction == 0.0:
        return _frictionless(lag, rotor, command, dt, limit)
    n = _parts(motor, rotor, command, rate0, dt)
    part, slope = dt / n, (rate1 - rate0) / dt
    total = 0.0
    for i in range(n):
        rate = rate0 + slope * i * part
        rotor, integral = _with_friction(motor, rotor, command, rate, slope, part, limit)
        total += integral
    return rotor, total


def _parts(motor: Motor, rotor: Rotor, command: float, rate: float, dt: float) -> int:
    """Into how many parts a step is cut so that friction is integrated well."""
    inertia, lag, viscous, coulomb, omega_eps, _, _ = motor
    h, torque, _ = rotor
    decay = viscous / inertia  # of the speed by friction, 1/s
    parts = 0.0
    gained = max(abs(torque), abs(command)) * dt / inertia
    if coulomb > 0.0 and abs(h / inertia - rate) < 8.0 * omega_eps + gained:
        # the sign of Coulomb friction may turn
        decay += coulomb / omega_eps / inertia
        parts = 2.0 * gained / omega_eps
    parts = max(parts, 10.0 * decay * dt)
    # where friction depends on the motor's transient
    swing = abs(torque - command) * lag / inertia
    if decay * swing * min(lag, dt) > SMALL_SPEED:
        parts = max(parts, 0.5 * dt / lag)
    return min(max(1, ceil(parts)), 64)


def _frictionless(
    lag: float, rotor: Rotor, command: float, dt: float, limit: float
) -> tuple[Rotor, float]:
    h0, torque, learnt = rotor
    if lag > 0.0:
        mean, slope, end = lag_moments(dt / lag)
        excess = torque - command
        gained, torque = dt * (command + excess * mean), command + excess * end
        first = 0.5 * command + excess * (slope / 12.0 + 0.5 * mean)  # int_0^1 s T ds
    else:
        gained, torque, first = dt * command, command, 0.5 * command
    h = h0 + gained
    if abs(h) > limit:
        return _stopped(h0, h, torque, learnt, dt, limit)
    return (h, torque, learnt), dt * (h - dt * first)


def _stopped(
    h0: float, h: float, torque: float, learnt: float, dt: float, limit: float
) -> tuple[Rotor, float]:
    """The wheel reaches +-limit within the step, along a straight line, and stays there."""
    end = limit if h > 0.0 else -limit
    share = min(max((end - h0) / (h - h0), 0.0), 1.0) if h != h0 else 0.0
    return (end, torque, learnt), dt * (share * 0.5 * (h0 + end) + (1.0 - share) * end)


def _with_friction(
    motor: Motor, rotor: Rotor, command: float, rate: float, slope: float, dt: float, limit: float
) -> tuple[Rotor, float]:
    j, lag, viscous, coulomb, omega_eps, c, stiction = motor
    h0, torque0, learnt = rotor
    pushed, torque, motor_part = command * dt, command, 0.5 * command * dt * dt
    excess = (torque0 - command) * lag  # of the motor over the command, in momentum
    if excess:
        decay = exp(-dt / lag)
        pushed += excess * (1.0 - decay)
        torque += excess / lag * decay
        motor_part += excess * (dt - lag * (1.0 - decay))
    omega = h0 / j - rate
    if stiction > 0.0 and abs(torque) <= stiction and abs(omega) <= omega_eps:
        h = j * (rate + slope * dt)  # held: the rotor turns with the body
        return (h, torque, 0.0), 0.5 * dt * (h0 + h)
    if c > 0.0:
        # A loop of bandwidth c (1/s) learns what friction takes: friction goes linearly from start
        # to end, the loop's exponential is exact. Written out, for most steps of a day are here.
        start = viscous * omega + coulomb * tanh(omega / omega_eps)
        x0 = start - learnt
        decayed = -expm1(-c * dt)
        omega = (h0 + pushed - x0 * decayed / c) / j - rate - slope * dt
        end = viscous * omega + coulomb * tanh(omega / omega_eps)
        steady = (end - start) / (c * dt)
        rest = x0 - steady
        lost = steady * dt + rest * decayed / c
        first = 0.5 * steady * dt * dt + rest / c * (dt - decayed / c)
        learnt = end - steady - rest * (1.0 - decayed)
    else:
        lost, first = _lost(motor, h0, excess, command, rate, slope, dt)
        learnt = 0.0
    h = h0 + pushed - lost
    if abs(h) > limit:
        return _stopped(h0, h, torque, learnt, dt, limit)
    return (h, torque, learnt), h0 * dt + motor_part - first


def _lost(
    motor: Motor, h0: float, excess: float, command: float, rate: float, slope: float, dt: float
) -> tuple[float, float]:
    """The momentum that friction takes (N m s) by RK4, and the integral of what it has taken."""
    j, lag, viscous, coulomb, omega_eps, _, _ = motor

    def drag(s: float, lost: float) -> float:
        """The friction at s into the step, with `lost` of the momentum lost so far."""
        pushed = command * s + (excess * (1.0 - exp(-s / lag)) if excess else 0.0)
        return friction((h0 + pushed - lost) / j - rate - slope * s, viscous, coulomb, omega_eps)

    half = 0.5 * dt
    a = drag(0.0, 0.0)
    b = drag(half, half * a)
    c = drag(half, half * b)
    d = drag(dt, dt * c)
    lost = dt / 6.0 * (a + 2.0 * (b + c) + d)
    return lost, dt * (0.5 * lost + dt * (a - d) / 12.0)  # by the Hermite cubic
