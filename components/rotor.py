"""One reaction wheel over a step: motor lag, friction, stiction, momentum limit.

The absolute axial momentum h (N m s) obeys

    h' = T - friction(Omega) + learnt        T' = (command - T) / lag
    friction = c_v Omega + c_c tanh(Omega / omega_eps)
    learnt' = compensation (friction - learnt)

with T the motor torque on the rotor (N m), Omega = h / J_s - g.omega the speed relative to the
body (rad/s), and `learnt` what a compensating speed loop has found of the friction.
"""

from __future__ import annotations

from math import ceil, exp, tanh

from .moments import lag as lag_moments

Motor = tuple[float, float, float, float, float, float, float]
"""J_s (kg m2), lag (s), c_v (N m s/rad), c_c (N m), omega_eps (rad/s), compensation (1/s),
stiction (N m)"""

Rotor = tuple[float, float, float]
"""The state: h (N m s), T (N m), learnt (N m)"""


def friction(omega: float, viscous: float, coulomb: float, omega_eps: float) -> float:
    """The torque against the rotation (N m): c_v Omega + c_c tanh(Omega / omega_eps)."""
    return viscous * omega + coulomb * tanh(omega / omega_eps)


def step(
    motor: Motor, rotor: Rotor, command: float, rate0: float, rate1: float, dt: float, limit: float
) -> tuple[Rotor, float]:
    """The state after dt (s) with a held motor command (N m), and the integral of h (N m s2).

    The body's axial rate g.omega goes linearly from rate0 to rate1 (rad/s); |h| <= limit (N m s).
    Without friction the motor's exponential is integrated in closed form; with friction by RK4
    beside the closed form.
    """
    _, lag, viscous, coulomb, _, _, stiction = motor
    if viscous == coulomb == stiction == 0.0:
        return _frictionless(lag, rotor, command, dt, limit)
    # the motor's transient must be resolved where friction depends on it
    n = min(max(1, ceil(dt / (2.0 * lag))), 64) if lag > 0.0 else 1
    part, slope = dt / n, (rate1 - rate0) / dt
    total = 0.0
    for i in range(n):
        rate = rate0 + slope * i * part
        rotor, integral = _with_friction(motor, rotor, command, rate, slope, part, limit)
        total += integral
    return rotor, total


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
    j, lag, viscous, coulomb, omega_eps, compensation, stiction = motor
    h0, torque0, learnt0 = rotor
    excess = (torque0 - command) * lag  # of the motor over the command, in momentum

    def pushed(s: float) -> float:
        """int_0^s T dt"""
        return command * s + (excess * (1.0 - exp(-s / lag)) if excess else 0.0)

    torque = command + (excess / lag * exp(-dt / lag) if excess else 0.0)
    omega = h0 / j - rate
    if stiction > 0.0 and abs(torque) <= stiction and abs(omega) <= omega_eps:
        h = j * (rate + slope * dt)  # held: the rotor turns with the body
        return (h, torque, 0.0), 0.5 * dt * (h0 + h)

    def loss(s: float, lost: float, learnt: float) -> tuple[float, float]:
        """What is lost, and learnt, per second at s into the step."""
        drag = friction((h0 + pushed(s) - lost) / j - rate - slope * s, viscous, coulomb, omega_eps)
        return drag - learnt, compensation * (drag - learnt)

    half = 0.5 * dt
    a1, b1 = loss(0.0, 0.0, learnt0)
    a2, b2 = loss(half, half * a1, learnt0 + half * b1)
    a3, b3 = loss(half, half * a2, learnt0 + half * b2)
    a4, b4 = loss(dt, dt * a3, learnt0 + dt * b3)
    lost = dt / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
    learnt = learnt0 + dt / 6.0 * (b1 + 2.0 * (b2 + b3) + b4)
    h = h0 + pushed(dt) - lost
    if abs(h) > limit:
        return _stopped(h0, h, torque, learnt, dt, limit)
    # the integral of h: the motor's part in closed form, the loss by its Hermite cubic
    motor_part = 0.5 * command * dt * dt
    if excess:
        motor_part += excess * (dt - lag * (1.0 - exp(-dt / lag)))
    return (h, torque, learnt), h0 * dt + motor_part - dt * (0.5 * lost + dt * (a1 - a4) / 12.0)
