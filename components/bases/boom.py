"""Provide the base of managers of a boom-stabilised craft.

It computes attitude and rate relative to the reference and handles lost measurements.
"""

from __future__ import annotations

from abc import abstractmethod

from ..contract.block import Mat33, Output, Vec3
from ..contract.roles import Manager, WheelAxes
from ..maths.attitude import inverse, matrix, product, rotate
from ..maths.vector import ZERO, sub
from ..physics.wheel_array import body_momentum, pseudo_inverse, to_wheels

NOTHING, NO_FIELD, NO_ATTITUDE, NO_RATE, NO_MOMENTUM = range(5)
X_AXIS: Vec3 = (1.0, 0.0, 0.0)
Y_AXIS: Vec3 = (0.0, 1.0, 0.0)
Z_AXIS: Vec3 = (0.0, 0.0, 1.0)


class Boom(Manager, WheelAxes):
    """Base of managers of a craft with a boom; a block adds `act` and `hold`.

    A measurement that is not valid is not used. Without a valid field, attitude or rate
    the coils are off and the wheels only hold the rate. Where the attitude is missing,
    the rate is relative to the reference as if the craft were aligned with it. Without
    a valid rate the wheels keep their momentum.
    """

    no_law = "it keeps a craft upright on a boom: attitude and momentum are one law of that craft"

    reason: int = Output(
        "1",
        "what is lost at this sample",
        interval=True,
        choices=("nothing", "no_field", "no_attitude", "no_rate", "no_momentum"),
    )

    _a: Mat33
    _rate: Vec3

    def start(self) -> None:
        super().start()
        self._to_wheels = pseudo_inverse(self.axes_wheel)
        self._a, self._rate = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), ZERO
        self.tau_cmd_wheel = (0.0,) * len(self.h_wheel)
        self.m_cmd_body = self.tau_cmd_thruster_body = ZERO
        self.reason = NOTHING

    @abstractmethod
    def act(self, t: float) -> None:
        """Command wheels and coils (`give`) at a valid sample.

        Field, attitude and rate are valid: `_a` takes vectors from the reference to
        body, `_rate` (rad/s, body) is relative to it.
        """

    @abstractmethod
    def hold(self, t: float) -> Vec3:
        """Compute the wheels' torque on the body (N m, body) against `_rate` alone."""

    def compute(self, t: float, dt: float) -> None:
        """Command wheels and coils at a sample by `act`, or hold the rate without."""
        if not self.due(t):
            return
        self.reason = NOTHING if self.valid_h else NO_MOMENTUM
        if not (self.valid_b and self.valid_q and self.valid_omega):
            self._without(t)
            return
        q = product(self.q_bi, inverse(self.q_ref_bi))
        self._a = matrix(q)
        self._rate = sub(self.omega_bi_body, rotate(q, self.omega_ref_body))
        self.act(t)

    def _without(self, t: float) -> None:
        """Hold the rate without a valid field or attitude.

        Without a valid rate the wheels keep their momentum.
        """
        if not self.valid_omega:
            self.reason = NO_RATE
            self.give(ZERO, ZERO)
            return
        reference = self.omega_ref_body
        self.reason = NO_ATTITUDE
        if self.valid_q:
            self.reason = NO_FIELD
            reference = rotate(product(self.q_bi, inverse(self.q_ref_bi)), reference)
        self._rate = sub(self.omega_bi_body, reference)
        self.give(ZERO, self.hold(t))

    def give(self, m: Vec3, torque: Vec3) -> None:
        """Command a dipole (A m2, body) and the wheels' torque on the body (N m)."""
        self.m_cmd_body = m
        x, y, z = torque
        self.tau_cmd_wheel = to_wheels(self._to_wheels, (-x, -y, -z))

    def momentum(self) -> Vec3:
        """Return the wheels' momentum (N m s, body) less its target.

        It is zero while the measurement is not valid.
        """
        if not self.valid_h:
            return ZERO
        return sub(body_momentum(self.axes_wheel, self.h_wheel), self.h_target_body)

    def need_wheel(self, axis: Vec3, setting: str) -> None:
        """Refuse to continue where no wheels give a torque along a body axis.

        The message begins with `setting`, the setting that needs the wheel.
        """
        torque = body_momentum(self.axes_wheel, to_wheels(self._to_wheels, axis))
        missing = sub(torque, axis)
        if max(abs(missing[0]), abs(missing[1]), abs(missing[2])) > 1e-6:
            self.fail(f"{setting}: axes_wheel has no wheel along body {axis}")
