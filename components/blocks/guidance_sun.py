from __future__ import annotations

from ..bases.pointing import PointingLaw
from ..contract.block import Parameter, Vec3, Vec4
from ..maths.attitude import from_axes, inverse, product, propagate, rotate
from ..maths.vector import add, cross, norm, scale, unit
from ..physics.earth import ECLIPTIC_NORTH

PARALLEL = 1e-3


class GuidanceSun(PointingLaw):
    """Sun pointing

        C(q_ref_bi) s = `axis_body`
        omega_ref_body = `sun_rate` C(q_ref_bi) n + `spin_rate` axis_body

    at each sample, held in between, with s the unit vector to the Sun and n the
    ecliptic's north. The rotation about s brings `second_body` as near to n as
    possible, and goes on from there by `spin_rate` t. The reference also holds in
    eclipse, as s is the direction to the Sun, visible or not.

    Seen from the Earth the Sun moves along the ecliptic by 0.953 to 1.019 deg a day;
    omega_ref_body has the mean rate; its error is at most 7e-9 rad/s. Seen from an
    orbit about the Sun, s moves at that orbit's rate.

    Source: geometry.
    """

    axis_body: Vec3 = Parameter(
        "1",
        "body axis that points to the Sun; of any length",
        start=(0.0, 0.0, 1.0),
        needs=("sun_eci",),
    )
    second_body: Vec3 = Parameter(
        "1",
        "body axis that is nearest to the ecliptic's north; across axis_body as far as it is "
        "used",
        start=(0.0, 1.0, 0.0),
    )
    sun_rate: float = Parameter(
        "rad/s",
        "rate of the Sun's direction about the ecliptic's north; start: from the Earth",
        start=1.990986e-7,
        min=0.0,
    )
    spin_rate: float = Parameter(
        "rad/s", "rate of the body about axis_body, from t = 0 on", usual=(-1.0, 1.0)
    )

    def start(self) -> None:
        """Check both directions; compute the rotation from their axes to the body."""
        super().start()
        if norm(self.axis_body) == 0.0:
            self.fail("axis_body is zero; a direction is needed")
        axis = unit(self.axis_body)
        across = cross(cross(axis, self.second_body), axis)
        if norm(across) <= PARALLEL * norm(self.second_body):
            self.fail(
                "second_body is zero or along axis_body; a direction across it is needed"
            )
        self._to_body = inverse(from_axes(axis, unit(across)))
        self.start_reference()

    def point(self, t: float) -> tuple[Vec4, Vec3]:
        """Compute the wanted attitude and rate (rad/s) from the direction to the Sun."""
        if norm(self.sun_eci) == 0.0:
            self.fail("sun_eci is zero: no Sun is modelled")
        sun = unit(self.sun_eci)
        north = unit(cross(cross(sun, ECLIPTIC_NORTH), sun))
        q = product(self._to_body, from_axes(sun, north))
        if self.spin_rate == 0.0:
            return q, scale(self.sun_rate, rotate(q, ECLIPTIC_NORTH))
        axis = unit(self.axis_body)
        q = propagate(q, scale(self.spin_rate, axis), t)
        north_rate = scale(self.sun_rate, rotate(q, ECLIPTIC_NORTH))
        return q, add(north_rate, scale(self.spin_rate, axis))
