"""Convert between mean and osculating elements by averaging over a revolution.

The averages are integrated numerically. The mean elements at t = 0 are the averages of
the osculating ones over the revolution around it; their drift is therefore that of
`orbit.j2_drift`, up to the second order in J2.
"""

from __future__ import annotations

from math import atan, atan2, ceil, cos, pi, remainder, sin, sqrt, tan, tau

from ..maths.runge_kutta import State, step8
from .orbit import (
    Elements,
    elements_from_state,
    gravity,
    mean_motion,
    state_from_elements,
)

# Integration steps in half a revolution of a circular orbit; an eccentric one takes
# more, as it passes the perigee faster.
STEPS = 60

# Equinoctial elements: a (m), e sin and e cos of the longitude of the perigee, tan(i/2)
# sin and tan(i/2) cos of raan, mean longitude (rad). They are singular only at i = pi.
_Six = tuple[float, float, float, float, float, float]


def mean_elements(osculating: Elements, degree: int, mu: float) -> Elements:
    """Compute the mean elements of osculating ones.

    Gravity has the zonal harmonics up to `degree`.
    """
    return _elements(_averages(osculating, degree, mu))


def osculating_elements(mean: Elements, degree: int, mu: float) -> Elements:
    """Compute the osculating elements of mean ones: the inverse of `mean_elements`.

    Fixed-point iteration; each step gains a factor of 1000, as J2 is small.
    """
    mean_equinoctial = _equinoctial(mean)
    guess = mean_equinoctial
    for _ in range(4):
        mean_of_guess = _averages(_elements(guess), degree, mu)
        guess = (
            guess[0] + mean_equinoctial[0] - mean_of_guess[0],
            guess[1] + mean_equinoctial[1] - mean_of_guess[1],
            guess[2] + mean_equinoctial[2] - mean_of_guess[2],
            guess[3] + mean_equinoctial[3] - mean_of_guess[3],
            guess[4] + mean_equinoctial[4] - mean_of_guess[4],
            guess[5] + remainder(mean_equinoctial[5] - mean_of_guess[5], tau),
        )
    return _elements(guess)


def _averages(osculating: Elements, degree: int, mu: float) -> _Six:
    """Average the equinoctial elements over the revolution around t = 0.

    The length of the revolution is one turn of the mean longitude itself.
    """
    half = pi / mean_motion(osculating.semi_major_axis, mu)
    for _ in range(2):
        ahead = _half_sum(osculating, half, degree, mu)
        behind = _half_sum(osculating, -half, degree, mu)
        last = ahead[1] - behind[1]
        half *= tau / last
    a, b = ahead[0], behind[0]
    return (
        0.5 * (a[0] + b[0]),
        0.5 * (a[1] + b[1]),
        0.5 * (a[2] + b[2]),
        0.5 * (a[3] + b[3]),
        0.5 * (a[4] + b[4]),
        0.5 * (a[5] + b[5]),
    )


def _half_sum(
    osculating: Elements, time: float, degree: int, mu: float
) -> tuple[_Six, float]:
    """Average the equinoctial elements from t = 0 to `time` (s).

    Trapezoidal rule. The second result is the mean longitude (rad) at `time`.
    """
    (x, y, z), (vx, vy, vz) = state_from_elements(osculating, mu)
    n = ceil(STEPS / (1.0 - osculating.eccentricity) ** 1.5)
    here: State = (x, y, z, vx, vy, vz, 0.0)
    first = _equinoctial(osculating)
    longitude = first[5]
    a, h, k, p, q, turn = (
        0.5 * first[0],
        0.5 * first[1],
        0.5 * first[2],
        0.5 * first[3],
        0.5 * first[4],
        0.5 * first[5],
    )

    def slope(e: float, y: State) -> State:
        """Return the derivative of position and velocity: m/s and m/s2."""
        ax, ay, az = gravity((y[0], y[1], y[2]), degree, mu)
        return (y[3], y[4], y[5], ax, ay, az, 0.0)

    for step in range(n):
        here = step8(slope, 0.0, here, 1.0, time / n)
        now = _equinoctial(
            elements_from_state(
                (here[0], here[1], here[2]), (here[3], here[4], here[5]), mu
            )
        )
        longitude += remainder(now[5] - longitude, tau)
        weight = 0.5 if step == n - 1 else 1.0
        a, h, k = a + weight * now[0], h + weight * now[1], k + weight * now[2]
        p, q, turn = p + weight * now[3], q + weight * now[4], turn + weight * longitude
    return (a / n, h / n, k / n, p / n, q / n, turn / n), longitude


def _equinoctial(elements: Elements) -> _Six:
    """Convert Kepler elements to equinoctial ones."""
    a, e, i, raan, perigee, anomaly = elements
    longitude, tilt = raan + perigee, tan(0.5 * i)
    return (
        a,
        e * sin(longitude),
        e * cos(longitude),
        tilt * sin(raan),
        tilt * cos(raan),
        longitude + anomaly,
    )


def _elements(six: _Six) -> Elements:
    """Convert equinoctial elements to Kepler elements."""
    a, h, k, p, q, turn = six
    raan, longitude = atan2(p, q), atan2(h, k)
    return Elements(
        a,
        sqrt(h * h + k * k),
        2.0 * atan(sqrt(p * p + q * q)),
        raan,
        longitude - raan,
        turn - longitude,
    )
