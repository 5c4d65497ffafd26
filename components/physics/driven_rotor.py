"""Integrate one reaction wheel over a step with its motor's curve and a table of drag.

The model extends that of `rotor`. A motor of the constant K_m (torque over the root of
the copper loss, N m / W^(1/2)) on a voltage that would turn it at Omega_0 without load
gives at the speed Omega, within +-torque limit,

    K_m^2 (-Omega_0 - Omega) <= drive <= K_m^2 (Omega_0 - Omega)

because its current is (voltage - k Omega) / R with k^2 / R = K_m^2 and voltage = k
Omega_0. The drag is linear between the entries of its table, is extrapolated from the
last two, and changes its sign as tanh(Omega / omega_eps). There is no stiction.

The motor's response to its command without curve and drag is in closed form. The
reduction by curve and drag is integrated by RK4 with step halving and doubling: two
half steps are compared with one whole step until they differ by less than SMALL_SPEED.
The corners of curve and table may therefore fall anywhere.

Source: the equations of a permanent-magnet motor, e.g. Hughes, Electric Motors and
Drives, ch. 3.
"""

from __future__ import annotations

from math import copysign, exp, tanh

from .rotor import (
    AT_LIMIT,
    CHANGES,
    HALVINGS,
    Axial,
    Motor,
    Rotor,
    at_limit,
    braking,
    driven,
    friction,
    motor_torque,
)

ENTRIES = 8
SMALL_SPEED = 1e-8  # rad/s: tolerance between two half steps and the whole
SHORTEST = 2.0**-24  # shortest piece, relative to the step
PIECES = 4096

Row = tuple[float, float, float, float, float, float, float, float]

# Omega_0 (rad/s; 0: any torque at any speed), K_m^2 (N m s/rad), number of entries of
# the drag table (0: none), their speeds (rad/s) and torques (N m)
Curve = tuple[float, float, int, Row, Row]

# h minus the momentum by the motor's response (N m s), learnt torque (N m), and the
# integral of the first (N m s2)
Moving = tuple[float, float, float]


def drag(motor: Motor, curve: Curve, omega: float) -> float:
    """Compute the drag torque (N m) against the rotation at the speed omega (rad/s)."""
    _, _, entries, speeds, torques = curve
    if entries == 0:
        return friction(omega, motor[2], motor[3], motor[4])
    speed, k = abs(omega), 1
    while k < entries - 1 and speed > speeds[k]:
        k += 1
    share = (speed - speeds[k - 1]) / (speeds[k] - speeds[k - 1])
    torque = torques[k - 1] + share * (torques[k] - torques[k - 1])
    return torque * tanh(omega / motor[4])


def limit_motor_torque(
    motor: Motor, curve: Curve, torque: float, omega: float
) -> float:
    """Limit a torque (N m) to what the motor can give at the speed omega (rad/s)."""
    no_load, slope, most = curve[0], curve[1], motor[7]
    if no_load > 0.0:
        torque = min(max(torque, slope * (-no_load - omega)), slope * (no_load - omega))
    return min(max(torque, -most), most)


def step(
    motor: Motor,
    curve: Curve,
    rotor: Rotor,
    command: float,
    rate0: float,
    rate1: float,
    dt: float,
    fastest: float,
) -> tuple[Rotor, float]:
    """Propagate the rotor over dt (s) with a held motor command (N m), as `rotor.step`.

    Returns the state after dt and the integral of h (N m s2).
    """
    change, rest, total = (rate1 - rate0) / dt, dt, 0.0
    for _ in range(CHANGES):
        axial = rate1 - change * rest, change
        rotor, duration, integral = _state(
            motor, curve, rotor, command, axial, rest, fastest
        )
        total += integral
        rest -= duration
        if rest <= 0.0:
            return rotor, total
    return rotor, total + rest * rotor[0]


def _state(
    motor: Motor,
    curve: Curve,
    rotor: Rotor,
    command: float,
    axial: Axial,
    dt: float,
    fastest: float,
) -> tuple[Rotor, float, float]:
    """Propagate the rotor until its present state ends, at most by dt (s).

    The states are moving, staying at the speed limit and braking. Returns the rotor,
    the elapsed time (s) and the integral of h (N m s2).
    """
    j = motor[0]
    h, torque, learnt, _ = rotor
    omega = h / j - axial[0]
    if abs(omega) > fastest * (1.0 + AT_LIMIT):
        return braking(motor, rotor, command, axial, dt, fastest)
    if abs(omega) >= fastest * (1.0 - AT_LIMIT):
        outwards = copysign(1.0, omega)
        balance = j * axial[1] + drag(motor, curve, omega)
        now = motor_torque(motor, torque, command, 0.0) + learnt
        if (limit_motor_torque(motor, curve, now, omega) - balance) * outwards > 0.0:
            return at_limit(
                motor, rotor, command, axial, dt, outwards * fastest, balance - learnt
            )
    return _moving(motor, curve, rotor, command, axial, dt, fastest)


def _moving(
    motor: Motor,
    curve: Curve,
    rotor: Rotor,
    command: float,
    axial: Axial,
    dt: float,
    fastest: float,
) -> tuple[Rotor, float, float]:
    """Propagate a moving rotor until it reaches its speed limit, at most by dt (s).

    Returns the rotor, the elapsed time (s) and the integral of h (N m s2).
    """
    torque = rotor[1]
    now: Moving = (rotor[0], rotor[2], 0.0)
    begin, size = 0.0, dt
    for _ in range(PIECES):
        size = min(size, dt - begin)
        after, error = _piece(motor, curve, torque, command, axial, begin, now, size)
        if error > SMALL_SPEED * motor[0] and size > SHORTEST * dt:
            size *= 0.5
            continue
        if _beyond(motor, torque, command, after, axial, begin + size, fastest):
            least, duration = 0.0, size
            for _ in range(HALVINGS):
                middle = 0.5 * (least + duration)
                trial, _ = _piece(
                    motor, curve, torque, command, axial, begin, now, middle
                )
                if _beyond(
                    motor, torque, command, trial, axial, begin + middle, fastest
                ):
                    duration = middle
                else:
                    least = middle
            after, _ = _piece(
                motor, curve, torque, command, axial, begin, now, duration
            )
            end = begin + duration
            (h, after_torque, learnt, way), integral = _there(
                motor, rotor, command, after, end
            )
            rate = axial[0] + axial[1] * end
            h = motor[0] * (copysign(fastest, h / motor[0] - rate) + rate)
            return (h, after_torque, learnt, way), end, integral
        now, begin = after, begin + size
        if begin >= dt:
            break
        if 64.0 * error < SMALL_SPEED * motor[0]:
            size *= 2.0
    rotor_after, total = _there(motor, rotor, command, now, begin)
    return rotor_after, begin, total


def _there(
    motor: Motor, rotor: Rotor, command: float, now: Moving, t: float
) -> tuple[Rotor, float]:
    """Return the rotor after t (s), and the integral of its h (N m s2)."""
    motor_momentum, first, torque, _ = driven(motor, rotor[1], command, t)
    return (now[0] + motor_momentum, torque, now[1], rotor[3]), now[2] + first


def _beyond(
    motor: Motor,
    torque: float,
    command: float,
    now: Moving,
    axial: Axial,
    t: float,
    fastest: float,
) -> bool:
    """Return whether the rotor is beyond its speed limit, t (s) after `axial`."""
    h = now[0] + driven(motor, torque, command, t)[0]
    return abs(h / motor[0] - axial[0] - axial[1] * t) > fastest * (1.0 + AT_LIMIT)


def _piece(
    motor: Motor,
    curve: Curve,
    torque: float,
    command: float,
    axial: Axial,
    begin: float,
    now: Moving,
    size: float,
) -> tuple[Moving, float]:
    """Integrate from `begin` (s) over `size` (s) and estimate the error (N m s).

    The state is that of two half steps, extrapolated with the whole step; the error is
    their difference.
    """
    half = 0.5 * size
    whole_step = _runge_kutta(motor, curve, torque, command, axial, begin, now, size)
    middle = _runge_kutta(motor, curve, torque, command, axial, begin, now, half)
    after = _runge_kutta(
        motor, curve, torque, command, axial, begin + half, middle, half
    )
    apart = after[0] - whole_step[0]
    return (
        after[0] + apart / 15.0,
        after[1] + (after[1] - whole_step[1]) / 15.0,
        after[2],
    ), abs(apart)


def _runge_kutta(
    motor: Motor,
    curve: Curve,
    torque: float,
    command: float,
    axial: Axial,
    begin: float,
    now: Moving,
    size: float,
) -> Moving:
    """Integrate one RK4 step of `size` (s) from `begin` (s).

    `now` is y (N m s), the momentum beyond that of the ideal motor torque; the learnt
    friction torque (N m); and the integral of y (N m s2).
    """
    j, lag, c, (rate, change) = motor[0], motor[1], motor[5], axial
    y, learnt, total = now
    excess = torque - command if lag > 0.0 else 0.0

    def changes(s: float, y: float, learnt: float) -> tuple[float, float]:
        """Compute y' (N m) and the derivative of the learnt torque (N m/s) at s (s)."""
        decay = exp(-s / lag) if excess else 0.0
        answer = command + excess * decay
        motor_momentum = command * s + excess * lag * (1.0 - decay)
        omega = (y + motor_momentum) / j - rate - change * s
        friction = drag(motor, curve, omega)
        drive = limit_motor_torque(motor, curve, answer + learnt, omega)
        return drive - answer - friction, c * (friction - learnt)

    half = 0.5 * size
    p, p2 = changes(begin, y, learnt)
    q, q2 = changes(begin + half, y + half * p, learnt + half * p2)
    r, r2 = changes(begin + half, y + half * q, learnt + half * q2)
    s, s2 = changes(begin + size, y + size * r, learnt + size * r2)
    momentum_gain = size / 6.0 * (p + 2.0 * (q + r) + s)
    total += size * (y + 0.5 * momentum_gain + size * (p - s) / 12.0)
    return y + momentum_gain, learnt + size / 6.0 * (p2 + 2.0 * (q2 + r2) + s2), total
