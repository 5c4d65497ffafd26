"""Integrate one reaction wheel over a step: lag, friction, stiction, speed limit.

The absolute axial momentum h (N m s) of a moving rotor obeys

    h' = drive - friction(Omega)             drive = T + learnt, within +-torque limit
    T' = (command - T) / lag                 learnt' = compensation (friction - learnt)
    friction = c_v Omega + c_c tanh(Omega / omega_eps)

with T the motor's response to its command (N m), Omega = h / J_s - g.omega the speed
relative to the body (rad/s), and `learnt` the friction that a compensating speed loop
has estimated.

In two other states Omega is constant, and so h' = J_s (g.omega)'. With stiction, Coulomb
friction is dry, +-c_c, and brings a rotor to rest in a finite time; from then on it
*stands* as long as |T - J_s (g.omega)'| <= stiction. *At its speed limit* a rotor stays
until its torque points inwards. A step is divided where the state changes, so that its
impulse does not depend on its length.
"""

from __future__ import annotations

from math import ceil, copysign, exp, inf, log, tanh

from ..maths.moments import lag as lag_moments

# J_s (kg m2), lag (s), c_v (N m s/rad), c_c (N m), omega_eps (rad/s), compensation
# (1/s), stiction (N m), torque limit (N m)
Motor = tuple[float, float, float, float, float, float, float, float]

# h (N m s), T (N m), learnt (N m), and with stiction the direction of motion: 1, -1, or
# 0 at rest
Rotor = tuple[float, float, float, float]

# body's axial rate g.omega (rad/s), its constant derivative (rad/s2)
Axial = tuple[float, float]

# rad/s: a motor transient is not resolved where friction changes less by it
SMALL_SPEED = 3e-8
# Change of the speed in one part, relative to omega_eps, where friction is taken as
# linear in the speed: its impulse then errs by up to 1e-4 of Coulomb friction's.
CURVED = 0.05
# Maximum number of changes between moving, standing and the limit in a step; the rotor
# then moves on for the remainder.
CHANGES = 16
HALVINGS = 48  # bisections of a step, to find when a state ends
TURNS = 1e-9  # a time so short, relative to the step, counts as elapsed
AT_LIMIT = 1e-9  # a speed so near the limit, relative to it, is at the limit


def friction(omega: float, viscous: float, coulomb: float, omega_eps: float) -> float:
    """Compute the friction torque (N m) against the rotation.

    c_v Omega + c_c tanh(Omega / omega_eps).
    """
    return viscous * omega + coulomb * tanh(omega / omega_eps)


def step(
    motor: Motor,
    rotor: Rotor,
    command: float,
    rate0: float,
    rate1: float,
    dt: float,
    fastest: float,
) -> tuple[Rotor, float]:
    """Propagate the rotor over dt (s) with a held motor command (N m).

    Returns the state after dt and the integral of h (N m s2). The body's axial rate
    g.omega goes linearly from rate0 to rate1 (rad/s); |Omega| <= fastest (rad/s). A
    rotor that is faster brakes with the torque limit.
    """
    j, viscous, coulomb, stiction = motor[0], motor[2], motor[3], motor[6]
    # `_may_pass`, written out because most steps end here
    speed_change = max(abs(rotor[1]), abs(command)) * dt / j + abs(rate1 - rate0)
    if stiction == 0.0 and abs(rotor[0] / j - rate0) + speed_change <= fastest:
        if viscous == coulomb == 0.0:
            return _frictionless(motor, rotor, command, dt)
        return _free(motor, rotor, command, (rate0, (rate1 - rate0) / dt), dt)
    change, rest, total = (rate1 - rate0) / dt, dt, 0.0
    for _ in range(CHANGES):
        axial = rate1 - change * rest, change
        rotor, duration, integral = _state(motor, rotor, command, axial, rest, fastest)
        total += integral
        rest -= duration
        if rest <= 0.0:
            return rotor, total
    rotor, integral = _free(
        motor, rotor, command, (rate1 - change * rest, change), rest
    )
    return rotor, total + integral


def _may_pass(
    motor: Motor,
    rotor: Rotor,
    command: float,
    rate0: float,
    rate1: float,
    dt: float,
    fastest: float,
) -> bool:
    """Return whether the motor may take the rotor beyond its limit within dt (s)."""
    speed_change = max(abs(rotor[1]), abs(command)) * dt / motor[0] + abs(rate1 - rate0)
    return abs(rotor[0] / motor[0] - rate0) + speed_change > fastest


def _state(
    motor: Motor, rotor: Rotor, command: float, axial: Axial, dt: float, fastest: float
) -> tuple[Rotor, float, float]:
    """Propagate the rotor in its present state; results as of `_moving`."""
    j, _, _, _, _, _, stiction, _ = motor
    h, torque, learnt, way = rotor
    omega, turning = h / j - axial[0], j * axial[1]
    if stiction > 0.0 and way == 0.0:
        pull = motor_torque(motor, torque, command, 0.0) - turning
        if abs(pull) <= stiction:
            return _standing(motor, rotor, command, axial, dt)
        rotor = (h, torque, learnt, copysign(1.0, pull))
    if abs(omega) > fastest * (1.0 + AT_LIMIT):
        return braking(motor, rotor, command, axial, dt, fastest)
    if abs(omega) >= fastest * (1.0 - AT_LIMIT):
        outwards = copysign(1.0, omega)
        # motor torque that keeps the speed
        balance = turning + _drag(motor, omega, outwards) - learnt
        if (motor_torque(motor, torque, command, 0.0) - balance) * outwards > 0.0:
            return at_limit(
                motor, rotor, command, axial, dt, outwards * fastest, balance
            )
    return _moving(motor, rotor, command, axial, dt, fastest)


def motor_torque(motor: Motor, torque: float, command: float, t: float) -> float:
    """Compute T (N m) at t (s) after it was `torque`."""
    lag = motor[1]
    return command + (torque - command) * exp(-t / lag) if lag > 0.0 else command


def _reaches(motor: Motor, torque: float, command: float, level: float) -> float:
    """Compute when T reaches a level (N m) on its way from `torque` to the command.

    Time in s; inf: never.
    """
    lag, there, to_go = motor[1], level - command, torque - command
    on_its_way = lag > 0.0 and there * to_go > 0.0 and abs(there) <= abs(to_go)
    return lag * log(to_go / there) if on_its_way else inf


def _drag(motor: Motor, omega: float, way: float) -> float:
    """Compute the friction of a moving rotor (N m): dry where there is stiction."""
    _, _, viscous, coulomb, omega_eps, _, stiction, _ = motor
    if stiction > 0.0:
        return viscous * omega + coulomb * way
    return viscous * omega + coulomb * tanh(omega / omega_eps)


# --- states that keep the speed -------------------------------------------------------


def _standing(
    motor: Motor, rotor: Rotor, command: float, axial: Axial, dt: float
) -> tuple[Rotor, float, float]:
    """Propagate a rotor that turns with the body until the motor breaks it loose.

    Results as of `_moving`.
    """
    j, stiction = motor[0], motor[6]
    h0, torque, _, _ = rotor
    level = j * axial[1] + copysign(stiction, command - torque)
    duration = min(_reaches(motor, torque, command, level), dt)
    way = copysign(1.0, command - torque) if duration < dt else 0.0
    h = j * (axial[0] + axial[1] * duration)
    after = motor_torque(motor, torque, command, duration)
    return (h, after, 0.0, way), duration, 0.5 * duration * (h0 + h)


def at_limit(
    motor: Motor,
    rotor: Rotor,
    command: float,
    axial: Axial,
    dt: float,
    omega: float,
    balance: float,
) -> tuple[Rotor, float, float]:
    """Propagate a rotor that keeps the speed `omega` (rad/s) until T is at `balance`.

    `balance` in N m. The compensating loop rests. Results as of `_moving`.
    """
    h0, torque, learnt, way = rotor
    duration = min(_reaches(motor, torque, command, balance), dt)
    h = motor[0] * (omega + axial[0] + axial[1] * duration)
    after = motor_torque(motor, torque, command, duration)
    return (h, after, learnt, way), duration, 0.5 * duration * (h0 + h)


def braking(
    motor: Motor, rotor: Rotor, command: float, axial: Axial, dt: float, fastest: float
) -> tuple[Rotor, float, float]:
    """Brake a rotor above its speed limit with the torque limit.

    This happens where the body's rate was not the predicted one. Results as of
    `_moving`.
    """
    j, torque_limit = motor[0], motor[7]
    h0, torque, learnt, way = rotor
    omega = h0 / j - axial[0]
    outwards = copysign(1.0, omega)
    # deceleration relative to the body, rad/s2
    falls = torque_limit / j + outwards * axial[1]
    duration = min((abs(omega) - fastest) / falls, dt) if falls > 0.0 else dt
    h = h0 - outwards * torque_limit * duration
    after = motor_torque(motor, torque, command, duration)
    return (h, after, learnt, way), duration, 0.5 * duration * (h0 + h)


# --- moving ---------------------------------------------------------------------------


def _free(
    motor: Motor, rotor: Rotor, command: float, axial: Axial, dt: float
) -> tuple[Rotor, float]:
    """Propagate a rotor that goes on moving over dt (s).

    Returns the state and the integral of h (N m s2).
    """
    rate, change = axial
    n = _parts(motor, rotor, command, axial, dt, inf)
    part, total = dt / n, 0.0
    for i in range(n):
        rotor, integral = _part(
            motor, rotor, command, (rate + change * i * part, change), part
        )
        total += integral
    return rotor, total


def _moving(
    motor: Motor, rotor: Rotor, command: float, axial: Axial, dt: float, fastest: float
) -> tuple[Rotor, float, float]:
    """Propagate a moving rotor until its motion ends, at most by dt (s).

    Returns the state, the elapsed time (s) and the integral of h (N m s2).
    """
    rate, change = axial
    if motor[6] > 0.0:
        # the speed turns where the torque does: end the part there, so that the speed
        # does not pass zero within one part and come back
        h, torque, learnt, way = rotor
        balance = _drag(motor, h / motor[0] - rate, way) - learnt + motor[0] * change
        turns = _reaches(motor, torque, command, balance)
        if TURNS * dt < turns < dt:
            dt = turns
    n = _parts(motor, rotor, command, axial, dt, fastest)
    part, total = dt / n, 0.0
    for i in range(n):
        now = rate + change * i * part, change
        after, integral = _part(motor, rotor, command, now, part)
        if _has_ended(motor, after, now, part, fastest):
            after, duration, integral = _to_its_end(
                motor, rotor, command, now, part, fastest
            )
            return after, i * part + duration, total + integral
        rotor, total = after, total + integral
    return rotor, dt, total


def _has_ended(
    motor: Motor, rotor: Rotor, axial: Axial, t: float, fastest: float
) -> bool:
    """Return whether the rotor, t (s) after `axial`, has ended its motion.

    It has if it is beyond its limit or, with stiction, turns the other way.
    """
    omega = rotor[0] / motor[0] - axial[0] - axial[1] * t
    # without stiction the state does not change where the speed turns, and `way` is that
    # of the start
    stops = motor[6] > 0.0 and omega * rotor[3] < 0.0
    return abs(omega) > fastest * (1.0 + AT_LIMIT) or stops


def _to_its_end(
    motor: Motor, rotor: Rotor, command: float, axial: Axial, dt: float, fastest: float
) -> tuple[Rotor, float, float]:
    """Propagate a moving rotor to the end of its motion, which lies within dt (s).

    The end is found by bisection; the speed is then exact. Results as of `_moving`.
    """
    j, (rate, change) = motor[0], axial
    before, duration = 0.0, dt
    for _ in range(HALVINGS):
        middle = 0.5 * (before + duration)
        if _has_ended(
            motor,
            _part(motor, rotor, command, axial, middle)[0],
            axial,
            middle,
            fastest,
        ):
            duration = middle
        else:
            before = middle
    (h, torque, learnt, way), integral = _part(motor, rotor, command, axial, duration)
    rate += change * duration
    omega = h / j - rate
    if motor[6] > 0.0 and omega * way < 0.0:
        return (j * rate, torque, 0.0, 0.0), duration, integral
    return (
        (j * (copysign(fastest, omega) + rate), torque, learnt, way),
        duration,
        integral,
    )


def _parts(
    motor: Motor, rotor: Rotor, command: float, axial: Axial, dt: float, fastest: float
) -> int:
    """Count the parts into which a step is divided for the integration of friction.

    Within one part, the speed does not pass its limit or zero and come back.
    """
    inertia, lag, viscous, coulomb, omega_eps, compensation, stiction, _ = motor
    (h, torque, learnt, way), rate = rotor, axial[0]
    decay = viscous / inertia  # of the speed by friction, 1/s
    parts = 0.0
    speed_change = max(abs(torque), abs(command)) * dt / inertia
    omega = h / inertia - rate
    if (
        coulomb > 0.0
        and stiction == 0.0
        and abs(omega) < 8.0 * omega_eps + speed_change
    ):
        # the sign of Coulomb friction may turn
        if compensation > 0.0:
            unknown = abs(_drag(motor, omega, way) - learnt)
            parts = (speed_change + unknown * dt / inertia) / (CURVED * omega_eps)
        else:
            parts = 2.0 * speed_change / omega_eps
        decay += coulomb / omega_eps / inertia
    if compensation <= 0.0:
        parts = max(parts, 10.0 * decay * dt)
        # where friction depends on the motor's transient
        swing = abs(torque - command) * lag / inertia
        if decay * swing * min(lag, dt) > SMALL_SPEED:
            parts = max(parts, 0.5 * dt / lag)
    if torque * command < 0.0 < lag and (
        stiction > 0.0
        or _may_pass(motor, rotor, command, rate, rate + axial[1] * dt, dt, fastest)
    ):
        parts = max(parts, 4.0 * dt / lag)
    return min(max(1, ceil(parts)), 64)


def _part(
    motor: Motor, rotor: Rotor, command: float, axial: Axial, dt: float
) -> tuple[Rotor, float]:
    """Propagate the rotor over dt (s), within which its motion does not end.

    Returns the state and the integral of h (N m s2).
    """
    _, lag, viscous, coulomb, _, compensation, stiction, torque_limit = motor
    if viscous == coulomb == stiction == 0.0:
        return _frictionless(motor, rotor, command, dt)
    if compensation <= 0.0:
        return _with_friction(motor, rotor, command, axial, dt)
    after, integral = _propagate_compensated(motor, rotor, command, axial, dt)
    # the motor's response and the learnt friction go one way each
    first = rotor[1] if lag > 0.0 else command
    most = max(first, after[1]) + max(rotor[2], after[2])
    least = min(first, after[1]) + min(rotor[2], after[2])
    if max(most, -least) > torque_limit * (1.0 + 1e-12):
        return _propagate_limited(motor, rotor, command, axial, dt)
    return after, integral


def _frictionless(
    motor: Motor, rotor: Rotor, command: float, dt: float
) -> tuple[Rotor, float]:
    """Propagate a rotor without friction over dt (s), in closed form.

    Returns the state and the integral of h (N m s2).
    """
    lag = motor[1]
    h0, torque, learnt, way = rotor
    if lag > 0.0:
        mean, slope, end = lag_moments(dt / lag)
        excess = torque - command
        momentum_gain, torque = dt * (command + excess * mean), command + excess * end
        first = 0.5 * command + excess * (slope / 12.0 + 0.5 * mean)  # int_0^1 s T ds
    else:
        momentum_gain, torque, first = dt * command, command, 0.5 * command
    h = h0 + momentum_gain
    return (h, torque, learnt, way), dt * (h - dt * first)


def driven(
    motor: Motor, torque0: float, command: float, dt: float
) -> tuple[float, float, float, float]:
    """Compute the effect of the motor alone in dt (s).

    Returns momentum (N m s), its integral (N m s2), T at the end (N m), and the motor's
    excess over the command as a momentum (N m s).
    """
    lag = motor[1]
    motor_momentum, torque, first = command * dt, command, 0.5 * command * dt * dt
    excess = (torque0 - command) * lag
    if excess:
        decay = exp(-dt / lag)
        motor_momentum += excess * (1.0 - decay)
        torque += excess / lag * decay
        first += excess * (dt - lag * (1.0 - decay))
    return motor_momentum, first, torque, excess


def _with_friction(
    motor: Motor, rotor: Rotor, command: float, axial: Axial, dt: float
) -> tuple[Rotor, float]:
    """Propagate the rotor over dt (s): motor in closed form, friction by RK4."""
    h0, torque0, _, way = rotor
    motor_momentum, first, torque, excess = driven(motor, torque0, command, dt)
    friction_loss, first_friction_loss = _friction_loss(
        motor, rotor, excess, command, axial, dt
    )
    return (
        h0 + motor_momentum - friction_loss,
        torque,
        0.0,
        way,
    ), h0 * dt + first - first_friction_loss


def _friction_loss(
    motor: Motor, rotor: Rotor, excess: float, command: float, axial: Axial, dt: float
) -> tuple[float, float]:
    """Compute the momentum lost by friction (N m s) and its integral (N m s2).

    By RK4; the integral is that of a Hermite cubic.
    """
    j, lag, viscous, coulomb, omega_eps, _, stiction, _ = motor
    (rate, change), (h0, _, _, way) = axial, rotor

    def drag(s: float, friction_loss: float) -> float:
        """Compute the friction (N m) at s (s) into the step.

        `friction_loss` is the momentum lost so far (N m s). The function is `_drag`, written out
        because it is called often.
        """
        motor_momentum = command * s + (
            excess * (1.0 - exp(-s / lag)) if excess else 0.0
        )
        omega = (h0 + motor_momentum - friction_loss) / j - rate - change * s
        return viscous * omega + coulomb * (
            way if stiction > 0.0 else tanh(omega / omega_eps)
        )

    half = 0.5 * dt
    a = drag(0.0, 0.0)
    b = drag(half, half * a)
    c = drag(half, half * b)
    d = drag(dt, dt * c)
    friction_loss = dt / 6.0 * (a + 2.0 * (b + c) + d)
    return friction_loss, dt * (0.5 * friction_loss + dt * (a - d) / 12.0)


def _propagate_compensated(
    motor: Motor, rotor: Rotor, command: float, axial: Axial, dt: float
) -> tuple[Rotor, float]:
    """Propagate a rotor whose loop of bandwidth c (1/s) learns the friction.

    With a = friction'(Omega) / J at the middle of the part, the friction that is not
    learnt yet obeys x' = a (T - J (g.omega)') - (a + c) x, which is solved exactly.
    """
    j, lag, viscous, coulomb, omega_eps, c, stiction, _ = motor
    (rate, change), (h0, torque0, learnt, way) = axial, rotor
    motor_momentum, first_pushed, torque, _ = driven(motor, torque0, command, dt)
    omega = h0 / j - rate
    x0 = _drag(motor, omega, way) - learnt
    # what drives the speed without friction, N m s, and its integral, N m s2
    momentum_gain = motor_momentum - j * change * dt
    first_gained = first_pushed - 0.5 * j * change * dt * dt
    slope = viscous
    if stiction == 0.0 and coulomb > 0.0:
        speed_sign = tanh(
            (omega + 0.5 * (momentum_gain - x0 * dt / (1.0 + c * dt)) / j) / omega_eps
        )
        slope += coulomb / omega_eps * (1.0 - speed_sign * speed_sign)
    a = slope / j
    k = a + c
    rest = exp(-k * dt)
    x = x0 * rest + a * (command - j * change) * (1.0 - rest) / k
    if lag > 0.0:
        x += a * (torque0 - command) * _integrate_lag(lag, k, rest, dt)
    # of the equation above, integrated once and twice
    friction_loss = (x0 - x + a * momentum_gain) / k
    first_loss = (x0 * dt - friction_loss + a * first_gained) / k
    return (
        h0 + motor_momentum - friction_loss,
        torque,
        learnt + c * friction_loss,
        way,
    ), h0 * dt + first_pushed - first_loss


def _integrate_lag(lag: float, k: float, rest: float, dt: float) -> float:
    """Compute int_0^dt exp(-k (dt - s)) exp(-s / lag) ds (s), with rest = exp(-k dt)."""
    difference = (k - 1.0 / lag) * dt
    if abs(difference) < 1e-4:
        return dt * rest * (1.0 + difference * (0.5 + difference / 6.0))
    return dt * (exp(-dt / lag) - rest) / difference


def _propagate_limited(
    motor: Motor, rotor: Rotor, command: float, axial: Axial, dt: float
) -> tuple[Rotor, float]:
    """Propagate as `_propagate_compensated`, with the drive limited: h and learnt by RK4."""
    j, lag, c, limit, (rate, change) = motor[0], motor[1], motor[5], motor[7], axial
    h, torque, learnt, way = rotor
    total = 0.0

    def changes(s: float, h: float, learnt: float) -> tuple[float, float]:
        """Return the derivatives of h (N m) and of the learnt torque (N m/s)."""
        drive = motor_torque(motor, torque, command, s) + learnt
        drag = _drag(motor, h / j - rate - change * s, way)
        return min(max(drive, -limit), limit) - drag, c * (drag - learnt)

    fastest = max(c, 1.0 / lag) if lag > 0.0 else c
    n = min(max(16, ceil(8.0 * fastest * dt)), 1024)
    part = dt / n
    half = 0.5 * part
    for i in range(n):
        s = i * part
        a, a2 = changes(s, h, learnt)
        b, b2 = changes(s + half, h + half * a, learnt + half * a2)
        d, d2 = changes(s + half, h + half * b, learnt + half * b2)
        e, e2 = changes(s + part, h + part * d, learnt + part * d2)
        momentum_gain = part / 6.0 * (a + 2.0 * (b + d) + e)
        total += part * (h + 0.5 * momentum_gain + part * (a - e) / 12.0)
        h += momentum_gain
        learnt += part / 6.0 * (a2 + 2.0 * (b2 + d2) + e2)
    return (h, motor_torque(motor, torque, command, dt), learnt, way), total
