"""Estimate rate, field and what is doubted of a craft by one extended Kalman filter.

The state x (24) is the rate omega (rad/s) and the field b (T), both body; the inertia J_r
without the wheels' axial part, as moments xx, yy, zz and elements xy, xz, yz (kg m2);
the effectiveness e of the three coils (1; -1: turned); and the coupling K of the coils
into the magnetometer, row by row (T/(A m2)). Between samples

    J_r omega' = (e m) x b + tau - omega x (J_r omega + w),      b' = -omega x b,

with m (A m2) the commanded dipole, e m by elements, tau (N m) the wheels' torque on the
body and w (N m s) their momentum. The magnetometer shows y = b + K m + v, and a gyro,
where there is one, omega. With E_i the symmetric unit matrices and a_i the body axes

    d omega'/d J_i = -J_r^-1 (E_i omega' + omega x E_i omega),
    d omega'/d e_i = m_i J_r^-1 (a_i x b).

What is constant is *considered* from the first sample: its doubt is in the covariance
of omega and b. It is estimated only once the rate is known (Schmidt). A parameter with
a standard deviation of zero is certain and stays as it is.

Source: Jazwinski, Stochastic Processes and Filtering Theory (1970), sec. 8.4 (Schmidt's
consider filter); Lear, Kalman Filtering Techniques, NASA JSC-20688 (1985), for
underweighting; rate and field as in Psiaki, Martel & Pal, Three-axis attitude
determination via Kalman filtering of magnetometer data, J. Guidance, Control, and
Dynamics 13 (1990) 506, without the attitude.
"""

from __future__ import annotations

from typing import NamedTuple

from ..contract.block import Mat33, Table, Vec3
from ..maths import kalman, matrix
from ..maths.vector import AXES, IDENTITY, add, cross, inverse, mat_vec, scale, sub
from . import rate_observer

FIELD, INERTIA, COILS, COUPLING, STATES = 3, 6, 12, 15, 24  # where each part begins
MOVING = INERTIA  # rate and field; the others are constant
UNDERWEIGHT = 0.2  # share of the state's part of an innovation's variance (Lear)
PRODUCTS = 0.2  # spread of a product of inertia over that of a moment
BOUND = 4.0  # spreads from its first value at which a constant is held
LEAST_MOMENT = 0.2  # share of its first value at which a moment is held


class Doubts(NamedTuple):
    """Standard deviations of what the filter begins with; 0: certain."""

    rate: float  # rad/s, each axis
    field: float  # T, of the magnetometer, each axis
    moment: float  # kg m2, of a moment of inertia; a product's is PRODUCTS of it
    coil: float  # 1, of the effectiveness of a coil
    coupling: float  # T/(A m2), of an element of K


class Interval(NamedTuple):
    """What happened to the craft from the last sample to this one."""

    elapsed_time: float  # s
    dipole: Vec3  # A m2, commanded, body
    tau: Vec3  # N m, the wheels' torque on the body
    wheel: Vec3  # N m s, the wheels' momentum at the last sample, body
    field: Vec3  # T, measured at this sample with the coils' in it, body
    gyro: Vec3  # rad/s, rate measured at this sample, body
    gyro_noise: float  # rad/s, its standard deviation, each axis; 0: there is no gyro


class Setting(NamedTuple):
    """What the filter is set to."""

    doubts: Doubts
    carrier: Mat33  # kg m2, J_r with which it began
    rate_noise: float  # rad/s, random walk over a root second
    field_turn: float  # T, random walk over a root second


def begin(b: Vec3, dipole: Vec3, setting: Setting) -> tuple[Table, Table]:
    """Return the first state (24) and covariance (24 x 24, row-major).

    Parameters
    ----------
    b : Vec3
        Measured field (T, body).
    dipole : Vec3
        Commanded dipole at the time of that measurement (A m2, body).
    setting : Setting
        Of the filter.
    """
    doubts = setting.doubts
    x = [0.0] * STATES
    p = [0.0] * (STATES * STATES)
    for i in range(3):
        x[FIELD + i] = b[i]
        x[COILS + i] = 1.0
    first = _elements(setting.carrier)
    for i in range(6):
        x[INERTIA + i] = first[i]
    dipole_square = (
        dipole[0] * dipole[0] + dipole[1] * dipole[1] + dipole[2] * dipole[2]
    )
    for i in range(STATES):
        deviation = deviation_of(doubts, i)
        p[STATES * i + i] = deviation * deviation
        if FIELD <= i < INERTIA:
            p[STATES * i + i] += doubts.coupling * doubts.coupling * dipole_square
    return tuple(x), tuple(p)


def deviation_of(doubts: Doubts, state: int) -> float:
    """Return the first standard deviation of a state, in its unit."""
    if state < FIELD:
        return doubts.rate
    if state < INERTIA:
        return doubts.field
    if state < COILS:
        return doubts.moment * (1.0 if state < INERTIA + 3 else PRODUCTS)
    return doubts.coil if state < COUPLING else doubts.coupling


def rate_of(x: Table) -> Vec3:
    """Return omega (rad/s, body)."""
    return (x[0], x[1], x[2])


def field_of(x: Table) -> Vec3:
    """Return b (T, body)."""
    return (x[3], x[4], x[5])


def carrier_of(x: Table) -> Mat33:
    """Return J_r (kg m2, body)."""
    return (x[6], x[9], x[10], x[9], x[7], x[11], x[10], x[11], x[8])


def coupled_field(x: Table, dipole: Vec3) -> Vec3:
    """Return K m (T, body), the field of a commanded dipole (A m2) at the magnetometer."""
    return mat_vec(
        (x[15], x[16], x[17], x[18], x[19], x[20], x[21], x[22], x[23]), dipole
    )


def rates_covariance(p: Table) -> Mat33:
    """Return the covariance of omega ((rad/s)^2)."""
    n = STATES
    return (
        p[0],
        p[1],
        p[2],
        p[n],
        p[n + 1],
        p[n + 2],
        p[2 * n],
        p[2 * n + 1],
        p[2 * n + 2],
    )


def coil_signs(x: Table, p: Table) -> Vec3:
    """Return -1 for a coil that is turned by more than a standard deviation, else 1."""
    return (_sign(x, p, COILS), _sign(x, p, COILS + 1), _sign(x, p, COILS + 2))


def _sign(x: Table, p: Table, state: int) -> float:
    """Return -1 where a state is below zero by more than a standard deviation, else 1."""
    is_reversed = x[state] < 0.0 and x[state] * x[state] > p[(STATES + 1) * state]
    return -1.0 if is_reversed else 1.0


def update(
    x: Table, p: Table, interval: Interval, setting: Setting, learns: bool
) -> tuple[Table, Table, float]:
    """Propagate to this sample and correct by its field, and by its rate with a gyro.

    Parameters
    ----------
    x, p : Table
        State (24) and covariance (24 x 24) at the last sample.
    interval : Passed
        What happened since.
    setting : Setting
        Of the filter.
    learns : bool
        Whether what is constant is estimated, or only considered.

    Returns
    -------
    tuple
        State, covariance, and the largest square of an innovation over its variance (1);
        `kalman.UNSOUND` where the covariance or the inertia cannot be that of anything.
    """
    state = [0.0] * STATES
    covariance = [0.0] * (STATES * STATES)
    for i in range(STATES):
        state[i] = x[i]
    for i in range(STATES * STATES):
        covariance[i] = p[i]
    _predict(state, covariance, x, interval, setting)
    worst = 0.0
    if interval.gyro_noise > 0.0:
        worst = _correct_rate(state, covariance, interval, learns)
    worst = max(
        worst, _correct(state, covariance, interval, setting.doubts.field, learns)
    )
    _limit_constants(state, setting)
    if not _is_sound(state, covariance):
        worst = kalman.UNSOUND
    return tuple(state), tuple(covariance), worst


def _predict(
    state: list[float],
    covariance: list[float],
    x: Table,
    interval: Interval,
    setting: Setting,
) -> None:
    """Propagate the state, whose copy x is, and its covariance in place."""
    effects = [0.0] * (MOVING * STATES)
    elapsed_time, dipole = interval.elapsed_time, interval.dipole
    m = (x[12] * dipole[0], x[13] * dipole[1], x[14] * dipole[2])
    carrier = carrier_of(x)
    carrier_inverse = inverse(carrier)
    omega, b = rate_observer.predict(
        rate_of(x),
        field_of(x),
        m,
        interval.tau,
        interval.wheel,
        carrier,
        carrier_inverse,
        elapsed_time,
    )
    _fill_moving(effects, x, interval.wheel, carrier_inverse, elapsed_time)
    _fill_constants(effects, x, omega, dipole, carrier_inverse, elapsed_time)
    kalman.predict(state, covariance, effects)
    for i in range(3):
        state[i], state[FIELD + i] = omega[i], b[i]
        of_rate, of_field = (STATES + 1) * i, (STATES + 1) * (FIELD + i)
        covariance[of_rate] += setting.rate_noise * setting.rate_noise * elapsed_time
        covariance[of_field] += setting.field_turn * setting.field_turn * elapsed_time


def _fill_moving(
    effects: list[float],
    x: Table,
    wheel: Vec3,
    carrier_inverse: Mat33,
    elapsed_time: float,
) -> None:
    """Set the columns of rate and field in the transition matrix.

    F_w = 1 + A T + (A T)^2 / 2 with A = J_r^-1 ([(J_r omega + w) x] - [omega x] J_r); the
    field has [b x] T and 1 - [omega x] T.
    """
    omega, carrier = rate_of(x), carrier_of(x)
    momentum = add(mat_vec(carrier, omega), wheel)
    turning = matrix.crossing(omega)
    slope = matrix.subtract(
        matrix.crossing(momentum), matrix.multiply(turning, carrier)
    )
    a = matrix.scale(elapsed_time, matrix.multiply(carrier_inverse, slope))
    half = matrix.scale(0.5, matrix.multiply(a, a))
    of_rate = matrix.add(matrix.add(IDENTITY, a), half)
    down = matrix.scale(elapsed_time, matrix.crossing(field_of(x)))
    across = matrix.subtract(IDENTITY, matrix.scale(elapsed_time, turning))
    for i in range(3):
        for j in range(3):
            effects[STATES * i + j] = of_rate[3 * i + j]
            effects[STATES * (FIELD + i) + j] = down[3 * i + j]
            effects[STATES * (FIELD + i) + FIELD + j] = across[3 * i + j]


def _fill_constants(
    effects: list[float],
    x: Table,
    after: Vec3,
    dipole: Vec3,
    carrier_inverse: Mat33,
    elapsed_time: float,
) -> None:
    """Set the columns of inertia and coils in the transition matrix.

    The rate at the end of the time is `after` (rad/s); slope and rate are taken as their
    means.
    """
    before, b = rate_of(x), field_of(x)
    middle = scale(0.5, add(before, after))
    change = sub(after, before)
    for i in range(6):
        momentum_change = add(
            _by_unit(i, change),
            scale(elapsed_time, cross(middle, _by_unit(i, middle))),
        )
        _fill_column(
            effects,
            INERTIA + i,
            scale(-1.0, mat_vec(carrier_inverse, momentum_change)),
            b,
            elapsed_time,
        )
    for i in range(3):
        torque = scale(elapsed_time * dipole[i], cross(AXES[i], b))
        _fill_column(
            effects, COILS + i, mat_vec(carrier_inverse, torque), b, elapsed_time
        )


def _fill_column(
    effects: list[float], state: int, rate_change: Vec3, b: Vec3, elapsed_time: float
) -> None:
    """Set what a unit of a constant does to rate (rad/s) and field (T).

    The field follows the mean of the change `rate_change` of the rate: db = T/2 b x turned.
    """
    swept = scale(0.5 * elapsed_time, cross(b, rate_change))
    for i in range(3):
        effects[STATES * i + state] = rate_change[i]
        effects[STATES * (FIELD + i) + state] = swept[i]


def _by_unit(element: int, a: Vec3) -> Vec3:
    """Return E_i a with the symmetric unit matrix of an element of the inertia."""
    if element < 3:
        return (
            a[0] if element == 0 else 0.0,
            a[1] if element == 1 else 0.0,
            a[2] if element == 2 else 0.0,
        )
    if element == 3:
        return (a[1], a[0], 0.0)
    return (a[2], 0.0, a[0]) if element == 4 else (0.0, a[2], a[1])


def _correct(
    state: list[float],
    covariance: list[float],
    interval: Interval,
    noise: float,
    learns: bool,
) -> float:
    """Correct in place by the measured field, one axis after the other.

    noise (T) is the standard deviation in each axis. The result is the largest square
    of an innovation over its variance.
    """
    product = [0.0] * STATES
    dipole = interval.dipole
    estimated_states = STATES if learns else MOVING
    worst = 0.0
    for axis in range(3):
        k = COUPLING + 3 * axis
        for i in range(STATES):
            row = STATES * i
            product[i] = covariance[row + FIELD + axis] + (
                covariance[row + k] * dipole[0]
                + covariance[row + k + 1] * dipole[1]
                + covariance[row + k + 2] * dipole[2]
            )
        of_state = product[FIELD + axis] + (
            product[k] * dipole[0]
            + product[k + 1] * dipole[1]
            + product[k + 2] * dipole[2]
        )
        expected_field = state[FIELD + axis] + (
            state[k] * dipole[0] + state[k + 1] * dipole[1] + state[k + 2] * dipole[2]
        )
        innovation = interval.field[axis] - expected_field
        worst = max(worst, kalman.surprise(innovation, of_state + noise * noise))
        kalman.correct(
            state,
            covariance,
            product,
            innovation,
            (1.0 + UNDERWEIGHT) * of_state + noise * noise,
            estimated_states,
        )
    return worst


def _correct_rate(
    state: list[float], covariance: list[float], interval: Interval, learns: bool
) -> float:
    """Correct in place by the measured rate, one axis after the other.

    The result is the largest square of an innovation over its variance (1).
    """
    product = [0.0] * STATES
    noise = interval.gyro_noise * interval.gyro_noise
    estimated_states = STATES if learns else MOVING
    worst = 0.0
    for axis in range(3):
        for i in range(STATES):
            product[i] = covariance[STATES * i + axis]
        variance = product[axis] + noise
        innovation = interval.gyro[axis] - state[axis]
        worst = max(worst, kalman.surprise(innovation, variance))
        kalman.correct(
            state, covariance, product, innovation, variance, estimated_states
        )
    return worst


def _limit_constants(state: list[float], setting: Setting) -> None:
    """Hold the constants within BOUND standard deviations of their first values."""
    first = _elements(setting.carrier)
    for i in range(INERTIA, STATES):
        reach = BOUND * deviation_of(setting.doubts, i)
        middle = 0.0
        if i < COILS:
            middle = first[i - INERTIA]
        elif i < COUPLING:
            middle = 1.0
        low = middle - reach
        if i < INERTIA + 3:
            low = max(low, LEAST_MOMENT * middle)
        state[i] = min(max(state[i], low), middle + reach)


def _is_sound(state: list[float], covariance: list[float]) -> bool:
    """Return whether all is finite, no variance negative and J_r positive definite."""
    if not kalman.is_sound(state, covariance):
        return False
    a, b, c = state[INERTIA], state[INERTIA + 3], state[INERTIA + 4]
    e, f, g = state[INERTIA + 1], state[INERTIA + 5], state[INERTIA + 2]
    determinant = a * (e * g - f * f) - b * (b * g - f * c) + c * (b * f - e * c)
    return a > 0.0 and a * e - b * b > 0.0 and determinant > 0.0


def _elements(carrier: Mat33) -> Table:
    """Return the six numbers of an inertia: xx, yy, zz, xy, xz, yz (kg m2)."""
    return (carrier[0], carrier[4], carrier[8], carrier[1], carrier[2], carrier[5])
