from __future__ import annotations

from ..contract.block import Parameter, Vec3
from ..contract.roles import Environment
from ..maths.attitude import IDENTITY_Q, propagate, rotate_back
from ..maths.vector import ZERO, cross, norm, unit


class EnvironmentBench(Environment):
    """A test bench: a field that stays, or turns at a rate, and a lamp

        B = field about the axis of field_rate by |field_rate| t,     r = r_start, v = v_start

    Position and velocity are those of an orbit, for components that need them, and are
    constant; the user has to switch off the gravity gradient of a spacecraft. The lamp
    is `sun`, with `light` times the Sun's light at 1 astronomical unit. There is no
    air.

    Source: a Helmholtz cage.
    """

    field: Vec3 = Parameter("T", "field at t = 0, eci", start=(0.0, 0.0, 3e-5))
    field_rate: Vec3 = Parameter(
        "rad/s", "rate at which the field turns, eci", usual=(-0.1, 0.1)
    )
    sun: Vec3 = Parameter("1", "direction to the lamp, eci; of any length, 0: none")
    light: float = Parameter(
        "1", "its light over the Sun's at 1 astronomical unit", min=0.0
    )
    r_start: Vec3 = Parameter("m", "position, eci", start=(7.0e6, 0.0, 0.0))
    v_start: Vec3 = Parameter("m/s", "velocity, eci", start=(0.0, 7546.05, 0.0))

    def start(self) -> None:
        if norm(self.r_start) == 0.0:
            self.fail(
                "r_start is zero; a position away from the Earth's centre is needed"
            )
        self.sun_eci = unit(self.sun) if norm(self.sun) > 0.0 else ZERO
        self.density, self.sunlight = 0.0, self.light
        self.r_eci, self.v_eci = self.r_start, self.v_start

    def output(self, t: float) -> None:
        self.b_eci = rotate_back(propagate(IDENTITY_Q, self.field_rate, t), self.field)
        self.b_rate_eci = cross(self.field_rate, self.b_eci)
        self.b_accel_eci = cross(self.field_rate, self.b_rate_eci)
