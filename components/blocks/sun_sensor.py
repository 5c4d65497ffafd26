from __future__ import annotations

from math import cos, pi

from ..bases.sensing import Sensor
from ..contract.block import SMALL_ANGLE, Parameter, Vec3
from ..contract.roles import SunSensor as Role
from ..maths.attitude import rotate
from ..maths.noise import normal3, stream
from ..maths.vector import ZERO, add, dot, norm, scale, unit


class SunSensor(Role, Sensor):
    """Sun sensor

        s = C(q_bi) sun_eci,        sun_meas_body = unit(s + noise n)

    at each sample, held in between, where the Sun is seen: within `half_angle` of the
    boresight, and with no less than `sunlight_min` of its light. Otherwise the vector
    is zero and invalid. n are standard normal numbers, so `noise` is the angular error
    of each of the two axes across the direction. The noise is a function of seed,
    instance name and sample index.
    """

    boresight_body: Vec3 = Parameter(
        "1", "axis of the field of view, body; normalised", start=(0.0, 0.0, 1.0)
    )
    half_angle: float = Parameter(
        "rad",
        "half-angle of the field of view; pi: sees everywhere",
        start=pi,
        min=0.0,
        max=pi,
    )
    sunlight_min: float = Parameter(
        "1",
        "light of the Sun, over that at 1 astronomical unit, from which on it is seen",
        start=0.5,
        min=0.0,
        max=0.96,
    )
    noise: float = Parameter(
        "rad",
        "standard deviation of the direction, each of two axes",
        min=0.0,
        usual=SMALL_ANGLE,
    )

    def start(self) -> None:
        if not any(self.boresight_body):
            self.fail("boresight_body is zero; it must be a direction")
        self._boresight = unit(self.boresight_body)
        self._cosine = cos(self.half_angle)
        self._noise = stream(self.instance, "sun_meas_body", self.seed)
        super().start()

    def mark_failed(self) -> None:
        self.valid, self.sun_meas_body = False, ZERO

    def measure(self, sample: int, elapsed_time: float) -> None:
        """Measure the Sun's direction (1, body); invalid in shadow or out of view."""
        size = norm(self.sun_eci)
        if size == 0.0 or self.sunlight < self.sunlight_min:
            self.mark_failed()
            return
        s = rotate(self.q_bi, scale(1.0 / size, self.sun_eci))
        # the tolerance keeps half angles of pi and 0 valid in spite of rounding
        if dot(s, self._boresight) < self._cosine - 1e-12:
            self.mark_failed()
            return
        if self.noise > 0.0:
            s = unit(add(s, scale(self.noise, normal3(self._noise, sample))))
        self.sun_meas_body = s
