from __future__ import annotations

from collections.abc import Iterator
from math import acos, asin, ceil, cos, inf, sin, sqrt

from ..bases.pointing import PointingLaw
from ..contract.block import TURN, Parameter, Table, Vec3, Vec4
from ..maths.attitude import (
    from_axes,
    inverse,
    nearest,
    normalise,
    product,
    propagate,
    rotate,
)
from ..maths.vector import ZERO, add, cross, dot, norm, scale, sub, unit
from ..physics.earth import ECLIPTIC_NORTH
from ..physics.orbit import EARTH_RADIUS, EARTH_RATE, MU, lvlh_attitude

ROWS, COLUMNS = 32, 6
INERTIAL, NADIR, SUN, TARGET = range(4)
FLATTENING = 1.0 / 298.257223563
# Parts of a step: each takes at most this share of the time in which the limits of rate
# and acceleration bring the craft from rest to its largest rate.
SHARE = 0.25
FOLLOWS = 10.0  # parts in which an error decays that no limit holds


class GuidancePlan(PointingLaw):
    """Attitudes by a plan: inertial, nadir, Sun or a target on the ground, with slews

    A row of `plan` holds from its time until that of the next: time, mode and a
    quaternion q. The wanted attitude is

        0 inertial:  q                       1 nadir:  q (x) q_oi(r, v)
        2 Sun:       z to the Sun, y as near to the ecliptic's north as possible
        3 target:    z to the target, x as near to the velocity as possible, while its
                     elevation is above `elevation_limit`; otherwise as nadir

    and the reference follows it with rates up to `rate_limit` and accelerations up to
    `acceleration_limit` beyond those of the wanted attitude. While it is off by the
    angle b about the axis e its rate is that of the wanted attitude and

        e min(sqrt(acceleration_limit b), b / (10 steps), rate_limit)

    The rate is held over each step, or over parts of a long one, so that it is that of
    the differenced attitude. The
    target lies on the ellipsoid of WGS 84 and turns with the Earth from
    `earth_angle_start` on. The wanted rate of a target is exact for two bodies.

    Source: ours; geometry.
    """

    plan: Table = Parameter(
        "1",
        "a row each: time s, mode (0 inertial, 1 nadir, 2 Sun, 3 target), quaternion x, y, z, w; "
        "a row whose time does not grow ends it",
        shape=(ROWS, COLUMNS),
        start=((0.0, 1.0, 0.0, 0.0, 0.0, 1.0),) + ((0.0,) * COLUMNS,) * (ROWS - 1),
        needs=("r_eci", "v_eci", "sun_eci"),
    )
    rate_limit: float = Parameter(
        "rad/s", "largest rate of a slew", start=8e-3, min=1e-6, usual=(1e-5, 0.1)
    )
    acceleration_limit: float = Parameter(
        "rad/s2",
        "largest acceleration of a slew",
        start=1e-4,
        min=1e-10,
        usual=(1e-9, 1e-2),
    )
    target_latitude: float = Parameter(
        "rad", "of the target, geodetic", min=-1.5707963268, max=1.5707963268
    )
    target_longitude: float = Parameter("rad", "of the target, east", usual=TURN)
    elevation_limit: float = Parameter(
        "rad", "below it the target is not followed", start=0.0873, usual=(-1.6, 1.6)
    )
    earth_angle_start: float = Parameter(
        "rad",
        "angle at t = 0 from the equinox of date to the meridian of Greenwich",
        usual=TURN,
    )

    def start(self) -> None:
        """Count the rows, check them and begin at the first wanted attitude."""
        super().start()
        count = 1
        while count < ROWS and (
            self.plan[COLUMNS * count] > self.plan[COLUMNS * (count - 1)]
        ):
            count += 1
        self._rows = count
        for i in range(count):
            mode = self.plan[COLUMNS * i + 1]
            if mode not in (0.0, 1.0, 2.0, 3.0):
                self.fail(f"plan: row {i + 1}: mode = {mode:g} is none of 0 to 3")
            if not any(self._quaternion(i)) and mode < SUN:
                self.fail(f"plan: row {i + 1}: a quaternion is needed, not 0, 0, 0, 0")
        self._site = self._place_target()
        self._last = -inf
        self._q: Vec4 = (0.0, 0.0, 0.0, 1.0)
        self._rate = self._wanted_before = ZERO
        self.start_reference()
        self._last = -inf

    def foresee(
        self, begin: float, end: float, wired_names: frozenset[str]
    ) -> Iterator[str]:
        """Yield the problems known before a run: a plan that begins after it."""
        if self.plan[0] > begin:
            yield (
                f"plan: its first row is at {self.plan[0]:g} s, the run from {begin:g} s: it holds "
                "from there on"
            )
        yield from super().foresee(begin, end, wired_names)

    def point(self, t: float) -> tuple[Vec4, Vec3]:
        """Compute the attitude and rate (rad/s) of the reference at t (s)."""
        if self._last > -inf and t > self._last:
            since = t - self._last
            longest = SHARE * self.rate_limit / self.acceleration_limit
            parts = max(1, ceil(since / longest - 1e-9))
            q, rate = self._goal(t)
            for k in range(parts):
                if k > 0:
                    self._steer(q, rate, since / float(parts))
                self._q = propagate(self._q, self._rate, since / float(parts))
            self._q = normalise(self._q)
            self._last = t
            self._steer(q, rate, since / float(parts))
        elif self._last == -inf:
            self._q, self._rate = self._goal(t)
            self._last = t
        return self._q, self._rate

    def _steer(self, q: Vec4, rate: Vec3, dt: float) -> None:
        """Set the rate (rad/s) for the next part of a step, of dt (s)."""
        a, b, c, w = nearest(product(q, inverse(self._q)), (0.0, 0.0, 0.0, 1.0))
        angle = 2.0 * acos(min(max(w, -1.0), 1.0))
        size = sqrt(a * a + b * b + c * c)
        fast = min(
            sqrt(self.acceleration_limit * angle),
            angle / (FOLLOWS * dt),
            self.rate_limit,
        )
        goal = rate if size == 0.0 else add(rate, scale(fast / size, (a, b, c)))
        change = sub(goal, self._rate)
        most = self.acceleration_limit * dt + norm(sub(rate, self._wanted_before))
        if norm(change) > most:
            change = scale(most / norm(change), change)
        self._rate = add(self._rate, change)
        self._wanted_before = rate

    def _goal(self, t: float) -> tuple[Vec4, Vec3]:
        """Compute the attitude and rate (rad/s) that the plan wants at t (s)."""
        i = 0
        while i + 1 < self._rows and t >= self.plan[COLUMNS * (i + 1)]:
            i += 1
        mode = self.plan[COLUMNS * i + 1]
        result = (self._quaternion(i), ZERO)
        if mode == TARGET:
            result = self._to_target(t)
        elif mode == SUN:
            result = self._to_sun()
        elif mode == NADIR:
            result = self._to_nadir(normalise(self._quaternion(i)))
        else:
            result = (normalise(self._quaternion(i)), ZERO)
        if self._last == -inf:
            self._wanted_before = result[1]
        return result

    def _quaternion(self, i: int) -> Vec4:
        """Return the quaternion of a row."""
        x, y, z, w = self.plan[COLUMNS * i + 2 : COLUMNS * i + 6]
        return (x, y, z, w)

    def _to_nadir(self, q_bo: Vec4) -> tuple[Vec4, Vec3]:
        """Return attitude and rate (rad/s) of a body that holds q_bo in lvlh."""
        r, v = self.r_eci, self.v_eci
        rate = norm(cross(r, v)) / dot(r, r)
        return product(q_bo, lvlh_attitude(r, v)), rotate(q_bo, (0.0, -rate, 0.0))

    def _to_sun(self) -> tuple[Vec4, Vec3]:
        """Return attitude and rate (rad/s) with z to the Sun, y near ecliptic north."""
        if norm(self.sun_eci) == 0.0:
            self.fail("sun_eci is zero: no Sun is modelled")
        sun = unit(self.sun_eci)
        north = unit(cross(cross(sun, ECLIPTIC_NORTH), sun))
        return from_axes(cross(north, sun), north), ZERO

    def _place_target(self) -> Vec3:
        """Return the target's place (m) with the meridian of Greenwich along x."""
        e2 = FLATTENING * (2.0 - FLATTENING)
        s, c = sin(self.target_latitude), cos(self.target_latitude)
        across = EARTH_RADIUS / sqrt(1.0 - e2 * s * s)
        x, y = cos(self.target_longitude), sin(self.target_longitude)
        return (across * c * x, across * c * y, across * (1.0 - e2) * s)

    def _to_target(self, t: float) -> tuple[Vec4, Vec3]:
        """Return attitude and rate (rad/s) with z to the target, or nadir below it."""
        angle = self.earth_angle_start + EARTH_RATE * t
        c, s = cos(angle), sin(angle)
        x, y, z = self._site
        site = (c * x - s * y, s * x + c * y, z)
        r, v = self.r_eci, self.v_eci
        line = sub(site, r)
        distance = norm(line)
        up = unit(site)
        if asin(-dot(line, up) / distance) < self.elevation_limit:
            return self._to_nadir((0.0, 0.0, 0.0, 1.0))
        down = scale(1.0 / distance, line)
        moves = sub(cross((0.0, 0.0, EARTH_RATE), site), v)
        turning = scale(1.0 / distance, sub(moves, scale(dot(moves, down), down)))
        fall = scale(-MU / norm(r) ** 3, r)
        along = sub(v, scale(dot(v, down), down))
        change = sub(
            fall,
            add(
                scale(dot(fall, down) + dot(v, turning), down),
                scale(dot(v, down), turning),
            ),
        )
        ahead = unit(along)
        right = cross(down, ahead)
        twist = dot(right, change) / norm(along)
        rate = add(cross(down, turning), scale(twist, down))
        q = from_axes(ahead, right)
        return q, rotate(q, rate)
